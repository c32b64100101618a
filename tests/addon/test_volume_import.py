# SPDX-License-Identifier: GPL-3.0-or-later
"""Measured data: imported as objects, shown in the panel, rendered by the command line."""

import json
from dataclasses import replace
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
import vdb_files
from blender_scenes import fresh, light, mesh, put, read

import leapray
from addon import cli, pipeline
from addon.blender import data_scene, engine, operators, ui, volume_data

SPACING = 5.0  # mm
SIZE = 40, 36, 32
RADIUS = 60.0  # mm, of the ball of bone in air
CENTRE = 30.0, -20.0, 100.0  # mm


@pytest.fixture
def scene():
    made = fresh()
    put("Sun", light("SUN", energy=3.0), rotation_euler=(0.4, 0.3, 0.0))
    return made


def scan(folder, name="scan", **more):
    """A raw file of a ball of 1000 HU in -1000 HU round CENTRE, with its layout beside."""
    first = np.array(CENTRE) - (np.array(SIZE) - 1) / 2 * SPACING
    axes = [first[k] + SPACING * np.arange(SIZE[k]) - CENTRE[k] for k in range(3)]
    x, y, z = np.meshgrid(*axes, indexing="ij")
    values = (200.0 * (RADIUS - np.sqrt(x * x + y * y + z * z)) / SPACING).clip(-1000, 1000)
    values.T.astype("<i2").tofile(folder / f"{name}.raw")
    layout = {"size": SIZE, "dtype": "int16", "spacing": [SPACING] * 3, "origin": first.tolist(),
              "meters": 1e-3, "quantity": "HU"}  # fmt: skip
    (folder / f"{name}.json").write_text(json.dumps(layout | more))
    return folder / f"{name}.raw"


def imported(path, **more):
    assert bpy.ops.object.leapray_import(filepath=str(path), **more) == {"FINISHED"}
    return bpy.context.object


def points():
    """Where the camera's rays meet the volume, in the world."""
    bpy.context.view_layer.update()
    job = replace(read(96, 72), passes=("Combined", "Position", "Object Index"))
    frame = pipeline.render(job)
    assert frame.warnings == []
    found = frame.passes["Position"][frame.passes["Object Index"][..., 0] == 1]
    assert len(found) > 100
    return found


# ---- import --------------------------------------------------------------------


@pytest.mark.parametrize("scale_length", [1.0, 0.001])
def test_a_scan_lies_where_its_file_says_in_the_scenes_units(scale_length, scene, tmp_path):
    scene.unit_settings.scale_length = scale_length
    ob = imported(scan(tmp_path))
    ob.pass_index = 1
    unit = 1e-3 / scale_length
    assert ob.type == "VOLUME" and ob.name == "scan" and ob.data.leapray.automatic
    assert tuple(ob.scale) == pytest.approx((unit,) * 3) and len(ob.material_slots) == 1
    centre = np.array(CENTRE) * unit
    bpy.context.view_layer.update()
    box = np.array(bpy.data.objects["scan box"].matrix_world)
    assert box[:3, 3] == pytest.approx(centre)
    assert np.diag(box)[:3] == pytest.approx((np.array(SIZE) - 1) / 2 * SPACING * unit)
    scene.camera.location = centre + np.array((0, 0, 0.4 / scale_length))
    scene.camera.data.clip_start, scene.camera.data.clip_end = 1e-3, 1e6
    distance = np.linalg.norm(points() - centre, axis=1)
    # Otsu's threshold lies between air and bone: up to some millimetres within the ramp
    assert np.abs(distance - RADIUS * unit).max() < 2 * SPACING * unit and distance.std() < unit


def test_what_would_be_too_small_to_be_seen_is_a_unit_long(scene, tmp_path):
    ob = imported(scan(tmp_path, meters=1e-10))  # a map of a molecule
    longest = (max(SIZE) - 1) * SPACING
    assert tuple(ob.scale) == pytest.approx((1 / longest,) * 3)


def test_a_dropped_file_is_imported_without_a_dialog(scene, tmp_path):
    done = bpy.ops.object.leapray_import("INVOKE_DEFAULT", filepath=str(scan(tmp_path)))
    assert done == {"FINISHED"} and bpy.context.object.name == "scan"


def test_a_given_threshold_is_in_the_datas_units(scene, tmp_path):
    ob = imported(scan(tmp_path))
    ob.pass_index = 1
    ob.data.leapray.automatic, ob.data.leapray.threshold = False, 400.0
    scene.camera.location = np.array(CENTRE) * 1e-3 + (0, 0, 0.4)
    scene.camera.data.clip_start = 0.01
    distance = np.linalg.norm(points() * 1e3 - CENTRE, axis=1)
    # 400 HU lie two samples inside 0; a ball's distances are off by an eighth of spacing^2 / radius
    # for each of two directions
    assert np.abs(distance - (RADIUS - 2 * SPACING)).max() < SPACING**2 / 4 / 40 + 0.02


