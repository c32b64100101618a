# SPDX-License-Identifier: GPL-3.0-or-later
"""Instances that emit and absorb among surfaces, against closed forms of boxes and slabs."""

from __future__ import annotations

import numpy as np
import pytest
from stage import IDENTITY, at, one, slab

import leapray
from leapray import Camera, Light, Lobe, Material, World

THICK, SIGMA = 2.0, 0.7
DARK = (0.0, 0.0, 0.0)
RED, BLUE = np.array([0.8, 0.2, 0.1]), np.array([0.1, 0.3, 0.9])
WHITE = Material([Lobe("diffuse", (1.0, 1.0, 1.0))])
MIRROR = Material([Lobe("glossy", (1.0, 1.0, 1.0))])
LAMP = Material([Lobe("emission", (2.0, 1.0, 0.5))])
VEIL = Material([Lobe("transparent", (0.5, 0.5, 0.5))])


def cloud(color=RED, sigma=SIGMA, emission=None, size=THICK, traverser="cd"):
    """A cube of one value about the origin."""
    matrix = np.diag([size / 4] * 3 + [1])
    matrix[:3, 3] = -size / 2
    grid = leapray.ScalarGrid("fog", np.ones((5, 5, 5), np.float32), matrix)
    look = leapray.TransferFunction([0.5, 1.5], [sigma, sigma], color, emission)
    return leapray.build(leapray.visible_volume(grid, look), traverser)


def camera(z=9.0, width=1.0):
    """Parallel rays down from z, 4 x 4 pixels."""
    pixel = width / 4
    corner = (-width / 2, -width / 2, 0)
    return Camera("orthographic", (0, 0, z), (0, 0, -1), corner, (pixel, 0, 0), (0, pixel, 0))


def render(instances, materials=(WHITE,), lights=(), world=(0, 0, 0), cam=None, **more):
    """RGBA of the 4 x 4 pixels, (16, 4)."""
    transparent = more.pop("transparent", False)
    slots, given = range(len(materials)), (list(materials), World(world), transparent)
    scene = leapray.Scene(cam or camera(), instances, lights, given[0], slots, given[1], given[2])
    got = scene.render_tile(0, 0, 4, 4, **{"samples": 1, **more})["Combined"]
    assert np.isfinite(got).all()
    return got.reshape(-1, 4).astype(float)


def wall(z, material=0, **more):
    """An opaque slab whose upper face is at z."""
    return one(leapray.build(slab(z), "cd"), first_material=material, **more)


def fades(depth, sigma=SIGMA):
    return np.exp(-sigma * depth)


@pytest.mark.parametrize("traverser", ["aw", "cd", "pyramid", "hdda"])
def test_a_box_dims_the_world_and_glows(traverser):
    got = render([one(cloud(traverser=traverser))], world=(0.3, 0.6, 0.9))
    expected = RED * (1 - fades(THICK)) + np.array([0.3, 0.6, 0.9]) * fades(THICK)
    assert np.abs(got[:, :3] - expected).max() < 2e-7


def test_what_only_emits_adds_its_depth():
    got = render([one(cloud(sigma=0.0, emission=(0.1, 0.2, 0.3)))], world=(0.5, 0.5, 0.5))
    assert np.abs(got[:, :3] - (0.5 + THICK * np.array([0.1, 0.2, 0.3]))).max() < 2e-7


def test_scale_of_an_instance_scales_its_depth_in_its_own_space_alone():
    big = np.diag([3.0, 3.0, 3.0, 1.0])
    got = render([one(cloud(), big)], world=(1, 1, 1))
    assert np.abs(got[:, :3] - (RED * (1 - fades(THICK)) + fades(THICK))).max() < 2e-7


