# SPDX-License-Identifier: GPL-3.0-or-later
"""Solids filled with a homogeneous medium, against closed forms and integrals along rays."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from stage import EXACT, at, ball, camera, centre_rays, clearance, meet_sphere, one, unit
from stage import render as render_passes

import leapray
from leapray import Camera, Light, Lobe, Material, World

LO, HI = np.array([-1.03, -0.97, -1.011]), np.array([1.07, 1.13, 0.983])  # off the lattice
DARK = (0.0, 0.0, 0.0)
EXTINCTION = np.array([0.3, 0.8, 2.0])
ALBEDO = np.array([0.9, 0.6, 0.3])
DEEP = dict(max_bounces=256, volume_bounces=256)
COLORED = dict(absorption=EXTINCTION * (1 - ALBEDO), scattering=EXTINCTION * ALBEDO)


def filled(**medium):
    """A material without a surface."""
    return Material((), **medium, bare=True)


def box(lo=LO, hi=HI, voxel=0.125, traverser="cd", dtype="f32"):
    corners = [(x, y, z) for z in (lo[2], hi[2]) for y in (lo[1], hi[1]) for x in (lo[0], hi[0])]
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    triangles = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    volume = leapray.voxelize(np.array(corners), np.array(triangles, np.int32), voxel, dtype=dtype)
    return leapray.build(volume, traverser)


def depth_of(o, d, lo=LO, hi=HI, begin=0.0):
    """Lengths of o + t d, t > begin, within the box, (n,)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = (lo - o) / d, (hi - o) / d
    t = np.clip(np.stack([np.fmin(a, b).max(-1), np.fmax(a, b).min(-1)]), begin, np.inf)
    return np.maximum(t[1] - t[0], 0) * np.linalg.norm(d, axis=-1)


def inner(o, d, by=0.2):
    """Whether rays stay that far from the edges of the box: where they meet it, two of the
    coordinates do."""
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = (LO - o) / d, (HI - o) / d
    good = np.fmin(a, b).max(-1) < np.fmax(a, b).min(-1)
    for t in (np.fmin(a, b).max(-1), np.fmax(a, b).min(-1)):
        p = o + t[..., None] * d
        good &= ((p > LO + by) & (p < HI - by)).sum(-1) >= 2
    return good


def render(instances, materials, lights=(), *, cam=None, world=DARK, size=(4, 4), **more):
    """RGBA of pixels, (h, w, 4)."""
    world = world if isinstance(world, World) else World(world)
    slots = range(len(materials))
    view = cam or down()
    scene = leapray.Scene(view, instances, lights, list(materials), slots, world)
    got = scene.render_tile(0, 0, *size, **{"samples": 1, "seed": 0, **more})["Combined"]
    assert np.isfinite(got).all()
    return got.astype(float)


def down(z=9.0, width=1.0, size=4, **more):
    """Parallel rays down from z."""
    pixel = width / size
    corner = (-width / 2, -width / 2, 0)
    return Camera("orthographic", (0, 0, z), (0, 0, -1), corner, (pixel, 0, 0), (0, pixel, 0),
                  **more)  # fmt: skip


# ---- without scattering ----------------------------------------------------------------


@pytest.mark.parametrize("traverser", EXACT)
def test_a_box_lets_through_what_the_law_of_beer_says(traverser):
    """To 1e-6: of f32 samples planes are exact but for rounding, away from edges."""
    cam = camera((3.1, -4.2, 2.3), size=(24, 24), width=0.6)
    o, d = centre_rays(cam, (24, 24))
    got = render([one(box(traverser=traverser))], [filled(absorption=EXTINCTION)], cam=cam,
                 world=(1, 1, 1), size=(24, 24))  # fmt: skip
    want = np.exp(-EXTINCTION * depth_of(o, d)[..., None])
    good = inner(o, d)
    assert good.mean() > 0.2
    assert np.abs(got[..., :3] - want)[good].max() < 1e-6


@pytest.mark.parametrize("voxel", [0.25, 0.125, 0.0625])
def test_samples_of_16_bits_cost_what_their_steps_move_the_surface(voxel):
    """The ramp is five voxels wide and has 2^16 steps. A sample is right to half of one, so that
    either side of the box is off by 5 voxels 2^-17 at most, and what is let through by twice that
    times the extinction, relatively: below 1e-6 where extinction times voxel is below 0.013."""
    law = np.exp(-EXTINCTION * (HI - LO)[2])
    passed = {
        dtype: render([one(box(voxel=voxel, dtype=dtype))], [filled(absorption=EXTINCTION)],
                      world=(1, 1, 1))[..., :3]
        for dtype in ("u16", "f32")
    }  # fmt: skip
    off = {dtype: np.abs(np.log(got / law) / EXTINCTION) for dtype, got in passed.items()}
    assert off["u16"].max() < 2 * 5 * voxel * 2**-17
    assert off["f32"].max() < 1e-6 < off["u16"].max()  # it is the steps, not the filter


