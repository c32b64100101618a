# SPDX-License-Identifier: GPL-3.0-or-later
"""The brick store gives back what was put in, and knows its surface cells."""

from __future__ import annotations

import meshes
import numpy as np
import pytest

import leapray

DTYPES = {"u8": (np.uint8, 255), "u16": (np.uint16, 65535), "f32": (np.float32, 1)}


def random_samples(rng, shape, dtype):
    kind, one = DTYPES[dtype]
    values = rng.random(shape) * one
    values[rng.random(shape) < 0.3] = 0
    values[:, :, shape[2] // 2 :] = one  # a part that is full throughout
    return values.astype(kind)


def surface_cells(samples, threshold):
    padded = np.pad(samples.astype(float), 1) >= threshold
    nz, ny, nx = (n + 1 for n in samples.shape)
    stacked = [
        padded[z : z + nz, y : y + ny, x : x + nx] for z in (0, 1) for y in (0, 1) for x in (0, 1)
    ]
    return np.any(stacked, axis=0) & ~np.all(stacked, axis=0)


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("shape", [(1, 1, 1), (3, 20, 40), (33, 8, 17), (64, 64, 64)])
def test_samples_ids_and_surface_cells_come_back(dtype, shape):
    rng = np.random.default_rng(1)
    samples = random_samples(rng, shape, dtype)
    ids = rng.integers(0, 65536, shape)
    volume = leapray.Volume(samples, threshold=0.4, ids=ids)
    np.testing.assert_array_equal(volume.read(), samples)
    np.testing.assert_array_equal(volume.read_ids(), ids)
    want = surface_cells(samples, 0.4 * DTYPES[dtype][1])
    size = tuple(n + 1 for n in shape[::-1])
    np.testing.assert_array_equal(volume.read_surface((-1, -1, -1), size), want)
    assert volume.info.n_surface_cells == want.sum()
    if want.any():
        where = np.argwhere(want)[:, ::-1] - 1
        assert volume.info.surface_lo == tuple(where.min(axis=0))
        assert volume.info.surface_hi == tuple(where.max(axis=0))


@pytest.mark.parametrize("dtype", DTYPES)
def test_a_voxelized_ramp_is_rounded_to_the_nearest_stored_value(dtype):
    kind, one = DTYPES[dtype]
    steps = 1 << 24 if kind is np.float32 else one
    vertices, triangles = meshes.box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    wide = leapray.voxelize(vertices, triangles, 0.0625, dtype="f32", half_width=2.5)
    volume = leapray.voxelize(vertices, triangles, 0.0625, dtype=dtype, half_width=2.5)
    want = wide.read().astype(float)
    assert 0.05 < ((want > 0.0) & (want < 1.0)).mean() < 0.95
    rounding = 2.0**-8  # of f32 products up to 65535, and of the sums, in steps
    assert np.abs(volume.read() / one - want).max() <= (0.5 + rounding) / steps
    assert volume.read().max() == one


def test_blocks_may_reach_beyond_the_lattice_where_samples_are_zero():
    samples = np.ones((4, 5, 6), np.float32)
    block = leapray.Volume(samples).read((-3, -2, -1), (20, 10, 9))
    np.testing.assert_array_equal(block[1:5, 2:7, 3:9], samples)
    assert block.sum() == samples.sum()


def test_constant_bricks_take_no_memory_and_are_still_listed():
    samples = np.zeros((70, 70, 70), np.uint8)
    samples[10:60, 10:60, 10:60] = 255
    volume = leapray.Volume(samples)
    origins, stored = volume.bricks()
    assert stored == volume.info.n_bricks < len(origins)
    covered = np.zeros(samples.shape, bool)
    for i, (x, y, z) in enumerate(origins):
        inside = tuple(slice(max(a, 0), a + 8) for a in (z, y, x))
        covered[inside] = True
        if i >= stored:
            assert (samples[inside] == 255).all()
    assert (samples[~covered] == 0).all()
    assert volume.info.nbytes < samples.nbytes


def test_blocks_put_in_any_order_make_the_same_volume():
    rng = np.random.default_rng(2)
    samples = random_samples(rng, (30, 25, 21), "u16")
    builder = leapray.VolumeBuilder(samples.shape[::-1], "u16")
    pieces = [(z, y) for z in range(0, 30, 7) for y in range(0, 25, 6)]
    rng.shuffle(pieces)
    for z, y in pieces:
        builder.put((0, y, z), samples[z : z + 7, y : y + 6])
    volume = builder.finish()
    np.testing.assert_array_equal(volume.read(), samples)
    assert volume.info.n_surface_cells == leapray.Volume(samples).info.n_surface_cells
    for again in (builder.finish, lambda: builder.put((0, 0, 0), samples)):
        with pytest.raises(leapray.LeapRayError, match="builder is spent"):
            again()


def test_the_field_is_trilinear_and_its_gradient_is_its_slope():
    rng = np.random.default_rng(3)
    matrix = np.array([[0.5, 0.1, 0, 3], [0, -0.7, 0.2, 1], [0, 0, 1.1, -2], [0, 0, 0, 1.0]])
    samples = rng.random((6, 7, 8)).astype(np.float32)
    volume = leapray.Volume(samples, object_from_index=matrix)
    index = rng.random((500, 3)) * (6.9, 5.9, 4.9)
    points = index @ matrix[:3, :3].T + matrix[:3, 3]
    value, gradient = volume.sample(points)
    base = np.floor(index).astype(int)
    u = index - base
    want = np.zeros(500)
    for corner in np.ndindex(2, 2, 2):
        weight = np.prod(np.where(np.array(corner), u, 1 - u), axis=1)
        i, j, k = (base + corner).T
        want += weight * samples[k, j, i]
    np.testing.assert_allclose(value, want, atol=1e-12)
    for axis in range(3):
        step = np.zeros(3)
        step[axis] = 1e-6
        slope = (volume.sample(points + step)[0] - volume.sample(points - step)[0]) / 2e-6
        same_cell = (np.abs(u - 0.5) < 0.499).all(axis=1)
        np.testing.assert_allclose(gradient[same_cell, axis], slope[same_cell], atol=1e-6)
    outside, _ = volume.sample(np.array([[1e9, 0, 0], [np.nan, 0, 0]]))
    assert (outside == 0).all()


CUBE = np.zeros((2, 2, 2), np.float32)


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: leapray.Volume(np.zeros((4, 4, 4), np.int64)), "uint8, uint16 or float32"),
        (lambda: leapray.Volume(CUBE[0]), r"shape \(nz, ny, nx\); it is \(2, 2\)"),
        (lambda: leapray.Volume(CUBE * np.nan), r"sample \(0, 0, 0\) of the block is"),
        (lambda: leapray.Volume(CUBE, threshold=0), r"in \(0, 1\]; it is 0"),
        (
            lambda: leapray.Volume(CUBE, object_from_index=np.diag([1, 0, 1, 1])),
            "invertible",
        ),
        (
            lambda: leapray.Volume(CUBE, ids=np.zeros((1, 2, 2))),
            "ids must have the samples' shape",
        ),
        (lambda: leapray.VolumeBuilder((0, 4, 4), "u8"), "0 x 4 x 4 were wanted"),
        (lambda: leapray.VolumeBuilder((1 << 21, 4, 4), "u8"), "1 to 1048576 samples per axis"),
        (
            lambda: leapray.VolumeBuilder((4, 4, 4), "u8").put(
                (2, 0, 0), np.zeros((4, 4, 4), np.uint8)
            ),
            "the block leaves the lattice along x: it has 4 samples from 2 on, the lattice 4",
        ),
    ],
)
def test_wrong_volumes_are_refused_by_a_sentence(make, sentence):
    with pytest.raises(leapray.LeapRayError, match=sentence):
        make()


@pytest.mark.parametrize("origin", [(2**40, 0, 0), (0, -(2**31) - 1, 0), (0, 0)])
def test_a_place_that_no_32_bits_hold_is_refused_not_wrapped(origin):
    volume = leapray.Volume(np.ones((3, 3, 3), np.float32))
    with pytest.raises(leapray.LeapRayError, match="32 bits"):
        volume.read(origin, (1, 1, 1))
