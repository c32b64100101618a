# SPDX-License-Identifier: GPL-3.0-or-later
"""Filters of scalar fields before surfaces are taken from them: smoothing, small parts (no bpy).

Sparse fields become arrays for that, with a layer of their background round them.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

import leapray
from leapray.scalar_grid import LEAF, Leaves, ScalarGrid

from . import objects

REACH = 3.0  # standard deviations that a Gaussian is taken to reach
MOST = 1 << 28  # samples of an array that a sparse field becomes
SLAB = 1 << 22  # samples that are worked on at a time

Check = Callable[[], None]  # raises leapray.Stopped


def dense(grid: ScalarGrid) -> ScalarGrid:
    """The field as an array. Raises LeapRayError where that would be too large."""
    leaves = grid.samples
    if not isinstance(leaves, Leaves):
        return grid
    first, last = objects.lattice(grid)
    size = last - first + 1
    if math.prod(size.tolist()) > MOST:
        sides = " x ".join(map(str, size))
        raise leapray.LeapRayError(f"a box of {sides} samples is too large to be smoothed")
    array = np.full(size[::-1], leaves.background, leaves.samples.dtype)
    for origin, side, value in zip(
        leaves.tile_origins, leaves.tile_sizes, leaves.tile_values, strict=True
    ):
        x, y, z = origin - first
        array[z : z + side, y : y + side, x : x + side] = value
    for origin, leaf in zip(leaves.origins, leaves.samples, strict=True):
        x, y, z = origin - first
        array[z : z + LEAF, y : y + LEAF, x : x + LEAF] = leaf
    matrix = np.array(grid.world_from_index, np.float64)
    matrix[:3, 3] += matrix[:3, :3] @ first
    return dataclasses.replace(grid, samples=array, world_from_index=matrix)


# ---- smoothing -----------------------------------------------------------------


def smoothed(grid: ScalarGrid, sigma: float, check: Check) -> ScalarGrid:
    """The field's mean by a Gaussian, sigma samples wide; of labels that of 1 where there is one.

    Samples without a value do not count, and stay without.
    """
    grid = dense(grid)
    samples = grid.samples
    assert not isinstance(samples, Leaves)
    none = _none(grid, samples)
    if grid.kind == "labels":
        values = (grid.offset + grid.scale * samples > 0).astype(np.float32)
        grid = dataclasses.replace(grid, scale=1.0, offset=0.0)
    else:
        values = samples.astype(np.float32)
    weights = _kernel(sigma)
    if none is None:
        made = _convolved(values, weights, check)
    else:
        values[none] = 0.0
        share = _convolved((~none).astype(np.float32), weights, check)
        made = _convolved(values, weights, check)
        np.divide(made, share, out=made, where=share > 0)
        made[none] = np.nan
    return dataclasses.replace(grid, samples=made, no_data=None)


def _none(grid: ScalarGrid, samples: NDArray) -> NDArray[np.bool_] | None:
    """Which samples have no value; None: all have."""
    none = np.zeros(samples.shape, bool)
    if grid.no_data is not None:
        none |= samples == grid.no_data
    if samples.dtype.kind == "f":
        none |= ~np.isfinite(samples)
    return none if none.any() else None


def _kernel(sigma: float) -> NDArray[np.float32]:
    """(2 n + 1,) weights, 1 together."""
    n = max(math.ceil(REACH * sigma), 1)
    weights = np.exp(-0.5 * (np.arange(-n, n + 1) / sigma) ** 2)
    return (weights / weights.sum()).astype(np.float32)


def _convolved(values: NDArray, weights: NDArray, check: Check) -> NDArray[np.float32]:
    """Along each axis; beyond the border lies what lies there."""
    for axis in range(3):
        moved = np.moveaxis(values, axis, 0)
        made = np.empty_like(values)
        target = np.moveaxis(made, axis, 0)
        n, reach = len(moved), len(weights) // 2
        step = max(SLAB * n // max(values.size, 1), 1)
        for first in range(0, n, step):
            check()
            last = min(first + step, n)
            total = np.zeros(target[first:last].shape, np.float32)
            for k, weight in enumerate(weights):
                rows = np.clip(np.arange(first, last) + k - reach, 0, n - 1)
                total += weight * moved[rows]
            target[first:last] = total
        values = made
    return values


# ---- small parts ----------------------------------------------------------------


def without_islands(
    grid: ScalarGrid, threshold: float, above: bool, least: int, check: Check
) -> ScalarGrid:
    """The field without parts of fewer than so many samples that lie inside at a threshold.

    A part is connected along the axes. Its samples get the value of the field that lies
    farthest outside.
    """
    grid = dense(grid)
    samples = grid.samples
    assert not isinstance(samples, Leaves)
    inside = np.empty(samples.shape, bool)
    for k in range(len(samples)):
        check()
        values = grid.offset + grid.scale * samples[k].astype(np.float64)
        inside[k] = values >= threshold if above else values <= threshold
    none = _none(grid, samples)
    if none is not None:
        inside &= ~none
    starts, ends = _runs(inside)
    check()
    parts = _parts(starts, ends, inside.shape)
    small = np.bincount(parts, ends - starts)[parts] < least if len(parts) else parts > 0
    if not small.any():
        return grid
    kept = samples[~inside if none is None else ~inside & ~none]
    farthest = kept.min() if above == (grid.scale > 0) else kept.max()
    changed = np.array(samples)
    flat = changed.reshape(-1)
    for start, end in zip(starts[small].tolist(), ends[small].tolist(), strict=True):
        flat[start:end] = farthest
    return dataclasses.replace(grid, samples=changed)


def _runs(inside: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Flat indices where rows of what is true begin, and where they end."""
    rows = inside.reshape(-1, inside.shape[2])
    edges = np.zeros((len(rows), inside.shape[2] + 1), np.int8)
    edges[:, :-1] += rows
    edges[:, 1:] -= rows
    row, at = np.nonzero(edges > 0)
    starts = row * inside.shape[2] + at
    row, at = np.nonzero(edges < 0)
    return starts, row * inside.shape[2] + at


def _parts(starts: NDArray, ends: NDArray, shape: tuple[int, ...]) -> NDArray[np.int64]:
    """For each run the first run of the part that it belongs to."""
    _, ny, nx = shape
    row = starts // nx
    pairs = []
    for step, has in ((1, row % ny < ny - 1), (ny, np.ones(len(row), bool))):
        # runs of the row `step` rows on that share a column
        low = np.searchsorted(ends, starts + step * nx, "right")
        high = np.searchsorted(starts, ends + step * nx, "left")
        count = np.where(has, np.maximum(high - low, 0), 0)
        one = np.repeat(np.arange(len(row)), count)
        skipped = np.cumsum(count) - count
        other = np.repeat(low - skipped, count) + np.arange(count.sum())
        pairs.append((one, other))
    one, other = (np.concatenate(side) for side in zip(*pairs, strict=True))
    return _joined(len(row), one, other)


def _joined(n: int, one: NDArray, other: NDArray) -> NDArray[np.int64]:
    """Connected components of a graph, each named by its least node (Shiloach and Vishkin 1982:
    roots are hooked to smaller ones, and paths are halved, until nothing changes)."""
    parent = np.arange(n)
    while True:
        a, b = parent[one], parent[other]
        apart = a != b
        if not apart.any():
            return parent
        one, other, a, b = one[apart], other[apart], a[apart], b[apart]
        np.minimum.at(parent, np.maximum(a, b), np.minimum(a, b))
        while True:
            above = parent[parent]
            if (above == parent).all():
                break
            parent = above
