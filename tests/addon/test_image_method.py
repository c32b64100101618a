# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures by the core's whole-image methods: the cells that traced rays meet, and what is said of
all that they do not show."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import scenes
from numpy.testing import assert_allclose, assert_array_equal

import leapray
from addon import film, image_method, methods, model, pipeline
from addon.plan import plan
from addon.store.memory_cache import Cache
from leapray.scalar_grid import ScalarGrid

WIDTH, HEIGHT = 96, 64
METHODS = leapray.image_methods()
EXACT = [entry for entry in leapray.image_variants() if entry.exact]
PASSES = "Combined", "Depth", "Position", "Object Index", "Material Index", "Volume"
PROJECTIONS = {"perspective": None, "orthographic": 4.0}


def spec_of(entry):
    return entry.spec


def turned(axis, angle):
    axis = np.asarray(axis, float) / np.linalg.norm(axis)
    k = np.cross(np.eye(3), axis)
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


def placed(mesh, at, linear, **more):
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = linear, at
    return dataclasses.replace(scenes.place(mesh, **more), world_from_object=matrix)


def two(kind="perspective", **settings):
    """A ball, and a box that is turned and stretched before a part of it."""
    meshes = [scenes.sphere(n=12), scenes.box((0.8, 0.8, 0.8))]
    things = [
        placed(0, (0, 0, 0), turned((1, 2, 3), 0.7), object_index=1),
        placed(
            1, (0.8, -1.4, 0.3), turned((0, 1, 1), 0.5) @ np.diag([1.0, 2.0, 0.6]),
            object_index=2, materials=(1,),
        ),
    ]  # fmt: skip
    view = scenes.camera(eye=(0.5, -6, 2), width=WIDTH, height=HEIGHT, scale=PROJECTIONS[kind])
    made = scenes.scene(meshes, things, view=view, resolution=40, **settings)
    return dataclasses.replace(made, passes=PASSES)


def kinds(entry):
    return PROJECTIONS if entry.perspective else ["orthographic"]


def all_kinds(entries):
    return [pytest.param(e, kind, id=f"{e.spec}-{kind}") for e in entries for kind in kinds(e)]


def traced(scene):
    """Depth and object index of the first object cells, ray by ray through every instance."""
    planned = plan.make(scene, Cache(), leapray.Watch(), 1)
    t, index = np.full(WIDTH * HEIGHT, np.inf), np.zeros(WIDTH * HEIGHT)
    for instance in planned.instances:
        own = film.camera_in(scene.camera, instance.world_from_object)
        hits = leapray.trace(
            leapray.build(instance.structure.volume, "aw"),
            *leapray.camera_rays(own, WIDTH, HEIGHT),
            t_min=own.clip_start,
            t_max=own.clip_end,
            mode="binary",
        )
        nearer = hits.t < t
        t[nearer], index[nearer] = hits.t[nearer], instance.object_index
    return t.reshape(HEIGHT, WIDTH), index.reshape(HEIGHT, WIDTH)


# ---- what is seen -------------------------------------------------------------------


@pytest.mark.parametrize(("entry", "kind"), all_kinds(EXACT))
def test_exact_methods_show_the_cells_that_traced_rays_meet_first(entry, kind):
    scene = two(kind, method=entry.spec)
    want, index = traced(scene)
    passes = pipeline.render(scene).passes
    depth = np.where(np.isfinite(want), want, film.FAR).astype(np.float32)
    assert_array_equal(passes["Depth"][..., 0], depth)
    assert_array_equal(passes["Object Index"][..., 0], index)
    assert (index == 1).sum() > 300 and (index == 2).sum() > 100
    seen = index == 1
    radius = np.linalg.norm(passes["Position"][seen], axis=1)
    assert np.abs(radius - 1).max() < 0.15  # cells of 0.065, their corners, the ramp


@pytest.mark.parametrize(("entry", "kind"), all_kinds(e for e in METHODS if not e.exact))
def test_inexact_methods_show_neighbouring_cells(entry, kind):
    scene = two(kind, method=entry.spec)
    want, index = traced(scene)
    passes = pipeline.render(scene).passes
    both = (passes["Object Index"][..., 0] == index) & (index > 0)
    assert both.sum() > 0.95 * (index > 0).sum()
    off = np.abs(passes["Depth"][..., 0] - want)[both]
    voxel = 2.6 / 40  # of the ball, about
    assert np.quantile(off, 0.9) < 2 * voxel and (off > voxel / 10).mean() > 0.02


