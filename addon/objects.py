# SPDX-License-Identifier: GPL-3.0-or-later
"""Which objects of a scene can be modelled, and as which meshes (no bpy)."""

from __future__ import annotations

import dataclasses
import hashlib

import numpy as np
from numpy.typing import NDArray

import leapray

from . import model


class SceneError(leapray.LeapRayError):
    """The scene cannot be modelled, for the reason that the sentence gives."""


def digest(mesh: model.Mesh) -> str:
    """A name for the mesh's contents."""
    name = hashlib.blake2b(digest_size=16)
    for array in (mesh.vertices, mesh.triangles, mesh.slots):
        if array is not None:
            name.update(np.ascontiguousarray(array).view(np.uint8))
        name.update(b"|")
    return name.hexdigest()


def wrong_with_mesh(mesh: model.Mesh) -> str:
    """Why the mesh cannot be modelled, or ""."""
    if len(mesh.triangles) == 0:
        return "it has no faces"
    if not np.isfinite(mesh.vertices).all():
        bad = int(np.flatnonzero(~np.isfinite(mesh.vertices).all(axis=1))[0])
        return f"its vertex {bad} has a coordinate that is not finite"
    if mesh.triangles.min() < 0 or mesh.triangles.max() >= len(mesh.vertices):
        return f"its triangles name vertices beyond its {len(mesh.vertices)}"
    corners = mesh.vertices[mesh.triangles].astype(np.float64)
    if not np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).any():
        return "none of its faces has an area"
    return ""


def wrong_with_matrix(matrix: NDArray[np.float64]) -> str:
    """Why nothing can be placed by the affine matrix (4, 4), or "". Scale does not matter."""
    if not np.isfinite(matrix).all():
        return "its matrix is not finite"
    values = np.linalg.svd(matrix[:3, :3], compute_uv=False)
    return "" if values[2] > 1e-9 * values[0] else "its matrix has no inverse (a scale of zero?)"


def usable(scene: model.Scene, warnings: list[str]) -> list[model.Instance]:
    """The instances that can be modelled; each of the others gets a warning that names it.

    Raises SceneError where there were some and none is left.
    """
    verdicts = {i: wrong_with_mesh(scene.meshes[i]) for i in {i.mesh for i in scene.instances}}
    good = []
    for instance in scene.instances:
        why = verdicts[instance.mesh] or wrong_with_matrix(np.asarray(instance.world_from_object))
        if why:
            warnings.append(f"{instance.name!r} is skipped: {why}.")
        else:
            good.append(instance)
    if scene.instances and not good:
        raise nothing_left(warnings)
    return good


def nothing_left(warnings: list[str]) -> SceneError:
    return SceneError("Nothing is left to render. " + " ".join(dict.fromkeys(warnings)))


def merge(
    scene: model.Scene, instances: list[model.Instance], warnings: list[str]
) -> tuple[model.Scene, list[int]]:
    """The scene as one mesh in world space, and the object index of each of its slots.

    Every instance keeps its own slots, so that a hit's id tells both material
    and object. Raises SceneError where 65536 ids do not suffice.
    """
    vertices, triangles, slots = [], [], []
    materials: list[int] = []
    objects: list[int] = []
    n_vertices = 0
    for instance in instances:
        mesh = scene.meshes[instance.mesh]
        matrix = np.asarray(instance.world_from_object, np.float64)
        corners = mesh.triangles + n_vertices
        mirrored = np.linalg.det(matrix[:3, :3]) < 0
        own = np.zeros(len(corners), np.int64) if mesh.slots is None else mesh.slots
        vertices.append(mesh.vertices @ matrix[:3, :3].T + matrix[:3, 3])
        triangles.append(corners[:, ::-1] if mirrored else corners)
        slots.append(np.minimum(own, len(instance.materials) - 1) + len(materials))
        materials += instance.materials
        objects += [instance.object_index] * len(instance.materials)
        n_vertices += len(mesh.vertices)
    if len(materials) > 65536:
        raise SceneError(
            f"One volume holds 65536 ids, but the scene's objects have {len(materials)} material "
            "slots; choose layout 'objects'."
        )
    flags = ("visible_camera", "visible_shadow", "visible_diffuse")
    if any(len({getattr(i, flag) for i in instances}) > 1 for flag in flags):
        warnings.append("In layout 'scene' the ray visibility of single objects does not count.")
    mesh = model.Mesh(
        "Scene",
        np.concatenate(vertices).astype(np.float32),
        np.concatenate(triangles).astype(np.int32),
        np.concatenate(slots).astype(np.uint16),
    )
    whole = model.Instance("Scene", 0, np.eye(4), tuple(materials))
    return dataclasses.replace(scene, meshes=(mesh,), instances=(whole,)), objects
