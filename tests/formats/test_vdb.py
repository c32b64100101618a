# SPDX-License-Identifier: GPL-3.0-or-later
"""Claims about OpenVDB files: every value of the tree comes back, sparse, and nothing else."""

import bpy
import numpy as np
import phantoms
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import leapray
from leapray import file_samples
from leapray.scalar_grid import LEAF

bpy.utils.expose_bundled_modules()
import openvdb  # noqa: E402

TYPES = {
    "FloatGrid": np.float32,
    "DoubleGrid": np.float64,
    "Int32Grid": np.int32,
    "Int64Grid": np.int64,
    "BoolGrid": np.bool_,
}


@pytest.fixture(autouse=True, params=["in memory", "in a file"])
def where(request, monkeypatch):
    """Phantoms are small: their samples come in memory, unless nothing is."""
    if request.param == "in a file":
        monkeypatch.setattr(file_samples, "SMALL", 0)


def save(path, *grids):
    openvdb.write(str(path), grids=list(grids))
    return path


def assert_same_tree(got, grid, dtype, first, last):
    """Every voxel of a box has the value that OpenVDB gives it."""
    want = np.empty(np.subtract(last, first) + 1, dtype)
    grid.copyToArray(want, ijk=tuple(first))
    values = phantoms.dense(got, (first, last))
    assert_array_equal(values, want.T.astype(values.dtype))
    return want


@pytest.mark.parametrize("name", TYPES)
def test_leaves_tiles_and_background_come_back(name, tmp_path):
    dtype = TYPES[name]
    rng = np.random.default_rng(5)
    background = dtype(1) if name == "BoolGrid" else dtype(7)
    grid = getattr(openvdb, name)(background.item())
    grid.name = "field"
    block = rng.integers(0, 2 if name == "BoolGrid" else 1000, (30, 20, 45)).astype(dtype)
    grid.copyFromArray(
        block, ijk=(-13, 100, -150)
    )  # on both sides of 0, across nodes of all levels
    other = dtype(0 if name == "BoolGrid" else 3).item()
    grid.fill((250, 0, 0), (383, 127, 140), other, True)  # tiles of 128 and of 8, and leaves
    grid.fill((-256, -256, -256), (-129, -129, -129), other, False)  # an inactive tile
    got = leapray.read_volume(save(tmp_path / "a.vdb", grid))
    leaves = got.samples
    assert isinstance(leaves, leapray.Leaves)
    assert len(leaves.origins) == grid.leafCount()
    assert leaves.samples.shape == (grid.leafCount(), LEAF, LEAF, LEAF)
    assert leaves.samples.dtype == (np.uint8 if name == "BoolGrid" else dtype)
    assert {8, 128} <= set(leaves.tile_sizes.tolist())
    assert not (leaves.origins % LEAF).any()
    assert len(np.unique(leaves.origins, axis=0)) == len(leaves.origins)
    for first, last in (
        ((-20, 90, -160), (30, 130, -90)),
        ((240, -9, -9), (390, 140, 150)),
        ((-260, -260, -260), (-120, -120, -120)),
    ):
        want = assert_same_tree(got, grid, dtype, first, last)
        assert len(np.unique(want)) > 1
    assert leaves.background == background


def test_a_level_set_is_one_and_its_inside_is_kept(tmp_path):
    grid = openvdb.createLevelSetSphere(radius=150.0, center=(5.0, -40.0, 90.0), voxelSize=1.0)
    grid.name = "surface"
    got = leapray.read_volume(save(tmp_path / "a.vdb", grid))
    assert got.kind == "level set" and got.samples.background == 3
    assert (got.samples.tile_values == -3).all() and len(got.samples.tile_values)
    want = assert_same_tree(got, grid, np.float32, (-150, -120, 0), (60, 0, 100))
    assert want.min() == -3 and want.max() == 3
    assert leapray.first_threshold(got)[0] == 0


def test_fog_half_floats_and_transforms(tmp_path):
    grid = openvdb.FloatGrid(0.0)
    grid.copyFromArray(np.full((9, 9, 9), 0.75, np.float32))
    grid.gridClass, grid.saveFloatAsHalf = openvdb.GridClass.FOG_VOLUME, True
    grid.transform = openvdb.createLinearTransform(phantoms.PLACES["oblique"].T.tolist())
    grid.name = "smoke"
    got = leapray.read_volume(save(tmp_path / "a.vdb", grid))
    assert got.kind == "fog" and got.name == "smoke"
    assert_allclose(got.world_from_index, phantoms.PLACES["oblique"], atol=1e-12)
    assert leapray.first_threshold(got)[0] == pytest.approx(0.375, abs=1e-4)  # a bin


