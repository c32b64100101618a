# SPDX-License-Identifier: GPL-3.0-or-later
"""What a mesh's corners carry into its volume: colours, textures, smooth normals."""

from __future__ import annotations

import ctypes
import weakref
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _abi
from ._lib import LeapRayError, Watch, call, check, lib
from .arrays import choice, members, numbers, pointer
from .programs import Program

INTERPOLATIONS = members(_abi.lr_interpolation)
EXTENSIONS = members(_abi.lr_extension)
WHITE, VERTEX = _abi.LR_COLOR_NONE, _abi.LR_COLOR_VERTEX


class Texture:
    """An image with its smaller versions; any number of voxelizations may share it.

    pixels: (height, width, 3), rows from below: uint8 in sRGB, which is interpolated as
    such, as Cycles does, or linear RGB; what is not finite is black. The centre of texel
    (x, y) lies at u = (x + 0.5) / width, v likewise.
    interpolation: "linear", "closest" or "cubic"; extension, what lies outside 0..1:
    "repeat", "extend" (the colour of the edge), "clip" (black) or "mirror".
    program: makes linear RGB of what is looked up, of pixels as they are, with alpha
    where they have a fourth channel, uint8 as 0..1; pixels of None are the colours of the
    mesh's corners. points_only: no smaller versions, for what is looked up at points alone.
    Raises LeapRayError for other shapes and names, Stopped when watch was told to stop.
    Source: Williams 1983 (pyramid).
    """

    def __init__(
        self,
        pixels: ArrayLike | None,
        interpolation: str = "linear",
        extension: str = "repeat",
        program: Program | None = None,
        *,
        points_only: bool = False,
        watch: Watch | None = None,
    ) -> None:
        self.program = program
        coded = getattr(pixels, "dtype", None) == np.uint8
        self.of_corners = of_corners = pixels is None and program is not None
        self.pixels = np.ascontiguousarray(
            np.zeros((1, 1, 3)) if of_corners else pixels, dtype=np.uint8 if coded else np.float32
        )
        if self.pixels.ndim != 3 or self.pixels.shape[2] not in ((3, 4) if program else (3,)):
            raise LeapRayError(f"pixels must have the shape (h, w, 3); it is {self.pixels.shape}")
        height, width, channels = self.pixels.shape
        self.handle = ctypes.POINTER(_abi.lr_texture)()
        desc = _abi.lr_texture_desc(
            pixels=None if of_corners else self.pixels.ctypes.data,
            program=ctypes.pointer(program.packed) if program else None,
            sample_type=_abi.LR_U8 if coded else _abi.LR_F32,
            channels=channels,
            width=width,
            height=height,
            interpolation=choice(INTERPOLATIONS, interpolation, "interpolation"),
            extension=choice(EXTENSIONS, extension, "extension"),
            points_only=int(points_only),
        )
        call(lib.lr_texture_new, ctypes.byref(desc), watch=watch, outputs=(self.handle,))
        weakref.finalize(self, lib.lr_texture_free, self.handle)
        self.nbytes = self.pixels.nbytes + lib.lr_texture_nbytes(self.handle)

    def __repr__(self) -> str:
        height, width, _ = self.pixels.shape
        return f"<Texture of {width} x {height} texels, {self.pixels.dtype}>"

    def sample(self, uvs: ArrayLike, footprints: ArrayLike | None = None) -> NDArray[np.float32]:
        """Colours (n, 3) at uvs (n, 2), averaged over footprints (n, 3); None: at points.

        A footprint is the long axis (x, y) of an ellipse and its width across it, in texels.
        Raises LeapRayError for other shapes.
        """
        where = np.ascontiguousarray(uvs, dtype=np.float32)
        if where.ndim != 2 or where.shape[1] != 2:
            raise LeapRayError(f"uvs must have the shape (n, 2); it is {where.shape}")
        if footprints is not None:
            footprints = _floats(footprints, (len(where), 3), "footprints")
        colors = np.empty((len(where), 3), np.float32)
        error = _abi.lr_error()
        arrays = (pointer(a, ctypes.c_float) for a in (where, footprints))
        status = lib.lr_texture_sample(
            self.handle,
            *arrays,
            len(where),
            pointer(colors, ctypes.c_float),
            ctypes.byref(error),
        )
        check(status, error)
        return colors


@dataclass(frozen=True)
class Attributes:
    """What the corners of a mesh's m triangles carry; None is nothing.

    normals: (m, 3, 3), smooth, on the side that the winding shows; they become the
    shading normals of hits. color_sources: (m,), for each triangle VERTEX (its
    colors), the number of a texture (through its uvs) or WHITE; None: no colours.
    colors: (m, 3, 3), linear RGB, at most 64. uvs: (m, 3, 2).
    """

    normals: NDArray[np.float32] | None = None
    color_sources: NDArray[np.int32] | None = None
    colors: NDArray[np.float32] | None = None
    uvs: NDArray[np.float32] | None = None
    textures: tuple[Texture, ...] = ()

    def pack(self, n: int) -> _abi.lr_attributes:
        """For C; it holds on to its arrays. n: triangles. Raises LeapRayError."""
        shapes = {"normals": (n, 3, 3), "colors": (n, 3, 3), "uvs": (n, 3, 2)}
        arrays = {name: _floats(getattr(self, name), shapes[name], name) for name in shapes}
        sources = self.color_sources
        if sources is not None:
            sources = np.asarray(sources)
            if sources.shape != (n,) or sources.dtype.kind not in "iu":
                raise LeapRayError(
                    f"color_sources must be {n} whole numbers, one per triangle; they are "
                    f"{sources.dtype} of shape {sources.shape}"
                )
            sources = np.ascontiguousarray(numbers(sources, np.int32, "color_sources"))
        handles = (ctypes.POINTER(_abi.lr_texture) * max(len(self.textures), 1))(
            *(texture.handle for texture in self.textures)
        )
        packed = _abi.lr_attributes(
            corner_normals=pointer(arrays["normals"], ctypes.c_float),
            corner_colors=pointer(arrays["colors"], ctypes.c_float),
            corner_uvs=pointer(arrays["uvs"], ctypes.c_float),
            color_sources=pointer(sources, ctypes.c_int32),
            textures=handles,
            n_textures=len(self.textures),
        )
        packed.kept = arrays, sources, handles, self.textures
        return packed


def _floats(values: ArrayLike | None, shape: tuple, name: str) -> NDArray[np.float32] | None:
    if values is None:
        return None
    array = np.ascontiguousarray(values, dtype=np.float32)
    if array.shape != shape:
        raise LeapRayError(f"{name} must have the shape {shape}; it is {array.shape}")
    return array
