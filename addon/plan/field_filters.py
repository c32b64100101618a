# SPDX-License-Identifier: GPL-3.0-or-later
"""What a scalar field goes through before surfaces are taken from it (no bpy).

The core's filters take arrays. Sparse fields become coarser leaf by leaf here, and become arrays,
with a layer of their background round them, where they are smoothed or lose small parts.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

import leapray
from leapray.scalar_grid import LEAF, Leaves, ScalarGrid

from .. import model
from . import objects

MOST = 1 << 28  # samples of an array that a sparse field becomes


def filtered(
    field: model.Field, threshold: float, factor: int, threads: int, watch: leapray.Watch
) -> ScalarGrid:
    """The field on a lattice so many times as coarse, smoothed, without small parts, as it asks.

    threshold: where parts are told apart. Raises LeapRayError where a sparse field is too large
    to be filtered, Stopped.
    """
    grid = coarser(field.grid, factor, threads, watch)
    if field.smoothing:
        grid = _one_region(dense(grid))
        grid = leapray.smooth(grid, field.smoothing / factor, threads=threads, watch=watch)
    if field.least:
        least = -(-field.least // factor**3)
        grid = leapray.without_islands(
            dense(grid), threshold, least, above=field.above, watch=watch
        )
    return grid


def _one_region(grid: ScalarGrid) -> ScalarGrid:
    """Of labels, which have no mean: 1 where there is one, else 0."""
    if grid.kind != "labels" or isinstance(grid.samples, Leaves):
        return grid
    values = grid.offset + grid.scale * grid.samples
    some = (values > 0) & (True if grid.no_data is None else grid.samples != grid.no_data)
    return dataclasses.replace(
        grid, samples=some.astype(np.uint8), scale=1.0, offset=0.0, kind="scalar", no_data=None
    )


def dense(grid: ScalarGrid) -> ScalarGrid:
    """The field as an array. Raises LeapRayError where that would be too large."""
    leaves = grid.samples
    if not isinstance(leaves, Leaves):
        return grid
    first, last = objects.lattice(grid)
    size = last - first + 1
    if math.prod(size.tolist()) > MOST:
        told = " x ".join(map(str, size))
        raise leapray.LeapRayError(f"a box of {told} samples is too large to be filtered")
    array = np.full(size[::-1], leaves.background, leaves.samples.dtype)
    lengths_of_leaves = np.full(len(leaves.origins), LEAF)
    for origins, lengths, values in (
        (leaves.tile_origins, leaves.tile_sizes, leaves.tile_values),
        (leaves.origins, lengths_of_leaves, leaves.samples),
    ):
        for (x, y, z), n, value in zip((origins - first).tolist(), lengths, values, strict=True):
            array[z : z + n, y : y + n, x : x + n] = value
    matrix = np.array(grid.world_from_index, np.float64)
    matrix[:3, 3] += matrix[:3, :3] @ first
    return dataclasses.replace(grid, samples=array, world_from_index=matrix)


def coarser(
    grid: ScalarGrid, factor: int, threads: int = 0, watch: leapray.Watch | None = None
) -> ScalarGrid:
    """The field on a lattice so many times as coarse, a power of two: means of what was there."""
    if factor == 1:
        return grid
    if not isinstance(grid.samples, Leaves):
        return leapray.coarser(grid, factor, threads=threads, watch=watch)
    samples = grid.samples
    for _ in range(factor.bit_length() - 1):
        samples = _halved(samples)
    to_fine = np.diag([factor, factor, factor, 1.0])
    to_fine[:3, 3] = (factor - 1) / 2
    matrix = np.asarray(grid.world_from_index) @ to_fine
    return dataclasses.replace(grid, samples=samples, world_from_index=matrix)


def _halved(leaves: Leaves) -> Leaves:
    """Leaves that hold up to eight of the finer ones; tiles as large as a leaf become parts too."""
    half = LEAF // 2
    small = leaves.tile_sizes == LEAF
    values = leaves.tile_values[small, None, None, None]
    blocks = np.concatenate(
        [_of_eight(leaves.samples), np.broadcast_to(values, (len(values), half, half, half))]
    )
    origins = np.concatenate([leaves.origins, leaves.tile_origins[small]]) // 2
    homes, which = np.unique(origins // LEAF * LEAF, axis=0, return_inverse=True)
    samples = np.full((len(homes), LEAF, LEAF, LEAF), leaves.background, blocks.dtype)
    parts = samples.reshape(len(homes), 2, half, 2, half, 2, half)
    i, j, k = (origins // half % 2).T
    parts[which.ravel(), k, :, j, :, i, :] = blocks
    return Leaves(
        homes.astype(np.int32),
        samples,
        leaves.background,
        leaves.tile_origins[~small] // 2,
        leaves.tile_sizes[~small] // 2,
        leaves.tile_values[~small],
    )


def _of_eight(samples: NDArray) -> NDArray[np.floating]:
    """Means of leaves (n, LEAF, LEAF, LEAF): f64 of f64, else f32."""
    total = np.zeros((len(samples), LEAF // 2, LEAF // 2, LEAF // 2), np.float64)
    for k in range(8):
        total += samples[:, k >> 2 :: 2, k >> 1 & 1 :: 2, k & 1 :: 2]
    return (total / 8).astype(samples.dtype if samples.dtype.kind == "f" else np.float32)
