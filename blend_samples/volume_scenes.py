# SPDX-License-Identifier: GPL-3.0-or-later
"""The samples about volumes: a scan, and a level set that nodes make, as surfaces."""

from __future__ import annotations

from pathlib import Path

import bpy  # isort: skip  (first: kit is in it)
import head_phantom
from kit import SAND, camera, link, material, new_scene, plane, sun
from lit_scenes import shader

HERE = Path(__file__).resolve().parent
SCAN = "head.nii.gz"  # beside the .blend
SAMPLES = 96  # of the scan along each axis
SKIN, IVORY = (0.85, 0.50, 0.38), (0.82, 0.76, 0.62)


def make_head() -> None:
    new_scene((0.20, 0.22, 0.26), 720, 720)
    head_phantom.write(HERE / SCAN, SAMPLES)
    volume = bpy.data.volumes.new("Head")
    own = volume.leapray
    own.file, own.automatic = f"//{SCAN}", False
    own.surfaces, own.threshold, own.threshold_2 = 2, head_phantom.SKIN_AT, head_phantom.BONE_AT
    volume.materials.append(veil("Skin", SKIN, 0.35))
    volume.materials.append(material("Bone", IVORY))
    # The scan is in millimetres; a unit is ten centimetres, and the neck stands on the floor.
    link(volume, "Head", at=(0, 0, head_phantom.EXTENT / 200), turn=(0, 0, 180), scale=0.01)
    link(plane("Floor", 200.0, material("Sand", SAND)), "Floor")
    sun(2.4, (-0.6, -0.7, 0.8))
    camera((-3.6, -6.6, 2.6), (0, 0, 1.2), lens=85)


def veil(name: str, color, opacity: float) -> bpy.types.Material:
    """Diffuse, but what lies behind shows through."""
    made = shader(name, "BsdfDiffuse", color)
    tree = made.node_tree
    clear, mix = tree.nodes.new("ShaderNodeBsdfTransparent"), tree.nodes.new("ShaderNodeMixShader")
    mix.inputs["Fac"].default_value = opacity
    tree.links.new(clear.outputs[0], mix.inputs[1])
    tree.links.new(tree.nodes["Diffuse BSDF"].outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    return made
