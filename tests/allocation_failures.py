# SPDX-License-Identifier: GPL-3.0-or-later
"""Let every allocation of the core fail once, and see what comes of it.

    python native/build_variants.py address tests/allocation_failures.py

Each scenario is run again and again, each time with its next allocation failing, until
none is left to fail. A run must end by OutOfMemory with a sentence, or as if nothing had
happened where the core can do without (an array that was only to shrink); afterwards the
core holds no block that it did not hold before. Prints the places that have failed so, as
JSON: {"refused": [...], "tolerated": [...], "runs": n}.
"""

from __future__ import annotations

import ctypes
import gc
import json
import os
import re
import sys
import threading
from pathlib import Path

import numpy as np

if __name__ == "__main__":
    native = str(Path(__file__).resolve().parent.parent / "native")
    sys.path[:0] = [os.environ.get("LEAPRAY_PACKAGE", native)]

import meshes
from sentences import check_sentence

import leapray
from leapray import _lib

NATIVE = Path(__file__).resolve().parent.parent / "native"
ASKED = re.compile(r"\b(malloc|calloc|realloc|aligned_alloc|mmap|lr_pages_new)\(")
OWN = r"^(void|#)"  # lines that declare or define one


def places() -> set[str]:
    """Every line of the core that asks for memory, as file:line."""
    found = set()
    for path in sorted((NATIVE / "src").rglob("*.[ch]")):
        for number, line in enumerate(path.read_text().splitlines(), 1):
            if ASKED.search(line) and not re.match(OWN + r"|\s*(/\*|\* )", line):
                found.add(f"{path.relative_to(NATIVE)}:{number}")
    return found


# ---- scenarios: together they reach every place ------------------------------------------------


def colored(n: int) -> leapray.Attributes:
    pixels = np.linspace(0, 1, 27, dtype=np.float32).reshape(3, 3, 3)
    return leapray.Attributes(
        normals=np.ones((n, 3, 3), np.float32),
        color_sources=np.resize([0, 1, leapray.VERTEX], n),
        colors=np.ones((n, 3, 3), np.float32),
        uvs=np.ones((n, 3, 2), np.float32),
        textures=(leapray.Texture(pixels), leapray.Texture(pixels[:2], program=invert())),
    )


def invert() -> leapray.Program:
    red, *_ = leapray.programs.INPUTS
    less = leapray.programs.operate("subtract", 1.0, red)
    return leapray.programs.compile_program((less, less, less))


BOX, LEAF = meshes.box((-0.5, -0.4, -0.3), (0.5, 0.4, 0.3)), meshes.leaf(4)
BALL = meshes.icosphere(1)
PIERCED = BALL[0], BALL[1][3:]


def voxelize(mesh, size, **more) -> leapray.Volume:
    return leapray.voxelize(*mesh, size, threads=1, **more)


def a_solid():
    n = len(BOX[1])
    volume = voxelize(
        BOX, 0.2, exact="all", dtype="u8", ids=np.arange(n) % 3, attributes=colored(n)
    )
    again = leapray.Volume.unpack(volume.pack())
    again.bind(volume.textures)
    leapray.build(again)


def a_sheet():
    volume = voxelize(LEAF, 0.3, attributes=colored(len(LEAF[1])))
    volume.narrow(2.0)


def trees_of_triangles():
    for mesh in (LEAF, (LEAF[0], LEAF[1][:3])):  # nodes, and a block alone
        leapray.build(voxelize(mesh, 0.5, kind="sheet", exact="every", dtype="u8"))


def a_pierced_ball():
    voxelize(PIERCED, 0.3, kind="solid")


def a_large_mesh():
    leapray.mesh_layers(*meshes.icosphere(6), 0.01)  # its arrays are mapped, not allocated


def a_doubled_crossing():
    twice = np.concatenate([BOX[1], BOX[1][:, ::-1], BOX[1]])
    mesh = meshes.joined((BOX[0], twice), (BOX[0] + 0.3, BOX[1]), (0.2 * BALL[0], BALL[1]))
    voxelize(mesh, 0.2, kind="solid")
    voxelize(mesh, 0.2)


