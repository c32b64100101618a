# SPDX-License-Identifier: GPL-3.0-or-later
"""Visible volumes: fields that are seen by a transfer function, without a surface."""

from __future__ import annotations

import ctypes
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from . import _abi
from ._lib import LeapRayError, Watch, check, lib
from .arrays import ONES
from .isosurfaces import FLOAT_MOST, LEAST_SCALE, TYPES, StoredSamples
from .scalar_grid import ScalarGrid
from .scalar_source import Source, source_of
from .threads import check_threads
from .transfer import TransferFunction
from .volume import Volume


def visible_volume(
    field: FieldSamples | ScalarGrid,
    transfer: TransferFunction,
    *,
    everywhere: bool = False,
    planes: tuple[ArrayLike, ArrayLike, ArrayLike] | None = None,
    threads: int = 0,
    watch: Watch | None = None,
) -> Volume:
    """The volume whose surface cells are those in which a transfer function sees something.

    Every structure leaps over the others; `trace` takes it by VISIBLE_MODES. field: the samples,
    which all volumes of them share, or the grid to take them from. everywhere: all cells that hold
    values are kept, whether something is seen in them or not: for extremes and means of all values,
    and to measure what leaping saves. planes: x (nx,), y (ny,), z (nz,), where planes of samples
    lie instead of at 0, 1, 2, ..., as for `Volume`. threads: 0 for all cores. Raises LeapRayError
    for what are no field and no transfer function, and where the background of a sparse grid is
    visible; OutOfMemory; Stopped when watch was told to stop.
    """
    check_threads(threads)
    if not isinstance(transfer, TransferFunction):
        raise LeapRayError(f"a leapray.TransferFunction is needed, not a {type(transfer).__name__}")
    if not isinstance(field, FieldSamples):
        only = None if everywhere else transfer
        field = FieldSamples(field, transfer=only, threads=threads, watch=watch)
    return field.at(transfer, everywhere=everywhere, planes=planes, threads=threads, watch=watch)


class FieldSamples:
    """The samples of a field, once, for volumes of any transfer functions.

    grid: a value is offset + scale * stored. NaN, no_data and minus infinity are no values: cells
    that they belong to are never visible, as those beyond the lattice; of leaves they are
    background, which goes on around them. Whole numbers are kept exactly in u8 or u16 where their
    range fits, others in f32. transfer: the only one that `at` will be asked for, or what makes it
    of the least and the largest value: where it sees nothing, samples of a dense grid take no
    memory. threads: 0 for all cores. max_nbytes: of samples and cells. Raises LeapRayError for
    grids that hold no real numbers, OutOfMemory beyond max_nbytes before anything is stored,
    Stopped when watch was told to stop.
    Attributes: low and high, the least and the largest value, low above high where there is none;
    infinite: whether either is infinite, and counts as the largest number of f32;
    scale and offset: the value is offset + scale * occupancy in each of its volumes; nbytes: of the
    samples, which are part of the nbytes of each volume.
    """

    def __init__(
        self,
        grid: ScalarGrid,
        *,
        transfer: TransferFunction | Callable[[float, float], TransferFunction] | None = None,
        threads: int = 0,
        watch: Watch | None = None,
        max_nbytes: int | None = None,
    ) -> None:
        check_threads(threads)
        watch = watch or Watch()
        source = source_of(grid)
        scale, offset = float(grid.scale), float(grid.offset)
        if not (np.isfinite([scale, offset]).all() and scale != 0.0):
            raise LeapRayError(
                f"scale and offset of {grid.name!r} must be finite, scale not 0; "
                f"they are {grid.scale} and {grid.offset}"
            )
        self._samples = StoredSamples(source, "linear", threads, watch)
        self._bounded = not source.sparse
        made = _map_of(source, self._samples)
        with np.errstate(all="ignore"):
            numbers = self._samples.low, self._samples.high
            ends = [float(offset + scale * np.float64(n)) for n in numbers]
            self._scale = scale / made.gain
            self.offset = offset + self._scale * made.base
        self.low, self.high = ends if self._samples.low > self._samples.high else sorted(ends)
        self.infinite = self._samples.infinite
        self.scale = self._scale * ONES[TYPES[made.sample_type]]
        self._only = transfer(self.low, self.high) if callable(transfer) else transfer
        if self._only is not None and self._bounded:
            error = _abi.lr_error()
            hide = lib.lr_samples_hide
            check(
                hide(self._samples.handle, self._only.handle, scale, offset, ctypes.byref(error)),
                error,
            )
        self._samples.store(source, made, max_nbytes, threads, watch)
        self.nbytes = self._samples.nbytes

    def __repr__(self) -> str:
        return f"<FieldSamples of {self.low:.6g} to {self.high:.6g}, {self.nbytes / 1e6:.3g} MB>"

    def at(
        self,
        transfer: TransferFunction,
        *,
        everywhere: bool = False,
        planes: tuple[ArrayLike, ArrayLike, ArrayLike] | None = None,
        threads: int = 0,
        watch: Watch | None = None,
    ) -> Volume:
        """The volume of a transfer function: everywhere, planes (x (nx,), y (ny,), z (nz,)),
        threads, watch and what is raised as for `visible_volume`.

        Raises LeapRayError, OutOfMemory, Stopped.
        """
        if self._only is not None and (everywhere or not transfer.sees_as(self._only)):
            raise LeapRayError("these samples are for one transfer function and what it sees alone")
        handle, error = ctypes.POINTER(_abi.lr_volume)(), _abi.lr_error()
        status = lib.lr_visible_begin(
            self._samples.handle,
            transfer.handle,
            self._scale,
            self.offset,
            self._bounded,
            everywhere,
            ctypes.byref(handle),
            ctypes.byref(error),
        )
        check(status, error)
        return self._samples.classify(handle, threads, watch or Watch(), planes)


def _map_of(source: Source, samples: StoredSamples) -> _abi.lr_samples_map:
    """How numbers are stored: none of them as what is outside, but for the background of leaves."""
    low, high = samples.low, samples.high
    made = _abi.lr_samples_map(gain=1.0)
    for sample_type in (_abi.LR_U8, _abi.LR_U16):
        one = ONES[TYPES[sample_type]]
        fits = low > high or high - low + 1 < one  # 0 stands for none, and nothing is all ones
        if source.whole and fits and not source.sparse:
            made.sample_type = sample_type
            made.base = low - 1 if low <= high else 0.0
            made.outside, made.inside = made.base, made.base + one
            return made
    made.sample_type = _abi.LR_F32
    largest = max(abs(low), abs(high)) if low <= high else 0.0
    if not LEAST_SCALE < largest < FLOAT_MOST and largest > 0.0 and not samples.infinite:
        made.gain = 2.0 ** -float(np.clip(np.frexp(largest)[1], -1000, 1000))
    most = min(FLOAT_MOST / made.gain, float(np.finfo(np.float64).max))
    made.outside, made.inside = source.background if source.sparse else -most, most
    return made
