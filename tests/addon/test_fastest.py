# SPDX-License-Identifier: GPL-3.0-or-later
"""The fastest traverser by trial: another one at most changes how long a picture takes."""

import gc
import time
import weakref

import numpy as np
import pytest
import scenes

import leapray
from addon import pipeline
from addon.plan import fastest
from addon.settings import FASTEST
from addon.store.memory_cache import Cache

TRIED = [entry.spec for entry in leapray.traversers() if entry.default or entry.trial]


@pytest.fixture(autouse=True)
def forget():
    fastest._choices.clear()


def balls(**settings):
    """A ball and a box, whose fields rays meet."""
    meshes = [scenes.sphere(n=24), scenes.box()]
    return scenes.scene(meshes, exact="none", resolution=48, **settings)


@pytest.fixture
def slow(monkeypatch):
    """slow(spec): that traverser takes a hundredth of a second longer in trials."""

    def make(spec):
        trace = leapray.trace

        def traced(structure, *rays, **options):
            if structure.traverser.spec == spec:
                time.sleep(0.01)
            return trace(structure, *rays, **options)

        monkeypatch.setattr(leapray, "trace", traced)

    return make


def test_a_trial_changes_no_bit_and_is_told(slow):
    default = leapray.traverser().spec
    slow(default)
    want, found = (pipeline.render(balls(traverser=s)) for s in (default, FASTEST))
    for name, values in want.passes.items():
        assert np.array_equal(values, found.passes[name], equal_nan=True), name
    for row, plain in zip(found.report["volumes"], want.report["volumes"], strict=True):
        assert plain["traverser"] == default and "traverser_why" not in plain
        assert row["traverser"] in TRIED and row["traverser"] != default
        assert sorted(row["traverser_microseconds"]) == sorted(TRIED)
        least = min(row["traverser_microseconds"], key=row["traverser_microseconds"].get)
        assert row["traverser"] == least
        assert row["nbytes"] == row["volume_nbytes"] + row["structure_nbytes"]
    sums = [sum(row["structure_nbytes"] for row in f.report["volumes"]) for f in (want, found)]
    assert [f.report["bytes"]["structures"] for f in (want, found)] == sums
    assert sums[1] < sums[0]  # those that are tried build less


def test_the_default_stays_where_it_is_not_clearly_slower(slow):
    for spec in TRIED:
        if spec != leapray.traverser().spec:
            slow(spec)
    report = pipeline.render(balls(traverser=FASTEST)).report
    assert {row["traverser"] for row in report["volumes"]} == {leapray.traverser().spec}


def test_one_trial_serves_all_frames_and_keeps_nothing_alive(monkeypatch):
    cache = Cache()
    pipeline.render(balls(traverser=FASTEST), cache=cache)
    structure, *_ = fastest._choices
    told = [each.microseconds for known in fastest._choices.values() for each in known.values()]
    monkeypatch.setattr(fastest, "_trial", None)
    rows = pipeline.render(balls(traverser=FASTEST), cache=cache).report["volumes"]
    assert all(row["traverser_microseconds"] in told for row in rows)
    watched = weakref.ref(structure)
    del structure, cache
    gc.collect()
    assert watched() is None


def test_only_the_largest_volumes_get_a_trial(monkeypatch):
    monkeypatch.setattr(fastest, "MOST", 1)
    rows = pipeline.render(balls(traverser=FASTEST)).report["volumes"]
    why = [row["traverser_why"] for row in rows]
    assert sorted(w.split(" ")[0] for w in why) == ["not", "the"], why


def test_a_tree_of_triangles_needs_no_trial():
    scene = scenes.scene([scenes.sphere(n=2)], exact="all", resolution=16, traverser=FASTEST)
    (row,) = pipeline.render(scene).report["volumes"]
    assert "tree" in row["traverser_why"] and row["traverser_microseconds"] == {}


def test_rays_of_an_orthographic_camera_come_along_its_axis():
    view = scenes.camera(scale=3.0)
    scene = balls(traverser=FASTEST, view=view)
    plan = pipeline.plan.make(scene, Cache(), leapray.Watch(), 1)
    starts, ways = fastest._rays(plan.instances[0], view)
    assert np.abs(np.cross(ways[: len(ways) // 2], view.forward)).max() < 1e-12
    hits = leapray.trace(plan.instances[0].structure, starts, ways)
    hit, half = np.isfinite(hits.t), len(starts) // 2
    assert min(hit[:half].sum(), hit[half:].sum()) > half / 4


def test_the_report_says_how_many_pairs_went_in_lanes():
    trees = scenes.scene([scenes.sphere(n=4), scenes.box()])
    for scene in (balls(), trees):
        report = pipeline.render(scene).report
        assert 0 < report["in_lanes"] == report["pairs"]
        assert report["hits"] <= report["pairs"]
    alone = next(e.spec for e in leapray.variants() if e.exact and e.trial)
    report = pipeline.render(balls(traverser=alone)).report
    assert report["in_lanes"] == 0 < report["pairs"]
