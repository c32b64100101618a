# SPDX-License-Identifier: GPL-3.0-or-later
"""A comparison of the sphere with Cycles, end to end through the command line."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip("bpy")
pytest.importorskip("flip_evaluator")
pytest.importorskip("matplotlib")

import leapray

ROOT = Path(__file__).resolve().parents[2]
pytestmark = pytest.mark.slow


def run(*words, cwd):
    return subprocess.run(
        [sys.executable, "-m", "addon.cli", *map(str, words)],
        cwd=cwd,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "native")])},
        capture_output=True,
        text=True,
        timeout=120,
    )


@pytest.fixture(scope="module")
def compared(tmp_path_factory):
    """The folder that a comparison of the sphere leaves, and what it printed."""
    folder = tmp_path_factory.mktemp("compare")
    options = ["--percentage", 25, "--samples", 4, "--reference", 32, "--traversers", "all"]
    options += ["--curve", 16]
    done = run("compare", ROOT / "blend_samples/sphere.blend", *options, cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder / "sphere-compare", done.stdout


@pytest.fixture(scope="module")
def told(compared):
    return json.loads((compared[0] / "report.json").read_text())


def exact(told):
    runs = [run for run in told["runs"].values() if run["exact"]]
    assert runs
    return runs


def test_the_folder_holds_the_page_the_figures_and_the_pictures(compared, told):
    output, printed = compared
    assert sorted(path.name for path in output.parent.iterdir()) == [output.name]
    assert str(output.name) in printed.splitlines()[-1]
    names = {path.name for path in output.iterdir()}
    shown = {name for name, *_ in told["pictures"] + told["charts"]}
    assert shown <= names
    assert not any(name.endswith((".exr", ".part")) for name in names)
    page = (output / "report.html").read_text()
    assert page.count("data:image/png;base64,") >= len(shown) - 2
    assert 'src="http' not in page and "href=" not in page


def test_both_engines_are_charted_at_the_counts_of_the_curve(told):
    assert list(told["by_samples"]) == ["1", "4", "16"]
    for count, values in told["by_samples"].items():
        assert values["seconds"] >= values["phases"]["total"] > 0
        assert values["all"]["flip"] > 0 and count in told["cycles"]["by_samples"]
    one, four = (told["by_samples"][count]["rims"]["rmse"] for count in ("1", "4"))
    assert 0 < four < one
    run = next(iter(told["runs"].values()))["light"]["all"]
    assert told["by_samples"]["4"]["all"]["rmse"] == pytest.approx(run["rmse"], rel=1e-6)


def test_every_traverser_is_measured(told):
    assert set(told["runs"]) == {entry.spec for entry in leapray.traversers()}
    assert next(run["default"] for run in told["runs"].values()) is True


def test_the_sphere_is_where_cycles_sees_it(told):
    for run in exact(told):
        shape = run["geometry"]
        assert shape["index"]["all"]["worst_steps"] <= 1
        assert shape["index"]["all"]["share_of_edges"] <= 0.1
        depth, angle = shape["depth_error_footprints"], shape["normal_angle_degrees"]
        assert set(depth) == {"Ball"}
        assert depth["Ball"]["n"] > 3000
        assert depth["Ball"]["median"] <= 0.25 and depth["Ball"]["p99"] <= 1.0
        assert angle["Ball"]["p99"] <= 2.0 and shape["normals_turned"]["Ball"] <= 0.001


def test_the_sphere_is_as_bright_as_cycles_has_it(told):
    for run in exact(told):
        assert abs(run["light"]["all"]["mean_ratio"]) <= 0.01
        assert run["light"]["but_rims"]["rmse"] <= 0.02
        assert run["light"]["but_rims"]["flip"] <= 0.05
    noise = [told["cycles"]["by_samples"][n]["all"]["rmse"] for n in ("1", "4", "16")]
    assert noise[0] > noise[1] > noise[2] > 0


def test_the_bars_are_told_with_their_figures(told):
    bars = [bar for group in told["bars"].values() for bar in group]
    assert len(bars) >= 7
    for bar in bars:
        assert bar["holds"] is (abs(bar["value"]) <= bar["limit"])


def test_an_unknown_traverser_and_a_missing_folder_are_refused_in_a_sentence(tmp_path):
    scene = ROOT / "blend_samples/sphere.blend"
    done = run("compare", scene, "--traversers", "nobody", cwd=tmp_path)
    assert done.returncode == 1
    assert "nobody" in done.stderr and "Traceback" not in done.stderr
    done = run("compare", scene, "--output", tmp_path / "no" / "such", cwd=tmp_path)
    assert done.returncode == 1
    assert "does not exist" in done.stderr and "Traceback" not in done.stderr
    assert not list(tmp_path.iterdir())


def test_an_interrupt_is_heard_while_cycles_renders(tmp_path):
    words = ["compare", ROOT / "blend_samples/sphere.blend", "--reference", 10**6]
    process = subprocess.Popen(
        [sys.executable, "-m", "addon.cli", *map(str, words)],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "native")])},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        while "reference" not in (line := process.stderr.readline()):
            assert line, "it ended"
        time.sleep(1.0)  # Cycles has begun
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=10)
    finally:
        process.kill()
    assert process.returncode == 130 and said.endswith("leapray: interrupted\n")
    assert list(tmp_path.iterdir()) == []
