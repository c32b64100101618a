# SPDX-License-Identifier: GPL-3.0-or-later
"""What to model and how finely: the least that keeps the error under a share of a pixel (no bpy).

Every distinct mesh becomes one volume in its own space, which its instances
share. Voxel sizes are powers of two and lattices lie on multiples of them, so
that nothing swims when a level changes. Every volume starts coarse; its error
is measured at the probes of its mesh and divided by their pixels' footprints.
The volume whose error is worst, as seen, is voxelized again with half the
voxel, until all are good enough or the memory is spent: so the budget goes
where it can be seen, a curved thing close by is fine, and a flat floor of any
size stays a handful of bricks. Meshes whose triangles are few, or no more than
fine voxels would be, keep all of them, which rays meet by a tree.

Source: Frisken et al. 2000, Adaptively sampled distance fields (refine by the
measured error of the field). Departures: 1. one level per volume, not per cell,
hence no cracks; 2. the error is measured on the surface, in pixels.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import Any

import numpy as np

import leapray
from leapray.voxelization import SPARE, mesh_scratch_nbytes

from .. import model
from ..store import disk_cache, memory_cache
from . import (
    culling,
    doubts,
    fastest,
    fields,
    light_planes,
    mesh_colors,
    mesh_split,
    objects,
    sample_types,
)
from .ahead import Ahead, Entries
from .levels import MB, Work
from .objects import SceneError
from .planned import Plan
from .refinement import Refinement
from .separation import PER_CELL

COARSEST = 16  # voxels along the longest side at the start, but for meshes with more than
FEW_TRIANGLES = 1024  # of a mesh: it is kept as it is,
MANY_TRIANGLES = 16384  # up to so many as well, where they are larger than pixels
MOST_CROWD = 64  # triangles in a cell, about: to sort them takes longer than finer voxels,
FINEST_START = 512  # of which they get so many at most
AHEAD_SHARE = 1 / 16  # of the memory, for the scratch of a mesh that is looked at ahead
FIELDS_SHARE = 0.2  # of the progress, where there are meshes, too
PADDING = 4  # samples that voxelize adds on every side for the ramp and for gradients


# ---- one volume ----------------------------------------------------------------


def coarsest(mesh: model.Mesh) -> float:
    """The largest power of two that puts at least COARSEST / 2 voxels along the longest side."""
    longest = np.ptp(mesh.bounds, axis=0).max()
    return 2.0 ** math.ceil(math.log2(longest / COARSEST)) if longest > 0 else 1.0


class Planner(Refinement):
    """Walks the levels of all volumes within one budget.

    advance: called with a share 0..1 of this work as it proceeds.
    """

    def __init__(
        self,
        scene: model.Scene,
        cache: memory_cache.Cache,
        watch: leapray.Watch,
        threads: int,
        advance: Callable[[float], None] = lambda share: None,
    ) -> None:
        super().__init__(scene, cache, watch, threads, advance)
        self._colored: dict[tuple, tuple[int, mesh_colors.ColorSet]] = {}

    # -- the walk

    def start(self, instances: list[model.Instance]) -> None:
        """Put every mesh on its coarsest level, or on the one that the settings ask for."""
        by_mesh: dict[tuple[int, mesh_colors.ColorSet], list[model.Instance]] = {}
        for instance in instances:
            by_mesh.setdefault(self._mesh_and_colors(instance), []).append(instance)
        with Ahead(self.cache) as ahead:
            self._prepare(ahead, [*dict.fromkeys(index for index, _ in by_mesh)][1:])
            for done, ((index, color_set), users) in enumerate(by_mesh.items()):
                self.check_cancelled()
                ahead.take(index)
                self._start_mesh(index, color_set, users)
                self.advance(0.3 * (done + 1) / len(by_mesh))
        self.warnings += self.color_sets.warnings

    def _prepare(self, ahead: Ahead, indices: Iterable[int]) -> None:
        """Let small meshes be split and their probes be drawn while those before are voxelized."""
        made: set[tuple] = set()
        room = AHEAD_SHARE * (self.budget - self.held())
        for index in indices if self.threads != 1 else ():
            mesh = self.scene.meshes[index]
            if mesh_scratch_nbytes(len(mesh.vertices), len(mesh.triangles)) <= room:
                ahead.begin(index, partial(self._prepared, mesh, made))

    def _start_mesh(
        self, index: int, color_set: mesh_colors.ColorSet, users: list[model.Instance]
    ) -> None:
        """Put the parts of a mesh there, which its users share."""
        matrices = np.array([u.world_from_object for u in users], np.float64)
        shown = np.array([u.visible_camera for u in users])
        several = any(len(u.materials) > 1 for u in users)
        used = {m for user in users for m in user.materials}
        self._check_room(self.scene.meshes[index], users[0].name)
        try:
            split, torn, one_island = self._split(self.scene.meshes[index])
        except leapray.Stopped:
            raise
        except leapray.LeapRayError as error:
            self.warnings.append(f"{users[0].name!r} is skipped: {error}.")
            return
        if torn:
            self.warnings.append(
                f"{users[0].name!r} is closed, but taken for sheets, since faces disagree in "
                "winding or meet three at an edge; the object's settings can say otherwise."
            )
        for part, (name, mesh) in enumerate(split):
            ids = several and mesh.slots is not None
            work = Work(index, part, users[0].name, mesh, name, matrices, shown, ids, color_set)
            work.one_island = one_island
            work.carries = mesh_colors.digest(mesh, color_set)
            work.dtype = self._asked_type(mesh)
            work.turn = sample_types.permitted_turn(self.scene.materials[m] for m in used)
            work.refracts = any(self.scene.materials[m].refracts for m in used)
            work.fills = any(self.scene.materials[m].fills for m in used)
            work.exact = "sheets" if self.settings.exact == "auto" else self.settings.exact
            if self.may_choose_cells(work) and self._has_few_triangles(work):
                work.exact, work.own_normals = "every", True
            self._start_one(work)

    def _has_few_triangles(self, work: Work) -> bool:
        """Whether voxels that are fine enough would hardly be fewer, or all were kept before."""
        n = len(work.mesh.triangles)
        if n <= FEW_TRIANGLES or n <= min(MANY_TRIANGLES, self.pixels(work)):
            return True
        kept = self.perfect(work)
        return self._known(kept, self.first_size(kept)) is not None

    def _check_room(self, mesh: model.Mesh, name: str) -> None:
        """Refuse a mesh that cannot even be looked at within the budget, before it is."""
        needs = mesh_scratch_nbytes(len(mesh.vertices), len(mesh.triangles)) - SPARE
        if self.held() + needs > self.budget:
            raise self._too_large(name, self.held() + needs)

    def _too_large(self, name: str, needs: int) -> SceneError:
        return SceneError(
            f"With {name!r} at its coarsest level the scene needs {math.ceil(needs / MB)} MB, "
            f"budget is {self.settings.memory_mb} MB."
        )

    def _mesh_and_colors(self, instance: model.Instance) -> tuple[int, mesh_colors.ColorSet]:
        """What instances share a volume by: the mesh, and where its colours come from."""
        key = instance.mesh, instance.materials
        if key not in self._colored:
            mesh = self.scene.meshes[instance.mesh]
            self._colored[key] = instance.mesh, self.color_sets.color_set(mesh, instance.materials)
        return self._colored[key]

    def _split(self, mesh: model.Mesh) -> tuple[list[tuple[str, model.Mesh]], bool, bool]:
        """The parts of the mesh that get volumes of their own, and names of their contents.

        Then whether a closed mesh was taken apart into open ones that nobody asked for, and
        whether it is known to be one island.
        """
        if self._is_whole(mesh):
            return _named(mesh, []), False, False
        key = _parts_key(mesh)
        split, torn, one = self.cache.get(key) or self.cache.put(key, self._made_split(mesh))
        return _named(mesh, split), torn and mesh.modelling.kind == "auto", one

    def _is_whole(self, mesh: model.Mesh) -> bool:
        """Whether it gets one volume, whatever its parts."""
        return self.settings.layout == "scene" or mesh.modelling.kind == "solid"

    def _made_split(self, mesh: model.Mesh) -> tuple[list[model.Mesh], bool, bool]:
        """The parts, if they are several, whether that tears the mesh, whether it is one island."""
        if not mesh_split.islands(mesh, self.watch).any():
            return [], False, True
        split = mesh_split.split(mesh, self.watch)
        several = len(split) > 1
        torn = several and mesh_split.torn(mesh, split, self.watch)
        return split if several else [], torn, False

    def _prepared(self, mesh: model.Mesh, made: set[tuple]) -> Entries:
        """What the cache will be asked for first of the mesh, but for the keys that were made."""
        entries: Entries = []

        def ask(key: tuple, make: Callable[[], Any]) -> Any:
            known = self.cache.peek(key)
            if known is None and key not in made:
                known = make()
                entries.append((key, known))
                made.add(key)
            return known

        parts: list[model.Mesh] = []
        one_island = False
        if not self._is_whole(mesh):
            known = ask(_parts_key(mesh), partial(self._made_split, mesh))
            if known is None:  # another mesh has the same contents
                return entries
            parts, _, one_island = known
        for name, part in _named(mesh, parts):
            ask(self.probes_key(name), partial(self.draw, part, one_island))
        return entries

    def _asked_type(self, mesh: model.Mesh) -> str:
        """Of the samples; "": what the errors ask for, u16 where the resolution is fixed."""
        asked = mesh.modelling.sample_type or self.settings.sample_type
        fixed = mesh.modelling.resolution or self.settings.resolution
        return ("u16" if fixed else "") if asked == "auto" else asked

    def first_size(self, work: Work) -> float:
        """The voxel size to start with, in object space."""
        n = work.mesh.modelling.resolution or self.settings.resolution
        if n:
            return fixed_size(work.mesh, n)
        size = coarsest(work.mesh)
        n_triangles = len(work.mesh.triangles)
        all_kept = work.exact == "every" and n_triangles > FEW_TRIANGLES
        crowd = PER_CELL if all_kept else MOST_CROWD
        room = crowd * self._probes(work).area / n_triangles
        finest = size * COARSEST / FINEST_START
        while size**2 > room and size > finest:
            size /= 2
        return size

    def _start_one(self, work: Work) -> None:
        size = self.first_size(work)
        room = self.budget - self.held()
        try:
            try:
                self.enter(work, size, room)
            except leapray.OutOfMemory:
                if work.dtype:
                    raise
                work.dtype = "u8"
                self.enter(work, size, room)
        except leapray.OutOfMemory as error:
            needs = self.held() + (error.nbytes or 0)
            raise self._too_large(work.name, needs) from error
        except leapray.Stopped:
            raise
        except leapray.LeapRayError as error:
            who = f"A part of {work.name!r}" if work.part else repr(work.name)
            self.warnings.append(f"{who} is skipped: {error}.")
            return
        self.works.append(work)

    def finish(self, instances: list[model.Instance]) -> Plan:
        """Make what is still missing, and put the instances together."""
        self.share_finest()
        self.clear_rims()
        self.complete_triangles()
        self.separate()
        for work in self.works:
            self.complete(work)
        self.keep_on_disk()
        self.cache.end()
        self.peak = max(self.peak, self.held() + self.cache.unused())
        placed, names, slots = self._place(instances)
        surfaces = self._surfaces(instances)
        lights = light_planes.with_margins(self.scene.lights, surfaces, self.warnings)
        return Plan(
            instances=placed,
            names=names,
            slots=slots,
            lights=lights,
            slot_objects=None,
            slot_names=None,
            volumes=[self._row(w) for w in self.works],
            warnings=self.warnings
            + [s for w in self.works if (s := self._complaint(w))]
            + doubts.sentences(self.works),
            volume_nbytes=sum(w.measured.volume_nbytes for w in self.works),
            structure_nbytes=sum(w.measured.structure_nbytes for w in self.works),
            scratch_nbytes=self.scratch,
            peak_nbytes=self.peak,
            seconds=self.seconds,
        )

    def _surfaces(self, instances: list[model.Instance]) -> Iterator[light_planes.Surface]:
        """What stops light, and how exactly it is modelled."""
        works = self._works()
        for instance in instances:
            for work in (
                works.get(self._mesh_and_colors(instance), []) if instance.visible_shadow else ()
            ):
                off = work.measured.step + work.measured.typical
                matrix = np.asarray(instance.world_from_object, np.float64)
                scale = np.linalg.norm(matrix[:3, :3], 2)
                yield light_planes.Surface(instance.name, work.mesh, matrix, float(off * scale))

    def _works(self) -> dict[tuple[int, mesh_colors.ColorSet], list[Work]]:
        works: dict[tuple[int, mesh_colors.ColorSet], list[Work]] = {}
        for work in self.works:
            works.setdefault((work.index, work.color_set), []).append(work)
        return works

    def _place(
        self, instances: list[model.Instance]
    ) -> tuple[list[leapray.Instance], list[str], list[int]]:
        """The instances of all volumes, the names of their objects, and their materials' slots."""
        works = self._works()
        index = {id(work): n for n, work in enumerate(self.works, 1)}
        first: dict[tuple[int, ...], int] = {}
        slots: list[int] = []
        placed: list[leapray.Instance] = []
        names: list[str] = []
        scales = objects.scales([instance.world_from_object for instance in instances])
        for instance, scale in zip(instances, scales, strict=True):
            if instance.materials not in first:
                first[instance.materials] = len(slots)
                slots.extend(instance.materials)
            placed += [
                leapray.Instance(
                    work.built,
                    **objects.told_of(instance),
                    first_material=first[instance.materials],
                    n_materials=len(instance.materials),
                    volume_index=index[id(work)],
                    error=work.measured.typical * scale,
                )
                for work in works.get(self._mesh_and_colors(instance), [])
            ]
            names += [instance.name] * (len(placed) - len(names))
        return placed, names, slots

    # -- what is said about it

    def _row(self, work: Work) -> dict[str, object]:
        m, e = work.measured, work.errors
        return {
            "name": work.name,
            "mesh": work.mesh.name,
            "part": work.part,
            "kind": m.kind,
            "why": m.why,
            "size": list(m.shape),
            "voxel_size": m.voxel_size,
            "sample_type": m.dtype,
            "error_footprints": round(e.surface, 4),
            "lost": round(e.lost, 4),
            "voxel_footprints": round(e.voxel, 4),
            "exact_share": round(m.exact_share, 4),
            "crease_footprints": round(e.crease, 4),
            "crease_voxel_footprints": round(e.blur, 4),
            "normal_error": round(math.degrees(e.normal), 2),
            "color_error": round(e.color, 4),
            "carries": [
                w for w, has in (("colors", m.color is not None), ("normals", m.normals)) if has
            ],
            "nbytes": m.nbytes,
            "volume_nbytes": m.volume_nbytes,
            "structure_nbytes": m.structure_nbytes,
            "instances": len(work.matrices),
            "objects": max(work.built.volume.info.n_objects, 1),
            "samples_shared": work.built.volume.info.n_shared,
            "samples_dropped": work.built.volume.info.n_dropped,
            "stuck": work.stuck,
        }

    def _complaint(self, work: Work) -> str:
        """The sentence on a volume that is coarser than it was asked to be, or ""."""
        what = work.errors.sentence(self.settings.pixel_error)
        if self.settings.resolution or work.fixed or not what:
            return ""
        return f"{work.name!r} has {what}: {work.stuck}."


