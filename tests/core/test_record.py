# SPDX-License-Identifier: GPL-3.0-or-later
"""What is recorded of a pixel's paths, against optics and against the pixel itself."""

from __future__ import annotations

import numpy as np
import pytest
from stage import WHITE, at, ball, camera, centre_rays, meet_sphere, one, slab, unit

import leapray
from leapray import Light, Lobe, Material, World, _abi

SIZE = (96, 64)
NONE = 2**32 - 1
PARTS = 4  # in which the core sums samples up
GRAZING = 0.011 * 1.3 / 25.6  # the ball's error along its normal, as test_render_core has it


def recorded(scene, x, y, capacity=1 << 16, samples=1, **more):
    record = leapray.Record(capacity)
    got = scene.render_tile(x, y, 1, 1, samples=samples, record=record, **more)
    return record, got["Combined"][0, 0]


def of(record, kind):
    return record.events[record.events["kind"] == kind]


def summed(record):
    """The pixel that the contributions make, added as the core adds them."""
    part = np.zeros((PARTS, 3))
    for event in record.events:
        if event["kind"] in (_abi.LR_EVENT_LIGHT, _abi.LR_EVENT_FOUND):
            part[event["sample"] % PARTS] += event["contribution"]
    total = np.zeros(3)
    for row in part:
        total += row
    return (total / record.samples).astype(np.float32)


@pytest.fixture(scope="module")
def busy():
    """Glass, a mirror and a floor under lights of every kind and a world."""
    glass = Material([Lobe("glass", (1, 1, 1))], absorption=(0.3, 0.1, 0.0))
    floor = Material([Lobe("diffuse", (0.6, 0.5, 0.4)), Lobe("emission", (0.02, 0.0, 0.0))])
    mirror = Material([Lobe("glossy", (0.9, 0.9, 0.9), roughness=0.2)])
    sphere = leapray.build(ball())
    things = [
        one(sphere, at(-0.9, 0, 0)),
        one(sphere, at(1.1, 0.4, -0.1, 0.9), first_material=1),
        one(leapray.build(slab(-1.0)), first_material=2),
    ]
    lights = [
        Light("sun", (1, 1, 1), direction=unit(0.3, -0.5, 0.8), angle=0.1),
        Light("point", (5, 4, 3), position=(0, -2, 3), radius=0.3),
        Light("area", (3, 3, 3), position=(-2, -2, 2), direction=unit(2, 2, -2),
              axis_u=(0.7, -0.7, 0), axis_v=unit(1, 1, 2), shape="rectangle", angle=np.pi,
              visible_camera=True),
    ]  # fmt: skip
    sky = World((0.2, 0.3, 0.4), np.linspace(0, 2, 8 * 16 * 3).reshape(8, 16, 3))
    view = camera((0.2, -5, 1.5), width=0.9)
    return leapray.Scene(view, things, lights, [glass, mirror, floor], (0, 1, 2), sky)


PIXELS = [(x, y) for x in (10, 33, 48, 60, 66) for y in (8, 24, 31, 40)]
MORE = {
    "samples": 6,
    "diffuse_bounces": 2,
    "clamp_indirect": 2.0,
    "pixel_filter": "blackman_harris",
}


def test_the_contributions_are_the_pixel_to_the_bit(busy):
    picture = busy.render_tile(0, 0, *SIZE, **MORE)["Combined"]
    brought = set()
    for x, y in PIXELS:
        record, pixel = recorded(busy, x, y, **MORE)
        assert (pixel == picture[y, x]).all()
        assert (summed(record) == pixel[:3]).all()
        assert record.samples == 6 and record.lost == 0
        given = np.abs(record.events["contribution"]).sum(axis=1) > 0
        for kind in (_abi.LR_EVENT_LIGHT, _abi.LR_EVENT_FOUND):
            brought |= {(kind, int(n)) for n in of_kind(record, kind, given)["light"]}
    lights = {light for _, light in brought}
    assert lights == {0, 1, 2, 3, 2**64 - 1}  # all lights, the world, the floor itself
    assert {(_abi.LR_EVENT_LIGHT, 3), (_abi.LR_EVENT_FOUND, 3)} <= brought


