"""All bakes of a batch. A tree that is baked already, from the same files with the same settings, is skipped."""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import suppress
from dataclasses import asdict, dataclass
from importlib.util import find_spec
from pathlib import Path
from threading import Event
from typing import Any

from .. import __version__
from .process import Limits, Outcome, bake
from .trees import Tree, key_of

RECORD = "batch.json"
"""The file beside a tree's report with the key of its bake, and the file beside all trees with all rows."""


@dataclass(frozen=True)
class Batch:
    """Settings of a batch.

    out: the folder of the results; each tree has a folder there. command: starts `bake.py`. flags: of each bake.
    processes: at once, ≥ 1. again: bake trees that are done, too.
    """

    out: Path
    command: tuple[str, ...]
    flags: tuple[str, ...]
    limits: Limits
    processes: int = 1
    again: bool = False


@dataclass(frozen=True)
class Row:
    """A tree and the end of its bake. `skipped`: baked by an earlier batch. report: the content of its report.json."""

    tree: Tree
    outcome: Outcome
    skipped: bool
    report: dict[str, Any] | None


def run(trees: Sequence[Tree], batch: Batch, stop: Event, tell: Callable[[Row], None]) -> list[Row]:
    """Bake all trees, and return their rows in the same order. `tell` gets each row as soon as its bake ends.

    After `stop` is set no further bake begins; the trees that are left out have no row. Wrong flags set it.
    """
    program = version_of(batch.command)
    rows: dict[Tree, Row] = {}
    with ThreadPoolExecutor(batch.processes) as pool:
        jobs = [pool.submit(_row, tree, batch, program, stop) for tree in trees]
        try:
            for job in as_completed(jobs):
                row = job.result()
                if row is not None:
                    rows[row.tree] = row
                    if row.outcome.wrong_flags:
                        stop.set()
                    tell(row)
        except BaseException:
            stop.set()
            raise
    return [rows[tree] for tree in trees if tree in rows]


def _row(tree: Tree, batch: Batch, program: str, stop: Event) -> Row | None:
    if stop.is_set():
        return None
    begun = begin(tree, batch, program)
    if isinstance(begun, Row):
        return begun
    folder = batch.out / tree.name
    before = forget(folder)
    outcome = bake(batch.command, tree.file, folder, batch.flags, batch.limits, stop)
    if outcome.unchanged and before is not None:
        write_whole(folder / RECORD, before)
    return end(tree, batch, begun, outcome)


def begin(tree: Tree, batch: Batch, program: str) -> Row | str:
    """Return the row of a tree that is baked already or cannot be read, or else the key for its bake."""
    try:
        key = key_of(tree, batch.flags, program)
    except OSError as error:
        return Row(tree, Outcome(f"{error.filename or tree.file}: {error.strerror or error}", 0.0, 0), False, None)
    folder = batch.out / tree.name
    known = None if batch.again else _done_before(folder, key)
    return key if known is None else Row(tree, known, True, report_in(folder))


def forget(folder: Path) -> str | None:
    """Remove the record of an earlier bake, because the folder may soon have files of two. Return its text, if any."""
    try:
        text = (folder / RECORD).read_text(encoding="utf-8").rstrip("\n")
        (folder / RECORD).unlink()
    except (OSError, ValueError):
        return None
    return text


def end(tree: Tree, batch: Batch, key: str, outcome: Outcome) -> Row:
    """Return the row of a tree after its bake, and remember a success in its folder."""
    folder = batch.out / tree.name
    if not outcome.done:
        return Row(tree, outcome, False, None)
    report = report_in(folder)
    try:
        sizes = _sizes(folder, report)
    except OSError as error:
        reason = f"{folder}: {error.strerror or error}; something removed a result, bake the tree again"
        return Row(tree, Outcome(reason, 0.0, 0), False, None)
    try:
        record = {"key": key, "bytes": sizes, **asdict(outcome)}
        write_whole(folder / RECORD, json.dumps(record, indent=2))
    except OSError as error:
        return Row(tree, Outcome(f"{folder}: {error.strerror or error}; make room there", 0.0, 0), False, None)
    return Row(tree, outcome, False, report)


def _done_before(folder: Path, key: str) -> Outcome | None:
    """Return how an earlier bake with this key ended, if all of its files are there with their sizes."""
    try:
        record = json.loads((folder / RECORD).read_text(encoding="utf-8"))
        sizes = _sizes(folder, report_in(folder))
        if record.pop("key") != key or not sizes or record.pop("bytes") != sizes:
            return None
        return Outcome(**{**record, "warnings": tuple(record["warnings"])})
    except (OSError, ValueError, TypeError, KeyError, AttributeError):
        return None


def _sizes(folder: Path, report: dict[str, Any] | None) -> dict[str, int]:
    """Return the bytes of each file that a report names. Raises `OSError` for a missing one."""
    return {} if report is None else {name: (folder / name).stat().st_size for name in report["files"]}


def report_in(folder: Path) -> dict[str, Any] | None:
    try:
        report = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return report if isinstance(report, dict) else None


def version_of(command: Sequence[str]) -> str:
    """Return a version of all code of a bake: of this package, and of the add-on beside the command's `bake.py`.

    A Blender that the command names counts by its name only.
    """
    native = find_spec("leafcloud._native")
    assert native, "this package has imported it"
    assert native.origin
    digest = hashlib.sha256(Path(native.origin).read_bytes())
    programs = [Path(each) for each in command if each.endswith("bake.py")]
    for program in programs:
        for file in [program, *sorted((program.parent / "addon").rglob("*.py"))]:
            digest.update(str(file.relative_to(program.parent)).encode())
            with suppress(OSError):
                digest.update(file.read_bytes())
    return f"{__version__} {' '.join(command)} {digest.hexdigest()}"


def write_whole(path: Path, text: str) -> None:
    """Write a file so that a reader sees the old one or the new one, whole. Raises `OSError`."""
    handle, name = tempfile.mkstemp(prefix=".leafcloud-", dir=path.parent)
    try:
        with open(handle, "w", encoding="utf-8", newline="\n") as file:
            file.write(text + "\n")
        os.replace(name, path)
    except BaseException:
        with suppress(OSError):
            os.unlink(name)
        raise
