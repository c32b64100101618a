# SPDX-License-Identifier: GPL-3.0-or-later
"""Volumes of triangle cells alone: scenes meet their triangles by a tree, with the same hits."""

from __future__ import annotations

import ctypes
from pathlib import Path

import meshes
import numpy as np
import pytest
from stage import FAR, at, camera, centre_rays, one, render

import leapray
from leapray import Light, _abi
from tests import compiled

ROOT = Path(__file__).resolve().parents[2]
SIZE = 96, 96
SETS = [_abi.LR_SIMD_AVX2, _abi.LR_SIMD_AVX512]


def soup(n, seed):
    """Triangles of all sizes across each other."""
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-1, 1, (n, 1, 3)) + rng.normal(size=(n, 3, 3)) * rng.choice(
        [0.05, 0.3, 1.0], (n, 1, 1)
    )
    return corners.reshape(-1, 3), np.arange(3 * n, dtype=np.int32).reshape(n, 3)


BODIES = {
    **{f"{n} triangles": (soup(n, n), "sheet") for n in (1, 7, 8, 9, 60, 700)},
    "box in the lattice": (meshes.box((-0.6,) * 3, (0.6,) * 3), "solid"),
    "box": (meshes.box((-0.61, -0.53, -0.37), (0.71, 0.57, 0.83)), "solid"),
    "torus": (meshes.torus(), "solid"),
    "box round a box": (
        meshes.joined(meshes.box(), meshes.box((-0.5,) * 3, (0.5,) * 3)), "solid"
    ),
}  # fmt: skip


@pytest.mark.parametrize("body", BODIES)
def test_scenes_meet_what_the_walk_through_cells_meets_to_the_bit(body):
    mesh, kind = BODIES[body]
    volume = leapray.voxelize(*mesh, 0.2, kind=kind, exact="every")
    assert volume.info.n_triangle_cells == volume.info.n_surface_cells
    structure = leapray.build(volume)
    met = 0
    for eye in ((4, 0, 0), (2.5, -3, 1.7), (0.01, 0.02, 5), (0.13, 0.1, 0.07)):
        cam = camera(eye, (0.05, -0.03, -0.1), SIZE, 0.9)
        o, d = centre_rays(cam, SIZE)
        alone = leapray.trace(structure, o.reshape(-1, 3), d.reshape(-1, 3))
        got = render(cam, [one(structure)], size=SIZE)
        want = np.where(np.isfinite(alone.t), alone.t, FAR).astype(np.float32)
        np.testing.assert_array_equal(got["Depth"].reshape(-1), want)
        turned = np.where((alone.normal * d.reshape(-1, 3)).sum(-1) > 0, -1, 1)[:, None]
        np.testing.assert_array_equal(
            got["Normal"].reshape(-1, 3), (turned * alone.normal).astype(np.float32)
        )
        met += np.isfinite(alone.t).sum()
    assert met > 40


@pytest.mark.parametrize("body", ["60 triangles", "700 triangles", "torus"])
def test_hits_are_those_of_every_triangle_asked_in_turn(body):
    mesh, kind = BODIES[body]
    structure = leapray.build(leapray.voxelize(*mesh, 0.2, kind=kind, exact="every"))
    cam = camera((2.5, -3, 1.7), size=SIZE, width=0.9)
    o, d = (x.reshape(-1, 3) for x in centre_rays(cam, SIZE))
    t, *_ = meshes.brute_rays(o, d, *mesh)
    got = render(cam, [one(structure)], size=SIZE)["Depth"].reshape(-1)
    seen = np.isfinite(t)
    assert 0.1 < seen.mean() < 1
    np.testing.assert_array_equal(got < FAR, seen)
    np.testing.assert_allclose(got[seen], t[seen], rtol=1e-6)


def test_shadows_are_those_of_every_triangle_asked_in_turn():
    blocker = meshes.torus()
    floor = meshes.box((-2, -2, -1.5), (2, 2, -1.4))
    to_sun = np.array([0.3, 0.5, 0.7]) / np.linalg.norm([0.3, 0.5, 0.7])
    things = [
        one(leapray.build(leapray.voxelize(*mesh, 0.25, kind="solid", exact="every")))
        for mesh in (blocker, floor)
    ]
    cam = camera((0.01, 0, -1), (0, 0, -2), SIZE, 6.0, kind="orthographic")
    got = render(cam, things, [Light("sun", (1.0,) * 3, direction=to_sun)], size=SIZE)
    lit = got["Combined"][..., 0].reshape(-1) > 0
    points = got["Position"].reshape(-1, 3).astype(float)
    ground = np.abs(points[:, 2] + 1.4) < 1e-5
    t, *_ = meshes.brute_rays(points, np.broadcast_to(to_sun, points.shape), *blocker)
    assert 0.05 < np.isfinite(t[ground]).mean() < 0.95
    assert (lit == ~np.isfinite(t))[ground].mean() > 0.999  # positions are rounded to f32


