# SPDX-License-Identifier: GPL-3.0-or-later
"""Chooses sample types: u8 where its steps are invisible, f32 where those of u16 show (no bpy).

A step of u8 moves the surface by up to 1/140 of a voxel, one of u16 by 1/26000. That is
little, but steps also turn normals, by a tenth of a degree on faces oblique to the lattice:
diffuse light does not show it, a mirror does. On faces along the lattice all samples are
equal, and normals do not turn. So a finished level becomes u8 if its error, measured with
such steps, is still permitted, and normals turn by less than its materials show.

A flat floor has so few and large voxels that steps are all of its error: there f32 is used,
which costs a few bricks.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

import leapray
from leapray.voxelization import filter_info

from .. import model
from ..arrays import unit

TURN = math.radians(0.15)  # of normals, the mean: diffuse light changes by a quarter of a per cent
LOBE_SHARE = 1 / 60  # likewise, of the width of a glossy lobe
STRAIGHT = ("diffuse", "emission", "transparent")  # lobes that do not scatter light
NONE = -1.0  # less than any
STEP = 4  # probes of which one is for turns: a mean needs fewer than a quantile
ROUNDING = 1e-6  # of normals, radians: less is no turn
PART = 0.5  # of the error: then steps are what it is made of


def permitted_turn(materials: Iterable[model.Material]) -> float:
    """By how much normals may turn, the mean in radians; 0 for mirrors and clear glass, NONE for
    solids that are filled, whose depth shows the steps of u8 where no normal turns."""
    materials = list(materials)
    if any(material.fills for material in materials):
        return NONE
    widths = [
        lobe.roughness**2
        for material in materials
        for lobe in material.lobes
        if lobe.kind not in STRAIGHT and _emits(lobe)
    ]
    return min([TURN, *(LOBE_SHARE * width for width in widths)])


def _emits(lobe: model.Lobe) -> bool:
    return lobe.kind != "principled" or max(lobe.metallic, lobe.transmission, lobe.specular) > 0


def turn(
    volume: leapray.Volume,
    points: NDArray,
    voxel_size: float,
    gain: float,
    ids: NDArray[np.uint16] | None = None,
) -> float:
    """By how much `volume.narrow(gain)` would turn normals at points (n, 3), the mean in radians.

    Where the volume carries normals, or keeps triangles, none turns. ids: of the objects of a
    merged volume.
    """
    ids = np.zeros(len(points), np.uint16) if ids is None else ids
    own = volume.attributes(points, ids)[1] if volume.info.has_normals else np.full((1, 3), np.nan)
    bare = np.isnan(own[:, 0]) & ~volume.exact_at(points)
    whose = ids[bare] if volume.info.n_objects else None
    before, after = (
        _central(volume, points[bare], voxel_size, some, whose) for some in (0.0, gain)
    )
    turned = 2 * np.arcsin(np.minimum(np.linalg.norm(after - before, axis=1) / 2, 1.0))
    return float(turned[turned > ROUNDING].sum() / len(points))


def _central(volume, points, voxel_size: float, gain: float, ids) -> NDArray[np.float64]:
    """Unit normals by central differences, (n, 3)."""
    sides = [
        volume.sample(points + step, ids, gain)[0] - volume.sample(points - step, ids, gain)[0]
        for step in voxel_size * np.eye(3)
    ]
    return unit(np.stack(sides, axis=1))


def gain(kernel: str, width: float) -> float:
    """How many times as steep u8 is as u16. width: of the filter, 0: its own."""
    wide, narrow = (filter_info(kernel, dtype).half_width for dtype in ("u16", "u8"))
    return 1.0 if width else wide / narrow
