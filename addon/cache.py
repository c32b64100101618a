# SPDX-License-Identifier: GPL-3.0-or-later
"""What frames share: volumes by their contents, and what was measured on them (no bpy).

In memory the least recently used volumes go first when the budget needs their
room. In a folder, where the user gives one, every volume is a .vdb under a name
made of its contents and of all that shaped it, so that nothing there is ever
out of date; what cannot be read is made anew.
"""

from __future__ import annotations

import hashlib
from collections.abc import Hashable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import leapray

from . import volumes


@dataclass
class _Entry:
    value: Any
    nbytes: int  # 0: too little to be counted
    frame: int  # that used it last


class Cache:
    """Values by keys (what, contents of the mesh, ...), the least recently used first."""

    def __init__(self) -> None:
        self._entries: dict[tuple, _Entry] = {}
        self._frame = 0

    def begin(self) -> None:
        """A new frame: nothing is used yet."""
        self._frame += 1

    def get(self, key: tuple) -> Any:
        """The value, which this frame now uses, or None."""
        entry = self._entries.pop(key, None)
        if entry is None:
            return None
        entry.frame = self._frame
        self._entries[key] = entry  # as the youngest
        return entry.value

    def peek(self, key: tuple) -> Any:
        """The value, or None; it grows no younger by it."""
        entry = self._entries.get(key)
        return entry and entry.value

    def put(self, key: tuple, value: Any, nbytes: int = 0) -> Any:
        """Keep the value, and return it. nbytes: what it takes, where that is much."""
        self._entries[key] = _Entry(value, nbytes, self._frame)
        return value

    def drop(self, key: tuple) -> None:
        self._entries.pop(key, None)

    def unused(self) -> int:
        """Bytes of what this frame has not used."""
        return sum(e.nbytes for e in self._entries.values() if e.frame < self._frame)

    def trim(self, room: int) -> None:
        """Drop the oldest of what this frame has not used, until that takes no more than room."""
        excess = self.unused() - max(room, 0)
        for key, entry in list(self._entries.items()):
            if excess <= 0:
                break
            if entry.nbytes and entry.frame < self._frame:
                del self._entries[key]
                excess -= entry.nbytes

    def end(self) -> None:
        """Drop what was measured on meshes of which neither this frame nor a volume is left."""
        alive = {
            _contents(key)
            for key, entry in self._entries.items()
            if entry.nbytes or entry.frame == self._frame
        }
        for key in [k for k in self._entries if _contents(k) not in alive]:
            del self._entries[key]

    def clear(self) -> None:
        self._entries.clear()

    def __len__(self) -> int:
        return len(self._entries)


def _contents(key: tuple) -> str:
    """Of the whole mesh: parts of it are told by what follows a slash."""
    return key[1].partition("/")[0]


# ---- on disk -------------------------------------------------------------------


def path(folder: str, key: Hashable) -> Path:
    """Where a volume lies: its name tells everything that shaped it, this version included."""
    name = repr((leapray.__version__, key)).encode()
    return Path(folder) / f"{hashlib.blake2b(name, digest_size=16).hexdigest()}.vdb"


def load(folder: str, key: Hashable) -> leapray.Volume | None:
    """The volume from the folder, or None where it is not or cannot be read."""
    place = path(folder, key)
    if not place.is_file():
        return None
    try:
        return volumes.read(place)
    except leapray.LeapRayError:
        return None


def store(folder: str, key: Hashable, volume: leapray.Volume) -> str:
    """Write the volume into the folder, which is made where it is not; why that failed, or ""."""
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
        volumes.write(volume, path(folder, key))
    except OSError as error:
        return f"The folder for volumes cannot be made: {error}."
    except leapray.LeapRayError as error:
        return f"A volume is not kept on disk: {error}."
    return ""
