# SPDX-License-Identifier: GPL-3.0-or-later
"""Slices that each know their place, as one lattice: sorted, counted, made even."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..file_samples import Samples, Spool
from .common import numbers, refuse

EVEN = 0.01  # of a slice's spacing: deviations of positions that rounding in files explains
SAME = 0.01  # of it: slices nearer than that lie in one place
MOST_FILLED = 4  # even slices for each that there is


class Placed(Protocol):
    """What a slice must know of itself; see dicom.Slice."""

    @property
    def axes(self) -> tuple[float, ...] | None: ...
    @property
    def position(self) -> tuple[float, ...] | None: ...
    @property
    def spacing(self) -> tuple[float, float] | None: ...
    @property
    def thickness(self) -> float: ...
    @property
    def order(self) -> tuple[float, ...]: ...


S = TypeVar("S", bound=Placed)
Fill = Callable[[Samples], Samples]  # samples of the slices (n, ny, nx) -> of the lattice
Frame = tuple[list[S], Fill]


def place(
    path: Path, slices: Sequence[S], told: list[str]
) -> tuple[list[Frame[S]], NDArray[np.float64]]:
    """The frames of slices, each sorted along the normal, and where their lattice lies.

    Appends sentences on what was amiss. Raises LeapRayError where slices make no lattice.
    """
    first = slices[0]
    along = np.array(first.axes or (1, 0, 0, 0, 1, 0), np.float64).reshape(2, 3)
    lengths = np.linalg.norm(along, axis=1)
    normal = np.cross(*along)
    if not (lengths > 0).all() or np.linalg.norm(normal) < 0.1 * lengths.prod():
        raise refuse(path, "its rows and columns lie on one line")
    along, normal = along / lengths[:, None], normal / np.linalg.norm(normal)
    spacing = first.spacing
    if spacing is None or min(spacing) <= 0:
        told.append(f"{path} does not say how far its pixels lie apart; 1 mm was taken")
        spacing = (1.0, 1.0)
    matrix = np.eye(4)
    matrix[:3, 0], matrix[:3, 1] = along[0] * spacing[1], along[1] * spacing[0]
    if first.axes is None or any(each.position is None for each in slices):
        told.append(f"{path} does not say where its slices lie; they follow their numbers")
        step = first.thickness or 1.0
        matrix[:3, 2] = normal * step
        return [(sorted(slices, key=lambda each: each.order), lambda samples: samples)], matrix
    return _by_position(path, slices, normal, matrix, told)


def _by_position(
    path: Path,
    slices: Sequence[S],
    normal: NDArray[np.float64],
    matrix: NDArray[np.float64],
    told: list[str],
) -> tuple[list[Frame[S]], NDArray[np.float64]]:
    positions = np.array([each.position for each in slices], np.float64)
    heights = positions @ normal
    ranks = sorted(range(len(slices)), key=lambda k: (heights[k], slices[k].order))
    ordered, positions, heights = [slices[k] for k in ranks], positions[ranks], heights[ranks]
    starts = _starts(heights)
    frames = _frames(path, ordered, starts, told)
    heights, positions = heights[starts], positions[starts]
    n = len(heights)
    matrix[:3, 3] = positions[0]
    if n == 1:
        matrix[:3, 2] = normal * (ordered[0].thickness or 1.0)
        return [(frame, lambda samples: samples) for frame in frames], matrix
    step, where = _lattice(path, heights, told)
    rise = (positions[-1] - positions[0]) / (heights[-1] - heights[0])
    strayed = np.linalg.norm(
        positions - positions[0] - np.outer(heights - heights[0], rise), axis=1
    )
    if strayed.max() > 0.1 * np.linalg.norm(matrix[:3, 0]):
        told.append(f"{path}: slices lie up to {strayed.max():.3g} mm beside a straight line")
    matrix[:3, 2] = rise * step
    return [(frame, lambda samples: _filled(samples, where)) for frame in frames], matrix


def _starts(heights: NDArray[np.float64]) -> NDArray[np.intp]:
    """The first of each run of slices in one place."""
    gaps = np.diff(heights)
    apart = gaps[gaps > 1e-4]  # mm, finer than files round positions
    least = SAME * np.median(apart) if len(apart) else np.inf
    return np.flatnonzero(np.concatenate([[True], gaps > least]))


def _frames(
    path: Path, ordered: list[S], starts: NDArray[np.intp], told: list[str]
) -> list[list[S]]:
    """Slices by frames: as many as there are in each place, else only the first of each."""
    counts = np.diff(np.append(starts, len(ordered)))
    if (counts == counts[0]).all():
        runs = [sorted(ordered[s : s + counts[0]], key=lambda each: each.order) for s in starts]
        return [[run[k] for run in runs] for k in range(counts[0])]
    told.append(
        f"{path}: {len(ordered) - len(starts)} slices lie where others do, and were left out"
    )
    return [[ordered[s] for s in starts]]


def _lattice(
    path: Path, heights: NDArray[np.float64], told: list[str]
) -> tuple[float, NDArray[np.float64] | None]:
    """The even distance of slices, and for each lattice slice its place among those that are.

    None where these are even as they are.
    """
    gaps = np.diff(heights)
    even = (heights[-1] - heights[0]) / len(gaps)
    if np.abs(heights - heights[0] - even * np.arange(len(heights))).max() <= EVEN * even:
        return even, None
    step = float(np.median(gaps))
    counts = np.round(gaps / step)
    missing = int((counts - 1).clip(0).sum())
    at_places = np.abs(gaps - counts * step).max() <= 2 * EVEN * step
    n = round((heights[-1] - heights[0]) / step) + 1
    if n > MOST_FILLED * len(heights):
        raise refuse(
            path, f"its slices lie {numbers([gaps.min(), gaps.max()])} mm apart, too unevenly"
        )
    what = f"{missing} slices are missing" if at_places else "slices are unevenly spaced"
    range_ = f"{gaps.min():.4g} to {gaps.max():.4g} mm"
    told.append(f"{path}: {what} ({range_} apart), so that samples between were interpolated")
    step = (heights[-1] - heights[0]) / (n - 1)
    return step, np.interp(
        heights[0] + step * np.arange(n), heights, np.arange(len(heights), dtype=np.float64)
    )


def _filled(samples: Samples, where: NDArray[np.float64] | None) -> Samples:
    """Samples at places between slices, by linear interpolation."""
    if where is None:
        return samples
    below = np.minimum(where.astype(np.intp), len(samples) - 2)
    filled = Spool((len(where), *samples.shape[1:]), samples.dtype)
    for k, (b, share) in enumerate(zip(below, where - below, strict=True)):
        if abs(share - round(share)) < EVEN:
            filled[k : k + 1] = samples[b + round(share)]
            continue
        between = samples[b] * (1.0 - share) + samples[b + 1] * share
        whole = samples.dtype.kind != "f"
        filled[k : k + 1] = (np.round(between) if whole else between).astype(samples.dtype)
    return filled.samples()
