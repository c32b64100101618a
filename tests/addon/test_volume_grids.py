# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces of volume objects that other grids of the same object colour by their values."""

from dataclasses import replace

import bpy
import numpy as np
import pytest
import vdb_files
from blender_scenes import colored, fresh, mesh, put, read

from addon import pipeline

SIZE = 64, 48
PASSES = "Combined", "Depth", "Position", "Normal", "Object Index", "Volume"


@pytest.fixture
def scene():
    made = fresh()
    made.render.resolution_x, made.render.resolution_y = SIZE
    made.camera.location = (0, 0, 6)
    return made


def slope(n=10, spacing=0.37, turned=0.4, name="heat", kind="FloatGrid", sparse=False):
    """A grid of another transform, whose values are 100 + 40 x + 10 y in its object."""
    lib = vdb_files.openvdb()
    matrix = np.eye(4)
    c, s = np.cos(turned), np.sin(turned)
    matrix[:2, :2] = spacing * np.array([[c, s], [-s, c]])  # OpenVDB's are of rows
    matrix[2, 2] = spacing * 1.2
    matrix[3, :3] = -(n - 1) / 2 * (np.ones(3) @ matrix[:3, :3])
    index = np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), axis=-1)
    place = index @ matrix[:3, :3] + matrix[3, :3]
    made = getattr(lib, kind)(0)
    values = 100 + 40 * place[..., 0] + 10 * place[..., 1]
    made.copyFromArray(values.astype(np.int32 if kind == "Int32Grid" else np.float32))
    made.name, made.transform = name, lib.createLinearTransform(matrix.tolist())
    return made


def ball(path, *materials, grids=(), name="Ball"):
    data = bpy.data.volumes.new(name)
    data.filepath = vdb_files.write(path / "ball.vdb", vdb_files.level_set("ball"), *grids)
    data.leapray.grid = "ball"
    for each in materials:
        data.materials.append(each)
    return put(name, data, pass_index=1)


def render(**settings):
    bpy.context.view_layer.update()
    made = replace(read(*SIZE), passes=PASSES)
    return pipeline.render(replace(made, settings=replace(made.settings, **settings)))


def whole_pixels(frame):
    """Those of the object whose samples all lie on it, at the mean of their values."""
    seen = frame.passes["Object Index"][..., 0] == 1
    for axis in (0, 1):
        seen &= np.roll(seen, 1, axis) & np.roll(seen, -1, axis)
    return seen


def check_colors(frame, off=(0, 0, 0)):
    """Each pixel has the ramp's colour of 100 + 40 x + 10 y, from 50 to 150."""
    seen = whole_pixels(frame)
    assert seen.sum() > 300
    place = frame.passes["Position"][seen] - off
    share = (50 + 40 * place[:, 0] + 10 * place[:, 1]) / 100
    color = frame.passes["Combined"][seen]
    assert color[:, 1] == pytest.approx(share, abs=0.012) and np.ptp(share) > 0.6
    assert color[:, 0] == pytest.approx(1 - share, abs=0.012)


@pytest.mark.parametrize("kind", ["FloatGrid", "Int32Grid", "DoubleGrid"])
def test_another_grid_of_the_file_colors_the_surface(kind, scene, tmp_path):
    lib = vdb_files.openvdb()
    if not hasattr(lib, kind):
        pytest.skip(f"this OpenVDB has no {kind}")
    material = colored("Heat", "heat", low=50, high=150)
    ob = ball(tmp_path, material, grids=[slope(kind=kind)])
    frame = render()
    assert frame.warnings == []
    if kind == "Int32Grid":  # whole numbers are a hundredth off
        assert (frame.passes["Combined"][..., 1] > 0.3).any()
        return
    check_colors(frame)
    ob.location = (0.3, 0.2, 0.1)
    check_colors(render(), ob.location)


def test_two_surfaces_and_the_face_of_a_cut_take_grids_of_their_own(scene, tmp_path):
    worn = [colored("Heat", "heat", low=50, high=150), colored("Cold", "cold", low=-150, high=-50)]
    cold = slope(name="cold")
    cold.mapAll(lambda value: -value)
    ob = ball(tmp_path, *worn, grids=[slope(), cold])
    cutter = put("Cutter", mesh(), location=(0, 0, 1.5))
    cutter.hide_render = cutter.hide_viewport = True
    ob.data.leapray.clip_object = cutter
    frame = render()
    assert frame.warnings == []
    face = frame.passes["Volume"][..., 0] == 2
    assert face.sum() > 200
    x, y = frame.passes["Position"][face][:, :2].T
    want = (50 - 40 * x - 10 * y) / 100
    assert np.abs(frame.passes["Combined"][face][:, 1] - want).mean() < 0.01


@pytest.mark.parametrize("made", ["file", "nodes"])
def test_a_grid_that_is_missing_is_named(made, scene, tmp_path):
    ob = ball(tmp_path, colored("Wrong", "heath"), grids=[slope()])
    if made == "nodes":
        ob.modifiers.new("Displace", "VOLUME_DISPLACE")
    (warning,) = render().warnings
    for word in ("'Wrong'", "'heath'", "'Ball'", "ball", "heat"):
        assert word in warning
    assert "/tmp/leapray" not in warning


