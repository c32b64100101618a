# SPDX-License-Identifier: GPL-3.0-or-later
"""Attributes that volumes keep of their meshes: vertex colours, textures, smooth normals (no bpy).

A volume keeps the triangles that its samples refer to, each with one source of its colour.
So its attributes depend on the materials in the slots of the instance, its *colour set*:
instances of a mesh with different colour sets have different volumes, all others share one.
Colours are kept only for slots whose material uses them. Images are looked up at the hit, by
the triangle's own UVs.

Smooth normals are kept where the plan has measured errors of the field's normals, and where
these are predicted: where facets are LARGE voxels wide or more, on at least SHOWS of the area,
and corner normals differ from theirs by more than LEAN; or where such facets meet in creases,
across which central differences would reach. Flat-shaded meshes have no corner normals, and
cells that keep triangles give the normal of the triangle that is hit; where no triangles are
kept, the facets' normals are.
"""

from __future__ import annotations

import dataclasses
import hashlib
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import leapray
from leapray import VERTEX, WHITE

from .. import arrays, model
from ..arrays import unit
from ..memory import pieces

LEAN = np.radians(0.5)  # light on a surface that it grazes changes by less than 1 %
LARGE = 2.0  # voxels: in folds of smaller facets the field's own normals err less
SHOWS = 0.25  # of the area
ROUNDED = 1.5  # times as wide may a facet be as f32 says: that is plenty


@dataclass(frozen=True)
class ColorSet:
    """Where the colours of a mesh's slots come from. Equal colour sets share a volume."""

    sources: tuple[int, ...] = ()  # per slot: WHITE, VERTEX or the number of an image; (): none
    images: tuple[str, ...] = ()  # digests


class ColorSets:
    """The colour sets of a scene, and their textures, kept over frames.

    cache: has get(key) and put(key, value), as cache.Cache.
    """

    def __init__(self, scene: model.Scene, cache, watch: leapray.Watch) -> None:
        self.scene, self.cache, self.watch = scene, cache, watch
        self.warnings: list[str] = []
        self._digests: dict[int, str] = {}  # of images
        self._pixel_digests: dict[int, bytes] = {}  # images may share them
        self._slots: dict[int, list[int]] = {}
        self._images: dict[str, model.Image] = {}

    def color_set(self, mesh: model.Mesh, materials: tuple[int, ...]) -> ColorSet:
        """Of an instance of the mesh with those materials in its slots."""
        sources: list[int] = []
        images: list[str] = []
        used = {min(slot, len(materials) - 1) for slot in self._used_slots(mesh)}
        for slot, number in enumerate(materials):
            if slot not in used:
                sources.append(WHITE)
                continue
            source, why = self._source(mesh, self.scene.materials[number], images)
            if why and why not in self.warnings:
                self.warnings.append(why)
            sources.append(source)
        if all(source == WHITE for source in sources):
            return ColorSet()
        return ColorSet(tuple(sources), tuple(images))

    def _used_slots(self, mesh: model.Mesh) -> list[int]:
        if mesh.slots is None:
            return [0]
        if id(mesh) not in self._slots:
            self._slots[id(mesh)] = np.unique(mesh.slots).tolist()
        return self._slots[id(mesh)]

    def _source(
        self, mesh: model.Mesh, material: model.Material, images: list[str]
    ) -> tuple[int, str]:
        if not material.color_source or not any(lobe.textured for lobe in material.lobes):
            return WHITE, ""
        who = f"Material {material.name!r} on mesh {mesh.name!r}"
        if material.color_source == "vertex":
            if mesh.corner_colors is None:
                return WHITE, f"{who} has no vertex colours {material.attribute!r}: white instead."
            if material.image is None:
                return VERTEX, ""
        elif material.image is None or not _has_pixels(material.image):
            return WHITE, f"{who} has a texture without an image: white instead."
        elif mesh.corner_uvs is None:
            return WHITE, f"{who} has no UVs {material.attribute!r}: white instead."
        name = self._digest(material.image)
        if name not in images:
            images.append(name)
        return images.index(name), ""

    def _digest(self, image: model.Image) -> str:
        if id(image) not in self._digests:
            form = repr((image.interpolation, image.extension)).encode()
            name = hashlib.blake2b(form, digest_size=16)
            name.update(image.program.key if image.program else b"")
            name.update(self._of_pixels(image.pixels))
            self._digests[id(image)] = name.hexdigest()
            self._images[name.hexdigest()] = image
        return self._digests[id(image)]

    def _of_pixels(self, pixels: NDArray | None) -> bytes:
        if pixels is None:
            return b""
        if id(pixels) not in self._pixel_digests:
            name = hashlib.blake2b(repr((pixels.shape, pixels.dtype)).encode(), digest_size=16)
            name.update(np.ascontiguousarray(pixels).view(np.uint8).data)
            self._pixel_digests[id(pixels)] = name.digest()
        return self._pixel_digests[id(pixels)]

    def textures(self, color_set: ColorSet) -> tuple[leapray.Texture, ...]:
        """Made once; raises Stopped."""
        made = []
        for name in color_set.images:
            texture = self.cache.get(("texture", name))
            if texture is None:
                image = self._images[name]
                texture = leapray.Texture(
                    image.pixels,
                    image.interpolation,
                    image.extension,
                    image.program,
                    watch=self.watch,
                )
                self.cache.put(("texture", name), texture)
            made.append(texture)
        return tuple(made)

    def attributes(
        self, mesh: model.Mesh, color_set: ColorSet, smooth: bool, facets: bool = False
    ) -> leapray.Attributes | None:
        """The attributes of a volume of the mesh, or of a part of it; None: none.

        smooth: the normals of its corners, if it has some; facets: those of its triangles,
        if it has none.
        """
        normals = mesh.corner_normals if smooth else None
        if facets and mesh.corner_normals is None:
            normals = np.empty((len(mesh.triangles), 3, 3), np.float32)
            for some in pieces(len(normals)):
                normals[some] = unit(facet_normals(mesh, some))
        sources = slot_sources(mesh, color_set)
        if sources is None and normals is None:
            return None
        used = set() if sources is None else set(np.unique(sources).tolist())
        return leapray.Attributes(
            normals=normals,
            color_sources=sources,
            colors=mesh.corner_colors if used - {WHITE} else None,
            uvs=mesh.corner_uvs if used - {VERTEX, WHITE} else None,
            textures=() if sources is None else self.textures(color_set),
        )


