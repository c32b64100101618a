# SPDX-License-Identifier: GPL-3.0-or-later
"""Samples of sparse grids as arrays, by one loop over tiles and leaves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from leapray import Leaves


def dense(leaves: Leaves) -> tuple[NDArray, NDArray]:
    """The samples round leaves and tiles as an array, and the index (3,) of its first one."""
    ends = np.concatenate([leaves.origins + 8, leaves.tile_origins + leaves.tile_sizes[:, None]])
    first = np.concatenate([leaves.origins, leaves.tile_origins]).min(axis=0)
    out = np.full((ends.max(axis=0) - first)[::-1], leaves.background, leaves.samples.dtype)
    for origin, size, value in zip(
        leaves.tile_origins, leaves.tile_sizes, leaves.tile_values, strict=True
    ):
        x, y, z = origin - first
        out[z : z + size, y : y + size, x : x + size] = value
    for origin, leaf in zip(leaves.origins, leaves.samples, strict=True):
        x, y, z = origin - first
        out[z : z + 8, y : y + 8, x : x + 8] = leaf
    return out, first
