# SPDX-License-Identifier: GPL-3.0-or-later
"""What the panels tell: how the last render went, and what LeapRay does not render.

A warning of the last render stands in the render properties, and again where the
thing that it names is shown. What LeapRay never renders says so in Blender's own
panel of it.
"""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Any

import bpy

from . import engine

ENGINE = "LEAPRAY"
LETTER = 6.2  # pixels of a letter at the interface's usual size, on the average
SIDES = 70  # pixels that an icon and the margins take
NAMED = "LeapRay does not render "  # how every such sentence begins


def paragraph(layout, region, sentence: str, icon: str = "NONE") -> None:
    """A sentence in as many lines as the region's width asks for."""
    scale = bpy.context.preferences.system.ui_scale or 1.0  # 0 without a window
    letters = max(20, int((region.width / scale - SIDES) / LETTER))
    column = layout.column(align=True)
    column.scale_y = 0.8
    for number, line in enumerate(textwrap.wrap(sentence, letters)):
        column.label(text=line, icon=icon if number == 0 else "BLANK1" if icon != "NONE" else icon)


# ---- the last render -------------------------------------------------------


def megabytes(nbytes: float) -> str:
    return f"{nbytes / 1e6:,.1f} MB"


def seconds(value: float) -> str:
    """A duration as Blender writes it."""
    minutes, rest = divmod(value, 60)
    hours, minutes = divmod(int(minutes), 60)
    return f"{hours}:{minutes:02}:{rest:05.2f}" if hours else f"{minutes:02}:{rest:05.2f}"


def statistics(report: dict) -> list[tuple[str, str]]:
    """What is worth knowing of a render's report, as pairs of what and how much."""
    took, held, volumes = report["seconds"], report["bytes"], report["volumes"]
    worst = max((row["error_footprints"] or 0.0 for row in volumes), default=0.0)
    made = took["total"] - took["trace"] - took["read"]
    in_lanes = report["in_lanes"] / max(report["pairs"], 1)
    return [
        ("Size", f"{report['width']} x {report['height']} px"),
        ("Time", seconds(took["total"])),
        ("Reading the Scene", seconds(took["read"])),
        ("Making Volumes", seconds(made)),
        ("Tracing", seconds(took["trace"])),
        ("Rays", f"{report['rays']:,}"),
        ("In Vector Lanes", f"{in_lanes:.1%} of rays and volumes"),
        ("Volumes", f"{len(volumes):,}"),
        ("Largest Error", f"{worst:.2g} px"),
        ("Volumes Take", megabytes(held["volumes"] + held["structures"])),
        ("Memory at Peak", megabytes(held["peak"])),
    ]


def warnings_of(name: str | None = None) -> list[str]:
    """The warnings of the last render, all of them or those that name a thing."""
    found = dict.fromkeys(w for report in engine.reports.values() for w in report["warnings"])
    return [each for each in found if name is None or f"'{name}'" in each]


class RENDER_PT_leapray_last(bpy.types.Panel):
    """How the last render went."""

    bl_label = "Last Render"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "render"
    bl_parent_id = "RENDER_PT_leapray"

    @classmethod
    def poll(cls, context) -> bool:
        return context.engine == ENGINE and bool(engine.reports or engine.failures)

    def draw(self, context) -> None:
        layout = self.layout
        for failure in engine.failures.values():
            paragraph(layout, context.region, str(failure), "ERROR")
        for warning in warnings_of():
            paragraph(layout, context.region, warning, "ERROR")
        for layer, report in engine.reports.items():
            if len(engine.reports) > 1:
                layout.label(text=layer, icon="RENDERLAYERS")
            columns = layout.split(factor=0.4)
            left, right = columns.column(align=True), columns.column(align=True)
            left.alignment = "RIGHT"
            for what, value in statistics(report):
                left.label(text=what)
                right.label(text=value)


class _Warned:
    """A panel of the warnings of the last render that name what the tab shows."""

    if TYPE_CHECKING:
        bl_context: str
        layout: Any  # of bpy.types.Panel

    bl_label = "Not as Cycles Renders It"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_options = {"HIDE_HEADER"}

    @classmethod
    def poll(cls, context) -> bool:
        thing = getattr(context, cls.bl_context, None)
        return context.engine == ENGINE and thing is not None and bool(warnings_of(thing.name))

    def draw(self, context) -> None:
        for warning in warnings_of(getattr(context, self.bl_context).name):
            paragraph(self.layout, context.region, warning, "ERROR")


class OBJECT_PT_leapray_warned(_Warned, bpy.types.Panel):
    bl_context = "object"


class MATERIAL_PT_leapray_warned(_Warned, bpy.types.Panel):
    bl_context = "material"


class WORLD_PT_leapray_warned(_Warned, bpy.types.Panel):
    bl_context = "world"


# ---- what is never rendered ------------------------------------------------


def _camera(context) -> str:
    camera = context.camera
    if camera is None:
        return ""
    named = []
    if camera.type not in ("PERSP", "ORTHO"):
        named.append("panoramic or custom cameras")
    if camera.dof.use_dof:
        named.append("depth of field, which is on for this camera")
    return " and ".join(named)


def _particles(context) -> str:
    system = context.particle_system
    settings = system.settings if system else None
    hair = settings and settings.type == "HAIR" and settings.render_type == "PATH"
    return "hair" if hair else ""


def unrendered_of_scene(context) -> str:
    """What the scene asks for in settings that LeapRay's panels do not have."""
    render = context.scene.render
    asked = {"motion blur": render.use_motion_blur, "stereoscopy": render.use_multiview}
    named = [what for what, used in asked.items() if used]
    return f"{NAMED}{' and '.join(named)}, which this scene asks for" if named else ""


# What Blender's panels hold that is left out: what it is called, where it is there.
UNRENDERED = {
    "DATA_PT_context_curves": lambda context: "hair curves",
    "DATA_PT_context_pointcloud": lambda context: "point clouds",
    "DATA_PT_lens": _camera,
    "PARTICLE_PT_render": _particles,
}


def _teller(what):
    """A function that Blender calls before it draws a panel of its own."""

    def tell(self, context) -> None:
        named = what(context) if context.engine == ENGINE else ""
        if named:
            paragraph(self.layout, context.region, NAMED + named, "INFO")

    return tell


_tellers: dict[str, object] = {}


@bpy.app.handlers.persistent
def _forget(*_) -> None:
    """Another file was opened: what the panels told was of the one before."""
    engine.reports.clear()
    engine.failures.clear()


WARNED = (
    OBJECT_PT_leapray_warned,
    MATERIAL_PT_leapray_warned,
    WORLD_PT_leapray_warned,
)


def register() -> None:
    for name, what in UNRENDERED.items():
        panel = getattr(bpy.types, name, None)
        if panel is not None:
            _tellers[name] = _teller(what)
            panel.prepend(_tellers[name])
    bpy.app.handlers.load_post.append(_forget)


def unregister() -> None:
    bpy.app.handlers.load_post.remove(_forget)
    for name, tell in _tellers.items():
        getattr(bpy.types, name).remove(tell)
    _tellers.clear()
