# SPDX-License-Identifier: GPL-3.0-or-later
"""The plan chooses the least that keeps the error small, and says what it did."""

from __future__ import annotations

import dataclasses
import json
import re

import meshes
import numpy as np
import pytest
import scenes

import leapray
from addon import model
from addon.plan import error_metric, objects, plan, probes
from addon.store.memory_cache import Cache
from leapray.voxelization import SPARE


def make(scene, cache=None):
    return plan.make(scene, Cache() if cache is None else cache, leapray.Watch(), 1)


class Calls(list):
    def __init__(self):
        self.faces = []

    def clear(self):
        super().clear()
        self.faces.clear()


@pytest.fixture
def calls(monkeypatch):
    """The voxel sizes that were asked for; .faces, the meshes' numbers of triangles."""
    sizes = Calls()
    voxelize = leapray.voxelize

    def counted(vertices, triangles, voxel_size, **more):
        sizes.append(voxel_size)
        sizes.faces.append(len(triangles))
        return voxelize(vertices, triangles, voxel_size, **more)

    monkeypatch.setattr(leapray, "voxelize", counted)
    return sizes


# ---- probes ---------------------------------------------------------------------


def test_probes_lie_on_the_surface_evenly():
    p = probes.draw(scenes.sphere(n=48))
    r = np.linalg.norm(p.surface, axis=1)
    assert r.max() < 1 + 1e-6 and r.min() > 1 - 5e-4
    assert p.area == pytest.approx(4 * np.pi, rel=1e-3)
    # Archimedes: uniform by area is uniform along any axis; 8192 draws stay within 1 %
    fraction = [(p.surface[:, axis] < 0.5).mean() for axis in range(3)]
    np.testing.assert_allclose(fraction, 0.75, atol=0.01)
    outward = np.einsum("nc,nc->n", p.surface, p.surface_normals)
    assert outward.min() > 0.999
    assert len(p.creases) == 0


def test_creases_are_the_sharp_edges():
    closed, flat = probes.draw(scenes.box()), probes.draw(scenes.plane(2.0))
    assert closed.crease_length == pytest.approx(24.0)
    assert (np.isclose(np.abs(closed.creases), 1.0).sum(axis=1) >= 2).all()
    assert len(flat.creases) == 0


def test_corners_at_one_place_are_welded():
    mesh = scenes.box()
    split = dataclasses.replace(
        mesh,
        vertices=mesh.vertices[mesh.triangles].reshape(-1, 3) * np.float32(1),
        triangles=np.arange(mesh.triangles.size, dtype=np.int32).reshape(-1, 3),
    )
    assert probes.draw(split).crease_length == pytest.approx(24.0)


def test_footprints_follow_depth_and_scale():
    width = 100
    view = scenes.camera(eye=(0, -10, 0), width=width, height=width, fov=2 * np.arctan(0.5))
    at = np.array([[0.0, 0.0, 0.0], [1.0, 10.0, 2.0], [0.0, -20.0, 0.0], [30.0, 0.0, 0.0]])
    footprint, _ = probes.look(view, at, width, width)
    seen = [10 / width, 20 / width]
    unseen = [probes.UNSEEN * 10 / width, probes.UNSEEN * np.hypot(30, 10) / width]
    np.testing.assert_allclose(footprint, [*seen, *unseen])

    scene = scenes.scene([scenes.sphere(n=8)], view=view, width=width, height=width)
    drawn = probes.draw(scene.meshes[0])

    def footprints(matrix):
        return probes.weigh(drawn, scene, np.array([matrix], float)).surface_footprint

    big, small = footprints(np.diag([0.2, 0.2, 0.2, 1])), footprints(np.diag([0.1, 0.1, 0.1, 1]))
    np.testing.assert_allclose(
        small / big, 2.0, rtol=0.03
    )  # half the size: a pixel is twice as much
    flat = footprints(np.diag([1.0, 1.0, 1e-3, 1]))
    top = np.abs(drawn.surface_normals[:, 2]) > 0.999
    assert (flat[top] > 50).all()  # along z, 1000 times flatter, a pixel is as much as ever 0.1


