# SPDX-License-Identifier: GPL-3.0-or-later
"""Several solids in one volume: each keeps its surface, and no light passes where they touch."""

import dataclasses

import numpy as np
import pytest
import scenes
from meshes import box, icosphere
from numpy.testing import assert_allclose, assert_array_equal

import leapray
from addon import model, pipeline
from addon.plan import plan
from addon.store.memory_cache import Cache
from leapray import VERTEX, Attributes

H = 1 / 16
EXACT = [t.name for t in leapray.traversers() if t.exact]


def solid(mesh, number, h=H, **options):
    v, t = mesh
    ids = np.full(len(t), number)
    return leapray.voxelize(v, t, h, ids=ids, kind="solid", **options)


def touching(seam=0.0, **options):
    """Two boxes that share the face x = seam."""
    left, right = box((-1, -1, -1), (seam, 1, 1)), box((seam, -1, -1), (1, 1, 1))
    return leapray.merge([solid(left, 1, **options), solid(right, 2, **options)])


def down(n, x, y, z=3.0, lean=0.0, seed=0):
    """Rays from above, through x and y ranges."""
    rng = np.random.default_rng(seed)
    o = np.c_[rng.uniform(*x, n), rng.uniform(*y, n), np.full(n, z)]
    d = np.c_[rng.uniform(-lean, lean, n), rng.uniform(-lean, lean, n), np.full(n, -1.0)]
    return o, d


# ---- contact -------------------------------------------------------------------


@pytest.mark.parametrize("seam", [0.0, 0.5 * H, 0.3 * H, 0.77 * H])
@pytest.mark.parametrize("dtype", ["u8", "u16", "f32"])
def test_no_light_passes_between_two_boxes_that_touch(seam, dtype):
    structure = leapray.build(touching(seam, dtype=dtype))
    o, d = down(20000, (seam - 3 * H, seam + 3 * H), (-0.6, 0.6), lean=0.05)
    hits = leapray.trace(structure, o, d)
    z = (o + hits.t[:, None] * d)[:, 2]
    assert np.isfinite(hits.t).all()  # not one ray is lit from behind
    assert (1 - z).max() < H  # the edges of both are rounded, by less than a voxel


def test_rays_along_the_seam_find_a_surface_at_once():
    """In the very plane of contact, and a little beside it."""
    structure = leapray.build(touching())
    x = np.concatenate([[0.0], H * np.linspace(-0.1, 0.1, 41), [1e-12, -1e-12]])
    o = np.c_[x, np.zeros(len(x)), np.full(len(x), 3.0)]
    hits = leapray.trace(structure, o, np.tile((0.0, 0.0, -1.0), (len(x), 1)))
    assert ((o[:, 2] - hits.t) > 1 - H).all()


@pytest.mark.parametrize("name", EXACT)
def test_every_exact_traverser_finds_the_same(name):
    volume = touching(0.3 * H)
    o, d = down(2000, (-1.3, 1.3), (-1.3, 1.3), lean=0.4)
    got = leapray.trace(leapray.build(volume, name), o, d)
    want = leapray.trace(leapray.build(volume, "aw"), o, d)
    assert_array_equal(got.t, want.t)
    assert_array_equal(got.id, want.id)
    assert np.isfinite(want.t).mean() > 0.4


def test_each_of_two_boxes_is_hit_on_its_side():
    structure = leapray.build(touching(0.3 * H))
    o, d = down(4000, (-0.9, 0.9), (-0.9, 0.9))
    hits = leapray.trace(structure, o, d)
    away = np.abs(o[:, 0] - 0.3 * H) > H
    assert_array_equal(hits.id[away], np.where(o[away, 0] < 0, 1, 2))
    flat = np.abs(o[:, 0] - 0.3 * H) > 4 * H  # near the seam each one's field turns down
    assert_allclose(hits.normal[flat][:, 2], 1.0, atol=1e-6)


def test_each_solid_keeps_its_volume():
    """Against the analytic one, by the box filter: contact takes nothing from either."""
    parts = [
        solid(box((-1, -1, -1), (0.3 * H, 1, 1)), 1, filter="box", dtype="f32"),
        solid(box((0.3 * H, -1, -1), (1, 1, 1)), 2, filter="box", dtype="f32"),
    ]
    merged = leapray.merge(parts)
    m = merged.info.object_from_index
    k, j, i = np.mgrid[: merged.info.size[2], : merged.info.size[1], : merged.info.size[0]]
    places = np.stack([i, j, k], -1).reshape(-1, 3) * H + m[:3, 3]
    for number, width in ((1, 1 + 0.3 * H), (2, 1 - 0.3 * H)):
        g, _ = merged.sample(places, np.full(len(places), number))
        assert g.sum() * H**3 == pytest.approx(4 * width, rel=1e-6)


# ---- one within another ----------------------------------------------------------


