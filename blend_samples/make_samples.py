# SPDX-License-Identifier: GPL-3.0-or-later
"""Make the sample scenes of this folder.

    python blend_samples/make_samples.py [NAME ...]

Run it with Blender's wheel (or `blender -b -P`), in the oldest Blender that is supported: newer
ones open its files. What is large (subdivision, scattering) is left to modifiers, so that each file
stays small. The files choose LeapRay, and Cycles gets the same light. The first six are about
shape: diffuse surfaces, one sun without extent, a world of one colour, no bounced light. Those of
lit_scenes.py are about light.

sphere    one ball
suzanne   Suzanne, subdivided, on a floor of 100 m
gallery   instances from 3 m down to 2 cm: mirrored, squeezed, nested in collections, scattered by
          geometry nodes
cad       a closed part with holes and creases, seen by an orthographic camera
thin      open and thin things: paper, a grid of wires, leaves
lowpoly   meshes of few faces as Blender makes them, smooth and flat: Suzanne, ball, ring, cylinder
cornell   a box with coloured walls under a square light; light bounces
still     glass and metal, clear and rough, under a sky with two windows
textured  images and vertex colours, on solids and on sheets
mirrors   a hall between two mirrors
metal     metals from polished to dull
glass     glass: solid, hollow, frosted, tinted, within glass
head      a scan beside the file: bone under skin that shows it
xray      the same scan without a surface, as X-rays see it
turntable the bone of that scan, round which the camera goes in 48 frames
labels    the label map of that scan, cut open
gyroid    a field that geometry nodes make, among meshes
cloud     a fog of OpenVDB as a surface, above hills
beam      a spot light in a room of fog
fog       the same fog without a surface, lit by the sun
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import bpy  # isort: skip  (first: the two below are in it)
import bmesh
import numpy as np
from mathutils import Matrix, Vector

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
sys.path[:0] = [str(HERE), str(ROOT), str(ROOT / "native")]  # `blender -P` does not

from kit import (  # noqa: E402
    CORAL,
    ENAMEL,
    LEAF,
    OCHRE,
    PLUM,
    SAND,
    SLATE,
    STEEL,
    TEAL,
    WHITE,
    ball_mesh,
    camera,
    grid,
    link,
    material,
    mesh,
    new_scene,
    plane,
    subdivide,
    sun,
)
from lit_scenes import (  # noqa: E402
    make_cornell,
    make_glass,
    make_metal,
    make_mirrors,
    make_still,
    make_textured,
)
from volume_scenes import (  # noqa: E402
    make_beam,
    make_cloud,
    make_fog,
    make_gyroid,
    make_head,
    make_labels,
    make_turntable,
    make_xray,
)

import addon  # noqa: E402


def make_sphere() -> None:
    new_scene((0.30, 0.42, 0.55))
    ball = link(ball_mesh("Ball", material("Coral", CORAL)), "Ball")
    subdivide(ball, 2)
    cast = ball.modifiers.new("Round", "CAST")
    cast.factor, cast.radius, cast.use_radius_as_size, cast.size = 1.0, 0.0, False, 1.0
    sun(2.6, (-0.6, -0.7, 0.9))
    camera((0, -6, 1.2), (0, 0, 0), lens=54)


def make_suzanne() -> None:
    new_scene((0.16, 0.22, 0.30))

    head = mesh("Suzanne", lambda bm: bmesh.ops.create_monkey(bm), material("Ochre", OCHRE))
    # She leans back a little and looks at us; her lowest point is on the floor.
    suzanne = link(head, "Suzanne", turn=(-18, 0, 28))
    subdivide(suzanne, 3)
    bpy.context.view_layer.update()
    evaluated = suzanne.evaluated_get(bpy.context.evaluated_depsgraph_get())
    lowest = min((evaluated.matrix_world @ v.co).z for v in evaluated.data.vertices)
    suzanne.location.z -= lowest
    link(plane("Floor", 100.0, material("Sand", SAND)), "Floor")
    sun(2.7, (0.75, -0.70, 0.80))
    camera((0.2, -8.4, 2.0), (-0.10, 0, 0.90), lens=77)


def make_gallery() -> None:
    scene = new_scene((0.30, 0.36, 0.44))
    colors = [CORAL, TEAL, OCHRE, PLUM, STEEL, LEAF]
    paints = [material(f"Paint {k}", color) for k, color in enumerate(colors)]
    link(plane("Floor", 60.0, material("Stone", WHITE)), "Floor")

    def ring(bm):
        around, across = 64, 28
        rows = [
            [
                bm.verts.new(
                    (
                        (0.72 + 0.28 * math.cos(b)) * math.cos(a),
                        (0.72 + 0.28 * math.cos(b)) * math.sin(a),
                        0.28 * math.sin(b),
                    )
                )
                for b in np.linspace(0, 2 * math.pi, across, endpoint=False)
            ]
            for a in np.linspace(0, 2 * math.pi, around, endpoint=False)
        ]
        for i in range(around):
            for j in range(across):
                k, m = (i + 1) % around, (j + 1) % across
                bm.faces.new((rows[i][j], rows[k][j], rows[k][m], rows[i][m]))

    shapes = {
        "Ring": mesh("Ring", ring, paints[0]),
        "Ball": ball_mesh("Ball", paints[1]),
        "Cone": mesh(
            "Cone",
            lambda bm: bmesh.ops.create_cone(
                bm,
                cap_ends=True,
                segments=96,
                radius1=0.8,
                radius2=0.0,
                depth=1.8,
                matrix=Matrix.Translation((0, 0, 0.9)),
            ),
            paints[2],
            smooth=False,
        ),
        "Gem": mesh(
            "Gem",
            lambda bm: bmesh.ops.create_icosphere(bm, subdivisions=2, radius=1.0),
            paints[3],
            smooth=False,
        ),
        "Block": mesh(
            "Block", lambda bm: bmesh.ops.create_cube(bm, size=1.0), paints[4], smooth=False
        ),
    }

    # A group that is placed whole: as it is, mirrored, squeezed, small.
    group = bpy.data.collections.new("Group")
    link(shapes["Block"], "Pedestal", at=(0, 0, 0.5), scale=(1.2, 1.2, 1.0), into=group)
    link(shapes["Ring"], "Ring", at=(0, 0, 1.72), turn=(68, 0, 25), scale=0.75, into=group)
    link(shapes["Ball"], "Ball", at=(0.02, 0.02, 1.72), scale=0.27, into=group)
    link(shapes["Gem"], "Gem", at=(1.0, -0.35, 0.25), turn=(15, 20, 0), scale=0.25, into=group)
    link(shapes["Cone"], "Cone", at=(-0.95, -0.45, 0.0), scale=(0.28, 0.28, 0.5), into=group)

    def place(name, at, turn_z, scale):
        empty = link(None, name, at=at, turn=(0, 0, turn_z), scale=scale)
        empty.instance_type = "COLLECTION"
        empty.instance_collection = group

    place("As it is", (0.0, 0.0, 0), 0, 1.0)
    place("Mirrored", (-3.3, 0.6, 0), 10, (-1.0, 1.0, 1.0))
    place("Tall", (3.3, 0.7, 0), -12, (0.8, 0.8, 1.35))
    place("Small", (1.75, -1.75, 0), 25, 0.42)
    place("Smaller", (2.75, -2.15, 0), -15, 0.18)
    place("Smallest", (3.2, -2.35, 0), 30, 0.08)
    place("Far", (-6.2, 12.0, 0), 20, (1.7, -1.7, 1.7))

    # Single objects from 3 m down to 2 cm on a spiral.
    link(shapes["Ball"], "Big ball", at=(7.5, 11.5, 3.0), scale=(3.0, 3.0, 3.0))
    link(shapes["Ball"], "Egg", at=(-2.05, -1.55, 0.55), turn=(0, 24, 40), scale=(0.36, 0.36, 0.58))
    names = ["Ball", "Gem", "Ring", "Cone"]
    for k in range(26):
        angle, radius = 0.42 * k, 3.1 * 0.955**k
        size = 0.34 * 0.9**k
        at = (
            -2.1 + 0.62 * radius * math.cos(angle) * 0.75,
            -2.35 + 0.5 * radius * math.sin(angle) * 0.6,
            size,
        )
        shape = names[k % 4]
        if shape == "Cone":
            at = (*at[:2], 0.0)
        elif shape == "Ring":
            at = (*at[:2], 0.28 * size)
        if (Vector(at) - Vector((-2.05, -1.55, 0.55))).length > 0.75:
            link(shapes[shape], f"{shape} {k}", at=at, turn=(0, 0, 33 * k), scale=size)

    scatter_pebbles(shapes["Gem"], paints[5])
    sun(2.4, (-0.7, -0.62, 0.85))
    camera((0.5, -13.5, 4.3), (0.35, 0.0, 1.0), lens=42)
    scene.render.resolution_x, scene.render.resolution_y = 960, 540


def scatter_pebbles(shape: bpy.types.Mesh, paint) -> None:
    """Geometry nodes: a strip with stones of 2 to 10 cm, each turned and squeezed."""
    stone = shape.copy()
    stone.name = "Pebble"
    stone.materials[0] = paint
    hidden = bpy.data.collections.new("Parts")
    original = link(stone, "Pebble", into=hidden)

    tree = bpy.data.node_groups.new("Scatter", "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    node = tree.nodes.new
    enter, leave = node("NodeGroupInput"), node("NodeGroupOutput")
    points, instances = (
        node("GeometryNodeDistributePointsOnFaces"),
        node("GeometryNodeInstanceOnPoints"),
    )
    points.inputs["Density"].default_value = 26.0
    points.inputs["Seed"].default_value = 4
    source = node("GeometryNodeObjectInfo")
    source.inputs["Object"].default_value = original
    turn, size = node("FunctionNodeRandomValue"), node("FunctionNodeRandomValue")
    for random, low, high in (
        (turn, (0, 0, 0), (6.28, 6.28, 6.28)),
        (size, (0.02, 0.02, 0.02), (0.09, 0.06, 0.05)),
    ):
        random.data_type = "FLOAT_VECTOR"
        random.inputs[0].default_value, random.inputs[1].default_value = low, high
    links = tree.links.new
    links(enter.outputs[0], points.inputs["Mesh"])
    links(points.outputs["Points"], instances.inputs["Points"])
    links(source.outputs["Geometry"], instances.inputs["Instance"])
    links(turn.outputs[0], instances.inputs["Rotation"])
    links(size.outputs[0], instances.inputs["Scale"])
    links(instances.outputs["Instances"], leave.inputs[0])

    half = Vector((3.6, 0.42, 0))
    strip = bpy.data.meshes.new("Strip")
    strip.from_pydata(
        [(-half.x, -half.y, 0), (half.x, -half.y, 0), (half.x, half.y, 0), (-half.x, half.y, 0)],
        [],
        [(0, 1, 2, 3)],
    )
    bed = link(strip, "Pebbles", at=(0.3, -4.15, 0.03), turn=(0, 0, 3))
    bed.modifiers.new("Scatter", "NODES").node_group = tree


def make_cad() -> None:
    new_scene((0.52, 0.54, 0.56), 960, 720)
    steel = material("Enamel", ENAMEL)

    def body(name, size, at):
        return link(
            mesh(
                name,
                lambda bm: bmesh.ops.create_cube(bm, size=1.0, matrix=Matrix.Diagonal((*size, 1))),
                steel,
                smooth=False,
            ),
            name,
            at=at,
        )

    def rod(name, radius, length, at, turn=(0, 0, 0), radius2=None, segments=128):
        return link(
            mesh(
                name,
                lambda bm: bmesh.ops.create_cone(
                    bm,
                    cap_ends=True,
                    segments=segments,
                    radius1=radius,
                    radius2=radius if radius2 is None else radius2,
                    depth=length,
                ),
                steel,
                smooth=False,
            ),
            name,
            at=at,
            turn=turn,
        )

    # A bearing bracket: foot, upright with a round head, rib, bore, four countersunk holes.
    part = body("Bracket", (8.0, 5.0, 1.0), (0, 0, 0.5))
    add = [
        body("Upright", (4.0, 1.4, 3.2), (0, 1.2, 2.4)),
        rod("Head", 2.0, 1.4, (0, 1.2, 4.0), (90, 0, 0)),
        rod("Boss", 1.45, 2.3, (0, 1.0, 4.0), (90, 0, 0)),
    ]
    rib = mesh("Rib", lambda bm: wedge(bm, 0.7, 3.1, 2.35), steel, smooth=False)
    add.append(link(rib, "Rib", at=(0, 0.9, 0.7)))
    cut = [rod("Bore", 0.95, 4.0, (0, 1.0, 4.0), (90, 0, 0))]
    for x in (-3.0, 3.0):
        for y in (-1.5, 1.5):
            cut.append(rod("Hole", 0.42, 3.0, (x, y, 0.5)))
            cut.append(rod("Countersink", 0.42, 0.42, (x, y, 0.84), radius2=0.84))
    for x in (-1.45, 1.45):
        cut.append(rod("Window", 0.28, 3.0, (x * 0.9, 1.2, 1.75), (90, 0, 0), segments=64))
    for k, (tools, operation) in enumerate(((add, "UNION"), (cut, "DIFFERENCE"))):
        for tool in tools:
            modifier = part.modifiers.new(f"{operation} {k}", "BOOLEAN")
            modifier.operation, modifier.solver, modifier.object = operation, "EXACT", tool

    # The boolean's result is stored, so that the file shows the same part in every Blender.
    bpy.context.view_layer.update()
    evaluated = part.evaluated_get(bpy.context.evaluated_depsgraph_get())
    bm = bmesh.new()
    bm.from_mesh(evaluated.data)
    bmesh.ops.remove_doubles(bm, verts=bm.verts, dist=1e-5)
    bmesh.ops.dissolve_degenerate(bm, dist=1e-5, edges=bm.edges)
    closed = all(edge.is_manifold and edge.is_contiguous for edge in bm.edges)
    assert closed, "the part is not watertight"
    made = bpy.data.meshes.new("Bracket")
    bm.to_mesh(made)
    bm.free()
    made.materials.append(steel)
    made.shade_smooth()
    made.set_sharp_from_angle(angle=math.radians(25))
    for thing in (part, *add, *cut):
        data = thing.data
        bpy.data.objects.remove(thing)
        bpy.data.meshes.remove(data)
    made.name = "Bracket"
    link(made, "Bracket", turn=(0, 0, -28))
    sun(2.3, (-0.5, -0.75, 1.15))
    target = Vector((-0.1, 0, 2.05))
    camera(target + Vector((2.0, -12, 7.0)), target, width=12.4)


def wedge(bm, width: float, height: float, length: float) -> None:
    """A triangular rib that leans on the plane y = 0 and runs towards -y."""
    half = width / 2
    left = [bm.verts.new((-half, y, z)) for y, z in ((0, 0), (0, height), (-length, 0))]
    right = [bm.verts.new((half, y, z)) for y, z in ((0, 0), (0, height), (-length, 0))]
    bm.faces.new(left)
    bm.faces.new(right)
    for a in range(3):
        b = (a + 1) % 3
        bm.faces.new((left[a], left[b], right[b], right[a]))


def make_thin() -> None:
    new_scene((0.42, 0.47, 0.52))
    link(plane("Table", 40.0, material("Table", SLATE)), "Table")

    # Paper: an A-size sheet whose near corner curls up.
    def paper(u, v):
        x, y = 2.97 * (u - 0.5), 2.10 * (v - 0.5)
        lift = max(0.0, 0.75 * (u - 0.45) + 0.55 * (0.55 - v))
        return (
            x - 0.30 * lift**2,
            y + 0.12 * lift**2,
            0.03 + 0.62 * lift**2 + 0.012 * math.sin(7 * v),
        )

    link(
        grid("Paper", 40, 28, paper, material("Paper", WHITE)),
        "Paper",
        at=(-1.55, -0.55, 0),
        turn=(0, 0, 14),
    )

    # Wires: a screen of open frame, 4 mm thick, bent like a fence.
    screen = link(
        grid(
            "Wires",
            14,
            10,
            lambda u, v: (
                3.4 * (u - 0.5),
                0.55 * math.sin(math.pi * (u - 0.1)) - 0.5,
                0.02 + 2.1 * v,
            ),
            material("Wire", OCHRE),
        ),
        "Wires",
        at=(0.75, 1.55, 0),
        turn=(0, 0, -14),
    )
    screen.data.shade_flat()  # its wires are square
    wires = screen.modifiers.new("Wires", "WIREFRAME")
    wires.thickness, wires.use_even_offset, wires.use_boundary = 0.03, False, True

    # A leaf: two halves folded along the middle vein, drooping towards the tip.
    def leaf(u, v):
        half = 0.62 * math.sin(math.pi * min(1.0, u**0.8)) ** 0.85 * (1 - 0.35 * u)
        across = (2 * v - 1) * half
        wave = 0.03 * math.sin(22 * u) * abs(2 * v - 1)
        return 2.3 * u, across, 0.22 * abs(across) + 0.75 * math.sin(2.2 * u) - 0.22 * u**3 + wave

    green = grid("Leaf", 48, 16, leaf, material("Leaf", LEAF))
    link(green, "Leaf", at=(1.05, -0.85, 0.02), turn=(0, 0, -18))
    link(green, "Fallen leaf", at=(3.15, 0.65, 0.12), turn=(12, 4, 118), scale=(0.62, 0.62, 0.25))
    red = green.copy()
    red.name = "Red leaf"
    red.materials[0] = material("Autumn", CORAL)
    link(red, "Red leaf", at=(0.15, -1.75, 0.10), turn=(-6, 5, 200), scale=(0.55, 0.55, 0.3))

    sun(2.4, (-0.75, -0.35, 0.80))
    camera((-0.1, -9.0, 4.6), (0.28, 0.0, 0.62), lens=47)


def make_lowpoly() -> None:
    new_scene((0.20, 0.26, 0.34))

    def ring(bm) -> None:
        around, across = 24, 8
        rows = []
        for i in range(around):
            a = 2 * math.pi * i / around
            row = []
            for j in range(across):
                b = 2 * math.pi * j / across
                r = 0.62 + 0.24 * math.cos(b)
                row.append(bm.verts.new((r * math.cos(a), r * math.sin(a), 0.24 * math.sin(b))))
            rows.append(row)
        for i in range(around):
            one, two = rows[i], rows[(i + 1) % around]
            for j in range(across):
                k = (j + 1) % across
                bm.faces.new((one[j], two[j], two[k], one[k]))

    shapes = (
        ("Suzanne", lambda bm: bmesh.ops.create_monkey(bm), OCHRE, (-14, 0, 24), 0.9),
        ("Ball", lambda bm: bmesh.ops.create_uvsphere(bm, u_segments=16, v_segments=8, radius=0.8),
         CORAL, (20, 10, 0), 1.0),
        ("Ring", ring, TEAL, (38, 12, 0), 1.0),
        ("Cylinder", lambda bm: bmesh.ops.create_cone(
            bm, cap_ends=True, segments=16, radius1=0.6, radius2=0.6, depth=1.4),
         LEAF, (0, 0, 8), 1.0),
    )  # fmt: skip
    for row, smooth in enumerate((True, False)):
        for column, (name, build, color, turn, scale) in enumerate(shapes):
            title = f"{name}, {'smooth' if smooth else 'flat'}"
            made = mesh(title, build, material(title, color), smooth=smooth)
            if smooth and name == "Cylinder":
                made.set_sharp_from_angle(angle=math.radians(50))
            thing = link(made, title, turn=turn, scale=scale)
            bpy.context.view_layer.update()
            lowest = min((thing.matrix_world @ v.co).z for v in made.vertices)
            thing.location = (2.3 * (column - 1.5), 1.6 - 2.6 * row, -lowest)
    link(plane("Floor", 60.0, material("Sand", SAND)), "Floor")
    sun(2.7, (-0.70, -0.60, 0.80))
    camera((0.0, -12.5, 7.4), (0.0, -0.1, 0.45), lens=50)


MAKERS = {
    "sphere": make_sphere,
    "suzanne": make_suzanne,
    "gallery": make_gallery,
    "cad": make_cad,
    "thin": make_thin,
    "lowpoly": make_lowpoly,
    "cornell": make_cornell,
    "still": make_still,
    "textured": make_textured,
    "mirrors": make_mirrors,
    "metal": make_metal,
    "glass": make_glass,
    "head": make_head,
    "xray": make_xray,
    "turntable": make_turntable,
    "labels": make_labels,
    "gyroid": make_gyroid,
    "cloud": make_cloud,
    "fog": make_fog,
    "beam": make_beam,
}


def main(names: list[str]) -> int:
    addon.register()  # the scenes choose LeapRay and hold its settings
    for name in names or MAKERS:
        MAKERS[name]()
        bpy.context.preferences.filepaths.save_version = 0
        bpy.context.scene.render.filepath = f"//{name}"
        path = HERE / f"{name}.blend"
        bpy.ops.wm.save_as_mainfile(filepath=str(path), compress=True)
        print(f"{path.name}: {path.stat().st_size / 1024:.0f} kB")
    addon.unregister()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]))
