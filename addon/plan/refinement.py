# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes volumes as good as asked for: by triangles, by normals, by finer voxels (no bpy)."""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable
from functools import partial

import leapray

from .. import model
from ..store import memory_cache
from . import error_metric, sample_types
from .levels import Work
from .separation import TRIANGLE_NBYTES, Separation

CELLS_PER_TRIANGLE = 0.1  # of finer voxels: so many take longer than a tree of the triangles
# Shares of the memory, counted without structures, so that traversers see the same volumes:
EDGE_SHARE = 1 / 32  # at most, that a volume takes for its creases' sake, or TRIANGLE_NBYTES each
SHARP_SHARE = 1 / 100  # for finer edges than asked for, of all volumes together
STEPS_SEEN = 1 / 5  # of the permitted error: less is no reason for wider samples


class Refinement(Separation):
    """The step of a plan that walks the levels of all volumes within one budget.

    advance: called with a share 0..1 of the plan's work as it proceeds.
    """

    def __init__(
        self,
        scene: model.Scene,
        cache: memory_cache.Cache,
        watch: leapray.Watch,
        threads: int,
        advance: Callable[[float], None] = lambda share: None,
    ) -> None:
        super().__init__(scene, cache, watch, threads)
        self.advance = advance

    def improve(self) -> None:
        """Make all volumes as good as asked for, unless their resolution is fixed."""
        for work in self.works:
            if work.fixed or self.settings.resolution:
                self._keep_normals(work)
        if self.settings.resolution:
            return
        self.clear_rims(self.budget * EDGE_SHARE)
        self.refine()
        self.sharpen()

    def refine(self) -> None:
        """Halve the voxels of the worst volume, while one is not good enough and memory lasts."""
        bar = self.settings.pixel_error

        def ticket(n: int) -> tuple[float, float, float, float, int]:
            """What sorts first is refined first: surfaces, colours, edges, normals."""
            surface, color, edges, normals = self.works[n].needs(bar)
            return -surface, -color, -edges, -normals, n

        widen = partial(self._widen, bar=bar)
        queue = [ticket(n) for n, work in enumerate(self.works) if not (work.stuck or work.fixed)]
        heapq.heapify(queue)
        total, left = 1e-9, 0.0
        while queue and queue[0][:4] < (-1.0, -1.0, -1.0, -1.0):
            *_, n = heapq.heappop(queue)
            work = self.works[n]
            levers = self._keep_all, widen, self._keep_triangles, self._keep_normals
            if any(lever(work) for lever in (*levers, self._refine_one)):
                heapq.heappush(queue, ticket(n))
            elif why := work.stuck:
                self._keep_normals(work)
                work.stuck = why
            left = sum(math.log2(math.prod(t[:4])) for t in queue)
            total = max(total, left)
            self.advance(0.3 + 0.7 * (1.0 - left / total))

    def _keep_all(self, work: Work) -> bool:
        """Let a mesh keep all its triangles, unless finer voxels would be much fewer.

        Rays meet them by a tree, nothing is lost, and no finer level has to be made.
        """
        if not self.may_choose_cells(work) or work.exact == "every" or work.asked_all:
            return False
        finer = self.cells(work, work.measured.voxel_size / 2 ** self._levels(work))
        if finer < CELLS_PER_TRIANGLE * len(work.mesh.triangles):
            return False
        work.asked_all = True  # finer levels would take longer
        return self._try(work, self.less_crowded(work), exact="every", own_normals=True)

    def _widen(self, work: Work, bar: float, volume_room: float = math.inf) -> bool:
        """Give a volume f32 where the steps of u16 are what its error is made of, if that helps.

        bar: smaller errors may stay.
        """
        before = work.errors.surface
        if work.dtype or work.errors.worst <= bar or work.errors.steps < sample_types.PART * before:
            return False
        measure, work.dtype = work.measured, "f32"
        if self.refused(work, 0, volume_room):
            work.dtype = ""
            return False
        if work.errors.surface < sample_types.PART * before:
            return True
        work.dtype = ""
        self.enter(work, measure.voxel_size, math.inf)
        del work.history[-2:]  # as if nothing had been tried
        return False

    def _keep_triangles(self, work: Work) -> bool:
        """Let a solid's cells keep their triangles at creases and thin walls, if that helps.

        It costs less than halving the voxels, unless nearly every cell would keep some.
        """
        m, e = work.measured, work.errors
        flat = work.mesh.corner_normals is None
        turned = work.turned_only(self.settings.pixel_error) and (flat or work.own_normals)
        if not self._may_keep_triangles(work) or self._crowds(work):
            return False
        thin = e.lost > error_metric.LOST_SHARE or e.body > self.settings.pixel_error
        if not (turned or thin or len(m.crease) > 0):
            return False
        return self._try(work, exact="all", own_normals=work.own_normals or flat)

    def _keep_normals(self, work: Work) -> bool:
        """Let hits have the mesh's own shading normals, where the field's are off."""
        final = work.stuck or work.fixed or self.settings.resolution
        off = work.errors.of_normals() > 1
        if work.own_normals or not (off if final else work.turned_only(self.settings.pixel_error)):
            return False
        if work.mesh.corner_normals is None and not final and self._may_keep_triangles(work):
            return False  # facets are kept with the triangles of cells
        return self._try(work, own_normals=True)

    def _crowds(self, work: Work) -> bool:
        """Would nearly every cell of this level keep more triangles than rays like to meet?

        Of thin things the samples may find no cell at all: then the area tells how many.
        """
        cells = self.cells(work, work.measured.voxel_size)
        return len(work.mesh.triangles) > error_metric.CROWD / 4 * max(work.measured.n_cells, cells)

    def _may_keep_triangles(self, work: Work) -> bool:
        """Whether it is a solid whose cells do not, but could if that helps."""
        automatic = work.exact == "sheets" and self.settings.exact == "auto"
        return automatic and work.measured.kind == "solid" and work.mesh.solids is None

    def _try(self, work: Work, levels: int = 0, **changes) -> bool:
        """Make the level anew, or one so many finer, changed so; keep that if it fits and helps."""
        before = {name: getattr(work, name) for name in changes}
        size, needed = work.measured.voxel_size, work.needs(self.settings.pixel_error)
        volume_room = self._volume_room(work)
        vars(work).update(changes)
        if self.refused(work, levels, volume_room):
            vars(work).update(before)
            return False
        if work.needs(self.settings.pixel_error) < needed:  # what is found may be shaded later
            return True
        vars(work).update(before)
        self.enter(work, size, math.inf)
        del work.history[-2:]  # as if nothing had been tried
        return False

    def _volume_room(self, work: Work) -> float:
        """Bytes that the work's volume may take: fewer where only edges ask for them."""
        surface, color, edges, normals = work.needs(self.settings.pixel_error)
        if max(edges, normals) == 1.0 or max(surface, color) > 1.0:
            return math.inf
        return max(self.budget * EDGE_SHARE, TRIANGLE_NBYTES * len(work.mesh.triangles))

    def _levels(self, work: Work) -> int:
        """How many times the voxel must be halved at least, as its errors and its mesh tell."""
        levels = work.errors.levels(self.settings.pixel_error)
        if self._may_keep_triangles(work):
            return levels
        return max(levels, work.errors.sharpening(work.measured.normals))

    def _refine_one(self, work: Work) -> bool:
        """Some levels finer; False where not even one can be, and work.stuck says why."""
        bar = self.settings.pixel_error
        room, volume_room = self.budget - self.held(), self._volume_room(work)
        waits = work.errors.of_normals() > 1 and work.exact == "sheets" and self._crowds(work)
        turned_only = work.turned_only(bar) and not waits
        if turned_only and len(work.history) > 1 and work.history[-1] > 0.8 * work.history[-2]:
            may = self._may_keep_triangles(work) and not self._crowds(work)
            if may and self._try(work, exact="every", own_normals=True):
                return True
            work.stuck = "finer voxels bring them no nearer"
            return False
        if not waits and len(work.history) > 3 and work.history[-1] > 0.9 * work.history[-4]:
            work.stuck = "halving the voxels three times did not help"
            return False
        for levels in range(self._levels(work), 0, -1):
            work.stuck = self.refused(work, levels, volume_room)
            if not work.stuck:
                return True
        if not work.dtype and work.turn > 0:  # a level finer for half the bytes
            work.dtype = "u8"
            if not self.refused(work, 1, volume_room):
                return True
            work.dtype = ""
        if volume_room < room:
            share = f"1/{round(1 / EDGE_SHARE)} of the memory budget"
            work.stuck = f"for edges and normals a volume gets {share}"
        return False

    def sharpen(self) -> None:
        """Spend a little memory on edges and steps that are good enough, the cheapest first."""
        left = self.budget * SHARP_SHARE
        for work in sorted(self.works, key=lambda w: w.measured.nbytes):
            before = work.measured.volume_nbytes
            self._widen(work, STEPS_SEEN * self.settings.pixel_error, left + before)
            wanted = 0 if work.stuck or work.fixed else math.ceil(math.log2(work.errors.softness()))
            for levels in range(wanted, 0, -1):
                if not self.refused(work, levels, left + before):
                    break
            left -= work.measured.volume_nbytes - before
