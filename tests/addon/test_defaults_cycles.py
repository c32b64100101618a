# SPDX-License-Identifier: GPL-3.0-or-later
"""A first picture, without a setting touched: as bright as Cycles' own at its defaults."""

import bpy
import numpy as np
import pytest
from blender_scenes import combined, fresh, light, mesh, nodes_of, plane, put
from mathutils import Vector

from addon.blender import engine, open_file

# Noise: the darkest of these pictures varies by 0.1 % from seed to seed.
LIMIT = 0.01


def startup():
    """Blender's own scene: a cube, a point light and a grey world."""
    bpy.ops.wm.read_factory_settings()
    return bpy.context.scene


def room():
    """A box without a window, a cube in it, below an area light."""
    scene = startup()
    bpy.data.objects.remove(bpy.data.objects["Light"])
    cube = bpy.data.objects["Cube"]
    cube.location, cube.scale = (0, 0, 0.6), (0.6, 0.6, 0.6)
    put("Room", mesh("Room", size=6.0), location=(0, 0, 3))
    put("Area", light("AREA", energy=200.0, size=1.5), location=(0, 0, 5.8))
    camera = scene.camera
    camera.location = (2.5, -2.5, 2.2)
    away = camera.location - Vector((0, 0, 1))
    camera.rotation_euler = away.to_track_quat("Z", "Y").to_euler()
    return scene


def outdoors():
    """The cube on a plane below an image of a sky with a sun."""
    scene = startup()
    bpy.data.objects.remove(bpy.data.objects["Light"])
    put("Ground", plane(size=10.0), location=(0, 0, -1))
    height, width = 64, 128
    image = bpy.data.images.new("Sky", width, height, float_buffer=True)
    y, x = np.mgrid[:height, :width]
    pixels = np.ones((height, width, 4), np.float32)
    pixels[..., :3] = np.array([0.3, 0.4, 0.5]) * (1 + y / height)[..., None]
    pixels[(x - 30) ** 2 + (y - 50) ** 2 < 8, :3] = (400, 360, 300)
    image.pixels.foreach_set(pixels.ravel())
    tree = nodes_of(scene.world)
    texture = tree.nodes.new("ShaderNodeTexEnvironment")
    texture.image = image
    tree.links.new(texture.outputs[0], tree.nodes["Background"].inputs["Color"])
    return scene


@pytest.mark.parametrize("make", [startup, room, outdoors])
def test_a_first_picture_is_as_bright_as_cycles_has_it(make):
    fresh()  # registers
    scene = make()
    scene.render.resolution_x, scene.render.resolution_y = 48, 27
    scene.render.resolution_percentage = 100
    means = {}
    for name in ("CYCLES", "LEAPRAY"):
        scene.render.engine = name
        engine.failures.clear()
        with open_file.quiet():
            bpy.ops.render.render()
        means[name] = combined(scene)[..., :3].mean(axis=(0, 1))
    (report,) = engine.reports.values()
    assert report["warnings"] == []
    assert means["LEAPRAY"] == pytest.approx(means["CYCLES"], rel=LIMIT)
    assert means["CYCLES"].min() > 0.03
