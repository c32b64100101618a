# SPDX-License-Identifier: GPL-3.0-or-later
"""The integer oracle (oracle.c), compiled on first use, and the rays it can judge (no bpy)."""

from __future__ import annotations

import ctypes
import functools
import importlib.util
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from leapray import LeapRayError

SHIFT = 16  # origins are multiples of 2^-16
VERDICTS = ("sound", "missed", "late", "not wanted", "not touched")


@functools.cache
def library():
    """The compiled oracle. Raises LeapRayError where this Python has no compiler."""
    if importlib.util.find_spec("ziglang") is None:
        raise LeapRayError("the oracle needs ziglang, which this Python has not; start by build.py")
    source = Path(__file__).with_name("oracle.c")
    with tempfile.TemporaryDirectory(prefix="leapray-oracle-") as folder:
        target = Path(folder) / "oracle.so"
        flags = ["-O2", "-shared", "-fPIC", "-fno-sanitize=all"]
        command = [sys.executable, "-m", "ziglang", "cc", *flags, str(source), "-o", str(target)]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            raise LeapRayError(f"the oracle does not compile: {done.stderr.strip()[-500:]}")
        return ctypes.CDLL(str(target))  # stays, once loaded


def object_cells(samples, threshold):
    """Cells -1..n-1 per axis (nz+1, ny+1, nx+1) whose largest sample is at or above T."""
    padded = np.pad(samples.astype(np.float64), 1) >= threshold
    cells = np.zeros(tuple(np.array(padded.shape) - 1), bool)
    for dz in (0, 1):
        for dy in (0, 1):
            for dx in (0, 1):
                nz, ny, nx = cells.shape
                cells |= padded[dz : dz + nz, dy : dy + ny, dx : dx + nx]
    return cells


def judge(wanted, origins, directions, hit, cells):
    """Verdict (n,) on every claim, an index into VERDICTS, and whether a wanted cell is pierced.

    origins: multiples of 2^-16; directions: whole numbers.
    """
    grid = np.ascontiguousarray(wanted, np.uint8)
    size = np.array(grid.shape[::-1], np.int64)
    scaled = np.asarray(origins) * 2.0**SHIFT
    o, d = scaled.astype(np.int64), np.asarray(directions).astype(np.int64)
    assert (o == scaled).all() and (d == directions).all()  # the oracle judges exact input only
    n = len(o)
    verdict, exact = np.zeros(n, np.uint8), np.zeros(n, np.uint8)
    claims = np.ascontiguousarray(cells, np.int32)
    hits = np.ascontiguousarray(hit, np.uint8)

    def pointer(array):
        return ctypes.c_void_p(array.ctypes.data)

    o, d = np.ascontiguousarray(o), np.ascontiguousarray(d)
    library().oracle_judge(
        pointer(grid), pointer(size), pointer(o), pointer(d), ctypes.c_int64(n),
        ctypes.c_int(SHIFT), pointer(hits), pointer(claims), pointer(verdict), pointer(exact),
    )  # fmt: skip
    return verdict, exact.astype(bool)


def generic_rays(rng, n, size):
    """Rays from all around and from inside, towards points of the volume; a tenth anywhere."""
    span = np.array(size) + 2.0
    origins = rng.uniform(-1.5, 2.5, (n, 3)) * span
    inside = rng.random(n) < 0.3
    origins[inside] = rng.random((inside.sum(), 3)) * span - 1.0
    targets = rng.random((n, 3)) * span - 1.0
    loose = rng.random(n) < 0.1
    targets[loose] = rng.uniform(-1, 2, (loose.sum(), 3)) * span
    origins = np.round(origins * 2.0**SHIFT) / 2.0**SHIFT
    directions = np.round((targets - origins) * 2.0**12)
    directions[(directions == 0).all(axis=1)] = (1, 2, 3)
    return origins, directions


def lattice_rays(rng, n, size):
    """Rays aligned with the lattice: starts on corners, edges, faces and centres, inside and out;
    directions with zero, negative zero and negative components, some nearly parallel to an axis."""
    span = np.array(size) + 2
    origins = rng.integers(-4, 2 * span + 4, (n, 3)) / 2.0 - 1.0
    directions = rng.integers(-2, 3, (n, 3)).astype(float)
    steep = rng.random(n) < 0.1
    directions[steep] *= np.where(rng.random((steep.sum(), 3)) < 0.5, 2.0**30, 1.0)
    directions[(directions == 0).all(axis=1)] = (0, 0, -1)
    negative_zero = (directions == 0) & (rng.random((n, 3)) < 0.5)
    directions[negative_zero] = -0.0
    return origins, directions
