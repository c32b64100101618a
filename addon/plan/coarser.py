# SPDX-License-Identifier: GPL-3.0-or-later
"""Scalar fields on lattices twice as coarse, as often as needed (no bpy).

A sample becomes the mean of eight, at their middle; labels, and fields that have samples without a
value, keep the first of the eight, since a mean of names is none.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from leapray.scalar_grid import LEAF, Leaves, ScalarGrid

SLAB = 1 << 24  # samples of an array that are worked on at a time


def coarser(grid: ScalarGrid, factor: int) -> ScalarGrid:
    """The field on a lattice so many times as coarse, a power of two."""
    while factor > 1:
        grid, factor = _halved(grid), factor // 2
    return grid


def _halved(grid: ScalarGrid) -> ScalarGrid:
    mean = grid.kind != "labels" and grid.no_data is None
    samples = grid.samples
    halved = _leaves(samples, mean) if isinstance(samples, Leaves) else _array(samples, mean)
    to_fine = np.diag([2.0, 2.0, 2.0, 1.0])
    to_fine[:3, 3] = 0.5 * mean
    return dataclasses.replace(
        grid, samples=halved, world_from_index=np.asarray(grid.world_from_index) @ to_fine
    )


def _array(samples: NDArray, mean: bool) -> NDArray:
    """Of an array (nz, ny, nx); an odd last plane counts twice."""
    nz, ny, nx = samples.shape
    made = np.empty([-(-n // 2) for n in samples.shape], _dtype(samples, mean))
    step = 2 * max(SLAB // (2 * ny * nx), 1)
    for first in range(0, nz, step):
        block = np.asarray(samples[first : first + step])
        block = np.pad(block, [(0, n % 2) for n in block.shape], mode="edge")
        made[first // 2 : first // 2 + len(block) // 2] = _of_eight(block, mean)
    return made


def _of_eight(block: NDArray, mean: bool) -> NDArray:
    """Of an array (..., 2 nz, 2 ny, 2 nx)."""
    first = block[..., ::2, ::2, ::2]
    if not mean:
        return first
    total = np.zeros(first.shape, np.float64)
    for k in range(8):
        total += block[..., k >> 2 :: 2, k >> 1 & 1 :: 2, k & 1 :: 2]
    return total / 8


def _dtype(samples: NDArray, mean: bool) -> np.dtype:
    """Of means: floats as they are, others as f32."""
    return samples.dtype if samples.dtype.kind == "f" or not mean else np.dtype(np.float32)


def _leaves(leaves: Leaves, mean: bool) -> Leaves:
    """Leaves that hold up to eight of the finer ones; tiles as large as a leaf become parts too."""
    dtype, half = _dtype(leaves.samples, mean), LEAF // 2
    small = leaves.tile_sizes == LEAF
    values = leaves.tile_values[small, None, None, None]
    blocks = np.concatenate(
        [_of_eight(leaves.samples, mean), np.broadcast_to(values, (len(values), half, half, half))]
    )
    origins = np.concatenate([leaves.origins, leaves.tile_origins[small]]) // 2
    homes, which = np.unique(origins // LEAF * LEAF, axis=0, return_inverse=True)
    samples = np.full((len(homes), LEAF, LEAF, LEAF), leaves.background, dtype)
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
