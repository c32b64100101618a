# SPDX-License-Identifier: GPL-3.0-or-later
"""Projections: the greatest, least or mean value of volume data along each pixel's ray (no bpy).

Of all volume objects, whatever is shown of them otherwise, the data's own samples are taken, and
all values of theirs count. A ray through the pixel's centre finds extremes to rounding, inside
cells as well; where several volumes lie on it the best of all counts, and means are weighted by the
lengths of the paths. Values are shown as greys, black for the least value of all data and white for
the greatest, or in the colours that the material of a volume emits at them. Where no data lie all
is black.
"""

from __future__ import annotations

import colorsys
import functools
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import leapray

from . import film, model
from .arrays import FLOAT_MOST
from .methods import Method
from .plan import culling, fastest, fields, looks, objects
from .plan.levels import MB
from .plan.planned import Plan
from .store.memory_cache import Cache
from .tiles import Tile, split

PASSES = "Combined", "Depth", "Position", "Object Index", "Volume"
FARTHEST_HUE = 2 / 3  # blue; the nearest is red
# Of a field whose values are projected: nothing of its surfaces.
PLAIN: dict[str, Any] = {
    "thresholds": (),
    "labels": None,
    "clip": None,
    "least": 0,
    "interpolation": "linear",
}


class Values(fields.Fields):
    """The data of all fields, of which every value counts.

    Attributes: limits: the least and the greatest value of each field.
    """

    def __init__(self, *given: Any) -> None:
        self.limits: dict[int, tuple[float, float]] = {}
        super().__init__(*given)

    def _seen(
        self, n: int, name: str, factor: int, room: float
    ) -> tuple[list[fields.Surface], list[str]]:
        """As Fields; nothing of a transfer function's is seen, and all cells are kept."""
        field = self.scene.fields[n]
        key = self._seen_key(field, factor)
        samples = self._stored(key, field, 0.0, factor, room, leapray.FieldSamples)
        if not samples.low <= samples.high:
            return [], [f"{name!r} shows nothing, for its data hold no value."]
        nothing = leapray.TransferFunction([0.0], [0.0])
        made = functools.partial(
            samples.at, nothing, everywhere=True, threads=self.threads, watch=self.watch
        )
        structure = self._structure((*key, b"all"), made, room, samples.nbytes)
        if not structure.volume.info.n_surface_cells:
            return [], [f"{name!r} shows nothing, for {objects.no_cells(field.grid)}."]
        self.limits[n] = samples.low, samples.high
        told = []
        if samples.infinite:
            told = [f"{name!r} holds an infinite value, beside which all others look the same."]
        nbytes = structure.volume.info.nbytes
        return [fields.Surface(n, 0, structure, factor, nbytes)], told

    def _row(self, surface: fields.Surface) -> dict[str, object]:
        low, high = self.limits[surface.field]
        return {**super()._row(surface), "why": f"values from {low:.6g} to {high:.6g}"}


def check(scene: model.Scene, method: Method) -> None:
    """Refuse, in a sentence, a scene without values."""
    if not scene.field_instances:
        why = "".join(f"; {sentence}" for sentence in scene.warnings)
        raise leapray.LeapRayError(
            f"The render method {method.spec} shows values of volume objects, and the scene has no "
            f"data of any{why}"
        )


def plan(
    scene: model.Scene,
    method: Method,
    cache: Cache,
    watch: leapray.Watch,
    threads: int,
    advance: Callable[[float], None] = lambda share: None,
) -> tuple[Plan, Values]:
    """The volumes of all data, and what is known of them. Raises LeapRayError where there are none
    within the memory budget, Stopped; uses and refills cache."""
    began = time.perf_counter()
    cache.begin()
    warnings: list[str] = []
    look = model.Look(_none, _none)
    data = [replace(field, **PLAIN, look=look) for field in scene.fields]
    whole = replace(scene, meshes=(), instances=(), fields=tuple(data))
    placed = [each for each in objects.usable(whole, warnings) if each.visible_camera]
    met = culling.in_view(whole, culling.box_corners(whole, placed))
    shown = [each for each, is_met in zip(placed, met.tolist(), strict=True) if is_met]
    room = scene.settings.memory_mb * MB
    found = Values(whole, shown, cache, watch, threads, room, advance)
    cache.end()
    made = Plan(
        instances=[],
        names=[],
        slots=[],
        lights=(),
        slot_objects=None,
        slot_names=None,
        volumes=[],
        warnings=warnings + _left_out(scene, method),
        volume_nbytes=0,
        structure_nbytes=0,
        scratch_nbytes=0,
        peak_nbytes=found.nbytes,
        seconds={"voxelize": 0.0, "structure": 0.0},
    )
    found.join(made)
    fastest.choose(made, scene, threads, watch, method.mode)
    made.seconds["plan"] = time.perf_counter() - began - sum(found.seconds.values())
    return made, found


