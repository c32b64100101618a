# SPDX-License-Identifier: GPL-3.0-or-later
"""What each kind of shader node makes of its inputs, as Cycles does.

A function of NODES takes the folder that asks and the place of an output. It asks for
the values of inputs by `yield folder.at(place)`, and returns that of the output.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import Any, cast, overload

import numpy as np
from numpy.typing import NDArray

from leapray import Step, Table, Value, operate

from .colors import MODES, blackbody, blend, hsv_from_rgb, rgb_from_hsv
from .links import Place, Triple, Unfolded, Values, luminance, own_values, title, triple, zero

RAMP = 257  # entries of a ramp's or curve's table, as in Cycles

Asking = Generator[Any, Values, Values]


def ask(folder, out: Place, *inputs: str) -> Generator[Any, Values, list]:
    """Values of inputs of the same node, by their identifiers."""
    made = []
    for name in inputs:
        made.append((yield folder.at(out.input(name))))
    return made


def _ask_first(folder, out: Place, n: int) -> Generator[Any, Values, list]:
    made = []
    for socket in list(out.node.inputs)[:n]:
        made.append((yield folder.at(Place(socket, out.groups))))
    return made


def each(name: str, *values: Values) -> Triple:
    """An operation on each part of vectors, and on numbers that all of them share."""
    parts = [v if isinstance(v, tuple) else (v, v, v) for v in values]
    return triple(operate(name, *row) for row in zip(*parts, strict=True))


@overload
def clamp(value: Triple, low: Values = 0.0, high: Values = 1.0) -> Triple: ...


@overload
def clamp(value: Value, low: Value = 0.0, high: Value = 1.0) -> Value: ...


def clamp(value: Values, low: Any = 0.0, high: Any = 1.0) -> Values:
    if isinstance(value, tuple):
        return each("minimum", each("maximum", value, low), high)
    return operate("minimum", operate("maximum", value, low), high)


def _dot(a: Triple, b: Triple) -> Value:
    x, y, z = each("multiply", a, b)
    return operate("add", operate("add", x, y), z)


def _lerp(a: Values, b: Values, share: Values) -> Values:
    """a where share is 0, b where it is 1."""
    operation: Callable[..., Any] = each if isinstance(a, tuple) else operate
    rest = operation("subtract", 1.0, share)
    return operation("multiply_add", b, share, operation("multiply", a, rest))


# ---- numbers -------------------------------------------------------------------


def _held(folder, out: Place) -> Asking:
    return own_values(out)
    yield


def _has_poles() -> bool:
    import bpy

    return bpy.app.version < (5, 0)


def _radians(a: Value, b: Value, c: Value) -> Value:
    return operate("multiply", a, np.pi / 180)


def _degrees(a: Value, b: Value, c: Value) -> Value:
    return operate("multiply", a, 180 / np.pi)


def _snap(a: Value, b: Value, c: Value) -> Value:
    return operate("multiply", operate("floor", operate("divide", a, b)), b)


def _smooth_max(a: Value, b: Value, c: Value) -> Value:
    negative = (operate("subtract", 0.0, each) for each in (a, b))
    return operate("subtract", 0.0, operate("smooth_min", *negative, c))


def _power(a: Value, b: Value, *, poles: bool) -> Value:
    """poles: 0 to a power below 0 is infinite, as it was in Cycles before 5.0."""
    made = operate("power", a, b)
    if not poles:
        return made
    pole = operate("select", operate("sign", a), 0.0, operate("less_than", b, 0.0))
    infinite = float(np.finfo(np.float32).max) if isinstance(pole, Step) else np.inf
    return operate("select", pole, infinite, made)


_MATH: dict[str, Callable[[Value, Value, Value], Value]] = {
    "POWER": lambda a, b, c: _power(a, b, poles=_has_poles()),
    "RADIANS": _radians,
    "DEGREES": _degrees,
    "SNAP": _snap,
    "SMOOTH_MAX": _smooth_max,
}


def _math(folder, out: Place) -> Asking:
    node = out.node
    a, b, c = yield from _ask_first(folder, out, 3)
    if node.operation in _MATH:
        value = _MATH[node.operation](a, b, c)
    else:
        value = operate(_known(node, node.operation), a, b, c)
    return clamp(value) if node.use_clamp else value


def _known(node, operation: str) -> str:
    from leapray.programs import OPERATIONS

    if operation.lower() not in OPERATIONS:
        raise Unfolded(f"{title(node)} ({operation.replace('_', ' ').capitalize()})")
    return operation.lower()


def _clamp(folder, out: Place) -> Asking:
    value, low, high = yield from ask(folder, out, "Value", "Min", "Max")
    if out.node.clamp_type == "RANGE":
        low, high = operate("minimum", low, high), operate("maximum", low, high)
    return clamp(value, low, high)


def _map_range(folder, out: Place) -> Asking:
    node = out.node
    vector = node.data_type == "FLOAT_VECTOR"
    words = "From Min", "From Max", "To Min", "To Max"
    names = [f"{name.replace(' ', '_')}_FLOAT3" for name in words] if vector else words
    inputs = yield from ask(folder, out, "Vector" if vector else "Value", *names)
    steps: Values = 0.0
    if node.interpolation_type == "STEPPED":
        steps = yield folder.at(out.input("Steps_FLOAT3" if vector else "Steps"))
    parts = (*inputs, steps)
    if not vector:
        return _mapped(node, *parts, of_empty=None if folder.by_blender(out, *parts) else 0.0)
    rows = zip(*(v if isinstance(v, tuple) else (v, v, v) for v in parts), strict=True)
    return triple(_mapped(node, *row, of_empty=None) for row in rows)


def _mapped(node, value, from_min, from_max, to_min, to_max, steps, *, of_empty) -> Value:
    """One number of Map Range. of_empty: its value where the range is empty; None: that at
    the range's start."""
    kind = node.interpolation_type
    span = operate("subtract", from_max, from_min)
    share = operate("divide", operate("subtract", value, from_min), span)
    if kind == "STEPPED":
        whole = operate("floor", operate("multiply", share, operate("add", steps, 1.0)))
        share = operate("divide", whole, steps)
        share = operate("select", operate("greater_than", steps, 0.0), share, 0.0)
    elif kind == "SMOOTHSTEP":
        share = clamp(share)
        square = operate("multiply", share, share)
        share = operate("multiply", square, operate("multiply_add", share, -2.0, 3.0))
    elif kind == "SMOOTHERSTEP":
        share = clamp(share)
        inner = operate("multiply_add", share, 6.0, -15.0)
        inner = operate("multiply_add", share, inner, 10.0)
        cube = operate("multiply", operate("multiply", share, share), share)
        share = operate("multiply", cube, inner)
    made = operate("multiply_add", share, operate("subtract", to_max, to_min), to_min)
    if of_empty is not None:
        made = operate("select", span, made, of_empty)
    if node.clamp:
        made = clamp(made, operate("minimum", to_min, to_max), operate("maximum", to_min, to_max))
    return made


