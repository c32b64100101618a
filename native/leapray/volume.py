# SPDX-License-Identifier: GPL-3.0-or-later
"""Volumes: samples on a lattice, held by the core in sparse bricks."""

from __future__ import annotations

import ctypes
import weakref
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _abi
from ._lib import LeapRayError, Watch, call, check, lib
from .arrays import (
    DTYPES,
    INTERPOLATIONS,
    NORMALS,
    SAMPLE_TYPES,
    choice,
    empty,
    id_array,
    matrix,
    numbers,
    pointer,
    triple,
)
from .attributes import Texture
from .threads import check_threads, run_parts

POINTS = 1024  # that a thread takes at a time

BRICK = 8  # samples along a brick


@dataclass(frozen=True)
class VolumeInfo:
    """What a volume holds. Triples are in x, y, z order."""

    size: tuple[int, int, int]  # samples per axis
    dtype: str  # "u8" | "u16" | "f32"
    kind: str  # "solid" | "sheet"
    has_ids: bool
    threshold: float
    object_from_index: NDArray[np.float64]  # (4, 4)
    n_bricks: int  # stored
    n_full: int  # bricks of ones, not stored
    n_surface_cells: int
    n_triangle_cells: int  # of those, the ones that keep their triangles
    n_cell_triangles: int  # on the lists of all those cells
    nbytes: int
    triangle_cells_nbytes: int  # of those, the bytes of triangle cells
    surface_lo: tuple[int, int, int]  # bounds of the surface cells, inclusive;
    surface_hi: tuple[int, int, int]  # lo > hi where there are none
    has_colors: bool  # samples at the surface carry a colour,
    has_normals: bool  # a shading normal
    n_objects: int  # of a merged volume, else 0
    n_shared: int  # samples that hold two objects of it
    n_dropped: int  # thirds that found no place in a sample
    planes: tuple[NDArray[np.float64], ...] | None = None  # x, y, z of a rectilinear volume
    interpolation: str = "linear"  # "linear" | "cubic"


