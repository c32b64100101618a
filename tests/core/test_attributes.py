# SPDX-License-Identifier: GPL-3.0-or-later
"""Colours, textures and smooth normals reach the hits as they lie on the mesh."""

import numpy as np
import pytest
from meshes import box, brute_distance, icosphere, plane
from numpy.testing import assert_allclose, assert_array_equal

import leapray
from leapray import VERTEX, WHITE, Attributes, Texture

HALF_STEP = 0.2 / 255  # of a stored colour, sRGB; see grid/attributes/attributes.h


def srgb(linear):
    linear = np.asarray(linear)
    return np.where(
        linear < 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055
    )


def on_plane(n, seed=0, margin=0.02):
    """Points of the unit square, and their UVs."""
    inside = np.random.default_rng(seed).uniform(margin, 1 - margin, (n, 2))
    return np.c_[inside - 0.5, np.zeros(n)], inside


def textured(texture, voxel_size, **options):
    v, t = plane(3)
    attributes = Attributes(
        uvs=v[t][..., :2] + 0.5, color_sources=np.zeros(len(t), int), textures=(texture,)
    )
    return leapray.voxelize(v, t, voxel_size, attributes=attributes, **options)


def smooth_ball(levels=2, **options):
    v, t = icosphere(levels)
    return leapray.voxelize(v, t, 1 / 40, attributes=Attributes(normals=v[t]), **options)


# ---- colours -----------------------------------------------------------------


@pytest.mark.parametrize("dtype", ["u8", "u16", "f32"])
def test_any_one_colour_keeps_to_half_a_step(dtype):
    v, t = box()
    shades = np.random.default_rng(1).random((40, 3)) ** 2.2
    for shade in shades:
        colors = np.broadcast_to(shade, (len(t), 3, 3))
        attributes = Attributes(colors=colors, color_sources=np.full(len(t), VERTEX))
        volume = leapray.voxelize(v, t, 0.3, attributes=attributes, dtype=dtype)
        got, _ = volume.attributes([[0.2, 0.1, 1.0]])
        assert np.abs(srgb(got) - srgb(shade)).max() < HALF_STEP


def test_vertex_colours_run_linearly_over_triangles():
    v, t = plane(4)
    attributes = Attributes(colors=np.clip(v[t] + 0.5, 0, 1), color_sources=np.full(len(t), VERTEX))
    volume = leapray.voxelize(v, t, 1 / 64, attributes=attributes)
    points, uv = on_plane(500)
    got, _ = volume.attributes(points)
    assert np.abs(srgb(got[:, :2]) - srgb(uv)).max() < HALF_STEP
    assert_array_equal(volume.colors(points, threads=3), got)


def test_colours_above_white_keep_their_ratio_to_it():
    v, t = plane(2)
    attributes = Attributes(
        colors=np.full((len(t), 3, 3), (0.5, 4.0, 20.0)), color_sources=np.full(len(t), VERTEX)
    )
    volume = leapray.voxelize(v, t, 1 / 16, attributes=attributes)
    got, _ = volume.attributes(on_plane(20)[0])
    assert_allclose(got, np.broadcast_to((0.5, 4.0, 20.0), got.shape), rtol=0.01)


