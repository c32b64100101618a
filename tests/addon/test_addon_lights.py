# SPDX-License-Identifier: GPL-3.0-or-later
"""Lights and worlds in the core's units, against Cycles."""

import math

import bpy
import numpy as np
import pytest
from blender_scenes import (
    cycles_radiance,
    diffuse,
    fresh,
    light,
    mesh,
    nodes_of,
    plane,
    put,
    read,
)
from mathutils import Vector
from numpy.testing import assert_allclose

import leapray
from addon import pipeline
from addon.blender.read import colors


@pytest.fixture
def scene():
    return fresh()


AT = 40.0  # metres above the ground: to a light of 1 m that is as good as infinity
LIGHTS = [
    ("SUN", {"energy": math.pi, "angle": 0.0}),
    ("SUN", {"energy": 2.0, "angle": 0.2, "color": (1.0, 0.5, 0.25)}),
    ("SUN", {"energy": 1.0, "angle": 0.0, "exposure": 1.5}),
    ("SUN", {"energy": 1.0, "angle": 0.0, "use_temperature": True, "temperature": 3000.0}),
    ("SUN", {"energy": 30.0, "angle": 0.2, "normalize": False}),
    ("SUN", {"energy": 1.0, "angle": 0.0, "normalize": False}),
    ("POINT", {"energy": 1e4, "shadow_soft_size": 0.0}),
    ("POINT", {"energy": 1e4, "shadow_soft_size": 0.5, "exposure": -1.0}),
    ("POINT", {"energy": 1e4, "shadow_soft_size": 0.5, "normalize": False}),
    ("POINT", {"energy": 1e4, "shadow_soft_size": 0.0, "normalize": False}),
    ("SPOT", {"energy": 1e4, "shadow_soft_size": 0.0, "spot_size": 1.0, "spot_blend": 0.5}),
    ("SPOT", {"energy": 1e4, "shadow_soft_size": 0.5, "normalize": False}),
    ("AREA", {"energy": 1e4, "shape": "SQUARE", "size": 0.7, "size_y": 9.0}),
    ("AREA", {"energy": 1e4, "shape": "RECTANGLE", "size": 0.5, "size_y": 1.0}),
    ("AREA", {"energy": 1e4, "shape": "DISK", "size": 1.0, "size_y": 9.0}),
    ("AREA", {"energy": 1e4, "shape": "ELLIPSE", "size": 0.5, "size_y": 1.0}),
    ("AREA", {"energy": 1e4, "shape": "ELLIPSE", "size": 0.5, "size_y": 1.0, "normalize": False}),
]


@pytest.mark.parametrize(("kind", "attributes"), LIGHTS)
def test_light_units_are_those_of_cycles(scene, kind, attributes):
    ground = put("Ground", plane(size=100.0))
    ground.data.materials.append(diffuse("White"))
    put("Light", light(kind, **attributes), location=(0, 0, AT), scale=(3, 3, 3))
    (got,) = read().lights
    facing = np.array(got.color)
    if kind == "AREA":
        round_fraction = math.pi / 4 if attributes["shape"] in ("DISK", "ELLIPSE") else 1
        assert got.shape == ("ellipse" if round_fraction < 1 else "rectangle")
        facing *= round_fraction * np.linalg.norm(np.cross(got.axis_u, got.axis_v))
    facing /= 1.0 if kind == "SUN" else AT**2
    assert_allclose(facing / math.pi, cycles_radiance(scene), rtol=2e-3)


