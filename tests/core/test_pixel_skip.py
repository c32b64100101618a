# SPDX-License-Identifier: GPL-3.0-or-later
"""Pixels are skipped around rays that miss, and none of them is wrong."""

from __future__ import annotations

import numpy as np
import pytest
import views

import leapray
from addon.study import phantom

SHEARED = np.array([[1, 0.4, 0, 3], [0, 0.5, 0.2, -2], [0.1, 0, 3, 1], [0, 0, 0, 1.0]])
FLAT = np.diag([1.0, 1.0, 30.0, 1.0])
METRICS = dict((o.name, o.choices) for o in leapray.image_method("pixel_skip").options)["metric"]


def image(volume, camera, pixels, skip="safe"):
    return leapray.render_image(f"pixel_skip:skip={skip}", volume, camera, pixels, pixels)


@pytest.mark.parametrize("n", range(1, 11))
def test_no_pixel_of_a_phantom_is_wrong(n):
    rng = np.random.default_rng((3, n))
    volume = leapray.Volume(phantom.phantom(64, n))
    prepared = leapray.prepare(volume, "pixel_skip")
    skipped = []
    for _ in range(5):
        camera = views.parallel(rng, volume, 100)
        found = image(prepared, camera, 100)
        assert views.wrong(found, views.traced(volume, camera, 100, 100)) == 0
        assert 0.05 < found.hit.mean() < 0.95
        assert not (found.hit & found.skipped).any()
        assert found.counters["rays"] == 100 * 100 - found.skipped.sum()
        skipped.append(found.skipped.mean())
    assert np.mean(skipped) > 0.2


@pytest.mark.parametrize("matrix", [SHEARED, FLAT], ids=["sheared", "flat"])
@pytest.mark.parametrize("metric", METRICS)
def test_no_pixel_is_wrong_where_voxels_are_boxes_or_sheared(metric, matrix):
    rng = np.random.default_rng(4)
    volume = leapray.Volume(phantom.phantom(40, 2), object_from_index=matrix)
    spec = f"pixel_skip:metric={metric}"
    prepared = leapray.prepare(volume, spec)
    skipped = 0
    for k in range(6):
        camera = views.parallel(rng, volume, 90, turn=k % 3 != 0)
        found = leapray.render_image(spec, prepared, camera, 90, 90)
        assert views.wrong(found, views.traced(volume, camera, 90, 90)) == 0
        skipped += found.skipped.sum()
    assert skipped > 0.2 * 6 * 90 * 90


def test_the_papers_skip_loses_pixels_and_no_skip_none():
    rng = np.random.default_rng(5)
    volume = leapray.Volume(phantom.phantom(64, 1))
    lost = 0
    for _ in range(5):
        camera = views.parallel(rng, volume, 100)
        want = views.traced(volume, camera, 100, 100)
        lost += views.wrong(image(volume, camera, 100, "paper"), want)
        every = image(volume, camera, 100, "none")
        assert views.wrong(every, want) == 0 and not every.skipped.any()
    assert lost > 20


def test_an_empty_volume_is_one_ray():
    rng = np.random.default_rng(7)
    empty = leapray.Volume(np.zeros((9, 9, 9), np.uint8))
    nothing = image(empty, views.parallel(rng, empty, 90), 90)
    assert nothing.counters["rays"] == 1 and nothing.skipped.sum() == 90 * 90 - 1
    assert np.isinf(nothing.t).all() and not nothing.hit.any()
