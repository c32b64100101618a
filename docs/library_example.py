# SPDX-License-Identifier: GPL-3.0-or-later
"""From a mesh to a picture in five steps, by the core alone; docs/library.md shows it."""

import numpy as np

import leapray

# 1. A mesh: a torus of 2 n^2 triangles, counter-clockwise from outside.
n = 48
u, v = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
around, across = 2 * np.pi * u / n, 2 * np.pi * v / n
ring = 1.0 + 0.45 * np.cos(across)
points = [ring * np.cos(around), ring * np.sin(around), 0.45 * np.sin(across)]
vertices = np.stack(points, axis=-1).reshape(-1, 3)
a, b, c, d = (((u + i) % n * n + (v + j) % n).ravel() for i, j in ((0, 0), (1, 0), (1, 1), (0, 1)))
triangles = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])

# 2. A volume: samples 0.05 apart that hold how much of their surroundings is inside.
volume = leapray.voxelize(vertices, triangles, voxel_size=0.05)
print(f"{volume.info.kind} of {volume.info.n_surface_cells} surface cells, {volume.info.size}")

# 3. A structure: what the default traverser needs to leap over empty cells.
structure = leapray.build(volume)
print(f"{structure.traverser.label}, {structure.nbytes} bytes")

# 4. Rays: one through the ring from the left, one through the hole.
hits = leapray.trace(structure, [[-3, 0, 0], [0, 0, 3]], [[1, 0, 0], [0, 0, -1]])
print(f"t {hits.t[0]:.2f} and {hits.t[1]:.2f}, normal x {hits.normal[0, 0]:.2f}")
print(f"{hits.counters['cells']} cells visited, {hits.counters['jumps']} jumps")

# 5. A picture: an orthographic camera above, a sun, one white material.
width, height = 60, 26
forward, right, up = np.array([0, 0.8, -0.6]), np.array([1.0, 0, 0]), np.array([0, 0.6, 0.8])
dx, dy = right * 3.2 / width, up * 2.6 / height
camera = leapray.Camera(
    "orthographic",
    eye=-5 * forward,
    forward=forward,
    corner=-dx * width / 2 - dy * height / 2,
    dx=dx,
    dy=dy,
)
scene = leapray.Scene(
    camera,
    [leapray.Instance(structure, np.eye(4))],
    [leapray.Light("sun", (3, 3, 3), direction=(-0.6, 0, 0.8))],
    [leapray.Material.diffuse((0.8, 0.8, 0.8))],
    slots=[0],
)
grey = scene.render_tile(0, 0, width, height, samples=4)["Combined"][..., 0]
for row in grey[::-1]:  # rows come from below
    print("".join(" .:-=+*#%@"[int(9 * min(value, 1.0))] for value in row).rstrip())
