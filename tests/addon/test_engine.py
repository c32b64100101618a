# SPDX-License-Identifier: GPL-3.0-or-later
"""The engine in a session of Blender's: passes, borders, layers, frames, errors."""

import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import bpy
import numpy as np
import pytest
from blender_scenes import combined, diffuse, exr, fresh, light, mesh, plane, put, read
from mathutils import Vector
from numpy.testing import assert_allclose, assert_array_equal

import addon
import leapray
from addon import model, pipeline
from addon.blender import engine, open_file, properties, result, ui
from addon.blender.read import scene as scene_module
from addon.plan import plan
from addon.store import volume_files


@pytest.fixture
def scene():
    """A cube above a plane, 64 x 48 pixels, one sample."""
    made = fresh()
    put("Cube", mesh(), location=(0, 0, 1), rotation_euler=(0.4, 0.5, 0.6), pass_index=3)
    put("Ground", plane(size=6.0), pass_index=1).data.materials.append(diffuse("Ground"))
    put("Sun", light("SUN", energy=3.0), rotation_euler=(0.5, 0.3, 0.0))
    made.leapray.samples = 1
    made.leapray.tile_size = 24
    bpy.context.view_layer.update()
    return made


def render_exr(scene, path):
    open_file.set_format(scene, path)
    open_file.render_frame(scene)
    return exr(path)


def of_layer(channels, layer, each):
    """One pass as (h, w, channels)."""
    names = [f"{layer}.{each.blender_name()}.{letter}" for letter in each.channels]
    return np.stack([channels[name] for name in names], axis=2)


def test_a_multilayer_exr_holds_the_passes_of_the_pipeline(scene, tmp_path):
    open_file.set_format(scene, tmp_path / "out.exr")  # asks for all passes
    want = pipeline.render(read()).passes
    got = render_exr(scene, tmp_path / "out.exr")
    assert {each.name for each in result.PASSES} == {*want, "Value"}  # which projections have
    for each in result.PASSES:
        held = of_layer(got, "ViewLayer", each)
        wanted = want.get(each.name, np.zeros((1, 1, 1)))
        assert_array_equal(held, np.broadcast_to(wanted, held.shape), each.name)
    assert set(np.unique(want["Object Index"])) == {0, 1, 3}  # there was something to compare


def test_only_the_passes_that_the_layer_asks_for_are_there(scene, tmp_path):
    open_file.set_format(scene, tmp_path / "out.exr")
    layer = bpy.context.view_layer
    for each in result.PASSES[1:]:
        setattr(each.owner(layer), each.switch, each.name == "Normal")
    open_file.render_frame(scene)
    names = {name.split(".")[1] for name in exr(tmp_path / "out.exr") if name.count(".") == 2}
    assert names == {"Combined", "Normal"}


def depth(scene, path):
    (channel,) = (values for name, values in render_exr(scene, path).items() if ".Depth." in name)
    return channel


@pytest.mark.parametrize("crop", [True, False])
def test_a_border_renders_its_part_of_the_frame(scene, tmp_path, crop):
    whole = depth(scene, tmp_path / "whole.exr")
    render = scene.render
    render.use_border, render.use_crop_to_border = True, crop
    render.border_min_x, render.border_max_x = 0.203, 0.7
    render.border_min_y, render.border_max_y = 0.333, 0.6667
    part = depth(scene, tmp_path / "part.exr")
    x, y = slice(12, 44), slice(15, 32)
    if not crop:
        assert part.shape == (48, 64)
        part = part[y, x]
    assert_allclose(part, whole[y, x], rtol=1e-6)  # film corner in another place


def test_resolution_percentage_and_transparent_film(scene):
    scene.render.resolution_percentage = 50
    scene.render.film_transparent = True
    bpy.ops.render.render()
    image = combined(scene)
    assert image.shape == (24, 32, 4)
    assert image[12, 16, 3] == 1 and image[0, 0, 3] == 0
    assert_array_equal(image[0, 0], 0)