def test_a_mesh_is_as_fine_as_its_nearest_instance_asks():
    mesh = scenes.sphere(n=32)
    far = scenes.place(0, at=(0, 40, 0))
    near = scenes.place(0, at=(0, -2, 0))

    def row(instances):
        return make(scenes.scene([mesh], instances, pixel_error=0.02)).volumes[0]

    one, both, alone = row([far]), row([far] * 40 + [near]), row([near])
    assert both["voxel_size"] == alone["voxel_size"] < one["voxel_size"]
    assert both["instances"] == 41


def test_what_no_ray_meets_is_not_modelled_and_what_only_shades_is_coarser(by_voxels):
    hidden = {"visible_camera": False, "visible_diffuse": False}

    def rows(**more):
        scene = scenes.scene([scenes.sphere(n=32)], [scenes.place(**more)], pixel_error=0.02)
        return make(scene).volumes

    assert rows(**hidden, visible_shadow=False) == []
    assert rows(**hidden)[0]["voxel_size"] > rows()[0]["voxel_size"]


def test_each_instance_counts_as_it_is_shown():
    drawn, scene = probes.draw(scenes.box()), scenes.scene([scenes.box()])
    matrices = np.array([scenes.place(at=(x, 0, 0)).world_from_object for x in (-1, 0, 1)])
    shown = np.array([True, False, False])

    def footprints(which):
        found = probes.weigh(drawn, scene, matrices[which], shown[which])
        return found.surface_footprint, found.crease_footprint

    each = [footprints([k]) for k in range(3)]
    for kind, found in enumerate(footprints([0, 1, 2])):
        np.testing.assert_array_equal(found, np.min([one[kind] for one in each], axis=0))


def test_an_eye_on_the_surface_gives_numbers():
    view = scenes.camera(eye=(0, -1.0, 0))
    view = dataclasses.replace(view, clip_start=0.0)
    row = make(scenes.scene([scenes.sphere(n=8)], view=view, memory_mb=64)).volumes[0]
    assert all(np.isfinite(v) for v in row.values() if isinstance(v, float))


# ---- the error --------------------------------------------------------------------


@pytest.mark.parametrize("dtype", ["u16", "f32"])
@pytest.mark.parametrize("voxel_size", [0.125, 0.0625, 0.03125])
def test_the_measured_error_of_a_sphere_is_the_predicted_one(dtype, voxel_size):
    """Trilinear interpolation of a distance errs by h^2 / 4R at most, h^2 / 6R in the mean."""
    mesh = scenes.sphere(n=160)  # chords sink by 1.2e-5
    drawn = probes.draw(mesh)
    volume = leapray.voxelize(mesh.vertices, mesh.triangles, voxel_size, dtype=dtype, threads=1)
    error, lost = error_metric.measure_surface(
        volume, drawn.surface, drawn.surface_normals, voxel_size
    )
    assert not lost.any()
    # the second-order terms that the formula leaves out are h/R of it
    assert np.quantile(error, 0.99) == pytest.approx(voxel_size**2 / 4, rel=0.1 + voxel_size)
    assert error.mean() == pytest.approx(voxel_size**2 / 6, rel=0.05 + voxel_size)


def test_the_prediction_holds_for_hits():
    """What the plan says in footprints bounds the rays' error at the quantile that it names."""
    width = 480
    view = scenes.camera(width=width, height=width)
    scene = scenes.scene([scenes.sphere(n=160)], view=view, width=width, height=width)
    made = make(scene)
    structure = made.instances[0].structure
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(width) + 0.5)
    film = view.corner + x.reshape(-1, 1) * view.dx + y.reshape(-1, 1) * view.dy
    hits = leapray.trace(structure, np.broadcast_to(view.eye, film.shape), film)
    hit = np.isfinite(hits.t)
    assert hit.mean() > 0.1
    at = view.eye + hits.t[hit, None] * film[hit]
    error = np.abs(np.linalg.norm(at, axis=1) - 1)
    footprint = hits.t[hit] * np.linalg.norm(view.dx)
    said = made.volumes[0]["error_footprints"]
    assert said <= scene.settings.pixel_error
    assert np.quantile(error / footprint, 0.99) <= said
    assert np.quantile(error / footprint, 0.99) >= said / 2  # nor is it careless with memory


