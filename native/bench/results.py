# SPDX-License-Identifier: GPL-3.0-or-later
"""Results of benchmarks: as files, as tables, and two of them compared."""

from __future__ import annotations

import json
import os
import platform
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.libraries import BenchError

# Flags of /proc/cpuinfo that say which vector instructions there are.
VECTOR_FLAGS = ("sse", "ssse", "avx", "fma", "bmi", "popcnt", "f16c", "asimd", "sve")


@dataclass
class Result:
    """What was measured of one core."""

    commit: str
    machine: str
    vector_instructions: list[str]
    python: str
    benchmarks: dict[str, dict] = field(default_factory=dict)  # see measured
    left_out: dict[str, str] = field(default_factory=dict)  # {benchmark: why}

    def seconds(self, name: str) -> NDArray[np.float64]:
        """(rounds,) of processor time for one run."""
        return np.array(self.benchmarks[name]["seconds"])

    def write(self, path: Path) -> None:
        """As JSON. Raises BenchError."""
        try:
            path.write_text(json.dumps(asdict(self), indent=1) + "\n", encoding="utf-8")
        except OSError as error:
            raise BenchError(f"{path} cannot be written: {error.strerror}") from None


def measured(rays: int, seconds: list[float]) -> dict:
    """An entry of a result: all rounds, and what they come to."""
    low, middle, high = np.percentile(seconds, (0, 50, 100)).tolist()
    return {"rays": rays, "median": middle, "least": low, "most": high, "seconds": seconds}


def read(path: Path) -> Result:
    """The result in a file. Raises BenchError."""
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
        result = Result(**told)
        result.left_out.keys()
        for name in result.benchmarks:
            if not (len(result.seconds(name)) and (result.seconds(name) > 0).all()):
                raise ValueError(name)
    except OSError as error:
        raise BenchError(f"{path} cannot be read: {error.strerror}") from None
    except (ValueError, TypeError, KeyError, AttributeError):
        raise BenchError(f"{path} is no file that `run.py --out` has written") from None
    return result


def empty_result(commit: str) -> Result:
    """A result of this machine, without benchmarks so far."""
    told: dict[str, str] = {}
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            name, _, value = line.partition(":")
            told.setdefault(name.strip(), value.strip())
    except OSError:
        pass  # then the processor stays unnamed
    flags = told.get("flags", told.get("Features", "")).split()
    vector = [flag for flag in flags if flag.startswith(VECTOR_FLAGS)]
    processor = told.get("model name", platform.machine())
    machine = f"{processor}, {os.cpu_count()} processors, {platform.platform()}"
    return Result(commit, machine, vector, platform.python_version())


# ---- tables --------------------------------------------------------------


def table(result: Result) -> str:
    """A line for each benchmark: the time of a run, and rays per second where it traces rays."""
    lines: list[tuple[str, ...]] = [("", "ms", "least", "most", "Mrays/s")]
    for name, each in result.benchmarks.items():
        times = [f"{1e3 * each[key]:.2f}" for key in ("median", "least", "most")]
        speed = f"{each['rays'] / each['median'] / 1e6:.2f}" if each["rays"] else ""
        lines.append((name, *times, speed))
    return aligned(lines)


def compared(new: Result, old: Result, paired: bool) -> str:
    """The ratios of the times of new to those of old, worst first.

    paired: round i of both ran side by side, so that the ratio is taken of these; else all pairs
    of rounds are taken.
    """
    both = [name for name in new.benchmarks if name in old.benchmarks]
    if not both:
        raise BenchError("the two have no benchmark in common")
    rows: list[tuple[float, tuple[str, ...]]] = []
    for name in both:
        a, b = new.seconds(name), old.seconds(name)
        ratios = a / b if paired else np.divide.outer(a, b).ravel()
        low, middle, high = np.percentile(ratios, (0, 50, 100))
        times = (f"{1e3 * np.median(each):.2f}" for each in (b, a))
        rows.append((middle, (name, f"{middle:.3f}", f"[{low:.3f}..{high:.3f}]", *times)))
    rows.sort(key=lambda row: -row[0])
    head = ("", "ratio", "[least..most]", "ms before", "ms after")
    return aligned([head, *(cells for _, cells in rows)])


def left_out(found: list[Result]) -> list[str]:
    """A sentence for each benchmark that one of these results lacks, though another names it."""
    names = dict.fromkeys(name for each in found for name in (*each.benchmarks, *each.left_out))
    return [
        f"left out: {name}: {each.left_out.get(name, 'not measured')} (in {each.commit})"
        for each in found
        for name in names
        if name in each.left_out or all(name not in one.left_out for one in found)
        if name not in each.benchmarks
    ]


def aligned(lines: list[tuple[str, ...]]) -> str:
    """Lines of cells in columns: the first to the left, numbers to the right."""
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join(
        "  ".join(
            (cell.rjust if i else cell.ljust)(width)
            for i, (cell, width) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in lines
    )
