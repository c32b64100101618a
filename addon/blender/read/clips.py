# SPDX-License-Identifier: GPL-3.0-or-later
"""Objects that cut the data of volumes open.

They are hidden as a rule, and Blender evaluates no hidden object for a property that names it:
the render of an animation does not move it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from leapray import LeapRayError

from ... import model
from ...settings import Isosurfaces
from . import matrices
from .meshes import read_object_mesh

STILL = (
    "is animated, but cuts where it was before the render, for it is hidden from renders; Ray "
    "Visibility hides it, too, and leaves it its motion"
)


def read_clip(ob, own: Isosurfaces, depsgraph, notes) -> model.Clip | None:
    """What cuts a volume object; notes are told of an object that cannot."""
    if own.clip_object is None:
        return None
    original = own.clip_object.original
    try:
        if original.type != "MESH":
            raise LeapRayError("it is no mesh")
        cutter, matrix = _evaluated(original, depsgraph, notes)
        if not matrices.invertible(matrix):
            raise LeapRayError("its matrix cannot be inverted (a scale of zero?)")
        return model.Clip(
            original.name, read_object_mesh(cutter), matrix, own.clip_keep == "inside"
        )
    except LeapRayError as error:
        notes.missing("Volume object", ob.name, f"is not cut by '{original.name}': {error}")
        return None


def _evaluated(original, depsgraph, notes) -> tuple:
    """The object with its modifiers, and its place.

    From this depsgraph, else from the viewport's; an object that is hidden in both is without
    modifiers. notes are told where that is of another frame.
    """
    for graph in (depsgraph, depsgraph.view_layer.depsgraph):
        if graph is not None and any(each.original == original for each in graph.ids):
            now = depsgraph.scene_eval.frame_current_final
            if graph.scene_eval.frame_current_final != now and _moves(original):
                notes.missing("Object", original.name, STILL)
            found = original.evaluated_get(graph)
            return found, matrices.affine(found.matrix_world)
    if _moves(original):
        notes.missing("Object", original.name, STILL)
    return original, _placed(original)


def _moves(ob) -> bool:
    """Whether the object, its mesh or a parent is animated."""
    own = any(each and each.animation_data for each in (ob, ob.data))
    return own or (ob.parent is not None and _moves(ob.parent))


def _placed(ob) -> NDArray[np.float64]:
    """Where an object that is not evaluated is, by its own and its parents' transforms; what
    has constraints, or another kind of parent, stays where it was seen last."""
    if len(ob.constraints) or (ob.parent and ob.parent_type != "OBJECT"):
        return matrices.affine(ob.matrix_world)
    own = matrices.affine(ob.matrix_basis)
    if ob.parent is None:
        return own
    return _placed(ob.parent) @ matrices.affine(ob.matrix_parent_inverse) @ own
