# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes generated pages and pictures, or tells which are not current."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A table in Markdown."""
    names = list(head)
    line = "|---" * len(names) + "|"
    first, *rest = (" ".join(["|", *" | ".join(cells).split(), "|"]) for cells in (names, *rows))
    return "\n".join([first, line, *rest])


def write(outputs: dict[Path, str], script: str) -> int:
    """Write the files, or with --check only name those that differ; returns the exit code."""
    old = []
    for path, made in outputs.items():
        if "--check" not in sys.argv[1:]:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(made, encoding="utf-8")
        elif not path.exists() or path.read_text("utf-8") != made:
            old.append(path.name)
    if old:
        print(f"not current: {', '.join(old)}; run {script}", file=sys.stderr)
    return int(bool(old))
