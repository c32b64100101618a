# SPDX-License-Identifier: GPL-3.0-or-later
"""Solids of the labels of a field, as many as its materials need (no bpy).

Opaque labels make one solid, whose samples' ids tell them apart: where they touch there is no
surface, and so no seam. See-through ones have solids of their own, which overlap their
neighbours a little.
"""

from __future__ import annotations

import leapray
from leapray.label_volume import SMOOTHEST

from .. import model
from . import field_filters


def key(field: model.Field, number: int | None, factor: int) -> str:
    """What tells a solid of the same data from others."""
    return repr((field.labels, number, factor))


def made(
    field: model.Field,
    number: int | None,
    factor: int,
    threads: int,
    watch: leapray.Watch,
    room: float,
) -> leapray.Volume:
    """The solid with that number, on a lattice so many times as coarse; None: of all labels.

    Raises LeapRayError for numbers that are no labels, OutOfMemory beyond so many bytes as room,
    Stopped.
    """
    assert field.labels is not None
    bodies = field.labels.bodies
    of: tuple[int, ...] | None = None
    over: tuple[int, ...] = ()
    if number is not None and len(bodies) > 1:
        of, over = bodies[number], tuple(n for body in bodies[number + 1 :] for n in body)
    return leapray.labels(
        field_filters.coarser(field.grid, factor, threads, watch),
        numbers=field.labels.numbers,
        of=of,
        over=over,
        smoothing=min(field.smoothing / factor, SMOOTHEST),
        watch=watch,
        max_nbytes=max(int(room), 1),
    )


def ids_of(volume: leapray.Volume, instance: model.FieldInstance) -> leapray.FieldColor:
    """What gives hits the labels of a solid around them, whose borders do not show the voxels."""
    return leapray.FieldColor(volume, instance.world_from_object, None, part="id")
