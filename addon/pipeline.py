# SPDX-License-Identifier: GPL-3.0-or-later
"""From a scene to a frame: plan, volumes, structures, tiles on threads, passes (no bpy).

The calling thread does no work of its own: it asks `stop`, shows progress and
hands tiles on, while workers call the core, which drops the interpreter lock.
One watch reaches every call into the core, so a stop ends whatever runs.
"""

from __future__ import annotations

import collections
import dataclasses
import platform
import queue
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path
from typing import Any, cast

import numpy as np

import leapray
from leapray._abi import lr_counters
from leapray.threads import cores

from . import film, image_method, memory, methods, model, pixel_report, projection, tiles
from .plan import plan
from .process import POLL
from .settings import SETTINGS
from .store.memory_cache import Cache

PLANNED = 0.3  # share of the progress bar that planning and voxelizing take


def never() -> bool:
    return False


def ignore(*_: object) -> None:
    pass


def render(
    scene: model.Scene,
    *,
    stop: Callable[[], bool] = never,
    progress: Callable[[float, str], None] = ignore,
    on_tile: Callable[[int, int, int, int, dict], None] | None = None,
    cache: Cache | None = None,
    planner: type[plan.Planner] = plan.Planner,
    pixel: tuple[int, int] | None = None,
) -> model.Frame:
    """Render the scene, or one pixel of it.

    stop, progress(share 0..1, phase) and on_tile(x, y, width, height, passes) are
    called on the calling thread only. cache is the caller's to keep between
    frames: what has not changed is not voxelized again. planner chooses the volumes.
    pixel: column and row from the lower left; the passes are 0 elsewhere, and the report has
    what happened on its paths under "pixel".
    Raises Stopped soon after stop() said so, LeapRayError with one sentence where
    there is nothing to render or the memory does not suffice; no thread outlives it.
    """
    began = time.perf_counter()
    meter = memory.Meter(scene.resident)
    watch = leapray.Watch()
    threads = scene.settings.threads or cores()
    check(scene.settings)
    method = methods.find(scene.settings.method)
    _check_method(scene, method, pixel)
    record = None if pixel is None else leapray.Record()
    with ThreadPoolExecutor(threads, thread_name_prefix="leapray") as pool:
        workers = WorkerPool(pool, watch, stop, progress, meter)
        kept = Cache() if cache is None else cache
        painter = _painter(scene, method, kept, workers, threads, planner, pixel, record)
        planned, planned_at = painter.planned, time.perf_counter()
        passes = _paint(scene, painter, workers, threads, on_tile)
    counters = painter.told()
    ended = time.perf_counter()
    warnings = [*scene.warnings, *planned.warnings, *painter.warnings]
    pixels_nbytes = sum(p.nbytes for p in passes.values())
    report = {
        "settings": asdict(scene.settings),
        "width": scene.width,
        "height": scene.height,
        "versions": versions(),
        "cpu": cpu(),
        "threads": threads,
        "seconds": {
            "read": scene.seconds_read,
            **planned.seconds,
            "prepare": planned_at - began - sum(planned.seconds.values()),
            "trace": ended - planned_at,
            "total": scene.seconds_read + ended - began,
        },
        "method": method.spec,
        **counters,
        "bytes": {
            "volumes": planned.volume_nbytes,
            "structures": planned.structure_nbytes,
            "scratch": planned.scratch_nbytes,
            "method": painter.nbytes,
            "peak": max(
                meter.peak(),
                planned.peak_nbytes,
                planned.volume_nbytes + planned.structure_nbytes + painter.nbytes + pixels_nbytes,
            ),
        },
        "volumes": planned.volumes,
        "warnings": warnings,
    }
    if pixel is not None and record is not None:
        value = passes["Combined"][pixel[1], pixel[0]]
        report["pixel"] = pixel_report.describe(record, scene, planned, pixel, value)
    return model.Frame(passes=passes, report=report, warnings=warnings)


def check(settings: model.Settings) -> None:
    """Refuse, in a sentence, settings that no scene could be rendered with."""
    for name, setting in SETTINGS.items():
        wrong = setting.problem(getattr(settings, name))
        if wrong:
            raise leapray.LeapRayError(f"{name} {wrong}")


