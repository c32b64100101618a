# SPDX-License-Identifier: GPL-3.0-or-later
"""Looks of fields as transfer functions: few knots, between which all is linear (no bpy)."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import leapray

from .. import model
from ..arrays import FLOAT_MOST

SAMPLES = 4097  # at which a look is asked at equal distances, before it is asked where it bends
BETWEEN = 129  # and between two values that its nodes name
OCTAVES = 128  # of distances from values that are named, each halved from the one before,
PER_OCTAVE = 16  # with so many values in each
MOST_NAMED = 64  # values that nodes name
MOST_ASKED = 1 << 15  # knots that are found: half of what a transfer function may have
FINEST = float(np.finfo(np.float32).eps)  # of a value, by which samples are told apart at least,
LEAST = float(np.finfo(np.float32).tiny)  # and near 0
ROUNDING = 16 * FINEST  # of what nodes make of a value, with f32
ACCURACY = 1e-4  # what leaving out knots may change, as a share of the largest
DENSE = 1e10  # over a voxel: as good as any surface; of more rays would not find out again
MOST = 1e30  # of light that is emitted
GREY = 0.02  # channels of extinction that differ by less are not told,
EVEN = 0.01  # nor anisotropy
TINY = float(np.finfo(np.float64).tiny)
JUMP = 0.01  # a share of a ramp's values within which it jumps: ramps are tables of 256 colours


@dataclass(frozen=True)
class Transfer:
    """A look as the core takes it."""

    function: leapray.TransferFunction
    shaded: bool  # by its gradient
    scatters: bool
    anisotropy: float  # mean cosine of what is scattered
    width: float  # of the range of values over which the look changes; 0: there is but one value
    grey: bool  # extinction is the same for all colours; else it is their mean
    even: bool  # the anisotropy is the same for all values; else it is their mean

    def doubts(self, name: str) -> list[str]:
        """Sentences on what is not as the look of a field of that name has it."""
        told = []
        if self.shaded and not self.scatters:
            told.append(
                f"{name!r} is not shaded by its gradient, for its shader scatters no light."
            )
        if not self.grey:
            told.append(f"{name!r} absorbs all colors alike: the mean of its own.")
        if not self.even:
            told.append(
                f"All values of {name!r} scatter by one anisotropy, the mean of their own: "
                f"{self.anisotropy:.2f}."
            )
        return told


def transfer(look: model.Look, low: float, high: float, voxel: float = 1.0) -> Transfer:
    """A look over values from low to high, by which gradients are told as changes over that length.

    Raises LeapRayError where a number of it is none.
    """
    values, columns = _where_it_bends(look, low, high, voxel)
    extinction, forward = columns[:, 7:10], columns[:, 10:]
    columns = columns[:, :7]
    mean, emission, scattering = columns[:, 0], columns[:, 1:4], columns[:, 4:]
    grey = bool((np.ptp(extinction, axis=1) <= GREY * mean.max(initial=0.0)).all())
    kept = knots(values, columns, 1.0 / voxel)
    width = _width(values, columns, look.named)
    full = look.modulation * width / voxel
    if look.modulation > 0:
        full = max(full, TINY)  # of one value nothing is seen
    dark = (0.0, 0.0, 0.0)
    made = leapray.TransferFunction(
        values[kept], mean[kept], dark, emission[kept], scattering[kept], full
    )
    weight = np.gradient(values)[:, None] if len(values) > 1 else 1.0
    total = (weight * scattering).sum()
    anisotropy = float(np.clip((weight * forward).sum() / total, -1, 1)) if total > 0 else 0.0
    off = np.abs(forward - anisotropy * scattering).max(initial=0.0)
    even = bool(off <= EVEN * scattering.max(initial=0.0))
    return Transfer(made, look.shading.amount > 0, bool(total > 0), anisotropy, width, grey, even)


def _where_it_bends(
    look: model.Look, low: float, high: float, voxel: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Values (n,) between which all of a look is linear, and of them its mean extinction, emission,
    scattering, extinction and forward scattering, in columns (n, 13). Raises LeapRayError where a
    number of it is none."""
    dense = min(DENSE / voxel, MOST)

    def columns(values: NDArray[np.float64]) -> NDArray[np.float64]:
        parts = look.extinction, look.emission, look.scattering, look.forward
        extinction, emission, scattering, forward = (part(values) for part in parts)
        if not np.isfinite(np.stack([extinction, emission, scattering, forward])).all():
            raise leapray.LeapRayError("its look has a value that is no number (NaN or infinite)")
        largest = np.maximum(extinction, scattering).max(1)
        share = np.minimum(1.0, dense / np.maximum(largest, dense))[:, None]
        extinction, emission, scattering, forward = (
            share * each for each in (extinction, emission, scattering, forward)
        )
        mean = extinction.mean(1)
        scattering = np.where(mean[:, None] > 0, scattering, 0.0)
        return np.column_stack([mean, np.minimum(emission, MOST), scattering, extinction, forward])

    return bends(columns, places(low, high, look.named), 1.0 / voxel)


def _width(
    values: NDArray[np.float64], columns: NDArray[np.float64], named: Sequence[float]
) -> float:
    """Of the range of values over which a look changes; of a jump, of all values. Jumps are narrow
    beside what lies between the values that are named next below and above."""
    whole = float(values[-1] - values[0])
    least = ROUNDING * np.maximum(np.abs(columns).max(0), TINY)
    begun = np.flatnonzero((np.abs(columns - columns[0]) > least).any(1))
    going = np.flatnonzero((np.abs(columns - columns[-1]) > least).any(1))
    if not len(begun) or not len(going):
        return whole
    low, high = float(values[begun[0] - 1]), float(values[going[-1] + 1])
    slack = JUMP * (high - low)
    below = max(v for v in (*named, float(values[0])) if v <= low + slack)
    above = min(v for v in (*named, float(values[-1])) if v >= high - slack)
    return high - low if high - low > JUMP * min(above - below, whole) else whole


