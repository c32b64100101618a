# SPDX-License-Identifier: GPL-3.0-or-later
"""Values of shader nodes' sockets: numbers, or what a program makes of a texture.

No recursion: trees may be thousands of nodes deep, and share branches.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from leapray import Step

from .links import (
    Place,
    Triple,
    Unfolded,
    Values,
    convert,
    inlined,
    output_of,
    own_value,
    own_values,
    path_to,
    source,
    title,
    zero,
)
from .node_values import NODES, Asking

OF_CYCLES = ("ShaderNodeRGB", "ShaderNodeBlackbody")  # though they hold numbers

__all__ = ["Folder", "Place", "Unfolded", "output_of", "own_value", "source", "title"]


class Folder:
    """Values of sockets. texture(place of the output) gives the values of a texture's output,
    or raises Unfolded; without it every texture does."""

    def __init__(self, texture: Callable[[Place], Values] | None = None) -> None:
        self._texture = texture
        self._made: dict[Place, Values] = {}  # by outputs
        self._under_way: set[Place] = set()
        self._of_cycles: set[Place] = set()  # outputs that Blender does not compute
        self._fed_by_cycles: set[tuple] = set()  # nodes, with their groups, that these feed

    def value(self, place: Place) -> NDArray[np.float64]:
        """The value that arrives at an input and depends on no texture. Raises Unfolded."""
        values = self.values(place)
        parts = values if isinstance(values, tuple) else (values,)
        if any(isinstance(part, Step) for part in parts):
            raise Unfolded("a texture")
        return np.array(values, np.float64)

    def values(self, place: Place) -> Values:
        """The value that arrives at an input. Raises Unfolded."""
        return self._run(self.at(place))

    def color(self, out: Place) -> Triple:
        """The value of an output as a colour. Raises Unfolded."""
        return cast(Triple, convert(self._run(self._of_output(out)), out.socket.type, "RGBA"))

    def _run(self, asking: Asking) -> Values:
        self._under_way.clear()
        stack = [asking]
        result: Any = None  # which a generator starts by
        while stack:
            try:
                stack.append(stack[-1].send(result))
                result = None
            except StopIteration as end:
                stack.pop()
                result = end.value
        return result

    def at(self, place: Place) -> Asking:
        """The same for the values of nodes, which ask for each of their inputs by a yield."""
        path = path_to(place)
        kinds = path.kinds
        if path.source is not None and path.source not in self._under_way:
            kind = path.source.socket.type
            values = yield self._of_output(path.source)
            if path.source in self._of_cycles:
                self._fed_by_cycles.add((place.node, place.groups))
                kinds = kinds[-1:] if inlined() else kinds
        elif path.end is None:
            kind, values = kinds[0], zero(kinds[0])
        else:
            kind, values = path.end.socket.type, own_values(path.end)
        for wanted in kinds:
            values, kind = convert(values, kind, wanted), wanted
        return values

    def by_blender(self, out: Place, *values: Values) -> bool:
        """Whether Blender itself has computed an output of these inputs' values, in its own way,
        before Cycles sees its node: from 5.2 on where they depend on nothing."""
        if not inlined() or (out.node, out.groups) in self._fed_by_cycles:
            return False
        parts = (part for v in values for part in (v if isinstance(v, tuple) else (v,)))
        return not any(isinstance(part, Step) for part in parts)

    def _of_output(self, out: Place) -> Asking:
        if out in self._made:
            return self._made[out]
        node = out.node
        self._under_way.add(out)
        if node.mute:  # and nothing passes it
            values = zero(out.socket.type)
        elif node.bl_idname in NODES:
            values = yield NODES[node.bl_idname](self, out)
        elif self._texture is None:
            raise Unfolded(title(node))
        else:
            values = self._texture(out)
        if node.bl_idname in OF_CYCLES or not self.by_blender(out, values):
            self._of_cycles.add(out)
        self._under_way.discard(out)
        self._made[out] = values
        return values