def test_lights_have_a_place_a_direction_a_size_and_nodes(scene):
    put("Cube", mesh())
    turned = {"rotation_euler": (0.3, 0.4, 0.5)}
    sun = put("Sun", light("SUN", energy=2.0, use_shadow=False, angle=0.3), **turned)
    put("Light", light("POINT", energy=4 * math.pi), location=(1, 2, 3), scale=(5, 5, 5))
    put("Soft", light("POINT", use_soft_falloff=True, shadow_soft_size=0.7))
    put("Spot", light("SPOT", spot_size=1.2, spot_blend=0.3, use_soft_falloff=False), **turned)
    area = put("Area", light("AREA", shape="RECTANGLE", size=2.0, size_y=3.0, spread=1.0), **turned)
    area.scale = (2, 1, 7)
    put("Dark", light("POINT", energy=0.0))
    put("Nowhere", light("POINT"), visible_diffuse=False, visible_glossy=False,
        visible_transmission=False, visible_volume_scatter=False)  # fmt: skip
    portal = light("AREA")
    portal.cycles.is_portal = True
    put("Portal", portal)
    emission = nodes_of(sun.data).nodes["Emission"]
    emission.inputs["Color"].default_value = (0.5, 1, 0, 1)
    emission.inputs["Strength"].default_value = 3.0
    bpy.context.view_layer.update()

    got = {each.name: each for each in read().lights}
    assert set(got) == {"Sun", "Light", "Soft", "Spot", "Area"}
    assert_allclose(got["Light"].position, (1, 2, 3))
    assert_allclose(got["Light"].color, 1.0, rtol=1e-6)
    assert got["Light"].casts_shadow and not got["Sun"].casts_shadow
    up = sun.matrix_world.to_3x3() @ Vector((0, 0, 1))
    assert_allclose(got["Sun"].direction, up, atol=1e-6)
    assert_allclose(got["Sun"].color, (3.0, 6.0, 0.0), rtol=1e-6)
    assert_allclose(got["Sun"].angle, 0.3, rtol=1e-6)
    assert (got["Soft"].shape, got["Spot"].shape) == ("disc", "sphere")
    assert_allclose(got["Soft"].radius, 0.7, rtol=1e-6)
    assert_allclose((got["Spot"].angle, got["Spot"].blend), (1.2, 0.3), rtol=1e-6)
    for name in ("Spot", "Area"):
        assert_allclose(got[name].direction, -up, atol=1e-6)
    sides = [sun.matrix_world.to_3x3() @ Vector(side) for side in ((4, 0, 0), (0, 3, 0))]
    assert_allclose((got["Area"].axis_u, got["Area"].axis_v), sides, atol=1e-6)
    assert_allclose(got["Area"].angle, 1.0)


def test_lights_are_seen_by_the_rays_that_may_see_them(scene):
    put("Cube", mesh())
    put("Light", light("POINT"), visible_glossy=False)
    put("Bulb", light("POINT"), visible_camera=True, visible_transmission=False)
    got = {each.name: each for each in read().lights}
    flags = ("visible_camera", "visible_diffuse", "visible_glossy", "visible_transmission",
             "visible_volume_scatter")  # fmt: skip
    assert [getattr(got["Light"], flag) for flag in flags] == [False, True, False, True, True]
    assert [getattr(got["Bulb"], flag) for flag in flags] == [True, True, True, False, True]


def test_black_bodies_are_those_of_blender():
    data = light("POINT", use_temperature=True)
    for kelvin in (900.0, 1000.0, 1300.0, 1700.0, 2500.0, 5000.0, 6500.0, 11000.0):
        data.temperature = kelvin
        want = np.array(data.temperature_color)
        assert_allclose(np.maximum(colors.blackbody(kelvin), 0), want, atol=0.02 * want.max())


def test_a_lights_nodes_may_be_a_black_body_with_falloff(scene):
    put("Cube", mesh())
    data = light("POINT", energy=4 * math.pi)
    put("Light", data)
    tree = nodes_of(data)
    emission = tree.nodes["Emission"]
    body, falloff = (
        tree.nodes.new(kind) for kind in ("ShaderNodeBlackbody", "ShaderNodeLightFalloff")
    )
    body.inputs["Temperature"].default_value = 3000.0
    falloff.inputs["Strength"].default_value = 2.0
    tree.links.new(body.outputs[0], emission.inputs["Color"])
    tree.links.new(falloff.outputs["Quadratic"], emission.inputs["Strength"])
    got = read()
    assert_allclose(got.lights[0].color, 2 * colors.blackbody(3000.0), rtol=1e-6)
    assert got.warnings == ()
    tree.links.new(falloff.outputs["Constant"], emission.inputs["Strength"])
    (warning,) = read().warnings
    assert "Light Falloff (Constant) in 'Light'" in warning


# ---- world -------------------------------------------------------------------


