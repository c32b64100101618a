# SPDX-License-Identifier: GPL-3.0-or-later
"""Sharp edges: cells that keep their triangles beside cells of the field, and no wrong pixel.

A ray that leaves a convex body meets nothing; so in a white world every pixel is white, if
no ray is scattered more often than the shape itself has it.
"""

from __future__ import annotations

import meshes
import numpy as np
import pytest
from stage import camera, one, unit

import leapray
from leapray import Light, Lobe, Material, World

WHITE = (1.0, 1.0, 1.0)
SIZE = (144, 96)
EYES = ((0.3, -4, 0.2), (2.2, -2.6, 1.9), (-2.5, -2, 2.6))
VOXEL = 0.06

ONCE = {  # what shows the white world if, and only if, every ray meets what it should
    "diffuse": (Lobe("diffuse", WHITE), dict(samples=16, diffuse_bounces=0)),
    "mirror": (Lobe("glossy", WHITE, roughness=0.0), dict(glossy_bounces=0)),
    "refraction": (Lobe("refraction", WHITE, ior=1.0), dict(transmission_bounces=1)),
    "transparent": (Lobe("transparent", WHITE), dict(transparent_bounces=1)),
}


def wedge(angle, half=0.6):
    """A prism along z over a triangle with this angle in degrees."""
    a = np.radians(angle)
    ring = [(-0.7, 0.0), (-0.7 + 1.4 * np.cos(a), 0.0), (-0.7 + 1.4 * np.cos(a), 1.4 * np.sin(a))]
    vertices = np.array([(*p, z) for z in (-half, half) for p in ring])
    sides = [(i, (i + 1) % 3, (i + 1) % 3 + 3) for i in range(3)]
    sides += [(i, (i + 1) % 3 + 3, i + 3) for i in range(3)]
    return vertices, np.array([(0, 2, 1), (3, 4, 5), *sides], np.int32)


def hollow(wall, inner=0.6):
    """A closed room whose walls are so thick."""
    room = meshes.box((-inner,) * 3, (inner,) * 3)
    return meshes.joined(
        meshes.box((-inner - wall,) * 3, (inner + wall,) * 3), (room[0], room[1][:, ::-1])
    )


BODIES = {
    "cube": meshes.box((-0.6,) * 3, (0.6,) * 3),
    "wedge of 20 degrees": wedge(20),
    "wedge of 45 degrees": wedge(45),
    "plate of 1.7 voxels": meshes.box((-0.7, -0.7, -0.05), (0.7, 0.7, 0.05)),
}
POSES = {  # seed of the rotation, shift
    "in the lattice": (None, (0.0, 0.0, 0.0)),
    "off the lattice": (None, (0.0131, 0.0272, 0.0389)),
    "turned": (4, (0.0, 0.0, 0.0)),
    "turned more": (7, (0.01, 0.02, 0.03)),
}


def posed(mesh, pose):
    seed, shift = POSES[pose]
    turn = np.eye(3)
    if seed is not None:
        turn, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
        turn *= np.sign(np.linalg.det(turn))
    return mesh[0] @ turn.T + np.array(shift), mesh[1]


def n_wrong(structure, lobe, setting, *, scale=1.0, at=(0.0, 0.0, 0.0)):
    """Pixels of three views that are not white."""
    matrix = np.diag([scale] * 3 + [1.0])
    matrix[:3, 3] = at
    wrong = 0
    for eye in EYES:
        cam = camera(np.array(eye) * scale + at, at, size=SIZE, width=0.5)
        things = [one(structure, matrix)]
        scene = leapray.Scene(cam, things, (), [Material([lobe])], [0], World(WHITE))
        got = scene.render_tile(0, 0, *SIZE, **({"samples": 4} | setting))
        assert 0.05 < (got["Depth"] < 1e9).mean() < 0.9
        wrong += int((np.abs(got["Combined"][..., :3] - 1) > 1e-6).any(-1).sum())
    return wrong


@pytest.mark.parametrize("pose", POSES)
@pytest.mark.parametrize("body", BODIES)
@pytest.mark.parametrize("exact", ["all", "every"])
def test_a_body_with_sharp_edges_has_no_wrong_pixel(exact, body, pose):
    volume = leapray.voxelize(*posed(BODIES[body], pose), VOXEL, kind="solid", exact=exact)
    info = volume.info
    assert 0 < info.n_triangle_cells <= info.n_surface_cells
    assert (info.n_triangle_cells == info.n_surface_cells) == (exact == "every")
    structure = leapray.build(volume)
    wrong = {name: n_wrong(structure, *thing) for name, thing in ONCE.items()}
    assert wrong == dict.fromkeys(ONCE, 0)


