# SPDX-License-Identifier: GPL-3.0-or-later
"""Cubic volumes: the exact surface of the tricubic B-spline of the samples."""

from __future__ import annotations

import bspline
import numpy as np
import pytest
from leaf_arrays import dense
from numpy.testing import assert_allclose, assert_array_equal

import leapray
from leapray import Isosurfaces, LeapRayError, Leaves, ScalarGrid, Volume, isosurface

EXACT = [t for t in leapray.traversers() if t.exact]
DTYPES = {"u8": np.uint8, "u16": np.uint16, "f32": np.float32}


def beyond(samples) -> float:
    """What lies around a capped lattice: of whole numbers, which are stored as they are, 0."""
    return float(samples.min()) if samples.dtype.kind == "f" else 0.0


def grid_of(samples, place=None, **more) -> ScalarGrid:
    return ScalarGrid("test", np.asarray(samples), np.eye(4) if place is None else place, **more)


def noise(shape=(11, 12, 13), dtype="u8", seed=0):
    rng = np.random.default_rng(seed)
    most = 1000.0 if dtype == "f32" else np.iinfo(DTYPES[dtype]).max
    return (rng.random(shape) * most).astype(DTYPES[dtype])


def aimed(size, n, seed=1):
    """Rays from around a lattice through points in it, some along axes, some grazing its faces."""
    rng = np.random.default_rng(seed)
    size = np.asarray(size, float)
    target = rng.uniform(-1.5, size + 0.5, (n, 3))
    target[::5] = np.round(target[::5])
    way = rng.normal(size=(n, 3))
    way[::7, rng.integers(3)] = 0
    way[::11] = np.eye(3)[rng.integers(3, size=len(way[::11]))]
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    return target - 1.5 * size.max() * way, way


# ---- where the surface is ----------------------------------------------------------------------


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("capped", [True, False])
def test_hits_are_the_first_roots_of_the_spline_in_noise(dtype, capped):
    samples = noise(dtype=dtype)
    level = float(np.quantile(samples, 0.55)) - 0.25
    volume = isosurface(grid_of(samples), level, capped=capped, interpolation="cubic")
    spline = bspline.Spline(samples, beyond(samples) if capped else None)
    o, d = aimed(volume.info.size, 200)
    want = spline.first_roots(level, o, d, 40.0)
    if not capped:  # the field ends with the lattice
        want, o, d = first_inside(spline, level, o, d, volume.info.size)
    hits = leapray.trace(leapray.build(volume, "aw"), o, d)
    both = np.isfinite(want) & np.isfinite(hits.t)
    assert both.mean() > 0.3
    near = np.abs(hits.t - np.where(both, want, np.nan)) < 1e-8
    rest = np.flatnonzero(~near & ~(np.isinf(want) & np.isinf(hits.t)))
    assert len(rest) < 0.02 * len(o)
    for i in rest:  # steps went over two roots at once: those must be there
        assert hits.t[i] < want[i]
        before, behind = (hits.t[i] + s for s in (-1e-7, 1e-7))
        ends = spline.value(np.stack([o[i] + before * d[i], o[i] + behind * d[i]]))
        assert (ends[0] >= level) != (ends[1] >= level)
    scale = np.ptp(samples.astype(float))
    points = (o + np.where(both, hits.t, 0)[:, None] * d)[both]
    assert_allclose(spline.value(points), level, rtol=0, atol=1e-11 * scale)


def first_inside(spline, level, o, d, size):
    """Rays that start on the lattice's faces, and their first roots before they leave it."""
    high = np.asarray(size, float) - 1
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.stack([(0 - o) / d, (high - o) / d])
    t_in = np.nanmax(np.minimum(*ends), axis=1)
    t_out = np.nanmin(np.maximum(*ends), axis=1)
    across = (t_out - t_in > 1e-3) & np.all((d != 0) | ((o > 0) & (o < high)), axis=1)
    o, d, t_in, t_out = o[across], d[across], t_in[across], t_out[across]
    o = o + (t_in + 1e-9)[:, None] * d
    want = spline.first_roots(level, o, d, 40.0)
    return np.where(want < t_out - t_in - 1e-6, want, np.inf), o, d


