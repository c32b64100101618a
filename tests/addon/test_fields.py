# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces of scalar fields in a plan: their samples, their places, their share of the memory."""

import dataclasses
import re

import bspline
import numpy as np
import pytest
import scenes

import leapray
from addon import model, pipeline
from addon.plan import field_filters, objects, plan
from addon.store.memory_cache import Cache
from leapray.scalar_grid import Leaves, ScalarGrid

PASSES = "Combined", "Depth", "Position", "Normal", "Object Index", "Material Index", "Volume"
PASSES = *PASSES, "Error", "Steps"


def ball_grid(n=40, radius=1.0, dtype=np.int16, sides=(1.0, 1.0, 1.0)):
    """A field that falls by 1000 with the radius from 2000 at the origin, in stored halves."""
    voxel = 2.6 * radius / (n - 1)
    axis = (np.arange(n) - (n - 1) / 2) * voxel
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    values = 2000.0 - 1000.0 / radius * np.sqrt(x * x + y * y + z * z)
    matrix = np.diag([voxel, voxel, voxel, 1.0])
    matrix[:3, 3] = axis[0]
    stretched = np.diag([*sides, 1.0]) @ matrix
    stored = values * 2 if np.issubdtype(dtype, np.floating) else np.round(values * 2)
    stored = np.maximum(stored, 0) if np.issubdtype(dtype, np.unsignedinteger) else stored
    return ScalarGrid("ball", stored.astype(dtype), stretched, scale=0.5)


def field(grid=None, *thresholds, contents="ball", **more):
    return model.Field("Ball", ball_grid() if grid is None else grid, contents,
                       thresholds or (1000.0,), **more)  # fmt: skip


def place(number=0, **more):
    given = {"name": f"Volume {number}", "world_from_object": np.eye(4), "materials": (0,), **more}
    return model.FieldInstance(field=number, **given)


def scene(fields, placed=None, meshes=(), instances=(), **settings):
    made = scenes.scene(list(meshes), list(instances), **settings)
    placed = [place(n) for n in range(len(fields))] if placed is None else placed
    return dataclasses.replace(
        made, fields=tuple(fields), field_instances=tuple(placed), passes=PASSES
    )


def where(frame, index):
    return frame.passes["Object Index"][..., 0] == index


# ---- what is rendered -----------------------------------------------------------


@pytest.mark.parametrize("dtype", [np.int16, np.uint16, np.float32, np.float64])
def test_a_ball_is_a_ball_whatever_its_numbers_are(dtype):
    frame = pipeline.render(scene([field(ball_grid(dtype=dtype))], [place(object_index=3)]))
    seen = where(frame, 3)
    arm = frame.passes["Position"][seen]
    radius = np.linalg.norm(arm, axis=1)
    voxel = 2.6 / 39
    # an eighth of the voxel's square by both second derivatives, and half a stored step
    assert seen.sum() > 500 and np.abs(radius - 1).max() < voxel**2 / 4 + 0.25e-3 + 1e-5
    assert (frame.passes["Normal"][seen] * arm).sum(axis=1).min() > np.cos(np.radians(3))
    assert (frame.passes["Volume"][seen] == 1).all() and (frame.passes["Error"][seen] == 0).all()


def test_each_exact_traverser_gives_the_same_picture():
    depths = [
        pipeline.render(scene([field()], traverser=entry.spec)).passes["Depth"]
        for entry in leapray.traversers()
        if entry.exact
    ]
    assert len(depths) > 3 and (depths[0] < 1e9).sum() > 500
    for depth in depths[1:]:
        np.testing.assert_allclose(depth, depths[0], rtol=1e-6)


def test_surfaces_at_several_thresholds_are_volumes_with_slots_of_their_own():
    made = scene([field(None, 800.0, 1400.0)], [place(materials=(0, 1), object_index=2)])
    clear = model.Material("Clear", (model.Lobe("transparent"),), index=5)
    made = dataclasses.replace(
        made, materials=(clear, dataclasses.replace(made.materials[1], index=6))
    )
    frame = pipeline.render(made)
    rows = frame.report["volumes"]
    assert [row["threshold"] for row in rows] == [800.0, 1400.0]
    assert set(np.unique(frame.passes["Material Index"])) == {0.0, 5.0}
    middle = frame.passes["Combined"][32, 48]
    assert middle[0] > 3 * middle[1]  # the red one through the clear one


