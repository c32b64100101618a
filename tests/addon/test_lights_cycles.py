# SPDX-License-Identifier: GPL-3.0-or-later
"""Lights that surprise, against Cycles: negative, narrow, sheared, with limits of their own."""

from __future__ import annotations

import math

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")
from blender_scenes import diffuse, light, mesh, nodes_of, plane, put  # noqa: E402
from engines import bare, blocks, both, render, warnings  # noqa: E402
from mathutils import Matrix  # noqa: E402
from numpy.testing import assert_allclose  # noqa: E402


def floor(size=12.0, above=14.0):
    """A white floor under an orthographic camera that sees all of it."""
    scene = bare()
    ground = put("Floor", plane(size=4 * size))
    ground.data.materials.append(diffuse("White"))
    scene.camera.location.z = above
    scene.camera.data.type, scene.camera.data.ortho_scale = "ORTHO", size
    return scene


def image_world(scene, pixels):
    """A world that is this picture (h, w, 3)."""
    image = bpy.data.images.new("Sky", pixels.shape[1], pixels.shape[0], float_buffer=True)
    rgba = np.ones((*pixels.shape[:2], 4), np.float32)
    rgba[..., :3] = pixels
    image.pixels.foreach_set(rgba.ravel())
    image.pack()
    tree = nodes_of(scene.world)
    sky = tree.nodes.new("ShaderNodeTexEnvironment")
    sky.image = image
    tree.links.new(sky.outputs["Color"], tree.nodes["Background"].inputs["Color"])


def assert_same_light(pair, rtol=0.02, side=8):
    """Blocks of the pictures agree, up to a share of the brightest one."""
    cycles, ours = (blocks(each["Combined"][..., :3], side) for each in pair)
    assert np.abs(cycles).max() > 1e-3
    assert_allclose(ours, cycles, rtol=rtol, atol=rtol * np.abs(cycles).max())


# ---- light that is taken away -------------------------------------------------


def test_lights_of_all_kinds_take_light_away():
    scene = floor()
    put("Sun", light("SUN", energy=3.0, angle=0.0))
    put("Bulb", light("POINT", energy=-600.0, shadow_soft_size=0.3), location=(-4, -4, 2))
    put("Point", light("POINT", energy=-300.0, shadow_soft_size=0.0), location=(4, 4, 2))
    put("Spot", light("SPOT", energy=-900.0, spot_size=1.0), location=(-4, 4, 3))
    put("Area", light("AREA", energy=-300.0, size=2.0, spread=1.5), location=(4, -4, 2))
    put("Dusk", light("SUN", energy=-0.4, angle=0.5), rotation_euler=(0.8, 0, 0))
    put("Blue", light("POINT", energy=200.0, color=(0.5, -0.5, 1.0)), location=(0, 0, 2))
    by_nodes = light("POINT", energy=100.0)
    nodes_of(by_nodes).nodes["Emission"].inputs["Strength"].default_value = -1.0
    put("Nodes", by_nodes, location=(0, 4, 2))
    pair = both(scene, 64)
    assert (pair[0]["Combined"][..., :3] < 0).any()  # not only dimmed
    assert_same_light(pair)
    assert warnings() == []


