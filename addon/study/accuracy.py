# SPDX-License-Identifier: GPL-3.0-or-later
"""Speed against accuracy: the time and the error of each setting.

Shapes whose surface is known (sphere, torus, thin rods, a turned box) are sampled, a knot's mesh
is voxelized, and rays from all around are traced with many settings. Truth is marching by the
shape's exact distance, and Embree for the mesh. One factor at a time is varied around the
defaults at every resolution; hit test, root, normal and sample type are crossed at two.
"""

from __future__ import annotations

import argparse
import itertools
import sys
import time
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import leapray
from leapray.arrays import SAMPLE_TYPES

from ..arrays import unit
from . import charts, embree, entries, page, shapes
from .folder import study_folder, write_figures
from .options import chosen, number, numbers

STUDY = True

SEED = 1994
SIDE = 2.2  # of the lattice's cube
LEAST = 1e-5  # stands for 0 on a logarithmic scale


def add_arguments(parser: argparse.ArgumentParser) -> None:
    number(parser, "rays", "per setting and scene; 40,000")
    numbers(parser, "sizes", "samples along a side; 32 64 128 256 512", least=8)
    numbers(parser, "crossed", "those of the sizes at which all choices are crossed; 64 256")


def main(args: argparse.Namespace) -> int:
    """Measure; writes the folder and returns the exit code."""
    count = chosen(args, "rays", 4000, 40_000)
    sizes = chosen(args, "sizes", (32, 64, 96), (32, 64, 128, 256, 512))
    crossed = chosen(args, "crossed", (64,), (64, 256))
    rounds = chosen(args, "rounds", 2, 3)
    with study_folder(args, "accuracy") as folder:
        rows = []
        for scene in scenes(count):
            for size in sizes:
                rows += measure(scene, size, size in crossed, rounds)
            print(f"accuracy: {scene.name}", file=sys.stderr, flush=True)
        points = means(rows)
        told = {"rays": count, "sizes": sizes, "crossed": crossed}
        told["front"] = [asdict(point) for point in front(points, "hit_99")]
        told = write_figures(folder, "accuracy", told, rows=rows)
        draw(folder, points, rows)
        write_page(folder, told, points)
    return 0


# ---- scenes --------------------------------------------------------------


@dataclass(frozen=True)
class Scene:
    """Rays with unit directions, and their true hits."""

    name: str
    shape: shapes.Shape | None  # None: the knot's mesh
    origins: NDArray
    directions: NDArray
    t: NDArray  # infinity on a miss
    normal: NDArray


def scenes(count: int) -> list[Scene]:
    """All scenes; without Embree (`embreex`), the mesh is left out."""
    found = []
    for shape in (shapes.sphere(), shapes.torus(), shapes.rods(), shapes.box()):
        origins, directions = rays(count)
        t = shape.first_hit(origins, directions)
        points = origins + np.where(np.isfinite(t), t, 0.0)[:, None] * directions
        found.append(Scene(shape.name, shape, origins, directions, t, shape.normal(points)))
    origins, directions = rays(count)
    try:
        t, normal, _ = embree.first_hits(*shapes.knot(), origins, directions)
    except ModuleNotFoundError:
        print("accuracy: no embreex here, so no mesh", file=sys.stderr)
        return found
    return [*found, Scene("knot (mesh)", None, origins, directions, t, normal)]


