# SPDX-License-Identifier: GPL-3.0-or-later
"""Scenes trace instances in boxes of their surfaces: no hit is lost beside the cells' own box."""

from __future__ import annotations

import meshes
import numpy as np
import pytest
from stage import FAR, IDENTITY, camera, centre_rays, one, render

import leapray

SIZE = 48, 48


def noise(rng):
    """Samples of either side next to each other."""
    return leapray.Volume(rng.random(rng.integers(2, 7, 3)).astype(np.float32))


def quantized(rng):
    return leapray.Volume((255 * rng.random(rng.integers(2, 7, 3))).astype(np.uint8))


def points(rng):
    """Single samples just above the threshold, whose surface keeps far from its cells' faces."""
    samples = np.zeros((9, 9, 9), np.float32)
    samples[tuple(rng.integers(9, size=(3, 2)))] = 0.5 + 0.3 * rng.random(2)
    return leapray.Volume(samples)


def at_threshold(rng):
    """Samples that are the threshold itself, on which the surface lies."""
    return leapray.Volume(rng.choice(np.float32([0, 0.5, 1]), rng.integers(2, 6, 3)))


def cubic(rng):
    samples = rng.random(rng.integers(2, 7, 3)).astype(np.float32)
    return leapray.Volume(samples, interpolation="cubic")


def turned(rng, mesh):
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    return mesh[0] @ turn.T + rng.normal(size=3), mesh[1]


def solid(exact):
    def make(rng):
        size = rng.uniform(0.05, 0.5, 3)
        return leapray.voxelize(*turned(rng, meshes.box(-size, size)), 0.1, exact=exact)

    return make


def sheet(exact):
    def make(rng):
        vertices = rng.uniform(-0.6, 0.6, (6, 3))
        return leapray.voxelize(
            vertices, np.array([(0, 1, 2), (3, 4, 5)], np.int32), 0.1, kind="sheet", exact=exact
        )

    return make


MAKERS = {
    "noise": noise,
    "quantized": quantized,
    "single points": points,
    "at the threshold": at_threshold,
    "cubic": cubic,
    "solid": solid("none"),
    "solid with triangles at creases": solid("all"),
    "solid of triangles": solid("every"),
    "sheet": sheet("none"),
    "sheet with triangles at borders": sheet("sheets"),
    "sheet of triangles": sheet("every"),
}


def rims(volume):
    """Cameras along the axes, on the outermost layer of cells of each side, corners apart."""
    info = volume.info
    lo, hi = np.array(info.surface_lo, float), np.array(info.surface_hi, float) + 1
    matrix = np.array(volume.info.object_from_index)
    for axis in range(3):
        for across in (a for a in range(3) if a != axis):
            for side in (lo, hi):
                inner = side[axis] + (0.5 if side is lo else -0.5)
                eye, target = (lo + hi) / 2, (lo + hi) / 2
                eye[axis] = target[axis] = inner
                eye[across] = lo[across] - 3
                target[across] = hi[across] + 3
                yield (
                    matrix[:3, :3] @ eye + matrix[:3, 3],
                    matrix[:3, :3] @ target + matrix[:3, 3],
                    (hi - lo).max() + 2,
                )


@pytest.mark.parametrize("kind", MAKERS)
def test_scenes_find_the_hits_of_volumes_by_themselves_at_every_rim(kind):
    rng = np.random.default_rng(11)
    met = 0
    for _ in range(12):
        volume = MAKERS[kind](rng)
        if volume.info.n_surface_cells == 0:
            continue
        structure = leapray.build(volume)
        for eye, target, width in rims(volume):
            unit = np.linalg.norm(np.array(volume.info.object_from_index)[:3, 0])
            for zoom in (width, 1.2):  # all of the rim, and its cell in the middle
                cam = camera(eye, target, SIZE, zoom * unit, kind="orthographic")
                o, d = centre_rays(cam, SIZE)
                alone = leapray.trace(structure, o.reshape(-1, 3), d.reshape(-1, 3)).t
                depth = render(cam, [one(structure, IDENTITY)], size=SIZE)["Depth"].reshape(-1)
                seen = np.isfinite(alone)
                met += seen.sum()
                np.testing.assert_array_equal(depth < np.float32(FAR), seen)
    assert met > 2000
