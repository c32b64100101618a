# SPDX-License-Identifier: GPL-3.0-or-later
"""Fuzz targets, one per input format; run.py runs them."""

from __future__ import annotations

import numpy as np

WORDS = (0, 1, 2, 3, 7, 8, 9, 255, 256, 511, 512, 65535, 65536, 2**31 - 1, 2**31, 2**32 - 1)


def mutated(rng: np.random.Generator, data: bytes, head: int, other: bytes = b"") -> bytes:
    """A few changes: bits, bytes, words of 4, a cut, more at the end, a piece of other data.

    Half of them fall into the first head bytes.
    """
    made = bytearray(data)
    for _ in range(int(rng.integers(1, 5))):
        if not made:
            break
        at = int(rng.integers(min(head, len(made)) if rng.random() < 0.5 else len(made)))
        kind = rng.integers(10)
        if kind < 2:
            made[at] ^= 1 << int(rng.integers(8))
        elif kind < 4:
            made[at] = int(rng.integers(256))
        elif kind < 7:
            at -= at % 4
            word = WORDS[rng.integers(len(WORDS))]
            made[at : at + 4] = word.to_bytes(4, "little")[: len(made) - at]
        elif kind == 7:
            at -= at % 4
            word = int.from_bytes(made[at : at + 4], "little") + int(rng.integers(-2, 3))
            made[at : at + 4] = (word % 2**32).to_bytes(4, "little")[: len(made) - at]
        elif kind == 8 and rng.random() < 0.2:
            del made[at:]
        elif kind == 9 and other:
            start = int(rng.integers(len(other)))
            piece = other[start : start + int(rng.integers(1, 64))]
            made[at : at + len(piece)] = piece[: len(made) - at]
    return bytes(made)
