# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures by the core's whole-image methods: first cells of surfaces, without light paths (no
bpy).

The scene is planned as for rays, and then with voxels of about a pixel. The camera is mapped into
each object's space, where the method renders strips of the film; of what the instances show in a
pixel the nearest counts. Cells are shaded by their depth between the nearest and the farthest
corner of all surfaces' boxes, or, where the method has lights, by the scene's suns and points; both
times with the material's base colour.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import leapray
from leapray._abi import LR_OWN_INDEX
from leapray.arrays import ONES

from . import film, model
from .methods import Method
from .plan import culling, plan
from .plan.levels import MB
from .plan.planned import Plan
from .store.memory_cache import Cache
from .tiles import Tile, strips

PASSES = "Combined", "Depth", "Position", "Object Index", "Material Index", "Volume"
MOST_LIGHTS = 32  # bits of a voxel
CELL = 1.5  # pixels that the cells of a mesh shall have at most, on the average,
COARSE = 3.0  # from which on that is told,
CELLS_SHARE = 1 / 4  # of the memory budget for them: what is prepared needs some, too
EVEN = 1e-4  # differences of scale that shading may not notice
CORNERS = np.array([[b & 1, b >> 1 & 1, b >> 2] for b in range(8)])

Job = Callable[[Callable], None]
Run = Callable[[list[Job]], Iterator]  # all jobs, side by side: yields what they put


def check(scene: model.Scene, method: Method) -> None:
    """Refuse, in a sentence, a camera that the method does not take."""
    assert method.image is not None
    if scene.camera.projection == "perspective" and not method.image.perspective:
        raise leapray.LeapRayError(
            f"The render method {method.spec} counts on parallel rays: the camera must be "
            "orthographic"
        )


class CellPlanner(plan.Planner):
    """Plans volumes whose cells themselves are seen: of flat surfaces, too, they shall be small."""

    def sharpen(self) -> None:
        """Halve the voxels of the volume with the largest cells, as seen, while there is room."""
        super().sharpen()
        room = self.budget * CELLS_SHARE
        open_works = [work for work in self.works if not work.fixed]
        while open_works:
            self.check_cancelled()
            work = max(open_works, key=lambda each: each.errors.voxel)
            if work.errors.voxel <= CELL:
                return
            left = room - self.held() + work.measured.nbytes
            wanted = range(math.ceil(math.log2(work.errors.voxel / CELL)), 0, -1)
            if left <= 0 or all(self.refused(work, levels, left) for levels in wanted):
                open_works.remove(work)


def coarse_cells(planned: Plan) -> list[str]:
    """The sentence on meshes whose cells are larger than pixels."""
    sizes = {
        str(row["name"]): float(row["voxel_footprints"])  # type: ignore[arg-type]
        for row in planned.volumes
        if float(row.get("voxel_footprints") or 0.0) > COARSE  # type: ignore[arg-type]
    }
    if not sizes:
        return []
    return [
        f"First cells of {film.names(sizes)} are seen as large as {max(sizes.values()):.3g} pixels "
        "on the average; a higher resolution or more memory makes them smaller."
    ]


@dataclass
class Shown:
    """An instance that the camera may see."""

    instance: leapray.Instance
    name: str
    prepared: leapray.Prepared
    camera: leapray.Camera  # in its space
    key: tuple  # of what is kept of the frame
    before: leapray.Image | None = None
    kept: NDArray[np.float64] | None = None  # of this frame, for the next one
    last: leapray.Image | None = None  # of this frame, of any strip

    @property
    def volume(self) -> leapray.Volume:
        return self.prepared.volume


