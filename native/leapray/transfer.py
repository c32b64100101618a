# SPDX-License-Identifier: GPL-3.0-or-later
"""Transfer functions: what values of a field look like."""

from __future__ import annotations

import ctypes
import weakref

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _abi
from ._lib import LeapRayError, check, lib
from .arrays import numbers, pointer


class TransferFunction:
    """Extinction, colour, emission and scattering of values, linear between knots, constant beyond.

    values: (n,), in the unit of the field, not descending; two knots at one value are a jump, and
    the value itself has what the second says. extinction: (n,), per unit of object space. colors:
    (n, 3), linear RGB, or (3,) for all: the radiance of what is opaque. emission: (n, 3) or (3,),
    linear RGB: radiance per unit of object space, beside what extinction brings; None: none.
    scattering: (n, 3) or (3,), linear RGB, per unit of object space: what of the extinction
    scatters light in the instances of a scene, instead of absorbing it; None: none. All lie between
    0 and 1e30. full_gradient: 0, or what makes boundaries stand out: extinction, emission and
    scattering are times the length of the gradient as a share of this one, in values per unit of
    object space, at most 1. The length is that of central differences at the samples, one-sided
    beside what is no value, and linear between. Raises LeapRayError for others and for other
    shapes, and for scattering where nothing is extinguished.
    Attributes: those six, arrays of which cannot be written; visible: whether any value is.
    """

    def __init__(
        self,
        values: ArrayLike,
        extinction: ArrayLike,
        colors: ArrayLike = (1.0, 1.0, 1.0),
        emission: ArrayLike | None = None,
        scattering: ArrayLike | None = None,
        full_gradient: float = 0.0,
    ) -> None:
        self.values = _column(values, "values", None)
        n = len(self.values)
        self.extinction = _column(extinction, "extinction", n)
        self.colors = _triples(colors, "colors", n)
        self.emission = _triples((0.0, 0.0, 0.0) if emission is None else emission, "emission", n)
        scattering = (0.0, 0.0, 0.0) if scattering is None else scattering
        self.scattering = _triples(scattering, "scattering", n)
        self.full_gradient = numbers(full_gradient, np.float64, "full_gradient").item()
        self.visible = bool(self.extinction.any() or self.emission.any())
        self.handle = ctypes.POINTER(_abi.lr_transfer)()
        desc = _abi.lr_transfer_desc(
            n,
            pointer(self.values),
            pointer(self.extinction),
            pointer(self.colors),
            pointer(self.emission),
            pointer(self.scattering),
            self.full_gradient,
        )
        error = _abi.lr_error()
        status = lib.lr_transfer_new(
            ctypes.byref(desc), ctypes.byref(self.handle), ctypes.byref(error)
        )
        check(status, error)
        weakref.finalize(self, lib.lr_transfer_free, self.handle)

    def __repr__(self) -> str:
        ends = f"{self.values[0]:.6g} to {self.values[-1]:.6g}"
        return f"<TransferFunction of {len(self.values)} knots, {ends}>"

    def sees_as(self, other: TransferFunction) -> bool:
        """Whether what is visible by another transfer function is so by this one, and no more.

        other: whose values, extinction and emission are compared; False where those differ.
        """
        pairs = (
            (self.values, other.values),
            (self.extinction, other.extinction),
            (self.emission, other.emission),
        )
        return all(np.array_equal(a, b) for a, b in pairs)

    def greatest(
        self, low: ArrayLike, high: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The greatest extinction and the greatest component of emission over ranges of values.

        low, high: (n,), the ends of each range, which belong to it. Returns two arrays (n,); where
        both are 0 nothing of the range is visible. Raises LeapRayError where high lies below low.
        """
        lows, highs = _column(low, "low", None), _column(high, "high", None)
        if lows.shape != highs.shape:
            raise LeapRayError(f"there are {len(lows)} numbers in low but {len(highs)} in high")
        extinction, emission = np.empty(len(lows)), np.empty(len(lows))
        error = _abi.lr_error()
        ends = pointer(lows), pointer(highs)
        found = pointer(extinction), pointer(emission)
        status = lib.lr_transfer_greatest(
            self.handle, *ends, len(lows), *found, ctypes.byref(error)
        )
        check(status, error)
        return extinction, emission


def _numbers(values: ArrayLike, name: str) -> NDArray[np.float64]:
    try:
        return np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise LeapRayError(f"{name} of a transfer function must be numbers") from None


def _column(values: ArrayLike, name: str, n: int | None) -> NDArray[np.float64]:
    array = np.atleast_1d(_numbers(values, name))
    if array.ndim != 1 or n not in (None, len(array)):
        wanted = "(n,)" if n is None else f"({n},)"
        raise LeapRayError(f"{name} must have the shape {wanted}; it is {array.shape}")
    array.flags.writeable = False
    return array


def _triples(values: ArrayLike, name: str, n: int) -> NDArray[np.float64]:
    array = _numbers(values, name)
    if array.shape not in ((n, 3), (3,)):
        raise LeapRayError(f"{name} must have the shape ({n}, 3) or (3,); it is {array.shape}")
    array = np.ascontiguousarray(np.broadcast_to(array, (n, 3)))
    array.flags.writeable = False
    return array
