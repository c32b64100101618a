# SPDX-License-Identifier: GPL-3.0-or-later
"""What the readers of all formats share: requests, libraries, errors and stored numbers."""

from __future__ import annotations

import importlib
import logging
import math
import struct
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._lib import LeapRayError, OutOfMemory, Stopped, Watch
from ..file_samples import Samples, Spool, spooled, unmapped
from ..scalar_grid import ScalarGrid

UNPACKED = 1 << 22  # bytes that are unpacked at a time
HEAD = 512  # bytes at a file's start by which formats know their own
LOGGERS = ("nibabel.global", "nrrd", "pydicom", "tifffile")
STUMBLES = (ValueError, LookupError, TypeError, AttributeError, ArithmeticError, struct.error)
RAS_FROM_LPS = np.diag([-1.0, -1.0, 1.0, 1.0])


@dataclass(frozen=True)
class RawLayout:
    """How the numbers lie in a file that does not say it: x fastest, z slowest.

    size: samples along x, y and z. dtype: numpy's name, as "uint16". spacing: between samples,
    in units of `meters` metres (0: unknown). big_endian: the byte order. header: bytes before
    the first sample. frames: grids one after the other. The value of a sample is
    offset + scale * stored, a stored no_data means none.
    """

    size: tuple[int, int, int]
    dtype: str
    spacing: tuple[float, float, float] = (1.0, 1.0, 1.0)
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    big_endian: bool = False
    header: int = 0
    frames: int = 1
    scale: float = 1.0
    offset: float = 0.0
    meters: float = 0.0
    kind: str = "scalar"
    quantity: str = ""
    no_data: float | None = None


@dataclass(frozen=True)
class Request:
    """What is to be read: a file or folder, and which grid and frame of it; watch ends it."""

    path: Path
    grid: str | None = None
    frame: int | None = None
    layout: RawLayout | None = None
    watch: Watch = field(default_factory=Watch)

    def check_stopped(self, share: float = 0.0) -> None:
        """Raise Stopped if the watch says so; else tell it what share of the reading is done."""
        if self.watch.stopped:
            raise Stopped(f"the reading of {self.path} was stopped")
        self.watch.advance(share)


@dataclass(frozen=True)
class Format:
    """A file format. told_by: whether a file with these first bytes is sure to be one."""

    name: str
    suffixes: tuple[str, ...]
    read: Callable[[Request], ScalarGrid]
    grids: Callable[[Path], list[str]]
    told_by: Callable[[bytes], bool]


def library(module: str, package: str) -> ModuleType:
    """A library that is imported only once it is needed. Raises LeapRayError where it lacks."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise LeapRayError(
            f"this file needs the Python package {package}, which is not installed: {error}"
        ) from None


@contextmanager
def reading(path: Path, format_name: str) -> Iterator[list[str]]:
    """Turn whatever a library raises meanwhile into one sentence, and keep it from printing.

    Gives a list that what libraries log as errors is added to.
    """
    logged = _Logged()
    try:
        for name in LOGGERS:
            logging.getLogger(name).addFilter(logged)
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            yield logged.errors
    except LeapRayError:
        raise
    except MemoryError:
        raise OutOfMemory(
            f"there is no room in memory for the samples that {path} tells of"
        ) from None
    except Exception as error:  # whatever a broken file makes of a library
        raise LeapRayError(f"{path} cannot be read as {format_name}: {_reason(error)}") from None
    finally:
        for name in LOGGERS:
            logging.getLogger(name).removeFilter(logged)


class _Logged(logging.Filter):
    """Keeps what is logged as an error, and lets nothing be printed."""

    def __init__(self) -> None:
        super().__init__()
        self.errors: list[str] = []

    def filter(self, record: logging.LogRecord) -> bool:
        if record.levelno >= logging.ERROR:
            self.errors.append(record.getMessage())
        return False


def _reason(error: Exception) -> str:
    """What an exception says, on one line."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    said = lines[0][:200].rstrip(".") if lines else type(error).__name__
    if isinstance(error, KeyError) and " " not in said:
        return f"it lacks {said}"
    return f"it is broken ({said})" if isinstance(error, STUMBLES) else said


