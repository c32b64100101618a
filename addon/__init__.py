# SPDX-License-Identifier: GPL-3.0-or-later
"""LeapRay, a Blender render engine for volumes.

Blender is imported only when the add-on registers, so that the modules which
do not need it can be used without.
"""

import atexit


def register() -> None:
    """Make the engine, its settings, panels and command known to Blender."""
    import bpy

    from . import cli, engine, operators, properties, ui

    for part in (properties, engine, operators, ui, cli):
        part.register()
    if getattr(bpy.app, "module", False):  # it crashes as it is unloaded with classes of ours
        atexit.register(unregister)


def unregister() -> None:
    from . import cli, engine, operators, properties, ui

    atexit.unregister(unregister)
    for part in (cli, ui, operators, engine, properties):
        part.unregister()
