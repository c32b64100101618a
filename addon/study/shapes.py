# SPDX-License-Identifier: GPL-3.0-or-later
"""Shapes with known points, normals and first hits, for studies of errors (no bpy)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from leapray.arrays import DTYPES, ONES
from leapray.voxelization import filter_info

from ..arrays import unit

Array = NDArray[np.float64]
BLOCK, PART = 8, 2000  # samples along a block, and blocks at a time
NEAR = 1e-8  # where marching ends
MARCHES = 3000  # steps; free distance shrinks by 1 - cos(incidence) each: enough up to 89.6 degrees


@dataclass(frozen=True)
class Shape:
    """A solid inside the unit cube -1..1, by its exact distance (negative inside)."""

    name: str
    distance: Callable[[Array], Array]  # (n, 3) -> (n,)

    def normal(self, points: Array) -> Array:
        """(n, 3) outward unit normals, by central differences of the distance."""
        h = 1e-6
        steps = h * np.eye(3)
        slopes = [self.distance(points + s) - self.distance(points - s) for s in steps]
        return unit(np.stack(slopes, axis=1))

    def first_hit(self, origins: Array, directions: Array) -> Array:
        """t (n,) where rays with unit directions from outside enter; infinity where they miss.

        Marching by the distance never passes the surface. Source: Hart 1996.
        """
        t = np.zeros(len(origins))
        found = np.full(len(origins), np.inf)
        alive = np.arange(len(origins))
        for _ in range(MARCHES):
            free = self.distance(origins[alive] + t[alive, None] * directions[alive])
            there = free < NEAR
            found[alive[there]] = t[alive[there]]
            t[alive] += free
            alive = alive[~there & (t[alive] < 20.0)]
            if not len(alive):
                break
        return found

    def samples(self, size: int, dtype: str) -> tuple[NDArray, Array]:
        """Samples (size, size, size) of the cube -1.1..1.1 and their object_from_index (4, 4).

        Occupancy falls from 1 to 0 across the surface over twice the half width of the dtype,
        which is in voxels, as where the core voxelizes. Blocks whose middle is farther from the
        surface than their corners and the ramp reach are 0 or 1 throughout.
        """
        kind, top = DTYPES[dtype], ONES[dtype]
        half_width = filter_info("ramp", dtype).half_width
        voxel = 2.2 / (size - 1)
        n = -(-size // BLOCK)
        middles = grid((np.arange(n) * BLOCK + (BLOCK - 1) / 2) * voxel - 1.1)
        away = self.distance(middles.reshape(-1, 3)).reshape(n, n, n)
        made = np.empty((n, BLOCK, n, BLOCK, n, BLOCK), kind)
        blocks = made.transpose(0, 2, 4, 1, 3, 5)
        blocks[...] = np.where(away < 0, top, 0)[..., None, None, None]
        distance = (np.sqrt(3) * (BLOCK - 1) / 2 + half_width) * voxel
        near = np.argwhere(np.abs(away) <= distance)
        inside = grid(np.arange(BLOCK) * voxel)
        for part in np.array_split(near, -(-len(near) // PART) or 1):
            points = part[:, None, None, None, ::-1] * (BLOCK * voxel) - 1.1 + inside
            ramp = 0.5 - self.distance(points.reshape(-1, 3)) / (2 * half_width * voxel)
            fraction = np.clip(ramp, 0.0, 1.0).reshape(-1, BLOCK, BLOCK, BLOCK) * top
            blocks[tuple(part.T)] = fraction if dtype == "f32" else np.rint(fraction)
        matrix = np.diag([voxel, voxel, voxel, 1.0])
        matrix[:3, 3] = -1.1
        made = made.reshape((n * BLOCK,) * 3)[:size, :size, :size]
        return np.ascontiguousarray(made), matrix


def grid(line: Array) -> Array:
    """(n, n, n, 3) points x, y, z in the order z, y, x."""
    z, y, x = np.meshgrid(line, line, line, indexing="ij")
    return np.stack([x, y, z], axis=-1)


# ---- distances -----------------------------------------------------------


def sphere(radius: float = 0.9) -> Shape:
    return Shape("sphere", lambda p: np.linalg.norm(p, axis=1) - radius)


def torus(major: float = 0.62, minor: float = 0.26) -> Shape:
    turn = rotation((0.5, 0.3, 0.8))

    def distance(points: Array) -> Array:
        p = points @ turn
        across = np.hypot(p[:, 0], p[:, 1]) - major
        return np.hypot(across, p[:, 2]) - minor

    return Shape("torus", distance)


def rods(radius: float = 0.02) -> Shape:
    """Three crossing rods with round ends."""
    ends = np.array(
        [
            [(-0.85, -0.5, -0.3), (0.8, 0.55, 0.4)],
            [(-0.6, 0.8, -0.55), (0.7, -0.75, 0.2)],
            [(0.1, 0.3, -0.9), (-0.25, -0.1, 0.9)],
        ]
    )

    def distance(points: Array) -> Array:
        nearest = np.full(len(points), np.inf)
        for a, b in ends:
            along = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
            off = points - a - along[:, None] * (b - a)
            nearest = np.minimum(nearest, np.sqrt(np.einsum("ij,ij->i", off, off)) - radius)
        return nearest

    return Shape("thin rods", distance)


def box() -> Shape:
    turn, half = rotation((0.4, 0.9, 0.2)), np.array([0.62, 0.45, 0.52])

    def distance(points: Array) -> Array:
        q = np.abs(points @ turn) - half
        outside = np.linalg.norm(np.maximum(q, 0.0), axis=1)
        return outside + np.minimum(q.max(axis=1), 0.0)

    return Shape("box", distance)


def rotation(angles: tuple[float, float, float]) -> Array:
    """(3, 3) turns about x, then y, then z, in radians."""
    whole = np.eye(3)
    for axis, angle in enumerate(angles):
        c, s = np.cos(angle), np.sin(angle)
        turn = np.eye(3)
        u, v = (axis + 1) % 3, (axis + 2) % 3
        turn[u, u], turn[u, v], turn[v, u], turn[v, v] = c, -s, s, c
        whole = turn @ whole
    return whole


# ---- a mesh --------------------------------------------------------------


def knot(n_along: int = 360, n_around: int = 40) -> tuple[Array, NDArray[np.int32]]:
    """Vertices (n, 3) and triangles (m, 3) of a closed tube along a trefoil knot."""
    u = np.arange(n_along) / n_along * 2 * np.pi
    line = np.stack(
        [np.sin(u) + 2 * np.sin(2 * u), np.cos(u) - 2 * np.cos(2 * u), -1.4 * np.sin(3 * u)], axis=1
    )
    line *= 0.74 / np.abs(line).max()
    tangent = unit(np.roll(line, -1, axis=0) - np.roll(line, 1, axis=0))
    side = unit(np.cross(tangent, (0.0, 0.0, 1.0)))
    up = np.cross(tangent, side)
    v = np.arange(n_around) / n_around * 2 * np.pi
    ring = side[:, None] * np.cos(v)[:, None] + up[:, None] * np.sin(v)[:, None]
    vertices = (line[:, None] + 0.2 * ring).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(n_along), np.arange(n_around), indexing="ij")
    a, b = i * n_around + j, i * n_around + (j + 1) % n_around
    c, d = ((i + 1) % n_along) * n_around + j, ((i + 1) % n_along) * n_around + (j + 1) % n_around
    quads = np.stack([a, b, d, a, d, c], axis=-1).reshape(-1, 3)
    return vertices, quads.astype(np.int32)
