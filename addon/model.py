# SPDX-License-Identifier: GPL-3.0-or-later
"""A scene in plain arrays: what `scene` reads and everything after it works on (no bpy)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple, dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

import leapray
from leapray import Camera, Lobe, Program
from leapray.arrays import bounds
from leapray.scalar_grid import ScalarGrid

from .arrays import digest
from .memory import Resident, pieces
from .settings import Modelling, Settings

Color = tuple[float, float, float]  # linear RGB


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

    @cached_property
    def bounds(self) -> NDArray[np.float64]:
        """(2, 3): the box of its triangles."""
        used = np.zeros(len(self.vertices), np.bool_)
        for some in pieces(len(self.triangles)):
            used[self.triangles[some]] = True
        corners = self.vertices if used.all() else self.vertices[used]
        return bounds(corners).astype(np.float64)

    @cached_property
    def contents(self) -> str:
        """A name for all that it holds but for its corners'."""
        return digest((self.vertices, self.triangles, self.slots, self.solids))

    @cached_property
    def corner_names(self) -> tuple[str, ...]:
        """What is told of the contents of corners' normals, colours and places; "": none."""
        carried = self.corner_normals, self.corner_colors, self.corner_uvs
        return tuple("" if each is None else digest([each]) for each in carried)


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
class Clip:
    """A mesh, or a plane, that cuts the surfaces of a field."""

    name: str  # of its object, for messages
    mesh: Mesh | None  # None: all of its space where z > 0
    world_from_object: NDArray[np.float64]  # (4, 4)
    inside: bool = False  # what lies inside the mesh stays, else what lies outside


@dataclass(frozen=True)
class OtherGrid:
    """A grid beside that of a field, in the same object."""

    grid: ScalarGrid
    contents: str  # a name for the grid's contents


@dataclass(frozen=True)
class FieldColor:
    """The colours that a material takes from the field whose surface wears it."""

    program: Program  # makes linear RGB of r = g = b, in the data's units
    part: str = "value"  # | "slope", per unit of world length
    other: OtherGrid | None = None  # that gives the value in place of the field


@dataclass(frozen=True)
class Labels:
    """Regions of a field that are rendered as solids, told by whole numbers."""

    numbers: tuple[int, ...]  # ascending, of each region; its id is its place here
    bodies: tuple[tuple[int, ...], ...] = ()  # ids of the regions that make each solid; where two
    # solids touch, the former reaches a little into the latter