def test_what_is_shown_is_shaded_by_depth_in_the_materials_color():
    scene = two(method="octree_projection")
    frame = pipeline.render(scene)
    picture, depth = frame.passes["Combined"], frame.passes["Depth"][..., 0]
    index = frame.passes["Object Index"][..., 0]
    assert (picture[index == 0] == np.float32([0.1, 0.1, 0.1, 1.0])).all()
    for number, color in ((1, (0.8, 0.8, 0.8)), (2, (0.8, 0.1, 0.1))):
        seen = index == number
        share = picture[seen][:, :3] / color
        assert_allclose(share, share[:, :1] * np.ones(3), rtol=1e-5)
        assert np.corrcoef(share[:, 0], depth[seen])[0, 1] < -0.999
    assert picture[index > 0][:, 0].min() > 0 and picture[..., :3].max() <= 0.8


def test_cells_of_a_mesh_with_several_materials_have_their_colors():
    mesh = scenes.box((1.0, 1.0, 1.0), turn=0.4)
    slots = np.where(mesh.vertices[mesh.triangles].mean(axis=1)[:, 2] > 0, 1, 0)
    mesh = dataclasses.replace(mesh, slots=slots.astype(np.uint16))
    scene = scenes.scene([mesh], [scenes.place(0, materials=(0, 1))], method="octree_projection",
                         view=scenes.camera(eye=(0, -4, 1)), resolution=160)  # fmt: skip
    scene = dataclasses.replace(scene, passes=PASSES)
    passes = pipeline.render(scene).passes
    seen = passes["Object Index"].shape and passes["Depth"][..., 0] < film.FAR
    red = passes["Combined"][..., 0] > 2 * passes["Combined"][..., 1]
    want = pipeline.render(scenes.replace(scene, method="rays")).passes["Combined"]
    truly = want[..., 0] > 2 * want[..., 1]
    assert truly.sum() > 100 and (~truly & seen).sum() > 100
    assert (red == truly)[seen].mean() > 0.97


def test_nearer_instances_hide_others_and_holdouts_cut_holes():
    scene = two(method="octree_projection")
    ball, box = scene.instances
    held = dataclasses.replace(box, holdout=True)
    passes = pipeline.render(dataclasses.replace(scene, instances=(ball, held))).passes
    index = passes["Object Index"][..., 0]
    assert (passes["Combined"][index == 2] == 0).all() and (index == 2).sum() > 100
    hidden = dataclasses.replace(box, visible_camera=False)
    index = pipeline.render(dataclasses.replace(scene, instances=(ball, hidden))).passes[
        "Object Index"
    ]
    assert not (index == 2).any()


def test_a_transparent_film_has_alpha_where_nothing_is_seen():
    scene = dataclasses.replace(two(method="leaping"), film_transparent=True)
    passes = pipeline.render(scene).passes
    seen = passes["Object Index"][..., 0] > 0
    assert_array_equal(passes["Combined"][..., 3], seen)
    assert (passes["Combined"][~seen] == 0).all()


def test_discrete_rays_have_the_light_of_suns_and_points_in_any_place():
    """A ball under a light, moved, turned and scaled evenly: as a Lambertian ball of rays."""
    point = model.Light("point", (40.0, 40.0, 40.0), position=(2.0, -4.0, 3.0), name="Point")
    sun = model.Light("sun", (2.0, 2.0, 2.0), direction=(0.0, -0.6, 0.8), name="Sun")
    linear = 0.7 * turned((1, 1, 0), 1.1)
    scene = scenes.scene(
        [scenes.sphere(n=24)], [placed(0, (0.3, 0.2, 0.1), linear)], lights=(point, sun),
        view=scenes.camera(eye=(0, -4, 1)), resolution=90, method="discrete",
    )  # fmt: skip
    scene = dataclasses.replace(scene, world=model.World(), passes=("Combined", "Normal"))
    got = pipeline.render(scene).passes
    want = pipeline.render(scenes.replace(scene, method="rays")).passes
    seen = want["Combined"][..., 0] > 0.5 * want["Combined"][..., 0].max()  # not grazing
    assert seen.sum() > 300
    ratio = got["Combined"][seen][:, :3] / want["Combined"][seen][:, :3]
    assert abs(np.median(ratio) - 1) < 0.01  # no bias of the lights; voxels' normals scatter it
    assert np.median(np.abs(ratio - 1)) < 0.04
    assert np.median((got["Normal"] * want["Normal"]).sum(axis=-1)[seen]) > np.cos(np.radians(2))


