# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's meshes as plain arrays: triangles, and what their corners carry.

Corners carry only what is wanted: normals where some faces are smooth, colours
and places in an image where a material of a slot asks for them.
"""

from __future__ import annotations

from collections.abc import Sequence

import bpy
import numpy as np
from numpy.typing import NDArray

from leapray import LeapRayError

from ... import model
from ...arrays import unit
from .materials import Texture

NO_FACES = "its mesh has no faces"
WIDTHS = {  # numbers of an attribute's element, and the name they have
    "FLOAT_COLOR": (4, "color"),
    "BYTE_COLOR": (4, "color"),  # linear, whatever it is stored as
    "FLOAT_VECTOR": (3, "vector"),
    "FLOAT2": (2, "vector"),
    "FLOAT": (1, "value"),
}


def read_object_mesh(ob, textures: Sequence[Texture | None] = (), notes=None) -> model.Mesh:
    """A copy of the mesh that an evaluated object of any type has. Raises as read_mesh does."""
    try:
        mesh = ob.to_mesh()
    except RuntimeError:  # a light, an empty, ...
        raise LeapRayError(NO_FACES) from None
    try:
        return read_mesh(mesh, ob.data.name, textures, notes)
    finally:
        ob.to_mesh_clear()


def read_mesh(mesh, name: str, textures: Sequence[Texture | None] = (), notes=None) -> model.Mesh:
    """A copy of Blender's mesh, with the places and colours that each slot's texture wants.

    notes are told of layers that are missing. Raises LeapRayError with the reason that makes
    the mesh useless.
    """
    n_corners, n_faces = len(mesh.loops), len(mesh.polygons)
    if not n_faces:
        raise LeapRayError(NO_FACES)
    vertices = np.empty((len(mesh.vertices), 3), np.float32)
    mesh.vertices.foreach_get("co", vertices.ravel())
    if not np.isfinite(vertices).all():
        raise LeapRayError("its mesh has vertices that are no numbers (NaN or infinite)")

    fans = n_corners != 3 * n_faces  # no face has fewer than three corners
    of_corner = _corner_vertices(mesh)
    if fans:
        corners = np.empty((n_corners - 2 * n_faces, 3), np.int32)
        mesh.calc_loop_triangles()
        mesh.loop_triangles.foreach_get("loops", corners.ravel())
        triangles = of_corner[corners]
    else:
        corners = np.arange(n_corners, dtype=np.int32).reshape(-1, 3)
        triangles = of_corner.reshape(-1, 3)

    slots = _slots(mesh, fans, len(triangles))
    smooth = mesh.normals_domain != "FACE"
    wanted = {each.source for each in textures if each}
    carried = _Corners(mesh, vertices, triangles, corners, slots, notes)
    return model.Mesh(
        name,
        vertices,
        triangles,
        slots,
        corner_normals=carried.normals() if smooth else None,
        corner_colors=carried.of(textures, "vertex", 3) if "vertex" in wanted else None,
        corner_uvs=carried.of(textures, "image", 2) if "image" in wanted else None,
    )


def _corner_vertices(mesh) -> NDArray[np.int32]:
    """The vertex of each corner of a face: as the attribute, which is copied at once."""
    of_corner = np.empty(len(mesh.loops), np.int32)
    stored = mesh.attributes.get(".corner_vert")
    if stored is not None and stored.domain == "CORNER" and stored.data_type == "INT":
        stored.data.foreach_get("value", of_corner)
    else:
        mesh.loops.foreach_get("vertex_index", of_corner)
    return of_corner


def _slots(mesh, fans: bool, n_triangles: int) -> NDArray[np.uint16] | None:
    """The material slot of each triangle; None where all are in the first."""
    indices = mesh.attributes.get("material_index")
    if indices is None or indices.domain != "FACE" or indices.data_type != "INT":
        return None
    of_face = np.empty(len(mesh.polygons), np.int32)
    indices.data.foreach_get("value", of_face)
    if not of_face.any():
        return None
    slots = of_face.clip(0, np.iinfo(np.uint16).max).astype(np.uint16)
    return slots[_face_of(mesh, n_triangles)] if fans else slots


def _face_of(mesh, n_triangles: int) -> NDArray[np.int32]:
    """The face of each triangle, where faces have more than three corners."""
    face_of = np.empty(n_triangles, np.int32)
    mesh.loop_triangle_polygons.foreach_get("value", face_of)
    return face_of


class _Corners:
    """What the corners of a mesh carry, as (m, 3, channels)."""

    def __init__(self, mesh, vertices, triangles, corners, slots, notes) -> None:
        self.mesh, self.vertices, self.triangles = mesh, vertices, triangles
        self.corners, self.slots, self.notes = corners, slots, notes

    def normals(self) -> NDArray[np.float32]:
        """Shading normals: of smooth and sharp faces and edges, or the mesh's own custom ones.

        As the Cycles of this Blender takes them: in Blender 4 those of vertices, while the
        triangles of flat faces have their own, unless some edge is sharp or normals are custom.
        """
        if not self._of_vertices():
            of_corner = np.empty((len(self.mesh.loops), 3), np.float32)
            self.mesh.corner_normals.foreach_get("vector", of_corner.ravel())
            return of_corner[self.corners]
        of_vertex = np.empty((len(self.vertices), 3), np.float32)
        self.mesh.vertex_normals.foreach_get("vector", of_vertex.ravel())
        normals = of_vertex[self.triangles]
        flat = self._flat()
        if flat is not None:
            a, b, c = (self.vertices[self.triangles[flat, k]].astype(np.float64) for k in range(3))
            normals[flat] = unit(np.cross(b - a, c - a))[:, None].astype(np.float32)
        return normals

    def _of_vertices(self) -> bool:
        """Whether Cycles takes normals of vertices, which smooth across flat faces' edges."""
        sharp = self.mesh.attributes.get("sharp_edge")
        if bpy.app.version >= (5, 0) or self.mesh.has_custom_normals:
            return False
        if sharp is None or sharp.domain != "EDGE" or sharp.data_type != "BOOLEAN":
            return True
        values = np.empty(len(sharp.data), bool)
        sharp.data.foreach_get("value", values)
        return not values.any()

    def _flat(self) -> NDArray[np.bool_] | None:
        """Which triangles are of flat faces; None: none."""
        found = self.mesh.attributes.get("sharp_face")
        if found is None or found.domain != "FACE" or found.data_type != "BOOLEAN":
            return None
        of_face = np.empty(len(self.mesh.polygons), bool)
        found.data.foreach_get("value", of_face)
        if not of_face.any():
            return None
        return of_face[self._faces()]

    def _faces(self) -> NDArray[np.int32]:
        """The face of each triangle."""
        n = len(self.triangles)
        fans = len(self.mesh.polygons) != n or len(self.mesh.loops) != 3 * n
        return _face_of(self.mesh, n) if fans else np.arange(n, dtype=np.int32)

    def of(self, textures, source: str, channels: int) -> NDArray[np.float32]:
        """What the textures of one source want, each in the triangles of its slots."""
        values = np.zeros((len(self.triangles), 3, channels), np.float32)
        last = len(textures) - 1
        for slot, texture in enumerate(textures):
            if texture is None or texture.source != source:
                continue
            if self.slots is None:
                mine = slice(None) if slot == 0 else slice(0)
            else:
                mine = self.slots == slot if slot < last else self.slots >= slot
            if source == "vertex":
                values[mine] = texture.apply(self._layer(texture.layer, mine))
            else:
                values[mine] = texture.place(self._places(texture, mine))[..., :2]
        return values

    def _layer(self, name: str, mine) -> NDArray[np.float32]:
        """Four numbers per corner of an attribute; zeros where the mesh has none of that name."""
        found = self.mesh.attributes.get(name) if name else _render_color(self.mesh)
        if found is None or found.data_type not in WIDTHS or found.domain == "EDGE":
            self._missing(
                f"has no colour attribute {name!r}" if name else "has no colour attribute"
            )
            return np.zeros((*self.corners[mine].shape, 4), np.float32)
        width, member = WIDTHS[found.data_type]
        stored = np.empty((len(found.data), width), np.float32)
        found.data.foreach_get(member, stored.ravel())
        values = stored[self._elements(found.domain, mine)]
        whole = np.ones((*values.shape[:-1], 4), np.float32)
        if width == 1:
            whole[..., :3] = values
        else:
            whole[..., :width] = values
            whole[..., width:3] = 0.0
        return whole

    def _elements(self, domain: str, mine) -> NDArray[np.int32]:
        """The element of an attribute's domain that each corner of these triangles takes."""
        if domain == "CORNER":
            return self.corners[mine]
        if domain == "POINT":
            return self.triangles[mine]
        return np.repeat(self._faces()[mine][:, None], 3, axis=1)

    def _places(self, texture: Texture, mine) -> NDArray[np.float32]:
        """The texture coordinates of the corners, before the material's mapping: (.., 3, 3)."""
        if texture.coordinates != "UV":
            points = self.vertices[self.triangles[mine]]
            if texture.coordinates == "Generated":  # the unit cube round the mesh
                middle = np.array(self.mesh.texspace_location, np.float32)
                half = np.array(self.mesh.texspace_size, np.float32)
                points = (points - middle) / (2 * np.where(half > 0, half, 1)) + 0.5
            return points
        layers = self.mesh.uv_layers
        found = layers.get(texture.layer) if texture.layer else _render_uv(layers)
        uvs = np.zeros((*self.corners[mine].shape, 3), np.float32)
        if found is None:
            self._missing(f"has no UV map {texture.layer!r}".removesuffix(" ''"))
            return uvs
        stored = np.empty((len(self.mesh.loops), 2), np.float32)
        found.uv.foreach_get("vector", stored.ravel())
        uvs[..., :2] = stored[self.corners[mine]]
        return uvs

    def _missing(self, what: str) -> None:
        if self.notes is not None:
            self.notes.missing("Mesh", self.mesh.name, what)


def _render_color(mesh):
    """The colour attribute that is marked for rendering."""
    attributes = mesh.color_attributes
    index = attributes.render_color_index
    return attributes[index] if 0 <= index < len(attributes) else None


def _render_uv(layers):
    return next((each for each in layers if each.active_render), None)
