# SPDX-License-Identifier: GPL-3.0-or-later
"""Paths against optics: furnaces, mirrors, glass, absorption, coloured shadows, bounces."""

from __future__ import annotations

import meshes
import numpy as np
import pytest
from stage import (
    FAR,
    IDENTITY,
    at,
    ball,
    camera,
    centre_rays,
    clearance,
    meet_sphere,
    one,
    slab,
)

import leapray
from leapray import Light, Lobe, Material, World

ALL = (1.0, 1.0, 1.0)
DEEP = dict(max_bounces=64, diffuse_bounces=64, glossy_bounces=64, transmission_bounces=64)


def material(kind, color=ALL, absorption=(0, 0, 0), **more):
    return Material([Lobe(kind, color, **more)], absorption=absorption)


def render(cam, things, lights=(), *, world=ALL, size=(96, 64), samples=1, nested=True, **more):
    """things: pairs of an instance and its material."""
    instances = [one(i.structure, i.world_from_object, first_material=k, **shown(i))
                 for k, (i, _) in enumerate(things)]  # fmt: skip
    world = world if isinstance(world, World) else World(world)
    materials = [m for _, m in things]
    slots = range(len(materials))
    scene = leapray.Scene(cam, instances, lights, materials, slots, world, nested=nested)
    return scene.render_tile(0, 0, *size, samples=samples, **(DEEP | more))


def shown(instance):
    names = ("camera", "shadow", "diffuse", "glossy", "transmission")
    return {f"visible_{n}": getattr(instance, f"visible_{n}") for n in names} | {
        "object_index": instance.object_index
    }


def bent(d, n, eta):
    """d (unit) refracted at a surface with normal n against it; eta: index before over after."""
    c = -(d * n).sum(-1, keepdims=True)
    return eta * d + (eta * c - np.sqrt(1 - eta**2 * (1 - c * c))) * n


def normalized(d):
    return d / np.linalg.norm(d, axis=-1, keepdims=True)


def degrees(a, b):
    half = np.linalg.norm(normalized(a) - normalized(b), axis=-1) / 2
    return np.degrees(2 * np.arcsin(np.clip(half, 0, 1)))


@pytest.fixture(scope="module")
def compass():
    """A world whose radiance tells the direction that it comes from: (d + 1) / 2."""
    n = 512
    v, u = np.mgrid[:n, : 2 * n] + 0.5
    east, north = (0.5 - u / (2 * n)) * 2 * np.pi, (v / n - 0.5) * np.pi
    d = np.cos(north)[..., None] * np.stack([np.cos(east), np.sin(east), np.tan(north)], -1)
    return World(ALL, ((d + 1) / 2).astype(np.float32))


def seen(picture):
    return 2 * picture["Combined"][..., :3].astype(float) - 1


# ---- furnaces ----------------------------------------------------------------------------------

WHITE_THINGS = {
    "diffuse": material("diffuse"),
    "mirror": material("glossy", roughness=0.0),
    "rough metal": material("glossy", roughness=0.4),
    "rougher metal": material("principled", roughness=0.8, metallic=1.0),
    "plastic": material("principled", roughness=0.3),
    "glass": material("glass", ior=1.5),
    "transparent": material("transparent"),
}


@pytest.mark.parametrize("branches", [1, 4])
@pytest.mark.parametrize("name", WHITE_THINGS)
def test_what_loses_no_light_vanishes_in_a_uniform_world(name, branches, sphere):
    cam = camera((0, -4, 0))
    thing = (one(sphere), WHITE_THINGS[name])
    got = render(cam, [thing], samples=64, branches=branches)
    hit = (got["Depth"] < FAR)[..., 0]
    assert hit.mean() > 0.2
    assert abs(got["Combined"][hit].mean() - 1) < 0.005
    clear = clearance(*centre_rays(cam, (96, 64))) > 1.05
    assert (got["Combined"][clear] == 1).all()


