# SPDX-License-Identifier: GPL-3.0-or-later
"""Colours of materials, lights and worlds, as far as their nodes are constant.

Light units are Blender's, as measured on a white diffuse plane in Cycles: a
sun of strength S gives S watts per square metre on a plane that faces it, a
point light of P watts a radiant intensity of P / 4 pi per steradian. `notes`
are told what is not followed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from . import model

NO_MATERIAL = model.Material("", (model.Lobe("diffuse"),))  # what Cycles gives to an empty slot


def of_material(material, notes) -> model.Material:
    """Base colour of Principled or Diffuse BSDF, else the viewport colour; grey for None."""
    if material is None:
        return NO_MATERIAL
    viewport = tuple(material.diffuse_color[:3])
    tree = _node_tree(material)
    output = tree.get_output_node("CYCLES") if tree else None
    if output is None:
        return model.Material(material.name, (model.Lobe("diffuse", viewport),))
    if _source(output.inputs["Displacement"]):
        notes.unsupported("Displacement is", material.name)
    if _source(output.inputs["Volume"]):
        notes.unsupported("Volumes are", material.name)
    socket = {
        "ShaderNodeBsdfPrincipled": "Base Color",
        "ShaderNodeBsdfDiffuse": "Color",
    }
    surface = _source(output.inputs["Surface"])
    node = surface.node if surface else None
    color = None
    if node and node.bl_idname in socket:
        color = _constant(node.inputs[socket[node.bl_idname]])
    if color is None:
        notes.replaced("viewport colour", material.name)
        color = viewport
    return model.Material(material.name, (model.Lobe("diffuse", tuple(color[:3])),))


def of_light(light, notes, name: str) -> NDArray[np.float64]:
    """Irradiance of a sun on a plane that faces it; radiant intensity of a point light."""
    strength = light.energy * 2.0**light.exposure
    if light.type == "SUN":
        if not light.normalize and light.angle > 0:  # energy is then the disk's radiance
            strength *= np.pi * np.sin(min(light.angle, np.pi) / 2) ** 2
    elif light.normalize:
        strength /= 4 * np.pi
    else:  # energy / pi is then the radiance of a sphere of that size
        strength *= light.shadow_soft_size**2 or 1 / np.pi
    color = strength * np.array(light.color, np.float64)
    if light.use_temperature:
        color *= light.temperature_color
    tree = _node_tree(light)
    output = tree.get_output_node("CYCLES") if tree else None
    if output:
        emission = _emitted(output, "ShaderNodeEmission")
        if emission is None:
            notes.unsupported("Light nodes other than a plain Emission are", name)
        else:
            color *= emission
    return color


def of_world(world, notes) -> tuple[float, float, float]:
    """Colour times strength of the Background node, else the world's own colour."""
    if world is None:
        return (0.0, 0.0, 0.0)
    tree = _node_tree(world)
    output = tree.get_output_node("CYCLES") if tree else None
    if output is None:
        return tuple(world.color)
    if _source(output.inputs["Volume"]):
        notes.unsupported("Volumes are", world.name)
    color = _emitted(output, "ShaderNodeBackground")
    if color is None:
        notes.unsupported("Environment textures and other world shaders are", world.name)
        return tuple(world.color)
    return tuple(color.tolist())


def _emitted(output, node_type: str) -> NDArray[np.float64] | None:
    """Colour times strength of the emitting node at an output: 0 without a node, None where
    it is another node or not constant."""
    surface = _source(output.inputs["Surface"])
    if surface is None:
        return np.zeros(3)
    if surface.node.bl_idname != node_type:
        return None
    color, strength = (_constant(surface.node.inputs[name]) for name in ("Color", "Strength"))
    if color is None or strength is None:
        return None
    return np.array(color[:3], np.float64) * strength


def _node_tree(block):
    """The shader nodes of a material, light or world; None where it does not use them."""
    import bpy

    if bpy.app.version >= (5, 0) or block.use_nodes:  # from 5.0 on they are always used
        return block.node_tree
    return None


def _source(socket):
    """The output socket that feeds an input, through reroutes; None where nothing does."""
    while True:
        link = next((link for link in socket.links if link.is_valid and not link.is_muted), None)
        if link is None:
            return None
        if link.from_node.bl_idname != "NodeReroute":
            return link.from_socket
        socket = link.from_node.inputs[0]


def _constant(socket):
    """The constant that an input has: its own, or that of an RGB or Value node; else None."""
    source = _source(socket)
    if source is None:
        return socket.default_value
    if source.node.bl_idname in ("ShaderNodeRGB", "ShaderNodeValue"):
        return source.default_value
    return None
