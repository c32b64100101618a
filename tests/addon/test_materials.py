# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials read from shader nodes, and the textures they evaluate on meshes and images."""

import math

import bpy
import numpy as np
import pytest
from blender_scenes import diffuse, fresh, mesh, nodes_of, plane, put, read
from numpy.testing import assert_allclose, assert_array_equal

import leapray
from addon import model
from addon.blender.read import images, materials
from addon.blender.read.warnings import Warnings


@pytest.fixture
def scene():
    return fresh()


def colors_of(scene, name):
    (instance,) = (i for i in scene.instances if i.name == name)
    return [scene.materials[at].base_color for at in instance.materials]


def tree(name="Material"):
    """An empty tree of a new material, its output node's surface input, and a way to add nodes."""
    made = bpy.data.materials.new(name)
    nodes_of(made).nodes.clear()
    output = made.node_tree.nodes.new("ShaderNodeOutputMaterial")
    return made, output


def node(made, kind, **inputs):
    """A node; inputs by identifier, _ for blanks: a value, a socket, or a node's first output."""
    into = made if hasattr(made, "nodes") else made.node_tree
    new = into.nodes.new(f"ShaderNode{kind}")
    for name, value in inputs.items():
        socket = next(
            s for s in new.inputs if name in (s.identifier, s.identifier.replace(" ", "_"))
        )
        set_input(into, socket, value)
    return new


def set_input(into, socket, value):
    if hasattr(value, "outputs"):
        value = value.outputs[0]
    if hasattr(value, "is_output"):
        into.links.new(value, socket)
    elif isinstance(value, tuple):
        socket.default_value = (*value, 1.0)[: len(socket.default_value)]
    else:
        socket.default_value = value


def surface(made, output, shader):
    made.node_tree.links.new(shader.outputs[0], output.inputs["Surface"])


def understood(made):
    """The model of a material that gives no warning."""
    notes = Warnings()
    got, _ = materials.read(made, notes)
    assert notes.sentences() == ()
    return got


def misunderstood(made):
    """The model of a material, and the one warning that it gives."""
    notes = Warnings()
    got, _ = materials.read(made, notes)
    (sentence,) = notes.sentences()
    assert sentence.endswith(f"in '{made.name}'")
    return got, sentence


# ---- shaders -----------------------------------------------------------------


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


def test_a_view_layers_material_override_wins(scene):
    ob = put("A", mesh())
    ob.data.materials.append(diffuse("Red", (1, 0, 0)))
    bpy.context.view_layer.material_override = diffuse("Grey", (0.5, 0.5, 0.5))
    assert_allclose(colors_of(read(), "A"), [(0.5, 0.5, 0.5)])


def test_single_shaders_are_single_lobes(scene):
    made, output = tree()
    red = (0.5, 0.25, 0.125)

    def lobe(kind, **inputs):
        surface(made, output, node(made, kind, **inputs))
        (got,) = understood(made).lobes
        return got

    for rough in (0.0, 0.25):
        got = lobe("BsdfDiffuse", Color=red, Roughness=rough)
        assert got == model.Lobe("diffuse", red, roughness=rough)
    got = lobe("BsdfGlossy", Color=red, Roughness=0.25)
    assert got == model.Lobe("glossy", red, roughness=0.25, multiscatter=got.multiscatter)
    got = lobe("BsdfGlass", Color=red, Roughness=0.5, IOR=1.25)
    assert (got.kind, got.color, got.roughness, got.ior) == ("glass", red, 0.5, 1.25)
    got = lobe("BsdfRefraction", Color=red, Roughness=0.0, IOR=1.25)
    assert (got.kind, got.color, got.roughness, got.ior) == ("refraction", red, 0.0, 1.25)
    assert lobe("BsdfTransparent", Color=red) == model.Lobe("transparent", red)
    assert lobe("Emission", Color=red, Strength=4.0) == model.Lobe("emission", (2.0, 1.0, 0.5))


