# SPDX-License-Identifier: GPL-3.0-or-later
"""Solids that cut instances, and fields that colour them: pictures whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest
import stage

import leapray

BOX = (-0.1, -1.6, -1.6), (1.7, 1.7, 1.6)  # what the cutting box spans
STEP = 1e-5  # of u16 samples, across voxels of 0.1 over which they rise by a fifth
RED, GREEN = leapray.Material.diffuse((1, 0, 0)), leapray.Material.diffuse((0, 1, 0))


def ball(radius=1.0, n=48):
    """A ball whose values fall by 1/2 over its radius, as a volume."""
    h = 3.2 / n
    at = (np.arange(n) + 0.5) * h - 1.6
    z, y, x = np.meshgrid(at, at, at, indexing="ij")
    field = np.clip(1 - 0.5 * np.sqrt(x * x + y * y + z * z) / radius, 0, 1)
    matrix = np.diag([h, h, h, 1.0])
    matrix[:3, 3] = 0.5 * h - 1.6
    return leapray.Volume(field.astype(np.float32), 0.5, object_from_index=matrix)


@pytest.fixture(scope="module")
def cut():
    """The ball without what lies in a box, its cut face another instance; (ball, box)."""
    lo, hi = BOX
    vertices = [[(lo, hi)[n >> a & 1][a] for a in range(3)] for n in range(8)]
    quads = [(0, 4, 6, 2), (1, 3, 7, 5), (0, 1, 5, 4), (2, 6, 7, 3), (0, 2, 3, 1), (4, 5, 7, 6)]
    triangles = [corners for a, b, c, d in quads for corners in ((a, b, c), (a, c, d))]
    box = leapray.voxelize(vertices, triangles, 0.1, kind="solid", exact="all")
    return ball(), box


def instances(cut, color=None):
    solid, box = cut
    whole, cutter = leapray.build(solid), leapray.build(box)
    placed = np.eye(4)
    return [
        leapray.Instance(
            whole, placed, 0, object_index=1, clips=[leapray.Clip(box, placed, margin=0.02)]
        ),
        leapray.Instance(
            cutter,
            placed,
            1,
            object_index=2,
            clips=[leapray.Clip(solid, placed, inside=True)],
            field_color=color,
        ),
    ]


def seen(placed, eye, size=96, materials=(RED, GREEN), lights=(), **more):
    view = stage.camera(eye, size=(size, size))
    scene = leapray.Scene(view, placed, list(lights), list(materials), [0, 1], **more)
    return scene.render_tile(
        0, 0, size, size, samples=1, passes=("Depth", "Position", "Normal", "Object Index")
    )


@pytest.mark.parametrize("eye", [(4, 0.3, 0.2), (3, -3, 1), (1.5, 2.5, 3), (-3, 1, 1)])
def test_a_ball_without_a_box_is_that(cut, eye):
    """Every hit lies on the ball outside the box, or on the box inside the ball."""
    found = seen(instances(cut), eye)
    index, where = found["Object Index"][..., 0], found["Position"]
    lo, hi = map(np.array, BOX)
    radius = np.linalg.norm(where, axis=2)
    in_box = ((where > lo + 0.03) & (where < hi - 0.03)).all(axis=2)
    on_ball, on_box = index == 1, index == 2
    assert on_ball.any() or eye[0] > 3.5
    assert np.abs(radius[on_ball] - 1).max(initial=0) < 0.005
    assert not in_box[on_ball].any()
    assert (radius[on_box] < 1.005).all()
    off_faces = np.minimum(np.abs(where - lo), np.abs(where - hi)).min(axis=2)
    assert off_faces[on_box].max(initial=0) < STEP


def test_where_the_box_takes_half_the_ball_the_face_is_a_disc(cut):
    found = seen(instances(cut), (6, 0, 0), size=128)
    index, where = found["Object Index"][..., 0], found["Position"]
    assert (index == 2).sum() > 1000
    assert np.abs(where[index == 2][:, 0] - BOX[0][0]).max() < STEP
    normals = found["Normal"][index == 2]
    assert np.abs(np.abs(normals[:, 0]) - 1).max() < 1e-3
    # no ray gets between the ball and the face of the cut, but at its rim
    whole = seen([instances(cut)[0]], (6, 0, 0), size=128)["Object Index"][..., 0]
    bare = seen(
        [leapray.Instance(leapray.build(cut[0]), np.eye(4), object_index=1)], (6, 0, 0), 128
    )
    rim = bare["Object Index"][..., 0] > 0
    inner = (
        rim & np.roll(rim, 2, 0) & np.roll(rim, -2, 0) & np.roll(rim, 2, 1) & np.roll(rim, -2, 1)
    )
    assert (whole[inner] == 1).any()  # without the face one looks into the ball
    assert (index[inner] > 0).all()


def test_what_is_cut_away_casts_no_shadow(cut):
    """A light inside the part that is gone lights the face of the cut."""
    sun = leapray.Light("sun", (np.pi,) * 3, direction=(1, 0, 0))
    placed = instances(cut)
    view = stage.camera((6, 0, 0), size=(33, 33))
    scene = leapray.Scene(view, placed, [sun], [RED, GREEN], [0, 1])
    tile = scene.render_tile(16, 16, 1, 1, samples=1)
    assert tile["Combined"][0, 0] == pytest.approx([0, 1, 0, 1], abs=1e-3)


def test_the_rim_of_the_face_is_as_light_as_the_rest(cut):
    """The ball's surface that was cut away beside it casts no shadow, however near."""
    sun = leapray.Light("sun", (np.pi,) * 3, direction=(0.8, 0.6, 0))
    size = 300
    scene = leapray.Scene(
        stage.camera((6, 0, 0), size=(size, size)), instances(cut), [sun], [RED, GREEN], [0, 1]
    )
    rim = 0
    for turn in range(4):
        tile = scene.render_tile(
            0, 0, size, size, samples=1, seed=turn, passes=("Position", "Object Index")
        )
        face = tile["Object Index"][..., 0] == 2
        assert tile["Combined"][face][:, 1] == pytest.approx(0.8, abs=1e-3)
        rim += (np.linalg.norm(tile["Position"][face], axis=1) > 0.985).sum()
    assert rim > 1000


