# SPDX-License-Identifier: GPL-3.0-or-later
"""The same frame by Cycles and by LeapRay, and how they differ.

Geometry: Cycles with one sample, which goes through the pixel's centre, under a black world; its
Combined tells what is lit; light does not bounce then, and shadows are sharp. LeapRay's geometry
passes go through the same points. Light: linear RGB at equal samples, filter and limits of
bounces, both measured against another Cycles render with many more samples and another seed.
`frames.prepare` describes how the scene is changed for that; the report lists the changes.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import flip_evaluator
import numpy as np
from numpy.typing import NDArray

import leapray
from leapray import LeapRayError

from ..arrays import srgb
from ..store import files
from . import charts, metrics, report
from .folder import result_folder

if TYPE_CHECKING:
    from . import frames

PIXELS_PER_DEGREE = 67  # FLIP's own viewing distance
LEAST_PIXELS = 64  # objects that fewer pixels show are listed, and left out of the worst
LIT = 1e-4  # of white: what is darker in the first sample is not lit
FLIP, GLASS_FLIP = 0.03, 0.06  # asked of the mean, without and with refraction
Json = dict[str, Any]


def main(args: argparse.Namespace) -> int:
    """Compare; writes the folder and returns the exit code."""
    from ..blender import open_file

    output = Path(args.output or f"{Path(args.scene).stem}-compare")
    chosen = traversers(getattr(args, "traversers", None))
    with result_folder(output, "report.html") as folder:
        scene = open_file.open_scene(Path(args.scene))
        told = compare(scene, args, chosen, folder)
        told["scene"] = str(args.scene)
        report.write(folder, told)
        files.write_json(folder / "report.json", told)
        for pattern in ("*.exr", "*.vdb"):
            for each in folder.glob(pattern):
                each.unlink()
    for line in report.summary(told):
        print(line)
    print(f"{output / 'report.html'}, and its figures in {output / 'report.json'}", flush=True)
    return 0


def traversers(words: str | None) -> list[leapray.Traverser]:
    """The traversers that were asked for; the default one leads where it is among them."""
    every = leapray.traversers()
    if words == "all":
        chosen = every
    elif words:
        chosen = [leapray.traverser(word.strip()) for word in words.split(",")]
    else:
        chosen = [each for each in every if each.default]
    return sorted(chosen, key=lambda each: not each.default)


def compare(scene, args: argparse.Namespace, chosen: list, folder: Path) -> Json:
    """Render and measure everything; pictures and charts go to the folder."""
    import bpy

    from . import cycles_volumes, frames, kept

    def option(name: str, default):
        value = getattr(args, name, None)
        return default if value is None else value

    if scene.camera is None:
        raise LeapRayError(f"{args.scene} has no camera")
    frames.open_image_io()  # refuses before the work begins
    samples = option("samples", 16)
    reference_samples = option("reference", 8 * samples)
    scene.frame_set(option("frame", scene.frame_current))
    scene.render.resolution_percentage = option("percentage", scene.render.resolution_percentage)
    if args.threads is not None:
        scene.render.threads_mode = "FIXED" if args.threads else "AUTO"
        scene.render.threads = args.threads or scene.render.threads
    plain = option("materials", "scene") == "plain"
    notes = frames.prepare(
        scene, plain=plain, diffuse_bounces=getattr(args, "diffuse_bounces", None)
    )
    notes += cycles_volumes.give(scene, folder)
    subject = frames.examine(scene, notes)
    own_world = scene.world
    frames.blacken_world(scene)
    black = option("world", "scene") == "black"

    began = time.perf_counter()

    def step(words: str) -> None:
        print(
            f"compare: {time.perf_counter() - began:6.1f} s  {words}", file=sys.stderr, flush=True
        )

    path = folder / "frame.exr"
    with frames.sharp(scene):
        step("Cycles, geometry")
        want = frames.render_cycles(scene, path, 1)
        step(f"LeapRay, geometry, {chosen[0].name}")
        got = frames.render_leapray(scene, path, 1, chosen[0].spec)
    geometry = Geometry(subject, want, got)

    if not black:
        scene.world = own_world
    cycles: dict[int, Json] = {}
    images: dict[str, frames.Frame] = {}
    step(f"Cycles, reference, {reference_samples} samples")
    own_references = getattr(args, "references", None)
    reference = kept.reference(scene, path, reference_samples, own_references, plain, black)
    light = Light(subject, geometry, reference.passes["Combined"][..., :3])
    most = option("curve", 0)
    curve = {4**k for k in range(16) if 4**k <= most}
    usual = {1, max(samples // 4, 1), samples, 4 * samples}
    counts = curve | {samples} if curve else {n for n in usual if n < reference_samples}
    for count in sorted(counts):
        step(f"Cycles, {count} samples")
        frame = frames.render_cycles(scene, path, count)
        cycles[count] = {"seconds": frame.seconds, **light.of(frame)}
        images["cycles"] = frame if count == samples else images.get("cycles", frame)
    ours: dict[int, Json] = {}
    done: dict[int, frames.Frame] = {}
    for count in sorted(curve):
        step(f"LeapRay, {count} samples")
        frame = frames.render_leapray(scene, path, count, chosen[0].spec)
        ours[count] = {"seconds": frame.seconds, "phases": frame.report["seconds"]}
        ours[count] |= light.of(frame)
        done[count] = frame
    runs: dict[str, Json] = {}
    for each in chosen:
        step(f"LeapRay, {samples} samples, {each.spec}")
        known = done.pop(samples, None)
        frame = known or frames.render_leapray(scene, path, samples, each.spec)
        images.setdefault("leapray", frame)
        runs[each.spec] = {
            "label": each.label,
            "exact": each.exact,
            "default": each.default,
            "seconds": frame.seconds,
            "report": frame.report,
            "geometry": Geometry(subject, want, frame, lit=got).told(),
            "light": light.of(frame),
        }
    step("pictures")
    told: Json = {
        "blender": bpy.app.version_string,
        "leapray": leapray.__version__,
        "machine": charts.machine(),
        "frame": scene.frame_current,
        "width": want.index.shape[1],
        "height": want.index.shape[0],
        "samples": samples,
        "reference_samples": reference_samples,
        "materials": "plain" if plain else "of the scene",
        "world": "black" if black or is_black(own_world) else "of the scene",
        "white": subject.white,
        "notes": subject.notes,
        "objects": geometry.fractions(),
        "cycles": {
            "seconds_geometry": want.seconds,
            "seconds_reference": reference.seconds,
            "by_samples": cycles,
        },
        "by_samples": ours,
        "bounces": {name: getattr(scene.leapray, name) for name in frames.BOUNCES},
        "refracts": subject.refracts,
        "runs": runs,
    }
    told["bars"] = bars(told, geometry)
    told["pictures"] = report.pictures(folder, geometry, light, images)
    told["charts"] = report.draw_charts(folder, told)
    return told


def is_black(world) -> bool:
    if world is None:
        return True
    tree = world.node_tree
    node = tree.nodes.get("Background") if tree else None
    color = node.inputs["Color"].default_value[:3] if node else world.color[:]
    return not any(color)


# ---- geometry ------------------------------------------------------------


@dataclass
class Geometry:
    """Two renders' geometry passes; `lit` is where LeapRay's one sample under black is seen."""

    subject: frames.Subject
    want: frames.Frame
    got: frames.Frame
    lit: frames.Frame | None = None

    def __post_init__(self) -> None:
        self.index, self.other = self.want.index, self.got.index
        self.agree = (self.index == self.other) & (self.index > 0)
        passes, others = self.want.passes, self.got.passes
        self.depth_error = np.where(
            self.agree,
            metrics.depth_error(
                self.subject.view,
                passes["Depth"],
                passes["Position"],
                passes["Normal"],
                others["Depth"],
            ),
            np.nan,
        )
        self.angle = np.where(self.agree, metrics.angle(passes["Normal"], others["Normal"]), np.nan)
        self.is_lit, self.other_lit = (
            np.full(frame.index.shape, True) if self.subject.soft else is_lit(frame, white)
            for white in (self.subject.white,)
            for frame in (self.want, self.lit or self.got)
        )
        self.sheet_rims = self.see_rims()

    def see_rims(self) -> metrics.Mask:
        """Pixels within one step of a border edge of an open mesh that Cycles sees."""
        view, depth = self.subject.view, self.want.passes["Depth"]
        mask = np.zeros(depth.shape, bool)
        points = metrics.on_lines(view, self.subject.rim_starts, self.subject.rim_ends, mask.shape)
        if not len(points):
            return mask
        x, y = points[:, 0].astype(int), points[:, 1].astype(int)
        # Behind the farthest surface of the neighbourhood by more than three pixels is hidden.
        farthest = metrics.around(depth).max(axis=0)[y, x]
        seen = points[:, 2] <= farthest + 3 * view.footprint(points[:, 2])
        mask[y[seen], x[seen]] = True
        return metrics.grown(mask)

    def shadow_steps(self) -> dict[str, Json]:
        """Per object: pixels lit in one image only, and how far from a shadow's edge in Cycles."""
        steps = metrics.steps_to_other(2 * self.index + self.is_lit)
        differ = self.agree & (self.is_lit != self.other_lit)
        told: dict[str, Json] = {}
        for k in np.unique(self.index[self.agree]):
            here = differ & (self.index == k)
            told[self.subject.names[int(k)]] = {
                "n": int(here.sum()),
                "worst_steps": int(steps[here].max()) if here.any() else 0,
                "n_beyond_edges": int((here & (steps > 1)).sum()),
            }
        return told

    def fractions(self) -> dict[str, float]:
        """Each object's fraction of the image, as Cycles sees it."""
        index, count = np.unique(self.index, return_counts=True)
        return {
            self.subject.names.get(int(k), f"index {k}"): float(n / self.index.size)
            for k, n in zip(index, count, strict=True)
        }

    def told(self) -> Json:
        """The figures."""
        names = self.subject.names
        clear = self.agree & ~metrics.mixed(self.index)
        return {
            "index": metrics.index_mismatch(self.index, self.other, self.sheet_rims),
            "depth_error_footprints": metrics.per_object(
                self.index, self.agree, self.depth_error, names
            ),
            "normal_angle_degrees": metrics.per_object(self.index, self.agree, self.angle, names),
            "normals_turned": {
                names.get(int(k), f"index {int(k)}"): metrics.turned_fraction(
                    self.angle, clear & (self.index == k)
                )
                for k in np.unique(self.index[self.agree])
            },
            "depth_error_footprints_but_edges": metrics.per_object(
                self.index, clear, self.depth_error, names
            ),
            "normal_angle_degrees_but_edges": metrics.per_object(
                self.index, clear, self.angle, names
            ),
            "shadow_edges": self.shadow_steps(),
        }


