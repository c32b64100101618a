# SPDX-License-Identifier: GPL-3.0-or-later
"""Claims about readers of volumes: a phantom comes back in its numbers, type and place."""

import gzip

import nibabel
import nrrd
import numpy as np
import phantoms
import pytest
import tifffile
from numpy.testing import assert_allclose, assert_array_equal
from phantoms import KINDS, LPS, PLACES, SIZE

import leapray
from leapray import file_samples
from leapray.scalar_grid import KINDS as KINDS_OF_GRID
from leapray.scalar_grid import Leaves

PLAIN = "nifti", "nifti 2", "nrrd", "nrrd detached", "mrc", "tiff", "raw"

CASES = [
    (kind, dtype, place)
    for kind, item in KINDS.items()
    for dtype in item.dtypes
    for place in PLACES
    if (item.placed or place in ("upright", "anisotropic"))
    and (dtype == item.dtypes[0] or place == "oblique" or place == "anisotropic")
]


@pytest.fixture(autouse=True, params=["in memory", "in a file"])
def where(request, monkeypatch):
    """Phantoms are small: their samples come in memory, unless nothing is."""
    if request.param == "in a file":
        monkeypatch.setattr(file_samples, "SMALL", 0)


def written(folder, kind, dtype="int16", place="anisotropic"):
    path = folder / KINDS[kind].name
    stored = phantoms.samples(dtype)
    KINDS[kind].write(path, stored, PLACES[place])
    return path, stored, PLACES[place]


def assert_same_field(grid, stored, matrix):
    """Each sample of the phantom lies on one of the grid, within 0.01 of a voxel, and equals it."""
    k, j, i = np.indices(stored.shape).reshape(3, -1)
    index = np.linalg.inv(grid.world_from_index) @ matrix @ [i, j, k, np.ones(len(i))]
    nearest = np.round(index[:3]).astype(int)
    assert np.abs(index[:3] - nearest).max() < 0.01
    got = phantoms.dense(grid, (nearest.min(axis=1), nearest.max(axis=1)))
    x, y, z = nearest - nearest.min(axis=1, keepdims=True)
    assert_array_equal(got[z, y, x], stored.reshape(-1).astype(got.dtype))
    assert stored.astype(float).std() > 10  # the phantom does tell places apart


@pytest.mark.parametrize(("kind", "dtype", "place"), CASES)
def test_a_phantom_comes_back_in_its_numbers_and_place(kind, dtype, place, tmp_path):
    path, stored, matrix = written(tmp_path, kind, dtype, place)
    grid = leapray.read_volume(path)
    if kind.startswith("tiff"):  # which says no place
        matrix = matrix.copy()
        matrix[:3, 3] = 0
    assert_same_field(grid, stored, matrix)
    if not isinstance(grid.samples, Leaves):
        assert grid.samples.shape == SIZE[::-1]
        assert grid.samples.dtype == np.dtype(dtype).newbyteorder("=")
    assert grid.warnings == ()
    assert grid.meters == {"mrc": 1e-10, "raw": 0.0, "vdb": 0.0}.get(kind, 1e-3)
    assert grid.source == str(path)
    assert grid.kind in KINDS_OF_GRID
    assert leapray.volume_grids(path)