def test_below_the_threshold_may_be_inside():
    """Of a field that rises outwards the ball is what lies below."""
    grid = ball_grid()
    falling = dataclasses.replace(grid, scale=-0.5)
    frame = pipeline.render(scene([field(falling, -1000.0, above=False)], [place(object_index=1)]))
    radius = np.linalg.norm(frame.passes["Position"][where(frame, 1)], axis=1)
    assert len(radius) > 500 and np.abs(radius - 1).max() < 2e-3


def test_sparse_samples_lie_where_their_leaves_do():
    dense = ball_grid(n=40, dtype=np.float32)
    blocks = dense.samples.reshape(5, 8, 5, 8, 5, 8).transpose(0, 2, 4, 1, 3, 5)
    k, j, i = np.meshgrid(*[np.arange(5)] * 3, indexing="ij")
    origins = 8 * np.stack([i, j, k], axis=-1).reshape(-1, 3) - 16
    matrix = dense.world_from_index.copy()
    matrix[:3, 3] += matrix[:3, :3] @ (16, 16, 16)
    samples = Leaves(origins.astype(np.int32), blocks.reshape(-1, 8, 8, 8), -3000.0)
    sparse = dataclasses.replace(dense, samples=samples, world_from_index=matrix)
    assert (objects.lattice(sparse) == [[-17] * 3, [24] * 3]).all()
    one, other = (pipeline.render(scene([field(grid)])) for grid in (dense, sparse))
    np.testing.assert_allclose(one.passes["Depth"], other.passes["Depth"], atol=2e-5)


def test_layout_scene_keeps_volumes_apart_and_says_so():
    made = scene(
        [field()],
        [place(object_index=9, materials=(1,))],
        [scenes.plane(8.0), scenes.box()],
        [
            scenes.place(0, at=(0, 0, -1.5), object_index=1),
            scenes.place(1, at=(2.0, 0, 0), object_index=2),
        ],
        layout="scene",
    )
    frame = pipeline.render(made)
    assert {0.0, 1.0, 2.0, 9.0} >= set(np.unique(frame.passes["Object Index"])) >= {1.0, 2.0, 9.0}
    radius = np.linalg.norm(frame.passes["Position"][where(frame, 9)], axis=1)
    assert np.abs(radius - 1).max() < 2e-3
    assert any("volumes of their own" in each for each in frame.warnings)
    alone = pipeline.render(scene([field()], [place(object_index=9)], layout="scene"))
    assert where(alone, 9).sum() > 500


def test_what_no_ray_reaches_is_not_built():
    aside = np.eye(4)
    aside[0, 3] = 50.0
    made = scene([field(), field(contents="other")], [place(0), place(1, world_from_object=aside)])
    made = dataclasses.replace(made, world=model.World((0.0, 0.0, 0.0)))
    frame = pipeline.render(made)
    assert [row["name"] for row in frame.report["volumes"]] == ["Volume 0"]


# ---- what is wrong ----------------------------------------------------------------


@pytest.mark.parametrize("threshold", [5000.0, -5000.0])
def test_a_threshold_beyond_the_data_is_a_sentence_with_their_range(threshold):
    made = scene([field(None, threshold)], meshes=[scenes.box()], instances=[scenes.place()])
    frame = pipeline.render(made)
    (warning,) = frame.warnings
    told = re.fullmatch(
        r"'Volume 0' has no surface at (\S+), .* between (\S+) and (\S+)\.", warning
    )
    assert told and float(told[1]) == threshold
    assert float(told[2]) == pytest.approx(-251, abs=2)
    assert float(told[3]) == pytest.approx(1942, abs=2)
    with pytest.raises(leapray.LeapRayError, match=r"Nothing is left.*no surface at"):
        pipeline.render(scene([field(None, threshold)]))


def test_bad_places_and_thresholds_are_sentences():
    flat = ball_grid()
    flat = dataclasses.replace(flat, world_from_index=np.diag([0.1, 0.1, 0.0, 1.0]))
    bad = np.diag([1.0, 0.0, 1.0, 1.0])
    made = scene(
        [field(flat), field(None, np.nan), field()],
        [place(0), place(1), place(2, world_from_object=bad), place(2, name="Good")],
    )
    frame = pipeline.render(made)
    assert len(frame.warnings) == 3 and len(frame.report["volumes"]) == 1
    for number, words in enumerate(("span space", "threshold is not finite", "no inverse")):
        assert any(f"'Volume {number}'" in w and words in w for w in frame.warnings)


# ---- filters ---------------------------------------------------------------------------


