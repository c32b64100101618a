# SPDX-License-Identifier: GPL-3.0-or-later
"""MRC and CCP4 maps of electron microscopy, by mrcfile.

The place is the header's origin where that is not 0, else the start of the lattice (as most
viewers have it), in angstrom; the axes may be stored in any order, and may be askew.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

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
    stem,
)

ANGSTROM = 1e-10
IMOD_STAMP, IMOD_SIGNED = 1146047817, 1


def read(request: Request) -> ScalarGrid:
    path = request.path
    with reading(path, "MRC"):
        mrcfile = library("mrcfile", "mrcfile")
        only_grid(request, stem(path))
        told: list[str] = []
        with mrcfile.mmap(path, mode="r") as file:
            header, stored = file.header.copy(), file.data
        if stored.dtype.kind == "c":
            raise refuse(path, "its samples are complex, and real ones are needed")
        samples = _in_order(path, header, _one_frame(request, stored, told))
        if samples.dtype == np.int8 and _imod_is_unsigned(header):
            samples = samples.view(np.uint8)
        matrix, meters = _matrix(path, header, told)
        return ScalarGrid(
            stem(path),
            check_samples(path, samples),
            check_matrix(path, matrix),
            meters=meters,
            source=str(path),
            warnings=tuple(told),
        )


def _one_frame(request: Request, stored: NDArray, told: list[str]) -> NDArray:
    """Sections, rows and columns of one volume, (3 axes)."""
    if stored.ndim == 2:
        stored = stored[None]
    n = len(stored) if stored.ndim == 4 else 1
    frame = choose_frame(request, n, told)
    return stored[frame] if stored.ndim == 4 else stored


def _in_order(path: Path, header, stored: NDArray) -> NDArray:
    """Samples (nz, ny, nx) from sections, rows and columns, each of which may be any axis."""
    axes = [int(header[name]) for name in ("maps", "mapr", "mapc")]
    if axes == [0, 0, 0]:  # old files
        return stored
    if sorted(axes) != [1, 2, 3]:
        raise refuse(path, f"its axes are {axes[::-1]} where a permutation of 1, 2, 3 is needed")
    return stored.transpose([axes.index(axis) for axis in (3, 2, 1)])


def _imod_is_unsigned(header) -> bool:
    """Whether IMOD wrote bytes 0..255, which the format's mode 0 has no word for."""
    stamp, flags = np.frombuffer(header["extra2"].tobytes()[40:48], header["nx"].dtype)
    return stamp == IMOD_STAMP and not flags & IMOD_SIGNED


def _matrix(path: Path, header, told: list[str]) -> tuple[NDArray[np.float64], float]:
    """world_from_index, and metres a unit."""
    sampling = np.array([header[name] for name in ("mx", "my", "mz")], np.float64)
    cell = np.array([header.cella[name] for name in "xyz"], np.float64)
    with np.errstate(all="ignore"):
        spacing = cell / sampling
    known = np.isfinite(spacing).all() and (spacing > 0).all()
    if not known:
        told.append(f"{path} does not say how far its samples lie apart")
        spacing = np.ones(3)
    angles = np.array([header.cellb[name] for name in ("alpha", "beta", "gamma")], np.float64)
    matrix = scaled(_cell_axes(path, angles), spacing)
    origin = np.array([header.origin[name] for name in "xyz"], np.float64)
    if origin.any():
        matrix[:3, 3] = origin
    else:
        stored = np.array([header[f"n{name}start"] for name in "xyz"], np.float64)
        axes = [int(header[name]) or k + 1 for k, name in enumerate(("mapc", "mapr", "maps"))]
        first = np.zeros(3)
        first[[axis - 1 for axis in axes]] = stored  # starts are of columns, rows, sections
        matrix[:3, 3] = matrix[:3, :3] @ first
    return matrix, ANGSTROM if known else 0.0


def _cell_axes(path: Path, angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit axes of a crystal's cell: x along the first, y in the plane of the first two."""
    if not (angles > 0).all() or (angles == 90).all():  # 0: not told
        return np.eye(4)
    cos_a, cos_b, cos_c = np.cos(np.radians(angles))
    sin_c = np.sin(np.radians(angles[2]))
    across = (cos_a - cos_b * cos_c) / sin_c
    height = 1 - cos_b**2 - across**2
    if not height > 0:
        raise refuse(path, f"no cell has the angles {', '.join(f'{a:g}' for a in angles)}")
    axes = np.eye(4)
    axes[:3, 1] = cos_c, sin_c, 0
    axes[:3, 2] = cos_b, across, np.sqrt(height)
    return axes


def _is_mrc(head: bytes) -> bool:
    return head[208:212] in (b"MAP ", b"MAP\0")


FORMAT = Format("MRC", (".mrc", ".map", ".rec"), read, one_grid, _is_mrc)
