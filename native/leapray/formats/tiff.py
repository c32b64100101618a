# SPDX-License-Identifier: GPL-3.0-or-later
"""TIFF stacks of microscopy and tomography, by tifffile.

Pages are the slices along z; y runs as the pictures' rows do, downwards. The spacing is that of
ImageJ, of OME's metadata, or of the resolution. Channels are grids of their own, times frames.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from ..file_samples import Samples, Spool
from ..scalar_grid import ScalarGrid
from .common import (
    Format,
    Request,
    check_matrix,
    check_samples,
    choose_frame,
    library,
    numbers,
    only_grid,
    positive,
    reading,
    refuse,
    scaled,
    stem,
)

METERS = {
    **{"m": 1.0, "cm": 1e-2, "mm": 1e-3, "nm": 1e-9, "inch": 0.0254, "in": 0.0254, "pm": 1e-12},
    **dict.fromkeys(("um", "\u00b5m", "\u03bcm", "micron", "microns", "\\u00b5m"), 1e-6),
    "\u00c5": 1e-10,
}
RESOLUTION_UNITS = {2: 0.0254, 3: 0.01}  # inch, centimetre
Spacing = tuple[tuple[float, float, float], float]  # x, y, z in units of so many metres


def read(request: Request) -> ScalarGrid:
    path = request.path
    with reading(path, "TIFF") as logged, library("tifffile", "tifffile").TiffFile(path) as file:
        told: list[str] = []
        series = _largest(path, file, told)
        if any("offset" in error for error in logged):  # the chain of pages
            raise refuse(path, f"it is cut short or broken after {len(file.pages)} pages")
        axes = _axes(path, series)
        name, channel = _channel(request, axes, series.shape)
        frames = series.shape[axes.index("T")] if "T" in axes else 1
        frame = choose_frame(request, frames, told)
        samples = _samples(request, series, axes, {"C": channel, "T": frame})
        (x, y, z), meters = _spacing(file, told, path)
        return ScalarGrid(
            name,
            check_samples(path, samples),
            check_matrix(path, scaled(np.eye(4), (x, y, z))),
            meters=meters,
            source=str(path),
            warnings=tuple(told),
        )


def grids(path: Path) -> list[str]:
    with reading(path, "TIFF"), library("tifffile", "tifffile").TiffFile(path) as file:
        series = _largest(path, file, [])
        return _channels(path, _axes(path, series), series.shape)


def _largest(path: Path, file, told: list[str]):
    """The series of pages with most samples."""
    found = sorted(file.series, key=lambda series: -series.size)
    if not found or not found[0].size:
        raise refuse(path, "it holds no picture")
    if len(found) > 1:
        shapes = f"{' x '.join(map(str, found[0].shape))}"
        told.append(f"{path} holds {len(found)} series of pictures, of which that of {shapes}")
        told[-1] += " was read"
    return found[0]


def _axes(path: Path, series) -> str:
    """Letters of the series' axes, of T, C, Z, Y and X only."""
    axes = series.axes
    if "S" in axes and series.shape[axes.index("S")] > 1:
        raise refuse(path, "it holds colours (RGB), and one number a sample is needed")
    if "Z" not in axes:  # pages without a word what they are, else times
        along = next((letter for letter in "IQRT" if letter in axes), None)
        axes = axes.replace(along, "Z") if along else axes
    unknown = [a for a, n in zip(axes, series.shape, strict=True) if a not in "TCZYX" and n > 1]
    if unknown or not {"X", "Y"} <= set(axes):
        raise refuse(path, f"its axes {axes} are not those of a volume, at most TCZYX")
    return axes


def _channels(path: Path, axes: str, shape: tuple[int, ...]) -> list[str]:
    n = shape[axes.index("C")] if "C" in axes else 1
    return [f"channel {c + 1}" for c in range(n)] if n > 1 else [stem(path)]


def _channel(request: Request, axes: str, shape: tuple[int, ...]) -> tuple[str, int]:
    """The name and the number of the channel that is asked for, else of the first."""
    names = _channels(request.path, axes, shape)
    if len(names) == 1:
        only_grid(request, names[0])
    if request.grid is not None and request.grid not in names:
        raise refuse(request.path, f"it has no grid {request.grid!r}; it has {', '.join(names)}")
    name = request.grid or names[0]
    return name, names.index(name)


