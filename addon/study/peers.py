# SPDX-License-Identifier: GPL-3.0-or-later
"""LeapRay and other programs at the same work, interleaved in one run on one machine.

One function per peer: a closed mesh to samples around its surface, end to end from numpy arrays, by
every set of vector instructions and number of threads, and by OpenVDB's Python; rays
(traversals.py); distance transforms (distances.py).
"""

from __future__ import annotations

import argparse
import contextlib
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import leapray
from leapray.formats.vdb import openvdb_module

from . import charts, distances, page, scenes, traversals
from .entries import seconds, spread
from .folder import study_folder, write_figures
from .options import chosen, number, numbers

STUDY = True

BAND = 1.8  # voxels to either side, of both
SIMD = ("portable", "avx2", "avx512")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    number(parser, "scan", "divisions of the scan-like mesh, which has 12 N^2 triangles; 290")
    numbers(parser, "sizes", "samples across; 256 512")
    number(parser, "image", "rays along a side; 1024")
    number(parser, "cells", "a side of the distance transforms; 256", least=8)
    number(parser, "rounds", "medians are of so many; 5")


def main(args: argparse.Namespace) -> int:
    """Measure; writes the folder and returns the exit code."""
    mesh = scenes.scan(chosen(args, "scan", 40, 290))
    sizes = chosen(args, "sizes", [64], [256, 512])
    rounds = chosen(args, "rounds", 2, 5)
    with study_folder(args, "peers") as folder:
        rows = []
        for size in sizes:
            rows += samples_of_meshes(mesh.vertices, mesh.triangles, size, rounds)
            print(f"peers: {size} samples", file=sys.stderr, flush=True)
        image = chosen(args, "image", 64, 1024)
        phantoms = chosen(args, "phantoms", {32: (2,)}, {128: (1, 5, 10), 512: (5,)})
        rays = traversals.measure(phantoms, image, rounds)
        fields = distances.measure(chosen(args, "cells", 64, 256), rounds)
        told = {"band": BAND, "rounds": rounds, "triangles": len(mesh.triangles)}
        told = write_figures(folder, "peers", told, rows=rows, rays=rays, distances=fields)
        draw(folder, rows)
        traversals.draw(folder, rays)
        more = traversals.section(folder, rays, image) + distances.section(fields)
        write_page(folder, told, rows, more)
    return 0


@dataclass(frozen=True)
class Row:
    """A method for a piece of work."""

    work: str
    size: int  # samples across
    by: str
    threads: int  # 0: all cores
    seconds: float  # median
    least: float
    most: float


# ---- meshes to samples ---------------------------------------------------


def samples_of_meshes(
    vertices: NDArray[np.float32], triangles: NDArray[np.int32], size: int, rounds: int
) -> list[Row]:
    """Rows of one resolution; vertices (n, 3), triangles (m, 3) of a closed mesh."""
    voxel = float(np.ptp(vertices, axis=0).max()) / size
    methods: dict[tuple[str, int], Callable] = {}
    for simd in offered(SIMD):
        methods[f"LeapRay {simd}", 1] = by_leapray(vertices, triangles, voxel, simd, 1)
    for threads in (2, 0):
        methods["LeapRay", threads] = by_leapray(vertices, triangles, voxel, "auto", threads)
    methods["OpenVDB", 0] = by_openvdb(vertices, triangles, voxel)
    taken = seconds(list(methods.values()), rounds, time.perf_counter)  # several threads
    return [
        Row("mesh to samples", size, by, threads, *spread(s))
        for (by, threads), s in zip(methods, taken.T, strict=True)
    ]


def offered(names: tuple[str, ...]) -> list[str]:
    """Vector instructions that this processor has."""
    box = np.eye(4)[:, :3], np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    found = []
    for name in names:
        try:
            leapray.voxelize(*box, 0.5, simd=name)
        except leapray.LeapRayError:
            continue
        found.append(name)
    return found


def by_leapray(vertices, triangles, voxel: float, simd: str, threads: int) -> Callable:
    return lambda: leapray.voxelize(
        vertices, triangles, voxel, half_width=BAND, dtype="u8", simd=simd, threads=threads
    )


def by_openvdb(vertices, triangles, voxel: float) -> Callable:
    """createLevelSetFromPolygons, which uses all cores; raises LeapRayError without OpenVDB."""
    with contextlib.suppress(ImportError):
        import bpy  # noqa: F401  has OpenVDB
    openvdb = openvdb_module()
    corners = triangles.astype(np.uint32)
    return lambda: openvdb.FloatGrid.createLevelSetFromPolygons(
        vertices,
        triangles=corners,
        transform=openvdb.createLinearTransform(voxel),
        halfWidth=BAND,
    )


# ---- telling -------------------------------------------------------------


def name_of(row: Row) -> str:
    threads = {0: "all cores", 1: "1 thread"}.get(row.threads, f"{row.threads} threads")
    return f"{row.by}, {threads}"


def draw(folder: Path, rows: list[Row]) -> None:
    """Seconds of all methods, a group per size."""
    sizes = sorted({row.size for row in rows})
    with charts.chart(folder / "peers", columns=len(sizes), width=5.2, height=3.4) as (_, axes):
        for axis, size in zip(axes[0], sizes, strict=True):
            group = [row for row in rows if row.size == size]
            charts.bars(axis, [name_of(row) for row in group], [row.seconds for row in group])
            axis.set_xscale("log")
            axis.set_title(f"{size} samples across, seconds", fontsize=10.5)


def write_page(folder: Path, told: dict, rows: list[Row], more: list[str]) -> None:
    """peers.html: the figures with what they say, and more sections."""
    body = [
        "<h1>Beside others</h1>",
        f'<p class="soft">A closed mesh of {told["triangles"]:,} triangles to samples within '
        f"{BAND} voxels of its surface, sign included; medians of {told['rounds']} rounds in "
        f"turns. {page.esc(told['machine'])}.</p>",
        page.figure(folder, "peers.png", "Mesh to samples", "lower is better"),
        page.findings(sentences(rows)),
        page.table(
            ["samples", "by", "seconds", "least", "most"],
            [
                [
                    str(row.size),
                    page.esc(name_of(row)),
                    f"{row.seconds:.3f}",
                    f"{row.least:.3f}",
                    f"{row.most:.3f}",
                ]
                for row in rows
            ],
        ),
        *more,
    ]
    (folder / "peers.html").write_text(page.whole("Beside others", body), "utf-8")


def sentences(rows: list[Row]) -> list[str]:
    """Sentences computed from the figures."""
    said = []
    for size in sorted({row.size for row in rows}):
        taken = {(row.by, row.threads): row.seconds for row in rows if row.size == size}
        one = min(s for (by, threads), s in taken.items() if threads == 1)
        said.append(
            f"At {size} samples LeapRay takes {taken['LeapRay', 0]:.3g} s on all cores, OpenVDB "
            f"{taken['OpenVDB', 0]:.3g} s; two threads are {one / taken['LeapRay', 2]:.2f} times "
            f"as fast as one."
        )
    return said