def test_grids_that_modifiers_made_color_surfaces(scene, tmp_path):
    ob = ball(tmp_path, colored("Heat", "heat", low=50, high=150), grids=[slope()])
    ob.modifiers.new("Displace", "VOLUME_DISPLACE").strength = 0.0
    frame = render()
    assert frame.warnings == []
    check_colors(frame)


def test_channels_of_measured_data_are_grids(scene, tmp_path):
    tifffile = pytest.importorskip("tifffile")
    n = 24
    k, j, i = np.indices((n, n, n)) - (n - 1) / 2
    first = 200 - 10 * np.sqrt(i * i + j * j + k * k)
    second = 100 + 5 * i
    stack = np.stack([first, second], axis=1).astype(np.float32)  # z, c, y, x
    file = tmp_path / "two.ome.tif"
    tifffile.imwrite(file, stack, metadata={"axes": "ZCYX", "Channel": {"Name": ["round", "heat"]}})
    import leapray

    names = leapray.volume_grids(file)
    assert len(names) == 2
    data = bpy.data.volumes.new("Two")
    data.leapray.file, data.leapray.grid = str(file), names[0]
    data.leapray.automatic, data.leapray.threshold = False, 120.0
    data.materials.append(colored("Heat", names[1], low=50, high=150))
    put("Two", data, pass_index=1, scale=(0.1, 0.1, 0.1))
    bpy.context.view_layer.update()
    frame = render()
    assert not any("colors" in each or "Material" in each for each in frame.warnings)
    seen = whole_pixels(frame)
    assert seen.sum() > 100
    x = frame.passes["Position"][seen][:, 0]
    share = (50 + 5 * (x / 0.1 - (n - 1) / 2)) / 100
    assert frame.passes["Combined"][seen][:, 1] == pytest.approx(share, abs=0.02)


def test_a_grid_of_one_value_is_that_value(scene, tmp_path):
    made = slope()
    made.mapAll(lambda value: 75.0)
    lib = vdb_files.openvdb()
    flat = lib.FloatGrid(75.0)
    flat.name, flat.transform = "heat", made.transform
    ball(tmp_path, colored("Heat", "heat", low=50, high=150), grids=[flat])
    color = render().passes["Combined"][SIZE[1] // 2, SIZE[0] // 2]
    assert color[:2] == pytest.approx((0.75, 0.25), abs=0.01)


def test_a_grid_beyond_the_budget_is_coarser_and_named(scene, tmp_path, monkeypatch):
    from addon.plan import other_grids

    ball(tmp_path, colored("Heat", "heat", low=50, high=150), grids=[slope(40, 0.08)])
    sizes = []
    real = other_grids._made

    def made(other, factor, *more):
        found = real(other, factor, *more)
        sizes.append(found.volume.info.nbytes)
        return found

    monkeypatch.setattr(other_grids, "_made", made)
    render()
    whole = other_grids.samples
    monkeypatch.setattr(other_grids, "samples", lambda *a: whole(*a[:-1], sizes[0] // 2))
    frame = render()
    (warning,) = frame.warnings
    assert "'Ball' has the colors of one in 2 samples of 'heat'" in warning
    check_colors(frame)


def test_other_textures_are_named(scene, tmp_path):
    ball(tmp_path, colored("Plain", ""))
    assert any("'Ball'" in each for each in render().warnings)


@pytest.mark.skipif(bpy.app.version < (5, 0), reason="nodes of grids came with Blender 5")
def test_a_second_grid_of_geometry_nodes_colors_the_first(scene):
    tree = bpy.data.node_groups.new("Nodes", "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    kinds = ("MeshUVSphere", "MeshToSDFGrid", "StoreNamedGrid", "FieldToGrid", "StoreNamedGrid",
             "SetMaterial", "InputPosition")  # fmt: skip
    ball, sdf, first, field, second, paint, place = (
        tree.nodes.new(f"GeometryNode{kind}") for kind in kinds
    )
    axes, output = tree.nodes.new("ShaderNodeSeparateXYZ"), tree.nodes.new("NodeGroupOutput")
    ball.inputs["Segments"].default_value, ball.inputs["Rings"].default_value = 64, 32
    sdf.inputs["Voxel Size"].default_value = 0.08
    first.inputs["Name"].default_value, second.inputs["Name"].default_value = "sdf", "heat"
    field.grid_items.clear()
    field.grid_items.new("FLOAT", "x")
    paint.inputs["Material"].default_value = colored("Heat", "heat", low=-1, high=1)
    for start, end in (
        (ball.outputs["Mesh"], sdf.inputs["Mesh"]),
        (sdf.outputs[0], first.inputs["Grid"]),
        (sdf.outputs[0], field.inputs["Topology"]),
        (place.outputs[0], axes.inputs[0]),
        (axes.outputs["X"], field.inputs["x"]),
        (field.outputs["x"], second.inputs["Grid"]),
        (first.outputs[0], second.inputs["Volume"]),
        (second.outputs[0], paint.inputs["Geometry"]),
        (paint.outputs[0], output.inputs[0]),
    ):
        tree.links.new(start, end)
    ob = put("Nodes", bpy.data.meshes.new("Empty"), pass_index=1)
    ob.modifiers.new("Nodes", "NODES").node_group = tree
    frame = render()
    assert frame.warnings == []
    seen = whole_pixels(frame)
    x = frame.passes["Position"][seen][:, 0]
    assert np.ptp(x) > 1.5
    assert frame.passes["Combined"][seen][:, 1] == pytest.approx((x + 1) / 2, abs=0.02)
