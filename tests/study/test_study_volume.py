# SPDX-License-Identifier: GPL-3.0-or-later
"""The study of light through volumes: its figures are what the methods promise."""

import argparse
import json

import numpy as np
import pytest

pytest.importorskip("matplotlib")
pytest.importorskip("nibabel")

import leapray
from addon.study import light_integrals, volume, volume_subject
from leapray import LeapRayError


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    output = tmp_path_factory.mktemp("study") / "out"
    args = argparse.Namespace(output=output, quick=True, size=32, image=48, judged=60, rounds=1)
    assert volume.main(args) == 0
    return json.loads((output / "volume.json").read_text()), output


def test_integrals_are_within_their_tolerance_and_early_ends_within_what_they_leave(told):
    rows = told[0]["rows"]
    for row in rows:
        if row["name"] == "exact":
            assert row["error_max"] <= row["number"]
        if row["name"] == "exact, ends early":
            assert 1e-6 < row["error_max"] <= 1 - row["number"] + 1e-4
    assert sum(row["name"] == "exact" for row in rows) == len(volume.TOLERANCES)


def test_steps_err_more_than_integrals_and_less_the_smaller_they_are(told):
    found = [row for row in told[0]["rows"] if row["name"] == "steps, post"]
    errors = [row["error_99"] for row in found]
    assert [row["number"] for row in found] == list(volume.STEPS)
    assert errors[-1] < errors[0] / 4 and errors[-1] > 1e-4


def test_lit_samples_err_less_the_smaller_their_steps_are_by_the_normals_of_the_reference(told):
    central, analytic = (
        [row["error_99"] for row in told[0]["lit"] if row["name"] == f"lit, {normal}"]
        for normal in volume.NORMALS
    )
    assert central[-1] < central[0] / 4
    assert central[-1] < 0.03 < analytic[-1]  # a quarter of a voxel is 2 mm of bone here


def test_compiled_references_are_those_of_the_slow_one():
    rng = np.random.default_rng(7)
    ramp = light_integrals.Ramp(
        volume_subject.VALUES, volume_subject.EXTINCTION, volume_subject.COLORS
    )
    samples = rng.uniform(-800, 1200, (7, 8, 9))
    matrix = np.diag([0.7, 0.9, 1.3, 1.0])
    ends = rng.normal(size=(40, 3))
    o = 5 + 8 * ends / np.linalg.norm(ends, axis=1, keepdims=True)
    d = rng.uniform(1, 5, (40, 3)) - o
    color, left = light_integrals.light(samples, o, d, ramp, matrix)
    got = light_integrals.light_of_many(samples, o, d, ramp, matrix)
    np.testing.assert_allclose(got, np.column_stack([color, left]).astype(float), atol=1e-15)
    assert left.min() < 0.5


def test_leaping_changes_no_picture(told):
    assert all(leap["equal"] for leap in told[0]["modes"])
    for sampling in ("exact", "pre"):
        whole = [row for row in told[0]["culling"] if row["sampling"] == sampling]
        to_the_end = [row for row in whole if row["stop_opacity"] == 1]
        assert len({row["error_max"] for row in to_the_end}) == 1
        assert len(whole) == {"exact": 6, "pre": 7}[sampling]
        assert all(row["seconds"] > 0 for row in whole)


def test_the_page_names_every_traverser_and_the_files_are_there(told):
    _, output = told
    page = (output / "volume.html").read_text()
    assert "NOT SO HERE" not in page
    assert all(entry.label in page for entry in leapray.traversers() if entry.exact)
    files = {path.name for path in output.iterdir()}
    assert {"volume.csv", "volume-culling.csv", "volume-modes.csv", "picture.png"} <= files
    assert "head.nii" not in files


def test_a_phantom_that_is_not_made_is_told(tmp_path):
    with pytest.raises(LeapRayError, match="was not made: "):
        volume_subject.head(tmp_path / "none", 24)


def test_sentences_say_who_is_as_good_sooner():
    def row(name, number, seconds, error):
        return volume.Row(
            name, number, "cd", True, "", 1.0, seconds, 0, 0, 0, error, error, 0, 0, 0
        )

    rows = [
        row("exact", 1e-4, 2.0, 1e-6),
        row("exact, ends early", 0.99, 1.0, 0.01),
        row("others", 0.5, 3.0, 0.02),
        row("others", 1.0, 1.5, 0.03),
        row("wonder", 1.0, 0.1, 1e-9),
    ]
    said = volume.sentences(rows)
    assert "the least error is 0.02, at 0.5 voxels in 3 s" in said[1] and "3.00 times" in said[1]
    assert said[2] == "wonder: no exact picture is as good as its best."
