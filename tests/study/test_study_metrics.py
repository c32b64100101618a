# SPDX-License-Identifier: GPL-3.0-or-later
"""The metrics of comparisons, on images whose answers are known."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from addon import arrays
from addon.study import metrics

HEIGHT, WIDTH = 48, 64


def view(perspective=True, pixel=0.01):
    """A camera at (1, 2, 3) that looks along -z; its film has HEIGHT x WIDTH pixels."""
    eye = np.array([1.0, 2.0, 3.0])
    towards = np.eye(4)
    towards[:3, 3] = -eye
    if perspective:  # column = x / (depth * pixel) + width / 2, depth = -z
        film = np.array(
            [
                [1 / pixel, 0, -WIDTH / 2, 0],
                [0, 1 / pixel, -HEIGHT / 2, 0],
                [0, 0, 1, 0],
                [0, 0, -1, 0],
            ]
        )
    else:
        film = np.array(
            [
                [1 / pixel, 0, 0, WIDTH / 2],
                [0, 1 / pixel, 0, HEIGHT / 2],
                [0, 0, 1, 0],
                [0, 0, 0, 1],
            ]
        )
    return metrics.View(perspective, eye, np.array([0.0, 0.0, -1.0]), pixel, film @ towards)


def pixel_rays(camera):
    """Points at depth 1 under the pixels' centres, less the eye."""
    x = (np.arange(WIDTH) + 0.5 - WIDTH / 2) * camera.pixel
    y = (np.arange(HEIGHT) + 0.5 - HEIGHT / 2) * camera.pixel
    return np.stack([*np.meshgrid(x, y), -np.ones((HEIGHT, WIDTH))], axis=-1)


def disc(radius, at=(32, 24)):
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    return ((x + 0.5 - at[0]) ** 2 + (y + 0.5 - at[1]) ** 2 < radius**2).astype(np.int32)


@pytest.mark.parametrize("perspective", [True, False])
def test_a_point_is_drawn_where_its_ray_starts(perspective):
    camera = view(perspective)
    rays = pixel_rays(camera)
    depth = 7.0
    points = camera.eye + (rays * depth if perspective else rays * (1, 1, depth))
    film, depths = camera.film(points.reshape(-1, 3))
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    assert_allclose(film, np.stack([x.ravel(), y.ravel()], axis=1) + 0.5, atol=1e-9)
    assert_allclose(depths, depth)


@pytest.mark.parametrize("perspective", [True, False])
@pytest.mark.parametrize("slope", [0.0, 3.0])
def test_a_plane_moved_along_its_normal_errs_by_that_distance_over_the_footprint(
    perspective, slope
):
    camera = view(perspective)
    rays = pixel_rays(camera)
    normal = arrays.unit(np.array([slope, 0.0, 1.0]))
    start = camera.eye if perspective else camera.eye + rays * (1, 1, 0)
    forward = rays if perspective else np.broadcast_to(camera.forward, rays.shape)

    def depth_of(offset):
        return ((camera.eye + np.array([0, 0, -5.0])) @ normal + offset - start @ normal) / (
            forward @ normal
        )

    depth, moved = depth_of(0.0), 0.002
    position = start + forward * depth[..., None]
    got = metrics.depth_error(
        camera, depth, position, np.broadcast_to(normal, position.shape), depth_of(moved)
    )
    assert_allclose(got, moved / camera.footprint(depth), rtol=1e-9)


def test_the_footprint_is_the_distance_of_neighbouring_points():
    for camera, depth in ((view(True), 9.0), (view(False), 9.0)):
        scale = depth if camera.perspective else 1.0
        x = pixel_rays(camera)[0, :, 0] * scale
        assert_allclose(camera.footprint(depth), np.diff(x))


def test_angles_are_right_when_small_and_when_large():
    turns = np.array([0.0, 1e-6, 0.5, 90.0, 179.9999, 180.0])
    a = np.stack([np.cos(np.radians(turns)), np.sin(np.radians(turns)), 0 * turns], axis=-1)
    assert_allclose(metrics.angle(a * 3, np.array([2.0, 0, 0])), turns, atol=1e-9)


def test_edges_are_the_pixels_with_a_mixed_neighbourhood():
    image = disc(10)
    got = metrics.mixed(image)
    for y in range(HEIGHT):
        for x in range(WIDTH):
            near = image[max(y - 1, 0) : y + 2, max(x - 1, 0) : x + 2]
            assert got[y, x] == (near.min() != near.max())