def test_a_ball_is_as_dense_as_its_surface_is_exact():
    cam = camera((3.1, -4.2, 2.3), size=(32, 32), width=0.5)
    o, d = centre_rays(cam, (32, 32))
    got = render([one(leapray.build(ball(), "cd"))], [filled(absorption=EXTINCTION)], cam=cam,
                 world=(1, 1, 1), size=(32, 32))  # fmt: skip
    good = clearance(o, d) < 0.8
    way = (meet_sphere(o, d, far=True) - meet_sphere(o, d)) * np.linalg.norm(d, axis=-1)
    want = np.exp(-EXTINCTION * way[..., None])
    # 0.011 of 1 / 25.6 off along the normal, which the ray meets at a sine of 0.8 at most
    bound = 2 * 0.011 / 25.6 / 0.6 * EXTINCTION.max()
    assert np.abs(got[..., :3] - want)[good].max() < bound


@pytest.mark.parametrize("scale", [0.0, 1e-9, 1.0])
def test_a_glowing_box(scale):
    glow, lost = np.array([1.0, 0.3, -0.1]), EXTINCTION * scale
    got = render([one(box())], [filled(absorption=lost, glow=glow)], world=(0.2, 0.2, 0.2))
    way = (HI - LO)[2]
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = np.where(lost > 0, -np.expm1(-lost * way) / lost, way)
    assert np.abs(got[..., :3] - glow * mean - 0.2 * np.exp(-lost * way)).max() < 1e-6


def test_the_eye_may_be_within_and_sees_what_lies_beyond_its_clip_start():
    for kind in ("perspective", "orthographic"):
        cam = camera((0.3, 0.2, 0.1), (0.4, 0.7, 9), (8, 8), 0.4, kind, clip_start=0.25)
        o, d = centre_rays(cam, (8, 8))
        got = render([one(box())], [filled(absorption=EXTINCTION)], cam=cam, world=(1, 1, 1),
                     size=(8, 8))  # fmt: skip
        want = np.exp(-EXTINCTION * depth_of(o, d, begin=0.25)[..., None])
        assert np.abs(got[..., :3] - want).max() < 1e-6


def test_media_add_up_where_solids_overlap():
    solids = [one(box()), one(box(), at(0.2, 0.1, 0.7), first_material=1)]
    one_ = dict(absorption=(0.5, 0.1, 0.2), glow=(0.3, 0, 0))
    other = dict(absorption=(0.1, 0.4, 0.2), glow=(0, 0.2, 0.1))
    got = render(solids, [filled(**one_), filled(**other)], world=(1, 1, 1))
    z = np.linspace(HI[2] + 0.7, LO[2], 400001)
    z = (z[1:] + z[:-1]) / 2
    in_one, in_other = z < HI[2], z > LO[2] + 0.7
    step = (HI[2] + 0.7 - LO[2]) / len(z)
    want = []
    for a in range(3):
        sigma = in_one * one_["absorption"][a] + in_other * other["absorption"][a]
        shine = in_one * one_["glow"][a] + in_other * other["glow"][a]
        passed = np.exp(-(np.cumsum(sigma) - sigma / 2) * step)
        want.append((shine * passed).sum() * step + np.exp(-sigma.sum() * step))
    assert np.abs(got[..., :3] - want).max() < 1e-5


def haze(scattering=(0.0, 0.0, 0.0), emission=(0.4, 0.2, 0.1), sigma=0.6):
    """A measured volume in the middle of the box: a cube of half a metre."""
    matrix = np.diag([0.125] * 3 + [1])
    matrix[:3, 3] = -0.25
    grid = leapray.ScalarGrid("haze", np.ones((5, 5, 5), np.float32), matrix)
    look = leapray.TransferFunction(
        [0.0, 2.0], [sigma, sigma], DARK, [emission] * 2, [scattering] * 2
    )
    return one(leapray.build(leapray.visible_volume(grid, look), "cd"), first_material=0)


