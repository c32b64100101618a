# SPDX-License-Identifier: GPL-3.0-or-later
"""The methods to be compared, as the core lists them, and timing (no bpy)."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

import leapray


def hit_tests() -> list[tuple[str, str]]:
    """Pairs (hit test, root finder) that the core does not refuse."""
    structure = leapray.build(leapray.Volume(np.ones((1, 1, 1), np.uint8)))
    found = []
    for hit_test in leapray.HIT_TESTS:
        for root in leapray.ROOTS:
            try:
                leapray.trace(structure, [(0, 0, -3)], [(0, 0, 1)], hit_test=hit_test, root=root)
            except leapray.LeapRayError:
                continue
            found.append((hit_test, root))
    return found


def walks_cells(hit_test: str) -> bool:
    """Whether a hit test tests each cell by itself, so that it works with every root finder."""
    return {root for test, root in hit_tests() if test == hit_test} == set(leapray.ROOTS)


def default() -> leapray.Traverser:
    """The traverser of default settings."""
    return next(entry for entry in leapray.traversers() if entry.default)


def first_of(source: str) -> leapray.Traverser:
    """The first traverser whose source begins so."""
    return next(entry for entry in leapray.traversers() if entry.source.startswith(source))


def label(entry: leapray.Traverser | leapray.ImageMethod) -> str:
    """A method's label with those options that are not the default."""
    _, _, options = entry.spec.partition(":")
    return (
        f"{entry.label}, {options.replace('=', ' ').replace(',', ', ')}" if options else entry.label
    )


def spread(taken: Sequence[float] | NDArray[np.float64]) -> tuple[float, float, float]:
    """The median, the least and the most of seconds."""
    return float(np.median(taken)), float(np.min(taken)), float(np.max(taken))


def seconds(
    jobs: list[Callable[[], object]], rounds: int, clock: Callable[[], float] = time.process_time
) -> NDArray[np.float64]:
    """(rounds, jobs) seconds by the clock, all jobs in turn, so that a slow moment hits all."""
    took = np.empty((rounds, len(jobs)))
    for turn in range(rounds):
        for k, job in enumerate(jobs):
            began = clock()
            job()
            took[turn, k] = clock() - began
    return took
