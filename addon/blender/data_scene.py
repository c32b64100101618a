# SPDX-License-Identifier: GPL-3.0-or-later
"""A scene made round a file of measured data: from a scan to a picture without a .blend.

The camera looks from above and aside, in three-quarter view, and sees the whole data. Anatomical
data show their front, which in right, anterior, superior is +y; others Blender's, which is -y.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix, Vector
from numpy.typing import NDArray

import leapray

from .. import methods
from ..plan import objects
from . import open_file, volume_data, volume_looks
from .read.links import node_tree

SIDE = 1024  # pixels of the picture, unless asked otherwise
MILLIMETRES = 1e-3  # in metres: the unit of anatomical data,
ANATOMICAL = ".nii", ".nii.gz", ".dcm", ".dicom", ".ima"  # or what their files are called
FROM = (0.5, -0.8, 0.2)  # where the camera stands, as seen from the data
ABOVE = (0.4, -0.6, 0.7)  # likewise, of data that are cut across z
DARK, BRIGHT = 0.01, 0.99  # shares of the inside's samples between which the cut shows greys
LENS = 85.0  # mm, as for portraits
ROOM = 1.02  # of the picture round the data
KEY, FILL = (4.0, (-0.5, -0.9, 0.6)), (0.5, (0.9, -0.3, 0.2))  # strength, and where it comes from
SHADOWED = 2.0  # of the strengths: half of what a volume reflects stays within its own shadow
SKY = (0.05, 0.055, 0.065)


def make(
    path: Path,
    threshold: float | None = None,
    interpolation: str | None = None,
    clip: tuple[str, float] | None = None,
    preset: str | None = None,
    method: str | None = None,
    tell: Callable[[str], None] = lambda sentence: None,
):
    """A new scene, in place of the one that is open, which shows the data of a file.

    threshold: of the surface, in the data's units; None: the automatic one. interpolation: of the
    samples; None: linear. clip: the axis across which the data are cut, and how far along their
    box. preset: shows a volume by that look, without a surface; tell is called with a sentence that
    says between which values. method: of rendering, for which the camera is chosen; None: by rays.
    Where no light falls on surfaces, colours are shown as they are. Raises LeapRayError where the
    file cannot be read.
    """
    open_file.empty_scene()
    scene = bpy.context.scene
    ob, grid = volume_data.add(scene, path.absolute())
    if threshold is not None:
        ob.data.leapray.automatic = False
        ob.data.leapray.threshold = threshold
        ob.data.leapray.shown = "threshold"
    if interpolation is not None:
        ob.data.leapray.interpolation = interpolation
    if preset is not None:
        tell(volume_looks.wear(ob, grid, preset))
    bpy.context.view_layer.update()
    corners = _corners(grid, np.array(ob.matrix_world))
    aside = np.array(ABOVE if clip is not None and clip[0] == "z" else FROM)
    front = aside / np.linalg.norm(aside)
    turn = np.diag([-1.0, -1.0, 1.0]) if _is_anatomical(path, grid) else np.eye(3)
    if clip is not None:
        _cut(scene, ob, grid, corners, turn @ front, "xyz".index(clip[0]), clip[1])
    scene.render.resolution_x = scene.render.resolution_y = SIDE
    scene.render.resolution_percentage = 100
    scene.camera = _camera(scene, corners, turn @ front)
    chosen = methods.find(method) if method else methods.RAYS
    if chosen.image is not None and not chosen.image.perspective:
        scene.camera.data.type = "ORTHO"
    if preset is not None or chosen != methods.RAYS:
        scene.view_settings.view_transform = "Standard"
    shadowed = SHADOWED if ob.data.leapray.gradient_shading > 0.0 else 1.0
    for name, (strength, origin) in (("Key", KEY), ("Fill", FILL)):
        _sun(scene, name, strength * shadowed, turn @ np.array(origin))
    _sky(scene)
    return scene


def _cut(
    scene, ob, grid: leapray.ScalarGrid, corners: NDArray, front: NDArray, axis: int, share: float
) -> None:
    """Take away what lies between a plane across the data and the camera."""
    place = (corners.min(axis=0) + corners.max(axis=0)) / 2
    place[axis] = (1 - share) * corners[:, axis].min() + share * corners[:, axis].max()
    towards = np.zeros(3)
    towards[axis] = np.copysign(1.0, front[axis])
    plane = bpy.data.objects.new("Cut", None)
    turn = Vector(towards.tolist()).to_track_quat("Z", "Y").to_matrix().to_4x4()
    plane.matrix_world = Matrix.Translation(Vector(place.tolist())) @ turn
    scene.collection.objects.link(plane)
    own = ob.data.leapray
    own.clip_object = plane
    if own.shown != "threshold" and grid.kind == "labels":
        return  # which are shown by their own materials
    threshold = leapray.first_threshold(grid)[0] if own.automatic else own.threshold
    ob.data.materials.append(_greys(*_shown_values(grid, threshold)))


def _shown_values(grid: leapray.ScalarGrid, threshold: float) -> tuple[float, float]:
    """Values between which most of the samples inside a surface lie."""
    least, most = leapray.histogram(grid, 1).edges[[0, -1]].tolist()
    inside = (least, threshold) if grid.kind == "level set" else (threshold, most)
    if not inside[0] < inside[1]:
        return threshold, threshold + 1.0
    told = leapray.histogram(grid, volume_looks.BINS, inside)
    low, high = volume_looks.between(grid, told, DARK * 100, BRIGHT * 100)
    return (low, high) if low < high else (threshold, threshold + 1.0)


def _greys(low: float, high: float):
    """A material that shines in greys from black at one value of the data to white at another."""
    made = bpy.data.materials.new("Cut")
    tree = node_tree(made)
    tree.nodes.clear()
    kinds = "Attribute", "MapRange", "ValToRGB", "Emission", "OutputMaterial"
    value, mapped, ramp, shine, output = (tree.nodes.new(f"ShaderNode{kind}") for kind in kinds)
    value.attribute_name = "value"
    mapped.inputs["From Min"].default_value, mapped.inputs["From Max"].default_value = low, high
    for start, end in (
        (value.outputs["Fac"], mapped.inputs["Value"]),
        (mapped.outputs["Result"], ramp.inputs["Fac"]),
        (ramp.outputs["Color"], shine.inputs["Color"]),
        (shine.outputs[0], output.inputs["Surface"]),
    ):
        tree.links.new(start, end)
    return made


def _is_anatomical(path: Path, grid: leapray.ScalarGrid) -> bool:
    named = path.is_dir() or path.name.lower().endswith(ANATOMICAL)
    return named or grid.meters == MILLIMETRES


def _corners(grid: leapray.ScalarGrid, world_from_object: NDArray) -> NDArray[np.float64]:
    """(8, 3): of the data in the world."""
    first, last = objects.lattice(grid)
    index = objects.box(np.array([first + 1, last - 1]))
    matrix = world_from_object @ grid.world_from_index
    return index @ matrix[:3, :3].T + matrix[:3, 3]


def _camera(scene, corners: NDArray[np.float64], front: NDArray[np.float64]):
    """A camera that stands in the direction of front and just sees all corners."""
    data = bpy.data.cameras.new("Camera")
    data.lens = LENS
    camera = bpy.data.objects.new("Camera", data)
    scene.collection.objects.link(camera)
    rotation = Vector(front.tolist()).to_track_quat("Z", "Y").to_matrix()
    right, up, back = np.array(rotation).T
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    offset = corners - middle
    half = data.sensor_width / (2 * LENS) / ROOM  # the tangent of half the angle of view
    across = np.maximum(np.abs(offset @ right), np.abs(offset @ up))
    distance = float((offset @ back + across / half).max())
    depth = distance - offset @ back
    place = Matrix.Translation(Vector((middle + distance * back).tolist()))
    camera.matrix_world = place @ rotation.to_4x4()
    data.ortho_scale = 2 * ROOM * float(across.max())
    data.clip_start = float(depth.min()) / 10
    data.clip_end = float(depth.max()) * 10
    return camera


def _sun(scene, name: str, strength: float, origin: NDArray[np.float64]) -> None:
    data = bpy.data.lights.new(name, "SUN")
    data.energy, data.angle = strength, math.radians(5)
    light = bpy.data.objects.new(name, data)
    light.rotation_euler = Vector(origin.tolist()).to_track_quat("Z", "Y").to_euler()
    scene.collection.objects.link(light)


def _sky(scene) -> None:
    world = scene.world = bpy.data.worlds.new("World")
    node_tree(world).nodes["Background"].inputs["Color"].default_value = (*SKY, 1.0)
