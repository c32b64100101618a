# SPDX-License-Identifier: GPL-3.0-or-later
"""Cycles' reference frames, kept in a folder from one comparison to the next.

A reference takes longer than all else and LeapRay has no part in it. The file's name holds a digest
of what the frame depends on: the scene's file, Blender, the way a scene is made comparable, and
what was asked for. Images and libraries that the scene's file only links to are not looked at.
"""

from __future__ import annotations

import hashlib
import os
import shutil
from pathlib import Path

import bpy

from leapray import LeapRayError

from . import frames


def reference(
    scene: bpy.types.Scene, path: Path, samples: int, folder: Path | None, *asked: object
) -> frames.Frame:
    """Cycles' frame of a seed of its own, rendered to path or taken from the folder.

    folder: None renders anew and keeps nothing. asked: what was changed in the open scene beyond
    its file. A frame that was kept took 0 seconds. Raises LeapRayError where the folder
    cannot be written to.
    """
    if folder is None:
        return frames.render_cycles(scene, path, samples, seed=1)
    source = Path(bpy.data.filepath)
    limits = [getattr(scene.leapray, name) for name in frames.BOUNCES]
    render = scene.render
    size = render.resolution_x, render.resolution_y, render.resolution_percentage
    told = (bpy.app.version_string, samples, scene.frame_current, size, limits, *asked)
    digest = hashlib.sha256(repr(told).encode())
    for each in (source, Path(frames.__file__)):
        digest.update(each.read_bytes())
    kept = folder / f"{source.stem}-{samples}-{digest.hexdigest()[:16]}.exr"
    if kept.is_file():
        return frames.Frame(frames.read(kept), 0.0)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        frame = frames.render_cycles(scene, path, samples, seed=1)
        part = kept.with_suffix(f".{os.getpid()}.part")
        shutil.copyfile(path, part)
        part.replace(kept)
    except OSError as error:
        raise LeapRayError(f"{folder} cannot keep reference frames: {error.strerror}") from error
    return frame
