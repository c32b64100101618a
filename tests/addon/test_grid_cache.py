# SPDX-License-Identifier: GPL-3.0-or-later
"""Measured files are read once, as long as they stay what they are, and within bounds."""

import os
import shutil

import numpy as np
import phantoms
import pytest

import leapray
from addon.store import grid_cache
from leapray import file_samples


@pytest.fixture
def reads(monkeypatch):
    """The paths that are read."""
    told = []
    read = leapray.read_volume

    def told_of(path, **more):
        told.append(path)
        return read(path, **more)

    monkeypatch.setattr(leapray, "read_volume", told_of)
    return told


def written(folder, kind, seed=1):
    path = folder / phantoms.KINDS[kind].name
    phantoms.KINDS[kind].write(path, phantoms.samples(seed=seed), phantoms.PLACES["anisotropic"])
    return path


def get(grids, path, grid=None, frame=0):
    return grids.read(path, grid, frame, leapray.Watch())


@pytest.mark.parametrize("kind", phantoms.KINDS)
def test_a_file_is_read_once_as_long_as_it_stays_as_it_is(kind, reads, tmp_path):
    path, grids = written(tmp_path, kind), grid_cache.Grids()
    first, contents = get(grids, path)
    assert get(grids, path) == (first, contents) and len(reads) == 1
    if path.is_dir():
        shutil.rmtree(path)
    path = written(tmp_path, kind, seed=2)
    second, other = get(grids, path)
    assert len(reads) == 2 and other != contents and second is not first


def touch(path):
    told = os.stat(path)
    os.utime(path, ns=(told.st_atime_ns, told.st_mtime_ns + 1_000_000))


@pytest.mark.parametrize(
    ("kind", "other"), [("dicom", "*.dcm"), ("raw", "*.json"), ("nrrd detached", "*.raw")]
)
def test_files_beside_count_too(kind, other, reads, tmp_path):
    path, grids = written(tmp_path, kind), grid_cache.Grids()
    get(grids, path)
    folder = path if path.is_dir() else path.parent
    touch(sorted(folder.glob(other))[-1])
    get(grids, path)
    assert len(reads) == 2


def test_one_more_slice_is_seen(reads, tmp_path):
    path, grids = written(tmp_path, "dicom"), grid_cache.Grids()
    n = len(get(grids, path)[0].samples)
    sorted(path.glob("*.dcm"))[-1].unlink()
    assert len(get(grids, path)[0].samples) == n - 1


def test_grids_and_frames_are_told_apart(reads, tmp_path):
    stored = np.arange(2 * 9 * 7 * 11, dtype=np.int16).reshape(2, 9, 7, 11)
    stored.tofile(tmp_path / "a.raw")
    (tmp_path / "a.json").write_text('{"size": [11, 7, 9], "dtype": "int16", "frames": 2}')
    grids = grid_cache.Grids()
    for frame in (0, 1, 0, 1):
        np.testing.assert_array_equal(
            get(grids, tmp_path / "a.raw", frame=frame)[0].samples, stored[frame]
        )
    assert len(reads) == 2


def test_a_file_that_changes_while_it_is_read_is_refused(monkeypatch, tmp_path):
    path, read = written(tmp_path, "nifti packed"), leapray.read_volume

    def changed(path, **more):
        made = read(path, **more)
        touch(path)
        return made

    monkeypatch.setattr(leapray, "read_volume", changed)
    grids = grid_cache.Grids()
    with pytest.raises(leapray.LeapRayError, match="changed while it was read"):
        get(grids, path)
    assert len(grids) == 0


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(leapray.LeapRayError, match=r"there is no file .*gone\.nii"):
        get(grid_cache.Grids(), tmp_path / "gone.nii")


@pytest.mark.parametrize("where", ["memory", "files"])
def test_the_oldest_go_first_where_there_are_too_many(where, reads, monkeypatch, tmp_path):
    monkeypatch.setattr(file_samples, "SMALL", 0 if where == "files" else 1 << 24)
    grids, paths = grid_cache.Grids(), []
    for name in "abcd":
        (tmp_path / name).mkdir()
        paths.append(written(tmp_path / name, "nifti packed"))
        grid = get(grids, paths[-1])[0]
    nbytes = grid.unpacked_nbytes or grid.nbytes
    get(grids, paths[0])  # the youngest now
    share = 1 if where == "files" else grid_cache.HELD_SHARE
    grids.trim(2 * nbytes / share)
    assert len(grids) == 2
    reads.clear()
    get(grids, paths[0])
    get(grids, paths[3])
    assert reads == []
    grids.trim(0)
    assert len(grids) == 1
    grids.clear()
    assert len(grids) == 0
