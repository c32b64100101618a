# SPDX-License-Identifier: GPL-3.0-or-later
"""How much memory the process has taken since a render began, as the system measures it (no bpy).

Linux keeps two numbers of a process: how much of it is resident now, and the most that ever
was. Where the latter has risen since the beginning, it is the peak; elsewhere, after a larger
render, the former is sampled while the render goes on. Nothing of the process is changed, so
that others can measure it, too. Other systems tell nothing: there the peak is 0.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

KB = 1024
STATUS = Path("/proc/self/status")
STATM = Path("/proc/self/statm")


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
