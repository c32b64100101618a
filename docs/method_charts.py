# SPDX-License-Identifier: GPL-3.0-or-later
"""Charts of filters, fields, hit tests, root finders and normals, of values that the core gives."""

from __future__ import annotations

import itertools

import numpy as np
from svg import BLUE, GREEN, GREY, INK, ORANGE, PALE, RED, Picture, number

import leapray
from leapray.arrays import INTERPOLATIONS
from leapray.voxelization import FILTERS

COLOURS = (BLUE, ORANGE, GREEN, RED, "#7d3c98")


class Chart:
    """A picture with axes: x and y ranges, ticks, labels."""

    def __init__(self, xs, ys, x_ticks, y_ticks, x_label, y_label, size=(560, 300)) -> None:
        self.xs, self.ys = xs, ys
        self.picture = Picture(*size)
        self.left, self.right, self.top, self.bottom = 52, size[0] - 12, 12, size[1] - 42
        for x in x_ticks:
            self.picture.line([self.at(x, ys[0]), self.at(x, ys[1])], PALE)
            self.picture.text(self.at(x, 0)[0], self.bottom + 16, number(x) or "0", size=11)
        for y in y_ticks:
            self.picture.line([self.at(xs[0], y), self.at(xs[1], y)], PALE)
            place = self.at(xs[0], y)
            self.picture.text(place[0] - 6, place[1] + 4, f"{y:g}", size=11, anchor="end")
        self.picture.text((self.left + self.right) / 2, size[1] - 8, x_label, size=12)
        self.picture.text(self.left, self.top - 1, y_label, size=12, anchor="start")

    def at(self, x: float, y: float) -> tuple[float, float]:
        (x0, x1), (y0, y1) = self.xs, self.ys
        return (
            self.left + (x - x0) / (x1 - x0) * (self.right - self.left),
            self.bottom - (y - y0) / (y1 - y0) * (self.bottom - self.top - 10),
        )

    def curve(self, x, y, colour, **more) -> None:
        self.picture.line([self.at(a, b) for a, b in zip(x, y, strict=True)], colour, **more)

    def dot(self, x, y, colour, radius=4) -> None:
        self.picture.circle(*self.at(x, y), radius, colour)

    def key(self, entries, x, y) -> None:
        """Names beside their colours, from a point of the chart down."""
        left, top = self.at(x, y)
        for row, (name, colour) in enumerate(entries):
            level = top + 17 * row
            self.picture.line([(left, level), (left + 18, level)], colour, width=2.5)
            self.picture.text(left + 24, level + 4, name, size=12, anchor="start")


def box_mesh(low, high):
    corner = np.array(
        [[(low, high)[b >> a & 1][a] for a in range(3)] for b in range(8)], np.float64
    )
    quads = [(0, 4, 6, 2), (1, 3, 7, 5), (0, 1, 5, 4), (2, 6, 7, 3), (0, 2, 3, 1), (4, 5, 7, 6)]
    return corner, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))], np.int32)


def filters() -> Picture:
    """Samples around the middle of a face of a box, which is shifted by fractions of a voxel."""
    chart = Chart((-4, 4), (0, 1), range(-4, 5), (0, 0.5, 1),
                  "signed distance to the surface in voxels, inside to the right", "occupancy",
                  size=(560, 320))  # fmt: skip
    curves = tuple(zip(FILTERS, itertools.cycle(COLOURS), strict=False))
    for name, colour in curves:
        found = {}
        for shift in np.arange(16) / 16 + 1 / 32:
            mesh = box_mesh((shift - 8, -8, -8), (shift, 8, 8))
            volume = leapray.voxelize(*mesh, 1.0, filter=name, dtype="f32", exact="none")
            first = volume.info.object_from_index[:3, 3]
            row = volume.read()[int(-first[2]), int(-first[1])]
            for i, value in enumerate(row):
                distance = float(shift - (first[0] + i))
                if abs(distance) <= 4:
                    found[distance] = float(value)
        x = sorted(found)
        chart.curve(x, [found[a] for a in x], colour, width=1.8)
    chart.key(curves, -3.8, 0.95)
    return chart.picture


def saddle() -> tuple[leapray.Volume, np.ndarray, np.ndarray]:
    """Two opposite edges of a cell are inside; the ray passes between them, origin, direction."""
    samples = np.zeros((3, 4, 4), np.float32)
    samples[:, 1, 2] = samples[:, 2, 1] = 1.0
    return leapray.Volume(samples, 0.4), np.array([-0.25, -0.19, 1.2]), np.array([1.0, 1.0, 0.0])


def along(volume, origin, direction, t) -> np.ndarray:
    return volume.sample(origin + np.asarray(t)[:, None] * direction)[0]


