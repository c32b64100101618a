# SPDX-License-Identifier: GPL-3.0-or-later
"""The front door: finds a Python, makes its environment once, survives kills, stays out of the way.

A scratch project holds build.py as it is, an empty requirements.txt, and stubs
for what takes long: Blender's module, the command line behind the verbs, the
core. Virtual environments, locks, kills and exit codes are real.
"""

from __future__ import annotations

import ctypes
import importlib.util
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import build

ROOT = Path(__file__).resolve().parent.parent
THIS = f"{sys.version_info[0]}.{sys.version_info[1]}"

STUBS = {
    "requirements.txt": "",
    "bpy/__init__.py": "",
    "native/build_core.py": "class BuildError(Exception): pass\ndef build(say): pass\n",
    "addon/cli.py": (
        "import sys, time\n"
        "def main(words):\n"
        "    print(sys.version_info[:2], *words, flush=True)\n"
        "    time.sleep(60 * words.count('sleep'))\n"
        "    return len(words) - 1\n"
    ),
}


def scratch_project(folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copy(ROOT / "build.py", folder)
    for name, text in STUBS.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)
    return folder


def start(project: Path, *words: str, **environment: str) -> subprocess.Popen:
    return subprocess.Popen(
        [sys._base_executable, str(project / "build.py"), *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, **environment},
        start_new_session=True,
    )


def finish(process: subprocess.Popen) -> tuple[int, str, str]:
    out, err = process.communicate(timeout=120)
    return process.returncode, out, err


