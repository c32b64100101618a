# SPDX-License-Identifier: GPL-3.0-or-later
"""Which cells a traverser visits on one small example, as far as the core lets it be seen.

The core does not report the cells of a walk, but it counts them. A ray that ends at t_max visits
the cells that it enters before; so where the count grows as t_max grows, a cell is entered.
Those points are found by bisection to a thousandth of a voxel.
"""

from __future__ import annotations

import numpy as np

import leapray

WIDTH, HEIGHT = 38, 26  # samples; cells are -1..WIDTH-1 and -1..HEIGHT-1
ORIGIN = np.array([-3.0, 1.15, 0.4])
DIRECTION = np.array([1.0, 0.46, 0.0])
CLOSE = 1e-3  # of t
FIRST = -2  # where the core's bricks begin, as Volume.bricks tells


def samples() -> np.ndarray:
    """A disc that the ray hits, a bar that it passes, small things at the corners; one layer."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    disc = (x - 29) ** 2 + (y - 17) ** 2 <= 36
    bar = (x >= 13) & (x <= 17) & (y >= 4) & (y <= 5)
    corners = ((x <= 1) | (x >= 36)) & ((y <= 1) | (y >= 24))
    return (disc | bar | corners).astype(np.float32)[None]


def volume() -> leapray.Volume:
    return leapray.Volume(samples())


def surface() -> set[tuple[int, int]]:
    """The surface cells (i, j) of the layer that the ray is in."""
    read = volume().read_surface((-1, -1, 0), (WIDTH + 1, HEIGHT + 1, 1))[0]
    return {(int(i) - 1, int(j) - 1) for j, i in np.argwhere(read)}


def trace(structure, t_max=np.inf, origin=ORIGIN, direction=DIRECTION) -> leapray.Hits:
    return leapray.trace(structure, origin, direction, t_max=t_max, mode="binary")


def growth(structure, counter="cells", end=None, origin=ORIGIN, direction=DIRECTION) -> list[float]:
    """The t at which the counter grows, up to the hit or to end."""

    def count(t: float) -> int:
        return trace(structure, t, origin, direction).counters[counter]

    found: list[float] = []

    def halve(low: float, high: float, n_low: int, n_high: int) -> None:
        if n_low == n_high:
            return
        if high - low < CLOSE:
            found.append(high)
            return
        middle = 0.5 * (low + high)
        n = count(middle)
        halve(low, middle, n_low, n)
        halve(middle, high, n, n_high)

    if end is None:
        end = float(trace(structure, np.inf, origin, direction).t[0]) + CLOSE
    halve(0.0, end, count(0.0), count(end))
    return found


def point(t: float) -> np.ndarray:
    return (ORIGIN + t * DIRECTION)[:2]


def cell(t: float) -> tuple[int, int]:
    """The cell that the ray is in just behind t."""
    i, j = np.floor(point(t + 2 * CLOSE)).astype(int)
    return int(i), int(j)


Box = tuple[int, int, int, int]  # cells: first and last along x, first and last along y


def exit_t(box: Box) -> float:
    """Where the ray leaves a box of cells; both components of its direction are above 0."""
    far = np.array([box[1] + 1, box[3] + 1])
    return float(((far - ORIGIN[:2]) / DIRECTION[:2]).min())


def aligned(size: int, c: tuple[int, int]) -> Box:
    """The block of a grid of blocks that begins at FIRST."""
    i, j = ((a - FIRST) // size * size + FIRST for a in c)
    return i, i + size - 1, j, j + size - 1


def around(half: int, c: tuple[int, int]) -> Box:
    return c[0] - half, c[0] + half, c[1] - half, c[1] + half


def ahead(size: int, c: tuple[int, int]) -> Box:
    return c[0], c[0] + size - 1, c[1], c[1] + size - 1


def cut(box: Box) -> Box:
    return max(box[0], -1), min(box[1], WIDTH - 1), max(box[2], -1), min(box[3], HEIGHT - 1)


def probed(structure, c: tuple[int, int]) -> Box:
    """The box around a cell that rays along the axes leave in their first step."""
    sides = []
    for axis, sign in ((0, -1), (0, 1), (1, -1), (1, 1)):
        origin = np.array([c[0] + 0.5, c[1] + 0.5, ORIGIN[2]])
        direction = np.zeros(3)
        direction[axis] = sign
        end = float(max(WIDTH, HEIGHT))
        found = growth(structure, "cells", end, origin, direction)
        edge = found[0] if found else end
        sides.append(round(origin[axis] + sign * edge) - (sign > 0))
    return cut((sides[0], sides[1], sides[2], sides[3]))


def regions(kind: str, structure, entries: list[float]) -> list[Box | None]:
    """For every visited cell the smallest region of that kind that the ray leaves where it
    enters the next visited cell; None where there is none."""
    made: list[Box | None] = []
    for t, following in zip(entries, [*entries[1:], None], strict=True):
        c = cell(t)
        offers = {
            "cell": lambda c=c: [around(0, c)],
            "octree": lambda c=c: [aligned(1 << m, c) for m in range(7)],
            "blocks": lambda c=c: [aligned(1, c), aligned(4, c)],
            "bricks": lambda c=c: [aligned(1, c), aligned(8, c), aligned(128, c)],
            "cube": lambda c=c: [around(m, c) for m in range(WIDTH)],
            "ahead": lambda c=c: [ahead(m, c) for m in range(1, WIDTH)],
            "box": lambda c=c: [around(0, c), probed(structure, c)],
        }[kind]()
        fits = [] if following is None else [cut(b) for b in offers]
        fits = [b for b in fits if abs(exit_t(b) - following) < 3 * CLOSE]
        made.append(fits[0] if fits else None)
    return made


def on_line(spec: str) -> list[tuple[int, int]]:
    """The cells up to the first surface cell of a walk that is not counted step by step.

    One cell after the other is made the only surface cell beside the corners, by the mask of a
    sheet: those that are found are on the walk.
    """
    values = np.ones((1, HEIGHT, WIDTH), np.float32)
    found = []
    for i, j in sorted({c for c in nearby() if min(c) >= 0}):
        touched = np.zeros(values.shape, bool)
        touched[0, [0, 0, -1, -1], [0, -1, 0, -1]] = True
        touched[0, j, i] = True
        probe = leapray.Volume(values, sheet=True, touched=touched)
        hits = trace(leapray.build(probe, spec))
        if np.isfinite(hits.t[0]) and tuple(hits.cell[0, :2]) == (i, j):
            found.append((i, j))
    last = next((n for n, c in enumerate(found) if c in surface()), len(found))
    return found[: last + 1]


def nearby() -> list[tuple[int, int]]:
    """Cells at most one beside those that the ray pierces, as far as the first hit."""
    structure = leapray.build(volume(), "aw")
    pierced = {cell(t) for t in growth(structure)}
    return [(i + a, j + b) for i, j in pierced for a in (-1, 0, 1) for b in (-1, 0, 1)]


# ---- the end of a long walk ------------------------------------------------------

LONG = 4000  # cells along x
LONG_DIRECTION = np.array([1.0, 0.4637, 0.0])
WINDOW = (LONG - 20, LONG - 9, 1846, 1853)  # cells: first and last along x, along y


def far_cells(spec: str) -> set[tuple[int, int]]:
    """The cells of the window that a long ray through an empty volume visits, found as on_line."""
    found = set()
    for i in range(WINDOW[0], WINDOW[1] + 1):
        for j in range(WINDOW[2], WINDOW[3] + 1):
            hits = trace(leapray.build(_only((i, j)), spec), direction=LONG_DIRECTION)
            if np.isfinite(hits.t[0]) and tuple(hits.cell[0, :2]) == (i, j):
                found.add((i, j))
    return found


def _only(c: tuple[int, int]) -> leapray.Volume:
    """A large volume with three surface cells: its first, its last and the given one."""
    size = (LONG, LONG // 2, 1)
    builder = leapray.VolumeBuilder(size, "u8", sheet=True)
    for i, j in ((0, 0), (size[0] - 2, size[1] - 2), c):
        touched = np.array([[[1, 0], [0, 0]]], np.uint8)
        builder.put((i, j, 0), np.full((1, 2, 2), 255, np.uint8), touched=touched)
    return builder.finish()
