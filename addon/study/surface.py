# SPDX-License-Identifier: GPL-3.0-or-later
"""The survey's second experiment: the cost of traversal, hit test and root.

A voxelized sphere is magnified so that all rays hit it. Times are differences of runs: binary mode
walks to the first object cell and no further (traversal); a whole run adds hit test, root and
normal. The normal's time is what is saved where t_max ends a little before the crossing, so that
the root is found but no hit is kept; of the rest, the linear root, one division, counts as hit
test, and what other roots take beyond it is the root's. Then errors of point and normal against
the sphere by angle of incidence, and against the field's own crossing.

Source: Sramek 1994, section 5, figure 4. Departures: 1. each hit test goes with the default
traverser, and the traversers are compared in a chart of their own; 2. roots between extrema and
by the closed form join; 3. errors are told; 4. the normal's time is told apart, and not stacked.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import leapray

from ..arrays import unit
from . import charts, entries, page, reference, shapes
from .folder import study_folder, write_figures
from .options import chosen, number
from .phantom import frame

STUDY = True

SIZE = 128  # samples along the cube
MAGNIFIED = 0.62  # half a side of the film by the sphere's radius: its corners stay on the sphere
BEFORE = 1e-6  # by how much of itself t_max lies before the crossing
BINS = (("below 60°", 0.0, 60.0), ("60° to 85°", 60.0, 85.0), ("above 85°", 85.0, 90.0))
RADIUS = 0.9  # of the cube's half side before its margin


def add_arguments(parser: argparse.ArgumentParser) -> None:
    number(parser, "size", f"samples along a side; {SIZE}", least=8)
    number(parser, "image", "pixels along a side; 300")
    number(parser, "rounds", "of which times are the median; 11")


def main(args: argparse.Namespace) -> int:
    """Measure; writes the folder and returns the exit code."""
    size = chosen(args, "size", 96, SIZE)
    image = chosen(args, "image", 120, 300)
    rounds = chosen(args, "rounds", 3, 11)
    with study_folder(args, "surface") as folder:
        samples, matrix = shapes.sphere(RADIUS).samples(size, "u16")
        volume = leapray.Volume(samples, object_from_index=matrix)
        costs = measure(volume, image, rounds)
        print("surface: times are taken", file=sys.stderr, flush=True)
        errors = measure_errors(volume, samples, matrix, image * image)
        told = {"size": size, "image": image, "rounds": rounds}
        told["traverser"] = leapray.traverser().spec
        told = write_figures(folder, "surface", told, costs=costs, errors=errors)
        write_page(folder, told, costs, errors)
    return 0


# ---- rays ----------------------------------------------------------------


def parallel_rays(image: int):
    """Origins and directions (image^2, 3) of an oblique camera whose film the sphere covers."""
    forward = np.array((-0.48, 0.31, -0.82))
    forward /= np.linalg.norm(forward)
    right, up = frame(forward)
    line = ((np.arange(image) + 0.5) / image * 2 - 1) * MAGNIFIED * RADIUS
    x, y = (part.reshape(-1, 1) for part in np.meshgrid(line, line))
    origins = x * right + y * up - 4.0 * forward
    return origins, np.broadcast_to(forward, origins.shape).copy()


def rays_of_all_angles(count: int):
    """Rays (count, 3) from everywhere whose angles of incidence are uniform between 0 and 90."""
    random = np.random.default_rng(1994)
    outward = unit(random.normal(size=(count, 3)))
    across = unit(np.cross(outward, random.normal(size=(count, 3))))
    angle = np.radians(random.uniform(0, 89.9, count))[:, None]
    directions = -np.cos(angle) * outward + np.sin(angle) * across
    return RADIUS * outward - 3.0 * directions, directions, np.degrees(angle[:, 0])


# ---- times ---------------------------------------------------------------


@dataclass(frozen=True)
class Cost:
    """What a traverser with a hit test and a root finder takes, in nanoseconds per ray."""

    traverser: str
    label: str
    hit_test: str
    root: str
    default: bool  # the traverser
    hits: int
    rays: int
    traversal: float
    testing: float
    rooting: float
    shading: float  # the normal, by central differences
    samples_per_ray: float
    relative: float  # of the first three, to the best iterative of the default traverser


def measure(volume: leapray.Volume, image: int, rounds: int) -> list[Cost]:
    """All hit tests with the default traverser, then the cheapest of each with every traverser."""
    origins, directions = parallel_rays(image)
    pairs = entries.hit_tests()
    chosen = [entry for entry in leapray.variants() if entry.default and entry.spec == entry.name]
    few = [next(pair for pair in pairs if pair[0] == test) for test in leapray.HIT_TESTS]
    others = [entry for entry in leapray.variants() if entry not in chosen]
    found = []
    for entry in chosen + others:
        tested = pairs if entry in chosen else few
        found += cost_of(volume, entry, tested, origins, directions, rounds)
    best = min(sum_of(row) for row in found if row.default and is_iterative(row))
    return [Cost(**{**asdict(row), "relative": sum_of(row) / best}) for row in found]


def cost_of(volume, entry, pairs, origins, directions, rounds) -> list[Cost]:
    structure = leapray.build(volume, entry)
    away = origins + np.array([0.0, 50.0, 0.0])

    def run(rays=origins, **settings):
        return leapray.trace(structure, rays, directions, normal="central", **settings)

    jobs: list[Callable[[], object]] = [
        lambda: run(away, mode="binary", count=False),
        lambda: run(mode="binary", count=False),
    ]
    full = []
    for test, root in sorted({(test, "linear") for test, _ in pairs} | set(pairs)):
        hits = run(hit_test=test, root=root)
        ends = np.where(np.isfinite(hits.t), hits.t * (1 - BEFORE), np.inf)
        full.append((test, root, hits))
        settings: dict[str, Any] = {"hit_test": test, "root": root, "count": False}
        jobs += [partial(run, t_max=ends, **settings), partial(run, **settings)]
    taken = np.median(entries.seconds(jobs, rounds), axis=0) / len(origins) * 1e9
    taken = np.maximum(taken - taken[0], 0.0)
    short = {(test, root): taken[2 + 2 * k] for k, (test, root, _) in enumerate(full)}
    whole = {(test, root): taken[3 + 2 * k] for k, (test, root, _) in enumerate(full)}
    walking = [(test, root) for test, root, _ in full if entries.walks_cells(test)]
    normal = max(float(np.median([whole[pair] - short[pair] for pair in walking])), 0.0)
    return [
        Cost(
            entry.spec,
            entries.label(entry),
            test,
            root,
            entry.default,
            hits.counters["hits"],
            len(origins),
            taken[1],
            max(whole[test, "linear"] - normal - taken[1], 0.0),
            max(whole[test, root] - whole[test, "linear"], 0.0),
            normal,
            hits.counters["samples"] / len(origins),
            0.0,
        )
        for pair in pairs
        for test, root, hits in full
        if (test, root) == pair
    ]


def sum_of(row: Cost) -> float:
    return row.traversal + row.testing + row.rooting


def is_iterative(row: Cost) -> bool:
    return row.root in ("newton", "bisect")


# ---- errors --------------------------------------------------------------


@dataclass(frozen=True)
class Error:
    """Errors of a hit test with a root finder in a range of angles of incidence."""

    hit_test: str
    root: str
    angles: str
    rays: int
    missed: int
    radial_rms: float  # voxels from the sphere
    radial_99: float
    along_rms: float  # voxels along the ray from the sphere's own hit
    along_99: float
    field_99: float  # voxels along the ray from the field's first crossing
    field_max: float
    normal_mean: dict[str, float]  # angle of each normal to the sphere's, degrees
    normal_99: dict[str, float]


def measure_errors(volume, samples, matrix, count: int) -> list[Error]:
    """A row for each hit test, root finder and range of angles, in that order."""
    origins, directions, angle = rays_of_all_angles(count)
    voxel = matrix[0, 0]
    top = np.iinfo(samples.dtype).max
    crossing = reference.first_crossing(
        samples / top, (origins - matrix[:3, 3]) / voxel, directions / voxel
    )
    structure = leapray.build(volume)
    found = []
    for test, root in entries.hit_tests():
        runs = {
            normal: leapray.trace(
                structure, origins, directions, hit_test=test, root=root, normal=normal
            )
            for normal in leapray.NORMALS
        }
        t = next(iter(runs.values())).t
        points = origins + np.where(np.isfinite(t), t, 0.0)[:, None] * directions
        distance = np.linalg.norm(points, axis=1)
        radial, along = (distance - RADIUS) / voxel, (t - 3.0) / voxel
        with np.errstate(invalid="ignore"):
            inner = np.abs(t - crossing.t) / voxel
        bent = {
            normal: np.degrees(
                np.arccos(np.clip((run.normal * points).sum(axis=1) / distance, -1, 1))
            )
            for normal, run in runs.items()
        }
        for name, low, high in BINS:
            here = (angle >= low) & (angle < high)
            hit = here & np.isfinite(t)
            own = hit & np.isfinite(crossing.t)
            found.append(
                Error(
                    test,
                    root,
                    name,
                    int(here.sum()),
                    int((here & np.isfinite(crossing.t) & ~np.isfinite(t)).sum()),
                    rms(radial[hit]),
                    p99(np.abs(radial[hit])),
                    rms(along[hit]),
                    p99(np.abs(along[hit])),
                    p99(inner[own]),
                    float(inner[own].max(initial=0.0)),
                    {normal: mean(angles[hit]) for normal, angles in bent.items()},
                    {normal: p99(angles[hit]) for normal, angles in bent.items()},
                )
            )
    return found


def rms(values) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else 0.0


def mean(values) -> float:
    return float(np.mean(values)) if len(values) else 0.0


def p99(values) -> float:
    return float(np.percentile(values, 99)) if len(values) else 0.0


# ---- telling -------------------------------------------------------------


def draw(folder: Path, costs: list[Cost], errors: list[Error]) -> None:
    """The stacked times, the traversers beside each other, and the errors by angle."""
    best = min(sum_of(row) for row in costs if row.default and is_iterative(row))
    rows = [row for row in costs if row.default]
    with charts.chart(folder / "costs", width=9.2, height=4.6) as (_, axes):
        stack(axes[0, 0], rows, [f"{row.hit_test}\n{row.root}" for row in rows], best)
        axes[0, 0].set_title(f"A ray's time, {rows[0].label.lower()}")
        axes[0, 0].set_ylabel("time, best iterative = 1")
        axes[0, 0].grid(axis="x", visible=False)
    tests = list(dict.fromkeys(row.hit_test for row in costs))
    few = [
        next(row for row in costs if row.label == name and row.hit_test == test)
        for test in tests
        for name in dict.fromkeys(row.label for row in costs)
    ]
    count = len(few) // len(tests)
    size: dict[str, Any] = {"columns": len(tests), "width": 5.2, "height": 1.3 + 0.24 * count}
    with charts.chart(folder / "traversers", **size) as (_, axes):
        for axis, test in zip(axes[0], tests, strict=True):
            part = [row for row in few if row.hit_test == test]
            stack(axis, part, [row.label for row in part], best, flat=True)
            axis.set_title(f"{test}, {part[0].root}")
            axis.set_xlabel("time, best iterative = 1")
            axis.grid(axis="y", visible=False)
            if axis is not axes[0, 0]:
                axis.set_yticklabels([])
                axis.get_legend().remove()
    kinds = (
        ("along_99", "from the sphere, along the ray: voxels, 99 %"),
        ("field_max", "from the field's own crossing: voxels, worst"),
    )
    with charts.chart(folder / "errors", columns=3, width=4.9) as (_, axes):
        names = [name for name, _, _ in BINS]
        for axis, (field, title) in zip(axes[0], kinds, strict=False):
            for k, (test, root) in enumerate(dict.fromkeys((r.hit_test, r.root) for r in errors)):
                found = [r for r in errors if (r.hit_test, r.root) == (test, root)]
                values = [max(getattr(row, field), 1e-14) for row in found]
                shift = (k - 4.5) * 0.04  # side by side, as many are alike
                axis.plot(np.arange(3) + shift, values, label=f"{test}, {root}", **dots(k))
            axis.set_yscale("log")
            axis.set_title(title, fontsize=10.5)
            axis.set_xticks(range(3), names)
        axes[0, 1].set_ylim(top=1e9)
        axes[0, 1].legend(fontsize=8, ncols=2, loc="upper left")
        base = [r for r in errors if (r.hit_test, r.root) == entries.hit_tests()[0]]
        for k, normal in enumerate(leapray.NORMALS):
            values = [row.normal_99[normal] for row in base]
            axes[0, 2].plot(range(3), values, label=normal, **charts.look(k))
        axes[0, 2].set_yscale("log")
        axes[0, 2].set_title("normals: degrees, 99 %", fontsize=10.5)
        axes[0, 2].set_xticks(range(3), names)
        axes[0, 2].legend()
        axes[0, 1].set_xlabel("angle of incidence")


def dots(k: int) -> dict:
    return {**charts.look(k), "markersize": 4.5, "lw": 0.8}


def stack(axis, rows: list[Cost], names: list[str], best: float, *, flat: bool = False) -> None:
    """Bars of traversal, hit test and root, one upon the other."""
    base = np.zeros(len(rows))
    for k, (field, title) in enumerate(
        (("traversal", "traversal"), ("testing", "hit-miss test"), ("rooting", "root"))
    ):
        part = np.array([getattr(row, field) for row in rows]) / best
        if flat:
            axis.barh(names, part, left=base, color=charts.COLORS[k], label=title)
        else:
            axis.bar(range(len(rows)), part, bottom=base, color=charts.COLORS[k], label=title)
        base += part
    if flat:
        axis.invert_yaxis()
    else:
        axis.set_xticks(range(len(rows)), names)
    axis.legend()


def write_page(folder: Path, told: dict, costs: list[Cost], errors: list[Error]) -> None:
    """surface.html: the charts with what they say."""
    draw(folder, costs, errors)
    body = [
        "<h1>To the surface and into it</h1>",
        f'<p class="soft">A sphere in {told["size"]}³ samples of 16 bits; {told["image"]} x '
        f"{told['image']} parallel rays, all of which hit; one thread, median of "
        f"{told['rounds']} rounds. {page.esc(told['machine'])}.</p>",
        page.figure(folder, "costs.png", "Times", "differences of runs, see below"),
        page.findings(sentences(costs, errors)),
        page.figure(folder, "traversers.png", "Every traverser", "the same rays and surface"),
        page.figure(folder, "errors.png", "Errors", "by the angle between ray and normal"),
        "<h2>Figures</h2>",
        page.table(
            ["traverser, hit test, root", "traversal, ns", "test", "root", "normal", "relative",
             "samples", "missed"],
            [
                [
                    page.esc(f"{row.label}, {row.hit_test}, {row.root}"),
                    *(f"{v:.0f}" for v in (row.traversal, row.testing, row.rooting, row.shading)),
                    f"{row.relative:.2f}",
                    f"{row.samples_per_ray:.1f}",
                    str(row.rays - row.hits),
                ]
                for row in costs
            ],
        ),
        page.table(
            ["hit test, root, angle", "rays", "missed", "radial rms", "99 %", "along 99 %",
             "field max", *(f"{normal}, °" for normal in leapray.NORMALS)],
            [
                [
                    page.esc(f"{row.hit_test}, {row.root}, {row.angles}"),
                    str(row.rays),
                    str(row.missed),
                    *(f"{v:.4f}" for v in (row.radial_rms, row.radial_99, row.along_99)),
                    f"{row.field_max:.1e}",
                    *(f"{angle:.3f}" for angle in row.normal_mean.values()),
                ]
                for row in errors
            ],
        ),
        "<h2>What this is, and what it is not</h2>",
        "<p>Parts of the time are differences of whole runs: a run in binary mode is the "
        "traversal; the normal is what is saved where rays end just before the surface; the root "
        "finders' part is what they take beyond the linear one, whose single division counts to "
        "the test, as do the cubic's coefficients, which they share. Normals are left out of the "
        "bars. Differences of noisy times are noisier; below zero they show as zero. The error "
        "against the sphere holds what sampling does to it; the error against the field's own "
        "crossing does not.</p>",
    ]  # fmt: skip
    (folder / "surface.html").write_text(page.whole("To the surface", body), "utf-8")


def sentences(costs: list[Cost], errors: list[Error]) -> list[str]:
    """Sentences computed from the figures."""
    rows = sorted((row for row in costs if row.default), key=lambda row: row.relative)
    best = next(row for row in rows if is_iterative(row))
    said = [
        f"The best iterative method is {best.hit_test} with {best.root}: {sum_of(best):.0f} ns per "
        f"ray, of which traversal takes {best.traversal / sum_of(best):.0%}, the hit test "
        f"{best.testing / sum_of(best):.0%} and the root {best.rooting / sum_of(best):.0%}."
    ]
    sampled = [row for row in rows if not entries.walks_cells(row.hit_test) and is_iterative(row)]
    if sampled:
        said.append(
            f"Equidistant samples with {sampled[0].root} take {sampled[0].relative:.2f} times as "
            "long (the survey: nearly 3 times)."
        )
    linear = next(row for row in rows if row.root == "linear")
    said.append(f"The fastest is {linear.hit_test} with linear, {linear.relative:.2f}.")
    for root in ("linear", "newton"):
        found = [row for row in errors if (row.hit_test, row.root) == (best.hit_test, root)]
        worst = "; ".join(f"{row.angles} {row.field_max:.1e}" for row in found)
        said.append(f"{root.capitalize()} strays from the field's crossing by at most: {worst}.")
    missed: dict[str, int] = {}
    for row in errors:
        missed[row.hit_test] = max(missed.get(row.hit_test, 0), row.missed)
    said.append(
        "Rays that cross the field and that were lost, at most in a range of angles: "
        + ", ".join(f"{test} {count}" for test, count in missed.items())
        + f" of some {errors[0].rays}."
    )
    return said
