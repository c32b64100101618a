# SPDX-License-Identifier: GPL-3.0-or-later
"""Tiles of scenes: geometry, instances, samples, and what is refused."""

from __future__ import annotations

import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from stage import (
    EXACT,
    FAR,
    VOXELS,
    WHITE,
    at,
    ball,
    camera,
    centre_rays,
    clearance,
    meet_sphere,
    one,
    render,
    unit,
)

import leapray
from leapray import _abi

# ---- geometry ----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", EXACT)
@pytest.mark.parametrize("kind", ["perspective", "orthographic"])
def test_geometry_passes_of_a_sphere_follow_its_formulas(name, kind):
    cam = camera((1, -4, 2), width=0.8 if kind == "perspective" else 3.0, kind=kind)
    got = render(cam, [one(leapray.build(ball(), name), object_index=7)])
    o, d = centre_rays(cam, (96, 64))
    gap, t = clearance(o, d), meet_sphere(o, d)
    hit, miss = gap < 1 - 0.02 / VOXELS, gap > 1
    assert 0.2 < hit.mean() < 0.8
    assert (hit | miss).mean() > 0.99
    normal = o + t[..., None] * d
    radial = (got["Depth"][..., 0] - t) * (d * normal).sum(-1)
    assert np.abs(radial[hit & (gap < 0.98)]).max() < 0.011 / VOXELS * 1.3  # the ray is oblique
    np.testing.assert_allclose(got["Position"][hit], (o + got["Depth"] * d)[hit], atol=1e-6)
    angle = np.degrees(np.arccos(np.clip((got["Normal"] * normal).sum(-1), -1, 1)))
    assert angle[hit].max() < 1.5  # near the rim points slide along the surface
    assert np.median(angle[hit]) < 0.05
    np.testing.assert_allclose(np.linalg.norm(got["Normal"][hit], axis=-1), 1, atol=1e-6)
    assert (got["Object Index"][hit] == 7).all()
    assert (got["Depth"][miss] == np.float32(FAR)).all()
    for name in ("Object Index", "Normal", "Position"):
        assert not got[name][miss].any()


def test_clipping_the_front_away_shows_the_inner_wall_from_inside(sphere):
    cam = camera((0, -4, 0), clip_start=4.0)
    got = render(cam, [one(sphere)])
    o, d = centre_rays(cam, (96, 64))
    hit = clearance(o, d) < 0.9
    t = meet_sphere(o, d, far=True)
    np.testing.assert_allclose(got["Depth"][hit][:, 0], t[hit], atol=0.02 / VOXELS)
    inwards = -(o + t[..., None] * d)
    assert (got["Normal"] * inwards).sum(-1)[hit].min() > 0.9999
    behind = render(replace(cam, clip_start=1.0, clip_end=2.9), [one(sphere)])
    assert (behind["Depth"] == np.float32(FAR)).all()


def test_geometry_comes_from_the_pixel_centre_whatever_samples_and_seed(sphere):
    few = render(camera((0, -4, 0)), [one(sphere)], samples=1, seed=1)
    many = render(camera((0, -4, 0)), [one(sphere)], samples=5, seed=2)
    for name in ("Depth", "Normal", "Position", "Object Index"):
        np.testing.assert_array_equal(few[name], many[name])
    assert (few["Combined"][..., 3] == 1).all()


@pytest.mark.parametrize(
    "matrix",
    [
        pytest.param(np.diag([-1.0, 1, 1, 1]), id="mirrored"),
        pytest.param(np.diag([1.3, 0.4, -0.7, 1]), id="unequal and mirrored"),
        pytest.param(
            [[1, 0.6, 0, 0.2], [0, 0.8, 0.3, 0], [0.2, 0, 1, -0.1], [0, 0, 0, 1]], id="sheared"
        ),
    ],
)
def test_an_instance_equals_its_volume_placed_by_the_same_map(matrix, sphere):
    matrix = np.array(matrix, float)
    setting = dict(lights=[leapray.Light("sun", (3, 2, 1), direction=unit(1, -1, 2))], samples=4)
    got = render(camera((1, -4, 2)), [one(sphere, matrix)], **setting)
    want = render(camera((1, -4, 2)), [one(leapray.build(ball(placed=matrix)))], **setting)
    assert 0.02 < (want["Depth"] < FAR).mean() < 0.9
    same = (got["Depth"] < FAR) == (want["Depth"] < FAR)
    assert same.mean() > 0.999
    np.testing.assert_allclose(got["Depth"][same], want["Depth"][same], rtol=1e-6)
    inner = same[..., 0]
    assert (got["Normal"] * want["Normal"]).sum(-1)[
        inner & (want["Depth"] < FAR)[..., 0]
    ].min() > 0.99999
    assert np.abs(got["Combined"] - want["Combined"]).max(-1).mean() < 1e-4
    assert (np.abs(got["Combined"] - want["Combined"]).max(-1) < 1e-4).mean() > 0.999


