# SPDX-License-Identifier: GPL-3.0-or-later
"""VTK's ray caster on the CPU on the head of `study volume` (PyPI's `vtk`, optional; no bpy).

It takes the directions of the light and of the view as the same for the whole picture, and has no
shadows.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

import leapray

from .volume_subject import EYE, HALF, Subject

KNOTS = 24  # of its opacity between two of the transfer function's


class VtkRays:
    """One step, with the attributes of `volume.Way`. Its picture has eight bits a channel.

    phong: how samples are lit; None: not at all.
    """

    name, spec, leaps, sampling, stop = "VTK", "", True, "post", 1.0

    def __init__(self, subject: Subject, step: float, phong: leapray.Phong | None = None) -> None:
        import vtkmodules.vtkRenderingOpenGL2
        import vtkmodules.vtkRenderingVolumeOpenGL2  # noqa: F401
        from vtkmodules.vtkRenderingCore import vtkRenderer, vtkRenderWindow, vtkVolume
        from vtkmodules.vtkRenderingVolume import vtkFixedPointVolumeRayCastMapper

        self.number = step
        self.image = image_of(subject)
        self.window = vtkRenderWindow()
        self.window.SetOffScreenRendering(1)
        self.window.SetMultiSamples(0)
        self.window.SetSize(subject.width, subject.height)
        renderer = vtkRenderer()
        self.window.AddRenderer(renderer)
        mapper = vtkFixedPointVolumeRayCastMapper()
        mapper.SetInputData(self.image)
        mapper.SetNumberOfThreads(1)
        mapper.SetAutoAdjustSampleDistances(0)
        mapper.SetLockSampleDistanceToInputSpacing(0)
        mapper.SetImageSampleDistance(1)
        mapper.SetSampleDistance(step * subject.voxel)
        mapper.SetInteractiveSampleDistance(step * subject.voxel)
        volume = vtkVolume()
        volume.SetMapper(mapper)
        dress(volume.GetProperty(), subject)
        if phong is not None:
            light(renderer, volume.GetProperty(), phong)
        renderer.AddVolume(volume)
        look(renderer, subject)
        renderer.ResetCameraClippingRange()

    def run(self, subject: Subject, *, count: bool = False) -> None:
        self.window.Modified()
        self.window.Render()

    def picture(self, subject: Subject) -> NDArray[np.float64]:
        """(n, 4) colours of all pixels, and 1."""
        from vtkmodules.util.numpy_support import vtk_to_numpy
        from vtkmodules.vtkRenderingCore import vtkWindowToImageFilter

        self.run(subject)
        shot = vtkWindowToImageFilter()
        shot.SetInput(self.window)
        shot.ReadFrontBufferOff()
        shot.Update()
        found = vtk_to_numpy(shot.GetOutput().GetPointData().GetScalars())[:, :3] / 255.0
        return np.column_stack([found, np.ones(len(found))])


def image_of(subject: Subject):
    """The samples as VTK has them, in the data's own units; the matrix only scales and moves."""
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonDataModel import vtkImageData

    image = vtkImageData()
    samples = np.ascontiguousarray(subject.stored)
    matrix = np.asarray(subject.grid.world_from_index, float)
    image.SetDimensions(*samples.shape[::-1])
    image.SetSpacing(*np.diag(matrix)[:3])
    image.SetOrigin(*matrix[:3, 3])
    image.GetPointData().SetScalars(numpy_to_vtk(samples.reshape(-1), deep=True))
    return image


def dress(own, subject: Subject) -> None:
    """The transfer function: opacity is per voxel."""
    from vtkmodules.vtkCommonDataModel import vtkPiecewiseFunction
    from vtkmodules.vtkRenderingCore import vtkColorTransferFunction

    knots = np.asarray(subject.transfer.values)
    opacity, color = vtkPiecewiseFunction(), vtkColorTransferFunction()
    ends = [float(knots[0]) - 1e4, float(knots[-1]) + 1e4]
    fine = [np.linspace(a, b, KNOTS, endpoint=False) for a, b in pairwise(knots)]
    for value in [ends[0], *np.concatenate(fine), float(knots[-1]), ends[1]]:
        extinction = np.interp(value, knots, subject.transfer.extinction)
        opacity.AddPoint(value, 1 - np.exp(-extinction * subject.voxel))
    for value, each in zip(knots, np.asarray(subject.transfer.colors), strict=True):
        color.AddRGBPoint(value, *each)
    own.SetScalarOpacity(opacity)
    own.SetColor(color)
    own.SetScalarOpacityUnitDistance(subject.voxel)
    own.SetInterpolationTypeToLinear()
    own.ShadeOff()


def light(renderer, own, phong: leapray.Phong) -> None:
    """Phong's model with the only light, which has a direction."""
    from vtkmodules.vtkRenderingCore import vtkLight

    lamp = vtkLight()
    lamp.SetLightTypeToSceneLight()
    lamp.SetPosition(*np.asarray(phong.light, float))
    lamp.SetFocalPoint(0.0, 0.0, 0.0)
    lamp.SetAmbientColor(1.0, 1.0, 1.0)
    renderer.AutomaticLightCreationOff()
    renderer.RemoveAllLights()
    renderer.AddLight(lamp)
    own.ShadeOn()
    own.SetAmbient(phong.ambient)
    own.SetDiffuse(phong.diffuse)
    own.SetSpecular(phong.specular)
    own.SetSpecularPower(phong.power)


def look(renderer, subject: Subject) -> None:
    """The camera."""
    camera = renderer.GetActiveCamera()
    camera.SetPosition(*EYE)
    camera.SetFocalPoint(0.0, 0.0, 0.0)
    camera.SetViewUp(0.0, 0.0, 1.0)
    camera.SetViewAngle(2 * np.degrees(np.arctan(HALF * subject.height / subject.width)))
