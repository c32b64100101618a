# SPDX-License-Identifier: GPL-3.0-or-later
"""A series of DICOM slices, from a folder or from any of its files, by pydicom.

Slices of one series, size and orientation are sorted by their position along the normal. Where
positions are uneven, or slices are missing, the samples are interpolated onto even ones, with
a warning. World space is right, anterior, superior, in millimetres; a tilted gantry gives a
sheared lattice. Files of several frames (enhanced CT and MR) are series of their own.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..file_samples import Samples, Spool
from ..scalar_grid import ScalarGrid
from .common import (
    RAS_FROM_LPS,
    Format,
    Request,
    check_matrix,
    check_samples,
    choose_frame,
    library,
    positive,
    reading,
    refuse,
)
from .slices import place

PREAMBLE = 132  # bytes up to and with "DICM"
RLE = "1.2.840.10008.1.2.5"  # the compression that pydicom undoes by itself
MOST_FILES = 100_000
HEADER_TAGS = [  # what is read of a file to sort it
    "SeriesInstanceUID",
    "SeriesDescription",
    "Modality",
    "Rows",
    "Columns",
    "NumberOfFrames",
    "SamplesPerPixel",
    "PhotometricInterpretation",
    "BitsAllocated",
    "BitsStored",
    "PixelRepresentation",
    "PixelSpacing",
    "ImagerPixelSpacing",
    "SliceThickness",
    "SpacingBetweenSlices",
    "SliceLocation",
    "ImagePositionPatient",
    "ImageOrientationPatient",
    "GridFrameOffsetVector",
    "InstanceNumber",
    "TemporalPositionIdentifier",
    "AcquisitionNumber",
    "EchoNumbers",
    "RescaleSlope",
    "RescaleIntercept",
    "RescaleType",
    "PixelPaddingValue",
    "SharedFunctionalGroupsSequence",
    "PerFrameFunctionalGroupsSequence",
]


ORDER = (  # of pictures in one place
    "TemporalPositionIndex",
    "TemporalPositionIdentifier",
    "AcquisitionNumber",
    "EchoNumbers",
    "InstanceNumber",
)


@dataclass(frozen=True)
class Slice:
    """One picture of a file: where it lies in left, posterior, superior, and what it means."""

    path: Path
    index: int  # among the pictures of the file
    series: str
    shape: tuple[int, int]  # rows, columns
    axes: tuple[float, ...] | None  # directions along a row and along a column, 6
    position: tuple[float, ...] | None
    spacing: tuple[float, float] | None  # between rows, between columns
    thickness: float  # from slice to slice, 0: not told
    order: tuple[float, ...]  # among slices of one position
    scale: float
    offset: float
    header: Any


def read(request: Request) -> ScalarGrid:
    path = request.path
    with reading(path, "DICOM"):
        pydicom = library("pydicom", "pydicom")
        told: list[str] = []
        chosen = _choose(request, _series_of(pydicom, path, told), told)
        head = chosen[0].header
        _check_kind(chosen[0])
        frames, matrix = place(path, chosen, told)
        frame = choose_frame(request, len(frames), told)
        slices, weights = frames[frame]
        stored, scale, offset = _stored(pydicom, request, slices)
        samples = weights(check_samples(path, stored))
        if str(head.get("PhotometricInterpretation")) == "MONOCHROME1":
            told.append(f"{path} shows small values white; the values were left as they are")
        padding = head.get("PixelPaddingValue")
        return ScalarGrid(
            str(head.get("SeriesDescription") or "").strip() or path.name,
            samples,
            check_matrix(path, RAS_FROM_LPS @ matrix),
            scale=scale,
            offset=offset,
            meters=1e-3,
            quantity=_quantity(head),
            no_data=_padding(head, padding) if samples.dtype.kind in "iu" else None,
            source=str(path),
            files=tuple(sorted({str(f) for each in slices for f in (each.path, each.path.parent)})),
            warnings=tuple(told),
        )


def grids(path: Path) -> list[str]:
    with reading(path, "DICOM"):
        found = _series_of(library("pydicom", "pydicom"), path, [])
        return sorted(found, key=lambda uid: -len(found[uid]))


# ---- which slices ----------------------------------------------------------------


def _series_of(pydicom, path: Path, told: list[str]) -> dict[str, list[Slice]]:
    """The slices of each series of a folder, or of the series of one file."""
    own = None
    if path.is_file():
        if not is_dicom_file(path):
            raise refuse(path, "it is no DICOM")
        first = list(_slices(pydicom, path))
        if not first:
            raise refuse(path, "it holds no picture")
        own = first[0].series
        if len(first) > 1:
            return {own: first}
    found: dict[str, list[Slice]] = {}
    broken: list[str] = []
    for file in dicom_files(path if own is None else path.parent):
        try:
            for slice_ in _slices(pydicom, file):
                if own in (None, slice_.series):
                    found.setdefault(slice_.series, []).append(slice_)
        except Exception:  # one broken file among many is told below
            broken.append(file.name)
    if not found:
        why = f"; {broken[0]} is broken" if broken else ""
        raise refuse(path, f"it holds no DICOM pictures{why}")
    if broken:
        folder = path if own is None else path.parent
        told.append(f"{folder} holds {len(broken)} broken files, {broken[0]} among them")
    return found


def dicom_files(folder: Path) -> list[Path]:
    """DICOM files of a folder; where it has none itself, of all folders in it."""
    for files in (folder.iterdir(), folder.rglob("*")):
        found = [file for file in _first(files) if is_dicom_file(file)]
        if found:
            return sorted(found)
    return []


def _first(files: Iterable[Path]) -> Iterator[Path]:
    for n, file in enumerate(files):
        if n == MOST_FILES:
            return
        if file.name != "DICOMDIR" and file.is_file():
            yield file


def is_dicom_file(file: Path) -> bool:
    try:
        with open(file, "rb") as opened:
            return _is_dicom(opened.read(PREAMBLE))
    except OSError:
        return False


def _slices(pydicom, file: Path) -> Iterator[Slice]:
    """The pictures of one file, of which no pixel is read."""
    head = pydicom.dcmread(file, stop_before_pixels=True, specific_tags=HEADER_TAGS)
    if not (head.get("Rows") and head.get("Columns")):
        return
    shared = _groups(head.get("SharedFunctionalGroupsSequence"))
    each = head.get("PerFrameFunctionalGroupsSequence") or []
    for index in range(max(int(head.get("NumberOfFrames") or 1), 1)):
        groups = {**shared, **_groups(each[index : index + 1])}
        yield _slice(file, index, head, {**_plain(head), **groups})


def _plain(head) -> dict[str, Any]:
    return {name: head.get(name) for name in HEADER_TAGS[:-2]}


def _groups(sequence) -> dict[str, Any]:
    """The members of the groups of one frame, by their names."""
    found: dict[str, Any] = {}
    for item in list(sequence or [])[:1]:
        for group in item:
            for member in (group.value or [])[:1] if group.VR == "SQ" else ():
                found.update({element.keyword: element.value for element in member})
    return found


def _slice(file: Path, index: int, head, told: dict[str, Any]) -> Slice:
    spacing = _floats(told.get("PixelSpacing"), 2) or _floats(told.get("ImagerPixelSpacing"), 2)
    thickness = positive(told.get("SpacingBetweenSlices")) or positive(told.get("SliceThickness"))
    scale, offset = told.get("RescaleSlope"), told.get("RescaleIntercept")
    return Slice(
        file,
        index,
        str(head.get("SeriesInstanceUID") or ""),
        (int(head.Rows), int(head.Columns)),
        _floats(told.get("ImageOrientationPatient"), 6),
        _position(index, head, told, thickness),
        (spacing[0], spacing[1]) if spacing else None,
        thickness,
        (*(_number(told.get(key)) for key in ORDER), index),
        1.0 if scale is None else float(scale),
        0.0 if offset is None else float(offset),
        head,
    )


def _position(index: int, head, told: dict[str, Any], thickness: float) -> tuple[float, ...] | None:
    """Where a picture lies; those of a file that tells only of the first go along the normal."""
    position = _floats(told.get("ImagePositionPatient"), 3)
    alone = int(head.get("NumberOfFrames") or 1) == 1
    if position is None or alone or head.get("PerFrameFunctionalGroupsSequence"):
        return position
    axes = _floats(told.get("ImageOrientationPatient"), 6)
    offsets = told.get("GridFrameOffsetVector")  # of doses
    if axes is None or not (offsets or thickness):
        return None
    rise = float(offsets[index]) if offsets else index * thickness
    return tuple((position + rise * np.cross(axes[:3], axes[3:])).tolist())


def _floats(values, n: int) -> tuple[float, ...] | None:
    """n finite numbers, or None."""
    try:
        found = tuple(float(value) for value in values)
    except (TypeError, ValueError):
        return None
    return found if len(found) == n and np.isfinite(found).all() else None


def _number(value) -> float:
    try:
        return float(value)
    except (TypeError, ValueError):
        return 0.0


def _choose(request: Request, found: dict[str, list[Slice]], told: list[str]) -> list[Slice]:
    """The slices of the series that is asked for, else of the largest; of one size and side."""
    path = request.path
    if request.grid is not None and request.grid not in found:
        raise refuse(path, f"it has no series {request.grid!r}; there are {', '.join(found)}")
    uid = request.grid or max(found, key=lambda uid: len(found[uid]))
    if request.grid is None and len(found) > 1:
        told.append(
            f"{path} holds {len(found)} series, of which the largest, {uid} of "
            f"{len(found[uid])} slices, was read"
        )
    groups: dict[tuple, list[Slice]] = {}
    for slice_ in found[uid]:
        axes = slice_.axes and tuple(np.round(slice_.axes, 3) + 0.0)
        groups.setdefault((slice_.shape, axes), []).append(slice_)
    largest = max(groups.values(), key=len)
    left = len(found[uid]) - len(largest)
    if left:
        told.append(f"{path} holds {left} slices of another size or orientation, which were left")
    return largest


def _check_kind(slice_: Slice) -> None:
    head, file = slice_.header, slice_.path
    if int(head.get("SamplesPerPixel") or 1) != 1:
        raise refuse(file, "it holds colours (RGB), and one number a sample is needed")
    if str(head.get("PhotometricInterpretation", "")).startswith("PALETTE"):
        raise refuse(file, "it holds colours (of a palette), and one number a sample is needed")
    syntax = head.file_meta.get("TransferSyntaxUID")
    if syntax is not None and syntax.is_compressed and syntax not in (RLE, DEFLATED):
        raise refuse(
            file,
            f"its pictures are compressed ({syntax.name}); write them uncompressed, for example "
            "by `gdcmconv --raw` or `dcmdjpeg`",
        )


DEFLATED = "1.2.840.10008.1.2.1.99"  # the file as a whole, which pydicom unpacks


# ---- what they hold ------------------------------------------------------------------


def _stored(pydicom, request: Request, slices: list[Slice]) -> tuple[Samples, float, float]:
    """Numbers (n, rows, columns), and what turns them into values.

    Where slices differ in scale, as those of PET do, the numbers are the values, as floats.
    """
    scalings = {(each.scale, each.offset) for each in slices}
    alike = len(scalings) == 1
    spool: Spool | None = None
    opened: tuple[Path, NDArray] | None = None
    for n, each in enumerate(slices):
        request.check_stopped(n / len(slices))
        if opened is None or opened[0] != each.path:
            opened = each.path, _pictures(pydicom, each.path)
        picture = opened[1][each.index]
        if spool is None:
            dtype = picture.dtype if alike else np.dtype(np.float32)
            spool = Spool((len(slices), *each.shape), dtype)
        if alike and picture.dtype != spool.dtype:
            raise refuse(each.path, f"it holds {picture.dtype}, other slices {spool.dtype}")
        spool[n : n + 1] = picture if alike else picture * each.scale + each.offset
    assert spool is not None
    scale, offset = scalings.pop() if alike else (1.0, 0.0)
    if scale == 0:
        raise refuse(slices[0].path, "its rescale slope is 0")
    return spool.samples(), scale, offset


def _pictures(pydicom, file: Path) -> NDArray:
    """All pictures of a file, (frames, rows, columns), unused bits cleared."""
    data = pydicom.dcmread(file)
    n = max(int(data.get("NumberOfFrames") or 1), 1)
    shape = (n, int(data.Rows), int(data.Columns))
    if "PixelData" not in data:
        raise refuse(file, "it has no picture, or one of floats")
    bits, signed = int(data.BitsAllocated), int(data.get("PixelRepresentation") or 0)
    if bits not in (8, 16, 32):
        raise refuse(file, f"samples of {bits} bits are not read, only of 8, 16 and 32")
    syntax = data.file_meta.get("TransferSyntaxUID")
    if syntax == RLE:
        return data.pixel_array.reshape(shape)
    big = syntax is not None and not syntax.is_little_endian
    dtype = np.dtype(f"{'>' if big else '<'}{'i' if signed else 'u'}{bits // 8}")
    wanted = int(np.prod(shape)) * dtype.itemsize
    if len(data.PixelData) < wanted:
        raise refuse(file, f"its picture takes {wanted} bytes, and it has {len(data.PixelData)}")
    stored = np.frombuffer(data.PixelData, dtype, wanted // dtype.itemsize).reshape(shape)
    unused = bits - int(data.get("BitsStored") or bits)
    native = stored.astype(dtype.newbyteorder("="), copy=False)
    return (native << unused) >> unused if 0 < unused < bits else native


def _padding(head, value) -> float | None:
    """The stored number of what lies outside the picture, with the sign that samples have."""
    if value is None:
        return None
    bits = int(head.get("BitsAllocated") or 16)
    try:
        number = int(value)
    except (TypeError, ValueError):
        return None
    if int(head.get("PixelRepresentation") or 0) and number >= 1 << (bits - 1):
        number -= 1 << bits
    return float(number)


def _quantity(head) -> str:
    told = str(head.get("RescaleType") or "").strip()
    if told and told != "US":  # unspecified
        return told
    return "HU" if str(head.get("Modality")) == "CT" else ""


def _is_dicom(head: bytes) -> bool:
    return head[128:132] == b"DICM"


FORMAT = Format("DICOM", (".dcm", ".dicom", ".ima"), read, grids, _is_dicom)