def test_a_principled_shader_is_one_lobe(scene):
    made, output = tree()
    shader = node(
        made, "BsdfPrincipled", Base_Color=(0.5, 0.25, 0.125), Metallic=0.25, Roughness=0.75,
        IOR=1.25, Alpha=0.5, Specular_IOR_Level=0.125, Specular_Tint=(0.5, 0.5, 1),
        Transmission_Weight=0.375, Emission_Color=(1, 0.5, 0.25), Emission_Strength=2.0,
    )  # fmt: skip
    surface(made, output, shader)
    (got,) = understood(made).lobes
    assert got == model.Lobe(
        "principled", (0.5, 0.25, 0.125), roughness=0.75, ior=1.25, metallic=0.25, specular=0.125,
        specular_tint=(0.5, 0.5, 1.0), transmission=0.375, alpha=0.5, emission=(2.0, 1.0, 0.5),
    )  # fmt: skip
    shader.distribution = "GGX"
    assert not understood(made).lobes[0].multiscatter


def test_mix_and_add_become_weights(scene):
    made, output = tree()
    shaders = [node(made, "BsdfDiffuse", Color=(c, 0, 0)) for c in (0.25, 0.5, 1.0)]
    fraction = node(made, "Math", Value=0.5, Value_001=0.5)
    fraction.operation = "MULTIPLY"
    inner = node(made, "MixShader", Fac=fraction, Shader=shaders[0], Shader_001=shaders[1])
    outer = node(made, "AddShader", Shader=inner, Shader_001=shaders[2])
    surface(made, output, outer)
    got = understood(made).lobes
    assert [(lobe.color[0], lobe.weight) for lobe in got] == [(0.25, 0.75), (0.5, 0.25), (1, 1)]
    inner.mute = True  # passes its first shader on
    got = understood(made).lobes
    assert [(lobe.color[0], lobe.weight) for lobe in got] == [(0.25, 1.0), (1.0, 1.0)]


def test_groups_and_reroutes_are_followed(scene):
    group = bpy.data.node_groups.new("Paint", "ShaderNodeTree")
    group.interface.new_socket("Tint", in_out="INPUT", socket_type="NodeSocketColor")
    group.interface.new_socket("Shader", in_out="OUTPUT", socket_type="NodeSocketShader")
    enter, leave = (group.nodes.new(f"NodeGroup{end}") for end in ("Input", "Output"))
    bsdf = node(group, "BsdfDiffuse", Color=enter.outputs[0])
    group.links.new(bsdf.outputs[0], leave.inputs[0])

    outer = bpy.data.node_groups.new("Outer", "ShaderNodeTree")
    outer.interface.new_socket("Color", in_out="INPUT", socket_type="NodeSocketColor")
    outer.interface.new_socket("Shader", in_out="OUTPUT", socket_type="NodeSocketShader")
    enter, leave = (outer.nodes.new(f"NodeGroup{end}") for end in ("Input", "Output"))
    inside = outer.nodes.new("ShaderNodeGroup")
    inside.node_tree = group
    outer.links.new(enter.outputs[0], inside.inputs[0])
    outer.links.new(inside.outputs[0], leave.inputs[0])

    made, output = tree()
    links = made.node_tree.links
    used = [made.node_tree.nodes.new("ShaderNodeGroup") for _ in range(2)]
    for each in used:
        each.node_tree = outer
    used[0].inputs[0].default_value = (0.25, 0.5, 0.75, 1)
    rgb, first = node(made, "RGB"), made.node_tree.nodes.new("NodeReroute")
    rgb.outputs[0].default_value = (1, 0, 0.5, 1)
    links.new(rgb.outputs[0], first.inputs[0])
    links.new(first.outputs[0], used[1].inputs[0])
    surface(made, output, node(made, "MixShader", Fac=0.5, Shader=used[0], Shader_001=used[1]))
    got = understood(made).lobes
    assert [lobe.color for lobe in got] == [(0.25, 0.5, 0.75), (1, 0, 0.5)]


