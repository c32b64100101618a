# SPDX-License-Identifier: GPL-3.0-or-later
"""The entry point of LeapRay.

    python3 build.py [--python 3.13|3.11|other] VERB ...

    render SCENE.blend     render a scene           (--help lists the options)
    compare SCENE.blend    the same frame by Cycles and by LeapRay, and a report
    study NAME             measure: speed, accuracy, stability
    test [--quick] ...     the project's checks; what follows goes to pytest
    test --sanitize address|thread, --analyze, --portable, --coverage, --fuzz MINUTES
                           the core compiled or read in other ways; see CONTRIBUTING.md
    build                  the core, and its wheel in dist/
    package                the extension for Blender, in dist/

On first use it makes .venv/3.13 (or 3.11) with what requirements.txt pins:
Blender as a module, and a compiler; what only some verbs need is added when one
of them is called. The core is compiled whenever its source has changed. Any
Python from 3.8 may start it: it looks for one that Blender supports, and hands
over.

This file runs twice: under the Python that was called, which sees to the
environment, and then inside the environment, which does the work.
"""

# ruff: noqa: E402  signals are heard before anything else

import os
import signal
import sys

SIGNALS = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated", signal.SIGHUP: "hung up"}


class Signalled(BaseException):
    """A signal, raised so that what runs is ended in order."""


def listen():
    """Have signals end the process with one sentence, but those that it was told to ignore."""
    for number in SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, end)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)  # enter has them wait


def end(number, _frame=None):
    os.write(2, f"build.py: {SIGNALS[number]}\n".encode())
    os._exit(128 + number)


def end_in_order(number, _frame):
    signal.signal(number, end)  # the second time at once
    raise Signalled(number)


if __name__ == "__main__":
    listen()

import contextlib
import difflib
import hashlib
import platform
import re
import select
import shutil
import subprocess
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent
SUPPORTED = ("3.13", "3.11")  # of the Blenders whose wheels requirements.txt names

# What each verb needs of the files that pin packages.
RENDER, VOLUMES, STUDY, PACKAGE, TEST = (
    "requirements.txt",
    "requirements-volumes.txt",
    "requirements-study.txt",
    "requirements-package.txt",
    "requirements-test.txt",
)
VERBS = {
    "render": (RENDER, VOLUMES),
    "compare": (RENDER, VOLUMES, STUDY),
    "study": (RENDER, VOLUMES, STUDY),
    "test": (RENDER, VOLUMES, STUDY, PACKAGE, TEST),
    "build": (RENDER, PACKAGE),
    "package": (RENDER, PACKAGE),
}

# Shared libraries that Blender's module takes from the system, and where Debian keeps them.
SYSTEM_LIBRARIES = {
    "libX11.so.6": "libx11-6",
    "libXext.so.6": "libxext6",
    "libXfixes.so.3": "libxfixes3",
    "libXi.so.6": "libxi6",
    "libXrender.so.1": "libxrender1",
    "libxkbcommon.so.0": "libxkbcommon0",
    "libSM.so.6": "libsm6",
    "libICE.so.6": "libice6",
    "libGL.so.1": "libgl1",
    "libstdc++.so.6": "libstdc++6",
}


class Refusal(Exception):
    """Why nothing was done, in one sentence."""


def say(sentence):
    print(f"build.py: {sentence}", file=sys.stderr, flush=True)


# ---- the environment -----------------------------------------------------


