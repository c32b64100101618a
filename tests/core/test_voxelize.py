# SPDX-License-Identifier: GPL-3.0-or-later
"""Claims about voxelization, against f64 brute force in numpy and analytic shapes."""

import meshes
import numpy as np
import pytest
from meshes import brute_distance, positions, winding
from numpy.testing import assert_allclose, assert_array_equal

import leapray
from leapray import LeapRayError, OutOfMemory, voxelization
from leapray.formats.vdb import openvdb_module
from leapray.voxelization import voxelize

TURN = np.linalg.qr(np.random.default_rng(7).normal(size=(3, 3)))[0]
CLOSED = {
    "large": (meshes.spiky(5, levels=1)[0] * [9, 1, 1] @ TURN, meshes.spiky(5, levels=1)[1]),
    "icosphere": meshes.icosphere(2),
    "torus": meshes.torus(30, 15),
    "box": meshes.box(),
    "spiky": meshes.spiky(1),
    "spikier": meshes.spiky(2, levels=3),
}
OPEN = {
    "plane": meshes.plane(),
    "aligned": meshes.plane(4),
    "tilted": meshes.plane(3, tilt=0.6),
    "half sphere": meshes.half_sphere(),
    "leaf": meshes.leaf(),
}


def near_samples(volume, limit, n=2000, seed=0):
    """Up to n samples whose stored distance is below limit voxels: indices (n, 3) z y x, points."""
    width = voxelization.filter_info("ramp", volume.info.dtype).half_width
    s = (volume.read() - 0.5) * 2 * width
    at = np.argwhere(np.abs(s) < min(limit, width - 1e-6))
    at = np.random.default_rng(seed).permutation(at)[:n]
    return at, positions(volume)[tuple(at.T)], s[tuple(at.T)]


@pytest.mark.parametrize("name", CLOSED)
def test_distances_of_closed_meshes_are_those_of_brute_force(name):
    vertices, triangles = CLOSED[name]
    h = 0.061
    volume = voxelize(vertices, triangles, h, dtype="f32")
    at, points, s = near_samples(volume, 2.5)
    assert len(at) > 1000
    d, _ = brute_distance(points, vertices, triangles)
    assert_allclose(np.abs(s), d / h, atol=1e-5, rtol=0)  # f32 steps of the ramp are 3e-7


@pytest.mark.parametrize("name", CLOSED)
def test_closed_meshes_are_the_clamped_ramp_everywhere(name):
    """Also beyond the band; the side is that of the winding number."""
    vertices, triangles = CLOSED[name]
    h = 0.083
    volume = voxelize(vertices, triangles, h, dtype="f32")
    some = np.random.default_rng(5).permutation(volume.read().size)[:4000]
    points = positions(volume).reshape(-1, 3)[some]
    d, _ = brute_distance(points, vertices, triangles)
    inside = winding(points, vertices, triangles) > 0.5
    assert 0.03 < inside.mean() < 0.9
    want = np.clip(0.5 + np.where(inside, d, -d) / h / 5.0, 0, 1)
    assert_allclose(volume.read().ravel()[some], want, atol=2e-6, rtol=0)
    assert volume.read()[[0, -1]].max() == 0


@pytest.mark.parametrize(("dtype", "most"), [("u8", 255), ("u16", 65535)])
def test_integers_are_the_rounded_ramp(dtype, most):
    vertices, triangles = meshes.torus()
    width = voxelization.filter_info("ramp", dtype).half_width
    exact = voxelize(vertices, triangles, 0.07, dtype="f32", half_width=width)
    rounded = voxelize(vertices, triangles, 0.07, dtype=dtype)
    assert np.abs(rounded.read() - exact.read().astype(float) * most).max() <= 0.5 + most * 1e-7


def test_the_lattice_lies_on_multiples_of_the_voxel_size():
    vertices, triangles = meshes.icosphere(1, centre=(0.3, -7.1, 100.0))
    volume = voxelize(vertices, triangles, 0.125)
    m = volume.info.object_from_index
    assert_array_equal(m[:3, :3], 0.125 * np.eye(3))
    assert_array_equal(m[:3, 3] % 0.125, 0)
    far = positions(volume)
    assert (far[0, 0, 0] <= vertices.min(axis=0) - 4 * 0.125).all()
    assert (far[-1, -1, -1] >= vertices.max(axis=0) + 4 * 0.125).all()


def test_a_mesh_wound_inside_out_is_turned():
    vertices, triangles = meshes.torus()
    volume = voxelize(vertices, triangles, 0.1)
    turned = voxelize(vertices, triangles[:, ::-1], 0.1)
    assert turned.mesh_info.inverted and not volume.mesh_info.inverted
    step = turned.read().astype(int) - volume.read()  # heights in f32 are rounded otherwise
    assert np.abs(step).max() <= 1


