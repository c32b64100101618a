# SPDX-License-Identifier: GPL-3.0-or-later
"""Flags of scenes, view layers, collections and objects, against Cycles."""

from __future__ import annotations

import math

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")
from blender_scenes import diffuse, fresh, light, mesh, nodes_of, plane, put, read  # noqa: E402
from engines import bare, blocks, both, render, warnings  # noqa: E402
from numpy.testing import assert_allclose  # noqa: E402


class Stage:
    """A floor (index 1), a box (index 2) in a collection of its own, a sun, a grey world."""

    def __init__(self, transparent=True):
        self.scene = bare(32, 24)
        self.scene.render.film_transparent = transparent
        self.scene.camera.location = 0, -6, 9
        self.scene.camera.rotation_euler = math.radians(35), 0, 0
        nodes_of(self.scene.world).nodes["Background"].inputs["Color"].default_value = (
            0.2, 0.2, 0.3, 1)  # fmt: skip
        self.layer = self.scene.view_layers[0]
        self.collection = bpy.data.collections.new("Held")
        self.scene.collection.children.link(self.collection)
        self.white = diffuse("White", (0.7, 0.7, 0.7))
        self.floor = self.thing("Floor", plane(size=6.0), 1)
        self.box = self.thing("Box", mesh(), 2, location=(0, 0, 1.2))
        self.move(self.box, self.collection)
        put("Sun", light("SUN", energy=3, angle=0.0), rotation_euler=(0.5, 0.4, 0))
        bpy.context.view_layer.update()

    @property
    def flags(self):
        """Of the collection in the view layer."""
        return self.layer.layer_collection.children["Held"]

    def thing(self, name, data, index, **places):
        data.materials.append(self.white)
        ob = put(name, data, **places)
        ob.pass_index = index
        return ob

    def move(self, ob, collection):
        for each in ob.users_collection:
            each.objects.unlink(ob)
        collection.objects.link(ob)

    def compare(self, samples=64, bounces=0):
        """Light and alpha agree in blocks, the others in all pixels but for some at edges."""
        cycles, ours = both(self.scene, samples, bounces)
        for name in ("Depth", "Object Index"):
            off = ~np.isclose(ours[name], cycles[name], rtol=0.01)
            assert off.mean() < 0.02, name
        for name in ("Combined", "Environment", "Emission"):
            assert_allclose(blocks(ours[name], 4), blocks(cycles[name], 4), atol=0.02, err_msg=name)
            assert_allclose(ours[name].mean((0, 1)), cycles[name].mean((0, 1)), atol=3e-3)


def object_holdout(stage):
    stage.box.is_holdout = True


def collection_holdout(stage):
    stage.flags.holdout = True


def nested_holdout(stage):
    inner = bpy.data.collections.new("Inner")
    stage.collection.children.link(inner)
    stage.move(stage.box, inner)
    stage.flags.holdout = True


def indirect_only(stage):
    stage.flags.indirect_only = True


def both_flags(stage):
    stage.flags.indirect_only = stage.flags.holdout = True


def _instanced(stage):
    """The box, drawn by an instance of a collection that is not in the scene."""
    source = bpy.data.collections.new("Source")
    stage.move(stage.box, source)
    empty = put("Empty", None, instance_type="COLLECTION", instance_collection=source)
    stage.move(empty, stage.collection)
    return empty


def instancer_in_holdout(stage):
    _instanced(stage)
    stage.flags.holdout = True


def instancer_held(stage):
    _instanced(stage).is_holdout = True


def instanced_held(stage):
    _instanced(stage)
    stage.box.is_holdout = True  # which counts for nothing


def instancer_indirect(stage):
    _instanced(stage)
    stage.flags.indirect_only = True


def faces_of_a_held_parent(stage):
    parent = stage.thing("Parent", plane(size=1.0), 3, location=(0, 0, 1.0), is_holdout=True)
    parent.instance_type, parent.show_instancer_for_render = "FACES", False
    stage.box.parent = parent
    stage.box.location = 0, 0, 0


def holdout_in_front(stage):
    stage.floor.is_holdout = True
    stage.box.location.z = -2.5  # seen beside the floor alone


def half_a_holdout(stage):
    stage.box.is_holdout = True
    tree = nodes_of(stage.box.data.materials[0].copy())
    stage.box.data.materials[0] = bpy.data.materials[-1]
    stage.box.data.materials[0] = next(m for m in bpy.data.materials if m.node_tree == tree)
    output = next(n for n in tree.nodes if n.bl_idname == "ShaderNodeOutputMaterial")
    shader = output.inputs["Surface"].links[0].from_socket
    mix, clear = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("MixShader", "BsdfTransparent"))
    mix.inputs[0].default_value = 0.6
    tree.links.new(shader, mix.inputs[1])
    tree.links.new(clear.outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], output.inputs["Surface"])


def shining_holdout(stage):
    stage.box.is_holdout = True
    made = bpy.data.materials.new("Shine")
    tree = nodes_of(made)
    tree.nodes.clear()
    emission = tree.nodes.new("ShaderNodeEmission")
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(emission.outputs[0], output.inputs["Surface"])
    stage.box.data.materials[0] = made


