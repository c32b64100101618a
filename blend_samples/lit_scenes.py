# SPDX-License-Identifier: GPL-3.0-or-later
"""The samples about light: bounced, refracted, reflected, and colours from images."""

from __future__ import annotations

import itertools
import math

import bpy  # isort: skip  (first: the two below are in it)
import bmesh
import numpy as np
from kit import ball_mesh, camera, grid, link, material, mesh, new_scene, plane, subdivide, sun
from mathutils import Matrix, Vector

WHITE = (0.73, 0.73, 0.73)
RED = (0.65, 0.05, 0.05)
GREEN = (0.12, 0.45, 0.15)
GOLD = (1.00, 0.71, 0.29)
COPPER = (0.95, 0.50, 0.36)
SILVER = (0.95, 0.93, 0.88)
FLOOR = (0.42, 0.32, 0.24)


def bounces(scene, *, total: int, diffuse: int, glossy: int = 4, transmission: int = 12) -> None:
    """How often light may bounce, for Cycles and for LeapRay alike."""
    for own in (scene.cycles, scene.leapray):
        own.max_bounces, own.diffuse_bounces = total, diffuse
        own.glossy_bounces, own.transmission_bounces = glossy, transmission


def shader(name: str, kind: str, color=(1, 1, 1), **inputs) -> bpy.types.Material:
    """A material of one shader node; inputs by name, _ for blanks."""
    made = material(name, color)
    tree = made.node_tree
    tree.nodes.remove(tree.nodes["Diffuse BSDF"])
    node = tree.nodes.new(f"ShaderNode{kind}")
    base = "Base Color" if "Base Color" in node.inputs else "Color"
    node.inputs[base].default_value = (*color, 1.0)
    for each, value in inputs.items():
        node.inputs[each.replace("_", " ")].default_value = value
    if hasattr(node, "distribution"):
        node.distribution = "MULTI_GGX"
    tree.links.new(node.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    return made


def area(name: str, watts: float, at, look_at, size: float, across: float, shape="RECTANGLE"):
    data = bpy.data.lights.new(name, "AREA")
    data.energy, data.shape, data.size, data.size_y = watts, shape, size, across
    ob = link(data, name, at=at)
    ob.rotation_euler = (Vector(at) - Vector(look_at)).to_track_quat("Z", "Y").to_euler()
    return ob


def box(name: str, size, paint, *, at=(0, 0, 0), turn=(0, 0, 0)):
    """A box that stands on the height of `at`."""
    shift = Matrix.Translation((0, 0, size[2] / 2)) @ Matrix.Diagonal((*size, 1))
    made = mesh(
        name, lambda bm: bmesh.ops.create_cube(bm, size=1.0, matrix=shift), paint, smooth=False
    )
    return link(made, name, at=at, turn=turn)


def lathe(name: str, profile, paint, *, around: int = 96) -> bpy.types.Mesh:
    """A closed solid: points (radius, height) from the axis to the axis, turned about z."""
    profile = np.asarray(profile, float)

    def build(bm):
        angles = np.linspace(0, 2 * math.pi, around, endpoint=False)
        rows = []
        for radius, height in profile:
            if radius == 0:
                rows.append([bm.verts.new((0, 0, height))] * around)
            else:
                rows.append(
                    [bm.verts.new((radius * math.cos(a), radius * math.sin(a), height))
                     for a in angles]
                )  # fmt: skip
        for below, above in itertools.pairwise(rows):
            for i in range(around):
                j = (i + 1) % around
                corners = dict.fromkeys((below[i], below[j], above[j], above[i]))
                if len(corners) > 2:
                    bm.faces.new(corners)

    return mesh(name, build, paint)


def rounded(points, radius: float, steps: int = 6) -> list[tuple[float, float]]:
    """A polyline whose inner corners are arcs, as tangent parabolas."""
    points = [np.asarray(p, float) for p in points]
    out = [tuple(points[0])]
    for before, corner, after in zip(points, points[1:], points[2:], strict=False):
        arms = [p - corner for p in (before, after)]
        cut = min(radius, *(0.45 * np.linalg.norm(arm) for arm in arms))
        start, end = (corner + arm / np.linalg.norm(arm) * cut for arm in arms)
        for t in np.linspace(0, 1, steps):
            out.append(tuple((1 - t) ** 2 * start + 2 * t * (1 - t) * corner + t**2 * end))
    return [*out, tuple(points[-1])]


# ---- scenes ------------------------------------------------------------------


def make_cornell() -> None:
    """After the box of Goral and others, 1984; 5.5 m wide, open towards the camera."""
    scene = new_scene((0, 0, 0), 640, 640)
    bounces(scene, total=4, diffuse=4)
    half, deep, high = 2.75, 2.8, 5.5
    corners = [(x, y, z) for z in (0, high) for y in (-deep, deep) for x in (-half, half)]
    walls = {  # wound so that they face the room
        (0, 1, 3, 2): 0,
        (4, 6, 7, 5): 0,
        (2, 3, 7, 6): 0,
        (0, 2, 6, 4): 1,
        (1, 5, 7, 3): 2,
    }
    room = bpy.data.meshes.new("Room")
    room.from_pydata(corners, [], list(walls))
    for paint in (material("White", WHITE), material("Red", RED), material("Green", GREEN)):
        room.materials.append(paint)
    for face, slot in zip(room.polygons, walls.values(), strict=True):
        face.material_index = slot
    link(room, "Room")
    white = bpy.data.materials["White"]
    box("Tall box", (1.65, 1.65, 3.3), white, at=(-0.95, 0.75, 0), turn=(0, 0, 18))
    box("Short box", (1.65, 1.65, 1.65), white, at=(0.95, -0.95, 0), turn=(0, 0, -17))
    area("Ceiling light", 180.0, (0, 0, high - 0.02), (0, 0, 0), 1.3, 1.3)
    camera((0, -10.6, 2.75), (0, 0, 2.75), lens=48)


def make_still() -> None:
    scene = new_scene((0.35, 0.42, 0.52))
    bounces(scene, total=16, diffuse=0, glossy=8, transmission=16)
    table = box("Table", (9, 6, 0.3), material("Wood", FLOOR), at=(0, 0, -0.3))
    table.modifiers.new("Bevel", "BEVEL").width = 0.04

    clear = shader("Glass", "BsdfGlass", IOR=1.5)
    frosted = shader("Frosted glass", "BsdfGlass", (0.92, 0.97, 1.0), IOR=1.45, Roughness=0.25)
    amber = shader("Amber", "BsdfGlass", IOR=1.54)
    tree = amber.node_tree
    absorb = tree.nodes.new("ShaderNodeVolumeAbsorption")
    absorb.inputs["Color"].default_value = (0.95, 0.55, 0.10, 1)
    absorb.inputs["Density"].default_value = 2.0
    tree.links.new(absorb.outputs[0], tree.nodes["Material Output"].inputs["Volume"])

    def ball(name, paint, at, size):
        made = link(ball_mesh(name, paint), name, at=at, scale=size)
        subdivide(made, 2)

    ball("Glass ball", clear, (-1.75, -0.75, 0.6), 0.6)
    ball("Amber ball", amber, (0.62, -1.25, 0.32), 0.32)
    ball("Frosted ball", frosted, (1.95, -0.85, 0.45), 0.45)
    gold = shader("Gold", "BsdfPrincipled", GOLD, Metallic=1.0, Roughness=0.28)
    ball("Gold ball", gold, (-0.35, -1.15, 0.36), 0.36)
    silver = shader("Mirror", "BsdfGlossy", SILVER, Roughness=0.0)
    ball("Mirror ball", silver, (1.05, 0.75, 0.95), 0.95)

    inner = [(0.0, 0.16), (0.40, 0.16), (0.47, 1.30)]
    outer = [(0.53, 1.30), (0.46, 0.0), (0.0, 0.0)]
    tumbler = lathe("Tumbler", rounded([*inner, *outer], 0.05), clear)
    link(tumbler, "Tumbler", at=(-0.55, 0.35, 0))
    vase = [(0, 0.06), (0.42, 0.06), (0.60, 0.60), (0.22, 1.25), (0.36, 1.62)]
    vase += [(0.42, 1.60), (0.29, 1.25), (0.67, 0.60), (0.48, 0.0), (0, 0)]
    copper = shader("Copper", "BsdfPrincipled", COPPER, Metallic=1.0, Roughness=0.12)
    link(lathe("Vase", rounded(vase, 0.25, 10), copper), "Vase", at=(-2.55, 0.75, 0))
    plastic = shader("Plastic", "BsdfPrincipled", (0.55, 0.03, 0.04), Roughness=0.15)
    ring = rounded([(0.0, 0.10), (0.7, 0.10), (0.78, 0.22), (0.86, 0.0), (0.0, 0.0)], 0.06)
    link(lathe("Dish", ring, plastic), "Dish", at=(2.75, 0.45, 0))

    area("Window", 420.0, (-3.8, -2.6, 4.2), (0, 0, 0.4), 1.6, 2.4)
    area("Lamp", 160.0, (4.0, -1.0, 3.0), (0.4, 0, 0.4), 0.9, 0.9, "DISK")
    camera((0.1, -8.6, 2.7), (0.06, 0, 0.70), lens=48)


def picture(name: str, pixels: np.ndarray) -> bpy.types.Image:
    """An image of these sRGB colours (h, w, 3), 0..1, packed into the file as PNG."""
    high, wide = pixels.shape[:2]
    made = bpy.data.images.new(name, wide, high)
    rgba = np.ones((high, wide, 4), np.float32)
    rgba[..., :3] = pixels
    made.pixels.foreach_set(rgba.ravel())
    made.pack()
    return made


def checks(size: int, across: int, first, second) -> np.ndarray:
    """A board of across x across squares."""
    cell = np.arange(size) * across // size
    odd = (cell[:, None] + cell[None, :]) % 2
    return np.where(odd[..., None] == 1, first, second)


def globe(size: int) -> np.ndarray:
    """Seas, lands and a grid of meridians, from a few waves of fixed phases."""
    v, u = np.mgrid[:size, : 2 * size] / (size, 2 * size)[0]
    u, v = u / 2 * 2 * math.pi, v * math.pi
    rng = np.random.default_rng(1994)
    x, y, z = np.sin(v) * np.cos(u), np.sin(v) * np.sin(u), np.cos(v)
    height = np.zeros_like(u)
    for wave in range(1, 7):
        for _ in range(3):
            a, b, c = rng.normal(size=3) * wave * 1.4
            height += np.sin(a * x + b * y + c * z + rng.uniform(0, 7)) / wave
    sea, land, snow = (0.09, 0.28, 0.55), (0.33, 0.55, 0.20), (0.93, 0.94, 0.96)
    colors = np.where((height > 0.35)[..., None], land, sea)
    colors = np.where((np.abs(z) > 0.9 + 0.03 * height)[..., None], snow, colors)
    lines = np.minimum(np.abs(np.sin(u * 6)) * np.sin(v), np.abs(np.sin(v * 6))) < 0.03
    return np.where(lines[..., None], (0.95, 0.85, 0.35), colors)


def painted_by(name: str, image: bpy.types.Image, *, scale: float = 1.0, turn: float = 0.0, **more):
    """A Principled material whose base colour is an image, by UV and a Mapping."""
    made = shader(name, "BsdfPrincipled", **{"Roughness": 0.5, "Specular_IOR_Level": 0.0, **more})
    tree = made.node_tree
    texture, mapping, place = (
        tree.nodes.new(f"ShaderNode{kind}") for kind in ("TexImage", "Mapping", "TexCoord")
    )
    texture.image = image
    mapping.inputs["Scale"].default_value = (scale, scale, 1)
    mapping.inputs["Rotation"].default_value = (0, 0, math.radians(turn))
    tree.links.new(place.outputs["UV"], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs["Vector"], texture.inputs["Vector"])
    base = tree.nodes["Principled BSDF"].inputs["Base Color"]
    tree.links.new(texture.outputs["Color"], base)
    return made


def uvs(made: bpy.types.Mesh, place) -> None:
    """A UV map; place(points of a face's corners (n, 3)) gives (n, 2)."""
    layer = made.uv_layers.new(name="UVMap")
    for face in made.polygons:
        points = np.array([made.vertices[v].co for v in face.vertices])
        for at, uv in zip(face.loop_indices, place(points), strict=True):
            layer.uv[at].vector = uv


def make_textured() -> None:
    scene = new_scene((0.38, 0.44, 0.52))
    bounces(scene, total=8, diffuse=0)
    board = picture("Board", checks(256, 8, (0.86, 0.82, 0.74), (0.30, 0.22, 0.18)))
    floor = plane("Floor", 16.0, painted_by("Tiles", board, scale=4.0, turn=20.0))
    uvs(floor, lambda p: p[:, :2] / 16 + 0.5)
    link(floor, "Floor")

    earth = ball_mesh("Globe", painted_by("Map", picture("Map", globe(256)), Roughness=0.35))

    def by_angle(p):
        u = np.arctan2(p[:, 1], p[:, 0]) / (2 * math.pi) + 0.5
        middle = math.atan2(p[:, 1].mean(), p[:, 0].mean()) / (2 * math.pi) + 0.5
        u += np.round(middle - u)  # no face spans the seam
        u = np.where(np.hypot(p[:, 0], p[:, 1]) < 1e-6, middle, u)
        return np.stack([u, np.arccos(np.clip(-p[:, 2], -1, 1)) / math.pi], axis=1)

    uvs(earth, by_angle)
    ball = link(earth, "Globe", at=(-1.35, 0.2, 1.15), turn=(0, -18, 205), scale=1.15)
    subdivide(ball, 2)

    crate = picture("Crate", crate_side(128))
    cube = box("Crate", (1.5, 1.5, 1.5), painted_by("Crate", crate), at=(1.35, 0.7, 0)).data
    uvs(cube, lambda p: np.float32([(0, 0), (1, 0), (1, 1), (0, 1)]))
    bpy.data.objects["Crate"].rotation_euler.z = math.radians(28)

    # Vertex colours on a twisted ribbon, a sheet that is seen from both sides.
    def ribbon(u, v):
        angle = 2.2 * math.pi * u
        x, y = 0.28 * (v - 0.5) * math.cos(angle), 0.28 * (v - 0.5) * math.sin(angle)
        return 4.2 * (u - 0.5), -1.35 + y + 0.25 * math.sin(5 * u), 0.45 + x

    paint = shader("Paint", "BsdfDiffuse")
    strip = grid("Ribbon", 96, 6, ribbon, paint)
    colors = strip.color_attributes.new("Rainbow", "FLOAT_COLOR", "POINT")
    hue = np.linspace(0, 1, 97).repeat(7).reshape(97, 7).T.ravel()
    wheel = np.clip(np.abs((hue[:, None] * 6 + (0, 4, 2)) % 6 - 3) - 1, 0.02, 0.9)
    colors.data.foreach_set("color", np.c_[wheel, np.ones(len(hue))].astype(np.float32).ravel())
    tree = paint.node_tree
    node = tree.nodes.new("ShaderNodeVertexColor")
    node.layer_name = "Rainbow"
    tree.links.new(node.outputs["Color"], tree.nodes["Diffuse BSDF"].inputs["Color"])
    link(strip, "Ribbon", turn=(0, 0, -6))
    sun(2.2, (-0.6, -0.7, 0.9))
    camera((0.0, -8.2, 2.9), (0.05, 0, 0.85), lens=52)


def crate_side(size: int) -> np.ndarray:
    """Boards in a frame, with the letters of a stencil left to the reader."""
    y, x = np.mgrid[:size, :size] / size
    rng = np.random.default_rng(7)
    board = np.floor(y * 5).astype(int)
    shade = rng.uniform(0.8, 1.0, 5)[board] * (1 - 0.08 * np.sin(60 * x + 9 * board) ** 2)
    frame = (np.minimum(np.minimum(x, 1 - x), np.minimum(y, 1 - y)) < 0.1) | (np.abs(x - y) < 0.06)
    gap = (np.abs(y * 5 - np.round(y * 5)) < 0.05) & ~frame
    colors = np.float64((0.72, 0.52, 0.32)) * shade[..., None]
    colors = np.where(frame[..., None], np.float64((0.55, 0.37, 0.21)), colors)
    return np.where(gap[..., None], 0.12, colors)


def make_metal() -> None:
    """Metals from polished to dull under lights and a sky of one colour."""
    scene = new_scene((0.32, 0.38, 0.46))
    bounces(scene, total=12, diffuse=0, glossy=8)
    link(plane("Floor", 30.0, material("Floor", (0.34, 0.33, 0.32))), "Floor")
    for row, (metal, color) in enumerate((("Gold", GOLD), ("Copper", COPPER), ("Silver", SILVER))):
        for k, rough in enumerate((0.1, 0.25, 0.4, 0.6, 0.85)):
            name = f"{metal} {rough}"
            paint = shader(name, "BsdfPrincipled", color, Metallic=1.0, Roughness=rough)
            at = (1.3 * (k - 2), 1.35 * (row - 1), 0.5)
            if row == 1:
                ring = rounded([(0, 0.62), (0.5, 0.62), (0.5, 0), (0, 0)], 0.12, 8)
                link(lathe(name, ring, paint), name, at=(*at[:2], 0))
            else:
                subdivide(link(ball_mesh(name, paint), name, at=at, scale=0.5), 2)
    area("Window", 500.0, (-4.5, -3.0, 4.5), (0, 0, 0.4), 1.8, 2.6)
    area("Lamp", 200.0, (4.5, -2.0, 3.2), (0, 0, 0.4), 1.0, 1.0, "DISK")
    camera((0.0, -9.6, 3.9), (0, -0.1, 0.42), lens=48)


def make_glass() -> None:
    """Glass: solid, hollow, frosted, tinted, within glass, and a prism with edges."""
    scene = new_scene((0.42, 0.48, 0.55))
    bounces(scene, total=24, diffuse=0, glossy=12, transmission=24)
    board = picture("Board", checks(256, 16, (0.80, 0.78, 0.74), (0.10, 0.16, 0.24)))
    floor = plane("Floor", 12.0, painted_by("Tiles", board, scale=1.0, turn=15.0))
    uvs(floor, lambda p: p[:, :2] / 12 + 0.5)
    link(floor, "Floor")
    clear = shader("Glass", "BsdfGlass", IOR=1.5)
    for name, x, paint in (
        ("Clear", -2.4, clear),
        ("Frosted", 0.0, shader("Frosted", "BsdfGlass", IOR=1.45, Roughness=0.2)),
        ("Tinted", 2.4, shader("Tinted", "BsdfGlass", (0.55, 0.90, 0.70), IOR=1.6)),
    ):
        subdivide(link(ball_mesh(name, paint), name, at=(x, 0.9, 0.75), scale=0.75), 2)
    shell = bmesh.new()
    shell.from_mesh(ball_mesh("Shell", clear))
    shell.from_mesh(ball_mesh("Cavity", clear))
    shell.faces.ensure_lookup_table()
    cavity = shell.faces[len(shell.faces) // 2 :]
    bmesh.ops.reverse_faces(shell, faces=cavity)
    bmesh.ops.scale(shell, vec=(0.8,) * 3, verts=list({v for f in cavity for v in f.verts}))
    made = bpy.data.meshes["Shell"]
    shell.to_mesh(made)
    shell.free()
    subdivide(link(made, "Shell", at=(-1.2, -0.9, 0.62), scale=0.6), 2)
    subdivide(link(ball_mesh("Kernel", clear), "Kernel", at=(-1.2, -0.9, 0.62), scale=0.25), 2)
    cup = [(0.0, 0.12), (0.40, 0.12), (0.46, 1.00), (0.54, 1.00), (0.47, 0.0), (0.0, 0.0)]
    link(lathe("Cup", rounded(cup, 0.05), clear), "Cup", at=(2.6, -0.9, 0.01))
    box("Prism", (0.8, 0.8, 0.8), clear, at=(0.75, -1.1, 0.01), turn=(0, 0, 32))
    area("Window", 500.0, (-3.8, -2.6, 4.6), (0, 0, 0.4), 1.6, 2.4)
    camera((0.0, -8.8, 3.6), (0.08, -0.05, 0.5), lens=48)


def make_mirrors() -> None:
    scene = new_scene((0.30, 0.34, 0.40))
    bounces(scene, total=32, diffuse=0, glossy=32)
    mirror = shader("Mirror", "BsdfGlossy", (0.92, 0.95, 0.94), Roughness=0.0)
    frame = material("Frame", (0.35, 0.20, 0.08))
    for side, y in (("Front", -3.0), ("Back", 3.0)):
        box(f"{side} mirror", (9.0, 0.10, 3.0), mirror, at=(0, y, 0.12))
        box(f"{side} frame", (9.4, 0.30, 0.12), frame, at=(0, y, 0))
    link(plane("Floor", 40.0, material("Floor", (0.46, 0.44, 0.40))), "Floor")
    for k, (name, color) in enumerate(
        (("Red", (0.75, 0.10, 0.07)), ("Blue", (0.06, 0.18, 0.55)), ("Yellow", (0.80, 0.55, 0.05)))
    ):
        made = link(
            ball_mesh(f"{name} ball", material(name, color)),
            f"{name} ball",
            at=(1.7 * (k - 1), 0.9 * math.cos(2.2 * k), 0.55),
            scale=0.55,
        )
        subdivide(made, 2)
    sun(2.4, (-0.5, -0.55, 0.9))
    camera((-1.5, -2.8, 1.9), (0.15, 3.0, 0.75), lens=24)
