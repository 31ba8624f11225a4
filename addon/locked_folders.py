"""Folders that a process locks as long as it lives, so that the next process can tell those that are left behind."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows has no such locks.
    fcntl = None  # type: ignore[assignment]

_SURELY_DEAD = 24.0 * 3600.0
"""Seconds after which a folder counts as left behind where no lock can tell."""


def left_behind(directory: Path, prefix: str) -> Iterator[Path]:
    """Yield the folders of `locked_folder` in `directory` that ended processes left, each locked for its turn."""
    for folder in directory.glob(f"{prefix}*"):
        with suppress(OSError), _lock_of(folder) as lock:
            if folder.is_symlink() or not folder.is_dir():
                continue
            if lock is not None or time.time() - folder.stat().st_mtime > _SURELY_DEAD:
                yield folder


def locked_folder(directory: Path, prefix: str) -> tuple[Path, int | None]:
    """Make a folder in `directory` with a name that begins with `prefix`. Return it with its lock, a file descriptor;
    None where the system has no locks. The process keeps the lock until it closes the descriptor, or ends.

    Raises `OSError` if the folder cannot be made.
    """
    while True:
        folder = Path(tempfile.mkdtemp(prefix=prefix, dir=directory))
        # Between the line above and the lock another process may take the folder for a dead one's.
        with suppress(BlockingIOError), _lock_of(folder) as lock:
            if folder.is_dir():
                return folder, None if lock is None else os.dup(lock)


@contextmanager
def _lock_of(folder: Path) -> Iterator[int | None]:
    """Lock the folder while the block runs, or longer if the block duplicates the descriptor.

    Yields None where the system has no such locks. Raises `BlockingIOError` if another process has the lock.
    """
    if fcntl is None:
        yield None
        return
    try:
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    except (FileNotFoundError, NotADirectoryError):
        yield None
        return
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise
        except OSError:  # A network drive without locks.
            yield None
            return
        yield descriptor
    finally:
        os.close(descriptor)