@pytest.mark.parametrize("albedo", [0.5, 0.9])
def test_an_emitting_cavity_sums_the_series_of_its_bounces(albedo, sphere):
    wall = Material([Lobe("diffuse", (albedo,) * 3), Lobe("emission", (0.1,) * 3)])
    cam = camera((0, -0.4, 0), (0, 1, 0), width=1.5)
    for limit in (0, 1, 5, 64):
        got = render(cam, [(one(sphere), wall)], samples=16, diffuse_bounces=limit, world=(7, 7, 7))
        want = 0.1 * sum(albedo**k for k in range(limit + 2))
        assert got["Combined"][..., 0].mean() == pytest.approx(want, rel=0.005)


# ---- mirrors and glass -------------------------------------------------------------------------


def test_a_mirror_ball_shows_the_world_by_the_law_of_reflection(sphere, compass):
    cam = camera((0.3, -4, 0.2), width=0.6)
    got = seen(render(cam, [(one(sphere), material("glossy", roughness=0.0))], world=compass))
    o, d = centre_rays(cam, (96, 64))
    d = normalized(d)
    inner = clearance(o, d) < np.cos(np.radians(5))
    n = o + meet_sphere(o, d)[..., None] * d
    want = d - 2 * (d * n).sum(-1, keepdims=True) * n
    assert inner.mean() > 0.4
    error = degrees(got, want)[inner]
    assert np.percentile(error, 99) < 0.25  # twice what the normals of this ball are off
    empty = seen(render(cam, [], world=compass))
    assert degrees(empty, d).max() < 1e-3


def test_glass_bends_rays_as_refraction_has_it(compass):
    cam = camera((0.3, -4, 0.2), width=0.55)
    glass = material("refraction", ior=1.5)
    got = seen(render(cam, [(one(leapray.build(ball(64.0))), glass)], world=compass))
    o, d = centre_rays(cam, (96, 64))
    d = normalized(d)
    inner = clearance(o, d) < np.cos(np.radians(5))
    p = o + meet_sphere(o, d)[..., None] * d
    within = bent(d, p, 1 / 1.5)
    q = p - 2 * (p * within).sum(-1, keepdims=True) * within
    want = bent(within, -q, 1.5)
    assert inner.mean() > 0.4
    error = degrees(got, want)[inner]
    assert np.percentile(error, 99) < 0.03
    assert error.max() < 0.1


def test_total_reflection_keeps_light_inside():
    """A view along the axis of a half ball from inside a dense medium: a disc of escape."""
    cam = camera((0, 0, -0.5), (0, 0, 5), width=4)
    box = leapray.build(ball(25.6))
    got = render(cam, [(one(box), material("refraction", ior=1.5))], max_bounces=1)
    o, d = centre_rays(cam, (96, 64))
    d = normalized(d)
    q = o + meet_sphere(o, d, far=True)[..., None] * d
    sine = np.sqrt(1 - np.clip((q * d).sum(-1), -1, 1) ** 2)
    clear = np.abs(sine * 1.5 - 1) > 0.01
    out = got["Combined"][..., 0] > 0.5
    assert 0.3 < (sine * 1.5 < 1)[clear].mean() <= 1
    np.testing.assert_array_equal(out[clear], (sine * 1.5 < 1)[clear])


@pytest.mark.parametrize("nested", [True, False], ids=["nested", "each by itself"])
def test_solids_in_each_other_bend_by_the_ratio_of_their_indices(nested, compass):
    """Water in glass in air, and a bubble in the water; or, as in Cycles, each by its own index."""
    cam = camera((0.2, -4, 0.1), width=0.5)
    indices, radii = (1.0, 1.5, 1.33, 1.0), (1.0, 0.75, 0.4)
    structure = leapray.build(ball(48.0))
    things = [
        (one(structure, at(scale=r)), material("refraction", ior=n))
        for r, n in zip(radii, indices[1:], strict=True)
    ]
    got = seen(render(cam, things, world=compass, nested=nested))
    o, d = centre_rays(cam, (96, 64))
    d = normalized(d)
    around = indices[:-1] if nested else (1.0,) * len(radii)
    want, safe = through_shells(o, d, radii, indices[1:], around)
    assert safe.mean() > 0.2
    assert np.percentile(degrees(got, want)[safe], 99) < 0.2


