# SPDX-License-Identifier: GPL-3.0-or-later
"""Claims about samples that stay in files: the same numbers, no memory, and sentences where a file
changes while it is read."""

import contextlib
import errno
import gc
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import leapray
from leapray import file_samples
from leapray.file_samples import FileSamples, Spool, spooled, unmapped
from leapray.scalar_grid import Leaves, ScalarGrid

MATRIX = np.diag([0.5, 0.75, 2.0, 1.0])
ROOT = Path(__file__).parents[2]


@pytest.fixture(autouse=True)
def nothing_in_memory(monkeypatch):
    monkeypatch.setattr(file_samples, "SMALL", 0)


def noise(shape=(21, 18, 30), dtype=np.uint16):
    rng = np.random.default_rng(3)
    made = rng.integers(0, 1000, shape) if np.dtype(dtype).kind in "iu" else rng.normal(size=shape)
    return made.astype(dtype)


def raw(path, array):
    """A raw file of an array, and its grid."""
    array.tofile(path)
    layout = leapray.RawLayout(array.shape[::-1], array.dtype.name)
    return leapray.read_volume(path, layout=layout)


def made_of(volume):
    return volume.read((-2, -2, -2), tuple(n + 4 for n in volume.info.size))


# ---- the same numbers ------------------------------------------------------------


@pytest.mark.parametrize("dtype", ["<u2", ">i2", "<f4", ">f8", "u1"])
def test_views_of_a_file_are_read_as_they_would_be_mapped(dtype, tmp_path):
    stored = noise((4, 5, 6, 3)).astype(dtype)
    (tmp_path / "a.bin").write_bytes(b"head.." + stored.tobytes())
    mapped = np.memmap(tmp_path / "a.bin", dtype, "r", 6, stored.shape)
    views = mapped[..., 1], mapped[2], mapped[1:, :, ::2, 0], mapped[..., 0].transpose(2, 0, 1)
    for view, kind in zip(views, (FileSamples,) * 3 + (np.ndarray,), strict=True):
        got = unmapped(view)
        assert isinstance(got, kind) and got.dtype.isnative
        assert_array_equal(got, view)
        assert_array_equal(got[1:3], view[1:3])


