"""One bake in a process of its own, within limits of time and memory. Whatever happens to it, the batch goes on."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from threading import Event
from typing import IO

import psutil

try:
    import fcntl
except ImportError:  # Windows has no such locks.
    fcntl = None  # type: ignore[assignment]

_LOOK_SECONDS = 0.2
"""Time between two looks at a process."""
_PATIENCE = 10.0
"""Seconds for a bake to clean up after it is asked to end."""
_MOST_LOG = 2**16
_STAGING = ".leafcloud-*"
"""Folders in which `bake.py` gathers its files: left behind only by a process that was killed."""
_COMMIT = "leafcloud-commit.json"
"""The list that such a folder has once its files are complete."""


@dataclass(frozen=True)
class Limits:
    """Limits of one bake: seconds > 0, and bytes of memory > 0 with all processes that it starts.

    memory: None for a share of the memory of the machine (`shared_among`).
    """

    seconds: float
    memory: int | None

    def shared_among(self, processes: int) -> Limits:
        """Return the limits with a share of this machine's memory, if none is set."""
        return self if self.memory is not None else Limits(self.seconds, psutil.virtual_memory().total // processes)


@dataclass(frozen=True)
class Outcome:
    """The end of a bake. `reason`: why it failed, one line; empty after a success.

    seconds, memory: of the process, the latter in bytes, as seen every fifth of a second.
    """

    reason: str
    seconds: float
    memory: int
    warnings: tuple[str, ...] = ()
    status: int | None = None
    """Exit status of the process, below 0 if a signal ended it; None if it did not run."""

    @property
    def done(self) -> bool:
        return not self.reason

    @property
    def wrong_flags(self) -> bool:
        """Whether `bake.py` refused its command line, as it will for every tree."""
        return self.status == 2

    @property
    def unchanged(self) -> bool:
        """Whether `bake.py` ended without a result, but was not killed in its midst: then it has changed no file."""
        return not self.done and self.status in (1, 2, 128 + signal.SIGTERM, -signal.SIGTERM)


def bake(command: Sequence[str], source: Path, out: Path, flags: Sequence[str], limits: Limits, stop: Event) -> Outcome:
    """Bake the file `source` into the folder `out`, which belongs to this bake alone.

    command: starts `bake.py`. stop: ends the bake when it is set.
    """
    begin = time.monotonic()
    most = 0
    with tempfile.TemporaryFile() as log:
        try:
            process = subprocess.Popen(
                [*command, "--input", str(source), "--out", str(out), *flags],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=log,
                start_new_session=True,
            )
        except OSError as error:
            return Outcome(f"{command[0]} cannot be started: {error.strerror or error}", 0.0, 0)
        broken = ""
        while process.poll() is None:
            most = max(most, _memory_of(process.pid))
            broken = _broken_limit(time.monotonic() - begin, most, limits, stop)
            if broken:
                _end(process)
                break
            with suppress(subprocess.TimeoutExpired):
                process.wait(_LOOK_SECONDS)
        lines = _last_lines(log)
    _remove_unfinished(out)
    reason = broken or ("" if process.returncode == 0 else _reason(process.returncode, lines))
    warnings = tuple(line.partition("warning: ")[2] for line in lines if line.startswith("bake.py: warning: "))
    return Outcome(reason, time.monotonic() - begin, most, warnings, process.returncode)


def _remove_unfinished(out: Path) -> None:
    """Remove the folders of a killed bake, but keep one with complete files: the next bake moves them."""
    for folder in out.glob(_STAGING):
        if not (folder / _COMMIT).exists() and not _is_locked(folder):
            shutil.rmtree(folder, ignore_errors=True)


def _is_locked(folder: Path) -> bool:
    """Return whether a living bake has locked its folder, such as one that another batch runs."""
    if fcntl is None:
        return False
    try:
        descriptor = os.open(folder, os.O_RDONLY)
    except OSError:
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:  # A network drive without locks.
        return False
    finally:
        os.close(descriptor)
    return False


def _broken_limit(seconds: float, memory: int, limits: Limits, stop: Event) -> str:
    """Return why the bake must end now; empty if it may go on."""
    if stop.is_set():
        return "stopped"
    if seconds > limits.seconds:
        return f"not done after {limits.seconds / 60:.3g} minutes: raise --minutes, or bake coarser"
    if limits.memory is not None and memory > limits.memory:
        return f"more than {limits.memory / 2**30:.3g} GiB of memory: raise --memory, or run fewer --processes"
    return ""


def _memory_of(number: int) -> int:
    """Return the bytes of a process and of all that it started."""
    total = 0
    with suppress(psutil.Error):
        process = psutil.Process(number)
        for each in (process, *process.children(recursive=True)):
            with suppress(psutil.Error):
                total += int(each.memory_info().rss)
    return total


def _end(process: subprocess.Popen[bytes]) -> None:
    """End a process and all that it started: asked first, so that it removes unfinished files, then killed."""
    started: list[psutil.Process] = []
    with suppress(psutil.Error):
        started = psutil.Process(process.pid).children(recursive=True)
    process.terminate()
    try:
        process.wait(_PATIENCE)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    for each in started:
        with suppress(psutil.Error):
            each.kill()
    psutil.wait_procs(started, _PATIENCE)


def _last_lines(log: IO[bytes]) -> list[str]:
    size = log.seek(0, os.SEEK_END)
    log.seek(max(size - _MOST_LOG, 0))
    return [line.strip() for line in log.read().decode(errors="replace").splitlines() if line.strip()]


def _reason(status: int, lines: Sequence[str]) -> str:
    """Return why a process ended with a status other than 0: its last line, or the signal."""
    if status < 0:
        with suppress(ValueError):
            return f"ended by {signal.Signals(-status).name}: the system or another program killed it, or it crashed"
    told = [line for line in lines if not line.startswith(("bake.py: note:", "bake.py: warning:")) and line[-1] != "…"]
    return told[-1].removeprefix("bake.py: ") if told else f"exit status {status} without a message"
