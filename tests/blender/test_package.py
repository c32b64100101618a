# SPDX-License-Identifier: GPL-3.0-or-later
"""The extension's zip holds what it must; a real Blender takes it, and renders by command."""

from __future__ import annotations

import re
import subprocess
import sys
import zipfile

import numpy as np
import pytest
from driver import pixels

import build

pytestmark = pytest.mark.alone

# ---- the zip ---------------------------------------------------------------


def test_the_zip_holds_the_addon_the_core_and_the_licence(archive):
    with zipfile.ZipFile(archive) as package:
        assert package.testzip() is None
        names = set(package.namelist())
        wheels = [name for name in names if name.endswith(".whl")]
        manifest = package.read("blender_manifest.toml").decode()
        assert len(wheels) > 5 and all(f'"./{name}"' in manifest for name in wheels)
        (wheel,) = (name for name in wheels if name.startswith("wheels/leapray-"))
        with package.open(wheel) as file, zipfile.ZipFile(file) as core:
            assert {"leapray/libleapray.so", "leapray/__init__.py"} <= set(core.namelist())
    assert archive.name.endswith("-linux_x64.zip")
    sources = build.ROOT / "addon"
    assert {str(path.relative_to(sources)) for path in sources.rglob("*.py")} <= names
    assert "LICENSE" in names
    assert not any("__pycache__" in name for name in names)


def test_blender_finds_the_zip_valid(blender, archive):
    done = blender.run("-c", "extension", "validate", blender.inside(blender.bring(archive)))
    assert done.returncode == 0, done.stdout
    assert "Success" in done.stdout or "No warnings" in done.stdout, done.stdout


def test_it_is_enabled_and_has_its_own_core(installed):
    done = installed.run(
        *("-b", "--python-exit-code", "3", "--python-expr"),
        "import bpy, leapray\n"
        "bpy.context.scene.render.engine = 'LEAPRAY'\n"
        "print('ENGINE', bpy.context.scene.render.engine)\n"
        "print('CORE', leapray.__file__)",
    )
    assert done.returncode == 0, done.stdout
    assert "ENGINE LEAPRAY" in done.stdout
    (core,) = (line for line in done.stdout.splitlines() if line.startswith("CORE"))
    assert core.startswith(f"CORE {installed.inside(installed.room)}/")


def test_it_brings_the_readers_of_volumes(installed):
    names = "mrcfile, nibabel, nrrd, pydicom, tifffile"
    words = f"import {names}; print('READERS', nibabel.__file__)"
    done = installed.run("-b", "--python-exit-code", "3", "--python-expr", words)
    assert done.returncode == 0, done.stdout
    (place,) = (line for line in done.stdout.splitlines() if line.startswith("READERS"))
    assert place.startswith(f"READERS {installed.inside(installed.room)}/")


# ---- commands ----------------------------------------------------------------


def test_blenders_command_line_renders(picture):
    said, path = picture
    assert "Saved: " in said and "Rendered " in said
    assert "Error" not in said and "Traceback" not in said, said
    found = pixels(path)
    assert found.std() > 20  # it shows something


def test_blenders_command_line_renders_an_animation(installed, scene):
    words = ["-E", "LEAPRAY", "-o", "//film_", "-F", "PNG", "-s", "1", "-e", "2", "-a"]
    done = installed.run("-b", installed.inside(scene), *words)
    assert done.returncode == 0, done.stdout
    first, second = (pixels(scene.with_name(f"film_000{frame}.png")) for frame in (1, 2))
    assert first.std() > 20 and second.std() > 20


def test_the_extensions_command_renders_the_same(installed, scene, picture, report_of):
    output = scene.with_name("command.png")
    words = ["--output", installed.inside(output), "--frame", "1"]
    done = installed.run("-c", "leapray", "render", installed.inside(scene), *words)
    assert done.returncode == 0, done.stdout
    assert done.stdout.splitlines()[-1].startswith(installed.inside(output))
    assert np.array_equal(pixels(output), pixels(picture[1]))
    report = report_of(output)
    assert report["rays"] > 0 and report["blender"] and not report["warnings"]


