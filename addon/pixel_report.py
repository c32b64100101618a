# SPDX-License-Identifier: GPL-3.0-or-later
"""What happened on the paths of one pixel, as data and as text (no bpy).

The core records rays, hits and light samples while it renders the pixel. The cells that a ray
visits are found afterwards: the ray is traced again with other ends, and a cell is entered where
the number of visited cells grows.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import leapray
from leapray._abi import (
    LR_EVENT_HIT,
    LR_EVENT_LIGHT,
    LR_EVENT_RAY,
    LR_EVENT_SCATTER,
    LR_RAY_TRANSPARENT,
    LR_RAY_VOLUME,
    lr_ray_kind,
)
from leapray.arrays import members

from . import model
from .plan.plan import Plan

CELLS_LISTED = 20  # of one ray
NONE = 2**32 - 1  # no instance, no triangle
OWN_EMISSION, VOLUME_EMISSION = 2**64 - 1, 2**64 - 2  # in place of a light's index
KINDS = tuple(members(lr_ray_kind))
SEES = {KINDS[LR_RAY_VOLUME]: "volume_scatter"}  # where a kind's visibility has another name
SECTIONS = 32  # of the ends between which a visited cell is sought, in one step


def describe(
    record: leapray.Record, scene: model.Scene, plan: Plan, place: tuple[int, int], value: NDArray
) -> dict[str, Any]:
    """All that the record holds, by names instead of numbers.

    place: the pixel's column and row, from the lower left; value: (4,) its Combined pass.
    Contributions are fractions of the pixel's value: divided by its samples, times the film's
    exposure; so they sum up to it. sum: of those so far, in the order of the rays.
    """
    reader = _Reader(record, scene, plan)
    return {
        "x": place[0],
        "y": place[1],
        "value": np.asarray(value, np.float64).tolist(),
        "sum": reader.sum.tolist(),
        "samples": record.samples,
        "events": len(record.events) + record.lost,
        "events_lost": record.lost,
        "rays": reader.rays,
    }


class _Reader:
    """Makes one entry per ray of the events of a record."""

    def __init__(self, record: leapray.Record, scene: model.Scene, plan: Plan) -> None:
        self.scene, self.plan = scene, plan
        self.fraction = scene.film_exposure / max(record.samples, 1)
        self.sum = np.zeros(3)
        self.rays: list[dict[str, Any]] = []
        self.boxes = np.array([_box(each) for each in plan.instances]).reshape(-1, 2, 3)
        starts: dict[tuple[int, int], Any] = {}
        ends: dict[tuple[int, int], Any] = {}
        lit: dict[tuple[int, int], list[Any]] = {}
        points: dict[tuple[int, int], Any] = {}
        for event in record.events:
            key = int(event["sample"]), int(event["ray"])
            if event["kind"] == LR_EVENT_RAY:
                starts[key] = event
            elif event["kind"] == LR_EVENT_HIT:
                ends[key] = event
            elif event["kind"] == LR_EVENT_SCATTER:
                points[key] = event
            else:
                lit.setdefault(key, []).append(event)
        self.numbers = {key: number for number, key in enumerate(starts)}
        self.visible: dict[tuple[int, int], str] = {}
        scattered = {}
        for key, event in points.items():
            before = key[0], int(event["parent"])
            scattered[before] = event, lit.get(key, [])
            self.numbers[key] = self.numbers[before]
        for key, start in starts.items():
            self.rays.append(self._ray(key, start, ends.get(key), lit.get(key, [])))
            self.rays[-1]["scattered"] = self._scattered(*scattered.get(key, (None, [])))

    def _ray(self, key: tuple[int, int], start, end, lit: list) -> dict[str, Any]:
        camera = start["parent"] == start["ray"]
        before = key[0], int(start["parent"])
        kind = int(start["ray_kind"])
        own_kind = KINDS[kind] if kind != LR_RAY_TRANSPARENT else self.visible.get(before, "camera")
        self.visible[key] = own_kind
        return {
            "ray": self.numbers[key],
            "sample": key[0],
            "after": None if camera else self.numbers.get(before),
            "kind": KINDS[kind],
            "bounces": int(start["bounces"]),
            "transparent_bounces": int(start["transparent"]),
            "scattered_no_more": bool(start["last"]),
            "origin": start["origin"].tolist(),
            "direction": start["direction"].tolist(),
            "throughput": start["throughput"].tolist(),
            "leaves": self._instance_name(start["instance"]),
            "inside": [
                {"object": self._instance_name(n), "material": self._material_name(m)}
                for n, m in zip(start["media"], start["media_material"], strict=True)
            ][: int(start["n_media"])],
            "cells": None if end is None else int(end["steps"]),
            "volumes": [] if end is None else self._volumes(start, own_kind),
            "hit": None if end is None or end["instance"] == NONE else self._hit(start, end),
            "light": [self._light(event) for event in lit],
        }

    # ---- names

    def _instance_name(self, instance: int) -> str | None:
        return None if instance == NONE else self.plan.names[int(instance)]

    def _material_name(self, material: int) -> str:
        return self.scene.materials[int(material)].name

    def _object_name(self, end) -> str:
        """Of a hit: where one volume holds several objects, the slot tells which."""
        if self.plan.slot_names is None:
            return self.plan.names[int(end["instance"])]
        placed = self.plan.instances[int(end["instance"])]
        return self.plan.slot_names[
            placed.first_material + min(max(int(end["id"]), 0), placed.n_materials - 1)
        ]

    def _light_name(self, light: int) -> str:
        if light == OWN_EMISSION:
            return "the surface itself"
        if light == VOLUME_EMISSION:
            return "volumes on the way"
        lights = self.plan.lights
        return lights[int(light)].name if light < len(lights) else "World"

    # ---- parts of a ray

    def _hit(self, start, end) -> dict[str, Any]:
        placed = self.plan.instances[int(end["instance"])]
        field = end["triangle"] == NONE
        return {
            "t": float(end["t"]),
            "distance": float(end["t"] * np.linalg.norm(start["direction"])),
            "object": self._object_name(end),
            "volume": placed.volume_index,
            "cell": end["cell"].tolist(),
            "position": end["position"].tolist(),
            "normal": end["normal"].tolist(),
            "from_inside": bool(end["side"] > 0),
            "material": self._material_name(end["material"]),
            "id": int(end["id"]),
            "surface": "field" if field else "triangle",
            "triangle": None if field else int(end["triangle"]),
            "error": placed.error,
            "throughput": end["throughput"].tolist(),
        }

    def _scattered(self, event, lit: list) -> dict[str, Any] | None:
        """Where a volume scatters a ray before its end, and the light that it gets there."""
        if event is None:
            return None
        return {
            "t": float(event["t"]),
            "object": self._instance_name(event["instance"]),
            "position": event["position"].tolist(),
            "throughput": event["throughput"].tolist(),
            "light": [self._light(each) for each in lit],
        }

    def _light(self, event) -> dict[str, Any]:
        sampled = event["kind"] == LR_EVENT_LIGHT
        contribution = event["contribution"] * self.fraction
        self.sum = self.sum + contribution
        told: dict[str, Any] = {
            "light": self._light_name(event["light"]),
            "how": "sampled" if sampled else "met",
            "weight": float(event["weight"]),
            "contribution": contribution.tolist(),
            "sum": self.sum.tolist(),
        }
        if sampled:
            told |= {
                "probability": float(event["probability"]),
                "pdf": float(event["pdf"]),
                "origin": event["origin"].tolist(),
                "direction": event["direction"].tolist(),
                "distance": float(event["t"]),
                "blocked_by": self._instance_name(event["instance"]),
            }
        return told

    def _volumes(self, start, kind: str) -> list[dict[str, Any]]:
        """The volumes in which the ray visits cells, and these cells, as far as CELLS_LISTED of
        the ray go.

        As in the core, volumes are searched in the order in which the ray enters their boxes,
        each up to the nearest hit so far: one that is entered early may be searched behind the
        hit of a later one.
        """
        camera = start["parent"] == start["ray"]
        low = float(self.scene.camera.clip_start) if camera else 0.0
        high, room = float(start["t"]), CELLS_LISTED
        entries = _entries(self.boxes, start["origin"], start["direction"], low, high)
        found = []
        for n in np.argsort(entries, kind="stable"):
            placed = self.plan.instances[n]
            row = self.plan.volumes[placed.volume_index - 1]
            if not (entries[n] <= high and getattr(placed, f"visible_{SEES.get(kind, kind)}")):
                continue
            leaves = start["instance"] == n and start["side"] != 0
            side = (start["cell"], int(start["side"])) if leaves else None
            matrix = np.linalg.inv(np.asarray(placed.world_from_object, np.float64))
            ray = Ray(
                placed.structure,
                matrix[:3, :3] @ start["origin"] + matrix[:3, 3],
                matrix[:3, :3] @ start["direction"],
                low,
                side,
                "volume" if row["kind"] == "volume" else "surface",
            )
            high = min(high, ray.hit(high, self.scene.settings))
            count, cells = ray.visited_cells(high, room)
            room -= len(cells)
            if count:
                found.append(
                    {
                        "object": self.plan.names[n],
                        "volume": placed.volume_index,
                        "cells": count,
                        "list": cells.tolist(),
                    }
                )
        return found


# ---- rays that are traced again ----------------------------------------------------


def _box(instance: leapray.Instance) -> NDArray[np.float64]:
    """(2, 3): around what rays can hit of the instance, in world space."""
    structure = instance.structure
    corners = np.stack(np.meshgrid(*structure.bounds.T, indexing="ij"), axis=-1).reshape(-1, 3)
    matrix = np.asarray(instance.world_from_object, np.float64)
    matrix = matrix @ structure.volume.info.object_from_index
    corners = corners @ matrix[:3, :3].T + matrix[:3, 3]
    return np.array([corners.min(axis=0), corners.max(axis=0)])


def _entries(boxes: NDArray, origin: NDArray, direction: NDArray, low: float, high: float):
    """(n,): where a ray enters boxes (n, 2, 3) between low and high; infinity where it does not."""
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (boxes - origin) / direction  # not a number in the plane of a side
    enter = np.fmax(np.fmax.reduce(np.fmin(t[:, 0], t[:, 1]), axis=1), low)
    leave = np.fmin(np.fmin.reduce(np.fmax(t[:, 0], t[:, 1]), axis=1), high)
    return np.where(enter <= leave, enter, np.inf)


@dataclass
class Ray:
    """A ray in the space of a structure's volume."""

    structure: leapray.Structure
    origin: NDArray[np.float64]  # (3,)
    direction: NDArray[np.float64]  # (3,)
    low: float = 0.0  # t at which it begins
    start: tuple[NDArray, int] | None = None  # cell and side of a surface that it leaves
    mode: str = "surface"  # | "volume", which has no surface

    def _trace(self, ends: NDArray, **options) -> leapray.Hits:
        n = len(ends)
        start = self.start and (np.tile(self.start[0], (n, 1)), np.full(n, self.start[1]))
        rays = np.tile(self.origin, (n, 1)), np.tile(self.direction, (n, 1))
        return leapray.trace(
            self.structure,
            *rays,
            t_min=self.low,
            t_max=ends,
            start=start,
            mode=self.mode,
            **options,
        )

    def hit(self, high: float, settings: model.Settings) -> float:
        """t of the hit before high, or infinity."""
        if self.mode == "volume":
            return np.inf
        return float(self._trace(np.array([high]), **settings.trace_options(self.mode)).t[0])

    def visited_cells(self, high: float, most: int) -> tuple[int, NDArray[np.int64]]:
        """How many cells the ray visits up to t = high, and the first `most` of them, (n, 3).

        A cell that is touched in a single point is listed as the one behind that point.
        """
        info = self.structure.volume.info
        index = np.linalg.inv(info.object_from_index)
        o, d = index[:3, :3] @ self.origin + index[:3, 3], index[:3, :3] @ self.direction
        with np.errstate(divide="ignore", invalid="ignore"):
            planes = (np.array([np.full(3, -2), np.add(info.size, 1)]) - o) / d
        beyond = np.where(d == 0, np.inf, planes.max(axis=0)).min()  # of all cells
        last = max(min(high, float(beyond)), self.low)
        total = int(self._trace(np.array([high])).steps[0])
        counts = np.arange(1, min(total, most) + 1)
        # The count reaches each number between before and behind.
        before, behind = np.full(len(counts), self.low), np.full(len(counts), last)
        narrower = len(counts) > 0
        while narrower:
            ends = np.linspace(before, behind, SECTIONS + 1, axis=1)
            reached = self._trace(ends.ravel()).steps.reshape(ends.shape) >= counts[:, None]
            reached[:, -1] = True
            rows, first = np.arange(len(counts)), reached.argmax(axis=1)
            closer = np.where(first > 0, ends[rows, np.maximum(first - 1, 0)], before)
            narrower = bool((closer > before).any() or (ends[rows, first] < behind).any())
            before, behind = closer, ends[rows, first]
        following = np.append(behind[1:], last)
        step = np.minimum(0.5 * (following - behind), 1e-4 / np.abs(d).max())
        return total, np.floor(o + (behind + step)[:, None] * d).astype(int)


