# SPDX-License-Identifier: GPL-3.0-or-later
"""Of two surfaces the nearer one is seen, however small the gap: decals, labels, carpets, text.

The judge is a search for the nearest of all triangles by f64.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import scenes

import leapray
from addon import model, pipeline
from addon.plan import plan, probes, proximity
from addon.store.memory_cache import Cache

WIDTH, HEIGHT = 200, 112


# ---- the judge -----------------------------------------------------------------------


def nearest_object(scene: model.Scene) -> np.ndarray:
    """(height, width) object indices of the nearest triangles at the pixels' centres; 0: none."""
    x, y = np.meshgrid(np.arange(scene.width) + 0.5, np.arange(scene.height) + 0.5)
    view, flat = scene.camera, scene.camera.projection == "orthographic"
    film = view.corner + x[..., None] * view.dx + y[..., None] * view.dy
    best, found = np.full(x.shape, np.inf), np.zeros(x.shape)
    for instance in scene.instances:
        mesh, m = scene.meshes[instance.mesh], instance.world_from_object
        corners = mesh.vertices.astype(np.float64) @ m[:3, :3].T + m[:3, 3]
        v = corners - view.eye
        depth = (v @ view.forward)[:, None]
        v = (v - depth * view.forward if flat else v / np.maximum(depth, 1e-9)) - view.corner
        at = np.stack([v @ d / (d @ d) for d in (view.dx, view.dy)], axis=1)
        at = np.where(depth > 0, at, [[-np.inf, -np.inf]])[mesh.triangles]
        at = np.where(
            np.isinf(at).any(axis=(1, 2), keepdims=True), [[0, 0], [1e4, 1e4], [0, 0]], at
        )
        low = np.maximum(np.floor(at.min(axis=1)).astype(int), 0)
        high = np.ceil(at.max(axis=1)).astype(int) + 1
        for (a, b, c), (x0, y0), (x1, y1) in zip(
            corners[mesh.triangles], low, np.maximum(high, 0), strict=True
        ):
            some = np.s_[y0:y1, x0:x1]
            origin, ray = (view.eye + film[some], view.forward) if flat else (view.eye, film[some])
            e, f = b - a, c - a
            p, q = np.cross(ray, f), np.cross(origin - a, e)
            with np.errstate(all="ignore"):
                u = ((origin - a) * p).sum(-1) / (p @ e)
                w = (ray * q).sum(-1) / (p @ e)
                t = q @ f / (p @ e)
                hit = (u >= 0) & (w >= 0) & (u + w <= 1) & (t > 0) & (t < best[some])
            best[some] = np.where(hit, t, best[some])
            found[some] = np.where(hit, instance.object_index, found[some])
    return found


def check(scene: model.Scene, least: int, of: int = 2) -> pipeline.Frame:
    """The object seen is the nearest one, but for edges of objects; `of` has so many pixels."""
    want = nearest_object(scene)
    assert (want == of).sum() >= least
    frame = pipeline.render(scene)
    got = frame.passes["Object Index"][..., 0]
    around = np.pad(want, 1, mode="edge")
    clear = np.ones(want.shape, bool)
    for dy in range(3):
        for dx in range(3):
            clear &= around[dy : dy + want.shape[0], dx : dx + want.shape[1]] == want
    assert (want == of)[clear].sum() > 0.25 * least
    assert (got == want)[clear].all()
    assert abs(int((got == of).sum()) - int((want == of).sum())) <= 0.02 * (want == of).sum() + 2
    return frame


# ---- things --------------------------------------------------------------------------


