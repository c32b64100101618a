# SPDX-License-Identifier: GPL-3.0-or-later
"""A render that is killed at any moment leaves nothing half written, and the next one works.

Real processes are killed by a signal that they cannot catch. A first render
tells how long each phase takes; the blows are then spread over the phases, each
counted from the moment at which the process itself was seen to enter its phase.
"""

from __future__ import annotations

import itertools
import json
import os
import pty
import select
import signal
import subprocess
import sys
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import blender_scenes
import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
SCENE = ROOT / "blend_samples" / "sphere.blend"
SIGNS = {"voxelizing": b"Voxelizing", "tracing": b"Rendered "}  # on the line that shows progress
PHASES = (*SIGNS, "writing")
BLOWS = 20
LANES = 2  # renders at once, each in a folder of its own

pytestmark = [pytest.mark.slow, pytest.mark.alone]


class Run:
    """A render in a folder, into out.exr and out.json; its phase is read while it runs."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.phase, self.since = folder, "starting", {"starting": time.monotonic()}
        words = ["render", str(SCENE), "--output", str(folder / "out.exr")]
        words += ["--samples", "1", "--pixel-error", "0.02", "--threads", "1"]
        words += ["--exact", "sheets"]  # by voxels, which take a while
        self.reader, writer = pty.openpty()  # a terminal is told about progress at once
        self.process = subprocess.Popen(
            [sys.executable, "-m", "addon.cli", *words],
            cwd=ROOT,
            env={**os.environ, "PYTHONPATH": str(ROOT / "native")},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=writer,
        )
        os.close(writer)

    def look(self) -> bool:
        """See which phase it is in; returns whether it still runs."""
        said = b""
        if select.select([self.reader], [], [], 0.001)[0]:
            try:
                said = os.read(self.reader, 65536)
            except OSError:  # it has ended
                time.sleep(0.001)
        for phase, sign in SIGNS.items():
            if sign in said:
                self.enter(phase)
        if any(self.folder.glob(".out.exr.*.part/picture.exr")):
            self.enter("writing")
        return self.process.poll() is None

    def enter(self, phase: str) -> None:
        if phase not in self.since:
            self.phase = phase
            self.since[phase] = time.monotonic()

    def until(self, phase: str = "", seconds: float = 0.0) -> None:
        """Follow it until so long after it has entered a phase, or to its end."""
        while self.look():
            if phase in self.since and time.monotonic() - self.since[phase] >= seconds:
                break

    def end(self, blow: signal.Signals | None = None) -> int:
        """Strike it, if asked to, and wait; returns its exit code."""
        if blow is not None:
            self.process.send_signal(blow)
        code = self.process.wait(120)
        os.close(self.reader)
        return code


@dataclass
class Measured:
    """What a render that nobody disturbed shows."""

    channels: dict[str, np.ndarray]
    rays: int
    seconds: dict[str, float]  # of each phase


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Measured:
    folder = tmp_path_factory.mktemp("whole")
    run = Run(folder)
    run.until()
    ended = time.monotonic()
    assert run.end() == 0
    assert run.since.keys() >= set(PHASES), "the render was too short to see its phases"
    begins = [run.since[phase] for phase in PHASES] + [ended]
    report = json.loads((folder / "out.json").read_text())
    lengths = np.diff(begins).tolist()
    return Measured(
        blender_scenes.exr(folder / "out.exr"),
        report["rays"],
        dict(zip(PHASES, lengths, strict=True)),
    )


def check(folder: Path, whole: Measured) -> set[str]:
    """What is there is whole; returns the names of what is not for the user's eyes."""
    names = {path.name for path in folder.iterdir()}
    if "out.json" in names:
        assert json.loads((folder / "out.json").read_text())["rays"] == whole.rays
    if "out.exr" in names:
        found = blender_scenes.exr(folder / "out.exr")
        assert found.keys() == whole.channels.keys()
        for name, pixels in found.items():
            np.testing.assert_array_equal(pixels, whole.channels[name], err_msg=name)
    return names - {"out.exr", "out.json"}


def test_a_render_killed_at_any_moment_leaves_nothing_half_written(
    whole, tmp_path, record_property
):
    blows = [
        (phase, (number + 0.5) / BLOWS * whole.seconds[phase])
        for number, phase in enumerate(itertools.islice(itertools.cycle(PHASES), BLOWS))
    ]

    def lane(number: int) -> list[str]:
        """Every second of the blows, in a folder; returns the phases in which they struck."""
        folder = tmp_path / str(number)
        folder.mkdir()
        struck = []
        for turn, (phase, seconds) in enumerate(blows[number::LANES]):
            if turn % 3 == 0:  # else over what the last one left
                for path in folder.glob("out.*"):
                    path.unlink()
            while True:
                run = Run(folder)
                run.until(phase, seconds)
                code = run.end(signal.SIGKILL)
                hidden = check(folder, whole)
                assert all(name.startswith(".") and name.endswith(".part") for name in hidden)
                if code == -signal.SIGKILL:
                    break
                assert code == 0
                seconds /= 2  # it was faster than when it was measured
            struck.append(run.phase)
        last = Run(folder)
        last.until()
        assert last.end() == 0
        assert (folder / "out.exr").exists() and (folder / "out.json").exists()
        assert check(folder, whole) == set()  # what the killed ones left is cleared away
        return struck

    with ThreadPoolExecutor(LANES) as pool:
        struck = Counter(itertools.chain.from_iterable(pool.map(lane, range(LANES))))
    record_property("struck", dict(struck))
    print(f"\nblows struck while {dict(struck)}; phases take {whole.seconds} s")
    assert struck.total() == BLOWS
    assert min(struck[phase] for phase in PHASES) >= BLOWS // 5  # they were spread