def beside_edges(mesh, n, seed=0):
    """Points (n, 3) on faces, within 1e-12 to 1e-4 voxel of an edge, and outward normals (n, 3)."""
    rng = np.random.default_rng(seed)
    turned = (rng.integers(3, size=(n, 1)) + np.arange(3)) % 3
    corner = mesh[0][mesh[1][rng.integers(len(mesh[1]), size=(n, 1)), turned]]
    along = corner[:, 1] - corner[:, 0]
    normal = np.cross(along, corner[:, 2] - corner[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    inward = np.cross(normal, along)
    inward *= (VOXEL * 10 ** rng.uniform(-12, -4, n) / np.linalg.norm(inward, axis=1))[:, None]
    return corner[:, 0] + rng.uniform(0.01, 0.99, (n, 1)) * along + inward, normal


@pytest.mark.parametrize("pose", POSES)
@pytest.mark.parametrize("body", BODIES)
def test_rays_that_start_beside_an_edge_keep_their_side(body, pose):
    """Half of the starts lie beyond their face, by up to half of what a start may be off."""
    mesh = posed(BODIES[body], pose)
    volume = leapray.voxelize(*mesh, VOXEL, kind="solid", exact="all")
    structure = leapray.build(volume)
    exact = volume.read_exact((-1, -1, -1), tuple(n + 2 for n in volume.info.size))
    rng = np.random.default_rng(1)
    points, normal = beside_edges(mesh, 60_000)
    seen = leapray.trace(structure, points + 3 * VOXEL * normal, -normal)
    on = np.isfinite(seen.t) & (np.abs(seen.t - 3 * VOXEL) < 1e-9 * VOXEL)
    i, j, k = seen.cell.T + 1
    on &= exact[np.where(on, k, 0), np.where(on, j, 0), np.where(on, i, 0)].astype(bool)
    points, normal, cell = points[on], normal[on], seen.cell[on]
    assert len(points) > 30_000
    points += VOXEL * rng.uniform(-5e-7, 5e-7, (len(points), 1)) * normal
    slope = 10 ** rng.uniform(-4, 0, (len(points), 1))
    d = rng.normal(size=points.shape)
    d += (slope * np.linalg.norm(d, axis=1, keepdims=True) - (d * normal).sum(1)[:, None]) * normal
    for side in (-1, 1):
        sides = np.full(len(points), side)
        hits = leapray.trace(structure, points, -side * d, start=(cell, sides))
        assert np.isfinite(hits.t).sum() == (len(points) if side > 0 else 0)


@pytest.mark.slow
@pytest.mark.parametrize("at", [(0.0, 0.0, 0.0), (1000.0, -700.0, 300.0)])
@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_edges_have_no_wrong_pixel_at_any_unit_and_far_away(scale, at):
    cube = posed(BODIES["cube"], "turned more")
    structure = leapray.build(leapray.voxelize(*cube, VOXEL, kind="solid", exact="all"))
    wrong = {
        name: n_wrong(structure, *t, scale=scale, at=np.array(at) * scale)
        for name, t in ONCE.items()
    }
    assert wrong == dict.fromkeys(ONCE, 0)


@pytest.mark.parametrize("pose", POSES)
@pytest.mark.parametrize("wall", [0.3, 1.0, 3.0])
def test_no_light_comes_through_walls_that_keep_their_triangles(wall, pose):
    """Walls from a third of a voxel on, in glaring light, seen from within."""
    volume = leapray.voxelize(*posed(hollow(wall * VOXEL), pose), VOXEL, exact="all")
    lights = [
        Light("sun", (1e3,) * 3, direction=unit(0.3, 0.5, 0.7), angle=0.2),
        Light("point", (1e3,) * 3, position=(2.0, 2.0, 2.0)),
    ]
    cam = camera((0.3, -0.4, 0.2), size=SIZE, width=1.6)
    white = Material([Lobe("diffuse", (0.8, 0.8, 0.8))])
    room = [one(leapray.build(volume))]
    scene = leapray.Scene(cam, room, lights, [white], [0], World((10.0, 10.0, 10.0)))
    got = scene.render_tile(0, 0, *SIZE, samples=4, diffuse_bounces=4, branches=4)
    assert (got["Depth"] < 1e9).all()
    assert not got["Combined"][..., :3].any()
