# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays on spheres by LeapRay and by others: one function per peer (no bpy).

The surface of n^3 spheres, as samples for LeapRay, as a level set of the same distances for OpenVDB
and as the triangles that OpenVDB makes of them for Embree; and the first object cell of the same
phantom, where there are no triangles. All on one thread, in turns, by processor time, with all that
the calls from Python return. OpenVDB's rays need its C++ headers and g++, Embree the module
embreex; what is not there is left out. Embree's module traces rays one by one.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import importlib.util
import shutil
import subprocess
import sys
import tempfile
import weakref
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import leapray
from leapray.formats.vdb import openvdb_module

from . import charts, entries, page, phantom
from .compiled import pointer

Array = NDArray[np.float64]
Found = tuple[Array, Array]  # t (n,), infinity on a miss; unit normals (n, 3), which cells lack

BAND = 3.0  # voxels to either side of the surface that hold distances
WIDTH = 1.8  # likewise, over which LeapRay's samples go from 0 to 1
JUDGED = 2000  # rays that are compared with the spheres
SURFACE, CELLS = "surface and normal", "first object cell"
HEADERS = Path("/usr/include/openvdb/openvdb.h"), Path("/usr/local/include/openvdb/openvdb.h")


@dataclass(frozen=True)
class Row:
    """A peer at a piece of work."""

    work: str
    size: int  # samples a side
    spheres: int  # along a side
    by: str
    nanoseconds: float  # of a ray, the median
    least: float
    most: float
    error_99: float  # voxels that t is off, at 99 % of the judged rays that hit in both; surfaces
    # are judged by the spheres, cells by LeapRay, whose first cells are those of integers
    differ: int  # of the judged rays that hit here and there not, or the other way
    nbytes: int  # of what is traced; 0: not known


@dataclass(frozen=True)
class Subject:
    """Spheres, and the rays on them."""

    size: int
    n: int
    centres: Array  # (n^3, 3), in index space
    radius: float
    distances: NDArray[np.float32]  # (nz, ny, nx) to the surface, negative inside, up to BAND
    cells: NDArray[np.uint8]  # (nz, ny, nx), 255 inside
    origins: Array
    directions: Array  # unit


@dataclass(frozen=True)
class Peer:
    """Someone who can trace."""

    by: str
    trace: Callable[[], Found]
    nbytes: int = 0


def subject(size: int, n: int, image: int) -> Subject:
    """n^3 spheres in size^3 samples, and image^2 parallel rays askew."""
    centres, radius = phantom.spheres(size, n)
    distances = np.full((size, size, size), BAND, np.float32)
    for centre in centres:
        low = np.maximum(np.floor(centre - radius - BAND).astype(int), 0)
        high = np.minimum(np.ceil(centre + radius + BAND).astype(int) + 1, size)
        x, y, z = (np.arange(low[a], high[a]) - centre[a] for a in range(3))
        own = np.sqrt(z[:, None, None] ** 2 + y[:, None] ** 2 + x**2) - radius
        part = distances[low[2] : high[2], low[1] : high[1], low[0] : high[0]]
        np.minimum(part, own, out=part)
    np.maximum(distances, -BAND, out=distances)
    origins, directions = phantom.cameras(size, image)["oblique"]
    directions = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    cells = phantom.phantom(size, n)
    return Subject(size, n, centres, radius, distances, cells, origins, directions)


def truth(s: Subject, some: slice) -> Array:
    """t at which those rays meet a sphere first; infinity on a miss."""
    o, d = s.origins[some], s.directions[some]
    arm = o[:, None] - s.centres[None]
    b = (arm * d[:, None]).sum(-1)
    closest = (arm * arm).sum(-1) - b * b
    chord = s.radius**2 - closest
    return np.where(chord >= 0, -b - np.sqrt(np.maximum(chord, 0)), np.inf).min(axis=1)


# ---- peers ---------------------------------------------------------------


