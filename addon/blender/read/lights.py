# SPDX-License-Identifier: GPL-3.0-or-later
"""Lights and worlds in the core's units.

Blender's units, as measured on a white diffuse plane in Cycles: a sun of
strength S gives S watts per square metre on a plane that faces it; a point or
spot light of P watts a radiant intensity of P / 4 pi on its axis; an area light
of P watts on an area A, the object's scale included, the radiance P / (pi A).
Lights that are not normalized have the radiance that they would have at a
radius of 1 m, an area of 1 m2. The radius of a sphere does not grow with its
object. `notes` are told what is not followed.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from leapray import Step, Value, numbers_of

from ... import model
from .images import MISSING, Texels
from .links import Triple, Values, own_values, tree_of
from .node_values import each
from .nodes import Folder, Place, Unfolded, output_of, title
from .shaders import Walk, flattened
from .textures import coordinates, look_up, shared_texels

RAYS = ("camera", "diffuse", "glossy", "transmission", "volume_scatter")
EVEN = 1e-3  # scales of an object that differ by less are taken as one
TURN = 1e-4  # a matrix that is no rotation by more than this is not one


def of_light(light, matrix: NDArray[np.float64], shown: list, name: str, notes):
    """The light in the world; None for one that gives no light.

    matrix: world from object, with axes that are not 0. shown: the objects whose
    flags must all let it be seen.
    """
    kind = light.type.lower()
    cycles = getattr(light, "cycles", None)
    if kind == "area" and cycles and cycles.is_portal:
        notes.unsupported("Light portals are", name)
        return None
    color = _color(light, name, notes)
    lengths = np.linalg.norm(matrix[:3, :3], axis=0)
    axes = matrix[:3, :3] / np.where(lengths > 0, lengths, 1.0)
    sun = kind == "sun"
    more: dict[str, Any] = {"angle": light.angle} if sun else {}
    if kind == "area":
        u, v = _sides(light, matrix)
        area = np.linalg.norm(u) * np.linalg.norm(v)  # though it is sheared, as Cycles takes it
        if light.shape in ("DISK", "ELLIPSE"):
            area *= math.pi / 4
        if not area or not np.cross(u, v).any():
            notes.skipped("it is an area light without an area", name)
            return None
        color /= math.pi * (area if light.normalize else 1.0)
        more = {
            "axis_u": _tuple(u),
            "axis_v": _tuple(v),
            "shape": "ellipse" if light.shape in ("DISK", "ELLIPSE") else "rectangle",
            "angle": light.spread,
        }
    elif not sun:
        radius = light.shadow_soft_size
        color *= 1 / (4 * math.pi) if light.normalize else radius**2 or 1 / math.pi
        more = {"radius": radius, "shape": "disc" if light.use_soft_falloff else "sphere"}
        if kind == "spot":
            more |= {"angle": light.spot_size, "blend": light.spot_blend}
            if lengths.max() > lengths.min() * (1 + EVEN):
                notes.unsupported("Spot lights with uneven scales are", name)
    elif not light.normalize and light.angle > 0:  # energy is then the disk's radiance
        color *= np.pi * np.sin(min(light.angle, np.pi) / 2) ** 2
    seen: dict[str, Any] = {
        f"visible_{ray}": all(getattr(o, f"visible_{ray}") for o in shown) for ray in RAYS
    }
    if not color.any() or not any(seen.values()):
        return None
    found = model.Light(
        name=name,
        kind=kind,
        color=_tuple(color),
        position=_tuple(matrix[:3, 3]),
        direction=_tuple(axes[:, 2] if sun else -axes[:, 2]),
        casts_shadow=light.use_shadow,
        max_bounces=getattr(cycles, "max_bounces", model.Light.max_bounces),
        **seen,
        **more,
    )
    if not np.isfinite(model.numbers(found)).all():
        notes.skipped("its strength, its place or its size is not a finite number", name)
        return None
    return found


def _sides(light, matrix: NDArray[np.float64]) -> tuple[NDArray, NDArray]:
    """The whole sides or diameters of an area light."""
    across = light.size_y if light.shape in ("RECTANGLE", "ELLIPSE") else light.size
    return matrix[:3, 0] * light.size, matrix[:3, 1] * across


def _tuple(values: NDArray | Triple) -> tuple[float, float, float]:
    return tuple(np.asarray(values, np.float64).tolist())


def _color(light, name: str, notes) -> NDArray[np.float64]:
    """Energy times color, by the light's panel and its nodes."""
    with np.errstate(over="ignore", invalid="ignore"):
        color = light.energy * np.exp2(light.exposure) * np.array(light.color, np.float64)
    if light.use_temperature:
        color *= light.temperature_color
    output = output_of(light)
    if output is None and tree_of(light) is not None:
        return np.zeros(3)
    if output:
        shader = _Emitters(Folder(_falloff), name, notes)
        color *= shader.sum(output)
        shader.tell()
    return color