def test_labels_are_smoothed_as_one_region():
    labels = np.zeros((12, 12, 12), np.uint8)
    labels[:, :, 3:7], labels[:, :, 7:] = 3, 200
    grid = ScalarGrid("labels", labels, np.eye(4), kind="labels")
    made = field_filters.filtered(
        field(grid, 0.5, smoothing=1.0), 0.5, 1, np.inf, 1, leapray.Watch()
    )
    across = made.samples[6, 6]
    assert across.max() <= 1.0 + 1e-6 and abs(across[7:10] - 1).max() < 1e-2
    assert across[2] < 0.5 < across[3]


def test_filters_take_sparse_fields_as_arrays_of_the_same_place():
    rng = np.random.default_rng(4)
    samples = Leaves(
        np.array([(-8, 0, 16)], np.int32),
        rng.normal(size=(1, 8, 8, 8)),
        -1.0,
        np.array([(0, 0, 16)], np.int32),
        np.array([8], np.int32),
        np.array([5.0]),
    )
    matrix = np.diag([0.5, 0.25, 2.0, 1.0])
    matrix[:3, 3] = 1, 2, 3
    made = field_filters.dense(ScalarGrid("sparse", samples, matrix))
    assert made.samples.shape == (10, 10, 18)
    np.testing.assert_array_equal(made.samples[1:9, 1:9, 1:9], samples.samples[0])
    assert (made.samples[1:9, 1:9, 9:17] == 5.0).all() and made.samples[0].max() == -1.0
    first = made.world_from_index @ (1, 1, 1, 1)
    np.testing.assert_allclose(first, matrix @ (-8, 0, 16, 1))
    far = dataclasses.replace(samples, tile_origins=np.array([(80000, 80000, 16)], np.int32))
    with pytest.raises(leapray.LeapRayError, match="too large to be filtered"):
        field_filters.dense(ScalarGrid("far", far, matrix))


def test_a_cubic_field_is_rendered_as_its_spline():
    grid = ball_grid(n=20, dtype=np.float32)
    made = field(grid, contents="coarse ball", interpolation="cubic")
    cache, shown = Cache(), [place(object_index=1)]
    frame = pipeline.render(scene([made], shown), cache=cache)
    seen = where(frame, 1)
    points = frame.passes["Position"][seen].astype(float)
    index = (points - grid.world_from_index[:3, 3]) / grid.world_from_index[0, 0]
    spline = bspline.Spline(0.5 * grid.samples.astype(float), outside=None)
    assert seen.sum() > 500
    np.testing.assert_allclose(spline.value(index), 1000.0, atol=1e-2)
    outward = -spline.gradient(index)
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    assert (frame.passes["Normal"][seen] * outward).sum(axis=1).min() > 1 - 1e-5
    linear = dataclasses.replace(made, interpolation="linear")
    other = pipeline.render(scene([linear], shown), cache=cache)  # not the one that is kept
    assert (
        np.abs(other.passes["Depth"] - frame.passes["Depth"])[seen & where(other, 1)].max() > 1e-3
    )
    with pytest.raises(leapray.LeapRayError, match="newton, bisect or linear"):
        pipeline.render(scene([made], shown, root="cubic"))


def test_filters_reach_the_picture():
    grid = ball_grid()
    specks = grid.samples.copy()
    specks[2:38:5, 2:38:5, 0:3] = 4000
    made = field(dataclasses.replace(grid, samples=specks), contents="specks")
    rough = pipeline.render(scene([made], [place(object_index=1)]))
    clean = pipeline.render(scene([dataclasses.replace(made, least=50)], [place(object_index=1)]))
    alone = pipeline.render(scene([field()], [place(object_index=1)]))
    assert where(rough, 1).sum() > where(alone, 1).sum() + 50
    np.testing.assert_array_equal(where(clean, 1), where(alone, 1))
    soft = pipeline.render(scene([dataclasses.replace(made, smoothing=2.0)]))
    assert (soft.passes["Depth"] != rough.passes["Depth"]).any()


# ---- memory and caches --------------------------------------------------------------


def test_what_does_not_fit_is_made_coarser_and_both_sizes_are_named():
    grid = ball_grid(n=160, dtype=np.float32)
    frame = pipeline.render(scene([field(grid)], [place(object_index=1)], memory_mb=6))
    (warning,) = frame.warnings
    told = re.match(
        r"'Volume 0' is rendered with (\d+) x \1 x \1 samples of its 160 x 160 x 160", warning
    )
    assert told and int(told[1]) in (80, 40)
    radius = np.linalg.norm(frame.passes["Position"][where(frame, 1)], axis=1)
    assert np.abs(radius - 1).max() < (2.6 / int(told[1])) ** 2
    (row,) = frame.report["volumes"]
    assert frame.passes["Error"][where(frame, 1)].min() > 0 and row["error_footprints"] is None
    assert row["nbytes"] <= 6 * plan.MB and row["coarser"] == 160 // int(told[1])


