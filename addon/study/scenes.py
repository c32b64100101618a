# SPDX-License-Identifier: GPL-3.0-or-later
"""Scenes for studies in plain arrays, and how their picture differs from their meshes'.

A .blend is read through Blender; everything after that works on arrays. The truth of a picture is
Embree's, through the pixels' centres, on the triangles themselves.
"""

from __future__ import annotations

import subprocess
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from leapray import LeapRayError

from .. import model
from ..arrays import unit
from . import embree, metrics

SAMPLES = Path(__file__).resolve().parents[2] / "blend_samples"
PASSES = ("Combined", "Depth", "Normal", "Object Index")
LEAST_PIXELS = 64  # objects that fewer pixels show are left out of the worst


def sample(name: str) -> Path:
    """A scene that comes with LeapRay. Raises LeapRayError where it is not installed."""
    path = SAMPLES / f"{name}.blend"
    if not path.is_file():
        raise LeapRayError(f"There is no {path}: samples come with the sources only")
    return path


def write_head(path: Path, size: int) -> None:
    """The phantom of a head, of size^3 samples. Raises LeapRayError where it cannot be made."""
    command = [sys.executable, str(SAMPLES / "head_phantom.py"), str(path), "--size", str(size)]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise LeapRayError(f"the phantom of a head was not made: {done.stderr[-300:]}")


def read(path: Path, percentage: int = 100) -> model.Scene:
    """A .blend as it is rendered, its own resolution by percentage."""
    import bpy

    from ..blender import open_file
    from ..blender.read import scene as reader

    scene = open_file.open_scene(path)
    for thing in scene.objects:
        thing.hide_viewport = thing.hide_render
        for modifier in thing.modifiers:
            modifier.show_viewport = modifier.show_render
            if hasattr(modifier, "render_levels"):
                modifier.levels = modifier.render_levels
    render = scene.render
    fraction = render.resolution_percentage * percentage / 10_000
    width, height = (int(n * fraction) for n in (render.resolution_x, render.resolution_y))
    read = reader.read(bpy.context.evaluated_depsgraph_get(), width, height)
    return numbered(read)


def numbered(scene: model.Scene) -> model.Scene:
    """As difference() asks: an object index of its own for each instance, one sample, no light."""
    instances = (replace(each, object_index=k) for k, each in enumerate(scene.instances, 1))
    settings = replace(scene.settings, samples=1, noise_threshold=0.0, diffuse_bounces=0)
    return replace(scene, instances=tuple(instances), lights=(), settings=settings, passes=PASSES)


def looked_at(
    mesh: model.Mesh, eye: tuple, target: tuple, width: int, height: int, angle: float = 0.6
) -> model.Scene:
    """One mesh before a perspective camera; angle: of the film's width, in radians."""
    start, end = np.array(eye, float), np.array(target, float)
    forward = (end - start) / np.linalg.norm(end - start)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    pixel = 2 * np.tan(angle / 2) / width
    corner = forward - pixel * (width / 2 * right + height / 2 * up)
    film = corner, pixel * right, pixel * up
    camera = model.Camera("perspective", start, forward, *film, 1e-3, 1e6)
    return numbered(
        model.Scene(
            meshes=(mesh,),
            instances=(
                model.Instance(name=mesh.name, mesh=0, world_from_object=np.eye(4), materials=(0,)),
            ),
            materials=(model.Material("plain", (model.Lobe("diffuse"),)),),
            lights=(),
            camera=camera,
            world=model.World(),
            film_transparent=False,
            width=width,
            height=height,
            settings=model.Settings(),
        )
    )


