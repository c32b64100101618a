# SPDX-License-Identifier: GPL-3.0-or-later
"""The front door of LeapRay.

    python3 build.py [--python 3.13|3.11|other] VERB ...

    render SCENE.blend     render a scene           (--help lists the options)
    compare SCENE.blend    the same frame by Cycles and by LeapRay, and a report
    study NAME             measure: speed, accuracy, stability
    test [--quick] ...     the project's checks; what follows goes to pytest
    build                  the core, and its wheel in dist/
    package                the extension for Blender, in dist/

On first use it makes .venv/3.13 (or 3.11) with what requirements.txt pins:
Blender as a module, and a compiler. The core is compiled whenever its source
has changed. Any Python from 3.8 may start it: it looks for one that Blender
supports, and hands over.

This file runs twice: under the Python that was called, which sees to the
environment, and then inside the environment, which does the work.
"""

import contextlib
import hashlib
import os
import platform
import shutil
import signal
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent
REQUIREMENTS = ROOT / "requirements.txt"
SUPPORTED = ("3.13", "3.11")  # of the Blenders whose wheels requirements.txt names
VERBS = ("render", "compare", "study", "test", "build", "package")

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
    """One virtual environment, good once its stamp names what it was made from."""

    def __init__(self, version):
        self.version = version
        self.folder = ROOT / ".venv" / version
        self.python = self.folder / "bin" / "python"
        self.stamp = self.folder / "leapray.stamp"
        self.blender_loads = self.folder / "leapray.bpy"  # exists once bpy was seen to load

    def wanted_stamp(self):
        """Hash of the pins and of this folder's place, which the environment has on its path."""
        return hashlib.sha256(REQUIREMENTS.read_bytes() + str(ROOT).encode()).hexdigest()

    def ready(self):
        with contextlib.suppress(OSError):
            return self.stamp.read_text() == self.wanted_stamp() and self.python.exists()
        return False

    def running(self):
        return os.path.realpath(sys.prefix) == os.path.realpath(str(self.folder))

    def make(self, base):
        """Bring the environment up to date with the Python base; safe to interrupt anywhere.

        The stamp goes first and comes back last: without it the next call
        starts over. The lock is handed to every child, so that it lasts while
        any of them, orphans too, still writes.
        """
        with locked(self.folder.with_name(self.version + ".lock")) as lock:
            if self.ready():
                return
            if self.stamp.exists() and self.python.exists():
                say(f"bringing .venv/{self.version} up to date")
                self.stamp.unlink()
            else:
                say(f"making .venv/{self.version}, once; this takes a minute or two")
                shutil.rmtree(self.folder, ignore_errors=True)
                run([base, "-m", "venv", self.folder], lock, f"could not make {self.folder}")
            with contextlib.suppress(FileNotFoundError):
                self.blender_loads.unlink()
            pip = [self.python, "-m", "pip", "--disable-pip-version-check", "--no-input"]
            quiet = [] if sys.stderr.isatty() else ["--quiet"]
            install = ["install", *quiet, "--only-binary", ":all:", "-r", REQUIREMENTS]
            run(pip + install, lock, "could not install what requirements.txt names")
            packages = next(self.folder.glob("lib/python*/site-packages"))
            (packages / "leapray.pth").write_text(f"{ROOT}\n{ROOT / 'native'}\n")
            beside = self.stamp.with_suffix(".new")
            beside.write_text(self.wanted_stamp())
            beside.replace(self.stamp)


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


def run(command, lock, complaint):
    """Run a command that inherits the lock; its output goes to stderr.

    It has a session of its own, out of reach of the terminal's Ctrl-C, at which
    venv and what it calls would print tracebacks; all of them are ended here.
    """
    words = [str(word) for word in command]
    with subprocess.Popen(
        words, stdout=sys.stderr, pass_fds=[lock.fileno()], start_new_session=True
    ) as child:
        try:
            status = child.wait()
        except BaseException:
            os.killpg(child.pid, signal.SIGTERM)
            raise
    if status:
        raise Refusal(complaint + "; what pip or venv said stands above")


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


def environment_for(choice):
    """A ready environment of the version that suits best, made where there is none."""
    refusals = []
    for versions in preferences(choice):
        for version in versions:
            if Environment(version).ready():
                return Environment(version)
        try:
            version, base = find_python(versions)
        except Refusal as refusal:
            refusals.append(refusal)
            continue
        environment = Environment(version)
        environment.make(base)
        return environment
    raise refusals[0]


def enter(choice, words):
    """Go on inside the environment; does not return."""
    if sys.platform != "linux" or platform.machine() != "x86_64":
        raise Refusal(f"LeapRay builds on Linux x86-64 so far, and this is {platform.platform()}")
    python = str(environment_for(choice).python)
    os.execv(python, [python, str(ROOT / "build.py"), *words])