def test_ids_are_those_of_the_nearest_triangle():
    vertices, triangles = meshes.icosphere(2)
    ids = np.random.default_rng(3).integers(0, 65536, len(triangles))
    volume = voxelize(vertices, triangles, 0.061, ids=ids, dtype="f32")
    at, points, _ = near_samples(volume, 2.4, n=1500)
    best, which = brute_distance(points, vertices, triangles)
    got = volume.read_ids()[tuple(at.T)]
    differ = np.flatnonzero(got != ids[which])
    for i in differ:  # only where another triangle is as near
        same = [
            brute_distance(points[i : i + 1], vertices, triangles[[t]])[0][0]
            for t in np.flatnonzero(ids == got[i])
        ]
        assert min(same) - best[i] < 1e-7
    assert len(differ) < len(at) / 2


# ---- sheets ------------------------------------------------------------------


def overlaps(cells, triangle, grow):
    """Does the triangle meet the unit cubes at cells (n, 3), grown by grow? Clipping, not axes."""
    hit = np.zeros(len(cells), bool)
    for n, cell in enumerate(cells):
        polygon = list(triangle)
        for a in range(3):
            for sign, bound in ((1, cell[a] + 1 + grow), (-1, -(cell[a] - grow))):
                kept = []
                for p, q in zip(polygon, polygon[1:] + polygon[:1], strict=True):
                    fp, fq = sign * p[a] - bound, sign * q[a] - bound
                    if fp <= 0:
                        kept.append(p)
                    if fp * fq < 0:
                        kept.append(p + (q - p) * fp / (fp - fq))
                polygon = kept
                if not polygon:
                    break
            if not polygon:
                break
        hit[n] = bool(polygon)
    return hit


def touched_cells(volume, vertices, triangles, grow):
    """Cells (nz, ny, nx) that triangles meet, by clipping."""
    nx, ny, nz = volume.info.size
    m = volume.info.object_from_index
    touched = np.zeros((nz, ny, nx), bool)
    for triangle in (vertices[triangles] - m[:3, 3]) / m[0, 0]:
        lo = np.floor(triangle.min(axis=0) - grow).astype(int) - 1
        hi = np.floor(triangle.max(axis=0) + grow).astype(int) + 1
        i, j, k = (x.ravel() for x in np.meshgrid(*(np.arange(a, b) for a, b in zip(lo, hi))))  # noqa: B905
        cells = np.stack([i, j, k], 1)
        met = cells[overlaps(cells, triangle, grow)]
        touched[met[:, 2], met[:, 1], met[:, 0]] = True
    return touched


@pytest.mark.parametrize("name", OPEN)
def test_sheets_live_in_the_cells_that_triangles_meet(name):
    vertices, triangles = OPEN[name]
    size = 0.125 if name == "aligned" else 0.117
    volume = voxelize(vertices, triangles, size, exact="none")
    assert volume.info.kind == "sheet"
    surface = volume.read_surface()
    least = touched_cells(volume, vertices, triangles, 0.0)
    most = touched_cells(volume, vertices, triangles, 2.1e-4)
    g = np.pad(volume.read().astype(float), ((0, 1),) * 3)
    corners = [
        g[k : k - 1 or None, j : j - 1 or None, i : i - 1 or None][
            : g.shape[0] - 1, : g.shape[1] - 1, : g.shape[2] - 1
        ]
        for k in (0, 1)
        for j in (0, 1)
        for i in (0, 1)
    ]
    crossed = (np.min(corners, axis=0) < 32767.5) & (np.max(corners, axis=0) >= 32767.5)
    assert surface.sum() > 50
    assert not (surface & ~most).any()
    assert not (least & crossed & ~surface).any()


def test_a_sheet_is_the_signed_distance_to_its_local_side():
    vertices, triangles = OPEN["half sphere"]
    h = 0.117
    volume = voxelize(vertices, triangles, h, dtype="f32")
    _, points, s = near_samples(volume, 2.5)
    above = points[:, 2] > 3 * h  # away from the rim
    d, _ = brute_distance(points[above], vertices, triangles)
    assert_allclose(np.abs(s[above]), d / h, atol=1e-5, rtol=0)
    outside = np.linalg.norm(points, axis=1) > 1
    assert (above & outside).sum() > 100
    assert_array_equal(s[above & outside] < 0, True)
    assert_array_equal(s[above & (np.linalg.norm(points, axis=1) < 0.95)] > 0, True)


