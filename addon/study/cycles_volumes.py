# SPDX-License-Identifier: GPL-3.0-or-later
"""Measured data as OpenVDB files: what Cycles can show of data that LeapRay reads itself."""

from __future__ import annotations

import os
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from leapray.formats.vdb import openvdb_module
from leapray.scalar_grid import Leaves, Samples, ScalarGrid

from ..blender.read import volumes
from ..blender.read.links import tree_of

NAME = "density"
# Of a voxel: Cycles before Blender 5 shows samples so far from where OpenVDB's transform has them.
SHIFT = 0.5 if bpy.app.version < (5, 0) else 0.0


def give(scene: bpy.types.Scene, folder: Path) -> list[str]:
    """Write the data of volumes without an OpenVDB file into the folder, where Cycles finds them.

    Returns what to say of it. Raises LeapRayError where they cannot be read.
    """
    notes = []
    depsgraph = bpy.context.evaluated_depsgraph_get()
    for k, thing in enumerate(each for each in scene.objects if each.type == "VOLUME"):
        data = thing.data
        if thing.hide_render or not data.leapray.file:
            continue
        grid = volumes.grid_of(thing.evaluated_get(depsgraph), data, depsgraph)
        if grid is None:
            continue
        path = folder / f"volume-{k}.vdb"
        if isinstance(grid.samples, Leaves):
            path = Path(grid.source)  # is one
        else:
            write(path, grid, grid.samples, {NAME, *names(thing)})
        data.filepath = os.fspath(path)
        notes.append(
            f"Cycles sees the data of {thing.name} through an OpenVDB file, whose values fade at "
            "the border"
        )
    return notes


def names(thing: bpy.types.Object) -> set[str]:
    """By what names the object's materials may call its grid."""
    trees = [tree_of(slot.material) for slot in thing.material_slots if slot.material]
    nodes = [node for tree in trees if tree for node in tree.nodes]
    return {node.attribute_name for node in nodes if node.type == "ATTRIBUTE"} - {""}


def write(path: Path, grid: ScalarGrid, samples: Samples, called: set[str]) -> None:
    """The grid's values under every one of these names."""
    openvdb = openvdb_module()
    values = of_samples(grid, samples)
    made = openvdb.FloatGrid(float(values.min()))
    made.copyFromArray(np.ascontiguousarray(values.transpose(2, 1, 0)), tolerance=0.0)
    matrix = np.array(grid.world_from_index, float)
    matrix[:3, 3] -= matrix[:3, :3] @ np.full(3, SHIFT)
    made.transform = openvdb.createLinearTransform(matrix.T.tolist())
    grids = []
    for name in sorted(called):
        made.name = name
        grids.append(made.copy())
    openvdb.write(os.fspath(path), grids=grids)


def of_samples(grid: ScalarGrid, samples: Samples) -> NDArray[np.float32]:
    """(nz, ny, nx) values; where there is none, the least."""
    stored = np.asarray(samples[:])
    values = (grid.offset + grid.scale * stored).astype(np.float32)
    missing = ~np.isfinite(values)
    if grid.no_data is not None:
        missing |= stored == grid.no_data
    values[missing] = values[~missing].min(initial=np.float32(np.inf))
    return values
