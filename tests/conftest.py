# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests find the core and the add-on in this checkout, and their helpers beside them; or the
core in the folder that LEAPRAY_PACKAGE names, see native/build_variants.py."""

import os
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
for folder in (ROOT, ROOT / "native", ROOT / "tests"):
    if str(folder) not in sys.path:
        sys.path.insert(0, str(folder))
if "LEAPRAY_PACKAGE" in os.environ:
    sys.path.insert(0, os.environ["LEAPRAY_PACKAGE"])


def pytest_addoption(parser):
    parser.addoption(
        "--blender", metavar="PATH", help="the Blender that tests/blender uses; default: Debian's"
    )
    parser.addoption(
        "--random-scenes", metavar="N", type=int, default=10, help="how many of them; default: 10"
    )


# Files of minutes with few tests: where they come first, processes end about together.
LONG = "test_allocations.py", "test_build.py"


def pytest_collection_modifyitems(items):
    items.sort(key=lambda item: item.path.name not in LONG)  # the order stays otherwise


@pytest.fixture
def made(monkeypatch):
    """The numbers of triangles of what was voxelized since it was last cleared."""
    import leapray

    counts = []
    voxelize = leapray.voxelize

    def counted(vertices, triangles, *more, **options):
        counts.append(len(triangles))
        return voxelize(vertices, triangles, *more, **options)

    monkeypatch.setattr(leapray, "voxelize", counted)
    return counts


@pytest.fixture
def by_voxels(monkeypatch):
    """Meshes of more than a thousand triangles are never kept as they are for these alone."""
    from addon.plan import plan, refinement

    monkeypatch.setattr(plan, "MANY_TRIANGLES", 0)
    monkeypatch.setattr(refinement, "CELLS_PER_TRIANGLE", float("inf"))


@pytest.fixture(scope="module")
def sphere():
    """The structure of stage's ball."""
    from stage import ball

    import leapray

    return leapray.build(ball())


@pytest.fixture(scope="module")
def floor():
    """The structure of stage's slab."""
    from stage import slab

    import leapray

    return leapray.build(slab())
