# SPDX-License-Identifier: GPL-3.0-or-later
"""Cycles' reference frames, kept in a folder from one comparison to the next.

A reference takes longer than all else and LeapRay has no part in it. The file's name holds a digest
of what the frame depends on: the scene's file, Blender, how a scene is made comparable, and
what was asked for. Images and libraries that the scene's file only links to are not looked at.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import bpy

from leapray import LeapRayError

from . import frames


def reference(
    scene: bpy.types.Scene, path: Path, samples: int, folder: Path | None, *asked: object
) -> frames.Frame:
    """Cycles' frame of a seed of its own, rendered to path or taken from the folder.

    folder: None renders anew and keeps nothing. asked: what was changed in the open scene beyond
    its file. A frame that was kept took 0 seconds, and has no other passes than Combined where it
    is made of one with more pixels of fewer samples. Raises LeapRayError
    where the folder cannot be written to.
    """
    if folder is None:
        return frames.render_cycles(scene, path, samples, seed=1)
    kept = place(scene, samples, folder, asked)
    if kept.is_file():
        return frames.Frame(frames.read(kept), 0.0)
    for n in (2, 4):
        with times_as_large(scene, n) as fits:
            larger = place(scene, samples // n**2, folder, asked)
        if fits and samples % n**2 == 0 and larger.is_file():
            image = frames.read(larger)["Combined"]
            high, wide = (k // n for k in image.shape[:2])
            parts = image.reshape(high, n, wide, n, -1)
            return frames.Frame({"Combined": parts.mean((1, 3))}, 0.0)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        frame = frames.render_cycles(scene, path, samples, seed=1)
        part = kept.with_suffix(f".{os.getpid()}.part")
        shutil.copyfile(path, part)
        part.replace(kept)
    except OSError as error:
        raise LeapRayError(f"{folder} cannot keep reference frames: {error.strerror}") from error
    return frame


def place(scene: bpy.types.Scene, samples: int, folder: Path, asked: tuple) -> Path:
    """The file of the scene's frame as it is set now."""
    source = Path(bpy.data.filepath)
    limits = [getattr(scene.leapray, name) for name in frames.BOUNCES]
    size = frames.size(scene)
    told = (bpy.app.version_string, samples, scene.frame_current, size, limits, *asked)
    digest = hashlib.sha256(repr(told).encode())
    for each in (source, Path(frames.__file__)):
        digest.update(each.read_bytes())
    return folder / f"{source.stem}-{samples}-{digest.hexdigest()[:16]}.exr"


@contextlib.contextmanager
def times_as_large(scene: bpy.types.Scene, n: int) -> Iterator[bool]:
    """Meanwhile the frame has n times the percentage; whether it has then exactly n^2 pixels for
    each. With a box filter of a pixel, as frames.prepare sets it, their means are the frame with
    n^2 times the samples."""
    render, (wide, high) = scene.render, frames.size(scene)
    own = render.resolution_percentage
    render.resolution_percentage = n * own
    try:
        yield frames.size(scene) == (n * wide, n * high)
    finally:
        render.resolution_percentage = own
