# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials: a tree of shader nodes as a short list of weighted lobes.

Mix and Add become weights, as in Cycles' flattened shaders. A colour may come
from one texture for the whole material, an image or the colours of a mesh,
through any nodes that work on colours one by one: these become a program that
runs at every look. What is not understood is told to `notes` once for each
material, and the socket's own value stands in. A material with a value that is
no number is black, and named.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, cast

import numpy as np

from leapray import Step, numbers_of
from leapray._abi import LR_LOBES_MAX

from ... import model
from . import looks
from .links import Triple, Values, tree_of
from .nodes import Folder, Place, Unfolded, output_of, own_value, title
from .shaders import Constants
from .textures import Leaves, Texture

GREY = (0.8, 0.8, 0.8)  # what Blender gives to an empty slot
BLACK = (0.0, 0.0, 0.0)
WHITE = (1.0, 1.0, 1.0)
LEAST = 1e-6  # of a weight: less is nothing
NO_NUMBER = "has a value that is no number (NaN or infinite) and is shown in black"

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


def read(material, notes, images: dict | None = None) -> tuple[model.Material, Texture | None]:
    """The material, and the texture whose colours its lobes marked `textured` are multiplied by.

    images: texels that materials share, kept by the caller while it reads them.
    """
    if material is None:
        return plain("", GREY), None
    if tree_of(material) is None:
        made = plain(material.name, tuple(material.diffuse_color[:3]), material.pass_index)
        return made, None
    made, texture = _Reader(material, notes, {} if images is None else images).read()
    if _is_sound(made):
        return made, texture
    notes.missing("Material", material.name, NO_NUMBER)
    return plain(material.name, BLACK, material.pass_index), None


def _is_sound(material: model.Material) -> bool:
    """Whether all its numbers are such, as f32 holds them."""
    inside = np.array([material.absorption, material.scattering, material.glow])
    if not np.abs(inside).max() <= np.finfo(np.float32).max:  # so of NaN
        return False
    return all(np.isfinite(model.numbers(lobe)).all() for lobe in material.lobes)


def plain(name: str, color, index: int = 0) -> model.Material:
    """A Lambertian material."""
    return model.Material(name, lobes=(model.Lobe("diffuse", color=color),), index=index)


