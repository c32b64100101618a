# SPDX-License-Identifier: GPL-3.0-or-later
"""Lets volumes keep all triangles where most of their cells do, or errors would be seen (no bpy).

Errors are seen where volumes are nearer to each other than these, and in smooth-shaded glass
with creases: near a rim normals turn so fast that refraction changes.
"""

from __future__ import annotations

import math
from functools import partial

import leapray

from . import error_metric, proximity
from .levels import Levels, Work

NO_ERROR = 1e-6  # of a voxel: no more than f32 rounds
MOSTLY = 3 / 4  # of the surface cells: from so many on that keep triangles, all do
MOST_FINER = 3  # levels, where cells that keep their triangles would have many,
SHARE = 1 / 32  # of the memory for that, unless its mesh has many triangles:
TRIANGLE_NBYTES = 128  # then so much for each
PER_CELL = 2.0  # triangles as large in all as a cell's side, where its list has error_metric.CROWD


class Separation(Levels):
    """The step of a plan for small gaps between volumes: decals, labels, carpets."""

    def clear_rims(self, most: float = math.inf) -> None:
        """Let solids of smooth glass with creases keep all triangles, if they fit.

        most: bytes that the triangles of one may take.
        """
        for work in self.works:
            if TRIANGLE_NBYTES * len(work.mesh.triangles) > most:
                continue
            smooth = work.refracts and work.mesh.corner_normals is not None
            own = work.measured.kind == "solid" and work.mesh.solids is None
            if smooth and own and work.exact != "every" and len(self._probes(work).creases):
                self._keep_every_triangle(work)

    def complete_triangles(self) -> None:
        """Let volumes most of whose cells keep a few triangles keep them all, if they fit.

        Then rays meet the triangles by a tree, and walk through no cells.
        """
        for work in self.works:
            mostly = MOSTLY <= work.measured.exact_share < 1
            if mostly and work.measured.crowd <= error_metric.CROWD and self.may_choose_cells(work):
                self._keep_every_triangle(work)

    def separate(self) -> None:
        """Let volumes that come nearer to each other than their errors keep all triangles."""
        if self.settings.layout == "scene":
            return
        bodies = [
            proximity.Body(
                work.matrices,
                work.mesh.bounds,
                _error(work),
                partial(self._probes, work),
                partial(self._some_structure, work),
            )
            for work in self.works
        ]
        why: dict[int, str] = {}
        for pair in proximity.close_pairs(bodies, self.scene.camera, self.check_cancelled):
            for n in pair:
                if n not in why:
                    why[n] = self._keep_every_triangle(self.works[n]) if bodies[n].error else ""
            names = dict.fromkeys(repr(self.works[n].name) for n in pair)
            if reason := next(filter(None, map(why.get, pair)), ""):
                self.warnings.append(
                    f"{' and '.join(names)} come so near to each other that one may show through "
                    f"the other: {reason}."
                )

    def _some_structure(self, work: Work) -> leapray.Structure:
        """A structure of the work's level, or of one without errors, to measure gaps."""
        perfect = self.perfect(work)
        for n in range(MOST_FINER if work.structure is None else -1, -1, -1):
            size = work.measured.voxel_size / 2**n
            measure = self._known(perfect, size)
            if measure is not None:
                room = self.budget - self.held() + work.measured.nbytes
                return self.structure(perfect, size, (measure.dtype,), room)
        self.complete(work)
        return work.built

    def _keep_every_triangle(self, work: Work) -> str:
        """Let all cells keep their triangles, so that there is no error; why not, or ""."""
        if self.settings.exact != "auto":
            return "only with automatic triangle cells they keep all their triangles"
        before, stuck = (work.exact, work.own_normals), work.stuck
        work.exact, work.own_normals = "every", True
        room = max(self.budget * SHARE, TRIANGLE_NBYTES * len(work.mesh.triangles))
        for levels in range(self.less_crowded(work), -1, -1):
            why = self.refused(work, levels, room if levels else math.inf)
            if not why:
                break
        if why:
            work.exact, work.own_normals = before
        for _ in range(levels, 0 if why else self._most_finer(work)):
            crowded = work.measured.crowd > error_metric.CROWD
            if not crowded or self.refused(work, 1, room):
                break
        work.stuck = stuck
        return why

    def less_crowded(self, work: Work) -> int:
        """How many levels finer a cell would hold few enough triangles, about, if all are kept."""
        each = len(work.mesh.triangles) / self.cells(work, work.measured.voxel_size)
        wanted = math.ceil(math.log2(max(each / PER_CELL, 1.0)) / 2)
        return min(wanted, self._most_finer(work))

    def _most_finer(self, work: Work) -> int:
        return 0 if work.fixed or self.settings.resolution else MOST_FINER


def _error(work: Work) -> float:
    """The quantile of the volume's errors, in object space; 0 where that is but rounding."""
    error = work.measured.typical
    return error if error > NO_ERROR * work.measured.voxel_size else 0.0
