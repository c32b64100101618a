# SPDX-License-Identifier: GPL-3.0-or-later
"""Claims about inside and outside, against winding numbers summed in f64 over all triangles."""

import meshes
import numpy as np
import pytest
from meshes import brute_distance, positions, winding
from numpy.testing import assert_allclose, assert_array_equal

from leapray.voxelization import voxelize

MOST_WRONG = 1e-3  # fraction of the band


def blob(holes=0, levels=4):
    """A bumpy ball with holes of one triangle each."""
    vertices, triangles = meshes.icosphere(levels)
    bumps = np.sin(5 * vertices).prod(axis=1)
    at = np.random.default_rng(4).permutation(len(triangles))[:holes]
    return vertices * (1 + 0.2 * bumps)[:, None], np.delete(triangles, at, axis=0)


def twisted():
    """A closed torus whose tube is so thick that it runs through itself."""
    return meshes.torus(40, 20, major=0.5, minor=0.8)


def suzanne():
    """Blender's monkey: eyes in sockets, ears that cross the head, open and crossing itself."""
    bpy = pytest.importorskip("bpy")
    bmesh = pytest.importorskip("bmesh")
    mesh, data = bmesh.new(), bpy.data.meshes.new("suzanne")
    bmesh.ops.create_monkey(mesh)
    bmesh.ops.triangulate(mesh, faces=mesh.faces[:])
    mesh.to_mesh(data)
    mesh.free()
    vertices = np.array([v.co[:] for v in data.vertices], np.float64)
    triangles = np.array([p.vertices[:] for p in data.polygons], np.int32)
    bpy.data.meshes.remove(data)
    return vertices, triangles


BALL = meshes.icosphere(3)
CROSSING = {
    "two balls": meshes.joined(BALL, meshes.icosphere(3, 0.8, (0.9, 0.2, 0.1))),
    "ball in a ball": meshes.joined(BALL, meshes.icosphere(2, 0.7, (0.1, 0, 0))),
    "many shells": meshes.joined(
        *(meshes.icosphere(2, 0.5, c) for c in np.random.default_rng(2).uniform(-1, 1, (12, 3)))
    ),
    "itself": twisted(),
    "boxes": meshes.joined(meshes.box(), meshes.box((-0.5, -0.4, 0.1), (1.7, 0.3, 1.4))),
}
OPEN = {
    "few holes": (blob(5), "solid"),
    "many holes": (blob(40), "solid"),
    "three at an edge": (
        meshes.joined(meshes.box(), (meshes.box()[0][[0, 1, 2]] * 0.7, [[0, 1, 2]])),
        "solid",
    ),
}


def wrong(volume, vertices, triangles, n=3000, closed=True):
    """Share of the samples in the band on the wrong side of the winding number.

    What closes the holes of a mesh that is not closed may be nearer than its triangles.
    """
    g = volume.read()
    band = np.argwhere((g > 0) & (g < 1))
    at = tuple(np.random.default_rng(1).permutation(band)[:n].T)
    points = positions(volume)[at]
    inside = np.abs(winding(points, vertices, triangles)) > 0.5
    assert 0.1 < inside.mean() < 0.9
    d, _ = brute_distance(points, vertices, triangles)
    h = volume.info.object_from_index[0, 0]
    off = np.abs(g[at] - 0.5) * 5 - d / h
    assert off.max() < 1e-4 and (np.abs(off) > 1e-4).mean() <= (0 if closed else 0.05)
    return ((g[at] >= 0.5) != inside).mean()


@pytest.mark.parametrize("name", CROSSING)
def test_shells_that_cross_are_one_solid(name):
    vertices, triangles = CROSSING[name]
    volume = voxelize(vertices, triangles, 0.061, dtype="f32")
    assert volume.info.kind == "solid" and volume.mesh_info.winding
    assert not volume.mesh_info.obvious and "cross" in volume.mesh_info.why
    assert wrong(volume, vertices, triangles) <= MOST_WRONG


@pytest.mark.parametrize("name", OPEN)
def test_solids_with_holes_are_closed_by_the_winding_number(name):
    (vertices, triangles), kind = OPEN[name]
    volume = voxelize(vertices, triangles, 0.061, dtype="f32", kind=kind)
    assert volume.info.kind == "solid" and volume.mesh_info.winding
    assert wrong(volume, vertices, triangles, closed=False) <= MOST_WRONG