def script(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return path


@pytest.fixture(scope="module")
def project(tmp_path_factory) -> Path:
    """A scratch project whose environment is made."""
    folder = scratch_project(tmp_path_factory.mktemp("door") / "project")
    status, out, err = finish(start(folder, "render", "a.blend"))
    assert (status, out) == (1, f"({THIS.replace('.', ', ')}) render a.blend\n"), err
    assert err.count("\n") == 1 and f"making .venv/{THIS}, once" in err
    return folder


# ---- words -----------------------------------------------------------------


def test_no_verb_shows_the_usage(project):
    status, out, err = finish(start(project))
    assert status == 2 and "render SCENE.blend" in out and not err


@pytest.mark.parametrize(
    "words, culprit",
    [
        (["paint"], "no verb paint; there are render, compare,"),
        (["--python", "3.7", "test"], "--python takes 3.13, 3.11 or other, not 3.7"),
        (["build", "now"], "build takes no further words, but got now"),
    ],
)
def test_a_wrong_word_is_named_in_one_sentence(project, words, culprit):
    status, out, err = finish(start(project, *words))
    assert status == 1 and not out
    assert culprit in err and err.count("\n") == 1


def test_the_exit_code_and_the_words_are_those_of_the_command_line(project):
    status, out, err = finish(start(project, "study", "phantom", "--quick"))
    assert (status, err) == (2, "")
    assert out.endswith(" study phantom --quick\n")


def test_a_second_call_makes_nothing(project, record_property):
    began = time.perf_counter()
    status, _, err = finish(start(project, "render"))
    record_property("second_call_seconds", round(time.perf_counter() - began, 3))
    assert (status, err) == (0, "")


def test_ctrl_c_ends_the_work_without_a_traceback(project):
    process = start(project, "render", "sleep")
    assert "render sleep" in process.stdout.readline()
    process.send_signal(signal.SIGINT)
    status, _, err = finish(process)
    assert status == 130 and err == "build.py: interrupted\n"


# ---- which Python ----------------------------------------------------------


def test_a_shim_that_fails_is_passed_over(tmp_path, monkeypatch):
    shim = script(tmp_path / "shims" / f"python{THIS}", "echo 'pyenv: not set' >&2; exit 127")
    liar = script(tmp_path / "liars" / f"python{THIS}", "echo 2.7 True")
    good = tmp_path / "good" / f"python{THIS}"
    good.parent.mkdir()
    good.symlink_to(sys._base_executable)
    monkeypatch.setenv("PATH", os.pathsep.join(str(p.parent) for p in (shim, liar, good)))
    monkeypatch.setattr(build, "this_version", lambda: "3.12")
    assert build.candidates(THIS)[:3] == [shim, liar, good]
    assert build.find_python([THIS]) == (THIS, good)


def test_a_python_outside_the_path_is_found_where_pyenv_keeps_it(tmp_path, monkeypatch):
    hidden = script(tmp_path / "versions" / f"{THIS}.9" / "bin" / f"python{THIS}", "echo 9.9 True")
    monkeypatch.setenv("PYENV_ROOT", str(tmp_path))
    monkeypatch.setenv("PATH", "")
    assert hidden in build.candidates(THIS)


def test_a_python_without_venv_is_named(tmp_path, monkeypatch):
    script(tmp_path / "python9.9", "echo 9.9 False")
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(build.Refusal, match=r"python9\.9 cannot make .* install python9\.9-venv"):
        build.find_python(["9.9"])


def test_no_python_at_all_says_which_to_install(monkeypatch):
    with pytest.raises(build.Refusal, match=r"needs Python 9\.9 or 9\.8, and none was found"):
        build.find_python(["9.9", "9.8"])


def test_the_own_version_comes_first_and_the_other_is_the_other(monkeypatch):
    for own, expected in (
        ("3.13", [["3.13"], ["3.11"]]),
        ("3.11", [["3.11"], ["3.13"]]),
        ("3.12", [["3.13", "3.11"]]),
    ):
        monkeypatch.setattr(build, "this_version", lambda own=own: own)
        assert build.preferences(None) == expected
    monkeypatch.setattr(build, "this_version", lambda: "3.13")
    assert build.preferences("other") == [["3.11"]]


# ---- the environment -------------------------------------------------------


def test_missing_system_libraries_are_named_with_their_packages(tmp_path, project):
    copy = scratch_project(tmp_path / "project")
    shutil.copytree(project / ".venv", copy / ".venv", symlinks=True)
    (copy / "bpy/__init__.py").write_text("raise ImportError('libSM.so.6: no such file')")
    script(tmp_path / "ldd", "echo 'libSM.so.6 => not found'; echo 'libX11.so.6 => not found'")
    path = f"{tmp_path}{os.pathsep}{os.environ['PATH']}"
    status, _, err = finish(start(copy, "render", PATH=path))
    assert status == 1
    assert err.splitlines()[-1] == (
        "build.py: Blender's module needs libSM.so.6, libX11.so.6 from the system; "
        "on Debian and its kin: apt install libsm6 libx11-6"
    )


def test_changed_pins_and_a_moved_project_bring_it_up_to_date(tmp_path, project):
    moved = scratch_project(tmp_path / "moved")
    shutil.copytree(project / ".venv", moved / ".venv", symlinks=True)
    for change in ("place", "pins"):
        if change == "pins":
            (moved / "requirements.txt").write_text("# other pins\n")
        status, _, err = finish(start(moved, "render"))
        assert (status, err) == (0, f"build.py: bringing .venv/{THIS} up to date\n"), change
    (paths,) = (moved / ".venv").rglob("leapray.pth")
    assert paths.read_text().splitlines() == [str(moved), str(moved / "native")]


@pytest.mark.slow
@pytest.mark.parametrize(
    "moment, blow",
    [
        ("*", signal.SIGKILL),
        ("*/bin/python", signal.SIGKILL),
        ("*/lib/python*/site-packages/pip/__init__.py", signal.SIGKILL),
        ("*/lib/python*/site-packages/pip/__init__.py", signal.SIGINT),
    ],
)
def test_a_kill_while_it_is_made_leaves_nothing_broken(tmp_path, moment, blow):
    project = scratch_project(tmp_path / "project")
    process = start(project, "render")
    while not list((project / ".venv").glob(moment)):
        assert process.poll() is None
        time.sleep(0.01)
    if blow == signal.SIGINT:  # a terminal sends it to all
        os.killpg(process.pid, blow)
    else:
        process.send_signal(blow)
    _, err = process.communicate(timeout=60)
    assert process.returncode != 0 and "Traceback" not in err
    assert not list(project.rglob("leapray.stamp"))
    status, out, err = finish(start(project, "render"))
    assert status == 0 and out.endswith(" render\n"), err


@pytest.mark.slow
def test_two_at_once_make_one_environment(tmp_path):
    project = scratch_project(tmp_path / "project")
    ends = [finish(process) for process in [start(project, "render") for _ in range(3)]]
    assert [status for status, _, _ in ends] == [0, 0, 0], ends
    told = "".join(err for _, _, err in ends)
    assert told.count("making .venv") == 3  # one makes it, two say that they wait for it
    assert told.count("once; this takes") == 1


# ---- the core --------------------------------------------------------------


@pytest.fixture
def core(tmp_path):
    """build_core over a little native folder: two sources, one header."""
    native = tmp_path / "native"
    for folder in ("src/room", "include", "leapray"):
        (native / folder).mkdir(parents=True)
    shutil.copy(ROOT / "native" / "build_core.py", native)
    (native / "include" / "n.h").write_text("#define N 1\n")
    (native / "src" / "room" / "one.c").write_text(
        '#include "n.h"\nint one(void);\nint one(void) { return N; }\n'
    )
    (native / "src" / "two.c").write_text("int two(void);\nint two(void) { return 2; }\n")
    spec = importlib.util.spec_from_file_location("scratch_core", native / "build_core.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def compiled(core) -> str:
    """What a build says that it does."""
    told: list[str] = []
    core.build(say=told.append)
    return "".join(told)


def test_only_what_has_changed_is_compiled(core):
    native = core.NATIVE
    assert compiled(core) == "compiling 2 of 2 files of the core"
    assert compiled(core) == ""
    (native / "src" / "two.c").touch()
    assert compiled(core) == ""  # the content decides
    (native / "include" / "n.h").write_text("#define N 3\n")
    assert compiled(core) == "compiling 1 of 2 files of the core"
    (native / "src" / "two.c").unlink()
    before = core.LIBRARY.stat().st_ino
    assert compiled(core) == "compiling 0 of 1 files of the core"
    assert core.LIBRARY.stat().st_ino != before


def test_a_source_that_does_not_compile_leaves_the_library_as_it_was(core):
    compiled(core)
    before = core.LIBRARY.read_bytes()
    (core.NATIVE / "src" / "two.c").write_text("int two(void) { int unused; return 2; }\n")
    for _ in range(2):
        with pytest.raises(core.BuildError, match=r"src/two\.c.*\n.*error"):
            core.build()
    assert core.LIBRARY.read_bytes() == before
    assert not [path for path in core.LIBRARY.parent.iterdir() if path != core.LIBRARY]


def test_two_builds_at_once_agree(core):
    command = [sys.executable, str(core.NATIVE / "build_core.py")]
    builds = [subprocess.Popen(command, stderr=subprocess.PIPE, text=True) for _ in range(2)]
    told = [process.communicate(timeout=60)[1] for process in builds]
    assert [process.returncode for process in builds] == [0, 0]
    assert sorted(told) == ["", "compiling 2 of 2 files of the core\n"]


@pytest.mark.slow
def test_a_killed_build_is_finished_by_the_next(core):
    visible = '__attribute__((visibility("default")))'
    body = "".join(f"{visible} int f{i}(int x) {{ return x * {i}; }}\n" for i in range(4000))
    (core.NATIVE / "src" / "two.c").write_text(body)  # takes a second or two
    command = [sys.executable, str(core.NATIVE / "build_core.py")]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    while not list(core.OBJECTS.glob("*.key")):  # the other file is done, this one is under way
        assert process.poll() is None
        time.sleep(0.01)
    process.kill()
    process.communicate()
    assert not core.LIBRARY.exists()
    assert compiled(core) == "compiling 1 of 2 files of the core"
    assert ctypes.CDLL(str(core.LIBRARY)).f7(6) == 42


def test_a_python_without_the_compiler_is_told_where_one_is(core, monkeypatch):
    def absent(name):
        raise core.importlib.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(core.importlib.metadata, "version", absent)
    with pytest.raises(core.BuildError, match="has no package ziglang"):
        core.build()
