# SPDX-License-Identifier: GPL-3.0-or-later
"""Light of samples close together that one lamp lights, without anything of the core's (no bpy)."""

from __future__ import annotations

from typing import cast

import numpy as np
from numpy.typing import NDArray

import leapray

from .light_integrals import Ramp

AT_ONCE = 64  # samples of a ray


def trilinear(samples, q):
    """At q (..., 3), index coordinates, x first; clamped to the lattice."""
    size = np.array(samples.shape[::-1])
    q = np.clip(q, 0, size - 1)
    c = np.minimum(q.astype(np.intp), size - 2)
    p = q - c
    flat, at = samples.reshape(-1), (c[..., 2] * size[1] + c[..., 1]) * size[0] + c[..., 0]
    f = [flat[at + x + size[0] * (y + size[1] * z)].astype(np.float64)
         for z in (0, 1) for y in (0, 1) for x in (0, 1)]  # fmt: skip
    for a in range(3):
        f = [low + p[..., a] * (high - low) for low, high in zip(f[::2], f[1::2], strict=True)]
    return f[0]


def shares(g, view, phong: leapray.Phong):
    """Of diffuse light and of the highlight, by gradients g and towards the viewer (..., 3)."""
    to = np.asarray(phong.light, float)
    to = to / np.linalg.norm(to)
    size = np.linalg.norm(g, axis=-1, keepdims=True)
    n = np.divide(g, size, out=np.zeros_like(g), where=size > 0)
    n *= np.where((n * view).sum(-1, keepdims=True) < 0, -1, 1)
    along = n @ to
    mirrored = ((2 * along[..., None] * n - to) * view).sum(-1)
    shine = np.where(along > 0, np.maximum(mirrored, 0) ** phong.power, 0)
    return phong.ambient + phong.diffuse * np.maximum(along, 0), phong.specular * shine


def light(
    grid: leapray.ScalarGrid, origins, directions, ramp: Ramp, phong: leapray.Phong, apart: float
) -> NDArray[np.float64]:
    """(n, 4) colour and transmittance of rays through the grid, without end.

    Samples lie in the middles of steps of `apart` voxels. The normal is the gradient of central
    differences, linear between samples, which is the difference of values a voxel to either side.
    """
    matrix = np.asarray(grid.world_from_index, float)
    inverse = np.linalg.inv(matrix)
    samples = np.asarray(cast(NDArray, grid.samples)[:])
    o = origins @ inverse[:3, :3].T + inverse[:3, 3]
    d = directions @ inverse[:3, :3].T
    speed = np.linalg.norm(d, axis=1, keepdims=True)
    length = apart * (np.linalg.norm(directions, axis=1) / speed[:, 0])
    view = -directions / np.linalg.norm(directions, axis=1, keepdims=True)
    with np.errstate(divide="ignore"):
        ends = np.sort([-o / d, (np.array(samples.shape[::-1]) - 1 - o) / d], axis=0)
    near, far = np.maximum(ends[0].max(1), 0), ends[1].min(1)
    color, left = np.zeros((len(o), 3)), np.ones(len(o))
    most = int(np.ceil(((far - near) * speed[:, 0]).max() / apart))
    for first in range(0, most, AT_ONCE):
        t = near[:, None] + (first + np.arange(AT_ONCE) + 0.5) * apart / speed
        q = o[:, None] + t[..., None] * d[:, None]
        value = grid.offset + grid.scale * trilinear(samples, q)
        seen = ramp.at(ramp.piece(value), value).astype(np.float64)
        opacity = -np.expm1(-length[:, None] * np.where(t < far[:, None], seen[..., 0], 0))
        own = seen[..., 1:4] * opacity[..., None]
        ray, k = np.nonzero(opacity * left[:, None] > 0)
        beside = [[trilinear(samples, q[ray, k] + side * np.eye(3)[a]) for side in (-1, 1)]
                  for a in range(3)]  # fmt: skip
        g = np.stack([high - low for low, high in beside], -1) @ inverse[:3, :3]
        diffuse, shine = shares(g, view[ray], phong)
        own[ray, k] = opacity[ray, k, None] * (seen[ray, k, 1:4] * diffuse[:, None]
                                               + shine[:, None])  # fmt: skip
        for sample in range(AT_ONCE):
            color += left[:, None] * own[:, sample]
            left *= 1 - opacity[:, sample]
    return np.column_stack([color, left])
