# SPDX-License-Identifier: GPL-3.0-or-later
"""Isosurfaces: volumes of the samples of a scalar field, which several thresholds share."""

from __future__ import annotations

import ctypes
import struct
import weakref
from collections.abc import Callable

import numpy as np

from . import _abi
from ._lib import LeapRayError, Watch, call, check, lib
from .arrays import DTYPES, INTERPOLATIONS, ONES, SAMPLE_TYPES, choice, matrix
from .scalar_grid import ScalarGrid
from .scalar_source import Source, source_of
from .threads import check_threads, run_steps
from .volume import BRICK, Volume, VolumeBuilder, set_planes

FLOAT_WHOLES = 1 << 24  # whole numbers in a row that a float holds
FLOAT_MOST = float(np.finfo(np.float32).max)
TYPES = {int(number): name for name, number in SAMPLE_TYPES.items()}
LEAST_SCALE = 2.0**-60  # numbers no larger are stored as multiples of a power of two


def isosurface(
    grid: ScalarGrid,
    threshold: float,
    *,
    above: bool | None = None,
    capped: bool = True,
    interpolation: str = "linear",
    threads: int = 0,
    watch: Watch | None = None,
    max_nbytes: int | None = None,
) -> Volume:
    """The solid where a field's values are at or above a threshold, in the field's own unit.

    grid, above, capped, interpolation, threads, watch, max_nbytes and what is raised: as for
    `Isosurfaces`, threshold: as for its `at`.
    """
    made = Isosurfaces(
        grid,
        above=above,
        capped=capped,
        interpolation=interpolation,
        threads=threads,
        watch=watch,
        max_nbytes=max_nbytes,
    )
    return made.at(threshold, threads=threads, watch=watch)


class Isosurfaces:
    """Volumes of one field at any thresholds, which share its samples.

    grid: every sample counts as inside or outside by its value offset + scale * stored, in f64;
    NaN and no_data lie outside, infinities count as the largest floats. above: the solid is
    where values are at or above the threshold, else where they are at or below; None: below for
    level sets. capped: the solid ends at the data's border by a cap, as if samples beyond were the
    farthest outside; else the surface ends there, open: a sheet, which has no inside, and whose
    normals see the border's samples repeated; leaves have no border. interpolation: "linear" or
    "cubic", as for `Volume`. Whole numbers are kept exactly
    in u8 or u16 where their range fits, others in f32; where f32 rounds them, every threshold reads
    the grid anew. threads: 0 for all cores. max_nbytes: of samples and cells.
    Raises LeapRayError for grids that hold no real numbers, OutOfMemory beyond max_nbytes
    before anything is stored, Stopped when watch was told to stop.
    Attributes: low and high, the least and the largest value; scale and offset: the value is
    offset + scale * occupancy in each of its volumes; nbytes: of the samples that its volumes
    share, which are part of the nbytes of each; 0 where each has its own.
    """

    def __init__(
        self,
        grid: ScalarGrid,
        *,
        above: bool | None = None,
        capped: bool = True,
        interpolation: str = "linear",
        threads: int = 0,
        watch: Watch | None = None,
        max_nbytes: int | None = None,
    ) -> None:
        check_threads(threads)
        watch = watch or Watch()
        source = source_of(grid, capped)
        self._interpolation = interpolation
        samples = StoredSamples(source, interpolation, threads, watch)
        self._max_nbytes = max_nbytes
        self._law = _Law(grid, grid.kind != "level set" if above is None else above)
        self._range = (samples.low, samples.high)[:: 1 if self._law.rising else -1]
        self._empty = samples.low > samples.high
        self._map, self._lossless = _map_of(source, samples, self._law)
        self.low, self.high = sorted(map(self._law.value, self._range))
        per_number = self._law.scale / self._map.gain
        self.scale = per_number * ONES[TYPES[self._map.sample_type]]
        self.offset = self._law.offset + per_number * self._map.base
        self._source = source
        self._samples, self.nbytes = None, 0
        if self._lossless and not self._empty:
            samples.store(source, self._map, max_nbytes, threads, watch)
            self._samples, self.nbytes = samples, samples.nbytes
            if not samples.has_none:
                source.forget()

    def at(self, threshold: float, *, threads: int = 0, watch: Watch | None = None) -> Volume:
        """The volume at a threshold, in the unit of the grid's values.

        Volumes of one threshold are the same to the bit, whichever came before. threads
        and watch: as for the class. Raises LeapRayError for a threshold that is not finite, and for
        one at which the background of a sparse grid lies inside; OutOfMemory, Stopped.
        """
        check_threads(threads)
        watch = watch or Watch()
        if not np.isfinite(threshold):
            raise LeapRayError(f"a threshold must be finite; it is {threshold}")
        inside = self._law.inside(threshold)
        first, last = self._range
        if self._empty or not inside(last):
            return self._constant(False, watch)
        if inside(first):
            return self._constant(True, watch)
        number, level = self._level(inside, self._law.number(threshold))
        if self._samples is not None:
            return self._samples.surface(level, threads, watch)
        self._map.threshold = number
        samples = StoredSamples(self._source, self._interpolation, threads, watch)
        samples.store(self._source, self._map, self._max_nbytes, threads, watch)
        return samples.surface(float(np.float32(level)), threads, watch)

    def _level(self, inside: Callable[[float], bool], number: float) -> tuple[float, float]:
        """The threshold as a number and as samples are stored: as given, unless that parts the
        numbers otherwise, or rounding does."""
        outer, inner = _neighbours(inside, self._range, self._source)
        sign = np.copysign(1.0, self._map.gain)
        if not sign * outer < sign * number <= sign * inner:
            number = inner
        low, high, level = (self._map.gain * n - self._map.base for n in (outer, inner, number))
        return number, level if low < level <= high else high

    def _constant(self, inside: bool, watch: Watch) -> Volume:
        """Of samples that are all outside, or all inside but for those that are none."""
        source = self._source
        if inside and source.sparse:
            raise LeapRayError("the background lies inside: the solid would fill all of space")
        builder = VolumeBuilder(
            source.size,
            "u8",
            0.5,
            source.object_from_index,
            sheet=not source.capped,
            interpolation=self._interpolation,
        )
        if inside and source.capped:
            for first in range(0, source.size[2], 8):
                n = min(8, source.size[2] - first)
                builder.put((0, 0, first), 255 * source.counts(first, n).astype(np.uint8))
        return builder.finish()