def test_solids_cast_shadows_on_each_other_in_layout_scene_alone():
    """A ball below a lamp, over a slab."""
    lamp = model.Light("point", (90.0, 90.0, 90.0), position=(0.0, 0.0, 4.0), name="Lamp")
    scene = scenes.scene(
        [scenes.sphere(n=12), scenes.box((5.0, 5.0, 0.5))],
        [scenes.place(0, scale=0.6), scenes.place(1, at=(0, 0, -1.5), object_index=2)],
        lights=(lamp,), view=scenes.camera(eye=(0, -6, 4)), resolution=100, method="discrete",
    )  # fmt: skip
    scene = dataclasses.replace(scene, world=model.World(), passes=PASSES)
    dark = {}
    for layout in ("objects", "scene"):
        frame = pipeline.render(scenes.replace(scene, layout=layout))
        at = frame.passes["Position"]
        below = (np.linalg.norm(at[..., :2], axis=-1) < 0.6) & (abs(at[..., 2] + 1.25) < 0.1)
        assert below.sum() > 50
        dark[layout] = (frame.passes["Combined"][below][:, 0] < 0.01).mean()
        assert any("cast no shadows" in w for w in frame.warnings) == (layout == "objects")
    assert dark["objects"] < 0.05 and dark["scene"] > 0.9


# ---- what is said ---------------------------------------------------------------------


@pytest.mark.parametrize("entry", [e for e in METHODS if not e.perspective], ids=spec_of)
def test_methods_of_parallel_rays_refuse_a_perspective_camera_before_work_begins(entry):
    scene = dataclasses.replace(two(method=entry.spec), meshes=())  # which none looks at
    with pytest.raises(leapray.LeapRayError) as error:
        pipeline.render(scene)
    assert str(error.value) == (
        f"The render method {entry.spec} counts on parallel rays: the camera must be orthographic"
    )


def test_an_unknown_method_is_answered_by_those_that_there_are():
    with pytest.raises(leapray.LeapRayError, match="unknown render method 'sketch'") as error:
        pipeline.render(two(method="sketch"))
    for name in ("rays", *(e.name for e in METHODS), *(m.spec for m in methods.PROJECTIONS)):
        assert name in str(error.value)
    with pytest.raises(leapray.LeapRayError, match=r"leaping has walk=spheres\|cells, not 'w=1'"):
        pipeline.render(two(method="leaping:w=1"))


def test_the_menu_has_the_cores_methods_below_what_they_promise():
    shown = list(methods.choices())
    heads = [n for n, each in enumerate(shown) if not each.name]
    assert [shown[n].label for n in heads] == [
        "Light", "First Cells", "First Cells, Inexact", "Projections",
    ]  # fmt: skip
    exact = {entry.spec: entry.exact for entry in leapray.image_variants()}
    assert set(exact) < {each.name for each in shown}
    for n, each in enumerate(shown):
        assert each.name not in exact or exact[each.name] == (n < heads[2])
        assert not each.name or methods.find(each.name).spec == each.name


def test_a_pixels_paths_are_those_of_rays_alone():
    for method in ("leaping", "octree_projection"):
        with pytest.raises(leapray.LeapRayError, match=f"of the render method rays, .* {method}$"):
            pipeline.render(two(method=method), pixel=(3, 4))


def told(**changes):
    """The warnings of a picture by discrete rays."""
    scene = dataclasses.replace(two(method="discrete"), world=model.World(), **changes)
    ball, _ = scene.instances
    alone = dataclasses.replace(scene, instances=(ball,))
    return pipeline.render(alone).warnings


def test_what_a_method_shows_truly_needs_no_warning():
    assert told() == []
    assert pipeline.render(two(method="leaping")).warnings == []