@pytest.mark.parametrize("unit", [0.5, 1.0, 4.0])
def test_a_unit_of_the_world_may_be_what_extinction_is_for(unit):
    stretched = np.diag([1.0, 2.0, 3.0, 1.0])
    got = render([one(cloud(emission=(0.1, 0.1, 0.1)), stretched, volume_unit=unit)])
    left = fades(3 * THICK / unit)
    glow = 0.1 / SIGMA * (1 - left)
    assert np.abs(got[:, :3] - (RED * (1 - left) + glow)).max() < 2e-6


def test_the_last_ray_of_a_path_still_meets_what_glows():
    glow = one(cloud(sigma=0.0, emission=(1.0, 1.0, 1.0)), visible_camera=False)
    more = dict(samples=256, max_bounces=4)
    last, deep = (
        render([wall(-1.5), glow], diffuse_bounces=n, **more)[:, :3].mean() for n in (0, 1)
    )
    assert last > 0.2
    assert abs(deep - last) < 0.01


def test_nothing_is_seen_through_what_is_as_dense_as_a_wall():
    got = render([wall(-3), one(cloud(sigma=1e6))], world=(1, 1, 1), diffuse_bounces=4)
    assert np.abs(got[:, :3] - RED).max() < 1e-6


@pytest.mark.parametrize("z", [-4.0, -0.4, 0.6, 4.0])
def test_surfaces_lie_before_within_and_behind(z):
    depth = np.clip(THICK / 2 - z, 0, THICK)
    got = render([wall(z), one(cloud())], [LAMP])
    expected = RED * (1 - fades(depth)) + np.array([2.0, 1.0, 0.5]) * fades(depth)
    assert np.abs(got[:, :3] - expected).max() < 1e-6


def test_the_camera_may_be_inside():
    got = render([one(cloud())], world=(1, 1, 1), cam=camera(0.25))
    depth = THICK / 2 + 0.25
    assert np.abs(got[:, :3] - (RED * (1 - fades(depth)) + fades(depth))).max() < 1e-6


def test_alpha_is_what_is_absorbed():
    got = render([one(cloud())], world=(1, 1, 1), transparent=True)
    assert np.abs(got[:, 3] - (1 - fades(THICK))).max() < 1e-6
    assert np.abs(got[:, :3] - RED * (1 - fades(THICK))).max() < 1e-6


def test_shadows_are_as_deep_as_the_volume_is_thick():
    sun = Light("sun", (np.pi, np.pi, np.pi), direction=(0, 0, 1))
    dark = dict(visible_camera=False)
    got = render([wall(-3), one(cloud(DARK), **dark)], lights=[sun])
    assert np.abs(got[:, :3] - fades(THICK)).max() < 1e-6
    unseen = one(cloud(DARK), visible_camera=False, visible_shadow=False)
    assert np.abs(render([wall(-3), unseen], lights=[sun])[:, :3] - 1).max() < 1e-6


def test_shadows_through_glassy_surfaces_and_volumes_multiply():
    sun = Light("sun", (np.pi, np.pi, np.pi), direction=(0, 0, 1))
    pane = wall(0.0, 1, visible_camera=False)  # two faces, each lets half through
    got = render([wall(-3), pane, one(cloud(DARK), visible_camera=False)], [WHITE, VEIL], [sun])
    assert np.abs(got[:, :3] - 0.25 * fades(THICK)).max() < 1e-6


def test_a_point_light_within_is_dimmed_by_the_part_before_it():
    light = Light("point", (np.pi, np.pi, np.pi), position=(0, 0, 0))
    got = render(
        [wall(-3), one(cloud(DARK), visible_camera=False)], lights=[light], cam=camera(width=1e-3)
    )
    assert np.abs(got[:, :3] - fades(THICK / 2) / 9).max() < 1e-6


def test_lights_with_extent_are_seen_through_it():
    lamp = Light(
        "area", (2, 2, 2), position=(0, 0, -3), direction=(0, 0, 1), axis_u=(4, 0, 0),
        axis_v=(0, 4, 0), shape="rectangle", angle=np.pi, visible_camera=True,
    )  # fmt: skip
    got = render([one(cloud())], lights=[lamp])
    assert np.abs(got[:, :3] - (RED * (1 - fades(THICK)) + 2 * fades(THICK))).max() < 1e-6


