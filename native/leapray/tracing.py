# SPDX-License-Identifier: GPL-3.0-or-later
"""Traversers, the structures they need, and rays through them."""

from __future__ import annotations

import ctypes
import weakref
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _abi
from ._lib import LeapRayError, Watch, call, check, lib
from .arrays import NORMALS, choice, columns, members, numbers, per_ray, pointer, record, vectors
from .options import Entry, all_choices, choice_numbers, find, read_entry
from .threads import check_threads, cores, run_parts, run_steps
from .volume import Volume

PART = 65536  # rays that a thread takes at a time
WORTH_THREADS = 1 << 20  # cells whose distances take longer than threads take to start

VISIBLE_MODES = {n: m for n, m in members(_abi.lr_mode).items() if m >= _abi.LR_MODE_VOLUME}
MODES = {n: m for n, m in members(_abi.lr_mode).items() if n not in VISIBLE_MODES}
HIT_TESTS = members(_abi.lr_hit_test)
ROOTS = members(_abi.lr_root)
SAMPLINGS = members(_abi.lr_sampling)
METRICS = members(_abi.lr_metric)
# what modes add up along rays, and the shape of it
SUMS: dict[str, dict[str, tuple[int, ...]]] = {
    "volume": {"color": (3,), "transmittance": ()},
    "maximum": {"value": ()},
    "minimum": {"value": ()},
    "mean": {"value": (), "length": ()},
}
MEMBERS = {"color": ("red", "green", "blue")}  # of lr_hits


@dataclass(frozen=True)
class Traverser(Entry):
    """A line of the core's registry, with its options chosen.

    exact: it agrees with the integer oracle but for ties.
    """

    default: bool = False
    rectilinear: bool = False  # takes rectilinear volumes
    trial: bool = False  # builds little: worth a trial where the fastest is wanted


def traversers() -> list[Traverser]:
    """All traversers that the core has, in the registry's order, with their default options.

    Raises LeapRayError only where core and package do not belong together.
    """
    return list(_registry())


@cache
def _registry() -> tuple[Traverser, ...]:
    """Read once: it does not change."""
    found = []
    for index in range(lib.lr_traverser_count()):
        line, error = _abi.lr_traverser(), _abi.lr_error()
        check(lib.lr_traverser_get(index, ctypes.byref(line), ctypes.byref(error)), error)
        flags = {
            "exact": bool(line.flags & _abi.LR_TRAVERSER_EXACT),
            "default": bool(line.flags & _abi.LR_TRAVERSER_DEFAULT),
            "rectilinear": bool(line.flags & _abi.LR_TRAVERSER_RECTILINEAR),
            "trial": bool(line.flags & _abi.LR_TRAVERSER_TRIAL),
        }
        found.append(read_entry(Traverser, index, line, **flags))
    return tuple(found)


def variants() -> list[Traverser]:
    """All traversers with every combination of their options."""
    return all_choices(traversers())


def traverser(spec: str | None = None) -> Traverser:
    """The traverser that spec, "name" or "name:option=choice,...", asks for; None: the default.

    Raises LeapRayError that lists what there is.
    """
    known = _registry()
    name, _, asked = (spec or "").partition(":")
    name = name or next(one.name for one in known if one.default)
    return find("traverser", f"{name}:{asked}", known)


class Structure:
    """What a traverser needs beside the volume, which it keeps alive; `build` makes it.

    volume: whose it is; entry: the traverser with its options; handle: the core's.
    Attributes: volume; traverser, with its options; nbytes, without the volume; has_tree: rays of
    scenes meet the volume's triangles by a tree, whatever the traverser; bounds, (2, 3): the box in
    which scenes look for what rays can hit, in lattice coordinates, its lower end above the upper
    one where there is nothing.
    """

    def __init__(self, volume: Volume, entry: Traverser, handle) -> None:
        self.volume = volume
        self.traverser = entry
        self.handle = handle
        self.nbytes = lib.lr_structure_nbytes(handle)
        self.has_tree = bool(lib.lr_structure_has_tree(handle))
        self.bounds = np.zeros((2, 3))
        lib.lr_structure_bounds(handle, *map(pointer, self.bounds))
        weakref.finalize(self, lib.lr_structure_free, handle)

    def __repr__(self) -> str:
        return f"<Structure {self.traverser.spec}, {self.nbytes / 1e6:.3g} MB, of {self.volume!r}>"


