# SPDX-License-Identifier: GPL-3.0-or-later
"""Scalar grids made of scalar grids: coarser, smoother, without small islands."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ._lib import LeapRayError, Stopped, Watch, call, lib
from .arrays import empty, pointer
from .scalar_grid import ScalarGrid
from .scalar_source import source_of
from .threads import check_threads, run_parts

SLAB = 8  # slices that a thread takes at a time
REACH = 4.0  # sigmas, beyond which a Gaussian is 0.0001 of its peak at most


def _array_of(grid: ScalarGrid) -> NDArray:
    """The samples of a dense grid. Raises LeapRayError for others."""
    source = source_of(grid)
    if source.sparse:
        raise LeapRayError(f"{grid.name!r} holds leaves; an array of samples is needed")
    assert isinstance(grid.samples, np.ndarray)
    return grid.samples


def _numbers(grid: ScalarGrid, block: NDArray, dtype=np.float32) -> NDArray:
    """A block as floats; NaN where nothing is known."""
    with np.errstate(all="ignore"):
        out = block.astype(dtype)
    if grid.no_data is not None:
        out[block == grid.no_data] = np.nan
    return out


def _float_of(dtype: np.dtype) -> np.dtype:
    """Floats that hold all numbers of a type, or come closest."""
    return np.dtype(np.float32 if np.can_cast(dtype, np.float32) else np.float64)


def _slabs(
    fill: Callable[[int, int], None], n: int, threads: int, watch: Watch | None, what: str
) -> None:
    check_threads(threads)
    watch = watch or Watch()

    def part(first: int, last: int) -> None:
        if not watch.stopped:
            fill(first, last)

    run_parts(part, n, SLAB, threads, watch)
    if watch.stopped:
        raise Stopped(f"{what} was stopped")


# ---- fewer samples -----------------------------------------------------------------------------


def coarser(
    grid: ScalarGrid, factor: int = 2, *, threads: int = 0, watch: Watch | None = None
) -> ScalarGrid:
    """A field of fewer samples: the means of blocks of factor^3, which lie at their centres.

    grid: of an array (nz, ny, nx); the last blocks are of what is left, their samples lie where
    those of whole blocks would. NaN and no_data take no part; a block of nothing else is NaN, of
    whole numbers no_data. Whole numbers are rounded and keep their type. Of labels a block
    takes the one that its middle has. threads: 0 for all cores. Raises LeapRayError for a factor
    below 1 and for leaves, OutOfMemory, Stopped when watch was told to stop.
    """
    array = _array_of(grid)
    if factor != int(factor) or factor < 1:
        raise LeapRayError(f"the factor must be a whole number of at least 1; it is {factor}")
    factor = int(factor)
    middle = factor // 2 if grid.kind == "labels" else (factor - 1) / 2
    place = np.diag([factor, factor, factor, 1.0])
    place[:3, 3] = middle
    if grid.kind == "labels":
        last = [np.minimum(np.arange(0, n, factor) + factor // 2, n - 1) for n in array.shape]
        out = array[np.ix_(*last)]
    else:
        out = _means(grid, array, factor, threads, watch)
    return replace(grid, samples=out, world_from_index=grid.world_from_index @ place)


def _means(grid: ScalarGrid, array: NDArray, factor: int, threads: int, watch) -> NDArray:
    nz, ny, nx = (-(-n // factor) for n in array.shape)
    whole = array.dtype.kind in "iub"
    dtype = array.dtype if array.dtype.kind != "b" else np.dtype(np.float32)
    out = empty((nz, ny, nx), dtype.newbyteorder("="))
    none = 0 if grid.no_data is None else grid.no_data

    def fill(first: int, last: int) -> None:
        block = array[first * factor : last * factor]
        numbers = _numbers(grid, block, np.float64 if block.itemsize > 2 else np.float32)
        known = ~np.isnan(numbers)
        every = known.all()
        total = _sums(np.where(known, numbers, 0) if not every else numbers, factor)
        count = _sums(known.astype(np.float32), factor)
        with np.errstate(all="ignore"):
            mean = total / count
        if whole and array.dtype.kind != "b":
            mean = np.where(count > 0, np.rint(mean), none)
        out[first:last] = mean

    _slabs(fill, nz, threads, watch, "resampling")
    return out


def _sums(block: NDArray, factor: int) -> NDArray:
    """Of blocks of factor^3; those at the end may be smaller."""
    for axis in range(3):
        block = np.add.reduceat(block, np.arange(0, block.shape[axis], factor), axis=axis)
    return block


# ---- smoother ----------------------------------------------------------------------------------


def smooth(
    grid: ScalarGrid, sigma: float, *, threads: int = 0, watch: Watch | None = None
) -> ScalarGrid:
    """The field convolved by a Gaussian, in floats.

    grid: of an array (nz, ny, nx). sigma: its standard deviation in voxels, the kernel ends at
    four of them. Weights are those of the samples that are known, together 1: NaN, no_data
    and what lies beyond the border take no part, and stay NaN. Infinities count as the largest
    floats. threads: 0 for all cores. Raises LeapRayError for a sigma that is negative or not
    finite, for labels and leaves; OutOfMemory, Stopped when watch was told to stop.
    """
    array = _array_of(grid)
    if not (math.isfinite(sigma) and sigma >= 0.0):
        raise LeapRayError(f"sigma must be finite and 0 or more; it is {sigma}")
    if grid.kind == "labels":
        raise LeapRayError("labels are names and have no mean: they are not smoothed")
    reach = math.ceil(REACH * sigma)
    weights = np.exp(-0.5 * (np.arange(reach + 1) / max(sigma, 1e-9)) ** 2)
    weights /= weights[0] + 2 * weights[1:].sum()
    dtype = _float_of(array.dtype)
    out = empty(array.shape, dtype)
    most = np.finfo(dtype).max

    def fill(first: int, last: int) -> None:
        low = max(0, first - reach)
        numbers = _numbers(grid, array[low : last + reach], dtype)
        known = ~np.isnan(numbers)
        numbers = np.clip(np.where(known, numbers, 0), -most, most)
        own = slice(first - low, last - low)
        mean = _convolve(numbers, weights, own)
        share = _shares(known, weights, own)
        with np.errstate(all="ignore"):
            out[first:last] = np.where(known[own], mean / share, np.nan)

    _slabs(fill, len(array), threads, watch, "smoothing")
    return replace(grid, samples=out, no_data=None)


def _convolve(block: NDArray, weights: NDArray, own: slice) -> NDArray:
    """Along z, of which only the own slices are kept, y and x; beyond the block all is 0."""
    block = _along(block, weights, 0)[own]
    return _along(_along(block, weights, 1), weights, 2)


def _shares(known: NDArray[np.bool_], weights: NDArray, own: slice) -> NDArray:
    """The weights of what is known, together."""
    if not known.all():
        return _convolve(known.astype(np.float32), weights, own)
    lines = [_along(np.ones(n, np.float32), weights, 0) for n in known.shape]
    return lines[0][own, None, None] * lines[1][:, None] * lines[2]


def _along(block: NDArray, weights: NDArray, axis: int) -> NDArray:
    line = np.moveaxis(block, axis, 0)
    out = line * line.dtype.type(weights[0])
    for k, weight in enumerate(weights[1 : len(line)].astype(line.dtype), 1):
        out[k:] += weight * line[:-k]
        out[:-k] += weight * line[k:]
    return np.moveaxis(out, 0, axis)


# ---- without islands ---------------------------------------------------------------------------


def without_islands(
    grid: ScalarGrid,
    threshold: float,
    least: int,
    *,
    above: bool | None = None,
    watch: Watch | None = None,
) -> ScalarGrid:
    """The field without pieces of its solid that have fewer samples than `least`.

    grid: of an array (nz, ny, nx), which is copied. threshold, above: of the solid, as for
    `isosurface`. Samples that share a cell are of one piece. Those of small pieces become the
    number that lies outside by least, of those that there are. Raises LeapRayError for leaves,
    OutOfMemory, Stopped when watch was told to stop.
    """
    array = _array_of(grid)
    above = grid.kind != "level set" if above is None else above
    rising = above == (grid.scale > 0)
    inside = empty(array.shape, np.uint8)
    fill = -np.inf if rising else np.inf
    for first in range(0, len(array), SLAB):
        block = array[first : first + SLAB]
        with np.errstate(all="ignore"):
            value = grid.offset + grid.scale * _numbers(grid, block, np.float64)
            solid = value >= threshold if above else value <= threshold
            outer = block[~solid & ~np.isnan(value)]
        inside[first : first + SLAB] = solid
        if outer.size:
            fill = max(fill, outer.max()) if rising else min(fill, outer.min())
    if not np.isfinite(float(fill)):
        return grid  # nothing lies outside
    small = np.empty_like(inside)
    call(
        lib.lr_small_components,
        pointer(inside, ctypes.c_uint8),
        *array.shape[::-1],
        max(0, int(least)),
        pointer(small, ctypes.c_uint8),
        watch=watch,
    )
    samples = np.array(array)
    np.copyto(samples, np.asarray(fill).astype(samples.dtype), where=small.astype(bool))
    return replace(grid, samples=samples)
