# SPDX-License-Identifier: GPL-3.0-or-later
"""Colours of shader nodes: HSV and HSL, blend modes, black bodies; as Cycles has them.

All but black bodies work on leapray.programs' values, in tuples of three.
Source: Smith 1978, Color gamut transform pairs; Blender's manual, Color Blend Modes.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from leapray import Value, operate

from .links import Triple, triple


def _choose(condition: Value, yes: Value, no: Value) -> Value:
    return operate("select", condition, yes, no)


def _is_less(a: Value, b: Value) -> Value:
    return operate("less_than", a, b)


def _extremes(color: Triple) -> tuple[Value, Value, Value]:
    """Largest, least, and their difference."""
    r, g, b = color
    most = operate("maximum", operate("maximum", r, g), b)
    least = operate("minimum", operate("minimum", r, g), b)
    return most, least, operate("subtract", most, least)


def _hue(color: Triple, most: Value, delta: Value) -> Value:
    """0..1; where there is none it counts for nothing."""
    r, g, b = color

    def sixth(a: Value, b: Value, first: float) -> Value:
        return operate("add", operate("divide", operate("subtract", a, b), delta), first)

    of_red = _choose(_is_less(g, b), sixth(g, b, 6.0), sixth(g, b, 0.0))
    others = _choose(_is_less(g, most), sixth(r, g, 4.0), sixth(b, r, 2.0))
    return operate("divide", _choose(_is_less(r, most), others, of_red), 6.0)


def hsv_from_rgb(color: Triple) -> Triple:
    most, _, delta = _extremes(color)
    saturation = operate("divide", delta, most)
    hue = _choose(saturation, _hue(color, most, delta), 0.0)
    return hue, saturation, most


def rgb_from_hsv(hsv: Triple) -> Triple:
    hue, saturation, value = hsv
    turned = operate("multiply", _choose(operate("compare", hue, 1.0, 0.0), 0.0, hue), 6.0)
    sector = operate("floor", turned)
    part = operate("subtract", turned, sector)

    def less(share: Value) -> Value:
        return operate("multiply", value, operate("subtract", 1.0, share))

    p, q = less(saturation), less(operate("multiply", saturation, part))
    t = less(operate("multiply", saturation, operate("subtract", 1.0, part)))
    sectors = [(value, t, p), (q, value, p), (p, value, t), (p, q, value), (t, p, value)]
    made: Triple = (value, p, q)
    for number, candidate in reversed(list(enumerate(sectors))):
        here = operate("compare", sector, float(number), 0.0)
        made = triple(_choose(here, a, b) for a, b in zip(candidate, made, strict=True))
    return triple(_choose(saturation, each, value) for each in made)


def hsl_from_rgb(color: Triple) -> Triple:
    most, least, delta = _extremes(color)
    both = operate("add", most, least)
    light = operate("minimum", 1.0, operate("multiply", both, 0.5))
    over = operate("divide", delta, operate("subtract", 2.0, both))
    under = operate("divide", delta, both)
    saturation = _choose(operate("greater_than", light, 0.5), over, under)
    hue = _hue(color, most, delta)
    return _choose(delta, hue, 0.0), _choose(delta, saturation, 0.0), light


def rgb_from_hsl(hsl: Triple) -> Triple:
    hue, saturation, light = hsl
    sixths = operate("multiply", hue, 6.0)

    def away(from_: float) -> Value:
        return operate("absolute", operate("subtract", sixths, from_))

    pure = (
        operate("subtract", away(3.0), 1.0),
        operate("subtract", 2.0, away(2.0)),
        operate("subtract", 2.0, away(4.0)),
    )
    middle = operate("absolute", operate("multiply_add", light, 2.0, -1.0))
    chroma = operate("multiply", operate("subtract", 1.0, middle), saturation)
    made = []
    for each in pure:
        clamped = operate("minimum", operate("maximum", each, 0.0), 1.0)
        made.append(operate("multiply_add", operate("subtract", clamped, 0.5), chroma, light))
    return triple(made)


def _same(color: Triple) -> Triple:
    return color


MODES: dict[str, tuple[Callable[[Triple], Triple], Callable[[Triple], Triple]]] = {
    "RGB": (_same, _same),  # to RGB, and from it
    "HSV": (rgb_from_hsv, hsv_from_rgb),
    "HSL": (rgb_from_hsl, hsl_from_rgb),
}


# ---- blend modes ---------------------------------------------------------------


def _lerp(a: Value, b: Value, share: Value) -> Value:
    rest = operate("subtract", 1.0, share)
    return operate("multiply_add", b, share, operate("multiply", a, rest))


def _faded(b: Value, f: Value) -> Value:
    """b by its share, 1 by the rest: what multiplies."""
    return operate("multiply_add", f, b, operate("subtract", 1.0, f))


def _complement(a: Value) -> Value:
    return operate("subtract", 1.0, a)


def _clamped(a: Value) -> Value:
    return operate("minimum", operate("maximum", a, 0.0), 1.0)


def _screen(a: Value, b: Value, f: Value) -> Value:
    return _complement(operate("multiply", _faded(_complement(b), f), _complement(a)))


def _overlay(a: Value, b: Value, f: Value) -> Value:
    dark = operate("multiply", a, _faded(operate("multiply", 2.0, b), f))
    bright = _faded(operate("multiply", 2.0, _complement(b)), f)
    bright = _complement(operate("multiply", bright, _complement(a)))
    return _choose(_is_less(a, 0.5), dark, bright)


def _divided(a: Value, b: Value, f: Value) -> Value:
    return _choose(b, _lerp(a, operate("divide", a, b), f), a)


def _exclusion(a: Value, b: Value, f: Value) -> Value:
    both = operate("multiply", operate("multiply", 2.0, a), b)
    made = operate("subtract", operate("add", a, b), both)
    return operate("maximum", _lerp(a, made, f), 0.0)


def _dodge(a: Value, b: Value, f: Value) -> Value:
    rest = _complement(operate("multiply", f, b))
    made = operate("minimum", operate("divide", a, rest), 1.0)
    return _choose(a, _choose(operate("greater_than", rest, 0.0), made, 1.0), a)


def _burn(a: Value, b: Value, f: Value) -> Value:
    rest = _faded(b, f)
    made = _clamped(_complement(operate("divide", _complement(a), rest)))
    return _choose(operate("greater_than", rest, 0.0), made, 0.0)


def _soft(a: Value, b: Value, f: Value) -> Value:
    screen = _complement(operate("multiply", _complement(a), _complement(b)))
    low = operate("multiply", operate("multiply", _complement(a), b), a)
    return _lerp(a, operate("multiply_add", a, screen, low), f)


_CHANNELS: dict[str, Callable[[Value, Value, Value], Value]] = {
    "MIX": _lerp,
    "ADD": lambda a, b, f: operate("multiply_add", f, b, a),
    "MULTIPLY": lambda a, b, f: operate("multiply", a, _faded(b, f)),
    "SUBTRACT": lambda a, b, f: operate("subtract", a, operate("multiply", f, b)),
    "SCREEN": _screen,
    "OVERLAY": _overlay,
    "DIVIDE": _divided,
    "DIFFERENCE": lambda a, b, f: _lerp(a, operate("absolute", operate("subtract", a, b)), f),
    "EXCLUSION": _exclusion,
    "DARKEN": lambda a, b, f: _lerp(a, operate("minimum", a, b), f),
    "LIGHTEN": lambda a, b, f: _lerp(a, operate("maximum", a, b), f),
    "DODGE": _dodge,
    "BURN": _burn,
    "SOFT_LIGHT": _soft,
    "LINEAR_LIGHT": lambda a, b, f: operate(
        "multiply_add", f, operate("multiply_add", 2.0, b, -1.0), a
    ),
}


def blend(mode: str, a: Triple, b: Triple, share: Value) -> Triple | None:
    """b on a by a share; None for a mode that is not known."""
    if mode in _CHANNELS:
        return triple(_CHANNELS[mode](x, y, share) for x, y in zip(a, b, strict=True))
    if mode not in ("HUE", "SATURATION", "VALUE", "COLOR"):
        return None
    h, s, v = hsv_from_rgb(a)
    other_h, other_s, other_v = hsv_from_rgb(b)
    if mode == "VALUE":
        return rgb_from_hsv((h, s, _lerp(v, other_v, share)))
    if mode == "SATURATION":
        made, counts = rgb_from_hsv((h, _lerp(s, other_s, share), v)), s
    else:
        made = rgb_from_hsv((other_h, s if mode == "HUE" else other_s, v))
        made = triple(_lerp(x, y, share) for x, y in zip(a, made, strict=True))
        counts = other_s
    return triple(_choose(counts, x, y) for x, y in zip(made, a, strict=True))


# ---- black bodies --------------------------------------------------------------


def blackbody(kelvin: NDArray) -> NDArray[np.float64]:
    """Linear Rec. 709 of a black body, of luminance 1.

    Source: Cycles' fit, svm_math_blackbody_color_rec709.
    """
    t = np.clip(np.asarray(kelvin, np.float64), 800.0, 12000.0)
    piece = np.searchsorted(_BODY_LIMITS, t, side="right")
    red, green, blue = (table[piece] for table in (_BODY_RED, _BODY_GREEN, _BODY_BLUE))
    r = red[..., 0] / t + red[..., 1] * t + red[..., 2]
    g = green[..., 0] / t + green[..., 1] * t + green[..., 2]
    b = ((blue[..., 0] * t + blue[..., 1]) * t + blue[..., 2]) * t + blue[..., 3]
    made = np.stack([r, g, b], axis=-1)
    made = np.where(np.asarray(kelvin)[..., None] < 800.0, _BODY_COLDEST, made)
    return np.where(np.asarray(kelvin)[..., None] >= 12000.0, _BODY_HOTTEST, made)


_BODY_COLDEST = np.array([5.413294490189271, -0.20319390035873933, -0.0822535242887164])
_BODY_HOTTEST = np.array([0.8262954810464208, 0.9945080501520986, 1.566307710274283])
_BODY_LIMITS = np.array([965.0, 1167.0, 1449.0, 1902.0, 3315.0, 6365.0])
_BODY_RED = np.array(
    [
        [1.61919106e3, -2.05010916e-3, 5.02995757],
        [2.48845471e3, -1.11330907e-3, 3.22621544],
        [3.34143193e3, -4.86551192e-4, 1.76486769],
        [4.09461742e3, -1.27446582e-4, 7.25731635e-1],
        [4.67028036e3, 2.91258199e-5, 1.26703442e-1],
        [4.59509185e3, 2.87495649e-5, 1.50345020e-1],
        [3.78717450e3, 9.35907826e-6, 3.99075871e-1],
    ]
)
_BODY_GREEN = np.array(
    [
        [-4.88999748e2, 6.04330754e-4, -7.55807526e-2],
        [-7.55994277e2, 3.16730098e-4, 4.78306139e-1],
        [-1.02363977e3, 1.20223470e-4, 9.36662319e-1],
        [-1.26571316e3, 4.87340896e-6, 1.27054498],
        [-1.42529332e3, -4.01150431e-5, 1.43972784],
        [-1.17554822e3, -2.16378048e-5, 1.30408023],
        [-5.00799571e2, -4.59832026e-6, 1.09098763],
    ]
)
_BODY_BLUE = np.array(
    [
        [5.96945309e-11, -4.85742887e-8, -9.70622247e-5, -4.07936148e-3],
        [2.40430366e-11, 5.55021075e-8, -1.98503712e-4, 2.89312858e-2],
        [-1.40949732e-11, 1.89878968e-7, -3.56632824e-4, 9.10767778e-2],
        [-3.61460868e-11, 2.84822009e-7, -4.93211319e-4, 1.56723440e-1],
        [-1.97075738e-11, 1.75359352e-7, -2.50542825e-4, -2.22783266e-2],
        [-1.61997957e-13, -1.64216008e-8, 3.86216271e-4, -7.38077418e-1],
        [6.72650283e-13, -2.73078809e-8, 4.24098264e-4, -7.52335691e-1],
    ]
)
