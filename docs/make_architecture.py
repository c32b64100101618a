# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the pictures of docs/architecture.md and write its lists of modules, from the sources.

    python docs/make_architecture.py            writes them
    python docs/make_architecture.py --check    fails where one of them is not current

Dependencies are read from imports and includes; a Python module's line is the first of its
docstring. Only what the C modules hold, and what the data flow is, is said here.
"""

from __future__ import annotations

import ast
import itertools
import re
import sys
from pathlib import Path

import generated
from dependencies import ROOT, Graph, c_modules, grouped, python_modules, ranks, reduced
from svg import BLUE, GREEN, GREY, INK, ORANGE, Picture

PAGE = ROOT / "docs" / "architecture.md"
PICTURES = ROOT / "docs" / "architecture"

C_MODULES = {
    "base": "errors, vectors, affine maps, SIMD operations, processor features, large arrays",
    "grid": "bricks of samples, cell classes, interpolation, triangle cells, merging, files",
    "grid/attributes": "what the nearest triangle gives a hit: colours, textures, smooth normals",
    "mesh": "triangles alone: topology, islands, closest triangle, winding number, sign",
    "distance": "distance transforms of cells, and how far it is empty around a cell",
    "voxelize": "from a mesh to samples: filters, inside and outside, bricks as parallel jobs",
    "trace": "rays, the registry, the walk template, hit tests, roots, hit records, triangle trees",
    "traversers": "one file per traverser: its structure, and its walk to the next surface cell",
    "imaging": "whole-image methods, a file each, and their registry",
    "render/film": "cameras, pixel filters, sampling patterns, sums over samples",
    "render/bsdf": "materials as lobes: evaluation, sampling, tables of directional albedo",
    "render/lights": "light sources, the environment, the tree that selects among lights",
    "render/scene": "instances under a bounding volume hierarchy",
    "render/integrator": "the path tracer: queues, intersection, shading, direct light, passes",
}

# The packages of the add-on that the picture shows as one box each.
PACKAGES = ("blender", "plan", "store", "study")


def package_text(graph: Graph) -> Graph:
    """Without the __init__ of packages, which only put names together."""
    kept = {name for name in graph if not name.endswith("__init__")}
    return {name: graph[name] & kept for name in sorted(kept)}


def core() -> Graph:
    return package_text(python_modules(ROOT / "native" / "leapray"))


def addon() -> Graph:
    return package_text(python_modules(ROOT / "addon"))


# ---- the picture of the modules --------------------------------------------------

ROW, BOX, GAP = 64, 24, 12


class Layout:
    """Boxes in rows by rank; an edge over several rows takes a place in each between."""

    def __init__(self, graph: Graph) -> None:
        edges = reduced(graph)
        self.rank = ranks(graph)
        self.chains: list[list[str]] = []  # from the user down to what it uses
        self.rows: list[list[str]] = [[] for _ in range(max(self.rank.values()) + 1)]
        for name, rank in sorted(self.rank.items()):
            self.rows[rank].append(name)
        for name in sorted(edges):
            for target in sorted(edges[name]):
                between = range(self.rank[name] - 1, self.rank[target], -1)
                chain = [name, *(f"{name}>{target}>{row}" for row in between), target]
                for row, place in zip(between, chain[1:-1], strict=True):
                    self.rows[row].append(place)
                self.chains.append(chain)
        self._sort()

    def _sort(self) -> None:
        """Order each row by the mean place of its neighbours, a few times up and down."""
        ends: dict[str, list[str]] = {}
        for chain in self.chains:
            for upper, lower in itertools.pairwise(chain):
                ends.setdefault(upper, []).append(lower)
                ends.setdefault(lower, []).append(upper)
        for _ in range(12):
            for rows in (self.rows, self.rows[::-1]):
                for row in rows:
                    at = {n: (i + 0.5) / len(r) for r in self.rows for i, n in enumerate(r)}
                    near = {n: [at[e] for e in ends.get(n, [n])] for n in row}
                    row.sort(key=lambda n: (sum(near[n]) / len(near[n]), n))

    def draw(self, picture: Picture, x: float, y: float, width: float, colour: str) -> None:
        """Into a panel: what uses nothing lies at the bottom."""
        places: dict[str, tuple[float, float, float]] = {}  # middle, upper edge, width
        for rank, row in enumerate(self.rows):
            sides = [0.0 if ">" in name else 14 + 6.6 * len(name) for name in row]
            gap = (width - sum(sides)) / (len(row) + 1)
            left = x + gap
            for name, side in zip(row, sides, strict=True):
                top = y + (len(self.rows) - 1 - rank) * ROW
                places[name] = (left + side / 2, top, side)
                left += side + gap
        for chain in self.chains:
            points: list[tuple[float, float]] = []
            for name in chain:
                middle, top, _ = places[name]
                ends = {chain[0]: [top + BOX], chain[-1]: [top]}
                points += [(middle, at) for at in ends.get(name, [top, top + BOX])]
            picture.line(points, GREY, arrow=True, bend=True)
        for name, (middle, top, side) in places.items():
            if side:
                picture.rect(middle - side / 2, top, side, BOX, "#ffffff", colour, round=4)
                picture.text(middle, top + 16, name, size=12)


def modules_picture() -> Picture:
    c = grouped(c_modules(), {"grid/attributes": "grid"})
    outside = grouped(addon(), {name: name for name in PACKAGES})
    panels = [
        ("native/src (C)", c, 370.0, BLUE),
        ("native/leapray (Python)", core(), 300.0, GREEN),
        ("addon (Python)", outside, 250.0, ORANGE),
    ]
    layouts = [(title, Layout(graph), width, colour) for title, graph, width, colour in panels]
    rows = max(len(layout.rows) for _, layout, _, _ in layouts)
    picture = Picture(sum(p[2] for p in panels) + 4 * GAP, rows * ROW + 56)
    x = float(GAP)
    for title, layout, width, colour in layouts:
        picture.rect(x, GAP, width, rows * ROW + 32, "#fafafa", "#dddddd", round=6)
        picture.text(x + width / 2, GAP + 20, title, size=13, bold=True, fill=colour)
        layout.draw(picture, x, GAP + 40 + (rows - len(layout.rows)) * ROW, width, colour)
        x += width + GAP
    return picture


# ---- the picture of the data flow ------------------------------------------------

# A box: column, row, its lines (the first in bold), its colour.
FLOW = {
    "scene": (0, 0, ["Blender's scene", "evaluated depsgraph"], ORANGE),
    "read": (0, 1, ["read", "addon/blender/read"], ORANGE),
    "model": (0, 2, ["plain arrays", "addon/model.py: Scene"], ORANGE),
    "plan": (1, 2, ["plan", "addon/plan: voxel sizes"], ORANGE),
    "voxelize": (1, 1, ["voxelize", "mesh to samples"], BLUE),
    "build": (2, 1, ["build", "samples to structure"], BLUE),
    "tile": (2, 2, ["render tile", "rays, hits, shading"], BLUE),
    "result": (3, 2, ["result", "passes and report"], ORANGE),
    "out": (3, 1, ["Blender, files", "blender/result, cli"], ORANGE),
    "study": (3, 0, ["study, compare", "charts and tables"], ORANGE),
    "store": (1, 0, ["store", "volumes and errors kept"], ORANGE),
}
# From, to, what passes.
ARROWS = [
    ("scene", "read", ""),
    ("read", "model", ""),
    ("model", "plan", "meshes"),
    ("plan", "voxelize", "a size"),
    ("voxelize", "plan", "error"),
    ("voxelize", "build", "volume"),
    ("build", "tile", "structures"),
    ("tile", "result", "tiles"),
    ("result", "out", ""),
    ("out", "study", ""),
    ("voxelize", "store", ""),
    ("store", "voxelize", ""),
]
COLUMN, STEP, WIDE, HIGH = 215, 96, 152, 46


def flow_picture() -> Picture:
    picture = Picture(3 * COLUMN + WIDE + 2 * GAP, 2 * STEP + HIGH + 2 * GAP + 42)

    def corner(name: str) -> tuple[float, float]:
        return GAP + FLOW[name][0] * COLUMN, GAP + FLOW[name][1] * STEP

    both = {(b, a) for a, b, _ in ARROWS} & {(a, b) for a, b, _ in ARROWS}
    for source, target, words in ARROWS:
        (x0, y0), (x1, y1) = corner(source), corner(target)
        if y0 == y1:
            y = y0 + HIGH / 2
            picture.line([(x0 + WIDE, y), (x1, y)], GREY, width=1.4, arrow=True)
            picture.text((x0 + WIDE + x1) / 2, y - 6, words, size=11, fill="#555555")
            continue
        down = y1 > y0
        x = x0 + WIDE / 2 + (0 if (source, target) not in both else 14 if down else -14)
        ends = [(x, y0 + HIGH), (x, y1)] if down else [(x, y0), (x, y1 + HIGH)]
        picture.line(ends, GREY, width=1.4, arrow=True)
        side = "start" if down else "end"
        if (source, target) not in both:
            side = "start"
        shift = 6 if side == "start" else -6
        middle = (ends[0][1] + ends[1][1]) / 2 + 4
        picture.text(x + shift, middle, words, size=11, fill="#555555", anchor=side)
    for name, (_, _, lines, colour) in FLOW.items():
        x, y = corner(name)
        picture.rect(x, y, WIDE, HIGH, "#ffffff", colour, round=5, width=1.4)
        picture.text(x + WIDE / 2, y + 19, lines[0], size=13, bold=True)
        picture.text(x + WIDE / 2, y + 36, lines[1], size=11, fill="#555555")
    y = picture.height - 14
    for x, colour, words in (
        (GAP, ORANGE, "Python, the add-on"),
        (GAP + 160, BLUE, "C, the core, called through native/leapray; worker threads"),
    ):
        picture.rect(x, y - 10, 12, 12, "#ffffff", colour, round=2, width=1.4)
        picture.text(x + 18, y, words, size=11, fill=INK, anchor="start")
    return picture


# ---- the lists of modules --------------------------------------------------------


def first_line(path: Path) -> str:
    """The first sentence of a module's docstring, without its full stop."""
    text = ast.get_docstring(ast.parse(path.read_text("utf-8"))) or ""
    line = " ".join(text.split("\n\n")[0].split())
    return line.replace(" (no bpy)", "").rstrip(".")