def of_kind(record, kind, among):
    return record.events[(record.events["kind"] == kind) & among]


def test_pixels_that_settle_early_are_recorded_to_their_last_sample(busy):
    more = MORE | {"samples": 64, "noise_threshold": 0.05, "min_samples": 4}
    counts = []
    for x, y in PIXELS:
        record, pixel = recorded(busy, x, y, **more)
        assert (summed(record) == pixel[:3]).all()
        counts.append(record.samples)
    assert min(counts) < 64 and len(set(counts)) > 1


def test_a_ray_that_only_asks_for_the_world_is_recorded_like_others():
    sphere = leapray.build(ball())
    scene = leapray.Scene(
        camera((0, -4, 0)), [one(sphere), one(sphere, at(0, 0, -2))], (), WHITE, (0,),
        World((1, 1, 1)),
    )  # fmt: skip
    picture = scene.render_tile(0, 0, *SIZE, samples=16, diffuse_bounces=0)["Combined"]
    record, pixel = recorded(scene, 48, 12, samples=16, diffuse_bounces=0)
    assert (pixel == picture[12, 48]).all() and (summed(record) == pixel[:3]).all()
    last = of(record, _abi.LR_EVENT_RAY)
    last = last[last["last"] != 0]
    hits = {(e["sample"], e["ray"]): e["instance"] for e in of(record, _abi.LR_EVENT_HIT)}
    ends = [hits[e["sample"], e["ray"]] for e in last]
    assert 0 < sum(end != NONE for end in ends) < len(ends)  # some meet the other ball


def single(material):
    scene = leapray.Scene(
        camera((0.3, -4, 0.2)), [one(leapray.build(ball()))], (), [material], (0,),
        World((1, 1, 1)),
    )  # fmt: skip
    o, d = centre_rays(camera((0.3, -4, 0.2)), SIZE)
    return scene, o, d


@pytest.mark.parametrize(("x", "y"), [(40, 30), (52, 38), (60, 20)])
def test_a_mirror_reflects_the_recorded_ray_by_the_law_of_reflection(x, y):
    scene, o, d = single(Material([Lobe("glossy", (1, 1, 1), roughness=0.0)]))
    record, _ = recorded(scene, x, y)
    first, second = of(record, _abi.LR_EVENT_RAY)
    hit, miss = of(record, _abi.LR_EVENT_HIT)
    o, d = o[y, x], d[y, x]
    np.testing.assert_array_equal(first["origin"], o)
    np.testing.assert_allclose(first["direction"], d, rtol=1e-12)
    t = meet_sphere(o, d)
    n = o + t * d
    assert abs(hit["t"] - t) * abs(d @ n) < GRAZING
    np.testing.assert_allclose(hit["position"], o + hit["t"] * d, atol=1e-12)
    np.testing.assert_allclose(hit["normal"], n, atol=0.01)
    normal = hit["normal"]
    want = unit(*(d - 2 * (d @ normal) * normal))
    np.testing.assert_allclose(second["direction"], want, atol=1e-6)
    assert second["parent"] == first["ray"] == hit["ray"] and miss["ray"] == second["ray"]
    assert (first["ray_kind"], second["ray_kind"]) == (_abi.LR_RAY_CAMERA, _abi.LR_RAY_GLOSSY)
    assert hit["instance"] == 0 and miss["instance"] == NONE and np.isinf(miss["t"])
    assert second["instance"] == 0 and (second["cell"] == hit["cell"]).all()
    inverse = np.linalg.inv(ball().info.object_from_index)
    place = inverse[:3, :3] @ hit["position"] + inverse[:3, 3]
    assert (np.abs(hit["cell"] + 0.5 - place) <= 0.5 + 1e-9).all()
    (world,) = of(record, _abi.LR_EVENT_FOUND)
    assert world["light"] == 0 and world["weight"] == 1  # there are no lights: 0 is the world