def tube(radius, height, n, turn=1.0, caps=False, name="Tube") -> model.Mesh:
    """A round wall of n segments of a full turn about z, smooth; with caps it is closed."""
    a = 2 * np.pi * turn * np.arange(n if caps else n + 1) / n - np.pi * (0.5 + turn)
    ring = np.stack([radius * np.cos(a), radius * np.sin(a)], axis=1)
    k = len(ring)
    z = np.repeat([-height / 2, height / 2], k)
    vertices = np.column_stack([np.tile(ring, (2, 1)), z])
    i = np.arange(n)
    j = (i + 1) % k
    triangles = np.concatenate([np.column_stack([i, j, j + k]), np.column_stack([i, j + k, i + k])])
    if caps:
        low, high = 2 * k, 2 * k + 1
        vertices = np.concatenate([vertices, [[0, 0, -height / 2], [0, 0, height / 2]]])
        triangles = np.concatenate(
            [
                triangles,
                np.column_stack([j, i, np.full(n, low)]),
                np.column_stack([i + k, j + k, np.full(n, high)]),
            ]
        )
    corners = vertices[triangles]
    normals = None
    if not caps:
        normals = corners * [1, 1, 0] / radius
    return model.Mesh(
        name,
        vertices.astype(np.float32),
        triangles.astype(np.int32),
        corner_normals=None if normals is None else normals.astype(np.float32),
    )


def letters() -> model.Mesh:
    """Flat rings and bars, as text has them, in z = 0."""
    parts = []
    for k in range(4):
        a = 2 * np.pi * np.arange(25) / 24
        ring = np.stack([np.cos(a), 1.4 * np.sin(a), 0 * a], axis=1)
        vertices = np.concatenate([0.5 * ring, 0.3 * ring]).astype(np.float32)
        i = np.arange(24)
        quads = np.column_stack([i, i + 1, i + 26, i + 25])
        triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.int32)
        parts.append((model.Mesh("O", vertices, triangles), (1.3 * k - 2, 0, 0)))
        bar = np.array([[-0.1, -0.7, 0], [0.1, -0.7, 0], [0.1, 0.7, 0], [-0.1, 0.7, 0]], np.float32)
        parts.append(
            (
                model.Mesh("I", bar, np.array([[0, 1, 2], [0, 2, 3]], np.int32)),
                (1.3 * k - 1.35, 0, 0),
            )
        )
    return scenes.join(*parts, name="Letters")


def turned(angles, at=(0, 0, 0), scale=(1, 1, 1)) -> np.ndarray:
    """World from object: scaled, turned about x, y, z, shifted."""
    matrix = np.diag([*scale, 1.0]).astype(float)
    for axis, angle in enumerate(angles):
        c, s = np.cos(angle), np.sin(angle)
        turn = np.eye(4)
        i, j = (axis + 1) % 3, (axis + 2) % 3
        turn[i, i] = turn[j, j] = c
        turn[i, j], turn[j, i] = -s, s
        matrix = turn @ matrix
    matrix[:3, 3] += at
    return matrix


def scene_of(meshes, matrices, view, **settings) -> model.Scene:
    """One instance for each matrix, of the mesh with that number or the last; indices from 1."""
    placed = [
        scenes.place(
            min(k, len(meshes) - 1),
            name=f"Object {k + 1}",
            world_from_object=matrix,
            object_index=k + 1,
        )
        for k, matrix in enumerate(matrices)
    ]
    return scenes.scene(meshes, placed, view=view, width=WIDTH, height=HEIGHT, **settings)


def look(distance, wide, down=0.93, **more) -> model.Camera:
    """At the origin from so far, so many units wide there, by so much of a right angle down."""
    eye = distance * np.array([0.0, -np.sin(down), np.cos(down)])
    fov = 2 * np.arctan(wide / 2 / distance)
    return scenes.camera(eye=eye, width=WIDTH, height=HEIGHT, fov=fov, **more)


def decal(distance, gap, wide, base=None, whole=None, **settings) -> model.Scene:
    """A square of 1 m that much above a square of 2 m, both moved by `whole`."""
    whole = np.eye(4) if whole is None else whole
    lift = np.eye(4)
    lift[2, 3] = gap
    meshes = [base or scenes.plane(2.0), scenes.plane(1.0)]
    view = look(distance, wide)
    return scene_of(meshes, [whole, whole @ lift], view, **settings)


# ---- flat things ---------------------------------------------------------------------


@pytest.mark.parametrize(
    ("distance", "gap", "wide"),
    [
        (5, 5e-4, 3.6),
        (20, 5e-4, 14.4),
        (30, 5e-4, 21.6),
        (60, 5e-4, 25),
        (60, 5e-5, 8),
        (400, 2e-4, 4),
    ],
)
def test_a_decal_above_a_table_is_seen(distance, gap, wide):
    check(decal(distance, gap, wide), 20)


