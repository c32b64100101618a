# SPDX-License-Identifier: GPL-3.0-or-later
"""What the engine keeps from frame to frame: what has not changed is not voxelized again."""

from pathlib import Path

import bpy
import numpy as np
import pytest
from blender_scenes import diffuse, exr, fresh, light, mesh, nodes_of, plane, put

from addon.blender import engine, open_file

SAMPLES = Path(__file__).parents[2] / "blend_samples"
N_FRAMES = 10


@pytest.fixture(autouse=True)
def nothing_kept():
    """Volumes that the engine keeps go with the test."""
    yield
    engine._volumes.clear()


def textured(name, n=8):
    """A material with an image over the UVs, and the image."""
    image = bpy.data.images.new(name, n, n, float_buffer=True)
    paint(image, 0)
    made = bpy.data.materials.new(name)
    tree = nodes_of(made)
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    tree.links.new(node.outputs["Color"], tree.nodes["Principled BSDF"].inputs["Base Color"])
    return made, image


def paint(image, seed):
    n = image.size[0] * image.size[1]
    pixels = np.ones((n, 4), np.float32)
    pixels[:, :3] = np.random.default_rng(seed).uniform(0, 1, (n, 3))
    image.pixels.foreach_set(pixels.ravel())
    image.update()


@pytest.fixture
def scene(tmp_path):
    """A still ball, a block that turns, a sheet with a picture; 10 frames."""
    made = fresh()
    made.frame_start, made.frame_end = 1, N_FRAMES
    made.render.use_persistent_data = True
    made.leapray.samples = 1
    ball = put("Ball", mesh("Ball"), location=(-2, 1, 0))
    round_ = ball.modifiers.new("Round", "SUBSURF")
    round_.levels = round_.render_levels = 4
    block = put("Block", mesh("Block"), location=(2, 0, 0))
    block.rotation_euler = (0.4, 0.5, 0.0)
    block.keyframe_insert("rotation_euler", frame=1)
    block.rotation_euler = (0.4, 0.5, 2.0)
    block.keyframe_insert("rotation_euler", frame=N_FRAMES)
    sheet = put("Sheet", plane("Sheet", 5.0), location=(0, 0, -2))
    sheet.data.uv_layers.new(name="UVMap")
    material, _ = textured("Picture")
    sheet.data.materials.append(material)
    block.data.materials.append(diffuse("Grey", (0.5, 0.5, 0.5)))
    put("Sun", light("SUN", energy=3.0), rotation_euler=(0.5, 0.3, 0.0))
    made.camera.location = (0, -1.0, 12)
    bpy.context.view_layer.update()
    open_file.set_format(made, tmp_path / "out.png")
    return made


def twisting(size=2.0):
    """A cloth of 8 x 8 faces, whose shape is another one in every frame."""
    cloth = put("Cloth", plane("Cloth", size), location=(-1.5, -1.5, 0))
    subdivide = cloth.modifiers.new("Subdivide", "SUBSURF")
    subdivide.subdivision_type, subdivide.levels, subdivide.render_levels = "SIMPLE", 3, 3
    twist = cloth.modifiers.new("Twist", "SIMPLE_DEFORM")
    twist.deform_method, twist.deform_axis = "TWIST", "X"
    for frame, angle in ((1, 0.2), (N_FRAMES, 2.0)):
        twist.angle = angle
        twist.keyframe_insert("angle", frame=frame)
    return cloth


def frames(scene, made, numbers=range(1, N_FRAMES + 1)):
    """What each frame voxelized."""
    told = []
    for number in numbers:
        scene.frame_set(number)
        told.append(again(scene, made))
    return told


def again(scene, made):
    made.clear()
    open_file.render_frame(scene)
    return list(made)


def tight(scene):
    """Every volume on one level, whatever the view: so that nothing asks for a finer one."""
    scene.leapray.resolution = 32


def test_what_moves_rigidly_is_made_once(scene, made):
    tight(scene)
    first, *others = frames(scene, made)
    assert len(first) >= 3
    assert others == [[]] * (N_FRAMES - 1)


