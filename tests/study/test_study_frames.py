# SPDX-License-Identifier: GPL-3.0-or-later
"""Scenes made comparable: the view that metrics use is Cycles'; indices, rims and materials."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

bpy = pytest.importorskip("bpy")
pytest.importorskip("flip_evaluator")
pytest.importorskip("matplotlib")

from addon.blender import open_file  # noqa: E402
from addon.blender.read import looks  # noqa: E402
from addon.study import compare, cycles_volumes, frames, kept  # noqa: E402
from leapray import LeapRayError  # noqa: E402

SAMPLES = Path(__file__).resolve().parents[2] / "blend_samples"


def opened(name, percentage=10):
    scene = open_file.open_scene(SAMPLES / f"{name}.blend")
    scene.render.resolution_percentage = percentage
    return scene


@pytest.mark.parametrize("name", ["suzanne", "cad"])  # perspective, orthographic
def test_cycles_sees_points_where_the_view_puts_them(name, tmp_path):
    scene = opened(name)
    scene.camera.data.shift_x, scene.camera.data.shift_y = 0.11, -0.07
    subject = frames.examine(scene, frames.prepare(scene))
    frame = frames.render_cycles(scene, tmp_path / "frame.exr", 1)
    seen = frame.index > 0
    assert 0.2 < seen.mean() <= 1
    film, depth = subject.view.film(frame.passes["Position"][seen].astype(float))
    rows, columns = np.nonzero(seen)
    # Positions are f32: 1e-4 of a pixel or so; the floor's are large.
    assert_allclose(film, np.stack([columns, rows], axis=1) + 0.5, atol=5e-3)
    assert_allclose(depth, frame.passes["Depth"][seen], rtol=1e-4)
    shown = {subject.names[k] for k in np.unique(frame.index[seen])}
    assert shown == {"suzanne": {"Suzanne", "Floor"}, "cad": {"Bracket"}}[name]


def test_surfaces_of_volume_objects_are_left_out_and_told_and_clouds_stay():
    scene = opened("cad")
    surface, cloud = (
        bpy.data.objects.new(name, bpy.data.volumes.new(name)) for name in ("Surface", "Cloud")
    )
    for each in (surface, cloud):
        scene.collection.objects.link(each)
    cloud.data.leapray.shown = "volume"
    notes = frames.prepare(scene)
    assert "Surface was left out, which Cycles renders as a cloud" in notes
    assert surface.hide_render and not cloud.hide_render
    assert not any("Cloud" in note for note in notes)


def test_volume_materials_stay_where_surfaces_become_diffuse():
    opened("xray")
    before = [node.bl_idname for node in bpy.data.materials["Film"].node_tree.nodes]
    assert looks.is_alone(bpy.data.materials["Film"])
    assert "Film" not in frames.make_diffuse()
    assert [node.bl_idname for node in bpy.data.materials["Film"].node_tree.nodes] == before


def test_cycles_sees_a_scan_that_only_leapray_reads(tmp_path):
    """X-rays through the head: where they pass not the face of the data where the neck is cut."""
    scene = opened("xray", 10)
    frames.prepare(scene)
    blank = frames.render_cycles(scene, tmp_path / "blank.exr", 1).passes["Combined"][..., 0]
    notes = cycles_volumes.give(scene, tmp_path)
    assert [note.partition(" through ")[0] for note in notes] == ["Cycles sees the data of Head"]
    theirs = frames.render_cycles(scene, tmp_path / "frame.exr", 64).passes["Combined"][..., 0]
    ours = frames.render_leapray(scene, tmp_path / "frame.exr", 16, "cd").passes["Combined"][..., 0]
    assert blank.min() == 1 and theirs.min() < 0.2
    blocks, others = (
        picture[18:].reshape(9, 6, 12, 6).mean(axis=(1, 3)) for picture in (ours, theirs)
    )
    assert ours.shape == (72, 72) and blocks.min() < 0.4
    assert_allclose(blocks, others, atol=0.015)


def test_rims_of_sheets_are_seen_and_closed_meshes_have_none(tmp_path):
    scene = opened("thin", 20)
    subject = frames.examine(scene, frames.prepare(scene))
    paper = bpy.data.objects["Paper"]
    corners = np.array([paper.matrix_world @ v.co for v in paper.data.vertices])
    ends = np.concatenate([subject.rim_starts, subject.rim_ends])
    on_paper = (np.abs(corners[:, None] - ends[None]).max(axis=2) < 1e-5).any(axis=1)
    assert on_paper.sum() == 2 * (40 + 28)  # the rim of its 40 x 28 faces, once around
    frame = frames.render_cycles(scene, tmp_path / "frame.exr", 1)
    geometry = compare.Geometry(subject, frame, frame)
    rims, index = geometry.sheet_rims, frame.index
    names = {name: k for k, name in subject.names.items()}
    inside = index == names["Wires"]
    edge = compare.metrics.mixed(index)
    leaf = edge & (index == names["Red leaf"])
    assert (rims & leaf).sum() > 0.95 * leaf.sum()
    assert (rims & inside).sum() < 0.05 * inside.sum()  # where a leaf is near
    assert geometry.told()["index"]["all"]["n"] == 0
    assert np.nanmax(geometry.depth_error) == 0


def test_materials_become_diffuse_of_the_colour_that_leapray_draws():
    scene = opened("sphere")
    glossy = bpy.data.materials.new("Glossy")
    if glossy.node_tree is None:  # before 5.0
        glossy.use_nodes = True
    glossy.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (
        0.1,
        0.6,
        0.3,
        1,
    )
    plain = bpy.data.materials.new("Plain")
    plain.diffuse_color = (0.7, 0.2, 0.1, 1)
    if plain.node_tree is not None:
        plain.node_tree.nodes.clear()
    notes = frames.prepare(scene)
    assert [note.split()[0] for note in notes if "Coral" in note] == []  # is diffuse as it is
    assert any("Glossy" in note for note in notes)
    for material, color in ((glossy, (0.1, 0.6, 0.3)), (plain, (0.7, 0.2, 0.1))):
        output = material.node_tree.get_output_node("CYCLES")
        shader = output.inputs["Surface"].links[0].from_node
        assert shader.type == "BSDF_DIFFUSE"
        assert_allclose(shader.inputs["Color"].default_value[:3], color, rtol=1e-6)


def test_white_is_what_a_lit_white_plane_shows(tmp_path):
    scene = opened("sphere")
    ball = bpy.data.objects["Ball"]
    sun = next(each for each in scene.objects if each.type == "LIGHT")
    ball.modifiers.clear()
    bpy.data.materials["Coral"].node_tree.nodes["Diffuse BSDF"].inputs[0].default_value = (1,) * 4
    scene.camera.matrix_world = sun.matrix_world
    subject = frames.examine(scene, frames.prepare(scene))
    frames.blacken_world(scene)
    frame = frames.render_cycles(scene, tmp_path / "frame.exr", 1)
    brightest = frame.passes["Combined"][..., :3].max()
    assert brightest == pytest.approx(subject.white, rel=0.01)


def test_cycles_gets_leaprays_limits_of_bounces_and_loses_them_for_geometry():
    scene = opened("still")
    scene.leapray.max_bounces, scene.leapray.glossy_bounces = 9, 3
    scene.leapray.transmission_bounces, scene.leapray.transparent_bounces = 7, 5
    names = {m.name for m in bpy.data.materials if frames.refracting(m)}
    assert names
    frames.prepare(scene, plain=False, diffuse_bounces=2)
    limits = {"max": 9, "diffuse": 2, "glossy": 3, "transmission": 7, "transparent_max": 5}
    for kind, most in limits.items():
        assert getattr(scene.cycles, f"{kind}_bounces") == most
    assert {m.name for m in bpy.data.materials if frames.refracting(m)} == names  # they stay
    sun = bpy.data.lights.new("Wide", "SUN")
    sun.angle = 0.3
    with frames.sharp(scene):
        assert {getattr(scene.cycles, f"{kind}_bounces") for kind in limits} == {0}
        assert scene.leapray.max_bounces == scene.leapray.glossy_bounces == 0
        assert sun.angle == 0
    assert sun.angle == pytest.approx(0.3)
    for kind, most in limits.items():
        assert getattr(scene.cycles, f"{kind}_bounces") == most
    frames.prepare(scene, plain=True)
    assert not any(frames.refracting(m) for m in bpy.data.materials)
    assert scene.cycles.max_bounces == scene.leapray.diffuse_bounces == 0


def test_a_reference_is_kept_for_what_it_was_made_for(tmp_path, monkeypatch):
    scene = opened("sphere", 10)
    frames.prepare(scene)
    first = kept.reference(scene, tmp_path / "frame.exr", 2, tmp_path / "kept")
    render = frames.render_cycles
    monkeypatch.setattr(frames, "render_cycles", None)
    again = kept.reference(scene, tmp_path / "none.exr", 2, tmp_path / "kept")
    assert first.seconds > again.seconds == 0
    assert_array_equal(first.passes["Combined"], again.passes["Combined"])
    scene.render.resolution_percentage = 5
    small = kept.reference(scene, tmp_path / "none.exr", 8, tmp_path / "kept")
    first = first.passes["Combined"]
    parts = [first[j::2, i::2] for j in (0, 1) for i in (0, 1)]
    assert_allclose(small.passes["Combined"], np.mean(parts, axis=0), rtol=1e-6)
    assert scene.render.resolution_percentage == 5
    scene.render.resolution_percentage = 10
    monkeypatch.setattr(frames, "render_cycles", render)
    scene.leapray.max_bounces += 1
    kept.reference(scene, tmp_path / "frame.exr", 2, tmp_path / "kept")
    kept.reference(scene, tmp_path / "frame.exr", 3, tmp_path / "kept")
    assert len(list((tmp_path / "kept").iterdir())) == 3
    (tmp_path / "file").touch()
    with pytest.raises(LeapRayError, match="file cannot keep reference frames"):
        kept.reference(scene, tmp_path / "frame.exr", 2, tmp_path / "file")