def is_lit(frame, white: float) -> metrics.Mask:
    return frame.passes["Combined"][..., :3].max(axis=-1) > LIT * white


# ---- light ---------------------------------------------------------------


@dataclass
class Light:
    """Errors against the reference; rims are those of Cycles' and LeapRay's first samples."""

    subject: frames.Subject
    geometry: Geometry
    reference: NDArray[np.float32]  # (height, width, 3) linear

    def __post_init__(self) -> None:
        g = self.geometry
        self.rims = metrics.rims(g.index, g.other, g.is_lit, g.other_lit)
        self.shown = srgb(self.reference)

    def of(self, frame) -> Json:
        """The figures of a frame."""
        image = frame.passes["Combined"][..., :3]
        white = self.subject.white
        flip = self.flip(image)
        return {
            "all": metrics.light_error(self.reference, image, white) | {"flip": float(flip.mean())},
            "but_rims": metrics.light_error(self.reference, image, white, ~self.rims)
            | {"flip": mean(flip[~self.rims])},
            "rims": metrics.light_error(self.reference, image, white, self.rims)
            | {"flip": mean(flip[self.rims])},
            "rims_share": float(self.rims.mean()),
        }

    def flip(self, image: NDArray[np.floating]) -> NDArray[np.float32]:
        """FLIP's map (height, width) in the Standard view. Source: Andersson et al. 2020."""
        found, _, _ = flip_evaluator.evaluate(
            np.ascontiguousarray(self.shown),
            np.ascontiguousarray(srgb(image)),
            "LDR",
            inputsRGB=True,
            applyMagma=False,
            parameters={"ppd": float(PIXELS_PER_DEGREE)},
        )
        return np.asarray(found, np.float32).reshape(image.shape[0], image.shape[1], -1)[..., 0]