class _Law:
    """What stored numbers mean, and where they lie inside."""

    def __init__(self, grid: ScalarGrid, above: bool) -> None:
        self.scale, self.offset, self.above = float(grid.scale), float(grid.offset), above
        if not (np.isfinite([self.scale, self.offset]).all() and self.scale != 0.0):
            raise LeapRayError(
                f"scale and offset of {grid.name!r} must be finite, scale not 0; "
                f"they are {grid.scale} and {grid.offset}"
            )
        self.rising = above == (self.scale > 0)  # larger numbers lie inside

    def value(self, number: float) -> float:
        with np.errstate(all="ignore"):
            return float(self.offset + self.scale * np.float64(number))

    def number(self, value: float) -> float:
        with np.errstate(all="ignore"):
            return float((np.float64(value) - self.offset) / self.scale)

    def inside(self, threshold: float) -> Callable[[float], bool]:
        if self.above:
            return lambda number: self.value(number) >= threshold
        return lambda number: self.value(number) <= threshold


def _neighbours(
    inside: Callable[[float], bool], ends: tuple[float, ...], source: Source
) -> tuple[float, float]:
    """The last number that lies outside and the next, of those between the ends."""
    key, of_key = _ordinals(source)
    outer, inner = map(key, ends)
    while abs(inner - outer) > 1:
        middle = (outer + inner) // 2
        if inside(of_key(middle)):
            inner = middle
        else:
            outer = middle
    return of_key(outer), of_key(inner)


def _ordinals(source: Source):
    """Numbers that the source can hold by their rank, and back."""
    if source.whole:
        return int, float
    number, rank = ("f", "i") if source.dtype == np.float32 else ("d", "q")

    def key(value: float) -> int:
        bits = struct.unpack(rank, struct.pack(number, value))[0]
        return bits if bits >= 0 else -(bits & (0x7FFFFFFF if rank == "i" else (1 << 63) - 1))

    def of_key(bits: int) -> float:
        value = struct.unpack(number, struct.pack(rank, abs(bits)))[0]
        return value if bits >= 0 else -value

    return key, of_key


def _map_of(source: Source, samples: StoredSamples, law: _Law) -> tuple[_abi.lr_samples_map, bool]:
    """How numbers are stored, and whether that is exact."""
    gain = 1.0 if law.rising else -1.0
    ends = sorted((gain * samples.low, gain * samples.high))
    outside, inside = gain * ends[0], gain * ends[1]
    made = _abi.lr_samples_map(gain=gain, outside=outside, inside=inside)
    small = "u1" if source.dtype.itemsize == 1 else "u2"
    kept = gain > 0 and source.dtype.str[1:] in ("u1", "u2")
    base = 0.0 if kept else ends[0]
    most = np.iinfo(small).max
    none_below = not source.sparse or source.background == outside
    if source.whole and none_below and ends[1] - base <= most:
        made.sample_type = _abi.LR_U8 if small == "u1" else _abi.LR_U16
        made.base = base
        return made, True
    made.sample_type = _abi.LR_F32
    if source.sparse:
        made.outside = source.background
    if source.whole and ends[1] - ends[0] < FLOAT_WHOLES:
        made.base = base
        return made, True
    if not source.whole and samples.fits_floats:
        return made, True
    largest = max(abs(ends[0]), abs(ends[1]))
    if not LEAST_SCALE < largest < FLOAT_MOST and not samples.infinite:
        made.gain = gain * 2.0 ** -float(np.clip(np.frexp(largest)[1], -1000, 1000))
    made.rounded = 1
    return made, False