def _none(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.zeros((len(values), 3))


def _left_out(scene: model.Scene, method: Method) -> list[str]:
    """What is in the scene and not in the picture."""
    told = []
    meshes = [each.name for each in scene.instances if each.visible_camera]
    if meshes:
        told.append(
            f"The render method {method.spec} shows values of volume objects alone, without "
            f"{film.names(meshes)}."
        )
    cut = {n for n, field in enumerate(scene.fields) if field.clip is not None}
    names = [each.name for each in scene.field_instances if each.field in cut]
    if names:
        told.append(f"The render method {method.spec} does not cut {film.names(names)}.")
    return told


@dataclass(frozen=True)
class Shown:
    """A placed field."""

    instance: leapray.Instance
    inverse: NDArray[np.float64]  # (4, 4): object from world
    ramp: tuple[NDArray, NDArray] | None  # values (n,) and colours (n, 3) at them; None: greys


class ProjectionPainter:
    """The projection of a plan's values, on the rays through the pixels' centres."""

    def __init__(
        self,
        scene: model.Scene,
        method: Method,
        planned: Plan,
        values: Values,
        watch: leapray.Watch,
    ) -> None:
        self.scene, self.method, self.planned, self.watch = scene, method, planned, watch
        self.tiles = split(scene.width, scene.height, scene.settings.tile_size)
        made = ("Combined", "Value") if method.mode == "mean" else (*PASSES, "Value")
        self.made = [name for name in made if name in scene.passes or name == "Combined"]
        self.warnings = film.general_warnings(scene, method.spec, made)
        self.counted: list[dict[str, int]] = []
        limits = np.array(list(values.limits.values())).reshape(-1, 2)
        self.low = float(limits[:, 0].min(initial=np.inf))
        self.high = float(limits[:, 1].max(initial=-np.inf))
        self.shown = self._shown(values)
        corners = [film.world_corners(each) for each in planned.instances]
        self.corners = np.array(corners).reshape(len(corners), 8, 3)
        self.near, self.far = film.depths(scene.camera, self.corners.reshape(-1, 3))

    def _shown(self, values: Values) -> list[Shown]:
        """The instances, each with the ramp of its material."""
        found = []
        for instance in self.planned.instances:
            surface = values.surfaces[instance.volume_index - 1]
            look = self.scene.fields[surface.field].look
            ramp = None if look is None else _ramp(look, *values.limits[surface.field])
            inverse = np.linalg.inv(np.asarray(instance.world_from_object, np.float64))
            found.append(Shown(instance, inverse, ramp))
        return found

    @property
    def nbytes(self) -> int:
        return 0

    def worker(self) -> Callable[[Tile], film.Passes]:
        return self._paint

    def _paint(self, tile: Tile) -> film.Passes:
        size = self.scene.width, self.scene.height
        camera = self.scene.camera
        origins, directions = leapray.camera_rays(camera, *size, window=tile)
        n = len(origins)
        value, t = np.full(n, np.nan), np.full(n, np.inf)
        length, owner = np.zeros(n), np.full(n, -1)
        met = culling.in_view(film.part_of(self.scene, tile), self.corners)
        for number in np.flatnonzero(met):
            shown = self.shown[number]
            linear = shown.inverse[:3, :3]
            way = directions @ linear.T
            hits = leapray.trace(
                shown.instance.structure,
                origins @ linear.T + shown.inverse[:3, 3],
                way,
                t_min=camera.clip_start,
                t_max=camera.clip_end,
                mode=self.method.mode,
                watch=self.watch,
            )
            self.counted.append(hits.counters)
            if self.method.mode == "mean":
                unit = np.linalg.norm(directions, axis=1) / np.linalg.norm(way, axis=1)
                value, length = _mean(value, length, hits.value, hits.length * unit)
                first = (owner < 0) & ~np.isnan(hits.value)
                owner[first] = number
                continue
            better = self._is_better(hits.value, hits.t, value, t)
            value[better], t[better], owner[better] = hits.value[better], hits.t[better], number
        return self._passes(tile, value, t, owner)

    def _is_better(self, new, new_t, old, old_t) -> NDArray[np.bool_]:
        """Where a value counts more than another; NaN is none. Of equal ones the nearer counts."""
        beats = new > old if self.method.mode == "maximum" else new < old
        return beats | (np.isnan(old) & ~np.isnan(new)) | ((new == old) & (new_t < old_t))

    def _passes(self, tile: Tile, value, t, owner) -> film.Passes:
        shape = tile.height, tile.width
        seen = owner >= 0
        rgb = self._colors(value, owner)
        if self.method.by_depth:
            rgb = rgb * self._hues(t)
        index = {name: np.zeros(len(owner)) for name in ("Object Index", "Volume")}
        picture = film.combined(
            self.scene, rgb.reshape(*shape, 3), seen.reshape(shape), np.zeros(3)
        )
        for number in np.unique(owner[seen]):
            instance, where = self.shown[number].instance, owner == number
            index["Object Index"][where] = instance.object_index
            index["Volume"][where] = instance.volume_index
            if instance.holdout:
                picture[where.reshape(shape)] = 0.0
        t = t.reshape(shape)
        size = self.scene.width, self.scene.height
        finite = np.clip(np.where(seen, value, 0.0), -FLOAT_MOST, FLOAT_MOST)
        passes = {
            "Combined": picture,
            "Depth": film.depth_pass(t),
            "Position": film.position_pass(self.scene.camera, tile, size, t),
            "Value": finite.reshape(*shape, 1),
            **{k: v.reshape(*shape, 1).astype(np.float32) for k, v in index.items()},
        }
        return {name: passes[name].astype(np.float32, copy=False) for name in self.made}

    def _colors(self, value: NDArray, owner: NDArray) -> NDArray[np.float64]:
        """(n, 3): greys, or the ramps of those that have one."""
        span = self.high - self.low
        grey = (value - self.low) / span if span > 0 else np.ones(len(value))
        rgb = np.repeat(np.where(owner >= 0, grey, 0.0)[:, None], 3, axis=1)
        for number, shown in enumerate(self.shown):
            where = owner == number
            if shown.ramp is not None and where.any():
                values, colors = shown.ramp
                rgb[where] = np.stack(
                    [np.interp(value[where], values, channel) for channel in colors.T], axis=-1
                )
        return rgb

    def _hues(self, t: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, 3): from red at the nearest corner of all data to blue at the farthest."""
        span = self.far - self.near
        share = np.clip((t - self.near) / span, 0.0, 1.0) if span > 0 else np.zeros(len(t))
        table = np.array([colorsys.hsv_to_rgb(h, 1, 1) for h in np.linspace(0, FARTHEST_HUE, 241)])
        places = np.linspace(0.0, 1.0, len(table))
        known = np.where(np.isfinite(share), share, 0.0)
        return np.stack([np.interp(known, places, channel) for channel in table.T], axis=-1)

    def told(self) -> dict[str, Any]:
        return {**film.totals(self.counted), "values": [self.low, self.high]}


def _mean(value, length, more, by) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Means along paths joined with others; NaN along none."""
    by = np.where(np.isnan(more), 0.0, by)
    total = length + by
    both = np.where(length > 0, value, 0.0) * length + np.where(by > 0, more, 0.0) * by
    return np.divide(both, total, out=np.full(len(total), np.nan), where=total > 0), total


def _ramp(look: model.Look, low: float, high: float) -> tuple[NDArray, NDArray] | None:
    """What a look emits from low to high, the brightest channel 1; None where it emits nothing."""
    values, colors = looks.bends(look.emission, looks.places(low, high, look.named))
    most = colors.max()
    return (values, colors / most) if np.isfinite(colors).all() and most > 0 else None
