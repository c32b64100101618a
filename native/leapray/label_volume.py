# SPDX-License-Identifier: GPL-3.0-or-later
"""Volumes of labels: one solid of all regions, with the label of each sample as its id."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ._lib import LeapRayError, Stopped, Watch
from .scalar_grid import Leaves, ScalarGrid
from .scalar_source import source_of
from .volume import Volume, VolumeBuilder

SLAB = 32  # slices at a time
LEVEL = 128  # the least stored occupancy that lies inside
MOST = 65535  # ids have 16 bits


def labels(grid: ScalarGrid, *, watch: Watch | None = None) -> Volume:
    """The solid of all samples that have a label, whose ids are the labels.

    grid: of an array (nz, ny, nx) of whole numbers 0..65535, 0 and no_data: none. Occupancy is
    that of all labels together, averaged over the 27 samples around by 1-2-1 along each axis, so
    that surfaces do not show the voxels; but samples with a label stay inside, all others
    outside, so that no region is lost. Where labels touch there is no surface and hence no gap
    between them; a hit takes the label of the nearest sample inside. Raises LeapRayError for
    numbers that are no labels and for leaves, OutOfMemory, Stopped when watch was told to stop.
    """
    source = source_of(grid)
    array = grid.samples
    if isinstance(array, Leaves):
        raise LeapRayError(f"labels of {grid.name!r} must be an array, not leaves")
    level = (LEVEL - 0.5) / 255
    builder = VolumeBuilder(source.size, "u8", level, source.object_from_index, has_ids=True)
    for first in range(0, len(array), SLAB):
        if watch is not None and watch.stopped:
            raise Stopped("the making of labels was stopped")
        low = max(0, first - 1)
        ids = _labels_of(grid, array[low : first + SLAB + 1])
        own = slice(first - low, first - low + min(SLAB, len(array) - first))
        builder.put((0, 0, first), _occupancy(ids > 0)[own], ids[own])
    return builder.finish()


def _labels_of(grid: ScalarGrid, block: NDArray) -> NDArray[np.uint16]:
    with np.errstate(all="ignore"):
        numbers = np.where(block == grid.no_data, 0, block) if grid.no_data is not None else block
        ids = numbers.astype(np.uint16)
        right = (ids == numbers).all()
    if not right:
        came = numbers[ids != numbers][0]
        raise LeapRayError(f"labels must be whole numbers in 0..{MOST}; {grid.name!r} has {came}")
    return ids


def _occupancy(solid: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """0..255, of which 128 and more lie inside; beyond the block all is 0."""
    total: NDArray = solid.astype(np.uint8)
    for axis in range(3):
        line = np.moveaxis(total, axis, 0)
        out = 2 * line
        out[1:] += line[:-1]
        out[:-1] += line[1:]
        total = np.moveaxis(out, 0, axis)
    occupancy = 4 * total.astype(np.uint16)  # of 64 parts
    inner = np.clip(occupancy, LEVEL, 255)
    return np.where(solid, inner, np.minimum(occupancy, LEVEL - 1)).astype(np.uint8)
