# SPDX-License-Identifier: GPL-3.0-or-later
"""Volumes as bytes: they come back the same to the bit, and no bytes do harm."""

import meshes
import numpy as np
import pytest
from numpy.testing import assert_array_equal

import leapray
from leapray import VERTEX, Attributes, Volume

H = 1 / 16


def aimed(n=4000, seed=0):
    """Rays from all around through the middle of things."""
    rng = np.random.default_rng(seed)
    o = rng.normal(size=(n, 3))
    o *= 4 / np.linalg.norm(o, axis=1, keepdims=True)
    return o, rng.uniform(-0.9, 0.9, (n, 3)) - o


def painted(mesh, seed=0):
    v, t = mesh
    colors = np.random.default_rng(seed).uniform(0, 3, (len(t), 3, 3)).astype(np.float32)
    normals = v[t] / np.maximum(np.linalg.norm(v[t], axis=2, keepdims=True), 1e-9)
    return Attributes(
        normals=normals.astype(np.float32),
        color_sources=np.full(len(t), VERTEX, np.int32),
        colors=colors,
    )


def solid(mesh, number, **options):
    v, t = mesh
    return leapray.voxelize(v, t, H, ids=np.full(len(t), number), kind="solid", **options)


def merged(**options):
    boxes = [meshes.box((-0.9, -0.8, -0.7), (0.0, 0.8, 0.7)), meshes.box((0, -1, -1), (1, 1, 1))]
    ball = meshes.icosphere(3, 0.6)
    return leapray.merge(
        [solid(m, n, attributes=painted(m, n), **options) for n, m in enumerate([*boxes, ball])]
    )


def measured(seed=0):
    """Any samples, as they are read from a file, on a sheared lattice."""
    rng = np.random.default_rng(seed)
    place = np.array([[0.1, 0.02, 0, -1], [0, 0.1, 0.01, -1], [0.03, 0, 0.1, -1], [0, 0, 0, 1]])
    samples = rng.uniform(-1, 2, (20, 17, 23)).astype(np.float32)
    return Volume(samples, 0.37, object_from_index=place, ids=rng.integers(0, 9, samples.shape))


BALL, LEAF, BOX = meshes.icosphere(3), meshes.leaf(), meshes.box((-0.5, -0.4, -0.3))
VOLUMES = {
    **{f"solid {d}": lambda d=d: leapray.voxelize(*BALL, H, dtype=d) for d in ("u8", "u16", "f32")},
    "ids": lambda: leapray.voxelize(*BALL, H, ids=np.arange(len(BALL[1])) % 7),
    "full bricks": lambda: leapray.voxelize(*BALL, H / 4),
    "touched": lambda: leapray.voxelize(*LEAF, H, exact="none"),
    "sheet": lambda: leapray.voxelize(*LEAF, H, ids=np.arange(len(LEAF[1])) % 5),
    "exact": lambda: leapray.voxelize(*BOX, H, exact="all"),
    "painted": lambda: leapray.voxelize(*BALL, H, attributes=painted(BALL), exact="all"),
    "painted sheet": lambda: leapray.voxelize(*LEAF, H, attributes=painted(LEAF)),
    "merged": merged,
    "merged f32": lambda: merged(dtype="f32"),
    "measured": measured,
    "nothing": lambda: Volume(np.zeros((3, 4, 5), np.uint8)),
}


def look(volume, n=4000):
    """All that rays can learn of a volume."""
    o, d = aimed(n)
    hits = leapray.trace(leapray.build(volume), o, d)
    points = o + np.nan_to_num(hits.t, posinf=0.0)[:, None] * d
    about = volume.sample(points), volume.attributes(points), volume.exact_at(points)
    return hits, (hits.t, hits.cell, hits.normal, hits.id, *about[0], *about[1], about[2])


