# SPDX-License-Identifier: GPL-3.0-or-later
"""Every filter gives the occupancy that its formula says, and the box what is covered."""

import math

import numpy as np
import pytest
from meshes import box, icosphere, joined, plane, positions, spiky, torus
from numpy.testing import assert_allclose, assert_array_equal
from scenes import place, replace, scene
from scenes import plane as model_plane
from scenes import sphere as model_sphere

import leapray
from addon import pipeline
from addon.plan import plan
from addon.store.memory_cache import Cache
from leapray.voxelization import FILTERS, filter_info, slope

TOP = {"u8": 255, "u16": 65535, "f32": 1.0}
HALF_STEP = {"u8": 0.5 / 255, "u16": 0.5 / 65535, "f32": 1e-7}
erf = np.vectorize(math.erf)


def formula(name, s, r):
    """Occupancy at distance s inside a plane, in voxels."""
    u = np.minimum(np.abs(s) / r, 1.0)
    sign = np.where(s >= 0, 1.0, -1.0)
    if name == "ramp":
        return np.clip(0.5 + s / (2 * r), 0, 1)
    if name == "cone":
        return 0.5 + sign * (u - u**3 + u**4 / 2)
    if name == "gauss":
        return 0.5 * (1 + erf(s / (r * 2**0.5)))
    if name == "binary":
        return (s >= 0).astype(float)
    return np.clip(0.5 + s, 0, 1)  # the box, of a plane along the lattice


def occupancy(volume):
    return volume.read() / TOP[volume.info.dtype]


def volume_of(vertices, triangles):
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    return np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6


def turned(mesh, seed=0):
    q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return mesh[0] @ (q * np.sign(np.linalg.det(q))).T, mesh[1]


# ---- profiles ------------------------------------------------------------------


@pytest.mark.parametrize("dtype", TOP)
@pytest.mark.parametrize("name", FILTERS)
def test_a_wall_has_the_profile_of_the_formula(name, dtype):
    h = 1 / 16
    height = 1.0 + 0.3 * h  # off the lattice, which binary needs
    volume = leapray.voxelize(*box((-1, -1, -2), (1, 1, height)), h, filter=name, dtype=dtype)
    places, g = positions(volume), occupancy(volume)
    inner = (np.abs(places[..., :2]).max(axis=-1) < 0.6) & (places[..., 2] > 0)
    s = (height - places[inner][:, 2]) / h
    width = filter_info(name, dtype).half_width
    want = formula(name, s, width)
    cut = 3.5e-6 if name == "gauss" else 0.0  # where its tail ends
    assert_allclose(g[inner], want, atol=HALF_STEP[dtype] + cut)
    assert slope(name, width) == pytest.approx(
        {"ramp": 0.5 / width, "cone": 1 / 3, "gauss": 0.398942}.get(name, 1)
    )


@pytest.mark.parametrize("name", ["ramp", "cone", "gauss", "binary"])
@pytest.mark.parametrize("width", [0.7, 2.0, 4.0])
def test_a_ball_has_the_profile_of_its_distance(name, width):
    v, t = icosphere(5)
    volume = leapray.voxelize(v, t, 1 / 12, filter=name, half_width=width, dtype="f32")
    s = (1 - np.linalg.norm(positions(volume), axis=-1)) * 12
    away = np.abs(s) > 0.01  # where facets cannot change the side
    sag = 12 * (1 - np.linalg.norm(v[t].mean(axis=1), axis=1).min())
    got, want = occupancy(volume)[away], formula(name, s, width)[away]
    assert np.abs(got - want).max() < 1.5 * sag * slope(name, width) + 4e-6


def test_sheets_take_cone_and_gauss():
    for name in ("cone", "gauss"):
        volume = leapray.voxelize(*plane(4), 1 / 16, filter=name)
        assert volume.info.kind == "sheet"
        value, gradient = volume.sample([[0.1, 0.2, 0.0], [0.1, 0.2, 0.5 / 16]])
        assert value[0] == pytest.approx(0.5, abs=1e-4)
        assert -gradient[0, 2] / 16 == pytest.approx(
            abs(value[1] - 0.5) * 2, rel=1e-3
        )  # linear within the cell


