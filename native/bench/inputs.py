# SPDX-License-Identifier: GPL-3.0-or-later
"""What the benchmarks work on: phantoms, rays, a mesh and a fog, made from seeds.

They are arrays, so that they are the same for every version of the core.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

SEED = 1994
RADIUS = 0.3  # of a phantom's sphere, by the side of its subregion
VIEW = (-0.48, 0.31, -0.82)  # a direction along no axis and no diagonal

Rays = tuple[NDArray[np.float64], NDArray[np.float64]]


def spheres(size: int, n: int) -> NDArray[np.uint8]:
    """(size, size, size) samples: 255 in n^3 spheres and in the corners, else 0.

    Each sphere lies at a random place of its subregion. The corners' samples make the bounds of
    what there is, where the core lets rays begin, the whole cube for every n.
    Source: Sramek 1994, section 4; its radius is not given.
    """
    random = np.random.default_rng((SEED, n))
    side, radius = size / n, RADIUS * size / n
    samples = np.zeros((size, size, size), np.uint8)
    for place in product(range(n), repeat=3):
        centre = side * np.array(place) + random.uniform(radius, side - radius, 3)
        low = np.maximum(np.floor(centre - radius).astype(int), 0)
        high = np.minimum(np.ceil(centre + radius).astype(int) + 1, size)
        x, y, z = (np.arange(low[a], high[a]) - centre[a] for a in range(3))
        inside = z[:, None, None] ** 2 + y[:, None] ** 2 + x**2 <= radius**2
        samples[low[2] : high[2], low[1] : high[1], low[0] : high[0]][inside] = 255
    samples[:: size - 1, :: size - 1, :: size - 1] = 255
    return samples


def parallel_rays(low: NDArray, high: NDArray, image: int) -> Rays:
    """Origins and directions (image^2, 3) of an oblique parallel camera that sees the whole box."""
    forward = np.array(VIEW) / np.linalg.norm(VIEW)
    right = np.cross(forward, (0.0, 1.0, 0.0))
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    extent = np.asarray(high, float) - low
    half_right, half_up = (np.abs(axis) @ extent / 2 for axis in (right, up))
    line = (np.arange(image) + 0.5) / image * 2 - 1
    x, y = (film.reshape(-1, 1) for film in np.meshgrid(half_right * line, half_up * line))
    eye = (np.asarray(low) + high) / 2 - np.linalg.norm(extent) * forward
    origins = eye + x * right + y * up
    return origins, np.broadcast_to(forward, origins.shape).copy()


def knobbly_torus(nu: int = 320, nv: int = 160) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Vertices (nu nv, 3) and 2 nu nv triangles of a closed ring about z with bumps and creases."""
    i, j = (index.ravel() for index in np.indices((nu, nv)))
    u, v = 2 * np.pi * i / nu, 2 * np.pi * j / nv
    tube = 0.35 + 0.05 * np.abs(np.sin(8 * u)) * np.cos(5 * v) + 0.01 * np.sin(40 * u + 21 * v)
    ring = 1.0 + tube * np.cos(v)
    vertices = np.stack([ring * np.cos(u), ring * np.sin(u), tube * np.sin(v)], axis=1)
    beyond_i, beyond_j = (i + 1) % nu, (j + 1) % nv
    a, b, c, d = i * nv + j, beyond_i * nv + j, beyond_i * nv + beyond_j, i * nv + beyond_j
    triangles = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return vertices, triangles.astype(np.int32)


def ball(n: int = 64) -> NDArray[np.float32]:
    """(n, n, n) occupancies of a ball that nearly fills the lattice, soft across its surface."""
    z, y, x = np.indices((n, n, n)) - (n - 1) / 2
    radius = n / 2 - 5
    return np.clip(0.5 + (radius - np.sqrt(x**2 + y**2 + z**2)) / 5, 0, 1).astype(np.float32)


def fog(n: int = 128, puffs: int = 14) -> NDArray[np.float32]:
    """(n, n, n) densities, 0 to 1: puffs that fade, and nothing around them."""
    random = np.random.default_rng(SEED)
    axis = (np.arange(n) + 0.5) / n
    density = np.zeros((n, n, n))
    for _ in range(puffs):
        middle, width = random.uniform(0.25, 0.75, 3), random.uniform(0.05, 0.1)
        x, y, z = (np.exp(-0.5 * ((axis - at) / width) ** 2) for at in middle)
        density += z[:, None, None] * y[:, None] * x
    density /= density.max()
    return np.where(density < 1e-3, 0.0, density).astype(np.float32)