def test_measured_volumes_lie_in_media():
    medium = dict(absorption=EXTINCTION, glow=(0.1, 0.5, 0.2))
    got = render([one(box()), haze()], [filled(**medium)], cam=down(width=0.2), world=(1, 1, 1))
    n = 200000
    step = (HI - LO)[2] / n
    z = HI[2] - (np.arange(n) + 0.5) * step
    within = np.abs(z) < 0.25
    for a in range(3):
        sigma = EXTINCTION[a] + 0.6 * within
        shine = medium["glow"][a] + np.array([0.4, 0.2, 0.1])[a] * within
        passed = np.exp(-(np.cumsum(sigma) - sigma / 2) * step)
        want = (shine * passed).sum() * step + np.exp(-sigma.sum() * step)
        assert np.abs(got[..., a] / want - 1).max() < 1e-4  # what exact integrals may be off


# ---- scattering ------------------------------------------------------------------------


def phase(cosine, g):
    return (1 - g * g) / (4 * np.pi * (1 + g * g - 2 * g * cosine) ** 1.5)


@pytest.mark.parametrize("g", [0.0, 0.6, -0.6])
def test_a_sun_aslant_on_coloured_fog(g):
    """Scattered once: the integral along the ray, by each colour's own extinction."""
    to_sun = unit(0.3, 0.2, 1.0)
    light = Light("sun", (1, 1, 1), direction=to_sun)
    got = render([one(box())], [filled(**COLORED, anisotropy=g)], [light], samples=4096,
                 cam=down(width=1e-3))  # fmt: skip
    n = 4000
    depth = (np.arange(n) + 0.5) / n * (HI - LO)[2]
    way = depth[:, None] + (depth / to_sun[2])[:, None]
    inner_ = (np.exp(-EXTINCTION * way) * COLORED["scattering"]).sum(0) * (HI - LO)[2] / n
    assert np.abs(got[..., :3].mean((0, 1)) / (inner_ * phase(-to_sun[2], g)) - 1).max() < 0.01


def test_a_point_light_within_the_fog():
    light = Light("point", (1, 1, 1), position=(0.5, 0.2, -0.3))
    got = render([one(box())], [filled(**COLORED)], [light], samples=16384, cam=down(width=1e-3))
    n = 4000
    depth = (np.arange(n) + 0.5) / n * (HI - LO)[2]
    p = np.column_stack([0 * depth, 0 * depth, HI[2] - depth])
    far = np.linalg.norm(p - light.position, axis=1)
    bright = np.exp(-EXTINCTION * (depth + far)[:, None]) / (4 * np.pi * far**2)[:, None]
    want = (bright * COLORED["scattering"]).sum(0) * (HI - LO)[2] / n
    assert np.abs(got[..., :3].mean((0, 1)) / want - 1).max() < 0.01


def lit_by(light, emitted, n):
    """Scattered on the ray down the z axis: light from points (m, 3), of intensity (n, m) there."""
    depth = (np.arange(n) + 0.5) / n * (HI - LO)[2]
    p = np.column_stack([0 * depth, 0 * depth, HI[2] - depth])
    points, intensity = emitted(p)
    total = np.zeros(3)
    for point, bright in zip(points, intensity.T, strict=True):
        far = np.linalg.norm(p - point, axis=1)
        way = depth + np.minimum(depth_of(p, (point - p) / far[:, None]), far)
        seen = np.exp(-EXTINCTION * way[:, None]) * (bright / far**2)[:, None]
        total += (seen * COLORED["scattering"]).mean(0) * (HI - LO)[2] / (4 * np.pi)
    return total


def from_point(light):
    return lambda p: (np.array([light.position]), np.ones((len(p), 1)))


def from_spot(light):
    def emitted(p):
        to = light.position - p
        cosine = -(to @ light.direction) / np.linalg.norm(to, axis=1)
        return np.array([light.position]), (cosine > np.cos(light.angle / 2))[:, None]

    return emitted


def from_area(light, n=24):
    """A grid of points on the square, which shine by the cosine."""
    line = (np.arange(n) + 0.5) / n - 0.5
    u, v = (x.reshape(-1, 1) for x in np.meshgrid(line, line))
    points = light.position + u * light.axis_u + v * light.axis_v
    area = np.linalg.norm(np.cross(light.axis_u, light.axis_v)) / n**2

    def emitted(p):
        to = points[None] - p[:, None]
        cosine = -(to @ light.direction) / np.linalg.norm(to, axis=-1)
        return points, np.maximum(cosine, 0) * area

    return emitted


