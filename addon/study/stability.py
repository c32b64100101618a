# SPDX-License-Identifier: GPL-3.0-or-later
"""Where methods fail: traversers against the integer oracle, hit tests against the field's roots.

Every case is a volume with rays that are hard in one way. A traverser's claim, the first object
cell in binary mode, is judged by exact arithmetic (oracle.c); a hit test's claim, the first
crossing in surface mode with the default traverser, by a slow reference in f64 (reference.py).
Rays whose verdict hangs on rounding, because the field all but touches the threshold, are left
out and counted. What promises exactness shows zeros.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import leapray

from . import charts, methods, oracle, page, reference
from .folder import result_folder
from .phantom import write_csv

STUDY = True

SEED = 1992
OFF = 1e-6  # voxels: a crossing farther from the first one than this is another, or a poor one
PICTURE = 160  # pixels along a side


def main(args: argparse.Namespace) -> int:
    """Measure; writes the folder and returns the exit code."""
    output = Path(args.output or "stability")
    quick = bool(getattr(args, "quick", False))
    count = getattr(args, "rays", None) or (1000 if quick else 60_000)
    alone = getattr(args, "alone", None) or (5 if quick else 100)
    drawn = getattr(args, "size", None) or (80 if quick else PICTURE)
    with result_folder(output, "stability.html") as folder:
        cells = [row for case in CASES for row in judge_cells(case, count, alone)]
        print("stability: traversers are judged", file=sys.stderr, flush=True)
        fields = [row for case in CASES for row in judge_fields(case, count)]
        roots = judge_roots(getattr(args, "cells", None) or (50_000 if quick else 1_000_000))
        told = {
            "machine": charts.machine(),
            "leapray": leapray.__version__,
            "rays": count,
            "alone": alone,
            "traversers": [asdict(row) for row in cells],
            "hit_tests": [asdict(row) for row in fields],
            "roots": [asdict(row) for row in roots],
        }
        (folder / "stability.json").write_text(json.dumps(told, indent=2) + "\n")
        write_csv(folder / "stability.csv", cells)
        write_csv(folder / "stability-hit-tests.csv", fields)
        draw(folder, cells, fields, drawn)
        write_page(folder, told, cells, fields, roots)
    print(f"{output / 'stability.html'}, and its figures in {output / 'stability.csv'}", flush=True)
    return 0


# ---- cases ---------------------------------------------------------------


@dataclass(frozen=True)
class Case:
    """A volume (nz, ny, nx) of f32 samples, rays through it, and the volume's place."""

    name: str
    samples: Callable[[np.random.Generator], NDArray]
    rays: Callable[[np.random.Generator, int, NDArray], tuple[NDArray, NDArray]]
    matrix: tuple = ()  # object_from_index, (3, 3); powers of two keep exact rays exact


def blobs(rng) -> NDArray:
    """Spheres with a soft border."""
    size = (33, 36, 40)
    grid = np.stack(np.indices(size), axis=-1)
    field = np.zeros(size)
    for _ in range(9):
        off = np.linalg.norm(grid - rng.random(3) * size, axis=-1) - rng.uniform(1, 6)
        field = np.maximum(field, np.clip(0.5 - off / 4, 0, 1))
    return field.astype(np.float32)


def walls(rng) -> NDArray:
    """A wall one sample thick, at a slant."""
    z, y, x = np.indices((32, 32, 32)) - 15.5
    normal = np.array([0.61, 0.5, -0.615])
    off = np.abs(x * normal[0] + y * normal[1] + z * normal[2])
    return (off <= 0.5 * np.abs(normal).sum()).astype(np.float32)


def wires(rng) -> NDArray:
    """Soft rods whose radius is less than a voxel."""
    z, y, x = np.indices((36, 36, 36)).astype(float)
    field = np.zeros(x.shape)
    for tilt, a, b in ((0.13, 9, 11), (-0.21, 18, 20), (0.31, 27, 24)):
        off = np.hypot(x - a - tilt * (z - 18), y - b + tilt * (z - 18))
        field = np.maximum(field, np.clip(0.5 + (0.7 - off) / 3, 0, 1))
    return field.astype(np.float32)


