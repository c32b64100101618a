# SPDX-License-Identifier: GPL-3.0-or-later
"""Where methods fail: traversers against the integer oracle, hit tests against the field's roots.

Every case is a volume with difficult rays of one kind. A traverser's claim, the first object
cell in binary mode, is judged by exact arithmetic (oracle.c); a hit test's claim, the first
crossing in surface mode with the default traverser, by a slow reference in f64 (reference.py).
Rays whose verdict depends on rounding, because the field nearly touches the threshold, are left
out and counted. Exact methods show zeros.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import leapray

from . import charts, entries, oracle, page, reference, tunnels
from .cases import CASES, SEED, Case, dyadic, made, wires
from .folder import study_folder, write_figures
from .options import chosen, number

STUDY = True

PICTURE = 160  # pixels along a side


def add_arguments(parser: argparse.ArgumentParser) -> None:
    number(parser, "rays", "rays in each case; 60,000")
    number(parser, "side", "samples along a side of the volume with tunnels; 2048", least=256)
    number(parser, "size", f"pixels along a side of the pictures; {PICTURE}")


def main(args: argparse.Namespace) -> int:
    """Measure; writes the folder and returns the exit code."""
    count = chosen(args, "rays", 1000, 60_000)
    side = chosen(args, "side", 512, 2048)
    drawn = chosen(args, "size", 80, PICTURE)
    with study_folder(args, "stability") as folder:
        cells = [row for case in CASES for row in judge_cells(case, count)]
        cells += judge_tunnels(side)
        print("stability: traversers are judged", file=sys.stderr, flush=True)
        fields = [row for case in CASES for row in judge_fields(case, count)]
        told = {"rays": count}
        write_figures(folder, "stability", told, traversers=cells, hit_tests=fields)
        draw(folder, cells, fields, drawn)
        write_page(folder, told, cells, fields)
    return 0


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
    longest: int  # most steps of a ray
    planes: int  # nx + ny + nz, which no walk need exceed

    @property
    def fraction(self) -> float:
        """Faults per ray that has a first cell, or per ray where none has."""
        return (self.missed + self.late + self.wrong) / (self.pierced or self.rays)


def judge_cells(case: Case, count: int) -> list[Claim]:
    """A row per variant of a traverser."""
    volume, samples, rays, placed = made(case, count)
    bench = oracle.Bench(oracle.object_cells(samples, 0.5), *rays)
    rows = []
    for entry in leapray.variants():
        hits = leapray.trace(leapray.build(volume, entry), *placed, mode="binary")
        verdict, pierced = bench.judge(np.isfinite(hits.t), hits.cell)
        number = np.bincount(verdict, minlength=len(oracle.VERDICTS))
        faults = (
            int(number[oracle.VERDICTS.index("missed")]),
            int(number[oracle.VERDICTS.index("late")]),
            int(number[oracle.VERDICTS.index("no object") :].sum()),
        )
        rows.append(claim(case.name, entry, hits, int(pierced.sum()), faults, samples.shape))
    return rows


def judge_tunnels(side: int) -> list[Claim]:
    """A row per variant: which rays reach the ends of tunnels as wide as themselves."""
    dug = tunnels.dig(side, SEED)
    rays, rows = (dug.origins, dug.directions), []
    for entry in leapray.variants():
        hits = leapray.trace(leapray.build(dug.volume, entry), *rays, mode="binary")
        hit = np.isfinite(hits.t)
        wrong = hit & (hits.cell != dug.ends).any(axis=1)
        faults = int((~hit).sum()), 0, int(wrong.sum())
        rows.append(claim(f"{side}³, tunnels", entry, hits, len(hit), faults, (side,) * 3))
    return rows


def claim(case: str, entry, hits, pierced: int, faults: tuple[int, int, int], shape) -> Claim:
    return Claim(
        case,
        entry.spec,
        entries.label(entry),
        entry.exact,
        len(hits.t),
        pierced,
        *faults,
        hits.counters["cells"] / len(hits.t),
        max(hits.counters["most_cells"] - 1, 0),  # the first cell takes no step
        sum(shape),
    )


# ---- hit tests -----------------------------------------------------------


def judge_fields(case: Case, count: int) -> list[reference.Crossing]:
    """A row per pair of hit test and root finder, with the default traverser."""
    count = min(count, 4000)  # the reference is slow
    volume, samples, rays, placed = made(case, count)
    length = np.linalg.norm(rays[1], axis=1)
    want = reference.first_crossing(samples, *rays)
    structure = leapray.build(volume)
    return [
        reference.judge(
            case.name,
            hit_test,
            root,
            want,
            leapray.trace(structure, *placed, hit_test=hit_test, root=root).t,
            length,
        )
        for hit_test, root in entries.hit_tests()
    ]


# ---- telling -------------------------------------------------------------


def draw(folder: Path, cells: list[Claim], fields: list[reference.Crossing], size: int) -> None:
    """The two tables as charts, and pictures of the worst."""
    names = list(dict.fromkeys(row.label for row in cells))
    table_chart(
        folder / "traversers",
        "First cells at fault, per cent of the rays that have one",
        names,
        {(row.label, row.case): row.fraction for row in cells},
    )
    pairs = list(dict.fromkeys(f"{row.hit_test}, {row.root}" for row in fields))
    table_chart(
        folder / "hit-tests",
        f"Crossings missed, false, or more than {reference.OFF:g} voxels from the first, per cent",
        pairs,
        {(f"{row.hit_test}, {row.root}", row.case): row.fraction for row in fields},
    )
    with charts.chart(folder / "pictures", columns=4, width=3.3, height=3.5) as (_, axes):
        for axis, (title, image) in zip(axes[0], pictures(cells, size), strict=False):
            axis.imshow(image, origin="lower", interpolation="nearest")
            axis.set_title(title, fontsize=7.5)
            axis.set_axis_off()


def table_chart(path: Path, title: str, methods_: list[str], fractions: dict) -> None:
    """A row per method, a column per case; what is 0 stays white."""
    cases = list(dict.fromkeys(case for _, case in fractions))
    table = np.array([[100 * fractions[name, case] for case in cases] for name in methods_])
    size: dict[str, Any] = {"width": 13.5, "height": 2.4 + 0.26 * len(methods_)}
    with charts.chart(path, **size) as (_, axes):
        axis = axes[0, 0]
        shown = np.where(table > 0, np.log10(np.maximum(table, 1e-3)) + 3, np.nan)
        drawn = axis.imshow(shown, cmap="OrRd", vmin=0, vmax=6, aspect="auto")
        for y, x in np.ndindex(table.shape):
            value = table[y, x]
            text = "0" if value == 0 else f"{value:.2g}" if value < 99.5 else f"{value:.0f}"
            color = "#BBBBBB" if value == 0 else charts.ink_on(drawn.to_rgba(shown[y, x]))
            axis.text(x, y, text, ha="center", va="center", fontsize=8, color=color)
        axis.set_xticks(range(len(cases)), cases, rotation=40, ha="right", fontsize=9)
        axis.set_yticks(range(len(methods_)), methods_, fontsize=9)
        axis.grid(visible=False)
        axis.set_title(title)


def pictures(cells: list[Claim], size: int) -> list[tuple[str, NDArray]]:
    """Wires seen through the default traverser and the worst ones, faults in red."""
    worst: dict[str, float] = {}
    for row in cells:
        worst[row.traverser] = max(worst.get(row.traverser, 0.0), row.fraction)
    chosen = sorted(leapray.variants(), key=lambda one: (not one.default, -worst[one.spec]))[:4]
    volume, samples, _, _ = made(next(c for c in CASES if c.samples is wires), 1)
    objects = oracle.object_cells(samples, 0.5)
    forward, right, up = (np.array(v, float) for v in ((5, 3, -2), (3, -5, 0), (10, 6, 34)))
    right, up = right / np.linalg.norm(right), up / np.linalg.norm(up)
    line = (np.arange(size) + 0.5) / size * 44 - 22
    x, y = (part.reshape(-1, 1) for part in np.meshgrid(line, line))
    origins = np.array(samples.shape[::-1]) / 2 - 20 * forward + x * right + y * up
    rays = dyadic(origins, np.broadcast_to(forward, origins.shape))
    found = []
    for entry in chosen:
        hits = leapray.trace(leapray.build(volume, entry), *rays, mode="binary")
        verdict, _ = oracle.judge(objects, *rays, np.isfinite(hits.t), hits.cell)
        image = np.full((len(verdict), 3), 255, np.uint8)
        depth = np.where(np.isfinite(hits.t), hits.t, 20) - 14
        image[np.isfinite(hits.t)] = np.clip(60 + 12 * depth, 40, 215)[np.isfinite(hits.t), None]
        image[verdict > 0] = (213, 30, 0)
        title = f"{entries.label(entry)}\n{np.count_nonzero(verdict)} of {len(verdict)} at fault"
        found.append((title, image.reshape(size, size, 3)))
    return found


def write_page(
    folder: Path, told: dict, cells: list[Claim], fields: list[reference.Crossing]
) -> None:
    """stability.html: the tables with what they say."""
    n_cases = len({row.case for row in cells})
    body = [
        "<h1>Where methods fail</h1>",
        f'<p class="soft">{n_cases} cases, {told["rays"]} rays each; first '
        "cells judged in integers, crossings by a reference in f64.</p>",
        page.figure(folder, "traversers.png", "Traversers", "missed, late or wrong first cells"),
        page.findings(sentences(cells, fields)),
        page.figure(folder, "pictures.png", "Wires", "first cells; red: at fault"),
        page.figure(folder, "hit-tests.png", "Hit tests and roots", "with the default traverser"),
        "<h2>Traversers over all cases</h2>",
        page.table(
            ["traverser", "promises", "missed", "late", "wrong", "longest walk by nx + ny + nz"],
            [total_line(cells, label) for label in dict.fromkeys(row.label for row in cells)],
        ),
        "<h2>What this is, and what it is not</h2>",
        "<p>At ties, through edges and corners, any object cell that the ray touches will do. "
        f"A tunnel consists of the cells that its ray pierces by exact arithmetic, up to "
        f"{max(row.longest for row in cells if row.exact)} of them, and its walls are objects: "
        "one wrong cell along the ray is a fault. "
        "Stretched and sheared voxels use matrices of powers of two, so that exact rays stay "
        "exact. What takes several samples in a cell walks longer by its nature. Doubtful "
        f"rays, where the field comes within {reference.NEAR:g} of the threshold, are left out "
        f"of the hit tests' table: {max(row.doubtful for row in fields)} at most in a case. "
        f"A hit test that is off by more than {reference.OFF:g} voxels need not be visibly wrong: "
        "see the largest errors in stability-hit-tests.csv.</p>",
    ]
    (folder / "stability.html").write_text(page.whole("Where methods fail", body), "utf-8")


def total_line(cells: list[Claim], label: str) -> list[str]:
    rows = [row for row in cells if row.label == label]
    numbers = [sum(getattr(r, key) for r in rows) for key in ("missed", "late", "wrong")]
    promise = "exact" if rows[0].exact else "no"
    longest = max(row.longest / row.planes for row in rows)
    return [page.esc(label), promise, *map(str, numbers), f"{longest:.2f}"]


def sentences(cells: list[Claim], fields: list[reference.Crossing]) -> list[str]:
    """Sentences computed from the tables."""
    exact = [row for row in cells if row.exact]
    faults = sum(row.missed + row.late + row.wrong for row in exact)
    stalls = sum(row.longest > row.planes for row in exact)
    said = [
        f"{len({row.traverser for row in exact})} methods promise exactness: {faults} faults in "
        f"{sum(row.rays for row in exact)} rays, and {stalls} cases with a walk of more than "
        "nx + ny + nz steps."
    ]
    loose = [row for row in cells if not row.exact]
    for label in dict.fromkeys(row.label for row in loose):
        worst = max((row for row in loose if row.label == label), key=lambda row: row.fraction)
        said.append(
            f"{label} fails most in “{worst.case}”: {worst.fraction:.2%}."
            if worst.fraction
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
