# SPDX-License-Identifier: GPL-3.0-or-later
"""OpenVDB, by the module `openvdb` that comes with Blender and with many systems.

Leaves and tiles are found by asking for the depth of the tree at the corners of its nodes, level
by level. Values are copied by nodes of 128^3 samples, which takes 5 ms; to copy a single leaf takes
0.1 ms, most of it before the copy starts. What is inactive counts as what it holds: in a level set
the inside, which no surface crosses, is inactive.
"""

from __future__ import annotations

import ctypes
import itertools
import os
import struct
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..file_samples import Spool
from ..scalar_grid import LEAF, Leaves, ScalarGrid
from .common import (
    Format,
    Request,
    check_matrix,
    choose_frame,
    library,
    reading,
    refuse,
)

# Samples along the nodes of OpenVDB's usual tree: below the root, and below those.
UPPER, LOWER = 4096, 128
AROUND = 2  # upper nodes around the box of what is active where inactive tiles are sought
DELAY_OFF = "OPENVDB_DISABLE_DELAYED_LOAD"  # an environment variable
MOST = 10_000  # upper nodes: a grid this wide has strayed
PLAIN_VERSION = 222  # of files, since which their heads are all alike
UUID = 36  # letters of a file's own name
USUAL = "density"  # the grid that is meant where none is named
DTYPES = {"float": "f4", "double": "f8", "half": "f4", "int32": "i4", "int64": "i8", "bool": "?"}
CLASSES = {"level set": "level set", "fog volume": "fog"}


def read(request: Request) -> ScalarGrid:
    path = request.path
    with reading(path, "OpenVDB"):
        openvdb = openvdb_module()
        _check_whole(path)
        told: list[str] = []
        choose_frame(request, 1, told)
        name = _choose(request, openvdb, told)
        with _undelayed():
            grid = openvdb.read(str(path), name)
        request.check_stopped()
        if tuple(_levels(grid)) != (5, 4, 3):
            raise refuse(path, f"the tree of the grid {name!r} is not OpenVDB's usual one")
        made = ScalarGrid(
            name,
            _leaves(request, grid, told),
            check_matrix(path, _matrix(path, grid)),
            kind=CLASSES.get(str(grid.metadata.get("class", "")), "scalar"),
            source=str(path),
            warnings=tuple(told),
        )
        del grid
        _give_back()
        return made


