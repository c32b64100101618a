# SPDX-License-Identifier: GPL-3.0-or-later
"""Closures: energy, reciprocity, sampling against evaluation, layers."""

import numpy as np
import pytest
from shading import KINDS, Surface, r_sequence, sphere_grid

import leapray
from leapray import Lobe

ROUGH = (0.1, 0.3, 0.6, 1.0)
VIEWS = [(0.2, 0.1, 1.0), (1.0, 0.3, 1.0), (-1.0, 0.5, 0.25)]
U = r_sequence(1 << 14, 3)
LUCK = np.random.default_rng(7).random((1 << 16, 3))


def surface(lobe, view=VIEWS[0], **more):
    return Surface(leapray.Material((lobe,)), view, **more)


def energy(at, kinds=tuple(KINDS)[:3]):
    """What a uniform world of radiance 1 sends to the viewer, by kind."""
    return {
        kind: np.where(s["pdf"] > 0, s["weight"].T, 0).mean(1)
        for kind in kinds
        for s in [at.sample(kind, U)]
    }


def total(at):
    return sum(energy(at).values())


# ---- energy ----------------------------------------------------------------


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("rough", (0.0, *ROUGH))
def test_white_facets_give_all_light_back(view, rough):
    assert total(surface(Lobe("glossy", (1, 1, 1), roughness=rough), view)) == pytest.approx(
        1, abs=5e-3
    )


@pytest.mark.parametrize("view", [*VIEWS, (1.0, 0, 0.1)])
@pytest.mark.parametrize("rough", (0.0, *ROUGH))
def test_a_white_diffuse_surface_gives_all_light_back(view, rough):
    directions, solid = sphere_grid(1000)
    response = surface(Lobe("diffuse", (1, 1, 1), roughness=rough), view).eval(directions)
    assert response["f_cos"][:, 0, 0].sum() * solid == pytest.approx(1, abs=1e-3)


def test_a_rough_diffuse_surface_sends_more_light_back_to_where_it_came_from():
    view = np.array([0.8, 0, 0.6])
    light = np.array([view, view * (-1, 1, 1)])
    smooth, rough = (
        surface(Lobe("diffuse", (0.5,) * 3, roughness=r), view).eval(light)["f_cos"][:, 0, 0]
        for r in (0.0, 1.0)
    )
    assert smooth[0] == pytest.approx(smooth[1])
    assert rough[0] > 1.3 * smooth[0]
    assert rough[1] < 0.9 * smooth[1]


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("inside", [False, True])
@pytest.mark.parametrize("rough", (0.0, *ROUGH))
def test_clear_glass_gives_all_light_back(view, rough, inside):
    lobe = Lobe("glass", (1, 1, 1), roughness=rough, ior=1.45)
    assert total(surface(lobe, view, inside=inside)) == pytest.approx(1, abs=1e-2)


@pytest.mark.parametrize("rough", ROUGH)
def test_a_single_bounce_loses_light_and_never_gains(rough):
    for kind in ("glossy", "glass"):
        lobe = Lobe(kind, (1, 1, 1), roughness=rough, ior=1.45, multiscatter=False)
        got = total(surface(lobe, VIEWS[1]))
        assert got.min() > 0.3
        assert got.max() < 1 - 0.1 * rough**4


