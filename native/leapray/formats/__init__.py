# SPDX-License-Identifier: GPL-3.0-or-later
"""Readers of measured volumes: one file a format, one line here.

Each reader turns a file into a ScalarGrid; the libraries that know the formats are imported when
a file of theirs is read.
"""

from __future__ import annotations

import os
from pathlib import Path

from .._lib import LeapRayError, Watch
from ..scalar_grid import ScalarGrid
from . import dicom, mrc, nifti, nrrd, raw, tiff, vdb
from .common import HEAD, Format, RawLayout, Request

FORMATS: tuple[Format, ...] = (
    nifti.FORMAT,
    dicom.FORMAT,
    nrrd.FORMAT,
    mrc.FORMAT,
    tiff.FORMAT,
    vdb.FORMAT,
    raw.FORMAT,
)


def read_volume(
    path: str | os.PathLike[str],
    *,
    grid: str | None = None,
    frame: int | None = None,
    layout: RawLayout | None = None,
    watch: Watch | None = None,
) -> ScalarGrid:
    """A measured volume as its file holds it: NIfTI, DICOM, NRRD, MRC, TIFF, OpenVDB or raw.

    path: a file, or for DICOM also a folder. The format is told by the name's ending, else by
    the file's first bytes. grid: one of `volume_grids`, else the first of numbers (of DICOM the
    largest series). frame: which of a file with several, from 0; else the first, with a
    warning. layout: how the numbers lie in a raw file that does not say it.

    World space is right, anterior, superior (RAS+) for NIfTI, DICOM and anatomical NRRD, in
    the file's unit of length; otherwise it is the file's own. Samples keep their stored type, in
    the machine's byte order. More than 16 MB of them stay in a file and are read by slices: in
    the file itself, which must stay as it is while the grid is used, or unpacked in a temporary
    one, in the folder that TMPDIR names, else in /var/tmp. What was read with a doubt is in
    the grid's warnings. watch stops the call by Stopped.

    Raises LeapRayError, in one sentence that names the file, for what is missing, broken, of
    another format, compressed in a way that is not read, of colours or complex numbers, and
    where the library that the format needs is not installed; OutOfMemory, Stopped.
    """
    request = Request(Path(path), grid, frame, layout, watch or Watch())
    chosen = raw.FORMAT if layout is not None else _format_of(request.path)
    return chosen.read(request)


def volume_grids(path: str | os.PathLike[str]) -> list[str]:
    """The names that `read_volume` takes as grid: of grids, channels or series.

    path: as for `read_volume`. A file with one grid has its own name without the ending.
    Raises LeapRayError as `read_volume` does.
    """
    found = Path(path)
    return _format_of(found).grids(found)


def _format_of(path: Path) -> Format:
    """The format of a file. Raises LeapRayError where there is none, or another than it says."""
    if path.is_dir():
        return dicom.FORMAT
    head = _head(path)
    name = path.name.lower()
    named = next((item for item in FORMATS if name.endswith(item.suffixes)), None)
    told = next((item for item in FORMATS if item.told_by(head)), None)
    if named is None and told is None:
        known = ", ".join(suffix for item in FORMATS for suffix in item.suffixes)
        raise LeapRayError(f"{path} is of no known format; names may end in {known}")
    if named is not None and told is not None and told is not named and named is not raw.FORMAT:
        raise LeapRayError(f"{path} is named as {named.name}, but it holds {told.name}")
    if not head:
        raise LeapRayError(f"{path} is empty")
    return named or told  # type: ignore[return-value]


def _head(path: Path) -> bytes:
    """The first bytes of a file."""
    if not path.exists():
        raise LeapRayError(f"there is no file {path}")
    try:
        with open(path, "rb") as file:
            return file.read(HEAD)
    except OSError as error:
        raise LeapRayError(f"{path} cannot be read: {error.strerror}") from None


__all__ = ["FORMATS", "Format", "RawLayout", "read_volume", "volume_grids"]
