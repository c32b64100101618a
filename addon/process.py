# SPDX-License-Identifier: GPL-3.0-or-later
"""How a process of the command line ends: with its work, or by a signal at any moment (no bpy).

Exceptions do not do for signals here: what is raised while Blender loads or in one of its
callbacks is printed and forgotten, and Python hears nothing before a call into Blender has
returned. So the handler ends the process itself, and where the main thread does not get
to run it, another thread does. Only a render that can be cancelled is given a moment to end.

The process leaves by os._exit: Blender's module may hang or crash while it is unloaded.
"""

from __future__ import annotations

import contextlib
import os
import select
import shutil
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NoReturn

SENTENCES: dict[int, str] = {
    signal.SIGINT: "interrupted",
    signal.SIGTERM: "terminated",
    signal.SIGHUP: "ended, for its terminal was closed",
}
PATIENCE = 0.2  # seconds for the main thread to hear a signal itself
GRACE = 1.5  # seconds for a cancelled render to end
POLL = 0.03  # seconds between two looks at whether a render is cancelled

temporary_folders: set[Path] = set()  # removed where a signal ends the process

_ending = threading.RLock()  # taken for good by who ends the process
_cancel: threading.Event | None = None  # ends the work that is under way
_listening = False
_heard = 0  # the first signal
_deferred = 0  # how many blocks want no signal now


def run(main: Callable[[list[str]], int], argv: list[str]) -> NoReturn:
    """Do the work and end the process with its exit code; a signal ends it with 128 + its number.

    main may raise KeyboardInterrupt, which is what `interruptible` makes of a signal.
    """
    listen()
    try:
        code = main(argv)
    except KeyboardInterrupt:
        end_by_signal()
    except BaseException:
        traceback.print_exc()
        code = 1
    leave(code)


def leave(code: int) -> NoReturn:
    """End the process without unloading Blender's module."""
    _ending.acquire()
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError, AttributeError):
            stream.flush()
    _remove_folder_of_blender()
    os._exit(code)


def end_by_signal(number: int = 0) -> NoReturn:
    """Remove what is not complete, say one sentence and end the process; 0: by what was heard."""
    number = number or _heard or signal.SIGINT
    _ending.acquire()  # reentrant, for a second signal may come on the same thread
    for folder in list(temporary_folders):
        shutil.rmtree(folder, ignore_errors=True)
    _remove_folder_of_blender()
    with contextlib.suppress(OSError):
        before = "\r\x1b[K" if os.isatty(2) else ""  # instead of the line of progress
        os.write(2, f"{before}leapray: {SENTENCES[number]}\n".encode())
    os._exit(128 + number)


def _remove_folder_of_blender() -> None:
    """Remove Blender's temporary folder, as it would itself."""
    modules = (sys.modules.get(name) for name in ("bpy", "_bpy"))  # the second is there sooner
    apps = (getattr(module, "app", None) for module in modules)
    folder = next((Path(app.tempdir) for app in apps if app is not None), Path())
    if folder.name.startswith("blender_"):  # else it is the system's own
        shutil.rmtree(folder, ignore_errors=True)


# ---- signals ---------------------------------------------------------------


def listen() -> None:
    """Have SIGINT, SIGTERM and SIGHUP end the process from now on, but those that it ignores."""
    global _listening
    if _listening or threading.current_thread() is not threading.main_thread():
        return
    _listening = True
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
    threading.Thread(target=_watch, args=(reader,), daemon=True).start()
    for number in SENTENCES:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _hear)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, SENTENCES)


def _hear(number: int, _frame) -> None:
    """What a signal does on the main thread, when that gets to it."""
    global _heard
    again, _heard = _heard, _heard or number
    if _deferred and not again:
        return
    if _cancel is None or again:
        end_by_signal(_heard)
    _cancel.set()


def _watch(reader: int) -> None:
    """End the process where the main thread does not, after the first signal or at the second."""
    number = 0
    while number not in SENTENCES:
        number = os.read(reader, 1)[0]
    select.select([reader], [], [], PATIENCE if _cancel is None else GRACE)
    end_by_signal(number)


@contextlib.contextmanager
def signals_deferred() -> Iterator[None]:
    """Let a first signal wait until the block, which must be short, has ended."""
    global _deferred
    _deferred += 1
    try:
        yield
    finally:
        _deferred -= 1
        if _heard and not _deferred and _cancel is None:
            end_by_signal(_heard)


@contextlib.contextmanager
def interruptible(event: threading.Event) -> Iterator[None]:
    """Have the first signal set event, which ends the work inside, then raise KeyboardInterrupt.

    In a process that does not `listen`, the signal is Ctrl-C, the second one is raised at
    once, and nothing changes on other threads and where Python does not hear Ctrl-C.
    """
    global _cancel
    event.clear()
    if _listening:
        _cancel = event
        try:
            yield
        finally:
            _cancel = None
            if event.is_set():
                event.clear()
                raise KeyboardInterrupt
        return
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
