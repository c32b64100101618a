# SPDX-License-Identifier: GPL-3.0-or-later
"""The core compiled with AddressSanitizer and UndefinedBehaviorSanitizer, and scripts over it.

The compiler is the system's: the runtime of AddressSanitizer does not link under ziglang.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import build_core

NATIVE = build_core.NATIVE
FOLDER = build_core.OBJECTS / "sanitized"
SANITIZERS = ("-fsanitize=address,undefined", "-fno-sanitize-recover=undefined")
FLAGS = (
    *("-std=c17", "-O1", "-g1", "-fno-omit-frame-pointer", "-fPIC", "-fvisibility=hidden"),
    *("-ffp-contract=off", "-fno-math-errno", "-march=x86-64-v2", "-Iinclude", "-Isrc"),
)
RUNTIMES = {"gcc": "libasan.so", "clang": "libclang_rt.asan-x86_64.so"}


def compiler() -> str:
    """gcc or clang, whichever the system has."""
    found = next((name for name in RUNTIMES if shutil.which(name)), None)
    if found is None:
        raise SystemExit("the sanitizers need the system's gcc or clang, and there is neither")
    return found


def package() -> Path:
    """A folder that holds the Python package over a sanitized core."""
    cc = compiler()
    headers = [path for end in ("h", "def") for path in NATIVE.rglob(f"*.{end}")]
    common = b"".join(path.read_bytes() for path in sorted(headers))
    common += " ".join((cc, *FLAGS, *SANITIZERS)).encode()
    FOLDER.mkdir(parents=True, exist_ok=True)

    def compile_one(source: Path) -> Path:
        key = hashlib.sha256(common + source.read_bytes()).hexdigest()[:16]
        output = FOLDER / f"{source.stem}-{key}.o"
        if not output.exists():
            beside = output.with_suffix(".new")
            command = [cc, *FLAGS, *SANITIZERS, "-c", str(source), "-o", str(beside)]
            subprocess.run(command, cwd=NATIVE, check=True)
            beside.rename(output)
        return output

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        objects = list(pool.map(compile_one, sorted((NATIVE / "src").rglob("*.c"))))
    made = FOLDER / "package" / "leapray"
    made.mkdir(parents=True, exist_ok=True)
    for path in (NATIVE / "leapray").glob("*.py"):
        shutil.copy(path, made)
    library = made / "libleapray.so"
    link = [cc, "-shared", *SANITIZERS, *map(str, objects), "-lm", "-o", str(library)]
    subprocess.run(link, check=True)
    return made.parent


def run(script: str, arguments: list[str]) -> int:
    """Run a script of this folder, which takes the package from LEAPRAY_PACKAGE, over it."""
    cc = compiler()
    asked = [cc, f"-print-file-name={RUNTIMES[cc]}"]
    runtime = subprocess.run(asked, capture_output=True, text=True, check=True).stdout.strip()
    env = os.environ | {
        "LEAPRAY_PACKAGE": str(package()),
        "LD_PRELOAD": os.path.realpath(runtime),
        "ASAN_OPTIONS": "detect_leaks=0:allocator_may_return_null=1",
        "UBSAN_OPTIONS": "print_stacktrace=1:halt_on_error=1",
    }
    return subprocess.run([sys.executable, script, *arguments], env=env, check=False).returncode