def test_thin_walls_are_found():
    """A plate thinner than a voxel has no sample inside: the error says so, triangles help."""
    view = scenes.camera(eye=(0, -3, 2), width=320, height=240)
    scene = scenes.scene([scenes.box((2, 2, 0.05), turn=0.3)], view=view, width=320, height=240)
    mesh, drawn = scene.meshes[0], probes.draw(scene.meshes[0])
    coarse = leapray.voxelize(mesh.vertices, mesh.triangles, 0.125, threads=1)
    _, lost = error_metric.measure_surface(coarse, drawn.surface, drawn.surface_normals, 0.125)
    assert lost.mean() > 0.5
    row = make(scene).volumes[0]
    assert row["exact_share"] > 0.9 and row["lost"] < 0.01 and row["nbytes"] < 1 << 20
    row = make(scenes.replace(scene, exact="sheets")).volumes[0]
    assert row["voxel_size"] <= 0.05 and row["lost"] < 0.01


def test_creases_ask_for_finer_voxels_than_their_faces(monkeypatch):
    monkeypatch.setattr(error_metric, "CREASE_VOXEL", np.inf)  # for their shape, not their look
    monkeypatch.setattr(error_metric, "SHARP_VOXEL", np.inf)
    turned, straight = (
        make(scenes.scene([scenes.box(turn=a)], exact="sheets", sample_type="u16")).volumes[0]
        for a in (0.4, 0.0)
    )
    assert turned["voxel_size"] < straight["voxel_size"]
    assert straight["crease_footprints"] < 0.01  # lattice planes hold its faces
    assert turned["crease_footprints"] <= error_metric.CREASE_ERROR


# ---- flat things --------------------------------------------------------------------


def test_a_flat_floor_stays_coarse():
    """Seen from above a person's height, 100 m of floor take less than 1 MB, rims and all."""
    view = scenes.camera(eye=(0, -6, 1.7), target=(0, 0, 1), width=960, height=540)
    row = make(scenes.scene([scenes.plane(100.0)], view=view, width=960, height=540)).volumes[0]
    assert row["kind"] == "sheet" and "4 border edges" in row["why"]
    assert row["error_footprints"] < 0.1
    assert row["nbytes"] < 1 << 20


def test_rims_end_where_the_mesh_ends_however_coarse():
    """Rays at either side of the rim, straight down; no finer voxels are needed for them."""
    near = scenes.camera(eye=(0, 0, 5), width=480, height=480)
    made = make(scenes.scene([scenes.plane(2.0, offset=0.03)], view=near, width=480, height=480))
    row = made.volumes[0]
    assert row["voxel_size"] > 3 * (5 * 2 * np.tan(0.35) / 480)
    along = np.random.default_rng(6).uniform(-1, 1, 1000)
    for beyond, found in ((-1e-6, True), (1e-6, False)):
        side = np.full(1000, 1 + beyond)
        at = np.concatenate([np.stack([along, side], 1), np.stack([-side, along], 1)])
        at += np.float32(1.03) - 1  # the offset, as corners have it
        at = np.column_stack([at, np.ones(len(at))])
        hits = leapray.trace(
            made.instances[0].structure, at, np.broadcast_to([0.0, 0.0, -1.0], at.shape)
        )
        assert (np.isfinite(hits.t) == found).all()


# ---- memory -----------------------------------------------------------------------------


def test_the_memory_budget_is_kept_and_the_error_reached_is_told():
    close = scenes.camera(eye=(0, -1.3, 0), width=1920, height=1080)
    scene = scenes.scene(
        [scenes.sphere(n=64), scenes.sphere(radius=0.3, n=16)],
        [scenes.place(0, name="Ball"), scenes.place(1, at=(1.5, 2, 0), name="Pea")],
        view=close,
        width=1920,
        height=1080,
        memory_mb=1,
        pixel_error=0.02,
    )
    made = make(scene)
    assert made.volume_nbytes + made.structure_nbytes <= 1 << 20
    assert made.peak_nbytes <= 1.05 * (1 << 20) + SPARE
    told = [w for w in made.warnings if "'Ball'" in w]
    assert len(told) == 1 and "memory" in told[0]
    reached = made.volumes[0]["error_footprints"]
    assert reached > 0.02 and f"{reached:.2g}" in told[0]
    more = make(scenes.replace(scene, memory_mb=64)).volumes[0]
    assert more["error_footprints"] < reached / 3  # h^2: at least one level