@pytest.mark.parametrize("name", VOLUMES)
def test_a_volume_comes_back_the_same_to_the_bit(name):
    volume = VOLUMES[name]()
    data = volume.pack()
    again = Volume.unpack(data)
    assert_array_equal(again.pack(), data)
    for field in vars(volume.info):
        if field not in ("nbytes", "triangle_cells_nbytes"):
            assert_array_equal(getattr(again.info, field), getattr(volume.info, field), field)
    assert volume.info.nbytes * 0.9 <= again.info.nbytes <= volume.info.nbytes * 1.05 + 4096
    (hits, seen), (_, seen_again) = look(volume), look(again)
    assert np.isfinite(hits.t).mean() > 0.1 or name == "nothing"
    for one, other in zip(seen, seen_again, strict=True):
        assert_array_equal(one.view(np.uint8), other.view(np.uint8))


def test_the_samples_cover_all_that_a_volume_may_hold():
    infos = [make().info for make in VOLUMES.values()]
    for what in ("n_full", "n_triangle_cells", "has_colors", "has_normals", "n_shared", "has_ids"):
        assert any(getattr(info, what) for info in infos), what


def refused_or_harmless(data):
    """Unpack; where that is not refused, use everything. Returns whether it was refused."""
    try:
        volume = Volume.unpack(data)
    except leapray.LeapRayError as error:
        assert str(error)
        return True
    look(volume, 300)
    volume.read()
    return False


@pytest.mark.parametrize("name", ["sheet", "painted", "merged f32", "ids"])
def test_no_flipped_byte_does_harm(name):
    """Whether it is refused or makes another volume: there is no crash, no hang."""
    data, rng = VOLUMES[name]().pack(), np.random.default_rng(1)
    refused = 0
    for _ in range(60):
        wrong = data.copy()
        where = rng.integers(0, wrong.size, 1 + rng.integers(0, 3))
        wrong[where] ^= rng.integers(1, 256, len(where), dtype=np.uint8)
        refused += refused_or_harmless(wrong)
    for word in range(0, 264, 4):  # the head
        for value in (0, 1, 2, 255, 65537, 1 << 24, (1 << 31) - 1, 0xFFFFFFFF):
            wrong = data.copy()
            wrong[word : word + 4].view(np.uint32)[:] = value
            refused += refused_or_harmless(wrong)
    assert refused > 200


@pytest.mark.parametrize("name", ["sheet", "painted", "merged"])
def test_no_numbers_out_of_place_do_harm(name):
    """Runs of words become large numbers, so that tables and lists lead nowhere."""
    data, rng = VOLUMES[name]().pack(), np.random.default_rng(2)
    words, refused = data.size // 4, 0
    for _ in range(150):
        wrong = data.copy()
        at, n = rng.integers(66, words - 9), rng.integers(1, 9)
        wrong[4 * at : 4 * (at + n)].view(np.uint32)[:] = rng.integers(0, 1 << 32, n)
        refused += refused_or_harmless(wrong)
    assert refused > 3


def test_bytes_of_any_length_are_refused():
    data = VOLUMES["sheet"]().pack()
    for n in (0, 1, 8, 100, 263, 264, data.size // 2, data.size - 1):
        with pytest.raises(leapray.LeapRayError, match="bytes of"):
            Volume.unpack(data[:n])
    with pytest.raises(leapray.LeapRayError, match="bytes of"):
        Volume.unpack(np.append(data, np.uint8(0)))
    with pytest.raises(leapray.LeapRayError, match="none of a volume"):
        Volume.unpack(bytes(1000))
    older = data.copy()
    older[8] += 1
    with pytest.raises(leapray.LeapRayError, match="another version"):
        Volume.unpack(older)


def test_a_rectilinear_volume_has_no_bytes():
    planes = tuple(np.cumsum(np.ones(4)) for _ in range(3))
    with pytest.raises(leapray.LeapRayError, match="rectilinear"):
        Volume(np.ones((4, 4, 4), np.uint8), planes=planes).pack()


def test_a_stopped_watch_ends_it():
    volume, watch = VOLUMES["sheet"](), leapray.Watch()
    data = volume.pack()
    watch.stop()
    with pytest.raises(leapray.Stopped):
        volume.pack(watch=watch)
    with pytest.raises(leapray.Stopped):
        Volume.unpack(data, watch=watch)