@pytest.mark.parametrize("name", ["aligned", "tilted"])
def test_the_field_of_a_plane_runs_on_straight_beyond_its_rim(name):
    """So the gradient, and the normal, are right up to the rim."""
    vertices, triangles = OPEN[name]
    h = 0.1171875 / 2 if name == "aligned" else 0.05
    volume = voxelize(vertices, triangles, h, dtype="f32")
    normal = np.cross(*(vertices[triangles[0, [1, 2]]] - vertices[triangles[0, 0]]))
    normal /= np.linalg.norm(normal)
    points = positions(volume).reshape(-1, 3)
    d, _ = brute_distance(points, vertices, triangles)
    near = d < 2.44 * h
    want = 0.5 - points[near] @ normal / h / 5
    assert_allclose(volume.read().ravel()[near], want, atol=1e-6, rtol=0)
    k, j, i = np.argwhere(volume.read_surface()).T
    hit = np.stack([i, j, k], 1) * h + volume.info.object_from_index[:3, 3] + h / 2
    _, gradient = volume.sample(hit)
    gradient /= -np.linalg.norm(gradient, axis=1, keepdims=True)
    assert_allclose(gradient, np.broadcast_to(normal, gradient.shape), atol=1e-5)


def test_rims_reach_at_most_to_the_end_of_their_cell():
    vertices, triangles = OPEN["tilted"]
    h = 0.117
    volume = voxelize(vertices, triangles, h, exact="none")
    cells = np.argwhere(volume.read_surface())[:, ::-1]
    m = volume.info.object_from_index
    centres = (cells + 0.5) * h + m[:3, 3]
    d, _ = brute_distance(centres, vertices, triangles)
    assert d.max() <= (np.sqrt(3) / 2 + 2e-4) * h


def test_stencils_of_a_sheet_are_exact_with_a_narrow_ramp():
    """Central differences read sqrt(6) from the surface: values there are those of the ramp."""
    vertices, triangles = OPEN["tilted"]
    h = 0.117
    volume = voxelize(vertices, triangles, h, dtype="f32", half_width=2.0)
    z, y, x = np.argwhere(volume.read_surface()).T
    around = [np.stack([x + a, y + b, z + c]) - 1 for a, b, c in np.ndindex(4, 4, 4)]
    i, j, k = np.concatenate(around, axis=1)
    points = positions(volume)[k, j, i]
    read = brute_distance(points, vertices, triangles)[0] < np.sqrt(6) * h
    normal = np.array([0, -np.sin(0.6), np.cos(0.6)])
    want = np.clip(0.5 - points @ normal / h / 4, 0, 1)
    assert_allclose(volume.read()[k, j, i][read], want[read], atol=1e-6, rtol=0)


# ---- kinds, bad meshes, wrong inputs --------------------------------------------


def test_the_kind_follows_the_edges():
    vertices, triangles = meshes.torus()
    assert voxelize(vertices, triangles, 0.1).info.kind == "solid"
    hole = voxelize(vertices, triangles[20:], 0.1)
    assert hole.info.kind == "sheet" and hole.mesh_info.n_border_edges > 3
    assert "holes" in hole.mesh_info.why
    flipped = triangles.copy()
    flipped[7] = flipped[7, ::-1]
    bad = voxelize(vertices, flipped, 0.1)
    assert bad.info.kind == "sheet" and bad.mesh_info.n_bad_edges == 3
    assert voxelize(vertices, triangles, 0.1, kind="sheet").info.kind == "sheet"
    assert voxelize(vertices, triangles[1:], 0.1, kind="solid").info.kind == "solid"


def test_vertices_at_one_place_are_one_vertex():
    vertices, triangles = meshes.torus()
    soup, apart = vertices[triangles].reshape(-1, 3), np.arange(triangles.size).reshape(-1, 3)
    soup[soup == 0] = -0.0
    volume = voxelize(soup, apart, 0.1)
    assert volume.info.kind == "solid" and volume.mesh_info.closed
    assert_array_equal(volume.read(), voxelize(vertices, triangles, 0.1).read())


def test_triangles_without_area_change_nothing():
    vertices, triangles = meshes.spiky(4)
    far = np.array([[9.0, 9, 9], [9, 9, 10], [9, 9, 11]])  # a loose line, not in the bounds
    extra = np.array([[0, 0, 1], [5, 5, 5], *[[len(vertices) + i for i in (0, 1, 1)]]])
    volume = voxelize(np.concatenate([vertices, far]), np.concatenate([triangles, extra]), 0.1)
    assert volume.mesh_info.n_degenerate == 3 and volume.mesh_info.closed
    assert_array_equal(volume.read(), voxelize(vertices, triangles, 0.1).read())


