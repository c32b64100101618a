# SPDX-License-Identifier: GPL-3.0-or-later
"""Textures among shader nodes: images and the colours of a mesh, and where they are looked up."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from leapray import (
    INPUTS,
    LeapRayError,
    Program,
    Step,
    compile_program,
    inputs_of,
    is_affine,
)

from ... import model
from .images import MISSING, Texels, texels_of
from .links import Triple, Values, average, is_used
from .nodes import Folder, Place, Unfolded, source, title

TEXTURES = ("ShaderNodeTexImage", "ShaderNodeVertexColor", "ShaderNodeAttribute")
INTERPOLATIONS = {"Linear": "linear", "Closest": "closest"}  # the others are cubic


@dataclass(frozen=True)
class Texture:
    """Where the colour that a material bakes comes from, for the meshes that wear it."""

    source: str  # "vertex" | "image"
    layer: str = ""  # the mesh's colour attribute or UV map; "": the one for rendering
    coordinates: str = "UV"  # of an image: "UV" | "Generated" | "Object" | "" (one place)
    matrix: NDArray[np.float32] | None = None  # (4, 4) on the coordinates
    apply: Callable[[NDArray], NDArray] | None = None  # a mesh's colours (.., 4) to those carried
    key: bytes = b""  # what `apply` does
    program: Program | None = None  # a vertex's colours to those of the material, for fields

    def place(self, points: NDArray[np.float32]) -> NDArray[np.float32]:
        """Where in the image the points with these coordinates (.., 3) lie."""
        if self.matrix is None:
            return points
        return points @ self.matrix[:3, :3].T + self.matrix[:3, 3]

    def same_as(self, other: Texture) -> bool:
        """Whether a mesh would carry the same for it."""
        names = ("source", "layer", "coordinates", "key")
        same = all(getattr(self, name) == getattr(other, name) for name in names)
        if self.matrix is None or other.matrix is None:
            return same and self.matrix is other.matrix
        return same and bool((self.matrix == other.matrix).all())


class Leaves:
    """The texture among the nodes of a colour; a second one raises Unfolded.

    images: texels by images' names, shared.
    """

    def __init__(self, notes, images: dict) -> None:
        self.notes, self.images = notes, images
        self.node: Any = None
        self.texels: Texels | None = None
        self._groups: tuple = ()
        self._look: tuple = ()

    def values(self, out: Place) -> Values:
        """The value of a texture's output."""
        node = out.node
        if node.bl_idname not in TEXTURES:
            raise Unfolded(title(node))
        if self.node is not None and (node != self.node or out.groups != self._groups):
            raise Unfolded("a second texture")
        self.node, self._groups = node, out.groups
        if node.bl_idname == "ShaderNodeTexImage":
            return self._of_image(out)
        if getattr(node, "attribute_type", "GEOMETRY") != "GEOMETRY":
            raise Unfolded(f"{title(node)} ({node.attribute_type.capitalize()})")
        return _output(out, INPUTS)

    def _of_image(self, out: Place) -> Values:
        node = out.node
        if node.projection != "FLAT":
            raise Unfolded(f"{title(node)} ({node.projection.capitalize()})")
        if node.image is None:
            return _output(out, (0.0, 0.0, 0.0, 0.0))  # black, as Cycles
        if not self._look:
            self.texels = shared_texels(node.image, self.images, self.notes)
            self._look = (*MISSING, 1.0)
            if self.texels is not None:
                straight = is_used(node.outputs["Alpha"])
                straight = straight and not (self.texels.opaque and node.extension != "CLIP")
                self._look = self.texels.look(straight=straight)
        return _output(out, self._look)

    def baked(self, color: Triple) -> tuple[Texture, model.Image | None]:
        """The texture that gives a colour made of `values`. Raises Unfolded."""
        try:
            if self.texels is None:
                return self._of_corners(color)
            place = Place(self.node.inputs["Vector"], self._groups)
            return coordinates(place, "UV"), look_up(
                self.node, self.texels, color, self.node.extension.lower()
            )
        except LeapRayError as error:
            raise Unfolded(f"so many nodes after {title(self.node)} ({error})") from None

    def _of_corners(self, color: Triple) -> tuple[Texture, model.Image | None]:
        node = self.node
        layer = getattr(node, "layer_name", "") or getattr(node, "attribute_name", "")
        if is_affine(color):  # then it makes no difference what comes first
            program = compile_program(color)
            texture = Texture(
                "vertex", layer, apply=program.paint, key=program.key, program=program
            )
            return texture, None
        inputs = inputs_of(color)
        if len(inputs) > 3:
            raise Unfolded(f"nodes that use all channels of {title(node)}")
        channels = [INPUTS.index(each) for each in inputs]
        program = compile_program(color, inputs)
        chosen = np.array([*channels, 0, 0, 0][:3])
        texture = Texture(
            "vertex",
            layer,
            apply=lambda table: table[..., chosen],
            key=bytes(channels),
            program=compile_program(color),
        )
        return texture, model.Image(layer, None, program=program)


