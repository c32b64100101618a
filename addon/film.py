# SPDX-License-Identifier: GPL-3.0-or-later
"""What pictures without light paths share: cameras in objects' space, what lies behind, and who
paints (no bpy)."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

import leapray

from . import model
from .plan.planned import Plan
from .tiles import Tile

FAR = 1e10  # the depth of nothing, as the core has it
LISTED = 5  # names in a sentence

Passes = dict[str, NDArray[np.float32]]  # (height, width, channels), rows from below


class Painter(Protocol):
    """Who makes the passes of a picture, tile by tile, on several threads."""

    planned: Plan  # what is shown
    tiles: list[Tile]
    warnings: list[str]

    @property
    def nbytes(self) -> int:
        """Beside volumes, structures and pixels."""
        ...

    def worker(self) -> Callable[[Tile], Passes]:
        """What a thread calls for each of its tiles. Raises LeapRayError, Stopped."""
        ...

    def told(self) -> dict[str, Any]:
        """For the report, once all tiles are painted: counters, and what else there is to say."""
        ...


def totals(counted: Iterable[dict[str, int]]) -> dict[str, int]:
    """The sums of counters; of most_cells the largest."""
    found = leapray.add_counters([])
    for each in counted:
        for name, n in each.items():
            found[name] = max(found[name], n) if name == "most_cells" else found[name] + n
    return found


def camera_in(camera: leapray.Camera, world_from_object: ArrayLike) -> leapray.Camera:
    """The camera in an object's space: the same rays by the same t, whatever the matrix."""
    inverse = np.linalg.inv(np.asarray(world_from_object, np.float64))
    linear = inverse[:3, :3]
    return leapray.Camera(
        projection=camera.projection,
        eye=linear @ camera.eye + inverse[:3, 3],
        forward=linear @ camera.forward,
        corner=linear @ camera.corner,
        dx=linear @ camera.dx,
        dy=linear @ camera.dy,
        clip_start=camera.clip_start,
        clip_end=camera.clip_end,
    )


def part_of(scene: model.Scene, tile: Tile) -> model.Scene:
    """The scene through a tile of its film."""
    camera = scene.camera
    corner = camera.corner + tile.x * camera.dx + tile.y * camera.dy
    return dataclasses.replace(
        scene,
        camera=dataclasses.replace(camera, corner=corner),
        width=tile.width,
        height=tile.height,
    )


def world_corners(instance: leapray.Instance) -> NDArray[np.float64]:
    """(8, 3): of the box of the surface cells, in the world."""
    info = instance.structure.volume.info
    ends = np.array([info.surface_lo, np.add(info.surface_hi, 1)], np.float64)
    corners = np.stack(np.meshgrid(*ends.T, indexing="ij"), axis=-1).reshape(-1, 3)
    matrix = np.asarray(instance.world_from_object, np.float64) @ info.object_from_index
    return corners @ matrix[:3, :3].T + matrix[:3, 3]


def depths(camera: leapray.Camera, corners: NDArray[np.float64]) -> tuple[float, float]:
    """The least and the greatest depth of points (n, 3) that the camera does not cut off."""
    forward = np.asarray(camera.forward, np.float64)
    along = (corners - camera.eye) @ forward / (forward @ forward)
    if not len(along):
        return camera.clip_start, camera.clip_start
    return max(float(along.min()), camera.clip_start), min(float(along.max()), camera.clip_end)


def combined(
    scene: model.Scene,
    rgb: NDArray[np.float64],
    seen: NDArray[np.bool_],
    behind: NDArray[np.float64],
) -> NDArray[np.float32]:
    """The Combined pass (height, width, 4): rgb, and what lies behind where nothing is seen."""
    picture = np.empty((*seen.shape, 4), np.float32)
    picture[..., :3] = np.where(seen[..., None], rgb, behind)
    picture[..., 3] = seen if scene.film_transparent else 1.0
    return picture


def world_color(scene: model.Scene) -> NDArray[np.float64]:
    """(3,): what the camera sees of the world, but for its image."""
    world = scene.world
    shows = world.visible_camera and world.image is None and not scene.film_transparent
    return np.asarray(world.color, np.float64) if shows else np.zeros(3)


def depth_pass(t: NDArray[np.float64]) -> NDArray[np.float32]:
    return np.where(np.isfinite(t), t, FAR).astype(np.float32)[..., None]


def position_pass(
    camera: leapray.Camera, tile: Tile, size: tuple[int, int], t: NDArray[np.float64]
) -> NDArray[np.float32]:
    """Of depths (height, width); 0 where nothing is seen. size: width and height of the film."""
    origins, directions = leapray.camera_rays(camera, *size, window=tile)
    far = np.where(np.isfinite(t), t, 0.0).reshape(-1, 1)
    points = (origins + far * directions) * np.isfinite(t).reshape(-1, 1)
    return points.reshape(*t.shape, 3).astype(np.float32)


# ---- what is said ----------------------------------------------------------------


def names(found: Iterable[str]) -> str:
    """Some names for a sentence."""
    distinct = list(dict.fromkeys(found))
    more = len(distinct) - LISTED
    listed = ", ".join(repr(name) for name in distinct[:LISTED])
    return f"{listed} and {more} more" if more > 0 else listed


def general_warnings(scene: model.Scene, spec: str, made: Sequence[str]) -> list[str]:
    """What no render method but rays shows, as far as this scene asks for it.

    made: the passes that the method makes.
    """
    told = []
    if scene.settings.samples > 1:
        told.append(
            f"The render method {spec} takes one ray through each pixel's centre, not "
            f"{scene.settings.samples} samples."
        )
    missing = [name for name in scene.passes if name not in (*made, "Value")]
    if missing:
        told.append(f"The render method {spec} does not make the passes {', '.join(missing)}.")
    return told