# ---- inside the environment ----------------------------------------------


def build_core():
    """Compile what has changed."""
    import build_core as core

    try:
        core.build(say=say)
    except core.BuildError as error:
        raise Refusal(f"the core does not compile:\n{error}") from None


def see_that_blender_loads(environment):
    """Once per environment, load bpy in a process of its own; name what the system lacks."""
    if environment.blender_loads.exists():
        return
    probe = subprocess.run(
        [sys.executable, "-c", "import bpy"], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    )
    if probe.returncode:
        import importlib.util

        module = importlib.util.find_spec("bpy")
        listing = subprocess.run(
            ["ldd", module.origin], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
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
    environment.blender_loads.touch()


def test(words):
    """Run pytest in the project's folder; --quick leaves out what is marked slow."""
    if "--quick" in words:
        words = [word for word in words if word != "--quick"] + ["-m", "not slow"]
    os.chdir(ROOT)
    os.execv(sys.executable, [sys.executable, "-m", "pytest", *words])


def make_wheel():
    """The core as a wheel in dist/, for every Python from 3.11; returns its path."""
    with tempfile.TemporaryDirectory() as folder:
        pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "wheel", "--quiet"]
        here = ["--no-deps", "--no-build-isolation", "--wheel-dir", folder, str(ROOT / "native")]
        if subprocess.run(pip + here).returncode:
            raise Refusal("the wheel of the core was not made; what pip said stands above")
        (wheel,) = Path(folder).glob("leapray-*.whl")
        return moved(wheel)


def make_extension():
    """The extension for Blender in dist/, with the core's wheel inside; returns its path.

    The tool that Blender ships is asked to check and to build; it leaves out
    wheels that do not fit without a word, so the contents are looked at too.
    """
    wheel = make_wheel()
    import importlib.util

    blender = Path(importlib.util.find_spec("bpy").origin).parent
    (tool,) = blender.glob("*/scripts/addons_core/bl_pkg/cli/blender_ext.py")
    with tempfile.TemporaryDirectory() as folder:
        source, made = Path(folder, "leapray"), Path(folder, "made")
        shutil.copytree(ROOT / "addon", source, ignore=shutil.ignore_patterns("__pycache__"))
        shutil.copy(ROOT / "LICENSE", source)
        (source / "wheels").mkdir()
        shutil.copy(wheel, source / "wheels")
        made.mkdir()
        for task in (
            ["validate", str(source)],
            ["build", "--split-platforms", "--source-dir", str(source), "--output-dir", str(made)],
        ):
            done = subprocess.run([sys.executable, str(tool), *task], stdout=subprocess.PIPE)
            if done.returncode:
                print(done.stdout.decode(), file=sys.stderr)
                raise Refusal("Blender's own tool refuses the extension; what it said stands above")
        (archive,) = made.glob("*.zip")
        names = zipfile.ZipFile(archive).namelist()
        if f"wheels/{wheel.name}" not in names:
            raise Refusal(f"{archive.name} lacks wheels/{wheel.name}; does the manifest name it?")
        return moved(archive)


def moved(path):
    """Put a finished file into dist/, whole or not at all; returns where it is."""
    target = ROOT / "dist" / path.name
    target.parent.mkdir(exist_ok=True)
    beside = target.with_suffix(f".{os.getpid()}")
    shutil.copyfile(path, beside)
    return beside.replace(target)


def work(environment, verb, words):
    """Do what the verb says; returns the exit code."""
    build_core()
    if verb in ("build", "package"):
        if words:
            raise Refusal(f"{verb} takes no further words, but got {' '.join(words)}")
        print(make_wheel() if verb == "build" else make_extension())
        return 0
    see_that_blender_loads(environment)
    if verb == "test":
        test(words)
    from addon import cli

    return cli.main([verb, *words])


def main(words):
    choice = None
    if words[:1] == ["--python"]:
        choice, words = "".join(words[1:2]), words[2:]
    verb = words[0] if words else ""
    if verb in ("", "-h", "--help", "help"):
        print(__doc__.split("\n", 2)[2].rsplit("\n\n", 1)[0])
        return 0 if verb else 2
    if verb not in VERBS:
        raise Refusal(f"no verb {verb}; there are {', '.join(VERBS)}")
    environment = Environment(this_version())
    if choice or not environment.running():
        enter(choice, words)
    return work(environment, verb, words[1:])


if __name__ == "__main__":
    try:
        sys.exit(main(sys.argv[1:]))
    except Refusal as refusal:
        say(str(refusal))
        sys.exit(1)
    except KeyboardInterrupt:
        say("interrupted")
        sys.exit(130)