def by_leapray(s: Subject, work: str) -> list[Peer]:
    """The default traverser with every choice of its options."""
    if work == SURFACE:
        samples = np.clip(0.5 - s.distances / (2 * WIDTH), 0, 1) * 65535
        volume = leapray.Volume(np.round(samples).astype(np.uint16))
    else:
        volume = leapray.Volume(s.cells)
    mode = "surface" if work == SURFACE else "binary"
    found = []
    for entry in leapray.variants():
        if entry.name != entries.default().name:
            continue
        structure = leapray.build(volume, entry)
        nbytes = volume.info.nbytes + structure.nbytes

        def trace(structure=structure) -> Found:
            hits = leapray.trace(structure, s.origins, s.directions, mode=mode, count=False)
            return hits.t, hits.normal

        found.append(Peer(f"LeapRay, {entry.spec}", trace, nbytes))
    return found


def by_openvdb(s: Subject, work: str) -> list[Peer]:
    """LevelSetRayIntersector, or its walk to the first voxel; none where that is not compiled."""
    library = openvdb_rays()
    if library is None:
        return []
    cells = work == CELLS
    values = object_cells(s.cells).astype(np.float32) if cells else s.distances
    size = np.array(values.shape[::-1], np.int32)
    outside = ctypes.c_float(0.0 if cells else BAND)
    low = ctypes.c_int32(-1 if cells else 0)
    handle = library.begin(pointer(values), pointer(size), low, outside, ctypes.c_int32(cells))
    if not handle:
        return []
    origins, directions = map(np.ascontiguousarray, (s.origins, s.directions))

    def trace() -> Found:
        n = len(origins)
        t, normals = np.empty(n), np.zeros((n, 3))
        given = map(pointer, (origins, directions))
        library.trace(
            ctypes.c_void_p(handle), *given, ctypes.c_int64(n), pointer(t), pointer(normals)
        )
        return t, normals

    weakref.finalize(trace, library.finish, ctypes.c_void_p(handle))
    return [Peer("OpenVDB", trace)]