def test_the_budget_goes_where_it_is_seen():
    """Of two equal meshes the one that fills the image is the finer one when memory is short."""
    a, b = scenes.sphere(n=64), scenes.sphere(n=63)
    scene = scenes.scene(
        [a, b],
        [scenes.place(0, at=(0, -4, 0)), scenes.place(1, at=(2, 20, 0))],
        width=1920,
        height=1080,
        view=scenes.camera(width=1920, height=1080),
        memory_mb=6,
        pixel_error=0.01,
    )
    near, far = make(scene).volumes
    assert near["voxel_size"] < far["voxel_size"]


def test_too_little_memory_for_the_coarsest_level_is_one_sentence(monkeypatch):
    monkeypatch.setattr(plan, "COARSEST", 512)
    scene = scenes.scene([scenes.sphere()], [scenes.place(name="Giant")], memory_mb=1)
    with pytest.raises(objects.SceneError, match=r"'Giant'.* needs \d+ MB, budget is 1 MB"):
        make(scene)


def test_resolution_counts_samples():
    for n in (32, 57, 100):
        row = make(scenes.scene([scenes.box((3, 1, 2), turn=0.3)], resolution=n)).volumes[0]
        assert n - 2 <= max(row["size"]) <= n
    tiny = make(scenes.scene([scenes.box()], resolution=1)).volumes[0]
    assert max(tiny["size"]) < 12


# ---- the cache ------------------------------------------------------------------------------


def test_what_is_cached_is_not_voxelized_again(calls):
    cache = Cache()
    scene = scenes.scene([scenes.sphere(n=32), scenes.box(turn=0.3)])
    first = make(scene, cache)
    assert len(calls) > 2
    calls.clear()
    again = make(scene, cache)
    assert calls == [] and again.volumes == first.volumes
    moved = dataclasses.replace(scene, camera=scenes.camera(eye=(0.0, -5.9, 0.0)))
    assert make(moved, cache).volumes[0]["voxel_size"] == first.volumes[0]["voxel_size"]
    assert calls == []


def test_two_view_layers_share_the_cache(calls):
    cache = Cache()
    one, two = scenes.scene([scenes.sphere(n=32)]), scenes.scene([scenes.box(turn=0.3)])
    make(one, cache)
    make(two, cache)
    calls.clear()
    make(one, cache)
    make(two, cache)
    assert calls == []


def test_the_oldest_volumes_make_room_and_what_was_measured_on_them_goes_too():
    cache = Cache()
    radii = 1.0 + 0.05 * np.arange(8)
    given = {"memory_mb": 1, "pixel_error": 0.05, "sample_type": "u16"}
    spheres = [scenes.scene([scenes.sphere(r, n=32)], **given) for r in radii]
    peaks = [make(scene, cache).peak_nbytes for scene in spheres]
    assert max(peaks) <= (1 << 20) + SPARE
    held = sum(make(scene).volume_nbytes for scene in spheres)
    assert held > 1 << 20, "they would fit together: the test shows nothing"
    entries = len(cache)
    for scene in spheres:
        make(scene, cache)
    assert len(cache) <= entries + 4


