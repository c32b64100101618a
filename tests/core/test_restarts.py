# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays that leave a surface where they hit it: none gets out of a solid, none hits where it is.

Walks go from wall to wall inside solids whose cells keep triangles, some hundred thousand
restarts; LEAPRAY_RESTARTS=100000000 makes as many as that.
"""

from __future__ import annotations

import os

import meshes
import numpy as np
import pytest

import leapray

RESTARTS = int(os.environ.get("LEAPRAY_RESTARTS", 600_000))
RAYS, BOUNCES = 20_000, 8
ON = 1e-4  # voxels: hits nearer than that are of the surface that the ray left
OFF = 1e-6  # a start that lies further from the mesh was a hit where the field stands for it
TRAVERSERS = ("cd", "aw", "hdda", "kdtree")


def blob(seed):
    """A ball with waves on it."""
    vertices, triangles = meshes.icosphere(3)
    rng = np.random.default_rng(seed)
    k, size, phase = 2 * rng.normal(size=(5, 3)), 0.12 * rng.normal(size=5), rng.uniform(0, 6, 5)
    return vertices * (1 + np.sin(vertices @ k.T + phase) @ size)[:, None], triangles


SHAPES = {
    "blob": blob,
    "box": lambda seed: meshes.box(),
    "spikes": lambda seed: meshes.spiky(seed, levels=1),
    "torus": lambda seed: meshes.torus(24, 12),
    "finer torus": lambda seed: meshes.torus(48, 24),
    "icosphere": lambda seed: meshes.icosphere(seed % 2 + 1),
}
# The first seeds are small, large, far away (on f32's and on f64's scale) and at the origin.
SCALES = (1.0, 1e-6, 1e6, 1e-3, 1e-5, 10.0, 1e3)


class Walk:
    """A solid and rays in it."""

    def __init__(self, name, seed):
        self.rng = np.random.default_rng([len(name), seed])
        vertices, self.triangles = SHAPES[name](seed)
        turn, _ = np.linalg.qr(self.rng.normal(size=(3, 3)))
        turn[:, 0] *= np.sign(np.linalg.det(turn))
        scale = SCALES[seed % len(SCALES)]
        far = seed % 3 == 2 and scale > 1e-6
        away = 1e4 * max(scale, 1) * self.rng.normal(size=3) * far
        self.vertices = (vertices @ turn.T if seed % 4 else vertices) * scale + away
        self.extent = np.ptp(self.vertices, axis=0).max()
        self.voxel = self.extent / self.rng.uniform(6, 40)
        self.volume = leapray.voxelize(
            self.vertices, self.triangles, self.voxel, kind="solid", threads=1,
            dtype=("u8", "u16", "f32")[seed % 3], exact=("all", "all", "sheets")[seed // 3 % 3],
        )  # fmt: skip
        self.structure = leapray.build(self.volume, TRAVERSERS[seed % len(TRAVERSERS)])
        size = tuple(n + 2 for n in self.volume.info.size)
        self.exact = self.volume.read_exact((-1, -1, -1), size)
        self.told = f"{name} {seed}, {self.volume.info.dtype}, {self.structure.traverser.name}"

    def first(self):
        middle = (self.vertices.min(0) + self.vertices.max(0)) / 2
        start = self.rng.normal(size=(RAYS, 3))
        start *= 2 * self.extent / np.linalg.norm(start, axis=1, keepdims=True)
        aim = self.rng.uniform(self.vertices.min(0), self.vertices.max(0), (RAYS, 3))
        return middle + start, aim - middle - start

    def directions(self, outward, side):
        """Unit, to one side, a third of them grazing the surface."""
        d = self.rng.normal(size=outward.shape)
        d /= np.linalg.norm(d, axis=1, keepdims=True)
        height = (d * outward).sum(1)
        d *= np.where(height * side > 0, -1, 1)[:, None]
        lowered = np.where(
            self.rng.random(len(d)) < 0.3, 10.0 ** self.rng.uniform(-4, 0, len(d)), 1
        )
        d -= ((d * outward).sum(1) * (1 - lowered))[:, None] * outward
        return d / np.linalg.norm(d, axis=1, keepdims=True)

    def off_mesh(self, points):
        return meshes.brute_distance(points, self.vertices, self.triangles)[0] / self.voxel

    def leads_off(self, points, d, side):
        """Does the ray go away from the triangle that it starts on, to its side?"""
        which = meshes.brute_distance(points, self.vertices, self.triangles)[1]
        a, b, c = (self.vertices[self.triangles[which, k]] for k in range(3))
        return (np.cross(b - a, c - a) * d).sum(1) * side < 0

    def second_root(self, points, d, normal):
        """Is there another triangle so near, or an edge? How near is known to a root's rounding:

        that of the start over the slope against what was hit.
        """
        ahead = points + 1e-7 * self.voxel * d
        slope = np.maximum(np.abs((normal * d).sum(1)), 1e-12)
        close = np.maximum(2 * ON, 4 * np.spacing(np.abs(points).max(1)) / self.voxel / slope)
        near = meshes.brute_rays(ahead, d, self.vertices, self.triangles)[0] / self.voxel < close
        a = self.vertices[self.triangles]
        for k in range(3):
            along = a[:, (k + 1) % 3] - a[:, k]
            for p, e in zip(a[:, k], along, strict=True):
                s = np.clip((points - p) @ e / (e @ e), 0, 1)
                gap = np.linalg.norm(points - p - s[:, None] * e, axis=1)
                near |= gap / self.voxel < close
        return near


def walk(name, seed, bounces=BOUNCES):
    """Restarts from cells with triangles; those that got out; those that hit where they were."""
    w = Walk(name, seed)
    o, d = w.first()
    hits = leapray.trace(w.structure, o, d, count=False)
    restarts, out, stuck = 0, [], []
    for bounce in range(bounces):
        hit = np.isfinite(hits.t)
        points, outward, cell = (
            (o + hits.t[:, None] * d)[hit],
            hits.field_normal[hit],
            hits.cell[hit],
        )
        if not len(points):
            break
        i, j, k = cell.T + 1
        exact = w.exact[k, j, i]
        restarts += 2 * int(exact.sum())
        for side in (-1, 1):
            d = w.directions(outward, side)
            hits = leapray.trace(
                w.structure, points, d, start=(cell, np.full(len(d), side)), count=False
            )
            short = np.flatnonzero((hits.t < ON * w.voxel) & exact)[:200]
            if len(short):
                normal = hits.field_normal[short]
                rest = ~w.second_root(points[short], d[short], normal)
                rest &= w.off_mesh(points[short]) < OFF
                rest &= w.leads_off(points[short], d[short], side)
                stuck += [f"{w.told}, bounce {bounce}, side {side}"] * int(rest.sum())
        lost = np.flatnonzero(~np.isfinite(hits.t) & exact)
        if len(lost):
            rest = w.off_mesh(points[lost]) < OFF
            rest |= meshes.winding(points[lost], w.vertices, w.triangles) > 0.5
            out += [f"{w.told}, bounce {bounce}"] * int(rest.sum())
        o = points
    return restarts, out, stuck


@pytest.mark.parametrize("name", SHAPES)
def test_no_ray_gets_out_of_a_solid_or_hits_where_it_is(name):
    restarts, seed = 0, 0
    while restarts < RESTARTS / len(SHAPES):
        done, out, stuck = walk(name, seed)
        restarts, seed = restarts + done, seed + 1
        assert not out, out
        assert not stuck, stuck


@pytest.mark.parametrize(
    "name, seed, bounces",
    [
        ("spikes", 32, 5),  # a start that rounding has put beyond both triangles of an edge
        ("spikes", 122, 2),  # beyond one, which it leaves so flatly that it passes by the next
        ("spikes", 38, 4),  # the field beside a triangle cell has the surface further on
        ("blob", 73, 2),  # a side that was handed on met the dip of a field that agrees behind it
        ("icosphere", 153, 4),  # a start beyond its cell, by two: the field between was met there
    ],
)
def test_rays_that_got_out_or_stuck_once_do_so_no_more(name, seed, bounces):
    restarts, out, stuck = walk(name, seed, bounces)
    assert restarts > 20_000
    assert not out, out
    assert not stuck, stuck
