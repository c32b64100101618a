# SPDX-License-Identifier: GPL-3.0-or-later
"""The package as nobody should call it, and what its objects say of themselves.

LEAPRAY_CALLS=100000 makes that many calls, LEAPRAY_SANITIZE=1 lets AddressSanitizer and
UndefinedBehaviorSanitizer watch them, where the system has gcc or clang.
"""

from __future__ import annotations

import os
import subprocess
import sys
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
import stage

import leapray

CALLS = Path(__file__).parents[1] / "hostile_calls.py"


def test_random_calls_end_by_a_result_or_a_sentence():
    command = [sys.executable, str(CALLS), "--calls", os.environ.get("LEAPRAY_CALLS", "2000")]
    if os.environ.get("LEAPRAY_SANITIZE"):
        command.append("--sanitize")
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-4000:]
    ends = {name: int(n) for n, name in (row.split(None, 1) for row in done.stdout.splitlines())}
    good = sum(n for name, n in ends.items() if name.endswith("done"))
    assert good > 0.5 * sum(ends.values()), ends  # most calls are no refusals
    assert len({name.split()[0] for name in ends}) == 16, ends


EMPTY = {
    "uniform": lambda: leapray.Volume(np.zeros((4, 5, 6), np.float32)),
    "rectilinear": lambda: leapray.Volume(
        np.zeros((4, 5, 6), np.float32),
        planes=(np.arange(6.0) ** 2, np.arange(5.0), np.arange(4.0)),
    ),
    "sheet, untouched": lambda: leapray.Volume(
        np.ones((4, 5, 6), np.uint8), sheet=True, touched=np.zeros((4, 5, 6), bool)
    ),
    "one sample": lambda: leapray.Volume(np.zeros((1, 1, 1), np.uint16)),
    "far and flat": lambda: leapray.Volume(
        np.zeros((3, 3, 3), np.uint8), object_from_index=np.diag([1e-9, 1.0, 1e9, 1.0])
    ),
}
RAYS = np.array(
    [
        [(-5, 1, 1), (1, 0.01, 0.02)],
        [(-1e30, 1, 1), (1e30, 0.3, 0.2)],
        [(-3e9, 1, 1), (1, 1e-3, 1e-3)],
        [(1e300, 1e300, 1e300), (-1e300, -1e299, -1)],
        [(1, 1, 1), (5e-324, 0, 0)],
        [(2, 2, 2), (1e-310, 1e-310, -1e-309)],
        [(0, 0, 0), (0, 0, 1)],
        [(1, 1, 1), (0, 0, 0)],
    ]
)


@pytest.mark.parametrize("kind", EMPTY)
@pytest.mark.parametrize("mode", leapray.MODES)
def test_where_no_surface_is_every_ray_misses(kind, mode):
    volume = EMPTY[kind]()
    assert volume.info.n_surface_cells == 0
    for entry in leapray.variants():
        if volume.info.planes is not None and not entry.rectilinear:
            continue
        structure = leapray.build(volume, entry)
        for start in (None, (np.zeros((len(RAYS), 3), int), np.ones(len(RAYS), int))):
            hits = leapray.trace(structure, RAYS[:, 0], RAYS[:, 1], mode=mode, start=start)
            inside = kind == "sheet, untouched" and mode == "binary"  # starts in object cells
            assert np.isinf(hits.t).all() or inside, entry.spec


@pytest.mark.parametrize("entry", leapray.variants(), ids=lambda entry: entry.spec)
def test_directions_of_next_to_nothing_do_not_lead_astray(entry):
    """Their reciprocals are infinite, as are products with them."""
    structure = leapray.build(stage.ball(4.0), entry)
    d = np.array([1.0, 0.3, -0.2]) * 10.0 ** np.array([-300, -307, -308, -309, -320])[:, None]
    o = np.tile([-3.0, 0, 0], (len(d), 1))
    hits = leapray.trace(structure, o, d)
    assert not np.isnan(hits.t).any()
    assert np.isinf(hits.t[-2:]).all()  # as rays without a direction


def test_no_rays_on_several_threads_are_no_hits():
    structure = leapray.build(stage.ball(4.0))
    for threads in (0, 1, 2, 5):
        hits = leapray.trace(structure, np.zeros((0, 3)), np.zeros((0, 3)), threads=threads)
        assert hits.t.shape == (0,) and hits.cell.shape == (0, 3)
        assert set(hits.counters.values()) == {0}


@pytest.mark.parametrize("wrong", [np.zeros((3, 3, 3)), None, "cd", 3])
def test_structures_of_what_is_no_volume_are_refused(wrong):
    with pytest.raises(leapray.LeapRayError, match=r"leapray\.Volume"):
        leapray.build(wrong)


def test_objects_say_what_they_are():
    volume = stage.ball(4.0)
    structure = leapray.build(volume, "cd")
    hits = leapray.trace(structure, [[-3.0, 0, 0], [9, 9, 9]], [[1.0, 0, 0], [1, 0, 0]])
    told = [
        repr(thing) for thing in (volume, structure, hits, leapray.prepare(volume, "pixel_skip"))
    ]
    assert "20 x 20 x 20" in told[0] and "f32" in told[0] and "surface cells" in told[0]
    assert "cd" in told[1] and told[0] in told[1]
    assert "1 of 2 rays" in told[2] and "from 2" in told[2]
    assert all(len(one) < 200 for one in told)


def test_the_package_says_that_it_is_typed():
    assert files("leapray").joinpath("py.typed").is_file()
