# SPDX-License-Identifier: GPL-3.0-or-later
"""Panels: LeapRay's own, and those of Blender's that suit it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import bpy

from ..methods import PROJECTIONS, RAYS
from . import ui_report, volume_data
from .presets import LOOKS, PRESETS
from .read import looks
from .ui_report import ENGINE

# Panels of another engine that show what LeapRay reads too.
BORROWED = {
    "EEVEE_MATERIAL_PT_context_material",
    "EEVEE_MATERIAL_PT_surface",
    "EEVEE_WORLD_PT_surface",
    "MATERIAL_PT_preview",
    "VIEWLAYER_PT_layer_passes",
}
# Parts of names of Blender's general panels whose content LeapRay does not read.
UNREAD = (
    *("freestyle", "gpencil", "grease", "lightprobe", "stereoscopy", "DATA_PT_light", "spot"),
    "simplify",  # ours
    "volume_render",  # space and steps of what is no surface
)
SHAPES = ("MESH", "CURVE", "SURFACE", "META", "FONT")  # objects that have a mesh


class _Panel:
    if TYPE_CHECKING:
        layout: Any  # of bpy.types.Panel
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"

    @classmethod
    def poll(cls, context) -> bool:
        return context.engine == ENGINE

    def columns(self, *, keyed: bool = False):
        """A column of names and values; keyed: with dots for keyframes."""
        self.layout.use_property_split = True
        self.layout.use_property_decorate = keyed
        return self.layout.column()


class _RenderPanel(_Panel):
    """A part of LeapRay's settings that beginners need not open."""

    bl_context = "render"
    bl_parent_id = "RENDER_PT_leapray"
    bl_options = {"DEFAULT_CLOSED"}


def automatic(column, owner, name: str, text: str = "Automatic") -> None:
    """A setting whose 0 means that LeapRay chooses: a check box, and the value where it is not."""
    _switched(column, owner, name, f"auto_{name}", text, text)


def optional(column, owner, name: str) -> None:
    """A setting whose 0 means off: a check box, and the value where it is on."""
    _switched(column, owner, name, f"use_{name}", "Off", "")


def _switched(column, owner, name: str, switch: str, at_zero: str, otherwise: str) -> None:
    row = column.row(align=True, heading=owner.bl_rna.properties[name].name)
    keyed, row.use_property_decorate = row.use_property_decorate, False
    zero = getattr(owner, name) == 0
    row.prop(owner, switch, text=at_zero if zero else otherwise)
    if not zero:
        row.prop(owner, name, text="")
        if keyed:
            row.prop_decorator(owner, name)


class RENDER_MT_leapray_presets(bpy.types.Menu):
    """Settings that go together"""

    bl_label = "Presets"

    def draw(self, context) -> None:
        for name, preset in PRESETS.items():
            operator = self.layout.operator("render.leapray_preset", text=preset.label)
            operator.preset = name


class DATA_MT_leapray_volume_presets(bpy.types.Menu):
    """Show the data as a volume, by a material for data of a kind"""

    bl_label = "Volume Presets"

    def draw(self, context) -> None:
        for name, look in LOOKS.items():
            operator = self.layout.operator("object.leapray_volume_preset", text=look.label)
            operator.preset = name


class RENDER_PT_leapray(_Panel, bpy.types.Panel):
    bl_label = "LeapRay"
    bl_context = "render"

    def draw_header_preset(self, context) -> None:
        self.layout.menu("RENDER_MT_leapray_presets", text="", icon="PRESET")

    def draw(self, context) -> None:
        column, settings = self.columns(keyed=True), context.scene.leapray
        column.prop(settings, "method")
        sampled = column.column()
        sampled.active = settings.method == RAYS.spec
        sampled.prop(settings, "samples")
        optional(sampled, settings, "noise_threshold")
        error = column.column()
        error.active = settings.resolution == 0
        error.prop(settings, "pixel_error")
        traced = column.column()
        traced.active = settings.method in (RAYS.spec, *(each.spec for each in PROJECTIONS))
        traced.prop(settings, "traverser")
        unrendered = ui_report.unrendered_of_scene(context)
        if unrendered:
            ui_report.paragraph(self.layout, context.region, unrendered, "INFO")