# ---- as text -------------------------------------------------------------------


def lines(told: dict[str, Any]) -> Iterator[str]:
    """The report as text, a line for each ray, hit and light."""
    samples = told["samples"]
    yield f"Pixel {told['x']},{told['y']}, counted from the lower left; {_many(samples, 'sample')}"
    shown = None
    for ray in told["rays"]:
        if ray["sample"] != shown:
            shown = ray["sample"]
            yield ""
            yield f"Sample {shown + 1} of {samples}"
        yield from _ray_lines(ray)
    yield ""
    if told["events_lost"]:
        yield (
            f"{told['events_lost']} of {told['events']} events found no room; what they contribute "
            "is missing from the sum."
        )
    yield f"Sum of the contributions: {_triple(told['sum'])}"
    red, green, blue, alpha = told["value"]
    yield f"The pixel's value: {_triple((red, green, blue))}, alpha {alpha:.6g}"


def _ray_lines(ray: dict[str, Any]) -> Iterator[str]:
    after = "" if ray["after"] is None else f" after ray {ray['after']}, from {ray['leaves']},"
    yield f"  Ray {ray['ray']}, {ray['kind']},{after} {_many(ray['bounces'], 'bounce')}"
    if ray["transparent_bounces"]:
        yield f"    through {_many(ray['transparent_bounces'], 'transparent surface')}"
    yield f"    origin {_triple(ray['origin'])}, direction {_triple(ray['direction'])}"
    yield f"    throughput {_triple(ray['throughput'])}"
    if ray["inside"]:
        solids = ", ".join(f"{each['object']} ({each['material']})" for each in ray["inside"])
        yield f"    inside {solids}"
    for volume in ray["volumes"]:
        cells = " ".join("({},{},{})".format(*cell) for cell in volume["list"])
        more = volume["cells"] - len(volume["list"])
        rest = f" ... {more} more" if more else ""
        name = f"volume {volume['volume']} of {volume['object']}"
        yield f"    {_many(volume['cells'], 'cell')} visited in {name}: {cells}{rest}"
    yield from _end_lines(ray)
    for light in ray["light"]:
        yield from _light_lines(light)
    point = ray["scattered"]
    if point is None:
        return
    yield f"    is scattered in {point['object']} at t {point['t']:.8g}"
    yield f"      position {_triple(point['position'])}, throughput {_triple(point['throughput'])}"
    for light in point["light"]:
        yield from _light_lines(light)