# ---- vectors -------------------------------------------------------------------


def _normalize(a: Triple) -> Triple:
    return each("divide", a, operate("sqrt", _dot(a, a)))


def _cross(a: Triple, b: Triple) -> Triple:
    def part(i: int, j: int) -> Value:
        return operate("subtract", operate("multiply", a[i], b[j]), operate("multiply", a[j], b[i]))

    return part(1, 2), part(2, 0), part(0, 1)


def _project(a: Triple, b: Triple) -> Triple:
    return each("multiply", operate("divide", _dot(a, b), _dot(b, b)), b)


def _reflect(a: Triple, b: Triple) -> Triple:
    normal = _normalize(b)
    twice = operate("multiply", 2.0, _dot(a, normal))
    return each("subtract", a, each("multiply", twice, normal))


def _refract(a: Triple, b: Triple, eta: Value) -> Triple:
    normal = _normalize(b)
    cosine = _dot(normal, a)
    sine2 = operate("subtract", 1.0, operate("multiply", cosine, cosine))
    k = operate("subtract", 1.0, operate("multiply", operate("multiply", eta, eta), sine2))
    along = operate("multiply_add", eta, cosine, operate("sqrt", k))
    bent = each("subtract", each("multiply", eta, a), each("multiply", along, normal))
    return each("select", operate("less_than", k, 0.0), 0.0, bent)


def _faceforward(a: Triple, b: Triple, c: Triple) -> Triple:
    towards = operate("less_than", _dot(c, b), 0.0)
    return each("select", towards, a, each("subtract", 0.0, a))


