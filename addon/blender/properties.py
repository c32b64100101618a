# SPDX-License-Identifier: GPL-3.0-or-later
"""The settings of a scene, `scene.leapray`: one property for each of model.Settings.

A property is named as its option of the command line. Menus are made from the
core's own tables. Only the number of threads is Blender's (Performance panel,
`blender -t`), as for its other engines. Where 0 stands for "automatic" or "off",
a switch that is not stored says so.
"""

# Annotations stay values here, for Blender evaluates them.

import os
import zlib
from dataclasses import fields

import bpy

import leapray
from leapray.voxelization import FILTERS, KINDS

from .. import model

DEFAULTS = model.Settings()

ABOUT = {  # of menu entries; a test asks for those of a new one in the core
    "extrema": "Also look at the field's extrema inside a cell, so that no surface is lost",
    "faces": "Look at the field on the faces of cells only: fast, but loses grazing surfaces",
    "uniform": "Look at the field at equal steps along the ray: loses what lies between them",
    "newton": "Newton's steps inside a bracket, to full precision",
    "bisect": "Halving of a bracket, to full precision: slower",
    "cubic": "The roots of the cubic in closed form, to full precision",
    "linear": "One linear interpolation: fast and approximate",
    "central": "Central differences, interpolated: smooth",
    "analytic": "The gradient of the field itself: faceted at cell borders",
    "smooth": "The gradients of the eight cells around, blended: smooth, and slower",
    "objects": "One volume for each distinct mesh, shared by its instances",
    "scene": "One volume for the whole scene",
    "box": "The mean over the pixel itself: sharp edges",
    "blackman_harris": "Cycles' own: smooth edges, no stair steps",
    "ramp": "Linear in the distance to the surface",
    "cone": "The hypercone of Wang and Kaufman: soft",
    "gauss": "Gaussian: soft",
    "binary": "Inside or outside, nothing between",
    "sheets": "Those of open surfaces",
    "all": "Those of solids too: sharper, and larger",
    "none": "None: a sheet ends with the cells that it touches",
    "auto": "A solid where the mesh is closed, a sheet where it is open",
    "solid": "What the mesh encloses",
    "sheet": "The surface alone, without an inside",
    "u8": "One byte per sample: smallest, for previews",
    "u16": "Two bytes per sample: as good as exact for most scenes",
    "f32": "Four bytes per sample: for measurements",
}
LABELS = {
    "u8": "8 Bit (u8)",
    "u16": "16 Bit (u16)",
    "f32": "32 Bit Float (f32)",
    "auto": "Automatic",
    "blackman_harris": "Blackman-Harris",
}


def menu(names, about=ABOUT, labels=LABELS) -> list[tuple[str, str, str, int]]:
    """Items of an EnumProperty.

    A file stores an entry's number; taken from its name, the number stays right
    when entries come and go.
    """
    return [
        (
            name,
            labels.get(name, name.capitalize()),
            about.get(name, ""),
            zlib.crc32(name.encode()) & 0x7FFFFFFF,
        )
        for name in names
    ]


def sentence(traverser) -> str:
    """A menu's word on a traverser with its options."""
    about = traverser.about[:1].upper() + traverser.about[1:]
    return f"{about} ({traverser.source})"


def traverser_menu() -> list[tuple]:
    """Every traverser with every choice of its options, below what they promise.

    An entry is called as in charts, and as on the command line.
    """
    items: list[tuple] = []
    for exact, heading, about in (
        (True, "Exact", "They miss no cell that the ray touches"),
        (False, "Inexact", "They may miss cells, or find wrong ones: for measurements"),
    ):
        here = [entry for entry in leapray.variants() if entry.exact == exact]
        items.append(("", heading, about))
        items += menu(
            [entry.spec for entry in here],
            {entry.spec: sentence(entry) for entry in here},
            {entry.spec: f"{entry.label} ({entry.spec})" for entry in here},
        )
    return items


def switch(name: str, label: str, description: str, on: float, *, zero: bool = False):
    """A check box for a setting whose 0 has a meaning of its own; it is not stored.

    It is ticked where the setting is not 0, or with zero where it is; `on` is the
    value that the setting gets where it was 0.
    """

    def ticked(self) -> bool:
        return (getattr(self, name) == 0) == zero

    def tick(self, value: bool) -> None:
        setattr(self, name, 0 if value == zero else getattr(self, name) or on)

    return bpy.props.BoolProperty(
        name=label, description=description, get=ticked, set=tick, options={"SKIP_SAVE"}
    )


def bounces(name: str, description: str, default: int) -> bpy.props.IntProperty:
    """A limit of bounces, as Cycles has it."""
    return bpy.props.IntProperty(
        name=name, description=description, default=default, min=0, max=1024, soft_max=64
    )


