# SPDX-License-Identifier: GPL-3.0-or-later
"""Which objects of a scene can be modelled, and as which meshes (no bpy)."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

import leapray
from leapray.rendering import VISIBILITIES
from leapray.scalar_grid import LEAF, Leaves, ScalarGrid

from .. import model
from . import mesh_colors

FARTHEST = 1e18  # coordinates beyond leave no digits for areas; Blender's infinity is 3.4e38


class SceneError(leapray.LeapRayError):
    """The scene cannot be modelled; the sentence says why."""


def told_of(instance: model.Placed) -> dict[str, Any]:
    """What the core's instances of a placed thing have from it, whatever they show."""
    return {
        "world_from_object": instance.world_from_object,
        "object_index": instance.object_index,
        "holdout": instance.holdout,
        **{flag: getattr(instance, flag) for flag in VISIBILITIES},
    }


def corners(scene: model.Scene, instance: model.Placed) -> NDArray[np.float64]:
    """(8, 3): of a box round what is placed, in its own space."""
    if isinstance(instance, model.FieldInstance):
        grid = scene.fields[instance.field].grid
        matrix = np.asarray(grid.world_from_index, np.float64)
        return box(lattice(grid)) @ matrix[:3, :3].T + matrix[:3, 3]
    assert isinstance(instance, model.Instance)
    return box(scene.meshes[instance.mesh].bounds)


def box(ends: NDArray) -> NDArray[np.float64]:
    """(8, 3): the corners of a box, ends (2, 3)."""
    return np.array(list(itertools.product(*np.asarray(ends, np.float64).T)))


def lattice(grid: ScalarGrid) -> NDArray[np.int64]:
    """(2, 3): the first and the last index of a grid's samples, and of one layer round them."""
    samples = grid.samples
    if not isinstance(samples, Leaves):
        return np.array([(-1, -1, -1), samples.shape[::-1]], np.int64)
    sizes = np.concatenate([np.full(len(samples.origins), LEAF), samples.tile_sizes])
    first = np.concatenate([samples.origins, samples.tile_origins]).astype(np.int64)
    if not len(first):
        return np.array([(-1, -1, -1), (0, 0, 0)], np.int64)
    return np.array([first.min(axis=0) - 1, (first + sizes[:, None]).max(axis=0)])


def no_cells(grid: ScalarGrid) -> str:
    """Why there is nothing to see between the samples of a grid that hold values."""
    layers = np.ptp(lattice(grid), axis=0).min() - 1
    if layers < 1:
        return "its data are empty"
    if layers == 1:
        return "its data are a single layer of samples, between which there is no space"
    return "no eight samples that are neighbours hold values of which any is seen"


def wrong_with_mesh(mesh: model.Mesh) -> str:
    """Why the mesh cannot be modelled, or ""."""
    if len(mesh.triangles) == 0:
        return "it has no faces"
    if not np.isfinite(mesh.vertices).all():
        bad = int(np.flatnonzero(~np.isfinite(mesh.vertices).all(axis=1))[0])
        return f"its vertex {bad} has a coordinate that is not finite"
    if max(mesh.vertices.max(), -mesh.vertices.min()) > FARTHEST:
        far = np.abs(mesh.vertices).max(axis=1) > FARTHEST
        return f"its vertex {int(far.argmax())} has a coordinate beyond {FARTHEST:.0e}"
    if mesh.triangles.min() < 0 or mesh.triangles.max() >= len(mesh.vertices):
        return f"its triangles name vertices beyond its {len(mesh.vertices)}"
    return ""


def wrong_with_matrices(matrices: NDArray[np.float64]) -> list[str]:
    """For each affine matrix (n, 4, 4) why nothing can be placed by it, or "".

    Scale does not matter, only how flat it makes things.
    """
    finite = np.isfinite(matrices).all(axis=(1, 2))
    linear = np.where(finite[:, None, None], matrices, 0.0)[:, :3, :3]
    values = np.linalg.svd(linear, compute_uv=False)
    good = values[:, 2] > 1e-9 * values[:, 0]
    flat = "its matrix has no inverse (a scale of zero?)"
    return [
        "" if ok else flat if known else "its matrix is not finite"
        for ok, known in zip(good.tolist(), finite.tolist(), strict=True)
    ]


def scales(matrices: Sequence[NDArray[np.float64]]) -> list[float]:
    """How many times longer things become on the average, by each matrix (4, 4)."""
    linear = np.array(matrices, np.float64).reshape(-1, 4, 4)[:, :3, :3]
    return [abs(volume) ** (1 / 3) for volume in np.linalg.det(linear).tolist()]


def wrong_with_field(field: model.Field) -> str:
    """Why no surface of the field can be modelled, or ""."""
    if not np.isfinite(field.thresholds).all():
        return "its threshold is not finite"
    if wrong_with_matrices(np.asarray(field.grid.world_from_index, np.float64)[None])[0]:
        return "the samples of its data do not span space"
    return ""


