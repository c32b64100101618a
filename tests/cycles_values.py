# SPDX-License-Identifier: GPL-3.0-or-later
"""Values of shader nodes as Cycles has them: each on a square of its own, in one picture."""

import bpy
import numpy as np
from blender_scenes import combined, fresh, nodes_of, put

from addon.blender import open_file

SHIFT = 10.0  # so that negative values show


def emitter(build, shift=SHIFT):
    """A material that emits the socket that build(tree) gives, with `shift` added."""
    made = bpy.data.materials.new("Emitter")
    tree = nodes_of(made)
    tree.nodes.clear()
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    emission = tree.nodes.new("ShaderNodeEmission")
    tree.links.new(emission.outputs[0], output.inputs["Surface"])
    last = build(tree)
    if shift:
        add = tree.nodes.new("ShaderNodeVectorMath")
        add.inputs[1].default_value = (shift,) * 3
        tree.links.new(last, add.inputs[0])
        last = add.outputs[0]
    tree.links.new(last, emission.inputs["Color"])
    return made


def wall(materials):
    """Squares of 1 m with UVs 0..1 and a material each, by rows from below. Columns and rows."""
    n = len(materials)
    columns = max(4, int(np.ceil(np.sqrt(n))))  # the least resolution is 4
    rows = max(4, -(-n // columns))
    corners, faces = [], []
    for k in range(n):
        j, i = divmod(k, columns)
        faces.append(tuple(range(4 * k, 4 * k + 4)))
        corners += [(i, j, 0), (i + 1, j, 0), (i + 1, j + 1, 0), (i, j + 1, 0)]
    mesh = bpy.data.meshes.new("Wall")
    mesh.from_pydata(corners, [], faces)
    for material in materials:
        mesh.materials.append(material)
    mesh.polygons.foreach_set("material_index", np.arange(n, dtype=np.int32))
    uvs = mesh.uv_layers.new(name="UVMap")
    uvs.uv.foreach_set("vector", np.tile(np.float32([0, 0, 1, 0, 1, 1, 0, 1]), n))
    put("Wall", mesh)
    return columns, rows


def picture(materials, side):
    """(n, side, side, 3): the squares by Cycles, at the middles of side x side pixels each."""
    columns, rows = wall(materials)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = columns * side, rows * side
    scene.render.resolution_percentage = 100
    scene.cycles.samples = 1
    scene.cycles.use_denoising = scene.cycles.use_adaptive_sampling = False
    scene.cycles.pixel_filter_type, scene.cycles.filter_width = "BLACKMAN_HARRIS", 0.01
    camera = scene.camera
    camera.data.type, camera.data.ortho_scale = "ORTHO", max(columns, rows)
    camera.location = columns / 2, rows / 2, 10
    with open_file.quiet():
        bpy.ops.render.render()
    whole = combined(scene)[..., :3].reshape(rows, side, columns, side, 3)
    squares = whole.transpose(0, 2, 1, 3, 4).reshape(rows * columns, side, side, 3)
    scene.render.engine = "LEAPRAY"
    return squares[: len(materials)]


def values(builds, shift=SHIFT):
    """(n, 3): what Cycles makes of the sockets that builds make in trees of their own."""
    fresh()
    return picture([emitter(build, shift) for build in builds], 1)[:, 0, 0].astype(float) - shift


def middles(side):
    """(side * side, 2): UVs at the middles of a square's pixels, by rows from below."""
    at = (np.arange(side) + 0.5) / side
    return np.stack(np.meshgrid(at, at), -1).reshape(-1, 2).astype(np.float32)
