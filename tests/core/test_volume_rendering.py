# SPDX-License-Identifier: GPL-3.0-or-later
"""Claims about light through visible volumes: what integrals are, and that no walk changes them."""

from __future__ import annotations

import sys
from math import erf
from pathlib import Path

import numpy as np
import pytest
import ramps
from numpy.testing import assert_allclose, assert_array_equal

import leapray
from addon.study import light_integrals as oracle

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "blend_samples"))

import head_phantom as head

EXACT = [t for t in leapray.variants() if t.exact]
SIDE = 21  # samples along a cube of random cells
ALL = np.array([0, 1], oracle.Real)


def trace(volume, origins, directions, spec="aw", mode="volume", **more) -> leapray.Hits:
    return leapray.trace(leapray.build(volume, spec), origins, directions, mode=mode, **more)


# ---- against extended precision ------------------------------------------------------------------


def random_cells(rng, n: int):
    """Rays through n cells of a cube, one each, from where they enter it, and where they leave."""
    cell = rng.integers(0, SIDE - 1, (n, 3))
    p, d = cell + rng.random((n, 3)), rng.normal(size=(n, 3))
    a, b = (cell - p) / d, (cell + 1 - p) / d
    t0, t1 = np.minimum(a, b).max(1), np.maximum(a, b).min(1)
    return p + t0[:, None] * d, d, t1 - t0


def errors_in_cells(rng, n: int, n_ramps: int, tolerance: float):
    """Of colours, as shares of what tolerance is a share of, and of transmittances."""
    worst = np.zeros(2)
    for k in range(n_ramps):
        knots = ramps.random_knots(rng, dense=10.0 ** rng.uniform(-2, 2))
        ramp = oracle.Ramp(*knots)
        samples = rng.random((SIDE,) * 3).astype(np.float32)
        samples = samples if k % 2 else np.float32(0.3 + 0.3 * samples)
        o, d, size = random_cells(rng, n)
        first, last = size * rng.uniform(1e-9, 0.3, n), size * rng.uniform(0.6, 1 - 1e-9, n)
        volume = ramps.volume(samples, knots)
        got = trace(volume, o, d, t_min=first, t_max=last, tolerance=tolerance)
        length = (last - first) * np.sqrt((d.astype(oracle.Real) ** 2).sum(1))
        c, _ = oracle.cubics(samples, *(x.astype(oracle.Real) for x in (o, d, first, last)))
        color, left = oracle.through_cells(c, np.broadcast_to(ALL, (n, 2)), length, ramp)
        scale = ramp.start[:, 1:4].max() + ramp.start[:, 4:].max() * length
        off = abs(got.color - color).max(1) / scale, abs(got.transmittance - left)
        worst = np.maximum(worst, [x.max() for x in off])
    return worst


@pytest.mark.parametrize("tolerance", [1e-4, 1e-6])
def test_colours_in_random_cells_are_within_the_tolerance(tolerance):
    color, left = errors_in_cells(np.random.default_rng(1), 500, 20, tolerance)
    assert color < tolerance and left < 2e-11  # transmittance needs no rule


@pytest.mark.slow
def test_colours_in_a_hundred_thousand_cells_are_within_the_tolerance():
    color, left = errors_in_cells(np.random.default_rng(2), 500, 200, 1e-4)
    assert color < 1e-4 and left < 2e-11


def test_the_oracle_agrees_with_itself_at_half_its_panels(monkeypatch):
    knots = ramps.random_knots(np.random.default_rng(3), dense=3.0)
    samples = np.random.default_rng(4).random((9, 9, 9)).astype(np.float32)
    o, d = ramps.rays(np.random.default_rng(5), 40, 8.0)
    color, left = oracle.light(samples, o, d, oracle.Ramp(*knots))
    monkeypatch.setattr(oracle, "PANELS", 2)
    again, clear = oracle.light(samples, o, d, oracle.Ramp(*knots))
    assert color.max() > 0.1
    assert abs(color - again).max() < 1e-9 and abs(left - clear).max() < 1e-9


def head_rays(n: int):
    rng = np.random.default_rng(6)
    eye = np.array([220.0, 260.0, 120.0])
    return np.tile(eye, (n, 1)), rng.uniform(-90, 90, (n, 3)) - eye