def isolated(rng) -> NDArray:
    samples = np.zeros((30, 34, 38), np.float32)
    places = rng.integers(0, samples.size, 60)
    samples.flat[places] = rng.uniform(0.55, 1, 60)
    return samples


def checkerboard(rng) -> NDArray:
    return (np.indices((14, 15, 16)).sum(axis=0) % 3 == 0).astype(np.float32)


def noise(rng) -> NDArray:
    return rng.random((24, 24, 24)).astype(np.float32)


def long(rng) -> NDArray:
    """2048 samples long with grains at the far end, so that what adds up has drifted by then."""
    samples = np.zeros((24, 24, 2048), np.float32)
    samples[:, :, 2020:] = rng.random((24, 24, 28)) < 0.03
    return samples


def single(rng) -> NDArray:
    return np.ones((1, 1, 1), np.float32)


def empty(rng) -> NDArray:
    return np.zeros((20, 20, 20), np.float32)


def full(rng) -> NDArray:
    return np.ones((20, 20, 20), np.float32)


def dyadic(origins, directions):
    """Rays that the oracle takes: origins in multiples of 2^-16, whole directions."""
    fine = 2.0**oracle.SHIFT
    return np.round(np.asarray(origins) * fine) / fine, np.round(directions)


def edges(rng, count, size):
    """Rays through points of the lattice, and so through edges and corners."""
    origins, _ = oracle.lattice_rays(rng, count, size)
    directions = rng.integers(0, size, (count, 3)) * 2.0 - origins * 2.0
    directions[(directions == 0).all(axis=1)] = (1, 1, 1)
    return dyadic(origins, directions)


def in_boundary(rng, count, size):
    """Rays that run in the planes that bound the lattice and its virtual layer."""
    origins, directions = oracle.generic_rays(rng, count, size)
    axis, rows = rng.integers(0, 3, count), np.arange(count)
    planes = np.stack([np.full(3, -1), np.zeros(3), size - 1, size], axis=0)
    origins[rows, axis] = planes[rng.integers(0, 4, count), axis]
    directions[rows, axis] = np.where(rng.random(count) < 0.5, 0.0, -0.0)
    directions[(directions == 0).all(axis=1)] = (0, 0, -1)
    return origins, directions


def axis_parallel(rng, count, size):
    """One or two components are 0 or -0."""
    origins, directions = oracle.generic_rays(rng, count, size)
    zero = rng.random((count, 3)) < 0.5
    directions = np.where(zero, np.where(rng.random((count, 3)) < 0.5, 0.0, -0.0), directions)
    directions[(directions == 0).all(axis=1)] = (0, -1, 0)
    origins = np.where(zero, rng.integers(-2, 4 * size + 6, (count, 3)) / 4.0, origins)
    return dyadic(origins, directions)


def grazing(rng, count, size):
    """Nearly parallel to an axis, close to lattice planes."""
    origins, directions = oracle.generic_rays(rng, count, size)
    axis, rows = rng.integers(0, 3, count), np.arange(count)
    origins = np.floor(origins) + rng.integers(-2, 3, (count, 3)) * 2.0**-oracle.SHIFT
    inside = rng.integers(0, size, (count, 3))
    origins = np.where(np.arange(3) == axis[:, None], origins, inside + origins % 1.0)
    directions = rng.integers(-3, 4, (count, 3)).astype(float)
    directions[rows, axis] = np.sign(size[axis] / 2 - origins[rows, axis] + 0.1) * 2.0**20
    return dyadic(origins, directions)


def from_inside(rng, count, size):
    origins = rng.random((count, 3)) * (size - 1)
    return dyadic(origins, rng.normal(size=(count, 3)) * 4096)


