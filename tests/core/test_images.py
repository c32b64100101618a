# SPDX-License-Identifier: GPL-3.0-or-later
"""Whole-image methods: those that are exact have the bits of traced rays, and all refuse alike."""

from __future__ import annotations

import numpy as np
import pytest
import views
from numpy.testing import assert_array_equal

import leapray
from addon.study import phantom

METHODS = leapray.image_methods()
EXACT = [entry for entry in leapray.image_variants() if entry.exact]
WIDE = [entry for entry in EXACT if entry.perspective]
SHEARED = np.array([[1, 0.4, 0, 3], [0, 0.5, 0.2, -2], [0.1, 0, 3, 1], [0, 0, 0, 1.0]])
LIGHT = leapray.Light("sun", (1.0, 1.0, 1.0), direction=(0.0, 0.6, 0.8))


def spec_of(entry):
    return entry.spec


def name_of(entry):
    return entry.name


def noise(shape, share, seed=0):
    """Samples of which so many, one in each of some places, are objects as thin as they come."""
    return (np.random.default_rng(seed).random(shape) < share).astype(np.uint8) * 255


def views_of_a_phantom(entry, n, side, count, pixels, seed):
    """Images that are held against traced rays, parallel and in perspective in turns."""
    rng = np.random.default_rng(seed)
    volume = leapray.Volume(phantom.phantom(side, n))
    prepared = leapray.prepare(volume, entry)
    for k in range(count):
        look = views.perspective if entry.perspective and k % 2 else views.parallel
        camera = look(rng, volume, pixels)
        image = leapray.render_image(entry, prepared, camera, pixels, pixels)
        assert views.wrong(image, views.traced(volume, camera, pixels, pixels)) == 0
        yield image


@pytest.mark.parametrize("entry", EXACT, ids=spec_of)
@pytest.mark.parametrize("n", [1, 3, pytest.param(2, marks=pytest.mark.slow)])
def test_the_exact_have_the_bits_of_traced_rays(entry, n):
    """More views are in the slow test below."""
    for image in views_of_a_phantom(entry, n, 32, 6, 40, n):
        assert 0.02 < image.hit.mean() < 0.98


@pytest.mark.slow
@pytest.mark.parametrize("entry", EXACT, ids=spec_of)
@pytest.mark.parametrize("n", range(1, 11))
def test_the_exact_have_the_bits_of_traced_rays_in_50_views_of_ten_phantoms(entry, n):
    assert len(list(views_of_a_phantom(entry, n, 64, 50, 50, (3, n)))) == 50


@pytest.mark.parametrize("entry", EXACT, ids=spec_of)
def test_no_order_of_planes_that_are_crossed_together_is_lost(entry):
    """Every ray goes through edges and corners of cells, half of them of object cells."""
    if entry.name == "pixel_skip":
        pytest.skip("its spheres choose another of the cells that the ray touches")
    rng = np.random.default_rng(4)
    hits = 0
    for k in range(24):
        volume = leapray.Volume(noise((12, 12, 12), 0.004 * (k % 3 + 1), k))
        camera = views.on_lattice(rng, volume, 60)
        image = leapray.render_image(entry, volume, camera, 60, 60)
        assert views.wrong(image, views.traced(volume, camera, 60, 60)) == 0
        hits += image.hit.sum()
    assert hits > 5000


@pytest.mark.parametrize("entry", WIDE, ids=spec_of)
def test_no_order_is_lost_in_perspective(entry):
    rng = np.random.default_rng(5)
    for k in range(12):
        volume = leapray.Volume(noise((12, 12, 12), 0.01, k))
        camera = views.on_lattice(rng, volume, 60, "perspective")
        image = leapray.render_image(entry, volume, camera, 60, 60)
        assert views.wrong(image, views.traced(volume, camera, 60, 60)) == 0


@pytest.mark.parametrize("entry", EXACT, ids=spec_of)
@pytest.mark.parametrize("pixels", [5, 300])
def test_cells_may_be_smaller_than_pixels_or_larger(entry, pixels):
    """Of 48^3 cells a film of 5 x 5 pixels sees a few, and one of 300 x 300 every one often."""
    rng = np.random.default_rng(6)
    volume = leapray.Volume(noise((48, 48, 48), 0.002))
    for _ in range(3):
        camera = views.parallel(rng, volume, pixels)
        image = leapray.render_image(entry, volume, camera, pixels, pixels)
        assert views.wrong(image, views.traced(volume, camera, pixels, pixels)) == 0