def _give_back() -> None:
    """Return to the system what trees took in pieces that the C library would keep for later."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # glibc's
    if trim is not None:
        trim(0)


def grids(path: Path) -> list[str]:
    with reading(path, "OpenVDB"):
        openvdb = openvdb_module()
        _check_whole(path)
        found = openvdb.readAllGridMetadata(str(path))
        return list(dict.fromkeys(grid.name for grid in found))


def _check_whole(path: Path) -> None:
    """Raise LeapRayError for a file that ends before its grids do.

    OpenVDB believes what it reads as a length behind a file's end, and may ask for any amount of
    memory. Source: io/Archive.cc and io/GridDescriptor.cc of OpenVDB, file version 222 on.
    """
    size = path.stat().st_size
    with open(path, "rb") as file:
        if not _is_vdb(file.read(8)):
            raise refuse(path, "it is no OpenVDB")

        def number(code: str) -> int:
            told = file.read(struct.calcsize(code))
            if len(told) < struct.calcsize(code):
                raise refuse(path, "it is cut short")
            return struct.unpack(code, told)[0]

        def skip_text() -> None:
            n = number("<I")
            if file.tell() + n > size:
                raise refuse(path, "it is cut short or broken")
            file.seek(n, 1)

        version = number("<I")
        file.seek(8, 1)  # of the library
        has_offsets = number("<B")
        if version < PLAIN_VERSION or not has_offsets:
            return
        file.seek(UUID, 1)
        for _ in range(number("<I")):
            for _ in ("name", "type", "value"):
                skip_text()
        for _ in range(number("<i")):
            for _ in ("name", "type", "parent"):
                skip_text()
            *_, end = (number("<q") for _ in ("grid", "blocks", "end"))
            if not file.tell() <= end <= size:
                raise refuse(path, f"it is cut short: its grids take {end} bytes, it has {size}")
            file.seek(end)


def openvdb_module():
    """OpenVDB: of the system, or the one inside a running Blender. Raises LeapRayError."""
    blender = sys.modules.get("bpy")
    if blender is not None and hasattr(blender.utils, "expose_bundled_modules"):
        blender.utils.expose_bundled_modules()
    return library("openvdb", "openvdb (which comes with Blender)")


@contextmanager
def _undelayed() -> Iterator[None]:
    """Let OpenVDB read at once what it would map, and meet a cut file in, later.

    Source: io/File.cc of OpenVDB.
    """
    before = os.environ.get(DELAY_OFF)
    os.environ[DELAY_OFF] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ[DELAY_OFF]
        else:
            os.environ[DELAY_OFF] = before


def _choose(request: Request, openvdb, told: list[str]) -> str:
    """The name of the grid that is asked for, else of the first of numbers."""
    path = request.path
    found = openvdb.readAllGridMetadata(str(path))
    if not found:
        raise refuse(path, "it has no grids")
    names = ", ".join(repr(grid.name) for grid in found)
    asked = [grid for grid in found if request.grid in (None, grid.name)]
    if not asked:
        raise refuse(path, f"it has no grid {request.grid!r}; there are {names}")
    scalar = [grid for grid in asked if grid.valueTypeName in DTYPES]
    if not scalar:
        kind = asked[0].valueTypeName
        raise refuse(
            path, f"the grid {asked[0].name!r} holds {kind}, and one number a sample is needed"
        )
    name = next((grid.name for grid in scalar if grid.name == USUAL), scalar[0].name)
    if request.grid is None and len(scalar) > 1:
        told.append(f"{path} has the grids {names}, of which {name!r} was read")
    return name


def _levels(grid) -> list[int]:
    dims = grid.nodeLog2Dims
    return [n for n in (dims() if callable(dims) else dims) if n]


def _matrix(path: Path, grid) -> NDArray[np.float64]:
    """world_from_index of the grid's transform. Raises LeapRayError for a frustum."""
    transform = grid.transform
    if not transform.isLinear:
        raise refuse(
            path, f"the grid {grid.name!r} lies in a frustum, and an affine transform is needed"
        )
    return matrix_of(transform)


def matrix_of(transform) -> NDArray[np.float64]:
    """world_from_index (4, 4) of a linear transform of OpenVDB's."""
    matrix = np.eye(4)
    matrix[:3, 3] = transform.indexToWorld((0.0, 0.0, 0.0))
    for axis in range(3):
        unit = np.eye(3)[axis].tolist()
        matrix[:3, axis] = np.subtract(transform.indexToWorld(unit), matrix[:3, 3])
    return matrix


def _leaves(request: Request, grid, told: list[str]) -> Leaves:
    """All that the tree holds."""
    dtype = np.dtype(DTYPES[grid.valueTypeName])
    numbers = np.dtype("u1") if dtype.kind == "b" else dtype
    tree = _Tree(request, grid, dtype, Spool((grid.leafCount(),) + (LEAF,) * 3, numbers))
    _visit_all(request.path, grid, tree, told)
    if tree.n_leaves < grid.leafCount():
        raise refuse(request.path, f"leaves of the grid {grid.name!r} lie outside its own box")
    return Leaves(
        np.concatenate(tree.origins),
        tree.spool.samples(),
        float(grid.background),
        np.concatenate(tree.tile_origins),
        np.concatenate(tree.tile_sizes),
        np.concatenate(tree.tile_values).astype(numbers),
    )


