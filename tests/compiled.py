# SPDX-License-Identifier: GPL-3.0-or-later
"""Files of the core together with C of the tests, as a library: for what no public function leads
to."""

from __future__ import annotations

import ctypes
import subprocess
from collections.abc import Iterable
from pathlib import Path

import build_core

ROOT = Path(__file__).resolve().parent.parent
FLAGS = ("-std=c17", "-O2", "-fPIC", "-shared", "-ffp-contract=off", "-fno-math-errno")


def library(folder: Path, own: str, core: Iterable[str]) -> ctypes.CDLL:
    """Of tests/c/OWN.c and native/src/NAME.c for each name of `core`, made in a folder."""
    compiled = folder / f"{own}.so"
    sources = [ROOT / "native" / "src" / f"{name}.c" for name in core]
    sources.append(ROOT / "tests" / "c" / f"{own}.c")
    folders = [f"-I{ROOT / 'native' / part}" for part in ("include", "src")]
    command = [*build_core.compiler()[0], *build_core.TARGET, *FLAGS, *folders]
    subprocess.run([*command, *map(str, sources), "-lm", "-o", str(compiled)], check=True)
    return ctypes.CDLL(str(compiled))
