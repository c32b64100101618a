# SPDX-License-Identifier: GPL-3.0-or-later
"""The study of phantoms: its own reference is right, and it writes what it promises."""

import argparse
import csv
import json

import numpy as np
import pytest
from numpy.testing import assert_array_equal

pytest.importorskip("matplotlib")

import leapray
from addon import cli
from addon.study import phantom


def test_phantoms_have_equal_volume_and_growing_surface():
    made = [phantom.phantom(64, n) for n in (1, 2, 4)]
    voxels = np.array([(samples > 0).sum() for samples in made])
    assert abs(voxels / voxels[0] - 1).max() < 0.05  # digital spheres of radius 5 vary by 2 %
    ratios = np.array([phantom.surface_to_volume(samples) for samples in made])
    # A digital sphere has 6 pi r^2 faces, so 4.5 faces by voxel and radius.
    want = 4.5 * np.array([1, 2, 4]) / (phantom.RADIUS * 64)
    assert abs(ratios / want - 1).max() < 0.05
    assert_array_equal(made[1], phantom.phantom(64, 2))


def test_spheres_do_not_touch_each_other_or_the_border():
    ndimage = pytest.importorskip("scipy.ndimage")
    samples = phantom.phantom(60, 3)
    _, count = ndimage.label(samples)
    assert count == 27 + 8  # and the cube's corners


def test_an_object_cell_has_an_object_sample():
    samples = np.zeros((3, 4, 5), np.uint8)
    samples[1, 2, 3] = 255
    cells = phantom.object_cells(samples)
    assert cells.shape == (4, 5, 6)
    assert cells.sum() == 8
    assert cells[1:3, 2:4, 3:5].all()


def test_the_reference_agrees_with_fractions():
    random = np.random.default_rng(5)
    cells = random.random((5, 6, 7)) < 0.08
    origins = random.uniform(-12, 12, (200, 3))
    directions = random.uniform(0, 5, (200, 3)) - origins
    directions[:20, 0] = 0.0
    origins[:20, 0] = random.uniform(-1, 6, 20)
    got = phantom.first_cells(cells, origins, directions)
    places = np.argwhere(cells)[:, ::-1] - 1
    hits = 0
    for origin, direction, cell in zip(origins, directions, got, strict=True):
        ways = {tuple(c): phantom.passage(origin, direction, c) for c in places}
        ways = {c: way for c, way in ways.items() if way is not None and way[0] < way[1]}
        want = min(ways, key=lambda c: ways[c][0]) if ways else (-2, -2, -2)
        assert tuple(cell) == want
        hits += bool(ways)
    assert 60 < hits < 200


def test_a_wrong_first_cell_is_told_from_a_tie():
    cells = np.zeros((4, 4, 4), bool)
    cells[1, 1, 1] = cells[1, 1, 3] = cells[1, 2, 2] = True  # (0, 0, 0), (2, 0, 0), (1, 1, 0)
    origin, direction = np.array([-3.0, 0.5, 0.5]), np.array([1.0, 0.0, 0.0])
    first, second, missed = (0, 0, 0), (2, 0, 0), (-2, -2, -2)
    assert phantom.is_wrong(cells, origin, direction, second, first)
    assert phantom.is_wrong(cells, origin, direction, missed, first)
    assert phantom.is_wrong(cells, origin, direction, (1, 0, 0), first)  # not an object's
    on_face = np.array([-3.0, 1.0, 0.5])  # between rows 0 and 1 of y
    assert not phantom.is_wrong(cells, on_face, direction, first, (1, 1, 0))
    assert not phantom.is_wrong(cells, on_face, direction, missed, missed)


def test_a_quick_study_writes_what_it_promises(tmp_path, monkeypatch):
    monkeypatch.setattr(phantom, "IMAGE", 100)
    output = tmp_path / "made"
    args = argparse.Namespace(output=output, quick=True, size=32, rounds=2)
    assert phantom.main(args) == 0
    names = {path.name for path in output.iterdir()}
    charts = {
        f"{name}.{ending}" for name in ("seconds", "steps", "setup") for ending in ("svg", "png")
    }
    assert names == charts | {"phantom.csv", "phantom.json", "phantom.html"}
    assert [path.name for path in tmp_path.iterdir()] == ["made"]
    rows = list(csv.DictReader((output / "phantom.csv").open()))
    exact = {entry.spec for entry in leapray.traversers() if entry.exact}
    assert {row["traverser"] for row in rows} == {entry.spec for entry in leapray.traversers()}
    assert len(rows) == 5 * 3 * len(leapray.traversers())
    assert all(row["wrong"] == "0" for row in rows if row["traverser"] in exact)
    assert all(0 < int(row["hits"]) <= 100**2 for row in rows)
    # No machine traces a ray in less than a nanosecond: the clock did see the work.
    assert sum(float(row["seconds"]) for row in rows) > 1e-9 * 100**2 * len(rows)
    told = json.loads((output / "phantom.json").read_text())
    assert told["rows"][0]["steps_per_ray"] > 0
    text = (output / "phantom.html").read_text()
    assert "http" not in text.replace("http-equiv", "")
    assert text.count("data:image/png;base64,") == 3


def test_the_command_line_offers_the_study(tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(phantom, "main", lambda args: asked.append(args) or 0)
    assert cli.main(["study", "phantom", "--quick", "--output", str(tmp_path / "made")]) == 0
    assert asked[0].quick and asked[0].output == tmp_path / "made"


def test_an_output_that_cannot_be_is_refused_before_any_work(tmp_path):
    args = argparse.Namespace(output=tmp_path / "no" / "folder", quick=True)
    with pytest.raises(leapray.LeapRayError, match="does not exist"):
        phantom.main(args)