class Volume:
    """A lattice of occupancy samples; the surface is where their field is T.

    samples: (nz, ny, nx) of uint8 or uint16, which mean 0..1, or of float32
    (float64 is rounded); finite. threshold: T, in (0, 1]. ids: the same shape,
    0..65535. object_from_index: (4, 4), affine and invertible; sample (i, j, k)
    lies at index coordinates (i, j, k); identity by default. sheet: the surface
    has no inside and is valid only in cells where touched (same shape as
    samples; the cell whose lowest corner is the sample) is true; everywhere by
    default. planes: where those of samples lie along x (nx,), y (ny,) and z (nz,),
    increasing, in place of 0, 1, 2, ...; object_from_index is applied to these. Such a
    rectilinear volume is for traversers with `rectilinear` set; scenes do not take it.
    interpolation: "linear", a trilinear field through the samples; or "cubic", the tricubic
    B-spline of which they are the coefficients, smooth to the second derivative and rounder than
    they are. It takes neither ids nor planes; `trace` says what it is traced by.
    Outside the lattice all samples are 0.
    Raises LeapRayError for anything else, OutOfMemory where there is no room.
    Attributes: info, a VolumeInfo; mesh_info, the MeshInfo of a voxelized volume, else None;
    textures, those that its surface looks up.
    """

    textures: tuple[Texture, ...]

    def __init__(
        self,
        samples: ArrayLike,
        threshold: float = 0.5,
        ids: ArrayLike | None = None,
        object_from_index: ArrayLike | None = None,
        *,
        sheet: bool = False,
        touched: ArrayLike | None = None,
        planes: tuple[ArrayLike, ArrayLike, ArrayLike] | None = None,
        interpolation: str = "linear",
    ) -> None:
        array = np.asarray(samples)
        if array.dtype == np.float64:
            array = array.astype(np.float32)
        names = [name for name, dtype in DTYPES.items() if dtype == array.dtype]
        if not names:
            raise LeapRayError(f"samples must be uint8, uint16 or float32; they are {array.dtype}")
        if array.ndim != 3 or array.size == 0:
            raise LeapRayError(f"samples must have the shape (nz, ny, nx); it is {array.shape}")
        builder = VolumeBuilder(
            array.shape[::-1],
            names[0],
            threshold,
            object_from_index,
            ids is not None,
            sheet,
            interpolation,
        )
        placed = None if planes is None else builder.place(planes)
        builder.put((0, 0, 0), array, ids, touched)
        self._adopt(builder.release(), None, placed)

    @classmethod
    def from_handle(cls, handle, mesh_info=None, textures: tuple = (), planes=None) -> Volume:
        """A finished volume that the core made; owns the handle from now on.

        mesh_info: of the mesh that it was voxelized from. textures: those that its faces look up,
        kept as long as the volume. planes: those that it was given.
        """
        volume = cls.__new__(cls)
        volume._adopt(handle, mesh_info, planes)
        volume.textures = textures
        return volume

    @classmethod
    def unpack(cls, data: bytes | NDArray[np.uint8], *, watch: Watch | None = None) -> Volume:
        """The volume that `pack` made data (n,) of, the same to the bit; without mesh_info
        and textures, see `bind`.

        Raises LeapRayError for bytes that this version cannot have made, whatever they
        are; OutOfMemory; Stopped when watch was told to stop.
        """
        held = np.frombuffer(data, np.uint8)
        handle = ctypes.POINTER(_abi.lr_volume)()
        where = pointer(held, ctypes.c_uint8)
        call(lib.lr_volume_unpack, where, held.size, watch=watch, outputs=(handle,))
        return cls.from_handle(handle)

    def bind(self, textures: tuple) -> None:
        """Give an unpacked volume the textures that it was made with. Raises LeapRayError."""
        handles = (ctypes.POINTER(_abi.lr_texture) * max(len(textures), 1))(
            *(texture.handle for texture in textures)
        )
        error = _abi.lr_error()
        status = lib.lr_volume_bind(self.handle, handles, len(textures), ctypes.byref(error))
        check(status, error)
        self.textures = tuple(textures)

    def pack(self, *, watch: Watch | None = None) -> NDArray[np.uint8]:
        """All that the volume holds, as bytes (n,) for a file, but for mesh_info.

        Raises LeapRayError for a rectilinear volume, Stopped when watch was told to stop.
        """
        data = np.empty(lib.lr_volume_packed_nbytes(self.handle), np.uint8)
        call(lib.lr_volume_pack, self.handle, pointer(data, ctypes.c_uint8), data.size, watch=watch)
        return data

    def _adopt(self, handle, mesh_info, planes=None) -> None:
        self.handle = handle
        self.mesh_info = mesh_info  # of the mesh it was voxelized from, else None
        self.textures = ()
        weakref.finalize(self, lib.lr_volume_free, handle)
        self.info = self._read_info(planes)

    def __repr__(self) -> str:
        info = self.info
        size = " x ".join(map(str, info.size))
        n = info.n_triangle_cells
        triangles = f", {n} of them triangle cells" * (n > 0)
        return (
            f"<Volume of {size} samples, {info.dtype}, {info.kind}, "
            f"{info.n_surface_cells} surface cells{triangles}, {info.nbytes / 1e6:.3g} MB>"
        )

    def _read_info(self, planes) -> VolumeInfo:
        info = _abi.lr_volume_info()
        lib.lr_volume_get_info(self.handle, ctypes.byref(info))
        counts = {name: getattr(info, name) for name, _ in info._fields_ if name[:2] == "n_"}
        return VolumeInfo(
            nbytes=info.nbytes,
            triangle_cells_nbytes=info.triangle_cells_nbytes,
            size=(info.desc.nx, info.desc.ny, info.desc.nz),
            dtype=next(n for n, c in SAMPLE_TYPES.items() if c == info.desc.sample_type),
            kind="sheet" if info.desc.kind == _abi.LR_KIND_SHEET else "solid",
            has_ids=bool(info.desc.has_ids),
            threshold=info.desc.threshold,
            object_from_index=np.array(info.desc.object_from_index[:]).reshape(4, 4),
            surface_lo=tuple(info.surface_lo),
            surface_hi=tuple(info.surface_hi),
            has_colors=bool(info.has_colors),
            has_normals=bool(info.has_normals),
            **counts,
            planes=planes,
            interpolation=list(INTERPOLATIONS)[info.desc.interpolation],
        )

    def narrow(self, gain: float = 1.0, *, watch: Watch | None = None) -> None:
        """Make the samples u8, in place, before anything else reads the volume.

        gain: how many times as steep occupancy becomes, as far as 0..1 reaches; it
        spends the 255 steps near the surface. No sample changes sides of the
        threshold: cells, ids, triangles and attributes stay what they are. Raises
        LeapRayError for a volume that is u8 already, or cubic, Stopped when watch was told to stop:
        then it is of no use any more.
        """
        call(lib.lr_volume_narrow, self.handle, gain, watch=watch)
        self.info = self._read_info(self.info.planes)

    def _get(self, origin, size, dtype, which: str) -> NDArray:
        where, count = triple(origin), triple(self.info.size if size is None else size)
        block = empty(tuple(count)[::-1], dtype)
        c_type = ctypes.c_uint16 if which == "ids" else ctypes.c_uint8
        target = None if which == "samples" else pointer(block, c_type)
        error = _abi.lr_error()
        status = lib.lr_volume_get(
            self.handle,
            where,
            count,
            block.ctypes.data_as(ctypes.c_void_p) if which == "samples" else None,
            target if which == "ids" else None,
            target if which == "surface" else None,
            ctypes.byref(error),
        )
        check(status, error)
        return block

    def read(self, origin=(0, 0, 0), size=None) -> NDArray:
        """A block of samples, as (nz, ny, nx).

        origin: its first sample; size: samples per axis, both in x, y, z order; size None: all.
        It may reach beyond the lattice, where samples are 0. Raises LeapRayError for what are
        no three whole numbers.
        """
        return self._get(origin, size, DTYPES[self.info.dtype], "samples")

    def read_ids(self, origin=(0, 0, 0), size=None) -> NDArray[np.uint16]:
        """The ids of a block of samples; 0 without ids. origin, size: as for `read`."""
        return self._get(origin, size, np.uint16, "ids")

    def read_surface(self, origin=(0, 0, 0), size=None) -> NDArray[np.bool_]:
        """Which cells of a block are surface cells; origin, size: as for `read`, of their lowest
        samples."""
        return self._get(origin, size, np.uint8, "surface").astype(bool)

    def read_exact(self, origin=(0, 0, 0), size=None) -> NDArray[np.bool_]:
        """Which cells of a block keep their triangles; origin, size: as for `read_surface`."""
        return self._get(origin, size, np.uint8, "surface") == 2

    def bricks(self) -> tuple[NDArray[np.int32], int]:
        """Origins (n, 3) of all bricks of 8^3 samples that are not 0, and how many are stored.

        The stored ones come first; all samples of the others are 1. Raises LeapRayError.
        """
        count = self.info.n_bricks + self.info.n_full
        origins = np.empty((count, 3), np.int32)
        error = _abi.lr_error()
        status = lib.lr_volume_get_bricks(
            self.handle, pointer(origins, ctypes.c_int32), count, ctypes.byref(error)
        )
        check(status, error)
        return origins, self.info.n_bricks

    def sample(
        self, points: ArrayLike, ids: ArrayLike | None = None, gain: float = 0.0
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Value (n,) and gradient (n, 3) of the field at points (n, 3).

        Points and gradient are in object space, values in 0..1; 0 where no surface can lie.
        ids (n,): of a merged volume, whose object's own field; None: of the largest samples.
        gain above 0: of the field that `narrow(gain)` would leave. Raises LeapRayError for other
        shapes and unknown ids, and for a gain of a cubic volume.
        """
        where = _points(points)
        ids = id_array(ids, len(where), one=True)
        value, gradient = np.empty(len(where)), np.empty((len(where), 3))
        error = _abi.lr_error()
        status = lib.lr_volume_sample(
            self.handle,
            pointer(where),
            pointer(ids, ctypes.c_uint16),
            len(where),
            gain,
            pointer(value),
            pointer(gradient),
            ctypes.byref(error),
        )
        check(status, error)
        return value, gradient

    def attributes(
        self, points: ArrayLike, ids: ArrayLike | None = None, width: float = 0.0
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Colours (n, 3), linear RGB, and unit shading normals (n, 3) near the surface.

        points: (n, 3), object space; ids: (n,), those of the hits that ask (None: 0).
        width: of the surface, in voxels, that textures are averaged over.
        NaN where the volume carries none. Raises LeapRayError for other shapes and unknown ids.
        """
        where = _points(points)
        colors, normals = np.empty(where.shape), np.empty(where.shape)
        self._attributes(where, id_array(ids, len(where), one=True), width, colors, normals)
        return colors, normals

    def colors(
        self,
        points: ArrayLike,
        ids: ArrayLike | None = None,
        width: float = 0.0,
        *,
        threads: int = 1,
    ) -> NDArray[np.float64]:
        """The colours (n, 3) of `attributes` without the normals, which takes less time.

        points, ids, width: as for `attributes`. threads: 0: all cores. Raises LeapRayError as that
        does.
        """
        where = _points(points)
        whose = id_array(ids, len(where), one=True)
        colors = np.empty(where.shape)

        def part(first: int, last: int) -> None:
            some = slice(first, last)
            self._attributes(where[some], _some(whose, some), width, colors[some], None)

        _in_parts(part, len(where), threads)
        return colors

    def _attributes(self, where, ids, width: float, colors, normals) -> None:
        error = _abi.lr_error()
        status = lib.lr_volume_attributes(
            self.handle,
            pointer(where),
            pointer(ids, ctypes.c_uint16),
            len(where),
            width,
            pointer(colors),
            pointer(normals),
            ctypes.byref(error),
        )
        check(status, error)

    def normals(
        self,
        points: ArrayLike,
        ids: ArrayLike | None = None,
        normal: str = "central",
        *,
        threads: int = 1,
    ) -> NDArray[np.float64]:
        """Unit shading normals (n, 3), outward, that hits at points (n, 3) would have.

        points: of the surface, in object space; ids as for `sample`. normal: as for
        `trace`. threads: 0: all cores. NaN where the field vanishes. Raises LeapRayError for other
        shapes and names.
        """
        where = _points(points)
        whose = id_array(ids, len(where), one=True)
        kind, found = choice(NORMALS, normal, "normal"), np.empty(where.shape)

        def part(first: int, last: int) -> None:
            some, error = slice(first, last), _abi.lr_error()
            status = lib.lr_volume_normals(
                self.handle,
                pointer(where[some]),
                pointer(_some(whose, some), ctypes.c_uint16),
                last - first,
                kind,
                pointer(found[some]),
                ctypes.byref(error),
            )
            check(status, error)

        _in_parts(part, len(where), threads)
        return found

    def exact_at(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Whether points (n, 3) in object space lie in cells that keep their triangles, (n,).

        Raises LeapRayError for other shapes.
        """
        where = _points(points)
        exact = np.empty(len(where), np.uint8)
        error = _abi.lr_error()
        status = lib.lr_volume_exact_at(
            self.handle,
            pointer(where),
            len(where),
            pointer(exact, ctypes.c_uint8),
            ctypes.byref(error),
        )
        check(status, error)
        return exact.astype(bool)


def _some(ids: NDArray | None, some: slice) -> NDArray | None:
    return None if ids is None else ids[some]


def _in_parts(part: Callable[[int, int], None], n: int, threads: int) -> None:
    """part(first, last) for some points at a time, on so many threads; 0: all cores."""
    check_threads(threads)
    if threads == 1:
        part(0, n)
    else:
        run_parts(part, n, POINTS, threads, Watch())


def merge(volumes: Sequence[Volume], *, watch: Watch | None = None) -> Volume:
    """One volume of several solids: every one keeps its surface where another covers it.

    volumes: with ids, of which none is in two of them; the number of a part is its
    object. Voxels and sample types agree, lattices are a whole number of voxels
    apart. Where objects meet a sample holds the two of largest occupancy;
    info.n_dropped counts what a third one lost. A ray tests every object's own
    field, the nearest hit wins, of equal ones that of the lower object.
    Raises LeapRayError, OutOfMemory; Stopped when watch was told to stop.
    """
    handles = (ctypes.POINTER(_abi.lr_volume) * max(len(volumes), 1))(
        *(volume.handle for volume in volumes)
    )
    merged = ctypes.POINTER(_abi.lr_volume)()
    call(lib.lr_volume_merge, handles, len(volumes), watch=watch, outputs=(merged,))
    return Volume.from_handle(
        merged, None, tuple(dict.fromkeys(t for v in volumes for t in v.textures))
    )


def set_planes(handle, planes, size: tuple[int, ...]) -> tuple[NDArray[np.float64], ...]:
    """Give a volume that is not finished its planes; see `VolumeBuilder.place`."""
    taken = tuple(np.array(axis, dtype=np.float64) for axis in planes)
    shapes = [axis.shape for axis in taken]
    if shapes != [(n,) for n in size]:
        wanted = ", ".join(map(str, size))
        raise LeapRayError(f"planes must be {wanted} numbers along x, y, z; it has {shapes}")
    error = _abi.lr_error()
    status = lib.lr_volume_set_planes(handle, *map(pointer, taken), ctypes.byref(error))
    check(status, error)
    for axis in taken:
        axis.setflags(write=False)
    return taken


class VolumeBuilder:
    """An empty volume that is filled block by block; `finish` makes the Volume.

    size: samples per axis in x, y, z order; dtype: "u8", "u16" or "f32"; has_ids: blocks will
    have ids; threshold, object_from_index (4, 4), sheet and interpolation as for `Volume`. Raises
    LeapRayError.
    """

    def __init__(
        self,
        size,
        dtype,
        threshold=0.5,
        object_from_index=None,
        has_ids=False,
        sheet=False,
        interpolation="linear",
    ) -> None:
        sample_type, self._dtype = choice(SAMPLE_TYPES, dtype, "dtype"), DTYPES[dtype]
        self._size = size = tuple(triple(size))
        desc = _abi.lr_volume_desc(
            nx=size[0],
            ny=size[1],
            nz=size[2],
            sample_type=sample_type,
            kind=_abi.LR_KIND_SHEET if sheet else _abi.LR_KIND_SOLID,
            has_ids=has_ids,
            interpolation=choice(INTERPOLATIONS, interpolation, "interpolation"),
            threshold=threshold,
            object_from_index=matrix(object_from_index, "object_from_index"),
            inside=1.0,
        )
        self._handle = ctypes.POINTER(_abi.lr_volume)()
        error = _abi.lr_error()
        status = lib.lr_volume_begin(
            ctypes.byref(desc), ctypes.byref(self._handle), ctypes.byref(error)
        )
        check(status, error)
        self._free = weakref.finalize(self, lib.lr_volume_free, self._handle)

    def __repr__(self) -> str:
        state = "open" if self._free.alive else "spent"
        return f"<VolumeBuilder of {' x '.join(map(str, self._size))} samples, {state}>"

    def place(self, planes) -> tuple[NDArray[np.float64], ...]:
        """Make the volume rectilinear; returns the planes (x, y, z) as they are taken.

        planes: where the samples lie along x (nx,), y (ny,) and z (nz,); increasing. Raises
        LeapRayError for others.
        """
        return set_planes(self._own(), planes, self._size)

    def put(self, origin, samples: NDArray, ids=None, touched=None) -> None:
        """Write a block of samples (nz, ny, nx), from the sample origin (x, y, z) on.

        ids and touched cells: as for `Volume`, of the same shape. Blocks must not overlap. Raises
        LeapRayError for blocks beyond the lattice and other shapes.
        """
        block = np.ascontiguousarray(samples, dtype=self._dtype)
        if ids is not None:
            ids = _same_shape(ids, block.shape, np.uint16, "ids")
        if touched is not None:
            touched = _same_shape(touched, block.shape, np.uint8, "touched")
        error = _abi.lr_error()
        status = lib.lr_volume_put(
            self._own(),
            triple(origin),
            triple(block.shape[::-1]),
            block.ctypes.data_as(ctypes.c_void_p),
            pointer(ids, ctypes.c_uint16),
            pointer(touched, ctypes.c_uint8),
            ctypes.byref(error),
        )
        check(status, error)

    def release(self):
        """Finish, and give the handle away. Raises LeapRayError for a builder that is spent."""
        call(lib.lr_volume_finish, self._own())
        self._free.detach()
        return self._handle

    def _own(self):
        if not self._free.alive:
            raise LeapRayError("this builder is spent: it has made its volume")
        return self._handle

    def finish(self) -> Volume:
        """The volume; the builder is spent."""
        return Volume.from_handle(self.release())


def _points(points: ArrayLike) -> NDArray[np.float64]:
    where = np.ascontiguousarray(points, dtype=np.float64)
    if where.ndim != 2 or where.shape[1] != 3:
        raise LeapRayError(f"points must have the shape (n, 3); it is {where.shape}")
    return where


def _same_shape(values: ArrayLike, shape: tuple, dtype, name: str) -> NDArray:
    array = np.asarray(values)
    if array.shape != shape:
        raise LeapRayError(f"{name} must have the samples' shape {shape}; it is {array.shape}")
    return np.ascontiguousarray(numbers(array, dtype, name))
