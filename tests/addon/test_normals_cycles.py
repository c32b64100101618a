# SPDX-License-Identifier: GPL-3.0-or-later
"""Stock meshes have the shading normals, and the light, that Cycles gives them."""

from __future__ import annotations

import itertools
import math

import bpy
import numpy as np
import pytest
from blender_scenes import diffuse, exr, fresh, light, polygons, put

from addon import arrays
from addon.blender import open_file
from addon.study import metrics

pytestmark = pytest.mark.slow

WIDTH, HEIGHT = 480, 200
rng = np.random.default_rng(3)


def leaves(n=40):
    """Bent quads that lie about in all directions."""
    points, faces = [], []
    for _ in range(n):
        middle, along = rng.uniform(-0.8, 0.8, 3), arrays.unit(rng.normal(size=3))
        across = arrays.unit(np.cross(along, rng.normal(size=3)))
        first = len(points)
        for s in (-1, 0, 1):
            bend = 0.05 * (1 - s * s) * np.cross(along, across)
            points += [tuple(middle + 0.3 * s * along + 0.1 * t * across + bend) for t in (-1, 1)]
        faces += [(first + k, first + k + 1, first + k + 3, first + k + 2) for k in (0, 2)]
    return polygons("Leaves", points, faces)


def shells(n=30):
    """Boxes that overlap, some of them wound inside out."""
    points, faces = [], []
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    for k in range(n):
        middle, half = rng.uniform(-0.7, 0.7, 3), rng.uniform(0.08, 0.3, 3)
        first = len(points)
        corners = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
        points += [tuple(middle + half * corner) for corner in corners]
        faces += [[first + i for i in (quad[::-1] if k % 3 == 0 else quad)] for quad in quads]
    return polygons("Shells", points, faces)


def terrain(n=40):
    line = np.linspace(-1, 1, n)
    x, y = np.meshgrid(line, line)
    z = 0.2 * np.sin(3 * x) * np.cos(2.5 * y) + 0.03 * rng.random((n, n))
    points = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    at = np.arange(n * n).reshape(n, n)
    faces = np.stack([at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]], -1).reshape(-1, 4)
    return polygons("Terrain", points.tolist(), faces.tolist())


def stock(operator, **words):
    """A mesh of Blender's own, taken out of its object."""

    def made():
        getattr(bpy.ops.mesh, f"primitive_{operator}_add")(**words)
        ob = bpy.context.object
        mesh = ob.data
        bpy.data.objects.remove(ob)
        return mesh

    return made


def text():
    curve = bpy.data.curves.new("Text", "FONT")
    curve.body, curve.extrude, curve.size = "Ray", 0.12, 1.1
    curve.align_x = curve.align_y = "CENTER"
    return curve


SHAPES = {
    "cube": stock("cube", size=1.5),
    "ball": stock("uv_sphere", segments=16, ring_count=8, radius=0.9),
    "fine ball": stock("uv_sphere", segments=48, ring_count=24, radius=0.9),
    "icosphere": stock("ico_sphere", subdivisions=4, radius=0.9),
    "cone": stock("cone", vertices=6, radius1=0.9, depth=1.6),
    "cylinder": stock("cylinder", vertices=12, radius=0.8, depth=1.5),
    "ring": stock(
        "torus", major_segments=48, minor_segments=12, major_radius=0.8, minor_radius=0.1
    ),
    "monkey": stock("monkey", size=1.8),
    "text": text,
    "leaves": leaves,
    "shells": shells,
    "terrain": terrain,
}
MODIFIERS = {
    "bevel": ("cube", (("BEVEL", {"width": 0.2, "segments": 2}),)),
    "weighted": ("cube", (("BEVEL", {"width": 0.15}), ("WEIGHTED_NORMAL", {"weight": 80}))),
    "wires": ("icosphere", (("WIREFRAME", {"thickness": 0.06}),)),
    "subdivided": ("monkey", (("SUBSURF", {"levels": 1, "render_levels": 1}),)),
}


