# SPDX-License-Identifier: GPL-3.0-or-later
"""Samples at equal steps are what a plain sum over them says, whoever takes them."""

from __future__ import annotations

import ctypes
from pathlib import Path

import numpy as np
import pytest
import ramps
from numpy.testing import assert_allclose, assert_array_equal

import leapray
from leapray import _abi
from tests import compiled

ROOT = Path(__file__).resolve().parents[2]
SETS = [_abi.LR_SIMD_AVX2, _abi.LR_SIMD_AVX512]
SIDE = 29
STEP = 0.37
KNOTS = (
    [0.3, 0.45, 0.45, 0.8, 0.9],
    [0.0, 0.3, 0.05, 0.4, 0.0],
    np.random.default_rng(1).random((5, 3)),
    np.random.default_rng(2).random((5, 3)) * [[0], [1], [1], [0], [0]],
)


def field(dtype: str) -> np.ndarray:
    wave = 0.5 + 0.5 * ramps.noise(np.random.default_rng(3), SIDE)
    top = {"u1": 255, "u2": 65535}.get(dtype)
    return (
        wave.astype(np.float32)
        if top is None
        else np.round(np.clip(wave, 0, 1) * top).astype(dtype)
    )


def some_rays(n: int):
    o, d = ramps.rays(np.random.default_rng(4), n, SIDE - 1.0)
    d[:5], d[5:10, 2] = np.eye(5, 3) + np.eye(5, 3, -3), 0.0
    return o, d


def trace(volume, o, d, **more) -> leapray.Hits:
    how = {"mode": "volume", "sampling": "post", "step": STEP, **more}
    return leapray.trace(leapray.build(volume), o, d, **how)


def classified(value: float):
    """Extinction, colour and emission of a value."""
    values = np.asarray(KNOTS[0])
    piece = np.searchsorted(values, value, "right")
    a, b = max(piece - 1, 0), min(piece, len(values) - 1)
    share = (value - values[a]) / (values[b] - values[a]) if values[b] > values[a] else 0.0
    return [np.asarray(x)[a] + share * (np.asarray(x)[b] - np.asarray(x)[a]) for x in KNOTS[1:]]


def summed(samples, o, d, t_max: float):
    """Colour and transmittance of one ray, by the definition of its samples."""
    length = np.linalg.norm(d)
    step = STEP / length  # in t: voxels are units here
    color, left = np.zeros(3), 1.0
    for k in range(int(min(t_max, 3 * SIDE / length) / step) + 1):
        q = o + k * step * d
        cell = np.floor(q).astype(int)
        if k * step >= t_max or (cell < 0).any() or (cell > SIDE - 2).any():
            continue
        p = q - cell
        corner = samples[tuple(slice(c, c + 2) for c in cell[::-1])].astype(float)
        value = ((corner @ [1 - p[0], p[0]]) @ [1 - p[1], p[1]]) @ [1 - p[2], p[2]]
        extinction, light, shines = classified(value)
        opacity = -np.expm1(-STEP * extinction)
        color += left * (opacity * light + STEP * shines)
        left *= 1 - opacity
    return color, left


@pytest.mark.parametrize("dtype", ["u1", "u2", "f4"])
def test_light_is_the_sum_over_samples_of_their_definition(dtype):
    stored = field(dtype)
    scale = {"u1": 1 / 255, "u2": 1 / 65535}.get(dtype, 1.0)
    volume = leapray.visible_volume(
        ramps.grid(stored, scale=scale), leapray.TransferFunction(*KNOTS)
    )
    assert 0.2 < volume.info.n_surface_cells / (SIDE - 1) ** 3 < 0.9
    o, d = some_rays(150)
    for t_max in (np.inf, 0.6):
        got = trace(volume, o, d, t_max=np.full(len(o), t_max))
        want = [summed(stored * scale, *ray, t_max) for ray in zip(o, d, strict=True)]
        assert_allclose(got.color, [color for color, _ in want], atol=1e-6)  # f32 * scale: 1e-7
        assert_allclose(got.transmittance, [left for _, left in want], atol=1e-6)
        assert got.transmittance.min() < 0.5


