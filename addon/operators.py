# SPDX-License-Identifier: GPL-3.0-or-later
"""What a user can ask for beside pictures: an object's volume as a file."""

# Annotations stay values here, for Blender evaluates them.

import bpy
import numpy as np
from bpy_extras.io_utils import ExportHelper

import leapray

from . import plan, properties, scene, volumes


class OBJECT_OT_leapray_export_vdb(bpy.types.Operator, ExportHelper):
    """Write the active object, modifiers included, as the volume that LeapRay makes of it"""

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
            mesh = scene.read_object_mesh(ob)
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
            placed = np.array(ob.matrix_world) if self.space == "WORLD" else None
            volumes.write(volume, self.filepath, placed)
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
