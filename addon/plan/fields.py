# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces of scalar fields: volumes on the data's own lattice, beside those of meshes (no bpy).

Nothing is voxelized: the samples are the data's. What does not fit into the memory is made
coarser by powers of two, and a warning names both sizes. In layout "scene" these volumes stay
apart from the one that meshes share, for their lattices have nothing in common.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

import leapray
from leapray._abi import LR_OWN_INDEX
from leapray.scalar_grid import Leaves, ScalarGrid

from .. import arrays, model
from ..store import memory_cache
from . import clips, fastest, field_filters, label_solids, looks, objects, other_grids
from .levels import MB
from .planned import Plan

MESH_SHARE = 1 / 4  # of the memory that is left for meshes, where there are some
SAMPLES = "samples"  # what the cache calls those that surfaces share
Stored = TypeVar("Stored", leapray.Isosurfaces, leapray.FieldSamples)


@dataclass(frozen=True)
class Surface:
    """The surface of a field at one of its thresholds, or of one solid of its labels."""

    field: int  # index into Scene.fields
    number: int  # of the threshold, or the solid
    structure: leapray.Structure
    factor: int  # samples of the data along a side of a voxel
    volume_nbytes: int  # with samples that surfaces share on the first of them
    scale: float = 1.0  # the value is offset + scale * occupancy
    offset: float = 0.0
    light: dict[str, Any] | None = None  # members of its instances: what it scatters, without one

    @property
    def error(self) -> float:
        """How far the surface may lie from that of the data, about: half a voxel, if coarser."""
        return voxel_size(self.structure) / 2 if self.factor > 1 else 0.0


def voxel_size(structure: leapray.Structure) -> float:
    """The longest side of a voxel, in object space."""
    matrix = structure.volume.info.object_from_index
    return float(np.linalg.norm(matrix[:3, :3], axis=0).max())