@pytest.mark.parametrize("angles", [(0.1, 0.2, 0.3), (-0.3, 0.15, 2.0)])
def test_a_decal_is_seen_wherever_both_are_turned(angles):
    check(decal(20, 5e-4, 14.4, whole=turned(angles, at=(0.37, 0.11, 0.07))), 100)


def test_a_decal_is_seen_on_a_solid_table():
    table = scenes.join((scenes.box((2.0, 2.0, 0.5)), (0, 0, -0.25)))
    check(decal(30, 5e-4, 14, base=table), 100)
    check(decal(30, 5e-4, 14, base=table, whole=turned((0.2, 0.1, 0.5))), 100)


def test_a_decal_is_seen_by_an_orthographic_camera():
    scene = decal(20, 5e-4, 14.4)
    view = scenes.camera(eye=(0, -16, 12), width=WIDTH, height=HEIGHT, scale=14.4)
    check(dataclasses.replace(scene, camera=view), 100)


@pytest.mark.parametrize(
    "settings", [{"sample_type": "u8"}, {"sample_type": "u16"}, {"resolution": 24}]
)
def test_a_decal_is_seen_whatever_the_samples(settings):
    check(decal(30, 2e-4, 14, **settings), 50)


def test_sheets_of_one_mesh_are_told_apart():
    """Posters in a pile, each a hand's breadth aside and 0.3 mm above the one before."""
    pile = [turned((0, 0, 0), at=(0.15 * k, 0.1 * k, 3e-4 * k)) for k in range(4)]
    check(scene_of([scenes.plane(1.0)], pile, look(25, 6)), 30, of=3)


def test_a_carpet_on_a_floor_is_seen():
    """A box of 0.5 mm, also one that only its instance makes so thin."""
    thin = scenes.box((1.4, 1.0, 5e-4))
    up = turned((0, 0, 0), at=(0, 0, 2.5e-4))
    check(scene_of([scenes.plane(6.0), thin], [np.eye(4), up], look(20, 14)), 100)
    flat = turned((0, 0, 0), at=(0, 0, 2.5e-4), scale=(0.7, 0.5, 2.5e-4))
    check(scene_of([scenes.plane(6.0), scenes.box()], [np.eye(4), flat], look(20, 14)), 100)


def test_text_on_a_wall_is_seen():
    wall = scenes.join((scenes.box((4.0, 3.0, 0.3)), (0, 0, -0.15)))
    whole = turned((0.3, -0.2, 0.1))
    text = whole @ turned((0, 0, 0), at=(0, 0, 2e-4), scale=(0.5, 0.5, 0.5))
    check(scene_of([wall, letters()], [whole, text], look(25, 6, down=0.3)), 500)


def test_a_road_mark_on_a_large_ground_is_seen():
    road = turned((0, 0, 0.3), at=(0, 0, 1e-3), scale=(0.15, 3.0, 1.0))
    scene = scene_of([scenes.plane(400.0), scenes.plane(2.0)], [np.eye(4), road], look(12, 8))
    check(scene, 200)


# ---- curved things -------------------------------------------------------------------


@pytest.mark.parametrize("segments", [16, 24, 19])
@pytest.mark.parametrize(("distance", "wide"), [(5, 3.0), (30, 4.5)])
def test_a_label_on_a_barrel_is_seen(segments, distance, wide):
    """A quarter of a turn, 0.2 mm above one of 64 segments: on its own ones and on others."""
    barrel = tube(0.4, 2.0, 64, caps=True, name="Barrel")
    label = tube(0.4002 / np.cos(np.pi / 64), 1.0, segments, turn=0.25, name="Label")
    whole = turned((0.05, 0.1, 0.0))
    scene = scene_of([barrel, label], [whole, whole], look(distance, wide, down=1.4))
    frame = check(scene, 400)
    normals = frame.passes["Normal"][frame.passes["Object Index"][..., 0] == 2]
    axis = whole[:3, 2]
    assert np.abs(normals @ axis).max() < 0.01  # of a cylinder


