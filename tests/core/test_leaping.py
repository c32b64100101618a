# SPDX-License-Identifier: GPL-3.0-or-later
"""Space leaping: an animation has the bits of frames from scratch, and takes less time."""

from __future__ import annotations

import time

import numpy as np
import pytest
import views

import leapray
from addon.study import phantom

VARIANTS = [entry for entry in leapray.image_variants() if entry.frames]


def sliver_before_a_ball():
    """A ball, and beside it a plate one sample thick that turns in before it, edge on."""
    z, y, x = np.indices((48, 48, 48))
    ball = (x - 24) ** 2 + (y - 24) ** 2 + (z - 24) ** 2 < 12**2
    plate = (y == 42) & (abs(x - 24) < 15) & (abs(z - 24) < 4)
    rod = (x == 5) & (y == 20)
    return leapray.Volume(255 * (ball | plate | rod).astype(np.uint8))


def orbit(volume, angle, pixels, kind="orthographic", far=1.0, clip=0.0):
    middle, extent = views.bounds(volume)
    forward = np.array([np.cos(angle), np.sin(angle), -0.3])
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0, 0, 1.0]) / np.hypot(*forward[:2])
    up = np.cross(right, forward)
    wide = kind == "perspective"
    step = 0.9 * (1 / far if wide else extent) / pixels
    dx, dy = step * right, step * up
    corner = forward * wide - pixels / 2 * (dx + dy)
    eye = middle - far * extent * forward
    return leapray.Camera(kind, eye, forward, corner, dx, dy, clip_start=clip * extent)


def animate(entry, volume, cameras, pixels, threads=1):
    """Wrong pixels against frames from scratch, and the share that was known without a ray."""
    prepared = leapray.prepare(volume, entry)
    before, wrong, skipped = None, 0, 0.0
    for camera in cameras:
        image = leapray.render_image(
            entry, prepared, camera, pixels, pixels, before=before, threads=threads
        )
        wrong += views.wrong(image, views.traced(volume, camera, pixels, pixels))
        before, skipped = image, skipped + image.skipped.mean() / len(cameras)
    return wrong, skipped


@pytest.mark.parametrize("entry", VARIANTS, ids=lambda entry: entry.spec)
@pytest.mark.parametrize("kind", ["orthographic", "perspective"])
@pytest.mark.parametrize("step", [0.05, 0.5, 7.5])
def test_48_frames_with_a_sliver_that_turns_in_are_those_from_scratch(entry, kind, step):
    volume = sliver_before_a_ball()
    first = np.radians(-24 * step)  # the plate is seen edge on half-way
    cameras = [orbit(volume, first + np.radians(step) * k, 48, kind) for k in range(48)]
    wrong, skipped = animate(entry, volume, cameras, 48)
    assert wrong == 0
    assert skipped > 0.05 or step > 5


@pytest.mark.parametrize("entry", VARIANTS, ids=lambda entry: entry.spec)
def test_slivers_that_come_in_are_seen(entry):
    """Frames differ, so that the test above does not compare a picture with itself."""
    volume = sliver_before_a_ball()
    first, last = (
        leapray.render_image(entry, volume, orbit(volume, a, 48), 48, 48) for a in (0.0, 1.2)
    )
    assert (first.cell != last.cell).any(axis=-1).mean() > 0.1


@pytest.mark.parametrize("entry", VARIANTS, ids=lambda entry: entry.spec)
def test_the_camera_may_move_in_any_way(entry):
    rng = np.random.default_rng(1)
    for n in (1, 3, 8):
        volume = leapray.Volume(phantom.phantom(40, n))
        start = orbit(volume, 0.3, 40, "perspective", far=1.2)
        walks = {
            "dolly": [orbit(volume, 0.3, 40, "perspective", far=1.2 - 0.09 * k) for k in range(12)],
            "pan": [
                leapray.Camera(start.projection, start.eye + 0.4 * k * np.asarray(start.dx) * 40,
                               start.forward, start.corner, start.dx, start.dy) for k in range(12)
            ],
            "cuts": [orbit(volume, 0.3 + 0.002 * k, 40, clip=0.02 * k + 0.4) for k in range(12)],
            "shots": [views.parallel(rng, volume, 40) for _ in range(3)]
            + [views.perspective(rng, volume, 40, inside=True) for _ in range(4)],
            "inside": [
                orbit(volume, 0.3 + 0.003 * k, 40, "perspective", far=0.2) for k in range(12)
            ],
        }  # fmt: skip
        for name, cameras in walks.items():
            assert animate(entry, volume, cameras, 40)[0] == 0, (name, n)


