# SPDX-License-Identifier: GPL-3.0-or-later
"""Samples lit by one lamp, by the gradient as a normal: Phong's model by its definition."""

from __future__ import annotations

import numpy as np
import pytest
import ramps
from numpy.testing import assert_allclose, assert_array_equal
from test_gradient_modulation import noise, rays, shares, skewed, trilinear

import leapray

STEP = 0.29
KNOTS = (
    [0.25, 0.5, 0.5, 0.8],
    [0.0, 2.0, 0.4, 1.5],
    np.random.default_rng(1).random((4, 3)),
    np.random.default_rng(2).random((4, 3)),
)
LIGHTS = [None, (0.3, -0.8, 1.9), (0.0, 0.0, 1e-200)]


def trace(volume, o, d, **more) -> leapray.Hits:
    how = {"mode": "volume", "sampling": "post", "step": STEP, **more}
    return leapray.trace(leapray.build(volume), o, d, **how)


def gradients(values, q, normal):
    """By index coordinates, at q (n, 3), x first."""
    if normal == "central":
        return np.stack([trilinear(g, q) for g in np.gradient(values)[::-1]], 1)
    cell = np.clip(np.floor(q), 0, np.array(values.shape)[::-1] - 2)
    found = np.empty_like(q)
    for a in range(3):
        ends = [np.where(np.arange(3) == a, cell + end, q) for end in (0, 1)]
        found[:, a] = trilinear(values, ends[1]) - trilinear(values, ends[0])
    return found


def lit(g, view, light, phong):
    """Shares of diffuse light and of the highlight."""
    size = np.linalg.norm(g, axis=1, keepdims=True)
    n = np.divide(g, size, out=np.zeros_like(g), where=size > 0)
    n *= np.where(n @ view < 0, -1, 1)[:, None]
    nl = n @ light
    reflected = 2 * nl[:, None] * n - light
    shine = np.where(nl > 0, np.maximum(reflected @ view, 0) ** phong.power, 0)
    return phong.ambient + phong.diffuse * np.maximum(nl, 0), phong.specular * shine


def summed(values, matrix, look, o, d, phong, normal):
    """Colour and transmittance of one ray by the definition of its samples."""
    inverse = np.linalg.inv(matrix)
    per_index = inverse[:3, :3] @ d
    step = STEP / np.linalg.norm(per_index)
    t = np.arange(int(4 / step) + 1) * step
    q = (o + t[:, None] * d) @ inverse[:3, :3].T + inverse[:3, 3]
    q = q[((q >= 0) & (q < np.array(values.shape)[::-1] - 1)).all(1)]
    if not len(q):
        return np.r_[0, 0, 0, 1.0]
    value = trilinear(values, q)
    piece = np.searchsorted(look.values, value, "right")
    a, b = np.maximum(piece - 1, 0), np.minimum(piece, len(look.values) - 1)
    wide = look.values[b] - look.values[a]
    share = np.divide(value - look.values[a], wide, out=np.zeros_like(wide), where=wide > 0)
    extinction, color, glow = (
        x[a] + (x[b] - x[a]) * (share if x.ndim == 1 else share[:, None])
        for x in (look.extinction, look.colors, look.emission)
    )
    full = look.full_gradient
    length = step * np.linalg.norm(d) * np.ones(len(q))
    if full > 0:
        length *= trilinear(shares(values, matrix, full), q)
    g = gradients(values, q, normal) @ inverse[:3, :3]
    view = -d / np.linalg.norm(d)
    to = view if phong.light is None else np.array(phong.light) / max(np.abs(phong.light))
    diffuse, shine = lit(g, view, to / np.linalg.norm(to), phong)
    opacity = -np.expm1(-length * extinction)
    before = np.r_[1, np.cumprod(1 - opacity)]
    light = opacity[:, None] * (color * diffuse[:, None] + shine[:, None]) + length[:, None] * glow
    return np.r_[(before[:-1, None] * light).sum(0), before[-1]]


@pytest.mark.parametrize("light", LIGHTS)
@pytest.mark.parametrize("normal", ["central", "analytic"])
@pytest.mark.parametrize("full", [0.0, 1.0])
def test_lit_samples_are_the_sum_of_their_definition(full, normal, light):
    values, matrix = noise().astype(np.float32).astype(float), skewed()
    look = leapray.TransferFunction(*KNOTS, full_gradient=full)
    volume = leapray.visible_volume(ramps.grid(values.astype(np.float32), matrix), look)
    phong = leapray.Phong(0.1, 0.7, 0.5, 9, light)
    o, d = rays(80)
    got = trace(volume, o, d, phong=phong, normal=normal, t_max=4.0)
    want = [summed(values, matrix, look, *ray, phong, normal) for ray in zip(o, d, strict=True)]
    found = np.column_stack([got.color, got.transmittance])
    assert_allclose(found, want, atol=1e-12)
    unlit = trace(volume, o, d, t_max=4.0)
    assert_array_equal(got.transmittance, unlit.transmittance)
    assert np.abs(got.color - unlit.color).max() > 0.05


def test_without_a_gradient_only_the_ambient_share_is_left():
    volume = ramps.volume(np.full((6, 6, 6), 0.6, np.float32), ([0.0, 1.0], [0.0, 1.0]))
    o, d = ramps.rays(np.random.default_rng(8), 40, 5.0)
    lamp = leapray.Phong(ambient=0.25, diffuse=3.0, specular=2.0)
    for normal in ("central", "analytic"):
        assert_allclose(trace(volume, o, d, phong=lamp, normal=normal).color,
                        0.25 * trace(volume, o, d).color, rtol=1e-13)  # fmt: skip


def test_a_ramp_that_is_seen_along_its_gradient_has_the_whole_of_light_and_highlight():
    z = np.broadcast_to(np.linspace(0, 1, 9)[:, None, None], (9, 9, 9)).astype(np.float32)
    volume = ramps.volume(z, ([0.0, 1.0], [0.3, 0.3]))
    o, d = np.array([[4.0, 4.0, 20.0], [4.0, 4.0, -9.0]]), np.array([[0, 0, -1.0], [0, 0, 1.0]])
    got = trace(volume, o, d, phong=leapray.Phong(0.1, 0.6, 0.5, 1000))
    assert_allclose(got.color, 1.2 * trace(volume, o, d).color, rtol=1e-12)


def test_what_cannot_be_lit_is_said():
    volume = ramps.volume(noise().astype(np.float32), KNOTS)
    o, d = rays(3)
    bad = [
        ({"sampling": "exact"}, {}, "post"),
        ({"sampling": "pre"}, {}, "post"),
        ({"normal": "sobel"}, {}, "central and analytic"),
        ({}, {"ambient": -1}, "between 0 and 1e"),
        ({}, {"specular": np.nan}, "between 0 and 1e"),
        ({}, {"power": 0}, "between 1 and 1024; it is 0"),
        ({}, {"light": (0, 0, 0)}, "not all 0"),
        ({}, {"light": (0, np.inf, 0)}, "finite"),
    ]
    for more, lamp, message in bad:
        with pytest.raises(leapray.LeapRayError, match=message):
            trace(volume, o, d, phong=leapray.Phong(**lamp), **more)
