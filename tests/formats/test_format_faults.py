# SPDX-License-Identifier: GPL-3.0-or-later
"""Broken, empty, misnamed and unfit files of each format: one sentence that names the file."""

import json
import logging
import os
import re
import subprocess
import sys

import bpy
import mrcfile
import nibabel
import nrrd
import numpy as np
import phantoms
import pytest
import tifffile
from phantoms import KINDS, PLACES

import leapray

bpy.utils.expose_bundled_modules()
import openvdb  # noqa: E402

FILES = [kind for kind in KINDS if kind != "dicom"]
SUFFIXES = {
    ".nii": "nifti",
    ".nrrd": "nrrd",
    ".mrc": "mrc",
    ".tif": "tiff",
    ".vdb": "vdb",
    ".dcm": "dicom",
}


def refusal(path, **options) -> str:
    """The one sentence with which a file is refused."""
    with pytest.raises(leapray.LeapRayError) as error:
        leapray.read_volume(path, **options)
    text = str(error.value)
    assert "\n" not in text and "Traceback" not in text and len(text) < 500
    assert path.name in text, text
    return text


def phantom(folder, kind):
    """A file of a phantom; of DICOM one with two slices and no others beside it."""
    path = folder / KINDS[kind].name
    if kind != "dicom":
        KINDS[kind].write(path, phantoms.samples(KINDS[kind].dtypes[0]), PLACES["anisotropic"])
        return path
    phantoms.write_dicom(path, phantoms.samples()[:1], PLACES["anisotropic"])
    return next(path.iterdir())


def test_a_missing_file_is_named(tmp_path):
    for suffix in (*SUFFIXES, ".raw", ""):
        assert "there is no file" in refusal(tmp_path / f"a{suffix}")


@pytest.mark.parametrize("kind", KINDS)
def test_an_empty_file_is_refused(kind, tmp_path):
    path = phantom(tmp_path, kind)
    path.write_bytes(b"")
    assert "is empty" in refusal(path)


# By one byte only files are cut that end with a sample. Others end with a checksum, with a digit
# of text, or, as TIFF, with the resolution of the last page: there the samples are whole.
CUTS = [(kind, share) for kind in KINDS for share in (0.02, 0.2, 0.5, 0.9)]
CUTS.remove(("tiff", 0.9))
CUTS += [(kind, -1) for kind in ("nifti", "nifti 2", "nrrd", "mrc", "raw", "vdb")]


@pytest.mark.parametrize(("kind", "share"), CUTS)
def test_a_file_that_is_cut_short_is_refused(kind, share, tmp_path):
    path = phantom(tmp_path, kind)
    data = path.read_bytes()
    path.write_bytes(data[: share if share < 0 else int(len(data) * share)])
    refusal(path)


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "raw"])
@pytest.mark.parametrize("what", ["noise", "text", "zeros", "zeros at the start"])
def test_a_file_of_something_else_is_refused(kind, what, tmp_path):
    path = phantom(tmp_path, kind)
    n = path.stat().st_size
    path.write_bytes(
        {
            "noise": np.random.default_rng(4).bytes(n),
            "text": b"It was a dark and stormy night.\n" * (n // 32),
            "zeros": b"\0" * n,
            "zeros at the start": b"\0" * 400 + path.read_bytes()[400:],
        }[what]
    )
    refusal(path)


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind not in ("raw", "vdb")])
def test_noise_in_the_head_is_refused_or_read_but_never_raises_otherwise(kind, tmp_path, capfd):
    """But of OpenVDB, which believes any length in its trees, and asks for as much memory."""
    path = phantom(tmp_path, kind)
    data, rng = path.read_bytes(), np.random.default_rng(len(kind))
    refused = 0
    for _ in range(30):
        broken = bytearray(data)
        for place in rng.integers(0, min(len(data), 500), 3):
            broken[place] = rng.integers(256)
        path.write_bytes(broken)
        try:
            leapray.read_volume(path)
        except leapray.LeapRayError as error:
            refused += 1
            assert "\n" not in str(error)
    assert refused or kind.startswith("nifti")  # whose head is mostly what nobody reads
    said = capfd.readouterr()
    assert (said.out, said.err) == ("", "")  # libraries are quiet


