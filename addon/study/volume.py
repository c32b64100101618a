# SPDX-License-Identifier: GPL-3.0-or-later
"""Light through a volume without steps, beside samples at equal steps: error against time.

The phantom of a head with a transfer function that shows skin and bone, through a perspective
camera, one thread. Errors are those of drawn pixels against integrals in extended precision; the
time is that of the whole picture. The same samples are lit by one lamp without shadows, too, by
both kinds of normals; their errors are against close steps of that model. Leaping over what is
invisible, the traversers, and rays that end early are measured apart. Where PyPI's `vtk` is there,
VTK's ray caster on the CPU joins.

Source: Levoy 1988 (equal steps, classified before interpolation) and 1990 (leaping, and ends that
come early).
"""

from __future__ import annotations

import argparse
import importlib.util
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import leapray

from ..arrays import srgb
from . import charts, page
from .entries import default, first_of, label, seconds, spread
from .folder import study_folder, write_figures
from .options import chosen, number
from .volume_subject import Subject, head

STUDY = True

STEPS = (4.0, 2.0, 1.0, 0.5, 0.25)  # voxels
TOLERANCES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-6)
STOPS = (0.9, 0.99, 0.999)
SINGLE_STEPS, PYRAMID = "Amanatides", "Levoy 1990"  # the methods whose culling is compared
APART = 0.08  # logarithms of points of a chart that both have their number
STOP = 0.99  # where rays end in the comparison of what culling brings
COLUMNS = (
    *("setting", "seconds", "least", "most", "error, 90 %", "99 %", "largest", "over 1e-4"),
    *("cells", "pieces"),
)
TOO_FAR = 1e-4  # errors above it are counted
LAMP = leapray.Phong(0.3, 0.7, 0.0, 20, (0.6, 0.3, 0.8))  # VTK has one view for all highlights
NORMALS = "central", "analytic"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    number(parser, "size", "samples along a side; 256", least=24)
    number(parser, "image", "pixels across, by 9/16 of that; 1280", least=16)
    number(parser, "judged", "pixels whose errors are taken; 1000")
    number(parser, "rounds", "medians are of so many; 5")