NEAR = np.array([0.005, 0.0, -0.3])  # of the ray down the z axis
LAMPS = {
    "point beside the ray": Light("point", (1, 1, 1), position=NEAR),
    "spot along it": Light(
        "spot", (1, 1, 1), position=NEAR, direction=unit(0.1, 0, 1), angle=1.0
    ),
    "spot across it": Light(
        "spot", (1, 1, 1), position=(0.3, 0, 0.2), direction=unit(-1, 0, 0.5), angle=0.1
    ),
    "wide spot": Light("spot", (1, 1, 1), position=NEAR, direction=unit(-1, 0.3, 0.5), angle=3.0),
    "square": Light(
        "area", (1, 1, 1), position=(0.05, 0, 0.1), direction=(-1, 0, 0), shape="rectangle",
        axis_u=(0, 0.05, 0), axis_v=(0, 0, 0.05), angle=np.pi,
    ),
    "point behind the end": Light("point", (1, 1, 1), position=(0.0, 0.0, LO[2] - 0.05)),
}  # fmt: skip


@pytest.mark.parametrize("name", LAMPS)
def test_fog_near_a_lamp_is_as_bright_as_the_integral_and_not_noisy(name):
    """By the density of the fog alone, 1,024 samples near the point would be 14 % off."""
    light = dataclasses.replace(LAMPS[name], position=np.array(LAMPS[name].position, float))
    emitted = {"point": from_point, "spot": from_spot, "area": from_area}[light.kind](light)
    want = lit_by(light, emitted, 4_000 if light.kind == "area" else 200_000)
    got = render([one(box())], [filled(**COLORED)], [light], samples=64, cam=down(width=1e-6))
    assert np.abs(got[..., :3].mean((0, 1)) / want - 1).max() < 0.015


@pytest.mark.parametrize("g", [0.0, 0.5])
@pytest.mark.parametrize("inside", [False, True])
def test_a_white_furnace_of_coloured_extinction(g, inside):
    """What scatters all that it takes cannot be seen before a white world."""
    cam = camera((0.1, 0.2, 0.3), (0.3, 0.2, -9), (4, 4), 0.8) if inside else None
    got = render([one(box())], [filled(scattering=EXTINCTION, anisotropy=g)], world=(1, 1, 1),
                 samples=1024, cam=cam, **DEEP)  # fmt: skip
    assert np.abs(got[..., :3].mean((0, 1)) - 1).max() < 0.01


def test_solids_that_overlap_are_a_furnace_too():
    solids = [one(box()), one(box(), at(0.2, 0.1, 0.7), first_material=1), haze((0.6,) * 3, DARK)]
    media = [filled(scattering=(0.2, 0.9, 0.1)), filled(scattering=(0.8, 0.1, 0.4), anisotropy=0.5)]
    got = render(solids, media, world=(1, 1, 1), samples=1024, **DEEP)
    assert np.abs(got[..., :3].mean((0, 1)) - 1).max() < 0.01


def test_fog_in_a_scene_of_few_slots_is_as_bright():
    """Whether a ray or its scattered one goes on is chosen at random where there is one slot."""
    light = Light("sun", (1, 1, 1), direction=unit(0.3, 0.2, 1.0))
    floor = one(box(LO - (2, 2, 3), HI - (-2, -2, 3)), first_material=1)
    media = [filled(**COLORED), Material.diffuse((0.5, 0.5, 0.5))]
    means = [
        render([one(box()), floor], media, [light], samples=1024, branches=branches,
               diffuse_bounces=2, max_bounces=4, volume_bounces=2)[..., :3].mean((0, 1))
        for branches in (1, 16)
    ]  # fmt: skip
    assert np.abs(means[0] / means[1] - 1).max() < 0.02


# ---- surfaces of such solids -----------------------------------------------------------


def test_the_bounds_of_media_are_no_transparent_surfaces():
    plate = box(LO, np.array([HI[0], HI[1], LO[2] + 0.5]), 0.0625)
    layers = [one(plate, at(0, 0, 0.6 * k)) for k in range(12)]
    got = render(layers, [filled(absorption=EXTINCTION)], world=(1, 1, 1), transparent_bounces=0)
    assert np.abs(got[..., :3] - np.exp(-6.0 * EXTINCTION)).max() < 1e-5