def test_what_lies_inside_another_solid_keeps_its_surface():
    outer, inner = icosphere(3), icosphere(3, 0.5, (0.1, 0.05, 0.0))
    merged = leapray.merge([solid(outer, 0), solid(inner, 7)])
    assert merged.info.n_objects == 2 and merged.info.n_dropped == 0
    structure = leapray.build(merged)
    # from the middle outwards: the inner ball first, then the outer one
    d = np.random.default_rng(1).normal(size=(500, 3))
    o = np.tile((0.1, 0.05, 0.0), (500, 1))
    first = leapray.trace(structure, o, d)
    assert (first.id == 7).all()
    then = leapray.trace(structure, o, d, t_min=first.t * 1.05)
    assert (then.id == 0).all()
    assert_allclose(np.linalg.norm(o + then.t[:, None] * d, axis=1), 1.0, atol=0.01)
    assert_allclose(np.linalg.norm(first.t[:, None] * d, axis=1), 0.5, atol=0.01)
    outward = first.t[:, None] * d / 0.5
    assert (np.sum(first.normal * outward, axis=1) > 0.99).all()


def test_where_nothing_meets_nothing_changes():
    a, b = icosphere(3, 0.8), box((2.0, -0.5, -0.5), (3.0, 0.5, 0.5))
    merged = leapray.merge([solid(a, 1), solid(b, 2)])
    assert merged.info.n_shared == merged.info.n_dropped == 0
    for mesh, number in ((a, 1), (b, 2)):
        own = leapray.build(solid(mesh, number))
        middle = mesh[0].mean(axis=0)
        o = middle + np.random.default_rng(2).normal(size=(2000, 3)) * 0.2 + (0, 0, 3)
        d = np.tile((0.0, 0.05, -1.0), (2000, 1))
        got, want = leapray.trace(leapray.build(merged), o, d), leapray.trace(own, o, d)
        assert np.isfinite(want.t).mean() > 0.5
        assert_allclose(got.t, want.t, rtol=1e-12)
        assert_allclose(got.normal, want.normal, atol=1e-9)
        assert_array_equal(got.id, want.id)


def test_of_three_in_one_sample_the_largest_two_stay_and_the_third_is_counted():
    parts = [box((-1, -1, -1), (0, 0, 1)), box((0, -1, -1), (1, 0, 1)), box((-1, 0, -1), (1, 1, 1))]
    merged = leapray.merge([solid(mesh, k) for k, mesh in enumerate(parts)])
    assert merged.info.n_dropped > 0
    samples = {k: solid(mesh, k) for k, mesh in enumerate(parts)}
    places = np.random.default_rng(3).integers(-2, 3, (40, 3)) * H
    each = np.stack([samples[k].sample(places)[0] for k in range(3)])
    own = np.stack([merged.sample(places, np.full(40, k))[0] for k in range(3)])
    kept = np.sort(each, axis=0)[1:]
    assert_allclose(np.sort(own, axis=0)[1:], kept, atol=1e-9)
    o, d = down(20000, (-0.5, 0.5), (-0.5, 0.5), lean=0.05)
    assert np.isfinite(leapray.trace(leapray.build(merged), o, d).t).all()


def test_ids_of_materials_are_kept_within_their_object():
    v, t = box()
    ids = np.where(v[t][..., 2].mean(axis=1) > 0, 5, 6)
    two = leapray.voxelize(v, t, H, ids=ids)
    other = solid(box((1, -1, -1), (2, 1, 1)), 9)
    structure = leapray.build(leapray.merge([two, other]))
    # the cube has no surface where its own two materials meet
    o, d = np.array([[0.0, 0, 0]]), np.array([[0, 0, 1.0]])
    up, below = leapray.trace(structure, o, d), leapray.trace(structure, o, -d)
    assert (up.id[0], below.id[0]) == (5, 6)
    assert_allclose([up.t[0], below.t[0]], 1.0, atol=1e-3)


# ---- what they carry ---------------------------------------------------------------


def test_colours_and_normals_come_along():
    ball, cube = icosphere(2), box((1.2, -1, -1), (2.2, 1, 1))
    colors = Attributes(
        colors=np.full((12, 3, 3), (3.0, 0.5, 0.1)), color_sources=np.full(12, VERTEX)
    )
    a = solid(ball, 0, attributes=Attributes(normals=ball[0][ball[1]]))
    merged = leapray.merge([a, solid(cube, 1, attributes=colors)])
    assert merged.info.has_colors and merged.info.has_normals
    points = ball[0][ball[1]].mean(axis=1)
    _, normals = merged.attributes(points, np.zeros(len(points), int))
    assert_allclose(normals, a.attributes(points)[1], atol=1e-9)
    got, _ = merged.attributes([[2.2, 0.1, 0.2]], [1])
    assert_allclose(got, [(3.0, 0.5, 0.1)], rtol=0.01)


# ---- words --------------------------------------------------------------------------


def test_what_cannot_be_merged_is_said():
    one = solid(box(), 1)
    plain = leapray.voxelize(*box(), H)
    sheet = leapray.voxelize(*box(), H, kind="sheet", ids=np.zeros(12, int))
    for others, words in (
        ([], "1 to 65536 volumes"),
        ([one, plain], "part 1 must be a finished solid with ids"),
        ([one, sheet], "part 1 must be a finished solid"),
        ([one, one], "id 1 is in two parts, 0 and 1"),
        ([one, solid(box(), 2, h=H / 2)], "other voxels than the first"),
        ([one, solid(box(), 2, dtype="u8")], "sample type or threshold"),
        ([leapray.merge([one])], "not merged before"),
    ):
        with pytest.raises(leapray.LeapRayError, match=words):
            leapray.merge(others)


