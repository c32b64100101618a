# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds volumes that are nearer to each other than their errors (no bpy).

A plan permits each volume an error of a fraction of a pixel, so that of two surfaces with
a smaller gap (a decal, a label, a carpet, a road mark) the farther one may be hit first.
Such pairs are found in two steps: by the boxes of all instances, widened by a few times
the errors, in a sweep along one axis; then by short rays from the probes of one against
the volume of the other, to either side along the normal. A pair is close if some of these
rays hit within a few times both errors, where the surfaces are about parallel and both
visible: the touching faces of two stacked solids are not.

Surfaces that coincide are close too; which of them is hit is undefined.

Source: Cohen, Lin, Manocha, Ponamgi 1995, I-COLLIDE (sweep and prune). Departures: 1. one
axis, the others are compared; 2. only so many pairs, the nearest to the camera first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

import leapray

from .. import model
from ..arrays import inverse, unit
from .probes import Probes

NEAR_ERRORS = (
    3.0  # times both errors, which are quantiles, and one of which the rays see: 2 at least
)
PARALLEL = 0.9  # cosine: a label on other segments than its bottle's turns by a few degrees
FEWEST = 1 / 500  # of one's probes: fewer are where something round or tilted touches a plane
MOSTLY = 0.5  # of a sheet's probes: it is a decal, even on what faces away from the camera
N_PROBES = 2048  # of one volume, evenly chosen,
N_RAYS = 256  # and of those for one pair
MOST_TESTS = 1 << 23  # pairs of boxes that overlap on the axis of the sweep,
BLOCK = 1 << 20  # so many at once
MOST_INSTANCES = 8  # pairs of instances for each pair of volumes
MOST_PAIRS = 1000
TINY = 1e-300

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Body:
    """One volume, and where it stands."""

    matrices: Array  # (n, 4, 4) world from object, of its instances
    box: Array  # (2, 3) of its mesh, in object space
    error: float  # the quantile, in object space
    probes: Callable[[], Probes]
    structure: Callable[[], leapray.Structure]

    @cached_property
    def inverses(self) -> Array:
        """(n, 3, 4) object from world."""
        linear = inverse(self.matrices[:, :3, :3])
        return np.concatenate([linear, -linear @ self.matrices[:, :3, 3:]], axis=2)


@dataclass(frozen=True)
class _Boxes:
    """Of all instances, in the world, widened by NEAR_ERRORS times their errors."""

    body: NDArray[np.int64]  # (n,)
    instance: NDArray[np.int64]  # (n,)
    low: Array  # (n, 3)
    high: Array

    def only(self, some: NDArray) -> _Boxes:
        return _Boxes(self.body[some], self.instance[some], self.low[some], self.high[some])


def close_pairs(
    bodies: Sequence[Body], camera: model.Camera, check_cancelled: Callable[[], None] = lambda: None
) -> list[tuple[int, int]]:
    """Pairs of bodies that come nearer to each other than NEAR_ERRORS times their errors.

    Numbers of bodies, the lower one first; a body is a pair with itself where two of its
    instances are close. A pair is left out if both are in others, or have no error. Not more
    than MOST_PAIRS pairs of instances are looked at, those nearest to the camera. check_cancelled
    may raise.
    """
    if not bodies:
        return []
    boxes, count = _sorted(_boxes(bodies), camera)
    errors = np.array([b.error for b in bodies])
    found: list[tuple[int, int]] = []
    done = {n for n, body in enumerate(bodies) if body.error == 0}
    for one, other in _candidates(boxes, count, errors, camera):
        first, second = sorted((int(boxes.body[one]), int(boxes.body[other])))
        pair = first, second
        if done.issuperset(pair):
            continue
        check_cancelled()
        orders = (one, other), (other, one)
        if any(_touches(bodies, boxes, *order, camera) for order in orders):
            found.append(pair)
            done.update(pair)
    return found


# ---- boxes -------------------------------------------------------------------


def _boxes(bodies: Sequence[Body]) -> _Boxes:
    body = np.repeat(np.arange(len(bodies)), [len(b.matrices) for b in bodies])
    instance = np.concatenate([np.arange(len(b.matrices)) for b in bodies] or [body])
    low, high = np.empty((len(body), 3)), np.empty((len(body), 3))
    for n, one in enumerate(bodies):
        linear = one.matrices[:, :3, :3]
        middle = linear @ one.box.mean(axis=0) + one.matrices[:, :3, 3]
        half = np.abs(linear) @ (0.5 * np.ptp(one.box, axis=0))
        widened = half + NEAR_ERRORS * one.error * np.linalg.norm(linear, axis=2)
        low[body == n], high[body == n] = middle - widened, middle + widened
    return _Boxes(body, instance, low, high)


def _away(low: Array, high: Array, camera: model.Camera) -> Array:
    """Distance of boxes from the camera, squared."""
    gap = np.maximum(np.maximum(low - camera.eye, camera.eye - high), 0.0)
    return (gap**2).sum(axis=1)


