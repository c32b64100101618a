# SPDX-License-Identifier: GPL-3.0-or-later
"""Options of what the core's registries list, and the choices that are made of them."""

from __future__ import annotations

import re
from dataclasses import dataclass

from ._lib import LeapRayError

Options = tuple["Option", ...]
Choices = tuple[str, ...]  # one per option


@dataclass(frozen=True)
class Option:
    """A choice that a traverser or an image method offers."""

    name: str
    choices: tuple[str, ...]  # the first is the default
    inexact: frozenset[str]  # those that give exactness up


def parse_options(text: str) -> Options:
    """The options of a line of a registry, "name=first|second! name=..."."""
    return tuple(_option(part) for part in text.split())


def _option(text: str) -> Option:
    name, _, listed = text.partition("=")
    choices = listed.split("|")
    inexact = frozenset(choice[:-1] for choice in choices if choice.endswith("!"))
    return Option(name, tuple(choice.rstrip("!") for choice in choices), inexact)


def defaults(options: Options) -> Choices:
    """The first choice of each."""
    return tuple(option.choices[0] for option in options)


def numbers_of_choices(options: Options, chosen: Choices) -> list[int]:
    """The choices as the core counts them."""
    return [option.choices.index(one) for option, one in zip(options, chosen, strict=True)]


def keeps_exact(options: Options, chosen: Choices) -> bool:
    """Whether none of the choices gives exactness up."""
    return not any(one in option.inexact for option, one in zip(options, chosen, strict=True))


def spec_of(name: str, options: Options, chosen: Choices) -> str:
    """How to ask for it: "name" or "name:option=choice,..." for what is not the default."""
    pairs = zip(options, chosen, strict=True)
    asked = [f"{option.name}={one}" for option, one in pairs if one != option.choices[0]]
    return f"{name}:{','.join(asked)}" if asked else name


def about_choices(template: str, options: Options, chosen: Choices) -> str:
    """What holds for these choices: of "{name:first|second}" the words of the one chosen."""
    names = [option.name for option in options]
    numbers = dict(zip(names, numbers_of_choices(options, chosen), strict=True))

    def words(found: re.Match) -> str:
        return found[2].split("|")[numbers[found[1]]]

    return re.sub(r"{(\w+):([^}]*)}", words, template)


def parse_choices(owner: str, options: Options, asked: str) -> Choices:
    """The choices that "option=choice,..." asks for, else the defaults.

    owner: who has the options, as a sentence names it. Raises LeapRayError that lists them.
    """
    chosen = {option.name: option.choices[0] for option in options}
    offered = {option.name: option.choices for option in options}
    for pair in filter(None, asked.split(",")):
        key, _, value = pair.partition("=")
        if value not in offered.get(key, ()):
            offers = "; ".join(f"{k}={'|'.join(v)}" for k, v in offered.items()) or "no options"
            raise LeapRayError(f"{owner} has {offers}, not {pair!r}")
        chosen[key] = value
    return tuple(chosen.values())