def test_a_mirror_shows_the_light_that_the_ray_has_passed_twice():
    got = render([wall(-2), one(cloud())], [MIRROR], world=(1, 1, 1))
    expected = RED * (1 - fades(2 * THICK)) + fades(2 * THICK)
    assert np.abs(got[:, :3] - expected).max() < 1e-5


def test_volumes_apart_come_one_after_the_other():
    for up in (3.0, -3.0):
        got = render([one(cloud()), one(cloud(BLUE, 0.4), at(0, 0, up))], world=(1, 1, 1))
        near, far = ((BLUE, 0.4), (RED, SIGMA)) if up > 0 else ((RED, SIGMA), (BLUE, 0.4))
        expected = near[0] * (1 - fades(THICK, near[1])) + fades(THICK, near[1]) * (
            far[0] * (1 - fades(THICK, far[1])) + fades(THICK, far[1])
        )
        assert np.abs(got[:, :3] - expected).max() < 1e-6


@pytest.mark.parametrize("shift", [0.0, 0.7])
@pytest.mark.parametrize("sigma", [0.4, 30.0])
def test_volumes_that_overlap_add_up_at_every_point(shift, sigma):
    got = render([one(cloud()), one(cloud(BLUE, sigma), at(0, 0, shift))], world=(1, 1, 1))
    parts = [(BLUE, sigma, shift), ((SIGMA * RED + sigma * BLUE) / (SIGMA + sigma), SIGMA + sigma,
             THICK - shift), (RED, SIGMA, shift)]  # fmt: skip
    expected, left = np.zeros(3), 1.0
    for color, extinction, depth in parts:
        expected += left * color * (1 - fades(depth, extinction))
        left *= fades(depth, extinction)
    assert np.abs(got[:, :3] - (expected + left)).max() < 2e-4


def test_three_that_overlap_do_not_depend_on_their_order():
    three = [one(cloud()), one(cloud(BLUE, 0.4)), one(cloud((0.2, 0.9, 0.2), 1.1))]
    pictures = [render([three[i] for i in order]) for order in ([0, 1, 2], [2, 0, 1], [1, 2, 0])]
    total = SIGMA + 0.4 + 1.1
    mixed = (SIGMA * RED + 0.4 * BLUE + 1.1 * np.array([0.2, 0.9, 0.2])) / total
    for got in pictures:
        assert np.abs(got[:, :3] - mixed * (1 - fades(THICK, total))).max() < 2e-4


def test_pictures_are_equal_to_the_bit_whatever_leaps():
    rng = np.random.default_rng(5)
    grid = leapray.ScalarGrid(
        "noise", rng.random((12, 12, 12), np.float32), np.diag([0.2] * 3 + [1])
    )
    look = leapray.TransferFunction([0.6, 1.0], [0.0, 5.0], RED)
    volume = leapray.visible_volume(grid, look)
    pictures = [
        render([one(leapray.build(volume, t.name), at(-1, -1, -1))], world=(1, 1, 1), samples=16)
        for t in leapray.traversers()
        if t.exact
    ]
    assert pictures[0][:, :3].std() > 0.01
    for got in pictures[1:]:
        assert (got == pictures[0]).all()


def test_what_has_no_surface_cannot_be_cut_or_held_out():
    ball = leapray.build(slab(0.0), "cd").volume
    with pytest.raises(leapray.LeapRayError, match="volume unit of instance 0"):
        render([one(cloud(), volume_unit=-1.0)])
    for more in ({"holdout": True}, {"clips": [leapray.Clip(ball, IDENTITY)]}):
        with pytest.raises(leapray.LeapRayError, match="instance 0 has a transfer function"):
            render([one(cloud(), **more)])
