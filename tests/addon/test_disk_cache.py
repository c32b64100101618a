# SPDX-License-Identifier: GPL-3.0-or-later
"""The folder of volumes: a second run makes nothing, shows the same, and trusts no file."""

from __future__ import annotations

import dataclasses
import json
import os
import resource
import subprocess
import sys
import threading
import zlib

import meshes
import numpy as np
import pytest
import scenes
from numpy.testing import assert_array_equal

import leapray
from addon import model, pipeline
from addon.plan import error_metric, probes
from addon.store import disk_cache
from leapray.formats.vdb import openvdb_module

pytest.importorskip("bpy", reason="OpenVDB comes with Blender")

PASSES = ("Combined", "Depth", "Normal", "Object Index", "Volume")


def painted(mesh):
    """With colours and normals of its own at the corners."""
    normals = mesh.vertices[mesh.triangles]
    colors = 0.5 + 0.4 * np.sin(2 * normals)
    return dataclasses.replace(
        mesh,
        corner_colors=colors.astype(np.float32),
        corner_normals=(normals / np.linalg.norm(normals, axis=2, keepdims=True)).astype("f4"),
    )


def with_texture(scene, source="vertex"):
    material = model.Material("Paint", (model.Lobe("diffuse", textured=True),), source)
    return dataclasses.replace(scene, materials=(material, *scene.materials[1:]))


def leaf():
    vertices, triangles = meshes.leaf()
    return model.Mesh("Leaf", vertices.astype(np.float32), triangles.astype(np.int32))


def kinds_of_scenes():
    box, ball = scenes.box(turn=0.3), scenes.sphere(n=12)
    two = [scenes.place(0, at=(-0.9, 0, 0)), scenes.place(1, at=(0.9, 0, 0), materials=(1,))]
    before = scenes.place(1, at=(0, -3, 0))
    twin, behind = dataclasses.replace(ball, name="Twin"), scenes.place(1, at=(4, 10, 0))
    return {
        "plain": scenes.scene([scenes.sphere(n=32)]),
        "triangle cells": scenes.scene([box, leaf()], [scenes.place(0), before]),
        "colours and normals": with_texture(scenes.scene([painted(ball)])),
        "merged": scenes.scene([box, ball], two, layout="scene"),
        "equal contents": scenes.scene([ball, twin], [scenes.place(0), behind]),
        "a resolution": scenes.scene([scenes.plane(5.0), ball], resolution=40),
        "another filter": scenes.scene([ball], filter="gauss", sample_type="f32"),
    }


def rendered(scene, folder=None):
    scene = dataclasses.replace(scene, passes=PASSES)
    return pipeline.render(scenes.replace(scene, cache_folder=str(folder or "")))


def assert_same(frame, other):
    assert set(frame.passes) == set(other.passes)
    for name in frame.passes:
        assert_array_equal(frame.passes[name].view("u4"), other.passes[name].view("u4"), name)


@pytest.mark.parametrize("kind", kinds_of_scenes())
def test_a_second_run_makes_nothing_and_shows_the_same(kind, tmp_path, made):
    scene, folder = kinds_of_scenes()[kind], tmp_path / "made" / "on demand"
    bare, first = rendered(scene), rendered(scene, folder)
    assert made and (bare.passes["Volume"] == len(bare.report["volumes"])).sum() > 100
    made.clear()
    again = rendered(scene, folder)
    assert made == []
    assert_same(first, bare)
    assert_same(again, bare)
    assert again.report["volumes"] == first.report["volumes"] == bare.report["volumes"]
    assert first.warnings == again.warnings == bare.warnings


def test_it_does_not_matter_who_reads_and_who_wrote(tmp_path, made):
    """Another camera asks for other levels: what is known already is used."""
    scene = scenes.scene([scenes.sphere(n=32), scenes.box(turn=0.3)])
    near = dataclasses.replace(scene, camera=scenes.camera(eye=(0, -2.5, 0)))
    rendered(scene, tmp_path)
    first = rendered(near, tmp_path)
    made.clear()
    rendered(scene, tmp_path)
    assert_same(rendered(near, tmp_path), first)
    assert made == []


def test_blender_and_others_find_the_occupancy_in_a_file(tmp_path):
    openvdb = openvdb_module()
    rendered(with_texture(scenes.scene([painted(scenes.sphere(n=12))], resolution=40)), tmp_path)
    (file,) = tmp_path.glob("*.vdb")
    (grid,) = openvdb.readAll(str(file))[0]
    inside, outside = (
        grid.getConstAccessor().getValue(
            tuple(map(int, grid.transform.worldToIndexCellCentered(p)))
        )
        for p in ((0.0, 0.0, 0.0), (1.2, 0.0, 0.0))
    )
    assert (grid.name, inside, outside) == ("density", 1.0, 0.0)


