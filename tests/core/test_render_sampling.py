# SPDX-License-Identifier: GPL-3.0-or-later
"""Samples and passes: what tiles leave alone, the pixel's filter, noise, mist, occlusion."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from stage import FAR, at, ball, camera, centre_rays, clearance, one, slab, unit

import leapray
from leapray import Light, Lobe, Material, World, _abi

SIZE = (80, 72)


def of(kind, color=(0.8, 0.6, 0.4), **more):
    return Material([Lobe(kind, color, **more)])


@pytest.fixture(scope="module")
def still():
    """Every kind of ray: glass in glass, rough metal, a pane, an area light, a bright floor."""
    structure = leapray.build(ball(10.0))
    sky = np.random.default_rng(1).uniform(0, 1, (16, 32, 3)).astype(np.float32)
    glass = Material([Lobe("glass", ior=1.5, roughness=0.1)], absorption=(0.1, 0.5, 1))
    materials = [
        of("diffuse"),
        glass,
        of("glass", ior=1.33),
        of("glossy", roughness=0.3),
        Material([Lobe("transparent", weight=0.5), Lobe("diffuse", weight=0.5)]),
        Material([Lobe("emission", (2, 1, 0)), Lobe("glossy", roughness=0.0)]),
    ]
    instances = [
        one(leapray.build(slab()), at(z=-1)),
        one(structure, first_material=1),
        one(structure, at(scale=0.5), first_material=2),
        one(structure, at(-2, 0.5), first_material=3),
        one(structure, at(1, -1.5, scale=0.6), first_material=4),
        one(structure, at(2, 1, 0.5), first_material=5),
    ]
    lights = [
        Light("sun", (1, 1, 1), direction=unit(1, -1, 1), angle=0.1),
        Light("point", (3, 1, 1), position=(-1, -2, 1), radius=0.3, shape="sphere"),
        Light("area", (3, 3, 1), position=(0, 0, 4), direction=(0, 0, -1), axis_u=(2, 0, 0),
              axis_v=(0, 1, 0), angle=np.pi, shape="rectangle"),
    ]  # fmt: skip
    cam = camera((0.5, -5, 1.5), size=SIZE)
    return leapray.Scene(cam, instances, lights, materials, range(6), World((1, 1, 1), sky))


SETTINGS = dict(
    samples=10, seed=5, diffuse_bounces=2, pixel_filter="blackman_harris", noise_threshold=0.05,
    min_samples=4, passes=tuple(leapray.PASSES), branches=3,
)  # fmt: skip


@pytest.fixture(scope="module")
def whole(still):
    return still.render_tile(0, 0, *SIZE, **SETTINGS)


@pytest.mark.parametrize("threads", [1, 2, 7])
@pytest.mark.parametrize("side", [16, 64, 256])
def test_every_bit_of_recursion_is_the_same_in_any_tiles_and_threads(side, threads, still, whole):
    got = {name: np.empty_like(array) for name, array in whole.items()}
    width, height = SIZE

    def tile(corner):
        x, y = corner
        w, h = min(side, width - x), min(side, height - y)
        for name, array in still.render_tile(x, y, w, h, **SETTINGS).items():
            got[name][y : y + h, x : x + w] = array

    corners = [(x, y) for y in range(0, height, side) for x in range(0, width, side)]
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(tile, corners[::-1]))
    for name, array in whole.items():
        assert np.isfinite(array).all()
        np.testing.assert_array_equal(got[name], array, err_msg=name)


def test_choosing_among_branches_keeps_the_mean(still):
    def mean(n, seed=0):
        part = still.render_tile(20, 20, 40, 32, samples=32, diffuse_bounces=1, branches=n,
                                 seed=seed)  # fmt: skip
        return part["Combined"][..., :3].mean()

    all_followed = mean(16)
    for n, seed in ((1, 0), (1, 3), (2, 0)):
        assert mean(n, seed) == pytest.approx(all_followed, rel=0.03)


def test_clamps_limit_the_contribution_of_a_ray(sphere):
    mirror, radiance = Lobe("glossy", (1, 1, 1), roughness=0.0), (40.0, 20.0, 0.0)
    cam = camera((0, -4, 0))
    inner = clearance(*centre_rays(cam, (96, 64))) < 0.9
    ball_or_two = [one(sphere), one(leapray.build(ball(10.0)), at(scale=30.0), first_material=1)]
    materials = [Material([mirror]), Material([Lobe("emission", radiance)])]
    scene = leapray.Scene(cam, ball_or_two, (), materials, [0, 1])
    for name, limit, want in (("clamp_direct", 10.0, 0.5), ("clamp_indirect", 10.0, 1.0),
                              ("clamp_direct", 30.0, 1.0)):  # fmt: skip
        got = scene.render_tile(0, 0, 96, 64, samples=2, **{name: limit})["Combined"]
        np.testing.assert_allclose(got[inner][:, :3] / (40, 20, 1), [[want, want, 0]] * inner.sum())


def test_the_ambient_reaches_where_the_world_is_hidden_from_afar(sphere):
    cam = camera((0, -0.4, 0), (0, 1, 0), width=1.5)
    scene = leapray.Scene(cam, [one(sphere)], (), [of("diffuse", (1, 1, 1))], [0], World((1, 1, 1)))
    dark = scene.render_tile(0, 0, 96, 64, samples=64)["Combined"][..., :3]
    near = scene.render_tile(0, 0, 96, 64, samples=64, ambient_distance=1.0)["Combined"][..., 0]
    assert not dark.any()
    # chords of the unit sphere are 2 cos: those above 1 lie in the cone of 60 degrees
    assert near.mean() == pytest.approx(np.sin(np.radians(60)) ** 2, rel=0.005)


# ---- filter and noise --------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "width"), [("box", 1.5), ("blackman_harris", 1.5),
                                             ("blackman_harris", 0.8)])  # fmt: skip
def test_an_edge_is_blurred_by_the_pixels_filter(name, width):
    """A wall that ends at x = 0; columns see the integral of the filter up to there."""
    size = (16, 8)
    wall = one(leapray.build(slab(half=4.0, voxel=0.125)), at(x=4.0625))  # half a voxel beyond 4
    cam = camera((0.0031, 0, 9), (0.0031, 0, 0), size=size, width=0.16, kind="orthographic")
    scene = leapray.Scene(cam, [wall], (), [of("emission", (1, 1, 1))], [0])
    got = scene.render_tile(0, 0, *size, samples=4096, pixel_filter=name, filter_width=width)
    edge = -np.linspace(-8, 8, 17)[:-1] - 0.5 - 0.0031 / 0.01  # pixels from each centre
    x = np.linspace(0, 1, 100_001)
    a = 2 * np.pi * x
    window = 0.35875 - 0.48829 * np.cos(a) + 0.14128 * np.cos(2 * a) - 0.01168 * np.cos(3 * a)
    fraction = np.cumsum(window) / window.sum()
    place = edge + 0.5 if name == "box" else edge / (2 * width) + 0.5
    want = 1 - np.interp(place, x, x if name == "box" else fraction)
    assert ((want > 0.02) & (want < 0.98)).any()
    np.testing.assert_allclose(got["Combined"][..., 0].mean(0), want, atol=0.004)


@pytest.mark.slow
def test_settled_pixels_take_no_more_samples(still):
    part, counts = (20, 20, 40, 32), {}
    reference = still.render_tile(*part, samples=256, seed=9)["Combined"][..., :3]
    for threshold in (0.0, 0.06, 0.2):
        counters = _abi.lr_counters()
        got = still.render_tile(*part, samples=128, noise_threshold=threshold, min_samples=8,
                                counters=counters)["Combined"][..., :3]  # fmt: skip
        counts[threshold] = counters.rays
        error = np.abs(got - reference).sum(-1) / (1e-4 + np.sqrt(reference.sum(-1)))
        assert np.quantile(error, 0.95) < 0.12 + 2 * threshold  # a few glints settle later
    assert counts[0.2] < 0.5 * counts[0.06]
    assert counts[0.06] < 0.8 * counts[0.0]


def test_the_samples_of_a_choice_are_even(sphere):
    """The world by a Lambertian ball in the open: every stratum of the hemisphere once."""
    half = np.zeros((8, 16, 3), np.float32)
    half[:, :8] = 1  # half of the world emits
    cam = camera((0, 0, 4))
    errors = []
    for samples in (16, 64):
        scene = leapray.Scene(cam, [one(leapray.build(slab()))], (), [of("diffuse", (1, 1, 1))],
                              [0], World((1, 1, 1), half))  # fmt: skip
        got = scene.render_tile(0, 0, 96, 64, samples=samples)["Combined"][..., 0]
        errors.append(np.sqrt(((got - 0.5) ** 2).mean()))
    assert errors[0] < 0.5 * 0.5 / np.sqrt(16)  # random samples: 0.125
    assert errors[1] < 0.5 * 0.5 / np.sqrt(64)


# ---- passes ------------------------------------------------------------------------------------


@pytest.mark.parametrize(("falloff", "power"), [("LINEAR", 1), ("QUADRATIC", 2),
                                                ("INVERSE_QUADRATIC", 0.5)])  # fmt: skip
def test_mist_grows_with_the_distance(falloff, power, floor):
    cam = camera((0, -3, 1.2))
    scene = leapray.Scene(cam, [one(floor)], (), [of("diffuse")], [0], mist=(2.0, 4.0, falloff))
    got = scene.render_tile(0, 0, 96, 64, samples=1, passes=["Mist", "Depth"])
    d = centre_rays(cam, (96, 64))[1]
    distance = got["Depth"][..., 0] * np.linalg.norm(d, axis=-1)
    want = np.clip((distance - 2) / 4, 0, 1) ** power
    hit = got["Depth"][..., 0] < FAR
    np.testing.assert_allclose(got["Mist"][hit][:, 0], want[hit], atol=1e-5)
    assert (got["Mist"][~hit] == 1).all()
    assert ((want > 0.1) & (want < 0.9))[hit].mean() > 0.2


def test_ambient_occlusion_is_the_share_of_the_sky_within_reach(sphere, floor):
    cam = camera((0, 0, 9), size=(24, 24), width=4, kind="orthographic")
    body = one(sphere, at(0, 0, 1.6), visible_camera=False)
    scene = leapray.Scene(cam, [one(floor), body], (), [of("diffuse")], [0])
    setting = dict(samples=512, passes=["Ambient Occlusion", "Position"])
    got = scene.render_tile(0, 0, 24, 24, ao_distance=10.0, **setting)
    away = np.array([0, 0, 1.6]) - got["Position"]
    distance = np.linalg.norm(away, axis=-1)
    want = 1 - (away[..., 2] / distance) / distance**2
    error = got["Ambient Occlusion"][..., 0] - want
    assert want.min() < 0.65
    assert np.abs(error).max() < 0.04
    assert abs(error.mean()) < 0.002
    near = scene.render_tile(0, 0, 24, 24, ao_distance=0.55, **setting)
    assert (near["Ambient Occlusion"] == 1).all()  # the ball is 0.6 above


def test_emission_environment_and_indices_have_passes_of_their_own(sphere):
    shining = Material([Lobe("emission", (3, 2, 1)), Lobe("diffuse", (0.5,) * 3)], index=11)
    pane = Material([Lobe("transparent", (0.5,) * 3)], index=4)
    cam = camera((0, -4, 0))
    instances = [
        one(sphere, volume_index=5, error=0.01),
        one(sphere, at(0, -2.0, 0, 0.3), first_material=1, volume_index=6),
    ]
    scene = leapray.Scene(cam, instances, (), [shining, pane], [0, 1], World((1, 2, 4)))
    got = scene.render_tile(0, 0, 96, 64, samples=1, passes=tuple(leapray.PASSES))
    gap = clearance(*centre_rays(cam, (96, 64)))
    before = clearance(*centre_rays(cam, (96, 64)), (0, -2, 0))
    ball_seen, pane_seen, sky = (gap < 0.98) & (before > 0.31), before < 0.29, gap > 1.02
    np.testing.assert_allclose(got["Emission"][ball_seen], [[3, 2, 1]] * ball_seen.sum())
    np.testing.assert_allclose(got["Emission"][pane_seen], [[0.75, 0.5, 0.25]] * pane_seen.sum())
    np.testing.assert_allclose(got["Environment"][sky], [[1, 2, 4]] * sky.sum())
    assert not got["Environment"][ball_seen | pane_seen].any()
    for where, material, volume in ((ball_seen, 11, 5), (pane_seen, 4, 6), (sky, 0, 0)):
        assert (got["Material Index"][where] == material).all()
        assert (got["Volume"][where] == volume).all()
    depth = got["Depth"][ball_seen]
    np.testing.assert_allclose(got["Error"][ball_seen], 0.01 / (depth * 0.8 / 96), rtol=1e-5)


def test_a_transparent_film_keeps_what_a_pane_lets_through(sphere):
    cam = camera((0, -4, 0))
    pane = of("transparent", (0.5, 0.5, 0.5))
    scene = leapray.Scene(cam, [one(sphere)], (), [pane], [0], World((1, 1, 1)), True)
    got = scene.render_tile(0, 0, 96, 64, samples=1)["Combined"]
    gap = clearance(*centre_rays(cam, (96, 64)))
    np.testing.assert_allclose(got[gap < 0.98], [[0, 0, 0, 0.75]] * (gap < 0.98).sum())
    assert not got[gap > 1.02].any()


def test_what_is_wrong_with_sampling_is_said_in_a_sentence(still):
    cases = {
        "branches per pixel must be 1 to 16, they are 17": dict(branches=17),
        "bounces must be 0 to 1024, one is -1": dict(glossy_bounces=-1),
        "filter's width .* it is 0": dict(filter_width=0.0),
        "noise threshold .* -1": dict(noise_threshold=-1.0),
        "clamps .* -2": dict(clamp_direct=-2.0),
        "within 16777216 pixels of the origin": dict(x=-(1 << 31)),
        "unknown pixel filter 'mitchell'": dict(pixel_filter="mitchell"),
        "sampling is min_samples, .* not luck": dict(luck=1),
    }
    for sentence, change in cases.items():
        with pytest.raises(leapray.LeapRayError, match=sentence):
            still.render_tile(**{"x": 0, "y": 0, "width": 4, "height": 4, **change})


@pytest.mark.parametrize("traverser", [t.name for t in leapray.traversers() if t.exact])
def test_steps_are_the_cells_in_which_a_ray_stood(traverser):
    structure = leapray.build(ball(10.0), traverser)
    instances = [one(structure), one(structure, at(0, 2.5))]
    cam = camera((0.3, -4, 0.2), size=(32, 24))
    scene = leapray.Scene(cam, instances, (), [of("diffuse")], [0])
    counters = _abi.lr_counters()
    got = scene.render_tile(0, 0, 32, 24, samples=1, passes=["Steps"], counters=counters)
    assert got["Steps"].sum() == counters.cells
    alone = leapray.Scene(cam, instances[:1], (), [of("diffuse")], [0])
    steps = alone.render_tile(0, 0, 32, 24, samples=1, passes=["Steps"])["Steps"]
    o, d = (a.reshape(-1, 3) for a in centre_rays(cam, (32, 24)))
    for pixel in (0, 32 * 12 + 16, 32 * 12 + 24):
        want = leapray.trace(structure, o[pixel : pixel + 1], d[pixel : pixel + 1]).counters[
            "cells"
        ]
        assert steps.ravel()[pixel] == want


def test_sixteen_samples_tell_what_an_edge_covers(sphere):
    cam = camera((0, -4, 0), size=(128, 128), width=0.62)
    scene = leapray.Scene(cam, [one(sphere)], [], [Material([Lobe("emission", (1, 1, 1))])], [0])
    few, many = (
        scene.render_tile(0, 0, 128, 128, samples=n, seed=3)["Combined"][..., 0] for n in (16, 1024)
    )
    edge = (many > 0.02) & (many < 0.98)
    assert edge.sum() > 200
    error = (few - many)[edge]
    assert np.sqrt(np.mean(error**2)) < 0.055  # of 16 random samples: 0.1
    assert abs(error.mean()) < 0.01


def test_neighbours_errors_cancel(floor):
    """Noise that two by two pixels share falls by more than the 4 of independent ones."""
    cam = camera((0, 0, 9), size=(96, 96), width=3, kind="orthographic")
    light = Light("area", (3, 3, 3), position=(0, 0, 0.6), direction=(0, 0, -1), axis_u=(2, 0, 0),
                  axis_v=(0, 2, 0), angle=np.pi, shape="ellipse")  # fmt: skip
    scene = leapray.Scene(cam, [one(floor)], [replace(light, visible_camera=False)],
                          [of("diffuse")], [0])  # fmt: skip
    few, many = (
        scene.render_tile(0, 0, 96, 96, samples=n, seed=3)["Combined"][..., 0] for n in (4, 1024)
    )
    error = few - many
    shared = error.reshape(48, 2, 48, 2).mean((1, 3))
    assert error.std() > 0.01 * many.mean()
    assert shared.var() < error.var() / 7


WRAPPED = 1 << 32, -(1 << 31) - 1, 1 << 70, 1.5


@pytest.mark.parametrize("number", WRAPPED)
def test_whole_numbers_that_do_not_fit_are_refused_and_not_wrapped_around(number, sphere, still):
    def scene(lights=(), world=None, slots=(0,), slot_objects=None, **instance):
        things = [one(sphere, **instance)]
        cam, white = camera((0, -4, 0)), of("diffuse", (1, 1, 1))
        return leapray.Scene(cam, things, lights, [white], slots, world, slot_objects=slot_objects)

    calls = {
        "samples": lambda: still.render_tile(0, 0, 4, 4, samples=number),
        "seed": lambda: still.render_tile(0, 0, 4, 4, seed=number),
        "glossy_bounces": lambda: still.render_tile(0, 0, 4, 4, glossy_bounces=number),
        "slots": lambda: scene(slots=[number]),
        "slot_objects": lambda: scene(slot_objects=[number]),
        "object_index": lambda: scene(object_index=number),
        "max_bounces of light 0": lambda: scene([Light("sun", (1, 1, 1), max_bounces=number)]),
        "max_bounces must": lambda: scene(world=World((1, 1, 1), max_bounces=number)),
        "cells of start": lambda: leapray.trace(
            sphere, np.zeros((1, 3)), np.ones((1, 3)), start=([[number, 0, 0]], [1])
        ),
    }
    for sentence, call in calls.items():
        with pytest.raises(leapray.LeapRayError, match=f"{sentence}.* whole numbers in"):
            call()
