# SPDX-License-Identifier: GPL-3.0-or-later
"""Claims about the layers that tell apart what one volume of a mesh cannot hold."""

import meshes
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import leapray
from leapray import LeapRayError, mesh_layers


def layers_of(*parts, margin=0.0):
    """The layer of each part of a joined mesh; fails where a part has several."""
    vertices, triangles = meshes.joined(*parts)
    layer = mesh_layers(vertices, triangles, margin)
    found, first = [], 0
    for _, t in parts:
        assert len(set(layer[first : first + len(t)])) == 1
        found.append(int(layer[first]))
        first += len(t)
    assert sorted(set(found)) == list(range(max(found) + 1))
    return found


def moved(mesh, by):
    return mesh[0] + by, mesh[1]


def turned(mesh):
    return mesh[0], mesh[1][:, ::-1]


def test_one_island_is_one_layer():
    for mesh in (meshes.torus(), meshes.leaf(), meshes.spiky(1)):
        assert layers_of(mesh) == [0]
    soup = meshes.torus()
    assert layers_of((soup[0][soup[1]].reshape(-1, 3), np.arange(soup[1].size).reshape(-1, 3))) == [
        0
    ]


def test_islands_apart_share_a_layer_and_crossing_ones_do_not():
    ball = meshes.icosphere(1)
    assert layers_of(ball, moved(ball, (3, 0, 0)), moved(ball, (6, 0, 0))) == [0, 0, 0]
    assert layers_of(ball, moved(ball, (3, 0, 0)), margin=1.5) in ([0, 1], [1, 0])
    a, b, c = layers_of(ball, moved(ball, (1, 0, 0)), moved(ball, (3.2, 0, 0)))
    assert a != b and b != c and a == c


def test_boxes_in_a_layer_keep_the_margin():
    rng = np.random.default_rng(4)
    lo = rng.uniform(0, 3, (60, 3))
    hi = lo + rng.uniform(0.1, 0.6, (60, 3))
    found = np.array(
        layers_of(*(meshes.box(*corners) for corners in zip(lo, hi, strict=True)), margin=0.05)
    )
    assert found.max() > 0
    for a, b in np.ndindex(60, 60):
        if a != b and found[a] == found[b]:
            assert (lo[a] > hi[b] + 0.05).any() or (hi[a] + 0.05 < lo[b]).any()


def test_open_and_closed_islands_never_share_a_layer():
    a, b, c, d = layers_of(
        meshes.box(),
        moved(meshes.leaf(), (9, 0, 0)),
        moved(meshes.icosphere(1), (20, 0, 0)),
        moved(meshes.plane(), (30, 0, 0)),
    )
    assert a == c and b == d and a != b


def test_a_cavity_stays_with_the_island_around_it():
    outer, inner = meshes.box((-3, -3, -3), (3, 3, 3)), meshes.box()
    assert layers_of(outer, turned(inner)) == [0, 0]
    assert len(set(layers_of(outer, inner))) == 2
    assert len(set(layers_of(outer, turned(moved(inner, (9, 0, 0)))))) == 2


def test_hundreds_of_islands_in_one_place_end_in_a_few_layers():
    rng = np.random.default_rng(1)
    found = layers_of(*(moved(meshes.box(), rng.uniform(-0.1, 0.1, 3)) for _ in range(200)))
    assert 10 < len(set(found)) < 50


def test_wrong_meshes_are_refused():
    vertices, triangles = meshes.box()
    for v, t in (
        (vertices * np.nan, triangles),
        (vertices, triangles + 9),
        (vertices, triangles[:0]),
    ):
        with pytest.raises(LeapRayError):
            mesh_layers(v, t)
    with pytest.raises(LeapRayError, match="margin"):
        mesh_layers(vertices, triangles, -1.0)


def test_islands_end_at_junctions_and_where_the_winding_flips():
    """Three half planes on one edge; a plane of which one half is turned."""

    def half(angle):
        v, t = meshes.plane(4)
        v[:, 1] += 0.5
        c, s = np.cos(angle), np.sin(angle)
        return v @ np.array([[1, 0, 0], [0, c, s], [0, -s, c]]), t

    assert len(set(layers_of(half(0.0), half(2.0), half(4.0)))) == 3
    vertices, triangles = meshes.plane(4)
    flipped = np.where(
        (vertices[triangles, 0].mean(axis=1) > 0)[:, None], triangles[:, ::-1], triangles
    )
    layer = mesh_layers(vertices, flipped)
    assert_array_equal(layer == layer[0], vertices[triangles, 0].mean(axis=1) < 0)
    assert layer.max() == 1


def test_triangles_without_area_get_no_layer_of_their_own():
    vertices, triangles = meshes.torus()
    line = np.array([[0.0, 0, 5], [0, 0, 6], [0, 0, 7]]), np.array([[0, 1, 2]])
    point = np.array([[0.0, 0, 5]]), np.array([[0, 0, 0]])
    assert layers_of((vertices, triangles), line, point) == [0, 0, 0]


def test_crossing_sheets_in_layers_are_hit_where_they_are():
    """In volumes of their own, and in one, where triangle cells hold what the samples cannot."""
    swap = np.array([[1, 0, 0], [0, 0, 1], [0, 1, 0]])  # y and z
    crossing = meshes.plane(3)[0] @ swap, meshes.plane(3)[1]
    vertices, triangles = meshes.joined(meshes.plane(4), crossing)
    layer = mesh_layers(vertices, triangles, 0.1)
    assert layer.max() == 1
    rng = np.random.default_rng(4)
    targets = rng.uniform(-0.4, 0.4, (3000, 3))
    targets[:1500, 2] = 0  # on the first plane
    targets[1500:, 1] = 0  # on the other
    origins = targets + rng.normal(size=(3000, 3))
    directions = targets - origins
    want = np.full(3000, np.inf)
    for axis in (2, 1):
        t = -origins[:, axis] / directions[:, axis]
        farthest = np.abs(origins + t[:, None] * directions).max(axis=1)
        want = np.where((t > 0) & (farthest <= 0.5) & (t < want), t, want)

    def first_hit(chosen):
        volume = leapray.voxelize(vertices, triangles[chosen], 0.02, dtype="f32")
        return leapray.trace(leapray.build(volume), origins, directions).t

    apart = np.minimum(first_hit(layer == 0), first_hit(layer == 1))
    # not beside a rim, where rounding decides
    hits = [np.abs(origins + t[:, None] * directions).max(axis=1) for t in (apart, want)]
    clear = np.max(hits, axis=0) < 0.46
    assert clear.sum() > 2000
    assert_allclose(apart[clear], want[clear], rtol=1e-5)
    together = first_hit(layer >= 0)
    assert_allclose(together[clear], want[clear], atol=1e-6)
