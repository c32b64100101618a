# SPDX-License-Identifier: GPL-3.0-or-later
"""Area lights that lie in a surface, or nearer to it than it is modelled exactly (no bpy).

Whether such a light is before or behind the surface follows from the mesh alone: the
volume's surface lies on either side of the light, varying with the place and the level.
So the light's rays end behind the mesh, or before it, by a margin of the volume's error.
A surface in the plane of a light hides it, but for Cycles' rounding.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from .. import model

TIE = 4 * np.finfo(np.float32).eps  # of coordinates: what Blender's f32 make of one plane
TOUCH = 1e-6  # of a light's sides: less is no overlap


@dataclasses.dataclass(frozen=True)
class Surface:
    """A mesh as it is placed in the world."""

    name: str  # of the object
    mesh: model.Mesh
    world_from_object: NDArray[np.float64]
    accuracy: float  # how far its volume's surface may lie from it, in world space


def with_margins(
    lights: Sequence[model.Light], surfaces: Iterable[Surface], warnings: list[str]
) -> tuple[model.Light, ...]:
    """The lights, those that lie in surfaces with their plane_margin. What is hidden is told."""
    if not any(_matters(light) for light in lights):
        return tuple(lights)
    placed = list(surfaces)
    boxes = np.array([_box(each) for each in placed]).reshape(-1, 2, 3)
    return tuple(
        dataclasses.replace(light, plane_margin=_margin(light, placed, boxes, warnings))
        if _matters(light)
        else light
        for light in lights
    )


def _matters(light: model.Light) -> bool:
    return light.kind == "area" and light.casts_shadow


def _box(surface: Surface) -> NDArray[np.float64]:
    """(2, 3): the box in world space, grown by what the surface may be off."""
    lo, hi = surface.mesh.bounds
    matrix = np.asarray(surface.world_from_object, np.float64)
    centre = matrix[:3, :3] @ (lo + hi) / 2 + matrix[:3, 3]
    half = np.abs(matrix[:3, :3]) @ (hi - lo) / 2 + surface.accuracy
    return np.array([centre - half, centre + half])


def _margin(
    light: model.Light, placed: list[Surface], boxes: NDArray[np.float64], warnings: list[str]
) -> float:
    """Positive where a surface lies in the light's plane or before it, negative behind it."""
    half = (np.abs(light.axis_u) + np.abs(light.axis_v)) / 2
    lo, hi = np.array(light.position) - half, np.array(light.position) + half
    tie = TIE * max(np.abs(lo).max(), np.abs(hi).max())
    near = (boxes[:, 0] <= hi + tie).all(axis=1) & (boxes[:, 1] >= lo - tie).all(axis=1)
    before = behind = 0.0
    for n in np.flatnonzero(near):
        margin = placed[n].accuracy + 2 * tie
        heights = _heights(light, placed[n], margin)
        if (heights >= -tie).any():
            before = max(before, margin)
            if (np.abs(heights) <= tie).any():
                warnings.append(
                    f"Area light {light.name!r} lies in the very plane of {placed[n].name!r}, "
                    "which hides what it covers of the light."
                )
        elif len(heights):
            behind = max(behind, margin)
    return before or -behind


def _heights(light: model.Light, surface: Surface, margin: float) -> NDArray[np.float64]:
    """The highest points before the light's plane of the triangles over the light that lie
    within the margin of its plane."""
    vertices = surface.mesh.vertices.astype(np.float64)
    matrix = np.asarray(surface.world_from_object, np.float64)
    offset = vertices @ matrix[:3, :3].T + (matrix[:3, 3] - light.position)
    height = offset @ light.direction
    sides = np.array([light.axis_u, light.axis_v])
    square = (sides**2).sum(axis=1)
    across = offset @ sides.T / square  # the light: -0.5 .. 0.5
    triangles = surface.mesh.triangles
    beside = np.zeros(len(triangles), bool)
    for values, low, high in (
        (across[:, 0], -0.5, 0.5),
        (across[:, 1], -0.5, 0.5),
        (height, -margin, margin),
    ):
        corners = values[triangles]
        beside |= (corners.max(axis=1) < low) | (corners.min(axis=1) > high)
    chosen = triangles[~beside]
    flat, heights = across[chosen], height[chosen]
    lowest, highest = _range_over_light(flat, heights)
    parallel = (lowest >= -margin) & (highest <= margin)
    return highest[parallel & _overlaps(flat)]


def _range_over_light(flat: NDArray, heights: NDArray) -> tuple[NDArray, NDArray]:
    """Bounds of the heights of triangles, (n, 3, 2) in the light's plane, over the square."""
    edges = flat[:, 1:] - flat[:, :1]
    edge_heights = heights[:, 1:] - heights[:, :1]
    double = edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        slope_x = (
            edge_heights[:, 0] * edges[:, 1, 1] - edge_heights[:, 1] * edges[:, 0, 1]
        ) / double
        slope_y = (
            edge_heights[:, 1] * edges[:, 0, 0] - edge_heights[:, 0] * edges[:, 1, 0]
        ) / double
        middle = heights[:, 0] - slope_x * flat[:, 0, 0] - slope_y * flat[:, 0, 1]
        spread = (np.abs(slope_x) + np.abs(slope_y)) / 2
        # NaN where the triangle is seen edge-on: then only its corners count.
        lowest = np.fmax(heights.min(axis=1), middle - spread)
        highest = np.fmin(heights.max(axis=1), middle + spread)
    return lowest, highest


def _overlaps(flat: NDArray) -> NDArray[np.bool_]:
    """Whether triangles (n, 3, 2) and the unit square about the origin share an area."""
    shared = np.ones(len(flat), bool)
    for k in range(2):
        shared &= (flat[..., k].min(axis=1) < 0.5 - TOUCH) & (
            flat[..., k].max(axis=1) > TOUCH - 0.5
        )
    for k in range(3):
        edge = flat[:, (k + 1) % 3] - flat[:, k]
        normal = np.stack([-edge[:, 1], edge[:, 0]], axis=1)
        along = (flat * normal[:, None]).sum(axis=2)
        half = np.abs(normal).sum(axis=1) / 2
        slack = TOUCH * half
        shared &= (along.min(axis=1) < half - slack) & (along.max(axis=1) > slack - half)
        shared &= half > 0
    return shared
