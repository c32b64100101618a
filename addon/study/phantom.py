# SPDX-License-Identifier: GPL-3.0-or-later
"""The survey's first experiment: how fast each traverser finds the first object cell.

A cube of samples is cut into N^3 subregions, and each gets a sphere at a random place; all spheres
of a phantom together have the same volume for every N, so that only the surface grows. 250 x 250
rays of three cameras are traced until the first object cell, with nothing done there.

Source: Sramek 1994, section 4. Departures: 1. the radius r1, which the survey does not give, is 40
samples of 128; 2. an oblique and a perspective camera join the parallel one; 3. steps and wrong
cells are counted beside the time, in runs of their own; 4. time is what the process itself used, so
that other work on the machine disturbs it less; 5. an object cell is a cube between eight samples
of which one or more lie in a sphere; 6. the cube's eight corner samples belong to objects
too, so that the bounds of what there is, where the core lets rays begin, are the whole cube for
every N, as in the survey, and not the single sphere's box.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import leapray

from . import charts, oracle, page
from .entries import label
from .folder import study_folder, write_figures
from .options import chosen, number

STUDY = True

RADIUS = 40 / 128  # r1 by the cube's side
SIZE, IMAGE = 128, 250  # samples of a phantom and pixels of a picture, along a side
SEED = 1994
# The methods of the survey's figure 2 by their first authors, and choices that it does not show.
SINGLE, TREE, SPHERES, CUBES = SURVEY = ("Cleary", "Spackman", "Zuiderveld", "Sramek")
NOT_SHOWN = {"cityblock", "euclid"}
PARALLEL = ("axis", "oblique")  # cameras


def add_arguments(parser: argparse.ArgumentParser) -> None:
    number(parser, "size", f"samples along a side; {SIZE}", least=16)
    number(parser, "image", f"pixels along a side; {IMAGE}")
    number(parser, "rounds", "of which times are the median; 11")


def main(args: argparse.Namespace) -> int:
    """Measure; writes the folder and returns the exit code."""
    size, image = chosen(args, "size", SIZE, SIZE), chosen(args, "image", IMAGE, IMAGE)
    rounds = chosen(args, "rounds", 3, 11)
    counts = chosen(args, "counts", (1, 3, 5, 7, 10), tuple(range(1, 11)))
    with study_folder(args, "phantom") as folder:
        rows, phantoms, overhead = measure(size, image, counts, rounds)
        told = {
            "size": size,
            "image": image,
            "rounds": rounds,
            "seed": SEED,
            "call_overhead_seconds": overhead,
            "phantoms": phantoms,
        }
        told = write_figures(folder, "phantom", told, rows=rows)
        write_page(folder, told, rows)
    return 0


# ---- phantoms and rays ---------------------------------------------------


def spheres(size: int, n: int) -> tuple[NDArray[np.float64], float]:
    """Centres (n^3, 3) of the spheres in index space, and their radius; seeded by n."""
    random = np.random.default_rng((SEED, n))
    side, radius = size / n, RADIUS * size / n
    centres = random.uniform(radius, side - radius, (n, n, n, 3))
    corner = side * np.moveaxis(np.indices((n, n, n)), 0, -1)
    # Sample s is the middle of voxel s, at s + 1/2 of the cube.
    return (centres + corner - 0.5).reshape(-1, 3), radius


def phantom(size: int, n: int) -> NDArray[np.uint8]:
    """(size, size, size) samples: 255 in n^3 spheres and the corners, else 0; seeded by n."""
    samples = np.zeros((size, size, size), np.uint8)
    centres, radius = spheres(size, n)
    for centre in centres:
        low = np.maximum(np.floor(centre - radius).astype(int), 0)
        high = np.minimum(np.ceil(centre + radius).astype(int) + 1, size)
        x, y, z = (np.arange(low[a], high[a]) - centre[a] for a in range(3))
        inside = z[:, None, None] ** 2 + y[:, None] ** 2 + x**2 <= radius**2
        samples[low[2] : high[2], low[1] : high[1], low[0] : high[0]][inside] = 255
    samples[:: size - 1, :: size - 1, :: size - 1] = 255
    return samples


def surface_to_volume(samples: NDArray[np.uint8]) -> float:
    """Faces between voxels in and out of an object, by voxels in."""
    solid = np.pad(samples > 0, 1)
    faces = sum(int(np.count_nonzero(np.diff(solid, axis=axis))) for axis in range(3))
    return faces / int(solid.sum())


def cameras(size: int, image: int) -> dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Origins and directions (n, 3) of each camera, in index space, as the oracle takes them."""
    middle = np.full(3, (size - 1) / 2)
    found = {}
    for name, towards in (("axis", (0.0, 0.0, -1.0)), ("oblique", (-0.48, 0.31, -0.82))):
        forward = np.array(towards) / np.linalg.norm(towards)
        right, up = frame(forward)
        half = (np.abs(right).sum() + np.abs(up).sum()) / 4 * (size + 1)
        film = pixels(image) * half
        origins = middle - 1.5 * size * forward + film[:, :1] * right + film[:, 1:] * up
        found[name] = origins, np.broadcast_to(forward, origins.shape).copy()
    forward = np.array([0.52, 0.62, -0.59])
    forward /= np.linalg.norm(forward)
    right, up = frame(forward)
    film = pixels(image) * 0.42
    eye = middle - 2.1 * size * forward
    directions = forward + film[:, :1] * right + film[:, 1:] * up
    found["perspective"] = np.broadcast_to(eye, directions.shape).copy(), directions
    return {name: whole(*rays) for name, rays in found.items()}