def test_the_tree_chooses_negative_lights_by_their_magnitude():
    scene = floor()
    put("Sun", light("SUN", energy=2.0, angle=0.0))
    for k in range(25):
        sign = -1 if k % 2 else 1
        put(f"Light {k}", light("POINT", energy=sign * (20.0 + 10 * k), shadow_soft_size=0.1),
            location=(2.4 * (k % 5) - 4.8, 2.4 * (k // 5) - 4.8, 1.5))  # fmt: skip
    assert_same_light(both(scene, 128), rtol=0.04)


@pytest.mark.parametrize("kind", ["color", "image"])
def test_worlds_take_light_away(kind):
    scene = floor()
    put("Sun", light("SUN", energy=3.0, angle=0.0))
    background = nodes_of(scene.world).nodes["Background"].inputs
    if kind == "color":
        background["Color"].default_value = (0.2, 0.4, 0.1, 1)
        background["Strength"].default_value = -1.0
    else:
        pixels = np.zeros((16, 32, 3), np.float32)
        pixels[8:, :16] = -0.5, 0.5, -0.2
        pixels[12, 20] = -20, 5, 8
        image_world(scene, pixels)
    assert_same_light(both(scene, 128), rtol=0.03)


def test_clamps_keep_light_that_is_taken_away_within_bounds():
    scene = floor()
    scene.cycles.sample_clamp_direct = scene.leapray.clamp_direct = 0.2
    hole = light("POINT", energy=-90.0, shadow_soft_size=0.0, color=(1, -0.5, 0.2))
    put("Hole", hole, location=(0, 0, 2))
    pair = both(scene, 4)
    assert np.abs(pair[0]["Combined"][..., :3]).mean(-1).max() == pytest.approx(0.2, rel=1e-5)
    assert_same_light(pair)


def test_pixels_below_black_settle():
    scene = floor()
    put("Sun", light("SUN", energy=-3.0, angle=0.0))
    scene.leapray.noise_threshold, scene.leapray.min_samples = 0.01, 4
    assert_allclose(render(scene, "LEAPRAY", 4096)["Combined"][..., :3], -3 / math.pi, rtol=1e-4)


# ---- area lights ----------------------------------------------------------------


SPREADS = [  # degrees, shape, sides, height
    (3, "SQUARE", (2.0, 2.0), 3.0),
    (3, "DISK", (2.0, 2.0), 3.0),
    (10, "RECTANGLE", (4.0, 0.1), 3.0),
    (10, "ELLIPSE", (4.0, 1.0), 3.0),
    (60, "DISK", (2.0, 2.0), 1.0),
    (170, "SQUARE", (2.0, 2.0), 0.5),
]


@pytest.mark.parametrize(("degrees", "shape", "sides", "height"), SPREADS)
def test_narrow_spreads_are_as_even_as_in_cycles(degrees, shape, sides, height):
    scene = floor(size=1.6)
    scene.render.resolution_x = scene.render.resolution_y = 12
    data = light("AREA", energy=300.0, shape=shape, spread=math.radians(degrees))
    data.size, data.size_y = sides
    put("Area", data, location=(0.4, 0.0, height))
    seen = [each["Combined"][..., 0] for each in both(scene, 64)]
    truth = render(scene, "CYCLES", 2048)["Combined"][..., 0]
    off, ours_off = (np.sqrt(((each - truth) ** 2).mean()) for each in seen)
    assert ours_off < 2 * off + 1e-3 * truth.max()
    assert seen[1].mean() == pytest.approx(truth.mean(), rel=0.01)


def test_a_spread_of_0_collimates():
    scene = floor(size=4.0)
    put(
        "Collimated",
        light("AREA", energy=30.0, shape="DISK", size=2.0, spread=0.0),
        location=(0, 0, 5),
    )
    pair = both(scene, 64)
    assert_same_light(pair, side=4)
    assert pair[1]["Combined"][12, 12, 0] == pytest.approx(30 / math.pi / math.pi, rel=1e-4)
    assert not pair[1]["Combined"][1, 1, 0]


SHEARS = {
    "sides": ((1, 0.8, 0), (0, 1, 0), (0, 0, 1)),
    "leaning": ((1, 0, 0.6), (0, 1, 0), (0, 0, 1)),
    "tilted": ((1, 0, 0), (0, 1, 0), (0.6, 0, 1)),
    "all": ((1, 0.5, 0.3), (0, 1.2, 0.4), (0, -0.2, 0.9)),
}


@pytest.mark.parametrize("shape", ["RECTANGLE", "ELLIPSE"])
@pytest.mark.parametrize("shear", SHEARS)
def test_sheared_area_lights_emit_as_in_cycles(shear, shape):
    scene = floor()
    data = light("AREA", energy=300.0, shape=shape, size=1.0, size_y=1.5)
    frame = put("Frame", None)  # whose inverse is what shears its child
    child = put("Area", data, parent=frame)
    child.matrix_parent_inverse = Matrix.Translation((0, 0, 4)) @ Matrix(SHEARS[shear]).to_4x4()
    assert_same_light(both(scene, 128), rtol=0.02)


# ---- limits of bounces ----------------------------------------------------------


def room(*names):
    """A grey room without a front, and lights: of 100 W, but for the world."""
    scene = bare(32, 24)
    scene.camera.location = 0, -7, 0
    scene.camera.rotation_euler = math.pi / 2, 0, 0
    walls = mesh("Walls", 4.0)
    walls.materials.append(diffuse("Grey", (0.7, 0.7, 0.7)))
    put("Walls", walls).scale = 1.0, 1.0, 1.0
    from bmesh import new, ops

    open_mesh = new()
    open_mesh.from_mesh(walls)
    front = min(open_mesh.faces, key=lambda face: face.calc_center_median().y)
    ops.delete(open_mesh, geom=[front], context="FACES_ONLY")
    open_mesh.to_mesh(walls)
    return scene


LIMITED = {
    "point": ("POINT", {"energy": 100.0, "shadow_soft_size": 0.1}),
    "large bulb": ("POINT", {"energy": 100.0, "shadow_soft_size": 1.0}),
    "area": ("AREA", {"energy": 100.0, "size": 3.0}),
    "spot": ("SPOT", {"energy": 100.0, "spot_size": 2.0}),
}


@pytest.mark.parametrize("limit", [0, 1, 2])
@pytest.mark.parametrize("name", LIMITED)
def test_a_light_has_its_own_limit_of_bounces(name, limit):
    if limit == 2 and name != "point":
        return
    scene = room()
    kind, values = LIMITED[name]
    data = light(kind, **values)
    data.cycles.max_bounces = limit
    put("Light", data, location=(0, 0, 1))
    cycles, ours = both(scene, 96, bounces=3)
    means = [each["Combined"][..., :3].mean() for each in (cycles, ours)]
    assert means[1] == pytest.approx(means[0], rel=0.015)
    data.cycles.max_bounces = 1024
    assert render(scene, "LEAPRAY", 32, bounces=3)["Combined"][..., :3].mean() > 1.03 * means[1]


def test_a_world_has_its_own_limit_of_bounces():
    scene = room()
    pixels = np.zeros((8, 16, 3), np.float32)
    pixels[4, 12] = 60.0  # before the open front
    image_world(scene, pixels)
    scene.world.cycles.max_bounces = 0
    cycles, ours = both(scene, 128, bounces=3)
    means = [each["Combined"][..., :3].mean() for each in (cycles, ours)]
    assert means[1] == pytest.approx(means[0], rel=0.03)
