# SPDX-License-Identifier: GPL-3.0-or-later
"""Scenes read from Blender and lit by LeapRay have the light that Cycles gives them.

Both render the same few pixels with equal limits of bounces; what is compared
are means, whose noise at 64 samples is far below the tolerance of 1 %.
"""

import math

import bpy
import numpy as np
import pytest
from blender_scenes import combined, diffuse, fresh, light, mesh, nodes_of, plane, put
from numpy.testing import assert_allclose
from test_addon_lights import environment
from test_materials import node, surface, tree

from addon.blender import open_file

pytestmark = pytest.mark.slow


@pytest.fixture
def scene():
    """A camera that looks down on a ground of 12 m with a red cube on it, under a dim sky."""
    made = fresh()
    background = nodes_of(made.world).nodes["Background"]
    background.inputs["Color"].default_value = (0.1, 0.12, 0.15, 1)
    put("Ground", plane(size=12.0)).data.materials.append(diffuse("Stone", (0.6, 0.55, 0.5)))
    red = mesh(size=1.2)
    red.materials.append(diffuse("Red", (0.7, 0.3, 0.2)))
    put("Cube", red, location=(-1.5, 1, 0.6), rotation_euler=(0, 0, 0.5))
    made.camera.location, made.camera.rotation_euler = (0, -8, 5), (math.radians(60), 0, 0)
    return made


def both(scene, diffuse_bounces):
    """(h, w, 3) by Cycles and by LeapRay."""
    scene.render.resolution_x, scene.render.resolution_y = 96, 72
    cycles, own = scene.cycles, scene.leapray
    cycles.samples = own.samples = 64
    cycles.use_denoising = cycles.use_adaptive_sampling = False
    cycles.pixel_filter_type, own.pixel_filter = "BOX", "box"
    cycles.sample_clamp_indirect = cycles.blur_glossy = cycles.light_sampling_threshold = 0
    own.clamp_indirect = 0
    cycles.max_bounces = own.max_bounces = 8
    cycles.diffuse_bounces = own.diffuse_bounces = diffuse_bounces
    cycles.glossy_bounces = own.glossy_bounces = 4
    images = []
    for engine in ("CYCLES", "LEAPRAY"):
        scene.render.engine = engine
        with open_file.quiet():
            bpy.ops.render.render()
        images.append(combined(scene)[..., :3])
    return images


def agree(scene, diffuse_bounces=1, blocks=0.1):
    """The means are those of Cycles within 1 %, those of 12 x 12 pixels within `blocks` of that."""
    want, got = both(scene, diffuse_bounces)
    assert want.mean() > 0.05
    assert_allclose(got.mean(axis=(0, 1)), want.mean(axis=(0, 1)), rtol=0.01)
    means = [image.reshape(6, 12, 8, 12, 3).mean(axis=(1, 3)) for image in (want, got)]
    assert np.abs(means[1] - means[0]).max() < blocks * means[0].mean()


LIGHTS = [
    ("SUN", {"energy": 3.0, "angle": 0.2}),
    ("POINT", {"energy": 300.0, "shadow_soft_size": 0.4, "use_soft_falloff": False}),
    ("SPOT", {"energy": 800.0, "shadow_soft_size": 0.2, "spot_size": 1.2, "spot_blend": 0.4}),
    ("AREA", {"energy": 300.0, "shape": "ELLIPSE", "size": 2.0, "size_y": 0.7}),
    ("AREA", {"energy": 100.0, "shape": "DISK", "size": 1.0, "spread": 1.0}),
]


@pytest.mark.parametrize(("kind", "attributes"), LIGHTS)
def test_lights(scene, kind, attributes):
    ob = put("Light", light(kind, **attributes), location=(2.5, -2, 4))
    ob.rotation_euler = (0.5, 0.4, 0.3)
    agree(scene)


def ball(shader, x, y):
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.6, location=(x, y, 0.6), segments=64)
    made = bpy.context.object.data
    made.shade_smooth()
    made.materials.append(shader)


def test_a_turned_environment_texture(scene):
    pixels = np.full((32, 64, 3), 0.2)
    pixels[20:24, 10:14] = (30, 20, 10)
    pixels[:, 32:48] += (0, 0.3, 0.6)
    sky_tree, sky = environment(scene, pixels.astype(np.float32))
    place, mapping = (
        sky_tree.nodes.new(kind) for kind in ("ShaderNodeTexCoord", "ShaderNodeMapping")
    )
    mapping.inputs["Rotation"].default_value = (0.3, 0.2, 1.0)
    sky_tree.links.new(place.outputs["Generated"], mapping.inputs["Vector"])
    sky_tree.links.new(mapping.outputs["Vector"], sky.inputs["Vector"])
    made, output = tree("Mirror")
    surface(made, output, node(made, "BsdfGlossy", Color=(1, 1, 1), Roughness=0.0))
    ball(made, 1.5, -1.5)
    agree(scene)


def test_materials(scene):
    principled = [
        {"Base_Color": (0.8, 0.2, 0.1), "Roughness": 0.3},
        {"Base_Color": (0.8, 0.2, 0.1), "Alpha": 0.5},
        {"Base_Color": (0.9, 0.6, 0.2), "Metallic": 1.0, "Roughness": 0.25},
        {"Base_Color": (0.9, 0.95, 0.9), "Transmission_Weight": 1.0, "Roughness": 0.0},
        {"Emission_Color": (1, 0.5, 0.2), "Emission_Strength": 1.5},
    ]
    for number, values in enumerate(principled):
        made, output = tree(f"Principled {number}")
        surface(made, output, node(made, "BsdfPrincipled", **values))
        ball(made, 1.5 * (number % 3) - 0.7, 1.6 * (number // 3) - 2.2)
    made, output = tree("Mixed")
    shaders = [
        node(made, "BsdfTransparent", Color=(1, 0.6, 0.6)),
        node(made, "BsdfDiffuse", Color=(0.1, 0.1, 0.8)),
    ]
    mix = node(made, "MixShader", Fac=0.5, Shader=shaders[0], Shader_001=shaders[1])
    surface(made, output, mix)
    ball(made, 2.3, -0.6)
    put("Light", light("AREA", energy=250.0, size=1.0), location=(2.5, -3, 4))
    # Caustics are too noisy, and a light's reflection may lie half a pixel beside Cycles'.
    agree(scene, diffuse_bounces=0, blocks=0.25)


def test_an_image_on_a_floor(scene):
    pixels = np.random.default_rng(8).uniform(0, 1, (8, 8, 3))
    image = bpy.data.images.new("Tiles", 8, 8)
    image.pixels.foreach_set(np.dstack([pixels, np.ones((8, 8))]).astype(np.float32).ravel())
    image.pack()
    made, output = tree("Tiles")
    texture = node(made, "TexImage")
    texture.image, texture.interpolation = image, "Closest"
    surface(made, output, node(made, "BsdfDiffuse", Color=texture))
    ground = bpy.data.objects["Ground"].data
    ground.uv_layers.new(name="UVMap").uv.foreach_set(
        "vector", np.float32([[0, 0], [2, 0], [2, 2], [0, 2]]).ravel()
    )
    ground.materials[0] = made
    put("Sun", light("SUN", energy=3.0, angle=0.1), rotation_euler=(0.4, 0.3, 0))
    agree(scene)
