# SPDX-License-Identifier: GPL-3.0-or-later
"""The cores that are measured: this checkout's and that of another commit, a process each."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import build_core

NATIVE = build_core.NATIVE
ROOT = NATIVE.parent


class BenchError(Exception):
    """Why there is nothing to measure or to compare, in one sentence."""


class Library:
    """A core in a long-lived process, which is started again where a benchmark ends it.

    name: what it is called in tables; package: the folder in which leapray lies.
    Attributes: name; rays: {benchmark: rays of one run}.
    """

    def __init__(self, name: str, package: Path) -> None:
        self.name, self.package = name, package
        self._process: subprocess.Popen[str] | None = None
        self.rays = self._start()

    def _start(self) -> dict[str, int]:
        command = [sys.executable, str(NATIVE / "bench" / "worker.py"), str(self.package)]
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,  # a Ctrl-C is heard here alone
        )
        told = self._read()
        if told is None:
            self.close()
            raise BenchError(f"the core of {self.name} cannot be loaded, for the reason above")
        return dict(told)

    def _read(self):
        """The next answer, None where the process ended instead."""
        assert self._process and self._process.stdout
        line = self._process.stdout.readline()
        return json.loads(line) if line.endswith("\n") else None

    def run(self, benchmark: str) -> tuple[float, str]:
        """Seconds of one run of a benchmark, and why there are none or ''."""
        if benchmark not in self.rays:
            return 0.0, "this core does not know it"
        assert self._process and self._process.stdin
        try:
            self._process.stdin.write(json.dumps(benchmark) + "\n")
            self._process.stdin.flush()
            told = self._read()
        except BrokenPipeError:
            told = None
        if told is None:
            status = self._process.wait()
            self._start()
            return 0.0, f"the process ended with status {status}"
        return told.get("seconds", 0.0), told.get("reason", "")

    def close(self) -> None:
        """End the process."""
        if self._process:
            self._process.kill()
            self._process.communicate()


@contextlib.contextmanager
def checkout(commit: str) -> Iterator[Path]:
    """native/ of that commit in a temporary worktree, with its core built. Raises BenchError."""
    folder = Path(tempfile.mkdtemp(prefix="leapray-bench-"))
    tree = folder / "checkout"
    try:
        git("worktree", "add", "--quiet", "--detach", str(tree), commit)
        build_checkout(tree / "native", commit)
        yield tree / "native"
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        removal = ("worktree", "remove", "--force", "--force", str(tree))
        subprocess.run([*GIT, *removal], capture_output=True, check=False)


def build_checkout(native: Path, commit: str) -> None:
    """Build a core by its own script; raises BenchError.

    It starts from this checkout's objects. Each is kept where the hash of its command and sources
    is what the script expects, so that only files that differ are compiled.
    """
    script = native / "build_core.py"
    if not script.exists():
        raise BenchError(f"commit {commit} has no {script.relative_to(native.parent)}")
    objects = [path for path in build_core.OBJECTS.glob("*.*") if path.is_file()]
    (native / "build").mkdir(exist_ok=True)
    for path in objects:
        shutil.copy2(path, native / "build")
    (native / "build" / "library.key").unlink(missing_ok=True)
    process = subprocess.Popen([sys.executable, str(script)], start_new_session=True)
    try:
        status = process.wait()
    except BaseException:
        os.killpg(process.pid, signal.SIGKILL)  # the compilers, too
        process.wait()
        raise
    if status:
        raise BenchError(f"the core of commit {commit} does not compile, for the reason above")


# ---- git -----------------------------------------------------------------

GIT = ("git", "-c", f"safe.directory={ROOT}", "-C", str(ROOT))  # another user's checkout, too


def git(*words: str) -> str:
    """What git answers; raises BenchError with its own words."""
    try:
        result = subprocess.run([*GIT, *words], capture_output=True, text=True, check=False)
    except OSError as error:
        raise BenchError(f"git cannot be run: {error.strerror}") from None
    if result.returncode:
        raise BenchError(f"git {words[0]}: {' '.join(result.stderr.split())}")
    return result.stdout.strip()


def find_commit(name: str) -> str:
    """The hash that a commit's name stands for; raises BenchError."""
    try:
        return git("rev-parse", "--verify", "--quiet", "--end-of-options", f"{name}^{{commit}}")
    except BenchError:
        raise BenchError(f"there is no commit {name!r} in this checkout") from None


def own_commit() -> str:
    """The commit that is checked out, with "-dirty" where files differ; "unknown" without git."""
    try:
        return git("describe", "--always", "--dirty", "--abbrev=40", "--exclude=*")
    except BenchError:
        return "unknown"


def say(sentence: str) -> None:
    print(f"bench: {sentence}", file=sys.stderr, flush=True)