def _samples(request: Request, series, axes: str, chosen: dict[str, int]) -> Samples:
    """One channel at one time, (nz, ny, nx); where the file is not packed a memory map."""
    path = request.path
    dtype = np.dtype(series.dtype)
    if dtype.kind not in "iuf" or dtype.itemsize > 8:
        raise refuse(path, f"samples of the type {dtype} are no real numbers")
    if series.dataoffset is not None:
        order = dtype.newbyteorder(series.parent.byteorder if hasattr(series, "parent") else "=")
        if path.stat().st_size < series.dataoffset + series.size * dtype.itemsize:
            raise refuse(path, "the file ends before its last sample")
        stored: NDArray = np.memmap(path, order, "r", series.dataoffset, tuple(series.shape))
    elif _is_of_planes(series, axes):
        return _planes(request, series, axes, chosen)
    else:
        stored = series.asarray()
    place = _place(axes, chosen)
    left = [a for a in axes if a in "ZYX"]
    stored = stored[place]
    if "Z" not in left:
        stored, left = stored[None], ["Z", *left]
    return stored.transpose([left.index(a) for a in "ZYX"])


def _place(axes: str, chosen: dict[str, int]) -> tuple[int | slice, ...]:
    """What is wanted along each axis."""
    return tuple(chosen.get(a, 0) if a not in "ZYX" else slice(None) for a in axes)


def _is_of_planes(series, axes: str) -> bool:
    """Whether each page is a picture of its own."""
    pages = list(series.pages)
    planes = math.prod(series.shape[:-2])
    return (
        axes.endswith("YX")
        and len(pages) == planes
        and all(page is not None and page.shape == series.shape[-2:] for page in pages)
    )


def _planes(request: Request, series, axes: str, chosen: dict[str, int]) -> Samples:
    """As `_samples`, unpacked page by page."""
    numbers = np.arange(len(series.pages)).reshape(series.shape[:-2])
    wanted = np.atleast_1d(numbers[_place(axes[:-2], chosen)]).tolist()
    spool = Spool((len(wanted), *series.shape[-2:]), np.dtype(series.dtype).newbyteorder("="))
    for k, number in enumerate(wanted):
        request.check_stopped(k / len(wanted))
        spool[k : k + 1] = series.pages[number].asarray()
    return spool.samples()


def _spacing(file, told: list[str], path: Path) -> Spacing:
    """How far samples lie apart, and metres a unit (0: unknown)."""
    found = _of_ome(file) or _of_imagej(file) or _of_resolution(file)
    if found is None:
        told.append(f"{path} does not say how far its samples lie apart")
        return (1.0, 1.0, 1.0), 0.0
    (x, y, z), meters = found
    if not z:
        z = x
        told.append(f"{path} does not say how far its slices lie apart; {numbers(z)} was taken")
    return (x, y, z), meters


def _of_ome(file) -> Spacing | None:
    if not file.is_ome:
        return None
    pixels = ElementTree.fromstring(file.ome_metadata).find(".//{*}Pixels")
    told = {} if pixels is None else pixels.attrib
    size = [positive(told.get(f"PhysicalSize{axis}")) for axis in "XYZ"]
    if not (size[0] and size[1]):
        return None
    units = [METERS.get(told.get(f"PhysicalSize{axis}Unit", "\u00b5m"), 0.0) for axis in "XYZ"]
    if not all(units):
        return (size[0], size[1], size[2]), 0.0
    x, y, z = (s * unit / units[0] for s, unit in zip(size, units, strict=True))
    return (x, y, z), units[0]


def _of_imagej(file) -> Spacing | None:
    if not file.is_imagej:
        return None
    told = file.imagej_metadata or {}
    x, y = (_pixel(file, axis) for axis in "XY")
    z = positive(told.get("spacing"))
    if not (x and y and (z or x != 1 or y != 1)):
        return None
    unit = re.sub(r"\\u00[bB]5", "\u00b5", str(told.get("unit", "")))
    return (x, y, z), METERS.get(unit.lower() if unit.isascii() else unit, 0.0)


def _of_resolution(file) -> Spacing | None:
    x, y = (_pixel(file, axis) for axis in "XY")
    tag = file.pages[0].tags.get("ResolutionUnit")
    meters = RESOLUTION_UNITS.get(int(tag.value) if tag else 1, 0.0)
    return ((x * meters * 1e3, y * meters * 1e3, 0.0), 1e-3) if x and y and meters else None


def _pixel(file, axis: str) -> float:
    """Width of a pixel in units of the resolution; 0 where it is not told."""
    tag = file.pages[0].tags.get(f"{axis}Resolution")
    over, under = tag.value if tag else (0, 1)
    return positive(under / over) if over else 0.0


def _is_tiff(head: bytes) -> bool:
    return head[:4] in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")


FORMAT = Format("TIFF", (".tif", ".tiff"), read, grids, _is_tiff)
