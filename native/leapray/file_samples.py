# SPDX-License-Identifier: GPL-3.0-or-later
"""Samples that stay in a file, of which slices are read when they are asked for.

Files are read, not mapped: a mapped file that another program cuts short would end the process by
a signal, where a short read is a sentence; and what is read again comes from the system's cache of
files, as fast. What a packed file holds goes into a temporary file without a name, so that it is
unpacked once and takes none of the process's memory.
"""

from __future__ import annotations

import os
import tempfile
import weakref
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import as_strided
from numpy.typing import NDArray

from ._lib import LeapRayError, OutOfMemory
from .arrays import empty

SMALL = 1 << 24  # bytes, up to which samples are an array in memory
LARGEST_FOLDER = Path("/var/tmp")  # for temporary files too large for memory, which /tmp may be
# Source: systemd, "Using /tmp/ and /var/tmp/ safely".


class _File:
    """An open file, which is closed when nobody has it any more.

    name: for messages. kept: nobody else changes it.
    """

    def __init__(self, fd: int, name: str, kept: bool = False) -> None:
        self.fd, self.name = fd, name
        weakref.finalize(self, os.close, fd)
        self._state = None if kept else self._now()

    @property
    def size(self) -> int | None:
        """Bytes that it had when it was opened; None where it is the process's own."""
        return self._state and self._state[1]

    def _now(self) -> tuple[int, int]:
        now = os.fstat(self.fd)
        return now.st_mtime_ns, now.st_size

    def read(self, offset: int, nbytes: int, room: NDArray | None = None) -> NDArray[np.uint8]:
        """Bytes, in room if there is enough.

        Raises LeapRayError where the file has changed since it was opened.
        """
        fits = room is not None and room.nbytes >= nbytes
        out = room[:nbytes] if room is not None and fits else empty((nbytes,), np.uint8)
        view, done = out.data, 0
        try:
            while done < nbytes:
                n = os.preadv(self.fd, [view[done:]], offset + done)
                if n == 0:
                    break
                done += n
            changed = self._state is not None and self._now() != self._state
        except OSError as error:
            raise LeapRayError(f"{self.name} cannot be read: {error.strerror}") from None
        if done < nbytes or changed:
            raise LeapRayError(f"{self.name} has changed since its reading began")
        return out

    def write(self, offset: int, data: NDArray) -> None:
        """Raises OutOfMemory where the disk is full."""
        view, done = data.reshape(-1).view(np.uint8).data, 0
        try:
            while done < len(view):
                done += os.pwrite(self.fd, view[done:], offset + done)
        except OSError as error:
            raise OutOfMemory(
                f"no room for unpacked samples in {self.name}: {error.strerror}; the environment "
                "variable TMPDIR may name another folder"
            ) from None


class FileSamples:
    """Numbers in a file as an array of that shape, read by slices of its first axis.

    `samples[first:last]` is an array of its own, in the machine's byte order; `numpy.asarray`
    reads all. dtype: as they are stored. offset: bytes before the first. strides: bytes from one
    number to the next along each axis, none below 0, the first the greatest; as for an array in C
    order without.
    Raises LeapRayError for a file that cannot be opened, and, when it is read, for one that
    has changed since; OutOfMemory.
    Attributes: shape, ndim, size, dtype in the machine's byte order, nbytes that the numbers take
    in the file.
    """

    def __init__(
        self,
        file: str | os.PathLike[str] | _File,
        dtype: np.dtype,
        shape: Sequence[int],
        offset: int = 0,
        strides: Sequence[int] | None = None,
    ) -> None:
        self._stored = np.dtype(dtype)
        self.dtype = self._stored.newbyteorder("=")
        self.shape = tuple(int(n) for n in shape)
        self.ndim, self.size = len(self.shape), int(np.prod(self.shape, dtype=np.int64))
        self.nbytes = self.size * self.dtype.itemsize
        steps = self.dtype.itemsize * np.cumprod([1, *self.shape[:0:-1]], dtype=np.int64)[::-1]
        self._strides = tuple(int(step) for step in (steps if strides is None else strides))
        self._offset = offset
        if not isinstance(file, _File):
            try:
                file = _File(os.open(file, os.O_RDONLY | os.O_CLOEXEC), str(file))
            except OSError as error:
                raise LeapRayError(f"{file} cannot be read: {error.strerror}") from None
        self._file = file
        if file.size is not None and file.size < offset + self._span(self.shape):
            raise LeapRayError(f"{file.name}: the file ends before its last sample")

    @property
    def unpacked_nbytes(self) -> int:
        """Bytes of a temporary file that these samples hold, 0 where the file is another's."""
        return self.nbytes if self._file.size is None else 0

    def _span(self, shape: tuple[int, ...]) -> int:
        """Bytes from the first to the end of the last number of some slices."""
        steps = zip(shape, self._strides, strict=True)
        return sum((n - 1) * step for n, step in steps) + self.dtype.itemsize

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, key: Any) -> NDArray:
        first, *rest = key if isinstance(key, tuple) else (key,)
        if isinstance(first, slice) and first.step in (None, 1):
            block = self.slices(*first.indices(len(self))[:2])
            return block[(slice(None), *rest)] if rest else block
        if isinstance(first, (int, np.integer)):
            at = range(len(self))[first]
            return self.slices(at, at + 1)[(0, *rest)]
        return self.slices(0, len(self))[key]

    def __array__(self, dtype=None, copy=None) -> NDArray:
        return self.slices(0, len(self)).astype(dtype or self.dtype, copy=False)

    def slices(self, first: int, last: int, room: NDArray[np.uint8] | None = None) -> NDArray:
        """`self[first:last]`, in room, bytes that are used again, if there is enough."""
        shape = (max(last - first, 0), *self.shape[1:])
        if 0 in shape:
            return np.empty(shape, self.dtype)
        start = self._offset + first * self._strides[0]
        numbers = self._file.read(start, self._span(shape), room).view(self._stored)
        block = np.ascontiguousarray(as_strided(numbers, shape, self._strides))
        return block if self._stored.isnative else block.byteswap(inplace=True).view(self.dtype)