def test_the_world_is_its_background_node(scene):
    put("Cube", mesh())
    tree = nodes_of(scene.world)
    background = tree.nodes["Background"]
    background.inputs["Color"].default_value = (0.5, 0.25, 0.1, 1)
    background.inputs["Strength"].default_value = 2.0
    assert_allclose(read().world.color, (1.0, 0.5, 0.2), rtol=1e-6)
    noise = tree.nodes.new("ShaderNodeTexNoise")
    tree.links.new(noise.outputs["Color"], background.inputs["Color"])
    got = read()
    assert_allclose(got.world.color, (1.0, 0.5, 0.2), rtol=1e-6)  # what the socket holds
    assert "Noise Texture in 'World'" in got.warnings[0]
    tree.links.remove(tree.nodes["World Output"].inputs["Surface"].links[0])
    assert read().world.color == (0, 0, 0)
    scene.world = None
    assert read().world.color == (0, 0, 0)


def environment(scene, pixels):
    """The world's tree with an environment texture of these colours (h, w, 3)."""
    image = bpy.data.images.new("Sky", pixels.shape[1], pixels.shape[0], float_buffer=True)
    rgba = np.ones((*pixels.shape[:2], 4), np.float32)
    rgba[..., :3] = pixels
    image.pixels.foreach_set(rgba.ravel())
    tree = nodes_of(scene.world)
    sky = tree.nodes.new("ShaderNodeTexEnvironment")
    sky.image = image
    tree.links.new(sky.outputs["Color"], tree.nodes["Background"].inputs["Color"])
    return tree, sky


def test_an_environment_texture_is_turned_and_scaled(scene):
    put("Cube", mesh())
    pixels = np.random.default_rng(5).uniform(0, 4, (4, 8, 3)).astype(np.float32)
    tree, sky = environment(scene, pixels)
    tree.nodes["Background"].inputs["Strength"].default_value = 0.5
    got = read().world
    v, u = np.mgrid[:4, :8]
    uv = np.stack([(u.ravel() + 0.5) / 8, (v.ravel() + 0.5) / 4], 1)
    looks = leapray.Texture(got.image.pixels, program=got.image.program).sample(uv)
    assert_allclose(looks.reshape(pixels.shape), 0.5 * pixels, rtol=1e-6)
    assert_allclose(got.image_from_world, np.eye(3))
    mapping, place = (tree.nodes.new(kind) for kind in ("ShaderNodeMapping", "ShaderNodeTexCoord"))
    tree.links.new(place.outputs["Generated"], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs["Vector"], sky.inputs["Vector"])
    mapping.inputs["Rotation"].default_value = (0, 0, math.pi / 2)
    assert_allclose(read().world.image_from_world, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-6)
    mapping.vector_type = "TEXTURE"
    assert_allclose(read().world.image_from_world, [[0, 1, 0], [-1, 0, 0], [0, 0, 1]], atol=1e-6)
    mapping.inputs["Scale"].default_value = (1, 1, 2)
    got = read()
    assert got.world.image is None and "Environment Texture (Vector) in 'World'" in got.warnings[0]


def test_a_world_is_seen_by_the_rays_that_may_see_it(scene):
    put("Cube", mesh())
    flags = scene.world.cycles_visibility
    flags.camera = flags.transmission = False
    got = read().world
    seen = (got.visible_camera, got.visible_diffuse, got.visible_glossy, got.visible_transmission)
    assert seen == (False, True, True, False)
    assert got.visible_volume_scatter
    flags.scatter = False
    assert not read().world.visible_volume_scatter


def test_worlds_have_limits_and_may_be_negative(scene):
    put("Cube", mesh())
    background = nodes_of(scene.world).nodes["Background"].inputs
    background["Color"].default_value = (0.5, 0.25, 1, 1)
    background["Strength"].default_value = -2.0
    scene.world.cycles.max_bounces = 3
    got = read().world
    assert_allclose(got.color, (-1, -0.5, -2))
    assert got.max_bounces == 3


# ---- what is not finite, and what is not followed ---------------------------------

