# SPDX-License-Identifier: GPL-3.0-or-later
"""A scene in plain arrays: what `scene` reads and everything after it works on (no bpy)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray


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


@dataclass(frozen=True)
class Image:
    """A texture. A texel's centre lies at u = (x + 0.5) / width, v = (y + 0.5) / height."""

    name: str
    pixels: NDArray[np.float32]  # (height, width, 3) linear RGB, rows from below
    interpolation: str = "linear"  # "linear" | "closest"
    extension: str = "repeat"  # "repeat" | "extend" | "clip" (black outside) | "mirror"


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


@dataclass(frozen=True)
class Material:
    """A Lambertian surface."""

    name: str
    base_color: tuple[float, float, float]


@dataclass(frozen=True)
class Light:
    """A light without extent."""

    name: str
    kind: str  # "sun" | "point"
    color: tuple[float, float, float]  # sun: irradiance facing it; point: radiant intensity
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    direction: tuple[float, float, float] = (0.0, 0.0, 1.0)  # unit, towards a sun
    casts_shadow: bool = True


@dataclass(frozen=True)
class Camera:
    """Rays through the film; see lr_camera in leapray.h. Film: pixels from the lower left."""

    projection: str  # "perspective" | "orthographic"
    eye: NDArray[np.float64]  # (3,) world space
    forward: NDArray[np.float64]  # (3,) unit
    corner: NDArray[np.float64]  # (3,)
    dx: NDArray[np.float64]  # (3,) one pixel to the right
    dy: NDArray[np.float64]  # (3,) one pixel up
    clip_start: float
    clip_end: float


LAYOUTS = ("objects", "scene")  # what shares a volume: the instances of a mesh, or all


@dataclass(frozen=True)
class Settings:
    """What the user may choose, in the panel and on the command line alike."""

    samples: int = 16
    traverser: str = ""  # "" is the core's default
    hit_test: str = "extrema"
    root: str = "newton"
    normal: str = "central"
    layout: str = "objects"  # one of LAYOUTS
    resolution: int = 0  # samples along the longest side of each volume; 0: the plan decides
    pixel_error: float = 0.25  # of a pixel's footprint
    memory_mb: int = 1024  # for volumes and structures together
    sample_type: str = "u16"
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
    world_color: tuple[float, float, float]
    film_transparent: bool
    width: int  # pixels rendered (the border's size where there is one)
    height: int
    settings: Settings
    warnings: tuple[str, ...] = ()
    seconds_read: float = 0.0


@dataclass
class Frame:
    """A rendered frame: the passes, rows from below, and how they came about."""

    passes: dict[str, NDArray[np.float32]]  # "Combined" (h, w, 4), "Depth" (h, w, 1), ...
    report: dict[str, object] = field(default_factory=dict)  # becomes the JSON beside the picture
    warnings: list[str] = field(default_factory=list)
