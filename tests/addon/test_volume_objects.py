# SPDX-License-Identifier: GPL-3.0-or-later
"""Volume objects are rendered as the surfaces of their data, beside meshes."""

import bpy
import numpy as np
import pytest
import vdb_files
from blender_scenes import diffuse, mesh, nodes_of, plane, polygons, put, read, sunlit
from mathutils import Matrix
from vdb_files import OFF, VOXEL

import leapray
from addon import model, pipeline
from addon.blender import engine

SIZE = 96, 72
PASSES = "Combined", "Depth", "Position", "Normal", "Object Index", "Material Index", "Volume"


@pytest.fixture
def scene():
    return sunlit(SIZE)


def volume(name, path, **settings):
    """A Volume datablock of a file; settings: LeapRay's."""
    made = bpy.data.volumes.new(name)
    made.filepath = str(path)
    for key, value in settings.items():
        setattr(made.leapray, key, value)
    return made


def render(passes=PASSES):
    """The frame as LeapRay renders the scene."""
    from dataclasses import replace

    bpy.context.view_layer.update()
    return pipeline.render(replace(read(*SIZE), passes=passes))


def seen(frame, index):
    return frame.passes["Object Index"][..., 0] == index


def check_ball(frame, index, centre, radius=1.0, off=OFF):
    """The object with that index is a ball, in position and normal."""
    where = seen(frame, index)
    assert where.sum() > 200
    arm = frame.passes["Position"][where] - np.array(centre)
    distance = np.linalg.norm(arm, axis=1)
    assert np.abs(distance - radius).max() < off + 1e-5
    cosine = (arm / distance[:, None] * frame.passes["Normal"][where]).sum(axis=1)
    assert cosine.min() > np.cos(np.radians(3))  # differences over a voxel of a sphere's gradient


# ---- what is in a file --------------------------------------------------------


@pytest.mark.parametrize("kind", ["level set", "fog"])
def test_a_ball_of_a_file_is_a_ball(kind, scene, tmp_path):
    made = vdb_files.level_set() if kind == "level set" else vdb_files.fog()
    own = {} if kind == "level set" else {"automatic": False, "threshold": 1.0}
    path = vdb_files.write(tmp_path / "ball.vdb", made)
    put("Ball", volume("Ball", path, **own), location=(0.3, -0.2, 0.5), pass_index=4)
    frame = render()
    check_ball(frame, 4, (0.3, -0.2, 0.5))
    depth = frame.passes["Depth"][seen(frame, 4)]
    assert depth.min() == pytest.approx(6 - 0.5 - 1, abs=0.02)
    (row,) = frame.report["volumes"]
    assert row["name"] == "Ball" and row["kind"] == "isosurface" and not frame.warnings
    assert row["voxel_size"] == pytest.approx(VOXEL) and row["instances"] == 1


def test_a_volume_follows_its_object_and_its_grids_transform(scene, tmp_path):
    grid = vdb_files.level_set()
    grid.transform.postScale((1.0, 0.5, 1.0))
    path = vdb_files.write(tmp_path / "ball.vdb", grid)
    matrix = Matrix.Translation((0.4, 0.3, 0)) @ Matrix.Rotation(0.8, 4, "Z")
    put("Ball", volume("Ball", path), matrix_world=matrix @ Matrix.Diagonal((1, 2, 1, 1)),
        pass_index=1)  # fmt: skip
    check_ball(render(), 1, (0.4, 0.3, 0))


def test_cycles_sees_the_mesh_of_the_grid_where_leapray_sees_its_surface(scene, tmp_path):
    grid = vdb_files.level_set()
    points, _, quads = grid.convertToPolygons(isovalue=0.0)
    put("Ball", volume("Ball", vdb_files.write(tmp_path / "ball.vdb", grid)), pass_index=1)
    ours = seen(render(), 1)
    bpy.data.objects.remove(bpy.data.objects["Ball"])
    put("Mesh", polygons("Mesh", points.tolist(), quads[:, ::-1].tolist()))
    from blender_scenes import combined

    scene.render.film_transparent = True
    scene.render.engine, scene.cycles.samples = "CYCLES", 1
    scene.cycles.use_denoising = False
    scene.cycles.pixel_filter_type = "BOX"
    bpy.ops.render.render()
    theirs = combined(scene)[..., 3] > 0.5
    assert theirs.sum() > 500
    assert (ours != theirs).sum() < 0.02 * theirs.sum()  # pixels of the rim


