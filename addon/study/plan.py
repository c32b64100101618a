# SPDX-License-Identifier: GPL-3.0-or-later
"""What the plan saves: one voxel size for a whole scene against planned voxel sizes.

The same scene is modelled with one size of voxels in the world, from coarse to as fine as memory
allows, and by the plan at several permitted errors; store, traverser and kinds of volumes are the
same. Errors are those of the picture against Embree on the meshes: perpendicular, in footprints.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from .. import model, pipeline
from ..plan import plan as planning
from ..plan.objects import SceneError
from . import charts, page, scenes
from .folder import study_folder, write_figures
from .options import chosen, number

STUDY = True

HALVINGS = 12  # of the coarsest voxel, which is a sixteenth of the scene
PIXEL_ERRORS = (1.0, 0.5, 0.25, 0.125, 0.0625, 0.03125, 0.015625)
KINDS = {"uniform": "one voxel size", "plan": "the plan"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--scene", type=Path, metavar="SCENE.blend", help="; gallery.blend")
    number(parser, "percentage", "of the scene's resolution; 100")
    number(parser, "memory", "megabytes that one model may take; 4096")


def main(args: argparse.Namespace) -> int:
    """Measure; writes the folder and returns the exit code."""
    path = getattr(args, "scene", None) or scenes.sample("gallery")
    percentage = chosen(args, "percentage", 40, 100)
    memory = chosen(args, "memory", 256, 4096)
    with study_folder(args, "plan") as folder:
        scene = scenes.read(path, percentage)
        scene = replace(scene, settings=replace(scene.settings, memory_mb=memory))
        rows = measure(scene)
        told = {"scene": path.name, "percentage": percentage, "memory_mb": memory}
        told = write_figures(folder, "plan", told, rows=rows)
        draw(folder, rows)
        write_page(folder, told, rows)
    return 0


# ---- measuring -----------------------------------------------------------


@dataclass(frozen=True)
class Row:
    """A model of the scene, and its picture."""

    kind: str  # of KINDS
    asked: float  # uniform: the voxel in world units; plan: the permitted error
    error_50: float  # perpendicular, footprints
    error_99: float
    mismatch_share: float  # pixels that see another object, by edge pixels
    far: int  # of them beyond a pixel from an edge
    volumes: int
    volume_bytes: int
    structure_bytes: int
    seconds: float  # of the model
    seconds_trace: float

    @property
    def bytes(self) -> int:
        return self.volume_bytes + self.structure_bytes


def uniform(size: float) -> type[planning.Planner]:
    """A planner that gives voxels of one size in the world to all, whatever the error."""

    class Uniform(planning.Planner):
        def first_size(self, work) -> float:
            return size / max(np.linalg.norm(m[:3, :3], axis=0).max() for m in work.matrices)

        def may_choose_cells(self, work) -> bool:
            return False  # else small meshes have no voxels at all, but for their triangles

        def improve(self) -> None:
            pass

    return Uniform


def measure(scene: model.Scene) -> list[Row]:
    """Uniform models until memory ends, then planned ones."""
    want, rows = scenes.truth(scene), []
    size = extent(scene) / 16
    for _ in range(HALVINGS):
        try:
            rows.append(judge("uniform", size, scene, want, planner=uniform(size)))
        except SceneError:  # too little memory
            break
        size /= 2
    for error in PIXEL_ERRORS:
        settings = replace(scene.settings, pixel_error=error)
        rows.append(judge("plan", error, replace(scene, settings=settings), want))
    return rows


def extent(scene: model.Scene) -> float:
    """The longest side of the scene's box."""
    corners = [
        scene.meshes[each.mesh].vertices @ each.world_from_object[:3, :3].T
        + each.world_from_object[:3, 3]
        for each in scene.instances
    ]
    low = np.min([points.min(axis=0) for points in corners], axis=0)
    high = np.max([points.max(axis=0) for points in corners], axis=0)
    return float((high - low).max())


def judge(kind: str, asked: float, scene: model.Scene, want: scenes.Truth, **how) -> Row:
    frame = pipeline.render(scene, **how)
    found = scenes.difference(scene, want, frame.passes)
    seconds, held = frame.report["seconds"], frame.report["bytes"]
    row = Row(
        kind,
        asked,
        found.error_50,
        found.error_99,
        found.mismatch_share,
        found.far,
        len(frame.report["volumes"]),
        held["volumes"],
        held["structures"],
        seconds["voxelize"] + seconds["structure"] + seconds["plan"],
        seconds["trace"],
    )
    print(f"plan: {KINDS[kind]}, {asked:.4g}: {row.bytes / 2**20:.1f} MB, {row.error_99:.3f}",
          file=sys.stderr, flush=True)  # fmt: skip
    return row


