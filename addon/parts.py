# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes whose parts are close are taken apart, for several volumes (no bpy).

A sample knows one distance, that to the nearest triangle. Where two surfaces
come closer than two voxels, or cut each other, that of one is lost to the
other: eyeballs tear their sockets, crossing rods get the wrong sign. Within a
connected part this asks for finer voxels; between parts it need not happen at
all, since rays find their way through any number of volumes. So the parts are
dealt out such that no two boxes in a volume overlap. A closed part of an open
mesh becomes a solid on the way.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from . import model
from .probes import weld

MOST_PARTS = 4096  # of one mesh that are dealt out; more are as good as a cloud
MOST_GROUPS = 8  # what overlaps with all of them goes to the last
NEAR = 1 / 32  # of the mesh's longest side: boxes with a gap less than this overlap


def connected(triangles: NDArray[np.integer], n: int) -> NDArray[np.int64]:
    """For each of n vertices the lowest number in its connected part.

    triangles: (m, 3). Source: Shiloach and Vishkin 1982 (hook and shortcut).
    """
    label = np.arange(n)
    ends = triangles[:, [0, 1, 1, 2]].reshape(-1, 2)
    while len(ends):
        ends = label[ends]
        ends = ends[ends[:, 0] != ends[:, 1]]
        np.minimum.at(label, ends.max(axis=1), ends.min(axis=1))
        while True:
            further = label[label]
            if np.array_equal(further, label):
                break
            label = further
    return label


def deal(lo: NDArray[np.float64], hi: NDArray[np.float64]) -> NDArray[np.int64]:
    """A group for each of n boxes, lo and hi (n, 3), so that no two in a group overlap.

    The first fit, the largest boxes first; what fits into none of MOST_GROUPS
    goes to the last of them.
    """
    group = np.zeros(len(lo), np.int64)
    order = np.argsort(-(hi - lo).max(axis=1), kind="stable")
    for rank, k in enumerate(order):
        before = order[:rank]
        apart = (lo[before] > hi[k]) | (hi[before] < lo[k])
        taken = set(group[before[~apart.any(axis=1)]].tolist())
        group[k] = next((g for g in range(MOST_GROUPS) if g not in taken), MOST_GROUPS - 1)
    return group


def split(mesh: model.Mesh, breathe: Callable[[], None] = lambda: None) -> list[model.Mesh]:
    """The mesh itself, or meshes of groups of its parts, of the same triangles in the same order.

    mesh: finite, with at least one triangle. breathe is called now and then; it may raise.
    """
    places = weld(mesh.vertices)[mesh.triangles]
    breathe()
    part = connected(places, int(places.max()) + 1)[places[:, 0]]
    names, part = np.unique(part, return_inverse=True)
    breathe()
    if not 1 < len(names) <= MOST_PARTS:
        return [mesh]
    corners = mesh.vertices[mesh.triangles].astype(np.float64)
    lo, hi = np.full((len(names), 3), np.inf), np.full((len(names), 3), -np.inf)
    np.minimum.at(lo, part, corners.min(axis=1))
    np.maximum.at(hi, part, corners.max(axis=1))
    near = NEAR * (hi.max(axis=0) - lo.min(axis=0)).max()
    group = deal(lo - near / 2, hi + near / 2)
    if group.max() == 0:
        return [mesh]
    return [_only(mesh, group[part] == g) for g in range(group.max() + 1)]


def _only(mesh: model.Mesh, chosen: NDArray[np.bool_]) -> model.Mesh:
    """The chosen triangles with the vertices that they use."""
    used, triangles = np.unique(mesh.triangles[chosen], return_inverse=True)
    slots = None if mesh.slots is None else mesh.slots[chosen]
    shape = (int(chosen.sum()), 3)
    return model.Mesh(
        mesh.name, mesh.vertices[used], triangles.reshape(shape).astype(np.int32), slots
    )