@pytest.mark.parametrize("kind", SUFFIXES.values())
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_misnamed_file_is_refused_by_what_it_is(kind, suffix, tmp_path):
    if SUFFIXES[suffix] == kind:
        suffix = ".nii.gz" if kind != "nifti" else ".nhdr"
    path = phantom(tmp_path, kind).rename(tmp_path / f"wrong{suffix}")
    told = {"nifti": "NIfTI", "nrrd": "NRRD", "mrc": "MRC", "tiff": "TIFF", "vdb": "OpenVDB"}
    name = told.get(kind, "DICOM")
    assert f"but it holds {name}" in refusal(path)


def test_a_file_of_no_known_kind_is_refused(tmp_path):
    for name in ("a.txt", "a", "a.png"):
        (tmp_path / name).write_bytes(b"nothing that is known")
        assert "is of no known format; names may end in .nii" in refusal(tmp_path / name)


def test_a_folder_without_volumes_is_refused(tmp_path):
    assert "holds no DICOM pictures" in refusal(tmp_path)
    (tmp_path / "a.txt").write_text("x")
    assert "holds no DICOM pictures" in refusal(tmp_path)


def test_a_grid_or_frame_that_is_none_is_named(tmp_path):
    for kind in FILES:
        folder = tmp_path / kind
        folder.mkdir()
        path = phantom(folder, kind)
        assert "'nosuch'" in refusal(path, grid="nosuch")
        assert "there is no frame 3; it has one frame, 0" in refusal(path, frame=3)


# ---- what no surface has -----------------------------------------------------------


def written(folder, kind, stored):
    path = folder / KINDS[kind].name
    KINDS[kind].write(path, stored, PLACES["anisotropic"])
    return path


@pytest.mark.parametrize("kind", KINDS)
def test_a_constant_field_is_read_and_has_no_threshold(kind, tmp_path):
    stored = np.full((5, 6, 7), 3, KINDS[kind].dtypes[0])
    if kind == "raw":
        path = tmp_path / "c_7x6x5_uint8.raw"
        stored.tofile(path)
    elif kind == "vdb":
        path = tmp_path / "c.vdb"
        grid = openvdb.FloatGrid(3.0)
        grid.fill((0, 0, 0), (6, 5, 4), 3.0)
        phantoms.write_vdb(path, np.full((8, 8, 8), 3, np.float32), np.eye(4), grid=grid)
    else:
        path = written(tmp_path, kind, stored)
    grid = leapray.read_volume(path)
    with pytest.raises(
        leapray.LeapRayError, match=r"the same value everywhere, about 3|no sample"
    ) as error:
        leapray.first_threshold(grid)
    assert path.name in str(error.value)


FLOATS = [kind for kind, item in KINDS.items() if "float32" in item.dtypes]


@pytest.mark.parametrize("kind", FLOATS)
def test_a_field_of_no_numbers_is_read_and_has_no_threshold(kind, tmp_path):
    if kind == "vdb":
        path = tmp_path / "a.vdb"
        phantoms.write_vdb(path, np.full((8, 8, 8), np.nan, np.float32), np.eye(4))
    else:
        path = written(tmp_path, kind, np.full(phantoms.SIZE[::-1], np.nan, np.float32))
    with pytest.raises(leapray.LeapRayError, match="no sample with a value") as error:
        leapray.first_threshold(leapray.read_volume(path))
    assert path.name in str(error.value)


@pytest.mark.parametrize("kind", [kind for kind in FILES if kind not in ("raw", "vdb")])
def test_one_sample_is_a_volume(kind, tmp_path):
    stored = np.full((1, 1, 1), 9, KINDS[kind].dtypes[0])
    grid = leapray.read_volume(written(tmp_path, kind, stored))
    assert grid.samples.shape == (1, 1, 1) and grid.samples[0, 0, 0] == 9


# ---- what is no scalar field ---------------------------------------------------------


def color_nifti(path):
    kind = np.dtype([("R", "u1"), ("G", "u1"), ("B", "u1")])
    nibabel.save(nibabel.Nifti1Image(np.zeros((4, 5, 6), kind), np.eye(4)), path)


def color_dicom(path):
    data = phantoms.dicom_slice(phantoms.samples("uint8"), np.eye(4), 0, "1.2.3")
    data.SamplesPerPixel, data.PhotometricInterpretation, data.PlanarConfiguration = 3, "RGB", 0
    data.PixelData = data.PixelData * 3
    data.save_as(path, enforce_file_format=True)