def from_afar(rng, count, size):
    """Origins a million voxels away."""
    away = rng.normal(size=(count, 3))
    away *= 1e6 / np.linalg.norm(away, axis=1, keepdims=True)
    targets = rng.random((count, 3)) * (size + 1) - 1
    origins, _ = dyadic(targets + away, away)
    return dyadic(origins, (targets - origins) * 2.0**8)


def lengthwise(rng, count, size):
    """From one end of the longest axis to the other."""
    ends = [rng.random((count, 3)) * size for _ in range(2)]
    axis = int(np.argmax(size))
    ends[0][:, axis], ends[1][:, axis] = -3.0, size[axis] + 3.0
    origins, _ = dyadic(*ends)
    return dyadic(origins, (ends[1] - origins) * 2.0**12)


STRETCH = ((1024.0, 0, 0), (0, 1.0, 0), (0, 0, 1.0))
SHEAR = ((1.0, 0.5, 0), (0, 1.0, 0.25), (0, 0, 1.0))
GENERIC = oracle.generic_rays
CASES = (
    Case("generic rays", blobs, GENERIC),
    Case("aligned with the lattice", blobs, oracle.lattice_rays),
    Case("zero and -0 components", blobs, axis_parallel),
    Case("nearly along lattice planes", blobs, grazing),
    Case("through edges and corners", isolated, edges),
    Case("in a boundary plane", blobs, in_boundary),
    Case("start inside", blobs, from_inside),
    Case("origin 10^6 voxels away", blobs, from_afar),
    Case("2048 cells long", long, lengthwise),
    Case("walls one voxel thick", walls, GENERIC),
    Case("rods thinner than a voxel", wires, GENERIC),
    Case("isolated voxels", isolated, GENERIC),
    Case("checkerboard", checkerboard, GENERIC),
    Case("noise", noise, GENERIC),
    Case("empty volume", empty, GENERIC),
    Case("full volume", full, GENERIC),
    Case("one voxel", single, oracle.lattice_rays),
    Case("voxels 1 : 1024", blobs, GENERIC, STRETCH),
    Case("sheared voxels", blobs, GENERIC, SHEAR),
)


def made(case: Case, count: int):
    """The volume, its samples, and its rays in index space and in object space."""
    rng = np.random.default_rng((SEED, CASES.index(case)))
    samples = case.samples(rng)
    origins, directions = case.rays(rng, count, np.array(samples.shape[::-1]))
    matrix = np.eye(4)
    if case.matrix:
        matrix[:3, :3] = case.matrix
    volume = leapray.Volume(samples, object_from_index=matrix)
    placed = (origins, directions)
    if case.matrix:
        placed = tuple(part @ matrix[:3, :3].T for part in placed)
    return volume, samples, (origins, directions), placed


# ---- traversers ----------------------------------------------------------


@dataclass(frozen=True)
class Claim:
    """A traverser in a case: how many of its first cells are at fault."""

    case: str
    traverser: str
    label: str
    exact: bool  # what it promises
    rays: int
    pierced: int  # rays that have a first object cell
    missed: int
    late: int
    wrong: int  # not an object's, or not on the ray
    steps_per_ray: float
    stalls: int  # of the rays that were traced alone: more steps than nx + ny + nz
    alone: int

    @property
    def share(self) -> float:
        """Faults per ray that has a first cell, or per ray where none has."""
        return (self.missed + self.late + self.wrong) / (self.pierced or self.rays)


