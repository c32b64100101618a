# SPDX-License-Identifier: GPL-3.0-or-later
"""Compile src/**/*.c into leapray/libleapray.so, only what has changed.

    python native/build_core.py [--force]

The compiler is the one that PyPI ships as `ziglang`, taken from the Python
that runs this file, so that no system compiler is needed and every machine
builds the same code: x86-64-v2, glibc 2.28 or later. An object is kept as long
as the hash of its command, its source and the headers it names stands; the
library is written beside and renamed, and a lock keeps two builds apart.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import importlib.metadata
import json
import os
import shlex
import subprocess
import sys
import sysconfig
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path

NATIVE = Path(__file__).resolve().parent
LIBRARY = NATIVE / "leapray" / "libleapray.so"
OBJECTS = NATIVE / "build"

TARGET = ("-target", "x86_64-linux-gnu.2.28", "-mcpu=x86_64_v2")
PLATFORM = "manylinux_2_28_x86_64"  # the same, as a wheel says it
FLAGS = (
    *("-std=c17", "-O2", "-gline-tables-only", "-fPIC", "-fvisibility=hidden"),
    *("-ffp-contract=off", "-fno-math-errno", "-fno-sanitize=undefined"),
    *("-Wall", "-Wextra", "-Wpedantic", "-Wshadow", "-Wstrict-prototypes", "-Wvla", "-Werror"),
    *("-Iinclude", "-Isrc"),
)
# The library is the same wherever it is built: debug lines forget where that was.
PACKAGES = sysconfig.get_path("purelib")
PLACES = (f"-ffile-prefix-map={NATIVE}=.", f"-ffile-prefix-map={PACKAGES}=packages")
LINK = ("-shared", "-lm")


class BuildError(Exception):
    """The compiler's own words, or why there is none."""


def compiler() -> tuple[tuple[str, ...], str]:
    """The command of the compiler and its version."""
    try:
        version = importlib.metadata.version("ziglang")
    except importlib.metadata.PackageNotFoundError:
        raise BuildError(
            f"{sys.executable} has no package ziglang, which holds the compiler; "
            "`python3 build.py build` uses an environment that has it"
        ) from None
    return (sys.executable, "-m", "ziglang", "cc"), version


