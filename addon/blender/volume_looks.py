# SPDX-License-Identifier: GPL-3.0-or-later
"""Volume materials of presets: nodes of Blender's own, which Cycles renders as well.

An Attribute node gives the value, a Map Range the place between two values of the data, a Color
Ramp the colour and how opaque that is. What is opaque has the ramp's colour whatever the light: the
look of classical volume rendering. Of shaded looks the colour is what is scattered of the scene's
light.
"""

from __future__ import annotations

import bpy
import numpy as np

import leapray

from ..plan import objects
from .presets import LOOKS, Look, Stop
from .read import volumes
from .read.labels import color_of
from .read.links import node_tree

BINS = 4096  # in which percentiles are found,
FEW = 256  # of which at least so many lie between them: else a few values lie far out
EVEN = 1e-6  # of a value: samples that differ by less are of one
MOST_STOPS = 32  # of a ramp of Blender's
AIR = -1100.0, -900.0  # where the least value of a CT lies, which shows air
BONE = 300.0, 5000.0  # where the greatest lies, of bone and metal


def apply(ob, depsgraph, name: str) -> str:
    """Show a volume object of data by a preset, by a new material in its first slot.

    Returns a sentence that says between which values it lies, and why. Raises LeapRayError where
    the data cannot be read or hold no value.
    """
    grid = volumes.grid_of(ob.evaluated_get(depsgraph), ob.data, depsgraph)
    if grid is None:
        raise leapray.LeapRayError(f"'{ob.name}' has no data in this frame")
    return wear(ob, grid, name)


def wear(ob, grid: leapray.ScalarGrid, name: str) -> str:
    """As apply, of data that were read."""
    look = LOOKS[name]
    low, high, how = limits(grid, look)
    material = made(ob, grid, look, low, high)
    if len(ob.data.materials):
        ob.data.materials[0] = material
    else:
        ob.data.materials.append(material)
    ob.data.leapray.shown = "volume"
    ob.data.leapray.gradient_shading = look.shading
    ob.data.update_tag()
    return f"{look.label} from {low:.6g} to {high:.6g}: {how}"


def limits(grid: leapray.ScalarGrid, look: Look) -> tuple[float, float, str]:
    """Between which values a look lies, and why. Raises LeapRayError without values."""
    told = leapray.histogram(grid, BINS)
    least, most = float(told.edges[0]), float(told.edges[-1])
    if not look.stops:
        last = min(max(round(most), 1), MOST_STOPS - 1)
        how = "the labels of the data"
        if least < -0.5 or most > last + 0.5:
            how = f"values go from {least:.6g} to {most:.6g}, and those beyond look like the ends"
        return -0.5, last + 0.5, how
    if look.hounsfield is not None:
        said = grid.quantity == "HU"
        seems = AIR[0] <= least <= AIR[1] and BONE[0] <= most <= BONE[1]
        if said or seems:
            how = "Hounsfield units, as the file says"
            if not said:
                how = (
                    f"taken for Hounsfield units, for the values go from {least:.4g} to {most:.4g}"
                )
            return *look.hounsfield, how
    first, final = look.percentiles
    low, high = between(grid, told, first, final)
    if not low < high:
        low, high = least, most if most > least else least + 1.0
    return low, high, f"{first:g} to {final:g} % of the samples"


def between(
    grid: leapray.ScalarGrid, told: leapray.Histogram, first: float, final: float
) -> tuple[float, float]:
    """The values below which two shares of the samples lie, in percent.

    told: the histogram, of all samples or of those that count.
    """
    total, below = told.counts.sum(), 0
    while True:
        share = (below + np.cumsum(told.counts)) / total * 100
        starts = np.minimum(np.searchsorted(share, (first, final)), len(told.counts) - 1)
        (start, end), edges = starts.tolist(), told.edges
        left, right = float(edges[start]), float(edges[end + 1])
        as_wide = right - left > 0.5 * (edges[-1] - edges[0])
        if end - start >= FEW or as_wide or right - left <= EVEN * max(abs(left), abs(right)):
            return float(edges[start + 1]), right
        below += told.counts[:start].sum()
        told = leapray.histogram(grid, BINS, (left, right))


def made(ob, grid: leapray.ScalarGrid, look: Look, low: float, high: float):
    """The material of a look between two values."""
    material = bpy.data.materials.new(look.label)
    tree = node_tree(material)
    tree.nodes.clear()
    kinds = "Attribute", "MapRange", "ValToRGB", "Math", "VolumePrincipled", "OutputMaterial"
    nodes = [tree.nodes.new(f"ShaderNode{kind}") for kind in kinds]
    value, place, ramp, dense, shader, output = nodes
    for n, node in enumerate(nodes):
        node.location = (240.0 * n, 0.0)
    value.attribute_name = grid.name if ob.data.filepath and grid.name else "value"
    place.inputs["From Min"].default_value, place.inputs["From Max"].default_value = low, high
    _fill(ramp.color_ramp, look, grid, high)
    dense.operation = "MULTIPLY"
    dense.inputs[1].default_value = look.opaque / _longest(grid)
    for name in ("Color", "Absorption Color"):  # all is extinguished, of which Color is scattered
        shader.inputs[name].default_value = (0.0, 0.0, 0.0, 1.0)
    shader.inputs["Density Attribute"].default_value = ""
    shader.inputs["Temperature Attribute"].default_value = ""
    for start, end in (
        (value.outputs["Fac"], place.inputs["Value"]),
        (place.outputs["Result"], ramp.inputs["Fac"]),
        (ramp.outputs["Alpha"], dense.inputs[0]),
        (dense.outputs[0], shader.inputs["Density"]),
        (shader.outputs[0], output.inputs["Volume"]),
        *(
            [(ramp.outputs["Color"], shader.inputs["Color"])]
            if look.shading > 0.0
            else [
                (dense.outputs[0], shader.inputs["Emission Strength"]),
                (ramp.outputs["Color"], shader.inputs["Emission Color"]),
            ]
        ),
    ):
        tree.links.new(start, end)
    return material


def _fill(ramp, look: Look, grid: leapray.ScalarGrid, high: float) -> None:
    """The stops of a look, or one for each label below `high`."""
    stops: tuple[Stop, ...] = look.stops
    if not stops:
        last = round(high - 0.5)
        ramp.interpolation = "CONSTANT"
        stops = tuple((n / (last + 1), color_of(grid, n), float(n > 0)) for n in range(last + 1))
    for at, _, _ in stops[2:]:
        ramp.elements.new(at)
    for element, (at, color, opacity) in zip(ramp.elements, stops, strict=True):
        element.position, element.color = at, (*color, opacity)


def _longest(grid: leapray.ScalarGrid) -> float:
    """The longest side of the data, in the object's space."""
    size = np.ptp(objects.lattice(grid), axis=0) - 2.0
    sides = size * np.linalg.norm(np.asarray(grid.world_from_index)[:3, :3], axis=0)
    return float(sides.max()) or 1.0
