# SPDX-License-Identifier: GPL-3.0-or-later
"""Exact traversers find the cell that exact arithmetic finds, whatever the ray."""

from __future__ import annotations

import numpy as np
import pytest

import leapray
from addon.study import oracle

EXACT = [t.spec for t in leapray.variants() if t.exact]
DEFAULTS = [t.spec for t in leapray.traversers() if t.exact]
ALL = [t.spec for t in leapray.variants()]


def sparse(rng, size):
    return (rng.random(size) < rng.choice([0.003, 0.02, 0.2])).astype(np.float32)


def spheres(rng, size):
    grid = np.stack(np.meshgrid(*map(np.arange, size), indexing="ij"), axis=-1)
    samples = np.zeros(size, np.float32)
    for _ in range(3):
        centre, radius = rng.random(3) * size, rng.uniform(1, 6)
        samples[((grid - centre) ** 2).sum(axis=-1) < radius**2] = 1
    return samples


def checkerboard(rng, size):
    return (np.indices(size).sum(axis=0) % int(rng.integers(2, 9)) == 0).astype(np.float32)


def one_sample(rng, size):
    samples = np.zeros(size, np.float32)
    samples[tuple(rng.integers(0, size))] = 1
    return samples


def full(rng, size):
    return np.ones(size, np.float32)


SCENES = (sparse, spheres, checkerboard, one_sample, full)


def judge(samples, structure, origins, directions):
    hits = leapray.trace(structure, origins, directions, mode="binary")
    objects = oracle.object_cells(samples, 0.5)
    verdict, pierced = oracle.judge(objects, origins, directions, np.isfinite(hits.t), hits.cell)
    steps = hits.counters["cells"] / max(hits.counters["rays"], 1)
    assert steps <= sum(samples.shape) + 6
    return verdict, pierced


def unsound(verdict):
    return {oracle.VERDICTS[v]: int((verdict == v).sum()) for v in set(verdict.tolist()) if v}


@pytest.mark.parametrize("name", EXACT)
def test_first_cells_are_sound_on_100000_generic_and_50000_lattice_rays(name):
    rng = np.random.default_rng(7)
    pierced_generic = []
    for index in range(50):
        size = rng.integers(1, 41, 3)
        samples = SCENES[index % len(SCENES)](rng, size)
        structure = leapray.build(leapray.Volume(samples), name)
        verdict, pierced = judge(samples, structure, *oracle.generic_rays(rng, 2000, size[::-1]))
        assert unsound(verdict) == {}, (size, SCENES[index % len(SCENES)].__name__)
        pierced_generic.append(pierced.mean())
        verdict, _ = judge(samples, structure, *oracle.lattice_rays(rng, 1000, size[::-1]))
        assert unsound(verdict) == {}, (size, SCENES[index % len(SCENES)].__name__)
    assert np.mean(pierced_generic) > 0.3  # the rays do hit


@pytest.fixture(scope="module")
def large():
    rng = np.random.default_rng(11)
    samples = np.zeros((512, 512, 512), np.uint8)
    for _ in range(60):
        lo = rng.integers(0, 420, 3)
        hi = lo + rng.integers(1, 92, 3)
        samples[lo[0] : hi[0], lo[1] : hi[1], lo[2] : hi[2]] = 255
    return samples, leapray.Volume(samples), oracle.object_cells(samples, 127.5)


@pytest.mark.slow
@pytest.mark.parametrize("name", DEFAULTS)
def test_first_cells_are_sound_at_512(name, large):
    samples, volume, objects = large
    rng = np.random.default_rng(13)
    structure = leapray.build(volume, name)
    for make, n in ((oracle.generic_rays, 100_000), (oracle.lattice_rays, 50_000)):
        origins, directions = make(rng, n, samples.shape[::-1])
        hits = leapray.trace(structure, origins, directions, mode="binary", threads=0)
        hit = np.isfinite(hits.t)
        assert hit.mean() > 0.1
        verdict, _ = oracle.judge(objects, origins, directions, hit, hits.cell)
        assert unsound(verdict) == {}


