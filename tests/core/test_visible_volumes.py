# SPDX-License-Identifier: GPL-3.0-or-later
"""Visible volumes: which cells they have, extremes and means of values, and what they refuse."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest
import ramps
from numpy.testing import assert_allclose, assert_array_equal

import leapray
from leapray import FieldSamples, LeapRayError, Leaves, ScalarGrid, TransferFunction, visible_volume

EVERY = TransferFunction([0.0], [1.0])


def trace(volume, origins, directions, mode="volume", spec="aw", **more) -> leapray.Hits:
    return leapray.trace(leapray.build(volume, spec), origins, directions, mode=mode, **more)


def corner_ranges(values):
    shifted = [values[k : k or -1, j : j or -1, i : i or -1][: values.shape[0] - 1]
               for k in (0, 1) for j in (0, 1) for i in (0, 1)]  # fmt: skip
    nz, ny, nx = (n - 1 for n in values.shape)
    shifted = [values[k : k + nz, j : j + ny, i : i + nx]
               for k in (0, 1) for j in (0, 1) for i in (0, 1)]  # fmt: skip
    return np.min(shifted, 0), np.max(shifted, 0)


def sees(knots, low, high):
    """Is extinction or emission above 0 somewhere in low..high? By numpy, at ends and knots."""
    x, y = np.asarray(knots[0], float), np.asarray(knots[1], float)
    seen = (np.interp(low, x, y) > 0) | (np.interp(high, x, y) > 0)
    for at, extinction in zip(x, y, strict=True):
        seen |= (low <= at) & (at <= high) & (extinction > 0)
    return seen


# ---- which cells ---------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", ["u1", "i1", "u2", "i2", "i4", "f2", "f4", "f8"])
@pytest.mark.parametrize("scale", [1.0, -0.5])
def test_visible_cells_are_those_whose_values_can_be_seen(dtype, scale):
    rng = np.random.default_rng(1)
    number = 50 + 40 * ramps.noise(rng, 23)
    stored = np.array(number).astype(dtype)
    value = 3.0 + scale * stored.astype(np.float64)
    ends = np.quantile(value, [0.2, 0.5, 0.6])
    knots = ends, [0.0, 1.0, 0.0]
    volume = visible_volume(ramps.grid(stored, scale=scale, offset=3.0), TransferFunction(*knots))
    want = sees(knots, *corner_ranges(value))
    assert 0.1 < want.mean() < 0.9
    n = np.array(want.shape[::-1])
    assert_array_equal(volume.read_surface((0, 0, 0), n), want)
    assert volume.info.n_surface_cells == want.sum()  # none beyond the lattice


def test_the_greatest_of_a_range_is_that_of_its_ends_and_knots():
    rng = np.random.default_rng(2)
    for _ in range(50):
        knots = ramps.random_knots(rng, 2.0)
        low, high = np.sort(rng.uniform(-0.5, 1.5, (2, 200)), axis=0)
        low[::7], high[::5] = knots[0][0], np.maximum(low[::5], knots[0][-1])
        low = np.minimum(low, high)
        extinction, emission = TransferFunction(*knots).greatest(low, high)
        x = knots[0] + np.arange(len(knots[0])) * 1e-13  # jumps as steep ramps
        inside = (low[:, None] <= knots[0] + 1e-15) & (knots[0] <= high[:, None])
        ends = np.maximum(np.interp(low, x, knots[1]), np.interp(high, x, knots[1]))
        want = np.maximum(ends, np.where(inside, knots[1], 0).max(1))
        assert_allclose(extinction, want, atol=1e-9)
        assert (emission.max() > 0) == (knots[3] is not None and knots[3].max() > 0)


def test_what_is_no_number_hides_the_cells_around_it():
    values = np.ones((6, 7, 8), np.float32)
    values[2, 3, 4] = np.nan
    values[4, 5, 1] = -7
    for stored in (values, np.nan_to_num(values, nan=-7).astype(np.int16)):
        volume = visible_volume(ramps.grid(stored, no_data=-7), EVERY)
        hidden = ~volume.read_surface((0, 0, 0), (7, 6, 5))
        want = np.zeros((5, 6, 7), bool)
        want[1:3, 2:4, 3:5] = want[3:5, 4:6, 0:2] = True
        assert_array_equal(hidden, want)


def test_the_least_number_is_seen_like_any_other():
    for dtype in ("u1", "u2", "i2", "f4"):
        low = np.iinfo(dtype).min if dtype != "f4" else -5.0
        values = np.full((5, 5, 5), low, dtype)
        values[0] = np.iinfo(dtype).max if dtype != "f4" else 9.0
        volume = visible_volume(ramps.grid(values), EVERY)
        assert volume.info.n_surface_cells == 4**3


def test_a_field_without_numbers_and_one_that_nobody_sees_are_empty():
    for values in (np.full((4, 4, 4), np.nan), np.zeros((4, 4, 4))):
        volume = visible_volume(ramps.grid(values), TransferFunction([0, 1], [0, 1]))
        assert volume.info.n_surface_cells == 0
        hits = trace(volume, [(-1.0, 1.2, 1.3)], [(1.0, 0, 0)])
        assert np.isinf(hits.t) and hits.transmittance == 1 and not hits.color.any()
    assert not TransferFunction([0, 1], [0, 0]).visible and EVERY.visible
    assert TransferFunction([0], [0], emission=(0, 0, 1)).visible


def test_leaves_are_seen_and_their_background_is_not():
    leaf = np.zeros((1, 8, 8, 8), np.float32)
    leaf[0, 2:6, 2:6, 2:6] = 1.0
    tiles = np.array([(64, 0, 0)], np.int32), np.array([16], np.int32), np.array([0.5])
    leaves = Leaves(np.array([(-8, 0, 8)], np.int32), leaf, 0.0, *tiles)
    field = FieldSamples(ScalarGrid("leaves", leaves, np.eye(4)))
    volume = field.at(TransferFunction([0.0, 1.0], [0.0, 1.0]))
    hits = trace(volume, [(-20.0, 3.0, 11.0), (-20.0, 3.1, 3.2)], [(1.0, 0, 0)] * 2)
    assert_allclose(-np.log(hits.transmittance), [12.0, 8.0], rtol=1e-10)  # ramps of a voxel, too
    assert_array_equal(hits.t, [13.0, 83.0])
    with pytest.raises(LeapRayError, match="background is visible"):
        field.at(TransferFunction([0.0, 1.0], [0.1, 1.0]))
    with pytest.raises(LeapRayError, match="background is visible"):
        field.at(TransferFunction([-1.0, 0.0, 1.0], [0.0, 0.1, 0.0]))


def test_one_field_holds_its_samples_once_for_all_volumes():
    field = FieldSamples(ramps.grid(ramps.noise(np.random.default_rng(3), 40)))
    volumes = [field.at(TransferFunction([x, x + 0.1], [0, 1])) for x in (0.1, 0.3, 0.5)]
    alone = visible_volume(ramps.grid(ramps.noise(np.random.default_rng(3), 40)),
                           TransferFunction([0.3, 0.4], [0, 1]))  # fmt: skip
    assert_array_equal(volumes[1].read_surface(), alone.read_surface())
    assert field.nbytes > 40**3 * 4
    n = [v.info.n_surface_cells for v in volumes]
    assert n[0] > n[1] > n[2] > 0


# ---- where it lies -------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", ["u1", "i2", "f4"])
def test_samples_that_nobody_sees_take_no_memory_and_change_no_bit(dtype):
    """A ball of high values in a noise of low ones, and a hole of NaN where there may be one."""
    z, y, x = np.mgrid[:70, :80, :90]
    ball = (x - 40) ** 2 + (y - 30) ** 2 + (z - 35) ** 2 < 12**2
    values = (np.where(ball, 100, 10) + np.random.default_rng(3).integers(0, 9, ball.shape)).astype(
        dtype
    )
    if dtype == "f4":
        values[30:33, 25:28, 38:41] = np.nan
    grid = ramps.grid(values, scale=0.5, offset=-2.0)
    transfer = TransferFunction([20.0, 50.0], [0.0, 0.1], [(0, 0, 0), (1, 2, 3)])
    asked = []
    whole = FieldSamples(grid)
    part = FieldSamples(grid, transfer=lambda low, high: asked.append((low, high)) or transfer)
    assert part.nbytes < whole.nbytes / 3 and asked == [(whole.low, whole.high)]
    rays = ramps.rays(np.random.default_rng(4), 500, 80.0)
    one, other = (trace(samples.at(transfer), *rays) for samples in (whole, part))
    assert (one.transmittance < 0.9).mean() > 0.1
    assert_array_equal(other.color, one.color)
    assert_array_equal(other.transmittance, one.transmittance)
    assert part.at(transfer).info.n_surface_cells == whole.at(transfer).info.n_surface_cells
    same = TransferFunction(transfer.values, transfer.extinction)
    assert part.at(same).info.n_surface_cells == part.at(transfer).info.n_surface_cells
    for how in ({"transfer": EVERY}, {"transfer": transfer, "everywhere": True}):
        with pytest.raises(LeapRayError, match="for one transfer function and what it sees alone"):
            part.at(**how)


def test_thin_things_between_hidden_bricks_are_seen():
    """Sheets and points at any place beside the faces of bricks."""
    transfer = TransferFunction([1.0, 2.0], [0.0, 1.0])
    for at in range(6, 18):
        values = np.zeros((25, 26, 27), np.uint8)
        values[at, at, at] = values[:, 3, 2] = 2
        values[:, :, at] += 1
        grid = ramps.grid(values)
        rays = ramps.rays(np.random.default_rng(at), 3000, 24.0)
        want = trace(FieldSamples(grid).at(transfer), *rays)
        got = trace(visible_volume(grid, transfer), *rays)
        assert_array_equal(got.transmittance, want.transmittance)
        assert (want.transmittance < 1).any()


def test_a_sheared_lattice_shows_what_its_rays_meet():
    matrix = np.array([[0.5, 0.1, 0, 3], [0, 2.0, 0.3, -1], [0.2, 0, 1.0, 7], [0, 0, 0, 1]])
    samples = ramps.noise(np.random.default_rng(4), 20)
    knots = [0.2, 0.6], [0.0, 1.0], (1, 1, 1)
    o, d = ramps.rays(np.random.default_rng(5), 200, 19.0)
    to = lambda p, w: p @ matrix[:3, :3].T + w * matrix[:3, 3]  # noqa: E731
    placed = trace(ramps.volume(samples, knots, matrix), to(o, 1), to(d, 0))
    straight = trace(ramps.volume(samples, knots), o, d)
    stretch = np.linalg.norm(to(d, 0), axis=1) / np.linalg.norm(d, axis=1)
    depth = -np.log(straight.transmittance) * stretch
    assert_allclose(-np.log(placed.transmittance), depth, atol=1e-9)


def test_a_rectilinear_lattice_shows_what_its_rays_meet():
    """Planes of a field that is linear in x may lie anywhere."""
    x = np.cumsum(np.r_[0, np.random.default_rng(6).uniform(0.3, 2.0, 14)])
    samples = np.broadcast_to(x, (4, 5, 15))
    knots = [2.0, 9.0], [0.0, 0.7], [(1, 0, 0), (0, 1, 0)]
    planes = x, np.arange(5.0), np.arange(4.0)
    volume = ramps.volume(samples.astype(np.float32), knots, planes=planes)
    even = np.broadcast_to(np.arange(33.0) * x[-1] / 32, (4, 5, 33))
    same = ramps.volume(even.astype(np.float32), knots, np.diag([x[-1] / 32, 1, 1, 1]))
    o, d = [(-1.0, 1.3, 2.2), (30.0, 0.1, 0.2)], [(1.0, 0.03, -0.02), (-2.0, 0.2, 0.1)]
    for entry in leapray.traversers():
        if entry.exact and entry.rectilinear:
            got, want = (trace(v, o, d, spec=entry, tolerance=1e-8) for v in (volume, same))
            assert_allclose(got.color, want.color, atol=2e-6)  # samples are 32-bit floats
            assert_allclose(got.transmittance, want.transmittance, atol=2e-6)
    with pytest.raises(LeapRayError, match="no one size"):
        trace(volume, o, d, sampling="post")
    with pytest.raises(LeapRayError, match="planes must be"):
        ramps.volume(samples.astype(np.float32), knots, planes=planes[::-1])


# ---- extremes and means --------------------------------------------------------------------------


def test_extremes_are_no_less_than_any_sample_and_no_more_than_the_cubic_has():
    samples = ramps.noise(np.random.default_rng(7), 24).astype(np.float64)
    volume = visible_volume(ramps.grid(samples.astype(np.float32)), EVERY, everywhere=True)
    o, d = ramps.rays(np.random.default_rng(8), 300, 23.0)
    for mode, best in (("maximum", np.max), ("minimum", np.min)):
        hits = trace(volume, o, d, mode, spec="cd")
        sign = 1 if mode == "maximum" else -1
        t = np.linspace(0, 2, 20001)
        for i in range(0, 300, 10):
            p = o[i] + t[:, None] * d[i]
            inside = ((p >= 0) & (p <= 23)).all(1)
            dense = best(interpolate(samples.astype(np.float32), p[inside]))
            assert 0 <= sign * (hits.value[i] - dense) + 1e-12 < 2e-3  # slope by spacing
        at = interpolate(samples.astype(np.float32), o + hits.t[:, None] * d)
        assert_allclose(at, hits.value, atol=1e-12)  # t is where it is


def interpolate(samples, p):
    cell = np.clip(np.floor(p).astype(int), 0, np.array(samples.shape[::-1]) - 2)
    q = p - cell
    value = np.zeros(len(p))
    for b in range(8):
        bits = np.array([b & 1, b >> 1 & 1, b >> 2])
        i, j, k = (cell + bits).T
        value += np.where(bits, q, 1 - q).prod(1) * samples[k, j, i]
    return value


def test_the_extreme_inside_a_cell_is_found():
    """f = x y (1 - z) has along x = y = z its maximum 4/27 at 2/3."""
    samples = np.zeros((2, 2, 2), np.float32)
    samples[0, 1, 1] = 1.0
    volume = visible_volume(ramps.grid(samples), EVERY)
    hits = trace(volume, [(-1.0, -1, -1)], [(1.0, 1, 1)], "maximum")
    assert_allclose([hits.value[0], hits.t[0]], [4 / 27, 5 / 3], rtol=1e-14)


def test_the_mean_is_the_integral_by_the_path():
    x = np.arange(11, dtype=np.int16)
    volume = visible_volume(ramps.grid(np.broadcast_to(x, (4, 4, 11)), scale=2.0, offset=-3.0),
                            TransferFunction([-3.0], [1.0]))  # fmt: skip
    o, d = [(-5.0, 1.2, 1.3), (2.0, 1.2, 1.3), (0, 9.0, 0)], [(2.0, 0.0, 0), (0.5, 0, 0), (1, 0, 0)]
    hits = trace(volume, o, d, "mean")
    assert_allclose(hits.length, [10.0, 8.0, 0.0], rtol=1e-13)
    assert_allclose(hits.value, [7.0, 9.0, np.nan], rtol=1e-13)
    assert_array_equal(hits.t, [2.5, 0.0, np.inf])


def test_only_values_in_visible_cells_count():
    x = np.arange(11, dtype=np.float32)
    volume = visible_volume(ramps.grid(np.broadcast_to(x, (4, 4, 11))),
                            TransferFunction([2.5, 2.5, 5.5, 5.5], [0, 1, 1, 0]))  # fmt: skip
    ray = [(-5.0, 1.2, 1.3)], [(1.0, 0.0, 0.0)]
    found = [trace(volume, *ray, mode).value[0] for mode in ("minimum", "maximum", "mean")]
    assert_allclose(found, [2, 6, 4])


# ---- refusals ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (([],), "extinction"),
        (([0, np.nan], [0, 1]), "finite"),
        (([0, np.inf], [0, 1]), "finite"),
        (([1, 0], [0, 1]), "not descend"),
        (([0, 1], [0, -1]), "extinction must lie between 0"),
        (([0, 1], [0, np.inf]), "extinction must lie between 0"),
        (([0, 1], [0, np.nan]), "extinction must lie between 0"),
        (([0, 1], [0, 1], (1, 1, -0.1)), "colours of a transfer function"),
        (([0, 1], [0, 1], (1, 1, 1), (np.nan, 0, 0)), "emission must lie"),
        (([0, 1], [0, 1, 2]), r"extinction must have the shape \(2,\)"),
        (([0, 1], [0, 1], (1, 1)), "colors must have the shape"),
        (([0, 1], [0, 1], np.ones((3, 3))), "colors must have the shape"),
        (([[0, 1]], [0, 1]), "values must have the shape"),
        ((["a", 1], [0, 1]), "must be numbers"),
        ((np.arange(70000), np.ones(70000)), "65536"),
    ],
)
def test_what_is_no_transfer_function_gets_a_sentence(arguments, words):
    if len(arguments) == 1:
        with pytest.raises(LeapRayError, match="1 to 65536"):
            TransferFunction([], [])
        return
    with pytest.raises(LeapRayError, match=words):
        TransferFunction(*arguments)


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ({"tolerance": 0.0}, "tolerance must lie"),
        ({"tolerance": np.nan}, "tolerance must lie"),
        ({"stop_opacity": 0.0}, "stop_opacity must lie"),
        ({"stop_opacity": 1.5}, "stop_opacity must lie"),
        ({"sampling": "post", "step": 0.0}, "step must lie"),
        ({"sampling": "post", "step": np.nan}, "step must lie"),
        ({"sampling": "often"}, "unknown sampling"),
        ({"mode": "surface"}, "in the place of a surface"),
        ({"mode": "binary"}, "in the place of a surface"),
    ],
)
def test_options_out_of_range_get_a_sentence(how, words):
    volume = visible_volume(ramps.grid(np.ones((3, 3, 3))), EVERY)
    with pytest.raises(LeapRayError, match=words):
        trace(volume, [(0.0, 0, 0)], [(1.0, 0, 0)], **how)


def test_volumes_of_a_surface_have_no_such_modes_and_visible_ones_no_bytes():
    solid = leapray.Volume(np.ones((3, 3, 3), np.float32))
    for mode in ("volume", "maximum", "minimum", "mean"):
        with pytest.raises(LeapRayError, match="no transfer function"):
            trace(solid, [(0.0, 0, 0)], [(1.0, 0, 0)], mode)
    with pytest.raises(LeapRayError, match="transfer function"):
        visible_volume(ramps.grid(np.ones((3, 3, 3))), EVERY).pack()
    for wrong in (None, [0, 1], solid):
        with pytest.raises(LeapRayError, match="is needed, not a"):
            visible_volume(ramps.grid(np.ones((3, 3, 3))), wrong)
        with pytest.raises(LeapRayError, match="is needed, not a"):
            visible_volume(wrong, EVERY)


@pytest.mark.parametrize("mode", ["volume", "maximum", "minimum", "mean"])
def test_rays_without_direction_see_nothing_and_wild_ones_no_nan(mode):
    samples = ramps.noise(np.random.default_rng(9), 12)
    knots = [-9.0, 0.0, 0.0, 1e-300, 2.0], [0.0, 1e30, 1e-30, 1e-300, 1e30], (1e30, 0, 1e-300)
    volume = ramps.volume(samples, knots)
    odd = (0.0, np.nan, np.inf, 1e300, -1e300, 1e-300, 5e-324, 3.3, -2.0)
    rng = np.random.default_rng(10)
    o, d = rng.choice(odd, (3000, 3)), rng.choice(odd, (3000, 3))
    low, high = rng.choice(odd, (2, 3000))
    for spec in ("aw", "cd", "kdtree", "frt"):
        hits = trace(volume, o, d, mode, spec=spec, t_min=low, t_max=high)
        none = ~np.isfinite(o).all(1) | ~np.isfinite(d).all(1) | (d == 0).all(1)
        assert np.isinf(hits.t[none]).all() and not np.isnan(hits.t).any()
        if mode == "volume":
            assert np.isfinite(hits.color).all()
            assert ((hits.transmittance >= 0) & (hits.transmittance <= 1)).all()
            assert (hits.color >= 0).all() and (hits.color[:, 0] <= 1.0001e30).all()


def test_a_stop_ends_a_call_soon():
    samples = np.random.default_rng(11).random((64, 64, 64)).astype(np.float32)
    x, colors = np.linspace(0, 1, 200), np.random.default_rng(1).random((200, 3))
    volume = ramps.volume(samples, (x, 1e-4 * (1 + np.sin(99 * x)), colors))
    o, d = ramps.rays(np.random.default_rng(12), 200000, 63.0)
    watch = leapray.Watch()
    threading.Timer(0.3, watch.stop).start()
    begun = time.perf_counter()
    with pytest.raises(leapray.Stopped):
        trace(volume, o, d, tolerance=1e-9, watch=watch)
    assert time.perf_counter() - begun < 0.3 + 0.3  # of which 0.1 are promised
