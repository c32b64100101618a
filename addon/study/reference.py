# SPDX-License-Identifier: GPL-3.0-or-later
"""Where a ray first crosses the trilinear field, without the core's walk or roots (no bpy).

All planes that a ray passes are sorted, and between two of them the field is a cubic, taken
from its values at four points. Slow, in f64, for studies alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

PART = 2000  # rays at a time
HALVINGS = 60
OFF = 1e-6  # voxels: a crossing farther from the first one than this is another, or a poor one
NEAR = 1e-9  # of the field: an extremum this close to the threshold may be on either side
CORNERS = [(dz, dy, dx) for dz in (0, 1) for dy in (0, 1) for dx in (0, 1)]


@dataclass(frozen=True)
class Crossings:
    """One entry per ray."""

    t: NDArray[np.float64]  # infinity where there is none
    doubtful: NDArray[np.bool_]  # rounding may decide whether this is the first one


def first_crossing(samples, origins, directions, threshold: float = 0.5) -> Crossings:
    """The first change of sides along rays (n, 3) in index space, from t = 0.

    samples (nz, ny, nx) in 0..1, and 0 outside.
    """
    field = np.pad(np.asarray(samples, np.float64), 2)
    size = np.array(field.shape[::-1])
    mixed = surface_cells(field, threshold)
    t = np.full(len(origins), np.inf)
    doubtful = np.zeros(len(origins), bool)
    for first in range(0, len(origins), PART):
        part = slice(first, first + PART)
        o, d = np.asarray(origins[part]) + 2.0, np.asarray(directions[part], float)
        t[part], doubtful[part] = _part(field, mixed, size, o, d, threshold)
    return Crossings(t, doubtful)


@dataclass(frozen=True)
class Crossing:
    """A hit test with a root finder in a case: how far it is from the field's first crossing."""

    case: str
    hit_test: str
    root: str
    rays: int  # without the doubtful ones
    doubtful: int
    crossing: int  # rays that have a first crossing
    missed: int
    false: int  # hits of rays that cross nothing
    off: int  # hits more than OFF voxels from the first crossing
    late: int  # of those, more than a voxel behind it
    error_99: float  # voxels
    error_max: float

    @property
    def faults(self) -> int:
        return self.missed + self.false + self.off

    @property
    def fraction(self) -> float:
        return self.faults / (self.crossing or self.rays or 1)


def judge(case: str, hit_test: str, root: str, want: Crossings, t, length) -> Crossing:
    """What became of t (n,), along directions of that length (n,) in voxels."""
    sure = ~want.doubtful
    has, got = np.isfinite(want.t) & sure, np.isfinite(t) & sure
    behind = (t[has & got] - want.t[has & got]) * length[has & got]
    error = np.abs(behind)
    return Crossing(
        case,
        hit_test,
        root,
        int(sure.sum()),
        int((~sure).sum()),
        int(has.sum()),
        int((has & ~got).sum()),
        int((got & ~has).sum()),
        int((error > OFF).sum()),
        int((behind > 1.0).sum()),
        float(np.percentile(error, 99)) if len(error) else 0.0,
        float(error.max(initial=0.0)),
    )


def surface_cells(field: NDArray, threshold: float) -> NDArray[np.bool_]:
    """Cells between eight samples on both sides; one less along each axis."""
    above = field >= threshold
    nz, ny, nx = (n - 1 for n in field.shape)
    parts = [above[z : z + nz, y : y + ny, x : x + nx] for z, y, x in CORNERS]
    return np.logical_or.reduce(parts) & ~np.logical_and.reduce(parts)


