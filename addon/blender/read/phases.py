# SPDX-License-Identifier: GPL-3.0-or-later
"""Mean cosines of Blender's phase functions, by which others stand in for them (no bpy).

Sources: Draine 2003; Fournier and Forand 1994, Jonasz and Fournier 2007 (their integral); Jendersie
and d'Eon 2023, An approximate Mie scattering function for fog and cloud rendering (the fit).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

STEPS = 4096  # of an integral over directions


def draine(g: ArrayLike, alpha: ArrayLike) -> NDArray[np.float64]:
    """Of Draine's function, whatever the shapes of its parameters."""
    g, alpha = np.asarray(g, np.float64), np.asarray(alpha, np.float64)
    square = g * g
    return g * (1 + alpha * (3 + 2 * square) / 5) / (1 + alpha * (1 + 2 * square) / 3)


def mie(diameter: float) -> float:
    """Of water droplets of that diameter in micrometres, as a mixture of two functions."""
    hg, g, alpha, share = _droplets(max(diameter, 0.0))
    return float((1 - share) * hg + share * draine(g, alpha))


def _droplets(d: float) -> tuple[float, float, float, float]:
    """Henyey and Greenstein's g, Draine's g and alpha, and the share of the latter."""
    if d <= 0.1:
        return 13.8 * d * d, 1.1456 * d * math.sin(9.29044 * d), 250.0, 0.252977 - 312.983 * d**4.3
    if d >= 5.0:
        return (
            math.exp(-0.0990567 / (d - 1.67154)),
            math.exp(-2.20679 / (d + 3.91029) - 0.428934),
            math.exp(3.62489 - 8.29288 / (d + 5.52825)),
            math.exp(-0.599085 / (d - 0.641583) - 0.665888),
        )
    x = math.log(d)
    if d >= 1.5:
        y = math.log(x)
        return (
            0.0604931 * y + 0.940256,
            0.500411 - 0.081287 / (math.tan(x) - 2.0 * x + 1.27551),
            7.30354 * x + 6.31675,
            0.026914 * (x - math.cos(5.68947 * (y - 0.0292149))) + 0.3764,
        )
    turn = (x - 0.238604) * (x + 1.00667) / (0.507522 - 0.15677 * x)
    return (
        0.862 - 0.143 * x * x,
        0.379685 * math.cos(1.19692 * math.cos(turn) + 1.37932 * x + 0.0625835) + 0.344213,
        250.0,
        0.146209 * math.cos(3.38707 * x + 2.11193) + 0.316072 + 0.0778917 * x,
    )


def fournier_forand(ior: float, backscatter: float) -> float:
    """Of particles of that index of refraction, which scatter that share backwards."""
    n, b = max(ior, 1.001), min(abs(backscatter), 0.499)  # as Cycles limits them
    # By parts: the mean of 1 - 2 s, s the square of the half angle's sine, is that of its integral.
    s = ((np.arange(STEPS) + 0.5) / STEPS) ** 4  # most is scattered almost straight on
    weight = 4 * s**0.75 / STEPS
    return float(2 * (_within(s, n, b) * weight).sum() - 1)


def _within(s: NDArray[np.float64], n: float, b: float) -> NDArray[np.float64]:
    """The share that is scattered by smaller angles than s tells."""
    reach = 4 / (3 * (n - 1) ** 2)
    half, whole = reach / 2, reach
    slope = -math.log(2 * b * (half - 1) + 1) / math.log(half)
    delta = reach * s
    power = delta**slope
    within = (1 - power * delta - (1 - power) * s) / ((1 - delta) * power)
    rest = (1 - whole**slope) / (8 * (whole - 1) * whole**slope)
    return within + rest * (1 - 2 * s) * 4 * s * (1 - s)
