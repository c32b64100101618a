# SPDX-License-Identifier: GPL-3.0-or-later
"""Time and memory against the size of the work: samples, triangles, instances, pixels, threads.

One scene per value, in the open under a sun, with a bounce of light, rendered with an empty cache;
everything else stays as it is. Meshes are the scan-like body, instances balls in a cube that fills
the same part of the picture however many they are.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np

from leapray.threads import cores

from .. import model, pipeline
from . import charts, page, scenes
from .entries import spread
from .folder import study_folder, write_figures
from .options import chosen, number

STUDY = True

WIDTH, HEIGHT = 480, 270
SAMPLES = 4
EYE = 2.9, -4.5, 1.85
SUN = model.Light("sun", (3.0, 3.0, 3.0), direction=(0.36, -0.48, 0.8), angle=0.01)
FULL = {
    "resolution": (64, 128, 256, 512, 1024),
    "triangles": (1_000, 10_000, 100_000, 1_000_000, 3_000_000),
    "instances": (1, 10, 100, 1_000, 10_000, 100_000),
    "pixels": (160 * 90, 320 * 180, 640 * 360, 1280 * 720, 2560 * 1440),
}
QUICK = {
    "resolution": (32, 64),
    "triangles": (1_000, 10_000),
    "instances": (1, 10, 100),
    "pixels": (160 * 90, 320 * 180),
}
TOLD = {
    "resolution": "samples along the longest side",
    "triangles": "triangles of a mesh, voxels as the plan finds them",
    "instances": "instances of a ball",
    "pixels": "pixels",
    "threads": "threads",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    number(parser, "rounds", "of which times are the median; 3")


def main(args: argparse.Namespace) -> int:
    """Measure; writes the folder and returns the exit code."""
    rounds = chosen(args, "rounds", 1, 3)
    values = dict(chosen(args, "values", QUICK, FULL))
    values.setdefault("threads", tuple(range(1, cores() + 1)))
    with study_folder(args, "scaling") as folder:
        rows = [row for axis in values for row in measure(axis, values[axis], rounds)]
        told = write_figures(folder, "scaling", {"rounds": rounds, "samples": SAMPLES}, rows=rows)
        draw(folder, rows)
        write_page(folder, told, rows)
    return 0


# ---- subjects ------------------------------------------------------------


def with_resolution(samples: int) -> model.Scene:
    return with_settings(of_scan(150), resolution=samples)


def with_triangles(n: int) -> model.Scene:
    return of_scan(round(np.sqrt(n / 12)))


def with_instances(n: int) -> model.Scene:
    """The first n cells of the smallest cubic grid that holds them, a ball in each."""
    scene = of_scan(6)
    side = int(np.ceil(n ** (1 / 3) - 1e-9))
    placed = []
    for x, y, z in list(product(range(side), repeat=3))[:n]:
        matrix = np.diag([0.8 / side] * 3 + [1.0])
        matrix[:3, 3] = (2 * np.array([z, y, x]) + 1) / side - 1
        placed.append(replace(scene.instances[0], world_from_object=matrix))
    return replace(scene, instances=tuple(placed))


def with_pixels(n: int) -> model.Scene:
    height = round(np.sqrt(n * 9 / 16))
    return of_scan(90, n // height, height)


def with_threads(n: int) -> model.Scene:
    return with_settings(of_scan(90), threads=n)


SUBJECTS: dict[str, Callable[[int], model.Scene]] = {
    "resolution": with_resolution,
    "triangles": with_triangles,
    "instances": with_instances,
    "pixels": with_pixels,
    "threads": with_threads,
}


def of_scan(divisions: int, width: int = WIDTH, height: int = HEIGHT) -> model.Scene:
    """The scan-like body of 12 divisions^2 triangles, which fills the height, on one thread."""
    scene = scenes.looked_at(scenes.scan(divisions), EYE, (0, 0, 0), width, height)
    scene = replace(scene, lights=(SUN,), world=model.World((0.1, 0.1, 0.1)))
    return with_settings(scene, samples=SAMPLES, diffuse_bounces=1, threads=1)


def with_settings(scene: model.Scene, **settings) -> model.Scene:
    return replace(scene, settings=replace(scene.settings, **settings))


# ---- measuring -----------------------------------------------------------


@dataclass(frozen=True)
class Row:
    """A scene; seconds are medians."""

    axis: str
    value: int
    seconds_made: float  # to plan, voxelize and build
    seconds_traced: float
    least_traced: float
    most_traced: float
    rays: int
    voxel_size: float  # of the first volume
    nbytes: int  # of volumes and structures
    peak: int  # bytes

    @property
    def speed(self) -> float:
        """Millions of rays a second."""
        return self.rays / self.seconds_traced / 1e6


def measure(axis: str, values: tuple[int, ...], rounds: int) -> list[Row]:
    """Rows of one axis: all its scenes in turns, round by round."""
    subjects = [SUBJECTS[axis](value) for value in values]
    reports = [[pipeline.render(scene).report for scene in subjects] for _ in range(rounds)]
    rows = []
    for k, value in enumerate(values):
        told = [turn[k] for turn in reports]
        traced = [each["seconds"]["trace"] for each in told]
        made = [each["seconds"]["total"] - each["seconds"]["trace"] for each in told]
        held = told[0]["bytes"]
        rows.append(
            Row(
                axis,
                value,
                float(np.median(made)),
                *spread(traced),
                told[0]["rays"],
                told[0]["volumes"][0]["voxel_size"],
                held["volumes"] + held["structures"],
                held["peak"],
            )
        )
    print(f"scaling: {axis}", file=sys.stderr, flush=True)
    return rows


# ---- telling -------------------------------------------------------------


def draw(folder: Path, rows: list[Row]) -> None:
    """A column per axis: seconds above, megabytes below."""
    groups = charts.grouped(rows, lambda row: row.axis)
    path, columns = folder / "scaling", len(groups)
    with charts.chart(path, rows=2, columns=columns, width=3.6, height=3.0) as (_, axes):
        for column, (name, group) in enumerate(groups.items()):
            lines = (
                {
                    "set-up, s": [row.seconds_made for row in group],
                    "tracing, s": [row.seconds_traced for row in group],
                    "million rays a second": [row.speed for row in group],
                },
                {
                    "volumes and structures, MB": [row.nbytes / 2**20 for row in group],
                    "at peak, MB": [row.peak / 2**20 for row in group],
                },
            )
            x = [row.value for row in group]
            for axis, series in zip(axes[:, column], lines, strict=True):
                for k, (label, y) in enumerate(series.items()):
                    axis.plot(x, y, label=label, **charts.look(k))
                axis.set_yscale("log")
                if name != "threads":
                    axis.set_xscale("log")
                else:
                    axis.set_xticks(x)
            axes[0, column].set_title(name, fontsize=10.5)
            axes[1, column].set_xlabel(TOLD[name], fontsize=9)
        for axis in axes[:, 0]:
            axis.legend(fontsize=8)


def sentences(rows: list[Row]) -> list[str]:
    """Sentences computed from the figures."""
    said = []
    for name, group in charts.grouped(rows, lambda row: row.axis).items():
        first, last = group[0], group[-1]
        said.append(
            f"{name.capitalize()} from {first.value:,} to {last.value:,}: set-up takes "
            f"{first.seconds_made:.2g} to {last.seconds_made:.2g} s, {first.speed:.2g} to "
            f"{last.speed:.2g} million rays a second are traced, volumes and structures take "
            f"{first.nbytes / 2**20:.2g} to {last.nbytes / 2**20:.2g} MB."
        )
    return said


def write_page(folder: Path, told: dict, rows: list[Row]) -> None:
    """scaling.html: the figures with what they say."""
    head = ["axis", "value", "set-up, s", "tracing, s", "least", "most", "rays", "million a second"]
    table = [
        [
            row.axis,
            f"{row.value:,}",
            *(f"{x:.3f}" for x in (row.seconds_made, row.seconds_traced)),
            *(f"{x:.3f}" for x in (row.least_traced, row.most_traced)),
            f"{row.rays:,}",
            f"{row.speed:.2f}",
            f"{row.voxel_size:.3g}",
            f"{row.nbytes / 2**20:.1f}",
            f"{row.peak / 2**20:.1f}",
        ]
        for row in rows
    ]
    body = [
        "<h1>Time and memory against size</h1>",
        f'<p class="soft">{WIDTH} x {HEIGHT} pixels, {SAMPLES} samples, one thread, but where that '
        f"is what varies; medians of {told['rounds']} rounds. {page.esc(told['machine'])}.</p>",
        page.figure(folder, "scaling.png", "Size of the work", "lower is better but for rays"),
        page.findings(sentences(rows)),
        page.table([*head, "voxel", "MB", "MB at peak"], table),
    ]
    (folder / "scaling.html").write_text(page.whole("Time and memory against size", body), "utf-8")
