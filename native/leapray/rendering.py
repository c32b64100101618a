# SPDX-License-Identifier: GPL-3.0-or-later
"""Scenes of placed structures, rendered tile by tile: numpy in, numpy out."""

from __future__ import annotations

import ctypes
import weakref
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _abi
from ._lib import LeapRayError, Watch, call, check, lib
from .arrays import choice, pointer
from .tracing import Structure, trace_options

# Channels of every pass, by Blender's names; the geometry passes come from the pixel's centre.
PASSES = {"Combined": 4, "Depth": 1, "Normal": 3, "Position": 3, "Object Index": 1}
MEMBERS = {name: name.lower().replace(" ", "_") for name in PASSES}  # of lr_passes

PROJECTIONS = {"perspective": _abi.LR_PERSPECTIVE, "orthographic": _abi.LR_ORTHOGRAPHIC}
VISIBILITIES = {
    "visible_camera": _abi.LR_VISIBLE_CAMERA,
    "visible_shadow": _abi.LR_VISIBLE_SHADOW,
    "visible_diffuse": _abi.LR_VISIBLE_DIFFUSE,
}
LIGHTS = {"sun": _abi.LR_LIGHT_SUN, "point": _abi.LR_LIGHT_POINT}


@dataclass(frozen=True)
class Camera:
    """Rays through the film, as lr_camera in leapray.h says; film points are in pixels."""

    projection: str  # "perspective" | "orthographic"
    eye: ArrayLike  # (3,), world space, as all that follow
    forward: ArrayLike
    corner: ArrayLike
    dx: ArrayLike
    dy: ArrayLike
    clip_start: float = 0.0  # depths
    clip_end: float = np.inf


@dataclass(frozen=True)
class Light:
    """A light without extent."""

    kind: str  # "sun" | "point"
    color: ArrayLike  # (3,) sun: irradiance on a plane facing it; point: radiant intensity
    position: ArrayLike = (0.0, 0.0, 0.0)
    direction: ArrayLike = (0.0, 0.0, 1.0)  # unit, towards a sun
    casts_shadow: bool = True


@dataclass(frozen=True)
class Material:
    """A Lambertian surface."""

    base_color: ArrayLike  # (3,) reflectance


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


class _Colored(Protocol):
    base_color: ArrayLike


class Scene:
    """Everything that a tile needs, checked and under one hierarchy; tiles may run on any threads.

    camera, lights and materials are of the classes above, or have attributes of
    the same names. slots are indices into materials; slot_objects, one per slot,
    replaces the object index of the hits with that slot. Structures are kept
    alive.
    Raises LeapRayError with a sentence that names the culprit.
    """

    def __init__(
        self,
        camera: Camera,
        instances: Sequence[Instance],
        lights: Sequence[Light] = (),
        materials: Sequence[_Colored] = (),
        slots: Sequence[int] = (),
        world_color: ArrayLike = (0.0, 0.0, 0.0),
        film_transparent: bool = False,
        slot_objects: Sequence[int] | None = None,
    ) -> None:
        self._structures = [i.structure for i in instances]  # kept alive
        tables = {
            "instances": _instances(instances),
            "lights": _lights(lights),
            "materials": _materials(materials),
            "slots": np.asarray(slots, np.uint32),
        }
        desc = _abi.lr_scene_desc()
        desc.camera = _camera(camera)
        types = dict(_abi.lr_scene_desc._fields_)
        for name, table in tables.items():
            setattr(desc, name, ctypes.cast(table.ctypes.data, types[name]))
            setattr(desc, f"n_{name}", len(table))
        if slot_objects is not None:
            objects = np.array(_vector(slot_objects, "slot_objects", (len(slots),)), np.int32)
            desc.slot_objects = pointer(objects, ctypes.c_int32)
        desc.world_color[:] = _vector(world_color, "the world's color")
        desc.film_transparent = int(film_transparent)
        self.handle = ctypes.POINTER(_abi.lr_scene)()
        error = _abi.lr_error()
        status = lib.lr_scene_new(
            ctypes.byref(desc), ctypes.byref(self.handle), ctypes.byref(error)
        )
        check(status, error)
        weakref.finalize(self, lib.lr_scene_free, self.handle)

    def workspace(self, width: int, height: int) -> NDArray[np.uint8]:
        """Working memory for tiles of up to that size; one per thread, to be used again."""
        return np.empty(lib.lr_render_nbytes(self.handle, width, height), np.uint8)

    def render_tile(
        self,
        x: int,
        y: int,
        width: int,
        height: int,
        *,
        samples: int = 16,
        seed: int = 0,
        options: Mapping[str, str] | None = None,
        passes: Sequence[str] | Mapping[str, NDArray[np.float32]] = tuple(PASSES),
        workspace: NDArray[np.uint8] | None = None,
        watch: Watch | None = None,
        counters: _abi.lr_counters | None = None,
    ) -> dict[str, NDArray[np.float32]]:
        """The passes of the width x height pixels from (x, y) on; rows from below.

        options: hit_test, root and normal, as of `trace`. passes: names, or the
        arrays to fill, float32 (height, width, channels), in rows without gaps;
        Combined always comes along. counters is added to.
        Raises LeapRayError, Stopped where the watch says so.
        """
        given = passes if isinstance(passes, Mapping) else dict.fromkeys(passes)
        unknown = set(given) - set(PASSES)
        if unknown:
            raise LeapRayError(f"passes are {', '.join(PASSES)}, not {', '.join(sorted(unknown))}")
        filled = {
            name: _buffer(given.get(name), name, width, height)
            for name in PASSES
            if name in given or name == "Combined"
        }
        pointers = _abi.lr_passes()
        for name, array in filled.items():
            setattr(pointers, MEMBERS[name], pointer(array, ctypes.c_float))
        if workspace is None:
            workspace = self.workspace(width, height)
        names = {"hit_test": "extrema", "root": "newton", "normal": "central", **(options or {})}
        tile = _abi.lr_tile(x, y, width, height, samples, seed, trace_options(**names))
        call(
            lib.lr_render_tile,
            self.handle,
            ctypes.byref(tile),
            ctypes.byref(pointers),
            workspace.ctypes.data,
            workspace.nbytes,
            None if counters is None else ctypes.byref(counters),
            watch=watch,
        )
        return filled


