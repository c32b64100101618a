# SPDX-License-Identifier: GPL-3.0-or-later
"""Links of nodes: values are converted, passed on, cut and left out as in Cycles."""

import math
import time

import bpy
import numpy as np
import pytest
from blender_scenes import combined, fresh, light, mesh, nodes_of, plane, put, read
from cycles_values import picture, values
from test_materials import misunderstood, node, surface, tree
from test_node_values import ours

from addon.blender import open_file
from addon.blender.read import lights, materials
from addon.blender.read.warnings import Warnings

ORANGE = (0.9, 0.4, 0.1, 1.0)


def group(name, sockets, inside):
    """A group: sockets are (name, "INPUT" or "OUTPUT", kind, default)."""
    made = bpy.data.node_groups.new(name, "ShaderNodeTree")
    for label, in_out, kind, default in sockets:
        socket = made.interface.new_socket(label, in_out=in_out, socket_type=f"NodeSocket{kind}")
        if default is not None:
            socket.default_value = default
    enter, leave = made.nodes.new("NodeGroupInput"), made.nodes.new("NodeGroupOutput")
    inside(made, enter, leave)
    return made


def through(kind, default, out="Float", value=None):
    """A group that passes an input of one kind on as an output of another."""

    def build(into):
        made = group(
            "Through",
            [("In", "INPUT", kind, default), ("Out", "OUTPUT", out, None)],
            lambda made, enter, leave: made.links.new(enter.outputs[0], leave.inputs[0]),
        )
        new = into.nodes.new("ShaderNodeGroup")
        new.node_tree = made
        if value is not None:
            into.links.new(value(into), new.inputs[0])
        return new.outputs[0]

    return build


def number(value):
    def build(into):
        made = into.nodes.new("ShaderNodeValue")
        made.outputs[0].default_value = value
        return made.outputs[0]

    return build


def rgb(color=ORANGE):
    def build(into):
        made = into.nodes.new("ShaderNodeRGB")
        made.outputs[0].default_value = color
        return made.outputs[0]

    return build


def muted(kind, link=None, mute=True, output=0, **settings):
    def build(into):
        made = node(into, kind)
        for name, value in settings.items():
            setattr(made, name, value)
        for socket in made.inputs:
            if socket.type == "RGBA":
                socket.default_value = ORANGE
        if link:
            into.links.new(link(into), next(s for s in made.inputs if s.enabled))
        made.mute = mute
        return [s for s in made.outputs if s.enabled][output]

    return build


def empty_group(into):
    new = into.nodes.new("ShaderNodeGroup")
    new.node_tree = group("Open", [("Out", "OUTPUT", "Color", ORANGE)], lambda *_: None)
    return new.outputs[0]


def muted_group(into):
    new = through("Color", ORANGE, "Color")(into).node
    new.mute = True
    return new.outputs[0]


def nested(into):
    inner = through("Color", ORANGE, "Float")

    def inside(made, enter, leave):
        socket = inner(made)
        made.links.new(enter.outputs[0], socket.node.inputs[0])
        made.links.new(socket, leave.inputs[0])

    new = into.nodes.new("ShaderNodeGroup")
    sockets = [("In", "INPUT", "Vector", (0.5, 2.0, 0.25)), ("Out", "OUTPUT", "Color", None)]
    new.node_tree = group("Outer", sockets, inside)
    return new.outputs[0]


def rerouted(link, n=3):
    def build(into):
        socket = link(into)
        for _ in range(n):
            turn = into.nodes.new("NodeReroute")
            into.links.new(socket, turn.inputs[0])
            socket = turn.outputs[0]
        return socket

    return build


def to_itself(into):
    made = node(into, "BrightContrast", Color=ORANGE, Bright=0.25)
    into.links.new(made.outputs[0], made.inputs["Color"])
    return made.outputs[0]


def circle(n):
    def build(into):
        nodes = [node(into, "Gamma", Color=ORANGE, Gamma=2.0) for _ in range(n)]
        for a, b in zip(nodes, nodes[1:] + nodes[:1], strict=True):
            into.links.new(a.outputs[0], b.inputs["Color"])
        return nodes[-1].outputs[0]

    return build


def reroute_circle(into):
    a, b = (into.nodes.new("NodeReroute") for _ in range(2))
    into.links.new(a.outputs[0], b.inputs[0])
    into.links.new(b.outputs[0], a.inputs[0])
    return a.outputs[0]


def muted_link(into):
    gamma = node(into, "Gamma", Color=ORANGE, Gamma=1.0)
    into.links.new(number(0.25)(into), gamma.inputs["Color"]).is_muted = True
    return gamma.outputs[0]


