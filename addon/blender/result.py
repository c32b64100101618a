# SPDX-License-Identifier: GPL-3.0-or-later
"""The passes: one list that drives both their registration and their writing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Pass:
    """A pass of Blender's."""

    name: str  # Blender's, and the core's
    channels: str  # one letter each; more than the core gives repeat its one
    kind: str  # Blender's type of the values
    switch: str = ""  # the property that asks for it; "": always there
    old_name: str = ""  # before Blender 5.0
    own: str = ""  # the tooltip of a switch among LeapRay's properties of the view layer

    def blender_name(self) -> str:
        import bpy

        return self.old_name if self.old_name and bpy.app.version < (5, 0) else self.name

    def owner(self, view_layer):
        """What holds the switch."""
        return view_layer.leapray if self.own else view_layer

    def wanted(self, view_layer) -> bool:
        return not self.switch or getattr(self.owner(view_layer), self.switch)


PASSES = (
    Pass("Combined", "RGBA", "COLOR"),
    Pass("Depth", "Z", "VALUE", "use_pass_z"),
    Pass("Mist", "Z", "VALUE", "use_pass_mist"),
    Pass("Position", "XYZ", "VECTOR", "use_pass_position"),
    Pass("Normal", "XYZ", "VECTOR", "use_pass_normal"),
    Pass("Object Index", "X", "VALUE", "use_pass_object_index", old_name="IndexOB"),
    Pass("Material Index", "X", "VALUE", "use_pass_material_index", old_name="IndexMA"),
    Pass("Emission", "RGB", "COLOR", "use_pass_emit", old_name="Emit"),
    Pass("Environment", "RGB", "COLOR", "use_pass_environment", old_name="Env"),
    Pass("Ambient Occlusion", "RGB", "COLOR", "use_pass_ambient_occlusion", old_name="AO"),
    Pass(
        *("Steps", "X", "VALUE", "use_pass_steps"),
        own="How many cells the camera's rays stand in before they meet something: what the pixel "
        "costs",
    ),
    Pass(
        *("Error", "X", "VALUE", "use_pass_error"),
        own="How far the surface that is seen may lie from its true place, in pixels",
    ),
    Pass(
        *("Volume", "X", "VALUE", "use_pass_volume"),
        own="The number of the volume that is seen, in the order of the report",
    ),
    Pass(
        *("Value", "X", "VALUE", "use_pass_value"),
        own="The projected value of volume data, in its unit; 0 by other render methods",
    ),
)


def wanted(view_layer) -> tuple[str, ...]:
    """The core's names of the passes that the view layer asks for."""
    return tuple(each.name for each in PASSES if each.wanted(view_layer))


def not_made(view_layer) -> tuple[str, ...]:
    """What the passes are called that the view layer asks for and LeapRay does not make."""
    made = {each.switch for each in PASSES}
    made |= {"use_pass_combined", "use_pass_cryptomatte_accurate"}  # the latter is none
    asked = []
    for owner, prefixes in (
        (view_layer, ("use_pass_",)),
        (getattr(view_layer, "cycles", None), ("use_pass_", "pass_debug_")),  # where it is loaded
    ):
        for each in owner.bl_rna.properties if owner is not None else ():
            named = each.identifier.startswith(prefixes) and each.type == "BOOLEAN"
            if named and each.identifier not in made and getattr(owner, each.identifier):
                asked.append(each.name)
    asked += [f"Shader AOV {each.name}" for each in view_layer.aovs if each.is_valid]
    asked += [f"Light Group {each.name}" for each in view_layer.lightgroups]
    return tuple(asked)


def register_passes(engine, scene, view_layer) -> None:
    """Tell Blender which passes the view layer will get."""
    for each in PASSES:
        if each.wanted(view_layer):
            name = each.blender_name()
            engine.register_pass(
                scene, view_layer, name, len(each.channels), each.channels, each.kind
            )


def write_tile(
    engine,
    view_layer: str,
    x: int,
    y: int,
    width: int,
    height: int,
    passes: dict[str, NDArray[np.float32]],
) -> None:
    """Put a tile into the render result; passes as (height, width, channels), rows from below."""
    names = {each.blender_name(): each.name for each in PASSES}
    result = engine.begin_result(x, y, width, height, layer=view_layer)
    for layer in result.layers:
        for each in layer.passes:
            values = passes.get(names.get(each.name, ""))
            if values is not None:
                shape = (height, width, each.channels)
                each.rect.foreach_set(np.broadcast_to(values, shape).astype(np.float32).ravel())
    engine.end_result(result)