def test_arrays_that_are_many_go_to_a_file_and_come_back(monkeypatch):
    array = noise((30, 8, 8, 8), np.float32)
    monkeypatch.setattr(file_samples, "SMALL", array.nbytes // 4)
    kept = spooled(array)
    assert isinstance(kept, FileSamples) and kept.unpacked_nbytes == array.nbytes
    assert_array_equal(kept, array)
    assert spooled(array[:5]) is not None and isinstance(spooled(array[:5]), np.ndarray)


@pytest.mark.parametrize("dtype", [np.uint16, np.int16, np.float32, np.float64])
def test_volumes_filters_and_counts_do_not_depend_on_where_samples_are(dtype, tmp_path):
    array = noise(dtype=dtype)
    here, there = ScalarGrid("array", array, MATRIX), raw(tmp_path / "a.raw", array)
    assert isinstance(there.samples, FileSamples) and there.nbytes == 0 == there.unpacked_nbytes
    threshold, how = leapray.first_threshold(here)
    assert leapray.first_threshold(there) == (threshold, how)
    for one, other in (
        (here, there),
        *((leapray.coarser(each, n) for each in (here, there)) for n in (2, 3, 64)),
        (leapray.smooth(each, 1.3) for each in (here, there)),
        (leapray.without_islands(each, threshold, 20) for each in (here, there)),
    ):
        assert_array_equal(np.asarray(other.samples), np.asarray(one.samples))
        volumes = [leapray.isosurface(each, threshold, threads=3) for each in (one, other)]
        assert_array_equal(*map(made_of, volumes))


def test_labels_in_a_file_are_those_in_memory(tmp_path):
    array = noise() % 5
    here = ScalarGrid("labels", array, np.eye(4), kind="labels")
    (tmp_path / "a.raw").write_bytes(array.tobytes())
    layout = leapray.RawLayout(array.shape[::-1], "uint16", kind="labels")
    there = leapray.read_volume(tmp_path / "a.raw", layout=layout)
    assert_array_equal(made_of(leapray.labels(there)), made_of(leapray.labels(here)))
    one, other = (leapray.coarser(each, 4).samples for each in (here, there))
    assert_array_equal(other, one)


def test_leaves_in_a_file_are_those_in_memory():
    samples = noise((40, 8, 8, 8), np.float32)
    origins = 8 * np.random.default_rng(0).permutation(list(np.ndindex(5, 5, 5)))[:40] - 16
    here, there = (
        ScalarGrid("leaves", Leaves(origins.astype(np.int32), each, -1.0), MATRIX)
        for each in (samples, spooled(samples))
    )
    assert there.nbytes < 1000 and here.nbytes > samples.nbytes
    assert_array_equal(*(made_of(leapray.isosurface(each, 0.3)) for each in (here, there)))


def test_the_samples_of_a_volume_are_all_that_memory_holds(tmp_path):
    """Beside them a few slices, for each thread: measured in a process of its own."""
    shape = 384, 384, 384
    (tmp_path / "a.raw").write_bytes(noise(shape).tobytes())
    code = f"""
import leapray
from pathlib import Path
def anonymous():
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("RssAnon")) * 1024
layout = leapray.RawLayout((384, 384, 384), "uint16")
leapray.isosurface(leapray.coarser(leapray.read_volume({str(tmp_path / "a.raw")!r}, layout=layout),
                                   16), 500.0, threads=2)
before = anonymous()
grid = leapray.read_volume({str(tmp_path / "a.raw")!r}, layout=layout)
threshold = leapray.first_threshold(grid)[0]
made = leapray.Isosurfaces(grid, threads=2)
print(anonymous() - before, made.nbytes)
"""
    if not Path("/proc/self/status").exists():
        pytest.skip("the system tells nothing of a process's memory")
    paths = os.pathsep.join([str(ROOT), str(ROOT / "native")])
    run = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": paths},
    )
    assert run.returncode == 0, run.stderr
    grown, held = map(int, run.stdout.split())
    assert held == pytest.approx(2 * np.prod(shape), rel=0.12)  # bricks reach beyond the border
    assert grown < 1.4 * held


# ---- files that change -----------------------------------------------------------


def test_a_file_that_is_cut_while_it_is_read_is_a_sentence_and_no_signal(tmp_path, monkeypatch):
    """A mapped file would end the process by SIGBUS."""
    grid = raw(tmp_path / "a.raw", noise((64, 64, 64)))
    read, calls = os.preadv, []

    def cut_later(fd, buffers, offset):
        calls.append(offset)
        if len(calls) == 5:
            os.truncate(tmp_path / "a.raw", 1000)
        return read(fd, buffers, offset)

    monkeypatch.setattr(os, "preadv", cut_later)
    with pytest.raises(leapray.LeapRayError, match=r"a\.raw has changed since its reading began"):
        leapray.Isosurfaces(grid, threads=2)
    assert len(calls) >= 5


@pytest.mark.parametrize("how", ["cut", "written", "longer"])
@pytest.mark.parametrize(
    "work",
    [
        leapray.histogram,
        leapray.first_threshold,
        leapray.Isosurfaces,
        lambda grid: leapray.smooth(grid, 1.0),
        lambda grid: leapray.coarser(grid, 2),
        lambda grid: leapray.without_islands(grid, 500.0, 10),
        lambda grid: np.asarray(grid.samples),
    ],
)
def test_a_file_that_changed_since_is_a_sentence(how, work, tmp_path):
    grid = raw(tmp_path / "a.raw", noise())
    before = os.stat(tmp_path / "a.raw")
    with open(tmp_path / "a.raw", "r+b") as file:
        if how == "cut":
            file.truncate(100)
        else:
            file.seek(0, os.SEEK_END if how == "longer" else os.SEEK_SET)
            file.write(b"xx")
    os.utime(tmp_path / "a.raw", ns=(before.st_atime_ns, before.st_mtime_ns + (how == "written")))
    with pytest.raises(leapray.LeapRayError, match=r"a\.raw has changed"):
        work(grid)