def scan(n: int = 300) -> model.Mesh:
    """A closed, dense mesh of 12 n^2 triangles such as a scanner leaves: a lumpy body with folds,
    pores and the noise of the measurement, on a sphere cut like a cube. Radius about 1."""
    line = np.linspace(-1, 1, n + 1)
    u, v = np.meshgrid(line, line, indexing="ij")
    one = np.ones_like(u)
    sides = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            point = np.empty((*u.shape, 3))
            point[..., axis] = sign * one
            point[..., (axis + 1) % 3], point[..., (axis + 2) % 3] = sign * u, v
            sides.append(point.reshape(-1, 3))
    points = np.concatenate(sides)
    i, j = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    a = (i * (n + 1) + j).ravel()
    quads = np.stack([a, a + n + 1, a + n + 2, a, a + n + 2, a + 1], axis=1).reshape(-1, 3)
    triangles = np.concatenate([quads + k * (n + 1) ** 2 for k in range(6)])
    _, first, inverse = np.unique(
        np.rint(points * n).astype(np.int64), axis=0, return_index=True, return_inverse=True
    )
    points, triangles = points[first], inverse.reshape(-1)[triangles]
    directions = unit(points)
    rng = np.random.default_rng(1994)
    radius = np.ones(len(directions))
    for octave, height in ((2.0, 0.16), (5.0, 0.06), (12.0, 0.02), (40.0, 0.004)):
        for _ in range(4):
            towards = rng.normal(size=3)
            towards *= octave / np.linalg.norm(towards)
            radius += height / 2 * np.sin(directions @ towards + rng.uniform(0, 2 * np.pi))
    radius += rng.normal(scale=2e-4, size=len(directions))
    return model.Mesh(
        "Scan", (directions * radius[:, None]).astype(np.float32), triangles.astype(np.int32)
    )


# ---- truth ---------------------------------------------------------------


@dataclass(frozen=True)
class Truth:
    """What the pixels' centres see of the meshes; rows from below."""

    index: NDArray[np.int32]  # (height, width) object index, 0: nothing
    depth: NDArray[np.float64]  # along the camera's axis
    normal: NDArray[np.float64]  # (height, width, 3) of the triangle, world space
    shading: NDArray[np.float64]  # (height, width, 3) of the mesh's corners, or of the triangle
    position: NDArray[np.float64]  # (height, width, 3)
    view: metrics.View
    triangles: int


def truth(scene: model.Scene) -> Truth:
    """Embree's view of all instances that the camera sees. Raises ModuleNotFoundError without."""
    vertices, triangles, owner, smooth, base = [], [], [], [], 0
    for each in scene.instances:
        if not each.visible_camera:
            continue
        mesh, matrix = scene.meshes[each.mesh], np.asarray(each.world_from_object)
        vertices.append(mesh.vertices.astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3])
        triangles.append(mesh.triangles + base)
        owner.append(np.full(len(mesh.triangles), each.object_index, np.int32))
        corners = np.zeros((len(mesh.triangles), 3, 3))
        if mesh.corner_normals is not None:
            corners = unit(mesh.corner_normals @ np.linalg.inv(matrix[:3, :3]))
        smooth.append(corners)
        base += len(mesh.vertices)
    vertices, triangles = np.concatenate(vertices), np.concatenate(triangles)
    camera = scene.camera
    perspective = camera.projection == "perspective"
    x, y = np.meshgrid(np.arange(scene.width) + 0.5, np.arange(scene.height) + 0.5)
    film = camera.corner + x[..., None] * camera.dx + y[..., None] * camera.dy
    film = film.reshape(-1, 3)
    along = film if perspective else np.broadcast_to(camera.forward, film.shape)
    length = np.linalg.norm(along, axis=1)
    start = camera.eye if perspective else camera.eye + film
    near = camera.clip_start * along
    origins = np.broadcast_to(start, film.shape) + near
    t, normal, triangle = embree.first_hits(vertices, triangles, origins, along / length[:, None])
    depth = t / length + camera.clip_start
    hit = np.isfinite(t) & (depth <= camera.clip_end)
    shape = scene.height, scene.width
    depth = np.where(hit, depth, np.inf)
    position = np.broadcast_to(start, film.shape) + np.where(hit, depth, 0.0)[:, None] * along
    index = np.where(hit, np.concatenate(owner)[np.maximum(triangle, 0)], 0)
    view = metrics.View(
        perspective=perspective,
        eye=np.asarray(camera.eye),
        forward=np.asarray(camera.forward),
        pixel=float(np.linalg.norm(camera.dx)),
        film_from_world=np.eye(4),
    )
    return Truth(
        index.reshape(shape),
        depth.reshape(shape),
        normal.reshape(*shape, 3),
        shading_normals(
            vertices[triangles[np.maximum(triangle, 0)]],
            np.concatenate(smooth)[np.maximum(triangle, 0)],
            position,
            normal,
        ).reshape(*shape, 3),
        position.reshape(*shape, 3),
        view,
        len(triangles),
    )


