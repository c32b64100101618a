# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials: a tree of shader nodes as a short list of weighted lobes.

Mix and Add become weights, as in Cycles' flattened shaders. A colour may come
from one texture for the whole material, an image or the colours of a mesh,
through any nodes that work on colours one by one: these are applied to the
pixels, or to the mesh's colours, before they are baked. What is not understood
is told to `notes` once for each material, and the socket's own value stands in.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from . import model
from .images import MISSING, pixels_of
from .nodes import Folder, Place, Unfolded, output_of, own_value, source, title

GREY = (0.8, 0.8, 0.8)  # what Blender gives to an empty slot
BLACK = (0.0, 0.0, 0.0)
WHITE = (1.0, 1.0, 1.0)
LEAST = 1e-6  # of a weight: less is nothing
MOST = 8  # lobes, in the core
TEXTURES = ("ShaderNodeTexImage", "ShaderNodeVertexColor", "ShaderNodeAttribute")
EXTENSIONS = {"REPEAT": "repeat", "EXTEND": "extend", "CLIP": "clip", "MIRROR": "mirror"}

# Inputs of nodes that change nothing while they have this value and are not linked.
IDLE = {
    "Subsurface Weight": 0.0,
    "Coat Weight": 0.0,
    "Sheen Weight": 0.0,
    "Anisotropic": 0.0,
    "Anisotropy": 0.0,
    "Thin Film Thickness": 0.0,
    "Diffuse Roughness": 0.0,
    "Thin Wall": 0.0,
}


@dataclass(frozen=True)
class Texture:
    """Where the colour that a material bakes comes from, for the meshes that wear it."""

    source: str  # "vertex" | "image"
    layer: str = ""  # the mesh's colour attribute or UV map; "": the one for rendering
    coordinates: str = "UV"  # of an image: "UV" | "Generated" | "Object" | "" (one place)
    matrix: NDArray[np.float32] | None = None  # (4, 4) on the coordinates
    apply: Callable[[NDArray], NDArray] | None = None  # a mesh's colours (.., 4) to those baked

    def place(self, points: NDArray[np.float32]) -> NDArray[np.float32]:
        """Where in the image the points with these coordinates (.., 3) lie."""
        if self.matrix is None:
            return points
        return points @ self.matrix[:3, :3].T + self.matrix[:3, 3]


def read(material, notes, images: dict | None = None) -> tuple[model.Material, Texture | None]:
    """The material, and the texture whose colours its lobes marked `textured` are multiplied by.

    images: pixels that materials share, kept by the caller while it reads them.
    """
    if material is None:
        return plain("", GREY), None
    output = output_of(material)
    if output is None:
        made = plain(material.name, tuple(material.diffuse_color[:3]), material.pass_index)
        return made, None
    return _Reader(material, output, notes, {} if images is None else images).read()


def plain(name: str, color, index: int = 0) -> model.Material:
    """A Lambertian material."""
    return model.Material(name, lobes=(model.Lobe("diffuse", color=color),), index=index)


