# SPDX-License-Identifier: GPL-3.0-or-later
"""Error of light against seconds: LeapRay and Cycles on the same cores, scene by scene.

Both render every scene at 1, 4, 16 .. samples with equal filters and limits of bounces, without
denoising; errors are those against Cycles with four times as many samples and another seed.
Seconds are those of the whole frame, so that LeapRay's hold the making of its volumes each time.
"""

from __future__ import annotations

import argparse
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import leapray

from ..blender import open_file
from . import charts, compare, page, scenes
from .folder import study_folder, write_figures
from .options import chosen, number

STUDY = True

SCENES = (
    *("gallery", "suzanne", "cornell", "textured", "mirrors", "metal", "glass", "still"),
    *("xray", "fog"),  # volumes that absorb, and scatter
)
QUICK = ("cornell", "still")
ENGINES = {"leapray": "LeapRay", "cycles": "Cycles"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--scenes", type=Path, nargs="+", metavar="SCENE.blend",
                        help=f"; {', '.join(SCENES)}")  # fmt: skip
    number(parser, "percentage", "of the scenes' resolution; 50")
    number(parser, "most", "samples per pixel, a power of 4; 1024")
    number(parser, "reference", "samples of the reference; 4 times as many as --most")
    parser.add_argument("--references", type=Path, metavar="DIR",
                        help="keeps reference frames for the next run")  # fmt: skip


def main(args: argparse.Namespace) -> int:
    """Measure; writes the folder and returns the exit code."""
    own = chosen(args, "scenes", QUICK, SCENES)
    files = [scenes.sample(each) if isinstance(each, str) else each for each in own]
    percentage = chosen(args, "percentage", 20, 50)
    most = chosen(args, "most", 16, 1024)
    with study_folder(args, "light") as folder:
        how = argparse.Namespace(
            samples=most,
            curve=most,
            reference=getattr(args, "reference", None) or 4 * most,
            references=getattr(args, "references", None),
            percentage=percentage,
            threads=None,
        )
        rows = [row for file in files for row in measure(file, how, folder)]
        told = {"percentage": percentage, "reference_samples": how.reference}
        told = write_figures(folder, "light", told, rows=rows)
        draw(folder, rows)
        write_page(folder, told, rows)
    return 0


# ---- measuring -----------------------------------------------------------


@dataclass(frozen=True)
class Row:
    """A frame against the reference. Errors are by a lit white surface."""

    scene: str
    engine: str  # of ENGINES
    samples: int
    seconds: float  # of the frame
    seconds_model: float  # of them, LeapRay's volumes
    rmse: float
    rmse_but_rims: float
    flip: float
    flip_but_rims: float
    mean_ratio: float  # less 1
    rims_share: float


def measure(file: Path, how: argparse.Namespace, folder: Path) -> list[Row]:
    """Both engines at all counts; the last pictures of both go to the folder.

    how: the comparison's options, the percentage of the scene's own resolution.
    """
    print(f"light: {file.stem}", file=sys.stderr, flush=True)
    scene = open_file.open_scene(file)
    aside = folder / "pictures"
    aside.mkdir()
    percentage = scene.render.resolution_percentage * how.percentage // 100
    own = argparse.Namespace(**(vars(how) | {"scene": file, "percentage": percentage}))
    told = compare.compare(scene, own, [leapray.traverser()], aside)
    for engine in (*ENGINES, "reference"):
        shutil.move(aside / f"{engine}.png", folder / f"{file.stem}-{engine}.png")
    shutil.rmtree(aside)
    found = {"leapray": told["by_samples"], "cycles": told["cycles"]["by_samples"]}
    return [
        Row(
            file.stem,
            engine,
            count,
            values["seconds"],
            sum(values.get("phases", {}).get(name, 0.0) for name in MODEL),
            values["all"]["rmse"],
            values["but_rims"]["rmse"],
            values["all"]["flip"],
            values["but_rims"]["flip"],
            values["all"]["mean_ratio"],
            values["rims_share"],
        )
        for engine in ENGINES
        for count, values in found[engine].items()
        if count in told["by_samples"]
    ]


MODEL = ("voxelize", "structure", "plan")  # phases of LeapRay's report


def of(rows: list[Row], scene: str, engine: str) -> list[Row]:
    return [row for row in rows if (row.scene, row.engine) == (scene, engine)]


def seconds_to(rows: list[Row], error: float) -> float | None:
    """Seconds until the error is reached, between the counts by powers; None where it is not."""
    ys = np.log([row.rmse for row in rows])
    reached = np.flatnonzero(ys <= np.log(error))
    if not len(reached):
        return None
    k = int(reached[0])
    if k == 0:
        return rows[0].seconds
    x = np.log([row.seconds for row in rows])
    fraction = (ys[k - 1] - np.log(error)) / (ys[k - 1] - ys[k])
    return float(np.exp(x[k - 1] + fraction * (x[k] - x[k - 1])))


