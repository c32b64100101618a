# SPDX-License-Identifier: GPL-3.0-or-later
"""Claims about series of DICOM slices: order, place, gaps, frames, scale, what is refused."""

import itertools

import numpy as np
import phantoms
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from phantoms import LPS, PLACES
from pydicom.dataset import Dataset
from pydicom.sequence import Sequence
from pydicom.uid import (
    ExplicitVRBigEndian,
    ImplicitVRLittleEndian,
    JPEG2000Lossless,
    RLELossless,
    generate_uid,
)

import leapray
from leapray import file_samples

PLACE = phantoms.affine((0.5, 0.75, 3.0), (10, 20, 30))


@pytest.fixture(autouse=True, params=["in memory", "in a file"])
def where(request, monkeypatch):
    """Phantoms are small: their samples come in memory, unless nothing is."""
    if request.param == "in a file":
        monkeypatch.setattr(file_samples, "SMALL", 0)


def ramp(n=7):
    """Slices each of which is its number times 100."""
    return np.repeat(np.arange(n, dtype=np.int16) * 100, 99).reshape(n, 9, 11)


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "series"


def test_a_file_stands_for_its_series(folder):
    stored = phantoms.samples()
    phantoms.write_dicom(folder, stored, PLACE)
    phantoms.write_dicom(folder, stored[:3] + 1, PLACE)
    grid = leapray.read_volume(folder)
    assert grid.samples.shape == stored.shape
    assert "holds 2 series, of which the largest" in grid.warnings[0]
    for uid in leapray.volume_grids(folder):
        file = next(folder.glob(f"*{uid[-6:]}.dcm"))
        one = leapray.read_volume(file)
        assert one.warnings == ()
        assert_array_equal(one.samples, leapray.read_volume(folder, grid=uid).samples)
    assert [
        len(leapray.read_volume(folder, grid=uid).samples) for uid in leapray.volume_grids(folder)
    ] == [7, 3]
    with pytest.raises(leapray.LeapRayError, match=r"no series '1\.2'"):
        leapray.read_volume(folder, grid="1.2")


def test_files_that_are_none_are_passed_over_and_folders_searched(tmp_path):
    phantoms.write_dicom(tmp_path / "a", phantoms.samples(), PLACE)
    (tmp_path / "a" / "readme.txt").write_text("nothing")
    (tmp_path / "a" / "DICOMDIR").write_bytes(b"\0" * 128 + b"DICM")
    assert_array_equal(leapray.read_volume(tmp_path).samples, phantoms.samples())


def test_slices_of_another_size_or_side_are_left(folder):
    series = generate_uid()
    phantoms.write_dicom(folder, phantoms.samples(), PLACE, series=series)
    other = phantoms.dicom_slice(phantoms.samples(), PLACES["upright"], 0, series)
    other.save_as(folder / "localizer.dcm", enforce_file_format=True)
    grid = leapray.read_volume(folder)
    assert_array_equal(grid.samples, phantoms.samples())
    assert "1 slices of another size or orientation" in grid.warnings[0]


def test_a_missing_slice_is_interpolated_and_told(folder):
    phantoms.write_dicom(folder, ramp(), PLACE, lambda data, k: k != 3)
    grid = leapray.read_volume(folder)
    assert_array_equal(grid.samples, ramp())  # a ramp's mean is the slice that is missing
    assert_allclose(grid.world_from_index, PLACE, atol=1e-6)
    assert "1 slices are missing" in grid.warnings[0] and str(folder) in grid.warnings[0]


def test_uneven_slices_are_made_even_and_told(folder):
    heights = np.array([0, 1, 2.3, 3, 4.4, 5, 6])

    def move(data, k):
        data.ImagePositionPatient = [
            float(round(x, 9)) for x in (LPS @ PLACE)[:3] @ [0, 0, heights[k], 1]
        ]

    stored = np.tile((heights * 100).astype(np.int16)[:, None, None], (9, 11))
    phantoms.write_dicom(folder, stored, PLACE, move)
    grid = leapray.read_volume(folder)
    k = np.arange(len(grid.samples))[:, None, None]
    step = np.linalg.norm(grid.world_from_index[:3, 2])
    assert (
        np.abs(np.asarray(grid.samples) - k * step / 3 * 100).max() <= 1
    )  # linear in height as it was
    assert step * (len(grid.samples) - 1) == pytest.approx(18)
    assert "unevenly spaced" in grid.warnings[0]


def test_doubled_slices_are_left_out_and_told(folder):
    series = generate_uid()
    phantoms.write_dicom(folder, ramp(), PLACE, series=series)
    double = phantoms.dicom_slice(ramp(), PLACE, 2, series)
    double.InstanceNumber = 99
    double.save_as(folder / "again.dcm", enforce_file_format=True)
    grid = leapray.read_volume(folder)
    assert_array_equal(grid.samples, ramp())
    assert "1 slices lie where others do" in grid.warnings[0]


