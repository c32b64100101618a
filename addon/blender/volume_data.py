# SPDX-License-Identifier: GPL-3.0-or-later
"""Volume objects of measured data, and what the panel tells of their values.

The datablock keeps the file's path, so that a saved scene renders again; the object's matrix
brings the data's unit of length to the scene's.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix
from numpy.typing import NDArray

import leapray
from leapray.formats import FORMATS

from ..plan import objects
from . import properties
from .read import volumes
from .read.links import node_tree

SMALLEST, LARGEST = 1e-3, 1e5  # units of the scene that imported data may be long
BINS = 128
HEIGHT = 128  # pixels of the histogram's picture, as wide as it has bins
BAR, BACK = (0.55, 0.55, 0.55, 1.0), (0.11, 0.11, 0.11, 1.0)
MARKS = ((1.0, 0.55, 0.1, 1.0), (0.3, 0.7, 1.0, 1.0), (0.5, 0.9, 0.3, 1.0))  # of each threshold


@dataclass(frozen=True, eq=False)
class Values:
    """What the panel tells of a grid."""

    size: tuple[int, int, int]  # samples
    quantity: str  # unit of the values
    histogram: leapray.Histogram
    threshold: float  # the automatic one
    how: str  # it was found
    labels: bool = False  # they name regions

    @property
    def limits(self) -> tuple[float, float]:
        """The least and the greatest value, to a bin."""
        return float(self.histogram.edges[0]), float(self.histogram.edges[-1])


# ---- what is known of data ---------------------------------------------------

_known: dict[tuple, Values] = {}  # by what a volume asks for
_shown: tuple | None = None  # what the picture shows
_pictures = None  # Blender's collection of the one picture


def asked(volume) -> tuple:
    """What tells the data that a volume asks for: its files, its grid, its frame."""
    own = properties.isosurfaces(volume)
    file = own.file or volume.grids.frame_filepath or volume.filepath
    return volumes.absolute(file, volume.library), own.grid, own.frame


def known(volume) -> Values | None:
    """The values of a volume's data, if they were looked at."""
    return _known.get(asked(volume))


def look(ob, depsgraph) -> Values:
    """Read the data of a volume object for the panel. Raises LeapRayError."""
    grid = volumes.grid_of(ob.evaluated_get(depsgraph), ob.data, depsgraph)
    if grid is None:
        raise leapray.LeapRayError(f"'{ob.name}' has no data in this frame")
    first, last = objects.lattice(grid)
    size = tuple((last - first - 1).tolist())
    told = leapray.histogram(grid, BINS), *leapray.first_threshold(grid)
    found = Values(size, grid.quantity, *told, grid.kind == "labels")
    _known[asked(ob.data)] = found
    return found


def picture(values: Values, thresholds: tuple[float, ...]) -> int:
    """The icon of the histogram with the thresholds marked."""
    global _pictures, _shown
    import bpy.utils.previews

    if _pictures is None:
        _pictures = bpy.utils.previews.new()
    if (values, thresholds) != _shown:
        _pictures.clear()
        pixels = drawn(values.histogram, thresholds)
        preview = _pictures.new("histogram")
        preview.image_size = pixels.shape[1], pixels.shape[0]
        preview.image_pixels_float = pixels.ravel().tolist()
        _shown = values, thresholds
    return _pictures["histogram"].icon_id


def drawn(histogram: leapray.Histogram, thresholds: tuple[float, ...]) -> NDArray[np.float32]:
    """(HEIGHT, n, 4), rows from below: bars as high as the logarithm of their counts."""
    n = len(histogram.counts)
    heights = np.log1p(histogram.counts) / np.log1p(max(histogram.counts.max(), 1))
    rows = (np.arange(HEIGHT)[:, None] + 0.5) / HEIGHT
    pixels = np.where((rows < heights)[..., None], np.array(BAR), np.array(BACK))
    lo, hi = histogram.edges[0], histogram.edges[-1]
    for threshold, color in zip(thresholds, MARKS, strict=False):
        if lo <= threshold <= hi:
            pixels[:, min(int((threshold - lo) / (hi - lo) * n), n - 1)] = color
    return pixels.astype(np.float32)


def forget() -> None:
    """Drop what is known, and the picture."""
    global _pictures, _shown
    _known.clear()
    volumes.kept.clear()
    if _pictures is not None:
        import bpy.utils.previews

        bpy.utils.previews.remove(_pictures)
    _pictures = _shown = None


# ---- files -------------------------------------------------------------------


def suffixes() -> list[str]:
    """Of the files that can be read."""
    return list(dict.fromkeys(end for each in FORMATS for end in each.suffixes))


def dropped() -> list[str]:
    """The last parts of the suffixes, but of OpenVDB's, which Blender takes itself."""
    return list(dict.fromkeys(f".{end.rpartition('.')[2]}" for end in suffixes() if end != ".vdb"))


# ---- new objects -------------------------------------------------------------


def add(scene, path: Path, grid: str = "") -> tuple[bpy.types.Object, leapray.ScalarGrid]:
    """A new volume object of a file's data, where the file says they are, and these; it is grey.

    Its child, an empty, shows the box of the data in the viewport, which draws OpenVDB alone.
    Raises LeapRayError where the file cannot be read; then nothing is added.
    """
    data, _ = volumes.kept.read(path, grid or None, 0, leapray.Watch())
    name = path.name.partition(".")[0] or path.name
    volume = bpy.data.volumes.new(name)
    if path.suffix.lower() == ".vdb":
        volume.filepath = str(path)
    else:
        volume.leapray.file = str(path)
    volume.leapray.grid = grid
    material = bpy.data.materials.new(name)
    material.diffuse_color = (0.8, 0.8, 0.8, 1.0)
    node_tree(material)
    volume.materials.append(material)
    ob = bpy.data.objects.new(name, volume)
    ob.scale = (scene_units(scene, data),) * 3
    scene.collection.objects.link(ob)
    if volume.leapray.file:
        scene.collection.objects.link(_box(ob, data))
    return ob, data


def _box(ob, grid: leapray.ScalarGrid) -> bpy.types.Object:
    """An empty cube, -1 to 1 in its own space, round the samples of the object's grid."""
    first, last = objects.lattice(grid)
    half = (last - first - 2) / 2
    of_cube = np.diag([*np.maximum(half, 0.5), 1.0])
    of_cube[:3, 3] = first + 1 + half
    box = bpy.data.objects.new(f"{ob.name} box", None)
    box.empty_display_type = "CUBE"
    box.parent = ob
    box.matrix_parent_inverse = Matrix((grid.world_from_index @ of_cube).tolist())  # may shear
    return box


def scene_units(scene, grid: leapray.ScalarGrid) -> float:
    """Units of the scene in one of the data; 1 where the data do not say.

    Data that would then be too small or too large are taken to be one unit long.
    """
    unit = grid.meters / scene.unit_settings.scale_length if grid.meters else 1.0
    size = np.ptp(objects.lattice(grid), axis=0) - 2.0
    sides = size * np.linalg.norm(np.asarray(grid.world_from_index)[:3, :3], axis=0)
    longest = float(sides.max()) or 1.0
    return unit if SMALLEST <= unit * longest <= LARGEST else 1.0 / longest
