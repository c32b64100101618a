# SPDX-License-Identifier: GPL-3.0-or-later
"""Exported volumes: Blender's own Volume object has the mesh's surface in the mesh's place."""

import bpy
import meshes
import numpy as np
import pytest
from blender_scenes import diffuse, fresh, mesh, plane, polygons, put
from mathutils import Matrix

from addon.store import volume_files

VOXEL = 2 / 38  # of a ball with 48 samples across
OFF = (
    0.1 if bpy.app.version >= (5, 0) else 1.0
)  # voxels; before, Blender shifts meshes by half a one
SHEAR = Matrix(((1, 0.4, 0, 3), (0, 1, 0.3, -2), (0.2, 0, 1, 1), (0, 0, 0, 1)))
TURN = Matrix.Rotation(0.7, 4, "X") @ Matrix.Rotation(0.5, 4, "Z")
PLACES = {
    "at rest": Matrix(),
    "rotated": Matrix.Translation((3, -2, 1)) @ TURN,
    "stretched": Matrix.Translation((-1, 5, 0)) @ TURN @ Matrix.Diagonal((2, 1, 0.5, 1)),
    "sheared": SHEAR,
    "mirrored": TURN @ Matrix.Diagonal((1, -1, 1, 1)),
    "turned inside out": Matrix.Translation((0, 0, 4)) @ Matrix.Diagonal((-1, -2, -0.7, 1)),
    "far away": Matrix.Translation((1e4, -2e4, 3e3)) @ TURN,
    "tiny": Matrix.Scale(1e-3, 4) @ TURN,
}


@pytest.fixture
def scene():
    return fresh()


def chosen(name, data, matrix):
    ob = put(name, data, matrix_world=matrix)
    bpy.context.view_layer.update()
    bpy.context.view_layer.objects.active = ob
    return ob


def opened(path):
    """The points of the mesh that Blender makes of the file's density at 1/2, in the world."""
    bpy.ops.object.volume_import(filepath=str(path))
    volume = bpy.context.object
    assert volume.type == "VOLUME" and volume.data.grids.load()
    assert volume.data.grids[0].name == "density"
    # Blender makes meshes of volumes for other objects
    ob = put("Surface", bpy.data.meshes.new("Surface"))
    modifier = ob.modifiers.new("Volume", "VOLUME_TO_MESH")
    modifier.object, modifier.grid_name, modifier.threshold = volume, "density", 0.5
    ob.matrix_world = volume.matrix_world
    bpy.context.view_layer.update()
    made = ob.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
    points = np.empty(3 * len(made.vertices))
    made.vertices.foreach_get("co", points)
    return points.reshape(-1, 3) @ np.array(ob.matrix_world)[:3, :3].T + np.array(ob.location)


@pytest.mark.parametrize("place", PLACES)
def test_blender_finds_the_surface_where_the_object_is(place, scene, tmp_path):
    vertices, triangles = meshes.icosphere(4)
    ob = chosen("Ball", polygons("Ball", vertices.tolist(), triangles.tolist()), PLACES[place])
    bpy.ops.object.leapray_export_vdb(filepath=str(tmp_path / "ball.vdb"), resolution=48)
    inverse = np.linalg.inv(np.array(ob.matrix_world))
    points = opened(tmp_path / "ball.vdb") @ inverse[:3, :3].T + inverse[:3, 3]
    radius = np.linalg.norm(points, axis=1)
    assert len(points) > 1000
    assert np.abs(radius - 1).max() < OFF * VOXEL
    assert np.abs(points.mean(axis=0)).max() < OFF * VOXEL
    (grid,) = volume_files._grids(tmp_path / "ball.vdb")
    points = np.asarray(grid.convertToPolygons(isovalue=0.5)[0], float) @ inverse[:3, :3].T
    assert np.abs(np.linalg.norm(points + inverse[:3, 3], axis=1) - 1).max() < 0.1 * VOXEL


def test_in_its_own_space_the_object_places_it(scene, tmp_path):
    chosen("Box", mesh("Box"), PLACES["stretched"])
    path = tmp_path / "box.vdb"
    bpy.ops.object.leapray_export_vdb(filepath=str(path), resolution=40, space="OBJECT")
    points = opened(path)
    assert np.abs(points).max() == pytest.approx(1.0, abs=OFF * 2 / 31)
    assert np.abs(np.abs(points).max(axis=1) - 1).max() < 0.2  # corners are rounded


def test_sheets_and_thin_walls_are_exported_as_their_field(scene, tmp_path):
    """Cells that keep triangles have the samples' best values in a file."""
    chosen("Plane", plane(), PLACES["rotated"])
    bpy.ops.object.leapray_export_vdb(filepath=str(tmp_path / "plane.vdb"), resolution=32)
    volume = volume_files.read(tmp_path / "plane.vdb")
    assert volume.info.kind == "sheet" and volume.info.n_triangle_cells == 0
    inverse = np.linalg.inv(np.array(PLACES["rotated"]))
    points = opened(tmp_path / "plane.vdb") @ inverse[:3, :3].T + inverse[:3, 3]
    points[:, 2] -= 0.0 if OFF < 1 else points[:, 2].max()  # see OFF
    z = points[np.abs(points[:, :2]).max(axis=1) < 0.8, 2]
    # to one side of the sheet the density is above 1/2 as far as the ramp goes
    voxel = volume.info.object_from_index[:3, 2]
    assert np.abs(z).max() < 3.1 * np.linalg.norm(voxel)
    assert 0.3 < (np.abs(z) < 1e-3).mean() < 0.7


def test_materials_are_ids_of_the_file(scene, tmp_path):
    ob = chosen("Box", mesh("Box"), PLACES["mirrored"])
    for name in ("One", "Two"):
        ob.data.materials.append(diffuse(name))
    ob.data.polygons[5].material_index = 1
    bpy.ops.object.leapray_export_vdb(filepath=str(tmp_path / "box.vdb"), resolution=32)
    assert set(np.unique(volume_files.read(tmp_path / "box.vdb").read_ids())) == {0, 1}


def test_what_cannot_be_exported_is_a_sentence(scene, tmp_path):
    path = tmp_path / "out.vdb"
    chosen("Flat", mesh("Flat"), Matrix.Diagonal((1, 1, 0, 1)))
    for export, words in (
        ({"filepath": str(path)}, "'Flat' is not exported: .* cannot place"),
        ({"filepath": str(tmp_path / "no" / "out.vdb"), "space": "OBJECT"}, "no folder"),
        ({"filepath": str(tmp_path), "space": "OBJECT"}, "'Flat' is not exported"),
        ({"filepath": str(path), "resolution": 16384, "space": "OBJECT"}, "'Flat' is not exported"),
    ):
        with pytest.raises(RuntimeError, match=words):
            bpy.ops.object.leapray_export_vdb(**export)
    assert list(tmp_path.iterdir()) == []
    holes = polygons("Holes", [(0, 0, 0), (1, 0, 0), (float("nan"), 1, 0)], [(0, 1, 2)])
    chosen("Holes", holes, Matrix())
    with pytest.raises(RuntimeError, match="'Holes' is not exported"):
        bpy.ops.object.leapray_export_vdb(filepath=str(path))