def test_samples_before_a_cut_and_behind_it_are_those_of_the_whole():
    volume = ramps.volume(field("f4"), KNOTS)
    o, d = some_rays(200)
    cut = np.random.default_rng(5).uniform(0.2, 1.2, 200)
    whole = trace(volume, o, d)
    first, then = trace(volume, o, d, t_max=cut), trace(volume, o, d, t_min=cut)
    assert_allclose(first.transmittance * then.transmittance, whole.transmittance, rtol=1e-12)
    both = first.color + first.transmittance[:, None] * then.color
    assert_allclose(both, whole.color, atol=1e-12)
    assert_array_equal(np.minimum(first.t, then.t), whole.t)


def test_rays_end_where_they_are_opaque():
    volume = ramps.volume(field("f4"), KNOTS)
    o, d = some_rays(200)
    whole, early = trace(volume, o, d), trace(volume, o, d, stop_opacity=0.6)
    ends = whole.transmittance < 0.4
    assert ends.sum() > 20 and early.counters["samples"] < whole.counters["samples"]
    assert (early.transmittance[ends] <= 0.4).all()
    assert_array_equal(early.color[~ends], whole.color[~ends])


@pytest.mark.parametrize("n", [1, 31, 33, 1025])
def test_rays_that_miss_and_any_number_of_rays_leave_no_trace_in_others(n):
    volume = ramps.volume(field("f4"), KNOTS)
    o, d = some_rays(1100)
    d[::3] *= -1  # away
    some, every = trace(volume, o[:n], d[:n]), trace(volume, o, d)
    assert_array_equal(some.color, every.color[:n])
    assert_array_equal(some.transmittance, every.transmittance[:n])
    assert not every.color[::3][5:].any() and (every.transmittance[::3][5:] == 1).all()


# ---- instruction sets ----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def library(tmp_path_factory) -> ctypes.CDLL:
    core = [f"trace/ray_samples{kind}" for kind in ("", "_avx2", "_avx512")]
    core += ["base/cpu", "base/error"]
    return compiled.library(tmp_path_factory.mktemp("samples"), "samples", core)


@pytest.mark.parametrize("normal", ["unlit", "central", "analytic"])
@pytest.mark.parametrize("full", [0.0, 9000.0])
@pytest.mark.parametrize("simd", SETS)
def test_all_instruction_sets_give_the_same_bits(library, simd, full, normal):
    if library.samples_simd() < simd:
        pytest.skip("the processor lacks it")

    def pointer(array):
        return array.ctypes.data_as(ctypes.c_void_p)

    knots = np.multiply(KNOTS[0], 65535), *KNOTS[1:], None, full
    volume = ramps.volume(field("u2"), knots)
    phong = None if normal == "unlit" else leapray.Phong(power=13)
    how = {"phong": phong} if phong is None else {"phong": phong, "normal": normal}
    o, d = some_rays(3000)
    rays, got = np.ascontiguousarray(np.concatenate([o, d], axis=1).T), []
    for which in (_abi.LR_SIMD_PORTABLE, simd):
        out = np.zeros((5, len(o)))
        library.samples_run(which, volume.handle, ctypes.c_uint64(len(o)), pointer(rays),
                            ctypes.c_double(STEP), ctypes.c_double(0.99),
                            None if phong is None else ctypes.byref(phong.in_c()),
                            leapray.tracing.NORMALS[how.get("normal", "central")],
                            pointer(out))  # fmt: skip
        got.append(out)
    assert_array_equal(got[0], got[1])
    hits = trace(volume, o, d, stop_opacity=0.99, **how)
    assert_array_equal(got[0], [hits.t, *hits.color.T, hits.transmittance])
    assert (hits.transmittance < 0.5).mean() > 0.2