class _Reader(Constants):
    """The lobes of one material."""

    def __init__(self, material, notes, images: dict) -> None:
        super().__init__(material.name, notes)
        self.material, self.images = material, images
        self.lobes: list[model.Lobe] = []
        self.texture: Texture | None = None
        self.image: model.Image | None = None
        self._baked: Place | None = None  # the output whose colours are baked

    def read(self) -> tuple[model.Material, Texture | None]:
        output = output_of(self.material)
        inputs = {} if output is None else output.node.inputs
        displaced = inputs.get("Displacement")
        if displaced and self.source(Place(displaced)):
            self.notes.unsupported("Displacement is", self.material.name)
        inside = looks.read_inside(self, inputs.get("Volume"))
        surfaces = self.flattened(inputs.get("Surface"))
        for out, weight in surfaces:
            self._shader(out, weight)
        bare = inside is not None and not surfaces
        if not self.lobes and not bare:
            self._add("diffuse", 1.0, color=BLACK)
        if len(self.lobes) > LR_LOBES_MAX:
            self.strange[f"more than {LR_LOBES_MAX} shaders"] = None
            self.lobes = sorted(self.lobes, key=lambda lobe: -lobe.weight)[:LR_LOBES_MAX]
        self.tell()
        made = model.Material(
            self.material.name,
            lobes=tuple(self.lobes),
            color_source=self.texture.source if self.texture else "",
            attribute=self.texture.layer if self.texture else "",
            image=self.image,
            index=self.material.pass_index,
            bare=bare,
            **(inside or {}),
        )
        return made, self.texture

    # -- shaders

    def _add(self, kind: str, weight: float, **values) -> None:
        if not weight <= LEAST:
            self.lobes.append(model.Lobe(kind, weight=weight, **values))

    def _shader(self, out: Place, weight: float) -> None:
        """Add the lobes of a shader, or of a colour, which shines by itself."""
        kind = out.node.bl_idname
        if out.socket.type != "SHADER":
            self._glow(weight, 1.0, self._told(lambda folder: folder.color(out), BLACK))
        elif kind in _SHADERS:
            self._idle(out)
            _SHADERS[kind](self, out, weight)
        else:
            self._other(out, weight)

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
            ior=_within(self.number(out, "IOR"), 1e-5, np.inf),
            multiscatter=_multiscatter(out),
            **self._color(out, "Color"),
        )

    def _transparent(self, out: Place, weight: float) -> None:
        self._add("transparent", weight, **self._color(out, "Color"))

    def _emission(self, out: Place, weight: float) -> None:
        power = self.number(out, "Strength")
        if not power <= 0:
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
        alpha = _within(self.number(out, "Alpha"), 0.0, 1.0)
        power = _within(self.number(out, "Emission Strength"), 0.0, np.inf)
        glow = self._color(out, "Emission Color") if power else {"color": BLACK}
        base = self._color(out, "Base Color")
        if glow.get("textured"):
            self._glow(weight * alpha, power, glow)
            glow = {"color": BLACK}
        self._add(
            "principled",
            weight,
            metallic=_within(self.number(out, "Metallic"), 0.0, 1.0),
            roughness=self._roughness(out),
            ior=_within(self.number(out, "IOR"), 1e-5, np.inf),
            multiscatter=_multiscatter(out),
            specular=self._specular(out),
            specular_tint=self._constant(out, "Specular Tint"),
            transmission=_within(self.number(out, "Transmission Weight"), 0.0, 1.0),
            alpha=alpha,
            emission=tuple(power * channel for channel in glow["color"]),
            **base,
        )

    def _specular(self, out: Place) -> float:
        level = self.number(out, "Specular IOR Level")
        if level > 1.0:
            self.strange["Specular IOR Level above 1"] = None
        return _within(level, 0.0, 1.0)

    # -- values

    def _constant(self, out: Place, name: str) -> tuple[float, float, float]:
        return tuple(np.maximum(self.value(out, name), 0.0).tolist())

    def _roughness(self, out: Place) -> float:
        return _within(self.number(out, "Roughness"), 0.0, 1.0)

    def _color(self, out: Place, name: str) -> dict[str, Any]:
        """color and textured of a lobe."""
        place = out.input(name)
        return self._told(lambda folder: folder.values(place), own_value(place).tolist())

    def _told(self, values: Callable[[Folder], Values], else_: Sequence[float]) -> dict:
        """The same of values that a folder gives, else_ where it cannot."""
        leaves = Leaves(self.notes, self.images)
        try:
            color = cast(Triple, values(Folder(leaves.values)))
            if leaves.node is None or not any(isinstance(part, Step) for part in color):
                numbers = cast(model.Color, color)
                return {"color": tuple(np.maximum(numbers, 0.0).tolist())}
            if not np.isfinite(numbers_of(color)).all():
                return {"color": (np.nan,) * 3}
            self._bake(leaves, color)
        except Unfolded as error:
            self.strange[str(error)] = None
            return {"color": tuple(np.maximum(else_, 0.0).tolist())}
        return {"color": WHITE, "textured": True}

    def _bake(self, leaves: Leaves, color: Triple) -> None:
        """Make a colour of a texture the material's. Raises Unfolded for a second one."""
        texture, image = leaves.baked(color)
        if self.texture is not None:
            known = self.texture.same_as(texture) and _same_look(self.image, image)
            if not known:
                raise Unfolded("a second texture")
        else:
            self.texture, self.image = texture, image


def _same_look(a: model.Image | None, b: model.Image | None) -> bool:
    if a is None or b is None:
        return a is b
    keys = [image.program.key if image.program else b"" for image in (a, b)]
    same = (a.interpolation, a.extension) == (b.interpolation, b.extension)
    return same and a.pixels is b.pixels and keys[0] == keys[1]


def _within(value: float, low: float, high: float) -> float:
    """NaN stays, to be found."""
    return value if value != value else min(max(value, low), high)


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
