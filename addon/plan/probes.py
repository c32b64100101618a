# SPDX-License-Identifier: GPL-3.0-or-later
"""Points where a volume's error is measured, and the size of a pixel there (no bpy).

A mesh gets two sets of probes, drawn once from a fixed seed and independent
of the view, so that measured errors stay valid when the camera moves:

- points of the surface, uniform by area: the trilinear field flattens curvature;
- points of its creases, uniform by length: there it rounds the corner.

A view turns an error in object space into pixels: it divides it by the
footprint, the width of a pixel at the probe's depth, brought into object space.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

import leapray
from leapray.arrays import bounds

from .. import model
from ..arrays import blend, crossed, inverse, lengths, unit
from ..memory import pieces
from . import mesh_split

N_SURFACE = 8192
N_EDGE = 2048
CREASE_COSINE = np.cos(np.radians(15.0))  # smaller angles count as smooth surface
LOOSE = 1e-5  # of the cosine: more than the rounding of f32
SEED = 1994
NOT_GRAZING = 0.8  # square of the largest sine between a ray and the normal that is tested
N_INSTANCES = 32  # of one mesh that are tested: the most demanding ones
UNSEEN = 4.0  # factor for what only shadows and reflections show

NEAREST = 1e-6  # world units: least distance from the eye of a footprint

Points = NDArray[np.float64]  # (n, 3)


@dataclass(frozen=True)
class Probes:
    """Points on a mesh, in its own space."""

    surface: Points
    surface_normals: Points  # unit
    surface_triangles: NDArray[np.int64]  # (n,) that the points lie in,
    surface_weights: NDArray[np.float64]  # (n, 3) barycentric
    surface_facets: NDArray[np.float64]  # (n,) widths of those triangles: of squares as large
    surface_bodies: NDArray[np.int32]  # (n,) of the mesh that they are of: solids, or islands
    creases: Points
    crease_triangles: NDArray[np.int64]  # (n,) one of those beside
    crease_normals: NDArray[np.float64]  # (n, 2, 3): of the triangles on either side, unit
    area: float
    largest: float  # area of a triangle
    crease_length: float
    _shading: dict[str, Points] = field(default_factory=dict, init=False, repr=False, compare=False)

    def shading_normals(self, mesh: model.Mesh) -> Points:
        """(n, 3), unit: the mesh's own at the points of the surface, smooth or flat."""
        name = mesh.corner_names[0]
        if mesh.corner_normals is None:
            return self.surface_normals
        if name not in self._shading:
            smooth = unit(blend(self.surface_weights, mesh.corner_normals[self.surface_triangles]))
            known = smooth.any(axis=1)[:, None]
            self._shading[name] = np.where(known, smooth, self.surface_normals)
        return self._shading[name]

    @cached_property
    def askew(self) -> Points:
        """(n, 3): in the planes across the normals, lengths those of the tangents of rays' angles.

        Rays from everywhere have sines of them whose squares are uniform between 0 and 1; those
        that graze are left to the rims. Drawn evenly (Roberts 2018, the R2 sequence).
        """
        normals = self.surface_normals
        n = np.arange(1, len(normals) + 1)
        square, turn = np.modf(n * 0.7548776662466927)[0], n * (0.5698402909980532 * 2 * np.pi)
        square *= NOT_GRAZING
        tangent = np.sqrt(square / (1 - square))
        least = np.eye(3)[np.abs(normals).argmin(axis=1)]
        first = unit(np.cross(normals, least))
        second = np.cross(normals, first)
        return tangent[:, None] * (np.cos(turn)[:, None] * first + np.sin(turn)[:, None] * second)


def _facets(mesh: model.Mesh, chosen, longest: float) -> NDArray[np.float32]:
    """(n, 3): cross products of the sides of chosen triangles, lengths divided by longest."""
    a, b, c = (mesh.vertices[mesh.triangles[chosen, k]] / np.float32(longest) for k in range(3))
    return np.stack(crossed((b - a).T, (c - a).T), axis=1)


