# SPDX-License-Identifier: GPL-3.0-or-later
"""Render methods in Blender and on the command line: pictures, animations, previews, refusals."""

import json
import re
from pathlib import Path

import bpy
import numpy as np
import pytest
import scenes
import vdb_files
from blender_scenes import combined, diffuse, exr, fresh, light, mesh, polygons, put
from mathutils import Vector

import leapray
from addon import cli, image_method, methods
from addon.blender import engine, result, ui

nibabel = pytest.importorskip("nibabel")
METHODS = leapray.image_methods()
HEAD = Path(__file__).resolve().parents[2] / "blend_samples" / "head.nii.gz"


@pytest.fixture(autouse=True)
def nothing_kept():
    yield
    engine._volumes.clear()


@pytest.fixture
def scene():
    """A turned cube of one colour before a ball of fog, seen by parallel rays."""
    made = fresh(settings={"samples": 1})
    made.render.resolution_x, made.render.resolution_y = 48, 40
    made.view_settings.view_transform = "Raw"
    camera = made.camera.data
    camera.type, camera.ortho_scale = "ORTHO", 4.0
    cube = put("Cube", mesh(size=1.0), location=(0.6, 0, 1), rotation_euler=(0.4, 0.5, 0.6))
    cube.data.materials.append(diffuse("Red", (0.9, 0.1, 0.1)))
    put("Sun", light("SUN", energy=3.0), rotation_euler=(0.5, 0.3, 0.0))
    return made


def add_fog(folder):
    volume = bpy.data.volumes.new("Fog")
    volume.filepath = vdb_files.write(folder / "fog.vdb", vdb_files.fog())
    return put("Fog", volume, location=(-0.5, 0, -1))


@pytest.mark.parametrize("shown", ["auto", "volume", "labels"])
def test_projections_ask_neither_for_a_threshold_nor_for_a_shader(scene, shown, tmp_path):
    """Of one value everywhere, of which no surface is found, and without a material."""
    volume = bpy.data.volumes.new("Even")
    image = nibabel.Nifti1Image(np.full((16, 16, 16), 0.5, np.float32), 100 * np.eye(4))
    nibabel.save(image, tmp_path / "even.nii")
    volume.leapray.file = str(tmp_path / "even.nii")
    volume.leapray.shown = shown
    put("Even", volume, location=(-0.8, -0.8, 0))
    scene.leapray.method, scene.leapray.samples = "maximum", 1
    bpy.ops.render.render()
    assert combined(scene)[24, 32, :3].min() == 1.0
    (report,) = engine.reports.values()
    assert report["values"] == [0.5, 0.5]
    assert report["warnings"] == [
        "The render method maximum shows values of volume objects alone, without 'Cube'."
    ]


@pytest.mark.parametrize("entry", METHODS, ids=lambda entry: entry.name)
def test_each_method_gives_a_picture_in_blender(scene, entry):
    scene.leapray.method = entry.spec
    bpy.ops.render.render()
    picture = combined(scene)
    red = picture[..., 0] > 2 * picture[..., 1]
    assert 0.03 < red.mean() < 0.2 and (picture[~red][:, :3] == 0).all()
    (report,) = engine.reports.values()
    assert report["method"] == entry.spec and report["bytes"]["method"] > 0 and report["rays"] > 0


@pytest.mark.parametrize("method", methods.PROJECTIONS, ids=lambda method: method.spec)
def test_each_projection_gives_a_picture_in_blender(scene, method, tmp_path):
    add_fog(tmp_path)
    scene.leapray.method = method.spec
    bpy.context.view_layer.leapray.use_pass_value = True
    bpy.ops.render.render()
    picture = combined(scene)
    assert picture[..., :3].max() > 0.4 or method.mode == "minimum"
    (report,) = engine.reports.values()
    assert report["method"] == method.spec and report["values"] == pytest.approx([0, 2], abs=1e-3)
    assert "values of volume objects alone, without 'Cube'" in " ".join(report["warnings"])


@pytest.mark.parametrize("entry", METHODS, ids=lambda entry: entry.name)
def test_a_scan_is_rendered_directly_by_each_method(entry, tmp_path, monkeypatch):
    """Also by those of parallel rays: the head takes a good part of the picture."""
    monkeypatch.chdir(tmp_path)
    words = ["render", str(HEAD), "--method", entry.spec, "--percentage", "8", "--output", "a.exr"]
    assert cli.main(words) == 0
    seen = exr(Path("a.exr"))["ViewLayer.Depth.Z"] < 1e9
    assert 0.1 < seen.mean() < 0.5 and not seen[0].any() and not seen[:, 0].any()
    assert bpy.context.scene.view_settings.view_transform == "Standard"


def test_comparisons_with_cycles_are_by_rays(scene):
    from addon.study import frames

    scene.leapray.method = "leaping"
    frames.prepare(scene)
    assert scene.leapray.method == methods.RAYS.spec


def test_the_value_pass_holds_the_projected_values(scene, tmp_path):
    add_fog(tmp_path)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "fog.blend"))
    out = tmp_path / "out.exr"
    words = ["render", str(tmp_path / "fog.blend"), "--method", "maximum", "--output", str(out)]
    assert cli.main(words) == 0
    (pass_,) = (each for each in result.PASSES if each.name == "Value")
    value = exr(out)[f"ViewLayer.{pass_.blender_name()}.X"]
    assert value.max() == pytest.approx(2.0, abs=1e-5) and (value == 0).mean() > 0.3


