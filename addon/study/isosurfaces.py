# SPDX-License-Identifier: GPL-3.0-or-later
"""Isosurfaces of measured data beside meshes of the same data, in accuracy and in speed.

Accuracy: a level set, a fog and whole numbers, each as an OpenVDB grid that LeapRay renders as it
is, and that OpenVDB's volumeToMesh turns into a mesh for Cycles. Speed: a scan of a head, from file
to image and again at another threshold, by LeapRay, by VTK's ray caster and by VTK's flying edges
with Cycles, in turns; without VTK (PyPI's `vtk`) LeapRay is alone.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from leapray import LeapRayError
from leapray.formats.vdb import openvdb_module

from . import charts, metrics, page
from .clouds import cloud
from .entries import spread
from .folder import study_folder, write_figures
from .options import chosen, number
from .scenes import write_head

STUDY = True

BAR_DEPTH, BAR_FAR = 0.1, 0.005  # voxels at 99 %; of the edge pixels, farther than a pixel
THRESHOLDS = -480.0, -300.0, -480.0  # Hounsfield units: of the skin, twice, and of fat
BAND = 3.0  # voxels of a level set to either side
WIDTH, HEIGHT = 1920, 1080


def add_arguments(parser: argparse.ArgumentParser) -> None:
    number(parser, "grid", "samples along a side of the grids that are meshed, too; 256", least=24)
    number(parser, "size", "samples along a side of the scan; 512", least=24)
    number(parser, "rounds", "medians are of so many; 3")


def main(args: argparse.Namespace) -> int:
    """Measure; writes the folder and returns the exit code."""
    side, size = chosen(args, "grid", 64, 256), chosen(args, "size", 128, 512)
    rounds = chosen(args, "rounds", 1, 3)
    with study_folder(args, "isosurfaces") as folder:
        rows, pictures = [], {}
        for kind, grid, threshold in grids(side):
            row, pictures[kind] = judge(kind, grid, threshold, folder)
            rows.append(row)
            print(f"isosurfaces: {kind}", file=sys.stderr, flush=True)
        runs = speed(folder, size, rounds)
        told = {"grid": side, "size": size, "rounds": rounds, "image": [WIDTH, HEIGHT]}
        told = write_figures(folder, "isosurfaces", told, rows=rows, runs=runs)
        draw(folder, runs, pictures)
        write_page(folder, told, rows, runs)
    return 0


# ---- beside meshes ---------------------------------------------------------


@dataclass(frozen=True)
class Row:
    """A grid. Depths are along the rays, in voxels, where both pictures see the surface."""

    grid: str
    threshold: float
    quads: int  # of the mesh, triangles included
    agreeing: int  # pixels
    depth_50: float
    depth_99: float
    depth_max: float
    perpendicular_99: float  # to the surface, instead of along the rays
    normal_99: float  # degrees
    edges: int  # pixels with another object beside them
    mismatch: int  # pixels that only one sees
    far: int  # of them more than a pixel from an edge
    far_share: float  # by edges


def grids(side: int) -> Iterator[tuple[str, Any, float]]:
    """Name, OpenVDB grid of about that many samples a side, and threshold; a voxel is a unit."""
    openvdb = openvdb_module()
    axis = np.arange(side) - (side - 1) / 2
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
    rings = distance_to_rings(x, y, z, side)
    kept = np.clip(rings, -BAND, BAND).astype(np.float32)
    level_set = openvdb.FloatGrid(BAND)
    level_set.copyFromArray(kept, tolerance=0.0)
    level_set.gridClass = openvdb.GridClass.LEVEL_SET
    yield "level set", level_set, 0.0
    fog = openvdb.FloatGrid(0.0)
    fog.copyFromArray(cloud(side))
    fog.gridClass = openvdb.GridClass.FOG_VOLUME
    yield "fog", fog, 0.35
    whole = openvdb.Int32Grid(0)
    wave = 2 * np.pi * 2.5 / side
    lumps = np.sin(wave * x) * np.cos(wave * y) + np.sin(wave * y) * np.cos(wave * z)
    ball = 0.45 * side - np.sqrt(x**2 + y**2 + z**2)
    numbers = 2000 / (1 + np.exp(-40 * ball / side) + np.exp(-0.4 - 4 * lumps))
    whole.copyFromArray(np.rint(numbers).astype(np.int32))
    yield "whole numbers", whole, 900.5


def distance_to_rings(x: NDArray, y: NDArray, z: NDArray, side: int) -> NDArray[np.float64]:
    """The distance to two linked tori, negative inside."""
    large, small = 0.24 * side, 0.075 * side
    one = np.hypot(np.hypot(x + large / 2, y) - large, z) - small
    other = np.hypot(np.hypot(x - large / 2, z) - large, y) - small
    return np.minimum(one, other)


def judge(kind: str, grid, threshold: float, folder: Path) -> tuple[Row, NDArray[np.uint8]]:
    """The figures of a grid, and a picture of its errors."""
    import bpy

    from ..blender import data_scene
    from . import frames, isosurface_runs

    path = folder / "grid.vdb"
    grid.name = "density"
    openvdb_module().write(str(path), grid)
    scene = data_scene.make(path, threshold)
    data = isosurface_runs.data_object()
    frames.prepare(scene, volumes=True)
    frames.blacken_world(scene)
    data.pass_index = 1
    got = frames.render_leapray(scene, folder / "frame.exr", 1, scene.leapray.traverser)
    points, triangles, quads = grid.convertToPolygons(isovalue=threshold, adaptivity=0.0)
    faces = np.concatenate([triangles, quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    mesh = bpy.data.objects.new("Mesh", isosurface_runs.mesh_of(points, faces))
    mesh.matrix_world, mesh.pass_index = data.matrix_world, 1
    scene.collection.objects.link(mesh)
    data.hide_render = True
    want = frames.render_cycles(scene, folder / "frame.exr", 1)
    voxel = float(data.matrix_world.to_scale()[0])
    view = frames.view(scene, bpy.context.evaluated_depsgraph_get())
    path.unlink()
    (folder / "frame.exr").unlink()
    return compared(kind, threshold, len(quads) + len(triangles), want, got, view, voxel)


def compared(
    kind: str, threshold: float, quads: int, want, got, view: metrics.View, voxel: float
) -> tuple[Row, NDArray[np.uint8]]:
    """Figures and picture of two frames of one object."""
    both = (want.index == 1) & (got.index == 1)
    if not both.any():
        raise LeapRayError(f"the pictures of the {kind} show nothing that is the same")
    direction, along = view.rays(want.passes["Position"])
    off = np.abs(want.passes["Depth"].astype(np.float64) - got.passes["Depth"]) * along / voxel
    facing = np.abs((want.passes["Normal"] * direction).sum(axis=-1))
    turned = metrics.angle(want.passes["Normal"], got.passes["Normal"])
    told = metrics.index_mismatch(want.index, got.index)
    edges, differ = told["n_edge_pixels"], told["all"]
    depth_50, depth_99, depth_max = np.percentile(off[both], (50, 99, 100))
    row = Row(
        kind,
        threshold,
        quads,
        int(both.sum()),
        float(depth_50),
        float(depth_99),
        float(depth_max),
        float(np.percentile((off * facing)[both], 99)),
        float(np.percentile(turned[both], 99)),
        edges,
        differ["n"],
        differ["n_beyond_edges"],
        differ["n_beyond_edges"] / max(edges, 1),
    )
    shown = np.where(both, off, np.nan)
    return row, charts.errors(shown, BAR_DEPTH, want.index != got.index)


# ---- speed -----------------------------------------------------------------


@dataclass(frozen=True)
class Run:
    """A program at one step of the work."""

    by: str
    step: str  # "file to image" | "another threshold"
    seconds: float  # median
    least: float
    most: float
    nbytes: int  # the most memory that it took, beside the file's own


def speed(folder: Path, size: int, rounds: int) -> list[Run]:
    """Rows of the programs that are here, on a head of size^3 samples of 16 bits."""
    from . import isosurface_runs

    path = folder / "head.nii"
    write_head(path, size)
    has_vtk = importlib.util.find_spec("vtkmodules") is not None
    if not has_vtk:
        print("isosurfaces: no vtk here, so no other program", file=sys.stderr)
    programs = list(isosurface_runs.PROGRAMS)[: None if has_vtk else 1]
    taken: dict[str, list[list[dict]]] = {by: [] for by in programs}
    for turn in range(rounds):
        for by in programs:
            taken[by].append(run(by, path, folder / f"by-{programs.index(by)}.png"))
            print(f"isosurfaces: {by}, round {turn + 1}", file=sys.stderr, flush=True)
    path.unlink()
    return [row for by in programs for row in summary(by, taken[by])]


def run(by: str, path: Path, out: Path) -> list[dict]:
    """What a process of its own says of each threshold."""
    words = [by, str(path), str(out), str(WIDTH), str(HEIGHT), "--", *map(str, THRESHOLDS)]
    command = [sys.executable, "-m", f"{__package__}.isosurface_runs", *words]
    done = subprocess.run(command, capture_output=True, text=True)
    lines = [line for line in done.stdout.splitlines() if line.startswith("{")]
    if len(lines) < len(THRESHOLDS):
        last = (done.stderr.strip().splitlines() or ["it says nothing"])[-1]
        raise LeapRayError(f"{by} did not render the scan: {last}")
    return [json.loads(line) for line in lines]


def summary(by: str, rounds: list[list[dict]]) -> list[Run]:
    """First thresholds apart from the others."""
    steps = {"file to image": slice(0, 1), "another threshold": slice(1, None)}
    found = []
    for step, which in steps.items():
        seconds = [each["seconds"] for told in rounds for each in told[which]]
        nbytes = max(each["nbytes"] for told in rounds for each in told[which])
        found.append(Run(by, step, *spread(seconds), nbytes))
    return found


# ---- telling ---------------------------------------------------------------


def draw(folder: Path, runs: list[Run], pictures: dict[str, NDArray[np.uint8]]) -> None:
    """Seconds of the programs, and where the depths differ."""
    steps = list(dict.fromkeys(each.step for each in runs))
    with charts.chart(folder / "isosurfaces", columns=len(steps), width=5.2, height=2.6) as (
        _,
        axes,
    ):
        for axis, step in zip(axes[0], steps, strict=True):
            group = [each for each in runs if each.step == step]
            charts.bars(axis, [each.by for each in group], [each.seconds for each in group])
            axis.set_title(f"{step}, seconds", fontsize=10.5)
    for kind, image in pictures.items():
        name = kind.replace(" ", "-")
        (folder / f"errors-{name}.png").write_bytes(charts.png(image))


def write_page(folder: Path, told: dict, rows: list[Row], runs: list[Run]) -> None:
    """isosurfaces.html: the figures with what they say."""
    body = [
        "<h1>Surfaces of measured data</h1>",
        f'<p class="soft">Grids of {told["grid"]}³ samples beside OpenVDB\'s meshes of them in '
        f"Cycles; a head of {told['size']}³ samples of 16 bits at {WIDTH} x {HEIGHT} pixels, one "
        f"sample, one sun; medians of {told['rounds']} rounds in turns. "
        f"{page.esc(told['machine'])}.</p>",
        page.findings([*sentences(rows), *speeds(runs)]),
        page.figure(folder, "isosurfaces.png", "From a scan to a picture", "lower is better"),
        page.table(
            ["by", "step", "seconds", "least", "most", "MB beside the file"],
            [
                [
                    page.esc(each.by),
                    each.step,
                    f"{each.seconds:.2f}",
                    f"{each.least:.2f}",
                    f"{each.most:.2f}",
                    f"{each.nbytes / 2**20:.0f}",
                ]
                for each in runs
            ],
        ),
        page.table(
            ["grid", "faces", "pixels", "depth 50 %, voxels", "99 %", "most",
             "perpendicular 99 %", "normals 99 %, degrees", "edge pixels", "seen by one",
             "beyond a pixel"],
            [
                [
                    row.grid,
                    f"{row.quads:,}",
                    f"{row.agreeing:,}",
                    f"{row.depth_50:.4f}",
                    f"{row.depth_99:.3f}",
                    f"{row.depth_max:.3g}",
                    f"{row.perpendicular_99:.3f}",
                    f"{row.normal_99:.2f}",
                    f"{row.edges:,}",
                    str(row.mismatch),
                    f"{row.far} ({row.far_share:.2%})",
                ]
                for row in rows
            ],
        ),
        "<h2>Where depths differ</h2>",
        *(
            page.figure(folder, f"errors-{row.grid.replace(' ', '-')}.png", row.grid,
                        f"black to yellow: 0 to {BAR_DEPTH:g} voxels and more; cyan: seen by one")
            for row in rows
        ),
        "<h2>What this is, and what it is not</h2>",
        "<p>A mesh of volumeToMesh has one vertex in each cell that the surface crosses, at the "
        "mean of where it crosses the cell's edges; LeapRay's surface is that of the "
        "interpolated field. The largest differences are where the surface hides a part of "
        "itself. VTK's ray caster has no shadows and takes a value every half sample; its "
        "opacity is a step at the threshold.</p>",
    ]  # fmt: skip
    (folder / "isosurfaces.html").write_text(page.whole("Surfaces of data", body), "utf-8")


def sentences(rows: list[Row]) -> list[str]:
    """On the accuracy, computed from the figures."""
    return [
        f"{row.grid}: {row.depth_99:.3f} voxels at 99 %, {row.far_share:.2%} of the edge pixels "
        f"differ beyond a pixel: "
        f"{'within' if row.depth_99 <= BAR_DEPTH and row.far_share <= BAR_FAR else 'outside of'} "
        f"what is asked for."
        for row in rows
    ]


def speeds(runs: list[Run]) -> list[str]:
    """On the speed, likewise."""
    ours = {each.step: each.seconds for each in runs if each.by == "LeapRay"}
    return [
        f"{each.step}: {each.by} takes {each.seconds / ours[each.step]:.2f} times LeapRay's "
        f"{ours[each.step]:.2f} s."
        for each in runs
        if each.by != "LeapRay"
    ]
