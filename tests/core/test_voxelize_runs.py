# SPDX-License-Identifier: GPL-3.0-or-later
"""Claims about voxelization as a long call: threads, progress, stopping."""

import os
import signal
import threading
import time

import meshes
import numpy as np
import pytest
from numpy.testing import assert_array_equal

from leapray import LeapRayError, Stopped, Watch
from leapray.voxelization import voxelize


@pytest.mark.parametrize("mesh", [meshes.spiky(2, levels=3), meshes.leaf()], ids=["solid", "sheet"])
def test_the_number_of_threads_does_not_matter(mesh):
    vertices, triangles = mesh
    ids = np.arange(len(triangles)) % 7
    one, *others = (
        voxelize(vertices, triangles, 0.03, ids=ids, threads=n, dtype="f32") for n in (1, 2, 7)
    )
    for other in others:
        assert_array_equal(other.read(), one.read())
        assert_array_equal(other.read_ids(), one.read_ids())
        assert_array_equal(other.read_surface(), one.read_surface())


def offered(simd):
    try:
        return voxelize(*meshes.box(), 0.5, simd=simd).mesh_info.simd == simd
    except LeapRayError as refused:
        assert simd in str(refused)
        return False


@pytest.mark.parametrize("simd", ["avx2", "avx512"])
@pytest.mark.parametrize("name", ["fat", "thin", "long", "sheet", "dense"])
def test_the_instructions_do_not_matter(name, simd):
    """Every bit is the same: triangles of all shapes, far larger and smaller than a voxel."""
    if not offered(simd):
        pytest.skip("this processor does not have them")
    (vertices, triangles), h = {
        "fat": (meshes.spiky(2, levels=3), 0.03),
        "thin": (meshes.uv_sphere(300, 7), 0.03),
        "long": (meshes.box((0, 0, 0), (3, 0.2, 0.1)), 0.011),
        "sheet": (meshes.leaf(), 0.03),
        "dense": (meshes.torus(200, 100), 0.11),
    }[name]
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    ids = np.arange(len(triangles)) % 65536
    portable, other = (
        voxelize(vertices @ turn, triangles, h, ids=ids, dtype="f32", simd=path)
        for path in ("portable", simd)
    )
    assert portable.mesh_info.simd == "portable"
    assert_array_equal(other.read(), portable.read())
    assert_array_equal(other.read_ids(), portable.read_ids())
    for exact, flat in (("sheets", False), ("all", True), ("every", False)):
        portable, other = (
            voxelize(vertices @ turn, triangles, h, exact=exact, flat=flat, simd=path)
            for path in ("portable", simd)
        )
        assert_array_equal(other.read_exact(), portable.read_exact())
        assert other.info.n_cell_triangles == portable.info.n_cell_triangles


def test_progress_rises_to_one():
    watch = Watch()
    seen = []
    done = threading.Event()

    def look():
        while not done.wait(0.001):
            seen.append(watch.progress)

    looker = threading.Thread(target=look)
    looker.start()
    voxelize(*meshes.icosphere(5), 0.01, watch=watch, threads=2)
    done.set()
    looker.join()
    assert watch.progress == 1.0
    assert len(set(seen)) > 5 and seen == sorted(seen)


@pytest.mark.slow
@pytest.mark.alone
@pytest.mark.parametrize("fraction", [0.0, 0.05, 0.3, 0.7, 0.95])
def test_stopping_ends_within_100_ms(fraction):
    vertices, triangles = meshes.icosphere(6)  # 81,920 triangles
    watch = Watch()
    begun = time.perf_counter()
    voxelize(vertices, triangles, 0.004)
    whole = time.perf_counter() - begun
    told = []

    def stop():
        told.append(time.perf_counter())
        watch.stop()

    timer = threading.Timer(fraction * whole, stop)
    timer.start()
    try:
        voxelize(vertices, triangles, 0.004, watch=watch)
    except Stopped:
        assert time.perf_counter() - told[0] < 0.1
    else:
        assert fraction > 0.6  # this time it was quicker than the measured one
    timer.join()


def test_stopping_gives_the_memory_back():
    vertices, triangles = meshes.icosphere(6)

    def stopped_run():
        watch = Watch()
        timer = threading.Timer(0.15, watch.stop)
        timer.start()
        with pytest.raises(Stopped):
            while True:
                voxelize(vertices, triangles, 0.004, watch=watch)
        timer.join()

    def resident():
        with open("/proc/self/statm") as file:
            return int(file.read().split()[1]) * 4096

    stopped_run()
    before = resident()
    for _ in range(8):
        stopped_run()
    assert resident() - before < 120e6  # eight runs hold some 480 MB; the allocator keeps a little


@pytest.mark.alone
def test_ctrl_c_ends_within_100_ms():
    vertices, triangles = meshes.icosphere(6)
    told = []

    def interrupt():
        told.append(time.perf_counter())
        os.kill(os.getpid(), signal.SIGINT)

    timer = threading.Timer(0.3, interrupt)
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        while True:
            voxelize(vertices, triangles, 0.004, threads=2)
    assert time.perf_counter() - told[0] < 0.1
    timer.join()
    while [t for t in threading.enumerate() if t.name.startswith("leapray")]:
        assert time.perf_counter() - told[0] < 1.0  # one that was just about to begin ends at once
