# SPDX-License-Identifier: GPL-3.0-or-later
"""The benchmarks: a fixed set, each by a name of words, set up once and run many times.

A run takes a fraction of a second and one thread. Traversers come from the registry of the core
that is measured. What is new here may use what older cores do not have: they leave it out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial

import numpy as np

import leapray

from . import inputs

PHANTOMS = (  # spheres along a side, samples along a side, sample type
    (1, 128, "u8"),
    (3, 128, "u8"),
    (5, 128, "u8"),
    (10, 128, "u8"),
    (5, 512, "u8"),
    (5, 512, "u16"),
)
MODES = {"surface": "surface", "cell": "binary"}  # by their words: with the normal; first cell
IMAGE = 250  # pixels along a side of what rays see, as in the survey
SCENE = 96  # pixels along a side of scenes' tiles
VOXEL = 1 / 64  # of the mesh, which is 2.8 wide
IDENTITY = np.eye(4)

Run = Callable[[], object]


@dataclass(frozen=True)
class Benchmark:
    """name: words; rays: that one run traces, 0 where it traces none; set_up: makes the run."""

    name: str
    rays: int
    set_up: Callable[[], Run]


def all_benchmarks() -> list[Benchmark]:
    """All, in their order."""
    found = [
        Benchmark(
            f"spheres {n} {size} {dtype} {word} {entry.name}",
            IMAGE**2,
            partial(phantom_rays, (n, size, dtype), mode, entry.name),
        )
        for n, size, dtype in PHANTOMS
        for word, mode in MODES.items()
        for entry in leapray.traversers()
        if entry.exact or entry.default
    ]
    return [
        *found,
        Benchmark("mesh voxelize", 0, mesh_voxelized),
        Benchmark("mesh build", 0, mesh_built),
        Benchmark("mesh surface", IMAGE**2, mesh_rays),
        Benchmark("scene triangles", 0, triangle_scene),
        Benchmark("scene paths", 0, path_scene),
        Benchmark("volume integrate", IMAGE**2, volume_rays),
    ]


# ---- phantoms ------------------------------------------------------------


@cache
def phantom(n: int, size: int, dtype: str) -> leapray.Volume:
    """The volume of n^3 spheres."""
    samples = inputs.spheres(size, n)
    return leapray.Volume(samples if dtype == "u8" else samples.astype(np.uint16) * 257)


@cache
def structure_of(at: tuple[int, int, str], traverser: str) -> leapray.Structure:
    """One structure for all modes."""
    return leapray.build(phantom(*at), traverser)


def phantom_rays(at: tuple[int, int, str], mode: str, traverser: str) -> Run:
    """Rays of an oblique parallel camera through a phantom."""
    structure = structure_of(at, traverser)
    origins, directions = inputs.parallel_rays(np.zeros(3), np.full(3, at[1] - 1), IMAGE)
    return lambda: leapray.trace(structure, origins, directions, mode=mode, count=False)


# ---- meshes --------------------------------------------------------------


@cache
def mesh_volume(exact: str) -> leapray.Volume:
    """The volume of the mesh; exact: which cells keep triangles, as of `leapray.voxelize`."""
    return leapray.voxelize(*inputs.knobbly_torus(), VOXEL, exact=exact, threads=1)


def mesh_voxelized() -> Run:
    """Some 100,000 triangles to samples."""
    vertices, triangles = inputs.knobbly_torus()
    return lambda: leapray.voxelize(vertices, triangles, VOXEL, threads=1)


def mesh_built() -> Run:
    """The default traverser's structure of the mesh's volume."""
    volume = mesh_volume("sheets")
    return lambda: leapray.build(volume, threads=1)


def mesh_rays() -> Run:
    """Rays through the mesh's volume by the default traverser."""
    structure = leapray.build(mesh_volume("sheets"))
    vertices, _ = inputs.knobbly_torus()
    origins, directions = inputs.parallel_rays(vertices.min(axis=0), vertices.max(axis=0), IMAGE)
    return lambda: leapray.trace(structure, origins, directions, count=False)


# ---- scenes --------------------------------------------------------------


