# SPDX-License-Identifier: GPL-3.0-or-later
"""Claims about triangle cells: borders, junctions, close pairs, creases are hit where they are."""

from __future__ import annotations

import meshes
import numpy as np
import pytest
from meshes import brute_rays, joined
from numpy.testing import assert_allclose, assert_array_equal

import leapray
from leapray.voxelization import voxelize

H = 0.06
GAPS = (0.3, 0.5, 0.8, 1.0, 1.4, 2.0)
EXACT = [t.name for t in leapray.traversers() if t.exact]


def quad(a, b, c, d):
    return np.array([a, b, c, d], float), np.array([[0, 1, 2], [0, 2, 3]], np.int32)


def flipped(mesh, seed=0):
    """The same surface, half of its triangles wound the other way."""
    vertices, triangles = mesh
    turn = np.random.default_rng(seed).random(len(triangles)) < 0.5
    return vertices, np.where(turn[:, None], triangles[:, ::-1], triangles)


def moebius(n=60, m=6):
    u, w = np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(-0.3, 0.3, m + 1), indexing="ij")
    a = 2 * np.pi * u
    ring = 1 + w * np.cos(a / 2)
    vertices = np.stack([ring * np.cos(a), ring * np.sin(a), w * np.sin(a / 2)], -1).reshape(-1, 3)
    i, j = (x.ravel() for x in np.meshgrid(np.arange(n), np.arange(m), indexing="ij"))
    q = i * (m + 1) + j
    quads = np.stack([q, q + m + 1, q + m + 2], 1), np.stack([q, q + m + 2, q + 1], 1)
    return vertices, np.concatenate(quads).astype(np.int32)


def pair(gap):
    vertices, triangles = meshes.plane(6, 0.3)
    return joined((vertices, triangles), (vertices + np.array([0, 0, gap * H]), triangles))


FLOOR = quad((-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0))
TENT = joined(
    quad((-1, -1, 0), (0, -1, 0.7), (0, 1, 0.7), (-1, 1, 0)),
    quad((0, -1, 0.7), (1, -1, 0), (1, 1, 0), (0, 1, 0.7)),
)
FLAT = {  # planes and what the samples cannot hold: exact everywhere but for the samples' rounding
    "plane": meshes.plane(8, 0.3),
    "aligned": meshes.plane(4),
    "junction": joined(FLOOR, quad((0, -1, 0), (0, 1, 0), (0, 1, 1), (0, -1, 1))),
    "tent": TENT,
    **{f"gap {gap}": pair(gap) for gap in GAPS},
    "flipped pair": flipped(pair(0.8)),
    "triangle": (np.array([[0, 0, 0], [0.02, 0, 0.003], [0, 0.015, 0.01]]), np.array([[0, 1, 2]])),
    "slab": meshes.box((-0.5, -0.4, -0.01), (0.5, 0.45, 0.0)),
    "box": meshes.box((-0.5, -0.4, -0.3), (0.5, 0.45, 0.33)),
}
CURVED = {
    "half sphere": meshes.half_sphere(),
    "leaf": meshes.leaf(),
    "moebius": moebius(),
    "flipped": flipped(meshes.half_sphere()),
    "spiky": meshes.spiky(1),
    "torus": meshes.torus(20, 10),
}


def aimed(vertices, triangles, n, seed=0, spread=0.05):
    """Rays from all around at points of the surface and beside it."""
    rng = np.random.default_rng(seed)
    size = np.ptp(vertices, axis=0).max()
    centre = (vertices.max(axis=0) + vertices.min(axis=0)) / 2
    corners = vertices[triangles]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(area, axis=1)
    corners = corners[rng.choice(len(triangles), n, p=area / area.sum())]
    target = np.einsum("nk,nkc->nc", rng.dirichlet([1, 1, 1], n), corners)
    target += spread * size * rng.normal(size=(n, 3)) * (rng.random((n, 1)) < 0.5)
    away = rng.normal(size=(n, 3))
    origin = centre + 2 * size * away / np.linalg.norm(away, axis=1, keepdims=True)
    direction = target - origin
    return origin, direction / np.linalg.norm(direction, axis=1, keepdims=True)


