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
from addon import arguments, cli
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


def test_wrong_first_cells_are_counted(monkeypatch):
    trace = leapray.trace

    def late(structure, origins, directions, **options):
        hits = trace(structure, origins, directions, **options)
        first = np.flatnonzero(np.isfinite(hits.t))[:5]
        hits.cell[first] += 1
        return hits

    rows, *_ = phantom.measure(32, 30, (2,), 1)
    exact = [k for k, row in enumerate(rows) if leapray.traverser(row.traverser).exact]
    assert {rows[k].wrong for k in exact} == {0}
    monkeypatch.setattr(leapray, "trace", late)
    rows, *_ = phantom.measure(32, 30, (2,), 1)
    assert all(0 < rows[k].wrong <= 5 for k in exact)


def test_the_surveys_findings_are_told_with_their_figures():
    rows, *_ = phantom.measure(128, 60, (1, 10), 1)
    told = " ".join(phantom.findings(rows))
    steps = {(row.traverser, row.n): row.steps_per_ray for row in rows if row.camera == "oblique"}
    for spec, trend in (("frt", "fall"), ("smart", "rise"), ("cd", "rise")):
        first, last = steps[spec, 1], steps[spec, 10]
        assert (last < first) == (trend == "fall")
        assert f"{trend} from {first:.2f} to {last:.2f}" in told
    assert steps["cd", 10] < steps["radc:metric=chessboard,step=paper", 10]
    assert abs(steps["cd", 10] / steps["radc:step=paper", 10] - 1) < 0.3


@pytest.mark.slow
def test_a_quick_study_writes_what_it_promises(tmp_path):
    output = tmp_path / "made"
    args = argparse.Namespace(output=output, quick=True, size=32, image=100, rounds=2)
    assert phantom.main(args) == 0
    names = {path.name for path in output.iterdir()}
    charts = {
        f"{name}.{ending}"
        for name in ("survey", "seconds", "steps", "setup")
        for ending in ("svg", "png")
    }
    assert names == charts | {"phantom.csv", "phantom.json", "phantom.html"}
    assert [path.name for path in tmp_path.iterdir()] == ["made"]
    rows = list(csv.DictReader((output / "phantom.csv").open()))
    exact = {entry.spec for entry in leapray.variants() if entry.exact}
    names = {row["traverser"] for row in rows}
    assert names >= {entry.spec for entry in leapray.traversers()}
    assert names >= {"radc:metric=chessboard,step=paper", "radc:step=paper"}
    assert len(rows) == 5 * 3 * len(names)
    assert all(row["wrong"] == "0" for row in rows if row["traverser"] in exact)
    assert all(0 < int(row["hits"]) <= 100**2 for row in rows)
    # No machine traces a ray in less than a nanosecond: the clock did see the work.
    assert sum(float(row["seconds"]) for row in rows) > 1e-9 * 100**2 * len(rows)
    told = json.loads((output / "phantom.json").read_text())
    assert told["rows"][0]["steps_per_ray"] > 0
    text = (output / "phantom.html").read_text()
    assert "://" not in text
    assert text.count("data:image/png;base64,") == 4


def test_the_command_line_offers_the_study(tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(phantom, "main", lambda args: asked.append(args) or 0)
    words = ["--quick", "--output", str(tmp_path / "made"), "--size", "256", "--image", "1024"]
    assert cli.main(["study", "phantom", *words]) == 0
    assert asked[0].quick and asked[0].output == tmp_path / "made"
    assert (asked[0].size, asked[0].image, asked[0].rounds) == (256, 1024, None)
    assert cli.main(["study", "phantom", "--size", "0"]) == 2


@pytest.mark.parametrize("name", arguments.studies())
def test_the_help_of_every_study_tells_its_options(name, capsys):
    assert cli.main(["study", name, "--help"]) == 0
    told = capsys.readouterr().out
    assert "--quick" in told and "N" in told.split("--quick")[1]


def test_an_output_that_cannot_be_is_refused_before_any_work(tmp_path):
    args = argparse.Namespace(output=tmp_path / "no" / "folder", quick=True)
    with pytest.raises(leapray.LeapRayError, match="does not exist"):
        phantom.main(args)
