# SPDX-License-Identifier: GPL-3.0-or-later
"""From triangle meshes to occupancy volumes."""

from __future__ import annotations

import ctypes
import threading
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _abi
from ._lib import LeapRayError, OutOfMemory, Watch, call, check, lib
from .arrays import SAMPLE_TYPES, bounds, choice, id_array, members, pointer
from .attributes import Attributes
from .threads import check_threads, run_parts
from .volume import BRICK, Volume

FILTERS = members(_abi.lr_filter)
KINDS = members(_abi.lr_kind)
SIMD = members(_abi.lr_simd)
EXACT = members(_abi.lr_exact_cells)

# Scratch that does not count against max_nbytes: an interpreter with numpy takes more.
SPARE = 8 << 20

FEW_PAIRS = 1 << 16  # of half-edges; a mesh of many triangles has some three for two of them

# Share of the work that is done after a stage; not all are there each time.
STAGE_DONE = {
    _abi.LR_STAGE_SET_UP: 0.2,
    _abi.LR_STAGE_COMPONENTS: 0.5,
    _abi.LR_STAGE_WINDING: 0.6,
    _abi.LR_STAGE_BRICKS: 0.85,
    _abi.LR_STAGE_CELLS: 0.95,
}

REASONS = {
    _abi.LR_REASON_ASKED: "it was asked for",
    _abi.LR_REASON_CLOSED: "every edge is shared by two triangles of one winding",
    _abi.LR_REASON_CROSSING: "it is closed, though parts of it cross or lie in each other",
    _abi.LR_REASON_ENCLOSES: "it encloses a volume, though {edges}",
    _abi.LR_REASON_HOLES: "it has holes, the widest {hole:.1f} voxels",
    _abi.LR_REASON_FLIPPED: "neighbouring faces disagree in winding",
    _abi.LR_REASON_EMPTY: "{edges}, and it encloses no volume",
}
OBVIOUS = {_abi.LR_REASON_ASKED, _abi.LR_REASON_CLOSED, _abi.LR_REASON_HOLES}


@dataclass(frozen=True)
class MeshInfo:
    """What voxelize found out about its mesh."""

    closed: bool  # every edge has two triangles of one winding
    n_border_edges: int  # edges with one triangle
    n_bad_edges: int  # edges with more than two triangles, or two of opposite winding
    n_degenerate: int  # triangles without area, or on the places of an earlier one
    inverted: bool  # a closed mesh was wound inside out and was turned
    simd: str  # the vector instructions used
    why: str  # it is a solid or a sheet: the end of a sentence
    obvious: bool  # so that nobody need be told
    winding: bool  # winding numbers told inside from outside, since pseudonormals could not
    hole: float  # extent of the widest loop of border edges in voxels, where it mattered
    scratch_nbytes: int = 0  # what making the volume took at most beside it


def filter_info(filter: str, dtype: str) -> _abi.lr_filter_info:
    """What holds for a filter of samples of that type, see leapray.h. Raises LeapRayError."""
    info, error = _abi.lr_filter_info(), _abi.lr_error()
    kernel, sample_type = choice(FILTERS, filter, "filter"), choice(SAMPLE_TYPES, dtype, "dtype")
    check(lib.lr_filter_get(kernel, sample_type, ctypes.byref(info), ctypes.byref(error)), error)
    return info


def slope(filter: str, width: float) -> float:
    """How much occupancy rises per voxel across a plane, at the plane."""
    return lib.lr_filter_slope(choice(FILTERS, filter, "filter"), width)


