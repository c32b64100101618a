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
from leapray import _abi

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


# ---- C ---------------------------------------------------------------------------

HEADER = (ROOT / "native" / "include" / "leapray.h").read_text(encoding="utf-8")
HEAD, BODY = HEADER.split("#ifndef LEAPRAY_H", 1)
# What every function has in common is said at the head of the header, once.
COMMON = {"error", "watch"}
COMMENT = re.compile(r"/\*(.*?)\*/", re.S)
PARAGRAPHS = [text for text in BODY.split("\n\n") if "LR_API " in text or "typedef" in text]


def plain(text: str) -> str:
    return " ".join(re.sub(r"\n\s*\*?", " ", text).split())


def functions() -> dict[str, tuple[str, str]]:
    """name -> (its declaration, the comments of its paragraph: neighbours share one)."""
    found = {}
    for text in PARAGRAPHS:
        comments = plain(" ".join(COMMENT.findall(text)))
        code = plain(COMMENT.sub("", text))
        for declaration in re.findall(r"LR_API ([^;]*\));", code):
            found[re.search(r"(lr_\w+)\(", declaration)[1]] = declaration, comments
    return found


FUNCTIONS = functions()
HANDLE = r"(?:const )?lr_(?:volume|samples|structure|scene|texture|voxelizer|radii) \*\w+"


def test_the_header_is_read_whole():
    assert set(FUNCTIONS) == set(_abi.PROTOTYPES)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_pointer_of_a_function_is_named(name):
    declaration, comments = FUNCTIONS[name]
    assert comments, f"{name} has no comment"
    inside = declaration[declaration.index("(") + 1 : -1]
    for parameter in inside.split(", "):
        words = re.fullmatch(r".*?\*(?:const \*)?(\w+)|.* (\w+)\[\d*\]", parameter)
        own = parameter == inside.split(", ")[0] and re.fullmatch(HANDLE, parameter)
        if words is None or own:  # no pointer, or the thing itself that it is about
            continue
        argument = words[1] or words[2]
        kind = re.sub(r"lr_|s$", "", parameter.split(" *")[0].removeprefix("const ").strip())
        named = re.search(rf"\b(?:{argument}|{kind}|{argument}s)\b", comments)
        assert argument in COMMON or named, f"{name} does not say what {argument} is"


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_status_that_a_function_may_return_is_named(name):
    declaration, comments = FUNCTIONS[name]
    if declaration.startswith("lr_status "):
        assert re.search(r"\bLR_E_\w+", comments), f"{name} does not say how it fails"
    else:
        assert "LR_E_" not in declaration


@pytest.mark.parametrize("argument", sorted(COMMON))
def test_what_functions_have_in_common_is_said_once(argument):
    assert re.search(rf"\b{argument}\b", HEAD)


COMMENTED = r"((?:/\*(?:(?!\*/).)*\*/\n)?)typedef struct \w+ \{\n(.*?)\n\} (\w+);"
STRUCTS = re.findall(COMMENTED, BODY, re.S)


@pytest.mark.parametrize(("above", "members", "name"), STRUCTS, ids=[name for *_, name in STRUCTS])
def test_every_member_of_a_struct_is_described(above, members, name):
    told = plain(above + members)
    members = COMMENT.sub(lambda found: found[0].replace(";", ","), members)
    for code, comment in re.findall(r"([^;]+);([^;\n]*/\*.*?\*/)?", members, re.S):
        for member in re.findall(r"(\w+)(?:\[\d+\])*(?:,|$)", plain(COMMENT.sub("", code))):
            counted = re.fullmatch(r"n_\w+", member) and f"[{member}]" in told
            listed = re.search(rf"\b{member}\b", plain(above))
            assert comment or counted or listed or member == "reserved", (
                f"{name}.{member} is not described"
            )
