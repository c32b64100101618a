# SPDX-License-Identifier: GPL-3.0-or-later
"""Volumes of labels: one solid of many regions, with the label of each sample as its id."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from ._lib import LeapRayError, OutOfMemory, Stopped, Watch
from .arrays import numbers as whole_numbers
from .file_samples import Samples
from .scalar_grid import Leaves, ScalarGrid
from .scalar_source import Source, source_of
from .volume import Volume, VolumeBuilder

SLAB = 32  # slices at a time, whole bricks
SMOOTHEST = 8.0  # voxels
BRICK = 8
MOST_AT_ONCE = 1 << 23  # samples
LEVEL = 128  # the least stored occupancy that lies inside
MOST = 65535  # ids have 16 bits
BIGGEST = 1 << 53  # of labels: above it floats are no whole numbers in a row
MOST_LOOKED_UP = 1 << 20  # labels up to here have their ids in a table
OWN, BESIDE = 1, 2  # marks of labels


def label_numbers(grid: ScalarGrid, *, watch: Watch | None = None) -> NDArray[np.int64]:
    """The labels that a grid has, (n,) ascending, without 0.

    grid: of an array (nz, ny, nx) of whole numbers from 0 on, no_data and NaN: none. Raises
    LeapRayError for numbers that are no labels and for leaves, Stopped when watch was told to stop.
    """
    _, array = _array_of(grid)
    found: NDArray[np.int64] = np.empty(0, np.int64)
    slab = _slab(array)
    for first in range(0, len(array), slab):
        _check_stopped(watch)
        found = np.union1d(found, _values(grid, array[first : first + slab]))
    return found[found > 0]


def labels(
    grid: ScalarGrid,
    *,
    numbers: Sequence[int] | NDArray | None = None,
    of: Sequence[int] | NDArray | None = None,
    over: Sequence[int] | NDArray = (),
    smoothing: float = 0.0,
    watch: Watch | None = None,
    max_nbytes: int | None = None,
) -> Volume:
    """The solid of the samples that have a label, whose ids are the labels.

    grid: as for `label_numbers`. Occupancy is that of the labels together, averaged over the 27
    samples around by 1-2-1 along each axis, so that surfaces do not show the voxels; but samples
    with a label stay inside, all others outside, so that no region is lost. Where labels touch
    there is no surface and hence no gap between them; a hit takes the label of the nearest
    sample inside.
    numbers: (n,) ascending, labels up to 2^53, whose places are the ids in place of the labels,
    which else are 0..65535. of: ids (n,) of the labels that make the solid; None: all. over:
    ids (n,) of labels beside them into which it reaches by a third of a voxel, so that the
    solid of those overlaps it: surfaces of two solids never lie upon each other, and nothing lies
    between them but, where three meet, a thread thinner than a voxel. smoothing: the standard
    deviation in voxels of what averages, where that is above the 0.7 of one 1-2-1: as many of
    them as make it, up to 8 voxels. max_nbytes: of samples and ids.
    Raises LeapRayError for numbers that are no labels, for more than ids can hold, for leaves and
    another smoothing;
    OutOfMemory beyond max_nbytes, Stopped when watch was told to stop.
    """
    source, array = _array_of(grid)
    if not 0.0 <= smoothing <= SMOOTHEST:
        raise LeapRayError(f"smoothing must be 0..{SMOOTHEST:g} voxels; it is {smoothing}")
    passes = max(1, round(2 * smoothing**2))  # each has a variance of 1/2
    shown = _Shown(grid, numbers, of, over, passes)
    lo, hi = (0, 0, 0), array.shape
    if of is not None:
        lo, hi = _box_of(shown, array, watch)
    shift = np.eye(4)
    shift[:3, 3] = lo[::-1]
    size = tuple(np.subtract(hi, lo)[::-1].tolist())
    level = (LEVEL - 0.5) / 255
    builder = VolumeBuilder(size, "u8", level, source.object_from_index @ shift, has_ids=True)
    nbytes, slab = 0, max(_slab(array), -(-passes // BRICK) * BRICK)
    for first in range(0, hi[0] - lo[0], slab):
        low, last = max(0, first - passes), min(first + slab, hi[0] - lo[0])
        block = array[lo[0] + low : min(lo[0] + last + passes, hi[0])]
        block = block[:, lo[1] : hi[1], lo[2] : hi[2]]
        for y, occupancy, ids in _bands(shown, block, slice(first - low, last - low)):
            _check_stopped(watch)
            nbytes += _nbytes(occupancy)
            if max_nbytes is not None and nbytes > max_nbytes:
                error = OutOfMemory(f"the labels need more than {max_nbytes / 1e6:.0f} MB")
                error.nbytes = nbytes
                raise error
            builder.put((0, y, first), occupancy, ids)
    return builder.finish()


def _slab(array: Samples) -> int:
    """Slices that are taken at a time."""
    return SLAB if SLAB * math.prod(array.shape[1:]) <= MOST_AT_ONCE else BRICK


def _bands(
    shown: _Shown, block: NDArray, own: slice
) -> Iterator[tuple[int, NDArray[np.uint8], NDArray[np.uint16]]]:
    """The first row, occupancies and ids of the own slices of a block, some rows at a time, for
    they take many times the memory of labels."""
    (nz, ny, nx), reach = block.shape, shown.passes
    rows = max(MOST_AT_ONCE // 8 // (nz * nx) // BRICK, -(-reach // BRICK)) * BRICK
    for first in range(0, ny, rows):
        low, last = max(0, first - reach), min(first + rows, ny)
        occupancy, ids = shown.samples(block[:, low : last + reach])
        rows_of_own = own, slice(first - low, last - low)
        yield first, occupancy[rows_of_own], ids[rows_of_own]


class _Shown:
    """Which labels make a solid, and what ids they have."""

    def __init__(self, grid: ScalarGrid, numbers, of, over, passes: int) -> None:
        self.grid, self.listed, self.passes = grid, numbers is not None, passes
        given = np.asarray(numbers if self.listed else range(MOST + 1), np.int64)
        if given.ndim != 1 or (np.diff(given, prepend=0 if self.listed else -1) <= 0).any():
            raise LeapRayError("numbers of labels must be a list that ascends from 1 on")
        if len(given) > MOST + 1:
            raise LeapRayError(f"{grid.name!r} has {len(given)} labels; ids hold {MOST + 1}")
        self.numbers = given
        self.marks = _marked(len(given), over) * BESIDE
        self.marks[_marked(len(given), of).astype(bool)] = OWN
        self.marks[given == 0] = 0
        self._id_of = None
        if len(given) and given[-1] < MOST_LOOKED_UP:
            self._id_of = np.zeros(given[-1] + 2, np.uint16)
            self._id_of[given] = np.arange(len(given))
            self._mark_of = np.zeros(given[-1] + 2, np.uint8)
            self._mark_of[given] = self.marks

    def told(self, block: NDArray) -> tuple[NDArray[np.uint16], NDArray[np.uint8]]:
        """The ids of samples, and their marks: OWN, BESIDE or 0."""
        values = _labels_of(self.grid, block)
        if not self.listed and values.max(initial=0) > MOST:
            raise LeapRayError(
                f"labels must be whole numbers in 0..{MOST} where their numbers are not listed; "
                f"{self.grid.name!r} has {values.max()}"
            )
        if self._id_of is not None:
            last = len(self._id_of) - 1  # of all that are larger
            at = values.astype(np.uint8) if values.dtype.kind == "b" else values
            at = at if np.iinfo(at.dtype).max <= last else np.minimum(at, last)
            return self._id_of[at], self._mark_of[at]
        if not len(self.numbers):
            return np.zeros(block.shape, np.uint16), np.zeros(block.shape, np.uint8)
        ids = np.minimum(np.searchsorted(self.numbers, values), len(self.numbers) - 1)
        marks = np.where(self.numbers[ids] == values, self.marks[ids], 0)
        return ids.astype(np.uint16), marks.astype(np.uint8)

    def samples(self, block: NDArray) -> tuple[NDArray[np.uint8], NDArray[np.uint16]]:
        """Occupancy, of which 128 and more lie inside, and ids; beyond the block all is 0."""
        ids, marks = self.told(block)
        solid, other = marks == OWN, marks == BESIDE
        occupancy = 4 * _blurred(solid, self.passes)  # of 64 parts
        if other.any():
            occupancy += _blurred(other, self.passes)  # a quarter of what the others have
            ids = np.where(solid, ids, _greatest(np.where(solid, ids, 0)))
        most = np.where(solid | other, 255, LEVEL - 1).astype(np.uint8)
        made = np.clip(occupancy, np.where(solid, LEVEL, 0), most).astype(np.uint8)
        return made, np.where(made >= LEVEL, ids, 0)


def _marked(n: int, ids) -> NDArray[np.uint8]:
    """(n,): 1 of the ids in a list; None: of all."""
    if ids is None:
        return np.ones(n, np.uint8)
    marks = np.zeros(n, np.uint8)
    which = whole_numbers(ids, np.uint16, "ids of labels") if len(ids) else np.empty(0, np.uint16)
    if which.max(initial=0) >= max(n, 1):
        raise LeapRayError(f"ids of labels must be below {n}; one is {which.max()}")
    marks[which] = 1
    return marks


def _box_of(shown: _Shown, array: Samples, watch: Watch | None) -> tuple[tuple, tuple]:
    """The first sample and the end of a box round the solid, with what matters beside it."""
    used = [np.zeros(n, bool) for n in array.shape]
    slab = _slab(array)
    for first in range(0, len(array), slab):
        _check_stopped(watch)
        solid = shown.told(array[first : first + slab])[1] == OWN
        flat = solid.any(axis=0)
        used[0][first : first + slab] = solid.any(axis=(1, 2))
        used[1] |= flat.any(axis=1)
        used[2] |= flat.any(axis=0)
    if not used[0].any():
        return (0, 0, 0), (1, 1, 1)
    reach = shown.passes + 1
    ends = [np.flatnonzero(each)[[0, -1]] for each in used]
    lo = tuple(max(int(first) - reach, 0) for first, _ in ends)
    hi = tuple(
        min(int(last) + 1 + reach, n) for (_, last), n in zip(ends, array.shape, strict=True)
    )
    return lo, hi


def _array_of(grid: ScalarGrid) -> tuple[Source, Samples]:
    source = source_of(grid)
    if isinstance(grid.samples, Leaves):
        raise LeapRayError(f"labels of {grid.name!r} must be an array, not leaves")
    return source, grid.samples


def _labels_of(grid: ScalarGrid, block: NDArray) -> NDArray:
    """The labels of samples as whole numbers; 0 of those that have none. Raises LeapRayError for
    other numbers."""
    with np.errstate(all="ignore"):
        values = block
        if (grid.scale, grid.offset) != (1.0, 0.0):
            values = grid.offset + grid.scale * block
        if grid.no_data is not None:
            values = np.where(block == grid.no_data, 0, values)
        if values.dtype.kind == "f":
            values = np.where(np.isnan(values), 0, values)
        wrong = None
        if not (values.min(initial=0) >= 0 and values.max(initial=0) <= BIGGEST):
            wrong = values[~((values >= 0) & (values <= BIGGEST))][0]
        elif values.dtype.kind == "f" and (values != np.floor(values)).any():
            wrong = values[values != np.floor(values)][0]
    if wrong is not None:
        raise LeapRayError(
            f"labels must be whole numbers in 0..2^53; {grid.name!r} has {wrong:.17g}"
        )
    return values if values.dtype.kind in "iu" else values.astype(np.int64)


def _values(grid: ScalarGrid, block: NDArray) -> NDArray[np.int64]:
    """The labels of a block, each once."""
    if block.dtype.kind == "u" and block.dtype.itemsize <= 2:
        stored = np.flatnonzero(np.bincount(block.ravel())).astype(block.dtype)
    else:
        stored = np.unique(block)
    return np.unique(_labels_of(grid, stored)).astype(np.int64)


def _blurred(solid: NDArray[np.bool_], passes: int) -> NDArray:
    """In 64 parts, by 1-2-1 along each axis, so many times; beyond the block all is 0."""
    total: NDArray = _averaged(solid.astype(np.uint8), 1).astype(np.uint16)
    if passes > 1:
        total = total.astype(np.float32)
    for _ in range(passes - 1):
        total = _averaged(total, np.float32(0.25))
    return total


def _averaged(total: NDArray, unit) -> NDArray:
    """1-2-1 of units along each axis."""
    for axis in range(3):
        line = np.moveaxis(total, axis, 0)
        out = 2 * unit * line
        out[1:] += unit * line[:-1]
        out[:-1] += unit * line[1:]
        total = np.moveaxis(out, 0, axis)
    return total


def _greatest(ids: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """The greatest of the 27 around."""
    for axis in range(3):
        line = np.moveaxis(ids, axis, 0)
        out = line.copy()
        np.maximum(out[1:], line[:-1], out=out[1:])
        np.maximum(out[:-1], line[1:], out=out[:-1])
        ids = np.moveaxis(out, 0, axis)
    return ids


def _nbytes(occupancy: NDArray[np.uint8]) -> int:
    """Of the bricks that samples and ids of a slab take, those that hold nothing left out."""
    some: NDArray = occupancy
    for axis in range(3):
        some = np.maximum.reduceat(some, np.arange(0, some.shape[axis], BRICK), axis=axis)
    return int(np.count_nonzero(some)) * BRICK**3 * 3


def _check_stopped(watch: Watch | None) -> None:
    if watch is not None and watch.stopped:
        raise Stopped("the making of labels was stopped")
