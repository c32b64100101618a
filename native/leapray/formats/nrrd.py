# SPDX-License-Identifier: GPL-3.0-or-later
"""NRRD, with its header in the same file (.nrrd) or beside it (.nhdr), by pynrrd.

An anatomical space is turned into right, anterior, superior; any other is taken as it is.
Samples of raw encoding are mapped, not read. Regions of a segmentation as 3D Slicer writes it
give their names and colours.
"""

from __future__ import annotations

import bz2
import contextlib
import gzip
import re
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ..file_samples import Samples
from ..scalar_grid import ScalarGrid
from .common import (
    Format,
    Request,
    check_matrix,
    check_samples,
    choose_frame,
    library,
    one_grid,
    only_grid,
    reading,
    refuse,
    scaled,
    sides,
    stem,
    unpacked,
)

METERS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "microns": 1e-6, "nm": 1e-9}
SIGNS = {"left": -1, "right": 1, "posterior": -1, "anterior": 1, "inferior": -1, "superior": 1}
LETTERS = {word[0]: word for word in SIGNS}
ALONG_SPACE = ("domain", "space", "???", "none", "")
FRAMES = ("list", "time")
PACKED: dict[str, Callable[..., Any]] = {
    **dict.fromkeys(("gzip", "gz"), gzip.open),
    **dict.fromkeys(("bzip2", "bz2"), bz2.open),
}
SKIPS = "line skip", "lineskip", "byte skip", "byteskip"


def read(request: Request) -> ScalarGrid:
    path = request.path
    with reading(path, "NRRD"):
        nrrd = library("nrrd", "pynrrd")
        only_grid(request, stem(path))
        told: list[str] = []
        with open(path, "rb") as file:
            header = nrrd.read_header(file)
            axes = _axes_along_space(path, header)
            stored = _stored(nrrd, request, header, file)
            beside = _beside(header)
        samples = _one_frame(request, header, axes, stored, told)
        labels = _segments(header)
        return ScalarGrid(
            stem(path),
            check_samples(path, samples),
            check_matrix(path, _matrix(path, header, axes, told)),
            kind="labels" if labels else "scalar",
            meters=_meters(header, axes),
            quantity=str(header.get("sample units", "")),
            label_names={value: name for value, (name, _) in labels.items()},
            label_colors={value: color for value, (_, color) in labels.items() if color},
            source=str(path),
            files=() if beside is None else (str(path.parent / beside),),
            warnings=tuple(told),
        )


def _stored(nrrd, request: Request, header: dict[str, Any], file: IO[bytes]) -> Samples:
    """All numbers, the file's first axis last."""
    path, encoding = request.path, str(header["encoding"]).lower()
    open_packed = PACKED.get(encoding)
    if encoding != "raw" and not (open_packed and len(header["sizes"]) == 3):
        return nrrd.read_data(header, file, str(path), "C")
    dtype = nrrd.reader._determine_datatype(header)
    if dtype.kind not in "iuf":
        raise refuse(path, f"samples of the type {header['type']} are no real numbers")
    if any(int(header.get(name, 0)) for name in SKIPS) and open_packed:
        return nrrd.read_data(header, file, str(path), "C")
    beside = _beside(header)
    if beside is not None and re.search(r"^LIST\b|%\d*d", beside):
        raise refuse(path, "its samples lie in several files, and one is needed")
    data = path if beside is None else path.parent / beside
    if beside is not None and not data.is_file():
        raise refuse(path, f"there is no file {data}, which is to hold the samples")
    shape = tuple(int(n) for n in header["sizes"][::-1])
    if open_packed:
        with contextlib.ExitStack() as opened:
            packed = file if beside is None else opened.enter_context(open(data, "rb"))
            return unpacked(request, opened.enter_context(open_packed(packed)), dtype, shape)
    nbytes = int(np.prod(shape, dtype=np.int64)) * dtype.itemsize
    start = _start(header, file if beside is None else None, data, nbytes)
    if start < 0 or start + nbytes > data.stat().st_size:
        have = data.stat().st_size - max(start, 0)
        raise refuse(path, f"its samples take {nbytes} bytes, and the file has {max(have, 0)}")
    return np.memmap(data, dtype, "r", start, shape)


def _beside(header: dict[str, Any]) -> str | None:
    """The file that holds the samples, if it is another one."""
    told = header.get("data file", header.get("datafile"))
    return None if told is None else str(told)


def _start(header: dict[str, Any], attached: IO[bytes] | None, data: Path, nbytes: int) -> int:
    """Where the first sample lies in the file."""
    lines = int(header.get("line skip", header.get("lineskip", 0)))
    skipped = int(header.get("byte skip", header.get("byteskip", 0)))
    if skipped == -1:
        return data.stat().st_size - nbytes
    with open(data, "rb") as file:
        file.seek(attached.tell() if attached else 0)
        for _ in range(lines):
            file.readline()
        return file.tell() + skipped


