# SPDX-License-Identifier: GPL-3.0-or-later
"""numpy arrays on their way into C and back."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from enum import IntEnum
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _abi
from ._lib import LeapRayError, OutOfMemory

T = TypeVar("T")


def members(enum: type[IntEnum]) -> dict[str, IntEnum]:
    """An enum of leapray.h by the words that tell its members apart, in lower case."""
    words = [member.name.lower().split("_") for member in enum]
    common = next(k for k, column in enumerate(zip(*words, strict=False)) if len(set(column)) > 1)
    return {"_".join(name[common:]): member for name, member in zip(words, enum, strict=True)}


SAMPLE_TYPES = members(_abi.lr_sample_type)
DTYPES = {name: np.dtype(f"{name[0]}{int(name[1:]) // 8}") for name in SAMPLE_TYPES}
ONES = {  # the stored values of occupancy 1
    name: 1.0 if dtype.kind == "f" else float(np.iinfo(dtype).max) for name, dtype in DTYPES.items()
}
NORMALS = members(_abi.lr_normal)
INTERPOLATIONS = members(_abi.lr_volume_interpolation)


def about(choice: IntEnum) -> str:
    """What leapray.h says of a member of an enum."""
    return _abi.ABOUT.get(choice.name, "")


def record(struct: type[ctypes.Structure]) -> np.dtype:
    """A structure of leapray.h as numpy has it; pointers become integers."""
    names, types = zip(*struct._fields_, strict=True)
    return np.dtype(
        {
            "names": names,
            "formats": [np.uintp if hasattr(t, "contents") else np.dtype(t) for t in types],
            "offsets": [getattr(struct, name).offset for name in names],
            "itemsize": ctypes.sizeof(struct),
        }
    )


def pointer(array: NDArray | None, c_type=ctypes.c_double):
    """The C pointer to a contiguous array's data; None stays NULL."""
    return None if array is None else array.ctypes.data_as(ctypes.POINTER(c_type))


def bounds(points: NDArray) -> NDArray:
    """(2, k): the lowest and the highest coordinates of points (n, k), n above 0.

    Coordinate by coordinate, which numpy does thirty times as fast as all together.
    """
    return np.array([(points[:, k].min(), points[:, k].max()) for k in range(points.shape[1])]).T


def empty(shape: tuple[int, ...], dtype) -> NDArray:
    """An array to be filled. Raises OutOfMemory, LeapRayError for sides that are none."""
    if min(shape, default=0) < 0:
        raise LeapRayError(f"sides of an array must be 0 or more; they are {shape}")
    try:
        return np.empty(shape, dtype)
    except (MemoryError, ValueError, OverflowError) as error:  # as numpy says of too many bytes
        raise OutOfMemory(f"there is no room for an array of {shape}: {error}") from None


def numbers(values: ArrayLike, dtype, what: str) -> NDArray:
    """An array of that type, of numpy's or of ctypes'.

    Raises LeapRayError where a whole number is needed and does not fit, which ctypes and
    numpy 1 would wrap around.
    """
    dtype, array = np.dtype(dtype), np.asarray(values)
    if dtype.kind in "iu" and array.size:
        least, most = np.iinfo(dtype).min, np.iinfo(dtype).max
        whole = array.dtype.kind in "iub"
        if not (whole and array.min() >= least and array.max() <= most):
            came = f"{array.min()}..{array.max()}" if whole else f"{array.ravel()[:3].tolist()}"
            raise LeapRayError(f"{what} must be whole numbers in {least}..{most}; came {came}")
    return array.astype(dtype, copy=False)


def id_array(ids: ArrayLike | None, n: int, *, one: bool = False) -> NDArray[np.uint16] | None:
    """Ids as (n,), where wanted from one for all; None stays None. Raises LeapRayError."""
    if ids is None:
        return None
    array = np.asarray(ids)
    if array.shape not in ((n,), *([()] * one)) or array.dtype.kind not in "iu":
        wanted = f"{n} whole numbers" + ", or one" * one
        raise LeapRayError(f"ids must be {wanted}; they are {array.dtype} of shape {array.shape}")
    return np.ascontiguousarray(np.broadcast_to(numbers(array, np.uint16, "ids"), n))


def triple(values, c_type=ctypes.c_int32):
    """Three numbers as a C array. Raises LeapRayError where ctypes would wrap one around."""
    values = tuple(values)
    try:
        array = (c_type * 3)(*values)
    except (TypeError, IndexError):
        array = ()
    if tuple(array) != values:
        raise LeapRayError(f"three whole numbers of 32 bits are needed, not {values}")
    return array


def matrix(values: ArrayLike | None, name: str):
    """A 4x4 matrix as a row-major C array; None is the identity. Raises LeapRayError."""
    array = np.eye(4) if values is None else np.asarray(values, dtype=np.float64)
    if array.shape != (4, 4):
        raise LeapRayError(f"{name} must be a 4x4 matrix; its shape is {array.shape}")
    return (ctypes.c_double * 16)(*array.ravel())


def vectors(values: ArrayLike, name: str) -> NDArray[np.float64]:
    """(n, 3) vectors; one of shape (3,) is (1, 3). Raises LeapRayError."""
    array = np.asarray(values, dtype=np.float64)
    if array.ndim == 1 and array.size == 3:
        array = array[None]
    if array.ndim != 2 or array.shape[1] != 3:
        raise LeapRayError(f"{name} must have the shape (n, 3); it is {array.shape}")
    return array


def columns(values: ArrayLike, name: str) -> NDArray[np.float64]:
    """(n, 3) vectors as three contiguous rows (3, n). Raises LeapRayError."""
    return np.ascontiguousarray(vectors(values, name).T)


def per_ray(value: ArrayLike | None, n: int, name: str) -> NDArray[np.float64] | None:
    """A number for all rays or one each as (n,); None stays None. Raises LeapRayError."""
    if value is None:
        return None
    array = np.asarray(value, dtype=np.float64)
    if array.ndim > 1 or array.size not in (1, n):
        raise LeapRayError(f"{name} must be one number or {n}; its shape is {array.shape}")
    return np.ascontiguousarray(np.broadcast_to(array, (n,)))


def choice(names: Mapping[str, T], value: str, what: str) -> T:
    """What a name stands for. Raises LeapRayError that lists the names."""
    if value not in names:
        raise LeapRayError(f"unknown {what} {value!r}; there are {', '.join(names)}")
    return names[value]
