# SPDX-License-Identifier: GPL-3.0-or-later
"""The samples about volumes: a scan, its label map, and a field that nodes make."""

from __future__ import annotations

from pathlib import Path

import bpy  # isort: skip  (first: kit is in it)
import head_phantom
from kit import (
    CORAL,
    OCHRE,
    SAND,
    TEAL,
    ball_mesh,
    camera,
    link,
    material,
    new_scene,
    plane,
    sun,
)
from lit_scenes import shader

HERE = Path(__file__).resolve().parent
SCAN = "head.nii.gz"  # beside the .blend
TISSUES = "head_labels.nii.gz"  # likewise
SAMPLES = 96  # of the scan along each axis
SKIN, IVORY = (0.85, 0.50, 0.38), (0.82, 0.76, 0.62)
LABELS = {  # colours of the phantom's labels, 1 first
    "Skin": SKIN,
    "Bone": IVORY,
    "Brain": (0.75, 0.28, 0.30),
    "Eye": (0.80, 0.85, 0.90),
    "Sinus": (0.05, 0.06, 0.10),
    "Tooth": (0.90, 0.89, 0.85),
}


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


def make_labels() -> None:
    new_scene((0.20, 0.22, 0.26), 720, 720)
    head_phantom.write(HERE / TISSUES, SAMPLES, labelled=True)
    volume = bpy.data.volumes.new("Head")
    volume.leapray.file, volume.leapray.label_index = f"//{TISSUES}", True
    for name, color in LABELS.items():
        volume.materials.append(material(name, color))
    link(volume, "Head", at=(0, 0, head_phantom.EXTENT / 200), turn=(0, 0, 180), scale=0.01)
    cut = link(None, "Cut", at=(-1.02, -1.1, 2.38))
    cut.empty_display_type = "CUBE"  # the quarter at the right temple is taken away
    volume.leapray.clip_object = cut
    link(plane("Floor", 200.0, material("Sand", SAND)), "Floor")
    sun(2.4, (-0.6, -0.7, 0.8))
    camera((-4.6, -5.8, 3.4), (0, 0, 1.2), lens=85)


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


def make_gyroid() -> None:
    new_scene((0.34, 0.40, 0.46), 720, 720)
    volume = bpy.data.volumes.new("Gyroid")
    volume.leapray.automatic, volume.leapray.threshold = False, 0.5
    made = link(volume, "Gyroid", at=(0, 0, 1.05))
    made.modifiers.new("Field", "NODES").node_group = gyroid_nodes(material("Teal", TEAL))
    link(ball_mesh("Kernel", material("Coral", CORAL)), "Kernel", at=(0, 0, 1.05), scale=0.4)
    link(ball_mesh("Ball", material("Ochre", OCHRE)), "Ball", at=(1.35, -0.75, 0.3), scale=0.3)
    link(plane("Floor", 200.0, material("Sand", SAND)), "Floor")
    sun(2.5, (-0.6, -0.7, 0.9))
    camera((-1.6, -7.0, 3.2), (0.1, 0, 0.9), lens=72)


def gyroid_nodes(paint, turns: float = 7.0, thickness: float = 0.4, resolution: int = 112):
    """A tree whose field is 0.5 on a gyroid's sheet, cut to the ball of radius 1."""
    tree = bpy.data.node_groups.new("Gyroid", "GeometryNodeTree")
    for side in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=side, socket_type="NodeSocketGeometry")

    def calculate(operation: str, *terms):
        node = tree.nodes.new("ShaderNodeMath")
        node.operation = operation
        for term, socket in zip(terms, node.inputs, strict=False):
            if isinstance(term, float):
                socket.default_value = term
            else:
                tree.links.new(term, socket)
        return node.outputs[0]

    position = tree.nodes.new("GeometryNodeInputPosition").outputs[0]
    split, length = tree.nodes.new("ShaderNodeSeparateXYZ"), tree.nodes.new("ShaderNodeVectorMath")
    length.operation = "LENGTH"
    tree.links.new(position, split.inputs[0])
    tree.links.new(position, length.inputs[0])
    angles = [calculate("MULTIPLY", axis, turns) for axis in split.outputs]
    waves = [
        calculate("MULTIPLY", calculate("SINE", a), calculate("COSINE", b))
        for a, b in zip(angles, angles[1:] + angles[:1], strict=True)
    ]
    sheet = calculate("ABSOLUTE", calculate("ADD", calculate("ADD", *waves[:2]), waves[2]))
    within = calculate("MULTIPLY", calculate("SUBTRACT", 1.0, length.outputs["Value"]), turns)
    least = calculate("MINIMUM", calculate("SUBTRACT", thickness, sheet), within)
    cube = tree.nodes.new("GeometryNodeVolumeCube")
    tree.links.new(calculate("ADD", least, 0.5), cube.inputs["Density"])
    for end, at in (("Min", -1.05), ("Max", 1.05)):
        cube.inputs[end].default_value = (at, at, at)
    for axis in "XYZ":
        cube.inputs[f"Resolution {axis}"].default_value = resolution
    painted, leave = tree.nodes.new("GeometryNodeSetMaterial"), tree.nodes.new("NodeGroupOutput")
    painted.inputs["Material"].default_value = paint
    tree.links.new(cube.outputs["Volume"], painted.inputs["Geometry"])
    tree.links.new(painted.outputs[0], leave.inputs[0])
    return tree