def test_passes_show_what_lies_within_and_behind():
    floor = one(box(LO - (0, 0, 3), HI - (0, 0, 3)), first_material=1, object_index=7)
    solids = [one(box(), object_index=5), floor]
    for kind, eye in (("orthographic", (0, 0, 9)), ("perspective", (0.1, 0.2, 9))):
        cam = camera(eye, size=(4, 4), width=0.05, kind=kind)
        got = render_passes(
            cam, solids, size=(4, 4), slots=(0, 1), world=(1, 1, 1),
            materials=[filled(absorption=EXTINCTION), Material.diffuse((1, 1, 1))],
        )  # fmt: skip
        assert np.abs(got["Depth"] - (9 - (HI[2] - 3)) * np.ones((4, 4, 1))).max() < (
            1e-5 if kind == "orthographic" else 0.05
        )
        assert (got["Object Index"] == 7).all()


def test_rays_through_corners_of_cells_end():
    """The box lies on the lattice, and so do the rays: where they meet it, cells meet."""
    cube = box(np.full(3, -1.25), np.full(3, 1.25), 0.25)
    cam = camera((0, 0, 5), size=(20, 20), width=0.8)
    got = render([one(cube)], [filled(absorption=(0.5, 0.5, 0.5))], cam=cam, size=(20, 20),
                 world=(1, 1, 1))  # fmt: skip
    o, d = centre_rays(cam, (20, 20))
    want = np.exp(-0.5 * depth_of(o, d, np.full(3, -1.25), np.full(3, 1.25)))
    clear = np.abs(np.abs((o + d * 3.75 / -d[..., 2:])[..., :2]).max(-1) - 1.25) > 0.2
    assert np.abs(got[..., 0] - want)[clear].max() < 1e-5


def test_glass_is_filled_as_well():
    """Straight through a plate: two losses by reflection, and the medium between."""
    glass = Material([Lobe("refraction", (1, 1, 1), ior=1.5)], glow=(0.4, 0, 0),
                     absorption=EXTINCTION)  # fmt: skip
    clear = Material([Lobe("refraction", (1, 1, 1), ior=1.5)])
    more = dict(world=(1, 1, 1), max_bounces=8, transmission_bounces=8)
    got, plain = (render([one(box())], [m], **more)[..., :3] for m in (glass, clear))
    passed = np.exp(-EXTINCTION * (HI - LO)[2])
    way = (1 - passed[0]) / EXTINCTION[0]
    once = np.sqrt(plain[..., 0])  # through one of the faces
    assert np.abs(got[..., 1:] - plain[..., 1:] * passed[1:]).max() < 1e-6
    assert np.abs(got[..., 0] - plain[..., 0] * passed[0] - once * 0.4 * way).max() < 1e-4


@pytest.mark.parametrize("flag", ["camera", "shadow", "diffuse"])
def test_media_that_rays_do_not_see(flag):
    """Nor are shadow rays in what the ray before them has not entered, as in Cycles."""
    hidden = one(box(), **{f"visible_{flag}": False})
    floor = one(box(LO - (0, 0, 0.5), HI - (0, 0, 1.5)), first_material=1)
    black = Material.diffuse((1, 1, 1))
    light = [Light("sun", (np.pi,) * 3, direction=(0, 0, 1))]
    got = render([hidden, floor], [filled(absorption=EXTINCTION), black], light)[..., :3]
    once = np.exp(-EXTINCTION * 1.5)
    want = {"camera": 1.0, "shadow": once, "diffuse": once * once}[flag]
    assert np.abs(got - want).max() < 1e-5


@pytest.mark.parametrize("sigma", [1e30, 1e-30])
def test_numbers_of_any_size(sigma):
    light = Light("sun", (1, 1, 1), direction=unit(0.3, 0.2, 1.0))
    medium = filled(scattering=(sigma,) * 3, absorption=(sigma,) * 3)
    got = render([one(box())], [medium], [light], samples=16, world=(1, 1, 1), **DEEP)
    assert got[..., :3].max() < 2
    if sigma < 1:
        assert np.abs(got[..., :3] - 1).max() < 1e-6


@pytest.mark.parametrize(
    ("medium", "words"),
    [
        (dict(scattering=(-1, 0, 0)), "scattering of 0 or more"),
        (dict(glow=(np.nan, 0, 0)), "finite glow"),
        (dict(absorption=(np.inf, 0, 0)), "finite absorption"),
        (dict(anisotropy=1.5), "anisotropy of material 0"),
        (dict(anisotropy=np.nan), "anisotropy of material 0"),
        (dict(phase="mie"), "phase function"),
        (dict(lobes=[Lobe("diffuse")]), "no lobes"),
    ],
)
def test_what_no_medium_is_like_is_refused(medium, words):
    wrong = Material(**{"lobes": (), "bare": True, **medium})
    with pytest.raises(leapray.LeapRayError, match=words):
        render([one(box())], [wrong])
