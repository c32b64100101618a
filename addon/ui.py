# SPDX-License-Identifier: GPL-3.0-or-later
"""Panels: LeapRay's own, and those of Blender's that suit it."""

from __future__ import annotations

import bpy

ENGINE = "LEAPRAY"

# Panels of another engine that show what LeapRay reads too.
BORROWED = {
    "EEVEE_MATERIAL_PT_context_material",
    "EEVEE_MATERIAL_PT_surface",
    "EEVEE_WORLD_PT_surface",
    "MATERIAL_PT_preview",
    "VIEWLAYER_PT_layer_passes",
}
# Parts of names of Blender's general panels whose content LeapRay does not read.
UNREAD = ("freestyle", "gpencil", "grease", "lightprobe", "stereoscopy", "DATA_PT_light", "spot")


class _Panel:
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"

    @classmethod
    def poll(cls, context) -> bool:
        return context.engine == ENGINE

    def columns(self):
        self.layout.use_property_split = True
        self.layout.use_property_decorate = False
        return self.layout.column()


class RENDER_PT_leapray(_Panel, bpy.types.Panel):
    bl_label = "LeapRay"
    bl_context = "render"

    def draw(self, context) -> None:
        column, settings = self.columns(), context.scene.leapray
        column.prop(settings, "samples")
        error = column.column()
        error.active = settings.resolution == 0
        error.prop(settings, "pixel_error")
        column.prop(settings, "traverser")


class RENDER_PT_leapray_surface(_Panel, bpy.types.Panel):
    bl_label = "Surface"
    bl_context = "render"
    bl_parent_id = "RENDER_PT_leapray"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context) -> None:
        column, settings = self.columns(), context.scene.leapray
        for name in ("hit_test", "root", "normal"):
            column.prop(settings, name)


class RENDER_PT_leapray_volumes(_Panel, bpy.types.Panel):
    bl_label = "Volumes"
    bl_context = "render"
    bl_parent_id = "RENDER_PT_leapray"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context) -> None:
        column, settings = self.columns(), context.scene.leapray
        for name in ("layout", "resolution", "sample_type", "filter", "half_width"):
            column.prop(settings, name)
        column.prop(settings, "memory_mb")
        column.prop(settings, "cache_folder")


class RENDER_PT_leapray_performance(_Panel, bpy.types.Panel):
    bl_label = "Performance"
    bl_context = "render"
    bl_parent_id = "RENDER_PT_leapray"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context) -> None:
        column, settings, render = self.columns(), context.scene.leapray, context.scene.render
        column.prop(render, "threads_mode")
        threads = column.column()
        threads.enabled = render.threads_mode == "FIXED"
        threads.prop(render, "threads")
        column.prop(settings, "tile_size")
        column.prop(render, "use_persistent_data", text="Keep Volumes")
        column.prop(settings, "seed")


class RENDER_PT_leapray_film(_Panel, bpy.types.Panel):
    bl_label = "Film"
    bl_context = "render"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context) -> None:
        self.columns().prop(context.scene.render, "film_transparent", text="Transparent")


class VIEWLAYER_PT_leapray_passes(_Panel, bpy.types.Panel):
    bl_label = "Data"
    bl_context = "view_layer"
    bl_parent_id = "VIEWLAYER_PT_layer_passes"

    def draw(self, context) -> None:
        from . import result

        column = self.columns()
        for each in result.PASSES:
            if each.switch:
                column.prop(context.view_layer, each.switch, text=each.name)


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
        if light.type not in ("SUN", "POINT"):
            column.label(text="LeapRay renders sun and point lights so far", icon="INFO")
            return
        column.prop(light, "color")
        column.prop(light, "use_temperature")
        if light.use_temperature:
            column.prop(light, "temperature")
        column.prop(light, "energy", text="Strength" if light.type == "SUN" else "Power")
        column.prop(light, "exposure")
        column.prop(light, "normalize")
        column.prop(light, "use_shadow", text="Shadow")


class OBJECT_PT_leapray_visibility(_Panel, bpy.types.Panel):
    bl_label = "Ray Visibility"
    bl_context = "object"
    bl_parent_id = "OBJECT_PT_visibility"

    @classmethod
    def poll(cls, context) -> bool:
        return context.object is not None and super().poll(context)

    def draw(self, context) -> None:
        column = self.columns()
        column.prop(context.object, "visible_camera", text="Camera")
        column.prop(context.object, "visible_diffuse", text="Diffuse")
        column.prop(context.object, "visible_shadow", text="Shadow")


CLASSES = (
    RENDER_PT_leapray,
    RENDER_PT_leapray_surface,
    RENDER_PT_leapray_volumes,
    RENDER_PT_leapray_performance,
    RENDER_PT_leapray_film,
    VIEWLAYER_PT_leapray_passes,
    DATA_PT_leapray_light,
    OBJECT_PT_leapray_visibility,
)


def shared_panels() -> list[type]:
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


def unregister() -> None:
    for each in reversed(CLASSES):
        bpy.utils.unregister_class(each)
    for panel in bpy.types.Panel.__subclasses__():
        getattr(panel, "COMPAT_ENGINES", set()).discard(ENGINE)
