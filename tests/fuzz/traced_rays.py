# SPDX-License-Identifier: GPL-3.0-or-later
"""Volumes and rays: by every exact traverser, every hit lies where f = T; by the others, it is at
least a number with a unit normal."""

from __future__ import annotations

from functools import cache

import numpy as np

import leapray

RAYS = 32
# Newton ends where t moves by rounding alone; f then differs from T by what 2^-40 of the ray's
# length in voxels changes, as f changes by at most 1 per voxel along an axis.
ROUNDING = 2.0**-40


@cache
def variants() -> list[leapray.Traverser]:
    return leapray.variants()


def samples(rng: np.random.Generator) -> np.ndarray:
    shape = rng.integers(1, 8, 3)
    kind = rng.integers(4)
    if kind == 0:
        made = rng.random(shape)
    elif kind == 1:
        made = rng.integers(0, 3, shape) / 2  # plateaus and ties with T
    elif kind == 2:
        made = (rng.random(shape) < 0.2) * rng.random(shape)
    else:
        far = [np.abs(np.arange(n) - rng.uniform(0, n)) for n in shape]
        far2 = far[0][:, None, None] ** 2 + far[1][:, None] ** 2 + far[2] ** 2
        made = np.clip(0.5 + (rng.uniform(0.5, 3) - np.sqrt(far2)) / 2, 0, 1)
    dtype = (np.uint8, np.uint16, np.float32)[rng.integers(3)]
    one = 1 if dtype is np.float32 else np.iinfo(dtype).max
    return (made * one).astype(dtype)


def rays(rng: np.random.Generator, shape) -> tuple[np.ndarray, np.ndarray]:
    """From outside and inside, some along axes, through lattice points, in planes of samples."""
    nz, ny, nx = shape
    size = np.array([nx, ny, nz])
    origins = rng.uniform(-3, 3, (RAYS, 3)) + size / 2
    aims = rng.uniform(-1, 1, (RAYS, 3)) + size / 2
    on_lattice = rng.random((RAYS, 3)) < 0.2
    origins[on_lattice] = np.round(origins[on_lattice])
    aims[rng.random((RAYS, 3)) < 0.1] = 1.0
    directions = (aims - origins) * 10.0 ** rng.integers(-3, 4)
    directions[rng.random((RAYS, 3)) < 0.1] = 0.0
    return origins, directions


def check(rng: np.random.Generator) -> None:
    given = samples(rng)
    threshold = (0.5, float(rng.uniform(0.01, 1)))[rng.integers(2)]
    place = np.eye(4)
    if rng.random() < 0.5:
        place[:3, :3] += rng.uniform(-0.3, 0.3, (3, 3))
        place[:3, 3] = rng.uniform(-3, 3, 3)
    planes = None
    if rng.random() < 0.2:
        planes = [np.cumsum(rng.uniform(0.5, 2, n)) for n in given.shape[::-1]]
    cubic = planes is None and rng.random() < 0.4
    volume = leapray.Volume(
        given,
        threshold,
        object_from_index=place,
        planes=planes,
        interpolation="cubic" if cubic else "linear",
    )
    entries = [entry for entry in variants() if planes is None or entry.rectilinear]
    entry = entries[rng.integers(len(entries))]
    structure = leapray.build(volume, entry, threads=1)
    origins, directions = rays(rng, given.shape)
    origins, directions = origins @ place[:3, :3].T + place[:3, 3], directions @ place[:3, :3].T
    root = ("newton", "bisect", "cubic")[rng.integers(3 - cubic)]
    normal = list(leapray.NORMALS)[rng.integers(len(leapray.NORMALS))]
    hits = leapray.trace(structure, origins, directions, root=root, normal=normal, threads=1)
    assert not np.isnan(hits.t).any(), "a hit at NaN"
    hit = np.isfinite(hits.t)
    length = np.linalg.norm(hits.normal[hit], axis=1)
    assert (np.abs(length - 1) < 1e-6).all(), "a normal that is not unit"
    points = origins[hit] + hits.t[hit, None] * directions[hit]
    value, _ = volume.sample(points)
    off = np.abs(value - volume.info.threshold).max(initial=0.0)
    assert off < ROUNDING or not entry.exact, f"f - T is {off:.3g}"