def shared_texels(image, images: dict, notes) -> Texels | None:
    """texels_of an image, once."""
    key = image.name_full
    if key not in images:
        images[key] = texels_of(image, notes)
    return images[key]


def look_up(node, texels: Texels, color: Triple, extension: str) -> model.Image:
    """An image texture's node with what becomes of its colour."""
    rgba = any(each is INPUTS[3] for each in inputs_of(color))
    plain = texels.look(straight=False)
    program: Program | None = None
    if not (texels.plain and _is_plain(color, plain)):
        program = compile_program(color)
    pixels = texels.rgba if rgba else texels.rgb
    return model.Image(
        node.image.name,
        pixels,
        INTERPOLATIONS.get(node.interpolation, "cubic"),
        extension,
        program,
    )


def _is_plain(color: Triple, look: tuple) -> bool:
    """Whether a colour is what is looked up, and nothing else."""
    for got, want in zip(color, look[:3], strict=True):
        if not isinstance(got, Step) or got.operation != want.operation:
            return False
        if got is not want and got.arguments != want.arguments:
            return False
    return True


def _output(out: Place, look: tuple) -> Values:
    """One output of a texture node, from its colour with alpha."""
    if out.socket.name == "Alpha":
        return look[3]
    if out.socket.type == "VALUE":  # Attribute's Factor
        return average(look[:3])
    return tuple(look[:3])


def coordinates(place: Place, default: str) -> Texture:
    """Where an image is looked up. default: coordinates of a socket without a link.

    Raises Unfolded where that is no affine map of UVs or of places in the object.
    """
    matrix = np.eye(4)
    seen = set()
    while True:
        found = source(place)[0]
        if found in seen:
            found = None  # as where a circle is cut
        seen.add(found)
        if not np.isfinite(matrix).all():
            raise Unfolded("coordinates that are no numbers")
        if found is None:
            return Texture("image", "", default, matrix.astype(np.float32))
        node, name = found.node, found.socket.name
        if node.bl_idname == "ShaderNodeMapping":
            matrix = matrix @ mapping(found)
            place, default = found.input("Vector"), ""
        elif node.bl_idname == "ShaderNodeUVMap" and not node.from_instancer:
            return Texture("image", node.uv_map, "UV", matrix.astype(np.float32))
        elif node.bl_idname == "ShaderNodeAttribute" and node.attribute_type == "GEOMETRY":
            return Texture("image", node.attribute_name, "UV", matrix.astype(np.float32))
        elif (
            node.bl_idname == "ShaderNodeTexCoord"
            and name in ("UV", "Generated", "Object")
            and not node.from_instancer
            and not (name == "Object" and node.object)
        ):
            return Texture("image", "", name, matrix.astype(np.float32))
        else:
            raise Unfolded(f"{title(node)} ({name})")


def mapping(out: Place) -> NDArray[np.float64]:
    """The matrix of a Mapping node. Raises Unfolded where it is no constant one."""
    from mathutils import Euler, Matrix

    kind = out.node.vector_type
    fold = Folder().value
    turn, scale = fold(out.input("Rotation")), fold(out.input("Scale"))
    shift = fold(out.input("Location")) if kind in ("POINT", "TEXTURE") else np.zeros(3)
    matrix = np.array(Matrix.LocRotScale(shift.tolist(), Euler(turn.tolist()), scale.tolist()))
    if kind in ("POINT", "VECTOR"):
        return matrix
    if kind == "NORMAL":
        raise Unfolded(f"{title(out.node)} (Normal)")
    scale = np.where(scale != 0, scale, 1.0)
    matrix = np.array(Matrix.LocRotScale(shift.tolist(), Euler(turn.tolist()), scale.tolist()))
    return np.linalg.inv(matrix)