_VECTOR: dict[str, Callable[[Triple, Triple, Triple, Value], Values]] = {
    "CROSS_PRODUCT": lambda a, b, c, s: _cross(a, b),
    "PROJECT": lambda a, b, c, s: _project(a, b),
    "REFLECT": lambda a, b, c, s: _reflect(a, b),
    "REFRACT": lambda a, b, c, s: _refract(a, b, s),
    "FACEFORWARD": lambda a, b, c, s: _faceforward(a, b, c),
    "DOT_PRODUCT": lambda a, b, c, s: _dot(a, b),
    "DISTANCE": lambda a, b, c, s: _length(each("subtract", a, b)),
    "LENGTH": lambda a, b, c, s: _length(a),
    "SCALE": lambda a, b, c, s: each("multiply", a, s),
    "NORMALIZE": lambda a, b, c, s: _normalize(a),
    "SNAP": lambda a, b, c, s: each("multiply", each("floor", each("divide", a, b)), b),
    "FRACTION": lambda a, b, c, s: each("fract", a),
}


def _length(a: Triple) -> Value:
    return operate("sqrt", _dot(a, a))


def _vector_math(folder, out: Place) -> Asking:
    node = out.node
    a, b, c, scale = yield from ask(folder, out, "Vector", "Vector_001", "Vector_002", "Scale")
    values: Values
    if node.operation == "POWER":
        poles = _has_poles() or folder.by_blender(out, a, b)
        values = triple(_power(x, y, poles=poles) for x, y in zip(a, b, strict=True))
    elif node.operation in _VECTOR:
        values = _VECTOR[node.operation](a, b, c, scale)
    else:
        values = each(_known(node, node.operation), a, b, c)
    if isinstance(values, tuple) != (out.socket.type == "VECTOR"):
        return zero(out.socket.type)  # of an output that the operation does not fill
    return values


def _combine(folder, out: Place) -> Asking:
    parts = yield from _ask_first(folder, out, 3)
    mode = getattr(out.node, "mode", "HSV" if "HSV" in out.node.bl_idname else "RGB")
    return MODES[mode][0](tuple(parts))


def _separate(folder, out: Place) -> Asking:
    (color,) = yield from _ask_first(folder, out, 1)
    mode = getattr(out.node, "mode", "HSV" if "HSV" in out.node.bl_idname else "RGB")
    return MODES[mode][1](color)[list(out.node.outputs).index(out.socket)]


# ---- colours -------------------------------------------------------------------


def _mix(folder, out: Place) -> Asking:
    node = out.node
    kind = {"FLOAT": "Float", "VECTOR": "Vector", "RGBA": "Color"}.get(node.data_type)
    if kind is None:
        raise Unfolded(f"{title(node)} ({node.data_type.capitalize()})")
    several = kind == "Vector" and node.factor_mode == "NON_UNIFORM"
    name = "Factor_Vector" if several else "Factor_Float"
    factor, a, b = yield from ask(folder, out, name, f"A_{kind}", f"B_{kind}")
    if node.clamp_factor:
        factor = clamp(factor)
    if kind != "Color":
        return _lerp(a, b, factor)
    made = _blend(node, a, b, factor)
    return clamp(made) if node.clamp_result else made


def _mix_rgb(folder, out: Place) -> Asking:
    factor, a, b = yield from ask(folder, out, "Fac", "Color1", "Color2")
    made = _blend(out.node, a, b, clamp(factor))
    return clamp(made) if out.node.use_clamp else made


def _blend(node, a: Triple, b: Triple, factor: Value) -> Triple:
    made = blend(node.blend_type, a, b, factor)
    if made is None:
        raise Unfolded(f"{title(node)} ({node.blend_type.replace('_', ' ').capitalize()})")
    return made


def _gamma(folder, out: Place) -> Asking:
    color, gamma = yield from ask(folder, out, "Color", "Gamma")
    power = each("select", each("greater_than", color, 0.0), each("power", color, gamma), color)
    return power if folder.by_blender(out, color, gamma) else each("select", gamma, power, 1.0)


def _invert(folder, out: Place) -> Asking:
    factor, color = yield from ask(folder, out, "Fac", "Color")
    return _lerp(color, each("subtract", 1.0, color), factor)


def _bright_contrast(folder, out: Place) -> Asking:
    color, bright, contrast = yield from ask(folder, out, "Color", "Bright", "Contrast")
    rest = operate("subtract", bright, operate("multiply", contrast, 0.5))
    made = each("multiply_add", color, operate("add", 1.0, contrast), rest)
    return each("maximum", made, 0.0)


def _hue_saturation(folder, out: Place) -> Asking:
    names = "Hue", "Saturation", "Value", "Fac", "Color"
    hue, saturation, value, factor, color = yield from ask(folder, out, *names)
    h, s, v = hsv_from_rgb(color)
    h = operate("fract", operate("add", operate("add", h, hue), 0.5))
    s = clamp(operate("multiply", s, saturation))
    made = rgb_from_hsv((h, s, operate("multiply", v, value)))
    return each("maximum", _lerp(color, made, factor), 0.0)


