# SPDX-License-Identifier: GPL-3.0-or-later
"""One pixel's paths by the command line: they make the pixel of the whole picture."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
import pytest
import scenes
from blender_scenes import exr, fresh, light, mesh, put

import leapray
from addon import cli, model, pipeline, pixel_report
from addon.blender import engine

ROOT = Path(__file__).resolve().parents[2]
SAMPLES = ROOT / "blend_samples"
WORDS = ("--percentage", "8", "--samples", "3")


def pixel(capsys, scene, place, *words):
    """(text, data) of a pixel."""
    told = Path("told.json")
    capsys.readouterr()
    code = cli.main(
        ["render", str(scene), "--pixel", "{},{}".format(*place), "--json", str(told), *words]
    )
    captured = capsys.readouterr()
    assert code == 0, captured.err
    return captured.out, json.loads(told.read_text())["pixel"]


def combined(picture):
    """(height, width, 4) of an EXR file, rows from below."""
    channels = exr(picture)
    names = [next(n for n in channels if n.endswith(f"Combined.{c}")) for c in "RGBA"]
    return np.stack([channels[name] for name in names], axis=-1)


@pytest.mark.parametrize("name", ["mirrors", "glass"])
def test_the_paths_of_a_pixel_make_the_pixel_of_the_picture(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    scene = SAMPLES / f"{name}.blend"
    assert cli.main(["render", str(scene), "--output", "whole.exr", *WORDS]) == 0
    picture = combined(Path("whole.exr"))
    height, width = picture.shape[:2]
    for x, y in ((width // 2, height // 3), (width // 4, height // 2), (0, height - 1)):
        text, told = pixel(capsys, scene, (x, y), *WORDS)
        assert (np.float32(told["value"]) == picture[y, x]).all(), (x, y)
        lights = [entry for ray in told["rays"] for entry in ray["light"]]
        total = np.sum([entry["contribution"] for entry in lights], axis=0)
        np.testing.assert_allclose(total, told["value"][:3], atol=1e-6)
        np.testing.assert_allclose(lights[-1]["sum"], told["value"][:3], atol=1e-6)
        assert told["samples"] == 3 and told["events_lost"] == 0
        assert text.count("  Ray ") == len(told["rays"])
        assert f"Pixel {x},{y}, counted from the lower left; 3 samples" in text
        value = "({:.6g}, {:.6g}, {:.6g})".format(*told["value"][:3])
        assert f"The pixel's value: {value}" in text
    assert sorted(path.name for path in Path().iterdir()) == [
        "told.json",
        "whole.exr",
        "whole.json",
    ]


# ---- what is said of a ray -------------------------------------------------------


def ball_scene(**settings):
    """A mirror ball of radius 1 over a floor at z = -1, 96 x 64 pixels."""
    mirror = model.Material("Mirror", (model.Lobe("glossy", (0.9, 0.9, 0.9)),))
    made = scenes.scene(
        [scenes.sphere(n=32), scenes.plane(20.0)],
        [
            scenes.place(0, name="Ball", materials=(2,)),
            scenes.place(1, name="Floor", at=(0, 0, -1), materials=(1,)),
        ],
        view=scenes.camera(eye=(0, -6, 1)),
        **settings,
    )
    return replace(made, materials=(*made.materials, mirror))


def test_a_mirror_ball_is_told_as_its_geometry_is():
    told = pipeline.render(ball_scene(), pixel=(48, 30)).report["pixel"]
    first, second = told["rays"][:2]
    o, d = np.array(first["origin"]), np.array(first["direction"])
    np.testing.assert_allclose(o, (0, -6, 1), atol=1e-9)
    a, b = d @ d, o @ d
    t = (-b - np.sqrt(b * b - a * (o @ o - 1))) / a
    hit = first["hit"]
    assert hit["t"] == pytest.approx(t, abs=0.01)
    assert hit["distance"] == pytest.approx(hit["t"] * np.sqrt(a))
    assert (hit["object"], hit["material"]) == ("Ball", "Mirror") and not hit["from_inside"]
    np.testing.assert_allclose(np.linalg.norm(hit["position"]), 1, atol=0.01)
    n = np.array(hit["normal"])
    np.testing.assert_allclose(n, hit["position"], atol=0.05)
    want = d - 2 * (d @ n) * n
    assert second["kind"] == "glossy" and second["after"] == 0 and second["leaves"] == "Ball"
    np.testing.assert_allclose(second["direction"], want / np.linalg.norm(want), atol=1e-6)
    np.testing.assert_allclose(second["throughput"], (0.9, 0.9, 0.9), atol=0.02)
    assert sum(v["cells"] for v in first["volumes"]) == first["cells"]  # the floor's too
    last = first["volumes"][-1]
    assert last["object"] == "Ball" and last["list"][-1] == hit["cell"]


def test_layout_scene_names_the_object_that_is_hit():
    frame = pipeline.render(ball_scene(layout="scene"), pixel=(48, 4))
    hit = frame.report["pixel"]["rays"][0]["hit"]
    assert (hit["object"], hit["material"]) == ("Floor", "Red")


def test_the_value_follows_the_films_exposure():
    scene = replace(ball_scene(samples=4), film_exposure=0.5)
    frame = pipeline.render(scene, pixel=(20, 10))
    told = frame.report["pixel"]
    picture = pipeline.render(scene).passes["Combined"]
    assert (np.float32(told["value"]) == picture[10, 20]).all()
    np.testing.assert_allclose(told["sum"], told["value"][:3], atol=1e-6)
    assert min(told["value"][:3]) > 0


# ---- cells ---------------------------------------------------------------------


def pierced(o, d, end):
    """The cells that a ray pierces up to t = end, from the crossings of all planes."""
    crossings = [0.0, end]
    for axis in range(3):
        planes = np.arange(-60, 60)
        t = (planes - o[axis]) / d[axis]
        crossings += t[(t > 0) & (t < end)].tolist()
    ts = np.unique(crossings)
    return np.floor(o + ((ts[1:] + ts[:-1]) / 2)[:, None] * d).astype(int)


def test_the_cells_listed_are_those_that_the_ray_pierces():
    z, y, x = np.mgrid[:40, :40, :40] - 20.0
    ball = np.clip(12.5 - np.sqrt(x * x + y * y + z * z), 0, 1).astype(np.float32)
    structure = leapray.build(leapray.Volume(ball), "aw")
    lo, hi = structure.volume.info.surface_lo, structure.volume.info.surface_hi
    rng = np.random.default_rng(3)
    for _ in range(20):
        o = rng.uniform(-8, 0, 3)
        d = rng.uniform(18, 22, 3) - o
        t = leapray.trace(structure, o, d).t[0]
        assert np.isfinite(t)
        count, cells = pixel_report.Ray(structure, o, d).visited_cells(t, 1000)
        inside = [c for c in pierced(o, d, t) if (c >= lo).all() and (c <= hi).all()]
        assert count == len(inside) == len(cells)
        np.testing.assert_array_equal(cells, inside)
        few = pixel_report.Ray(structure, o, d).visited_cells(t, 5)
        assert few[0] == count and np.array_equal(few[1], inside[:5])


def test_a_leaping_traverser_visits_fewer_of_the_same_cells():
    z, y, x = np.mgrid[:40, :40, :40] - 20.0
    ball = np.clip(12.5 - np.sqrt(x * x + y * y + z * z), 0, 1).astype(np.float32)
    volume = leapray.Volume(ball)
    o, d = np.array([-3.0, 4.2, 6.1]), np.array([1.0, 0.61, 0.53])
    t = leapray.trace(leapray.build(volume, "aw"), o, d).t[0]
    walked = pixel_report.Ray(leapray.build(volume, "aw"), o, d).visited_cells(t, 1000)[1]
    count, leapt = pixel_report.Ray(leapray.build(volume, "cd"), o, d).visited_cells(t, 1000)
    assert 2 < count == len(leapt) < len(walked)
    assert {tuple(c) for c in leapt} <= {tuple(c) for c in walked}


def test_cells_beyond_the_limit_are_counted(monkeypatch):
    monkeypatch.setattr(pixel_report, "CELLS_LISTED", 3)
    told = pipeline.render(ball_scene(traverser="aw", resolution=60), pixel=(60, 40)).report
    ray = told["pixel"]["rays"][0]
    assert sum(len(v["list"]) for v in ray["volumes"]) == 3 < ray["cells"]
    more = ray["volumes"][-1]["cells"] - len(ray["volumes"][-1]["list"])
    assert any(line.endswith(f" ... {more} more") for line in pixel_report.lines(told["pixel"]))


# ---- the command line ------------------------------------------------------------


@pytest.fixture
def cube(tmp_path, monkeypatch):
    """A file with a cube under a sun, 64 x 48 pixels; it lies in the current folder."""
    monkeypatch.chdir(tmp_path)
    scene = fresh()
    put("Cube", mesh(), rotation_euler=(0.4, 0.5, 0.6))
    put("Sun", light("SUN"))
    scene.leapray.samples = 2
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "cube.blend"))
    return tmp_path / "cube.blend"


def test_a_pixel_that_is_not_there_gets_one_sentence(cube, capsys):
    for place in ("64,0", "0,48", "-1,3"):
        assert cli.main(["render", str(cube), "--pixel", place]) == 1
        assert capsys.readouterr().err.endswith(
            "leapray: The picture has 64 x 48 pixels, 0,0 to 63,47 from its lower left corner; "
            f"there is no pixel {place}\n"
        )
    for word in ("12", "1,2,3", "a,b", "1.5,2"):
        assert cli.main(["render", str(cube), "--pixel", word]) == 2
        assert capsys.readouterr().err == f"leapray: --pixel must be like 120,45, not {word}\n"
    for words in (["--output", "a.png"], ["--frames", "1-2"]):
        assert cli.main(["render", str(cube), "--pixel", "1,2", *words]) == 1
        assert "--pixel writes no picture" in capsys.readouterr().err
    assert cli.main(["render", str(cube), "--pixel", "1,2", "--json", str(cube)]) == 1
    assert "must be different files" in capsys.readouterr().err
    assert engine.pixel is None


def test_pixels_are_counted_in_the_picture_whatever_region_is_rendered(cube, capsys):
    inside = (30, 20)
    _, want = pixel(capsys, cube, inside)
    assert want["rays"][0]["hit"]["object"] == "Cube"
    for crop, place in ((False, inside), (True, (30 - 16, 20 - 12))):
        scene = bpy.context.scene
        scene.render.use_border, scene.render.use_crop_to_border = True, crop
        scene.render.border_min_x = scene.render.border_min_y = 0.25
        bpy.ops.wm.save_as_mainfile(filepath=str(cube))
        _, told = pixel(capsys, cube, place)
        np.testing.assert_allclose(
            told["rays"][0]["direction"], want["rays"][0]["direction"], atol=1e-2
        )
        assert told["rays"][0]["hit"]["object"] == "Cube"
        shutil.copy(cube, "copy.blend")
        if not crop:
            assert cli.main(["render", "copy.blend", "--pixel", "3,3"]) == 1
            assert "lies outside the render region, which holds 16,12 to 63,47" in (
                capsys.readouterr().err
            )


def test_every_view_layer_is_told(cube, capsys):
    bpy.context.scene.view_layers.new("Other")
    bpy.ops.wm.save_as_mainfile(filepath=str(cube))
    text, _ = pixel(capsys, cube, (30, 20), "--frame", "3")
    assert "View layer ViewLayer\n" in text and "View layer Other\n" in text
    data = json.loads(Path("told.json").read_text())
    assert data["frame"] == 3 and set(data["view_layers"]) == {"ViewLayer", "Other"}


# ---- the page --------------------------------------------------------------------

PAGE = ROOT / "docs" / "wrong-pixel.md"
EXAMPLES = re.findall(
    r"```\npython3 build.py (render blend_samples/[^\n]*)\n```\n\n```\n(.*?)```",
    PAGE.read_text(encoding="utf-8"),
    re.S,
)


@pytest.mark.parametrize(("command", "shown"), EXAMPLES)
def test_the_worked_example_prints_what_the_page_says(command, shown, capsys, monkeypatch):
    monkeypatch.chdir(ROOT)
    assert cli.main(command.split()) == 0
    printed = capsys.readouterr().out
    at = 0
    for part in shown.split("...\n"):
        found = printed.find(part, at)
        assert found >= 0, f"not printed: {part}"
        at = found + len(part)


def test_the_page_has_its_examples():
    assert len(EXAMPLES) == 2