def test_slices_in_the_same_places_are_frames(folder):
    series, stored = generate_uid(), [phantoms.samples(seed=seed) for seed in range(3)]
    for time, each in enumerate(stored):
        for k in range(len(each)):
            data = phantoms.dicom_slice(each, PLACE, k, series)
            data.TemporalPositionIdentifier = time + 1
            data.InstanceNumber = 100 - 10 * time - k
            folder.mkdir(exist_ok=True)
            data.save_as(folder / f"{k}{time}", enforce_file_format=True)
    for time in range(3):
        assert_array_equal(leapray.read_volume(folder, frame=time).samples, stored[time])
    assert "has 3 frames" in leapray.read_volume(folder).warnings[0]


def test_a_tilted_gantry_shears_the_lattice(folder):
    tilted = PLACE.copy()
    tilted[:3, 2] += 0.4 * PLACE[:3, 1]
    phantoms.write_dicom(folder, phantoms.samples(), tilted, lambda data, k: along(data, PLACE))
    grid = leapray.read_volume(folder)
    assert grid.warnings == ()
    assert_allclose(grid.world_from_index, tilted, atol=1e-6)


def along(data, place):
    """Rows and columns of another place."""
    axes = (LPS @ place)[:3, :2] / np.linalg.norm(place[:3, :2], axis=0)
    data.ImageOrientationPatient = [round(float(x), 12) for x in axes.T.ravel()]


def test_slices_without_a_place_follow_their_numbers(folder):
    def strip(data, k):
        del data.ImagePositionPatient, data.ImageOrientationPatient

    phantoms.write_dicom(folder, phantoms.samples(), PLACE, strip)
    grid = leapray.read_volume(folder)
    assert_array_equal(grid.samples, phantoms.samples())
    assert "does not say where its slices lie" in grid.warnings[0]
    assert_allclose(np.linalg.norm(grid.world_from_index[:3, :3], axis=0), [0.5, 0.75, 3])


def test_numbers_are_rescaled_to_hounsfield_units(folder):
    def rescale(data, k):
        data.RescaleSlope, data.RescaleIntercept, data.PixelPaddingValue = 2, -1024, 63536
        data["PixelPaddingValue"].VR = "US"

    phantoms.write_dicom(folder, phantoms.samples(), PLACE, rescale)
    grid = leapray.read_volume(folder)
    assert (grid.scale, grid.offset, grid.quantity, grid.meters) == (2, -1024, "HU", 1e-3)
    assert grid.no_data == 63536 - 65536  # the sign of the samples
    assert grid.samples.dtype == np.int16


def test_slices_of_their_own_scale_become_values(folder):
    def rescale(data, k):
        data.Modality, data.RescaleSlope, data.RescaleIntercept = "PT", 0.5 + k, k

    phantoms.write_dicom(folder, phantoms.samples(), PLACE, rescale)
    grid = leapray.read_volume(folder)
    k = np.arange(7)[:, None, None]
    assert_allclose(grid.samples, phantoms.samples() * (0.5 + k) + k, rtol=1e-6)
    assert (grid.scale, grid.offset, grid.quantity) == (1, 0, "")


@pytest.mark.parametrize("signed", [False, True])
def test_unused_bits_say_nothing(signed, folder):
    values = phantoms.samples(np.int16) if signed else phantoms.samples(np.uint16)
    dirty = (values & 0x0FFF | 0x5000).astype(values.dtype)

    def twelve(data, k):
        data.BitsStored, data.HighBit = 12, 11

    phantoms.write_dicom(folder, dirty, PLACE, twelve)
    want = (values.astype(np.int16) << 4) >> 4 if signed else values & 0x0FFF
    assert_array_equal(leapray.read_volume(folder).samples, want)


def test_small_values_shown_white_are_left_and_told(folder):
    def invert(data, k):
        data.PhotometricInterpretation = "MONOCHROME1"

    phantoms.write_dicom(folder, phantoms.samples(), PLACE, invert)
    grid = leapray.read_volume(folder)
    assert_array_equal(grid.samples, phantoms.samples())
    assert "shows small values white" in grid.warnings[0]


@pytest.mark.parametrize("syntax", [ExplicitVRBigEndian, ImplicitVRLittleEndian, RLELossless])
def test_every_uncompressed_way_of_writing_is_read(syntax, folder):
    stored = phantoms.samples()

    def write(data, k):
        if syntax == RLELossless:
            data.compress(RLELossless)
            return
        data.file_meta.TransferSyntaxUID = syntax
        data.set_original_encoding(syntax == ImplicitVRLittleEndian, syntax.is_little_endian)
        if syntax == ExplicitVRBigEndian:
            data.PixelData = stored[k].byteswap().tobytes()
            data["PixelData"].VR = "OW"

    phantoms.write_dicom(folder, stored, PLACE, write)
    grid = leapray.read_volume(folder)
    assert_array_equal(grid.samples, stored)
    assert grid.samples.dtype == np.int16