def test_of_several_frames_one_is_chosen(scene, tmp_path):
    path = scan(tmp_path, frames=2)
    first = np.fromfile(path, "<i2")
    np.concatenate([first, np.where(first > -1000, -1000, 1000)]).astype("<i2").tofile(path)
    ob = imported(path)
    assert read().fields[0].grid.samples[16, 18, 20] == 1000
    ob.data.leapray.frame = 1
    bpy.context.view_layer.update()
    assert read().fields[0].grid.samples[16, 18, 20] == -1000


def test_the_file_is_found_again_after_the_scene_was_saved(scene, tmp_path):
    ob = imported(scan(tmp_path))
    ob.pass_index = 1
    scene.camera.location = np.array(CENTRE) * 1e-3 + (0, 0, 0.4)
    scene.camera.data.clip_start = 0.01
    before = points()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    ob.data.leapray.file = "//scan.raw"
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    assert bpy.data.volumes["scan"].leapray.file == "//scan.raw"
    np.testing.assert_array_equal(points(), before)


def test_an_openvdb_file_stays_one_of_blenders(scene, tmp_path):
    path = vdb_files.write(tmp_path / "two.vdb", vdb_files.level_set(), vdb_files.fog())
    ob = imported(path, grid="density")
    assert ob.data.filepath == path and ob.data.leapray.file == ""
    assert read().fields[0].grid.kind == "fog"


def test_what_cannot_be_imported_adds_nothing(scene, tmp_path):
    (tmp_path / "wrong.vdb").write_bytes(b"no such thing")
    for name, words in (("gone.raw", "there is no file"), ("wrong.vdb", "wrong.vdb")):
        with pytest.raises(RuntimeError, match=words):
            bpy.ops.object.leapray_import(filepath=str(tmp_path / name))
    assert len(bpy.data.volumes) == 0 and len(bpy.data.materials) == 0


def test_files_of_every_format_can_be_chosen_and_dropped():
    fresh()
    chosen = bpy.ops.object.leapray_import.get_rna_type().properties["filter_glob"].default
    assert "*.nii.gz" in chosen.split(";") and "*.vdb" in chosen.split(";")
    handler = operators.IMAGE_FH_leapray_volume
    assert {".gz", ".nii", ".dcm", ".raw"} <= set(handler.bl_file_extensions.split(";"))
    assert ".vdb" not in handler.bl_file_extensions
    assert handler.bl_import_operator == "object.leapray_import"
    assert handler.poll_drop(SimpleNamespace(area=SimpleNamespace(type="VIEW_3D")))
    assert not handler.poll_drop(SimpleNamespace(area=None))


# ---- the panel -----------------------------------------------------------------


class Layout:
    """Takes down what a panel draws."""

    def __init__(self, told):
        self.told = told

    def __getattr__(self, name):
        def record(*words, **more):
            self.told.append((name, words, more))
            return Layout(self.told)

        return record


def drawn(volume):
    told = []
    panel = SimpleNamespace(layout=Layout(told))
    panel.columns = lambda keyed: Layout(told)
    panel.draw_values = lambda *more: ui.DATA_PT_leapray_volume.draw_values(panel, *more)
    context = SimpleNamespace(volume=volume, region=SimpleNamespace(width=300), engine="LEAPRAY")
    assert ui.DATA_PT_leapray_volume.poll(context)
    ui.DATA_PT_leapray_volume.draw(panel, context)
    return told


def test_the_panel_tells_the_values_and_how_the_threshold_was_found(scene, tmp_path):
    data = imported(scan(tmp_path)).data
    told = drawn(data)
    texts = " ".join(more["text"] for name, _, more in told if name == "label")
    assert "40 x 36 x 32 samples -1" in texts and "HU" in texts and "threshold" in texts.lower()
    (icon,) = [more or words for name, words, more in told if name == "template_icon"]
    assert icon
    shown = [words[1] for name, words, _ in told if name == "prop"]
    assert "automatic" in shown and "threshold" not in shown
    data.leapray.automatic, data.leapray.surfaces = False, 3
    shown = [words[1] for name, words, _ in drawn(data) if name == "prop"]
    assert {"threshold", "threshold_2", "threshold_3"} <= set(shown)


