# SPDX-License-Identifier: GPL-3.0-or-later
"""Random scenes, small and such as people make them, rendered by LeapRay and by Cycles.

    python tests/random_scenes.py FIRST COUNT [--save]     one line of JSON for each seed;
                                                           saved: SEED.blend, SEED.npz

A scene is made of everything that Blender offers for it; what a seed makes is the same in
every run of one Blender. Both engines look through the pixels' centres, so that depth and
object index can be told from each other but at edges.
"""

from __future__ import annotations

import json
import math
import os
import random
import sys
import tempfile
import time
from pathlib import Path

import bpy
import numpy as np
from blender_scenes import exr, fresh, nodes_of
from mathutils import Matrix, Vector

import leapray
from addon.blender import open_file
from addon.study import frames, metrics

SIDE = 64  # pixels of the longer side of a picture
SLACK = 0.5  # pixels by which a depth may differ from those around the pixel
INCOMPARABLE = (  # warnings of what Cycles draws and LeapRay does not
    "not supported",
    "its matrix cannot be inverted",
    "the ray visibility of single objects does not count",
)
GRADED = ("Base Color", "Roughness", "Metallic", "IOR", "Alpha", "Transmission Weight", "Color")


class Maker:
    """Makes the scene of a seed."""

    def __init__(self, seed: int) -> None:
        self.rng = random.Random(seed)
        self.scene = fresh()
        bpy.data.objects.remove(self.scene.camera)
        self.objects: list = []
        self.whole = None  # what all of them hang on
        self.materials = [self.material(k) for k in range(self.rng.randint(1, 4))]

    def likely(self, probability: float) -> bool:
        return self.rng.random() < probability

    def one(self, *choices):
        return self.rng.choice(choices)

    def vector(self, size: float) -> tuple[float, float, float]:
        return tuple(self.rng.uniform(-size, size) for _ in range(3))

    def color(self) -> tuple[float, float, float, float]:
        return (*(self.rng.random() for _ in range(3)), 1.0)

    def make(self):
        """The scene."""
        for _ in range(self.rng.randint(2, 8)):
            self.add(self.object())
        if self.likely(0.6):
            bpy.ops.mesh.primitive_plane_add(size=self.one(8, 20, 200), location=(0, 0, -2))
            self.add(bpy.context.object)
        for ob in list(self.objects):
            if self.likely(0.3) and ob.type in {"MESH", "CURVE", "FONT", "SURFACE"}:
                self.modifier(ob)
        for ob in self.objects:
            if self.likely(0.06) and ob.type == "MESH" and len(ob.data.polygons):
                self.scatter(ob)
        self.relate()
        if self.likely(0.1):
            self.move_all()
        for _ in range(self.rng.randint(0, 3)):
            self.light()
        self.camera()
        self.world()
        self.settings()
        for k, ob in enumerate(sorted(bpy.data.objects, key=lambda each: each.name), 1):
            ob.pass_index = k
        return self.scene

    # ---- objects -------------------------------------------------------------

    def add(self, ob) -> None:
        """Place a new object, shade it, and put it in some collection."""
        self.objects.append(ob)
        ob.location = Vector(ob.location) + Vector(self.vector(2.5))
        ob.rotation_mode = self.one("XYZ", "QUATERNION", "ZYX", "AXIS_ANGLE")
        if ob.rotation_mode in {"XYZ", "ZYX"} and ob.name[:5] != "Plane":
            ob.rotation_euler = self.vector(math.pi)
        if self.likely(0.4):
            ob.scale = [self.rng.choice((-1, 1, 1, 1)) * self.rng.uniform(0.3, 2) for _ in range(3)]
        if self.likely(0.02):
            ob.scale[self.rng.randrange(3)] = 0.0
        for flag, probability in (
            ("hide_render", 0.04),
            ("visible_camera", 0.96),
            ("visible_shadow", 0.9),
        ):
            setattr(ob, flag, self.likely(probability))
        if hasattr(ob.data, "materials"):
            for _ in range(self.one(0, 1, 1, 1, 2)):
                ob.data.materials.append(self.one(None, *self.materials, *self.materials))
            if ob.material_slots and self.likely(0.2):
                ob.material_slots[0].link = "OBJECT"
                ob.material_slots[0].material = self.rng.choice(self.materials)
        if ob.type == "MESH" and ob.data.polygons:
            self.shade(ob.data)
        if self.likely(0.15):
            self.into_collection(ob)

    def into_collection(self, ob) -> None:
        made = bpy.data.collections.new("Group")
        parent = self.rng.choice([self.scene.collection, *self.scene.collection.children_recursive])
        parent.children.link(made)
        for owner in ob.users_collection:
            owner.objects.unlink(ob)
        made.objects.link(ob)
        made.hide_render = self.likely(0.05)

    def object(self):
        """A new object of any kind."""
        kinds = (self.primitive, self.primitive, self.primitive, self.text, self.curve)
        kinds += (self.surface, self.metaballs, self.polygons, self.nothing)
        return self.rng.choice(kinds)()

    def primitive(self):
        add, rng = bpy.ops.mesh, self.rng
        self.rng.choice(
            (
                lambda: add.primitive_cube_add(size=rng.uniform(0.5, 2)),
                lambda: add.primitive_uv_sphere_add(
                    segments=rng.randint(3, 32), ring_count=rng.randint(3, 16)
                ),
                lambda: add.primitive_ico_sphere_add(subdivisions=rng.randint(1, 4)),
                lambda: add.primitive_cylinder_add(
                    vertices=rng.randint(3, 48), end_fill_type=self.one("NGON", "TRIFAN", "NOTHING")
                ),
                lambda: add.primitive_cone_add(
                    vertices=rng.randint(3, 32), radius2=self.one(0, 0, 0.5)
                ),
                lambda: add.primitive_torus_add(
                    major_segments=rng.randint(3, 48), minor_segments=rng.randint(3, 16)
                ),
                lambda: add.primitive_monkey_add(),
                lambda: add.primitive_grid_add(x_subdivisions=rng.randint(2, 12)),
                lambda: add.primitive_circle_add(
                    vertices=rng.randint(3, 32), fill_type=self.one("NGON", "TRIFAN", "NOTHING")
                ),
            )
        )()
        return bpy.context.object

    def text(self):
        bpy.ops.object.text_add()
        ob = bpy.context.object
        ob.data.body = self.one("Ray", "a\nb c", "8", "", "\u00e4\u00df", "WWW")
        ob.data.extrude = self.one(0, 0.05, 0.2)
        ob.data.bevel_depth = self.one(0, 0, 0.02)
        ob.data.size = self.rng.uniform(0.5, 2)
        return ob

    def curve(self):
        add = bpy.ops.curve
        self.rng.choice(
            (
                add.primitive_bezier_circle_add,
                add.primitive_bezier_curve_add,
                add.primitive_nurbs_circle_add,
                add.primitive_nurbs_path_add,
            )
        )()
        ob = bpy.context.object
        ob.data.dimensions = self.one("2D", "3D", "3D")
        ob.data.bevel_depth = self.one(0, 0.02, 0.1, 0.3)
        ob.data.extrude = self.one(0, 0, 0.2)
        ob.data.bevel_resolution = self.rng.randint(0, 4)
        ob.data.use_fill_caps = self.likely(0.5)
        return ob

    def surface(self):
        add = bpy.ops.surface
        self.rng.choice(
            (
                add.primitive_nurbs_surface_sphere_add,
                add.primitive_nurbs_surface_torus_add,
                add.primitive_nurbs_surface_surface_add,
                add.primitive_nurbs_surface_cylinder_add,
            )
        )()
        return bpy.context.object

    def metaballs(self):
        data = bpy.data.metaballs.new("Meta")
        data.resolution = data.render_resolution = self.rng.uniform(0.15, 0.4)
        for _ in range(self.rng.randint(1, 4)):
            element = data.elements.new(type=self.one("BALL", "CAPSULE", "ELLIPSOID", "CUBE"))
            element.co = self.vector(0.7)
            element.use_negative = self.likely(0.15)
        return self.linked("Meta", data)

    def polygons(self):
        """A mesh that nobody models: loose, open, twisted or doubled faces."""
        corners = [self.vector(1) for _ in range(self.rng.randint(3, 24))]
        faces = []
        for _ in range(self.rng.randint(1, 20)):
            count = min(self.one(3, 3, 3, 4, 5), len(corners))
            faces.append(self.rng.sample(range(len(corners)), count))
        data = bpy.data.meshes.new("Polygons")
        data.from_pydata(corners, [], faces)
        data.validate()
        return self.linked("Polygons", data)

    def nothing(self):
        """An object that shows nothing."""
        data = {
            "empty": None,
            "mesh": bpy.data.meshes.new("No mesh"),
            "wire": bpy.data.meshes.new("Wire"),
            "armature": bpy.data.armatures.new("Armature"),
            "lattice": bpy.data.lattices.new("Lattice"),
            "speaker": bpy.data.speakers.new("Speaker"),
            "camera": bpy.data.cameras.new("Another"),
        }
        data["wire"].from_pydata([(0, 0, 0), (1, 0, 0)], [(0, 1)], [])
        return self.linked("Nothing", data[self.rng.choice(sorted(data))])

    def linked(self, name: str, data):
        ob = bpy.data.objects.new(name, data)
        self.scene.collection.objects.link(ob)
        return ob

    def shade(self, data) -> None:
        """Shading, layers and material slots of a mesh."""
        how = self.one("flat", "smooth", "mixed", "angle")
        smooth = np.full(len(data.polygons), how != "flat")
        if how == "mixed":
            smooth = np.array([self.likely(0.5) for _ in data.polygons])
        data.polygons.foreach_set("use_smooth", smooth)
        if how == "angle" and hasattr(data, "set_sharp_from_angle"):
            data.set_sharp_from_angle(angle=self.rng.uniform(0.2, 1.5))
        if self.likely(0.5):
            slots = [self.rng.randrange(3) for _ in data.polygons]  # beyond what is there, too
            data.polygons.foreach_set("material_index", slots)
        if self.likely(0.3):
            kind, domain = self.one("FLOAT_COLOR", "BYTE_COLOR"), self.one("POINT", "CORNER")
            layer = data.color_attributes.new("Col", kind, domain)
            for each in layer.data:
                each.color = self.color()
        if self.likely(0.1):
            bent = [each.vector + Vector(self.vector(0.3)) for each in data.corner_normals]
            data.normals_split_custom_set(bent)
        data.update()

    def modifier(self, ob) -> None:
        mesh = ob.type == "MESH"
        kinds = ["SUBSURF", "SOLIDIFY", "ARRAY", "MIRROR", "SIMPLE_DEFORM", "DECIMATE", "BEVEL"]
        kinds += ["WIREFRAME", "SCREW", "REMESH", "TRIANGULATE", "EDGE_SPLIT", "DISPLACE", "BUILD"]
        kinds += ["BOOLEAN", "WELD", "WAVE", "CAST"] * mesh
        made = ob.modifiers.new("Modifier", self.rng.choice(kinds))
        if made is None:
            return
        made.show_render = self.likely(0.9)
        values = {
            "SUBSURF": {"render_levels": 1, "levels": 0},
            "SOLIDIFY": {"thickness": self.rng.uniform(-0.3, 0.3)},
            "ARRAY": {"count": self.rng.randint(1, 4)},
            "MIRROR": {"use_axis": (True, self.likely(0.5), False)},
            "SIMPLE_DEFORM": {"deform_method": self.one("TWIST", "BEND", "TAPER")},
            "DECIMATE": {"ratio": self.rng.random()},
            "BEVEL": {"width": self.rng.uniform(0, 0.2), "segments": self.rng.randint(1, 3)},
            "REMESH": {"mode": self.one("BLOCKS", "SMOOTH", "SHARP"), "octree_depth": 3},
            "DISPLACE": {"strength": self.rng.uniform(-0.5, 0.5)},
            "BUILD": {"frame_duration": 1},
            "BOOLEAN": {"object": self.rng.choice(self.objects)},
        }.get(made.type, {})
        if made.type == "BOOLEAN" and (values["object"] == ob or values["object"].type != "MESH"):
            values = {}
        for name, value in values.items():
            setattr(made, name, value)

    def scatter(self, ob) -> None:
        """Things on a mesh: particles, or instances by geometry nodes."""
        if self.likely(0.5):
            ob.modifiers.new("Particles", "PARTICLE_SYSTEM")
            settings = ob.particle_systems[-1].settings
            settings.count, settings.frame_start, settings.frame_end = 20, -10, 0
            settings.physics_type, settings.lifetime = "NO", 1000
            settings.render_type, settings.particle_size = "OBJECT", 0.2
            settings.instance_object = self.rng.choice(
                [each for each in self.objects if each != ob]
            )
            return
        tree = bpy.data.node_groups.new("Scatter", "GeometryNodeTree")
        for in_out in ("INPUT", "OUTPUT"):
            tree.interface.new_socket("Geometry", in_out=in_out, socket_type="NodeSocketGeometry")
        source, end, place, cube, joined = (
            tree.nodes.new(kind)
            for kind in (
                "NodeGroupInput",
                "NodeGroupOutput",
                "GeometryNodeInstanceOnPoints",
                self.one("GeometryNodeMeshCube", "GeometryNodeMeshIcoSphere"),
                self.one("GeometryNodeJoinGeometry", "GeometryNodeRealizeInstances"),
            )
        )
        place.inputs["Scale"].default_value = (0.1, 0.1, self.one(0.1, -0.2))
        tree.links.new(source.outputs[0], place.inputs["Points"])
        tree.links.new(cube.outputs[0], place.inputs["Instance"])
        tree.links.new(place.outputs[0], joined.inputs[0])
        if joined.bl_idname == "GeometryNodeJoinGeometry":
            tree.links.new(source.outputs[0], joined.inputs[0])
        tree.links.new(joined.outputs[0], end.inputs[0])
        ob.modifiers.new("Scatter", "NODES").node_group = tree

    def relate(self) -> None:
        """Parents, which shear, and instances of collections, vertices, faces and data."""
        for ob in self.objects:
            other = self.rng.choice(self.objects)
            above = other
            while above and above != ob:
                above = above.parent
            if above is None and self.likely(0.25):
                ob.parent = other
                if self.likely(0.5):
                    turned = Matrix.Rotation(self.rng.uniform(0, 3), 4, self.vector(1))
                    ob.matrix_parent_inverse = turned
                if other.type == "MESH" and self.likely(0.15):
                    other.instance_type = self.one("VERTS", "FACES")
                    other.show_instancer_for_render = self.likely(0.5)
        for collection in self.scene.collection.children_recursive:
            if self.likely(0.4):
                empty = self.linked("Instances", None)
                empty.instance_type, empty.instance_collection = "COLLECTION", collection
                empty.location, empty.scale = self.vector(3), (1, 1, self.one(1, -1, 0.5))
        for ob in list(self.objects):
            if self.likely(0.1) and ob.data is not None:
                twin = ob.copy()  # the same data
                twin.location = self.vector(3)
                self.scene.collection.objects.link(twin)

    def move_all(self) -> None:
        """Have all of it far away, or of another size; camera and lights come later, with it."""
        self.whole = self.linked("Whole", None)
        self.whole.location = self.vector(self.one(0, 10, 1000))
        self.whole.scale = [self.one(0.01, 0.1, 1, 30)] * 3
        for ob in self.scene.objects:
            if ob.parent is None and ob != self.whole:
                ob.parent = self.whole

    # ---- what they are made of and seen by -----------------------------------

    def material(self, number: int):
        made = bpy.data.materials.new(f"Material {number}")
        tree = nodes_of(made)
        made.pass_index = number + 1
        made.diffuse_color = self.color()
        if self.likely(0.05):
            return made  # as it is
        tree.nodes.clear()
        output = tree.nodes.new("ShaderNodeOutputMaterial")
        shader = self.shader(tree)
        if self.likely(0.2):
            mix = tree.nodes.new(self.one("ShaderNodeMixShader", "ShaderNodeAddShader"))
            tree.links.new(shader.outputs[0], mix.inputs[-1])
            tree.links.new(self.shader(tree).outputs[0], mix.inputs[-2])
            shader = mix
        tree.links.new(shader.outputs[0], output.inputs["Surface"])
        return made

    def shader(self, tree):
        kinds = ["Principled"] * 4 + ["Diffuse"] * 2 + ["Glossy", "Glass", "Refraction"]
        kind = self.rng.choice([*kinds, "Translucent", "Toon", "Sheen"])
        made = tree.nodes.new(f"ShaderNodeBsdf{kind}")
        for socket in made.inputs:
            if socket.name in GRADED and self.likely(0.4):
                if socket.type == "RGBA":
                    socket.default_value = self.color()
                    if self.likely(0.3):
                        tree.links.new(self.colors(tree).outputs[0], socket)
                elif socket.name not in {"Alpha", "IOR"}:
                    socket.default_value = self.rng.choice((0.0, 1.0, self.rng.random()))
        if self.likely(0.05) and "Emission Strength" in made.inputs:
            made.inputs["Emission Strength"].default_value = self.rng.uniform(0, 5)
        return made

    def colors(self, tree):
        """A node that gives colours, known or not."""
        kind = self.one("TexImage", "VertexColor", "TexNoise", "TexChecker", "RGB", "Gamma")
        made = tree.nodes.new(f"ShaderNode{kind}")
        if kind == "TexImage" and self.likely(0.8):
            image = bpy.data.images.new("Image", 4, 4, float_buffer=self.likely(0.3))
            image.generated_type = self.one("BLANK", "UV_GRID", "COLOR_GRID")
            made.image = image
        return made

    def light(self) -> None:
        data = bpy.data.lights.new("Light", self.one("POINT", "SUN", "SPOT", "AREA"))
        data.energy = self.rng.uniform(0, 5) if data.type == "SUN" else self.rng.uniform(0, 500)
        data.color = self.color()[:3]
        if data.type == "AREA":
            data.shape = self.one("SQUARE", "RECTANGLE", "DISK", "ELLIPSE")
            data.size, data.size_y = self.rng.uniform(0, 2), self.rng.uniform(0, 2)
        ob = self.linked("Light", data)
        ob.location, ob.rotation_euler = self.vector(4), self.vector(3)
        if self.likely(0.2):
            ob.scale = self.vector(2)
        if self.likely(0.2):
            ob.parent = self.rng.choice(self.objects)

    def camera(self) -> None:
        data = bpy.data.cameras.new("Camera")
        ob = self.linked("Camera", data)
        away = Vector(self.vector(1)).normalized() * self.rng.uniform(3, 9)
        away.z = abs(away.z)
        ob.location = away
        seen = [each for each in self.objects if each.type != "EMPTY"] or self.objects
        aim = self.rng.choice(seen).location + Vector(self.vector(0.5))
        ob.rotation_euler = (aim - away).to_track_quat("-Z", "Y").to_euler()
        if self.likely(0.15):
            ob.scale = [self.rng.uniform(0.5, 3) for _ in range(3)]
        data.type = self.one("PERSP", "PERSP", "PERSP", "ORTHO")
        data.lens, data.ortho_scale = self.rng.uniform(14, 50), self.rng.uniform(4, 12)
        data.sensor_fit = self.one("AUTO", "AUTO", "HORIZONTAL", "VERTICAL")
        if self.likely(0.2):
            data.shift_x, data.shift_y = self.vector(0.3)[:2]
        if self.likely(0.2):
            data.clip_start, data.clip_end = self.rng.uniform(0.1, 6), self.rng.uniform(8, 30)
        data.dof.use_dof = self.likely(0.03)
        if self.whole is not None:
            ob.parent = self.whole
            data.clip_start *= self.whole.scale[0]
            data.clip_end *= self.whole.scale[0]
            data.ortho_scale *= self.whole.scale[0]
        self.scene.camera = ob

    def world(self) -> None:
        if self.likely(0.05):
            self.scene.world = None
            return
        background = nodes_of(self.scene.world).nodes["Background"]
        background.inputs["Color"].default_value = self.color()
        background.inputs["Strength"].default_value = self.one(0, 0.3, 1, 2)

    def settings(self) -> None:
        scene, render = self.scene, self.scene.render
        sides = [SIDE, self.rng.randint(16, SIDE)]
        self.rng.shuffle(sides)
        render.resolution_x, render.resolution_y = sides
        render.pixel_aspect_x = self.one(1, 1, 1, 1, 1.5)
        render.pixel_aspect_y = self.one(1, 1, 1, 1, 2)
        render.film_transparent = self.likely(0.3)
        render.use_persistent_data = self.likely(0.2)
        render.use_simplify, render.simplify_subdivision_render = self.likely(0.1), 0
        if self.likely(0.1):
            render.use_border, render.use_crop_to_border = True, self.likely(0.5)
            render.border_min_x, render.border_max_x = self.rng.uniform(0, 0.4), 0.9
            render.border_min_y, render.border_max_y = self.rng.uniform(0, 0.4), 0.8
        if self.likely(0.1):
            other = scene.view_layers.new("Another")
            other.use = self.likely(0.5)
            for child in other.layer_collection.children:
                child.exclude = self.likely(0.5)
        scene.frame_set(self.one(1, 1, 1, 0, -5, 100))
        own = scene.leapray
        own.samples = self.one(1, 1, 2, 3)
        own.diffuse_bounces, own.max_bounces = self.one(0, 1, 4), self.one(0, 2, 12)
        if self.likely(0.25):
            own.traverser = self.rng.choice([e.name for e in leapray.traversers() if e.exact])
        if self.likely(0.1):
            own.layout = "scene"
        if self.likely(0.1):
            own.sample_type = self.one("u8", "u16", "f32")
        if self.likely(0.1):
            own.root = self.rng.choice(list(leapray.ROOTS))
            own.normal = self.rng.choice(list(leapray.NORMALS))
        if self.likely(0.05):
            own.noise_threshold = 0.1


