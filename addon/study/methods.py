# SPDX-License-Identifier: GPL-3.0-or-later
"""Whole images at once beside rays one by one: time, misses, and after how many frames it pays.

Phantoms of N^3 spheres as in the study of first cells, seen along parallel rays and in perspective.
Three experiments: every method with every choice of its options beside traversers; lights whose
bits are stored in voxels beside shadow rays; and frames of an orbit (leaps.py). One thread, all in
turns.

Source: Meagher 1982, Yagel, Cohen and Kaufman 1992, Yagel and Kaufman 1992, Yagel and Shi 1993.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

import leapray

from . import charts, page
from .cameras import parallel
from .entries import default, first_of, label, seconds
from .folder import study_folder, write_figures
from .leaps import TURNS, Leap, by_phantom, looking, of_leaps, orbits
from .options import chosen, number, numbers
from .phantom import phantom

STUDY = True

SIZE, IMAGE = 128, 250
SINGLE, LINES = "Amanatides", "Kaufman, Shimony"  # traversers by their first authors
TOWARDS = (-0.48, 0.31, -0.82)  # where the cameras look
SUN = (0.36, 0.48, 0.8)
NEVER = "never"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    number(parser, "size", f"samples along a side; {SIZE}", least=16)
    number(parser, "image", f"pixels along a side; {IMAGE}", least=8)
    numbers(parser, "counts", "phantoms of N^3 spheres; 1 3 5 7 10")
    number(parser, "frames", "of each orbit; 48", least=2)
    number(parser, "rounds", "medians are of so many; 7")


def main(args: argparse.Namespace) -> int:
    """Measure; writes the folder and returns the exit code."""
    size, image = chosen(args, "size", 64, SIZE), chosen(args, "image", 100, IMAGE)
    counts = chosen(args, "counts", [1, 5], [1, 3, 5, 7, 10])
    frames, rounds = chosen(args, "frames", 6, 48), chosen(args, "rounds", 3, 7)
    with study_folder(args, "methods") as folder:
        rows: list[Row] = []
        lights: list[Stored] = []
        leaps: list[Leap] = []
        for n in counts:
            volume = leapray.Volume(phantom(size, n))
            for name, camera in cameras(size, image).items():
                rows += images(volume, n, name, camera, image, rounds)
            lights += [
                light_bits(volume, n, cameras(size, side)["parallel"], side, rounds)
                for side in (image, 2 * image)
            ]
            for turn in TURNS:
                leaps += orbits(volume, n, size, image, turn, frames)
            print(f"methods: N = {n}", file=sys.stderr, flush=True)
        told = {"size": size, "image": image, "frames": frames, "rounds": rounds}
        told = write_figures(folder, "methods", told, rows=rows, lights=lights, leaps=leaps)
        draw(folder, rows, leaps)
        write_page(folder, told, rows, lights, leaps)
    return 0


def cameras(size: int, image: int) -> dict[str, leapray.Camera]:
    """Parallel and perspective, in index space."""
    forward = np.array(TOWARDS) / np.linalg.norm(TOWARDS)
    return {
        "parallel": parallel(forward, size, image),
        "perspective": looking(forward, size, image),
    }


# ---- images beside rays ----------------------------------------------------------


@dataclass(frozen=True)
class Row:
    """A method, or a traverser, on one phantom through one camera."""

    n: int
    camera: str
    method: str
    label: str
    rays: bool  # one by one, by a traverser
    exact: bool
    seconds: float  # a frame; median
    least: float
    most: float
    prepare: float  # seconds, median: what is made once
    nbytes: int  # of that
    hits: int  # pixels of the exact image that see something
    lost: int  # of those: see nothing
    invented: int
    displaced: int  # see another cell
    farthest: int  # cells
    pays_after: float | None  # frames, beside the default traverser; None: never


def images(
    volume: leapray.Volume, n: int, name: str, camera: leapray.Camera, image: int, rounds: int
) -> list[Row]:
    """Every method that takes the camera, after the traversers."""
    traversers = [default(), first_of(SINGLE), first_of(LINES)]
    methods = [
        each for each in leapray.image_variants() if each.perspective or name != "perspective"
    ]
    rays = leapray.camera_rays(camera, image, image)
    built, making = zip(
        *(timed(partial(leapray.build, volume, t)) for t in traversers), strict=True
    )
    made, preparing = zip(
        *(timed(partial(leapray.prepare, volume, m)) for m in methods), strict=True
    )
    jobs: list[Callable[[], object]] = [
        partial(leapray.trace, s, *rays, mode="binary", count=False) for s in built
    ]
    jobs += [
        partial(leapray.render_image, m, p, camera, image, image, keep=False)
        for m, p in zip(methods, made, strict=True)
    ]
    taken = seconds(jobs, rounds)
    truth = leapray.render_image(best(methods), volume, camera, image, image)
    rows = []
    entries: list[leapray.Traverser | leapray.ImageMethod] = [*traversers, *methods]
    once = [*zip(making, built, strict=True), *zip(preparing, made, strict=True)]
    base = making[0], float(np.median(taken[:, 0]))
    for k, (entry, (before, thing)) in enumerate(zip(entries, once, strict=True)):
        one = isinstance(entry, leapray.Traverser)
        shown = as_image(thing, rays, truth) if one else jobs[k]()
        missed = shown.misses(truth)  # type: ignore[attr-defined]
        own = float(np.median(taken[:, k]))
        rows.append(
            Row(
                n,
                name,
                entry.spec,
                name_of(entry),
                one,
                entry.exact,
                own,
                float(taken[:, k].min()),
                float(taken[:, k].max()),
                before,
                thing.nbytes,
                missed.hits,
                missed.lost,
                missed.invented,
                missed.displaced,
                missed.farthest,
                pays_after(before, own, *base),
            )
        )
    return rows


def timed(make: Callable) -> tuple:
    """What it makes, and the median of three times."""
    took = []
    for _ in range(3):
        began = time.process_time()
        made = make()
        took.append(time.process_time() - began)
    return made, float(np.median(took))


def best(methods: list[leapray.ImageMethod]) -> leapray.ImageMethod:
    """One that is exact, and takes the camera of all."""
    return next(each for each in methods if each.exact and each.perspective)


def as_image(structure: leapray.Structure, rays, like: leapray.Image) -> leapray.Image:
    """What the rays of an image find one by one."""
    hits = leapray.trace(structure, *rays, mode="binary", count=False)
    shape = like.t.shape
    found = np.isfinite(hits.t).reshape(shape)
    cell = np.where(found[..., None], hits.cell.reshape(*shape, 3), like.cell)
    none = np.zeros(shape, bool)
    return leapray.Image(
        hits.t.reshape(shape), cell, found, none, like.shade, None, {}, like.method, like.camera
    )


def name_of(entry: leapray.Traverser | leapray.ImageMethod) -> str:
    return f"{'rays: ' * isinstance(entry, leapray.Traverser)}{label(entry)}"


def pays_after(prepare: float, frame: float, other_prepare: float, other: float) -> float | None:
    """Frames after which what is made once has paid; None: never."""
    more = prepare - other_prepare
    if frame < other:
        return max(more / (other - frame), 0.0)
    return 0.0 if frame == other and more <= 0 else None


# ---- lights that are stored ------------------------------------------------------


@dataclass(frozen=True)
class Stored:
    """A sun whose visibility is stored in the surface voxels of a phantom."""

    n: int
    image: int  # pixels along a side
    method: str
    voxels: int
    bits: float  # seconds, median: the sun's bits of all voxels
    frame: float  # seconds of a picture that looks them up
    shadows: float  # of as many shadow rays as the picture has hits, along discrete lines
    pays_after: float  # frames of a still sun


def light_bits(
    volume: leapray.Volume, n: int, camera: leapray.Camera, image: int, rounds: int
) -> Stored:
    """By the first method that stores lights."""
    method = next(each for each in leapray.image_methods() if each.lights)
    prepared = leapray.prepare(volume, method)
    sun = leapray.Light("sun", (1.0, 1.0, 1.0), direction=SUN)
    prepared.set_light(0, sun)
    seen = leapray.render_image(method, prepared, camera, image, image)
    assert seen.normal is not None
    # One voxel out along the normal, as the lines of the bits.
    starts = seen.cell[seen.hit] + 0.5 + seen.normal[seen.hit]
    lines = leapray.build(volume, first_of(LINES))
    towards = np.broadcast_to(np.array(SUN), starts.shape)
    taken = np.median(
        seconds(
            [
                partial(prepared.set_light, 0, sun),
                partial(leapray.render_image, method, prepared, camera, image, image),
                partial(leapray.trace, lines, starts, towards, mode="binary", count=False),
            ],
            rounds,
        ),
        axis=0,
    )
    bits, frame, shadows = map(float, taken)
    voxels = len(prepared.voxels().cell)
    return Stored(n, image, method.spec, voxels, bits, frame, shadows, bits / max(shadows, 1e-9))


# ---- telling ---------------------------------------------------------------------


def draw(folder: Path, rows: list[Row], leaps: list[Leap]) -> None:
    """Time by N of exact and other methods, and what the frame before saves."""
    plain = {each.spec for each in [*leapray.image_methods(), *leapray.traversers()]}
    rows = [row for row in rows if row.method in plain]
    views = list(dict.fromkeys(row.camera for row in rows))
    with charts.chart(folder / "methods", columns=len(views), width=5.2, height=4.2) as (
        figure,
        axes,
    ):
        looks = {
            name: charts.look(k) for k, name in enumerate(dict.fromkeys(r.label for r in rows))
        }
        for axis, camera in zip(axes[0], views, strict=True):
            for name, found in series([row for row in rows if row.camera == camera]).items():
                y = [1e3 * row.seconds for row in found]
                axis.plot([row.n for row in found], y, label=name, **looks[name])
            axis.set_yscale("log")
            axis.set_title(camera)
            axis.set_xlabel("N, of N³ spheres")
            charts.plain_ticks(axis)
        axes[0, 0].set_ylabel("milliseconds a frame")
        handles = axes[0, 0].get_legend_handles_labels()
        figure.legend(*handles, loc="outside lower center", ncols=3)
    turns = sorted({leap.turn for leap in leaps})
    with charts.chart(folder / "leaps", columns=len(turns), width=4.2, height=3.6) as (
        figure,
        axes,
    ):
        for axis, turn in zip(axes[0], turns, strict=True):
            for k, (name, orbit) in enumerate(by_phantom(leaps, turn).items()):
                style = charts.look(k) | {"marker": ""}
                axis.plot([f.frame for f in orbit], [f.leapt for f in orbit], label=name, **style)
            axis.set_ylim(-0.1, 1)
            axis.set_title(f"{turn:g} degrees a frame")
            axis.set_xlabel("frame")
        axes[0, 0].set_ylabel("share of cells leapt over")
        handles = axes[0, 0].get_legend_handles_labels()
        figure.legend(*handles, loc="outside lower center", ncols=3)


def series(rows: list[Row]) -> dict[str, list[Row]]:
    """The rows by the label of their method."""
    return charts.grouped(rows, lambda row: row.label)


def write_page(
    folder: Path, told: dict, rows: list[Row], lights: list[Stored], leaps: list[Leap]
) -> None:
    """methods.html: the charts and figures with what they say."""
    side, image = told["size"], told["image"]
    body = [
        "<h1>Whole images</h1>",
        f'<p class="soft">{side}³ samples, N³ spheres, {image} x {image} pixels, one thread, '
        f"medians of {told['rounds']} rounds in turns. {page.esc(told['machine'])}.</p>",
        page.figure(folder, "methods.png", "Time", "methods and traversers with default options"),
        page.findings(sentences(rows)),
        page.figure(folder, "leaps.png", "Space leaping", "what the frame before saves"),
        page.findings([*of_lights(lights), *of_leaps(leaps)]),
    ]
    for camera in dict.fromkeys(row.camera for row in rows):
        for n in dict.fromkeys(row.n for row in rows):
            body += [f"<h3>N = {n}, {camera}</h3>", table(rows, n, camera)]
    (folder / "methods.html").write_text(page.whole("Whole images", body), "utf-8")


def table(rows: list[Row], n: int, camera: str) -> str:
    """All figures of a phantom through a camera."""
    head = ["", "ms", "least", "most", "prepare, ms", "kB", "lost", "invented", "another cell"]
    lines = [
        [
            page.esc(row.label),
            *(f"{1e3 * value:.2f}" for value in (row.seconds, row.least, row.most, row.prepare)),
            f"{row.nbytes / 1e3:.0f}",
            *(str(value) for value in (row.lost, row.invented, row.displaced, row.farthest)),
            NEVER if row.pays_after is None else f"{row.pays_after:.1f}",
        ]
        for row in rows
        if (row.n, row.camera) == (n, camera)
    ]
    return page.table([*head, "farthest", "pays after"], lines)


def sentences(rows: list[Row]) -> list[str]:
    """The fastest, and the misses, computed from the figures."""
    said = []
    for camera in dict.fromkeys(row.camera for row in rows):
        for n in sorted({row.n for row in rows})[:: max(len({row.n for row in rows}) - 1, 1)]:
            found = [row for row in rows if (row.camera, row.n) == (camera, n)]
            exact = [row for row in found if row.exact]
            images, rays = (
                min((row for row in exact if row.rays == one), key=lambda row: row.seconds)
                for one in (False, True)
            )
            said.append(
                f"{camera}, N = {n}: the fastest exact image is {images.label}, "
                f"{1e3 * images.seconds:.1f} ms; the fastest exact {rays.label}, "
                f"{1e3 * rays.seconds:.1f} ms, {rays.seconds / images.seconds:.2f} times that."
            )
    for row in worst(rows):
        said.append(
            f"{row.label}, {row.camera}, N = {row.n}: of {row.hits} hits {row.lost} are lost and "
            f"{row.displaced} in another cell, at most {row.farthest} cells off; {row.invented} "
            "are invented."
        )
    wrong = [row for row in rows if row.exact and (row.lost or row.invented)]
    said.append(
        f"Exact methods and traversers lose and invent nothing in {sum(r.exact for r in rows)} "
        "pictures." if not wrong else f"NOT EXACT: {', '.join(row.method for row in wrong)}."
    )  # fmt: skip
    return said


def worst(rows: list[Row]) -> list[Row]:
    """Of every image method that may miss the picture with the largest share of lost hits."""
    found: dict[str, Row] = {}
    for row in rows:
        if row.exact or row.rays:
            continue
        known = found.get(row.label)
        if known is None or row.lost / row.hits > known.lost / known.hits:
            found[row.label] = row
    return list(found.values())


def of_lights(lights: list[Stored]) -> list[str]:
    return [
        f"N = {each.n}, {each.image} x {each.image}: a sun's bits in {each.voxels} voxels take "
        f"{1e3 * each.bits:.1f} ms and save {1e3 * each.shadows:.1f} ms of shadow rays a frame: "
        f"they pay after {each.pays_after:.1f} frames."
        for each in lights
    ]
