# SPDX-License-Identifier: GPL-3.0-or-later
"""Scenes of placed structures, rendered tile by tile: numpy in, numpy out."""

from __future__ import annotations

import ctypes
import operator
import weakref
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _abi
from ._lib import LeapRayError, Watch, call, check, lib
from .arrays import choice, empty, members, numbers, pointer, record
from .attributes import Texture
from .scene_parts import Camera, Instance, Light, Lobe, Material, World
from .tracing import trace_options

# Channels of every pass, by Blender's names; those that show what is seen first come from the
# pixel's centre, the others are means over its samples.
PASSES = {
    "Combined": 4,
    "Depth": 1,
    "Normal": 3,
    "Position": 3,
    "Object Index": 1,
    "Material Index": 1,
    "Mist": 1,
    "Ambient Occlusion": 1,
    "Emission": 3,
    "Environment": 3,
    "Error": 1,
    "Volume": 1,
    "Steps": 1,
}
MEMBERS = {name: name.lower().replace(" ", "_") for name in PASSES}  # of lr_passes
MEMBERS["Ambient Occlusion"] = "ao"
USUAL_PASSES = ("Combined", "Depth", "Normal", "Position", "Object Index")

# How a tile is sampled, as of lr_tile.
SAMPLING: dict[str, float | str] = {
    "min_samples": 0,
    "noise_threshold": 0.0,
    "pixel_filter": "box",
    "filter_width": 1.5,
    "max_bounces": 12,
    "diffuse_bounces": 0,
    "glossy_bounces": 4,
    "transmission_bounces": 12,
    "transparent_bounces": 8,
    "volume_bounces": 0,
    "branches": 1,
    "ao_distance": 10.0,
    "ambient_distance": 0.0,
    "clamp_direct": 0.0,
    "clamp_indirect": 0.0,
}
PIXEL_FILTERS = members(_abi.lr_film_filter)
MIST_POWERS = {"LINEAR": 1.0, "QUADRATIC": 2.0, "INVERSE_QUADRATIC": 0.5}  # Blender's falloffs

PROJECTIONS = members(_abi.lr_projection)
VISIBILITIES = {f"visible_{rays}": flag for rays, flag in members(_abi.lr_visibility).items()}
_SEEN = operator.attrgetter(*VISIBILITIES)
LIGHTS = members(_abi.lr_light_kind)
FIELD_PARTS = members(_abi.lr_field_part)
PHASES = members(_abi.lr_phase_kind)
SHAPES = {
    "disc": _abi.LR_LIGHT_ROUND,
    "ellipse": _abi.LR_LIGHT_ROUND,
    "sphere": _abi.LR_LIGHT_FULL,
    "rectangle": _abi.LR_LIGHT_FULL,
}
LOBES = members(_abi.lr_lobe_kind)
LOBE_FLAGS = members(_abi.lr_lobe_flag)


class Record:
    """What happens on the paths of one pixel, as `Scene.render_tile` writes it.

    capacity: events that are kept; each takes some 500 bytes. Raises LeapRayError for one that
    is no whole number.
    """

    def __init__(self, capacity: int = 1 << 16) -> None:
        capacity = numbers(capacity, np.uint32, "capacity").item()
        self._events = np.zeros(capacity, record(_abi.lr_event))
        self.struct = _abi.lr_record(pointer(self._events, _abi.lr_event), capacity)

    @property
    def events(self) -> NDArray:
        """(n,) records with the members of lr_event, in the order in which things happened."""
        return self._events[: self.struct.n]

    @property
    def lost(self) -> int:
        """How many events found no room."""
        return max(self.struct.n - self.struct.capacity, 0)

    @property
    def samples(self) -> int:
        """How many samples the pixel had: its value is the mean of what they brought."""
        return self.struct.samples


