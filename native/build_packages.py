# SPDX-License-Identifier: GPL-3.0-or-later
"""The core's wheel, and the extension for Blender that holds it, in dist/."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

from build_core import BuildError

ROOT = Path(__file__).resolve().parent.parent


def make_wheel() -> Path:
    """The core as a wheel, for every Python from 3.11; returns its path."""
    with tempfile.TemporaryDirectory() as folder:
        here = ["--no-deps", "--no-build-isolation", "--wheel-dir", folder, str(ROOT / "native")]
        _pip("wheel", here, "the wheel of the core was not made")
        (wheel,) = Path(folder).glob("leapray-*.whl")
        return _moved(wheel)


def make_extension(blender: Path, readers: Path) -> Path:
    """The extension, with the wheels of the core and of the readers of volumes inside; its path.

    blender: the folder of Blender's module. readers: the file that pins the readers.
    The tool that Blender ships is asked to check and to build; it leaves out
    wheels that do not fit without a word, so the contents are looked at too.
    """
    wheel = make_wheel()
    (tool,) = blender.glob("*/scripts/addons_core/bl_pkg/cli/blender_ext.py")
    with tempfile.TemporaryDirectory() as folder:
        source, made = Path(folder, "leapray"), Path(folder, "made")
        shutil.copytree(ROOT / "addon", source, ignore=shutil.ignore_patterns("__pycache__"))
        shutil.copy(ROOT / "LICENSE", source)
        wheels = source / "wheels"
        wheels.mkdir()
        shutil.copy(wheel, wheels)
        fetch = ["--no-deps", "--only-binary", ":all:", "--dest", str(wheels), "-r", str(readers)]
        _pip("download", fetch, f"the wheels that {readers.name} pins were not fetched")
        made.mkdir()
        for task in (
            ["validate", str(source)],
            ["build", "--split-platforms", "--source-dir", str(source), "--output-dir", str(made)],
        ):
            done = subprocess.run([sys.executable, str(tool), *task], stdout=subprocess.PIPE)
            if done.returncode:
                print(done.stdout.decode(), file=sys.stderr)
                raise BuildError("Blender's own tool refuses the extension; what it said is above")
        (archive,) = made.glob("*.zip")
        names = zipfile.ZipFile(archive).namelist()
        for name in sorted(f"wheels/{path.name}" for path in wheels.iterdir()):
            if name not in names:
                raise BuildError(f"{archive.name} lacks {name}; does the manifest name it?")
        return _moved(archive)


def _pip(task: str, words: list[str], complaint: str) -> None:
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", task, "--quiet"]
    if subprocess.run(pip + words).returncode:
        raise BuildError(f"{complaint}; what pip said stands above")


def _moved(path: Path) -> Path:
    """Put a finished file into dist/, whole or not at all; returns where it is."""
    target = ROOT / "dist" / path.name
    target.parent.mkdir(exist_ok=True)
    beside = target.with_suffix(f".{os.getpid()}")
    shutil.copyfile(path, beside)
    return beside.replace(target)
