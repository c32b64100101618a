# SPDX-License-Identifier: GPL-3.0-or-later
"""Volumes that scatter light, against integrals along rays, furnaces and each other."""

from __future__ import annotations

import numpy as np
import pytest
from stage import EXACT, at, one, slab

import leapray
from leapray import Camera, Light, Lobe, Material, World, _abi

THICK, SIGMA = 2.0, 0.7
ALBEDO = np.array([1.0, 0.5, 0.25])
DARK = (0.0, 0.0, 0.0)
BLACK, WHITE = Material(()), Material.diffuse((1.0, 1.0, 1.0))
VEIL = Material([Lobe("transparent", (0.5, 0.5, 0.5))])
DEEP = dict(max_bounces=64, volume_bounces=64, diffuse_bounces=64)


def fog(sigma=SIGMA, albedo=ALBEDO, size=THICK, traverser="cd", values=None, emission=None):
    """A cube about the origin, of extinction sigma times the value, 1 unless values say others."""
    values = np.ones((5, 5, 5)) if values is None else values
    matrix = np.diag([size / (len(values) - 1)] * 3 + [1])
    matrix[:3, 3] = -size / 2
    grid = leapray.ScalarGrid("fog", values.astype(np.float32), matrix)
    extinction = np.array([0.0, 2.0 * sigma])
    scattering = extinction[:, None] * np.broadcast_to(albedo, 3)
    glow = None if emission is None else [emission, emission]
    look = leapray.TransferFunction([0.0, 2.0], extinction, DARK, glow, scattering)
    return leapray.build(leapray.visible_volume(grid, look), traverser)


def camera(z=9.0, width=1.0):
    """Parallel rays down from z, 4 x 4 pixels."""
    corner, pixel = (-width / 2, -width / 2, 0), width / 4
    return Camera("orthographic", (0, 0, z), (0, 0, -1), corner, (pixel, 0, 0), (0, pixel, 0))


def scene_of(instances, lights=(), world=DARK, materials=(BLACK,), cam=None):
    world = world if isinstance(world, World) else World(world)
    slots = range(len(materials))
    return leapray.Scene(cam or camera(), instances, lights, list(materials), slots, world)


def render(instances, lights=(), *, samples=64, seed=0, cam=None, materials=(BLACK,), world=DARK,
           record=None, place=(0, 0, 4, 4), **more):  # fmt: skip
    """RGBA of pixels, (n, 4)."""
    scene = scene_of(instances, lights, world, materials, cam)
    more = {"samples": samples, "seed": seed, "record": record, **more}
    got = scene.render_tile(*place, **more)["Combined"]
    assert np.isfinite(got).all()
    return got.reshape(-1, 4).astype(float)


def phase(cosine, g=0.0):
    return (1 - g * g) / (4 * np.pi * (1 + g * g - 2 * g * cosine) ** 1.5)


def sun(*direction):
    return Light("sun", (1, 1, 1), direction=np.array(direction) / np.linalg.norm(direction))


def middles(n=4000):
    """Depths below the upper face of the fog, and what each stands for."""
    return (np.arange(n) + 0.5) / n * THICK, THICK / n


# ---- one scattering ----------------------------------------------------------------


@pytest.mark.parametrize("g", [0.0, 0.6, -0.6])
@pytest.mark.parametrize("down", [1.0, -1.0])
def test_a_sun_before_and_behind_the_eye(g, down):
    got = render([one(fog(), anisotropy=g)], [sun(0, 0, down)])
    depth, step = middles()
    way = depth if down > 0 else THICK - depth
    expected = (SIGMA * np.exp(-SIGMA * (depth + way))).sum() * step * phase(-down, g)
    assert np.abs(got[:, :3].mean(0) / (ALBEDO * expected) - 1).max() < 0.003


