# SPDX-License-Identifier: GPL-3.0-or-later
"""From a file of measured data to the picture of a surface, by LeapRay or another program.

    python -m addon.study.isosurface_runs BY DATA OUT WIDTH HEIGHT THRESHOLD [THRESHOLD ...]

A process of its own for each, so that nothing is warm and its memory is its own. All see the data
from the same place in the light of one sun. Prints a line of JSON for each threshold, the first
with the reading of the file. VTK is PyPI's `vtk`, and optional.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import bpy
import numpy as np
from numpy.typing import NDArray

import leapray

from .. import memory, process
from ..blender import data_scene, open_file
from . import frames

GREY = 0.8
VTK_STEP = 0.5  # samples between the values that VTK's ray caster takes, its default being 1


@dataclass(frozen=True)
class Task:
    """What every program is given."""

    path: Path
    out: Path  # a PNG
    width: int
    height: int


def make_scene(task: Task, threshold: float):
    """The scene of the data with one sun that casts sharp shadows, one sample a pixel."""
    scene = data_scene.make(task.path, threshold)
    bpy.data.objects.remove(bpy.data.objects["Fill"])
    bpy.data.lights["Key"].angle = 0.0
    frames.prepare(scene, volumes=True)
    for each in ("z", "normal", "position", "object_index"):  # a picture alone is asked for
        setattr(bpy.context.view_layer, f"use_pass_{each}", False)
    frames.blacken_world(scene)
    scene.render.resolution_x, scene.render.resolution_y = task.width, task.height
    scene.camera.data.sensor_fit = "VERTICAL"
    scene.camera.data.sensor_height = scene.camera.data.sensor_width
    scene.leapray.samples = scene.cycles.samples = 1
    open_file.set_format(scene, task.out)
    bpy.context.view_layer.update()
    return scene


def data_object() -> bpy.types.Object:
    return next(ob for ob in bpy.data.objects if ob.type == "VOLUME")


class Program(Protocol):
    """Made with the task and the first threshold; reads the file."""

    def picture(self, threshold: float) -> None:
        """Render the surface at a threshold and write it."""


class ByLeapRay:
    def __init__(self, task: Task, threshold: float) -> None:
        self.scene = make_scene(task, threshold)

    def picture(self, threshold: float) -> None:
        data_object().data.leapray.threshold = threshold
        open_file.render_frame(self.scene)


class ByMeshAndCycles:
    """VTK's flying edges, then Cycles."""

    def __init__(self, task: Task, threshold: float) -> None:
        self.scene = make_scene(task, threshold)
        grid = leapray.read_volume(task.path)
        self.image, self.world_from_index = vtk_image(grid), np.asarray(grid.world_from_index)
        self.scene.render.engine = "CYCLES"
        volume = data_object()
        self.mesh = bpy.data.objects.new("Surface", bpy.data.meshes.new("Surface"))
        self.mesh.matrix_world = volume.matrix_world
        self.scene.collection.objects.link(self.mesh)
        volume.hide_render = True

    def picture(self, threshold: float) -> None:
        vertices, triangles = flying_edges(self.image, threshold)
        vertices = vertices @ self.world_from_index[:3, :3].T + self.world_from_index[:3, 3]
        old, self.mesh.data = self.mesh.data, mesh_of(vertices, triangles)
        bpy.data.meshes.remove(old)
        with open_file.quiet():
            bpy.ops.render.render(write_still=True, scene=self.scene.name)


def mesh_of(vertices: NDArray, triangles: NDArray) -> bpy.types.Mesh:
    """Smooth-shaded, as the surfaces of volumes are; vertices (n, 3), triangles (m, 3)."""
    mesh = bpy.data.meshes.new("Surface")
    mesh.vertices.add(len(vertices))
    mesh.vertices.foreach_set("co", vertices.astype(np.float32).ravel())
    mesh.loops.add(triangles.size)
    mesh.loops.foreach_set("vertex_index", triangles.astype(np.int32).ravel())
    mesh.polygons.add(len(triangles))
    first = np.arange(0, triangles.size, triangles.shape[1], dtype=np.int32)
    mesh.polygons.foreach_set("loop_start", first)
    mesh.polygons.foreach_set("use_smooth", np.ones(len(triangles), bool))
    mesh.update()
    material = bpy.data.materials.new("Surface")
    frames.be_diffuse(material, (GREY, GREY, GREY, 1.0))
    mesh.materials.append(material)
    return mesh


# ---- VTK -------------------------------------------------------------------


def vtk_image(grid: leapray.ScalarGrid):
    """The samples, read, as VTK has them, in index coordinates."""
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonDataModel import vtkImageData

    image = vtkImageData()
    samples = np.asarray(grid.samples)
    image.SetDimensions(*samples.shape[::-1])
    image.GetPointData().SetScalars(numpy_to_vtk(samples.reshape(-1), deep=False))
    return image


