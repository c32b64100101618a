# SPDX-License-Identifier: GPL-3.0-or-later
"""Every fuzz target's property holds for its first inputs, and most of these are no refusals."""

import collections
import types

import pytest
from fuzz import run

INPUTS = 200


@pytest.mark.parametrize("name", run.TARGETS)
def test_the_first_inputs_of_a_target_hold_its_property(name):
    if name in run.WITH_BLENDER:
        pytest.importorskip("bpy")
    module = run.target(name)
    ends = collections.Counter(run.check_input(module, 0, index) for index in range(INPUTS))
    assert ends["done"] > INPUTS / 5, ends


def test_an_input_that_breaks_the_property_is_named_so_that_it_can_be_repeated():
    broken = types.ModuleType("fuzz.broken")

    def check(rng):
        assert rng.random() < 0.9, "more than 0.9"

    broken.check = check
    first = next(i for i in range(1000) if fails(broken, i))
    with pytest.raises(run.Finding, match=f"broken --seed 0 --first {first} --inputs 1"):
        run.check_input(broken, 0, first)


def fails(module, index):
    try:
        run.check_input(module, 0, index)
    except run.Finding:
        return True
    return False
