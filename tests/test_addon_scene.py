# SPDX-License-Identifier: GPL-3.0-or-later
"""What is read from Blender: cameras, instances, materials, lights, warnings, errors."""

import itertools
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
    polygons,
    put,
    read,
)
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Euler, Vector
from numpy.testing import assert_allclose, assert_array_equal

import leapray


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
    put("Nowhere", mesh(), visible_camera=False, visible_shadow=False, visible_diffuse=False)
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
    flags = [got["Camera only"].visible_camera, got["Camera only"].visible_shadow]
    assert flags == [True, False]
    inner = got["Inner"]
    assert (inner.visible_camera, inner.visible_shadow, inner.object_index) == (False, True, 7)


# ---- materials -----------------------------------------------------------


def colors_of(scene, name):
    (instance,) = (i for i in scene.instances if i.name == name)
    return [scene.materials[at].base_color for at in instance.materials]


def test_slots_are_per_instance_where_the_object_owns_the_material(scene):
    shared = mesh()
    shared.materials.append(diffuse("Red", (1, 0, 0)))
    shared.materials.append(diffuse("Green", (0, 1, 0)))
    put("A", shared)
    own = put("B", shared)
    own.material_slots[1].link = "OBJECT"
    own.material_slots[1].material = diffuse("Blue", (0, 0, 1))
    bare = put("C", mesh())
    empty = put("D", plane())
    empty.data.materials.append(None)
    got = read()
    assert colors_of(got, "A") == [(1, 0, 0), (0, 1, 0)]
    assert colors_of(got, "B") == [(1, 0, 0), (0, 0, 1)]
    assert len({i.mesh for i in got.instances if i.name in "AB"}) == 1
    assert_allclose(colors_of(got, bare.name) + colors_of(got, empty.name), 0.8)


def test_base_colors_are_found_through_reroutes_and_constants(scene):
    ob = put("A", mesh())
    principled = bpy.data.materials.new("Principled")
    bsdf = nodes_of(principled).nodes["Principled BSDF"]
    bsdf.inputs["Base Color"].default_value = (0.1, 0.2, 0.3, 1)

    rerouted = diffuse("Rerouted")
    tree = rerouted.node_tree
    rgb, first, second = (
        tree.nodes.new(kind) for kind in ("ShaderNodeRGB", "NodeReroute", "NodeReroute")
    )
    rgb.outputs[0].default_value = (0.5, 0.25, 0.125, 1)
    bsdf, output = tree.nodes["Diffuse BSDF"], tree.nodes["Material Output"]
    tree.links.new(rgb.outputs[0], first.inputs[0])
    tree.links.new(first.outputs[0], bsdf.inputs["Color"])
    tree.links.new(bsdf.outputs[0], second.inputs[0])
    tree.links.new(second.outputs[0], output.inputs["Surface"])

    textured = diffuse("Textured")
    tree = textured.node_tree
    noise = tree.nodes.new("ShaderNodeTexNoise")
    tree.links.new(noise.outputs["Color"], tree.nodes["Diffuse BSDF"].inputs["Color"])
    textured.diffuse_color = (0.6, 0.7, 0.8, 1)

    for material in (principled, rerouted, textured):
        ob.data.materials.append(material)
    got = read()
    assert_allclose(
        colors_of(got, "A"), [(0.1, 0.2, 0.3), (0.5, 0.25, 0.125), (0.6, 0.7, 0.8)], rtol=1e-6
    )
    assert got.warnings == (
        "Shader nodes are not followed, the viewport colour stands in: 'Textured'",
    )


def test_a_view_layers_material_override_wins(scene):
    ob = put("A", mesh())
    ob.data.materials.append(diffuse("Red", (1, 0, 0)))
    bpy.context.view_layer.material_override = diffuse("Grey", (0.5, 0.5, 0.5))
    assert colors_of(read(), "A") == [(0.5, 0.5, 0.5)]


# ---- lights and world ----------------------------------------------------

LIGHTS = [
    ("SUN", {"energy": math.pi, "angle": 0.0}),
    ("SUN", {"energy": 2.0, "angle": 0.2, "color": (1.0, 0.5, 0.25)}),
    ("SUN", {"energy": 1.0, "angle": 0.0, "exposure": 1.5}),
    ("SUN", {"energy": 1.0, "angle": 0.0, "use_temperature": True, "temperature": 3000.0}),
    ("SUN", {"energy": 30.0, "angle": 0.2, "normalize": False}),
    ("SUN", {"energy": 1.0, "angle": 0.0, "normalize": False}),
    ("POINT", {"energy": 100.0, "shadow_soft_size": 0.0}),
    ("POINT", {"energy": 100.0, "shadow_soft_size": 0.05, "exposure": -1.0}),
    ("POINT", {"energy": 100.0, "shadow_soft_size": 0.05, "normalize": False}),
    ("POINT", {"energy": 100.0, "shadow_soft_size": 0.0, "normalize": False}),
]


