# SPDX-License-Identifier: GPL-3.0-or-later
"""Claims about volumes as OpenVDB files: what is written comes back equal."""

import meshes
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from addon.store import volume_files
from leapray import LeapRayError, Volume, voxelize
from leapray.formats.vdb import openvdb_module

pytest.importorskip("bpy", reason="OpenVDB comes with Blender")

SHEARED = np.array([[0.5, 0.2, 0, 7.3], [0, -1.5, 0.1, 1e5 + 0.1], [0.3, 0, 2, -3], [0, 0, 0, 1]])


def random_volume(dtype, *, ids=False, sheet=False, size=(9, 14, 21), seed=0):
    rng = np.random.default_rng(seed)
    shape = size[::-1]
    samples = rng.uniform(0, 1, shape)
    if dtype != np.float32:
        samples = np.round(samples * np.iinfo(dtype).max)
    return Volume(
        samples.astype(dtype),
        threshold=0.37,
        ids=rng.integers(0, 65536, shape) if ids else None,
        object_from_index=SHEARED,
        sheet=sheet,
        touched=rng.uniform(size=shape) < 0.5 if sheet else None,
    )


def assert_equal_volumes(got, want):
    for name in ("size", "dtype", "kind", "has_ids", "threshold", "n_surface_cells"):
        assert getattr(got.info, name) == getattr(want.info, name), name
    for name in ("surface_lo", "surface_hi"):
        assert getattr(got.info, name) == getattr(want.info, name), name
    assert_array_equal(got.info.object_from_index, want.info.object_from_index)
    around = [n + 2 for n in want.info.size]
    for read in ("read", "read_ids", "read_surface"):
        assert_array_equal(
            getattr(got, read)((-1,) * 3, around), getattr(want, read)((-1,) * 3, around)
        )


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("ids", [False, True])
@pytest.mark.parametrize("sheet", [False, True])
def test_dense_volumes_come_back_equal(dtype, ids, sheet, tmp_path):
    volume = random_volume(dtype, ids=ids, sheet=sheet)
    volume_files.write(volume, tmp_path / "a.vdb")
    assert_equal_volumes(volume_files.read(tmp_path / "a.vdb"), volume)


def test_every_value_of_the_integers_comes_back(tmp_path):
    volume = Volume(np.arange(65536, dtype=np.uint16).reshape(32, 32, 64))
    volume_files.write(volume, tmp_path / "a.vdb")
    assert_array_equal(volume_files.read(tmp_path / "a.vdb").read(), volume.read())


@pytest.mark.parametrize("size", [(1, 1, 1), (62, 63, 5), (64, 130, 3)])
def test_any_size_comes_back_equal(size, tmp_path):
    volume = random_volume(np.uint8, size=size, ids=True)
    volume_files.write(volume, tmp_path / "a.vdb")
    assert_equal_volumes(volume_files.read(tmp_path / "a.vdb"), volume)


def test_floats_beyond_0_and_1_come_back(tmp_path):
    volume = Volume(np.linspace(-3, 4, 1000, dtype=np.float32).reshape(10, 10, 10))
    volume_files.write(volume, tmp_path / "a.vdb")
    assert_equal_volumes(volume_files.read(tmp_path / "a.vdb"), volume)


@pytest.mark.parametrize("mesh", ["solid", "sheet"])
def test_sparse_volumes_come_back_equal(mesh, tmp_path):
    vertices, triangles = meshes.icosphere(3) if mesh == "solid" else meshes.leaf()
    ids = np.arange(len(triangles)) % 5
    volume = voxelize(vertices, triangles, 0.02, ids=ids, exact="none")  # files hold no triangles
    assert volume.info.kind == mesh
    volume_files.write(volume, tmp_path / "a.vdb")
    again = volume_files.read(tmp_path / "a.vdb")
    assert_equal_volumes(again, volume)
    assert again.info.n_bricks <= volume.info.n_bricks * 1.1  # still sparse


def test_a_sheet_that_is_valid_everywhere_stays_so(tmp_path):
    volume = Volume(random_volume(np.uint8).read(), sheet=True)
    volume_files.write(volume, tmp_path / "a.vdb")
    assert_equal_volumes(volume_files.read(tmp_path / "a.vdb"), volume)


def test_the_file_says_where_the_volume_is(tmp_path):
    openvdb = openvdb_module()
    volume_files.write(random_volume(np.uint8), tmp_path / "a.vdb")
    grid = openvdb.read(str(tmp_path / "a.vdb"), "density")
    assert_allclose(
        grid.transform.indexToWorld((1, 2, 3)), (SHEARED @ [1, 2, 3, 1])[:3], rtol=1e-12
    )
    grid.transform.postTranslate((5.0, 0.0, 0.0))  # another program moves it
    openvdb.write(str(tmp_path / "b.vdb"), grids=[grid])
    moved = volume_files.read(tmp_path / "b.vdb").info.object_from_index
    assert_allclose(moved[:3, 3], SHEARED[:3, 3] + [5, 0, 0], rtol=1e-12)


def test_what_cannot_be_read_is_a_sentence(tmp_path):
    openvdb = openvdb_module()
    (tmp_path / "text.vdb").write_text("no volume")
    vectors = openvdb.Vec3SGrid()
    vectors.name = "speed"
    vectors.fill((0, 0, 0), (1, 1, 1), (1.0, 2.0, 3.0), True)
    openvdb.write(str(tmp_path / "some.vdb"), grids=[vectors])
    some = tmp_path / "some.vdb"
    for call, words in (
        (lambda: volume_files.read(tmp_path / "none.vdb"), "no file"),
        (lambda: volume_files.read(tmp_path / "text.vdb"), "text.vdb"),
        (lambda: volume_files.read(some), "not written by LeapRay"),
    ):
        with pytest.raises(LeapRayError) as refused:
            call()
        assert words in str(refused.value)


def test_a_file_is_whole_or_absent(tmp_path, monkeypatch):
    volume = random_volume(np.uint8)
    with pytest.raises(LeapRayError, match="no folder"):
        volume_files.write(volume, tmp_path / "nowhere" / "a.vdb")
    volume_files.write(volume, tmp_path / "a.vdb")
    before = (tmp_path / "a.vdb").read_bytes()

    def full(source, target):
        raise OSError("no space left on device")

    monkeypatch.setattr(volume_files.os, "replace", full)
    with pytest.raises(LeapRayError, match="no space left"):
        volume_files.write(random_volume(np.uint8, seed=9), tmp_path / "a.vdb")
    assert (tmp_path / "a.vdb").read_bytes() == before
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.vdb"]
