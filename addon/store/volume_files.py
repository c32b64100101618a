# SPDX-License-Identifier: GPL-3.0-or-later
"""Volumes as OpenVDB files (OpenVDB comes with Blender).

A file written here holds a float grid "density" of the occupancies 0..1, a float grid
"id" if the volume has ids, and for sheets a bool grid "surface", all placed by the
grid's transform, so that Blender shows them where LeapRay does. What OpenVDB
cannot represent is JSON in the grid's metadata "leapray". Float and bool are the
grids that every Blender can read. Triangles of cells, colours and normals are not in
the grids: see disk_cache.py.
"""

from __future__ import annotations

import contextlib
import json
import os
import secrets
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from leapray import LeapRayError, MeshInfo, Volume, VolumeBuilder
from leapray.arrays import DTYPES, ONES
from leapray.formats.vdb import matrix_of, openvdb_module
from leapray.volume import BRICK

BLOCK = 64  # samples along a block that is read at a time; a multiple of a brick
LEAST = -1  # block: bricks start two samples before the lattice
COPIED = 32  # along a block that is written at a time; a multiple of OpenVDB's leaves
DENSITY, ID, SURFACE, META = "density", "id", "surface", "leapray"


def write(
    volume: Volume,
    path: str | Path,
    world_from_object: NDArray[np.float64] | None = None,
    *,
    behind: bytes = b"",
) -> None:
    """Write a volume as .vdb; `read` gives an equal one, placed by world_from_object if given.

    The file holds the field alone: not the triangles of triangle cells, nor colours and normals.
    behind: bytes that follow the grids, not read by OpenVDB; then only the density grid is
    written, and `read` refuses the file.
    The file is written beside its place and renamed, so it is whole or absent.
    Raises LeapRayError where there is no OpenVDB or the place cannot be written.
    """
    openvdb = openvdb_module()
    info = volume.info
    if info.planes is not None:
        raise LeapRayError("OpenVDB has no rectilinear grids: this volume cannot be written")
    matrix = info.object_from_index
    if world_from_object is not None:
        matrix = np.asarray(world_from_object, np.float64) @ matrix
    grids = [_density(openvdb, volume)]
    if info.has_ids and not behind:
        grids.append(_grid_of_bricks(openvdb.FloatGrid(), ID, volume, volume.read_ids, np.float32))
    if info.kind == "sheet" and not behind:
        grids.append(
            _grid_of_bricks(openvdb.BoolGrid(), SURFACE, volume, volume.read_surface, np.bool_)
        )
    if not behind:
        grids[0][META] = json.dumps(
            {
                "size": info.size,
                "dtype": info.dtype,
                "kind": info.kind,
                "threshold": info.threshold,
                "object_from_index": matrix.tolist(),
                "mesh": volume.mesh_info and asdict(volume.mesh_info),
            }
        )
    for grid in grids:
        grid.transform = _transform(openvdb, matrix)

    def fill(beside: Path) -> None:
        openvdb.write(str(beside), grids=grids)
        with open(beside, "ab") as file:
            file.write(behind)

    _write_whole(Path(path), fill)


def write_bytes(path: Path, data: bytes) -> None:
    """Write a file that is whole or absent, too. Raises LeapRayError."""
    _write_whole(path, lambda beside: beside.write_bytes(data))


def read(path: str | Path) -> Volume:
    """The volume that `write` wrote; moved, if another program changed the grid's transform.

    Raises LeapRayError where there is no OpenVDB, no such file, or another kind of it.
    """
    grids = {grid.name: grid for grid in _grids(path)}
    density = grids.get(DENSITY)
    if density is None or META not in density.metadata:
        raise LeapRayError(
            f"{path} was not written by LeapRay: it has no grid {DENSITY!r} that says {META!r}"
        )
    try:
        meta = json.loads(density[META])
        one, dtype = ONES[meta["dtype"]], DTYPES[meta["dtype"]]
        size, sheet = tuple(map(int, meta["size"])), meta["kind"] == "sheet"
        told = np.array(meta["object_from_index"], dtype=np.float64)
        threshold = float(meta["threshold"])
        mesh_info = MeshInfo(**meta["mesh"]) if meta.get("mesh") else None
    except (ValueError, KeyError, TypeError) as error:
        raise LeapRayError(f"{path}: the metadata {META!r} cannot be understood: {error}") from None
    # indexToWorld rounds; the stored matrix is exact, if the grid has not been moved.
    placed = _matrix(density.transform)
    rounding = 1e-12 * (np.abs(told[:3, :3]).max() + np.abs(told[:3, 3]).max())
    matrix = told if told.shape == (4, 4) and np.abs(placed - told).max() <= rounding else placed
    builder = VolumeBuilder(size, meta["dtype"], threshold, matrix, ID in grids, sheet)
    touched = grids.get(SURFACE) if sheet else None
    for origin, block in _blocks(density, size, np.float32):
        samples = block * one if dtype == np.float32 else np.round(block.astype(np.float64) * one)
        builder.put(
            origin,
            samples.astype(dtype),
            _like(grids.get(ID), origin, block, np.float32, np.uint16),
            _like(touched, origin, block, np.bool_, np.bool_),
        )
    volume = builder.finish()
    volume.mesh_info = mesh_info
    return volume


