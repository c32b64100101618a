# SPDX-License-Identifier: GPL-3.0-or-later
"""The studies' own C, compiled on first use (no bpy)."""

from __future__ import annotations

import ctypes
import functools
import importlib.util
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from numpy.typing import NDArray

from leapray import LeapRayError
from leapray.threads import cores

PART = 1 << 15  # rays that a thread takes at a time

# A named target is compiled against the headers that come with the compiler, whatever C library
# the machine has, or has half of.
TARGET = ("-target", "x86_64-linux-gnu.2.28", "-mcpu=x86_64_v2")


@functools.cache
def library(name: str) -> ctypes.CDLL:
    """name.c of this folder. Raises LeapRayError where this Python has no compiler."""
    if importlib.util.find_spec("ziglang") is None:
        raise LeapRayError(f"{name}.c needs ziglang, which this Python has not; start by build.py")
    source = Path(__file__).with_name(f"{name}.c")
    with tempfile.TemporaryDirectory(prefix=f"leapray-{name}-") as folder:
        target = Path(folder) / f"{name}.so"
        flags = ["-O2", "-shared", "-fPIC", "-fno-sanitize=all"]
        command = [sys.executable, "-m", "ziglang", "cc", *TARGET, *flags, str(source)]
        done = subprocess.run([*command, "-o", str(target)], capture_output=True, text=True)
        if done.returncode:
            raise LeapRayError(f"{name}.c does not compile: {done.stderr.strip()[-500:]}")
        return ctypes.CDLL(str(target))  # stays, once loaded


def pointer(array: NDArray) -> ctypes.c_void_p:
    """The address of a contiguous array, which must outlive the call."""
    assert array.flags.c_contiguous
    return ctypes.c_void_p(array.ctypes.data)


def in_parts(job, n: int) -> None:
    """job(first, last) over 0..n, side by side; what they call in C drops the lock."""
    bounds = [*range(0, n, PART), n]
    if n <= PART:
        job(0, n)
        return
    with ThreadPoolExecutor(cores()) as pool:
        list(pool.map(job, bounds[:-1], bounds[1:]))
