# SPDX-License-Identifier: GPL-3.0-or-later
"""What the sample scenes are put together from: scene, materials, meshes, lights, camera."""

from __future__ import annotations

import math

import bpy  # isort: skip  (first: the two below are in it)
import bmesh
from mathutils import Vector

# Linear reflectances.
WHITE = (0.80, 0.80, 0.78)
SAND = (0.62, 0.52, 0.40)
SLATE = (0.10, 0.13, 0.17)
CORAL = (0.80, 0.20, 0.12)
TEAL = (0.05, 0.38, 0.40)
OCHRE = (0.80, 0.46, 0.08)
LEAF = (0.14, 0.40, 0.06)
PLUM = (0.32, 0.08, 0.24)
STEEL = (0.42, 0.47, 0.53)
ENAMEL = (0.12, 0.46, 0.50)


def new_scene(
    world: tuple[float, float, float], width: int = 960, height: int = 540
) -> bpy.types.Scene:
    """An empty scene with LeapRay chosen; Cycles renders it with the light that both share."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "LEAPRAY"
    own = scene.leapray
    own.samples, own.noise_threshold, own.pixel_filter = 16, 0.0, "box"
    own.diffuse_bounces = 0
    scene.cycles.samples = 64
    scene.cycles.use_denoising = False
    scene.cycles.max_bounces = 0
    scene.cycles.pixel_filter_type = "BOX"
    scene.render.resolution_x, scene.render.resolution_y = width, height
    scene.view_settings.view_transform = "Standard"
    scene.world = bpy.data.worlds.new("World")
    scene.world.color = world
    scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (*world, 1.0)
    return scene


def material(name: str, color: tuple[float, float, float]) -> bpy.types.Material:
    """A diffuse material."""
    made = bpy.data.materials.new(name)
    made.diffuse_color = (*color, 1.0)
    made.use_nodes = True
    tree = made.node_tree
    tree.nodes.clear()
    bsdf = tree.nodes.new("ShaderNodeBsdfDiffuse")
    bsdf.inputs["Color"].default_value = (*color, 1.0)
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    output.location.x = 240
    tree.links.new(bsdf.outputs["BSDF"], output.inputs["Surface"])
    return made


def link(
    data: bpy.types.ID | None,
    name: str,
    *,
    at=(0, 0, 0),
    turn=(0, 0, 0),
    scale=(1, 1, 1),
    into=None,
):
    """Put an object with this data into the scene; angles in degrees, scale one number or three."""
    made = bpy.data.objects.new(name, data)
    made.location = at
    made.rotation_euler = [math.radians(angle) for angle in turn]
    made.scale = (scale,) * 3 if isinstance(scale, (int, float)) else scale
    (into or bpy.context.scene.collection).objects.link(made)
    return made


def mesh(name: str, build, paint: bpy.types.Material, *, smooth: bool = True) -> bpy.types.Mesh:
    """A mesh that `build(bm)` fills."""
    bm = bmesh.new()
    build(bm)
    bmesh.ops.recalc_face_normals(bm, faces=bm.faces)
    made = bpy.data.meshes.new(name)
    bm.to_mesh(made)
    bm.free()
    made.shade_smooth() if smooth else made.shade_flat()
    made.materials.append(paint)
    return made


def grid(name: str, nx: int, ny: int, place, paint) -> bpy.types.Mesh:
    """An open sheet of nx x ny faces; place(u, v) with 0 <= u, v <= 1 gives the points."""
    points = [place(i / nx, j / ny) for j in range(ny + 1) for i in range(nx + 1)]
    corner = lambda i, j: j * (nx + 1) + i  # noqa: E731
    faces = [
        (corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1))
        for j in range(ny)
        for i in range(nx)
    ]
    made = bpy.data.meshes.new(name)
    made.from_pydata(points, [], faces)
    made.shade_smooth()
    made.materials.append(paint)
    return made


def plane(name: str, size: float, paint) -> bpy.types.Mesh:
    half = size / 2
    made = bpy.data.meshes.new(name)
    made.from_pydata(
        [(-half, -half, 0), (half, -half, 0), (half, half, 0), (-half, half, 0)], [], [(0, 1, 2, 3)]
    )
    made.materials.append(paint)
    return made


def sun(energy: float, towards) -> None:
    """A sun without extent that stands in the direction `towards`."""
    data = bpy.data.lights.new("Sun", "SUN")
    data.energy = energy
    data.angle = 0.0
    ob = link(data, "Sun", at=Vector(towards).normalized() * 10)
    ob.rotation_euler = Vector(towards).to_track_quat("Z", "Y").to_euler()


def camera(
    at, look_at, *, lens: float = 50.0, width: float | None = None, clip_end: float = 200.0
) -> None:
    """The scene's camera; with a width it is orthographic and sees so many metres."""
    data = bpy.data.cameras.new("Camera")
    data.lens = lens
    data.clip_end = clip_end
    if width is not None:
        data.type = "ORTHO"
        data.ortho_scale = width
    made = link(data, "Camera", at=at)
    made.rotation_euler = (Vector(look_at) - Vector(at)).to_track_quat("-Z", "Y").to_euler()
    bpy.context.scene.camera = made


def subdivide(thing, levels: int) -> None:
    modifier = thing.modifiers.new("Subdivision", "SUBSURF")
    modifier.levels = modifier.render_levels = levels


def ball_mesh(name: str, paint) -> bpy.types.Mesh:
    """A sphere of radius 1 as a closed quad mesh of 1536 faces."""

    def build(bm):
        bmesh.ops.create_cube(bm, size=2.0)
        bmesh.ops.subdivide_edges(bm, edges=bm.edges, cuts=15, use_grid_fill=True)
        for vertex in bm.verts:
            # Equal angles between the grid's lines keep the quads alike.
            vertex.co = Vector([math.tan(c * math.pi / 4) for c in vertex.co]).normalized()

    return mesh(name, build, paint)