def test_the_same_phantom_through_all_formats_is_the_same_field(tmp_path):
    grids = []
    for n, kind in enumerate(KINDS):
        folder = tmp_path / str(n)
        folder.mkdir()
        dtype = "uint8" if "uint8" in KINDS[kind].dtypes else KINDS[kind].dtypes[0]
        stored = (phantoms.samples("uint8") // 2).astype(dtype)
        KINDS[kind].write(
            folder / KINDS[kind].name, stored, phantoms.affine((0.5, 0.75, 3), origin=(0,) * 3)
        )
        grids.append(leapray.read_volume(folder / KINDS[kind].name))
    first = grids[0]
    for grid in grids[1:]:
        values = phantoms.dense(grid, (np.zeros(3, int), np.array(SIZE) - 1))
        index = np.linalg.inv(first.world_from_index) @ grid.world_from_index
        if grid.quantity == "HU":  # rows run to the left's and to the front's opposite
            assert_same_field(grid, np.asarray(first.samples), first.world_from_index)
            continue
        assert_allclose(index, np.eye(4), atol=1e-5)
        assert_array_equal(values, first.samples)


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "vdb"])
def test_samples_that_are_many_stay_in_a_file_of_which_slices_are_read(kind, tmp_path, monkeypatch):
    monkeypatch.setattr(file_samples, "SMALL", 0)
    path, *_ = written(tmp_path, kind)
    grid = leapray.read_volume(path)
    samples = grid.samples
    assert isinstance(samples, file_samples.FileSamples) and grid.nbytes == 0
    assert grid.unpacked_nbytes == (0 if kind in PLAIN else samples.nbytes)
    whole = np.asarray(samples)
    assert (samples.shape, samples.ndim, samples.size) == (whole.shape, 3, whole.size)
    for key in (slice(2, 5), slice(None), -1, (3, 4), (slice(1, 3), slice(None), 5), whole > 0):
        assert_array_equal(samples[key], whole[key])
    with pytest.raises(IndexError):
        samples[len(samples)]


# ---- NIfTI -----------------------------------------------------------------------


def test_nifti_of_the_other_byte_order(tmp_path):
    stored = phantoms.samples(np.int16)
    header = nibabel.Nifti1Header(endianness=">")
    nibabel.save(nibabel.Nifti1Image(stored.T, PLACES["oblique"], header), tmp_path / "a.nii")
    assert (tmp_path / "a.nii").read_bytes()[:4] == b"\0\0\x01\x5c"
    grid = leapray.read_volume(tmp_path / "a.nii")
    assert_same_field(grid, stored, PLACES["oblique"])
    assert grid.samples.dtype.isnative


def test_nifti_takes_the_sform_then_the_qform_then_the_spacing(tmp_path):
    image = nibabel.Nifti1Image(phantoms.samples().T, None)
    image.set_qform(PLACES["oblique"], code=1)
    image.set_sform(PLACES["anisotropic"], code=2)
    nibabel.save(image, tmp_path / "both.nii")
    data = bytearray((tmp_path / "both.nii").read_bytes())
    data[254:256] = b"\0\0"  # the sform's code
    (tmp_path / "q.nii").write_bytes(data)
    data[252:254] = b"\0\0"  # the qform's
    data[80:92] = np.array([2, 3, 4], "<f4").tobytes()
    (tmp_path / "none.nii").write_bytes(data)
    both, q, none = (leapray.read_volume(tmp_path / f"{n}.nii") for n in ("both", "q", "none"))
    assert_allclose(both.world_from_index, PLACES["anisotropic"], atol=1e-5)
    assert_allclose(q.world_from_index, PLACES["oblique"], atol=1e-4)
    assert_allclose(none.world_from_index, np.diag([2, 3, 4, 1]))
    assert (both.warnings, q.warnings) == ((), ())
    assert "does not say how it is oriented" in none.warnings[0]


@pytest.mark.parametrize(("unit", "meters"), [("meter", 1), ("mm", 1e-3), ("micron", 1e-6), (0, 0)])
def test_nifti_scale_unit_and_labels(unit, meters, tmp_path):
    image = nibabel.Nifti1Image(phantoms.samples().T, np.eye(4))
    image.header.set_xyzt_units(unit)
    image.header.set_slope_inter(0.5, -1024)
    image.header.set_intent("label")
    nibabel.save(image, tmp_path / "a.nii.gz")
    grid = leapray.read_volume(tmp_path / "a.nii.gz")
    told = nibabel.load(tmp_path / "a.nii.gz").dataobj
    assert (grid.scale, grid.offset) == (told.slope, told.inter)
    assert_allclose(grid.offset + grid.scale * np.asarray(grid.samples), np.asarray(told).T)
    assert grid.meters == meters
    assert grid.kind == "labels"


