# SPDX-License-Identifier: GPL-3.0-or-later
"""A scene in plain arrays: what `scene` reads and everything after it works on (no bpy)."""

from __future__ import annotations

from dataclasses import astuple, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

import leapray
from leapray import Camera, Lobe, Program

from .memory import Resident

Color = tuple[float, float, float]  # linear RGB


SAMPLE_TYPES = ("auto", "u8", "u16", "f32")  # auto: the least that a volume's error permits


@dataclass(frozen=True)
class Modelling:
    """How a mesh becomes a volume, where its object says more than the scene."""

    kind: str = "auto"  # "auto" | "solid" | "sheet"
    resolution: int = 0  # samples along its volume's longest side; 0: as the scene
    filter: str = ""  # of the voxelization; "": the scene's
    sample_type: str = ""  # one of SAMPLE_TYPES; "": the scene's


def numbers(thing: Any) -> NDArray[np.float32]:
    """All numbers of a lobe or a light, as f32 holds them."""
    told = (value for value in astuple(thing) if not isinstance(value, str))
    with np.errstate(over="ignore"):
        return np.concatenate([np.ravel(value) for value in told]).astype(np.float32)


@dataclass(frozen=True)
class Mesh:
    """One distinct evaluated mesh in its own space; instances share it."""

    name: str
    vertices: NDArray[np.float32]  # (n, 3)
    triangles: NDArray[np.int32]  # (m, 3)
    slots: NDArray[np.uint16] | None = None  # (m,) material slot of each triangle; None: all 0
    corner_normals: NDArray[np.float32] | None = None  # (m, 3, 3) unit; None: flat throughout
    corner_colors: NDArray[np.float32] | None = None  # (m, 3, 3) linear RGB of the vertex colours
    corner_uvs: NDArray[np.float32] | None = None  # (m, 3, 2)
    modelling: Modelling = field(default_factory=Modelling)
    solids: NDArray[np.int32] | None = None  # (m,) ascending: of which solid a triangle is, where
    # several share a volume; their slots are then ids, none in two of them


@dataclass(frozen=True)
class Image:
    """A texture. A texel's centre lies at u = (x + 0.5) / width, v = (y + 0.5) / height."""

    name: str
    pixels: NDArray[np.float32] | NDArray[np.uint8] | None  # (height, width, 3) RGB, rows from
    # below: linear, or in sRGB, which is interpolated as such; or what the program takes,
    # as leapray.Texture says; None: the mesh's own colours
    interpolation: str = "linear"  # "linear" | "closest" | "cubic"
    extension: str = "repeat"  # "repeat" | "extend" | "clip" (black outside) | "mirror"
    program: Program | None = None  # makes linear RGB of what is looked up


@dataclass(frozen=True)
class Instance:
    """A mesh placed in the world."""

    name: str  # of the object, for messages
    mesh: int  # index into Scene.meshes
    world_from_object: NDArray[np.float64]  # (4, 4)
    materials: tuple[int, ...]  # per slot, indices into Scene.materials; at least one
    object_index: int = 0  # Blender's pass index
    visible_camera: bool = True
    visible_shadow: bool = True
    visible_diffuse: bool = True
    visible_glossy: bool = True
    visible_transmission: bool = True
    holdout: bool = False  # the camera sees a hole in the picture


@dataclass(frozen=True)
class Material:
    """What a surface does to light: the sum of its lobes."""

    name: str
    lobes: tuple[Lobe, ...]
    color_source: str = ""  # of textured lobes: "vertex" | "image"
    attribute: str = ""  # the colours' or UVs' name in the mesh
    image: Image | None = None
    absorption: Color = (0.0, 0.0, 0.0)  # inside solids, per unit of world length
    index: int = 0  # Blender's pass index

    @property
    def base_color(self) -> Color:
        """Of the first lobe, where there is one."""
        return self.lobes[0].color if self.lobes else (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Light(leapray.Light):
    """A light of the core's with its name, for messages."""

    name: str = ""


@dataclass(frozen=True)
class World(leapray.World):
    """What surrounds the scene, as the core has it; the image is not its texture yet."""

    image: Image | None = None  # type: ignore[assignment]


EXACT = ("auto", "sheets", "all", "none")  # auto: of sheets, and of solids where it is worth it
LAYOUTS = ("objects", "scene")  # what shares a volume: the instances of a mesh, or all


@dataclass(frozen=True)
class Settings:
    """What the user may choose, in the panel and on the command line alike.

    The defaults are Cycles' own where it has the setting.
    """

    samples: int = 256
    noise_threshold: float = 0.01  # at which a pixel gets no more samples; 0: never
    min_samples: int = 0  # before that; 0: by the threshold
    pixel_filter: str = "blackman_harris"  # or "box", of one pixel
    filter_width: float = 1.5  # pixels, of the former
    max_bounces: int = 12  # in all, without transparent_bounces
    diffuse_bounces: int = 4
    glossy_bounces: int = 4
    transmission_bounces: int = 12
    transparent_bounces: int = 8
    branches: int = 0  # rays of one sample on their way at a time; 0: by the samples
    clamp_direct: float = 0.0  # most that a sample brings of lights it sees; 0: all
    clamp_indirect: float = 10.0  # of what is scattered more than once
    nested: bool = False  # glass in glass bends by the ratio of indices; off: as in Cycles
    ambient_distance: float = 0.0  # within it things darken the world's light; 0: no such light
    ao_distance: float = 10.0  # reach of ambient occlusion, in world space
    traverser: str = ""  # "" is the core's default
    hit_test: str = "extrema"
    root: str = "newton"
    normal: str = "central"
    layout: str = "objects"  # one of LAYOUTS
    resolution: int = 0  # samples along the longest side of each volume; 0: the plan decides
    pixel_error: float = 0.25  # of a pixel's footprint
    memory_mb: int = 1024  # for volumes, structures and the scratch to make them
    sample_type: str = "auto"  # one of SAMPLE_TYPES
    filter: str = "ramp"  # how occupancy falls across the surface, see leapray.voxelize
    half_width: float = 0.0  # of the filter, in voxels; 0: its own
    exact: str = "auto"  # whose cells keep their triangles: one of EXACT
    cache_folder: str = ""  # where volumes are kept as .vdb; "": nowhere
    seed: int = 0
    threads: int = 0  # 0: all cores
    tile_size: int = 64


@dataclass(frozen=True)
class Scene:
    """One frame of one view layer."""

    meshes: tuple[Mesh, ...]
    instances: tuple[Instance, ...]
    materials: tuple[Material, ...]
    lights: tuple[Light, ...]
    camera: Camera
    world: World
    film_transparent: bool
    width: int  # pixels rendered (the border's size where there is one)
    height: int
    settings: Settings
    passes: tuple[str, ...] = ("Combined", "Depth", "Normal", "Position", "Object Index")
    mist: tuple[float, float, str] = (5.0, 25.0, "QUADRATIC")  # start, depth, Blender's falloff
    film_exposure: float = 1.0  # multiplies the light of the passes
    warnings: tuple[str, ...] = ()
    seconds_read: float = 0.0
    resident: Resident | None = None  # what the process took before the scene was read


@dataclass
class Frame:
    """A rendered frame: the passes, rows from below, and how they came about."""

    passes: dict[str, NDArray[np.float32]]  # "Combined" (h, w, 4), "Depth" (h, w, 1), ...
    report: dict[str, Any] = field(default_factory=dict)  # becomes the JSON beside the picture
    warnings: list[str] = field(default_factory=list)
