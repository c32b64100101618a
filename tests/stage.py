# SPDX-License-Identifier: GPL-3.0-or-later
"""What the tests of rendering set up: balls, slabs, cameras, and the formulas of spheres."""

from __future__ import annotations

import numpy as np

import leapray

EXACT = [t.name for t in leapray.traversers() if t.exact]
FAR = 1e10  # the depth of nothing
VOXELS = 25.6  # radius of the usual sphere; its radial error is at most 0.011 voxel
IDENTITY = np.eye(4)
WHITE = [leapray.Material.diffuse((1, 1, 1))]


def ball(radius=VOXELS, ids=None, placed=IDENTITY):
    """A solid sphere of radius 1 round the origin, `radius` voxels large, its volume placed."""
    n = int(2 * radius) + 12
    middle = (n - 1) / 2 + 0.13  # off the lattice
    z, y, x = np.mgrid[:n, :n, :n] - middle
    g = np.clip(0.5 + (radius - np.sqrt(x * x + y * y + z * z)) / 5, 0, 1).astype(np.float32)
    matrix = np.diag([1 / radius] * 3 + [1])
    matrix[:3, 3] = -middle / radius
    return leapray.Volume(
        g, object_from_index=placed @ matrix, ids=None if ids is None else ids(x, y, z)
    )


def slab(z=0.0, half=4.0, voxel=0.125):
    """A solid that fills |x|, |y| < half from z - 8 voxels up to z."""
    n = int(2 * half / voxel) + 1
    rows = np.clip(0.5 + (8.25 - np.arange(14)) / 5, 0, 1).astype(np.float32)
    g = np.broadcast_to(rows[:, None, None], (14, n, n))
    matrix = np.diag([voxel] * 3 + [1])
    matrix[:3, 3] = (-half, -half, z - 8.25 * voxel)
    return leapray.Volume(g, object_from_index=matrix)


def camera(eye, at=(0, 0, 0), size=(96, 64), width=0.8, kind="perspective", **clip):
    """width: of the film at depth 1, or of the orthographic view."""
    eye, at = np.array(eye, float), np.array(at, float)
    forward = (at - eye) / np.linalg.norm(at - eye)
    up = (0, 0, 1) if abs(forward[2]) < 0.9 else (0, 1, 0)
    right = np.cross(forward, up)
    right *= width / size[0] / np.linalg.norm(right)
    up = np.cross(right, forward)
    corner = -size[0] / 2 * right - size[1] / 2 * up
    corner += forward if kind == "perspective" else 0
    return leapray.Camera(kind, eye, forward, corner, right, up, **clip)


def centre_rays(cam, size):
    y, x = np.mgrid[: size[1], : size[0]] + 0.5
    film = cam.corner + x[..., None] * cam.dx + y[..., None] * cam.dy
    if cam.projection == "perspective":
        return np.broadcast_to(cam.eye, film.shape), film
    return cam.eye + film, np.broadcast_to(cam.forward, film.shape)


def at(x=0.0, y=0.0, z=0.0, scale=1.0):
    matrix = np.diag([scale] * 3 + [1.0])
    matrix[:3, 3] = x, y, z
    return matrix


def one(structure, matrix=None, **more):
    return leapray.Instance(structure, IDENTITY if matrix is None else matrix, **more)


def unit(*v):
    return np.array(v) / np.linalg.norm(v)


def render(cam, instances, lights=(), *, size=(96, 64), samples=1, materials=WHITE, slots=(0,),
           world=(0, 0, 0), transparent=False, slot_objects=None, **more):  # fmt: skip
    scene = leapray.Scene(
        cam, instances, lights, materials, slots, leapray.World(world), transparent, slot_objects
    )
    return scene.render_tile(0, 0, *size, samples=samples, **more)


def meet_sphere(o, d, radius=1.0, far=False):
    """t at which o + t d meets the sphere round the origin, NaN where it does not."""
    a, b = (d * d).sum(-1), (o * d).sum(-1)
    with np.errstate(invalid="ignore"):
        root = np.sqrt(b * b - a * ((o * o).sum(-1) - radius**2))
    return (-b + (root if far else -root)) / a


def clearance(o, d, centre=(0, 0, 0)):
    """Distance of the line o + t d from a point."""
    cross = np.cross(np.asarray(centre) - o, d)
    return np.linalg.norm(cross, axis=-1) / np.linalg.norm(d, axis=-1)
