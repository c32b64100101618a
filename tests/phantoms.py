# SPDX-License-Identifier: GPL-3.0-or-later
"""Phantoms written by the reference libraries of the formats, and what they must come back as."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import bpy
import mrcfile
import nibabel
import nrrd
import numpy as np
import tifffile
from numpy.typing import NDArray
from pydicom.dataset import FileDataset, FileMetaDataset
from pydicom.uid import CTImageStorage, ExplicitVRLittleEndian, generate_uid

from leapray.scalar_grid import Leaves

bpy.utils.expose_bundled_modules()
import openvdb  # noqa: E402

SIZE = (11, 9, 7)  # along x, y, z: all differ, so that no mix-up of axes goes unseen
LPS = np.diag([-1.0, -1.0, 1.0, 1.0])  # from and to right, anterior, superior


def turned(degrees: tuple[float, float, float]) -> NDArray[np.float64]:
    """A rotation about x, then y, then z."""
    matrix = np.eye(3)
    for axis, angle in enumerate(np.radians(degrees)):
        a, b = (axis + 1) % 3, (axis + 2) % 3
        turn = np.eye(3)
        turn[a, a], turn[a, b], turn[b, a], turn[b, b] = (
            np.cos(angle),
            -np.sin(angle),
            np.sin(angle),
            np.cos(angle),
        )
        matrix = turn @ matrix
    return matrix


def affine(spacing, degrees=(0, 0, 0), flips=(1, 1, 1), origin=(-31.5, 12.25, 140.0)):
    matrix = np.eye(4)
    matrix[:3, :3] = turned(degrees) @ np.diag(np.multiply(spacing, flips))
    matrix[:3, 3] = origin
    return matrix


PLACES = {
    "upright": affine((1.0, 1.0, 1.0)),
    "anisotropic": affine((0.5, 0.75, 3.0)),
    "oblique": affine((0.9, 0.9, 1.4), (20, -35, 50)),
    "flipped": affine((0.5, 0.75, 3.0), flips=(-1, -1, 1)),
    "left-handed": affine((0.8, 0.7, 1.1), (-10, 15, 5), flips=(-1, 1, 1)),
    "permuted": affine((0.8, 0.7, 1.1)) @ np.eye(4)[[1, 2, 0, 3]],
}


def samples(dtype=np.int16, seed=1) -> NDArray:
    """(nz, ny, nx), from -1000 to 2000 where the type allows it."""
    rng = np.random.default_rng(seed)
    values = rng.integers(-1000, 2000, SIZE[::-1])
    kind = np.dtype(dtype).kind
    if kind == "u":
        values = (values + 1000) % (1 << min(8 * np.dtype(dtype).itemsize, 15))
    if np.dtype(dtype) == np.int8:
        values = values % 256 - 128
    return values.astype(dtype)


def dense(grid, box) -> NDArray:
    """Stored numbers (nz, ny, nx) of the samples first to last (x, y, z) of a grid."""
    first, last = (np.asarray(corner) for corner in box)
    if not isinstance(grid.samples, Leaves):
        (x, y, z), (nx, ny, nz) = first, last + 1
        assert min(first) >= 0
        return grid.samples[z:nz, y:ny, x:nx]
    leaves = grid.samples
    values = np.full((last - first + 1)[::-1], leaves.background, leaves.samples.dtype)

    def put(origin, samples):
        lo, hi = np.maximum(origin, first), np.minimum(origin + samples.shape[0], last + 1)
        if (lo < hi).all():
            (a, b, c), (d, e, f) = lo - first, hi - first
            (i, j, k), (l, m, n) = lo - origin, hi - origin
            values[c:f, b:e, a:d] = samples[k:n, j:m, i:l]

    for origin, samples in zip(leaves.origins, leaves.samples, strict=True):
        put(origin, samples)
    tiles = zip(leaves.tile_origins, leaves.tile_sizes, leaves.tile_values, strict=True)
    for origin, size, value in tiles:
        put(origin, np.broadcast_to(value, (size,) * 3))
    return values


# ---- writers: (path, samples, world_from_index) ----------------------------------------


def write_nifti(path: Path, stored: NDArray, matrix: NDArray, *, two=False, **fields) -> None:
    image = (nibabel.Nifti2Image if two else nibabel.Nifti1Image)(
        stored.T, matrix, dtype=stored.dtype
    )
    image.header.set_xyzt_units("mm")
    for name, value in fields.items():
        image.header[name] = value
    nibabel.save(image, path)


def write_nrrd(path: Path, stored: NDArray, matrix: NDArray, *, space="LPS", **fields) -> None:
    to_space = {"LPS": LPS, "RAS": np.eye(4), "LAS": np.diag([-1.0, 1, 1, 1])}[space] @ matrix
    full = {
        "LPS": "left-posterior-superior",
        "RAS": "right-anterior-superior",
        "LAS": "left-anterior-superior",
    }[space]
    header = {
        "space": full,
        "space directions": to_space[:3, :3].T,
        "space origin": to_space[:3, 3],
        "space units": ["mm", "mm", "mm"],
        "encoding": "raw",
        **fields,
    }
    detached = path.suffix == ".nhdr"
    nrrd.write(str(path), stored, header, detached_header=detached, index_order="C")


def write_mrc(path: Path, stored: NDArray, matrix: NDArray) -> None:
    """Only upright lattices have a place in MRC."""
    with mrcfile.new(path, overwrite=True) as file:
        file.set_data(stored)
        file.set_volume()
        file.voxel_size = tuple(np.diag(matrix)[:3])
        for axis, name in enumerate("xyz"):
            file.header.origin[name] = matrix[axis, 3]


def write_tiff(path: Path, stored: NDArray, matrix: NDArray, **options) -> None:
    """ImageJ's kind, which knows a spacing but no place."""
    x, y, z = np.diag(matrix)[:3]
    tifffile.imwrite(
        path,
        stored,
        imagej=True,
        resolution=(1 / x, 1 / y),
        metadata={"spacing": z, "unit": "mm", "axes": "ZYX"},
        **options,
    )