def test_fog_of_one_density_has_a_surface(tmp_path):
    grid = openvdb.FloatGrid(0.0)
    grid.name, grid.gridClass = "smoke", openvdb.GridClass.FOG_VOLUME
    grid.copyFromArray(np.full((8, 8, 8), 0.5, np.float32))
    got = leapray.read_volume(save(tmp_path / "a.vdb", grid))
    assert leapray.first_threshold(got)[0] == pytest.approx(0.25)
    grid.gridClass, grid.background = openvdb.GridClass.UNKNOWN, -0.5
    got = leapray.read_volume(save(tmp_path / "a.vdb", grid))
    assert got.kind == "scalar"
    assert leapray.first_threshold(got)[0] == pytest.approx(0.0, abs=1e-6)


def test_grids_are_chosen_by_name(tmp_path):
    velocity, density, heat = openvdb.Vec3SGrid(), openvdb.FloatGrid(), openvdb.FloatGrid(20.0)
    for grid, name in ((velocity, "velocity"), (density, "density"), (heat, "heat")):
        grid.name = name
    path = save(tmp_path / "a.vdb", velocity, density, heat)
    assert leapray.volume_grids(path) == ["density", "heat", "velocity"]
    first = leapray.read_volume(path)
    assert first.name == "density" and "of which 'density' was read" in first.warnings[0]
    assert leapray.read_volume(path, grid="heat").samples.background == 20
    with pytest.raises(leapray.LeapRayError, match="'velocity' holds vec3s"):
        leapray.read_volume(path, grid="velocity")
    with pytest.raises(leapray.LeapRayError, match="no grid 'fire'; there are 'density', 'heat'"):
        leapray.read_volume(path, grid="fire")


def test_a_frustum_is_refused(tmp_path):
    grid = openvdb.FloatGrid()
    grid.name = "view"
    grid.fill((0, 0, 0), (3, 3, 3), 1.0)
    grid.transform = openvdb.createFrustumTransform(
        taper=0.5, depth=10.0, xyzMin=(0, 0, 0), xyzMax=(100, 100, 100), voxelSize=1.0
    )
    with pytest.raises(leapray.LeapRayError, match="'view' lies in a frustum"):
        leapray.read_volume(save(tmp_path / "a.vdb", grid))


def test_an_empty_grid_has_no_leaves(tmp_path):
    grid = openvdb.FloatGrid(2.0)
    grid.name = "nothing"
    got = leapray.read_volume(save(tmp_path / "a.vdb", grid))
    assert len(got.samples.origins) == len(got.samples.tile_sizes) == 0
    assert got.samples.background == 2
    with pytest.raises(leapray.LeapRayError, match="no sample with a value"):
        leapray.first_threshold(got)


def test_a_grid_that_has_strayed_is_refused(tmp_path):
    grid = openvdb.FloatGrid()
    grid.name = "dust"
    for corner in (-(2**30), 2**30):
        grid.fill((corner,) * 3, (corner,) * 3, 1.0)
    with pytest.raises(leapray.LeapRayError, match="'dust' spans"):
        leapray.read_volume(save(tmp_path / "a.vdb", grid))


def test_a_volume_of_a_file_has_its_values_where_its_transform_puts_them(tmp_path):
    values = np.random.default_rng(1).uniform(-1000, 3000, (20, 30, 70)).astype(np.float32)
    sheared = np.array([[0.5, 0.1, 0, 1e5], [0, 0.7, 0.2, -2], [0.3, 0, 0.9, 7], [0, 0, 0, 1]])
    grid = openvdb.FloatGrid()
    grid.name = "ct"
    grid.transform = openvdb.createLinearTransform(sheared.T.tolist())
    grid.copyFromArray(values, ijk=(-5, 7, 3))
    made = leapray.Isosurfaces(leapray.read_volume(save(tmp_path / "ct.vdb", grid), grid="ct"))
    volume = made.at(100.0)
    index = np.random.default_rng(2).integers(0, values.shape, (300, 3))
    points = (index + np.array([-5, 7, 3])) @ sheared[:3, :3].T + sheared[:3, 3]
    occupancy = volume.sample(points)[0]
    # points round to 1e-11, in which values of neighbours differ by some thousands a voxel
    assert_allclose(
        made.offset + made.scale * np.asarray(occupancy), values[tuple(index.T)], atol=1e-3
    )


def test_a_level_sets_surface_is_at_zero(tmp_path):
    grid = openvdb.createLevelSetSphere(2.0, (1.0, 2.0, 3.0), 0.1)
    made = leapray.Isosurfaces(leapray.read_volume(save(tmp_path / "s.vdb", grid)))
    volume = made.at(0.0)
    d = np.random.default_rng(2).normal(size=(500, 3))
    points = 2.0 * d / np.linalg.norm(d, axis=1, keepdims=True) + (1, 2, 3)
    value = made.offset + made.scale * np.asarray(volume.sample(points)[0])
    assert np.abs(value).max() < 0.002  # 0.02 voxel: h / 4R and f32
    assert made.offset + made.scale * volume.sample([[1.0, 2.0, 3.0]])[0] < -0.25