def _part(field, mixed, size, o, d, threshold):
    with np.errstate(divide="ignore", invalid="ignore"):
        planes = [(np.arange(size[a]) - o[:, a, None]) / d[:, a, None] for a in range(3)]
    passed = np.concatenate([np.zeros((len(o), 1)), *planes], axis=1)
    passed[~(passed >= 0)] = np.inf
    passed.sort(axis=1)
    begin, end = passed[:, :-1], passed[:, 1:]
    ray, slot = np.nonzero(np.isfinite(end) & (end > begin))
    begin, end = begin[ray, slot], end[ray, slot]
    cell = np.floor(o[ray] + (0.5 * (begin + end))[:, None] * d[ray]).astype(np.int64)
    inside = ((cell >= 0) & (cell < size - 1)).all(axis=1)
    ray, begin, end, cell = ray[inside], begin[inside], end[inside], cell[inside]
    crossing = mixed[cell[:, 2], cell[:, 1], cell[:, 0]]
    ray, begin, end, cell = ray[crossing], begin[crossing], end[crossing], cell[crossing]
    above = _side_at_start(field, size, o, threshold)[ray]
    points = [o[ray] + (begin + x * (end - begin))[:, None] * d[ray] for x in (0, 1 / 3, 2 / 3, 1)]
    c = cubic(*(trilinear(field, cell, p - cell) - threshold for p in points))
    x, least = first_root(c, above)
    hit = np.isfinite(x)
    t = np.full(len(o), np.inf)
    rays, which = np.unique(ray[hit], return_index=True)
    which = np.flatnonzero(hit)[which]
    t[rays] = begin[which] + x[which] * (end[which] - begin[which])
    doubt = np.zeros(len(o), bool)
    doubt[ray[(least < NEAR) & (begin <= t[ray])]] = True
    return t, doubt


def first_root(c, above):
    """The first x (n,) in 0..1 where cubics c (n, 4) leave their side of 0, infinity without one,
    and the least |c| (n,) at ends and extrema, where a change of sides may come or go."""
    x = np.column_stack([np.zeros(len(c)), *extrema(c), np.ones(len(c))])
    f = polynomial(c[:, None], x)
    changed = (f >= 0) != above[:, None]
    hit = np.flatnonzero(changed.any(axis=1))
    last = changed[hit].argmax(axis=1)
    low, high = x[hit, np.maximum(last - 1, 0)], x[hit, last]
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        beyond = (polynomial(c[hit], middle) >= 0) != above[hit]
        low, high = np.where(beyond, low, middle), np.where(beyond, middle, high)
    found = np.full(len(c), np.inf)
    found[hit] = high
    return found, np.abs(f).min(axis=1)


def _side_at_start(field, size, o, threshold):
    cell = np.clip(np.floor(o), 0, size - 2).astype(np.int64)
    outside = ((o < 0) | (o > size - 1)).any(axis=1)
    return (trilinear(field, cell, o - cell) >= threshold) & ~outside


def trilinear(field, cell, p):
    """The field (n,) at p (n, 3) in cell coordinates."""
    total = np.zeros(len(cell))
    for dz, dy, dx in CORNERS:
        weight = np.where(dx, p[:, 0], 1 - p[:, 0]) * np.where(dy, p[:, 1], 1 - p[:, 1])
        weight = weight * np.where(dz, p[:, 2], 1 - p[:, 2])
        total += weight * field[cell[:, 2] + dz, cell[:, 1] + dy, cell[:, 0] + dx]
    return total


def cubic(f0, f1, f2, f3):
    """Coefficients (n, 4), ascending, of the cubic through values at 0, 1/3, 2/3 and 1."""
    c1 = -5.5 * f0 + 9 * f1 - 4.5 * f2 + f3
    c2 = 9 * f0 - 22.5 * f1 + 18 * f2 - 4.5 * f3
    c3 = -4.5 * f0 + 13.5 * f1 - 13.5 * f2 + 4.5 * f3
    return np.stack([f0, c1, c2, c3], axis=-1)


def polynomial(c, x):
    return ((c[..., 3] * x + c[..., 2]) * x + c[..., 1]) * x + c[..., 0]


def extrema(c):
    """Both extrema in 0..1, ascending; where there is none, 0 stands for it."""
    a, b, k = 3 * c[:, 3], 2 * c[:, 2], c[:, 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        q = -0.5 * (b + np.copysign(np.sqrt(b * b - 4 * a * k), b))
        both = np.stack([q / a, k / q], axis=1)
    both[~((both > 0) & (both < 1))] = 0.0
    both.sort(axis=1)
    return both[:, 0], both[:, 1]
