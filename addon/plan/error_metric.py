# SPDX-License-Identifier: GPL-3.0-or-later
"""The error of a volume against its mesh, and how a view shows it (no bpy).

The error at a point of the surface is |f - T| / |grad f|: the distance between
the point and the field's own surface, to first order. Where a wall is thinner
than the lattice resolves, the field never reaches T: such points are *lost*.
At creases the field rounds the corner, and its normal turns within about a voxel
(*blur*). Triangle cells have none of these errors. Triangles finer than the voxels
lose *color*. Shading normals, of the field or of triangles, are compared with the
mesh's own, smooth or flat as its faces are.

Each has its tolerance. Those of edges follow from what is visible: an outline with a
mean error of half a pixel changes a quarter of the pixels at the edge, and a corner
that turns within two pixels looks sharp.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

import leapray
from leapray.arrays import ONES
from leapray.voxelization import filter_info, slope

from .. import model
from ..arrays import lengths
from .probes import Probes, Weights

STEPS = ONES | {"f32": 1 << 24}  # of a sample's type between 0 and 1
TURN_OF_U8 = math.radians(0.12)  # mean over faces askew of the lattice, where nothing says better
SATURATED = 2.5  # voxels: the ramp ends there: larger errors cannot be measured
LEAST_SLOPE = 0.25  # of the filter's: at creases the gradient can vanish though f is right
INSIDE = (0.25, 0.5, 1.0, 2.0)  # voxels behind a point that is not lost, f reaches T somewhere

QUANTILE = 0.99  # of the pixels keep the error
FEW = 4  # times as many probes as their share of the weights hold that quantile, mostly
MANY, SAMPLE, ABOUT = 2048, 256, 0.15  # values; so many of them tell another quantile about
MARGIN = 1.25  # what is measured at probes predicts that quantile within 20 %
LOST_SHARE = 0.03  # of the pixels: wedges are always lost at their very edge
MOSTLY = 0.5  # of a body's pixels: a wire beside a ball has too few for the quantile
LEAST_BODY = 1 / 1000  # of the pixels: smaller bodies are not tested separately
ROUGH = 0.25  # of a voxel
THIN = 0.25  # of a footprint: surfaces that such voxels miss may be lost
CREASE_ERROR = 0.5  # of a footprint, the mean along creases that are outlines
CROWD = 12.0  # triangles on a triangle cell's list, the mean, while its voxel is above CREASE_VOXEL
CREASE_VOXEL = 2.0  # footprints, the mean along creases: corners look sharp
CARRIED = 0.5  # of such a voxel counts if the volume has normals, which turn within one cell
SHARP_VOXEL = 1.0  # footprints, likewise: facets of a dozen pixels look flat
NORMAL_ERROR = math.radians(2.0)  # the quantile; light at 45 degrees changes by 3.5 %
ROUGHNESS = 3.0  # times that, RMS: what is finer than a pixel keeps its mean light within 0.5 %
NORMAL_STEP = 4  # probes of which one is for normals, while the rest asks for finer voxels anyway
COLOR_STEP = 4  # probes of which one is for colours: a mean needs fewer than a quantile, and looks
# at textures take long
COLOR_ERROR = 0.01  # of the square root of light, the mean: black and white checks need 0.4 pixel


@dataclass(frozen=True)
class Measure:
    """What is known of a mesh at one voxel size; errors are object-space lengths at its probes."""

    voxel_size: float
    dtype: str  # of the samples
    step: float  # most that rounding to it moves the surface
    turn: float  # of normals by it, the mean in radians
    surface: NDArray[np.float32]
    lost: NDArray[np.bool_]
    normal: NDArray[np.float32]  # radians between the shading normals of hits and the mesh's; of
    # a level that is too coarse for other reasons at every NORMAL_STEP-th probe
    crease: NDArray[np.float32]
    sharp: NDArray[np.bool_]  # creases in triangle cells
    exact_share: float  # of the surface cells
    crowd: float  # triangles on a triangle cell's list, the mean; 0 without such cells
    n_cells: int  # that hold surface
    color: (
        NDArray[np.float32] | None
    )  # (n / COLOR_STEP, k) as mesh_colors.color_errors gives it; None: no colours
    shape: tuple[int, int, int]
    kind: str
    normals: bool  # the mesh's own are in the volume
    why: str  # it is a sheet, or a solid where that is not obvious; else ""
    doubtful: bool  # the user may have meant the other kind
    volume_nbytes: int
    structure_nbytes: int

    @property
    def nbytes(self) -> int:
        return self.volume_nbytes + self.structure_nbytes

    def fits(self, probes: Probes) -> bool:
        """Can it have been measured at these probes?"""
        n, n_creases = len(probes.surface), len(probes.creases)
        n_color = len(probes.surface[::COLOR_STEP])
        color = self.color is None or (self.color.ndim == 2 and len(self.color) == n_color)
        return (
            color
            and self.surface.shape == self.lost.shape == (n,)
            and self.normal.shape in ((n,), (len(probes.surface[::NORMAL_STEP]),))
            and self.crease.shape == self.sharp.shape == (n_creases,)
        )

    @property
    def normals_known(self) -> bool:
        """Whether normals were measured at all probes."""
        return self.normal.shape == self.surface.shape

    @cached_property
    def typical(self) -> float:
        """The error that the quantile of the surface keeps, in object space."""
        found = self.surface[~self.lost]
        return float(np.quantile(found, QUANTILE)) if len(found) else 0.0


@dataclass(frozen=True)
class Errors:
    """Of one volume in one view; lengths in footprints."""

    surface: float  # the quantile, without what is lost
    steps: float  # the part of it that the samples' type explains
    lost: float  # fraction of the pixels, or of a body's if that is mostly lost
    normal: float  # of shading, radians: the quantile, or a third of the RMS if that is more
    voxel: float  # the mean over the surface
    crease: float  # the mean along outlines
    blur: float  # the voxel, the mean along creases that are seen; 0 without creases
    color: float  # the mean over the surface; 0 without colours
    crowd: float  # as measured
    body: float  # the error that most pixels of a body have, the worst

    @property
    def worst(self) -> float:
        """The error of the surface, all of it or its worst body."""
        return max(self.surface, self.body)

    def of_surface(self, pixel_error: float) -> float:
        """Relative to the surface's tolerances; at most 1 is good enough."""
        return max(self.worst / pixel_error, min(self.lost / LOST_SHARE, self.voxel / THIN))

    def of_edges(self) -> float:
        """Relative to the tolerances of creases and crowded cells; at most 1 is good enough."""
        crowded = min(self.crowd / CROWD, self.voxel / CREASE_VOXEL)
        return max(self.crease / CREASE_ERROR, self.blur / CREASE_VOXEL, crowded)

    def enough(self, pixel_error: float) -> bool:
        """Whether everything is as good as asked for."""
        return self.of_normals() <= 1 and self.enough_but_normals(pixel_error)

    def enough_but_normals(self, pixel_error: float) -> bool:
        """Whether everything else is."""
        return max(self.of_surface(pixel_error), self.of_color(), self.of_edges()) <= 1

    def of_normals(self) -> float:
        """Relative to the tolerance of shading normals; at most 1 is good enough."""
        return self.normal / NORMAL_ERROR

    def of_color(self) -> float:
        """Relative to the tolerance of colours; at most 1 is good enough."""
        return self.color / COLOR_ERROR

    def progress(self, pixel_error: float) -> float:
        """The errors that finer voxels reduce, if any do."""
        lost = self.voxel if self.lost > LOST_SHARE else 0.0
        others = self.of_normals(), self.of_color(), self.of_edges()
        return max(self.worst / pixel_error, lost, *others)

    def levels(self, pixel_error: float) -> int:
        """How many times the voxel must be halved at least, predicted from these errors.

        The error of a curved surface falls to a quarter when the voxel is halved,
        that of an edge to half. What is more than ROUGH voxels off is no such
        error yet: it may vanish at the next level.
        """
        if self.of_surface(pixel_error) > 1:
            ratio = min(self.worst, ROUGH * self.voxel) / pixel_error
            return max(1, math.floor(math.log2(max(ratio, 1.0)) / 2))
        if max(self.of_normals(), self.of_color()) > 1:
            return 1  # facets may show, a texture may be smooth just below
        ratios = (
            min(self.crease, ROUGH * self.blur) / CREASE_ERROR,
            self.blur / CREASE_VOXEL,
            1.0,
        )
        return max(1, math.floor(math.log2(max(ratios))))

    def sharpening(self, carried: bool) -> int:
        """How many times the voxel must be halved for edges at least, if nothing else helps them.

        Then blur falls to half, and lists of triangles to a quarter. carried: whether the volume
        has normals; else finer ones may get some.
        """
        blur = (1.0 if carried else CARRIED) * self.blur / CREASE_VOXEL
        crowded = min(math.sqrt(self.crowd / CROWD), self.voxel / CREASE_VOXEL)
        return math.ceil(math.log2(max(blur, crowded, 1.0)))

    def softness(self) -> float:
        """How many times creases are too coarse to look their best; 1 is good enough."""
        return max(self.blur / SHARP_VOXEL, 1.0)

    def sentence(self, pixel_error: float) -> str:
        """What is not good enough, or ""."""
        if self.worst > pixel_error:
            return f"an error of {self.worst:.2g} pixels instead of {pixel_error:g}"
        if self.of_surface(pixel_error) > 1:
            return f"{100 * self.lost:.0f} % of its surface thinner than its voxels"
        if self.of_normals() > 1:
            return f"shading normals that are {math.degrees(self.normal):.1f} degrees off"
        if self.of_color() > 1:
            return f"colours that are {100 * self.color:.0f} % off"
        if self.crease > CREASE_ERROR:
            return f"creases that are {self.crease:.2g} pixels off"
        if self.blur > CREASE_VOXEL:
            return f"creases that are {self.blur:.2g} pixels wide"
        return ""


