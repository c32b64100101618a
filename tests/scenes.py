# SPDX-License-Identifier: GPL-3.0-or-later
"""Small scenes in plain arrays, with analytic answers, for the tests of plan and pipeline."""

from __future__ import annotations

import dataclasses

import numpy as np

from addon import model


def sphere(radius=1.0, n=64, name="Sphere") -> model.Mesh:
    """A closed sphere of 12 n^2 triangles: a cube's faces, subdivided and blown up.

    The grid has equal angles, so chords sink by radius (pi / 4 n)^2 / 2 at most.
    """
    a = np.tan(np.linspace(-np.pi / 4, np.pi / 4, n + 1))
    u, v = np.meshgrid(a, a, indexing="ij")
    i = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    quads = np.stack([i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, 1:]], axis=-1).reshape(-1, 4)
    points, triangles = [], []
    for axis in range(3):
        for side in (1.0, -1.0):
            face = np.empty((*u.shape, 3))
            face[..., axis], face[..., (axis + 1) % 3], face[..., (axis + 2) % 3] = side, u, v
            q = (quads if side > 0 else quads[:, ::-1]) + len(points) * (n + 1) ** 2
            points.append(face.reshape(-1, 3))
            triangles += [q[:, [0, 1, 2]], q[:, [0, 2, 3]]]
    vertices = np.concatenate(points)
    # the cube's faces share their borders exactly: round before blowing up
    vertices = np.round(vertices, 12)
    vertices *= radius / np.linalg.norm(vertices, axis=1, keepdims=True)
    return model.Mesh(name, vertices.astype(np.float32), np.concatenate(triangles).astype(np.int32))


def plane(size=2.0, name="Plane", offset=0.0) -> model.Mesh:
    """A square in z = 0 of two triangles, size x size, facing up."""
    h = size / 2
    corners = np.array([[-h, -h, 0], [h, -h, 0], [h, h, 0], [-h, h, 0]])
    corners += np.array([offset, offset, 0])
    return model.Mesh(name, corners.astype(np.float32), np.array([[0, 1, 2], [0, 2, 3]], np.int32))


def box(size=(2.0, 2.0, 2.0), turn=0.0, name="Box") -> model.Mesh:
    """A closed box around the origin, turned about (1, 1, 0) by that angle."""
    c = (np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)]) - 0.5) * size
    quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    triangles = [t for q in quads for t in ([q[0], q[1], q[2]], [q[0], q[2], q[3]])]
    a = np.array([1.0, 1.0, 0.0]) / np.sqrt(2)
    k = np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])
    rotation = np.eye(3) + np.sin(turn) * k + (1 - np.cos(turn)) * k @ k
    return model.Mesh(name, (c @ rotation.T).astype(np.float32), np.array(triangles, np.int32))


def divided(mesh: model.Mesh, times: int) -> model.Mesh:
    """The same surface of 4^times as many triangles."""
    vertices, triangles = mesh.vertices, mesh.triangles
    for _ in range(times):
        corner = vertices[triangles]  # (n, 3, 3)
        middle = (corner + np.roll(corner, -1, axis=1)) / 2
        parts = [corner[:, [k]] for k in range(3)] + [middle[:, [k]] for k in range(3)]
        four = np.concatenate(parts, axis=1)[:, [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]]]
        vertices, index = np.unique(four.reshape(-1, 3), axis=0, return_inverse=True)
        triangles = index.reshape(-1, 3).astype(np.int32)
    return dataclasses.replace(mesh, vertices=vertices.astype(np.float32), triangles=triangles)


def place(mesh=0, at=(0.0, 0.0, 0.0), scale=1.0, **more) -> model.Instance:
    """An instance of the mesh with that number; more: any member of model.Instance."""
    matrix = np.diag([scale, scale, scale, 1.0]) if np.ndim(scale) == 0 else np.diag([*scale, 1.0])
    matrix[:3, 3] = at
    given = {"name": f"Object {mesh}", "world_from_object": matrix, "materials": (0,), **more}
    return model.Instance(mesh=mesh, **given)


def camera(
    eye=(0.0, -6.0, 0.0), target=(0.0, 0.0, 0.0), width=96, height=64, fov=0.7, scale=None
) -> model.Camera:
    """A camera that looks at target with z up; fov across width, or orthographic and scale wide."""
    eye, target = np.array(eye, float), np.array(target, float)
    forward = (target - eye) / np.linalg.norm(target - eye)
    up = (0.0, 0.0, 1.0) if abs(forward[2]) < 0.99 else (0.0, 1.0, 0.0)
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    pixel = (2 * np.tan(fov / 2) if scale is None else scale) / width
    corner = -0.5 * pixel * (width * right + height * up)
    return model.Camera(
        projection="perspective" if scale is None else "orthographic",
        eye=eye,
        forward=forward,
        corner=corner + (forward if scale is None else 0.0),
        dx=pixel * right,
        dy=pixel * up,
        clip_start=0.1,
        clip_end=1000.0,
    )


# One sample of the light that comes straight, each for the pixel that it is in.
PLAIN = {"samples": 1, "noise_threshold": 0.0, "pixel_filter": "box", "diffuse_bounces": 0}


def scene(
    meshes, instances=None, view=None, width=96, height=64, lights=(), **settings
) -> model.Scene:
    """Two materials, white and red, under a sun; settings: members of
    model.Settings, PLAIN where not given."""
    if instances is None:
        instances = [place(i) for i in range(len(meshes))]
    return model.Scene(
        meshes=tuple(meshes),
        instances=tuple(instances),
        materials=(
            model.Material("White", (model.Lobe("diffuse", (0.8, 0.8, 0.8)),)),
            model.Material("Red", (model.Lobe("diffuse", (0.8, 0.1, 0.1)),)),
        ),
        lights=lights
        or (model.Light("sun", (3.0, 3.0, 3.0), name="Sun", direction=(0.0, -0.6, 0.8)),),
        camera=view or camera(width=width, height=height),
        world=model.World((0.1, 0.1, 0.1)),
        film_transparent=False,
        width=width,
        height=height,
        settings=model.Settings(**PLAIN | settings),
    )


def replace(scene: model.Scene, **settings) -> model.Scene:
    """The scene with other settings."""
    return dataclasses.replace(scene, settings=dataclasses.replace(scene.settings, **settings))


def join(*placed: tuple[model.Mesh, tuple[float, float, float]], name="Joined") -> model.Mesh:
    """One mesh of several, each shifted."""
    vertices, triangles, n = [], [], 0
    for mesh, shift in placed:
        vertices.append(mesh.vertices + np.float32(shift))
        triangles.append(mesh.triangles + n)
        n += len(mesh.vertices)
    return model.Mesh(name, np.concatenate(vertices), np.concatenate(triangles))
