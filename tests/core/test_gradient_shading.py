# SPDX-License-Identifier: GPL-3.0-or-later
"""Volumes shaded by their gradient: against Lambert's law, integrals along rays, furnaces, and
pictures without it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from shading import Hybrid, Phase, r_sequence, sphere_grid
from stage import at, one
from test_render_scattering import DARK, camera, noise, phase, render, sun

import leapray
from leapray import Camera, Light, World, _abi

VIEW = np.array([0.3, -0.5, 0.8]) / np.linalg.norm([0.3, -0.5, 0.8])
ISOTROPIC = _abi.LR_PHASE_HENYEY_GREENSTEIN, 0.0
COLOR = np.array([1.0, 0.6, 0.2])
SURE = dict(gradient_shading=1.0, gradient_scale=1e9)  # all is a surface
MATT = dict(specular=0.0)
FURNACE = dict(max_bounces=1024, volume_bounces=1024, samples=512)


def ball(sigma=200.0, rise=0.02, albedo=(1, 1, 1), n=49, side=2.4, bend=None, falls=False):
    """A ball of radius 1 whose value is 1 - radius, of extinction 0 outside, which grows to sigma
    over `rise`. bend: what else is done to the values; falls: their signs are turned."""
    z, y, x = np.mgrid[:n, :n, :n] * (side / (n - 1)) - side / 2
    values = 1 - np.sqrt(x * x + y * y + z * z)
    values = values if bend is None else bend(values, x, y, z)
    matrix = np.diag([side / (n - 1)] * 3 + [1])
    matrix[:3, 3] = -side / 2
    grid = leapray.ScalarGrid("ball", values.astype(np.float32), matrix)
    extinction = np.array([0.0, 0.0, sigma, sigma])
    scattering = extinction[:, None] * np.broadcast_to(albedo, 3)
    knots = np.array([-3, 0, rise, 3])
    if falls:
        grid = dataclasses.replace(grid, samples=-grid.samples)
        knots, extinction, scattering = -knots[::-1], extinction[::-1], scattering[::-1]
    look = leapray.TransferFunction(knots, extinction, DARK, None, scattering)
    return leapray.build(leapray.visible_volume(grid, look), "cd")


def ramp(sigma=0.7, albedo=(1, 1, 1), slope=0.25, n=5, lowest=0):
    """A cube of side 2 about the origin of even extinction, whose value rises along x."""
    values = np.broadcast_to(1 + slope * np.linspace(-1, 1, n), (n, n, n)).copy()
    values[..., :lowest] = np.nan
    matrix = np.diag([2 / (n - 1)] * 3 + [1])
    matrix[:3, 3] = -1
    grid = leapray.ScalarGrid("ramp", values.astype(np.float32), matrix)
    look = leapray.TransferFunction([0.0], [sigma], DARK, None, [sigma * np.array(albedo)])
    return leapray.build(leapray.visible_volume(grid, look), "cd")


def picture(instances, lights, n=9, width=1.6, **more):
    """(n * n, 3), seen from above."""
    pixel, corner = width / n, (-width / 2, -width / 2, 0)
    cam = Camera("orthographic", (0, 0, 9), (0, 0, -1), corner, (pixel, 0, 0), (0, pixel, 0))
    return render(instances, lights, cam=cam, place=(0, 0, n, n), **more)[:, :3]


def lambert(towards, flat=1.0, n=9, width=1.6, parts=16):
    """The cosine of a light of irradiance 1 over the pixels (n * n,) of a ball, by that factor as
    high as wide, and whether a pixel is well within it."""
    x = ((np.arange(n * parts) + 0.5) / (n * parts) - 0.5) * width
    x, y = np.meshgrid(x, x)
    z = np.sqrt(np.maximum(1 - x * x - y * y, 0)) / flat
    normal = np.stack([x, y, z], -1) / np.sqrt(x * x + y * y + z * z)[..., None]
    seen = np.maximum(normal @ towards, 0) / np.pi
    means = [
        each.reshape(n, parts, n, parts).mean((1, 3)).ravel() for each in (seen, x * x + y * y)
    ]
    return means[0], means[1] < 0.7


# ---- the response at a point ---------------------------------------------------------

SURFACES = [(0.3, 0.5, 0.5), (1.0, 0.2, 1.0), (1.0, 0.7, 0.0), (0.9, 1.0, 0.5)]


@pytest.mark.parametrize(("share", "roughness", "specular"), SURFACES)
@pytest.mark.parametrize("kind", [ISOTROPIC, (_abi.LR_PHASE_HENYEY_GREENSTEIN, 0.6)])
def test_samples_add_up_to_the_response_and_are_spread_as_its_density_says(
    share, roughness, specular, kind
):
    point = Hybrid(*kind, VIEW, share, COLOR, roughness, specular)
    directions, solid = sphere_grid(700)
    told = point.eval(directions)
    assert abs((told["pdf"] * solid).sum() - 1) < 0.07  # of rough facets it is about the density
    whole = (told["f_cos"] * solid).sum(0)
    got = point.sample(r_sequence(1 << 16, 3))
    assert (got["kind"][got["pdf"] > 0] == _abi.LR_RAY_VOLUME).all()
    assert np.abs(got["weight"].mean(0) / whole - 1).max() < 0.01
    half = got["direction"][:, 0] > 0  # and so does the light of each half of the sky
    part = (told["f_cos"] * solid)[directions[:, 0] > 0].sum(0)
    assert np.abs((got["weight"] * half[:, None]).mean(0) / part - 1).max() < 0.02


def test_what_is_scattered_in_white_is_all_of_it():
    directions, solid = sphere_grid(700)
    for share, roughness, specular in SURFACES:
        told = Hybrid(*ISOTROPIC, VIEW, share, (1, 1, 1), roughness, specular).eval(directions)
        assert np.abs((told["f_cos"] * solid).sum(0) - 1).max() < 0.01


def test_highlights_are_white_and_the_rest_has_its_color():
    mirrored = np.array([-VIEW[0], -VIEW[1], VIEW[2]])
    lights = np.stack([mirrored, [0.9, 0.1, 0.42]])
    glossy, matt = (
        Hybrid(*ISOTROPIC, VIEW, 1.0, COLOR, 0.2, specular).eval(lights)["f_cos"]
        for specular in (0.5, 0.0)
    )
    assert np.allclose(matt, matt[:, :1] * COLOR)
    highlight = glossy[0] - matt[0] * (glossy[1] / matt[1])  # less the base, which loses a little
    assert np.ptp(highlight) < 0.02 * highlight[0]
    assert highlight[0] > 3 * matt[0, 0]


def test_without_a_share_it_is_the_phase_function_to_the_bit():
    for kind in (ISOTROPIC, (_abi.LR_PHASE_RAYLEIGH, 0.0)):
        mixed, alone = Hybrid(*kind, VIEW, 0.0, (1, 1, 1), 0.5, 0.5), Phase(*kind, VIEW)
        u = r_sequence(100, 3)
        got, expected = mixed.sample(u), alone.sample(u[:, :2].copy())
        assert (got == expected).all()
        assert (mixed.eval(got["direction"]) == alone.eval(got["direction"])).all()


# ---- light -----------------------------------------------------------------------------


@pytest.mark.parametrize("normal", ["central", "analytic", "smooth", "sobel", "zucker_hummel"])
def test_a_ball_has_the_cosine_of_lambert(normal):
    """A sun that casts no shadows, on a skin of some thousandth of the radius."""
    towards = np.array([0.8, 0.0, 0.6])
    light = Light("sun", (1, 1, 1), direction=towards, casts_shadow=False)
    volume = one(ball(5000.0, 0.001, albedo=COLOR), **SURE, **MATT)
    got = picture([volume], [light], options={"normal": normal})
    expected, inside = lambert(towards)
    assert (expected[inside] == 0).any()
    # Facets, of a cell of 1/20 of the radius, have normals that are 0.03 off.
    most = 0.006 if normal == "analytic" else 0.002
    assert np.abs(got - expected[:, None] * COLOR)[inside].max() < most


def test_a_soft_ball_agrees_with_an_integral_along_rays():
    """Density, share and shadow differ along the ray; the integral takes small steps of a ball's
    own formulas."""
    sigma, rise, scale, g = 6.0, 0.5, 1.5, 0.4
    towards = np.array([0.0, 0.6, 0.8])
    wavy = ball(sigma, rise, n=97, bend=lambda v, *_: np.sign(v) * v * v)  # slope 2 sqrt(value)
    shaded = dict(gradient_shading=0.8, gradient_scale=scale, anisotropy=g, **MATT)

    def extinction(p):
        value = np.maximum(1 - np.linalg.norm(p, axis=-1), 0) ** 2
        return sigma * np.minimum(value / rise, 1)

    step = 0.005
    s = (np.arange(int(2.4 / step)) + 0.5) * step
    for x, y in ((0.1, 0.0), (0.0, -0.5), (0.3, 0.4)):
        volume = one(wavy, at(-x, -y), **shaded)
        seen = render([volume], [sun(*towards)], samples=8192, cam=camera(width=1e-4))
        p = np.stack([x + 0 * s, y + 0 * s, 1.2 - s], 1)
        there = extinction(p)
        before = np.cumsum(there) * step - there * step / 2
        way = p[:, None] + s[None, :, None] * towards
        shadow = extinction(way).sum(1) * step
        radius = np.linalg.norm(p, axis=1)
        slope = 2 * np.maximum(1 - radius, 0)
        share = 0.8 * (1 - np.exp(-scale * slope))
        normal = p / np.maximum(radius, 1e-9)[:, None]
        normal *= np.where(normal[:, 2] < 0, -1, 1)[:, None]
        lit = np.maximum(normal @ towards, 0) / np.pi
        response = (1 - share) * phase(-towards[2], g) + share * lit
        expected = (there * np.exp(-before - shadow) * response).sum() * step
        assert abs(seen[:, 0].mean() / expected - 1) < 0.01


def test_a_ramp_is_a_surface_by_its_share_of_one_normal():
    """Of even gradient: its share times the cosine, the rest isotropic, in closed form."""
    slope, scale, turn = 0.25, 3.0, np.radians(30)
    matrix = np.eye(4)  # the gradient, +x, turned towards the viewer
    matrix[:3, :3] = [[np.sin(turn), 0, np.cos(turn)], [0, 1, 0], [-np.cos(turn), 0, np.sin(turn)]]
    volume = one(ramp(1e-3, slope=slope), matrix.T, gradient_shading=0.9, gradient_scale=scale,
                 **MATT)  # fmt: skip
    lights = [Light("sun", (1, 1, 1), direction=(0, 0, sign)) for sign in (1.0, -1.0)]
    before, behind = (render([volume], [light], samples=256)[:, 0].mean() for light in lights)
    share = 0.9 * (1 - np.exp(-scale * slope))
    isotropic = (1 - share) / (4 * np.pi)
    assert abs(before / behind - (isotropic + share * np.cos(turn) / np.pi) / isotropic) < 0.02


def test_normals_are_those_of_the_stretched_object():
    """By the inverse transpose: a ball made flat is lit as the ellipsoid that it is."""
    flat = np.diag([1.0, 1.0, 0.4, 1.0])
    light = Light("sun", (1, 1, 1), direction=(0.6, 0, 0.8), casts_shadow=False)
    got = picture([one(ball(9000.0, 0.001), flat, **SURE, **MATT)], [light])[:, 0]
    expected, inside = lambert(np.array([0.6, 0, 0.8]), 0.4)
    assert np.abs(got - expected)[inside].max() < 0.003


def test_the_dense_side_may_have_the_smaller_values():
    light = Light("sun", (1, 1, 1), direction=(0.6, 0, 0.8), casts_shadow=False)
    pictures = [
        picture([one(ball(5000.0, 0.001, falls=falls), **SURE, **MATT)], [light], n=5)
        for falls in (False, True)
    ]
    assert np.abs(pictures[0] - pictures[1]).max() < 1e-3


# ---- energy, and where it falls back -------------------------------------------------------


@pytest.mark.parametrize("share", [0.5, 1.0])
@pytest.mark.parametrize(("roughness", "specular"), [(0.5, 0.0), (0.3, 0.5), (1.0, 1.0)])
def test_a_white_ball_in_a_white_furnace_is_not_seen(share, roughness, specular):
    volume = one(ball(5.0, 0.3), gradient_shading=share, gradient_scale=100.0,
                 roughness=roughness, specular=specular)  # fmt: skip
    got = render([volume], world=(1, 1, 1), cam=camera(width=1.5), **FURNACE)
    assert abs(got[:, :3].mean() - 1) < 0.006


@pytest.mark.parametrize(("roughness", "specular"), [(0.5, 0.0), (0.15, 1.0)])
def test_light_samples_and_scattered_rays_find_the_same_light(roughness, specular):
    """A world of one colour is met by rays alone, one with an image is sampled, too."""
    volume = one(ball(20.0, 0.2, albedo=COLOR), gradient_shading=0.8, gradient_scale=3.0,
                 roughness=roughness, specular=specular)  # fmt: skip
    image = np.full((4, 8, 3), 0.7, np.float32)
    worlds = [World((0.7, 0.7, 0.7)), World((1, 1, 1), image=image)]
    found = [
        render([volume], world=world, samples=4096, cam=camera(width=1.2))[:, :3].mean(0)
        for world in worlds
    ]
    assert np.abs(found[0] / found[1] - 1).max() < 0.005


@pytest.mark.parametrize(("roughness", "specular"), [(0.5, 0.0), (0.3, 1.0)])
def test_a_wide_sun_is_as_bright_as_points_of_it(roughness, specular):
    """Scattered rays and light samples meet the disc, light samples alone its points."""
    volume = one(ball(20.0, 0.2, albedo=COLOR), gradient_shading=0.8, gradient_scale=3.0,
                 roughness=roughness, specular=specular)  # fmt: skip
    half, n, towards = np.radians(30), 200, np.array([0.6, 0.0, 0.8])
    u = r_sequence(n, 2)
    cosine, turn = 1 - u[:, 0] * (1 - np.cos(half)), 2 * np.pi * u[:, 1]
    sine = np.sqrt(1 - cosine**2)
    aside, across = np.array([0.8, 0.0, -0.6]), np.array([0.0, 1.0, 0.0])
    points = (sine * np.cos(turn))[:, None] * aside + (sine * np.sin(turn))[:, None] * across
    points += cosine[:, None] * towards
    solid = 2 * np.pi * (1 - np.cos(half)) / (np.pi * np.sin(half) ** 2)  # for 1 on a plane
    parts = [Light("sun", (solid / n,) * 3, direction=point) for point in points]
    disc = Light("sun", (1, 1, 1), direction=towards, angle=2 * half)
    more = dict(cam=camera(width=1.2))
    both = render([volume], [disc], samples=4096, **more)[:, :3].mean(0)
    alone = render([volume], parts, samples=256, **more)[:, :3].mean(0)
    assert np.abs(both / alone - 1).max() < 0.02


def test_even_parts_scatter_by_the_phase_function():
    even = one(ramp(slope=0.0), anisotropy=0.5)
    shaded = one(ramp(slope=0.0), anisotropy=0.5, gradient_shading=1.0, gradient_scale=1e6)
    pictures = [render([v], [sun(0, 1, 1)], samples=16) for v in (even, shaded)]
    assert (pictures[0] == pictures[1]).all()


def test_beside_what_is_no_value_differences_are_one_sided():
    """At the lattice's border and beside numbers that are none, a ramp is a ramp."""
    light = Light("sun", (1, 1, 1), direction=(0.6, 0, 0.8), casts_shadow=False)
    for lowest in (0, 2):
        volume = ramp(0.05, slope=0.25, n=3 + lowest, lowest=lowest)
        shaded = one(volume, gradient_shading=1.0, gradient_scale=4.0, **MATT)
        got, plain = (
            render([each], [light], samples=256)[:, 0].reshape(4, 4)[:, 2:]  # where x > 0
            for each in (shaded, one(volume))
        )
        # The gradient is +x, across the view: it is turned back a little to the viewer's side.
        share = 1 - np.exp(-4.0 * 0.25)
        expected = (1 - share) + share * 0.6 * 4
        assert np.abs(got / plain / expected - 1).max() < 0.01