# ---- telling -------------------------------------------------------------


def draw(folder: Path, rows: list[Row]) -> None:
    """A panel per scene, the counts as numbers."""
    names = list(dict.fromkeys(row.scene for row in rows))
    columns = min(3, len(names))
    lines = -(-len(names) // columns)
    with charts.chart(folder / "light", rows=lines, columns=columns, width=4.6, height=3.9) as (
        figure,
        axes,
    ):
        for axis in axes.flat[len(names) :]:
            axis.set_axis_off()
        for axis, name in zip(axes.flat, names, strict=False):
            for k, (engine, label) in enumerate(ENGINES.items()):
                found = of(rows, name, engine)
                xs, ys = [row.seconds for row in found], [row.rmse for row in found]
                axis.plot(xs, ys, label=label, **charts.look(k))
                for row in found[:: max(len(found) - 1, 1)]:
                    axis.annotate(f"{row.samples}", (row.seconds, row.rmse), xytext=(5, 5),
                                  textcoords="offset points", fontsize=9)  # fmt: skip
            axis.set_xscale("log")
            axis.set_yscale("log")
            charts.plain_ticks(axis)
            axis.set_title(name)
            axis.set_xlabel("seconds for the frame")
        for axis in axes[:, 0]:
            axis.set_ylabel("RMSE by a lit white surface")
        figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=2)


def write_page(folder: Path, told: dict, rows: list[Row]) -> None:
    """light.html: the charts with what they say."""
    names = list(dict.fromkeys(row.scene for row in rows))
    most = max(row.samples for row in rows)
    body = [
        "<h1>Error of light against time</h1>",
        f'<p class="soft">{told["percentage"]} % of the scenes\' resolution, 1 to {most} samples, '
        f"reference Cycles at {told['reference_samples']}. {page.esc(told['machine'])}.</p>",
        page.figure(folder, "light.png", "Both engines", "lower left is better"),
        page.table(
            ["scene", "to an RMSE of", "", "LeapRay, s", "Cycles, s", ""],
            [
                [page.esc(name), f"{error:.2g}", word, f"{a:.1f}", f"{b:.1f}", lead(a, b)]
                for name, word, error, a, b in leads(rows)
            ],
        ),
        page.table(
            ["scene", "engine", "samples", "seconds", "of that, volumes", "mean", "RMSE",
             "but rims", "FLIP", "but rims", "rims"],
            [
                [
                    page.esc(row.scene),
                    ENGINES[row.engine],
                    str(row.samples),
                    f"{row.seconds:.2f}",
                    f"{row.seconds_model:.2f}",
                    f"{row.mean_ratio:+.2%}",
                    *(f"{v:.4f}" for v in (row.rmse, row.rmse_but_rims, row.flip)),
                    f"{row.flip_but_rims:.4f}",
                    f"{row.rims_share:.1%}",
                ]
                for row in rows
            ],
        ),
        *(
            figure
            for name in names
            for figure in (
                f"<h2>{page.esc(name)}</h2>",
                '<div class="two">',
                page.figure(folder, f"{name}-leapray.png", "LeapRay", f"{most} samples"),
                page.figure(folder, f"{name}-reference.png", "Cycles", "the reference"),
                "</div>",
            )
        ),
        "<h2>What this is, and what it is not</h2>",
        "<p>One run each; other work on the machine shows. The reference is noisy, too, and has "
        "the same faults as Cycles' own frames: where LeapRay's line becomes level, what is left "
        "is the difference of the two engines, its volumes' included.</p>",
    ]  # fmt: skip
    (folder / "light.html").write_text(page.whole("Error of light against time", body), "utf-8")


def leads(rows: list[Row]) -> list[tuple[str, str, float, float, float]]:
    """Per scene and error that both reach: (scene, word for it, error, our seconds, Cycles')."""
    found = []
    for name in dict.fromkeys(row.scene for row in rows):
        ours, theirs = (of(rows, name, engine) for engine in ENGINES)
        for word, error in (
            ("coarse", max(ours[0].rmse, theirs[0].rmse) / 2),
            ("fine", max(ours[-1].rmse, theirs[-1].rmse) * 1.01),
        ):
            a, b = seconds_to(ours, error), seconds_to(theirs, error)
            if a is not None and b is not None:
                found.append((name, word, error, a, b))
    return found


def lead(ours: float, theirs: float) -> str:
    """Who leads, and how many times."""
    leader = "LeapRay" if ours < theirs else "Cycles"
    return f"{leader} leads {max(ours, theirs) / min(ours, theirs):.1f} times"