# ---- rendering them --------------------------------------------------------------


def render(scene, picture: Path, engine: str) -> dict[str, np.ndarray]:
    """The geometry's passes of the frame, all of its channels, and the reports of LeapRay."""
    scene.render.engine = engine
    open_file.set_format(scene, picture)
    picture.unlink(missing_ok=True)
    if engine == "LEAPRAY":
        found = open_file.render_frame(scene)
    else:
        cycles = scene.cycles
        cycles.samples, cycles.max_bounces = 1, 0
        cycles.use_adaptive_sampling = cycles.use_denoising = False
        cycles.pixel_filter_type = "BOX"
        found = {}
        with open_file.quiet():
            bpy.ops.render.render(write_still=True, scene=scene.name)
    first = f"{scene.view_layers[0].name}."
    planes = {
        name.removeprefix(first): pixels
        for name, pixels in exr(picture).items()
        if name.startswith(first)
    }
    index = "Object Index" if bpy.app.version >= (5, 0) else "IndexOB"
    passes = {
        "depth": planes["Depth.Z"].astype(np.float64),
        "index": np.rint(planes[f"{index}.X"]).astype(int),
        **{
            name.lower(): np.stack([planes[f"{name}.{axis}"] for axis in "XYZ"], axis=-1)
            for name in ("Position", "Normal")
        },
        "all": np.stack(list(planes.values())),
        "reports": found,
    }
    return passes


