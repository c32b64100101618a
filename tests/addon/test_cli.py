# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line: what it writes, what it refuses, how it dies."""

import json
import os
import shutil
import signal
import struct
import subprocess
import sys
import time
from pathlib import Path

import bpy
import numpy as np
import pytest
from blender_scenes import exr, fresh, light, mesh, put

import leapray
from addon import cli
from addon.blender import open_file, result

ROOT = Path(__file__).resolve().parents[2]


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


def test_an_earlier_save_that_blender_keeps_is_a_scene_too(blend, tmp_path):
    earlier = tmp_path / "cube.blend1"
    earlier.write_bytes(blend.read_bytes())
    code, out, err = run("render", earlier, cwd=tmp_path)
    assert code == 0, err
    assert out == "cube.png, and its figures in cube.json\n"


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


def size_of(picture):
    """(width, height) of a PNG file."""
    assert is_png(picture)
    return struct.unpack(">II", picture.read_bytes()[16:24])


@pytest.fixture
def copied(blend, tmp_path, monkeypatch):
    """The scene in a folder of its own; the current folder is another."""
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "project"
    folder.mkdir()
    return Path(shutil.copy(blend, folder / "cube.blend"))


def test_paths_are_relative_to_the_scene_and_to_the_home_folder(copied, monkeypatch):
    monkeypatch.setenv("HOME", str(copied.parent / "home"))
    for name in ("home", "home/cache", "cache"):
        (copied.parent / name).mkdir()
    for cache in ("//cache", "~/cache"):
        words = ["--output", "//a.png", "--json", "~/told.json", "--cache-folder", cache]
        assert cli.main(["render", str(copied), *words]) == 0
    assert is_png(copied.parent / "a.png")
    told = json.loads((copied.parent / "home" / "told.json").read_text())
    assert told["picture"] == str(copied.parent / "a.png")
    for name in ("cache", "home/cache"):
        assert list((copied.parent / name).glob("*.vdb"))
    assert sorted(os.listdir(copied.parent)) == ["a.png", "cache", "cube.blend", "home"]
    assert os.listdir() == ["project"]


@pytest.mark.parametrize(
    ("words", "size"),
    [
        (["--percentage", "50"], (32, 24)),
        (["--resolution-x", "20"], (20, 48)),
        (["--resolution-x", "20", "--resolution-y", "10"], (20, 10)),
        (["--resolution-y", "10", "--percentage", "200"], (128, 20)),
    ],
)
def test_the_size_of_the_picture_is_as_asked_for(copied, words, size):
    scene = open_file.open_scene(copied)
    scene.render.resolution_percentage = 25
    bpy.ops.wm.save_mainfile()
    assert cli.main(["render", str(copied), *words]) == 0
    assert size_of(Path("cube.png")) == size
    told = json.loads(Path("cube.json").read_text())
    assert (told["width"], told["height"]) == size


def test_several_frames_are_numbered_and_each_has_its_figures(copied, capfd):
    words = ["--frames", "2-3,-1", "--percentage", "25", "--output", "out.exr"]
    assert cli.main(["render", str(copied), *words]) == 0
    out = capfd.readouterr().out.splitlines()
    names = ["out0002", "out0003", "out-0001"]
    assert out == [f"{name}.exr, and its figures in {name}.json" for name in names]
    for name, frame in zip(names, (2, 3, -1), strict=True):
        assert json.loads(Path(f"{name}.json").read_text())["frame"] == frame
    assert len(os.listdir()) == 7
    assert cli.main(["render", str(copied), *words, "--frames", "2"]) == 0  # its own are replaced


def test_several_frames_may_share_the_file_of_their_figures(copied, monkeypatch):
    words = ["--frames", "1-3", "--percentage", "25", "--output", "o_##.png", "--json"]
    assert cli.main(["render", str(copied), *words, "a.json"]) == 0
    told = json.loads(Path("a.json").read_text())
    assert [each["picture"] for each in told["frames"]] == ["o_01.png", "o_02.png", "o_03.png"]
    assert cli.main(["render", str(copied), *words, "b##.json"]) == 0
    assert json.loads(Path("b03.json").read_text())["frame"] == 3

    render_frame = cli.render_frame

    def fail_at_the_second(scene, lead):
        if scene.frame_current == 2:
            raise leapray.LeapRayError("no")
        return render_frame(scene, lead)

    monkeypatch.setattr(cli, "render_frame", fail_at_the_second)
    for path in Path().glob("*.*"):
        path.unlink()
    assert cli.main(["render", str(copied), *words, "a.json"]) == 1
    assert sorted(path.name for path in Path().glob("*.*")) == ["a.json", "o_01.png"]
    assert len(json.loads(Path("a.json").read_text())["frames"]) == 1  # the others stay whole


def test_frames_differ_and_are_those_of_single_renders(blend, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scene = open_file.open_scene(blend)
    cube = scene.objects["Cube"]
    for frame, x in ((1, 0.0), (2, 1.0)):
        cube.location.x = x
        cube.keyframe_insert("location", frame=frame)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "moving.blend"))
    words = ["render", "moving.blend", "--output"]
    assert cli.main([*words, "all#.exr", "--frames", "1-2"]) == 0
    assert cli.main([*words, "one#.exr", "--frame", "2"]) == 0
    first, second, single = (exr(Path(name)) for name in ("all1.exr", "all2.exr", "one2.exr"))
    for name, pixels in single.items():
        np.testing.assert_array_equal(second[name], pixels, err_msg=name)
    assert any(not np.array_equal(first[name], second[name]) for name in first)


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
    (["{blend}", "--pixel-error", "0"], 2, "--pixel-error must be at least 0.001, not 0.0"),
    (["{blend}", "--pixel-error", "nan"], 2, "--pixel-error must be at least 0.001, not nan"),
    (["{blend}", "--samples", "1000000"], 2, "--samples must be at most 65536, not 1000000"),
    (["{blend}", "--resolution", "0"], 2, "must be at least 1, not 0"),
    (["{blend}", "--samples", "0"], 2, "must be at least 1, not 0"),
    (["{blend}", "--resolution", "x"], 2, """invalid "auto" or integer value: 'x'"""),
    (["{blend}", "--threads", "1025"], 2, "must be at most 1024"),
    (["{blend}", "--frame", "1048575"], 2, "must be at most 1048574"),
    (["{blend}", "--hit-test", "guess"], 2, "invalid choice"),
    (["{blend}", "--interpolation", "cubic"], 1, "--interpolation is for measured data"),
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
    assert "shows nothing" in capfd.readouterr().err
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