class Environment:
    """One virtual environment, which holds the sets of packages that its stamp names."""

    def __init__(self, version):
        self.version = version
        self.folder = ROOT / ".venv" / version
        self.python = self.folder / "bin" / "python"
        self.stamp = self.folder / "leapray.stamp"
        self.blender_loads = self.folder / "leapray.bpy"  # exists once bpy was seen to load

    def stamped(self):
        """{set: hash of the pins that were installed}; empty where it is not whole."""
        try:
            lines = self.stamp.read_text().splitlines()
            return dict(line.split() for line in lines) if self.python.exists() else {}
        except (OSError, ValueError):
            return {}

    def has(self, sets):
        stamped = self.stamped()
        return all(stamped.get(name) == pins(name) for name in sets)

    def running(self):
        return os.path.realpath(sys.prefix) == os.path.realpath(str(self.folder))

    def make(self, base, sets):
        """Have it hold these sets, made by the Python base where there is none; safe to
        interrupt anywhere.

        The stamp goes first and comes back last: without it the next call
        starts over. The lock is handed to every child, so that it lasts while
        any of them, orphans too, still writes.
        """
        with locked(self.folder.with_name(self.version + ".lock")) as lock:
            if self.has(sets):
                return
            before = self.stamped()
            sets = [name for name in VERBS["test"] if name in before or name in sets]
            if self.stamp.exists() and self.python.exists():
                what = "up to date" if len(sets) == len(before) else "to what this verb needs"
                self.stamp.unlink()
                say(f"bringing .venv/{self.version} {what}")
            else:
                say(f"making .venv/{self.version}, once; this takes a minute or two")
                shutil.rmtree(self.folder, ignore_errors=True)
                base = base or find_python([self.version])[1]
                run([base, "-m", "venv", self.folder], lock, f"could not make {self.folder}")
            with contextlib.suppress(FileNotFoundError):
                self.blender_loads.unlink()
            self.install(sets, lock)
            packages = next(self.folder.glob("lib/python*/site-packages"))
            up = "../" * len(packages.relative_to(ROOT).parts)
            (packages / "leapray.pth").write_text(f"{up}\n{up}native\n")
            beside = self.stamp.with_suffix(".new")
            beside.write_text("".join(f"{name} {pins(name)}\n" for name in sets))
            beside.replace(self.stamp)

    def install(self, sets, lock):
        """Install what the sets pin; pip loads down into a folder whose growth is shown."""
        downloads = self.folder / "downloads"
        shutil.rmtree(downloads, ignore_errors=True)
        downloads.mkdir()
        pip = [self.python, "-m", "pip", "--disable-pip-version-check", "--no-input", "install"]
        files = [word for name in sets for word in ("-r", ROOT / name)]
        try:
            run(
                [*pip, "--progress-bar", "off", "--only-binary", ":all:", *files],
                lock,
                f"could not install what {' and '.join(sets)} pin",
                Installation(downloads),
                # Packages on PYTHONPATH would pass for installed ones.
                {"TMPDIR": str(downloads), "PYTHONPATH": ""},
            )
        finally:
            shutil.rmtree(downloads, ignore_errors=True)


def pins(name):
    """Hash of a file that pins packages."""
    return hashlib.sha256((ROOT / name).read_bytes()).hexdigest()


class Installation:
    """What pip says, made into a line of progress: on a terminal one that changes each second."""

    PAUSE = 10.0  # seconds between lines elsewhere

    def __init__(self, downloads):
        self.downloads = downloads
        self.terminal = sys.stderr.isatty()
        self.began = self.said = time.monotonic()
        self.doing, self.size, self.before = "looking for packages", "", 0

    def hear(self, text):
        for line in text.splitlines():
            found = re.match(r"\s*(?:Downloading|Using cached) (\S+) \((.+)\)", line)
            if found:
                self.doing = f"downloading {found.group(1).rpartition('/')[2].partition('-')[0]}"
                self.size, self.before = found.group(2), self.loaded()
            elif line.startswith("Installing collected packages"):
                self.doing, self.size = "unpacking", ""

    def show(self):
        now = time.monotonic()
        if now - self.said < (1.0 if self.terminal else self.PAUSE):
            return
        self.said = now
        words = f"{self.doing}, {now - self.began:.0f} s"
        if self.size:
            words = f"{self.doing}, {(self.loaded() - self.before) / 1e6:.1f} MB of {self.size}"
        if self.terminal:
            print(f"\r\x1b[Kbuild.py: {words}", end="", file=sys.stderr, flush=True)
        else:
            say(words)

    def loaded(self):
        """Bytes of all that has been downloaded."""
        nbytes = 0
        for folder, _, names in os.walk(str(self.downloads)):
            for name in names:
                with contextlib.suppress(OSError):
                    nbytes += os.path.getsize(os.path.join(folder, name))
        return nbytes

    def end(self):
        if self.terminal:
            print("\r\x1b[K", end="", file=sys.stderr, flush=True)


