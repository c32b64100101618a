# SPDX-License-Identifier: GPL-3.0-or-later
"""The true hits of rays on a mesh, by Embree, which works in f32 (no bpy)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arrays import unit

Array = NDArray[np.float64]


def first_hits(
    vertices: NDArray, triangles: NDArray, origins: ArrayLike, directions: ArrayLike
) -> tuple[Array, Array, NDArray[np.int32]]:
    """t (n,), infinity on a miss; unit normals (n, 3) of the triangles, turned against the ray;
    and the triangles hit, -1 on a miss. directions (n, 3) are unit.

    Raises ModuleNotFoundError without embreex.
    """
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    scene = EmbreeScene(robust=True)
    mesh = TriangleMesh(scene, vertices.astype(np.float32), triangles.astype(np.int32))
    rays = (np.ascontiguousarray(part, np.float32) for part in (origins, directions))
    found = scene.run(*rays, output=True)
    del mesh
    triangle = np.asarray(found["primID"], np.int32)
    corner = vertices[triangles[np.maximum(triangle, 0)]].astype(np.float64)
    normal = unit(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]))
    normal *= -np.sign((normal * directions).sum(axis=1, keepdims=True))
    return np.where(triangle >= 0, found["tfar"], np.inf).astype(float), normal, triangle