def build(
    volume: Volume,
    spec: str | Traverser | None = None,
    *,
    threads: int = 0,
    watch: Watch | None = None,
) -> Structure:
    """Build a traverser's structure for a volume.

    spec: "name", "name:option=choice,..." or a Traverser; the default without.
    threads is taken for the builders that can use them; none of today's does.
    Raises LeapRayError for an unknown name, Stopped when watch was told to stop.
    """
    if not isinstance(volume, Volume):
        raise LeapRayError(
            f"structures are built for a leapray.Volume, which leapray.Volume(samples) makes; "
            f"this is of type {type(volume).__name__}"
        )
    entry = spec if isinstance(spec, Traverser) else traverser(spec)
    choices = choice_numbers(entry)
    handle = ctypes.POINTER(_abi.lr_structure)()
    call(
        lib.lr_structure_build,
        volume.handle,
        entry.index,
        choices,
        watch=watch,
        outputs=(handle,),
    )
    return Structure(volume, entry, handle)


def _nothing() -> NDArray[np.float64]:
    return np.empty(0)


@dataclass(frozen=True, repr=False)
class Hits:
    """One entry per ray; arrays that a mode does not fill are empty.

    Points are origins + t * directions.
    """

    t: NDArray[np.float64]  # (n,) infinity on a miss
    cell: NDArray[np.int32]  # (n, 3) i, j, k of the cell hit
    normal: NDArray[np.float64]  # (n, 3) unit, outward, object space; 0 on a miss
    field_normal: NDArray[np.float64]  # (n, 3) of the trilinear field itself
    id: NDArray[np.int32]  # (n,)
    counters: dict[str, int]  # as add_counters gives them; empty if not counted
    steps: NDArray[np.int32]  # (n,) cells in which each ray stood; empty if not counted
    # of the mode "volume": (n, 3) radiance, linear RGB, and (n,) the share of what lies behind
    color: NDArray[np.float64] = field(default_factory=_nothing)
    transmittance: NDArray[np.float64] = field(default_factory=_nothing)
    # (n,) of "maximum", "minimum" and "mean", NaN on a miss; (n,) of the path of "mean"
    value: NDArray[np.float64] = field(default_factory=_nothing)
    length: NDArray[np.float64] = field(default_factory=_nothing)

    @property
    def opacity(self) -> NDArray[np.float64]:
        """(n,): 1 - transmittance."""
        return 1.0 - self.transmittance

    def __repr__(self) -> str:
        near = self.t[np.isfinite(self.t)]
        told = f", t from {near.min():.6g} to {near.max():.6g}" if len(near) else ""
        return f"<Hits of {len(near)} of {len(self.t)} rays{told}>"


@dataclass(frozen=True)
class Phong:
    """How samples are lit, by a light far away that nothing shadows.

    The normal is the gradient, facing the viewer. Colours are times ambient + diffuse n.l, and
    specular (r.v)^power is added, where r is the reflection of l; without a gradient the ambient
    share is all. The shares lie between 0 and 1e6, power between 1 and 1024. light: (3,), towards
    the light in object space; None: at the viewer, back along each ray.
    """

    ambient: float = 0.2
    diffuse: float = 0.8
    specular: float = 0.2
    power: int = 16
    light: Sequence[float] | None = None

    def in_c(self) -> _abi.lr_phong:
        """The core's struct. Raises LeapRayError for a direction of no length and other shapes."""
        to = np.zeros(3)
        if self.light is not None:
            to = numbers(self.light, np.float64, "the light's direction")
            if to.shape != (3,) or not to.any():
                raise LeapRayError(
                    f"the light's direction must be three numbers, not all 0; it is {self.light!r}"
                )
        return _abi.lr_phong(
            float(self.ambient),
            float(self.diffuse),
            float(self.specular),
            (ctypes.c_double * 3)(*to),
            int(self.power),
        )


def trace_options(
    *,
    mode="surface",
    hit_test="extrema",
    root="newton",
    normal="central",
    step=1.0,
    sampling="exact",
    tolerance=1e-4,
    stop_opacity=1.0,
    phong=None,
) -> _abi.lr_trace_options:
    """The C options that these names stand for.

    mode is of MODES or VISIBLE_MODES, hit_test, root, normal and sampling are of HIT_TESTS, ROOTS,
    NORMALS and SAMPLINGS; step: of the uniform hit test and of samplings, in voxels; tolerance,
    stop_opacity and phong as for `trace`. Raises LeapRayError that lists the names.
    """
    return _abi.lr_trace_options(
        mode=choice(MODES | VISIBLE_MODES, mode, "mode"),
        hit_test=choice(HIT_TESTS, hit_test, "hit test"),
        root=choice(ROOTS, root, "root finder"),
        normal=choice(NORMALS, normal, "normal"),
        step=float(step),
        sampling=choice(SAMPLINGS, sampling, "sampling"),
        tolerance=float(tolerance),
        stop_opacity=float(stop_opacity),
        phong=None if phong is None else ctypes.pointer(phong.in_c()),
    )