def test_a_camera_that_draws_back_keeps_the_finer_volume(calls):
    cache = Cache()
    near = scenes.scene([scenes.sphere(n=32)], view=scenes.camera(eye=(0.0, -2.5, 0.0)))
    far = dataclasses.replace(near, camera=scenes.camera(eye=(0.0, -60.0, 0.0)))
    cold = make(far).volumes[0]
    first = make(near, cache).volumes[0]
    calls.clear()
    kept = make(far, cache).volumes[0]
    assert calls == []
    assert kept["voxel_size"] == first["voxel_size"] < cold["voxel_size"]


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_meshes_of_equal_contents_share_what_is_cached(calls, order):
    """And do not take it away from each other, where one is refined beyond the other."""
    cache = Cache()
    meshes = [scenes.sphere(n=32), scenes.sphere(n=32, name="Copy")]
    places = [scenes.place(0, at=(0, -3.5, 0)), scenes.place(1, at=(20, 400, 0))]
    scene = scenes.scene(meshes, [places[k] for k in order], pixel_error=0.05)
    alone = make(scenes.scene(meshes[:1], places[:1], pixel_error=0.05)).volumes[0]
    calls.clear()
    made = make(scene, cache)
    assert {row["name"]: row["voxel_size"] for row in made.volumes}["Object 0"] == alone[
        "voxel_size"
    ]
    calls.clear()
    again = make(scene, cache)
    assert calls == [] and len(again.instances) == 2


def test_an_edited_mesh_alone_is_voxelized_anew(calls):
    cache = Cache()
    meshes = [scenes.sphere(n=32), scenes.box(turn=0.3)]
    apart = [scenes.place(0), scenes.place(1, at=(4, 0, 0))]
    make(scenes.scene(meshes, apart), cache)
    calls.clear()
    edited = dataclasses.replace(meshes[1], vertices=meshes[1].vertices * np.float32(1.5))
    make(scenes.scene([meshes[0], edited], apart), cache)
    assert calls and calls.faces == [len(edited.triangles)] * len(calls)


# ---- kinds ----------------------------------------------------------------------------------


def test_a_kind_that_may_not_be_meant_is_a_warning_and_others_are_not():
    plain = [scenes.sphere(n=16), scenes.plane(), scenes.join((scenes.box(), (0, 0, 0)))]
    crossing = scenes.join((scenes.box(turn=0.3), (0, 0, 0)), (scenes.box(), (0.5, 0.5, 0.5)))
    for mesh in (*plain, crossing):
        assert not any("taken for" in warning for warning in make(scenes.scene([mesh])).warnings)
    triangles = scenes.box().triangles.copy()
    triangles[:2] = triangles[:2, ::-1]  # a face that looks inwards
    flipped = dataclasses.replace(scenes.box(name="Flipped"), triangles=triangles)
    made = make(scenes.scene([flipped]))
    doubts = [warning for warning in made.warnings if "taken for" in warning]
    assert len(doubts) == 1 and "disagree in winding" in doubts[0]
    asked = dataclasses.replace(flipped, modelling=model.Modelling(kind="solid"))
    made = make(scenes.scene([asked]))
    assert [row["kind"] for row in made.volumes] == ["solid"]
    assert not any("taken for" in warning for warning in made.warnings)


# ---- bad objects ----------------------------------------------------------------------------


def broken(name):
    mesh = scenes.box(name=name)
    if name in ("NaN", "Infinite"):  # Blender keeps the latter as the largest number there is
        vertices = mesh.vertices.copy()
        vertices[3, 1] = np.nan if name == "NaN" else np.finfo(np.float32).max
        return dataclasses.replace(mesh, vertices=vertices)
    if name == "Empty":
        return dataclasses.replace(mesh, triangles=np.zeros((0, 3), np.int32))
    if name == "Line":
        return dataclasses.replace(mesh, vertices=mesh.vertices * np.float32([1, 0, 0]))
    return dataclasses.replace(mesh, triangles=mesh.triangles + 1)


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("NaN", "not finite"),
        ("Infinite", "vertex 3 .* beyond"),
        ("Empty", "no faces"),
        ("Line", "area"),
        ("Beyond", "beyond"),
    ],
)
def test_bad_meshes_are_skipped_by_name(name, why):
    meshes = [broken(name), scenes.sphere(n=8)]
    placed = [scenes.place(0, name=name), scenes.place(1, name="Good")]
    made = make(scenes.scene(meshes, placed))
    assert [row["name"] for row in made.volumes] == ["Good"]
    assert len(made.warnings) == 1 and f"{name!r} is skipped" in made.warnings[0]
    assert re.search(why, made.warnings[0])
    with pytest.raises(objects.SceneError, match=f"Nothing is left to render.*{name}.*{why}"):
        make(scenes.scene(meshes[:1], placed[:1]))