@pytest.mark.parametrize("g", [0.0, 0.6])
def test_a_point_light_within_a_field_that_grows(g):
    """Against an integral along the ray, with the depth towards the light by another."""
    z = np.linspace(0.2, 1.8, 9)  # the extinction falls linearly with the depth
    values = np.broadcast_to(z[:, None, None], (9, 9, 9))
    light = Light("point", (1, 1, 1), position=(0.6, 0.2, -0.3))
    got = render(
        [one(fog(values=values), anisotropy=g)], [light], cam=camera(width=1e-3), samples=4096
    )
    depth, step = middles()
    p = np.column_stack([0 * depth, 0 * depth, 1 - depth])
    to_light = np.array(light.position) - p
    distance = np.linalg.norm(to_light, axis=1)
    extinction = SIGMA * (1 + 0.8 * p[:, 2])
    before = np.cumsum(extinction) * step - extinction * step / 2
    between = SIGMA * (1 + 0.4 * (p[:, 2] + light.position[2])) * distance
    cosine = -to_light[:, 2] / distance
    bright = extinction * np.exp(-before - between) * phase(cosine, g) / distance**2
    expected = ALBEDO * bright.sum() * step
    assert np.abs(got[:, :3].mean(0) / expected - 1).max() < 0.01


def test_rayleigh_scatters_forwards_and_back_twice_as_much_as_aside():
    volume = fog(0.001)
    back, aside = (
        render([one(volume, phase="rayleigh")], [sun(*d)])[:, 0].mean()
        for d in ((0, 0, 1), (1, 0, 0))
    )
    assert abs(back / aside - 2) < 0.01
    assert abs(back / (0.002 * 3 / (8 * np.pi)) - 1) < 0.01


def test_thin_fog_in_a_uniform_world_gives_back_what_it_takes():
    """Of a thin medium, whatever the phase function: as much light comes back as is lost."""
    for more in ({"anisotropy": 0.0}, {"anisotropy": 0.6}, {"phase": "rayleigh"}):
        got = render([one(fog(0.001, (1, 1, 1)), **more)], world=(1, 1, 1), samples=1024)
        assert np.abs(got[:, :3].mean() - 1) < 2e-5  # 0.002 are lost and come back


@pytest.mark.parametrize("g", [0.0, 0.5, -0.8])
def test_light_samples_and_scattered_rays_find_the_same_light(g):
    """A world of one colour is met by rays alone, one with an image is sampled, too."""
    image = np.full((4, 8, 3), 0.7, np.float32)
    pictures = [
        render([one(fog(), anisotropy=g)], world=world, samples=4096)[:, :3].mean(0)
        for world in (World((0.7, 0.7, 0.7)), World((1, 1, 1), image=image))
    ]
    assert np.abs(pictures[0] / pictures[1] - 1).max() < 0.005


def test_an_area_light_met_by_scattered_rays_counts_once():
    lamp = dict(kind="area", color=(2, 2, 2), position=(0, 0, 3), direction=(0, 0, -1),
                axis_u=(4, 0, 0), axis_v=(0, 4, 0), shape="rectangle", angle=np.pi)  # fmt: skip
    volume = one(fog(0.01, (1, 1, 1)), anisotropy=-0.7)
    got = render([volume], [Light(**lamp)], samples=4096, cam=camera(1.5, 1e-3))[:, 0].mean()
    depth, step = middles(40)
    x, y = np.meshgrid(*[(np.arange(200) + 0.5) / 50 - 2] * 2)
    expected = 0.0
    for z in 1 - depth:
        distance = np.sqrt(x * x + y * y + (3 - z) ** 2)
        cosine = (3 - z) / distance
        seen = (2 * cosine / distance**2 * phase(-cosine, -0.7)).sum() * 0.02**2
        expected += 0.01 * np.exp(-0.01 * 2 * (1 - z)) * seen * step
    assert abs(got / expected - 1) < 0.01


# ---- many --------------------------------------------------------------------------


