# SPDX-License-Identifier: GPL-3.0-or-later
"""Public functions say what they take and give: parameters, shapes, units, errors.

Of prose a machine can tell only so much: that a parameter is named, that an array has a shape,
that a call which can fail says so. The rest is for readers.
"""

from __future__ import annotations

import inspect
import re
import sys
from pathlib import Path

import pytest

import leapray

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "docs"))

import make_library  # noqa: E402

# ---- Python ----------------------------------------------------------------------

SHAPE = r"\((?:n|m|\d|nx|ny|nz|height|width)\b[\w, ]*\)|same shape|as (?:for |of )?`"
FAILS = re.compile(
    r"\braise \w|\b(?:check|call|choice|numbers|triple|matrix|columns|per_ray|empty)\("
)


def callables() -> dict[str, tuple[object, str]]:
    """name -> (function, its documentation); a class's constructor is documented by the class."""
    found: dict[str, tuple[object, str]] = {}
    for name in leapray.__all__:
        thing = getattr(leapray, name)
        if inspect.isfunction(thing):
            found[name] = thing, inspect.getdoc(thing) or ""
        if not inspect.isclass(thing):
            continue
        own = inspect.getdoc(thing) or ""
        if not hasattr(thing, "__dataclass_fields__") and "__init__" in vars(thing):
            found[name] = thing.__init__, own
        for member in make_library.documented_members(thing):
            raw = inspect.getattr_static(thing, member)
            function = raw.fget if isinstance(raw, property) else getattr(raw, "__func__", raw)
            found[f"{name}.{member}"] = function, inspect.getdoc(function) or ""
    return found


CALLABLES = callables()


def parameters(function) -> list[inspect.Parameter]:
    own = inspect.signature(function).parameters.values()
    return [p for p in own if p.name not in ("self", "cls")]


def statements_on(name: str, text: str) -> str:
    """What the text says from each mention of the name to the end of that statement."""
    return " ".join(re.findall(rf"\b{name}\b.*?(?:\.\s|;|\Z)", text, re.S))


@pytest.mark.parametrize("name", CALLABLES)
def test_every_parameter_is_named(name):
    function, text = CALLABLES[name]
    missing = [p.name for p in parameters(function) if not re.search(rf"\b{p.name}\b", text)]
    assert not missing, f"{name} does not say what {', '.join(missing)} is"


@pytest.mark.parametrize("name", CALLABLES)
def test_every_array_has_a_shape(name):
    function, text = CALLABLES[name]
    plain = " ".join(text.split())
    for p in parameters(function):
        if re.search("ArrayLike|NDArray", str(p.annotation)):
            told = statements_on(p.name, plain)
            assert re.search(SHAPE, told), f"{name} gives {p.name} no shape"
    if "NDArray" in str(inspect.signature(function).return_annotation):
        assert re.search(SHAPE, plain), f"{name} gives its result no shape"


@pytest.mark.parametrize("name", CALLABLES)
def test_what_can_fail_says_how(name):
    function, text = CALLABLES[name]
    source = re.sub(r'""".*?"""', "", inspect.getsource(function), flags=re.S)
    if FAILS.search(source):
        assert re.search(r"\bRaises\b", text), f"{name} does not say what it raises"
