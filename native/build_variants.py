# SPDX-License-Identifier: GPL-3.0-or-later
"""Compile the core for checks, into build/VARIANT/package, and run Python over that.

    python native/build_variants.py VARIANT [SCRIPT or -m MODULE ...]

    address    AddressSanitizer and UndefinedBehaviorSanitizer; allocations can be made to fail
    thread     ThreadSanitizer
    coverage   counts how often every line and branch is reached
    portable   no vector instructions, for any processor
    aarch64    the same for 64-bit ARM, which nothing here can run

The first three by the system's gcc, whose gcov reads the counts, and as the runtime of
AddressSanitizer does not link under ziglang; the others by ziglang. The tests and their
scripts take the package from the folder that LEAPRAY_PACKAGE names; Python itself and
numpy stay as they are, so that a sanitizer watches the core alone.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import build_core

NATIVE = build_core.NATIVE
GCC = "gcc"
FLAGS = (
    *("-std=c17", "-g1", "-fPIC", "-fvisibility=hidden", "-ffp-contract=off", "-fno-math-errno"),
    *("-march=x86-64-v2", "-Iinclude", "-Isrc"),
    "-Wno-psabi",  # of vectors that are passed by value: none is to a function of another file
)
TRACED = ("-O1", "-fno-omit-frame-pointer")

# Has allocations fail where tests/allocation_failures.py asks for it.
FAULTS = NATIVE.parent / "tests" / "c" / "faulty_memory.c"
VECTOR = (
    *("closest_triangle_avx2.c", "closest_triangle_avx512.c"),
    *("cd_packet_avx2.c", "cd_packet_avx512.c"),
    *("ray_light_avx2.c", "ray_light_avx512.c"),
    *("cell_tests_avx2.c", "cell_tests_avx512.c"),
    *("ray_samples_avx2.c", "ray_samples_avx512.c"),
    *("triangle_tree_avx2.c", "triangle_tree_avx512.c"),
)
WRAPPED = ("malloc", "calloc", "realloc", "aligned_alloc", "mmap", "munmap", "free")


@dataclass(frozen=True)
class Variant:
    """One way to compile the core, and what the process that loads it needs."""

    flags: tuple[str, ...]  # to compile and to link
    target: str = ""  # of ziglang; by gcc where there is none
    x86: bool = True  # whether there are vector instructions
    faults: bool = False  # whether allocations can be made to fail
    runtime: str = ""  # of the sanitizer, which must come before all other libraries
    environment: tuple[tuple[str, str], ...] = ()


VARIANTS = {
    "address": Variant(
        (
            *(*TRACED, "-fsanitize=address,undefined", "-fno-sanitize-recover=undefined"),
            # AddressSanitizer sees the first two; of a check at every access, alignment's is of
            # no use on x86. What is left compiles in a third of the time.
            "-fno-sanitize=null,object-size,alignment",
            *("--param", "asan-instrumentation-with-call-threshold=0"),
        ),
        faults=True,
        runtime="libasan.so",
        environment=(
            ("ASAN_OPTIONS", "detect_leaks=0:allocator_may_return_null=1"),
            ("UBSAN_OPTIONS", "print_stacktrace=1:halt_on_error=1"),
        ),
    ),
    "thread": Variant(
        (*TRACED, "-fsanitize=thread"),
        runtime="libtsan.so",
        environment=(
            ("TSAN_OPTIONS", "halt_on_error=1:exitcode=66:ignore_noninstrumented_modules=1"),
        ),
    ),
    "coverage": Variant(
        ("-O1", "-fno-inline", "-DLR_INLINE=static inline", "--coverage", "-fprofile-update=atomic")
    ),
    "portable": Variant(("-DLR_PORTABLE",), target="x86_64-linux-gnu.2.28", x86=False),
    "aarch64": Variant((), target="aarch64-linux-gnu.2.28", x86=False),
}


def available() -> bool:
    """Whether the system has gcc."""
    return shutil.which(GCC) is not None


def command_of(name: str) -> tuple[tuple[str, ...], str]:
    """The command that compiles and links a variant, and what identifies its compiler."""
    variant = VARIANTS[name]
    if variant.target:
        zig, version = build_core.compiler()
        common = (*build_core.FLAGS, *build_core.PLACES)
        return (*zig, "-target", variant.target, *common, *variant.flags), version
    if not available():
        raise build_core.BuildError(f"the variant {name} of the core needs the system's {GCC}")
    faults = ("-include", str(FAULTS.with_suffix(".h"))) if variant.faults else ()
    asked = [GCC, "-dumpfullversion"]
    answer = subprocess.run(asked, capture_output=True, text=True, check=True).stdout.strip()
    return (GCC, *FLAGS, *variant.flags, *faults), answer


def compile_all(name: str) -> Path:
    """Compile what has changed; returns the folder that holds the Python package."""
    variant, folder = VARIANTS[name], build_core.OBJECTS / name
    command, version = command_of(name)
    made = folder / "package" / "leapray"
    with build_core.locked(folder / "lock"):
        build_core.content.cache_clear()
        sources = [
            source
            for source in sorted((NATIVE / "src").rglob("*.c"))
            if variant.x86 or source.name not in VECTOR
        ]
        sources += [FAULTS] * variant.faults
        tag = " ".join((version, *command))
        units = [build_core.Unit(source, tag, folder) for source in sources]
        build_core.compile_each([unit for unit in units if not unit.current()], command)
        others = shutil.ignore_patterns("*.so", "__pycache__")
        shutil.copytree(
            NATIVE / "leapray", made, ignore=others, copy_function=renew, dirs_exist_ok=True
        )
        library = made / "libleapray.so"
        beside = library.with_suffix(f".{os.getpid()}")
        wrapped = [f"-Wl,--wrap={name}" for name in WRAPPED] if variant.faults else []
        objects = [str(unit.object) for unit in units]
        build_core.run([*link(command), *wrapped, *objects, *build_core.LINK, "-o", str(beside)])
        beside.replace(library)
    return made.parent


def renew(source: str, copy: str) -> str:
    """Copy a file whose copy is another, at once: processes beside this one may read it."""
    now, known = Path(source), Path(copy)
    if not known.exists() or known.read_bytes() != now.read_bytes():
        beside = known.with_suffix(f".{os.getpid()}")
        shutil.copy2(now, beside)
        beside.replace(known)
    return copy


def link(command: tuple[str, ...]) -> tuple[str, ...]:
    """The same command without what is included before every file."""
    at = command.index("-include") if "-include" in command else len(command)
    return command[:at] + command[at + 2 :]


def environment(name: str) -> dict[str, str]:
    """The variables under which Python runs over the variant, which is compiled first."""
    variant = VARIANTS[name]
    env = os.environ | dict(variant.environment) | {"LEAPRAY_PACKAGE": str(compile_all(name))}
    if variant.runtime:
        # with the library of C++, whose exceptions the runtime wants to know from the start
        env["LD_PRELOAD"] = " ".join(map(path_of, (variant.runtime, "libstdc++.so.6")))
    return env


def path_of(name: str) -> str:
    """Where gcc finds a library; its name alone where it does not."""
    asked = [GCC, f"-print-file-name={name}"]
    answer = subprocess.run(asked, capture_output=True, text=True, check=True).stdout.strip()
    return os.path.realpath(answer) if os.path.isabs(answer) else answer


def python(words: list[str]) -> list[str]:
    """Python with these words, at addresses where ThreadSanitizer expects it."""
    fixed = ["setarch", "--addr-no-randomize"] if shutil.which("setarch") else []
    return [*fixed, sys.executable, *words]


def run(name: str, words: list[str]) -> int:
    """Run Python with these words over the variant; returns its exit code."""
    return subprocess.run(python(words), env=environment(name), check=False).returncode


def main() -> int:
    if len(sys.argv) < 2 or sys.argv[1] not in VARIANTS:
        print(__doc__, file=sys.stderr)
        return 2
    try:
        if sys.argv[2:]:
            return run(sys.argv[1], sys.argv[2:])
        print(compile_all(sys.argv[1]))
    except build_core.BuildError as error:
        print(f"build_variants: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
