# SPDX-License-Identifier: GPL-3.0-or-later
"""The benchmarks of native/bench run, compare, and say what they measured; no speed is claimed."""

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import leapray
from bench import benchmarks
from bench import run as bench_run

NATIVE = Path(__file__).resolve().parents[2] / "native"
TINY = ("--only", "mesh", "build,surface", "--rounds", "3")  # some 10 ms each
NAMES = {"mesh build", "mesh surface"}

# A build of nothing: the library lies beside the package.
STUB = """
import os, pathlib, time
NATIVE = pathlib.Path(__file__).resolve().parent
OBJECTS = NATIVE / "build"
class BuildError(Exception): pass
def build(say=None): pass
if __name__ == "__main__" and "STALLED" in os.environ:
    print("stalled", flush=True)
    time.sleep(60)
"""


def run(*words, script=NATIVE / "bench" / "run.py", **env):
    return subprocess.run(
        [sys.executable, str(script), *map(str, words)],
        capture_output=True,
        text=True,
        env={**os.environ, **env},
    )


def rows(text):
    """{benchmark: its numbers} of a printed table."""
    lines = (line.split() for line in text.splitlines()[1:] if line.startswith("mesh"))
    return {" ".join(words[:2]): words[2:] for words in lines}


@pytest.fixture
def told(capsys):
    """Runs the command in this process; returns its status and what it printed."""

    def call(*words):
        try:
            status = bench_run.main(list(map(str, words)))
        except SystemExit as ended:
            status = ended.code
        return status, *capsys.readouterr()

    return call


def result_of(commit, **benchmarks):
    """A file's content: one benchmark by each name, of these seconds."""
    return {
        "commit": commit,
        "machine": "one",
        "vector_instructions": [],
        "python": "3",
        "benchmarks": {name: {"rays": 0, "seconds": each} for name, each in benchmarks.items()},
        "left_out": {},
    }


@pytest.fixture(scope="module")
def repository(tmp_path_factory):
    """A repository of this core: in its first commit voxelization is missing, and transfer
    functions end the process."""
    root = tmp_path_factory.mktemp("repository")
    native = root / "native"
    for package in ("leapray", "bench"):
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(NATIVE / package, native / package, ignore=ignored)
    (native / "build_core.py").write_text(STUB)
    whole = (native / "leapray" / "__init__.py").read_text()
    old = f"{whole}\nimport os\ndel voxelize\ndef TransferFunction(*_): os._exit(3)\n"
    who = ("-c", "user.name=someone", "-c", "user.email=someone@example.org")

    def git(*words):
        command = ["git", *who, "-C", str(root), *words]
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout

    git("init", "--quiet")
    for content in (old, whole):
        (native / "leapray" / "__init__.py").write_text(content)
        git("add", "--force", ".")
        git("commit", "--quiet", "--message", "state")
    return root, git


# ---- measuring -----------------------------------------------------------


def test_a_file_says_what_was_measured(tmp_path):
    result = run(*TINY, "--out", tmp_path / "a.json")
    assert result.returncode == 0, result.stderr
    told = json.loads((tmp_path / "a.json").read_text())
    assert told["benchmarks"].keys() == NAMES and not told["left_out"]
    assert all(told[key] for key in ("commit", "machine", "python"))
    assert isinstance(told["vector_instructions"], list)
    for name, each in told["benchmarks"].items():
        assert each["rays"] == (250**2 if name == "mesh surface" else 0)
        taken = sorted(each["seconds"])
        assert len(taken) == 3 and taken[0] > 0
        assert [each["least"], each["median"], each["most"]] == taken
        speed = [f"{each['rays'] / taken[1] / 1e6:.2f}"] if each["rays"] else []
        shown = [f"{1e3 * each[key]:.2f}" for key in ("median", "least", "most")]
        assert rows(result.stdout)[name] == shown + speed


def test_every_benchmark_has_a_name_of_its_own():
    names = [each.name for each in benchmarks.all_benchmarks()]
    assert len(set(names)) == len(names) > 100
    words = {word for name in names for word in name.split()}
    assert {"spheres", "mesh", "scene", "volume", "512", "u16"} <= words
    traversers = [entry for entry in leapray.traversers() if entry.exact or entry.default]
    assert all(sum(entry.name in name.split() for name in names) == 12 for entry in traversers)


# ---- two commits ---------------------------------------------------------