class Fields:
    """The surfaces of all fields that are placed, within so many bytes as room.

    advance: called with the share 0..1 of them that is made.
    """

    def __init__(
        self,
        scene: model.Scene,
        instances: Sequence[model.FieldInstance],
        cache: memory_cache.Cache,
        watch: leapray.Watch,
        threads: int,
        room: float,
        advance: Callable[[float], None] = lambda share: None,
    ) -> None:
        self.scene, self.instances = scene, instances
        self.cache, self.watch, self.threads = cache, watch, threads
        self.seconds = {"voxelize": 0.0, "structure": 0.0}
        self.warnings: list[str] = []
        self.surfaces: list[Surface] = []
        self.cutters: dict[int, leapray.Structure] = {}  # of the fields that are cut
        self.clips: dict[int, model.Clip] = {}  # by which they are
        self.wholes: dict[int, leapray.Volume] = {}  # all labels of those that have several solids
        self.others: dict[tuple, other_grids.Samples] = {}  # grids that colour surfaces
        users: dict[int, str] = {}  # the first object of each field
        for instance in instances:
            users.setdefault(instance.field, instance.name)
        # The small ones first: what they leave of their shares goes to the large ones.
        order = sorted(users, key=lambda n: np.prod(np.ptp(objects.lattice(self._grid(n)), axis=0)))
        self.read_nbytes = sum(scene.fields[n].read_nbytes for n in order)
        room -= self.read_nbytes
        for done, n in enumerate(order):
            share = (room - self.nbytes) / (len(order) - done)
            self._make(n, users[n], share - self._cut(n, users[n], share))
            advance((done + 1) / len(order))
        used = {each.field for each in self.surfaces}
        for instance in instances:
            if instance.field in used:
                self._read_others(instance, room - self.nbytes)
        self.cutters = {n: made for n, made in self.cutters.items() if n in used}
        if scene.settings.layout == "scene" and self.surfaces:
            self.warnings.append(
                "In layout 'scene' the surfaces of volume objects keep volumes of their own."
            )

    @property
    def nbytes(self) -> int:
        return self.volume_nbytes + self.structure_nbytes

    @property
    def volume_nbytes(self) -> int:
        own = sum(each.volume_nbytes for each in self.surfaces)
        volumes = [*(each.volume for each in self.cutters.values()), *self.wholes.values()]
        volumes += [each.volume for each in self.others.values()]
        return own + sum(each.info.nbytes for each in volumes)

    @property
    def structure_nbytes(self) -> int:
        return sum(each.nbytes for each in self._structures())

    def _structures(self) -> list[leapray.Structure]:
        return [*(each.structure for each in self.surfaces), *self.cutters.values()]

    def _grid(self, n: int) -> ScalarGrid:
        return self.scene.fields[n].grid

    def _cut(self, n: int, name: str, room: float) -> int:
        """Make what cuts a field, if anything does; the bytes that it takes."""
        clip = self.scene.fields[n].clip
        if clip is None:
            return 0
        began = time.perf_counter()
        clip = self.clips[n] = clips.bounded(clip, self._corners(n))
        try:
            made = clips.solid(
                clip, self.scene.settings.traverser, self.cache, self.watch, self.threads, room
            )
        except leapray.Stopped:
            raise
        except leapray.LeapRayError as error:
            self.warnings.append(f"{name!r} is not cut by {clip.name!r}: {error}.")
            return 0
        self.seconds["voxelize"] += time.perf_counter() - began
        self.cutters[n] = made
        return made.volume.info.nbytes + made.nbytes

    def _corners(self, n: int) -> NDArray[np.float64]:
        """(m, 3): of boxes round all places of a field, in the world."""
        found = []
        for instance in self.instances:
            if instance.field == n:
                matrix = np.asarray(instance.world_from_object)
                local = objects.corners(self.scene, instance)
                found.append(local @ matrix[:3, :3].T + matrix[:3, 3])
        return np.concatenate(found)

    def _read_others(self, instance: model.FieldInstance, room: float) -> None:
        """The grids whose values colour an instance."""
        for color in instance.colors:
            other = color.other if color else None
            if other is None or other_grids.key(other) in self.others:
                continue
            name, began = other.grid.name, time.perf_counter()
            try:
                found = other_grids.samples(other, self.cache, self.watch, self.threads, room)
            except leapray.Stopped:
                raise
            except leapray.LeapRayError as error:
                self.warnings.append(f"{instance.name!r} has no colors of {name!r}: {error}.")
                continue
            self.seconds["voxelize"] += time.perf_counter() - began
            self.others[other_grids.key(other)] = found
            room -= found.volume.info.nbytes
            if found.factor > 1:
                self.warnings.append(
                    f"{instance.name!r} has the colors of one in {found.factor} samples of "
                    f"{name!r} along each axis, for its memory budget holds no more."
                )

    def _make(self, n: int, name: str, room: float) -> None:
        """The surfaces of a field on the finest lattice that fits into room."""
        factor = 1
        while factor <= field_filters.COARSEST:
            try:
                found, warnings = self._surfaces(n, name, factor, room)
            except leapray.Stopped:
                raise
            except leapray.OutOfMemory:
                self._drop_samples(n, factor)
                factor *= 2
                continue
            except leapray.LeapRayError as error:
                self.warnings.append(f"{name!r} is skipped: {error}.")
                return
            self.surfaces += found
            self.warnings += warnings
            if factor > 1 and found:
                self.warnings.append(self._coarser(n, name, factor, room))
            return
        raise objects.SceneError(
            f"With {name!r} at its coarsest level the scene needs more than the "
            f"{self.scene.settings.memory_mb} MB of its budget."
        )

    def _coarser(self, n: int, name: str, factor: int, room: float) -> str:
        """The sentence on a field whose own samples do not fit."""
        size = np.ptp(objects.lattice(self._grid(n)), axis=0) - 1
        whole, made = (" x ".join(str(-(-int(side) // by)) for side in size) for by in (1, factor))
        return (
            f"{name!r} is rendered with {made} samples of its {whole}, which do not fit into the "
            f"{room / MB:.0f} MB of the memory budget that are left for them."
        )

    def _surfaces(
        self, n: int, name: str, factor: int, room: float
    ) -> tuple[list[Surface], list[str]]:
        """On a lattice that many times coarser, and what is missing; OutOfMemory where they do not
        fit."""
        field, found, left = self.scene.fields[n], [], room
        if field.labels is not None:
            return self._solids(n, factor, room), []
        if field.look is not None:
            return self._seen(n, name, factor, room)
        known: list[leapray.Isosurfaces] = []
        warnings: list[str] = []
        for number, threshold in enumerate(field.thresholds):
            self._check_cancelled()
            samples = self._samples(field, threshold, factor, room)
            if why := _no_surface(field, samples, threshold):
                warnings.append(f"{name!r} has no surface at {threshold:.6g}, for {why}.")
                continue
            made = functools.partial(samples.at, threshold, threads=self.threads, watch=self.watch)
            key = *self._key(field, factor), threshold
            shared = samples.nbytes if known and samples is known[-1] else 0
            structure = self._structure(key, made, left + shared, samples.nbytes)
            nbytes = structure.volume.info.nbytes - shared
            left -= nbytes + structure.nbytes
            known.append(samples)
            law = samples.scale, samples.offset
            found.append(Surface(n, number, structure, factor, nbytes, *law))
        return found, warnings

    def _solids(self, n: int, factor: int, room: float) -> list[Surface]:
        """Those of labels; OutOfMemory where they do not fit."""
        field, found, left = self.scene.fields[n], [], room
        assert field.labels is not None
        for number in range(len(field.labels.bodies)):
            self._check_cancelled()
            key = *self._key(field, factor), label_solids.key(field, number, factor)
            made = functools.partial(
                label_solids.made, field, number, factor, self.threads, self.watch, left
            )
            structure = self._structure(key, made, left)
            nbytes = structure.volume.info.nbytes
            left -= nbytes + structure.nbytes
            found.append(Surface(n, number, structure, factor, nbytes))
        if n in self.cutters and len(found) > 1:
            self.wholes[n] = self._whole(field, factor, left)
        return found

    def _seen(self, n: int, name: str, factor: int, room: float) -> tuple[list[Surface], list[str]]:
        """What is visible of a field by its look: of all samples, which looks share, or where these
        do not fit of those that it needs; OutOfMemory where they do not either."""
        field = self.scene.fields[n]
        try:
            samples = self._stored(
                self._seen_key(field, factor), field, 0.0, factor, room, leapray.FieldSamples
            )
            return self._shown(n, name, factor, room, samples)
        except leapray.OutOfMemory:
            self._drop_samples(n, factor)
        assert field.look is not None
        look, voxel, key = field.look, looks.voxel(field), self._own_key(field, factor)
        made = functools.partial(
            leapray.FieldSamples,
            transfer=lambda low, high: looks.transfer(look, low, high, voxel).function,
        )
        samples = self._stored(key, field, 0.0, factor, room, made)
        return self._shown(n, name, factor, room, samples)

    def _shown(
        self, n: int, name: str, factor: int, room: float, samples: leapray.FieldSamples
    ) -> tuple[list[Surface], list[str]]:
        field = self.scene.fields[n]
        assert field.look is not None
        if not samples.low <= samples.high:
            return [], [f"{name!r} shows nothing, for its data hold no value."]
        transfer = looks.transfer(field.look, samples.low, samples.high, looks.voxel(field))
        if not transfer.function.visible:
            return [], [f"{name!r} shows nothing, for nothing of its values is opaque or emits."]
        made = functools.partial(
            samples.at, transfer.function, threads=self.threads, watch=self.watch
        )
        own = *self._seen_key(field, factor), *field.look.seen_key
        structure = self._structure(own, made, room, samples.nbytes)
        if not structure.volume.info.n_surface_cells:
            return [], [f"{name!r} shows nothing, for {objects.no_cells(field.grid)}."]
        nbytes = structure.volume.info.nbytes
        light = looks.light_of(field, transfer)
        return [Surface(n, 0, structure, factor, nbytes, light=light)], transfer.doubts(name)

    def _whole(self, field: model.Field, factor: int, room: float) -> leapray.Volume:
        key = "labels", *self._key(field, factor), label_solids.key(field, None, factor)
        volume = self.cache.get(key)
        if volume is None:
            began = time.perf_counter()
            volume = label_solids.made(field, None, factor, self.threads, self.watch, room)
            self.seconds["voxelize"] += time.perf_counter() - began
        return self.cache.put(key, volume, volume.info.nbytes)

    def _drop_samples(self, n: int, factor: int) -> None:
        """Of a lattice that is too fine."""
        field = self.scene.fields[n]
        self.cache.drop(self._seen_key(field, factor))
        self.cache.drop(self._own_key(field, factor))
        for threshold in field.thresholds:
            self.cache.drop(self._samples_key(field, threshold, factor))

    def _check_cancelled(self) -> None:
        if self.watch.stopped:
            raise leapray.Stopped("The planning was stopped.")

    def _samples(
        self, field: model.Field, threshold: float, factor: int, room: float
    ) -> leapray.Isosurfaces:
        """The samples that a field's surfaces share, from the cache or stored now.

        Where small parts are left out, each threshold has its own.
        """
        key = self._samples_key(field, threshold, factor)
        made = functools.partial(
            leapray.Isosurfaces,
            above=field.above,
            capped=field.capped,
            interpolation=field.interpolation,
        )
        return self._stored(key, field, threshold, factor, room, made)

    def _stored(
        self,
        key: tuple,
        field: model.Field,
        threshold: float,
        factor: int,
        room: float,
        made: Callable[..., Stored],
    ) -> Stored:
        """The samples of a field, from the cache or as made stores them."""
        samples = self.cache.get(key)
        if samples is None:
            began = time.perf_counter()
            self.cache.trim(int(room - _foreseen(field.grid, factor)))
            samples = made(
                field_filters.filtered(field, threshold, factor, room, self.threads, self.watch),
                threads=self.threads,
                watch=self.watch,
                max_nbytes=max(int(room), 1),
            )
            self.seconds["voxelize"] += time.perf_counter() - began
        return self.cache.put(key, samples, samples.nbytes)

    def _samples_key(self, field: model.Field, threshold: float, factor: int) -> tuple:
        return SAMPLES, *self._key(field, factor), threshold if field.least else None

    def _seen_key(self, field: model.Field, factor: int) -> tuple:
        """Of the samples that looks of a field share."""
        return SAMPLES, "seen", *self._key(field, factor)

    def _own_key(self, field: model.Field, factor: int) -> tuple:
        """Of the samples that a field's own look needs."""
        return *self._seen_key(field, factor), field.look and field.look.seen_key, "alone"

    def _key(self, field: model.Field, factor: int) -> tuple[str, str]:
        told = field.above, field.capped, field.smoothing, field.interpolation, field.least, factor
        where = np.asarray(field.grid.world_from_index)
        return field.contents, arrays.digest((where,), repr(told).encode())

    def _structure(
        self, key: tuple, made: Callable[[], leapray.Volume], room: float, shared: int = 0
    ) -> leapray.Structure:
        """From the cache, or of the volume that is made. shared: bytes of its samples that the
        cache counts elsewhere."""
        traverser = self.scene.settings.traverser
        key = "surface", *key, traverser
        structure = self.cache.get(key)
        if structure is None:
            began = time.perf_counter()
            volume = made()
            middle = time.perf_counter()
            _check_room(volume.info.nbytes, room)
            structure = leapray.build(
                volume, fastest.first(traverser), threads=self.threads, watch=self.watch
            )
            self.seconds["voxelize"] += middle - began
            self.seconds["structure"] += time.perf_counter() - middle
        nbytes = structure.volume.info.nbytes + structure.nbytes
        _check_room(nbytes, room)
        self.cache.put(key, structure, nbytes - shared)
        self.cache.trim(int(room - nbytes))
        return structure

    # ---- what becomes of them

    def join(self, plan: Plan) -> None:
        """Put the surfaces into a plan, behind the volumes of meshes."""
        first: dict[tuple, int] = {}
        of_field: dict[int, list[tuple[int, Surface]]] = {}
        for at, each in enumerate(self.surfaces, len(plan.volumes) + 1):
            of_field.setdefault(each.field, []).append((at, each))
        first_cut = len(plan.volumes) + len(self.surfaces) + 1
        cut_at = {n: at for at, n in enumerate(self.cutters, first_cut)}
        if plan.slot_objects is None and any(each.slot_objects for each in self.instances):
            plan.slot_objects = [LR_OWN_INDEX] * len(plan.slots)
        for instance in self.instances:
            own = instance if plan.slot_names is not None else None
            key = instance.materials, instance.slot_objects, id(own)
            if key not in first:
                first[key] = len(plan.slots)
                plan.slots += instance.materials
                _tell_slots(plan, instance)
            shown = of_field.get(instance.field, [])
            plan.instances += self._placed(instance, shown, first[key], cut_at)
            plan.names += [instance.name] * (len(plan.instances) - len(plan.names))
        plan.volumes += [self._row(each) for each in self.surfaces]
        plan.volumes += [self._cut_row(n) for n in self.cutters]
        plan.warnings += self.warnings
        plan.volume_nbytes += self.volume_nbytes
        plan.structure_nbytes += self.structure_nbytes
        for phase, seconds in self.seconds.items():
            plan.seconds[phase] += seconds

    def _placed(
        self,
        instance: model.FieldInstance,
        shown: list[tuple[int, Surface]],
        first: int,
        cut_at: dict[int, int],
    ) -> list[leapray.Instance]:
        """The surfaces of a placed field, each with its number among the volumes, and the faces
        of its cut."""
        field = self.scene.fields[instance.field]
        clip, cutter = self.clips.get(instance.field), self.cutters.get(instance.field)
        if clip is None or cutter is None or not shown:
            return [self._instance(instance, each, first, at) for at, each in shown]
        clipped = [clips.of_surface(clip, cutter)]
        made = [self._instance(instance, each, first, at, clipped) for at, each in shown]
        if field.labels is not None:
            whole = self.wholes.get(instance.field, shown[0][1].structure.volume)
            color = label_solids.ids_of(whole, instance)
            more = {"volume_index": cut_at[instance.field], "field_color": color}
            return [*made, clips.face(clip, cutter, made[0], whole, **more)]
        outermost = (min if field.above else max)(
            range(len(shown)), key=lambda k: field.thresholds[shown[k][1].number]
        )
        if field.capped:  # else the data have no inside
            slot = min(len(field.thresholds), len(instance.materials) - 1)
            more = {
                "first_material": first + slot,
                "volume_index": cut_at[instance.field],
                "field_color": self._color(instance, shown[outermost][1], slot),
            }
            data = shown[outermost][1].structure.volume
            made.append(clips.face(clip, cutter, made[outermost], data, **more))
        return made

    def _color(
        self, instance: model.FieldInstance, surface: Surface, slot: int
    ) -> leapray.FieldColor | None:
        """What colours a surface, or the faces of a cut, with the material in that slot."""
        color = instance.colors[slot] if instance.colors else None
        if color is None:
            return None
        law: tuple = (surface.structure.volume, surface.scale, surface.offset)
        if color.other is not None:
            found = self.others.get(other_grids.key(color.other))
            if found is None:
                return None
            law = found.volume, found.scale, found.offset
        volume, scale, offset = law
        placed = instance.world_from_object
        return leapray.FieldColor(volume, placed, color.program, scale, offset, color.part)

    def _instance(
        self,
        instance: model.FieldInstance,
        surface: Surface,
        first: int,
        volume: int,
        clipped: Sequence[leapray.Clip] = (),
    ) -> leapray.Instance:
        if self.scene.fields[surface.field].labels is not None:
            slot, n = 0, len(instance.materials)
            color: leapray.FieldColor | None = label_solids.ids_of(
                surface.structure.volume, instance
            )
        else:
            slot, n = min(surface.number, len(instance.materials) - 1), 1
            color = self._color(instance, surface, slot)
        look = self.scene.fields[surface.field].look
        return leapray.Instance(
            surface.structure,
            **objects.told_of(instance),
            first_material=first + slot,
            n_materials=n,
            volume_index=volume,
            error=surface.error * objects.scales([instance.world_from_object])[0],
            clips=clipped,
            field_color=color,
            volume_unit=looks.unit(look, instance.world_from_object) if look else 0.0,
            **(surface.light or {}),
        )

    def _cut_row(self, n: int) -> dict[str, object]:
        clip = self.scene.fields[n].clip
        assert clip is not None
        return {
            **self._bare_row(n, self.cutters[n], self.cutters[n].volume.info.nbytes),
            "kind": "clip",
            "why": f"{clip.name!r} cuts it",
        }

    def _row(self, surface: Surface) -> dict[str, object]:
        field, exact = self.scene.fields[surface.field], surface.factor == 1
        if field.look is not None:
            told: dict[str, object] = {"kind": "volume", "why": "a volume shader"}
        elif field.labels is not None:
            n = len(field.labels.bodies[surface.number])
            told = {"kind": "labels", "why": f"{n} label{'s' * (n != 1)}", "labels": n}
        else:
            threshold = field.thresholds[surface.number]
            why = f"a threshold of {threshold:g}"
            told = {"kind": "isosurface", "why": why, "threshold": threshold}
        return {
            **self._bare_row(surface.field, surface.structure, surface.volume_nbytes),
            **told,
            "part": surface.number,
            "coarser": surface.factor,
            "error_footprints": 0.0 if exact else None,  # else not measured
            "stuck": "" if exact else "the memory budget ends",
        }

    def _bare_row(
        self, n: int, structure: leapray.Structure, volume_nbytes: int
    ) -> dict[str, object]:
        """What the report tells of any volume that belongs to a field."""
        info = structure.volume.info
        users = [each for each in self.instances if each.field == n]
        return {
            "name": users[0].name,
            "field": self.scene.fields[n].name,
            "part": 0,
            "size": list(info.size),
            "voxel_size": voxel_size(structure),
            "sample_type": info.dtype,
            "error_footprints": None,
            "nbytes": volume_nbytes + structure.nbytes,
            "volume_nbytes": volume_nbytes,
            "structure_nbytes": structure.nbytes,
            "instances": len(users),
            "stuck": "",
        }


def _tell_slots(plan: Plan, instance: model.FieldInstance) -> None:
    """What object the slots of a placed field belong to, where slots tell that."""
    n = len(instance.materials)
    if plan.slot_objects is not None:
        own = instance.object_index if plan.slot_names is not None else LR_OWN_INDEX
        plan.slot_objects += instance.slot_objects or [own] * n
    if plan.slot_names is not None:
        plan.slot_names += [instance.name] * n


def _no_surface(field: model.Field, samples: leapray.Isosurfaces, threshold: float) -> str:
    """Why there is none at a threshold, or ""."""
    if not samples.low < threshold < samples.high:
        return f"its values lie between {samples.low:.6g} and {samples.high:.6g}"
    stored = field.grid.samples
    if isinstance(stored, Leaves):
        around = field.grid.offset + field.grid.scale * stored.background
        if around >= threshold if field.above else around <= threshold:
            return f"the inside would be all of space: round the data lies {around:.6g}"
    return ""


def _foreseen(grid: ScalarGrid, factor: int) -> float:
    """Bytes that the samples of a grid take, about."""
    held = grid.samples.samples if isinstance(grid.samples, Leaves) else grid.samples
    return held.size * min(held.dtype.itemsize, 4) / factor**3


def _check_room(nbytes: int, room: float) -> None:
    """Raise OutOfMemory where so many bytes do not fit."""
    if nbytes > room:
        error = leapray.OutOfMemory(
            f"the surface needs {nbytes / MB:.0f} MB, {max(room, 0) / MB:.0f} MB are left"
        )
        error.nbytes = nbytes
        raise error