def camera(eye: tuple[float, float, float], width: float) -> leapray.Camera:
    """A perspective camera that looks at the origin; width: of the film at depth 1."""
    forward = -np.array(eye) / np.linalg.norm(eye)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right *= width / SCENE / np.linalg.norm(right)
    up = np.cross(right, forward)
    corner = forward - SCENE / 2 * (right + up)
    return leapray.Camera("perspective", np.array(eye), forward, corner, right, up)


def tile_of(scene: leapray.Scene, samples: int, bounces: int) -> Run:
    """One tile of a scene, again and again in the same memory."""
    workspace = scene.workspace(SCENE, SCENE)
    return lambda: scene.render_tile(
        *(0, 0, SCENE, SCENE),
        samples=samples,
        workspace=workspace,
        max_bounces=bounces,
        diffuse_bounces=bounces,
    )


def triangle_scene() -> Run:
    """A mesh whose cells all keep triangles, seen directly: 4 camera rays and a shadow ray each."""
    structure = leapray.build(mesh_volume("every"))
    sun = leapray.Light("sun", (1.0, 1.0, 1.0), direction=(0.48, 0.6, 0.64))
    scene = leapray.Scene(
        camera((2.2, -2.6, 2.1), 0.7),
        [leapray.Instance(structure, IDENTITY)],
        [sun],
        [leapray.Material.diffuse((0.8, 0.8, 0.8))],
        [0],
    )
    return tile_of(scene, samples=4, bounces=0)


def path_scene() -> Run:
    """Balls of three materials on a floor under an area light and a sky, by paths."""
    samples = inputs.ball()
    placed = np.diag([2 / len(samples)] * 3 + [1.0])
    placed[:3, 3] = -1.0
    sphere = leapray.build(leapray.Volume(samples, object_from_index=placed))
    rows = np.zeros((12, 65, 65), np.uint8)
    rows[:9] = 255
    floor_from_index = np.diag([0.125, 0.125, 0.125, 1.0])
    floor_from_index[:3, 3] = -4.0, -4.0, -1.0 - 8.5 * 0.125
    floor = leapray.build(leapray.Volume(rows, object_from_index=floor_from_index))
    materials = [
        leapray.Material.diffuse((0.7, 0.7, 0.7)),
        leapray.Material((leapray.Lobe("principled", (0.8, 0.3, 0.2), roughness=0.4),)),
        leapray.Material((leapray.Lobe("glass", (1.0, 1.0, 1.0), ior=1.45),)),
        leapray.Material((leapray.Lobe("glossy", (0.9, 0.8, 0.5), roughness=0.2),)),
    ]
    instances = [leapray.Instance(floor, IDENTITY, first_material=0)]
    for number, x in enumerate((-1.9, 0.0, 1.9), 1):
        moved = np.eye(4)
        moved[0, 3] = x
        instances.append(leapray.Instance(sphere, moved, first_material=number))
    lamp = leapray.Light(
        "area",
        (20.0, 20.0, 20.0),
        position=(1.0, -1.0, 4.0),
        direction=(0.0, 0.0, -1.0),
        axis_u=(1.0, 0.0, 0.0),
        axis_v=(0.0, 1.0, 0.0),
        shape="rectangle",
    )
    view = camera((0.0, -6.0, 2.5), 1.0)
    world = leapray.World((0.3, 0.35, 0.4))
    scene = leapray.Scene(view, instances, [lamp], materials, range(4), world)
    return tile_of(scene, samples=4, bounces=6)


# ---- volume rendering ----------------------------------------------------


def volume_rays() -> Run:
    """Emission and absorption along rays through a fog, by the default traverser."""
    density = inputs.fog()
    transfer = leapray.TransferFunction(
        [0.02, 0.3, 1.0], [0.0, 0.05, 0.4], [(0.2, 0.4, 0.9), (0.9, 0.8, 0.7), (1.0, 1.0, 1.0)]
    )
    field = leapray.ScalarGrid("fog", density, np.eye(4))
    structure = leapray.build(leapray.visible_volume(field, transfer, threads=1))
    end = np.full(3, len(density) - 1)
    origins, directions = inputs.parallel_rays(np.zeros(3), end, IMAGE)
    return lambda: leapray.trace(structure, origins, directions, mode="volume", count=False)