@pytest.mark.parametrize("name", FILTERS)
def test_what_the_core_says_of_a_filter_is_what_it_does(name):
    told = filter_info(name, "u16")
    leapray.voxelize(*box(), 4.0, filter=name, half_width=told.widest)
    with pytest.raises(leapray.LeapRayError, match="half_width must lie"):
        leapray.voxelize(*box(), 4.0, filter=name, half_width=1.001 * told.widest)
    if told.of_solids:
        with pytest.raises(leapray.LeapRayError, match="tell inside from outside"):
            leapray.voxelize(*plane(2), 0.5, filter=name)
    else:
        assert leapray.voxelize(*plane(2), 0.5, filter=name).info.kind == "sheet"


# ---- the box -------------------------------------------------------------------

CLOSED = {
    "cube": box(),
    "cube between samples": box((-0.53125,) * 3, (0.53125,) * 3),
    "turned cube": turned(box()),
    "torus": torus(),
    "sphere": icosphere(4),
    "spikes": spiky(3),
    "shell": joined(icosphere(3), (icosphere(2, 0.6)[0], icosphere(2)[1][:, ::-1])),
    "inside out": (torus()[0], torus()[1][:, ::-1]),
    "speck": icosphere(1, 0.03, (0.02, 0.01, 0.04)),
    "needle": (icosphere(2)[0] * (1.0, 0.02, 0.02), icosphere(2)[1]),
}


@pytest.mark.parametrize("h", [1 / 16, 1 / 17.3, 1 / 5])
@pytest.mark.parametrize("name", CLOSED)
def test_the_box_keeps_the_volume(name, h):
    v, t = CLOSED[name]
    true = abs(volume_of(v, t))
    for dtype, within in (("f32", 1e-7), ("u16", 1e-4)):
        g = occupancy(leapray.voxelize(v, t, h, filter="box", dtype=dtype))
        assert g.min() >= 0.0 and g.max() <= 1.0
        step = 0 if dtype == "f32" else HALF_STEP[dtype] * ((g > 0) & (g < 1)).sum() * h**3 / true
        assert g.sum(dtype=float) * h**3 == pytest.approx(true, rel=within if name != "speck" else
                                                          within + step)  # fmt: skip


def about_z(mesh, angle):
    c, s = np.cos(angle), np.sin(angle)
    return mesh[0] @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]), mesh[1]


def balls(levels, apart):
    """Two crossing balls of facets, and the volume of their union by that of round balls."""
    one, other = icosphere(levels), icosphere(levels, 1.0, (apart, 0, 0))
    radius = (volume_of(*one) / (4 * math.pi / 3)) ** (1 / 3)
    lens = math.pi * (4 * radius + apart) * (2 * radius - apart) ** 2 / 12
    return joined(one, other), 2 * volume_of(*one) - lens


BARS = [box(-np.roll(r, a), np.roll(r, a)) for a in range(3) for r in [np.array((1.0, 0.3, 0.3))]]
UNIONS = {  # mesh, volume of the union, within
    "boxes": (joined(box(), box((-0.5, -0.4, 0.1), (1.7, 0.3, 1.4))), 10.002 - 0.945, 1e-7),
    "star": (  # what two squares share is an octagon
        joined(box(), about_z(box((-1, -1, -1.3), (1, 1, 0.7)), math.pi / 4)),
        16 - 8 * (2**0.5 - 1) * 1.7,
        1e-7,
    ),
    "three bars": (joined(*BARS), 3 * 0.72 - 2 * 0.6**3, 1e-7),
    "thin overlap": (joined(box(), box((0.99, -1, -1), (2, 1, 1))), 12, 1e-7),
    "box in a box": (joined(box(), box((-0.5, -0.3, -0.2), (0.4, 0.3, 0.2))), 8, 1e-7),
    "ball in a ball": (
        joined(icosphere(3), icosphere(3, 0.7, (0.1, 0, 0))),
        volume_of(*icosphere(3)),
        1e-7,
    ),
    "balls": (*balls(4, 1.2), 1e-5),  # what facets make of the lens
}


