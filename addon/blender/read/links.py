# SPDX-License-Identifier: GPL-3.0-or-later
"""Links of shader nodes: what feeds a socket, and how its value is converted on the way.

A link is followed through reroutes, groups and muted nodes, and a value is converted
at every socket that it passes, as Cycles does. Values are those of leapray.programs:
numbers, or steps that depend on a texture; a colour or vector is a tuple of three.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from leapray import Value, operate

from ...arrays import LUMINANCE

TRIPLES = ("RGBA", "VECTOR", "ROTATION")
WHOLE = ("INT", "BOOLEAN")
NUMBERS = ("VALUE", *WHOLE, *TRIPLES)

Triple = tuple[Value, Value, Value]
Values = Value | Triple


def triple(parts: Iterable[Value]) -> Triple:
    """A tuple of just three."""
    first, second, third = parts
    return first, second, third


class Unfolded(Exception):
    """A node whose value is not the same everywhere; its words name it."""


class Place(NamedTuple):
    """A socket, and the group nodes around its node, the outermost first."""

    socket: Any  # bpy.types.NodeSocket
    groups: tuple = ()

    @property
    def node(self):
        return self.socket.node

    def input(self, identifier: str) -> Place:
        """An input of the same node, by its identifier: names change between versions."""
        return Place(_by_identifier(self.node.inputs, identifier), self.groups)


class Path(NamedTuple):
    """How an input is fed."""

    source: Place | None  # the output at its start, None where nothing is linked
    end: Place | None  # the input whose own value counts where nothing is linked; None: nothing
    kinds: tuple[str, ...]  # types of sockets that the value passes, in its direction


def tree_of(block):
    """The shader nodes of a material, light or world; None where it does not use them."""
    import bpy

    if bpy.app.version >= (5, 0) or block.use_nodes:  # from 5.0 on they are always used
        return block.node_tree
    return None


def node_tree(block):
    """The shader nodes of a material, light or world, which uses them from now on."""
    import bpy

    if bpy.app.version < (5, 0):
        block.use_nodes = True
    return block.node_tree


def output_of(block) -> Place | None:
    """The surface input of the output node that Cycles would take; None where there is none."""
    tree = tree_of(block)
    output = tree.get_output_node("CYCLES") if tree else None
    if output is None or (inlined() and not _is_inlined(tree, output, block)):
        return None
    return Place(output.inputs["Surface"]) if "Surface" in output.inputs else None


def inlined() -> bool:
    """Whether Blender makes a plain tree of nodes for Cycles: without groups, muted nodes and
    reroutes, what depends on nothing as a value, and none at all of a tree with a circle."""
    import bpy

    return bpy.app.version >= (5, 2)


def _is_inlined(tree, output, block) -> bool:
    kinds = {"LIGHT": "Light", "WORLD": "World"}
    return output.bl_idname == f"ShaderNodeOutput{kinds.get(block.id_type, 'Material')}" and (
        not has_circle(tree)
    )


def has_circle(tree) -> bool:
    """Whether links lead back to their start, here or in a group."""
    trees, seen = [tree], set()
    while trees:
        each = trees.pop()
        if each is None or each in seen:
            continue
        seen.add(each)
        trees += [n.node_tree for n in each.nodes if n.bl_idname == "ShaderNodeGroup"]
        if _goes_round(each):
            return True
    return False


def _goes_round(tree) -> bool:
    """Take away nodes that nothing feeds, until none is left, or a circle."""
    fed: dict[object, int] = {node: 0 for node in tree.nodes}
    feeds: dict[object, list] = {node: [] for node in tree.nodes}
    for link in tree.links:
        if link.from_socket.enabled and link.to_socket.enabled:
            fed[link.to_node] += 1
            feeds[link.from_node].append(link.to_node)
    free = [node for node, n in fed.items() if n == 0]
    for node in free:
        for after in feeds[node]:
            fed[after] -= 1
            if fed[after] == 0:
                free.append(after)
    return len(free) < len(fed)


def path_to(place: Place) -> Path:
    """What feeds an input, through reroutes, groups and muted nodes.

    A way that comes back to itself is not linked. Raises Unfolded for a group that has
    nodes but no such output.
    """
    first, kinds, seen = place, [place.socket.type], {place}
    while True:
        link = next((link for link in place.socket.links if _counts(link)), None)
        if link is None:
            return _unlinked(first, place, kinds)
        found = Place(link.from_socket, place.groups)
        inner = _through(found)
        if inner is None:
            return Path(found, Place(link.to_socket, found.groups), tuple(reversed(kinds)))
        place = inner
        kinds.append(found.socket.type)
        if place in seen:
            return Path(None, None, tuple(reversed(kinds)))
        seen.add(place)
        if not found.node.mute:
            kinds.append(place.socket.type)


def _unlinked(first: Place, last: Place, kinds: list[str]) -> Path:
    """A muted node passes nothing on where it is not linked."""
    if last == first or not _is_gone(last.node):
        return Path(None, last, tuple(reversed(kinds)))
    if inlined():
        return Path(None, first, (first.socket.type,))
    return Path(None, None, tuple(reversed(kinds)))


def _is_gone(node) -> bool:
    return node.mute or node.bl_idname == "NodeReroute"


def _counts(link) -> bool:
    """Whether Cycles follows a link: one in a circle of nodes is not valid."""
    ends = link.from_socket, link.to_socket
    return link.is_valid and not link.is_muted and all(socket.enabled for socket in ends)


def is_used(socket) -> bool:
    """Whether an output feeds anything."""
    return any(_counts(link) for link in socket.links)


def _through(out: Place) -> Place | None:
    """The input that an output passes on, None where its node does more than that."""
    node = out.node
    if node.bl_idname == "NodeReroute":
        return Place(node.inputs[0], out.groups)
    if node.mute:
        inside = next((i for i in node.internal_links if i.to_socket == out.socket), None)
        return Place(inside.from_socket, out.groups) if inside else None
    if node.bl_idname == "ShaderNodeGroup":
        tree = node.node_tree
        ends = [each for each in tree.nodes if each.bl_idname == "NodeGroupOutput"] if tree else []
        if not ends:
            raise Unfolded(f"the empty group {node.name}")
        end = next((each for each in ends if each.is_active_output), ends[0])
        return Place(_by_identifier(end.inputs, out.socket.identifier), (*out.groups, node))
    if node.bl_idname == "NodeGroupInput" and out.groups:
        inputs = out.groups[-1].inputs
        return Place(_by_identifier(inputs, out.socket.identifier), out.groups[:-1])
    return None


def source(place: Place) -> tuple[Place | None, Place | None]:
    """The output that feeds an input, None where nothing does, and the last input on the way.

    Raises Unfolded as path_to does.
    """
    path = path_to(place)
    return path.source, path.end


def _by_identifier(sockets, identifier: str):
    found = next((each for each in sockets if each.identifier == identifier), None)
    if found is None:  # between two updates of a group
        raise Unfolded(f"a socket that is gone ({identifier})")
    return found


def title(node) -> str:
    """What the node's kind is called in Blender's menus."""
    return node.bl_rna.name or node.bl_label


# ---- values ------------------------------------------------------------------


def own_value(place: Place) -> NDArray[np.float64]:
    """What a socket holds itself; 0 for one that holds nothing."""
    return np.array(own_values(place), np.float64)


def own_values(place: Place) -> Values:
    """The same as a value."""
    kind = place.socket.type
    held = getattr(place.socket, "default_value", None)
    if kind in TRIPLES:
        return zero(kind) if held is None else cast(Triple, tuple(map(float, tuple(held)[:3])))
    return float(held) if isinstance(held, int | float) else 0.0


def zero(kind: str) -> Values:
    """Nothing, in the shape of a socket's type."""
    return (0.0, 0.0, 0.0) if kind in TRIPLES else 0.0


def convert(values: Values, kind: str, wanted: str) -> Values:
    """A value between sockets of two types. Raises Unfolded where there is no such way."""
    if kind == wanted:
        return values
    if kind not in NUMBERS or wanted not in NUMBERS:
        raise Unfolded(f"a link from {kind.lower()} to {wanted.lower()}")
    if isinstance(values, tuple) and wanted not in TRIPLES:
        values = luminance(values) if kind == "RGBA" else average(values)
    if wanted in WHOLE and kind not in WHOLE:
        assert not isinstance(values, tuple)
        return operate("trunc", values)
    if wanted in TRIPLES and not isinstance(values, tuple):
        return (values, values, values)
    return values


def luminance(color: Triple) -> Value:
    """Of linear Rec. 709."""
    red, green, blue = (operate("multiply", c, w) for c, w in zip(color, LUMINANCE, strict=True))
    return operate("add", operate("add", red, green), blue)


def average(vector: Triple) -> Value:
    """Of the three parts."""
    both = operate("add", vector[0], vector[1])
    return operate("divide", operate("add", both, vector[2]), 3.0)
