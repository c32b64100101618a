# SPDX-License-Identifier: GPL-3.0-or-later
"""Traversers that are not exact: how they err, how often, and what they never do."""

from __future__ import annotations

import numpy as np
import pytest

import leapray
from addon.study import oracle

INEXACT = [t.spec for t in leapray.variants() if not t.exact]


def spheres(n, count, radius, seed=1):
    """count^3 spheres of one radius, one in each part of n^3 samples."""
    rng, side = np.random.default_rng(seed), n / count
    z, y, x = np.ogrid[:n, :n, :n]
    samples = np.zeros((n, n, n), np.uint8)
    for part in np.ndindex(count, count, count):
        cx, cy, cz = np.array(part) * side + rng.uniform(radius, side - radius, 3)
        samples[(x - cx) ** 2 + (y - cy) ** 2 + (z - cz) ** 2 < radius**2] = 255
    return samples


@pytest.fixture(scope="module")
def phantom():
    return leapray.Volume(spheres(64, 3, 8.0))


@pytest.fixture(scope="module")
def rays():
    return oracle.generic_rays(np.random.default_rng(2), 20_000, (64, 64, 64))


@pytest.fixture(scope="module")
def exact(phantom, rays):
    return leapray.trace(leapray.build(phantom), *rays, mode="binary")


def first_cells(phantom, rays, spec):
    return leapray.trace(leapray.build(phantom, spec), *rays, mode="binary")


def wrong_fraction(hits, exact):
    """Share of the rays that hit something whose first cell is another one, or none."""
    hit = np.isfinite(exact.t)
    return (hits.cell != exact.cell).any(axis=1)[hit].mean()


@pytest.mark.parametrize("spec", INEXACT)
def test_none_claims_a_cell_that_is_no_object_cell(spec):
    rng = np.random.default_rng(3)
    for size in ((1, 1, 1), (3, 20, 9), (24, 17, 30), (40, 2, 40)):
        samples = (rng.random(size) < 0.03).astype(np.float32)
        samples.flat[rng.integers(samples.size)] = 1
        structure = leapray.build(leapray.Volume(samples), spec)
        objects = oracle.object_cells(samples, 0.5)
        for make in (oracle.generic_rays, oracle.lattice_rays):
            origins, directions = make(rng, 2000, size[::-1])
            hits = leapray.trace(structure, origins, directions, mode="binary")
            hit = np.isfinite(hits.t)
            assert hit.any() and np.isfinite(hits.t[hit]).all()
            verdict, _ = oracle.judge(objects, origins, directions, hit, hits.cell)
            assert not (verdict == oracle.VERDICTS.index("no object")).any()
            if not spec.startswith("lines"):  # a line's cell may lie beside the ray
                assert not (verdict == oracle.VERDICTS.index("not touched")).any()


# the fraction of cells on a ray that samples at equal distances pass over
PASSED_OVER = {"1": 0.376, "0.5": 0.20, "0.25": 0.105, "0.1": 0.043}


@pytest.mark.parametrize("step", PASSED_OVER)
def test_uniform_samples_pass_over_first_cells_at_the_known_rate(step, phantom, rays, exact):
    hits = first_cells(phantom, rays, f"uniform:step={step}")
    assert wrong_fraction(hits, exact) == pytest.approx(PASSED_OVER[step], rel=0.3)
    both = np.isfinite(hits.t) & np.isfinite(exact.t)
    assert (hits.t[both] >= exact.t[both]).all()  # later, never earlier


@pytest.mark.parametrize("metric", ["chamfer345", "chessboard", "cityblock", "euclid"])
def test_the_published_steps_of_spheres_overshoot(metric, phantom, rays, exact):
    hits = first_cells(phantom, rays, f"radc:metric={metric},step=paper")
    assert 0.3 < wrong_fraction(hits, exact) < 0.65
    lost = np.isinf(hits.t)[np.isfinite(exact.t)].mean()
    assert 0.003 < lost < 0.1


def test_lines_err_by_their_ends_and_the_wide_one_slips_through(phantom, rays, exact):
    found = {
        kind: first_cells(phantom, rays, f"lines:connectivity={kind}")
        for kind in ("adaptive", "26", "6")
    }
    np.testing.assert_array_equal(found["adaptive"].cell, found["6"].cell)
    assert found["adaptive"].counters["cells"] < 0.7 * found["6"].counters["cells"]
    assert 0.2 < wrong_fraction(found["6"], exact) < wrong_fraction(found["26"], exact) < 0.7
    for hits in found.values():  # within the rounding of both ends, and half a cell
        hit = np.isfinite(hits.t)
        unit = rays[1][hit] / np.linalg.norm(rays[1][hit], axis=1)[:, None]
        out = hits.cell[hit] + 0.5 - rays[0][hit]
        off = np.linalg.norm(out - (out * unit).sum(axis=1)[:, None] * unit, axis=1)
        assert off.max() < 2 * np.sqrt(3)


def test_sums_in_f32_drift_and_sums_in_f64_hardly():
    samples = np.zeros((200, 200, 512), np.uint8)  # a wall at the end of a long ray
    samples[:, :, -2:] = 255
    samples[0, 0, 0] = samples[-1, -1, 0] = 255
    volume = leapray.Volume(samples)
    rng = np.random.default_rng(5)
    ends = rng.random((2, 20_000, 3)) * (0, 190, 190) + (0, 4, 4)
    origins, directions = ends[0] + (0.01, 0, 0), ends[1] - ends[0] + (511, 0, 0)
    want = leapray.trace(leapray.build(volume), origins, directions, mode="binary")
    assert np.isfinite(want.t).all()
    wrong, late = {}, {}
    for spec in ("aw_accumulate:precision=f32", "aw_accumulate", "frt:arithmetic=float"):
        hits = leapray.trace(leapray.build(volume, spec), origins, directions, mode="binary")
        wrong[spec] = wrong_fraction(hits, want)
        late[spec] = np.percentile(np.abs(hits.t - want.t), 99)
    for spec in ("aw_accumulate:precision=f32", "frt:arithmetic=float"):
        assert wrong[spec] > 1e-4  # of the last cells alone
        assert late[spec] > 1e-6
    assert wrong["aw_accumulate"] == 0
    assert 0 < late["aw_accumulate"] < 1e-13


@pytest.mark.parametrize("spec", INEXACT)
def test_what_they_find_of_a_sphere_lies_on_it(spec):
    n, radius, centre = 48, 16.3, np.array([23.4, 23.7, 23.1])
    z, y, x = np.ogrid[:n, :n, :n]
    distance = np.sqrt((x - centre[0]) ** 2 + (y - centre[1]) ** 2 + (z - centre[2]) ** 2)
    samples = np.clip(0.5 + (radius - distance) / 5, 0, 1).astype(np.float32)
    structure = leapray.build(leapray.Volume(samples), spec)
    directions = np.random.default_rng(6).normal(size=(10_000, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    hits = leapray.trace(structure, centre - 60 * directions, directions)
    hit = np.isfinite(hits.t)
    assert hit.mean() > 0.4  # from in front, and some only from behind
    points = centre + (hits.t[hit, None] - 60) * directions[hit]
    error = np.abs(np.linalg.norm(points - centre, axis=1) - radius)
    # a line is off by half a cell's diagonal at its ends and claims whole cells
    assert error.max() < (2 * np.sqrt(3) if spec.startswith("lines") else 0.02)