@pytest.mark.parametrize("h", [1 / 8, 0.0613])
@pytest.mark.parametrize("around", [None, 1])
@pytest.mark.parametrize("name", UNIONS)
def test_the_box_keeps_the_volume_of_the_union_where_shells_cross(name, around, h):
    mesh, true, within = UNIONS[name]
    mesh = mesh if around is None else turned(mesh, around)
    volume = leapray.voxelize(*mesh, h, filter="box", dtype="f32", kind="solid")
    g = volume.read()
    assert volume.mesh_info.winding and g.min() >= 0 and g.max() <= 1
    assert g.sum(dtype=float) * h**3 == pytest.approx(true, rel=within)


def test_shares_of_crossing_boxes_are_exact():
    lo, hi = np.array([(-1, -1, -1), (-0.5, -0.4, 0.1)]), np.array([(1, 1, 1), (1.7, 0.3, 1.4)])
    h = 1 / 7
    mesh = joined(box(lo[0], hi[0]), box(lo[1], hi[1]))
    volume = leapray.voxelize(*mesh, h, filter="box", dtype="f32")
    places = positions(volume)

    def fraction(lo, hi):
        sides = np.minimum(places + h / 2, hi) - np.maximum(places - h / 2, lo)
        return np.prod(np.maximum(sides, 0) / h, axis=-1)

    both = fraction(np.maximum(lo[0], lo[1]), np.minimum(hi[0], hi[1]))
    assert 0 < both.sum() < 0.2 * volume.read().sum()
    assert_allclose(
        volume.read(), fraction(lo[0], hi[0]) + fraction(lo[1], hi[1]) - both, atol=1e-6
    )


def test_many_small_triangles_that_cross_in_a_voxel_are_sampled():
    """Beyond 32 triangles; the points are 6 to an axis, so a voxel is off by some hundredths."""
    mesh, true = balls(5, 1.2)
    h = 0.3
    volume = leapray.voxelize(*mesh, h, filter="box", dtype="f32")
    assert volume.mesh_info.winding
    assert volume.read().sum(dtype=float) * h**3 == pytest.approx(true, rel=5e-4)


@pytest.mark.parametrize("name", ["sphere", "torus", "turned cube"])
def test_the_box_keeps_the_volume_in_8_bits_where_steps_even_out(name):
    v, t = CLOSED[name]
    g = occupancy(leapray.voxelize(v, t, 1 / 32, filter="box", dtype="u8"))
    assert g.sum() / 32**3 == pytest.approx(volume_of(v, t), rel=1e-4)


def test_shares_are_those_of_numeric_integration():
    """Of a turned cube and of a ball: 10^3 points in every voxel."""
    cube, h, n = turned(box()), 1 / 6, 10
    back = np.linalg.lstsq(box()[0], cube[0], rcond=None)[0].T
    cases = [
        (cube, lambda p: np.abs(p @ back).max(axis=-1) < 1),
        (icosphere(6), lambda p: (p * p).sum(axis=-1) < 1),
    ]
    offsets = (np.arange(n) + 0.5) / n - 0.5
    for (v, t), covers in cases:
        volume = leapray.voxelize(v, t, h, filter="box", dtype="f32")
        places, fraction = positions(volume), np.zeros(volume.info.size[::-1])
        for a in offsets:
            for b in offsets:
                for c in offsets:
                    fraction += covers(places + h * np.array([a, b, c]))
        assert np.abs(volume.read() - fraction / n**3).max() < 0.02


def test_threads_change_no_share():
    one, seven = (
        leapray.voxelize(*torus(), 1 / 20, filter="box", threads=n).read() for n in (1, 7)
    )
    assert_array_equal(one, seven)


# ---- normals -------------------------------------------------------------------


def mean_error(name, width, dtype, radius):
    """Mean angle in degrees between central differences and a ball's own normals."""
    n = int(2 * radius) + 24
    middle = (n - 1) / 2 + 0.13
    z, y, x = np.mgrid[:n, :n, :n] - middle
    g = formula(name, radius - np.sqrt(x * x + y * y + z * z), width)
    g = g.astype(np.float32) if dtype == "f32" else np.round(g * TOP[dtype])
    g = g.astype({"u8": np.uint8, "u16": np.uint16, "f32": np.float32}[dtype])
    o = np.random.default_rng(0).normal(size=(3000, 3))
    o /= np.linalg.norm(o, axis=1, keepdims=True)
    hits = leapray.trace(leapray.build(leapray.Volume(g)), middle + o * (radius + 8), -o)
    return np.degrees(np.arccos(np.clip((hits.normal * o).sum(axis=1), -1, 1))).mean()


