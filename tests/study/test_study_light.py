# SPDX-License-Identifier: GPL-3.0-or-later
"""The study of light: both engines at all counts, and who leads where."""

import argparse
import json

import pytest

pytest.importorskip("bpy")
pytest.importorskip("flip_evaluator")
pytest.importorskip("matplotlib")

from addon.study import light, scenes


def row(engine, samples, seconds, rmse):
    return light.Row("box", engine, samples, seconds, 0.0, rmse, rmse, 0.1, 0.1, 0.0, 0.0)


def test_seconds_to_an_error_lie_between_the_counts():
    rows = [row("cycles", 1, 1.0, 0.4), row("cycles", 4, 4.0, 0.2), row("cycles", 16, 16.0, 0.1)]
    assert light.seconds_to(rows, 0.2) == pytest.approx(4)
    assert light.seconds_to(rows, 0.4 / 2**0.5) == pytest.approx(2)
    assert light.seconds_to(rows, 0.5) == 1.0
    assert light.seconds_to(rows, 0.05) is None
    ours = [row("leapray", 1, 3.0, 0.4), row("leapray", 4, 6.0, 0.1)]
    told = [light.lead(*found[-2:]) for found in light.leads(ours + rows)]
    assert "Cycles leads" in told[0] and "LeapRay leads" in told[-1]


@pytest.mark.slow
def test_a_quick_study_writes_what_it_promises(tmp_path):
    output = tmp_path / "made"
    own = [scenes.sample("cornell")]
    args = argparse.Namespace(output=output, quick=True, scenes=own, percentage=8, most=16)
    assert light.main(args) == 0
    pictures = {f"cornell-{name}.png" for name in ("leapray", "cycles", "reference")}
    names = {f"light.{ending}" for ending in ("csv", "json", "html", "svg", "png")}
    assert {path.name for path in output.iterdir()} == names | pictures
    rows = json.loads((output / "light.json").read_text())["rows"]
    assert [(r["engine"], r["samples"]) for r in rows] == [
        (engine, count) for engine in light.ENGINES for count in (1, 4, 16)
    ]
    for engine in light.ENGINES:
        errors = [r["rmse"] for r in rows if r["engine"] == engine]
        assert errors[0] > 1.5 * errors[-1] > 0
    assert all(r["seconds"] > r["seconds_model"] >= 0 for r in rows)