@pytest.mark.parametrize("more", [{"anisotropy": 0.0}, {"anisotropy": 0.7}, {"phase": "rayleigh"}])
def test_white_fog_in_a_white_furnace_is_not_seen(more):
    got = render([one(fog(3.0, (1, 1, 1)), **more)], world=(1, 1, 1), samples=256, **DEEP)
    assert abs(got[:, :3].mean() - 1) < 0.01
    assert np.abs(got[:, :3].mean(0) - 1).max() < 0.02


def test_limits_of_bounces_count_as_for_surfaces():
    volume = one(fog(2.0, (1, 1, 1)))
    means = [
        render([volume], world=(1, 1, 1), samples=256, max_bounces=a, volume_bounces=b)[
            :, :3
        ].mean()
        for a, b in ((0, 0), (64, 0), (0, 64), (1, 64), (64, 1), (64, 64))
    ]
    assert np.ptp(means[:3]) < 1e-6
    assert np.ptp(means[3:5]) < 1e-6
    assert means[2] + 0.1 < means[3] < means[5] - 0.3


def test_paths_that_share_slots_are_weighted():
    """With one branch a volume and the wall behind it are continued by chance, not both."""
    wall = one(leapray.build(slab(-1.5), "cd"))
    more = dict(materials=(WHITE,), world=(1, 1, 1), samples=1024)
    means = [
        render([one(fog(1.0, (1, 1, 1))), wall], branches=n, **DEEP, **more)[:, :3].mean()
        for n in (1, 4)
    ]
    assert np.abs(np.array(means) - 1).max() < 0.01


# ---- several, and surfaces ---------------------------------------------------------


@pytest.mark.parametrize("shift", [0.0, 0.7, 3.0])
def test_volumes_that_overlap_scatter_as_one_of_their_sum(shift):
    parts = [(SIGMA, np.array([1.0, 0.2, 0.1]), 0.0), (1.3, np.array([0.3, 0.9, 0.5]), shift)]
    instances = [one(fog(sigma, albedo), at(0, 0, z)) for sigma, albedo, z in parts]
    got = render(instances, [sun(0, 0, 1)], samples=2048)[:, :3].mean(0)
    z, step = np.linspace(-2, 6, 80001)[:-1] + 5e-5, 1e-4
    within = [np.abs(z - middle) < THICK / 2 for _, _, middle in parts]
    extinction = sum(sigma * w for (sigma, _, _), w in zip(parts, within, strict=True))
    scattered = sum(sigma * w[:, None] * a for (sigma, a, _), w in zip(parts, within, strict=True))
    above = (extinction[::-1].cumsum()[::-1] - extinction / 2) * step
    expected = (scattered * np.exp(-2 * above)[:, None]).sum(0) * step * phase(-1.0)
    assert np.abs(got / expected - 1).max() < 0.01


def test_what_absorbs_beside_what_scatters_dims_it():
    smoke = fog(0.9, DARK)
    got = render([one(fog()), one(smoke)], [sun(0, 0, 1)], samples=2048)[:, :3].mean(0)
    total = SIGMA + 0.9
    expected = SIGMA * ALBEDO * (1 - np.exp(-2 * total * THICK)) / (2 * total) * phase(-1.0)
    assert np.abs(got / expected - 1).max() < 0.01


def test_surfaces_cast_shadows_into_volumes():
    lid = one(leapray.build(slab(2.0, half=1.5), "cd"), visible_camera=False)
    volume = one(fog(0.1, (1, 1, 1)))
    assert render([volume, lid], [sun(0, 0, 1)])[:, :3].max() == 0
    open_sky = render([volume], [sun(0, 1, 1)])[:, 0].mean()
    half = one(leapray.build(slab(2.0, half=1.5), "cd"), at(0, 4.0, 0), visible_camera=False)
    # Rays to the sun from depth 0.5 to 2 below the face meet the plate at y = depth + 1 > 2.5.
    partly = render([volume, half], [sun(0, 1, 1)], samples=1024)[:, 0].mean()
    assert 0.15 < partly / open_sky < 0.85
    veiled = one(leapray.build(slab(3.0, half=1.5), "cd"), visible_camera=False)
    dimmed = render([volume, veiled], [sun(0, 0, 1)], materials=(VEIL,))[:, 0].mean()
    assert abs(dimmed / render([volume], [sun(0, 0, 1)])[:, 0].mean() - 0.25) < 1e-3  # two faces


