# SPDX-License-Identifier: GPL-3.0-or-later
"""How the command line ends: by itself, with what hangs or crashes Blender, and by signals."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import bpy
import pytest
from blender_scenes import fresh, light, mesh, put

from addon import process

ROOT = Path(__file__).resolve().parents[2]
VARIABLES = dict(os.environ, PYTHONPATH=f"{ROOT}{os.pathsep}{ROOT / 'native'}")
SAMPLES = 60000  # takes minutes

pytestmark = pytest.mark.alone


@pytest.fixture(scope="module")
def blend(tmp_path_factory) -> Path:
    """A cube, 64 x 48, whose place is a driver's: such files keep Blender from unloading."""
    scene = fresh()
    cube = put("Cube", mesh(), rotation_euler=(0.4, 0.5, 0.6))
    put("Sun", light("SUN"))
    driver = cube.driver_add("location", 0).driver
    driver.type, driver.expression = "SCRIPTED", "[1, 2][0] - 1"
    scene.leapray.samples = 1
    path = tmp_path_factory.mktemp("scene") / "cube.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


def start(*words, cwd: Path) -> subprocess.Popen:
    """A render with a folder of its own for temporary files."""
    (cwd / "tmp").mkdir(exist_ok=True)
    return subprocess.Popen(
        [sys.executable, "-m", "addon.cli", *map(str, words)],
        cwd=cwd,
        env={**VARIABLES, "TMPDIR": str(cwd / "tmp")},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


@pytest.mark.parametrize(
    ("words", "code"),
    [
        ([], 0),
        (["--pixel", "9999,0"], 1),  # refused once the scene is open
        (["--frames", "1-2"], 0),
    ],
)
def test_the_process_ends_at_once_whatever_blender_has_to_unload(blend, tmp_path, words, code):
    running = start("render", blend, *words, cwd=tmp_path)
    out, err = running.communicate(timeout=60)
    ended = time.time()
    assert running.returncode == code, err
    made = [path for path in tmp_path.iterdir() if path.is_file()]
    assert len(made) == 2 * out.count("\n")
    assert ended - max((path.stat().st_mtime for path in made), default=ended) < 1
    assert os.listdir(tmp_path / "tmp") == []  # Blender's own folder


SCRIPTS = {
    "registers": "",
    "renders": "open_file.open_scene(Path({blend!r})).render.resolution_percentage = 10\n"
    "open_file.set_format(bpy.context.scene, Path('a.png').absolute())\n"
    "open_file.render_frame(bpy.context.scene)",
    "unregisters": "addon.unregister()",
    "registers again": "addon.unregister(); addon.register()",
    "exits": "raise SystemExit(0)",
    "lets a thread end it": "import threading; threading.Timer(0.1, print).start()",
}


@pytest.mark.parametrize("body", SCRIPTS.values(), ids=SCRIPTS)
def test_scripts_that_register_the_addon_end_well(blend, tmp_path, body):
    if "Path" in body:  # Blender itself hangs over the driver
        scene = fresh()
        put("Cube", mesh())
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "plain.blend"))
        assert scene.leapray.samples
    text = "from pathlib import Path\nimport bpy, addon\nfrom addon.blender import open_file\n"
    text += "addon.register()\n" + body.format(blend=str(tmp_path / "plain.blend")) + "\n"
    done = subprocess.run(
        [sys.executable, "-c", text], cwd=tmp_path, env=VARIABLES, timeout=60, capture_output=True
    )
    assert done.returncode == 0, done.stderr


def test_a_script_that_fails_still_ends_with_its_own_exit_code():
    text = "import bpy, addon\naddon.register()\nraise ValueError"
    done = subprocess.run([sys.executable, "-c", text], env=VARIABLES, timeout=60)
    assert done.returncode == 1


# ---- signals ---------------------------------------------------------------

MOMENTS = ("listening", "loading", "tracing")


def wait_for(running: subprocess.Popen, moment: str, folder: Path) -> None:
    """Return when the process is as far as that."""
    status = Path(f"/proc/{running.pid}/status")
    while running.poll() is None:
        caught = int(re.search(r"SigCgt:\s*(\w+)", status.read_text())[1], 16)
        listening = caught >> (signal.SIGTERM - 1) & 1
        if moment == "listening" and listening:
            return
        if moment == "loading" and os.listdir(folder / "tmp"):  # Blender's folder
            return
        if moment == "tracing" and list(folder.glob(".cube.png.*.part")):
            time.sleep(0.3)
            return
        time.sleep(0.002)