@pytest.fixture(scope="module")
def scan():
    return head.volume(64), head.world_from_index(64)


@pytest.mark.parametrize("tolerance", [1e-4, 1e-6])
def test_rays_through_a_head_are_within_the_tolerance(scan, tolerance):
    samples, matrix = scan
    o, d = head_rays(300)
    got = trace(ramps.volume(samples, ramps.CT, matrix), o, d, "cd", tolerance=tolerance)
    color, left = oracle.light(samples.astype(np.float64), o, d, oracle.Ramp(*ramps.CT), matrix)
    assert 0.2 < left.mean() < 0.9 and (left < 0.01).mean() > 0.1  # some pass, some do not
    assert abs(got.color - color).max() < tolerance
    assert abs(got.transmittance - left).max() < 1e-10


@pytest.mark.parametrize("seed", range(3))
def test_a_field_that_lies_on_a_knot_ends(seed):
    """Rounding puts it on either side of the knot, where extinction goes through 0."""
    rng = np.random.default_rng(seed)
    samples = np.full((9, 9, 9), 1000, np.uint16)
    some = rng.random(samples.shape) < 0.4
    samples[some] = rng.integers(500, 1500, some.sum())
    scale, offset = rng.uniform(0.01, 1), rng.uniform(-2000, 0)
    values = offset + scale * np.array([700, 1000, 1300])
    transfer = leapray.TransferFunction(values, [0.5, 0.0, 0.5], np.eye(3))
    volume = leapray.visible_volume(ramps.grid(samples, scale=scale, offset=offset), transfer)
    o, d = ramps.rays(rng, 2000, 8.0)
    got = trace(volume, o, d, "cd")  # halved to the last bit it would take for ever
    assert 1 < got.counters["samples"] / len(o) < 50
    assert got.transmittance.min() < 0.5


# ---- closed forms --------------------------------------------------------------------------------


@pytest.mark.parametrize("extinction", [1e-6, 0.05, 3.0, 400.0])
def test_a_box_of_one_extinction_lets_through_what_beer_and_lambert_say(extinction):
    samples = np.ones((9, 10, 11), np.float32)
    o, d = ramps.rays(np.random.default_rng(7), 500, 8.0)
    near, far = -o / d, (np.array([10, 9, 8]) - o) / d
    t0, t1 = np.minimum(near, far).max(1), np.maximum(near, far).min(1)
    path = np.maximum(np.minimum(t1, np.inf) - np.maximum(t0, 0), 0) * np.linalg.norm(d, axis=1)
    got = trace(ramps.volume(samples, ([1.0], [extinction], [(1.0, 0.5, 0.25)])), o, d)
    assert (path > 1).sum() > 300
    assert_allclose(got.transmittance, np.exp(-extinction * path), atol=1e-12)
    assert_allclose(got.color[:, 1], 0.5 * -np.expm1(-extinction * path), atol=1e-12)
    assert_array_equal(got.opacity, 1 - got.transmittance)
    assert_allclose(got.t[path > 0], np.maximum(t0, 0)[path > 0], atol=1e-12)
    assert np.isinf(got.t[path == 0]).all()


def test_a_box_that_shines_and_does_not_absorb_shines_by_its_depth():
    samples = np.ones((4, 5, 6), np.float32)
    got = trace(ramps.volume(samples, ([1.0], [0.0], (1, 1, 1), [(2.0, 0.0, 1.0)])),
                [(-3.0, 1.3, 1.2)], [(0.5, 0.0, 0.0)])  # fmt: skip
    assert_allclose(got.color, [(10.0, 0.0, 5.0)], rtol=1e-14)
    assert got.transmittance == 1.0 and got.t == 6.0


def test_a_box_that_shines_and_absorbs_tends_to_the_source():
    samples = np.ones((4, 5, 6), np.float32)
    got = trace(ramps.volume(samples, ([1.0], [2.0], (0.5, 0.5, 0.5), (3.0, 1.0, 0.0))),
                [(-3.0, 1.3, 1.2)], [(1.0, 0.0, 0.0)])  # fmt: skip
    assert_allclose(got.color[0], (np.array([3.0, 1.0, 0.0]) / 2 + 0.5) * -np.expm1(-10), rtol=1e-6)


