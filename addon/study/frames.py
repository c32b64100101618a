# SPDX-License-Identifier: GPL-3.0-or-later
"""A scene made comparable, and its frame rendered by one engine or the other, as arrays.

Blender cannot read its render result back, so each frame goes through a 32-bit multilayer EXR,
which OpenImageIO reads. Blender's own builds and wheels have that module; Debian's has not, and
LeapRayError is raised.
"""

from __future__ import annotations

import contextlib
import math
import os
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast

import bpy
import numpy as np
from numpy.typing import NDArray

from leapray import LeapRayError

from .. import methods
from ..blender import open_file
from ..blender.read import looks
from ..blender.read.images import openimageio
from ..blender.read.links import node_tree, tree_of
from .metrics import View

CHANNELS = {  # our name: the layer's names in Blender 5 and 4, and its channels
    "Combined": (("Combined",), "RGBA"),
    "Depth": (("Depth",), "Z"),
    "Normal": (("Normal",), "XYZ"),
    "Position": (("Position",), "XYZ"),
    "Object Index": (("Object Index", "IndexOB"), "X"),
}


@dataclass
class Frame:
    """A rendered frame; rows from below."""

    passes: dict[str, NDArray[np.float32]]  # (height, width) or (height, width, channels)
    seconds: float  # of the render call, with the writing of the file
    report: dict[str, object] = field(default_factory=dict)  # what LeapRay says of the frame

    @property
    def index(self) -> NDArray[np.int32]:
        return np.rint(self.passes["Object Index"]).astype(np.int32)


@dataclass(frozen=True)
class Subject:
    """What was found in the scene, after it was made comparable."""

    names: dict[int, str]  # of the objects, by the pass index they were given
    view: View
    white: float  # Combined of a lit white surface that faces the lights
    rim_starts: NDArray[np.float64]  # (n, 3) border edges of open meshes, world space
    rim_ends: NDArray[np.float64]
    refracts: bool  # some material lets light through
    soft: bool  # some light has no sharp shadows, whatever its size: lit and unlit are not told
    notes: list[str]  # what was changed for the comparison


# ---- making scenes comparable --------------------------------------------


def prepare(
    scene: bpy.types.Scene,
    *,
    plain: bool = True,
    diffuse_bounces: int | None = None,
    volumes: bool = False,
) -> list[str]:
    """Change the open scene so that both engines can draw the same; returns what was changed.

    plain: materials become diffuse, and light goes from the light to the surface to the camera.
    Else Cycles gets the limits of bounces that the scene has for LeapRay. Pixels have a box
    filter, and every object has a pass index of its own; instances share their object's.
    volumes: so do surfaces of volume objects, which only LeapRay renders.
    """
    notes = [] if volumes else hide_surfaces(scene)
    layer = bpy.context.view_layer
    if plain:
        notes += [f"{name} became a diffuse material of its base colour" for name in make_diffuse()]
    elif diffuse_bounces is not None:
        scene.leapray.diffuse_bounces = diffuse_bounces
    limit_bounces(scene, 0 if plain else None)
    render = scene.render
    render.use_border = render.use_motion_blur = render.use_sequencer = False
    render.use_compositing = render.film_transparent = False
    render.use_persistent_data = False
    render.use_simplify = False
    cycles = scene.cycles
    cycles.device = "CPU"
    cycles.use_denoising = cycles.use_adaptive_sampling = False
    cycles.use_auto_tile = False
    cycles.pixel_filter_type, cycles.filter_width = "BOX", 1.0
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
    scene.leapray.clamp_direct = scene.leapray.clamp_indirect = 0.0
    cycles.light_sampling_threshold = 0.0
    cycles.blur_glossy = 0.0
    cycles.use_fast_gi = False
    scene.leapray.pixel_filter, scene.leapray.noise_threshold = "box", 0.0
    scene.leapray.method = methods.RAYS.spec
    cycles.film_exposure = 1.0
    if scene.camera is not None and scene.camera.data.type != "PANO":
        scene.camera.data.dof.use_dof = False
    for switch in ("z", "normal", "position", "object_index"):
        setattr(layer, f"use_pass_{switch}", True)
    layer.samples = 0
    for other in scene.view_layers:
        other.use = other == layer
    return notes


BOUNCES = {  # LeapRay's limits of bounces, and Cycles'
    "max_bounces": "max_bounces",
    "diffuse_bounces": "diffuse_bounces",
    "glossy_bounces": "glossy_bounces",
    "transmission_bounces": "transmission_bounces",
    "transparent_bounces": "transparent_max_bounces",
    "volume_bounces": "volume_bounces",
}


def limit_bounces(scene: bpy.types.Scene, most: int | None) -> None:
    """Give both engines this limit of bounces of every kind; None: Cycles gets LeapRay's."""
    for ours, theirs in BOUNCES.items():
        if most is not None:
            setattr(scene.leapray, ours, most)
        setattr(scene.cycles, theirs, getattr(scene.leapray, ours))