@contextlib.contextmanager
def locked(path):
    """Hold an exclusive lock on path, saying so where another process has it."""
    import fcntl

    path.parent.mkdir(parents=True, exist_ok=True)
    with open(path, "w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            say(f"waiting for another build.py, which is making .venv/{path.stem}")
            fcntl.flock(file, fcntl.LOCK_EX)
        yield file


def run(command, lock, complaint, watcher=None, variables=None):
    """Run a command that inherits the lock; its output goes to stderr, or to the watcher.

    It has a session of its own, out of reach of the terminal's Ctrl-C, at which
    venv and what it calls would print tracebacks; all of them are ended here.
    """
    words = [str(word) for word in command]
    with subprocess.Popen(
        words,
        stdout=subprocess.PIPE if watcher else sys.stderr,
        env={**os.environ, **(variables or {})},
        pass_fds=[lock.fileno()],
        start_new_session=True,
    ) as child:
        try:
            if watcher:
                follow(child.stdout, watcher)
            status = child.wait()
        except BaseException:
            os.killpg(child.pid, signal.SIGTERM)
            raise
    if status:
        raise Refusal(complaint + "; what pip or venv said stands above")


def follow(pipe, watcher):
    """Hand what comes out of the pipe to the watcher until it is closed."""
    try:
        while True:
            if select.select([pipe], [], [], 0.5)[0]:
                text = os.read(pipe.fileno(), 65536)
                if not text:
                    return
                watcher.hear(text.decode(errors="replace"))
            watcher.show()
    finally:
        watcher.end()


# ---- the right Python ----------------------------------------------------


def candidates(version):
    """Paths at which a Python of this version may lie, likelier ones first."""
    name = "python" + version
    home = Path.home()
    folders = [Path(folder) for folder in os.environ.get("PATH", "").split(os.pathsep) if folder]
    folders += [Path("/usr/local/bin"), Path("/usr/bin"), home / ".local" / "bin"]
    roots = [
        (Path(os.environ.get("PYENV_ROOT") or home / ".pyenv") / "versions", version + "*/bin"),
        (home / ".local/share/uv/python", "cpython-" + version + ".*/bin"),
        (Path("/opt"), "*/bin"),
    ]
    for root, pattern in roots:
        folders += sorted(root.glob(pattern), reverse=True)
    paths = [folder / name for folder in folders]
    return [path for path in dict.fromkeys(paths) if path.exists()]


def version_of(path):
    """(version, whether it can make environments) of an interpreter, by running it."""
    probe = (
        "import importlib.util as u, sys;"
        "print('%d.%d' % sys.version_info[:2], all(map(u.find_spec, ('venv', 'ensurepip'))))"
    )
    try:
        words = subprocess.run(
            [str(path), "-c", probe],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            stdin=subprocess.DEVNULL,
            timeout=20,
        )
        version, complete = words.stdout.decode().split()
    except (OSError, ValueError, subprocess.TimeoutExpired):
        return None, False
    return version, complete == "True"


def find_python(versions):
    """The first interpreter of one of these versions that runs: (version, path)."""
    incomplete = []
    for version in versions:
        running = [Path(sys.executable)] if sys.executable and version == this_version() else []
        for path in running + candidates(version):
            found, complete = version_of(path)
            if found == version and complete:
                return version, path
            if found == version:
                incomplete.append(version)
    if incomplete:
        name = "python" + incomplete[0]
        raise Refusal(f"{name} cannot make environments here; install {name}-venv")
    raise Refusal(
        f"Blender's module needs Python {' or '.join(versions)}, and none was found (this is "
        f"{this_version()}); install it, by your system's packages or from python.org"
    )


def this_version():
    return "{}.{}".format(*sys.version_info)


def preferences(choice):
    """Groups of versions that will do, the best group first."""
    own = this_version()
    others = [version for version in SUPPORTED if version != own]
    if choice in SUPPORTED:
        return [[choice]]
    if choice == "other":
        return [others[-1:]]
    if choice:
        raise Refusal(f"--python takes {', '.join(SUPPORTED)} or other, not {choice}")
    return [[own], others] if own in SUPPORTED else [others]


def environment_for(choice, verb):
    """An environment of the version that suits best, with what the verb needs."""
    sets = VERBS[verb]
    refusals = []
    for versions in preferences(choice):
        known = [Environment(version) for version in versions]
        for environment in known:
            if environment.has(sets):
                return environment
        try:
            extended = next((each for each in known if each.stamped()), None)
            version, base = (extended.version, None) if extended else find_python(versions)
        except Refusal as refusal:
            refusals.append(refusal)
            continue
        environment = Environment(version)
        try:
            environment.make(base, sets)
        except OSError as error:
            raise Refusal(why_not_made(environment, verb, error)) from None
        return environment
    raise refusals[0]


def why_not_made(environment, verb, error):
    """In one sentence, why an environment cannot be made or changed here."""
    where = f".venv/{environment.version} of {ROOT}"
    try:
        behind = os.path.realpath(str(environment.python))
        if environment.stamp.exists() and not os.access(behind, os.X_OK):
            return f"{where} uses {behind}, which you may not run; its owner may let you"
    except OSError:
        pass
    what = "does not hold what this verb needs" if environment.stamped() else "is not made"
    return (
        f"{where} {what}, and it cannot be written to by you ({error.strerror}: {error.filename}); "
        f"have its owner run `python3 build.py --python {environment.version} {verb}` once, or "
        "take a copy of your own"
    )


def enter(choice, words):
    """Go on inside the environment; does not return."""
    if sys.platform != "linux" or platform.machine() != "x86_64":
        raise Refusal(f"LeapRay builds on Linux x86-64 so far, and this is {platform.platform()}")
    python = str(environment_for(choice, words[0]).python)
    signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)  # until listen, in the new process
    os.execv(python, [python, str(ROOT / "build.py"), *words])