def palette_dicom(path):
    data = phantoms.dicom_slice(phantoms.samples("uint8"), np.eye(4), 0, "1.2.3")
    data.PhotometricInterpretation = "PALETTE COLOR"
    data.save_as(path, enforce_file_format=True)


def vector_nifti(path):
    image = nibabel.Nifti1Image(np.zeros((4, 5, 6, 1, 3), np.float32), np.eye(4))
    nibabel.save(image, path)


def save_nrrd(path, array, **header):
    nrrd.write(str(path), array, header, index_order="C")


def save_mrc(path, array):
    with mrcfile.new(path) as file:
        file.set_data(array)


def vector_vdb(path):
    grid = openvdb.Vec3SGrid()
    grid.name = "velocity"
    openvdb.write(str(path), grids=[grid])


UNFIT = {
    "colours of NIfTI": ("a.nii", color_nifti, "colours"),
    "vectors of NIfTI": ("a.nii", vector_nifti, "more than one number"),
    "complex NIfTI": (
        "a.nii",
        lambda path: nibabel.save(
            nibabel.Nifti1Image(np.zeros((4, 5, 6), np.complex64), np.eye(4)), path
        ),
        "complex64 are no real numbers",
    ),
    "colours of DICOM": ("a.dcm", color_dicom, "colours"),
    "palette of DICOM": ("a.dcm", palette_dicom, "palette"),
    "colours of NRRD": (
        "a.nrrd",
        lambda path: save_nrrd(
            path, np.zeros((4, 5, 6, 3), np.uint8), kinds=["RGB-color", *["domain"] * 3]
        ),
        "colours",
    ),
    "vectors of NRRD": (
        "a.nrrd",
        lambda path: save_nrrd(
            path, np.zeros((4, 5, 6, 3), np.float32), kinds=["vector", *["domain"] * 3]
        ),
        "several numbers a sample",
    ),
    "a flat NRRD": ("a.nrrd", lambda path: save_nrrd(path, np.zeros((4, 5))), "make no volume"),
    "complex MRC": (
        "a.mrc",
        lambda path: save_mrc(path, np.zeros((4, 5, 6), np.complex64)),
        "complex",
    ),
    "colours of TIFF": (
        "a.tif",
        lambda path: tifffile.imwrite(path, np.zeros((4, 5, 6, 3), np.uint8), photometric="rgb"),
        "colours",
    ),
    "complex TIFF": (
        "a.tif",
        lambda path: tifffile.imwrite(
            path, np.zeros((4, 5, 6), np.complex64), photometric="minisblack"
        ),
        "no real numbers",
    ),
    "vectors of OpenVDB": ("a.vdb", vector_vdb, "'velocity' holds vec3s"),
}


@pytest.mark.parametrize("what", UNFIT)
def test_what_is_no_scalar_field_is_refused(what, tmp_path):
    name, write, reason = UNFIT[what]
    write(tmp_path / name)
    assert reason in refusal(tmp_path / name)


def test_a_lattice_without_extent_is_refused(tmp_path):
    flat = np.diag([1.0, 0, 2, 1])
    for name, write in (("a.nii", phantoms.write_nifti), ("a.nrrd", phantoms.write_nrrd)):
        write(tmp_path / name, phantoms.samples(), np.eye(4))
    save_nrrd(
        tmp_path / "a.nrrd",
        phantoms.samples(),
        **{"space": "RAS", "space directions": flat[:3, :3], "space origin": [0, 0, 0]},
    )
    assert "cannot be placed" in refusal(tmp_path / "a.nrrd")
    plane = np.array([[1.0, 0, 0], [0, 1, 0], [1, 1, 0]])
    save_nrrd(
        tmp_path / "b.nrrd",
        phantoms.samples(),
        **{"space": "RAS", "space directions": plane, "space origin": [0, 0, 0]},
    )
    assert "axes lie in one plane" in refusal(tmp_path / "b.nrrd")


def test_the_samples_of_a_detached_header_are_looked_for(tmp_path):
    phantoms.write_nrrd(tmp_path / "a.nhdr", phantoms.samples(), np.eye(4))
    (data,) = (file for file in tmp_path.iterdir() if file.suffix != ".nhdr")
    data.unlink()
    assert data.name in refusal(tmp_path / "a.nhdr")


