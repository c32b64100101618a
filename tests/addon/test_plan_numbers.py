# SPDX-License-Identifier: GPL-3.0-or-later
"""What the plan computes with: weighted quantiles, inverse maps."""

from __future__ import annotations

import numpy as np

from addon import arrays
from addon.plan import error_metric


def test_a_quantile_is_the_least_value_that_a_share_of_the_weights_does_not_exceed():
    rng = np.random.default_rng(31)
    for n in (1, 7, 100, 8192):
        for weights in (rng.random(n) + 0.1, 1e-4 ** rng.random(n)):
            values = rng.random(n).round(2)
            for q in (0.5, 0.9, error_metric.QUANTILE):
                found = error_metric.quantile(values, weights, q)
                share = q * weights.sum()
                slack = 1e-12 * weights.sum()  # of the sums, in whatever order
                assert weights[values <= found].sum() >= share - slack
                assert weights[values < found].sum() <= share + slack


def test_maps_are_inverted_whatever_their_scale():
    rng = np.random.default_rng(32)
    linear = rng.normal(size=(50, 3, 3)) * 10.0 ** rng.integers(-60, 60, (50, 1, 1))
    unity = arrays.inverse(linear) @ linear
    worst = np.linalg.cond(linear)[:, None, None]  # which rounding grows by
    assert (np.abs(unity - np.eye(3)) < 1e-14 * worst).all()
