# SPDX-License-Identifier: GPL-3.0-or-later
"""How much memory a render takes, and how to take little (no bpy).

A mesh can have millions of triangles: what is computed of each is computed for some at a time.

What the process has taken since a render began is measured by the system. Linux keeps two
numbers of a process: how much of it is resident now, and the most that ever was. Where the
latter has risen since the beginning, it is the peak; elsewhere, after a larger render, the
former is sampled while the render goes on. Nothing of the process is changed, so that others
can measure it, too. Other systems tell nothing: there the peak is 0.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

KB = 1024
PIECE = 1 << 17  # triangles or edges: what is computed of so many takes some megabytes
STATUS = Path("/proc/self/status")
STATM = Path("/proc/self/statm")


def pieces(n: int) -> Iterator[slice]:
    """0..n - 1 in slices."""
    return (slice(first, min(first + PIECE, n)) for first in range(0, n, PIECE))


@dataclass(frozen=True)
class Resident:
    """Bytes of the process that are in memory, and the most that ever were; 0: unknown."""

    now: int = 0
    most: int = 0

    @classmethod
    def read(cls) -> Resident:
        try:
            lines = STATUS.read_text().splitlines()
        except OSError:
            return cls()
        found = dict(line.split(":", 1) for line in lines if ":" in line)
        now, most = (int(found.get(name, "0").split()[0]) * KB for name in ("VmRSS", "VmHWM"))
        return cls(now, most)


class Meter:
    """Growth of the process since it was begun, or since an earlier look at it."""

    def __init__(self, since: Resident | None = None) -> None:
        self.since = since if since is not None and since.now else Resident.read()
        self._sampled = self.since.now

    def sample(self) -> None:
        """Look at what is resident now: some microseconds."""
        try:
            pages = int(STATM.read_bytes().split()[1])
        except OSError:
            return
        self._sampled = max(self._sampled, pages * os.sysconf("SC_PAGE_SIZE"))

    def peak(self) -> int:
        """Bytes, the most so far."""
        now = Resident.read()
        most = now.most if now.most > self.since.most else max(self._sampled, now.now)
        return max(most - self.since.now, 0)