def _to_gray(folder, out: Place) -> Asking:
    (color,) = yield from ask(folder, out, "Color")
    return luminance(color)


def _blackbody(folder, out: Place) -> Asking:
    (kelvin,) = yield from ask(folder, out, "Temperature")
    if isinstance(kelvin, Step):
        raise Unfolded(f"{title(out.node)} of a texture")
    return tuple(np.maximum(blackbody(kelvin), 0.0).tolist())


# ---- ramps and curves ----------------------------------------------------------


def _ramp(folder, out: Place) -> Asking:
    (x,) = yield from ask(folder, out, "Fac")
    ramp = out.node.color_ramp
    if folder.by_blender(out, x):
        values = tuple(map(float, ramp.evaluate(x)))
        return cast(Triple, values[:3]) if out.socket.type == "RGBA" else values[3]
    table = np.array([ramp.evaluate(at) for at in np.linspace(0.0, 1.0, RAMP)])
    kind = "constant" if ramp.interpolation == "CONSTANT" else "linear"
    if out.socket.type != "RGBA":
        return Table(table[:, 3], kind).at(x)
    return triple(Table(table[:, c], kind).at(x) for c in range(3))


def _curve_table(node, curves: list[int]) -> tuple[NDArray[np.float64], float, float]:
    """Curves one after the other, at RAMP points of their common range, and that range."""
    mapping = node.mapping
    mapping.initialize()
    points = [point.location[0] for curve in mapping.curves for point in curve.points]
    low, high = min(points), max(points)
    rows = []
    for x in np.linspace(low, high, RAMP):
        for curve in curves:
            x = mapping.evaluate(mapping.curves[curve], x)
        rows.append(x)
    return np.array(rows), low, high


def _curved(node, curves: list[int], x: Value, exact: bool) -> Value:
    """exact: without a table."""
    if exact:
        node.mapping.initialize()
        for curve in curves:
            x = node.mapping.evaluate(node.mapping.curves[curve], x)
        return x
    values, low, high = _curve_table(node, curves)
    kind = "extrapolate" if node.mapping.extend == "EXTRAPOLATED" else "linear"
    at = operate("divide", operate("subtract", x, low), high - low)
    return Table(values, kind).at(at)


def _curves(folder, out: Place) -> Asking:
    """RGB Curves, whose fourth goes before the others, and Vector Curves."""
    node = out.node
    factor, color = yield from _ask_first(folder, out, 2)
    of_all = [3] if node.bl_idname == "ShaderNodeRGBCurve" else []
    exact = folder.by_blender(out, factor, color)
    made = triple(_curved(node, [*of_all, c], color[c], exact) for c in range(3))
    return _lerp(color, made, factor)


def _float_curve(folder, out: Place) -> Asking:
    factor, value = yield from _ask_first(folder, out, 2)
    x = value
    exact = folder.by_blender(out, x)
    if exact:  # which does not extrapolate these
        points = [point.location[0] for point in out.node.mapping.curves[0].points]
        x = clamp(x, min(points), max(points))
    return _lerp(value, _curved(out.node, [0], x, exact), factor)


NODES: dict[str, Callable[[Any, Place], Asking]] = {
    "ShaderNodeRGB": _held,
    "ShaderNodeValue": _held,
    "ShaderNodeMath": _math,
    "ShaderNodeClamp": _clamp,
    "ShaderNodeMapRange": _map_range,
    "ShaderNodeVectorMath": _vector_math,
    "ShaderNodeCombineColor": _combine,
    "ShaderNodeCombineRGB": _combine,
    "ShaderNodeCombineHSV": _combine,
    "ShaderNodeCombineXYZ": _combine,
    "ShaderNodeSeparateColor": _separate,
    "ShaderNodeSeparateRGB": _separate,
    "ShaderNodeSeparateHSV": _separate,
    "ShaderNodeSeparateXYZ": _separate,
    "ShaderNodeMix": _mix,
    "ShaderNodeMixRGB": _mix_rgb,
    "ShaderNodeGamma": _gamma,
    "ShaderNodeInvert": _invert,
    "ShaderNodeBrightContrast": _bright_contrast,
    "ShaderNodeHueSaturation": _hue_saturation,
    "ShaderNodeRGBToBW": _to_gray,
    "ShaderNodeBlackbody": _blackbody,
    "ShaderNodeValToRGB": _ramp,
    "ShaderNodeRGBCurve": _curves,
    "ShaderNodeVectorCurve": _curves,
    "ShaderNodeFloatCurve": _float_curve,
}
