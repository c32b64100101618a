# SPDX-License-Identifier: GPL-3.0-or-later
"""Work in parts on several threads; the core lets go of the interpreter meanwhile."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from ._lib import CancelToken, LeapRayError, apart

T = TypeVar("T")


def cores() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def check_threads(threads: int) -> None:
    """Raise LeapRayError for a number that is none of threads."""
    if threads < 0:
        raise LeapRayError(f"threads must be 0 (all cores) or more; it is {threads}")


def run_parts(
    part: Callable[[int, int], T], n: int, size: int, threads: int, watch: CancelToken
) -> list[T]:
    """part(first, last) over 0..n in steps of size, in order of the result; threads 0: all cores.

    The first exception is raised once all threads have ended; parts that have not begun are left
    out. Ctrl-C sets the watch's stop word besides.
    """
    firsts = range(0, n, size)
    left = iter(enumerate(firsts))  # threads take from it in turns, each a part at a time
    results: dict[int, T] = {}
    failures: dict[int, BaseException] = {}

    def share() -> None:
        for index, first in left:
            if failures:
                return
            try:
                results[index] = part(first, min(first + size, n))
            except BaseException as error:
                failures[index] = error

    def work() -> list[T]:
        _side_by_side(share, min(threads or cores(), len(firsts)))
        if failures:
            error = failures[min(failures)]
            _stop_unless_part_failed(watch, error)
            raise error
        return [results[index] for index in range(len(firsts))]

    return apart(work, watch)


def _side_by_side(share: Callable[[], None], hands: int) -> None:
    """share(), which does not raise, on so many threads, one of which is this one."""
    others = [threading.Thread(target=share, name="leapray") for _ in range(hands - 1)]
    started = []
    try:
        for thread in others:
            thread.start()
            started.append(thread)
        share()
    finally:
        for thread in started:
            thread.join()


def run_steps(
    part: Callable[[int, int], object], counts: list[int], threads: int, watch: CancelToken
) -> None:
    """part(step, index) for every index below counts[step], one step after the other.

    The parts of a step run on that many threads, 0: all cores. The first exception is raised once
    all threads have ended; parts that have not begun are left out. Ctrl-C sets the watch's stop
    word besides.
    """
    hands = threads or cores()
    failed = threading.Event()

    def share(step: int, first: int) -> None:
        for index in range(first, counts[step], hands):
            if failed.is_set():
                return
            try:
                part(step, index)
            except BaseException:
                failed.set()
                raise

    def work() -> None:
        with ThreadPoolExecutor(hands, thread_name_prefix="leapray") as pool:
            try:
                for step, count in enumerate(counts):
                    for job in [pool.submit(share, step, i) for i in range(min(hands, count))]:
                        job.result()
            except BaseException as error:
                failed.set()
                _stop_unless_part_failed(watch, error)
                pool.shutdown(wait=True, cancel_futures=True)
                raise

    apart(work, watch)


def _stop_unless_part_failed(watch: CancelToken, error: BaseException) -> None:
    """A refusal of one volume must not stop what others share the watch with it."""
    if not isinstance(error, LeapRayError):
        watch.stop()
