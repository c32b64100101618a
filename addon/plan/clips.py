# SPDX-License-Identifier: GPL-3.0-or-later
"""Solids that cut the surfaces of fields, and the faces of the cut (no bpy)."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

import leapray

from .. import model
from ..store import memory_cache
from . import fastest, objects

FLAT = 1e-5  # of a mesh's extent: how far its vertices may lie off a plane
BESIDE = 1.1  # of the data's extent: how far the box that stands for a half-space reaches
VOXELS = 64  # along the longest side of a solid that cuts
MARGIN = 0.02  # in occupancy: so the surfaces reach the faces of the cut


def box() -> model.Mesh:
    """From -1 to 1 along each axis."""
    corners = objects.box(np.array([(-1.0, -1.0, -1.0), (1.0, 1.0, 1.0)]))
    quads = np.array(
        [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    )
    triangles = np.concatenate([quads[:, (0, 1, 2)], quads[:, (0, 2, 3)]]).astype(np.int32)
    return model.Mesh("box", corners.astype(np.float32), triangles)


def plane_of(mesh: model.Mesh) -> NDArray[np.float64] | None:
    """mesh_from_plane, (4, 4): z along the normals of a flat mesh; None of others."""
    if objects.wrong_with_mesh(mesh):
        return None
    corners = mesh.vertices.astype(np.float64)[mesh.triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).sum(axis=0)
    middle = corners.mean(axis=(0, 1))
    offset = corners.reshape(-1, 3) - middle
    extent, length = np.abs(offset).max(), np.linalg.norm(normal)
    if not length > FLAT * extent**2 or np.abs(offset @ normal).max() > FLAT * extent * length:
        return None
    along = np.eye(3)[np.abs(normal).argmin()]
    x = np.cross(along, normal)
    x /= np.linalg.norm(x)
    matrix = np.eye(4)
    matrix[:3] = np.column_stack([x, np.cross(normal, x) / length, normal / length, middle])
    return matrix


def bounded(clip: model.Clip, corners: NDArray[np.float64]) -> model.Clip:
    """The clip by a mesh: of a half-space the part round what has these corners (n, 3), in the
    world."""
    if clip.mesh is not None:
        return clip
    inverse = np.linalg.inv(clip.world_from_object)
    local = corners @ inverse[:3, :3].T + inverse[:3, 3]
    low, high = local.min(axis=0), local.max(axis=0)
    half = np.maximum((high - low) / 2 * BESIDE, FLAT * np.ptp(local))
    height = max(high[2] * BESIDE, half.max() * FLAT)
    place = np.diag([half[0], half[1], height / 2, 1.0])
    place[:3, 3] = *(low + high)[:2] / 2, height / 2
    return dataclasses.replace(clip, mesh=box(), world_from_object=clip.world_from_object @ place)


def solid(
    clip: model.Clip,
    traverser: str,
    cache: memory_cache.Cache,
    watch: leapray.Watch,
    threads: int,
    room: float,
) -> leapray.Structure:
    """The structure of a bounded clip's mesh, from the cache or made within so many bytes as room.

    Its flat faces are exact. Raises LeapRayError with the reason that makes the mesh useless,
    Stopped.
    """
    mesh = clip.mesh
    assert mesh is not None
    flat = mesh.corner_normals is None
    key = "clip", mesh.contents, flat, traverser
    structure = cache.get(key)
    if structure is None:
        if wrong := objects.wrong_with_mesh(mesh):
            raise leapray.LeapRayError(wrong)
        side = float(np.ptp(mesh.bounds, axis=0).max())
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
        structure = leapray.build(volume, fastest.first(traverser), threads=threads, watch=watch)
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
