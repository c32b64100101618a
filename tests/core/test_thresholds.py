# SPDX-License-Identifier: GPL-3.0-or-later
"""Claims about histograms of scalar grids, and about the threshold that is proposed first."""

import threading

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import leapray
from leapray import LeapRayError, Leaves, ScalarGrid

RNG = np.random.default_rng


def grid_of(values, **members) -> ScalarGrid:
    """A grid of those numbers in any order, as a lattice of one plane for each thousand."""
    n = len(values) // 1000 * 1000
    shuffled = RNG(0).permutation(values)[:n]
    return ScalarGrid("made", shuffled.reshape(-1, 10, 100), np.eye(4), **members)


# ---- histograms --------------------------------------------------------------------


@pytest.mark.parametrize("dtype", ["u1", "i1", "u2", "i2", "i4", "u8", "f2", "f4", "f8"])
@pytest.mark.parametrize("bins", [1, 7, 256])
def test_a_histogram_counts_what_numpy_counts(dtype, bins):
    values = RNG(1).normal(20, 30, 24000)
    stored = (
        np.abs(values).astype(dtype) if dtype[0] == "u" else values.clip(-120, 120).astype(dtype)
    )
    grid = grid_of(stored, scale=0.5, offset=-3.0)
    got = leapray.histogram(grid, bins)
    assert len(got.counts) <= bins and got.counts.sum() == stored.size and got.n_none == 0
    edges = (got.edges + 3) / 0.5
    want, _ = np.histogram(stored.astype(np.float64), edges)
    # a sample on an edge may go either way by rounding; of half floats several have one value
    assert np.abs(got.counts - want).max() <= {"f2": 8, "f4": 2, "f8": 2}.get(dtype, 0)
    assert_allclose(np.diff(got.edges), np.diff(got.edges)[0])


def test_bins_of_whole_numbers_hold_as_many_each():
    got = leapray.histogram(grid_of(np.arange(10000, dtype=np.int16) % 1000), 256)
    assert len(got.counts) == 250 and (got.counts == 40).all()
    assert got.edges[0] == -0.5 and got.edges[-1] == 999.5


def test_a_falling_scale_turns_the_histogram_round():
    stored = RNG(2).integers(0, 100, 5000).astype(np.uint8)
    got = leapray.histogram(grid_of(stored, scale=-2.0, offset=10.0))
    assert (np.diff(got.edges) > 0).all()
    want, _ = np.histogram(10 - 2.0 * stored, got.edges)
    assert_array_equal(got.counts, want)


@pytest.mark.parametrize("dtype", ["i2", "i4", "f4"])
def test_what_means_none_is_left_out(dtype):
    stored = RNG(3).integers(0, 100, 6000).astype(dtype)
    stored[:1500] = -2000
    if dtype == "f4":
        stored[1500:2000], stored[2000:2010], stored[2010:2020] = np.nan, np.inf, -np.inf
    got = leapray.histogram(grid_of(stored, no_data=-2000.0))
    n = np.count_nonzero(np.isfinite(stored) & (stored != -2000))
    assert got.counts.sum() == n and got.n_none == len(stored) - n
    assert got.edges[0] > -1


def test_limits_leave_values_out():
    stored = np.arange(1000, dtype=np.int16).repeat(3)
    for grid in (grid_of(stored), grid_of(stored.astype(np.float32))):
        got = leapray.histogram(grid, 50, (100.0, 199.0))
        assert got.counts.sum() == 300
        assert 99 < got.edges[0] <= 100 and 199 <= got.edges[-1] < 200
    for limits in ((5, 5), (9, 1), (0, np.inf), (np.nan, 1)):
        with pytest.raises(LeapRayError, match="finite and rise"):
            leapray.histogram(grid_of(stored), limits=limits)
    with pytest.raises(LeapRayError, match="'made' has no values from 2000 to 3000"):
        leapray.histogram(grid_of(stored), limits=(2000, 3000))
    for words in ({"bins": 0}, {"threads": -1}):
        with pytest.raises(LeapRayError, match=r"not 0|is -1"):
            leapray.histogram(grid_of(stored), **words)


