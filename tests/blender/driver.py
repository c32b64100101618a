# SPDX-License-Identifier: GPL-3.0-or-later
"""How the tests reach a Blender: by command, or in a window with keys pressed in it.

A Blender in a folder of its own (chroot) and one of the machine's look alike
here: `room` is a folder that both sides see, `inside` says what Blender calls
a path in it. Nothing of this checkout is on Blender's path: what runs there is
what the extension brought.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import shutil
import subprocess
import time
from pathlib import Path

import numpy as np
from debian import Unavailable
from PIL import Image

SESSION = Path(__file__).with_name("session.py")
TOOLS = ("Xvfb", "xdotool", "xwd", "convert")
SIZE = (1000, 640)  # pixels of the screen
KEYS = {"F12": "96", "Escape": "Escape"}  # by its name, xdotool finds F12 together with Alt


def pixels(path: Path) -> np.ndarray:
    """(h, w, 3) of a PNG, 0..255."""
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB")).astype(int)


# Not every root has the system's tools on its path.
CHROOT = shutil.which("chroot") or "/usr/sbin/chroot"


class Blender:
    """A Blender to test with: the executable as it is called under root, a folder to work in."""

    def __init__(self, root: Path, executable: str, room: Path) -> None:
        self.root, self.executable, self.room = root, executable, room
        room.mkdir(parents=True)
        self.environment = {
            "PATH": "/usr/local/bin:/usr/bin:/bin",
            "HOME": self.inside(room),
            "TMPDIR": self.inside(room),
            "BLENDER_USER_RESOURCES": self.inside(room / "user"),
            "LANG": "C.UTF-8",
            "LIBGL_ALWAYS_SOFTWARE": "1",
            "GALLIUM_DRIVER": "llvmpipe",
            "XDG_RUNTIME_DIR": self.inside(room),
        }

    def inside(self, path: Path) -> str:
        """The name of a path as Blender sees it."""
        return "/" + str(path.relative_to(self.root))

    def command(self, *words: str) -> list[str]:
        """A command line that runs on Blender's side."""
        chroot = [] if self.root == Path("/") else [CHROOT, str(self.root)]
        environment = (f"{name}={value}" for name, value in self.environment.items())
        return [*chroot, "/usr/bin/env", "-i", *environment, *words]

    def lacks(self, tools: tuple[str, ...]) -> list[str]:
        return [
            tool
            for tool in tools
            if not os.path.lexists(self.root / "usr/bin" / tool)  # links may be absolute
        ]

    def run(self, *words: str, timeout: float = 120) -> subprocess.CompletedProcess:
        """Run Blender with these words; standard output and error come together."""
        return subprocess.run(
            self.command(self.executable, *words),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=timeout,
        )

    def bring(self, path: Path) -> Path:
        """Copy a file into the room."""
        return Path(shutil.copy(path, self.room))


