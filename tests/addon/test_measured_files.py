# SPDX-License-Identifier: GPL-3.0-or-later
"""Measured files in scenes: read once, in sequences, and while other programs change them."""

import json
import os
from dataclasses import replace

import bpy
import numpy as np
import pytest
from blender_scenes import mesh, put, read, sunlit

import leapray
from addon import pipeline
from addon.blender import engine
from addon.blender.read import sequences, volumes
from leapray import file_samples
from leapray.file_samples import FileSamples

N = 40
VOXEL = 2.6 / (N - 1)


@pytest.fixture(autouse=True)
def nothing_kept(monkeypatch):
    """No sample stays in memory; what the engine keeps goes with the test."""
    monkeypatch.setattr(file_samples, "SMALL", 0)
    volumes.kept.clear()
    yield
    volumes.kept.clear()
    engine._volumes.clear()


@pytest.fixture
def scene():
    made = sunlit((64, 48))
    made.leapray.samples = 1
    put("Cube", mesh(size=0.3), location=(1.6, 0, 0), pass_index=2)
    return made


def ball(path, radius=1.0, kind="raw"):
    """A field that falls by 1000 with the distance, from 1000 radius at the origin: above 0 is a
    ball."""
    axis = (np.arange(N) - (N - 1) / 2) * VOXEL
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    values = np.round(1000 * (radius - np.sqrt(x * x + y * y + z * z))).astype(np.int16)
    matrix = np.diag([VOXEL, VOXEL, VOXEL, 1.0])
    matrix[:3, 3] = axis[0]
    if kind == "raw":
        values.tofile(path)
        layout = {"size": [N] * 3, "dtype": "int16", "spacing": [VOXEL] * 3,
                  "origin": [float(axis[0])] * 3}  # fmt: skip
        path.with_suffix(".json").write_text(json.dumps(layout))
    elif kind == "dicom":
        from phantoms import KINDS

        KINDS["dicom"].write(path, values, matrix)
    else:
        import nibabel

        nibabel.save(nibabel.Nifti1Image(values.T, matrix), path)
    return path


def shown(path, **settings):
    """A volume object of a file."""
    data = bpy.data.volumes.new("Ball")
    data.leapray.file = str(path)
    for key, value in {"automatic": False, "threshold": 0.0, **settings}.items():
        setattr(data.leapray, key, value)
    return put("Ball", data, pass_index=1)


def render():
    bpy.context.view_layer.update()
    passes = "Combined", "Position", "Object Index"
    return pipeline.render(replace(read(64, 48), passes=passes))


def radius_of(frame):
    """Of the ball that is seen, None: nothing is."""
    seen = frame.passes["Object Index"][..., 0] == 1
    assert (frame.passes["Object Index"][..., 0] == 2).any()
    arm = np.linalg.norm(frame.passes["Position"][seen], axis=1)
    return None if not len(arm) else pytest.approx(arm.mean(), abs=0.01)


# ---- once ------------------------------------------------------------------------


def test_a_threshold_that_moves_reads_nothing_again(scene, tmp_path, monkeypatch):
    """Whether volumes are kept or not."""
    ob = shown(ball(tmp_path / "a.raw"))
    reads, pread = [], os.preadv
    monkeypatch.setattr(os, "preadv", lambda *told: reads.append(told) or pread(*told))
    for keep in (False, True):
        scene.render.use_persistent_data = keep
        for k, threshold in enumerate((0.0, 300.0)):
            ob.data.leapray.threshold = threshold
            bpy.ops.render.render()
            (report,) = engine.reports.values()
            assert [row["threshold"] for row in report["volumes"] if "threshold" in row] == [
                threshold
            ]
            assert bool(reads) == (k == 0 and not keep)
            reads.clear()
    ob.data.leapray.smoothing = 1.0
    bpy.ops.render.render()
    assert reads  # other samples are needed


