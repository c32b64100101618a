# SPDX-License-Identifier: GPL-3.0-or-later
"""A plan that is carried out: what is traced, and what is said of it (no bpy)."""

from __future__ import annotations

from dataclasses import dataclass

import leapray

from .. import model


@dataclass
class Plan:
    """Structures to trace, and what they stand for."""

    instances: list[leapray.Instance]
    names: list[str]  # of each instance's object
    slots: list[int]
    lights: tuple[model.Light, ...]  # the scene's, as the structures have them
    slot_objects: list[int] | None  # object index per slot, where one volume holds several objects
    slot_names: list[str] | None  # and the name of that object
    volumes: list[dict[str, object]]  # one row per volume, for the report
    warnings: list[str]
    volume_nbytes: int
    structure_nbytes: int
    scratch_nbytes: int  # that making one of the volumes took, the most
    peak_nbytes: int  # volumes and structures that were alive together, with scratch
    seconds: dict[str, float]
