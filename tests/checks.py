# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks of the core that compile or read it in other ways: `build.py test` hands over to this.

--sanitize address [PYTEST ...]    tests/core under AddressSanitizer and its kin
--sanitize thread [PYTEST ...]     what has threads, under ThreadSanitizer
--portable [PYTEST ...]            the same without vector instructions, or other tests; for ARM,
                                   too, it is compiled
--analyze [FILE.c ...]             gcc's analyser over native/src
--fuzz [MINUTES]                   each fuzz target that long
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

import build_core
import build_variants

ROOT = Path(__file__).resolve().parent.parent


def files(names: tuple[str, ...]) -> list[str]:
    return [f"tests/core/test_{name}.py" for name in names]


QUICK = ["-m", "not slow"]
# What reaches every module in a few minutes: the rest repeats it with more rays and triangles.
# Flipped bytes are what a fuzz target tries, and tests of 100 ms are for a core at full speed.
MEMORY = ("attributes", "calls", "distance", "first_cells", "islands", "merge", "programs",
          "rectilinear", "render_edges", "serialize", "trace_lanes", "volume",
          "voxelize_sign")  # fmt: skip
THREADS = ("interrupts", "stop", "voxelize_runs", "render_core", "voxelize_sign")
THREADED = "(thread or interrupt or stop or progress) and not 100_m"
SANITIZED = {
    "address": [*files(MEMORY), "-k", "not 100_m and not flipped"],
    "thread": [*files(THREADS), "-k", THREADED],
}
PORTABLE = files(("distance", "lights", "merge", "render_core", "serialize", "trace", "volume"))


def pytest(variant: str, words: list[str]) -> int:
    """Run tests of the core over a variant of it."""
    return build_variants.run(variant, ["-m", "pytest", "-p", "no:cacheprovider", *words])


def script(*words: str) -> int:
    """Run a script of this project, which takes this process's place."""
    os.execv(sys.executable, [sys.executable, *words])


def check(asked: str, words: list[str]) -> int:
    if asked == "--sanitize" and words[:1] and words[0] in SANITIZED:
        return pytest(words[0], [*QUICK, *SANITIZED[words[0]], *words[1:]])
    if asked == "--portable":
        build_variants.compile_all("aarch64")
        return pytest("portable", [*QUICK, *(words or PORTABLE)])
    if asked == "--analyze":
        return script("native/analyze.py", *words)
    if asked == "--fuzz":
        return script("tests/fuzz/run.py", "all", "--sanitize", "--minutes", *(words or ["1"]))
    print(__doc__)
    return 2


if __name__ == "__main__":
    os.chdir(ROOT)
    try:
        code = check("".join(sys.argv[1:2]), sys.argv[2:])
    except build_core.BuildError as error:
        print(f"build.py: {error}", file=sys.stderr)
        code = 1
    sys.exit(code)