def _has_pixels(image: model.Image) -> bool:
    return image.pixels is not None and image.pixels.size > 0


def digest(mesh: model.Mesh, color_set: ColorSet) -> str:
    """A digest of the mesh's attributes; "" for none."""
    if not color_set.sources and mesh.corner_normals is None:
        return ""
    normals, colors, uvs = mesh.corner_names
    used = normals, colors if color_set.sources else "", uvs if color_set.images else ""
    return arrays.digest((), repr((color_set, used)).encode())


def corners_digest(mesh: model.Mesh) -> str:
    """A digest of all attributes of the mesh's corners, used by a colour set or not."""
    return "/".join(mesh.corner_names)


def slot_sources(mesh: model.Mesh, color_set: ColorSet) -> NDArray[np.int32] | None:
    """For each triangle where its colour comes from; None where all are white."""
    if not color_set.sources:
        return None
    table = np.array(color_set.sources, np.int32)
    slots = np.zeros(len(mesh.triangles), np.int64) if mesh.slots is None else mesh.slots
    sources = table[np.minimum(slots, len(table) - 1)]
    return None if (sources == WHITE).all() else sources


def widest_voxel(largest: float) -> float:
    """No voxel size from facet_voxel is above; largest: area of a triangle, about."""
    return float(np.sqrt(2 * largest) / LARGE) * ROUNDED


def facet_voxel(mesh: model.Mesh, creased: bool) -> float:
    """The voxel size below which the mesh's own normals are needed; 0: never."""
    if mesh.corner_normals is None or not len(mesh.triangles):
        return 0.0
    twice = np.empty(len(mesh.triangles))  # the facets' areas
    counts = np.ones(len(twice), bool)
    for some in pieces(len(twice)):
        facets = facet_normals(mesh, some)[:, 0]
        twice[some] = arrays.lengths(facets)
        if not creased:
            cosine = np.einsum("mka,ma->mk", mesh.corner_normals[some], unit(facets))
            counts[some] = cosine.min(axis=1) < np.cos(LEAN)
    bar = SHOWS * twice.sum()
    largest_first = np.sort(twice[counts])[::-1]
    enough = np.flatnonzero(np.cumsum(largest_first) > bar)
    return float(np.sqrt(largest_first[enough[0]]) / LARGE) if len(enough) else 0.0