def hit_tests() -> Picture:
    """The field along a ray that enters and leaves the surface within one cell."""
    volume, origin, direction = saddle()
    t = np.linspace(0.5, 3.0, 401)
    chart = Chart((0.5, 3.0), (0, 0.6), np.arange(0.5, 3.1, 0.5), (0, 0.2, 0.4, 0.6), "t", "f",
                  size=(560, 290))  # fmt: skip
    chart.curve([0.5, 3.0], [0.4, 0.4], RED, dash="5 4")
    crossed = sorted({(k - origin[a]) for a in (0, 1) for k in (1, 2)})
    for s in crossed:
        chart.curve([s, s], [0, 0.6], GREY, dash="2 3")
    for s in crossed:
        chart.dot(s, along(volume, origin, direction, [s])[0], BLUE)
    chart.curve(t, along(volume, origin, direction, t), INK, width=1.8)
    structure = leapray.build(volume)
    middle = 0.5 * (crossed[1] + crossed[2])
    chart.dot(middle, along(volume, origin, direction, [middle])[0], GREEN)
    for s in np.arange(1, 5) / np.sqrt(2):  # one voxel apart
        chart.dot(s, along(volume, origin, direction, [s])[0], ORANGE)
    words = []
    colours = {"faces": BLUE, "extrema": GREEN, "uniform": ORANGE}
    for name, colour in colours.items():
        root = "bisect" if name == "uniform" else "newton"
        hits = leapray.trace(structure, origin, direction, hit_test=name, root=root, step=1.0)
        found = float(hits.t[0])
        told = f"hit at t = {found:.3f}" if np.isfinite(found) else "no hit"
        words.append((f"{name}: {told}", colour))
        if np.isfinite(found):
            chart.dot(found, 0.4, RED)
    chart.key(words, 2.3, 0.56)
    return chart.picture


def interpolation() -> Picture:
    """The two fields along a row of samples, and where the core hits them."""
    row = np.array([0.0, 0.0, 0.15, 0.85, 0.9, 0.35, 0.75, 0.95, 0.2, 0.0, 0.0], np.float32)
    samples = np.broadcast_to(row, (7, 7, len(row)))
    origin, direction = np.array([0.0, 3.0, 3.0]), np.array([1.0, 0.0, 0.0])
    t = np.linspace(0, len(row) - 1, 501)
    chart = Chart(
        (0, len(row) - 1), (0, 1), range(len(row)), (0, 0.5, 1), "t", "f", size=(560, 290)
    )
    chart.curve([0, len(row) - 1], [0.5, 0.5], RED, dash="5 4")
    words = []
    for name, colour in zip(INTERPOLATIONS, (BLUE, GREEN), strict=True):
        volume = leapray.Volume(samples, interpolation=name)
        chart.curve(t, along(volume, origin, direction, t), colour, width=1.8)
        found = float(leapray.trace(leapray.build(volume), origin, direction).t[0])
        chart.dot(found, 0.5, colour)
        words.append((f"{name}: hit at t = {found:.3f}", colour))
    for i, value in enumerate(row):
        chart.dot(i, float(value), INK, 2.5)
    chart.key(words, 0.2, 0.95)
    return chart.picture


def roots() -> Picture:
    """The field in one cell along a ray, the secant, and the roots that the core finds."""
    values = np.zeros((4, 4, 4), np.float32)
    values[1:3, 1:3, 1:3] = [[[0.2, 1.0], [0.5, 0.4]], [[0.9, 0.1], [0.2, 0.7]]]
    volume = leapray.Volume(values)
    origin, direction = np.array([0.0, 0.8, 0.7]), np.array([1.0, 0.4, 0.44])
    t = np.linspace(1.0, 2.0, 201)
    f = along(volume, origin, direction, t)
    chart = Chart((1, 2), (0, 1), np.arange(1, 2.1, 0.2), (0, 0.5, 1), "t", "f", size=(560, 290))
    chart.curve([1, 2], [0.5, 0.5], RED, dash="5 4")
    chart.curve([1, 2], [f[0], f[-1]], GREY, dash="2 3")
    chart.curve(t, f, INK, width=1.8)
    structure, words = leapray.build(volume), []
    for name, colour in zip(leapray.ROOTS, COLOURS, strict=False):
        found = float(leapray.trace(structure, origin, direction, root=name).t[0])
        words.append((f"{name}: t = {found:.6f}", colour))
        if np.isfinite(found):
            chart.dot(found, 0.5, colour, 5 if name == "newton" else 3.5)
    chart.key(words, 1.03, 0.95)
    return chart.picture


def normals() -> Picture:
    """How far the normals of a sphere of radius 8 are off, along a quarter of a circle."""
    z, y, x = np.mgrid[-13:14, -13:14, -13:14]
    samples = np.clip(0.5 + (8 - np.sqrt(x * x + y * y + z * z)) / 5, 0, 1)
    volume = leapray.Volume(samples.astype(np.float32))
    structure = leapray.build(volume)
    angles = np.radians(np.linspace(0, 90, 361))
    outward = np.stack([np.cos(angles), np.sin(angles), 0.23 + 0 * angles], axis=1)
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    chart = Chart((0, 90), (0, 6), range(0, 91, 15), (0, 2, 4, 6),
                  "place on the sphere, in degrees", "error in degrees")  # fmt: skip
    for name, colour in zip(leapray.NORMALS, COLOURS, strict=False):
        hits = leapray.trace(structure, 13 + 12 * outward, -outward, normal=name)
        cosine = np.clip((hits.normal * outward).sum(axis=1), -1, 1)
        chart.curve(np.degrees(angles), np.degrees(np.arccos(cosine)), colour, width=1.6)
    chart.key(zip(leapray.NORMALS, COLOURS, strict=False), 66, 5.7)
    return chart.picture


def pictures() -> dict[str, Picture]:
    made = filters, interpolation, hit_tests, roots, normals
    return {draw.__name__: draw() for draw in made}
