# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes on a second thread what a plan is about to ask its cache for (no bpy)."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import leapray

from ..store import memory_cache

Entries = list[tuple[tuple, Any]]  # keys and values


class Ahead:
    """Tasks, one after the other, beside what this thread does, which alone changes the cache.

    With `with`, at whose end no task is left.
    """

    def __init__(self, cache: memory_cache.Cache) -> None:
        self.cache = cache
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="leapray-plan")
        self._tasks: dict[Hashable, Future[Entries]] = {}

    def __enter__(self) -> Ahead:
        return self

    def __exit__(self, *_) -> None:
        self._pool.shutdown(cancel_futures=True)

    def begin(self, name: Hashable, task: Callable[[], Entries]) -> None:
        """Let the task make entries of the cache, which it must not change."""
        self._tasks[name] = self._pool.submit(task)

    def take(self, name: Hashable) -> None:
        """Wait for the task of that name, if there is one, and put what it made into the cache.

        What the core refused is left to who asks for it, who will hear the same.
        """
        task = self._tasks.pop(name, None)
        try:
            entries = task.result() if task else []
        except leapray.LeapRayError:
            return
        for key, value in entries:
            self.cache.put(key, value)
