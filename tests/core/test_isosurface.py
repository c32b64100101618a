# SPDX-License-Identifier: GPL-3.0-or-later
"""Isosurfaces of scalar grids: which samples lie inside, where the surface is, what is shared."""

from __future__ import annotations

import numpy as np
import pytest
from leaf_arrays import dense
from numpy.testing import assert_allclose, assert_array_equal

import leapray
from leapray import Isosurfaces, Leaves, ScalarGrid, isosurface
from leapray.arrays import ONES

EXACT = [t for t in leapray.traversers() if t.exact]
DTYPES = ["u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f2", "f4", "f8", ">i2", ">f4", "?"]


def grid_of(samples, **more) -> ScalarGrid:
    return ScalarGrid("test", np.asarray(samples), np.eye(4), **more)


def inside(volume: leapray.Volume) -> np.ndarray:
    """Which samples the volume holds inside."""
    return volume.read().astype(np.float64) >= volume.info.threshold * ONES[volume.info.dtype]


def surface_cells(solid: np.ndarray) -> np.ndarray:
    """Of a capped solid: cells -1..n-1 with corners on both sides."""
    padded = np.pad(solid, 1)
    nz, ny, nx = (n + 1 for n in solid.shape)
    corners = [
        padded[k : k + nz, j : j + ny, i : i + nx] for k in (0, 1) for j in (0, 1) for i in (0, 1)
    ]
    return np.any(corners, 0) & ~np.all(corners, 0)


def check_sides(grid: ScalarGrid, threshold: float, above: bool) -> leapray.Volume:
    """The volume, whose every sample and cell lies where numpy says."""
    volume = isosurface(grid, threshold, above=above)
    with np.errstate(all="ignore"):
        value = grid.offset + grid.scale * grid.samples.astype(np.float64)
    solid = value >= threshold if above else value <= threshold
    if grid.no_data is not None:
        solid &= grid.samples.astype(np.float64) != grid.no_data
    assert_array_equal(inside(volume), solid)
    n = np.array(solid.shape[::-1]) + 1
    assert_array_equal(volume.read_surface((-1, -1, -1), n), surface_cells(solid))
    assert volume.info.n_surface_cells == surface_cells(solid).sum()
    return volume


def hostile(rng, dtype: np.dtype, shape) -> np.ndarray:
    """Numbers of which many are equal, next to each other, or at the ends of their type."""
    if dtype.kind == "b":
        return rng.random(shape) < 0.5
    if dtype.kind in "iu":
        info = np.iinfo(dtype)
        centre = int(rng.choice([0, 5, info.max - 4, max(info.min, -3)]))
        spread = int(rng.choice([3, 100, 70000]))
        low, high = max(info.min, centre - spread), min(info.max, centre + spread)
        return rng.integers(low, high, shape, dtype.newbyteorder("="), endpoint=True).astype(dtype)
    centre = dtype.type(rng.choice([0.0, 1.0, -1000.3, 3e4]))
    steps = rng.integers(-3, 4, shape)
    near = centre + steps * np.spacing(np.abs(centre) + dtype.type(1e-3))
    wide = rng.normal(0, 100, shape)
    out = np.where(rng.random(shape) < 0.5, near, wide).astype(dtype)
    odd = rng.random(shape)
    out[odd < 0.03], out[odd > 0.97] = np.nan, rng.choice([np.inf, -np.inf])
    return out


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("above", [True, False])
def test_every_sample_lies_on_the_side_of_its_value(dtype, above):
    rng = np.random.default_rng(7)
    dtype = np.dtype(dtype)
    for _ in range(12):
        shape = rng.choice([1, 2, 5, 6, 7, 13, 20], 3)
        samples = hostile(rng, dtype, shape)
        scale, offset = rng.choice([1.0, 0.1, -2.0, 1e-7]), rng.choice([0.0, -1024.0, 0.3])
        no_data = float(samples.flat[0]) if rng.random() < 0.3 else None
        grid = grid_of(samples, scale=scale, offset=offset, no_data=no_data)
        picked = offset + scale * rng.choice(samples.ravel(), 3).astype(np.float64)
        for value in picked[np.isfinite(picked)]:  # thresholds that samples equal, and beside
            check_sides(grid, value, above)
            check_sides(grid, np.nextafter(value, -np.inf), above)
            check_sides(grid, value + 0.5 * abs(scale), above)