def test_it_renders_as_blenders_module_does(scene, picture, tmp_path):
    """Another Python, another Blender perhaps: one step of 255 for its colour management."""
    output = tmp_path / "module.png"
    words = ["-m", "addon.cli", "render", str(scene), "--output", str(output), "--frame", "1"]
    done = subprocess.run([sys.executable, *words], cwd=build.ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert abs(pixels(output) - pixels(picture[1])).max() <= 1


@pytest.mark.parametrize(
    "words",
    [
        ("--method", "maximum_depth"),
        ("--method", "leaping"),
        ("--method", "templates"),
        ("--preset", "ct_skin", "--samples", "1"),
    ],
    ids=lambda words: words[1],
)
def test_the_extensions_command_shows_a_scan_without_light(installed, words):
    head = installed.inside(installed.bring(build.ROOT / "blend_samples" / "head.nii.gz"))
    name = f"scan_{words[1]}.png"
    more = ("--percentage", "10", "--output", installed.inside(installed.room / name))
    done = installed.run("-c", "leapray", "render", head, *words, *more)
    assert done.returncode == 0, done.stdout
    shown = pixels(installed.room / name)
    assert shown[30:-30, 30:-30].std(axis=(0, 1)).max() > 20 and np.ptp(shown[0]) < 12


# ---- errors --------------------------------------------------------------------


@pytest.mark.parametrize(
    "words, culprit",
    [
        (["render", "SCENE", "--traverser", "nosuch"], "nosuch"),
        (["render", "/no/such.blend"], "/no/such.blend"),
        (["render", "SCENE", "--output", "/no/folder/out.png"], "/no/folder"),
    ],
)
def test_the_extensions_command_names_the_culprit(installed, scene, words, culprit):
    words = [installed.inside(scene) if word == "SCENE" else word for word in words]
    done = installed.run("-c", "leapray", *words)
    assert done.returncode != 0
    (line,) = (line for line in done.stdout.splitlines() if line.startswith("leapray: "))
    assert culprit in line and "Traceback" not in done.stdout


def test_a_scene_without_a_camera_fails_by_a_sentence_and_an_exit_code(installed, scene):
    strip = (
        "import bpy; [bpy.data.objects.remove(o) for o in bpy.data.objects if o.type == 'CAMERA']"
    )
    words = ["-E", "LEAPRAY", "-o", "//blind_", "-f", "1"]
    done = installed.run("-b", installed.inside(scene), "--python-expr", strip, *words)
    assert done.returncode != 0
    assert "camera" in done.stdout.lower() and "Traceback" not in done.stdout


SAMPLES = sorted((build.ROOT / "blend_samples").glob("*.blend"))


@pytest.mark.parametrize("sample", SAMPLES, ids=lambda path: path.stem)
def test_every_sample_renders(installed, sample, tmp_path):
    inside = installed.inside(installed.bring(sample))
    for data in (*sample.parent.glob("*.nii.gz"), *sample.parent.glob("*.vdb")):
        installed.bring(data)
    small = (
        "import bpy; scene = bpy.context.scene; scene.render.resolution_percentage = 15;"
        "scene.leapray.samples = 4; scene.leapray.pixel_error = 1"
    )
    words = ["-b", inside, "--python-expr", small, "-E", "LEAPRAY", "-o", f"//{sample.stem}_"]
    done = installed.run(*words, "-F", "PNG", "-f", "1")
    assert done.returncode == 0, done.stdout
    assert not re.search(r"Warning: |reports +\| WARNING", done.stdout), done.stdout
    shown = pixels(installed.room / f"{sample.stem}_0001.png")
    assert shown.std(axis=(0, 1)).min() > 8  # a picture
