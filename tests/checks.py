# SPDX-License-Identifier: GPL-3.0-or-later
"""The project's checks, which `build.py test` hands over to.

nothing, or --quick                all tests; --quick leaves out what is marked slow
--sanitize address [PYTEST ...]    tests/core under AddressSanitizer and its kin
--sanitize thread [PYTEST ...]     what has threads, under ThreadSanitizer
--portable [PYTEST ...]            the same without vector instructions, or other tests; for ARM,
                                   too, it is compiled
--analyze [FILE.c ...]             gcc's analyser over native/src
--coverage [PYTEST ...]            tests/core, or other tests; then which lines and branches of
                                   native/src they reach
--fuzz [MINUTES]                   each fuzz target that long
anything else                      goes to pytest
"""

from __future__ import annotations

import os
import subprocess
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
MEMORY = ("attributes", "calls", "clips", "cubic", "discrete", "distance", "images", "islands",
          "isosurface", "labels", "leaping", "merge", "pixel_skip", "programs", "rectilinear",
          "render_edges", "serialize", "templates", "trace_lanes", "volume",
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


def whole(quick: str) -> int:
    """All tests: in several processes at first, then alone what measures time or shows windows."""
    processes = str(min(os.cpu_count() or 1, 4))
    by_file = ["--dist", "loadfile", "--no-loadscope-reorder"]
    beside = ["-n", processes, *by_file, "-m", f"not alone{quick}"]
    codes = [
        subprocess.run([sys.executable, "-m", "pytest", *options], check=False).returncode
        for options in (beside, ["-m", f"alone{quick}"])
    ]
    return max(codes)


def coverage(words: list[str]) -> int:
    """Run tests over a core that counts what they reach; tables of it lie in its folder."""
    folder = build_core.OBJECTS / "coverage"
    for counts in folder.rglob("*.gcda"):
        counts.unlink()
    code = pytest("coverage", words or [*QUICK, "tests/core"])
    places = ["--root", str(build_core.NATIVE), "--filter", "src/", str(folder)]
    tables = ["--txt", "--print-summary", "--html-details", str(folder / "coverage.html")]
    report = [
        "-m",
        "gcovr",
        "--gcov-suspicious-hits-threshold=0",  # a number may be large
        "--merge-mode-functions=separate",  # templates are several functions on a line
        *places,
        *tables,
        "--txt-metric",
        "branch",
        "--sort",
        "uncovered-number",
    ]
    done = subprocess.run([sys.executable, *report], cwd=build_core.NATIVE, check=False)
    return code or done.returncode


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
    if not asked or (asked == "--quick" and not words):
        return whole(" and not slow" if asked else "")
    if asked == "--coverage":
        return coverage(words)
    if asked == "--fuzz":
        return script("tests/fuzz/run.py", "all", "--sanitize", "--minutes", *(words or ["1"]))
    if asked == "--sanitize":
        print(__doc__)
        return 2
    words = [asked, *words]
    quick = QUICK if "--quick" in words else []
    return script("-m", "pytest", *quick, *(word for word in words if word != "--quick"))


if __name__ == "__main__":
    os.chdir(ROOT)
    try:
        code = check("".join(sys.argv[1:2]), sys.argv[2:])
    except build_core.BuildError as error:
        print(f"build.py: {error}", file=sys.stderr)
        code = 1
    sys.exit(code)