def test_leaves_and_tiles_are_counted_the_background_is_not():
    leaves = Leaves(
        np.zeros((1, 3), np.int32),
        np.full((1, 8, 8, 8), 2, np.float32),
        0.0,
        np.array([[8, 0, 0], [128, 0, 0]], np.int32),
        np.array([8, 128], np.int32),
        np.array([1, 3], np.float32),
    )
    got = leapray.histogram(ScalarGrid("sparse", leaves, np.eye(4)), 3)
    assert_array_equal(got.counts, [8**3, 8**3, 128**3])


def test_blocks_and_threads_count_alike():
    stored = RNG(4).normal(0, 1, (40, 300, 301)).astype(np.float32)  # more than one block
    grid = ScalarGrid("big", stored, np.eye(4))
    one, two = (leapray.histogram(grid, 100, threads=threads) for threads in (1, 2))
    assert_array_equal(one.counts, two.counts)
    assert one.counts.sum() == stored.size
    across = ScalarGrid("big", stored.T, np.eye(4))  # in no order that memory has
    assert_array_equal(leapray.histogram(across, 100).counts, one.counts)


def test_a_count_can_be_stopped():
    grid = ScalarGrid("big", np.zeros((50, 200, 200), np.float32), np.eye(4))
    watch = leapray.Watch()
    watch.stop()
    with pytest.raises(leapray.Stopped):
        leapray.histogram(grid, watch=watch)
    assert threading.active_count() < 10


# ---- thresholds --------------------------------------------------------------------


def peaks(*parts, seed=0, dtype=np.float32, n=200_000):
    """Values of normal distributions: (share, mean, deviation)."""
    rng = RNG(seed)
    return np.concatenate(
        [rng.normal(mean, deviation, int(share * n)) for share, mean, deviation in parts]
    ).astype(dtype)


# name: values, range that separates the classes (their means, three deviations inwards)
CLEAR = {
    "even classes": (peaks((0.5, 100, 10), (0.5, 200, 10)), (130, 170)),
    "a tenth": (peaks((0.9, 100, 10), (0.1, 200, 10)), (130, 170)),
    "a hundredth": (peaks((0.99, 100, 10), (0.01, 200, 10)), (130, 170)),
    "a thousandth": (peaks((0.999, 100, 10), (0.001, 200, 10)), (130, 170)),
    "a thousandth, wide": (peaks((0.999, 100, 10), (0.001, 400, 60)), (130, 250)),
    "a dark thousandth": (peaks((0.999, 200, 10), (0.001, 100, 10)), (130, 170)),
    "a few parts in ten thousand": (peaks((0.9996, 100, 10), (0.0004, 200, 10)), (130, 190)),
    "a spike of zeros": (
        np.concatenate([np.zeros(180_000, np.float32), peaks((0.1, 500, 80))]),
        (1e-6, 260),
    ),
    "two values": (np.repeat(np.array([3.0, 7.0], np.float32), [150_000, 1000]), (3.01, 6.99)),
    "whole numbers": (peaks((0.95, 1000, 30), (0.05, 9000, 200), dtype=np.uint16), (1090, 8400)),
    "bytes": (peaks((0.9, 20, 4), (0.1, 120, 10), dtype=np.uint8), (32, 90)),
    "an outlier": (
        np.concatenate([peaks((0.8, 100, 10), (0.2, 200, 10)), [1e9, -1e9]]).astype(np.float32),
        (130, 170),
    ),
}


@pytest.mark.parametrize("name", CLEAR)
@pytest.mark.parametrize("scale", [1.0, 0.01, -2.0])
def test_a_first_threshold_lies_between_two_classes(name, scale):
    stored, (lo, hi) = CLEAR[name]
    value, sentence = leapray.first_threshold(grid_of(stored, scale=scale, offset=5.0))
    assert lo <= (value - 5) / scale <= hi, sentence
    assert sentence and "\n" not in sentence