def test_surfaces_behind_are_seen_and_those_before_hide():
    lamp = Material([Lobe("emission", (2.0, 2.0, 2.0))])
    volume, wall = one(fog()), leapray.build(slab(0.0), "cd")
    got = render(
        [volume, one(wall, at(0, 0, -1.5))], [sun(0, 0, 1)], materials=(lamp,), samples=256
    )
    free = render([volume], [sun(0, 0, 1)], samples=256)
    seen = 2 * np.exp(-SIGMA * THICK)
    # The lamp lights the fog, too.
    assert (got[:, 0] > free[:, 0] + seen).all()
    before = render([volume, one(wall, at(0, 0, 3))], [sun(0, 0, 1)], materials=(lamp,))
    assert np.abs(before[:, :3] - 2).max() < 1e-6


def test_a_wall_within_ends_the_volume_for_the_eye():
    wall = one(leapray.build(slab(0.0, half=0.9), "cd"))
    got = render([one(fog(0.01)), wall], [sun(0, 0, 1)], samples=256)
    expected = 0.01 * ALBEDO * phase(-1.0)
    assert np.abs(got[:, :3].mean(0) / expected - 1).max() < 0.03


def test_fog_lights_the_floor_below_it():
    floor = one(leapray.build(slab(-2.0), "cd"))
    light = Light("point", (10, 10, 10), position=(0, 0, 0.3))
    thin = np.diag([1, 1, 0.05, 1.0])
    lid = one(leapray.build(slab(0.0, half=0.5), "cd"), thin, visible_camera=False)
    hidden = dict(visible_camera=False)
    dark, lit = (
        render([floor, lid, one(fog(1.0, a), **hidden)], [light], materials=(WHITE,), samples=256,
               cam=camera(width=0.1), max_bounces=4)[:, 0].mean()
        for a in (DARK, (1, 1, 1))
    )  # fmt: skip
    assert dark == 0
    assert lit == 0  # diffuse_bounces 0: the ray from the floor is scattered no more
    deep = render([floor, lid, one(fog(1.0, (1, 1, 1)), **hidden)], [light], materials=(WHITE,),
                  samples=256, cam=camera(width=0.1), max_bounces=4, diffuse_bounces=1)  # fmt: skip
    assert deep[:, 0].mean() > 0.005


# ---- visibility, alpha, what is recorded ---------------------------------------------


def test_visibility_to_scattered_rays_is_that_of_the_thing():
    volume = one(fog(1.0, (1, 1, 1)))
    seen = render([volume], world=(1, 1, 1))[:, 0].mean()
    hidden = render([volume], world=World((1, 1, 1), visible_volume_scatter=False))[:, 0].mean()
    assert abs(hidden - np.exp(-THICK)) < 1e-6 < seen - hidden - 0.1
    light = dict(kind="sun", color=(1, 1, 1), direction=(0, 0, 1))
    assert render([volume], [Light(**light, visible_volume_scatter=False)])[:, 0].max() == 0
    lamp = Material([Lobe("emission", (2.0, 2.0, 2.0))])
    floor = leapray.build(slab(-1.5), "cd")
    for flag in (True, False):
        behind = one(floor, visible_camera=False, visible_volume_scatter=flag)
        assert (render([volume, behind], materials=(lamp,))[:, 0].mean() > 0) == flag
    unseen = one(fog(), visible_camera=False)
    assert render([unseen], [sun(0, 0, 1)]).max(initial=0, where=[True] * 3 + [False]) == 0