# ---- OpenVDB ------------------------------------------------------------------


def _grids(path: str | Path) -> list:
    path = Path(path)
    if not path.is_file():
        raise LeapRayError(f"there is no file {path}")
    try:
        return openvdb_module().readAll(str(path))[0]
    except (OSError, RuntimeError, ValueError, TypeError, KeyError) as error:
        raise LeapRayError(f"{path} cannot be read as OpenVDB: {error}") from None


def _transform(openvdb, object_from_index: NDArray[np.float64]):
    try:  # OpenVDB's matrices act on row vectors
        return openvdb.createLinearTransform(object_from_index.T.tolist())
    except (ArithmeticError, ValueError, RuntimeError) as error:
        raise LeapRayError(f"OpenVDB cannot place this volume: {error}") from None


def _matrix(transform) -> NDArray[np.float64]:
    """object_from_index of a linear transform."""
    if not transform.isLinear:
        raise LeapRayError("the grid is not placed by a linear transform")
    return matrix_of(transform)


def _density(openvdb, volume: Volume):
    """Occupancies; bricks of ones, which take no memory in the volume, as few large boxes."""
    grid = openvdb.FloatGrid()
    grid.gridClass = openvdb.GridClass.FOG_VOLUME
    origins, n_stored = volume.bricks()
    for lo, hi in _boxes(origins[n_stored:]):
        grid.fill(lo, tuple(x - 1 for x in hi), 1.0, True)
    one = ONES[volume.info.dtype]

    def read(origin, size):
        return np.divide(volume.read(origin, size), np.float32(one), dtype=np.float32)

    return _grid_of_bricks(grid, DENSITY, volume, read, np.float32)


def _grid_of_bricks(grid, name: str, volume: Volume, read, dtype):
    """Copy all blocks with stored bricks, read(origin, size) giving (nz, ny, nx), into a grid."""
    grid.name = name
    grid.creator = "LeapRay"
    origins, n_stored = volume.bricks()
    corners = (
        np.stack(np.meshgrid(*[(0, BRICK - 1)] * 3), -1).reshape(-1, 1, 3) + origins[:n_stored]
    )
    found = corners.reshape(-1, 3) // COPIED - LEAST  # none is below
    sizes = tuple(found.max(axis=0, initial=0) + 1)
    numbers = np.unique(np.ravel_multi_index(tuple(found.T), sizes))
    blocks = np.stack(np.unravel_index(numbers, sizes), -1) + LEAST
    for origin in (COPIED * blocks).tolist():
        block = np.ascontiguousarray(read(origin, (COPIED,) * 3).T, dtype=dtype)
        if block.any():
            grid.copyFromArray(block, ijk=tuple(origin))
    return grid


def _boxes(origins: NDArray[np.int32]) -> list[tuple[tuple, tuple]]:
    """Bricks joined to boxes (first, past the last): runs along x, then along y, then z."""
    boxes = [(tuple(first), tuple(x + BRICK for x in first)) for first in origins.tolist()]
    for axis in range(3):

        def across(box, axis=axis):
            return tuple(corner[a] for corner in box for a in range(3) if a != axis)

        def order(box, axis=axis):
            return across(box), box[0][axis]

        boxes.sort(key=order)
        joined: list[tuple[tuple, tuple]] = []
        for box in boxes:
            last = joined[-1] if joined else None
            if last and across(last) == across(box) and last[1][axis] == box[0][axis]:
                joined[-1] = (last[0], box[1])
            else:
                joined.append(box)
        boxes = joined
    return boxes


def _blocks(grid, size: tuple, dtype) -> Iterator[tuple]:
    """(origin, values (nz, ny, nx)) of blocks of a lattice that are not all zeros.

    They start 2 samples before multiples of their size, as the core's bricks do.
    """
    starts = [[0, *range(BLOCK - 2, n, BLOCK)] for n in size]
    for k, z in enumerate(starts[2]):
        for j, y in enumerate(starts[1]):
            for i, x in enumerate(starts[0]):
                origin = (x, y, z)
                end = [
                    starts[a][n + 1] if n + 1 < len(starts[a]) else size[a]
                    for a, n in enumerate((i, j, k))
                ]
                block = np.empty([e - o for e, o in zip(end, origin, strict=True)], dtype)
                grid.copyToArray(block, ijk=origin)
                if block.any():
                    yield origin, block.T


def _like(grid, origin: tuple, block: NDArray, dtype, out) -> NDArray | None:
    """The same block of another grid."""
    if grid is None:
        return None
    values = np.empty(block.shape[::-1], dtype)
    grid.copyToArray(values, ijk=origin)
    return values.T.astype(out)


def _write_whole(path: Path, fill: Callable[[Path], object]) -> None:
    if not path.parent.is_dir():
        raise LeapRayError(f"there is no folder {path.parent} to write {path.name} into")
    beside = path.with_name(f".{path.name}.{secrets.token_hex(6)}.partial")
    try:
        fill(beside)
        os.replace(beside, path)
    except (OSError, RuntimeError) as error:
        raise LeapRayError(f"{path} cannot be written: {error}") from None
    finally:
        with contextlib.suppress(OSError):
            beside.unlink(missing_ok=True)