def test_what_materials_and_lights_ask_for_in_vain_is_named_once():
    glass = model.Material("Pane", (model.Lobe("glass"),))
    red = model.Material("Red", (model.Lobe("diffuse", (1, 0, 0)),))
    (warning,) = told(materials=(glass, red))
    assert warning.endswith("without what 'Pane' mirrors, lets through or emits.")
    area = model.Light("area", (1, 1, 1), axis_u=(1, 0, 0), axis_v=(0, 1, 0), name="Panel")
    soft = model.Light("sun", (1, 1, 1), angle=0.1, name="Sun")
    assert told(lights=(area, soft)) == [
        "The render method discrete has light of up to 32 suns and points, and none of 'Panel'.",
        "The render method discrete gives hard shadows to 'Sun'.",
    ]
    words = " ".join(pipeline.render(two(method="discrete", samples=4)).warnings)
    assert "not 4 samples" in words and "no light of the world" in words
    assert "cast no shadows on each other" in words
    assert "'Object 1' as without its scale" in words and "'Object 0'" not in words


def test_passes_that_no_cell_has_are_named():
    scene = dataclasses.replace(two(method="leaping"), passes=("Combined", "Mist", "Normal"))
    frame = pipeline.render(scene)
    assert frame.warnings == ["The render method leaping does not make the passes Mist, Normal."]
    assert set(frame.passes) == {"Combined"}


def test_cells_are_made_about_as_small_as_pixels_where_no_resolution_is_given():
    """Of a floor rays need no small voxels, but its cells are seen."""
    floor = scenes.scene([scenes.plane(8.0)], view=scenes.camera(eye=(0, -6, 2)), method="leaping")
    frame = pipeline.render(floor)
    (row,) = frame.report["volumes"]
    assert row["voxel_footprints"] <= image_method.CELL and frame.warnings == [
        "The render method leaping does not make the passes Normal."
    ]
    rays = pipeline.render(scenes.replace(floor, method="rays"))
    assert rays.report["volumes"][0]["voxel_footprints"] > 4
    coarse = pipeline.render(scenes.replace(floor, resolution=16)).warnings
    assert "are seen as large as" in coarse[-1] and "'Object 0'" in coarse[-1]


def test_what_is_prepared_stays_within_the_memory_budget(monkeypatch):
    monkeypatch.setattr(image_method, "MB", 1 << 10)
    scene = two(method="leaping", memory_mb=64)
    with pytest.raises(leapray.LeapRayError, match=r"leaping prepares the scene needs \d+ MB"):
        pipeline.render(scene)


# ---- measured data -----------------------------------------------------------------------


def ball_of_data(**more):
    """A field that is above 0.5 in a ball of radius 1, and where it is placed."""
    n, voxel = 40, 2.6 / 39
    axis = (np.arange(n) - (n - 1) / 2) * voxel
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    values = (1.5 - np.sqrt(x * x + y * y + z * z)).astype(np.float32)
    matrix = np.diag([voxel] * 3 + [1.0])
    matrix[:3, 3] = axis[0]
    data = model.Field("Ball", ScalarGrid("ball", values, matrix), "ball", (0.5,), **more)
    return data, model.FieldInstance(
        name="Scan", world_from_object=np.eye(4), materials=(1,), field=0, object_index=4
    )


def with_data(**more):
    data, instance = ball_of_data(**more)
    scene = scenes.scene([], [], view=scenes.camera(scale=4.0), method="octree_projection")
    return dataclasses.replace(scene, fields=(data,), field_instances=(instance,), passes=PASSES)


def test_surfaces_of_measured_data_are_seen_by_their_cells():
    passes = pipeline.render(with_data()).passes
    seen = passes["Object Index"][..., 0] == 4
    radius = np.linalg.norm(passes["Position"][seen], axis=1)
    assert seen.sum() > 1000 and np.abs(radius - 1).max() < 2 * 2.6 / 39
    assert (passes["Combined"][seen][:, 0] > 5 * passes["Combined"][seen][:, 1]).all()  # red


