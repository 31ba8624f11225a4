"""Guard of the `bake.py` process: the bake runs in a child process, and whatever happens to it ends in one line.

A hostile file may crash Blender, or fill the memory while Blender keeps Python's lock, so that no other code runs. The
guard loads nothing else. It passes signals on and ends with the exit status of the bake. It kills a bake that is
over a limit, and tells of one that crashed: in one line, with status 1, without unfinished files. If the guard is
killed, the system kills the bake.

Only Linux has a guard, and not where Blender runs `bake.py`, because Blender has opened the scene before.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from . import ending

_LOOK_SECONDS = 0.02
"""Time between two looks at the bake. A bake fills some gigabytes of memory a second."""
_PATIENCE = 20.0
"""Seconds for the bake to answer a signal, or to go on without address space."""
_USABLE = 0.9
"""Share of the free memory that a bake may use by default."""
_BRINK = 2**20
"""Bytes of address space that Python asks for at once. With less, Python 3.11 may try again for ever."""
_DIE_WITH_PARENT = 1
"""PR_SET_PDEATHSIG of prctl(2)."""

is_guarded = False
"""Whether this process is a bake with a guard."""


@dataclass(frozen=True)
class Limits:
    """Limits of a bake: bytes of memory, seconds, bytes of address space, and the folder for its results. None: no
    limit, no folder."""

    memory: float | None
    seconds: float | None
    out: Path | None
    space: int | None


@contextmanager
def guarded(program: str, cancelled: str) -> Iterator[None]:
    """Go on in a guarded child process, if the system has guards. Hold signals back during the block.

    program: begins the guard's lines. cancelled: the line for a bake that a signal ends.
    """
    global is_guarded
    if sys.platform != "linux" or "bpy" in sys.modules:
        yield
        return
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    # Ignored signals stay ignored. If they were blocked, the guard would receive them.
    answered = {number for number in ending.SIGNALS if signal.getsignal(number) is not signal.SIG_IGN}
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {*answered, signal.SIGCHLD})
    receiver, sender = os.pipe()
    guard = _Guard(program, cancelled, receiver, _limits(arguments()))
    number = os.getpid()
    try:
        child = os.fork()
    except OSError:  # No process is left for the user: the bake runs without a guard.
        child = None
    if child:
        os.close(sender)
        status = 1
        try:
            status = guard.status(child, answered)
        finally:
            os._exit(status)
    if child is not None:
        is_guarded = True
        ending.tell_commits(sender)
        ctypes.CDLL(None).prctl(_DIE_WITH_PARENT, signal.SIGKILL)
        if os.getppid() != number:
            os._exit(1)
    os.close(receiver)
    yield
    signal.pthread_sigmask(signal.SIG_SETMASK, before)


def arguments() -> list[str]:
    """Return the program's arguments: those after `--` under Blender, all of them under Python."""
    given = sys.argv
    return given[given.index("--") + 1 :] if "--" in given else given[1:]


