"""Files that appear in a folder together: written beside it all, moved in when every one is whole."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from .. import ending


class Staging:
    """A hidden folder in `directory` that gathers files until `commit` moves them up, over older ones of their names.

    Left without a commit, `directory` is as it was before: folders that were made for it are gone again.
    Raises `OSError` when `directory` cannot be made or written to, or holds a folder that has a file's name.
    """

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        self._made: list[Path] = []
        self._folder: Path | None = None
        self._files: list[str] = []

    def __enter__(self) -> Self:
        with ending.step():
            try:
                for folder in reversed([self._directory, *self._directory.parents]):
                    if not folder.is_dir():
                        folder.mkdir()
                        self._made.append(folder)
                self._folder = Path(tempfile.mkdtemp(prefix=".leafcloud-", dir=self._directory))
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
        """The names given out so far."""
        return tuple(self._files)

    def path(self, name: str) -> Path:
        """Where to write the file that is to be called `name`."""
        if self._folder is None:
            raise RuntimeError("a staging folder gives out paths only within its `with` block")
        target = self._directory / name
        if target.is_dir():
            raise IsADirectoryError(f"{target} is a folder, a file of that name has to be written")
        self._files.append(name)
        return self._folder / name

    def write_json(self, name: str, content: Any) -> None:
        """Writes `content` as the file `name`; numbers that JSON does not know are refused with `ValueError`."""
        text = json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False)
        self.path(name).write_text(text + "\n", encoding="utf-8", newline="\n")

    def commit(self) -> None:
        """Moves the files to where they belong. Raises `FileNotFoundError`, and moves none, where one is missing."""
        assert self._folder is not None
        with ending.step():
            for name in self._files:
                (self._folder / name).stat()
            for name in self._files:
                os.replace(self._folder / name, self._directory / name)
            self._made.clear()
            ending.finish()

    def _clean(self) -> None:
        if self._folder is not None:
            # Renamed first: Blender may be writing there still when the process ends, and would add files.
            shutil.rmtree(self._folder.rename(f"{self._folder}-removed"))
            self._folder = None
        for folder in reversed(self._made):
            folder.rmdir()
        self._made.clear()
