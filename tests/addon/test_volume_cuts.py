# SPDX-License-Identifier: GPL-3.0-or-later
"""Volume objects that meshes cut open, and materials that colour them by their values."""

import json
from dataclasses import replace

import bpy
import numpy as np
import pytest
import vdb_files
from blender_scenes import colored, diffuse, light, mesh, plane, polygons, put, read, sunlit

import leapray
from addon import pipeline
from addon.blender import engine
from addon.blender.read import clips
from addon.store import memory_cache

SIZE = 96, 72
PASSES = "Combined", "Depth", "Position", "Normal", "Object Index", "Material Index", "Volume"
CENTRE = 0.3, -0.2, 0.5
TOP = 0.61  # of the plane at which the cube cuts, above the ball's middle


@pytest.fixture
def scene():
    return sunlit(SIZE, (0.3, -0.2, 6))


def values():
    """A ball whose values are 3 - 2 * distance from the middle: 1 on its surface."""
    return vdb_files.grid(3 - 2 * vdb_files.VOXEL * vdb_files.distances(), "density", "fog volume")


def ball(path, *materials, **settings):
    """A volume object at CENTRE with the surface where values are 1."""
    data = bpy.data.volumes.new("Ball")
    data.filepath = vdb_files.write(path / "ball.vdb", values())
    own = {"automatic": False, "threshold": 1.0} | settings
    for key, value in own.items():
        setattr(data.leapray, key, value)
    for each in materials:
        data.materials.append(each)
    return put("Ball", data, location=CENTRE, pass_index=1)


def cutter(data=None, **attributes):
    """A hidden cube whose lower side is TOP above the ball's middle."""
    told = {"location": (*CENTRE[:2], CENTRE[2] + TOP + 2), "scale": (1.5, 1.5, 2)} | attributes
    made = put("Cutter", mesh() if data is None else data, **told)
    made.hide_render = made.hide_viewport = True
    return made


def render():
    bpy.context.view_layer.update()
    return pipeline.render(replace(read(*SIZE), passes=PASSES))


def seen(frame):
    return frame.passes["Object Index"][..., 0] == 1


def on_face(frame):
    """Pixels that show the face of the cut: the second volume."""
    return frame.passes["Volume"][..., 0] == 2


def radius(frame, where):
    return np.linalg.norm(frame.passes["Position"][where] - np.array(CENTRE), axis=1)


def test_a_cube_cuts_a_ball_at_its_side(scene, tmp_path):
    inner = diffuse("Inner")
    inner.pass_index = 7
    ball(tmp_path, diffuse("Skin"), inner, clip_object=cutter())
    frame = render()
    assert frame.warnings == []
    surface, cut = frame.report["volumes"]
    assert (surface["kind"], cut["kind"], cut["name"]) == ("isosurface", "clip", "Ball")
    face = on_face(frame)
    assert face.sum() > 200
    assert frame.passes["Depth"][face] == pytest.approx(6 - CENTRE[2] - TOP, abs=1e-4)
    assert (frame.passes["Material Index"][face] == 7).all()
    assert np.abs(frame.passes["Normal"][face] @ (0, 0, 1)) == pytest.approx(1, abs=1e-3)
    assert radius(frame, face).max() < 1.01
    rest = seen(frame) & ~face
    assert rest.sum() > 50
    assert radius(frame, rest) == pytest.approx(1, abs=0.01)
    assert frame.passes["Position"][rest][:, 2].max() < CENTRE[2] + TOP + 0.01


def test_what_lies_in_the_cube_is_what_stays(scene, tmp_path):
    ball(tmp_path, clip_object=cutter(), clip_keep="inside")
    scene.camera.location, scene.camera.rotation_euler = (*CENTRE[:2], -6), (np.pi, 0, 0)
    frame = render()
    face = on_face(frame)
    assert face.sum() > 200
    assert (face != seen(frame)).sum() < 0.05 * face.sum()  # but at the rim
    assert frame.passes["Depth"][face] == pytest.approx(6 + CENTRE[2] + TOP, abs=1e-4)
    height = frame.passes["Position"][face][:, :2] - np.array(CENTRE[:2])
    assert np.linalg.norm(height, axis=1).max() == pytest.approx(np.sqrt(1 - TOP**2), abs=0.03)


