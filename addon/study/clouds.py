# SPDX-License-Identifier: GPL-3.0-or-later
"""A fog: puffs whose density fades to nothing within a cube (no bpy)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

PUFFS, LEAST = 14, 1e-3  # below the least density there is none
SEED = 1994


def cloud(n: int) -> NDArray[np.float32]:
    """(n, n, n) densities, 0 to about 1.5."""
    rng = np.random.default_rng(SEED)
    middles, widths = rng.uniform(-0.22, 0.22, (PUFFS, 3)), rng.uniform(0.05, 0.1, PUFFS)
    axis = ((np.arange(n) + 0.5) / n - 0.5).astype(np.float32)
    density = np.zeros((n, n, n), np.float32)
    for middle, width in zip(middles.astype(np.float32), widths, strict=True):
        x, y, z = (np.exp(-((axis - at) ** 2) / np.float32(2 * width**2)) for at in middle)
        density += x[:, None, None] * (y[:, None] * z)
    density[density < LEAST] = 0.0
    return density
