# SPDX-License-Identifier: GPL-3.0-or-later
"""Numbers of scalar grids on their way into the core: slices of an array, or leaves."""

from __future__ import annotations

import ctypes
import math
import threading

import numpy as np
from numpy.typing import NDArray

from . import _abi
from ._lib import LeapRayError, Watch, call, lib
from .arrays import pointer
from .file_samples import FileSamples, Samples
from .scalar_grid import LEAF, Leaves, ScalarGrid
from .threads import run_steps

ALIGNED = 6  # samples of the lattice before the first leaf, so that leaves are bricks of the core
CHUNK = 2048  # leaves that a thread takes at a time
MOST_SIDE = 1 << 20  # samples along an axis

NUMBER_TYPES = {
    "u1": _abi.LR_NUMBER_U8,
    "i1": _abi.LR_NUMBER_I8,
    "u2": _abi.LR_NUMBER_U16,
    "i2": _abi.LR_NUMBER_I16,
    "u4": _abi.LR_NUMBER_U32,
    "i4": _abi.LR_NUMBER_I32,
    "f4": _abi.LR_NUMBER_F32,
    "f8": _abi.LR_NUMBER_F64,
}
AS_OTHERS = {"b": "u1", "f2": "f4"}  # exact; all others as f64, in which values are counted, too


class Source:
    """A lattice of numbers that the core reads twice.

    Attributes: size, samples per axis; object_from_index (4, 4); dtype, as the core is given
    numbers; number_type, its name there; whole: they are whole numbers; no_data; capped; sparse;
    background, of a sparse one, else 0.
    """

    sparse = False
    background = 0.0
    size: tuple[int, int, int]

    def __init__(self, grid: ScalarGrid, capped: bool, dtype: np.dtype) -> None:
        code = AS_OTHERS.get(dtype.kind, AS_OTHERS.get(dtype.str[1:], dtype.str[1:]))
        if dtype.kind not in "biuf":
            raise LeapRayError(f"samples of {grid.name!r} must be real numbers; they are {dtype}")
        self.dtype = np.dtype(code if code in NUMBER_TYPES else "f8")
        self.number_type = NUMBER_TYPES[self.dtype.str[1:]]
        self.whole = dtype.kind in "biu"
        self.no_data = None if grid.no_data is None else float(grid.no_data)
        self.capped = capped
        place = np.asarray(grid.world_from_index)
        if place.shape != (4, 4) or place.dtype.kind not in "biuf":
            raise LeapRayError(f"world_from_index of {grid.name!r} must be a 4x4 matrix")
        self.object_from_index = place.astype(np.float64)

    def _native(self, numbers: NDArray) -> NDArray:
        with np.errstate(all="ignore"):
            return np.ascontiguousarray(numbers, self.dtype)

    def forget(self) -> None:
        """Keep nothing to read."""

    def scan(self, handle, parts: list[tuple[int, int]], threads: int, watch: Watch) -> None:
        """Let the core look at the numbers; parts: first slice and number of slices of each."""
        raise NotImplementedError

    def fill(self, handle, parts: list[tuple[int, int]], threads: int, watch: Watch) -> None:
        """Let the core store them."""
        raise NotImplementedError

    def counts(self, first: int, n: int) -> NDArray[np.bool_]:
        """Which samples of n slices, from the first on, are numbers that count."""
        return np.ones((n, *self.size[1::-1]), bool)


class ArraySource(Source):
    """The numbers of an array (nz, ny, nx)."""

    def __init__(self, grid: ScalarGrid, capped: bool) -> None:
        array = grid.samples
        if not isinstance(array, np.ndarray | FileSamples) or array.ndim != 3 or array.size == 0:
            shape = getattr(array, "shape", type(array).__name__)
            raise LeapRayError(
                f"samples of {grid.name!r} must be an array (nz, ny, nx), none of them 0; "
                f"they are {shape}"
            )
        super().__init__(grid, capped, array.dtype)
        self.array: Samples | None = array
        self.size = (array.shape[2], array.shape[1], array.shape[0])

    def forget(self) -> None:
        self.array = None

    def _slices(self, first: int, n: int, room: NDArray | None = None) -> NDArray:
        """room: bytes that the numbers of a file may be read into."""
        array = self.array
        assert array is not None
        if isinstance(array, FileSamples):
            return self._native(array.slices(first, first + n, room))
        return self._native(array[first : first + n])

    def _each(self, function, handle, parts, threads: int, watch: Watch) -> None:
        rooms = threading.local()  # new memory for every part would take longer than to read it
        most = max(n for _, n in parts) * math.prod(self.size[:2]) * self.dtype.itemsize

        def part(step: int, index: int) -> None:
            if not hasattr(rooms, "bytes") and isinstance(self.array, FileSamples):
                rooms.bytes = np.empty(most, np.uint8)
            first, n = parts[index]
            block = self._slices(first, n, getattr(rooms, "bytes", None))
            where = ctypes.c_void_p(block.ctypes.data)
            call(function, handle, index, where, watch=watch)

        run_steps(part, [len(parts)], threads, watch)

    def scan(self, handle, parts, threads: int, watch: Watch) -> None:
        self._each(lib.lr_samples_scan, handle, parts, threads, watch)

    def fill(self, handle, parts, threads: int, watch: Watch) -> None:
        self._each(lib.lr_samples_fill, handle, parts, threads, watch)

    def counts(self, first: int, n: int) -> NDArray[np.bool_]:
        if self.array is None:
            return super().counts(first, n)
        block = self._slices(first, n)
        return (block == block) & (self.no_data is None or block != self.no_data)