def differences(scene, want, got) -> dict[str, float]:
    """Shares of pixels whose index or depth is not that of Cycles within a pixel's step."""
    shape = want["index"].shape
    wrong = np.zeros(shape, bool)
    for one, other in ((want, got), (got, want)):
        wrong |= (metrics.around(one["index"]) != other["index"]).all(axis=0)
    near = metrics.around(want["depth"])
    depth, other = want["depth"], got["depth"]
    view = frames.view(scene, bpy.context.evaluated_depsgraph_get())
    slack = SLACK * view.footprint(depth)
    hit = (depth < 1e9) & (other < 1e9) & ~wrong
    error = metrics.depth_error(view, depth, want["position"], want["normal"], other)
    beyond = (other < near.min(axis=0) - slack) | (other > near.max(axis=0) + slack)
    return {
        "index": float(wrong.mean()),
        "depth": float((beyond & hit & (error > SLACK)).mean()),
        "n": int(hit.sum()),
    }


def outcome(seed: int, folder: Path) -> dict:
    """What becomes of the scene of a seed."""
    began = time.perf_counter()
    told = {"seed": seed}
    try:
        scene = Maker(seed).make()
        if "--save" in sys.argv:
            bpy.ops.wm.save_as_mainfile(filepath=str(Path(f"{seed}.blend").absolute()))
        made = time.perf_counter()
        got = render(scene, folder / "ours.exr", "LEAPRAY")
        told["seconds"] = time.perf_counter() - made
    except leapray.LeapRayError as error:
        sentence = str(error)
        kind = "fault" if "fault of its own" in sentence else "refused"
        return told | {"outcome": kind, "why": sentence}
    except Exception as error:
        return told | {"outcome": "error", "why": f"{type(error).__name__}: {error}"}
    reports = got["reports"]
    told["warnings"] = [w for report in reports.values() for w in report["warnings"]]
    told["finite"] = bool(np.isfinite(got["all"]).all())
    told["outcome"] = "rendered"
    of_geometry = [warning for warning in told["warnings"] if "lights" not in warning]
    if not any(words in warning for words in INCOMPARABLE for warning in of_geometry):
        want = render(scene, folder / "cycles.exr", "CYCLES")
        told["differ"] = differences(scene, want, got)
        if "--save" in sys.argv:
            np.savez(
                f"{seed}.npz",
                **{
                    f"{who}_{k}": each[k]
                    for who, each in (("want", want), ("got", got))
                    for k in ("index", "depth")
                },
            )
    told["whole"] = time.perf_counter() - began
    return told


def main(first: int, count: int) -> None:
    told = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # Blender's own words
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(first, first + count):
            print(json.dumps(outcome(seed, Path(folder))), file=told, flush=True)


if __name__ == "__main__":
    from addon import process

    def work(words: list[str]) -> int:
        main(*map(int, words[:2]))
        return 0

    process.run(work, sys.argv[1:])