@pytest.mark.parametrize("rough", (0.0, *ROUGH))
@pytest.mark.parametrize("metallic", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("transmission", [0.0, 0.5, 1.0])
def test_a_white_principled_surface_keeps_nearly_all_light(rough, metallic, transmission):
    lobe = Lobe("principled", (1, 1, 1), roughness=rough, ior=1.5, metallic=metallic,
                transmission=transmission)  # fmt: skip
    for view in VIEWS:
        assert total(surface(lobe, view)) == pytest.approx(1, abs=5e-3)


def test_colours_multiply_and_texture_only_where_it_is_asked_for():
    tint = np.array([0.5, 0.25, 1.0])
    for textured in (False, True):
        lobe = Lobe("diffuse", (0.8, 0.4, 0.2), textured=textured)
        got = total(surface(lobe, color=tint))
        assert got == pytest.approx([0.8, 0.4, 0.2] * (tint if textured else 1), rel=1e-6)


def test_mixes_add_their_weights():
    lobes = (Lobe("diffuse", (1, 0, 0), 0.25), Lobe("transparent", (0, 1, 0), 0.5),
             Lobe("emission", (8, 4, 2), 0.25), Lobe("glossy", (0, 0, 1), 0.25))  # fmt: skip
    at = Surface(leapray.Material(lobes), VIEWS[0])
    albedo, emission, transparency = at.look()
    assert emission == pytest.approx([2, 1, 0.5])
    assert transparency == pytest.approx([0, 0.5, 0])
    assert total(at) == pytest.approx([0.25, 0, 0.25], abs=1e-6)
    assert (albedo > 0).tolist() == [False, True, True, False, True, False]
    assert at.flags() == 1 | 2 | 4


# ---- what optics says ------------------------------------------------------


def fresnel(cosine, n):
    """Mean of the two polarisations, by Snell's angle."""
    sine = np.sqrt(1 - cosine**2) / n
    if sine >= 1:
        return 1.0
    inner = np.sqrt(1 - sine**2)
    s = (cosine - n * inner) / (cosine + n * inner)
    p = (inner - n * cosine) / (inner + n * cosine)
    return (s * s + p * p) / 2


@pytest.mark.parametrize("n", [1.1, 1.45, 2.4])
@pytest.mark.parametrize("inside", [False, True])
@pytest.mark.parametrize("angle", [0.0, 0.4, 0.9, 1.3])
def test_smooth_glass_obeys_snell_and_fresnel(n, inside, angle):
    view = np.array([np.sin(angle), 0, np.cos(angle)])
    at = surface(Lobe("glass", (1, 1, 1), ior=n), view, inside=inside)
    ratio = 1 / n if inside else n
    want = fresnel(np.cos(angle), ratio)
    (back,) = at.sample("glossy", U[:1])
    assert back["delta"] and back["weight"] == pytest.approx([want] * 3, rel=1e-9)
    assert back["direction"] == pytest.approx([-view[0], 0, view[2]], abs=1e-12)
    (through,) = at.sample("transmission", U[:1])
    if want == 1:
        assert through["pdf"] == 0
        return
    assert through["weight"] == pytest.approx([1 - want] * 3, rel=1e-9)
    assert np.hypot(*through["direction"][:2]) == pytest.approx(np.sin(angle) / ratio, abs=1e-12)
    assert through["direction"][2] < 0
    assert np.linalg.norm(through["direction"]) == pytest.approx(1)


def test_the_index_of_what_lies_around_counts():
    lobe = Lobe("glass", (1, 1, 1), ior=1.5)
    (alike,) = surface(lobe, VIEWS[1], eta=1.0).sample("transmission", U[:1])
    assert alike["direction"] == pytest.approx(-np.array(VIEWS[1]) / np.linalg.norm(VIEWS[1]))
    assert alike["weight"] == pytest.approx([1, 1, 1])
    (plain,) = surface(lobe, VIEWS[1]).sample("transmission", U[:1])
    (told,) = surface(lobe, VIEWS[1], eta=1 / 1.5).sample("transmission", U[:1])
    assert told["direction"] == pytest.approx(plain["direction"], rel=1e-12)


def test_a_metal_shows_its_base_colour_and_its_edge_tint():
    lobe = Lobe("principled", (0.9, 0.5, 0.2), metallic=1.0, specular_tint=(1, 0.5, 0.25))
    (front,) = surface(lobe, (0, 0, 1)).sample("glossy", U[:1])
    assert front["weight"] == pytest.approx([0.9, 0.5, 0.2])
    cosine = 1 / 7  # where F82 is told
    view = (np.sqrt(1 - cosine**2), 0, cosine)
    (edge,) = surface(lobe, view).sample("glossy", U[:1])
    schlick = np.array([0.9, 0.5, 0.2]) + (1 - np.array([0.9, 0.5, 0.2])) * (6 / 7) ** 5
    assert edge["weight"] == pytest.approx(schlick * [1, 0.5, 0.25], rel=1e-9)
    white = Lobe("principled", (0.9, 0.5, 0.2), metallic=1.0)
    (plain,) = surface(white, view).sample("glossy", U[:1])
    assert plain["weight"] == pytest.approx(schlick, rel=1e-9)


def test_specular_level_changes_the_reflection_at_normal_incidence():
    for level, want in ((0.0, 0.0), (0.5, 0.04), (1.0, 0.08)):
        lobe = Lobe("principled", (0, 0, 0), ior=1.5, specular=level)
        got = energy(surface(lobe, (0, 0, 1)))["glossy"]
        assert got == pytest.approx([want] * 3, abs=1e-9)


def test_alpha_lets_light_straight_through():
    lobe = Lobe("principled", (1, 1, 1), alpha=0.25, emission=(4, 4, 4), roughness=0.5)
    at = surface(lobe)
    _, emission, transparency = at.look()
    assert transparency == pytest.approx([0.75] * 3)
    assert emission == pytest.approx([1] * 3)
    assert total(at) == pytest.approx([0.25] * 3, rel=0.02)


# ---- sampling --------------------------------------------------------------

LOBES = {
    "diffuse": Lobe("diffuse", (0.8, 0.8, 0.8)),
    "rough": Lobe("diffuse", (0.8, 0.8, 0.8), roughness=0.7),
    "glossy": Lobe("glossy", (0.8, 0.8, 0.8), roughness=0.4),
    "glass": Lobe("glass", (0.8, 0.8, 0.8), roughness=0.5, ior=1.5),
    "refraction": Lobe("refraction", (0.8, 0.8, 0.8), roughness=0.4, ior=1.3),
    "plastic": Lobe("principled", (0.5, 0.5, 0.5), roughness=0.4, ior=1.5),
    "mixture": Lobe("principled", (0.5, 0.6, 0.7), roughness=0.5, metallic=0.3, transmission=0.4,
                    ior=1.45),
}  # fmt: skip


def cell_of(d):
    """Of 80 cells of the sphere, (n,)."""
    return 8 * np.floor((d[:, 2] + 1) * 5).clip(0, 9).astype(int) + octant(d)


@pytest.mark.parametrize("inside", [False, True])
@pytest.mark.parametrize("view", VIEWS[:2])
@pytest.mark.parametrize("name", LOBES)
def test_samples_agree_with_the_responses(name, view, inside):
    at = surface(LOBES[name], view, inside=inside)
    albedo = at.look()[0]
    directions, solid = sphere_grid(400)
    responses = at.eval(directions)
    for kind, group in list(KINDS.items())[:3]:
        response = responses[:, group - 1]
        if not albedo[group]:
            assert not response["pdf"].any()
            assert not response["f_cos"].any()
            continue
        found = at.sample(kind, LUCK)
        found = found[found["pdf"] > 0]
        d, weight = found["direction"], found["weight"][:, 0]
        np.testing.assert_allclose(at.eval(d)["pdf"][:, group - 1], found["pdf"], rtol=1e-6)
        # in cells of the sphere, by chi-square: 1 +- 0.35 in the mean for 16 cells and more
        want = np.bincount(cell_of(directions), response["f_cos"][:, 0] * solid, 80)
        got = np.bincount(cell_of(d), weight, 80) / len(LUCK)
        spread = np.bincount(cell_of(d), weight**2, 80) / len(LUCK) ** 2
        full = np.bincount(cell_of(d), None, 80) > 20
        assert full.sum() > 3
        assert got[~full].sum() < 0.01
        chi = ((got - want)[full] ** 2 / (spread[full] + (0.02 * want[full]) ** 2)).mean()
        assert chi < 2.0
        # rays are about as dense as is said: where facets of dielectrics are guided by a few of
        # them, as dense as multiple importance sampling needs
        density = np.bincount(cell_of(directions), response["pdf"] * solid, 80)
        dense = np.bincount(cell_of(d), None, 80) / len(LUCK)
        off = np.abs(density - dense).sum()
        assert off < (0.04 if name in ("diffuse", "rough", "glossy", "refraction") else 1.0)


def test_no_ray_of_rough_glass_outweighs_the_others():
    """The largest weight of a group's rays, over its probability by the albedo."""
    for rough in (0.1, 0.3, 0.5, 1.0):
        for cosine in np.linspace(0.02, 1, 25):
            view = (np.sqrt(1 - cosine**2), 0, cosine)
            for inside in (False, True):
                at = surface(Lobe("glass", (1, 1, 1), roughness=rough, ior=1.45), view,
                             inside=inside)  # fmt: skip
                albedo = at.look()[0]
                for kind in ("glossy", "transmission"):
                    heaviest = at.sample(kind, LUCK[:2000])["weight"].max()
                    assert heaviest * albedo.sum() < 8 * albedo[KINDS[kind]]


def octant(d):
    return ((np.arctan2(d[:, 1], d[:, 0]) / (2 * np.pi) + 0.5) * 8).clip(0, 7.999).astype(int)


@pytest.mark.parametrize("name", ["diffuse", "rough", "glossy"])
def test_light_and_viewer_may_change_places(name):
    lobe = LOBES[name]
    lobe = Lobe(lobe.kind, lobe.color, roughness=lobe.roughness, multiscatter=False)
    directions, _ = sphere_grid(12)
    above = directions[directions[:, 2] > 0.05]
    f = np.array([
        surface(lobe, v).eval(above)["f_cos"].sum(1)[:, 0] / above[:, 2] for v in above
    ])  # fmt: skip
    assert f.max() > 0.1
    np.testing.assert_allclose(f, f.T, rtol=1e-9, atol=1e-12)


def test_a_view_that_smoothing_puts_below_the_surface_is_no_trouble():
    tilted = np.array([-0.8, 0, 0.6])
    for lobe in LOBES.values():
        at = surface(lobe, (1.0, 0, 0.3), normal=tilted)
        for kind in tuple(KINDS)[:3]:
            found = at.sample(kind, U[:512])
            assert np.isfinite(found["weight"]).all()
            assert np.isfinite(found["direction"]).all()
            assert found["weight"].max() < 20
