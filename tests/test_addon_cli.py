# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line: what it writes, what it refuses, how it dies."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import bpy
import pytest
from blender_scenes import exr, fresh, light, mesh, put

import leapray
from addon import cli, result

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="module")
def blend(tmp_path_factory):
    """A file with a cube under a sun, 64 x 48 pixels."""
    scene = fresh()
    put("Cube", mesh(), rotation_euler=(0.4, 0.5, 0.6))
    put("Sun", light("SUN"))
    scene.leapray.samples = 2
    path = tmp_path_factory.mktemp("scene") / "cube.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


def start(*words, cwd):
    environment = dict(os.environ, PYTHONPATH=f"{ROOT}{os.pathsep}{ROOT / 'native'}")
    command = [sys.executable, "-m", "addon.cli", *map(str, words)]
    return subprocess.Popen(
        command, cwd=cwd, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def run(*words, cwd):
    process = start(*words, cwd=cwd)
    out, err = process.communicate(timeout=60)
    return process.returncode, out, err


def is_png(path):
    data = path.read_bytes()
    return data.startswith(b"\x89PNG") and data.endswith(b"IEND\xaeB`\x82")


def test_render_without_options_puts_a_picture_and_its_figures_here(blend, tmp_path):
    code, out, err = run("render", blend, cwd=tmp_path)
    assert code == 0, err
    assert out == "cube.png, and its figures in cube.json\n"  # and nothing of Blender's
    assert is_png(tmp_path / "cube.png")
    told = json.loads((tmp_path / "cube.json").read_text())
    assert told["settings"]["samples"] == 2 and told["frame"] == 1
    assert told["seconds"]["total"] > 0 and told["rays"] > 64 * 48
    assert sorted(os.listdir(tmp_path)) == ["cube.json", "cube.png"]


def test_options_replace_the_scenes_settings(blend, tmp_path):
    folder = tmp_path / "braces {are} # no template"
    folder.mkdir()
    first = leapray.traversers()[0].name
    words = ["--output", folder / "out.exr", "--json", tmp_path / "told.json", "--frame", 7]
    words += ["--samples", 3, "--traverser", first, "--hit-test", "faces", "--root", "linear"]
    words += ["--normal", "analytic", "--layout", "scene", "--resolution", 40]
    words += ["--pixel-error", 0.5, "--threads", 1, "--diffuse-bounces", 2, "--max-bounces", 3]
    words += ["--noise-threshold", 0.25, "--pixel-filter", "blackman_harris", "--seed", 9]
    words += ["--sample-type", "f32", "--half-width", 2]
    assert cli.main(["render", str(blend), *map(str, words)]) == 0
    told = json.loads((tmp_path / "told.json").read_text())
    assert told["frame"] == 7 and told["threads"] == 1
    settings = told["settings"]
    want = {
        "samples": 3,
        "traverser": first,
        "hit_test": "faces",
        "root": "linear",
        "normal": "analytic",
        "layout": "scene",
        "resolution": 40,
        "pixel_error": 0.5,
        "threads": 1,
        "diffuse_bounces": 2,
        "max_bounces": 3,
        "noise_threshold": 0.25,
        "pixel_filter": "blackman_harris",
        "seed": 9,
        "sample_type": "f32",
        "half_width": 2.0,
    }
    assert {name: settings[name] for name in want} == want
    names = {name.split(".")[1] for name in exr(folder / "out.exr") if name.count(".") == 2}
    assert names == {each.blender_name() for each in result.PASSES}


REFUSED = [
    (["missing.blend"], 1, "There is no file missing.blend"),
    (["."], 1, ". is a folder"),
    (["/"], 1, "/ is a folder"),
    (["{blend}", "--json", "{blend}"], 1, "three different files"),
    (["{blend}", "--output", "a.png", "--json", "./a.png"], 1, "three different files"),
    (["{blend}", "--output", "no/such/place/a.png"], 1, "no/such/place does not exist"),
    (["{blend}", "--output", "/proc/a.png"], 1, "/proc cannot be written to"),
    (["{blend}", "--json", "/proc/a.json"], 1, "/proc cannot be written to"),
    (["{blend}", "--output", "a.jpg"], 1, "must end in .png or .exr"),
    (["{blend}", "--traverser", "teleport"], 1, "there are " + leapray.traversers()[0].name),
    (["{blend}", "--pixel-error", "0"], 1, "Pixel Error must lie between"),
    (["{blend}", "--pixel-error", "nan"], 1, "Pixel Error must lie between"),
    (["{blend}", "--samples", "1000000"], 1, "Samples must lie between"),
    (["{blend}", "--resolution", "0"], 2, "must be at least 1, not 0"),
    (["{blend}", "--samples", "0"], 2, "must be at least 1, not 0"),
    (["{blend}", "--resolution", "x"], 2, """invalid "auto" or integer value: 'x'"""),
    (["{blend}", "--threads", "1025"], 2, "must be at most 1024"),
    (["{blend}", "--frame", "1048575"], 2, "must be at most 1048574"),
    (["{blend}", "--hit-test", "guess"], 2, "invalid choice"),
    ([], 2, "SCENE.blend"),
]


@pytest.mark.parametrize(("words", "code", "sentence"), REFUSED)
def test_what_cannot_be_done_is_refused_in_a_sentence(
    blend, tmp_path, monkeypatch, capfd, words, code, sentence
):
    monkeypatch.chdir(tmp_path)
    words = [word.format(blend=blend) for word in words]
    before = blend.read_bytes()
    assert cli.main(["render", *words]) == code
    assert blend.read_bytes() == before
    out, err = capfd.readouterr()
    assert sentence in err and "Traceback" not in err and out == ""
    assert os.listdir(tmp_path) == []


def test_broken_files_and_scenes_are_refused(blend, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    broken = tmp_path / "broken.blend"
    broken.write_bytes(blend.read_bytes()[:2000])
    assert cli.main(["render", str(broken)]) == 1
    assert "leapray: " in (said := capfd.readouterr().err) and "broken.blend cannot be" in said

    scene = fresh()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "empty.blend"))
    scene.view_layers[0].use = False
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "unused.blend"))
    scene.camera = None
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "blind.blend"))
    capfd.readouterr()
    assert cli.main(["render", "empty.blend"]) == 1
    assert "shows no mesh" in capfd.readouterr().err
    assert cli.main(["render", "unused.blend"]) == 1
    assert "No view layer" in capfd.readouterr().err
    assert cli.main(["render", "blind.blend"]) == 1
    assert "camera" in capfd.readouterr().err
    names = [f"{name}.blend" for name in ("blind", "broken", "empty", "unused")]
    assert sorted(os.listdir(tmp_path)) == names


