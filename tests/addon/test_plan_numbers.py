# SPDX-License-Identifier: GPL-3.0-or-later
"""What the plan computes with: weighted quantiles, inverse maps, angles."""

from __future__ import annotations

from types import SimpleNamespace

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


def test_normals_are_off_by_their_angle_whichever_side_they_tell():
    """Among them the normals of two faces of a box, at a right angle to the last bit."""
    angle = np.array([0.0, 1e-7, 0.3, 1.2, 1.57])
    found = np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=1)
    found = np.concatenate([found, -found, [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]])
    wanted = np.concatenate([angle, angle, [np.pi / 2, np.pi / 2]])
    n = len(found)
    probes = SimpleNamespace(
        surface=np.zeros((n, 3)),
        askew=np.zeros((n, 3)),
        shading_normals=lambda mesh: np.tile([0.0, 0, 1], (n, 1)),
    )
    volume = SimpleNamespace(
        normals=lambda at, ids, threads: found, exact_at=lambda at: np.zeros(len(at), np.bool_)
    )
    mesh = SimpleNamespace(corner_normals=None)
    off = error_metric.normal_errors(volume, mesh, probes, np.zeros(n, np.float32))
    assert np.abs(off - wanted).max() < 1e-6
