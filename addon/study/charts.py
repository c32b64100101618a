# SPDX-License-Identifier: GPL-3.0-or-later
"""One style for all charts and pictures of studies (no bpy)."""

from __future__ import annotations

import contextlib
import io
import os
import platform
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, TypeVar

import matplotlib
import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter
from numpy.typing import NDArray

from .. import pipeline
from ..arrays import LUMINANCE, from_srgb

Item = TypeVar("Item")

# Okabe and Ito's colours, told apart by the colour-blind too; black stays for references.
COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#7F7F7F", "#B8A800")
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")
INK, FAINT = "#222222", "#DDDDDD"
CYAN = 0, 190, 220
STYLE: dict[Any, Any] = {
    "font.family": "sans-serif",
    "font.size": 10.5,
    "axes.titlesize": 12,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titlepad": 12,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": FAINT,
    "grid.linewidth": 0.8,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "lines.linewidth": 1.8,
    "lines.markersize": 6,
    "legend.frameon": False,
    "legend.handlelength": 2.8,  # a dashed line shows its dashes
    "legend.markerscale": 1.2,
    "svg.fonttype": "none",
    "svg.hashsalt": "leapray",  # the same data give the same file
    "figure.facecolor": "white",
}


def look(k: int) -> dict[str, str]:
    """Colour, marker and line of the k-th series; after a round the lines are dashed."""
    rounds, place = divmod(k, len(COLORS))
    return {
        "color": COLORS[place],
        "marker": MARKERS[(place + rounds) % len(MARKERS)],
        "linestyle": ("-", "--", ":", "-.")[rounds % 4],
    }


def ink_on(color: tuple[float, ...]) -> str:
    """Dark or white, whichever is better to read on that colour.

    Source: the contrast ratio of the Web Content Accessibility Guidelines 2.
    """
    luminance = float(np.dot(from_srgb(np.array(color[:3], np.float32)), LUMINANCE))
    dark = 0.0159  # of INK
    return INK if (luminance + 0.05) ** 2 > (dark + 0.05) * 1.05 else "#FFFFFF"


@contextlib.contextmanager
def chart(
    path: Path, *, rows: int = 1, columns: int = 1, width: float = 7.2, height: float = 4.4
) -> Iterator[tuple[Figure, NDArray]]:
    """A figure with its axes (rows, columns), written as path.svg and path.png at the end."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(width * columns, height * rows), layout="constrained")
        axes = figure.subplots(rows, columns, squeeze=False)
        yield figure, axes
        figure.text(1.0, 1.01, machine(), ha="right", va="bottom", fontsize=8, color="#777777")
        for ending in (".svg", ".png"):
            figure.savefig(
                path.with_suffix(ending),
                dpi=144,
                bbox_inches="tight",
                metadata={"Date": None} if ending == ".svg" else None,
            )


def bars(axis, names: Sequence[str], seconds: Sequence[float]) -> None:
    """A bar with its number for each name, from above."""
    place = np.arange(len(names))
    axis.barh(place, seconds, color=COLORS[0], height=0.6)
    for y, value in zip(place, seconds, strict=True):
        axis.text(value, y, f" {value:.3g}", va="center", fontsize=9)
    axis.set_yticks(place, names)
    axis.invert_yaxis()


def grouped(rows: Iterable[Item], key: Callable[[Item], str]) -> dict[str, list[Item]]:
    """The rows of every series, in the order in which they come."""
    found: dict[str, list[Item]] = {}
    for row in rows:
        found.setdefault(key(row), []).append(row)
    return found


def plain_ticks(axis) -> None:
    """Label logarithmic scales by 1, 2 and 5 of each power, in plain decimals."""
    for scale in (axis.xaxis, axis.yaxis):
        if scale.get_scale() == "log":
            scale.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            scale.set_major_formatter(lambda value, _: f"{value:g}")
            scale.set_minor_formatter(NullFormatter())


def machine() -> str:
    """The processor and the system, for a chart's corner."""
    system = f"{platform.system()} {platform.machine()}"
    return f"{pipeline.cpu()}, {os.cpu_count()} logical cores, {system}"


# ---- pictures ------------------------------------------------------------


def picture(values: NDArray, low: float, high: float, colors: str = "inferno") -> NDArray[np.uint8]:
    """Values (height, width) in false colours between low and high; what is not finite is grey."""
    fraction = (np.asarray(values, np.float64) - low) / ((high - low) or 1.0)
    rgb = colormaps[colors](np.nan_to_num(np.clip(fraction, 0, 1)))[..., :3]
    rgb[~np.isfinite(values)] = 0.82
    return as_bytes(rgb)


def errors(values: NDArray, most: float, differ: NDArray) -> NDArray[np.uint8]:
    """Errors in false colours, the brightest at most; nothing grey; cyan where pixels differ."""
    image = picture(values, 0.0, most)
    image[differ] = CYAN
    return image


def labels(index: NDArray, edges: NDArray | None = None) -> NDArray[np.uint8]:
    """Indices in colours of their own; 0 is white."""
    palette = np.array([matplotlib.colors.to_rgb(color) for color in COLORS])
    index = np.asarray(index)
    # Each round through the palette is paler than the one before.
    fade = ((index - 1) // len(palette) % 4)[..., None] * 0.2
    rgb = palette[(index - 1) % len(palette)] * (1 - fade) + fade
    rgb[index == 0] = 1.0
    if edges is not None:
        rgb[edges] = 0.0
    return as_bytes(rgb)


def as_bytes(rgb: NDArray[np.floating]) -> NDArray[np.uint8]:
    return np.rint(np.clip(rgb, 0, 1) * 255).astype(np.uint8)


def png(image: NDArray[np.uint8]) -> bytes:
    """A picture (height, width, 3), rows from below, as the bytes of a PNG file."""
    from PIL import Image

    file = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(image[::-1])).save(file, "PNG", optimize=True)
    return file.getvalue()
