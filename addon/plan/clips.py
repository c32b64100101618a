# SPDX-License-Identifier: GPL-3.0-or-later
"""Solids that cut the surfaces of fields, and the faces of the cut (no bpy)."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

import leapray

from .. import model
from ..store import memory_cache
from . import objects

VOXELS = 64  # along the longest side of a solid that cuts
MARGIN = 0.02  # in occupancy: so the surfaces reach the faces of the cut


def solid(
    clip: model.Clip,
    traverser: str,
    cache: memory_cache.Cache,
    watch: leapray.Watch,
    threads: int,
    room: float,
) -> leapray.Structure:
    """The structure of a clip's mesh, from the cache or made within so many bytes as room.

    Its flat faces are exact. Raises LeapRayError with the reason that makes the mesh useless,
    Stopped.
    """
    mesh = clip.mesh
    flat = mesh.corner_normals is None
    key = "clip", objects.digest(mesh), flat, traverser
    structure = cache.get(key)
    if structure is None:
        if wrong := objects.wrong_with_mesh(mesh):
            raise leapray.LeapRayError(wrong)
        side = float(np.ptp(objects.bounds(mesh), axis=0).max())
        if not side > 0:
            raise leapray.LeapRayError("it has no extent")
        volume = leapray.voxelize(
            mesh.vertices,
            mesh.triangles,
            side / VOXELS,
            exact="all",
            flat=flat,
            threads=threads,
            watch=watch,
            max_nbytes=max(int(room), 1),
        )
        if volume.info.kind != "solid":
            raise leapray.LeapRayError(f"it is no solid, since {volume.mesh_info.why}")
        structure = leapray.build(volume, traverser or None, threads=threads, watch=watch)
    return cache.put(key, structure, structure.volume.info.nbytes + structure.nbytes)


def of_surface(clip: model.Clip, cutter: leapray.Structure) -> leapray.Clip:
    """What cuts the surfaces of a field."""
    return leapray.Clip(cutter.volume, clip.world_from_object, clip.inside, MARGIN)


def face(
    clip: model.Clip,
    cutter: leapray.Structure,
    surface: leapray.Instance,
    volume: leapray.Volume,
    **more: Any,
) -> leapray.Instance:
    """The faces of a cut through a volume, placed as a surface; more: what differs from its own."""
    data = leapray.Clip(volume, surface.world_from_object, inside=True)
    return dataclasses.replace(
        surface,
        structure=cutter,
        world_from_object=clip.world_from_object,
        clips=[data],
        error=0.0,
        **more,
    )