def measure(
    volume: leapray.Volume,
    mesh: model.Mesh,
    probes: Probes,
    voxel_size: float,
    color: NDArray[np.float32] | None = None,
    slope_across: float | None = None,
    gain: float = 0.0,
    normal: NDArray[np.float32] | None = None,
    threads: int = 1,
) -> Measure:
    """Measure the volume of a mesh, as voxelized with that voxel size, at the mesh's probes.

    color: what mesh_colors.color_errors measured there. slope_across: occupancy per voxel across
    a plane, before gain; None: that of the ramp. Where several solids share the volume, each is
    compared with its own field, by the slots of the mesh. gain above 0: as `volume.narrow(gain)`
    would leave it; then normal is what was measured before, else normals are measured at every
    NORMAL_STEP-th probe. The structure's bytes are the caller's to add.
    """
    info, made = volume.info, volume.mesh_info
    sheet = info.kind == "sheet"
    normals = None if sheet else probes.surface_normals * (-1.0 if made.inverted else 1.0)
    own, beside = None, None
    if info.n_objects:
        assert mesh.slots is not None
        own, beside = mesh.slots[probes.surface_triangles], mesh.slots[probes.crease_triangles]
    slope_across = (slope_across or _slope_across(volume)) * (gain or 1.0)
    at = voxel_size, slope_across
    surface, lost = measure_surface(volume, probes.surface, normals, *at, own, gain)
    if normal is None:
        normal = normal_errors(volume, mesh, probes, surface, own, threads, NORMAL_STEP)
    crease, _ = measure_surface(volume, probes.creases, None, *at, beside, gain)
    dtype = "u8" if gain else info.dtype
    of_samples = info.n_triangle_cells < info.n_surface_cells  # some surface, and its normals
    why = ""
    if sheet and made.n_border_edges:
        why = f"open: {made.n_border_edges} border edges"
    elif sheet:
        why = f"not closed: {made.n_bad_edges} edges of many faces or of opposite winding"
    elif not made.obvious:
        why = made.why
    return Measure(
        voxel_size=voxel_size,
        dtype=dtype,
        step=0.5 / STEPS[dtype] / slope_across * voxel_size,
        turn=TURN_OF_U8 if dtype == "u8" and of_samples else 0.0,
        surface=surface,
        lost=lost,
        normal=np.where(lost[:: len(lost) // len(normal)], np.float32(0), normal),
        crease=crease,
        sharp=volume.exact_at(probes.creases),
        exact_share=info.n_triangle_cells / max(info.n_surface_cells, 1),
        crowd=info.n_cell_triangles / max(info.n_triangle_cells, 1),
        n_cells=info.n_surface_cells,
        color=color,
        shape=info.size,
        kind=info.kind,
        normals=info.has_normals,
        why=why,
        doubtful=not (made.obvious or made.closed or (sheet and made.n_border_edges)),
        volume_nbytes=info.nbytes,
        structure_nbytes=0,
    )


def _slope_across(volume: leapray.Volume) -> float:
    """Of occupancy per voxel across a plane, as the ramp has it."""
    return slope("ramp", filter_info("ramp", volume.info.dtype).half_width)


def measure_surface(
    volume: leapray.Volume,
    points: NDArray,
    normals: NDArray | None,
    voxel_size: float,
    slope_across: float | None = None,
    ids: NDArray[np.uint16] | None = None,
    gain: float = 0.0,
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Distance of the field's surface from points of the mesh, and which points are lost.

    points: (n, 3). normals: (n, 3) outward, or None where nothing can be lost.
    Distances are in object space, at most SATURATED voxels.
    """
    value, gradient = volume.sample(points, ids, gain)
    threshold = volume.info.threshold
    most = SATURATED * voxel_size
    steep = lengths(gradient)
    least = LEAST_SLOPE * (slope_across or _slope_across(volume)) / voxel_size
    error = np.minimum(np.abs(value - threshold) / np.maximum(steep, least), most)
    exact = volume.exact_at(points)
    error[exact] = 0.0
    lost = np.zeros(len(points), np.bool_)
    if normals is not None:
        lost = (value < threshold) & ~exact
        for depth in INSIDE:
            behind = points[lost] - depth * voxel_size * normals[lost]
            whose = None if ids is None else ids[lost]
            lost[lost] = volume.sample(behind, whose, gain)[0] < threshold
    return error.astype(np.float32), lost


def with_normals(
    measure: Measure,
    volume: leapray.Volume,
    mesh: model.Mesh,
    probes: Probes,
    threads: int = 1,
) -> Measure:
    """The same with normals that are measured at all probes."""
    ids = None
    if volume.info.n_objects:
        assert mesh.slots is not None
        ids = mesh.slots[probes.surface_triangles]
    normal = normal_errors(volume, mesh, probes, measure.surface, ids, threads)
    return dataclasses.replace(measure, normal=np.where(measure.lost, np.float32(0), normal))


def seen(measure: Measure, weights: Weights, pixel_error: float) -> Errors:
    """The measured errors as a view shows them.

    Normals count at all probes only where nothing else is above its tolerance, so that it does
    not matter what another view has measured.
    """
    m, w = measure, weights
    pixels = w.surface_pixels / w.surface_pixels.sum()
    found = ~m.lost
    surface, steps = 0.0, 0.0
    turn = m.voxel_size * (CARRIED if m.normals else 1.0)
    if found.any():
        shown = w.surface_footprint[found], pixels[found], QUANTILE
        surface = quantile(m.surface[found] / shown[0], *shown[1:])
        steps = quantile(m.step / shown[0], *shown[1:])
    lost, body = _worst_body(m, w, pixels)
    errors = Errors(
        surface=MARGIN * surface,
        steps=MARGIN * min(steps, surface),
        lost=max(float(pixels[m.lost].sum()), lost),
        normal=0.0,
        voxel=float((m.voxel_size / w.surface_footprint * pixels).sum()),
        crease=mean(m.crease / w.outline_footprint, 1 / w.outline_footprint),
        blur=mean(np.where(m.sharp, 0, turn) / w.crease_footprint, 1 / w.crease_footprint),
        color=color_seen(m, w) if m.color is not None else 0.0,
        crowd=m.crowd,
        body=body,
    )
    step = 1 if m.normals_known and errors.enough_but_normals(pixel_error) else NORMAL_STEP
    return dataclasses.replace(errors, normal=normal_seen(m, w, step))


def _worst_body(measure: Measure, weights: Weights, pixels: NDArray) -> tuple[float, float]:
    """The fraction of a body's pixels that are lost, if most are; the error that most have."""
    of, error = weights.surface_bodies, measure.surface / weights.surface_footprint
    fraction = np.bincount(of, pixels)
    lost = np.bincount(of, pixels * measure.lost)
    worst, found = 0.0, 0.0
    for body in np.flatnonzero(fraction > LEAST_BODY):
        if lost[body] > MOSTLY * fraction[body]:
            worst = max(worst, float(lost[body] / fraction[body]))
        else:
            own = (of == body) & ~measure.lost
            found = max(found, quantile(error[own], pixels[own], MOSTLY))
    return worst, found


def normal_errors(
    volume: leapray.Volume,
    mesh: model.Mesh,
    probes: Probes,
    off: NDArray[np.float32],
    ids: NDArray[np.uint16] | None = None,
    threads: int = 1,
    step: int = 1,
) -> NDArray[np.float32]:
    """Radians (n,) between the shading normals that hits have at the probes and the mesh's own.

    Rays that aim at a probe hit the field's surface beside it, as far as that is off and they
    are askew; beside an edge that may be another face's. Not above a quarter turn: which side
    is outside is not judged. off: (n,) what `measure_surface` gave. ids: (n,) of solids that
    share the volume, or None. step: at every so manieth probe. In triangle cells hits have the
    normal of the triangle that is met, unless it is smooth and the volume has none: there is no
    error.
    """
    errors = np.zeros(len(probes.surface[::step]), np.float32)
    some = np.arange(0, len(probes.surface), step)
    if mesh.corner_normals is None or volume.info.has_normals:
        some = some[~volume.exact_at(probes.surface[::step])]
    if not len(some):
        return errors
    own = probes.shading_normals(mesh)[some]
    at = probes.surface[some] + off[some, None] * probes.askew[some]
    found = volume.normals(at, None if ids is None else ids[some], threads=threads)
    side = np.where(np.einsum("nc,nc->n", found, own) < 0, -1.0, 1.0)
    chord = lengths(found - side[:, None] * own)
    errors[some // step] = np.nan_to_num(2 * np.arcsin(np.minimum(chord / 2, 1.0)))
    return errors


def normal_seen(measure: Measure, weights: Weights, step: int) -> float:
    """The error of shading normals as pixels show it, at every so manieth probe, radians.

    A pixel that holds several voxels or triangles averages what they are off, but for what
    roughness takes from the mean light.
    """
    some = slice(None, None, step)
    normal = measure.normal[some] if measure.normals_known else measure.normal
    pixels, footprint = weights.surface_pixels[some], weights.surface_footprint[some]
    width = np.minimum(measure.voxel_size / footprint, weights.surface_facets[some])
    shown = normal * np.minimum(width, 1.0)
    rough = math.sqrt(mean(np.square(normal, dtype=np.float64), pixels)) / ROUGHNESS
    return max(quantile(shown, pixels, QUANTILE), rough)


def color_seen(measure: Measure, weights: Weights) -> float:
    """The mean error of colours as pixels show it.

    A pixel shows the texture averaged over its own width, so a voxel of 2^k
    footprints is measured by column k. A pixel that holds several voxels averages
    their errors.
    """
    assert measure.color is not None
    ratio = measure.voxel_size / weights.surface_footprint[::COLOR_STEP]
    last = measure.color.shape[1] - 1
    k = np.clip(np.log2(np.maximum(ratio, 1.0)), 0.0, last)
    below = np.minimum(k.astype(np.int64), last - 1)
    rows = np.arange(len(k))
    low, high = measure.color[rows, below], measure.color[rows, below + 1]
    error = (low + (k - below) * (high - low)) * np.minimum(ratio, 1.0)
    return mean(error, weights.surface_pixels[::COLOR_STEP])


def quantile(values: NDArray, weights: NDArray, q: float) -> float:
    """The least value that the fraction q of the weights does not exceed.

    A high quantile is looked for among the largest values, as few as may hold it; another one
    between two values that some probes take for its neighbours.
    """
    n_top = int(FEW * (1 - q) * len(values))
    if 0 < n_top < len(values) / FEW:
        top = np.argpartition(values, len(values) - n_top)[-n_top:]
        top = top[np.argsort(values[top])]
        total = weights.sum()
        below = total - weights[top].sum()
        if below < q * total:
            cumulative = below + np.cumsum(weights[top])
            return float(values[top[min(np.searchsorted(cumulative, q * total), n_top - 1)]])
    elif len(values) > MANY:
        some = slice(None, None, len(values) // SAMPLE)
        low, high = (quantile(values[some], weights[some], at) for at in (q - ABOUT, q + ABOUT))
        inside = np.flatnonzero((values >= low) & (values <= high))
        below, total = weights[values < low].sum(), weights.sum()
        if below < q * total <= below + weights[inside].sum():
            order = inside[np.argsort(values[inside])]
            at = np.searchsorted(below + np.cumsum(weights[order]), q * total)
            return float(values[order[min(at, len(order) - 1)]])
    order = np.argsort(values)
    cumulative = np.cumsum(weights[order])
    return float(
        values[order[min(np.searchsorted(cumulative, q * cumulative[-1]), len(values) - 1)]]
    )


def mean(values: NDArray, weights: NDArray) -> float:
    """The weighted mean; 0 of nothing."""
    return float((values * weights).sum() / weights.sum()) if len(values) else 0.0