def _dtype(struct: type[ctypes.Structure]) -> np.dtype:
    """The ctypes structure as a numpy record; pointers become integers."""
    names, types = zip(*struct._fields_, strict=True)
    return np.dtype(
        {
            "names": names,
            "formats": [np.uintp if hasattr(t, "contents") else np.dtype(t) for t in types],
            "offsets": [getattr(struct, name).offset for name in names],
            "itemsize": ctypes.sizeof(struct),
        }
    )


def _vector(values: ArrayLike, what: str, shape: tuple[int, ...] = (3,)) -> NDArray[np.float64]:
    array = np.asarray(values, np.float64)
    if array.shape != shape:
        raise LeapRayError(f"{what} must have shape {shape}, it has {array.shape}")
    return array


def _camera(camera: Camera) -> _abi.lr_camera:
    result = _abi.lr_camera()
    result.projection = choice(PROJECTIONS, camera.projection, "projection")
    for name in ("eye", "forward", "corner", "dx", "dy"):
        getattr(result, name)[:] = _vector(getattr(camera, name), f"the camera's {name}")
    result.clip_start, result.clip_end = camera.clip_start, camera.clip_end
    return result


def _instances(instances: Sequence[Instance]) -> NDArray:
    table = np.zeros(len(instances), _dtype(_abi.lr_instance))
    if not len(instances):
        return table
    table["world_from_object"] = [
        _vector(instance.world_from_object, f"the matrix of instance {i}", (4, 4)).ravel()
        for i, instance in enumerate(instances)
    ]
    structures = {id(i.structure): i.structure for i in instances}
    addresses = {
        key: ctypes.cast(structure.handle, ctypes.c_void_p).value
        for key, structure in structures.items()
    }
    table["structure"] = [addresses[id(i.structure)] for i in instances]
    for name in ("object_index", "first_material", "n_materials"):
        table[name] = [getattr(i, name) for i in instances]
    for name, flag in VISIBILITIES.items():
        table["visibility"] |= np.array([flag * bool(getattr(i, name)) for i in instances], "u4")
    return table


def _lights(lights: Sequence[Light]) -> NDArray:
    table = np.zeros(len(lights), _dtype(_abi.lr_light))
    for i, (row, light) in enumerate(zip(table, lights, strict=True)):
        row["kind"] = choice(LIGHTS, light.kind, f"kind of light {i}")
        row["casts_shadow"] = bool(light.casts_shadow)
        for name in ("position", "direction", "color"):
            row[name] = _vector(getattr(light, name), f"the {name} of light {i}")
    return table


def _materials(materials: Sequence[_Colored]) -> NDArray:
    table = np.zeros(len(materials), _dtype(_abi.lr_material))
    for i, (row, material) in enumerate(zip(table, materials, strict=True)):
        row["base_color"] = _vector(material.base_color, f"the base color of material {i}")
    return table


def _buffer(
    array: NDArray[np.float32] | None, name: str, width: int, height: int
) -> NDArray[np.float32]:
    """The caller's array, checked, or a new one."""
    shape = (max(height, 0), max(width, 0), PASSES[name])
    if array is None:
        return np.empty(shape, np.float32)
    fits = array.dtype == np.float32 and array.shape == shape
    if not (fits and array.flags.c_contiguous and array.flags.writeable):
        raise LeapRayError(
            f"the buffer of pass {name} must be float32 {shape} without gaps, and writeable; "
            f"it is {array.dtype} {array.shape}"
        )
    return array