@pytest.mark.parametrize("dtype", ["u1", "i2", "u2", "f4", "f8", "i4"])
def test_a_threshold_moved_is_one_built_anew(dtype):
    rng = np.random.default_rng(3)
    samples = rng.normal(0, 50, (19, 30, 41)) + (200 if dtype[0] == "u" else 0)
    samples = np.clip(samples, *((0, 250) if dtype == "u1" else (-1e4, 1e4))).astype(dtype)
    made = Isosurfaces(grid_of(samples, offset=-10.0))
    values = -10.0 + np.quantile(samples, [0.1, 0.5, 0.9])
    for value in [*values, values[0], -1e9, 1e9]:
        moved, anew = made.at(value), isosurface(grid_of(samples, offset=-10.0), value)
        assert_array_equal(moved.pack(), anew.pack())
        assert moved.info.n_surface_cells == anew.info.n_surface_cells
        assert_array_equal(leapray.Volume.unpack(moved.pack()).read(), moved.read())


@pytest.mark.parametrize("dtype", DTYPES[:-1])
@pytest.mark.parametrize("above", [True, False])
@pytest.mark.parametrize("scale", [0.5, -3.0])
def test_values_follow_from_occupancies(dtype, above, scale):
    rng = np.random.default_rng(5)
    least = 20 if "u" in dtype else -20
    samples = rng.integers(least, 100, (7, 9, 11)).astype(dtype)
    made = Isosurfaces(grid_of(samples, scale=scale, offset=-7.0), above=above)
    values = -7.0 + scale * samples.astype(np.float64)
    volume = made.at(float(np.median(values)))
    occupancy = volume.read().astype(np.float64) / ONES[volume.info.dtype]
    assert_allclose(made.offset + made.scale * occupancy, values, rtol=1e-12, atol=1e-9)


def test_values_that_floats_round_follow_from_occupancies():
    values = np.random.default_rng(5).normal(0, 1e-30, (5, 6, 7)) * np.float64(1e-20)
    made = Isosurfaces(grid_of(values))
    found = made.offset + made.scale * made.at(0.0).read().astype(np.float64)
    assert_allclose(found, values, rtol=1e-6)


def test_volumes_outlive_their_maker_and_each_other():
    samples = np.random.default_rng(0).integers(0, 1000, (20, 20, 20)).astype(np.uint16)
    made = Isosurfaces(grid_of(samples))
    first, second = made.at(100), made.at(900)
    del made, first
    assert_array_equal(second.read(), samples)
    again = isosurface(grid_of(samples), 900)
    assert_array_equal(second.pack(), again.pack())


def test_threads_change_no_bit():
    samples = np.random.default_rng(0).normal(0, 1, (50, 40, 30)).astype(np.float32)
    one = isosurface(grid_of(samples), 0.1, threads=1)
    assert_array_equal(one.pack(), isosurface(grid_of(samples), 0.1, threads=3).pack())


# ---- where the surface is ----------------------------------------------------------------------


def ball(n: int, radius: float, centre, dtype=np.float32) -> np.ndarray:
    """Distance inside a ball, positive inside, in voxels."""
    k, j, i = np.indices((n, n, n))
    return (
        radius - np.sqrt(sum((a - c) ** 2 for a, c in zip((i, j, k), centre, strict=True)))
    ).astype(dtype)


