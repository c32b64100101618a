# SPDX-License-Identifier: GPL-3.0-or-later
"""Sequences of measured files or folders: which of them is shown in a frame.

Blender knows sequences of OpenVDB alone; others follow the same four settings of the datablock.
Source: BKE_volume's volume_sequence_frame in Blender.
"""

from __future__ import annotations

import re
from pathlib import Path

from leapray import LeapRayError
from leapray.formats import FORMATS

NUMBER = re.compile(r"\d+$")
LAYOUT = re.compile(r"_(u?int|float)\d+$")  # of raw numbers, in a name


def file_of_frame(path: Path, original, depsgraph) -> Path | None:
    """The file or folder of the present frame, path unless the volume is a sequence; None where it
    shows nothing now. original: the datablock in the file.

    Raises LeapRayError where the name of a sequence holds no number, and for one of no frames.
    """
    volume = original.evaluated_get(depsgraph) if hasattr(original, "is_sequence") else None
    if volume is None or not volume.is_sequence:
        return path
    if volume.frame_duration == 0:
        raise LeapRayError("it is a sequence of 0 frames")
    number = frame_number(
        int(depsgraph.scene_eval.frame_current_final),
        volume.frame_start,
        volume.frame_duration,
        volume.frame_offset,
        volume.sequence_mode,
    )
    return None if number is None else numbered(path, number)


def frame_number(now: int, start: int, duration: int, offset: int, mode: str) -> int | None:
    """The number of the file in a frame of the scene; None: nothing is shown."""
    if duration == 0:
        return None
    number = now - start + 1
    if mode == "CLIP" and not 1 <= number <= duration:
        return None
    if mode == "EXTEND":
        number = min(max(number, 1), duration)
    elif mode == "REPEAT":
        number = (number - 1) % duration + 1
    elif mode == "PING_PONG":
        there = (number - 1) % max(2 * duration - 2, 1) + 1
        number = 2 * duration - there if there > duration else there
    return number + offset


def numbered(path: Path, number: int) -> Path:
    """The path with another number at the end of its name, with as many digits."""
    lower = path.name.lower()
    known = [end for each in FORMATS for end in each.suffixes if lower.endswith(end)]
    suffix = path.name[len(path.name) - max(map(len, known), default=0) :] if known else ""
    stem = path.name.removesuffix(suffix)
    found = None if LAYOUT.search(stem) else NUMBER.search(stem)
    if found is None:
        raise LeapRayError(f"it is a sequence, but the name of {path} does not end in a number")
    digits = f"{number:0{len(found[0]) + (number < 0)}d}"
    return path.with_name(stem[: found.start()] + digits + suffix)
