# SPDX-License-Identifier: GPL-3.0-or-later
"""Where a study's files go (no bpy)."""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

from leapray import LeapRayError


@contextlib.contextmanager
def result_folder(output: Path, last: str) -> Iterator[Path]:
    """A folder beside output whose files move there at the end, the file named `last` last.

    Nothing is left behind where the work fails, and other files in output stay. Raises
    LeapRayError before any work where output cannot be.
    """
    parent = output.absolute().parent
    if output.is_file():
        raise LeapRayError(f"--output must be a folder, and {output} is a file")
    if not parent.is_dir():
        raise LeapRayError(f"The output folder {parent} does not exist")
    try:
        if output.is_dir():
            tempfile.TemporaryFile(dir=output).close()
        part = Path(tempfile.mkdtemp(prefix=f".{output.name}.", suffix=".part", dir=parent))
    except OSError as error:
        raise LeapRayError(f"{output} cannot be written to: {error.strerror}") from error
    try:
        yield part
        output.mkdir(exist_ok=True)
        for path in sorted(part.iterdir(), key=lambda each: each.name == last):
            os.replace(path, output / path.name)
    finally:
        shutil.rmtree(part, ignore_errors=True)