def c_list() -> str:
    assert set(C_MODULES) == set(c_modules()), set(C_MODULES) ^ set(c_modules())
    rows = ((f"`{name}`", words) for name, words in C_MODULES.items())
    return generated.table(("module", "holds"), rows)


def python_list(package: Path, graph: Graph) -> str:
    rows = []
    for name in sorted(graph, key=lambda n: (n.count(".") > 0, n)):
        path = Path(*name.split(".")).with_suffix(".py")
        rows.append((f"`{path.as_posix()}`", first_line(package / path)))
    return generated.table(("module", "its first line"), rows)


def page(text: str) -> str:
    """The page with its lists made anew, each between a comment and a blank line."""
    lists = {
        "native/src": c_list(),
        "native/leapray": python_list(ROOT / "native" / "leapray", core()),
        "addon": python_list(ROOT / "addon", addon()),
    }
    for name, rows in lists.items():
        begin, end = f"<!-- {name}: written by make_architecture.py -->", "<!-- end -->"
        pattern = f"{re.escape(begin)}.*?{end}"
        assert len(re.findall(pattern, text, re.S)) == 1, f"the page needs one {begin}"
        made = f"{begin}\n\n{rows}\n\n{end}"
        text = re.sub(pattern, lambda _, made=made: made, text, flags=re.S)
    return text


def outputs() -> dict[Path, str]:
    """All that the script writes."""
    return {
        PICTURES / "data_flow.svg": flow_picture().source(),
        PICTURES / "modules.svg": modules_picture().source(),
        PAGE: page(PAGE.read_text("utf-8")),
    }


if __name__ == "__main__":
    sys.exit(generated.write(outputs(), "docs/make_architecture.py"))