def _visit_all(path: Path, grid, tree: _Tree, told: list[str]) -> None:
    """Visit all nodes below the root: those that hold leaves and active tiles, then around.

    Only nodes of inactive tiles alone lie outside the box that OpenVDB tells.
    """
    boxes = np.array([grid.evalLeafBoundingBox(), grid.evalActiveVoxelBoundingBox()], np.int64)
    boxes = boxes[(boxes[:, 0] <= boxes[:, 1]).all(axis=1)]
    if not len(boxes):
        boxes = np.zeros((1, 2, 3), np.int64)
    first, last = boxes[:, 0].min(axis=0) // UPPER, boxes[:, 1].max(axis=0) // UPPER
    if np.prod(last - first + 1.0) > MOST:
        across = " x ".join(f"{n:d}" for n in (last - first + 1) * UPPER)
        raise refuse(path, f"the grid {grid.name!r} spans {across} samples, more than are read")
    visited: set[tuple[int, int, int]] = set()
    for around in range(AROUND + 1):
        low, end = (first - around) * UPPER, (last + around) * UPPER + 1
        corners = set(_corners(tuple(low.tolist()), tuple(end.tolist()), UPPER)) - visited
        for corner in sorted(corners):
            tree.visit_upper(corner)
        visited |= corners
        if tree.n_nodes + 1 >= grid.nonLeafCount():  # the root is one
            return
    told.append(f"{path}: far off the grid {grid.name!r} has inactive tiles, which were left out")


def _corners(first: tuple, end: tuple, step: int) -> Iterator[tuple[int, int, int]]:
    ranges = (range(a, b, step) for a, b in zip(first, end, strict=True))
    yield from itertools.product(*ranges)


class _Tree:
    """What has been found of a grid."""

    def __init__(self, request: Request, grid, dtype: np.dtype, spool: Spool) -> None:
        self.request, self.grid, self.spool = request, grid, spool
        self.accessor = grid.getConstAccessor()
        self.depth = self.accessor.getValueDepth  # -1: background, 0..2: tiles, 3: a leaf's
        self.background = grid.background
        self.n_leaves = 0
        self.n_nodes = 0  # of both levels between root and leaves
        self.block = np.empty((LOWER,) * 3, dtype)  # a lower node
        self.origins = [np.empty((0, 3), np.int32)]
        self.tile_origins = [np.empty((0, 3), np.int32)]
        self.tile_values = [np.empty(0, dtype)]
        self.tile_sizes = [np.empty(0, np.int32)]

    def visit_upper(self, corner: tuple[int, int, int]) -> None:
        if self.depth(corner) <= 0:
            self.add_tiles([corner], [self.accessor.getValue(corner)], UPPER)
            return
        self.n_nodes += 1
        tiles = []
        for below in _corners(corner, tuple(x + UPPER for x in corner), LOWER):
            if self.depth(below) == 1:
                tiles.append(below)
            else:
                self.visit_lower(below)
        self.add_tiles(tiles, [self.accessor.getValue(tile) for tile in tiles], LOWER)

    def visit_lower(self, corner: tuple[int, int, int]) -> None:
        """Copy a node as a whole; OpenVDB writes arrays as if their axes were x, y, z."""
        self.request.check_stopped(self.n_leaves / max(self.spool.shape[0], 1))
        self.n_nodes += 1
        n = LOWER // LEAF
        below = _corners(corner, tuple(x + LOWER for x in corner), LEAF)
        is_leaf = np.fromiter(map(self.depth, below), np.int8, n**3).reshape(n, n, n) == 3
        self.grid.copyToArray(self.block, ijk=corner)
        split = self.block.reshape(n, LEAF, n, LEAF, n, LEAF)
        i, j, k = np.nonzero(is_leaf)
        last = self.n_leaves + len(i)
        leaves = split[i, :, j, :, k, :].transpose(0, 3, 2, 1)
        self.spool[self.n_leaves : last] = leaves.astype(self.spool.dtype)
        self.n_leaves = last
        self.origins.append((np.stack((i, j, k), -1) * LEAF + corner).astype(np.int32))
        values = split[:, 0, :, 0, :, 0]
        tiles = np.nonzero(~is_leaf)
        self.add_tiles(np.stack(tiles, -1) * LEAF + corner, values[tiles], LEAF)

    def add_tiles(self, corners: ArrayLike, values: ArrayLike, size: int) -> None:
        """Add those tiles that are no background."""
        array = np.asarray(values, self.block.dtype)
        told = array != self.background
        self.tile_origins.append(np.reshape(corners, (-1, 3))[told].astype(np.int32))
        self.tile_values.append(array[told])
        self.tile_sizes.append(np.full(np.count_nonzero(told), size, np.int32))


def _is_vdb(head: bytes) -> bool:
    return head.startswith(b" BDV")


FORMAT = Format("OpenVDB", (".vdb",), read, grids, _is_vdb)