def _areas(
    mesh: model.Mesh, longest: float, check_cancelled: Callable[[], None]
) -> NDArray[np.float64]:
    """(m,) areas of the triangles."""
    areas = np.empty(len(mesh.triangles))
    places = [np.ascontiguousarray(x) / np.float32(longest) for x in mesh.vertices.T]
    for some in pieces(len(areas)):
        check_cancelled()
        corners = mesh.triangles[some].astype(np.intp).T
        a, b, c = ([x.take(corner) for x in places] for corner in corners)
        sides = ([q - p for p, q in zip(a, end, strict=True)] for end in (b, c))
        x, y, z = crossed(*sides)
        areas[some] = np.sqrt(x * x + y * y + z * z)
    areas *= longest * longest / 2
    return areas


def _place_keys(places: NDArray[np.float32]) -> NDArray[np.uint64]:
    """64 bits mixed from the coordinates' bits of each place (n, 3): equal where they are equal."""
    bits = (np.asarray(places, np.float32) + np.float32(0)).view(np.uint32)
    key = np.zeros(len(bits), np.uint64)
    for axis in range(3):
        key = (key ^ bits[:, axis].astype(np.uint64)) * np.uint64(0x9E3779B97F4A7C15)
        key = (key ^ key >> np.uint64(32)) * np.uint64(0xD6E8FEB86659FD93)
        key ^= key >> np.uint64(29)
    return key