def through_shells(o, d, radii, indices, around):
    """Directions behind concentric spheres, of some indices in others.

    safe: no ray comes near to grazing or to the rim.
    """
    safe = np.ones(d.shape[:-1], bool)
    deepest = np.zeros(d.shape[:-1], int)
    for depth, radius in enumerate(radii):  # inwards
        gap = clearance(o, d)
        enters = (gap < radius) & (deepest == depth)
        safe &= ~((deepest == depth) & (np.abs(gap / radius - 1) < 0.02))
        t = meet_sphere(o, d, radius)
        p = o + np.where(enters, t, 0)[..., None] * d
        eta = around[depth] / indices[depth]
        with np.errstate(invalid="ignore"):
            turned = bent(d, p / radius, eta)
        total = enters & ~np.isfinite(turned).all(-1)
        safe &= ~total
        enters &= ~total
        o, d = np.where(enters[..., None], p, o), np.where(enters[..., None], turned, d)
        deepest += enters
    for depth in range(len(radii) - 1, -1, -1):  # and out again
        leaves = deepest > depth
        t = meet_sphere(o, d, radii[depth], far=True)
        p = o + np.where(leaves, t, 0)[..., None] * d
        with np.errstate(invalid="ignore"):
            turned = bent(d, -p / radii[depth], indices[depth] / around[depth])
        safe &= ~(leaves & ~np.isfinite(turned).all(-1))
        o, d = np.where(leaves[..., None], p, o), np.where(leaves[..., None], turned, d)
    return d, safe


@pytest.mark.parametrize("limit", [0, 3, 64])
def test_a_hall_of_mirrors_dims_by_every_bounce(limit):
    """Two facing mirrors, a gap of 1 apart; rays leave by the open end."""
    wall = leapray.build(slab())
    flip = np.diag([1.0, 1, -1, 1])
    upper = at(z=1.0) @ flip
    mirror = material("glossy", (0.9,) * 3, roughness=0.0)
    cam = camera((0, -3.9, 0.5), (0, 0, 3.0), size=(8, 64), width=0.02)
    got = render(cam, [(one(wall), mirror), (one(wall, upper), mirror)], size=(8, 64),
                 glossy_bounces=limit, max_bounces=limit)  # fmt: skip
    d = centre_rays(cam, (8, 64))[1]
    slope = d[..., 2] / d[..., 1]
    height = 0.5 + slope * (4.0 + 3.9)  # where it would be at the end
    bounces = np.floor(height).astype(int)
    clear = np.abs(height - np.round(height)) > 0.02
    want = np.where(bounces <= limit + 1, 0.9**bounces, 0)
    assert bounces.min() >= 3
    assert bounces.max() > 4
    np.testing.assert_allclose(got["Combined"][..., 0][clear], want[clear], rtol=1e-4, atol=1e-6)


def test_memory_does_not_depend_on_depth_or_samples(sphere):
    glass = material("glass", ior=1.5)
    scene = leapray.Scene(camera((0, -4, 0)), [one(sphere)], (), [glass], [0], World(ALL))
    workspace = scene.workspace(32, 32, 4)
    for depth in (0, 1, 8, 64):
        got = scene.render_tile(
            32, 16, 32, 32, samples=8, workspace=workspace, branches=4, max_bounces=depth,
            transmission_bounces=depth, glossy_bounces=depth,
        )  # fmt: skip
        assert np.isfinite(got["Combined"]).all()


# ---- absorption, transparency, shadows ---------------------------------------------------------


