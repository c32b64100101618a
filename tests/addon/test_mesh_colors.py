# SPDX-License-Identifier: GPL-3.0-or-later
"""What materials ask of a mesh reaches its volume, and no more; the plan measures its error."""

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scenes import box, camera, join, place, plane, scene, sphere

import leapray
from addon import model
from addon.plan import mesh_colors, mesh_split, objects, plan
from addon.store.memory_cache import Cache

TEXTURED = (model.Lobe("diffuse", (1.0, 1.0, 1.0), textured=True),)


def image(n=32, seed=0, name="noise", **options):
    pixels = np.random.default_rng(seed).random((n, n, 3)).astype(np.float32)
    return model.Image(name, pixels, **options)


def material(picture=None, source="image", name="Textured"):
    return model.Material(name, TEXTURED, source, "UVMap", picture)


def with_uvs(mesh):
    """UVs from x and y, the mesh's box on the unit square."""
    flat = mesh.vertices[:, :2]
    lo, size = flat.min(axis=0), np.ptp(flat, axis=0)
    return dataclasses.replace(mesh, corner_uvs=((flat - lo) / size)[mesh.triangles])


def smooth(mesh):
    """A sphere's own normals, round the middle of its box."""
    middle = (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2
    outward = mesh.vertices - middle
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    return dataclasses.replace(mesh, corner_normals=outward[mesh.triangles])


def dressed(meshes, instances, materials, **more):
    return dataclasses.replace(scene(meshes, instances, **more), materials=tuple(materials))


def planned(what):
    return plan.make(what, Cache(), leapray.Watch(), 1)


def looking_down(**more):
    return camera(eye=(0.0, -0.01, 3.0), **more)


# ---- who shares a volume --------------------------------------------------------


def test_instances_share_a_volume_where_their_colours_are_the_same():
    mesh = with_uvs(plane())
    materials = [material(image(seed=0)), material(image(seed=1)), material(image(seed=0))]
    instances = [place(0, at=(3.0 * i, 0, 0), materials=(i,)) for i in range(3)]
    made = planned(dressed([mesh], instances, materials, resolution=40))
    volumes = [i.structure.volume for i in made.instances]
    assert volumes[0] is volumes[2] and volumes[0] is not volumes[1]
    assert len(made.volumes) == 2
    assert all(v.info.has_colors for v in volumes)


def test_only_what_materials_ask_for_is_baked():
    mesh = dataclasses.replace(with_uvs(plane()), corner_colors=np.full((2, 3, 3), 0.5, np.float32))
    plain = model.Material("Plain", (model.Lobe("diffuse"),))
    unused = model.Material("Unused", (model.Lobe("diffuse"),), "image", "UVMap", image())
    for asked in (plain, unused):
        made = planned(dressed([mesh], [place(0)], [asked], resolution=40))
        assert made.volumes[0]["carries"] == []
    made = planned(dressed([mesh], [place(0)], [material(source="vertex")], resolution=40))
    assert made.volumes[0]["carries"] == ["colors"]
    got, _ = made.instances[0].structure.volume.attributes([[0.1, 0.2, 0.0]])
    assert_allclose(got, 0.5, atol=0.002)


def test_every_slot_has_its_own_source():
    left = plane(2.0)
    both = with_uvs(join((left, (0, 0, 0)), (left, (2.0, 0, 0))))
    both = dataclasses.replace(
        both,
        slots=np.array([0, 0, 1, 1], np.uint16),
        corner_colors=np.full((4, 3, 3), (0.9, 0.5, 0.1), np.float32),
    )
    blue = model.Image("blue", np.broadcast_to(np.float32((0, 0, 1)), (4, 4, 3)))
    materials = [material(blue), material(source="vertex")]
    made = planned(dressed([both], [place(0, materials=(0, 1))], materials, resolution=60))
    (volume,) = {i.structure.volume for i in made.instances}
    got, _ = volume.attributes([[-0.5, 0.3, 0], [2.4, 0.3, 0]], [0, 1])
    assert_allclose(got, [(0, 0, 1), (0.9, 0.5, 0.1)], atol=0.002)


@pytest.mark.parametrize(
    "mesh, asked, words",
    [
        (plane(), material(image()), "no UVs 'UVMap'"),
        (plane(), material(source="vertex"), "no vertex colours"),
        (with_uvs(plane()), material(None), "texture without an image"),
    ],
)
def test_what_is_missing_is_said_once_and_white(mesh, asked, words):
    instances = [place(0), place(0, at=(3, 0, 0))]
    made = planned(dressed([mesh], instances, [asked], resolution=40))
    assert sum(words in warning for warning in made.warnings) == 1
    assert "'Textured'" in " ".join(made.warnings)
    assert made.volumes[0]["carries"] == []


def test_slots_that_no_triangle_has_ask_for_nothing():
    mesh = dataclasses.replace(with_uvs(plane()), slots=np.zeros(2, np.uint16))
    materials = [material(image()), material(source="vertex", name="Unused")]
    made = planned(dressed([mesh], [place(0, materials=(0, 1))], materials, resolution=40))
    assert made.volumes[0]["carries"] == ["colors"]
    assert not any("vertex colours" in warning for warning in made.warnings)


# ---- smooth normals -------------------------------------------------------------


def test_meshes_whose_facets_show_carry_normals_and_others_do_not():
    coarse, fine = sphere(n=6), sphere(n=64)
    assert mesh_colors.facet_voxel(smooth(coarse), False) > 0.02
    assert mesh_colors.facet_voxel(coarse, True) == 0  # flat: its triangles have their own normals
    assert not mesh_colors.facet_voxel(smooth(fine), True) > 0.1  # facets smaller than voxels
    places = [place(0), place(1, at=(3, 0, 0)), place(2, at=(-3, 0, 0)), place(3, at=(0, 0, 3))]
    made = planned(scene([smooth(coarse), coarse, fine, plane()], places))
    carried = [row["carries"] for row in made.volumes]
    assert carried == [["normals"], [], [], []]
    assert made.volumes[1]["exact_share"] > 0.5 and made.volumes[1]["normal_error"] < 2


def test_beside_a_crease_normals_are_those_of_the_face():
    """Central differences would see both sides within two voxels."""
    made = planned(scene([box(turn=0.3)], resolution=48))
    structure = made.instances[0].structure
    rng = np.random.default_rng(3)
    origins = rng.uniform(-4, 4, (20000, 3))
    hits = leapray.trace(structure, origins, rng.uniform(-0.8, 0.8, (20000, 3)) - origins)
    normals = hits.normal[np.isfinite(hits.t)]
    a = np.array([1, 1, 0]) / np.sqrt(2)
    k = np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])
    axes = np.eye(3) + np.sin(0.3) * k + (1 - np.cos(0.3)) * k @ k
    cosine = np.abs(normals @ axes).max(axis=1)
    assert len(cosine) > 10000
    assert (cosine < np.cos(np.radians(0.1))).mean() < 0.04  # within half a voxel of the edges
    blurred = leapray.voxelize(box(turn=0.3).vertices, box().triangles, 2 / 32)
    hits = leapray.trace(leapray.build(blurred), origins, -origins)
    cosine = np.abs(hits.normal[np.isfinite(hits.t)] @ axes).max(axis=1)
    assert (cosine < np.cos(np.radians(0.1))).mean() > 0.1