@pytest.mark.parametrize(("kind", "attributes"), LIGHTS)
def test_light_units_are_those_of_cycles(scene, kind, attributes):
    ground = put("Ground", plane(size=100.0))
    ground.data.materials.append(diffuse("White"))
    put("Light", light(kind, **attributes), location=(0, 0, 2), scale=(3, 3, 3))
    (got,) = read().lights
    facing = np.array(got.color) / (1.0 if kind == "SUN" else 2.0**2)
    # a sphere of radius 0.05 at distance 2 differs from a point by less than 0.1 %
    assert_allclose(facing / math.pi, cycles_radiance(scene), rtol=1e-3)


def test_lights_have_a_place_a_direction_and_nodes(scene):
    put("Cube", mesh())
    sun = put("Sun", light("SUN", energy=2.0, use_shadow=False), rotation_euler=(0.3, 0.4, 0.5))
    put("Lamp", light("POINT", energy=4 * math.pi), location=(1, 2, 3), scale=(5, 5, 5))
    put("Dark", light("POINT", energy=0.0))
    put("Nowhere", light("POINT"), visible_diffuse=False)
    emission = nodes_of(sun.data).nodes["Emission"]
    emission.inputs["Color"].default_value = (0.5, 1, 0, 1)
    emission.inputs["Strength"].default_value = 3.0
    bpy.context.view_layer.update()
    lamp, sun_read = sorted(read().lights, key=lambda each: each.name)
    assert_allclose(lamp.position, (1, 2, 3))
    assert_allclose(lamp.color, 1.0, rtol=1e-6)
    assert lamp.casts_shadow and not sun_read.casts_shadow
    up = sun.matrix_world.to_3x3() @ Vector((0, 0, 1))
    assert_allclose(sun_read.direction, up, atol=1e-6)
    assert_allclose(sun_read.color, (3.0, 6.0, 0.0), rtol=1e-6)


def test_the_world_is_its_background_node(scene):
    put("Cube", mesh())
    tree = nodes_of(scene.world)
    background = tree.nodes["Background"]
    background.inputs["Color"].default_value = (0.5, 0.25, 0.1, 1)
    background.inputs["Strength"].default_value = 2.0
    assert_allclose(read().world.color, (1.0, 0.5, 0.2), rtol=1e-6)
    sky = tree.nodes.new("ShaderNodeTexEnvironment")
    tree.links.new(sky.outputs[0], background.inputs["Color"])
    scene.world.color = (0.1, 0.2, 0.3)
    got = read()
    assert_allclose(got.world.color, (0.1, 0.2, 0.3), rtol=1e-6)
    assert "Environment textures" in got.warnings[0] and "'World'" in got.warnings[0]
    tree.links.remove(tree.nodes["World Output"].inputs["Surface"].links[0])
    assert read().world.color == (0, 0, 0)
    scene.world = None
    assert read().world.color == (0, 0, 0)


# ---- what is left out ----------------------------------------------------


def test_what_is_not_supported_is_one_warning_each_by_name(scene):
    put("Cube", mesh())
    camera = scene.camera.data
    camera.type, camera.dof.use_dof = "PANO", True
    scene.render.use_motion_blur = True
    put("Spot", light("SPOT"))
    put("Area 1", light("AREA"))
    put("Area 2", light("AREA"))
    put("Fur", bpy.data.hair_curves.new("Fur"))
    put("Cloud", bpy.data.pointclouds.new("Cloud"))
    put("Smoke", bpy.data.volumes.new("Smoke"))
    hairy = put("Hairy", plane())
    bpy.context.view_layer.update()
    bpy.context.view_layer.objects.active = hairy
    hairy.modifiers.new("Hair", "PARTICLE_SYSTEM")
    hairy.particle_systems[0].settings.type = "HAIR"
    bumpy = diffuse("Bumpy")
    tree = bumpy.node_tree
    displacement = tree.nodes.new("ShaderNodeDisplacement")
    tree.links.new(displacement.outputs[0], tree.nodes["Material Output"].inputs["Displacement"])
    put("Rock", mesh()).data.materials.append(bumpy)

    got = read()
    assert sorted(got.warnings) == sorted(
        f"{feature} not supported yet: {names}"
        for feature, names in {
            "Panoramic and custom cameras are": "'Camera'",
            "Depth of field is": "'Camera'",
            "Motion blur is": "'Scene'",
            "Spot lights are": "'Spot'",
            "Area lights are": "'Area 1', 'Area 2'",
            "Hair and curves objects are": "'Fur'",
            "Point clouds are": "'Cloud'",
            "Volumes are": "'Smoke'",
            "Hair particles are": "'Hairy'",
            "Displacement is": "'Bumpy'",
        }.items()
    )
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
    with pytest.raises(leapray.LeapRayError, match=r"no mesh that can be rendered.*'Flat'"):
        read()


def test_thin_but_sound_scales_are_not_skipped(scene):
    put("Thin", mesh(), scale=(1000, 1000, 1e-3), rotation_euler=(0.3, 0.2, 0.1))
    put("Tiny", mesh(), scale=(1e-8, 1e-8, 1e-8))
    assert len(read().instances) == 2


def test_a_scene_that_cannot_be_rendered_says_why(scene):
    with pytest.raises(leapray.LeapRayError, match="Scene 'Scene' shows no mesh"):
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
