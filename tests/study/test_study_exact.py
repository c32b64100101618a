# SPDX-License-Identifier: GPL-3.0-or-later
"""The study of what must be exact: zeros where all is well, and faults where something is not."""

import argparse
import json

import numpy as np
import pytest

pytest.importorskip("matplotlib")

import leapray
from addon.study import exact, oracle

EXACT = [entry for entry in leapray.variants() if entry.exact]


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    output = tmp_path_factory.mktemp("exact") / "made"
    sizes = {
        "rays": 8000,
        "size": 32,
        "cells": 20_000,
        "views": 4,
        "image": 96 * 8,
        "counts": (1, 3),
    }
    assert exact.main(argparse.Namespace(output=output, quick=True, **sizes)) == 0
    drawn = {"walks.svg", "walks.png"}
    tables = {
        "exact.csv",
        "exact-roots.csv",
        "exact-closed.csv",
        "exact-skips.csv",
        "exact.json",
        "exact.html",
    }
    assert {path.name for path in output.iterdir()} == drawn | tables
    return json.loads((output / "exact.json").read_text())


def test_every_exact_method_is_judged_and_shows_zeros(told):
    rows = told["first_cells"]
    assert len(rows) == 3 * len(EXACT)
    for row in rows:
        assert (row["rays"], row["lattice_rays"]) == (8000, 1600)
        assert row["pierced"] > 0.3 * row["rays"]
        assert row["missed"] == row["late"] == row["wrong"] == row["long"] == 0
        assert row["longest"] <= 1
    assert max(row["longest"] for row in rows) > 0.5


def test_late_cells_and_long_walks_are_counted():
    rng = np.random.default_rng(1)
    samples = exact.random_volume(rng, 0)
    volume, rays = leapray.Volume(samples), oracle.generic_rays(rng, 500, samples.shape[::-1])
    bench = oracle.Bench(oracle.object_cells(samples, 127.5), *rays)
    hits = leapray.trace(leapray.build(volume), *rays, mode="binary")
    hit, tally = np.isfinite(hits.t), exact.Tally()
    verdict, pierced = bench.judge(hit, hits.cell)
    assert not verdict.any() and pierced.sum() > 50
    wrong = np.flatnonzero(hit)[:7]
    hits.cell[wrong] += 100
    verdict, _ = bench.judge(hit, hits.cell)
    assert np.flatnonzero(verdict).tolist() == wrong.tolist()
    steps = {"most_cells": sum(samples.shape) + 2, "cells": 0}
    tally.add(verdict, pierced, steps, sum(samples.shape))
    assert (tally.wrong, tally.long) == (7, 1)


def test_random_cells_give_their_first_root_to_all_but_the_linear_one(told):
    roots = {row["root"]: row for row in told["roots"]}
    assert set(roots) == set(leapray.ROOTS)
    for name, row in roots.items():
        assert row["crossing"] > 0.3 * row["rays"]
        assert row["doubtful"] < 1e-3 * row["rays"]
        assert row["missed"] == row["false"] == 0
        assert (row["off"] == 0) == (name != "linear")


def test_skipped_pixels_are_right_but_for_the_published_skip(told):
    rows = told["skips"]
    assert [(row["n"], row["skip"]) for row in rows] == [
        (n, skip) for n in (1, 3) for skip in ("safe", "paper")
    ]
    for row in rows:
        assert row["skipped"] > 0.05 * row["pixels"]
        assert row["pixels"] == 4 * 96**2
        assert (row["wrong"] == 0) == (row["skip"] == "safe")


def test_closed_surfaces_have_no_holes(told):
    assert [row["solid"] for row in told["closed"]] == ["sphere", "torus"]
    for row, fraction in zip(told["closed"], (0.7, 0.2), strict=True):
        assert row["holes"] == row["displaced"] == 0
        assert row["rays"] > fraction * row["pixels"]  # the disc fills pi / 4 of its square


def test_a_hole_in_a_closed_surface_is_found(monkeypatch):
    trace = leapray.trace

    def leaky(structure, origins, directions, **options):
        hits = trace(structure, origins, directions, **options)
        hits.t[:1] = np.inf
        hits.t[1:2] += 0.1
        return hits

    monkeypatch.setattr(leapray, "trace", leaky)
    row = exact.closed(exact.SOLIDS[1], 1, 64)
    assert row.holes == row.displaced == 1  # the picture is one job of 64 rows


def test_entries_into_solids_are_where_they_are_known_to_be():
    origins = np.array([[0, 0, 3.0], [0, 0, 3.0], [-3, 0, 0], [0, 0.88, 3.0], [0, 0.886, 3.0]])
    forward = np.array([[0, 0, -1.0], [0, 0, -1.0], [1, 0, 0], [0, 0, -1.0], [0, 0, -1.0]])
    sphere, torus = exact.SOLIDS
    early, late = exact.entrances(sphere, origins[:1], forward[:1], 0.01)
    np.testing.assert_allclose((early[0], late[0]), (2.09, 2.11), atol=1e-6)
    early, late = exact.entrances(torus, origins[1:], forward[1:], 0.01)
    assert np.isinf(early[0]) and np.isinf(late[0])  # through the hole
    np.testing.assert_allclose((early[1], late[1]), (2.11, 2.13), atol=1e-6)
    assert np.isfinite(early[2:]).all() and np.isinf(late[2:]).all()  # grazing
