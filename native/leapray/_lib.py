# SPDX-License-Identifier: GPL-3.0-or-later
"""The compiled core: found, checked and declared once; its errors as exceptions.

Calls into `lib` release the interpreter lock, so any number of Python threads
may trace at once. A C call is deaf to Ctrl-C; long ones therefore go through
`call`, which lets a worker run them while the main thread listens.
"""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol, TypeVar

from . import _abi

T = TypeVar("T")


class LeapRayError(Exception):
    """What the core refused, in one sentence."""


class Stopped(LeapRayError):
    """The call ended early because its watch was told to stop."""


class OutOfMemory(LeapRayError):
    """The system, or the budget, has no room for what was asked.

    Where `voxelize` refuses for its budget, the attribute nbytes is the estimate.
    """

    nbytes: int | None = None  # that are needed, where that is known


EXCEPTIONS: dict[int, type[LeapRayError]] = {
    _abi.LR_E_STOPPED: Stopped,
    _abi.LR_E_MEMORY: OutOfMemory,
}


def load(path: Path) -> ctypes.CDLL:
    """The core at path with its prototypes declared.

    Raises ImportError, in one sentence, where it is missing, does not load, or
    is of another version than this package.
    """
    try:
        library = ctypes.CDLL(str(path))
    except OSError as error:
        missing = "is missing; `python3 build.py build` makes it"
        reason = f"does not load: {error}" if path.exists() else missing
        raise ImportError(f"LeapRay's core {path} {reason}") from error
    library.lr_version.restype = ctypes.c_char_p
    abi, version = library.lr_abi(), library.lr_version().decode()
    if (abi, version) != (_abi.LR_ABI, _abi.LR_VERSION):
        raise ImportError(
            f"LeapRay's core {path} is version {version} (ABI {abi}), but this package needs "
            f"version {_abi.LR_VERSION} (ABI {_abi.LR_ABI}); install the two together"
        )
    for name, (result, arguments) in _abi.PROTOTYPES.items():
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    return library


lib = load(Path(__file__).with_name("libleapray.so"))


def check(status: int, error: _abi.lr_error) -> None:
    """Raise what a status other than LR_OK stands for, with the core's sentence."""
    if status != _abi.LR_OK:
        sentence = error.text.decode("utf-8", "replace") or f"the core failed with status {status}"
        raise EXCEPTIONS.get(status, LeapRayError)(sentence)


class CancelToken(Protocol):
    """What a C call reads to end early: a Watch, or what shares the stop word of one."""

    @property
    def pointer(self) -> Any:
        """To an lr_watch, for C."""

    @property
    def stop(self) -> Callable[[], None]:
        """Sets the stop word."""


class Watch:
    """A stop word and a progress word that C calls read and write; usable from any thread."""

    def __init__(self) -> None:
        self._stop = ctypes.c_int32(0)
        self._progress = ctypes.c_double(0.0)
        self._words = _abi.lr_watch(ctypes.pointer(self._stop), ctypes.pointer(self._progress))
        self.pointer = ctypes.pointer(self._words)  # for C, as long as the watch lives

    def stop(self) -> None:
        """Ask the calls that were given this watch to end, within 100 ms, by Stopped."""
        self._stop.value = 1

    @property
    def stopped(self) -> bool:
        """Whether `stop` was called."""
        return bool(self._stop.value)

    @property
    def progress(self) -> float:
        """The share of the work that is done, 0..1."""
        return self._progress.value

    def advance(self, share: float) -> None:
        """Say what share of the work is done, 0..1, where the work is not the core's."""
        self._progress.value = share


def call(function, *arguments, watch: CancelToken | None = None, outputs: tuple = ()) -> None:
    """Call function(*arguments, watch, &outputs..., error), raise what it reports, hear Ctrl-C.

    On the main thread the call runs in a worker: KeyboardInterrupt sets the
    stop word, and is raised again as soon as the call has ended.
    """
    watch = watch or Watch()
    error = _abi.lr_error()
    tail = (watch.pointer, *map(ctypes.byref, outputs), ctypes.byref(error))
    check(apart(lambda: function(*arguments, *tail), watch), error)


def apart(work: Callable[[], T], watch: CancelToken) -> T:
    """work() on a thread of its own where this is the main one, which alone hears Ctrl-C.

    KeyboardInterrupt sets the stop word and is raised again once work has ended: what work
    uses must live until then. It may come at any call here, within the thread's start too.
    """
    if threading.current_thread() is not threading.main_thread():
        return work()
    claim, ended = threading.Lock(), threading.Event()
    result: list[T] = []
    failure: list[BaseException] = []

    def run() -> None:
        if not claim.acquire(blocking=False):
            return  # nobody waits for it
        try:
            result.append(work())
        except BaseException as raised:
            failure.append(raised)
        finally:
            ended.set()

    worker = threading.Thread(target=run, name="leapray-call")
    interrupt = None
    try:
        worker.start()
    except BaseException as raised:
        if claim.acquire(blocking=False):
            raise  # before anything ran
        watch.stop()
        interrupt = raised
    while True:
        try:
            ended.wait()
            break
        except BaseException as raised:
            watch.stop()
            interrupt = raised
    worker.join()
    if interrupt is not None:
        raise interrupt
    if failure:
        raise failure[0]
    return result[0]