def test_each_threshold_has_its_surface_and_its_slots_material(scene, tmp_path):
    path = vdb_files.write(tmp_path / "ball.vdb", vdb_files.fog())
    data = volume("Ball", path, automatic=False, threshold=0.5, surfaces=2, threshold_2=1.5)
    data.materials.append(glass("Shell"))
    data.materials.append(diffuse("Core", (0.8, 0.1, 0.1)))
    data.materials["Core"].pass_index = 7
    put("Ball", data, pass_index=2)
    got = read(*SIZE)
    assert got.fields[0].thresholds == (0.5, 1.5) and len(got.field_instances[0].materials) == 2
    frame = render()
    check_ball(frame, 2, (0, 0, 0), 1 + 2 * VOXEL)
    assert len(frame.report["volumes"]) == 2
    core = frame.passes["Combined"][SIZE[1] // 2, SIZE[0] // 2]
    assert core[0] > 2 * core[1]  # through the shell the red core is seen


def glass(name):
    made = bpy.data.materials.new(name)
    tree = nodes_of(made)
    tree.nodes.clear()
    bsdf = tree.nodes.new("ShaderNodeBsdfTransparent")
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(bsdf.outputs[0], output.inputs["Surface"])
    mix = tree.nodes.new("ShaderNodeMixShader")
    mix.inputs[0].default_value = 0.2
    tree.links.new(bsdf.outputs[0], mix.inputs[1])
    tree.links.new(tree.nodes.new("ShaderNodeBsdfDiffuse").outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], output.inputs["Surface"])
    return made


def test_a_level_set_whose_outside_would_be_all_of_space_is_named(scene, tmp_path):
    path = vdb_files.write(tmp_path / "ball.vdb", vdb_files.level_set())
    put("Ball", volume("Ball", path, invert=True))
    put("Cube", mesh(), pass_index=2)
    frame = render()
    (warning,) = frame.warnings
    assert "'Ball'" in warning and "all of space" in warning and seen(frame, 2).any()


# ---- where it comes from -------------------------------------------------------


def test_instances_share_a_field(scene, tmp_path):
    path = vdb_files.write(tmp_path / "ball.vdb", vdb_files.level_set())
    data = volume("Ball", path)
    inside = bpy.data.collections.new("Inside")
    inside.objects.link(bpy.data.objects.new("Original", data))
    for x in (-1.2, 1.2):
        empty = put(f"Empty {x}", None, location=(x, 0, 0))
        empty.instance_type, empty.instance_collection = "COLLECTION", inside
    put("Direct", data, location=(0, 1.5, 0), scale=(0.5, 0.5, 0.5), pass_index=3)
    bpy.context.view_layer.update()
    got = read(*SIZE)
    assert len(got.fields) == 1 and len(got.field_instances) == 3
    frame = render()
    assert frame.report["volumes"][0]["instances"] == 3
    check_ball(frame, 3, (0, 1.5, 0), 0.5, OFF / 2)