def two_islands():
    mesh = meshes.joined(BALL, (BALL[0] + 3, BALL[1]))
    leapray.mesh_layers(*mesh, 0.1)
    leapray.mesh_edges(*mesh, 0.5)
    voxelize(mesh, 0.5)


def coverage():
    voxelize(BALL, 0.4, filter="box")
    voxelize(PIERCED, 0.4, filter="box", kind="solid")


def merged():
    parts = [
        voxelize(
            (BOX[0] + 0.7 * k, BOX[1]), 0.2, kind="solid", ids=np.full(len(BOX[1]), k),
            attributes=colored(len(BOX[1])),
        )
        for k in range(2)
    ]  # fmt: skip
    volume = leapray.merge(parts)
    leapray.Volume.unpack(volume.pack())
    volume.narrow()


def sampled():
    rng = np.random.default_rng(1)
    noise = rng.random((20, 9, 10)).astype(np.float32)
    planes = [np.cumsum(rng.random(n)) for n in noise.shape[::-1]]
    leapray.Volume(noise, planes=planes)
    leapray.Volume(noise, ids=rng.integers(0, 9, noise.shape)).narrow()
    leapray.Volume(noise, sheet=True, touched=noise < 0.5)


def fields():
    rng = np.random.default_rng(2)
    numbers = rng.normal(size=(12, 11, 10))
    for stored in (np.int16(1000 * numbers), np.float32(numbers), numbers):
        field = leapray.ScalarGrid("numbers", stored, np.eye(4))
        surfaces = leapray.Isosurfaces(field, threads=1)
        for threshold in (0.0, 0.5):
            surfaces.at(threshold, threads=1)
        leapray.isosurface(field, 0.0, capped=False, threads=1)
        smooth = leapray.isosurface(field, 0.0, interpolation="cubic", threads=1)
        leapray.Volume.unpack(smooth.pack())
        leapray.without_islands(field, 0.0, 4)
    leaf = np.zeros((2, 8, 8, 8), np.float32)
    leaf[:, 2:6, 2:6, 2:6] = 1
    origins, tile = np.array([(0, 0, 0), (8, 0, 0)], np.int32), np.array([(64, 0, 0)], np.int32)
    leaves = leapray.Leaves(origins, leaf, 0.0, tile, np.array([8], np.int32), np.ones(1))
    leapray.isosurface(leapray.ScalarGrid("leaves", leaves, np.eye(4)), 0.5, threads=1)
    leapray.labels(leapray.ScalarGrid("labels", np.uint8(rng.random((9, 9, 9)) < 0.5), np.eye(4)))


def seen():
    numbers = np.eye(9, dtype=np.int16).repeat(9).reshape(9, 9, 9)
    grid = leapray.ScalarGrid("field", numbers, np.eye(4))
    field = leapray.FieldSamples(grid, threads=1)
    for each in (field, grid):
        leapray.visible_volume(each, leapray.TransferFunction([0, 1], [0, 1]), threads=1)
    planes = (np.arange(9.0) ** 2,) * 3
    leapray.visible_volume(field, leapray.TransferFunction([0], [1]), planes=planes, threads=1)


def structures():
    far = np.zeros((40, 40, 40), np.uint8)
    far[3:9, 3:9, 3:9] = 255
    for volume in (leapray.Volume(far), voxelize(BALL, 0.25)):
        for entry in leapray.variants():
            leapray.build(volume, entry, threads=1)


def distances():
    cells = np.zeros((9, 9, 9), bool)
    cells[4, 4, 4] = True
    for metric in leapray.METRICS:
        leapray.distance(cells, metric, threads=1)


def images():
    view = leapray.Camera("orthographic", (0, 0, -50), (0, 0, 1), (-1, -1, 0), (3, 0, 0), (0, 3, 0))
    far = np.zeros((40, 40, 40), np.uint8)
    far[3:9, 3:9, 3:9] = 255
    volume = leapray.Volume(far)
    for entry in leapray.image_methods():
        prepared = leapray.prepare(volume, entry)
        if entry.lights:
            prepared.set_light(0, leapray.Light("point", (1, 1, 1), (50, 50, 50)))
        leapray.render_image(entry, prepared, view, 14, 13)
    leapray.prepare(voxelize(BOX, 0.2, attributes=colored(len(BOX[1]))), "discrete")