def shade(data, style):
    if not hasattr(data, "polygons"):
        return
    n = len(data.polygons)
    mixed = style in ("mixed", "sharp")
    smooth = np.arange(n) % 3 != 0 if mixed else np.full(n, style == "smooth")
    data.polygons.foreach_set("use_smooth", smooth)
    for edge in list(data.edges)[::5] if style == "sharp" else ():
        edge.use_edge_sharp = True
    data.update()


def lean(data):
    """Custom normals: all of them lean to one side."""
    normals = np.empty((len(data.loops), 3), np.float32)
    data.corner_normals.foreach_get("vector", normals.ravel())
    data.normals_split_custom_set(arrays.unit(normals + np.array([0.4, 0, 0.2])).tolist())


@pytest.fixture
def row():
    """A scene whose objects stand in two rows before the camera; `add` puts the next one there."""
    scene = fresh()
    scene.render.resolution_x, scene.render.resolution_y = WIDTH, HEIGHT
    scene.camera.location = (0, -14, 4.0)
    scene.camera.rotation_euler = (math.radians(74), 0, 0)
    put("Sun", light("SUN", energy=2.0, angle=0.0), rotation_euler=(0.9, 0.3, 0))
    count = [0]

    def add(data, modifiers=()):
        k = count[0]
        count[0] += 1
        data.materials.append(diffuse("Plain"))
        place = (2.2 * (k % 6 - 2.5), 0.0, 1.2 - 2.4 * (k // 6))
        ob = put(f"Thing {k}", data, location=place, rotation_euler=(0.35, 0.2, 0.5))
        ob.pass_index = k + 1
        for kind, words in modifiers:
            modifier = ob.modifiers.new(kind, kind)
            for name, value in words.items():
                setattr(modifier, name, value)
        return k + 1

    return scene, add


def passes(scene, engine, path):
    scene.render.engine = engine
    layer, settings = scene.view_layers[0], scene.render.image_settings
    layer.use_pass_normal = layer.use_pass_object_index = layer.use_pass_z = True
    if hasattr(settings, "media_type"):
        settings.media_type = "MULTI_LAYER_IMAGE"
    settings.file_format, settings.color_depth = "OPEN_EXR_MULTILAYER", "32"
    scene.cycles.samples = scene.leapray.samples = 1
    scene.cycles.use_denoising = scene.cycles.use_adaptive_sampling = False
    scene.cycles.pixel_filter_type, scene.leapray.pixel_filter = "BOX", "box"
    scene.cycles.diffuse_bounces = 0
    scene.render.filepath = str(path)
    with open_file.quiet():
        bpy.ops.render.render(write_still=True)
    found = exr(path)

    def of(*words):
        return np.stack([found[n] for n in sorted(found) if any(w in n for w in words)], axis=-1)

    index = np.rint(of("IndexOB.", "Object Index.")[..., 0]).astype(int)
    return index, of("Normal."), of("Combined.")[..., [3, 2, 1]]  # A B G R, sorted


def judge(scene, things, tmp_path):
    """Where both see the same thing, hardly a normal is off, and hardly a pixel's light."""
    index, want, lit = passes(scene, "CYCLES", tmp_path / "cycles.exr")
    other, got, own = passes(scene, "LEAPRAY", tmp_path / "leapray.exr")
    assert (index != other).mean() < 0.002
    inner = (index == other) & ~metrics.mixed(index)
    angle, light_off = metrics.angle(want, got), np.abs(lit - own).max(axis=-1)
    for thing, number in things.items():
        seen = inner & (index == number)
        assert seen.sum() > 300, thing
        turned = metrics.turned_fraction(angle, seen)
        assert turned <= 0.01, f"{thing}: {turned:.1%} of the normals"
        assert np.percentile(angle[seen], 90) < 2, thing
        assert (light_off[seen] > 0.03).mean() < 0.02, thing


@pytest.mark.parametrize("style", ["smooth", "flat", "mixed", "sharp"])
def test_normals_of_stock_meshes(style, row, tmp_path):
    scene, add = row
    things = {}
    for name, make in SHAPES.items():
        data = make()
        shade(data, style)
        things[name] = add(data)
    judge(scene, things, tmp_path)


def test_normals_of_modified_meshes_and_of_custom_ones(row, tmp_path):
    scene, add = row
    things = {}
    for name, (shape, modifiers) in MODIFIERS.items():
        data = SHAPES[shape]()
        shade(data, "smooth")
        things[name] = add(data, modifiers)
    for name in ("fine ball", "icosphere", "cube"):
        data = SHAPES[name]()
        shade(data, "smooth")
        lean(data)
        things[f"leaning {name}"] = add(data)
    judge(scene, things, tmp_path)


def lathe(profile, n=24):
    """A smooth solid of revolution about z; its profile (r, z) begins and ends on the axis."""
    turn = 2 * np.pi * np.arange(n) / n
    rings = [
        [(r * math.cos(a), r * math.sin(a), z) for a in turn] if r else [(0.0, 0.0, z)]
        for r, z in profile
    ]
    first = np.cumsum([0, *map(len, rings)])
    faces = []
    for below, above in itertools.pairwise(range(len(rings))):
        for i in range(n):
            low = [first[below] + (i + k) % n % len(rings[below]) for k in (0, 1)]
            high = [first[above] + (i + k) % n % len(rings[above]) for k in (1, 0)]
            faces.append(list(dict.fromkeys([*low, *high])))
    data = bpy.data.meshes.new("Lathe")
    data.from_pydata([v for ring in rings for v in ring], [], faces)
    data.polygons.foreach_set("use_smooth", [True] * len(faces))
    data.update()
    return data


def glass(ior):
    made = bpy.data.materials.new("Glass")
    made.use_nodes = True
    tree = made.node_tree
    node = tree.nodes.new("ShaderNodeBsdfGlass")
    node.inputs["IOR"].default_value, node.inputs["Roughness"].default_value = ior, 0.0
    tree.links.new(node.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    return made


CORNERS = (-4, -4), (4, -4), (4, 4), (-4, 4)


def glass_light(scene, engine, path, samples=256):
    """The mean light of what has index 1."""
    index, *_ = passes(scene, engine, path)
    scene.cycles.samples = scene.leapray.samples = samples
    scene.cycles.diffuse_bounces = scene.leapray.diffuse_bounces = 4
    scene.cycles.blur_glossy = scene.cycles.sample_clamp_indirect = 0
    scene.leapray.clamp_indirect = 0
    with open_file.quiet():
        bpy.ops.render.render(write_still=True)
    found = exr(path)
    return np.mean(
        [found[n][index == 1].mean() for n in found if "Combined." in n and "A" not in n[-1]]
    )


@pytest.mark.parametrize("deeper", [None, -0.02, 0.1], ids=["empty", "gap", "overlap"])
def test_a_smooth_tumbler_is_as_bright_as_in_cycles(deeper, tmp_path):
    scene = fresh()
    scene.render.resolution_x = scene.render.resolution_y = 80
    background = scene.world.node_tree.nodes["Background"]
    background.inputs["Color"].default_value = (0.8, 0.8, 0.8, 1)
    scene.camera.location, scene.camera.rotation_euler = (0, -4, 2.2), (1.22, 0, 0)
    cup = lathe([(0, 0), (0.7, 0), (0.8, 1.8), (0.72, 1.8), (0.63, 0.15), (0, 0.15)])
    cup.materials.append(glass(1.45))
    put("Tumbler", cup).pass_index = 1
    floor = polygons("Floor", [(x, y, -1e-3) for x, y in CORNERS], [(0, 1, 2, 3)])
    floor.materials.append(diffuse("Floor"))
    put("Floor", floor)
    if deeper is not None:
        low, high = 0.63 + deeper, 0.63 + 0.09 * 1.05 / 1.65 + deeper
        water = lathe([(0, 0.15 - deeper), (low, 0.15 - deeper), (high, 1.2), (0, 1.2)])
        water.materials.append(glass(1.33))
        put("Water", water).pass_index = 1
    want, got = (
        glass_light(scene, engine, tmp_path / f"{engine}.exr") for engine in ("CYCLES", "LEAPRAY")
    )
    assert got == pytest.approx(want, rel=0.01)
