# SPDX-License-Identifier: GPL-3.0-or-later
"""The report of a comparison: pictures, charts and one page that needs no network (no bpy)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..arrays import srgb
from . import charts, metrics
from .page import data, esc, table, whole
from .page import figure as framed

GAIN = 10  # of the difference of light in its picture
NONE = "\N{EN DASH}"
TIMES = "\N{MULTIPLICATION SIGN}"

# ---- pictures and charts -------------------------------------------------


def pictures(folder: Path, geometry, light, images: dict) -> list[list[str]]:
    """Write the pictures; returns [file, title, caption] of each."""
    made: list[list[str]] = []

    def add(name: str, title: str, caption: str, image) -> None:
        (folder / f"{name}.png").write_bytes(charts.png(image))
        made.append([f"{name}.png", title, caption])

    g = geometry
    ours = images["leapray"].passes["Combined"][..., :3]
    theirs = images["cycles"].passes["Combined"][..., :3]
    white = g.subject.white
    for name, title, image in (
        ("cycles", "Cycles", theirs),
        ("leapray", "LeapRay", ours),
        ("reference", "Reference", light.reference),
    ):
        caption = "linear light in the Standard view"
        add(name, title, caption, charts.as_bytes(srgb(image)))
    difference = 0.5 + GAIN * (ours - light.reference) / (2 * white)
    add(
        "difference",
        "Difference of light",
        f"LeapRay less the reference, grey is none, {GAIN} times enlarged",
        charts.as_bytes(difference),
    )
    add(
        "flip",
        "FLIP",
        "what an eye notices when it flips between the two: black nothing, yellow much",
        charts.picture(light.flip(ours), 0.0, 1.0, "magma"),
    )
    edges = metrics.mixed(g.index)
    add("index_cycles", "Objects, Cycles", "one colour per index", charts.labels(g.index))
    add("index_leapray", "Objects, LeapRay", "one colour per index", charts.labels(g.other))
    add(
        "index_mismatch",
        "Index mismatch",
        "grey: edge pixels of Cycles; vermilion: another object; blue: so at the rim of a sheet",
        mismatch_picture(g, edges),
    )
    add(
        "depth_error",
        "Depth error",
        "along the ray, by the surface's tilt, in widths of a pixel: black 0, yellow from 1 on",
        charts.picture(g.depth_error, 0.0, 1.0),
    )
    add(
        "normal_angle",
        "Angle of the normals",
        "black 0 degrees, yellow 5 degrees and more",
        charts.picture(g.angle, 0.0, 5.0),
    )
    add(
        "lit",
        "Lit or not",
        "white: lit in both, black: in neither; blue: lit by Cycles alone, orange: LeapRay alone",
        lit_picture(g),
    )
    return made


def mismatch_picture(g, edges):
    image = np.full((*g.index.shape, 3), 255, np.uint8)
    image[g.index > 0] = 240
    image[edges] = 200
    differ = g.index != g.other
    image[differ] = (213, 94, 0)
    image[differ & g.sheet_rims] = (0, 114, 178)
    return image


def lit_picture(g):
    image = np.zeros((*g.index.shape, 3), np.uint8)
    image[g.is_lit & g.other_lit] = 235
    image[(g.index == 0) & (g.other == 0)] = 128
    image[g.is_lit & ~g.other_lit] = (86, 180, 233)
    image[~g.is_lit & g.other_lit] = (230, 159, 0)
    return image


def draw_errors(axis, told: dict, which: str) -> None:
    """Error of light against seconds: Cycles at its sample counts, a point per traverser."""
    points = told["cycles"]["by_samples"]
    xs = [values["seconds"] for values in points.values()]
    ys = [values[which]["rmse"] for values in points.values()]
    axis.plot(xs, ys, "-o", color=charts.INK, label="Cycles, samples as numbered")
    for count, x, y in zip(points, xs, ys, strict=True):
        axis.annotate(f"{count}", (x, y), xytext=(5, 5), textcoords="offset points", fontsize=9)
    ours = told["by_samples"]
    if ours:
        xs = [values["seconds"] for values in ours.values()]
        curve = [values[which]["rmse"] for values in ours.values()]
        axis.plot(xs, curve, "--", color=charts.COLORS[0], label="LeapRay, likewise")
        ys += curve
        for count, x, y in zip(ours, xs, curve, strict=True):
            axis.annotate(f"{count}", (x, y), xytext=(5, 5), textcoords="offset points", fontsize=9)
    for k, run in enumerate(told["runs"].values()):
        y = run["light"][which]["rmse"]
        ys.append(y)
        label = f"LeapRay, {run['label']}"
        style = {**charts.look(k), "linestyle": "none", "markersize": 9}
        axis.plot(run["seconds"], y, label=label, **style)
    axis.set_xscale("log")
    if all(y > 0 for y in ys):
        axis.set_yscale("log")
    charts.plain_ticks(axis)
    axis.set_xlabel("seconds for the frame, reading and writing included")


ERRORS = {  # charts of the error of light: the part of the image, the title
    "all": "Error against time",
    "but_rims": "Error against time, without rims",
}


def draw_charts(folder: Path, told: dict) -> list[list[str]]:
    """Write the charts, narrow enough for a phone; returns [file, title, caption] of each."""
    made = []
    for which, title in ERRORS.items():
        name = f"error_{which}"
        height = 3.6 + 0.2 * len(told["runs"])
        with charts.chart(folder / name, width=5.4, height=height) as (figure, axes):
            axis = axes[0, 0]
            draw_errors(axis, told, which)
            axis.set_ylabel("RMSE by a lit white surface")
            figure.legend(*axis.get_legend_handles_labels(), loc="outside lower left")
        caption = f"LeapRay at {told['samples']} samples; the figures stand in the table below"
        made.append([f"{name}.png", title, caption])
    phases = {run["label"]: phases_of(run) for run in told["runs"].values()}
    names = list(dict.fromkeys(name for values in phases.values() for name in values))
    if names:
        height = 2.2 + 0.3 * len(phases)
        with charts.chart(folder / "phases", width=5.4, height=height) as (figure, axes):
            axis = axes[0, 0]
            left = np.zeros(len(phases))
            for k, name in enumerate(names):
                widths = np.array([values.get(name, 0.0) for values in phases.values()])
                color = charts.COLORS[k % len(charts.COLORS)]
                axis.barh(list(phases), widths, left=left, color=color, label=name, height=0.6)
                left += widths
            axis.invert_yaxis()
            axis.grid(axis="y", visible=False)
            axis.set_xlabel("seconds")
            figure.legend(loc="outside lower left", ncols=3)
        made.append(["phases.png", "Time by phase", "of the frame that is measured for light"])
    return made


def phases_of(run: dict) -> dict[str, float]:
    """The seconds of a run by phase, their total left out."""
    seconds = run["report"].get("seconds", {})
    return {k: v for k, v in seconds.items() if isinstance(v, int | float) and k != "total"}


# ---- words ---------------------------------------------------------------


def number(value, digits: int = 3) -> str:
    """A figure for the eye; a dash where there is none."""
    if value is None:
        return NONE
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:,}".replace(",", "\u2009")
    if value and abs(value) < 10**-digits:
        return f"{value:.1e}"
    return f"{value:.{digits}f}" if abs(value) < 1000 else f"{value:,.0f}".replace(",", "\u2009")


def summary(told: dict) -> list[str]:
    """The bars, a line each, for the terminal."""
    lines = []
    for group, found in told["bars"].items():
        for bar in found:
            state = {True: "holds", False: "FAILS", None: "not measured"}[bar["holds"]]
            where = f" ({bar['where']})" if bar.get("where") else ""
            value, limit = number(bar["value"], 4), number(bar["limit"])
            lines.append(f"{group}: {bar['what']}{where}: {value}, at most {limit}: {state}")
    return lines


def write(folder: Path, told: dict) -> None:
    """Write report.html from what compare tells and the pictures in the folder."""
    name = Path(str(told["scene"])).stem
    bar_rows = []
    for group, found in told["bars"].items():
        for bar in found:
            kind = {True: "good", False: "bad", None: "soft"}[bar["holds"]]
            state = {True: "holds", False: "fails", None: "not measured"}[bar["holds"]]
            where = f' <span class="soft">{esc(bar["where"])}</span>' if bar.get("where") else ""
            bar_rows.append(
                [
                    f"{esc(bar['what'])}{where}",
                    esc(group),
                    number(bar["value"], 4),
                    number(bar["limit"]),
                    f'<span class="{kind}">{state}</span>',
                ]
            )
    shown = {file: (title, caption) for file, title, caption in told["pictures"]}
    slider = (
        '<div class="slider">'
        f'<img alt="Cycles" src="{data(folder, "cycles.png")}">'
        f'<img alt="LeapRay" class="over" src="{data(folder, "leapray.png")}">'
        '<div class="bar"></div><span style="left:10px">Cycles</span>'
        '<span style="right:10px">LeapRay</span></div>'
    )

    def figures(files: list[str], known: dict) -> str:
        return (
            '<div class="two">'
            + "".join(framed(folder, file, *known[file]) for file in files)
            + "</div>"
        )

    drawn = {file: (title, caption) for file, title, caption in told["charts"]}
    parts = [
        f"<h1>{esc(name)}: LeapRay beside Cycles</h1>",
        f'<p class="soft">{told["width"]} {TIMES} {told["height"]} pixels, {told["samples"]} '
        f"samples per pixel, reference Cycles at {told['reference_samples']} samples, world "
        f"{esc(told['world'])}. LeapRay {esc(told['leapray'])} in Blender {esc(told['blender'])} "
        f"on {esc(told['machine'])}.</p>",
        f"<figure>{slider}<figcaption>Move over the picture to compare. Click the pictures below "
        "to magnify them.</figcaption></figure>",
        "<h2>What is asked, and what was found</h2>",
        table(["", "of", "found", "at most", ""], bar_rows),
        "<h2>Light</h2>",
        light_table(told),
        figures(["difference.png", "flip.png", "lit.png", "reference.png"], shown),
        "<h2>Geometry</h2>",
        index_table(told),
        object_table(told),
        figures(
            ["index_mismatch.png", "depth_error.png", "normal_angle.png", "index_leapray.png"],
            shown,
        ),
        "<h2>Light against time</h2>",
        figures([f"error_{which}.png" for which in ERRORS], drawn),
        error_table(told),
        '<p class="soft">One run each, on a machine that may have done other work. One sample of '
        "Cycles goes through the pixel's centre, so away from rims it is good already.</p>",
        "<h2>Time and memory</h2>",
        figures([file for file in drawn if not file.startswith("error_")], drawn),
        time_table(told),
        volume_table(told),
        "<h2>How it was measured</h2>",
        "<p>Geometry: Cycles with one sample, which goes through the pixel's centre, and LeapRay "
        "through the same points. Depth error is the difference along the ray times the cosine of "
        "the surface's tilt, in widths of a pixel there, where both see the same object. Edge "
        "pixels are those with another object among their eight neighbours in Cycles' picture. "
        "Light: linear RGB, box filter of one pixel, light to surface to camera and no further, "
        "against Cycles with more samples and another seed; errors are relative to a lit white "
        "surface. Rims are neighbourhoods with mixed objects, or with lit and unlit pixels. FLIP "
        "is taken in the Standard view at 67 pixels per degree.</p>",
        *(
            [f"<details><summary>Changes to the scene: {len(told['notes'])}</summary><ul>"]
            + [f"<li>{esc(note)}</li>" for note in told["notes"]]
            + ["</ul></details>"]
            if told["notes"]
            else []
        ),
        warnings(told),
    ]
    page = whole(f"{name}: LeapRay beside Cycles", parts)
    (folder / "report.html").write_text(page, encoding="utf-8")


def light_table(told: dict) -> str:
    rows = []
    named = {f"LeapRay, {esc(run['label'])}": run["light"] for run in told["runs"].values()}
    for count, values in told["by_samples"].items():
        named[f"LeapRay, samples: {count}"] = values
    for count, values in told["cycles"]["by_samples"].items():
        named[f"Cycles, samples: {count}"] = values
    for name, values in named.items():
        inner, every = values["but_rims"], values["all"]
        ratio = every["mean_ratio"]
        rows.append(
            [
                name,
                NONE if ratio is None else f"{100 * ratio:+.2f} %",
                number(inner["rmse"], 4),
                number(inner["psnr"], 1),
                number(inner["flip"], 4),
                number(every["rmse"], 4),
                number(every["psnr"], 1),
                number(every["flip"], 4),
                f"{100 * values['rims_share']:.1f} %",
            ]
        )
    head = ["", "mean", "RMSE*", "PSNR* dB", "FLIP*", "RMSE", "PSNR dB", "FLIP", "rims"]
    return (
        table(head, rows) + '<p class="soft">* without rims, whose fraction is the last column.</p>'
    )


def index_table(told: dict) -> str:
    rows = []
    for run in told["runs"].values():
        found = run["geometry"]["index"]
        cells = [esc(run["label"]), number(found["n_edge_pixels"])]
        for which in ("but_sheet_rims", "sheet_rims"):
            part = found[which]
            fraction = part["share_of_edges"]
            cells += [
                number(part["n"]),
                NONE if fraction is None else f"{100 * fraction:.2f} %",
                number(part["worst_steps"]),
            ]
        rows.append(cells)
    head = ["", "edge pixels", "differ", "by edges", "farthest", "at rims of sheets", "by edges"]
    return table([*head, "farthest"], rows)


def object_table(told: dict) -> str:
    run = next(iter(told["runs"].values()))
    shape = run["geometry"]
    rows = []
    names = sorted(shape["depth_error_footprints"], key=lambda n: -told["objects"].get(n, 0))
    for name in names:
        depth, angle = (
            shape[key][name] for key in ("depth_error_footprints", "normal_angle_degrees")
        )
        shadow = shape["shadow_edges"].get(name, {})
        rows.append(
            [
                esc(name),
                number(depth["n"]),
                *(number(depth[key]) for key in metrics.PERCENTILES),
                *(number(angle[key], 2) for key in metrics.PERCENTILES),
                f"{100 * shape['normals_turned'][name]:.2f} %",
                number(shadow.get("n")),
                number(shadow.get("worst_steps")),
            ]
        )
    head = ["", "pixels", "depth error, median", "95 %", "99 %", "max"]
    head += ["normal, median °", "95 %", "99 %", "max", f"over {metrics.TURNED:g}°"]
    head += ["lit otherwise", "farthest"]
    return table(head, rows[:40])


def error_table(told: dict) -> str:
    """The figures of the charts of errors: a line for every point."""
    points = [
        (f"Cycles, samples: {count}", values["seconds"], values)
        for count, values in told["cycles"]["by_samples"].items()
    ]
    points += [
        (f"LeapRay, samples: {count}", values["seconds"], values)
        for count, values in told["by_samples"].items()
    ]
    points += [
        (f"LeapRay, {esc(run['label'])}", run["seconds"], run["light"])
        for run in told["runs"].values()
    ]
    rows = [
        [name, f"{seconds:.2f}", *(number(values[which]["rmse"], 4) for which in ERRORS)]
        for name, seconds, values in points
    ]
    return table(["", "seconds", "RMSE", "RMSE without rims"], rows)


def time_table(told: dict) -> str:
    """Seconds by phase, and what was held in memory: a column each."""
    runs = told["runs"].values()
    phases = list(dict.fromkeys(name for run in runs for name in phases_of(run)))
    kinds = list(dict.fromkeys(kind for run in runs for kind in run["report"].get("bytes", {})))
    rows = []
    for run in runs:
        seconds, nbytes = phases_of(run), run["report"].get("bytes", {})
        cells = [f"{seconds[name]:.2f}" if name in seconds else NONE for name in phases]
        cells += [number(nbytes[kind] / 2**20, 1) if kind in nbytes else NONE for kind in kinds]
        rows.append([f"LeapRay, {esc(run['label'])}", f"{run['seconds']:.2f}", *cells])
    for count, values in told["cycles"]["by_samples"].items():
        nothing = [NONE] * (len(phases) + len(kinds))
        rows.append([f"Cycles, samples: {count}", f"{values['seconds']:.2f}", *nothing])
    head = ["", "seconds", *(f"{esc(name)}, s" for name in phases)]
    return table(head + [f"{esc(kind)}, MB" for kind in kinds], rows)


def volume_table(told: dict) -> str:
    """What the scene was modelled by, folded away."""
    volumes = next(iter(told["runs"].values()))["report"].get("volumes", [])
    rows = [
        [
            esc(str(each.get("name"))),
            esc(str(each.get("kind"))),
            f" {TIMES} ".join(str(n) for n in each.get("size", ())),
            number(each.get("voxel_size"), 4),
            number(each.get("error_footprints")),
            number(each.get("nbytes", 0) / 2**20, 2),
            number(each.get("instances")),
        ]
        for each in volumes
    ]
    head = ["", "kind", "samples", "voxel size", "error, footprints", "MB", "instances"]
    return f"<details><summary>The volumes: {len(rows)}</summary>{table(head, rows)}</details>"


def warnings(told: dict) -> str:
    run = next(iter(told["runs"].values()))
    found = run["report"].get("warnings", [])
    if not found:
        return ""
    lines = "".join(f"<li>{esc(str(each))}</li>" for each in found)
    return f"<h2>Warnings</h2><ul>{lines}</ul>"