def mean(values: NDArray[np.floating]) -> float | None:
    return float(values.mean()) if values.size else None


# ---- bars ----------------------------------------------------------------


def bars(told: Json, geometry: Geometry) -> dict[str, list[Json]]:
    """The project's requirements of a default render, and the figures of the first traverser."""
    run = next(iter(told["runs"].values()))
    shape, light = run["geometry"], run["light"]
    seen = {
        name
        for name, fraction in told["objects"].items()
        if fraction * told["width"] * told["height"] >= LEAST_PIXELS
    }

    def worst(of: str, which: str) -> tuple[str, float | None]:
        found = {
            name: values[which]
            for name, values in shape[of].items()
            if name in seen and values[which] is not None
        }
        if not found:
            return "nothing", None
        name = max(found, key=found.__getitem__)
        return name, found[name]

    def bar(what: str, value: float | None, limit: float, where: str = "") -> Json:
        known: Json = {"what": what, "value": value, "limit": limit}
        holds = None if value is None else bool(abs(value) <= limit)
        return known | {"holds": holds} | ({"where": where} if where else {})

    mismatch = shape["index"]["but_sheet_rims"]
    geometry_bars = [
        bar("index mismatch, fraction of edge pixels", mismatch["share_of_edges"], 0.10),
        bar("index mismatch, worst distance in pixels", mismatch["worst_steps"], 1),
    ]
    for what, of, which, limit in (
        ("depth error, median, footprints", "depth_error_footprints", "median", 0.1),
        ("depth error, 99 %, footprints", "depth_error_footprints", "p99", 1.0),
        ("normal angle, 99 % but edges, degrees", "normal_angle_degrees_but_edges", "p99", 5.0),
    ):
        where, value = worst(of, which)
        geometry_bars.append(bar(what, value, limit, where))
    turned = {name: fraction for name, fraction in shape["normals_turned"].items() if name in seen}
    where = max(turned, key=turned.__getitem__, default="nothing")
    what = f"normals more than {metrics.TURNED:g} degrees off, fraction of pixels but edges"
    geometry_bars.append(bar(what, turned.get(where), 0.01, where))
    light_bars = [
        bar(
            "mean of Combined against the reference, but rims",
            light["but_rims"]["mean_ratio"],
            0.01,
        ),
        bar("mean of Combined against the reference", light["all"]["mean_ratio"], 0.01),
    ]
    limit = GLASS_FLIP if told["refracts"] else FLIP
    light_bars += [
        bar("FLIP of Combined, mean, but rims", light["but_rims"]["flip"], limit),
        bar("FLIP of Combined, mean", light["all"]["flip"], limit),
    ]
    if (
        told["world"] == "black" and told["materials"] == "plain"
    ):  # else it tells the noise of the world's light, not an error
        light_bars.append(
            bar("RMSE of Combined by white, but rims", light["but_rims"]["rmse"], 0.02)
        )
    known = {"geometry": geometry_bars, f"light, world {told['world']}": light_bars}
    floor = next((name for name in shape["shadow_edges"] if name.lower() == "floor"), None)
    if floor:
        depth = shape["depth_error_footprints"][floor]["max"]
        steps = shape["shadow_edges"][floor]["worst_steps"]
        known["floor"] = [
            bar("floor, depth error, largest, footprints", depth, 1.0),
            bar("floor, shadow edges, worst distance in pixels", steps, 1),
            bar("memory at peak, bytes", run["report"].get("bytes", {}).get("peak"), 256 * 2**20),
        ]
    return known