@pytest.mark.parametrize("name", ["a.nii", "a.nii.gz"])
def test_frames_of_nifti(name, tmp_path):
    stored = np.stack([phantoms.samples(seed=seed) for seed in range(4)])
    nibabel.save(nibabel.Nifti1Image(stored.T, np.eye(4)), tmp_path / name)
    for frame in range(4):
        assert_array_equal(leapray.read_volume(tmp_path / name, frame=frame).samples, stored[frame])
    first = leapray.read_volume(tmp_path / name)
    assert_array_equal(first.samples, stored[0])
    assert "has 4 frames, of which the first was read" in first.warnings[0]
    for frame in (4, -1):
        with pytest.raises(
            leapray.LeapRayError, match=rf"no frame {frame}; it has 4 frames, 0 to 3"
        ):
            leapray.read_volume(tmp_path / name, frame=frame)


# ---- NRRD ------------------------------------------------------------------------


@pytest.mark.parametrize("space", ["LPS", "RAS", "LAS"])
def test_anatomical_spaces_of_nrrd_become_one(space, tmp_path):
    stored = phantoms.samples()
    phantoms.write_nrrd(tmp_path / "a.nrrd", stored, PLACES["oblique"], space=space)
    grid = leapray.read_volume(tmp_path / "a.nrrd")
    assert_allclose(grid.world_from_index, PLACES["oblique"], atol=1e-9)


def test_other_spaces_of_nrrd_stay(tmp_path):
    header = {
        "space": "3D-left-handed",
        "space directions": np.diag([1.0, 2, 3]),
        "space origin": [4, 5, 6],
    }
    nrrd.write(str(tmp_path / "a.nrrd"), phantoms.samples(), header, index_order="C")
    want = np.diag([1.0, 2, 3, 1])
    want[:3, 3] = 4, 5, 6
    assert_allclose(leapray.read_volume(tmp_path / "a.nrrd").world_from_index, want)


@pytest.mark.parametrize("field", ["centerings", "centers"])
def test_nrrd_of_spacings_and_centers(field, tmp_path):
    header = {
        "spacings": [1.0, 2.0, 3.0],
        "axis mins": [10.0, 20, 30],
        field: ["cell", "node", "cell"] if field == "centerings" else "cell node cell",
    }
    nrrd.write(str(tmp_path / "a.nrrd"), phantoms.samples(), header, index_order="C")
    matrix = leapray.read_volume(tmp_path / "a.nrrd").world_from_index
    assert_allclose(np.diag(matrix), [1, 2, 3, 1])
    assert_allclose(matrix[:3, 3], [10.5, 20, 31.5])


@pytest.mark.parametrize("last", [False, True])
def test_frames_of_nrrd_may_be_any_axis(last, tmp_path):
    stored = np.stack([phantoms.samples(seed=seed) for seed in range(3)])
    nan = [np.nan] * 3
    along = (LPS @ PLACES["oblique"])[:3, :3].T.tolist()
    header = {
        "space": "left-posterior-superior",
        "space origin": (LPS @ PLACES["oblique"])[:3, 3],
        "space directions": np.array([*along, nan] if last else [nan, *along]),
        "kinds": ["domain"] * 3 + ["list"] if last else ["list"] + ["domain"] * 3,
    }
    array = stored if last else np.moveaxis(stored, 0, -1)
    nrrd.write(str(tmp_path / "a.nrrd"), np.ascontiguousarray(array), header, index_order="C")
    grid = leapray.read_volume(tmp_path / "a.nrrd", frame=2)
    assert_same_field(grid, stored[2], PLACES["oblique"])


def test_segments_of_nrrd_have_names_and_colours(tmp_path):
    names = {"Segment0_LabelValue": "1", "Segment0_Name": "skin", "Segment0_Color": "0.5 0.25 1"}
    names |= {"Segment1_LabelValue": "7", "Segment1_Name": "bone"}
    phantoms.write_nrrd(tmp_path / "a.nrrd", phantoms.samples("uint8"), np.eye(4), **names)
    grid = leapray.read_volume(tmp_path / "a.nrrd")
    assert grid.kind == "labels"
    assert grid.label_names == {1: "skin", 7: "bone"}
    assert grid.label_colors == {1: (0.5, 0.25, 1.0)}