def test_an_animation_moves(scene, tmp_path):
    cube = bpy.data.objects["Cube"]
    for frame, x in ((1, -1.5), (3, 1.5)):
        cube.location.x = x
        cube.keyframe_insert("location", frame=frame)
    open_file.set_format(scene, tmp_path / "frame_.exr")
    scene.render.filepath = str(tmp_path / "frame_")
    scene.frame_start, scene.frame_end = 1, 3
    for kept in (False, True):  # with and without volumes kept between frames
        scene.render.use_persistent_data = kept
        with open_file.quiet():
            bpy.ops.render.render(animation=True)
        places = []
        for frame in (1, 2, 3):
            (index,) = (
                values
                for name, values in exr(tmp_path / f"frame_{frame:04}.exr").items()
                if name.split(".")[1] in ("Object Index", "IndexOB")
            )
            places.append(np.argwhere(index == 3)[:, 1].mean())
        assert np.diff(places).min() > 3
        assert bool(engine._volumes) == kept


def test_each_view_layer_gets_its_own_picture(scene, tmp_path):
    second = scene.view_layers.new("Second")
    hidden = bpy.data.collections.new("Hidden")
    scene.collection.children.link(hidden)
    cube = bpy.data.objects["Cube"]
    hidden.objects.link(cube)
    scene.collection.objects.unlink(cube)
    second.layer_collection.children["Hidden"].exclude = True
    channels = render_exr(scene, tmp_path / "out.exr")
    (index,) = (each for each in result.PASSES if each.name == "Object Index")
    assert 3 in of_layer(channels, "ViewLayer", index)
    assert set(np.unique(of_layer(channels, "Second", index))) == {0, 1}
    assert set(engine.reports) == {"ViewLayer", "Second"}


def test_what_was_left_out_is_reported_as_a_warning(scene, capfd):
    put("Nothing", bpy.data.meshes.new("Nothing"))
    bpy.ops.render.render()
    told = "".join(capfd.readouterr())
    assert "Warning: Skipped 'Nothing': its mesh has no faces" in told


def test_an_error_is_one_sentence_and_the_session_lives_on(scene):
    for ob in list(bpy.data.objects):
        ob.hide_render = ob.type == "MESH"
    with pytest.raises(RuntimeError, match="Error: Scene 'Scene' shows nothing that can"):
        bpy.ops.render.render()
    for ob in bpy.data.objects:
        ob.hide_render = False
    assert bpy.ops.render.render() == {"FINISHED"}
    assert engine.failures == {} and list(engine.reports) == ["ViewLayer"]
    scene.camera = None
    with pytest.raises(RuntimeError, match="camera"):
        bpy.ops.render.render()


def test_a_fault_of_our_own_is_reported_too(scene, monkeypatch):
    def broken(*_, **__):
        raise ZeroDivisionError("a fault")

    monkeypatch.setattr(pipeline, "render", broken)
    with pytest.raises(RuntimeError, match="ZeroDivisionError: a fault"):
        bpy.ops.render.render()
    monkeypatch.undo()
    assert bpy.ops.render.render() == {"FINISHED"}


def test_over_the_budget_is_an_error_in_the_session(scene):
    scene.leapray.memory_mb, scene.leapray.resolution = 1, 2000
    with pytest.raises(RuntimeError, match="MB"):
        bpy.ops.render.render()


def test_cancelling_is_no_error_and_leaves_no_thread(scene, monkeypatch):
    real, asked = pipeline.render, []

    def cancelled(job, *, stop, **others):
        def soon():
            asked.append(stop())  # Blender's own answer
            return len(asked) > 3

        return real(job, stop=soon, **others)

    monkeypatch.setattr(pipeline, "render", cancelled)
    scene.leapray.samples = 4096
    for _ in range(3):
        asked.clear()
        assert bpy.ops.render.render() == {"FINISHED"}
        assert len(asked) >= 4 and not any(asked)
        assert isinstance(engine.failures["ViewLayer"], leapray.Stopped) and not engine.reports
        assert [t.name for t in threading.enumerate() if t.name.startswith("leapray")] == []