def test_a_slab_whose_extinction_and_colour_rise_is_what_the_integral_says():
    """Extinction a x and colour x: light is the integral of a x^2 exp(-a x^2 / 2)."""
    n, a = 11, 0.3
    samples = np.broadcast_to(np.arange(n, dtype=np.float32), (4, 4, n))
    got = trace(ramps.volume(samples, ([0, 10], [0, 10 * a], [(0, 0, 0), (10, 5, 0)])),
                [(-2.0, 1.5, 1.5)], [(2.0, 0.0, 0.0)], tolerance=1e-9)  # fmt: skip
    assert_allclose(got.transmittance, np.exp(-a * 100 / 2), rtol=1e-11)
    whole = np.sqrt(np.pi / (2 * a)) * erf(10 * np.sqrt(a / 2)) - 10 * np.exp(-a * 50)
    assert_allclose(got.color[0], [whole, whole / 2, 0], atol=1e-7)


def test_a_ball_is_as_opaque_as_its_chords_are_long():
    """The sampled sphere is smaller by at most h^2 / 4R: 0.016 voxel along half a chord's slope."""
    n, radius, extinction = 40, 15.0, 0.08
    z, y, x = np.mgrid[:n, :n, :n] - 19.5
    samples = np.float32(radius - np.sqrt(x * x + y * y + z * z))
    volume = ramps.volume(samples, ([0, 0], [0, extinction], (1, 1, 1)))
    off = np.linspace(0, 14, 40)
    o = np.stack([np.full(40, -9.0), 19.5 + 0.8 * off, 19.5 + 0.6 * off], 1)
    got = trace(volume, o, np.tile((1.0, 0, 0), (40, 1)))
    depth = extinction * 2 * np.sqrt(radius**2 - off**2)
    assert_allclose(-np.log(got.transmittance), depth, atol=extinction * 2 * 0.017 / 0.35)


# ---- every walk ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def field():
    rng = np.random.default_rng(8)
    shines = rng.random((4, 3)) * [[0], [1], [1], [0]]
    knots = [0.35, 0.5, 0.5, 0.8], [0.0, 0.4, 0.05, 0.3], rng.random((4, 3)), shines
    samples = ramps.noise(rng, 40)
    return leapray.FieldSamples(ramps.grid(samples)), leapray.TransferFunction(*knots)


def some_rays():
    o, d = ramps.rays(np.random.default_rng(9), 700, 39.0)
    along = np.array([(1.0, 0, 0), (0, -1.0, 0), (0, 0, 2.0), (1, 1, 0), (1, -1, 1)])
    starts = np.array([(-3, 12, 17), (20, 45, 3), (7, 9, -2), (-2, -2, 11), (-2, 40, -2.0)])
    return np.r_[o, starts, starts + 0.25], np.r_[d, along, along]


def answers(hits) -> np.ndarray:
    columns = [hits.t, *hits.color.T, hits.transmittance, hits.value, hits.length]
    return np.stack([c for c in columns if c.size])


@pytest.mark.parametrize("mode", leapray.VISIBLE_MODES)
def test_every_exact_traverser_and_no_leaping_give_the_same_bits(field, mode):
    samples, transfer = field
    rays = some_rays()
    visible = samples.at(transfer)
    want = answers(trace(visible, *rays, "aw", mode))
    assert np.isfinite(want).mean() > 0.5
    for entry in EXACT:
        assert_array_equal(answers(trace(visible, *rays, entry, mode)), want, entry.spec)
    everything = samples.at(transfer, everywhere=True)
    assert everything.info.n_surface_cells == 39**3 > 2 * visible.info.n_surface_cells
    if mode == "volume":  # of values there are more, then
        for spec in ("aw", "cd", "kdtree"):
            assert_array_equal(answers(trace(everything, *rays, spec, mode)), want)


@pytest.mark.parametrize("sampling", ["post", "pre"])
def test_samples_stay_on_one_lattice_whatever_is_leapt_over(field, sampling):
    samples, transfer = field
    rays = some_rays()
    how = {"sampling": sampling, "step": 0.37}
    want = answers(trace(samples.at(transfer, everywhere=True), *rays, **how))
    visible = samples.at(transfer)
    for entry in EXACT:
        assert_array_equal(answers(trace(visible, *rays, entry, **how)), want)


