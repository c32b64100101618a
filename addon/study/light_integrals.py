# SPDX-License-Identifier: GPL-3.0-or-later
"""Emission and absorption along rays by extended precision, without anything of the core's.

Along a ray the trilinear field of a cell is a cubic, which four of its values give. It is cut where
it turns and, by halving, where it passes a knot; what lies between is integrated by Gauss and
Legendre's rule of 16 nodes, in at least four panels, none of them deeper than 4.
light_integrals.c does the same for many rays, without emission.
"""

from __future__ import annotations

import ctypes

import numpy as np

from .compiled import library, pointer

Real = np.longdouble
NODES, WEIGHTS = (Real(x) for x in np.polynomial.legendre.leggauss(16))
HALVINGS = 70
PANELS, DEEPEST = 4, 16.0  # of each part between knots, and for how deep a one


class Ramp:
    """A transfer function's knots as pieces that are linear in the value."""

    def __init__(self, values, extinction, colors, emission=None) -> None:
        self.knots_in_c = np.column_stack([values, extinction, np.broadcast_to(
            colors, (len(values), 3))]).astype(float) if emission is None else None  # fmt: skip
        x = np.asarray(values, Real)
        columns = [np.asarray(extinction, Real)[:, None], np.broadcast_to(colors, (len(x), 3))]
        columns.append(np.zeros((len(x), 3)) if emission is None else emission)
        y = np.concatenate([np.asarray(np.broadcast_to(c, (len(x), c.shape[-1])), Real)
                            for c in map(np.asarray, columns)], axis=1)  # fmt: skip
        self.knots = np.unique(x)
        width = np.diff(x)[:, None]
        rise = np.divide(np.diff(y, axis=0), width, out=np.zeros_like(y[1:]), where=width > 0)
        self.x, self.from_, self.start = x, np.r_[x[:1], x], np.r_[y[:1], y]
        self.rise = np.r_[np.zeros((1, 7), Real), rise, np.zeros((1, 7), Real)]

    def piece(self, value):
        return np.searchsorted(self.x, value, "right")

    def at(self, piece, value):
        """(..., 7): extinction, colour and emission, by the line of that piece."""
        return self.start[piece] + (value - self.from_[piece])[..., None] * self.rise[piece]


def cubic(f):
    """Coefficients (n, 4) of the cubics with values f (n, 4) at 0, 1/3, 2/3 and 1."""
    a, b, c, d = f.T
    c1 = (-11 * a + 18 * b - 9 * c + 2 * d) / 2
    c2 = 9 * (2 * a - 5 * b + 4 * c - d) / 2
    c3 = 9 * (-a + 3 * b - 3 * c + d) / 2
    return np.stack([a, c1, c2, c3], axis=1)


def value(c, x):
    return ((c[:, 3, None] * x + c[:, 2, None]) * x + c[:, 1, None]) * x + c[:, 0, None]


def turns(c):
    """(n, 2): where the slope is 0 within 0..1, else 0."""
    a, b, d = 3 * c[:, 3], 2 * c[:, 2], c[:, 1]
    with np.errstate(all="ignore"):
        q = -(b + np.copysign(np.sqrt(b * b - 4 * a * d), b)) / 2
        x = np.stack([q / a, d / q], axis=1)
    return np.where((x > 0) & (x < 1), x, 0)


def cuts(c, ramp: Ramp, ends):
    """(n, m), ascending: where cubics begin, turn, pass knots and end within ends (n, 2)."""
    n = len(c)
    stops = np.sort(np.concatenate([ends, np.clip(turns(c), ends[:, :1], ends[:, 1:])], axis=1))
    low, high = (np.repeat(stops[:, side][:, :, None], len(ramp.knots), axis=2)
                 for side in (slice(0, 3), slice(1, 4)))  # fmt: skip
    low, high = low.reshape(n, -1).copy(), high.reshape(n, -1).copy()
    level = np.tile(ramp.knots, 3)
    below = value(c, low) < level
    crosses = below != (value(c, high) < level)
    high = np.where(crosses, high, low)
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        stays = (value(c, middle) < level) == below
        low, high = np.where(stays, middle, low), np.where(stays, high, middle)
    return np.sort(np.concatenate([stops, high], axis=1))


def through_cells(c, ends, length, ramp: Ramp):
    """Colour (n, 3) and transmittance (n,) of cubics, each seen alone.

    c: (n, 4); ends: (n, 2), the part of 0..1; length: (n,) of 0..1.
    """
    stops = cuts(c, ramp, ends)
    color, left = np.zeros((len(c), 3), Real), np.ones(len(c), Real)
    for k in range(stops.shape[1] - 1):
        wide = np.flatnonzero(stops[:, k + 1] > stops[:, k])
        if not len(wide):
            continue
        own = c[wide]
        width = stops[wide, k + 1] - stops[wide, k]
        deepest = float((width * length[wide]).max() * ramp.start[:, 0].max())
        panels = PANELS * (1 + int(deepest / DEEPEST))
        step = width / panels
        middle = (stops[wide, k + 1] + stops[wide, k]) / 2
        piece = ramp.piece(value(own, middle[:, None])[:, 0])[:, None]
        for panel in range(panels):
            a = stops[wide, k] + panel * step
            x = a[:, None] + step[:, None] * (1 + NODES) / 2
            inner = a[:, None, None] + (x - a[:, None])[:, :, None] * (1 + NODES) / 2
            at = value(own, inner.reshape(len(own), -1)).reshape(inner.shape)
            depth = (ramp.at(piece[:, :, None], at)[..., 0] * WEIGHTS).sum(-1)
            depth *= (x - a[:, None]) * length[wide, None] / 2
            light = ramp.at(piece, value(own, x))
            weight = np.exp(-depth) * WEIGHTS * (step * length[wide] / 2)[:, None]
            radiance = light[..., :1] * light[..., 1:4] + light[..., 4:]
            color[wide] += left[wide, None] * (weight[..., None] * radiance).sum(1)
            whole = (light[..., 0] * WEIGHTS).sum(-1) * step * length[wide] / 2
            left[wide] *= np.exp(-whole)
    return color, left


