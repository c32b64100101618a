# SPDX-License-Identifier: GPL-3.0-or-later
"""The process that runs benchmarks over one core: requests come and answers go, a JSON line each.

    python native/bench/worker.py PACKAGE

PACKAGE: the folder in which the package leapray lies. At first the worker tells its benchmarks,
[[name, rays], ...]. Then it is sent names, of benchmarks that it sets up the first time, and
answers {"seconds": of processor time for one run} or {"reason": a sentence}. It ends with its
input.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from pathlib import Path

LEAST_SECONDS = (
    0.04  # that a measurement takes, so that starting threads and reading clocks are none of it
)


def measure(run) -> float:
    """Seconds of processor time of one run, the mean of as many as take long enough."""
    began, runs = time.process_time(), 0
    while True:
        run()
        runs += 1
        took = time.process_time() - began
        if took >= LEAST_SECONDS:
            return took / runs


def main(package: str) -> None:
    """Answer until the input ends."""
    native = str(Path(__file__).resolve().parents[1])
    sys.path.insert(0, native)
    import bench  # noqa: F401  this one, whatever lies beside the core that is measured

    sys.path.insert(0, package)
    import leapray

    found = Path(leapray.__file__).parents[1]
    if not os.path.samefile(found, package):
        raise ImportError(f"leapray lies in {found}, not in {package}")
    from bench import benchmarks

    known = {each.name: each for each in benchmarks.all_benchmarks()}
    answer([[each.name, each.rays] for each in known.values()])
    runs: dict[str, benchmarks.Run] = {}
    for line in sys.stdin:
        name = json.loads(line)
        try:
            if name not in runs:
                run = known[name].set_up()
                run()  # memory is touched
                runs[name] = run
            answer({"seconds": measure(runs[name])})
        except Exception as error:  # an older core may lack anything that a benchmark uses
            answer({"reason": f"{type(error).__name__}: {error}".splitlines()[0]})


def answer(content) -> None:
    print(json.dumps(content), flush=True)


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # its parent ends it
    main(sys.argv[1])