def check_pixel(pixel: tuple[int, int], width: int, height: int) -> None:
    """Refuse a pixel that a picture of that size has not."""
    if not (0 <= pixel[0] < width and 0 <= pixel[1] < height):
        raise leapray.LeapRayError(
            f"The picture has {width} x {height} pixels, 0,0 to {width - 1},{height - 1} from its "
            f"lower left corner; there is no pixel {pixel[0]},{pixel[1]}"
        )


def _check_method(
    scene: model.Scene, method: methods.Method, pixel: tuple[int, int] | None
) -> None:
    """Refuse, in a sentence, what the render method cannot show."""
    if method.image is not None:
        image_method.check(scene, method)
    elif method.mode:
        projection.check(scene, method)
    if pixel is None:
        return
    if method.spec != methods.RAYS.spec:
        raise leapray.LeapRayError(
            f"What happens on a pixel's paths is told of the render method {methods.RAYS.spec}, "
            f"and the scene's is {method.spec}"
        )
    check_pixel(pixel, scene.width, scene.height)


class WorkerPool:
    """Workers, and the calling thread that listens to them and to its caller.

    progress is called again while nothing arrives, with `share`, which a worker
    may move.
    """

    def __init__(self, pool, watch, stop, progress, meter) -> None:
        self.pool, self.watch, self.stop, self.progress = pool, watch, stop, progress
        self.meter = meter
        self.phase, self.share = "", 0.0
        self._said: tuple[float, str] | None = None
        self._asked = 0.0

    def _listen(self) -> None:
        """Ask the caller whether to stop, and say how far things are, but not too often."""
        now = time.monotonic()
        if now - self._asked < POLL:
            return
        self._asked = now
        self.meter.sample()
        if self.stop():
            self.watch.stop()
        if (self.share, self.phase) != self._said:
            self._said = self.share, self.phase
            self.progress(*self._said)

    def run(self, jobs: list[Callable[[Callable], None]]) -> Iterator:
        """Run job(put) for all jobs side by side; yields on this thread what they put.

        Raises the first exception of a job, or Stopped, after all have ended.
        """
        arrived: queue.SimpleQueue = queue.SimpleQueue()
        ended = object()

        def work(job):
            try:
                job(arrived.put)
            except BaseException:
                self.watch.stop()  # the others need not go on
                raise
            finally:
                arrived.put(ended)

        futures = [self.pool.submit(work, job) for job in jobs]
        running = len(futures)
        try:
            while running:
                self._listen()
                try:
                    item = arrived.get(timeout=POLL)
                except queue.Empty:
                    continue
                if item is ended:
                    running -= 1
                elif not self.watch.stopped:
                    yield item
        except BaseException:
            self.watch.stop()
            raise
        finally:
            errors = [e for f in futures if (e := f.exception())]
        errors.sort(key=lambda e: isinstance(e, leapray.Stopped))
        if errors:
            raise errors[0]
        if self.watch.stopped:
            raise leapray.Stopped("The render was cancelled.")


def _painter(
    scene: model.Scene,
    method: methods.Method,
    cache: Cache,
    workers: WorkerPool,
    threads: int,
    planner: type[plan.Planner],
    pixel: tuple[int, int] | None,
    record: leapray.Record | None,
) -> film.Painter:
    """Plan the scene for its render method, and make what that needs."""
    watch = workers.watch

    def advance(share: float) -> None:
        workers.share = max(workers.share, PLANNED * share)

    def of_values(put: Callable) -> None:
        put(projection.plan(scene, method, cache, watch, threads, advance))

    if method.image is not None and planner is plan.Planner:
        planner = image_method.CellPlanner

    def of_surfaces(put: Callable) -> None:
        put(plan.make(scene, cache, watch, threads, advance, planner))

    workers.phase = "Voxelizing"
    if method.mode:
        ((planned, values),) = workers.run([of_values])
        return projection.ProjectionPainter(scene, method, planned, values, watch)
    (planned,) = workers.run([of_surfaces])
    if method.image is None:
        return RayPainter(scene, planned, watch, threads, pixel, record)
    workers.phase = "Preparing"
    return image_method.ImagePainter(scene, method, planned, cache, workers.run, watch, threads)