class RENDER_PT_leapray_sampling(_RenderPanel, bpy.types.Panel):
    bl_label = "Sampling"

    def draw(self, context) -> None:
        column, settings = self.columns(keyed=True), context.scene.leapray
        least = column.column()
        least.active = settings.noise_threshold > 0
        automatic(least, settings, "min_samples")
        column.prop(settings, "volume_sampling")
        step = column.column()
        step.active = settings.volume_sampling != "exact" or settings.hit_test == "uniform"
        step.prop(settings, "step")
        column.prop(settings, "stop_opacity")
        column.prop(settings, "branches")
        column.prop(settings, "seed")


class RENDER_PT_leapray_paths(_RenderPanel, bpy.types.Panel):
    bl_label = "Light Paths"

    def draw(self, context) -> None:
        column, settings = self.columns(keyed=True), context.scene.leapray
        limits = column.column(align=True)
        limits.prop(settings, "max_bounces", text="Max Bounces, Total")
        for kind in ("diffuse", "glossy", "transmission", "transparent", "volume"):
            limits.prop(settings, f"{kind}_bounces", text=kind.capitalize())
        column.separator()
        for name in ("clamp_direct", "clamp_indirect"):
            optional(column, settings, name)
        column.separator()
        column.prop(settings, "nested")
        optional(column, settings, "ambient_distance")
        column.prop(settings, "ao_distance")


class RENDER_PT_leapray_surface(_RenderPanel, bpy.types.Panel):
    bl_label = "Surface"

    def draw(self, context) -> None:
        column, settings = self.columns(keyed=True), context.scene.leapray
        for name in ("hit_test", "root", "normal"):
            column.prop(settings, name)


class RENDER_PT_leapray_volumes(_RenderPanel, bpy.types.Panel):
    bl_label = "Volumes"

    def draw(self, context) -> None:
        column, settings = self.columns(keyed=True), context.scene.leapray
        column.prop(settings, "layout")
        automatic(column, settings, "resolution")
        column.prop(settings, "filter")
        automatic(column, settings, "half_width")
        for name in ("exact", "sample_type"):
            column.prop(settings, name)
        column.separator()
        column.prop(settings, "memory_mb")
        column.prop(settings, "cache_folder")


class RENDER_PT_leapray_performance(_RenderPanel, bpy.types.Panel):
    bl_label = "Performance"

    def draw(self, context) -> None:
        column, settings, render = self.columns(), context.scene.leapray, context.scene.render
        column.prop(render, "threads_mode")
        threads = column.column()
        threads.enabled = render.threads_mode == "FIXED"
        threads.prop(render, "threads")
        column.prop(settings, "tile_size")
        column.prop(render, "use_persistent_data", text="Keep Volumes")


class RENDER_PT_leapray_film(_Panel, bpy.types.Panel):
    bl_label = "Film"
    bl_context = "render"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context) -> None:
        column, settings = self.columns(keyed=True), context.scene.leapray
        column.prop(context.scene.render, "film_transparent", text="Transparent")
        if hasattr(context.scene, "cycles"):
            column.prop(context.scene.cycles, "film_exposure")
        column.prop(settings, "pixel_filter")
        width = column.column()
        width.active = settings.pixel_filter != "box"
        width.prop(settings, "filter_width")


class RENDER_PT_leapray_simplify(_Panel, bpy.types.Panel):
    """What of Blender's Simplify shows in a render; Blender's own panel would stand above ours"""

    bl_label = "Simplify"
    bl_context = "render"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_header(self, context) -> None:
        self.layout.prop(context.scene.render, "use_simplify", text="")

    def draw(self, context) -> None:
        column, render = self.columns(keyed=True), context.scene.render
        column.active = render.use_simplify
        viewport = column.column(align=True)
        viewport.prop(render, "simplify_subdivision", text="Viewport Subdivision")
        viewport.prop(render, "simplify_child_particles", text="Child Particles")
        rendered = column.column(align=True)
        rendered.prop(render, "simplify_subdivision_render", text="Render Subdivision")
        rendered.prop(render, "simplify_child_particles_render", text="Child Particles")


class VIEWLAYER_PT_leapray_passes(_Panel, bpy.types.Panel):
    bl_label = "Data"
    bl_context = "view_layer"
    bl_parent_id = "VIEWLAYER_PT_layer_passes"

    def draw(self, context) -> None:
        from . import result

        column = self.columns()
        for each in result.PASSES:
            if each.switch:
                column.prop(each.owner(context.view_layer), each.switch, text=each.name)