def test_the_oracle_objects_to_wrong_claims():
    samples = np.zeros((4, 4, 4), np.float32)
    samples[1, 1, 1] = samples[3, 3, 3] = 1
    objects = oracle.object_cells(samples, 0.5)
    origins, directions = np.array([[-4.0, 0.25, 0.375]]), np.array([[1.0, 0.0, 0.0]])
    claims = {
        (0, 0, 0): "sound",
        (1, 0, 0): "late",
        (2, 1, 1): "no object",
        (1, 1, 1): "not touched",
    }
    objects[2, 2, 2] = True  # cell (1, 1, 1), which the ray does not touch
    for cell, name in claims.items():
        if name == "no object":
            objects[2, 2, 3] = False
        verdict, _ = oracle.judge(objects, origins, directions, [True], [cell])
        assert oracle.VERDICTS[verdict[0]] == name
    verdict, _ = oracle.judge(objects, origins, directions, [False], [(0, 0, 0)])
    assert oracle.VERDICTS[verdict[0]] == "missed"


@pytest.mark.parametrize("mode", ["binary", "surface"])
@pytest.mark.parametrize("name", ALL)
def test_hostile_rays_miss_and_never_hang(name, mode):
    rng = np.random.default_rng(17)
    samples = sparse(rng, (9, 13, 17))
    structure = leapray.build(leapray.Volume(samples), name)
    bad = [np.nan, np.inf, -np.inf]
    good = rng.normal(size=(60, 3)) * 10, rng.normal(size=(60, 3))
    for which in (0, 1):
        for i in range(60):
            rays = [part.copy() for part in good]
            rays[which][i, i % 3] = bad[i % len(bad)]
            hits = leapray.trace(structure, *rays, mode=mode)
            assert np.isinf(hits.t[i])
    zero = leapray.trace(structure, good[0], np.zeros((60, 3)), mode=mode)
    assert np.isinf(zero.t).all()
    for scale in (1e-300, 1e-40, 1e-8, 1e8, 1e40, 1e300):  # whole directions and single components
        hits = leapray.trace(structure, good[0], good[1] * scale, mode=mode)
        assert not np.isnan(hits.t).any()
        directions = good[1].copy()
        directions[:, 1] *= scale
        hits = leapray.trace(structure, good[0], directions, mode=mode)
        assert not np.isnan(hits.t).any()
        assert np.isfinite(hits.normal).all()
    for size in (1e-300, 1e-310, 5e-324):  # no t can be told where 1 / size is infinite
        for axis in range(3):
            directions = np.zeros((60, 3))
            directions[:, axis] = size
            leapray.trace(structure, [6, 4, 3] + good[0] / 10, directions, mode=mode)
            leapray.trace(structure, good[0] * 1e9, directions, mode=mode)


@pytest.mark.parametrize("name", EXACT)
def test_rays_from_a_million_voxels_away_are_sound(name):
    rng = np.random.default_rng(19)
    samples = spheres(rng, (24, 30, 18))
    structure = leapray.build(leapray.Volume(samples), name)
    targets = np.round(rng.random((2000, 3)) * (18, 30, 24) * 2**16) / 2**16
    directions = np.round(rng.normal(size=(2000, 3)) * 2**10)
    origins = targets - directions * np.round(1e6 / np.abs(directions).max(axis=1))[:, None]
    verdict, pierced = judge(samples, structure, origins, directions)
    assert pierced.mean() > 0.1
    assert unsound(verdict) == {}


@pytest.mark.parametrize("name", EXACT)
def test_no_ray_stands_in_more_cells_than_it_can_cross_planes(name):
    rng = np.random.default_rng(23)
    samples = sparse(rng, (12, 25, 18))
    structure = leapray.build(leapray.Volume(samples), name)
    size = samples.shape[::-1]
    for make in (oracle.generic_rays, oracle.lattice_rays):
        rays = make(rng, 5000, size)
        counters = leapray.trace(structure, *rays, mode="surface", hit_test="faces").counters
        # Cells -1..n-1 along each axis have n planes between them; the first cell needs no step.
        assert counters["cells"] / 5000 < counters["most_cells"] <= sum(size) + 1