def test_without_persistent_data_only_samples_of_fields_are_kept(scene, tmp_path):
    shown(ball(tmp_path / "a.raw"))
    scene.render.use_persistent_data = False
    bpy.ops.render.render()
    assert len(engine._volumes) == 1
    (entry,) = engine._volumes._entries.values()
    assert isinstance(entry.value, leapray.Isosurfaces) and entry.nbytes == entry.value.nbytes > 0
    bpy.data.objects.remove(bpy.data.objects["Ball"])
    bpy.ops.render.render()
    assert len(engine._volumes) == 0


def test_what_is_kept_stays_within_the_budget(scene, tmp_path):
    ob = shown(ball(tmp_path / "a.raw"))
    scene.leapray.memory_mb = 4
    scene.render.use_persistent_data = True
    for k in range(12):
        ob.data.leapray.smoothing = k / 10
        bpy.ops.render.render()
    kept = engine._volumes._entries.values()
    assert len(kept) > 1 and sum(entry.nbytes for entry in kept) <= 4 << 20


def test_a_packed_file_is_unpacked_once_for_import_threshold_and_frames(
    scene, tmp_path, monkeypatch
):
    path = ball(tmp_path / "a.nii.gz", kind="nifti")
    told, read_volume = [], leapray.read_volume
    monkeypatch.setattr(
        leapray, "read_volume", lambda path, **more: told.append(path) or read_volume(path, **more)
    )
    bpy.ops.object.leapray_import(filepath=str(path))
    for frame in (1, 2, 3):
        scene.frame_set(frame)
        bpy.ops.render.render()
    assert len(told) == 1 and isinstance(read_field().grid.samples, FileSamples)


def test_the_panel_offers_blenders_settings_of_sequences_for_other_formats(scene, tmp_path):
    from test_volume_import import drawn

    ob = shown(ball(tmp_path / "a_1.raw"))
    assert "is_sequence" in [words[1] for name, words, _ in drawn(ob.data) if name == "prop"]
    ob.data.is_sequence = True
    told = {words[1] for name, words, _ in drawn(ob.data) if name == "prop"}
    assert {"frame_duration", "frame_start", "frame_offset", "sequence_mode"} <= told


def read_field():
    bpy.context.view_layer.update()
    return read().fields[0]


# ---- sequences --------------------------------------------------------------------

MODES = {
    "CLIP": [None, None, 2, 3, 4, None, None, None, None, None],
    "EXTEND": [2, 2, 2, 3, 4, 4, 4, 4, 4, 4],
    "REPEAT": [3, 4, 2, 3, 4, 2, 3, 4, 2, 3],
    "PING_PONG": [4, 3, 2, 3, 4, 3, 2, 3, 4, 3],
}


@pytest.mark.parametrize("mode", MODES)
def test_numbers_of_frames_follow_blenders_own(mode, scene, tmp_path):
    """Of OpenVDB sequences Blender tells the frame itself."""
    import vdb_files

    for k in range(1, 6):
        vdb_files.write(tmp_path / f"s_{k}.vdb", vdb_files.level_set())
    data = bpy.data.volumes.new("Blender's")
    data.filepath = str(tmp_path / "s_1.vdb")
    data.is_sequence, data.frame_start, data.frame_duration = True, 12, 3
    data.frame_offset, data.sequence_mode = 1, mode
    ob = put("Blender's", data)
    ours, theirs = [], []
    for frame in range(10, 20):
        scene.frame_set(frame)
        ours.append(sequences.frame_number(frame, 12, 3, 1, mode))
        number = ob.evaluated_get(bpy.context.evaluated_depsgraph_get()).data.grids.frame
        theirs.append(None if number == volumes.NOT_IN_FRAME else number)
    assert ours == theirs == MODES[mode]
    for short in (0, 1, 2):
        assert sequences.frame_number(5, 5, short, 0, mode) == (1 if short else None)