class Scene:
    """Everything that a tile needs, checked and under one hierarchy; tiles may run on any threads.

    camera, instances, lights, materials and world are of the classes above, or have
    attributes of the same names. slots are indices into materials; slot_objects, (n,) for n
    slots, replaces the object index of the hits with that slot, unless it is LR_OWN_INDEX.
    film_transparent: the camera sees alpha in place of the world. mist: start, depth and
    Blender's falloff of the Mist pass. nested: solids in each other or side by side bend light
    by the ratio of their indices; else each surface by its own index, as in Cycles.
    Structures are kept alive.
    Raises LeapRayError with a sentence that names the culprit.
    """

    def __init__(
        self,
        camera: Camera,
        instances: Sequence[Instance],
        lights: Sequence[Light] = (),
        materials: Sequence[Material] = (),
        slots: Sequence[int] = (),
        world: World | None = None,
        film_transparent: bool = False,
        slot_objects: Sequence[int] | None = None,
        mist: tuple[float, float, str] = (5.0, 25.0, "QUADRATIC"),
        nested: bool = True,
    ) -> None:
        self._instances = tuple(instances)  # kept alive, with what they name
        self._told = f"{len(instances)} instances, {len(lights)} lights, {len(materials)} materials"
        lobes = _lobes(materials)
        clips, colors = _clips(instances), _field_colors(instances)
        tables = {
            "instances": _instances(instances, clips, colors),
            "lights": _lights(lights),
            "materials": _materials(materials, lobes),
            "slots": numbers(slots, np.uint32, "slots"),
        }
        desc = _abi.lr_scene_desc()
        desc.camera = camera_struct(camera)
        types = _field_types(_abi.lr_scene_desc)
        for name, table in tables.items():
            setattr(desc, name, ctypes.cast(table.ctypes.data, types[name]))
            setattr(desc, f"n_{name}", len(table))
        if slot_objects is not None:
            _vector(slot_objects, "slot_objects", (len(slots),))
            objects = numbers(slot_objects, np.int32, "slot_objects")
            desc.slot_objects = pointer(objects, ctypes.c_int32)
        desc.world, self._sky = _world(world or World())
        desc.film_transparent = int(film_transparent)
        desc.lone_media = int(not nested)
        desc.mist_start, desc.mist_depth = mist[:2]
        desc.mist_power = choice(MIST_POWERS, mist[2], "falloff of the mist")
        self.handle = ctypes.POINTER(_abi.lr_scene)()
        error = _abi.lr_error()
        status = lib.lr_scene_new(
            ctypes.byref(desc), ctypes.byref(self.handle), ctypes.byref(error)
        )
        check(status, error)
        del lobes, clips, colors  # copied
        weakref.finalize(self, lib.lr_scene_free, self.handle)

    def __repr__(self) -> str:
        return f"<Scene of {self._told}>"

    def workspace(self, width: int, height: int, branches: int = 1) -> NDArray[np.uint8]:
        """Working memory (n,) for tiles of up to width x height pixels; one per thread, to be used
        again. branches: as of the tiles. Raises LeapRayError for what are no whole numbers."""
        sides = numbers((width, height, branches), np.int32, "width, height and branches").tolist()
        return np.empty(lib.lr_render_nbytes(self.handle, *sides), np.uint8)

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
        passes: Sequence[str] | Mapping[str, NDArray[np.float32]] = USUAL_PASSES,
        workspace: NDArray[np.uint8] | None = None,
        watch: Watch | None = None,
        counters: _abi.lr_counters | None = None,
        record: Record | None = None,
        **sampling: float | str,
    ) -> dict[str, NDArray[np.float32]]:
        """The passes of the width x height pixels from (x, y) on; rows from below.

        samples: per pixel; where there is a noise threshold, at most. seed: of the random numbers.
        options: hit_test, root and normal, as of `trace`. sampling: see SAMPLING.
        passes: names, or the arrays to fill, float32 (height, width, channels), in
        rows without gaps; Combined always comes along. workspace: (n,), of the method of that
        name; made where None. counters is added to. record: of a tile of one pixel, takes what
        happens on its paths.
        Raises LeapRayError, Stopped where the watch says so.
        """
        given = passes if isinstance(passes, Mapping) else dict.fromkeys(passes)
        unknown = set(given) - set(PASSES)
        if unknown:
            asked = ", ".join(sorted(map(str, unknown)))
            raise LeapRayError(f"passes are {', '.join(PASSES)}, not {asked}")
        filled = {
            name: _buffer(given.get(name), name, width, height)
            for name in PASSES
            if name in given or name == "Combined"
        }
        pointers = _abi.lr_passes()
        for name, array in filled.items():
            setattr(pointers, MEMBERS[name], pointer(array, ctypes.c_float))
        tile = _tile(samples, sampling)
        _assign(tile, x=x, y=y, width=width, height=height, seed=seed)
        names = {"hit_test": "extrema", "root": "newton", "normal": "central", **(options or {})}
        tile.trace = trace_options(**names)
        if record is not None:
            tile.record = ctypes.pointer(record.struct)
        if workspace is None:
            workspace = self.workspace(width, height, tile.branches)
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


def _tile(samples: int, sampling: Mapping[str, float | str]) -> _abi.lr_tile:
    """A tile without a place; the sampling that is not given is SAMPLING's."""
    unknown = set(sampling) - set(SAMPLING)
    if unknown:
        raise LeapRayError(f"sampling is {', '.join(SAMPLING)}, not {', '.join(sorted(unknown))}")
    tile = _abi.lr_tile()
    _assign(tile, samples=samples)
    values: dict[str, Any] = {**SAMPLING, **sampling}
    tile.filter = choice(PIXEL_FILTERS, values.pop("pixel_filter"), "pixel filter")
    _assign(tile, **values)
    return tile


