# SPDX-License-Identifier: GPL-3.0-or-later
"""Splits meshes whose parts are close into several volumes (no bpy).

A sample holds one distance, that to the nearest triangle. Where two surfaces
come closer than two voxels, or intersect, the farther one is lost: eyeballs
tear their sockets. Within a connected part only finer voxels help; separate
parts can have separate volumes. So the parts are assigned to layers, such that
no two boxes in a layer overlap. A closed part of an open mesh thereby becomes
a solid.
"""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
from numpy.typing import NDArray

import leapray
from leapray.arrays import bounds

from .. import model
from . import mesh_colors

MOST_LAYERS = 16  # beyond that, every ray would meet too many volumes
NEAR = 1 / 32  # of the mesh's longest side: boxes with a gap less than this overlap


def islands(mesh: model.Mesh, watch: leapray.Watch | None = None) -> NDArray[np.int32]:
    """(n_triangles,): the number of each one's island; the small ones share one."""
    return leapray.mesh_layers(mesh.vertices, mesh.triangles, np.inf, watch=watch)


def split(mesh: model.Mesh, watch: leapray.Watch | None = None) -> list[model.Mesh]:
    """The mesh itself, or meshes of its layers, of the same triangles in the same order.

    mesh: finite, with at least one triangle. Raises Stopped where watch says so,
    LeapRayError where no triangle has an area.
    """
    near = NEAR * float(np.ptp(bounds(mesh.vertices), axis=0).max())
    layer = leapray.mesh_layers(mesh.vertices, mesh.triangles, near, watch=watch)
    layer = np.minimum(layer, MOST_LAYERS - 1)
    if layer.max() == 0:
        return [mesh]
    return [_only(mesh, layer == k) for k in range(layer.max() + 1)]


def torn(mesh: model.Mesh, pieces: list[model.Mesh], watch: leapray.Watch | None = None) -> bool:
    """Whether a mesh without an open edge became pieces that have some."""
    return not is_open(mesh, watch) and any(is_open(piece, watch) for piece in pieces)


def is_open(mesh: model.Mesh, watch: leapray.Watch | None = None) -> bool:
    """Whether an edge, as the vertices' numbers tell it, has one triangle only."""
    _, n_border = leapray.mesh_edges(mesh.vertices, mesh.triangles, -2.0, weld=False, watch=watch)
    return n_border > 0


def solids(mesh: model.Mesh) -> list[model.Mesh]:
    """The solids that share the mesh's volume, each by itself."""
    if mesh.solids is None:
        return [mesh]
    ends = np.flatnonzero(np.diff(mesh.solids)) + 1
    bounds = [0, *ends.tolist(), len(mesh.solids)]
    return [_only(mesh, slice(*ends)) for ends in itertools.pairwise(bounds)]


def _only(mesh: model.Mesh, chosen: NDArray[np.bool_] | slice) -> model.Mesh:
    """The chosen triangles with the vertices that they use, sharing a volume no more."""
    triangles = mesh.triangles[chosen]
    used = np.zeros(len(mesh.vertices), np.bool_)
    used[triangles] = True
    number = np.cumsum(used, dtype=np.int32) - 1
    return dataclasses.replace(
        mesh,
        vertices=mesh.vertices[used],
        triangles=number[triangles],
        slots=None if mesh.slots is None else mesh.slots[chosen],
        solids=None,
        **mesh_colors.only(mesh, chosen),
    )