AS_SCENE = ("scene", "As Scene", "What the scene's settings say", 0)
EXACT_ABOUT = {
    **ABOUT,
    "auto": "Those of open surfaces, and of solids where creases or thin walls are worth it",
}
SAMPLE_TYPE_ABOUT = {
    **ABOUT,
    "auto": "What a volume's error permits: 8 bit where nobody sees it, 32 where 16 are too few",
}
VOXEL_FILTER_ABOUT = {**ABOUT, "box": "The exact share of the voxel that is inside"}


class LeapRaySettings(bpy.types.PropertyGroup):
    """What LeapRay renders with."""

    samples: bpy.props.IntProperty(
        name="Samples",
        description="Rays per pixel, spread over the pixel; the geometry passes use its centre",
        default=DEFAULTS.samples,
        min=1,
        soft_max=256,
        max=65536,
    )
    noise_threshold: bpy.props.FloatProperty(
        name="Noise Threshold",
        description="Pixels whose estimated noise is below this get no more samples; 0 gives all "
        "pixels the same",
        default=DEFAULTS.noise_threshold,
        min=0.0,
        soft_max=1.0,
        max=10.0,
        precision=4,
    )
    min_samples: bpy.props.IntProperty(
        name="Min Samples",
        description="Samples that every pixel gets before its noise is judged; 0 takes what suits "
        "the threshold",
        default=DEFAULTS.min_samples,
        min=0,
        soft_max=256,
        max=4096,
    )
    pixel_filter: bpy.props.EnumProperty(
        name="Pixel Filter",
        description="How samples near a pixel are weighted",
        items=menu(leapray.PIXEL_FILTERS),
        default=DEFAULTS.pixel_filter,
    )
    filter_width: bpy.props.FloatProperty(
        name="Filter Width",
        description="Width of the pixel filter in pixels",
        default=DEFAULTS.filter_width,
        min=0.01,
        soft_max=3.0,
        max=10.0,
        subtype="PIXEL",
    )
    max_bounces: bounces("Max Bounces", "Most bounces of light in all", DEFAULTS.max_bounces)
    diffuse_bounces: bounces(
        "Diffuse Bounces",
        "Most diffuse bounces; 0 leaves surfaces without light from each other, which is fast",
        DEFAULTS.diffuse_bounces,
    )
    glossy_bounces: bounces("Glossy Bounces", "Most reflections", DEFAULTS.glossy_bounces)
    transmission_bounces: bounces(
        "Transmission Bounces", "Most refractions", DEFAULTS.transmission_bounces
    )
    transparent_bounces: bounces(
        "Transparent Bounces",
        "Most surfaces that light passes straight, by alpha or a Transparent BSDF",
        DEFAULTS.transparent_bounces,
    )
    branches: bpy.props.IntProperty(
        name="Branches",
        description="Rays of one sample that may be on their way at a time: where a surface both "
        "reflects and refracts, more are followed and fewer left to chance; 0 takes what suits the "
        "samples",
        default=DEFAULTS.branches,
        min=0,
        max=16,
    )
    clamp_direct: bpy.props.FloatProperty(
        name="Clamp Direct",
        description="The most light that one sample brings from lights that its surface sees; 0 "
        "lets all through",
        default=DEFAULTS.clamp_direct,
        min=0.0,
        soft_max=100.0,
        max=1e8,
    )
    clamp_indirect: bpy.props.FloatProperty(
        name="Clamp Indirect",
        description="The most light that one sample brings after more than one bounce: less noise, "
        "some light lost; 0 lets all through",
        default=DEFAULTS.clamp_indirect,
        min=0.0,
        soft_max=100.0,
        max=1e8,
    )
    nested: bpy.props.BoolProperty(
        name="Nested Glass",
        description="Solids that lie in each other or touch bend light by the ratio of their "
        "indices, as water in a tumbler does; off, every surface bends it by its own index, as in "
        "Cycles",
        default=DEFAULTS.nested,
    )
    ambient_distance: bpy.props.FloatProperty(
        name="Ambient Distance",
        description="Where no diffuse bounce is left, surfaces still see the world where nothing "
        "lies within this distance: a fast stand-in for bounced light, as Cycles' Fast GI; 0 is "
        "off",
        default=DEFAULTS.ambient_distance,
        min=0.0,
        soft_max=100.0,
        max=1e9,
        subtype="DISTANCE",
    )
    ao_distance: bpy.props.FloatProperty(
        name="AO Distance",
        description="How far away things darken the Ambient Occlusion pass",
        default=DEFAULTS.ao_distance,
        min=1e-6,
        soft_min=0.01,
        soft_max=100.0,
        max=1e9,
        subtype="DISTANCE",
    )
    traverser: bpy.props.EnumProperty(
        name="Traverser",
        description="How a ray finds the next cell of a volume that may hold a surface",
        items=traverser_menu(),
        default=leapray.traverser().spec,
    )
    hit_test: bpy.props.EnumProperty(
        name="Hit Test",
        description="How a cell is asked whether the ray meets the surface inside it",
        items=menu(leapray.HIT_TESTS),
        default=DEFAULTS.hit_test,
    )
    root: bpy.props.EnumProperty(
        name="Root",
        description="How the place of the hit is found",
        items=menu(leapray.ROOTS),
        default=DEFAULTS.root,
    )
    normal: bpy.props.EnumProperty(
        name="Normal",
        description="How the surface's normal is found",
        items=menu(leapray.NORMALS),
        default=DEFAULTS.normal,
    )
    layout: bpy.props.EnumProperty(
        name="Layout",
        description="What shares a volume",
        items=menu(model.LAYOUTS),
        default=DEFAULTS.layout,
    )
    resolution: bpy.props.IntProperty(
        name="Resolution",
        description="Samples along the longest side of each volume; 0 takes as many as the "
        "pixel error asks for",
        default=DEFAULTS.resolution,
        min=0,
        soft_max=1024,
        max=16384,
    )
    pixel_error: bpy.props.FloatProperty(
        name="Pixel Error",
        description="How far a surface may lie from its true place, as a fraction of a pixel",
        default=DEFAULTS.pixel_error,
        min=0.001,
        soft_min=0.05,
        soft_max=4.0,
        max=1000.0,
        precision=3,
    )
    memory_mb: bpy.props.IntProperty(
        name="Memory (MB)",
        description="Megabytes that volumes and their structures may take, with what making "
        "them takes; what does not fit is modelled more coarsely, with a warning",
        default=DEFAULTS.memory_mb,
        min=1,
        soft_min=64,
        max=1 << 24,
    )
    sample_type: bpy.props.EnumProperty(
        name="Sample Type",
        description="How the samples of volumes are stored",
        items=menu(model.SAMPLE_TYPES, SAMPLE_TYPE_ABOUT),
        default=DEFAULTS.sample_type,
    )
    filter: bpy.props.EnumProperty(
        name="Filter",
        description="How occupancy falls across the surface of volumes",
        items=menu(FILTERS, VOXEL_FILTER_ABOUT),
        default=DEFAULTS.filter,
    )
    half_width: bpy.props.FloatProperty(
        name="Half Width",
        description="Voxels over which the filter reaches to either side, of gauss its sigma; "
        "0 takes what suits filter and sample type",
        default=DEFAULTS.half_width,
        min=0.0,
        soft_max=4.0,
        max=7.0,
    )
    exact: bpy.props.EnumProperty(
        name="Exact Cells",
        description="Whose cells keep their triangles where samples cannot hold the surface: at "
        "borders, junctions, creases, thin walls and gaps",
        items=menu(model.EXACT, EXACT_ABOUT),
        default=DEFAULTS.exact,
    )
    cache_folder: bpy.props.StringProperty(
        name="Cache Folder",
        description="Where volumes are kept as .vdb files, to be read instead of made by the next "
        "render; empty: nowhere",
        default=DEFAULTS.cache_folder,
        subtype="DIR_PATH",
    )
    seed: bpy.props.IntProperty(
        name="Seed",
        description="Choose another pattern of rays inside the pixels",
        default=DEFAULTS.seed,
        min=0,
    )
    tile_size: bpy.props.IntProperty(
        name="Tile Size",
        description="Pixels along the side of a tile, the piece of the image that a thread takes",
        default=DEFAULTS.tile_size,
        min=8,
        soft_max=256,
        max=4096,
    )

    use_noise_threshold: switch(
        "noise_threshold",
        "Use Noise Threshold",
        "Give no more samples to pixels that are good enough",
        0.01,
    )
    auto_min_samples: switch(
        "min_samples",
        "Automatic Min Samples",
        "Take as many as suit the noise threshold",
        64,
        zero=True,
    )
    auto_branches: switch(
        "branches", "Automatic Branches", "Take as many as suit the samples", 4, zero=True
    )
    use_clamp_direct: switch("clamp_direct", "Use Clamp Direct", "Limit direct light", 10.0)
    use_clamp_indirect: switch("clamp_indirect", "Use Clamp Indirect", "Limit bounced light", 10.0)
    use_ambient_distance: switch(
        "ambient_distance",
        "Use Ambient Distance",
        "Let the world stand in for light that would bounce further",
        10.0,
    )
    auto_resolution: switch(
        "resolution",
        "Automatic Resolution",
        "Take as many samples as the pixel error asks for, for each volume its own",
        256,
        zero=True,
    )
    auto_half_width: switch(
        "half_width",
        "Automatic Half Width",
        "Take what suits the filter and the sample type",
        2.5,
        zero=True,
    )


