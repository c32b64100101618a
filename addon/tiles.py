# SPDX-License-Identifier: GPL-3.0-or-later
"""How an image is cut into tiles, in which order they come, and where they end up (no bpy)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Tile(NamedTuple):
    """A rectangle of pixels; row 0 is the lowest."""

    x: int
    y: int
    width: int
    height: int


def split(width: int, height: int, size: int) -> list[Tile]:
    """Tiles of at most size x size pixels that cover the image, those nearest to its centre first.

    The subject tends to be in the middle, and its tiles tend to take longest:
    what is left for the end, when some threads have run dry, is cheap.
    """
    size = max(1, size)
    cut = [
        Tile(x, y, min(size, width - x), min(size, height - y))
        for y in range(0, height, size)
        for x in range(0, width, size)
    ]

    def from_centre(tile: Tile) -> tuple[int, int, int]:
        dx = 2 * tile.x + tile.width - width
        dy = 2 * tile.y + tile.height - height
        return dx * dx + dy * dy, tile.y, tile.x

    return sorted(cut, key=from_centre)


def strips(width: int, height: int, least: int, most: int) -> list[Tile]:
    """Up to `most` strips as wide as the image, of at least so many rows, in the order of split."""
    rows = max(least, -(-height // most))
    cut = [Tile(0, y, width, min(rows, height - y)) for y in range(0, height, rows)]
    return sorted(cut, key=lambda tile: (abs(2 * tile.y + tile.height - height), tile.y))


def paste(
    passes: dict[str, NDArray[np.float32]],
    tile: Tile,
    parts: dict[str, NDArray[np.float32]],
    shape: tuple[int, int],
) -> None:
    """Copy a tile's passes into those of the image, which are made where they are missing.

    parts: name -> (tile.height, tile.width, channels). shape: (height, width) of the image.
    """
    for name, part in parts.items():
        if name not in passes:
            passes[name] = np.zeros((*shape, part.shape[2]), np.float32)
        passes[name][tile.y : tile.y + tile.height, tile.x : tile.x + tile.width] = part