class ImagePainter:
    """The picture of a plan by one of the core's methods.

    cache: the caller's, between frames: what was prepared, and what methods with `frames` keep of
    the frame before. run: runs jobs on threads. Raises LeapRayError where what is prepared does
    not fit into the memory budget, Stopped.
    """

    def __init__(
        self,
        scene: model.Scene,
        method: Method,
        planned: Plan,
        cache: Cache,
        run: Run,
        watch: leapray.Watch,
        threads: int,
    ) -> None:
        assert method.image is not None
        self.scene, self.entry, self.planned, self.watch = scene, method.image, planned, watch
        self.cache = cache
        self.tiles = strips(scene.width, scene.height, scene.settings.tile_size, 4 * threads)
        made = (*PASSES, "Normal") if self.entry.lights else PASSES
        self.made = [name for name in made if name in scene.passes or name == "Combined"]
        self.warnings = film.general_warnings(scene, method.spec, made)
        self.counted: list[dict[str, int]] = []
        self.skipped: list[int] = []  # rays, in each tile, of each instance
        self.lights = self._usable_lights() if self.entry.lights else ()
        self.shown = self._prepare(run)
        self.corners = np.array([film.world_corners(s.instance) for s in self.shown])
        self.corners = self.corners.reshape(len(self.shown), 8, 3)
        self.near, self.far = film.depths(scene.camera, self.corners.reshape(-1, 3))
        self._keep_frames()
        self.warnings += [*coarse_cells(planned), *self._not_shown()]

    @property
    def nbytes(self) -> int:
        """Of what was prepared and is kept."""
        return self.taken

    # ---- before the picture

    def _prepare(self, run: Run) -> list[Shown]:
        """What the method needs of each volume, and of each instance where that sees lights."""
        wanted: dict[tuple, tuple[leapray.Instance, str]] = {}
        keys: list[tuple | None] = []
        for instance, name in zip(self.planned.instances, self.planned.names, strict=True):
            key = self._key(instance)
            seen = instance.visible_camera and not self._is_cut(instance)
            seen = seen and not self._is_bare(instance)
            keys.append(key if seen else None)
            if seen:
                wanted.setdefault(key, (instance, name))
        found = {key: made for key in wanted if (made := self.cache.get(key)) is not None}
        jobs = [self._job(key, *wanted[key]) for key in wanted if key not in found]
        taken = self.planned.volume_nbytes + self.planned.structure_nbytes
        self._check_room(taken + sum(each.nbytes for each in found.values()))
        for key, made, why in run(jobs) if jobs else ():
            if made is None:
                self.warnings.append(f"{wanted[key][1]!r} is left out: {why}.")
                continue
            found[key] = self.cache.put(key, made, made.nbytes)
            self._check_room(taken + sum(each.nbytes for each in found.values()))
        self.taken = sum(each.nbytes for each in found.values())
        shown: list[Shown] = []
        named: dict[tuple, int] = {}  # how many of a name show the same
        for n, one in enumerate(keys):
            if one is None or one not in found:
                continue
            instance, name = self.planned.instances[n], self.planned.names[n]
            place = named[one, name] = named.get((one, name), -1) + 1
            camera = film.camera_in(self.scene.camera, instance.world_from_object)
            own = "image frame", one[1], self.entry.spec, name, place
            shown.append(Shown(instance, name, found[one], camera, own))
        return shown

    def _is_cut(self, instance: leapray.Instance) -> bool:
        """Whether it is the faces of a cut, which the method does not make."""
        row = self.planned.volumes[instance.volume_index - 1 : instance.volume_index]
        return any(each["kind"] == "clip" for each in row)

    def _key(self, instance: leapray.Instance) -> tuple:
        """Of what is prepared, which keeps its volume alive, so that no other has its id."""
        key = "image", str(id(instance.structure.volume)), self.entry.spec
        if not self.entry.lights:
            return key
        matrix = np.asarray(instance.world_from_object, np.float64)
        told = [model.numbers(light).tobytes() for light in self.lights]
        return *key, matrix.tobytes(), b"".join(told)

    def _job(self, key: tuple, instance: leapray.Instance, name: str) -> Job:
        def job(put: Callable) -> None:
            try:
                made = leapray.prepare(instance.structure.volume, self.entry, watch=self.watch)
            except (leapray.Stopped, leapray.OutOfMemory):
                raise
            except leapray.LeapRayError as error:  # such as cubic volumes
                put((key, None, str(error)))
                return
            for number, light in enumerate(self.lights):
                own = _light_in(light, np.asarray(instance.world_from_object, np.float64))
                made.set_light(number, own, watch=self.watch)
            put((key, made, ""))

        return job

    def _check_room(self, nbytes: int) -> None:
        budget = self.scene.settings.memory_mb
        if nbytes > budget * MB:
            raise leapray.OutOfMemory(
                f"With what the render method {self.entry.spec} prepares the scene needs "
                f"{nbytes / MB:.0f} MB, and its budget is {budget} MB"
            )

    def _keep_frames(self) -> None:
        """Find the frame before of each instance, and room for this one."""
        if not self.entry.frames:
            return
        each_nbytes = self.scene.width * self.scene.height * 16
        room = self.scene.settings.memory_mb * MB - self.taken
        room -= self.planned.volume_nbytes + self.planned.structure_nbytes
        for shown in self.shown:
            before = self.cache.get(shown.key)
            if before is not None and before.volume is shown.volume:
                shown.before = before
            room -= 2 * each_nbytes
            if room < 0:  # the next frame begins anew
                return
            shown.kept = np.zeros((self.scene.height, self.scene.width, 2))
            self.taken += each_nbytes

    def _usable_lights(self) -> tuple[model.Light, ...]:
        """Suns and points; the others, and what of these is not shown, get a warning."""
        spec, lights = self.entry.spec, self.scene.lights
        usable = [light for light in lights if light.kind in ("sun", "point")]
        others = [light.name for light in lights if light.kind not in ("sun", "point")]
        others += [light.name for light in usable[MOST_LIGHTS:]]
        usable = usable[:MOST_LIGHTS]
        if others:
            self.warnings.append(
                f"The render method {spec} has light of up to {MOST_LIGHTS} suns and points, and "
                f"none of {film.names(others)}."
            )
        soft = [light.name for light in usable if light.radius > 0 or light.angle > 0]
        if soft:
            self.warnings.append(
                f"The render method {spec} gives hard shadows to {film.names(soft)}."
            )
        if any(self.scene.world.color):
            self.warnings.append(f"The render method {spec} has no light of the world.")
        return tuple(usable)

    def _not_shown(self) -> list[str]:
        """What materials and objects ask for and the method does not show."""
        spec, told = self.entry.spec, []
        used = {m for shown in self.shown for m in self._materials(shown.instance)}
        materials = [self.scene.materials[m] for m in sorted(used)]
        odd = [material.name for material in materials if not _is_plain(material)]
        if odd:
            told.append(
                f"The render method {spec} shows base colors alone, without what {film.names(odd)} "
                "mirrors, lets through or emits."
            )
        placed = zip(self.planned.instances, self.planned.names, strict=True)
        filled = list(dict.fromkeys(name for each, name in placed if self._is_bare(each)))
        if filled:
            told.append(f"The render method {spec} does not show what fills {film.names(filled)}.")
        cut = [shown.name for shown in self.shown if shown.instance.clips]
        if cut:
            told.append(f"The render method {spec} does not cut {film.names(cut)}.")
        colored = [shown.name for shown in self.shown if _is_colored(shown.instance)]
        if colored:
            told.append(
                f"The render method {spec} does not show the colors that {film.names(colored)} "
                "takes from its data."
            )
        world = self.scene.world
        if world.image is not None and world.visible_camera and not self.scene.film_transparent:
            told.append(f"The render method {spec} does not show the world's image.")
        if not self.entry.lights:
            return told
        if len(self.shown) > 1:
            told.append(
                f"By the render method {spec} objects cast no shadows on each other; in layout "
                "'scene' solids do."
            )
        uneven = [s.name for s in self.shown if not _is_even(s.instance.world_from_object)]
        if uneven:
            told.append(
                f"The render method {spec} shades {film.names(uneven)} as without its scale, which "
                "is not the same along all axes."
            )
        return told

    def _is_bare(self, instance: leapray.Instance) -> bool:
        """Whether it has no surface, but what fills it alone."""
        return all(self.scene.materials[m].bare for m in self._materials(instance))

    def _materials(self, instance: leapray.Instance) -> list[int]:
        first = instance.first_material
        return self.planned.slots[first : first + instance.n_materials]

    # ---- the picture

    def worker(self) -> Callable[[Tile], film.Passes]:
        return self._paint

    def _paint(self, tile: Tile) -> film.Passes:
        size = self.scene.width, self.scene.height
        shape = tile.height, tile.width
        t, owner = np.full(shape, np.inf), np.full(shape, -1)
        cell = np.zeros((*shape, 3), np.int32)
        shade, normal = np.zeros((*shape, 3)), np.zeros((*shape, 3))
        met = culling.in_view(film.part_of(self.scene, tile), self.corners)
        for n, shown in enumerate(self.shown):
            if not met[n] and shown.kept is None:
                continue
            image = leapray.render_image(
                self.entry,
                shown.prepared,
                shown.camera,
                *size,
                window=tile,
                before=shown.before,
                keep=False if shown.kept is None else shown.kept,
                watch=self.watch,
            )
            self.counted.append(image.counters)
            self.skipped.append(int(image.skipped.sum()))
            shown.last = image if shown.kept is not None else None
            nearer = image.hit & (image.t < t)
            for target, values in ((t, image.t), (cell, image.cell), (shade, image.shade)):
                target[nearer] = values[nearer]
            if image.normal is not None:
                turned = image.normal[nearer] @ np.linalg.inv(_linear(shown.instance))
                normal[nearer] = turned
            owner[nearer] = n
        return self._passes(tile, t, owner, cell, shade, normal)

    def _passes(self, tile: Tile, t, owner, cell, shade, normal) -> film.Passes:
        """Of the tile's nearest cells."""
        seen = owner >= 0
        if not self.entry.lights:
            length = self.far - self.near
            depth = (t - self.near) / length if length > 0 else np.zeros_like(t)
            shade = np.where(seen, np.clip(1.0 - depth, 0.0, 1.0), 0.0)[..., None]
        color = np.zeros((*t.shape, 3))
        index = {name: np.zeros(t.shape) for name in ("Object Index", "Material Index", "Volume")}
        holdout = np.zeros(t.shape, bool)
        for n in np.unique(owner[seen]):
            instance, where = self.shown[n].instance, owner == n
            slots = self._slots(self.shown[n], cell[where])
            materials = np.array(self.planned.slots)[slots]
            color[where] = self._colors(self.shown[n], cell[where], materials)
            index["Object Index"][where] = self._object_index(instance, slots)
            own = np.array([material.index for material in self.scene.materials])
            index["Material Index"][where] = own[materials]
            index["Volume"][where] = instance.volume_index
            holdout |= where & instance.holdout
        picture = film.combined(self.scene, color * shade, seen, film.world_color(self.scene))
        picture[holdout] = 0.0
        size = self.scene.width, self.scene.height
        passes = {
            "Combined": picture,
            "Depth": film.depth_pass(t),
            "Position": film.position_pass(self.scene.camera, tile, size, t),
            "Normal": _unit(normal).astype(np.float32),
            **{name: values.astype(np.float32)[..., None] for name, values in index.items()},
        }
        return {name: passes[name] for name in self.made}

    def _slots(self, shown: Shown, cells: NDArray[np.int32]) -> NDArray[np.int64]:
        """(n,): the slots of the materials of cells (n, 3)."""
        instance = shown.instance
        ids = np.zeros(len(cells), np.int64)
        if instance.n_materials > 1 and shown.volume.info.has_ids:
            ids = cell_ids(shown.volume, cells)
        return instance.first_material + np.minimum(ids, instance.n_materials - 1)

    def _object_index(self, instance: leapray.Instance, slots: NDArray[np.int64]):
        own = self.planned.slot_objects
        if own is None:
            return instance.object_index
        told = np.array(own)[slots]
        return np.where(told == LR_OWN_INDEX, instance.object_index, told)

    def _colors(self, shown: Shown, cells, materials: NDArray[np.int64]) -> NDArray[np.float64]:
        """(n, 3): base colours, with the volume's own where materials are textured."""
        colors = np.array([material.base_color for material in self.scene.materials])[materials]
        textured = np.array(
            [any(lobe.textured for lobe in m.lobes[:1]) for m in self.scene.materials]
        )[materials]
        if self.entry.lights or not (shown.volume.info.has_colors and textured.any()):
            return colors  # lights: the method has them in its voxels
        matrix = shown.volume.info.object_from_index
        centres = (cells[textured] + 0.5) @ matrix[:3, :3].T + matrix[:3, 3]
        own, _ = shown.volume.attributes(centres)
        colors[textured] *= np.where(np.isfinite(own), own, 1.0)
        return colors

    def told(self) -> dict[str, Any]:
        """Keeps the frame, too, for the next one."""
        for shown in self.shown:
            if shown.kept is not None and shown.last is not None:
                frame = replace(shown.last, **_without_pixels(), empty=shown.kept)
                self.cache.put(shown.key, frame, shown.kept.nbytes)
        counters, skipped = film.totals(self.counted), sum(self.skipped)
        share = skipped / max(skipped + counters["rays"], 1)  # of rays that were known to miss
        return {**counters, "skipped_share": round(share, 6)}


