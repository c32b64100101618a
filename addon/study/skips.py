# SPDX-License-Identifier: GPL-3.0-or-later
"""Pixels that are skipped around a ray that misses: how many, and how many wrongly (no bpy).

Every phantom is seen from all around; the image with pixels skipped is held against the
same rays traced one by one. The published skip is there to show what it loses.

Source: Zuiderveld, Koning and Viergever 1992.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import leapray

from .cameras import parallel
from .phantom import phantom


@dataclass(frozen=True)
class Skip:
    """A skip on a phantom from all views."""

    n: int  # of the phantom: n^3 spheres
    skip: str
    views: int
    pixels: int
    skipped: int
    wrong: int  # pixels that see another first cell than their ray, or miss it
    seconds: float  # all cores
    seconds_traced: float  # the same by tracing every ray


def measure(counts, directions: NDArray, size: int, image: int) -> list[Skip]:
    """Rows per phantom and skip."""
    found = []
    for n in counts:
        volume = leapray.Volume(phantom(size, n))
        structure = leapray.build(volume)
        prepared = {
            skip: leapray.prepare(volume, f"pixel_skip:skip={skip}") for skip in ("safe", "paper")
        }
        sums = {skip: np.zeros(3) for skip in prepared}
        traced = 0.0
        for forward in directions:
            seen = parallel(forward, size, image)
            rays = leapray.camera_rays(seen, image, image)
            began = time.perf_counter()
            want = leapray.trace(structure, *rays, mode="binary", threads=0, count=False)
            traced += time.perf_counter() - began
            hit = np.isfinite(want.t)
            for skip, total in sums.items():
                began = time.perf_counter()
                made = prepared[skip]
                got = leapray.render_image(made.method, made, seen, image, image, threads=0)
                took = time.perf_counter() - began
                other = (got.cell.reshape(-1, 3) != want.cell).any(axis=1)
                wrong = (got.hit.ravel() != hit) | (hit & other)
                total += got.skipped.sum(), wrong.sum(), took
        pixels = len(directions) * image**2
        found += [
            Skip(n, skip, len(directions), pixels, int(skipped), int(wrong), took, traced)
            for skip, (skipped, wrong, took) in sums.items()
        ]
    return found
