# SPDX-License-Identifier: GPL-3.0-or-later
"""Whole images at once: first object cells of parallel rays, with pixels skipped."""

from __future__ import annotations

import ctypes
import weakref
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from . import _abi
from ._lib import LeapRayError, Watch, call, lib
from .arrays import choice, empty, members, pointer
from .rendering import Camera, camera_struct
from .threads import check_threads, cores, run_parts
from .tracing import METRICS, add_counters
from .volume import Volume

SKIPS = members(_abi.lr_pixel_skip)


class Clearance:
    """How far it is empty around every cell of a volume, which it keeps alive.

    metric: one of METRICS; "euclid" knows the largest radii. Raises LeapRayError for
    another, Stopped when watch was told to stop.
    Attributes: volume; metric; nbytes, without the volume.
    """

    def __init__(
        self, volume: Volume, metric: str = "euclid", *, watch: Watch | None = None
    ) -> None:
        self.volume = volume
        self.metric = metric
        self.handle = ctypes.POINTER(_abi.lr_radii)()
        number = choice(METRICS, metric, "metric")
        call(lib.lr_radii_build, volume.handle, number, watch=watch, outputs=(self.handle,))
        self.nbytes = lib.lr_radii_nbytes(self.handle)
        weakref.finalize(self, lib.lr_radii_free, self.handle)

    def __repr__(self) -> str:
        return f"<Clearance {self.metric}, {self.nbytes / 1e6:.3g} MB, of {self.volume!r}>"


@dataclass(frozen=True, repr=False)
class FirstCells:
    """What lies behind each pixel; row 0 is the lowest."""

    t: NDArray[np.float64]  # (height, width) along the camera's forward; infinity on a miss
    cell: NDArray[np.int32]  # (height, width, 3) i, j, k of the first object cell
    hit: NDArray[np.bool_]  # (height, width)
    skipped: NDArray[np.bool_]  # (height, width) not traced, as a neighbour had shown a miss
    counters: dict[str, int]  # of the rays that were traced

    def __repr__(self) -> str:
        height, width = self.t.shape
        return (
            f"<FirstCells of {width} x {height} pixels, {self.hit.sum()} hit, "
            f"{self.skipped.sum()} skipped>"
        )


def first_cells(
    clearance: Clearance,
    camera: Camera,
    width: int,
    height: int,
    *,
    skip: str = "safe",
    threads: int = 1,
    watch: Watch | None = None,
) -> FirstCells:
    """The first object cells behind an orthographic camera's pixels, in object space.

    clearance: of the volume; camera: in pixels of an image of that width and height.
    The same as `trace` with mode="binary" for a ray through every pixel's centre; but around
    a ray that misses, skip="safe" leaves out the pixels that are sure to miss too. "none"
    traces all; "paper" skips as far as the least radius of the ray's samples, as published,
    and loses pixels. threads (0: all cores) take bands of the image, and no pixel is skipped
    for one of another band. Raises LeapRayError for a perspective camera, Stopped when watch
    was told to stop. Source: Zuiderveld, Koning and Viergever 1992.
    """
    check_threads(threads)
    if width < 1 or height < 1:
        raise LeapRayError(f"an image needs pixels; there are {width} x {height}")
    number, seen = choice(SKIPS, skip, "skip"), camera_struct(camera)
    t, cell = empty((height, width), float), empty((height, width, 3), np.int32)
    pixel = empty((height, width), np.uint8)
    watch = watch or Watch()

    def band(first: int, last: int) -> _abi.lr_counters:
        image = _abi.lr_image(
            0, first, width, last - first,
            pointer(t[first:last]),
            pointer(cell[first:last], ctypes.c_int32),
            pointer(pixel[first:last], ctypes.c_uint8),
        )  # fmt: skip
        counters = _abi.lr_counters()
        call(
            lib.lr_first_cells,
            clearance.handle,
            ctypes.byref(seen),
            number,
            ctypes.byref(image),
            ctypes.byref(counters),
            watch=watch,
        )
        return counters

    if threads == 1:
        totals = [band(0, height)]
    else:
        share = -(-height // (threads or cores()))
        totals = run_parts(band, height, share, threads, watch)
    return FirstCells(
        t,
        cell,
        pixel == _abi.LR_PIXEL_HIT,
        pixel == _abi.LR_PIXEL_SKIPPED,
        add_counters(totals),
    )