def judge_cells(case: Case, count: int, alone: int) -> list[Claim]:
    """A row per variant of a traverser."""
    volume, samples, rays, placed = made(case, count)
    wanted = oracle.object_cells(samples, 0.5)
    longest = sum(samples.shape) + 3  # the virtual layer adds a cell along each axis
    rows = []
    for entry in leapray.variants():
        structure = leapray.build(volume, entry)
        hits = leapray.trace(structure, *placed, mode="binary")
        verdict, pierced = oracle.judge(wanted, *rays, np.isfinite(hits.t), hits.cell)
        number = np.bincount(verdict, minlength=len(oracle.VERDICTS))
        steps = [
            leapray.trace(
                structure, placed[0][k : k + 1], placed[1][k : k + 1], mode="binary"
            ).counters["cells"]
            for k in range(min(alone, count))
        ]
        rows.append(
            Claim(
                case.name,
                entry.spec,
                methods.label(entry),
                entry.exact,
                count,
                int(pierced.sum()),
                int(number[oracle.VERDICTS.index("missed")]),
                int(number[oracle.VERDICTS.index("late")]),
                int(number[oracle.VERDICTS.index("not wanted") :].sum()),
                hits.counters["cells"] / count,
                sum(step > longest for step in steps),
                len(steps),
            )
        )
    return rows


# ---- hit tests -----------------------------------------------------------


@dataclass(frozen=True)
class Crossing:
    """A hit test with a root finder in a case: how far it is from the field's first crossing."""

    case: str
    hit_test: str
    root: str
    rays: int  # without the doubtful ones
    doubtful: int
    crossing: int  # rays that have a first crossing
    missed: int
    false: int  # hits of rays that cross nothing
    off: int  # hits more than OFF voxels from the first crossing
    late: int  # of those, more than a voxel behind it
    error_99: float  # voxels
    error_max: float

    @property
    def share(self) -> float:
        return (self.missed + self.false + self.off) / (self.crossing or self.rays or 1)


def judge_fields(case: Case, count: int) -> list[Crossing]:
    """A row per pair of hit test and root finder, with the default traverser."""
    count = min(count, 4000)  # the reference is slow
    volume, samples, rays, placed = made(case, count)
    length = np.linalg.norm(rays[1], axis=1)
    want = reference.first_crossing(samples, *rays)
    sure = ~want.doubtful
    structure = leapray.build(volume)
    rows = []
    for hit_test, root in methods.hit_tests():
        t = leapray.trace(structure, *placed, hit_test=hit_test, root=root).t
        has, got = np.isfinite(want.t) & sure, np.isfinite(t) & sure
        behind = (t[has & got] - want.t[has & got]) * length[has & got]
        error = np.abs(behind)
        rows.append(
            Crossing(
                case.name,
                hit_test,
                root,
                int(sure.sum()),
                int((~sure).sum()),
                int(has.sum()),
                int((has & ~got).sum()),
                int((got & ~has).sum()),
                int((error > OFF).sum()),
                int((behind > 1.0).sum()),
                float(np.percentile(error, 99)) if len(error) else 0.0,
                float(error.max(initial=0.0)),
            )
        )
    return rows


# ---- roots ---------------------------------------------------------------


@dataclass(frozen=True)
class Root:
    """A root finder on chords of random cells, between the cubic's extrema."""

    root: str
    cells: int  # without the doubtful ones
    doubtful: int
    roots: int  # chords that have one
    missed: int
    false: int
    off: int  # more than OFF voxels from the first root
    error_99: float  # voxels
    error_max: float


def judge_roots(count: int) -> list[Root]:
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
    sure = least >= reference.NEAR
    has = np.isfinite(want) & sure
    structure = leapray.build(leapray.Volume(samples))
    found = []
    for root in leapray.ROOTS:
        t = leapray.trace(structure, cell + ends[0], chord, t_max=1.0, root=root).t
        got = np.isfinite(t) & sure
        near = np.abs(t[has & got] - want[has & got]) * length[has & got]
        found.append(
            Root(
                root,
                int(sure.sum()),
                int((~sure).sum()),
                int(has.sum()),
                int((has & ~got).sum()),
                int((got & ~has).sum()),
                int((near > OFF).sum()),
                float(np.percentile(near, 99)),
                float(near.max()),
            )
        )
    return found


# ---- telling -------------------------------------------------------------


