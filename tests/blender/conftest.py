# SPDX-License-Identifier: GPL-3.0-or-later
"""A real Blender for the tests of this folder, with the extension installed from its zip.

Taken from --blender or LEAPRAY_BLENDER, else Debian's is installed (debian.py).
Where there is none, the tests are skipped and say why; where CI is set, that is
a failure.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import debian
import pytest
from driver import Blender, Window

ROOT = Path(__file__).resolve().parent.parent.parent
SCENE = ROOT / "blend_samples" / "sphere.blend"
HERE = Path(__file__).parent


def pytest_collection_modifyitems(items) -> None:
    for item in items:
        if HERE in item.path.parents:
            item.add_marker(pytest.mark.slow)


def or_unavailable(make, *words):
    """What make(*words) returns; where that is not to be had, skip, or fail where CI is set."""
    try:
        return make(*words)
    except debian.Unavailable as error:
        reason = str(error)
    if os.environ.get("CI", "").lower() in ("", "0", "false"):
        pytest.skip(f"not tested in a real Blender: {reason}")
    pytest.fail(f"no real Blender to test in: {reason}", pytrace=False)


@pytest.fixture(scope="session")
def blender(request):
    """Blender without the extension, its settings in a folder of their own."""
    named = request.config.getoption("--blender") or os.environ.get("LEAPRAY_BLENDER")
    if named:
        executable = shutil.which(named)
        if executable is None:
            pytest.fail(f"--blender names {named}, which cannot be run", pytrace=False)
        root, executable = Path("/"), str(Path(executable).absolute())
    else:
        root, executable = or_unavailable(debian.install), "/usr/bin/blender"
    with tempfile.TemporaryDirectory(prefix="leapray-", dir=root / "tmp") as folder:
        yield Blender(root, executable, Path(folder, "room"))


@pytest.fixture(scope="session")
def archive() -> Path:
    """The extension's zip, as `build.py package` says where it is."""
    words = [sys.executable, str(ROOT / "build.py"), "package"]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return Path(done.stdout.splitlines()[-1])


@pytest.fixture(scope="session")
def installed(blender, archive) -> Blender:
    """Blender with the extension installed from its zip and enabled."""
    zip_file = blender.inside(blender.bring(archive))
    done = blender.run("-c", "extension", "install-file", "-r", "user_default", "-e", zip_file)
    assert done.returncode == 0, done.stdout
    return blender


@pytest.fixture(scope="session")
def scene(installed):
    """A folder with a small copy of a scene in it, saved by Blender's module, without pictures."""
    folder = installed.room / "commands"
    folder.mkdir()
    code = (
        "import bpy, sys; bpy.ops.wm.open_mainfile(filepath=sys.argv[1]);"
        "bpy.context.scene.render.resolution_percentage = 25;"
        "bpy.ops.wm.save_as_mainfile(filepath=sys.argv[2], compress=True)"
    )
    words = [sys.executable, "-c", code, str(SCENE), str(folder / SCENE.name)]
    subprocess.run(words, check=True, capture_output=True)
    return folder / SCENE.name


@pytest.fixture(scope="session")
def picture(installed, scene):
    """What Blender's own command line renders: (its output, the PNG)."""
    inside = installed.inside(scene)
    done = installed.run("-b", inside, "-E", "LEAPRAY", "-o", "//out_", "-F", "PNG", "-f", "1")
    assert done.returncode == 0, done.stdout
    return done.stdout, scene.with_name("out_0001.png")


@pytest.fixture(scope="module")
def window(installed):
    """A session with a window, in which the extension is enabled."""
    made = or_unavailable(Window, installed)
    yield made
    made.close()


@pytest.fixture(scope="session")
def report_of():
    """Function: what a JSON file beside a picture says."""
    return lambda picture: json.loads(picture.with_suffix(".json").read_text())