def test_every_setting_is_a_property(scene):
    known = scene.leapray.bl_rna.properties
    stored = {p.identifier for p in known if not p.identifier.startswith(("auto_", "use_"))}
    assert stored - {"rna_type", "name"} | {"threads"} == set(model.Settings.__dataclass_fields__)
    assert properties.settings(scene).samples == 1
    fresh(settings={})
    default = properties.settings(bpy.context.scene)
    assert leapray.traverser(default.traverser) == leapray.traverser()
    for name, value in vars(model.Settings(traverser=default.traverser)).items():
        held = getattr(default, name)  # in single precision
        assert held == (np.float32(value) if isinstance(value, float) else value), name
    bpy.context.scene.render.threads_mode = "FIXED"
    bpy.context.scene.render.threads = 3
    assert properties.settings(bpy.context.scene).threads == 3


def test_panels_join_and_leave():
    def joined():
        return [p for p in bpy.types.Panel.__subclasses__() if ui.ENGINE in engines(p)]

    def engines(panel):
        return getattr(panel, "COMPAT_ENGINES", ())

    names = {panel.__name__ for panel in joined()}
    assert {"RENDER_PT_format", "RENDER_PT_output", "VIEWLAYER_PT_layer_passes"} <= names
    assert {"DATA_PT_lens", "EEVEE_MATERIAL_PT_surface", "EEVEE_WORLD_PT_surface"} <= names
    assert not any("freestyle" in name for name in names)
    addon.unregister()
    try:
        assert joined() == [] and not hasattr(bpy.types.Scene, "leapray")
    finally:
        addon.register()
    assert {panel.__name__ for panel in joined()} == names


def test_an_objects_volume_is_exported_as_it_is_voxelized(scene, tmp_path):
    cube = bpy.data.objects["Cube"]
    cube.modifiers.new("Bevel", "BEVEL").width = 0.3
    bpy.context.view_layer.objects.active = cube
    path = tmp_path / "cube.vdb"
    bpy.ops.object.leapray_export_vdb(filepath=str(path), resolution=40, space="OBJECT")
    got = volume_files.read(path)
    (mine,) = (m for m in read().meshes if m.name == "Cube")
    assert len(mine.triangles) > 12
    want = leapray.voxelize(mine.vertices, mine.triangles, plan.fixed_size(mine, 40))
    assert got.info.size == want.info.size and 38 <= max(got.info.size) <= 48
    assert_array_equal(got.read((0, 0, 0), got.info.size), want.read((0, 0, 0), want.info.size))
    assert_array_equal(got.info.object_from_index, want.info.object_from_index)
    for bad in (scene.camera, put("Empty", None)):
        bpy.context.view_layer.objects.active = bad
        with pytest.raises(RuntimeError, match=f"'{bad.name}' is not exported: its mesh has no"):
            bpy.ops.object.leapray_export_vdb(filepath=str(path))


def test_an_object_says_how_it_is_modelled(scene):
    cube, ground = bpy.data.objects["Cube"], bpy.data.objects["Ground"]
    twin = put("Twin", cube.data)  # shares the mesh, not the choice
    cube.leapray.kind, cube.leapray.resolution = "sheet", 48
    inside = bpy.data.objects.new("Inside", mesh("Inside"))  # seen as an instance alone
    inside.leapray.kind = "solid"
    group = bpy.data.collections.new("Group")
    group.objects.link(inside)
    put("Placed", None, instance_type="COLLECTION", instance_collection=group, location=(0, 0, -9))
    bpy.context.view_layer.update()
    got = read()
    at = {i.name: got.meshes[i.mesh].modelling for i in got.instances}
    assert at["Cube"] == model.Modelling("sheet", 48)
    assert at["Twin"] == at["Ground"] == model.Modelling()
    assert at["Inside"] == model.Modelling("solid")
    rows = {row["name"]: row for row in pipeline.render(got).report["volumes"]}
    assert (rows["Cube"]["kind"], rows[twin.name]["kind"]) == ("sheet", "solid")
    assert 36 <= max(rows["Cube"]["size"]) <= 48 and not rows["Cube"]["stuck"]
    assert rows[ground.name]["kind"] == "sheet"  # as it is open