def test_the_face_has_the_color_of_the_values(cut):
    red, *_ = leapray.INPUTS
    program = leapray.compile_program((leapray.operate("multiply", red, 0.001), 0.25, 0.0))
    color = leapray.FieldColor(cut[0], np.eye(4), program, scale=2000.0, offset=-1000.0)
    lobes = (leapray.Lobe("emission", (1, 1, 1), textured=True),)
    view = stage.camera((6, 0, 0), size=(65, 65))
    scene = leapray.Scene(view, instances(cut, color), [], [RED, leapray.Material(lobes)], [0, 1])
    tile = scene.render_tile(0, 0, 65, 65, samples=1, passes=("Position", "Object Index"))
    face = tile["Object Index"][..., 0] == 2
    face &= np.linalg.norm(tile["Position"], axis=2) > 0.2  # off the tip of the cone of values
    radius = np.linalg.norm(tile["Position"][face], axis=1)
    assert tile["Combined"][face][:, 0] == pytest.approx(1 - radius, abs=0.01)
    assert tile["Combined"][face][:, 1] == pytest.approx(0.25)


def test_the_slope_is_that_of_the_world(cut):
    """The field falls by 1/2 per unit; an instance twice as large has half the slope."""
    red, *_ = leapray.INPUTS
    program = leapray.compile_program((red, 0.0, 0.0))
    lobes = (leapray.Lobe("emission", (1, 1, 1), textured=True),)
    for scale in (1.0, 2.0):
        placed = np.diag([scale, scale, scale, 1.0])
        color = leapray.FieldColor(cut[0], placed, program, part="slope")
        one = [leapray.Instance(leapray.build(cut[0]), placed, field_color=color)]
        scene = leapray.Scene(
            stage.camera((6, 1, 0), size=(9, 9)), one, [], [leapray.Material(lobes)], [0]
        )
        tile = scene.render_tile(4, 4, 1, 1, samples=1)
        assert tile["Combined"][0, 0, 0] == pytest.approx(0.5 / scale, rel=0.01)


def test_every_traverser_cuts_alike(cut):
    solid, box = cut
    first = None
    for each in leapray.traversers():
        if not each.exact:
            continue
        placed = np.eye(4)
        clip = [leapray.Clip(box, placed, margin=0.02)]
        one = [leapray.Instance(leapray.build(solid, each.spec), placed, 0, clips=clip)]
        depth = seen(one, (3, -3, 1), size=48)["Depth"]
        first = depth if first is None else first
        assert np.allclose(depth, first, rtol=1e-6), each.spec


def test_the_number_of_rays_in_a_tile_does_not_matter(cut):
    """A pixel of a tile is the same as alone, bit for bit, as for all instances."""
    placed = instances(cut)
    scene = leapray.Scene(stage.camera((3, -3, 1), size=(40, 40)), placed, [], [RED, GREEN], [0, 1])
    whole = scene.render_tile(0, 0, 40, 40, samples=2, passes=("Depth", "Position"))
    for x, y in ((20, 20), (13, 25), (30, 10)):
        alone = scene.render_tile(x, y, 1, 1, samples=2, passes=("Depth", "Position"))
        assert all((alone[name][0, 0] == whole[name][y, x]).all() for name in alone)


@pytest.mark.parametrize(
    ("clip", "sentence"),
    [
        (dict(world_from_object=np.zeros((4, 4))), "invertible matrix"),
        (dict(margin=-1.0), "the margin of what cuts instance 0 must be 0..1, it is -1"),
        (dict(margin=np.nan), "the margin of what cuts instance 0"),
        (dict(world_from_object=np.eye(3)), "shape"),
    ],
)
def test_a_wrong_clip_is_a_sentence(cut, clip, sentence):
    solid, box = cut
    clips = [leapray.Clip(**{"volume": box, "world_from_object": np.eye(4)} | clip)]
    one = [leapray.Instance(leapray.build(solid), np.eye(4), clips=clips)]
    with pytest.raises(leapray.LeapRayError, match=sentence):
        leapray.Scene(stage.camera((6, 0, 0)), one, [], [RED], [0])


def test_a_sheet_cuts_nothing():
    sheet = leapray.Volume(np.zeros((4, 4, 4), np.uint8), sheet=True)
    one = [
        leapray.Instance(leapray.build(ball()), np.eye(4), clips=[leapray.Clip(sheet, np.eye(4))])
    ]
    with pytest.raises(leapray.LeapRayError, match="instance 0 must be cut by finished solids"):
        leapray.Scene(stage.camera((6, 0, 0)), one, [], [RED], [0])
