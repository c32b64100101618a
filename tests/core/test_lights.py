# SPDX-License-Identifier: GPL-3.0-or-later
"""Lights and surroundings: what arrives, and whether sampling and meeting them agree."""

import numpy as np
import pytest
from shading import hit_light, look_at_world, r_sequence, sample_light, sample_world, sphere_grid

from leapray import Light, World

U = r_sequence(1 << 15, 2)
AT = np.array([0.3, -0.2, 2.0])
DOWN = np.array([0.1, -0.2, -1.0]) / np.linalg.norm([0.1, -0.2, -1.0])
SIDE = np.cross(DOWN, (1, 0, 0)) / np.linalg.norm(np.cross(DOWN, (1, 0, 0)))
OTHER = np.cross(SIDE, DOWN)
AREA = dict(position=AT, direction=DOWN, axis_u=0.8 * SIDE, axis_v=0.5 * OTHER, angle=np.pi)
LIGHTS = {
    "sun": Light("sun", (3, 2, 1), direction=-DOWN, angle=0.4),
    "disc": Light("point", (3, 2, 1), AT, radius=0.5, shape="disc"),
    "sphere": Light("point", (3, 2, 1), AT, radius=0.5, shape="sphere"),
    "spot": Light("spot", (3, 2, 1), AT, DOWN, radius=0.3, angle=0.9, blend=0.5, shape="sphere"),
    "soft spot": Light("spot", (3, 2, 1), AT, DOWN, radius=0.3, angle=0.9, blend=0.5),
    "rectangle": Light("area", (3, 2, 1), shape="rectangle", **AREA),
    "ellipse": Light("area", (3, 2, 1), shape="ellipse", **AREA),
    "narrow": Light("area", (3, 2, 1), shape="rectangle", **AREA | dict(angle=1.0)),
}
ORIGIN = np.zeros(3)


def irradiance(light, p=ORIGIN, normal=(0, 0, 1)):
    """Of a surface at p: from the light's own samples, (3,)."""
    rays = sample_light(light, p, U)
    with np.errstate(invalid="ignore", divide="ignore"):
        each = rays["color"] * np.maximum(rays["direction"] @ normal, 0)[:, None]
        return np.where(rays["pdf"][:, None] > 0, each / rays["pdf"][:, None], 0).mean(0)


@pytest.mark.parametrize("name", LIGHTS)
def test_a_light_is_met_where_it_was_sampled(name):
    light = LIGHTS[name]
    rays = sample_light(light, ORIGIN, U[:4096])
    seen = rays["pdf"] > 0
    assert seen.mean() > 0.3
    found = hit_light(light, ORIGIN, rays["direction"][seen])
    met = found["pdf"] > 0
    assert met.mean() > 0.999  # but for rims
    for part in ("distance", "color", "pdf"):
        np.testing.assert_allclose(found[part][met], rays[part][seen][met], rtol=1e-6)
    assert not rays["delta"].any()
    np.testing.assert_allclose(np.linalg.norm(rays["direction"][seen], axis=1), 1, rtol=1e-12)


@pytest.mark.parametrize("name", LIGHTS)
def test_what_rays_meet_is_what_samples_bring(name):
    light = LIGHTS[name]
    d, solid = sphere_grid(1500)
    up = d[d[:, 2] > 0]
    found = hit_light(light, ORIGIN, up)
    want = (found["color"] * up[:, 2:]).sum(0) * solid
    assert want[0] > 0.01
    np.testing.assert_allclose(irradiance(light), want, rtol=0.015)  # the grid's rims
    if "spot" not in name and name != "narrow":  # whose dark parts are sampled, too
        assert found["pdf"].sum() * solid == pytest.approx(1, rel=0.01)


@pytest.mark.parametrize("angle", [0.0, 0.01, 0.5, 2.0, np.pi])
def test_a_sun_gives_its_irradiance_whatever_its_angle(angle):
    sun = Light("sun", (3, 2, 1), direction=(0, 0, 1), angle=angle)
    np.testing.assert_allclose(irradiance(sun), (3, 2, 1), rtol=1e-3)
    assert sample_light(sun, ORIGIN, U[:1])["delta"][0] == (angle == 0)


