# SPDX-License-Identifier: GPL-3.0-or-later
"""Phase functions: what they send where adds up, and samples are spread as it says."""

from __future__ import annotations

import numpy as np
import pytest
from shading import Phase, r_sequence, sphere_grid

from leapray import _abi

VIEW = np.array([0.3, -0.5, 0.8]) / np.linalg.norm([0.3, -0.5, 0.8])
FUNCTIONS = [(_abi.LR_PHASE_RAYLEIGH, 0.0)]
FUNCTIONS += [(_abi.LR_PHASE_HENYEY_GREENSTEIN, g) for g in (0, 1e-9, 1e-4, -0.3, 0.6, 0.9, -0.9)]


@pytest.mark.parametrize(("kind", "g"), FUNCTIONS)
def test_all_that_is_scattered_goes_somewhere(kind, g):
    directions, solid = sphere_grid(1000)
    got = Phase(kind, g, VIEW).eval(directions)
    assert (got["pdf"] > 0).all()
    assert (got["f_cos"] == got["pdf"][:, None]).all()
    assert abs((got["pdf"] * solid).sum() - 1) < 1e-3
    mean = (got["pdf"] * solid * -(directions @ VIEW)).sum()
    assert abs(mean - g) < 1e-3


@pytest.mark.parametrize(("kind", "g"), FUNCTIONS)
def test_samples_are_spread_as_the_density_says(kind, g):
    n, bins = 1 << 16, 40
    phase = Phase(kind, g, VIEW)
    got = phase.sample(r_sequence(n, 2))
    assert np.abs(np.linalg.norm(got["direction"], axis=1) - 1).max() < 1e-12
    assert (got["weight"] == 1).all()
    assert (got["kind"] == _abi.LR_RAY_VOLUME).all()
    assert not got["delta"].any()
    assert np.abs(got["pdf"] / phase.eval(got["direction"])["pdf"] - 1).max() < 1e-6
    cosine = -(got["direction"] @ VIEW)
    counted = np.histogram(cosine, bins, (-1, 1))[0] / n
    fine = np.linspace(-1, 1, bins * 200 + 1)
    middle = (fine[1:] + fine[:-1]) / 2
    side = np.cross(VIEW, [1.0, 0, 0])
    side /= np.linalg.norm(side)
    lights = -middle[:, None] * VIEW + np.sqrt(1 - middle**2)[:, None] * side
    density = phase.eval(lights)["pdf"] * 2 * np.pi * (2 / len(middle))
    assert np.abs(counted - density.reshape(bins, -1).sum(1)).max() < 1e-3
    other = np.cross(VIEW, side)
    turn = np.arctan2(got["direction"] @ other, got["direction"] @ side)
    assert np.abs(np.histogram(turn, 8, (-np.pi, np.pi))[0] / n - 1 / 8).max() < 2e-3