@pytest.mark.parametrize("around", [None, 3])
@pytest.mark.parametrize("h", [0.061, 0.1])
def test_a_half_ball_that_is_to_be_solid_ends_where_it_winds_half_around(h, around):
    vertices, triangles = meshes.half_sphere()
    if around is not None:
        q, _ = np.linalg.qr(np.random.default_rng(around).normal(size=(3, 3)))
        vertices = vertices @ (q * np.sign(np.linalg.det(q))).T
    volume = voxelize(vertices, triangles, h, dtype="f32", kind="solid")
    g, places = volume.read(), positions(volume)
    assert volume.info.kind == "solid" and volume.mesh_info.winding
    number = np.abs(winding(places.reshape(-1, 3), vertices, triangles)).reshape(g.shape)
    doubtful = np.abs(number - 0.5) < 1e-3
    assert doubtful.mean() < 0.01
    wrong = ((g >= 0.5) != (number > 0.5)) & ~doubtful
    band = (g > 0) & (g < 1)
    assert wrong[band].mean() <= 2e-3 and wrong.mean() <= 1e-3
    # What closes it is smooth: the surface between samples lies where the number is 1/2.
    across = (g[:, :, 1:] >= 0.5) != (g[:, :, :-1] >= 0.5)
    fraction = (0.5 - g[:, :, :-1][across]) / (g[:, :, 1:] - g[:, :, :-1])[across]
    at = places[:, :, :-1][across] + fraction[:, None] * (h, 0, 0)
    distance, _ = brute_distance(at, vertices, triangles)
    filled = at[distance > 3 * h]
    if around is not None:
        assert len(filled) > 10
        assert_allclose(np.abs(winding(filled, vertices, triangles)), 0.5, atol=0.05 * h)


def test_holes_that_nobody_sees_leave_a_solid():
    vertices, triangles = blob(5)
    for h, kind in ((0.3, "solid"), (0.04, "sheet")):
        volume = voxelize(vertices, triangles, h)
        assert volume.info.kind == kind
        assert (volume.mesh_info.hole > 0.5) == (kind == "sheet")
    assert not voxelize(vertices, triangles, 0.3).mesh_info.obvious


def test_suzanne_is_a_sheet_by_herself_and_a_solid_if_asked():
    vertices, triangles = suzanne()
    sheet = voxelize(vertices, triangles, 0.04, dtype="f32")
    assert sheet.info.kind == "sheet" and "holes" in sheet.mesh_info.why
    solid = voxelize(vertices, triangles, 0.04, dtype="f32", kind="solid")
    assert wrong(solid, vertices, triangles, closed=False) <= MOST_WRONG


def test_a_shell_inside_a_solid_is_no_surface():
    """Its distances stay in the samples beside it, but none is below the threshold."""
    vertices, triangles = meshes.joined(
        meshes.icosphere(3, 4.0), meshes.icosphere(3, 1.5, (0.5, 0, 0))
    )
    volume = voxelize(vertices, triangles, 0.1)
    g, points = volume.read(), positions(volume)
    radius = np.linalg.norm(points, axis=-1)
    assert (g[radius < 3.9] > 32767).all() and not (g[radius > 4.05] > 32767).any()
    shell = np.abs(np.linalg.norm(points - [0.5, 0, 0], axis=-1) - 1.5) < 0.3
    assert_array_equal(g[(radius < 3.6) & ~shell], 65535)
    surface = volume.read_surface()
    assert not surface[(radius < 3.6)].any() and surface.sum() > 1000


@pytest.mark.parametrize("h", np.linspace(0.05, 0.11, 13))
def test_a_box_inside_a_box_is_no_surface_wherever_the_bricks_lie(h):
    """Its samples agree about the inner box; they disagree beyond the band, or at bricks' faces."""
    mesh = meshes.joined(meshes.box(), meshes.box((-0.5, -0.3, -0.2), (0.4, 0.3, 0.2)))
    volume = voxelize(*mesh, h, dtype="f32")
    deep = np.abs(positions(volume)).max(axis=-1) < 1
    assert volume.mesh_info.winding
    assert volume.read()[deep].min() >= 0.5


@pytest.mark.parametrize("name", ["two balls", "ball in a ball"])
def test_the_winding_of_all_shells_may_be_turned(name):
    vertices, triangles = CROSSING[name]
    volume = voxelize(vertices, triangles, 0.1, dtype="f32")
    turned = voxelize(vertices, triangles[:, ::-1], 0.1, dtype="f32")
    assert_allclose(turned.read(), volume.read(), atol=2e-6)


def test_shells_that_do_not_cross_keep_their_pseudonormals():
    for name, mesh in {"ball": BALL, "torus": meshes.torus(), "spiky": meshes.spiky(3)}.items():
        info = voxelize(*mesh, 0.07).mesh_info
        assert not info.winding and info.obvious, name
    cavity = meshes.joined(BALL, (BALL[0] * 0.5, BALL[1][:, ::-1]))
    volume = voxelize(*cavity, 0.07)
    assert not volume.mesh_info.winding
    assert volume.sample([[0.0, 0, 0]])[0][0] == 0 and volume.sample([[0, 0, 0.75]])[0][0] == 1


def test_what_encloses_nothing_is_a_sheet():
    """Faces that are there twice, a little apart, have no open edge that edges would count."""
    vertices, triangles = meshes.plane(8)
    back = (vertices + np.array([0, 0, 1e-3]), triangles[:, ::-1])
    volume = voxelize(*meshes.joined((vertices, triangles), back), 0.9)
    assert volume.info.kind == "sheet"
    flipped = BALL[1].copy()
    flipped[::7] = flipped[::7, ::-1]
    info = voxelize(BALL[0], flipped, 0.1).mesh_info
    assert "winding" in info.why and not info.obvious


def test_the_number_of_threads_does_not_matter_to_crossing_shells():
    vertices, triangles = CROSSING["many shells"]
    one, two = (voxelize(vertices, triangles, 0.04, threads=n) for n in (1, 2))
    assert_array_equal(one.read(), two.read())