def scatter(n, seed, structure):
    """n spheres of different size, stretched, turned and mirrored, in a cube."""
    rng = np.random.default_rng(seed)
    for i in range(n):
        turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        matrix = np.eye(4)
        matrix[:3, :3] = turn * rng.uniform(0.3, 1, 3) * 0.6 / n ** (1 / 3)
        matrix[:3, 3] = rng.uniform(-1, 1, 3)
        yield one(structure, matrix, object_index=i + 1)


def test_ten_thousand_instances_equal_every_instance_asked_in_turn():
    structure = leapray.build(ball(6.0))
    instances = list(scatter(10_000, 1, structure))
    size = (40, 30)
    cam = camera((0.3, -3.2, 0.2), size=size, width=0.9)
    got = render(cam, instances, size=size)
    o, d = (a.reshape(-1, 3) for a in centre_rays(cam, size))
    nearest, index = np.full(len(o), np.inf), np.zeros(len(o))

    def ask(part):
        for i in part:
            inverse = np.linalg.inv(instances[i].world_from_object)
            origins, directions = o @ inverse[:3, :3].T + inverse[:3, 3], d @ inverse[:3, :3].T
            near = clearance(origins, directions) < 1.2  # else it is far from the sphere
            t = leapray.trace(structure, origins[near], directions[near], count=False).t
            yield i, np.flatnonzero(near), t

    with ThreadPoolExecutor(1) as pool:  # off the main thread, where calls are cheaper
        for i, rays, t in pool.submit(lambda: list(ask(range(len(instances))))).result():
            better = t < nearest[rays]
            nearest[rays[better]], index[rays[better]] = t[better], i + 1
    assert 0.5 < np.isfinite(nearest).mean() < 1
    np.testing.assert_array_equal(got["Object Index"].ravel(), index)
    depth = np.where(np.isfinite(nearest), nearest, FAR)
    np.testing.assert_allclose(got["Depth"].ravel(), depth, rtol=1e-6)


def test_of_coincident_instances_the_first_is_seen_everywhere(sphere):
    others = list(scatter(40, 3, sphere))
    others = [replace(i, world_from_object=at(0, 5, 0) @ i.world_from_object) for i in others]
    for first in (0, 17):
        instances = [*others[:first], one(sphere, object_index=101), *others[first:]]
        instances += [one(sphere, object_index=102 + k) for k in range(3)]
        index = render(camera((0.7, -4, 0.3)), instances)["Object Index"]
        assert (index == 101).mean() > 0.2
        assert not (index > 101).any()


def two_balls():
    z, y, x = np.mgrid[:40, :40, :40] - 19.6
    plain = np.clip(0.5 + (8 - np.sqrt(x * x + y * y + z * z)) / 5, 0, 1).astype(np.float32)
    more = plain.copy()
    more[33:36, 33:36, 3:6] = 1
    return leapray.Volume(plain), leapray.Volume(more)


def two_sheets():
    """Their common surface is the upper face of cell 0, hence of the first one's box."""
    rows = np.float32([0.3, 0.5, 0.7, 0.7, 0.7, 0.3])
    field = np.broadcast_to(rows[:, None, None], (6, 40, 40))
    touched = np.zeros(field.shape, bool)
    touched[0, :39, :39] = True
    more = touched.copy()
    more[4, 35:37, 3:5] = True
    return [leapray.Volume(field, sheet=True, touched=t) for t in (touched, more)]


@pytest.mark.parametrize("make", [two_balls, two_sheets])
def test_of_equal_surfaces_the_first_is_seen_though_the_box_of_the_second_comes_before(make):
    cam = camera((41.3, 60.1, 40.7), (19.6, 19.6, 12), width=1.2)
    pair = [one(leapray.build(volume), object_index=i + 1) for i, volume in enumerate(make())]
    position = render(cam, pair[:1])["Position"]
    same = (position != 0).any(-1)
    assert same.mean() > 0.05
    index = render(cam, pair)["Object Index"]
    assert (index == 2).any()  # the crumb that makes the box of the second larger
    assert (index[same] == 1).mean() > 0.99  # which may hide a little
    turned = render(cam, pair[::-1])
    assert (index == 2)[same].sum() == (turned["Position"] != position)[same].any(-1).sum()
    assert (turned["Object Index"][same] == 2).all()


