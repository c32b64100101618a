# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs inside Blender: code that arrives as files in a folder, between Blender's own events.

The folder is the last word of the command line. N.py is run on the main thread,
in a namespace that stays; N.json then holds {"result": ...} or {"error": traceback}.
"""

import json
import sys
import time
import traceback
from pathlib import Path

import bpy

MAIL = Path(sys.argv[-1])
view = bpy.context.preferences.view
view.show_splash = False
view.render_display_type = "SCREEN"  # there is no window manager to place a second window

events = []  # (time, what) of every render; "idle" once its job is over
stats = [""]  # what the engine said last about its progress
handlers = bpy.app.handlers


def noted(what):
    """A handler that notes when it was called."""
    return handlers.persistent(lambda *_: events.append((time.time(), what)))


for name in ("render_init", "render_complete", "render_cancel"):
    getattr(handlers, name).append(noted(name))


@handlers.persistent
def note_stats(text, *_):
    stats[0] = str(text)


handlers.render_stats.append(note_stats)
names = {"bpy": bpy, "events": events, "stats": stats}


def answer() -> float:
    ended = events and events[-1][1] in ("render_complete", "render_cancel")
    if ended and not bpy.app.is_job_running("RENDER"):
        events.append((time.time(), "idle"))
    for question in sorted(MAIL.glob("*.py")):
        if question.name == Path(__file__).name:
            continue
        names["result"] = None
        try:
            exec(compile(question.read_text(), question.name, "exec"), names)
            said = {"result": names["result"]}
        except BaseException:
            said = {"error": traceback.format_exc()}
        question.unlink()
        beside = question.with_suffix(".part")
        beside.write_text(json.dumps(said))
        beside.rename(question.with_suffix(".json"))
    return 0.01


bpy.app.timers.register(answer, persistent=True)