# shares of a scan: padding, air, lung, fat, muscle, bone, metal
CT = {
    "a head": ((0.7, -1000, 15), (0.02, -90, 20), (0.2, 40, 20), (0.06, 700, 250)),
    "a thorax": (
        (0.45, -1000, 12),
        (0.2, -820, 60),
        (0.1, -95, 20),
        (0.2, 50, 25),
        (0.03, 500, 200),
    ),
    "a finger": ((0.985, -1000, 10), (0.01, 30, 30), (0.005, 800, 200)),
    "padding": ((0.45, -3024, 0.1), (0.3, -1000, 12), (0.2, 40, 25), (0.05, 600, 200)),
    "metal": ((0.75, -1000, 12), (0.2, 40, 25), (0.045, 600, 200), (0.00005, 20000, 4000)),
}


@pytest.mark.parametrize("name", CT)
def test_of_a_scan_in_hounsfield_units_the_body_is_found(name):
    stored = peaks(*CT[name], dtype=np.int16)
    value, sentence = leapray.first_threshold(grid_of(stored, quantity="HU"))
    assert -960 < value < 300, sentence  # skin, or bone where the scan is all body
    share = np.mean(stored > value)
    assert 0.01 < share < 0.5


def test_otsu_is_what_is_taken_where_classes_are_even():
    """The value that leaves the least variance within two classes, found by trying all."""
    stored = peaks((0.6, 50, 12), (0.4, 160, 25), dtype=np.uint8)
    value, sentence = leapray.first_threshold(grid_of(stored))

    def within(t):
        low, high = stored[stored <= t], stored[stored > t]
        return len(low) * low.var(dtype=np.float64) + len(high) * high.var(dtype=np.float64)

    best = min(range(stored.min(), stored.max()), key=within)
    assert "Otsu" in sentence
    assert abs(value - (best + 0.5)) <= 1


def test_level_sets_and_labels_have_their_own():
    values = np.arange(2000, dtype=np.float32)
    assert leapray.first_threshold(grid_of(values, kind="level set"))[0] == 0
    assert leapray.first_threshold(grid_of(values.astype(np.int16), kind="labels"))[0] == 0.5


def test_fog_is_cut_at_half_the_mean_of_what_is_not_empty():
    stored = np.repeat(np.array([0, 0.2, 1.0], np.float32), [5000, 1000, 1000])
    value, _ = leapray.first_threshold(grid_of(stored, kind="fog"))
    assert value == pytest.approx(0.3, abs=1e-4)  # the width of a bin


def test_noise_of_one_class_is_told():
    value, sentence = leapray.first_threshold(grid_of(peaks((1.0, 100, 10))))
    assert 90 < value < 110 and "noise" in sentence


def test_a_field_of_one_value_or_none_is_refused():
    for stored, reason in (
        (np.full(2000, 7, np.int16), "the same value everywhere, about 7"),
        (np.full(2000, 7, np.float32), "the same value everywhere, about 7"),
        (np.full(2000, np.nan, np.float32), "no sample with a value"),
    ):
        with pytest.raises(LeapRayError, match=f"'made' .*{reason}"):
            leapray.first_threshold(grid_of(stored))
    with pytest.raises(LeapRayError, match=r"a\.nii holds no sample"):
        leapray.first_threshold(grid_of(stored, source="a.nii"))


def test_what_lies_below_the_limits_is_not_counted_however_wide_these_are():
    values = np.array([[[70.0, 79.0, 80.0, 90.0, 1e30]]], np.float32)
    told = leapray.histogram(leapray.ScalarGrid("test", values, np.eye(4)), 4096, (80.0, 1e30))
    assert told.counts.sum() == told.counts[0] == 2  # 1e30 of f32 lies above