class _Reader:
    """Walks the shaders of one material."""

    def __init__(self, material, output: Place, notes, images: dict) -> None:
        self.material, self.output, self.notes = material, output, notes
        self.images = images
        self.lobes: list[model.Lobe] = []
        self.strange: dict[str, None] = {}  # what is not understood, in order
        self.texture: Texture | None = None
        self.image: model.Image | None = None
        self._baked: Place | None = None  # the output whose colours are baked

    def read(self) -> tuple[model.Material, Texture | None]:
        inputs = self.output.node.inputs
        if source(Place(inputs["Displacement"]))[0]:
            self.notes.unsupported("Displacement is", self.material.name)
        volume = self._source(Place(inputs["Volume"]))
        absorption = self._absorption(volume) if volume else np.zeros(3)
        surface = self._source(self.output)
        if surface:
            self._shader(surface, 1.0)
        elif volume:
            self._add("transparent", 1.0, color=WHITE)
        if not self.lobes:
            self._add("diffuse", 1.0, color=BLACK)
        if len(self.lobes) > MOST:
            self.strange[f"more than {MOST} shaders"] = None
            self.lobes = sorted(self.lobes, key=lambda lobe: -lobe.weight)[:MOST]
        if self.strange:
            self.notes.strange(tuple(self.strange), self.material.name)
        made = model.Material(
            self.material.name,
            lobes=tuple(self.lobes),
            color_source=self.texture.source if self.texture else "",
            attribute=self.texture.layer if self.texture else "",
            image=self.image,
            absorption=tuple(absorption.tolist()),
            index=self.material.pass_index,
        )
        return made, self.texture

    def _source(self, place: Place) -> Place | None:
        try:
            return source(place)[0]
        except Unfolded as error:
            self.strange[str(error)] = None
            return None

    # -- shaders

    def _add(self, kind: str, weight: float, **values) -> None:
        if weight > LEAST:
            self.lobes.append(model.Lobe(kind, weight=weight, **values))

    def _shader(self, out: Place, weight: float) -> None:
        """Add the lobes of a shader's output."""
        if weight <= LEAST:
            return
        kind = out.node.bl_idname
        if kind == "ShaderNodeMixShader":
            share = min(max(self._number(out, "Fac"), 0.0), 1.0)
            self._inner(out, "Shader", weight * (1.0 - share))
            self._inner(out, "Shader_001", weight * share)
        elif kind == "ShaderNodeAddShader":
            self._inner(out, "Shader", weight)
            self._inner(out, "Shader_001", weight)
        elif kind in _SHADERS:
            self._idle(out)
            _SHADERS[kind](self, out, weight)
        else:
            self._other(out, weight)

    def _inner(self, out: Place, name: str, weight: float) -> None:
        found = self._source(out.input(name))
        if found:
            self._shader(found, weight)

    def _idle(self, out: Place) -> None:
        """Note the inputs that are set and not understood."""
        for socket in out.node.inputs:
            if socket.identifier == "Normal" and socket.is_linked:
                self.strange["Normal"] = None
            idle = IDLE.get(socket.identifier)
            if idle is not None and (socket.is_linked or socket.default_value != idle):
                self.strange[socket.name] = None
        rough = getattr(out.node, "distribution", "GGX") not in ("GGX", "MULTI_GGX")
        if rough and self._roughness(out) > 0:
            self.strange[f"{title(out.node)} ({out.node.distribution.capitalize()})"] = None

    def _other(self, out: Place, weight: float) -> None:
        """A shader that is not understood: a diffuse one of its colour."""
        self.strange[title(out.node)] = None
        names = {socket.identifier for socket in out.node.inputs if socket.type == "RGBA"}
        name = next((each for each in ("Base Color", "Color") if each in names), None)
        if name is None:
            self._add("diffuse", weight, color=tuple(self.material.diffuse_color[:3]))
        else:
            self._add("diffuse", weight, **self._color(out, name))

    def _diffuse(self, out: Place, weight: float) -> None:
        self._add("diffuse", weight, roughness=self._roughness(out), **self._color(out, "Color"))

    def _glossy(self, out: Place, weight: float) -> None:
        more = {"roughness": self._roughness(out), "multiscatter": _multiscatter(out)}
        self._add("glossy", weight, **more, **self._color(out, "Color"))

    def _glass(self, out: Place, weight: float) -> None:
        kind = "glass" if out.node.bl_idname == "ShaderNodeBsdfGlass" else "refraction"
        self._add(
            kind,
            weight,
            roughness=self._roughness(out),
            ior=max(self._number(out, "IOR"), 1e-5),
            multiscatter=_multiscatter(out),
            **self._color(out, "Color"),
        )

    def _transparent(self, out: Place, weight: float) -> None:
        self._add("transparent", weight, **self._color(out, "Color"))

    def _emission(self, out: Place, weight: float) -> None:
        power = self._number(out, "Strength")
        if power > 0:
            self._glow(weight, power, self._color(out, "Color"))

    def _glow(self, weight: float, power: float, told: dict) -> None:
        color = tuple(power * channel for channel in told["color"])
        if any(color):
            self._add("emission", weight, **{**told, "color": color})

    def _metallic(self, out: Place, weight: float) -> None:
        if out.node.fresnel_type != "F82":
            self.strange["Metallic BSDF (Physical Conductor)"] = None
        self._add(
            "principled",
            weight,
            metallic=1.0,
            roughness=self._roughness(out),
            multiscatter=_multiscatter(out),
            specular_tint=self._constant(out, "Edge Tint"),
            **self._color(out, "Base Color"),
        )

    def _principled(self, out: Place, weight: float) -> None:
        alpha = min(max(self._number(out, "Alpha"), 0.0), 1.0)
        power = max(self._number(out, "Emission Strength"), 0.0)
        glow = self._color(out, "Emission Color") if power else {"color": BLACK}
        base = self._color(out, "Base Color")
        if glow.get("textured"):
            self._glow(weight * alpha, power, glow)
            glow = {"color": BLACK}
        self._add(
            "principled",
            weight,
            metallic=min(max(self._number(out, "Metallic"), 0.0), 1.0),
            roughness=self._roughness(out),
            ior=max(self._number(out, "IOR"), 1e-5),
            multiscatter=_multiscatter(out),
            specular=max(self._number(out, "Specular IOR Level"), 0.0),
            specular_tint=self._constant(out, "Specular Tint"),
            transmission=min(max(self._number(out, "Transmission Weight"), 0.0), 1.0),
            alpha=alpha,
            emission=tuple(power * channel for channel in glow["color"]),
            **base,
        )

    # -- volume

    def _absorption(self, out: Place) -> NDArray[np.float64]:
        """What a metre of the inside takes away, as a coefficient."""
        kind = out.node.bl_idname
        if kind == "ShaderNodeVolumeAbsorption":
            color = np.clip(self._constant(out, "Color"), 0.0, 1.0)
            return max(self._number(out, "Density"), 0.0) * (1.0 - color)
        if kind == "ShaderNodeAddShader":
            parts = (self._source(out.input(name)) for name in ("Shader", "Shader_001"))
            return sum((self._absorption(each) for each in parts if each), np.zeros(3))
        self.strange[title(out.node)] = None
        return np.zeros(3)

    # -- values

    def _value(self, out: Place, name: str) -> NDArray[np.float64]:
        place = out.input(name)
        try:
            return Folder().value(place)
        except Unfolded as error:
            self.strange[str(error)] = None
            return own_value(place)

    def _number(self, out: Place, name: str) -> float:
        return float(self._value(out, name))

    def _constant(self, out: Place, name: str) -> tuple[float, float, float]:
        return tuple(np.maximum(self._value(out, name), 0.0).tolist())

    def _roughness(self, out: Place) -> float:
        return min(max(self._number(out, "Roughness"), 0.0), 1.0)

    def _color(self, out: Place, name: str) -> dict[str, object]:
        """color and textured of a lobe."""
        place = out.input(name)
        try:
            return {"color": tuple(np.maximum(Folder().value(place), 0.0).tolist())}
        except Unfolded:
            pass
        try:
            return self._textured(place)
        except Unfolded as error:
            self.strange[str(error)] = None
            return {"color": tuple(np.maximum(own_value(place), 0.0).tolist())}

    def _textured(self, place: Place) -> dict[str, object]:
        """A colour from a texture, which becomes the material's; raises Unfolded."""
        end = source(place)[0]
        if self._baked is not None:
            if self._baked != end:
                raise Unfolded("a second texture")
            return {"color": WHITE, "textured": True}
        leaves = _Leaves(self.notes, self.images)
        values = Folder(leaves.table).value(place)
        if values.ndim < 2:  # of a texture that is not there
            return {"color": tuple(np.maximum(values, 0.0).tolist())}
        self.texture = leaves.texture(lambda table: _recolor(place, table))
        if leaves.image is not None:
            self.image = model.Image(
                leaves.image.name,
                leaves.pixels.textured(values),
                interpolation="closest" if leaves.node.interpolation == "Closest" else "linear",
                extension=EXTENSIONS[leaves.node.extension],
            )
        self._baked = end
        return {"color": WHITE, "textured": True}