def test_a_commit_is_compared_and_nothing_of_it_is_left(repository, tmp_path):
    root, git = repository
    script = root / "native" / "bench" / "run.py"
    result = run(
        "--only",
        "mesh",
        "surface",
        "--rounds",
        "2",
        "--against",
        "HEAD",
        script=script,
        TMPDIR=str(tmp_path),
    )
    assert result.returncode == 0, result.stderr
    assert rows(result.stdout).keys() == {"mesh surface"}
    assert f"before: {git('rev-parse', 'HEAD')}" in result.stdout
    assert len(git("worktree", "list").splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_what_an_older_commit_cannot_run_is_named(repository, tmp_path):
    root, git = repository
    script = root / "native" / "bench" / "run.py"
    words = ("--only", "build,integrate,paths", "--rounds", "2", "--against", "HEAD~1")
    result = run(*words, script=script, TMPDIR=str(tmp_path))
    assert result.returncode == 0, result.stderr
    mesh, volume = (line for line in result.stderr.splitlines() if "left out" in line)
    assert mesh.startswith("bench: left out: mesh build: AttributeError") and "voxelize" in mesh
    assert volume.startswith("bench: left out: volume integrate: the process ended with status 3")
    commit = git("rev-parse", "HEAD~1").strip()
    assert all(line.endswith(f"(in {commit})") for line in (mesh, volume))
    (line,) = result.stdout.splitlines()[4:]
    assert line.startswith("scene paths")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_leaves_nothing_behind(number, repository, tmp_path):
    root, git = repository
    process = subprocess.Popen(
        [sys.executable, str(root / "native" / "bench" / "run.py"), "--against", "HEAD"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "TMPDIR": str(tmp_path), "STALLED": "1"},
    )
    assert process.stdout.readline() == "stalled\n"  # while it builds
    assert list(tmp_path.iterdir())
    process.send_signal(number)
    told = process.communicate(timeout=20)[1]
    assert process.returncode == 128 + number and "Traceback" not in told
    assert len(git("worktree", "list").splitlines()) == 1
    assert not list(tmp_path.iterdir())


# ---- two files -----------------------------------------------------------


def test_ratios_of_files_are_those_of_their_rounds_worst_first(told, tmp_path):
    before = result_of("old", **{"mesh build": [1.0, 2.0, 4.0], "mesh surface": [3.0]})
    after = result_of("new", **{"mesh build": [2.0, 4.0, 8.0], "mesh surface": [9.0, 6.0]})
    after["benchmarks"]["mesh voxelize"] = {"rays": 0, "seconds": [1.0]}
    for name, content in (("a.json", before), ("b.json", after)):
        (tmp_path / name).write_text(json.dumps(content))
    status, out, err = told("--compare", tmp_path / "a.json", tmp_path / "b.json")
    table = rows(out)
    assert status == 0
    assert list(table) == ["mesh surface", "mesh build"]
    assert table["mesh surface"] == ["2.500", "[2.000..3.000]", "3000.00", "7500.00"]
    assert table["mesh build"] == ["2.000", "[0.500..8.000]", "2000.00", "4000.00"]
    assert "left out: mesh voxelize: not measured (in old)" in err


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--only", "meshes"), "no benchmark has 'meshes' in its name"),
        (("--only", "mesh", "512"), "no benchmark has all of mesh 512 in its name"),
        (("--against", "nothing-of-the-kind"), "there is no commit 'nothing-of-the-kind'"),
        (("--rounds", "0"), "--rounds must be 1 or more; it is 0"),
        (("--out", "/nowhere/at/all.json"), "there is no folder /nowhere/at"),
        (("--compare", "missing.json", "missing.json"), "missing.json cannot be read"),
        (("--compare", __file__, __file__), "is no file that `run.py --out` has written"),
    ],
)
def test_what_is_wrong_is_said_in_a_sentence(words, sentence, told):
    status, out, err = told(*words)
    assert status and not out
    assert sentence in err.splitlines()[-1]


@pytest.mark.parametrize("content", ["{}", "[]", '{"commit": 1}', "\x00"])
def test_files_of_others_are_refused(content, told, tmp_path):
    path = tmp_path / "other.json"
    path.write_text(content)
    status, out, err = told("--compare", path, path)
    assert (status, out) == (1, "")
    assert err == f"bench: {path} is no file that `run.py --out` has written\n"


def test_files_without_a_benchmark_in_common_are_refused(told, tmp_path):
    for name in ("build", "surface"):
        content = result_of(name, **{f"mesh {name}": [1.0]})
        (tmp_path / name).write_text(json.dumps(content))
    status, _, err = told("--compare", tmp_path / "build", tmp_path / "surface")
    assert status == 1
    assert err.splitlines()[-1] == "bench: the two have no benchmark in common"
