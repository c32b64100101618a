# SPDX-License-Identifier: GPL-3.0-or-later
"""What a render takes: the budget counts scratch, and the report tells the process's own growth."""

from __future__ import annotations

import dataclasses
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import scenes
from meshes import grid_surface

import leapray
from addon import arrays, memory, model, pipeline
from addon.model import Mesh
from addon.plan import mesh_colors, mesh_split, objects, probes
from leapray.formats.vdb import openvdb_module
from leapray.voxelization import SPARE, mesh_scratch_nbytes

HERE = Path(__file__).parent
LINUX = pytest.mark.skipif(not memory.STATUS.exists(), reason="the system tells no process's peak")
pytestmark = pytest.mark.alone  # what a process takes depends a little on how its threads fall
NOISE = 4 << 20  # bytes: stacks of threads, pages of libraries that are met for the first time

# A process of its own renders one mesh, after a small one that loads everything.
RENDER = """
import json, sys
from pathlib import Path
import numpy as np
import scenes
import test_memory
from addon import memory, pipeline
pipeline.render(test_memory.scene(scenes.sphere(n=4)))
for name in sys.argv[1].split("+"):
    mesh = getattr(test_memory, name)()
    Path("/proc/self/clear_refs").write_text("5")
    before = memory.Resident.read()
    frame = pipeline.render(test_memory.scene(mesh, memory_mb=128))
    grown = memory.Resident.read().most - before.now
report = frame.report
print(json.dumps({"grown": grown, "bytes": report["bytes"], "kind": report["volumes"][0]["kind"],
                  "triangles": len(mesh.triangles), "warnings": frame.warnings}))
"""


# Likewise of a measured file, which is read meanwhile.
RENDER_FIELD = """
import json, sys
from pathlib import Path
import bpy
import test_memory
from addon import memory
folder, kind, memory_mb = Path(sys.argv[1]), sys.argv[2], int(sys.argv[3])
small, large = (test_memory.measured(folder / name, n, kind) for name, n in (("s", 40), ("l", 288)))
test_memory.render_measured(small, 256)
Path("/proc/self/clear_refs").write_text("5")
before = memory.Resident.read()
frame = test_memory.render_measured(large, memory_mb)
grown = memory.Resident.read().most - before.now
print(json.dumps({"grown": grown, "bytes": frame.report["bytes"], "warnings": frame.warnings,
                  "coarser": frame.report["volumes"][0]["coarser"]}))
"""


def measured(folder: Path, n: int, kind: str) -> Path:
    """A file of n^3 numbers of 16 bits, noise round a ball, so that none of the bricks is alike."""
    folder.mkdir()
    axis = (np.arange(n) - n / 2) / n
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij", sparse=True)
    values = 4000 - 8000 * np.sqrt(x * x + y * y + z * z)
    values += np.random.default_rng(0).integers(0, 20, values.shape)
    stored = values.astype(np.int16)
    if kind == "raw":
        stored.tofile(folder / f"a_{n}x{n}x{n}_int16.raw")
    elif kind == "vdb":
        openvdb = openvdb_module()
        grid = openvdb.FloatGrid(-10000.0)
        grid.copyFromArray(values.T.astype(np.float32))
        grid.name = "a"
        openvdb.write(str(folder / "a.vdb"), grids=[grid])
    else:
        import nibabel

        nibabel.save(nibabel.Nifti1Image(stored.T, np.eye(4)), folder / "a.nii.gz")
    return next(folder.iterdir())


def render_measured(path: Path, memory_mb: int) -> model.Frame:
    """As the add-on does: read, the threshold sought, rendered."""
    before = memory.Resident.read()
    grid = leapray.read_volume(path)
    threshold, _ = leapray.first_threshold(grid, threads=2)
    shift, scale = np.eye(4), np.eye(4)
    scale[:3, :3] /= max(grid.world_from_index[0, 0] * 100, 1)
    shift[:3, 3] = -50
    made = scenes.scene([], [], view=scenes.camera(eye=(0, -4, 0)), memory_mb=memory_mb, threads=2)
    held = model.Field("A", grid, str(path), (threshold,), read_nbytes=grid.nbytes)
    placed = model.FieldInstance(field=0, name="A", world_from_object=scale @ shift, materials=(0,))
    made = dataclasses.replace(made, fields=(held,), field_instances=(placed,), resident=before)
    return pipeline.render(made)