def folded(made, output, source):
    surface(made, output, node(made, "BsdfDiffuse", Color=source))
    return understood(made).lobes[0].color


def test_constant_colors_are_folded(scene):
    made, output = tree()
    mix = node(made, "Mix", Factor_Float=0.5)
    mix.data_type, mix.blend_type = "RGBA", "MULTIPLY"
    for name, value in (("A_Color", (0.5, 1, 0.25, 1)), ("B_Color", (0.5, 0.5, 1, 1))):
        next(s for s in mix.inputs if s.identifier == name).default_value = value
    result = next(s for s in mix.outputs if s.type == "RGBA")
    assert_allclose(folded(made, output, result), (0.375, 0.75, 0.25))
    gamma = node(made, "Gamma", Color=result, Gamma=2.0)
    assert_allclose(folded(made, output, gamma), np.square((0.375, 0.75, 0.25)), rtol=1e-6)
    invert = node(made, "Invert", Color=(0.25, 0.5, 1), Fac=0.5)
    assert_allclose(folded(made, output, invert), 0.5)
    combined = node(made, "CombineColor", Red=0.25, Green=0.5, Blue=1.0)
    assert_allclose(folded(made, output, combined), (0.25, 0.5, 1))
    ramp = node(made, "ValToRGB", Fac=0.25)
    ramp.color_ramp.elements[0].color = (1, 0, 0, 1)
    assert_allclose(folded(made, output, ramp), (1, 0.25, 0.25), atol=1e-3)
    value = node(made, "Value")
    value.outputs[0].default_value = 0.375
    assert_allclose(folded(made, output, value), 0.375)
    bright = node(made, "BrightContrast", Color=(0.25, 0.5, 0.75), Bright=0.25, Contrast=0.5)
    assert_allclose(folded(made, output, bright), (0.375, 0.75, 1.125))


def test_absorption_is_that_of_the_volume(scene):
    made, output = tree()
    surface(made, output, node(made, "BsdfGlass"))
    volume = node(made, "VolumeAbsorption", Color=(1, 0.75, 0.5), Density=4.0)
    made.node_tree.links.new(volume.outputs[0], output.inputs["Volume"])
    assert understood(made).absorption == (0, 1, 2)
    info = node(made, "VolumeInfo")
    made.node_tree.links.new(info.outputs[0], output.inputs["Volume"])
    got, warning = misunderstood(made)
    assert got.absorption == (0, 0, 0) and "Volume Info" in warning


def test_materials_without_a_shader_are_as_in_blender(scene):
    made, output = tree()
    assert [lobe.color for lobe in understood(made).lobes] == [(0, 0, 0)]
    volume = node(made, "VolumeAbsorption", Color=(1, 0.75, 0.5))
    made.node_tree.links.new(volume.outputs[0], output.inputs["Volume"])
    assert understood(made).bare and understood(made).lobes == ()
    made.node_tree.nodes.clear()
    made.diffuse_color = (0.25, 0.5, 0.75, 1.0)
    assert [lobe.color for lobe in understood(made).lobes] == [(0, 0, 0)]  # it has no output
    if bpy.app.version < (5, 0):
        made.use_nodes = False
        assert understood(made).lobes == (model.Lobe("diffuse", (0.25, 0.5, 0.75)),)
    assert understood(None).lobes == (model.Lobe("diffuse", (0.8, 0.8, 0.8)),)


def test_what_is_not_understood_is_named_once_and_the_sockets_value_stands_in(scene):
    made, output = tree("Odd")
    noise = node(made, "TexNoise")
    shader = node(
        made, "BsdfPrincipled", Base_Color=noise.outputs["Color"], Coat_Weight=0.5,
        Roughness=noise.outputs[0], Metallic=noise.outputs[0],
    )  # fmt: skip
    shader.inputs["Base Color"].default_value = (0.25, 0.5, 0.75, 1)
    shader.inputs["Roughness"].default_value = 0.125
    surface(made, output, shader)
    got, warning = misunderstood(made)
    assert got.base_color == (0.25, 0.5, 0.75) and got.lobes[0].roughness == 0.125
    assert warning.count("Noise Texture") == 1 and "Coat Weight" in warning

    surface(made, output, node(made, "BsdfTranslucent", Color=(0.25, 0.5, 0.75)))
    got, warning = misunderstood(made)
    assert got.lobes == (model.Lobe("diffuse", (0.25, 0.5, 0.75)),)
    assert "Translucent BSDF" in warning


