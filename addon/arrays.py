# SPDX-License-Identifier: GPL-3.0-or-later
"""What numpy arrays are asked again and again: directions, sRGB, names of contents (no bpy)."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

FLOAT_MOST = float(np.finfo(np.float32).max)
LUMINANCE = (0.2126729, 0.7151522, 0.0721750)  # Rec. 709


def lengths(vectors: NDArray) -> NDArray:
    """(...,): of (..., 3), as numpy's norm, which takes longer for so short rows."""
    x, y, z = (vectors[..., axis] for axis in range(3))
    return np.sqrt(x * x + y * y + z * z)


def crossed(first: Iterable[NDArray], second: Iterable[NDArray]) -> tuple[NDArray, ...]:
    """The cross products of vectors, x, y, z each in an array, which numpy's takes longer for."""
    (x, y, z), (u, v, w) = first, second
    return y * w - z * v, z * u - x * w, x * v - y * u


def unit(vectors: NDArray) -> NDArray:
    """(..., 3), of length 1; those of length 0 stay so."""
    long = lengths(vectors)[..., None]
    return vectors / np.where(long > 0, long, 1)


def blend(weights: NDArray[np.float64], corners: NDArray) -> NDArray[np.float64]:
    """(n, c): what corners (n, k, c) have, by their weights (n, k)."""
    parts = (weights[:, k, None] * corners[:, k] for k in range(corners.shape[1]))
    return functools.reduce(np.add, parts)


def inverse(linear: NDArray[np.float64]) -> NDArray[np.float64]:
    """(..., 3, 3): the inverses of maps that have some, by cofactors.

    numpy's inverse wakes threads that then wait, busily, for more work.
    """
    largest = np.abs(linear).max(axis=(-2, -1), keepdims=True)
    m, after, before = linear / largest, [1, 2, 0], [2, 0, 1]
    below, above = m[..., after, :], m[..., before, :]
    cofactors = below[..., after] * above[..., before] - below[..., before] * above[..., after]
    volume = (m[..., :1, :] * cofactors[..., :1, :]).sum(axis=-1, keepdims=True)
    return np.swapaxes(cofactors, -2, -1) / volume / largest


def from_srgb(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Linear values of the sRGB ones. Source: IEC 61966-2-1."""
    values = np.maximum(values, np.float32(0))
    high = np.power((values + np.float32(0.055)) / np.float32(1.055), np.float32(2.4))
    return np.where(values < np.float32(0.04045), values / np.float32(12.92), high)


def srgb(linear: NDArray[np.floating]) -> NDArray[np.float32]:
    """Linear RGB as the Standard view shows it: sRGB in 0..1. Source: IEC 61966-2-1."""
    linear = np.clip(np.asarray(linear, np.float32), 0.0, 1.0)
    curved = 1.055 * np.power(np.maximum(linear, 1e-8), 1 / 2.4) - 0.055
    return np.where(linear <= 0.0031308, 12.92 * linear, curved).astype(np.float32)


def digest(arrays: Iterable[NDArray | None], told: bytes = b"") -> str:
    """A name for what arrays hold, some of which may be missing, and for what is told beside."""
    name = hashlib.sha1(told, usedforsecurity=False)  # processors have instructions for it
    for array in arrays:
        if array is not None:
            name.update(np.ascontiguousarray(array).view(np.uint8).data)
        name.update(b"|")
    return name.hexdigest()
