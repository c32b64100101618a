# SPDX-License-Identifier: GPL-3.0-or-later
"""Objects that cut the data of volumes open.

They are hidden as a rule, and Blender evaluates no hidden object for a property that names it:
the render of an animation does not move it. Where hiding it from renders is animated itself, it
cuts in the frames that show it.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from leapray import LeapRayError

from ... import model
from ...plan import clips
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
    if _is_keyed_hidden(original, depsgraph.scene_eval.frame_current_final):
        return None
    try:
        if original.type not in ("MESH", "EMPTY"):
            raise LeapRayError("it is neither a mesh nor an empty")
        cutter, matrix = _evaluated(original, depsgraph, notes)
        if not matrices.invertible(matrix):
            raise LeapRayError("its matrix cannot be inverted (a scale of zero?)")
        return _clip(original, cutter, matrix, own.clip_keep == "inside")
    except LeapRayError as error:
        notes.missing("Volume object", ob.name, f"is not cut by '{original.name}': {error}")
        return None


def _clip(original, cutter, matrix: NDArray[np.float64], inside: bool) -> model.Clip:
    if original.type == "EMPTY":
        if original.empty_display_type != "CUBE":
            return model.Clip(original.name, None, matrix, inside)
        half = original.empty_display_size
        sized = matrix @ np.diag([half, half, half, 1.0])
        return model.Clip(original.name, clips.box(), sized, inside)
    mesh = read_object_mesh(cutter)
    plane = clips.plane_of(mesh)
    if plane is not None:
        return model.Clip(original.name, None, matrix @ plane, inside)
    return model.Clip(original.name, mesh, matrix, inside)


def _is_keyed_hidden(ob, frame: float) -> bool:
    """Whether an object is hidden from renders in a frame by its animation."""
    for curve in _curves(ob):
        if curve.data_path == "hide_render" and not curve.mute:
            return curve.evaluate(frame) > 0.0
    return False


def _curves(ob) -> Iterator:
    """Of an object's own action."""
    told = ob.animation_data
    if told is None or told.action is None:
        return
    for layer in told.action.layers:
        for strip in layer.strips:
            bag = strip.channelbag(told.action_slot)
            if bag is not None:
                yield from bag.fcurves


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
    """Whether the object, its mesh or a parent is animated otherwise than by being hidden."""
    told = ob.animation_data
    own = told is not None and (
        len(told.drivers) > 0
        or len(told.nla_tracks) > 0
        or any(not curve.data_path.startswith("hide_") for curve in _curves(ob))
    )
    data = ob.data is not None and ob.data.animation_data is not None
    return own or data or (ob.parent is not None and _moves(ob.parent))


def _placed(ob) -> NDArray[np.float64]:
    """Where an object that is not evaluated is, by its own and its parents' transforms; what
    has constraints, or another kind of parent, stays where it was seen last."""
    if len(ob.constraints) or (ob.parent and ob.parent_type != "OBJECT"):
        return matrices.affine(ob.matrix_world)
    own = matrices.affine(ob.matrix_basis)
    if ob.parent is None:
        return own
    return _placed(ob.parent) @ matrices.affine(ob.matrix_parent_inverse) @ own