def draw(folder: Path, cells: list[Claim], fields: list[Crossing], size: int) -> None:
    """The two tables as charts, and pictures of the worst."""
    names = list(dict.fromkeys(row.label for row in cells))
    table_chart(
        folder / "traversers",
        "First cells at fault, per cent of the rays that have one",
        names,
        {(row.label, row.case): row.share for row in cells},
    )
    pairs = list(dict.fromkeys(f"{row.hit_test}, {row.root}" for row in fields))
    table_chart(
        folder / "hit-tests",
        f"Crossings missed, false, or more than {OFF:g} voxels from the first, per cent",
        pairs,
        {(f"{row.hit_test}, {row.root}", row.case): row.share for row in fields},
    )
    with charts.chart(folder / "pictures", columns=4, width=3.3, height=3.5) as (_, axes):
        for axis, (title, image) in zip(axes[0], pictures(cells, size), strict=False):
            axis.imshow(image, origin="lower", interpolation="nearest")
            axis.set_title(title, fontsize=7.5)
            axis.set_axis_off()


def table_chart(path: Path, title: str, methods_: list[str], shares: dict) -> None:
    """A row per method, a column per case; what is 0 stays white."""
    cases = [case.name for case in CASES]
    table = np.array([[100 * shares[name, case] for case in cases] for name in methods_])
    size = {"width": 13.5, "height": 2.4 + 0.26 * len(methods_)}
    with charts.chart(path, **size) as (_, axes):
        axis = axes[0, 0]
        shown = np.where(table > 0, np.log10(np.maximum(table, 1e-3)) + 3, np.nan)
        axis.imshow(shown, cmap="OrRd", vmin=0, vmax=6, aspect="auto")
        for y, x in np.ndindex(table.shape):
            value = table[y, x]
            text = "0" if value == 0 else f"{value:.2g}" if value < 99.5 else f"{value:.0f}"
            color = "#BBBBBB" if value == 0 else charts.INK
            axis.text(x, y, text, ha="center", va="center", fontsize=8, color=color)
        axis.set_xticks(range(len(cases)), cases, rotation=40, ha="right", fontsize=9)
        axis.set_yticks(range(len(methods_)), methods_, fontsize=9)
        axis.grid(visible=False)
        axis.set_title(title)


def pictures(cells: list[Claim], size: int) -> list[tuple[str, NDArray]]:
    """Wires seen through the default traverser and the worst ones, faults in red."""
    worst: dict[str, float] = {}
    for row in cells:
        worst[row.traverser] = max(worst.get(row.traverser, 0.0), row.share)
    chosen = sorted(leapray.variants(), key=lambda one: (not one.default, -worst[one.spec]))[:4]
    volume, samples, _, _ = made(next(c for c in CASES if c.samples is wires), 1)
    wanted = oracle.object_cells(samples, 0.5)
    forward, right, up = (np.array(v, float) for v in ((5, 3, -2), (3, -5, 0), (10, 6, 34)))
    right, up = right / np.linalg.norm(right), up / np.linalg.norm(up)
    line = (np.arange(size) + 0.5) / size * 44 - 22
    x, y = (part.reshape(-1, 1) for part in np.meshgrid(line, line))
    origins = np.array(samples.shape[::-1]) / 2 - 20 * forward + x * right + y * up
    rays = dyadic(origins, np.broadcast_to(forward, origins.shape))
    found = []
    for entry in chosen:
        hits = leapray.trace(leapray.build(volume, entry), *rays, mode="binary")
        verdict, _ = oracle.judge(wanted, *rays, np.isfinite(hits.t), hits.cell)
        image = np.full((len(verdict), 3), 255, np.uint8)
        depth = np.where(np.isfinite(hits.t), hits.t, 20) - 14
        image[np.isfinite(hits.t)] = np.clip(60 + 12 * depth, 40, 215)[np.isfinite(hits.t), None]
        image[verdict > 0] = (213, 30, 0)
        title = f"{methods.label(entry)}\n{np.count_nonzero(verdict)} of {len(verdict)} at fault"
        found.append((title, image.reshape(size, size, 3)))
    return found