def test_a_file_that_is_replaced_or_removed_is_still_read(tmp_path):
    array = noise()
    grid = raw(tmp_path / "a.raw", array)
    (tmp_path / "b.raw").write_bytes(b"other")
    os.replace(tmp_path / "b.raw", tmp_path / "a.raw")
    assert_array_equal(grid.samples, array)


def test_a_file_that_is_too_short_is_refused_when_it_is_opened(tmp_path):
    (tmp_path / "a.bin").write_bytes(bytes(100))
    with pytest.raises(leapray.LeapRayError, match="ends before its last sample"):
        FileSamples(tmp_path / "a.bin", np.dtype("<u2"), (5, 5, 2), 2)
    FileSamples(tmp_path / "a.bin", np.dtype("<u2"), (5, 5, 2))
    with pytest.raises(leapray.LeapRayError, match="cannot be read"):
        FileSamples(tmp_path / "gone.bin", np.dtype("<u2"), (1, 1, 1))


# ---- temporary files -------------------------------------------------------------


def test_temporary_files_lie_where_tmpdir_says_and_have_no_names(tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    kept = spooled(noise())
    assert not list(tmp_path.iterdir())
    (link,) = {each for each in links() if str(tmp_path) in each}
    assert "deleted" in link
    del kept
    gc.collect()
    assert not [each for each in links() if str(tmp_path) in each]


def links() -> list[str]:
    """What the open files of this process are; other threads may close some meanwhile."""
    folder = Path("/proc/self/fd")
    if not folder.exists():
        pytest.skip("the system tells nothing of open files")
    found = []
    for each in folder.iterdir():
        with contextlib.suppress(FileNotFoundError):
            found.append(os.readlink(each))
    return found


def test_a_full_disk_is_a_sentence(monkeypatch):
    def full(fd, data, offset):
        raise OSError(errno.ENOSPC, "No space left on device")

    spool = Spool((4, 4, 4), np.dtype(np.uint8))
    monkeypatch.setattr(os, "pwrite", full)
    with pytest.raises(leapray.OutOfMemory, match=r"No space left .* TMPDIR"):
        spool[0:4] = np.zeros((4, 4, 4), np.uint8)
    monkeypatch.undo()
    monkeypatch.setattr(file_samples, "SMALL", 0)
    with pytest.raises(leapray.OutOfMemory, match="no room"):
        monkeypatch.setattr("tempfile.mkstemp", lambda **_: full(0, b"", 0))
        Spool((4, 4, 4), np.dtype(np.uint8))


def test_slices_may_be_written_in_any_order():
    array, spool = noise(), Spool((21, 18, 30), np.dtype(np.uint16))
    for first in (12, 0, 18, 6):
        spool[first : first + 6] = array[first : first + 6]
    assert_array_equal(spool.samples(), array)


# ---- stopped ---------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["nifti packed", "nrrd packed", "tiff packed", "dicom", "vdb"])
def test_reading_can_be_stopped(kind, tmp_path):
    import phantoms

    path = tmp_path / phantoms.KINDS[kind].name
    phantoms.KINDS[kind].write(path, phantoms.samples(), phantoms.PLACES["anisotropic"])
    watch = leapray.Watch()
    watch.stop()
    with pytest.raises(leapray.Stopped):
        leapray.read_volume(path, watch=watch)
    going = leapray.Watch()
    leapray.read_volume(path, watch=going)
    assert 0 <= going.progress <= 1
