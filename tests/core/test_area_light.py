# SPDX-License-Identifier: GPL-3.0-or-later
"""Rectangles as area lights see them: solid angles, and places drawn by them, against sums in 80
bits."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest

from tests import compiled

EIGHTY = np.longdouble
ANGLE_MIN = 1e-4  # of area.c: smaller ones are sampled by area


@pytest.fixture(scope="module")
def library(tmp_path_factory) -> ctypes.CDLL:
    core = ["render/lights/light_fields", "base/error"]
    return compiled.library(tmp_path_factory.mktemp("area"), "area", core)


def see(library, rect, u=None):
    """Solid angles of rectangles [n, 5], whether they are sampled by these, and places."""

    def pointer(array):
        return array.ctypes.data_as(ctypes.c_void_p)

    rect = np.ascontiguousarray(rect, dtype=float)
    n = len(rect)
    u = np.full((n, 2), 0.5) if u is None else np.ascontiguousarray(u)
    angle, by_angle, place = np.zeros(n), np.zeros(n, np.uint8), np.zeros((n, 2))
    library.area_see(ctypes.c_uint64(n), pointer(rect), pointer(u), pointer(angle),
                     pointer(by_angle), pointer(place))  # fmt: skip
    return angle, by_angle.astype(bool), place


def solid_angle(rect, x1=None):
    """In 80 bits: the sum of the four corners' angles; up to x1 where that is given."""
    x0, x, y0, y1, z = rect.astype(EIGHTY).T
    x = x if x1 is None else x1.astype(EIGHTY)

    def corner(x, y):
        return np.arctan2(x * y, abs(z) * np.sqrt(x * x + y * y + z * z))

    return corner(x, y1) - corner(x0, y1) - corner(x, y0) + corner(x0, y0)


def rectangles(n, seed):
    """Of any shape and place: tiny, huge, edge-on, over the foot and beside it."""
    rng = np.random.default_rng(seed)
    size = 10.0 ** rng.uniform(-4, 4, (n, 2))
    low = -size * rng.choice([rng.random(), 0.0, 1.0, 0.5, 3.0, -2.0], (n, 2))
    z = -(10.0 ** rng.uniform(-5, 3, n))
    scale = 10.0 ** rng.uniform(-6, 6, (n, 1))
    sides = np.stack([low[:, 0], low[:, 0] + size[:, 0], low[:, 1], low[:, 1] + size[:, 1], z])
    return sides.T * scale


def test_the_sum_in_80_bits_is_the_integral():
    """Gauss-Legendre's rule with 64 points along each side, where the rectangle is not too near."""
    at, weight = (x.astype(EIGHTY) for x in np.polynomial.legendre.leggauss(64))
    for rect in ([-1, 1, -1, 1, -2.0], [0.5, 2, -1, 3, -1.5], [3, 4, 5, 9, -1.0]):
        x0, x1, y0, y1, z = map(EIGHTY, rect)
        x = (x0 + x1) / 2 + (x1 - x0) / 2 * at[:, None]
        y = (y0 + y1) / 2 + (y1 - y0) / 2 * at[None]
        cosine = -z / np.sqrt(x * x + y * y + z * z)
        seen = (cosine**3 / z**2 * weight[:, None] * weight).sum() * (x1 - x0) * (y1 - y0) / 4
        assert abs(seen / solid_angle(np.array([rect]))[0] - 1) < 1e-12


def test_solid_angles_are_those_of_the_sum_in_80_bits(library):
    """Each of the four angles is off by some units of 2^-53, whatever their sum."""
    rect = rectangles(100000, 1)
    angle, by_angle, _ = see(library, rect)
    want = solid_angle(rect)
    assert abs(angle - want).max() < 32 * 2**-53
    assert want.max() > 6.28 and (by_angle.mean() > 0.3) and not by_angle.all()
    np.testing.assert_array_equal(by_angle[want > 2 * ANGLE_MIN], True)
    np.testing.assert_array_equal(by_angle[want < ANGLE_MIN / 2], False)


def test_rectangles_that_no_number_holds_are_not_sampled_by_angle(library):
    for rect in ([1e60, 2e60, -1e60, 1e60, -1e60], [1e-90, 2e-90, -1e-90, 1e-90, -1e-90]):
        angle, by_angle, _ = see(library, [rect])
        assert not by_angle[0] or 0 < angle[0] < 2 * np.pi


def test_places_have_the_share_of_the_solid_angle_before_them(library):
    """Up to x lies u[0] of the solid angle; along y, u[1] of the difference of the cosines. As a
    share of the least angle, 1e-4, rounding is some 1e-11; and x is the root of a difference that
    cancels where the rectangle lies far to the side."""
    rect = rectangles(100000, 2)
    u = np.random.default_rng(3).random((len(rect), 2))
    angle, by_angle, place = see(library, rect, u)
    rect, u, angle, place = rect[by_angle], u[by_angle], angle[by_angle], place[by_angle]
    inside = (place >= rect[:, [0, 2]]) & (place <= rect[:, [1, 3]])
    assert inside.all()
    share = solid_angle(rect, place[:, 0]) / solid_angle(rect)
    off = abs(share - u[:, 0])
    assert np.median(off) < 1e-14 and np.quantile(off, 0.99) < 1e-8 and off.max() < 1e-6
    d = np.hypot(place[:, 0].astype(EIGHTY), rect[:, 4])
    low, high, at = (y / np.hypot(y, d) for y in (rect[:, 2], rect[:, 3], place[:, 1]))
    along = (at - low) / (high - low)
    off = abs(along - u[:, 1])
    assert np.median(off) < 1e-14 and np.quantile(off, 0.99) < 1e-8 and off.max() < 1e-6
