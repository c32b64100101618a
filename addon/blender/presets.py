# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings that go together, and looks of volumes, by name (no bpy)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import leapray

from ..settings import SETTINGS


@dataclass(frozen=True)
class Preset:
    """All settings that are in presets: the defaults, and what differs."""

    label: str
    about: str
    differs: dict[str, object] = field(default_factory=dict)

    def values(self) -> dict[str, object]:
        """By the names of Settings, each with a value that a scene can hold."""
        defaults = {name: s.default for name, s in SETTINGS.items() if s.in_presets}
        return defaults | self.differs


def _of_paper() -> str:
    """The traverser that the paper proposes, one ray at a time as there."""
    return next(
        entry.spec
        for entry in leapray.variants()
        if entry.source == "Sramek 1994" and entry.chosen[-1:] == ("one",)
    )


PRESETS = {
    "draft": Preset(
        "Draft",
        "A first look in seconds: few samples, one bounce between diffuse surfaces, coarse volumes",
        {
            "samples": 16,
            "noise_threshold": 0.0,
            "max_bounces": 4,
            "diffuse_bounces": 1,
            "glossy_bounces": 2,
            "transmission_bounces": 4,
            "pixel_error": 1.0,
        },
    ),
    "balanced": Preset(
        "Balanced",
        "The defaults: the light paths and the pixel filter of Cycles, surfaces within a quarter "
        "of a pixel",
    ),
    "exact": Preset(
        "Exact",
        "Close to the meshes: surfaces within a tenth of a pixel, triangles kept wherever samples "
        "fall short, half the noise, no light clamped",
        {
            "samples": 1024,
            "noise_threshold": 0.005,
            "clamp_indirect": 0.0,
            "pixel_error": 0.1,
            "exact": "all",
        },
    ),
    "paper_1994": Preset(
        "Paper 1994",
        "The methods of Sramek's comparison of 1994: one volume of 256 samples a side, samples "
        "alone, tests on the faces of cells, one linear interpolation, one ray per pixel",
        {
            "samples": 1,
            "noise_threshold": 0.0,
            "pixel_filter": "box",
            "diffuse_bounces": 0,
            "traverser": _of_paper(),
            "hit_test": "faces",
            "root": "linear",
            "layout": "scene",
            "resolution": 256,
            "exact": "none",
            "sample_type": "u8",
        },
    ),
}


# ---- looks of volumes -----------------------------------------------------------

Stop = tuple[float, tuple[float, float, float], float]  # where, 0..1; linear RGB; opacity 0..1


@dataclass(frozen=True)
class Look:
    """A transfer function over the values of any data: what they emit or, of shaded ones, scatter,
    and how opaque they are.

    Its stops lie between two values: of CT data in Hounsfield units those of the preset, of others
    percentiles of the samples.
    """

    label: str
    about: str
    stops: tuple[Stop, ...]  # none: one for each label
    percentiles: tuple[float, float]
    hounsfield: tuple[float, float] | None = None
    opaque: float = 300.0  # optical depth of full opacity along the data's longest side
    shading: float = 0.0  # 0..1: by the gradient, in the light of the scene; 0: it shines instead


def _shaded(look: Look, about: str) -> Look:
    """The same, lit by the scene."""
    return replace(look, label=f"{look.label} Shaded", about=about, shading=1.0)


CT_BONE = Look(
    "CT Bone",
    "Bone and teeth of a CT, from 150 to 1500 HU, without soft tissue",
    (
        (0.00, (0.45, 0.20, 0.12), 0.0),
        (0.15, (0.55, 0.30, 0.18), 0.02),
        (0.40, (0.75, 0.62, 0.42), 0.4),
        (0.70, (0.90, 0.84, 0.68), 1.0),
        (1.00, (1.00, 0.98, 0.92), 1.0),
    ),
    (90.0, 99.9),
    (150.0, 1500.0),
)
CT_SKIN = Look(
    "CT Skin",
    "Skin like a veil over the bone of a CT, from -600 to 1200 HU",
    (
        (0.00, (0.70, 0.38, 0.26), 0.0),
        (0.10, (0.75, 0.42, 0.30), 0.025),
        (0.22, (0.70, 0.30, 0.20), 0.004),
        (0.36, (0.55, 0.12, 0.08), 0.001),
        (0.47, (0.60, 0.30, 0.16), 0.004),
        (0.60, (0.85, 0.74, 0.54), 0.5),
        (1.00, (1.00, 0.98, 0.92), 1.0),
    ),
    (10.0, 99.9),
    (-600.0, 1200.0),
)
LOOKS = {
    "ct_bone": CT_BONE,
    "ct_bone_shaded": _shaded(
        CT_BONE, "Bone and teeth of a CT, from 150 to 1500 HU, lit by the scene like surfaces"
    ),
    "ct_skin": CT_SKIN,
    "ct_skin_shaded": _shaded(
        CT_SKIN,
        "Skin like a veil over the bone of a CT, from -600 to 1200 HU, lit by the scene like "
        "surfaces",
    ),
    "mr": Look(
        "MR",
        "Greys of magnetic resonance, the brighter the more opaque, from the median to 99.5 % of "
        "the samples",
        (
            (0.00, (0.00, 0.00, 0.00), 0.0),
            (0.30, (0.10, 0.11, 0.13), 0.01),
            (0.70, (0.45, 0.45, 0.44), 0.06),
            (1.00, (1.00, 0.97, 0.92), 0.25),
        ),
        (50.0, 99.5),
    ),
    "fire": Look(
        "Fire",
        "Red, orange and white light of a flame or of smoke, from 1 to 99 % of the samples",
        (
            (0.00, (0.00, 0.00, 0.00), 0.0),
            (0.25, (0.35, 0.02, 0.00), 0.15),
            (0.55, (1.00, 0.22, 0.02), 0.5),
            (0.80, (1.00, 0.65, 0.12), 0.8),
            (1.00, (1.00, 0.95, 0.75), 1.0),
        ),
        (1.0, 99.0),
        opaque=12.0,
    ),
    "labels": Look(
        "Labels",
        "A colour for each whole number from 1 on, up to 31; where two labels meet, those between "
        "them show as well",
        (),
        (0.0, 100.0),
        opaque=8.0,
    ),
}
