# SPDX-License-Identifier: GPL-3.0-or-later
"""Exactness, by counting faults: first cells, walks, roots, skipped pixels, closed surfaces.

First cells: every exact traverser, with all its options, against the integer oracle on volumes of
all shapes, on a large one and on the surface of a fog; ties at edges and corners are no faults. No
walk may take more steps than there are planes between cells. Roots: one random cell per ray,
against the first root in f64. Skipped pixels: those around a ray that misses must miss, too. Closed
surfaces: a sphere and a torus seen from all around through every pixel that must hit; the hit must
lie between the entries into the solid grown and shrunk by a margin, so that holes, and walls hit
through another one, are found.
"""

from __future__ import annotations

import argparse
import itertools
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from ctypes import c_double, c_int64
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import leapray
from leapray.arrays import ONES
from leapray.threads import cores

from ..arrays import unit
from . import charts, entries, oracle, page, reference, shapes, skips
from .clouds import cloud
from .compiled import library, pointer
from .folder import study_folder, write_figures
from .options import chosen, number
from .phantom import frame, phantom
from .reference import Crossing

STUDY = True

SEED = 1988
SIDES = 41  # small volumes have 1..40 samples along each axis
PER_VOLUME = 2000  # generic rays, and a fifth of it along the lattice
MARGIN = 0.05  # voxels; the field of a torus of 15 voxels' radius deviates by 0.02
SAMPLES = 128  # a side, of the closed surfaces
PHANTOM, SMALLER = 128, 8  # samples of phantoms; their pictures by those of closed surfaces
ROWS = 64  # of a picture at a time
SMALL, FOG = "1..40", 0.35  # the name of the small volumes, and the fog's threshold


def add_arguments(parser: argparse.ArgumentParser) -> None:
    number(parser, "rays", "generic rays per traverser and kind of volume; 1,000,000")
    number(parser, "size", "samples along a side of the large volume; 512", least=2)
    number(parser, "cells", "random cells whose root is looked for; 1,000,000")
    number(parser, "views", "directions that closed surfaces are seen from; 50")
    number(parser, "image", "pixels along a side of such a view; 2048")


