# SPDX-License-Identifier: GPL-3.0-or-later
"""Matrices of Blender's as arrays, and whether they can be inverted."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# A 4x4 of float32 whose axes lie in a plane still shows this much thickness.
FLAT = 4 * np.finfo(np.float32).eps


def affine(matrix) -> NDArray[np.float64]:
    """A matrix of Blender's; behind chains of parents its last row is 0, 0, 0 and almost 1."""
    found = np.array(matrix, np.float64)
    found[3] = 0.0, 0.0, 0.0, 1.0
    return found


def invertible(matrix: NDArray[np.float64]) -> bool:
    """Whether a matrix that Blender holds in float32 has three axes that span space."""
    if not np.isfinite(matrix).all():
        return False
    lengths = np.linalg.norm(matrix[:3, :3], axis=0)
    if not lengths.all():
        return False
    return bool(np.linalg.svd(matrix[:3, :3] / lengths, compute_uv=False)[-1] > FLAT)
