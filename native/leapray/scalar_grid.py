# SPDX-License-Identifier: GPL-3.0-or-later
"""Scalar fields as files hold them: stored numbers, what they mean, and where they lie."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .file_samples import FileSamples, Samples

KINDS = ("scalar", "level set", "fog", "labels")
LEAF = 8  # samples along a leaf of a sparse grid


@dataclass(frozen=True)
class Leaves:
    """The samples of a sparse grid: those of its leaves, of its tiles, else the background.

    Coordinates are x, y, z and may be negative; they are multiples of LEAF.
    """

    origins: NDArray[np.int32]  # (n, 3) first sample of each leaf
    samples: Samples  # (n, LEAF, LEAF, LEAF) in z, y, x order, in memory or in a file
    background: float  # stored number of all other samples
    tile_origins: NDArray[np.int32] = field(default_factory=lambda: np.empty((0, 3), np.int32))
    tile_sizes: NDArray[np.int32] = field(default_factory=lambda: np.empty(0, np.int32))
    tile_values: NDArray = field(default_factory=lambda: np.empty(0))  # stored numbers


@dataclass(frozen=True)
class ScalarGrid:
    """A measured or made scalar field: a number on each point of a lattice.

    samples: the stored numbers, (nz, ny, nx) of any real dtype, in memory or in a file, or
    Leaves. The value of a sample is offset + scale * stored. world_from_index: (4, 4), affine,
    invertible: where sample (i, j, k) lies, in units of `meters` metres (0: the file does not
    say). kind: "scalar", "level set" (the surface at 0, inside below), "fog" (density) or
    "labels" (whole numbers that name regions, 0 none).
    """

    name: str
    samples: Samples | Leaves
    world_from_index: NDArray[np.float64]
    scale: float = 1.0
    offset: float = 0.0
    kind: str = "scalar"
    meters: float = 0.0
    quantity: str = ""  # unit of the values, as "HU"
    no_data: float | None = None  # stored number that means none; NaN always does
    label_names: dict[int, str] = field(default_factory=dict)
    label_colors: dict[int, tuple[float, float, float]] = field(default_factory=dict)  # sRGB 0..1
    source: str = ""  # the file or folder that it was read from
    files: tuple[str, ...] = ()  # what else was read: slices and their folder, headers, samples
    warnings: tuple[str, ...] = ()  # sentences on what was read with a doubt

    @property
    def nbytes(self) -> int:
        """Bytes of memory that the samples take; those in files take none."""
        return sum(each.nbytes for each in self._arrays() if not isinstance(each, FileSamples))

    @property
    def unpacked_nbytes(self) -> int:
        """Bytes that they take in temporary files."""
        files = (each for each in self._arrays() if isinstance(each, FileSamples))
        return sum(each.unpacked_nbytes for each in files)

    def _arrays(self) -> list[Samples]:
        held = self.samples
        if not isinstance(held, Leaves):
            return [held]
        tiles = [held.tile_origins, held.tile_sizes, held.tile_values]
        return [held.origins, held.samples, *tiles]
