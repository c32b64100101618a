# SPDX-License-Identifier: GPL-3.0-or-later
"""Hits are shaded by the mesh's own normals: of the triangle that is hit, smooth or flat."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from meshes import box, icosphere, torus, uv_sphere
from scenes import camera, place, scene

import leapray
from addon import model
from addon.plan import plan
from addon.plan.mesh_colors import unit
from addon.store.memory_cache import Cache
from addon.study import embree


def vertex_normals(vertices, triangles):
    """(n, 3) of vertices, by the areas around them."""
    corners = vertices[triangles]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sums = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(sums, triangles[:, corner], cross)
    return unit(sums)


def made(name, vertices, triangles, smooth):
    normals = vertex_normals(vertices, triangles)[triangles] if smooth else None
    return model.Mesh(
        name,
        vertices.astype(np.float32),
        triangles.astype(np.int32),
        corner_normals=None if normals is None else normals.astype(np.float32),
    )


def planned(*meshes, settings=None, at=None):
    view = camera(eye=(0.0, -4.5, 0.8), width=240, height=180)
    places = [place(k, at=(2.6 * k, 0, 0)) for k in range(len(meshes))]
    what = scene(list(meshes), places, view=view, width=240, height=180, **(settings or {}))
    return plan.make(what, Cache(), leapray.Watch(), 1)


def rays(n=4000, seed=5, extent=0.9):
    """From outside towards points near the middle."""
    rng = np.random.default_rng(seed)
    origins = 4.0 * unit(rng.normal(size=(n, 3)))
    return origins, rng.uniform(-extent, extent, (n, 3)) - origins


def own_normals(mesh, origins, directions):
    """t, infinity on a miss, and the shading normals (n, 3) of the mesh's first hits."""
    vertices = mesh.vertices.astype(np.float64)
    length = np.linalg.norm(directions, axis=1)
    t, _, index = embree.first_hits(vertices, mesh.triangles, origins, directions / length[:, None])
    t, index = t / length, np.maximum(index, 0)
    corners = vertices[mesh.triangles[index]]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    if mesh.corner_normals is None:
        return t, unit(cross)
    points = origins + np.where(np.isfinite(t), t, 0.0)[:, None] * directions
    a, b, c = (corners[:, k] - points for k in range(3))
    areas = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
    weights = np.einsum("nkc,nc->nk", areas, unit(cross))
    return t, unit(np.einsum("nk,nkc->nc", weights, mesh.corner_normals[index].astype(float)))


def angles(a, b):
    return np.degrees(np.arccos(np.clip(np.einsum("nk,nk->n", a, b), -1, 1)))


SHAPES = {
    "ball of 16": uv_sphere(16, 8),
    "ball of 48": uv_sphere(48, 24),
    "icosahedron": icosphere(1),
    "fine icosphere": icosphere(4),
    "ring": torus(24, 8, 0.9, 0.2),
    "thin ring": torus(48, 12, 1.0, 0.08),
    "box": box(),
}


@pytest.mark.parametrize("smooth", [True, False], ids=["smooth", "flat"])
@pytest.mark.parametrize("shape", SHAPES)
def test_normals_are_the_meshs_own(shape, smooth):
    mesh = made(shape, *map(np.asarray, SHAPES[shape]), smooth)
    plan_made = planned(mesh)
    origins, directions = rays()
    hits = leapray.trace(plan_made.instances[0].structure, origins, directions)
    t, want = own_normals(mesh, origins, directions)
    both = np.isclose(t, hits.t, rtol=0, atol=0.05) & np.isfinite(t)
    assert both.sum() > 400
    off = angles(hits.normal[both], want[both])
    assert (off > 5).mean() < 0.01 and np.percentile(off, 90) < 2


@pytest.mark.parametrize("kind", ["u8", "u16", "f32"])
def test_a_volume_says_what_normals_its_hits_have(kind):
    mesh = made("ball", *map(np.asarray, SHAPES["ball of 16"]), True)
    attributes = leapray.Attributes(normals=mesh.corner_normals)
    volume = leapray.voxelize(
        mesh.vertices, mesh.triangles, 0.1, attributes=attributes, exact="all", dtype=kind
    )
    origins, directions = rays(1000)
    hits = leapray.trace(leapray.build(volume), origins, directions)
    found = np.isfinite(hits.t)
    points = origins[found] + hits.t[found, None] * directions[found]
    normals = volume.normals(points, threads=3)
    np.testing.assert_array_equal(normals, volume.normals(points))
    assert np.percentile(angles(normals, hits.normal[found]), 99) < 0.1


def test_packed_volumes_keep_the_normals_of_triangles():
    mesh = made("ring", *map(np.asarray, SHAPES["ring"]), True)
    attributes = leapray.Attributes(normals=mesh.corner_normals)
    for flat, given in ((False, attributes), (True, None)):
        volume = leapray.voxelize(
            mesh.vertices, mesh.triangles, 0.1, attributes=given, exact="all", flat=flat
        )
        again = leapray.Volume.unpack(volume.pack())
        origins, directions = rays(2000)
        one, two = (leapray.trace(leapray.build(v), origins, directions) for v in (volume, again))
        assert np.isfinite(one.t).mean() > 0.2
        np.testing.assert_array_equal(one.normal, two.normal)
        np.testing.assert_array_equal(one.t, two.t)