# ---- files that are not what they were -----------------------------------------------


@pytest.fixture
def kept(tmp_path):
    """A scene of triangle cells, colours and normals, its picture, its folder and files."""
    scene = scenes.scene([painted(scenes.box(turn=0.3))], width=24, height=16, resolution=24)
    scene = with_texture(scene)
    frame = rendered(scene, tmp_path)
    return scene, frame, tmp_path, {p: p.read_bytes() for p in tmp_path.iterdir()}


def restored(files):
    for path, data in files.items():
        path.write_bytes(data)


def test_what_is_cut_off_or_strange_is_made_anew_and_mended(kept, made):
    scene, frame, folder, files = kept
    sizes = {path: len(data) for path, data in files.items()}
    for n in (0, 1, 47, 48, 100, 0.3, 0.9, -1, -40, -48, -49):
        for path, data in files.items():
            path.write_bytes(data[: int(n * sizes[path]) if 0 < n < 1 else n])
        made.clear()
        assert_same(rendered(scene, folder), frame)
        assert made, n
        assert {p: p.read_bytes() for p in folder.glob("*.measure")} == {
            p: d for p, d in files.items() if p.suffix == ".measure"
        }
        made.clear()
        rendered(scene, folder)
        assert made == [], "the files are whole again"
    for path in files:
        path.write_bytes(os.urandom(5000))
    assert_same(rendered(scene, folder), frame)


@pytest.mark.parametrize("seed", range(4))
def test_no_flipped_byte_changes_the_picture(seed, kept):
    scene, frame, folder, files = kept
    rng = np.random.default_rng(seed)
    for _ in range(25):
        restored(files)
        for path, data in files.items():
            wrong = np.frombuffer(data, np.uint8).copy()
            # the seal and the head are as likely as what lies between
            ends = rng.integers(-400, 0), rng.integers(0, wrong.size)
            wrong[ends[rng.integers(2)]] ^= rng.integers(1, 256)
            path.write_bytes(wrong.tobytes())
        assert_same(rendered(scene, folder), frame)


def test_files_that_change_places_are_not_believed(tmp_path):
    scene = scenes.scene([scenes.sphere(n=32), scenes.box(turn=0.3)], width=24, height=16)
    frame = rendered(scene, tmp_path)
    for suffix in (".vdb", ".measure"):
        paths = sorted(tmp_path.glob(f"*{suffix}"))
        data = [path.read_bytes() for path in paths]
        for path, other in zip(paths, [*data[1:], data[0]], strict=True):
            path.write_bytes(other)
    assert_same(rendered(scene, tmp_path), frame)


def test_files_of_other_versions_are_made_anew(kept, made, monkeypatch):
    scene, frame, folder, files = kept
    for name, value in (("FORMAT", disk_cache.FORMAT + 1), ("LR_ABI", disk_cache.LR_ABI + 1)):
        made.clear()
        with monkeypatch.context() as other:
            other.setattr(disk_cache, name, value)
            assert_same(rendered(scene, folder), frame)
        assert made
    for path, data in files.items():
        assert path.read_bytes() == data


def forged(shelf_, key, head, data, suffix):
    """A file whose seal is right, whoever wrote it."""
    shelf_.path(key, suffix).write_bytes(disk_cache._sealed(key, head, data))


def test_a_right_seal_makes_no_wrong_volume_right(tmp_path):
    kept, key = disk_cache.DiskCache(str(tmp_path)), ("volume", "ball")
    ball = leapray.voxelize(*meshes.icosphere(2), 0.1)
    packed, room = ball.pack().tobytes(), 1 << 30
    mesh = dataclasses.asdict(ball.mesh_info)
    told = {"nbytes": ball.info.nbytes, "packed": len(packed), "mesh": mesh}
    squeezed = zlib.compress(packed)
    forged(kept, key, told, squeezed, ".vdb")
    assert_array_equal(kept.volume(key, room).pack(), ball.pack())
    for wrong, data in (
        ({"packed": len(packed) - 1}, squeezed),
        ({"packed": len(packed) + 1}, squeezed),
        ({"packed": -5}, squeezed),
        ({"packed": "many"}, squeezed),
        ({"nbytes": None}, squeezed),
        ({"mesh": {**mesh, "closed": "yes"}}, squeezed),
        ({"mesh": {"closed": True}}, squeezed),
        ({"mesh": [1]}, squeezed),
        ({}, packed),
        ({}, squeezed[:-9]),
        ({"packed": 3}, zlib.compress(b"abc")),
        ({}, zlib.compress(bytes(len(packed)))),
    ):
        forged(kept, key, {**told, **wrong}, data, ".vdb")
        assert kept.volume(key, room) is None, (wrong, data[:10])
        assert not kept.path(key).exists()
    forged(kept, key, {**told, "packed": room + 1}, zlib.compress(bytes(1 << 20)), ".vdb")
    with pytest.raises(leapray.OutOfMemory):
        kept.volume(key, room)


