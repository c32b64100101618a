# SPDX-License-Identifier: GPL-3.0-or-later
"""Looks of fields as transfer functions: few knots, between which all is linear (no bpy)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import leapray

from .. import model

SAMPLES = 4097  # at which a look is asked
ACCURACY = 1e-4  # what leaving out knots may change, as a share of the largest
GREY = 0.02  # channels of extinction that differ by less are not told,
EVEN = 0.01  # nor anisotropy
TINY = float(np.finfo(np.float64).tiny)
JUMP = 0.01  # a share of all values within which a look jumps: ramps are tables of 256 colours


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
    values = np.linspace(low, high, SAMPLES) if high > low else np.array([low])
    extinction, emission = look.extinction(values), look.emission(values)
    scattering, forward = look.scattering(values), look.forward(values)
    if not np.isfinite(np.stack([extinction, emission, scattering, forward])).all():
        raise leapray.LeapRayError("its look has a value that is no number (NaN or infinite)")
    mean = extinction.mean(1)
    scattering = np.where(mean[:, None] > 0, scattering, 0.0)
    grey = bool((np.ptp(extinction, axis=1) <= GREY * mean.max(initial=0.0)).all())
    columns = np.column_stack([mean, emission, scattering])
    kept = knots(values, columns)
    width = _width(values[kept], columns[kept])
    full = look.modulation * width / voxel
    if look.modulation > 0:
        full = max(full, TINY)  # of one value nothing is seen
    dark = (0.0, 0.0, 0.0)
    made = leapray.TransferFunction(
        values[kept], mean[kept], dark, emission[kept], scattering[kept], full
    )
    total = scattering.sum()
    anisotropy = float(np.clip(forward.sum() / total, -1, 1)) if total > 0 else 0.0
    off = np.abs(forward - anisotropy * scattering).max(initial=0.0)
    even = bool(off <= EVEN * scattering.max(initial=0.0))
    return Transfer(made, look.shading.amount > 0, bool(total > 0), anisotropy, width, grey, even)


def _width(values: NDArray[np.float64], columns: NDArray[np.float64]) -> float:
    """Of the range of values over which a look changes; of a jump, of all values."""
    whole = float(values[-1] - values[0])
    turns = np.flatnonzero((np.diff(columns, axis=0) != 0).any(1))
    width = float(values[turns[-1] + 1] - values[turns[0]]) if len(turns) else 0.0
    return width if width > JUMP * whole else whole


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


def knots(x: NDArray[np.float64], columns: NDArray[np.float64]) -> NDArray[np.int64]:
    """Which of the points (n,) are needed for lines between them to give columns (n, k).

    Source: Douglas and Peucker 1973.
    """
    scale = np.maximum(np.abs(columns).max(0), np.finfo(float).tiny)
    columns = columns / scale
    kept = {0, len(x) - 1}
    ranges = [(0, len(x) - 1)]
    while ranges:
        first, last = ranges.pop()
        if last - first < 2:
            continue
        share = ((x[first : last + 1] - x[first]) / (x[last] - x[first]))[:, None]
        line = (1 - share) * columns[first] + share * columns[last]
        off = np.abs(columns[first : last + 1] - line).max(1)
        worst = int(off.argmax())
        if off[worst] > ACCURACY:
            kept.add(first + worst)
            ranges += [(first, first + worst), (first + worst, last)]
    return np.array(sorted(kept))