def rays_at(centre, radius: float, n: int, rng):
    """Rays from outside a ball towards points in it."""
    way = rng.normal(size=(n, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    aim = centre + 0.9 * radius * way[::-1] * rng.random((n, 1))
    origin = np.asarray(centre) + 3 * radius * way
    ahead = aim - origin
    return origin, ahead / np.linalg.norm(ahead, axis=1, keepdims=True)


@pytest.mark.parametrize("radius", [6.0, 12.0])
def test_a_sphere_is_hit_within_what_interpolation_may_be_off(radius):
    centre = np.array([16.2, 15.7, 16.4])
    volume = isosurface(grid_of(ball(33, radius, centre)), 0.0)
    origin, ahead = rays_at(centre, radius, 2000, np.random.default_rng(1))
    hits = leapray.trace(leapray.build(volume), origin, ahead)
    point = origin + hits.t[:, None] * ahead
    off = np.linalg.norm(point - centre, axis=1) - radius
    # Second differences along each axis, of which two are 1/r: at most h^2/8 each; the surface
    # lies where the field does, whose slope is 1.
    assert np.abs(off).max() <= 1.0 / (4.0 * radius) * 1.05  # r is less by what is bounded
    outward = (point - centre) / np.linalg.norm(point - centre, axis=1, keepdims=True)
    assert (hits.normal * outward).sum(1).min() > 0.99


@pytest.mark.parametrize("dtype", ["i2", "f4", "f8"])
def test_planes_of_a_linear_field_are_exact(dtype):
    k, j, i = np.indices((20, 21, 22))
    field = (100 * i + 37 * j - 11 * k).astype(dtype)
    place = np.array([[0.5, 0.1, 0, 3], [0, 0.7, 0.2, -1], [0, 0, 1.5, 2], [0, 0, 0, 1.0]])
    grid = ScalarGrid("plane", field, place, scale=2.0, offset=-300.0)
    volume = isosurface(grid, 1777.25)
    rng = np.random.default_rng(5)
    target = np.column_stack([rng.uniform(2, 18, (500, 3)), np.ones(500)]) @ place.T
    ahead = rng.normal(size=(500, 3))
    origin = target[:, :3] - 40 * ahead
    hits = leapray.trace(leapray.build(volume), origin, ahead)
    back = np.linalg.inv(place)
    hit = np.isfinite(hits.t)
    point = origin + np.where(hit, hits.t, 0)[:, None] * ahead
    index = (np.column_stack([point, np.ones(500)]) @ back.T)[:, :3]
    inner = ((index > 1) & (index < np.array([20, 19, 18]))).all(1) & hit
    assert inner.sum() > 50
    value = -300.0 + 2.0 * (index @ np.array([100.0, 37.0, -11.0]))
    assert_allclose(value[inner], 1777.25, rtol=0, atol=1e-6)
    gradient = back[:3, :3].T @ np.array([100.0, 37.0, -11.0])
    want = -gradient / np.linalg.norm(gradient)
    for normal in leapray.NORMALS:
        hits = leapray.trace(leapray.build(volume), origin, ahead, normal=normal)
        assert_allclose(hits.normal[inner], np.broadcast_to(want, (inner.sum(), 3)), atol=1e-6)


def fog() -> ScalarGrid:
    """A sparse cloud around the origin, with a tile inside."""
    rng = np.random.default_rng(2)
    at = np.stack(np.meshgrid(*[np.arange(-3, 3)] * 3, indexing="ij"), -1).reshape(-1, 3)
    kept = at[(np.abs(at).max(1) > 1) | (at.min(1) < -1)]
    kept = kept[rng.random(len(kept)) < 0.6]
    tiled = ~((kept >= -1) & (kept < 1)).all(1)
    leaves = 8 * kept[tiled]
    samples = rng.random((len(leaves), 8, 8, 8)).astype(np.float32)
    tile = np.array([[-8, -8, -8]], np.int32), np.array([16], np.int32), np.array([0.75])
    held = Leaves(leaves.astype(np.int32), samples, 0.0, *tile)
    return ScalarGrid("fog", held, np.diag([0.1, 0.1, 0.1, 1.0]), kind="fog")


def whole(grid: ScalarGrid) -> ScalarGrid:
    """The same with the samples of its leaves as an array."""
    out, first = dense(grid.samples)
    shift = np.eye(4)
    shift[:3, 3] = first
    return ScalarGrid("dense", out, grid.world_from_index @ shift, kind=grid.kind)


def noisy() -> ScalarGrid:
    rng = np.random.default_rng(4)
    samples = 40 * ball(40, 14, (19, 20, 21), np.float64) + rng.normal(0, 60, (40, 40, 40))
    return grid_of(samples.astype(np.int16), offset=-1000.0)


def some_rays(volume: leapray.Volume, n: int):
    rng = np.random.default_rng(9)
    place, size = volume.info.object_from_index, np.array(volume.info.size)
    index = rng.uniform(-0.2, 1.2, (2, n, 3)) * size
    points = index @ place[:3, :3].T + place[:3, 3]
    return points[0], points[1] - points[0]


@pytest.mark.parametrize("spec", EXACT, ids=lambda t: t.name)
@pytest.mark.parametrize(("grid", "threshold"), [(noisy, -950.0), (fog, 0.8)])
def test_exact_traversers_agree_on_noise(spec, grid, threshold):
    volume = isosurface(grid(), threshold)
    rays = some_rays(volume, 3000)
    want = leapray.trace(leapray.build(volume), *rays)
    got = leapray.trace(leapray.build(volume, spec), *rays)
    assert np.isfinite(want.t).mean() > 0.3
    assert_array_equal(got.t, want.t)


def test_leaves_are_hit_as_the_same_samples_in_an_array():
    for threshold in (0.3, 0.75, 0.9):
        volume, same = isosurface(fog(), threshold), isosurface(whole(fog()), threshold)
        assert volume.info.n_surface_cells == same.info.n_surface_cells
        rays = some_rays(same, 3000)
        hits, want = (leapray.trace(leapray.build(v), *rays) for v in (volume, same))
        assert np.isfinite(want.t).mean() > 0.1
        assert_allclose(hits.t, want.t, rtol=0, atol=1e-9)


def test_level_sets_are_solid_below_and_keep_no_samples_inside():
    field = -ball(48, 18, (24, 24, 24))
    clipped = np.clip(field, -3, 3).reshape(6, 8, 6, 8, 6, 8).transpose(0, 2, 4, 1, 3, 5)
    clipped = clipped.reshape(-1, 8, 8, 8)
    at = 8 * np.stack(np.unravel_index(np.arange(216), (6, 6, 6)), -1)[:, ::-1]
    flat = clipped.reshape(216, -1)
    band = (flat.min(1) < 3) & (flat.max(1) > -3)
    inner = flat.max(1) == -3
    leaves = Leaves(
        at[band].astype(np.int32),
        clipped[band],
        3.0,
        at[inner].astype(np.int32),
        np.full(inner.sum(), 8, np.int32),
        np.full(inner.sum(), -3.0),
    )
    volume = isosurface(ScalarGrid("level", leaves, np.eye(4), kind="level set"), 0.0)
    assert inner.sum() > 0 and volume.info.n_full > 0
    centre = np.array([24.0, 24, 24])
    origin, ahead = rays_at(centre, 18, 500, np.random.default_rng(1))
    hits = leapray.trace(leapray.build(volume), origin, ahead)
    off = np.linalg.norm(origin + hits.t[:, None] * ahead - centre, axis=1) - 18
    assert np.abs(off).max() < 0.02


def test_averaged_normals_turn_least_by_noise():
    rng = np.random.default_rng(2)
    centre = np.array([24.0, 24, 24])
    field = ball(49, 16, centre) + rng.normal(0, 0.2, (49, 49, 49)).astype(np.float32)
    structure = leapray.build(isosurface(grid_of(field), 0.0))
    origin, ahead = rays_at(centre, 16, 3000, rng)
    turned = {}
    for normal in ("central", "sobel", "zucker_hummel"):
        hits = leapray.trace(structure, origin, ahead, normal=normal)
        outward = (origin + hits.t[:, None] * ahead - centre) / 16
        turned[normal] = np.sqrt(1 - np.clip((hits.normal * outward).sum(1), -1, 1) ** 2).mean()
    # Of the noise of differences 0.375 and 0.339 are left at samples, more between them, whose
    # averages share lines; and the points that are hit lie off by the noise as well.
    assert turned["sobel"] < 0.75 * turned["central"]
    assert turned["zucker_hummel"] < turned["sobel"]


# ---- the data's border -------------------------------------------------------------------------


def test_a_cut_solid_is_capped_or_open():
    k, _, _ = np.indices((12, 12, 12))
    field = (k >= 6).astype(np.float32)  # the upper half, up to the border
    up = np.array([[5.3, 5.2, -3.0]]), np.array([[0, 0, 1.0]])
    down = np.array([[5.3, 5.2, 20.0]]), np.array([[0, 0, -1.0]])
    capped = leapray.build(isosurface(grid_of(field), 0.5))
    opened = leapray.build(isosurface(grid_of(field), 0.5, capped=False))
    assert_allclose(leapray.trace(capped, *up).t, 8.5)
    assert_allclose(leapray.trace(opened, *up).t, 8.5)
    assert_allclose(20 - leapray.trace(capped, *down).t, 11.5)  # halfway to the samples beyond
    assert_allclose(20 - leapray.trace(opened, *down).t, 5.5)  # from inside, through the border
    assert opened.volume.info.kind == "sheet"


@pytest.mark.parametrize("n", [1, 2, 4, 5, 6, 7, 8, 12])
def test_open_surfaces_are_those_of_the_cells_within(n):
    samples = np.random.default_rng(n).normal(size=(n, n + 1, n + 2)).astype(np.float32)
    volume = isosurface(grid_of(samples), 0.1, capped=False)
    want = surface_cells(samples >= 0.1)
    want[0], want[-1], want[:, 0], want[:, -1], want[:, :, 0], want[:, :, -1] = [False] * 6
    size = np.array(samples.shape[::-1]) + 1
    assert_array_equal(volume.read_surface((-1, -1, -1), size), want)


# ---- limits ------------------------------------------------------------------------------------


def test_memory_is_refused_before_it_is_taken():
    samples = np.random.default_rng(0).random((64, 64, 64)).astype(np.float32)
    with pytest.raises(leapray.OutOfMemory, match="bytes"):
        isosurface(grid_of(samples), 0.5, max_nbytes=1_000_000)
    assert isosurface(grid_of(samples), 0.5, max_nbytes=2_000_000).info.nbytes < 2_000_000
    empty = np.zeros((64, 64, 64), np.float32)
    empty[30, 30, 30] = 1  # constant bricks take nothing
    assert isosurface(grid_of(empty), 0.5, max_nbytes=50_000).info.n_surface_cells == 8


@pytest.mark.parametrize(
    "samples",
    [
        np.zeros((0, 2, 2)),
        np.zeros((3, 3)),
        np.zeros((2, 2, 2), complex),
        np.full((2, 2, 2), "a"),
        np.zeros((2, 2, 2), object),
        [[[1.0]]],
    ],
    ids=["empty", "flat", "complex", "words", "objects", "list"],
)
def test_what_is_no_lattice_of_numbers_is_refused(samples):
    with pytest.raises(leapray.LeapRayError):
        isosurface(ScalarGrid("bad", samples, np.eye(4)), 0.5)


def test_odd_thresholds_places_and_laws_are_refused():
    samples = np.arange(27.0).reshape(3, 3, 3)
    for threshold in (np.nan, np.inf):
        with pytest.raises(leapray.LeapRayError, match="finite"):
            isosurface(grid_of(samples), threshold)
    for law in ({"scale": 0.0}, {"scale": np.nan}, {"offset": np.inf}):
        with pytest.raises(leapray.LeapRayError, match="scale"):
            isosurface(grid_of(samples, **law), 1.0)
    with pytest.raises(leapray.LeapRayError, match="invertible"):
        isosurface(ScalarGrid("flat", samples, np.zeros((4, 4))), 1.0)
    for place in (np.eye(3), np.full((4, 4), "a"), None):
        for held in (samples, fog().samples):
            with pytest.raises(leapray.LeapRayError, match="world_from_index"):
                isosurface(ScalarGrid("misplaced", held, place), 1.0)
    with pytest.raises(leapray.LeapRayError, match="background"):
        isosurface(fog(), -1.0)
    with pytest.raises(leapray.LeapRayError, match="ScalarGrid"):
        isosurface(samples, 1.0)


def test_leaves_off_their_places_are_refused():
    one = np.zeros((1, 8, 8, 8), np.float32)
    for leaves in (
        Leaves(np.array([[1, 0, 0]], np.int32), one, 0.0),
        Leaves(np.zeros((2, 3), np.int32), np.zeros((2, 8, 8, 8)), 0.0),
        Leaves(np.zeros((1, 3), np.int32), np.zeros((1, 4, 4, 4)), 0.0),
        Leaves(np.zeros((1, 3), np.int32), one, np.nan),
        Leaves(np.array([[0, 0, 0], [8 << 26, 0, 0]], np.int32), np.zeros((2, 8, 8, 8)), 0.0),
    ):
        with pytest.raises(leapray.LeapRayError):
            isosurface(ScalarGrid("bad", leaves, np.eye(4)), 0.5)


def test_nothing_and_everything_are_volumes_too():
    samples = np.random.default_rng(0).normal(size=(9, 10, 11))
    samples[4, 4, 4] = np.nan
    assert isosurface(grid_of(samples), 100).info.n_surface_cells == 0
    full = inside(isosurface(grid_of(samples), -100))
    assert_array_equal(full, np.isfinite(samples))
    assert isosurface(grid_of(np.full((2, 3, 4), np.nan)), 0).info.n_surface_cells == 0
    none = Leaves(np.empty((0, 3), np.int32), np.empty((0, 8, 8, 8), np.float32), 0.0)
    assert isosurface(ScalarGrid("none", none, np.eye(4)), 0.5).info.n_surface_cells == 0


def test_isosurfaces_are_neither_narrowed_nor_merged():
    volume = isosurface(noisy(), -950)
    with pytest.raises(leapray.LeapRayError, match="isosurface"):
        volume.narrow()
    with pytest.raises(leapray.LeapRayError):
        leapray.merge([volume])