def _multiscatter(out: Place) -> bool:
    return getattr(out.node, "distribution", "") == "MULTI_GGX"


_SHADERS = {
    "ShaderNodeBsdfPrincipled": _Reader._principled,
    "ShaderNodeBsdfDiffuse": _Reader._diffuse,
    "ShaderNodeBsdfAnisotropic": _Reader._glossy,
    "ShaderNodeBsdfGlossy": _Reader._glossy,
    "ShaderNodeBsdfGlass": _Reader._glass,
    "ShaderNodeBsdfRefraction": _Reader._glass,
    "ShaderNodeBsdfTransparent": _Reader._transparent,
    "ShaderNodeBsdfMetallic": _Reader._metallic,
    "ShaderNodeEmission": _Reader._emission,
}


# ---- textures ----------------------------------------------------------------


class _Leaves:
    """The texture among the nodes of a colour; a second one raises Unfolded."""

    def __init__(self, notes, images: dict) -> None:
        self.notes, self.images = notes, images
        self.node, self.image, self.pixels = None, None, None
        self._groups: tuple = ()

    def table(self, out: Place) -> NDArray:
        """Values of a texture's output: of all pixels (h, w, ...), of one colour (1, ...)."""
        node = out.node
        if node.bl_idname not in TEXTURES:
            raise Unfolded(title(node))
        if self.node is not None and (node != self.node or out.groups != self._groups):
            raise Unfolded("a second texture")
        self.node, self._groups = node, out.groups
        if node.bl_idname != "ShaderNodeTexImage":
            if getattr(node, "attribute_type", "GEOMETRY") != "GEOMETRY":
                raise Unfolded(f"{title(node)} ({node.attribute_type.capitalize()})")
            return _output(out, np.ones((1, 4)))
        if node.projection != "FLAT":
            raise Unfolded(f"{title(node)} ({node.projection.capitalize()})")
        if node.image is None:
            return np.zeros(()) if out.socket.type == "VALUE" else np.zeros(3)  # black, as Cycles
        if self.pixels is None:
            key = node.image.name_full, node.outputs["Alpha"].is_linked
            if key not in self.images:
                self.images[key] = pixels_of(node.image, self.notes, straight=key[1])
            self.pixels = self.images[key]
        if self.pixels is None:
            return np.ones(()) if out.socket.type == "VALUE" else np.array(MISSING)
        self.image = node.image
        return _output(out, self.pixels.linear)

    def texture(self, apply: Callable) -> Texture:
        if self.image is None:
            node = self.node
            layer = getattr(node, "layer_name", "") or getattr(node, "attribute_name", "")
            return Texture("vertex", layer, apply=apply)
        return coordinates(Place(self.node.inputs["Vector"], self._groups), "UV")


def _output(out: Place, table: NDArray) -> NDArray:
    """One output of a texture node, from its colours with alpha."""
    if out.socket.name == "Alpha":
        return table[..., 3]
    if out.socket.type == "VALUE":  # Attribute's Factor
        return table[..., :3].mean(axis=-1)
    return table[..., :3]


def _recolor(place: Place, table: NDArray[np.float32]) -> NDArray[np.float32]:
    """The colours of a mesh (.., 4) as they arrive at a socket (.., 3)."""
    values = Folder(lambda out: _output(out, table)).value(place)
    return np.maximum(values, 0.0).astype(np.float32)


def coordinates(place: Place, default: str) -> Texture:
    """Where an image is looked up. default: coordinates of a socket without a link.

    Raises Unfolded where that is no affine map of UVs or of places in the object.
    """
    matrix = np.eye(4)
    while True:
        found = source(place)[0]
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