@pytest.mark.parametrize("moment", MOMENTS)
@pytest.mark.parametrize("blow", process.SENTENCES)
def test_a_signal_at_any_moment_is_one_sentence_and_its_exit_code(blend, tmp_path, moment, blow):
    running = start("render", blend, "--samples", SAMPLES, cwd=tmp_path)
    wait_for(running, moment, tmp_path)
    running.send_signal(blow)
    asked = time.monotonic()
    out, err = running.communicate(timeout=30)
    assert (running.returncode, out) == (128 + blow, "")
    assert err == f"leapray: {process.SENTENCES[blow]}\n"
    assert time.monotonic() - asked < 3  # most of it Blender's loading, on a busy machine
    assert os.listdir(tmp_path) == ["tmp"]
    if moment == "tracing":
        assert os.listdir(tmp_path / "tmp") == []


@pytest.mark.slow
def test_ctrl_c_while_blender_loads_is_never_lost(blend, tmp_path):
    for tenths in range(12):
        running = start("render", blend, "--samples", SAMPLES, cwd=tmp_path)
        wait_for(running, "listening", tmp_path)
        time.sleep(tenths / 10)
        running.send_signal(signal.SIGINT)
        _, err = running.communicate(timeout=30)
        assert (running.returncode, err) == (130, "leapray: interrupted\n"), tenths
        assert os.listdir(tmp_path) == ["tmp"]


DEAF = """
import sys, time, ctypes
from pathlib import Path
from addon import process
from addon.store import files
def work(argv):
    with files.part_folder(Path('a.png')) as folder:
        (folder / 'picture.png').touch()
        print('here', flush=True)
        {0}
    return 0
process.run(work, [])
"""
WAYS = {  # in which the main thread does not hear
    "a call into C": "lock, m = ctypes.CDLL(None).pthread_mutex_lock, bytes(64); lock(m); lock(m)",
    "a callback that swallows": "import gc; gc.callbacks.append(lambda *_: time.sleep(600)); "
    "gc.collect()",
    "an except of everything": "exec('while True:\\n try: time.sleep(600)\\n except: pass')",
    "a cancelled work that goes on": "import threading\n"
    "        with process.interruptible(threading.Event()): time.sleep(600); time.sleep(600)",
    "a loop": "exec('while True: pass')",
}


@pytest.mark.parametrize("way", WAYS.values(), ids=WAYS)
def test_a_signal_ends_what_does_not_hear_it(tmp_path, way):
    running = subprocess.Popen(
        [sys.executable, "-c", DEAF.format(way)],
        cwd=tmp_path,
        env=VARIABLES,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert running.stdout.readline() == "here\n"
    time.sleep(0.1)
    running.send_signal(signal.SIGINT)
    asked = time.monotonic()
    _, err = running.communicate(timeout=10)
    assert (running.returncode, err) == (130, "leapray: interrupted\n")
    assert time.monotonic() - asked < process.GRACE + 1
    assert os.listdir(tmp_path) == []


def test_the_second_signal_waits_for_nothing(tmp_path):
    body = WAYS["a cancelled work that goes on"]
    running = subprocess.Popen(
        [sys.executable, "-c", DEAF.format(body)],
        cwd=tmp_path,
        env=VARIABLES,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    running.stdout.readline()
    for _ in range(2):
        time.sleep(0.1)
        running.send_signal(signal.SIGINT)
    asked = time.monotonic()
    running.communicate(timeout=10)
    assert running.returncode == 130 and time.monotonic() - asked < process.GRACE / 2


def test_files_are_put_in_place_together(tmp_path):
    text = DEAF.replace("{0}", "with process.signals_deferred(): time.sleep(0.05); ")
    text = text.replace("time.sleep(0.05); ", "raise_it(); Path('a').touch(); Path('b').touch()")
    text = text.replace(
        "def work", "import signal\nraise_it = lambda: signal.raise_signal(15)\ndef work"
    )
    done = subprocess.run(
        [sys.executable, "-c", text], cwd=tmp_path, env=VARIABLES, capture_output=True, text=True
    )
    assert (done.returncode, done.stderr) == (143, "leapray: terminated\n")
    assert sorted(os.listdir(tmp_path)) == ["a", "b"]


def test_the_temporary_folder_of_the_system_stays(monkeypatch):
    """Where Blender could make no folder of its own, it names the system's."""
    removed = []
    monkeypatch.setattr(process.shutil, "rmtree", lambda path, **_: removed.append(path))
    process._remove_folder_of_blender()
    assert removed == [Path(bpy.app.tempdir)]
    app = type("app", (), {"tempdir": tempfile.gettempdir()})
    monkeypatch.setitem(sys.modules, "bpy", type("bpy", (), {"app": app}))
    process._remove_folder_of_blender()
    assert len(removed) == 1
