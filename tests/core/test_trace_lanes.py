# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays that go side by side find what each finds by itself, to the last bit."""

from __future__ import annotations

import numpy as np
import pytest

import leapray
from tests import meshes

PLACE = np.array([[0.3, 0.05, 0, -4], [0, 0.2, -0.1, 1], [0, 0, 0.25, 2], [0, 0, 0, 1]])
FIELDS = ("t", "cell", "normal", "field_normal", "id")


def noise(rng):
    coarse = rng.random((9, 10, 11))
    fine = np.kron(coarse, np.ones((4, 4, 4))) + 0.2 * rng.random((36, 40, 44))
    return leapray.Volume((65535 * np.clip(fine / 1.2, 0, 1)).astype(np.uint16))


def bytes_(rng):
    return leapray.Volume(rng.integers(0, 256, (20, 21, 23)).astype(np.uint8))


def one_brick(rng):
    return leapray.Volume(rng.integers(0, 256, (4, 4, 4)).astype(np.uint8))


def floats(rng):
    coarse = np.kron(rng.random((6, 6, 6)), np.ones((4, 4, 4)))
    return leapray.Volume((coarse + 0.2 * rng.random(coarse.shape)).astype(np.float32))


def without_bounds(rng):
    """Floats of either sign and many magnitudes, as measured fields have them."""
    samples = rng.normal(size=(20, 20, 20)) * 10.0 ** rng.integers(-3, 30, (20, 20, 20))
    return leapray.Volume(samples.astype(np.float32), threshold=0.01)


def far_apart(rng):
    """Small things with empty bricks between them, placed askew."""
    samples = np.zeros((70, 90, 120), np.uint16)
    for _ in range(12):
        at = rng.integers(1, (60, 80, 110))
        samples[tuple(slice(a, a + 5) for a in at)] = rng.integers(0, 65536, (5, 5, 5))
    ids = rng.integers(0, 5, samples.shape).astype(np.uint16)
    return leapray.Volume(samples, ids=ids, object_from_index=PLACE)


def sheet(rng):
    return leapray.voxelize(*meshes.plane(), 0.1, kind="sheet")


def box(rng):
    return leapray.voxelize(*meshes.box(), 0.06, exact="all")


def rays_at(rng, volume, n):
    info, m = volume.info, volume.info.object_from_index
    low, high = np.array(info.surface_lo), np.array(info.surface_hi) + 1.0
    target = rng.uniform(low, high, (n, 3))
    origin = rng.uniform(low - (high - low) - 3, high + (high - low) + 3, (n, 3))
    direction = target - origin
    direction[::7, rng.integers(0, 3)] = 0  # along planes
    origin[::5] = np.round(origin[::5])  # through edges
    return origin @ m[:3, :3].T + m[:3, 3], direction @ m[:3, :3].T


def both_of(volume, how):
    """Rays side by side, by these instructions, and alone."""
    return [leapray.build(volume, f"cd:rays={each}") for each in (how, "one")]


def assert_same(both, *rays, **options):
    """They find the same to the last bit, by as many steps; returns what the first finds."""
    lanes, one = (leapray.trace(s, *rays, **options) for s in both)
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(lanes, name), getattr(one, name))
    differ = "samples", "in_lanes"
    counted = [{k: v for k, v in h.counters.items() if k not in differ} for h in (lanes, one)]
    assert lanes.counters["in_lanes"] in (0, len(lanes.t))  # 0 where most cells keep triangles
    assert one.counters["in_lanes"] == 0
    assert counted[0] == counted[1]
    return lanes


