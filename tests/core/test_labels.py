# SPDX-License-Identifier: GPL-3.0-or-later
"""Labels of any numbers, solids of some of them side by side, and cuts that show them."""

import numpy as np
import pytest
import stage
from numpy.testing import assert_array_equal

import leapray
from leapray import ScalarGrid, label_numbers, label_volume, labels
from leapray._abi import LR_OWN_INDEX


def grid_of(samples, **more):
    return ScalarGrid("map", np.asarray(samples), np.eye(4), kind="labels", **more)


def thirds(n=24):
    """A ball that is three labels, which meet in its axis, among air."""
    k, j, i = np.indices((n, n, n)) - (n - 1) / 2
    turn = np.floor((np.arctan2(j, i) / np.pi + 1) * 1.4999).astype(int)
    return np.choose(turn, (5, 1000, 70_000_000)) * (i**2 + j**2 + k**2 < (0.4 * n) ** 2)


def test_labels_of_any_size_have_their_places_as_ids():
    grid = grid_of(thirds())
    numbers = label_numbers(grid)
    assert_array_equal(numbers, (5, 1000, 70_000_000))
    volume = labels(grid, numbers=numbers)
    inside = grid.samples > 0
    assert_array_equal(volume.read() >= 128, inside)
    assert_array_equal(numbers[volume.read_ids()[inside]], grid.samples[inside])


@pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.float32, np.float64])
def test_numbers_are_those_of_the_values_and_none_is_none(dtype):
    stored = np.array([[[0, 3, 7, 9, 3, 2]]], dtype)
    grid = ScalarGrid("map", stored, np.eye(4), kind="labels", scale=2.0, offset=1.0, no_data=9)
    assert_array_equal(label_numbers(grid), (1, 5, 7, 15))


@pytest.mark.parametrize(
    ("dtype", "numbers"),
    [(np.bool_, [1]), (np.uint8, [1, 255]), (np.int8, [1, 127]), (np.uint16, [9, 65535]),
     (np.uint64, [5, 2**53]), (np.float32, [3, 2**24])],
)  # fmt: skip
def test_the_largest_numbers_of_each_type_are_labels(dtype, numbers):
    samples = np.zeros((6, 6, 12), dtype)
    for n, number in enumerate(numbers):
        samples[1:5, 1:5, 1 + 5 * n : 5 + 5 * n] = number
    grid = grid_of(samples)
    assert_array_equal(label_numbers(grid), numbers)
    for listed in (numbers, None):
        if listed is None and max(numbers) > 65535:
            continue
        volume = labels(grid, numbers=listed)
        assert_array_equal(volume.read() >= 128, samples > 0)
        ids = volume.read_ids()[samples > 0]
        assert_array_equal(ids if listed is None else np.array(listed)[ids], samples[samples > 0])


def test_a_solid_of_some_labels_is_no_larger_than_they_are():
    samples = np.zeros((40, 50, 60), np.int32)
    samples[10:20, 12:30, 15:18] = 4
    samples[20:25, 12:30, 15:18] = 9
    whole = labels(grid_of(samples), numbers=(4, 9))
    some = labels(grid_of(samples), numbers=(4, 9), of=[1])
    assert some.info.size == (7, 22, 9) and whole.info.size == (60, 50, 40)
    points = np.argwhere(np.ones(samples.shape, bool))[:, ::-1].astype(float)
    assert_array_equal((some.sample(points)[0] >= 0.5).reshape(samples.shape), samples == 9)


@pytest.mark.parametrize("dtype", ["?", "u1", "i1", "u2", "i2", "u4", "i8", "f4"])
def test_labels_whose_numbers_are_not_listed_are_their_own_ids(dtype):
    stored = np.zeros((5, 6, 7), dtype)
    stored[1:4, 1:4, 1:5], stored[3, 3, 3] = 1, 100
    volume = labels(grid_of(stored))
    assert_array_equal(volume.read_ids(), stored.astype(np.uint16))


def test_bands_of_slabs_make_no_difference(monkeypatch):
    """However few samples are taken at a time."""
    samples = np.zeros((44, 60, 30), np.uint16)
    rng = np.random.default_rng(4)
    samples[3:40, 5:55, 4:26] = rng.integers(0, 4, (37, 50, 22)) * 100
    numbers = label_numbers(grid_of(samples))
    for more in ({}, {"of": [1], "over": [0, 2]}, {"smoothing": 1.6}):
        made = []
        for most in (1 << 23, 1):
            monkeypatch.setattr(label_volume, "MOST_AT_ONCE", most)
            assert_array_equal(label_numbers(grid_of(samples)), numbers)
            made.append(labels(grid_of(samples), numbers=numbers, **more))
        assert_array_equal(*(each.read() for each in made))
        assert_array_equal(*(each.read_ids() for each in made))
        assert made[0].info.nbytes == made[1].info.nbytes