class DATA_PT_leapray_light(_Panel, bpy.types.Panel):
    bl_label = "Light"
    bl_context = "data"

    @classmethod
    def poll(cls, context) -> bool:
        return context.light is not None and super().poll(context)

    def draw(self, context) -> None:
        light = context.light
        self.layout.row().prop(light, "type", expand=True)
        column = self.columns()
        column.prop(light, "color")
        column.prop(light, "use_temperature")
        if light.use_temperature:
            column.prop(light, "temperature")
        column.prop(light, "energy", text="Strength" if light.type == "SUN" else "Power")
        column.prop(light, "exposure")
        column.prop(light, "normalize")
        column.separator()
        if light.type == "SUN":
            column.prop(light, "angle")
        elif light.type == "AREA":
            column.prop(light, "shape")
            sides = column.column(align=True)
            if light.shape in ("RECTANGLE", "ELLIPSE"):
                sides.prop(light, "size", text="Size X")
                sides.prop(light, "size_y", text="Y")
            else:
                sides.prop(light, "size")
            column.prop(light, "spread")
        else:
            column.prop(light, "use_soft_falloff")
            column.prop(light, "shadow_soft_size", text="Radius")
        if light.type == "SPOT":
            column.prop(light, "spot_size", text="Spot Size")
            column.prop(light, "spot_blend", text="Blend")
            column.prop(light, "show_cone")
        column.separator()
        column.prop(light, "use_shadow", text="Shadow")


class WORLD_PT_leapray_mist(_Panel, bpy.types.Panel):
    bl_label = "Mist Pass"
    bl_context = "world"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context) -> bool:
        return context.world is not None and super().poll(context)

    def draw(self, context) -> None:
        column = self.columns()
        for name in ("start", "depth", "falloff"):
            column.prop(context.world.mist_settings, name)


class WORLD_PT_leapray_visibility(_Panel, bpy.types.Panel):
    bl_label = "Ray Visibility"
    bl_context = "world"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context) -> bool:
        return hasattr(context.world, "cycles_visibility") and super().poll(context)

    def draw(self, context) -> None:
        column = self.columns()
        for name in ("camera", "diffuse", "glossy", "transmission"):
            column.prop(context.world.cycles_visibility, name)


class MATERIAL_PT_leapray_index(_Panel, bpy.types.Panel):
    bl_label = "Settings"
    bl_context = "material"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context) -> bool:
        return context.material is not None and super().poll(context)

    def draw(self, context) -> None:
        self.columns().prop(context.material, "pass_index")


SEQUENCE = "frame_duration", "frame_start", "frame_offset", "sequence_mode"  # Blender's own


def _asks_for_labels(own, values) -> bool:
    """Whether a volume is rendered as labels, as far as is known."""
    known = values is not None and values.labels
    return own.shown == "labels" or (own.shown == "auto" and known)


def _draw_thresholds(column, region, own, values) -> None:
    """What is asked of surfaces at thresholds."""
    column.prop(own, "surfaces")
    column.prop(own, "automatic", text="Automatic")
    if not own.automatic:
        column.prop(own, "threshold")
    elif values:
        ui_report.paragraph(column, region, f"{values.threshold:.6g}: {values.how}")
    for number in range(2, own.surfaces + 1):
        column.prop(own, f"threshold_{number}")
    column.separator()
    for name in ("interpolation", "smoothing", "least", "invert", "capped"):
        column.prop(own, name)


def _draw_shading(column, own) -> None:
    """How a volume that scatters light is shaded."""
    optional(column, own, "gradient_shading")
    if own.gradient_shading > 0.0:
        for name in ("gradient_scale", "gradient_roughness", "gradient_specular"):
            column.prop(own, name)