def flying_edges(image, threshold: float) -> tuple[NDArray, NDArray]:
    """Vertices (n, 3) in index coordinates, and triangles (m, 3)."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkFiltersCore import vtkFlyingEdges3D

    cut = vtkFlyingEdges3D()
    cut.SetInputData(image)
    cut.SetValue(0, threshold)
    cut.ComputeNormalsOff()
    cut.ComputeGradientsOff()
    cut.ComputeScalarsOff()
    cut.Update()
    found = cut.GetOutput()
    corners = vtk_to_numpy(found.GetPolys().GetConnectivityArray())
    return vtk_to_numpy(found.GetPoints().GetData()), corners.reshape(-1, 3)


class ByVtkRays:
    """VTK's ray caster on the CPU, which has neither surfaces nor shadows: its opacity is a step at
    the threshold."""

    def __init__(self, task: Task, threshold: float) -> None:
        import vtkmodules.vtkRenderingOpenGL2
        import vtkmodules.vtkRenderingVolumeOpenGL2  # noqa: F401
        from vtkmodules.vtkRenderingCore import vtkRenderer, vtkRenderWindow, vtkVolume
        from vtkmodules.vtkRenderingVolume import vtkFixedPointVolumeRayCastMapper

        self.task = task
        scene = make_scene(task, threshold)
        grid = leapray.read_volume(task.path)
        self.image = vtk_image(grid)
        self.window = vtkRenderWindow()
        self.window.SetOffScreenRendering(1)
        self.window.SetSize(task.width, task.height)
        self.renderer = vtkRenderer()
        self.window.AddRenderer(self.renderer)
        mapper = vtkFixedPointVolumeRayCastMapper()
        mapper.SetInputData(self.image)
        mapper.SetAutoAdjustSampleDistances(0)
        mapper.SetImageSampleDistance(1)
        mapper.SetSampleDistance(VTK_STEP)
        volume = vtkVolume()
        volume.SetMapper(mapper)
        self.property = volume.GetProperty()
        self.property.ShadeOn()
        self.property.SetInterpolationTypeToLinear()
        self.renderer.AddVolume(volume)
        self._look(scene, np.array(data_object().matrix_world, float) @ grid.world_from_index)

    def _look(self, scene, world_from_index: NDArray[np.float64]) -> None:
        """The camera and the sun in index coordinates."""
        from vtkmodules.vtkRenderingCore import vtkLight

        index_from_world = np.linalg.inv(world_from_index)
        turn = index_from_world[:3, :3]
        pose = np.array(scene.camera.matrix_world)
        eye = turn @ pose[:3, 3] + index_from_world[:3, 3]
        camera = self.renderer.GetActiveCamera()
        camera.SetPosition(*eye)
        camera.SetFocalPoint(*(eye - turn @ pose[:3, 2]))
        camera.SetViewUp(*(turn @ pose[:3, 1]))
        camera.SetViewAngle(np.degrees(scene.camera.data.angle_y))
        sun = vtkLight()
        sun.SetLightTypeToSceneLight()
        sun.SetFocalPoint(0, 0, 0)
        sun.SetPosition(*(turn @ np.array(bpy.data.objects["Key"].matrix_world)[:3, 2]))
        sun.PositionalOff()
        self.renderer.AddLight(sun)

    def picture(self, threshold: float) -> None:
        from vtkmodules.vtkCommonDataModel import vtkPiecewiseFunction
        from vtkmodules.vtkIOImage import vtkPNGWriter
        from vtkmodules.vtkRenderingCore import vtkColorTransferFunction, vtkWindowToImageFilter

        low, high = self.image.GetScalarRange()
        opacity, color = vtkPiecewiseFunction(), vtkColorTransferFunction()
        for value, alpha in (
            (low, 0.0),
            (threshold - 0.5, 0.0),
            (threshold + 0.5, 1.0),
            (high, 1.0),
        ):
            opacity.AddPoint(value, alpha)
        color.AddRGBPoint(low, GREY, GREY, GREY)
        self.property.SetScalarOpacity(opacity)
        self.property.SetColor(color)
        self.renderer.ResetCameraClippingRange()
        self.window.Render()
        shot, writer = vtkWindowToImageFilter(), vtkPNGWriter()
        shot.SetInput(self.window)
        writer.SetFileName(str(self.task.out))
        writer.SetInputConnection(shot.GetOutputPort())
        writer.Write()


PROGRAMS: dict[str, Callable[[Task, float], Program]] = {
    "LeapRay": ByLeapRay,
    "VTK rays": ByVtkRays,
    "VTK mesh, Cycles": ByMeshAndCycles,
}


# ---- a run -----------------------------------------------------------------


def main(words: list[str]) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("by", choices=PROGRAMS)
    parser.add_argument("path", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("width", type=int)
    parser.add_argument("height", type=int)
    parser.add_argument("thresholds", type=float, nargs="+")
    args = parser.parse_args(words)
    open_file.be_registered()
    task = Task(args.path, args.out, args.width, args.height)
    meter = memory.Meter()
    program: Program | None = None
    for threshold in args.thresholds:
        began = time.perf_counter()
        if program is None:
            program = PROGRAMS[args.by](task, threshold)
        program.picture(threshold)
        told = {"seconds": time.perf_counter() - began, "nbytes": meter.peak()}
        print(json.dumps(told), flush=True)
    return 0


if __name__ == "__main__":
    process.run(main, sys.argv[1:])