def test_threads_and_parts_of_rays_change_no_bit(field):
    visible = field[0].at(field[1])
    o, d = ramps.rays(np.random.default_rng(10), 70000, 39.0)
    one = answers(trace(visible, o, d, "cd"))
    assert_array_equal(answers(trace(visible, o, d, "cd", threads=2)), one)
    assert_array_equal(answers(trace(visible, o[65000:], d[65000:], "cd")), one[:, 65000:])


def test_a_ray_cut_in_two_lets_through_the_product_and_shows_the_sum(field):
    visible = field[0].at(field[1])
    o, d = ramps.rays(np.random.default_rng(11), 300, 39.0)
    cut = np.random.default_rng(12).uniform(0.2, 1.2, 300)
    whole = trace(visible, o, d, tolerance=1e-9)
    first = trace(visible, o, d, t_max=cut, tolerance=1e-9)
    then = trace(visible, o, d, t_min=cut, tolerance=1e-9)
    assert_allclose(first.transmittance * then.transmittance, whole.transmittance, rtol=1e-9)
    both = first.color + first.transmittance[:, None] * then.color
    assert_allclose(both, whole.color, atol=1e-8)


@pytest.mark.parametrize("stop", [0.5, 0.9, 0.99])
def test_rays_that_end_early_are_off_by_what_is_let_through_at_most(scan, stop):
    volume = ramps.volume(scan[0], ramps.CT, scan[1])
    rays = head_rays(2000)
    whole, early = trace(volume, *rays), trace(volume, *rays, stop_opacity=stop)
    assert early.counters["tests"] < whole.counters["tests"]
    off = abs(early.color - whole.color).max(1)
    assert 0 < off.max() <= 1 - stop
    assert (off[whole.opacity < stop] == 0).all()
    assert (early.opacity[whole.opacity >= stop] >= stop).all()


# ---- no stripes ----------------------------------------------------------------------------------


def stripes(picture, period: float) -> float:
    """Of rows of pixels what waves of that period have, at the most, beside the row's own shape."""
    n = picture.shape[1]
    window = np.hanning(n)
    smooth = picture - np.apply_along_axis(
        lambda row: np.polyval(np.polyfit(np.arange(n), row, 6), np.arange(n)), 1, picture
    )
    spectrum = abs(np.fft.rfft(smooth * window, axis=1)).mean(0) / window.sum() * 2
    at = round(n / period)
    return float(spectrum[at - 2 : at + 3].max())


def test_exact_integrals_have_no_stripes_and_samples_at_steps_have():
    """A slanted plane that turns opaque within a tenth of a voxel, seen by parallel rays: where it
    lies between two samples changes from ray to ray, and so does what samples make of it."""
    n = 34
    _, y, x = np.mgrid[:n, :n, :n].astype(np.float32)
    samples = (x + 0.25 * y).astype(np.float32)
    knots = [15, 15.1, 17.5, 17.6], [0, 0.6, 0.6, 0.0], (1, 1, 1)
    volume = ramps.volume(samples, knots)
    across = np.arange(256) / 256 * 24 + 4
    o = np.stack(np.meshgrid([-3.0], across, [11.2, 12.7], indexing="ij"), -1).reshape(-1, 3)
    d = np.tile((1.0, 0.0, 0.0), (len(o), 1))
    step, width = 1.0, 256 / 24
    period = step / 0.25 * width  # pixels from one sample's plane to the next
    picture = lambda **how: trace(volume, o, d, **how).opacity.reshape(256, 2).T  # noqa: E731
    exact, sampled = (stripes(picture(**how), period) for how in ({}, {"sampling": "post"}))
    off = np.array([0.0, 1e-9, 1e-9])  # the oracle takes no direction with a 0
    _, left = oracle.light(samples, o + off, d + off, oracle.Ramp(*knots))
    true = stripes(np.float64(1 - left).reshape(256, 2).T, period)
    assert sampled > 0.01
    assert exact < true + 1e-9 and true < 1e-6