def test_a_moving_camera_asks_for_finer_levels_alone(scene, made):
    camera = scene.camera
    camera.keyframe_insert("location", frame=1)
    camera.location.z = 40.0  # away: nothing need be finer
    camera.keyframe_insert("location", frame=N_FRAMES)
    first, *others = frames(scene, made)
    assert first and others == [[]] * (N_FRAMES - 1)
    camera.animation_data_clear()
    camera.location = (-2.0, 1.0, 2.0)
    scene.render.resolution_percentage = 300
    nearer = again(scene, made)
    assert nearer  # there is more to see
    rows = engine.reports["ViewLayer"]["volumes"]
    assert again(scene, made) == [] and engine.reports["ViewLayer"]["volumes"] == rows


def test_a_shape_that_changes_alone_is_made_anew(scene, made):
    tight(scene)
    twisting()
    first, *others = frames(scene, made)
    (cloth,) = {n for told in others for n in told}
    assert cloth == 2 * 64 and cloth in first
    assert all(set(told) == {cloth} for told in others), others


def test_an_edit_makes_one_mesh_anew_and_undo_finds_it_again(scene, made):
    tight(scene)
    bpy.ops.ed.undo_push(message="Before")
    again(scene, made)
    bpy.data.objects["Block"].data.vertices[0].co.x -= 0.5
    bpy.data.objects["Block"].data.update()
    bpy.ops.ed.undo_push(message="Moved")
    assert set(again(scene, made)) == {12}
    bpy.ops.ed.undo()
    scene = bpy.context.scene
    assert bpy.data.objects["Block"].data.vertices[0].co.x == -1.0
    assert again(scene, made) == []
    bpy.ops.ed.redo()
    assert bpy.data.objects["Block"].data.vertices[0].co.x == -1.5
    assert again(bpy.context.scene, made) == []


def test_a_material_bakes_anew_only_where_its_picture_changes(scene, made):
    tight(scene)
    again(scene, made)
    node = nodes_of(bpy.data.materials["Picture"]).nodes["Principled BSDF"]
    node.inputs["Roughness"].default_value = 0.1
    node.inputs["Metallic"].default_value = 0.3
    assert again(scene, made) == []
    paint(bpy.data.images["Picture"], 1)
    assert set(again(scene, made)) <= {2}  # the sheet, and nothing else


def test_of_solids_in_one_volume_only_those_that_change_are_made_anew(scene, made):
    """They lie in the world: what stands still stays, and so does all when the camera moves."""
    scene.leapray.layout = "scene"
    first = frames(scene, made, [1])[0]
    assert set(first) == {2, 12, 3072}  # the sheet, the block, the ball
    scene.camera.location.x = 0.5
    assert again(scene, made) == []
    block, *_ = frames(scene, made, [3])
    assert set(block) == {12}
    assert len(engine.reports["ViewLayer"]["volumes"]) == 2


def test_volumes_go_with_the_setting(scene, made):
    tight(scene)
    again(scene, made)
    assert len(engine._volumes) > 0
    scene.render.use_persistent_data = False
    assert again(scene, made) and len(engine._volumes) == 0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["gallery", "textured", "cad", "thin", "cornell", "still"])
def test_a_second_run_of_a_sample_makes_nothing_and_shows_the_same(name, made, tmp_path):
    scene = open_file.open_scene(SAMPLES / f"{name}.blend")
    scene.render.use_persistent_data = False
    scene.render.resolution_percentage, scene.leapray.samples = 20, 1
    pictures, told = [], []
    for folder in ("", str(tmp_path / "folder"), str(tmp_path / "folder")):
        scene.leapray.cache_folder = folder
        picture = tmp_path / f"{len(pictures)}.exr"
        open_file.set_format(scene, picture)
        told.append(again(scene, made))
        pictures.append(exr(picture))
    bare, first, second = pictures
    assert told[0] == told[1] and told[0] and told[2] == []
    for channel, values in bare.items():
        for other in (first, second):
            assert np.array_equal(other[channel].view("u4"), values.view("u4")), channel
