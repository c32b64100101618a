# SPDX-License-Identifier: GPL-3.0-or-later
"""The study of others at the same work."""

import argparse
import json
import time

import pytest

pytest.importorskip("matplotlib")
pytest.importorskip("bpy")  # its OpenVDB

import leapray
from addon.study import distances, methods, peers


def test_methods_are_run_in_turns():
    ran = []
    runs = {name: lambda name=name: ran.append(name) for name in "ab"}
    taken = dict(
        zip(runs, methods.seconds(list(runs.values()), 3, time.perf_counter).T, strict=True)
    )
    assert ran == list("ababab")
    assert all(len(seconds) == 3 and min(seconds) >= 0 for seconds in taken.values())


def test_the_study_writes_its_folder(tmp_path):
    args = argparse.Namespace(
        output=tmp_path / "out", quick=True, scan=10, sizes=[16], rounds=1, cells=20
    )
    assert peers.main(args) == 0
    told = json.loads((tmp_path / "out" / "peers.json").read_text())
    by = [row["by"] for row in told["rows"]]
    assert "OpenVDB" in by and by.count("LeapRay") == 2 and "LeapRay portable" in by
    assert all(0 < row["least"] <= row["seconds"] <= row["most"] for row in told["rows"])
    text = (tmp_path / "out" / "peers.html").read_text()
    assert "OpenVDB, all cores" in text and (tmp_path / "out" / "peers.png").exists()
    assert {row["metric"] for row in told["distances"]} == set(leapray.METRICS)
    assert "Chessboard: " in text and "as fast as scipy" in text


def test_peers_that_differ_are_told(monkeypatch):
    monkeypatch.setitem(distances.PEERS, "scipy", lambda cells, metric: lambda: cells * 3)
    with pytest.raises(ValueError, match="scipy finds other distances, by chessboard"):
        distances.measure(12, 1)