def test_round_lights_give_what_the_formulas_say():
    distance, r = 2.0, 0.7
    for shape, square in (("sphere", distance**2), ("disc", distance**2 + r**2)):
        light = Light("point", (3, 2, 1), (0, 0, distance), radius=r, shape=shape)
        np.testing.assert_allclose(irradiance(light), np.divide((3, 2, 1), square), rtol=1e-3)
    point = Light("point", (3, 2, 1), (0, 0, distance))
    np.testing.assert_allclose(irradiance(point), np.divide((3, 2, 1), distance**2), rtol=1e-12)
    assert not hit_light(point, ORIGIN, np.array([[0, 0, 1.0]]))["pdf"].any()


def test_inside_a_sphere_light_it_lights_from_all_around():
    light = Light("point", (np.pi,) * 3, (0.1, 0.2, 0.1), radius=1.0, shape="sphere")
    np.testing.assert_allclose(irradiance(light), np.pi, rtol=5e-3)  # radiance 1


def test_a_rectangle_gives_what_its_edges_say():
    light = Light("area", (1, 1, 1), (0, 0, 1.5), (0, 0, -1), (1.2, 0, 0), (0, 0.6, 0),
                  angle=np.pi, shape="rectangle")  # fmt: skip
    corners = np.array([(-0.6, -0.3, 1.5), (0.6, -0.3, 1.5), (0.6, 0.3, 1.5), (-0.6, 0.3, 1.5)])
    p = np.array([0.4, 0.2, 0])
    v = (corners - p) / np.linalg.norm(corners - p, axis=1)[:, None]
    w = np.roll(v, -1, 0)
    cross = np.cross(v, w)
    edges = np.arccos((v * w).sum(1)) * cross[:, 2] / np.linalg.norm(cross, axis=1)
    assert irradiance(light, p)[0] == pytest.approx(abs(edges.sum()) / 2, rel=1e-3)  # Lambert
    behind = irradiance(light, (0, 0, 3.0), (0, 0, -1))
    assert not behind.any()


@pytest.mark.parametrize("height", [1e-3, 0.05, 0.5, 5.0, 300.0])
def test_a_rectangle_is_sampled_evenly_as_it_is_seen(height):
    """Whatever its distance a few samples tell its light, and all lie on it."""
    u, v = np.array([1.2, 0.3, 0]), np.array([-0.15, 0.6, 0])
    light = Light("area", (1, 1, 1), (0, 0, height), (0, 0, -1), u, v,
                  angle=np.pi, shape="rectangle")  # fmt: skip
    for p in (np.zeros(3), np.array([0.9, 0.2, 0]), np.array([-0.2, 3.0, 0])):
        rays = sample_light(light, p, U)
        at = (p + rays["distance"][:, None] * rays["direction"] - (0, 0, height)) @ np.array(
            [u, v]
        ).T
        assert np.abs(at / [u @ u, v @ v]).max() < 0.5 + 1e-9
        assert (rays["pdf"] > 0).all()
        each = rays["color"][:, 0] / rays["pdf"]  # as a surface sees it that faces all directions
        far = each.mean() < 1e-4  # there the area will do
        assert each.std() < (0.25 if far else 0.02) * each.mean()


def test_a_narrow_spread_keeps_the_power():
    angles = (np.arange(2000) + 0.5) / 2000 * np.pi / 2
    below = np.stack([np.sin(angles), 0 * angles, -np.cos(angles)], -1)
    for spread in (0.1, 0.3, 1.0, 2.5, np.pi):
        light = Light("area", (1, 1, 1), (0, 0, 0), (0, 0, -1), (1e-3, 0, 0), (0, 1e-3, 0),
                      angle=spread, shape="ellipse")  # fmt: skip
        seen = np.array([hit_light(light, p, -p[None])["color"][0, 0] for p in below])
        power = 2 * np.pi * (seen * np.sin(angles) * np.cos(angles)).sum() * (angles[1] - angles[0])
        assert power == pytest.approx(np.pi, rel=1e-3)
        assert seen[0] == pytest.approx(seen.max())
        assert not seen[angles > spread / 2].any()


