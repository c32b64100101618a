# SPDX-License-Identifier: GPL-3.0-or-later
"""Scalar grids made of scalar grids: coarser, smoother, without small islands."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from . import leaf_filters
from ._lib import LeapRayError, Stopped, Watch, call, lib
from .arrays import empty, pointer
from .file_samples import Samples, Spool
from .scalar_grid import Leaves, ScalarGrid
from .scalar_source import source_of
from .threads import check_threads, run_parts

SLAB = 8  # slices that a thread takes at a time
STACK = 16  # slices that are summed at a time: more take more memory, fewer read more often
BLOCK = 1 << 22  # samples that are added up at a time
REACH = 4.0  # sigmas, beyond which a Gaussian is 0.0001 of its peak at most


def _array_of(grid: ScalarGrid) -> Samples:
    """The samples of a dense grid. Raises LeapRayError for others."""
    source = source_of(grid)
    if source.sparse:
        raise LeapRayError(f"{grid.name!r} holds leaves; an array of samples is needed")
    assert not isinstance(grid.samples, Leaves)
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
    fill: Callable[[int, int], None],
    n: int,
    rows: int,
    threads: int,
    watch: Watch | None,
    what: str,
) -> None:
    """fill(first, last) of some rows at a time, side by side."""
    check_threads(threads)
    watch = watch or Watch()

    def part(first: int, last: int) -> None:
        if not watch.stopped:
            fill(first, last)

    run_parts(part, n, rows, threads, watch)
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
    takes the one that its middle has. Leaves, too, for factors that are powers of two, unless
    they are of labels; their means are floats. threads: 0 for all cores. Raises LeapRayError for
    other factors, OutOfMemory, Stopped when watch was told to stop.
    """
    if factor != int(factor) or factor < 1:
        raise LeapRayError(f"the factor must be a whole number of at least 1; it is {factor}")
    factor = int(factor)
    if isinstance(grid.samples, Leaves):
        return _coarser_leaves(grid, grid.samples, factor, watch or Watch())
    array = _array_of(grid)
    middle = factor // 2 if grid.kind == "labels" else (factor - 1) / 2
    place = np.diag([factor, factor, factor, 1.0])
    place[:3, 3] = middle
    size = [-(-n // factor) for n in array.shape]
    out = Spool(size, array.dtype if array.dtype.kind != "b" else np.dtype(np.float32))
    of_labels = grid.kind == "labels"

    def fill(first: int, last: int) -> None:
        for k in range(first, last):
            row = _middles(array, factor, k) if of_labels else _means(grid, array, factor, k)
            out[k : k + 1] = row

    _slabs(fill, size[0], max(SLAB // factor, 1), threads, watch, "resampling")
    return replace(grid, samples=out.samples(), world_from_index=grid.world_from_index @ place)


def _coarser_leaves(grid: ScalarGrid, leaves: Leaves, factor: int, watch: Watch) -> ScalarGrid:
    source_of(grid)
    if factor & (factor - 1):
        raise LeapRayError(f"leaves become coarser by powers of two, not by {factor}")
    _refuse_labels(grid)
    dtype = _float_of(leaves.samples.dtype)
    place = np.diag([factor, factor, factor, 1.0])
    place[:3, 3] = (factor - 1) / 2
    while factor > 1:
        leaves = leaf_filters.halved(leaves, partial(_numbers, grid, dtype=dtype), dtype, watch)
        factor //= 2
    return replace(grid, samples=leaves, world_from_index=grid.world_from_index @ place)


def _refuse_labels(grid: ScalarGrid) -> None:
    if grid.kind == "labels":
        raise LeapRayError("labels are names and have no mean: they are not averaged")


def _middles(array: Samples, factor: int, k: int) -> NDArray:
    """The samples in the middles of blocks, of row k of blocks."""
    z, y, x = (np.minimum(np.arange(0, n, factor) + factor // 2, n - 1) for n in array.shape)
    return array[int(z[k])][np.ix_(y, x)]


def _means(grid: ScalarGrid, array: Samples, factor: int, k: int) -> NDArray:
    """The means of row k of blocks, of which a few slices are taken at a time."""
    whole = array.dtype.kind in "iub"
    all_known = whole and grid.no_data is None
    largest = factor**2 << 8 * array.dtype.itemsize
    exact = np.dtype(np.int32 if all_known and largest < 1 << 31 else np.float64)
    plane = array.shape[1:]
    total: NDArray = np.zeros(plane, exact)
    count: NDArray = np.zeros(plane, np.int32)
    rows = max(BLOCK // math.prod(plane), 1)
    end = min((k + 1) * factor, len(array))
    for first in range(k * factor, end, rows):
        block = array[first : min(first + rows, end)]
        if all_known:
            total += block.sum(axis=0, dtype=exact)
            count += len(block)
            continue
        numbers = _numbers(grid, block, np.float64 if block.itemsize > 2 else np.float32)
        known = ~np.isnan(numbers)
        total += np.where(known, numbers, 0).sum(axis=0, dtype=np.float64)
        count += known.sum(axis=0)
    with np.errstate(all="ignore"):
        mean = _sums(total, factor) / _sums(count, factor)
    if whole and array.dtype.kind != "b":
        none = 0 if grid.no_data is None else grid.no_data
        mean = np.where(np.isnan(mean), none, np.rint(mean))
    return mean


def _sums(plane: NDArray, factor: int) -> NDArray[np.float64]:
    """Of squares of factor^2; those at the end may be smaller."""
    ny, nx = (-(-n // factor) for n in plane.shape)
    padded = np.zeros((ny * factor, nx * factor), plane.dtype)
    padded[: plane.shape[0], : plane.shape[1]] = plane
    lines = padded.reshape(ny, factor, nx * factor).sum(axis=1, dtype=plane.dtype)
    total = np.zeros((ny, nx))
    for x in range(factor):
        total += lines[:, x::factor]
    return total


# ---- smoother ----------------------------------------------------------------------------------


def smooth(
    grid: ScalarGrid, sigma: float, *, threads: int = 0, watch: Watch | None = None
) -> ScalarGrid:
    """The field convolved by a Gaussian, in floats.

    grid: of an array (nz, ny, nx). sigma: its standard deviation in voxels, the kernel ends at
    four of them. Weights are those of the samples that are known, together 1: NaN, no_data
    and what lies beyond the border take no part, and stay NaN. Infinities count as the largest
    floats. Leaves, too, beyond which lies the background, which takes part. threads: 0 for all
    cores. Raises LeapRayError for a sigma that is negative or not finite, for labels, and for more
    than two million leaves; OutOfMemory, Stopped when watch was told to stop.
    """
    if not (math.isfinite(sigma) and sigma >= 0.0):
        raise LeapRayError(f"sigma must be finite and 0 or more; it is {sigma}")
    _refuse_labels(grid)
    if isinstance(grid.samples, Leaves):
        return _smooth_leaves(grid, grid.samples, sigma, threads, watch or Watch())
    array = _array_of(grid)
    dtype = _float_of(array.dtype)
    flat = _Flat(grid, array, dtype, _weights(sigma))
    out = Spool(array.shape, dtype)
    _slabs(flat.fill, len(array), 1, threads, watch, "smoothing")
    _slabs(partial(flat.stack, out), len(array), STACK, threads, watch, "smoothing")
    return replace(grid, samples=out.samples(), no_data=None)


def _smooth_leaves(
    grid: ScalarGrid, leaves: Leaves, sigma: float, threads: int, watch: Watch
) -> ScalarGrid:
    source_of(grid)
    check_threads(threads)
    dtype = _float_of(leaves.samples.dtype)
    numbers = partial(_numbers, grid, dtype=dtype)
    made = leaf_filters.smoothed(leaves, numbers, dtype, _weights(sigma), _along, threads, watch)
    return replace(grid, samples=made, no_data=None)


def _weights(sigma: float) -> NDArray[np.float64]:
    """Of samples 0, 1 ... away; together, those on either side, 1."""
    reach = math.ceil(REACH * sigma)
    weights = np.exp(-0.5 * (np.arange(reach + 1) / max(sigma, 1e-9)) ** 2)
    return weights / (weights[0] + 2 * weights[1:].sum())


class _Flat:
    """Slices that are convolved along x and y, then together along z.

    Beside the sums go the weights of what is known, together; where all is, they are products.
    """

    def __init__(self, grid: ScalarGrid, array: Samples, dtype: np.dtype, weights: NDArray) -> None:
        self.grid, self.array, self.dtype, self.weights = grid, array, dtype, weights
        self.all_known = array.dtype.kind in "iub" and grid.no_data is None
        self.sums = Spool(array.shape, dtype)
        self.shares = None if self.all_known else Spool(array.shape, np.dtype(np.float32))
        self.most = np.finfo(dtype).max

    def _slice(self, k: int) -> tuple[NDArray, NDArray[np.bool_] | None]:
        """The numbers of a slice, 0 where they are not known, and where they are."""
        numbers = _numbers(self.grid, self.array[k], self.dtype)
        if self.all_known:
            return numbers, None
        known = ~np.isnan(numbers)
        return np.clip(np.where(known, numbers, 0), -self.most, self.most), known

    def fill(self, first: int, last: int) -> None:
        for k in range(first, last):
            numbers, known = self._slice(k)
            self.sums[k : k + 1] = self._plane(numbers)
            if self.shares is not None and known is not None:
                self.shares[k : k + 1] = self._plane(known.astype(np.float32))

    def _plane(self, plane: NDArray) -> NDArray:
        return _along(_along(plane, self.weights, 0), self.weights, 1)

    def stack(self, out: Spool, first: int, last: int) -> None:
        with np.errstate(all="ignore"):
            mean = self._stacked(self.sums, first, last)
            if self.shares is None:
                ones = [_along(np.ones(n, np.float32), self.weights, 0) for n in self.array.shape]
                mean /= ones[0][first:last, None, None] * ones[1][:, None] * ones[2]
            else:
                mean /= self._stacked(self.shares, first, last)
        for k in range(first, last):
            known = self._slice(k)[1]
            if known is not None:
                mean[k - first][~known] = np.nan
        out[first:last] = mean

    def _stacked(self, spool: Spool, first: int, last: int) -> NDArray:
        """The sums along z of slices first..last - 1; each slice in reach is read once."""
        samples, reach = spool.samples(), len(self.weights) - 1
        total = np.zeros((last - first, *spool.shape[1:]), spool.dtype)
        for k in range(max(first - reach, 0), min(last + reach, spool.shape[0])):
            plane = samples[k]
            for row in range(max(first, k - reach), min(last, k + reach + 1)):
                total[row - first] += spool.dtype.type(self.weights[abs(row - k)]) * plane
        return total


def _along(block: NDArray, weights: NDArray, axis: int) -> NDArray:
    """Convolved along an axis; beyond the block all is 0."""
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
    samples = Spool(array.shape, array.dtype)
    outer = np.asarray(fill).astype(array.dtype)
    for first in range(0, len(array), SLAB):
        rows = slice(first, min(first + SLAB, len(array)))
        samples[rows] = np.where(small[rows], outer, array[rows])
    return replace(grid, samples=samples.samples())
