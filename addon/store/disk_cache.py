# SPDX-License-Identifier: GPL-3.0-or-later
"""A folder of volumes and of measurements on them, kept from render to render (no bpy).

A file's name is a digest of all inputs of its contents, this version included, so files
are never out of date; they may be deleted at any time. A volume is a .vdb: its grid is
the occupancy, for Blender and other programs. Behind the grid, where OpenVDB does not
read, lies the whole volume as the core serializes it (a grid cannot hold triangles of
cells, colours, normals, second objects), then a line of JSON and a seal: its length and
a hash. Only what the seal covers is read back, and not by OpenVDB, which does not check
its files: files that are truncated, damaged or misplaced are made anew.

Any number of processes may share the folder: files are written under a temporary name
and renamed. If the folder cannot be written, nothing is kept, and a warning says so.
"""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import json
import struct
import time
import typing
import zlib
from collections.abc import Hashable
from pathlib import Path
from typing import Any

import numpy as np

import leapray
from leapray._abi import LR_ABI

from . import volume_files

FORMAT = 1  # raised whenever the contents or their meaning change
SEAL = struct.Struct("<8sQ32s")  # magic, bytes of the head and what follows it, their hash
MAGIC = b"LEAPRAY\n"
FORGOTTEN = 86400.0  # seconds after which temporary files of killed processes are removed
SCALARS = {float: (float, int), int: (int,), str: (str,), bool: (bool,)}
ARRAYS = {"<f4", "|b1"}  # what records hold

WRONG = (ValueError, KeyError, TypeError, OverflowError, zlib.error)  # what bytes may raise

T = typing.TypeVar("T")