def test_normals_along_the_facets_are_not_worth_it():
    flat = plane()
    up = np.broadcast_to(np.float32((0, 0, 1)), (2, 3, 3))
    assert not mesh_colors.facet_voxel(dataclasses.replace(flat, corner_normals=up), False) > 0.01


# ---- meshes that change ---------------------------------------------------------


def test_parts_keep_what_their_corners_carry():
    ball = smooth(with_uvs(sphere(n=4)))
    two = join((ball, (0, 0, 0)), (ball, (0.5, 0, 0)))
    two = dataclasses.replace(
        two,
        corner_normals=np.concatenate([ball.corner_normals] * 2),
        corner_uvs=np.concatenate([ball.corner_uvs, ball.corner_uvs + 1]),
    )
    split = mesh_split.split(two)
    assert len(split) == 2
    for part in split:
        assert len(part.corner_normals) == len(part.corner_uvs) == len(part.triangles)
        assert part.corner_colors is None
    assert {int(part.corner_uvs.min() >= 1) for part in split} == {0, 1}


def test_one_volume_for_all_keeps_every_objects_colours_and_normals():
    ball = smooth(sphere(n=6))
    tile = with_uvs(plane())
    red = model.Image("red", np.broadcast_to(np.float32((1, 0, 0)), (4, 4, 3)))
    mirrored = np.diag([-2.0, 1.0, 1.0, 1.0])
    mirrored[0, 3] = 4.0
    instances = [
        dataclasses.replace(place(0, materials=(1,)), world_from_object=mirrored),
        place(1, at=(0, 0, -0.5)),
    ]
    plain = model.Material("Plain", (model.Lobe("diffuse"),))
    what = dressed([ball, tile], instances, [material(red), plain], layout="scene", resolution=120)
    kinds = [objects.Kind("solid"), objects.Kind("sheet")]
    merged, _ = objects.merge(what, instances, [], kinds)
    solid, sheet = merged.meshes
    corners = solid.vertices[solid.triangles]
    # of an ellipsoid the normal is the place over the squared half axes
    want = (corners - np.float32((4, 0, 0))) / np.float32((4, 1, 1))
    want /= np.linalg.norm(want, axis=2, keepdims=True)
    assert_allclose(solid.corner_normals, want, atol=1e-5)
    assert_allclose(sheet.corner_uvs, tile.corner_uvs)
    assert set(solid.slots) == {0} and set(sheet.slots) == {1}
    made = planned(what)
    volumes = [i.structure.volume for i in made.instances]
    assert [row["carries"] for row in made.volumes] == [["normals"], ["colors"]]
    got, _ = volumes[1].attributes([[0.0, 0.0, -0.5]], [1])
    assert_allclose(got, [(1, 0, 0)], atol=0.002)
    outward = want.mean(axis=1) / np.linalg.norm(want.mean(axis=1), axis=1, keepdims=True)
    _, normals = volumes[0].attributes(corners.mean(axis=1), np.zeros(len(corners), np.uint16))
    assert (np.sum(normals * outward, axis=1) > 0.99).all()


