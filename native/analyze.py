# SPDX-License-Identifier: GPL-3.0-or-later
"""Read the core by gcc's analyser and further warnings; findings beyond the known ones fail.

    python native/analyze.py [FILE.c ...]

KNOWN says of every finding that stays why it is none. A file is read again only when it,
a header of its own or the flags have changed.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import build_core
import build_variants

NATIVE = build_core.NATIVE
# The analyser follows all paths through a function. Those through a walk with its hit test, which
# are one function, do not end in minutes: the traversers are read for warnings alone.
# Its check of values that are not set takes a loop over three axes for one that may end after one.
ANALYSER = ("-fanalyzer", "-Wno-analyzer-use-of-uninitialized-value")
TOO_MANY_PATHS = "src/traversers/"
FAILURES = ("-include", str(NATIVE.parent / "tests" / "c" / "analysis.h"))
WITHOUT = ("src/base/error.c", "src/base/pages.c")  # what fails there is defined or not used
FOLDER = build_core.OBJECTS / "analysis"
FLAGS = (
    *(*build_variants.FLAGS, "-O1", "-fdiagnostics-format=json"),
    *("-Wall", "-Wextra", "-Wcast-align", "-Wpointer-arith", "-Wundef", "-Wlogical-op"),
    *("-Wduplicated-cond", "-Wnull-dereference", "-Wformat=2", "-Wwrite-strings"),
)

# (file, option, part of the message): why it is no fault.
NULL, LEAK, UNSET = "-Wanalyzer-null-dereference", "-Wanalyzer-malloc-leak", "-Wmaybe-uninitialized"
MAYBE_NULL = "-Wanalyzer-possible-null-dereference"
KNOWN: dict[tuple[str, str, str], str] = {
    (
        "src/base/base.h",
        NULL,
        "\u2018d\u2019",
    ): "only boxes, which need none, are asked without a direction",
    ("src/grid/surface_octree.c", LEAK, "unknown"): "every level is freed, in a loop",
    (
        "src/grid/serialize.c",
        "-Wanalyzer-null-argument",
        "non-null",
    ): "an array that is not there has no bytes",
    (
        "src/render/scene/scene.c",
        "-Wanalyzer-possible-null-argument",
        "\u2018to\u2019",
    ): "asked for before",
    ("src/traversers/frt.c", UNSET, "\u2018state."): "set at the start of every ray",
    ("src/voxelize/brick_jobs.c", LEAK, "malloc"): "the part owns it and frees it",
    ("src/voxelize/brick_jobs.c", MAYBE_NULL, "unknown"): "unite says whether it is there",
}


def read(unit: build_core.Unit) -> list[tuple[str, str, str, int]]:
    """(file, option, message, line) of each finding in a unit."""
    found = unit.object.with_suffix(".json")
    if not unit.current():
        unit.note.unlink(missing_ok=True)
        failures = () if unit.source in WITHOUT else FAILURES
        analyser = () if unit.source.startswith(TOO_MANY_PATHS) else ANALYSER
        outputs = ["-MMD", "-MF", str(unit.depends), "-c", unit.source, "-o", str(unit.object)]
        done = subprocess.run(
            [build_variants.GCC, *FLAGS, *analyser, *failures, *outputs],
            cwd=NATIVE,
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            raise build_core.BuildError(f"{unit.source} does not compile:\n{done.stderr}")
        found.write_text(done.stderr or "[]")
        unit.note.write_text(unit.key())
    return list(findings(found.read_text()))


def findings(text: str):
    for line in filter(None, text.splitlines()):
        for each in json.loads(line):
            at = each["locations"][0]["caret"]
            file = os.path.relpath(NATIVE / at["file"], NATIVE)
            yield file, each.get("option", each["kind"]), each["message"], at["line"]


def known(finding: tuple[str, str, str, int]) -> tuple[str, str, str] | None:
    file, option, message, _ = finding
    for entry in KNOWN:
        if entry[:2] == (file, option) and entry[2] in message:
            return entry
    return None


def main(names: list[str]) -> int:
    if not build_variants.available():
        print("analyze: the analyser is that of the system's gcc, and there is none")
        return 1
    sources = [Path(name).resolve() for name in names] or sorted((NATIVE / "src").rglob("*.c"))
    FOLDER.mkdir(parents=True, exist_ok=True)
    units = [build_core.Unit(source, " ".join((*FLAGS, *ANALYSER)), FOLDER) for source in sources]
    try:
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            found = {finding for each in pool.map(read, units) for finding in each}
    except build_core.BuildError as error:
        print(f"analyze: {error}", file=sys.stderr)
        return 1
    new = sorted(finding for finding in found if known(finding) is None)
    stale = [] if names else sorted(set(KNOWN) - {known(finding) for finding in found})
    for file, option, message, line in new:
        print(f"{file}:{line}: {message} [{option}]")
    for entry in stale:
        print(f"{entry[0]}: no longer found, take it from the list: {entry[2]} [{entry[1]}]")
    print(f"{len(units)} files: {len(new)} new findings, {len(found) - len(new)} known")
    return 1 if new or stale else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
