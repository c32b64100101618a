# SPDX-License-Identifier: GPL-3.0-or-later
"""Light along rays side by side is that of each ray alone, by every instruction set and walk."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest
import ramps
from numpy.testing import assert_allclose, assert_array_equal

import leapray
from leapray import _abi
from tests import compiled

SETS = [_abi.LR_SIMD_AVX2, _abi.LR_SIMD_AVX512]
SIDE = 29
MANY = 40  # knots, which are searched
TOLERANCE = 1e-7  # at which many parts of cells are halved


def knots(n: int = 6):
    """Of values from 0 to 1: an invisible end, a jump, colours that turn, emission."""
    rng = np.random.default_rng(1)
    values = np.sort(rng.uniform(0.2, 0.9, n))
    values[1] = values[2]
    extinction, shines = rng.exponential(0.4, n), rng.random((n, 3))
    extinction[[0, -1]] = shines[[0, -1]] = shines[1:3] = 0.0
    return values, extinction, rng.random((n, 3)), shines


def field(dtype: str) -> np.ndarray:
    wave = np.clip(0.5 + 0.5 * ramps.noise(np.random.default_rng(3), SIDE), 0, 1)
    top = {"u1": 255, "u2": 65535, "f4": 1}[dtype]
    return (wave * top if dtype == "f4" else np.round(wave * top)).astype(dtype)


def seen(dtype: str, n: int = 6, **more) -> leapray.Volume:
    values, *rest = knots(n)
    top = {"u1": 255, "u2": 65535, "f4": 1}[dtype]
    return ramps.volume(field(dtype), (values * top, *rest), **more)


def some_rays(n: int):
    o, d = ramps.rays(np.random.default_rng(4), n, SIDE - 1.0)
    d[:5], d[5:10, 2] = np.eye(5, 3) + np.eye(5, 3, -3), 0.0
    return o, d


def trace(volume, o, d, spec: str = "cd", **more) -> leapray.Hits:
    return leapray.trace(leapray.build(volume, spec), o, d, mode="volume", **more)


def bits(hits: leapray.Hits) -> np.ndarray:
    return np.column_stack([hits.t, hits.color, hits.transmittance])


@pytest.mark.parametrize("n", [6, MANY])
@pytest.mark.parametrize("dtype", ["u1", "u2", "f4"])
def test_a_ray_sees_alone_what_it_sees_beside_others(dtype, n):
    volume = seen(dtype, n)
    o, d = some_rays(300)
    d[::7] *= -1  # away
    every = bits(trace(volume, o, d, tolerance=TOLERANCE, stop_opacity=0.9))
    alone = [
        bits(trace(volume, o[i : i + 1], d[i : i + 1], tolerance=TOLERANCE, stop_opacity=0.9))
        for i in range(300)
    ]
    assert_array_equal(np.concatenate(alone), every)
    assert (every[:, 4] < 0.2).mean() > 0.2 and np.isinf(every[::7, 0]).all()


@pytest.mark.parametrize("spec", ["cd", "aw"])
@pytest.mark.parametrize("dtype", ["u1", "f4"])
def test_cells_left_out_and_leaps_change_no_bit(spec, dtype):
    o, d = some_rays(1500)
    all_cells = bits(trace(seen(dtype, everywhere=True), o, d, "aw"))
    got = trace(seen(dtype), o, d, spec)
    assert_array_equal(bits(got), all_cells)
    assert got.counters["tests"] < 0.9 * trace(seen(dtype, everywhere=True), o, d).counters["tests"]


def test_parts_before_a_cut_and_behind_it_are_the_whole():
    volume, (o, d) = seen("u2"), some_rays(300)
    cut = np.random.default_rng(5).uniform(0.2, 1.2, 300)
    whole = trace(volume, o, d, tolerance=1e-9)
    first = trace(volume, o, d, t_max=cut, tolerance=1e-9)
    then = trace(volume, o, d, t_min=cut, tolerance=1e-9)
    assert_allclose(first.transmittance * then.transmittance, whole.transmittance, rtol=1e-10)
    both = first.color + first.transmittance[:, None] * then.color
    assert_allclose(both, whole.color, atol=1e-8 * SIDE)  # emission by the length of the path


# ---- instruction sets ----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def library(tmp_path_factory) -> ctypes.CDLL:
    core = [f"trace/ray_light{kind}" for kind in ("", "_avx2", "_avx512")]
    core += ["trace/emission_absorption", "trace/modulated_light", "base/cpu", "base/error"]
    return compiled.library(tmp_path_factory.mktemp("light"), "light", core)


@pytest.mark.parametrize("stops", [False, True])
@pytest.mark.parametrize("simd", SETS)
def test_all_instruction_sets_give_the_same_bits(library, simd, stops):
    if library.light_simd() < simd:
        pytest.skip("the processor lacks it")

    def pointer(array):
        return array.ctypes.data_as(ctypes.c_void_p)

    volume, (o, d) = seen("u2"), some_rays(3000)
    rng = np.random.default_rng(7)
    t_max, stop = rng.uniform(0.5, 3, len(o)), rng.uniform(0.05, 1, len(o))
    rays, got = np.ascontiguousarray(np.column_stack([o, d, t_max, stop]).T), []
    for which in (_abi.LR_SIMD_PORTABLE, simd):
        out = np.zeros((5, len(o)))
        numbers = ctypes.c_double(TOLERANCE), ctypes.c_double(0.99)
        library.light_run(
            which, volume.handle, ctypes.c_uint64(len(o)), pointer(rays), int(stops), *numbers,
            pointer(out),
        )  # fmt: skip
        got.append(out)
    assert_array_equal(got[0], got[1])
    if stops:
        ended = np.isfinite(got[0][0])
        assert 0.2 < ended.mean() < 0.9
        assert_array_equal(got[0][4][ended], stop[ended])
    else:
        hits = trace(volume, o, d, t_max=t_max, tolerance=TOLERANCE, stop_opacity=0.99)
        assert_array_equal(got[0], bits(hits).T)
        assert (hits.transmittance < 0.5).mean() > 0.2
