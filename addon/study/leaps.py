# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames of an orbit that leap by the frame before, beside frames from scratch (no bpy).

Source: Yagel and Shi 1993.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

import leapray

from . import charts
from .cameras import perspective
from .entries import label

DISTANCE, HALF = 2.1, 0.42  # of a perspective camera by the cube's side; tangent
TURNS = (0.05, 0.25, 1.0)  # degrees a frame


def looking(forward: NDArray[np.float64], size: int, image: int) -> leapray.Camera:
    """In perspective at the middle of a cube of size^3 samples."""
    eye = np.full(3, (size - 1) / 2) - DISTANCE * size * forward
    return perspective(eye, forward, HALF, image, image)


@dataclass(frozen=True)
class Leap:
    """A frame of an orbit, by the frame before and from scratch."""

    n: int
    method: str
    label: str
    turn: float  # degrees a frame
    frame: int
    seconds: float
    scratch: float
    cells: int  # looked at
    scratch_cells: int
    equal: bool  # to the bit

    @property
    def leapt(self) -> float:
        """The share of cells that the frame before saved."""
        return 1 - self.cells / max(self.scratch_cells, 1)


def orbits(
    volume: leapray.Volume, n: int, size: int, image: int, turn: float, frames: int
) -> list[Leap]:
    """Frames of an orbit in perspective by every choice of the methods that leap."""
    found = []
    for method in leapray.image_variants():
        if not method.frames:
            continue
        prepared = leapray.prepare(volume, method)
        before = None
        for frame in range(frames):
            angle = np.radians(30 + turn * frame)
            forward = np.array([np.cos(angle), np.sin(angle), -0.5])
            camera = looking(forward / np.linalg.norm(forward), size, image)
            job = partial(leapray.render_image, method, prepared, camera, image, image)
            began = time.process_time()
            now = job(before=before)
            middle = time.process_time()
            scratch = job(keep=False)
            ended = time.process_time()
            found.append(
                Leap(
                    n,
                    method.spec,
                    label(method),
                    turn,
                    frame,
                    middle - began,
                    ended - middle,
                    visited(now),
                    visited(scratch),
                    np.array_equal(now.t, scratch.t) and np.array_equal(now.cell, scratch.cell),
                )
            )
            before = now
    return found


def visited(image: leapray.Image) -> int:
    return image.counters["cells"] + image.counters["nodes"]


def by_phantom(leaps: list[Leap], turn: float) -> dict[str, list[Leap]]:
    """The frames of every orbit with that turn."""
    seen = [leap for leap in leaps if leap.turn == turn]
    return charts.grouped(seen, lambda leap: f"{leap.label}, N = {leap.n}")


def of_leaps(leaps: list[Leap]) -> list[str]:
    """Whole orbits, computed from their frames."""
    said = []
    for turn in sorted({leap.turn for leap in leaps}):
        for name, found in by_phantom(leaps, turn).items():
            ours, scratch = sum(f.seconds for f in found), sum(f.scratch for f in found)
            leapt = 1 - sum(f.cells for f in found) / max(sum(f.scratch_cells for f in found), 1)
            same = "equal to the bit" if all(f.equal for f in found) else "NOT EQUAL"
            said.append(
                f"{name}, {turn:g} degrees a frame: {len(found)} frames, {same}, "
                f"{scratch / ours:.2f} times as fast as from scratch; {leapt:.0%} of the cells are "
                "leapt over."
            )
    return said
