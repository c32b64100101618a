# SPDX-License-Identifier: GPL-3.0-or-later
"""Files of the folder of volumes: whatever their bytes, the volume comes back as it was put there
or not at all; behind a seal that was made for other bytes, nothing worse than another volume."""

from __future__ import annotations

import atexit
import contextlib
import dataclasses
import json
import shutil
import tempfile
import zlib
from pathlib import Path

import bpy  # noqa: F401  OpenVDB comes with it
import meshes
import numpy as np

import leapray
from addon.store import disk_cache
from fuzz import mutated
from fuzz.packed_volumes import HEAD

KEY, ROOM = ("fuzz", 1), 10_000_000
MEMORY = Path("/dev/shm")  # files that are rewritten a thousand times a second
FOLDER = tempfile.mkdtemp(prefix="leapray-fuzz-", dir=MEMORY if MEMORY.is_dir() else None)
atexit.register(shutil.rmtree, FOLDER, ignore_errors=True)
SHELF = disk_cache.DiskCache(FOLDER)
VOLUME = leapray.voxelize(*meshes.box((-0.4, -0.4, -0.4), (0.4, 0.4, 0.4)), 0.4, threads=1)
PACKED = VOLUME.pack().tobytes()
SHELF.keep_volume(KEY, VOLUME)
PATH = SHELF.path(KEY)
FILE = PATH.read_bytes()
MESH = dataclasses.asdict(VOLUME.mesh_info)
VALUES = (0, -1, 1, 2**31, 2**63, 10**400, 0.5, float("nan"), None, True, "", "x", [], {}, [1, 2])


def check(rng: np.random.Generator) -> None:
    if rng.random() < 0.5:
        PATH.write_bytes(mutated(rng, FILE[::-1], 200)[::-1])  # the seal is at the end
        sealed_by_us = False
    else:
        PATH.write_bytes(resealed(rng))
        sealed_by_us = True
    with contextlib.suppress(leapray.OutOfMemory):
        found = SHELF.volume(KEY, ROOM)
        if found is None:
            assert not PATH.exists(), "what cannot be read stays there"
        elif not sealed_by_us:
            assert found.pack().tobytes() == PACKED, "another volume"
        else:
            assert found.pack().size, "no volume"


def resealed(rng: np.random.Generator) -> bytes:
    """Another head or other bytes of a volume under a seal that holds."""
    packed = mutated(rng, PACKED, HEAD) if rng.random() < 0.5 else PACKED
    head = {"nbytes": VOLUME.info.nbytes, "packed": len(packed), "mesh": dict(MESH)}
    kind = rng.integers(6)
    if kind == 0:
        head[list(head)[rng.integers(3)]] = VALUES[rng.integers(len(VALUES))]
    elif kind == 1:
        head["mesh"][list(MESH)[rng.integers(len(MESH))]] = VALUES[rng.integers(len(VALUES))]
    elif kind == 2:
        del head[list(head)[rng.integers(3)]]
    data = zlib.compress(packed, 1)
    sealed = disk_cache._sealed(KEY, head, mutated(rng, data, 20) if kind == 3 else data)
    if kind == 4:
        line = json.dumps({"name": disk_cache._name(KEY), **head}).encode()
        told = mutated(rng, line, len(line)) + b"\n" + data
        sealed = told + disk_cache.SEAL.pack(disk_cache.MAGIC, len(told), disk_cache._hash(told))
    return sealed
