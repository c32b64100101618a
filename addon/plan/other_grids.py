# SPDX-License-Identifier: GPL-3.0-or-later
"""Samples of grids that colour the surfaces of others (no bpy)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import leapray
from leapray.scalar_grid import Leaves

from .. import arrays, model
from ..store import memory_cache
from . import field_filters

SAMPLES = "other samples"  # what the cache calls them


@dataclass(frozen=True)
class Samples:
    """A grid as the core looks it up: the value is offset + scale * occupancy."""

    volume: leapray.Volume
    scale: float
    offset: float
    factor: int  # samples of the data along a side of a voxel


def key(other: model.OtherGrid) -> tuple[str, str]:
    """What tells a grid from others."""
    return other.contents, arrays.digest((np.asarray(other.grid.world_from_index),))


def samples(
    other: model.OtherGrid,
    cache: memory_cache.Cache,
    watch: leapray.Watch,
    threads: int,
    room: float,
) -> Samples:
    """Those of a grid on the finest lattice that fits into so many bytes as room.

    Raises LeapRayError for a grid that is no field of numbers, OutOfMemory where the coarsest does
    not fit, Stopped.
    """
    factor = 1
    while True:
        told = SAMPLES, *key(other), factor
        made = cache.get(told)
        try:
            if made is None:
                made = _made(other, factor, watch, threads, room)
            nbytes = made.volume.info.nbytes
            if nbytes > room:
                raise leapray.OutOfMemory(f"its samples take {nbytes / 1e6:.0f} MB")
            return cache.put(told, made, nbytes)
        except leapray.OutOfMemory:
            if factor == field_filters.COARSEST:
                raise
            factor *= 2


def _made(
    other: model.OtherGrid, factor: int, watch: leapray.Watch, threads: int, room: float
) -> Samples:
    grid = field_filters.coarser(other.grid, factor, threads, watch)

    def field_of(above: bool) -> leapray.Isosurfaces:
        return leapray.Isosurfaces(
            grid, above=above, threads=threads, watch=watch, max_nbytes=max(int(room), 1)
        )

    field = field_of(True)
    middle = (field.low + field.high) / 2
    stored = grid.samples
    if isinstance(stored, Leaves) and grid.offset + grid.scale * stored.background >= middle:
        field = field_of(False)  # the background lies outside
    if not field.low < field.high:  # the same everywhere
        empty = leapray.Volume(np.zeros((1, 1, 1), np.uint8))
        return Samples(empty, 0.0, field.low if np.isfinite(field.low) else 0.0, factor)
    volume = field.at(middle, threads=threads, watch=watch)
    return Samples(volume, field.scale, field.offset, factor)
