"""Folder writes that are all or nothing: a hidden folder gathers the files until all are complete."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Collection
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from .. import ending


class Staging:
    """A hidden folder in `directory` that gathers files until `commit` moves them up and replaces older ones.

    Without a commit `directory` does not change, and folders created for it are removed again.
    Raises `OSError` if `directory` cannot be created or written to, or has a folder with a file's name.
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
            for name in self._files:
                os.replace(self._folder / name, self._directory / name)
            for name in set(earlier) - set(self._files):
                (self._directory / name).unlink(missing_ok=True)
            self._made.clear()
            ending.finish()

    def _clean(self) -> None:
        if self._folder is not None:
            # Renamed first: Blender may still be writing here when the process ends, and would add files.
            shutil.rmtree(self._folder.rename(f"{self._folder}-removed"))
            self._folder = None
        for folder in reversed(self._made):
            folder.rmdir()
        self._made.clear()