def hidden_input(into):
    """A link to a socket that the node's settings have made unavailable."""
    mix = node(into, "Mix", Factor_Float=0.5)
    mix.data_type = "RGBA"
    into.links.new(rgb()(into), next(s for s in mix.inputs if s.identifier == "A_Color"))
    mix.data_type = "FLOAT"
    return next(s for s in mix.outputs if s.enabled)


LINKS = {
    "colour to number": through("Color", ORANGE),
    "vector to number": through("Vector", (0.5, 2.0, 0.25)),
    "number to colour": through("Float", 0.3, "Color"),
    "colour to vector": through("Color", ORANGE, "Vector"),
    "whole number": through("Int", 3, "Float"),
    "number to whole": through("Int", 3, "Float", number(2.75)),
    "negative to whole": through("Int", 3, "Float", number(-2.75)),
    "colour to whole": through("Int", 3, "Color", rgb((5.5, 3.0, 1.0, 1))),
    "linked colour to number": through("Color", ORANGE, "Float", rgb((0.2, 0.8, 0.5, 1))),
    "nested groups": nested,
    "muted group": muted_group,
    "muted gray": muted("RGBToBW"),
    "muted gray, linked": muted("RGBToBW", rgb()),
    "muted math": muted("Math", number(0.75)),
    "muted invert": muted("Invert", number(0.25)),
    "muted gamma, linked": muted("Gamma", rgb()),
    "muted ramp": muted("ValToRGB", number(0.6)),
    "muted separate": muted("SeparateColor", rgb(), output=1),
    "muted noise": muted("TexNoise"),
    "muted vector math": muted("VectorMath", rgb(), operation="LENGTH"),
    "reroutes": rerouted(rgb()),
    "reroute of nothing": rerouted(lambda into: into.nodes.new("NodeReroute").outputs[0]),
    "node to itself": to_itself,
    "circle of two": circle(2),
    "circle of five": circle(5),
    "circle of reroutes": reroute_circle,
    "muted link": muted_link,
    "hidden input": hidden_input,
    "group without inside": empty_group,
}


def test_links_are_those_of_cycles():
    fresh()
    want = values(list(LINKS.values()))
    got = np.array([ours(build) for build in LINKS.values()])
    bad = [(name, a, b) for name, a, b in zip(LINKS, got, want, strict=True)
           if np.abs(a - b).max() > 1e-4]  # fmt: skip
    assert not bad, bad


# ---- shaders -------------------------------------------------------------------


def shaders():
    """Emitting materials, by name."""
    for name, build in {
        "colour": rgb(), "number": number(0.7), "gray": muted("RGBToBW", rgb(), mute=False),
        "combined": lambda into: node(into, "CombineXYZ", X=0.5, Y=0.25, Z=0.125).outputs[0],
    }.items():  # fmt: skip
        made, output = tree(name)
        made.node_tree.links.new(build(made.node_tree), output.inputs["Surface"])
        yield made
    made, output = tree("shared")
    glow = node(made, "Emission", Color=ORANGE[:3], Strength=0.01)
    last = glow
    for _ in range(6):  # 64 paths to one shader
        last = node(made, "AddShader", Shader=last, Shader_001=last)
    surface(made, output, last)
    yield made
    made, output = tree("mixed with a colour")
    parts = dict(Shader=glow_of(made), Shader_001=node(made, "RGB"))
    surface(made, output, node(made, "MixShader", Fac=0.25, **parts))
    yield made
    made, output = tree("no output")
    surface(made, output, glow_of(made))
    made.node_tree.nodes.remove(output)
    yield made
    made, output = tree("an output of a world")
    made.node_tree.nodes.remove(output)
    world = node(made, "OutputWorld")
    made.node_tree.links.new(glow_of(made).outputs[0], world.inputs["Surface"])
    yield made
    made, _ = tree("nothing linked")
    yield made
    made, output = tree("two outputs")
    second = node(made, "OutputMaterial")
    second.is_active_output = True
    output.is_active_output = False
    surface(made, second, glow_of(made))
    yield made


def glow_of(made):
    return node(made, "Emission", Color=(0.25, 0.5, 1.0), Strength=0.5)


def test_shaders_emit_as_in_cycles():
    fresh()
    made = list(shaders())
    got = []
    for each in made:
        notes = Warnings()
        lobes = materials.read(each, notes)[0].lobes
        assert notes.sentences() == (), each.name
        shining = [lobe for lobe in lobes if lobe.kind == "emission"]
        got.append(sum((lobe.weight * np.array(lobe.color) for lobe in shining), np.zeros(3)))
    want = picture(made, 1)[:, 0, 0]
    bad = [(m.name, a, b) for m, a, b in zip(made, got, want, strict=True)
           if np.abs(a - b).max() > 1e-4]  # fmt: skip
    assert not bad, bad


