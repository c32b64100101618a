# SPDX-License-Identifier: GPL-3.0-or-later
"""Scalar grids that were read, kept for the next frame and the next render (no bpy).

A grid is the file's as long as none of the files that it was read from has another size or time.
What it takes is little: samples that are many stay in files. The least recently used go first.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import leapray
from leapray import LeapRayError, ScalarGrid

from .. import arrays

HELD_SHARE = 1 / 16  # of the memory budget, for grids that are not in files

Key = tuple[str, str | None, int]
State = tuple[tuple[str, int, int], ...]


@dataclass
class _Entry:
    grid: ScalarGrid
    state: State
    contents: str


def _state(path: Path, more: tuple[str, ...] = ()) -> State:
    """Of files: their times and sizes; of those that are gone 0."""
    found = []
    for name in (str(path), *more):
        try:
            told = os.stat(name)
        except OSError:
            found.append((name, 0, 0))
        else:
            found.append((name, told.st_mtime_ns, told.st_size))
    return tuple(found)


class Grids:
    """Grids by the file, the grid and the frame that were asked for."""

    def __init__(self) -> None:
        self._entries: dict[Key, _Entry] = {}

    def read(
        self, path: Path, grid: str | None, frame: int, watch: leapray.Watch
    ) -> tuple[ScalarGrid, str]:
        """A grid of a file, read if it is not known, and a name for its contents.

        Raises LeapRayError where `read_volume` does, and where the file changes meanwhile.
        """
        if not path.exists():
            raise LeapRayError(f"there is no file {path}")
        key = str(path), grid, frame
        entry = self._entries.pop(key, None)
        if entry is None or entry.state != _state(path, entry.grid.files):
            before = _state(path)
            made = leapray.read_volume(path, grid=grid, frame=frame or None, watch=watch)
            state = _state(path, made.files)
            if state[:1] != before:
                raise LeapRayError(f"{path} changed while it was read")
            contents = arrays.digest((), repr((key, state)).encode())
            entry = _Entry(made, state, contents)
        self._entries[key] = entry  # as the youngest
        return entry.grid, entry.contents

    def trim(self, budget: float) -> None:
        """Drop the oldest, until those in memory take a small share of so many bytes, and
        those in temporary files no more; the last one stays."""
        grids = [entry.grid for entry in self._entries.values()]
        held = sum(grid.nbytes for grid in grids)
        unpacked = sum(grid.unpacked_nbytes for grid in grids)
        for key in list(self._entries)[:-1]:
            if held <= HELD_SHARE * budget and unpacked <= budget:
                break
            grid = self._entries.pop(key).grid
            held, unpacked = held - grid.nbytes, unpacked - grid.unpacked_nbytes

    def clear(self) -> None:
        self._entries.clear()

    def __len__(self) -> int:
        return len(self._entries)