def _axes_along_space(path: Path, header: dict[str, Any]) -> list[int]:
    """The three axes of the lattice; one more may count frames."""
    n = int(header["dimension"])
    kinds = [str(kind).lower() for kind in header.get("kinds", ["???"] * n)]
    directions = header.get("space directions")
    if directions is not None:
        along = [a for a in range(n) if np.isfinite(directions[a]).all()]
    else:
        along = [a for a in range(n) if kinds[a] in ALONG_SPACE]
    others = [a for a in range(n) if a not in along]
    several = [kinds[a] for a in others if kinds[a] not in FRAMES and header["sizes"][a] > 1]
    if several:
        kind = several[0]
        what = "colours (RGB)" if "color" in kind else f"several numbers a sample ({kind})"
        raise refuse(path, f"it holds {what}, and one number a sample is needed")
    if directions is None and len(along) == 4:
        along = along[:3]
    if len(along) != 3 or n > 4:
        raise refuse(path, f"its {sides(tuple(header['sizes'][::-1]))} samples make no volume")
    return along


def _one_frame(
    request: Request, header: dict[str, Any], axes: list[int], stored: Samples, told: list[str]
) -> Samples:
    n = stored.ndim
    others = [axis for axis in range(n) if axis not in axes]
    count = int(header["sizes"][others[0]]) if others else 1
    frame = choose_frame(request, count, told)
    if not others:
        return stored
    place: list[Any] = [slice(None)] * n
    place[n - 1 - others[0]] = frame
    return stored[tuple(place)]


def _matrix(
    path: Path, header: dict[str, Any], axes: list[int], told: list[str]
) -> NDArray[np.float64]:
    matrix = np.eye(4)
    if header.get("space directions") is not None:
        directions = np.array([header["space directions"][a] for a in axes], np.float64)
        if directions.shape != (3, 3):
            raise refuse(path, f"its space has {directions.shape[1]} axes where three are needed")
        matrix[:3, :3] = directions.T
        origin = header.get("space origin")
        matrix[:3, 3] = 0.0 if origin is None else np.nan_to_num(origin)
        return np.diag([*_signs(path, header), 1.0]) @ matrix
    spacings = _per_axis(header, "spacings", axes)
    if not np.isfinite(spacings).all():
        told.append(f"{path} does not say how far its samples lie apart")
    matrix = scaled(matrix, np.where(np.isfinite(spacings), spacings, 1.0))
    first = _per_axis(header, "axis mins", axes)
    told_centers = header.get("centerings", header.get("centers", ""))  # two names of one field
    centers = told_centers.split() if isinstance(told_centers, str) else told_centers
    inside = [0.5 if a < len(centers) and centers[a] == "cell" else 0.0 for a in axes]
    start = first + np.array(inside) * np.diag(matrix)[:3]
    matrix[:3, 3] = np.where(np.isfinite(start), start, 0.0)
    return matrix


def _per_axis(header: dict[str, Any], name: str, axes: list[int]) -> NDArray[np.float64]:
    """Numbers of the three axes, NaN where they are not told."""
    values = header.get(name)
    return np.array([np.nan if values is None else float(values[axis]) for axis in axes])


def _signs(path: Path, header: dict[str, Any]) -> list[float]:
    """What turns the axes of the file's space into right, anterior, superior."""
    space = str(header.get("space", "")).lower().removesuffix("-time").removesuffix("t")
    words = space.split("-") if "-" in space else [LETTERS.get(letter, "") for letter in space]
    if len(words) != 3 or not all(word in SIGNS for word in words):
        return [1.0, 1.0, 1.0]  # a scanner's or no anatomical space
    if [word in pair for word, pair in zip(words, AXES, strict=True)] != [True] * 3:
        raise refuse(path, f"its space {header['space']!r} is not known")
    return [float(SIGNS[word]) for word in words]


AXES = (("left", "right"), ("posterior", "anterior"), ("inferior", "superior"))


def _meters(header: dict[str, Any], axes: list[int]) -> float:
    """Metres of a unit of the space, 0 where the axes have none in common."""
    units = header.get("space units")
    if units is None:
        told = header.get("units")
        units = [told[axis] for axis in axes] if told is not None else []
    found = {METERS.get(str(unit).strip().strip('"').lower(), 0.0) for unit in units}
    return found.pop() if len(found) == 1 else 0.0


def _segments(header: dict[str, Any]) -> dict[int, tuple[str, tuple[float, float, float] | None]]:
    """Regions as 3D Slicer names them: number -> name, colour."""
    found = {}
    for key, value in header.items():
        match = re.fullmatch(r"(Segment\d+)_LabelValue", str(key))
        if match:
            name = str(header.get(f"{match[1]}_Name", match[1]))
            color = [float(x) for x in str(header.get(f"{match[1]}_Color", "")).split()]
            rgb = (color[0], color[1], color[2]) if len(color) == 3 else None
            found[int(value)] = name, rgb
    return found


FORMAT = Format(
    "NRRD", (".nrrd", ".nhdr"), read, one_grid, lambda head: head.startswith(b"NRRD000")
)