def voxelize(
    vertices: ArrayLike,
    triangles: ArrayLike,
    voxel_size: float,
    *,
    filter: str = "ramp",
    half_width: float | None = None,
    kind: str = "auto",
    ids: ArrayLike | None = None,
    attributes: Attributes | None = None,
    dtype: str = "u16",
    exact: str = "sheets",
    flat: bool = False,
    threads: int = 0,
    watch: Watch | None = None,
    max_nbytes: int | None = None,
    max_volume_nbytes: int | None = None,
    simd: str = "auto",
) -> Volume:
    """The occupancy volume of a mesh, its lattice on multiples of voxel_size.

    vertices: (n, 3), finite, in object space; triangles: (m, 3) vertex numbers,
    counter-clockwise from outside; ids: (m,), 0..65535, or None;
    samples near the surface take that of the nearest triangle. attributes: colours
    and smooth normals that hits take from the triangles they lie on, which the volume
    keeps, as long as samples at the surface name them; textures stay as sharp as they are.
    filter: of FILTERS, how occupancy falls across the surface, over half_width voxels to either
    side, of "gauss" its sigma; None: the filter's own. "box" and "binary" are for solids only.
    Where shells cross, "box" takes the share of their union, exactly where at most 32 triangles
    meet in the voxel; of more, where some place is covered twice, by 6^3 points, a few
    hundredths of the voxel off.
    kind "solid" takes what the triangles enclose, "sheet" the triangles as a surface
    without inside; "auto" takes a solid where every edge is shared by two triangles of
    one winding, or where winding numbers find a volume enclosed but for holes of half
    a voxel at most: mesh_info.why tells. Where parts of a solid cross, lie in each
    other or leave holes, winding numbers tell inside from outside; the surface on which
    the number is 1/2 closes wide holes of what is to be a solid. dtype: "u8", "u16" or "f32".
    exact "sheets": cells of sheets in which the samples cannot hold the surface (at
    borders, junctions, creases, close pairs) keep their triangles, which rays meet
    exactly; "all": those of solids too (creases, walls and gaps thinner than a voxel);
    "every": all cells that the surface meets, so that there is no error at all;
    "none": the samples alone, so that a sheet ends with the cells that it touches.
    flat: the mesh is flat-shaded. Then cells that may keep their triangles do so wherever
    normals would turn from a facet's by more than a degree, and hits elsewhere have the
    gradient of the field in their own cell.
    threads 0: all cores; the result does not depend on it. max_nbytes: OutOfMemory,
    its attribute nbytes being the estimate, is raised before the work begins
    where the volume and the scratch to make it (above SPARE bytes) may take more, and
    where the volume may take more than max_volume_nbytes. simd: the vector instructions,
    "portable", "avx2" or "avx512"; "auto" takes the best there is. They change nothing but
    the time.
    Returns a Volume with mesh_info set. Raises LeapRayError for wrong input and
    lattices that are too large, Stopped when watch was told to stop.
    Source: Sramek and Kaufman 1999 (oriented box filter); Wang and Kaufman 1993
    (hypercone); Baerentzen and Aanaes 2005, Barill et al. 2018 (sign).
    """
    points, corners, numbers = _mesh_arrays(vertices, triangles, ids)
    kernel = choice(FILTERS, filter, "filter")
    width = filter_info(filter, dtype).half_width if half_width is None else float(half_width)
    chosen = _abi.lr_voxelize_options(
        voxel_size=float(voxel_size),
        half_width=width,
        filter=kernel,
        kind=choice(KINDS, kind, "kind"),
        sample_type=choice(SAMPLE_TYPES, dtype, "dtype"),
        simd=choice(SIMD, simd, "simd"),
        exact=choice(EXACT, exact, "exact"),
        flat=bool(flat),
    )
    check_threads(threads)
    copied = sum(
        mine.nbytes
        for mine, given in ((points, vertices), (corners, triangles))
        if not np.shares_memory(mine, given)
    )
    limits = _Limits(max_nbytes, max_volume_nbytes, copied)
    limits.check_table(points, chosen.voxel_size, width)
    mesh = _mesh(points, corners, numbers)
    if attributes is not None:
        mesh.attributes = ctypes.pointer(attributes.pack(len(corners)))
    volume = _run(mesh, chosen, threads, _Progress(watch or Watch()), limits)
    volume.textures = () if attributes is None else tuple(attributes.textures)
    return volume


