# SPDX-License-Identifier: GPL-3.0-or-later
"""Restarts of rays: wrong pixels are counted, and there are none, whatever the unit of length.

A ray that met its own surface again, or slipped through one, would exceed the
limit of bounces that its picture is rendered with, and find black or white
where the other is due.
"""

from __future__ import annotations

import numpy as np
import pytest
from stage import FAR, ball, camera, centre_rays, clearance, meet_sphere, one, unit

import leapray
from leapray import Light, Lobe, Material, World

ALL = (1.0, 1.0, 1.0)
SIZE = (192, 128)
SCALES = (1e-3, 1.0, 1e3)

# What shows the plain colour of the world if, and only if, every ray meets what it should.
THINGS = {
    "diffuse": (Lobe("diffuse", ALL), dict(samples=64, diffuse_bounces=0)),
    "mirror": (Lobe("glossy", ALL, roughness=0.0), dict(glossy_bounces=0)),
    "refraction": (Lobe("refraction", ALL, ior=1.5), dict(transmission_bounces=1)),
    "transparent": (Lobe("transparent", ALL), dict(transparent_bounces=1)),
}


def scaled(s):
    return np.diag([s, s, s, 1.0])


def picture(structure, scale, lobe, eye, *, width=0.8, lights=(), world=ALL, **more):
    cam = camera(np.array(eye) * scale, size=SIZE, width=width)
    things = [one(structure, scaled(scale))]
    scene = leapray.Scene(cam, things, lights, [Material([lobe])], [0], World(world))
    return scene.render_tile(0, 0, *SIZE, **({"samples": 4} | more))


def n_wrong(got, where, want=1.0):
    return int((np.abs(got["Combined"][where][:, :3] - want) > 1e-6).any(-1).sum())


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("radius", [8.0, 25.6])
@pytest.mark.parametrize("name", THINGS)
def test_a_ball_has_no_wrong_pixel(name, radius, scale):
    lobe, setting = THINGS[name]
    eye = (0.3, -4, 0.2)
    inner = clearance(*centre_rays(camera(eye, size=SIZE), SIZE)) < 1 - 0.5 / radius
    got = picture(leapray.build(ball(radius)), scale, lobe, eye, **setting)
    assert inner.mean() > 0.4
    assert n_wrong(got, inner) == 0


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("height", [0.0, 0.25, 0.5])
@pytest.mark.parametrize("name", THINGS)
def test_a_plate_has_no_wrong_pixel_though_its_face_lies_in_the_lattice(name, height, scale):
    rows = np.clip(0.5 + (8.0 + height - np.arange(14)) / 5, 0, 1).astype(np.float32)
    matrix = scaled(0.125)
    matrix[:3, 3] = -2, -2, -1
    field = np.broadcast_to(rows[:, None, None], (14, 33, 33))
    plate = leapray.build(leapray.Volume(field, object_from_index=matrix))
    lobe, setting = THINGS[name]
    got = picture(plate, scale, lobe, (0.3, -2, 3), width=0.4, **setting)
    assert (got["Depth"] < FAR).all()
    assert n_wrong(got, np.ones(got["Depth"].shape[:2], bool)) == 0


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("shift", [0.0, 0.13, 0.5])
@pytest.mark.parametrize("wall", [1.2, 3.0])
def test_no_light_comes_into_a_closed_room(wall, shift, scale):
    """A hollow box with thin walls and sharp edges, in glaring light."""
    n = 40
    z, y, x = np.mgrid[:n, :n, :n] - (n - 1) / 2 + shift
    half = n / 2 - 8
    out = np.maximum(np.maximum(abs(x), abs(y)), abs(z)) - half
    field = np.clip(0.5 + (wall / 2 - abs(out)) / 5, 0, 1).astype(np.float32)
    matrix = scaled(1 / half)
    matrix[:3, 3] = (shift - (n - 1) / 2) / half
    room = leapray.build(leapray.Volume(field, object_from_index=matrix))
    lights = [
        Light("sun", (1e3,) * 3, direction=unit(0.3, 0.5, 0.7), angle=0.2),
        Light("point", (1e3 * scale**2,) * 3, position=np.array([2.0, 2, 2]) * scale),
    ]
    setting = dict(lights=lights, world=(10, 10, 10), diffuse_bounces=4, branches=4, width=1.6)
    white = Lobe("diffuse", (0.8, 0.8, 0.8))
    got = picture(room, scale, white, (0.3, -0.5, 0.2), **setting)
    assert (got["Depth"] < FAR).all()
    assert n_wrong(got, np.ones(got["Depth"].shape[:2], bool), want=0.0) == 0


@pytest.mark.parametrize("scale", SCALES)
def test_the_terminator_of_a_ball_has_no_steps(scale, sphere):
    light, eye = unit(2, -1, 1), (0, -4, 0)
    sun = Light("sun", [np.pi] * 3, direction=light)
    white = Lobe("diffuse", ALL)
    got = picture(sphere, scale, white, eye, lights=[sun], world=(0, 0, 0), samples=1)
    o, d = centre_rays(camera(eye, size=SIZE), SIZE)
    inner = clearance(o, d) < 0.95
    cosine = ((o + meet_sphere(o, d)[..., None] * d) * light).sum(-1)
    wrong = np.abs(got["Combined"][..., 0] - np.maximum(cosine, 0)) > 0.002
    assert (np.abs(cosine[inner]) < 0.1).mean() > 0.05
    assert not wrong[inner].any()


def tube(segments=96, outer=1.0, inner=0.86, half=0.7):
    """A pipe along z as a closed mesh, counter-clockwise from outside."""
    angle = np.arange(segments) / segments * 2 * np.pi
    ring = np.stack([np.cos(angle), np.sin(angle)], -1)
    profile = [(outer, -half), (outer, half), (inner, half), (inner, -half)]
    rows = [np.column_stack([r * ring, np.full(segments, z)]) for r, z in profile]
    here, there = np.arange(segments), np.roll(np.arange(segments), -1)
    faces = []
    for k in range(4):
        a, b = k * segments, (k + 1) % 4 * segments
        faces += [np.stack([a + here, a + there, b + there], -1)]
        faces += [np.stack([a + here, b + there, b + here], -1)]
    return np.concatenate(rows), np.concatenate(faces).astype(np.int32)


@pytest.mark.parametrize("name", ["transparent", "refraction"])
def test_a_pipe_of_glass_with_walls_of_two_voxels_has_no_wrong_pixel(name):
    """Most of its cells keep their triangles, and rays leave them into cells that do not.

    Four surfaces, and one pair more where samples round off a rim.
    """
    vertices, triangles = tube()
    turn, _ = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))
    if np.linalg.det(turn) < 0:
        turn = -turn
    volume = leapray.voxelize(vertices @ turn.T, triangles, 0.07, kind="solid", exact="all")
    assert volume.info.n_triangle_cells > 100
    pipe = leapray.build(volume)
    limit = {"transparent": "transparent_bounces", "refraction": "transmission_bounces"}[name]
    lobe = Lobe(name, ALL, ior=1.0)
    got = picture(pipe, 1.0, lobe, (0.3, -4, 0.2), samples=16, **{limit: 5})
    assert (got["Depth"] < FAR).mean() > 0.1
    assert n_wrong(got, np.ones(got["Depth"].shape[:2], bool)) == 0