@pytest.mark.parametrize("scale", [(1, 1, 0), (0, 0, 0), (1, np.nan, 1), (1, 1e-12, 1)])
def test_bad_matrices_are_skipped_by_name(scale):
    placed = [scenes.place(0, name="Flat", scale=scale), scenes.place(0, name="Good")]
    made = make(scenes.scene([scenes.sphere(n=8)], placed))
    assert len(made.instances) == 1
    assert "'Flat' is skipped" in made.warnings[0] and "matrix" in made.warnings[0]


def test_a_stray_vertex_far_away_spoils_no_other_mesh():
    stray = scenes.sphere(n=8, name="Stray")
    stray.vertices[0] = 0.9 * objects.FARTHEST, 0, 0
    scene = scenes.scene([scenes.sphere(n=8), stray], [scenes.place(0), scenes.place(1)])
    with np.errstate(over="raise", invalid="raise", divide="raise"):
        made = make(scene)
    assert {row["mesh"] for row in made.volumes} == {"Sphere", "Stray"}


def test_tiny_and_mirrored_objects_are_no_bad_ones():
    placed = [scenes.place(0, scale=1e-6), scenes.place(0, scale=(-1, 2, 1))]
    made = make(scenes.scene([scenes.sphere(n=8)], placed))
    assert len(made.instances) == 2 and made.warnings == []


@pytest.mark.parametrize("unit", [1e-12, 1e12])
def test_the_unit_of_a_mesh_does_not_matter(unit):
    mesh = scenes.box(turn=0.4)
    other = dataclasses.replace(mesh, vertices=mesh.vertices * np.float32(unit))
    first = make(scenes.scene([mesh])).volumes[0]
    made = make(scenes.scene([other], [scenes.place(0, scale=1 / unit)]))
    assert made.warnings == []
    row = made.volumes[0]
    assert 0.5 <= row["voxel_size"] / unit / first["voxel_size"] <= 2  # powers of two
    assert row["crease_footprints"] <= error_metric.CREASE_ERROR


# ---- one volume for all -----------------------------------------------------------------------


def test_layout_scene_makes_one_volume_that_tells_objects_and_materials_apart():
    meshes = [scenes.sphere(n=16), scenes.box()]
    placed = [
        scenes.place(0, at=(-1.5, 0, 0), object_index=3, materials=(1,)),
        scenes.place(1, at=(1.5, 0, 0), object_index=5, scale=(-0.5, 0.5, 0.5)),
    ]
    made = make(scenes.scene(meshes, placed, layout="scene"))
    assert len(made.instances) == len(made.volumes) == 1
    assert made.slots == [1, 0] and made.slot_objects == [3, 5]
    assert made.volumes[0]["kind"] == "solid"
    structure = made.instances[0].structure
    hits = leapray.trace(structure, [[-1.5, -9, 0], [1.5, -9, 0]], [[0, 1, 0]] * 2)
    assert list(hits.id) == [0, 1]
    np.testing.assert_allclose(hits.t, [8, 8.5], atol=0.02)


def test_the_report_is_plain_json():
    row = make(scenes.scene([scenes.sphere(n=8)])).volumes[0]
    assert json.loads(json.dumps(row)) == row


def test_corners_look_sharp(by_voxels):
    """A turned box is no voxels finer than it starts: its creases keep their triangles."""
    view = scenes.camera(eye=(2.0, -5.0, 2.0), width=320, height=240)
    box = scenes.divided(scenes.box(turn=0.5), 5)
    scene = scenes.scene([box], view=view, width=320, height=240)
    row = make(scene).volumes[0]
    assert row["kind"] == "solid" and 0.02 < row["exact_share"] < 0.9
    assert row["crease_footprints"] < 0.01 and row["crease_voxel_footprints"] == 0
    assert row["error_footprints"] < 0.1 and row["voxel_footprints"] > 2
    rounded = make(scenes.replace(scene, exact="sheets")).volumes[0]
    assert rounded["exact_share"] == 0 and rounded["nbytes"] > row["nbytes"]
    assert rounded["crease_footprints"] > 0.05
    assert 0.5 < rounded["crease_voxel_footprints"] <= error_metric.SHARP_VOXEL