def write_raw(path: Path, stored: NDArray, matrix: NDArray, **members) -> None:
    stored.tofile(path)
    layout = {
        "size": SIZE,
        "dtype": stored.dtype.name,
        "spacing": np.diag(matrix)[:3].tolist(),
        "origin": matrix[:3, 3].tolist(),
        "big_endian": stored.dtype.str[0] == ">",
        **members,
    }
    path.with_suffix(".json").write_text(json.dumps(layout))


def write_vdb(path: Path, stored: NDArray, matrix: NDArray, name="density", grid=None) -> None:
    grid = grid or openvdb.FloatGrid(0.0)
    grid.name = name
    grid.copyFromArray(np.ascontiguousarray(stored.T))
    grid.transform = openvdb.createLinearTransform(matrix.T.tolist())
    openvdb.write(str(path), grids=[grid])


def dicom_slice(stored: NDArray, matrix: NDArray, k: int, series: str) -> FileDataset:
    """Slice k as a CT image."""
    meta = FileMetaDataset()
    meta.MediaStorageSOPClassUID = CTImageStorage
    meta.MediaStorageSOPInstanceUID = generate_uid()
    meta.TransferSyntaxUID = ExplicitVRLittleEndian
    data = FileDataset(None, {}, file_meta=meta, preamble=b"\0" * 128)
    data.SOPClassUID, data.SOPInstanceUID = CTImageStorage, meta.MediaStorageSOPInstanceUID
    data.SeriesInstanceUID, data.Modality, data.InstanceNumber = series, "CT", k + 1
    lps = LPS @ matrix
    spacing = np.linalg.norm(lps[:3, :3], axis=0)
    along = lps[:3, :3] / spacing
    data.ImageOrientationPatient = [round(float(x), 12) for x in (*along[:, 0], *along[:, 1])]
    data.ImagePositionPatient = [round(float(x), 9) for x in lps[:3, 3] + lps[:3, 2] * k]
    data.PixelSpacing = [round(float(spacing[1]), 12), round(float(spacing[0]), 12)]
    data.SliceThickness = round(float(spacing[2]), 12)
    data.SamplesPerPixel, data.PhotometricInterpretation = 1, "MONOCHROME2"
    data.Rows, data.Columns = stored.shape[1:]
    bits = 8 * stored.itemsize
    data.BitsAllocated, data.BitsStored, data.HighBit = bits, bits, bits - 1
    data.PixelRepresentation = int(stored.dtype.kind == "i")
    data.RescaleSlope, data.RescaleIntercept = 1, 0
    data.PixelData = stored[k].tobytes()
    return data


def write_dicom(
    folder: Path,
    stored: NDArray,
    matrix: NDArray,
    change: Callable[[FileDataset, int], object] | None = None,
    series: str | None = None,
) -> None:
    """A folder of slices whose names say nothing of their order; change may alter each."""
    folder.mkdir(exist_ok=True)
    series = series or generate_uid()
    for k in range(len(stored)):
        data = dicom_slice(stored, matrix, k, series)
        if change is None or change(data, k) is not False:
            name = f"{(k * 5) % 97:03d}_{series[-6:]}.dcm"
            data.save_as(folder / name, enforce_file_format=True)


@dataclass(frozen=True)
class Kind:
    """A way of writing a phantom."""

    name: str  # of the file
    write: Callable[..., None]
    placed: bool  # any affine map, not only spacings
    dtypes: tuple[str, ...]


INTS = ("uint8", "int16", "uint16")
KINDS = {
    "nifti": Kind("a.nii", write_nifti, True, (*INTS, "int32", "float32", "float64")),
    "nifti packed": Kind("a.nii.gz", write_nifti, True, ("int16", "float32")),
    "nifti 2": Kind(
        "a.nii", lambda *args: write_nifti(*args, two=True), True, ("int8", "uint64", "int32")
    ),
    "dicom": Kind("series", write_dicom, True, INTS),
    "nrrd": Kind("a.nrrd", write_nrrd, True, (*INTS, "int8", "int64", "float64", ">u2", ">f4")),
    "nrrd packed": Kind(
        "a.nrrd", lambda *args: write_nrrd(*args, encoding="gzip"), True, ("int16", "float32")
    ),
    "nrrd bzip2": Kind("a.nrrd", lambda *args: write_nrrd(*args, encoding="bzip2"), True, INTS),
    "nrrd text": Kind("a.nrrd", lambda *args: write_nrrd(*args, encoding="ascii"), True, INTS),
    "nrrd detached": Kind("a.nhdr", write_nrrd, True, ("int16", "float32")),
    "mrc": Kind("a.mrc", write_mrc, False, ("int8", "int16", "uint16", "float16", "float32")),
    "tiff": Kind("a.tif", write_tiff, False, ("uint8", "uint16", "float32")),
    "tiff packed": Kind(
        "a.tif",
        lambda *args: write_tiff(*args, compression="zlib"),
        False,
        ("uint8", "uint16", "float32"),
    ),
    "raw": Kind("a.raw", write_raw, False, (*INTS, "float32", ">i4")),
    "vdb": Kind("a.vdb", write_vdb, True, ("float32",)),
}