def no_sky(stage):
    stage.layer.use_sky = False


def no_surfaces(stage):
    stage.layer.use_solid = False


FLAGS = [
    object_holdout,
    collection_holdout,
    nested_holdout,
    indirect_only,
    both_flags,
    instancer_in_holdout,
    instancer_held,
    instanced_held,
    instancer_indirect,
    faces_of_a_held_parent,
    holdout_in_front,
    half_a_holdout,
    shining_holdout,
    no_sky,
    no_surfaces,
]


@pytest.mark.parametrize("transparent", [True, False])
@pytest.mark.parametrize("flag", FLAGS, ids=lambda each: each.__name__)
def test_flags_show_what_they_show_in_cycles(flag, transparent):
    stage = Stage(transparent)
    flag(stage)
    bpy.context.view_layer.update()
    stage.compare()
    assert warnings() == []


def test_what_is_held_out_is_seen_in_mirrors_and_lights_its_surroundings():
    stage = Stage(transparent=False)
    stage.box.is_holdout = True
    mirror = bpy.data.materials.new("Mirror")
    tree = nodes_of(mirror)
    tree.nodes.clear()
    shader = tree.nodes.new("ShaderNodeBsdfAnisotropic")
    shader.inputs["Roughness"].default_value = 0.0
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    stage.floor.data.materials[0] = mirror
    stage.compare(samples=32, bounces=2)
    stage.box.is_holdout = False
    stage.flags.indirect_only = True
    bpy.context.view_layer.update()
    stage.compare(samples=32, bounces=2)


def test_lights_of_indirect_only_collections_are_not_seen():
    stage = Stage(transparent=False)
    bulb = put("Bulb", light("POINT", energy=50.0, shadow_soft_size=0.8), location=(2, 0, 3))
    bulb.visible_camera = True
    stage.compare(samples=32)
    stage.move(bulb, stage.collection)
    stage.flags.indirect_only = True
    bpy.context.view_layer.update()
    stage.compare(samples=32)


def test_the_films_exposure_is_that_of_cycles():
    stage = Stage()
    stage.scene.cycles.film_exposure = 2.5
    cycles, ours = both(stage.scene)
    plain = {name: each.mean() for name, each in ours.items()}
    for name in ("Combined", "Environment", "Emission", "Depth"):
        assert ours[name].mean() == pytest.approx(cycles[name].mean(), rel=0.01, abs=1e-6)
    stage.scene.cycles.film_exposure = 1.0
    ours = render(stage.scene, "LEAPRAY")
    assert plain["Depth"] == ours["Depth"].mean()
    assert 1.9 < plain["Combined"] / ours["Combined"].mean() < 2.5  # alpha is not exposed


def test_view_layers_have_samples_of_their_own():
    from addon.blender import properties

    scene = fresh()
    scene.leapray.samples, layer = 32, scene.view_layers[0]

    def taken():
        return properties.settings(scene, layer).samples

    assert taken() == 32
    layer.samples = 100
    assert [taken(), properties.settings(scene).samples] == [100, 32]
    scene.cycles.use_layer_samples = "BOUNDED"
    assert taken() == 32
    layer.samples = 5
    assert taken() == 5
    scene.cycles.use_layer_samples = "IGNORE"
    assert taken() == 32
    scene.cycles.use_layer_samples = "USE"
    put("Cube", mesh())
    assert read().settings.samples == 5


def test_samples_asked_for_on_the_command_line_count_for_every_layer():
    from addon import arguments, cli
    from addon.blender import properties

    scene = fresh()
    scene.view_layers[0].samples = 100
    cli.override(scene, arguments.parse(["render", "a.blend", "--samples", "7"]))
    assert properties.settings(scene, scene.view_layers[0]).samples == 7


def test_passes_that_are_not_made_are_named_once():
    scene = fresh()
    put("Cube", mesh())
    layer = scene.view_layers[0]
    assert read().warnings == ()
    layer.use_pass_diffuse_color = layer.use_pass_vector = layer.use_pass_z = True
    layer.use_pass_cryptomatte_object = layer.cycles.pass_debug_sample_count = True
    layer.use_pass_ambient_occlusion = True
    layer.aovs.add().name = "Mask"
    layer.lightgroups.add().name = "Lights"
    (sentence,) = read().warnings
    for name in ("Diffuse Color", "Vector", "Cryptomatte Object", "Sample Count", "Mask", "Lights"):
        assert sentence.count(name) == 1
    assert sentence.startswith("View layer 'ViewLayer'")
    assert "Ambient" not in sentence and " Z" not in sentence


def test_glass_before_a_transparent_film_is_named():
    scene = fresh()
    put("Cube", mesh())
    scene.cycles.film_transparent_glass = True
    assert read().warnings == ()
    scene.render.film_transparent = True
    (sentence,) = read().warnings
    assert "Transparent glass" in sentence and scene.name in sentence