@pytest.mark.parametrize("entry", EXACT, ids=spec_of)
def test_voxels_may_be_sheared(entry):
    rng = np.random.default_rng(7)
    samples = phantom.phantom(32, 2)[:, :20]
    volume = leapray.Volume(samples, object_from_index=SHEARED)
    for k in range(6):
        camera = views.parallel(rng, volume, 50, turn=k % 3 != 0)
        image = leapray.render_image(entry, volume, camera, 50, 50)
        assert views.wrong(image, views.traced(volume, camera, 50, 50)) == 0
        assert image.hit.any()


@pytest.mark.parametrize("entry", EXACT, ids=spec_of)
def test_what_the_camera_cuts_off_is_not_seen(entry):
    rng = np.random.default_rng(8)
    volume = leapray.Volume(phantom.phantom(48, 2))
    begun_inside = 0
    for start, end in ((0.0, 2.0), (1.7, 9.0), (1.9, 2.1), (3.0, 4.0), (0.0, 1.9)):
        for _ in range(3):
            camera = views.parallel(rng, volume, 60)
            scale = np.linalg.norm(np.full(3, 49.0)) / np.linalg.norm(camera.forward)
            camera = views.clipped(camera, start * scale, end * scale)
            image = leapray.render_image(entry, volume, camera, 60, 60)
            assert views.wrong(image, views.traced(volume, camera, 60, 60)) == 0
            begun_inside += (image.t == camera.clip_start).sum()
    assert begun_inside > 500


@pytest.mark.parametrize("entry", WIDE, ids=spec_of)
@pytest.mark.parametrize("share", [0.001, 0.02])
def test_the_eye_may_be_anywhere_in_the_volume(entry, share):
    rng = np.random.default_rng(9)
    volume = leapray.Volume(noise((40, 40, 40), share))
    prepared = leapray.prepare(volume, entry)
    for k in range(20):
        camera = views.perspective(rng, volume, 40, inside=True)
        if k % 2:
            camera = views.clipped(camera, 3.0, 25.0)
        if k % 5 == 0:
            object.__setattr__(camera, "eye", np.round(camera.eye))
        image = leapray.render_image(entry, prepared, camera, 40, 40)
        assert views.wrong(image, views.traced(volume, camera, 40, 40)) == 0


@pytest.mark.parametrize("entry", EXACT, ids=spec_of)
def test_a_sheet_has_its_touched_cells_alone(entry):
    rng = np.random.default_rng(10)
    field = rng.random((20, 20, 20)).astype(np.float32)
    touched = np.zeros(field.shape, bool)
    touched[rng.integers(2, 18, 60), rng.integers(2, 18, 60), rng.integers(2, 18, 60)] = True
    volume = leapray.Volume(field, sheet=True, touched=touched)
    for _ in range(4):
        camera = views.parallel(rng, volume, 60)
        image = leapray.render_image(entry, volume, camera, 60, 60)
        assert views.wrong(image, views.traced(volume, camera, 60, 60)) == 0
        assert image.hit.any()


@pytest.mark.parametrize("entry", leapray.image_variants(), ids=spec_of)
def test_threads_change_no_bit_and_an_empty_volume_is_no_hit(entry):
    rng = np.random.default_rng(11)
    volume = leapray.Volume(phantom.phantom(48, 3))
    camera = views.parallel(rng, volume, 90)
    prepared = leapray.prepare(volume, entry)
    one = leapray.render_image(entry, prepared, camera, 120, 90)
    many = leapray.render_image(entry, prepared, camera, 120, 90, threads=4)
    same = entry.exact or entry.name != "pixel_skip"  # which loses other pixels in other bands
    for part in ("t", "cell", "hit", "shade") if same else ():
        assert_array_equal(getattr(one, part), getattr(many, part))
    assert one.hit.any() and one.counters["hits"] >= one.hit.sum() > 0
    nothing = leapray.Volume(np.zeros((9, 9, 9), np.uint8))
    image = leapray.render_image(entry, nothing, camera, 12, 9)
    assert np.isinf(image.t).all() and not image.hit.any() and not image.shade.any()


