# SPDX-License-Identifier: GPL-3.0-or-later
"""Scalar grids made of scalar grids, and volumes of labels."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import leapray
from leapray import (
    Leaves,
    ScalarGrid,
    coarser,
    file_samples,
    isosurface,
    labels,
    smooth,
    without_islands,
)

PLACE = np.array([[0.5, 0.1, 0, 3], [0, 0.7, 0.2, -1], [0, 0, 1.5, 2], [0, 0, 0, 1.0]])


def grid_of(samples, place=PLACE, **more) -> ScalarGrid:
    return ScalarGrid("test", np.asarray(samples), place, **more)


def points_of(grid: ScalarGrid) -> np.ndarray:
    """Where the samples lie, (nz, ny, nx, 3)."""
    k, j, i = np.indices(grid.samples.shape)
    index = np.stack([i, j, k, np.ones_like(i)], -1)
    return (index @ grid.world_from_index.T)[..., :3]


# ---- fewer samples -----------------------------------------------------------------------------


@pytest.mark.parametrize("factor", [1, 2, 3, 5])
def test_a_linear_field_stays_what_it_is_where_samples_are_fewer(factor):
    grid = grid_of(np.zeros((15, 30, 30)))
    linear = points_of(grid) @ np.array([1.0, -2.0, 0.5])
    fewer = coarser(grid_of(linear), factor)
    assert fewer.samples.shape == (15 // factor + (15 % factor > 0), -(-30 // factor), 30 // factor)
    whole = tuple(slice(n // factor) for n in linear.shape)  # blocks of which nothing is cut off
    want = points_of(fewer) @ np.array([1.0, -2.0, 0.5])
    assert_allclose(fewer.samples[whole], want[whole], rtol=0, atol=1e-9)


def test_means_leave_out_what_is_not_known():
    samples = np.array([[[1.0, 3.0], [np.nan, np.nan]]])
    assert_allclose(coarser(grid_of(samples)).samples, [[[2.0]]])
    assert np.isnan(coarser(grid_of(np.full((2, 2, 2), np.nan))).samples).all()
    whole = np.array([[[7, 8, -5], [-5, -5, -5]]], np.int16)
    assert_array_equal(coarser(grid_of(whole, no_data=-5)).samples, [[[8, -5]]])


def test_fewer_samples_keep_their_type_and_their_solid():
    rng = np.random.default_rng(0)
    k, j, i = np.indices((40, 40, 40))
    field = 1000 - 40 * np.sqrt((i - 20) ** 2 + (j - 19) ** 2 + (k - 21) ** 2)
    grid = grid_of((field + rng.normal(0, 5, field.shape)).astype(np.int16), np.eye(4))
    fewer = coarser(grid, 2, threads=1)
    assert fewer.samples.dtype == np.int16
    assert_array_equal(fewer.samples, coarser(grid, 2, threads=3).samples)
    origin = np.array([[20.0, 19, -30]])
    t = [leapray.trace(leapray.build(isosurface(g, 400.0)), origin, [[0, 0, 1.0]]).t[0]
         for g in (grid, fewer)]  # fmt: skip
    assert abs(t[0] - 36) < 0.3 and abs(t[1] - t[0]) < 0.3


# ---- smoother ----------------------------------------------------------------------------------


@pytest.mark.parametrize("sigma", [0.0, 0.7, 1.0, 2.3])
def test_a_point_becomes_a_gaussian(sigma):
    samples = np.zeros((45, 47, 49), np.float32)
    samples[22, 23, 24] = 1.0
    k, j, i = np.indices(samples.shape)
    square = (i - 24) ** 2 + (j - 23) ** 2 + (k - 22) ** 2
    want = np.exp(-0.5 * square / max(sigma, 1e-9) ** 2)
    want /= want.sum()
    got = smooth(grid_of(samples), sigma).samples
    near = np.abs([i - 24, j - 23, k - 22]).max(0) <= math.floor(4 * sigma)
    assert_allclose(got[near], want[near], rtol=2e-3, atol=1e-6)  # the tails beyond 4 sigma
    assert got.sum() == pytest.approx(1.0, abs=1e-5)


def test_constant_fields_stay_constant_up_to_borders_and_holes():
    samples = np.full((9, 10, 40), 7.0, np.float32)
    samples[4, 4, 4:20] = np.nan
    got = smooth(grid_of(samples), 1.5).samples
    assert_array_equal(np.isnan(got), np.isnan(samples))
    assert_allclose(got[~np.isnan(got)], 7.0, rtol=1e-5)
    assert_array_equal(got, smooth(grid_of(samples), 1.5, threads=1).samples)


def test_no_data_takes_no_part():
    samples = np.full((6, 6, 6), 100, np.int16)
    samples[2, 2, 2] = -32768
    got = smooth(grid_of(samples, no_data=-32768), 1.0)
    assert np.isnan(got.samples[2, 2, 2]) and got.no_data is None
    assert_allclose(np.delete(got.samples.ravel(), 2 * 36 + 2 * 6 + 2), 100, rtol=1e-5)


# ---- islands -----------------------------------------------------------------------------------


def components(solid: np.ndarray) -> np.ndarray:
    """Sizes of the 26-connected components of a few samples, by flooding."""
    left = {tuple(at) for at in np.argwhere(solid)}
    size = np.zeros(solid.shape, int)
    while left:
        found, todo = [], [left.pop()]
        while todo:
            z, y, x = todo.pop()
            found.append((z, y, x))
            around = {(z + a, y + b, x + c) for a, b, c in itertools.product((-1, 0, 1), repeat=3)}
            near = around & left
            left -= near
            todo += near
        for at in found:
            size[at] = len(found)
    return size


@pytest.mark.parametrize("seed", range(6))
def test_pieces_below_a_size_vanish_and_no_others(seed):
    rng = np.random.default_rng(seed)
    samples = rng.normal(size=rng.choice([1, 3, 9, 14], 3)).astype([np.float32, ">f8"][seed % 2])
    above = seed % 3 > 0
    threshold = 1.4 if above else -1.4
    size = components(samples >= threshold if above else samples <= threshold)
    for least in (0, 2, 4, 10):
        grid = without_islands(grid_of(samples), threshold, least, above=above)
        solid = grid.samples >= threshold if above else grid.samples <= threshold
        assert_array_equal(solid, (size >= max(least, 1)))
        assert_array_equal(grid.samples[solid], samples[solid])


# ---- labels ------------------------------------------------------------------------------------


def some_labels() -> ScalarGrid:
    k, j, i = np.indices((30, 30, 30))
    ball = (i - 14.6) ** 2 + (j - 15.2) ** 2 + (k - 14.9) ** 2 < 100
    named = np.where(i < 15, 3, np.where(j < 15, 40000, 7)) * ball
    named[2, 2, 2:9] = 9  # a line of one sample across
    return grid_of(named.astype(np.int32), np.eye(4), kind="labels")


def test_every_labelled_sample_lies_inside_and_no_other():
    grid = some_labels()
    volume = labels(grid)
    assert_array_equal(volume.read() >= 255 * volume.info.threshold, grid.samples > 0)
    assert_array_equal(volume.read_ids(), grid.samples)


def test_labels_have_one_surface_without_gaps_and_hits_take_the_nearest():
    grid = some_labels()
    structure = leapray.build(labels(grid))
    rng = np.random.default_rng(1)
    way = rng.normal(size=(4000, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    centre = np.array([14.6, 15.2, 14.9])
    inner = leapray.trace(structure, np.broadcast_to(centre, way.shape), way)
    assert_allclose(inner.t, 10, atol=1.0)  # nothing stops a ray where labels touch
    outer = leapray.trace(structure, centre + 30 * way, -way)
    point = centre + (30 - outer.t)[:, None] * way
    want = np.where(point[:, 0] < 14.5, 3, np.where(point[:, 1] < 14.5, 40000, 7))
    clear = (np.abs(point[:, :2] - 14.5) > 1).all(1) & (np.abs(way).max(1) < 0.99)
    assert_array_equal(outer.id[clear], want[clear])


def test_label_surfaces_are_smoother_than_voxels():
    grid = some_labels()
    blocks = grid_of((grid.samples > 0).astype(np.uint8), np.eye(4))
    rng = np.random.default_rng(1)
    way = rng.normal(size=(4000, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    centre = np.array([14.6, 15.2, 14.9])

    def turned(volume: leapray.Volume) -> float:
        hits = leapray.trace(leapray.build(volume), centre + 30 * way, -way)
        return np.degrees(np.arccos(np.clip((hits.normal * way).sum(1), -1, 1))).mean()

    assert turned(labels(grid)) < 0.75 * turned(isosurface(blocks, 0.5))


# ---- leaves ------------------------------------------------------------------------------------

SIDE, LOW = 128, -64  # of a box round the leaves, and its first sample


def sparse(rng, dtype=np.float32, background=-7.0, n=20, unknown=False) -> ScalarGrid:
    """Leaves in any order, tiles of 8, 24 and 32 samples, on both sides of 0."""
    places = 8 * rng.permutation(list(np.ndindex(4, 4, 4)))[:n] - 32
    blocks = rng.normal(size=(n, 8, 8, 8)) * 100
    if unknown:
        blocks[:, 2, 3:5] = np.nan
        blocks[0] = np.nan
    tiles = np.array([(8, 8, 8), (-40, -40, -48), (-32, -48, 16)])
    leaves = Leaves(
        places.astype(np.int32),
        blocks.astype(dtype),
        background,
        tiles.astype(np.int32),
        np.array([32, 8, 24], np.int32),
        np.array([300.0, 5.0, -9.0]),
    )
    sides = np.array([32, 8, 24])[:, None, None]
    inside = (places >= tiles[:, None]) & (places < tiles[:, None] + sides)
    keep = ~inside.all(axis=2).any(axis=0)
    leaves = replace(leaves, origins=leaves.origins[keep], samples=leaves.samples[keep])
    return ScalarGrid("sparse", leaves, PLACE)


def dense(grid: ScalarGrid, low: int, side: int) -> np.ndarray:
    """All samples of a box; each place is told once."""
    parts = grid.samples
    made = np.full((side,) * 3, parts.background, np.result_type(parts.samples.dtype, np.float32))
    told = np.zeros(made.shape, int)
    sizes = [8] * len(parts.origins) + parts.tile_sizes.tolist()
    values = [*parts.samples, *parts.tile_values]
    origins = np.concatenate([parts.origins, parts.tile_origins]) - low
    for (x, y, z), n, value in zip(origins.tolist(), sizes, values, strict=True):
        assert min(x, y, z) >= 0 and max(x, y, z) + n <= side and n % 8 == 0
        cut = slice(z, z + n), slice(y, y + n), slice(x, x + n)
        made[cut] = value
        told[cut] += 1
    assert told.max() == 1
    return made


@pytest.mark.parametrize("where", ["in memory", "in a file"])
@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.int32])
def test_coarser_leaves_are_the_coarser_array(dtype, where, monkeypatch):
    grid = sparse(np.random.default_rng(5), dtype)
    if where == "in a file":
        monkeypatch.setattr(file_samples, "SMALL", 0)
        kept = file_samples.spooled(grid.samples.samples)
        grid = replace(grid, samples=replace(grid.samples, samples=kept))
    array = grid_of(dense(grid, LOW, SIDE))
    for factor in (1, 2, 4, 8):
        want, got = coarser(array, factor), coarser(grid, factor)
        assert_allclose(got.world_from_index, array_place(grid, factor))
        first, side = LOW // factor - 8, SIDE // factor + 16
        around = slice(8, 8 + SIDE // factor)
        found = dense(got, first, side)
        assert_allclose(found[around, around, around], want.samples, rtol=1e-5, atol=1e-4)
        assert (np.delete(found, range(8, 8 + SIDE // factor), 0) == -7.0).all()


def array_place(grid, factor):
    """Sample i of the coarser grid is the mean of i factor to i factor + factor - 1."""
    place = np.diag([factor, factor, factor, 1.0])
    place[:3, 3] = (factor - 1) / 2
    return grid.world_from_index @ place


def test_means_of_leaves_leave_out_what_is_not_known():
    grid = sparse(np.random.default_rng(6), unknown=True)
    want = coarser(grid_of(dense(grid, LOW, SIDE)), 2).samples
    got = dense(coarser(grid, 2), LOW // 2, SIDE // 2)
    assert np.isnan(want).sum() > 60
    assert_allclose(got, want, rtol=1e-5, atol=1e-4)


@pytest.mark.parametrize("where", ["in memory", "in a file"])
@pytest.mark.parametrize("sigma", [0.0, 0.7, 1.5, 3.1])
@pytest.mark.parametrize("unknown", [False, True])
def test_smooth_leaves_are_the_smooth_array(sigma, unknown, where, monkeypatch):
    grid = sparse(np.random.default_rng(7), unknown=unknown)
    if where == "in a file":
        monkeypatch.setattr(file_samples, "SMALL", 0)
        kept = file_samples.spooled(grid.samples.samples)
        grid = replace(grid, samples=replace(grid.samples, samples=kept))
    got = smooth(grid, sigma, threads=3)
    assert_allclose(got.world_from_index, grid.world_from_index)
    want = smooth(grid_of(dense(grid, LOW, SIDE)), sigma).samples
    assert_allclose(dense(got, LOW, SIDE), want, rtol=1e-4, atol=1e-3)
    assert np.isnan(want).any() == unknown


def test_smoothing_leaves_far_spaces_and_the_inside_of_tiles_alone():
    far = 8 * np.array([(0, 0, 0), (100_000, 0, 50_000)])
    tile = np.array([(1024, 1024, 1024)])
    samples = np.random.default_rng(8).normal(size=(2, 8, 8, 8))
    leaves = Leaves(far.astype(np.int32), samples, -1.0, tile.astype(np.int32),
                    np.array([128], np.int32), np.array([5.0]))  # fmt: skip
    made = smooth(ScalarGrid("far", leaves, PLACE), 1.0).samples
    assert len(made.samples) < 2 * 27 + 6 * 2 * 18**2
    inner = made.tile_values == 5.0
    # of the tile a leaf's width at its border is told anew, some of it alike
    assert (made.tile_sizes[inner].astype(int) ** 3).sum() >= 112**3
    assert made.tile_sizes.max() == 32


# ---- what is refused ---------------------------------------------------------------------------


def test_wrong_grids_and_numbers_are_refused():
    leaves = Leaves(np.zeros((1, 3), np.int32), np.zeros((1, 8, 8, 8), np.float32), 0.0)
    sparse = ScalarGrid("sparse", leaves, np.eye(4))
    one = np.zeros((1, 3), np.int32)
    vast = replace(leaves, tile_origins=one - 4096, tile_sizes=one[0, :1] + 4096,
                   tile_values=np.ones(1))  # fmt: skip
    named = grid_of(np.zeros((2, 2, 2), np.uint8), kind="labels")
    plain = grid_of(np.zeros((2, 2, 2)))
    for call in (
        lambda: coarser(sparse, 3),
        lambda: coarser(replace(sparse, kind="labels")),
        lambda: smooth(replace(sparse, kind="labels"), 1.0),
        lambda: smooth(sparse, -1.0),
        lambda: smooth(replace(sparse, samples=vast), 16.0),
        lambda: labels(sparse),
        lambda: without_islands(sparse, 0.5, 3),
        lambda: coarser(plain, 0),
        lambda: coarser(plain, 1.5),
        lambda: smooth(plain, -1.0),
        lambda: smooth(plain, math.nan),
        lambda: smooth(named, 1.0),
        lambda: labels(grid_of(np.full((2, 2, 2), 0.5))),
        lambda: labels(grid_of(np.full((2, 2, 2), -1))),
        lambda: labels(grid_of(np.full((2, 2, 2), 70000))),
        lambda: coarser(grid_of(np.zeros((0, 2, 2)))),
    ):
        with pytest.raises(leapray.LeapRayError):
            call()


def test_a_stop_is_heard():
    watch = leapray.Watch()
    watch.stop()
    grid = grid_of(np.random.default_rng(0).random((16, 16, 16)))
    for call in (
        lambda: coarser(grid, watch=watch),
        lambda: smooth(grid, 1.0, watch=watch),
        lambda: isosurface(grid, 0.5, watch=watch),
        lambda: without_islands(grid, 0.5, 3, watch=watch),
        lambda: labels(grid_of(np.ones((9, 9, 9), np.uint8)), watch=watch),
    ):
        with pytest.raises(leapray.Stopped):
            call()