# ---- off, and bits ----------------------------------------------------------------------


def test_off_whatever_the_other_numbers_say_it_is_the_same_to_the_bit():
    volume = leapray.build(noise(), "cd")
    more = dict(lights=[sun(0, 1, 1)], world=(0.2, 0.3, 0.4), samples=16, volume_bounces=3)
    off = dict(gradient_shading=0.0, gradient_scale=7.0, roughness=0.1, specular=1.0)
    pictures = [render([one(volume, anisotropy=0.4, **each)], **more) for each in ({}, off)]
    assert (pictures[0] == pictures[1]).all()


def test_shaded_pictures_are_equal_to_the_bit_by_all_traversers_and_tiles():
    volume, more = noise(), dict(lights=[sun(0, 1, 1)], samples=16, volume_bounces=3)
    shaded = dict(gradient_shading=0.7, gradient_scale=0.3)
    pictures = [
        render([one(leapray.build(volume, t), **shaded)], **more) for t in ("cd", "aw", "kdtree")
    ]
    assert (pictures[1] == pictures[0]).all()
    assert (pictures[2] == pictures[0]).all()
    instances = [one(leapray.build(volume, "cd"), **shaded)]
    part = render(instances, place=(2, 1, 2, 3), **more).reshape(3, 2, 4)
    assert (part == pictures[0].reshape(4, 4, 4)[1:, 2:]).all()


@pytest.mark.parametrize(
    ("more", "sentence"),
    [
        ({"gradient_shading": 1.5}, "gradient shading of instance 0 must lie between 0 and 1"),
        ({"gradient_shading": np.nan}, "gradient shading of instance 0 .* it is nan"),
        ({"gradient_scale": -1.0}, "gradient scale of instance 0 must be finite and not negative"),
        ({"gradient_scale": np.inf}, "gradient scale of instance 0 .* it is inf"),
        ({"roughness": -0.1}, "roughness of instance 0 must lie between 0 and 1, it is -0.1"),
        ({"specular": 2.0}, "specular level of instance 0 must lie between 0 and 1, it is 2"),
    ],
)
def test_numbers_out_of_range_are_refused(more, sentence):
    with pytest.raises(leapray.LeapRayError, match=sentence):
        render([one(ramp(), at(), **more)])
