# SPDX-License-Identifier: GPL-3.0-or-later
"""LeapRay, a Blender render engine for volumes.

Blender is imported only when the add-on registers, so that the modules which
do not need it can be used without.
"""

import atexit
import importlib

SCRIPTED = {"engine": ".blender.engine", "session": ".blender.open_file"}


def __getattr__(name: str):
    """What scripts import from the add-on itself: the engine with its reports, and the session."""
    if name in SCRIPTED:
        return importlib.import_module(SCRIPTED[name], __package__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def register() -> None:
    """Make the engine, its settings, panels and command known to Blender."""
    import bpy

    from . import cli
    from .blender import engine, operators, properties, ui

    for part in (properties, engine, operators, ui, cli):
        part.register()
    if getattr(bpy.app, "module", False):  # it crashes as it is unloaded with classes of ours
        atexit.register(unregister)


def unregister() -> None:
    from . import cli
    from .blender import engine, operators, properties, ui

    atexit.unregister(unregister)
    for part in (cli, ui, operators, engine, properties):
        part.unregister()
