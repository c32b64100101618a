# SPDX-License-Identifier: GPL-3.0-or-later
"""The study of others at the same work."""

import argparse
import importlib.util
import json
import time

import numpy as np
import pytest

pytest.importorskip("matplotlib")
pytest.importorskip("bpy")  # its OpenVDB

import leapray
from addon.study import distances, methods, peers, traversals


def test_methods_are_run_in_turns():
    ran = []
    runs = {name: lambda name=name: ran.append(name) for name in "ab"}
    taken = dict(
        zip(runs, methods.seconds(list(runs.values()), 3, time.perf_counter).T, strict=True)
    )
    assert ran == list("ababab")
    assert all(len(seconds) == 3 and min(seconds) >= 0 for seconds in taken.values())


def test_the_study_writes_its_folder(tmp_path, monkeypatch):
    monkeypatch.setattr(traversals, "openvdb_rays", lambda: None)  # takes long to compile
    args = argparse.Namespace(
        output=tmp_path / "out", quick=True, scan=10, sizes=[16], rounds=1, cells=20,
        image=16, phantoms={24: (1, 2)},
    )  # fmt: skip
    assert peers.main(args) == 0
    told = json.loads((tmp_path / "out" / "peers.json").read_text())
    by = [row["by"] for row in told["rows"]]
    assert "OpenVDB" in by and by.count("LeapRay") == 2 and "LeapRay portable" in by
    assert all(0 < row["least"] <= row["seconds"] <= row["most"] for row in told["rows"])
    text = (tmp_path / "out" / "peers.html").read_text()
    assert "OpenVDB, all cores" in text and (tmp_path / "out" / "peers.png").exists()
    assert {row["metric"] for row in told["distances"]} == set(leapray.METRICS)
    assert "Chessboard: " in text and "as fast as scipy" in text
    rays = told["rays"]
    assert {(row["work"], row["spheres"]) for row in rays} == {
        (work, n) for work in (traversals.SURFACE, traversals.CELLS) for n in (1, 2)
    }
    assert all(0 < row["least"] <= row["nanoseconds"] <= row["most"] for row in rays)
    assert all(row["differ"] == 0 for row in rays if row["work"] == traversals.CELLS)
    embree = any(row["by"].startswith("Embree") for row in rays)
    assert embree == ("as fast as Embree" in text) == bool(importlib.util.find_spec("embreex"))


def test_peers_that_differ_are_told(monkeypatch):
    monkeypatch.setitem(distances.PEERS, "scipy", lambda cells, metric: lambda: cells * 3)
    with pytest.raises(ValueError, match="scipy finds other distances, by chessboard"):
        distances.measure(12, 1)


# ---- rays ----------------------------------------------------------------


def test_object_cells_are_those_that_rays_meet():
    """A ray along x through the middle of every row of cells finds the first of them."""
    s = traversals.subject(16, 2, 4)
    cells = traversals.object_cells(s.cells)
    assert cells.shape == (17, 17, 17)
    z, y = np.indices((17, 17)).reshape(2, -1)
    origins = np.stack([np.full(z.shape, -5.0), y - 0.5, z - 0.5], axis=1)
    structure = leapray.build(leapray.Volume(s.cells))
    hits = leapray.trace(structure, origins, np.tile((1.0, 0, 0), (len(z), 1)), mode="binary")
    rows = cells.reshape(-1, 17)
    want = np.where(rows.any(axis=1), rows.argmax(axis=1) - 1 + 5.0, np.inf)
    assert np.isfinite(want).sum() > 50
    np.testing.assert_array_equal(hits.t, want)


def test_distances_and_triangles_are_those_of_the_spheres():
    s = traversals.subject(40, 2, 4)
    vertices, triangles = traversals.mesh_of(s.distances)
    off = np.linalg.norm(vertices[:, None] - s.centres[None], axis=-1) - s.radius
    # a voxel's diagonal squared by twice the radius is what chords may sink
    assert np.abs(off).min(axis=1).max() < 3 / (2 * s.radius)
    assert len(np.unique(triangles)) == len(vertices)


def test_a_ray_at_a_sphere_meets_it_where_algebra_does():
    s = traversals.subject(32, 1, 8)
    (centre,) = s.centres
    t = traversals.truth(s, slice(None))
    at = s.origins + t[:, None] * s.directions
    hit = np.isfinite(t)
    assert 0 < hit.sum() < len(t)
    np.testing.assert_allclose(np.linalg.norm(at[hit] - centre, axis=1), s.radius, rtol=1e-9)


@pytest.mark.slow
def test_openvdb_finds_the_same_cells_and_nearly_the_same_surfaces():
    if traversals.openvdb_rays() is None:
        pytest.skip("no g++ with OpenVDB's headers")
    s = traversals.subject(48, 3, 40)
    for work, most in ((traversals.CELLS, 1e-9), (traversals.SURFACE, 0.1)):
        own, *_ = traversals.by_leapray(s, work)
        (other,) = traversals.by_openvdb(s, work)
        (t, normal), (u, other_normal) = own.trace(), other.trace()
        both = np.isfinite(t) & np.isfinite(u)
        assert (np.isfinite(t) != np.isfinite(u)).sum() <= (0 if work == traversals.CELLS else 8)
        assert np.median(np.abs(t[both] - u[both])) < most
        if work == traversals.SURFACE:
            assert np.median((normal * other_normal).sum(axis=1)[both]) > np.cos(0.1)