def _world(world: model.World, watch: leapray.Watch) -> leapray.World:
    """The world with its image as a texture."""
    image = world.image
    if image is None:
        return world
    texture = leapray.Texture(
        image.pixels,
        image.interpolation,
        image.extension,
        image.program,
        points_only=True,
        watch=watch,
    )
    return dataclasses.replace(world, image=cast(Any, texture))


class RayPainter:
    """Paths of light through a plan's structures, by the core's scene.

    pixel: the only one that is painted, which record tells of; None: all.
    """

    def __init__(
        self,
        scene: model.Scene,
        planned: plan.Plan,
        watch: leapray.Watch,
        threads: int,
        pixel: tuple[int, int] | None,
        record: leapray.Record | None,
    ) -> None:
        s = scene.settings
        self.scene, self.planned, self.watch, self.record = scene, planned, watch, record
        self.tiles = tiles.split(scene.width, scene.height, s.tile_size)
        if pixel is not None:
            self.tiles = [tiles.Tile(*pixel, 1, 1)]
        self.passes = [name for name in scene.passes if name in leapray.PASSES]
        self.warnings: list[str] = []
        # The core takes what has attributes of the same names as its own classes.
        self.placed = leapray.Scene(
            scene.camera,
            planned.instances,
            planned.lights,
            cast(Sequence[leapray.Material], scene.materials),
            planned.slots,
            world=_world(scene.world, watch),
            film_transparent=scene.film_transparent,
            slot_objects=planned.slot_objects,
            mist=scene.mist,
            nested=s.nested,
        )
        self.counters: list[lr_counters] = []
        self.workspaces: list[int] = []

    @property
    def nbytes(self) -> int:
        return sum(self.workspaces)

    def worker(self) -> Callable[[tiles.Tile], film.Passes]:
        s = self.scene.settings
        side = min(s.tile_size, max(self.scene.width, self.scene.height))
        workspace, counters = self.placed.workspace(side, side, s.branches), lr_counters()
        self.workspaces.append(workspace.nbytes)
        self.counters.append(counters)
        sampling = {name: getattr(s, name) for name in leapray.SAMPLING}
        options = s.trace_options("surface") | s.trace_options("volume")

        def paint(tile: tiles.Tile) -> film.Passes:
            return self.placed.render_tile(
                *tile,
                samples=s.samples,
                seed=s.seed,
                options=options,
                passes=self.passes,
                workspace=workspace,
                watch=self.watch,
                counters=counters,
                record=self.record,
                **sampling,
            )

        return paint

    def told(self) -> dict[str, Any]:
        return leapray.add_counters(self.counters)


def _paint(
    scene: model.Scene, painter: film.Painter, workers: WorkerPool, threads: int, on_tile
) -> film.Passes:
    """The passes, of tiles that threads paint."""
    todo = collections.deque(painter.tiles)
    n_tiles, n_pixels = len(todo), scene.width * scene.height
    workers.phase, workers.share = f"Rendered 0/{n_tiles} Tiles", PLANNED

    def job(put: Callable) -> None:
        paint = painter.worker()
        while True:
            try:
                tile = todo.popleft()
            except IndexError:
                return
            parts = paint(tile)
            _expose(parts, scene.film_exposure)
            put((tile, parts))

    passes: film.Passes = {}
    done = 0
    for count, (tile, parts) in enumerate(workers.run([job] * min(threads, n_tiles)), 1):
        tiles.paste(passes, tile, parts, (scene.height, scene.width))
        done += tile.width * tile.height
        workers.phase = f"Rendered {count}/{n_tiles} Tiles"  # as Cycles says it: farms parse it
        workers.share = PLANNED + (1 - PLANNED) * done / n_pixels
        if on_tile is not None:
            on_tile(*tile, parts)
    workers.progress(1.0, workers.phase)
    return passes


def _expose(parts: dict[str, np.ndarray], exposure: float) -> None:
    """Multiply what is light in the passes (alpha is not)."""
    for name in ("Combined", "Emission", "Environment") if exposure != 1.0 else ():
        if name in parts:
            parts[name][..., :3] *= np.float32(exposure)


# ---- where it ran --------------------------------------------------------------


def cpu() -> str:
    """The processor's name, as the system gives it."""
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def versions() -> dict[str, str]:
    return {
        "leapray": leapray.__version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
    }