def facet_normals(mesh: model.Mesh, some: slice = slice(None)) -> NDArray[np.float64]:
    """(m, 3, 3): at each corner the facet's normal, twice as long as the facet's area."""
    corners = mesh.triangles[some]
    a, b, c = (mesh.vertices[corners[:, k]].astype(np.float64) for k in range(3))
    normals = np.stack(arrays.crossed((b - a).T, (c - a).T), axis=1)
    return np.broadcast_to(normals[:, None], (len(a), 3, 3))


# ---- attributes of corners when a mesh changes ---------------------------------


def only(mesh: model.Mesh, chosen: NDArray[np.bool_] | slice) -> dict[str, Any]:
    """The corners' attributes of the chosen triangles, by their names in model.Mesh.

    Any, for the names are keywords of dataclasses.replace, which takes other types, too.
    """
    arrays = {name: getattr(mesh, name) for name in CORNERS}
    return {name: array[chosen] for name, array in arrays.items() if array is not None}


def turned(mesh: model.Mesh) -> model.Mesh:
    """The mesh with the opposite winding."""
    corners = {name: getattr(mesh, name) for name in CORNERS}
    corners = {name: array[:, ::-1] for name, array in corners.items() if array is not None}
    if "corner_normals" in corners:
        corners["corner_normals"] = -corners["corner_normals"]
    return dataclasses.replace(mesh, triangles=mesh.triangles[:, ::-1], **corners)


CORNERS = {"corner_normals": 3, "corner_colors": 3, "corner_uvs": 2}  # names, components


def joined(
    meshes: list[model.Mesh], linear: list[NDArray[np.float64]]
) -> dict[str, NDArray[np.float32]]:
    """The corners' attributes of meshes that become one, each moved by a linear map (3, 3).

    What a mesh lacks and another has is filled in: its facets' normals, white, zero.
    Corners of triangles that a mirroring map turns change places as objects.merge's do.
    """
    made = {}
    for name, n in CORNERS.items():
        if all(getattr(mesh, name) is None for mesh in meshes):
            continue
        rows = []
        for mesh, matrix in zip(meshes, linear, strict=True):
            array = getattr(mesh, name)
            if array is None:
                array = _default(mesh, name, n)
            if name == "corner_normals":
                array = array @ np.linalg.inv(matrix)
                array = unit(array)
            rows.append(array[:, ::-1] if np.linalg.det(matrix) < 0 else array)
        made[name] = np.concatenate(rows).astype(np.float32)
    return made


def _default(mesh: model.Mesh, name: str, n: int) -> NDArray[np.float64]:
    shape = (len(mesh.triangles), 3, n)
    if name != "corner_normals":
        return np.full(shape, 1.0 if name == "corner_colors" else 0.0)
    return facet_normals(mesh)


# ---- errors of a volume's colours ----------------------------------------------

WIDEST = 1e9  # texels: no footprint is wider
SHARPER = 7  # widths that textures are averaged over: a voxel, half of one, ...
ROOT = 0.5  # of linear light: equal steps look about equal


def color_errors(
    volume: leapray.Volume,
    mesh: model.Mesh,
    attributes: leapray.Attributes,
    points: NDArray[np.float64],
    triangles: NDArray[np.int64],
    weights: NDArray[np.float64],
    voxel_size: float,
    threads: int = 1,
) -> NDArray[np.float32]:
    """(n, SHARPER): errors of the volume's colours at n points of the mesh.

    points (n, 3) lie in triangles (n,) by barycentric weights (n, 3). Column k
    compares with the texture averaged over 2^-k voxels, which is what a pixel of
    that width would show. Differences are of square roots, RMS over the channels. In
    triangle cells hits have the colours of the triangle that is met: there is no error.
    """
    errors = np.zeros((len(points), SHARPER), np.float32)
    off = ~volume.exact_at(points)
    points, triangles, weights = points[off], triangles[off], weights[off]
    if not len(points):
        return errors
    ids = None
    if volume.info.has_ids and mesh.slots is not None:
        ids = mesh.slots[triangles]
    true = TrueColors(mesh, attributes, triangles, weights)
    for k in range(SHARPER if true.textured else 1):  # nothing else is averaged
        stored = volume.colors(points, ids, 1 / 2**k, threads=threads)
        stored = np.nan_to_num(stored, nan=1.0) ** ROOT
        difference = stored - true.averaged(voxel_size / 2**k) ** ROOT
        errors[off, k:] = np.sqrt(np.mean(difference**2, axis=1))[:, None]
    return errors


