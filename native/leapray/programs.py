# SPDX-License-Identifier: GPL-3.0-or-later
"""Programs of shader operations: values that may depend on an image's colour.

A value is a number, or a Step, which depends on the inputs: the colour and alpha
of what is looked up in a texture. `operate` computes with both, as Cycles does with
f32; what depends on nothing is a number at once. `compile` makes a Program of the
steps that lead to three outputs.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _abi
from ._abi import LR_PROGRAM_REGISTERS
from ._lib import LeapRayError, check, lib
from .arrays import members, pointer, record

OPERATIONS = members(_abi.lr_operation)
NAMES = {int(number): name for name, number in OPERATIONS.items()}
TABLE = OPERATIONS["table"]
KINDS = members(_abi.lr_table_kind)


class Table:
    """A curve through n points at equal distances on 0..1.

    values: (n,), n >= 2. kind says what lies between and beyond: "linear" between,
    its ends beyond; "constant", the value before; "extrapolate", linear throughout.
    """

    def __init__(self, values: ArrayLike, kind: str = "linear") -> None:
        self.values = np.ascontiguousarray(values, np.float32)
        self.kind = KINDS[kind]

    def at(self, x: Value) -> Value:
        """The value at x, 0..1; a Step where x is one."""
        step = Step(TABLE, (x,), self)
        if isinstance(x, Step):
            return step
        return float(compile_program((step, 0.0, 0.0)).run(np.zeros((1, 4)))[0, 0])


class Step:
    """One operation on values, or one of the four inputs (operation -1).

    operation: its number in the core. arguments: one to three values. table: what the operation
    of looking up takes beside.
    """

    __slots__ = ("arguments", "operation", "table")

    def __init__(
        self, operation: int, arguments: tuple[Value, ...], table: Table | None = None
    ) -> None:
        self.operation, self.arguments, self.table = operation, arguments, table


Value = float | Step

INPUTS = tuple(Step(-1, (float(channel),)) for channel in range(4))  # red, green, blue, alpha


def operate(name: str, *arguments: Value) -> Value:
    """The operation of that name, as in OPERATIONS, on one to three values, its arguments.

    name: as Blender's Math node has it, in lower case. A number where all arguments are numbers,
    else a Step.
    """
    operation = OPERATIONS[name]
    if any(isinstance(each, Step) for each in arguments):
        return Step(operation, arguments)
    return lib.lr_operate(operation, *arguments, *(0.0,) * (3 - len(arguments)))


class Program:
    """What becomes of an image's colour; made by compile_program, kept by textures.

    instructions: (n, 5), as lr_instruction; constants: numbers that these name; tables: curves
    that they look up; outputs: three operands. leapray.h says what each number means.
    """

    def __init__(
        self,
        instructions: Sequence[tuple[int, ...]],  # (n, 5)
        constants: Sequence[float],
        tables: Sequence[Table],
        outputs: Sequence[int],
    ) -> None:
        self._code = np.array([tuple(row) for row in instructions], record(_abi.lr_instruction))
        self._constants = np.array(constants, np.float32)
        rows = self._tables = np.zeros(len(tables), record(_abi.lr_table))
        rows["n"] = [len(table.values) for table in tables]
        rows["first"] = np.cumsum(rows["n"]) - rows["n"]
        rows["kind"] = [table.kind for table in tables]
        values = [table.values for table in tables]
        self._values = np.concatenate(values) if values else np.zeros(0, np.float32)
        self._outputs = tuple(outputs)
        self.packed = _abi.lr_program(
            instructions=pointer(self._code, _abi.lr_instruction),
            n_instructions=len(self._code),
            constants=pointer(self._constants, ctypes.c_float),
            n_constants=len(self._constants),
            tables=pointer(self._tables, _abi.lr_table),
            n_tables=len(self._tables),
            values=pointer(self._values, ctypes.c_float),
            n_values=len(self._values),
            outputs=self._outputs,
        )

    @property
    def key(self) -> bytes:
        """Equal for programs that do the same in the same way."""
        arrays = (self._code, self._constants, self._tables, self._values)
        return b"|".join((repr(self._outputs).encode(), *(array.tobytes() for array in arrays)))

    def run(self, inputs: ArrayLike) -> NDArray[np.float32]:
        """Linear RGB (n, 3) of inputs (n, 4), colours with alpha.

        Raises LeapRayError for other shapes.
        """
        colors = np.ascontiguousarray(inputs, np.float32)
        if colors.ndim != 2 or colors.shape[1] != 4:
            raise LeapRayError(f"inputs must have the shape (n, 4); it is {colors.shape}")
        made = np.empty((len(colors), 3), np.float32)
        error = _abi.lr_error()
        status = lib.lr_program_run(
            ctypes.byref(self.packed),
            pointer(colors, ctypes.c_float),
            len(colors),
            pointer(made, ctypes.c_float),
            ctypes.byref(error),
        )
        check(status, error)
        return made

    def paint(self, colors: ArrayLike) -> NDArray[np.float32]:
        """Linear RGB, (height, width, 3), of colors (height, width, 4), with alpha; or any other
        shape whose last side is 4. Raises LeapRayError for others.
        """
        whole = np.asarray(colors, np.float32)
        return self.run(whole.reshape(-1, 4)).reshape(*whole.shape[:-1], 3)


def steps_to(outputs: Iterable[Value]) -> list[Step]:
    """All steps that the outputs need, each after those that it needs itself."""
    order: list[Step] = []
    seen: set[int] = set()
    stack: list[tuple[Step, Iterator[Value]]] = []

    def enter(value: Value) -> None:
        if isinstance(value, Step) and id(value) not in seen:
            seen.add(id(value))
            stack.append((value, iter(value.arguments)))

    for output in outputs:
        enter(output)
        while stack:
            step, rest = stack[-1]
            following = next(rest, None)
            if following is None:
                order.append(step)
                stack.pop()
            else:
                enter(following)
    return order


class _Compiler:
    """Gives steps their registers, in their order, and takes them back after their last use."""

    def __init__(
        self, outputs: tuple[Value, ...], order: list[Step], inputs: Sequence[Step]
    ) -> None:
        self.constants: dict[float | str, int] = {}
        self.values: list[float] = []
        self.registers = {id(step): channel for channel, step in enumerate(inputs)}
        self.free = list(range(LR_PROGRAM_REGISTERS - 1, len(INPUTS) - 1, -1))
        self.last: dict[int, int] = {}
        for number, step in enumerate(order):
            self.last.update((id(each), number) for each in step.arguments)
        self.last.update((id(each), len(order)) for each in outputs)

    def operand(self, value: Value) -> int:
        if isinstance(value, Step):
            return self.registers[id(value)]
        key = value if value == value and value != 0.0 else repr(value)  # NaN, and -0.0
        if key not in self.constants:
            self.constants[key] = len(self.values)
            self.values.append(value)
        operand = LR_PROGRAM_REGISTERS + self.constants[key]
        if operand > np.iinfo(np.uint16).max:
            raise LeapRayError("a program has too many constants")
        return operand

    def give(self, step: Step, number: int) -> int:
        """The register of a step that is made; those that it uses last are free for it."""
        for each in {id(a): a for a in step.arguments if isinstance(a, Step)}.values():
            if self.last[id(each)] == number and each.operation >= 0:
                self.free.append(self.registers[id(each)])
        if not self.free:
            most = LR_PROGRAM_REGISTERS - len(INPUTS)
            raise LeapRayError(f"a program holds more than {most} values at once")
        self.registers[id(step)] = self.free.pop()
        return self.registers[id(step)]


def inputs_of(outputs: Iterable[Value]) -> list[Step]:
    """Those of INPUTS that the outputs depend on, in their order."""
    used = {id(step) for step in steps_to(outputs)}
    return [step for step in INPUTS if id(step) in used]


def numbers_of(outputs: Iterable[Value]) -> list[float]:
    """All numbers that the outputs are made of."""
    parts = [*outputs, *(a for step in steps_to(outputs) for a in step.arguments)]
    return [part for part in parts if not isinstance(part, Step)]


def compile_program(
    outputs: tuple[Value, Value, Value], inputs: Sequence[Step] = INPUTS
) -> Program:
    """The program that makes three values, its outputs. inputs: what the channels of its colours
    are.

    Raises LeapRayError where it holds too many.
    """
    order = [step for step in steps_to(outputs) if step.operation >= 0]
    made = _Compiler(outputs, order, inputs)
    tables: dict[int, tuple[int, Table]] = {}
    code = []
    for number, step in enumerate(order):
        operands = [made.operand(each) for each in step.arguments]
        if step.table is not None:
            index, _ = tables.setdefault(id(step.table), (len(tables), step.table))
            operands.append(index)
        operands += operands[:1] * (3 - len(operands))
        code.append((step.operation, made.give(step, number), *operands))
    ends = [made.operand(each) for each in outputs]
    return Program(code, made.values, [table for _, table in tables.values()], ends)


AFFINE = ("add", "subtract", "multiply", "multiply_add", "divide")


def is_affine(outputs: Iterable[Value]) -> bool:
    """Whether the outputs are sums of multiples of the inputs: such a program may run before
    colours are interpolated. False may be wrong."""
    for step in steps_to(outputs):
        if step.operation < 0:
            continue
        name = NAMES[step.operation]
        depends = [isinstance(each, Step) for each in step.arguments]
        products = all(depends[:2]) if name in ("multiply", "multiply_add") else False
        if name not in AFFINE or products or (name == "divide" and depends[1]):
            return False
    return True
