# SPDX-License-Identifier: GPL-3.0-or-later
"""What a description of a setting says, and numbers within its limits (no bpy)."""

from __future__ import annotations

import argparse
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

import leapray

WHOLE_MAX = 2**31 - 1  # that Blender holds


def sentence(text: str) -> str:
    """It begins with a capital letter."""
    return text[:1].upper() + text[1:]


@dataclass(frozen=True)
class Choice:
    """An entry of a menu; without a name the heading of those that follow."""

    name: str
    label: str
    tooltip: str
    stored: int | None = None  # the number in files; None: one made of the name

    @property
    def number(self) -> int:
        """Of the name, so that it stays right when entries come and go."""
        return zlib.crc32(self.name.encode()) & WHOLE_MAX if self.stored is None else self.stored


@dataclass(frozen=True)
class Switch:
    """A check box for a setting whose 0 has a meaning of its own; it is not stored."""

    label: str
    tooltip: str
    on: float  # what the setting becomes where it was 0
    automatic: bool = True  # 0: LeapRay chooses, and the box is ticked; else 0 is off


@dataclass(frozen=True)
class Setting:
    """What is to be known of a setting beside its name; kinds are int, float, bool and str."""

    default: Any
    label: str
    tooltip: str
    minimum: float | None = None
    maximum: float | None = None
    soft_minimum: float | None = None  # of a slider
    soft_maximum: float | None = None
    unit: str = "NONE"  # Blender's subtype
    digits: int = 2  # behind the point, in the panel
    choices: tuple[Choice, ...] = ()
    check: Callable[[str], str] | None = None  # to the name in full; raises LeapRayError
    zero: Switch | None = None
    option: bool = True  # on the command line, by the name with hyphens
    zero_word: str = ""  # what the command line calls 0, which it then does not take
    object_types: tuple[str, ...] = ()  # it names an object of one, as "MESH", in Blender alone
    in_blender: bool = True  # a property of LeapRay's; else Blender has its own
    in_presets: bool = True  # not where things are kept, and what the machine has

    @property
    def kind(self) -> type:
        return type(self.default)

    @property
    def animates(self) -> bool:
        """Whether it can be keyed: Blender does so for numbers and choices."""
        held = self.kind is not str and not self.object_types
        return self.in_blender and (held or bool(self.choices))

    def problem(self, value: Any) -> str:
        """What is wrong with a value, as the end of a sentence; "" where nothing is."""
        if self.check is not None:
            try:
                self.check(value)
            except leapray.LeapRayError as error:
                return f"cannot be {value}: {error}"
        elif self.choices and value not in self.names():
            return f"is one of {', '.join(self.names())}, not {value}"
        return out_of_range(value, self.minimum, self.maximum)

    def names(self) -> list[str]:
        return [choice.name for choice in self.choices if choice.name]


def out_of_range(value: float, minimum: float | None, maximum: float | None) -> str:
    """What is wrong with a number, as the end of a sentence; "" where nothing is.

    Floats are taken as Blender holds them, whose single precision may round a limit past itself.
    """
    held = np.float32 if float in (type(value), type(minimum)) else int
    with np.errstate(over="ignore"):
        if minimum is not None and not held(value) >= held(minimum):
            return f"must be at least {minimum}, not {value}"
        if maximum is not None and held(value) > held(maximum):
            return f"must be at most {maximum}, not {value}"
    return ""


def number(
    minimum: float | None, maximum: float | None = WHOLE_MAX, kind: type = int, zero_word: str = ""
) -> Callable[[str], Any]:
    """A type for argparse: a number from minimum to maximum, or the word for 0."""

    def parse(word: str) -> Any:
        if zero_word and word == zero_word:
            return 0
        value = kind(word)
        wrong = out_of_range(value, minimum, maximum)
        if wrong:
            raise argparse.ArgumentTypeError(wrong)
        return value

    plain = "integer" if kind is int else "number"
    parse.__name__ = f'"{zero_word}" or {plain}' if zero_word else plain  # argparse shows it
    return parse


def setting(
    default: Any,
    label: str,
    tooltip: str,
    minimum: float | None = None,
    maximum: float | None = None,
    **more: Any,
) -> Any:
    """A field of a dataclass with its description."""
    told = Setting(default, label, tooltip, minimum, maximum, **more)
    return field(default=default, metadata={"setting": told})


def described(owner: type) -> dict[str, Setting]:
    """The descriptions of a dataclass's fields, by name."""
    return {each.name: each.metadata["setting"] for each in fields(owner)}