@pytest.mark.slow
def test_a_killed_render_leaves_no_picture_and_the_next_one_clears_up(blend, tmp_path):
    slow = start("render", blend, "--samples", 60000, cwd=tmp_path)
    deadline = time.monotonic() + 30
    while not list(tmp_path.glob(".cube.png.*.part")) and time.monotonic() < deadline:
        time.sleep(0.05)
    time.sleep(0.3)
    slow.kill()
    slow.communicate()
    assert {path.suffix for path in tmp_path.iterdir()} == {".part"}
    code, _, err = run("render", blend, cwd=tmp_path)
    assert code == 0, err
    assert sorted(os.listdir(tmp_path)) == ["cube.json", "cube.png"]


def test_an_interrupt_ends_the_render_soon_and_cleanly(blend, tmp_path):
    slow = start("render", blend, "--samples", 60000, cwd=tmp_path)
    deadline = time.monotonic() + 30
    while not list(tmp_path.glob(".cube.png.*.part")) and time.monotonic() < deadline:
        time.sleep(0.05)
    time.sleep(0.5)
    slow.send_signal(signal.SIGINT)
    asked = time.monotonic()
    _, err = slow.communicate(timeout=30)
    assert slow.returncode == 130 and "interrupted" in err
    assert time.monotonic() - asked < 5  # closing Blender included
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("moment", ["render_init", "render_pre", "render_stats"])
def test_an_interrupt_is_heard_while_blender_swallows_exceptions(
    blend, tmp_path, monkeypatch, capfd, moment
):
    monkeypatch.chdir(tmp_path)
    heard = []

    def press(*_):
        if not heard:
            heard.append(signal.getsignal(signal.SIGINT))
            signal.raise_signal(signal.SIGINT)

    def render(path):
        scene = open_scene(path)
        getattr(bpy.app.handlers, moment).append(press)
        return scene

    open_scene = cli.open_scene
    monkeypatch.setattr(cli, "open_scene", render)
    assert cli.main(["render", str(blend)]) == 130
    assert len(heard) == 1 and capfd.readouterr().err.endswith("leapray: interrupted\n")
    assert os.listdir(tmp_path) == []
    monkeypatch.setattr(cli, "open_scene", open_scene)
    assert cli.main(["render", str(blend)]) == 0  # and the next one is not


def test_help_names_what_there_is(capsys):
    assert cli.main(["render", "--help"]) == 0
    told = capsys.readouterr().out
    for entry in leapray.traversers():
        assert entry.name in told
    assert cli.main(["dance"]) == 2


def test_a_study_without_its_libraries_says_which(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    for name in [name for name in sys.modules if name.startswith("addon.study")]:
        monkeypatch.delitem(sys.modules, name)
    assert cli.main(["compare", "any.blend"]) == 1
    assert "compare needs matplotlib, which this Python has not" in capsys.readouterr().err
