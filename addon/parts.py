# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes whose parts are close are taken apart, for several volumes (no bpy).

A sample knows one distance, that to the nearest triangle. Where two surfaces
come closer than two voxels, or cut each other, that of one is lost to the
other: eyeballs tear their sockets. Within a connected part this asks for finer
voxels; between parts it need not happen at all, since rays find their way
through any number of volumes. So the parts are dealt out in layers, such that
no two boxes in a layer overlap. A closed part of an open mesh becomes a solid
on the way.

A closed part whose walls are thinner than a voxel (paper with a thickness) has
no sample inside, so its field shows nothing. It is cut: its rims, which are
strips narrower than a voxel, are left out, and its two faces become sheets.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import leapray

from . import bake, model, probes

MOST_LAYERS = 16  # what needs more is a thicket, in which every ray would meet every volume
RIM_COSINE = np.cos(np.radians(45.0))  # duller edges do not end the face of a plate
LEFT_OUT = 0.2  # of the area, at most; where the rims are more, it is no plate
NEAR = 1 / 32  # of the mesh's longest side: boxes with a gap less than this overlap


def split(mesh: model.Mesh, watch: leapray.Watch | None = None) -> list[model.Mesh]:
    """The mesh itself, or meshes of its layers, of the same triangles in the same order.

    mesh: finite, with at least one triangle. Raises Stopped where watch says so,
    LeapRayError where no triangle has an area.
    """
    near = NEAR * float(np.ptp(mesh.vertices, axis=0).max())
    layer = leapray.mesh_layers(mesh.vertices, mesh.triangles, near, watch=watch)
    layer = np.minimum(layer, MOST_LAYERS - 1)
    if layer.max() == 0:
        return [mesh]
    return [_only(mesh, layer == k) for k in range(layer.max() + 1)]


def cut(
    mesh: model.Mesh, voxel_size: float, watch: leapray.Watch | None = None
) -> list[model.Mesh]:
    """The faces of a plate that is thinner than voxel_size, as open meshes; [] where it is none.

    Patches between sharp edges that are narrower than a voxel are its rims.
    """
    vertices, triangles = mesh.vertices, mesh.triangles
    a, b, c = (vertices[triangles[:, k]].astype(np.float64) for k in range(3))  # for its range
    cross = np.cross(b - a, c - a)
    order, bounds = probes.edges(probes.weld(vertices)[triangles])
    pair = bounds[:-1][np.diff(bounds) == 2]
    first, second = order[pair], order[pair + 1]
    flat = ~probes.turns(cross, first, second, RIM_COSINE)
    patch = connected(np.stack([first[flat], second[flat]], axis=1) // 3, len(triangles))
    _, patch = np.unique(patch, return_inverse=True)
    area = np.bincount(patch, np.linalg.norm(cross, axis=1) / 2)
    lo, hi = np.full((len(area), 3), np.inf), np.full((len(area), 3), -np.inf)
    np.minimum.at(lo, patch, np.minimum(np.minimum(a, b), c))
    np.maximum.at(hi, patch, np.maximum(np.maximum(a, b), c))
    strip = area < voxel_size * np.linalg.norm(hi - lo, axis=1)
    if not strip.any() or area[strip].sum() > LEFT_OUT * area.sum():
        return []
    return split(_only(mesh, ~strip[patch]), watch)


def connected(pairs: NDArray[np.integer], n: int) -> NDArray[np.int64]:
    """For each of n things the lowest number of those that pairs (m, 2) connect it with.

    Source: Shiloach and Vishkin 1982 (hook and shortcut).
    """
    label = np.arange(n)
    while len(pairs):
        pairs = label[pairs]
        pairs = pairs[pairs[:, 0] != pairs[:, 1]]
        np.minimum.at(label, pairs.max(axis=1), pairs.min(axis=1))
        while not np.array_equal(further := label[label], label):
            label = further
    return label


def _only(mesh: model.Mesh, chosen: NDArray[np.bool_]) -> model.Mesh:
    """The chosen triangles with the vertices that they use."""
    used, triangles = np.unique(mesh.triangles[chosen], return_inverse=True)
    slots = None if mesh.slots is None else mesh.slots[chosen]
    shape = (int(chosen.sum()), 3)
    return model.Mesh(
        mesh.name,
        mesh.vertices[used],
        triangles.reshape(shape).astype(np.int32),
        slots,
        **bake.only(mesh, chosen),
        modelling=mesh.modelling,
    )