class LeapRayObject(bpy.types.PropertyGroup):
    """How LeapRay models an object, where that is not left to the scene."""

    kind: bpy.props.EnumProperty(
        name="Kind",
        description="What the object's mesh stands for",
        items=menu(KINDS),
        default="auto",
    )
    resolution: bpy.props.IntProperty(
        name="Resolution",
        description="Samples along the longest side of the object's volume; 0 leaves it to the "
        "scene",
        default=0,
        min=0,
        soft_max=1024,
        max=16384,
    )
    auto_resolution: switch(
        "resolution", "Resolution as Scene", "Leave it to the scene's settings", 128, zero=True
    )
    filter: bpy.props.EnumProperty(
        name="Filter",
        description="How the object's mesh becomes samples",
        items=[AS_SCENE, *menu(FILTERS, VOXEL_FILTER_ABOUT)],
        default="scene",
    )
    sample_type: bpy.props.EnumProperty(
        name="Sample Type",
        description="How the samples of the object's volume are stored",
        items=[AS_SCENE, *menu(model.SAMPLE_TYPES, SAMPLE_TYPE_ABOUT)],
        default="scene",
    )


class LeapRayViewLayer(bpy.types.PropertyGroup):
    """LeapRay's own passes of a view layer."""

    use_pass_steps: bpy.props.BoolProperty(
        name="Steps",
        description="How many cells the camera's rays stand in before they meet something: what "
        "the pixel costs",
    )
    use_pass_error: bpy.props.BoolProperty(
        name="Error",
        description="How far the surface that is seen may lie from its true place, in pixels",
    )
    use_pass_volume: bpy.props.BoolProperty(
        name="Volume",
        description="The number of the volume that is seen, in the order of the report",
    )


