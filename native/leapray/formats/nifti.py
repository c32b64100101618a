# SPDX-License-Identifier: GPL-3.0-or-later
"""NIfTI-1 and NIfTI-2, by nibabel.

The place of the samples is the sform, else the qform, else the spacing alone, as the format's
"method 1" has it. World space is right, anterior, superior, in the file's unit of length.
"""

from __future__ import annotations

import gzip
import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..file_samples import Samples
from ..scalar_grid import ScalarGrid
from .common import (
    HEAD,
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

METERS = {"meter": 1.0, "mm": 1e-3, "micron": 1e-6}
LABELS = (1002, 1005)  # intents: label, name of a brain region
PACKED = 1032  # bytes that one of gzip's can stand for
COLORS = ("RGB", "RGBA")


def read(request: Request) -> ScalarGrid:
    path = request.path
    with reading(path, "NIfTI"):
        nibabel = library("nibabel", "nibabel")
        only_grid(request, stem(path))
        image = _open(nibabel, path)
        header = image.header
        if header.get_value_label("datatype") in COLORS:
            raise refuse(path, "it holds colours (RGB), and one number a sample is needed")
        told: list[str] = []
        samples = _samples(request, image, told)
        return ScalarGrid(
            stem(path),
            check_samples(path, samples),
            check_matrix(path, _matrix(path, header, told)),
            scale=float(image.dataobj.slope),
            offset=float(image.dataobj.inter),
            kind="labels" if int(header["intent_code"]) in LABELS else "scalar",
            meters=METERS.get(header.get_xyzt_units()[0], 0.0),
            source=str(path),
            warnings=tuple(told),
        )


def _open(nibabel, path: Path):
    """The image, whatever the file is called, of which no sample is read."""
    with nibabel.openers.ImageOpener(str(path)) as file:
        head = file.read(HEAD)
    if not _is_nifti(head):
        raise refuse(path, "it is no NIfTI")
    two = head[:4] in (b"\x1c\x02\0\0", b"\0\0\x02\x1c")  # the header's length, 540
    kind = nibabel.Nifti2Image if two else nibabel.Nifti1Image
    return kind.from_file_map(kind.make_file_map({"image": str(path)}))


def _samples(request: Request, image, told: list[str]) -> Samples:
    """The stored numbers of one frame, (nz, ny, nx)."""
    shape = tuple(int(n) for n in image.shape)
    if min(shape, default=0) < 1 or len(shape) < 2:
        raise refuse(request.path, f"{sides(shape[::-1])} samples make no volume")
    if max(shape[4:], default=1) > 1:
        raise refuse(request.path, f"its {sides(shape[::-1])} samples hold more than one number")
    dtype, offset = image.dataobj.dtype, int(image.dataobj.offset)
    packed = request.path.suffix.lower() == ".gz"
    nbytes = math.prod(shape) * dtype.itemsize
    most = request.path.stat().st_size * (PACKED if packed else 1)
    if nbytes > most:
        raise refuse(request.path, f"its samples take {nbytes} bytes, more than the file can hold")
    n = shape[3] if len(shape) > 3 else 1
    frame = choose_frame(request, n, told)
    lattice = (*shape, 1)[2::-1]
    offset += frame * math.prod(lattice) * dtype.itemsize
    if not packed:
        return np.memmap(request.path, dtype, "r", offset, lattice)
    with gzip.open(request.path) as file:
        file.seek(offset)
        return unpacked(request, file, dtype, lattice)


def _matrix(path: Path, header, told: list[str]) -> NDArray[np.float64]:
    if int(header["sform_code"]) > 0:
        return header.get_sform()
    if int(header["qform_code"]) > 0:
        return header.get_qform()
    told.append(f"{path} does not say how it is oriented")
    spacing = [*map(float, header.get_zooms()), 1.0][:3]
    return scaled(np.eye(4), spacing)


def _is_nifti(head: bytes) -> bool:
    return head[344:348] == b"n+1\0" or head[4:8] == b"n+2\0"


FORMAT = Format("NIfTI", (".nii", ".nii.gz"), read, one_grid, _is_nifti)