# ---- textures ----------------------------------------------------------------


def painted(name, domain, kind, values):
    """A square of two triangles with a colour attribute."""
    made = plane()
    layer = made.color_attributes.new(name, kind, domain)
    layer.data.foreach_set("color", np.asarray(values, np.float32).ravel())
    return made


def test_vertex_colors_come_with_the_corners(scene):
    rng = np.random.default_rng(3)
    for domain, kind in (("POINT", "FLOAT_COLOR"), ("CORNER", "BYTE_COLOR")):
        values = rng.uniform(0, 1, (4, 4))
        ob = put("Painted", painted("Paint", domain, kind, values))
        made, output = tree()
        color = node(made, "VertexColor")
        color.layer_name = "Paint"
        halved = node(made, "Gamma", Color=color, Gamma=2.0)
        surface(made, output, node(made, "BsdfDiffuse", Color=halved))
        ob.data.materials.append(made)
        got = read()
        material, colored = got.materials[-1], got.meshes[-1]
        assert (material.color_source, material.attribute) == ("vertex", "Paint")
        assert material.lobes == (model.Lobe("diffuse", (1, 1, 1), textured=True),)
        ob.data.calc_loop_triangles()
        corners = [tuple(t.loops if domain == "CORNER" else t.vertices)
                   for t in ob.data.loop_triangles]  # fmt: skip
        layer = ob.data.color_attributes["Paint"]
        want = [[layer.data[c].color[:] for c in three] for three in corners]
        assert_allclose(colored.corner_colors, np.array(want)[..., :3], rtol=1e-5)
        assert material.image.pixels is None  # what the nodes make of them where they are hit
        assert_allclose(material.image.program.paint(want), np.square(want)[..., :3], rtol=1e-5)
        assert colored.corner_colors.dtype == np.float32 and colored.corner_uvs is None
        assert got.warnings == ()
        color.layer_name = "Nothing"
        got = read()
        assert_array_equal(got.meshes[-1].corner_colors, 0)  # black, as in Cycles
        assert got.warnings == ("Mesh 'Plane' has no colour attribute 'Nothing'",)
        bpy.data.objects.remove(ob)
        bpy.data.meshes.remove(bpy.data.meshes["Plane"])


def image(pixels, name="Picture", **more):
    made = bpy.data.images.new(name, pixels.shape[1], pixels.shape[0], alpha=True, **more)
    rgba = np.ones((*pixels.shape[:2], 4), np.float32)
    rgba[..., : pixels.shape[2]] = pixels
    made.pixels.foreach_set(rgba.ravel())
    return made


def textured(pixels, **more):
    """A material whose colour is an image; its texture node."""
    made, output = tree("Textured")
    texture = node(made, "TexImage")
    texture.image = image(pixels, **more)
    surface(made, output, node(made, "BsdfDiffuse", Color=texture))
    return made, texture


def mapped(size=2.0):
    """A square of two triangles with UVs 0..1."""
    made = plane(size=size)
    uvs = made.uv_layers.new(name="Unwrapped")
    uvs.uv.foreach_set("vector", np.float32([[0, 0], [1, 0], [1, 1], [0, 1]]).ravel())
    return made


