# SPDX-License-Identifier: GPL-3.0-or-later
"""Trees of Mix Shader and Add Shader as a list of shaders with weights."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import cast

import numpy as np
from numpy.typing import NDArray

from leapray import Step, Value, operate

from .node_values import clamp
from .nodes import Folder, Place, Unfolded, own_value, source

SIDES = ("Shader", "Shader_001")
MIX, ADD = "ShaderNodeMixShader", "ShaderNodeAddShader"


class Walk:
    """A walk through the shaders of a material, light or world, which is told what it does not
    understand: once, under the name of what has the shaders."""

    def __init__(self, name: str, notes) -> None:
        self.name, self.notes = name, notes
        self.strange: dict[str, None] = {}  # what is not understood, in order

    def tell(self) -> None:
        if self.strange:
            self.notes.strange(tuple(self.strange), self.name)

    def source(self, place: Place) -> Place | None:
        """The output that feeds an input; None where there is none, or it is not understood."""
        try:
            return source(place)[0]
        except Unfolded as error:
            self.strange[str(error)] = None
            return None


class Constants(Walk):
    """A walk in which weights, and what else is asked by name, depend on no texture."""

    def value(self, out: Place, name: str) -> NDArray[np.float64]:
        """Of the input of that name; the socket's own where it depends on a texture."""
        place = out.input(name)
        try:
            return Folder().value(place)
        except Unfolded as error:
            self.strange[str(error)] = None
            return own_value(place)

    def number(self, out: Place, name: str) -> float:
        return float(self.value(out, name))

    def flattened(self, socket) -> list[tuple[Place, float]]:
        """The shaders that an output node's input adds up, and their weights."""
        if socket is None:
            return []
        found = flattened(Place(socket), self.source, lambda out: self.number(out, "Fac"))
        return cast(list[tuple[Place, float]], found)


def flattened(
    place: Place,
    source: Callable[[Place], Place | None],
    factor: Callable[[Place], Value],
) -> list[tuple[Place, Value]]:
    """Outputs of other nodes that the shader at an input adds up, and their weights, in order.

    source: the output that feeds an input. factor: that of a Mix Shader. What is reached
    on several ways comes once. No recursion, as trees may be thousands of nodes deep, and
    none of them is seen twice, as the ways through them may be more than can be counted.
    """
    first = source(place)
    if first is None:
        return []
    parts = _Parts(source, factor)
    weights: dict[Place, Value] = {first: 1.0}
    made = []
    for out in reversed(_after_what_they_use(first, parts)):
        inner = parts.of(out)
        if inner is None:
            made.append((out, weights[out]))
            continue
        for each, share in inner:
            weights[each] = _plus(weights.get(each, 0.0), _times(share, weights[out]))
    return made


def _times(a: Value, b: Value) -> Value:
    """In f64 where both are numbers."""
    return operate("multiply", a, b) if isinstance(a, Step) or isinstance(b, Step) else a * b


def _plus(a: Value, b: Value) -> Value:
    return operate("add", a, b) if isinstance(a, Step) or isinstance(b, Step) else a + b


class _Parts:
    """What a node adds up: shaders' outputs with their shares; None for any other node."""

    def __init__(self, source, factor) -> None:
        self.source, self.factor = source, factor
        self.known: dict[Place, list[tuple[Place, Value]] | None] = {}

    def of(self, out: Place) -> list[tuple[Place, Value]] | None:
        if out not in self.known:
            self.known[out] = self._find(out)
        return self.known[out]

    def _find(self, out: Place) -> list[tuple[Place, Value]] | None:
        kind = out.node.bl_idname
        if out.node.mute or kind not in (MIX, ADD):
            return None
        shares: list[Value] = [1.0, 1.0]
        if kind == MIX:
            share = self.factor(out)
            if isinstance(share, Step):
                share = clamp(share)
            elif share == share:  # else NaN, to be found
                share = min(max(share, 0.0), 1.0)
            shares = [_plus(1.0, _times(-1.0, share)), share]
        found = ((self.source(out.input(side)), s) for side, s in zip(SIDES, shares, strict=True))
        return [(each, share) for each, share in found if each is not None and share != 0.0]


def _after_what_they_use(first: Place, parts: _Parts) -> list[Place]:
    """Each output after those that it uses; one that would use itself does not."""
    order: list[Place] = []
    seen = {first}
    stack: list[tuple[Place, Iterator[tuple[Place, Value]]]] = [(first, _from_last(first, parts))]
    under_way = {first}
    while stack:
        out, rest = stack[-1]
        following = next(rest, None)
        if following is None:
            order.append(out)
            under_way.discard(out)
            stack.pop()
        elif following[0] in under_way:
            parts.known[out] = [each for each in parts.of(out) or [] if each[0] != following[0]]
        elif following[0] not in seen:
            seen.add(following[0])
            under_way.add(following[0])
            stack.append((following[0], _from_last(following[0], parts)))
    return order


def _from_last(out: Place, parts: _Parts) -> Iterator[tuple[Place, Value]]:
    return iter(list(reversed(parts.of(out) or [])))