def trace(
    structure: Structure,
    origins: ArrayLike,
    directions: ArrayLike,
    *,
    t_min: ArrayLike | None = None,
    t_max: ArrayLike | None = None,
    mode: str = "surface",
    hit_test: str = "extrema",
    root: str = "newton",
    normal: str = "central",
    step: float = 1.0,
    sampling: str = "exact",
    tolerance: float = 1e-4,
    stop_opacity: float = 1.0,
    phong: Phong | None = None,
    start: tuple[ArrayLike, ArrayLike] | None = None,
    stop: ArrayLike | None = None,
    threads: int = 1,
    count: bool = True,
    watch: Watch | None = None,
) -> Hits:
    """Trace rays P = origin + t direction, both in object space.

    structure: of the volume to trace; origins, directions: (n, 3). Directions need not be
    unit; rays without direction or with a NaN or an infinity miss. t_min (default 0) and
    t_max (default infinity): a number or (n,). mode "surface" finds the first crossing of
    f = T in either direction, "binary" the first object cell. hit_test, root, normal: names
    of HIT_TESTS, ROOTS and NORMALS; cubic volumes take the mode "surface" without the hit test
    "uniform" and the root "cubic", and of their surface nothing is lost that the field passes by
    2^-46 of the largest difference between T and its samples. step: of the uniform hit test, in
    voxels.

    A volume of `visible_volume` takes the VISIBLE_MODES, along the whole ray: "volume" adds up
    emission and absorption, "maximum" and "minimum" find the largest and the smallest value, "mean"
    averages them; only values in visible cells count. t is where the ray begins to see something,
    of extremes where they are. sampling "exact" integrates without steps, off by at most tolerance
    times the largest colour and the largest emission along the path that emits; "post" and "pre"
    take samples at t = k step, classified after and before interpolation, and lose what lies
    between. stop_opacity: rays end where they are as opaque. phong: how samples "post" are lit,
    by the normals "central" and "analytic"; None: colours are as they are. stop: a number or (n,),
    with the mode "volume" and exact sampling: each ray ends where its transmittance has fallen to
    it; t is that place (infinity: there is none) and color the share of light that is scattered
    there.

    start: cells (n, 3) and sides (n,) of rays that leave a surface: side -1 where f < T, +1 where
    f >= T, 0 unknown. threads (0: all cores) change no bit. count: fill counters and steps. Raises
    LeapRayError for shapes and unknown names, and for options that the volume does not take;
    Stopped when watch was told to stop.
    """
    check_threads(threads)
    origins, directions = vectors(origins, "origins"), vectors(directions, "directions")
    n = len(origins)
    if n != len(directions):
        raise LeapRayError(f"there are {n} origins but {len(directions)} directions")
    chosen = trace_options(
        mode=mode,
        hit_test=hit_test,
        root=root,
        normal=normal,
        step=step,
        sampling=sampling,
        tolerance=tolerance,
        stop_opacity=stop_opacity,
        phong=phong,
    )
    low, high = per_ray(t_min, n, "t_min"), per_ray(t_max, n, "t_max")
    starts, stops = None if start is None else _starts(start, n), per_ray(stop, n, "stop")
    surface = n if mode in MODES else 0  # rays that end at one
    t, cell = np.empty(n), np.empty((surface, 3), np.int32)
    normals, field = np.empty((surface, 3)), np.empty((surface, 3))
    ids = np.empty(surface, np.int32)
    steps = np.empty(n if count else 0, np.int32)
    sums = {name: np.empty((n, *shape)) for name, shape in SUMS.get(mode, {}).items()}
    watch = watch or Watch()

    def part(first: int, last: int) -> _abi.lr_counters:
        apart = []  # vectors and their coordinates, which the core takes one by one

        def at(array, c_type=ctypes.c_double):
            return None if array is None else pointer(array[first:last], c_type)

        def each(array, c_type=ctypes.c_double):
            rows = np.empty((3, last - first), array.dtype)
            apart.append((array, rows))
            return [pointer(row, c_type) for row in rows]

        o, d = (
            columns(origins[first:last], "origins"),
            columns(directions[first:last], "directions"),
        )
        rays = _abi.lr_rays(*map(pointer, o), *map(pointer, d), at(low), at(high))
        rays.start, rays.stop = at(starts, _abi.lr_start), at(stops)
        hits = _abi.lr_hits(t=at(t))
        if surface:
            integers = each(cell, ctypes.c_int32)
            hits = _abi.lr_hits(
                at(t), *integers, *each(normals), *each(field), at(ids, ctypes.c_int32)
            )
        if count:
            hits.steps = at(steps, ctypes.c_int32)
        for name, array in sums.items():
            one_each = [at(array)] if array.ndim == 1 else each(array)
            for member, values in zip(MEMBERS.get(name, (name,)), one_each, strict=True):
                setattr(hits, member, values)
        counters = _abi.lr_counters()
        call(
            lib.lr_trace,
            structure.handle,
            ctypes.byref(rays),
            last - first,
            ctypes.byref(chosen),
            ctypes.byref(hits),
            ctypes.byref(counters) if count else None,
            watch=watch,
        )
        for array, rows in apart:
            array[first:last] = rows.T
        return counters

    if threads == 1:
        totals = [part(first, min(first + PART, n)) for first in range(0, max(n, 1), PART)]
    else:
        totals = run_parts(part, n, PART, threads, watch)
    return Hits(t, cell, normals, field, ids, add_counters(totals) if count else {}, steps, **sums)


