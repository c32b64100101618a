# SPDX-License-Identifier: GPL-3.0-or-later
"""Samples of 8, 16 and 32 bits: made narrow in place, and chosen by what their steps cost."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import leapray
from addon import model, pipeline
from addon.plan import plan, sample_types
from addon.store.memory_cache import Cache
from tests import meshes, scenes

GAIN = 2.5 / 1.8
VOXEL = 1 / 16


def make(scene, cache=None):
    return plan.make(scene, Cache() if cache is None else cache, leapray.Watch(), 1)


def rays(n=4000, seed=7):
    """Towards points within a ball of radius 1.2, from a sphere of radius 4."""
    random = np.random.default_rng(seed)
    ends = random.normal(size=(2, n, 3))
    ends /= np.linalg.norm(ends, axis=2, keepdims=True)
    origins, targets = 4 * ends[0], 1.2 * random.random((n, 1)) * ends[1]
    return origins, targets - origins


def subjects():
    """Volumes with all that a brick can hold: a solid, a sheet, triangle cells, ids, colours."""
    ball, sheet = meshes.icosphere(4), meshes.half_sphere(24)
    crossed = meshes.box((-0.7, -0.7, -0.7), (0.71, 0.72, 0.73))
    ids = (np.arange(len(ball[1])) % 3).astype(np.uint16)
    normals = np.asarray(ball[0])[ball[1]].astype(np.float32)
    attributes = leapray.Attributes(normals=normals)
    yield "solid", leapray.voxelize(*ball, VOXEL, threads=1)
    yield "f32", leapray.voxelize(*ball, VOXEL, threads=1, dtype="f32")
    yield "sheet", leapray.voxelize(*sheet, VOXEL, threads=1)
    yield "exact", leapray.voxelize(*crossed, VOXEL, threads=1, exact="all")
    yield "dressed", leapray.voxelize(*ball, VOXEL, threads=1, ids=ids, attributes=attributes)
    yield (
        "merged",
        leapray.merge(
            [
                leapray.voxelize(*mesh, VOXEL, threads=1, ids=np.full(len(mesh[1]), n, np.uint16))
                for n, mesh in enumerate(
                    [
                        meshes.icosphere(3, 0.7, (0.2, 0, 0)),
                        meshes.icosphere(3, 0.6, (-0.4, 0.1, 0)),
                    ]
                )
            ]
        ),
    )


@pytest.mark.parametrize("name", ["solid", "f32", "sheet", "exact", "dressed", "merged"])
def test_narrow_samples_leave_cells_and_hits_where_they_are(name):
    volume = dict(subjects())[name]
    before = volume.info
    everything = (-1, -1, -1), tuple(n + 1 for n in before.size)
    cells = volume.read_surface(*everything)
    origins, directions = rays()
    wide = leapray.trace(leapray.build(volume), origins, directions, threads=1)
    points = wide.t[:, None] * directions + origins
    hit = np.isfinite(wide.t)
    assert hit.mean() > 0.3
    foreseen = volume.sample(points[hit], wide.id[hit] if before.n_objects else None, GAIN)
    colors = volume.attributes(points[hit], wide.id[hit])
    volume.narrow(GAIN)
    after = volume.info
    assert after.dtype == "u8" and after.nbytes < 0.85 * before.nbytes
    assert after.n_surface_cells == before.n_surface_cells
    np.testing.assert_array_equal(volume.read_surface(*everything), cells)
    found = volume.sample(points[hit], wide.id[hit] if before.n_objects else None)
    np.testing.assert_allclose(found[0], foreseen[0], atol=1e-12)
    np.testing.assert_allclose(found[1], foreseen[1], atol=1e-9)
    np.testing.assert_array_equal(volume.attributes(points[hit], wide.id[hit]), colors)
    narrow = leapray.trace(leapray.build(volume), origins, directions, threads=1)
    both = hit & np.isfinite(narrow.t)
    assert (np.isfinite(narrow.t) != hit).mean() < 2e-3  # at outlines
    assert (narrow.id[both] == wide.id[both]).mean() > 0.995
    cosine = np.abs(np.einsum("nc,nc->n", directions, wide.normal))[both]
    off = np.abs(narrow.t[both] - wide.t[both]) * cosine / VOXEL
    # half a step of 255 is 0.007 voxel; at creases the field's surface is not where its plane is
    assert np.quantile(off, 0.95) < 0.008, name


def test_narrow_samples_are_those_of_a_volume_made_so():
    mesh = meshes.icosphere(4)
    made = leapray.voxelize(*mesh, VOXEL, dtype="u8", threads=1)
    narrow = leapray.voxelize(*mesh, VOXEL, threads=1)
    narrow.narrow(GAIN)
    assert narrow.info.n_bricks == made.info.n_bricks and narrow.info.nbytes == made.info.nbytes
    offset = np.rint(
        (made.info.object_from_index - narrow.info.object_from_index)[:3, 3] / VOXEL
    ).astype(int)
    a, b = narrow.read(offset, made.info.size).astype(int), made.read().astype(int)
    assert np.abs(a - b).max() <= 1 and (a != b).mean() < 0.01  # rounded twice


def test_what_cannot_be_narrow_says_so():
    volume = leapray.voxelize(*meshes.icosphere(2), 0.25, dtype="u8", threads=1)
    with pytest.raises(leapray.LeapRayError, match="u16 or f32"):
        volume.narrow()
    with pytest.raises(leapray.LeapRayError, match="gain"):
        leapray.voxelize(*meshes.icosphere(2), 0.25, threads=1).narrow(-1.0)


# ---- the plan's choice ---------------------------------------------------------------


def test_the_plan_takes_8_bits_where_nobody_sees_it_and_keeps_the_error():
    wide, narrow = (
        make(scenes.scene([scenes.sphere()], sample_type=t)).volumes[0] for t in ("u16", "auto")
    )
    assert (wide["sample_type"], narrow["sample_type"]) == ("u16", "u8")
    assert narrow["voxel_size"] == wide["voxel_size"]
    assert narrow["volume_nbytes"] < 0.6 * wide["volume_nbytes"]
    assert narrow["error_footprints"] <= 0.25


def test_a_mirror_keeps_16_bits_unless_its_faces_lie_along_the_lattice():
    def types(*lobes):
        apart = [scenes.place(0), scenes.place(1, at=(4, 0, 0))]
        scene = scenes.scene([scenes.sphere(), scenes.box()], apart)
        material = dataclasses.replace(scene.materials[0], lobes=lobes)
        scene = dataclasses.replace(scene, materials=(material, scene.materials[1]))
        return [row["sample_type"] for row in make(scene).volumes]

    assert types(model.Lobe("glossy", roughness=0.0)) == ["u16", "u8"]
    assert types(model.Lobe("principled", roughness=0.1)) == ["u16", "u8"]
    assert types(model.Lobe("principled", roughness=0.1, specular=0.0)) == ["u8", "u8"]
    assert types(model.Lobe("glossy", roughness=0.5)) == ["u8", "u8"]


def test_a_mirror_takes_no_8_bits_that_another_object_left():
    cache, scene = Cache(), scenes.scene([scenes.sphere()])
    dull, mirror = scene.materials[0], model.Lobe("glossy", roughness=0.0)
    assert make(scene, cache).volumes[0]["sample_type"] == "u8"
    materials = dataclasses.replace(dull, lobes=(mirror,)), dull
    shining = dataclasses.replace(scene, materials=materials)
    assert make(shining, cache).volumes[0]["sample_type"] == "u16"
    both = [scenes.place(0, at=(x, 0, 0), materials=(m,)) for x, m in ((-1.2, 0), (1.2, 1))]
    assert (
        make(dataclasses.replace(shining, instances=tuple(both))).volumes[0]["sample_type"] == "u16"
    )


def test_normals_turn_as_foretold():
    volume = leapray.voxelize(*meshes.icosphere(5), VOXEL, threads=1)
    directions = np.random.default_rng(3).normal(size=(2000, 3))
    points = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    told = sample_types.turn(volume, points, VOXEL, GAIN)
    normals = []
    for _ in range(2):
        hits = leapray.trace(leapray.build(volume), 3 * points, -points, threads=1)
        normals.append(hits.normal)
        if volume.info.dtype != "u8":
            volume.narrow(GAIN)
    cosine = np.clip(np.einsum("nc,nc->n", *normals), -1, 1)
    assert 0.0005 < told < 0.004
    assert np.arccos(cosine).mean() == pytest.approx(told, rel=0.1)


def test_large_flat_floors_get_32_bits(by_voxels):
    """Close to it voxels are many thousand pixels wide: steps are seen."""
    eye = scenes.camera(eye=(0.3, -8.0, 0.4), target=(0.0, 0.0, 0.3), width=960, height=540)
    floor = scenes.divided(scenes.plane(1000.0), 6)
    scene = scenes.scene([floor], view=eye, width=960, height=540)
    rows = {t: make(scenes.replace(scene, sample_type=t)).volumes[0] for t in ("u16", "auto")}
    assert rows["auto"]["sample_type"] == "f32"
    assert rows["auto"]["error_footprints"] < 0.1 * rows["u16"]["error_footprints"]
    assert rows["auto"]["volume_nbytes"] < 60 * len(floor.triangles)


def test_where_memory_ends_8_bits_go_a_level_finer():
    def row(sample_type):
        given = {"memory_mb": 5, "pixel_error": 0.05, "sample_type": sample_type}
        planned = make(scenes.scene([scenes.sphere()], width=960, height=640, **given))
        assert planned.volume_nbytes + planned.structure_nbytes <= 5 << 20
        return planned.volumes[0]

    wide, chosen = row("u16"), row("auto")
    assert (wide["sample_type"], chosen["sample_type"]) == ("u16", "u8")
    assert chosen["voxel_size"] == wide["voxel_size"] / 2
    assert chosen["error_footprints"] < 0.05 < wide["error_footprints"]


def test_objects_and_settings_may_ask_for_a_type_of_their_own():
    ball = scenes.sphere()
    asked = dataclasses.replace(ball, modelling=model.Modelling(sample_type="f32"))
    scene = scenes.scene([ball, asked], sample_type="u16")
    assert [row["sample_type"] for row in make(scene).volumes] == ["u16", "f32"]
    fixed = make(scenes.scene([ball], resolution=48)).volumes[0]
    assert fixed["sample_type"] == "u16"  # what is asked for by size is not judged by errors


def test_the_next_frame_finds_8_bits_in_the_cache(monkeypatch):
    cache, scene = Cache(), scenes.scene([scenes.sphere(), scenes.box(turn=0.3)])
    first = make(scene, cache)
    assert {row["sample_type"] for row in first.volumes} == {"u8"}
    monkeypatch.setattr(leapray, "voxelize", None)
    assert make(scene, cache).volumes == first.volumes


def test_the_picture_does_not_show_it():
    scene = scenes.scene(
        [scenes.sphere(), scenes.plane(12.0)],
        [scenes.place(0), scenes.place(1, at=(0, 0, -1.0))],
        view=scenes.camera(eye=(0, -6, 1.5)), width=160, height=120,
    )  # fmt: skip
    wide, chosen = (
        pipeline.render(scenes.replace(scene, sample_type=t, samples=4)).passes
        for t in ("u16", "auto")
    )
    inner = wide["Object Index"] == chosen["Object Index"]
    assert inner.mean() > 0.999
    off = np.abs(chosen["Combined"] - wide["Combined"]).max(axis=2)
    assert np.quantile(off, 0.99) < 0.005 and off.mean() < 0.001