def test_the_uniform_hit_test_refuses_merged_volumes():
    with pytest.raises(leapray.LeapRayError, match="one field per object"):
        leapray.trace(
            leapray.build(touching()), [[0, 0, 3.0]], [[0, 0, -1.0]], hit_test="uniform",
            root="bisect",
        )  # fmt: skip


def test_merging_stops_when_told():
    watch = leapray.Watch()
    watch.stop()
    with pytest.raises(leapray.Stopped):
        leapray.merge([solid(box(), 1)], watch=watch)


# ---- a scene in one volume -----------------------------------------------------------


def boxes(**settings):
    """Two boxes side by side, one turned inside out, before a light; the camera in their shade."""
    turned = scenes.box((2.0, 2.0, 2.0))
    turned = dataclasses.replace(turned, triangles=turned.triangles[:, ::-1].copy())
    view = scenes.camera(eye=(0.0, -6.0, 0.0), width=96, height=64)
    made = scenes.scene(
        [scenes.box((2.0, 2.0, 2.0)), turned],
        [
            scenes.place(0, at=(-1.01, 0, 0), object_index=3),
            scenes.place(1, at=(0.99, 0, 0), object_index=5, materials=(1,)),
        ],
        view=view,
        lights=(model.Light("sun", (9.0, 9.0, 9.0), name="Behind", direction=(0.0, 1.0, 0.0)),),
        **{"layout": "scene", **settings},
    )
    return dataclasses.replace(made, world=model.World((0.0, 0.0, 0.0)))


@pytest.mark.parametrize("resolution", [0, 24, 50])
def test_no_light_from_behind_passes_the_seam(resolution):
    frame = pipeline.render(boxes(resolution=resolution, samples=4))
    combined, index = frame.passes["Combined"], frame.passes["Object Index"][..., 0]
    covered = index > 0
    assert set(np.unique(index)) == {0.0, 3.0, 5.0}
    assert (combined[covered][:, :3] == 0).all()  # they show their shaded side
    assert (combined[..., 3] == 1.0)[covered].all()
    middle = combined.shape[1] // 2
    assert (index[28:36, middle - 4 : middle + 4] > 0).all()
    (row,) = frame.report["volumes"]
    assert row["objects"] == 2 and row["samples_shared"] > 0 and row["samples_dropped"] == 0


def test_a_scene_of_solids_and_sheets_makes_two_volumes():
    meshes = [scenes.sphere(n=8), scenes.plane(6.0)]
    placed = [scenes.place(0, at=(0, 0, 1)), scenes.place(0, at=(0, 1.5, 1)), scenes.place(1)]
    made = plan.make(scenes.scene(meshes, placed, layout="scene"), Cache(), leapray.Watch(), 1)
    assert [row["kind"] for row in made.volumes] == ["solid", "sheet"]
    assert [row["objects"] for row in made.volumes] == [2, 1]
    assert made.slots == [0, 0, 0] and made.slot_objects == [0, 0, 0]


def test_a_ball_within_another_one_is_held_against_its_own_field():
    placed = [scenes.place(0), scenes.place(0, scale=0.5)]
    made = plan.make(
        scenes.scene([scenes.sphere(n=32)], placed, layout="scene"), Cache(), leapray.Watch(), 1
    )
    (row,) = made.volumes
    assert row["error_footprints"] <= 0.25 and row["lost"] == 0.0 and row["objects"] == 2


def test_what_a_third_solid_lost_is_said():
    view = scenes.camera(eye=(3.0, -5.0, 4.0))
    mesh = scenes.box((1.0, 1.0, 1.0))
    places = [(-0.5, -0.5, 0), (0.5, -0.5, 0), (0.0, 0.5, 0)]
    what = scenes.scene(
        [mesh], [scenes.place(0, at=at) for at in places], view=view, layout="scene"
    )
    made = plan.make(what, Cache(), leapray.Watch(), 1)
    (row,) = made.volumes
    assert row["samples_dropped"] > 0
    assert any("more than two objects" in warning for warning in made.warnings)


@pytest.mark.parametrize("unseen", [(0, 1), (0,), ()])
def test_what_no_object_shows_the_scenes_volume_does_not_show(unseen):
    """Where objects differ, the ray visibility does not count, and a warning says so."""
    lit = model.World((0.5, 0.5, 0.5))  # which looks at everything, so that nothing is left out
    whole = dataclasses.replace(boxes(samples=1), world=lit)
    placed = [
        dataclasses.replace(each, visible_camera=number not in unseen)
        for number, each in enumerate(whole.instances)
    ]
    frame = pipeline.render(dataclasses.replace(whole, instances=tuple(placed)))
    index = frame.passes["Object Index"]
    assert (len(unseen) < 2) == bool((index > 0).any())
    warned = any("does not count" in warning for warning in frame.warnings)
    assert warned == (len(unseen) == 1)
