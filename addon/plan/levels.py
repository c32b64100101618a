# SPDX-License-Identifier: GPL-3.0-or-later
"""Volumes on their levels: made, measured, kept within the memory budget (no bpy)."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

import leapray
from leapray.voxelization import filter_info, slope

from .. import model
from ..store import disk_cache, memory_cache
from . import error_metric, fastest, mesh_colors, probes, sample_types
from .mesh_split import solids

FINER = 6  # levels beyond the one asked for on which a volume may still be at hand
MB = 1 << 20
NO_END = 1 << 62  # bytes
KEPT = "volume", "structure"  # what the cache holds of a level, beside what was measured


@dataclass
class Work:
    """One volume on its way."""

    index: int  # of the mesh in the scene
    part: int  # of the mesh
    name: str  # of the object that stands for it in messages
    mesh: model.Mesh  # or the part of it
    digest: str
    matrices: NDArray[np.float64]  # (n, 4, 4) of its instances
    shown: NDArray[np.bool_]  # (n,) whether the camera sees them
    with_ids: bool
    color_set: mesh_colors.ColorSet = field(default_factory=mesh_colors.ColorSet)
    one_island: bool = False  # whether the mesh is known to be that
    carries: str = ""  # a digest of what the colour set takes from the mesh; "": nothing
    turn: float = sample_types.TURN  # of normals, that its materials do not show
    refracts: bool = False  # some material of it,
    fills: bool = False  # likewise
    weights: probes.Weights | None = None
    measure: error_metric.Measure | None = None
    seen: list[tuple[error_metric.Measure, error_metric.Errors]] = field(
        default_factory=list, repr=False, compare=False
    )  # of all that was measured on it
    errors: error_metric.Errors = field(init=False, repr=False, compare=False)  # as seen
    structure: leapray.Structure | None = None
    stuck: str = ""  # why it is no finer, where it should be
    exact: str = "sheets"  # whose cells keep their triangles, see leapray.voxelize
    asked_all: bool = False  # whether it was tried to keep all of them for want of finer voxels
    own_normals: bool = False  # shading is the mesh's own at any voxel size, smooth or flat
    dtype: str = ""  # of its samples; "": u16, or u8 where that is enough
    history: list[float] = field(default_factory=list)
    keys: list[tuple] = field(default_factory=list)  # under which the cache holds its level

    @property
    def measured(self) -> error_metric.Measure:
        """What was measured on its level, once it has entered one."""
        assert self.measure is not None
        return self.measure

    @property
    def built(self) -> leapray.Structure:
        """The structure of its level, once that is complete."""
        assert self.structure is not None
        return self.structure

    @property
    def fixed(self) -> bool:
        """Whether the object says how fine the volume is."""
        return self.mesh.modelling.resolution > 0

    def needs(self, pixel_error: float) -> tuple[float, float, float, float]:
        """How many times too coarse the surface is, its colours, edges, normals; 1: good."""
        e = self.errors
        surface, color = max(e.of_surface(pixel_error), 1.0), max(e.of_color(), 1.0)
        return surface, color, max(e.of_edges(), 1.0), max(e.of_normals(), 1.0)

    def turned_only(self, pixel_error: float) -> bool:
        """Whether all that is not good enough are shading normals."""
        *others, normals = self.needs(pixel_error)
        return normals > 1.0 and max(others) == 1.0


@dataclass(frozen=True)
class Room:
    """Bytes that a volume may take, and that it may take with the scratch to make it."""

    volume: int
    both: int

    @classmethod
    def of(cls, volume: float, both: float) -> Room:
        return cls(*(max(1, int(min(nbytes, NO_END))) for nbytes in (volume, both)))

    def without(self, nbytes: int) -> Room:
        return Room.of(self.volume - nbytes, self.both - nbytes)


class Levels:
    """All volumes of a frame, each on one level, within one budget.

    cache: kept by the caller between frames; volumes by mesh and level, and what
    was measured on them. watch: stops the calls into the core.
    """

    def __init__(
        self, scene: model.Scene, cache: memory_cache.Cache, watch: leapray.Watch, threads: int
    ) -> None:
        self.scene, self.settings = scene, scene.settings
        self.cache, self.watch, self.threads = cache, watch, threads
        self.on_disk = disk_cache.DiskCache(self.settings.cache_folder)
        self.color_sets = mesh_colors.ColorSets(scene, cache, watch)
        self.budget = self.settings.memory_mb * MB
        self.seconds = {"voxelize": 0.0, "structure": 0.0, "plan": 0.0}
        self.warnings: list[str] = []
        self.works: list[Work] = []
        self.taken = 0  # bytes of what does not come from meshes
        self.peak = 0  # bytes, with scratch
        self.scratch = 0  # of the making of one volume, the most

    def check_cancelled(self) -> None:
        if self.watch.stopped:
            raise leapray.Stopped("The planning was stopped.")

    def _key(self, work: Work, what: str, voxel_size: float, dtype: str) -> tuple:
        s = self.settings
        made: tuple = what, work.digest, voxel_size, work.with_ids, work.carries, dtype
        made = *made, self._filter(work.mesh), s.half_width, work.exact
        made = *made, work.own_normals, work.mesh.modelling.kind
        return made if what == "volume" else (*made, s.traverser)

    def may_choose_cells(self, work: Work) -> bool:
        """Whether it is for the plan to say which cells keep their triangles, and how fine."""
        automatic = self.settings.exact == "auto" and work.mesh.solids is None
        return automatic and not (work.fixed or self.settings.resolution)

    def _filter(self, mesh: model.Mesh) -> str:
        return mesh.modelling.filter or self.settings.filter

    def held(self) -> int:
        """Bytes of all volumes and structures that are alive, as far as the plan has come."""
        return self.taken + sum(w.measure.nbytes for w in self.works if w.measure)

    def structure(
        self,
        work: Work,
        voxel_size: float,
        types: tuple[str, ...],
        room: float,
        volume_room: float = math.inf,
        settle: Callable[[leapray.Volume, bool], None] = lambda volume, fresh: None,
    ) -> leapray.Structure:
        """The structure of a level, which holds its volume.

        types: of samples that will do if there are some, the last where there are none.
        room: bytes for both, volume_room: for the volume alone; OutOfMemory where
        they do not suffice. The structure's share is foreseen from the level before.
        settle: called with a volume before its structure is built, and whether nobody
        else has it.
        """
        for dtype in types:
            structure = self.cache.get(self._key(work, "structure", voxel_size, dtype))
            if structure is not None:
                self.cache.get(self._key(work, "volume", voxel_size, dtype))
                settle(structure.volume, False)
                return structure
        measure, share = work.measure, 1.0
        if measure is not None:
            share = measure.volume_nbytes / measure.nbytes
            foreseen = measure.nbytes * (measure.voxel_size / voxel_size) ** 2
            self.cache.trim(int(self.budget - self.held() - foreseen))
        began = time.perf_counter()
        most = Room.of(min(room * share, volume_room), room)
        volume, fresh = self._volume(work, voxel_size, types, most)
        middle = time.perf_counter()
        settle(volume, fresh)
        settled = time.perf_counter()
        structure = leapray.build(
            volume, fastest.first(self.settings.traverser), threads=self.threads, watch=self.watch
        )
        self.seconds["voxelize"] += middle - began
        self.seconds["structure"] += time.perf_counter() - settled
        nbytes = volume.info.nbytes + structure.nbytes
        self.cache.trim(self.budget - self.held() - nbytes)
        self.peak = max(self.peak, self.held() + nbytes + self.cache.unused())
        if nbytes > room:
            raise leapray.OutOfMemory(
                f"the level needs {nbytes / MB:.0f} MB, {max(room, 0) / MB:.0f} MB are left"
            )
        keys = [self._key(work, what, voxel_size, volume.info.dtype) for what in KEPT]
        self.cache.put(keys[0], volume, volume.info.nbytes)
        return self.cache.put(keys[1], structure, structure.nbytes)

    def _volume(
        self, work: Work, voxel_size: float, types: tuple[str, ...], room: Room
    ) -> tuple[leapray.Volume, bool]:
        """The volume of a level: from the cache, from the folder, or made of the mesh.

        Then whether it was made.
        """
        for dtype in types:
            key = self._key(work, "volume", voxel_size, dtype)
            volume = self.cache.get(key) or self._shelved(work, key, room.volume)
            if volume is None:
                continue
            if volume.info.nbytes <= room.volume:
                return volume, False
            error = leapray.OutOfMemory("the level's volume is larger than its room")
            error.nbytes = volume.info.nbytes
            raise error
        kernel = self._filter(work.mesh)
        try:
            return self._voxelize(work, voxel_size, dtype, room, kernel), True
        except (leapray.Stopped, leapray.OutOfMemory):
            raise
        except leapray.LeapRayError:
            if not filter_info(kernel, dtype).of_solids:
                raise
        volume = self._voxelize(work, voxel_size, dtype, room, "ramp")
        why = f"{work.name!r} has no inside for the filter {kernel}: ramp instead."
        if why not in self.warnings:
            self.warnings.append(why)
        return volume, True

    def _shelved(self, work: Work, key: tuple, max_nbytes: int) -> leapray.Volume | None:
        """The volume from the folder, with its textures, or None."""
        volume = self.on_disk.volume(key, max_nbytes, self.watch)
        if volume is None or not volume.info.has_colors:
            return volume
        try:
            volume.bind(self.color_sets.textures(work.color_set))
        except leapray.LeapRayError:  # it was joined of parts with textures of their own
            return None
        return volume

    def _voxelize(
        self, work: Work, voxel_size: float, dtype: str, room: Room, kernel: str
    ) -> leapray.Volume:
        """Of solids that share the volume each is made by itself; then they are merged."""
        parts, left = [], room
        for mesh in solids(work.mesh):
            if work.mesh.solids is None:
                return self._voxelize_one(work, mesh, voxel_size, dtype, left, kernel)
            part = self._solid(work, mesh, voxel_size, dtype, left, kernel)
            parts.append(part)
            taken = sum(each.info.nbytes for each in parts)
            left = room.without(taken)
            if taken >= room.volume:
                error = leapray.OutOfMemory("the solids take more than their room")
                error.nbytes = taken
                raise error
        merged = leapray.merge(parts, watch=self.watch)
        merged.mesh_info = parts[0].mesh_info
        nbytes = merged.info.nbytes  # the parts are in the cache
        self.peak = max(self.peak, self.held() + nbytes + self.cache.unused())
        return merged

    def _solid(
        self,
        work: Work,
        mesh: model.Mesh,
        voxel_size: float,
        dtype: str,
        room: Room,
        kernel: str,
    ) -> leapray.Volume:
        """One that shares the volume, kept for the next time as long as nothing else needs room."""
        digests = mesh.contents, mesh_colors.digest(mesh, work.color_set)
        s, own = self.settings, mesh.modelling
        key = "solid", *digests, voxel_size, work.with_ids, dtype, kernel, s.half_width
        part = self.cache.get((*key, own.kind))
        if part is None or part.info.nbytes > room.volume:
            part = self._voxelize_one(work, mesh, voxel_size, dtype, room, kernel)
        return self.cache.put((*key, own.kind), part, part.info.nbytes, unused=True)

    def _voxelize_one(
        self,
        work: Work,
        mesh: model.Mesh,
        voxel_size: float,
        dtype: str,
        room: Room,
        kernel: str,
    ) -> leapray.Volume:
        own = kernel == self.settings.filter
        volume = leapray.voxelize(
            mesh.vertices,
            mesh.triangles,
            voxel_size,
            kind=mesh.modelling.kind,
            filter=kernel,
            half_width=self.settings.half_width or None if own else None,
            ids=mesh.slots if work.with_ids else None,
            attributes=self._attributes(work, mesh, voxel_size),
            dtype=dtype,
            exact=work.exact if work.mesh.solids is None else "none",
            flat=work.own_normals and mesh.corner_normals is None,
            threads=self.threads,
            watch=self.watch,
            max_nbytes=room.both,
            max_volume_nbytes=room.volume,
        )
        scratch = volume.mesh_info.scratch_nbytes
        self.scratch = max(self.scratch, scratch)
        nbytes = self.held() + volume.info.nbytes + scratch
        self.peak = max(self.peak, nbytes + self.cache.unused())
        return volume

    def _attributes(
        self, work: Work, mesh: model.Mesh, voxel_size: float
    ) -> leapray.Attributes | None:
        kind = work.measure.kind if work.measure else ""
        facets = work.own_normals and work.exact not in ("all", "every") and kind == "solid"
        smooth = work.own_normals or self._shows_facets(work, mesh, voxel_size)
        return self.color_sets.attributes(mesh, work.color_set, smooth, facets)

    def _shows_facets(self, work: Work, mesh: model.Mesh, voxel_size: float) -> bool:
        """Whether volumes of the work's mesh, or of a solid of it, need its normals from there."""
        at = self._probes(work)
        if mesh.corner_normals is None or voxel_size > mesh_colors.widest_voxel(at.largest):
            return False
        key = "facets", work.digest, work.carries
        widest = self.cache.get(key) if mesh is work.mesh else None
        if widest is None:
            widest = mesh_colors.facet_voxel(mesh, len(at.creases) > 0)
            if mesh is work.mesh:
                self.cache.put(key, widest)
        return voxel_size < widest

    def _kernel(self, mesh: model.Mesh, volume: leapray.Volume) -> tuple[str, float]:
        """The filter that the volume was made with, and its half width; 0: its own."""
        s, kernel = self.settings, self._filter(mesh)
        dtype = volume.info.dtype
        if volume.info.kind == "sheet" and filter_info(kernel, dtype).of_solids:
            kernel = "ramp"
        return kernel, s.half_width if kernel == s.filter else 0.0

    def drop(self, work: Work) -> None:
        """Forget the volume of a level that is left, if this frame has made it.

        What was measured on it stays.
        """
        for key in work.keys if work.structure is not None else ():
            self.cache.drop(key)
        work.structure, work.keys = None, []

    def _probes(self, work: Work) -> probes.Probes:
        key = self.probes_key(work.digest)
        return self.cache.get(key) or self.cache.put(key, self.draw(work.mesh, work.one_island))

    @staticmethod
    def probes_key(digest: str) -> tuple:
        return "probes", digest

    def draw(self, mesh: model.Mesh, one_island: bool) -> probes.Probes:
        return probes.draw(mesh, self.check_cancelled, self.watch, one_island)

    def cells(self, work: Work, voxel_size: float) -> float:
        """How many cells of that size the surface goes through, about."""
        return self._probes(work).area / voxel_size**2

    def enter(
        self, work: Work, voxel_size: float, room: float, volume_room: float = math.inf
    ) -> None:
        """Put the mesh on a level; OutOfMemory, and nothing changed, where it does not fit."""
        measure, structure = self._known(work, voxel_size), None
        if measure is None:
            found: list[error_metric.Measure] = []

            def settle(volume: leapray.Volume, fresh: bool) -> None:
                found.append(self._settle(work, volume, voxel_size, fresh))

            types = self._types(work)
            structure = self.structure(work, voxel_size, types, room, volume_room, settle)
            measure = dataclasses.replace(found[0], structure_nbytes=structure.nbytes)
            key = self._key(work, "measure", voxel_size, measure.dtype)
            self.cache.put(key, measure)
            self.on_disk.keep_record(key, measure)
        elif measure.nbytes > room or measure.volume_nbytes > volume_room:
            raise leapray.OutOfMemory(
                f"the level needs {measure.nbytes / MB:.0f} MB, {max(room, 0) / MB:.0f} MB are left"
            )
        keys = [self._key(work, what, voxel_size, measure.dtype) for what in KEPT]
        if keys != work.keys:
            self.drop(work)
        work.measure, work.structure, work.stuck, work.keys = measure, structure, "", keys
        work.errors = self._seen(work, measure)
        work.history.append(work.errors.progress(self.settings.pixel_error))

    def refused(self, work: Work, levels: int, volume_room: float) -> str:
        """Refine by so many levels, within the budget; why that cannot be, or ""."""
        try:
            size = work.measured.voxel_size / 2**levels
            self.enter(work, size, self.budget - self.held(), volume_room)
        except leapray.Stopped:
            raise
        except leapray.OutOfMemory:
            return "the memory budget ends"
        except leapray.LeapRayError as error:
            return str(error)
        return ""

    def pixels(self, work: Work) -> float:
        """How many pixels the surface would cover if all of it were turned to the camera."""
        return self._probes(work).area * float(self._weights(work).surface_pixels.mean())

    def _weights(self, work: Work) -> probes.Weights:
        if work.weights is None:
            work.weights = probes.weigh(self._probes(work), self.scene, work.matrices, work.shown)
        return work.weights

    def _seen(self, work: Work, measure: error_metric.Measure) -> error_metric.Errors:
        for known, errors in work.seen:  # also of what had other bytes, which nobody sees
            if known.surface is measure.surface and known.normal is measure.normal:
                return errors
        errors = error_metric.seen(measure, self._weights(work), self.settings.pixel_error)
        work.seen.append((measure, errors))
        return errors

    def _known(self, work: Work, voxel_size: float) -> error_metric.Measure | None:
        """What was measured on a level; where u8 and u16 were, u8 if that is enough.

        None as well where normals would have to be measured at more probes, and no finer volume
        is at hand that will be taken anyway.
        """
        keys = (self._key(work, "measure", voxel_size, t) for t in self._types(work))
        found = [m for key in keys if (m := self.cache.get(key) or self._kept(work, key))]
        known = [
            m
            for m in found
            if m.normals_known
            or not self._needs_normals(work, m)
            or self._at_hand(work, self._finer(work, voxel_size))
        ]
        for measure in known:
            if self._enough(work, measure):
                return measure
        if not work.dtype and any(measure.turn > work.turn for measure in known):
            work.dtype = "u16"  # on other levels normals turn as much
            return self._known(work, voxel_size)
        return known[-1] if known else None

    def _kept(self, work: Work, key: tuple) -> error_metric.Measure | None:
        """What is known from the folder."""
        measure = self.on_disk.record(key, error_metric.Measure)
        if measure is None or not measure.fits(self._probes(work)):
            return None
        return self.cache.put(key, measure)

    def _types(self, work: Work) -> tuple[str, ...]:
        """Of the samples that the work may have, the smallest first; none meets rays in "every"."""
        if work.dtype:
            return (work.dtype,)
        return ("u8",) if work.exact == "every" else ("u8", "u16")

    def _enough(self, work: Work, measure: error_metric.Measure) -> bool:
        enough = self._seen(work, measure).enough(self.settings.pixel_error)
        return enough and measure.turn <= work.turn

    def _needs_normals(self, work: Work, measure: error_metric.Measure) -> bool:
        """Whether its normals may be all that is wrong with it, or nobody makes it finer."""
        final = work.fixed or self.settings.resolution > 0
        return final or self._seen(work, measure).enough_but_normals(self.settings.pixel_error)

    def _settle(
        self, work: Work, volume: leapray.Volume, voxel_size: float, fresh: bool
    ) -> error_metric.Measure:
        """Measure a level's volume, and make a fresh one u8 where that is enough."""
        at, ids = self._probes(work), work.mesh.slots
        kernel, width = self._kernel(work.mesh, volume)
        rise = slope(kernel, width or filter_info(kernel, volume.info.dtype).half_width)
        color = self._color_errors(work, volume)
        known = work.mesh, at, voxel_size, color, rise
        measure = error_metric.measure(volume, *known, threads=self.threads)
        if self._needs_normals(work, measure):
            measure = error_metric.with_normals(measure, volume, work.mesh, at, self.threads)
        wide = volume.info.dtype != self._types(work)[0]
        if not (fresh and wide and self._enough(work, measure)):
            return measure
        gain = sample_types.gain(kernel, width)
        narrow = error_metric.measure(volume, *known, gain, measure.normal)
        if not self._enough(work, dataclasses.replace(narrow, turn=0.0)):
            return measure
        some = slice(None, None, sample_types.STEP)
        whose = None
        if volume.info.n_objects and ids is not None:
            whose = ids[at.surface_triangles[some]]
        turn = sample_types.turn(volume, at.surface[some], voxel_size, gain, whose)
        if turn > work.turn:
            return measure
        volume.narrow(gain, watch=self.watch)
        return dataclasses.replace(narrow, turn=turn, volume_nbytes=volume.info.nbytes)

    def _color_errors(self, work: Work, volume: leapray.Volume):
        if not volume.info.has_colors:
            return None
        at, size = self._probes(work), volume.info.object_from_index[0, 0]
        attributes = self._attributes(work, work.mesh, size)
        assert attributes is not None
        some = slice(None, None, error_metric.COLOR_STEP)
        return mesh_colors.color_errors(
            volume,
            work.mesh,
            attributes,
            at.surface[some],
            at.surface_triangles[some],
            at.surface_weights[some],
            size,
            self.threads,
        )

    def share_finest(self) -> None:
        """Volumes of equal contents become one, on the finest level that one of them is on.

        There the widest samples, and before all others the one that keeps all triangles. So the
        levels are the same whatever lies in cache and folder.
        """

        def fineness(work: Work) -> tuple[bool, float, float]:
            m = work.measured
            return work.exact == "every", -m.voxel_size, error_metric.STEPS[m.dtype]

        finest: dict[tuple, Work] = {}
        sharing = [work for work in self.works if not (work.fixed or self.settings.resolution)]
        for work in sorted(sharing, key=fineness, reverse=True):
            any_cells = self.perfect(work) if self.may_choose_cells(work) else work
            key = self._key(any_cells, "volume", 0.0, work.mesh.modelling.sample_type)
            best = finest.setdefault(key, work)
            if fineness(best) > fineness(work):
                self.drop(work)
                self._take(work, best, best.measured, best.structure)

    def _take(
        self,
        work: Work,
        kept: Work,
        measure: error_metric.Measure,
        structure: leapray.Structure | None,
    ) -> None:
        """Let the work have a volume that the other has, or had."""
        work.exact, work.own_normals = kept.exact, kept.own_normals
        work.measure, work.structure = measure, structure
        work.errors = self._seen(work, measure)

    def complete(self, work: Work) -> None:
        """Let the work have its structure, or that of a finer level at hand."""
        if work.structure is None and not self.take_finer(work):
            others = self.held() - work.measured.nbytes
            size, types = work.measured.voxel_size, (work.measured.dtype,)
            work.structure = self.structure(work, size, types, self.budget - others)

    def take_finer(self, work: Work) -> bool:
        """Take an earlier frame's volume that is finer than asked for, where there is room."""
        size = work.measured.voxel_size
        found = self._at_hand(work, [(size, work.measured.dtype), *self._finer(work, size)])
        if found is not None:
            kept, level = found
            all_of = (self.cache.get(self._key(kept, what, *level)) for what in ("measure", *KEPT))
            measure, _, structure = all_of
            self._take(work, kept, measure, structure)
        return found is not None

    def _finer(self, work: Work, voxel_size: float) -> list[tuple[float, str]]:
        """Levels beyond, on which its volume may still be at hand."""
        types = self._types(work)
        return [(voxel_size / 2**n, dtype) for n in range(1, FINER) for dtype in types]

    def perfect(self, work: Work) -> Work:
        """The same with all triangles in its cells, so that there are no errors."""
        return dataclasses.replace(work, exact="every", own_normals=True)

    def _at_hand(
        self, work: Work, levels: list[tuple[float, str]]
    ) -> tuple[Work, tuple[float, str]] | None:
        """The first of the levels, else of those with all triangles where the plan may choose them,
        whose volume is in the cache and fits in the work's place; and which of the two it is."""
        room = self.budget - self.held() + (work.measure.nbytes if work.measure else 0)
        for kept in (work, self.perfect(work))[: 1 + self.may_choose_cells(work)]:
            for level in levels:
                measure = self.cache.peek(self._key(kept, "measure", *level))
                structure = self.cache.peek(self._key(kept, "structure", *level))
                if measure is not None and structure is not None and measure.nbytes <= room:
                    return kept, level
        return None

    def keep_on_disk(self) -> None:
        """Put the volumes into the folder, where there is one."""
        for work in self.works:
            key = self._key(work, "volume", work.measured.voxel_size, work.measured.dtype)
            self.on_disk.keep_volume(key, work.built.volume, self.watch)
        if self.on_disk.trouble:
            self.warnings.append(self.on_disk.trouble)