def _sorted(boxes: _Boxes, camera: model.Camera) -> tuple[_Boxes, NDArray[np.int64]]:
    """By where they begin on the axis of the sweep; and how many behind each overlap it there.

    Of too many the farther half is dropped, until the sweep is short.
    """
    while True:
        size = (boxes.high - boxes.low).sum(axis=0)
        axis = int(np.argmax(np.ptp(boxes.low, axis=0) / np.maximum(size, TINY)))
        boxes = boxes.only(np.argsort(boxes.low[:, axis], kind="stable"))
        n = len(boxes.body)
        behind = np.searchsorted(boxes.low[:, axis], boxes.high[:, axis], side="right")
        count = behind - np.arange(n) - 1
        if count.sum() <= MOST_TESTS:
            return boxes, count
        away = _away(boxes.low, boxes.high, camera)
        boxes = boxes.only(np.sort(np.argsort(away, kind="stable")[: n // 2]))


def _candidates(
    boxes: _Boxes, count: NDArray[np.int64], errors: Array, camera: model.Camera
) -> Iterator[NDArray[np.int64]]:
    """Pairs of boxes that overlap, of which one errs, the nearest to the camera first.

    For each pair of bodies MOST_INSTANCES, in all MOST_PAIRS.
    """
    ends, first = np.cumsum(count), 0
    best, near = np.zeros((0, 2), np.int64), np.zeros(0)
    while first < len(count):
        start = int(ends[first] - count[first])
        end = max(int(np.searchsorted(ends, start + BLOCK, side="right")), first + 1)
        one = np.repeat(np.arange(first, end), count[first:end])
        other = one + 1 + start + np.arange(len(one)) - (ends - count)[one]
        meet = (boxes.low[one] <= boxes.high[other]).all(axis=1)
        meet &= (boxes.low[other] <= boxes.high[one]).all(axis=1)
        meet &= (errors[boxes.body[one]] > 0) | (errors[boxes.body[other]] > 0)
        pairs = np.stack([one[meet], other[meet]], axis=1)
        low, high = boxes.low[pairs].max(axis=1), boxes.high[pairs].min(axis=1)
        best = np.concatenate([best, pairs])
        near = np.concatenate([near, _away(low, high, camera)])
        bodies = np.sort(boxes.body[best], axis=1)
        order = np.lexsort((near, bodies[:, 1], bodies[:, 0]))
        starts = (np.diff(bodies[order], axis=0, prepend=-1) != 0).any(axis=1)
        at = np.arange(len(order))
        rank = at - np.maximum.accumulate(np.where(starts, at, 0))
        kept = order[rank < MOST_INSTANCES]
        best, near, first = best[kept], near[kept], end
    yield from best[np.argsort(near, kind="stable")[:MOST_PAIRS]]


# ---- rays --------------------------------------------------------------------


def _touches(
    bodies: Sequence[Body], boxes: _Boxes, source: int, target: int, camera: model.Camera
) -> bool:
    """Do rays from the source's probes hit the target within both errors?"""
    a, b = bodies[boxes.body[source]], bodies[boxes.body[target]]
    at_a, at_b = boxes.instance[source], boxes.instance[target]
    from_a, to_a = a.matrices[at_a], a.inverses[at_a]
    from_b, to_b = b.matrices[at_b], b.inverses[at_b]
    probes = a.probes()
    some = slice(None, None, max(1, len(probes.surface) // N_PROBES))
    points = probes.surface[some] @ from_a[:3, :3].T + from_a[:3, 3]
    low, high = boxes.low[target], boxes.high[target]
    margin = NEAR_ERRORS * a.error * np.linalg.norm(from_a[:3, :3], axis=1)
    inside = np.flatnonzero(((points >= low - margin) & (points <= high + margin)).all(axis=1))
    if len(inside) < FEWEST * len(points):
        return False
    structure = a.structure(), b.structure()
    solid = [s.volume.info.kind == "solid" for s in structure]
    normals = unit(probes.surface_normals[some][inside] @ to_a[:3, :3])
    if structure[0].volume.mesh_info.inverted:
        normals = -normals
    if solid == [True, False]:
        seen = _faces(normals, points[inside], camera)
        inside, normals = inside[seen], normals[seen]
    fraction = len(inside) / len(points)
    if fraction < FEWEST:
        return False
    every = max(1, len(inside) // N_RAYS)
    points, normals = points[inside[::every]], normals[::every]
    off = a.error * np.linalg.norm(normals @ from_a[:3, :3], axis=1)
    off += b.error * np.linalg.norm(normals @ from_b[:3, :3], axis=1)
    origins = points @ to_b[:3, :3].T + to_b[:3, 3]
    along = (NEAR_ERRORS * off[:, None] * normals) @ to_b[:3, :3].T
    near = np.zeros(len(points), np.bool_)
    for direction in (along, -along):
        hits = leapray.trace(structure[1], origins, direction, t_max=1.0, count=False)
        met = np.isfinite(hits.t)
        theirs = unit(np.where(met[:, None], hits.normal, 1.0) @ to_b[:3, :3])
        met &= _parallel(normals, theirs, solid)
        if solid == [False, True] and fraction * met.mean() < MOSTLY:
            met &= _faces(theirs, points, camera)
        near |= met
    return fraction * near.mean() >= FEWEST


def _parallel(ours: Array, theirs: Array, solid: list[bool]) -> NDArray[np.bool_]:
    """Are surfaces with these outward normals parallel, and two solids not back to back?"""
    cosine = np.einsum("nc,nc->n", ours, theirs)
    return (cosine if all(solid) else np.abs(cosine)) > PARALLEL


def _faces(outward: Array, points: Array, camera: model.Camera) -> NDArray[np.bool_]:
    """Do the surfaces of a solid face the camera?"""
    towards = camera.eye - points if camera.projection == "perspective" else -camera.forward
    return (outward * towards).sum(axis=1) > 0