# ---- thin things --------------------------------------------------------------------------------


def seen_from(view, made, width, height):
    """Which pixels' centres hit any of the plan's instances (all in world space)."""
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    film = (view.corner + x[..., None] * view.dx + y[..., None] * view.dy).reshape(-1, 3)
    eye = np.broadcast_to(view.eye, film.shape)
    t = np.min([leapray.trace(i.structure, eye, film).t for i in made.instances], axis=0)
    return np.isfinite(t).reshape(height, width), eye, film


@pytest.mark.parametrize("thickness", [0.004, 1e-5])
def test_paper_with_a_thickness_keeps_its_triangles(thickness):
    """No voxel of the budget is fine enough for its inside; it is hit to the pixel all the same."""
    width, height = 320, 240
    view = scenes.camera(eye=(0, -3.5, 2), width=width, height=height)
    scene = scenes.scene(
        [scenes.box((2, 2, thickness), turn=0.3)], view=view, width=width, height=height
    )
    made = make(scene)
    assert [row["kind"] for row in made.volumes] == ["solid"]
    assert made.volumes[0]["exact_share"] == 1 and made.volumes[0]["lost"] == 0
    assert made.volume_nbytes + made.structure_nbytes < 1 << 20
    hit, eye, film = seen_from(view, made, width, height)
    corners = scene.meshes[0].vertices.astype(float)
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    t = ((corners[0] - eye) @ normal) / (film @ normal)
    at = eye + t[:, None] * film - corners[:4].mean(axis=0)
    sides = [corners[1] - corners[0], corners[2] - corners[0]]
    farthest = np.max([np.abs(at @ s) / (s @ s) for s in sides], axis=0).reshape(height, width)
    assert hit[farthest < 0.4999].all() and (farthest < 0.49).sum() > 5000
    assert not hit[farthest > 0.5001 + thickness].any()


def test_a_thin_needle_is_found():
    """Nothing flat about it: voxels must go down to its thickness, though nothing shows before."""
    mesh = scenes.sphere(n=24)
    needle = dataclasses.replace(mesh, vertices=mesh.vertices * np.float32([1, 0.012, 0.012]))
    width, height = 480, 120
    view = scenes.camera(eye=(0, -3.2, 0), width=width, height=height)
    made = make(scenes.scene([needle], view=view, width=width, height=height))
    (row,) = made.volumes
    assert row["kind"] == "solid" and row["lost"] < error_metric.LOST_SHARE
    hit, _, _ = seen_from(view, made, width, height)
    columns = hit[:, 40:-40].sum(axis=0)
    assert (columns >= 1).all() and columns.mean() > 2


@pytest.mark.parametrize("minor", [0.004, 0.01, 0.03])
def test_a_wire_that_is_little_beside_a_ball_is_not_lost(minor):
    """Of one mesh: no quantile of its pixels tells of the wire, which has no crease."""
    wire = model.Mesh("Wire", *meshes.torus(96, 32, 0.9, minor))
    both = scenes.join((scenes.sphere(), (-1.3, 0.0, 0.0)), (wire, (1.3, 0.0, 0.0)))
    turned = np.eye(4)
    turned[1:3, 1:3] = [[0, -1], [1, 0]]  # the wire's axis towards the camera
    instance = dataclasses.replace(scenes.place(), world_from_object=turned)
    made = make(scenes.scene([both], [instance], width=480, height=270))
    angles = np.linspace(0, 2 * np.pi, 100)
    wire = np.stack([1.3 + 0.9 * np.cos(angles), 0 * angles, 0.9 * np.sin(angles)], axis=1)
    eye = np.array([0.0, -6.0, 0.0])
    back = np.linalg.inv(turned)[:3, :3]
    hits = leapray.trace(
        made.instances[0].structure, np.tile(eye @ back.T, (100, 1)), (wire - eye) @ back.T
    )
    assert np.abs(hits.t - 1).max() < 0.02
