# SPDX-License-Identifier: GPL-3.0-or-later
"""What a user can ask for beside pictures: an object's volume as a file."""

# Annotations stay values here, for Blender evaluates them.

import bpy
from bpy_extras.io_utils import ExportHelper

import leapray

from . import plan, properties, scene, volumes


class OBJECT_OT_leapray_export_vdb(bpy.types.Operator, ExportHelper):
    """Write the active object, modifiers included, as an OpenVDB file in its own space"""

    bl_idname = "object.leapray_export_vdb"
    bl_label = "Export Volume"
    bl_options = {"REGISTER"}

    filename_ext = ".vdb"
    filter_glob: bpy.props.StringProperty(default="*.vdb", options={"HIDDEN"})
    resolution: bpy.props.IntProperty(
        name="Resolution",
        description="Samples along the longest side of the volume",
        default=128,
        min=2,
        soft_max=1024,
        max=16384,
    )

    @classmethod
    def poll(cls, context) -> bool:
        return context.object is not None

    def execute(self, context) -> set[str]:
        ob = context.object.evaluated_get(context.evaluated_depsgraph_get())
        try:
            settings = properties.settings(context.scene)
            mesh = scene.read_object_mesh(ob)
            volume = leapray.voxelize(
                mesh.vertices,
                mesh.triangles,
                plan.fixed_size(mesh, self.resolution),
                ids=mesh.slots,
                dtype=settings.sample_type,
                threads=settings.threads,
                max_nbytes=settings.memory_mb * plan.MB,
            )
            volumes.write(volume, self.filepath)
        except leapray.LeapRayError as error:
            self.report({"ERROR"}, f"'{ob.name}' is not exported: {error}")
            return {"CANCELLED"}
        size = " x ".join(map(str, volume.info.size))
        self.report({"INFO"}, f"{size} samples written to {self.filepath}")
        return {"FINISHED"}


def menu(self, context) -> None:
    """The entry of File > Export."""
    operator = OBJECT_OT_leapray_export_vdb
    self.layout.operator(operator.bl_idname, text="LeapRay Volume of Active Object (.vdb)")


def register() -> None:
    bpy.utils.register_class(OBJECT_OT_leapray_export_vdb)
    bpy.types.TOPBAR_MT_file_export.append(menu)


def unregister() -> None:
    bpy.types.TOPBAR_MT_file_export.remove(menu)
    bpy.utils.unregister_class(OBJECT_OT_leapray_export_vdb)