def creases(
    mesh: model.Mesh,
    longest: float,
    check_cancelled: Callable[[], None] = lambda: None,
    watch: leapray.Watch | None = None,
) -> NDArray[np.uint32]:
    """(n, 2): the first two half-edges of every edge at which the mesh turns by more than an angle.

    Half-edge 3 t + e runs from corner e of triangle t to the next; edges are told by their places.
    In an order of its own, mixed from the places of their ends, so that how a mesh is numbered
    does not matter. longest: the mesh's side.
    """
    about = CREASE_COSINE + LOOSE
    found, _ = leapray.mesh_edges(mesh.vertices, mesh.triangles, about, unit=longest, watch=watch)
    check_cancelled()
    keep = np.zeros(len(found), np.bool_)
    lower, higher = np.empty(len(found), np.uint64), np.empty(len(found), np.uint64)
    for some in pieces(len(found)):
        check_cancelled()
        first, second = found[some].T
        one, other = (_facets(mesh, half // 3, longest) for half in (first, second))
        keep[some] = turns(one, other)
        ends = [_place_keys(mesh.vertices[v]) for v in _end_vertices(mesh, first)]
        lower[some], higher[some] = np.minimum(*ends), np.maximum(*ends)
    order = np.lexsort((higher[keep], lower[keep]))
    return found[keep][order]


def _spread(length: NDArray[np.float64], n: int, random: np.random.Generator):
    """n pieces drawn in proportion to their size, evenly spread, and a place 0..1 in each.

    The sizes become their sums.
    """
    cumulative = np.cumsum(length, out=length)
    at = (np.arange(n) + random.random(n)) * (cumulative[-1] / n)
    return np.minimum(
        np.searchsorted(cumulative, at, side="right"), len(length) - 1
    ), random.random(n)


def draw(
    mesh: model.Mesh,
    check_cancelled: Callable[[], None] = lambda: None,
    watch: leapray.Watch | None = None,
    one_island: bool = False,
) -> Probes:
    """Draw the probes of a mesh with finite vertices and at least one triangle that has an area.

    one_island: the mesh is known to be just that.

    check_cancelled is called every few hundred milliseconds per million triangles; it may raise.
    watch stops the calls into the core.
    """
    random = np.random.default_rng(SEED)
    vertices, triangles = mesh.vertices, mesh.triangles
    # the unit of what follows: f32 overflows
    longest = float(np.ptp(bounds(vertices), axis=0).max())
    area = _areas(mesh, longest, check_cancelled)
    whole, largest = float(area.sum()), float(area.max())

    chosen, u = _spread(area, N_SURFACE, random)
    del area
    u, v = np.sqrt(u), random.random(N_SURFACE)
    weights = np.stack([1 - u, u * (1 - v), u * v], axis=1)
    surface = blend(weights, vertices[triangles[chosen]])
    facets = _facets(mesh, chosen, longest)
    widths = lengths(facets).astype(np.float64) * (longest * longest / 2)

    def normals(some: NDArray[np.int64]) -> Points:
        """Of some triangles, given by any of their half-edges."""
        return unit(_facets(mesh, some // 3, longest).astype(np.float64))

    check_cancelled()
    bodies = mesh.solids  # the number of its solid; or else of its island, small ones share one
    if bodies is None:
        one = np.zeros(len(triangles), np.int32)
        bodies = one if one_island else mesh_split.islands(mesh, watch)
    edges = creases(mesh, longest, check_cancelled, watch)
    at, crease_points, crease_length = _on_edges(mesh, edges[:, 0], random)
    first, second = edges[at].astype(np.int64).T
    return Probes(
        surface=surface,
        surface_normals=unit(facets.astype(np.float64)),
        surface_triangles=chosen,
        surface_weights=weights,
        surface_facets=np.sqrt(widths),
        surface_bodies=bodies[chosen],
        creases=crease_points,
        crease_triangles=first // 3,
        crease_normals=np.stack([normals(first), normals(second)], axis=1),
        area=whole,
        largest=largest,
        crease_length=crease_length,
    )


def _on_edges(
    mesh: model.Mesh, half_edges: NDArray, random: np.random.Generator
) -> tuple[NDArray[np.int64], Points, float]:
    """Of points on half-edges: on which they are, where they are; then the whole length."""
    length = np.empty(len(half_edges))
    for some in pieces(len(length)):
        length[some] = np.linalg.norm(_ends(mesh, half_edges[some])[1], axis=1)
    whole = float(length.sum())
    if not whole > 0:
        return np.zeros(0, np.int64), np.zeros((0, 3)), 0.0
    at, where = _spread(length, N_EDGE, random)
    start, along = _ends(mesh, half_edges[at])
    return at, start + where[:, None] * along, whole


def _end_vertices(mesh: model.Mesh, half_edges: NDArray) -> tuple[NDArray, NDArray]:
    triangle, corner = half_edges // 3, half_edges % 3
    return mesh.triangles[triangle, corner], mesh.triangles[triangle, (corner + 1) % 3]


def _ends(mesh: model.Mesh, half_edges: NDArray) -> tuple[Points, Points]:
    """Where half-edges start, and their vectors."""
    start, end = _end_vertices(mesh, half_edges)
    at = mesh.vertices[start].astype(np.float64)
    return at, mesh.vertices[end] - at


def turns(
    a: NDArray[np.float32], b: NDArray[np.float32], cosine: float = CREASE_COSINE
) -> NDArray[np.bool_]:
    """Whether triangles meet at a crease; those without area never do.

    a, b: (n, 3) cross products of their sides. cosine: of the least angle of a crease.
    """
    lengths = np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
    return np.einsum("nc,nc->n", a, b) < cosine * lengths


# ---- views ------------------------------------------------------------------


@dataclass(frozen=True)
class Weights:
    """Weights of a mesh's probes in a view, over all its instances.

    footprint: object-space length of a pixel, as far as a shift along the
    probe's normal can be seen. pixels: how much of the
    image a probe stands for, up to a common factor.
    """

    surface_footprint: NDArray[np.float64]
    surface_pixels: NDArray[np.float64]
    surface_facets: NDArray[np.float64]  # widths of the triangles, in pixels
    surface_bodies: NDArray[np.int32]
    crease_footprint: NDArray[np.float64]
    outline_footprint: NDArray[np.float64]  # of the creases; large where they are no outline


def look(camera: model.Camera, points: Points, width: int, height: int):
    """Footprints of a pixel at world points, and directions towards them, of any length.

    Returns ((n,) world units, (n, 3)). Points outside the image count UNSEEN
    pixels, by their distance to the camera whatever the direction.
    """
    # A camera whose film is one point allows any model.
    pixel = min(np.linalg.norm(camera.dx), np.linalg.norm(camera.dy)) or 1.0
    across = [d / (d @ d or 1.0) for d in (camera.dx, camera.dy)]
    v = points.T - np.asarray(camera.eye, np.float64)[:, None]
    depth, *film = np.stack([camera.forward, *across]) @ v
    seen = (depth >= camera.clip_start) & (depth <= camera.clip_end)
    perspective = camera.projection == "perspective"
    if perspective:
        towards = v.T
        distance = np.sqrt(np.einsum("cn,cn->n", v, v))
        distance = np.maximum(distance, max(camera.clip_start, NEAREST))
        ahead = np.where(depth > 0, depth, np.nan)
        scale = np.maximum(depth, NEAREST)
    else:
        towards = np.broadcast_to(camera.forward, points.shape)
        distance = scale = ahead = np.ones(len(points))
    for at, along, size in zip(film, across, (width, height), strict=True):
        at = at / ahead - along @ camera.corner
        seen &= (at >= -1) & (at <= size + 1)
    return pixel * np.where(seen, scale, UNSEEN * distance), towards


def _demanding(camera: model.Camera, box: NDArray, matrices: NDArray) -> NDArray[np.int64]:
    """The instances whose pixels are the smallest in object space, by their boxes."""
    if len(matrices) <= N_INSTANCES:
        return np.arange(len(matrices))
    stretch = np.linalg.norm(matrices[:, :3, :3], 2, axis=(1, 2))
    radius = 0.5 * np.linalg.norm(box[1] - box[0]) * stretch
    centre = matrices[:, :3, :3] @ box.mean(axis=0) + matrices[:, :3, 3] - camera.eye
    if camera.projection == "perspective":
        nearest = np.maximum(np.linalg.norm(centre, axis=1) - radius, camera.clip_start)
        behind = centre @ camera.forward + radius < camera.clip_start
        nearest = np.where(behind, UNSEEN * nearest, nearest)
    else:
        nearest = np.ones(len(matrices))
    return np.argsort(nearest / stretch, kind="stable")[:N_INSTANCES]


def weigh(
    probes: Probes,
    scene: model.Scene,
    matrices: NDArray[np.float64],
    shown: NDArray[np.bool_] | None = None,
) -> Weights:
    """The weights of the probes in the scene's view.

    matrices: (n, 4, 4), of the mesh's instances. shown: (n,), whether the camera
    sees them at all; None: it does.
    """
    camera = scene.camera
    box = bounds(probes.surface)
    best: dict[str, NDArray] = {}
    surface, normals, creases = (  # coordinate by coordinate, which is faster
        np.ascontiguousarray(each.T)
        for each in (probes.surface, probes.surface_normals, probes.creases)
    )

    def keep(name: str, footprint: NDArray) -> None:
        best[name] = np.minimum(best[name], footprint) if name in best else footprint

    for index in _demanding(camera, box, matrices):
        linear, shift = matrices[index, :3, :3], matrices[index, :3, 3:]
        back = inverse(linear)
        stretch = np.linalg.norm(linear, 2)

        hidden = UNSEEN if shown is not None and not shown[index] else 1.0

        def seen(points, linear=linear, shift=shift, hidden=hidden):
            footprint, towards = look(
                camera, (linear @ points + shift).T, scene.width, scene.height
            )
            return hidden * footprint, towards

        # a shift by e along the normal n moves the surface by e / |M^-T n| in the world
        footprint, _ = seen(surface)
        turned = back.T @ normals
        keep("surface", footprint * np.sqrt(np.einsum("cn,cn->n", turned, turned)))
        if len(probes.creases):
            footprint, towards = seen(creases)
            facing = np.einsum("nkc,nc->nk", probes.crease_normals, towards @ back.T) < 0
            towards_us, outline = facing.any(axis=1), facing[:, 0] != facing[:, 1]
            keep("crease", np.where(towards_us, footprint, UNSEEN * footprint) / stretch)
            keep("outline", np.where(outline, footprint, UNSEEN * footprint) / stretch)

    none = np.zeros(0)
    crease, outline = (best.get(name, none) for name in ("crease", "outline"))
    footprint = best["surface"]
    facets, bodies = probes.surface_facets / footprint, probes.surface_bodies
    return Weights(footprint, footprint**-2.0, facets, bodies, crease, outline)