@pytest.mark.parametrize("far", [1.0, 1e4])
def test_a_sheet_that_lies_in_the_face_of_its_cells_has_no_holes(far):
    rows = np.float32([0.3, 0.5, 0.7])  # the surface is the upper face of cell 0
    field = np.broadcast_to(rows[:, None, None], (3, 50, 50))
    touched = np.zeros(field.shape, bool)
    touched[0] = True
    volume = leapray.Volume(field, sheet=True, touched=touched)
    turn, _ = np.linalg.qr(np.random.default_rng(8).normal(size=(3, 3)))
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = turn, -turn @ (24.5, 24.5, 1)
    for side in (1, -1):
        eye = far * (side * turn[:, 2] * 30 + turn[:, 0] * 20)
        got = render(camera(eye, width=0.3 / far), [one(leapray.build(volume), matrix)])
        depth_error = got["Position"] @ turn[:, 2]
        assert (got["Depth"] < FAR).all()
        assert np.abs(depth_error).max() < 1e-5
        assert (got["Normal"] @ turn[:, 2] * side).min() > 0.999999


def test_the_picture_does_not_depend_on_the_unit_of_length(sphere, floor):
    def picture(unit_of_length):
        grow = np.diag([unit_of_length] * 3 + [1])
        cam = camera((1, -4, 3))
        longer = {k: getattr(cam, k) * unit_of_length for k in ("eye", "corner", "dx", "dy")}
        cam = replace(cam, forward=cam.forward, **longer)
        instances = [one(sphere, grow), one(floor, grow @ at(z=-1.0))]
        sun = leapray.Light("sun", (3, 3, 3), direction=unit(1, 1, 1))
        return render(cam, instances, [sun], world=(0.2, 0.3, 0.4), samples=4)["Combined"]

    np.testing.assert_array_equal(picture(1.0), picture(2.0**-30))
    np.testing.assert_array_equal(picture(1.0), picture(2.0**30))


# ---- film and materials ------------------------------------------------------------------------


def test_alpha_is_the_covered_share_of_the_pixel(sphere):
    cam = camera((0, -4, 0), width=3, kind="orthographic")
    got = render(cam, [one(sphere)], world=(1, 0.5, 0.25), transparent=True, samples=64)
    alpha = got["Combined"][..., 3]
    assert 0.005 < ((alpha > 0) & (alpha < 1)).mean() < 0.1
    area = alpha.sum() * (3 / 96) ** 2
    assert abs(area - np.pi) < 0.003 * np.pi  # the voxels' sphere is 0.04 % smaller
    np.testing.assert_allclose(got["Combined"][..., 1], 0.5 * alpha, atol=0.02)
    opaque = render(cam, [one(sphere)], world=(1, 0.5, 0.25), samples=2)["Combined"]
    assert (opaque[..., 3] == 1).all()
    assert (opaque[0, 0] == (1, 0.5, 0.25, 1)).all()


def test_a_pixels_samples_fill_it_evenly(sphere):
    cam = camera((0, -4, 0), size=(48, 32), width=3, kind="orthographic")
    got = render(cam, [one(sphere)], transparent=True, samples=64, size=(48, 32))
    fine = camera((0, -4, 0), size=(48 * 32, 32 * 32), width=3, kind="orthographic")
    covered = clearance(*centre_rays(fine, (48 * 32, 32 * 32))) < 1 - 1 / 6 / VOXELS**2
    want = covered.reshape(32, 32, 48, 32).mean(axis=(1, 3))
    rim = (want > 0) & (want < 1)
    error = (got["Combined"][..., 3] - want)[rim]
    assert rim.sum() > 50
    assert np.sqrt((error**2).mean()) < 0.03  # 64 random samples: 0.05
    assert np.abs(error).max() < 0.08


def test_a_hits_id_chooses_its_slot_and_the_last_slot_serves_all_beyond():
    ids = lambda x, y, z: np.where(x < 0, 0, np.where(z < 0, 1, 9)).astype(np.uint16)  # noqa: E731
    materials = [leapray.Material.diffuse(c) for c in np.eye(3)]
    setting = dict(materials=materials, slots=[2, 0, 1], world=(1, 1, 1))
    structure = leapray.build(ball(ids=ids))
    cam = camera((0, -4, 0))
    two = [one(structure, first_material=1, n_materials=2, object_index=5)]
    got = render(cam, two, slot_objects=[3, 4, 6], **setting)
    x, _, z = np.moveaxis(got["Position"], -1, 0)
    hit = (got["Depth"] < FAR)[..., 0]
    left, right = hit & (x < -0.05), hit & (x > 0.05)
    assert left.sum() > 200
    assert not got["Combined"][left][:, 1:3].any()
    assert not got["Combined"][right][:, [0, 2]].any()
    assert (got["Object Index"][left] == 4).all()
    assert (got["Object Index"][right] == 6).all()
    three = [one(structure, n_materials=3, object_index=5)]
    got = render(cam, three, **setting)
    assert not got["Combined"][left][:, :2].any()
    assert not got["Combined"][right & (z < -0.05)][:, 1:3].any()
    assert (got["Object Index"][hit] == 5).all()