def held_by_each(points, reaching):
    """(3, n): which solid of the labels of `thirds` holds points (n, 3)."""
    grid = grid_of(thirds())
    numbers, held = label_numbers(grid), []
    for n, later in enumerate(((1, 2), (2,), ())):
        solid = labels(grid, numbers=numbers, of=[n], over=later if reaching else ())
        held.append(solid.sample(points)[0] >= solid.info.threshold)
    return np.array(held)


def test_solids_of_labels_that_touch_overlap():
    """Every point in the ball lies in a solid, but for a thread where all three meet."""
    rng = np.random.default_rng(3)
    way = rng.normal(size=(60000, 3))
    way *= (rng.random((len(way), 1)) ** (1 / 3)) * 7.5 / np.linalg.norm(way, axis=1)[:, None]
    off = np.hypot(way[:, 0], way[:, 1])
    reaching, apart = (held_by_each(way + 11.5, reaches) for reaches in (True, False))
    assert reaching[:, off > 0.75].any(axis=0).all()
    assert (reaching.sum(axis=0) == 2).mean() > 0.02
    void, wider = (~held.any(axis=0) for held in (reaching, apart))
    assert 0 < 5 * void.sum() < wider.sum()


def test_a_solid_that_reaches_over_others_keeps_its_own_ids():
    samples = np.repeat(np.repeat([[[0, 0, 3, 3, 3, 8, 8, 8, 0, 0]]], 9, 0), 9, 1)
    solid = labels(grid_of(samples), numbers=(3, 8), of=[0], over=[1])
    hits = leapray.trace(leapray.build(solid), [(20, 4, 4), (-9, 4, 4)], [(-1, 0, 0), (1, 0, 0)])
    assert_array_equal(hits.id, (0, 0))
    assert 20 - hits.t[0] == pytest.approx(4.5 + 1 / 3, abs=0.01)  # a third into the neighbour
    assert hits.t[1] - 9 == pytest.approx(1.5, abs=0.02)  # and not into the air


def test_more_labels_than_ids_are_a_sentence():
    grid = grid_of(np.arange(1, 41**3 + 1).reshape(41, 41, 41))
    with pytest.raises(leapray.LeapRayError, match="'map' has 68921 labels; ids hold 65536"):
        labels(grid, numbers=label_numbers(grid))
    assert labels(grid, numbers=np.arange(1, 65537)).info.has_ids


@pytest.mark.parametrize("smoothing", [0.0, 1.0, 2.5])
def test_smoothing_leaves_samples_in_their_labels(smoothing):
    rng = np.random.default_rng(5)
    samples = rng.integers(0, 3, (70, 9, 40)) * (rng.random((70, 9, 40)) < 0.7)
    volume = labels(grid_of(samples), numbers=(1, 2), smoothing=smoothing)
    assert_array_equal(volume.read() >= 128, samples > 0)
    some = labels(grid_of(samples), numbers=(1, 2), of=[1], smoothing=smoothing)
    points = np.argwhere(samples == 2)[:, ::-1].astype(float)
    assert (some.sample(points)[0] >= some.info.threshold).all()


def test_slabs_make_one_smooth_solid():
    samples = np.zeros((100, 8, 8), np.uint8)
    samples[:, 2:6, 2:5] = 1
    made = labels(grid_of(samples), smoothing=2.0).read()[12:-12]
    assert_array_equal(made, np.broadcast_to(made[0], made.shape))


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"numbers": (3, 3)}, "ascends"),
        ({"numbers": (0, 3)}, "ascends"),
        ({"numbers": (5,), "of": [1]}, "below 1; one is 1"),
        ({"numbers": (5,), "of": [0.5]}, "whole numbers"),
        ({"numbers": (5,), "over": [-1]}, "whole numbers"),
        ({"numbers": (5,), "smoothing": 8.5}, "0..8 voxels"),
        ({"numbers": (5,), "smoothing": float("nan")}, "0..8 voxels"),
        ({}, "whole numbers in 0..65535"),
    ],
)
def test_wrong_lists_are_sentences(given, words):
    with pytest.raises(leapray.LeapRayError, match=words):
        labels(grid_of(thirds()), **given)


