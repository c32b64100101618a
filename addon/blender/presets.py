# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings that go together, by name (no bpy)."""

from __future__ import annotations

from dataclasses import dataclass, field

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