def _parts_key(mesh: model.Mesh) -> tuple:
    return "parts", mesh.contents, mesh_colors.corners_digest(mesh)


def _named(mesh: model.Mesh, parts: list[model.Mesh]) -> list[tuple[str, model.Mesh]]:
    """The parts, or the mesh where there are none, and names of their contents."""
    return [(f"{mesh.contents}/{k}", part) for k, part in enumerate(parts)] or [
        (mesh.contents, mesh)
    ]


def fixed_size(mesh: model.Mesh, n: int) -> float:
    """The voxel size at which the mesh's volume has n samples, or a few less, on its longest side.

    The ramp's own samples count; where n leaves hardly any for the mesh, it gets one voxel or two.
    """
    lo, hi = mesh.bounds
    size = (hi - lo).max() / max(n - 1 - 2 * PADDING, 1)
    largest = 2.0 * size
    while size < largest:
        samples = np.ceil(hi / size) - np.floor(lo / size) + 1 + 2 * PADDING
        if samples.max() <= n:
            break
        size *= 1.0 + 0.5 / n
    return float(size)


def make(
    scene: model.Scene,
    cache: memory_cache.Cache,
    watch: leapray.Watch,
    threads: int,
    advance: Callable[[float], None] = lambda share: None,
    planner: type[Planner] = Planner,
) -> Plan:
    """Choose, voxelize and build everything that the scene needs, as the planner sees it.

    Raises SceneError where nothing can be rendered within the settings, Stopped
    where watch says so. Uses and refills cache, which together with
    the frame's own volumes stays within the memory budget.
    """
    began = time.perf_counter()
    cache.begin()
    warnings: list[str] = []
    placed = objects.usable(scene, warnings)
    met = culling.reached(scene, placed)
    placed = [i for i, is_met in zip(placed, met.tolist(), strict=True) if is_met]
    instances = [i for i in placed if isinstance(i, model.Instance)]
    of_fields = [i for i in placed if isinstance(i, model.FieldInstance)]
    room = scene.settings.memory_mb * MB * (1 - fields.MESH_SHARE * bool(instances))
    share = FIELDS_SHARE if instances else 1.0
    surfaces = fields.Fields(
        scene, of_fields, cache, watch, threads, room, lambda done: advance(share * done)
    )
    owners: list[model.Instance] | None = None
    if scene.settings.layout == "scene" and instances:
        kinds = _kinds(scene, instances, cache, watch, warnings)
        instances = [i for i, kind in zip(instances, kinds, strict=True) if kind]
        if not instances and not surfaces.surfaces:
            raise objects.nothing_left(warnings)
        scene, owners = objects.merge(scene, instances, warnings, [k for k in kinds if k])
        instances = list(scene.instances)
    chosen = planner(scene, cache, watch, threads, advance)
    chosen.warnings += warnings
    chosen.taken = surfaces.nbytes + surfaces.read_nbytes
    chosen.start(instances)
    if placed and not chosen.works and not surfaces.surfaces:
        raise objects.nothing_left(chosen.warnings + surfaces.warnings)
    chosen.improve()
    plan = chosen.finish(instances)
    if owners is not None:
        plan.slot_objects = [owner.object_index for owner in owners]
        plan.slot_names = [owner.name for owner in owners]
    surfaces.join(plan)
    fastest.choose(plan, scene, threads, watch)
    spent = time.perf_counter() - began
    plan.seconds["plan"] = spent - plan.seconds["voxelize"] - plan.seconds["structure"]
    return plan