def test_nothing_bleeds_between_ids():
    v, t = plane(2)
    right = v[t][..., 0].mean(axis=1) > 0
    colors = np.where(right[:, None, None], (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)) * np.ones((1, 3, 1))
    attributes = Attributes(colors=colors, color_sources=np.full(len(t), VERTEX))
    volume = leapray.voxelize(v, t, 1 / 16, attributes=attributes, ids=right.astype(int))
    structure = leapray.build(volume)
    points, _ = on_plane(4000)
    hits = leapray.trace(structure, points + np.array([0, 0, 3]), np.tile((0.0, 0, -1), (4000, 1)))
    assert np.isfinite(hits.t).all() and 0.4 < hits.id.mean() < 0.6
    got, _ = volume.attributes(points, hits.id)
    want = np.where(hits.id[:, None] == 1, (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    assert_allclose(got, want, atol=1e-6)


def test_a_triangle_without_a_source_is_white():
    v, t = plane(2)
    attributes = Attributes(color_sources=np.full(len(t), WHITE))
    got, normals = leapray.voxelize(v, t, 1 / 16, attributes=attributes).attributes(on_plane(20)[0])
    assert_allclose(got, 1.0)
    assert np.isnan(normals).all()


# ---- textures ------------------------------------------------------------------


def lookup(pixels, uv, extension, interpolation):
    """Texture lookup by a simple reference, one uv at a time."""
    h, w, _ = pixels.shape

    def texel(i, n):
        if extension == "repeat":
            return i % n
        if extension == "mirror":
            return i % (2 * n) if i % (2 * n) < n else 2 * n - 1 - i % (2 * n)
        if extension == "clip":
            return i if 0 <= i < n else None
        return min(max(i, 0), n - 1)

    def at(i, j):
        i, j = texel(i, w), texel(j, h)
        return np.zeros(3) if i is None or j is None else pixels[j, i]

    def weights(t):  # of a B-spline
        away = np.abs(np.arange(-1, 3) - t)
        return np.where(away < 1, 2 / 3 - away**2 + away**3 / 2, (2 - away) ** 3 / 6)

    out = []
    for u, v in uv:
        if interpolation == "closest":
            out.append(at(int(np.floor(u * w)), int(np.floor(v * h))))
            continue
        x, y = u * w - 0.5, v * h - 0.5
        i, j = int(np.floor(x)), int(np.floor(y))
        p, q = x - i, y - j
        if interpolation == "cubic":
            taps = [[at(i + k, j + m) for k in range(-1, 3)] for m in range(-1, 3)]
            out.append(np.einsum("m,k,mkc->c", weights(q), weights(p), taps))
            continue
        row = [(1 - p) * at(i, j + k) + p * at(i + 1, j + k) for k in (0, 1)]
        out.append((1 - q) * row[0] + q * row[1])
    return np.array(out)


@pytest.mark.parametrize("extension", leapray.attributes.EXTENSIONS)
@pytest.mark.parametrize("interpolation", leapray.attributes.INTERPOLATIONS)
def test_lookups_agree_with_a_simple_reference(extension, interpolation):
    rng = np.random.default_rng(2)
    pixels = rng.random((5, 7, 3)).astype(np.float32)
    uv = rng.uniform(-2.5, 3.5, (400, 2)).astype(np.float32)
    got = Texture(pixels, interpolation, extension).sample(uv)
    assert_allclose(got, lookup(pixels, uv.astype(float), extension, interpolation), atol=2e-5)


def test_every_level_of_the_pyramid_keeps_the_mean():
    pixels = np.random.default_rng(3).random((37, 53, 3)).astype(np.float32)
    texture = Texture(pixels)
    whole = texture.sample([[0.3, 0.6]], [[0, 0, 1e3]])
    assert_allclose(whole[0], pixels.mean(axis=(0, 1)), rtol=1e-5)


def test_a_texture_finer_than_the_voxel_does_not_alias():
    board = (np.add.outer(np.arange(256), np.arange(256)) % 2).astype(np.float32)
    texture = Texture(np.repeat(board[..., None], 3, axis=2))
    points, _ = on_plane(300, margin=0.1)
    got, _ = textured(texture, 1 / 32).attributes(points, width=1)
    assert_allclose(got, 0.5, atol=0.02)  # point samples would be anything from 0 to 1


def test_a_texture_seen_obliquely_keeps_its_stripes():
    stripes = np.repeat((np.arange(16) % 2).astype(np.float32)[:, None, None], 512, axis=1)
    texture = Texture(np.repeat(stripes, 3, axis=2), "closest")  # 512 texels wide, 16 high
    points, uv = on_plane(2000, margin=0.05)
    got, _ = textured(texture, 1 / 128).attributes(points)
    middle = np.abs(uv[:, 1] * 16 % 1 - 0.5) < 0.3  # of a stripe that is 8 voxels high
    want = np.floor(uv[:, 1] * 16) % 2
    assert_allclose(got[middle, 0], want[middle], atol=0.02)


@pytest.mark.parametrize("n", [4, 16, 64])
def test_a_texture_is_as_sharp_as_on_the_mesh_whatever_the_voxel(n):
    pixels = np.random.default_rng(8).random((64, 64, 3)).astype(np.float32)
    texture = Texture(pixels, extension="extend")
    points, uv = on_plane(1000)
    got, _ = textured(texture, 1 / n).attributes(points)
    assert_allclose(got, texture.sample(uv), atol=1e-3)  # corners are f32 in units of voxels


def test_a_seam_of_the_uvs_stays_where_the_mesh_has_it():
    """Left of it the image runs one way, right of it the other, and far off."""
    v, t = plane(8)
    right = v[t][..., 0].mean(axis=1) > 0
    uvs = np.where(right[:, None, None], (-1.0, 1.0) * v[t][..., :2] + 7.25, v[t][..., :2] + 0.5)
    texture = Texture(np.random.default_rng(9).random((16, 16, 3)).astype(np.float32))
    attributes = Attributes(uvs=uvs, color_sources=np.zeros(len(t), int), textures=(texture,))
    volume = leapray.voxelize(v, t, 1 / 20, attributes=attributes)
    points, _ = on_plane(3000)
    side = points[:, 0] > 0
    uv = np.where(side[:, None], (-1.0, 1.0) * points[:, :2] + 7.25, points[:, :2] + 0.5)
    want = texture.sample(uv)
    off = np.abs(volume.attributes(points)[0] - want).max(axis=1)
    assert off[np.abs(points[:, 0]) > 1 / 20].max() < 1e-3
    assert (off > 1e-3).mean() < 0.02  # where no corner of the cell names the right triangle


def test_bytes_are_interpolated_before_they_are_made_linear():
    texture = Texture(np.uint8([[[0] * 3, [255] * 3]]), extension="extend")
    got = texture.sample([[0.25, 0.5], [0.5, 0.5], [0.75, 0.5]])[:, 0]
    assert_allclose(got, [0.0, 0.21404, 1.0], atol=1e-5)  # of sRGB 1/2, as Cycles shows it


def test_a_texture_of_bytes_is_as_bright_from_afar():
    pixels = np.random.default_rng(10).integers(0, 256, (32, 32, 3), dtype=np.uint8)
    texture = Texture(pixels)
    uv = np.random.default_rng(11).random((200_000, 2))
    near = texture.sample(uv).mean(axis=0)
    far = texture.sample([[0.5, 0.5]], [[0, 0, 32]])[0]
    assert_allclose(far, near, rtol=0.03)  # the mean of linear texels is a third brighter


# ---- normals -------------------------------------------------------------------


def normals_at(volume, n=1500):
    """Hits of rays towards the origin; their places on the unit sphere."""
    rng = np.random.default_rng(4)
    o = rng.normal(size=(n, 3))
    o /= np.linalg.norm(o, axis=1, keepdims=True)
    hits = leapray.trace(leapray.build(volume), 3 * o, -o)
    assert np.isfinite(hits.t).all()
    return hits, o


def degrees(a, b):
    return np.degrees(np.arccos(np.clip(np.sum(a * b, axis=1), -1, 1)))


@pytest.mark.parametrize("dtype", ["u8", "u16", "f32"])
def test_a_coarse_ball_is_smooth_to_the_eye(dtype):
    hits, o = normals_at(smooth_ball(dtype=dtype))
    plain, _ = normals_at(leapray.voxelize(*icosphere(2), 1 / 40, dtype=dtype))
    assert np.quantile(degrees(plain.normal, o), 0.9) > 5.0
    # Across the edges of facets the samples' closest points lie a little apart.
    assert np.quantile(degrees(hits.normal, o), 0.9) < 1.0
    assert degrees(hits.normal, o).max() < 2.5
    assert_array_equal(hits.t, plain.t)


def test_normals_are_those_of_the_closest_point():
    v, t = icosphere(1)
    rng = np.random.default_rng(5)
    which = rng.integers(0, len(t), 500)
    weights = rng.dirichlet((3.0, 3.0, 3.0), 500)  # inside of triangles, where one is nearest
    weights = weights[middle := weights.min(axis=1) > 0.1]
    which = which[middle]
    points = np.einsum("nc,nca->na", weights, v[t[which]])
    want = points / np.linalg.norm(points, axis=1, keepdims=True)
    _, got = leapray.voxelize(v, t, 1 / 64, attributes=Attributes(normals=v[t])).attributes(points)
    assert degrees(got, want).max() < 0.02


@pytest.mark.parametrize("kind", ["solid", "sheet"])
def test_a_mesh_wound_inside_out_shows_the_same_normals(kind):
    v, t = icosphere(2)
    attributes = Attributes(normals=-v[t[:, ::-1]])
    turned = leapray.voxelize(v, t[:, ::-1], 1 / 40, attributes=attributes, kind=kind)
    hits, o = normals_at(turned)
    assert degrees(hits.normal, o).max() < 2.5  # a closed mesh is turned, as a sheet too


def test_normals_reach_no_analytic_normal():
    volume = smooth_ball()
    o, d = [[0.3, 0.2, 3.0]], [[0, 0, -1.0]]
    plain = leapray.build(leapray.voxelize(*icosphere(2), 1 / 40))
    got = leapray.trace(leapray.build(volume), o, d, normal="analytic")
    assert_array_equal(got.normal, leapray.trace(plain, o, d, normal="analytic").normal)
    assert (leapray.trace(leapray.build(volume), o, d).normal != got.normal).any()


# ---- storage -------------------------------------------------------------------


@pytest.mark.parametrize("half_width", [0.6, 2.5, 6.0])
def test_every_corner_of_a_surface_cell_carries_its_attributes(half_width):
    """With a narrow ramp such corners lie in bricks that are constant otherwise."""
    v, t = icosphere(3)
    volume = leapray.voxelize(
        v,
        t,
        1 / 16,
        attributes=Attributes(normals=v[t], color_sources=np.full(len(t), WHITE)),
        half_width=half_width,
    )
    k, j, i = np.nonzero(volume.read_surface())
    corners = np.stack([i, j, k], 1)[:, None] + np.array(list(np.ndindex(2, 2, 2)))
    places = np.unique(corners.reshape(-1, 3), axis=0)
    m = volume.info.object_from_index
    points = places @ m[:3, :3].T + m[:3, 3]
    # at the sample itself the others weigh nothing, so its own normal shows
    _, normals = volume.attributes(points)
    distance, which = brute_distance(points, v, t)
    assert distance.max() < 3**0.5 / 16
    facet = np.cross(v[t[which, 1]] - v[t[which, 0]], v[t[which, 2]] - v[t[which, 0]])
    facet /= np.linalg.norm(facet, axis=1, keepdims=True)
    assert degrees(normals, facet).max() < 8  # a corner's normal leans from its facet by less


def test_attributes_take_memory_only_at_the_surface():
    v, t = icosphere(3)
    plain = leapray.voxelize(v, t, 1 / 64).info
    carrying = leapray.voxelize(
        v, t, 1 / 64, attributes=Attributes(normals=v[t], color_sources=np.full(len(t), WHITE))
    ).info
    assert not plain.has_colors and not plain.has_normals
    assert carrying.has_colors and carrying.has_normals
    assert carrying.n_bricks == plain.n_bricks
    all_bricks = carrying.n_bricks * 512 * 8
    assert 0.2 * all_bricks < carrying.nbytes - plain.nbytes < 0.6 * all_bricks


def test_threads_change_no_attribute():
    points = icosphere(3)[0]
    one, seven = (smooth_ball(threads=n).attributes(points)[1] for n in (1, 7))
    assert_array_equal(one, seven)


# ---- words ---------------------------------------------------------------------


@pytest.mark.parametrize(
    "make, words",
    [
        (lambda: Texture(np.zeros((4, 4))), r"pixels must have the shape \(h, w, 3\)"),
        (lambda: Texture(np.zeros((0, 4, 3))), "1 to 65536 texels per side; it is 4 x 0"),
        (lambda: Texture(np.zeros((4, 4, 3)), "sharp"), "unknown interpolation 'sharp'"),
        (lambda: Texture(np.zeros((4, 4, 4))), r"pixels must have the shape \(h, w, 3\)"),
        (lambda: Texture(np.zeros((4, 4, 3)), extension="wrap"), "unknown extension 'wrap'"),
        (lambda: Texture(np.zeros((4, 4, 3))).sample([[0, 0]], [[0, 0, -1]]), "of a width of 0"),
        (lambda: voxelized(normals=np.zeros((3, 3))), r"normals must have the shape \(12, 3, 3\)"),
        (lambda: voxelized(color_sources=np.zeros(12, int)), "from texture 0; there are 0"),
        (
            lambda: voxelized(color_sources=np.full(12, VERTEX)),
            "vertex colours, but there are none",
        ),
        (
            lambda: voxelized(
                color_sources=np.zeros(12, int), textures=(Texture(np.ones((1, 1, 3))),)
            ),
            "takes a texture, but there are no UVs",
        ),
        (lambda: voxelized(color_sources=np.zeros(11, int)), "12 whole numbers, one per triangle"),
    ],
)
def test_what_is_wrong_is_said(make, words):
    with pytest.raises(leapray.LeapRayError, match=words):
        make()


def voxelized(**attributes):
    return leapray.voxelize(*box(), 0.2, attributes=Attributes(**attributes))


def test_nonsense_becomes_black_or_nothing_and_never_nan():
    v, t = plane(2)
    rng = np.random.default_rng(6)
    wild = rng.choice([np.nan, np.inf, -np.inf, 1e38, -1.0, 0.5], (len(t), 3, 3))
    pixels = rng.choice([np.nan, np.inf, 0.5], (8, 8, 3))
    attributes = Attributes(
        normals=wild,
        colors=wild,
        uvs=wild[..., :2] * 3,
        color_sources=np.arange(len(t)) % 2 - 1,
        textures=(Texture(pixels),),
    )
    volume = leapray.voxelize(v, t, 1 / 16, attributes=attributes)
    points, _ = on_plane(500)
    colors, _ = volume.attributes(points)
    assert np.isfinite(colors).all()
    hits = leapray.trace(
        leapray.build(volume), points + np.array([0, 0, 1]), np.tile((0.0, 0, -1), (500, 1))
    )
    assert_allclose(np.linalg.norm(hits.normal, axis=1), 1.0, atol=1e-9)
