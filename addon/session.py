# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender driven from outside: open a file, choose what is written, render a frame.

Used by the command line and by the studies; what Blender prints to standard
output meanwhile is kept from it.
"""

from __future__ import annotations

import atexit
import contextlib
import os
import shutil
import signal
import sys
import threading
import time
from collections.abc import Collection, Iterator
from pathlib import Path

import leapray
from leapray import LeapRayError


def check_file(path: Path) -> None:
    """Raise LeapRayError where there is no file to read."""
    if not path.is_file():
        raise LeapRayError(f"{path} is a folder" if path.is_dir() else f"There is no file {path}")


def open_scene(path: Path):
    """Open a .blend, with LeapRay registered and chosen; returns its scene."""
    check_file(path)
    import bpy

    if not hasattr(bpy.types.Scene, "leapray"):
        from . import register, unregister

        register()
        atexit.register(unregister)  # Blender's module crashes at exit over classes it still has
    try:
        with quiet():
            bpy.ops.wm.open_mainfile(filepath=str(path.absolute()), load_ui=False)
    except RuntimeError as error:
        raise LeapRayError(f"{path} cannot be opened: {first_line(error)}") from error
    scene = bpy.context.scene
    scene.render.engine = "LEAPRAY"
    return scene


def set_format(scene, picture: Path, passes: Collection[str] | None = None) -> None:
    """Have Blender write this file: PNG, or 32 bit EXR with passes of all view layers.

    passes: by the core's names; all of them where None.
    """
    from . import result

    settings = scene.render.image_settings
    several = picture.suffix == ".exr"
    if hasattr(settings, "media_type"):  # from 5.0 on
        settings.media_type = "MULTI_LAYER_IMAGE" if several else "IMAGE"
    settings.file_format = "OPEN_EXR_MULTILAYER" if several else "PNG"
    if several:
        settings.color_depth = "32"
        for layer in scene.view_layers:
            for each in result.PASSES:
                if each.switch:
                    asked = passes is None or each.name in passes
                    setattr(each.owner(layer), each.switch, asked)
    else:
        settings.color_mode = "RGBA" if scene.render.film_transparent else "RGB"
    path = str(picture.absolute())
    scene.render.filepath = path.replace("{", "{{").replace("}", "}}")  # braces are templates
    scene.render.use_sequencer = False


def render_frame(scene) -> dict[str, dict]:
    """Render and save the current frame; returns the report of each view layer.

    Raises the engine's own LeapRayError, or KeyboardInterrupt where it was stopped.
    """
    import bpy

    from . import engine

    handlers = bpy.app.handlers.render_stats
    progress = Progress(sys.stderr)
    handlers.append(progress)
    engine.reports.clear()
    engine.failures.clear()
    refusal = None
    try:
        with quiet(), interruptible(engine.interrupt):
            bpy.ops.render.render(write_still=True, scene=scene.name)
    except RuntimeError as error:
        refusal = LeapRayError(first_line(error))
    finally:
        handlers.remove(progress)
        progress.end()
    failure = next(iter(engine.failures.values()), refusal)  # Blender knows less of what happened
    if isinstance(failure, leapray.Stopped):
        raise KeyboardInterrupt
    if failure is not None:
        raise failure
    return dict(engine.reports)


class Progress:
    """A handler of Blender's render statistics: one line that changes, or now and then a line."""

    def __init__(self, stream) -> None:
        self.stream, self.terminal, self.said = stream, stream.isatty(), time.monotonic()

    def __call__(self, text, *_) -> None:
        now = time.monotonic()
        if isinstance(text, str) and now - self.said > (0.1 if self.terminal else 10.0):
            self.said = now
            words = text.strip().removeprefix("| ")
            line = f"\r\x1b[K{words}" if self.terminal else f"{words}\n"
            print(line, end="", file=self.stream, flush=True)

    def end(self) -> None:
        if self.terminal:
            print("\r\x1b[K", end="", file=self.stream, flush=True)


def first_line(error: RuntimeError) -> str:
    """What an operator of Blender says in its exception, without its frills."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    wanted = [line for line in lines if line.startswith("Error:")] or lines
    return wanted[0].removeprefix("Error:").strip() if wanted else "Blender does not say why"


@contextlib.contextmanager
def interruptible(event: threading.Event) -> Iterator[None]:
    """Have the first Ctrl-C set event, which ends the work inside, then raise KeyboardInterrupt.

    What is raised in a callback of Blender's, Blender prints and forgets. The
    second Ctrl-C is raised at once. Where Python does not listen to Ctrl-C, and
    on other threads, nothing changes.
    """
    event.clear()
    on_main_thread = threading.current_thread() is threading.main_thread()
    if not on_main_thread or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return

    def heard(*_) -> None:
        event.set()
        signal.signal(signal.SIGINT, signal.default_int_handler)

    signal.signal(signal.SIGINT, heard)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        if event.is_set():
            event.clear()
            raise KeyboardInterrupt


@contextlib.contextmanager
def interrupt_ends_process(folder: Path) -> Iterator[None]:
    """Have Ctrl-C end the process while Blender is deaf inside; folder goes if it is a .part.

    Python hears signals between its own commands, so not before a call into Blender
    has returned; another engine's render may take an hour. Exit code 130. Where
    Python does not listen to Ctrl-C, and on other threads, nothing changes.
    """
    on_main_thread = threading.current_thread() is threading.main_thread()
    if not on_main_thread or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    reader, writer = os.pipe()
    os.set_blocking(writer, False)

    def listen() -> None:
        if os.read(reader, 1) == bytes([signal.SIGINT]):  # else the other end was closed
            if folder.suffix == ".part":
                shutil.rmtree(folder, ignore_errors=True)
            print("leapray: interrupted", file=sys.stderr, flush=True)
            os._exit(130)

    listener = threading.Thread(target=listen, daemon=True)
    before = signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
    listener.start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(before)
        os.close(writer)
        listener.join()
        os.close(reader)


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Keep what Blender prints from standard output."""
    sys.stdout.flush()
    saved, nowhere = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.close(nowhere)
    try:
        yield
    finally:
        sys.stdout.flush()
        os.dup2(saved, 1)
        os.close(saved)
