# SPDX-License-Identifier: GPL-3.0-or-later
"""Distance transforms against brute force and against scipy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

import leapray


def chamfer(differences):
    a, b, c = np.moveaxis(np.sort(differences, axis=-1), -1, 0)
    return a + b + 3 * c  # 5 for every corner step, 4 for every edge step that is left, then 3


BRUTE = {
    "chessboard": lambda differences: differences.max(axis=-1),
    "cityblock": lambda differences: differences.sum(axis=-1),
    "chamfer345": chamfer,
    "euclid": lambda differences: np.sqrt((differences.astype(np.float64) ** 2).sum(axis=-1)),
}


def test_every_metric_has_a_brute_force():
    assert set(BRUTE) == set(leapray.METRICS)


@pytest.mark.parametrize("metric", BRUTE)
@pytest.mark.parametrize("shape", [(32, 32, 32), (5, 40, 1), (1, 1, 7), (3, 17, 60)])
@pytest.mark.parametrize("fraction", [0.0, 0.001, 0.01])
def test_distances_agree_with_brute_force(metric, shape, fraction):
    rng = np.random.default_rng(12)
    cells = rng.random(shape) < fraction
    cells.flat[rng.integers(cells.size)] = True
    want = np.full(shape, np.inf)
    every = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1)
    for marked in np.argwhere(cells):
        np.minimum(want, BRUTE[metric](np.abs(every - marked)), out=want)
    np.testing.assert_array_equal(leapray.distance(cells, metric), want.astype(np.float32))


@pytest.mark.parametrize("metric", BRUTE)
def test_nothing_is_infinitely_far(metric):
    dist = leapray.distance(np.zeros((3, 4, 5), bool), metric)
    assert (dist == (np.inf if metric == "euclid" else 255)).all()


@pytest.mark.parametrize("metric", ["chessboard", "cityblock", "chamfer345"])
def test_far_cells_are_capped_and_not_wrapped(metric):
    cells = np.zeros((1, 3, 700), bool)
    cells[0, 0, 0] = True
    dist = leapray.distance(cells, metric)[0, 0].astype(int)
    step = 3 if metric == "chamfer345" else 1
    np.testing.assert_array_equal(dist, np.minimum(np.arange(700) * step, 255))


@pytest.mark.parametrize("metric", BRUTE)
def test_distances_agree_with_scipy(metric):
    cells = np.random.default_rng(13).random((60, 71, 83)) < 0.0005
    free = ~cells
    if metric == "euclid":
        want = ndimage.distance_transform_edt(free).astype(np.float32)
    else:
        kind = "chessboard" if metric != "cityblock" else "taxicab"
        want = ndimage.distance_transform_cdt(free, kind)
    if metric == "chamfer345":  # 3-4-5 is twice the chessboard's distance more than the city's
        least = ndimage.distance_transform_cdt(free, "taxicab") + 2 * want
        dist = leapray.distance(cells, metric)
        assert (dist >= least).all() and (
            dist <= 3.0 * ndimage.distance_transform_edt(free) * 1.11
        ).all()
    else:
        np.testing.assert_array_equal(leapray.distance(cells, metric), want)


@pytest.mark.parametrize("metric", BRUTE)
@pytest.mark.parametrize(
    "shape", [(70, 95, 40), (1, 300, 33), (200, 1, 90), (33, 32, 1), (2, 2, 2)]
)
def test_threads_change_no_bit(metric, shape):
    rng = np.random.default_rng(14)
    cells = rng.random(shape) < 0.002
    cells.flat[rng.integers(cells.size)] = True
    one = leapray.distance(cells, metric, threads=1)
    for threads in (2, 5):
        np.testing.assert_array_equal(leapray.distance(cells, metric, threads=threads), one)


@pytest.mark.parametrize("metric", BRUTE)
def test_stopped_threads_end(metric):
    watch = leapray.Watch()
    watch.stop()
    with pytest.raises(leapray.Stopped):
        leapray.distance(np.ones((40, 40, 40), bool), metric, threads=3, watch=watch)


def test_an_unknown_metric_and_a_wrong_shape_are_answered_by_a_sentence():
    with pytest.raises(leapray.LeapRayError, match="unknown metric 'x'; there are chessboard"):
        leapray.distance(np.zeros((2, 2, 2), bool), "x")
    with pytest.raises(leapray.LeapRayError, match=r"shape \(nz, ny, nx\); it is \(2, 2\)"):
        leapray.distance(np.zeros((2, 2), bool), "euclid")
    with pytest.raises(leapray.LeapRayError, match="limited to 26754 cells a side"):
        leapray.distance(np.zeros((1, 1, 26755), bool), "euclid")
