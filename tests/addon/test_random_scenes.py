# SPDX-License-Identifier: GPL-3.0-or-later
"""Whatever scene people make: no fault, no NaN, no hang, and the surfaces that Cycles sees.

`--random-scenes 500` takes as many instead of a few. A process renders them one after
the other; where it crashes or hangs, that seed has failed and the next process goes on.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FIRST = 27  # seed of the few that are always rendered
PATIENCE = 120.0  # seconds for a scene, on a busy machine
DIFFERENT = 0.005  # of the pixels: specks of surfaces that lie in each other


def run(first: int, end: int, folder: Path) -> list[dict]:
    """What becomes of the scenes of these seeds."""
    found: list[dict] = []
    while first + len(found) < end:
        seed = first + len(found)
        with open(folder / "errors.txt", "w+") as errors:
            worker = subprocess.Popen(
                [sys.executable, ROOT / "tests" / "random_scenes.py", str(seed), str(end - seed)],
                cwd=folder,
                env={**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{ROOT / 'native'}"},
                stdout=subprocess.PIPE,
                stderr=errors,
            )
            found += outcomes(worker)
            if len(found) < end - first:
                errors.seek(0)
                last = errors.read()[-500:]
                kind = "hang" if worker.returncode == -9 else f"exit code {worker.returncode}"
                found.append({"seed": first + len(found), "outcome": kind, "why": last})
    return found


def outcomes(worker: subprocess.Popen):
    """The lines of JSON that a worker says; it is killed where one takes too long."""
    text, heard = b"", time.monotonic()
    with contextlib.closing(worker.stdout) as pipe:
        while True:
            if select.select([pipe], [], [], 1.0)[0]:
                more = os.read(pipe.fileno(), 65536)
                if not more:
                    break
                *lines, text = (text + more).split(b"\n")
                for line in lines:
                    heard = time.monotonic()
                    yield json.loads(line)
            if time.monotonic() - heard > PATIENCE:
                worker.kill()
                break
    worker.wait()


def test_random_scenes(tmp_path, pytestconfig, record_property):
    count = pytestconfig.getoption("random_scenes")
    found = run(FIRST, FIRST + count, tmp_path)
    assert [each["seed"] for each in found] == list(range(FIRST, FIRST + count))
    kinds = Counter(each["outcome"] for each in found)
    record_property("outcomes", dict(kinds))
    faults = [each for each in found if each["outcome"] not in ("rendered", "refused")]
    assert not faults, faults
    rendered = [each for each in found if each["outcome"] == "rendered"]
    assert len(rendered) >= 0.7 * count
    assert not [each for each in rendered if not each["finite"]]
    compared = [each for each in rendered if "differ" in each]
    assert sum(each["differ"]["n"] > 100 for each in compared) >= 0.3 * count  # something is seen
    differ = [each for each in compared if max_of(each["differ"]) > DIFFERENT]
    assert not differ, differ


def max_of(differ: dict) -> float:
    return max(differ["index"], differ["depth"])