def test_data_that_have_no_cells_are_left_out_with_the_reason():
    frame = pipeline.render(with_data(interpolation="cubic"))
    (warning,) = frame.warnings
    assert warning.startswith("'Scan' is left out: ") and "this volume is cubic" in warning
    look = model.Look(lambda v: np.ones((len(v), 3)), lambda v: np.zeros((len(v), 3)))
    frame = pipeline.render(with_data(look=look))
    assert any("'Scan' is left out: the volume has a transfer" in w for w in frame.warnings)
    assert (frame.passes["Object Index"] == 0).all()


def test_what_cuts_data_is_named_and_its_own_faces_are_left_out():
    clip = model.Clip("Knife", None, np.eye(4))
    frame = pipeline.render(with_data(clip=clip))
    whole = pipeline.render(with_data())
    assert "The render method octree_projection does not cut 'Scan'." in frame.warnings
    assert_array_equal(frame.passes["Depth"], whole.passes["Depth"])


# ---- frames ---------------------------------------------------------------------------


def orbit(k, **settings):
    angle = np.radians(0.05 * k)
    eye = (6 * np.sin(angle), -6 * np.cos(angle), 1.0)
    return dataclasses.replace(
        two(**settings), camera=scenes.camera(eye=eye, width=WIDTH, height=HEIGHT)
    )


@pytest.mark.parametrize("spec", [e.spec for e in leapray.image_variants() if e.frames])
def test_frames_that_use_the_one_before_are_those_from_scratch(spec):
    cache, skipped = Cache(), []
    for k in range(6):
        scene = orbit(k, method=spec)
        frame = pipeline.render(scene, cache=cache)
        scratch = pipeline.render(scene)
        for name, values in scratch.passes.items():
            assert_array_equal(frame.passes[name], values, name)
        skipped.append(frame.report["skipped_share"])
        assert scratch.report["skipped_share"] == 0
        assert frame.report["cells"] <= 1.2 * scratch.report["cells"]
    assert skipped[0] == 0 and min(skipped[1:]) > 0.05
    assert frame.report["method"] == spec and frame.report["bytes"]["method"] > 0


def test_things_that_move_are_where_they_are():
    """Objects turn below a still camera, one of two that share a volume goes away."""
    cache = Cache()
    for k in range(6):
        base = two(method="leaping")
        ball, box = base.instances
        other = placed(1, (-0.9, -1.2 + 0.02 * k, 0.2), turned((0, 0, 1), 0.01 * k), name="Other",
                       object_index=3)  # fmt: skip
        things = (ball, box, other) if k != 3 else (ball, other)
        scene = dataclasses.replace(base, instances=things)
        got = pipeline.render(scene, cache=cache).passes
        want = pipeline.render(scene).passes
        for name, values in want.items():
            assert_array_equal(got[name], values, name)


def test_what_was_prepared_serves_the_next_frame():
    cache, made = Cache(), []
    for _ in range(2):
        scene = two("orthographic", method="pixel_skip")
        painter = []
        original = image_method.ImagePainter._job

        def counted(self, *words, found=painter, original=original):
            found.append(words)
            return original(self, *words)

        image_method.ImagePainter._job = counted
        try:
            pipeline.render(scene, cache=cache)
        finally:
            image_method.ImagePainter._job = original
        made.append(len(painter))
    assert made == [2, 0]


# ---- clean ends -----------------------------------------------------------------------


def test_a_stop_ends_it_and_tiles_arrive_while_it_works():
    arrived = []
    scene = dataclasses.replace(two(method="leaping", tile_size=16, threads=2), width=WIDTH)
    pipeline.render(scene, on_tile=lambda *words: arrived.append(words[:4]))
    assert len(arrived) == 4 and sum(w * h for _, _, w, h in arrived) == WIDTH * HEIGHT
    with pytest.raises(leapray.Stopped):
        pipeline.render(scene, stop=lambda: True)


def test_layout_scene_gives_one_volume_in_which_objects_keep_their_indices():
    scene = scenes.replace(two(method="octree_projection", layout="scene"), resolution=160)
    index = pipeline.render(scene).passes["Object Index"][..., 0]
    scene = scenes.replace(scene, layout="objects")
    want = pipeline.render(scene).passes["Object Index"][..., 0]
    assert (index == want).mean() > 0.97 and set(np.unique(index)) == {0, 1, 2}