def tilt(directions, vertices, triangles, which):
    """|cosine| between directions (n, 3) and the normals of triangles which (n,)."""
    a, b, c = np.moveaxis(vertices[triangles[which]], 1, 0)
    normal = np.cross(b - a, c - a)
    return np.abs(np.einsum("ij,ij->i", directions, normal)) / np.linalg.norm(normal, axis=1)


@pytest.mark.parametrize("name", FLAT)
def test_flat_things_are_hit_where_they_are(name):
    """Rims, junctions, pairs at any gap: hit or miss as by the triangles themselves."""
    vertices, triangles = FLAT[name]
    volume = voxelize(vertices, triangles, H, dtype="f32", exact="all")
    origin, direction = aimed(vertices, triangles, 10_000)
    want, which = brute_rays(origin, direction, vertices, triangles)
    got = leapray.trace(leapray.build(volume), origin, direction)
    assert 0.3 < np.isfinite(want).mean() < 0.95
    assert_array_equal(np.isfinite(got.t), np.isfinite(want))
    hit = which >= 0
    off = np.abs(got.t[hit] - want[hit]) * tilt(direction, vertices, triangles, which)[hit]
    assert np.quantile(off, 0.99) < 2e-6 * H  # f32 keeps the ramp of five voxels to 3e-7 of one
    assert off.max() < 0.06 * H  # the field may be off by a twentieth before a cell is exact


@pytest.mark.parametrize("name", CURVED)
def test_curved_things_are_hit_where_they_are(name):
    vertices, triangles = CURVED[name]
    volume = voxelize(vertices, triangles, H, exact="all")
    origin, direction = aimed(vertices, triangles, 10_000)
    want, which = brute_rays(origin, direction, vertices, triangles)
    got = leapray.trace(leapray.build(volume), origin, direction)
    both = np.isfinite(got.t) & np.isfinite(want)
    assert both.mean() > 0.3
    lost = np.isfinite(want) & ~np.isfinite(got.t)
    assert (tilt(direction, vertices, triangles, which)[lost] < 0.15).all()  # at the outline:
    assert lost.mean() < 0.03  # a twentieth of a voxel of the field
    assert (np.isfinite(got.t) & ~np.isfinite(want)).mean() < 0.001
    off = np.abs(got.t[both] - want[both]) * tilt(direction, vertices, triangles, which)[both]
    assert np.quantile(off, 0.99) < 0.05 * H


def inner_edges(triangles):
    """Edges (n, 2) of two triangles, the two (n, 2), and whether an edge's start is inside (n,)."""
    ends = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], 2).reshape(-1, 2), axis=1)
    edges, which, count = np.unique(ends, axis=0, return_inverse=True, return_counts=True)
    order = np.argsort(which, kind="stable")
    first = np.searchsorted(which[order], np.arange(len(edges)))
    two = count == 2
    owners = np.stack([order[first[two]], order[first[two] + 1]], 1) // 3
    return edges[two], owners, ~np.isin(edges[two, 0], edges[~two])


@pytest.mark.parametrize("name", ["moebius", "half sphere", "torus", "tent", "flipped"])
def test_no_ray_slips_between_triangles_or_cells(name):
    """A million rays in all, through edges and corners of triangles, from near and far."""
    vertices, triangles = (CURVED | FLAT)[name]
    volume = voxelize(vertices, triangles, H, exact="all")
    assert 0.1 < volume.info.n_triangle_cells / volume.info.n_surface_cells < 1
    rng = np.random.default_rng(3)
    n = 200_000
    edges, owners, inside = inner_edges(triangles)
    some = rng.integers(len(edges), size=n)
    fraction = rng.uniform(1e-9, 1, (n, 1)) * ((rng.random(n) < 0.9) | ~inside[some])[:, None]
    ends = vertices[edges[some]]
    target = ends[:, 0] * (1 - fraction) + ends[:, 1] * fraction
    away = rng.normal(size=(n, 3))
    away *= rng.choice([0.1, 1, 100], (n, 1)) / np.linalg.norm(away, axis=1, keepdims=True)
    length = np.linalg.norm(away, axis=1)
    got = leapray.trace(leapray.build(volume), target + away, -away)
    # not at an outline: the triangles lie on different sides of the ray, none is seen edge-on
    across = np.cross(ends[:, 1] - ends[:, 0], away)
    middle = vertices[triangles[owners[some]]].mean(axis=2) - target[:, None]
    sides = np.sign(np.einsum("nkc,nc->nk", middle, across))
    cosine = np.min([tilt(away, vertices, triangles, owners[some, k]) for k in (0, 1)], axis=0)
    least = np.where(fraction[:, 0] > 0, 0.3, 0.7)  # at corners for the other triangles' sake
    clear = (sides[:, 0] != sides[:, 1]) & (cosine > least * length)
    assert clear.mean() > 0.4
    assert (got.t <= 1 + 0.1 * H / cosine)[clear].all()