Samples = NDArray | FileSamples


def unmapped(array: NDArray) -> Samples:
    """The numbers of a view of a numpy.memmap, of which nothing is touched, to be read instead.

    Few of them, and such as lie across slices, are read at once. Other arrays stay.
    """
    root = array
    while isinstance(root.base, np.ndarray):
        root = root.base
    if not isinstance(root, np.memmap) or array.size == 0:
        return array
    offset = root.offset + array.ctypes.data - root.ctypes.data
    made = FileSamples(str(root.filename), array.dtype, array.shape, offset, array.strides)
    across = array.strides[0] < max(array.strides)
    return made[:] if made.nbytes <= SMALL or across else made


class Spool:
    """Room for numbers that are written by slices of the first axis, side by side, then read.

    `spool[first:last] = block`; then `samples()` is what has been written: an array, or if larger
    than SMALL a temporary file. dtype: in the machine's byte order.
    Raises LeapRayError for sides that are none, OutOfMemory where there is no room.
    """

    def __init__(self, shape: Sequence[int], dtype: np.dtype) -> None:
        self.shape, self.dtype = tuple(int(n) for n in shape), np.dtype(dtype)
        self.nbytes = int(np.prod(self.shape, dtype=np.int64)) * self.dtype.itemsize
        self._file: _File | None = None
        if self.nbytes <= SMALL:
            self._array = empty(self.shape, self.dtype)
        else:
            folder = _folder()
            try:
                fd, path = tempfile.mkstemp(prefix="leapray-", dir=folder)
                os.unlink(path)
            except OSError as error:
                raise OutOfMemory(
                    f"no room for unpacked samples in {folder}: {error.strerror}"
                ) from None
            self._file = _File(fd, folder, kept=True)

    def __setitem__(self, where: slice, block: NDArray) -> None:
        if self._file is None:
            self._array[where] = block
            return
        first, last, _ = where.indices(self.shape[0])
        whole = np.broadcast_to(block, (last - first, *self.shape[1:]))
        per_slice = self.nbytes // self.shape[0]
        self._file.write(first * per_slice, np.ascontiguousarray(whole, self.dtype))

    def samples(self, n: int | None = None) -> Samples:
        """What has been written; n: so many slices of it."""
        n = self.shape[0] if n is None else n
        if self._file is None:
            return self._array[:n]
        return FileSamples(self._file, self.dtype, (n, *self.shape[1:]))


def spooled(array: NDArray) -> Samples:
    """The same numbers, in a temporary file if they are many. Raises OutOfMemory."""
    if array.nbytes <= SMALL:
        return array
    spool = Spool(array.shape, array.dtype)
    rows = max(1, SMALL // (array.nbytes // len(array)))
    for first in range(0, len(array), rows):
        spool[first : first + rows] = array[first : first + rows]
    return spool.samples()


def _folder() -> str:
    """Where large temporary files go: as TMPDIR says, else where they are not in memory."""
    large = LARGEST_FOLDER
    usable = "TMPDIR" not in os.environ and large.is_dir() and os.access(large, os.W_OK)
    return str(large) if usable else tempfile.gettempdir()
