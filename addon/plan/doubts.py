# SPDX-License-Identifier: GPL-3.0-or-later
"""What is said of volumes that may not be what their meshes were meant to be (no bpy)."""

from __future__ import annotations

from collections.abc import Sequence

from .levels import Work


def sentences(works: Sequence[Work]) -> list[str]:
    """On the volumes of a plan, each once."""
    told = [_crowded(work) for work in works]
    told += [_doubt(work) for work in works if work.measured.doubtful]
    told += [_unfilled(work) for work in works if work.fills and work.measured.kind == "sheet"]
    return [sentence for sentence in dict.fromkeys(told) if sentence]


def _crowded(work: Work) -> str:
    """The sentence on samples that would have to hold more than two objects, or ""."""
    lost = work.built.volume.info.n_dropped
    if not lost:
        return ""
    return (
        f"In {work.name!r} more than two objects meet in {lost} samples, which hold two: there a "
        "third one is as large as the second."
    )


def _doubt(work: Work) -> str:
    """The sentence on a kind that the user may not have meant."""
    return (
        f"{work.name!r} is taken for a {work.measured.kind}, since "
        f"{work.built.volume.mesh_info.why}; the object's settings can say otherwise."
    )


def _unfilled(work: Work) -> str:
    """The sentence on a medium that nothing holds."""
    why = f" ({work.measured.why})" if work.measured.why else ""
    return (
        f"{work.name!r} has no inside{why}, so the volume of its material is not rendered; a "
        "closed mesh has one."
    )
