# SPDX-License-Identifier: GPL-3.0-or-later
"""Projections of volume data: extremes and means along rays, against numpy and formulas."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import scenes
from numpy.testing import assert_allclose, assert_array_equal

import leapray
from addon import film, methods, model, pipeline
from leapray.scalar_grid import Leaves, ScalarGrid

PASSES = "Combined", "Depth", "Position", "Object Index", "Volume", "Value"
MODES = [method.spec for method in methods.PROJECTIONS]
VOXEL = 0.125  # of a pixel's width, too: rays go through columns of samples
N = 24
# Rays in the last plane of samples along an axis are on the border, and see nothing.
OWN = np.s_[:-1, :-1]


def grid(samples, voxel=VOXEL, **more):
    """Samples (nz, ny, nx) round the origin."""
    matrix = np.diag([voxel] * 3 + [1.0])
    matrix[:3, 3] = -voxel * (np.array(samples.shape[::-1]) - 1) / 2
    return ScalarGrid("data", samples, matrix, **more)


def field(samples, contents="data", **more):
    held = samples if isinstance(samples, ScalarGrid) else grid(samples)
    return model.Field("Data", held, contents, (0.5,), **more)


def place(number=0, at=(0, 0, 0), linear=None, **more):
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = np.eye(3) if linear is None else linear, at
    given = {"name": f"Volume {number}", "world_from_object": matrix, "materials": (0,), **more}
    return model.FieldInstance(field=number, object_index=number + 1, **given)


def scene(fields, placed=None, view=None, size=N, meshes=(), **settings):
    """Seen along y, through columns of samples, by default."""
    view = view or scenes.camera(eye=(0, -6, 0), width=size, height=size, scale=VOXEL * size)
    things = [scenes.place(n) for n in range(len(meshes))]
    made = scenes.scene(list(meshes), things, view=view, width=size, height=size, **settings)
    placed = [place(n) for n in range(len(fields))] if placed is None else placed
    return dataclasses.replace(
        made, fields=tuple(fields), field_instances=tuple(placed), passes=PASSES
    )


def noise(seed=0, shape=(N, N, N)):
    return np.random.default_rng(seed).random(shape).astype(np.float32)


def passes(made):
    return {name: values[..., 0] for name, values in pipeline.render(made).passes.items()}


# ---- extremes -----------------------------------------------------------------------


@pytest.mark.parametrize(("mode", "along"), [("maximum", np.max), ("minimum", np.min)])
def test_extremes_along_columns_of_samples_are_numpys(mode, along):
    """Where rays go through samples, extremes of the trilinear field are those of the samples."""
    samples = noise()
    got = passes(scene([field(samples)], method=mode))
    want = along(samples, axis=1)  # rows from below: z
    assert_allclose(got["Value"][OWN], want[OWN], atol=1e-6)
    grey = (want - samples.min()) / np.ptp(samples)
    assert_allclose(got["Combined"][OWN], grey[OWN], atol=1e-6)
    first = samples.argmax(axis=1) if mode == "maximum" else samples.argmin(axis=1)
    assert_allclose(got["Depth"][OWN], (6 + VOXEL * (first - (N - 1) / 2))[OWN], atol=1e-5)
    assert want.std() > 0.01


def test_the_depth_coded_maximum_goes_from_red_to_blue():
    samples = np.zeros((N, N, N), np.float32)
    ramp = np.arange(N)
    samples[:, ramp, ramp] = 1.0  # in column x at y = x: farther to the right
    picture = pipeline.render(scene([field(samples)], method="maximum_depth")).passes["Combined"]
    row = picture[N // 2, :-1, :3]
    assert row[0, 0] > 0.95 and row[0, 1] < 0.2 and row[0, 2] < 0.05
    assert row[-1, 2] > 0.95 and row[-1, 1] < 0.4 and row[-1, 0] < 0.05
    assert row[N // 2, 1] > 0.95
    assert (np.diff(row[:, 2]) >= -1e-6).all() and (np.diff(row[:, 0]) <= 1e-6).all()


def test_of_several_volumes_the_best_value_counts_wherever_it_lies():
    first, second = noise(1), noise(2) + np.float32(0.02)
    fields = [field(first, "first"), field(second, "second")]
    made = scene(fields, [place(0, at=(0, 3.5, 0)), place(1)], method="maximum")
    got = passes(made)
    a, b = first.max(axis=1), second.max(axis=1)
    assert_allclose(got["Value"][OWN], np.maximum(a, b)[OWN], atol=1e-6)
    assert_array_equal(got["Object Index"][OWN], np.where(a > b, 1, 2)[OWN])
    assert 0.01 < (a > b).mean() < 0.99
    grey = (np.maximum(a, b) - first.min()) / (second.max() - first.min())
    assert_allclose(got["Combined"][OWN], grey[OWN], atol=1e-6)


@pytest.mark.parametrize("scale", [None, 4.0], ids=["perspective", "orthographic"])
def test_turned_and_stretched_volumes_are_seen_from_anywhere(scale):
    """Against a fine march through the trilinear field, of which it is an upper bound."""
    samples = noise(3, (9, 9, 9))
    linear = scenes_turn() @ np.diag([1.0, 1.6, 0.7])
    data = grid(samples, 0.3)
    view = scenes.camera(eye=(1, -5, 2), width=N, height=N, scale=scale)
    made = scene([field(data)], [place(linear=linear)], view=view, method="maximum")
    got = passes(made)["Value"]
    origins, directions = leapray.camera_rays(view, N, N)
    index = np.linalg.inv(made.field_instances[0].world_from_object @ data.world_from_index)
    best = np.full(N * N, -np.inf)
    for t in np.linspace(2, 9, 3000):
        at = (origins + t * directions) @ index[:3, :3].T + index[:3, 3]
        best = np.fmax(best, trilinear(samples, at))
    seen = np.isfinite(best)
    assert seen.mean() > 0.2
    assert_array_equal((got > 0).ravel()[seen], True)
    assert (got.ravel()[seen] >= best[seen] - 1e-6).all()
    assert_allclose(got.ravel()[seen], best[seen], atol=0.02)


def scenes_turn(angle=0.6):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ [[1, 0, 0], [0, c, -s], [0, s, c]]


def trilinear(samples, at):
    """Values at index coordinates (n, 3); -infinity outside."""
    last = np.array(samples.shape[::-1]) - 1
    inside = ((at >= 0) & (at <= last)).all(axis=1)
    low = np.clip(np.floor(at), 0, last - 1).astype(int)
    share = np.clip(at - low, 0, 1)
    value = np.zeros(len(at))
    for b in range(8):
        bits = np.array([b & 1, b >> 1 & 1, b >> 2])
        x, y, z = (low + bits).T
        value += samples[z, y, x] * np.prod(np.where(bits, share, 1 - share), axis=1)
    return np.where(inside, value, -np.inf)


# ---- means --------------------------------------------------------------------------


def test_the_x_ray_of_a_ball_is_the_chord_of_each_ray():
    """The mean of a field that is 1 in a ball and 0 outside, by the path through the data."""
    n, radius = 96, 1.0
    voxel = 2.6 / (n - 1)
    axis = (np.arange(n) - (n - 1) / 2) * voxel
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    inside = np.clip(0.5 + (radius - np.sqrt(x * x + y * y + z * z)) / voxel, 0, 1)
    made = scene([field(grid(inside.astype(np.float32), voxel))], size=48, method="mean",
                 view=scenes.camera(width=48, height=48, scale=2.4))  # fmt: skip
    got = passes(made)["Value"] * 2.6
    at = (np.arange(48) + 0.5 - 24) * 2.4 / 48
    square = at[:, None] ** 2 + at**2
    chord = 2 * np.sqrt(np.maximum(radius**2 - square, 0))
    inner = np.abs(np.sqrt(square) - radius) > 2 * voxel
    assert np.abs(got - chord)[inner].max() < 0.01 * 2 * radius
    assert np.abs(got - chord).max() < 0.3 and chord.max() > 1.99


def test_means_of_several_volumes_are_weighted_by_the_paths_in_the_world():
    """The second volume is as deep as three of the first, and so counts thrice."""
    ones, fours = np.ones((N, N, N), np.float32), np.full((N, N, N), 4, np.float32)
    fours[0] = 3.9  # or the data would have no range
    fields = [field(ones, "ones"), field(fours, "fours")]
    placed = [place(0), place(1, at=(0, 8, 0), linear=np.diag([1.0, 3.0, 1.0]))]
    got = passes(scene(fields, placed, method="mean"))["Value"]
    assert_allclose(got[2:-1, 1:-1], (1 + 3 * 4) / 4, atol=1e-6)


# ---- what counts --------------------------------------------------------------------


def test_what_is_no_value_and_what_lies_beyond_the_data_is_not_seen():
    samples = noise(4)
    samples[:, :, : N // 2] = np.nan
    wide = scenes.camera(eye=(0, -6, 0), width=2 * N, height=2 * N, scale=2 * VOXEL * N)
    for mode in MODES:
        frame = pipeline.render(scene([field(samples)], size=2 * N, view=wide, method=mode))
        value = frame.passes["Value"][..., 0]
        seen = value > 0
        assert not seen[:, :N].any() and seen[N // 2 : -N // 2 - 1, N : -N // 2 - 1].all()
        assert (frame.passes["Combined"][~seen] == [0, 0, 0, 1]).all()


def test_of_sparse_data_what_is_stored_counts():
    """A background in the middle of the values hides none of them, and is not seen alone."""
    block = noise(5, (8, 8, 8)) * np.float32(2) - np.float32(1)
    leaves = Leaves(np.zeros((1, 3), np.int32), block[None], background=0.0)
    matrix = np.diag([VOXEL] * 3 + [1.0])
    matrix[:3, 3] = -3.5 * VOXEL
    data = ScalarGrid("data", leaves, matrix)
    got = passes(scene([field(data)], method="minimum"))
    inner = np.s_[N // 2 - 3 : N // 2 + 3, N // 2 - 3 : N // 2 + 3]
    assert_allclose(got["Value"][inner], block.min(axis=1)[1:-1, 1:-1], atol=1e-6)
    assert (got["Object Index"][:4] == 0).all()


def test_fields_with_thresholds_labels_and_looks_show_all_their_values():
    samples = (noise(6) * 5).astype(np.uint8)
    look = model.Look(lambda v: np.ones((len(v), 3)), lambda v: np.zeros((len(v), 3)))
    want = passes(scene([field(samples)], method="maximum"))["Value"]
    for more in (
        {"thresholds": (99.0,)},  # that no value passes
        {"interpolation": "cubic", "least": 10},
        {"labels": model.Labels((1, 2), ((0,), (1,)))},
        {"look": look},
    ):
        other = dataclasses.replace(field(samples), **more)
        assert_array_equal(passes(scene([other], method="maximum"))["Value"], want)


def test_a_material_that_emits_gives_its_colors():
    samples = noise(7)

    def emission(values):
        return np.stack([2 * values, 0 * values, 2 * (1 - values)], axis=-1)

    look = model.Look(lambda v: np.zeros((len(v), 3)), emission)
    frame = pipeline.render(scene([field(samples, look=look)], method="maximum"))
    most = 2 * max(samples.max(), 1 - samples.min())
    want = emission(frame.passes["Value"][..., 0]) / most
    assert_allclose(frame.passes["Combined"][..., :3][OWN], want[OWN], atol=1e-3)


@pytest.mark.parametrize(
    ("samples", "why"),
    [
        (noise()[:1], "its data are a single layer of samples, between which there is no space"),
        (np.full((4, 4, 4), np.nan, np.float32), "its data hold no value"),
        (
            np.where(np.indices((4, 4, 4)).sum(0) % 2, noise(0, (4, 4, 4)), np.nan),
            "no eight samples that are neighbours hold values of which any is seen",
        ),
        (
            Leaves(np.zeros((0, 3), np.int32), np.zeros((0, 8, 8, 8), np.float32), background=0.0),
            "its data are empty",
        ),
    ],
    ids=["layer", "none", "apart", "empty"],
)
def test_what_shows_nothing_is_named(samples, why):
    data = grid(samples) if isinstance(samples, np.ndarray) else ScalarGrid("d", samples, np.eye(4))
    look = model.Look(*[lambda v: np.ones((len(v), 3))] * 2)
    frame = pipeline.render(scene([field(data)], method="maximum"))
    assert frame.warnings[0] == f"'Volume 0' shows nothing, for {why}."
    assert not frame.passes["Combined"][..., :3].any()
    lit = scene([field(data, look=look)], meshes=[scenes.sphere(1.0)])
    told = pipeline.render(lit).warnings
    assert told == frame.warnings[:1] or why == "its data are empty"  # light: its background


def test_an_infinite_value_is_named():
    samples = noise()
    for wild in (np.inf, -np.inf):
        samples[3, 3, 3] = wild
        told = pipeline.render(scene([field(samples)], method="maximum")).warnings
        assert told == [
            "'Volume 0' holds an infinite value, beside which all others look the same."
        ]


def test_smoothing_is_done_before():
    samples = noise(8)
    plain = passes(scene([field(samples)], method="maximum"))["Value"]
    smooth = passes(scene([field(samples, smoothing=1.0)], method="maximum"))["Value"]
    assert smooth.mean() < plain.mean() - 0.1


def test_data_that_do_not_fit_are_made_coarser_with_a_warning():
    samples = noise(9, (100, 100, 100))
    made = scene([field(grid(samples, 0.03))], method="maximum", memory_mb=2)
    frame = pipeline.render(made)
    assert any("is rendered with 50 x 50 x 50 samples" in w for w in frame.warnings)
    assert frame.passes["Value"].max() > 0.5


# ---- what is said -------------------------------------------------------------------


@pytest.mark.parametrize("mode", MODES)
def test_a_scene_without_data_is_refused_and_meshes_are_named(mode):
    with pytest.raises(leapray.LeapRayError) as error:
        pipeline.render(scenes.scene([scenes.sphere(n=4)], method=mode))
    assert str(error.value) == (
        f"The render method {mode} shows values of volume objects, and the scene has no data of any"
    )
    made = scene([field(noise())], meshes=[scenes.sphere(n=4)], method=mode)
    frame = pipeline.render(dataclasses.replace(made, passes=("Combined", "Value")))
    assert frame.warnings == [
        f"The render method {mode} shows values of volume objects alone, without 'Object 0'."
    ]
    assert frame.report["method"] == mode and frame.report["rays"] == N * N
    assert frame.report["values"] == pytest.approx([noise().min(), noise().max()])


def test_data_without_a_value_are_named_and_leave_the_picture_black():
    frame = pipeline.render(
        scene([field(np.full((4, 4, 4), np.nan, np.float32))], method="maximum")
    )
    assert frame.warnings == ["'Volume 0' shows nothing, for its data hold no value."]
    assert (frame.passes["Combined"][..., :3] == 0).all()


def test_a_pixel_is_refused_and_the_mean_has_no_depth():
    with pytest.raises(leapray.LeapRayError, match=r"of the render method rays, .* is mean$"):
        pipeline.render(scene([field(noise())], method="mean"), pixel=(1, 1))
    frame = pipeline.render(scene([field(noise())], method="mean"))
    assert set(frame.passes) == {"Combined", "Value"}
    assert frame.warnings == [
        "The render method mean does not make the passes Depth, Position, Object Index, Volume."
    ]


def test_a_stop_ends_it_and_frames_share_the_samples():
    from addon.store.memory_cache import Cache

    made, cache = scene([field(noise())], method="mean"), Cache()
    with pytest.raises(leapray.Stopped):
        pipeline.render(made, stop=lambda: True)
    first = pipeline.render(made, cache=cache)
    second = pipeline.render(scenes.replace(made, method="minimum"), cache=cache)
    assert first.report["seconds"]["voxelize"] > 0 == second.report["seconds"]["voxelize"]
    assert film.FAR > 1e9