def test_the_mist_pass_is_the_worlds(scene):
    mist = scene.world.mist_settings
    mist.start, mist.depth, mist.falloff = 2.0, 6.0, "LINEAR"
    assert read().mist == (2.0, 6.0, "LINEAR")
    bpy.context.view_layer.use_pass_mist = bpy.context.view_layer.use_pass_position = True
    passes = pipeline.render(read()).passes
    seen = passes["Position"].any(axis=2)
    deep = np.linalg.norm(passes["Position"][seen] - (0, 0, 10), axis=1)
    assert_allclose(
        passes["Mist"][seen, 0], np.clip((deep - 2) / 6, 0, 1), atol=0.01
    )  # means over the pixel against its centre


def test_the_volume_pass_numbers_the_volumes_of_the_report(scene):
    layer = bpy.context.view_layer
    layer.leapray.use_pass_volume = layer.leapray.use_pass_error = True
    frame = pipeline.render(read())
    names = [row["name"] for row in frame.report["volumes"]]
    shown = frame.passes["Volume"][..., 0]
    middle = shown[24, 32]
    assert names[int(middle) - 1] == "Cube" and set(np.unique(shown)) == {0, 1, 2}
    assert (frame.passes["Error"][shown > 0] < 1.0).all()


def test_an_exported_volume_opens_in_blender_where_the_object_is(scene, tmp_path):
    cube = bpy.data.objects["Cube"]
    cube.location, cube.scale = (3.0, -2.0, 1.0), (2.0, 1.0, 0.5)
    bpy.context.view_layer.update()
    bpy.context.view_layer.objects.active = cube
    path = tmp_path / "cube.vdb"
    bpy.ops.object.leapray_export_vdb(filepath=str(path), resolution=64)
    bpy.ops.object.volume_import(filepath=str(path))
    opened = bpy.context.object
    assert opened.type == "VOLUME" and opened.data.grids.load()
    assert [grid.name for grid in opened.data.grids] == ["density"]
    (grid,) = volume_files._grids(path)  # Blender's module reads what Blender shows
    lo, hi = (np.array(grid.transform.indexToWorld(c)) for c in grid.evalActiveVoxelBoundingBox())
    corners = np.array([cube.matrix_world @ Vector(corner) for corner in cube.bound_box])
    assert_allclose((lo + hi) / 2, (corners.min(axis=0) + corners.max(axis=0)) / 2, atol=0.1)
    place = volume_files.read(path).info.object_from_index
    turned = np.array(cube.matrix_world)[:3, :3]
    assert_allclose(np.linalg.solve(turned, place[:3, :3]) / place[0, 0] * turned[0, 0], np.eye(3),
                    atol=1e-6)  # fmt: skip
    values, _ = volume_files.read(path).sample(corners * 0.98 + np.array(cube.location) * 0.02)
    outside, _ = volume_files.read(path).sample(corners * 1.2 - np.array(cube.location) * 0.2)
    assert (values > 0.2).all() and (outside < 0.2).all()


