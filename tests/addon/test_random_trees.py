# SPDX-License-Identifier: GPL-3.0-or-later
"""No tree of nodes that Blender can make is more than LeapRay can read."""

import bpy
import numpy as np
import pytest
from blender_scenes import fresh, light, nodes_of, put
from random_trees import OUTPUTS, Grower
from stage import camera, one

import leapray
from addon.blender.read import lights, materials
from addon.blender.read.node_values import NODES
from addon.blender.read.warnings import Warnings

TREES = 2000
BATCH = 250


def of_material(grower):
    made = bpy.data.materials.new("Random")
    tree = nodes_of(made)
    tree.nodes.clear()
    return made, grower.grow(tree, int(grower.rng.integers(1, 14)), outputs(grower)), tree


def outputs(grower):
    return [OUTPUTS[min(int(grower.rng.integers(8)), 2) if grower.rng.random() < 0.3 else 0]]


def tie(grower, tree, nodes):
    """Link the output's surface, as most trees have it."""
    surface = nodes[0].inputs.get("Surface") if nodes else None
    shaders = [s for node in nodes for s in node.outputs if s.type == "SHADER"]
    if surface is not None and shaders and grower.rng.random() < 0.9:
        tree.links.new(grower._one(shaders), surface)
    if surface is not None and grower.rng.random() < 0.3:
        paint(grower, tree, surface)


def paint(grower, tree, surface):
    """A texture, some nodes that work on it, and a shader that takes it."""
    texture = tree.nodes.new(
        ("ShaderNodeTexImage", "ShaderNodeVertexColor")[grower.rng.integers(2)]
    )
    grower._set(texture)
    last = grower._one(texture.outputs)
    for _ in range(int(grower.rng.integers(0, 4))):
        new = tree.nodes.new(grower._one([kind for kind in NODES if kind in grower.kinds]))
        grower._set(new)
        if new.inputs and new.outputs:
            tree.links.new(last, grower._one(new.inputs))
            last = grower._one(new.outputs)
    shader = tree.nodes.new("ShaderNodeBsdfDiffuse")
    tree.links.new(last, shader.inputs["Color"])
    tree.links.new(shader.outputs[0], surface)


def sampled(image):
    """Some looks of an image."""
    texture = leapray.Texture(image.pixels, image.interpolation, image.extension, image.program)
    if texture.of_corners:
        return image.program.run(np.random.default_rng(1).uniform(-1, 2, (8, 4)))
    looks = texture.sample(np.random.default_rng(1).uniform(-1, 2, (8, 2)))
    assert np.isfinite(looks).all()
    return looks


@pytest.mark.parametrize("seed", range(TREES // BATCH))
def test_random_trees_are_read(seed, floor):
    fresh()
    grower = Grower(seed)
    read, textured, named = [], 0, 0
    for _ in range(BATCH):
        made, nodes, tree = of_material(grower)
        tie(grower, tree, nodes)
        notes = Warnings()
        material, _ = materials.read(made, notes)
        read.append(material)
        named += bool(notes.sentences())
        if material.image is not None:
            textured += 1
            sampled(material.image)
        bpy.data.materials.remove(made)
    scene_of(read, floor)
    assert named > BATCH / 4  # the trees do hold what is not understood
    assert textured > BATCH / 50


def scene_of(read, floor):
    """All materials are such as the core takes."""
    leapray.Scene(camera((0, 0, 5)), [one(floor)], (), read, range(len(read)))


def test_random_worlds_and_lights_are_read():
    fresh()
    grower = Grower(99)
    for k in range(200):
        data = light("POINT") if k % 2 else bpy.data.worlds.new("Random")
        tree = nodes_of(data)
        if tree is None:
            data.use_nodes = True
            tree = data.node_tree
        tree.nodes.clear()
        nodes = grower.grow(tree, int(grower.rng.integers(1, 10)), OUTPUTS[1:][k % 2 :][:1])
        tie(grower, tree, nodes)
        if k % 2:
            ob = put("Random", data)
            lights.of_light(data, np.eye(4), [ob], "Random", Warnings())
            continue
        world = lights.of_world(data, Warnings())
        assert np.isfinite(world.color).all()
        if world.image is not None:
            sampled(world.image)
