# SPDX-License-Identifier: GPL-3.0-or-later
"""What scenes are made of, as plain data: cameras, lights, materials, placed structures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._abi import LR_BOUNCES_MAX
from .attributes import Texture
from .programs import Program
from .tracing import Structure
from .volume import Volume

Vector = Any  # three numbers: a tuple, a list or an array


@dataclass(frozen=True)
class Camera:
    """Rays through the film, as lr_camera in leapray.h says; film points are in pixels."""

    projection: str  # "perspective" | "orthographic"
    eye: Vector  # world space, as all that follow
    forward: Vector
    corner: Vector
    dx: Vector
    dy: Vector
    clip_start: float = 0.0  # depths
    clip_end: float = np.inf


@dataclass(frozen=True)
class Light:
    """A light, as lr_light in leapray.h says."""

    kind: str  # "sun" | "point" | "spot" | "area"
    color: Vector  # sun: irradiance facing it; point, spot: radiant intensity; area: radiance
    position: Vector = (0.0, 0.0, 0.0)
    direction: Vector = (0.0, 0.0, 1.0)  # unit: towards a sun, the way that spot and area shine
    axis_u: Vector = (0.0, 0.0, 0.0)  # an area's whole side or diameter
    axis_v: Vector = (0.0, 0.0, 0.0)
    radius: float = 0.0  # of point and spot
    angle: float = 0.0  # full: a sun's disc, a spot's cone, an area's spread
    blend: float = 0.0  # share of the cone in which a spot fades
    shape: str = "disc"  # area: "rectangle" | "ellipse"; point and spot: "sphere" | "disc"
    plane_margin: float = 0.0  # of an area that lies in a surface: see leapray.h
    max_bounces: int = LR_BOUNCES_MAX  # surfaces behind more do not ask it
    casts_shadow: bool = True
    visible_camera: bool = False
    visible_diffuse: bool = True
    visible_glossy: bool = True
    visible_transmission: bool = True
    visible_volume_scatter: bool = True


@dataclass(frozen=True)
class Lobe:
    """What one part of a surface does to light, as lr_lobe in leapray.h says."""

    kind: str  # of LOBES
    color: Vector = (0.8, 0.8, 0.8)  # emission: radiance
    weight: float = 1.0  # share in a mix
    roughness: float = 0.0  # as perceived: GGX's alpha is its square; diffuse: as in Cycles' node
    ior: float = 1.5
    multiscatter: bool = True  # light between microfacets is not lost
    textured: bool = False  # the volume's colours multiply color
    metallic: float = 0.0  # this and all that follows: of principled lobes
    specular: float = 0.5
    specular_tint: Vector = (1.0, 1.0, 1.0)
    transmission: float = 0.0
    alpha: float = 1.0
    emission: Vector = (0.0, 0.0, 0.0)  # radiance


@dataclass(frozen=True)
class Material:
    """What a surface does to light, the sum of its lobes, and what fills solids that wear it."""

    lobes: Sequence[Lobe]
    absorption: Vector = (0.0, 0.0, 0.0)  # inside solids, per unit of world length,
    index: int = 0
    scattering: Vector = (0.0, 0.0, 0.0)  # likewise,
    glow: Vector = (0.0, 0.0, 0.0)  # and the radiance that is added
    anisotropy: float = 0.0  # of what is scattered: the mean cosine
    phase: str = "henyey_greenstein"  # of PHASES
    bare: bool = False  # no surface, and no lobes: rays meet what is inside alone

    @classmethod
    def diffuse(cls, color: Vector) -> Material:
        """A Lambertian surface of that reflectance. color: (3,), linear RGB."""
        return cls((Lobe("diffuse", color),))


@dataclass(frozen=True)
class World:
    """What surrounds the scene: a color, which multiplies the image where there is one."""

    color: Vector = (0.0, 0.0, 0.0)  # radiance
    image: NDArray[np.float32] | Texture | None = None  # (height, width, 3), as pixels of a
    # Texture, by longitude and latitude, rows from below; or one that repeats
    image_from_world: ArrayLike = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    max_bounces: int = LR_BOUNCES_MAX  # of a world with an image, as of a light
    visible_camera: bool = True
    visible_diffuse: bool = True
    visible_glossy: bool = True
    visible_transmission: bool = True
    visible_volume_scatter: bool = True


@dataclass(frozen=True)
class Clip:
    """A solid that cuts an instance, of which the hits on one side of it count.

    The faces of the cut are an instance of the solid's own structure, which is cut by the volume
    that they are seen in (inside=True).
    """

    volume: Volume  # a solid
    world_from_object: ArrayLike  # (4, 4)
    inside: bool = False  # the hits inside the solid count, else those outside
    margin: float = 0.0  # in occupancy: hits that lie so little on the wrong side count


@dataclass(frozen=True)
class FieldColor:
    """A scalar field that colours hits: program makes linear RGB of the grey that it has there.

    That is its value, offset + scale * occupancy, or its slope, the length of the gradient per
    unit of world length. Beyond the lattice occupancy and slope are 0. Of the part "id" hits take
    no colour, but an id of the field's, and so its material: the one that weighs most among the
    samples inside, averaged by 1-2-1 along each axis, so that borders do not show the voxels.
    """

    volume: Volume
    world_from_object: ArrayLike  # (4, 4)
    program: Program | None  # of the part "id": None
    scale: float = 1.0
    offset: float = 0.0
    part: str = "value"  # | "slope" | "id"


@dataclass(frozen=True)
class Instance:
    """A structure placed in the world.

    Id m of its volume has the material slots[first_material + min(m, n_materials - 1)].
    """

    structure: Structure
    world_from_object: ArrayLike  # (4, 4)
    first_material: int = 0
    n_materials: int = 1
    object_index: int = 0
    visible_camera: bool = True
    visible_shadow: bool = True
    visible_diffuse: bool = True
    visible_glossy: bool = True
    visible_transmission: bool = True
    volume_index: int = 0  # of the Volume pass
    error: float = 0.0  # of the surface, in world space, for the Error pass
    holdout: bool = False  # the camera sees a hole in the picture
    clips: Sequence[Clip] = ()  # inside what is cut light is neither bent nor absorbed
    field_color: FieldColor | None = None  # in place of the colours that the volume keeps
    visible_volume_scatter: bool = True
    volume_unit: float = 0.0  # of a visible volume: the length in world space that its extinction,
    # emission and scattering are for; 0: the unit of object space
    anisotropy: float = 0.0  # of what it scatters: the mean cosine
    phase: str = "henyey_greenstein"  # of PHASES
    gradient_shading: float = 0.0  # 0..1: of what it scatters, how much reflects like a surface
    # whose normal is the gradient, times 1 - exp(-gradient_scale * length of the gradient)
    gradient_scale: float = 0.0  # by values per unit of object space; 0 or more
    roughness: float = 0.5  # of that surface, 0..1, as of lobes,
    specular: float = 0.5  # likewise, with an index of refraction of 1.5
