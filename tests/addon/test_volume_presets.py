# SPDX-License-Identifier: GPL-3.0-or-later
"""Looks of volumes by presets: the values that they lie between, their nodes beside Cycles, and
where a user finds them."""

import json
from pathlib import Path

import bpy
import numpy as np
import pytest
import vdb_files
from blender_scenes import fresh, mesh, put, read
from engines import bare, blocks, both, warnings

import leapray
from addon import cli, pipeline
from addon.blender import engine, ui, volume_looks
from addon.blender.presets import LOOKS
from leapray.scalar_grid import ScalarGrid

HEAD = Path(__file__).resolve().parents[2] / "blend_samples" / "head.nii.gz"
TISSUES = HEAD.with_name("head_labels.nii.gz")


def grid(values, **more):
    return ScalarGrid("data", np.asarray(values, np.float32).reshape(1, 1, -1), np.eye(4), **more)


def ct():
    return np.linspace(-1000, 2000, 3001)


def fog(folder):
    volume = bpy.data.volumes.new("Fog")
    volume.filepath = vdb_files.write(folder / "fog.vdb", vdb_files.fog())
    volume.render.step_size = 0.01
    return put("Fog", volume)


def folded(picture):
    """Means of blocks, and of a block and its mirror images, which show the same."""
    mean = blocks(picture, 4)
    mean = mean + mean[::-1]
    return (mean + mean[:, ::-1]) / 4


def choose(ob, name):
    bpy.context.view_layer.objects.active = ob
    assert bpy.ops.object.leapray_volume_preset(preset=name) == {"FINISHED"}


# ---- values -----------------------------------------------------------------------------


@pytest.mark.parametrize("name", [name for name, look in LOOKS.items() if look.hounsfield])
def test_looks_of_ct_lie_in_hounsfield_units_where_data_are_such(name):
    look = LOOKS[name]
    told = volume_looks.limits(grid(ct() / 3 + 5, quantity="HU"), look)
    assert told == (*look.hounsfield, "Hounsfield units, as the file says")
    low, high, how = volume_looks.limits(grid(ct()), look)
    assert (low, high) == look.hounsfield
    assert how == "taken for Hounsfield units, for the values go from -1000 to 2000"
    low, high, how = volume_looks.limits(grid(ct() + 1000), look)
    first, last = look.percentiles
    assert how == f"{first:g} to {last:g} % of the samples"
    assert (low, high) == pytest.approx((30 * first, 30 * last), abs=2)


@pytest.mark.parametrize("name", ["mr", "fire"])
def test_other_looks_lie_between_percentiles_and_hide_the_background(name):
    """Of data that are 0 in most places all that is 0 is clear."""
    values = np.r_[np.zeros(6000), np.linspace(100, 500, 4000)]
    low, high, _ = volume_looks.limits(grid(values), LOOKS[name])
    assert 0 < low < 2 and 490 < high <= 500
    assert LOOKS[name].stops[0][2] == 0


@pytest.mark.parametrize("wild", [3e4, 1e9, 1e30, np.inf, -1e30])
@pytest.mark.parametrize("name", ["mr", "fire", "ct_bone"])
def test_a_few_wild_values_do_not_move_percentiles(name, wild):
    values = np.random.default_rng(0).normal(100, 20, 40000).astype(np.float32)
    values[:3] = wild
    low, high, how = volume_looks.limits(grid(values), LOOKS[name])
    first, last = LOOKS[name].percentiles
    assert (low, high) == pytest.approx(np.percentile(values, (first, last)), rel=0.01)
    assert how == f"{first:g} to {last:g} % of the samples"
    assert leapray.first_threshold(grid(values))[0] == pytest.approx(100, abs=10)


def test_data_of_one_value_have_a_range_and_data_of_none_a_sentence():
    low, high, _ = volume_looks.limits(grid([7.0, 7.0]), LOOKS["mr"])
    assert low < high
    with pytest.raises(leapray.LeapRayError, match="holds no sample with a value"):
        volume_looks.limits(grid([np.nan]), LOOKS["mr"])


def test_the_sentence_on_labels_says_what_lies_beyond_them():
    for values, how in (
        ([0, 3, 31], "the labels of the data"),
        ([0, 3, 40], "values go from 0 to 40, and those beyond look like the ends"),
        ([-1000, 3, 30], "values go from -1000 to 30, and those beyond look like the ends"),
    ):
        low, high, told = volume_looks.limits(grid(np.int16(values)), LOOKS["labels"])
        assert (low, high, told) == (-0.5, min(values[-1], 31) + 0.5, how)


def test_labels_have_the_colors_that_they_have_as_bodies():
    fresh()
    volume = bpy.data.volumes.new("Labels")
    volume.leapray.file = str(TISSUES)
    choose(put("Labels", volume), "labels")
    (ramp,) = (n for n in volume.materials[0].node_tree.nodes if n.type == "VALTORGB")
    elements = ramp.color_ramp.elements
    assert len(elements) == 7 and ramp.color_ramp.interpolation == "CONSTANT"
    data = leapray.read_volume(TISSUES)
    for number, element in enumerate(elements):
        at = (number + 0.5) / 7  # in the middle of its values
        assert ramp.color_ramp.evaluate(at)[:3] == pytest.approx(
            volume_looks.color_of(data, number), abs=1e-6
        )
        assert element.color[3] == (number > 0)