class StoredSamples:
    """The core's samples of a source: looked at when made, then stored.

    Attributes: handle, the core's; size, samples per axis; low and high of the numbers, low above
    high where there is none; has_none, infinite, fits_floats: what was found; nbytes, once stored.
    """

    def __init__(self, source: Source, interpolation: str, threads: int, watch: Watch) -> None:
        self.handle = ctypes.POINTER(_abi.lr_samples)()
        none = source.no_data
        desc = _abi.lr_samples_desc(
            *source.size,
            number_type=source.number_type,
            open=not source.capped,
            has_no_data=none is not None,
            interpolation=choice(INTERPOLATIONS, interpolation, "interpolation"),
            no_data=0.0 if none is None else none,
            object_from_index=matrix(source.object_from_index, "world_from_index"),
        )
        error = _abi.lr_error()
        check(
            lib.lr_samples_begin(
                ctypes.byref(desc), ctypes.byref(self.handle), ctypes.byref(error)
            ),
            error,
        )
        weakref.finalize(self, lib.lr_samples_free, self.handle)
        self.size = source.size
        source.scan(self.handle, self._parts(), threads, watch)
        found = _abi.lr_samples_range()
        lib.lr_samples_get_range(self.handle, ctypes.byref(found))
        self.infinite = max(-found.low, found.high) == np.inf
        most = FLOAT_MOST
        if source.dtype != np.float32 and not self.infinite:
            most = float(np.finfo(np.float64).max)
        self.low, self.high = max(found.low, -most), min(found.high, most)
        if source.sparse:
            self.low, self.high = (
                min(self.low, source.background),
                max(self.high, source.background),
            )
        elif found.low > found.high:
            self.low, self.high = np.inf, -np.inf
        self.has_none, self.fits_floats = bool(found.has_none), bool(found.fits_floats)

    def _parts(self) -> list[tuple[int, int]]:
        """First slice and number of slices of every part."""
        words = [ctypes.c_int32() for _ in range(3)]
        found: list[tuple[int, int]] = []
        count, error = 1, _abi.lr_error()
        while len(found) < count:
            outputs = [ctypes.byref(word) for word in words]
            status = lib.lr_samples_part(self.handle, len(found), *outputs, ctypes.byref(error))
            check(status, error)
            count = words[0].value
            found.append((words[1].value, words[2].value))
        self._n_parts = count
        return found

    def store(self, source: Source, as_map, max_nbytes, threads: int, watch: Watch) -> None:
        nbytes, error = ctypes.c_uint64(), _abi.lr_error()
        limit = 0 if max_nbytes is None else max(1, int(max_nbytes))
        status = lib.lr_samples_allocate(
            self.handle,
            ctypes.byref(as_map),
            limit,
            ctypes.byref(nbytes),
            ctypes.byref(error),
        )
        check(status, error)
        brick, cells = BRICK**3 * DTYPES[TYPES[as_map.sample_type]].itemsize, BRICK**3 // 8
        self.nbytes = nbytes.value // (brick + cells) * brick  # without a bit for each cell
        source.fill(self.handle, self._parts(), threads, watch)

    def surface(self, level: float, threads: int, watch: Watch) -> Volume:
        handle, error = ctypes.POINTER(_abi.lr_volume)(), _abi.lr_error()
        status = lib.lr_isosurface_begin(
            self.handle, level, ctypes.byref(handle), ctypes.byref(error)
        )
        check(status, error)
        return self.classify(handle, threads, watch)

    def classify(self, handle, threads: int, watch: Watch, planes=None) -> Volume:
        """The volume that handle begins, which is freed where that fails; planes: as for Volume."""
        error = _abi.lr_error()
        try:
            tables = None if planes is None else set_planes(handle, planes, self.size)

            def part(step: int, index: int) -> None:
                call(lib.lr_isosurface_part, handle, index, watch=watch)

            run_steps(part, [self._n_parts], threads, watch)
            check(lib.lr_isosurface_finish(handle, ctypes.byref(error)), error)
        except BaseException:
            lib.lr_volume_free(handle)
            raise
        return Volume.from_handle(handle, planes=tables)
