# SPDX-License-Identifier: GPL-3.0-or-later
"""The tricubic B-spline by its definition, and its first root along rays by looking everywhere."""

from __future__ import annotations

import numpy as np

REACH = 4  # samples that are known beyond the lattice


def basis(x):
    """The cubic B-spline with knots at whole numbers, centred at 0."""
    x = np.abs(x)
    near, far = 2 / 3 - x**2 + x**3 / 2, (2 - x) ** 3 / 6
    return np.where(x < 1, near, np.where(x < 2, far, 0.0))


def basis_slope(x):
    size = np.abs(x)
    near, far = -2 * size + 1.5 * size**2, -((2 - size) ** 2) / 2
    return np.sign(x) * np.where(size < 1, near, np.where(size < 2, far, 0.0))


class Spline:
    """Of samples (nz, ny, nx), in index coordinates; outside: what lies beyond them, None: they
    are repeated there."""

    def __init__(self, samples, outside: float | None = 0.0) -> None:
        more = {"mode": "edge"} if outside is None else {"constant_values": outside}
        self.samples = np.pad(np.asarray(samples, np.float64), REACH, **more)

    def _weigh(self, points, kernels):
        first = np.floor(points).astype(int) - 1
        at = first[:, :, None] + np.arange(4)
        w = [kernels[a](points[:, a, None] - at[:, a]) for a in range(3)]
        limit = np.array(self.samples.shape[::-1]) - 1
        x, y, z = (np.clip(at[:, a] + REACH, 0, limit[a]) for a in range(3))
        block = self.samples[z[:, :, None, None], y[:, None, :, None], x[:, None, None, :]]
        rows = (block * w[0][:, None, None, :]).sum(3)
        return ((rows * w[1][:, None, :]).sum(2) * w[2]).sum(1)

    def value(self, points):
        return self._weigh(points, (basis,) * 3)

    def gradient(self, points):
        each = [[basis_slope if a == b else basis for b in range(3)] for a in range(3)]
        return np.column_stack([self._weigh(points, kernels) for kernels in each])

    def first_roots(self, level, origins, directions, t_max, n=1200):
        """The first t in 0..t_max at which f - level is seen to change sides at n steps."""
        steps = np.linspace(0, t_max, n + 1)
        found = np.full(len(origins), np.inf)
        for i, (o, d) in enumerate(zip(origins, directions, strict=True)):
            above = self.value(o + steps[:, None] * d) >= level
            changes = np.flatnonzero(above[1:] != above[:-1])
            if not len(changes):
                continue
            a, b = steps[changes[0]], steps[changes[0] + 1]
            for _ in range(60):
                middle = (a + b) / 2
                if (self.value((o + middle * d)[None])[0] >= level) == above[changes[0]]:
                    a = middle
                else:
                    b = middle
            found[i] = b
        return found


def mixed_cells(samples, level, outside=0.0):
    """Which of the cells -2..n have samples on both sides among the 4^3 by which they are given."""
    solid = np.pad(np.asarray(samples, np.float64), 3, constant_values=outside) >= level
    windows = np.lib.stride_tricks.sliding_window_view(solid, (4, 4, 4))
    return windows.any((3, 4, 5)) & ~windows.all((3, 4, 5))
