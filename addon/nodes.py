# SPDX-License-Identifier: GPL-3.0-or-later
"""Shader nodes: what feeds a socket, and the values of nodes that depend on nothing.

A node is followed through reroutes, groups and muted nodes. Values are folded
as Cycles computes them: numbers have the shape (...), colours and vectors
(..., 3). One texture may stand among the nodes, as a table of its pixels or of
a mesh's colours: then the nodes after it are applied to the table as a whole.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

LUMINANCE = np.array([0.2126729, 0.7151522, 0.0721750])  # Rec. 709
RAMP = 257  # entries of a ramp's table, as in Cycles


class Unfolded(Exception):
    """A node whose value is not the same everywhere; its words name it."""


class Place(NamedTuple):
    """A socket, and the group nodes around its node, the outermost first."""

    socket: object
    groups: tuple = ()

    @property
    def node(self):
        return self.socket.node

    def input(self, identifier: str) -> Place:
        """An input of the same node, by its identifier: names change between versions."""
        return Place(_by_identifier(self.node.inputs, identifier), self.groups)


def tree_of(block):
    """The shader nodes of a material, light or world; None where it does not use them."""
    import bpy

    if bpy.app.version >= (5, 0) or block.use_nodes:  # from 5.0 on they are always used
        return block.node_tree
    return None


def output_of(block) -> Place | None:
    """The surface input of the output node that Cycles would take; None where there is none."""
    tree = tree_of(block)
    output = tree.get_output_node("CYCLES") if tree else None
    return Place(output.inputs["Surface"]) if output else None


def source(place: Place) -> tuple[Place | None, Place]:
    """The output that feeds an input, None where nothing does, and the last input on the way.

    Raises Unfolded for a group without nodes.
    """
    while True:
        link = next(
            (link for link in place.socket.links if link.is_valid and not link.is_muted), None
        )
        if link is None:
            return None, place
        node, out = link.from_node, link.from_socket
        if node.bl_idname == "NodeReroute":
            place = Place(node.inputs[0], place.groups)
        elif node.mute:
            inside = next((i for i in node.internal_links if i.to_socket == out), None)
            if inside is None:
                return None, place
            place = Place(inside.from_socket, place.groups)
        elif node.bl_idname == "ShaderNodeGroup":
            tree = node.node_tree
            ends = (
                [each for each in tree.nodes if each.bl_idname == "NodeGroupOutput"] if tree else []
            )
            if not ends:
                raise Unfolded(f"the empty group {node.name}")
            end = next((each for each in ends if each.is_active_output), ends[0])
            place = Place(_by_identifier(end.inputs, out.identifier), (*place.groups, node))
        elif node.bl_idname == "NodeGroupInput" and place.groups:
            group = place.groups[-1]
            place = Place(_by_identifier(group.inputs, out.identifier), place.groups[:-1])
        else:
            return Place(out, place.groups), place


def _by_identifier(sockets, identifier: str):
    return next(each for each in sockets if each.identifier == identifier)


def title(node) -> str:
    """What the node's kind is called in Blender's menus."""
    return node.bl_rna.name or node.bl_label


class Folder:
    """Values of sockets. texture(place of the output) gives the table of a texture's values, or
    raises Unfolded; without it every texture does."""

    def __init__(self, texture: Callable[[Place], NDArray] | None = None) -> None:
        self._texture = texture

    def value(self, place: Place) -> NDArray[np.float64]:
        """The value that arrives at an input. Raises Unfolded."""
        found, end = source(place)
        if found is None:
            return own_value(end)
        return _convert(self._of_node(found), found.socket.type, place.socket.type)

    def _of_node(self, out: Place) -> NDArray:
        fold = _FOLDS.get(out.node.bl_idname)
        if fold is not None:
            return fold(self, out)
        if self._texture is None:
            raise Unfolded(title(out.node))
        return self._texture(out)


def own_value(place: Place) -> NDArray[np.float64]:
    """What a socket holds itself; 0 for one that holds nothing."""
    value = getattr(place.socket, "default_value", 0.0)
    if place.socket.type in ("RGBA", "VECTOR", "ROTATION"):
        return np.array(value[:3], np.float64)
    return np.float64(value) if np.isscalar(value) else np.float64(0.0)


def _convert(value: NDArray, kind: str, wanted: str) -> NDArray:
    """A value between sockets of two types."""
    triple, triples = kind in ("RGBA", "VECTOR"), wanted in ("RGBA", "VECTOR")
    if triple and not triples:
        return value @ LUMINANCE if kind == "RGBA" else value.mean(axis=-1)
    if triples and not triple:
        return np.asarray(value)[..., None] * np.ones(3)
    return value


# ---- nodes -------------------------------------------------------------------


def _held(folder: Folder, out: Place) -> NDArray:
    return own_value(out)


def _clamped(value: NDArray, clamp: bool) -> NDArray:
    return np.clip(value, 0.0, 1.0) if clamp else value


def _divide(a, b):
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(b != 0, a / np.where(b != 0, b, 1), 0.0)


_MATH = {
    "ADD": lambda a, b, c: a + b,
    "SUBTRACT": lambda a, b, c: a - b,
    "MULTIPLY": lambda a, b, c: a * b,
    "DIVIDE": lambda a, b, c: _divide(a, b),
    "MULTIPLY_ADD": lambda a, b, c: a * b + c,
    "POWER": lambda a, b, c: np.nan_to_num(np.power(np.maximum(a, 0.0), b)),
    "SQRT": lambda a, b, c: np.sqrt(np.maximum(a, 0.0)),
    "ABSOLUTE": lambda a, b, c: np.abs(a),
    "EXPONENT": lambda a, b, c: np.exp(a),
    "MINIMUM": lambda a, b, c: np.minimum(a, b),
    "MAXIMUM": lambda a, b, c: np.maximum(a, b),
    "LESS_THAN": lambda a, b, c: np.where(a < b, 1.0, 0.0),
    "GREATER_THAN": lambda a, b, c: np.where(a > b, 1.0, 0.0),
    "ROUND": lambda a, b, c: np.floor(a + 0.5),
    "FLOOR": lambda a, b, c: np.floor(a),
    "CEIL": lambda a, b, c: np.ceil(a),
    "FRACT": lambda a, b, c: a - np.floor(a),
    "SINE": lambda a, b, c: np.sin(a),
    "COSINE": lambda a, b, c: np.cos(a),
    "RADIANS": lambda a, b, c: np.radians(a),
    "DEGREES": lambda a, b, c: np.degrees(a),
}


def _math(folder: Folder, out: Place) -> NDArray:
    node = out.node
    if node.operation not in _MATH:
        raise Unfolded(f"{title(node)} ({node.operation.capitalize()})")
    a, b, c = (folder.value(Place(socket, out.groups)) for socket in node.inputs[:3])
    return _clamped(_MATH[node.operation](a, b, c), node.use_clamp)


_BLENDS = {
    "MIX": lambda a, b: b,
    "ADD": lambda a, b: a + b,
    "MULTIPLY": lambda a, b: a * b,
    "SUBTRACT": lambda a, b: a - b,
    "DIVIDE": _divide,
    "SCREEN": lambda a, b: 1 - (1 - a) * (1 - b),
    "DIFFERENCE": lambda a, b: np.abs(a - b),
    "DARKEN": np.minimum,
    "LIGHTEN": np.maximum,
}


def _blend(node, a: NDArray, b: NDArray, factor: NDArray) -> NDArray:
    if node.blend_type not in _BLENDS:
        raise Unfolded(f"{title(node)} ({node.blend_type.replace('_', ' ').capitalize()})")
    return a + (_BLENDS[node.blend_type](a, b) - a) * np.asarray(factor)[..., None]


def _mix(folder: Folder, out: Place) -> NDArray:
    node = out.node
    kind = {"FLOAT": "Float", "VECTOR": "Vector", "RGBA": "Color"}.get(node.data_type)
    if kind is None:
        raise Unfolded(f"{title(node)} ({node.data_type.capitalize()})")
    several = kind == "Vector" and node.factor_mode == "NON_UNIFORM"
    factor = folder.value(out.input("Factor_Vector" if several else "Factor_Float"))
    factor = _clamped(factor, node.clamp_factor)
    a, b = (folder.value(out.input(f"{side}_{kind}")) for side in "AB")
    if kind == "Color":
        return _clamped(_blend(node, a, b, factor), node.clamp_result)
    if kind == "Vector" and not several:
        factor = np.asarray(factor)[..., None]
    return a + (b - a) * factor


def _mix_rgb(folder: Folder, out: Place) -> NDArray:
    factor = np.clip(folder.value(out.input("Fac")), 0.0, 1.0)
    a, b = (folder.value(out.input(name)) for name in ("Color1", "Color2"))
    return _clamped(_blend(out.node, a, b, factor), out.node.use_clamp)


def _gamma(folder: Folder, out: Place) -> NDArray:
    color, gamma = folder.value(out.input("Color")), folder.value(out.input("Gamma"))
    return np.where(color > 0, np.power(np.maximum(color, 1e-30), gamma[..., None]), color)


def _invert(folder: Folder, out: Place) -> NDArray:
    color, factor = folder.value(out.input("Color")), folder.value(out.input("Fac"))
    return color + (1 - 2 * color) * np.asarray(factor)[..., None]


def _bright_contrast(folder: Folder, out: Place) -> NDArray:
    color, bright, contrast = (
        folder.value(out.input(name)) for name in ("Color", "Bright", "Contrast")
    )
    scale, contrast = 1 + contrast[..., None], contrast[..., None]
    return np.maximum(color * scale + bright[..., None] - contrast * 0.5, 0.0)


def _to_gray(folder: Folder, out: Place) -> NDArray:
    return folder.value(out.input("Color")) @ LUMINANCE


def _combine(folder: Folder, out: Place) -> NDArray:
    if getattr(out.node, "mode", "RGB") != "RGB":
        raise Unfolded(f"{title(out.node)} ({out.node.mode})")
    parts = [folder.value(Place(socket, out.groups)) for socket in out.node.inputs[:3]]
    return np.stack(np.broadcast_arrays(*parts), axis=-1)


def _separate(folder: Folder, out: Place) -> NDArray:
    if getattr(out.node, "mode", "RGB") != "RGB":
        raise Unfolded(f"{title(out.node)} ({out.node.mode})")
    channel = list(out.node.outputs).index(out.socket)
    return folder.value(Place(out.node.inputs[0], out.groups))[..., channel]


def _ramp(folder: Folder, out: Place) -> NDArray:
    x = np.clip(folder.value(out.input("Fac")), 0.0, 1.0)
    at = np.linspace(0.0, 1.0, RAMP)
    table = np.array([out.node.color_ramp.evaluate(each) for each in at])
    if out.socket.type != "RGBA":
        return np.interp(x, at, table[:, 3])
    return np.stack([np.interp(x, at, table[:, c]) for c in range(3)], axis=-1)


def _clamp(folder: Folder, out: Place) -> NDArray:
    value, low, high = (folder.value(out.input(name)) for name in ("Value", "Min", "Max"))
    if out.node.clamp_type == "RANGE":
        low, high = np.minimum(low, high), np.maximum(low, high)
    return np.minimum(np.maximum(value, low), high)


def blackbody(kelvin: NDArray) -> NDArray[np.float64]:
    """Linear Rec. 709 of a black body, of luminance 1.

    Source: Cycles' fit, svm_math_blackbody_color_rec709.
    """
    t = np.clip(np.asarray(kelvin, np.float64), 800.0, 12000.0)
    piece = np.searchsorted(_BODY_LIMITS, t, side="right")
    red, green, blue = (table[piece] for table in (_BODY_RED, _BODY_GREEN, _BODY_BLUE))
    r = red[..., 0] / t + red[..., 1] * t + red[..., 2]
    g = green[..., 0] / t + green[..., 1] * t + green[..., 2]
    b = ((blue[..., 0] * t + blue[..., 1]) * t + blue[..., 2]) * t + blue[..., 3]
    return np.stack([r, g, b], axis=-1)


_BODY_LIMITS = np.array([965.0, 1167.0, 1449.0, 1902.0, 3315.0, 6365.0])
_BODY_RED = np.array(
    [
        [1.61919106e3, -2.05010916e-3, 5.02995757],
        [2.48845471e3, -1.11330907e-3, 3.22621544],
        [3.34143193e3, -4.86551192e-4, 1.76486769],
        [4.09461742e3, -1.27446582e-4, 7.25731635e-1],
        [4.67028036e3, 2.91258199e-5, 1.26703442e-1],
        [4.59509185e3, 2.87495649e-5, 1.50345020e-1],
        [3.78717450e3, 9.35907826e-6, 3.99075871e-1],
    ]
)
_BODY_GREEN = np.array(
    [
        [-4.88999748e2, 6.04330754e-4, -7.55807526e-2],
        [-7.55994277e2, 3.16730098e-4, 4.78306139e-1],
        [-1.02363977e3, 1.20223470e-4, 9.36662319e-1],
        [-1.26571316e3, 4.87340896e-6, 1.27054498],
        [-1.42529332e3, -4.01150431e-5, 1.43972784],
        [-1.17554822e3, -2.16378048e-5, 1.30408023],
        [-5.00799571e2, -4.59832026e-6, 1.09098763],
    ]
)
_BODY_BLUE = np.array(
    [
        [5.96945309e-11, -4.85742887e-8, -9.70622247e-5, -4.07936148e-3],
        [2.40430366e-11, 5.55021075e-8, -1.98503712e-4, 2.89312858e-2],
        [-1.40949732e-11, 1.89878968e-7, -3.56632824e-4, 9.10767778e-2],
        [-3.61460868e-11, 2.84822009e-7, -4.93211319e-4, 1.56723440e-1],
        [-1.97075738e-11, 1.75359352e-7, -2.50542825e-4, -2.22783266e-2],
        [-1.61997957e-13, -1.64216008e-8, 3.86216271e-4, -7.38077418e-1],
        [6.72650283e-13, -2.73078809e-8, 4.24098264e-4, -7.52335691e-1],
    ]
)


def _blackbody(folder: Folder, out: Place) -> NDArray:
    return np.maximum(blackbody(folder.value(out.input("Temperature"))), 0.0)


_FOLDS = {
    "ShaderNodeRGB": _held,
    "ShaderNodeValue": _held,
    "ShaderNodeMath": _math,
    "ShaderNodeMix": _mix,
    "ShaderNodeMixRGB": _mix_rgb,
    "ShaderNodeGamma": _gamma,
    "ShaderNodeInvert": _invert,
    "ShaderNodeBrightContrast": _bright_contrast,
    "ShaderNodeRGBToBW": _to_gray,
    "ShaderNodeCombineColor": _combine,
    "ShaderNodeCombineXYZ": _combine,
    "ShaderNodeSeparateColor": _separate,
    "ShaderNodeSeparateXYZ": _separate,
    "ShaderNodeValToRGB": _ramp,
    "ShaderNodeClamp": _clamp,
    "ShaderNodeBlackbody": _blackbody,
}
