# SPDX-License-Identifier: GPL-3.0-or-later
"""The traverser that is the fastest in each volume, by trial (no bpy).

Exact traversers find the same hits, so the choice changes no pixel, only time. The rays of a trial
are those of a frame in small: half of them come from the camera, half start inside the volume's
box, as bounced light does.
"""

from __future__ import annotations

import time
import weakref
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import leapray

from .. import model
from ..settings import FASTEST
from .planned import Plan

RAYS = 512  # of a trial
ROUNDS = 3  # the least time of so many counts
MOST = 32  # volumes that get a trial: those with the most surface cells
WORTH = 0.9  # of the default's time: more would be noise


@dataclass(frozen=True)
class Choice:
    """What a trial has found."""

    structure: leapray.Structure | None  # of the fastest; None: the default is
    microseconds: dict[str, float]  # of a ray, by traverser; empty: there was no trial
    why: str  # a sentence's end


# By the structure of the default, then by what its rays were traced with: the same volume is tried
# once, however many frames show it.
_choices: weakref.WeakKeyDictionary[leapray.Structure, dict[str, Choice]] = (
    weakref.WeakKeyDictionary()
)


def first(spec: str) -> str | None:
    """The traverser whose structures a plan is made with; None: the default."""
    return None if spec in ("", FASTEST) else spec


def choose(
    plan: Plan, scene: model.Scene, threads: int, watch: leapray.Watch, mode: str = ""
) -> None:
    """Say of each volume what traces it; give it the fastest where that is asked for.

    mode: of leapray.trace; "": the one in which its kind is rendered. Raises Stopped.
    """
    placed: dict[int, leapray.Instance] = {}
    for instance in plan.instances:
        placed.setdefault(instance.volume_index, instance)
    if scene.settings.traverser == FASTEST:
        size = {n: each.structure.volume.info.n_surface_cells for n, each in placed.items()}
        tried = sorted(size, key=lambda n: (-size[n], n))[:MOST]
        chosen = {n: _choice(placed[n], scene, threads, watch, mode) for n in tried}
    else:
        chosen = {}
    new = {n: each.structure for n, each in chosen.items() if each.structure is not None}
    for n, row in enumerate(plan.volumes, 1):
        if n not in placed:  # nothing but what it cuts is seen
            continue
        found = chosen.get(n)
        structure = new.get(n, placed[n].structure)
        row["traverser"] = structure.traverser.spec
        if scene.settings.traverser == FASTEST:
            row["traverser_why"] = found.why if found else f"not among the {MOST} largest volumes"
            row["traverser_microseconds"] = found.microseconds if found else {}
        grown = structure.nbytes - placed[n].structure.nbytes
        row["structure_nbytes"] += grown
        row["nbytes"] += grown
        plan.structure_nbytes += grown
    if new:
        plan.instances = [
            replace(each, structure=new.get(each.volume_index, each.structure))
            for each in plan.instances
        ]


def _choice(
    instance: leapray.Instance,
    scene: model.Scene,
    threads: int,
    watch: leapray.Watch,
    mode: str,
) -> Choice:
    """What a trial finds or has found. mode: as for choose."""
    mode = mode or ("volume" if instance.volume_unit > 0 else "surface")
    options = {"mode": mode, **scene.settings.trace_options(mode)}
    known = _choices.setdefault(instance.structure, {})
    if repr(options) not in known:
        known[repr(options)] = _trial(instance, scene.camera, options, threads, watch)
    return known[repr(options)]


def _trial(
    instance: leapray.Instance,
    camera: leapray.Camera,
    options: dict[str, Any],
    threads: int,
    watch: leapray.Watch,
) -> Choice:
    """Trace the same rays by all that may be the fastest. options: of leapray.trace."""
    built = instance.structure
    if built.has_tree:
        return Choice(None, {}, "its triangles are met in a tree, whatever the traverser")
    rivals = [
        leapray.build(built.volume, each, threads=threads, watch=watch)
        for each in leapray.traversers()
        if each.trial and not each.default
    ]
    structures = [built, *rivals]
    rays = _rays(instance, camera)
    least = [np.inf] * len(structures)
    for _ in range(ROUNDS):
        for n, each in enumerate(structures):
            began = time.perf_counter()
            leapray.trace(each, *rays, count=False, watch=watch, **options)
            least[n] = min(least[n], time.perf_counter() - began)
    best = int(np.argmin(least))
    best = best if least[best] < WORTH * least[0] else 0
    told = {
        each.traverser.spec: round(seconds / RAYS * 1e6, 3)
        for each, seconds in zip(structures, least, strict=True)
    }
    return Choice(
        structures[best] if best else None, told, f"the fastest of {len(told)} with {RAYS} rays"
    )


def _rays(instance: leapray.Instance, camera: leapray.Camera) -> Sequence[NDArray[np.float64]]:
    """Origins and directions (RAYS, 3) in object space of rays to points in the volume's box."""
    rng = np.random.default_rng(0)
    low, high = instance.structure.bounds
    lattice = instance.structure.volume.info.object_from_index
    targets, starts = rng.uniform(low, high, (2, RAYS, 3)) @ lattice[:3, :3].T + lattice[:3, 3]
    inverse = np.linalg.inv(np.asarray(instance.world_from_object, np.float64))
    half = RAYS // 2
    if camera.projection == "perspective":
        starts[:half] = inverse[:3, :3] @ camera.eye + inverse[:3, 3]
        return starts, targets - starts
    directions = targets - starts
    directions[:half] = inverse[:3, :3] @ camera.forward
    starts[:half] = targets[:half] - directions[:half] * np.ptp(targets, axis=0).max()
    return starts, directions