def test_of_labels_the_panel_asks_for_colors(scene, tmp_path):
    data = imported(scan(tmp_path, "named", kind="labels")).data
    told = drawn(data)
    shown = [words[1] for name, words, _ in told if name == "prop"]
    assert {"shown", "label_colors", "label_index", "smoothing", "clip_object"} <= set(shown)
    assert not {"surfaces", "automatic", "least"} & set(shown)
    assert not [name for name, _, _ in told if name == "template_icon"]
    data.leapray.shown = "threshold"
    shown = [words[1] for name, words, _ in drawn(data) if name == "prop"]
    assert "surfaces" in shown and "label_colors" not in shown


def test_of_other_data_the_panel_tells_nothing_until_they_are_read(scene, tmp_path):
    ob = imported(scan(tmp_path))
    ob.data.leapray.file = str(scan(tmp_path, "other", quantity="K"))
    assert volume_data.known(ob.data) is None
    assert not [name for name, _, _ in drawn(ob.data) if name == "template_icon"]
    assert bpy.ops.object.leapray_look() == {"FINISHED"}
    assert volume_data.known(ob.data).quantity == "K"
    ob.data.leapray.file = str(tmp_path / "gone.raw")
    assert bpy.ops.object.leapray_look() == {"FINISHED"}  # and a warning
    assert volume_data.known(ob.data) is None


def test_the_histogram_has_bars_and_marks():
    histogram = leapray.Histogram(np.linspace(-2.0, 2.0, 5), np.array([0, 1000, 10, 1]))
    pixels = volume_data.drawn(histogram, (-0.5, 1.5, 7.0))
    assert pixels.shape == (volume_data.HEIGHT, 4, 4) and pixels.dtype == np.float32
    back, bar, first, second = (
        np.float32(c) for c in (volume_data.BACK, volume_data.BAR, *volume_data.MARKS[:2])
    )
    assert (pixels[:, 0] == back).all() and (pixels[:, 1] == first).all()
    assert (pixels[:, 3] == second).all()
    high = (pixels[:, 2] == bar).all(axis=-1)
    share = np.log(11) / np.log(1001)
    assert high.mean() == pytest.approx(share, abs=1 / volume_data.HEIGHT)
    assert high[: high.sum()].all()


# ---- the command line ------------------------------------------------------------


def test_one_command_makes_a_picture_of_a_scan(tmp_path, capsys):
    path, output = scan(tmp_path), tmp_path / "out.exr"
    words = ["render", str(path), "--samples", "1", "--percentage", "10", "--output", str(output)]
    assert cli.main(words) == 0, capsys.readouterr().err
    figures = json.loads((tmp_path / "out.json").read_text())
    (row,) = figures["volumes"]
    assert output.exists() and row["kind"] == "isosurface" and figures["warnings"] == []
    from blender_scenes import exr

    depth = exr(output)["ViewLayer.Depth.Z"]
    seen = depth < 1e9
    assert 0.1 < seen.mean() < 0.6
    assert not (seen[0] | seen[-1]).any() and not (seen[:, 0] | seen[:, -1]).any()  # all in frame
    assert cli.main([*words, "--threshold", "400"]) == 0
    (row,) = json.loads((tmp_path / "out.json").read_text())["volumes"]
    assert row["threshold"] == 400.0


@pytest.mark.parametrize("how", ["scan.raw", "scan_40x36x32_int16.raw", "scan"])
def test_pictures_of_data_and_of_scenes_have_names_of_their_own(
    how, scene, tmp_path, monkeypatch, capsys
):
    """Rendered twice, for figures must not be taken for the layout of raw numbers."""
    monkeypatch.chdir(tmp_path)
    path = scan(tmp_path)
    sources = [path, tmp_path / "scan.blend"]
    if how == "scan.raw":
        (tmp_path / "scan.json").rename(tmp_path / "scan.raw.json")
    else:
        (tmp_path / "scan.json").unlink()
        sources[0] = path.rename(tmp_path / how)
        if how == "scan":  # a folder
            from phantoms import KINDS, PLACES, samples

            sources[0].unlink()
            KINDS["dicom"].write(sources[0], samples(), PLACES["anisotropic"])
    put("Cube", mesh())
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scan.blend"))
    before = set(tmp_path.iterdir())
    for source in (*sources, *sources):
        words = ["render", str(source), "--samples", "1", "--percentage", "3"]
        assert cli.main(words) == 0, capsys.readouterr().err
    made = {each.name for each in set(tmp_path.iterdir()) - before}
    own = "scan_data" if how == "scan" else how.replace(".", "_")
    assert made == {f"{stem}{end}" for stem in ("scan", own) for end in (".png", ".json")}