def test_alpha_is_what_is_extinguished_and_emission_stays():
    glow = (0.1, 0.2, 0.3)
    scene = leapray.Scene(
        camera(), [one(fog(emission=glow))], [sun(0, 0, 1)], [BLACK], [0], World((1, 1, 1)), True
    )
    got = scene.render_tile(0, 0, 4, 4, samples=64, passes=("Combined", "Emission"))
    assert np.abs(got["Combined"][..., 3] - (1 - np.exp(-SIGMA * THICK))).max() < 1e-6
    seen = np.array(glow) / SIGMA * (1 - np.exp(-SIGMA * THICK))
    assert np.abs(got["Emission"] - seen).max() < 1e-6
    lit = render([one(fog(emission=glow))])[:, :3].mean(0)
    assert (lit > seen * (1 + 0.1 * ALBEDO)).all()  # and scattered once
    assert (lit < seen * (1 + 0.5 * ALBEDO)).all()


def test_a_record_tells_of_the_point_and_adds_up():
    record = leapray.Record()
    got = render([one(fog(), anisotropy=0.3)], [sun(0, 0, 1)], samples=8, volume_bounces=2,
                 world=(0.2, 0.2, 0.2), place=(1, 1, 1, 1), record=record)  # fmt: skip
    events = record.events
    points = events[events["kind"] == _abi.LR_EVENT_SCATTER]
    assert len(points) > 8
    assert (np.abs(points["position"]) <= THICK / 2 + 1e-9).all()
    assert (points["instance"] == 0).all()
    rays = events[events["kind"] == _abi.LR_EVENT_RAY]
    kinds = rays["ray_kind"][rays["parent"] != rays["ray"]]
    assert len(kinds) and (kinds == _abi.LR_RAY_VOLUME).all()
    known = set(zip(points["sample"], points["ray"], strict=True))
    for ray in rays[rays["parent"] != rays["ray"]]:
        assert (ray["sample"], ray["parent"]) in known
    assert np.abs(events["contribution"].sum(0) / 8 - got[0, :3]).max() < 1e-6


# ---- which bits ----------------------------------------------------------------------


def noise(n=12):
    values = np.random.default_rng(5).random((n, n, n), np.float32)
    matrix = np.diag([0.2] * 3 + [1])
    matrix[:3, 3] = -1.1
    grid = leapray.ScalarGrid("noise", values, matrix)
    look = leapray.TransferFunction(
        [0.4, 0.6, 0.6, 1.0], [0, 3.0, 8.0, 5.0], (1, 0, 0), (0.1, 0.2, 0.0),
        [[0, 0, 0], [3, 1, 2], [8, 0, 1], [1, 2, 3]],
    )  # fmt: skip
    return leapray.visible_volume(grid, look)


def test_pictures_are_equal_to_the_bit_whatever_leaps():
    volume = noise()
    more = dict(lights=[sun(0, 1, 1)], world=(0.2, 0.3, 0.4), samples=16, volume_bounces=3)
    pictures = [render([one(leapray.build(volume, t), anisotropy=0.4)], **more) for t in EXACT]
    assert pictures[0][:, :3].std() > 0.01
    for got in pictures[1:]:
        assert (got == pictures[0]).all()


def test_tiles_do_not_matter():
    instances = [one(leapray.build(noise(), "cd")), one(fog(0.2), at(0, 0, 0.5))]
    more = dict(lights=[sun(0, 1, 1)], samples=16, volume_bounces=3)
    whole = render(instances, **more).reshape(4, 4, 4)
    for x, y in ((0, 0), (2, 1)):
        part = render(instances, place=(x, y, 2, 3), **more).reshape(3, 2, 4)
        assert (part == whole[y : y + 3, x : x + 2]).all()


