# SPDX-License-Identifier: GPL-3.0-or-later
"""The settings, each described once (no bpy).

`Settings` is what the user chooses for a scene, `Modelling` for an object, `Isosurfaces` for
the data of a volume. Blender's properties, the options of the command line, what is refused before
a render and docs/settings.md follow from the fields' descriptions; choices of the core's are its
own.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import leapray
from leapray._abi import LR_BOUNCES_MAX, LR_BRANCHES_MAX
from leapray.arrays import INTERPOLATIONS, SAMPLE_TYPES, about
from leapray.voxelization import EXACT, FILTERS, KINDS, filter_info

from . import methods
from .descriptions import WHOLE_MAX, Choice, Switch, described, sentence, setting

# ---- choices -----------------------------------------------------------------

LABELS = {
    "u8": "8 Bit (u8)",
    "u16": "16 Bit (u16)",
    "f32": "32 Bit Float (f32)",
    "auto": "Automatic",
    "blackman_harris": "Blackman-Harris",
}


def label_of(name: str) -> str:
    return LABELS.get(name, name.capitalize())


def choices(members: Mapping[str, IntEnum], auto: str = "") -> tuple[Choice, ...]:
    """Of an enum of the core, as leapray.h describes them; auto: what "auto" does, if it is one."""
    told = {"auto": auto} if auto else {}
    told |= {name: sentence(about(member)) for name, member in members.items()}
    return tuple(Choice(name, label_of(name), tooltip) for name, tooltip in told.items())


def method_spec(word: str) -> str:
    """A render method with its options, in full. Raises LeapRayError for an unknown one."""
    return methods.find(word).spec


def traverser_spec(word: str) -> str:
    """Likewise a traverser, or the wish for the fastest."""
    return word if word == FASTEST else leapray.traverser(word).spec


def traversers() -> Iterable[Choice]:
    """The wish for the fastest, and every traverser with every choice of its options, below what
    they promise.

    An entry is called as in charts, and as on the command line.
    """
    yield Choice("", "By Trial", "Each volume gets its own; all that are tried are exact")
    tooltip = "That of a few which trial rays find to be the fastest in each volume: see the report"
    yield Choice(FASTEST, f"Fastest ({FASTEST})", tooltip)
    for exact, heading, promise in (
        (True, "Exact", "They miss no cell that the ray touches"),
        (False, "Inexact", "They may miss cells, or find wrong ones: for measurements"),
    ):
        yield Choice("", heading, promise)
        for entry in leapray.variants():
            if entry.exact == exact:
                tooltip = f"{sentence(entry.about)} ({entry.source})"
                yield Choice(entry.spec, f"{entry.label} ({entry.spec})", tooltip)


FASTEST = "auto"  # in place of a traverser
AS_SCENE = Choice("scene", "As Scene", "What the scene's settings say", 0)
FILTER_CHOICES = choices(FILTERS)
LAYOUT_CHOICES = (
    Choice("objects", "Objects", "One volume for each distinct mesh, shared by its instances"),
    Choice("scene", "Scene", "One volume for the whole scene"),
)
SAMPLE_TYPE_CHOICES = choices(
    SAMPLE_TYPES,
    "What a volume's error permits: 8 bit where nobody sees it, 32 where 16 are too few",
)
EXACT_CHOICES = choices(
    {name: member for name, member in EXACT.items() if name != "every"},  # for measurements
    "Those of open surfaces, and of solids where creases or thin walls are worth it",
)
CLIP_CHOICES = (
    Choice("outside", "Outside", "What lies inside the object, or before it, is cut away"),
    Choice("inside", "Inside", "What lies outside the object, or behind it, is cut away"),
)
SHOWN_CHOICES = (
    Choice(
        "auto",
        "Automatic",
        "Labels where the data are such; a volume where the first material has no surface, but of "
        "level sets; else thresholds",
    ),
    Choice("threshold", "Thresholds", "The surfaces where values pass thresholds"),
    Choice("labels", "Labels", "Whole numbers name bodies, 0 none; each may have a material"),
    Choice(
        "volume",
        "Volume",
        "What the volume shader of the first material makes of the values: it absorbs and emits "
        "light, without a surface",
    ),
)
# The half width in whole voxels that every filter takes.
WIDEST = math.floor(min(filter_info(name, "f32").widest for name in FILTERS))


# ---- the settings ------------------------------------------------------------


def bounces(default: int, label: str, tooltip: str) -> Any:
    """A limit of bounces, as Cycles has it."""
    return setting(default, label, tooltip, 0, LR_BOUNCES_MAX, soft_maximum=64)


def samples_along(label: str, tooltip: str, **more: Any) -> Any:
    """A number of samples along the longest side of a volume; 0 leaves it to others."""
    return setting(0, label, tooltip, 0, 16384, soft_maximum=1024, **more)


@dataclass(frozen=True)
class Settings:
    """What the user may choose, in the panel and on the command line alike.

    The defaults are Cycles' own where it has the setting.
    """

    method: str = setting(
        methods.RAYS.spec,
        "Render Method",
        "What the picture shows: light by rays, first cells of surfaces, or projected values of "
        "volume data",
        choices=tuple(methods.choices()),
        check=method_spec,
    )
    samples: int = setting(
        256,
        "Samples",
        "Rays per pixel, spread over the pixel; the geometry passes use its centre",
        1,
        65536,
        soft_maximum=256,
    )
    noise_threshold: float = setting(
        0.01,
        "Noise Threshold",
        "Pixels whose estimated noise is below this get no more samples; 0 gives all pixels the "
        "same",
        0.0,
        10.0,
        soft_maximum=1.0,
        digits=4,
        zero=Switch(
            "Use Noise Threshold",
            "Give no more samples to pixels that are good enough",
            0.01,
            automatic=False,
        ),
    )
    min_samples: int = setting(
        0,
        "Min Samples",
        "Samples that every pixel gets before its noise is judged; 0 takes what suits the "
        "threshold",
        0,
        4096,
        soft_maximum=256,
        zero=Switch("Automatic Min Samples", "Take as many as suit the noise threshold", 64),
    )
    pixel_filter: str = setting(
        "blackman_harris",
        "Pixel Filter",
        "How samples near a pixel are weighted",
        choices=choices(leapray.PIXEL_FILTERS),
    )
    filter_width: float = setting(
        1.5,
        "Filter Width",
        "Width of the pixel filter in pixels",
        0.01,
        10.0,
        soft_maximum=3.0,
        unit="PIXEL",
    )
    max_bounces: int = bounces(12, "Max Bounces", "Most bounces of light in all")
    diffuse_bounces: int = bounces(
        4,
        "Diffuse Bounces",
        "Most diffuse bounces; 0 leaves surfaces without light from each other, which is fast",
    )
    glossy_bounces: int = bounces(4, "Glossy Bounces", "Most reflections")
    transmission_bounces: int = bounces(12, "Transmission Bounces", "Most refractions")
    transparent_bounces: int = bounces(
        8,
        "Transparent Bounces",
        "Most surfaces that light passes straight, by alpha or a Transparent BSDF",
    )
    volume_bounces: int = bounces(
        0,
        "Volume Bounces",
        "Most times that volumes scatter light which they have scattered once",
    )
    branches: int = setting(
        1,
        "Branches",
        "Rays of one sample that may be on their way at a time: where a surface both reflects and "
        "refracts, more are followed and fewer left to chance, which takes longer than it spares "
        "samples",
        1,
        LR_BRANCHES_MAX,
        option=False,
    )
    clamp_direct: float = setting(
        0.0,
        "Clamp Direct",
        "The most light that one sample brings from lights that its surface sees; 0 lets all "
        "through",
        0.0,
        1e8,
        soft_maximum=100.0,
        zero=Switch("Use Clamp Direct", "Limit direct light", 10.0, automatic=False),
    )
    clamp_indirect: float = setting(
        10.0,
        "Clamp Indirect",
        "The most light that one sample brings after more than one bounce: less noise, some light "
        "lost; 0 lets all through",
        0.0,
        1e8,
        soft_maximum=100.0,
        zero=Switch("Use Clamp Indirect", "Limit bounced light", 10.0, automatic=False),
    )
    nested: bool = setting(
        False,
        "Nested Glass",
        "Solids that lie in each other or touch bend light by the ratio of their indices, as "
        "water in a tumbler does; off, every surface bends it by its own index, as in Cycles",
    )
    ambient_distance: float = setting(
        0.0,
        "Ambient Distance",
        "Where no diffuse bounce is left, surfaces still see the world where nothing lies within "
        "this distance: a fast stand-in for bounced light, as Cycles' Fast GI; 0 is off",
        0.0,
        1e9,
        soft_maximum=100.0,
        unit="DISTANCE",
        zero=Switch(
            "Use Ambient Distance",
            "Let the world stand in for light that would bounce further",
            10.0,
            automatic=False,
        ),
    )
    ao_distance: float = setting(
        10.0,
        "AO Distance",
        "How far away things darken the Ambient Occlusion pass",
        1e-6,
        1e9,
        soft_minimum=0.01,
        soft_maximum=100.0,
        unit="DISTANCE",
    )
    traverser: str = setting(
        leapray.traverser().spec,
        "Traverser",
        "How a ray finds the next cell of a volume that may hold a surface",
        choices=tuple(traversers()),
        check=traverser_spec,
    )
    hit_test: str = setting(
        "extrema",
        "Hit Test",
        "How a cell is asked whether the ray meets the surface inside it",
        choices=choices(leapray.HIT_TESTS),
    )
    root: str = setting(
        "newton", "Root", "How the place of the hit is found", choices=choices(leapray.ROOTS)
    )
    normal: str = setting(
        "central",
        "Normal",
        "How the surface's normal is found",
        choices=choices(leapray.NORMALS),
    )
    volume_sampling: str = setting(
        "exact",
        "Volume Sampling",
        "How light adds up along rays through volume data without a surface",
        choices=choices(leapray.SAMPLINGS),
    )
    step: float = setting(
        1.0,
        "Step",
        "How far apart samples of volume data, and those of the uniform hit test, lie, in voxels",
        0.01,
        100.0,
        soft_minimum=0.1,
        soft_maximum=8.0,
    )
    stop_opacity: float = setting(
        1.0,
        "Stop Opacity",
        "How opaque volume data become along a ray before it ends, at the cost of what lies "
        "behind; 1 never ends it",
        0.01,
        1.0,
        digits=4,
    )
    layout: str = setting("objects", "Layout", "What shares a volume", choices=LAYOUT_CHOICES)
    resolution: int = samples_along(
        "Resolution",
        "Samples along the longest side of each volume; 0 takes as many as the pixel error asks "
        "for",
        zero_word="auto",
        zero=Switch(
            "Automatic Resolution",
            "Take as many samples as the pixel error asks for, for each volume its own",
            256,
        ),
    )
    pixel_error: float = setting(
        0.25,
        "Pixel Error",
        "How far a surface may lie from its true place, as a fraction of a pixel",
        0.001,
        1000.0,
        soft_minimum=0.05,
        soft_maximum=4.0,
        digits=3,
    )
    memory_mb: int = setting(
        1024,
        "Memory (MB)",
        "Megabytes that volumes and their structures may take, with what making them takes; what "
        "does not fit is modelled more coarsely, with a warning",
        1,
        1 << 24,
        soft_minimum=64,
        in_presets=False,
    )
    sample_type: str = setting(
        "auto",
        "Sample Type",
        "How the samples of volumes are stored",
        choices=SAMPLE_TYPE_CHOICES,
    )
    filter: str = setting(
        "ramp",
        "Filter",
        "How occupancy falls across the surface of volumes",
        choices=FILTER_CHOICES,
    )
    half_width: float = setting(
        0.0,
        "Half Width",
        "Voxels over which the filter reaches to either side, of gauss its sigma; 0 takes what "
        "suits filter and sample type",
        0.0,
        float(WIDEST),
        soft_maximum=4.0,
        zero=Switch("Automatic Half Width", "Take what suits the filter and the sample type", 2.5),
    )
    exact: str = setting(
        "auto",
        "Exact Cells",
        "Whose cells keep their triangles where samples cannot hold the surface: at borders, "
        "junctions, creases, thin walls and gaps",
        choices=EXACT_CHOICES,
    )
    cache_folder: str = setting(
        "",
        "Cache Folder",
        "Where volumes are kept as .vdb files, to be read instead of made by the next render; "
        "empty: nowhere",
        unit="DIR_PATH",
        in_presets=False,
    )
    seed: int = setting(
        0,
        "Seed",
        "Choose another pattern of rays inside the pixels",
        0,
        WHOLE_MAX,
        in_presets=False,
    )
    threads: int = setting(
        0,
        "Threads",
        "Threads that render; 0 takes one for each core",
        0,
        1024,
        in_blender=False,
        in_presets=False,
    )
    tile_size: int = setting(
        64,
        "Tile Size",
        "Pixels along the side of a tile, the piece of the image that a thread takes",
        8,
        4096,
        soft_maximum=256,
        option=False,
        in_presets=False,
    )

    def trace_options(self, mode: str) -> dict[str, Any]:
        """What of these leapray.trace takes in a mode."""
        if mode == "surface":
            return {name: getattr(self, name) for name in ("hit_test", "root", "normal", "step")}
        if mode == "volume":
            own = {name: getattr(self, name) for name in ("step", "stop_opacity")}
            return {**own, "sampling": self.volume_sampling}
        return {}


@dataclass(frozen=True)
class Modelling:
    """How a mesh becomes a volume, where its object says more than the scene."""

    kind: str = setting("auto", "Kind", "What the object's mesh stands for", choices=choices(KINDS))
    resolution: int = samples_along(
        "Resolution",
        "Samples along the longest side of the object's volume; 0 leaves it to the scene",
        zero=Switch("Resolution as Scene", "Leave it to the scene's settings", 128),
    )
    filter: str = setting(  # "": the scene's
        "",
        "Filter",
        "How the object's mesh becomes samples",
        choices=(AS_SCENE, *FILTER_CHOICES),
    )
    sample_type: str = setting(  # "": the scene's
        "",
        "Sample Type",
        "How the samples of the object's volume are stored",
        choices=(AS_SCENE, *SAMPLE_TYPE_CHOICES),
    )


def surface_value(label: str, tooltip: str) -> Any:
    return setting(0.0, label, f"{tooltip}, in the units of the data", digits=4)


@dataclass(frozen=True)
class Isosurfaces:
    """Which surfaces of a volume's data are rendered."""

    file: str = setting(
        "",
        "Data File",
        "Measured data in another format than OpenVDB, in place of the volume's own file; a name "
        "that begins with // is relative to the .blend",
        unit="FILE_PATH",
    )
    grid: str = setting(
        "",
        "Grid",
        "The name of the grid that is rendered; empty: the active one if its values are single "
        "numbers, else the first such grid",
    )
    frame: int = setting(
        0,
        "Frame",
        "Which of several frames of the data file, from 0",
        0,
        WHOLE_MAX,
    )
    shown: str = setting("auto", "Show", "What the values stand for", choices=SHOWN_CHOICES)
    gradient_shading: float = setting(
        0.0,
        "Gradient Shading",
        "Of a volume that scatters light: how much of that boundaries in the data reflect like "
        "surfaces, whose normal is the gradient; the rest goes as the shader's phase function says",
        0.0,
        1.0,
        zero=Switch("Use Gradient Shading", "Shade boundaries like surfaces", 1.0, False),
    )
    gradient_scale: float = setting(
        10.0,
        "Gradient Scale",
        "How soon a change of the values counts as a boundary. At 10, values that change from one "
        "voxel to the next by a tenth of the range that the shader shows reflect 63 % like a "
        "surface, by a third 96 %; raise it for soft boundaries, lower it where noise is shaded",
        0.0,
        1e6,
        soft_maximum=100.0,
    )
    gradient_roughness: float = setting(
        0.5, "Roughness", "Of the highlights of boundaries: 0 is nearly a mirror", 0.0, 1.0
    )
    gradient_specular: float = setting(
        0.5,
        "Specular",
        "How strong the highlights of boundaries are, as in a Principled BSDF; 0 has none",
        0.0,
        1.0,
    )
    gradient_modulation: float = setting(
        0.0,
        "Gradient Modulation",
        "Of a volume: fade out what is homogeneous, so that boundaries show through it. The change "
        "of the values from one voxel to the next, as a share of the range that the shader shows, "
        "from which on all is seen; what changes half as much is half as dense. 0 is off",
        0.0,
        1e6,
        soft_maximum=1.0,
        zero=Switch("Use Gradient Modulation", "Fade out what is homogeneous", 0.2, False),
    )
    label_colors: bool = setting(
        True,
        "Color per Label",
        "Where there is no more than one material, each label has it in a colour of its own: "
        "the file's, else one of a table",
    )
    label_index: bool = setting(
        False,
        "Label as Object Index",
        "The Object Index pass has the label in place of the object's own index",
    )
    automatic: bool = setting(
        True,
        "Automatic Threshold",
        "Find a first threshold in the data: 0 for level sets, half for densities, else what parts "
        "the values best",
    )
    threshold: float = surface_value("Threshold", "The value on the surface")
    surfaces: int = setting(
        1, "Surfaces", "How many surfaces are rendered, each at a threshold", 1, 3
    )
    threshold_2: float = surface_value("Threshold 2", "The value on the second surface")
    threshold_3: float = surface_value("Threshold 3", "The value on the third surface")
    invert: bool = setting(
        False,
        "Invert",
        "Take for the inside what lies outside: below the threshold, of level sets above it",
    )
    smoothing: float = setting(
        0.0,
        "Smoothing",
        "Samples over which the data are averaged by a Gaussian, as its standard deviation: less "
        "noise, rounder edges",
        0.0,
        16.0,
        soft_maximum=4.0,
    )
    interpolation: str = setting(
        "linear", "Interpolation", "The field between the samples", choices=choices(INTERPOLATIONS)
    )
    least: int = setting(
        0,
        "Smallest Part",
        "Parts of fewer samples are left out, such as specks of noise",
        0,
        WHOLE_MAX,
        soft_maximum=10000,
    )
    capped: bool = setting(
        True,
        "Cap",
        "Close surfaces where the data end; off, they have a hole there",
    )
    clip_object: Any = setting(  # noqa: RUF009
        None,
        "Clip Object",
        "What cuts the data open, and may be hidden: a closed mesh or an empty cube takes what it "
        "holds, a flat mesh or another empty all that lies before it, where its Z axis points. The "
        "faces of the cut have the material after the surfaces' own",
        object_types=("MESH", "EMPTY"),
    )
    clip_keep: str = setting(
        "outside", "Keep", "What stays of the data where an object cuts them", choices=CLIP_CHOICES
    )


SETTINGS = described(Settings)
