# SPDX-License-Identifier: GPL-3.0-or-later
"""What a scalar field goes through before surfaces are taken from it (no bpy).

Where sparse fields lose small parts they become arrays, with a layer of their background round
them: the search for parts takes no others.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

import leapray
from leapray.file_samples import Samples, Spool
from leapray.scalar_grid import LEAF, Leaves, ScalarGrid

from .. import model
from . import objects

MOST = 1 << 28  # samples of an array that a sparse field becomes
SLAB = 8  # slices that are taken at a time
COARSEST = 64  # the most samples of which one stands for, along an axis


def filtered(
    field: model.Field,
    threshold: float,
    factor: int,
    room: float,
    threads: int,
    watch: leapray.Watch,
) -> ScalarGrid:
    """The field on a lattice so many times as coarse, smoothed, without small parts, as it asks.

    threshold: where parts are told apart. room: bytes of memory. Raises LeapRayError where a sparse
    field is too large to be filtered, OutOfMemory, Stopped.
    """
    grid = coarser(field.grid, factor, threads, watch)
    if field.smoothing:
        grid = leapray.smooth(
            _one_region(grid), field.smoothing / factor, threads=threads, watch=watch
        )
    if field.least:
        least = -(-field.least // factor**3)
        whole = dense(grid)
        assert not isinstance(whole.samples, Leaves)
        if 2 * whole.samples.size > room:  # a byte inside, and one for what is small
            raise leapray.OutOfMemory("the search for small parts needs more than its room")
        grid = leapray.without_islands(whole, threshold, least, above=field.above, watch=watch)
    return grid


def coarser(grid: ScalarGrid, factor: int, threads: int, watch: leapray.Watch) -> ScalarGrid:
    """The grid on a lattice so many times as coarse; itself, where that is 1."""
    if factor == 1:
        return grid
    return leapray.coarser(grid, factor, threads=threads, watch=watch)


def _one_region(grid: ScalarGrid) -> ScalarGrid:
    """Of labels, which have no mean: 1 where there is one, else 0."""
    if grid.kind != "labels" or isinstance(grid.samples, Leaves):
        return grid
    some = Spool(grid.samples.shape, np.dtype(np.uint8))
    for first, block in _slabs(grid.samples):
        known = True if grid.no_data is None else block != grid.no_data
        some[first : first + len(block)] = (grid.offset + grid.scale * block > 0) & known
    return dataclasses.replace(
        grid, samples=some.samples(), scale=1.0, offset=0.0, kind="scalar", no_data=None
    )


def _slabs(samples: Samples):
    """First slice and numbers of a few slices, one after the other."""
    for first in range(0, len(samples), SLAB):
        yield first, samples[first : first + SLAB]


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
    spool = Spool(size[::-1].tolist(), leaves.samples.dtype)
    leaf = np.full(len(leaves.origins), LEAF)
    starts = np.concatenate([leaves.tile_origins, leaves.origins]) - first
    sides = np.concatenate([leaves.tile_sizes, leaf])
    n_tiles = len(leaves.tile_origins)
    for low in range(0, int(size[2]), LEAF):
        high = min(low + LEAF, int(size[2]))
        slab = np.full((high - low, size[1], size[0]), leaves.background, spool.dtype)
        for at in np.flatnonzero((starts[:, 2] < high) & (starts[:, 2] + sides > low)):
            (x, y, z), n = starts[at].tolist(), int(sides[at])
            block = leaves.samples[int(at) - n_tiles] if at >= n_tiles else leaves.tile_values[at]
            cube = np.broadcast_to(block, (n,) * 3)[max(low - z, 0) : high - z]
            slab[max(z - low, 0) : z + n - low, y : y + n, x : x + n] = cube
        spool[low:high] = slab
    matrix = np.array(grid.world_from_index, np.float64)
    matrix[:3, 3] += matrix[:3, :3] @ first
    return dataclasses.replace(grid, samples=spool.samples(), world_from_index=matrix)