# ---- telling -------------------------------------------------------------


def best(rows: list[Row], of: str) -> tuple[Row, Row | None]:
    """The uniform model of the least error, and the cheapest planned one that is no worse."""
    finest = min((row for row in rows if row.kind == "uniform"), key=lambda r: getattr(r, of))
    reached = [
        row for row in rows if row.kind == "plan" and getattr(row, of) <= getattr(finest, of)
    ]
    return finest, min(reached, key=lambda row: row.bytes, default=None)


def draw(folder: Path, rows: list[Row]) -> None:
    """Error of points and of silhouettes by bytes and by seconds."""
    with charts.chart(folder / "plan", rows=2, columns=2, width=5.4, height=3.6) as (_, axes):
        for (y, x), axis in np.ndenumerate(axes):
            what = ("error_99", "mismatch_share")[y]
            for k, (kind, label) in enumerate(KINDS.items()):
                found = [row for row in rows if row.kind == kind]
                across = [row.bytes / 2**20 if x == 0 else row.seconds for row in found]
                scale = 1 if y == 0 else 100
                axis.plot(across, [scale * getattr(row, what) for row in found],
                          label=label, **charts.look(k))  # fmt: skip
            axis.set_xscale("log")
            axis.set_yscale("log")
            axis.set_xlabel("megabytes of volumes and structures" if x == 0 else "seconds to model")
            title = ("perpendicular error at 99 %, footprints", "silhouettes, per cent of edges")[y]
            axis.set_title(title, fontsize=10.5)
        axes[0, 0].legend()


def write_page(folder: Path, told: dict, rows: list[Row]) -> None:
    """plan.html: the charts with what they say."""
    body = [
        "<h1>What the plan saves</h1>",
        f'<p class="soft">{page.esc(told["scene"])} at {told["percentage"]} % of its resolution; '
        f"{page.esc(told['machine'])}.</p>",
        page.figure(folder, "plan.png", "Error by memory and by time", "lower left is better"),
        page.findings(sentences(rows)),
        page.table(
            ["model", "error 50 %", "99 %", "silhouettes", "beyond a pixel", "volumes",
             "MB of volumes", "of structures", "model, s", "trace, s"],
            [
                [
                    page.esc(named(row)),
                    f"{row.error_50:.4f}",
                    f"{row.error_99:.3f}",
                    f"{row.mismatch_share:.2%}",
                    *map(str, (row.far, row.volumes)),
                    f"{row.volume_bytes / 2**20:.2f}",
                    f"{row.structure_bytes / 2**20:.2f}",
                    f"{row.seconds:.2f}",
                    f"{row.seconds_trace:.2f}",
                ]
                for row in rows
            ],
        ),
        "<h2>What this is, and what it is not</h2>",
        "<p>With one voxel size, an object is modelled where its largest instance asks for it, as "
        "instances share volumes; both leave out instances that no ray can meet. Uniform sizes are "
        f"halved until a model would take more than {told['memory_mb']} MB. A small error of "
        "points counts little where silhouettes are wrong: what a coarse model loses altogether "
        "has no error of points. Seconds of the plan hold the levels that it tried and left.</p>",
    ]  # fmt: skip
    (folder / "plan.html").write_text(page.whole("What the plan saves", body), "utf-8")


def named(row: Row) -> str:
    word = f"voxels of {row.asked:.4g}" if row.kind == "uniform" else f"permitted {row.asked:g}"
    return f"{KINDS[row.kind]}, {word}"


def sentences(rows: list[Row]) -> list[str]:
    """Sentences computed from the figures."""
    said = []
    for of, words in (("error_99", "of points at 99 %"), ("mismatch_share", "of silhouettes")):
        finest, planned = best(rows, of)
        value = f"{getattr(finest, of):.3g}"
        size = f"{finest.bytes / 2**20:.1f} MB"
        said.append(
            f"The least error {words} with one voxel size is {value}, with {size}; the plan "
            f"reaches it with {planned.bytes / 2**20:.1f} MB, {finest.bytes / planned.bytes:.1f} "
            f"times less, and in {planned.seconds:.1f} seconds against {finest.seconds:.1f}."
            if planned
            else f"The least error {words} with one voxel size is {value}, with {size}; the plan "
            "reaches it with none of the errors that were permitted."
        )
    return said