@pytest.mark.parametrize("kind", ["raw", "nifti", "nifti packed", "dicom"])
def test_a_sequence_of_any_format_shows_the_file_of_its_frame(kind, scene, tmp_path):
    suffix = {"raw": ".raw", "nifti": ".nii", "nifti packed": ".nii.gz", "dicom": ""}[kind]
    for k, radius in enumerate((0.5, 0.75, 1.0), 1):
        ball(tmp_path / f"ball.{k:04d}{suffix}", radius, kind.partition(" ")[0])
    ob = shown(tmp_path / f"ball.0001{suffix}")
    data = ob.data
    data.is_sequence, data.frame_start, data.frame_duration = True, 11, 3
    data.sequence_mode = "CLIP"
    for frame, radius in ((11, 0.5), (12, 0.75), (13, 1.0), (10, None), (14, None)):
        scene.frame_set(frame)
        made = render()
        assert made.warnings == []
        assert radius_of(made) == radius
    data.frame_offset = 1
    scene.frame_set(11)
    assert radius_of(render()) == 0.75


def test_a_frame_that_is_missing_is_a_sentence_and_the_rest_is_rendered(scene, tmp_path):
    ob = shown(ball(tmp_path / "ball_0001.raw"))
    ob.data.is_sequence, ob.data.frame_duration = True, 3
    scene.frame_set(2)
    made = render()
    assert radius_of(made) is None
    (warning,) = made.warnings
    assert "'Ball'" in warning and "ball_0002.raw" in warning


@pytest.mark.parametrize("name", ["ball.raw", "ball_40x40x40_int16.raw"])
def test_a_sequence_without_a_number_is_a_sentence(name, scene, tmp_path):
    ob = shown(ball(tmp_path / name))
    ob.data.is_sequence = True
    for duration, words in ((0, "a sequence of 0 frames"), (2, "does not end in a number")):
        ob.data.frame_duration = duration
        made = render()
        (warning,) = made.warnings
        assert radius_of(made) is None and "'Ball'" in warning and words in warning


def test_numbers_keep_their_digits():
    from pathlib import Path

    for name, number, want in (
        ("a.0009.nii.gz", 10, "a.0010.nii.gz"),
        ("a9.raw", 10, "a10.raw"),
        ("scan_001", -2, "scan_-002"),
        ("2020_x1.NRRD", 7, "2020_x7.NRRD"),
    ):
        assert sequences.numbered(Path("/b", name), number) == Path("/b", want)


# ---- files that change ---------------------------------------------------------------


@pytest.mark.parametrize("when", [1, 5])
def test_a_file_that_is_cut_during_the_render_is_a_sentence(when, scene, tmp_path, monkeypatch):
    """While the threshold is sought, or while samples are stored."""
    path = ball(tmp_path / "a.raw")
    shown(path, automatic=when == 1)
    calls, pread = [], os.preadv

    def cut(*told):
        calls.append(told)
        if len(calls) == when:
            os.truncate(path, 100)
        return pread(*told)

    monkeypatch.setattr(os, "preadv", cut)
    frame = render()
    assert radius_of(frame) is None and len(calls) >= when
    (warning,) = frame.warnings
    assert "'Ball'" in warning and "a.raw has changed" in warning


def test_a_file_that_changed_between_renders_is_read_again(scene, tmp_path):
    shown(ball(tmp_path / "a.raw", 0.5))
    assert radius_of(render()) == 0.5
    ball(tmp_path / "a.raw", 0.9)
    assert radius_of(render()) == 0.9


def test_reading_tells_how_far_it_is_and_can_be_cancelled():
    told = []
    caller = volumes.Caller(lambda: len(told) > 3, lambda share, what: told.append((share, what)))
    with pytest.raises(leapray.Stopped):
        volumes.listening(waited, caller, "a.nii.gz")
    shares = [share for share, _ in told]
    assert shares == sorted(shares) and shares[-1] > 0 and told[0][1] == "a.nii.gz"


def waited(watch):
    import time

    for k in range(1000):
        watch.advance(k / 1000)
        if watch.stopped:
            raise leapray.Stopped("stopped")
        time.sleep(0.01)
    raise AssertionError("nobody stopped it")
