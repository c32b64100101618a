# SPDX-License-Identifier: GPL-3.0-or-later
"""The samples about volumes: a scan, its label map, a fog, and a field that nodes make."""

from __future__ import annotations

import math
from pathlib import Path

import bpy  # isort: skip  (first: kit is in it)
import head_phantom
import numpy as np
from kit import (
    CORAL,
    LEAF,
    OCHRE,
    SAND,
    TEAL,
    WHITE,
    ball_mesh,
    camera,
    grid,
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
FOG = "cloud.vdb"  # likewise
SAMPLES = 96  # of the scan along each axis
FRAMES = 48  # of a turn
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


def make_xray() -> None:
    """The scan before a white world, which it dims the more the denser it is."""
    new_scene((1.0, 1.0, 1.0), 720, 720)
    head_phantom.write(HERE / SCAN, SAMPLES)
    volume = bpy.data.volumes.new("Head")
    volume.leapray.file, volume.leapray.shown = f"//{SCAN}", "volume"
    volume.materials.append(film("Film"))
    link(volume, "Head", turn=(0, 0, 180), scale=0.01)
    camera((-2.4, -8.4, 0.9), (0, 0, 0), lens=100)


def make_turntable() -> None:
    """The bone of the scan; the camera goes round it in 48 frames."""
    scene = new_scene((0.20, 0.22, 0.26), 480, 480)
    head_phantom.write(HERE / SCAN, SAMPLES)
    volume = bpy.data.volumes.new("Head")
    own = volume.leapray
    own.file, own.automatic, own.threshold = f"//{SCAN}", False, head_phantom.BONE_AT
    volume.materials.append(material("Bone", IVORY))
    link(volume, "Head", turn=(0, 0, 180), scale=0.01)
    sun(2.4, (-0.6, -0.7, 0.8))
    camera((-2.4, -8.4, 1.4), (0, 0, 0), lens=100)
    table = scene.camera.parent = link(None, "Turntable")
    scene.frame_end = FRAMES
    bpy.context.preferences.edit.keyframe_new_interpolation_type = "LINEAR"
    for frame, angle in ((1, 0.0), (FRAMES + 1, 2 * math.pi)):
        table.rotation_euler.z = angle
        table.keyframe_insert("rotation_euler", index=2, frame=frame)
    scene.frame_set(1)


def film(name: str) -> bpy.types.Material:
    """Absorbs as X-rays are: nothing in air, the more the larger the CT value."""
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    tree = made.node_tree
    tree.nodes.clear()
    kinds = "Attribute", "MapRange", "VolumeAbsorption", "OutputMaterial"
    value, dense, absorb, leave = (tree.nodes.new(f"ShaderNode{kind}") for kind in kinds)
    value.attribute_name = "value"
    for end, number in (("From Min", -1000.0), ("From Max", 1500.0), ("To Max", 0.04)):
        dense.inputs[end].default_value = number
    absorb.inputs["Color"].default_value = (0, 0, 0, 1)
    tree.links.new(value.outputs["Fac"], dense.inputs["Value"])
    tree.links.new(dense.outputs[0], absorb.inputs["Density"])
    tree.links.new(absorb.outputs[0], leave.inputs["Volume"])
    return made


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


def make_cloud() -> None:
    volume = above_hills()
    volume.leapray.automatic, volume.leapray.threshold = False, 0.25
    volume.materials.append(material("Cloud", WHITE))


def make_fog() -> None:
    """The same fog as what it is: it scatters the sun's light until that leaves it."""
    volume = above_hills()
    volume.leapray.shown = "volume"
    volume.materials.append(mist("Mist"))
    scene = bpy.context.scene
    scene.leapray.volume_bounces = scene.cycles.volume_bounces = 8
    scene.leapray.samples = scene.cycles.samples = 64
    scene.cycles.max_bounces = scene.leapray.max_bounces
    scene.cycles.diffuse_bounces = 0


def mist(name: str) -> bpy.types.Material:
    """White droplets, so many that half a unit of them hides what is behind."""
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    tree = made.node_tree
    tree.nodes.clear()
    drops, leave = (
        tree.nodes.new(f"ShaderNode{kind}") for kind in ("VolumePrincipled", "OutputMaterial")
    )
    for socket, value in (("Color", (0.99, 0.99, 0.99, 1)), ("Density", 8.0)):
        drops.inputs[socket].default_value = value
    tree.links.new(drops.outputs[0], leave.inputs["Volume"])
    return made


def make_beam() -> None:
    """A box of thin fog around everything, in which the beam of a lamp is seen."""
    new_scene((0.004, 0.006, 0.01), 960, 540)
    link(plane("Floor", 24.0, material("Stone", (0.35, 0.33, 0.3))), "Floor")
    link(ball_mesh("Ball", material("Clay", CORAL)), "Ball", at=(0.4, 0, 1.1), scale=0.6)
    fog = bpy.data.materials.new("Fog")
    fog.use_nodes = True
    tree = fog.node_tree
    tree.nodes.clear()
    drops, leave = (
        tree.nodes.new(f"ShaderNode{kind}") for kind in ("VolumeScatter", "OutputMaterial")
    )
    drops.inputs["Color"].default_value = (0.9, 0.95, 1.0, 1)
    drops.inputs["Density"].default_value = 0.12
    drops.inputs["Anisotropy"].default_value = 0.3
    tree.links.new(drops.outputs[0], leave.inputs["Volume"])
    bpy.ops.mesh.primitive_cube_add(size=26.0)
    room = bpy.context.object
    room.name = "Room"
    room.data.materials.append(fog)
    lamp = bpy.data.lights.new("Lamp", "SPOT")
    lamp.energy, lamp.spot_size, lamp.spot_blend = 3000.0, 0.42, 0.2
    lamp.shadow_soft_size = 0.08
    spot = bpy.data.objects.new("Lamp", lamp)
    bpy.context.scene.collection.objects.link(spot)
    spot.location, spot.rotation_euler = (-4.2, 0.0, 4.0), (0.0, -1.0, 0.0)
    camera((0.3, -8.5, 1.8), (0.3, 0, 1.5), lens=40)
    scene = bpy.context.scene
    scene.leapray.samples = scene.cycles.samples = 64


def above_hills() -> bpy.types.Volume:
    """A new scene of hills under a sky, and the fog above them, which shows nothing yet."""
    new_scene((0.30, 0.46, 0.72), 960, 540)
    write_fog(HERE / FOG)
    volume = bpy.data.volumes.new("Cloud")
    volume.filepath = f"//{FOG}"
    link(volume, "Cloud", at=(0, 0, 2.3))
    hills = grid("Hills", 96, 96, hill, material("Leaf", LEAF))
    link(hills, "Hills")
    sun(3.0, (-0.5, -0.6, 0.7))
    camera((-1.5, -11.0, 2.4), (0, 0, 1.7), lens=50)
    return volume


def hill(u: float, v: float) -> tuple[float, float, float]:
    """A point of the hills, which rise away from the camera; u and v: 0 to 1."""
    x, y = 40 * (u - 0.5), 40 * v - 8
    rise = 0.5 * np.sin(0.9 * x + 0.3) * np.cos(0.7 * y) + 0.3 * np.sin(0.35 * x - 0.8 * y)
    return x, y, float(rise + 0.004 * max(y, 0.0) ** 2)


def write_fog(path: Path, voxel: float = 0.06) -> None:
    """A cumulus as a fog: round above, level below, and nothing around it."""
    bpy.utils.expose_bundled_modules()
    import openvdb

    rng = np.random.default_rng(1982)
    low, high = np.array((-3.0, -1.6, -0.9)), np.array((3.0, 1.6, 1.7))
    axes = [np.arange(a, b, voxel) for a, b in zip(low, high, strict=True)]
    x, y, z = np.meshgrid(*axes, indexing="ij", sparse=True)
    density = np.zeros(tuple(map(len, axes)), np.float32)
    for size, number in ((0.8, 7), (0.4, 50), (0.2, 260)):
        for _ in range(number):
            turn, far = rng.uniform(0, 2 * np.pi), np.sqrt(rng.uniform())
            a, b = 2.0 * far * np.cos(turn), 0.9 * far * np.sin(turn)
            c = rng.uniform(-0.4, 0.9) * (1 - far**2)
            square = (x - a) ** 2 + (y - b) ** 2 + (z - c) ** 2
            np.maximum(density, 1 - np.sqrt(square) / size, out=density)
    density *= np.clip(1 + (z + 0.45) / 0.3, 0, 1)  # level below
    density[density < 0.02] = 0
    fog = openvdb.FloatGrid()
    fog.copyFromArray(np.round(density, 3), tolerance=0.0)
    fog.name, fog.gridClass, fog.saveFloatAsHalf = "density", openvdb.GridClass.FOG_VOLUME, True
    fog.transform = openvdb.createLinearTransform(voxel)
    fog.transform.postTranslate(tuple(low))
    openvdb.write(str(path), grids=[fog])


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