def _falloff(out: Place) -> Values:
    """A Light Falloff node where it is the physical one."""
    if out.node.bl_idname != "ShaderNodeLightFalloff" or out.socket.name != "Quadratic":
        raise Unfolded(f"{title(out.node)} ({out.socket.name})")
    return Folder().values(out.input("Strength"))


def of_world(world, notes) -> model.World:
    """The world as its nodes describe it, a colour or an image by longitude and latitude."""
    if world is None:
        return model.World()
    flags = getattr(world, "cycles_visibility", None)  # where Blender has Cycles
    seen: dict[str, Any] = {
        f"visible_{ray}": getattr(flags, ray.removeprefix("volume_"), True) for ray in RAYS
    }
    limit = model.World.max_bounces
    seen["max_bounces"] = getattr(getattr(world, "cycles", None), "max_bounces", limit)
    output = output_of(world)
    if output is None:
        color = (0.0, 0.0, 0.0) if tree_of(world) else tuple(world.color)
        return _checked(model.World(color, **seen), world.name, notes)
    sky = _Sky(notes)
    shader = _Emitters(Folder(sky.values), world.name, notes)
    volume = output.node.inputs.get("Volume")
    if volume and shader.source(Place(volume)):
        notes.unsupported("Volumes are", world.name)
    radiance = shader.sum(output)
    shader.tell()
    if not any(isinstance(part, Step) for part in radiance):
        return _checked(model.World(_tuple(radiance), **seen), world.name, notes)
    if not np.isfinite(numbers_of(radiance)).all():
        return _checked(model.World((np.inf,) * 3, **seen), world.name, notes)
    assert sky.texels is not None  # on which the radiance depends
    return model.World(
        (1.0, 1.0, 1.0),
        image=look_up(sky.node, sky.texels, radiance, "repeat"),
        image_from_world=tuple(_tuple(row) for row in sky.rotation),
        **seen,
    )


def _checked(world: model.World, name: str, notes) -> model.World:
    """The world, if its numbers are finite; black, and noted, where its color is not."""
    with np.errstate(over="ignore"):
        if not np.isfinite(np.array(world.color, np.float32)).all():
            notes.skipped("its strength is not a finite number", name)
            return dataclasses.replace(world, color=(0.0, 0.0, 0.0))
    return world


class _Emitters(Walk):
    """The sum of the emitting shaders at an output."""

    def __init__(self, folder: Folder, name: str, notes) -> None:
        super().__init__(name, notes)
        self.folder = folder

    def sum(self, place: Place) -> Triple:
        total: Triple = (0.0, 0.0, 0.0)
        for out, weight in flattened(place, self.source, self._factor):
            total = each("multiply_add", self._of(out), weight, total)
        return total

    def _factor(self, out: Place) -> Value:
        return cast(Value, self._value(out.input("Fac")))

    def _of(self, out: Place) -> Triple:
        """What a shader shines, or a colour, by itself."""
        if out.node.bl_idname in ("ShaderNodeEmission", "ShaderNodeBackground"):
            color, strength = (self._value(out.input(name)) for name in ("Color", "Strength"))
            return each("multiply", color, strength)
        if out.socket.type != "SHADER":
            try:
                return self.folder.color(out)
            except Unfolded as error:
                self.strange[str(error)] = None
                return (0.0, 0.0, 0.0)
        self.strange[title(out.node)] = None
        return (0.0, 0.0, 0.0)

    def _value(self, place: Place) -> Values:
        try:
            return self.folder.values(place)
        except Unfolded as error:
            self.strange[str(error)] = None
            return own_values(place)


class _Sky:
    """The environment texture among a world's nodes; a second one raises Unfolded."""

    def __init__(self, notes) -> None:
        self.notes, self.rotation = notes, np.eye(3)
        self.node: Any = None
        self.texels: Texels | None = None
        self._seen: tuple | None = None
        self._look: Triple = (0.0, 0.0, 0.0)

    def values(self, out: Place) -> Values:
        node = out.node
        if node.bl_idname != "ShaderNodeTexEnvironment":
            raise Unfolded(title(node))
        if self._seen not in (None, (node, out.groups)):
            raise Unfolded("a second texture")
        if node.projection != "EQUIRECTANGULAR":
            raise Unfolded(f"{title(node)} (Mirror Ball)")
        if node.image is None:
            return (0.0, 0.0, 0.0)  # black, as in Cycles
        if self._seen is None:
            self._turn(out)
            self.node, self._seen = node, (node, out.groups)
            self.texels = shared_texels(node.image, {}, self.notes)
            self._look = MISSING
            if self.texels is not None:
                self._look = self.texels.look(straight=False)[:3]
        return self._look

    def _turn(self, out: Place) -> None:
        turn = coordinates(Place(out.node.inputs["Vector"], out.groups), "Generated")
        matrix = np.asarray(turn.matrix, np.float64)
        self.rotation = matrix[:3, :3]
        if (
            turn.coordinates not in ("Generated", "Object")
            or np.abs(self.rotation @ self.rotation.T - np.eye(3)).max() > TURN
            or matrix[:3, 3].any()
        ):
            raise Unfolded(f"{title(out.node)} (Vector)")