@pytest.mark.parametrize(
    "name, width, dtype, radius, degrees",
    [
        ("ramp", 1.6, "u8", 25.6, 0.139),
        ("ramp", 1.8, "u8", 25.6, 0.113),
        ("ramp", 2.45, "u8", 25.6, 0.149),
        ("ramp", 2.45, "u8", 8.0, 0.183),
        ("ramp", 2.5, "f32", 25.6, 0.009),
        ("ramp", 1.0, "f32", 25.6, 1.9),
        ("ramp", 0.5, "f32", 25.6, 5.1),
        ("binary", 0.5, "f32", 25.6, 10.6),
    ],
)
def test_normals_err_as_published_or_measured_before(name, width, dtype, radius, degrees):
    assert mean_error(name, width, dtype, radius) == pytest.approx(degrees, rel=0.06, abs=5e-4)


def test_the_default_widths_are_the_best_for_their_samples():
    eight = {w: mean_error("ramp", w, "u8", 25.6) for w in (1.4, 1.8, 2.5)}
    assert min(eight, key=eight.get) == filter_info("ramp", "u8").half_width == 1.8
    assert filter_info("ramp", "u16").half_width == filter_info("ramp", "f32").half_width == 2.5
    assert mean_error("ramp", 2.5, "u16", 25.6) < 0.5 * mean_error("ramp", 1.8, "u16", 8.0)


# ---- words and settings ----------------------------------------------------------


@pytest.mark.parametrize(
    "more, words",
    [
        ({"filter": "hat"}, "unknown filter 'hat'"),
        ({"filter": "gauss", "half_width": 8.0}, r"half_width must lie in \(0, 7.11\] voxels"),
        ({"filter": "cone", "half_width": 0.0}, r"half_width must lie in \(0, 32\] voxels"),
        ({"filter": "box", "kind": "sheet"}, "taken for a sheet, which has neither"),
        ({"filter": "binary", "kind": "sheet"}, "use ramp, cone or gauss, or kind solid"),
    ],
)
def test_what_is_wrong_is_said(more, words):
    with pytest.raises(leapray.LeapRayError, match=words):
        leapray.voxelize(*box(), 0.2, **more)


@pytest.mark.parametrize("name", FILTERS)
def test_a_scene_is_planned_with_any_filter(name):
    what = scene([model_sphere(n=24)], [place(0)], filter=name, pixel_error=1.0)
    made = plan.make(what, Cache(), leapray.Watch(), 1)
    value = occupancy(made.instances[0].structure.volume)
    between = ((value > 0) & (value < 1)).any()
    assert between == (name != "binary")
    assert made.volumes[0]["error_footprints"] <= 1.0


def test_another_filter_makes_another_volume():
    cache, seen = Cache(), []
    what = scene([model_sphere(n=12)], [place(0)], resolution=40)
    for changes in ({}, {"filter": "box"}, {"half_width": 1.0}, {}):
        made = plan.make(replace(what, **changes), cache, leapray.Watch(), 1)
        seen.append(made.instances[0].structure.volume)
    assert seen[0] is seen[3] and len({id(v) for v in seen}) == 3


def test_sheets_take_the_ramp_where_a_filter_needs_an_inside():
    meshes = [model_plane(), model_sphere(n=12)]
    what = scene(meshes, [place(0), place(1, at=(4, 0, 0))], filter="box", resolution=40)
    made = plan.make(what, Cache(), leapray.Watch(), 1)
    assert [row["kind"] for row in made.volumes] == ["sheet", "solid"]
    (warning,) = [w for w in made.warnings if "filter" in w]
    assert warning == "'Object 0' has no inside for the filter box: ramp instead."


@pytest.mark.parametrize("bad", [{"filter": "hat"}, {"half_width": -1.0}, {"half_width": 99.0}])
def test_settings_that_no_volume_can_have_stop_the_render(bad):
    (name,) = bad
    with pytest.raises(leapray.LeapRayError, match=name):
        pipeline.render(scene([model_sphere(n=4)], [place(0)], **bad))
