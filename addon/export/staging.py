"""Folder writes that are all or nothing, also if the process is killed at any moment.

A hidden folder beside the files gathers them until all are complete. A list in it, renamed into place, then decides:
the files will be moved. Each move replaces one file at once. A process that is killed before the list leaves the old
files, and one that is killed behind it some old and some new ones. The next process that writes into the folder removes
the rest of the first, and moves the remaining files of the second; `locked_folders` tells their folders from those of
living processes.
"""

from __future__ import annotations

import errno
import json
import os
import shutil
from collections.abc import Collection
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from .. import ending
from ..locked_folders import left_behind, locked_folder

_PREFIX = ".leafcloud-"
_REMOVED = "-removed"
_LIST = "leafcloud-commit.json"
"""Name of the list of the files to move and of those to remove."""


class Staging:
    """A hidden folder in `directory` that gathers files until `commit` moves them up and replaces older ones.

    Without a commit `directory` does not change, and folders created for it are removed again. Completes or removes
    what killed processes left behind in `directory`.
    Raises `OSError` if `directory` cannot be created or written to, or has a folder with a file's name.
    """

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        self._made: list[Path] = []
        self._folder: Path | None = None
        self._lock: int | None = None
        self._files: list[str] = []

    def __enter__(self) -> Self:
        with ending.step():
            try:
                for folder in reversed([self._directory, *self._directory.parents]):
                    if not folder.is_dir():
                        folder.mkdir()
                        self._made.append(folder)
                recover(self._directory)
                self._folder, self._lock = locked_folder(self._directory, _PREFIX)
            except OSError:
                self._clean()
                raise
            ending.unfinished.append(self._clean)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with ending.step():
            ending.unfinished.remove(self._clean)
            self._clean()

    @property
    def files(self) -> tuple[str, ...]:
        """The names of the files so far."""
        return tuple(self._files)

    def path(self, name: str) -> Path:
        """Return the path at which to write the file `name`."""
        if self._folder is None:
            raise RuntimeError("a staging folder has paths only inside its `with` block")
        target = self._directory / name
        if target.is_dir():
            raise IsADirectoryError(f"cannot write the file {target}: a folder has that name; move or rename it")
        self._files.append(name)
        return self._folder / name

    def write_json(self, name: str, content: Any) -> None:
        """Write `content` as the file `name`. Raises `ValueError` for numbers that JSON lacks, such as NaN."""
        text = json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False)
        self.path(name).write_text(text + "\n", encoding="utf-8", newline="\n")

    def commit(self, earlier: Collection[str] = ()) -> None:
        """Move all files into the directory, and remove those of `earlier` that this commit does not replace.

        Raises `FileNotFoundError`, and changes nothing, if a file is missing.
        """
        assert self._folder is not None
        with ending.step():
            for name in self._files:
                (self._folder / name).stat()
            ending.commit()
            _decide(self._folder, self._files, sorted(set(earlier) - set(self._files)))
            self._made.clear()
            try:
                _move(self._folder, self._directory)
            except OSError:
                self._folder = None  # It stays for the next process, which moves the rest.
                raise
            ending.finish()

    def _clean(self) -> None:
        if self._folder is not None:
            _remove(self._folder)
            self._folder = None
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None
        for folder in reversed(self._made):
            folder.rmdir()
        self._made.clear()


def _decide(folder: Path, files: list[str], removed: list[str]) -> None:
    """Make the commit final: from now on the files will be moved, by this process or by the next."""
    written = folder / f"{_LIST}.new"
    written.write_text(json.dumps({"files": files, "removed": removed}), encoding="utf-8")
    os.replace(written, folder / _LIST)


def _move(folder: Path, directory: Path) -> None:
    """Move the files of a final commit that are still in its folder."""
    decided = json.loads((folder / _LIST).read_text(encoding="utf-8"))
    files, removed = (list(map(_plain_name, decided[key])) for key in ("files", "removed"))
    for name in files:
        if (folder / name).exists():  # Else it was moved before.
            os.replace(folder / name, directory / name)
    if not all((directory / name).exists() for name in files):
        raise FileNotFoundError(errno.ENOENT, "a file has vanished while it was moved", str(directory))
    for name in removed:
        (directory / name).unlink(missing_ok=True)


def _plain_name(name: str) -> str:
    """Return the name of a file beside the list. Raise `ValueError` for a path: the list may be a foreign one."""
    if Path(name).name != name:
        raise ValueError(f"{name!r} is no name of a file")
    return name


def recover(directory: Path) -> bool:
    """Complete the commits, and remove the unfinished files, of processes that are dead.

    Returns whether it completed a commit.
    """
    completed = False
    for folder in left_behind(directory, _PREFIX):
        with suppress(OSError, ValueError, KeyError, TypeError):
            if (folder / _LIST).is_file() and not folder.name.endswith(_REMOVED):
                _move(folder, directory)
                completed = True
            _remove(folder)
    return completed


def _remove(folder: Path) -> None:
    # Renamed first: Blender may still be writing here when the process ends, and would add files.
    shutil.rmtree(folder.rename(f"{folder}{_REMOVED}"))