def usable(scene: model.Scene, warnings: list[str]) -> list[model.Placed]:
    """The instances that can be modelled; each of the others gets a warning that names it.

    Raises SceneError where there were some and none is left.
    """
    instances: list[model.Placed] = [*scene.instances, *scene.field_instances]
    if not instances:
        return []
    of_meshes = {i: wrong_with_mesh(scene.meshes[i]) for i in {i.mesh for i in scene.instances}}
    of_fields = [wrong_with_field(each) for each in scene.fields]
    placed = np.array([i.world_from_object for i in instances], np.float64)
    good = []
    for instance, of_matrix in zip(instances, wrong_with_matrices(placed), strict=True):
        why = of_fields[instance.field] if isinstance(instance, model.FieldInstance) else ""
        why = of_meshes[instance.mesh] if isinstance(instance, model.Instance) else why
        if why or of_matrix:
            warnings.append(f"{instance.name!r} is skipped: {why or of_matrix}.")
        else:
            good.append(instance)
    if not good:
        raise nothing_left(warnings)
    return good


def nothing_left(warnings: list[str]) -> SceneError:
    return SceneError("Nothing is left to render. " + " ".join(dict.fromkeys(warnings)))


def merge(
    scene: model.Scene, instances: list[model.Instance], warnings: list[str], kinds: list[Kind]
) -> tuple[model.Scene, list[model.Instance]]:
    """The scene in world space as one mesh of all solids and one of all sheets.

    Every instance keeps its own slots, so that a hit's id tells both material
    and object; the instance of each slot is returned beside. Raises SceneError
    where 65536 ids do not suffice.
    """
    materials: list[int] = []
    owners: list[model.Instance] = []
    first: list[int] = []
    for instance in instances:
        first.append(len(materials))
        materials += instance.materials
        owners += [instance] * len(instance.materials)
    if len(materials) > 65536:
        raise SceneError(
            f"One volume holds 65536 ids, but the scene's objects have {len(materials)} material "
            "slots; choose layout 'objects'."
        )
    flags = {"ray visibility": VISIBILITIES, "holdout": ("holdout",)}
    for what, names in flags.items():
        if any(len({getattr(i, name) for i in instances}) > 1 for name in names):
            warnings.append(f"In layout 'scene' the {what} of single objects does not count.")
    meshes = []
    for kind in ("solid", "sheet"):
        chosen = [n for n, k in enumerate(kinds) if k.kind == kind]
        if chosen:
            meshes.append(_joined(scene, instances, chosen, first, kinds))
    seen = {flag: any(getattr(each, flag) for each in instances) for flag in VISIBILITIES}
    whole = [
        model.Instance(
            name="Scene",
            mesh=number,
            world_from_object=np.eye(4),
            materials=tuple(materials),
            **seen,
            holdout=all(instance.holdout for instance in instances),
        )
        for number in range(len(meshes))
    ]
    return dataclasses.replace(scene, meshes=tuple(meshes), instances=tuple(whole)), owners


@dataclasses.dataclass(frozen=True)
class Kind:
    """What a mesh is: "solid" or "sheet", and whether it is wound inside out."""

    kind: str
    inverted: bool = False


def _joined(scene, instances, chosen: list[int], first: list[int], kinds: list[Kind]) -> model.Mesh:
    vertices, triangles, slots, solids = [], [], [], []
    n_vertices = 0
    parts, linear = [], []
    for number, n in enumerate(chosen):
        instance, mesh = instances[n], scene.meshes[instances[n].mesh]
        matrix = np.asarray(instance.world_from_object, np.float64)
        if kinds[n].inverted:
            mesh = mesh_colors.turned(mesh)
        corners = mesh.triangles + n_vertices
        mirrored = np.linalg.det(matrix[:3, :3]) < 0
        own = np.zeros(len(corners), np.int64) if mesh.slots is None else mesh.slots
        vertices.append(mesh.vertices @ matrix[:3, :3].T + matrix[:3, 3])
        triangles.append(corners[:, ::-1] if mirrored else corners)
        slots.append(np.minimum(own, len(instance.materials) - 1) + first[n])
        solids.append(np.full(len(corners), number, np.int32))
        n_vertices += len(mesh.vertices)
        parts.append(mesh)
        linear.append(matrix[:3, :3])
    kind = kinds[chosen[0]].kind
    return model.Mesh(
        "Scene",
        np.concatenate(vertices).astype(np.float32),
        np.concatenate(triangles).astype(np.int32),
        np.concatenate(slots).astype(np.uint16),
        **mesh_colors.joined(parts, linear),
        modelling=model.Modelling(kind=kind),
        solids=np.concatenate(solids) if kind == "solid" and len(chosen) > 1 else None,
    )