class Window:
    """A Blender with its window on a screen of its own (Xvfb), answering to code and to keys.

    Code goes in as files, which session.py runs on Blender's main thread between
    events; the variable `result` comes back. Keys are real events of the X server.
    """

    def __init__(self, blender: Blender) -> None:
        missing = blender.lacks(TOOLS)
        if missing:
            raise Unavailable(f"a window needs {', '.join(missing)}")
        self.blender = blender
        self.mail = blender.room / "mail"
        self.mail.mkdir()
        self.numbers = itertools.count()
        self.log = (blender.room / "window.log").open("w")
        self.display = self._screen()
        blender.environment["DISPLAY"] = self.display
        script = Path(shutil.copy(SESSION, self.mail))
        options = ["--gpu-backend", "opengl", "--window-geometry", "0", "0", *map(str, SIZE)]
        self.process = subprocess.Popen(
            blender.command(
                blender.executable,
                *options,
                "--python",
                blender.inside(script),
                "--",
                blender.inside(self.mail),
            ),
            stdin=subprocess.DEVNULL,
            stdout=self.log,
            stderr=subprocess.STDOUT,
        )
        try:
            self.run("result = True", timeout=90)
            (window,) = self.x("xdotool", "search", "--onlyvisible", "--class", "blender").split()
            self.x("xdotool", "windowfocus", window)  # there is no window manager to do it
            self.point(SIZE[0] // 3, SIZE[1] // 3)
        except BaseException:
            self.close()
            raise

    def _screen(self) -> str:
        """Start Xvfb on a display that is free, which it names itself."""
        out, into = os.pipe()
        size = "{}x{}x24".format(*SIZE)
        words = ["Xvfb", "-displayfd", str(into), "-screen", "0", size, "+extension", "GLX"]
        self.server = subprocess.Popen(
            self.blender.command(*words, "-nolisten", "tcp"),
            stdin=subprocess.DEVNULL,
            stdout=self.log,
            stderr=subprocess.STDOUT,
            pass_fds=[into],
        )
        os.close(into)
        with open(out) as answer:
            number = answer.readline().strip()
        if not number:
            raise Unavailable("Xvfb did not start")
        return f":{number}"

    def close(self) -> None:
        for process in (getattr(self, "process", None), self.server):
            if process is not None and process.poll() is None:
                process.terminate()
                with contextlib.suppress(subprocess.TimeoutExpired):
                    process.wait(10)
                process.kill()
                process.wait()
        self.log.close()

    def said(self) -> str:
        """All that Blender and the screen have printed."""
        return Path(self.log.name).read_text(errors="replace")

    # ---- code --------------------------------------------------------------

    def run(self, code: str, timeout: float = 60):
        """Run code in Blender; returns what it left in `result`. Raises with its traceback."""
        name = f"{next(self.numbers):06}"
        question, answer = self.mail / f"{name}.py", self.mail / f"{name}.json"
        beside = question.with_suffix(".part")
        beside.write_text(code)
        beside.rename(question)
        self.wait(answer.exists, timeout, f"no answer to {code!r}")
        said = json.loads(answer.read_text())
        if "error" in said:
            raise RuntimeError(said["error"])
        return said["result"]

    def wait(self, condition, timeout: float, complaint: str) -> None:
        """Wait until condition() holds and Blender lives."""
        end = time.monotonic() + timeout
        while not condition():
            if self.process.poll() is not None:
                raise RuntimeError(f"Blender ended: {self.said()[-2000:]}")
            if time.monotonic() > end:
                raise TimeoutError(f"{complaint} in {timeout} s")
            time.sleep(0.005)

    # ---- keys --------------------------------------------------------------

    def x(self, *words: str) -> str:
        """Run a client of the X server."""
        done = subprocess.run(self.blender.command(*words), capture_output=True, timeout=30)
        if done.returncode:
            raise RuntimeError(f"{words[0]}: {done.stderr.decode()}")
        return done.stdout.decode()

    def key(self, name: str) -> float:
        """Press and release a key where the pointer is; returns a time just before that."""
        before = time.time()
        self.x("xdotool", "key", KEYS[name])
        return before

    def point(self, x: int, y: int) -> None:
        """Move the pointer, a little at last, so that Blender notices."""
        self.x("xdotool", "mousemove", str(x - 3), str(y), "mousemove", str(x), str(y))

    def screenshot(self, path: Path) -> Path:
        """The whole screen as a PNG."""
        shot = self.blender.room / "shot"
        raw, png = (self.blender.inside(shot.with_suffix(s)) for s in (".xwd", ".png"))
        self.x("xwd", "-root", "-silent", "-out", raw)
        self.x("convert", f"xwd:{raw}", png)
        return Path(shutil.copy(shot.with_suffix(".png"), path))

    # ---- what the system says ------------------------------------------------

    def pid(self) -> int:
        """Blender's own process; chroot and env have become it."""
        return self.process.pid

    def status(self) -> dict[str, str]:
        lines = Path(f"/proc/{self.pid()}/status").read_text().splitlines()
        return {name: value.strip() for name, _, value in (line.partition(":") for line in lines)}

    def memory(self) -> int:
        """Bytes that are in memory."""
        return int(self.status()["VmRSS"].split()[0]) * 1024

    def threads(self) -> int:
        return int(self.status()["Threads"])
