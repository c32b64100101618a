# SPDX-License-Identifier: GPL-3.0-or-later
"""Volumes of Blender as scalar fields with the thresholds of their surfaces.

A volume comes from its OpenVDB file or sequence, from what modifiers and nodes make of it, or from
measured data of another format that its `leapray` properties name. Blender gives no access to
voxels: files are read again, and what was made is saved first, into a folder that goes away.
"""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import bpy

from leapray import LeapRayError
from leapray.scalar_grid import Leaves, ScalarGrid

from ... import arrays, model
from ...settings import Isosurfaces
from .. import properties

NOT_IN_FRAME = 2**31 - 1  # Blender's frame of a sequence that has none now


def read_field(ob, original, depsgraph) -> model.Field | None:
    """The field of an evaluated volume object; None where a sequence shows nothing in this frame.

    original: the datablock of its object in the file. Raises LeapRayError with the reason that
    makes the volume useless.
    """
    own = Isosurfaces()
    if isinstance(original, bpy.types.Volume):
        original = original.evaluated_get(depsgraph)
        own = properties.isosurfaces(original)
    if own.file:
        file = Path(absolute(own.file, original.library))
        grid, contents = _of_file(file, own.grid or None)
    elif ob.data.filepath and not any(m.show_render for m in ob.modifiers):
        path = frame_path(ob.data)
        if path is None:
            return None
        grid, contents = _of_file(path, grid_name(path, own, ob.data))
    else:
        grid, contents = _made(ob.data, own)
    return model.Field(
        name=ob.data.name,
        grid=grid,
        contents=contents,
        thresholds=thresholds(grid, own),
        above=(grid.kind != "level set") != own.invert,
        capped=own.capped,
    )


def absolute(path: str, library) -> str:
    """A path of the user's: `//` is the folder of the .blend, `~` the home folder."""
    return os.path.expanduser(bpy.path.abspath(path, library=library))


def frame_path(volume) -> Path | None:
    """The OpenVDB file of the present frame; None where a sequence has none now."""
    grids = volume.grids
    if volume.is_sequence and grids.frame == NOT_IN_FRAME:
        return None
    return Path(grids.frame_filepath or absolute(volume.filepath, volume.library))


def grid_name(path: Path, own: Isosurfaces, volume) -> str | None:
    """The grid that is wanted of an OpenVDB file; None: the first that will do."""
    if own.grid:
        return own.grid
    active = volume.grids[volume.grids.active_index].name if len(volume.grids) else ""
    scalar = [name for name, usable in _grids(path) if usable]
    return active if active in scalar else None


def thresholds(grid: ScalarGrid, own: Isosurfaces) -> tuple[float, ...]:
    """Of each surface that is wanted."""
    first = _first_threshold(grid) if own.automatic else own.threshold
    return (first, own.threshold_2, own.threshold_3)[: own.surfaces]


def _of_file(path: Path, name: str | None) -> tuple[ScalarGrid, str]:
    """A grid of a file, and a name for its contents."""
    if not path.exists():
        raise LeapRayError(f"there is no file {path}")
    state = path.stat()
    told = repr((str(path), name, state.st_mtime_ns, state.st_size))
    return _read(path, name), arrays.digest((), told.encode())


def _made(volume, own: Isosurfaces) -> tuple[ScalarGrid, str]:
    """A grid that modifiers or nodes made."""
    if not len(volume.grids):
        raise LeapRayError("it has neither a file nor a grid")
    with tempfile.TemporaryDirectory(prefix="leapray-") as folder:
        path = Path(folder, "made.vdb")
        if not volume.grids.save(filepath=str(path)):
            raise LeapRayError(f"its grids cannot be saved: {volume.grids.error_message}")
        name = grid_name(path, own, volume)
        grid = _read(path, name)
        return grid, _digest(grid)


def _digest(grid: ScalarGrid) -> str:
    samples = grid.samples
    told = repr((grid.scale, grid.offset, grid.kind, grid.no_data)).encode()
    if isinstance(samples, Leaves):
        held = [value for value in vars(samples).values() if not isinstance(value, float)]
        return arrays.digest(held, told + repr(samples.background).encode())
    return arrays.digest((samples,), told)


# ---- stand-ins
import numpy as np  # noqa


def _vdb():
    bpy.utils.expose_bundled_modules()
    import openvdb

    return openvdb


def _grids(path):
    return [
        (g.name, type(g).__name__ in ("FloatGrid", "DoubleGrid", "Int32Grid", "Int64Grid"))
        for g in _vdb().readAllGridMetadata(str(path))
    ]


def _first_threshold(grid):
    if grid.kind == "level set":
        return 0.0
    return float(np.max(grid.samples)) / 2


def _read(path, name):
    known = [n for n, u in _grids(path) if u]
    if not known or (name and name not in known):
        raise LeapRayError(f"{path} has no grid {name}")
    g = _vdb().read(str(path), name or known[0])
    lo, hi = (np.array(c) for c in g.evalActiveVoxelBoundingBox())
    a = np.empty(tuple(hi - lo + 1), np.float32)
    g.copyToArray(a, ijk=tuple(lo.tolist()))
    m = np.eye(4)
    o = np.array(g.transform.indexToWorld((0, 0, 0)))
    for k in range(3):
        m[:3, k] = np.array(g.transform.indexToWorld(tuple(np.eye(3)[k].tolist()))) - o
    m[:3, 3] = g.transform.indexToWorld(tuple(lo.astype(float).tolist()))
    kind = "level set" if g.gridClass == "level set" else "fog"
    return ScalarGrid(g.name, np.ascontiguousarray(a.transpose(2, 1, 0)), m, kind=kind)
