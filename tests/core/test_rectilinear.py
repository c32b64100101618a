# SPDX-License-Identifier: GPL-3.0-or-later
"""Rectilinear volumes: planes of samples at unequal distances, up to 1 : 1000."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import leapray
from addon.study import oracle

RECTILINEAR = [entry.spec for entry in leapray.variants() if entry.rectilinear]
OTHERS = [entry.spec for entry in leapray.traversers() if not entry.rectilinear]


def rational_planes(rng, n, ratio):
    """n planes at multiples of 2^-16, whose distances differ by up to that ratio."""
    steps = np.exp(rng.random(max(n - 1, 1)) * np.log(ratio))
    steps[rng.integers(len(steps))] = ratio
    steps[rng.integers(len(steps))] = 1.0
    places = np.concatenate([[0.0], np.cumsum(steps[: n - 1])])
    return np.round((places - places[-1] * rng.random()) * 2.0**16 * 8 / ratio) / 2.0**16


def with_borders(places):
    """The planes with those of the virtual layers around them."""
    first = places[1] - places[0] if len(places) > 1 else 1.0
    last = places[-1] - places[-2] if len(places) > 1 else 1.0
    return np.concatenate([[places[0] - first], places, [places[-1] + last]])


def generic_rays(rng, n, planes):
    """Rays from anywhere around towards points near the planes, as the oracle takes them."""
    low = np.array([axis[0] for axis in planes])
    span = np.array([axis[-1] for axis in planes]) - low
    pick = np.stack([rng.choice(axis, n) for axis in planes], axis=1)
    targets = pick + span * rng.normal(size=(n, 3)) * 0.02
    origins = low + span * rng.uniform(-1, 2, (n, 3))
    origins = np.round(origins * 2.0**16) / 2.0**16
    directions = np.round((targets - origins) * 2.0**16)
    directions[(directions == 0).all(axis=1)] = (1, 2, 3)
    return origins, directions


def lattice_rays(rng, n, planes):
    """Rays through planes' crossings, along axes and diagonals, with zeros of both signs."""
    origins = np.stack([rng.choice(axis, n) for axis in planes], axis=1)
    aside = rng.random((n, 3)) < 0.3
    origins[aside] += 2.0**-16 * rng.integers(-9, 9, aside.sum())
    directions = rng.integers(-2, 3, (n, 3)).astype(float)
    through = np.stack([rng.choice(axis, n) for axis in planes], axis=1) - origins
    several = rng.random(n) < 0.5
    directions[several] = through[several] * 2.0**16
    directions[(directions == 0).all(axis=1)] = (0, 0, -1)
    directions[(directions == 0) & (rng.random((n, 3)) < 0.5)] = -0.0
    back = np.where(rng.random((n, 1)) < 0.5, 4.0, 0.0)
    small = np.abs(directions).max(axis=1, keepdims=True) < 2**20
    return origins - np.where(small, back * directions, 0.0), directions


@pytest.mark.parametrize("name", RECTILINEAR)
def test_first_cells_are_sound_on_rectilinear_planes(name):
    rng = np.random.default_rng(31)
    pierced = []
    for index in range(24):
        size = rng.integers(1, 30, 3)  # z, y, x
        samples = (rng.random(size) < rng.choice([0.003, 0.02, 0.2])).astype(np.float32)
        samples.flat[rng.integers(samples.size)] = 1
        ratio = (1.0, 3.0, 50.0, 1000.0)[index % 4]
        planes = [rational_planes(rng, n, ratio) for n in size[::-1]]
        whole = [with_borders(axis) for axis in planes]
        structure = leapray.build(leapray.Volume(samples, planes=planes), name)
        objects = oracle.object_cells(samples, 0.5)
        for make in (generic_rays, lattice_rays):
            origins, directions = make(rng, 1000, whole)
            hits = leapray.trace(structure, origins, directions, mode="binary")
            verdict, exact = oracle.judge(
                objects, origins, directions, np.isfinite(hits.t), hits.cell, whole
            )
            found = {oracle.VERDICTS[v] for v in verdict if v}
            assert not found, (index, size, ratio, make.__name__)
            assert hits.counters["most_cells"] <= sum(size) + 1
            pierced.append(exact.mean())
    assert np.mean(pierced) > 0.2