@pytest.mark.parametrize("kind", ["transparent", "refraction"])
@pytest.mark.parametrize("matrix", [IDENTITY, at(scale=0.5)], ids=["plain", "half"])
def test_a_solid_absorbs_by_the_length_of_the_path_through_it(kind, matrix, sphere):
    sigma = np.array([0.2, 1.0, 3.0])
    cam = camera((0, -4, 0), width=0.6)
    tinted = material(kind, absorption=sigma, ior=1.0)
    got = render(cam, [(one(sphere, matrix), tinted)])
    o, d = centre_rays(cam, (96, 64))
    radius = matrix[0, 0]
    gap = clearance(o, d)
    inner = gap < 0.95 * radius
    chord = 2 * np.sqrt(radius**2 - gap[inner] ** 2)
    want = np.exp(-sigma * chord[:, None])
    np.testing.assert_allclose(got["Combined"][inner][:, :3], want, rtol=0.01)


def test_a_camera_in_a_solid_sees_through_its_medium(sphere):
    cam = camera((0, -0.3, 0), (0, 1, 0), width=1.0)
    got = render(cam, [(one(sphere), material("transparent", absorption=(1, 1, 1)))])
    o, d = centre_rays(cam, (96, 64))
    want = np.exp(-meet_sphere(o, normalized(d), far=True))
    np.testing.assert_allclose(got["Combined"][..., 0], want, rtol=0.005)


def test_shadows_take_on_the_colour_of_what_is_transparent(sphere, floor):
    sun = Light("sun", (3, 3, 3), direction=(0, 0, 1))
    tint, sigma = np.array([0.9, 0.5, 0.0]), np.array([0.0, 0.4, 0.0])
    pane = material("transparent", tint, absorption=sigma)
    body = one(sphere, at(z=2.0, scale=0.8), visible_camera=False)
    cam = camera((0, 0, 9), size=(64, 64), width=4, kind="orthographic")
    white = material("diffuse")
    got = render(cam, [(one(floor), white), (body, pane)], [sun], world=(0, 0, 0), size=(64, 64))
    free = render(cam, [(one(floor), white)], [sun], world=(0, 0, 0), size=(64, 64))
    fraction = got["Combined"][..., :3] / free["Combined"][..., :3]
    gap = np.linalg.norm(got["Position"][..., :2], axis=-1)
    chord = 2 * np.sqrt(np.maximum(0.64 - gap**2, 0))[..., None]
    under, beside = gap < 0.76, gap > 0.81
    assert under.mean() > 0.05
    want = tint**2 * np.exp(-sigma * chord)
    np.testing.assert_allclose(fraction[under], want[under], rtol=0.02, atol=1e-6)
    np.testing.assert_array_equal(fraction[beside], 1)
    opaque = render(cam, [(one(floor), white), (body, material("glass"))], [sun],
                    world=(0, 0, 0), size=(64, 64), diffuse_bounces=0)  # fmt: skip
    assert not opaque["Combined"][under][:, :3].any()  # as Cycles: glass casts a full shadow


@pytest.mark.parametrize("kind", ["sun", "point"])
def test_every_pane_before_a_light_attenuates_it(kind, floor):
    """They cover the whole picture, so that every ray of the wave goes on."""
    light = Light(kind, (3, 3, 3), (0, 0, 40), direction=(0, 0, 1))
    cam = camera((0, 0, 1), size=(8, 8), width=1, kind="orthographic")
    tint, sigma, thickness = 0.9, 0.2, 8.75 / 8  # of voxels of 1/8
    pane = material("transparent", (tint,) * 3, absorption=(sigma,) * 3)
    panes = leapray.build(slab(half=2.0))

    def mean(n):
        things = [one(panes, at(z=3.0 + 2 * k), visible_camera=False) for k in range(n)]
        things = [(one(floor), material("diffuse")), *((thing, pane) for thing in things)]
        return render(cam, things, [light], world=(0, 0, 0), size=(8, 8))["Combined"][..., 0].mean()

    free = mean(0)
    for n in (1, 2, 3):
        want = (tint**2 * np.exp(-sigma * thickness)) ** n
        assert mean(n) / free == pytest.approx(want, rel=1e-3)