# ---- MRC -------------------------------------------------------------------------


@pytest.mark.parametrize("order", [(1, 2, 3), (3, 2, 1), (2, 3, 1), (3, 1, 2)])
def test_the_axes_of_mrc_may_be_stored_in_any_order(order, tmp_path):
    import mrcfile

    stored = phantoms.samples(np.float32)  # z, y, x
    with mrcfile.new(tmp_path / "a.map") as file:
        file.set_data(np.ascontiguousarray(stored.transpose([3 - axis for axis in order[::-1]])))
        file.set_volume()
        for name, axis in zip(("mapc", "mapr", "maps"), order, strict=True):
            file.header[name] = axis
        for name, n, length in zip("xyz", SIZE, (1.5, 2.5, 0.5), strict=True):
            file.header[f"m{name}"], file.header.cella[name] = n, n * length
        for name, axis in zip("xyz", order, strict=True):  # of columns, rows, sections
            file.header[f"n{name}start"] = (10, 20, 30)[axis - 1]
    grid = leapray.read_volume(tmp_path / "a.map")
    want = np.diag([1.5, 2.5, 0.5, 1])
    want[:3, 3] = 15, 50, 15
    assert_same_field(grid, stored, want)


def test_a_skewed_cell_of_mrc(tmp_path):
    import mrcfile

    with mrcfile.new(tmp_path / "a.mrc") as file:
        file.set_data(phantoms.samples(np.float32))
        file.set_volume()
        file.voxel_size = 2.0
        file.header.cellb.alpha, file.header.cellb.beta, file.header.cellb.gamma = 80, 95, 120
    axes = leapray.read_volume(tmp_path / "a.mrc").world_from_index[:3, :3].T
    assert_allclose(np.linalg.norm(axes, axis=1), 2, rtol=1e-6)
    for a, b, angle in ((1, 2, 80), (0, 2, 95), (0, 1, 120)):
        assert np.degrees(np.arccos(axes[a] @ axes[b] / 4)) == pytest.approx(angle, abs=1e-4)


def test_mrc_stacks_of_volumes_have_frames(tmp_path):
    import mrcfile

    stored = np.stack([phantoms.samples(seed=seed) for seed in range(3)])
    with mrcfile.new(tmp_path / "a.mrc") as file:
        file.set_data(stored)
    assert_array_equal(leapray.read_volume(tmp_path / "a.mrc", frame=1).samples, stored[1])


def test_bytes_of_imod_may_be_unsigned(tmp_path):
    import mrcfile

    with mrcfile.new(tmp_path / "a.rec") as file:
        file.set_data(phantoms.samples(np.int8))
        file.set_volume()
    data = bytearray((tmp_path / "a.rec").read_bytes())
    data[152:160] = np.array([1146047817, 0], "<i4").tobytes()
    (tmp_path / "a.rec").write_bytes(data)
    assert leapray.read_volume(tmp_path / "a.rec").samples.dtype == np.uint8
    data[156] = 1
    (tmp_path / "a.rec").write_bytes(data)
    assert leapray.read_volume(tmp_path / "a.rec").samples.dtype == np.int8


# ---- TIFF ------------------------------------------------------------------------


def test_channels_are_grids_and_times_are_frames(tmp_path):
    stored = np.random.default_rng(0).integers(0, 60000, (3, 5, 2, 8, 9)).astype(np.uint16)
    tifffile.imwrite(tmp_path / "a.tif", stored, imagej=True, metadata={"axes": "TZCYX"})
    assert leapray.volume_grids(tmp_path / "a.tif") == ["channel 1", "channel 2"]
    grid = leapray.read_volume(tmp_path / "a.tif", grid="channel 2", frame=2)
    assert_array_equal(grid.samples, stored[2, :, 1])
    assert grid.name == "channel 2"
    with pytest.raises(leapray.LeapRayError, match="channel 1, channel 2"):
        leapray.read_volume(tmp_path / "a.tif", grid="red")