def main(args: argparse.Namespace) -> int:
    """Measure; writes the folder and returns the exit code."""
    size, width = chosen(args, "size", 64, 256), chosen(args, "image", 160, 1280)
    judged, rounds = chosen(args, "judged", 100, 1000), chosen(args, "rounds", 2, 5)
    with study_folder(args, "volume") as folder:
        subject = Subject.of(head(folder, size), width, judged)
        print("volume: reference", file=sys.stderr, flush=True)
        truth = subject.reference()
        rows = measure(subject, truth, quality(), rounds)
        rows += measure(subject, truth, by_vtk(subject), rounds)
        lit = measure(
            subject, subject.lit_reference(LAMP), in_light(subject), rounds, subject.judged_lit
        )
        culling = measure(subject, truth, cullings(), max(rounds // 2, 1))
        modes = of_modes(subject, max(rounds // 2, 1))
        told: dict[str, Any] = {"size": size, "image": [width, subject.height], "judged": judged}
        told |= {"rounds": rounds}
        told = write_figures(
            folder, "volume", told, rows=rows, lit=lit, culling=culling, modes=modes
        )
        draw(folder, rows)
        show(folder, subject)
        write_page(folder, told, rows, lit, culling, modes)
    return 0


# ---- measuring -------------------------------------------------------------------


@dataclass(frozen=True)
class Way:
    """How to render."""

    name: str  # of the series
    number: float  # in it
    spec: str = field(default_factory=lambda: default().spec)
    leaps: bool = True
    sampling: str = "exact"
    step: float = 1.0  # voxels
    tolerance: float = 1e-4
    stop: float = 1.0
    phong: leapray.Phong | None = None
    normal: str = "central"

    def run(self, subject: Subject, *, count: bool = False) -> leapray.Hits:
        return leapray.trace(
            subject.structure(self.spec, self.leaps),
            subject.origins,
            subject.directions,
            mode="volume",
            sampling=self.sampling,
            step=self.step,
            tolerance=self.tolerance,
            stop_opacity=self.stop,
            phong=self.phong,
            normal=self.normal,
            count=count,
        )

    def picture(self, subject: Subject) -> NDArray[np.float64]:
        """(n, 4) colours and transmittances of all pixels."""
        hits = self.run(subject)
        return np.column_stack([hits.color, hits.transmittance])


@dataclass(frozen=True)
class Row:
    """A way to render, and what came of it."""

    name: str
    number: float
    traverser: str
    leaps: bool
    sampling: str
    stop_opacity: float
    seconds: float  # median, one thread
    least: float
    most: float
    error_90: float  # of a colour's channels, in 90 % of the judged pixels
    error_99: float
    error_max: float
    over: int  # judged pixels whose error is above TOO_FAR
    cells_per_ray: float  # visible ones that were looked at
    pieces_per_ray: float  # integrals, or samples


def quality() -> list[Way]:
    """The ways whose error is charted against their time."""
    ways = [Way("exact", each, tolerance=each) for each in TOLERANCES]
    ways += [Way("exact, ends early", each, stop=each) for each in STOPS]
    for sampling in ("post", "pre"):
        ways += [Way(f"steps, {sampling}", each, sampling=sampling, step=each) for each in STEPS]
        ways += [
            Way(f"steps, {sampling}, ends early", each, sampling=sampling, step=each, stop=STOP)
            for each in STEPS
        ]
    return ways


def cullings() -> list[Way]:
    """All cells or the visible ones, to the end or not, both samplings.

    Samples before interpolation go by the traverser's own walk. Integrals go by rays side by side,
    which leap by the masks of bricks, or by distances where the structure has them.
    """
    single, pyramid, distances = first_of(SINGLE_STEPS), first_of(PYRAMID), default()
    kinds = [("all cells", single, False, 1.0), ("all cells", single, False, STOP)]
    masks = [("visible cells by masks", single, True, stop) for stop in (1.0, STOP)]
    alone = [("visible cells one by one", single, True, 1.0)]
    alone += [(f"visible cells, {pyramid.label}", pyramid, True, stop) for stop in (1.0, STOP)]
    far = [("visible cells by distances", distances, True, stop) for stop in (1.0, STOP)]
    return [
        Way(f"{name}, to {stop:g}, {sampling}", number, entry.spec, leaps, sampling, stop=stop)
        for sampling, leaping in (("exact", masks), ("pre", alone))
        for number, (name, entry, leaps, stop) in enumerate([*kinds, *leaping, *far])
    ]


def measure(
    subject: Subject,
    truth: NDArray[np.float64],
    ways: Sequence[Any],
    rounds: int,
    judged: NDArray[np.int64] | None = None,
) -> list[Row]:
    """Rows of ways, all in turn. truth: of the pixels `judged`; None: of those of the subject."""
    judged = subject.judged if judged is None else judged
    pictures = [way.picture(subject)[judged] for way in ways]  # builds, too
    taken = seconds([partial(way.run, subject) for way in ways], rounds)
    rows = []
    for way, picture, took in zip(ways, pictures, taken.T, strict=True):
        off = np.abs(picture[:, :3] - truth[:, :3]).max(1)
        counted = way.run(subject, count=True) if isinstance(way, Way) else None
        told = {} if counted is None else counted.counters
        n = len(subject.origins)
        rows.append(
            Row(
                way.name,
                way.number,
                way.spec,
                way.leaps,
                way.sampling,
                way.stop,
                *spread(took),
                float(np.percentile(off, 90)),
                float(np.percentile(off, 99)),
                float(off.max()),
                int((off > TOO_FAR).sum()),
                told.get("cells", 0) / n,
                told.get("tests", 0) / n,
            )
        )
    print(f"volume: {', '.join(dict.fromkeys(way.name for way in ways))}", file=sys.stderr)
    return rows


def in_light(subject: Subject) -> list:
    """Samples that a lamp lights, and VTK's."""
    ours = [
        Way(
            f"lit, {normal}", step, sampling="post", step=step, stop=STOP, phong=LAMP, normal=normal
        )
        for normal in NORMALS
        for step in STEPS
    ]
    return [*ours, *by_vtk(subject, LAMP)]


def by_vtk(subject: Subject, phong: leapray.Phong | None = None) -> list:
    """VTK's ways, where it is installed."""
    if importlib.util.find_spec("vtkmodules") is None:
        print("volume: no vtk here, so no other program", file=sys.stderr)
        return []
    from .vtk_volumes import VtkRays

    return [VtkRays(subject, step, phong) for step in STEPS]


@dataclass(frozen=True)
class Leap:
    """What an exact traverser gains by leaving out invisible cells."""

    mode: str
    traverser: str
    label: str
    seconds: float  # median, visible cells alone
    seconds_all: float  # every cell
    equal: bool  # both to the bit; of modes in which all cells count it says nothing


def of_modes(subject: Subject, rounds: int) -> list[Leap]:
    """Every exact traverser in every mode, on every fourth pixel of both sides."""
    part = slice(None, None, 16)
    rays = subject.origins[part], subject.directions[part]
    found = []
    for mode in leapray.VISIBLE_MODES:
        for entry in leapray.traversers():
            if not entry.exact:
                continue
            both = [leapray.build(v, entry) for v in (subject.visible, subject.everything)]
            runs = [partial(leapray.trace, s, *rays, mode=mode, count=False) for s in both]
            one, other = (run() for run in runs)
            same = mode != "volume" or (
                np.array_equal(one.color, other.color)
                and np.array_equal(one.transmittance, other.transmittance)
            )
            times = np.median(seconds([*runs], rounds), axis=0)
            found.append(
                Leap(mode, entry.spec, label(entry), float(times[0]), float(times[1]), same)
            )
        print(f"volume: {mode}", file=sys.stderr, flush=True)
    return found


# ---- telling ---------------------------------------------------------------------


def series(rows: list[Row]) -> dict[str, list[Row]]:
    """The rows by their names."""
    return charts.grouped(rows, lambda row: row.name)


def draw(folder: Path, rows: list[Row]) -> None:
    """Error against seconds."""
    with charts.chart(folder / "volume", width=9.0, height=5.4) as (figure, axes):
        axis = axes[0, 0]
        for k, (name, found) in enumerate(series(rows).items()):
            x, y = [row.seconds for row in found], [max(row.error_99, 1e-12) for row in found]
            axis.plot(x, y, label=name, **charts.look(k))
            told = np.full(2, np.inf)
            for row, at in zip(found, zip(x, y, strict=True), strict=True):
                if np.abs(np.log(at) - told).max() > APART:  # else it would cover another's
                    told = np.log(at)
                    axis.annotate(
                        f"{row.number:g}", at, xytext=(5, 5), textcoords="offset points", fontsize=8
                    )
        axis.set_xscale("log")
        axis.set_yscale("log")
        axis.set_xlabel("seconds of one thread")
        axis.set_ylabel("error of a colour in 99 % of the pixels")
        figure.legend(*axis.get_legend_handles_labels(), loc="outside lower center", ncols=4)
        charts.plain_ticks(axis)
        axis.set_yscale("log")


def show(folder: Path, subject: Subject) -> None:
    """The picture itself."""
    shown = Way("exact", 0.0).picture(subject)[:, :3]
    image = charts.as_bytes(srgb(shown.reshape(subject.height, subject.width, 3)))
    (folder / "picture.png").write_bytes(charts.png(image))


def write_page(
    folder: Path,
    told: dict,
    rows: list[Row],
    lit: list[Row],
    culling: list[Row],
    modes: list[Leap],
) -> None:
    """volume.html: the charts and figures with what they say."""
    size, (width, height) = told["size"], told["image"]
    body = [
        "<h1>Light through a volume</h1>",
        f'<p class="soft">A head of {size}³ samples, skin and bone, {width} x {height} pixels, one '
        f"thread, median of {told['rounds']} rounds in turns; errors of {told['judged']} pixels "
        f"against integrals of 80 bits. {page.esc(told['machine'])}.</p>",
        page.figure(folder, "picture.png", "The picture", "exact, before black"),
        page.figure(
            folder,
            "volume.png",
            "Error against time",
            "numbers: tolerance, step in voxels, or the opacity at which rays end",
        ),
        page.findings([*sentences(rows), *gains(culling)]),
        figures(rows),
        "<h2>Lit by the gradient</h2>",
        '<p class="soft">Ambient and diffuse light of one lamp without shadows, against close '
        "steps with normals of central differences.</p>",
        figures(lit),
        "<h2>What leaping over invisible cells and ending early bring</h2>",
        page.table(
            ["", "seconds", "times as fast", "error, 99 %"],
            [
                [
                    page.esc(row.name),
                    f"{row.seconds:.3f}",
                    f"{first(culling, row).seconds / row.seconds:.1f}",
                    f"{row.error_99:.2g}",
                ]
                for row in culling
            ],
        ),
        "<h2>Every exact traverser</h2>",
        '<p class="soft">Milliseconds through visible cells, through all cells, and how many times '
        "as fast that is. In the mode volume both give the same bits: "
        f"{'so here' if all(leap.equal for leap in modes) else 'NOT SO HERE'}.</p>",
        page.table(
            ["", *(title for mode in leapray.VISIBLE_MODES for title in (mode, "all", "times"))],
            [[page.esc(name), *cells] for name, cells in by_traverser(modes).items()],
        ),
    ]
    (folder / "volume.html").write_text(page.whole("Light through a volume", body), "utf-8")


def figures(rows: list[Row]) -> str:
    """A table of ways."""
    return page.table(
        ["", *COLUMNS],
        [
            [
                page.esc(row.name),
                f"{row.number:g}",
                f"{row.seconds:.3f}",
                f"{row.least:.3f}",
                f"{row.most:.3f}",
                f"{row.error_90:.2g}",
                f"{row.error_99:.2g}",
                f"{row.error_max:.2g}",
                f"{row.over}",
                f"{row.cells_per_ray:.1f}",
                f"{row.pieces_per_ray:.1f}",
            ]
            for row in rows
        ],
    )


def first(rows: list[Row], row: Row) -> Row:
    """The slowest way of a row's sampling: all cells, to the end."""
    return next(each for each in rows if each.sampling == row.sampling)


def by_traverser(modes: list[Leap]) -> dict[str, list[str]]:
    """The figures of all modes by the traverser's label."""
    found: dict[str, list[str]] = {}
    for leap in modes:
        times = 1e3 * leap.seconds, 1e3 * leap.seconds_all, leap.seconds_all / leap.seconds
        found.setdefault(leap.label, []).extend(f"{value:.1f}" for value in times)
    return found


def sentences(rows: list[Row]) -> list[str]:
    """Who reaches the accuracy of whom, computed from the figures."""
    exact = next(row for row in rows if row.name == "exact" and row.number == 1e-4)
    said = [
        f"Exact, at the default tolerance, the picture takes {exact.seconds:.3g} s; the largest "
        f"error is {exact.error_max:.1e}."
    ]
    ours = [row for row in rows if row.name.startswith("exact")]
    for name, found in series(rows).items():
        if name.startswith("exact"):
            continue
        best = min(found, key=lambda row: row.error_99)
        as_good = [row for row in ours if row.error_99 <= best.error_99]
        if not as_good:
            said.append(f"{name}: no exact picture is as good as its best.")
            continue
        fastest = min(as_good, key=lambda row: row.seconds)
        said.append(
            f"{name}: the least error is {best.error_99:.2g}, at {best.number:g} voxels in "
            f"{best.seconds:.3g} s; exact integrals are as good in {fastest.seconds:.3g} s, "
            f"{best.seconds / fastest.seconds:.2f} times as fast."
        )
    return said


def gains(rows: list[Row]) -> list[str]:
    """What Levoy's accelerations bring together."""
    said = []
    for sampling in dict.fromkeys(row.sampling for row in rows):
        slowest, *_ = found = [row for row in rows if row.sampling == sampling]
        said += [
            f"{row.name}: {slowest.seconds / row.seconds:.1f} times as fast as {slowest.name}."
            for row in found
            if row.leaps and row.stop_opacity < 1
        ]
    return said
