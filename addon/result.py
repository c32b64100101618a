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
    channels: str  # one letter each
    kind: str  # Blender's type of the values
    switch: str = ""  # the view layer's property that asks for it; "": always there
    old_name: str = ""  # before Blender 5.0

    def blender_name(self) -> str:
        import bpy

        return self.old_name if self.old_name and bpy.app.version < (5, 0) else self.name


PASSES = (
    Pass("Combined", "RGBA", "COLOR"),
    Pass("Depth", "Z", "VALUE", "use_pass_z"),
    Pass("Normal", "XYZ", "VECTOR", "use_pass_normal"),
    Pass("Position", "XYZ", "VECTOR", "use_pass_position"),
    Pass("Object Index", "X", "VALUE", "use_pass_object_index", old_name="IndexOB"),
)


def register_passes(engine, scene, view_layer) -> None:
    """Tell Blender which passes the view layer will get."""
    for each in PASSES:
        if not each.switch or getattr(view_layer, each.switch):
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
                each.rect.foreach_set(np.ascontiguousarray(values, np.float32).ravel())
    engine.end_result(result)
