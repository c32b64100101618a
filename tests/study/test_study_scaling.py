# SPDX-License-Identifier: GPL-3.0-or-later
"""The study of time and memory against the size of the work."""

import argparse
import json

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from addon.study import scaling


def test_the_study_writes_its_folder(tmp_path):
    values = {"resolution": (16, 32), "instances": (1, 9), "pixels": (160 * 90,), "threads": (1, 2)}
    args = argparse.Namespace(output=tmp_path / "out", rounds=1, values=values)
    assert scaling.main(args) == 0
    rows = json.loads((tmp_path / "out" / "scaling.json").read_text())["rows"]
    assert {row["axis"]: 0 for row in rows} == dict.fromkeys(values, 0)
    for row in rows:
        assert 0 < row["least_traced"] <= row["seconds_traced"] <= row["most_traced"]
        assert row["rays"] >= scaling.SAMPLES * 160 * 90 and 0 < row["nbytes"] < row["peak"]
    fine = [row["voxel_size"] for row in rows if row["axis"] == "resolution"]
    assert 2 < fine[0] / fine[1] < 4  # nine samples of either lie around the mesh
    one, two = (row["rays"] for row in rows if row["axis"] == "threads")
    assert one == two  # threads change no ray
    text = (tmp_path / "out" / "scaling.html").read_text()
    assert "Instances from 1 to 9" in text and (tmp_path / "out" / "scaling.png").exists()


@pytest.mark.parametrize("n", [1, 8, 9, 100])
def test_instances_fill_the_same_cube_without_touching(n):
    placed = np.array([each.world_from_object for each in scaling.with_instances(n).instances])
    assert len(placed) == n
    centres, scale = placed[:, :3, 3], placed[0, 0, 0]
    assert np.abs(centres).max() + scale <= 1
    apart = np.linalg.norm(centres[:, None] - centres[None], axis=-1) + 9 * np.eye(n)
    assert apart.min() > 2 * scale


def test_pixels_are_those_asked_for():
    for n in scaling.FULL["pixels"]:
        scene = scaling.with_pixels(n)
        assert scene.width * scene.height == n and abs(scene.width / scene.height - 16 / 9) < 0.01
