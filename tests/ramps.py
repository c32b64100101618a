# SPDX-License-Identifier: GPL-3.0-or-later
"""Transfer functions and fields that the tests of visible volumes share."""

from __future__ import annotations

import numpy as np

import leapray

CT = (  # air and fat hidden, skin thin, bone dense: Hounsfield units, per millimetre
    [-600.0, -400.0, -150.0, 150.0, 300.0, 800.0],
    [0.0, 0.03, 0.0, 0.0, 0.1, 0.9],
    [
        (0.9, 0.6, 0.5),
        (0.9, 0.6, 0.5),
        (0.8, 0.5, 0.4),
        (0.9, 0.8, 0.6),
        (0.95, 0.9, 0.8),
        (1, 1, 1),
    ],
)


def grid(samples, matrix=None, **more) -> leapray.ScalarGrid:
    return leapray.ScalarGrid("test", np.asarray(samples), np.eye(4) if matrix is None else matrix,
                              **more)  # fmt: skip


def volume(samples, knots, matrix=None, **more) -> leapray.Volume:
    return leapray.visible_volume(
        grid(samples, matrix), leapray.TransferFunction(*knots), threads=1, **more
    )


def random_knots(rng, dense: float):
    """Knots over 0..1 and beyond, some of them jumps, some parts of them hidden."""
    n = int(rng.integers(1, 9))
    x = rng.uniform(-0.2, 1.2, n)
    if n > 2 and rng.random() < 0.4:
        x[1] = x[0]
    extinction = rng.exponential(1.0, n) * dense * (rng.random(n) < 0.8)
    shines = rng.random() < 0.4
    emission = rng.random((n, 3)) * (rng.random((n, 1)) < 0.5) if shines else None
    return np.sort(x), extinction, rng.random((n, 3)), emission


def noise(rng, n: int) -> np.ndarray:
    """Smooth on the whole, so that there is something to leap over."""
    z, y, x = np.mgrid[:n, :n, :n] * (5.0 / n)
    wave = np.sin(x + rng.uniform(0, 6)) * np.sin(y + rng.uniform(0, 6)) * np.cos(z)
    return (wave + 0.1 * rng.random((n, n, n))).astype(np.float32)


def rays(rng, n: int, size: float):
    """Rays from around a cube 0..size through it."""
    ends = rng.normal(size=(n, 3))
    origins = size * (0.5 + ends / np.linalg.norm(ends, axis=1, keepdims=True))
    return origins, size * rng.uniform(0.1, 0.9, (n, 3)) - origins


def largest(knots) -> float:
    return float(np.max(knots[2]))