def _run(mesh, chosen, threads: int, progress: _Progress, limits: _Limits) -> Volume:
    voxelizer = ctypes.POINTER(_abi.lr_voxelizer)()
    begin = (ctypes.byref(mesh), ctypes.byref(chosen))
    call(lib.lr_voxelize_begin, *begin, watch=progress, outputs=(voxelizer,))
    try:
        info, n_parts = _abi.lr_voxelizer_info(), ctypes.c_uint64()
        lib.lr_voxelizer_get_info(voxelizer, ctypes.byref(info))
        limits.check(info.nbytes, info.scratch_nbytes + limits.copied)
        while True:
            call(lib.lr_voxelize_next, voxelizer, watch=progress, outputs=(n_parts,))
            lib.lr_voxelizer_get_info(voxelizer, ctypes.byref(info))
            limits.check(info.nbytes, info.scratch_nbytes + limits.copied)
            if not n_parts.value:
                break
            share = progress.until(STAGE_DONE[info.stage]) / n_parts.value

            def part(first: int, last: int, share: float = share) -> None:
                for index in range(first, last):
                    call(lib.lr_voxelize_part, voxelizer, index, watch=progress)
                    progress.add(share)

            run_parts(part, n_parts.value, 1, threads, progress)
        handle = ctypes.POINTER(_abi.lr_volume)()
        call(lib.lr_voxelize_end, voxelizer, watch=progress, outputs=(handle,))
        progress.end()
    finally:
        lib.lr_voxelizer_free(voxelizer)
    return Volume.from_handle(handle, _mesh_info(info, limits.copied))


def mesh_layers(
    vertices: ArrayLike, triangles: ArrayLike, margin: float = 0.0, *, watch: Watch | None = None
) -> NDArray[np.int32]:
    """A layer number (m,) for every triangle: what one volume cannot hold is told apart.

    vertices: (n, 3) and triangles: (m, 3), as for `voxelize`; margin: in object space.
    Islands, connected through edges of two triangles of one winding, keep margin
    between their boxes within a layer; open and closed ones never share one.
    Layers are numbered from 0. Raises LeapRayError, as voxelize; Stopped when watch was told to
    stop.
    """
    points, corners, _ = _mesh_arrays(vertices, triangles, None)
    mesh = _mesh(points, corners)
    layer, count = np.empty(max(len(corners), 1), np.int32), ctypes.c_int32()
    outputs = (ctypes.c_int32.from_buffer(layer.data), count)
    call(lib.lr_mesh_layers, ctypes.byref(mesh), float(margin), watch=watch, outputs=outputs)
    return layer


def mesh_scratch_nbytes(n_vertices: int, n_triangles: int) -> int:
    """Bytes that must be free, beside the mesh itself, for anything to be done with it."""
    copied = 3 * np.dtype(np.float64).itemsize * n_vertices
    return lib.lr_mesh_scratch_nbytes(n_vertices, n_triangles) + copied


