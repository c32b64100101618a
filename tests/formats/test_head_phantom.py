# SPDX-License-Identifier: GPL-3.0-or-later
"""Claims about the whole way from a scan's file to hits on its surfaces: the head of
blend_samples/head_phantom.py, whose field is known everywhere, is seen where the field says."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import leapray
from addon.arrays import unit

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "blend_samples"))

import head_phantom as head

SIZE = 96
STEP = head.spacing(SIZE)
AROUND = 300.0  # millimetres from the middle: where rays begin
SKIN, BONE = head.SKIN_AT, head.BONE_AT


@pytest.fixture(scope="module")
def grid(tmp_path_factory) -> leapray.ScalarGrid:
    path = tmp_path_factory.mktemp("head") / "head.nii.gz"
    head.write(path, SIZE)
    return leapray.read_volume(path)


def values(points) -> np.ndarray:
    return head.values(*points.T)


def slope(points, step: float = 1e-3) -> np.ndarray:
    """(n, 3): the outward unit normals of the field at points."""
    ahead = step * np.eye(3)
    return unit(np.stack([values(points - a) - values(points + a) for a in ahead], axis=1))


def crossings(origins, directions, near, threshold):
    """Where the field rises to the threshold along rays, within two samples of `near`, by halving;
    and on which rays it does."""
    at = lambda t: values(origins + t[:, None] * directions) >= threshold  # noqa: E731
    low, high = near - 2 * STEP, near + 2 * STEP
    crosses = ~at(low) & at(high)
    for _ in range(40):
        middle = (low + high) / 2
        inside = at(middle)
        low, high = np.where(inside, low, middle), np.where(inside, middle, high)
    return (low + high) / 2, crosses


def test_the_file_says_what_the_phantom_is(grid):
    assert grid.samples.shape == (SIZE,) * 3 and grid.samples.dtype == np.int16
    assert (grid.scale, grid.offset, grid.meters, grid.kind) == (1.0, 0.0, 1e-3, "scalar")
    assert_allclose(grid.world_from_index, head.world_from_index(SIZE), atol=1e-4)
    assert_array_equal(grid.samples, head.volume(SIZE))


@pytest.mark.parametrize(
    ("threshold", "depth", "degrees", "missed"),
    [
        (SKIN, 0.09, 6.5, 0.002),
        (BONE, 0.11, 8.5, 0.02),  # rims of sockets, gaps between teeth: two samples wide
    ],
    ids=["skin", "bone"],
)
def test_surfaces_are_where_the_field_has_them(grid, threshold, depth, degrees, missed):
    """Along rays from all around: 99 % of the errors, in samples and degrees, and the share of
    hits without a surface nearby. All three shrink as samples get closer."""
    rng = np.random.default_rng(1)
    origins = AROUND * unit(rng.normal(size=(20_000, 3)))
    directions = unit(rng.uniform(-60, 60, (20_000, 3)) - origins)
    hits = leapray.trace(leapray.build(leapray.isosurface(grid, threshold)), origins, directions)
    found = np.flatnonzero(np.isfinite(hits.t))
    points = origins[found] + hits.t[found, None] * directions[found]
    found = found[np.abs(points).max(axis=1) < head.EXTENT / 2 - STEP]  # not the neck's cap
    assert len(found) > 18_000
    t, crosses = crossings(origins[found], directions[found], hits.t[found], threshold)
    normals = slope(origins[found] + t[:, None] * directions[found])
    facing = np.abs(np.einsum("na,na->n", normals, directions[found]))
    errors = np.abs(t - hits.t[found]) * facing / STEP  # perpendicular
    cosines = np.einsum("na,na->n", normals, hits.normal[found]).clip(-1, 1)
    assert 1 - crosses.mean() < missed
    assert np.quantile(errors[crosses], 0.99) < depth
    assert np.quantile(np.degrees(np.arccos(cosines[crosses])), 0.99) < degrees


@pytest.mark.parametrize(
    ("threshold", "origin", "end"),
    [
        (SKIN, (0, 0, 300), (0, 0, 18 + 96)),
        (SKIN, (0, -300, 18), (0, -97, 18)),
        (SKIN, (0, 300, -17), (0, 104 + 14, -17)),
        (SKIN, (300, -8, 0), (77 + 8, -8, 0)),
        (SKIN, (-300, -8, 0), (-77 - 8, -8, 0)),
        (BONE, (0, -4, 300), (0, -4, 24 + 82)),
        (BONE, (0, -300, 24), (0, -4 - 87, 24)),
    ],
    ids=["crown", "back", "nose", "right ear", "left ear", "top of skull", "back of skull"],
)
def test_landmarks_lie_in_the_files_world(grid, threshold, origin, end):
    """Right, front and up are +x, +y and +z: ends of ellipsoids, to a fifth of a sample."""
    begin, goal = np.array([origin], np.float64), np.array(end, np.float64)
    hits = leapray.trace(
        leapray.build(leapray.isosurface(grid, threshold)), begin, unit(goal - begin)
    )
    assert_allclose(begin[0] + hits.t[0] * unit(goal - begin[0]), goal, atol=STEP / 5)
