# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's images as Cycles looks them up: their texels, and what is done to a look.

A file is read as Cycles reads it, by OpenImageIO: it does not read what Blender has in
memory, whose bytes have been divided by alpha, and whose 16-bit values are linear.
Packed and generated images are taken from Blender, and files too where OpenImageIO is
missing. Colours are multiplied by alpha as they are stored, interpolated, divided by it
where a node uses the alpha too, and made linear: in that order.

Source: Blender's manual, Image Texture and Image properties; the order by rendering.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from leapray import INPUTS, Value, operate

from ...arrays import from_srgb

MISSING = (1.0, 0.0, 1.0)  # the colour of an image that cannot be read, as in Cycles
LINEAR = ("Linear Rec.709", "Linear", "scene_linear")
DATA = ("Non-Color", "Raw")
CODED = "sRGB"


@dataclass(frozen=True)
class Texels:
    """An image's texels as they are interpolated, rows from below."""

    rgba: NDArray[np.float32] | NDArray[np.uint8]  # (height, width, 4), bytes are 0..1
    coded: bool  # in sRGB
    means_cover: bool  # colours are multiplied by alpha
    opaque: bool  # alpha is 1 throughout
    _rgb: list = field(default_factory=list, compare=False)

    @property
    def rgb(self) -> NDArray[np.float32] | NDArray[np.uint8]:
        """(height, width, 3); bytes only where they are sRGB, as textures without a program want
        them. Made once."""
        if not self._rgb:
            colors = np.ascontiguousarray(self.rgba[..., :3])
            if colors.dtype == np.uint8 and not self.coded:
                colors = colors.astype(np.float32) / 255
            self._rgb.append(colors)
        return self._rgb[0]

    @property
    def plain(self) -> bool:
        """Whether colours are looked up without a program."""
        return not self.coded or self.rgba.dtype == np.uint8

    def look(self, *, straight: bool) -> tuple[Value, Value, Value, Value]:
        """Linear colour and alpha of what is looked up. straight: divided by alpha, as colours
        are where a node's alpha is used too."""
        alpha = INPUTS[3]
        colors: list[Value] = list(INPUTS[:3])
        if straight and self.means_cover:
            colors = [operate("select", alpha, operate("divide", c, alpha), c) for c in colors]
        if self.coded:
            colors = [operate("from_srgb", c) for c in colors]
        red, green, blue = colors
        return red, green, blue, alpha

    def linear(self) -> NDArray[np.float32]:
        """(height, width, 3) of the texels themselves."""
        colors = self.rgba[..., :3]
        if colors.dtype == np.uint8:
            table = np.arange(256, dtype=np.float32) / 255
            return (from_srgb(table) if self.coded else table)[colors]
        floats = cast(NDArray[np.float32], colors)
        return from_srgb(floats) if self.coded else floats


def texels_of(image, notes) -> Texels | None:
    """None, and a note, for an image that cannot be read."""
    if image.source not in ("FILE", "GENERATED", "VIEWER"):
        kind = {"TILED": "first tile"}.get(image.source, "loaded frame")
        notes.missing("Image", image.name, f"is shown by its {kind} alone")
    stored = _stored(image)
    if stored is None:
        notes.missing("Image", image.name, "cannot be read and is shown in pink")
        return None
    space, rgba = image.colorspace_settings.name, stored.rgba
    bad = np.zeros((), bool) if rgba.dtype == np.uint8 else ~np.isfinite(rgba).all(axis=-1)
    if bad.any():
        n = int(bad.sum())
        notes.missing("Image", image.name, f"has {n} pixels that are not finite: they are black")
        rgba[bad] = 0
    coded = space == CODED and not stored.linear
    processor = None
    if not (stored.linear or coded or space in LINEAR + DATA):
        processor = _to_scene_linear(space)
        if processor is None:
            notes.missing("Image", image.name, f"is taken for sRGB, it is {space}")
            coded = True
        else:
            rgba = _floats(rgba, stored.halves)
    means_cover = image.alpha_mode in ("STRAIGHT", "PREMUL") and space not in DATA
    if means_cover and stored.straight:
        rgba = _multiplied(rgba)
    one = 255 if rgba.dtype == np.uint8 else 1
    if image.alpha_mode == "NONE":
        rgba[..., 3] = one
    if processor is not None:
        rgba = _converted(rgba, processor, stored.halves)
    return Texels(rgba, coded, means_cover, bool((rgba[..., 3] == one).all()))


class _Stored(NamedTuple):
    """What an image's file or memory holds."""

    rgba: NDArray  # (height, width, 4), its own
    straight: bool = False  # alpha is still to be multiplied into the colours
    linear: bool = False  # Blender has converted it
    halves: bool = False  # Cycles converts colours into numbers of that precision


def _stored(image) -> _Stored | None:
    """None where an image cannot be read."""
    if image.source == "FILE" and not image.packed_file:
        oiio = openimageio()
        if oiio is not None:
            return _of_file(oiio, image)
    width, height = image.size
    if not width or not height or not len(image.pixels):
        return None
    flat = np.empty(width * height * image.channels, np.float32)
    image.pixels.foreach_get(flat)
    rgba = _four_channels(flat.reshape(height, width, image.channels))
    straight = image.alpha_mode == "STRAIGHT" if _by_mode() else not image.is_float
    if image.is_float:
        return _Stored(rgba, straight, linear=True)
    return _Stored(np.rint(255 * np.clip(rgba, 0, 1)).astype(np.uint8), straight, halves=True)