def test_voxels_may_be_sheared_and_threads_many():
    shear = np.array([[1, 0.4, 0, 3], [0, 0.5, 0.2, -2], [0.1, 0, 3, 1], [0, 0, 0, 1.0]])
    volume = leapray.Volume(phantom.phantom(32, 2), object_from_index=shear)
    for kind in ("orthographic", "perspective"):
        cameras = [orbit(volume, 0.3 + 0.002 * k, 50, kind) for k in range(16)]
        wrong, skipped = animate(VARIANTS[0], volume, cameras, 50, threads=3)
        assert wrong == 0 and skipped > 0.05


def test_frames_may_change_their_size_and_nothing_need_be_kept():
    volume = sliver_before_a_ball()
    before = None
    for k, pixels in enumerate((50, 31, 64, 64, 20)):
        camera = orbit(volume, 0.3 + 0.002 * k, pixels)
        image = leapray.render_image("leaping", volume, camera, pixels, pixels, before=before)
        assert views.wrong(image, views.traced(volume, camera, pixels, pixels)) == 0
        before = image
    image = leapray.render_image("leaping", volume, camera, 20, 20, before=before, keep=False)
    assert image.empty is None and views.wrong(image, views.traced(volume, camera, 20, 20)) == 0
    with pytest.raises(leapray.LeapRayError, match=r"with keep=True; it is by leaping$"):
        leapray.render_image("leaping", volume, camera, 20, 20, before=image)
    whole = leapray.Volume(np.full((9, 9, 9), 255, np.uint8))
    with pytest.raises(leapray.LeapRayError, match="the frame before is of another volume"):
        leapray.render_image("leaping", whole, camera, 20, 20, before=before)
    other = leapray.render_image("leaping:walk=cells", volume, camera, 20, 20)
    with pytest.raises(
        leapray.LeapRayError, match="by leaping, with keep=True; it is by leaping:walk"
    ):
        leapray.render_image("leaping", volume, camera, 20, 20, before=other)


def test_strips_of_frames_keep_what_whole_frames_do():
    volume = sliver_before_a_ball()
    prepared = leapray.prepare(volume, "leaping")
    before, skipped = None, 0
    for k in range(8):
        camera, kept = orbit(volume, 0.3 + 0.002 * k, 40), np.zeros((40, 40, 2))
        whole = leapray.render_image("leaping", prepared, camera, 40, 40, before=before)
        for y in (0, 10, 20, 30):
            part = leapray.render_image(
                "leaping", prepared, camera, 40, 40,
                window=(0, y, 40, 10), before=before, keep=kept,
            )  # fmt: skip
            assert np.array_equal(part.t, whole.t[y : y + 10])
            skipped += part.skipped.sum()
        np.testing.assert_allclose(kept, whole.empty, rtol=1e-9, atol=1e-9)
        before = part  # of which `empty` is that of the whole film
    assert skipped > 100
    alone = leapray.render_image("leaping", prepared, camera, 40, 40, window=(0, 0, 40, 5))
    assert alone.empty is None
    with pytest.raises(leapray.LeapRayError, match=r"float64 \(40, 40, 2\) without gaps"):
        leapray.render_image("leaping", prepared, camera, 40, 40, keep=np.zeros((40, 2)))


@pytest.mark.slow
@pytest.mark.alone
def test_48_frames_take_half_the_time_of_the_same_walk_from_scratch():
    volume = leapray.Volume(phantom.phantom(256, 1))
    entry = leapray.image_method("leaping:walk=cells")
    prepared = leapray.prepare(volume, entry)
    before, spent = None, np.zeros(2)
    for k in range(48):
        camera = orbit(volume, 0.3 + np.radians(0.25) * k, 200, far=2.0)
        began = time.process_time()
        leapray.render_image(entry, prepared, camera, 200, 200, keep=False)
        between = time.process_time()
        before = leapray.render_image(entry, prepared, camera, 200, 200, before=before)
        spent += between - began, time.process_time() - between
    assert spent[0] > 2 * spent[1]
