# SPDX-License-Identifier: GPL-3.0-or-later
"""Programs of shader operations: what they compute, what they hold, what is refused."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import leapray
from leapray import INPUTS, LeapRayError, Table, compile_program, is_affine, operate
from leapray._abi import LR_PROGRAM_REGISTERS as REGISTERS
from leapray.programs import OPERATIONS, Program

RED, GREEN, BLUE, ALPHA = INPUTS


def inputs(n=64):
    return np.random.default_rng(1).uniform(-1, 2, (n, 4)).astype(np.float32)


def test_numbers_are_computed_at_once_and_steps_at_every_colour():
    assert operate("multiply_add", 2.0, 3.0, 4.0) == 10.0
    colors = inputs()
    got = compile_program((operate("multiply", RED, ALPHA), 0.25, BLUE)).run(colors)
    assert_array_equal(got[:, 0], colors[:, 0] * colors[:, 3])
    assert_array_equal(got[:, 1:], np.stack([np.full(64, 0.25), colors[:, 2]], 1))


@pytest.mark.parametrize("name", [name for name in OPERATIONS if name != "table"])
def test_a_step_computes_what_a_number_does(name):
    colors = inputs(200)
    colors[:40] = np.random.default_rng(2).choice((-2, -1, 0, 0.5, 1, 3), (40, 4))
    got = compile_program((operate(name, RED, GREEN, BLUE), 0.0, 0.0)).run(colors)[:, 0]
    want = [operate(name, *map(float, row[:3])) for row in colors]
    assert_array_equal(got, np.float32(want))


EDGES = [
    ("divide", (1, 0), 0), ("divide", (0, 0), 0), ("power", (-2, 2), 4), ("power", (-2, 3), -8),
    ("power", (-2, 0.5), 0), ("power", (0, 0), 1), ("power", (0, -1), 0), ("round", (-0.5,), 0),
    ("power", (-2, -1), -0.5), ("modulo", (-5, 3), -2), ("sign", (-0.0,), 0),
    ("logarithm", (0, 2), 0), ("logarithm", (-1, 2), 0), ("logarithm", (8, 2), 3),
    ("logarithm", (2, 1), 0), ("sqrt", (-4,), 0), ("inverse_sqrt", (0,), 0),
    ("modulo", (5, 0), 0), ("floored_modulo", (-5, 3), 1), ("wrap", (5, 3, 1), 1),
    ("wrap", (5, 1, 1), 1), ("pingpong", (5, 2), 1), ("pingpong", (5, 0), 0),
    ("compare", (1, 1, 0), 1), ("compare", (1, 1.5, 0.5), 1), ("smooth_min", (1, 2, 0), 1),
    ("arctan2", (0, 0), 0), ("arcsine", (3,), np.pi / 2),
    ("trunc", (-1.5,), -1), ("fract", (-0.25,), 0.75), ("multiply", (1e30, 1e30), np.inf),
]  # fmt: skip


@pytest.mark.parametrize(("name", "arguments", "want"), EDGES)
def test_edges(name, arguments, want):
    assert_allclose(operate(name, *map(float, arguments)), want, rtol=1e-6)


def test_tables():
    x = np.linspace(-0.5, 1.5, 41, dtype=np.float32)
    colors = np.repeat(x[:, None], 4, axis=1)
    values = np.array([1.0, 3.0, 2.0])

    def run(kind):
        return compile_program((Table(values, kind).at(RED), 0.0, 0.0)).run(colors)[:, 0]

    clipped = x.clip(0, 1)
    assert_allclose(run("linear"), np.interp(clipped, (0, 0.5, 1), values), atol=1e-6)
    assert_array_equal(run("constant"), values[(clipped * 2).astype(int)])
    beyond = np.where(x < 0, 1 + 4 * x, np.where(x > 1, 2 - 2 * (x - 1), run("linear")))
    assert_allclose(run("extrapolate"), beyond, atol=1e-5)
    assert Table(values).at(0.25) == 2.0


def test_long_chains_need_few_registers_and_shared_branches_run_once():
    value = RED
    for _ in range(5000):
        value = operate("multiply_add", value, 0.5, 0.25)
    for _ in range(200):  # 2^200 paths
        value = operate("multiply", operate("add", value, value), 0.5)
    program = compile_program((value, value, value))
    assert_allclose(program.run(inputs()), 0.5, atol=1e-6)


def test_too_many_values_at_once_are_refused():
    values = [operate("sine", operate("multiply", RED, float(k))) for k in range(REGISTERS)]
    total = values[0]
    for value in values[1:]:  # each is needed to the end
        total = operate("add", total, value)
    compile_program((total, 0.0, 0.0))
    for value in values:
        total = operate("add", total, value)
    with pytest.raises(LeapRayError, match="at once"):
        compile_program((total, 0.0, 0.0))


BROKEN = [
    dict(instructions=[(0, 4, 5, 0, 0)]),  # register 5 is not set
    dict(instructions=[(0, REGISTERS, 0, 0, 0)]),
    dict(instructions=[(len(OPERATIONS), 4, 0, 0, 0)]),
    dict(instructions=[(0, 4, 0, REGISTERS, 0)]),  # no constant
    dict(instructions=[(OPERATIONS["table"], 4, 0, 0, 0)]),  # no table
    dict(outputs=[0, 1, 9]),
]


@pytest.mark.parametrize("change", BROKEN)
def test_broken_programs_are_refused(change):
    parts = dict(instructions=[], constants=[], tables=[], outputs=[0, 1, 2]) | change
    with pytest.raises(LeapRayError, match="program"):
        Program(**parts).run(inputs())
    with pytest.raises(LeapRayError, match="program"):
        leapray.Texture(np.zeros((2, 2, 4)), program=Program(**parts))


def test_affine_programs_are_known():
    tinted = operate("multiply_add", RED, 0.5, operate("divide", GREEN, 2.0))
    assert is_affine((tinted, 1.0, ALPHA))
    assert not is_affine((operate("multiply", RED, GREEN), 0.0, 0.0))
    assert not is_affine((operate("divide", 1.0, RED), 0.0, 0.0))
    assert not is_affine((operate("maximum", RED, 0.0), 0.0, 0.0))


# ---- textures ------------------------------------------------------------------


def test_a_texture_runs_its_program_on_what_is_interpolated():
    pixels = np.zeros((1, 2, 4), np.float32)
    pixels[0, 1] = 1
    step = operate("greater_than", RED, 0.75)
    texture = leapray.Texture(pixels, "linear", "extend", compile_program((step, GREEN, ALPHA)))
    u = np.linspace(0.25, 0.75, 21)
    got = texture.sample(np.stack([u, np.full(21, 0.5)], 1))
    fraction = (u - 0.25) * 2
    assert_array_equal(got[:, 0], (fraction > 0.75 + 1e-6) | (np.arange(21) > 15))
    assert_allclose(got[:, 1:], np.stack([fraction, fraction], 1), atol=1e-6)


def test_the_mean_of_a_programs_looks_is_that_from_afar():
    rng = np.random.default_rng(3)
    pixels = rng.uniform(0, 1, (16, 16, 3)).astype(np.float32)
    step = operate("greater_than", RED, 0.5)
    texture = leapray.Texture(pixels, program=compile_program((step, step, step)))
    uv = rng.uniform(0, 1, (20000, 2))
    near = texture.sample(uv).mean()
    afar = texture.sample([[0.5, 0.5]], [[16, 0, 16]])[0, 0]
    assert afar == pytest.approx(near, abs=0.03)  # four looks of a texel
    smooth = leapray.Texture(pixels, "cubic")
    assert_allclose(smooth.sample([[0.5, 0.5]], [[16, 0, 16]])[0], pixels.mean((0, 1)), atol=0.01)


def test_what_is_no_number_is_black():
    pixels = np.full((1, 1, 3), 2.0, np.float32)
    huge = operate("exponent", operate("multiply", RED, 100.0))
    values = (huge, operate("subtract", 1.0, RED), RED)
    texture = leapray.Texture(pixels, program=compile_program(values))
    assert_array_equal(texture.sample([[0.5, 0.5]]), [[0, -1, 2]])


def test_a_texture_of_the_corners_needs_no_uvs():
    step = operate("greater_than", GREEN, 0.5)
    texture = leapray.Texture(None, program=compile_program((step, 0.25, BLUE)))
    vertices = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
    triangles = np.array([[0, 1, 2], [0, 2, 3]])
    corner = np.stack([np.zeros(4), vertices[:, 0] / 2 + 0.5, np.full(4, 0.75)], 1)
    carried = leapray.Attributes(
        color_sources=np.zeros(2, np.int32),
        colors=corner[triangles].astype(np.float32),
        textures=(texture,),
    )
    sheet = leapray.voxelize(vertices, triangles, 0.1, kind="sheet", attributes=carried)
    x = np.array([-0.83, -0.31, -0.02, 0.02, 0.31, 0.83])
    points = np.stack([x, np.full(6, 0.3), np.zeros(6)], 1)
    colors, _ = sheet.attributes(points, None, 0.0)
    want = np.stack([x > 0, np.full(6, 0.25), np.full(6, 0.75)], 1)
    assert_allclose(colors, want, atol=1e-6)