class DATA_PT_leapray_volume(_Panel, bpy.types.Panel):
    """Which surfaces of a volume's data are rendered."""

    bl_label = "LeapRay Surfaces"
    bl_context = "data"

    @classmethod
    def poll(cls, context) -> bool:
        return context.volume is not None and super().poll(context)

    def draw(self, context) -> None:
        column, volume = self.columns(keyed=True), context.volume
        own = volume.leapray
        column.prop(own, "file")
        if own.file:
            column.prop(own, "frame")
            column.prop(own, "grid")
            column.prop(volume, "is_sequence")
            for name in SEQUENCE if volume.is_sequence else ():
                column.prop(volume, name)
        else:
            column.prop_search(own, "grid", volume, "grids")
        column.separator()
        values = volume_data.known(volume)
        column.prop(own, "shown")
        column.menu("DATA_MT_leapray_volume_presets")
        worn = volume.materials[0] if len(volume.materials) else None
        if looks.is_shown(own.shown, worn):
            column.prop(own, "smoothing")
            optional(column, own, "gradient_modulation")
            _draw_shading(column, own)
        elif _asks_for_labels(own, values):
            column.prop(own, "label_colors")
            column.prop(own, "label_index")
            column.prop(own, "smoothing")
        else:
            _draw_thresholds(column, context.region, own, values)
        column.separator()
        column.prop(own, "clip_object")
        if own.clip_object:
            column.prop(own, "clip_keep")
        if values:
            self.draw_values(column.box(), own, values)
        column.operator("object.leapray_look", icon="FILE_REFRESH" if values else "VIEWZOOM")

    def draw_values(self, box, own, values) -> None:
        """The range of the values, and how they are spread."""
        low, high = values.limits
        box.label(text=f"{' x '.join(map(str, values.size))} samples")
        if _asks_for_labels(own, values):
            return
        box.label(text=f"{low:.6g} to {high:.6g} {values.quantity}".strip())
        first = values.threshold if own.automatic else own.threshold
        thresholds = (first, own.threshold_2, own.threshold_3)[: own.surfaces]
        box.template_icon(volume_data.picture(values, thresholds), scale=8.0)


class OBJECT_PT_leapray(_Panel, bpy.types.Panel):
    bl_label = "LeapRay Volume"
    bl_context = "object"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context) -> bool:
        return (
            context.object is not None and context.object.type in SHAPES and super().poll(context)
        )

    def draw(self, context) -> None:
        column, ob = self.columns(keyed=True), context.object
        column.prop(ob.leapray, "kind")
        automatic(column, ob.leapray, "resolution", text="As Scene")
        for name in ("filter", "sample_type"):
            column.prop(ob.leapray, name)
        column.operator("object.leapray_export_vdb", icon="EXPORT")


class OBJECT_PT_leapray_visibility(_Panel, bpy.types.Panel):
    bl_label = "Ray Visibility"
    bl_context = "object"
    bl_parent_id = "OBJECT_PT_visibility"

    @classmethod
    def poll(cls, context) -> bool:
        return context.object is not None and super().poll(context)

    def draw(self, context) -> None:
        column = self.columns()
        for rays in ("camera", "diffuse", "glossy", "transmission", "shadow"):
            if rays != "shadow" or context.object.type != "LIGHT":
                column.prop(context.object, f"visible_{rays}", text=rays.capitalize())
        column.prop(context.object, "visible_volume_scatter", text="Volume Scatter")


CLASSES = (
    RENDER_MT_leapray_presets,
    DATA_MT_leapray_volume_presets,
    RENDER_PT_leapray,
    ui_report.RENDER_PT_leapray_last,
    RENDER_PT_leapray_sampling,
    RENDER_PT_leapray_paths,
    RENDER_PT_leapray_surface,
    RENDER_PT_leapray_volumes,
    RENDER_PT_leapray_performance,
    RENDER_PT_leapray_film,
    RENDER_PT_leapray_simplify,
    VIEWLAYER_PT_leapray_passes,
    DATA_PT_leapray_light,
    WORLD_PT_leapray_mist,
    WORLD_PT_leapray_visibility,
    MATERIAL_PT_leapray_index,
    DATA_PT_leapray_volume,
    OBJECT_PT_leapray,
    OBJECT_PT_leapray_visibility,
    *ui_report.WARNED,
)


def shared_panels() -> list[Any]:
    """Blender's panels that LeapRay joins."""
    return [
        panel
        for panel in bpy.types.Panel.__subclasses__()
        if panel.__name__ in BORROWED
        or (
            "BLENDER_RENDER" in getattr(panel, "COMPAT_ENGINES", ())
            and not any(part in panel.__name__ for part in UNREAD)
        )
    ]


def register() -> None:
    for panel in shared_panels():
        panel.COMPAT_ENGINES.add(ENGINE)
    for each in CLASSES:
        bpy.utils.register_class(each)
    ui_report.register()


def unregister() -> None:
    volume_data.forget()
    ui_report.unregister()
    for each in reversed(CLASSES):
        bpy.utils.unregister_class(each)
    for panel in bpy.types.Panel.__subclasses__():
        getattr(panel, "COMPAT_ENGINES", set()).discard(ENGINE)
