# SPDX-License-Identifier: GPL-3.0-or-later
"""Opacity modulated by the length of the gradient: against fine steps of the same definition, and
in closed form where the gradient is even."""

from __future__ import annotations

import numpy as np
import pytest
from stage import EXACT, one
from test_render_scattering import DARK, render

import leapray

SHAPE = (9, 8, 10)  # of samples, along z, y, x
COLORS = [(1.0, 0.2, 0.1), (0.1, 0.9, 0.3), (0.2, 0.3, 1.0)]
GLOW = [(0.0, 0.1, 0.0), (0.4, 0.0, 0.2), (0.0, 0.3, 0.6)]
KNOTS = [0.2, 0.5, 0.8]


def transfer(full=0.0, sigma=1.0, colors=COLORS, glow=GLOW):
    return leapray.TransferFunction(
        KNOTS, sigma * np.array([0.3, 2.0, 1.0]), colors, glow, full_gradient=full
    )


def skewed():
    """Object space of a lattice: neither even nor upright."""
    matrix = np.eye(4)
    matrix[:3, :3] = [[0.5, 0.1, 0.0], [0.0, 0.4, 0.1], [0.05, 0.0, 0.7]]
    matrix[:3, 3] = (0.3, -0.2, 0.1)
    return matrix


def grid_of(values, matrix=None):
    return leapray.ScalarGrid(
        "data", np.asarray(values, np.float32), skewed() if matrix is None else matrix
    )


def noise(seed=3):
    """Smooth enough that gradients differ, from 0 to 1."""
    values = np.random.default_rng(seed).random(SHAPE)
    for axis in range(3):
        values = (values + np.roll(values, 1, axis)) / 2
    low, high = values.min(), values.max()
    return (values - low) / (high - low)


def rays(n, seed=5, size=SHAPE, matrix=None):
    """Through the lattice, in object space, from t = 0 to 4."""
    matrix = skewed() if matrix is None else matrix
    rng = np.random.default_rng(seed)
    ends = rng.uniform(-0.1, 1.1, (2, n, 3)) * (np.array(size)[::-1] - 1)
    o, at = (end @ matrix[:3, :3].T + matrix[:3, 3] for end in ends)
    return o - 2 * (at - o), at - o


def shares(values, matrix, full):
    """Of the samples: their gradients' lengths by central differences, one-sided at the border."""
    per_index = np.stack(np.gradient(values.astype(np.float32).astype(float))[::-1], -1)
    per_unit = per_index @ np.linalg.inv(matrix[:3, :3])
    return np.minimum(np.linalg.norm(per_unit, axis=-1) / full, 1)


def trilinear(samples, q):
    """At q (n, 3), index coordinates in x, y, z order, within the lattice."""
    size = np.array(samples.shape)[::-1]
    c = np.clip(np.floor(q).astype(int), 0, size - 2)
    p, sum_ = q - c, 0.0
    for b in range(8):
        o = np.array([b & 1, b >> 1 & 1, b >> 2])
        weight = np.where(o, p, 1 - p).prod(-1)
        x, y, z = (c + o).T
        sum_ = sum_ + weight * samples[z, y, x]
    return sum_


def stepped(values, matrix, look, full, o, d, n=40000):
    """Colour and transmittance of rays by steps of equal length, of the samples' own definition."""
    shown = shares(values, matrix, full)
    inverse, found = np.linalg.inv(matrix), []
    for origin, direction in zip(o, d, strict=True):
        t = (np.arange(n) + 0.5) / n * 4
        p = origin + t[:, None] * direction
        q = p @ inverse[:3, :3].T + inverse[:3, 3]
        inside = ((q >= 0) & (q <= np.array(values.shape)[::-1] - 1)).all(1)
        step = 4 / n * np.linalg.norm(direction)
        value, m = (trilinear(each, q[inside]) for each in (values.astype(np.float32), shown))
        extinction = m * np.interp(value, look.values, look.extinction)
        color, glow = (
            np.stack([np.interp(value, look.values, each[:, k]) for k in range(3)], 1)
            for each in (look.colors, look.emission)
        )
        depth = np.cumsum(extinction) * step
        before = np.exp(-(depth - extinction * step / 2))
        light = before[:, None] * (extinction[:, None] * color + m[:, None] * glow)
        found.append([*(light.sum(0) * step), np.exp(-depth[-1:].sum())])
    return np.array(found)


