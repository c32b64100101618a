# SPDX-License-Identifier: GPL-3.0-or-later
"""What a user can ask for beside pictures: settings that go together, an object's volume."""

# Annotations stay values here, for Blender evaluates them.

from pathlib import Path

import bpy
from bpy_extras.io_utils import ExportHelper, ImportHelper

import leapray

from ..plan import plan
from ..settings import SETTINGS
from ..store import volume_files
from . import properties, volume_data, volume_looks
from .presets import LOOKS, PRESETS
from .read import matrices, meshes


class RENDER_OT_leapray_preset(bpy.types.Operator):
    """Choose settings that go together"""

    bl_idname = "render.leapray_preset"
    bl_label = "LeapRay Preset"
    bl_options = {"REGISTER", "UNDO"}

    preset: bpy.props.EnumProperty(
        name="Preset",
        description="What the settings are for",
        items=[(name, preset.label, preset.about) for name, preset in PRESETS.items()],
    )

    @classmethod
    def description(cls, context, properties) -> str:
        return PRESETS[properties.preset].about

    def execute(self, context) -> set[str]:
        properties.apply(context.scene, PRESETS[self.preset].values())
        return {"FINISHED"}


class OBJECT_OT_leapray_export_vdb(bpy.types.Operator, ExportHelper):
    """Write the active object, modifiers included, as the volume that LeapRay makes of it"""

    bl_idname = "object.leapray_export_vdb"
    bl_label = "Export Volume"
    bl_options = {"REGISTER"}

    filename_ext = ".vdb"
    filter_glob: bpy.props.StringProperty(
        name="Files Shown",
        description="Which files are shown",
        default="*.vdb",
        options={"HIDDEN"},
    )
    resolution: bpy.props.IntProperty(
        name="Resolution",
        description="Samples along the longest side of the volume",
        default=128,
        min=2,
        soft_max=SETTINGS["resolution"].soft_maximum,
        max=SETTINGS["resolution"].maximum,
    )

    space: bpy.props.EnumProperty(
        name="Space",
        description="Where the volume lies in the file",
        items=[
            ("WORLD", "World", "Where the object is: a new volume object shows it in its place"),
            ("OBJECT", "Object", "In the object's own space, for volume objects that follow it"),
        ],
        default="WORLD",
    )

    @classmethod
    def poll(cls, context) -> bool:
        return context.object is not None

    def execute(self, context) -> set[str]:
        ob = context.object.evaluated_get(context.evaluated_depsgraph_get())
        try:
            settings, own = properties.settings(context.scene), properties.modelling(ob)
            mesh = meshes.read_object_mesh(ob)
            dtype = own.sample_type or settings.sample_type
            volume = leapray.voxelize(
                mesh.vertices,
                mesh.triangles,
                plan.fixed_size(mesh, self.resolution),
                kind=own.kind,
                filter=own.filter or settings.filter,
                half_width=settings.half_width or None,
                ids=mesh.slots,
                dtype="u16" if dtype == "auto" else dtype,
                exact="none",  # an exported file holds no triangles
                threads=settings.threads,
                max_nbytes=settings.memory_mb * plan.MB,
            )
            placed = matrices.affine(ob.matrix_world) if self.space == "WORLD" else None
            volume_files.write(volume, self.filepath, placed)
        except leapray.LeapRayError as error:
            self.report({"ERROR"}, f"'{ob.name}' is not exported: {error}")
            return {"CANCELLED"}
        size = " x ".join(map(str, volume.info.size))
        self.report({"INFO"}, f"{size} samples written to {self.filepath}")
        return {"FINISHED"}


