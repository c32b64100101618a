# SPDX-License-Identifier: GPL-3.0-or-later
"""Volumes of Blender as scalar fields with the thresholds of their surfaces.

A volume comes from its OpenVDB file or sequence, from what modifiers and nodes make of it, or from
measured data of another format that its `leapray` properties name. Blender gives no access to
voxels: files are read here, too, and what was made is saved first, into a folder that goes away.
What was read of a file is kept for the next frame and the next render.
"""

from __future__ import annotations

import itertools
import os
import tempfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TypeVar

import bpy

import leapray
from leapray import LeapRayError
from leapray.scalar_grid import Leaves, ScalarGrid

from ... import arrays, model
from ...process import POLL
from ...settings import Isosurfaces
from ...store.grid_cache import Grids
from .. import properties
from . import clips, labels, looks, sequences
from .textures import Texture

T = TypeVar("T")

NOT_IN_FRAME = 2**31 - 1  # Blender's frame of a sequence that has none now
NUMBERS = "FLOAT", "DOUBLE", "INT", "INT64", "BOOLEAN"  # Blender's types of such grids
SOLID = "level set", "labels"  # kinds of grids that are surfaces, whatever their material
HASHED = 4096  # leaves that are looked at at a time
MOST_KNOWN = 64  # thresholds that are kept for later frames

kept = Grids()
_thresholds: dict[str, float] = {}  # that were found, by contents


@dataclass(frozen=True)
class Caller:
    """Who waits for what is read: asked whether to stop, told the share of a file that is read."""

    stop: Callable[[], bool] = lambda: False
    progress: Callable[[float, str], None] = lambda share, what: None


def read_field(
    ob, original, material, depsgraph, notes, caller: Caller = Caller(), projected: bool = False
) -> model.Field | None:
    """The field of an evaluated volume object; None where a sequence shows nothing in this frame.

    original: the datablock of its object in the file. material: of its first slot, which says what
    a field without a surface looks like. notes are told of what is in doubt. projected: its values
    alone are wanted, and the colours that such a material has for them, if any. Raises
    LeapRayError with the reason that makes the volume useless, Stopped soon after the caller said
    so.
    """
    own = wanted(original, depsgraph)
    found = _grid(ob, own, original, depsgraph, caller)
    if found is None:
        return None
    grid, contents = found
    if own.shown == "auto" and grid.kind not in SOLID and looks.is_alone(material):
        own = replace(own, shown="volume")
    for doubt in grid.warnings:
        notes.missing("The data of", ob.name, f"are in doubt: {doubt}")
    told = {
        "name": ob.data.name,
        "read_nbytes": grid.nbytes,
        "clip": clips.read_clip(ob, own, depsgraph, notes),
    }
    if projected:
        return model.Field(
            grid=grid,
            contents=contents,
            thresholds=(),
            smoothing=own.smoothing,
            look=_colors(material, grid, notes) if own.shown == "volume" else None,
            **told,
        )
    if own.shown == "volume":
        if told.pop("clip") is not None:
            notes.unsupported("A cut through a volume that has no surface is", ob.name)
        look = looks.read_look(material, grid.name, notes)
        if isinstance(original, bpy.types.Volume):
            look = replace(look, per_world_unit=original.render.space == "WORLD")
        shading = own.gradient_shading, own.gradient_scale, own.gradient_roughness
        look = replace(
            look,
            shading=model.GradientShading(*shading, own.gradient_specular),
            modulation=own.gradient_modulation,
        )
        return model.Field(
            grid=grid,
            contents=contents,
            thresholds=(),
            smoothing=own.smoothing,
            look=look,
            **told,
        )
    if labels.are_shown(grid, own):
        heard = partial(listening, caller=caller, what=f"labels of {grid.name}")
        grid, found_labels = labels.read(grid, contents, ob.name, own, notes, heard)
        return model.Field(
            grid=grid,
            contents=contents,
            thresholds=(),
            labels=found_labels,
            smoothing=own.smoothing,
            **told,
        )
    return model.Field(
        grid=grid,
        contents=contents,
        thresholds=thresholds(grid, contents, own, caller),
        above=(grid.kind != "level set") != own.invert,
        capped=own.capped,
        smoothing=own.smoothing,
        interpolation=own.interpolation or "linear",  # of a newer file
        least=own.least,
        **told,
    )


def _colors(material, grid: ScalarGrid, notes) -> model.Look | None:
    """What a material makes of values; None where it has no volume shader."""
    try:
        return looks.read_look(material, grid.name, notes)
    except LeapRayError:
        return None


def field_color(texture: Texture, field: model.Field) -> model.FieldColor | None:
    """The colours that a material's texture takes from a field; None where it takes none."""
    values = {field.grid.name, "value", "density"} - {""}
    if texture.program is None or texture.layer not in values | {"gradient"}:
        return None
    return model.FieldColor(texture.program, "value" if texture.layer in values else "slope")