def whole(origins: NDArray, directions: NDArray) -> tuple[NDArray, NDArray]:
    """The nearest rays with origins in multiples of 2^-16 and whole directions."""
    fine = 2.0**oracle.SHIFT
    return np.round(origins * fine) / fine, np.round(directions * 2.0**24)


def frame(forward: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Two unit vectors across a unit one."""
    right = np.cross(forward, (0.0, 1.0, 0.0))
    right /= np.linalg.norm(right)
    return right, np.cross(right, forward)


def pixels(image: int) -> NDArray[np.float64]:
    """(image^2, 2) the pixels' centres in -1..1, row by row."""
    line = (np.arange(image) + 0.5) / image * 2 - 1
    x, y = np.meshgrid(line, line)
    return np.stack([x.ravel(), y.ravel()], axis=1)


# ---- measuring -----------------------------------------------------------


@dataclass(frozen=True)
class Row:
    """One traverser on one phantom through one camera."""

    n: int
    surface_to_volume: float
    camera: str
    traverser: str
    label: str
    seconds: float  # median of the rounds, for all rays, without the call's overhead
    seconds_low: float  # quartiles
    seconds_high: float
    mrays_per_second: float
    steps_per_ray: float
    hits: int
    wrong: int  # rays whose first cell is at fault by the integer oracle; ties are none
    setup_seconds: float
    structure_bytes: int


def of_survey(entry: leapray.Traverser) -> bool:
    """Whether the survey's figure 2 shows it."""
    return entry.source.startswith(SURVEY) and not NOT_SHOWN & set(entry.chosen)


def compared() -> list[leapray.Traverser]:
    """All traversers, then the variants that the survey compared."""
    plain = leapray.traversers()
    more = [entry for entry in leapray.variants() if of_survey(entry) and entry not in plain]
    return plain + more


def measure(size: int, image: int, counts, rounds: int) -> tuple[list[Row], list[dict], float]:
    """All rows, the phantoms' figures, and the seconds that a call takes for rays that miss all."""
    methods = compared()
    views = cameras(size, image)
    rows, phantoms, overhead = [], [], []
    for n in counts:
        samples = phantom(size, n)
        volume = leapray.Volume(samples)
        cells = oracle.object_cells(samples, 127.5)
        svr = surface_to_volume(samples)
        voxels = int((samples > 0).sum())
        phantoms.append({"n": n, "spheres": n**3, "voxels": voxels, "surface_to_volume": svr})
        built, setup = [], []
        for method in methods:
            took = []
            for _ in range(3):
                began = time.process_time()
                structure = leapray.build(volume, method)
                took.append(time.process_time() - began)
            built.append(structure)
            setup.append(float(np.median(took)))
        for camera, (origins, directions) in views.items():
            away = origins + np.array([0.0, 50.0 * size, 0.0])
            seconds = np.empty((rounds, len(methods)))
            for turn in range(rounds):  # interleaved, so that a slow moment hits all alike
                began = time.process_time()
                leapray.trace(built[0], away, directions, mode="binary", count=False)
                missed = time.process_time() - began
                overhead.append(missed)
                for m, structure in enumerate(built):
                    began = time.process_time()
                    leapray.trace(structure, origins, directions, mode="binary", count=False)
                    seconds[turn, m] = time.process_time() - began
            empty = float(np.median(overhead))
            bench = oracle.Bench(cells, origins, directions)
            for m, (method, structure) in enumerate(zip(methods, built, strict=True)):
                hits = leapray.trace(structure, origins, directions, mode="binary")
                found = np.isfinite(hits.t)
                verdict, _ = bench.judge(found, hits.cell)
                low, middle, high = np.percentile(seconds[:, m], (25, 50, 75)) - empty
                rows.append(
                    Row(
                        n,
                        svr,
                        camera,
                        method.spec,
                        label(method),
                        middle,
                        low,
                        high,
                        len(origins) / max(middle, 1e-9) / 1e6,
                        (hits.counters["cells"] + hits.counters["nodes"]) / len(origins),
                        hits.counters["hits"],
                        int((verdict != 0).sum()),
                        setup[m],
                        structure.nbytes,
                    )
                )
        print(f"phantom: N = {n}, surface to volume {svr:.2f}", file=sys.stderr, flush=True)
    return rows, phantoms, float(np.median(overhead))


# ---- telling -------------------------------------------------------------


def series(rows: list[Row], camera: str) -> dict[str, list[Row]]:
    """The rows of a camera by the traverser's label, in the order of N."""
    seen = [row for row in rows if row.camera == camera]
    return charts.grouped(seen, lambda row: row.label)


def draw(folder: Path, rows: list[Row], size: int, image: int) -> None:
    """The charts: seconds, steps and set-up time by surface-to-volume ratio."""
    draw_survey(folder, rows, image)
    plain = {entry.spec for entry in leapray.traversers()}
    rows = [row for row in rows if row.traverser in plain]
    views = list(dict.fromkeys(row.camera for row in rows))
    for name, what, value in (
        ("seconds", f"milliseconds for {image} x {image} rays", lambda row: 1e3 * row.seconds),
        ("steps", "cells and nodes looked at, per ray", lambda row: row.steps_per_ray),
    ):
        with charts.chart(folder / name, columns=len(views), width=4.6, height=5.0) as (
            figure,
            axes,
        ):
            for axis, camera in zip(axes[0], views, strict=True):
                for k, (shown, found) in enumerate(series(rows, camera).items()):
                    x = [row.surface_to_volume for row in found]
                    axis.plot(x, [value(row) for row in found], label=shown, **charts.look(k))
                    if name == "seconds":
                        low = [1e3 * row.seconds_low for row in found]
                        high = [1e3 * row.seconds_high for row in found]
                        color = charts.look(k)["color"]
                        axis.fill_between(x, low, high, color=color, alpha=0.15, lw=0)
                axis.set_title(f"{camera} camera")
                axis.set_ylim(bottom=0)
                axis.set_xlabel("surface-to-volume ratio, faces per voxel")
            axes[0, 0].set_ylabel(what)
            handles = axes[0, 0].get_legend_handles_labels()
            figure.legend(*handles, loc="outside lower center", ncols=6)
    with charts.chart(folder / "setup", width=13.8, height=3.6) as (figure, axes):
        axis = axes[0, 0]
        for k, (name, found) in enumerate(series(rows, views[0]).items()):
            x = [row.surface_to_volume for row in found]
            axis.plot(x, [1e3 * row.setup_seconds for row in found], label=name, **charts.look(k))
        axis.set_ylim(bottom=0)
        axis.set_xlabel("surface-to-volume ratio, faces per voxel")
        axis.set_ylabel("milliseconds")
        axis.set_title(f"Building the structure, {size} samples a side")
        figure.legend(*axis.get_legend_handles_labels(), loc="outside right center")


def draw_survey(folder: Path, rows: list[Row], image: int) -> None:
    """Figure 2 of the survey: its methods alone, through parallel rays, in steps and in time."""
    shown = {entry.spec for entry in compared() if of_survey(entry)}
    views = [camera for camera in dict.fromkeys(row.camera for row in rows) if camera in PARALLEL]
    size: dict[str, Any] = {"rows": 2, "columns": len(views), "width": 6.0, "height": 3.6}
    with charts.chart(folder / "survey", **size) as (figure, axes):
        for (y, x), axis in np.ndenumerate(axes):
            found = series([row for row in rows if row.traverser in shown], views[x])
            for k, (name, line) in enumerate(found.items()):
                values = [1e3 * row.seconds if y else row.steps_per_ray for row in line]
                ratios = [row.surface_to_volume for row in line]
                axis.plot(ratios, values, label=name, **charts.look(k))
            axis.set_ylim(bottom=0)
            axis.set_title("" if y else f"{views[x]} camera")
            axis.set_xlabel("surface-to-volume ratio, faces per voxel" if y else "")
        axes[0, 0].set_ylabel("cells and nodes, per ray")
        axes[1, 0].set_ylabel(f"milliseconds, {image} x {image} rays")
        figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)


