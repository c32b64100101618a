# SPDX-License-Identifier: GPL-3.0-or-later
"""Light against what optics says of spheres, planes, lights and the world."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from stage import (
    FAR,
    IDENTITY,
    VOXELS,
    at,
    ball,
    camera,
    centre_rays,
    clearance,
    meet_sphere,
    one,
    render,
    unit,
)

import leapray


@pytest.mark.parametrize(("radius", "slack"), [(VOXELS, 0.002), (8.0, 0.01), (4.0, 0.04)])
@pytest.mark.parametrize("matrix", [IDENTITY, np.diag([-1.0, 1, 1, 1])], ids=["plain", "mirrored"])
def test_a_sphere_under_a_sun_of_irradiance_pi_shows_the_cosine(radius, slack, matrix):
    light = unit(2, -1, 1)
    cam = camera((0, -4, 0), size=(128, 128), width=0.62)
    sun = leapray.Light("sun", [np.pi] * 3, direction=light)
    got = render(cam, [one(leapray.build(ball(radius)), matrix)], [sun], size=(128, 128))
    o, d = centre_rays(cam, (128, 128))
    inner = clearance(o, d) < 0.95
    cosine = ((o + meet_sphere(o, d)[..., None] * d) * light).sum(-1)
    assert (cosine[inner] > 0).mean() > 0.3
    assert (cosine[inner] < 0).mean() > 0.1
    # no acne, no steps at the terminator: the cosine down to grazing light
    assert np.abs(got["Combined"][..., 0] - np.maximum(cosine, 0))[inner].max() < slack
    assert not got["Combined"][inner & (cosine < -slack)][:, :3].any()


def test_a_point_light_falls_off_with_the_square_of_the_distance(sphere):
    place = np.array([0.6, -1.5, 0.8])
    cam = camera((0, -4, 0))
    light = leapray.Light("point", (np.pi, 2 * np.pi, 0), position=place)
    got = render(cam, [one(sphere)], [light], materials=[leapray.Material.diffuse((0.5, 0.25, 1))])
    o, d = centre_rays(cam, (96, 64))
    inner = clearance(o, d) < 0.95
    point = o + meet_sphere(o, d)[..., None] * d
    to_light = place - point
    distance = np.linalg.norm(to_light, axis=-1)
    want = 0.5 * np.maximum((point * to_light).sum(-1) / distance, 0) / distance**2
    assert want[inner].max() > 3 * np.median(want[inner])
    for channel in (0, 1):
        np.testing.assert_allclose(
            got["Combined"][inner][:, channel], want[inner], rtol=5e-3, atol=5e-4
        )
    assert not got["Combined"][..., 2].any()


@pytest.mark.parametrize("kind", ["sun", "point"])
def test_the_shadow_of_a_sphere_ends_where_the_cone_of_light_says(kind, sphere, floor):
    place, direction = np.array([1.5, 0.5, 4.0]), unit(1, 0.5, 2)
    light = leapray.Light(kind, (3, 3, 3), position=place, direction=direction)
    cam = camera((0, 0, 9), size=(160, 160), width=6, kind="orthographic")
    body = one(sphere, at(0, 0, 1.5, 0.8), visible_camera=False)
    got = render(cam, [one(floor), body], [light], size=(160, 160))
    lit = got["Combined"][..., 0] > 0
    towards = np.broadcast_to(direction, got["Position"].shape)
    if kind == "point":
        towards = place - got["Position"]
    gap = clearance(got["Position"], towards, (0, 0, 1.5))
    clear = np.abs(gap - 0.8) > 0.8 * 0.02 / VOXELS + 1e-5  # the voxels' own error
    assert clear.mean() > 0.99
    assert 0.02 < (gap < 0.8).mean() < 0.4
    np.testing.assert_array_equal(lit[clear], gap[clear] > 0.8)
    for each in (replace(light, casts_shadow=False), light):
        through = replace(body, visible_shadow=each.casts_shadow is False)
        free = render(cam, [one(floor), through], [each], size=(160, 160))
        assert (free["Combined"][..., 0] > 0).all()


def test_a_flat_floor_has_no_acne_under_grazing_light(floor):
    sun = leapray.Light("sun", [np.pi] * 3, direction=unit(1, 0.3, 0.002))
    got = render(camera((0, -3, 1.2)), [one(floor)], [sun], samples=4)
    on_top = (got["Normal"][..., 2] > 0.999999) & (np.abs(got["Position"][..., :2]).max(-1) < 3.5)
    assert on_top.mean() > 0.4
    np.testing.assert_allclose(got["Combined"][on_top][:, 0], unit(1, 0.3, 0.002)[2], rtol=1e-4)


def test_a_convex_body_in_a_bright_world_shows_its_own_colour(sphere):
    world, color = np.array([0.5, 0.25, 1]), np.array([0.2, 0.4, 0.6])
    got = render(camera((0, -4, 0)), [one(sphere)], samples=16, world=world,
                 materials=[leapray.Material.diffuse(color)])  # fmt: skip
    hit = (got["Object Index"] == 0)[..., 0] & (got["Depth"] < FAR)[..., 0]
    inner = hit & (clearance(*centre_rays(camera((0, -4, 0)), (96, 64))) < 0.97)
    np.testing.assert_allclose(got["Combined"][inner][:, :3].mean(0), color * world, rtol=1e-3)
    np.testing.assert_allclose(got["Combined"][inner][:, 0], 0.1, rtol=1 / 16 + 1e-6)
    np.testing.assert_array_equal(got["Combined"][0, 0], np.float32([*world, 1]))


def test_a_white_body_vanishes_in_the_furnace(sphere):
    matrix = np.diag([1.2, -0.5, 0.9, 1.0])
    got = render(camera((0, -4, 0)), [one(sphere, matrix)], world=(1, 1, 1), samples=32)
    assert np.abs(got["Combined"] - 1).max() <= 1 / 32 + 1e-6  # one ray in 32 at most
    assert np.abs(got["Combined"] - 1).mean() < 1e-3


def test_the_world_is_dimmed_under_a_sphere_by_its_form_factor(sphere, floor):
    cam = camera((0, 0, 9), size=(24, 24), width=4, kind="orthographic")
    body = one(sphere, at(0, 0, 1.6), visible_camera=False)
    got = render(cam, [one(floor), body], world=(1, 1, 1), samples=512, size=(24, 24))
    away = np.array([0, 0, 1.6]) - got["Position"]
    distance = np.linalg.norm(away, axis=-1)
    want = 1 - (away[..., 2] / distance) / distance**2  # the sphere is wholly above the floor
    assert want.min() < 0.65
    error = got["Combined"][..., 0] - want
    assert np.abs(error).max() < 0.04  # 512 low-discrepancy samples
    assert abs(error.mean()) < 0.002
    free = render(
        cam, [one(floor), replace(body, visible_diffuse=False)], world=(1, 1, 1), size=(24, 24)
    )
    assert (free["Combined"] == 1).all()


def test_from_inside_a_solid_its_walls_are_lit_by_what_is_inside(sphere):
    cam = camera((0, -0.5, 0), (0, 1, 0), width=1.5)
    place = np.array([0.3, -0.2, 0.4])
    inside = leapray.Light("point", [np.pi] * 3, position=place)
    outside = leapray.Light("sun", [np.pi] * 3, direction=unit(0, 1, 0.2))
    room, other = one(sphere), one(sphere, at(x=2.5))
    got = render(cam, [room, other], [inside, outside], world=(1, 1, 1))
    o, d = centre_rays(cam, (96, 64))
    point = o + meet_sphere(o, d, far=True)[..., None] * d
    to_light = place - point
    distance = np.linalg.norm(to_light, axis=-1)
    want = -(point * to_light).sum(-1) / distance**3
    np.testing.assert_allclose(got["Combined"][..., 0], want, rtol=0.01)
    assert ((got["Normal"] * point).sum(-1) < -0.999).all()
    dark = render(cam, [room, other], [outside], world=(1, 1, 1))
    assert not dark["Combined"][..., :3].any()
