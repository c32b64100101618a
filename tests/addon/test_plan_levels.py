# SPDX-License-Identifier: GPL-3.0-or-later
"""How few levels the plan makes, and that threads and what is known change nothing about them."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import scenes

import leapray
from addon import model
from addon.plan import mesh_colors, plan
from addon.store.memory_cache import Cache


@pytest.fixture
def calls(monkeypatch):
    """(voxel size, exact) of all that was voxelized."""
    told = []
    voxelize = leapray.voxelize

    def counted(vertices, triangles, voxel_size, **more):
        told.append((voxel_size, more["exact"]))
        return voxelize(vertices, triangles, voxel_size, **more)

    monkeypatch.setattr(leapray, "voxelize", counted)
    return told


def make(scene, cache=None, threads=1):
    return plan.make(scene, cache or Cache(), leapray.Watch(), threads)


def smooth(mesh: model.Mesh) -> model.Mesh:
    """With normals as of a ball round the origin."""
    corners = mesh.vertices[mesh.triangles]
    length = np.linalg.norm(corners, axis=-1, keepdims=True)
    return dataclasses.replace(mesh, corner_normals=(corners / length).astype(np.float32))


def test_smooth_glass_with_creases_is_voxelized_twice(by_voxels, calls):
    """Once to see that it is a solid; then it keeps its triangles, so few in a cell that none
    of the levels between is needed."""
    mesh = smooth(scenes.divided(scenes.box(turn=0.3), 4))
    assert len(mesh.triangles) > plan.FEW_TRIANGLES
    scene = scenes.scene([mesh], view=scenes.camera(width=960, height=640), width=960, height=640)
    clear = dataclasses.replace(scene.materials[0], lobes=(model.Lobe("glass"),))
    assert clear.refracts
    row = make(dataclasses.replace(scene, materials=(clear, clear))).volumes[0]
    assert [exact for _, exact in calls] == ["sheets", "every"]
    assert row["exact_share"] == 1 and row["error_footprints"] == 0


@pytest.mark.parametrize("distance", [3.0, 200.0])
def test_triangles_larger_than_pixels_are_kept_at_once(calls, distance):
    """A ball of 4,800 triangles has 200,000 pixels and more from near, few from afar."""
    view = scenes.camera(eye=(0.0, -distance, 0.0), width=960, height=640)
    make(scenes.scene([scenes.sphere(n=20)], view=view, width=960, height=640))
    assert calls[0][1] == ("every" if distance == 3.0 else "sheets")
    assert len(calls) == 1 or distance > 3.0


def wavy(n: int) -> model.Mesh:
    """An open sheet of 2 n^2 triangles with folds, whose cells keep some."""
    x, y = np.meshgrid(np.linspace(-2, 2, n + 1), np.linspace(-2, 2, n + 1))
    z = 0.3 * np.abs(np.sin(4 * x)) + 0.2 * np.sin(3 * y)
    at = np.arange(n * (n + 1)).reshape(n, n + 1)[:, :-1].reshape(-1, 1)
    corners = np.array([[0, 1, n + 2], [0, n + 2, n + 1]])
    triangles = (at[:, :, None] + corners).reshape(-1, 3).astype(np.int32)
    vertices = np.stack([x, y, z], axis=-1).reshape(-1, 3).astype(np.float32)
    return model.Mesh("Sheet", vertices, triangles)


def test_levels_that_cannot_be_enough_are_left_out(calls):
    """The level reached is the one that single steps reach."""
    view = scenes.camera(eye=(0.0, -5.0, 3.0), width=960, height=640)
    scene = scenes.scene([wavy(128)], view=view, width=960, height=640)
    row = make(scene).volumes[0]
    sizes = [size for size, _ in calls]
    assert min(np.divide(sizes[1:], sizes[:-1])) < 0.5, "some level is left out"
    stepwise = pytest.MonkeyPatch()
    with stepwise.context() as patch:
        patch.setattr("addon.plan.error_metric.Errors.sharpening", lambda self, carried: 0)
        assert make(scene).volumes[0] == row


def test_a_second_thread_changes_nothing():
    """It looks at meshes ahead, also at one that is refused, and at two of the same contents."""
    point = model.Mesh("Point", np.zeros((3, 3), np.float32), np.array([[0, 1, 2]], np.int32))
    meshes = [scenes.sphere(n=12), point, scenes.box(), scenes.sphere(n=12), wavy(24)]
    placed = [scenes.place(n, at=(3.0 * n - 6, 0, 0), name=m.name) for n, m in enumerate(meshes)]
    scene = scenes.scene(meshes, placed, view=scenes.camera(eye=(0.0, -12.0, 3.0)))
    one, two = (make(scene, threads=threads) for threads in (1, 2))
    assert one.volumes == two.volumes and one.warnings == two.warnings
    assert len(one.volumes) == 4 and any("'Point' is skipped" in w for w in one.warnings)


def test_normals_are_as_well_known_from_afar_as_if_nothing_had_been_nearer():
    """Near by, the coarse levels are no good and their normals looked at roughly."""
    near = scenes.scene([scenes.sphere(n=32)], view=scenes.camera(eye=(0.0, -2.5, 0.0)))
    far = dataclasses.replace(near, camera=scenes.camera(eye=(0.0, -60.0, 0.0)))
    cache = Cache()
    make(near, cache)
    cache.keep("probes", "measure")
    assert make(far, cache).volumes[0] == make(far).volumes[0]


@pytest.mark.parametrize("shift", [0.0, 100.0])
def test_no_facet_needs_normals_at_voxels_wider_than_the_largest_says(shift):
    rng = np.random.default_rng(7)
    for _ in range(20):
        corners = rng.random((60, 3)) * rng.random(3) + shift
        triangles = np.arange(60).reshape(-1, 3).astype(np.int32)
        mesh = model.Mesh("Scraps", corners.astype(np.float32), triangles)
        up = np.tile(np.float32([0, 0, 1]), (20, 3, 1))
        mesh = dataclasses.replace(mesh, corner_normals=up)
        sides = mesh.vertices[triangles].astype(np.float64)
        areas = np.linalg.norm(
            np.cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0]), axis=1
        )
        widest = mesh_colors.widest_voxel(areas.max() / 2)
        assert 0 < mesh_colors.facet_voxel(mesh, True) <= widest
