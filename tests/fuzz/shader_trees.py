# SPDX-License-Identifier: GPL-3.0-or-later
"""Trees of shader nodes: any that Blender can make is read as a material that the core takes, with
no question asked of it but what its warnings name."""

from __future__ import annotations

import bpy
import numpy as np
from blender_scenes import fresh, nodes_of
from random_trees import OUTPUTS, Grower
from stage import ball, camera, one

import leapray
from addon.blender.read import materials
from addon.blender.read.warnings import Warnings

fresh()
GROWER = Grower(0)  # its groups of nodes; the trees are those of each input's own numbers
MATERIAL = bpy.data.materials.new("Random")
TREE = nodes_of(MATERIAL)
BALL = one(leapray.build(ball()))
VIEW = camera((0, 0, 5))


def check(rng: np.random.Generator) -> None:
    GROWER.rng = rng
    TREE.nodes.clear()
    nodes = GROWER.grow(TREE, int(rng.integers(1, 10)), OUTPUTS[:1])
    shaders = [s for node in nodes for s in node.outputs if s.type == "SHADER"]
    if shaders:
        TREE.links.new(shaders[rng.integers(len(shaders))], nodes[0].inputs["Surface"])
    told = Warnings()
    material, _ = materials.read(MATERIAL, told)
    leapray.Scene(VIEW, [BALL], (), [material], [0])
    assert all(" " in sentence for sentence in told.sentences()), "no sentence"
