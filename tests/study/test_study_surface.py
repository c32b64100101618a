# SPDX-License-Identifier: GPL-3.0-or-later
"""The study of surfaces: its reference is right, and its figures say what they should."""

import argparse
import csv
import json

import numpy as np
import pytest

pytest.importorskip("matplotlib")

import leapray
from addon.study import entries, reference, shapes, surface


def test_marching_finds_the_sphere_where_algebra_does():
    shape, radius = shapes.sphere(0.9), 0.9
    random = np.random.default_rng(3)
    directions = random.normal(size=(500, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    origins = random.uniform(-0.8, 0.8, (500, 3)) - 4 * directions
    b = (origins * directions).sum(axis=1)
    square = b * b - (origins * origins).sum(axis=1) + radius**2
    t = shape.first_hit(origins, directions)
    hit = square > 1e-4
    assert 50 < hit.sum() < 500
    assert np.isinf(t[square < -1e-6]).all()
    np.testing.assert_allclose(t[hit], (-b - np.sqrt(np.maximum(square, 0)))[hit], atol=1e-5)


@pytest.mark.parametrize("make", [shapes.sphere, shapes.torus, shapes.rods, shapes.box])
def test_distances_are_distances(make):
    shape, random = make(), np.random.default_rng(4)
    points = random.uniform(-1, 1, (2000, 3))
    other = points + random.normal(size=points.shape) * 0.1
    change = np.abs(shape.distance(points) - shape.distance(other))
    assert (change <= np.linalg.norm(points - other, axis=1) + 1e-12).all()
    assert (shape.distance(points * 0.999 / np.abs(points).max(axis=1, keepdims=True)) > 0).any()
    assert (shape.distance(points) < 0).any()


def test_first_crossings_are_those_of_fine_samples():
    random = np.random.default_rng(5)
    samples = random.random((6, 7, 8))
    origins = random.uniform(0.1, 4.9, (200, 3))
    directions = random.normal(size=(200, 3))
    found = reference.first_crossing(samples, origins, directions)
    t = np.linspace(0, 12, 40_001)
    padded = np.pad(samples, 2)
    for o, d, first in zip(origins[:40], directions[:40], found.t[:40], strict=True):
        points = np.clip(o + t[:, None] * d + 2, 0, np.array(padded.shape[::-1]) - 1.001)
        cell = np.floor(points).astype(int)
        above = reference.trilinear(padded, cell, points - cell) >= 0.5
        changes = np.flatnonzero(above != above[0])
        want = t[changes[0]] if len(changes) else np.inf
        assert first <= want  # samples may skip a pair of crossings, and find nothing earlier
        if np.isfinite(first):
            point = o + first * d + 2
            cell = np.floor(point).astype(int)[None]
            assert abs(reference.trilinear(padded, cell, point - cell)[0] - 0.5) < 1e-9


@pytest.mark.slow
def test_a_quick_study_says_what_the_methods_promise(tmp_path):
    output = tmp_path / "made"
    args = argparse.Namespace(output=output, quick=True, size=40, image=40, rounds=1)
    assert surface.main(args) == 0
    names = {path.name for path in output.iterdir()}
    drawn = {f"{n}.{e}" for n in ("costs", "traversers", "errors") for e in ("svg", "png")}
    tables = {"surface.csv", "surface-errors.csv", "surface.json", "surface.html"}
    assert names == drawn | tables
    costs = list(csv.DictReader((output / "surface.csv").open()))
    assert {row["traverser"] for row in costs} == {one.spec for one in leapray.variants()}
    exact = {one.spec for one in leapray.variants() if one.exact}
    assert all(row["hits"] == row["rays"] for row in costs if row["traverser"] in exact)
    errors = json.loads((output / "surface.json").read_text())["errors"]
    worst = {(row["hit_test"], row["root"], row["angles"]): row["field_max"] for row in errors}
    last = surface.BINS[-1][0]
    for name, _, _ in surface.BINS:
        assert worst["extrema", "newton", name] < 1e-9
        assert worst["extrema", "linear", name] > 1e3 * worst["extrema", "newton", name]
    assert worst["extrema", "linear", last] > worst["extrema", "linear", surface.BINS[0][0]]
    assert all(row["missed"] == 0 for row in errors if row["hit_test"] == "extrema")


def test_the_core_says_which_roots_go_with_a_hit_test():
    assert entries.walks_cells("faces") and not entries.walks_cells("uniform")