def other_grid(ob, original, depsgraph, name: str, caller: Caller = Caller()) -> model.OtherGrid:
    """The grid of that name beside the one that `read_field` takes. Raises as that does."""
    own = replace(wanted(original, depsgraph), grid=name)
    found = _grid(ob, own, original, depsgraph, caller)
    if found is None:
        raise LeapRayError("there is none in this frame")
    return model.OtherGrid(*found)


def grid_of(ob, original, depsgraph) -> ScalarGrid | None:
    """The grid of an evaluated volume object, as for `read_field`."""
    found = _grid(ob, wanted(original, depsgraph), original, depsgraph, Caller())
    return found and found[0]


def wanted(original, depsgraph) -> Isosurfaces:
    """Which surfaces the datablock of an object asks for; those of nodes ask for nothing."""
    if not isinstance(original, bpy.types.Volume):
        return Isosurfaces()
    return properties.isosurfaces(original.evaluated_get(depsgraph))


def _grid(
    ob, own: Isosurfaces, original, depsgraph, caller: Caller
) -> tuple[ScalarGrid, str] | None:
    """The grid, and a name for its contents."""
    if own.file:
        path = sequences.file_of_frame(
            Path(absolute(own.file, original.library)), original, depsgraph
        )
        name = own.grid or None
    elif ob.data.filepath and not any(each.show_render for each in ob.modifiers):
        path = frame_path(ob.data)
        name = grid_name(own, ob.data)
    else:
        return _made(ob.data, own, caller)
    if path is None:
        return None
    file = path
    return listening(lambda watch: kept.read(file, name, own.frame, watch), caller, file.name)


def absolute(path: str, library) -> str:
    """A path of the user's: `//` is the folder of the .blend, `~` the home folder."""
    return os.path.expanduser(bpy.path.abspath(path, library=library))


def frame_path(volume) -> Path | None:
    """The OpenVDB file of the present frame; None where a sequence has none now."""
    grids = volume.grids
    if volume.is_sequence and grids.frame == NOT_IN_FRAME:
        return None
    return Path(grids.frame_filepath or absolute(volume.filepath, volume.library))


def grid_name(own: Isosurfaces, volume) -> str | None:
    """The grid that is wanted of an evaluated volume: the active one, or the first of numbers."""
    if own.grid:
        return own.grid
    grids = volume.grids
    grids.load()
    active = grids[grids.active_index : grids.active_index + 1]
    return next((each.name for each in [*active, *grids] if each.data_type in NUMBERS), None)


def thresholds(
    grid: ScalarGrid, contents: str, own: Isosurfaces, caller: Caller
) -> tuple[float, ...]:
    """Of each surface that is wanted."""
    first = automatic(grid, contents, caller) if own.automatic else own.threshold
    return (first, own.threshold_2, own.threshold_3)[: own.surfaces]


def automatic(grid: ScalarGrid, contents: str, caller: Caller) -> float:
    """The first threshold of a grid, which is sought once for its contents."""
    if contents not in _thresholds:
        while len(_thresholds) >= MOST_KNOWN:
            _thresholds.pop(next(iter(_thresholds)))
        _thresholds[contents] = listening(
            lambda watch: leapray.first_threshold(grid, watch=watch)[0],
            caller,
            f"values of {grid.name}",
        )
    return _thresholds[contents]


def listening(work: Callable[[leapray.Watch], T], caller: Caller, what: str) -> T:
    """work(watch) on what is told, while this thread, which Blender knows, asks the caller now and
    then whether to stop."""
    watch = leapray.Watch()
    with ThreadPoolExecutor(1, thread_name_prefix="leapray-read") as pool:
        job = pool.submit(work, watch)
        try:
            while not wait([job], timeout=POLL).done:
                caller.progress(watch.progress, what)
                if caller.stop():
                    watch.stop()
        except BaseException:
            watch.stop()
            raise
        return job.result()


def _made(volume, own: Isosurfaces, caller: Caller) -> tuple[ScalarGrid, str]:
    """A grid that modifiers or nodes made."""
    if not len(volume.grids):
        raise LeapRayError("it has neither a file nor a grid")
    names = [each.name for each in volume.grids]
    if own.grid and own.grid not in names:
        raise LeapRayError(f"it has no grid {own.grid!r}; there are {', '.join(names)}")
    with tempfile.TemporaryDirectory(prefix="leapray-") as folder:
        path = Path(folder, "made.vdb")
        if not volume.grids.save(filepath=str(path)):
            raise LeapRayError(f"its grids cannot be saved: {volume.grids.error_message}")
        name = grid_name(own, volume)
        grid = listening(
            lambda watch: leapray.read_volume(path, grid=name, watch=watch), caller, volume.name
        )
        grid = replace(grid, source="")
        return grid, _digest(grid)


def _digest(grid: ScalarGrid) -> str:
    samples = grid.samples
    assert isinstance(samples, Leaves)
    told = repr((grid.scale, grid.offset, grid.kind, grid.no_data, samples.background)).encode()
    blocks = (samples.samples[k : k + HASHED] for k in range(0, len(samples.samples), HASHED))
    tiles = samples.tile_origins, samples.tile_sizes, samples.tile_values
    return arrays.digest(itertools.chain((samples.origins, *tiles), blocks), told)