def shading_normals(
    corners: NDArray, normals: NDArray, points: NDArray, facing: NDArray
) -> NDArray[np.float64]:
    """(n, 3): the corners' normals (n, 3, 3) at points (n, 3) of triangles (n, 3, 3), turned to
    the side that the triangles' own (n, 3) show; these where the corners have none."""
    sides, offset = corners[:, 1:] - corners[:, :1], points - corners[:, 0]
    metric = np.einsum("nka,nla->nkl", sides, sides)
    flat = ~(np.linalg.det(metric) > 0)
    metric[flat] = np.eye(2)
    places = np.linalg.solve(metric, np.einsum("nka,na->nk", sides, offset)[..., None])[..., 0]
    weights = np.clip(np.column_stack([1 - places.sum(axis=1), places]), 0, 1)
    made = unit(np.einsum("nk,nka->na", weights, normals))
    winding = np.einsum("na,na->n", np.cross(sides[:, 0], sides[:, 1]), facing)
    made *= np.where(winding < 0, -1.0, 1.0)[:, None]
    return np.where(made.any(axis=1)[:, None], made, facing)


# ---- comparing -----------------------------------------------------------


@dataclass(frozen=True)
class Difference:
    """A picture against the truth. Errors are perpendicular, in footprints of the pixel."""

    error: NDArray[np.float64]  # (height, width), NaN where the two see different objects
    differ: NDArray[np.bool_]  # (height, width)
    error_50: float
    error_99: float
    error_max: float
    worst: str  # the object of LEAST_PIXELS or more that errs most at 99 %
    worst_99: float
    normal_99: float  # degrees between shading normals
    turned: float  # fraction of pixels, but for edges, whose normals are metrics.TURNED degrees off
    agreeing: int  # pixels
    edges: int  # pixels with another object beside them
    mismatch: int  # pixels that see another object
    far: int  # of them more than a pixel from any edge

    @property
    def mismatch_share(self) -> float:
        return self.mismatch / max(self.edges, 1)


def difference(scene: model.Scene, want: Truth, passes: dict[str, NDArray]) -> Difference:
    """passes: of a render of the scene, rows from below."""
    index = np.rint(passes["Object Index"][..., 0]).astype(np.int32)
    agree = (index == want.index) & (index > 0)
    depth = np.where(agree, want.depth, 1.0)
    got = np.where(agree, passes["Depth"][..., 0], 1.0)
    error = metrics.depth_error(want.view, depth, want.position, want.normal, got)
    error = np.where(agree, error, np.nan)
    names = {each.object_index: each.name for each in scene.instances}
    by_object = {
        int(k): float(np.percentile(error[agree & (want.index == k)], 99))
        for k in np.unique(want.index[agree])
        if np.count_nonzero(want.index == k) >= LEAST_PIXELS
    }
    worst = max(by_object, key=by_object.__getitem__, default=0)
    told = metrics.index_mismatch(want.index, index)
    values = error[agree]
    at = np.percentile(values, (50, 99, 100)) if values.size else (0.0, 0.0, 0.0)
    error_50, error_99, error_max = map(float, at)
    angle = metrics.angle(want.shading, passes["Normal"])
    normal_99 = float(np.percentile(angle[agree], 99)) if values.size else 0.0
    return Difference(
        error,
        index != want.index,
        error_50,
        error_99,
        error_max,
        names.get(worst, ""),
        by_object.get(worst, 0.0),
        normal_99,
        metrics.turned_fraction(angle, agree & ~metrics.mixed(want.index)),
        int(agree.sum()),
        told["n_edge_pixels"],
        told["all"]["n"],
        told["all"]["n_beyond_edges"],
    )


def timed(job):
    """What the job returns, and its seconds."""
    began = time.perf_counter()
    made = job()
    return made, time.perf_counter() - began