# ---- pictures ---------------------------------------------------------------------------


@pytest.mark.parametrize("name", [name for name, look in LOOKS.items() if not look.shading])
def test_a_look_is_that_of_cycles(name, tmp_path):
    scene = bare()
    scene.camera.location.z = 4.0
    ob = fog(tmp_path)
    choose(ob, name)
    a, b = (folded(each["Combined"]) for each in both(scene, samples=256))
    assert not warnings() and ob.data.leapray.shown == "volume"
    assert a[..., :3].max() > 0.02
    assert np.abs(a - b)[..., :3].max() < 0.03 * max(a.max(), 1)


def test_skin_is_a_veil_over_the_bone(monkeypatch, tmp_path):
    """Beside the skull the head is seen, dimmer; where there is bone, it is as without skin."""
    monkeypatch.chdir(tmp_path)
    seen = {}
    for name in ("ct_skin", "ct_bone"):
        words = ["--preset", name, "--percentage", "8", "--samples", "1", "--json", f"{name}.json"]
        assert cli.main(["render", str(HEAD), *words, "--output", f"{name}.exr"]) == 0
        from blender_scenes import exr

        seen[name] = exr(Path(f"{name}.exr"))["ViewLayer.Combined.R"]
        assert json.loads(Path(f"{name}.json").read_text())["volumes"][0]["kind"] == "volume"
    sky = seen["ct_bone"][0, 0]
    veil = (np.abs(seen["ct_bone"] - sky) < 0.005) & (seen["ct_skin"] > sky + 0.02)
    bone = seen["ct_bone"] > 0.6
    assert veil.sum() > 50 and bone.sum() > 200
    assert 0.7 < np.median(seen["ct_skin"][bone] / seen["ct_bone"][bone]) < 1.2
    assert seen["ct_skin"][veil].mean() < 0.7 * seen["ct_bone"][bone].mean()


def test_a_projection_takes_the_colors_of_a_look(tmp_path):
    scene = fresh()
    scene.leapray.method = "maximum"
    choose(fog(tmp_path), "fire")
    frame = pipeline.render(read(32, 32))
    red, _, blue = frame.passes["Combined"][..., :3].max(axis=(0, 1))
    assert red > 0.9 and blue < red


# ---- where it is found ------------------------------------------------------------------


def test_the_operator_says_between_which_values_and_replaces_only_the_first_material(tmp_path):
    fresh()
    ob = fog(tmp_path)
    first, second = (bpy.data.materials.new(n) for n in ("First", "Second"))
    for each in (first, second):
        ob.data.materials.append(each)
    choose(ob, "fire")
    assert [m.name for m in ob.data.materials] == ["Fire", "Second"]
    assert first.name in bpy.data.materials
    told = volume_looks.apply(ob, bpy.context.evaluated_depsgraph_get(), "mr")
    assert told.startswith("MR from ") and told.endswith("50 to 99.5 % of the samples")


def test_what_cannot_be_read_is_told_and_nothing_changes(tmp_path):
    fresh()
    volume = bpy.data.volumes.new("Gone")
    volume.leapray.file = str(tmp_path / "gone.nii")
    ob = put("Gone", volume)
    bpy.context.view_layer.objects.active = ob
    with pytest.raises(RuntimeError, match=r"gone\.nii"):
        bpy.ops.object.leapray_volume_preset(preset="mr")
    assert len(volume.materials) == 0 and volume.leapray.shown == "auto"
    bpy.context.view_layer.objects.active = put("Cube", mesh())
    assert not bpy.ops.object.leapray_volume_preset.poll()


class Layout:
    """Stands in for a layout of Blender's: notes the operators that are offered."""

    def __init__(self):
        self.offered = []

    def operator(self, name, text=""):
        self.offered.append((name, text))
        return self


def test_the_menu_of_the_panel_offers_every_look():
    fresh()

    class Menu:
        layout = Layout()

    ui.DATA_MT_leapray_volume_presets.draw(Menu(), bpy.context)
    labels = [look.label for look in LOOKS.values()]
    assert Menu.layout.offered == [("object.leapray_volume_preset", label) for label in labels]


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["{head}", "--preset", "ct"], "--preset: invalid choice: 'ct'"),
        (["{head}", "--preset", "mr", "--threshold", "5"], "and --threshold is for surfaces"),
        (["{head}", "--preset", "mr", "--clip", "x=0.5"], "and --clip is for surfaces"),
        (["{head}", "--method", "mean", "--threshold", "5"], "and --threshold is for surfaces"),
        (
            ["{head}", "--method", "maximum_depth", "--interpolation", "cubic"],
            "--method maximum_depth shows values without a surface, and --interpolation is",
        ),
        (["a.blend", "--preset", "mr"], "--preset is for measured data, and a.blend is a scene"),
    ],
)
def test_what_does_not_go_with_a_preset_is_a_sentence(
    words, sentence, capfd, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    Path("a.blend").write_bytes(b"")
    words = [word.format(head=HEAD) for word in words]
    assert cli.main(["render", *words]) in (1, 2)
    assert sentence in capfd.readouterr().err
    assert not list(tmp_path.glob("*.png"))
    assert engine.pixel is None