def test_an_images_pixels_are_linear_and_its_uvs_come_with_the_corners(scene):
    pixels = np.linspace(0, 1, 24).reshape(2, 4, 3)
    made, texture = textured(pixels)
    texture.interpolation, texture.extension = "Closest", "MIRROR"
    put("Square", mapped()).data.materials.append(made)
    got = read()
    material, square = got.materials[0], got.meshes[0]
    assert material.color_source == "image" and material.lobes[0].textured
    assert material.image.program is None
    stored = np.round(pixels * 255) / 255
    want = np.where(stored < 0.04045, stored / 12.92, ((stored + 0.055) / 1.055) ** 2.4)
    assert_allclose(material.image.pixels, np.round(pixels * 255))  # looked up as they are stored
    assert_allclose(images.texels_of(texture.image, Warnings()).linear(), want, atol=1e-6)
    assert (material.image.interpolation, material.image.extension) == ("closest", "mirror")
    corners = square.vertices[square.triangles][..., :2]
    assert_allclose(square.corner_uvs, corners / 2 + 0.5, atol=1e-6)
    assert got.warnings == ()


def test_nodes_after_a_texture_change_its_looks(scene):
    pixels = np.random.default_rng(1).uniform(0, 1, (3, 5, 3)).astype(np.float32)
    made, texture = textured(pixels, float_buffer=True)
    tint = node(made, "Mix", Factor_Float=1.0)
    tint.data_type, tint.blend_type = "RGBA", "MULTIPLY"
    sockets = {s.identifier: s for s in tint.inputs}
    sockets["B_Color"].default_value = (0.5, 0.25, 1, 1)
    made.node_tree.links.new(texture.outputs["Color"], sockets["A_Color"])
    result = next(s for s in tint.outputs if s.type == "RGBA")
    bsdf = next(n for n in made.node_tree.nodes if n.bl_idname == "ShaderNodeBsdfDiffuse")
    made.node_tree.links.new(result, bsdf.inputs["Color"])
    put("Square", mapped()).data.materials.append(made)
    got = read().materials[0].image
    assert_array_equal(got.pixels, pixels)
    core = leapray.Texture(got.pixels, program=got.program)
    middles = (np.mgrid[:3, :5][::-1].reshape(2, -1).T + 0.5) / (5, 3)
    looks = core.sample(middles).reshape(pixels.shape)
    assert_allclose(looks, pixels * (0.5, 0.25, 1), rtol=1e-5)


def test_coordinates_pass_through_a_mapping(scene):
    made, texture = textured(np.ones((2, 2, 3)))
    ob = put("Square", mapped())
    ob.data.materials.append(made)
    mapping = node(
        made, "Mapping", Location=(0.5, 0.25, 0), Rotation=(0, 0, math.pi / 2), Scale=(2, 3, 1)
    )
    named = node(made, "UVMap")
    named.uv_map = "Unwrapped"
    made.node_tree.links.new(named.outputs[0], mapping.inputs["Vector"])
    made.node_tree.links.new(mapping.outputs[0], texture.inputs["Vector"])
    uv = read().meshes[0].corner_uvs
    plain = np.stack([0.5 - 3 * (y := ob_uv(read()))[..., 1], 0.25 + 2 * y[..., 0]], axis=-1)
    assert_allclose(uv, plain, atol=1e-6)
    mapping.vector_type = "TEXTURE"
    back = read().meshes[0].corner_uvs
    moved = ob_uv(read()) - (0.5, 0.25)
    assert_allclose(back, np.stack([moved[..., 1] / 2, -moved[..., 0] / 3], axis=-1), atol=1e-6)
    place = node(made, "TexCoord")
    made.node_tree.links.new(place.outputs["Object"], texture.inputs["Vector"])
    got = read().meshes[0]
    assert_allclose(got.corner_uvs, got.vertices[got.triangles][..., :2])
    made.node_tree.links.new(place.outputs["Generated"], texture.inputs["Vector"])
    got = read().meshes[0]
    assert_allclose(got.corner_uvs, got.vertices[got.triangles][..., :2] / 2 + 0.5, atol=1e-6)
    named.uv_map = "Nothing"
    made.node_tree.links.new(named.outputs[0], texture.inputs["Vector"])
    assert read().warnings == ("Mesh 'Plane' has no UV map 'Nothing'",)


