# SPDX-License-Identifier: GPL-3.0-or-later
"""What is read from Blender: cameras, instances, meshes, warnings, errors."""

import itertools
import math

import bpy
import numpy as np
import pytest
from blender_scenes import (
    diffuse,
    fresh,
    light,
    mesh,
    plane,
    polygons,
    put,
    read,
)
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Euler, Matrix, Vector
from numpy.testing import assert_allclose, assert_array_equal

import leapray
from addon import pipeline
from addon.blender.read import scene as scene_module


@pytest.fixture
def scene():
    return fresh()


# ---- camera --------------------------------------------------------------

FILMS = list(
    itertools.product(
        ("PERSP", "ORTHO"),
        ("AUTO", "HORIZONTAL", "VERTICAL"),
        ((96, 54), (54, 96)),
        ((1.0, 1.0), (1.0, 2.5), (3.0, 1.0)),
    )
)


@pytest.mark.parametrize(("kind", "fit", "size", "aspect"), FILMS)
def test_film_rays_pass_through_points_where_blender_projects_them(scene, kind, fit, size, aspect):
    rng = np.random.default_rng(11)
    put("Cube", mesh())
    camera = scene.camera
    camera.location, camera.rotation_euler = (1.5, -2.0, 4.0), Euler((0.6, -0.3, 2.0))
    camera.scale = (2.0, 2.0, 2.0)  # of no consequence
    data = camera.data
    data.type, data.sensor_fit, data.lens, data.ortho_scale = kind, fit, 31.0, 7.0
    data.sensor_width, data.sensor_height = 36.0, 22.0
    data.shift_x, data.shift_y = 0.17, -0.31
    data.clip_start, data.clip_end = 0.25, 321.0
    render = scene.render
    render.resolution_x, render.resolution_y = size
    render.pixel_aspect_x, render.pixel_aspect_y = aspect
    bpy.context.view_layer.update()

    film = read(*size).camera
    assert (film.clip_start, film.clip_end) == (0.25, 321.0)
    place = camera.matrix_world.normalized()
    local = rng.uniform((-3, -3, -9), (3, 3, -2), (20, 3))
    points = np.array([place @ Vector(point) for point in local])
    seen = np.array([world_to_camera_view(scene, camera, Vector(point)) for point in points])
    x, y, depth = seen[:, :1] * size[0], seen[:, 1:2] * size[1], seen[:, 2:]
    on_film = film.corner + x * film.dx + y * film.dy
    if kind == "ORTHO":
        got = film.eye + on_film + depth * film.forward
    else:
        got = film.eye + depth * on_film
    assert_allclose(got, points, atol=2e-4)  # Blender projects in float32


def test_a_border_cuts_the_film(scene):
    put("Cube", mesh())
    whole = read(101, 77)
    render = scene.render
    render.use_border = True
    render.border_min_x, render.border_max_x = 0.1003, 0.7
    render.border_min_y, render.border_max_y = 0.333, 0.6667
    cut = read(101, 77)
    assert (cut.width, cut.height) == (60, 26)  # 10..70, 25..51: as Blender allots them
    corner = whole.camera.corner + 10 * whole.camera.dx + 25 * whole.camera.dy
    assert_allclose(cut.camera.corner, corner, atol=1e-12)
    assert_array_equal(cut.camera.dx, whole.camera.dx)


# ---- matrices ------------------------------------------------------------


@pytest.mark.parametrize("last", [(0, 0, 0, 1 - 2**-24), (0, 0, 0, 1 + 2**-23), (1e-7, 0, 0, 1)])
@pytest.mark.parametrize("how", ["parent", "instance", "world"])
def test_a_last_row_that_is_not_quite_affine_is_no_fault_of_the_object(scene, last, how):
    """Products of float32 leave it behind parents of parents."""
    odd = Matrix.Identity(4)
    odd[3] = last
    cube = put("Cube", mesh())
    if how == "parent":
        cube.parent = put("Above", None)
        cube.matrix_parent_inverse = odd
    elif how == "world":
        cube.matrix_world = odd
    else:
        group = bpy.data.collections.new("Group")
        scene.collection.objects.unlink(cube)
        group.objects.link(cube)
        empty = put("Empty", None, instance_type="COLLECTION", instance_collection=group)
        empty.parent = put("Above", None)
        empty.matrix_parent_inverse = odd
    scene.view_layers[0].use_pass_z = True
    job = read()
    (instance,) = job.instances
    assert_array_equal(instance.world_from_object[3], (0, 0, 0, 1))
    frame = pipeline.render(job)
    assert frame.passes["Depth"].min() == pytest.approx(9.0, abs=0.01)