def rays(count: int) -> tuple[NDArray, NDArray]:
    """Parallel rays of a film that is turned to eight sides, in f32 so that Embree has the same."""
    random = np.random.default_rng(SEED)
    directions = np.repeat(random.normal(size=(8, 3)), -(-count // 8), axis=0)[:count]
    directions = unit(directions)
    across = unit(np.cross(directions, (0.3, 0.5, 0.8)))
    film = random.uniform(-1, 1, (count, 2))
    origins = film[:, :1] * across + film[:, 1:] * np.cross(directions, across) - 3 * directions
    origins, directions = (part.astype(np.float32).astype(float) for part in (origins, directions))
    return origins, directions


def sampled(scene: Scene, size: int, dtype: str) -> leapray.Volume:
    """The scene's volume: size samples along the cube."""
    if scene.shape is None:
        return leapray.voxelize(*shapes.knot(), SIDE / (size - 1), dtype=dtype)
    samples, matrix = scene.shape.samples(size, dtype)
    return leapray.Volume(samples, object_from_index=matrix)


# ---- measuring -----------------------------------------------------------


@dataclass(frozen=True)
class Setting:
    """What is chosen; the defaults of everything."""

    traverser: str
    hit_test: str
    root: str
    normal: str
    dtype: str
    size: int


@dataclass(frozen=True)
class Row:
    """A setting in a scene. Errors of points are in thousandths of the cube's side."""

    scene: str
    traverser: str
    hit_test: str
    root: str
    normal: str
    dtype: str
    size: int
    mrays: float  # millions of rays a second, one thread
    hit_50: float  # from the true hit along the true normal, on rays that both hit
    hit_99: float
    normal_mean: float  # degrees
    normal_99: float
    silhouette: float  # rays on which truth and volume disagree, by those that truly hit
    structure_bytes: int


def default(size: int) -> Setting:
    return Setting(
        leapray.traverser().spec,
        next(iter(leapray.HIT_TESTS)),
        next(iter(leapray.ROOTS)),
        next(iter(leapray.NORMALS)),
        "u16",
        size,
    )


def settings(size: int, crossed: bool) -> list[Setting]:
    """One factor at a time around the default, and all but the traverser crossed if asked."""
    base = default(size)
    pairs = entries.hit_tests()
    found = [base]
    found += [replace(base, traverser=entry.spec) for entry in leapray.variants()]
    found += [replace(base, hit_test=test, root=root) for test, root in pairs]
    found += [replace(base, normal=normal) for normal in leapray.NORMALS]
    found += [replace(base, dtype=dtype) for dtype in SAMPLE_TYPES]
    if crossed:
        found += [
            replace(base, hit_test=test, root=root, normal=normal, dtype=dtype)
            for (test, root), normal, dtype in itertools.product(
                pairs, leapray.NORMALS, SAMPLE_TYPES
            )
        ]
    return list(dict.fromkeys(found))


def measure(scene: Scene, size: int, crossed: bool, rounds: int) -> list[Row]:
    rows = []
    chosen = sorted(settings(size, crossed), key=lambda s: (s.dtype, s.traverser))
    for dtype, of_type in itertools.groupby(chosen, key=lambda s: s.dtype):
        volume = sampled(scene, size, dtype)
        for spec, group in itertools.groupby(of_type, key=lambda s: s.traverser):
            structure = leapray.build(volume, spec)
            rows += [judge(scene, structure, setting, rounds) for setting in group]
    return rows


def judge(scene: Scene, structure: leapray.Structure, setting: Setting, rounds: int) -> Row:
    took = []
    for _ in range(rounds):
        began = time.process_time()
        hits = leapray.trace(
            structure,
            scene.origins,
            scene.directions,
            hit_test=setting.hit_test,
            root=setting.root,
            normal=setting.normal,
            count=False,
        )
        took.append(time.process_time() - began)
    real, got = np.isfinite(scene.t), np.isfinite(hits.t)
    both = real & got
    slant = np.abs((scene.directions * scene.normal).sum(axis=1))[both]
    if scene.shape is None:
        off = np.abs(hits.t[both] - scene.t[both]) * slant
    else:
        points = scene.origins[both] + hits.t[both, None] * scene.directions[both]
        off = np.abs(scene.shape.distance(points))
    turned = np.clip((hits.normal[both] * scene.normal[both]).sum(axis=1), -1, 1)
    angle = np.degrees(np.arccos(turned))
    fraction = np.count_nonzero(real != got) / max(np.count_nonzero(real), 1)
    off, angle = (part if len(part) else np.zeros(1) for part in (off, angle))
    return Row(
        scene.name,
        **asdict(setting),
        mrays=len(scene.t) / max(min(took), 1e-9) / 1e6,
        hit_50=1e3 * float(np.median(off)) / SIDE,
        hit_99=1e3 * float(np.percentile(off, 99)) / SIDE,
        normal_mean=float(angle.mean()),
        normal_99=float(np.percentile(angle, 99)),
        silhouette=fraction,
        structure_bytes=structure.nbytes,
    )


@dataclass(frozen=True)
class Point:
    """A setting over all scenes: geometric means, but for silhouettes, which are a mean."""

    setting: Setting
    mrays: float
    hit_99: float
    normal_mean: float
    silhouette: float


def means(rows: list[Row]) -> list[Point]:
    by_setting: dict[Setting, list[Row]] = {}
    for row in rows:
        setting = Setting(*(getattr(row, field.name) for field in fields(Setting)))
        by_setting.setdefault(setting, []).append(row)
    return [
        Point(
            setting,
            geometric(found, "mrays"),
            geometric(found, "hit_99"),
            geometric(found, "normal_mean"),
            float(np.mean([row.silhouette for row in found])),
        )
        for setting, found in by_setting.items()
    ]


def geometric(rows: list[Row], key: str) -> float:
    return float(np.exp(np.mean([np.log(max(getattr(row, key), LEAST)) for row in rows])))


def front(points: list[Point], key: str) -> list[Point]:
    """Those that no other point beats in speed and error both (Pareto), from fast to slow."""
    found: list[Point] = []
    for point in sorted(points, key=lambda p: (-p.mrays, getattr(p, key))):
        if not found or getattr(point, key) < getattr(found[-1], key):
            found.append(point)
    return found


# ---- telling -------------------------------------------------------------


KINDS = (
    ("hit_99", "point: 99 %, thousandths of the side"),
    ("normal_mean", "normal: mean, degrees"),
    ("silhouette", "silhouette: wrong rays by hits"),
)


def draw(folder: Path, points: list[Point], rows: list[Row]) -> None:
    """All settings, then the defaults of each scene by resolution."""
    sizes = sorted({point.setting.size for point in points})
    tests = list(leapray.HIT_TESTS)
    with charts.chart(folder / "accuracy", columns=3, width=5.2, height=5.0) as (_, axes):
        for axis, (key, title) in zip(axes[0], KINDS, strict=True):
            for s, test in itertools.product(range(len(sizes)), range(len(tests))):
                here = [
                    p
                    for p in points
                    if p.setting.size == sizes[s] and p.setting.hit_test == tests[test]
                ]
                axis.scatter(
                    [p.mrays for p in here],
                    [max(getattr(p, key), LEAST) for p in here],
                    s=16,
                    alpha=0.6,
                    lw=0,
                    color=charts.COLORS[s],
                    marker=charts.MARKERS[test],
                )
            best = front(points, key)
            axis.plot(
                [p.mrays for p in best],
                [max(getattr(p, key), LEAST) for p in best],
                color=charts.INK,
                lw=1.0,
                drawstyle="steps-pre",
            )
            axis.set_xscale("log")
            axis.set_yscale("log")
            charts.plain_ticks(axis)
            axis.set_xlabel("million rays a second, one thread")
            axis.set_title(title, fontsize=10.5)
        by_size = [axes[0, 2].scatter([], [], color=charts.COLORS[s]) for s in range(len(sizes))]
        by_test = [
            axes[0, 2].scatter([], [], color=charts.INK, marker=charts.MARKERS[test])
            for test in range(len(tests))
        ]
        for handles, labels, title, y in (
            (by_size, sizes, "samples: colour", 1.0),
            (by_test, tests, "hit test: shape", 0.5),
        ):
            place = {"loc": "upper left", "bbox_to_anchor": (1.0, y)}
            legend = axes[0, 2].legend(handles, labels, title=title, fontsize=9, **place)
            axes[0, 2].add_artist(legend)
    names = list(dict.fromkeys(row.scene for row in rows))
    with charts.chart(folder / "resolution", columns=3, width=4.8) as (_, axes):
        for axis, (key, title) in zip(axes[0], KINDS, strict=True):
            for k, name in enumerate(names):
                base = [
                    r
                    for size in sizes
                    for r in rows
                    if r.scene == name and is_setting(r, default(size))
                ]
                values = [max(getattr(r, key), LEAST) for r in base]
                axis.plot([r.size for r in base], values, label=name, **charts.look(k))
            axis.set_xscale("log", base=2)
            axis.set_yscale("log")
            axis.set_xticks(sizes, [str(size) for size in sizes])
            axis.set_title(title, fontsize=10.5)
            axis.set_xlabel("samples along the side")
        axes[0, 0].legend(fontsize=9)


def is_setting(row: Row, setting: Setting) -> bool:
    return all(getattr(row, key) == value for key, value in asdict(setting).items())


def write_page(folder: Path, told: dict, points: list[Point]) -> None:
    """accuracy.html: the charts with what they say."""
    best = front(points, "hit_99")
    body = [
        "<h1>Speed against accuracy</h1>",
        f'<p class="soft">{len(points)} settings in five scenes, {told["rays"]} rays each, one '
        f"thread. {page.esc(told['machine'])}.</p>",
        page.figure(folder, "accuracy.png", "All settings", "the line: what nothing beats"),
        page.findings(sentences(points)),
        page.figure(folder, "resolution.png", "Resolution", "all else at its default"),
        "<h2>The front, by the error of points</h2>",
        page.table(
            ["setting", "Mrays/s", "point 99 %, ‰", "normal, °", "silhouette"],
            [
                [
                    page.esc(told_setting(point.setting)),
                    f"{point.mrays:.2f}",
                    f"{point.hit_99:.3f}",
                    f"{point.normal_mean:.2f}",
                    f"{point.silhouette:.4f}",
                ]
                for point in best
            ],
        ),
        "<h2>What this is, and what it is not</h2>",
        "<p>Points of the chart are geometric means over the scenes. Speeds are the best of a few "
        "short runs on one machine and hold misses too; neighbours on the front may change places "
        "from run to run. Truth of the mesh is Embree's, in f32, with the triangles' own normals. "
        "Rods are thinner than the ramp of a voxel at low resolutions, and all but vanish there: "
        "silhouettes count them.</p>",
    ]
    (folder / "accuracy.html").write_text(page.whole("Speed against accuracy", body), "utf-8")


def told_setting(s: Setting) -> str:
    label = entries.label(leapray.traverser(s.traverser))
    return f"{label}; {s.hit_test}, {s.root}, {s.normal}, {s.dtype}, {s.size}³"


def sentences(points: list[Point]) -> list[str]:
    """Sentences computed from the figures."""
    found = {point.setting: point for point in points}
    sizes = sorted({setting.size for setting in found})
    first, last = (found[default(size)] for size in (sizes[0], sizes[-1]))
    said = [
        f"With the defaults, {sizes[0]} to {sizes[-1]} samples a side take the error of points "
        f"from {first.hit_99:.2g} to {last.hit_99:.2g} thousandths and the speed from "
        f"{first.mrays:.2g} to {last.mrays:.2g} million rays a second."
    ]
    base = default(sizes[len(sizes) // 2])
    here = found[base]
    for key, label in (("hit_test", "hit test"), ("root", "root"), ("normal", "normal"),
                       ("dtype", "sample type")):  # fmt: skip
        others = [
            p
            for s, p in found.items()
            if s != base and replace(s, **{key: getattr(base, key)}) == base
        ]
        parts = [
            f"{getattr(p.setting, key)} {p.mrays / here.mrays:.2f} times the speed, "
            f"{p.hit_99 / here.hit_99:.2f} times the error of points, "
            f"{p.normal_mean / here.normal_mean:.2f} of normals"
            for p in others
        ]
        if parts:
            said.append(
                f"At {base.size}, {label} against {getattr(base, key)}: {'; '.join(parts)}."
            )
    walks = [p for s, p in found.items() if replace(s, traverser=base.traverser) == base]
    walks.sort(key=lambda p: -p.mrays)
    fast, slow = (entries.label(leapray.traverser(p.setting.traverser)) for p in
                  (walks[0], walks[-1]))  # fmt: skip
    said.append(
        f"Of the traversers {fast} is fastest there, {walks[0].mrays / walks[-1].mrays:.1f} times "
        f"as fast as {slow}."
    )
    return said
