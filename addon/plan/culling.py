# SPDX-License-Identifier: GPL-3.0-or-later
"""Which instances a ray may meet: the others are not modelled (no bpy).

Decided conservatively by boxes: an instance is left out if it is outside the camera's
view and not between a visible one and a light. Where light arrives from all directions,
none is left out.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .. import model
from . import objects

FILTER = 8.0  # pixels beyond the image's edges that its pixels may see
SEVERAL = 512  # if more are visible, their boxes are joined
SLACK = 1e-9  # of the scene's extent
STRAIGHT_FLAGS = "visible_camera", "visible_shadow", "visible_diffuse"
SCATTERED_FLAGS = "visible_glossy", "visible_transmission", "visible_volume_scatter"
WIDE = math.radians(160)  # from this angle on, a sun's light counts as coming from everywhere
STRAIGHT = ("diffuse", "transparent", "emission")  # lobes that only diffuse bounces take elsewhere


def reached(scene: model.Scene, instances: Sequence[model.Placed]) -> NDArray[np.bool_]:
    """For each instance (n,) whether a ray of the camera, or of light from there, may meet it."""
    used = {material for instance in instances for material in instance.materials}
    kinds = {lobe.kind for material in used for lobe in scene.materials[material].lobes}
    scatters = not kinds <= set(STRAIGHT) or any(f.look is not None for f in scene.fields)
    scatters |= any(any(scene.materials[material].scattering) for material in used)
    spreads = scene.settings.diffuse_bounces > 0 or "Ambient Occlusion" in scene.passes
    names = (*STRAIGHT_FLAGS, *SCATTERED_FLAGS) if scatters else STRAIGHT_FLAGS
    flags = np.array([[getattr(i, name) for name in names] for i in instances], bool)
    flags = flags.reshape(len(instances), len(names))
    if scatters or spreads or (any(scene.world.color) and scene.world.visible_diffuse):
        return flags.any(axis=1)
    seen, stops_light = flags.T[:2]
    corners = box_corners(scene, instances)
    seen = seen & in_view(scene, corners)
    lit = _boxes(corners[seen])
    found = seen.copy()
    for light in scene.lights:
        if light.casts_shadow and len(lit):
            found |= stops_light & _between(corners, lit, light)
    return found


def in_view(scene: model.Scene, corners: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether boxes, corners (n, 8, 3) in world space, may lie in the camera's view: (n,)."""
    camera = scene.camera
    origin = camera.corner - FILTER * (camera.dx + camera.dy)
    across = camera.dx * (scene.width + 2 * FILTER)
    up = camera.dy * (scene.height + 2 * FILTER)
    offset = corners - camera.eye
    depth = offset @ camera.forward
    slack = SLACK * max(np.abs(offset).max(initial=0.0), np.abs(corners).max(initial=0.0))
    outside = (depth < camera.clip_start - slack).all(axis=1)
    outside |= (depth > camera.clip_end + slack).all(axis=1)
    for normal, at in _sides(camera.projection, camera.forward, origin, across, up):
        outside |= ((offset - at) @ normal < -slack).all(axis=1)
    return ~outside


def _sides(projection, forward, origin, across, up):
    """(inward unit normal, point) of the four sides of the view, as seen from the eye."""
    middle = origin + (across + up) / 2
    for edge, along in (
        (origin, up),
        (origin + across, up),
        (origin, across),
        (origin + up, across),
    ):
        normal = np.cross(along, edge if projection == "perspective" else forward)
        at = np.zeros(3) if projection == "perspective" else edge
        normal = normal / np.linalg.norm(normal)
        yield (normal if (middle - edge) @ normal > 0 else -normal), at


def box_corners(scene: model.Scene, instances: Sequence[model.Placed]) -> NDArray[np.float64]:
    """(n, 8, 3): the boxes of what the instances place, in world space."""
    boxes: dict[tuple, NDArray] = {}
    for instance in instances:
        if _content(instance) not in boxes:
            boxes[_content(instance)] = objects.corners(scene, instance)
    if not instances:
        return np.zeros((0, 8, 3))
    matrices = np.array([i.world_from_object for i in instances], np.float64)
    local = np.array([boxes[_content(i)] for i in instances])
    return local @ matrices[:, :3, :3].transpose(0, 2, 1) + matrices[:, None, :3, 3]


def _content(instance: model.Placed) -> tuple:
    """Tells which instances place the same."""
    return type(instance), getattr(instance, "mesh", None), getattr(instance, "field", None)


def _boxes(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 2, 3): axis-aligned boxes of the corners (n, 8, 3); at most SEVERAL, then joint ones."""
    boxes = np.stack([corners.min(axis=1), corners.max(axis=1)], axis=1)
    if len(boxes) <= SEVERAL:
        return boxes
    boxes = boxes[np.lexsort(boxes.mean(axis=1).T)]
    return np.array(
        [(b[:, 0].min(axis=0), b[:, 1].max(axis=0)) for b in np.array_split(boxes, SEVERAL)]
    )


def _between(
    corners: NDArray[np.float64], lit: NDArray[np.float64], light: model.Light
) -> NDArray[np.bool_]:
    """Whether boxes, corners (n, 8, 3), may lie between one of lit (m, 2, 3) and a light: (n,)."""
    if light.kind == "sun" and light.angle > WIDE:
        return np.ones(len(corners), bool)
    if light.kind == "sun":  # along x towards the sun, unbounded
        axes = np.linalg.qr(np.column_stack([light.direction, np.eye(3)]))[0].T
        axes[0] = light.direction
        ends = _boxes_in(_spanned(lit), axes)
        ends[:, 1, 0] = np.inf
        opening = math.tan(light.angle / 2)
    else:
        axes = np.eye(3)
        sides = np.abs(light.axis_u) + np.abs(light.axis_v)
        extent = light.radius + sides / 2
        near, far = light.position - extent, light.position + extent
        ends = np.stack([np.minimum(lit[:, 0], near), np.maximum(lit[:, 1], far)], axis=1)
        opening = 0.0
    own = _boxes_in(corners, axes)
    slack = SLACK * np.abs(own).max(initial=0.0)
    met = np.zeros(len(own), bool)
    for lo, hi in ends:
        wide = slack + opening * np.maximum(own[:, 1, 0] - lo[0], 0.0)[:, None]
        met |= ((own[:, 1] >= lo - wide) & (own[:, 0] <= hi + wide)).all(axis=1)
    return met


def _spanned(boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 8, 3): the corners of axis-aligned boxes (n, 2, 3)."""
    picks = np.array(list(itertools.product((0, 1), repeat=3)))
    return np.stack([boxes[:, picks[:, a], a] for a in range(3)], axis=-1)


def _boxes_in(corners: NDArray[np.float64], axes: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 2, 3): the boxes of corners (n, 8, 3) along the given unit axes (3, 3)."""
    along = corners @ axes.T
    return np.stack([along.min(axis=1), along.max(axis=1)], axis=1)