def _kinds(
    scene: model.Scene,
    instances: list[model.Instance],
    cache: memory_cache.Cache,
    watch: leapray.Watch,
    warnings: list[str],
) -> list[objects.Kind | None]:
    """What each instance is, as its mesh's coarsest volume tells; None, and a warning: nothing."""
    known: dict[int, objects.Kind | None] = {}
    on_disk = disk_cache.DiskCache(scene.settings.cache_folder)
    for instance in instances:
        if instance.mesh in known:
            continue
        mesh = scene.meshes[instance.mesh]
        key = "kind", mesh.contents, mesh.modelling.kind
        kind = cache.get(key) or on_disk.record(key, objects.Kind)
        try:
            if kind is None:
                made = leapray.voxelize(
                    mesh.vertices,
                    mesh.triangles,
                    coarsest(mesh),
                    kind=mesh.modelling.kind,
                    exact="none",
                    watch=watch,
                )
                kind = objects.Kind(made.info.kind, made.mesh_info.inverted)
                on_disk.keep_record(key, kind)
            cache.put(key, kind)
        except leapray.Stopped:
            raise
        except leapray.LeapRayError as error:
            warnings.append(f"{instance.name!r} is skipped: {error}.")
        known[instance.mesh] = kind
    return [known[instance.mesh] for instance in instances]