def test_an_empty_view_layer_among_others_is_named_and_shows_the_world(scene, tmp_path):
    hidden = bpy.data.collections.new("Hidden")
    scene.collection.children.link(hidden)
    for name in ("Cube", "Ground"):
        hidden.objects.link(bpy.data.objects[name])
        scene.collection.objects.unlink(bpy.data.objects[name])
    empty = scene.view_layers.new("Nothing here")
    empty.layer_collection.children["Hidden"].exclude = True
    channels = render_exr(scene, tmp_path / "out.exr")
    (index,) = (each for each in result.PASSES if each.name == "Object Index")
    assert 3 in of_layer(channels, "ViewLayer", index)
    assert_array_equal(of_layer(channels, "Nothing here", index), 0)
    assert engine.failures == {}
    told = engine.reports["Nothing here"]["warnings"]
    assert told == ["View layer 'Nothing here' shows nothing that can be rendered"]


@pytest.mark.alone
def test_reading_is_cancelled_too(scene, monkeypatch):
    for number in range(50):
        put(f"Copy {number}", mesh())
    bpy.context.view_layer.update()
    real = scene_module.read_mesh

    def slowly(*words):
        time.sleep(0.02)
        return real(*words)

    monkeypatch.setattr(scene_module, "read_mesh", slowly)
    began = time.monotonic()
    with pytest.raises(leapray.Stopped):
        scene_module.read(bpy.context.evaluated_depsgraph_get(), 64, 48, stop=lambda: True)
    assert time.monotonic() - began < 0.3  # all of them would take a second


def test_a_missing_library_is_named_with_what_it_lacks(scene, tmp_path):
    library = tmp_path / "library.blend"
    bpy.data.libraries.write(str(library), {bpy.data.objects["Cube"]})
    fresh()
    put("Here", mesh())
    with bpy.data.libraries.load(str(library), link=True) as (_, linked):
        linked.objects = ["Cube"]
    bpy.context.scene.collection.objects.link(linked.objects[0])
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "user.blend"))
    library.unlink()
    with open_file.quiet():
        bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "user.blend"))
    (warning,) = read().warnings
    assert warning == "Library '//library.blend' is missing, or lacks 'Cube'"


@pytest.mark.parametrize("name", ["cornell", "mirrors"])
def test_the_samples_light_paths_are_equal_for_both_engines(name):
    path = Path(addon.__file__).resolve().parent.parent / "blend_samples" / f"{name}.blend"
    scene = open_file.open_scene(path)
    for kind in ("max", "diffuse", "glossy", "transmission"):
        limits = [getattr(owner, f"{kind}_bounces") for owner in (scene.leapray, scene.cycles)]
        assert limits[0] == limits[1], kind


@pytest.mark.parametrize(
    ("name", "thresholds", "paints"),
    [
        ("head", (-480.0, 570.0), ["Skin", "Bone"]),
        ("gyroid", (0.5,), ["Teal"]),
        ("cloud", (0.25,), ["Cloud"]),
    ],
)
def test_the_samples_volumes_are_read(name, thresholds, paints):
    path = Path(addon.__file__).resolve().parent.parent / "blend_samples" / f"{name}.blend"
    open_file.open_scene(path)
    got = read(64, 64)
    assert got.warnings == ()
    assert [each.thresholds for each in got.fields] == [thresholds]
    (instance,) = got.field_instances
    assert [got.materials[at].name for at in instance.materials] == paints
    shown = pipeline.render(got).passes["Combined"][..., :3]
    assert shown.std(axis=(0, 1)).min() > 0.05


def test_nothing_leaks_from_instances():
    """Blender counts at exit what was not freed, and says so."""
    root = Path(addon.__file__).resolve().parent.parent
    code = (
        "import bpy, addon; addon.register()\n"
        f"bpy.ops.wm.open_mainfile(filepath={str(root / 'blend_samples/gallery.blend')!r})\n"
        "from addon.blender.read import scene\n"
        "read = scene.read(bpy.context.evaluated_depsgraph_get(), 64, 48)\n"
        "assert len(read.instances) > 50\n"
        "addon.unregister()"
    )
    paths = os.pathsep.join([str(root), str(root / "native")])
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": paths},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 0, done.stderr
    assert "Not freed" not in done.stdout + done.stderr