@pytest.mark.parametrize("n", [2, 9, 30])
def test_instances_that_overlap_give_the_hits_of_the_nearest_to_the_bit(n):
    """Through each other, turned, of several sizes, some twice in one place: there the first
    counts, by its object index."""
    rng = np.random.default_rng(n)
    meant = [soup(300, 5), meshes.torus(), meshes.icosphere(2)]
    kinds = ["sheet", "solid", "solid"]
    shapes = [
        leapray.build(leapray.voxelize(*mesh, 0.2, kind=kind, exact="every"))
        for mesh, kind in zip(meant, kinds, strict=True)
    ]
    placed, counts = [], []
    for k in range(n):
        turned, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        matrix = at(*rng.normal(0, 0.7, 3))
        matrix[:3, :3] = turned * rng.choice([0.3, 0.5, 0.7])
        placed.append(one(shapes[k % 3], matrix, object_index=k + 1))
        if k % 4 == 0:
            placed.append(one(shapes[k % 3], matrix, object_index=n + k + 1))
    for eye in ((4, 0, 0), (2.5, -3, 1.7), (0.13, 0.1, 0.07)):
        cam = camera(eye, (0.05, -0.03, -0.1), SIZE, 0.9)
        got = render(cam, placed, size=SIZE)
        each = [render(cam, [single], size=SIZE) for single in placed]
        depth = np.array([one_alone["Depth"] for one_alone in each])
        first = depth.argmin(axis=0)
        counts.append(len(np.unique(first)))
        for name in ("Depth", "Normal", "Object Index"):
            alone = np.array([one_alone[name] for one_alone in each])
            want = np.take_along_axis(alone, first[None], axis=0)[0]
            np.testing.assert_array_equal(got[name], want)
    assert max(counts) > n / 2


# ---- instruction sets ----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def library(tmp_path_factory) -> ctypes.CDLL:
    core = [f"trace/triangle_tree_{kind}" for kind in ("portable", "avx2", "avx512")]
    core += ["base/cpu", "base/error", "base/pages", "trace/bvh", "trace/wide_nodes"]
    return compiled.library(tmp_path_factory.mktemp("tree"), "tree", core)


