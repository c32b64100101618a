# SPDX-License-Identifier: GPL-3.0-or-later
"""The study of accuracy: its truth is true, finer is better, and the front is one."""

import argparse
import csv
import json

import numpy as np
import pytest

pytest.importorskip("matplotlib")
pytest.importorskip("embreex")

import leapray
from addon.study import accuracy, embree, shapes
from leapray.arrays import DTYPES, ONES
from leapray.voxelization import filter_info

pytestmark = pytest.mark.slow  # the studies run


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    output = tmp_path_factory.mktemp("accuracy") / "made"
    args = argparse.Namespace(output=output, quick=True, rays=400, sizes=(24, 48), crossed=(48,))
    assert accuracy.main(args) == 0
    return output


@pytest.fixture(scope="module")
def rows(made):
    return json.loads((made / "accuracy.json").read_text())["rows"]


def of(rows, size, **changed):
    """The rows of the defaults, by scene, but for what is changed."""
    want = {**vars(accuracy.default(size)), **changed}
    return {r["scene"]: r for r in rows if all(r[key] == value for key, value in want.items())}


def test_it_writes_what_it_promises(made, rows):
    drawn = {f"{n}.{e}" for n in ("accuracy", "resolution") for e in ("svg", "png")}
    tables = {"accuracy.csv", "accuracy.json", "accuracy.html"}
    assert {path.name for path in made.iterdir()} == drawn | tables
    assert len(list(csv.DictReader((made / "accuracy.csv").open()))) == len(rows)
    assert {r["traverser"] for r in rows} == {one.spec for one in leapray.variants()}
    assert {r["hit_test"] for r in rows} == set(leapray.HIT_TESTS)
    assert len({r["scene"] for r in rows}) == 5


def test_finer_samples_err_less(rows):
    coarse, fine = of(rows, 24), of(rows, 48)
    for scene in ("sphere", "torus", "box", "knot (mesh)"):
        assert fine[scene]["hit_99"] < coarse[scene]["hit_99"]
    for scene in ("sphere", "torus"):  # the error falls with the square of the voxel's side
        assert fine[scene]["hit_99"] < 0.5 * coarse[scene]["hit_99"]


def test_factors_do_what_they_should(rows):
    base = of(rows, 48)["sphere"]
    assert of(rows, 48, root="linear")["sphere"]["hit_99"] > base["hit_99"]
    assert of(rows, 48, normal="analytic")["sphere"]["normal_mean"] > 2 * base["normal_mean"]
    assert of(rows, 48, dtype="u8")["sphere"]["normal_mean"] > base["normal_mean"]
    for entry in leapray.variants():
        if entry.exact:  # the same hits, whoever finds the cells
            other = of(rows, 48, traverser=entry.spec)["sphere"]
            assert other["hit_99"] == pytest.approx(base["hit_99"], rel=1e-6)
            assert other["silhouette"] == base["silhouette"]


def test_nothing_beats_the_front(made, rows):
    points = accuracy.means([accuracy.Row(**row) for row in rows])
    best = accuracy.front(points, "hit_99")
    assert len(best) > 1
    for point in best:
        assert not any(p.mrays > point.mrays and p.hit_99 < point.hit_99 for p in points)
    for p in points:
        assert any(b.mrays >= p.mrays and b.hit_99 <= p.hit_99 for b in best)


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("shape", [shapes.sphere(), shapes.torus(), shapes.rods(), shapes.box()],
                         ids=lambda shape: shape.name)  # fmt: skip
def test_samples_are_those_of_the_distance_at_every_point(shape, dtype):
    samples, matrix = shape.samples(45, dtype)
    z, y, x = np.indices(samples.shape)
    points = np.stack([x, y, z], axis=-1).reshape(-1, 3) * matrix[0, 0] - 1.1
    kind, top = DTYPES[dtype], ONES[dtype]
    half_width = filter_info("ramp", dtype).half_width
    ramp = np.clip(0.5 - shape.distance(points) / (2 * half_width * matrix[0, 0]), 0, 1) * top
    want = ramp if dtype == "f32" else np.rint(ramp)
    assert samples.dtype == kind and samples.min() == 0
    np.testing.assert_allclose(samples.ravel(), want, atol=1e-6 if dtype == "f32" else 1)
    assert 0.01 < ((samples > 0) & (samples < top)).mean() < 0.5


def test_embree_agrees_with_the_sphere_that_its_mesh_approaches():
    u, v = np.meshgrid(np.linspace(0, np.pi, 101), np.linspace(0, 2 * np.pi, 201), indexing="ij")
    points = np.stack([np.sin(u) * np.cos(v), np.sin(u) * np.sin(v), np.cos(u)], axis=-1) * 0.9
    i = (np.arange(100)[:, None] * 201 + np.arange(200)).ravel()
    triangles = np.concatenate([np.stack(c, axis=1) for c in
                                ((i + 1, i + 202, i + 201), (i, i + 1, i + 201))])  # fmt: skip
    origins, directions = accuracy.rays(500)
    with np.errstate(invalid="ignore"):
        t, normal, _ = embree.first_hits(points.reshape(-1, 3), triangles, origins, directions)
    want = shapes.sphere(0.9).first_hit(origins, directions)
    hit = np.isfinite(t) & np.isfinite(want)
    assert 0.4 < hit.mean() < 0.9
    at = origins[hit] + t[hit, None] * directions[hit]
    assert np.abs(np.linalg.norm(at, axis=1) - 0.9).max() < 1e-3
    assert ((normal[hit] * at).sum(axis=1) / 0.9 > 0.99).mean() > 0.99