def test_a_label_on_a_ball_is_seen():
    ball = scenes.sphere(0.5, n=24)
    normals = 2 * ball.vertices[ball.triangles]
    ball = dataclasses.replace(ball, corner_normals=normals)
    some = ball.vertices[ball.triangles].mean(axis=1)[:, 1] < -0.4
    label = model.Mesh("Label", ball.vertices, ball.triangles[some], corner_normals=normals[some])
    larger = turned((0, 0, 0), scale=(1.0004, 1.0004, 1.0004))
    check(scene_of([ball, label], [np.eye(4), larger], look(9, 4, down=1.57)), 500)


# ---- what it costs -------------------------------------------------------------------


def rows(scene, cache=None):
    made = plan.make(scene, cache or Cache(), leapray.Watch(), 1)
    return made, [(v["voxel_size"], v["sample_type"], v["volume_nbytes"]) for v in made.volumes]


@pytest.mark.parametrize("gap", [0.0, 1e-4])
def test_what_stands_on_a_floor_costs_nothing(gap, monkeypatch):
    """Its foot and the floor below it are not seen both."""
    foot = turned((0, 0, 0), at=(0, 0, 0.5 + gap))
    ball = turned((0, 0, 0), at=(2, 0, 1.0))
    meshes = [scenes.plane(20.0), scenes.box((1, 1, 1)), scenes.sphere(n=24)]
    scene = scene_of(meshes, [np.eye(4), foot, ball], look(20, 10))
    made, with_it = rows(scene)
    monkeypatch.setattr(plan.Planner, "separate", lambda self: None)
    assert with_it == rows(scene)[1] and not made.warnings


def test_a_decal_costs_kilobytes(monkeypatch):
    scene = decal(30, 5e-4, 21.6)
    made, with_it = rows(scene)
    monkeypatch.setattr(plan.Planner, "separate", lambda self: None)
    _, without = rows(scene)
    assert sum(r[2] for r in with_it) - sum(r[2] for r in without) < 1 << 16
    assert not made.warnings


def test_a_crowd_with_hardly_an_error_has_no_close_pairs():
    """Ten thousand boxes, all of them in each other's, of two volumes: 25 million pairs."""
    n, random = 5000, np.random.default_rng(7)
    matrices = np.tile(np.eye(4), (2 * n, 1, 1))
    matrices[:, :3, 3] = random.uniform(-1, 1, (2 * n, 3)) * [0.2, 0.2, 0.2]
    structures = [
        leapray.build(leapray.voxelize(m.vertices, m.triangles, 0.125))
        for m in (scenes.sphere(n=8), scenes.box())
    ]
    drawn = [probes.draw(m) for m in (scenes.sphere(n=8), scenes.box())]
    bodies = [
        proximity.Body(
            matrices[k * n : (k + 1) * n],
            np.array([[-1.0] * 3, [1.0] * 3]),
            1e-9,
            lambda k=k: drawn[k],
            lambda k=k: structures[k],
        )
        for k in range(2)
    ]
    assert proximity.close_pairs(bodies, look(10, 10)) == []


# ---- what cannot be done is said -------------------------------------------------------


@pytest.mark.parametrize("exact", ["none", "sheets", "all"])
def test_cells_that_may_not_keep_triangles_are_named(exact):
    frame = pipeline.render(decal(30, 2e-4, 21.6, sample_type="u8", exact=exact))
    said = [w for w in frame.report["warnings"] if "near to each other" in w]
    assert len(said) == 1 and "'Object 1' and 'Object 2'" in said[0]


def test_the_next_frame_finds_the_volumes_in_the_cache(monkeypatch):
    cache, scene = Cache(), decal(30, 5e-4, 21.6)
    first = pipeline.render(scene, cache=cache)
    assert (first.passes["Object Index"] == 2).sum() > 50

    def made(*_, **__):
        raise AssertionError("made again")

    monkeypatch.setattr(leapray, "voxelize", made)
    second = pipeline.render(scene, cache=cache)
    np.testing.assert_array_equal(first.passes["Object Index"], second.passes["Object Index"])