def write_page(folder: Path, told: dict, rows: list[Row]) -> None:
    """phantom.html: the charts with what they say."""
    draw(folder, rows, told["size"], told["image"])
    body = [
        "<h1>The first object cell</h1>",
        f'<p class="soft">{told["size"]}³ samples, N³ spheres of equal total volume for N = '
        f"{rows[0].n} to {rows[-1].n}, {told['image']} x {told['image']} rays, one thread, "
        f"median of {told['rounds']} interleaved rounds. {page.esc(told['machine'])}.</p>",
        page.figure(folder, "survey.png", "The survey's figure 2", "parallel rays"),
        page.findings(findings(rows)),
        page.figure(folder, "seconds.png", "Time", "shaded: the middle half of the rounds"),
        page.findings(sentences(rows)),
        page.figure(folder, "steps.png", "Steps", "counted in a run of its own"),
        page.figure(folder, "setup.png", "Set-up", "from the finished volume to the structure"),
        "<h2>Figures</h2>",
    ]
    for camera in dict.fromkeys(row.camera for row in rows):
        body += [f"<h3>{camera} camera</h3>", *camera_tables(series(rows, camera))]
    wrong = sum(row.wrong for row in rows)
    body += [
        "<h2>What this is, and what it is not</h2>",
        f"<p>Every first cell was judged by exact integer arithmetic: {wrong} of "
        f"{len(rows) * told['image'] ** 2} are wrong. At ties, where a ray runs through an edge "
        "or a corner, any cell that it touches first will do. A call for rays that miss everything "
        f"takes {1e3 * told['call_overhead_seconds']:.1f} ms, handing over of arrays included, and "
        "is taken off each time. Times are what the process used on one machine, which may have "
        "done other work; believe ratios within one chart. A sample in each corner of the cube "
        "keeps the bounds alike, as rays begin at the bounds of what there is. The survey's own "
        f"radius is not known; here it is {RADIUS:.4f} of the side for N = 1.</p>",
    ]
    (folder / "phantom.html").write_text(page.whole("The first object cell", body), "utf-8")


