# SPDX-License-Identifier: GPL-3.0-or-later
"""Sparse grids made of sparse grids: coarser, or smoother, without the space between leaves.

What a filter makes alike becomes a tile, or background again, and takes no memory.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ._lib import LeapRayError, Stopped, Watch
from .file_samples import Samples, Spool
from .scalar_grid import LEAF, Leaves
from .threads import run_parts

CHUNK = 1024  # leaves that are filled at a time
SCATTERED = 4  # times as many leaves that are read at once rather than one by one
BLOCK = 4  # leaves along a block that is smoothed at a time, at least
MOST = 1 << 21  # leaves that a filter may touch: a billion samples

Numbers = Callable[[NDArray], NDArray[np.floating]]  # a block as floats, NaN where none is known


def _rows(samples: Samples, chosen: NDArray[np.intp]) -> NDArray:
    """Some leaves, in any order."""
    if isinstance(samples, np.ndarray):
        return samples[chosen]
    first, last = int(chosen.min()), int(chosen.max()) + 1
    if last - first <= SCATTERED * len(chosen):
        return samples[first:last][chosen - first]
    return np.stack([samples[int(k)] for k in chosen])


# ---- fewer samples -----------------------------------------------------------------------------


def halved(leaves: Leaves, numbers: Numbers, dtype: np.dtype, watch: Watch) -> Leaves:
    """Means of cubes of eight samples, of those that are known, in leaves that hold up to eight of
    the finer ones; tiles as large as a leaf become parts of leaves, too."""
    half = LEAF // 2
    odd = (leaves.tile_sizes // 2 % LEAF != 0) | (leaves.tile_origins // 2 % LEAF != 0).any(axis=1)
    leaves = _with_small_tiles(leaves, odd & (leaves.tile_sizes > LEAF))
    small = leaves.tile_sizes == LEAF
    origins = np.concatenate([leaves.origins, leaves.tile_origins[small]]) // 2
    homes, which = np.unique(origins // LEAF * LEAF, axis=0, return_inverse=True)
    which = which.ravel()
    order = np.argsort(which, kind="stable")
    starts = np.searchsorted(which[order], np.arange(len(homes) + 1))
    values = numbers(leaves.tile_values[small].astype(leaves.samples.dtype))
    n_leaves, spool = len(leaves.origins), Spool((len(homes), LEAF, LEAF, LEAF), dtype)
    for first in range(0, len(homes), CHUNK):
        if watch.stopped:
            raise Stopped("resampling was stopped")
        last = min(first + CHUNK, len(homes))
        members = order[starts[first] : starts[last]]
        made = np.full((last - first, 2, half, 2, half, 2, half), leaves.background, dtype)
        i, j, k = (origins[members] // half % 2).T
        home, of_leaf = which[members] - first, members < n_leaves
        parts = np.empty((len(members), half, half, half), dtype)
        if of_leaf.any():
            parts[of_leaf] = _of_eight(numbers(_rows(leaves.samples, members[of_leaf])))
        parts[~of_leaf] = values[members[~of_leaf] - n_leaves, None, None, None]
        made[home, k, :, j, :, i, :] = parts
        spool[first:last] = made.reshape(-1, LEAF, LEAF, LEAF)
    return Leaves(
        homes.astype(np.int32),
        spool.samples(),
        leaves.background,
        leaves.tile_origins[~small] // 2,
        leaves.tile_sizes[~small] // 2,
        leaves.tile_values[~small],
    )


def _with_small_tiles(leaves: Leaves, which: NDArray[np.bool_]) -> Leaves:
    """With some tiles cut into those as large as a leaf."""
    origins, values = [leaves.tile_origins[~which]], [leaves.tile_values[~which]]
    for at in np.flatnonzero(which):
        steps = np.array(list(np.ndindex((int(leaves.tile_sizes[at]) // LEAF,) * 3)))
        origins.append(leaves.tile_origins[at] + LEAF * steps)
        values.append(np.full(len(steps), leaves.tile_values[at]))
    kept = leaves.tile_sizes[~which]
    sizes = np.full(sum(map(len, origins)), LEAF)
    sizes[: len(kept)] = kept
    return replace(
        leaves,
        tile_origins=np.concatenate(origins).astype(np.int32),
        tile_sizes=sizes.astype(np.int32),
        tile_values=np.concatenate(values),
    )


def _of_eight(block: NDArray[np.floating]) -> NDArray[np.floating]:
    """Means of cubes of eight samples that are known; NaN where none is."""
    known = ~np.isnan(block)
    cubes = (len(block),) + (LEAF // 2, 2) * 3
    with np.errstate(all="ignore"):
        total = np.where(known, block, 0).reshape(cubes).sum(axis=(2, 4, 6), dtype=np.float64)
        return total / known.reshape(cubes).sum(axis=(2, 4, 6))


# ---- smoother ----------------------------------------------------------------------------------


def smoothed(
    leaves: Leaves,
    numbers: Numbers,
    dtype: np.dtype,
    weights: NDArray[np.float64],
    convolve: Callable[[NDArray, NDArray, int], NDArray],
    threads: int,
    watch: Watch,
) -> Leaves:
    """The field convolved by weights along each axis, wherever it is not alike all around.

    weights: of samples 0, 1 ... away. convolve(block, weights, axis). Raises LeapRayError
    where that would be too many leaves, Stopped.
    """
    reach = len(weights) - 1
    table = _Table(leaves, -(-reach // LEAF))
    places = table.touched()
    side = max(BLOCK, 2 * table.around)
    blocks, which = np.unique(places // side, axis=0, return_inverse=True)
    order = np.argsort(which.ravel(), kind="stable")
    starts = np.searchsorted(which.ravel()[order], np.arange(len(blocks) + 1))
    out = _Output(len(places), dtype, leaves.background)

    def smooth_block(n: int, _: int) -> None:
        if watch.stopped:
            return
        block = numbers(table.block(blocks[n] * side - table.around, side + 2 * table.around))
        known = ~np.isnan(block)
        most = np.finfo(dtype).max
        mean = np.clip(np.where(known, block, 0), -most, most)
        share = None if known.all() else known.astype(np.float32)
        own = slice(LEAF * table.around, LEAF * (table.around + side))
        for axis in range(3):
            cut = tuple(own if a == axis else slice(None) for a in range(3))
            mean = convolve(mean, weights, axis)[cut]
            share = None if share is None else convolve(share, weights, axis)[cut]
        if share is not None:
            with np.errstate(all="ignore"):
                mean = np.where(known[own, own, own], mean / share, np.nan)
        inside = places[order[starts[n] : starts[n + 1]]]
        x, y, z = (inside - blocks[n] * side).T
        split = mean.reshape((side, LEAF) * 3)
        out.add(inside, split[z, :, y, :, x, :])

    run_parts(smooth_block, len(blocks), 1, threads, watch)
    if watch.stopped:
        raise Stopped("smoothing was stopped")
    return out.leaves(*table.untouched())


@dataclass
class _Table:
    """Leaves and tiles by their places, in leaves; around: how far each reaches."""

    source: Leaves
    around: int

    def __post_init__(self) -> None:
        leaves = self.source
        small = leaves.tile_sizes == LEAF
        self.large = leaves.tile_origins[~small] // LEAF, leaves.tile_sizes[~small] // LEAF
        self.large_values = leaves.tile_values[~small]
        self.small_values = leaves.tile_values[small]
        self.places = np.concatenate([leaves.origins, leaves.tile_origins[small]]) // LEAF
        corners = [self.places, self.large[0], self.large[0] + self.large[1][:, None]]
        every = np.concatenate([*corners, np.zeros((1, 3), np.int64)]).astype(np.int64)
        self.low = every.min(axis=0) - 4 * self.around - BLOCK
        self.size = every.max(axis=0) + 4 * self.around + BLOCK + 2 - self.low
        keys = self._keys(self.places)
        self.order = np.argsort(keys)
        self.keys = keys[self.order]

    def _keys(self, places: NDArray) -> NDArray[np.int64]:
        x, y, z = (np.asarray(places, np.int64) - self.low).T
        return (z * self.size[1] + y) * self.size[0] + x

    def touched(self) -> NDArray[np.int64]:
        """Places around leaves, small tiles, and the borders of large tiles."""
        found = self.keys
        strides = 1, int(self.size[0]), int(self.size[0] * self.size[1])
        for stride in strides:
            steps = stride * np.arange(-self.around, self.around + 1)
            found = np.unique((found[:, None] + steps).ravel())
            self._check(len(found))
        shells = [self._keys(self._shell(o, n)) for o, n in zip(*self.large, strict=True)]
        found = np.unique(np.concatenate([found, *shells]))
        self._check(len(found))
        z, rest = np.divmod(found, strides[2])
        y, x = np.divmod(rest, strides[1])
        return np.stack([x, y, z], axis=-1) + self.low

    def _shell(self, origin: NDArray, n: int) -> NDArray[np.int64]:
        """Places as near to the border of a cube of n^3 as filters reach, on either side."""
        self._check(6 * int(n) ** 2 * 2 * self.around)
        axis = np.arange(-self.around, n + self.around)
        inner = (axis >= self.around) & (axis < n - self.around)
        found = []
        for z, is_inner in zip(axis, inner, strict=True):
            y, x = np.nonzero(~(inner[:, None] & inner) | (not is_inner))
            found.append(np.stack([axis[x], axis[y], np.full(len(x), z)], axis=-1))
        return np.concatenate(found) + origin

    def _check(self, n: int) -> None:
        if n > MOST:
            raise LeapRayError(f"{n} leaves are too many to be smoothed; {MOST} are possible")

    def block(self, first: NDArray[np.int64], side: int) -> NDArray:
        """The stored numbers of side^3 leaves from a place on, z, y, x."""
        leaves = self.source
        dtype = np.result_type(leaves.samples.dtype, leaves.tile_values.dtype)
        block = np.full((side, LEAF) * 3, leaves.background, dtype)
        z, y, x = np.indices((side,) * 3).reshape(3, -1)
        keys = self._keys(np.stack([x, y, z], axis=-1) + first)
        at = np.minimum(np.searchsorted(self.keys, keys), len(self.keys) - 1)
        for origin, n, value in zip(*self.large, self.large_values, strict=True):
            lo, hi = np.maximum(origin - first, 0), np.minimum(origin + n - first, side)
            if (lo < hi).all():
                cut = [s for a in (2, 1, 0) for s in (slice(lo[a], hi[a]), slice(None))]
                block[tuple(cut)] = value
        if len(self.keys):
            there = self.keys[at] == keys
            entries, x, y, z = self.order[at[there]], x[there], y[there], z[there]
            of_leaf = entries < len(leaves.origins)
            if of_leaf.any():
                rows = _rows(leaves.samples, entries[of_leaf])
                block[z[of_leaf], :, y[of_leaf], :, x[of_leaf], :] = rows
            values = self.small_values[entries[~of_leaf] - len(leaves.origins)]
            block[z[~of_leaf], :, y[~of_leaf], :, x[~of_leaf], :] = values[:, None, None, None]
        return block.reshape((side * LEAF,) * 3)

    def untouched(self) -> tuple[NDArray, NDArray, NDArray]:
        """Origins, sizes and values of tiles that fill what large tiles have within."""
        found: list[tuple[NDArray, int, float]] = []
        for origin, n, value in zip(*self.large, self.large_values, strict=True):
            lo, hi = self.around, int(n) - self.around
            todo = [(np.zeros(3, np.int64), int(n))]
            while todo:
                place, side = todo.pop()
                if (place >= lo).all() and (place + side <= hi).all():
                    found.append((LEAF * (place + origin), LEAF * side, value))
                elif (place < hi).all() and (place + side > lo).all() and side > 1:
                    each = side // 2 if side % 2 == 0 else 1
                    steps = np.array(list(np.ndindex((side // each,) * 3))) * each
                    todo += [(place + step, each) for step in steps]
        origins = np.array([each[0] for each in found], np.int64).reshape(-1, 3)
        sizes = np.array([each[1] for each in found], np.int32)
        return origins, sizes, np.array([each[2] for each in found], np.float64)


class _Output:
    """Leaves that are found block by block; those that are alike are tiles."""

    def __init__(self, n: int, dtype: np.dtype, background: float) -> None:
        self.background = background
        self.spool, self.n = Spool((n, LEAF, LEAF, LEAF), dtype), 0
        self.origins: list[NDArray] = []
        self.tiles: list[tuple[NDArray, NDArray]] = []
        self.lock = threading.Lock()

    def add(self, places: NDArray, samples: NDArray) -> None:
        values = samples[:, 0, 0, 0]
        alike = (samples == values[:, None, None, None]).all(axis=(1, 2, 3))
        rounding = 8 * float(np.finfo(samples.dtype).eps) * abs(self.background)
        told = alike & (np.abs(values - self.background) > rounding)
        kept = samples[~alike]
        with self.lock:
            first, self.n = self.n, self.n + len(kept)
            self.origins.append(LEAF * places[~alike])
            self.tiles.append((LEAF * places[told], values[told]))
        if len(kept):
            self.spool[first : first + len(kept)] = kept

    def leaves(self, origins: NDArray, sizes: NDArray, values: NDArray) -> Leaves:
        """With tiles beside."""
        small = np.concatenate([each[1] for each in self.tiles] or [np.empty(0)])
        return Leaves(
            np.concatenate([*self.origins, np.empty((0, 3))]).astype(np.int32),
            self.spool.samples(self.n),
            self.background,
            np.concatenate([*(each[0] for each in self.tiles), origins]).astype(np.int32),
            np.concatenate([np.full(len(small), LEAF), sizes]).astype(np.int32),
            np.concatenate([small, values]),
        )