@pytest.mark.parametrize("entry", METHODS, ids=name_of)
def test_shades_fall_with_depth_where_there_are_no_lights(entry):
    rng = np.random.default_rng(12)
    volume = leapray.Volume(phantom.phantom(40, 2))
    camera = views.parallel(rng, volume, 60)
    image = leapray.render_image(entry, volume, camera, 60, 60)
    assert image.shade.shape == (60, 60, 3) and not image.shade[~image.hit].any()
    if entry.lights:
        assert image.normal.shape == (60, 60, 3)
        return
    assert image.normal is None
    corners = np.array(np.meshgrid(*[(-1.0, 40.0)] * 3)).reshape(3, -1).T  # its corners are objects
    depth = (corners - camera.eye) @ camera.forward / np.dot(camera.forward, camera.forward)
    want = (depth.max() - image.t) / (depth.max() - depth.min())
    np.testing.assert_allclose(image.shade[image.hit, 0], want[image.hit], atol=1e-12)
    assert np.ptp(image.shade[image.hit]) > 0.2


def test_the_misses_of_an_image_are_counted():
    volume = leapray.Volume(phantom.phantom(40, 2))
    camera = views.parallel(np.random.default_rng(13), volume, 60)
    exact = leapray.render_image("octree_projection", volume, camera, 60, 60)
    assert exact.misses(exact) == leapray.Misses(0, 0, 0, 0, int(exact.hit.sum()))
    other = leapray.render_image("octree_projection", volume, camera, 60, 60)
    (y, x), (v, u) = np.argwhere(exact.hit)[0], np.argwhere(~exact.hit)[0]
    other.hit[y, x], other.hit[v, u] = False, True
    y, x = np.argwhere(exact.hit)[-1]
    other.cell[y, x, 1] += 3
    assert other.misses(exact) == leapray.Misses(1, 1, 1, 3, int(exact.hit.sum()))
    small = leapray.render_image("octree_projection", volume, camera, 9, 9)
    with pytest.raises(leapray.LeapRayError, match="60 x 60 pixels by an exact method is needed"):
        other.misses(small)


# ---- refusals ----------------------------------------------------------------------


@pytest.fixture(scope="module")
def ones():
    return leapray.Volume(np.full((4, 4, 4), 255, np.uint8))


def plain(**changed):
    given = {
        "projection": "orthographic", "eye": (0, 0, -9), "forward": (0, 0, 1),
        "corner": (-2, -2, 0), "dx": (1, 0, 0), "dy": (0, 1, 0),
    } | changed  # fmt: skip
    return leapray.Camera(**given)


@pytest.mark.parametrize("entry", METHODS, ids=name_of)
@pytest.mark.parametrize(
    ("camera", "words"),
    [
        (plain(dx=(0, 0, 1)), "must span a film that its rays cross"),
        (plain(dx=(0, 2, 0)), "must span a film that its rays cross"),
        (plain(dx=(1e300, 0, 0), dy=(0, 1e300, 0)), "must span a film that its rays cross"),
        (plain(forward=(0, 0, 0)), "must span a film that its rays cross"),
        (plain(eye=(0, np.nan, 0)), "must span a film that its rays cross"),
        (plain(clip_start=3.0, clip_end=1.0), "clips from 3 to 1"),
        (plain(clip_start=np.nan), "finite depth"),
        (plain(projection="round"), "unknown projection 'round'"),
        (plain(eye=(0, 0)), "the camera's eye must have shape"),
    ],
)
def test_wrong_cameras_are_answered_by_a_sentence(entry, camera, words, ones):
    with pytest.raises(leapray.LeapRayError, match=words):
        leapray.render_image(entry, ones, camera, 10, 10)