def add_counters(parts: list[_abi.lr_counters]) -> dict[str, int]:
    """Of the counters in parts the totals: rays, cells, jumps, ...; of most_cells the largest."""
    return {
        name: (max if name == "most_cells" else sum)([0, *(getattr(part, name) for part in parts)])
        for name, _ in _abi.lr_counters._fields_
    }


def _starts(start: tuple[ArrayLike, ArrayLike], n: int) -> NDArray:
    cells, sides = np.asarray(start[0]), np.asarray(start[1])
    if cells.shape != (n, 3) or sides.shape != (n,):
        raise LeapRayError(
            f"start must be cells ({n}, 3) and sides ({n},); they are {cells.shape}, {sides.shape}"
        )
    table = np.zeros(n, record(_abi.lr_start))
    table["cell"] = numbers(cells, np.int32, "the cells of start")
    table["side"] = np.sign(sides)
    return table


def distance(
    cells: ArrayLike, metric: str = "chessboard", *, threads: int = 0, watch: Watch | None = None
) -> NDArray[np.uint8 | np.float32]:
    """Distance from every cell to the nearest one that is true, 0 on those.

    cells: (nz, ny, nx); returns the same shape. "chessboard" and "cityblock" count
    cells, "chamfer345" thirds of a cell: uint8, capped at 255. "euclid" is exact, in
    cells: float32, infinity where no cell is true. threads (0: all cores) change no
    bit. Raises LeapRayError for an unknown metric, Stopped when watch was told to
    stop. Sources: Borgefors 1986; Maurer, Qi and Raghavan 2003.
    """
    check_threads(threads)
    marked = np.ascontiguousarray(cells, dtype=bool).view(np.uint8)
    if marked.ndim != 3 or marked.size == 0:
        raise LeapRayError(f"cells must have the shape (nz, ny, nx); it is {marked.shape}")
    number = choice(METRICS, metric, "metric")
    dist: NDArray = np.empty(marked.shape, np.float32 if metric == "euclid" else np.uint8)
    asked = pointer(marked, ctypes.c_uint8), *marked.shape[::-1], number
    target = ctypes.c_void_p(dist.ctypes.data)
    if threads == 1 or (threads == 0 and (cores() == 1 or marked.size < WORTH_THREADS)):
        call(lib.lr_distance, *asked, target, watch=watch)
        return dist
    watch = watch or Watch()

    def parts(step: int) -> tuple[int, int]:
        steps, count, error = ctypes.c_int32(), ctypes.c_int64(), _abi.lr_error()
        which = *marked.shape[::-1], number, step, ctypes.byref(steps), ctypes.byref(count)
        check(lib.lr_distance_parts(*which, ctypes.byref(error)), error)
        return steps.value, count.value

    def part(step: int, index: int) -> None:
        call(lib.lr_distance_part, *asked, step, index, target, watch=watch)

    run_steps(part, [parts(step)[1] for step in range(parts(0)[0])], threads, watch)
    return dist