def test_a_spot_fades_within_its_blend_and_ends_at_its_cone():
    angles = np.linspace(0, 0.8, 200)
    place = np.stack([np.sin(angles), 0 * angles, -np.cos(angles)], -1)
    for blend in (0.0, 0.3, 1.0):
        spot = Light("spot", (1, 1, 1), (0, 0, 0), (0, 0, -1), angle=1.0, blend=blend)
        got = np.array([irradiance(spot, p, -p)[0] for p in place])
        edge = np.cos(0.5)
        with np.errstate(divide="ignore"):
            x = np.clip((np.cos(angles) - edge) / ((1 - edge) * blend), 0, 1)
        np.testing.assert_allclose(got, x * x * (3 - 2 * x), atol=1e-9)


# ---- the world -------------------------------------------------------------


def picture(seed=3, h=24, w=48):
    """Noise, a dark half, and a sun of one texel."""
    pixels = np.random.default_rng(seed).random((h, w, 3)).astype(np.float32)
    pixels[:, : w // 2] = 0
    pixels[17, 9] = 4000, 3000, 2000
    return pixels


TURN = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]


def test_a_plain_world_has_its_colour_and_is_not_sampled():
    world = World((1, 2, 3))
    d, _ = sphere_grid(4)
    assert (look_at_world(world, d)["color"] == (1, 2, 3)).all()
    assert not sample_world(world, U[:16])["pdf"].any()
    assert not look_at_world(world, d)["pdf"].any()


def test_an_image_lies_round_the_world_as_blender_puts_it():
    """Longitude falls from left to right, the middle shows +X, the lowest row -Z. Above the
    highest row comes the lowest again, as in Cycles."""
    h, w = 16, 32
    pixels = np.zeros((h, w, 3), np.float32)
    pixels[..., 0], pixels[..., 1] = np.arange(w), np.arange(h)[:, None]
    world = World((1, 1, 1), pixels)
    eps = 1e-9
    d = np.array([(1, 0, 0), (0, 1, 0), (0, -1, 0), (-1, -eps, 0), (0, 0, 1), (0, 0, -1)], float)
    got = look_at_world(world, d)["color"]
    np.testing.assert_allclose(got[:3, 0], [15.5, 7.5, 23.5])
    np.testing.assert_allclose(got[3, 0], (0 + 31) / 2, atol=1e-6)  # the seam
    np.testing.assert_allclose(got[:, 1], np.full(6, 7.5))
    poles = np.array([(0, 0.1, 1), (0, 0.1, -1)]) / np.sqrt(1.01)
    np.testing.assert_allclose(look_at_world(world, poles)["color"][:, 1], [15, 0], atol=0.02)
    turned = look_at_world(World((1, 1, 1), pixels, TURN), d[:3])["color"]
    np.testing.assert_allclose(turned, look_at_world(world, d[:3] @ TURN.T)["color"])


@pytest.mark.parametrize("turn", [np.eye(3), TURN])
def test_the_world_is_sampled_as_densely_as_is_said(turn):
    world = World((0.5, 1, 2), picture(), turn)
    rays = sample_world(world, U)
    assert (rays["pdf"] > 0).all()
    same = look_at_world(world, rays["direction"])
    agree = np.isclose(same["pdf"], rays["pdf"], rtol=1e-3)
    assert agree.mean() > 0.9999  # but for rounding at the texels' edges
    np.testing.assert_allclose(same["color"], rays["color"], rtol=1e-6, atol=1e-6)
    d, solid = sphere_grid(600)
    all_around = look_at_world(world, d)
    assert all_around["pdf"].sum() * solid == pytest.approx(1, rel=0.015)  # the sun is small
    # no light without density; evenly spread rays would scatter by 40 times the mean
    lit = all_around["color"].sum(1) > 0
    assert (all_around["pdf"][lit] > 0).all()
    weights = rays["color"] / rays["pdf"][:, None]
    np.testing.assert_allclose(weights.mean(0), all_around["color"].sum(0) * solid, rtol=0.02)
    assert weights.sum(1).std() < 1.2 * weights.sum(1).mean()


def test_a_black_image_is_sampled_without_harm():
    rays = sample_world(World((1, 1, 1), np.zeros((4, 8, 3), np.float32)), U[:64])
    assert not rays["color"].any()
    assert np.isfinite(rays["pdf"]).all()
    one = World((1, 1, 1), np.ones((1, 1, 3), np.float32))
    np.testing.assert_allclose(sample_world(one, U[:64])["pdf"], 1 / (4 * np.pi), rtol=1e-4)
