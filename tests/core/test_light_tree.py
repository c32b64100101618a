# SPDX-License-Identifier: GPL-3.0-or-later
"""Choosing among many lights: probabilities are as told, and no light is left out."""

from dataclasses import replace

import numpy as np
import pytest
from shading import choose_lights, hit_light, r_sequence, sample_light, walk_lights
from stage import at, camera, one, slab

import leapray
from leapray import Light, Lobe, Material

UP = np.array([0.0, 0, 1])
EITHER = np.zeros(3)


def crowd(n, seed=2, suns=0):
    """Lights of all kinds around the origin, of random brightness."""
    rng = np.random.default_rng(seed)
    out = [Light("sun", rng.random(3), direction=unit(rng), angle=0.3 * k) for k in range(suns)]
    for k in range(n - suns):
        place, towards = rng.uniform(-3, 3, 3), unit(rng)
        color = rng.random(3) * 10 ** rng.uniform()
        side = np.cross(towards, unit(rng))
        sides = dict(axis_u=0.4 * side, axis_v=0.2 * np.cross(side, towards))
        spread = [np.pi, 1.0][k % 3 > 0]
        out.append(
            [
                Light("point", color, place),
                Light("point", color, place, radius=0.1, shape="sphere"),
                Light("spot", color, place, towards, radius=0.05, angle=1.2, blend=0.2),
                Light("area", color, place, towards, shape="rectangle", angle=spread, **sides),
                Light("area", color, place, towards, shape="ellipse", angle=spread, **sides),
            ][k % 5]
        )
    return out


def unit(rng):
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


PLACES = [np.zeros(3), np.array([1.0, -2, 0.5]), np.array([30.0, 5, -8])]


@pytest.mark.parametrize("normal", [UP, EITHER], ids=["one side", "either side"])
@pytest.mark.parametrize("p", PLACES, ids=str)
@pytest.mark.parametrize(("n", "suns", "world"), [(1, 0, 0), (2, 1, 0), (60, 3, 2.0), (300, 0, 0)])
def test_lights_are_chosen_as_often_as_their_probabilities_say(n, suns, world, p, normal):
    lights = crowd(n, suns=suns)
    u = (np.arange(1 << 16) + 0.5) / (1 << 16)
    index, probability, probability_of = choose_lights(lights, p, normal, u, world)
    some = index >= 0
    np.testing.assert_allclose(probability[some], probability_of[index[some]], rtol=1e-9)
    often = np.bincount(index[some], minlength=len(probability_of)) / len(u)
    np.testing.assert_allclose(often, probability_of, atol=40 / len(u))  # some intervals' ends
    assert probability_of.sum() == pytest.approx(some.mean(), abs=40 / len(u))


@pytest.mark.parametrize("normal", [UP, EITHER], ids=["one side", "either side"])
@pytest.mark.parametrize("p", PLACES, ids=str)
def test_a_light_that_contributes_has_a_probability(p, normal):
    lights = crowd(200, suns=4)
    probability_of = choose_lights(lights, p, normal, np.zeros(1))[2]
    contributions = []
    for light in lights:
        rays = sample_light(light, p, r_sequence(256, 2))
        height = rays["direction"] @ normal if normal.any() else 1.0
        irradiance = rays["color"].sum(1) * np.maximum(height, 0)
        contributions.append(np.where(rays["pdf"] > 0, irradiance, 0))
    contribution = np.max(contributions, axis=1)
    assert 20 < (contribution > 0).sum() < len(lights)
    assert (probability_of[contribution > 1e-9] > 0).all()
    if normal.any():  # and of those that cannot some are known not to
        assert (probability_of[contribution == 0] == 0).sum() > 20


def test_near_and_bright_lights_are_likely():
    lights = [Light("point", (1, 1, 1), (k, 0, 1)) for k in range(50)]
    probability = choose_lights(lights, (20, 0, 0), UP, np.zeros(1))[2]
    assert probability[18:23].sum() > 0.5
    assert probability[:10].sum() + probability[30:].sum() < 0.2
    lights[40] = Light("point", (1000, 1000, 1000), (40, 0, 1))
    assert choose_lights(lights, (20, 0, 0), UP, np.zeros(1))[2].argmax() == 40


def test_many_lights_at_one_place_make_a_tree_too():
    lights = [Light("point", (1, 1, 1), (0, 0, 1))] * 5000
    probability = choose_lights(lights, (0, 0, 0), UP, np.zeros(1))[2]
    np.testing.assert_allclose(probability, 1 / 5000, rtol=1e-9)


def test_rays_come_to_every_light_that_they_meet():
    lights, o = crowd(120), np.array([0.2, -4.5, 0.1])
    rng = np.random.default_rng(7)
    d = rng.normal(size=(16000, 3)) * (1, 0.2, 1) + (0, 2, 0)
    d /= np.linalg.norm(d, axis=1)[:, None]
    met = walk_lights(lights, o, d)
    assert met.max() == 1
    hits = np.stack([hit_light(light, o, d)["pdf"] > 0 for light in lights], 1)
    assert hits.sum() > 200
    assert (met[hits] == 1).all()
    assert met.mean() < 0.1


def above(light):
    """The light over the floor, pointing down, not seen in mirrors."""
    place = np.abs(light.position) * (1, 1, 0.4) + (0, 0, 0.5)
    sides = dict(axis_u=(0.4, 0, 0), axis_v=(0, 0.2, 0))
    return replace(light, position=place, direction=(0, 0, -1), visible_glossy=False, **sides)


def test_many_lights_light_a_floor_as_each_does_by_itself():
    lights = [above(light) for light in crowd(20)]
    floor = leapray.build(slab(), "cd")
    diffuse, mirror = (
        Material.diffuse((0.6,) * 3),
        Material([Lobe("glossy", (1,) * 3, roughness=0)]),
    )
    instances = [one(floor, at(scale=2)), one(floor, at(z=8, scale=2), first_material=1)]

    def mean(sources, eye, target, samples):
        cam = camera(eye, target, size=(24, 24), width=3, kind="orthographic")
        scene = leapray.Scene(cam, instances, sources, [diffuse, mirror], range(2))
        picture = scene.render_tile(0, 0, 24, 24, samples=samples, seed=1)["Combined"]
        return picture[..., :3].mean((0, 1))

    down, up = ((1.5, 1.5, 4), (1.5, 1.5, 0)), ((1.5, 1.5, 4), (1.5, 1.5, 9))
    want = sum(mean([light], *down, 32) for light in lights)
    assert want.min() > 0.1
    np.testing.assert_allclose(mean(lights, *down, 256), want, rtol=0.01)
    np.testing.assert_allclose(mean(lights, *up, 512), want, rtol=0.01)  # seen in the mirror


@pytest.mark.parametrize("far", [1e300, 1.7e308])
def test_lights_at_the_ends_of_all_numbers_make_a_tree_too(far):
    rng = np.random.default_rng(2)
    lights = crowd(40)
    lights = [replace(each, position=tuple(far * rng.uniform(-1, 1, 3))) for each in lights]
    index, _, probability_of = choose_lights(lights, (0, 0, 0), UP, np.linspace(0, 0.99, 50))
    assert ((index >= -1) & (index < 40)).all()
    assert np.isfinite(probability_of).all() and probability_of.sum() < 1 + 1e-9
