# SPDX-License-Identifier: GPL-3.0-or-later
"""The settings of a scene, `scene.leapray`: one property for each of settings.Settings.

A property is named as its option of the command line; `settings` says what it is. Only
the number of threads is Blender's (Performance panel, `blender -t`), as for its other
engines. Where 0 stands for "automatic" or "off", a switch that is not stored says so.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import Any

import bpy

import leapray

from .. import model
from ..descriptions import Choice, Setting, Switch, described
from ..settings import Isosurfaces
from . import result

PATHS = "FILE_PATH", "DIR_PATH"
RELATIVE = "PATH_SUPPORTS_BLEND_RELATIVE"  # a path may begin with //


def menu(choices: Iterable[Choice]) -> list[tuple]:
    """Items of an EnumProperty."""
    return [
        (each.name, each.label, each.tooltip, each.number)
        if each.name
        else ("", each.label, each.tooltip)
        for each in choices
    ]


def of(setting: Setting, **more: Any) -> Any:
    """The property of a setting; more: what else Blender is told of it."""
    told: dict[str, Any] = {"name": setting.label, "description": setting.tooltip, **more}
    if setting.choices:
        default = setting.default or setting.choices[0].name
        return bpy.props.EnumProperty(items=menu(setting.choices), default=default, **told)
    if setting.object_types:
        types = setting.object_types
        told["poll"] = lambda _, ob: ob.type in types
        return bpy.props.PointerProperty(type=bpy.types.Object, **told)
    told["default"] = setting.default
    if setting.kind is bool:
        return bpy.props.BoolProperty(**told)
    told["subtype"] = setting.unit
    if setting.kind is str:
        if setting.unit in PATHS:
            told["options"] = {RELATIVE}
        return bpy.props.StringProperty(**told)
    limits = {
        "min": setting.minimum,
        "max": setting.maximum,
        "soft_min": setting.soft_minimum,
        "soft_max": setting.soft_maximum,
    }
    told |= {name: limit for name, limit in limits.items() if limit is not None}
    if setting.kind is float:
        return bpy.props.FloatProperty(precision=setting.digits, **told)
    return bpy.props.IntProperty(**told)


def of_all(owner: type, **more: Any) -> dict[str, Any]:
    """The properties of a dataclass's settings and of their switches; more: as for `of`."""
    made = {}
    for name, setting in described(owner).items():
        if not setting.in_blender:
            continue
        made[name] = of(setting, **more)
        if setting.zero is not None:
            kind = "auto" if setting.zero.automatic else "use"
            made[f"{kind}_{name}"] = switch(name, setting.zero)
    return made


def switch(name: str, told: Switch) -> Any:
    """A check box that stands for 0, ticked where the setting is automatic, or not off."""

    def ticked(self) -> bool:
        return (getattr(self, name) == 0) == told.automatic

    def tick(self, value: bool) -> None:
        at_zero = value == told.automatic
        setattr(self, name, 0 if at_zero else getattr(self, name) or told.on)

    return bpy.props.BoolProperty(
        name=told.label, description=told.tooltip, get=ticked, set=tick, options={"SKIP_SAVE"}
    )


class LeapRaySettings(bpy.types.PropertyGroup):
    """What LeapRay renders with."""

    __annotations__ = of_all(model.Settings)


class LeapRayObject(bpy.types.PropertyGroup):
    """How LeapRay models an object, where that is not left to the scene."""

    __annotations__ = of_all(model.Modelling)


class LeapRayVolume(bpy.types.PropertyGroup):
    """Which surfaces of a volume's data LeapRay renders."""

    __annotations__ = of_all(Isosurfaces, update=lambda own, _: own.id_data.update_tag())


class LeapRayViewLayer(bpy.types.PropertyGroup):
    """LeapRay's own passes of a view layer."""

    __annotations__ = {
        each.switch: bpy.props.BoolProperty(name=each.name, description=each.own)
        for each in result.PASSES
        if each.own
    }


def modelling(ob) -> model.Modelling:
    """How the object wants to be modelled, as plain values; unknown choices are the scene's."""
    own = ob.leapray
    names = ("" if name == "scene" else name for name in (own.filter, own.sample_type))
    return model.Modelling(own.kind or "auto", own.resolution, *names)


def isosurfaces(volume) -> Isosurfaces:
    """Which surfaces of its data a volume wants, as plain values."""
    return Isosurfaces(**{name: getattr(volume.leapray, name) for name in described(Isosurfaces)})


def apply(scene, values: dict[str, object]) -> None:
    """Give settings of the scene these values, by the names of model.Settings."""
    for name, value in values.items():
        setattr(scene.leapray, name, value)


def settings(scene, view_layer=None) -> model.Settings:
    """The scene's settings as plain values, with the view layer's own number of samples.

    Raises LeapRayError for a choice that this LeapRay does not know, as from the
    file of a newer one: Blender reads it as an empty name.
    """
    values = {
        name: getattr(scene.leapray, name)
        for name, setting in described(model.Settings).items()
        if setting.in_blender
    }
    for name, value in values.items():
        known = scene.leapray.bl_rna.properties[name]
        if value == "" and known.type == "ENUM":
            label = known.name
            raise leapray.LeapRayError(
                f"The {label} stored in scene {scene.name} is unknown to LeapRay "
                f"{leapray.__version__}; choose one in the Render properties"
            )
    values["cache_folder"] = os.path.expanduser(bpy.path.abspath(values["cache_folder"]))
    if view_layer is not None:
        values["samples"] = _samples_of(view_layer, scene, values["samples"])
    fixed = scene.render.threads_mode == "FIXED"
    return model.Settings(**values, threads=scene.render.threads if fixed else 0)


def _samples_of(view_layer, scene, samples: int) -> int:
    """What the view layer's own number of samples makes of the scene's; 0: it has none.

    Cycles' setting says whether it overrides the scene's, bounds it, or is ignored.
    """
    use = getattr(getattr(scene, "cycles", None), "use_layer_samples", "USE")
    own = 0 if use == "IGNORE" else view_layer.samples
    return min(samples, own or samples) if use == "BOUNDED" else own or samples


OWNERS = (  # the type that has `leapray`, the properties, what the user is told
    (bpy.types.Scene, LeapRaySettings, "Settings of the LeapRay engine"),
    (bpy.types.Object, LeapRayObject, "How LeapRay models the object"),
    (bpy.types.Volume, LeapRayVolume, "Which surfaces of the data LeapRay renders"),
    (bpy.types.ViewLayer, LeapRayViewLayer, "LeapRay's own passes"),
)


def register() -> None:
    for owner, group, description in OWNERS:
        bpy.utils.register_class(group)
        owner.leapray = bpy.props.PointerProperty(
            type=group, name="LeapRay", description=description
        )


def unregister() -> None:
    for owner, group, _ in reversed(OWNERS):
        del owner.leapray
        bpy.utils.unregister_class(group)