# ---- inside the environment ----------------------------------------------


def build_core():
    """Compile what has changed."""
    import build_core as core

    try:
        core.build(say=say)
    except core.BuildError as error:
        raise Refusal(str(error)) from None


def see_that_blender_loads(environment):
    """Once per environment, load bpy in a process of its own; name what the system lacks."""
    if environment.blender_loads.exists():
        return
    probe = subprocess.run(
        [sys.executable, "-c", "import bpy"], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    )
    if probe.returncode:
        listing = subprocess.run(
            ["ldd", blender_module()], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
        )
        lines = listing.stdout.decode().splitlines()
        missing = sorted({line.split()[0] for line in lines if line.endswith("not found")})
        if not missing:
            raise Refusal("Blender's module does not load:\n" + probe.stderr.decode())
        packages = [SYSTEM_LIBRARIES[name] for name in missing if name in SYSTEM_LIBRARIES]
        raise Refusal(
            f"Blender's module needs {', '.join(missing)} from the system; on Debian and its kin: "
            f"apt install {' '.join(packages)}"
        )
    with contextlib.suppress(OSError):  # where nothing can be written it is tried each time
        environment.blender_loads.touch()


def blender_module():
    """The file of Blender's module."""
    import importlib.util

    module = importlib.util.find_spec("bpy")
    if module is None or module.origin is None:
        raise Refusal("Blender's module is not installed")
    return module.origin


def test(words):
    """Hand over to the project's checks."""
    os.chdir(ROOT)
    os.execv(sys.executable, [sys.executable, "tests/checks.py", *words])


def make_packages(verb):
    """Make the core's wheel or the extension, and say where it is."""
    import build_core
    import build_packages

    try:
        if verb == "build":
            print(build_packages.make_wheel())
        else:
            blender = Path(blender_module()).parent
            print(build_packages.make_extension(blender, ROOT / VOLUMES))
    except build_core.BuildError as error:
        raise Refusal(str(error)) from None


def work(environment, verb, words):
    """Do what the verb says; returns the exit code, or ends the process with it."""
    sys.path[:0] = [str(ROOT), str(ROOT / "native")]
    build_core()
    if verb in ("build", "package"):
        if words:
            raise Refusal(f"{verb} takes no further words, but got {' '.join(words)}")
        make_packages(verb)
        return 0
    see_that_blender_loads(environment)
    if verb == "test":
        test(words)
    from addon import process

    process.run(command_line, [verb, *words])


def command_line(words):
    from addon import cli

    return cli.run(words)


def main(words):
    choice = None
    if words[:1] == ["--python"]:
        choice, words = "".join(words[1:2]), words[2:]
    verb = words[0] if words else ""
    if verb in ("", "-h", "--help", "help"):
        print(__doc__.split("\n", 2)[2].rsplit("\n\n", 1)[0])
        return 0 if verb else 2
    if verb not in VERBS:
        close = difflib.get_close_matches(verb, VERBS, 1)
        close = [f"render {verb}"] if verb.endswith(".blend") else close
        meant = f" did you mean {close[0]}?" if close else ""
        raise Refusal(f"no verb {verb};{meant} there are {', '.join(VERBS)}")
    environment = Environment(this_version())
    if choice or not environment.running():
        enter(choice, words)
    return work(environment, verb, words[1:])


def ends_with(words):
    """The exit code, after a sentence where something went wrong."""
    try:
        return main(words)
    except Refusal as refusal:
        say(str(refusal))
    except OSError as error:
        say(f"{error.filename or ROOT}: {error.strerror or error}")
    return 1


if __name__ == "__main__":
    for signal_number in SIGNALS:
        if signal.getsignal(signal_number) is end:
            signal.signal(signal_number, end_in_order)
    try:
        code = ends_with(sys.argv[1:])
    except Signalled as signalled:
        end(signalled.args[0])
    sys.exit(code)