@pytest.mark.parametrize("radius", [5.0, 9.0])
def test_a_sphere_is_as_much_smaller_as_the_spline_smooths(radius):
    centre = np.array([16.2, 15.7, 16.4])
    k, j, i = np.indices((33, 33, 33))
    distance = np.sqrt((i - centre[0]) ** 2 + (j - centre[1]) ** 2 + (k - centre[2]) ** 2)
    grid = grid_of((radius - distance).astype(np.float32))
    structure = leapray.build(isosurface(grid, 0.0, interpolation="cubic"))
    rng = np.random.default_rng(1)
    way = rng.normal(size=(3000, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    o = centre + 14 * way
    d = centre + 0.8 * radius * way[::-1] - o
    hits = leapray.trace(structure, o, d)
    point = o + hits.t[:, None] * d - centre
    # A sixth of the second derivative along each axis, whose sum is -2/r; fourth derivatives give
    # less than 1/r^3.
    off = np.linalg.norm(point, axis=1) - (radius - 1 / (3 * radius))
    assert np.abs(off).max() < 1.5 / radius**3
    outward = point / np.linalg.norm(point, axis=1, keepdims=True)
    turned = np.degrees(np.arccos(np.clip((hits.normal * outward).sum(1), -1, 1)))
    assert turned.max() < 12 / radius**2
    linear = leapray.trace(leapray.build(isosurface(grid, 0.0)), o, d, normal="analytic")
    facets = o + linear.t[:, None] * d - centre
    facets /= np.linalg.norm(facets, axis=1, keepdims=True)
    turned_by_facets = np.degrees(np.arccos(np.clip((linear.normal * facets).sum(1), -1, 1)))
    assert turned.max() < 0.2 * turned_by_facets.max()


def test_a_torus_is_hit_where_the_spline_is_and_faces_out():
    k, j, i = np.indices((20, 41, 41)) - np.array([9.5, 20, 20])[:, None, None, None]
    field = (5 - np.hypot(np.hypot(i, j) - 13, k)).astype(np.float32)
    volume = isosurface(grid_of(field), 0.0, interpolation="cubic")
    spline = bspline.Spline(field, float(field.min()))
    o, d = aimed(volume.info.size, 4000)
    hits = leapray.trace(leapray.build(volume), o, d)
    hit = np.isfinite(hits.t)
    points = (o + np.where(hit, hits.t, 0)[:, None] * d)[hit]
    assert hit.mean() > 0.3
    assert_allclose(spline.value(points), 0.0, rtol=0, atol=1e-10)
    outward = -spline.gradient(points)
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    for normal in ("central", "analytic", "smooth"):
        same = leapray.trace(leapray.build(volume), o, d, normal=normal)
        assert_allclose(same.normal[hit], outward, rtol=0, atol=1e-9)
        assert_allclose(same.field_normal[hit], outward, rtol=0, atol=1e-9)
        assert_allclose(volume.normals(points, normal=normal), outward, rtol=0, atol=1e-6)
    for normal in ("sobel", "zucker_hummel"):
        other = leapray.trace(leapray.build(volume), o, d, normal=normal)
        assert (other.normal[hit] * outward).sum(1).min() > 0.95


def test_grazing_rays_hit_what_they_touch_and_nothing_else():
    k, j, i = np.indices((24, 24, 24)) - 11.3
    field = (40 - i**2 - j**2 - k**2).astype(np.float32)
    volume = isosurface(grid_of(field), 0.0, interpolation="cubic")
    # Second differences of squares are 2 along each axis: the spline is 40 - 1 - r^2.
    radius = np.sqrt(39.0)
    rng = np.random.default_rng(4)
    n = rng.normal(size=(4000, 3))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    d = np.cross(n, rng.normal(size=(4000, 3)))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    depth = np.sign(rng.normal(size=4000)) * 10.0 ** rng.uniform(-11, -1, 4000)
    o = 11.3 + (radius - depth)[:, None] * n - 30 * d
    hits = leapray.trace(leapray.build(volume), o, d)
    f32 = 1e-5  # what samples of some hundred are rounded by
    assert np.isfinite(hits.t[depth > f32]).all()
    assert np.isinf(hits.t[depth < -f32]).all()
    whole = (40 * 4096 - np.rint(64 * i) ** 2 - np.rint(64 * j) ** 2 - np.rint(64 * k) ** 2) / 4096
    middle = 11.3 - (np.rint(64 * i) / 64 - i)[0, 0, 0]
    assert_array_equal(whole.astype(np.float32), whole)
    volume = isosurface(grid_of(whole.astype(np.float32)), 0.0, interpolation="cubic")
    o = o - 11.3 + middle
    hits = leapray.trace(leapray.build(volume), o, d)
    assert np.isfinite(hits.t[depth > 1e-11]).all()  # 40 voxels: rounded by some 1e-14
    assert np.isinf(hits.t[depth < -1e-11]).all()
    half = np.sqrt(np.maximum(radius**2 - (radius - depth) ** 2, 0))
    deep = depth > 1e-6
    assert_allclose(hits.t[deep], (30 - half)[deep], rtol=0, atol=1e-9)


@pytest.mark.parametrize("spec", EXACT, ids=lambda t: t.name)
@pytest.mark.parametrize("capped", [True, False])
def test_exact_traversers_agree(spec, capped):
    for dtype in DTYPES:
        samples = noise((21, 26, 17), dtype, seed=3)
        level = float(np.quantile(samples, 0.6))
        volume = isosurface(grid_of(samples), level, capped=capped, interpolation="cubic")
        o, d = aimed(volume.info.size, 2000)
        want = leapray.trace(leapray.build(volume, "aw"), o, d)
        got = leapray.trace(leapray.build(volume, spec), o, d)
        assert np.isfinite(want.t).mean() > 0.3
        ties = (o == np.round(o)).any(1) & (d == 0).any(1)  # along faces of cells
        assert_array_equal(got.t[~ties], want.t[~ties])
        assert_allclose(got.normal[~ties], want.normal[~ties], rtol=0, atol=1e-12)
        if capped:
            assert_allclose(got.t, want.t, rtol=0, atol=1e-9)


def test_inexact_traversers_hit_no_other_surface():
    samples = noise((21, 26, 17), seed=3)
    volume = isosurface(grid_of(samples), 150.0, interpolation="cubic")
    spline = bspline.Spline(samples)
    o, d = aimed(volume.info.size, 2000)
    best = leapray.trace(leapray.build(volume), o, d).t
    for spec in leapray.traversers():
        if spec.exact or spec.name == "lines":
            continue
        hits = leapray.trace(leapray.build(volume, spec), o, d)
        hit = np.isfinite(hits.t)
        assert hit.any() and (hits.t >= best - 1e-9).all()
        points = (o + np.where(hit, hits.t, 0)[:, None] * d)[hit]
        assert_allclose(spline.value(points), 150.0, rtol=0, atol=1e-8)


@pytest.mark.parametrize("root", ["newton", "bisect", "linear"])
@pytest.mark.parametrize("hit_test", ["extrema", "faces"])
def test_hit_tests_and_roots_find_the_same_surface(root, hit_test):
    samples = noise((15, 16, 17), "u16")
    structure = leapray.build(isosurface(grid_of(samples), 33000.0, interpolation="cubic"))
    rays = aimed((17, 16, 15), 3000)
    want = leapray.trace(structure, *rays)
    got = leapray.trace(structure, *rays, root=root, hit_test=hit_test)
    near = np.isclose(got.t, want.t, rtol=0, atol=1e-9 if root != "linear" else np.sqrt(3))
    near |= np.isinf(got.t) & np.isinf(want.t)
    assert near.mean() > 0.9
    assert hit_test == "faces" or near.all()


# ---- which cells -------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", DTYPES)
def test_surface_cells_are_those_whose_samples_lie_on_both_sides(dtype):
    rng = np.random.default_rng(5)
    for _ in range(12):
        shape = rng.choice([1, 2, 5, 6, 7, 13, 20], 3)
        samples = noise(shape, dtype, seed=rng.integers(99))
        samples[rng.random(shape) < 0.6] = samples.min()
        samples.flat[0] = samples.min() + 1
        level = float(rng.choice(samples[samples > samples.min()]))
        volume = isosurface(grid_of(samples), level, interpolation="cubic")
        want = bspline.mixed_cells(samples, level, beyond(samples))
        assert_array_equal(volume.read_surface((-2, -2, -2), want.shape[::-1]), want)
        assert volume.info.n_surface_cells == want.sum()
        if dtype == "f32":
            continue
        one = np.iinfo(DTYPES[dtype]).max
        same = Volume(samples, max(level, 1) / one, interpolation="cubic")
        want = bspline.mixed_cells(samples, max(level, 1))
        assert_array_equal(same.read_surface((-2, -2, -2), want.shape[::-1]), want)


def test_an_open_surface_ends_with_the_lattice():
    samples = noise((9, 10, 11))
    volume = isosurface(grid_of(samples), 150.0, capped=False, interpolation="cubic")
    cells = volume.read_surface((-3, -3, -3), (18, 17, 16))
    inner = np.zeros_like(cells)
    inner[3:11, 3:12, 3:13] = True
    assert cells.any() and not (cells & ~inner).any()
    assert volume.info.kind == "sheet" and volume.info.interpolation == "cubic"


def leaves(seed=2, background=0.0):
    """Far apart and side by side, with a tile inside."""
    rng = np.random.default_rng(seed)
    at = np.stack(np.meshgrid(*[np.arange(-3, 3)] * 3, indexing="ij"), -1).reshape(-1, 3)
    at = at[rng.random(len(at)) < 0.25]
    apart = ~((at >= -1) & (at < 1)).all(1)
    origins = 8 * at[apart]
    samples = rng.random((len(origins), 8, 8, 8)).astype(np.float32)
    tile = np.array([[-8, -8, -8]], np.int32), np.array([16], np.int32), np.array([0.75])
    return Leaves(origins.astype(np.int32), samples, background, *tile)


@pytest.mark.parametrize("level", [0.02, 0.3, 0.6, 0.74])
def test_leaves_are_hit_as_the_same_samples_in_an_array(level):
    held = leaves()
    array, first = dense(held)
    shift = np.eye(4)
    shift[:3, 3] = first
    grid = ScalarGrid("fog", held, np.eye(4), kind="fog")
    volume = isosurface(grid, level, interpolation="cubic")
    same = isosurface(grid_of(array, shift), level, interpolation="cubic")
    want = bspline.mixed_cells(array, np.float32(level))
    assert same.info.n_surface_cells == want.sum() == volume.info.n_surface_cells
    o, d = aimed(same.info.size, 3000)
    for name in ("aw", "cd", "kdtree"):
        hits, other = (leapray.trace(leapray.build(v, name), o + first, d) for v in (volume, same))
        assert np.isfinite(other.t).mean() > 0.1
        assert_allclose(hits.t, other.t, rtol=0, atol=1e-9)


def test_the_samples_of_level_sets_inside_take_no_memory():
    k, j, i = np.indices((96, 96, 96)) - 47.5
    inside = np.clip(36 - np.sqrt(i**2 + j**2 + k**2), -3, 3).astype(np.float32)
    volume = isosurface(grid_of(inside), 0.0, interpolation="cubic")
    assert volume.info.n_full > 0
    assert volume.info.n_bricks + volume.info.n_full < 13**3
    hits = leapray.trace(leapray.build(volume), [[47.5, 47.5, -9]], [[0, 0, 1.0]])
    assert_allclose(hits.t, 9 + 47.5 - (36 - 1 / 108), atol=1e-4)


def test_what_is_inside_throughout_ends_at_its_cap():
    full = np.full((5, 6, 7), 9, np.uint8)
    volume = isosurface(grid_of(full), 5.0, interpolation="cubic")
    assert volume.info.interpolation == "cubic"
    hits = leapray.trace(leapray.build(volume), [[3, 2.5, -9]], [[0, 0, 1.0]])
    assert_allclose(hits.t, 8.5, atol=1e-3)  # 1/6, 5/6 at -1 and 0
    opened = isosurface(grid_of(full), 5.0, capped=False, interpolation="cubic")
    assert opened.info.n_surface_cells == 0
    nothing = isosurface(grid_of(full), 50.0, interpolation="cubic")
    assert nothing.info.n_surface_cells == 0


def test_thresholds_share_samples_and_threads_change_no_bit():
    samples = np.random.default_rng(0).normal(0, 1, (30, 40, 50)).astype(np.float32)
    made = Isosurfaces(grid_of(samples), interpolation="cubic")
    for level in (-0.5, 0.1, 0.9):
        one = isosurface(grid_of(samples), level, interpolation="cubic", threads=1)
        assert_array_equal(made.at(level, threads=3).pack(), one.pack())


# ---- normals -----------------------------------------------------------------------------------


def test_normals_do_not_jump_at_the_faces_of_cells():
    rng = np.random.default_rng(6)
    samples = rng.random((16, 16, 16)).astype(np.float32)
    structure = leapray.build(isosurface(grid_of(samples), 0.55, interpolation="cubic"))
    linear = leapray.build(isosurface(grid_of(samples), 0.55))
    beside = 1e-7
    at = np.column_stack([rng.integers(2, 13, 4000) - beside, rng.uniform(2, 13, (4000, 2))])
    o, d = np.array(at), np.broadcast_to([0.0, 0, 1], at.shape)
    over = o + np.array([2 * beside, 0, 0])
    turned = {}
    for name, each, normal in (("cubic", structure, "central"), ("linear", linear, "analytic")):
        a, b = (leapray.trace(each, start, d, normal=normal) for start in (o, over))
        both = np.isfinite(a.t) & np.isfinite(b.t)
        same = both & (np.abs(np.where(both, a.t, 0) - np.where(both, b.t, 0)) < 1e-3)
        assert same.mean() > 0.4
        turned[name] = np.linalg.norm(a.normal - b.normal, axis=1)[same]
    assert np.quantile(turned["cubic"], 0.99) < 1e-4
    assert np.median(turned["linear"]) > 0.01


def test_samples_of_the_field_are_those_of_the_spline():
    samples = noise((7, 8, 9), "f32")
    place = np.array([[0.5, 0.1, 0, 3], [0, 0.7, 0.2, -1], [0, 0, 1.5, 2], [0, 0, 0, 1.0]])
    volume = isosurface(grid_of(samples, place), 500.0, interpolation="cubic")
    spline = bspline.Spline(samples, float(samples.min()))
    index = np.random.default_rng(1).uniform(-2, [10, 9, 8], (2000, 3))
    points = index @ place[:3, :3].T + place[:3, 3]
    value, gradient = volume.sample(points)
    assert_allclose(value, spline.value(index), rtol=0, atol=1e-9)
    want = spline.gradient(index) @ np.linalg.inv(place[:3, :3])
    assert_allclose(gradient, want, rtol=0, atol=1e-8)
    beyond, none = volume.sample(place[:3, :3] @ [20.0, 0, 0] + place[:3, 3][None])
    assert (beyond == 0).all() and (none == 0).all()


# ---- rays that leave the surface ---------------------------------------------------------------

PLACES = {  # scale, and how far off the origin, in voxels
    "as it is": (1.0, 0.0),
    "small": (1e-4, 3.0),
    "far": (1.0, 1e5),
    "large and far": (1e3, 1e7),
}


def walk(samples, level, place, seed, bounces=8, n=4000):
    """Rays from wall to wall of a capped solid, a third of them grazing what they leave; how many
    got out, and how many hit what they left though they lead away from it."""
    scale, away = PLACES[place]
    rng = np.random.default_rng(seed)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    if seed % 2 == 0:
        turn = np.eye(3)
    matrix = np.eye(4)
    matrix[:3, :3] = scale * turn
    matrix[:3, 3] = scale * away * rng.normal(size=3)
    volume = isosurface(grid_of(samples, matrix), level, interpolation="cubic")
    structure = leapray.build(volume, ("cd", "aw", "kdtree", "hdda")[seed % 4])
    index, way = aimed(volume.info.size, n, seed)
    o, d = index @ matrix[:3, :3].T + matrix[:3, 3], way @ turn.T
    hits = leapray.trace(structure, o, d)
    done = out = stuck = 0
    for _ in range(bounces):
        hit = np.isfinite(hits.t)
        points, outward = (o + np.where(hit, hits.t, 0)[:, None] * d)[hit], hits.field_normal[hit]
        cell = hits.cell[hit]
        for side in (-1, 1):
            d = rng.normal(size=outward.shape)
            d -= (d * outward).sum(1)[:, None] * outward
            d /= np.linalg.norm(d, axis=1, keepdims=True)
            lean = np.where(rng.random(len(d)) < 0.35, 10.0 ** rng.uniform(-9, -1, len(d)), 1.0)
            lean *= rng.random(len(d)) + 1e-3
            d = d - side * lean[:, None] * outward
            hits = leapray.trace(structure, points, d, start=(cell, np.full(len(d), side)))
            done += len(d)
            # What is nearer to a start than 1e-6 is never met; behind, the field has risen by lean.
            stuck += int(((hits.t < 1e-5 * scale) & (lean > 1e-3)).sum())
        out += int(np.isinf(hits.t).sum())  # of those inside
        o = points
    return done, out, stuck, volume


def smooth_field(seed):
    rng = np.random.default_rng(seed)
    k, j, i = np.indices((18, 18, 18)) - 8.5
    waves = rng.normal(size=(4, 3)) * 0.4
    bumps = sum(np.sin(a * i + b * j + c * k + rng.uniform(0, 6)) for a, b, c in waves)
    return (6 - np.sqrt(i**2 + j**2 + k**2) + 0.4 * bumps).astype(np.float32)


@pytest.mark.parametrize("place", PLACES)
def test_no_ray_gets_out_of_a_solid_or_hits_where_it_is(place):
    total = 0
    for seed in range(6):
        done, out, stuck, _ = walk(smooth_field(seed), 0.0, place, seed)
        assert (out, stuck) == (0, 0)
        total += done
    for seed in range(4):
        samples = noise((12, 12, 12), ("u8", "u16", "f32", "u8")[seed], seed)
        level = float(np.quantile(samples, 0.4))
        done, out, stuck, _ = walk(samples, level, place, seed)
        assert out == 0
        assert stuck <= 1e-4 * done  # necks of noise are thinner than any bound
        total += done
    assert total > 200_000


def test_rays_leave_surfaces_that_lie_on_faces_of_cells():
    k = np.indices((12, 12, 12))[0]
    grid = grid_of((k - 5).astype(np.float32))  # linear: the spline is the same
    structure = leapray.build(isosurface(grid, 0.0, interpolation="cubic"))
    rng = np.random.default_rng(3)
    o = np.column_stack([rng.integers(2, 9, (500, 2)), np.full(500, 5)]).astype(float)
    o[::2, :2] += rng.random((250, 2))
    for cell_z in (4, 5):
        cell = np.column_stack([np.floor(o[:, :2]), np.full(500, cell_z)]).astype(int)
        for side in (-1, 1):
            d = rng.normal(size=(500, 3)) * 0.1
            d[:, 2] = side * 10.0 ** rng.uniform(-6, 0, 500)
            hits = leapray.trace(structure, o, d, start=(cell, np.full(500, side)))
            assert (hits.t > 0.5).all()
            assert side > 0 or np.isinf(hits.t).all()


def test_a_ray_that_leads_through_the_surface_that_it_leaves_hits_it():
    structure = leapray.build(isosurface(grid_of(smooth_field(1)), 0.0, interpolation="cubic"))
    o, d = aimed((18, 18, 18), 1000)
    first = leapray.trace(structure, o, d)
    hit = np.isfinite(first.t)
    points, normal = (o + np.where(hit, first.t, 0)[:, None] * d)[hit], first.field_normal[hit]
    for side in (-1, 1):
        start = first.cell[hit], np.full(hit.sum(), side)
        hits = leapray.trace(structure, points, side * normal, start=start)
        assert hits.t.max() < 1e-5


def test_any_start_gives_an_answer():
    """Cells and sides that no hit has: an answer, the same by every exact traverser."""
    rng = np.random.default_rng(8)
    volume = isosurface(grid_of(noise()), 130.0, interpolation="cubic")
    o, d = aimed(volume.info.size, 3000)
    o = o + rng.uniform(0, 25, (3000, 1)) * d
    cell = rng.integers(-3, 16, (3000, 3))
    cell[::9] = rng.choice([-(2**31), 2**31 - 1, 0, 5], (len(cell[::9]), 3))
    cell[1::2] = np.floor(o[1::2])
    side = rng.integers(-1, 2, 3000)
    want = leapray.trace(leapray.build(volume, "aw"), o, d, start=(cell, side))
    hit = np.isfinite(want.t)
    assert hit.any() and not np.isnan(want.t).any() and (want.t >= 0).all()
    assert_allclose(np.linalg.norm(want.normal[hit], axis=1), 1, atol=1e-12)
    for name in ("cd", "kdtree", "pyramid"):
        got = leapray.trace(leapray.build(volume, name), o, d, start=(cell, side))
        assert_allclose(got.t, want.t, rtol=0, atol=1e-9)


# ---- what cubic volumes do not take ------------------------------------------------------------


def test_what_does_not_go_together_is_told_in_a_sentence():
    samples = noise((5, 6, 7))
    volume = Volume(samples, interpolation="cubic")
    structure = leapray.build(volume)
    ray = [[0.0, 0, -9]], [[0.0, 0, 1]]
    with pytest.raises(LeapRayError, match="no object cells"):
        leapray.trace(structure, *ray, mode="binary")
    with pytest.raises(LeapRayError, match="this volume is cubic"):
        leapray.trace(structure, *ray, hit_test="uniform", root="bisect")
    with pytest.raises(LeapRayError, match="degree 9"):
        leapray.trace(structure, *ray, root="cubic")
    with pytest.raises(LeapRayError, match="carries no ids"):
        Volume(samples, ids=samples.astype(np.uint16), interpolation="cubic")
    with pytest.raises(LeapRayError, match="takes no planes"):
        Volume(samples, planes=[np.arange(n) for n in (7, 6, 5)], interpolation="cubic")
    wide = Volume(samples.astype(np.uint16), interpolation="cubic")
    with pytest.raises(LeapRayError, match="keeps its samples"):
        wide.narrow()
    with pytest.raises(LeapRayError, match="keeps its samples"):
        volume.sample([[1.0, 1, 1]], gain=2.0)
    with pytest.raises(LeapRayError, match="ids"):
        leapray.merge([volume, volume])
    with pytest.raises(LeapRayError, match="trilinear"):
        leapray.prepare(volume, leapray.image_methods()[0])
    for make in (
        lambda: Volume(samples, interpolation="quintic"),
        lambda: Isosurfaces(grid_of(samples), interpolation=""),
        lambda: isosurface(grid_of(samples), 1.0, interpolation="closest"),
    ):
        with pytest.raises(LeapRayError, match=r"unknown interpolation .* linear, cubic"):
            make()


def test_a_cubic_volume_comes_back_from_bytes():
    for volume in (
        Volume(noise((5, 6, 7)), interpolation="cubic"),
        isosurface(grid_of(noise((14, 9, 7), "f32")), 500.0, interpolation="cubic"),
        isosurface(grid_of(noise((9, 9, 7))), 127.0, capped=False, interpolation="cubic"),
    ):
        again = Volume.unpack(volume.pack())
        assert again.info.interpolation == "cubic"
        rays = aimed(volume.info.size, 500)
        hits, same = (leapray.trace(leapray.build(v), *rays) for v in (volume, again))
        assert np.isfinite(hits.t).any()
        assert_array_equal(same.t, hits.t)
        assert_array_equal(same.normal, hits.normal)