def test_facets_below_the_crease_angle_stay_flat():
    """A ball of 48 segments turns by 7.5 degrees from facet to facet."""
    vertices, triangles = map(np.asarray, SHAPES["ball of 48"])
    origins, directions = rays()
    turned = []
    for flat in (True, False):
        volume = leapray.voxelize(vertices, triangles, 0.06, exact="all", flat=flat)
        hits = leapray.trace(leapray.build(volume), origins, directions)
        mesh = made("ball", vertices, triangles, False)
        t, want = own_normals(mesh, origins, directions)
        both = np.isclose(t, hits.t, rtol=0, atol=0.02) & np.isfinite(t)
        turned.append((angles(hits.normal[both], want[both]) > 1.5).mean())
    assert turned[0] < 0.01 < 0.2 < turned[1]


def test_normals_of_the_users_own_are_kept_whatever_the_facets_size():
    vertices, triangles = map(np.asarray, icosphere(5))
    lean = unit(vertices + 0.4 * np.array([0.0, 0.0, 1.0]))
    mesh = dataclasses.replace(
        made("ball", vertices, triangles, True),
        corner_normals=lean[triangles].astype(np.float32),
    )
    plan_made = planned(mesh)
    assert plan_made.volumes[0]["carries"] == ["normals"]
    origins, directions = rays()
    hits = leapray.trace(plan_made.instances[0].structure, origins, directions)
    found = np.isfinite(hits.t)
    points = unit(origins[found] + hits.t[found, None] * directions[found])
    want = unit(points + 0.4 * np.array([0.0, 0.0, 1.0]))
    assert np.percentile(angles(hits.normal[found], want), 99) < 3


def test_meshes_of_one_shape_are_shaded_each_by_itself():
    """Of several parts, too: they are split alike, and differ in their corners alone."""
    one, two = box((-0.9, -0.9, -0.9), (-0.1, 0.9, 0.9)), box((0.1, -0.9, -0.9), (0.9, 0.9, 0.9))
    vertices = np.concatenate([one[0], two[0]])
    triangles = np.concatenate([one[1], np.asarray(two[1]) + len(one[0])])
    smooth, flat = (
        made("smooth", vertices, triangles, True),
        made("flat", vertices, triangles, False),
    )
    origins, directions = rays(2000)
    for pair in ((smooth, flat), (flat, smooth)):
        plan_made = planned(*pair)
        parts = len(plan_made.instances) // 2
        for k, mesh in enumerate(pair):
            t, want = own_normals(mesh, origins, directions)
            structures = [i.structure for i in plan_made.instances[k * parts : (k + 1) * parts]]
            traced = [leapray.trace(s, origins, directions) for s in structures]
            first = np.argmin([h.t for h in traced], axis=0)
            normal = np.stack([h.normal for h in traced])[first, np.arange(len(t))]
            both = np.isfinite(t)
            assert (angles(normal[both], want[both]) > 5).mean() < 0.01


def test_both_sides_of_a_thin_wall_have_their_own_colours():
    """Samples on one side of a wall thinner than a voxel may name triangles of the other."""
    vertices, triangles = map(np.asarray, box((-1, -1, -0.01), (1, 1, 0.01)))
    up = vertices[triangles].mean(axis=1)[:, 2] > 0
    colors = np.where(up[:, None, None], np.float32((1, 0, 0)), np.float32((0, 0, 1)))
    attributes = leapray.Attributes(
        colors=np.broadcast_to(colors, (len(triangles), 3, 3)).astype(np.float32),
        color_sources=np.full(len(triangles), leapray.VERTEX, np.int32),
    )
    volume = leapray.voxelize(vertices, triangles, 0.2, attributes=attributes, exact="all")
    rng = np.random.default_rng(1)
    points = np.column_stack([rng.uniform(-0.9, 0.9, (500, 2)), np.full(500, 0.01)])
    for height, color in ((0.01, (1, 0, 0)), (-0.01, (0, 0, 1))):
        points[:, 2] = height
        np.testing.assert_allclose(
            volume.attributes(points)[0], np.tile(color, (500, 1)), atol=1e-6
        )


def test_a_fixed_resolution_keeps_the_shading_too():
    for smooth in (True, False):
        mesh = made("ball", *map(np.asarray, SHAPES["ball of 16"]), smooth)
        plan_made = planned(mesh, settings={"resolution": 64})
        origins, directions = rays()
        hits = leapray.trace(plan_made.instances[0].structure, origins, directions)
        t, want = own_normals(mesh, origins, directions)
        both = np.isclose(t, hits.t, rtol=0, atol=0.05) & np.isfinite(t)
        off = angles(hits.normal[both], want[both])
        assert np.percentile(off, 90) < 2 and (off > 5).mean() < 0.05  # creases: half a voxel
