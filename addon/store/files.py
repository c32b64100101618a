# SPDX-License-Identifier: GPL-3.0-or-later
"""Paths as users write them, files that are written whole or not at all, and JSON (no bpy)."""

from __future__ import annotations

import contextlib
import glob
import json
import math
import os
import re
import shutil
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

from leapray import LeapRayError

from .. import process

FRAME_DIGITS = 4  # of a frame's number in a file name, as Blender appends it


# ---- paths -----------------------------------------------------------------


def resolved(path: Path, scene: Path | None = None) -> Path:
    """The absolute path: `//` is the folder of the scene's file, `~` the user's own.

    Raises LeapRayError for `//` without a scene, and for the home folder of a user unknown here.
    """
    text = str(path)
    if text.startswith("//"):
        if scene is None:
            raise LeapRayError(f"{path}: // is the folder of a .blend, and there is none here")
        return scene.absolute().parent / text.lstrip("/")
    try:
        return path.expanduser()
    except RuntimeError as error:
        raise LeapRayError(f"The home folder in {path} is not known here") from error


def numbered(path: Path, frame: int, several: bool) -> Path:
    """The path of one frame: its number stands for the last `###` of the name, with as many
    digits; where there is none and the path is for several frames, before the suffix."""
    marks = list(re.finditer("#+", path.name))
    if not marks and not several:
        return path
    start, end = marks[-1].span() if marks else (len(path.stem), len(path.stem))
    width = (end - start or FRAME_DIGITS) + (frame < 0)
    return path.with_name(f"{path.name[:start]}{frame:0{width}d}{path.name[end:]}")


def check_file(path: Path) -> None:
    """Raise LeapRayError where there is no file to read."""
    if not path.is_file():
        raise LeapRayError(f"{path} is a folder" if path.is_dir() else f"There is no file {path}")


def check_folder(path: Path) -> None:
    """Raise LeapRayError where a file could not be written there."""
    if path.is_dir():
        raise LeapRayError(f"{path} is a folder, not a file to write")
    folder = path.absolute().parent
    if not folder.is_dir():
        raise LeapRayError(f"The output folder {folder} does not exist")
    try:
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        raise LeapRayError(
            f"The output folder {folder} cannot be written to: {error.strerror}"
        ) from error


@contextlib.contextmanager
def part_folder(output: Path) -> Iterator[Path]:
    """A temporary folder beside output for incomplete files.

    A killed process leaves files in such folders only. They are locked while in
    use, so that those of killed processes can be identified and removed.
    """
    parent, name = output.absolute().parent, f".{output.name}."
    for old in parent.glob(f"{glob.escape(name)}*.part"):
        with contextlib.suppress(OSError), locked(old):
            shutil.rmtree(old)
    with process.signals_deferred():
        folder = Path(tempfile.mkdtemp(prefix=name, suffix=".part", dir=parent))
        process.temporary_folders.add(folder)
    try:
        with locked(folder):
            yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        process.temporary_folders.discard(folder)


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold a folder's lock; OSError where another process has it."""
    import fcntl

    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    finally:
        os.close(handle)


# ---- JSON ------------------------------------------------------------------


def finite(data):
    """The same data with None for every NaN and infinity, which JSON does not have."""
    if isinstance(data, dict):
        return {key: finite(value) for key, value in data.items()}
    if isinstance(data, (list, tuple)):
        return [finite(value) for value in data]
    if hasattr(data, "tolist"):  # numpy's arrays and scalars
        return finite(data.tolist())
    return None if isinstance(data, float) and not math.isfinite(data) else data


def write_json(path: Path, data) -> None:
    """Write data as JSON by the standard; what it has no type for becomes a string."""
    text = json.dumps(finite(data), indent=2, allow_nan=False, default=str)
    path.write_text(text + "\n", encoding="utf-8")


def check_replaceable(path: Path, is_ours: Callable[[dict], bool], remedy: str) -> None:
    """Raise LeapRayError where a file is there that is not a JSON file of ours."""
    if not path.exists():
        return
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        data = None
    if not (isinstance(data, dict) and is_ours(data)):
        raise LeapRayError(f"{path} was not written by LeapRay, so it is not replaced; {remedy}")
