# SPDX-License-Identifier: GPL-3.0-or-later
"""Images of first cells: pixels are skipped, and none of them is wrong."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import leapray
from addon.study import phantom

EXACT = next(entry for entry in leapray.traversers() if entry.exact)
SHEARED = np.array([[1, 0.4, 0, 3], [0, 0.5, 0.2, -2], [0.1, 0, 3, 1], [0, 0, 0, 1.0]])
FLAT = np.diag([1.0, 1.0, 30.0, 1.0])


def view(rng, volume, size, pixels, turn=True):
    """An orthographic camera around a volume of that size, from anywhere; its film may be askew."""
    matrix = volume.info.object_from_index
    corners = np.stack(np.meshgrid(*[(-1.0, size)] * 3), axis=-1).reshape(-1, 3)
    corners = corners @ matrix[:3, :3].T + matrix[:3, 3]
    middle, extent = corners.mean(axis=0), np.linalg.norm(np.ptp(corners, axis=0))
    forward = rng.normal(size=3) if turn else np.eye(3)[rng.integers(3)] * rng.choice([-1, 1])
    right, up = phantom.frame(forward / np.linalg.norm(forward) + 1e-9)
    step = extent * 1.05 / pixels
    dx = step * right
    dy = step * (up + 0.3 * right * rng.integers(2))
    corner = -pixels / 2 * (dx + dy)
    eye = middle - 2 * extent * forward / np.linalg.norm(forward)
    return leapray.Camera("orthographic", eye, forward, corner, dx, dy)


def reference(volume, camera, width, height):
    """The same image by an exact traverser, ray by ray."""
    x, y = np.arange(width) + 0.5, np.arange(height) + 0.5
    film = x[None, :, None] * camera.dx + y[:, None, None] * camera.dy
    origins = (np.asarray(camera.eye) + camera.corner + film).reshape(-1, 3)
    directions = np.broadcast_to(camera.forward, origins.shape)
    return leapray.trace(
        leapray.build(volume, EXACT),
        origins,
        directions,
        t_min=camera.clip_start,
        t_max=camera.clip_end,
        mode="binary",
    )


def wrong(found, want):
    """Pixels that hit where they should not, miss where they should not, or hit another cell."""
    hit = np.isfinite(want.t)
    at_fault = hit != found.hit.ravel()
    at_fault |= hit & (found.cell.reshape(-1, 3) != want.cell).any(axis=1)
    return int(at_fault.sum())


@pytest.mark.parametrize("n", range(1, 11))
def test_no_pixel_of_a_phantom_is_wrong(n):
    rng = np.random.default_rng((3, n))
    volume = leapray.Volume(phantom.phantom(64, n))
    clearance = leapray.Clearance(volume)
    skipped = []
    for _ in range(5):
        camera = view(rng, volume, 64, 100)
        found = leapray.first_cells(clearance, camera, 100, 100)
        assert wrong(found, reference(volume, camera, 100, 100)) == 0
        assert 0.05 < found.hit.mean() < 0.95
        assert not (found.hit & found.skipped).any()
        assert found.counters["rays"] == 100 * 100 - found.skipped.sum()
        skipped.append(found.skipped.mean())
    assert np.mean(skipped) > 0.2


@pytest.mark.parametrize("matrix", [SHEARED, FLAT], ids=["sheared", "flat"])
@pytest.mark.parametrize("metric", leapray.METRICS)
def test_no_pixel_is_wrong_where_voxels_are_boxes_or_sheared(metric, matrix):
    rng = np.random.default_rng(4)
    volume = leapray.Volume(phantom.phantom(40, 2), object_from_index=matrix)
    clearance = leapray.Clearance(volume, metric)
    skipped = 0
    for k in range(6):
        camera = view(rng, volume, 40, 90, turn=k % 3 != 0)
        found = leapray.first_cells(clearance, camera, 90, 90)
        assert wrong(found, reference(volume, camera, 90, 90)) == 0
        skipped += found.skipped.sum()
    assert skipped > 0.2 * 6 * 90 * 90


def test_the_papers_skip_loses_pixels_and_no_skip_none():
    rng = np.random.default_rng(5)
    volume = leapray.Volume(phantom.phantom(64, 1))
    clearance = leapray.Clearance(volume)
    lost = 0
    for _ in range(5):
        camera = view(rng, volume, 64, 100)
        want = reference(volume, camera, 100, 100)
        lost += wrong(leapray.first_cells(clearance, camera, 100, 100, skip="paper"), want)
        every = leapray.first_cells(clearance, camera, 100, 100, skip="none")
        assert wrong(every, want) == 0 and not every.skipped.any()
    assert lost > 20


def test_what_the_camera_cuts_off_skips_nobody():
    rng = np.random.default_rng(6)
    volume = leapray.Volume(phantom.phantom(48, 2))
    clearance = leapray.Clearance(volume)
    cut = 0
    for start, end in ((0.0, 2.0), (1.7, 9.0), (1.9, 2.1), (3.0, 4.0)):
        for _ in range(4):
            camera = view(rng, volume, 48, 80)
            scale = np.linalg.norm(np.full(3, 49.0)) / np.linalg.norm(camera.forward)
            camera = leapray.Camera(
                *(getattr(camera, name) for name in ("projection", "eye", "forward")),
                *(getattr(camera, name) for name in ("corner", "dx", "dy")),
                clip_start=start * scale,
                clip_end=end * scale,
            )
            found = leapray.first_cells(clearance, camera, 80, 80)
            want = reference(volume, camera, 80, 80)
            assert wrong(found, want) == 0
            np.testing.assert_allclose(found.t.ravel(), want.t, rtol=1e-13)
            cut += int(np.isfinite(want.t).sum())
    assert cut > 1000


def test_threads_find_the_same_and_an_empty_volume_is_one_ray():
    rng = np.random.default_rng(7)
    volume = leapray.Volume(phantom.phantom(48, 3))
    camera = view(rng, volume, 48, 90)
    clearance = leapray.Clearance(volume)
    one = leapray.first_cells(clearance, camera, 120, 90)
    many = leapray.first_cells(clearance, camera, 120, 90, threads=4)
    assert_array_equal(one.t, many.t)
    assert_array_equal(one.cell, many.cell)
    empty = leapray.Clearance(leapray.Volume(np.zeros((9, 9, 9), np.uint8)))
    nothing = leapray.first_cells(empty, camera, 120, 90)
    assert nothing.counters["rays"] == 1 and nothing.skipped.sum() == 120 * 90 - 1
    assert np.isinf(nothing.t).all() and not nothing.hit.any()


def test_a_perspective_camera_and_a_flat_film_are_answered_by_a_sentence():
    clearance = leapray.Clearance(leapray.Volume(np.ones((4, 4, 4), np.uint8)))
    eye, forward, corner = (0, 0, -9), (0, 0, 1), (-2, -2, 0)
    seen = leapray.Camera("perspective", eye, forward, (-2, -2, 1), (0.1, 0, 0), (0, 0.1, 0))
    with pytest.raises(leapray.LeapRayError, match="the camera must be orthographic"):
        leapray.first_cells(clearance, seen, 10, 10)
    for dx, dy in (((0, 0, 1), (0, 1, 0)), ((1, 0, 0), (2, 0, 0.5))):
        flat = leapray.Camera("orthographic", eye, forward, corner, dx, dy)
        with pytest.raises(leapray.LeapRayError, match="must span a film that its rays cross"):
            leapray.first_cells(clearance, flat, 10, 10)
    good = leapray.Camera("orthographic", eye, forward, corner, (1, 0, 0), (0, 1, 0))
    with pytest.raises(leapray.LeapRayError, match="unknown skip 'x'; there are safe"):
        leapray.first_cells(clearance, good, 10, 10, skip="x")
    with pytest.raises(leapray.LeapRayError, match="an image needs pixels; there are 0 x 10"):
        leapray.first_cells(clearance, good, 0, 10)
    watch = leapray.Watch()
    watch.stop()
    with pytest.raises(leapray.Stopped):
        leapray.first_cells(clearance, good, 10, 10, watch=watch)
