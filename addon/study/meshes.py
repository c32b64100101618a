# SPDX-License-Identifier: GPL-3.0-or-later
"""Errors of a picture against its meshes, at default settings.

Every scene is planned, voxelized and traced as for a render, one ray through the middle of each
pixel; truth is Embree on the triangles themselves. The error of a point is perpendicular to the
surface, in footprints of its pixel, where both see the same object; silhouettes are counted where
they do not. The dense, scan-like mesh is made here, the other scenes are files.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .. import model, pipeline
from . import charts, page, scenes
from .folder import study_folder, write_figures
from .options import chosen, number

STUDY = True

SCENES = ("suzanne", "cad", "thin")
BAR_ERROR, BAR_MISMATCH = 0.25, 0.10  # what the project asks of a default render,
BAR_TURNED = 0.01  # of normals more than metrics.TURNED degrees off
CUT = 0.25  # footprints, where the picture of errors is brightest


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--scenes", type=Path, nargs="+", metavar="SCENE.blend",
                        help=f"; {', '.join(SCENES)}")  # fmt: skip
    number(parser, "percentage", "of the scenes' resolution; 100")
    number(parser, "scan", "divisions of the scan-like mesh, which has 12 N^2 triangles; 300")


def main(args: argparse.Namespace) -> int:
    """Measure; writes the folder and returns the exit code."""
    files = [Path(p) for p in getattr(args, "scenes", None) or map(scenes.sample, SCENES)]
    percentage = chosen(args, "percentage", 40, 100)
    divisions = chosen(args, "scan", 60, 300)
    with study_folder(args, "meshes") as folder:
        rows, pictures = [], {}
        for name, scene in subjects(files, divisions, percentage):
            row, pictures[name] = judge(name, scene)
            rows.append(row)
            print(f"meshes: {name}", file=sys.stderr, flush=True)
        told = {"percentage": percentage}
        told = write_figures(folder, "meshes", told, rows=rows)
        draw(folder, rows, pictures)
        write_page(folder, told, rows)
    return 0


def subjects(files: list[Path], divisions: int, percentage: int):
    """Pairs of name and scene, read one after the other."""
    for path in files:
        yield path.stem, scenes.read(path, percentage)
    width, height = (n * percentage // 100 for n in (960, 540))
    mesh = scenes.scan(divisions)
    yield "scan-like", scenes.looked_at(mesh, (2.9, -4.5, 1.85), (0, 0, 0), width, height)


# ---- measuring -----------------------------------------------------------


@dataclass(frozen=True)
class Row:
    """A scene. Errors are perpendicular, in footprints of the pixel."""

    scene: str
    triangles: int  # with those of instances
    width: int
    height: int
    error_50: float
    error_99: float
    error_max: float
    worst: str  # the object that errs most at 99 %
    worst_99: float
    normal_99: float  # degrees between shading normals
    turned: float  # fraction of pixels, but for edges, whose normals are 5 degrees off
    agreeing: int  # pixels that see the same object
    edges: int  # pixels with another object beside them
    mismatch: int  # pixels that see another object
    mismatch_share: float  # by edges
    far: int  # of them more than a pixel from an edge
    bytes: int  # of volumes and structures
    seconds_model: float
    seconds_trace: float


def judge(name: str, scene: model.Scene) -> tuple[Row, NDArray[np.uint8]]:
    """The figures of a scene, and a picture of its errors."""
    want = scenes.truth(scene)
    frame = pipeline.render(scene)
    found = scenes.difference(scene, want, frame.passes)
    seconds, held = frame.report["seconds"], frame.report["bytes"]
    row = Row(
        name,
        want.triangles,
        scene.width,
        scene.height,
        found.error_50,
        found.error_99,
        found.error_max,
        found.worst,
        found.worst_99,
        found.normal_99,
        found.turned,
        found.agreeing,
        found.edges,
        found.mismatch,
        found.mismatch_share,
        found.far,
        held["volumes"] + held["structures"],
        seconds["voxelize"] + seconds["structure"] + seconds["plan"],
        seconds["trace"],
    )
    return row, charts.errors(found.error, CUT, found.differ)


# ---- telling -------------------------------------------------------------


def draw(folder: Path, rows: list[Row], pictures: dict[str, NDArray[np.uint8]]) -> None:
    """The two figures of each scene beside their bars, and where the errors lie."""
    place = np.arange(len(rows))
    with charts.chart(folder / "meshes", columns=2, width=5.2, height=3.4) as (_, axes):
        for axis, values, bar, title in (
            (axes[0, 0], [row.error_99 for row in rows], BAR_ERROR,
             "perpendicular error at 99 %, footprints"),
            (axes[0, 1], [100 * row.mismatch_share for row in rows], 100 * BAR_MISMATCH,
             "silhouette mismatch, per cent of edge pixels"),
        ):  # fmt: skip
            axis.bar(place, values, color=charts.COLORS[0], width=0.6)
            for x, value in zip(place, values, strict=True):
                axis.text(x, value, f"{value:.3g}", ha="center", va="bottom", fontsize=9)
            axis.axhline(bar, color=charts.COLORS[1], lw=1.2)
            axis.text(len(rows) - 0.5, bar, "asked for", color=charts.COLORS[1], fontsize=9,
                      ha="right", va="bottom")  # fmt: skip
            axis.set_xticks(place, [row.scene for row in rows])
            axis.grid(axis="x", visible=False)
            axis.set_title(title, fontsize=10.5)
    for name, image in pictures.items():
        (folder / f"errors-{name}.png").write_bytes(charts.png(image))


def write_page(folder: Path, told: dict, rows: list[Row]) -> None:
    """meshes.html: the figures with what they say."""
    body = [
        "<h1>Pictures against their meshes</h1>",
        f'<p class="soft">{rows[0].width} x {rows[0].height} pixels, default settings. '
        f"{page.esc(told['machine'])}.</p>",
        page.figure(folder, "meshes.png", "At 99 % and at silhouettes", "lower is better"),
        page.findings(sentences(rows)),
        page.table(
            ["scene", "triangles", "error 50 %", "99 %", "most", "worst object, 99 %",
             "normals 99 %, degrees", "over 5 degrees",
             "edge pixels", "see another object", "beyond a pixel", "MB", "model, s",
             "trace, s"],
            [
                [
                    page.esc(row.scene),
                    f"{row.triangles:,}",
                    f"{row.error_50:.4f}",
                    f"{row.error_99:.3f}",
                    f"{row.error_max:.3g}",
                    page.esc(f"{row.worst} {row.worst_99:.3f}"),
                    f"{row.normal_99:.2f}",
                    f"{row.turned:.2%}",
                    f"{row.edges:,}",
                    f"{row.mismatch} ({row.mismatch_share:.2%})",
                    str(row.far),
                    f"{row.bytes / 2**20:.1f}",
                    f"{row.seconds_model:.1f}",
                    f"{row.seconds_trace:.1f}",
                ]
                for row in rows
            ],
        ),
        "<h2>Where the errors lie</h2>",
        *(
            page.figure(folder, f"errors-{row.scene}.png", row.scene,
                        f"black to yellow: 0 to {CUT:g} footprints and more; cyan: another object")
            for row in rows
        ),
        "<h2>What this is, and what it is not</h2>",
        "<p>The largest errors are pixels where an object hides a part of itself and the two "
        "see different parts of it: silhouettes that object indices do not tell. Seconds of the "
        "model hold the levels that the plan tried and left. Embree works in f32.</p>",
    ]  # fmt: skip
    (folder / "meshes.html").write_text(page.whole("Pictures against meshes", body), "utf-8")


def sentences(rows: list[Row]) -> list[str]:
    """Sentences computed from the figures."""
    said = []
    for row in rows:
        holds = row.error_99 <= BAR_ERROR and row.mismatch_share <= BAR_MISMATCH and not row.far
        holds = holds and row.turned <= BAR_TURNED
        said.append(
            f"{row.scene}: {row.error_99:.3f} footprints at 99 %, {row.mismatch_share:.1%} of the "
            f"edge pixels see another object, {row.far} of those lie beyond a pixel, "
            f"{row.turned:.2%} of the normals are more than 5 degrees off: "
            f"{'within' if holds else 'outside of'} what is asked for."
        )
    return said