@pytest.mark.parametrize("turn", [False, True])
@pytest.mark.parametrize("name", ["spiky", "leaf"])
def test_triangles_that_are_there_twice_count_once(name, turn):
    vertices, triangles = (CLOSED | OPEN)[name]
    again = triangles[::-1, [2, 1, 0]] if turn else np.roll(triangles[::-1], 1, axis=1)
    doubled = voxelize(vertices, np.concatenate([triangles, again]), 0.1)
    single = voxelize(vertices, triangles, 0.1)
    assert doubled.mesh_info.n_degenerate == len(triangles) + single.mesh_info.n_degenerate
    assert doubled.info.kind == single.info.kind
    assert_array_equal(doubled.read(), single.read())
    assert_array_equal(doubled.read_surface(), single.read_surface())


def test_interiors_and_cavities_are_flooded():
    """Bricks that no triangle comes near: inside the outer box, in the cavity, around."""
    inner_v, inner_t = meshes.box((-3, -3, -3), (3, 3, 3))
    vertices, triangles = meshes.joined(
        meshes.box((-9, -9, -9), (9, 9, 9)), (inner_v, inner_t[:, ::-1]), meshes.box()
    )
    volume = voxelize(vertices, triangles, 0.19, dtype="u8")
    points = positions(volume).reshape(-1, 3)
    radius = np.abs(points).max(axis=1)
    inside = ((radius < 9) & (radius > 3)) | (radius < 1)
    assert_array_equal(volume.read().ravel() > 127, inside)
    assert volume.info.n_full > 200
    assert volume.info.nbytes < volume.read().nbytes


BAD = {
    "a vertex": (lambda v, t: (v * np.where(np.arange(len(v)) == 3, np.nan, 1)[:, None], t), "nan"),
    "infinity": (lambda v, t: (v / np.where(np.arange(len(v)) == 3, 0, 1)[:, None], t), "vertex 3"),
    "too high": (lambda v, t: (v, np.where(t == 5, 99, t)), "names vertex 99"),
    "negative": (lambda v, t: (v, np.where(t == 5, -1, t)), "names vertex -1"),
    "none": (lambda v, t: (v, t[:0]), "0 triangles"),
    "no vertex": (lambda v, t: (v[:0], t), "0 vertices"),
    "no area": (lambda v, t: (v * [1, 0, 0], t), "12 triangles has an area"),
    "shape": (lambda v, t: (v[:, :2], t), "(8, 2)"),
    "quads": (lambda v, t: (v, t.reshape(-1, 4)), "(9, 4)"),
    "floats": (lambda v, t: (v, t * 1.0), "float64"),
}


@pytest.mark.parametrize("name", BAD)
@pytest.mark.filterwarnings("ignore:divide by zero", "ignore:invalid value")
def test_wrong_meshes_are_refused_in_a_sentence(name):
    change, words = BAD[name]
    with pytest.raises(LeapRayError) as refused:
        voxelize(*change(*meshes.box()), 0.25)
    assert words in str(refused.value)


@pytest.mark.parametrize(
    ("size", "words"),
    [
        (0.0, "is 0"),
        (-1.0, "is -1"),
        (np.nan, "nan"),
        (np.inf, "inf"),
        (1e-200, "1e-200"),
        (1e-5, "200009 x 200009"),
        (1e-12, "too far"),
        (3e-4, "larger voxel_size"),
    ],
)
def test_wrong_voxel_sizes_are_refused_with_numbers(size, words):
    with pytest.raises(LeapRayError) as refused:
        voxelize(*meshes.box(), size)
    assert words in str(refused.value)


def test_wrong_options_are_refused_with_their_names():
    mesh = meshes.box()
    for options in (
        {"kind": "gas"},
        {"filter": "magic"},
        {"dtype": "u32"},
        {"half_width": 0.0},
        {"half_width": np.nan},
        {"half_width": 33.0},
        {"threads": -1},
        {"ids": [1, 2]},
        {"ids": [65536] * 12},
        {"ids": [-1] * 12},
        {"ids": [0.5] * 12},
    ):
        with pytest.raises(LeapRayError) as refused:
            voxelize(*mesh, 0.25, **options)
        assert next(iter(options)) in str(refused.value)