def refuse(path: Path, why: str) -> LeapRayError:
    """An error about a file, which begins with its name."""
    return LeapRayError(f"{path}: {why}")


def native(samples: NDArray) -> NDArray:
    """Samples in the machine's byte order and of a type that numpy can count with."""
    if samples.dtype.kind == "b":
        return samples.view(np.uint8)
    if samples.dtype.isnative:
        return samples
    return samples.astype(samples.dtype.newbyteorder("="))


def unpacked(request: Request, stream: Any, dtype: np.dtype, shape: Sequence[int]) -> Samples:
    """Numbers in C order from a stream of unpacked bytes, a few slices at a time."""
    spool = Spool(shape, dtype.newbyteorder("="))
    rows = max(1, UNPACKED // max(dtype.itemsize * math.prod(shape[1:]), 1))
    for first in range(0, shape[0], rows):
        request.check_stopped(first / shape[0])
        block = np.empty((min(rows, shape[0] - first), *shape[1:]), dtype)
        view, done = block.reshape(-1).view(np.uint8).data, 0
        while done < len(view):
            n = stream.readinto(view[done:])
            if not n:
                raise refuse(request.path, "the file ends before its last sample")
            done += n
        spool[first : first + len(block)] = native(block)
    return spool.samples()


def check_samples(path: Path, samples: Samples) -> Samples:
    """Samples in native order, (nz, ny, nx). Raises LeapRayError for what is no scalar field."""
    samples = unmapped(samples) if isinstance(samples, np.ndarray) else samples
    if samples.dtype.kind not in "biuf" or samples.dtype.itemsize > 8:
        raise refuse(path, f"samples of the type {samples.dtype} are no real numbers")
    if samples.ndim != 3 or samples.size == 0:
        raise refuse(path, f"{sides(samples.shape)} samples make no volume")
    return spooled(native(samples)) if isinstance(samples, np.ndarray) else samples


def check_matrix(path: Path, matrix: ArrayLike) -> NDArray[np.float64]:
    """world_from_index, (4, 4). Raises LeapRayError where it flattens the lattice."""
    array = np.array(matrix, np.float64)
    lengths = np.linalg.norm(array[:3, :3], axis=0)
    if not np.isfinite(array).all() or not (lengths > 0).all():
        raise refuse(path, f"samples {numbers(lengths)} apart cannot be placed")
    if abs(np.linalg.det(array[:3, :3] / lengths)) < 1e-6:  # axes within some 1e-6 of a plane
        raise refuse(path, "its axes lie in one plane")
    return array


def choose_frame(request: Request, n: int, told: list[str]) -> int:
    """The frame that is asked for of n, else the first, with a warning where there are more."""
    frame = request.frame
    if frame is None and n > 1:
        told.append(f"{request.path} has {n} frames, of which the first was read")
    if not 0 <= (frame or 0) < n:
        have = f"{n} frames, 0 to {n - 1}" if n > 1 else "one frame, 0"
        raise refuse(request.path, f"there is no frame {frame}; it has {have}")
    return frame or 0


def only_grid(request: Request, name: str) -> None:
    """Refuse another grid than the only one."""
    if request.grid not in (None, name):
        raise refuse(request.path, f"it has no grid {request.grid!r}; there is {name!r}")


def stem(path: Path) -> str:
    """A file's name without its suffixes."""
    return path.name.removesuffix(".gz").rpartition(".")[0] or path.name


def one_grid(path: Path) -> list[str]:
    """The names of the grids of a format that holds one: its file's name."""
    return [stem(path)]


def scaled(matrix: NDArray[np.float64], spacing: ArrayLike) -> NDArray[np.float64]:
    """A matrix after lengths of its axes, (3,)."""
    return matrix @ np.diag([*np.asarray(spacing, np.float64), 1.0])


def sides(shape: tuple[int, ...]) -> str:
    """A shape (nz, ny, nx) as x, y, z order reads."""
    return " x ".join(map(str, reversed(shape))) or "no"


def numbers(values: ArrayLike) -> str:
    """Numbers as a list in a sentence."""
    return ", ".join(f"{value:g}" for value in np.ravel(values))


def positive(value: object) -> float:
    """A number above 0, or 0 where it is none."""
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return 0.0
    return number if math.isfinite(number) and number > 0 else 0.0
