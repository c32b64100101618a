# SPDX-License-Identifier: GPL-3.0-or-later
"""Environment textures are looked up as in Cycles, in every interpolation and through nodes."""

import math

import bpy
import numpy as np
import pytest
from blender_scenes import combined, fresh, nodes_of, plane, put
from test_materials import node

import leapray
from addon.blender import open_file
from addon.blender.read import lights
from addon.blender.read.warnings import Warnings

WIDTH, HEIGHT = 9, 5
ROWS = 24


def sky(is_float, after=None, interpolation="Linear", straight=True):
    """The scene, with an image round it."""
    scene = fresh()
    image = bpy.data.images.new("Sky", WIDTH, HEIGHT, alpha=True, float_buffer=is_float)
    rgba = np.random.default_rng(7).uniform(0, 1, (HEIGHT, WIDTH, 4)).astype(np.float32)
    if is_float:
        rgba[..., :3] *= 4
    image.pixels.foreach_set(rgba.ravel())
    image.alpha_mode = "STRAIGHT" if straight else "CHANNEL_PACKED"
    tree = nodes_of(scene.world)
    texture = node(tree, "TexEnvironment")
    texture.image, texture.interpolation = image, interpolation
    last = after(tree, texture) if after else texture
    background = tree.nodes["Background"]
    background.inputs["Strength"].default_value = 1.5
    tree.links.new(last.outputs[0], background.inputs["Color"])
    return scene


def all_around(scene):
    """(ROWS, 2 ROWS, 3) by Cycles."""
    put("Far", plane(size=1e-3), location=(0, 0, 1e4))
    scene.world.cycles.sampling_method = "NONE"  # saves its map
    camera = scene.camera
    camera.data.type = "PANO"
    owner = camera.data if hasattr(camera.data, "panorama_type") else camera.data.cycles
    owner.panorama_type = "EQUIRECTANGULAR"
    camera.location, camera.rotation_euler = (0, 0, 0), (math.pi / 2, 0, -math.pi / 2)
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = 2 * ROWS, ROWS
    scene.cycles.samples, scene.cycles.use_denoising = 1, False
    scene.cycles.use_adaptive_sampling = False
    scene.cycles.pixel_filter_type, scene.cycles.filter_width = "BLACKMAN_HARRIS", 0.01
    with open_file.quiet():
        bpy.ops.render.render()
    return combined(scene)[..., :3]


def ours(scene):
    notes = Warnings()
    world = lights.of_world(scene.world, notes)
    assert notes.sentences() == ()
    image = world.image
    core = leapray.Texture(
        image.pixels, image.interpolation, image.extension, image.program, points_only=True
    )
    u, v = (np.arange(2 * ROWS) + 0.5) / (2 * ROWS), (np.arange(ROWS) + 0.5) / ROWS
    uv = np.stack(np.meshgrid(u, v), -1).reshape(-1, 2)
    return core.sample(uv).reshape(ROWS, 2 * ROWS, 3) * world.color


def high(tree, texture):
    half = node(tree, "Gamma", Color=texture, Gamma=3.0)
    return ramp(tree, node(tree, "BrightContrast", Color=half, Bright=-4.0))


def ramp(tree, texture):
    made = node(tree, "ValToRGB", Fac=texture)
    made.color_ramp.interpolation = "CONSTANT"
    made.color_ramp.elements[1].position = 0.4
    return made


SKIES = [
    dict(is_float=True), dict(is_float=False), dict(is_float=False, straight=False),
    dict(is_float=True, interpolation="Closest"), dict(is_float=False, interpolation="Closest"),
    dict(is_float=True, interpolation="Cubic"), dict(is_float=False, interpolation="Smart"),
    dict(is_float=False, after=ramp), dict(is_float=True, after=high, interpolation="Cubic"),
]  # fmt: skip


@pytest.mark.parametrize("made", SKIES)
def test_looks_are_those_of_cycles(made):
    scene = sky(**made)
    got = ours(scene)
    want = all_around(scene)
    wrong = np.abs(got - want).max(axis=-1) > 4e-3 * max(1, want.max())
    assert want.std() > 0.05
    # a pixel's middle may lie on a step
    assert wrong.mean() <= (0.005 if "after" in made or "Closest" in made.values() else 0)


def test_a_sky_that_takes_light_away():
    """Negative pixels, and a negative strength by a Math node, whose socket cannot hold it."""
    scene = sky(is_float=True)
    tree = scene.world.node_tree
    image = next(n for n in tree.nodes if n.bl_idname == "ShaderNodeTexEnvironment").image
    pixels = np.empty(WIDTH * HEIGHT * 4, np.float32)
    image.pixels.foreach_get(pixels)
    pixels.reshape(-1, 4)[::2, :3] *= -1
    image.pixels.foreach_set(pixels)
    strength = node(tree, "Math", Value=-0.5, Value_001=1.0)
    strength.operation = "MULTIPLY"
    tree.links.new(strength.outputs[0], tree.nodes["Background"].inputs["Strength"])
    got, want = ours(scene), all_around(scene)
    assert want.min() < -0.5 and want.max() > 0.5
    assert np.abs(got - want).max() < 4e-3 * want.max()


def test_a_steep_sky_is_sampled_without_bias():
    """Light that lies between a texel's looks is found."""
    from shading import look_at_world, sample_world, sphere_grid

    pixels = np.random.default_rng(2).uniform(0, 1, (8, 16, 3)).astype(np.float32)
    step = leapray.operate("greater_than", leapray.INPUTS[0], 0.9)
    texture = leapray.Texture(pixels, program=leapray.compile_program((step, step, step)))
    world = leapray.World((1, 1, 1), texture)
    u = np.random.default_rng(3).random((400_000, 2))
    rays = sample_world(world, u)
    d, solid = sphere_grid(700)
    seen = look_at_world(world, d)
    assert (seen["pdf"] > 0).all()
    mean = (rays["color"][:, 0] / rays["pdf"]).mean()
    assert mean == pytest.approx(seen["color"][:, 0].sum() * solid, rel=0.01)