def corners(samples, cell):
    """(n, 8): x fastest."""
    i, j, k = cell.T
    return np.stack([samples[k + (b >> 2), j + (b >> 1 & 1), i + (b & 1)] for b in range(8)], 1)


def trilinear(corner, p):
    """corner: (n, 8); p: (n, m, 3), in the cell; returns (n, m)."""
    f = np.broadcast_to(corner[:, None], (*p.shape[:2], 8))
    for a in (0, 1, 2):
        f = f[..., ::2] + p[..., a, None] * (f[..., 1::2] - f[..., ::2])
    return f[..., 0]


def crossings(origins, directions, size):
    """(n, m), ascending: t of the planes of samples along rays, within the lattice; NaN beyond."""
    t = []
    with np.errstate(all="ignore"):
        for a in range(3):
            planes = np.arange(size[a], dtype=Real)
            t.append((planes - origins[:, a, None]) / directions[:, a, None])
    near = np.max([np.min([x[:, 0], x[:, -1]], 0) for x in t], 0)
    far = np.min([np.max([x[:, 0], x[:, -1]], 0) for x in t], 0)
    sorted_t = np.sort(np.concatenate(t, axis=1), axis=1)
    within = (sorted_t >= near[:, None]) & (sorted_t <= far[:, None])
    return np.where(within, sorted_t, np.nan)


def cubics(samples, origins, directions, t0, t1):
    """Of rays between t0 and t1 (n,), in one cell: coefficients (n, 4), and its corners (n, 8)."""
    middle = origins + ((t0 + t1) / 2)[:, None] * directions
    top = np.array(samples.shape[::-1]) - 2
    cell = np.clip(np.floor(middle).astype(int), 0, top)
    t = t0[:, None] + (t1 - t0)[:, None] * np.arange(4, dtype=Real) / 3
    p = origins[:, None] + t[:, :, None] * directions[:, None] - cell[:, None]
    corner = corners(samples, cell).astype(Real)
    return cubic(trilinear(corner, p)), corner


def light(samples, origins, directions, ramp: Ramp, matrix=None, t_min=0.0, t_max=np.inf):
    """Colour (n, 3) and transmittance (n,) of rays through samples (nz, ny, nx), without end.

    matrix: object_from_index; origins and directions (n, 3) in object space, no component 0 in
    index space.
    """
    matrix = np.eye(4) if matrix is None else matrix
    inverse = np.linalg.inv(matrix)
    o = (origins @ inverse[:3, :3].T + inverse[:3, 3]).astype(Real)
    d = (directions @ inverse[:3, :3].T).astype(Real)
    speed = np.sqrt((np.asarray(directions, Real) ** 2).sum(1))
    t = np.clip(crossings(o, d, samples.shape[::-1]), t_min, t_max)
    color, left = np.zeros((len(o), 3), Real), np.ones(len(o), Real)
    ray, at = np.nonzero(t[:, 1:] > t[:, :-1])
    t0, t1 = t[ray, at], t[ray, at + 1]
    c, corner = cubics(samples, o[ray], d[ray], t0, t1)
    low, high = corner.min(1), corner.max(1)
    seen = np.zeros(len(ray), bool)
    for x in (low, high, *(np.clip(k, low, high) for k in ramp.knots)):
        for piece in (ramp.piece(x), np.searchsorted(ramp.x, x, "left")):
            seen |= (ramp.at(piece, x)[:, [0, 4, 5, 6]] > 0).any(1)
    ray, c, t0, t1 = ray[seen], c[seen], t0[seen], t1[seen]
    ends = np.broadcast_to(np.array([0, 1], Real), (len(ray), 2))
    own, clear = through_cells(c, ends, (t1 - t0) * speed[ray], ramp)
    order = np.arange(len(ray)) - np.searchsorted(ray, ray)
    for k in range(order.max(initial=-1) + 1):
        now = order == k
        color[ray[now]] += left[ray[now], None] * own[now]
        left[ray[now]] *= clear[now]
    return color, left


def light_of_many(samples, origins, directions, ramp: Ramp, matrix=None):
    """As light, without emission, by one thread of compiled code: (n, 4) float64.

    Raises LeapRayError where this Python has no compiler.
    """
    assert ramp.knots_in_c is not None and len(ramp.knots_in_c) <= 64
    inverse = np.linalg.inv(np.eye(4) if matrix is None else matrix)
    values = np.ascontiguousarray(samples, np.float64)
    o = np.ascontiguousarray(origins @ inverse[:3, :3].T + inverse[:3, 3])
    d = np.ascontiguousarray(directions @ inverse[:3, :3].T)
    speed = np.linalg.norm(directions, axis=1)
    size = np.array(values.shape[::-1], np.int64)
    x, y = (np.ascontiguousarray(part) for part in (ramp.knots_in_c[:, 0], ramp.knots_in_c[:, 1:]))
    rule = [np.ascontiguousarray(part, np.float64) for part in (NODES, WEIGHTS)]
    found = np.empty((len(o), 4))
    assert library("light_integrals").light_along(
        *map(pointer, (values, size)), ctypes.c_int64(len(o)), *map(pointer, (o, d, speed)),
        ctypes.c_int32(len(x)), *map(pointer, (x, y, *rule, found)),
    )  # fmt: skip
    return found