class _Guard:
    """A guard, made before the bake begins. It can read `commits` once the bake replaces files: then it must go on."""

    def __init__(self, program: str, cancelled: str, commits: int, limits: Limits) -> None:
        self._program, self._cancelled = program, cancelled
        self._commits, self._limits = commits, limits
        self._commits_now = False
        self._full_since: float | None = None
        self._missing = _missing(limits.out)
        self._child = 0

    def status(self, child: int, answered: set[signal.Signals]) -> int:
        """Wait for the end of the bake, and pass these signals on. Return the exit status."""
        self._child = child
        begin = time.monotonic()
        asked: tuple[int, float] | None = None
        os.set_blocking(self._commits, False)
        while True:
            got = signal.sigtimedwait({*answered, signal.SIGCHLD}, _LOOK_SECONDS)
            if got is not None and got.si_signo in answered:
                os.kill(self._child, got.si_signo)
                asked = asked or (got.si_signo, time.monotonic())
            ended, status = os.waitpid(self._child, os.WNOHANG)
            if ended:
                return self._ended(os.waitstatus_to_exitcode(status))
            if asked is not None and time.monotonic() - asked[1] > _PATIENCE and self._kill():
                return self._broken(self._cancelled, 128 + asked[0])
            reason = self._broken_limit(time.monotonic() - begin)
            if reason and self._kill():
                return self._broken(f"{self._program}: {reason}", 1)

    def _broken_limit(self, seconds: float) -> str:
        """Return why the bake must end now; empty if it may go on."""
        limits = self._limits
        if limits.seconds is not None and seconds > limits.seconds:
            return f"not done after {limits.seconds / 60:.3g} minutes: raise --minutes, or use a smaller tree"
        if limits.memory is not None and _memory_of(self._child) > limits.memory:
            remedy = "use a smaller tree, fewer modifiers and instances, or smaller textures, or raise --memory"
            return f"the bake needs more than {limits.memory / 2**30:.3g} GiB of memory: {remedy}"
        if limits.space is None or _space_of(self._child) + _BRINK <= limits.space:
            self._full_since = None
        elif self._full_since is None:
            self._full_since = seconds
        elif seconds - self._full_since > _PATIENCE:
            return f"the bake has used its {limits.space / 2**30:.3g} GiB of address space: raise the limit (ulimit -v)"
        return ""

    def _kill(self) -> bool:
        """Kill the bake, unless it replaces files. Return whether it is dead."""
        if self._has_begun_to_commit():
            return False
        os.kill(self._child, signal.SIGKILL)
        os.waitpid(self._child, 0)
        return True

    def _has_begun_to_commit(self) -> bool:
        """Return whether the bake has told that it replaces files."""
        with suppress(BlockingIOError):
            self._commits_now = self._commits_now or bool(os.read(self._commits, 1))
        return self._commits_now

    def _ended(self, status: int) -> int:
        if status >= 0:
            return status
        name = signal.Signals(-status).name
        reason = f"the bake crashed ({name}): save the file again in Blender, use a smaller tree, or free memory"
        if status == -signal.SIGKILL:
            reason = f"the system or another program killed the bake ({name}): free memory, or use a smaller tree"
        return self._broken(f"{self._program}: {reason}", 1)

    def _broken(self, line: str, status: int) -> int:
        """Remove what the dead bake left, and print a line. Return the status; 0 if its files were complete."""
        from .export.staging import recover

        with suppress(OSError):
            ending.remove_left_behind()
        # An earlier bake may have left a commit, too.
        if self._limits.out is not None and recover(self._limits.out) and self._has_begun_to_commit():
            return 0
        for folder in self._missing:
            with suppress(OSError):
                folder.rmdir()
        with suppress(OSError):
            os.write(2, f"{line}\n".encode())
        return status


def _limits(given: Sequence[str]) -> Limits:
    """Return the limits by the flags. The bake refuses wrong flags, so they count as missing here."""
    import argparse

    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False, exit_on_error=False)
    parser.add_argument("--memory", type=_above_zero)
    parser.add_argument("--minutes", type=_above_zero)
    parser.add_argument("--out", type=Path)
    try:
        options, _ = parser.parse_known_args(given)
    except argparse.ArgumentError:
        return Limits(None, None, None, _address_space())
    memory = _free_memory() if options.memory is None else options.memory * 2**30
    return Limits(memory, None if options.minutes is None else 60.0 * options.minutes, options.out, _address_space())


def _above_zero(text: str) -> float:
    value = float(text)
    if value <= 0.0:
        raise ValueError
    return value


def _missing(out: Path | None) -> list[Path]:
    """Return the folders that the bake will make, from the inner to the outer one."""
    with suppress(OSError, ValueError):
        return [] if out is None else [folder for folder in (out, *out.parents) if not folder.exists()]
    return []


def _address_space() -> int | None:
    """Return the bytes of address space that this process and its children may use; None for no limit."""
    import resource  # Other systems lack it.

    space, _ = resource.getrlimit(resource.RLIMIT_AS)
    return None if space == resource.RLIM_INFINITY else space


def _free_memory() -> float | None:
    """Return the bytes that a bake may use by default; None if the system does not tell."""
    free = _kilobytes("/proc/meminfo", ("MemAvailable:", "SwapFree:"))
    return _USABLE * 1024.0 * free if free else None


def _memory_of(process: int) -> int:
    """Return the bytes of a process in memory and in swap space; 0 if it has ended."""
    return 1024 * _kilobytes(f"/proc/{process}/status", ("VmRSS:", "VmSwap:"))


def _space_of(process: int) -> int:
    """Return the bytes of address space that a process uses; 0 if it has ended."""
    return 1024 * _kilobytes(f"/proc/{process}/status", ("VmSize:",))


def _kilobytes(path: str, names: tuple[str, ...]) -> int:
    """Return the sum of the named lines in a file of the system; 0 if it cannot be read."""
    try:
        with open(path, encoding="utf-8", errors="replace") as file:
            return sum(int(line.split()[1]) for line in file if line.startswith(names))
    except (OSError, ValueError, IndexError):
        return 0