def scene(mesh, **settings):
    return scenes.scene([mesh], view=scenes.camera(eye=(0, -4, 0)), **settings)


def bumpy(n=300, wave=0.0) -> Mesh:
    """A closed torus of 4 n^2 triangles with bumps."""

    def position(u, v):
        u, v = 2 * np.pi * u, 2 * np.pi * v
        r = 0.4 + 0.02 * np.sin(9 * u) * np.sin(5 * v) + wave * np.sin(300 * u) * np.sin(90 * v)
        ring = 1 + r * np.cos(v)
        return ring * np.cos(u), r * np.sin(v), ring * np.sin(u)

    vertices, triangles = grid_surface(2 * n, n, position, True, True)
    return Mesh("Bumpy", vertices.astype(np.float32), triangles)


def closed() -> Mesh:
    return bumpy(350)  # 490,000 triangles


def smooth() -> Mesh:
    mesh = bumpy()
    normals = np.repeat(arrays.unit(mesh_colors.facet_normals(mesh)[:, :1]), 3, axis=1)
    return Mesh("Smooth", mesh.vertices, mesh.triangles, corner_normals=normals.astype(np.float32))


def rough() -> Mesh:
    """Nearly every edge is a crease."""
    return bumpy(wave=0.01)


def opened() -> Mesh:
    mesh = bumpy()
    return Mesh("Open", mesh.vertices, mesh.triangles[: len(mesh.triangles) * 9 // 10])


def crossing() -> Mesh:
    """Two shells that cross: winding numbers tell the sides."""
    mesh = bumpy(220)
    moved = mesh.vertices + np.float32([0.3, 0.0, 0.0])
    triangles = np.concatenate([mesh.triangles, mesh.triangles + len(moved)])
    return Mesh("Crossing", np.concatenate([mesh.vertices, moved]), triangles)


def rendered(*words: str, code: str = RENDER) -> dict:
    root = HERE.parents[1]
    paths = [HERE, HERE.parent, root, root / "native"]
    code = f"import sys; sys.path[:0] = {[str(p) for p in paths]!r}\n{code}"
    run = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    (told,) = (line for line in run.stdout.splitlines() if line.startswith("{"))  # Blender logs
    return json.loads(told)


# ---- the report ------------------------------------------------------------------------


@LINUX
@pytest.mark.parametrize("name", ["closed", "smooth", "rough", "opened", "crossing"])
def test_the_peak_is_the_growth_of_the_process(name):
    """And stays within 220 bytes of a triangle, beside what is kept: numpy alone took 230 of the
    largest mesh, and the making of a tree of triangles takes 110 of each."""
    found = rendered(name)
    assert found["warnings"] == [] or name in ("opened", "crossing")
    assert found["bytes"]["peak"] == pytest.approx(found["grown"], rel=0.1, abs=NOISE)
    kept = found["bytes"]["volumes"] + found["bytes"]["structures"]
    assert found["grown"] < 220 * found["triangles"] + 2 * NOISE + kept
    assert 0 < found["bytes"]["scratch"] < found["bytes"]["peak"]


@LINUX
@pytest.mark.parametrize("kind", ["raw", "nii.gz", "vdb"])
def test_the_peak_of_measured_data_is_the_growth_of_the_process(kind, tmp_path):
    """And is that of the samples that rays see: nothing else is held as a whole. OpenVDB holds its
    tree while it is read, and gives it back before samples are stored."""
    found = rendered(str(tmp_path), kind, "256", code=RENDER_FIELD)
    assert found["warnings"] == [] and found["coarser"] == 1
    told = found["bytes"]
    assert told["peak"] == pytest.approx(found["grown"], rel=0.1, abs=NOISE)
    held = told["volumes"] + told["structures"]
    assert held > 288**3 * (4 if kind == "vdb" else 2)
    assert found["grown"] < held + 9 * NOISE  # what each thread works on, unpacks and counts


@LINUX
@pytest.mark.parametrize("kind", ["raw", "nii.gz"])
def test_the_budget_holds_for_measured_data(kind, tmp_path):
    found = rendered(str(tmp_path), kind, "50", code=RENDER_FIELD)
    assert found["coarser"] == 2 and "144 x 144 x 144 samples of its 288" in found["warnings"][0]
    assert found["grown"] < (50 << 20) + NOISE
    assert found["bytes"]["peak"] == pytest.approx(found["grown"], rel=0.1, abs=NOISE)


@LINUX
def test_the_peak_after_a_larger_render_is_sampled():
    """The system's own peak is that of the earlier render, where nobody has set it back."""
    begun = memory.Resident.read()
    before = memory.Resident(begun.now, 1 << 50)
    meter = memory.Meter(before)
    held = np.ones(1 << 23)  # 64 MB
    meter.sample()
    del held
    assert meter.peak() == pytest.approx(64 << 20, abs=NOISE)


def test_where_the_system_tells_nothing_the_peak_is_what_was_counted(monkeypatch, tmp_path):
    monkeypatch.setattr(memory, "STATUS", tmp_path / "status")
    monkeypatch.setattr(memory, "STATM", tmp_path / "statm")
    told = pipeline.render(scene(bumpy(60))).report["bytes"]
    assert told["peak"] >= told["volumes"] + told["structures"]
    assert told["peak"] > told["scratch"] > 0


# ---- the budget ------------------------------------------------------------------------


def test_the_budget_counts_scratch_and_the_refusal_tells_both_sizes():
    mesh = bumpy()
    needs = mesh_scratch_nbytes(len(mesh.vertices), len(mesh.triangles)) - SPARE
    with pytest.raises(leapray.OutOfMemory, match=r"[\d.]+ MB to make it, but 4.0 MB") as refused:
        leapray.voxelize(mesh.vertices, mesh.triangles, 0.1, max_nbytes=4_000_000)
    volume = leapray.voxelize(mesh.vertices, mesh.triangles, 0.1)
    counted = volume.mesh_info.scratch_nbytes - SPARE
    assert 0.9 * counted < refused.value.nbytes < 1.2 * counted
    enough = int(1.05 * (counted + 2 * volume.info.nbytes))
    leapray.voxelize(mesh.vertices, mesh.triangles, 0.1, max_nbytes=enough)
    assert needs <= counted
    with pytest.raises(objects.SceneError, match=r"'Object 0' .* needs \d+ MB, budget is 4 MB"):
        pipeline.render(scene(mesh, memory_mb=4))
    pipeline.render(scene(mesh, memory_mb=enough // (1 << 20) + 1))


def test_a_mesh_too_large_for_the_budget_is_refused_before_it_is_looked_at(monkeypatch):
    monkeypatch.setattr(mesh_split, "split", None)
    monkeypatch.setattr(probes, "draw", None)
    with pytest.raises(objects.SceneError, match="budget is 1 MB"):
        pipeline.render(scene(bumpy(), memory_mb=1))


def test_the_volume_alone_can_have_a_limit_of_its_own():
    vertices, triangles = (bumpy(40).vertices, bumpy(40).triangles)
    volume = leapray.voxelize(vertices, triangles, 0.02)
    with pytest.raises(leapray.OutOfMemory, match="larger voxel_size"):
        leapray.voxelize(vertices, triangles, 0.02, max_volume_nbytes=volume.info.nbytes // 2)


# ---- edges, in pieces ------------------------------------------------------------------


def edges_of(vertices, triangles, cosine, weld):
    """The pairs and the border by sorting all half-edges at once, in f64."""
    place = np.arange(len(vertices))
    if weld:
        place = np.unique(vertices + 0.0, axis=0, return_inverse=True)[1].reshape(-1)
    a = place[triangles]
    b = np.roll(a, -1, axis=1)
    key = (np.minimum(a, b) * (a.max() + 1) + np.maximum(a, b)).ravel()
    order = np.argsort(key, kind="stable")
    order = order[(a != b).ravel()[order]]
    starts = np.flatnonzero(np.diff(key[order], prepend=-1))
    count = np.diff(np.append(starts, len(order)))
    pairs = np.stack([order[starts], order[np.minimum(starts + 1, len(order) - 1)]], axis=1)
    p = vertices[triangles].astype(np.float64)
    normal = arrays.unit(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]))
    first, second = normal[pairs // 3].transpose(1, 0, 2)
    real = first.any(axis=1) & second.any(axis=1)
    turns = (count > 1) & real & (np.einsum("nc,nc->n", first, second) < cosine)
    return pairs[turns], int((count == 1).sum())


def soup():
    """Random triangles on few vertices: junctions, doubles, places used twice, open edges."""
    random = np.random.default_rng(5)
    places = random.normal(size=(40, 3)).astype(np.float32)
    return places[random.integers(0, 40, 90)], random.integers(0, 90, (600, 3)).astype(np.int32)


def flat_quads():
    """A grid of quads with vertices of their own, flat but for steps."""
    mesh = bumpy(20)
    return mesh.vertices[mesh.triangles.ravel()], np.arange(len(mesh.triangles) * 3).reshape(-1, 3)


@pytest.mark.parametrize("weld", [True, False])
@pytest.mark.parametrize("cosine", [0.9659, 0.5, -0.5])
@pytest.mark.parametrize("make", [soup, flat_quads])
def test_edges_are_those_of_a_sort(make, cosine, weld):
    vertices, triangles = make()
    pairs, n_border = leapray.mesh_edges(vertices, triangles, cosine, weld=weld)
    expected, border = edges_of(vertices, triangles, cosine, weld)
    np.testing.assert_array_equal(np.sort(pairs.view("u8").ravel()), pack(expected))
    assert n_border == border


def test_a_large_mesh_has_the_edges_of_a_sort():
    """It is dealt out in pieces, and has more pairs than are expected."""
    mesh = bumpy(430, wave=0.01)
    order = np.random.default_rng(1).permutation(len(mesh.vertices))
    vertices = np.empty_like(mesh.vertices)
    vertices[order] = mesh.vertices
    triangles = order[mesh.triangles].astype(np.int32)
    pairs, n_border = leapray.mesh_edges(vertices, triangles, 0.9, weld=False)
    expected, border = edges_of(vertices, triangles, 0.9, weld=False)
    assert len(pairs) > 1 << 16
    # in f32 and in f64 they may differ on the very angle
    assert len(np.setxor1d(pack(pairs), pack(expected))) < 1e-4 * len(pairs)
    assert n_border == border == 0


def pack(pairs):
    return np.sort(np.ascontiguousarray(pairs, np.uint32).view("u8").ravel())


def test_creases_do_not_depend_on_how_a_mesh_is_numbered():
    mesh = bumpy(30, wave=0.01)
    turned = Mesh("Turned", mesh.vertices, mesh.triangles[::-1].copy())
    one, other = probes.draw(mesh), probes.draw(turned)
    assert len(one.creases) == len(other.creases) > 0
    assert one.crease_length == pytest.approx(other.crease_length, rel=1e-9)
    # the points lie on the same edges, from either end
    ends = np.abs(one.creases - other.creases).max(axis=1)
    longest = np.linalg.norm(np.diff(mesh.vertices[mesh.triangles], axis=1), axis=2).max()
    assert np.quantile(ends, 0.9) <= longest


def test_stopping_ends_the_search_for_edges():
    watch = leapray.Watch()
    watch.stop()
    with pytest.raises(leapray.Stopped):
        leapray.mesh_edges(bumpy(60).vertices, bumpy(60).triangles, 0.9, watch=watch)


@pytest.mark.parametrize("unit", [0.0, -1.0, float("nan"), float("inf")])
def test_a_unit_that_is_none_is_refused(unit):
    with pytest.raises(leapray.LeapRayError, match="unit must be positive"):
        leapray.mesh_edges(bumpy(4).vertices, bumpy(4).triangles, 0.9, unit=unit)