def mesh_edges(
    vertices: ArrayLike,
    triangles: ArrayLike,
    cosine: float,
    *,
    weld: bool = True,
    unit: float = 1.0,
    watch: Watch | None = None,
) -> tuple[NDArray[np.uint32], int]:
    """Edges at which triangles turn by more than an angle, and how many edges have one triangle.

    vertices: (n, 3) and triangles: (m, 3), as for `voxelize`.
    Returns (n, 2) pairs of half-edges (3 t + e runs from corner e of triangle t to the next): of
    every edge the first two, if the cosine between the normals of their triangles is below the
    given one; triangles without area never turn. weld: an edge is told by its places, else
    by its vertices' numbers. unit: coordinates are divided by it, in f32.
    Raises LeapRayError, as voxelize; Stopped when watch was told to stop.
    """
    points, corners, _ = _mesh_arrays(vertices, triangles, None)
    mesh = _mesh(points, corners)
    room = max(FEW_PAIRS, 3 * len(corners) // 2)
    while True:
        pairs = np.empty((room, 2), np.uint32)
        n_pairs, n_border = ctypes.c_uint64(), ctypes.c_uint64()
        call(
            lib.lr_mesh_edges,
            ctypes.byref(mesh),
            int(weld),
            float(unit),
            float(cosine),
            pointer(pairs, ctypes.c_uint32),
            room,
            watch=watch,
            outputs=(n_pairs, n_border),
        )
        if n_pairs.value <= room:
            return pairs[: n_pairs.value], n_border.value
        room = n_pairs.value


class _Progress:
    """The words of a watch for parts that run side by side.

    They share its stop word; its progress word is written here alone, since
    each part only knows its own share.
    """

    def __init__(self, watch: Watch) -> None:
        self._watch = watch
        self._lock = threading.Lock()
        self._share = 0.0
        self._words = _abi.lr_watch(watch.pointer.contents.stop, None)
        self.pointer = ctypes.pointer(self._words)
        self.stop = watch.stop

    def add(self, share: float) -> None:
        with self._lock:
            self._write(self._share + share)

    def until(self, share: float) -> float:
        """What is left until a share of the whole is done."""
        return max(0.0, share - self._share)

    def end(self) -> None:
        with self._lock:
            self._write(1.0)

    def _write(self, share: float) -> None:
        self._share = share
        if self._watch.pointer.contents.progress:
            self._watch.pointer.contents.progress[0] = share


def _mesh_info(info: _abi.lr_voxelizer_info, copied: int) -> MeshInfo:
    return MeshInfo(
        closed=info.n_border_edges == 0 and info.n_bad_edges == 0,
        n_border_edges=info.n_border_edges,
        n_bad_edges=info.n_bad_edges,
        n_degenerate=info.n_degenerate,
        inverted=bool(info.inverted),
        why=REASONS[info.reason].format(edges=_open_edges(info), hole=info.hole),
        obvious=info.reason in OBVIOUS,
        winding=bool(info.by_winding),
        hole=info.hole,
        scratch_nbytes=info.scratch_nbytes + copied,
        simd=next(name for name, code in SIMD.items() if code == info.simd),
    )


def _open_edges(info: _abi.lr_voxelizer_info) -> str:
    counts = {
        "with one triangle": info.n_border_edges,
        "with more than two triangles or of opposite winding": info.n_bad_edges,
    }
    found = [f"{n} {'edge' if n == 1 else 'edges'} {words}" for words, n in counts.items() if n]
    return "it has " + " and ".join(found)


def _mesh_arrays(vertices: ArrayLike, triangles: ArrayLike, ids: ArrayLike | None):
    points = np.ascontiguousarray(vertices, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise LeapRayError(f"vertices must have the shape (n, 3); it is {points.shape}")
    corners = np.asarray(triangles)
    if corners.ndim != 2 or corners.shape[1] != 3:
        raise LeapRayError(f"triangles must have the shape (m, 3); it is {corners.shape}")
    if corners.dtype.kind not in "iu":
        raise LeapRayError(f"triangles must be whole numbers; they are {corners.dtype}")
    if corners.dtype.itemsize >= 4 and corners.size and corners.max() > np.iinfo(np.int32).max:
        raise LeapRayError(f"triangles name vertex {corners.max()}, but there are {len(points)}")
    if corners.dtype.itemsize > 4 and corners.size and corners.min() < 0:
        raise LeapRayError(f"triangles name vertex {corners.min()}")
    return points, np.ascontiguousarray(corners, dtype=np.int32), id_array(ids, len(corners))


def _mesh(points: NDArray, corners: NDArray, ids: NDArray | None = None) -> _abi.lr_mesh:
    """As C has it; the arrays are the caller's to keep."""
    return _abi.lr_mesh(
        pointer(points),
        len(points),
        pointer(corners, ctypes.c_int32),
        len(corners),
        pointer(ids, ctypes.c_uint16),
    )


@dataclass(frozen=True)
class _Limits:
    """What a volume and the scratch to make it may take, in bytes; None: anything."""

    both: int | None
    volume: int | None
    copied: int  # arrays that were not as the core takes them

    def check_table(self, points: NDArray, voxel_size: float, width: float) -> None:
        """Refuse, before anything is allocated, a lattice whose table is over the budget."""
        unlimited = self.both is None and self.volume is None
        if unlimited or not len(points) or not voxel_size > 0.0:
            return
        low, high = bounds(points)
        bricks = np.prod(np.ceil(((high - low) / voxel_size + 2.0 * width) / BRICK))
        self.check(4.0 * bricks, 0)

    def check(self, volume: float, scratch: int) -> None:
        counted = max(scratch - SPARE, 0)
        if self.both is not None and volume + counted > self.both:
            made = f" and {counted / 1e6:.1f} MB to make it" if counted else ""
            self._refuse(volume, made, volume + counted, self.both)
        if self.volume is not None and volume > self.volume:
            self._refuse(volume, "", volume, self.volume)

    def _refuse(self, volume: float, made: str, wanted: float, allowed: int) -> None:
        larger = "; use a larger voxel_size" if volume else ""
        refusal = OutOfMemory(
            f"the volume may take {volume / 1e6:.1f} MB{made}, but {allowed / 1e6:.1f} MB are "
            f"allowed{larger}"
        )
        refusal.nbytes = int(min(wanted, 2.0**63))
        raise refusal