@pytest.mark.parametrize("keep", ["outside", "inside"])
def test_a_turned_mirrored_and_sheared_cube_cuts_as_it_stands(keep, scene, tmp_path):
    """A level set with two surfaces: the faces lie on the cube, and end at the outer one."""
    cube = cutter(location=(0.5, 0.1, 1.4), rotation_euler=(0.4, 0.5, 0.3), scale=(0.9, -0.7, 0.8))
    cube.parent = put("Parent", None, rotation_euler=(0, 0.2, 0), scale=(1, 1, 1.3))
    ob = ball(tmp_path, threshold=0.0, surfaces=2, threshold_2=-0.1, clip_object=cube)
    ob.data.leapray.clip_keep = keep
    ob.data.filepath = vdb_files.write(tmp_path / "set.vdb", vdb_files.level_set())
    if keep == "inside":
        scene.camera.location, scene.camera.rotation_euler = (*CENTRE[:2], -6), (np.pi, 0, 0)
    frame = render()
    assert frame.warnings == []
    matrix = np.array(cube.parent.matrix_basis @ cube.matrix_parent_inverse @ cube.matrix_basis)
    local = (frame.passes["Position"] - matrix[:3, 3]) @ np.linalg.inv(matrix[:3, :3]).T
    outmost = np.abs(local).max(axis=2)
    face = frame.passes["Volume"][..., 0] == 3
    assert face.sum() > 100
    assert outmost[face] == pytest.approx(1, abs=1e-4)
    assert 0.98 < radius(frame, face).max() < 1.01
    rest = seen(frame) & ~face
    assert rest.any()
    assert ((outmost[rest] > 0.97) if keep == "outside" else (outmost[rest] < 1.03)).all()


def empty(kind="PLAIN_AXES", **attributes):
    told = {"location": (*CENTRE[:2], CENTRE[2] + TOP), "scale": (0.01, 3, -0.5)} | attributes
    made = put("Cutter", None, **told)
    made.empty_display_type = kind
    return made


def flat(kind):
    """A half-space that removes what lies above TOP."""
    if kind == "empty":
        return empty(scale=(0.01, 3, 0.5), rotation_euler=(0, 0, 0.3))
    if kind == "mirrored empty":
        return empty(rotation_euler=(np.pi, 0, 0.3))
    place = {"location": (*CENTRE[:2], CENTRE[2] + TOP), "scale": (1e-3, 2e-3, 1)}
    if kind == "plane":
        return cutter(plane(), **place)
    if kind == "turned polygon":  # its normal points down, until it is turned
        corners = [(x, y, 0.2) for x, y in ((-1, -1), (0, -3), (1, -1), (1, 1), (-1, 1))]
        place |= {"rotation_euler": (np.pi, 0, 0), "location": (0, 0, CENTRE[2] + TOP + 0.2)}
        return cutter(polygons("Five", corners, [(4, 3, 2, 1, 0)]), **place)
    return cutter(polygons("Three", [(0, 0, 0), (2, 0, 0), (0, 1, 0), (2, 1, 0)],
                           [(0, 1, 2), (1, 3, 2)]), **place)  # fmt: skip


@pytest.mark.parametrize("keep", ["outside", "inside"])
@pytest.mark.parametrize(
    "kind", ["empty", "mirrored empty", "plane", "turned polygon", "triangles"]
)
def test_a_plane_cuts_all_that_lies_before_it(kind, keep, scene, tmp_path):
    ball(tmp_path, clip_object=flat(kind), clip_keep=keep)
    if keep == "inside":
        scene.camera.location, scene.camera.rotation_euler = (*CENTRE[:2], -6), (np.pi, 0, 0)
    frame = render()
    assert frame.warnings == []
    face = on_face(frame)
    assert face.sum() > 200
    assert frame.passes["Position"][face][:, 2] == pytest.approx(CENTRE[2] + TOP, abs=1e-4)
    assert radius(frame, face).max() == pytest.approx(1, abs=0.02)
    rest = frame.passes["Position"][seen(frame) & ~face][:, 2] - CENTRE[2] - TOP
    assert (rest < 0.02).all() if keep == "outside" else (rest > -0.02).all()


