# SPDX-License-Identifier: GPL-3.0-or-later
"""Hit points, normals and ids against shapes whose answers are known."""

from __future__ import annotations

import numpy as np
import pytest
import stage

import leapray

ALL = [t.spec for t in leapray.variants()]
EXACT = [t.spec for t in leapray.variants() if t.exact]
CENTRE = np.array([31.31, 32.17, 30.73])
RADIUS = 25.6
SCALES = {"u8": (255, np.uint8), "u16": (65535, np.uint16), "f32": (1, np.float32)}


def ramp_sphere(dtype="f32", n=64, centre=CENTRE, radius=RADIUS, half_width=2.5):
    z, y, x = np.mgrid[:n, :n, :n]
    distance = np.sqrt((x - centre[0]) ** 2 + (y - centre[1]) ** 2 + (z - centre[2]) ** 2)
    g = np.clip(0.5 + (radius - distance) / (2 * half_width), 0, 1)
    one, kind = SCALES[dtype]
    return np.round(g * one).astype(kind) if one > 1 else g.astype(kind)


def aimed_rays(rng, n, spread=8.0):
    directions = rng.normal(size=(n, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    return CENTRE + rng.normal(size=(n, 3)) * spread - directions * 100, directions


def errors(hits, origins, directions):
    hit = np.isfinite(hits.t)
    out = origins[hit] + hits.t[hit, None] * directions[hit] - CENTRE
    length = np.linalg.norm(out, axis=1)
    cosine = (out / length[:, None] * hits.normal[hit]).sum(axis=1)
    return length - RADIUS, np.degrees(np.arccos(np.clip(cosine, -1, 1)))


@pytest.mark.parametrize(("dtype", "slack"), [("f32", 1.0), ("u16", 1.1)])
def test_hits_on_a_sphere_of_25_voxels_lie_within_a_hundredth_of_a_voxel(dtype, slack):
    origins, directions = aimed_rays(np.random.default_rng(1), 100_000)
    structure = leapray.build(leapray.Volume(ramp_sphere(dtype)))
    hits = leapray.trace(structure, origins, directions)
    radial, angle = errors(hits, origins, directions)
    assert len(radial) > 90_000
    assert abs(radial.mean()) <= 0.007 * slack  # a trilinear field shrinks a sphere by 1/(6R)
    assert abs(radial).max() <= 0.011 * slack  # and at most by 1/(4R)
    assert angle.mean() <= 0.02 * slack


PLACEMENTS = {
    "in place": np.eye(4),
    "flat boxes, sheared": np.array(
        [[1e-3, 0.3, 0, 5], [0, 1, -0.2, 0], [0, 0, 1, 7], [0, 0, 0, 1]]
    ),
}


@pytest.fixture(scope="module", params=PLACEMENTS)
def bundles(request):
    """Rays as a scene has them: from afar, from inside and cut short, leaving a surface."""
    rng = np.random.default_rng(2)
    matrix = PLACEMENTS[request.param]
    volume = leapray.Volume(ramp_sphere("u16"), object_from_index=matrix)
    default = leapray.build(volume)
    origins, directions = aimed_rays(rng, 10_000, spread=20)
    origins = origins @ matrix[:3, :3].T + matrix[:3, 3]
    directions = directions @ matrix[:3, :3].T
    far = leapray.trace(default, origins, directions)
    near = {"t_min": rng.uniform(60, 110, 10_000), "t_max": rng.uniform(90, 130, 10_000)}
    hit = np.isfinite(far.t)
    points = origins[hit] + far.t[hit, None] * directions[hit]
    onward = rng.normal(size=points.shape)
    side = np.where((onward * far.field_normal[hit]).sum(axis=1) > 0, -1, 1)
    rays = [
        (origins, directions, {}),
        (origins, directions, near),
        (points, onward, {"start": (far.cell[hit], side)}),
    ]
    return volume, rays, [leapray.trace(default, o, d, **more) for o, d, more in rays]


@pytest.mark.parametrize("name", EXACT)
def test_every_exact_traverser_gives_the_same_bits(name, bundles):
    volume, rays, references = bundles
    structure = leapray.build(volume, name)
    for (origins, directions, more), reference in zip(rays, references, strict=True):
        hits = leapray.trace(structure, origins, directions, **more)
        np.testing.assert_array_equal(hits.t, reference.t)
        np.testing.assert_array_equal(hits.normal, reference.normal)
        np.testing.assert_array_equal(hits.cell, reference.cell)
        assert 0.3 < np.isfinite(hits.t).mean() < 0.99


@pytest.mark.parametrize("name", ALL)
def test_counting_and_threads_change_nothing(name):
    rays = aimed_rays(np.random.default_rng(3), 70_000)  # more than one thread takes at a time
    structure = leapray.build(leapray.Volume(ramp_sphere("u8")), name)
    one = leapray.trace(structure, *rays)
    many = leapray.trace(structure, *rays, threads=7)
    uncounted = leapray.trace(structure, *rays, count=False)
    for other in (many, uncounted):
        np.testing.assert_array_equal(one.t, other.t)
        np.testing.assert_array_equal(one.normal, other.normal)
    assert one.counters == many.counters
    assert one.counters["rays"] == 70_000 and one.counters["hits"] == np.isfinite(one.t).sum()


def test_no_ray_slips_through_a_closed_surface():
    rng = np.random.default_rng(4)
    structure = leapray.build(leapray.Volume(ramp_sphere("f32")))
    directions = rng.normal(size=(200_000, 3))
    origins = np.repeat(CENTRE[None], len(directions), axis=0)
    out = leapray.trace(structure, origins, directions)
    assert np.isfinite(out.t).all()
    back = leapray.trace(structure, origins + directions * 1e3, -directions)
    assert np.isfinite(back.t).all()
    # lattice-aligned, through corners and along planes
    whole = np.round(directions * 2)
    whole = whole[(whole != 0).any(axis=1)]
    start = np.repeat(np.round(CENTRE)[None], len(whole), axis=0)
    assert np.isfinite(leapray.trace(structure, start, whole).t).all()


@pytest.mark.parametrize("name", EXACT)
def test_a_ray_inside_leaps_to_where_it_leaves(name):
    rng = np.random.default_rng(5)
    structure = leapray.build(leapray.Volume(ramp_sphere("f32")), name)
    directions = rng.normal(size=(1000, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    hits = leapray.trace(structure, np.repeat(CENTRE[None], 1000, axis=0), directions)
    np.testing.assert_allclose(hits.t, RADIUS, atol=0.011)
    assert ((hits.normal * directions).sum(axis=1) > 0.99).all()  # outward still


def test_a_ray_that_leaves_a_surface_does_not_hit_it_again():
    rng = np.random.default_rng(6)
    structure = leapray.build(leapray.Volume(ramp_sphere("f32")))
    origins, directions = aimed_rays(rng, 50_000)
    hits = leapray.trace(structure, origins, directions)
    hit = np.isfinite(hits.t)
    points = origins[hit] + hits.t[hit, None] * directions[hit]
    onward = rng.normal(size=points.shape)
    outwards = (onward * hits.field_normal[hit]).sum(axis=1)
    side = np.where(outwards > 0, -1, 1)
    again = leapray.trace(structure, points, onward, start=(hits.cell[hit], side))
    length = np.linalg.norm(onward, axis=1)
    steep = np.abs(outwards) / length > 0.05
    # outward: away from a convex body for good; inward: to the far side, a chord away
    assert np.isinf(again.t[steep & (outwards > 0)]).all()
    inward = steep & (outwards < 0)
    normal = (points - CENTRE) / np.linalg.norm(points - CENTRE, axis=1)[:, None]
    chord = -2 * RADIUS * (onward * normal).sum(axis=1) / length
    np.testing.assert_allclose((again.t * length)[inward], chord[inward], atol=0.3)


def test_t_counts_in_the_callers_own_direction_and_is_cut_there():
    structure = leapray.build(leapray.Volume(ramp_sphere("f32")))
    origins, directions = aimed_rays(np.random.default_rng(7), 5000)
    unit = leapray.trace(structure, origins, directions).t
    hit = np.isfinite(unit)
    long = leapray.trace(structure, origins, directions * 7).t
    np.testing.assert_allclose(long[hit] * 7, unit[hit], rtol=1e-12)
    before = leapray.trace(structure, origins, directions, t_max=unit - 1e-6).t
    assert np.isinf(before).all()
    at = leapray.trace(structure, origins, directions, t_max=unit).t
    np.testing.assert_array_equal(at, unit)
    behind = leapray.trace(structure, origins, directions, t_min=unit + 1e-6).t
    assert (behind[hit] > unit[hit]).all()  # the far side, or a miss


@pytest.mark.parametrize("normal", leapray.NORMALS)
@pytest.mark.parametrize("root", leapray.ROOTS)
@pytest.mark.parametrize("hit_test", leapray.HIT_TESTS)
def test_every_combination_finds_the_sphere(hit_test, root, normal):
    structure = leapray.build(leapray.Volume(ramp_sphere("f32")))
    rays = aimed_rays(np.random.default_rng(8), 20_000)
    if hit_test == "uniform" and root in ("newton", "cubic"):
        with pytest.raises(leapray.LeapRayError, match="must be bisect or linear"):
            leapray.trace(structure, *rays, hit_test=hit_test, root=root)
        return
    hits = leapray.trace(structure, *rays, hit_test=hit_test, root=root, normal=normal)
    radial, angle = errors(hits, *rays)
    grazing = 0.06 if hit_test != "uniform" else 0.4  # linear, over one cell or one step
    assert abs(radial).max() < (grazing if root == "linear" else 0.011)
    # analytic: about 18 degrees / R; smooth and central agree on distances
    assert angle.mean() < (1.0 if normal == "analytic" else 0.02 + (root == "linear") * 0.01)


@pytest.mark.parametrize("step", [0.5, 1.0, 4.0])
def test_uniform_hits_between_the_first_neighbours_on_different_sides(step):
    """A solid block: steps lead from the surface cells into plain ones on either side."""
    samples = np.zeros((20, 20, 20), np.uint8)
    samples[4:16, 4:16, 4:16] = 255
    volume = leapray.Volume(samples)
    rng = np.random.default_rng(12)
    origins = rng.uniform(-5, 25, (2000, 3))
    directions = rng.uniform(5, 15, (2000, 3)) - origins
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    t = step * np.arange(round(60 / step))
    values, _ = volume.sample((origins[:, None] + t[:, None] * directions[:, None]).reshape(-1, 3))
    above = values.reshape(len(origins), -1) >= 0.5
    changes = above[:, 1:] != above[:, :-1]
    rays = origins, directions
    hits = leapray.trace(leapray.build(volume), *rays, hit_test="uniform", root="bisect", step=step)
    found, before = changes.any(axis=1), t[changes.argmax(axis=1)]
    np.testing.assert_array_equal(np.isfinite(hits.t), found)
    late = (hits.t - before)[found]
    assert found.mean() > 0.9 and late.min() > -1e-9 and late.max() < step + 1e-9


def test_extrema_finds_the_thin_rod_that_faces_lose():
    n = 24
    _, y, x = np.mgrid[:n, :n, :n]
    rod = np.clip(0.5 + (0.75 - np.hypot(x - 11.3, y - 11.6)) / 5, 0, 1).astype(np.float32)
    structure = leapray.build(leapray.Volume(rod))
    rng = np.random.default_rng(9)
    directions = rng.normal(size=(50_000, 3))
    targets = np.array([11.3, 11.6, 11.5]) + rng.uniform(-1, 1, (50_000, 3)) * (0.74, 0.74, 8)
    lost = {}
    for hit_test in leapray.HIT_TESTS:
        origins = targets - 40 * directions
        hits = leapray.trace(structure, origins, directions, hit_test=hit_test, root="bisect")
        lost[hit_test] = np.isinf(hits.t).sum()
    assert lost["uniform"] > lost["faces"] > lost["extrema"] > 0  # some rays pass the rod


def test_newton_bisect_and_cubic_find_the_first_root_in_noise():
    """Noise is the hardest field: up to three roots in a cell. The reference samples each cubic."""
    rng = np.random.default_rng(21)
    structure = leapray.build(leapray.Volume(rng.random((12, 12, 12)).astype(np.float32)))
    origins = rng.random((20_000, 3)) * 11
    directions = rng.normal(size=(20_000, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    found = {
        root: leapray.trace(structure, origins, directions, root=root).t
        for root in ("newton", "bisect", "cubic")
    }
    t = found["newton"]
    for other in ("bisect", "cubic"):
        np.testing.assert_allclose(found[other], t, atol=1e-9)
    hit = np.isfinite(t)
    assert hit.mean() > 0.9
    t, origins, directions = t[hit], origins[hit], directions[hit]
    value, _ = structure.volume.sample(origins + t[:, None] * directions)
    np.testing.assert_allclose(value, 0.5, atol=1e-9)
    began, _ = structure.volume.sample(origins)
    for fraction in np.linspace(0.02, 0.98, 49):  # nothing crossed before
        between, _ = structure.volume.sample(origins + (fraction * t)[:, None] * directions)
        assert ((between >= 0.5) == (began >= 0.5)).all()


@pytest.mark.parametrize(
    "matrix",
    [
        np.diag([0.1, 0.1, 0.1, 1]),
        np.diag([-0.3, 0.2, 1.7, 1]),  # mirrored boxes
        np.array([[1, 0.4, 0, 5], [0, 0.8, -0.3, -2], [0.1, 0, 1.3, 11], [0, 0, 0, 1.0]]),
    ],
    ids=["scaled", "mirrored", "sheared"],
)
def test_any_affine_placement_gives_the_same_hits_in_its_own_space(matrix):
    origins, directions = aimed_rays(np.random.default_rng(10), 20_000)
    plain = leapray.trace(leapray.build(leapray.Volume(ramp_sphere("f32"))), origins, directions)
    placed = leapray.build(leapray.Volume(ramp_sphere("f32"), object_from_index=matrix))
    moved = origins @ matrix[:3, :3].T + matrix[:3, 3], directions @ matrix[:3, :3].T
    hits = leapray.trace(placed, *moved)
    agree = np.isfinite(hits.t) == np.isfinite(plain.t)
    assert agree.mean() > 0.9999
    hit = np.isfinite(plain.t) & np.isfinite(hits.t)
    np.testing.assert_allclose(hits.t[hit], plain.t[hit], atol=1e-6)
    want = plain.normal[hit] @ np.linalg.inv(matrix[:3, :3])
    want /= np.linalg.norm(want, axis=1)[:, None]
    np.testing.assert_allclose(hits.normal[hit], want, atol=1e-5)


def test_ids_come_from_the_nearest_object_sample():
    samples = np.zeros((8, 8, 8), np.uint8)
    samples[2:6, 2:6, 2:6] = 255
    ids = np.zeros(samples.shape, np.uint16)
    ids[2:6, 2:6, 2:4], ids[2:6, 2:6, 4:6] = 7, 9
    structure = leapray.build(leapray.Volume(samples, ids=ids))
    x = np.array([2.2, 3.3, 3.7, 4.8])
    origins = np.stack([x, np.full(4, 3.5), np.full(4, -5.0)], axis=1)
    hits = leapray.trace(structure, origins, np.tile([0.0, 0, 1], (4, 1)))
    assert hits.id.tolist() == [7, 7, 9, 9]


def test_a_sheet_is_hit_from_both_sides_and_only_where_it_is_touched():
    z = np.arange(8.0)[:, None, None] * np.ones((8, 8, 8))
    samples = np.clip(0.5 + (3.4 - z) / 5, 0, 1).astype(np.float32)
    touched = np.zeros((8, 8, 8), bool)
    touched[3, 2:5, 2:5] = True
    structure = leapray.build(leapray.Volume(samples, sheet=True, touched=touched))
    for direction in (1.0, -1.0):
        origins = np.array([[3.5, 3.5, 4 - 9 * direction], [5.5, 3.5, 4 - 9 * direction]])
        hits = leapray.trace(structure, origins, np.tile([0, 0, direction], (2, 1)))
        np.testing.assert_allclose(origins[0, 2] + hits.t[0] * direction, 3.4, atol=1e-6)
        np.testing.assert_allclose(hits.normal[0], [0, 0, 1], atol=1e-9)
        assert np.isinf(hits.t[1])


def test_wrong_calls_are_answered_by_a_sentence():
    structure = leapray.build(leapray.Volume(ramp_sphere("u8", n=32)))
    ray = np.zeros((1, 3)), np.ones((1, 3))
    with pytest.raises(leapray.LeapRayError, match=r"unknown traverser 'nosuch'; there are "):
        leapray.build(structure.volume, "nosuch")
    with pytest.raises(leapray.LeapRayError, match="unknown hit test 'x'; there are extrema"):
        leapray.trace(structure, *ray, hit_test="x")
    with pytest.raises(leapray.LeapRayError, match=r"shape \(n, 3\); it is \(1, 4\)"):
        leapray.trace(structure, np.zeros((1, 4)), ray[1])
    with pytest.raises(leapray.LeapRayError, match="1 origins but 2 directions"):
        leapray.trace(structure, ray[0], np.ones((2, 3)))
    watch = leapray.Watch()
    watch.stop()
    with pytest.raises(leapray.Stopped):
        leapray.trace(structure, *ray, watch=watch)


@pytest.mark.parametrize("traverser", [t.name for t in leapray.traversers()])
@pytest.mark.parametrize("mode", leapray.MODES)
def test_rays_that_begin_at_infinity_miss(traverser, mode):
    half = np.zeros((8, 8, 8), np.float32)
    half[4:] = 1
    structure = leapray.build(leapray.Volume(half), traverser)
    rng, n = np.random.default_rng(1), 400
    cells, directions = rng.integers(0, 7, (n, 3)), rng.normal(size=(n, 3))
    leaving = cells, rng.integers(-1, 2, n)
    for start in (None, leaving):
        hits = leapray.trace(
            structure, cells + 0.5, directions, t_min=np.inf, mode=mode, start=start
        )
        assert (hits.t == np.inf).all() and not hits.normal.any()


def test_uniform_samples_end_where_the_start_is_far_from_the_ray():
    structure = leapray.build(stage.ball(), "aw")
    origin, direction = [[2.0**53, -0.0, 0.0]], [[-(2.0**31), 1.7, 11.0]]
    cell = np.argwhere(structure.volume.read().astype(float) > 0)[:1, ::-1]
    hits = leapray.trace(
        structure, origin, direction, t_max=2.6, hit_test="uniform", root="bisect", step=0.3,
        start=(cell, [-1]), count=True,
    )  # fmt: skip
    assert hits.counters["samples"] < 1000
