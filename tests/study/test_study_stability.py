# SPDX-License-Identifier: GPL-3.0-or-later
"""The study of stability: what promises exactness shows zeros, what does not shows its faults."""

import argparse
import csv
import json

import numpy as np
import pytest

pytest.importorskip("matplotlib")

import leapray
from addon.study import cases, oracle, reference, stability, tunnels

pytestmark = pytest.mark.slow  # the studies run


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    output = tmp_path_factory.mktemp("stability") / "made"
    args = argparse.Namespace(output=output, quick=True, rays=250, size=24, side=256)
    assert stability.main(args) == 0
    return output


@pytest.fixture(scope="module")
def claims(made):
    return json.loads((made / "stability.json").read_text())["traversers"]


@pytest.fixture(scope="module")
def crossings(made):
    return json.loads((made / "stability.json").read_text())["hit_tests"]


def faults(rows):
    return sum(row["missed"] + row["late"] + row["wrong"] for row in rows)


def test_it_writes_what_it_promises(made):
    drawn = {f"{n}.{e}" for n in ("traversers", "hit-tests", "pictures") for e in ("svg", "png")}
    tables = {"stability.csv", "stability-hit-tests.csv", "stability.json", "stability.html"}
    assert {path.name for path in made.iterdir()} == drawn | tables
    rows = list(csv.DictReader((made / "stability.csv").open()))
    assert len(rows) == (len(cases.CASES) + 1) * len(leapray.variants())


def test_exact_methods_show_zeros_and_rays_do_hit(claims):
    exact = [row for row in claims if row["exact"]]
    assert faults(exact) == 0
    assert all(row["longest"] <= row["planes"] for row in exact)
    assert sum(row["longest"] for row in exact) > len(exact)
    assert sum(row["pierced"] for row in exact) > 0.2 * sum(row["rays"] for row in exact)


def test_samples_miss_more_the_farther_they_are_apart(claims):
    steps = {spec: [row for row in claims if row["traverser"] == spec] for spec in
             ("uniform:step=1", "uniform", "uniform:step=0.25", "uniform:step=0.1")}  # fmt: skip
    counts = [faults(rows) for rows in steps.values()]
    assert counts == sorted(counts, reverse=True)
    assert counts[0] > 3 * counts[-1] > 0


def test_roots_between_extrema_are_the_first_and_others_say_how_far_off_they_are(crossings):
    def of(hit_test, root):
        return [r for r in crossings if (r["hit_test"], r["root"]) == (hit_test, root)]

    for root in ("newton", "bisect", "cubic"):
        rows = of("extrema", root)
        assert sum(row["missed"] + row["false"] + row["off"] for row in rows) == 0
        assert max(row["error_max"] for row in rows) < reference.OFF
    assert max(row["error_max"] for row in of("extrema", "linear")) > 0.01
    lost = {test: sum(row["missed"] for row in of(test, "bisect")) for test in leapray.HIT_TESTS}
    assert lost["uniform"] > lost["faces"] > lost["extrema"] == 0


def test_tunnels_are_as_wide_as_their_rays_and_end_with_them():
    dug = tunnels.dig(384, 1)
    assert len(dug.ends) >= 4
    assert dug.steps > 600
    structure = leapray.build(dug.volume)
    hits = leapray.trace(structure, dug.origins, dug.directions, mode="binary")
    np.testing.assert_array_equal(hits.cell, dug.ends)
    # A quarter of a voxel aside, every ray soon meets a wall.
    beside = dug.origins + np.array([0.0, 0.25, -0.25])
    aside = leapray.trace(structure, beside, dug.directions, mode="binary")
    assert np.isfinite(aside.t).all()
    assert (aside.t < 0.1 * hits.t).all()
    for k in range(len(dug.ends)):  # the oracle's first pierced cell, near the end, is the end
        low = dug.ends[k] - 20
        samples = dug.volume.read(tuple(low), (30, 30, 30))
        objects = oracle.object_cells(samples, 127.5)[1:-1, 1:-1, 1:-1]
        origins = dug.origins[k : k + 1] - low - 1
        verdict, pierced = oracle.judge(
            objects, origins, dug.directions[k : k + 1], [True], [dug.ends[k] - low - 1]
        )
        assert pierced.all() and not verdict.any()


@pytest.mark.parametrize("case", cases.CASES, ids=lambda case: case.name)
def test_a_case_is_input_that_the_oracle_takes(case):
    volume, samples, (origins, directions), placed = cases.made(case, 50)
    assert volume.info.size == samples.shape[::-1]
    assert (origins * 2.0**oracle.SHIFT % 1 == 0).all() and (directions % 1 == 0).all()
    assert np.abs(directions).max(axis=1).min() > 0
    if case.matrix:  # there and back without rounding
        back = np.linalg.inv(case.matrix)
        assert (placed[0] @ back.T == origins).all() and (placed[1] @ back.T == directions).all()