# ---- the plan -------------------------------------------------------------------


def grid(n):
    """A square of n x n quads, of side 2."""
    y, x = np.mgrid[: n + 1, : n + 1].reshape(2, -1)
    v = np.stack([2 * x / n - 1, 2 * y / n - 1, 0 * x], axis=1).astype(np.float32)
    a = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    t = np.concatenate([np.stack([a, a + 1, a + n + 2], 1), np.stack([a, a + n + 2, a + n + 1], 1)])
    return v, t.astype(np.int32)


def checks(n, **options):
    board = np.add.outer(np.arange(n), np.arange(n)) % 2
    pixels = np.repeat(board[..., None], 3, axis=2).astype(np.float32)
    return model.Image("checks", pixels, "closest", **options)


def test_a_texture_takes_no_finer_voxels_than_a_plain_floor():
    mesh = with_uvs(plane(6.0))
    plain = model.Material("Plain", (model.Lobe("diffuse"),))
    view = looking_down(width=100, height=100)  # the rims are far outside of it
    rows = {
        name: planned(
            dressed([mesh], [place(0)], [worn], view=view, width=100, height=100)
        ).volumes[0]
        for name, worn in (("plain", plain), ("checks", material(checks(32))))
    }
    assert rows["checks"]["color_error"] < 1e-3
    assert rows["checks"]["voxel_size"] == rows["plain"]["voxel_size"]
    assert rows["checks"]["nbytes"] < rows["plain"]["nbytes"] + 50_000


def test_colours_of_triangles_finer_than_voxels_are_worth_finer_ones():
    """A volume that is too coarse names only some of them."""
    v, t = grid(96)
    colors = np.random.default_rng(7).random((len(t), 1, 3)).repeat(3, axis=1)
    mesh = model.Mesh("Grid", v, t, corner_colors=colors.astype(np.float32))
    view = looking_down(width=100, height=100)
    what = dressed([mesh], [place(0)], [material(None, "vertex")], view=view, width=100, height=100)
    (row,) = planned(what).volumes
    assert row["voxel_size"] < 2 / 96 and row["color_error"] <= 0.011


def test_an_edited_texture_or_normal_makes_a_new_volume():
    cache = Cache()
    mesh = with_uvs(plane())
    seen = []
    for picture in (image(seed=0), image(seed=0), image(seed=5)):
        made = plan.make(
            dressed([mesh], [place(0)], [material(picture)], resolution=40),
            cache, leapray.Watch(), 1,
        )  # fmt: skip
        seen.append(made.instances[0].structure.volume)
    assert seen[0] is seen[1] and seen[1] is not seen[2]