def test_spacing_of_ome(tmp_path):
    told = {"axes": "ZYX", "PhysicalSizeX": 0.5, "PhysicalSizeXUnit": "\u00b5m"}
    told |= {"PhysicalSizeY": 250.0, "PhysicalSizeYUnit": "nm"}
    told |= {"PhysicalSizeZ": 0.002, "PhysicalSizeZUnit": "mm"}
    tifffile.imwrite(tmp_path / "a.ome.tif", phantoms.samples(np.uint16), metadata=told)
    grid = leapray.read_volume(tmp_path / "a.ome.tif")
    assert_allclose(np.diag(grid.world_from_index), [0.5, 0.25, 2, 1])
    assert grid.meters == 1e-6


def test_spacing_of_the_resolution_in_centimetres(tmp_path):
    tifffile.imwrite(
        tmp_path / "a.tif",
        phantoms.samples(np.uint16),
        resolution=(20, 40),
        resolutionunit="CENTIMETER",
    )
    grid = leapray.read_volume(tmp_path / "a.tif")
    assert_allclose(np.diag(grid.world_from_index), [0.5, 0.25, 0.5, 1])
    assert grid.meters == 1e-3
    assert "slices lie apart" in grid.warnings[0]


@pytest.mark.parametrize("packed", [None, "zlib"])
def test_tiff_of_the_other_byte_order(packed, tmp_path):
    stored = phantoms.samples(np.uint16)
    tifffile.imwrite(
        tmp_path / "a.tif", stored, byteorder=">", compression=packed, photometric="minisblack"
    )
    assert (tmp_path / "a.tif").read_bytes()[:2] == b"MM"
    grid = leapray.read_volume(tmp_path / "a.tif")
    assert_array_equal(grid.samples, stored)
    assert grid.samples.dtype.isnative


# ---- raw -------------------------------------------------------------------------


def test_a_raw_file_may_say_its_layout_by_its_name(tmp_path):
    stored = phantoms.samples("uint16")
    stored.tofile(tmp_path / "head_11x9x7_uint16.raw")
    assert_array_equal(leapray.read_volume(tmp_path / "head_11x9x7_uint16.raw").samples, stored)


def test_a_layout_may_be_given(tmp_path):
    stored = np.stack([phantoms.samples(seed=seed) for seed in (1, 2)]).astype(">f4")
    (tmp_path / "a.dat").write_bytes(b"x" * 100 + stored.tobytes())
    layout = leapray.RawLayout(
        SIZE,
        "float32",
        (1, 2, 3),
        big_endian=True,
        header=100,
        frames=2,
        scale=2,
        offset=5,
        quantity="K",
    )
    grid = leapray.read_volume(tmp_path / "a.dat", layout=layout, frame=1)
    assert_array_equal(grid.samples, stored[1])
    assert (grid.scale, grid.offset, grid.quantity) == (2, 5, "K")
    assert_allclose(np.diag(grid.world_from_index), [1, 2, 3, 1])


def test_a_file_without_an_ending_is_known_by_its_content(tmp_path):
    for kind in ("nifti", "nrrd", "mrc", "tiff", "vdb"):
        dtype = KINDS[kind].dtypes[0]
        path, stored, _ = written(tmp_path, kind, dtype)
        bare = path.rename(tmp_path / kind)
        assert (
            phantoms.dense(leapray.read_volume(bare), (np.zeros(3, int), np.array(SIZE) - 1)).shape
            == stored.shape
        )


def test_a_packed_file_is_read_once_and_whole(tmp_path):
    stored = phantoms.samples()
    path, *_ = written(tmp_path, "nifti packed")
    assert gzip.decompress(path.read_bytes())[352:] == stored.tobytes()
    assert_array_equal(leapray.read_volume(path).samples, stored)