def test_steps_count_to_the_nearest_pixel_of_another_index():
    image = disc(9, at=(20, 17)) + 2 * disc(6, at=(50, 40))
    got = metrics.steps_to_other(image)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    for at in [(0, 0), (17, 20), (17, 28), (17, 29), (47, 63), (30, 40), (40, 50)]:
        other = image != image[at]
        want = np.maximum(np.abs(y - at[0]), np.abs(x - at[1]))[other].min()
        assert got[at] == want, at
    assert not metrics.steps_to_other(np.zeros((5, 5), int)).any()


def test_a_disc_grown_by_a_pixel_mismatches_at_its_edge_only():
    got = metrics.index_mismatch(disc(10), disc(11))
    assert got["all"]["worst_steps"] == 1
    assert got["all"]["n"] == int(disc(11).sum() - disc(10).sum())
    assert 0 < got["all"]["share_of_edges"] < 1
    assert got["all"]["n_beyond_edges"] == 0


def test_a_lost_pixel_inside_is_found_and_rims_are_told_apart():
    want, got = disc(12), disc(12)
    got[24, 32] = 0  # the centre: 12 steps from the edge, or so
    got[24, 43] = 0  # at the edge
    apart = np.zeros(want.shape, bool)
    apart[24, 43] = True
    known = metrics.index_mismatch(want, got, apart)
    assert known["all"]["n"] == 2
    assert known["sheet_rims"] == {**known["sheet_rims"], "n": 1, "worst_steps": 1}
    assert known["but_sheet_rims"]["n_beyond_edges"] == 1
    assert 8 <= known["but_sheet_rims"]["worst_steps"] <= 12


def test_a_mismatch_without_any_edge_has_no_distance():
    empty = np.zeros((6, 6), int)
    got = metrics.index_mismatch(empty, empty + 1)
    assert got["all"]["worst_steps"] is None
    assert got["all"]["share_of_edges"] is None
    assert metrics.index_mismatch(empty, empty)["all"]["worst_steps"] == 0


def test_rims_hold_the_edges_of_every_image():
    one, two = disc(10), disc(5)
    assert_array_equal(metrics.rims(one, two), metrics.mixed(one) | metrics.mixed(two))
    assert not metrics.rims(one * 0, two * 0).any()


def test_percentiles_per_object_count_only_the_mask():
    index = disc(10)
    values = np.where(index == 1, 2.0, 5.0)
    values[0, 0] = 100.0
    mask = np.ones(index.shape, bool)
    mask[0, 0] = False
    got = metrics.per_object(index, mask, values, {1: "Disc"})
    assert got["Disc"]["max"] == got["Disc"]["median"] == 2.0
    assert got["index 0"]["max"] == 5.0
    assert got["Disc"]["n"] + got["index 0"]["n"] == index.size - 1


def test_light_errors_follow_white():
    want = np.full((4, 5, 3), 0.5)
    got = metrics.light_error(want, want * 1.02, white=2.0)
    assert got["mean_ratio"] == pytest.approx(0.02)
    assert got["rmse"] == pytest.approx(0.005)
    assert got["psnr"] == pytest.approx(46.02, abs=0.01)
    same = metrics.light_error(want, want)
    assert same["rmse"] == 0 and same["psnr"] is None


def test_the_standard_view_knows_srgb():
    got = arrays.srgb(np.array([-1.0, 0.0, 0.001, 0.18, 0.5, 1.0, 7.0]))
    assert_allclose(got, [0, 0, 0.01292, 0.46135, 0.73536, 1, 1], atol=2e-5)


@pytest.mark.parametrize("perspective", [True, False])
def test_a_line_is_drawn_without_gaps_and_cut_to_the_film(perspective):
    camera = view(perspective)
    half_width = 4.0 if perspective else 0.8
    ends = camera.eye + np.array([[-half_width, -0.02, -5.0], [half_width, 0.02, -6.0]])
    got = metrics.on_lines(camera, ends[:1], ends[1:], (HEIGHT, WIDTH))
    columns = np.unique(np.floor(got[:, 0]))
    assert_array_equal(columns, np.arange(WIDTH))
    assert ((got[:, 2] > 5) & (got[:, 2] < 6)).all()


def test_a_line_behind_the_camera_is_not_drawn():
    camera = view()
    behind = camera.eye + np.array([[0.0, 0.0, 2.0]])
    ahead = camera.eye + np.array([[0.0, 0.0, -2.0]])
    assert len(metrics.on_lines(camera, behind, ahead, (HEIGHT, WIDTH))) == 0