def _end_lines(ray: dict[str, Any]) -> Iterator[str]:
    hit = ray["hit"]
    if hit is None:
        yield "    hits nothing" if ray["cells"] is not None else "    its end was not recorded"
        return
    at = f"t {hit['t']:.8g}, distance {hit['distance']:.8g}"
    yield f"    hits {hit['object']}{' from inside' if hit['from_inside'] else ''} at {at}"
    where = "({},{},{})".format(*hit["cell"])
    found = f"triangle {hit['triangle']} of the cell" if hit["surface"] == "triangle" else "field"
    yield f"      cell {where} of volume {hit['volume']}, on the {found}, error {hit['error']:.3g}"
    yield f"      position {_triple(hit['position'])}, normal {_triple(hit['normal'])}"
    yield f"      material {hit['material']}, id {hit['id']}"
    if ray["inside"]:
        yield f"      throughput at the hit {_triple(hit['throughput'])}"
    if ray["scattered_no_more"]:
        yield "      not scattered: a limit of bounces is reached"


def _light_lines(light: dict[str, Any]) -> Iterator[str]:
    added = f"+ {_triple(light['contribution'])} = {_triple(light['sum'])}"
    if light["how"] == "met":
        yield f"    finds {light['light']}, weight {light['weight']:.6g}: {added}"
        return
    yield f"    samples {light['light']}: {_sample_words(light)}"
    if light["pdf"] > 0:
        yield f"      {added}"


def _sample_words(light: dict[str, Any]) -> str:
    if not light["pdf"] > 0:
        return f"probability {light['probability']:.6g}, it sends nothing to this side"
    blocked = f"blocked by {light['blocked_by']}" if light["blocked_by"] else "clear"
    return (
        f"probability {light['probability']:.6g}, pdf {light['pdf']:.6g}, "
        f"weight {light['weight']:.6g}, {blocked}"
    )


def _many(n: int, thing: str) -> str:
    return f"{n} {thing}" if n == 1 else f"{n} {thing}s"


def _triple(values) -> str:
    return "({:.6g}, {:.6g}, {:.6g})".format(*values)