def modelling(ob) -> model.Modelling:
    """How the object wants to be modelled, as plain values; unknown choices are the scene's."""
    own = ob.leapray
    names = ("" if name == "scene" else name for name in (own.filter, own.sample_type))
    return model.Modelling(own.kind or "auto", own.resolution, *names)


def apply(scene, values: dict[str, object]) -> None:
    """Give settings of the scene these values, by the names of model.Settings."""
    for name, value in values.items():
        setattr(scene.leapray, name, value)


def settings(scene, view_layer=None) -> model.Settings:
    """The scene's settings as plain values, with the view layer's own number of samples.

    Raises LeapRayError for a choice that this LeapRay does not know, as from the
    file of a newer one: Blender reads it as an empty name.
    """
    values = {
        field.name: getattr(scene.leapray, field.name)
        for field in fields(model.Settings)
        if field.name != "threads"
    }
    for name, value in values.items():
        known = scene.leapray.bl_rna.properties[name]
        if value == "" and known.type == "ENUM":
            label = known.name
            raise leapray.LeapRayError(
                f"The {label} stored in scene {scene.name} is unknown to LeapRay "
                f"{leapray.__version__}; choose one in the Render properties"
            )
    values["cache_folder"] = os.path.expanduser(bpy.path.abspath(values["cache_folder"]))
    if view_layer is not None:
        values["samples"] = _samples_of(view_layer, scene, values["samples"])
    fixed = scene.render.threads_mode == "FIXED"
    return model.Settings(**values, threads=scene.render.threads if fixed else 0)


def _samples_of(view_layer, scene, samples: int) -> int:
    """What the view layer's own number of samples makes of the scene's; 0: it has none.

    Cycles' setting says whether it overrides the scene's, bounds it, or is ignored.
    """
    use = getattr(getattr(scene, "cycles", None), "use_layer_samples", "USE")
    own = 0 if use == "IGNORE" else view_layer.samples
    return min(samples, own or samples) if use == "BOUNDED" else own or samples


OWNERS = (  # the type that has `leapray`, the properties, what the user is told
    (bpy.types.Scene, LeapRaySettings, "Settings of the LeapRay engine"),
    (bpy.types.Object, LeapRayObject, "How LeapRay models the object"),
    (bpy.types.ViewLayer, LeapRayViewLayer, "LeapRay's own passes"),
)


def register() -> None:
    for owner, group, description in OWNERS:
        bpy.utils.register_class(group)
        owner.leapray = bpy.props.PointerProperty(
            type=group, name="LeapRay", description=description
        )


def unregister() -> None:
    for owner, group, _ in reversed(OWNERS):
        del owner.leapray
        bpy.utils.unregister_class(group)
