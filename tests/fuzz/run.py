# SPDX-License-Identifier: GPL-3.0-or-later
"""Run one fuzz target, or all: random inputs made from a seed, each checked for one property.

    python tests/fuzz/run.py TARGET|all [--minutes M | --inputs N] [--seed S] [--first I]
                             [--sanitize]

A target is a module of this folder. Its docstring states its property, its function
`check` makes one input from a generator of random numbers and raises where the property
does not hold; a LeapRayError whose text is a sentence is an answer, too. Input I of seed S
is the same on every machine: --seed S --first I --inputs 1 repeats a finding. An input
that crashes the process is named on its last line. --sanitize checks the core that
`build_variants.py address` compiles, except where the target needs Blender as well.
"""

from __future__ import annotations

import argparse
import collections
import faulthandler
import importlib
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np

if __name__ == "__main__":
    root = Path(__file__).resolve().parents[2]
    native = str(root / "native")
    sys.path[:0] = [os.environ.get("LEAPRAY_PACKAGE", native), native]
    sys.path[:0] = [str(root / "tests"), str(root)]

from sentences import check_sentence

import build_variants
import leapray

FOLDER = Path(__file__).resolve().parent
TARGETS = tuple(sorted({path.stem for path in FOLDER.glob("*.py")} - {"run", "__init__"}))
WITH_BLENDER = ("cached_volumes", "shader_trees")  # whose module no sanitizer gets on with
LONGEST = 60  # seconds that one input may take
BLOCK = 100  # inputs between looks at the clock


class Finding(AssertionError):
    """An input for which the property does not hold."""


def target(name: str):
    return importlib.import_module(f"fuzz.{name}")


def check_input(module, seed: int, index: int) -> str:
    """Check one input; returns how it ended, raises Finding."""
    rng = np.random.default_rng([seed, index])
    try:
        try:
            with np.errstate(all="ignore"):
                module.check(rng)
        except leapray.LeapRayError as refusal:
            check_sentence(refusal)
            return "refused"
    except Exception as reason:
        name = module.__name__.rpartition(".")[2]
        place = f"{name} --seed {seed} --first {index} --inputs 1"
        raise Finding(f"{place}: {reason!r}") from reason
    return "done"


def run(name: str, seed: int, first: int, inputs: int, seconds: float) -> collections.Counter:
    """Check so many inputs, or as many as there is time for; findings are printed and counted.

    On a thread of its own: calls of the core from the main one start a thread each.
    """
    ends: collections.Counter = collections.Counter()
    module, place = target(name), Place(name, seed)

    def work():
        until = time.monotonic() + seconds
        for index in range(first, first + inputs):
            if index % BLOCK == 0:
                faulthandler.dump_traceback_later(LONGEST, exit=True)
                if time.monotonic() > until:
                    break
            place.note(index)
            try:
                ends[check_input(module, seed, index)] += 1
            except Finding as finding:
                print(f"FINDING {finding}", flush=True)
                ends["FINDING"] += 1
        faulthandler.cancel_dump_traceback_later()

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    place.remove()
    return ends


class Place:
    """A file that says which input is being checked, for whoever sees the process crash."""

    def __init__(self, name: str, seed: int) -> None:
        folder = build_variants.build_core.OBJECTS / "fuzz"
        folder.mkdir(parents=True, exist_ok=True)
        self.path = folder / f"{name}-{os.getpid()}"
        self.text = f"{name} --seed {seed} --first {{}} --inputs 1\n"
        self.file = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_TRUNC)

    def note(self, index: int) -> None:
        os.pwrite(self.file, self.text.format(index).encode(), 0)

    def remove(self) -> None:
        os.close(self.file)
        self.path.unlink()


def run_all(words: list[str], sanitize: bool) -> int:
    """Every target in a process of its own, two at a time; returns the number that failed."""
    queue, running, failed = list(TARGETS), {}, 0
    while queue or running:
        while queue and len(running) < 2:
            name = queue.pop(0)
            running[name] = start(name, words, sanitize)
        for name, process in list(running.items()):
            if process.poll() is not None:
                del running[name]
                said = process.communicate()[0]
                failed += process.returncode != 0
                print(said.rstrip(), flush=True)
                if process.returncode not in (0, 1):
                    print(f"FINDING {last_input(name, process.pid)}", flush=True)
        time.sleep(0.1)
    return failed


def start(name: str, words: list[str], sanitize: bool) -> subprocess.Popen:
    words = [str(Path(__file__)), name, *words]
    env = dict(os.environ)
    if sanitize and name not in WITH_BLENDER:
        env = build_variants.environment("address")
    return subprocess.Popen(
        build_variants.python(words),
        env=env,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    )


def last_input(name: str, pid: int) -> str:
    """The input at which a process crashed or hung."""
    path = build_variants.build_core.OBJECTS / "fuzz" / f"{name}-{pid}"
    return f"{path.read_text().splitlines()[0]}: crashed" if path.exists() else f"{name}: crashed"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("target", choices=[*TARGETS, "all"])
    parser.add_argument("--minutes", type=float)
    parser.add_argument("--inputs", type=int)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--sanitize", action="store_true")
    chosen = parser.parse_args()
    if chosen.target == "all":
        words = [word for word in sys.argv[1:] if word not in ("all", "--sanitize")]
        return run_all(words, chosen.sanitize) > 0
    if chosen.sanitize:
        words = [word for word in sys.argv if word != "--sanitize"]
        return build_variants.run("address", words)
    faulthandler.enable()
    inputs = chosen.inputs or (sys.maxsize // 2 if chosen.minutes else 1000)
    seconds = 60 * chosen.minutes if chosen.minutes else float("inf")
    began = time.monotonic()
    ends = run(chosen.target, chosen.seed, chosen.first, inputs, seconds)
    took, n = time.monotonic() - began, sum(ends.values())
    told = ", ".join(f"{count} {end}" for end, count in sorted(ends.items()))
    print(f"{chosen.target}: {n} inputs in {took:.0f} s ({n / took:.0f}/s): {told}")
    return ends["FINDING"] > 0


if __name__ == "__main__":
    sys.exit(main())
