# SPDX-License-Identifier: GPL-3.0-or-later
"""What nodes make of numbers is what Cycles makes of them, at the edges of their domains too."""

import itertools

import bpy
import numpy as np
import pytest
from blender_scenes import fresh
from cycles_values import SHIFT, emitter, values

from addon.blender.read.links import output_of, source
from addon.blender.read.node_values import NODES
from addon.blender.read.nodes import Folder

ODD = (-2.5, -2.0, -1.0, -0.5, 0.0, 0.3, 1.0, 2.0, 3.0)


def items(kind, name):
    return [item.identifier for item in kind.bl_rna.properties[name].enum_items]


def maker(kind, inputs, output=0, **settings):
    """Adds a node with those settings; inputs by identifier."""

    def build(tree):
        node = tree.nodes.new(f"ShaderNode{kind}")
        for name, value in settings.items():
            setattr(node, name, value)
        for name, value in inputs.items():
            socket = next(s for s in node.inputs if s.identifier == name)
            socket.default_value = (*value, 1.0)[: len(socket.default_value)] if isinstance(
                value, tuple
            ) else value  # fmt: skip
        usable = [s for s in node.outputs if s.enabled]
        return usable[output % len(usable)]

    return build


def maths():
    rng = np.random.default_rng(4)
    pairs = list(itertools.product(ODD, ODD))
    for operation in items(bpy.types.ShaderNodeMath, "operation"):
        for k in rng.permutation(len(pairs))[:14]:
            a, b = pairs[k]
            c = float(rng.choice([-1.0, 0.0, 0.5, 2.0]))
            yield operation, maker("Math", {"Value": a, "Value_001": b, "Value_002": c},
                                   operation=operation, use_clamp=bool(k % 7 == 0))  # fmt: skip


def vector_maths():
    rng = np.random.default_rng(5)
    for operation in items(bpy.types.ShaderNodeVectorMath, "operation"):
        for k in range(6):
            a, b, c = (tuple(rng.choice(ODD, 3)) if k or n == 0 else (0.0, 0.0, 0.0)
                       for n in range(3))  # fmt: skip
            inputs = {"Vector": a, "Vector_001": b, "Vector_002": c}
            inputs["Scale"] = float(rng.choice(ODD))
            yield operation, maker("VectorMath", inputs, operation=operation)


def mixes():
    rng = np.random.default_rng(6)
    for blend in items(bpy.types.ShaderNodeMix, "blend_type"):
        for k in range(8):
            a, b = (tuple(rng.choice((0.0, 0.25, 0.5, 1.0, 1.5, -0.5), 3)) for _ in range(2))
            inputs = {"Factor_Float": (0.0, 0.5, 1.0, 0.7, 1.4, -0.3, 1.0, 0.2)[k],
                      "A_Color": a, "B_Color": b}  # fmt: skip
            yield blend, maker("Mix", inputs, data_type="RGBA", blend_type=blend,
                               clamp_factor=k < 4, clamp_result=k == 3)  # fmt: skip
            if k < 2:
                legacy = {"Fac": inputs["Factor_Float"], "Color1": a, "Color2": b}
                yield blend, maker("MixRGB", legacy, blend_type=blend, use_clamp=bool(k))
    for factor in (-0.5, 0.25, 2.0):
        for clamp in (False, True):
            number = {"Factor_Float": factor, "A_Float": -1.5, "B_Float": 2.5}
            yield "mix", maker("Mix", number, data_type="FLOAT", clamp_factor=clamp)
            vector = {"A_Vector": (1.0, -2.0, 0.0), "B_Vector": (3.0, 0.5, 1.0)}
            yield "mix", maker("Mix", {**vector, "Factor_Float": factor}, data_type="VECTOR",
                               clamp_factor=clamp)  # fmt: skip
            yield "mix", maker("Mix", {**vector, "Factor_Vector": (factor, 0.5, 1.0)},
                               data_type="VECTOR", factor_mode="NON_UNIFORM",
                               clamp_factor=clamp)  # fmt: skip


def ranges():
    kinds = items(bpy.types.ShaderNodeMapRange, "interpolation_type")
    cases = [(0.3, 0.0, 1.0, -1.0, 4.0), (2.0, 0.0, 1.0, 3.0, -1.0), (0.3, 1.0, 0.0, 0.0, 2.0),
             (0.5, 1.0, 1.0, 2.0, 3.0), (-1.0, -2.0, 2.0, 0.0, 1.0)]  # fmt: skip
    names = ("From Min", "From Max", "To Min", "To Max")
    for kind, case, clamp, steps in itertools.product(kinds, cases, (False, True), (4.0, 0.0)):
        if steps == 0.0 and kind != "STEPPED":
            continue
        more = dict(interpolation_type=kind, clamp=clamp)
        inputs = dict(zip(("Value", *names), case, strict=True)) | {"Steps": steps}
        yield kind, maker("MapRange", inputs, **more)
        vectors = {f"{n.replace(' ', '_')}_FLOAT3": (v, v + 0.5, v)
                   for n, v in zip(names, case[1:], strict=True)}  # fmt: skip
        vectors |= {"Vector": (case[0],) * 3, "Steps_FLOAT3": (steps, 2.0, 1.0)}
        yield kind, maker("MapRange", vectors, data_type="FLOAT_VECTOR", **more)