def write_page(
    folder: Path, told: dict, cells: list[Claim], fields: list[Crossing], roots: list[Root]
) -> None:
    """stability.html: the tables with what they say."""
    body = [
        "<h1>Where methods fail</h1>",
        f'<p class="soft">{len(CASES)} cases, {told["rays"]} rays each; first cells judged in '
        "integers, crossings by a reference in f64.</p>",
        page.figure(folder, "traversers.png", "Traversers", "missed, late or wrong first cells"),
        "<p>" + " ".join(map(page.esc, sentences(cells, fields))) + "</p>",
        page.figure(folder, "pictures.png", "Wires", "first cells; red: at fault"),
        page.figure(folder, "hit-tests.png", "Hit tests and roots", "with the default traverser"),
        "<h2>Traversers over all cases</h2>",
        page.table(
            ["traverser", "promises", "missed", "late", "wrong", "long walks"],
            [total_line(cells, label) for label in dict.fromkeys(row.label for row in cells)],
        ),
        f"<h2>Roots on {roots[0].cells} random cells</h2>",
        page.table(
            ["root", "roots", "doubtful", "missed", "false", "off", "99 %, voxels", "worst"],
            [
                [
                    row.root,
                    *map(str, (row.roots, row.doubtful, row.missed, row.false, row.off)),
                    f"{row.error_99:.1e}",
                    f"{row.error_max:.1e}",
                ]
                for row in roots
            ],
        ),
        "<h2>What this is, and what it is not</h2>",
        "<p>At ties, through edges and corners, any object cell that the ray touches will do. "
        "Stretched and sheared voxels use matrices of powers of two, so that exact rays stay "
        f"exact. Long walks are counted on {told['alone']} rays of each case, traced alone, that "
        "take more than nx + ny + nz steps; what takes several samples in a cell does so by its "
        "nature. Doubtful rays, where the field comes within "
        f"{reference.NEAR:g} of the threshold, are left out of the hit tests' table: "
        f"{max(row.doubtful for row in fields)} at most in a case. A hit test that is off by more "
        f"than {OFF:g} voxels need not be visibly wrong: see the largest errors in "
        "stability-hit-tests.csv.</p>",
    ]
    (folder / "stability.html").write_text(page.whole("Where methods fail", body), "utf-8")


def total_line(cells: list[Claim], label: str) -> list[str]:
    rows = [row for row in cells if row.label == label]
    numbers = [sum(getattr(r, key) for r in rows) for key in ("missed", "late", "wrong", "stalls")]
    promise = "exact" if rows[0].exact else "no"
    return [page.esc(label), promise, *map(str, numbers)]


def sentences(cells: list[Claim], fields: list[Crossing]) -> list[str]:
    """What the tables say, computed from them."""
    exact = [row for row in cells if row.exact]
    faults = sum(row.missed + row.late + row.wrong for row in exact)
    stalls = sum(row.stalls for row in exact)
    said = [
        f"{len({row.traverser for row in exact})} methods promise exactness: {faults} faults in "
        f"{sum(row.rays for row in exact)} rays, and {stalls} walks longer than the grid."
    ]
    loose = [row for row in cells if not row.exact]
    for label in dict.fromkeys(row.label for row in loose):
        worst = max((row for row in loose if row.label == label), key=lambda row: row.share)
        said.append(
            f"{label} fails most in “{worst.case}”: {worst.share:.2%}."
            if worst.share
            else f"{label} promises nothing, but no case here shows a fault."
        )
    for pair in dict.fromkeys((row.hit_test, row.root) for row in fields):
        rows = [row for row in fields if (row.hit_test, row.root) == pair]
        missed = sum(row.missed for row in rows) / max(sum(row.crossing for row in rows), 1)
        far = max(row.error_max for row in rows)
        said.append(
            f"{pair[0].capitalize()} with {pair[1]} misses {missed:.3%} of all crossings and is "
            f"off by {far:.2g} voxels at most."
        )
    return said