def hide_surfaces(scene: bpy.types.Scene) -> list[str]:
    """Leave out volume objects of which LeapRay shows surfaces; returns what to say of them."""
    notes = []
    for thing in scene.objects:
        if thing.type != "VOLUME" or thing.hide_render:
            continue
        worn = thing.material_slots[0].material if len(thing.material_slots) else None
        if not looks.is_shown(thing.data.leapray.shown, worn):
            thing.hide_render = True
            notes.append(f"{thing.name} was left out, which Cycles renders as a cloud")
    return notes


@contextlib.contextmanager
def sharp(scene: bpy.types.Scene) -> Iterator[None]:
    """Meanwhile light does not bounce, and suns, points and spots have no extent."""
    limits = {name: getattr(scene.leapray, name) for name in BOUNCES}
    limit_bounces(scene, 0)
    extents = [
        (light, name, getattr(light, name))
        for light in bpy.data.lights
        for name in {"SUN": ("angle",), "AREA": ()}.get(light.type, ("shadow_soft_size",))
    ]
    for light, name, _ in extents:
        setattr(light, name, 0.0)
    try:
        yield
    finally:
        for light, name, value in extents:
            setattr(light, name, value)
        for name, value in limits.items():
            setattr(scene.leapray, name, value)
        limit_bounces(scene, None)


def refracting(material: bpy.types.Material) -> bool:
    """Whether some node of the material lets light through."""
    nodes = material.node_tree.nodes if material.node_tree else ()
    names = ("Transmission Weight", "Transmission")
    return any(
        node.type in {"BSDF_GLASS", "BSDF_REFRACTION"}
        or any(node.inputs[n].default_value > 0 for n in names if n in node.inputs)
        for node in nodes
        if node.type.startswith("BSDF")
    )


def make_diffuse() -> list[str]:
    """Replace surfaces by diffuse ones of their base colour; returns the names of what changed."""
    changed = []
    for material in bpy.data.materials:
        color, plain = base_color(material)
        if plain or looks.is_alone(material):
            continue
        changed.append(material.name)
        be_diffuse(material, color)
    return changed


def be_diffuse(material: bpy.types.Material, color: tuple[float, ...]) -> None:
    """Have a material be diffuse, of that colour (RGBA), and nothing else."""
    tree = node_tree(material)
    tree.nodes.clear()
    bsdf = tree.nodes.new("ShaderNodeBsdfDiffuse")
    bsdf.inputs["Color"].default_value = color
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(bsdf.outputs["BSDF"], output.inputs["Surface"])


def base_color(material: bpy.types.Material) -> tuple[tuple[float, ...], bool]:
    """The colour by which LeapRay draws a material, and whether it is diffuse already."""
    tree = tree_of(material)
    output = tree and (tree.get_output_node("CYCLES") or tree.get_output_node("ALL"))
    if output is not None and output.inputs["Surface"].is_linked:
        shader = output.inputs["Surface"].links[0].from_node
        name = {"BSDF_PRINCIPLED": "Base Color", "BSDF_DIFFUSE": "Color"}.get(shader.type)
        if name and not shader.inputs[name].is_linked:
            plain = name == "Color" and not any(socket.is_linked for socket in shader.inputs)
            plain = plain and shader.inputs["Roughness"].default_value == 0
            return tuple(shader.inputs[name].default_value), plain
    return tuple(material.diffuse_color), False


def blacken_world(scene: bpy.types.Scene) -> None:
    """Let no light come from the surroundings."""
    scene.world = bpy.data.worlds.new("Black")
    scene.world.color = (0.0, 0.0, 0.0)
    node_tree(scene.world).nodes["Background"].inputs["Color"].default_value = (0, 0, 0, 1)


def examine(scene: bpy.types.Scene, notes: list[str]) -> Subject:
    """Give the objects their pass indices, and learn the view and the rims of open meshes."""
    names = {0: "nothing"}
    for k, thing in enumerate(sorted(bpy.data.objects, key=lambda each: each.name), start=1):
        thing.pass_index = k
        names[k] = thing.name
    depsgraph = bpy.context.evaluated_depsgraph_get()
    starts, ends = border_edges(depsgraph)
    suns = [
        thing.data.energy * 2.0**thing.data.exposure * max(thing.data.color)
        for thing in scene.objects
        if thing.type == "LIGHT" and thing.data.type == "SUN" and not thing.hide_render
    ]
    if not suns:
        notes.append("there is no sun: errors of light are relative to 1")
    used = {m for o in scene.objects for slot in o.material_slots if (m := slot.material)}
    return Subject(
        names,
        view(scene, depsgraph),
        sum(suns) / math.pi or 1.0,
        starts,
        ends,
        any(map(refracting, used)),
        any(o.type == "LIGHT" and o.data.type == "AREA" for o in scene.objects),
        notes,
    )


