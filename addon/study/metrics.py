# SPDX-License-Identifier: GPL-3.0-or-later
"""How two images of one scene differ, in numbers (no bpy).

Images are (height, width) or (height, width, channels), rows from above or below alike. Neighbours
are the eight around a pixel; distances between pixels are counted in king's steps.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import unit

Mask = NDArray[np.bool_]
PERCENTILES = {"median": 50.0, "p95": 95.0, "p99": 99.0, "max": 100.0}
TURNED = 5.0  # degrees: larger errors of normals are visible


@dataclass(frozen=True)
class View:
    """A camera, for the metrics."""

    perspective: bool
    eye: NDArray[np.float64]  # (3,) world space
    forward: NDArray[np.float64]  # (3,) unit, world space
    pixel: float  # a pixel's width: at depth 1 (perspective), or at any depth (orthographic)
    film_from_world: NDArray[np.float64]  # (4, 4) homogeneous: to pixels from the lower left

    def footprint(self, depth: NDArray[np.floating]) -> NDArray[np.float64]:
        """A pixel's width at a depth, in world units."""
        depth = np.asarray(depth, np.float64)
        return depth * self.pixel if self.perspective else np.full_like(depth, self.pixel)

    def rays(
        self, position: NDArray[np.floating]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Through points (..., 3): unit directions, and the length of a ray per unit of depth."""
        if not self.perspective:
            return np.broadcast_to(self.forward, position.shape), np.ones(position.shape[:-1])
        away = np.asarray(position, np.float64) - self.eye
        length = np.linalg.norm(away, axis=-1)
        length = np.where(length > 0, length, 1.0)
        unit = away / length[..., None]
        along = unit @ self.forward
        return unit, 1.0 / np.where(np.abs(along) > 1e-12, along, 1.0)

    def film(self, points: NDArray[np.floating]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Where points (n, 3) appear, in pixels from the lower left, and their depths."""
        homogeneous = np.concatenate([points, np.ones((len(points), 1))], axis=1)
        film = homogeneous @ self.film_from_world.T
        return film[:, :2] / film[:, 3:4], (points - self.eye) @ self.forward


# ---- neighbourhoods ------------------------------------------------------


def around(image: NDArray) -> NDArray:
    """The nine shifts of an image (9, height, width); beyond the border its rim goes on."""
    padded = np.pad(image, 1, mode="edge")
    height, width = image.shape
    return np.stack([padded[y : y + height, x : x + width] for y in range(3) for x in range(3)])


def mixed(labels: NDArray) -> Mask:
    """Pixels whose 3x3 neighbourhood holds more than one label."""
    shifts = around(labels)
    return (shifts != shifts[4]).any(axis=0)


def grown(mask: Mask, steps: int = 1) -> Mask:
    """The mask and all within so many steps."""
    for _ in range(steps):
        mask = around(mask).any(axis=0)
    return mask


def steps_to_other(labels: NDArray) -> NDArray[np.int32]:
    """Steps from each pixel to the nearest of another label: 1 on edge pixels, 0 if none is."""
    reached = mixed(labels)
    steps = reached.astype(np.int32)
    distance = 1
    while reached.any() and not reached.all():
        distance += 1
        now = grown(reached)
        steps[now & ~reached] = distance
        reached = now
    return steps


def rims(*labels: NDArray) -> Mask:
    """Pixels whose neighbourhood is mixed in any of the images, of indices or of lit and unlit."""
    mask = mixed(labels[0])
    for image in labels[1:]:
        mask |= mixed(image)
    return mask


# ---- geometry ------------------------------------------------------------


def percentiles(values: NDArray[np.floating]) -> dict[str, float | int | None]:
    """Median, 95 %, 99 % and maximum, and how many; None where there are no values."""
    known: dict[str, float | int | None] = {"n": int(values.size)}
    for name, percent in PERCENTILES.items():
        known[name] = float(np.percentile(values, percent)) if values.size else None
    return known


def index_mismatch(want: NDArray, got: NDArray, apart: Mask | None = None) -> dict[str, Any]:
    """How the object indices differ.

    share_of_edges is the number of pixels that differ by the number of edge pixels of want;
    worst_steps how many pixels the farthest of them lies from another index of want (1: at an
    edge, 0: nothing differs). Pixels of apart (rims of sheets) are counted on their own.
    """
    apart = np.zeros(want.shape, bool) if apart is None else apart
    differ = want != got
    edge, steps = mixed(want), steps_to_other(want)

    def count(mask: Mask) -> dict[str, object]:
        n, n_edges = int(mask.sum()), int(edge.sum())
        worst = int(steps[mask].max()) if n else 0
        return {
            "n": n,
            "share_of_edges": n / n_edges if n_edges else None,
            "share_of_image": n / want.size,
            "worst_steps": worst if n_edges or not n else None,  # no edge to be near to
            "n_beyond_edges": int((mask & (steps > 1)).sum()),
        }

    return {
        "n_edge_pixels": int(edge.sum()),
        "all": count(differ),
        "but_sheet_rims": count(differ & ~apart),
        "sheet_rims": count(differ & apart),
    }


def depth_error(
    view: View,
    depth: NDArray[np.floating],
    position: NDArray[np.floating],
    normal: NDArray[np.floating],
    other_depth: NDArray[np.floating],
) -> NDArray[np.float64]:
    """Error in footprints: |difference along the ray| x |n.d| / footprint, per pixel."""
    direction, along = view.rays(position)
    difference = np.abs(np.asarray(other_depth, np.float64) - depth) * along
    facing = np.abs((unit(np.asarray(normal, np.float64)) * direction).sum(axis=-1))
    return difference * facing / view.footprint(depth)


def angle(a: NDArray[np.floating], b: NDArray[np.floating]) -> NDArray[np.float64]:
    """Degrees between vectors (..., 3), right for small angles too."""
    a, b = (unit(np.asarray(each, np.float64)) for each in (a, b))
    across = np.linalg.norm(np.cross(a, b), axis=-1)
    return np.degrees(np.arctan2(across, (a * b).sum(axis=-1)))


def per_object(
    index: NDArray, mask: Mask, values: NDArray[np.floating], names: dict[int, str]
) -> dict[str, dict[str, float | int | None]]:
    """Percentiles of the values of each object that is seen within the mask."""
    return {
        names.get(int(k), f"index {int(k)}"): percentiles(values[mask & (index == k)])
        for k in np.unique(index[mask])
    }


def turned_fraction(angle: NDArray[np.floating], mask: Mask) -> float:
    """The fraction of the mask's pixels whose normals are off by more than TURNED degrees."""
    return float((angle[mask] > TURNED).mean()) if mask.any() else 0.0


def on_lines(view: View, starts: NDArray, ends: NDArray, shape: tuple[int, ...]) -> NDArray:
    """Line segments (n, 3) on the film: (m, 3) of column, row, depth, half a pixel apart at most.

    Rows count from below; what lies behind the camera or outside the image is left out.
    """
    ahead = np.ones(len(starts), bool)
    if view.perspective:
        least = 1e-6
        ahead = ((starts - view.eye) @ view.forward > least) & (
            (ends - view.eye) @ view.forward > least
        )
    starts, ends = starts[ahead], ends[ahead]
    if not len(starts):
        return np.empty((0, 3))
    a, b = view.film(starts)[0], view.film(ends)[0]
    length = np.abs(b - a).max(axis=1)
    count = np.minimum(np.ceil(2 * length), 4 * max(shape)).astype(int) + 1
    which = np.repeat(np.arange(len(count)), count)
    place = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    fraction = (place / np.maximum(count[which] - 1, 1))[:, None]
    film, depth = view.film(starts[which] * (1 - fraction) + ends[which] * fraction)
    points = np.column_stack([film, depth])
    height, width = shape
    inside = (film >= 0).all(axis=1) & (film[:, 0] < width) & (film[:, 1] < height)
    return points[inside]


# ---- light ---------------------------------------------------------------


def light_error(
    want: NDArray[np.floating],
    got: NDArray[np.floating],
    white: float = 1.0,
    mask: Mask | None = None,
) -> dict[str, float | int | None]:
    """Of linear RGB (height, width, 3) where mask holds; white is the value of a lit white surface.

    mean_ratio is got's mean by want's, less 1. rmse and psnr are relative to white.
    """
    if mask is not None:
        want, got = want[mask], got[mask]
    want, got = np.asarray(want, np.float64), np.asarray(got, np.float64)
    known: dict[str, float | int | None] = {"n": want.size // 3}
    if not want.size:
        return known | {"mean_ratio": None, "rmse": None, "psnr": None, "max": None}
    rmse = float(np.sqrt(np.mean((got - want) ** 2))) / white
    mean = float(want.mean())
    return known | {
        "mean_ratio": float(got.mean()) / mean - 1 if mean else None,
        "rmse": rmse,
        "psnr": -20 * float(np.log10(rmse)) if rmse else None,
        "max": float(np.abs(got - want).max()) / white,
    }