@pytest.mark.parametrize(("axis", "share"), [("x", 0.5), ("y", 0.4), ("z", 0.7)])
def test_one_word_cuts_a_scan_open(axis, share, tmp_path, capsys):
    path, output = scan(tmp_path), tmp_path / "out.exr"
    words = ["render", str(path), "--samples", "4", "--percentage", "10", "--output", str(output)]
    assert cli.main([*words, "--clip", f"{axis}={share}"]) == 0, capsys.readouterr().err
    figures = json.loads((tmp_path / "out.json").read_text())
    assert [row["kind"] for row in figures["volumes"]] == ["isosurface", "clip"]
    assert figures["warnings"] == []
    from blender_scenes import exr

    cut, at = bpy.data.objects["Cut"], "xyz".index(axis)
    where = 1e-3 * (CENTRE[at] + (share - 0.5) * (SIZE[at] - 1) * SPACING)
    assert cut.location[at] == pytest.approx(where, abs=1e-6)
    towards = bpy.context.scene.camera.location - cut.location
    assert cut.matrix_world.col[2].to_3d()[at] * towards[at] > 0  # the camera sees the face
    made = exr(output)
    greys = np.stack([made[f"ViewLayer.Combined.{c}"] for c in "RGB"], axis=-1)
    depth = made["ViewLayer.Depth.Z"]
    seen = depth < 1e9
    assert 0.02 < seen.mean() < 0.6
    assert np.ptp(greys[seen][:, 0]) > 0.3


@pytest.mark.parametrize("wild", [1e6, 1e30])
def test_the_greys_of_a_cut_are_those_of_most_samples(wild, tmp_path):
    nrrd = pytest.importorskip("nrrd")
    values = np.linspace(0, 100, 4096, dtype=np.float32).reshape(16, 16, 16)
    values[3, 3, 3] = wild
    nrrd.write(str(tmp_path / "some.nrrd"), values, {"space directions": np.eye(3), "space": "RAS"})
    fresh()
    data_scene.make(tmp_path / "some.nrrd", threshold=20.0, clip=("z", 0.5))
    (place,) = (n for n in bpy.data.materials["Cut"].node_tree.nodes if n.type == "MAP_RANGE")
    low, high = (place.inputs[name].default_value for name in ("From Min", "From Max"))
    assert (low, high) == pytest.approx((20.8, 99.2), abs=0.2)


def test_labels_are_cut_open_in_their_colors(tmp_path):
    samples = np.repeat([[[1, 2, 3, 0]] * 5], 4, 0).astype(np.uint8)
    path = tmp_path / "labels.nrrd"
    nrrd = pytest.importorskip("nrrd")
    header = {"space": "right-anterior-superior", "Segment0_ID": "a", "Segment0_Name": "Bone",
              "Segment0_LabelValue": "1", "Segment0_Layer": "0", "Segment0_Color": "1 0 0",
              "space directions": np.eye(3), "space origin": np.zeros(3)}  # fmt: skip
    nrrd.write(str(path), samples, header)
    fresh()
    data_scene.make(path, clip=("z", 0.5))
    (data,) = bpy.data.volumes
    assert data.leapray.clip_object.name == "Cut" and len(data.materials) == 1


def test_wrong_words_for_data_are_sentences(tmp_path, capsys):
    (tmp_path / "some.png").write_bytes(b"\x89PNG")
    for words, sentence in (
        (["render", str(tmp_path / "some.png")], "is of no known format"),
        (["render", str(tmp_path / "gone.nii.gz")], "There is no file"),
        (["render", str(tmp_path / "a.blend"), "--threshold", "3"], "no file"),
        (["render", str(scan(tmp_path)), "--threshold", "high"], "--threshold"),
        (["render", str(scan(tmp_path)), "--clip", "z=1.5"], "must be as z=0.5"),
        (["render", str(scan(tmp_path)), "--clip", "w=0.5"], "must be as z=0.5"),
    ):
        assert cli.main([*words, "--output", str(tmp_path / "o.png")]) != 0
        error = capsys.readouterr().err
        assert sentence in error and len(error.strip().splitlines()) == 1, error
    assert not (tmp_path / "o.png").exists()


def test_anatomical_data_show_their_front(tmp_path):
    fresh()
    of_patient = data_scene.make(scan(tmp_path)).camera.location.y
    assert of_patient > CENTRE[1] * 1e-3
    of_others = data_scene.make(scan(tmp_path, "other", meters=0.0)).camera.location.y
    assert of_others < CENTRE[1]
    assert engine.LeapRayEngine.bl_idname == "LEAPRAY"