def object_cells(samples: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """(nz + 1, ny + 1, nx + 1), from cell -1 on: cells between samples of which one is set."""
    found = np.pad(samples > 0, 1)
    for axis in range(3):
        found = np.delete(found, -1, axis) | np.delete(found, 0, axis)
    return found


def by_embree(s: Subject, work: str) -> list[Peer]:
    """Rays one by one on triangles of the same distances; none of cells, nor without embreex."""
    if work == CELLS or importlib.util.find_spec("embreex") is None:
        return []
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    vertices, triangles = mesh_of(s.distances)
    scene = EmbreeScene()
    mesh = TriangleMesh(scene, vertices, triangles)
    origins, directions = (x.astype(np.float32) for x in (s.origins, s.directions))

    def trace(mesh=mesh) -> Found:
        told = scene.run(origins, directions, output=True)
        return np.where(told["primID"] >= 0, told["tfar"], np.inf), told["Ng"]

    return [Peer(f"Embree, {len(triangles) / 1000:.0f} k triangles", trace)]


PEERS = by_leapray, by_openvdb, by_embree


def mesh_of(distances: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Vertices (n, 3) and triangles (m, 3) where distances (nz, ny, nx) are 0, by OpenVDB."""
    with contextlib.suppress(ImportError):
        import bpy  # noqa: F401  has OpenVDB
    grid = openvdb_module().FloatGrid(BAND)
    grid.copyFromArray(np.ascontiguousarray(distances.T))
    points, triangles, quads = grid.convertToPolygons(isovalue=0.0, adaptivity=0.0)
    halves = [triangles, quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]
    return points.astype(np.float32), np.concatenate(halves).astype(np.int32)


@functools.cache
def openvdb_rays() -> ctypes.CDLL | None:
    """openvdb_rays.cpp, compiled; None where g++ or OpenVDB's headers are missing or too old."""
    if shutil.which("g++") is None or not any(header.exists() for header in HEADERS):
        return None
    source = Path(__file__).with_name("openvdb_rays.cpp")
    with tempfile.TemporaryDirectory(prefix="leapray-openvdb-") as folder:
        target = Path(folder) / "openvdb_rays.so"
        flags = ["-std=c++17", "-O3", "-march=native", "-shared", "-fPIC"]
        command = ["g++", *flags, str(source), "-o", str(target), "-lopenvdb", "-ltbb"]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            print(f"peers: no OpenVDB, {done.stderr.strip()[-200:]}", file=sys.stderr)
            return None
        library = ctypes.CDLL(str(target))
    library.begin.restype = ctypes.c_void_p
    library.trace.restype = library.finish.restype = None
    return library


# ---- measuring -----------------------------------------------------------


def measure(sizes: dict[int, tuple[int, ...]], image: int, rounds: int) -> list[Row]:
    """Rows of every peer. sizes: samples a side, with the numbers of spheres along a side."""
    rows = []
    for size, counts in sizes.items():
        for n in counts:
            s = subject(size, n, image)
            for work in (SURFACE, CELLS):
                rows += rows_of(s, work, [peer for by in PEERS for peer in by(s, work)], rounds)
            print(f"peers: rays on {n}^3 spheres in {size}^3", file=sys.stderr, flush=True)
    return rows


def rows_of(s: Subject, work: str, peers: list[Peer], rounds: int) -> list[Row]:
    some = slice(None, None, max(len(s.origins) // JUDGED, 1))
    want = truth(s, some) if work == SURFACE else peers[0].trace()[0][some]
    found = [peer.trace()[0][some] for peer in peers]  # and whatever is made at first use
    taken = entries.seconds([peer.trace for peer in peers], rounds) / len(s.origins) * 1e9
    rows = []
    for peer, each, t in zip(peers, taken.T, found, strict=True):
        both = np.isfinite(t) & np.isfinite(want)
        off = np.abs(t[both] - want[both])
        rows.append(
            Row(
                work,
                s.size,
                s.n,
                peer.by,
                *entries.spread(each),
                float(np.quantile(off, 0.99)) if both.any() else np.nan,
                int((np.isfinite(t) != np.isfinite(want)).sum()),
                peer.nbytes,
            )
        )
    return rows


# ---- telling -------------------------------------------------------------


def draw(folder: Path, rows: list[Row]) -> None:
    """Nanoseconds of a ray on surfaces, a group per phantom."""
    groups = charts.grouped((r for r in rows if r.work == SURFACE), name_of)
    with charts.chart(folder / "traversals", columns=len(groups), width=4.6, height=2.8) as (
        _,
        axes,
    ):
        for axis, (name, group) in zip(axes[0], groups.items(), strict=True):
            charts.bars(axis, [row.by for row in group], [row.nanoseconds for row in group])
            axis.set_xscale("log")
            axis.set_title(f"{name}, ns a ray", fontsize=10.5)


def name_of(row: Row) -> str:
    return f"{row.spheres}³ spheres in {row.size}³ samples"


def section(folder: Path, rows: list[Row], image: int) -> list[str]:
    """The part of a page that tells them."""
    table = [
        [
            row.work,
            name_of(row),
            page.esc(row.by),
            *(f"{x:.0f}" for x in (row.nanoseconds, row.least, row.most)),
            f"{row.error_99:.2g}",
            str(row.differ),
            f"{row.nbytes / 2**20:.1f}" if row.nbytes else "",
        ]
        for row in rows
    ]
    head = ["work", "phantom", "by", "ns a ray", "least", "most"]
    head += ["off by at 99 %, voxels", "other hits of those judged", "MB"]
    return [
        "<h2>Rays</h2>",
        f"<p>{image} x {image} parallel rays, askew, one thread, in turns, with all that the calls "
        "return to Python. Surfaces are judged by the spheres themselves, cells by LeapRay's "
        "first peer.</p>",
        page.figure(folder, "traversals.png", "Surfaces with normals", "lower is better"),
        page.findings(sentences(rows)),
        page.table(head, table),
    ]


def sentences(rows: list[Row]) -> list[str]:
    """How many times as fast as its peers LeapRay's default is."""
    said = []
    for what, group in charts.grouped(rows, lambda r: f"{r.work}, {name_of(r)}").items():
        own = group[0].nanoseconds
        others = [row for row in group if not row.by.startswith("LeapRay")]
        ratios = " and ".join(
            f"{row.nanoseconds / own:.2g} times as fast as {row.by}" for row in others
        )
        if ratios:
            said.append(f"{what.capitalize()}: LeapRay is {ratios}.")
    return said