def _four_channels(stored: NDArray) -> NDArray:
    """Grey, grey with alpha, RGB or RGBA as RGBA."""
    height, width, channels = stored.shape
    if channels == 4:
        return stored
    one = np.iinfo(stored.dtype).max if stored.dtype.kind == "u" else 1
    made = np.full((height, width, 4), one, stored.dtype)
    made[..., :3] = stored[..., :3] if channels >= 3 else stored[..., :1]
    if channels == 2 or channels > 4:
        made[..., 3] = stored[..., 3 if channels > 4 else 1]
    return made


@cache
def openimageio():
    """The module, None where this Blender lacks it."""
    import bpy

    try:
        bpy.utils.expose_bundled_modules()
        import OpenImageIO
    except (AttributeError, ImportError):  # Blender of a distribution
        return None
    return OpenImageIO


def _of_file(oiio, image) -> _Stored | None:
    import bpy

    path = bpy.path.abspath(image.filepath, library=image.library)
    if not Path(path).is_file():
        return None
    config = oiio.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)
    file = oiio.ImageInput.open(path, config)
    if file is None:
        return None
    spec = file.spec()
    kind = {"uint8": "uint8", "uint16": "uint16"}.get(str(spec.format), "")
    kind = kind or ("float" if str(spec.format) in ("half", "float", "double") else "uint8")
    read = file.read_image(0, 0, 0, spec.nchannels, kind)
    file.close()
    if read is None or spec.width < 1 or spec.height < 1:
        return None
    stored = np.asarray(read).reshape(spec.height, spec.width, spec.nchannels)[::-1]
    if file.format_name() == "jpeg" and spec.nchannels == 4:
        stored = _from_cmyk(stored)
    return _Stored(
        _as_stored(_four_channels(stored)),
        straight=_is_straight(file, spec, image),
        halves=str(spec.format) not in ("float", "double"),
    )


def _as_stored(rgba: NDArray) -> NDArray:
    """Bytes as they are, all else as f32."""
    if rgba.dtype == np.uint8:
        return np.array(rgba)
    scale = np.iinfo(rgba.dtype).max if rgba.dtype.kind == "u" else 1
    return rgba.astype(np.float32) / np.float32(scale)


def _from_cmyk(stored: NDArray) -> NDArray:
    most = np.iinfo(stored.dtype).max
    cmyk = stored.astype(np.float32) / most
    return np.rint(most * (1 - cmyk[..., :3]) * (1 - cmyk[..., 3:])).astype(stored.dtype)


def _by_mode() -> bool:
    """Whether Cycles multiplies colours by alpha as the image's alpha mode says. Before 5.2 it goes
    by what the file is, or multiplies all bytes."""
    import bpy

    return bpy.app.version >= (5, 2)


def _is_straight(file, spec, image) -> bool:
    """Whether Cycles multiplies a file's colours by its alpha."""
    if spec.nchannels != 4:
        return False
    if _by_mode():
        return image.alpha_mode == "STRAIGHT"
    name = file.format_name()
    if name == "targa":
        return spec.get_int_attribute("targa:alpha_type", -1) != 4
    return name in ("dds", "psd") or bool(spec.get_int_attribute("oiio:UnassociatedAlpha", 0))


def _multiplied(rgba: NDArray) -> NDArray:
    """Colours times alpha, in the precision that they are stored in."""
    if rgba.dtype == np.uint8:
        wide = rgba.astype(np.uint16)
        wide[..., :3] = wide[..., :3] * wide[..., 3:] // 255
        return wide.astype(np.uint8)
    made = rgba.copy()
    made[..., :3] *= made[..., 3:]
    return made


@cache
def _to_scene_linear(space: str):
    """OpenColorIO's processor from a colour space of Blender's; None where there is none."""
    import bpy

    try:
        bpy.utils.expose_bundled_modules()
        import PyOpenColorIO as ocio
    except (AttributeError, ImportError):  # Blender of a distribution
        return None
    folder = bpy.utils.system_resource("DATAFILES", path="colormanagement")
    path = os.environ.get("OCIO") or str(Path(folder, "config.ocio"))
    try:
        config = ocio.Config.CreateFromFile(path)
        return config.getProcessor(space, ocio.ROLE_SCENE_LINEAR).getDefaultCPUProcessor()
    except ocio.Exception:
        return None


def _floats(rgba: NDArray, halves: bool) -> NDArray[np.float32]:
    made = rgba.astype(np.float32) / (255 if rgba.dtype == np.uint8 else 1)
    return _as_half(made) if halves else made


def _converted(rgba: NDArray[np.float32], processor, halves: bool) -> NDArray[np.float32]:
    """Linear colours of another colour space, multiplied by alpha as before."""
    alpha = np.where((rgba[..., 3:] > 0) & (rgba[..., 3:] < 1), rgba[..., 3:], np.float32(1))
    made = rgba.copy()
    made[..., :3] /= alpha
    processor.applyRGBA(made)
    made[..., :3] *= alpha
    return _as_half(made) if halves else made


def _as_half(values: NDArray[np.float32]) -> NDArray[np.float32]:
    most = np.finfo(np.float16).max
    return np.clip(values, -most, most).astype(np.float16).astype(np.float32)