def _assign(struct: ctypes.Structure, **values: float) -> None:
    """Set numbers of a structure. Raises LeapRayError where one does not fit."""
    types = _field_types(type(struct))
    for name, value in values.items():
        setattr(struct, name, numbers(value, types[name], name).item())


def _field_types(struct: type[ctypes.Structure]) -> dict[str, Any]:
    """The ctypes type of every field."""
    return {name: c_type for name, c_type, *_ in struct._fields_}


def _vector(values: ArrayLike, what: str, shape: tuple[int, ...] = (3,)) -> NDArray[np.float64]:
    array = np.asarray(values, np.float64)
    if array.shape != shape:
        raise LeapRayError(f"{what} must have shape {shape}, it has {array.shape}")
    return array


def camera_struct(camera: Camera) -> _abi.lr_camera:
    """A camera as C has it. Raises LeapRayError that names what is wrong."""
    result = _abi.lr_camera()
    result.projection = choice(PROJECTIONS, camera.projection, "projection")
    for name in ("eye", "forward", "corner", "dx", "dy"):
        getattr(result, name)[:] = _vector(getattr(camera, name), f"the camera's {name}")
    result.clip_start, result.clip_end = camera.clip_start, camera.clip_end
    return result


def _fill(row: np.void, thing: object, of: str) -> None:
    """Copy those members of a structure that the thing has by the same names and that are numbers.

    of: what the thing is called. Raises LeapRayError that names what is wrong.
    """
    for name in row.dtype.names or ():
        value, dtype, what = getattr(thing, name, None), row.dtype[name], f"the {name} of {of}"
        if dtype.shape and value is not None:
            row[name] = _vector(value, what, dtype.shape)
        elif not isinstance(value, str | None):
            row[name] = numbers(value, dtype, what)


def _instances(instances: Sequence[Instance], clips: NDArray, colors: NDArray) -> NDArray:
    """clips and colors: those of all instances, one after the other."""
    table = np.zeros(len(instances), record(_abi.lr_instance))
    if not len(instances):
        return table
    table["n_clips"] = [len(instance.clips) for instance in instances]
    first = np.cumsum(table["n_clips"]) - table["n_clips"]
    table["clips"] = clips.ctypes.data + first * clips.itemsize
    colored = np.array([instance.field_color is not None for instance in instances])
    at = np.cumsum(colored) - 1
    table["field_color"] = np.where(colored, colors.ctypes.data + at * colors.itemsize, 0)
    table["world_from_object"] = [
        _vector(instance.world_from_object, f"the matrix of instance {i}", (4, 4)).ravel()
        for i, instance in enumerate(instances)
    ]
    structures = {id(i.structure): i.structure for i in instances}
    addresses = {key: _address(structure.handle) for key, structure in structures.items()}
    table["structure"] = [addresses[id(i.structure)] for i in instances]
    names = ["object_index", "first_material", "n_materials", "volume_index", "error"]
    names += ["volume_unit", "anisotropy", "gradient_shading", "gradient_scale"]
    for name in (*names, "roughness", "specular"):
        values = [getattr(i, name) for i in instances]
        table[name] = numbers(values, table.dtype[name], f"{name} of the instances")
    table["phase"] = [choice(PHASES, i.phase, "phase function") for i in instances]
    table["holdout"] = [bool(i.holdout) for i in instances]
    seen = list(map(_SEEN, instances))
    flags = {each: _flags(each) for each in set(seen)}  # few, however many instances
    table["visibility"] = [flags[each] for each in seen]
    return table


def _address(handle: Any) -> int | None:
    return ctypes.cast(handle, ctypes.c_void_p).value


def _clips(instances: Sequence[Instance]) -> NDArray:
    """The clips of all instances, one after the other."""
    clips = [(i, clip) for i, instance in enumerate(instances) for clip in instance.clips]
    table = np.zeros(len(clips), record(_abi.lr_clip))
    for row, (i, clip) in zip(table, clips, strict=True):
        row["volume"] = _address(clip.volume.handle)
        matrix = _vector(clip.world_from_object, f"the matrix of a clip of instance {i}", (4, 4))
        row["world_from_object"] = matrix.ravel()
        row["margin"] = numbers(clip.margin, np.float64, f"the margin of a clip of instance {i}")
        row["inside"] = bool(clip.inside)
    return table


