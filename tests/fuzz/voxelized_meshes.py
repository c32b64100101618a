# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes: any triangles are refused, or a volume of finite samples in 0..1 that can be traced."""

from __future__ import annotations

import numpy as np

import leapray

HOSTILE = (0.0, -0.0, 1e-30, 1e-7, 1e7, 1e30, 1e300, 5e-324, np.nan, np.inf, -np.inf)
ROOM = 3_000_000  # bytes of a volume


def mesh(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Few triangles between few vertices: they share edges, fold, cross and vanish often."""
    n = int(rng.integers(3, 9))
    kind = rng.integers(4)
    if kind == 0:
        vertices = rng.normal(size=(n, 3))
    elif kind == 1:
        vertices = rng.integers(-1, 2, (n, 3)).astype(float)  # many in one place, on one plane
    elif kind == 2:
        vertices = rng.normal(size=(n, 3)) * 10.0 ** rng.integers(-5, 2, 3)
    else:
        vertices = rng.normal(size=(n, 3))
        vertices[rng.integers(n), rng.integers(3)] = HOSTILE[rng.integers(len(HOSTILE))]
    triangles = rng.integers(0, n, (int(rng.integers(1, 13)), 3))
    if rng.random() < 0.3:  # a closed one, maybe turned inside out in places
        triangles = np.array([[0, 1, 2], [0, 2, 1], [0, 1, 2]])[: rng.integers(2, 4)]
    if n > 3 and rng.random() < 0.3:
        triangles = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    if rng.random() < 0.02:
        triangles[0, 0] = (-1, n, 2**31 - 1)[rng.integers(3)]
    return vertices, triangles


def check(rng: np.random.Generator) -> None:
    vertices, triangles = mesh(rng)
    finite = vertices[np.isfinite(vertices)]
    size = float(np.ptp(finite)) / rng.uniform(1, 7) or 1.0
    more: dict = {}
    for name, names in (
        ("filter", ("ramp", "box", "cone", "gauss", "binary")),
        ("kind", ("auto", "solid", "sheet")),
        ("dtype", ("u8", "u16", "f32")),
        ("exact", ("all", "sheets", "none")),
    ):
        if rng.random() < 0.7:
            more[name] = names[rng.integers(len(names))]
    if rng.random() < 0.3:
        more["ids"] = rng.integers(0, 3, len(triangles))
    volume = leapray.voxelize(vertices, triangles, size, max_nbytes=ROOM, threads=1, **more)
    samples = volume.read()
    one = 1.0 if samples.dtype == np.float32 else np.iinfo(samples.dtype).max
    assert np.isfinite(samples).all(), "a sample that is not finite"
    assert samples.min() >= 0 and samples.max() <= one, "a sample outside 0..1"
    trace(rng, volume)


def trace(rng: np.random.Generator, volume: leapray.Volume) -> None:
    shape = np.array(volume.info.size)
    starts, ends = rng.uniform(-1, 2, (2, 8, 3)) * shape
    place = volume.info.object_from_index
    origins = starts @ place[:3, :3].T + place[:3, 3]
    directions = (ends - starts) @ place[:3, :3].T
    hits = leapray.trace(leapray.build(volume), origins, directions, threads=1)
    assert not np.isnan(hits.t).any(), "a hit at NaN"
    length = np.linalg.norm(hits.normal[np.isfinite(hits.t)], axis=1)
    assert (np.abs(length - 1) < 1e-6).all(), "a normal that is not unit"
