# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays of kinds whose shares lie far apart: no tile hangs, none has another mean."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

if __name__ == "__main__":  # the child
    sys.path[:0] = [str(Path(__file__).parents[1]), str(Path(__file__).parents[2] / "native")]

from stage import at, ball, camera, one

import leapray
from leapray import Lobe, Material, World

SIDE = 20  # pixels
TINY = (1e-15, 1e-17, 1e-20, 1e-30, 1e-200, 1e-320, 0.0)
SURFACES = {  # with a group of an albedo of about e
    "veil over black": lambda e: [Lobe("principled", (e, e, e), alpha=0.5, specular=0.0)],
    "diffuse and clear": lambda e: [Lobe("diffuse", (e, e, e)), Lobe("transparent", (0.5,) * 3)],
    "diffuse, hardly clear": lambda e: [Lobe("diffuse"), Lobe("transparent", (e, e, e))],
    "a little metal": lambda e: [
        Lobe("diffuse", weight=0.6),
        Lobe("glossy", weight=e, roughness=0.3),
    ],
    "a little glass": lambda e: [Lobe("diffuse"), Lobe("glass", weight=e, roughness=0.2)],
    "four kinds": lambda e: [
        Lobe("diffuse"),
        Lobe("glossy", (e, e, e), roughness=0.5),
        Lobe("refraction", (e * 1e-3,) * 3, roughness=0.1),
        Lobe("transparent", (0.2, e, e)),
    ],
    "nearly nothing": lambda e: [
        Lobe("diffuse", weight=e),
        Lobe("transparent", weight=e * 1e-18),
        Lobe("glossy", weight=e * 1e-30, roughness=0.1),
    ],
    "clear, a veil over it": lambda e: [Lobe("principled", alpha=e)],
}
PLACES = (1, 2, 3, 4, 16)


def mean(things, lobes, branches):
    """Of Combined, two balls of the same material before each other."""
    scene = leapray.Scene(
        camera((0, -4, 0), size=(SIDE, SIDE), width=0.7),
        things,
        [],
        [Material(lobes)],
        [0],
        World((1, 1, 1)),
    )
    frame = scene.render_tile(
        0, 0, SIDE, SIDE, samples=16, branches=branches, diffuse_bounces=4, transparent_bounces=16
    )
    return float(frame["Combined"][..., :3].mean())


def all_means():
    structure = leapray.build(ball(8.0))
    things = [one(structure), one(structure, at(y=2.5))]
    return {
        name: [[mean(things, lobes(e), n) for n in PLACES] for e in TINY]
        for name, lobes in SURFACES.items()
    }


@pytest.fixture(scope="module")
def means():
    """By surface, of every albedo and number of slots; a child, since a hang cannot be stopped."""
    done = subprocess.run(
        [sys.executable, __file__], capture_output=True, text=True, timeout=100, check=False
    )
    assert done.returncode == 0, done.stderr
    return {name: np.array(rows) for name, rows in json.loads(done.stdout).items()}


@pytest.mark.parametrize("name", SURFACES)
def test_a_group_of_next_to_no_share_does_not_show(name, means):
    got = means[name]
    assert got.shape == (len(TINY), len(PLACES))
    right = got[-1, -1]  # without the group, and with a place for every ray
    assert 0 < right < 1.001
    # 16 samples of 400 pixels: four times the scatter between seeds of the noisiest
    assert np.abs(got - right).max() < 0.01, got.tolist()


@pytest.mark.parametrize("places", [1, 4])
def test_shares_beyond_all_numbers_do_not_hang(places):
    """Colours that each are a number, but not their sums and products."""
    lobes = [Lobe(kind, (1e308,) * 3, weight=1e10) for kind in ("diffuse", "transparent", "glossy")]
    scene = leapray.Scene(
        camera((0, -4, 0), size=(8, 8)),
        [one(leapray.build(ball(4.0)))],
        [],
        [Material(lobes)],
        [0],
        World((1, 1, 1)),
    )
    frame = scene.render_tile(0, 0, 8, 8, samples=4, branches=places, diffuse_bounces=4)
    corner = frame["Combined"][0, 0]
    assert corner.tolist() == [1, 1, 1, 1]  # a pixel that does not see it is what it was


if __name__ == "__main__":
    print(json.dumps(all_means()))
