# SPDX-License-Identifier: GPL-3.0-or-later
"""Write leapray/_abi.py, the ctypes view of include/leapray.h.

    python native/generate_abi.py [--check]

The compiler's preprocessor takes away comments and macros, pycparser reads
what is left, and every enum, struct and function of the header comes out as
its ctypes twin under its own name. Macros that are numbers or strings, and the
comments behind the members of enums, are taken from the text. With --check
nothing is written: the difference is printed, and the exit code is 1 where
there is one.
"""

from __future__ import annotations

import argparse
import difflib
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from pycparser import c_ast, c_parser

import build_core

NATIVE = Path(__file__).resolve().parent
HEADER = NATIVE / "include" / "leapray.h"
TARGET = NATIVE / "leapray" / "_abi.py"

HEAD = '''\
# Generated from include/leapray.h by generate_abi.py; do not edit.
# SPDX-License-Identifier: GPL-3.0-or-later
"""The public C interface as ctypes: constants, enums, structs, prototypes.

ABOUT is what the header says of the members of enums.
"""

import ctypes
from enum import IntEnum
'''

SCALARS = {
    "char": "c_char",
    "int": "c_int",
    "float": "c_float",
    "double": "c_double",
    **{
        f"{sign}int{bits}_t": f"c_{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)
    },
}


def preprocess(header: Path) -> str:
    """The header without comments, macros and system includes."""
    command = [*build_core.compiler()[0], *build_core.TARGET]
    command += ["-E", "-P", "-nostdinc", "-DLR_API="]
    with tempfile.TemporaryDirectory() as folder:
        fixed = (name for name in SCALARS if name.endswith("_t"))
        text = "".join(f"typedef int {name};\n" for name in fixed)
        Path(folder, "stdint.h").write_text(text)
        result = subprocess.run(
            [*command, "-I", folder, str(header)], capture_output=True, text=True, check=False
        )
    if result.returncode:
        raise SystemExit(f"generate_abi: {header} does not preprocess:\n{result.stderr}")
    return result.stdout


def constant(node: c_ast.Node) -> int:
    """A whole number, maybe with a minus."""
    if isinstance(node, c_ast.UnaryOp) and node.op == "-":
        return -constant(node.expr)
    return int(node.value, 0)


class Writer:
    """Turns declarations of the header into lines of Python."""

    def __init__(self) -> None:
        self.enums: dict[str, dict[str, int]] = {}
        self.structs: dict[str, list[tuple[str, str]]] = {}  # no fields: opaque
        self.functions: list[tuple[str, str, list[str]]] = []

    def read(self, source: str) -> None:
        for node in c_parser.CParser().parse(source).ext:
            if isinstance(node, c_ast.Typedef):
                self.read_typedef(node)
            elif isinstance(node, c_ast.Decl) and isinstance(node.type, c_ast.FuncDecl):
                self.read_function(node)
            else:
                raise SystemExit(f"generate_abi: no rule for the declaration at {node.coord}")

    def read_typedef(self, node: c_ast.Typedef) -> None:
        inner = node.type.type
        if isinstance(inner, c_ast.Enum):
            values: dict[str, int] = {}
            for item in inner.values.enumerators:
                values[item.name] = constant(item.value) if item.value else len(values)
            if len(set(values.values())) < len(values):
                raise SystemExit(f"generate_abi: {node.name} gives one value to two names")
            self.enums[node.name] = values
        elif isinstance(inner, c_ast.Struct):
            fields = [(field.name, self.type_of(field.type)) for field in inner.decls or []]
            self.structs[node.name] = fields
        elif node.name not in SCALARS:
            raise SystemExit(f"generate_abi: no rule for the typedef {node.name}")

    def read_function(self, node: c_ast.Decl) -> None:
        params = node.type.args.params if node.type.args else []
        arguments = [self.type_of(param.type, argument=True) for param in params]
        arguments = [name for name in arguments if name != "None"]  # (void)
        self.functions.append((node.name, self.type_of(node.type.type), arguments))

    def type_of(self, node: c_ast.Node, argument: bool = False) -> str:
        """The ctypes expression for a type; an array as argument is a pointer."""
        if isinstance(node, c_ast.ArrayDecl) and not argument:
            return f"{self.type_of(node.type)} * {int(node.dim.value, 0)}"
        if isinstance(node, (c_ast.PtrDecl, c_ast.ArrayDecl)):
            target = self.type_of(node.type)
            special = {"None": "ctypes.c_void_p", "ctypes.c_char": "ctypes.c_char_p"}
            return special.get(target, f"ctypes.POINTER({target})")
        name = node.type.names[-1]
        if name == "void":
            return "None"
        if name in self.enums:
            return "ctypes.c_int"
        return name if name in self.structs else f"ctypes.{SCALARS[name]}"

    def lines(self):
        for name, values in self.enums.items():
            yield f"\n\nclass {name}(IntEnum):"
            yield from (f"    {item} = {value}" for item, value in values.items())
        yield "\n"
        for name, values in self.enums.items():
            names = ", ".join(values) if len(values) > 1 else f"({next(iter(values))},)"
            yield f"{names} = {name}"
        for name, fields in self.structs.items():
            yield f"\n\nclass {name}(ctypes.Structure):"
            if not fields:
                yield "    pass  # opaque"
                continue
            yield "    _fields_ = ("
            yield from (f'        ("{field}", {ctype}),' for field, ctype in fields)
            yield "    )"
        yield "\n\nPROTOTYPES = {"
        for name, result, arguments in self.functions:
            yield f'    "{name}": ({result}, (' + ("" if arguments else ")),")
            yield from (f"        {ctype}," for ctype in arguments)
            if arguments:
                yield "    )),"
        yield "}"


def constants(text: str):
    """The macros of the header that are numbers or strings."""
    for name, value in re.findall(r'^#define (LR_\w+) +("[^"]+"|-?\d[.\w]*)', text, re.MULTILINE):
        yield f"{name} = {value}"


def comments(text: str):
    """What stands behind the members of the header's enums."""
    yield "\nABOUT = {"
    for body in re.findall(r"^typedef enum \w+ {(.*?)}", text, re.MULTILINE | re.DOTALL):
        for name, told in re.findall(r"(LR_\w+) = -?\w+,?\s*/\*(.*?)\*/", body, re.DOTALL):
            yield f'    "{name}": "{" ".join(told.split())}",'
    yield "}"


def generate(header: Path) -> str:
    """The text of _abi.py for this header."""
    writer = Writer()
    writer.read(preprocess(header))
    text = header.read_text(encoding="utf-8")
    return "\n".join([HEAD, *constants(text), *writer.lines(), *comments(text)]) + "\n"


def main() -> int:
    parser = argparse.ArgumentParser(description="Write leapray/_abi.py from leapray.h.")
    parser.add_argument("--check", action="store_true", help="only say whether it is current")
    options = parser.parse_args()
    new = generate(HEADER)
    old = TARGET.read_text(encoding="utf-8") if TARGET.exists() else ""
    if options.check:
        names = (str(TARGET), "generated")
        diff = difflib.unified_diff(old.splitlines(True), new.splitlines(True), *names)
        sys.stdout.writelines(diff)
        return int(old != new)
    if old != new:
        TARGET.write_text(new, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