def traced(volume, o, d, **more):
    got = leapray.trace(
        leapray.build(volume, more.pop("traverser", "cd")),
        o,
        d,
        mode="volume",
        stop_opacity=1.0,
        **more,
    )
    return np.column_stack([got.color, got.transmittance])


# ---- what it is ------------------------------------------------------------------------


@pytest.mark.parametrize("full", [0.3, 1.0, 4.0])
def test_light_agrees_with_fine_steps(full):
    values, look = noise(), transfer(full)
    o, d = rays(60)
    got = traced(leapray.visible_volume(grid_of(values), look), o, d, tolerance=1e-6, t_max=4.0)
    expected = stepped(values, skewed(), look, full, o, d)
    assert (expected[:, 3] < 0.9).mean() > 0.5
    assert np.abs(got - expected).max() < 1e-4  # the steps jump at the border and at knots
    plain = traced(leapray.visible_volume(grid_of(values), transfer()), o, d, t_max=4.0)
    assert np.abs(got - plain).max() > 0.05


@pytest.mark.parametrize("glow", [GLOW, None])
@pytest.mark.parametrize("colors", [COLORS, (0.3, 0.6, 0.9)])
@pytest.mark.parametrize("sigma", [0.0, 1.0, 200.0])
def test_an_even_gradient_scales_all_that_is_seen(sigma, colors, glow):
    """Half of the full gradient is half of extinction and emission, to the tolerance."""
    z, y, x = np.mgrid[:9, :8, :10]
    values, matrix = (0.1 * x - 0.05 * y + 0.02 * z) + 0.3, skewed()
    slope = np.linalg.norm(np.array([0.1, -0.05, 0.02]) @ np.linalg.inv(matrix[:3, :3]))
    o, d = rays(300)
    half = None if glow is None else np.array(glow) / 2
    pictures = [
        traced(leapray.visible_volume(grid_of(values), look), o, d, tolerance=1e-7)
        for look in (transfer(2 * slope, sigma, colors, glow), transfer(0, sigma / 2, colors, half))
    ]
    if sigma > 0:
        assert (pictures[0][:, 3] < 0.99).mean() > 0.4
    assert np.abs(pictures[0] - pictures[1]).max() < 2e-6


def test_beyond_the_full_gradient_all_is_seen():
    values = noise()
    o, d = rays(300)
    bright = [
        traced(leapray.visible_volume(grid_of(values), transfer(full)), o, d, tolerance=1e-7)
        for full in (1e-12, 0.0)
    ]
    assert np.abs(bright[0] - bright[1]).max() < 2e-6


def test_even_data_are_not_seen():
    volume = leapray.visible_volume(grid_of(np.full(SHAPE, 0.5)), transfer(0.1))
    got = traced(volume, *rays(50))
    assert (got == [0, 0, 0, 1]).all()


def test_samples_at_steps_are_modulated_alike():
    values, look = noise(), transfer(1.0)
    volume = leapray.visible_volume(grid_of(values), look)
    o, d = rays(100)
    exact = traced(volume, o, d)
    for sampling, most in (("post", 2e-3), ("pre", 0.3)):
        got = traced(volume, o, d, sampling=sampling, step=0.002)
        assert np.abs(got - exact).max() < most


def test_beside_what_is_no_value_differences_are_one_sided():
    """A ramp with a hole, of uneven planes, has one gradient throughout."""
    x = np.cumsum([0, 1, 2, 1, 3, 1, 1, 2, 1, 1.0])
    values = np.broadcast_to(0.04 * x + 0.3, SHAPE).copy()
    values[4, 4, 5] = np.nan
    planes = x, np.arange(8.0), np.arange(9.0)
    o, d = rays(200, matrix=np.diag([1.3, 1, 1, 1]))
    more = dict(traverser="aw", tolerance=1e-7)
    pictures = [
        traced(
            leapray.visible_volume(grid_of(values, np.eye(4)), look, planes=planes), o, d, **more
        )
        for look in (transfer(0.08), transfer(0, 0.5, glow=np.array(GLOW) / 2))
    ]
    assert (pictures[0][:, 3] < 0.9).mean() > 0.5
    assert np.abs(pictures[0] - pictures[1]).max() < 2e-6


