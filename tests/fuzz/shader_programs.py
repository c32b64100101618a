# SPDX-License-Identifier: GPL-3.0-or-later
"""Programs of shader nodes: any instructions are refused, or give the same colours twice."""

from __future__ import annotations

import numpy as np

import leapray
from leapray import programs
from leapray._abi import LR_PROGRAM_REGISTERS

NUMBERS = np.array([0.0, -0.0, 0.5, 1, -1, 2, 1e-30, 1e30, -1e30, np.inf, -np.inf, np.nan])


def check(rng: np.random.Generator) -> None:
    n, n_tables = int(rng.integers(1, 12)), int(rng.integers(0, 3))
    constants = NUMBERS[rng.integers(0, len(NUMBERS), int(rng.integers(1, 6)))]
    there = np.r_[:4, LR_PROGRAM_REGISTERS : LR_PROGRAM_REGISTERS + len(constants)]
    code = rng.choice(there, (n, 5))
    code[:, 0] = rng.integers(0, len(programs.OPERATIONS) - (n_tables == 0), n)
    code[:, 1] = rng.integers(0, 4, n)
    looks_up = code[:, 0] == programs.TABLE
    code[looks_up, 3] = rng.integers(0, max(n_tables, 1), looks_up.sum())
    outputs = rng.choice(there, 3)
    if rng.random() < 0.1:
        code[rng.integers(n), rng.integers(5)] = rng.integers(65536)
        outputs[rng.integers(3)] = rng.integers(65536)
    tables = [
        leapray.Table(rng.normal(size=int(rng.integers(2, 5))), kind)
        for kind in rng.choice(list(programs.KINDS), n_tables)
    ]
    program = leapray.Program(code.tolist(), constants, tables, outputs.tolist())
    looks = rng.normal(size=(16, 4))
    looks[rng.random(looks.shape) < 0.1] = NUMBERS[rng.integers(len(NUMBERS))]
    colors = program.run(looks)
    assert colors.shape == (16, 3), "no colours"
    assert colors.tobytes() == program.run(looks).tobytes(), "other colours"
