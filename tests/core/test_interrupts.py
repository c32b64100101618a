# SPDX-License-Identifier: GPL-3.0-or-later
"""Ctrl-C is raised once the work has ended whose arrays it would take away, whenever it comes."""

from __future__ import annotations

import threading
import time

import pytest

from leapray import Stopped, Watch
from leapray._lib import apart
from leapray.threads import run_parts, run_steps


@pytest.fixture
def interrupted(monkeypatch):
    """Have the start of the next thread interrupted, before or after it runs."""

    def at(moment):
        start = threading.Thread.start

        def broken(thread):
            monkeypatch.setattr(threading.Thread, "start", start)
            if moment == "after":
                start(thread)
                time.sleep(0.05)
            raise KeyboardInterrupt

        monkeypatch.setattr(threading.Thread, "start", broken)

    return at


def work_of(watch, began, ended):
    def work(*_):
        began.append(1)
        while not watch.stopped:
            time.sleep(0.001)
        time.sleep(0.1)
        ended.append(1)
        raise Stopped("it was stopped")

    return work


WAYS = {
    "call": lambda work, watch: apart(work, watch),
    "parts": lambda work, watch: run_parts(work, 8, 1, 3, watch),
    "steps": lambda work, watch: run_steps(work, [4, 4], 2, watch),
}


@pytest.mark.parametrize("how", WAYS)
def test_an_interrupt_in_the_start_of_a_thread_waits_for_what_began(how, interrupted):
    watch, began, ended = Watch(), [], []
    interrupted("after")
    with pytest.raises(KeyboardInterrupt):
        WAYS[how](work_of(watch, began, ended), watch)
    assert 1 <= len(began) == len(ended)
    time.sleep(0.05)
    assert len(began) == len(ended)  # and nothing begins later


@pytest.mark.parametrize("how", WAYS)
def test_an_interrupt_before_the_thread_runs_lets_nothing_begin(how, interrupted):
    watch, began, ended = Watch(), [], []
    interrupted("before")
    with pytest.raises(KeyboardInterrupt):
        WAYS[how](work_of(watch, began, ended), watch)
    time.sleep(0.05)
    assert not began


def test_an_interrupt_meanwhile_stops_the_work_and_waits(monkeypatch):
    watch, began, ended = Watch(), [], []
    wait = threading.Event.wait

    def once(event, timeout=None):
        monkeypatch.setattr(threading.Event, "wait", wait)
        while not began:
            time.sleep(0.001)
        raise KeyboardInterrupt

    work = work_of(watch, began, ended)

    def begin():
        monkeypatch.setattr(threading.Event, "wait", once)
        work()

    with pytest.raises(KeyboardInterrupt):
        apart(begin, watch)
    assert began and ended


def test_what_the_work_raises_and_returns_comes_back():
    assert apart(lambda: 7, Watch()) == 7
    with pytest.raises(ZeroDivisionError):
        apart(lambda: 1 // 0, Watch())
    assert run_parts(lambda i, j: (i, j), 5, 2, 2, Watch()) == [(0, 2), (2, 4), (4, 5)]