def test_rays_end_where_their_transmittance_says():
    volume, rng = noise(), np.random.default_rng(7)
    rays = rng.uniform(-2, 2, (3000, 3)), rng.normal(size=(3000, 3))
    whole = [leapray.trace(leapray.build(volume, t), *rays, mode="volume") for t in EXACT]
    u = rng.random(len(rays[0]))
    stop = 1 - u * (1 - whole[0].transmittance)
    ends = [leapray.trace(leapray.build(volume, t), *rays, mode="volume", stop=stop) for t in EXACT]
    met = whole[0].transmittance < 1
    assert 0.2 < met.mean() < 0.9
    assert (np.isfinite(ends[0].t) == met).all()
    for got in ends[1:]:
        assert (got.t == ends[0].t).all()
        assert (got.color == ends[0].color).all()
    structure = leapray.build(volume, "aw")
    up_to = leapray.trace(structure, *(r[met] for r in rays), mode="volume", t_max=ends[0].t[met])
    assert np.abs(up_to.transmittance - stop[met]).max() < 1e-9
    assert (ends[0].color >= 0).all()
    assert (ends[0].color <= 1 + 1e-12).all()


# ---- hostile values ------------------------------------------------------------------


@pytest.mark.parametrize("g", [1.0, -1.0])
def test_beams_are_as_narrow_as_can_be_told(g):
    got = render([one(fog(1.0, (1, 1, 1)), anisotropy=g)], world=(1, 1, 1), samples=256, **DEEP)
    assert np.abs(got[:, :3].mean() - 1) < 0.02


@pytest.mark.parametrize(
    ("more", "sentence"),
    [
        ({"anisotropy": np.nan}, "anisotropy of instance 0 must lie between -1 and 1, it is nan"),
        ({"anisotropy": 1.5}, "anisotropy of instance 0 must lie between -1 and 1, it is 1.5"),
        ({"phase": "mie"}, "phase function"),
    ],
)
def test_phase_functions_that_are_none_are_refused(more, sentence):
    with pytest.raises(leapray.LeapRayError, match=sentence):
        render([one(fog(), **more)])


@pytest.mark.parametrize(
    ("scattering", "sentence"),
    [
        ((0, -1, 0), "scattering must lie between 0 and 1e\\+30; one is -1"),
        ((0, np.nan, 0), "scattering must lie between 0 and 1e\\+30; one is nan"),
        ((0, 1), "scattering must have the shape"),
        ([(0, 0, 0), (1, 1, 1)], "knot 1 has scattering 1 and no extinction"),
    ],
)
def test_scattering_that_is_none_is_refused(scattering, sentence):
    with pytest.raises(leapray.LeapRayError, match=sentence):
        leapray.TransferFunction([0, 1], [1, 0], scattering=scattering)


def test_limits_and_modes_out_of_range_are_refused():
    with pytest.raises(leapray.LeapRayError, match="limits of bounces"):
        render([one(fog())], volume_bounces=-1)
    ray = np.zeros((1, 3)), np.ones((1, 3))
    for mode in ({"mode": "maximum"}, {"mode": "volume", "sampling": "post"}):
        with pytest.raises(leapray.LeapRayError, match="rays end at a transmittance only"):
            leapray.trace(fog(), *ray, stop=0.5, **mode)


@pytest.mark.parametrize("stop", [np.nan, -1.0, 0.0, 1.0, 2.0, np.inf])
def test_ends_that_no_ray_has_are_harmless(stop):
    got = leapray.trace(fog(30.0), [[0, 0, 9.0]], [[0, 0, -1.0]], mode="volume", stop=stop)
    t = got.t[0]
    assert t == np.inf or 8 <= t <= 10
    assert np.isfinite(got.color).all()


def test_more_than_all_may_be_scattered_and_extreme_numbers_stay_numbers():
    got = render([one(fog(albedo=(3, 1, 1)))], [sun(0, 0, 1)], samples=16)
    assert abs(got[:, 0].mean() / got[:, 1].mean() - 3) < 1e-5
    for sigma in (1e-12, 1e12, 1e29):
        render([one(fog(sigma, (1, 1, 1)))], [sun(0, 0, 1)], samples=4, **DEEP)