class DiskCache:
    """The folder; "": none, so that nothing is read or written."""

    def __init__(self, folder: str) -> None:
        self.folder = folder
        self.trouble = ""  # why it cannot be written, as a sentence
        self._ready = False

    def path(self, key: Hashable, suffix: str = ".vdb") -> Path:
        """The path of the file for that key."""
        return Path(self.folder) / f"{_name(key)}{suffix}"

    # -- volumes

    def volume(
        self, key: Hashable, max_nbytes: int, watch: leapray.Watch | None = None
    ) -> leapray.Volume | None:
        """The volume, the same to the bit, or None.

        Raises OutOfMemory, as voxelize, where it is larger than that; Stopped.
        """
        found = self._read(key, ".vdb")
        if found is None:
            return None
        head, packed = found
        try:
            nbytes, told = int(head["nbytes"]), int(head["packed"])
            if max(nbytes, told) > max_nbytes:
                error = leapray.OutOfMemory("the level's volume is larger than its room")
                error.nbytes = nbytes
                raise error
            mesh_info = head["mesh"] and _made(leapray.MeshInfo, head["mesh"])
            volume = leapray.Volume.unpack(_inflated(packed, told), watch=watch)
        except (leapray.Stopped, leapray.OutOfMemory):
            raise
        except (leapray.LeapRayError, *WRONG):
            self._remove(key, ".vdb")
            return None
        volume.mesh_info = mesh_info
        return volume

    def keep_volume(
        self, key: Hashable, volume: leapray.Volume, watch: leapray.Watch | None = None
    ) -> None:
        """Put the volume there, unless it is there already. Raises Stopped."""
        path = self.path(key)
        if not self._open() or path.exists():
            return
        packed = volume.pack(watch=watch)
        head = {
            "nbytes": volume.info.nbytes,
            "packed": packed.size,
            "mesh": volume.mesh_info and dataclasses.asdict(volume.mesh_info),
        }
        data = zlib.compress(packed.data, 1)
        try:
            volume_files.write(volume, path, behind=_sealed(key, head, data))
        except leapray.LeapRayError as error:
            self._give_up(error)

    # -- records

    def record(self, key: Hashable, kind: type[T]) -> T | None:
        """The dataclass of that kind, or None."""
        found = self._read(key, ".measure")
        if found is None:
            return None
        try:
            return _record(*found, kind)
        except WRONG:
            self._remove(key, ".measure")
            return None

    def keep_record(self, key: Hashable, value: Any) -> None:
        """Put a dataclass of numbers, strings and arrays of float32 or bool there."""
        if not self._open():
            return
        fields = {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
        arrays = {n: x for n, x in fields.items() if isinstance(x, np.ndarray)}
        head = {
            "values": {n: x for n, x in fields.items() if n not in arrays},
            "arrays": {n: [x.dtype.str, x.shape] for n, x in arrays.items()},
        }
        data = zlib.compress(b"".join(x.tobytes() for x in arrays.values()), 1)
        try:
            volume_files.write_bytes(self.path(key, ".measure"), _sealed(key, head, data))
        except leapray.LeapRayError as error:
            self._give_up(error)

    # -- the folder

    def _read(self, key: Hashable, suffix: str) -> tuple[dict, bytes] | None:
        """The head and what follows it, if the seal is valid."""
        if not self.folder:
            return None
        try:
            with open(self.path(key, suffix), "rb") as file:
                size = file.seek(0, 2)
                file.seek(max(size - SEAL.size, 0))
                seal = file.read()
                magic, length, digest = SEAL.unpack(seal) if len(seal) == SEAL.size else (0, 0, 0)
                whole = magic == MAGIC and length <= size - SEAL.size
                file.seek(size - SEAL.size - length if whole else size)
                told = file.read(length if whole else 0)
        except OSError:
            return None
        if whole and _hash(told) == digest:
            line, _, data = told.partition(b"\n")
            try:
                head = json.loads(line)
                if head["name"] == _name(key):
                    return head, data
            except (ValueError, KeyError, TypeError):
                pass
        self._remove(key, suffix)
        return None

    def _remove(self, key: Hashable, suffix: str) -> None:
        """Remove a file, so that it is made anew; one that cannot be removed stays unread."""
        with contextlib.suppress(OSError):
            self.path(key, suffix).unlink(missing_ok=True)

    def _open(self) -> bool:
        """Whether files can be written there, as far as is known."""
        if not self.folder or self.trouble:
            return False
        if not self._ready:
            try:
                folder = Path(self.folder)
                folder.mkdir(parents=True, exist_ok=True)
                for left in folder.glob(".*.partial"):
                    with contextlib.suppress(FileNotFoundError):  # another render has ended it
                        if time.time() - left.stat().st_mtime > FORGOTTEN:
                            left.unlink()
            except OSError as error:
                self._give_up(error)
                return False
            self._ready = True
        return True

    def _give_up(self, error: Exception) -> None:
        self.trouble = f"Volumes are not kept in {self.folder}: {error}."


# ---- files ---------------------------------------------------------------------


def _name(key: Hashable) -> str:
    told = repr((leapray.__version__, LR_ABI, FORMAT, key)).encode()
    return hashlib.blake2b(told, digest_size=16).hexdigest()


def _hash(data: bytes) -> bytes:
    return hashlib.blake2b(data, digest_size=32).digest()


def _sealed(key: Hashable, head: dict, data: bytes) -> bytes:
    told = json.dumps({"name": _name(key), **head}).encode() + b"\n" + data
    return told + SEAL.pack(MAGIC, len(told), _hash(told))


def _inflated(data: bytes, nbytes: int) -> bytes:
    """Raises ValueError where it is not just so many bytes."""
    inflated = zlib.decompressobj().decompress(data, max(nbytes, 0) + 1)
    if len(inflated) != nbytes:
        raise ValueError("another length than told")
    return inflated


def _record(head: dict, data: bytes, kind: type[T]) -> T:
    """Raises ValueError, KeyError, TypeError for anything but such a dataclass."""
    values, arrays = dict(head["values"]), dict(head["arrays"])
    sizes = {}
    for name, (dtype, shape) in arrays.items():
        if dtype not in ARRAYS or any(type(n) is not int or n < 0 for n in shape):
            raise ValueError(f"{name} is no such array")
        sizes[name] = np.dtype(dtype).itemsize * int(np.prod(shape, dtype=object))
    data = _inflated(data, sum(sizes.values()))
    at = 0
    for name, (dtype, shape) in arrays.items():
        array = np.frombuffer(data, dtype, sizes[name] // np.dtype(dtype).itemsize, at)
        values[name] = array.reshape(shape)
        at += sizes[name]
    return _made(kind, values)


def _made(kind: type[T], values: dict) -> T:
    """A dataclass of its members. Raises ValueError where they are others, or of other types."""
    hints = typing.get_type_hints(kind)
    if set(values) != set(hints):
        raise ValueError("other members")
    for name, value in values.items():
        types = SCALARS.get(hints[name])
        if types and type(value) not in types:
            raise ValueError(f"{name} is of another type")
    return kind(**{n: tuple(x) if isinstance(x, list) else x for n, x in values.items()})