@pytest.mark.parametrize("entry", METHODS, ids=name_of)
def test_wrong_arguments_are_answered_by_a_sentence(entry, ones):
    with pytest.raises(leapray.LeapRayError, match="an image needs pixels; there are 0 x 10"):
        leapray.render_image(entry, ones, plain(), 0, 10)
    with pytest.raises(leapray.LeapRayError, match="threads must be"):
        leapray.render_image(entry, ones, plain(), 10, 10, threads=-1)
    with pytest.raises(leapray.LeapRayError, match="of type ndarray"):
        leapray.render_image(entry, np.zeros(3), plain(), 10, 10)
    seen = plain(projection="perspective", corner=(-2, -2, 1), clip_start=-1.0)
    words = "sees nothing behind it" if entry.perspective else "the camera must be orthographic"
    with pytest.raises(leapray.LeapRayError, match=words):
        leapray.render_image(entry, ones, seen, 10, 10)
    rectilinear = leapray.Volume(np.ones((4, 4, 4), np.uint8), planes=[np.array([0, 1, 3, 7])] * 3)
    with pytest.raises(leapray.LeapRayError, match="this volume is rectilinear"):
        leapray.prepare(rectilinear, entry)
    grid = leapray.ScalarGrid("fog", np.ones((4, 4, 4), np.float32), np.eye(4))
    look = leapray.TransferFunction([0.0, 2.0], [1.0, 1.0])
    with pytest.raises(leapray.LeapRayError, match="transfer function in the place of a surface"):
        leapray.prepare(leapray.visible_volume(grid, look), entry)
    other = next(one for one in leapray.image_variants() if one.spec != entry.spec)
    with pytest.raises(leapray.LeapRayError, match="is not for"):
        leapray.render_image(entry, leapray.prepare(ones, other), plain(), 10, 10)
    if not entry.frames:
        image = leapray.render_image(entry, ones, plain(), 10, 10)
        with pytest.raises(leapray.LeapRayError, match="the frame before must be by"):
            leapray.render_image(entry, ones, plain(), 10, 10, before=image)


def test_unknown_names_are_answered_by_a_list(ones):
    with pytest.raises(leapray.LeapRayError, match="unknown image method 'x'; there"):
        leapray.prepare(ones, "x")
    with pytest.raises(leapray.LeapRayError, match=r"octree_projection has order=front\|back, not"):
        leapray.prepare(ones, "octree_projection:order=up")


@pytest.mark.parametrize("entry", METHODS, ids=name_of)
def test_the_stop_word_is_heard(entry, ones):
    watch = leapray.Watch()
    watch.stop()
    prepared = leapray.prepare(ones, entry)
    with pytest.raises(leapray.Stopped):
        leapray.prepare(ones, entry, watch=watch)
    with pytest.raises(leapray.Stopped):
        leapray.render_image(entry, prepared, plain(), 10, 10, watch=watch)


@pytest.mark.parametrize("entry", EXACT, ids=spec_of)
def test_windows_are_parts_of_the_whole_image(entry):
    rng = np.random.default_rng(12)
    volume = leapray.Volume(phantom.phantom(32, 2))
    prepared = leapray.prepare(volume, entry)
    camera = views.parallel(rng, volume, 60)
    whole = leapray.render_image(entry, prepared, camera, 60, 50)
    for x, y, w, h in ((0, 0, 60, 7), (0, 31, 60, 19), (11, 5, 30, 40), (59, 49, 1, 1)):
        part = leapray.render_image(entry, prepared, camera, 60, 50, window=(x, y, w, h))
        cut = np.s_[y : y + h, x : x + w]
        for name in ("t", "cell", "hit", "shade"):
            assert_array_equal(getattr(part, name), getattr(whole, name)[cut], name)
        rays = leapray.camera_rays(camera, 60, 50, window=(x, y, w, h))
        for mine, all_ in zip(rays, leapray.camera_rays(camera, 60, 50), strict=True):
            assert_array_equal(mine, all_.reshape(50, 60, 3)[cut].reshape(-1, 3))
    assert whole.hit[5:45, 11:41].any()


@pytest.mark.parametrize("window", [(0, 0, 61, 1), (-1, 0, 5, 5), (0, 0, 0, 5), (50, 45, 5, 6)])
def test_windows_beyond_the_image_are_refused(window):
    volume = leapray.Volume(noise((8, 8, 8), 0.1))
    camera = views.parallel(np.random.default_rng(1), volume, 60)
    with pytest.raises(leapray.LeapRayError, match="is no part of 60 x 50 pixels"):
        leapray.render_image(METHODS[0], volume, camera, 60, 50, window=window)
    with pytest.raises(leapray.LeapRayError, match="is no part of 60 x 50 pixels"):
        leapray.camera_rays(camera, 60, 50, window=window)
    with pytest.raises(leapray.LeapRayError, match=r"x, y, width and height; it has shape \(2,\)"):
        leapray.camera_rays(camera, 60, 50, window=window[:2])