def test_samples_in_several_files_are_refused(tmp_path):
    phantoms.write_nrrd(tmp_path / "a.nhdr", phantoms.samples(), np.eye(4))
    text = (tmp_path / "a.nhdr").read_text()
    for several in ("LIST", "slice%03d.raw 1 7 1"):
        changed = re.sub(r"data file: .*", f"data file: {several}", text)
        assert changed != text
        (tmp_path / "a.nhdr").write_text(changed)
        assert "in several files" in refusal(tmp_path / "a.nhdr")


# ---- raw -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("members", "reason"),
    [
        ({"size": [11, 9]}, "three whole numbers"),
        ({"size": [11, 9, 7.5]}, "three whole numbers"),
        ({"size": [11, 9, -7]}, "makes no volume"),
        ({"size": [2**30, 2**30, 2**30]}, "makes no volume"),
        ({"size": 11}, "lists of three"),
        ({"dtype": "uint17"}, "no type of numbers"),
        ({"dtype": "complex64"}, "no real numbers"),
        ({"dtype": "object"}, "no real numbers"),
        ({"spacing": [1, 1]}, "no such numbers"),
        ({"spacing": [1, 0, 1]}, "cannot be placed"),
        ({"scale": 0}, "no such numbers"),
        ({"kind": "solid"}, "unknown kind 'solid'"),
        ({"frames": 2}, "its layout takes"),
        ({"header": -1}, "makes no volume"),
        ({"colour": "red"}, "unknown member 'colour'"),
    ],
)
def test_a_wrong_layout_is_refused_in_a_sentence(members, reason, tmp_path):
    path = tmp_path / "a.raw"
    phantoms.samples("uint8").tofile(path)
    layout = {"size": [11, 9, 7], "dtype": "uint8", **members}
    path.with_suffix(".json").write_text(json.dumps(layout))
    with pytest.raises(leapray.LeapRayError, match=reason) as error:
        leapray.read_volume(path)
    assert str(tmp_path / "a.") in str(error.value)


def test_a_raw_file_without_a_layout_is_told_how_to_get_one(tmp_path):
    (tmp_path / "a.raw").write_bytes(b"x" * 100)
    assert "put it into a.json" in refusal(tmp_path / "a.raw")
    for text in ("{", "[]", '{"size": [1, 1, 1]}'):
        (tmp_path / "a.json").write_text(text)
        with pytest.raises(leapray.LeapRayError, match=r"a\.json: it (is no JSON|needs)"):
            leapray.read_volume(tmp_path / "a.raw")


# ---- libraries -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "module", "package"),
    [
        ("nifti", "nibabel", "nibabel"),
        ("dicom", "pydicom", "pydicom"),
        ("nrrd", "nrrd", "pynrrd"),
        ("mrc", "mrcfile", "mrcfile"),
        ("tiff", "tifffile", "tifffile"),
        ("vdb", "openvdb", "openvdb"),
    ],
)
def test_a_library_that_is_missing_is_named(kind, module, package, tmp_path, monkeypatch):
    path = phantom(tmp_path, kind)
    leapray.read_volume(path)
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(leapray.LeapRayError, match=f"Python package {package}"):
        leapray.read_volume(path)


def test_logging_is_as_it_was(tmp_path):
    path = phantom(tmp_path, "tiff")
    path.write_bytes(path.read_bytes()[:300])
    logger = logging.getLogger("tifffile")
    before = logger.propagate, list(logger.handlers), list(logger.filters)
    refusal(path)
    assert (logger.propagate, list(logger.handlers), list(logger.filters)) == before


def test_what_libraries_log_is_not_printed(tmp_path):
    path = phantom(tmp_path, "nifti")
    data = bytearray(path.read_bytes())
    data[252:254] = b"\x00\xf7"  # a code of the qform that nibabel complains of and mends
    path.write_bytes(data)
    command = "import sys, leapray; print(leapray.read_volume(sys.argv[1]).samples.shape)"
    done = subprocess.run(
        [sys.executable, "-c", command, path],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    assert (done.stdout, done.stderr) == ("(7, 9, 11)\n", "")