def _field_colors(instances: Sequence[Instance]) -> NDArray:
    """The fields that colour instances, one after the other."""
    colors = [(i, each.field_color) for i, each in enumerate(instances) if each.field_color]
    table = np.zeros(len(colors), record(_abi.lr_field_color))
    for row, (i, color) in zip(table, colors, strict=True):
        row["volume"] = _address(color.volume.handle)
        row["part"] = choice(FIELD_PARTS, color.part, f"part of the field of instance {i}")
        if color.program is not None:
            row["program"] = ctypes.addressof(color.program.packed)
        matrix = _vector(
            color.world_from_object, f"the matrix of the field that colours instance {i}", (4, 4)
        )
        row["world_from_object"] = matrix.ravel()
        for name in ("scale", "offset"):
            value = getattr(color, name)
            row[name] = numbers(value, np.float64, f"{name} of the field that colours instance {i}")
    return table


def _visibility(thing: object, **more: bool) -> int:
    """The flags of what has attributes of their names; more tells those that it has not."""
    seen = {name: getattr(thing, name, False) for name in VISIBILITIES} | more
    return _flags(seen[name] for name in VISIBILITIES)


def _flags(seen: Iterable[bool]) -> int:
    """Those of VISIBILITIES that are set."""
    return sum(flag for flag, is_seen in zip(VISIBILITIES.values(), seen, strict=True) if is_seen)


def _lights(lights: Sequence[Light]) -> NDArray:
    table = np.zeros(len(lights), record(_abi.lr_light))
    for i, (row, light) in enumerate(zip(table, lights, strict=True)):
        _fill(row, light, f"light {i}")
        row["kind"] = choice(LIGHTS, light.kind, f"kind of light {i}")
        row["shape"] = choice(SHAPES, light.shape, f"shape of light {i}")
        row["visibility"] = _visibility(light, visible_shadow=light.casts_shadow)
    return table


def _lobes(materials: Sequence[Material]) -> NDArray:
    """The lobes of all materials, one after the other."""
    lobes: list[tuple[int, Lobe]] = [
        (i, lobe) for i, material in enumerate(materials) for lobe in material.lobes
    ]
    table = np.zeros(len(lobes), record(_abi.lr_lobe))
    for row, (i, lobe) in zip(table, lobes, strict=True):
        _fill(row, lobe, f"a lobe of material {i}")
        row["kind"] = choice(LOBES, lobe.kind, f"kind of a lobe of material {i}")
        row["flags"] = sum(flag for name, flag in LOBE_FLAGS.items() if getattr(lobe, name))
    return table


def _materials(materials: Sequence[Material], lobes: NDArray) -> NDArray:
    table = np.zeros(len(materials), record(_abi.lr_material_desc))
    first = 0
    for i, (row, material) in enumerate(zip(table, materials, strict=True)):
        row["lobes"] = lobes.ctypes.data + first * lobes.itemsize
        row["n_lobes"] = len(material.lobes)
        row["index"] = numbers(material.index, np.int32, f"the index of material {i}")
        for name in ("absorption", "scattering", "glow"):
            row[name] = _vector(getattr(material, name), f"the {name} of material {i}")
        row["anisotropy"] = numbers(material.anisotropy, float, f"the anisotropy of material {i}")
        row["phase"] = choice(PHASES, material.phase, f"phase function of material {i}")
        row["bare"] = bool(material.bare)
        first += len(material.lobes)
    return table


def _world(world: World) -> tuple[_abi.lr_world, Texture | None]:
    """The description, and the texture that it points to."""
    result = _abi.lr_world(visibility=_visibility(world))
    _assign(result, max_bounces=world.max_bounces)
    result.color[:] = _vector(world.color, "the world's color")
    rotation = _vector(world.image_from_world, "the world's rotation", (3, 3))
    result.image_from_world[:] = rotation.ravel()
    if world.image is None:
        return result, None
    image = world.image
    if not isinstance(image, Texture):
        image = Texture(image, points_only=True)
    result.image = image.handle
    return result, image


def _buffer(
    array: NDArray[np.float32] | None, name: str, width: int, height: int
) -> NDArray[np.float32]:
    """The caller's array, checked, or a new one."""
    shape = (max(height, 0), max(width, 0), PASSES[name])
    if array is None:
        return empty(shape, np.float32)
    fits = array.dtype == np.float32 and array.shape == shape
    if not (fits and array.flags.c_contiguous and array.flags.writeable):
        raise LeapRayError(
            f"the buffer of pass {name} must be float32 {shape} without gaps, and writeable; "
            f"it is {array.dtype} {array.shape}"
        )
    return array