def test_an_animation_by_leaping_has_the_frames_of_single_renders(scene, tmp_path, monkeypatch):
    """Also where volumes are not kept between frames otherwise."""
    monkeypatch.chdir(tmp_path)
    corners, faces = [], []
    for at in (-0.6, 0.6):  # two cubes, and much that is empty in their box
        corners += [Vector(v.co) * 0.4 + Vector((at, at, at)) for v in mesh().vertices]
        faces += [[i + len(corners) - 8 for i in face.vertices] for face in mesh().polygons]
    put("Pair", polygons("Pair", corners, faces), location=(-0.4, -0.4, 0))
    for frame, x in ((1, 0.0), (4, 0.03)):
        scene.camera.location.x = x
        scene.camera.keyframe_insert("location", frame=frame)
    assert not scene.render.use_persistent_data
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "turn.blend"))
    words = ["render", "turn.blend", "--method", "leaping", "--output"]
    assert cli.main([*words, "all#.exr", "--frames", "1-4"]) == 0
    shares = [json.loads(Path(f"all{n}.json").read_text())["skipped_share"] for n in range(1, 5)]
    assert shares[0] == 0 and min(shares[1:]) > 0.02
    for n in range(1, 5):
        engine._volumes.clear()
        assert cli.main([*words, "one#.exr", "--frame", str(n)]) == 0
        alone = exr(Path(f"one{n}.exr"))
        for name, pixels in exr(Path(f"all{n}.exr")).items():
            np.testing.assert_array_equal(pixels, alone[name], err_msg=name)
        assert json.loads(Path(f"one{n}.json").read_text())["skipped_share"] == 0


def test_previews_of_materials_are_made_by_rays(scene):
    class Preview:
        is_preview = True

    scene.leapray.method = "mean"
    depsgraph = bpy.context.evaluated_depsgraph_get()
    assert engine.LeapRayEngine._settings(Preview(), depsgraph).method == methods.RAYS.spec


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--method", "leping"], "did you mean leaping?"),
        (["--method", "leaping:walk=jumps"], "leaping has walk=spheres|cells, not 'walk=jumps'"),
        (["--method", "pixel_skip"], "counts on parallel rays: the camera must be orthographic"),
        (["--method", "mean"], "and the scene has no data of any"),
        (["--method", "leaping", "--pixel", "3,3"], "told of the render method rays"),
    ],
)
def test_what_a_method_cannot_do_is_a_sentence_and_no_picture(
    scene, tmp_path, monkeypatch, capfd, words, sentence
):
    monkeypatch.chdir(tmp_path)
    scene.camera.data.type = "PERSP"
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "cube.blend"))
    assert cli.main(["render", "cube.blend", *words]) == 1
    lines = capfd.readouterr().err.strip().splitlines()
    assert sentence in lines[-1] and lines[-1].startswith("leapray: ")
    assert not list(tmp_path.glob("*.png")) and not list(tmp_path.glob("*.json"))


@pytest.mark.parametrize("entry", leapray.image_variants(), ids=lambda entry: entry.spec)
def test_the_menu_says_which_methods_want_parallel_rays_and_which_miss(entry):
    (about,) = [each.tooltip for each in methods.choices() if each.name == entry.spec]
    view = scenes.camera(width=8, height=8, scale=None)
    made = scenes.scene([scenes.box()], [scenes.place()], view=view, width=8, height=8)
    try:
        image_method.check(made, methods.find(entry.spec))
    except leapray.LeapRayError:
        assert about.endswith(", by orthographic cameras alone")
    else:
        assert "orthographic" not in about
    assert bool(re.search(r"loses|off the rays|beside its ray", about)) != entry.exact


def test_projections_of_data_that_cannot_be_read_say_why(scene, tmp_path):
    data = add_fog(tmp_path).data
    data.leapray.grid = "smoke"
    scene.leapray.method = "mean"
    with pytest.raises(RuntimeError, match=r"no data of any; Skipped 'Fog': .* no grid 'smoke'"):
        bpy.ops.render.render()


class Layout:
    """Stands in for a layout of Blender's: notes properties, and whether they are active."""

    def __init__(self, drawn=None):
        self.drawn = {} if drawn is None else drawn
        self.active = self.use_property_decorate = True

    def column(self, **_):
        return Layout(self.drawn)

    row = column

    def prop(self, owner, name, **_):
        self.drawn[name] = self

    def prop_decorator(self, *_):
        pass


def test_the_panel_begins_with_the_method_and_greys_what_it_does_not_use(scene):
    for method, sampled, traced in (
        ("rays", True, True),
        ("leaping", False, False),
        ("mean", False, True),
    ):
        scene.leapray.method = method

        class Panel(ui._Panel):
            layout = Layout()

        ui.RENDER_PT_leapray.draw(Panel(), bpy.context)
        drawn = Panel.layout.drawn
        assert next(iter(drawn)) == "method"
        assert (drawn["samples"].active, drawn["traverser"].active) == (sampled, traced)