def test_glass_bends_the_recorded_ray_and_keeps_what_it_is_in():
    scene, *_ = single(Material([Lobe("glass", (1, 1, 1), ior=1.5)], absorption=(1, 0, 0)))
    record, _ = recorded(scene, 52, 38, branches=16)
    rays = {int(e["ray"]): e for e in of(record, _abi.LR_EVENT_RAY)}
    hits = {int(e["ray"]): e for e in of(record, _abi.LR_EVENT_HIT)}
    first = next(e for e in rays.values() if e["parent"] == e["ray"])
    inner = next(e for e in rays.values()
                 if e["parent"] == first["ray"] and e["ray_kind"] == _abi.LR_RAY_TRANSMISSION
                 and e["n_media"])  # fmt: skip
    n, direction = hits[int(first["ray"])]["normal"], unit(*first["direction"])
    cos = -(direction @ n)
    want = direction / 1.5 + (cos / 1.5 - np.sqrt(1 - (1 - cos * cos) / 1.5**2)) * n
    np.testing.assert_allclose(inner["direction"], want, atol=1e-6)
    assert first["n_media"] == 0 and inner["n_media"] == 1 and inner["media"][0] == 0
    end = hits[int(inner["ray"])]
    assert end["side"] == 1
    chord = np.exp(-end["t"] * np.array([1, 0, 0]))
    np.testing.assert_allclose(end["throughput"], inner["throughput"] * chord, rtol=1e-12)


def test_what_stops_a_light_is_named_and_what_is_turned_away_gets_no_ray():
    sphere = leapray.build(ball())
    floor = one(leapray.build(slab(-1.0)))
    above = Light("sun", (1, 1, 1), direction=(0, 0, 1))
    below = Light("sun", (1, 1, 1), direction=(0, 0, -1))
    view = camera((0, -0.4, 4), at=(0, 0, -1), width=2.0)
    scene = leapray.Scene(view, [floor, one(sphere)], [above, below], WHITE, (0,))
    record, _ = recorded(scene, 48, 4)  # beside the ball
    lit, dark = of(record, _abi.LR_EVENT_LIGHT)
    assert lit["instance"] == NONE and lit["pdf"] == 1 and lit["contribution"].sum() > 0
    assert dark["pdf"] == 0 and not dark["contribution"].any()
    hidden = leapray.Scene(view, [floor, one(sphere, visible_camera=False)], [above], WHITE, (0,))
    record, pixel = recorded(hidden, 48, 32)
    (light,) = of(record, _abi.LR_EVENT_LIGHT)
    assert light["instance"] == 1 and not light["contribution"].any() and not pixel[:3].any()
    assert light["pdf"] == 1 and light["probability"] == 1 and light["weight"] == pytest.approx(1)


def test_events_beyond_the_room_are_counted_and_change_nothing(busy):
    whole, pixel = recorded(busy, 48, 31, **MORE)
    for capacity in (0, 1, 7):
        record, same = recorded(busy, 48, 31, capacity, **MORE)
        assert len(record.events) == capacity
        assert record.lost == len(whole.events) - capacity
        kinds = ("kind", "ray", "origin", "t")
        for name in kinds:
            np.testing.assert_array_equal(record.events[name], whole.events[name][:capacity])
        assert (same == pixel).all() and record.samples == 6


def test_the_cells_of_a_ray_are_those_that_a_trace_counts(busy):
    record, _ = recorded(busy, 33, 31, samples=1)
    first = of(record, _abi.LR_EVENT_RAY)[0]
    hit = next(e for e in of(record, _abi.LR_EVENT_HIT) if e["ray"] == first["ray"])
    assert hit["instance"] == 0
    volume = leapray.build(ball())
    h = leapray.trace(volume, first["origin"] - (-0.9, 0, 0), first["direction"], t_max=hit["t"])
    assert h.steps[0] == h.counters["cells"] > 0
    assert hit["steps"] >= h.steps[0]


def test_only_a_tile_of_one_pixel_can_be_recorded(busy):
    with pytest.raises(leapray.LeapRayError, match="record must be one pixel, it is 2 x 1"):
        busy.render_tile(0, 0, 2, 1, record=leapray.Record())
    with pytest.raises(leapray.LeapRayError, match="capacity"):
        leapray.Record(-1)
