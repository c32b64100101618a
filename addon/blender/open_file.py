# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender driven from outside: open a file, choose what is written, render a frame.

Used by the command line and by the studies; what Blender prints to standard
output meanwhile is kept from it.
"""

from __future__ import annotations

import contextlib
import os
import sys
import time
from collections.abc import Collection, Iterator
from pathlib import Path

import leapray
from leapray import LeapRayError

from ..process import interruptible
from ..store.files import check_file, finite


def open_scene(path: Path):
    """Open a .blend, with LeapRay registered and chosen; returns its scene."""
    check_file(path)
    import bpy

    be_registered()
    try:
        with quiet():
            bpy.ops.wm.open_mainfile(filepath=str(path.absolute()), load_ui=False)
    except RuntimeError as error:
        raise LeapRayError(f"{path} cannot be opened: {first_line(error)}") from error
    scene = bpy.context.scene
    scene.render.engine = "LEAPRAY"
    return scene


def be_registered() -> None:
    """Register LeapRay, if that has not been done."""
    import bpy

    if not hasattr(bpy.types.Scene, "leapray"):
        from .. import register

        register()


def empty_scene() -> None:
    """A new file with nothing in its scene, and LeapRay chosen."""
    import bpy

    be_registered()
    with quiet():  # reading factory settings would disable the extension
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.context.scene.render.engine = "LEAPRAY"


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


def render_frame(scene, lead: str = "", pixel: tuple[int, int] | None = None) -> dict[str, dict]:
    """Render and save the current frame; returns the report of each view layer.

    lead: what stands before the words of progress. pixel: the only one to render, from the
    picture's lower left corner; then no picture is saved.

    Raises the engine's own LeapRayError, or KeyboardInterrupt where it was stopped.
    """
    import bpy

    from . import engine

    handlers = bpy.app.handlers.render_stats
    progress = Progress(sys.stderr, lead)
    handlers.append(progress)
    engine.reports.clear()
    engine.failures.clear()
    engine.pixel = pixel
    refusal = None
    try:
        with quiet(), interruptible(engine.interrupt):
            bpy.ops.render.render(write_still=pixel is None, scene=scene.name)
    except RuntimeError as error:
        refusal = LeapRayError(first_line(error))
    finally:
        engine.pixel = None
        handlers.remove(progress)
        progress.end()
    failure = next(iter(engine.failures.values()), refusal)  # Blender knows less of what happened
    if isinstance(failure, leapray.Stopped):
        raise KeyboardInterrupt
    if failure is not None:
        raise failure
    return finite(engine.reports)


class Progress:
    """A handler of Blender's render statistics: one line that changes, or now and then a line."""

    def __init__(self, stream, lead: str = "") -> None:
        self.stream, self.lead = stream, lead
        self.terminal, self.said = stream.isatty(), time.monotonic()

    def __call__(self, text, *_) -> None:
        now = time.monotonic()
        if isinstance(text, str) and now - self.said > (0.1 if self.terminal else 10.0):
            self.said = now
            words = self.lead + text.strip().removeprefix("| ")
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