# ---- objects -------------------------------------------------------------


def test_instances_share_a_mesh_and_stand_where_the_depsgraph_puts_them(scene):
    shared = mesh()
    put("A", shared, location=(1, 2, 3), scale=(-1, 2, 0.5))
    put("B", shared, location=(-3, 0, 0), rotation_euler=(0.1, 0.2, 0.3))
    bumpy = put("C", shared)
    bumpy.modifiers.new("Subdivision", "SUBSURF").levels = 1
    collection = bpy.data.collections.new("Inside")
    collection.objects.link(put("D", plane()))
    put(
        "Outside", None, instance_type="COLLECTION", instance_collection=collection, scale=(3, 3, 1)
    )
    bpy.context.view_layer.update()

    got = read()
    want = [
        (instance.object.name, np.array(instance.matrix_world))
        for instance in bpy.context.evaluated_depsgraph_get().object_instances
        if instance.object.type == "MESH"
    ]
    assert [instance.name for instance in got.instances] == [name for name, _ in want]
    assert_array_equal([i.world_from_object for i in got.instances], [m for _, m in want])
    index = {instance.name: instance.mesh for instance in got.instances}
    assert index["A"] == index["B"] != index["C"]
    assert sorted(name for name, _ in want) == ["A", "B", "C", "D", "D"]
    assert len(got.meshes) == 3
    n_triangles = {name: len(got.meshes[at].triangles) for name, at in index.items()}
    assert n_triangles == {"A": 12, "B": 12, "C": 48, "D": 2}


def test_triangles_and_their_slots_are_blenders(scene):
    ngon = polygons(
        "Ngon",
        [(0, 0, 0), (2, 0, 0), (2, 2, 0), (1, 3, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2)],
        [(0, 1, 2, 3, 4), (0, 5, 6, 1), (1, 6, 2)],
    )
    for face, slot in zip(ngon.polygons, (2, 0, 1), strict=True):
        face.material_index = slot
    put("Ngon", ngon)
    got = read().meshes[0]
    ngon.calc_loop_triangles()
    assert got.triangles.tolist() == [list(t.vertices) for t in ngon.loop_triangles]
    assert got.slots.tolist() == [2, 2, 2, 0, 0, 1]
    assert got.vertices.tolist() == [list(v.co) for v in ngon.vertices]
    assert (got.vertices.dtype, got.triangles.dtype, got.slots.dtype) == (
        np.float32,
        np.int32,
        np.uint16,
    )


def test_curves_texts_surfaces_and_metaballs_come_as_meshes(scene):
    bpy.ops.curve.primitive_bezier_circle_add()
    bpy.context.object.data.bevel_depth = 0.1
    bpy.ops.object.text_add()
    bpy.ops.surface.primitive_nurbs_surface_sphere_add()
    bpy.ops.object.metaball_add()
    bpy.ops.object.metaball_add(location=(1, 0, 0))
    bpy.ops.curve.primitive_bezier_curve_add()  # a guide without faces: nothing to draw or say
    got = read()
    assert len(got.instances) == 4
    assert min(len(m.triangles) for m in got.meshes) > 10
    assert got.warnings == ()


def test_visibility_follows_the_object_and_its_instancer(scene):
    put("Hidden", mesh(), hide_render=True, hide_viewport=True)
    put("Camera only", mesh(), visible_shadow=False, visible_diffuse=False)
    put("Nowhere", mesh(), **dict.fromkeys(scene_module.VISIBILITIES, False))
    collection = bpy.data.collections.new("Inside")
    collection.objects.link(bpy.data.objects.new("Inner", plane()))
    put(
        "Outer",
        None,
        instance_type="COLLECTION",
        instance_collection=collection,
        visible_camera=False,
        pass_index=5,
    )
    collection.objects["Inner"].pass_index = 7
    got = {instance.name: instance for instance in read().instances}
    assert set(got) == {"Camera only", "Inner"}
    flags = [getattr(got["Camera only"], flag) for flag in scene_module.VISIBILITIES]
    assert flags == [True, False, False, True, True, True]
    inner = got["Inner"]
    assert (inner.visible_camera, inner.visible_shadow, inner.object_index) == (False, True, 7)


# ---- what is left out ----------------------------------------------------


