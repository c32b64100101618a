# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes for tests: vertices (n, 3) in f64 and triangles (m, 3), counter-clockwise from outside,
and slow, plain answers about them."""

import numpy as np


def icosphere(levels, radius=1.0, centre=(0.0, 0.0, 0.0)):
    """20 * 4^levels triangles whose vertices lie on the sphere."""
    g = (1 + 5**0.5) / 2
    signs = [(i, j) for i in (-1, 1) for j in (-1, 1)]
    v = np.array([np.roll((0, i, j * g), a) for a in range(3) for i, j in signs])
    apart = np.linalg.norm(v[:, None] - v, axis=2)
    near = (apart > 0) & (apart < 2.1)  # the icosahedron's edges have length 2
    t = np.array(
        [
            c
            for c in np.ndindex(12, 12, 12)
            if c == tuple(sorted(c)) and near[c[0], c[1]] and near[c[1], c[2]] and near[c[2], c[0]]
        ]
    )
    inward = np.linalg.det(v[t]) < 0
    t[inward] = t[inward, ::-1]
    v = v / np.linalg.norm(v, axis=1, keepdims=True)
    for _ in range(levels):
        edges = np.sort(t[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        unique, which = np.unique(edges, axis=0, return_inverse=True)
        middle = v[unique].sum(axis=1)
        a, b, c = t.T
        ab, bc, ca = (which.reshape(-1, 3) + len(v)).T
        t = np.stack([a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca], axis=1).reshape(-1, 3)
        v = np.concatenate([v, middle / np.linalg.norm(middle, axis=1, keepdims=True)])
    return v * radius + centre, t.astype(np.int32)


def grid_surface(nu, nv, position, wrap_u=False, wrap_v=False):
    """The surface position(u, v), u and v in 0..1, as 2 nu nv triangles; wrapped sides join."""
    mu, mv = nu + (not wrap_u), nv + (not wrap_v)
    u, v = np.meshgrid(np.arange(mu) / nu, np.arange(mv) / nv, indexing="ij")
    i, j = (x.ravel() for x in np.meshgrid(np.arange(nu), np.arange(nv), indexing="ij"))
    i1, j1 = (i + 1) % mu, (j + 1) % mv
    a, b, c, d = i * mv + j, i1 * mv + j, i1 * mv + j1, i * mv + j1
    triangles = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return np.stack(position(u, v), axis=-1).reshape(-1, 3), triangles.astype(np.int32)


def torus(nu=48, nv=24, major=1.0, minor=0.4):
    def position(u, v):
        ring = major + minor * np.cos(2 * np.pi * v)
        u = 2 * np.pi * u
        return ring * np.cos(u), ring * np.sin(u), minor * np.sin(2 * np.pi * v)

    return grid_surface(nu, nv, position, True, True)


def plane(n=8, tilt=0.0):
    """The unit square as 2 n^2 triangles, tilted about x."""
    return grid_surface(
        n, n, lambda u, v: (u - 0.5, (v - 0.5) * np.cos(tilt), (v - 0.5) * np.sin(tilt))
    )


def half_sphere(n=16):
    vertices, triangles = icosphere(3)
    return vertices, triangles[vertices[triangles, 2].min(axis=1) > -1e-9]


def leaf(n=12):
    """A pointed, bent and curled blade whose tips are single vertices."""

    def position(u, v):
        width = 0.3 * np.sin(np.pi * u)
        return 2 * u - 1, width * (2 * v - 1), 0.3 * u**2 + 0.5 * width * (2 * v - 1) ** 2

    return grid_surface(n, 6, position)


def box(lo=(-1, -1, -1), hi=(1, 1, 1)):
    """12 triangles."""
    corner = np.array([[(lo, hi)[b >> a & 1][a] for a in range(3)] for b in range(8)], float)
    quads = [(0, 4, 6, 2), (1, 3, 7, 5), (0, 1, 5, 4), (2, 6, 7, 3), (0, 2, 3, 1), (4, 5, 7, 6)]
    return corner, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))], np.int32)


def spiky(seed, levels=2):
    """A closed, random star-shaped mesh with sharp edges and slivers."""
    rng = np.random.default_rng(seed)
    vertices, triangles = icosphere(levels)
    return vertices * rng.uniform(0.5, 1.0, (len(vertices), 1)), triangles


def joined(*meshes):
    """Several meshes as one."""
    vertices, triangles, n = [], [], 0
    for v, t in meshes:
        vertices.append(v)
        triangles.append(np.asarray(t) + n)
        n += len(v)
    return np.concatenate(vertices), np.concatenate(triangles)


def uv_sphere(nu, nv, radius=1.0):
    """2 nu (nv - 1) triangles with area whose vertices lie on the sphere."""

    def position(u, v):
        around, up = 2 * np.pi * u, np.pi * v
        ring = np.where(v < 1, np.sin(up), 0.0)  # sin(pi) is not 0
        return radius * ring * np.cos(around), radius * ring * np.sin(around), -radius * np.cos(up)

    return grid_surface(nu, nv, position, wrap_u=True)


# ---- oracles ----------------------------------------------------------------


def positions(volume):
    """Sample positions (nz, ny, nx, 3) in object space."""
    nx, ny, nz = volume.info.size
    k, j, i = np.meshgrid(np.arange(nz), np.arange(ny), np.arange(nx), indexing="ij")
    m = volume.info.object_from_index
    return np.stack([i, j, k], -1) @ m[:3, :3].T + m[:3, 3]


def brute_distance(points, vertices, triangles):
    """Unsigned distance and nearest triangle of points (n, 3), by a slow and simple search.

    The closest point of a triangle is that of its plane where it falls inside,
    else the closest of the three segments.
    """
    best = np.full(len(points), np.inf)
    which = np.full(len(points), -1)
    for t, (a, b, c) in enumerate(vertices[triangles]):
        n = np.cross(b - a, c - a)
        d = np.full(len(points), np.inf)
        inside = np.ones(len(points), bool)
        for p, q in ((a, b), (b, c), (c, a)):
            u = q - p
            s = np.clip((points - p) @ u / (u @ u), 0, 1)
            d = np.minimum(d, np.linalg.norm(points - p - s[:, None] * u, axis=1))
            inside &= (points - p) @ np.cross(n, u) >= 0
        height = np.abs((points - a) @ n) / np.linalg.norm(n)
        d = np.where(inside, height, d)
        which = np.where(d < best, t, which)
        best = np.minimum(d, best)
    return best, which


def brute_rays(origins, directions, vertices, triangles):
    """First hit (n,) of rays with triangles, infinity on a miss; both sides; and which (n,).

    Source: Moeller and Trumbore 1997.
    """
    first, which = np.full(len(origins), np.inf), np.full(len(origins), -1)
    with np.errstate(divide="ignore", invalid="ignore"):
        for k, (a, b, c) in enumerate(vertices[triangles]):
            p = np.cross(directions, c - a)
            fraction = 1 / (p @ (b - a))
            from_a = origins - a
            u = np.einsum("ij,ij->i", from_a, p) * fraction
            q = np.cross(from_a, b - a)
            v = np.einsum("ij,ij->i", directions, q) * fraction
            t = (q @ (c - a)) * fraction
            hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t >= 0) & (t < first)
            first, which = np.where(hit, t, first), np.where(hit, k, which)
    return first, which


def winding(points, vertices, triangles):
    """Generalised winding number: the sum of solid angles (van Oosterom and Strackee 1983)."""
    total = np.zeros(len(points))
    for a, b, c in vertices[triangles]:
        a, b, c = a - points, b - points, c - points
        la, lb, lc = (np.linalg.norm(x, axis=1) for x in (a, b, c))
        numerator = np.einsum("ij,ij->i", a, np.cross(b, c))
        dot = lambda x, y: np.einsum("ij,ij->i", x, y)  # noqa: E731
        denominator = la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb
        total += 2 * np.arctan2(numerator, denominator)
    return total / (4 * np.pi)
