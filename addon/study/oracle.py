# SPDX-License-Identifier: GPL-3.0-or-later
"""The integer oracle (oracle.c), compiled on first use, and rays for it (no bpy)."""

from __future__ import annotations

import ctypes

import numpy as np

from .compiled import in_parts, library, pointer

SHIFT = 16  # origins are multiples of 2^-16
VERDICTS = ("sound", "missed", "late", "no object", "not touched")


def object_cells(samples, threshold):
    """Cells -1..n-1 per axis (nz+1, ny+1, nx+1) whose largest sample is at or above T."""
    cells = np.pad(samples >= threshold, 1)
    for axis in range(3):
        rows = np.moveaxis(cells, axis, 0)
        cells = np.moveaxis(rows[:-1] | rows[1:], 0, axis)
    return cells


def judge(objects, origins, directions, hit, cells, planes=None):
    """Verdict (n,) on every claim, an index into VERDICTS, and whether a surface cell is pierced.

    origins: multiples of 2^-16; directions: whole numbers. planes: x, y and z of the planes
    -1..n of a rectilinear volume, multiples of 2^-16.
    """
    grid = np.ascontiguousarray(objects, np.uint8)
    size = np.array(grid.shape[::-1], np.int64)
    scaled = np.asarray(origins) * 2.0**SHIFT
    o, d = scaled.astype(np.int64), np.asarray(directions).astype(np.int64)
    assert (o == scaled).all() and (d == directions).all()  # the oracle judges exact input only
    n = len(o)
    verdict, exact = np.zeros(n, np.uint8), np.zeros(n, np.uint8)
    claims = np.ascontiguousarray(cells, np.int32)
    hits = np.ascontiguousarray(hit, np.uint8)
    o, d = np.ascontiguousarray(o), np.ascontiguousarray(d)
    tables: list = [None] * 3 if planes is None else [_whole(axis) for axis in planes]
    assert planes is None or [len(axis) for axis in tables] == list(size + 1)
    places = [None if axis is None else pointer(axis) for axis in tables]

    def part(first, last):
        of = slice(first, last)
        library("oracle").oracle_judge(
            pointer(grid), pointer(size), pointer(o[of]), pointer(d[of]),
            ctypes.c_int64(last - first), ctypes.c_int(SHIFT), *places,
            pointer(hits[of]), pointer(claims[of]), pointer(verdict[of]), pointer(exact[of]),
        )  # fmt: skip

    in_parts(part, n)
    return verdict, exact.astype(bool)


def path(origin, direction, low, high):
    """The cells (n, 3) that a ray pierces inside low..high, high exclusive, in order."""
    o = (np.asarray(origin) * 2.0**SHIFT).astype(np.int64)
    d, lo, hi = (np.ascontiguousarray(part, np.int64) for part in (direction, low, high))
    cells = np.empty((int((hi - lo).sum()), 3), np.int32)
    found = library("oracle").oracle_path
    found.restype = ctypes.c_int64
    n = found(
        pointer(o), pointer(d), ctypes.c_int(SHIFT), pointer(lo), pointer(hi), pointer(cells),
        ctypes.c_int64(len(cells)),
    )  # fmt: skip
    return cells[:n]


def _whole(axis):
    """Planes in units of 2^-16."""
    scaled = np.asarray(axis) * 2.0**SHIFT
    assert (scaled == np.round(scaled)).all()
    return np.ascontiguousarray(scaled, np.int64)


class Bench:
    """Rays in a volume, for claims of several traversers; equal claims are judged once."""

    def __init__(self, objects, origins, directions):
        self.objects, self.rays = objects, (origins, directions)
        self.hit = None

    def judge(self, hit, cells):
        """As judge()."""
        if self.hit is None:
            self.verdict, self.pierced = judge(self.objects, *self.rays, hit, cells)
            self.hit, self.cells = hit.copy(), cells.copy()
            return self.verdict, self.pierced
        same = (hit == self.hit) & (~hit | (cells == self.cells).all(axis=1))
        verdict = self.verdict.copy()
        other = np.flatnonzero(~same)
        if len(other):
            origins, directions = (part[other] for part in self.rays)
            verdict[other], _ = judge(self.objects, origins, directions, hit[other], cells[other])
        return verdict, self.pierced


def generic_rays(rng, n, size):
    """Rays from all around and from inside, towards points of the volume; a tenth anywhere."""
    span = np.array(size) + 2.0
    origins = rng.uniform(-1.5, 2.5, (n, 3)) * span
    inside = rng.random(n) < 0.3
    origins[inside] = rng.random((inside.sum(), 3)) * span - 1.0
    targets = rng.random((n, 3)) * span - 1.0
    loose = rng.random(n) < 0.1
    targets[loose] = rng.uniform(-1, 2, (loose.sum(), 3)) * span
    origins = np.round(origins * 2.0**SHIFT) / 2.0**SHIFT
    directions = np.round((targets - origins) * 2.0**12)
    directions[(directions == 0).all(axis=1)] = (1, 2, 3)
    return origins, directions


def lattice_rays(rng, n, size):
    """Rays aligned with the lattice: starts on corners, edges, faces and centres, inside and out;
    directions with zero, negative zero and negative components, some nearly parallel to an axis."""
    span = np.array(size) + 2
    origins = rng.integers(-4, 2 * span + 4, (n, 3)) / 2.0 - 1.0
    directions = rng.integers(-2, 3, (n, 3)).astype(float)
    steep = rng.random(n) < 0.1
    directions[steep] *= np.where(rng.random((steep.sum(), 3)) < 0.5, 2.0**30, 1.0)
    directions[(directions == 0).all(axis=1)] = (0, 0, -1)
    negative_zero = (directions == 0) & (rng.random((n, 3)) < 0.5)
    directions[negative_zero] = -0.0
    return origins, directions
