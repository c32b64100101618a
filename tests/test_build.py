# SPDX-License-Identifier: GPL-3.0-or-later
"""The entry point: finds a Python, makes its environment once, survives kills, leaves no trace.

A scratch project holds build.py and addon/process.py as they are, no pins, and
stubs for what takes long: Blender's module, the command line behind the verbs,
the core. Virtual environments, locks, kills and exit codes are real.
"""

from __future__ import annotations

import ctypes
import hashlib
import importlib.util
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import build

ROOT = Path(__file__).resolve().parent.parent
THIS = f"{sys.version_info[0]}.{sys.version_info[1]}"

STUBS = {
    **dict.fromkeys(build.VERBS["test"], ""),  # the files that pin packages
    "bpy/__init__.py": "",
    "native/build_core.py": "class BuildError(Exception): pass\ndef build(say): pass\n",
    "addon/cli.py": (
        "import sys, time\n"
        "def run(words):\n"
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
    shutil.copy(ROOT / "addon" / "process.py", folder / "addon")
    return folder


def start(project: Path, *words: str, before=None, **environment: str) -> subprocess.Popen:
    return subprocess.Popen(
        [sys._base_executable, str(project / "build.py"), *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, **environment},
        start_new_session=True,
        preexec_fn=before,
    )


def finish(process: subprocess.Popen) -> tuple[int, str, str]:
    out, err = process.communicate(timeout=120)
    return process.returncode, out, err


def script(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return path


def stamp(project: Path, sets) -> None:
    """Have the environment's stamp name these sets, which pin nothing."""
    (file,) = (project / ".venv").rglob("leapray.stamp")
    file.write_text("".join(f"{name} {hashlib.sha256(b'').hexdigest()}\n" for name in sets))


def stamped(project: Path) -> set[str]:
    """The sets that an environment's stamp names."""
    (file,) = (project / ".venv").rglob("leapray.stamp")
    return {line.split()[0] for line in file.read_text().splitlines()}


@pytest.fixture(scope="module")
def project(tmp_path_factory) -> Path:
    """A scratch project whose environment is made."""
    folder = scratch_project(tmp_path_factory.mktemp("build") / "project")
    status, out, err = finish(start(folder, "render", "a.blend"))
    assert (status, out) == (1, f"({THIS.replace('.', ', ')}) render a.blend\n"), err
    assert err.count("\n") == 1 and f"making .venv/{THIS}, once" in err
    assert stamped(folder) == set(build.VERBS["render"])
    stamp(folder, build.VERBS["test"])  # there is nothing in the others either
    return folder


# ---- words -----------------------------------------------------------------


def test_no_verb_shows_the_usage(project):
    status, out, err = finish(start(project))
    assert status == 2 and "render SCENE.blend" in out and not err


@pytest.mark.parametrize(
    "words, culprit",
    [
        (["paint"], "no verb paint; there are render, compare,"),
        (["rendr", "a.blend"], "no verb rendr; did you mean render? there are render,"),
        (["a.blend"], "no verb a.blend; did you mean render a.blend? there are render,"),
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


@pytest.mark.parametrize("blow, word", [(number, word) for number, word in build.SIGNALS.items()])
def test_a_signal_ends_the_work_without_a_traceback(project, blow, word):
    process = start(project, "render", "sleep")
    assert "render sleep" in process.stdout.readline()
    process.send_signal(blow)
    status, _, err = finish(process)
    assert status == 128 + blow
    assert re.fullmatch("leapray: .*\n", err) and (blow == signal.SIGHUP or word in err)


def test_a_signal_that_is_ignored_stays_so(project):
    def ignore():
        signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as nohup does

    process = start(project, "render", "sleep", before=ignore)
    assert "render sleep" in process.stdout.readline()
    process.send_signal(signal.SIGHUP)
    time.sleep(0.3)
    assert process.poll() is None
    process.send_signal(signal.SIGTERM)
    assert finish(process)[0] == 128 + signal.SIGTERM


def catches(process: subprocess.Popen, number: int) -> bool:
    """Whether a process has a handler of that signal."""
    status = Path(f"/proc/{process.pid}/status").read_text()
    return bool(int(re.search(r"SigCgt:\s*(\w+)", status)[1], 16) >> (number - 1) & 1)


def test_a_signal_is_heard_from_one_python_to_the_next(project):
    for pause in np.linspace(0, 0.25, 6):
        process = start(project, "render", "sleep")
        while not catches(process, signal.SIGTERM):  # Python by itself does not
            time.sleep(0.001)
        time.sleep(pause)
        process.send_signal(signal.SIGINT)
        status, _, err = finish(process)
        assert (status, err.count("\n")) == (130, 1) and "interrupted" in err, pause


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
    (copy / ".venv" / THIS / "leapray.bpy").unlink()
    (copy / "bpy/__init__.py").write_text("raise ImportError('libSM.so.6: no such file')")
    script(tmp_path / "ldd", "echo 'libSM.so.6 => not found'; echo 'libX11.so.6 => not found'")
    path = f"{tmp_path}{os.pathsep}{os.environ['PATH']}"
    status, _, err = finish(start(copy, "render", PATH=path))
    assert status == 1
    assert err.splitlines()[-1] == (
        "build.py: Blender's module needs libSM.so.6, libX11.so.6 from the system; "
        "on Debian and its kin: apt install libsm6 libx11-6"
    )


@pytest.fixture
def copied(tmp_path, project) -> Path:
    """A copy of the project and of its environment."""
    copy = scratch_project(tmp_path / "copy")
    shutil.copytree(project / ".venv", copy / ".venv", symlinks=True)
    return copy


def test_changed_pins_bring_it_up_to_date(copied):
    (copied / "requirements.txt").write_text("# other pins\n")
    status, _, err = finish(start(copied, "render"))
    assert (status, err) == (0, f"build.py: bringing .venv/{THIS} up to date\n")


def test_a_moved_project_works_at_once_with_its_own_code(copied):
    (copied / "native" / "moved.py").write_text("")
    status, _, err = finish(start(copied, "render"))
    assert (status, err) == (0, "")
    python = copied / ".venv" / THIS / "bin" / "python"
    subprocess.run([python, "-c", "import moved, addon.cli"], check=True, cwd="/")


def test_a_verb_gets_the_sets_that_it_needs_and_keeps_the_others(copied):
    stamp(copied, build.VERBS["render"])
    for verb, want in (
        ("study", set(build.VERBS["study"])),
        ("build", set(build.VERBS["build"])),
    ):
        before = stamped(copied)
        _, _, err = finish(start(copied, verb, "x"))  # build refuses the word, after that
        assert err.startswith(f"build.py: bringing .venv/{THIS} to what this verb needs\n"), err
        assert stamped(copied) == before | want
    assert finish(start(copied, "render"))[2] == ""
    (copied / build.STUDY).write_text("# other pins\n")
    assert finish(start(copied, "render"))[2] == ""  # what it does not need may be old
    (copied / build.RENDER).write_text("# other pins\n")
    finish(start(copied, "render"))
    assert stamped(copied) == {build.RENDER, build.VOLUMES, build.STUDY, build.PACKAGE}


def test_an_environment_stamped_by_an_older_version_is_brought_up_to_date(copied):
    (file,) = (copied / ".venv").rglob("leapray.stamp")
    file.write_text("0123456789abcdef")
    kept = file.with_name("kept")
    kept.touch()
    status, _, err = finish(start(copied, "render"))
    assert status == 0 and "bringing" in err and kept.exists()


def test_pins_agree_wherever_they_stand():
    found: dict[str, str] = {}
    for name in build.VERBS["test"]:
        for line in (ROOT / name).read_text().splitlines():
            pin, _, marker = line.partition("==")
            if marker:
                marker, _, condition = marker.partition(";")
                key = f"{pin.lower()};{condition.strip()}"
                assert found.setdefault(key, marker) == marker, line


PIP = r"""
import sys, time
from pathlib import Path
Path(sys.argv[1], "other").write_bytes(bytes(7_000_000))
sys.stdout.write("  Downloading https://host/path/bpy-4-cp311.whl (9.0 MB)\n")
sys.stdout.flush()
time.sleep(0.1)
Path(sys.argv[1], "part").write_bytes(bytes(3_000_000))
time.sleep({0})
print("Installing collected packages: bpy", flush=True)
time.sleep({0})
"""


def test_progress_is_shown_while_packages_are_downloaded(tmp_path, monkeypatch, capfd):
    monkeypatch.setattr(build.Installation, "PAUSE", 0.5)
    with open(tmp_path / "lock", "w") as lock:
        command = [sys.executable, "-c", PIP.format(1.6), tmp_path]
        build.run(command, lock, "", build.Installation(tmp_path))
    lines = capfd.readouterr().err.splitlines()
    assert "build.py: downloading bpy, 3.0 MB of 9.0 MB" in lines
    assert re.fullmatch(r"build\.py: unpacking, \d s", lines[-1]) and 3 <= len(lines) <= 8


# ---- what cannot be written ------------------------------------------------


def powerless() -> None:
    """Have the superuser obey the permissions of files, as everybody else."""
    libc = ctypes.CDLL(None)
    for capability in range(64):
        libc.prctl(24, capability, 0, 0, 0)  # PR_CAPBSET_DROP


@pytest.fixture
def closed(copied):
    """The copied project after a first call, when nothing in it can be written any more."""
    finish(start(copied, "render"))

    def close() -> None:
        folders.extend(each for each in [copied, *copied.rglob("*")] if each.is_dir())
        for folder in folders:
            if not folder.is_symlink():
                folder.chmod(0o555)

    folders: list[Path] = []
    yield close
    for folder in folders:
        folder.chmod(0o755)


def test_a_project_that_cannot_be_written_to_runs_where_it_is_built(copied, closed):
    closed()
    status, out, err = finish(start(copied, "render", "x", before=powerless))
    assert (status, err) == (1, "") and out.endswith(" render x\n")


@pytest.mark.parametrize("lacks", ["environment", "set", "core"])
def test_a_project_that_cannot_be_written_to_says_what_it_lacks(copied, closed, lacks):
    verb = "study" if lacks == "set" else "render"
    if lacks == "environment":
        shutil.rmtree(copied / ".venv")
    if lacks == "set":
        stamp(copied, build.VERBS["render"])
    if lacks == "core":
        shutil.copy(ROOT / "native" / "build_core.py", copied / "native")
        (copied / "native" / "src").mkdir()
        (copied / "native" / "src" / "one.c").write_text("int one;\n")
        (copied / "ziglang.dist-info").mkdir()
        (copied / "ziglang.dist-info" / "METADATA").write_text("Name: ziglang\nVersion: 1\n")
    closed()
    status, out, err = finish(start(copied, verb, before=powerless))
    assert (status, out, err.count("\n")) == (1, "", 1), err
    assert "cannot be written to by you" in err and "have its owner run `python3 build.py" in err
    assert {
        "environment": "is not made",
        "set": "does not hold what this verb needs",
        "core": "is not compiled from these sources",
    }[lacks] in err


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