def test_beyond_the_limit_of_transparent_surfaces_all_is_black(sphere):
    things = [(one(sphere, at(y=2.5 * k)), material("transparent")) for k in range(3)]
    cam = camera((0, -40, 0), width=0.02)
    for limit in range(8):
        got = render(cam, things, transparent_bounces=limit)
        assert (got["Combined"][32, 48, :3] == (limit >= 5)).all()  # six surfaces


# ---- flags, lights, passes ----------------------------------------------------------------------


@pytest.mark.parametrize("flag", ["diffuse", "glossy", "transmission"])
def test_an_object_hides_from_the_rays_that_may_not_see_it(flag, sphere, floor):
    """A black ball around all shuts the world out, but for rays that do not see it."""
    lobes = {"diffuse": "diffuse", "glossy": "glossy", "transmission": "refraction"}
    cam = camera((0, -4, 0))
    thing = material(lobes[flag], roughness=0.0, ior=1.2)
    for visible in (True, False):
        shell = one(sphere, at(scale=9.0), **{f"visible_{flag}": visible})
        got = render(cam, [(one(sphere), thing), (shell, material("diffuse", (0, 0, 0)))],
                     samples=4)  # fmt: skip
        inner = clearance(*centre_rays(cam, (96, 64))) < 0.8
        bright = got["Combined"][inner][:, 0]
        assert (bright == 0).all() if visible else (bright > 0.99).all()


@pytest.mark.parametrize("roughness", [0.0, 0.15, 0.5])
def test_an_area_light_and_an_emitter_of_its_shape_light_alike(roughness, floor):
    """The light is sampled; the emitter only rays of the metal find."""
    emission = material("emission", (2, 2, 2))
    metal = material("glossy", roughness=roughness)
    cam = camera((0, -4, 2), size=(48, 32))
    plate = np.diag([0.5 / 4.0625, 0.5 / 4.0625, 1e-4, 1])  # cells reach half a voxel beyond 4
    plate[:3, 3] = 0, 1.0, 1.0
    body = one(floor, np.diag([1.0, 1, -1, 1]) @ np.eye(4))
    body = one(floor, plate, visible_camera=False)
    light = Light("area", (2, 2, 2), position=(0, 1.0, 1.0 - 1e-4), direction=(0, 0, -1),
                  axis_u=(1, 0, 0), axis_v=(0, 1, 0), angle=np.pi, shape="rectangle",
                  casts_shadow=True)  # fmt: skip
    setting = dict(world=(0, 0, 0), size=(48, 32), samples=1024)
    sampled = render(cam, [(one(floor), metal)], [light], **setting)["Combined"][..., 0]
    found = render(cam, [(one(floor), metal), (body, emission)], **setting)["Combined"][..., 0]
    part = (slice(4, 24), slice(12, 36))
    assert found[part].mean() > 0.01
    assert sampled[part].mean() == pytest.approx(found[part].mean(), rel=0.02)


def test_what_the_workspace_held_before_does_not_matter():
    """A sheet that refracts and lets light through holds no medium, whatever lies there."""
    sheet = leapray.build(leapray.voxelize(*meshes.plane(), 0.1, kind="sheet"))
    clear = Lobe("transparent", weight=0.5)
    lobes = [Lobe("refraction", ior=1.5, roughness=0.3, weight=0.5), clear]
    white = Material([Lobe("diffuse", (1, 1, 1))])
    things = [
        one(sheet, at(z=1, scale=4)),
        one(sheet, at(z=-1, scale=8), first_material=1),
    ]
    lights = [Light("sun", (3, 3, 3), direction=(0, 0.6, 0.8))]
    scene = leapray.Scene(
        camera((0.5, 0.5, 6), (0.5, 0.5, 0)), things, lights, [Material(lobes), white], range(2)
    )
    pictures = []
    for byte in (0, 1, 255):
        room = scene.workspace(32, 32)
        room.fill(byte)
        pictures.append(scene.render_tile(20, 10, 32, 32, samples=4, workspace=room)["Combined"])
    assert pictures[0][..., :3].max() > 0.1
    for other in pictures[1:]:
        np.testing.assert_array_equal(other, pictures[0])
