# SPDX-License-Identifier: GPL-3.0-or-later
"""What `study volume` renders: the phantom of a head, its look, and the rays of the picture."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

import leapray

from . import light_integrals, lit_samples
from .cameras import perspective
from .scenes import write_head

# Hounsfield units, per millimetre: air and fat hidden, skin thin, bone dense.
VALUES = (-600.0, -400.0, -150.0, 150.0, 300.0, 800.0)
EXTINCTION = (0.0, 0.03, 0.0, 0.0, 0.1, 0.9)
COLORS = (
    (0.9, 0.6, 0.5),
    (0.9, 0.6, 0.5),
    (0.8, 0.5, 0.4),
    (0.9, 0.8, 0.6),
    (0.95, 0.9, 0.8),
    (1.0, 1.0, 1.0),
)
EYE, HALF = (220.0, 260.0, 120.0), 0.36  # millimetres; tangent of half the angle of view across
SEED = 1988
MOST_LIT = 2000


def head(folder: Path, size: int) -> leapray.ScalarGrid:
    """The phantom of size^3 samples. Raises LeapRayError where it is not installed."""
    path = folder / "head.nii"
    write_head(path, size)
    grid = leapray.read_volume(path)
    path.unlink()
    return grid


@dataclass
class Subject:
    """The head, its look, and the rays of the picture."""

    grid: leapray.ScalarGrid
    transfer: leapray.TransferFunction
    width: int
    height: int
    origins: NDArray[np.float64]  # (n, 3) of all pixels, row 0 the lowest
    directions: NDArray[np.float64]
    judged: NDArray[np.int64]  # pixels whose errors are taken
    visible: leapray.Volume
    everything: leapray.Volume  # in which no cell is left out
    built: dict[tuple[str, bool], leapray.Structure] = field(default_factory=dict)

    @classmethod
    def of(cls, grid: leapray.ScalarGrid, width: int, judged: int) -> Subject:
        height = max(width * 9 // 16, 1)
        eye = np.array(EYE)
        camera = perspective(eye, -eye / np.linalg.norm(eye), HALF, width, height)
        rays = leapray.camera_rays(camera, width, height)
        transfer = leapray.TransferFunction(VALUES, EXTINCTION, COLORS)
        samples = leapray.FieldSamples(grid)
        drawn = np.random.default_rng(SEED).choice(
            width * height, min(judged, width * height), replace=False
        )
        visible, everything = samples.at(transfer), samples.at(transfer, everywhere=True)
        return cls(grid, transfer, width, height, *rays, np.sort(drawn), visible, everything)

    @property
    def voxel(self) -> float:
        """In units of the data."""
        return float(np.linalg.norm(np.asarray(self.grid.world_from_index)[:3, 0]))

    @property
    def stored(self) -> NDArray:
        """(nz, ny, nx) samples."""
        return np.asarray(cast(NDArray, self.grid.samples)[:])

    def reference(self) -> NDArray[np.float64]:
        """(judged, 4) colours and transmittances in extended precision."""
        values = self.grid.offset + self.grid.scale * self.stored.astype(np.float64)
        ramp = light_integrals.Ramp(VALUES, EXTINCTION, COLORS)
        rays = self.origins[self.judged], self.directions[self.judged]
        return light_integrals.light_of_many(values, *rays, ramp, self.grid.world_from_index)

    @property
    def judged_lit(self) -> NDArray[np.int64]:
        """Some of the judged pixels: close samples take longer than integrals."""
        return self.judged[:: -(-len(self.judged) // MOST_LIT)]

    def lit_reference(self, phong: leapray.Phong, apart: float = 1 / 32) -> NDArray[np.float64]:
        """(judged_lit, 4) of samples so many voxels apart, lit by central differences."""
        ramp = light_integrals.Ramp(VALUES, EXTINCTION, COLORS)
        rays = self.origins[self.judged_lit], self.directions[self.judged_lit]
        return lit_samples.light(self.grid, *rays, ramp, phong, apart)

    def structure(self, spec: str, leaps: bool) -> leapray.Structure:
        """Of the visible cells, or of all; kept."""
        if (spec, leaps) not in self.built:
            volume = self.visible if leaps else self.everything
            self.built[spec, leaps] = leapray.build(volume, spec)
        return self.built[spec, leaps]