def test_a_right_seal_makes_no_wrong_record_right(tmp_path):
    kept, key = disk_cache.DiskCache(str(tmp_path)), ("measure", "ball")
    scene = scenes.scene([scenes.sphere(n=32)])
    kinds = disk_cache.DiskCache(str(tmp_path / "frame"))
    rendered(scene, kinds.folder)
    path = next((tmp_path / "frame").glob("*.measure"))
    told, _, data = path.read_bytes()[: -disk_cache.SEAL.size].partition(b"\n")
    head = json.loads(told)
    head.pop("name")
    forged(kept, key, head, data, ".measure")
    assert kept.record(key, error_metric.Measure).kind == "solid"
    values, arrays = head["values"], head["arrays"]
    for wrong, body in (
        ({"values": {**values, "volume_nbytes": "1"}}, data),
        ({"values": {n: x for n, x in values.items() if n != "kind"}}, data),
        ({"values": {**values, "more": 1}}, data),
        ({"arrays": {**arrays, "lost": ["|O", [1]]}}, data),
        ({"arrays": {**arrays, "lost": ["|b1", [-1]]}}, data),
        ({"arrays": {**arrays, "lost": ["|b1", [1 << 62, 1 << 62]]}}, data),
        ({"arrays": []}, data),
        ({"values": 5}, data),
        ({}, data[:-300]),
        ({}, zlib.compress(b"")),
    ):
        forged(kept, key, {**head, **wrong}, body, ".measure")
        assert kept.record(key, error_metric.Measure) is None, wrong
    short = {**arrays, "lost": ["|b1", [arrays["lost"][1][0] - 1]]}
    body = zlib.compress(zlib.decompress(data)[:-1])
    forged(kept, key, {**head, "arrays": short}, body, ".measure")
    ball = probes.draw(scene.meshes[0])
    measure = kept.record(key, error_metric.Measure)
    assert measure is None or not measure.fits(ball)


# ---- folders that cannot be written, and others who write ------------------------------


def test_a_folder_that_cannot_be_is_one_warning(tmp_path):
    (tmp_path / "file").write_text("")
    scene = scenes.scene([scenes.sphere(n=32), scenes.box()])
    frame = rendered(scene, tmp_path / "file")
    assert_same(frame, rendered(scene))
    (warning,) = [w for w in frame.warnings if "not kept" in w]
    assert str(tmp_path / "file") in warning


def test_a_full_disk_is_one_warning_and_leaves_nothing_half_written(tmp_path):
    scene = scenes.scene([scenes.sphere(n=48), scenes.box(turn=0.3)])
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (30_000, before[1]))
    try:
        frame = rendered(scene, tmp_path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert sum("not kept" in w for w in frame.warnings) == 1
    assert not list(tmp_path.glob(".*"))
    assert all(path.stat().st_size < 30_000 for path in tmp_path.iterdir())
    assert_same(rendered(scene, tmp_path), rendered(scene))


def test_what_a_killed_process_left_is_swept_away_after_a_day(tmp_path):
    old, new = tmp_path / ".a.vdb.12.partial", tmp_path / ".b.vdb.34.partial"
    for path in (old, new):
        path.write_text("half")
    os.utime(old, (0, 0))
    rendered(scenes.scene([scenes.box()]), tmp_path)
    assert new.exists() and not old.exists()


def test_renders_side_by_side_share_a_folder(tmp_path):
    scene = scenes.scene([scenes.sphere(n=24), scenes.box(turn=0.3)], width=24, height=16)
    frames, want = [], rendered(scene)

    def run():
        for _ in range(4):
            frames.append(rendered(scene, tmp_path))
            for path in tmp_path.glob("[!.]*"):  # so that all write again and again
                path.unlink(missing_ok=True)

    threads = [threading.Thread(target=run) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(frames) == 16
    for frame in frames:
        assert_same(frame, want)
        assert not any("not kept" in warning for warning in frame.warnings)


def test_another_process_reads_what_this_one_wrote(tmp_path):
    kept, key = disk_cache.DiskCache(str(tmp_path)), ("volume", "leaf", 0.1)
    volume = leapray.voxelize(*meshes.leaf(), 0.05)
    kept.keep_volume(key, volume)
    code = (
        "import sys; from addon.store import disk_cache\n"
        f"volume = disk_cache.DiskCache({str(tmp_path)!r}).volume({key!r}, 1 << 30)\n"
        "sys.stdout.buffer.write(volume.pack().tobytes())\n"
        "assert 'bpy' not in sys.modules and 'openvdb' not in sys.modules"
    )
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    assert told.stdout == volume.pack().tobytes()
