# SPDX-License-Identifier: GPL-3.0-or-later
"""Volumes on their levels: made, measured, kept within the memory budget (no bpy)."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

import leapray
from leapray.voxelization import SOLID_FILTERS, own_half_width, slope

from . import bake, errors, model, objects, probes
from . import cache as caches
from . import shelf as shelves
from .parts import solids

FINER = 6  # levels beyond the one asked for on which a volume may still be at hand
MB = 1 << 20
NO_END = 1 << 62  # bytes


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
    outfit: bake.Outfit = field(default_factory=bake.Outfit)
    carries: str = ""  # a digest of what the outfit takes from the mesh; "": nothing
    weights: probes.Weights | None = None
    measure: errors.Measure | None = None
    errors: errors.Errors | None = None
    structure: leapray.Structure | None = None
    stuck: str = ""  # why it is no finer, where it should be
    exact: str = "sheets"  # whose cells keep their triangles, see leapray.voxelize
    history: list[float] = field(default_factory=list)

    @property
    def fixed(self) -> bool:
        """Whether the object says how fine the volume is."""
        return self.mesh.modelling.resolution > 0

    def needs(self, pixel_error: float) -> tuple[float, float, float]:
        """How many times too coarse the surface is, its colours and edges; 1 is good enough."""
        e = self.errors
        return tuple(max(x, 1.0) for x in (e.of_surface(pixel_error), e.of_color(), e.of_edges()))


class Levels:
    """All volumes of a frame, each on one level, within one budget.

    cache: kept by the caller between frames; volumes by mesh and level, and what
    was measured on them. watch: stops the calls into the core.
    """

    def __init__(
        self, scene: model.Scene, cache: caches.Cache, watch: leapray.Watch, threads: int
    ) -> None:
        self.scene, self.settings = scene, scene.settings
        self.cache, self.watch, self.threads = cache, watch, threads
        self.shelf = shelves.Shelf(self.settings.cache_folder)
        self.wardrobe = bake.Wardrobe(scene, cache, watch)
        self.budget = self.settings.memory_mb * MB
        self.seconds = {"voxelize": 0.0, "structure": 0.0, "plan": 0.0}
        self.warnings: list[str] = []
        self.works: list[Work] = []
        self.peak = 0

    def breathe(self) -> None:
        if self.watch.stopped:
            raise leapray.Stopped("The planning was stopped.")

    def _key(self, work: Work, what: str, voxel_size: float, exact: str = "") -> tuple:
        s = self.settings
        made = what, work.digest, voxel_size, work.with_ids, work.carries, s.sample_type
        made = *made, self._filter(work.mesh), s.half_width, exact or work.exact
        made = *made, work.mesh.modelling.kind
        return made if what == "volume" else (*made, s.traverser)

    def _filter(self, mesh: model.Mesh) -> str:
        return mesh.modelling.filter or self.settings.filter

    def held(self) -> int:
        """Bytes of all volumes and structures that are alive, as far as the plan has come."""
        return sum(w.measure.nbytes for w in self.works if w.measure)

    def structure(
        self, work: Work, voxel_size: float, room: float, volume_room: float = math.inf
    ) -> leapray.Structure:
        """The structure of a level, which holds its volume.

        room: bytes for both, volume_room: for the volume alone; OutOfMemory where
        they do not suffice. The structure's share is foreseen from the level before.
        """
        key = self._key(work, "structure", voxel_size)
        structure = self.cache.get(key)
        if structure is not None:
            self.cache.get(self._key(work, "volume", voxel_size))
            return structure
        measure, share = work.measure, 1.0
        if measure is not None:
            share = measure.volume_nbytes / measure.nbytes
            foreseen = measure.nbytes * (measure.voxel_size / voxel_size) ** 2
            self.cache.trim(int(self.budget - self.held() - foreseen))
        began = time.perf_counter()
        volume = self._volume(work, voxel_size, max(1, int(min(room * share, volume_room, NO_END))))
        middle = time.perf_counter()
        structure = leapray.build(
            volume, self.settings.traverser or None, threads=self.threads, watch=self.watch
        )
        self.seconds["voxelize"] += middle - began
        self.seconds["structure"] += time.perf_counter() - middle
        nbytes = volume.info.nbytes + structure.nbytes
        self.cache.trim(self.budget - self.held() - nbytes)
        self.peak = max(self.peak, self.held() + nbytes + self.cache.unused())
        if nbytes > room:
            raise leapray.OutOfMemory(
                f"the level needs {nbytes / MB:.0f} MB, {max(room, 0) / MB:.0f} MB are left"
            )
        self.cache.put(self._key(work, "volume", voxel_size), volume, volume.info.nbytes)
        return self.cache.put(key, structure, structure.nbytes)

    def _volume(self, work: Work, voxel_size: float, max_nbytes: int) -> leapray.Volume:
        """The volume of a level: from the cache, from the folder, or made of the mesh."""
        key = self._key(work, "volume", voxel_size)
        volume = self.cache.get(key) or self.shelf.volume(key, max_nbytes, self.watch)
        if volume is not None:
            if volume.info.nbytes <= max_nbytes:
                return volume
            error = leapray.OutOfMemory("the level's volume is larger than its room")
            error.nbytes = volume.info.nbytes
            raise error
        kernel = self._filter(work.mesh)
        try:
            return self._voxelize(work, voxel_size, max_nbytes, kernel)
        except (leapray.Stopped, leapray.OutOfMemory):
            raise
        except leapray.LeapRayError:
            if kernel not in SOLID_FILTERS:
                raise
        volume = self._voxelize(work, voxel_size, max_nbytes, "ramp")
        why = f"{work.name!r} has no inside for the filter {kernel}: ramp instead."
        if why not in self.warnings:
            self.warnings.append(why)
        return volume

    def _voxelize(
        self, work: Work, voxel_size: float, max_nbytes: int, kernel: str
    ) -> leapray.Volume:
        """Of solids that share the volume each is made by itself; then they are merged."""
        parts, left = [], max_nbytes
        for mesh in solids(work.mesh):
            if work.mesh.solids is None:
                return self._voxelize_one(work, mesh, voxel_size, left, kernel)
            part = self._solid(work, mesh, voxel_size, left, kernel)
            parts.append(part)
            left -= part.info.nbytes
            if left <= 0:
                error = leapray.OutOfMemory("the solids take more than their room")
                error.nbytes = max_nbytes - left
                raise error
        merged = leapray.merge(parts, watch=self.watch)
        merged.mesh_info = parts[0].mesh_info
        nbytes = merged.info.nbytes  # the parts are in the cache
        self.peak = max(self.peak, self.held() + nbytes + self.cache.unused())
        return merged

    def _solid(
        self, work: Work, mesh: model.Mesh, voxel_size: float, max_nbytes: int, kernel: str
    ) -> leapray.Volume:
        """One that shares the volume, kept for the next time as long as nothing else needs room."""
        digests = objects.digest(mesh), bake.digest(mesh, work.outfit)
        s, own = self.settings, mesh.modelling
        key = "solid", *digests, voxel_size, work.with_ids, s.sample_type, kernel, s.half_width
        part = self.cache.get((*key, own.kind))
        if part is None or part.info.nbytes > max_nbytes:
            part = self._voxelize_one(work, mesh, voxel_size, max_nbytes, kernel)
        return self.cache.put((*key, own.kind), part, part.info.nbytes, spare=True)

    def _voxelize_one(
        self, work: Work, mesh: model.Mesh, voxel_size: float, max_nbytes: int, kernel: str
    ) -> leapray.Volume:
        own = kernel == self.settings.filter
        return leapray.voxelize(
            mesh.vertices,
            mesh.triangles,
            voxel_size,
            kind=mesh.modelling.kind,
            filter=kernel,
            half_width=self.settings.half_width or None if own else None,
            ids=mesh.slots if work.with_ids else None,
            attributes=self._attributes(work, mesh, voxel_size),
            dtype=self.settings.sample_type,
            exact=work.exact if work.mesh.solids is None else "none",
            threads=self.threads,
            watch=self.watch,
            max_nbytes=max(max_nbytes, 1),
        )

    def _attributes(
        self, work: Work, mesh: model.Mesh, voxel_size: float
    ) -> leapray.Attributes | None:
        key = "facets", work.digest, work.carries
        widest = self.cache.get(key) if mesh is work.mesh else None
        if widest is None:
            creased = len(self._probes(work).creases) > 0
            widest = bake.facet_voxel(mesh, creased)
            if mesh is work.mesh:
                self.cache.put(key, widest)
        return self.wardrobe.attributes(mesh, work.outfit, voxel_size < widest)

    def _rise(self, mesh: model.Mesh, volume: leapray.Volume) -> float:
        """Of occupancy per voxel across a plane."""
        s, kernel = self.settings, self._filter(mesh)
        if volume.info.kind == "sheet" and kernel in SOLID_FILTERS:
            kernel = "ramp"
        width = s.half_width if kernel == s.filter else 0.0
        return slope(kernel, width or own_half_width(kernel, s.sample_type))

    def drop(self, work: Work) -> None:
        """Forget the volume of a level that is left; what was measured on it stays."""
        if work.measure is not None:
            for what in ("structure", "volume"):
                self.cache.drop(self._key(work, what, work.measure.voxel_size, work.measure.exact))
        work.structure = None

    def _probes(self, work: Work) -> probes.Probes:
        key = "probes", work.digest
        drawn = self.cache.get(key)
        return drawn or self.cache.put(key, probes.draw(work.mesh, self.breathe))

    def enter(
        self, work: Work, voxel_size: float, room: float, volume_room: float = math.inf
    ) -> None:
        """Put the mesh on a level; OutOfMemory, and nothing changed, where it does not fit."""
        key = self._key(work, "measure", voxel_size)
        measure, structure = self.cache.get(key) or self._measured_before(work, key), None
        if measure is None:
            structure = self.structure(work, voxel_size, room, volume_room)
            measure = errors.measure(
                structure,
                self._probes(work),
                voxel_size,
                self._color_errors(work, structure),
                self._rise(work.mesh, structure.volume),
                work.exact,
                work.mesh.slots,
            )
            self.cache.put(key, measure)
            self.shelf.keep_record(key, measure)
        elif measure.nbytes > room or measure.volume_nbytes > volume_room:
            raise leapray.OutOfMemory(
                f"the level needs {measure.nbytes / MB:.0f} MB, {max(room, 0) / MB:.0f} MB are left"
            )
        self.drop(work)
        work.measure, work.structure, work.stuck = measure, structure, ""
        if work.weights is None:
            work.weights = probes.weigh(self._probes(work), self.scene, work.matrices, work.shown)
        work.errors = errors.seen(measure, work.weights)
        work.history.append(work.errors.progress(self.settings.pixel_error))

    def _measured_before(self, work: Work, key: tuple) -> errors.Measure | None:
        """What is known from the folder."""
        measure = self.shelf.record(key, errors.Measure)
        if measure is None or not measure.fits(self._probes(work)):
            return None
        return self.cache.put(key, measure)

    def _color_errors(self, work: Work, structure: leapray.Structure):
        volume, at = structure.volume, self._probes(work)
        if not volume.info.has_colors:
            return None
        size = volume.info.object_from_index[0, 0]
        attributes = self._attributes(work, work.mesh, size)
        where = at.surface, at.surface_triangles, at.surface_weights
        return bake.color_errors(volume, work.mesh, attributes, *where, size)

    def share_finest(self) -> None:
        """Volumes of equal contents become one, on the finest level that one of them is on.

        So the levels are the same whatever lies in cache and folder.
        """
        finest: dict[tuple, Work] = {}
        sharing = [work for work in self.works if not (work.fixed or self.settings.resolution)]
        for work in sorted(sharing, key=lambda w: w.measure.voxel_size):
            best = finest.setdefault(self._key(work, "volume", 0.0), work)
            if best.measure.voxel_size < work.measure.voxel_size:
                self.drop(work)
                work.measure, work.structure = best.measure, best.structure
                work.errors = errors.seen(best.measure, work.weights)

    def take_finer(self, work: Work) -> bool:
        """Take an earlier frame's volume that is finer than asked for, where there is room."""
        room = self.budget - self.held() + work.measure.nbytes
        size = work.measure.voxel_size
        for finer in (size, *(size / 2**n for n in range(1, FINER))):
            measure = self.cache.peek(self._key(work, "measure", finer))
            structure = self.cache.peek(self._key(work, "structure", finer))
            if measure is not None and structure is not None and measure.nbytes <= room:
                for what in ("measure", "structure", "volume"):
                    self.cache.get(self._key(work, what, finer))  # is used
                work.measure, work.structure = measure, structure
                work.errors = errors.seen(measure, work.weights)
                return True
        return False

    def keep_on_disk(self) -> None:
        """Put the volumes into the folder, where there is one."""
        for work in self.works:
            key = self._key(work, "volume", work.measure.voxel_size)
            self.shelf.keep_volume(key, work.structure.volume, self.watch)
        if self.shelf.trouble:
            self.warnings.append(self.shelf.trouble)
