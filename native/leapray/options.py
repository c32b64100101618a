# SPDX-License-Identifier: GPL-3.0-or-later
"""What the core's registries list, its options, and the choices that are made of them."""

from __future__ import annotations

import ctypes
import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from ._lib import LeapRayError

Options = tuple["Option", ...]
Choices = tuple[str, ...]  # one per option


@dataclass(frozen=True)
class Option:
    """A choice that a traverser or an image method offers."""

    name: str
    choices: tuple[str, ...]  # the first is the default
    inexact: frozenset[str]  # those that give exactness up


@dataclass(frozen=True)
class Entry:
    """A line of one of the core's registries, with its options chosen."""

    index: int
    name: str  # as in files and on the command line
    label: str  # as in menus
    source: str
    about: str  # how it works with the options chosen, or what it may miss
    exact: bool  # it finds what it is to find, whatever the ray
    options: tuple[Option, ...] = ()
    chosen: tuple[str, ...] = ()  # per option
    template: str = ""  # about, with the words of every choice, as the registry has it

    @property
    def spec(self) -> str:
        """How to ask for it: "name" or "name:option=choice,..." for what is not the default."""
        pairs = zip(self.options, self.chosen, strict=True)
        asked = [f"{option.name}={one}" for option, one in pairs if one != option.choices[0]]
        return f"{self.name}:{','.join(asked)}" if asked else self.name


AnyEntry = TypeVar("AnyEntry", bound=Entry)


def read_entry(kind: type[AnyEntry], index: int, line: Any, **flags: Any) -> AnyEntry:
    """An entry of that kind of the core's line with that index, with its default options.

    flags: of the kind's own, and whether it is exact.
    """
    name, label, source, about, listed = (
        getattr(line, key).decode() for key in ("name", "label", "source", "about", "options")
    )
    options = tuple(_option(part) for part in listed.split())
    made = kind(index, name, label, source, about, options=options, template=about, **flags)
    return choose(made, tuple(option.choices[0] for option in options))


def _option(text: str) -> Option:
    """Of "name=first|second!"; the mark stands where exactness is given up."""
    name, _, listed = text.partition("=")
    choices = listed.split("|")
    inexact = frozenset(choice[:-1] for choice in choices if choice.endswith("!"))
    return Option(name, tuple(choice.rstrip("!") for choice in choices), inexact)


def choose(entry: AnyEntry, chosen: Choices) -> AnyEntry:
    """The entry with other choices."""
    pairs = zip(entry.options, chosen, strict=True)
    return replace(
        entry,
        chosen=chosen,
        exact=entry.exact and not any(one in option.inexact for option, one in pairs),
        about=_about(entry, chosen),
    )


def all_choices(entries: Sequence[AnyEntry]) -> list[AnyEntry]:
    """The entries with every combination of their options."""
    return [
        choose(entry, chosen)
        for entry in entries
        for chosen in itertools.product(*(option.choices for option in entry.options))
    ]


def find(kind: str, spec: str, entries: Sequence[AnyEntry]) -> AnyEntry:
    """The entry that spec, "name" or "name:option=choice,...", asks for.

    kind: what sentences call it. Raises LeapRayError that lists what there is.
    """
    name, _, asked = spec.partition(":")
    entry = next((one for one in entries if one.name == name), None)
    if entry is None:
        known = ", ".join(one.name for one in entries)
        raise LeapRayError(f"unknown {kind} {name!r}; there are {known}")
    chosen = {option.name: option.choices[0] for option in entry.options}
    offered = {option.name: option.choices for option in entry.options}
    for pair in filter(None, asked.split(",")):
        key, _, value = pair.partition("=")
        if value not in offered.get(key, ()):
            offers = "; ".join(f"{k}={'|'.join(v)}" for k, v in offered.items()) or "no options"
            raise LeapRayError(f"{kind} {entry.name} has {offers}, not {pair!r}")
        chosen[key] = value
    return choose(entry, tuple(chosen.values()))


def choice_numbers(entry: Entry) -> ctypes.Array:
    """The choices as the core counts them; where there are none, one that nobody reads."""
    numbers = _numbers(entry.options, entry.chosen)
    return (ctypes.c_int32 * max(len(numbers), 1))(*numbers)


def _numbers(options: Options, chosen: Choices) -> list[int]:
    return [option.choices.index(one) for option, one in zip(options, chosen, strict=True)]


def _about(entry: Entry, chosen: Choices) -> str:
    """What holds for these choices: of "{name:first|second}" the words of the one chosen."""
    names = (option.name for option in entry.options)
    numbers = dict(zip(names, _numbers(entry.options, chosen), strict=True))

    def words(found: re.Match) -> str:
        return found[2].split("|")[numbers[found[1]]]

    return re.sub(r"{(\w+):([^}]*)}", words, entry.template)