def test_whole_numbers_and_scales_have_the_gradient_of_values():
    x = np.mgrid[:9, :8, :10][2]
    whole = leapray.ScalarGrid("data", (10 * x + 30).astype(np.uint8), np.eye(4), -0.01, 1.0)
    o, d = rays(100, matrix=np.eye(4))
    pictures = [
        traced(leapray.visible_volume(whole, look), o, d, tolerance=1e-7)
        for look in (transfer(0.2), transfer(0, 0.5, glow=np.array(GLOW) / 2))
    ]
    assert np.abs(pictures[0] - pictures[1]).max() < 2e-6


# ---- where rays end ------------------------------------------------------------------------


def test_rays_end_where_their_transmittance_says():
    volume = leapray.visible_volume(grid_of(noise()), transfer(1.0))
    o, d = rays(500)
    structure = leapray.build(volume, "cd")
    through = leapray.trace(structure, o, d, mode="volume").transmittance
    u = np.random.default_rng(7).random(len(o))
    stop = 1 - u * (1 - through)
    ends = leapray.trace(structure, o, d, mode="volume", stop=stop)
    met = through < 1
    assert met.mean() > 0.5 and (np.isfinite(ends.t) == met).all()
    up_to = leapray.trace(structure, o[met], d[met], mode="volume", t_max=ends.t[met])
    assert np.abs(up_to.transmittance - stop[met]).max() < 1e-9


def test_scattered_light_keeps_its_energy():
    """White where all that is taken is scattered, whatever share is seen."""
    values = noise()
    e = np.array([1.0, 5.0])
    look = leapray.TransferFunction([0.2, 0.8], e, DARK, None, e[:, None] * np.ones(3), 1.5)
    matrix = np.diag([0.25, 0.25, 0.25, 1])
    matrix[:3, 3] = -1
    structure = leapray.build(leapray.visible_volume(grid_of(values, matrix), look), "cd")
    got = render([one(structure)], world=(1, 1, 1), samples=256, max_bounces=64, volume_bounces=64)
    assert abs(got[:, :3].mean() - 1) < 0.01


# ---- bits ------------------------------------------------------------------------------------


def test_all_traversers_give_the_same_bits():
    volume = leapray.visible_volume(grid_of(noise()), transfer(1.0))
    o, d = rays(500)
    pictures = [traced(volume, o, d, traverser=name) for name in EXACT]
    for got in pictures[1:]:
        assert (got == pictures[0]).all()


def test_samples_that_take_no_memory_change_nothing():
    """Where a transfer function sees nothing samples are dropped, but for those that its gradients
    need."""
    n = 72  # the ball's least visible cells are the first of bricks, which begin at 6, 14, 22
    z, y, x = np.mgrid[:n, :n, :n]
    values = 0.5 - np.abs(np.sqrt((x - 24.5) ** 2 + (y - 24.4) ** 2 + (z - 24.6) ** 2) - 9) / 3
    grid = grid_of(values, np.eye(4))
    look = leapray.TransferFunction(KNOTS, [0, 2.0, 1.0], COLORS, full_gradient=0.4)
    o, d = rays(2000, size=(n, n, n), matrix=np.eye(4))
    dropped = leapray.FieldSamples(grid, transfer=look)
    assert dropped.nbytes < 0.9 * leapray.FieldSamples(grid).nbytes
    pictures = [traced(samples.at(look), o, d) for samples in (dropped, leapray.FieldSamples(grid))]
    assert (pictures[0] == pictures[1]).all()


@pytest.mark.parametrize("full", [-1.0, np.nan, np.inf])
def test_gradients_that_are_none_are_refused(full):
    with pytest.raises(
        leapray.LeapRayError, match="gradient at which all is seen must lie between"
    ):
        transfer(full)