def test_of_a_field_without_surfaces_only_what_is_seen_need_fit():
    """The middle of a ball, of whose samples all take 8 MB."""

    def dense(values):
        return np.repeat(np.clip((values - 1500) / 100, 0, 1)[:, None], 3, axis=1)

    def dark(values):
        return np.zeros((len(values), 3))

    grid = ball_grid(n=160, dtype=np.uint16)
    seen = field(grid, look=model.Look(dense, dark, key=b"middle"))
    small, large = (
        pipeline.render(scene([dataclasses.replace(seen, thresholds=())], memory_mb=size))
        for size in (5, 64)
    )
    assert small.warnings == large.warnings == []
    one, other = (frame.report["volumes"][0]["volume_nbytes"] for frame in (small, large))
    assert one < 4 * plan.MB < 8 * plan.MB < other
    np.testing.assert_array_equal(small.passes["Combined"], large.passes["Combined"])
    everything = model.Look(lambda values: dense(values + 5000), dark, key=b"all")
    coarse = pipeline.render(scene([dataclasses.replace(seen, look=everything)], memory_mb=5))
    (warning,) = coarse.warnings
    assert "samples of its 160 x 160 x 160" in warning


def test_samples_that_surfaces_share_are_counted_once():
    grid = ball_grid(n=96, dtype=np.uint16)
    one, three = (
        pipeline.render(scene([field(grid, *thresholds)], [place(materials=(0,))]))
        for thresholds in ((800.0,), (800.0, 1000.0, 1400.0))
    )
    rows = three.report["volumes"]
    first, *others = (row["volume_nbytes"] for row in rows)
    assert first == one.report["volumes"][0]["volume_nbytes"] > 2 * 80**3
    assert max(others) < first / 4  # tables and surface cells
    assert sum(row["nbytes"] for row in rows) == sum(
        three.report["bytes"][name] for name in ("volumes", "structures")
    )


def test_three_surfaces_fit_where_their_samples_fit_once():
    grid = ball_grid(n=96, dtype=np.uint16)
    frame = pipeline.render(
        scene([field(grid, 800.0, 1000.0, 1400.0)], [place(materials=(0,))], memory_mb=5)
    )
    assert frame.warnings == [] and {row["coarser"] for row in frame.report["volumes"]} == {1}


def test_what_reading_took_counts_in_the_budget():
    grid = ball_grid(n=96, dtype=np.uint16)
    coarser = [
        pipeline.render(
            scene([field(grid, contents=f"{n}", read_nbytes=n << 20)], memory_mb=5)
        ).report["volumes"][0]["coarser"]
        for n in (0, 3)
    ]
    assert coarser[0] == 1 < coarser[1]


def test_a_large_field_leaves_room_for_a_small_one_and_for_meshes():
    large, small = ball_grid(n=160, dtype=np.float32), ball_grid(n=32)
    made = scene(
        [field(large, contents="large"), field(small, contents="small")],
        [place(0), place(1, world_from_object=np.diag([0.5, 0.5, 0.5, 1.0]))],
        [scenes.sphere()],
        [scenes.place(at=(1.5, 0, 0))],
        memory_mb=12,
    )
    frame = pipeline.render(made)
    coarser = {row["field"]: row["coarser"] for row in frame.report["volumes"] if "field" in row}
    assert len(coarser) == 1 or coarser  # both have the same name
    rows = {row["name"]: row for row in frame.report["volumes"]}
    assert rows["Volume 0"]["coarser"] > 1 and rows["Volume 1"]["coarser"] == 1
    assert "Object 0" in rows and frame.report["bytes"]["volumes"] < 12 * plan.MB


def test_frames_share_what_has_not_changed():
    cache, made = Cache(), scene([field()])
    first = pipeline.render(made, cache=cache)
    again = pipeline.render(made, cache=cache)
    assert first.report["seconds"]["structure"] > 0 and again.report["seconds"]["structure"] == 0
    np.testing.assert_array_equal(first.passes["Depth"], again.passes["Depth"])
    for other in (field(None, 900.0), field(None, above=False), field(contents="other")):
        changed = dataclasses.replace(made, fields=(other,))
        assert pipeline.render(changed, cache=cache).report["seconds"]["structure"] > 0


def test_a_stop_ends_the_making_of_surfaces():
    watch = leapray.Watch()
    watch.stop()
    with pytest.raises(leapray.Stopped):
        plan.make(scene([field()]), Cache(), watch, 1)
