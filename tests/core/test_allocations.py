# SPDX-License-Identifier: GPL-3.0-or-later
"""Every allocation of the core fails once: a sentence comes of it, and nothing is left behind."""

from __future__ import annotations

import json
import os
import subprocess

import allocation_failures
import pytest

import build_variants


@pytest.mark.slow
def test_every_allocation_of_the_core_may_fail():
    if not build_variants.available():
        assert not os.environ.get("CI"), "no gcc"
        pytest.skip("the system has no gcc, which compiles the core with allocations that fail")
    done = subprocess.run(
        build_variants.python([allocation_failures.__file__]),
        env=build_variants.environment("address"),
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout[-1000:] + done.stderr[-4000:]
    told = json.loads(done.stdout)
    asked = allocation_failures.places()
    assert len(asked) > 150
    assert asked == {*told["refused"], *told["tolerated"]}
    for place in set(told["tolerated"]) - set(told["refused"]):
        assert "realloc" in asked_at(place), f"{place} did without"  # what only shrinks


def asked_at(place: str) -> str:
    """The line of the core."""
    name, _, number = place.rpartition(":")
    return (build_variants.NATIVE / name).read_text().splitlines()[int(number) - 1]