@pytest.mark.parametrize("beyond", [3.0, -3.0])
def test_a_plane_beside_the_data_takes_nothing_or_all(beyond, scene, tmp_path):
    whole_cut = empty(location=(*CENTRE[:2], CENTRE[2] + beyond), scale=(1, 1, 1))
    ob = ball(tmp_path)
    whole = render().passes["Depth"]
    ob.data.leapray.clip_object = whole_cut
    frame = render()
    if beyond > 0:
        np.testing.assert_array_equal(frame.passes["Depth"], whole)
    else:
        assert not seen(frame).any()


def test_one_plane_cuts_all_places_of_the_data(scene, tmp_path):
    ob = ball(tmp_path, clip_object=empty(scale=(1, 1, 1)))
    other = put("Other", ob.data, location=(CENTRE[0] - 1.7, CENTRE[1], CENTRE[2] + 0.3),
                scale=(0.5, 0.7, 0.9), pass_index=1)  # fmt: skip
    frame = render()
    face = on_face(frame)
    assert frame.passes["Position"][face][:, 2] == pytest.approx(CENTRE[2] + TOP, abs=1e-4)
    near = abs(frame.passes["Position"][face][:, 0] - other.location.x) < 0.4
    assert near.sum() > 30 and (~near).sum() > 200


def test_an_empty_cube_cuts_by_what_it_shows(scene, tmp_path):
    cube = empty("CUBE", location=(*CENTRE[:2], CENTRE[2] + TOP + 1), scale=(0.2, 0.3, 0.5))
    cube.empty_display_size = 2.0  # of half its sides
    ball(tmp_path, clip_object=cube)
    frame = render()
    assert frame.warnings == []
    face = on_face(frame)
    place = frame.passes["Position"][face] - np.array(CENTRE)
    bottom = abs(place[:, 2] - TOP) < 1e-4
    assert bottom.sum() > 100
    assert np.abs(place[bottom][:, 0]).max() == pytest.approx(0.4, abs=0.04)
    assert np.abs(place[bottom][:, 1]).max() == pytest.approx(0.6, abs=0.06)
    assert frame.passes["Position"][seen(frame) & ~face][:, 2].max() > CENTRE[2] + TOP + 0.1


@pytest.mark.parametrize("kind", ["empty", "plane"])
def test_a_cut_may_be_keyed_off_by_hiding_it(kind, scene, tmp_path):
    """Shown in frame 1, hidden in frame 2, shown in frame 3; an empty moves, too."""
    cut = flat(kind)
    cut.hide_viewport = False
    ball(tmp_path, clip_object=cut)
    for rays in ("camera", "shadow", "diffuse", "glossy", "transmission"):
        setattr(cut, f"visible_{rays}", False)
    for frame in (1, 2, 3):
        cut.hide_render = frame == 2
        cut.keyframe_insert("hide_render", frame=frame)
        cut.location.z = CENTRE[2] + TOP + 0.1 * (frame - 1)
        cut.keyframe_insert("location", frame=frame)
    heights = []
    for frame in (1, 2, 3):
        scene.frame_set(frame)
        bpy.ops.render.render()
        (report,) = engine.reports.values()
        assert report["warnings"] == []
        assert [row["kind"] for row in report["volumes"]] == ["isosurface", "clip"][
            : 1 + (frame != 2)
        ]
        if frame != 2:
            made = render()
            heights.append(np.median(made.passes["Position"][on_face(made)][:, 2]))
    assert np.diff(heights) == pytest.approx(0.2, abs=1e-3)


