"""How a bake in a process of its own ends: at once, with its status, and with nothing unfinished left behind.

Blender can neither be interrupted nor left in the usual way. An exception that a signal's handler raises crashes it, or
comes out of an operator as an error of that operator. And where anything still refers to bpy when Python ends, as a
driver does whose expression failed, Blender does not stop its threads, and the process waits for them for ever. So
nothing is raised: unfinished files are removed, and `os._exit` ends the process.

A thread does so for signals, for C code may keep the main thread for long; that one waits as soon as it runs Python.

This module imports little, so that a program can answer signals from its first lines on.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import NoReturn

SIGNALS = (signal.SIGINT, signal.SIGTERM)
"""The exit status that answers each is 128 more than its number: 130 and 143."""

unfinished: list[Callable[[], None]] = []
"""What removes things that are not to outlive the process unless they are finished."""

_ending = threading.Lock()
_stepping = False
_finished = False


def answer_signals(words: str) -> None:
    """From here on each of `SIGNALS` ends the process, with `words` as a line on standard error.

    A signal that is ignored stays so. For the main thread.
    """
    receiver, sender = os.pipe()
    os.set_blocking(sender, False)
    console = os.dup(2)  # Standard error, wherever that is turned later on.

    def answer() -> None:
        while True:
            [number] = os.read(receiver, 1)
            with _ending:
                if number in SIGNALS and not _finished:
                    _end(128 + number, lambda: os.write(console, f"{words}\n".encode()))

    def wait_for_answer(*_: object) -> None:
        while not (_stepping or _finished):
            time.sleep(1.0)

    threading.Thread(target=answer, name="leafcloud signals", daemon=True).start()
    signal.set_wakeup_fd(sender, warn_on_full_buffer=False)
    for number in SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, wait_for_answer)


@contextmanager
def step() -> Iterator[None]:
    """For the time of the block no signal ends the process. For the main thread; no step is within another."""
    global _stepping
    _stepping = True  # Before the lock is taken, until it is free again: the handler must not wait while it is held.
    try:
        with _ending:
            yield
    finally:
        _stepping = False


def finish() -> None:
    """Let later signals change nothing: the work is done. Call this within a step."""
    global _finished
    _finished = True


def own_temporary_folder() -> None:
    """Has Python and Blender keep their temporary files in a folder that goes with the process. Raises `OSError`."""
    import shutil
    import tempfile

    with step():
        folder = tempfile.mkdtemp(prefix="leafcloud-")
        unfinished.append(lambda: shutil.rmtree(folder))
    tempfile.tempdir = folder
    os.environ.update(dict.fromkeys(("TMPDIR", "TEMP", "TMP"), folder))


def leave(status: int) -> NoReturn:
    """Ends the process."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError):  # Nobody reads it any more.
            stream.flush()
    with step():
        _end(status)


def _end(status: int, tell: Callable[[], object] = lambda: None) -> NoReturn:
    try:
        for act in (*reversed(unfinished), _remove_session_folder, tell):
            with suppress(Exception):
                act()
    finally:
        os._exit(status)


def _remove_session_folder() -> None:
    """Blender's own temporary folder, which lies elsewhere if Blender was there before us, and is empty then."""
    os.rmdir(sys.modules["_bpy"].app.tempdir)