def nothing(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Black (n, 3) for values (n,)."""
    return np.zeros((len(values), 3))


@dataclass(frozen=True)
class GradientShading:
    """How a field that scatters light is shaded by its gradient."""

    amount: float = 0.0  # 0..1: what boundaries reflect like surfaces
    scale: float = 10.0  # by the change of values over a voxel, as a share of the range shown
    roughness: float = 0.5  # of such surfaces, 0..1
    specular: float = 0.5  # likewise


@dataclass(frozen=True)
class Look:
    """What a field looks like that is seen without a surface: functions of its values (n,)."""

    extinction: Callable[[NDArray[np.float64]], NDArray[np.float64]]  # to (n, 3), per unit of
    emission: Callable[[NDArray[np.float64]], NDArray[np.float64]]  # length, as these:
    scattering: Callable[[NDArray[np.float64]], NDArray[np.float64]] = nothing  # of extinction,
    forward: Callable[[NDArray[np.float64]], NDArray[np.float64]] = nothing  # by its mean cosine
    key: bytes = b""  # what they do
    named: tuple[float, ...] = ()  # values that it may turn at, among others
    phase: str = "henyey_greenstein"  # of leapray.rendering.PHASES
    per_world_unit: bool = False  # else objects that are scaled stay as dense as they look
    shading: GradientShading = GradientShading()
    modulation: float = 0.0  # the gradient at which all is seen, as for the scale; 0: off

    @property
    def seen_key(self) -> tuple[bytes, float]:
        """What of it decides on what is seen."""
        return self.key, self.modulation


@dataclass(frozen=True)
class Field:
    """A scalar field whose surfaces at some thresholds are rendered; instances share it.

    The grid's world is the object's own space, its units those of the scene.
    """

    name: str
    grid: ScalarGrid
    contents: str  # a name for the grid's contents
    thresholds: tuple[float, ...]  # of each surface, in the data's units; of labels none
    above: bool = True  # inside is what exceeds the threshold, else what falls below it
    capped: bool = True  # surfaces are closed where the data end
    smoothing: float = 0.0  # the standard deviation of a Gaussian, in samples
    interpolation: str = "linear"  # | "cubic"
    least: int = 0  # parts of fewer samples are left out
    clip: Clip | None = None
    read_nbytes: int = 0  # of the grid that the render's memory budget pays for
    labels: Labels | None = None  # in place of surfaces at thresholds
    look: Look | None = None  # likewise: what light meets inside


@dataclass(frozen=True, kw_only=True)
class Placed:
    """A thing placed in the world, and what its object says of it."""

    name: str  # of the object, for messages
    world_from_object: NDArray[np.float64]  # (4, 4)
    materials: tuple[int, ...]  # per slot, indices into Scene.materials; at least one
    object_index: int = 0  # Blender's pass index
    visible_camera: bool = True
    visible_shadow: bool = True
    visible_diffuse: bool = True
    visible_glossy: bool = True
    visible_transmission: bool = True
    visible_volume_scatter: bool = True
    holdout: bool = False  # the camera sees a hole in the picture


@dataclass(frozen=True, kw_only=True)
class Instance(Placed):
    """A mesh placed in the world."""

    mesh: int  # index into Scene.meshes


@dataclass(frozen=True, kw_only=True)
class FieldInstance(Placed):
    """A field placed in the world; surface n of it has the material in slot n, or in the last.

    The faces of a cut come after the surfaces. Of labels there is a slot for each, which its part
    of the faces has, too.
    """

    field: int  # index into Scene.fields
    colors: tuple[FieldColor | None, ...] = ()  # per slot, where the material takes any
    slot_objects: tuple[int, ...] = ()  # pass index per slot; (): the object's for all


@dataclass(frozen=True)
class Material:
    """What a surface does to light, the sum of its lobes, and what fills solids that wear it."""

    name: str
    lobes: tuple[Lobe, ...]
    color_source: str = ""  # of textured lobes: "vertex" | "image"
    attribute: str = ""  # the colours' or UVs' name in the mesh
    image: Image | None = None
    absorption: Color = (0.0, 0.0, 0.0)  # inside solids, per unit of world length,
    scattering: Color = (0.0, 0.0, 0.0)  # likewise,
    glow: Color = (0.0, 0.0, 0.0)  # and the radiance that is added
    anisotropy: float = 0.0  # of what is scattered: the mean cosine
    phase: str = "henyey_greenstein"  # of leapray.rendering.PHASES
    index: int = 0  # Blender's pass index
    bare: bool = False  # no surface, and no lobes: what is inside alone

    @property
    def refracts(self) -> bool:
        """Whether light goes on through it, bent by its normals."""
        return any(
            lobe.kind in ("glass", "refraction") or lobe.transmission > 0 for lobe in self.lobes
        )

    @property
    def fills(self) -> bool:
        """Whether light meets something inside."""
        return any(self.absorption + self.scattering + self.glow)

    @property
    def is_clear(self) -> bool:
        """Whether one sees through it."""
        through = self.bare or self.refracts
        return through or any(lobe.kind == "transparent" or lobe.alpha < 1 for lobe in self.lobes)

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
    passes: tuple[str, ...] = leapray.rendering.USUAL_PASSES
    mist: tuple[float, float, str] = (5.0, 25.0, "QUADRATIC")  # start, depth, Blender's falloff
    film_exposure: float = 1.0  # multiplies the light of the passes
    warnings: tuple[str, ...] = ()
    seconds_read: float = 0.0
    resident: Resident | None = None  # what the process took before the scene was read
    fields: tuple[Field, ...] = ()
    field_instances: tuple[FieldInstance, ...] = ()


@dataclass
class Frame:
    """A rendered frame: the passes, rows from below, and how they came about."""

    passes: dict[str, NDArray[np.float32]]  # "Combined" (h, w, 4), "Depth" (h, w, 1), ...
    report: dict[str, Any] = field(default_factory=dict)  # becomes the JSON beside the picture
    warnings: list[str] = field(default_factory=list)