class TrueColors:
    """Linear RGB at n points of a mesh: triangles (n,), barycentric weights (n, 3)."""

    def __init__(
        self,
        mesh: model.Mesh,
        attributes: leapray.Attributes,
        triangles: NDArray[np.int64],
        weights: NDArray[np.float64],
    ) -> None:
        assert attributes.color_sources is not None
        sources = attributes.color_sources[triangles]
        self.plain = np.ones((len(triangles), 3))  # where no texture is
        self.textured: list[tuple] = []  # texture, its points, their (u, v), footprints of width 1
        painted = sources == VERTEX
        if painted.any():
            self.plain[painted] = _vertex_colors(attributes, triangles[painted], weights[painted])
        for number, texture in enumerate(attributes.textures):
            chosen = sources == number
            if not chosen.any():
                continue
            if texture.of_corners:
                assert texture.program is not None
                rgba = np.ones((int(chosen.sum()), 4))
                rgba[:, :3] = _vertex_colors(attributes, triangles[chosen], weights[chosen])
                self.plain[chosen] = np.nan_to_num(texture.program.run(rgba))
                continue
            assert attributes.uvs is not None
            corners = attributes.uvs[triangles[chosen]].astype(np.float64)
            uv = np.einsum("nk,nkc->nc", weights[chosen], corners)
            p = mesh.vertices[mesh.triangles[triangles[chosen]]].astype(np.float64)
            size = texture.pixels.shape[1::-1]
            self.textured.append((texture, chosen, uv, footprints(p, corners * size)))

    def averaged(self, width: float) -> NDArray[np.float64]:
        """(n, 3): textures averaged over width in object space."""
        colors = self.plain.copy()
        for texture, chosen, uv, seen in self.textured:
            colors[chosen] = texture.sample(uv, np.minimum(width * seen, WIDEST))
        return np.clip(colors, 0.0, None)


def _vertex_colors(
    attributes: leapray.Attributes, triangles: NDArray[np.int64], weights: NDArray[np.float64]
) -> NDArray[np.float64]:
    assert attributes.colors is not None
    return np.einsum("nk,nkc->nc", weights, attributes.colors[triangles])


def footprints(p: NDArray[np.float64], texels: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 3): what a width of 1 on triangles (n, 3, 3) covers of an image, for Texture.sample.

    texels: (n, 3, 2), where their corners lie. Nothing of triangles without area. A circle in the
    triangle's plane becomes an ellipse: its longer half axis, and the length of the other.
    """
    sides, moves = p[:, 1:] - p[:, :1], texels[:, 1:] - texels[:, :1]
    a, b, c = (np.einsum("na,na->n", sides[:, i], sides[:, j]) for i, j in ((0, 0), (0, 1), (1, 1)))
    area = a * c - b * b
    flat = ~(area > 0)
    area[flat] = 1.0
    first, second = moves[:, 0], moves[:, 1]
    crossed = first[:, :, None] * second[:, None, :]
    squares = c[:, None, None] * first[:, :, None] * first[:, None, :]
    squares += a[:, None, None] * second[:, :, None] * second[:, None, :]
    squares -= b[:, None, None] * (crossed + crossed.transpose(0, 2, 1))
    values, axes = np.linalg.eigh(np.nan_to_num(squares / area[:, None, None]))
    lengths = np.sqrt(np.maximum(values, 0.0))
    made = np.concatenate([lengths[:, 1:] * axes[:, :, 1], lengths[:, :1]], axis=1)
    made[flat] = 0.0
    return made