def test_labels_that_do_not_fit_are_out_of_memory():
    grid = grid_of(thirds(40))
    numbers = label_numbers(grid)
    needed = labels(grid, numbers=numbers).info.nbytes
    assert labels(grid, numbers=numbers, max_nbytes=needed).info.nbytes == needed
    with pytest.raises(leapray.OutOfMemory):
        labels(grid, numbers=numbers, max_nbytes=needed // 3)


# ---- in a scene ------------------------------------------------------------------

COLORS = ((0.9, 0.1, 0.1), (0.1, 0.9, 0.1), (0.1, 0.1, 0.9), (0.5, 0.5, 0.5))


def glowing(color, index):
    return leapray.Material((leapray.Lobe("emission", color),), index=index)


def cut_scene(objects=None):
    """A ball of three labels that is cut where z is greatest, seen from above."""
    grid = grid_of(thirds(48))
    ball = labels(grid, numbers=label_numbers(grid))
    axis = np.linspace(-1, 1, 24)
    outward = np.abs(np.stack(np.meshgrid(axis, axis, axis, indexing="ij"))).max(0)
    box = leapray.Volume((0.5 + 2 * (0.6 - outward)).clip(0, 1).astype(np.float32))
    place = np.diag([4.0, 4.0, 4.0, 1.0])
    place[:3, 3] = (23.5 - 46, 23.5 - 46, 23.5 + 3.5 - 4 * (11.5 - 0.6 * 11.5))
    clip = leapray.Clip(box, place)
    id_of = leapray.FieldColor(ball, np.eye(4), None, part="id")
    face = leapray.Instance(
        leapray.build(box), place, 0, 3, 7, clips=[leapray.Clip(ball, np.eye(4), inside=True)],
        field_color=id_of, volume_index=2,
    )  # fmt: skip
    solid = leapray.Instance(leapray.build(ball), np.eye(4), 0, 3, 7, clips=[clip], volume_index=1)
    camera = leapray.Camera("orthographic", (23.5, 23.5, 90), (0, 0, -1), (-24, -24, 0),
                            (0.5, 0, 0), (0, 0.5, 0))  # fmt: skip
    materials = [glowing(color, 11 + n) for n, color in enumerate(COLORS)]
    scene = leapray.Scene(camera, [solid, face], [], materials, [0, 1, 2], slot_objects=objects)
    passes = "Combined", "Position", "Object Index", "Material Index", "Volume"
    return grid, scene.render_tile(0, 0, 96, 96, samples=1, passes=passes)


def averaged(mask, points):
    """Of samples: their average by 1-2-1 along each axis, interpolated at points (n, 3)."""
    total = mask.astype(float)
    for axis in range(3):
        before, after = np.roll(total, 1, axis), np.roll(total, -1, axis)
        total = (before + 2 * total + after) / 4
    cell = np.floor(points).astype(int)
    part = points - cell
    found = np.zeros(len(points))
    for corner in np.ndindex(2, 2, 2):
        weight = np.where(corner, part, 1 - part).prod(axis=1)
        x, y, z = (cell + corner).T
        found += weight * total[z, y, x]
    return found


@pytest.mark.parametrize("objects", [None, (21, LR_OWN_INDEX, 23)])
def test_the_face_of_a_cut_has_the_label_that_it_goes_through(objects):
    grid, tile = cut_scene(objects)
    face = tile["Volume"][..., 0] == 2
    assert face.sum() > 2000
    place = tile["Position"][face]
    assert place[:, 2] == pytest.approx(place[0, 2], abs=1e-3)
    weights = np.stack([averaged(grid.samples == n, place) for n in label_numbers(grid)])
    first, second = np.sort(weights, axis=0)[[-1, -2]]
    clear = first > second + 1e-6
    which = weights.argmax(axis=0)[clear]
    assert clear.sum() > 2000
    assert_array_equal(np.unique(which), (0, 1, 2))
    assert_array_equal(tile["Material Index"][face][clear, 0], 11 + which)
    index = (7, 7, 7) if objects is None else (21, 7, 23)
    assert_array_equal(tile["Object Index"][face][clear, 0], np.array(index)[which])


def test_ids_come_without_a_program_and_colors_with_one():
    solid = labels(grid_of(np.ones((4, 4, 4), int)))
    red, *_ = leapray.INPUTS
    program = leapray.compile_program((red, red, red))
    for color in (
        leapray.FieldColor(solid, np.eye(4), program, part="id"),
        leapray.FieldColor(solid, np.eye(4), None),
    ):
        one = [leapray.Instance(leapray.build(solid), np.eye(4), field_color=color)]
        with pytest.raises(leapray.LeapRayError, match="instance 0 must take its colours"):
            leapray.Scene(stage.camera((6, 0, 0)), one, [], [glowing((1, 1, 1), 0)], [0])