class LeafSource(Source):
    """The numbers of leaves and tiles, on a lattice on which leaves are the core's bricks."""

    sparse = True

    def __init__(self, grid: ScalarGrid) -> None:
        leaves = grid.samples
        assert isinstance(leaves, Leaves)
        super().__init__(grid, True, leaves.samples.dtype)
        self.leaves: Leaves | None = leaves
        self.background = float(leaves.background)
        if not np.isfinite(self.background):
            raise LeapRayError(f"the background of {grid.name!r} is {self.background}")
        origins = np.concatenate([leaves.origins, leaves.tile_origins]).astype(np.int64)
        sides = np.concatenate([np.full(len(leaves.origins), LEAF), leaves.tile_sizes])
        _check(grid.name, leaves, origins, sides)
        first = origins.min(0) if len(origins) else np.zeros(3, np.int64)
        last = (origins + sides[:, None]).max(0) if len(origins) else first + 1
        size = last - first + ALIGNED
        if size.max() > MOST_SIDE:
            raise LeapRayError(f"{grid.name!r} spans {size} samples; {MOST_SIDE} are possible")
        self.size = (int(size[0]), int(size[1]), int(size[2]))
        self.first = first - ALIGNED
        shift = np.eye(4)
        shift[:3, 3] = self.first
        self.object_from_index = self.object_from_index @ shift

    def forget(self) -> None:
        self.leaves = None

    def _each(self, function, handle, threads: int, watch: Watch) -> None:
        leaves = self.leaves
        assert leaves is not None
        origins = np.ascontiguousarray(leaves.origins - self.first, np.int32)

        def part(step: int, index: int) -> None:
            chosen = slice(CHUNK * index, CHUNK * index + CHUNK)
            numbers = self._native(leaves.samples[chosen])
            places = pointer(origins[chosen], ctypes.c_int32)
            where = ctypes.c_void_p(numbers.ctypes.data)
            call(function, handle, places, where, len(numbers), watch=watch)

        run_steps(part, [-(-len(origins) // CHUNK)], threads, watch)

    def scan(self, handle, parts, threads: int, watch: Watch) -> None:
        self._each(lib.lr_samples_scan_leaves, handle, threads, watch)
        leaves = self.leaves
        assert leaves is not None
        origins = np.ascontiguousarray(leaves.tile_origins - self.first, np.int32)
        sizes = np.ascontiguousarray(leaves.tile_sizes, np.int32)
        values = np.ascontiguousarray(leaves.tile_values, np.float64)
        call(
            lib.lr_samples_put_tiles,
            handle,
            pointer(origins, ctypes.c_int32),
            pointer(sizes, ctypes.c_int32),
            pointer(values),
            len(values),
            watch=watch,
        )

    def fill(self, handle, parts, threads: int, watch: Watch) -> None:
        self._each(lib.lr_samples_fill_leaves, handle, threads, watch)


def _check(name: str, leaves: Leaves, origins: NDArray, sides: NDArray) -> None:
    """Raise LeapRayError for leaves and tiles off their places."""
    n, tiles = len(leaves.origins), len(leaves.tile_origins)
    right = (
        leaves.samples.shape == (n, LEAF, LEAF, LEAF)
        and len(leaves.tile_sizes) == tiles == len(leaves.tile_values)
        and not (origins % LEAF).any()
        and not (sides % LEAF).any()
        and sides.min(initial=LEAF) > 0
    )
    if not right or len(np.unique(leaves.origins, axis=0)) != n:
        raise LeapRayError(
            f"leaves of {name!r} must be {LEAF}^3 samples each, at multiples of {LEAF}, no two at "
            "one place, with as many tiles as sizes and values"
        )


def source_of(grid: ScalarGrid, capped: bool = True) -> Source:
    """The numbers of a grid. Raises LeapRayError for one that holds none."""
    if not isinstance(grid, ScalarGrid):
        raise LeapRayError(f"a leapray.ScalarGrid is needed, not a {type(grid).__name__}")
    return LeafSource(grid) if isinstance(grid.samples, Leaves) else ArraySource(grid, capped)