def mean(scene, engine):
    scene.render.engine = engine
    scene.render.resolution_x = scene.render.resolution_y = 8
    scene.cycles.samples = scene.leapray.samples = 1
    scene.cycles.use_denoising = scene.cycles.use_adaptive_sampling = False
    with open_file.quiet():
        bpy.ops.render.render()
    return combined(scene)[..., :3].mean(axis=(0, 1))


@pytest.mark.parametrize("without", ["world", "sun", "material"])
def test_without_an_output_nothing_emits(without):
    scene = fresh()
    nodes_of(scene.world).nodes["Background"].inputs["Color"].default_value = (0.1, 0.2, 0.3, 1)
    sun = light("SUN", energy=3.0)
    put("Sun", sun)
    ground = put("Ground", plane())
    made = bpy.data.materials.new("Ground")
    nodes_of(made)
    ground.data.materials.append(made)
    if nodes_of(sun) is None:
        sun.use_nodes = True
    tree = {"world": scene.world, "sun": sun, "material": made}[without].node_tree
    tree.nodes.clear()
    scene.world.color = made.diffuse_color[:3] = (1, 0.5, 0.25)
    want, got = mean(scene, "CYCLES"), mean(scene, "LEAPRAY")
    assert np.abs(want - got).max() < 0.01


# ---- size and nonsense ---------------------------------------------------------


def chain(into, first, kind, n):
    """n nodes one after the other, from a socket on, and the last one's output."""
    for _ in range(n):
        new = into.nodes.new(kind)
        into.links.new(first, new.inputs[0])
        first = new.outputs[0]
    return first


def long_chain(into, first, kind, socket, side):
    """side^2 nodes, in groups, for Blender is slow to link thousands in one tree."""
    inner = group(
        kind,
        [("In", "INPUT", socket, None), ("Out", "OUTPUT", socket, None)],
        lambda made, enter, leave: made.links.new(
            chain(made, enter.outputs[0], kind, side), leave.inputs[0]
        ),
    )
    for _ in range(side):
        new = into.nodes.new("ShaderNodeGroup")
        new.node_tree = inner
        into.links.new(first, new.inputs[0])
        first = new.outputs[0]
    return first


def test_chains_of_thousands_of_nodes():
    fresh()
    made, output = tree("Long")
    into = made.node_tree
    color = long_chain(into, rgb()(into), "ShaderNodeGamma", "Color", 71)
    glow = node(made, "Emission", Color=color).outputs[0]
    shader = long_chain(into, glow, "ShaderNodeAddShader", "Shader", 71)
    into.links.new(shader, output.inputs["Surface"])
    start = time.perf_counter()
    got, _ = materials.read(made, Warnings())
    assert np.allclose(got.lobes[0].color, ORANGE[:3], atol=1e-5)
    assert time.perf_counter() - start < 10


def test_branches_that_meet_again_are_walked_once():
    fresh()
    made, output = tree("Diamonds")
    last = node(made, "Emission", Color=(1.0, 1.0, 1.0))
    for _ in range(100):  # 2^100 paths, whose sum is no number of f32's
        last = node(made, "AddShader", Shader=last, Shader_001=last)
    surface(made, output, last)
    color = node(made, "RGB")
    for _ in range(100):
        color = node(made, "Mix", A_Color=color, B_Color=color)
        color.data_type = "RGBA"
    got, _ = materials.read(made, Warnings())
    assert len(got.lobes) == 1


NONSENSE = [math.nan, math.inf, -math.inf]


@pytest.mark.parametrize("value", NONSENSE)
@pytest.mark.parametrize("name", ["Base Color", "Roughness", "Emission Color", "Alpha", "IOR"])
def test_a_material_with_no_number_is_black_and_named(name, value):
    fresh()
    made, output = tree("Odd")
    pole = node(made, "Math", Value=3e38, Value_001=3e38)
    pole.operation = "MULTIPLY"
    sign = 0.0 if math.isnan(value) else math.copysign(1, value)
    infinite = node(made, "Math", Value=pole, Value_001=sign)
    infinite.operation = "MULTIPLY"
    shader = node(made, "BsdfPrincipled", Emission_Strength=1.0)
    made.node_tree.links.new(infinite.outputs[0], shader.inputs[name])
    surface(made, output, shader)
    notes = Warnings()
    got, _ = materials.read(made, notes)
    if value == -math.inf or (value == math.inf and name in ("Roughness", "Alpha")):
        assert notes.sentences() == ()  # what is out of range is brought into it
        return
    assert notes.sentences() == (
        "Material 'Odd' has a value that is no number (NaN or infinite) and is shown in black",
    )
    assert [(lobe.kind, lobe.color) for lobe in got.lobes] == [("diffuse", (0, 0, 0))]


