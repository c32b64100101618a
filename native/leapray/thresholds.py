# SPDX-License-Identifier: GPL-3.0-or-later
"""How the values of a scalar field are spread, and which one is a surface worth seeing first."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ._lib import LeapRayError, Stopped, Watch
from .scalar_grid import Leaves, ScalarGrid
from .threads import check_threads, run_parts

T = TypeVar("T")

BLOCK = 1 << 19  # samples that are counted at a time, which fit the processor's cache
CACHED = 1 << 16  # numbers whose bins are found at a time
FIRST = 1 << 14  # bins of the whole range; more would cost more than the samples
FINE = 4096  # bins in which thresholds are sought
ZOOMS = 10  # times at most that a histogram is counted again where most samples are
TAIL = 1e-4  # share of samples at either end that may be artefacts, as of metal
WIDTH = 4.0  # half-widths at half the height up to which a peak's noise reaches: 4.7 deviations
FOOT = 0.1  # of a peak's height, below which a count is no longer of the peak's middle
RARE = 1e-5  # share of samples beyond the background that are no second class
AIR = -1024.0  # HU, below which scanners write what they did not measure


@dataclass(frozen=True)
class Histogram:
    """How many samples have which values.

    edges: (n + 1), of the bins, in the units of the field's values, rising. counts: (n).
    n_none: samples without a value.
    """

    edges: NDArray[np.float64]
    counts: NDArray[np.int64]
    n_none: int = 0


def histogram(
    grid: ScalarGrid,
    bins: int = 256,
    limits: tuple[float, float] | None = None,
    *,
    threads: int = 0,
    watch: Watch | None = None,
) -> Histogram:
    """Count the samples of a grid by their values.

    bins: at most so many; of whole numbers each bin holds as many as the others, so that
    there may be fewer. limits: values beyond which samples are left out; those of the field
    without. Samples without a value, and those of a sparse grid outside its leaves and tiles,
    are not counted. threads: 0, all cores. watch stops the call by Stopped.
    Raises LeapRayError for a field without values, and for limits that do not rise.
    """
    check_threads(threads)
    if bins < 1:
        raise LeapRayError(f"a histogram needs a bin or more, not {bins}")
    if limits is not None and not (np.isfinite(limits).all() and limits[0] < limits[1]):
        raise LeapRayError(f"limits must be finite and rise; they are {limits}")
    parts = _Parts(grid, threads, watch or Watch())
    lo, hi, n_valued = parts.range_of_stored()
    if n_valued == 0:
        raise LeapRayError(f"{_about(grid)} holds no sample with a value")
    if limits is not None:
        ends = sorted((value - grid.offset) / grid.scale for value in limits)
        lo, hi = max(lo, ends[0]), min(hi, ends[1])
        if lo > hi:
            raise LeapRayError(f"{_about(grid)} has no values from {limits[0]:g} to {limits[1]:g}")
    edges = _edges(lo, hi, bins, parts.whole)
    counts = parts.count(edges)
    values = grid.offset + grid.scale * edges
    if grid.scale < 0:
        values, counts = values[::-1], counts[::-1]
    return Histogram(values, counts, parts.size - n_valued)


def first_threshold(
    grid: ScalarGrid, *, threads: int = 0, watch: Watch | None = None
) -> tuple[float, str]:
    """A value of a grid whose surface is likely to show something, and how it was found.

    The second is a sentence. The value is 0 for a level set, 0.5 for labels (all regions), for
    fog half the mean of what is not empty. Otherwise it is Otsu's threshold; where that lies
    inside the peak of a background that is far larger than the object, the lowest point between
    that peak and the rest. Values of computed tomography below -1024 HU, and the outermost
    0.01 % of others, do not count.
    threads: 0, all cores. watch stops the call by Stopped. Raises LeapRayError where the field
    has no values or only one.
    Source: Otsu 1979.
    """
    if grid.kind == "level set":
        return 0.0, "the surface of a level set is at 0"
    if grid.kind == "labels":
        return 0.5, "all that has a label"
    fine = histogram(grid, FIRST, threads=threads, watch=watch)
    middles = (fine.edges[:-1] + fine.edges[1:]) / 2
    dense = np.where(fine.edges[:-1] > 0, fine.counts, 0)
    if grid.kind == "fog" and dense.any():
        mean = float((dense * middles).sum() / dense.sum())
        return mean / 2, f"half the mean density of what is not empty, {mean:.3g}"
    if np.count_nonzero(fine.counts) < 2:
        return _from_background(grid, float(middles[np.argmax(fine.counts)]))
    inner = _without_tails(grid, fine)
    for _ in range(ZOOMS):
        if len(inner.counts) >= FINE // 8 or _is_whole(grid, fine):
            break
        ends = float(inner.edges[0]), float(inner.edges[-1])  # a few values lie far out
        fine = histogram(grid, FIRST, ends, threads=threads, watch=watch)
        inner = _without_tails(grid, fine)
    return _between_classes(inner if np.count_nonzero(inner.counts) > 1 else fine)


def _from_background(grid: ScalarGrid, value: float) -> tuple[float, str]:
    """A threshold for a field whose samples all have that value."""
    samples = grid.samples
    if isinstance(samples, Leaves):
        around = grid.offset + grid.scale * samples.background
        if not math.isclose(around, value, rel_tol=1e-5):
            return (around + value) / 2, "midway between the one value and the background"
    raise LeapRayError(f"{_about(grid)} has the same value everywhere, about {value:g}")


def _about(grid: ScalarGrid) -> str:
    return grid.source or f"the grid {grid.name!r}"


# ---- counting ----------------------------------------------------------------------


class _Parts:
    """The stored numbers of a grid, by blocks."""

    def __init__(self, grid: ScalarGrid, threads: int, watch: Watch) -> None:
        self.grid, self.threads, self.watch = grid, threads, watch
        samples = grid.samples
        self.tiles: tuple[NDArray, NDArray] = (np.empty(0), np.empty(0, np.int64))
        if isinstance(samples, Leaves):
            self.tiles = samples.tile_values, samples.tile_sizes.astype(np.int64) ** 3
            samples = samples.samples
        self.samples = samples
        self.size = samples.size + int(self.tiles[1].sum())
        self.whole = samples.dtype.kind in "iu"
        self.each = self.count_each() if self.whole and samples.dtype.itemsize < 4 else None

    def run(self, part: Callable[[NDArray], T]) -> list[T]:
        """part(numbers) of all blocks of samples, on threads."""
        slab = max(BLOCK // max(math.prod(self.samples.shape[1:]), 1), 1)

        def rows(first: int, last: int) -> T | None:
            return part(self.samples[first:last]) if not self.watch.stopped else None

        found = run_parts(rows, len(self.samples), slab, self.threads, self.watch)
        if self.watch.stopped:
            raise Stopped("the count of samples was stopped")
        return [item for item in found if item is not None]

    def total(self, part: Callable[[NDArray], NDArray[np.int64]], n: int) -> NDArray[np.int64]:
        """The sum of n counts of all blocks."""
        total, lock = np.zeros(n, np.int64), threading.Lock()

        def add(numbers: NDArray) -> None:
            counts = part(numbers)
            with lock:
                np.add(total, counts, out=total)

        self.run(add)
        return total

    def valued(self, numbers: NDArray) -> NDArray:
        """Those that stand for a value."""
        if self.grid.no_data is not None:
            numbers = numbers[numbers != self.grid.no_data]
        if not self.whole:
            with np.errstate(invalid="ignore"):
                if not np.isfinite(numbers.sum(dtype=np.float64)):
                    numbers = numbers[np.isfinite(numbers)]
        return numbers

    def valued_tiles(self) -> tuple[NDArray, NDArray]:
        values, weights = self.tiles
        keep = np.isfinite(values.astype(np.float64))
        if self.grid.no_data is not None:
            keep &= values != self.grid.no_data
        return values[keep], weights[keep]

    def count_each(self) -> tuple[NDArray, NDArray[np.int64]]:
        """Each stored number of 8 or 16 bits that occurs and has a value, and how often."""
        dtype = self.samples.dtype
        unsigned, n = np.dtype(f"u{dtype.itemsize}"), 1 << 8 * dtype.itemsize

        def part(numbers: NDArray) -> NDArray[np.int64]:
            flat = np.ascontiguousarray(numbers).reshape(-1)
            return np.bincount(flat.view(unsigned), minlength=n)

        counts = self.total(part, n)
        numbers = np.arange(n, dtype=unsigned).view(dtype)
        occurs = counts > 0
        if self.grid.no_data is not None:
            occurs &= numbers != self.grid.no_data
        return numbers[occurs], counts[occurs]

    def weighted(self) -> tuple[NDArray, NDArray[np.int64]]:
        """Numbers that are known with how often they occur."""
        values, weights = self.valued_tiles()
        if self.each is None:
            return values, weights
        return np.append(self.each[0], values), np.append(self.each[1], weights)

    def range_of_stored(self) -> tuple[float, float, int]:
        """The least and the greatest stored number that has a value, and how many have."""

        def ends(block: NDArray) -> tuple[float, float, int]:
            numbers = self.valued(block)
            if not numbers.size:
                return math.inf, -math.inf, 0
            return float(numbers.min()), float(numbers.max()), numbers.size

        found = self.run(ends) if self.each is None else []
        values, weights = self.weighted()
        if len(values):
            found.append((float(values.min()), float(values.max()), int(weights.sum())))
        return (
            min((lo for lo, _, _ in found), default=math.inf),
            max((hi for _, hi, _ in found), default=-math.inf),
            sum(n for _, _, n in found),
        )

    def count(self, edges: NDArray[np.float64]) -> NDArray[np.int64]:
        """How many samples lie between edges of even bins, of stored numbers."""
        n = len(edges) + 1

        def counts(block: NDArray) -> NDArray[np.int64]:
            numbers = self.valued(block).reshape(-1)
            place, total = np.empty(min(CACHED, numbers.size)), np.zeros(n, np.int64)
            for start in range(0, numbers.size, CACHED):
                some = numbers[start : start + CACHED]
                total += np.bincount(_bin_numbers(some, edges, place[: some.size]), minlength=n)
            return total

        total = np.zeros(n, np.int64) if self.each is not None else self.total(counts, n)
        values, weights = self.weighted()
        np.add.at(total, _bin_numbers(values, edges, np.empty(len(values))), weights)
        return total[1:-1]


def _bin_numbers(
    numbers: NDArray, edges: NDArray[np.float64], place: NDArray[np.float64]
) -> NDArray[np.intp]:
    """The bin of each, 1 to n; 0 for what is below the first, n + 1 above the last.

    place: room for as many numbers. The last edge belongs to the last bin.
    """
    n = len(edges) - 1
    np.subtract(numbers, edges[0], out=place, dtype=np.float64)
    place *= n * (1 - 1e-15) / (edges[-1] - edges[0])
    np.floor(place, out=place)  # first, or what lies below by little would be rounded up
    place += 1
    np.maximum(place, 0, out=place)
    np.minimum(place, n + 1, out=place)
    return place.astype(np.intp)


def _edges(lo: float, hi: float, bins: int, whole: bool) -> NDArray[np.float64]:
    """Edges of even bins over stored numbers; of whole ones they lie at halves."""
    if whole:
        lo, hi = math.ceil(lo), math.floor(hi)
        width = max(-(-(hi - lo + 1) // bins), 1)
        n = max(-(-(hi - lo + 1) // width), 1)
        return lo - 0.5 + float(width) * np.arange(n + 1)
    if not hi - lo > 1e-12 * max(abs(lo), abs(hi)):  # all alike
        reach = max(abs(lo) * 1e-6, 1e-30)
        return np.array([lo - reach, lo + reach])
    return np.linspace(lo, hi, bins + 1)


# ---- choosing ----------------------------------------------------------------------


def _is_whole(grid: ScalarGrid, seen: Histogram) -> bool:
    """Whether each bin already stands for one stored number."""
    samples = grid.samples.samples if isinstance(grid.samples, Leaves) else grid.samples
    return samples.dtype.kind in "iu" and seen.edges[1] - seen.edges[0] < 1.5 * abs(grid.scale)


def _without_tails(grid: ScalarGrid, fine: Histogram) -> Histogram:
    """The values among which a threshold is sought, in at most FINE bins."""
    share = np.cumsum(fine.counts) / fine.counts.sum()
    first = int(np.searchsorted(share, TAIL, "right"))
    if grid.quantity == "HU":
        first = max(first, int(np.searchsorted(fine.edges, AIR)))
    end = min(int(np.searchsorted(share, 1 - TAIL)) + 1, len(fine.counts))
    if end <= first:
        return fine
    starts = np.arange(first, end, -(-(end - first) // FINE))
    counts = np.add.reduceat(fine.counts[:end], starts)
    return Histogram(np.append(fine.edges[starts], fine.edges[end]), counts)


def _between_classes(seen: Histogram) -> tuple[float, str]:
    """A threshold between background and object."""
    counts, edges = seen.counts.astype(np.float64), seen.edges
    middles = (edges[:-1] + edges[1:]) / 2
    smooth = _smooth(counts)
    otsu = _otsu(counts, middles)
    peak = int(np.argmax(smooth))
    reach = WIDTH * max(_half_width(smooth, peak), 1)
    if abs(otsu - peak) > reach or smooth[otsu] < FOOT * smooth[peak]:
        return float(edges[otsu + 1]), "Otsu's threshold between two classes of values"
    above, below = counts.copy(), counts.copy()
    above[: min(int(peak + reach) + 1, len(counts))] = 0
    below[max(int(peak - reach), 0) :] = 0
    rest = above if above.sum() >= below.sum() else below
    if rest.sum() < max(RARE * counts.sum(), 2):
        return float(edges[otsu + 1]), (
            "Otsu's threshold, though the values have but one class and it may be noise"
        )
    centre = round(float((rest * np.arange(len(rest))).sum() / rest.sum()))
    lo, hi = sorted((peak, centre))
    valley = lo + _lowest(smooth[lo : hi + 1])
    return float(middles[valley]), (
        "the lowest count between the background, which is far larger, and the rest"
    )


def _otsu(counts: NDArray[np.float64], middles: NDArray[np.float64]) -> int:
    """The last bin of the lower class where the variance between two classes is greatest."""
    below = np.cumsum(counts)
    above = below[-1] - below
    sums = np.cumsum(counts * (middles - middles[0]))
    with np.errstate(divide="ignore", invalid="ignore"):
        apart = sums / below - (sums[-1] - sums) / above
        between = np.nan_to_num(below * above * apart * apart, nan=0.0)
    best = np.flatnonzero(between >= between.max() * (1 - 1e-12))
    return int(best[len(best) // 2])  # in a gap between classes all are best: its middle


def _smooth(counts: NDArray[np.float64]) -> NDArray[np.float64]:
    """Counts averaged over 1/128 of the bins, twice, which keeps peaks and takes noise."""
    n = max(len(counts) // 128, 1) | 1
    kernel = np.ones(n) / n
    twice = np.convolve(kernel, kernel)
    return np.convolve(counts, twice, "same") if len(counts) > len(twice) else counts


def _half_width(counts: NDArray[np.float64], peak: int) -> int:
    """Bins from the peak to half its height, on the steeper side."""
    low = np.flatnonzero(counts <= counts[peak] / 2)
    left, right = low[low < peak], low[low > peak]
    return int(min([*(peak - left[-1:]), *(right[:1] - peak)], default=1))


def _lowest(counts: NDArray[np.float64]) -> int:
    """The middle of the longest stretch of the lowest counts."""
    low = np.flatnonzero(counts <= counts.min() + 1e-9)
    runs = np.split(low, np.flatnonzero(np.diff(low) > 1) + 1)
    longest = max(runs, key=len)
    return int(longest[len(longest) // 2])
