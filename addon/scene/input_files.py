"""Files that an input names, opened only if they are regular files in the input's folder.

A pipe or a device under a harmless name would block the bake, or fill the memory. A path that leaves the folder would
read files that have nothing to do with the tree.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from ..errors import SceneError

CHUNK = 1 << 20
"""Number of bytes read at a time."""

_EMPTY = 1 << 26
"""Number of unwritten bytes from which a file counts as sparse."""


def shown(value: object, longest: int = 60) -> str:
    """Return a value as text in one line of ASCII, shortened in the middle."""
    if isinstance(value, list | dict):
        return f"a list of {len(value)} entries" if isinstance(value, list) else "an object"
    text = str(value)
    half = (longest - 3) // 2
    escaped = ascii(text if len(text) <= longest else f"{text[:half]}...{text[-half:]}")
    return escaped if isinstance(value, str) else escaped[1:-1]


def file_in(home: Path, named: Path, user: str) -> Path:
    """Return a path without `..`, which must lie in the folder `home` (resolved). The file may be missing.

    `user`: the part of the input that names the file. Raises `SceneError` for a path that leaves the folder, also by a
    link, or that the system cannot have.
    """
    try:
        path = Path(os.path.normpath(named.absolute()))
        resolved = path.resolve()
    except (ValueError, OSError, RuntimeError) as error:
        raise SceneError(f"{user} names the file {shown(str(named))}, which is no path: rename the file") from error
    if not resolved.is_relative_to(home):
        raise SceneError(
            f"{user} names the file {shown(str(named))} outside of the folder {home}: copy the file into the folder"
        )
    return path


def exists(path: Path) -> bool:
    """Return whether anything is at a path. A path that the system cannot have counts as missing."""
    try:
        return path.exists()
    except (OSError, ValueError):
        return False


def check_regular(path: Path) -> int:
    """Return the size in bytes of a file. Raise `SceneError` for a pipe, a device, a folder, or a sparse file.

    Raises `OSError` for a missing file.
    """
    found = path.stat()
    if not stat.S_ISREG(found.st_mode):
        raise SceneError(f"{path} is {_kind(found.st_mode)}, not a file: put a file there")
    written = getattr(found, "st_blocks", found.st_size) * 512  # Windows does not count blocks.
    if found.st_size - written > _EMPTY and written < found.st_size / 16:
        raise SceneError(f"{path} is sparse: {written} of its {found.st_size} bytes were ever written; export it again")
    return found.st_size


@contextmanager
def opened(path: Path) -> Iterator[BinaryIO]:
    """Open a file that `check_regular` accepts. Raises as `check_regular` does."""
    check_regular(path)
    # Opening a pipe would wait for its writer, if a pipe has taken the file's place meanwhile.
    descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_BINARY", 0) | getattr(os, "O_NONBLOCK", 0))
    with open(descriptor, "rb") as file:
        yield file


def _kind(mode: int) -> str:
    if stat.S_ISDIR(mode):
        return "a folder"
    return "a pipe" if stat.S_ISFIFO(mode) else "a device"