@pytest.mark.parametrize(("attribute", "socket"), [("density", "Fac"), ("value", "Color")])
def test_the_face_has_the_colors_of_the_values(attribute, socket, scene, tmp_path):
    ball(tmp_path, diffuse("Skin"), colored("Inner", attribute, socket), clip_object=cutter())
    frame = render()
    assert frame.warnings == []
    # whole pixels of the face, whose samples all lie on it, at the mean of their values
    face = on_face(frame)
    for axis in (0, 1):
        face &= np.roll(on_face(frame), 1, axis) & np.roll(on_face(frame), -1, axis)
    share = (3 - 2 * radius(frame, face)) / 3
    assert share.min() < 0.4 and share.max() > 0.58
    color = frame.passes["Combined"][face]
    assert color[:, 0] == pytest.approx(1 - share, abs=0.01)
    assert color[:, 1] == pytest.approx(share, abs=0.01)


def test_a_surface_has_the_color_of_the_slope_in_the_world(scene, tmp_path):
    """Values fall by 2 per unit; by 1 where the object is twice as large."""
    ob = ball(tmp_path, colored("Slope", "gradient", high=4.0))
    for scale in (1.0, 2.0):
        ob.scale = (scale,) * 3
        frame = render()
        assert frame.warnings == []
        color = frame.passes["Combined"][SIZE[1] // 2, SIZE[0] // 2]
        assert color[:2] == pytest.approx((1 - 0.5 / scale, 0.5 / scale), abs=0.01)


def test_a_level_sets_values_keep_their_sign(scene, tmp_path):
    """Stored numbers are turned round where the solid lies below the threshold."""
    ob = ball(tmp_path, colored("Values", "ball", "Color", -0.1, 0.1), threshold=0.05)
    ob.data.filepath = vdb_files.write(tmp_path / "set.vdb", vdb_files.level_set())
    color = render().passes["Combined"][SIZE[1] // 2, SIZE[0] // 2]
    assert color[:2] == pytest.approx((0.25, 0.75), abs=0.01)


@pytest.mark.parametrize("layout", ["objects", "scene"])
def test_beside_meshes_and_for_one_pixel_a_cut_is_the_same(layout, scene, tmp_path):
    scene.leapray.layout = layout
    inner = diffuse("Inner")
    inner.pass_index = 7
    ball(tmp_path, diffuse("Skin"), inner, clip_object=cutter())
    put("Cube", mesh(size=0.3), location=(2, 0, 0), pass_index=2)
    frame = render()
    face = frame.passes["Volume"][..., 0] == 3
    assert (frame.passes["Material Index"][face] == 7).all() and face.sum() > 200
    assert (frame.passes["Object Index"][face] == 1).all()
    y, x = (int(each[len(each) // 2]) for each in np.nonzero(face))
    told = pipeline.render(read(*SIZE), pixel=(x, y)).report["pixel"]
    assert '"material": "Inner"' in json.dumps(told) and '"object": "Ball"' in json.dumps(told)


def test_frames_of_one_cut_keep_its_volume(scene, tmp_path, monkeypatch):
    ball(tmp_path, clip_object=cutter())
    made, voxelize = [], leapray.voxelize
    monkeypatch.setattr(leapray, "voxelize", lambda *a, **b: made.append(a) or voxelize(*a, **b))
    cache = memory_cache.Cache()
    bpy.context.view_layer.update()
    for _ in range(2):
        pipeline.render(read(*SIZE), cache=cache)
    assert len(made) == 1


def test_a_reopened_file_is_cut_alike(scene, tmp_path):
    ball(tmp_path, colored("Inner"), clip_object=cutter(), clip_keep="inside")
    before = render().passes["Combined"]
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    own = bpy.data.volumes["Ball"].leapray
    assert own.clip_object.name == "Cutter" and own.clip_keep == "inside"
    np.testing.assert_array_equal(render().passes["Combined"], before)


@pytest.mark.parametrize("hidden", [False, True])
def test_parents_of_what_cuts_count_and_modifiers_where_it_is_shown(
    hidden, scene, tmp_path, monkeypatch
):
    cube = cutter(parent=put("Parent", None, location=(0, 0, -0.2)))
    cube.hide_viewport = hidden
    ball(tmp_path, clip_object=cube)
    move = cube.modifiers.new("Up", "DISPLACE")
    move.direction, move.space, move.strength, move.mid_level = "Z", "LOCAL", 0.1, 0.0
    made = []
    reading = clips.read_clip
    monkeypatch.setattr(clips, "read_clip", lambda *told: made.append(reading(*told)) or made[-1])
    bpy.ops.render.render()
    (clip,) = made
    height = clip.mesh.vertices @ clip.world_from_object[2, :3] + clip.world_from_object[2, 3]
    assert height.min() == pytest.approx(CENTRE[2] + TOP - 0.2 + 0.2 * (not hidden), abs=1e-5)


@pytest.mark.parametrize("hidden", ["renders", "everywhere", "rays"])
def test_an_animation_moves_what_cuts_unless_it_is_hidden_from_renders(
    hidden, scene, tmp_path, monkeypatch
):
    cube = cutter()
    cube.hide_render, cube.hide_viewport = hidden != "rays", hidden == "everywhere"
    for rays in ("camera", "shadow", "diffuse", "glossy", "transmission"):
        setattr(cube, f"visible_{rays}", False)
    ball(tmp_path, clip_object=cube)
    for frame in (1, 2):
        cube.location.z = frame
        cube.keyframe_insert("location", frame=frame)
    scene.frame_set(1)
    scene.frame_start, scene.frame_end = 1, 2
    scene.render.resolution_x = scene.render.resolution_y = 8
    scene.render.filepath = str(tmp_path / "frame")
    heights, warned = [], []
    reading = clips.read_clip

    def read_clip(ob, own, depsgraph, notes):
        clip = reading(ob, own, depsgraph, notes)
        heights.append(clip.world_from_object[2, 3])
        warned.append(any("'Cutter' is animated" in each for each in notes.sentences()))
        return clip

    monkeypatch.setattr(clips, "read_clip", read_clip)
    bpy.ops.render.render(animation=True)
    for height, frame, told in zip(heights, (1, 2), warned, strict=True):
        assert told or height == pytest.approx(frame)
    assert any(warned) == (hidden != "rays")


def wrong(kind):
    """An object that cannot cut, and words of the sentence on it."""
    if kind == "no mesh":
        ob = cutter()
        bpy.data.volumes["Ball"].leapray.clip_object = ob
        return put("Cutter.lamp", light("POINT")), "neither a mesh nor an empty"
    if kind == "open":
        bowl = cutter()
        bowl.data = polygons("Bowl", [tuple(v.co) for v in bowl.data.vertices],
                             [tuple(p.vertices) for p in bowl.data.polygons][:-1])  # fmt: skip
        return bowl, "no solid"
    return cutter(bpy.data.meshes.new("Empty")), "no faces"


@pytest.mark.parametrize("kind", ["no mesh", "open", "empty"])
def test_what_cannot_cut_is_named_and_the_data_are_whole(kind, scene, tmp_path):
    ob = ball(tmp_path)
    whole = render().passes["Depth"]
    ob.data.leapray.clip_object, words = wrong(kind)
    assert ob.data.leapray.clip_object
    frame = render()
    (warning,) = frame.warnings
    assert "'Ball'" in warning and "'Cutter" in warning and words in warning
    np.testing.assert_array_equal(frame.passes["Depth"], whole)


def test_open_data_have_no_faces_of_a_cut(scene, tmp_path):
    ball(tmp_path, capped=False, clip_object=cutter())
    frame = render()
    assert frame.warnings == [] and seen(frame).any() and not on_face(frame).any()


def test_the_engine_cuts_by_an_object_that_it_does_not_render(scene, tmp_path):
    cube = cutter()
    scene.collection.objects.unlink(cube)
    ball(tmp_path, clip_object=cube)
    bpy.ops.render.render()
    (report,) = engine.reports.values()
    assert [row["kind"] for row in report["volumes"]] == ["isosurface", "clip"]
    assert report["warnings"] == []
