# SPDX-License-Identifier: GPL-3.0-or-later
"""Which meshes the plan keeps as they are, triangle by triangle."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import scenes

import leapray
from addon import model, pipeline
from addon.plan import plan, refinement
from addon.store.memory_cache import Cache


def make(scene):
    return plan.make(scene, Cache(), leapray.Watch(), 1)


@pytest.mark.parametrize("make_mesh", [scenes.box, scenes.plane])
def test_meshes_of_few_triangles_are_kept_as_they_are(make_mesh):
    """Rays meet them exactly, at the coarsest level, whatever the pixel error."""
    scene = scenes.scene([make_mesh()], width=960, height=640, pixel_error=0.001)
    row = make(scene).volumes[0]
    assert row["exact_share"] == 1 and row["error_footprints"] == 0 and row["stuck"] == ""
    assert row["nbytes"] < 100_000
    asked = make(scenes.replace(scene, exact="sheets")).volumes[0]
    assert asked["exact_share"] < 1  # who chooses triangle cells has them as chosen


def test_meshes_most_of_whose_cells_keep_triangles_keep_them_all(by_voxels):
    """A folded sheet has a crease in nearly every cell; a smooth one keeps its few as they are."""
    x, y = np.meshgrid(np.linspace(-2, 2, 33), np.linspace(-2, 2, 33))
    at = np.arange(32 * 33).reshape(32, 33)[:, :-1].reshape(-1, 1)
    corners = np.array([[0, 1, 34], [0, 34, 33]])
    triangles = (at[:, :, None] + corners).reshape(-1, 3).astype(np.int32)
    rows = {}
    for name, z in (("folded", 0.12 * (np.arange(33) % 2)), ("smooth", 0.2 * np.sin(x[0]))):
        vertices = np.stack([x, y, np.broadcast_to(z, x.shape)], axis=-1).reshape(-1, 3)
        mesh = model.Mesh("Sheet", vertices.astype(np.float32), triangles)
        view = scenes.camera(eye=(0.0, -5.0, 3.0), width=320, height=240)
        rows[name] = make(scenes.scene([mesh], view=view, width=320, height=240)).volumes[0]
    assert rows["folded"]["exact_share"] == 1 and rows["folded"]["error_footprints"] == 0
    assert 0 < rows["smooth"]["exact_share"] < 0.5


@pytest.mark.parametrize("sigma", [0.3, 0.8, 2.0])
def test_a_box_of_gas_lets_through_what_the_law_of_beer_says(sigma):
    """To what 32 bits of a pixel hold, for the plan keeps the triangles of so small a mesh."""
    gas = model.Material("Gas", (), absorption=(sigma,) * 3, bare=True)
    view = scenes.camera(eye=(0, -6, 0), scale=1.2)
    scene = scenes.scene([scenes.box((2.0, 1.8, 1.6))], view=view)
    lit = {"materials": (gas, gas), "lights": (), "world": model.World((1.0, 1.0, 1.0))}
    got = pipeline.render(dataclasses.replace(scene, **lit)).passes["Combined"][..., :3]
    assert np.abs(got / np.exp(-1.8 * sigma) - 1).max() < 2e-7


@pytest.mark.parametrize("distance", [3.0, 10.0])
def test_triangles_are_kept_where_voxels_would_be_as_many(distance):
    """A ball of 49,000 triangles would take as many cells, seen from near; from afar 3,200."""
    view = scenes.camera(eye=(0.0, -distance, 0.0), width=960, height=640)
    row = make(scenes.scene([scenes.sphere(n=64)], view=view, width=960, height=640)).volumes[0]
    assert row["exact_share"] == (distance == 3.0)
    assert row["error_footprints"] < 0.25 and row["normal_error"] < 1.5
    cells = 4 * np.pi / row["voxel_size"] ** 2
    assert cells < 12 * 64 * 64 * (2 if distance == 3.0 else refinement.CELLS_PER_TRIANGLE)