@pytest.mark.parametrize("how", ["lanes", "avx2", "portable"])
@pytest.mark.parametrize("hit_test", ["extrema", "faces"])
@pytest.mark.parametrize(
    "make", [noise, far_apart, sheet, box, bytes_, one_brick, floats, without_bounds]
)
def test_rays_side_by_side_find_what_each_finds_alone(make, hit_test, how):
    rng = np.random.default_rng(5)
    volume = make(rng)
    both = both_of(volume, how)
    origins, directions = rays_at(rng, volume, 20_000)
    t_max = np.where(rng.random(len(origins)) < 0.3, rng.uniform(0, 2, len(origins)), np.inf)
    hits = assert_same(both, origins, directions, t_max=t_max, hit_test=hit_test)
    hit = np.isfinite(hits.t)
    assert 0.02 < hit.mean() < 0.99
    on = origins[hit] + hits.t[hit, None] * directions[hit]
    onward = rng.normal(size=on.shape)
    side = np.where((onward * hits.field_normal[hit]).sum(1) > 0, -1, 1)
    start = (hits.cell[hit], side)
    again = assert_same(both, on, onward, start=start, hit_test=hit_test)  # shadows, reflections
    assert np.isfinite(again.t).mean() > 0.02 or make is sheet
    for scale in (1e-300, 1e-40, 1e40, 1e300):
        assert_same(both, origins[:500], directions[:500] * scale, hit_test=hit_test)


@pytest.mark.parametrize("how", ["lanes", "avx2", "portable"])
@pytest.mark.parametrize("make", [noise, far_apart, one_brick])
def test_first_object_cells_are_found_side_by_side(make, how):
    rng = np.random.default_rng(6)
    volume = make(rng)
    origins, directions = rays_at(rng, volume, 20_000)
    t_max = np.where(rng.random(len(origins)) < 0.3, rng.uniform(0, 2, len(origins)), np.inf)
    hits = assert_same(both_of(volume, how), origins, directions, t_max=t_max, mode="binary")
    assert np.isfinite(hits.t).mean() > 0.05


@pytest.mark.parametrize("how", ["lanes", "portable"])
@pytest.mark.parametrize("normal", ["analytic", "central", "smooth", "sobel"])
@pytest.mark.parametrize("root", ["newton", "bisect", "cubic"])
def test_normals_and_roots_are_those_of_rays_alone(root, normal, how):
    rng = np.random.default_rng(7)
    volume = far_apart(rng)
    origins, directions = rays_at(rng, volume, 4_000)
    assert_same(both_of(volume, how), origins, directions, root=root, normal=normal)


@pytest.mark.parametrize("how", ["lanes", "portable"])
def test_ties_of_crossings_are_no_doubtful_hits(how):
    """Rays along rows, diagonals and planes of the lattice, where floats cannot tell which crossing
    is first, and rays that start so far away that their own doubles hardly can."""
    rng = np.random.default_rng(8)
    volume = noise(rng)
    both = both_of(volume, how)
    n = 3_000
    origins = rng.integers(-3, 48, (n, 3)) / 2.0
    directions = rng.integers(-2, 3, (n, 3)).astype(float)
    directions[(directions == 0).all(1)] = 1.0
    assert_same(both, origins, directions)
    assert_same(both, origins, directions, mode="binary")
    for distance in (1e4, 1e8, 1e12, 1e16):
        towards = rng.normal(size=(n, 3))
        towards /= np.linalg.norm(towards, axis=1)[:, None]
        assert_same(both, rng.uniform(0, 36, (n, 3)) - distance * towards, towards)


@pytest.mark.parametrize("how", ["lanes", "portable"])
def test_starts_in_any_cell_give_what_rays_alone_give(how):
    """A caller's cell may lie anywhere; nothing is read beyond the volume."""
    rng = np.random.default_rng(9)
    volume = noise(rng)
    n = 3_000
    origins = rng.uniform(-5, 45, (n, 3))
    directions = rng.normal(size=(n, 3))
    cells = rng.integers(-2, 46, (n, 3))
    cells[::50] = rng.integers(-(2**31), 2**31 - 1, (len(cells[::50]), 3))
    start = (cells.astype(np.int32), rng.choice([-1, 1], n))
    assert_same(both_of(volume, how), origins, directions, start=start)