def cell_ids(volume: leapray.Volume, cells: NDArray[np.int32]) -> NDArray[np.int64]:
    """(n,): the id of each object cell (n, 3): that of its first object sample, as of hits."""
    found = np.zeros(len(cells), np.int64)
    bricks, which = np.unique(cells >> 3, axis=0, return_inverse=True)
    order = np.argsort(which.ravel(), kind="stable")
    ends = np.cumsum(np.bincount(which.ravel(), minlength=len(bricks)))
    threshold = volume.info.threshold * ONES[volume.info.dtype]
    for brick, some in zip(bricks, np.split(order, ends[:-1]), strict=True):
        first = (8 * brick).tolist()
        at = (cells[some] - first)[:, None] + CORNERS  # (m, 8, 3)
        x, y, z = at.transpose(2, 0, 1)
        inside = volume.read(first, (9, 9, 9))[z, y, x] >= threshold
        corner = inside.argmax(axis=1)[:, None]
        ids = volume.read_ids(first, (9, 9, 9))[z, y, x]
        found[some] = np.take_along_axis(ids, corner, axis=1)[:, 0]
    return found


def _light_in(light: model.Light, world_from_object: NDArray[np.float64]) -> leapray.Light:
    """A sun or a point in an object's space."""
    inverse = np.linalg.inv(world_from_object)
    if light.kind == "sun":
        towards = inverse[:3, :3] @ np.asarray(light.direction)
        return leapray.Light("sun", light.color, direction=towards / np.linalg.norm(towards))
    scale = abs(np.linalg.det(world_from_object[:3, :3])) ** (1 / 3)
    place = inverse[:3, :3] @ np.asarray(light.position) + inverse[:3, 3]
    return leapray.Light("point", np.asarray(light.color) / scale**2, position=place)


def _linear(instance: leapray.Instance) -> NDArray[np.float64]:
    return np.asarray(instance.world_from_object, np.float64)[:3, :3]


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 0, length, 1.0)


def _is_even(world_from_object) -> bool:
    """Whether a matrix scales all directions alike."""
    values = np.linalg.svd(np.asarray(world_from_object)[:3, :3], compute_uv=False)
    return bool(values[0] <= (1 + EVEN) * values[2])


def _is_plain(material: model.Material) -> bool:
    """Whether a material is a colour on a surface, but for highlights."""
    return all(
        lobe.kind == "diffuse"
        or (
            lobe.kind == "principled"
            and lobe.metallic == 0
            and lobe.transmission == 0
            and lobe.alpha == 1
            and not any(lobe.emission)
        )
        for lobe in material.lobes
    )


def _is_colored(instance: leapray.Instance) -> bool:
    color = instance.field_color
    return color is not None and color.part != "id"


def _without_pixels() -> dict[str, Any]:
    """Of an image of which only what the next frame uses is wanted."""
    none = np.zeros((0, 0))
    return {"t": none, "cell": none, "hit": none, "skipped": none, "shade": none}