def test_no_instances_leave_the_world_or_nothing():
    got = render(camera((0, -4, 0)), [], world=(0.1, 0.2, 0.3), samples=3)
    np.testing.assert_allclose(
        got["Combined"], np.broadcast_to([0.1, 0.2, 0.3, 1], (64, 96, 4)), 1e-6
    )
    assert (got["Depth"] == np.float32(FAR)).all()
    assert not render(camera((0, -4, 0)), [], world=(1, 1, 1), transparent=True)["Combined"].any()


def test_volumes_without_surface_are_passed_by(sphere):
    empty = leapray.build(leapray.Volume(np.zeros((4, 4, 4), np.float32)))
    flat = np.diag([1.0, 1, 1e-7, 1])
    got = render(camera((0, 0, 9)), [one(empty), one(sphere, flat, object_index=2), one(empty)])
    assert (got["Object Index"] == 2).mean() > 0.01
    assert np.abs(got["Position"][..., 2]).max() < 1e-6


# ---- tiles, threads, borders -------------------------------------------------------------------


@pytest.fixture(scope="module")
def crowd(floor):
    lights = [
        leapray.Light("sun", (1, 1, 1), direction=unit(1, -1, 1)),
        leapray.Light("point", (3, 1, 1), position=(-1, -2, 1)),
    ]
    instances = [*scatter(60, 5, leapray.build(ball(6.0))), one(floor, at(z=-1.1))]
    cam = camera((0.5, -4, 1.5), size=(100, 70))
    return leapray.Scene(cam, instances, lights, WHITE, [0], leapray.World((0.2, 0.3, 0.4)))


@pytest.fixture(scope="module")
def whole(crowd):
    return crowd.render_tile(0, 0, 100, 70, samples=3, seed=9)


@pytest.mark.parametrize("threads", [1, 2, 7])
@pytest.mark.parametrize("side", [16, 64, 100])
def test_tiles_and_threads_leave_every_bit_as_it_is(side, threads, crowd, whole):
    got = {name: np.empty_like(array) for name, array in whole.items()}

    def tile(corner):
        x, y = corner
        part = (slice(y, min(y + side, 70)), slice(x, min(x + side, 100)))
        width, height = part[1].stop - x, part[0].stop - y
        for name, array in crowd.render_tile(x, y, width, height, samples=3, seed=9).items():
            got[name][part] = array

    corners = [(x, y) for y in range(0, 70, side) for x in range(0, 100, side)]
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(tile, corners[::-1]))
    for name, array in whole.items():
        np.testing.assert_array_equal(got[name], array)


def test_buffers_workspace_and_counters_may_be_the_callers(crowd, whole):
    buffers = {"Depth": np.zeros((70, 100, 1), np.float32)}
    counters = _abi.lr_counters()
    workspace = np.empty(crowd.workspace(100, 70).nbytes + 1, np.uint8)[1:]  # not aligned
    got = crowd.render_tile(0, 0, 100, 70, samples=3, seed=9, passes=buffers, workspace=workspace,
                            counters=counters)  # fmt: skip
    assert set(got) == {"Combined", "Depth"}
    assert got["Depth"] is buffers["Depth"]
    np.testing.assert_array_equal(got["Depth"], whole["Depth"])
    np.testing.assert_array_equal(got["Combined"], whole["Combined"])
    assert 3 * 7000 < counters.rays <= 3 * 4 * 7000  # camera, two lights, world
    assert 0 < counters.hits < counters.rays
    assert counters.cells > counters.tests > 0


def test_a_buffer_that_may_not_be_written_is_refused(crowd):
    buffer = np.zeros((8, 8, 1), np.float32)
    buffer.flags.writeable = False
    with pytest.raises(leapray.LeapRayError, match=r"Depth must be .* writeable"):
        crowd.render_tile(0, 0, 8, 8, passes={"Depth": buffer})
    assert not buffer.any()


