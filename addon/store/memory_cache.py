# SPDX-License-Identifier: GPL-3.0-or-later
"""Values that frames share: volumes by their contents, and measurements on them (no bpy).

The least recently used volumes are dropped first when the budget needs their memory.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass
class _Entry:
    value: Any
    nbytes: int  # 0: not counted
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

    def put(self, key: tuple, value: Any, nbytes: int = 0, unused: bool = False) -> Any:
        """Keep the value, and return it. nbytes: what it takes, where that is much.

        unused: this frame does not use it, so it is dropped first.
        """
        self._entries[key] = _Entry(value, nbytes, self._frame - unused)
        return value

    def drop(self, key: tuple) -> None:
        self._entries.pop(key, None)

    def unused(self) -> int:
        """Bytes of the values that this frame has not used."""
        return sum(e.nbytes for e in self._entries.values() if e.frame < self._frame)

    def trim(self, room: int) -> None:
        """Drop the oldest values that this frame has not used, until these take `room` bytes."""
        excess = self.unused() - max(room, 0)
        for key, entry in list(self._entries.items()):
            if excess <= 0:
                break
            if entry.nbytes and entry.frame < self._frame:
                del self._entries[key]
                excess -= entry.nbytes

    def end(self) -> None:
        """Drop measurements on meshes that neither this frame nor a kept volume uses."""
        alive = {
            _contents(key)
            for key, entry in self._entries.items()
            if entry.nbytes or entry.frame == self._frame
        }
        for key in [k for k in self._entries if _contents(k) not in alive]:
            del self._entries[key]

    def keep(self, *kinds: str, used: bool = False) -> None:
        """Drop all values but those of some kinds, the first words of their keys, and of these,
        if asked, what this frame has not used."""
        self._entries = {
            key: entry
            for key, entry in self._entries.items()
            if key[0] in kinds and (entry.frame == self._frame or not used)
        }

    def clear(self) -> None:
        self._entries.clear()

    def __len__(self) -> int:
        return len(self._entries)


def _contents(key: tuple) -> str:
    """Of the whole mesh: parts of it are told by what follows a slash."""
    return key[1].partition("/")[0]