@pytest.mark.parametrize("shared", [False, True])
def test_a_file_of_several_frames_knows_the_place_of_each(shared, folder):
    stored = phantoms.samples()
    data = phantoms.dicom_slice(stored, PLACE, 0, generate_uid())
    positions = [(LPS @ PLACE)[:3] @ [0, 0, k, 1] for k in range(7)]
    order = [4, 2, 0, 6, 5, 3, 1]
    data.NumberOfFrames = 7
    data.PixelData = stored[order].tobytes()
    measures, turn, values = Dataset(), Dataset(), Dataset()
    measures.PixelSpacing, measures.SliceThickness = data.PixelSpacing, data.SliceThickness
    turn.ImageOrientationPatient = data.ImageOrientationPatient
    values.RescaleSlope, values.RescaleIntercept, values.RescaleType = 2, -1000, "HU"
    for name in (
        "PixelSpacing",
        "SliceThickness",
        "ImageOrientationPatient",
        "RescaleSlope",
        "RescaleIntercept",
        "ImagePositionPatient",
    ):
        del data[name]

    def groups():
        group = Dataset()
        group.PixelMeasuresSequence = Sequence([measures])
        group.PlaneOrientationSequence = Sequence([turn])
        group.PixelValueTransformationSequence = Sequence([values])
        return group

    frames = []
    for k in order:
        group = Dataset() if shared else groups()
        place = Dataset()
        place.ImagePositionPatient = [round(float(x), 9) for x in positions[k]]
        group.PlanePositionSequence = Sequence([place])
        frames.append(group)
    data.PerFrameFunctionalGroupsSequence = Sequence(frames)
    if shared:
        data.SharedFunctionalGroupsSequence = Sequence([groups()])
    folder.mkdir()
    data.save_as(folder / "all.dcm", enforce_file_format=True)
    for path in (folder, folder / "all.dcm"):
        grid = leapray.read_volume(path)
        assert_array_equal(grid.samples, stored)
        assert_allclose(grid.world_from_index, PLACE, atol=1e-6)
        assert (grid.scale, grid.offset, grid.warnings) == (2, -1000, ())


@pytest.mark.parametrize("offsets", [False, True])
def test_frames_of_a_file_that_tells_of_the_first_go_along_the_normal(offsets, folder):
    stored = phantoms.samples()
    data = phantoms.dicom_slice(stored, PLACE, 0, generate_uid())
    data.NumberOfFrames, data.PixelData = 7, stored.tobytes()
    if offsets:  # as doses tell it
        data.GridFrameOffsetVector = [3.0 * k for k in range(7)]
        del data.SliceThickness
    folder.mkdir()
    data.save_as(folder / "all.dcm", enforce_file_format=True)
    grid = leapray.read_volume(folder)
    assert_array_equal(grid.samples, stored)
    assert_allclose(grid.world_from_index, PLACE, atol=1e-6)
    assert grid.warnings == ()


def test_compressed_pictures_are_refused_by_the_name_of_the_compression(folder):
    def pretend(data, k):
        data.file_meta.TransferSyntaxUID = JPEG2000Lossless
        data["PixelData"].VR = "OB"
        data["PixelData"].is_undefined_length = True
        data.PixelData = (
            b"\xfe\xff\x00\xe0\0\0\0\0\xfe\xff\x00\xe0\x04\0\0\0abcd\xfe\xff\xdd\xe0\0\0\0\0"
        )

    phantoms.write_dicom(folder, phantoms.samples(), PLACE, pretend)
    with pytest.raises(leapray.LeapRayError, match=r"compressed \(JPEG 2000") as refusal:
        leapray.read_volume(folder)
    assert str(folder) in str(refusal.value)


def test_one_slice_is_a_volume_too(folder):
    phantoms.write_dicom(folder, phantoms.samples()[:1], PLACE)
    grid = leapray.read_volume(folder)
    assert grid.samples.shape == (1, 9, 11)
    assert_allclose(grid.world_from_index, PLACE, atol=1e-6)


def test_the_order_of_files_does_not_matter(folder, tmp_path):
    phantoms.write_dicom(folder, phantoms.samples(), PLACE)
    want = leapray.read_volume(folder)
    rng = np.random.default_rng(3)
    files = sorted(folder.iterdir())
    for file, n in zip(files, rng.permutation(len(files)), strict=True):
        file.rename(folder / f"x{n}")
    for file in itertools.islice(sorted(folder.iterdir()), 2):
        assert_array_equal(leapray.read_volume(file).samples, want.samples)