def colors():
    rng = np.random.default_rng(7)
    for _ in range(12):
        color = tuple(rng.choice((0.0, 0.2, 0.5, 1.0, 1.7, -0.4), 3))
        for gamma in (0.0, 1.0, 2.2, -1.0):
            yield "gamma", maker("Gamma", {"Color": color, "Gamma": gamma})
        factor = float(rng.choice((0.0, 0.5, 1.0, 1.3)))
        yield "invert", maker("Invert", {"Color": color, "Fac": factor})
        contrast = {"Color": color, "Bright": rng.uniform(-1, 1), "Contrast": rng.uniform(-1, 2)}
        yield "contrast", maker("BrightContrast", contrast)
        turned = {"Color": color, "Fac": factor, "Hue": float(rng.choice((0.0, 0.2, 0.5, 0.9))),
                  "Saturation": rng.uniform(0, 2), "Value": rng.uniform(0, 2)}  # fmt: skip
        yield "hsv", maker("HueSaturation", turned)
        yield "gray", maker("RGBToBW", {"Color": color})
        for mode in ("RGB", "HSV", "HSL"):
            parts = dict(zip(("Red", "Green", "Blue"), color, strict=True))
            yield f"from {mode}", maker("CombineColor", parts, mode=mode)
            for output in range(3):
                yield f"to {mode}", maker("SeparateColor", {"Color": color}, output, mode=mode)
        limits = {"Value": color[0], "Min": color[1], "Max": color[2]}
        for kind in ("MINMAX", "RANGE"):
            yield "clamp", maker("Clamp", limits, clamp_type=kind)
    for kelvin in (500.0, 800.0, 1500.0, 6500.0, 12000.0, 40000.0):
        yield "black body", maker("Blackbody", {"Temperature": kelvin})


def ramps():
    for interpolation in ("LINEAR", "CONSTANT", "EASE", "B_SPLINE"):
        for x in (-0.5, 0.0, 0.3, 0.5, 0.501, 1.0, 2.0):
            for output in range(2):

                def build(tree, x=x, output=output, interpolation=interpolation):
                    node = tree.nodes.new("ShaderNodeValToRGB")
                    ramp = node.color_ramp
                    ramp.interpolation = interpolation
                    ramp.elements[0].color = (1, 0.5, 0, 0.25)
                    ramp.elements.new(0.5).color = (0, 0.2, 1, 0.75)
                    node.inputs[0].default_value = x
                    return node.outputs[output]

                yield "ramp", build  # fmt: skip
    for kind, channels in (("RGBCurve", 4), ("VectorCurve", 3), ("FloatCurve", 1)):
        for extend, x in itertools.product(("HORIZONTAL", "EXTRAPOLATED"), (-1.5, 0.1, 0.6, 1.4)):

            def build(tree, kind=kind, extend=extend, x=x, channels=channels):
                node = tree.nodes.new(f"ShaderNode{kind}")
                node.mapping.extend = extend
                for c in range(channels):
                    node.mapping.curves[c].points.new(0.4 + 0.1 * c, 0.7 - 0.2 * c)
                node.mapping.update()
                node.inputs[0].default_value = 0.75
                value = node.inputs[1]
                value.default_value = (
                    x if kind == "FloatCurve" else (x, 0.5, x, 1)[: len(value.default_value)]
                )
                return node.outputs[0]

            yield "curve", build  # fmt: skip


CASES = {"math": maths, "vector math": vector_maths, "mix": mixes, "map range": ranges,
         "color": colors, "ramp": ramps}  # fmt: skip


def ours(build):
    """(3,) of the socket, through the same nodes that Cycles had."""
    output = output_of(emitter(build))
    if output is None:
        return np.full(3, -SHIFT)
    return Folder().value(source(output)[0].input("Color")) - SHIFT


@pytest.mark.parametrize("name", CASES)
def test_values_are_those_of_cycles(name):
    fresh()
    cases = list(CASES[name]())
    want = values([build for _, build in cases])
    got = np.array([ours(build) for _, build in cases])
    got[~np.isfinite(got)] = -SHIFT  # Cycles shows none of its light
    assert len(cases) > 50
    wrong = np.abs(got - want) > 2e-6 * (SHIFT + np.abs(want)) + 1e-5
    gray = [case == "gray" for case, _ in cases]  # Blender's own weights have four digits
    wrong[gray] = np.abs(got - want)[gray] > 2e-4
    bad = [(cases[k][0], k, got[k], want[k]) for k in np.flatnonzero(wrong.any(axis=1))]
    assert not bad, bad[:10]


def test_every_node_with_values_is_one_of_blenders():
    fresh()
    tree = bpy.data.materials.new("All")
    if bpy.app.version < (5, 0):
        tree.use_nodes = True
    for name in NODES:
        try:
            tree.node_tree.nodes.new(name)
        except RuntimeError:
            assert "Combine" in name or "Separate" in name or "MixRGB" in name  # gone since