@contextlib.contextmanager
def locked(path: Path):
    """Hold an exclusive lock on path.

    The compiler inherits it: where this process is killed, the lock lasts until
    the compilers that it left behind have ended too.
    """
    import fcntl

    path.parent.mkdir(parents=True, exist_ok=True)
    with open(path, "w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        os.set_inheritable(file.fileno(), True)
        yield


@cache
def content(path: Path) -> bytes:
    """Hash of one file, read once; empty where it is gone."""
    try:
        return hashlib.sha256(path.read_bytes()).digest()
    except FileNotFoundError:
        return b""


def run(command: list[str]) -> None:
    result = subprocess.run(
        command,
        cwd=NATIVE,
        capture_output=True,
        text=True,
        env=environment(),
        close_fds=False,  # see locked
        check=False,
    )
    if result.returncode:
        said = f"{shlex.join(command)}\n{result.stderr}{result.stdout}"
        raise BuildError(f"the core does not compile:\n{said}")


def environment() -> dict[str, str]:
    """The compiler keeps its own cache in the home folder; without one, here."""
    env = dict(os.environ)
    if not os.access(env.get("XDG_CACHE_HOME") or env.get("HOME") or "/nowhere", os.W_OK):
        env.setdefault("ZIG_GLOBAL_CACHE_DIR", str(OBJECTS / "zig-cache"))
    return env


class Unit:
    """One source file, its object, and the note of what the object was made from."""

    def __init__(self, source: Path, tag: str, folder: Path = OBJECTS) -> None:
        self.source = os.path.relpath(source, NATIVE)
        name = self.source.removeprefix("src/").removesuffix(".c").replace("/", ".").lstrip(".")
        self.object = folder / f"{name}.o"
        self.depends = folder / f"{name}.d"
        self.note = folder / f"{name}.key"
        self.tag = tag

    def key(self) -> str:
        """Hash of all that the object depends on; empty where that is not known yet."""
        try:
            rule = self.depends.read_text()
        except FileNotFoundError:
            return ""
        names = shlex.split(rule.replace("\\\n", " "))[1:]
        digest = hashlib.sha256(self.tag.encode())
        for name in names:
            digest.update(name.encode() + content(NATIVE / name))
        return digest.hexdigest()

    def current(self) -> bool:
        known = self.note.read_text() if self.note.exists() else "unknown"
        return self.object.exists() and known == self.key()

    def compile(self, command: tuple[str, ...]) -> None:
        """Compile by command, which holds all flags."""
        self.note.unlink(missing_ok=True)
        outputs = ["-MMD", "-MF", str(self.depends), "-o", str(self.object)]
        run([*command, "-c", self.source, *outputs])
        self.note.write_text(self.key())


def build(force: bool = False, say=lambda sentence: None) -> bool:
    """Bring the library up to date; true where something was compiled. Raises BuildError.

    Where nothing is to be done, nothing is written and no lock is taken.
    """
    command, version = compiler()
    content.cache_clear()
    if not force and current(*units_of(version)):
        return False
    try:
        with locked(OBJECTS / "lock"):
            content.cache_clear()
            return compile_stale(command, *units_of(version, force), say)
    except OSError as error:
        raise BuildError(
            f"the core is not compiled from these sources, and {NATIVE} cannot be written to by "
            f"you ({error.strerror}); have its owner run `python3 build.py build` once, or take "
            "a copy of your own"
        ) from None


def units_of(version: str, force: bool = False) -> tuple[list[Unit], list[Unit]]:
    """All units, and those that are not current."""
    sources = sorted((NATIVE / "src").rglob("*.c"))
    units = [Unit(source, " ".join((version, *TARGET, *FLAGS))) for source in sources]
    return units, [unit for unit in units if force or not unit.current()]


def current(units: list[Unit], stale: list[Unit]) -> bool:
    """Whether the library is that of the units."""
    note = OBJECTS / "library.key"
    linked = note.read_text() if LIBRARY.exists() and note.exists() else ""
    return not stale and linked == library_key(units)


def compile_stale(command: tuple[str, ...], units: list[Unit], stale: list[Unit], say) -> bool:
    """Compile the stale units and link all, under the lock; false where nothing is to be done."""
    if current(units, stale):
        return False
    say(f"compiling {len(stale)} of {len(units)} files of the core")
    compile_each(stale, (*command, *TARGET, *FLAGS, *PLACES))
    beside = LIBRARY.with_suffix(f".{os.getpid()}")
    objects = [str(unit.object) for unit in units]
    try:
        run([*command, *TARGET, *objects, *LINK, "-o", str(beside)])
        os.replace(beside, LIBRARY)
    finally:
        beside.unlink(missing_ok=True)
    (OBJECTS / "library.key").write_text(library_key(units))
    write_commands(command, units)
    return True


def compile_each(units: list[Unit], command: tuple[str, ...]) -> None:
    """Compile side by side; the first failure is raised."""
    pool = ThreadPoolExecutor(os.cpu_count())
    try:
        list(pool.map(lambda unit: unit.compile(command), units))
    finally:
        pool.shutdown(cancel_futures=True)


def write_commands(command: tuple[str, ...], units: list[Unit]) -> None:
    """compile_commands.json, by which editors and analysers know how each file is compiled."""
    entries = [
        {
            "directory": str(NATIVE),
            "file": str(NATIVE / unit.source),
            "arguments": [*command, *TARGET, *FLAGS, "-c", str(NATIVE / unit.source)],
        }
        for unit in units
    ]
    (NATIVE / "compile_commands.json").write_text(json.dumps(entries, indent=1))


def library_key(units: list[Unit]) -> str:
    """Hash of the objects' keys and the link line."""
    parts = [" ".join(LINK), *(unit.object.name + unit.key() for unit in units)]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def main() -> int:
    parser = argparse.ArgumentParser(description="Compile the core of LeapRay.")
    parser.add_argument("--force", action="store_true", help="compile every file")
    options = parser.parse_args()
    try:
        build(options.force, say=lambda sentence: print(sentence, file=sys.stderr))
    except BuildError as error:
        print(f"build_core: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
