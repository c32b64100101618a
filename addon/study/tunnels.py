# SPDX-License-Identifier: GPL-3.0-or-later
"""Long rays through tunnels just as wide as themselves (no bpy).

In a large, sparse volume every ray has a tunnel whose cells are those that it pierces by exact
arithmetic, and whose walls are objects: the first cell that a traverser gets wrong along the ray is
an object cell, and it stops there. Only who makes no mistake in thousands of steps comes to the
tunnel's end.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import leapray
from leapray.volume import BRICK

from . import oracle

ACROSS = 12  # mouths of neighbours are a side's twelfth apart, but at least LEAST samples
LEAST = 64
CORNERS = np.array(list(itertools.product((0, 1), repeat=3)))  # of a cell
AROUND = np.array(list(itertools.product((-1, 0, 1, 2), repeat=3)))  # and of its neighbours


@dataclass(frozen=True)
class Tunnels:
    volume: leapray.Volume
    origins: NDArray[np.float64]  # (n, 3)
    directions: NDArray[np.float64]
    ends: NDArray[np.int32]  # (n, 3) the first object cell of each ray
    steps: int  # of the longest


def dig(side: int, seed: int) -> Tunnels:
    """Tunnels from x = 0 to near the far side, in a volume of side^3 samples."""
    rng = np.random.default_rng(seed)
    offset = 0.42 * side  # sideways
    last = int(side - offset - 60)
    mouths = np.array(
        list(itertools.product(range(30, last, max(side // ACROSS, LEAST)), repeat=2)), float
    )
    n = len(mouths)
    starts = np.column_stack([np.full(n, -3.0), mouths + rng.random((n, 2))])
    aside = offset + rng.uniform(-25, 25, (n, 2))
    ends = np.column_stack([np.full(n, side + 3.0), starts[:, 1:] + aside])
    origins = np.round(starts * 2.0**oracle.SHIFT) / 2.0**oracle.SHIFT
    directions = np.round((ends - origins) * 2.0**12)
    paths = []
    for o, d in zip(origins, directions, strict=True):
        whole = oracle.path(o, d, (-1, -1, -1), (side, side, side))
        paths.append(whole[: np.argmax(whole[:, 0] >= side - 4) + 1])
    # Through an edge or a corner there are several walks, and all are right.
    plain = [bool((np.abs(np.diff(path, axis=0)).sum(axis=1) == 1).all()) for path in paths]
    origins, directions = origins[plain], directions[plain]
    paths = list(itertools.compress(paths, plain))
    # Tunnels are far from each other, so that each can be dug for itself.
    walls = [
        np.setdiff1d(corners_of(path[:-1], AROUND, side), corners_of(path[:-1], CORNERS, side))
        for path in paths
    ]
    return Tunnels(
        filled(np.concatenate(walls), side),
        origins,
        directions,
        np.array([path[-1] for path in paths]),
        max(map(len, paths)),
    )


def corners_of(cells: NDArray, offsets: NDArray, side: int) -> NDArray[np.int64]:
    """The samples at these offsets from cells, each once, as numbers: see number_of."""
    samples = (cells[:, None] + offsets.astype(cells.dtype)).reshape(-1, 3)
    inside = (samples >= 0).all(axis=1) & (samples < side).all(axis=1)
    return np.unique(number_of(samples[inside].astype(np.int64), side))


def number_of(samples: NDArray, side: int) -> NDArray[np.int64]:
    """Samples (n, 3) as numbers, those of a brick one after the other."""
    x, y, z = (samples // BRICK).T
    brick = (z * side + y) * side + x
    x, y, z = (samples % BRICK).T
    return brick * BRICK**3 + (z * BRICK + y) * BRICK + x


def filled(numbers: NDArray, side: int) -> leapray.Volume:
    """A volume whose samples of these numbers are 1, and all others 0."""
    builder = leapray.VolumeBuilder((side, side, side), "u8")
    numbers = np.sort(numbers)
    cuts = np.flatnonzero(np.diff(numbers // BRICK**3)) + 1
    for part in np.split(numbers, cuts):
        block = np.zeros(BRICK**3, np.uint8)
        block[part % BRICK**3] = 255
        brick = int(part[0]) // BRICK**3
        origin = [BRICK * n for n in (brick % side, brick // side % side, brick // side**2)]
        room = [min(side - first, BRICK) for first in reversed(origin)]
        block = block.reshape(BRICK, BRICK, BRICK)
        builder.put(origin, block[: room[0], : room[1], : room[2]])
    return leapray.Volume.from_handle(builder.release())