def light_of(field: model.Field, transfer: Transfer) -> dict[str, Any]:
    """How instances of a field scatter light, as members of leapray.Instance."""
    assert field.look is not None
    shading = field.look.shading
    scale = shading.scale * voxel(field) / transfer.width if transfer.width > 0 else 0.0
    return {
        "anisotropy": transfer.anisotropy,
        "phase": field.look.phase,
        "gradient_shading": shading.amount,
        "gradient_scale": scale,
        "roughness": shading.roughness,
        "specular": shading.specular,
    }


def voxel(field: model.Field) -> float:
    """The side of a cube as large as a voxel of the data, in object space."""
    matrix = np.asarray(field.grid.world_from_index)[:3, :3]
    return float(abs(np.linalg.det(matrix)) ** (1 / 3))


def unit(look: model.Look, world_from_object: NDArray[np.float64]) -> float:
    """The length in the world that extinction and emission are for, as in Cycles."""
    if look.per_world_unit:
        return 1.0
    return float(np.linalg.norm(np.asarray(world_from_object)[:3, :3].sum(1)) / np.sqrt(3))


def places(low: float, high: float, named: Sequence[float] = ()) -> NDArray[np.float64]:
    """Values from low to high, the closer the nearer they are to the ends, to 0 and to named ones:
    what a look does between two tissues is found as well where a single voxel is a million."""
    low, high = (float(np.clip(end, -FLOAT_MOST, FLOAT_MOST)) for end in (low, high))
    if not high > low:
        return np.array([low])
    marks = np.unique([low, high, *(v for v in (0.0, *named[:MOST_NAMED]) if low < v < high)])
    steps = (high - low) * 0.5 ** (np.arange(OCTAVES * PER_OCTAVE) / PER_OCTAVE)
    near = [marks, *(m + s * steps for m in marks for s in (-1.0, 1.0))]
    between = [np.linspace(a, b, BETWEEN) for a, b in itertools.pairwise(marks)]
    found = np.concatenate([np.linspace(low, high, SAMPLES), *near, *between])
    return _apart(found[(found >= low) & (found <= high)])


def _apart(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values in their order, of those that samples do not tell apart the first and the last."""
    values = np.unique(values)
    far = np.diff(values) > np.maximum(FINEST * np.abs(values[1:]), LEAST)
    return values[np.concatenate([[True], far]) | np.concatenate([far, [True]])]


def bends(
    columns: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    values: NDArray[np.float64],
    most: float = np.inf,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Values (m,), and columns (m, k) of them: halved between values (n,) wherever columns are not
    linear there or cease to be 0, until they are or samples tell values no more apart; most: as of
    knots."""
    found = columns(values)
    open_ = np.arange(len(values) - 1)  # intervals
    while len(open_) and len(values) < MOST_ASKED:
        middle = values[open_] + 0.5 * (values[open_ + 1] - values[open_])
        told = columns(middle)
        line = 0.5 * (found[open_] + found[open_ + 1])
        off = np.abs(told - line) / _scale(found, most, told)
        wide = np.diff(values)[open_] > np.maximum(FINEST * np.abs(middle), LEAST)
        shown = found.any(1)
        odd = (off > ACCURACY / 2).any(1) | (shown[open_] != shown[open_ + 1])
        bent = np.flatnonzero(wide & odd)[: MOST_ASKED - len(values)]
        after = open_[bent] + 1
        values = np.insert(values, after, middle[bent])
        found = np.insert(found, after, told[bent], axis=0)
        first = open_[bent] + np.arange(len(bent))
        open_ = np.column_stack([first, first + 1]).ravel()
    return values, found


def _scale(columns: NDArray, most: float, own: NDArray) -> NDArray[np.float64]:
    """What own of the columns may be off in proportion to: the largest, up to a bound, from which
    on it is what they are themselves."""
    largest = np.maximum(np.abs(columns).max(0), TINY)
    return np.maximum(np.minimum(largest, most), np.abs(own))


def knots(
    x: NDArray[np.float64], columns: NDArray[np.float64], most: float = np.inf
) -> NDArray[np.int64]:
    """Which of the points (n,) are needed for lines between them to give columns (n, k), and 0
    wherever all are, so that nothing is seen there.

    most: the largest number that a share of is nothing; larger ones count as they are.
    Source: Douglas and Peucker 1973.
    """
    scale = _scale(columns, most, columns)
    hidden = ~columns.any(1)
    ends = np.flatnonzero(hidden[:-1] != hidden[1:])
    kept = {0, len(x) - 1, *np.where(hidden[ends], ends, ends + 1).tolist()}
    ranges = list(itertools.pairwise(sorted(kept)))
    while ranges:
        first, last = ranges.pop()
        if last - first < 2:
            continue
        share = ((x[first : last + 1] - x[first]) / (x[last] - x[first]))[:, None]
        line = (1 - share) * columns[first] + share * columns[last]
        off = (np.abs(columns[first : last + 1] - line) / scale[first : last + 1]).max(1)
        worst = int(off.argmax())
        if off[worst] > ACCURACY:
            kept.add(first + worst)
            ranges += [(first, first + worst), (first + worst, last)]
    return np.array(sorted(kept))
