"""End of the `bake.py` process: at once, with its exit status, without unfinished files.

Blender can neither be interrupted nor exited in the usual way. An exception from a signal handler crashes Blender, or
appears as the error of an operator. If anything still refers to bpy when Python ends, Blender does not stop its
threads, and the process waits for them forever. A driver with a failed expression does so. Therefore no handler raises:
the module removes unfinished files, and `os._exit` ends the process.

A separate thread answers signals, because C code may block the main thread for long. The main thread waits as soon as
it runs Python again.

This module imports little, so a program can answer signals from its first lines.
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
"""Signals that end the process. The exit status is 128 plus the signal's number: 130 and 143."""

_TEMPORARY = "leafcloud-bake-"
"""Start of the names of temporary folders."""

unfinished: list[Callable[[], None]] = []
"""Functions that remove unfinished files and folders when the process ends."""

_ending = threading.Lock()
_stepping = False
_finished = False
_guard: int | None = None


def answer_signals(words: str) -> None:
    """End the process on each of `SIGNALS` from now on, with `words` as a line on standard error.

    An ignored signal stays ignored. Call this in the main thread.
    """
    receiver, sender = os.pipe()
    os.set_blocking(sender, False)
    console = os.dup(2)  # The present standard error. It may be redirected later.

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
    """Keep signals from ending the process during the block. Use it in the main thread, without nesting."""
    global _stepping
    _stepping = True  # Set before taking the lock and until its release: the handler must not wait meanwhile.
    try:
        with _ending:
            yield
    finally:
        _stepping = False


def finish() -> None:
    """Ignore later signals, because the work is done. Call this within a step."""
    global _finished
    _finished = True


def open_closed_streams() -> None:
    """Open standard input, output and error as the null device where they are closed.

    Otherwise other files would get their numbers, and the texts that are printed. Call this before any file is opened.
    """
    for number, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # The system gives the smallest free number.
        if getattr(sys, name) is None:
            setattr(sys, name, open(number, mode, encoding="utf-8", closefd=False))  # noqa: SIM115


def tell_commits(guard: int) -> None:
    """Tell of commits through a pipe to the guard of this process: see `guard`."""
    global _guard
    _guard = guard


def commit() -> None:
    """Tell the guard that files are replaced from now on, so that it kills this process no more."""
    if _guard is not None:
        with suppress(OSError):
            os.write(_guard, b".")


def own_temporary_folder() -> None:
    """Move the temporary files of Python and Blender to a folder that is removed at the end. Raise `OSError`.

    Removes the folders of processes that were killed.
    """
    import shutil
    import tempfile
    from pathlib import Path

    from .locked_folders import locked_folder

    with step():
        tempfile.gettempdir()  # Tries a file with a random name in the folder: no later bake would remove it.
    remove_left_behind()
    with step():
        own, _ = locked_folder(Path(tempfile.gettempdir()), _TEMPORARY)
        unfinished.append(lambda: shutil.rmtree(own))
    tempfile.tempdir = str(own)
    os.environ.update(dict.fromkeys(("TMPDIR", "TEMP", "TMP"), str(own)))


def remove_left_behind() -> None:
    """Remove the temporary folders of processes that were killed. Raise `OSError` without a folder for such files."""
    import shutil
    import tempfile
    from pathlib import Path

    from .locked_folders import left_behind

    for folder in left_behind(Path(tempfile.gettempdir()), _TEMPORARY):
        shutil.rmtree(folder, ignore_errors=True)


def leave(status: int) -> NoReturn:
    """End the process with the exit status `status`."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError):  # The reader has closed the stream.
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
    """Remove Blender's own temporary folder. If Blender started before us, it lies elsewhere and is empty."""
    os.rmdir(sys.modules["_bpy"].app.tempdir)
