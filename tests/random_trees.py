# SPDX-License-Identifier: GPL-3.0-or-later
"""Random trees of shader nodes: any nodes, links, values and settings that Blender allows."""

import contextlib
import math
import struct

import bpy
import numpy as np

SKIPPED = ("ShaderNodeCustomGroup", "ShaderNodeTree", "ShaderNode", "ShaderNodeScript")
OUTPUTS = ("ShaderNodeOutputMaterial", "ShaderNodeOutputWorld", "ShaderNodeOutputLight")
SHADERS = ("ShaderNodeMixShader", "ShaderNodeAddShader", "ShaderNodeEmission",
           "ShaderNodeBsdfPrincipled", "ShaderNodeBsdfDiffuse", "ShaderNodeBackground")  # fmt: skip
COMMON = ("ShaderNodeTexImage", "ShaderNodeMath", "ShaderNodeMix", "ShaderNodeVectorMath",
          "ShaderNodeValToRGB", "ShaderNodeRGBCurve", "ShaderNodeMapRange", "NodeReroute",
          "ShaderNodeVertexColor", "ShaderNodeTexEnvironment", "ShaderNodeMapping")  # fmt: skip
NUMBERS = (0.0, -0.0, 0.5, 1.0, -1.0, 2.0, 1e-30, 1e30, -1e30, math.inf, -math.inf, math.nan)


class Grower:
    """Makes trees; all that it draws comes from the seed."""

    def __init__(self, seed):
        self.rng = np.random.default_rng(seed)
        names = sorted(n for n in dir(bpy.types) if n.startswith("ShaderNode") and n not in SKIPPED)
        self.kinds = [*(name for name in names if self._is_known(name)), "NodeReroute", "NodeFrame"]
        self.images = self._images()
        self.groups = []
        for k in range(12):
            self.groups.append(self._group(f"Group {k}"))

    @staticmethod
    def _is_known(name):
        """Some types are there, but no nodes of theirs any more."""
        tree = bpy.data.node_groups.new("Known", "ShaderNodeTree")
        try:
            tree.nodes.new(name)
        except RuntimeError:
            return name.startswith("ShaderNodeOutput")  # not in groups
        finally:
            bpy.data.node_groups.remove(tree)
        return True

    def _images(self):
        made = [bpy.data.images.new(f"Random {k}", 3, 2, alpha=True, float_buffer=bool(k))
                for k in range(2)]  # fmt: skip
        made[1].pixels.foreach_set(np.float32([*range(20), math.nan, math.inf, -1, 0.5]))
        gone = bpy.data.images.new("Gone", 2, 2)
        gone.source, gone.filepath = "FILE", "/nowhere/gone.png"
        return [*made, gone, None]

    def _group(self, name):
        tree = bpy.data.node_groups.new(name, "ShaderNodeTree")
        sockets = ("Float", "Color", "Vector", "Shader", "Int", "Bool")
        for k in range(int(self.rng.integers(0, 5))):
            kind = f"NodeSocket{self.rng.choice(sockets)}"
            in_out = ("INPUT", "OUTPUT")[int(self.rng.integers(2))]
            tree.interface.new_socket(f"Socket {k}", in_out=in_out, socket_type=kind)
        ends = ["NodeGroupInput", "NodeGroupOutput"][: int(self.rng.integers(0, 3))]
        self.grow(tree, int(self.rng.integers(0, 8)), ends)
        return tree

    def grow(self, tree, n, first=()):
        """Random nodes and links in a tree."""
        nodes = [tree.nodes.new(kind) for kind in first]
        for _ in range(n):
            pool = (self.kinds, self.kinds, SHADERS, COMMON, ("ShaderNodeGroup",))
            kinds = pool[int(self.rng.integers(len(pool)))]
            try:
                node = tree.nodes.new(str(self.rng.choice(kinds)))
            except RuntimeError:  # not in this tree
                continue
            self._set(node)
            nodes.append(node)
        inputs = [(k, socket) for k, node in enumerate(nodes) for socket in node.inputs]
        outputs = [(k, socket) for k, node in enumerate(nodes) for socket in node.outputs]
        for _ in range(3 * n):
            if inputs and outputs:
                (k, start), (j, end) = self._one(outputs), self._one(inputs)
                if k <= j and self.rng.random() < 0.99:  # else a circle, perhaps
                    continue
                pair = start, end
                with contextlib.suppress(RuntimeError):  # of a group's own ends
                    tree.links.new(*pair, verify_limits=bool(self.rng.random() < 0.8))
        for node in nodes:
            node.mute = bool(self.rng.random() < 0.1)
        return nodes

    def _one(self, things):
        return things[int(self.rng.integers(len(things)))]

    def _set(self, node):
        if node.bl_idname == "ShaderNodeGroup":
            node.node_tree = self._one([*self.groups, None]) if self.groups else None
        if hasattr(node, "image"):
            node.image = self._one(self.images)
        for prop in node.bl_rna.properties:
            if prop.type == "ENUM" and not prop.is_readonly and self.rng.random() < 0.3:
                names = [item.identifier for item in prop.enum_items]
                if names and not prop.is_enum_flag:
                    self._try(node, prop.identifier, self._one(names))
            elif prop.type == "BOOLEAN" and prop.identifier.startswith(("use_", "clamp")):
                self._try(node, prop.identifier, bool(self.rng.integers(2)))
        for socket in (*node.inputs, *node.outputs):
            if self.rng.random() < 0.3 and hasattr(socket, "default_value"):
                self._value(socket)

    def _value(self, socket):
        old = socket.default_value
        if isinstance(old, float):
            self._try(socket, "default_value", self._one(NUMBERS))
        elif hasattr(old, "__len__") and not isinstance(old, str):
            self._try(socket, "default_value", [self._one(NUMBERS) for _ in old])

    @staticmethod
    def _try(thing, name, value):
        with contextlib.suppress(TypeError, ValueError, AttributeError, struct.error):
            setattr(thing, name, value)
