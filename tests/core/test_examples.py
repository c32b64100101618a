# SPDX-License-Identifier: GPL-3.0-or-later
"""The example in C compiles as its page says, and finds what it must."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "native"))

import build_core  # noqa: E402

STRICT = [flag for flag in build_core.FLAGS if flag.startswith("-W")]


def test_the_minimal_example_hits_the_cube_where_it_is(tmp_path):
    page = (ROOT / "native" / "README.md").read_text(encoding="utf-8")
    line = re.search(r"^\S+ -m ziglang cc (.*) -o minimal$", page, re.M)[1]
    words = shlex.split(line.replace("$PWD", str(ROOT)))
    command, _ = build_core.compiler()
    built = tmp_path / "minimal"
    subprocess.run(
        [*command, *build_core.TARGET, *STRICT, *words, "-o", str(built)],
        cwd=ROOT,
        env=build_core.environment() | {"TMPDIR": str(tmp_path)},
        check=True,
    )
    ran = subprocess.run([built], capture_output=True, text=True, check=False, env=dict(os.environ))
    assert ran.returncode == 0, ran.stderr
    found = re.fullmatch(r"t (\S+) cell (\S+) (\S+) (\S+) normal (\S+) (\S+) (\S+)\n", ran.stdout)
    t, i, j, k, *normal = (float(word) for word in found.groups())
    # The ray (-3, 0.2, 0.3) + t (1, 0, 0) meets the cube's side x = -1, whose samples are u16: the
    # ramp of 5 voxels of 0.1 has 65535 steps.
    assert abs(t - 2) < 0.5 / 65535 + 1e-6
    assert [round(n, 3) for n in normal] == [-1, 0, 0]
    # Lattices lie on multiples of the voxel: y = 0.2 and z = 0.3 are one cell apart, x is in the
    # cell before or behind x = -1, which is 12 cells before y = 0.2.
    assert k - j == 1 and j - i in (12, 13)
    assert " ".join(ran.stdout.split()) in " ".join(page.split()).replace("`", "")
