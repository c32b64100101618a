# SPDX-License-Identifier: GPL-3.0-or-later
"""Cameras around volumes, and images of first object cells traced ray by ray."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import leapray
from addon.study import phantom

CELLWISE = "aw"  # crosses one plane at a time: planes that are crossed together have an order


def bounds(volume):
    """Middle and extent of the lattice with the layer around it, in object space."""
    info = volume.info
    size = np.array(info.size)
    corners = np.stack(np.meshgrid(*[(-1.0, n) for n in size], indexing="ij"), axis=-1)
    matrix = info.object_from_index
    corners = corners.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]
    return corners.mean(axis=0), np.linalg.norm(np.ptp(corners, axis=0))


def parallel(rng, volume, pixels, turn=True, askew=True):
    """An orthographic camera around a volume, from anywhere; its film may be askew."""
    middle, extent = bounds(volume)
    forward = rng.normal(size=3) if turn else np.eye(3)[rng.integers(3)] * rng.choice([-1, 1])
    right, up = phantom.frame(forward / np.linalg.norm(forward) + 1e-9)
    step = extent * 1.05 / pixels
    dx, dy = step * right, step * (up + 0.3 * right * (askew and rng.integers(2)))
    corner = -pixels / 2 * (dx + dy)
    eye = middle - 2 * extent * forward / np.linalg.norm(forward)
    return leapray.Camera("orthographic", eye, forward, corner, dx, dy)


def perspective(rng, volume, pixels, inside=False, far=1.0):
    """A perspective camera that looks at a volume from around it, or from inside anywhere."""
    middle, extent = bounds(volume)
    forward = rng.normal(size=3)
    forward /= np.linalg.norm(forward)
    right, up = phantom.frame(forward)
    eye = middle - far * extent * forward
    if inside:
        eye = middle + 0.3 * extent * rng.uniform(-1, 1, 3)
    step = (1.5 if inside else 0.8 / far) / pixels
    dx, dy = step * right, step * up
    return leapray.Camera("perspective", eye, forward, forward - pixels / 2 * (dx + dy), dx, dy)


def on_lattice(rng, volume, pixels, kind="orthographic"):
    """A camera whose rays go through corners and edges of cells: all planes are crossed together.

    Of a volume in index space.
    """
    size = volume.info.size[0]
    forward = rng.choice([-1.0, 0.0, 1.0, 0.5], 3)
    forward = forward if forward.any() else np.eye(3)[rng.integers(3)]
    axis = int(np.abs(forward).argmax())
    dx, dy = np.delete(np.eye(3), axis, axis=0) * (0.5 if kind == "orthographic" else 1 / 16)
    eye = np.full(3, float(size // 2)) - 2.0 * size * forward
    corner = -(pixels // 2 + 0.5) * (dx + dy)
    if kind == "perspective":
        corner = corner + forward
    return leapray.Camera(kind, eye, forward, corner, dx, dy)


def clipped(camera, start, end):
    return replace(camera, clip_start=start, clip_end=end)


def traced(volume, camera, width, height, spec=CELLWISE):
    """The same image by a traverser, ray by ray; hits are flat."""
    return leapray.trace(
        leapray.build(volume, spec),
        *leapray.camera_rays(camera, width, height),
        t_min=camera.clip_start,
        t_max=camera.clip_end,
        mode="binary",
    )


def wrong(found, want):
    """Pixels that are not, to the bit, what a traced image has in them."""
    at_fault = found.hit.ravel() != np.isfinite(want.t)
    at_fault |= found.t.ravel() != want.t
    at_fault |= (found.cell.reshape(-1, 3) != want.cell).any(axis=1)
    return int(at_fault.sum())
