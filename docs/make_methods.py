# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the pictures of docs/methods and write the tables of its pages, from the core itself.

    python docs/make_methods.py            writes them
    python docs/make_methods.py --check    fails where one of them is not current

The text of each page is written by hand; the table at its head and the index's come from the
registry. Walks are those of the core, see walks.py; curves are what the core answers.
"""

from __future__ import annotations

import itertools
import re
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
if __name__ == "__main__":
    sys.path.insert(0, str(ROOT / "native"))

import generated  # noqa: E402
import method_charts  # noqa: E402
import walks  # noqa: E402
from svg import BLUE, INK, ORANGE, PALE, RED, Picture  # noqa: E402

import leapray  # noqa: E402
from leapray.arrays import about  # noqa: E402
from leapray.voxelization import FILTERS, filter_info  # noqa: E402

FOLDER = ROOT / "docs" / "methods"
SIDE = 14  # pixels of a cell
MARGIN = 8

# What the picture shows of each traverser: the kind of empty region that it leaves (see
# walks.regions), or "spheres", "samples", "line", "nodes".
SHOWN = {
    "aw": "cell",
    "aw_accumulate": "cell",
    "frt": "cell",
    "pyramid": "octree",
    "smart": "octree",
    "supervoxel": "blocks",
    "hdda": "bricks",
    "cd": "cube",
    "cd_octant": "ahead",
    "macro_box": "box",
    "radc": "spheres",
    "uniform": "samples",
    "lines": "line",
    "kdtree": "nodes",
}
# Pictures of other choices: name of the file -> what is asked for.
MORE = {"lines_6": "lines:connectivity=6", "radc_paper": "radc:step=paper"}
FIRST_CHOICE = {"lines": "lines:connectivity=26"}  # of those whose default cannot be observed


def at(x: float, y: float) -> tuple[float, float]:
    """The pixel of a point in index coordinates."""
    return MARGIN + (x + 1) * SIDE, MARGIN + (walks.HEIGHT - y) * SIDE


def draw_box(picture: Picture, box: walks.Box, fill="none", stroke=None, **more) -> None:
    x, y = at(box[0], box[3] + 1)
    w, h = (box[1] - box[0] + 1) * SIDE, (box[3] - box[2] + 1) * SIDE
    picture.rect(x, y, w, h, fill, stroke, **more)


def background(bricks: bool) -> Picture:
    """The grid of cells, the surface cells, and if `bricks`, those of the core."""
    width, height = walks.WIDTH + 1, walks.HEIGHT + 1
    picture = Picture(width * SIDE + 2 * MARGIN, height * SIDE + 2 * MARGIN)
    surface = walks.surface()
    for j in range(-1, walks.HEIGHT):
        row = sorted(i for i, k in surface if k == j)
        starts = [i for i in row if i - 1 not in row]
        for first in starts:
            last = next(i for i in range(first, walks.WIDTH + 1) if i + 1 not in row)
            draw_box(picture, (first, last, j, j), "#b9b9b9")
    for i in range(-1, walks.WIDTH + 1):
        strong = bricks and (i - walks.FIRST) % 8 == 0
        picture.line([at(i, -1), at(i, walks.HEIGHT)], "#8f8f8f" if strong else PALE, width=0.8)
    for j in range(-1, walks.HEIGHT + 1):
        strong = bricks and (j - walks.FIRST) % 8 == 0
        picture.line([at(-1, j), at(walks.WIDTH, j)], "#8f8f8f" if strong else PALE, width=0.8)
    return picture


def draw_regions(picture: Picture, structure, kind: str, entries: list[float]) -> None:
    for box in walks.regions(kind, structure, entries):
        if box is not None and kind != "cell":
            draw_box(picture, box, BLUE, BLUE, opacity=0.13, width=1.2)
    for t in entries:
        i, j = walks.cell(t)
        draw_box(picture, (i, i, j, j), ORANGE, opacity=0.4)


def draw_spheres(picture: Picture, entries: list[float]) -> None:
    speed = float(np.linalg.norm(walks.DIRECTION))
    for t, following in itertools.pairwise(entries):
        i, j = walks.cell(t)
        draw_box(picture, (i, i, j, j), ORANGE, opacity=0.4)
        radius = (following - t) * speed
        if radius >= 1.0:
            x, y = at(*walks.point(t))
            picture.circle(x, y, radius * SIDE, BLUE, BLUE, opacity=0.1, width=1.2)


def draw_samples(picture: Picture, entries: list[float]) -> None:
    """Cells that hold a sample, and, outlined in red, those that are pierced and hold none."""
    found = {walks.cell(t - 2 * walks.CLOSE) for t in entries}
    pierced = {walks.cell(t) for t in walks.growth(leapray.build(walks.volume(), "aw"))}
    for i, j in sorted(found):
        draw_box(picture, (i, i, j, j), ORANGE, opacity=0.4)
    for i, j in sorted(pierced - found):
        draw_box(picture, (i, i, j, j), "none", RED, width=1.6)


def draw_line(picture: Picture, spec: str) -> None:
    on_line = walks.on_line(spec)
    pierced = {walks.cell(t) for t in walks.growth(leapray.build(walks.volume(), "aw"))}
    for i, j in on_line:
        draw_box(picture, (i, i, j, j), ORANGE, opacity=0.4)
    for i, j in sorted({c for c in pierced if c[0] >= 0} - set(on_line)):
        draw_box(picture, (i, i, j, j), "none", RED, width=1.6)


def walk_picture(spec: str) -> Picture:
    kind = SHOWN[spec.partition(":")[0]]
    structure = leapray.build(walks.volume(), spec)
    picture = background(kind in ("octree", "bricks", "blocks"))
    end = float(walks.trace(structure).t[0])
    seen = end + (1.0 if kind == "samples" else walks.CLOSE)  # the last sample is behind the hit
    entries = walks.growth(structure, "nodes" if kind == "nodes" else "cells", seen)
    if kind == "spheres":
        draw_spheres(picture, entries)
    elif kind == "samples":
        draw_samples(picture, entries)
    elif kind == "line":
        draw_line(picture, spec)
    elif kind != "nodes":
        draw_regions(picture, structure, kind, entries)
    picture.line([at(*walks.point(2.0)), at(*walks.point(end))], INK, width=1.3)
    for t in () if kind == "line" else entries:
        picture.circle(*at(*walks.point(t)), 2.6, INK)
    picture.circle(*at(*walks.point(end)), 4, RED)
    return picture


def drift_picture() -> Picture:
    """The last cells of a long ray, by sums in 32 bits, and where these leave the ray."""
    x0, x1, y0, y1 = walks.WINDOW
    side, margin = 34, 8
    picture = Picture((x1 - x0 + 1) * side + 2 * margin, (y1 - y0 + 1) * side + 2 * margin)

    def place(x: float, y: float) -> tuple[float, float]:
        return margin + (x - x0) * side, margin + (y1 + 1 - y) * side

    for i in range(x0, x1 + 2):
        picture.line([place(i, y0), place(i, y1 + 1)], PALE)
    for j in range(y0, y1 + 2):
        picture.line([place(x0, j), place(x1 + 1, j)], PALE)
    visited = walks.far_cells("aw_accumulate:precision=f32")
    for i, j in sorted(visited):
        picture.rect(*place(i, j + 1), side, side, ORANGE, opacity=0.4)
    for i, j in sorted(walks.far_cells("aw") - visited):
        picture.rect(*place(i, j + 1), side, side, "none", RED, width=2)
    ends = [(x - walks.ORIGIN[0]) / walks.LONG_DIRECTION[0] for x in (x0, x1 + 1)]
    points = [walks.ORIGIN + t * walks.LONG_DIRECTION for t in ends]
    picture.line([place(p[0], p[1]) for p in points], INK, width=1.4)
    return picture


# ---- tables ----------------------------------------------------------------------


def yes(value: bool) -> str:
    return "yes" if value else "no"


def index_table() -> str:
    rows = []
    for t in leapray.traversers():
        counters = walks.trace(leapray.build(walks.volume(), t)).counters
        told = (f"[{t.label}]({t.name}.md)", f"`{t.name}`", t.source, t.about, yes(t.exact))
        rows.append((*told, str(counters["cells"]), str(counters["nodes"] or "")))
    head = ("traverser", "name", "source", "how it goes", "exact", "cells", "nodes")
    return generated.table(head, rows)


def registry_table(entry: leapray.Traverser) -> str:
    """What the registry says of one traverser."""
    rows = [
        ("name", f"`{entry.name}`" + " (the default)" * entry.default),
        ("source", entry.source),
        ("exact", yes(entry.exact)),
        ("rectilinear volumes", yes(entry.rectilinear)),
    ]
    return generated.table(("in the registry", ""), rows + option_rows(entry.options))


def option_rows(options: tuple[leapray.Option, ...]) -> list[tuple[str, str]]:
    rows = []
    for option in options:
        choices = ", ".join(
            f"`{c}`" + " (not exact)" * (c in option.inexact) for c in option.choices
        )
        rows.append((f"option `{option.name}`", f"{choices}; the first is the default"))
    return rows


def images_table() -> str:
    rows = [
        (
            f"[{m.label}]({m.name}.md)",
            f"`{m.name}`",
            m.source,
            m.about,
            yes(m.exact),
            yes(m.perspective),
        )
        for m in leapray.image_methods()
    ]
    head = ("method", "name", "source", "how it goes", "exact", "perspective")
    return generated.table(head, rows)


def image_method_table(entry: leapray.ImageMethod) -> str:
    """What the registry says of one whole-image method."""
    rows = [
        ("name", f"`{entry.name}`"),
        ("source", entry.source),
        ("exact", yes(entry.exact)),
        ("perspective cameras", yes(entry.perspective)),
    ]
    return generated.table(("in the registry", ""), rows + option_rows(entry.options))


def filter_table() -> str:
    """What the core says of the filters, widths in voxels."""
    rows = []
    for name, member in FILTERS.items():
        wide, narrow = (filter_info(name, dtype) for dtype in ("u16", "u8"))
        width = f"{wide.half_width:g}" + f"; {narrow.half_width:g} for u8" * (
            wide.half_width != narrow.half_width
        )
        rows.append((f"`{name}`", about(member), width, yes(not wide.of_solids)))
    return generated.table(("filter", "", "half width unless asked", "for sheets"), rows)


def filled(path: Path, table: str) -> str:
    """The page with its table made anew, between two comments."""
    text = path.read_text("utf-8")
    begin, end = "<!-- written by make_methods.py -->", "<!-- end -->"
    pattern = f"{re.escape(begin)}.*?{end}"
    assert len(re.findall(pattern, text, re.S)) == 1, f"{path.name} needs one {begin}"
    return re.sub(pattern, lambda _: f"{begin}\n\n{table}\n\n{end}", text, flags=re.S)


def pictures() -> dict[Path, str]:
    asked = {t.name: FIRST_CHOICE.get(t.name, t.name) for t in leapray.traversers()} | MORE
    made = {name: walk_picture(spec) for name, spec in asked.items()} | method_charts.pictures()
    made["aw_accumulate_f32"] = drift_picture()
    return {FOLDER / "pictures" / f"{name}.svg": made[name].source() for name in made}


def outputs() -> dict[Path, str]:
    """All that the script writes."""
    tables = {f"{t.name}.md": registry_table(t) for t in leapray.traversers()}
    tables |= {f"{m.name}.md": image_method_table(m) for m in leapray.image_methods()}
    tables |= {
        "README.md": index_table(),
        "filters.md": filter_table(),
        "images.md": images_table(),
    }
    return pictures() | {FOLDER / name: filled(FOLDER / name, tables[name]) for name in tables}


if __name__ == "__main__":
    sys.exit(generated.write(outputs(), "docs/make_methods.py"))