def a_scene():
    ball = leapray.build(voxelize(BALL, 0.4))
    at = np.eye(4)
    at[0, 3] = 3.0
    lights = [leapray.Light("point", (1, 1, 1), (k, 2, 0), radius=0.1) for k in range(3)]
    world = leapray.World((1, 1, 1), np.ones((4, 8, 3), np.float32))
    view = leapray.Camera("perspective", (0, 0, -5), (0, 0, 1), (-0.5, -0.5, 1), (0.1, 0, 0),
                          (0, 0.1, 0))  # fmt: skip
    cut = [leapray.Clip(ball.volume, at)]
    instances = [leapray.Instance(ball, m, 0, 1, clips=cut) for m in (np.eye(4), at)]
    look = leapray.TransferFunction([0, 1], [0, 1], scattering=[(0, 0, 0), (1, 1, 1)])
    grid = leapray.ScalarGrid("fog", np.ones((3, 3, 3), np.float32), np.eye(4))
    fog = leapray.build(leapray.visible_volume(grid, look, threads=1), threads=1)
    instances.append(leapray.Instance(fog, np.eye(4), anisotropy=0.5))
    leaf = leapray.build(voxelize(LEAF, 0.5, kind="sheet", exact="every", dtype="u8"))
    instances += [leapray.Instance(leaf, np.eye(4))] * 6  # overlapping trees
    material = leapray.Material([leapray.Lobe("diffuse", (1, 1, 1))])
    scene = leapray.Scene(view, instances, lights, [material], [0], world, False, [1])
    scene.render_tile(0, 0, 4, 4, samples=1)


SCENARIOS = (a_solid, a_sheet, trees_of_triangles, a_pierced_ball, a_large_mesh,
             a_doubled_crossing, two_islands, coverage, merged, sampled, fields, seen, structures,
             distances, images, a_scene)  # fmt: skip


# ---- runs --------------------------------------------------------------------------------------


def fail_each(scenario) -> tuple[set[str], set[str], int]:
    """Where the core refused, where it did without, and how many runs that took."""
    fail_at, failed, blocks = faults()
    fail_at(0)
    scenario()  # what is kept for good is there from now on
    gc.collect()
    refused, tolerated, before, n = set(), set(), blocks(), 0
    while True:
        n += 1
        fail_at(n)
        sentence = ""
        try:
            scenario()
        except leapray.OutOfMemory as error:
            sentence = check_sentence(error)
        place = failed().decode()
        fail_at(0)
        if blocks() != before:
            gc.collect()  # tracebacks hold what the frames held
        assert blocks() == before, f"{blocks() - before} blocks left by {place}"
        if not place:
            assert not sentence, sentence
            return refused, tolerated, n
        (refused if sentence else tolerated).add(place)


def faults():
    lib = _lib.lib
    lib.lr_test_fail_at.argtypes = [ctypes.c_int64]
    lib.lr_test_failed.restype = ctypes.c_char_p
    lib.lr_test_blocks.restype = ctypes.c_int64
    return lib.lr_test_fail_at, lib.lr_test_failed, lib.lr_test_blocks


def main(names: list[str]) -> int:
    refused, tolerated, runs = set(), set(), 0
    for scenario in SCENARIOS:
        if not names or scenario.__name__ in names:
            print(scenario.__name__, file=sys.stderr, flush=True)
            some, others, n = fail_each(scenario)
            refused, tolerated, runs = refused | some, tolerated | others, runs + n
    print(json.dumps({"refused": sorted(refused), "tolerated": sorted(tolerated), "runs": runs}))
    return 0


if __name__ == "__main__":
    code = []
    worker = threading.Thread(target=lambda: code.append(main(sys.argv[1:])))  # see _lib.apart
    worker.start()
    worker.join()
    sys.exit(code[0] if code else 1)