def test_the_budget_is_kept_before_work_begins():
    mesh = meshes.box()
    with pytest.raises(OutOfMemory, match="larger voxel_size") as refused:
        voxelize(*mesh, 0.01, max_nbytes=100_000)
    volume = voxelize(*mesh, 0.01)
    assert volume.info.nbytes <= refused.value.nbytes < 2 * volume.info.nbytes
    with pytest.raises(OutOfMemory):
        voxelize(*mesh, 0.001, max_nbytes=1_000_000)
    volume = voxelize(*mesh, 0.05)
    estimate = voxelize(*mesh, 0.05, max_nbytes=2 * volume.info.nbytes).info.nbytes
    assert estimate == volume.info.nbytes


def test_the_estimate_is_tight_for_long_thin_diagonal_meshes():
    """Bricks that the box of a large triangle holds but its band does not reach are not counted."""
    turn = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    vertices, triangles = meshes.box((0, 0, 0), (10, 0.05, 0.05))
    with pytest.raises(OutOfMemory) as refused:
        voxelize(vertices @ turn, triangles, 0.03, max_nbytes=40_000)
    volume = voxelize(vertices @ turn, triangles, 0.03)
    assert volume.info.nbytes <= refused.value.nbytes < 1.3 * volume.info.nbytes


@pytest.mark.parametrize("scale", [1e-6, 1e-3, 1e6])
def test_scale_does_not_matter(scale):
    vertices, triangles = meshes.spiky(6)
    scale = 2.0 ** np.round(np.log2(scale))
    assert_array_equal(
        voxelize(vertices * scale, triangles, 0.07 * scale, dtype="f32").read(),
        voxelize(vertices, triangles, 0.07, dtype="f32").read(),
    )


def test_far_from_the_origin_the_shape_stays():
    vertices, triangles = meshes.spiky(6)
    h = 2.0**-4
    vertices = np.round(vertices * 2**20) / 2**20  # so that moving it is exact
    near = voxelize(vertices, triangles, h, dtype="f32")
    far = voxelize(vertices + 2.0**20, triangles, h, dtype="f32")
    assert_allclose(far.read(), near.read(), atol=1e-7, rtol=0)


# ---- beside others -----------------------------------------------------------------


def test_a_sphere_of_a_million_triangles_is_as_good_as_analytic_samples():
    """Radius 25.6 voxels; the trilinear field of exact samples is off by 0.007 on average."""
    radius = 25.6
    volume = voxelize(*meshes.uv_sphere(1000, 501), 1 / radius, dtype="f32")
    assert volume.info.kind == "solid"
    directions = np.random.default_rng(8).normal(size=(20000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)

    def radial_error(v):
        hits = leapray.trace(leapray.build(v), np.zeros((20000, 3)), directions)
        return np.abs(hits.t - 1) * radius

    m = volume.info.object_from_index
    s = (1 - np.linalg.norm(positions(volume), axis=-1)) * radius
    exact = leapray.Volume(np.clip(0.5 + s / 5, 0, 1).astype(np.float32), object_from_index=m)
    mesh, analytic = radial_error(volume), radial_error(exact)
    assert mesh.mean() < 0.007 * 1.2 and mesh.max() < 0.011 * 1.2
    assert mesh.mean() < 1.05 * analytic.mean() and mesh.max() < 1.05 * analytic.max()


@pytest.mark.parametrize("name", ["torus", "spikier"])
def test_beside_openvdb_the_differences_are_openvdbs(name):
    """Its level sets lie on the same lattice. Measured: half of the samples agree to
    2e-5 voxel; those that do not are further from brute force than ours."""
    pytest.importorskip("bpy", reason="OpenVDB comes with Blender")
    openvdb = openvdb_module()
    vertices, triangles = CLOSED[name]
    h = 2.0**-5
    ours = voxelize(vertices, triangles, h, dtype="f32")
    grid = openvdb.FloatGrid.createLevelSetFromPolygons(
        vertices.astype(np.float32),
        triangles=triangles.astype(np.uint32),
        transform=openvdb.createLinearTransform(h),
        halfWidth=3.0,
    )
    first = np.round(ours.info.object_from_index[:3, 3] / h).astype(int)
    theirs = np.empty(ours.info.size, np.float32)
    grid.copyToArray(theirs, ijk=tuple(first.tolist()))
    d_theirs = theirs.T / h
    d_ours = (0.5 - ours.read()) * 5
    band = np.abs(d_ours) < 2.4
    difference = np.abs(d_theirs - d_ours)[band]
    assert band.sum() > 10000
    assert np.median(difference) < 1e-4
    apart = np.argwhere(band & (np.abs(d_theirs - d_ours) > 1e-3))
    apart = np.random.default_rng(9).permutation(apart)[:300]
    if len(apart):
        at = tuple(apart.T)
        d, _ = brute_distance(positions(ours)[at], vertices, triangles)
        assert np.abs(np.abs(d_ours[at]) - d / h).max() < 1e-5
