# SPDX-License-Identifier: GPL-3.0-or-later
"""Cells side by side give the same bits by every instruction set that the processor has."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest

from leapray import _abi
from tests import compiled

SOURCES = [f"trace/cell_lanes{kind}" for kind in ("", "_avx2", "_avx512")]
SOURCES += ["base/cpu", "base/error"]
SETS = [_abi.LR_SIMD_AVX2, _abi.LR_SIMD_AVX512]


@pytest.fixture(scope="module")
def library(tmp_path_factory) -> ctypes.CDLL:
    made = compiled.library(tmp_path_factory.mktemp("lanes"), "lanes", SOURCES)
    made.lanes_nbytes.restype = ctypes.c_uint64
    return made


def numbers(rng) -> np.ndarray:
    """A ray through eight cells that it may meet, with pieces of a transfer function."""
    table = np.zeros((17, 8))
    table[:8] = rng.random((8, 8)) * rng.choice([1.0, 1e-3, 1e5])
    table[8:11] = rng.integers(0, 3, (3, 8))
    o = rng.uniform(-3, 5, 3)
    table[11, :6] = [*o, *(rng.uniform(0, 3, 3) - o) * (rng.random(3) < 0.9)]
    table[12, :4] = [0.0, rng.choice([0.7, np.inf]), 1e-4, rng.uniform(0.1, 3)]
    table[13], table[14:16] = rng.random(8), rng.exponential(0.3, (2, 8))
    table[16] = rng.random(8) * (rng.random() < 0.8)
    return table


@pytest.mark.parametrize("simd", SETS)
def test_all_instruction_sets_give_the_same_bits(library, simd):
    if library.lanes_simd() < simd:
        pytest.skip("the processor lacks it")
    rng, n, met = np.random.default_rng(1), library.lanes_nbytes(), 0
    for _ in range(2000):
        table = numbers(rng)
        got = np.zeros((2, n), np.uint8)
        for row, which in zip(got, (_abi.LR_SIMD_PORTABLE, simd), strict=True):
            library.lanes_run(which, table.ctypes.data_as(ctypes.c_void_p),
                              row.ctypes.data_as(ctypes.c_void_p))  # fmt: skip
        np.testing.assert_array_equal(got[0], got[1])
        met += (got[0].view(np.float64)[-8:] == 1).any()
    assert met > 100  # some are within the tolerance, so that something was integrated