def test_the_frame_goes_on_beside_nonsense():
    scene = fresh()
    good, output = tree("Good")
    surface(good, output, node(good, "Emission", Color=(0.5, 0.25, 1.0)))
    bad, output = tree("Bad")
    color = node(bad, "RGB")
    color.outputs[0].default_value = (math.nan, 0, 0, 1)
    surface(bad, output, node(bad, "Emission", Color=color))
    for x, made in ((-1, good), (1, bad)):
        put(made.name, plane(), location=(x, 0, 0)).data.materials.append(made)
    background = nodes_of(scene.world)
    strength = node(background, "Math", Value=3e38, Value_001=10.0)
    strength.operation = "MULTIPLY"
    background.links.new(strength.outputs[0], background.nodes["Background"].inputs["Strength"])
    background.nodes["Background"].inputs["Color"].default_value = (1, 1, 1, 1)
    assert len(read().warnings) == 2
    scene.camera.data.type, scene.camera.data.ortho_scale = "ORTHO", 4
    scene.render.resolution_x, scene.render.resolution_y = 16, 8
    scene.leapray.samples = 1
    with open_file.quiet():
        bpy.ops.render.render()
    got = combined(scene)[..., :3]
    assert np.isfinite(got).all()
    assert np.allclose(got[:, 1:7], (0.5, 0.25, 1.0), atol=1e-3) and not got[:, 9:15].any()


def test_a_world_with_no_number_is_left_out_and_named():
    scene = fresh()
    put("Cube", mesh())
    color = node(nodes_of(scene.world), "RGB")
    color.outputs[0].default_value = (math.nan, 1, 1, 1)
    nodes = scene.world.node_tree
    nodes.links.new(color.outputs[0], nodes.nodes["Background"].inputs["Color"])
    notes = Warnings()
    assert lights.of_world(scene.world, notes).color == (0, 0, 0)
    assert notes.sentences() == ("Skipped 'World': its strength is not a finite number",)


def test_a_texture_times_no_number_is_named():
    fresh()
    made, output = tree("Odd")
    texture = node(made, "TexImage")
    texture.image = bpy.data.images.new("Fine", 2, 2)
    huge = node(made, "Math", Value=3e38, Value_001=3e38)
    huge.operation = "MULTIPLY"
    product = node(made, "VectorMath", Vector=texture, Vector_001=huge)
    product.operation = "MULTIPLY"
    surface(made, output, node(made, "Emission", Color=product))
    notes = Warnings()
    got, _ = materials.read(made, notes)
    assert got.lobes[0].color == (0, 0, 0) and not got.lobes[0].textured
    assert "'Odd' has a value that is no number" in notes.sentences()[0]


def test_a_shader_where_a_colour_belongs_is_named():
    fresh()
    made, output = tree("Odd")
    made.node_tree.nodes.new("ShaderNodeShaderToRGB")
    shown = next(n for n in made.node_tree.nodes if n.bl_idname == "ShaderNodeShaderToRGB")
    surface(made, output, node(made, "BsdfDiffuse", Color=shown))
    _, warning = misunderstood(made)
    assert "Shader to RGB" in warning


# ---- the colours of a mesh ------------------------------------------------------


def test_a_ramp_of_vertex_colours_is_sharp_where_it_is_hit():
    """In Cycles and in LeapRay a step lies within the triangles, not along their edges."""
    scene = fresh()
    made, output = tree("Painted")
    color = node(made, "VertexColor")
    color.layer_name = "Paint"
    ramp = node(made, "ValToRGB", Fac=color.outputs["Alpha"])
    ramp.color_ramp.interpolation = "CONSTANT"
    ramp.color_ramp.elements[1].position = 0.3
    surface(made, output, node(made, "Emission", Color=ramp))
    square = plane(size=4.0)
    layer = square.color_attributes.new("Paint", "FLOAT_COLOR", "POINT")
    layer.data.foreach_set("color", np.float32([[0, 0, 0, x > 0] for x in (-1, 1, 1, -1)]).ravel())
    square.materials.append(made)
    put("Square", square)
    scene.camera.data.type, scene.camera.data.ortho_scale = "ORTHO", 4
    pictures = {}
    for engine in ("CYCLES", "LEAPRAY"):
        mean(scene, engine)
        scene.render.resolution_x, scene.render.resolution_y = 40, 8
        scene.cycles.pixel_filter_type = "BOX"
        with open_file.quiet():
            bpy.ops.render.render()
        pictures[engine] = combined(scene)[..., 0]
    want, got = pictures["CYCLES"], pictures["LEAPRAY"]
    assert 0.6 < want.mean() < 0.75
    assert (np.abs(want - got) > 0.02).sum() <= 8  # the column of the step
