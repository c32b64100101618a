# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's images: as linear colours, and as the bytes that are looked up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

MISSING = (1.0, 0.0, 1.0)  # the colour of an image that cannot be read, as in Cycles
LINEAR = ("Linear Rec.709", "Linear", "Non-Color", "Raw")
DATA = ("Non-Color", "Raw")


@dataclass(frozen=True)
class Pixels:
    """An image's pixels, rows from below."""

    linear: NDArray[np.float32]  # (height, width, 4)
    coded: NDArray[np.uint8] | None  # (height, width, 3) in sRGB; None: it is stored otherwise

    def textured(self, colors: NDArray[np.floating]) -> NDArray:
        """Colours (height, width, 3) made of these as a texture's pixels: coded if these are.

        Cycles interpolates such images before it makes them linear.
        """
        if self.coded is None or colors.max() > 1:
            made = colors if colors.dtype == np.float32 and colors.min() >= 0 else None
            return np.maximum(colors, 0).astype(np.float32) if made is None else made
        if np.shares_memory(colors, self.linear):
            return self.coded
        return np.rint(255 * to_srgb(np.maximum(colors, 0))).astype(np.uint8)


def pixels_of(image, notes, *, straight: bool = False) -> Pixels | None:
    """None, and a note, for an image that cannot be read.

    straight: not multiplied by alpha, as colours are when a node's alpha is used too.
    """
    width, height = image.size
    if not width or not height or not len(image.pixels):
        notes.missing("Image", image.name, "cannot be read and is shown in pink")
        return None
    if image.source not in ("FILE", "GENERATED", "VIEWER"):
        kind = {"TILED": "first tile"}.get(image.source, "loaded frame")
        notes.missing("Image", image.name, f"is shown by its {kind} alone")
    flat = np.empty(width * height * image.channels, np.float32)
    image.pixels.foreach_get(flat)
    stored = flat.reshape(height, width, image.channels)
    pixels = stored
    if image.channels < 4:
        pixels = np.ones((height, width, 4), np.float32)
        pixels[..., :3] = stored[..., : 3 if image.channels == 3 else 1]
        if image.channels == 2:
            pixels[..., 3] = stored[..., 1]
    space, alpha = image.colorspace_settings.name, pixels[..., 3:]
    means_cover = image.alpha_mode in ("STRAIGHT", "PREMUL") and space not in DATA
    covered = means_cover and straight != (image.alpha_mode == "STRAIGHT") and (alpha < 1).any()
    if covered:  # as Cycles, not decoded yet
        pixels[..., :3] *= 1.0 / np.where(alpha > 0, alpha, 1.0) if straight else alpha
    coded = None
    if not image.is_float and space not in LINEAR:
        if space != "sRGB":
            notes.missing("Image", image.name, f"is taken for sRGB, it is {space}")
        if not covered:  # still bytes
            coded = np.rint(255 * np.clip(pixels[..., :3], 0, 1)).astype(np.uint8)
            pixels[..., :3] = from_srgb(np.arange(256, dtype=np.float32) / 255)[coded]
        else:
            pixels[..., :3] = from_srgb(pixels[..., :3])
    if image.alpha_mode == "NONE":
        pixels[..., 3] = 1.0
    return Pixels(pixels, coded)


def from_srgb(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Linear values of the sRGB ones."""
    values = np.maximum(values, np.float32(0))
    high = np.power((values + np.float32(0.055)) / np.float32(1.055), np.float32(2.4))
    return np.where(values < np.float32(0.04045), values / np.float32(12.92), high)


def to_srgb(values: NDArray[np.floating]) -> NDArray[np.floating]:
    """sRGB of linear values of 0 or more."""
    return np.where(values < 0.0031308, 12.92 * values, 1.055 * values ** (1 / 2.4) - 0.055)