INFINITE = {
    "energy": ("POINT", {"energy": math.inf}),
    "no energy": ("SUN", {"energy": math.nan}),
    "overflow": ("SPOT", {"energy": 3e38, "color": (99.0, 99.0, 99.0), "spot_size": 1.0}),
    "exposure": ("AREA", {"energy": 1.0, "exposure": 1e4}),
    "color": ("POINT", {"color": (1.0, math.nan, 0.0)}),
    "radius": ("POINT", {"shadow_soft_size": math.inf}),
    "size": ("AREA", {"size": math.inf}),
    "no size": ("AREA", {"size": math.nan}),
    "angle": ("SUN", {"angle": math.nan}),
    "spread": ("AREA", {"spread": math.nan}),
    "cone": ("SPOT", {"spot_size": math.nan}),
    "blend": ("SPOT", {"spot_blend": math.nan}),
}


@pytest.mark.parametrize("name", INFINITE)
def test_a_light_that_is_not_finite_is_left_out_by_name(scene, name):
    kind, attributes = INFINITE[name]
    put("Cube", mesh())
    put("Good", light("POINT"))
    bad = light(kind)
    for key, value in attributes.items():
        setattr(bad, key, value)
    kept = all(np.allclose(getattr(bad, k), v, equal_nan=True) for k, v in attributes.items())
    put("Bad", bad)
    got = read()
    if not kept:  # Blender itself does not take the value
        assert got.warnings == ()
        return
    assert [each.name for each in got.lights] == ["Good"]
    (sentence,) = got.warnings
    assert sentence.startswith("Skipped 'Bad'")
    pipeline.render(got)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 3e38])
def test_strengths_from_nodes_that_are_not_finite_are_named(scene, value):
    put("Cube", mesh())
    bad = light("POINT", energy=100.0)
    nodes_of(bad).nodes["Emission"].inputs["Strength"].default_value = value
    put("Bad", bad)
    nodes_of(scene.world).nodes["Background"].inputs["Color"].default_value = (9, 1, 1, 1)
    nodes_of(scene.world).nodes["Background"].inputs["Strength"].default_value = value
    got = read()
    assert got.lights == () and got.world.color == (0, 0, 0)
    assert len(got.warnings) == 1 or all("finite" in each for each in got.warnings)
    assert "'Bad'" in str(got.warnings) and "'World'" in str(got.warnings)
    assert np.isfinite(pipeline.render(got).passes["Combined"]).all()


def test_pixels_of_the_sky_that_are_not_finite_give_no_light(scene):
    put("Cube", mesh())
    pixels = np.ones((4, 8, 3), np.float32)
    pixels[1, 2] = math.nan, 1, 1
    pixels[3, 5] = math.inf
    environment(scene, pixels)
    got = read()
    sky = got.world.image.pixels
    assert not sky[1, 2].any() and not sky[3, 5].any()
    assert sky.sum() == pytest.approx(30 * 3, rel=1e-5)
    (sentence,) = got.warnings
    assert sentence == "Image 'Sky' has 2 pixels that are not finite: they are black"
    assert np.isfinite(pipeline.render(got).passes["Combined"]).all()


def test_what_lights_are_not_followed_in_is_named(scene):
    cube = put("Cube", mesh())
    portal = light("AREA")
    portal.cycles.is_portal = True
    put("Portal", portal)
    linked, blocked, measured = (put(n, light("POINT")) for n in ("Linked", "Blocked", "Measured"))
    linked.light_linking.receiver_collection = bpy.data.collections.new("Receivers")
    blocked.light_linking.blocker_collection = bpy.data.collections.new("Blockers")
    cube.light_linking.receiver_collection = bpy.data.collections.new("Receivers")
    tree = nodes_of(measured.data)
    profile = tree.nodes.new("ShaderNodeTexIES")
    tree.links.new(profile.outputs[0], tree.nodes["Emission"].inputs["Strength"])
    said = sorted(read().warnings)
    assert said[0].startswith("Light linking is not supported yet: ")
    assert "'Cube'" in said[0] and "'Linked'" in said[0]
    assert said[1] == "Light portals are not supported yet: 'Portal'"
    assert said[2].startswith("Not understood") and "IES Texture" in said[2]
    assert "'Measured'" in said[2]
    assert said[3:] == ["Shadow linking is not supported yet: 'Blocked'"]