def main(args: argparse.Namespace) -> int:
    """Measure; writes the folder and returns the exit code."""
    rays = chosen(args, "rays", 60_000, 1_000_000)
    size = chosen(args, "size", 128, 512)
    cells = chosen(args, "cells", 200_000, 1_000_000)
    views = chosen(args, "views", 10, 50)
    image = chosen(args, "image", 1024, 2048)
    counts = chosen(args, "counts", (1, 4, 10), tuple(range(1, 11)))
    with study_folder(args, "exact") as folder:
        claims = first_cells(rays, size)
        roots = judge_roots(cells)
        skipped = skips.measure(counts, directions(views), min(size, PHANTOM), image // SMALLER)
        say("pixels are skipped")
        solids = [closed(solid, views, image) for solid in SOLIDS]
        told = {"rays": rays, "size": size, "views": views, "image": image}
        tables: dict[str, list] = {
            "first_cells": claims,
            "roots": roots,
            "skips": skipped,
            "closed": solids,
        }
        told = write_figures(folder, "exact", told, **tables)
        draw(folder, claims, size)
        write_page(folder, told, claims, roots, skipped, solids)
    return 0


# ---- first cells ---------------------------------------------------------


@dataclass(frozen=True)
class Claim:
    """A traverser on the small volumes, on the large one, or on the surface of the fog."""

    volumes: str
    traverser: str
    label: str
    rays: int  # generic ones
    lattice_rays: int
    pierced: int  # rays that have a first object cell
    missed: int
    late: int
    wrong: int  # not an object's, or not on the ray
    long: int  # volumes in which a ray took more than nx + ny + nz steps
    longest: float  # most steps of a ray by nx + ny + nz
    steps_per_ray: float
    seconds: float  # of tracing, all cores

    @property
    def faults(self) -> int:
        return self.missed + self.late + self.wrong


def random_volume(rng: np.random.Generator, kind: int) -> NDArray:
    """1..40 samples along each axis: spheres, noise, a checkerboard or a single object cell."""
    size = rng.integers(1, SIDES, 3)
    nz, ny, nx = size
    if kind == 0:
        n = int(rng.integers(1, 5))
        return phantom(max(int(size.max()), 2), n)[:nz, :ny, :nx]
    if kind == 1:
        return (rng.random(size) < rng.choice([0.003, 0.02, 0.2])) * np.uint8(255)
    if kind == 2:
        return (np.indices(tuple(size)).sum(axis=0) % rng.integers(2, 9) == 0) * np.uint8(255)
    samples = np.zeros(size, np.uint8)
    samples[tuple(rng.integers(0, size))] = 255
    return samples


def first_cells(count: int, size: int) -> list[Claim]:
    """A row per exact variant for the small volumes, for the large one and for the fog."""
    exact = [entry for entry in leapray.variants() if entry.exact]
    rng = np.random.default_rng(SEED)
    small = [Tally() for _ in exact]
    for turn in range(-(-count // PER_VOLUME)):
        samples = random_volume(rng, turn % 4)
        n = min(PER_VOLUME, count - turn * PER_VOLUME)
        judge_volume(exact, small, leapray.Volume(samples), rng, n)
    say("small volumes are judged")
    large = [Tally() for _ in exact]
    judge_volume(exact, large, leapray.Volume(phantom(size, 4)), rng, count)
    say(f"{size} samples a side are judged")
    fog = [Tally() for _ in exact]
    grid = leapray.ScalarGrid("fog", cloud(size), np.eye(4), kind="fog")
    judge_volume(exact, fog, leapray.isosurface(grid, FOG), rng, count)
    say("the fog is judged")
    found = zip((SMALL, f"{size}³", "fog"), (small, large, fog), strict=True)
    return [
        Claim(name, entry.spec, entries.label(entry), **vars(tally))
        for name, tallies in found
        for entry, tally in zip(exact, tallies, strict=True)
    ]


class Tally:
    """Sums over volumes; the fields of a Claim."""

    def __init__(self) -> None:
        self.rays = self.lattice_rays = self.pierced = 0
        self.missed = self.late = self.wrong = self.long = 0
        self.longest = self.steps_per_ray = self.seconds = 0.0

    def add(self, verdict: NDArray, pierced: NDArray, counters: dict, planes: int) -> None:
        number = np.bincount(verdict, minlength=len(oracle.VERDICTS))
        before, n = self.rays + self.lattice_rays, len(verdict)
        self.pierced += int(pierced.sum())
        self.missed += int(number[oracle.VERDICTS.index("missed")])
        self.late += int(number[oracle.VERDICTS.index("late")])
        self.wrong += int(number[oracle.VERDICTS.index("no object") :].sum())
        # The first cell takes no step.
        steps = max(counters["most_cells"] - 1, 0)
        self.long += steps > planes
        self.longest = max(self.longest, steps / planes)
        self.steps_per_ray = (self.steps_per_ray * before + counters["cells"]) / (before + n)


def judge_volume(exact, tallies, volume: leapray.Volume, rng, count: int) -> None:
    info = volume.info
    objects = oracle.object_cells(volume.read(), info.threshold * ONES[info.dtype])
    size = info.size
    few = max(count // 5, 1)
    for make, n in ((oracle.generic_rays, count), (oracle.lattice_rays, few)):
        rays = make(rng, n, size)
        bench = oracle.Bench(objects, *rays)
        for entry, tally in zip(exact, tallies, strict=True):
            structure = leapray.build(volume, entry)
            began = time.perf_counter()
            hits = leapray.trace(structure, *rays, mode="binary", threads=0)
            tally.seconds += time.perf_counter() - began
            verdict, pierced = bench.judge(np.isfinite(hits.t), hits.cell)
            tally.add(verdict, pierced, hits.counters, sum(size))
            if make is oracle.generic_rays:
                tally.rays += n
            else:
                tally.lattice_rays += n


# ---- roots ---------------------------------------------------------------


def judge_roots(count: int) -> list[Crossing]:
    """Every root finder, with the default hit test and traverser, on one cell per ray."""
    rng = np.random.default_rng(SEED)
    samples = rng.random((64, 64, 64)).astype(np.float32)
    cell = rng.integers(0, 63, (count, 3))
    ends = rng.integers(1, 2**16, (2, count, 3)) / 2.0**16
    rows, axes = np.arange(count), rng.integers(0, 3, (2, count))
    sides = rng.integers(0, 2, (2, count))
    sides[1] = np.where(axes[0] == axes[1], 1 - sides[0], sides[1])
    for k in (0, 1):  # from one face of the cell to another
        ends[k][rows, axes[k]] = sides[k]
    chord = ends[1] - ends[0]
    length = np.linalg.norm(chord, axis=1)
    values = [
        reference.trilinear(samples.astype(float), cell, ends[0] + x * chord) - 0.5
        for x in (0, 1 / 3, 2 / 3, 1)
    ]
    want, least = reference.first_root(reference.cubic(*values), values[0] >= 0)
    want = reference.Crossings(want, least < reference.NEAR)
    structure = leapray.build(leapray.Volume(samples))
    test, found = next(iter(leapray.HIT_TESTS)), []
    for root in leapray.ROOTS:
        t = leapray.trace(structure, cell + ends[0], chord, t_max=1.0, root=root).t
        found.append(reference.judge("random cells", test, root, want, t, length))
    say("roots are judged")
    return found


# ---- closed surfaces -----------------------------------------------------


@dataclass(frozen=True)
class Solid:
    name: str
    major: float
    minor: float

    @property
    def radius(self) -> float:
        return self.major + self.minor


SOLIDS = (Solid("sphere", 0.0, 0.9), Solid("torus", 0.62, 0.26))


@dataclass(frozen=True)
class Closed:
    """A closed surface from all directions."""

    solid: str
    views: int
    pixels: int
    rays: int  # that must hit
    holes: int  # of them went on
    displaced: int  # or hit something that is not the first surface
    seconds: float  # all cores, what must be hit worked out, too


def directions(count: int) -> NDArray[np.float64]:
    """(count, 3) unit: along an axis and two diagonals of the lattice, then evenly all around."""
    found = [(0.0, 0.0, -1.0), (0.0, -1.0, -1.0), (-1.0, -1.0, -1.0)][:count]
    turn = np.pi * (3 - np.sqrt(5))  # the golden angle
    for k in range(count - len(found)):
        z = 1 - (2 * k + 1) / (count - 3)
        flat = np.sqrt(1 - z * z)
        found.append((flat * np.cos(turn * k), flat * np.sin(turn * k), z))
    return unit(np.array(found))


def closed(solid: Solid, views: int, image: int) -> Closed:
    """Every pixel of every view, rows of pixels side by side on all cores."""
    body = shapes.Shape(
        solid.name,
        lambda p: (
            np.hypot(np.hypot(p[:, 0], p[:, 1]) - solid.major, p[:, 2]) - solid.minor
            if solid.major
            else np.linalg.norm(p, axis=1) - solid.minor
        ),
    )
    samples, matrix = body.samples(SAMPLES, "u16")
    structure = leapray.build(leapray.Volume(samples, object_from_index=matrix))
    margin = MARGIN * matrix[0, 0]
    began = time.perf_counter()

    def rows_of(job: tuple[NDArray, int]) -> NDArray[np.int64]:
        forward, first = job
        o, d = film(forward, solid.radius, image, first, min(first + ROWS, image))
        early, late = entrances(solid, o, d, margin)
        must = np.flatnonzero(np.isfinite(late))
        t = leapray.trace(structure, o[must], d[must], count=False).t
        gone = ~np.isfinite(t)
        slack = margin * 1e-3  # the march ends a little before
        off = ~gone & ((t < early[must] - slack) | (t > late[must] + slack))
        return np.array([len(must), gone.sum(), off.sum()])

    jobs = itertools.product(directions(views), range(0, image, ROWS))
    with ThreadPoolExecutor(cores()) as pool:
        must, gone, off = sum(pool.map(rows_of, jobs), np.zeros(3, np.int64))
    say(f"the {solid.name} is seen from {views} directions")
    took = time.perf_counter() - began
    return Closed(solid.name, views, views * image**2, int(must), int(gone), int(off), took)


def film(forward: NDArray, radius: float, image: int, first: int, last: int):
    """Parallel rays through the centres of some rows' pixels; the film just holds the solid."""
    right, up = frame(forward) if abs(forward[1]) < 1 else (np.eye(3)[0], np.eye(3)[2])
    line = ((np.arange(image) + 0.5) / image * 2 - 1) * radius
    x, y = (part.reshape(-1, 1) for part in np.meshgrid(line, line[first:last]))
    origins = x * right + y * up - 2.0 * forward
    return origins, np.broadcast_to(forward, origins.shape).copy()


def entrances(solid: Solid, origins: NDArray, directions: NDArray, margin: float):
    """t (n,) where rays enter the solid grown by margin, and shrunk by it; else infinity."""
    early, late = np.empty(len(origins)), np.empty(len(origins))
    library("solids").solid_entries(
        pointer(origins), pointer(directions), c_int64(len(origins)), c_double(solid.major),
        c_double(solid.minor), c_double(margin), pointer(early), pointer(late),
    )  # fmt: skip
    return early, late


# ---- telling -------------------------------------------------------------


def say(words: str) -> None:
    print(f"exact: {words}", file=sys.stderr, flush=True)


def draw(folder: Path, claims: list[Claim], size: int) -> None:
    """The longest and the mean walk of every exact traverser in the large volume."""
    rows = [row for row in claims if row.volumes not in (SMALL, "fog")]
    names, place = [row.label for row in rows], np.arange(len(rows))
    with charts.chart(folder / "walks", width=9.0, height=1.4 + 0.27 * len(rows)) as (_, axes):
        axis = axes[0, 0]
        longest = [100 * row.longest for row in rows]
        mean = [100 * row.steps_per_ray / (3 * size) for row in rows]
        axis.barh(place, longest, color=charts.COLORS[5], label="longest of all walks")
        axis.barh(place, mean, color=charts.COLORS[0], label="mean walk")
        axis.axvline(100, color=charts.INK, lw=1.0)
        axis.set_yticks(place, names)
        axis.invert_yaxis()
        axis.grid(axis="y", visible=False)
        axis.set_xlabel("per cent of nx + ny + nz steps, which none may exceed")
        axis.set_title(f"Walks to the first object cell, {size}³ samples")
        axis.legend(loc="lower right")


def write_page(folder: Path, told: dict, claims: list[Claim], roots, skipped, solids) -> None:
    """exact.html: the counts with what they say."""
    body = [
        "<h1>What must be exact</h1>",
        f'<p class="soft">{page.esc(told["machine"])}.</p>',
        page.findings(sentences(claims, roots, skipped, solids)),
        "<h2>First cells</h2>",
        page.table(
            ["traverser", "samples a side", "generic rays", "along the lattice", "that hit",
             "missed", "late", "wrong", "longest walk by nx + ny + nz", "steps per ray"],
            [
                [
                    page.esc(row.label),
                    row.volumes,
                    *(f"{n:,}" for n in (row.rays, row.lattice_rays, row.pierced)),
                    *map(str, (row.missed, row.late, row.wrong)),
                    f"{row.longest:.3f}",
                    f"{row.steps_per_ray:.1f}",
                ]
                for row in claims
            ],
        ),
        page.figure(folder, "walks.png", "Walks", "counted on every ray"),
        f"<h2>Roots on {roots[0].rays + roots[0].doubtful:,} random cells</h2>",
        page.table(
            ["root", "roots", "doubtful", "missed", "false", "off", "99 %, voxels", "worst"],
            [
                [
                    row.root,
                    *map(str, (row.crossing, row.doubtful, row.missed, row.false, row.off)),
                    f"{row.error_99:.1e}",
                    f"{row.error_max:.1e}",
                ]
                for row in roots
            ],
        ),
        "<h2>Pixels skipped around rays that miss</h2>",
        page.table(
            ["phantom", "skip", "views", "pixels", "skipped", "wrong", "seconds", "ray by ray"],
            [
                [
                    f"N = {row.n}",
                    row.skip,
                    *(f"{n:,}" for n in (row.views, row.pixels)),
                    f"{row.skipped / row.pixels:.1%}",
                    str(row.wrong),
                    *(f"{t:.1f}" for t in (row.seconds, row.seconds_traced)),
                ]
                for row in skipped
            ],
        ),
        "<h2>Closed surfaces</h2>",
        page.table(
            ["solid", "views", "pixels", "that must hit", "holes", "displaced", "seconds"],
            [
                [
                    row.solid,
                    *(f"{n:,}" for n in (row.views, row.pixels, row.rays)),
                    *map(str, (row.holes, row.displaced)),
                    f"{row.seconds:.1f}",
                ]
                for row in solids
            ],
        ),
        "<h2>What this is, and what it is not</h2>",
        "<p>Small volumes are spheres, noise, checkerboards and single samples in turn, and "
        f"{PER_VOLUME} generic rays go to each; the large one holds 64 spheres, the fog as many "
        f"samples, its surface at a density of {FOG:g}. A fifth as many "
        "rays start on corners, edges, faces and middles of cells with directions of small whole "
        "numbers, zero and -0. Trees' nodes are no steps here, cells are. A chord of a random cell "
        f"is doubtful where the field comes within {reference.NEAR:g} of the threshold at an "
        f"extremum. A pixel must hit where its ray enters the solid shrunk by {MARGIN} voxels; a "
        "hit is displaced where it does not lie between the entries into the grown and the shrunk "
        f"solid. Closed surfaces have {SAMPLES}³ samples of 16 bits and are traced with the "
        "defaults.</p>",
    ]  # fmt: skip
    (folder / "exact.html").write_text(page.whole("What must be exact", body), "utf-8")


def sentences(claims: list[Claim], roots: list[Crossing], skipped, solids) -> list[str]:
    """Sentences computed from the tables."""
    faults, long = sum(row.faults for row in claims), sum(row.long for row in claims)
    rays = sum(row.rays + row.lattice_rays for row in claims)
    names = len({row.traverser for row in claims})
    longest = max(claims, key=lambda row: row.longest)
    said = [
        f"{names} methods promise exactness: {faults} faults in {rays:,} rays. The longest walk "
        f"has {longest.longest:.1%} of nx + ny + nz steps ({longest.label}), and {long} volumes "
        "saw a longer one than allowed.",
    ]
    for row in roots:
        said.append(
            f"{row.root.capitalize()}: {row.faults} of {row.crossing:,} first "
            f"roots missed, false or off; the worst error is {row.error_max:.1e} voxels."
        )
    for skip in dict.fromkeys(row.skip for row in skipped):
        rows = [row for row in skipped if row.skip == skip]
        fraction = sum(row.skipped for row in rows) / sum(row.pixels for row in rows)
        said.append(
            f"The {skip} skip leaves out {fraction:.0%} of the pixels around {len(rows)} phantoms "
            f"from {rows[0].views} views, {sum(row.wrong for row in rows)} of them wrongly."
        )
    for row in solids:
        said.append(
            f"The {row.solid} from {row.views} directions: {row.holes} holes and {row.displaced} "
            f"displaced hits on {row.rays:,} rays that must hit, in {row.seconds:.0f} seconds."
        )
    return said
