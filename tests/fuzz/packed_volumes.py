# SPDX-License-Identifier: GPL-3.0-or-later
"""Packed volumes: any bytes are refused, or a volume that can be traced and that packs into bytes
which unpack and pack to the same again."""

from __future__ import annotations

import meshes
import numpy as np

import leapray
from fuzz import mutated

HEAD = 320  # bytes at whose place the numbers lie that all others follow from


def packed() -> list[bytes]:
    """Small ones of every kind; the largest arrays are those of triangle cells."""
    rng = np.random.default_rng(3)
    noise = rng.random((3, 4, 5)).astype(np.float32)
    box, flat = meshes.box((-0.4, -0.4, -0.4), (0.4, 0.4, 0.4)), meshes.plane(1, 0.3)
    colors = leapray.Attributes(
        normals=np.ones((12, 3, 3), np.float32),
        color_sources=np.full(12, leapray.VERTEX, np.int32),
        colors=np.ones((12, 3, 3), np.float32),
    )
    parts = [
        leapray.voxelize(box[0] + 0.3 * k, box[1], 0.4, ids=np.full(12, k), kind="solid", threads=1)
        for k in (0, 1)
    ]
    made = [
        leapray.Volume(np.zeros((2, 2, 2), np.uint8)),
        leapray.Volume((255 * noise).astype(np.uint8)),
        leapray.Volume((65535 * noise).astype(np.uint16), ids=rng.integers(0, 9, noise.shape)),
        leapray.Volume(noise, sheet=True, touched=noise < 0.5),
        leapray.Volume((255 * noise).astype(np.uint8), interpolation="cubic"),
        leapray.voxelize(*box, 0.4, exact="all", threads=1, dtype="u8"),
        leapray.voxelize(*flat, 0.5, exact="all", threads=1, dtype="u8", ids=np.arange(2)),
        leapray.voxelize(*box, 0.4, exact="all", threads=1, dtype="u8", attributes=colors),
        leapray.merge(parts),
    ]
    return [volume.pack().tobytes() for volume in made]


PACKED = packed()


def check(rng: np.random.Generator) -> None:
    n = len(PACKED) - (rng.random() < 0.95)  # the merged one is large
    data, other = PACKED[rng.integers(n)], PACKED[rng.integers(n)]
    volume = leapray.Volume.unpack(mutated(rng, data, HEAD, other))
    again = volume.pack().tobytes()
    assert leapray.Volume.unpack(again).pack().tobytes() == again, "it packs to other bytes"
    use(rng, volume)


def use(rng: np.random.Generator, volume: leapray.Volume) -> None:
    """Let rays and points lead through all its tables."""
    corner = np.abs(np.nan_to_num(volume.info.object_from_index[:3])).max() + 1.0
    points = rng.uniform(-1, 1, (8, 3)) * min(corner, 1e6) * 3
    volume.sample(points)
    volume.attributes(points)
    names = leapray.traversers()
    entry = names[rng.integers(len(names))]
    if entry.rectilinear or volume.info.planes is None:
        hits = leapray.trace(leapray.build(volume, entry), points, points[::-1] - points, threads=1)
        assert not np.isnan(hits.t).any(), "a hit at NaN"
        assert np.isfinite(hits.normal).all(), "a normal that is not finite"