def test_a_sequence_shows_the_file_of_its_frame(scene, tmp_path):
    for k, radius in enumerate((0.5, 0.75, 1.0), 1):
        vdb_files.write(tmp_path / f"ball_{k:04d}.vdb", vdb_files.level_set(radius=radius))
    data = volume("Ball", tmp_path / "ball_0001.vdb")
    data.is_sequence, data.frame_start, data.frame_duration = True, 11, 3
    data.sequence_mode = "CLIP"
    put("Ball", data, pass_index=1)
    put("Cube", mesh(size=0.3), location=(1.6, 0, 0), pass_index=2)
    for frame, radius in ((11, 0.5), (12, 0.75), (13, 1.0), (10, None), (14, None)):
        scene.frame_set(frame)
        made = render()
        assert made.warnings == []
        if radius is None:
            assert not seen(made, 1).any() and seen(made, 2).any()
        else:
            where = seen(made, 1)
            arm = np.linalg.norm(made.passes["Position"][where], axis=1)
            assert np.abs(arm - radius).max() < 2 * OFF
    data.frame_offset = 1
    scene.frame_set(11)
    arm = np.linalg.norm(render().passes["Position"][seen(render(), 1)], axis=1)
    assert np.abs(arm - 0.75).max() < 2 * OFF
    data.frame_offset = 0
    (tmp_path / "ball_0002.vdb").unlink()
    scene.frame_set(12)
    made = render()
    assert seen(made, 2).any() and not seen(made, 1).any()
    (warning,) = made.warnings
    assert "'Ball'" in warning and "ball_0002.vdb" in warning


def node_group(kind, **values):
    """A tree of geometry nodes that makes one node's volume."""
    made = bpy.data.node_groups.new("Nodes", "GeometryNodeTree")
    made.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    node, output = made.nodes.new(kind), made.nodes.new("NodeGroupOutput")
    for name, value in values.items():
        node.inputs[name].default_value = value
    made.links.new(node.outputs[0], output.inputs[0])
    return made


def test_nodes_of_a_mesh_object_that_make_a_volume_are_rendered(scene):
    ob = put("Nodes", bpy.data.meshes.new("Empty"), pass_index=1)
    ob.modifiers.new("Nodes", "NODES").node_group = node_group("GeometryNodeVolumeCube")
    frame = render()
    where = seen(frame, 1)
    position = frame.passes["Position"][where]
    assert where.sum() > 200 and np.abs(position[:, 2]).max() == pytest.approx(1.0, abs=2 / 31)
    assert (frame.passes["Normal"][where] @ (0, 0, 1) > 0.99).mean() > 0.8


def test_a_mesh_that_a_modifier_makes_a_volume_is_rendered(scene):
    source = put("Source", mesh(), location=(10, 0, 0))
    ob = put("Made", bpy.data.volumes.new("Made"), pass_index=1, location=(10, 0, 0))
    modifier = ob.modifiers.new("Mesh", "MESH_TO_VOLUME")
    modifier.object, modifier.resolution_mode, modifier.voxel_size = source, "VOXEL_SIZE", 0.05
    scene.camera.location.x = 10
    source.hide_render = source.hide_viewport = True
    frame = render()
    where = seen(frame, 1)
    position = frame.passes["Position"][where] - np.array((10, 0, 0))
    assert where.sum() > 200 and np.abs(position).max() < 1.1