def test_what_is_not_supported_is_one_warning_each_by_name(scene):
    put("Cube", mesh())
    camera = scene.camera.data
    camera.type, camera.dof.use_dof = "PANO", True
    scene.render.use_motion_blur = True
    put("Squeezed 1", light("SPOT"), scale=(1, 2, 1))
    put("Squeezed 2", light("SPOT"), scale=(1, 1, 2))
    put("Large", light("SPOT"), scale=(2, 2, 2))
    put("Fur", bpy.data.hair_curves.new("Fur"))
    put("Cloud", bpy.data.pointclouds.new("Cloud"))
    put("Smoke", bpy.data.volumes.new("Smoke"))
    hairy = put("Hairy", plane())
    bpy.context.view_layer.update()
    bpy.context.view_layer.objects.active = hairy
    hairy.modifiers.new("Hair", "PARTICLE_SYSTEM")
    hairy.particle_systems[0].settings.type = "HAIR"
    hairy.light_linking.receiver_collection = bpy.data.collections.new("Lit")
    bumpy = diffuse("Bumpy")
    tree = bumpy.node_tree
    displacement = tree.nodes.new("ShaderNodeDisplacement")
    tree.links.new(displacement.outputs[0], tree.nodes["Material Output"].inputs["Displacement"])
    put("Rock", mesh()).data.materials.append(bumpy)

    got = read()
    without = "Skipped 'Smoke': it has neither a file nor a grid"
    assert sorted(set(got.warnings) - {without}) == sorted(
        f"{feature} not supported yet: {names}"
        for feature, names in {
            "Panoramic and custom cameras are": "'Camera'",
            "Depth of field is": "'Camera'",
            "Motion blur is": "'Scene'",
            "Spot lights with uneven scales are": "'Squeezed 1', 'Squeezed 2'",
            "Hair and curves objects are": "'Fur'",
            "Point clouds are": "'Cloud'",
            "Hair particles are": "'Hairy'",
            "Displacement is": "'Bumpy'",
            "Light linking is": "'Hairy'",
        }.items()
    )
    assert without in got.warnings
    assert [instance.name for instance in got.instances] == ["Cube", "Hairy", "Rock"]


def test_bad_objects_are_skipped_by_name_and_the_rest_is_read(scene):
    put("Good", mesh())
    put("No faces", polygons("Points", [(0, 0, 0), (1, 0, 0)], []))
    instancer = put("Instancer", polygons("Places", [(0, 0, 0), (5, 0, 0)], []))
    instancer.instance_type = "VERTS"  # without faces, but not without purpose
    put("Placed", mesh(), parent=instancer)
    put("Flat", mesh(), scale=(1, 1, 0), rotation_euler=(0.3, 0.2, 0.1))
    broken = mesh()
    broken.vertices[3].co.x = math.nan
    put("Broken", broken)
    put("Broken too", broken)
    got = read()
    assert {instance.name for instance in got.instances} == {"Good", "Placed"}
    nan = "its mesh has vertices that are no numbers (NaN or infinite)"
    assert sorted(got.warnings) == [
        f"Skipped 'Broken', 'Broken too': {nan}",
        "Skipped 'Flat': its matrix cannot be inverted (a scale of zero?)",
        "Skipped 'No faces': its mesh has no faces",
    ]
    for name in ("Good", "Placed"):
        bpy.data.objects.remove(bpy.data.objects[name])
    with pytest.raises(leapray.LeapRayError, match=r"nothing that can be rendered.*'Flat'"):
        read()


def test_thin_but_sound_scales_are_not_skipped(scene):
    put("Thin", mesh(), scale=(1000, 1000, 1e-3), rotation_euler=(0.3, 0.2, 0.1))
    put("Tiny", mesh(), scale=(1e-8, 1e-8, 1e-8))
    assert len(read().instances) == 2


def test_a_scene_that_cannot_be_rendered_says_why(scene):
    with pytest.raises(leapray.LeapRayError, match="Scene 'Scene' shows nothing"):
        read()
    put("Cube", mesh())
    with pytest.raises(leapray.LeapRayError, match="resolution is 0 x 48"):
        read(0)
    scene.camera.scale = (0, 0, 0)
    bpy.context.view_layer.update()
    with pytest.raises(leapray.LeapRayError, match="'Camera'"):
        read()
    scene.camera = bpy.data.objects["Cube"]
    with pytest.raises(leapray.LeapRayError, match="'Cube' is not a camera"):
        read()
    scene.camera = None
    with pytest.raises(leapray.LeapRayError, match="has no camera"):
        read()


def test_reading_a_million_triangles_takes_arrays_not_loops(scene):
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=700, y_subdivisions=700)
    got = read()
    assert len(got.meshes[0].triangles) == 2 * 700**2
    assert got.seconds_read < 2.0  # a loop over the faces takes some five seconds
