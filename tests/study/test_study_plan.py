# SPDX-License-Identifier: GPL-3.0-or-later
"""The studies of pictures against meshes and of the plan against one voxel size."""

import argparse
import json
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("matplotlib")
pytest.importorskip("embreex")

from addon import pipeline
from addon.study import meshes, plan, scenes


@pytest.fixture(scope="module")
def ball():
    """A coarse sphere of radius 1 before a small camera, and a smaller one far to the side."""
    mesh = scenes.scan(8)
    points = mesh.vertices / np.linalg.norm(mesh.vertices, axis=1, keepdims=True)
    mesh = replace(mesh, vertices=points.astype(np.float32))
    scene = scenes.looked_at(mesh, (0, -5, 0), (0, 0, 0), 120, 80, angle=0.9)
    aside = np.diag([0.2, 0.2, 0.2, 1.0])
    aside[:3, 3] = 1.5, 0.0, 0.5
    other = replace(scene.instances[0], name="Aside", world_from_object=aside)
    return scenes.numbered(replace(scene, instances=(*scene.instances, other)))


def test_the_truth_is_where_the_sphere_is(ball):
    want = scenes.truth(ball)
    assert set(np.unique(want.index)) == {0, 1, 2}
    seen = want.index == 1
    np.testing.assert_allclose(np.linalg.norm(want.position[seen], axis=1), 1, atol=0.02)
    np.testing.assert_allclose(want.position[seen][:, 1] + 5, want.depth[seen], atol=1e-5)
    outward = (want.normal[seen] * want.position[seen]).sum(axis=1)
    assert outward.min() > 0.97
    height, width = want.index.shape
    assert want.index[height // 2, width // 2] == 1
    assert 0.5 * width < np.argwhere(want.index == 2)[:, 1].mean()  # to the right
    assert 0.5 * height < np.argwhere(want.index == 2)[:, 0].mean()  # and up


def test_a_scan_is_closed_and_rough():
    mesh = scenes.scan(20)
    assert len(mesh.triangles) == 12 * 20**2
    edges = np.sort(mesh.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    _, count = np.unique(edges, axis=0, return_counts=True)
    assert set(count) == {2}
    corners = mesh.vertices[mesh.triangles].astype(float)
    volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    assert 3 < volume < 6  # and its triangles face outwards
    assert np.ptp(np.linalg.norm(mesh.vertices, axis=1)) > 0.3


def test_a_picture_is_near_its_mesh_and_a_shift_is_seen(ball):
    want, frame = scenes.truth(ball), pipeline.render(ball)
    found = scenes.difference(ball, want, frame.passes)
    assert found.agreeing > 1000 and found.edges > 100
    assert found.error_99 < 0.25 and found.mismatch_share < 0.1 and found.far == 0
    shifted = dict(frame.passes)
    shifted["Depth"] = frame.passes["Depth"] + 0.05
    shifted["Object Index"] = np.roll(frame.passes["Object Index"], 5, axis=1)
    worse = scenes.difference(ball, want, shifted)
    footprint = 2 * np.tan(0.45) / 120 * 4.5
    assert 0.5 * 0.05 / footprint < worse.error_50 < 1.1 * 0.05 / footprint
    assert worse.mismatch > 10 * found.mismatch and worse.far > 100


def test_a_scene_that_asks_for_no_passes_gets_those_of_the_study(ball):
    frame = pipeline.render(scenes.numbered(replace(ball, passes=("Combined",))))
    assert set(frame.passes) >= set(scenes.PASSES)
    assert set(np.unique(frame.passes["Object Index"])) == {0, 1, 2}


def test_one_voxel_size_is_that_of_the_world_and_finer_is_better(ball):
    want = scenes.truth(ball)
    rows = []
    for size in (0.25, 0.0625):
        frame = pipeline.render(ball, planner=plan.uniform(size))
        assert [row["voxel_size"] for row in frame.report["volumes"]] == [size]
        rows.append(plan.judge("uniform", size, ball, want, planner=plan.uniform(size)))
    assert rows[1].error_99 < 0.2 * rows[0].error_99
    assert rows[1].bytes > 2 * rows[0].bytes
    planned = plan.judge("plan", 0.25, ball, want)
    finest, reached = plan.best([*rows, planned], "error_99")
    assert finest == rows[1] and reached in (None, planned)


def test_uniform_sizes_end_with_the_memory(ball):
    small = replace(ball, settings=replace(ball.settings, memory_mb=1))
    rows = plan.measure(small)
    kinds = [row.kind for row in rows]
    assert 2 <= kinds.count("uniform") < plan.HALVINGS
    assert kinds.count("plan") == len(plan.PIXEL_ERRORS)
    assert max(row.bytes for row in rows) <= 2**20
    sizes = [row.asked for row in rows if row.kind == "uniform"]
    assert sizes[0] == pytest.approx(plan.extent(small) / 16)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["plan", "meshes"])
def test_a_quick_study_writes_what_it_promises(name, tmp_path):
    study = {"plan": plan, "meshes": meshes}[name]
    output = tmp_path / "made"
    args = {"percentage": 15, "scan": 20, "memory": 64}
    assert study.main(argparse.Namespace(output=output, quick=True, **args)) == 0
    names = {f"{name}.{ending}" for ending in ("csv", "json", "html", "svg", "png")}
    if name == "meshes":
        names |= {f"errors-{scene}.png" for scene in (*meshes.SCENES, "scan-like")}
    assert {path.name for path in output.iterdir()} == names
    rows = json.loads((output / f"{name}.json").read_text())["rows"]
    assert all(0 <= row["error_50"] <= row["error_99"] for row in rows)
    if name == "meshes":
        assert max(row["error_99"] for row in rows) < 1