class OBJECT_OT_leapray_import(bpy.types.Operator, ImportHelper):
    """Add measured data (NIfTI, DICOM, NRRD, MRC, TIFF, OpenVDB, raw) where their file says"""

    bl_idname = "object.leapray_import"
    bl_label = "Import Volume"
    bl_options = {"REGISTER", "UNDO"}

    filter_glob: bpy.props.StringProperty(
        name="Files Shown",
        description="Which files are shown",
        default=";".join(f"*{suffix}" for suffix in volume_data.suffixes()),
        options={"HIDDEN"},
    )
    grid: bpy.props.StringProperty(
        name="Grid",
        description="The name of a grid, channel or series of the file; empty: the first",
    )

    def invoke(self, context, event) -> set[str]:
        if self.properties.is_property_set("filepath"):  # a file was dropped
            return self.execute(context)
        return ImportHelper.invoke(self, context, event)

    def execute(self, context) -> set[str]:
        try:
            ob, _ = volume_data.add(context.scene, Path(self.filepath), self.grid)
        except leapray.LeapRayError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        for other in context.selected_objects:
            other.select_set(False)
        ob.select_set(True)
        context.view_layer.objects.active = ob
        return look(self, context, ob)


class OBJECT_OT_leapray_look(bpy.types.Operator):
    """Read the data of the active volume, to see the range of its values and how they are spread"""

    bl_idname = "object.leapray_look"
    bl_label = "Read Values"
    bl_options = {"REGISTER"}

    @classmethod
    def poll(cls, context) -> bool:
        return context.object is not None and context.object.type == "VOLUME"

    def execute(self, context) -> set[str]:
        return look(self, context, context.object)


def look(operator, context, ob) -> set[str]:
    """Read a volume's values for the panel; why that cannot be is a warning."""
    try:
        values = volume_data.look(ob, context.evaluated_depsgraph_get())
    except leapray.LeapRayError as error:
        operator.report({"WARNING"}, str(error))
    else:
        operator.report({"INFO"}, f"Automatic threshold {values.threshold:.6g}: {values.how}")
    return {"FINISHED"}


class OBJECT_OT_leapray_volume_preset(bpy.types.Operator):
    """Show the active volume by a material for data of a kind, between values of its own"""

    bl_idname = "object.leapray_volume_preset"
    bl_label = "Volume Preset"
    bl_options = {"REGISTER", "UNDO"}

    preset: bpy.props.EnumProperty(
        name="Preset",
        description="What the data are",
        items=[(name, look.label, look.about) for name, look in LOOKS.items()],
    )

    @classmethod
    def poll(cls, context) -> bool:
        return context.object is not None and context.object.type == "VOLUME"

    @classmethod
    def description(cls, context, properties) -> str:
        return LOOKS[properties.preset].about

    def execute(self, context) -> set[str]:
        try:
            told = volume_looks.apply(
                context.object, context.evaluated_depsgraph_get(), self.preset
            )
        except leapray.LeapRayError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, told)
        return {"FINISHED"}


class IMAGE_FH_leapray_volume(bpy.types.FileHandler):
    """Files of measured data that are dropped into the 3D viewport"""

    bl_idname = "IMAGE_FH_leapray_volume"
    bl_label = "Volume for LeapRay"
    bl_import_operator = "object.leapray_import"
    bl_file_extensions = ";".join(volume_data.dropped())

    @classmethod
    def poll_drop(cls, context) -> bool:
        return context.area is not None and context.area.type == "VIEW_3D"


def export_menu(self, context) -> None:
    """The entry of File > Export."""
    operator = OBJECT_OT_leapray_export_vdb
    self.layout.operator(operator.bl_idname, text="LeapRay Volume of Active Object (.vdb)")


def import_menu(self, context) -> None:
    """The entry of File > Import."""
    self.layout.operator(OBJECT_OT_leapray_import.bl_idname, text="Volume for LeapRay")


CLASSES = (
    RENDER_OT_leapray_preset,
    OBJECT_OT_leapray_export_vdb,
    OBJECT_OT_leapray_import,
    OBJECT_OT_leapray_look,
    OBJECT_OT_leapray_volume_preset,
)


def register() -> None:
    for each in CLASSES:
        bpy.utils.register_class(each)
    bpy.utils.register_class(IMAGE_FH_leapray_volume)
    bpy.types.TOPBAR_MT_file_export.append(export_menu)
    bpy.types.TOPBAR_MT_file_import.append(import_menu)


def unregister() -> None:
    bpy.types.TOPBAR_MT_file_import.remove(import_menu)
    bpy.types.TOPBAR_MT_file_export.remove(export_menu)
    bpy.utils.unregister_class(IMAGE_FH_leapray_volume)
    for each in reversed(CLASSES):
        bpy.utils.unregister_class(each)