def ob_uv(read_scene):
    """The UVs of `mapped`, from the places of its corners."""
    got = read_scene.meshes[0]
    return got.vertices[got.triangles][..., :2] / 2 + 0.5


def test_slots_with_and_without_textures_share_a_mesh(scene):
    first, _ = textured(np.full((2, 2, 3), 0.5))
    square = mapped()
    square.materials.append(diffuse("Plain"))
    square.materials.append(first)
    put("A", square)
    put("B", square)
    other = put("C", square)
    other.material_slots[1].link = "OBJECT"
    other.material_slots[1].material = diffuse("Grey")
    got = read()
    at = {i.name: i.mesh for i in got.instances}
    assert at["A"] == at["B"] != at["C"]
    assert got.meshes[at["A"]].corner_uvs is not None and got.meshes[at["C"]].corner_uvs is None
    assert_array_equal(got.meshes[at["A"]].corner_uvs, 0)  # all faces are in the other slot


def test_an_image_that_is_not_there_is_pink_and_named(scene):
    made, texture = textured(np.ones((2, 2, 3)))
    put("Square", mapped()).data.materials.append(made)
    texture.image = bpy.data.images.new("Gone", 4, 4)
    texture.image.source = "FILE"
    texture.image.filepath = "/nowhere/gone.png"
    got = read()
    assert got.materials[0].lobes == (model.Lobe("diffuse", (1, 0, 1)),)
    assert got.warnings == ("Image 'Gone' cannot be read and is shown in pink",)


def test_a_second_texture_is_not_understood(scene):
    made, output = tree("Two")
    textures = [node(made, "TexImage") for _ in range(2)]
    for k, texture in enumerate(textures):
        texture.image = image(np.full((2, 2, 3), 0.5), name=f"Picture {k}")
    shaders = [node(made, "BsdfDiffuse", Color=t) for t in (*textures, textures[0])]
    inner = node(made, "MixShader", Fac=0.5, Shader=shaders[0], Shader_001=shaders[1])
    surface(made, output, node(made, "AddShader", Shader=inner, Shader_001=shaders[2]))
    got, warning = misunderstood(made)
    assert [lobe.textured for lobe in got.lobes] == [True, False, True]
    assert "a second texture" in warning


# ---- normals -----------------------------------------------------------------


def test_corner_normals_are_there_where_faces_are_smooth(scene):
    bpy.ops.mesh.primitive_uv_sphere_add(segments=12, ring_count=6)
    ball = bpy.context.object.data
    assert read().meshes[0].corner_normals is None  # flat throughout
    ball.shade_smooth()
    got = read().meshes[0]
    normals = np.array([v.vector for v in ball.vertex_normals])
    assert_allclose(got.corner_normals, normals[got.triangles], atol=1e-5)
    ball.set_sharp_from_angle(angle=0.1)  # every edge is one
    got = read().meshes[0]
    if got.corner_normals is not None:
        ball.calc_loop_triangles()
        facets = [ball.polygons[t.polygon_index].normal for t in ball.loop_triangles]
        assert_allclose(got.corner_normals, np.repeat(np.array(facets)[:, None], 3, 1), atol=1e-5)


def test_custom_normals_win(scene):
    ball = plane()
    ball.shade_smooth()
    normal = np.array([0.6, 0.0, 0.8])
    ball.normals_split_custom_set([normal.tolist()] * len(ball.loops))
    put("Square", ball)
    assert_allclose(read().meshes[0].corner_normals, np.broadcast_to(normal, (2, 3, 3)), atol=1e-3)


def test_materials_share_an_images_pixels(scene):
    first, texture = textured(np.full((4, 4, 3), 0.25))
    second, other = textured(np.full((1, 1, 3), 1.0))
    other.image = texture.image
    square = mapped()
    square.materials.append(first)
    square.materials.append(second)
    put("Square", square)
    got = read().materials
    assert np.shares_memory(got[0].image.pixels, got[1].image.pixels)