@pytest.mark.skipif(bpy.app.version < (5, 0), reason="SDF nodes of grids came with Blender 5")
def test_a_level_set_that_nodes_make_is_rendered(scene):
    tree = bpy.data.node_groups.new("Nodes", "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    ball = tree.nodes.new("GeometryNodeMeshUVSphere")
    ball.inputs["Segments"].default_value, ball.inputs["Rings"].default_value = 128, 64
    sdf = tree.nodes.new("GeometryNodeMeshToSDFGrid")
    sdf.inputs["Voxel Size"].default_value = 0.05
    store, output = tree.nodes.new("GeometryNodeStoreNamedGrid"), tree.nodes.new("NodeGroupOutput")
    store.inputs["Name"].default_value = "sdf"
    tree.links.new(ball.outputs["Mesh"], sdf.inputs["Mesh"])
    tree.links.new(sdf.outputs[0], store.inputs["Grid"])
    tree.links.new(store.outputs[0], output.inputs[0])
    ob = put("Nodes", bpy.data.meshes.new("Empty"), pass_index=1)
    ob.modifiers.new("Nodes", "NODES").node_group = tree
    check_ball(render(), 1, (0, 0, 0), off=0.005)


# ---- beside meshes -------------------------------------------------------------


def test_volumes_and_meshes_shade_each_other(scene, tmp_path):
    path = vdb_files.write(tmp_path / "ball.vdb", vdb_files.level_set())
    bpy.data.objects["Sun"].rotation_euler = (0, 0, 0)
    scene.camera.location, scene.camera.rotation_euler = (0, -8, 8), (np.pi / 4, 0, 0)
    put("Ground", plane(size=8.0), pass_index=1, location=(0, 0, -1.5))
    put("Ball", volume("Ball", path), pass_index=2)
    put("Lid", plane(size=0.8), location=(0, 0, 3.0), visible_camera=False)
    frame = render()
    ground, ball = (frame.passes["Position"][seen(frame, n)] for n in (1, 2))
    lit = frame.passes["Combined"][..., 0]
    # a shadow of the ball on the ground, with a margin of some pixels
    r = np.linalg.norm(ground[:, :2], axis=1)
    assert lit[seen(frame, 1)][r < 0.8].max(initial=0.0) < 1e-3
    assert (lit[seen(frame, 1)][(r > 1.2) & (r < 3)] > 0.7).mean() > 0.95  # but at the ball's rim
    # of the lid on the ball
    x, y, z = ball.T
    under = (np.abs(x) < 0.3) & (np.abs(y) < 0.3) & (z > 0)
    beside = (np.maximum(np.abs(x), np.abs(y)) > 0.5) & (z > 0.5)
    assert lit[seen(frame, 2)][under].max() < 1e-3 and lit[seen(frame, 2)][beside].min() > 0.2


def test_a_mirror_shows_a_volume(scene, tmp_path):
    path = vdb_files.write(tmp_path / "ball.vdb", vdb_files.level_set())
    mirror = bpy.data.materials.new("Mirror")
    tree = nodes_of(mirror)
    tree.nodes.clear()
    bsdf, output = (
        tree.nodes.new(kind) for kind in ("ShaderNodeBsdfGlossy", "ShaderNodeOutputMaterial")
    )
    bsdf.inputs["Roughness"].default_value = 0.0
    tree.links.new(bsdf.outputs[0], output.inputs["Surface"])
    ground = plane(size=8.0)
    ground.materials.append(mirror)
    put("Mirror", ground, pass_index=1, location=(0, 0, -1))
    data = volume("Ball", path)
    data.materials.append(shining("Red", (0.8, 0.0, 0.0, 1)))
    put("Ball", data, location=(0, 0, 0.5), pass_index=2)
    scene.camera.location, scene.camera.rotation_euler = (0, -6, 2), (1.25, 0, 0)
    nodes_of(scene.world).nodes["Background"].inputs["Color"].default_value = (0, 1, 0, 1)
    frame = render()
    light_of = frame.passes["Combined"]
    red = light_of[..., 0] > light_of[..., 1]
    assert (red & seen(frame, 1)).sum() > 50 and (~red & seen(frame, 1)).sum() > 50


def shining(name, color):
    made = bpy.data.materials.new(name)
    tree = nodes_of(made)
    tree.nodes.clear()
    bsdf = tree.nodes.new("ShaderNodeEmission")
    bsdf.inputs["Color"].default_value = color
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(bsdf.outputs[0], output.inputs["Surface"])
    return made


def test_a_volume_of_glass_bends_what_lies_behind(scene, tmp_path):
    """A ball of index 1.5 has its focus half a radius behind it, and turns what lies beyond."""
    path = vdb_files.write(tmp_path / "ball.vdb", vdb_files.level_set())
    made = bpy.data.materials.new("Glass")
    tree = nodes_of(made)
    tree.nodes.clear()
    bsdf = tree.nodes.new("ShaderNodeBsdfGlass")
    bsdf.inputs["IOR"].default_value, bsdf.inputs["Roughness"].default_value = 1.5, 0.0
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(bsdf.outputs[0], output.inputs["Surface"])
    data = volume("Ball", path)
    data.materials.append(made)
    put("Ball", data, pass_index=1)
    left, right = plane("Left", 6.0), plane("Right", 6.0)
    left.materials.append(shining("Red", (1, 0, 0, 1)))
    right.materials.append(shining("Green", (0, 1, 0, 1)))
    put("Left", left, location=(-3, 0, -3))
    put("Right", right, location=(3, 0, -3))
    frame = render()
    inside = frame.passes["Combined"][SIZE[1] // 2, SIZE[0] // 2 - 6 : SIZE[0] // 2 + 6]
    # the picture in the ball is turned round
    assert inside[2][1] > 4 * inside[2][0] and inside[-3][0] > 4 * inside[-3][1]


# ---- what is wrong -------------------------------------------------------------


def vector_grid():
    made = vdb_files.openvdb().Vec3SGrid()
    made.fill((0, 0, 0), (3, 3, 3), (1.0, 0.0, 0.0))
    made.name = "velocity"
    return made


def wrong(tmp_path, kind):
    """A volume that cannot be rendered, and words of the sentence on it."""
    if kind == "no file":
        return volume("Wrong", tmp_path / "gone.vdb"), "there is no file"
    if kind == "no vdb":
        (tmp_path / "no.vdb").write_bytes(b"what is no volume")
        return volume("Wrong", tmp_path / "no.vdb"), "no.vdb"
    path = tmp_path / "ball.vdb"
    if kind == "no scalar":
        return volume("Wrong", vdb_files.write(path, vector_grid())), "number"
    vdb_files.write(path, vdb_files.level_set(), vector_grid())
    if kind == "no grid":
        return volume("Wrong", path, grid="smoke"), "no grid 'smoke'"
    if kind == "vectors":
        return volume("Wrong", path, grid="velocity"), "number"
    if kind == "threshold":
        return volume("Wrong", path, automatic=False, threshold=5.0), "5"
    return bpy.data.volumes.new("Wrong"), "neither a file nor a grid"


KINDS = "no file", "no vdb", "no scalar", "no grid", "vectors", "threshold", "nothing"


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_wrong_with_a_volume_is_a_sentence_and_the_rest_is_rendered(kind, scene, tmp_path):
    data, words = wrong(tmp_path, kind)
    put("Culprit", data, pass_index=1)
    put("Cube", mesh(), pass_index=2)
    frame = render()
    assert seen(frame, 2).any() and not seen(frame, 1).any()
    (warning,) = frame.warnings
    assert "'Culprit'" in warning and words in warning


def test_a_scene_of_nothing_but_a_wrong_volume_says_why(scene, tmp_path):
    put("Culprit", volume("Wrong", tmp_path / "gone.vdb"))
    bpy.context.view_layer.update()
    with pytest.raises(leapray.LeapRayError, match=r"'Culprit'.*there is no file"):
        render()


def test_textures_on_a_volume_are_named(scene, tmp_path):
    path = vdb_files.write(tmp_path / "ball.vdb", vdb_files.level_set())
    data = volume("Ball", path)
    material = diffuse("Painted")
    tree = material.node_tree
    node = tree.nodes.new("ShaderNodeVertexColor")
    tree.links.new(node.outputs[0], tree.nodes["Diffuse BSDF"].inputs["Color"])
    data.materials.append(material)
    put("Ball", data, pass_index=1)
    frame = render()
    assert seen(frame, 1).any()
    assert any("'Ball'" in each and "Textures" in each for each in frame.warnings)


def test_a_material_of_volumes_alone_stands_back_for_a_surface(scene, tmp_path):
    path = vdb_files.write(tmp_path / "ball.vdb", vdb_files.level_set())
    data = volume("Ball", path)
    material = bpy.data.materials.new("Fog")
    tree = nodes_of(material)
    tree.nodes.clear()
    bsdf, output = (
        tree.nodes.new(kind) for kind in ("ShaderNodeVolumePrincipled", "ShaderNodeOutputMaterial")
    )
    tree.links.new(bsdf.outputs[0], output.inputs["Volume"])
    material.pass_index = 9
    data.materials.append(material)
    put("Ball", data, pass_index=1)
    frame = render()
    assert (frame.passes["Material Index"][seen(frame, 1)] == 9).all()
    assert frame.passes["Combined"][seen(frame, 1)][:, 0].max() > 0.3


def test_interpolation_is_a_setting_of_the_data(scene, tmp_path):
    path = vdb_files.write(tmp_path / "ball.vdb", vdb_files.fog())
    data = volume("Ball", path, automatic=False, threshold=1.0)
    put("Ball", data)
    assert read(*SIZE).fields[0].interpolation == "linear"
    before = render().passes["Depth"]
    data.leapray.interpolation = "cubic"
    assert read(*SIZE).fields[0].interpolation == "cubic"
    after = render().passes["Depth"]
    both = (before < 1e9) & (after < 1e9)
    moved = np.abs(after - before)[both]
    assert both.sum() > 500 and 1e-5 < moved.max() < 0.1


# ---- files that are kept --------------------------------------------------------


def test_a_saved_scene_renders_again(scene, tmp_path):
    vdb_files.write(tmp_path / "ball.vdb", vdb_files.fog())
    data = volume("Ball", tmp_path / "ball.vdb", automatic=False, threshold=1.2, invert=False)
    put("Ball", data, location=(0.2, 0, 0))
    scene.render.filepath = ""
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    data.filepath = bpy.path.relpath(str(tmp_path / "ball.vdb"))
    assert data.filepath.startswith("//")
    bpy.ops.wm.save_mainfile()
    before = render().passes["Combined"]
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    after = render().passes["Combined"]
    assert before.std() > 0.01
    np.testing.assert_array_equal(before, after)


def test_a_keyed_threshold_moves_the_surface(scene, tmp_path):
    path = vdb_files.write(tmp_path / "ball.vdb", vdb_files.fog())
    data = volume("Ball", path, automatic=False)
    put("Ball", data)
    for frame, value in ((1, 0.5), (11, 1.5)):
        data.leapray.threshold = value
        data.leapray.keyframe_insert("threshold", frame=frame)
    for curve in fcurves(data):
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"
    for frame, value in ((1, 0.5), (6, 1.0), (11, 1.5)):
        scene.frame_set(frame)
        assert read(*SIZE).fields[0].thresholds == pytest.approx((value,))
    scene.frame_set(1)
    heights = []
    scene.render.resolution_x = scene.render.resolution_y = 8
    for scene.frame_current in (1, 11):
        bpy.ops.render.render()
        (report,) = engine.reports.values()
        heights += [row["threshold"] for row in report["volumes"]]
    assert heights == pytest.approx([0.5, 1.5])


def fcurves(block):
    action = block.animation_data.action
    if bpy.app.version < (5, 0):
        return action.fcurves
    return action.layers[0].strips[0].channelbags[0].fcurves


def test_frames_of_one_file_keep_their_volumes(scene, tmp_path):
    path = vdb_files.write(tmp_path / "ball.vdb", vdb_files.level_set())
    put("Ball", volume("Ball", path))
    scene.render.use_persistent_data = True
    scene.render.resolution_x = scene.render.resolution_y = 8
    took = []
    for _ in range(2):
        bpy.ops.render.render()
        took.append(next(iter(engine.reports.values()))["seconds"]["structure"])
    assert took[0] > 0 == took[1]


def test_the_engine_renders_volumes(scene, tmp_path):
    path = vdb_files.write(tmp_path / "ball.vdb", vdb_files.level_set())
    put("Ball", volume("Ball", path), pass_index=1)
    bpy.ops.render.render()
    (report,) = engine.reports.values()
    assert [row["kind"] for row in report["volumes"]] == ["isosurface"]
    assert report["warnings"] == [] and isinstance(report["settings"], dict)
    assert model.Settings().traverser