@pytest.mark.parametrize("name", RECTILINEAR)
def test_uniform_planes_give_what_a_matrix_gives(name):
    rng = np.random.default_rng(32)
    spacing, first = np.array([2.0, 0.5, 0.25]), np.array([-3.0, 1.0, 8.0])
    samples = rng.random((14, 19, 17)).astype(np.float32)
    matrix = np.diag([*spacing, 1.0])
    matrix[:3, 3] = first
    planes = [first[a] + spacing[a] * np.arange(n) for a, n in enumerate((17, 19, 14))]
    one = leapray.build(leapray.Volume(samples, object_from_index=matrix), name)
    other = leapray.build(leapray.Volume(samples, planes=planes), name)
    targets = first + spacing * rng.random((4000, 3)) * (17, 19, 14)
    origins = targets + rng.normal(size=(4000, 3)) * 60
    for normal in leapray.NORMALS:
        a = leapray.trace(one, origins, targets - origins, normal=normal)
        b = leapray.trace(other, origins, targets - origins, normal=normal)
        assert_array_equal(np.isfinite(a.t), np.isfinite(b.t))
        same = np.isfinite(a.t) & (a.cell == b.cell).all(axis=1)
        assert same.mean() > 0.9
        assert_allclose(a.t[same], b.t[same], rtol=1e-9)
        if normal != "smooth":  # which makes its slopes unit before it blends them: in voxels there
            assert_allclose(a.normal[same], b.normal[same], atol=1e-6)
        assert_allclose(a.field_normal[same], b.field_normal[same], atol=1e-6)


def ball(planes, centre, radius, width):
    """A ramp of a ball's signed distance on these planes."""
    x, y, z = planes
    far = np.sqrt(
        (x - centre[0]) ** 2
        + ((y - centre[1]) ** 2)[:, None]
        + ((z - centre[2]) ** 2)[:, None, None]
    )
    return np.clip(0.5 + (radius - far) / (2 * width), 0, 1).astype(np.float32)


@pytest.mark.parametrize("name", RECTILINEAR)
def test_a_ball_on_rectilinear_planes_is_hit_where_it_is(name):
    rng = np.random.default_rng(33)
    planes = [np.cumsum(rng.uniform(0.3, 1.7, n)) for n in (60, 70, 64)]
    centre = np.array([(axis[0] + axis[-1]) / 2 for axis in planes])
    volume = leapray.Volume(ball(planes, centre, 18.0, 6.0), planes=planes)
    structure = leapray.build(volume, name)
    directions = rng.normal(size=(3000, 3))
    origins = centre - directions / np.linalg.norm(directions, axis=1)[:, None] * 60
    origins += rng.normal(size=origins.shape) * 5
    aim = centre - origins
    hits = leapray.trace(structure, origins, aim)
    assert np.isfinite(hits.t).all()
    points = origins + hits.t[:, None] * aim
    outward = (points - centre) / np.linalg.norm(points - centre, axis=1)[:, None]
    # h^2 / 4 R with cells of 1.7: 0.04 at most
    assert np.abs(np.linalg.norm(points - centre, axis=1) - 18.0).max() < 0.05
    angle = np.degrees(np.arccos(np.clip((hits.normal * outward).sum(axis=1), -1, 1)))
    assert np.mean(angle) < 1.0 and angle.max() < 3.0
    value, gradient = volume.sample(points)
    assert_allclose(value, 0.5, atol=1e-6)
    steepest = -gradient / np.linalg.norm(gradient, axis=1)[:, None]
    assert np.mean((steepest * hits.field_normal).sum(axis=1)) > 0.9999


