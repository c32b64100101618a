# SPDX-License-Identifier: GPL-3.0-or-later
"""Cameras around volumes (no bpy)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import leapray

from .phantom import frame

MARGIN = 1.02  # of the film around the cube


def parallel(forward: NDArray[np.float64], size: int, image: int) -> leapray.Camera:
    """Parallel rays along a unit vector; the film holds a volume of size^3 samples."""
    right, up = frame(forward) if abs(forward[1]) < 1 else (np.eye(3)[0], np.eye(3)[2])
    extent = np.sqrt(3) * (size + 1) * MARGIN
    dx, dy = extent / image * right, extent / image * up
    eye = np.full(3, (size - 1) / 2) - extent * forward
    return leapray.Camera("orthographic", eye, forward, -image / 2 * (dx + dy), dx, dy)


def perspective(
    eye: NDArray[np.float64], forward: NDArray[np.float64], half: float, width: int, height: int
) -> leapray.Camera:
    """From a point along a unit vector, z above; half: tangent of half the angle across."""
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    dx = right * (2 * half / width)
    dy = np.cross(right, forward) * (2 * half / width)
    corner = forward - width / 2 * dx - height / 2 * dy
    return leapray.Camera("perspective", eye, forward, corner, dx, dy)