def view(scene: bpy.types.Scene, depsgraph) -> View:
    """The metrics' view of the scene's camera."""
    thing = scene.camera.evaluated_get(depsgraph)
    width, height = size(scene)
    projection = np.array(
        thing.calc_matrix_camera(
            depsgraph,
            x=width,
            y=height,
            scale_x=scene.render.pixel_aspect_x,
            scale_y=scene.render.pixel_aspect_y,
        ),
        np.float64,
    )
    pose = np.array(thing.matrix_world.normalized(), np.float64)
    pixels = np.diag([width / 2, height / 2, 1.0, 1.0])
    pixels[:2, 3] = width / 2, height / 2
    return View(
        perspective=thing.data.type == "PERSP",
        eye=pose[:3, 3],
        forward=-pose[:3, 2],
        pixel=2.0 / (projection[0, 0] * width),
        film_from_world=pixels @ projection @ np.linalg.inv(pose),
    )


def size(scene: bpy.types.Scene) -> tuple[int, int]:
    """Width and height of the rendered image in pixels."""
    render = scene.render
    fraction = render.resolution_percentage / 100
    return int(render.resolution_x * fraction), int(render.resolution_y * fraction)


def border_edges(depsgraph) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Ends of the edges with one face of all meshes that are rendered, in world space."""
    found, known = [np.empty((0, 2, 3))], {}
    for instance in depsgraph.object_instances:
        thing = instance.object
        if thing.type not in {"MESH", "CURVE", "SURFACE", "FONT", "META"} or thing.hide_render:
            continue
        key = thing.original.name, getattr(thing.data, "name", "")
        if key not in known:
            known[key] = mesh_borders(thing)
        matrix = np.array(instance.matrix_world, np.float64)
        found.append(known[key] @ matrix[:3, :3].T + matrix[:3, 3])
    edges = np.concatenate(found)
    return edges[:, 0], edges[:, 1]


def mesh_borders(thing) -> NDArray[np.float64]:
    """(n, 2, 3) ends of the border edges of an evaluated object, in its own space."""
    mesh = thing.to_mesh()
    if mesh is None or not len(mesh.loops):
        return np.empty((0, 2, 3))
    used = np.empty(len(mesh.loops), np.int32)
    mesh.loops.foreach_get("edge_index", used)
    edges = np.empty(2 * len(mesh.edges), np.int32)
    mesh.edges.foreach_get("vertices", edges)
    points = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", points)
    border = np.bincount(used, minlength=len(mesh.edges)) == 1
    ends = points.reshape(-1, 3)[edges.reshape(-1, 2)[border]].astype(np.float64)
    thing.to_mesh_clear()
    return ends


# ---- rendering -----------------------------------------------------------


def render_cycles(scene: bpy.types.Scene, path: Path, samples: int, seed: int = 0) -> Frame:
    """The frame by Cycles, which ignores Ctrl-C: a process of the command line ends at once."""
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.seed = samples, seed
    write_to(scene, path)
    began = time.perf_counter()
    with open_file.quiet():
        bpy.ops.render.render(write_still=True, scene=scene.name)
    seconds = time.perf_counter() - began
    return Frame(read(path), seconds)


def render_leapray(scene: bpy.types.Scene, path: Path, samples: int, traverser: str) -> Frame:
    """The frame by LeapRay through one traverser; the scene's other settings stay."""
    scene.render.engine = "LEAPRAY"
    scene.leapray.samples = samples
    scene.leapray.traverser = traverser
    write_to(scene, path)
    began = time.perf_counter()
    reports = open_file.render_frame(scene)
    seconds = time.perf_counter() - began
    report = next(iter(reports.values()), {})
    if not path.exists():
        raise LeapRayError("LeapRay gave no picture")
    return Frame(read(path), seconds, dict(report))


def write_to(scene: bpy.types.Scene, path: Path) -> None:
    """Have Blender write 32-bit multilayer EXR to this file, and remove what is there."""
    path.unlink(missing_ok=True)
    open_file.set_format(scene, path, CHANNELS)
    scene.render.image_settings.exr_codec = "NONE"


def open_image_io():
    """OpenImageIO's module; LeapRayError where this Blender has none."""
    oiio = openimageio()
    if oiio is None:
        raise LeapRayError(
            "A comparison reads EXR files by OpenImageIO's Python module, which this Blender has "
            "not; start it by build.py"
        )
    return oiio


def read(path: Path) -> dict[str, NDArray[np.float32]]:
    """The passes of a multilayer EXR, of one part or of many; rows from below."""
    source = open_image_io().ImageInput.open(os.fspath(path))
    if source is None:
        raise LeapRayError(f"{path.name} cannot be read as an EXR file")
    planes: dict[str, NDArray[np.float32]] = {}
    part = 0
    while source.seek_subimage(part, 0):
        names = source.spec().channelnames
        pixels = source.read_image(part, 0, 0, len(names), "float")
        for k, name in enumerate(names):
            planes[name.split(".", 1)[1]] = pixels[::-1, :, k]
        part += 1
    source.close()
    passes = {}
    for name, (layers, channels) in CHANNELS.items():
        for layer in layers:
            found = [planes.get(f"{layer}.{channel}") for channel in channels]
            if all(plane is not None for plane in found):
                stacked = np.stack(cast(list[NDArray], found), axis=-1)
                passes[name] = np.ascontiguousarray(
                    stacked[..., 0] if stacked.shape[-1] == 1 else stacked
                )
    return passes
