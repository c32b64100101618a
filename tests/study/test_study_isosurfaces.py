# SPDX-License-Identifier: GPL-3.0-or-later
"""The study of surfaces of measured data beside meshes of them."""

import argparse
import json

import numpy as np
import pytest

pytest.importorskip("matplotlib")
pytest.importorskip("bpy")  # its OpenVDB, and Cycles

from addon.blender import open_file
from addon.study import isosurfaces, metrics
from leapray import LeapRayError


class Frame:
    def __init__(self, index, depth):
        facing = np.broadcast_to([0.0, 0.0, 1.0], (*index.shape, 3))
        self.index = index
        self.passes = {"Depth": depth, "Position": facing, "Normal": facing}


VIEW = metrics.View(False, np.zeros(3), np.array([0.0, 0.0, -1.0]), 1.0, np.eye(4))


def test_depths_are_compared_where_both_see_the_surface_in_voxels():
    index = np.ones((6, 8), np.int32)
    index[:, :2] = 0
    depth = np.full(index.shape, 3.0, np.float32)
    other = depth.copy()
    other[2, 5] += 0.5
    row, _ = isosurfaces.compared("any", 1.0, 9, Frame(index, depth), Frame(index, other), VIEW, 2)
    assert (row.agreeing, row.depth_50, row.depth_max) == (36, 0.0, 0.25)
    seen_by_one = index.copy()
    seen_by_one[3, 7] = 0  # far from the edge between columns 1 and 2
    row, _ = isosurfaces.compared(
        "any", 1.0, 9, Frame(index, depth), Frame(seen_by_one, depth), VIEW, 2
    )
    assert (row.mismatch, row.far) == (1, 1) and row.far_share == pytest.approx(1 / 12)
    with pytest.raises(LeapRayError, match="nothing that is the same"):
        isosurfaces.compared("any", 1.0, 9, Frame(index, depth), Frame(0 * index, depth), VIEW, 2)


def test_the_study_finds_the_surfaces_of_meshes(tmp_path):
    open_file.be_registered()
    args = argparse.Namespace(output=tmp_path / "out", quick=True, grid=48, size=48)
    assert isosurfaces.main(args) == 0
    told = json.loads((tmp_path / "out" / "isosurfaces.json").read_text())
    assert [row["grid"] for row in told["rows"]] == ["level set", "fog", "whole numbers"]
    for row in told["rows"]:
        assert row["agreeing"] > 50_000 and row["edges"] > 1000
        assert row["depth_50"] < 0.1 and row["perpendicular_99"] < 0.3
        assert row["far"] <= 0.05 * row["edges"]
    ours = [row for row in told["runs"] if row["by"] == "LeapRay"]
    assert [row["step"] for row in ours] == ["file to image", "another threshold"]
    assert all(0 < row["least"] <= row["seconds"] <= row["most"] for row in told["runs"])
    files = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"isosurfaces.html", "by-0.png", "errors-fog.png"} <= files
    assert not {"grid.vdb", "frame.exr", "head.nii"} & files


def test_a_program_that_fails_is_told(tmp_path):
    with pytest.raises(LeapRayError, match="LeapRay did not render the scan: "):
        isosurfaces.run("LeapRay", tmp_path / "none.nii", tmp_path / "out.png")