@pytest.mark.parametrize("name", RECTILINEAR)
def test_a_slope_over_cells_of_1_to_1000_has_its_place_and_its_normal(name):
    rng = np.random.default_rng(34)
    steps = np.where(np.arange(19) % 2 == 0, 1000.0, 1.0)
    planes = [np.concatenate([[0.0], np.cumsum(np.roll(steps, a))]) for a in range(3)]
    top = np.array([axis[-1] for axis in planes])
    slope = np.array([3.0, -5.0, 8.0]) * 2.0**-18  # with these planes f32 holds all samples
    x, y, z = planes
    samples = slope[0] * x + (slope[1] * y)[:, None] + (slope[2] * z)[:, None, None]
    samples -= slope[1] * top[1]
    volume = leapray.Volume(samples, 0.27, planes=planes)
    structure = leapray.build(volume, name)
    origins = rng.random((2000, 3)) * top
    value, gradient = volume.sample(origins)
    assert_allclose(value, origins @ slope - slope[1] * top[1], rtol=1e-12)
    assert_allclose(gradient, np.broadcast_to(slope, gradient.shape), rtol=1e-9)
    outside = value < 0.27
    directions = rng.normal(size=(2000, 3)) + 3 * slope / np.linalg.norm(slope)
    for normal in leapray.NORMALS:
        hits = leapray.trace(structure, origins[outside], directions[outside], normal=normal)
        found = np.isfinite(hits.t)
        points = origins[outside][found] + hits.t[found, None] * directions[outside][found]
        deep = (points > 2100).all(axis=1) & (points < top - 2100).all(axis=1)
        assert deep.sum() > 200
        assert_allclose(points[deep] @ slope - slope[1] * top[1], 0.27, rtol=1e-9)
        unit = -slope / np.linalg.norm(slope)
        assert_allclose(hits.normal[found][deep], np.tile(unit, (deep.sum(), 1)), atol=1e-9)


def test_what_cannot_take_rectilinear_planes_says_so():
    planes = (np.array([0.0, 1.0, 3.0]), np.array([0.0, 2.0, 3.0]), np.array([0.0, 1.0, 9.0]))
    volume = leapray.Volume(np.eye(3, dtype=np.float32)[None].repeat(3, 0), planes=planes)
    assert_array_equal(volume.info.planes[2], planes[2])
    for name in OTHERS:
        with pytest.raises(leapray.LeapRayError, match="this volume is rectilinear"):
            leapray.build(volume, name)
    structure = leapray.build(volume, RECTILINEAR[0])
    with pytest.raises(leapray.LeapRayError, match="have no one size"):
        leapray.trace(structure, [(0, 0, -9)], [(0, 0, 1)], hit_test="uniform", root="bisect")
    with pytest.raises(leapray.LeapRayError, match="this volume is rectilinear"):
        leapray.prepare(volume, leapray.image_methods()[0])
    eye, forward = (0, 0, -9), (0, 0, 1)
    camera = leapray.Camera("orthographic", eye, forward, (0, 0, 0), (1, 0, 0), (0, 1, 0), 0, 99)
    with pytest.raises(leapray.LeapRayError, match="instance 0 has a rectilinear volume"):
        leapray.Scene(camera, [leapray.Instance(structure, np.eye(4))])


@pytest.mark.parametrize(
    ("planes", "sentence"),
    [
        (([0, 1, 2], [0, 1, 2], [0, 2, 2]), "along z plane 1 lies at 2 and plane 2 at 2"),
        (([0, 1, 2], [2, 1, 0], [0, 1, 2]), "along y plane 0 lies at 2 and plane 1 at 1"),
        (([0, np.nan, 2], [0, 1, 2], [0, 1, 2]), "plane 1 along x is nan"),
        (([0, 1], [0, 1, 2], [0, 1, 2]), "planes must be 3, 3, 3 numbers along x, y, z"),
        (([0, 1, 1e17], [0, 1, 2], [0, 1, 2]), None),
        (([1e17, 1e17 + 16, 3e17], [0, 1, 2], [0, 1, 2]), None),
    ],
)
def test_wrong_planes_are_answered_by_a_sentence(planes, sentence):
    samples = np.ones((3, 3, 3), np.uint8)
    if sentence is None:
        leapray.Volume(samples, planes=planes)
        return
    with pytest.raises(leapray.LeapRayError, match=sentence):
        leapray.Volume(samples, planes=planes)