@pytest.mark.parametrize("traverser", EXACT)
def test_all_exact_traversers_find_the_same(traverser):
    vertices, triangles = joined(CURVED["leaf"], FLAT["junction"], CURVED["moebius"])
    volume = voxelize(vertices, triangles, H, dtype="u8")
    origin, direction = aimed(vertices, triangles, 20_000)
    want = leapray.trace(leapray.build(volume, "aw"), origin, direction)
    got = leapray.trace(leapray.build(volume, traverser), origin, direction)
    assert_array_equal(got.t, want.t)
    hit = np.isfinite(want.t)
    assert_array_equal(got.normal[hit], want.normal[hit])


def test_normals_and_ids_are_those_of_the_triangle():
    vertices, triangles = FLAT["junction"]
    ids = np.array([3, 7, 11, 60_000])
    volume = voxelize(vertices, triangles, H, ids=ids, dtype="f32")
    origin, direction = aimed(vertices, triangles, 5000, spread=0)
    hits = leapray.trace(leapray.build(volume), origin, direction)
    _, which = brute_rays(origin, direction, vertices, triangles)
    point = origin + hits.t[:, None] * direction
    exact = volume.exact_at(np.where(np.isfinite(point), point, 0)) & (which >= 0)
    assert exact.sum() > 500
    assert_array_equal(hits.id[exact], ids[which[exact]])
    corner = vertices[triangles[which[exact]]]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    assert_allclose(hits.normal[exact], normal, atol=1e-12)


# ---- rays that leave triangle cells ---------------------------------------------------------


def leave(structure, point, hits, chosen, direction):
    """Go on from hits on the side that faces the direction."""
    side = np.where(np.einsum("ij,ij->i", direction, hits.normal[chosen]) > 0, -1, 1)
    return leapray.trace(structure, point, direction, start=(hits.cell[chosen], side))


@pytest.mark.parametrize("dtype", ["u16", "f32"])
@pytest.mark.parametrize("name", ["tent", "junction", "box", "gap 0.5"])
def test_rays_that_leave_are_stopped_by_what_is_there_and_by_nothing_else(name, dtype):
    """No acne, no leak: what a ray of light meets is what the triangles stop."""
    vertices, triangles = FLAT[name]
    volume = voxelize(vertices, triangles, H, dtype=dtype, exact="all")
    structure = leapray.build(volume)
    origin, direction = aimed(vertices, triangles, 20_000, spread=0)
    hits = leapray.trace(structure, origin, direction, normal="analytic")
    chosen = np.flatnonzero(np.isfinite(hits.t))
    point = origin[chosen] + hits.t[chosen, None] * direction[chosen]
    rng = np.random.default_rng(1)
    light = rng.normal(size=point.shape)
    light /= np.linalg.norm(light, axis=1, keepdims=True)
    _, which = brute_rays(origin, direction, vertices, triangles)
    sure = tilt(light, vertices, triangles, which[chosen]) > 0.02
    got = leave(structure, point, hits, chosen, light)
    # start a little off the triangle that was hit, by more than the samples are rounded
    a, b, c = np.moveaxis(vertices[triangles[which[chosen]]], 1, 0)
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    side = np.sign(np.einsum("ij,ij->i", light, normal))[:, None]
    foot = point - np.einsum("ij,ij->i", point - a, normal)[:, None] * normal
    want, _ = brute_rays(foot + 1e-9 * side * normal, light, vertices, triangles)
    wrong = (np.isfinite(got.t) != np.isfinite(want)) & sure
    assert 0.05 < np.isfinite(want).mean() < 0.95
    assert wrong.sum() == 0