@pytest.mark.parametrize("simd", SETS)
def test_all_instruction_sets_and_narrow_blocks_give_the_same_bits(library, simd):
    if library.tree_simd() < simd:
        pytest.skip("the processor lacks it")
    rng, n, met = np.random.default_rng(2), 2000, 0

    def pointer(array):
        return array.ctypes.data_as(ctypes.c_void_p)

    for _ in range(20):
        corners = rng.uniform(-5, 5, (64, 1, 3)) + rng.normal(size=(64, 3, 3))
        corners[:8] = np.round(corners[:8])  # shared planes, rays through corners
        corners = corners.astype(np.float32).astype(float)
        voxel = 1.25 + rng.random()
        stored = corners * voxel + (np.arange(3) - 3.0)
        rays = np.concatenate([rng.uniform(-8, 8, (n, 3)), rng.normal(size=(n, 3))], axis=1)
        rays[: n // 4] = np.round(rays[: n // 4])
        rays = rays[rays[:, 3:].any(axis=1)]
        got = []
        for which in (_abi.LR_SIMD_PORTABLE, simd):
            for given, scale in ((stored, 0.0), (corners, voxel)):
                t, triangle, steps = np.zeros(len(rays)), *np.zeros((2, len(rays)), np.uint32)
                library.tree_run(which, pointer(given), ctypes.c_double(scale),
                                 ctypes.c_uint64(len(rays)), pointer(rays), pointer(t),
                                 pointer(triangle), pointer(steps))  # fmt: skip
                got.append((t, triangle, steps))
        for other in got[1:]:
            for one_set, the_other in zip(got[0], other, strict=True):
                np.testing.assert_array_equal(one_set, the_other)
        met += np.isfinite(got[0][0]).sum()
    assert met > 1000


# ---- boxes ---------------------------------------------------------------------------------------


def met_boxes(library, simd, boxes, rays, t_min, t_max):
    """How often each ray is given each box, and the number of nodes."""

    def pointer(array):
        return np.ascontiguousarray(array).ctypes.data_as(ctypes.c_void_p)

    met = np.zeros((len(rays), len(boxes)), np.uint8)
    n_nodes = library.tree_boxes(
        simd, len(boxes), pointer(boxes), ctypes.c_uint64(len(rays)), pointer(rays),
        pointer(t_min), pointer(t_max), pointer(met))  # fmt: skip
    assert n_nodes >= 0
    return met, n_nodes


def crossed(boxes, rays, t_min, t_max, wider):
    """[rays, boxes]: which boxes, larger by `wider`, each ray enters, in 80 bits."""
    o, d = (rays[:, None, part].astype(np.longdouble) for part in (slice(0, 3), slice(3, 6)))
    lo, hi = boxes[None, :, 0] - wider, boxes[None, :, 1] + wider
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = (lo - o) / d, (hi - o) / d
    still, within = d == 0, (o >= lo) & (o <= hi)
    near = np.where(still, np.where(within, -np.inf, np.inf), np.minimum(a, b)).max(axis=-1)
    far = np.where(still, np.where(within, np.inf, -np.inf), np.maximum(a, b)).min(axis=-1)
    return np.maximum(near, t_min[:, None]) <= np.minimum(far, t_max[:, None])


@pytest.mark.parametrize("n", [1, 2, 8, 9, 57, 700])
@pytest.mark.parametrize("far", [1.0, 1e4, 1e9])
def test_rays_are_given_every_box_that_they_cross_and_few_others(library, n, far):
    """Boxes of all sizes, some flat, some of one place; rays along axes, in faces, through corners,
    from afar, of any length of direction. No box is lost, and what is given beside them lies within
    what f32 does to the start."""
    rng = np.random.default_rng(n)
    centre = rng.uniform(-5, 5, (n, 3))
    half = rng.choice([0.0, 0.01, 0.5], (n, 3)) * rng.random((n, 3))
    boxes = np.stack([centre - half, centre + half], axis=1)
    boxes[: n // 4] = np.round(boxes[: n // 4])
    target = boxes[rng.integers(0, n, 800), 0] + rng.choice([0, 0, 0.3], (800, 3))
    d = rng.normal(size=(800, 3)) * rng.choice([0, 1, 1], (800, 3))
    d = d[d.any(axis=1)]
    target = target[: len(d)]
    o = target - d / np.linalg.norm(d, axis=1, keepdims=True) * far * rng.random((len(d), 1))
    scale = 10.0 ** rng.integers(-140, 140, (len(d), 1)).astype(float)
    rays = np.concatenate([o, d * scale], axis=1)
    reach = far / np.linalg.norm(rays[:, 3:], axis=1)
    t_min, t_max = reach * rng.choice([0, 0.2], len(d)), reach * rng.choice([0.5, 2, 1e9], len(d))
    for simd in (_abi.LR_SIMD_PORTABLE, *SETS):
        if library.tree_simd() < simd:
            continue
        met, n_nodes = met_boxes(library, simd, boxes, rays, t_min, t_max)
        assert met.max() <= 1
        assert (met[crossed(boxes, rays, t_min, t_max, 0)] == 1).all()
        # f32 keeps the start to 2^-22 of its distance; t to 2^-19, over the way from the start
        near = crossed(boxes, rays, t_min * (1 - 2e-6), t_max * (1 + 2e-6), far * 2**-18 + 1e-5)
        assert not met[~near].any()
        assert n_nodes <= max(n - 1, 1)


def test_a_ray_without_a_direction_or_a_number_meets_no_box(library):
    boxes = np.array([[[-1.0] * 3, [1.0] * 3]])
    rays = np.array([[0, 0, 0, 0, 0, 0], [np.nan, 0, 0, 1, 0, 0], [0, 0, 0, np.inf, 0, 0.0]])
    met, _ = met_boxes(library, 0, boxes, rays, np.zeros(3), np.full(3, np.inf))
    assert not met.any()


def test_rays_from_beyond_the_numbers_of_f32_meet_a_box(library):
    boxes = np.array([[[-1.0] * 3, [1.0] * 3]])
    for far in (1e30, 1e39, 1e300):
        rays = np.array([[far, 0, 0, -1, 0, 0], [0, -far, 0, 0, 3, 0], [far, 0, 0, 1, 0, 0]])
        met, _ = met_boxes(library, 0, boxes, rays, np.zeros(3), np.full(3, np.inf))
        assert met.ravel().tolist() == [1, 1, 0]