def sentences(rows: list[Row]) -> list[str]:
    """Sentences computed from the times."""
    said = []
    for camera in dict.fromkeys(row.camera for row in rows):
        found = [row for row in rows if row.camera == camera]
        ends = []
        for n in (found[0].n, found[-1].n):
            there = sorted((row for row in found if row.n == n), key=lambda row: row.seconds)
            best, other = there[0], there[-1]
            ratio = other.seconds / max(best.seconds, 1e-9)
            ends.append(
                f"at N = {n} {best.label} is fastest ({best.mrays_per_second:.1f} million rays a "
                f"second), {ratio:.1f} times as fast as {other.label}"
            )
        said.append(f"{camera.capitalize()} camera: {'; '.join(ends)}.")
    return said


def findings(rows: list[Row]) -> list[str]:
    """The survey's findings, and the figures of this run."""

    def pick(author: str, *chosen: str) -> str:
        found = [e for e in leapray.variants() if e.source.startswith(author)]
        return next(e.spec for e in found if set(chosen) <= set(e.chosen))

    single, tree, cubes = pick(SINGLE), pick(TREE), pick(CUBES)
    chessboard = pick(SPHERES, "chessboard", "paper")
    chamfer = pick(SPHERES, "chamfer345", "paper")
    said = []
    ends = rows[0].n, rows[-1].n
    for camera in PARALLEL:
        at = {(row.traverser, row.n): row for row in rows if row.camera == camera}
        for key, unit, scale in (("steps_per_ray", "steps per ray", 1), ("seconds", "ms", 1e3)):

            def value(spec: str, n: int, key=key, scale=scale, at=at) -> float:
                return scale * getattr(at[spec, n], key)

            def trend(spec: str, value=value) -> str:
                first, last = value(spec, ends[0]), value(spec, ends[1])
                return f"{'fall' if last < first else 'rise'} from {first:.2f} to {last:.2f}"

            last = {spec: value(spec, ends[1]) for spec in (single, tree, cubes, chessboard)}
            close = value(cubes, ends[1]) / value(chamfer, ends[1])
            worst = max((tree, cubes, chessboard), key=last.__getitem__)
            said.append(
                f"{camera.capitalize()} camera, {unit}, N = {ends[0]} to {ends[1]}: single steps "
                f"{trend(single)}; the octree's {trend(tree)}; cubes' {trend(cubes)}; spheres' by "
                f"chessboard distance {trend(chessboard)}, by chamfer {trend(chamfer)}. The "
                "survey: single steps fall and all others rise; the octree is worst of those that "
                f"leap ({'so' if worst == tree else 'not so'} here at N = {ends[1]}); cubes beat "
                f"spheres by chessboard ({'so' if last[cubes] < last[chessboard] else 'not so'}) "
                f"and come close to spheres by chamfer (here at {close:.2f} of them)."
            )
        if at[single, ends[1]].seconds < at[cubes, ends[1]].seconds:
            said.append(
                f"In time, single steps win at N = {ends[1]}: today a step costs less than a leap."
            )
        wrong = [at[spec, n].wrong for spec in (chessboard, chamfer) for n in ends]
        said.append(f"As published, spheres find up to {max(wrong)} wrong first cells.")
    return said


def camera_tables(found: dict[str, list[Row]]) -> list[str]:
    """Time, steps, wrong cells of a camera: a line per traverser, a column per phantom."""
    first = next(iter(found.values()))
    head = [f"N = {row.n}" for row in first]
    made = []
    for title, shown in (
        ("milliseconds", lambda row: f"{1e3 * row.seconds:.2f}"),
        ("million rays a second", lambda row: f"{row.mrays_per_second:.1f}"),
        ("cells and nodes looked at, per ray", lambda row: f"{row.steps_per_ray:.1f}"),
        ("wrong first cells", lambda row: str(row.wrong)),
    ):
        lines = [[page.esc(label), *map(shown, rows)] for label, rows in found.items()]
        made.append(page.table([title, *head], lines))
    return made
