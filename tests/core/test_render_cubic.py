# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures of cubic volumes: light in and around them, solids that cut, fields that colour."""

from __future__ import annotations

import bspline
import numpy as np
import pytest
import stage

import leapray
from leapray import Instance, Lobe, Material

DEEP = dict(max_bounces=64, diffuse_bounces=64, glossy_bounces=64, transmission_bounces=64)
N = 20
VOXEL = 0.1
MIDDLE = (N - 1) / 2 + 0.13
RED = Material.diffuse((1, 0, 0))


def ball_samples():
    z, y, x = np.mgrid[:N, :N, :N] - MIDDLE
    return np.clip(0.5 + (7 - np.sqrt(x * x + y * y + z * z)) / 8, 0, 1).astype(np.float32)


def placed():
    matrix = np.diag([VOXEL] * 3 + [1])
    matrix[:3, 3] = -MIDDLE * VOXEL
    return matrix


def ball():
    """Of radius 0.7, coarse."""
    return leapray.Volume(ball_samples(), object_from_index=placed(), interpolation="cubic")


def heights(points):
    """The spline of the ball at points of the world."""
    return bspline.Spline(ball_samples()).value(points.reshape(-1, 3) / VOXEL + MIDDLE)


@pytest.mark.parametrize("name", ["diffuse", "glossy", "glass", "transparent"])
@pytest.mark.parametrize("eye", [(0, -4, 0), (0, -0.2, 0.1)])
def test_what_loses_no_light_vanishes_in_a_uniform_world(name, eye):
    inside = eye[1] > -1
    if inside and name in ("diffuse", "glossy"):
        pytest.skip("no light comes into it")
    lobe = Lobe(name, (1.0, 1.0, 1.0), **({"ior": 1.5} if name == "glass" else {}))
    cam = stage.camera(eye, (0, 5, 0), size=(48, 48))
    one = Instance(leapray.build(ball()), np.eye(4))
    scene = leapray.Scene(cam, [one], [], [Material([lobe])], [0], leapray.World((1, 1, 1)))
    got = scene.render_tile(0, 0, 48, 48, samples=64, passes=("Depth",), **DEEP)
    hit = (got["Depth"] < stage.FAR)[..., 0]
    assert hit.mean() > (0.9 if inside else 0.1)
    assert abs(got["Combined"][hit].mean() - 1) < 0.005


def test_a_glass_ball_absorbs_by_the_way_that_rays_take_in_it():
    lobe = Lobe("glass", (1.0, 1.0, 1.0), ior=1.0)
    solid = Material([lobe], absorption=(1.0, 1.0, 1.0))
    cam = stage.camera((0, -4, 0), size=(33, 33))
    structure = leapray.build(ball())
    scene = leapray.Scene(
        cam, [Instance(structure, np.eye(4))], [], [solid], [0], leapray.World((1, 1, 1))
    )
    got = scene.render_tile(0, 0, 33, 33, samples=1, filter_width=1e-3, **DEEP)["Combined"][..., 0]
    o, d = (np.reshape(each, (-1, 3)) for each in stage.centre_rays(cam, (33, 33)))
    d = d / np.linalg.norm(d, axis=1, keepdims=True)
    first = leapray.trace(structure, o, d)
    hit = np.isfinite(first.t)
    points = (o + np.where(hit, first.t, 0)[:, None] * d)[hit]
    second = leapray.trace(
        structure, points, d[hit], start=(first.cell[hit], np.ones(hit.sum(), int))
    )
    assert hit.mean() > 0.1
    assert np.isfinite(second.t).all() and second.t.max() == pytest.approx(1.4, abs=0.05)
    got = got.ravel()
    assert got[~hit] == pytest.approx(1.0)
    assert np.median(np.abs(got[hit] - np.exp(-second.t))) < 0.01


def test_a_cubic_solid_cuts_where_its_spline_is():
    wall = leapray.build(stage.slab())
    for inside in (True, False):
        clip = leapray.Clip(ball(), np.eye(4), inside=inside)
        scene = leapray.Scene(
            stage.camera((0, 0.5, 4), (0, 0, 0.1), size=(64, 64)),
            [Instance(wall, np.eye(4), clips=[clip])], [], [RED], [0],
        )  # fmt: skip
        got = scene.render_tile(0, 0, 64, 64, samples=1, passes=("Position", "Depth"))
        seen = got["Depth"][..., 0] < stage.FAR
        top = seen & (np.abs(got["Position"][..., 2]) < 1e-3)
        height = heights(got["Position"][top]) - 0.5
        assert top.sum() > 300
        assert (height > -1e-5).all() if inside else (height < 1e-5).all()


def test_a_cubic_field_colours_by_its_values_and_slopes():
    red, *_ = leapray.INPUTS
    program = leapray.compile_program((red, 0.0, 0.0))
    shines = Material((Lobe("emission", (1, 1, 1), textured=True),))
    spline, wall = bspline.Spline(ball_samples()), leapray.build(stage.slab())
    for part in ("value", "slope"):
        color = leapray.FieldColor(ball(), np.eye(4), program, part=part)
        scene = leapray.Scene(
            stage.camera((0, 0.5, 4), size=(32, 32)),
            [Instance(wall, np.eye(4), field_color=color)], [], [shines], [0],
        )  # fmt: skip
        got = scene.render_tile(
            0, 0, 32, 32, samples=1, filter_width=1e-3, passes=("Position", "Depth")
        )
        index = got["Position"].reshape(-1, 3) / VOXEL + MIDDLE
        near = ((index > -1.9) & (index < N + 0.9)).all(1)
        want = spline.value(index)
        if part == "slope":
            want = np.linalg.norm(spline.gradient(index), axis=1) / VOXEL
        assert near.sum() > 100
        linear = leapray.Volume(ball_samples(), object_from_index=placed())
        other = linear.sample(got["Position"].reshape(-1, 3)[near].astype(float))
        other = other[0] if part == "value" else np.linalg.norm(other[1], axis=1)
        assert np.abs(other - want[near]).max() > 0.01
        assert np.abs(got["Combined"].reshape(-1, 4)[near, 0] - want[near]).max() < 1e-3
