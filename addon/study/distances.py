# SPDX-License-Identifier: GPL-3.0-or-later
"""Distance transforms by LeapRay and by others: one function per peer (no bpy).

On one thread the time is what the process used, in turns; scipy and edt are asked for the same
values, which are compared. edt is left out where it is not installed.
"""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

import leapray

from . import page
from .entries import seconds, spread
from .phantom import phantom

SEED = 256
SPARSE = 0.0005  # fraction of marked cells


@dataclass(frozen=True)
class Distance:
    """A method of finding the distances of a field, on one thread."""

    field: str
    size: int  # cells a side
    metric: str
    by: str
    seconds: float  # median
    least: float
    most: float


def fields(size: int) -> dict[str, NDArray[np.bool_]]:
    """(size, size, size) cells, true where distances are 0: much surface, little, a point."""
    point = np.zeros((size, size, size), bool)
    point[size // 2, size // 2, size // 2] = True
    return {
        "spheres": phantom(size, 5) > 0,
        "sparse": np.random.default_rng(SEED).random(point.shape) < SPARSE,
        "one cell": point,
    }


def by_leapray(cells: NDArray[np.bool_], metric: str) -> Callable[[], NDArray]:
    return lambda: leapray.distance(cells, metric, threads=1)


def by_scipy(cells: NDArray[np.bool_], metric: str) -> Callable[[], NDArray] | None:
    """None for chamfer 3-4-5, which it has not; its Euclid is not the peer: edt is faster."""
    kind = {"chessboard": "chessboard", "cityblock": "taxicab"}.get(metric)
    free = ~cells
    return None if kind is None else lambda: ndimage.distance_transform_cdt(free, kind)


def by_edt(cells: NDArray[np.bool_], metric: str) -> Callable[[], NDArray] | None:
    """None but for Euclid, and where edt is not installed."""
    if metric != "euclid" or importlib.util.find_spec("edt") is None:
        return None
    edt, free = importlib.import_module("edt"), (~cells).astype(np.uint8)
    return lambda: edt.edt(free, parallel=1)


PEERS = {"LeapRay": by_leapray, "scipy": by_scipy, "edt": by_edt}


def measure(size: int, rounds: int) -> list[Distance]:
    """Rows of every field, metric and peer. Raises ValueError where peers differ."""
    rows = []
    for field, cells in fields(size).items():
        for metric in leapray.METRICS:
            peers = {by: peer(cells, metric) for by, peer in PEERS.items()}
            methods = {by: run for by, run in peers.items() if run}
            own, *others = (run() for run in methods.values())
            for by, other in zip(list(methods)[1:], others, strict=True):
                capped = other if metric == "euclid" else np.minimum(other, 255)
                if not np.allclose(own, capped, rtol=1e-6):
                    raise ValueError(f"{by} finds other distances, by {metric}")
            taken = seconds(list(methods.values()), rounds)
            for by, each in zip(methods, taken.T, strict=True):
                rows.append(Distance(field, size, metric, by, *spread(each)))
    return rows


def section(rows: list[Distance]) -> list[str]:
    """The part of a page that tells them."""
    table = [
        [
            page.esc(row.field),
            row.metric,
            row.by,
            *(f"{1e3 * each:.1f}" for each in (row.seconds, row.least, row.most)),
        ]
        for row in rows
    ]
    return [
        "<h2>Distance transforms</h2>",
        f"<p>{rows[0].size}³ cells, one thread, milliseconds of the process, in turns. "
        + " ".join(map(page.esc, sentences(rows)))
        + "</p>",
        page.table(["field", "metric", "by", "median", "least", "most"], table),
    ]


def sentences(rows: list[Distance]) -> list[str]:
    """How many times as fast as its peers LeapRay is, over the fields."""
    taken = {(row.field, row.metric, row.by): row.seconds for row in rows}
    said = []
    for metric, by in dict.fromkeys((row.metric, row.by) for row in rows if row.by != "LeapRay"):
        ratios = [
            taken[field, metric, by] / max(taken[field, metric, "LeapRay"], 1e-9)
            for field in dict.fromkeys(row.field for row in rows)
        ]
        said.append(
            f"{metric.capitalize()}: {min(ratios):.1f} to {max(ratios):.1f} times as fast as {by}."
        )
    if not any(row.by == "edt" for row in rows):
        said.append("edt is not installed here.")
    return said