def test_the_seed_moves_samples_but_not_their_mean(crowd, whole):
    other = crowd.render_tile(0, 0, 100, 70, samples=3, seed=10)["Combined"]
    assert (other != whole["Combined"]).any(-1).mean() > 0.3
    assert abs(other.mean() - whole["Combined"].mean()) < 0.01


@pytest.mark.alone
def test_a_told_watch_ends_a_tile_within_100_milliseconds(crowd):
    watch = leapray.Watch()
    ended = []

    def work():
        with pytest.raises(leapray.Stopped):
            crowd.render_tile(0, 0, 100, 70, samples=100_000, watch=watch)
        ended.append(time.perf_counter())

    worker = threading.Thread(target=work)
    worker.start()
    time.sleep(0.3)
    told = time.perf_counter()
    watch.stop()
    worker.join()
    assert ended and ended[0] - told < 0.1 + 0.2  # and the machine may be busy
    assert 0 < watch.progress < 1


def bad_scene(sphere, **change):
    cam, sun = camera((0, -4, 0)), leapray.Light("sun", (1, 1, 1))
    parts = dict(camera=cam, instances=[one(sphere)], lights=[sun], materials=WHITE, slots=[0])
    return lambda: leapray.Scene(**(parts | change))


def test_what_is_wrong_with_a_scene_is_said_in_a_sentence(sphere):
    cam, nan = camera((0, -4, 0)), float("nan")
    flat, bent = np.diag([1.0, 1, 0, 1]), np.eye(4)
    bent[3, 0] = 0.1
    light = leapray.Light("point", (1, 1, 1))
    cases = {
        "instance 0 .* invertible": dict(instances=[one(sphere, flat)]),
        "instance 1 .* finite": dict(instances=[one(sphere), one(sphere, at(nan))]),
        "instance 0 .* affine": dict(instances=[one(sphere, bent)]),
        "matrix of instance 0 .*shape": dict(instances=[one(sphere, np.eye(3))]),
        "instance 0 .* 1 material slots, it has 2": dict(instances=[one(sphere, n_materials=2)]),
        "it has 0": dict(instances=[one(sphere, n_materials=0)]),
        "slot 1 holds material 1": dict(slots=[0, 1]),
        "material 0 .*-1": dict(materials=[leapray.Material.diffuse((0, -1, 0))]),
        "light 0 .* length 1, it has 2": dict(
            lights=[leapray.Light("sun", (1, 1, 1), direction=(0, 0, 2))]
        ),
        "light 1 .* position": dict(lights=[light, replace(light, position=(nan, 0, 0))]),
        "light 0 .* color": dict(lights=[replace(light, color=(np.inf, 0, 0))]),
        "kind of light 0 .*sun": dict(lights=[replace(light, kind="moon")]),
        "projection": dict(camera=replace(cam, projection="fisheye")),
        "camera.* finite": dict(camera=replace(cam, eye=(nan, 0, 0))),
        "axis is zero": dict(camera=replace(cam, forward=(0, 0, 0))),
        "clips from 2 to 1": dict(camera=replace(cam, clip_start=2, clip_end=1)),
        "world .* color": dict(world=leapray.World((nan, 0, 0))),
        "world .* limit .* -1": dict(world=leapray.World(max_bounces=-1)),
        "light 0 .* limit .* -1": dict(lights=[replace(light, max_bounces=-1)]),
        "slot_objects .*shape": dict(slot_objects=[1, 2]),
    }
    for sentence, change in cases.items():
        with pytest.raises(leapray.LeapRayError, match=sentence):
            bad_scene(sphere, **change)()


def test_what_is_wrong_with_a_tile_is_said_in_a_sentence(crowd):
    cases = {
        "sides must be 1 to 65536 pixels, they are 0 and 4": dict(width=0),
        "within 16777216 pixels .* -20000000": dict(y=-20_000_000),
        "samples per pixel .* they are 0": dict(samples=0),
        "needs a workspace of [0-9]+ bytes, it has 100": dict(workspace=np.empty(100, np.uint8)),
        "passes are Combined, .* not Fog": dict(passes=["Fog"]),
        "passes are Combined, .* not 1": dict(passes=[1]),
        r"Depth must be float32 \(4, 4, 1\)": dict(passes={"Depth": np.empty((4, 4, 1))}),
        "unknown hit test 'luck'": dict(options={"hit_test": "luck"}),
        "lit by their lights": dict(options={"phong": leapray.Phong()}),
    }
    for sentence, change in cases.items():
        tile = dict(x=0, y=0, width=4, height=4) | change
        with pytest.raises(leapray.LeapRayError, match=sentence):
            crowd.render_tile(**tile)
