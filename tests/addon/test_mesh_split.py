# SPDX-License-Identifier: GPL-3.0-or-later
"""Parts of a mesh that come near one another do not spoil each other's fields."""

from __future__ import annotations

import numpy as np
import pytest
import scenes

import leapray
from addon import model
from addon.plan import mesh_split, plan
from addon.store.memory_cache import Cache


def test_there_are_never_too_many_parts():
    """A thicket of spheres within one another: the last volume takes what is left."""
    mesh = scenes.join(*((scenes.sphere(0.5 + k / 40, n=2), (k / 40, 0, 0)) for k in range(20)))
    split = mesh_split.split(mesh)
    assert len(split) == mesh_split.MOST_LAYERS
    assert [len(part.triangles) for part in split[:-1]] == [48] * (mesh_split.MOST_LAYERS - 1)
    assert sum(len(part.triangles) for part in split) == len(mesh.triangles)


def test_parts_keep_their_triangles_and_slots():
    near = scenes.join((scenes.sphere(n=4), (0, 0, 0)), (scenes.box(), (1.5, 0, 0)))
    slots = np.arange(len(near.triangles)).astype(np.uint16)
    whole = model.Mesh("Pair", near.vertices, near.triangles, slots)
    split = mesh_split.split(whole)
    assert sorted(len(part.triangles) for part in split) == [12, 192]
    corners = {}
    for part in split:
        assert part.vertices.shape[0] == np.unique(part.triangles).size
        for slot, corner in zip(part.slots, part.vertices[part.triangles], strict=True):
            corners[int(slot)] = corner
    for slot, corner in enumerate(whole.vertices[whole.triangles]):
        np.testing.assert_array_equal(corners[slot], corner)


@pytest.mark.parametrize("apart", [5.0, 0.5])
def test_only_near_parts_are_taken_apart(apart):
    mesh = scenes.join((scenes.sphere(n=4), (0, 0, 0)), (scenes.sphere(n=4), (2 + apart, 0, 0)))
    assert mesh_split.split(mesh) == [mesh]
    assert mesh_split.split(scenes.sphere(n=4))[0].name == "Sphere"


def test_crossing_parts_keep_their_shape():
    """Two spheres that cut each other: rays from everywhere meet the nearer one, as computed."""
    centres = np.array([[0.0, 0.0, 0.0], [1.2, 0.3, 0.1]])
    mesh = scenes.join(*((scenes.sphere(n=64), tuple(c)) for c in centres))
    made = plan.make(scenes.scene([mesh], pixel_error=0.1), Cache(), leapray.Watch(), 1)
    assert [row["kind"] for row in made.volumes] == ["solid", "solid"]
    assert [row["part"] for row in made.volumes] == [0, 1] and len(made.instances) == 2
    rng = np.random.default_rng(5)
    toward = rng.normal(size=(4000, 3))
    origin = 6 * toward / np.linalg.norm(toward, axis=1, keepdims=True)
    ray = rng.uniform(-0.9, 1.5, (4000, 3)) - origin
    t = np.min([leapray.trace(i.structure, origin, ray).t for i in made.instances], axis=0)

    def exact(centre):
        o = origin - centre
        a, b = (ray * ray).sum(1), (o * ray).sum(1)
        root = b * b - a * ((o * o).sum(1) - 1)
        with np.errstate(invalid="ignore"):
            return np.where(root > 0, (-b - np.sqrt(root)) / a, np.inf)

    want = np.min([exact(c) for c in centres], axis=0)
    both = np.isfinite(want) & np.isfinite(t)
    assert (np.isfinite(want) == np.isfinite(t)).mean() > 0.995  # grazing rays aside
    length = np.linalg.norm(ray, axis=1)
    error = np.abs(t[both] - want[both]) * length[both]
    assert np.quantile(error, 0.98) < 0.02


def test_a_closed_part_of_an_open_mesh_is_a_solid():
    mesh = scenes.join((scenes.plane(4.0), (0, 0, 0)), (scenes.sphere(n=16), (0, 0, 0.5)))
    made = plan.make(scenes.scene([mesh]), Cache(), leapray.Watch(), 1)
    assert sorted(row["kind"] for row in made.volumes) == ["sheet", "solid"]


def test_layout_scene_keeps_everything_together():
    mesh = scenes.join((scenes.sphere(n=8), (0, 0, 0)), (scenes.sphere(n=8), (1, 0, 0)))
    made = plan.make(
        scenes.scene([mesh], layout="scene", resolution=40), Cache(), leapray.Watch(), 1
    )
    assert len(made.volumes) == 1
