# SPDX-License-Identifier: GPL-3.0-or-later
"""The study of whole images: its figures are what the methods promise."""

import argparse
import json

import pytest

pytest.importorskip("matplotlib")

import leapray
from addon.study import leaps, methods

SIZE, IMAGE, COUNTS = 24, 40, [1, 2]


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    output = tmp_path_factory.mktemp("study") / "out"
    args = argparse.Namespace(
        output=output, quick=True, size=SIZE, image=IMAGE, counts=COUNTS, frames=3, rounds=1
    )
    assert methods.main(args) == 0
    return json.loads((output / "methods.json").read_text()), output


def test_every_method_with_every_option_sees_every_phantom_by_the_cameras_that_it_takes(told):
    rows = told[0]["rows"]
    for camera in ("parallel", "perspective"):
        for n in COUNTS:
            shown = {r["method"] for r in rows if (r["camera"], r["n"]) == (camera, n)}
            asked = [e for e in leapray.image_variants() if e.perspective or camera == "parallel"]
            assert {entry.spec for entry in asked} == shown - {e.spec for e in leapray.variants()}


def test_exact_methods_miss_nothing_and_others_are_told(told):
    rows = told[0]["rows"]
    for row in rows:
        assert row["hits"] > 50
        if row["exact"]:
            assert row["lost"] == row["invented"] == 0
    wrong = [row for row in rows if not row["exact"] and row["displaced"] + row["lost"] > 0]
    assert {"templates", "discrete"} <= {row["method"] for row in wrong}


def test_leaping_frames_are_equal_and_save_cells(told):
    frames = told[0]["leaps"]
    assert len(frames) == 3 * len(leaps.TURNS) * len(COUNTS) * 2
    assert all(frame["equal"] for frame in frames)
    later = [f for f in frames if f["frame"] and f["turn"] == min(leaps.TURNS)]
    assert sum(f["cells"] for f in later) < sum(f["scratch_cells"] for f in later)


def test_the_page_tells_and_draws(told):
    _, output = told
    page = (output / "methods.html").read_text()
    assert "NOT E" not in page and "Octree projection" in page
    files = {path.name for path in output.iterdir()}
    assert {"methods.csv", "methods-lights.csv", "methods-leaps.csv", "leaps.png"} <= files


@pytest.mark.parametrize(
    ("prepare", "frame", "other_prepare", "other", "expected"),
    [(5, 1, 1, 2, 4), (1, 1, 5, 2, 0), (5, 2, 1, 1, None), (5, 1, 1, 1, None), (1, 1, 1, 1, 0)],
)
def test_what_is_made_once_pays_when_frames_have_saved_it(
    prepare, frame, other_prepare, other, expected
):
    assert methods.pays_after(prepare, frame, other_prepare, other) == expected
