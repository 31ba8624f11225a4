"""The command `leafcloud-batch`."""

from __future__ import annotations

import argparse
import json
import os
import shlex
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from threading import Event
from types import FrameType
from typing import TextIO

from tqdm import tqdm

from .. import LeafcloudError
from ..command import aligned
from .process import Limits
from .run import RECORD, Batch, Row, run, write_whole
from .sheet import sheet
from .trees import SUFFIXES, Tree, find_trees

_USAGE = "leafcloud-batch TREE … --out DIR [options] [-- flags of bake.py]"
_DESCRIPTION = f"""Bake many trees, each in a process of its own. A tree that fails does not stop the others. A tree
that is baked already, from the same files with the same flags and version, is skipped, so a batch that was stopped goes
on where it was. Exit status: 0 if all trees are baked, 1 if any failed, 2 after a wrong command line, 130 after an
interrupt. TREE: a file ({", ".join(SUFFIXES)}), or a folder with such files. DIR gets a folder for each tree,
index.html with all of them in pictures, and {RECORD}."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit status."""
    _open_closed_streams()
    given = list(sys.argv[1:] if arguments is None else arguments)
    end = given.index("--") if "--" in given else len(given)
    options = _parser().parse_args(given[:end])
    try:
        trees = find_trees(options.trees, options.out)
        batch = _batch(options, given[end + 1 :])
        batch.out.mkdir(parents=True, exist_ok=True)
    except LeafcloudError as error:
        _print(f"leafcloud-batch: {error}", sys.stderr)
        return 2
    except OSError as error:
        _print(f"leafcloud-batch: {error.filename}: {error.strerror}; choose another --out", sys.stderr)
        return 1
    stop = Event()
    with _stopping(stop) as signals, tqdm(total=len(trees), unit="tree", disable=None) as bar:

        def tell(row: Row) -> None:
            with suppress(OSError), bar.external_write_mode(file=sys.stderr):
                _print(_line(row), sys.stderr)
                bar.update()

        try:
            rows = _rows(options.scheduler, trees, batch, stop, tell)
        except LeafcloudError as error:
            _print(f"leafcloud-batch: {error}", sys.stderr)
            return 1
    wrong = next((row for row in rows if row.outcome.wrong_flags), None)
    if wrong is not None:
        _print(f"leafcloud-batch: the flags behind -- are wrong: {wrong.outcome.reason}", sys.stderr)
        return 2
    try:
        _write(rows, batch.out)
    except OSError as error:
        _print(f"leafcloud-batch: {batch.out}: {error.strerror or error}; make room there", sys.stderr)
        return 1
    failed = [row for row in rows if not row.outcome.done]
    _print("\n".join(_table(rows)), sys.stdout)
    if signals:
        _print(f"leafcloud-batch: stopped; {len(trees) - len(rows) + len(failed)} trees are left", sys.stderr)
        return 128 + signals[0]
    _print(f"{len(rows) - len(failed)} of {len(rows)} trees are baked: {batch.out / 'index.html'}", sys.stdout)
    return 1 if failed else 0


def _open_closed_streams() -> None:
    """Open the null device in place of closed streams, so that no other file gets their numbers, 0 to 2."""
    while (number := os.open(os.devnull, os.O_RDWR)) <= 2:
        pass
    os.close(number)
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115


def _print(text: str, file: TextIO) -> None:
    """Print a text, unless nobody can read it: the results and the exit status do not depend on that."""
    try:
        print(text, file=file, flush=True)
    except OSError:
        # Python would print the rest of the text when it ends, and fail again.
        with suppress(OSError, ValueError), open(os.devnull, "wb") as nothing:
            os.dup2(nothing.fileno(), file.fileno())


def _rows(
    scheduler: str | None, trees: Sequence[Tree], batch: Batch, stop: Event, tell: Callable[[Row], None]
) -> list[Row]:
    """Run the batch on this machine, or on the workers of a scheduler. Raise `LeafcloudError` if none answers."""
    if scheduler is None:
        return run(trees, batch, stop, tell)
    try:
        from .cluster import run_on
    except ImportError as error:
        raise LeafcloudError("--scheduler needs Dask: pip install 'leafcloud[cluster]'") from error
    return run_on(scheduler, trees, batch, stop, tell)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="leafcloud-batch", usage=_USAGE, description=_DESCRIPTION)
    parser.add_argument("trees", nargs="+", type=Path, metavar="TREE", help="files and folders")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the results")
    parser.add_argument(
        "--processes", type=int, default=max((os.cpu_count() or 1) // 2, 1), metavar="N", help="bakes at once"
    )
    parser.add_argument("--minutes", type=float, default=60.0, metavar="M", help="most time for a tree (default: 60)")
    parser.add_argument(
        "--memory",
        type=float,
        metavar="GIB",
        help="most memory for a tree (default: all of its machine, shared among the bakes there)",
    )
    parser.add_argument(
        "--bake",
        metavar="COMMAND",
        help="command that runs bake.py, such as 'blender -b --python bake.py --' (default: the bake.py beside this "
        "environment, with its Python)",
    )
    parser.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="bake on the workers of the Dask scheduler there, such as tcp://10.0.0.1:8786, in place of --processes",
    )
    parser.add_argument("--again", action="store_true", help="bake trees that are done, too")
    return parser


def _batch(options: argparse.Namespace, flags: Sequence[str]) -> Batch:
    """Return the settings. Raise `LeafcloudError` for values that are out of range."""
    own = [flag for flag in flags if flag.partition("=")[0] in ("--input", "--out", "--plan-only")]
    if own:
        raise LeafcloudError(f"{own[0]} is set for each tree by the batch: leave it out")
    for name in ("processes", "minutes", "memory"):
        value = getattr(options, name)
        if value is not None and not value > 0:
            raise LeafcloudError(f"--{name} is {value}; it must be above 0")
    command = tuple(shlex.split(options.bake)) if options.bake else _usual_command()
    limits = Limits(60.0 * options.minutes, None if options.memory is None else int(options.memory * 2**30))
    if options.scheduler is None:
        limits = limits.shared_among(options.processes)
    return Batch(options.out.resolve(), command, tuple(flags), limits, options.processes, options.again)


def _usual_command() -> tuple[str, ...]:
    """Return the command of the repository that holds this environment. Raise `LeafcloudError` without one."""
    program = Path(sys.prefix).parent / "bake.py"
    if not program.is_file():
        raise LeafcloudError(f"{program} does not exist: name bake.py with --bake 'blender -b --python …/bake.py --'")
    return sys.executable, str(program)


@contextmanager
def _stopping(stop: Event) -> Iterator[list[int]]:
    """Set `stop` on a signal that ends programs, while the block runs. Yield the numbers of the signals."""
    seen: list[int] = []

    def answer(number: int, _: FrameType | None) -> None:
        seen.append(number)
        stop.set()

    names = (signal.SIGINT, signal.SIGTERM)
    before = {name: signal.signal(name, answer) for name in names if signal.getsignal(name) is not signal.SIG_IGN}
    try:
        yield seen
    finally:
        for name, handler in before.items():
            signal.signal(name, handler)


def _line(row: Row) -> str:
    state = "unchanged" if row.skipped else "baked" if row.outcome.done else f"failed: {row.outcome.reason}"
    return f"{row.tree.name}: {state}" + ("" if row.skipped else f" ({row.outcome.seconds:.1f} s)")


def _table(rows: Sequence[Row]) -> list[str]:
    def cells(row: Row) -> tuple[str, ...]:
        levels = (
            ""
            if row.report is None
            else f"{max(len(tree['levels']) for tree in row.report.get('trees', [row.report]))}"
        )
        figures = (f"{row.outcome.seconds:.1f}", f"{row.outcome.memory / 2**20:,.0f}")
        notes = row.outcome.reason or ("unchanged" if row.skipped else "; ".join(row.outcome.warnings))
        return (row.tree.name, levels, *figures, notes)

    return aligned(("tree", "levels", "seconds", "MiB", ""), [cells(row) for row in rows])


def _write(rows: Sequence[Row], out: Path) -> None:
    """Write the contact sheet and the record of all rows."""
    told = [
        {"tree": row.tree.name, "file": str(row.tree.file), "skipped": row.skipped, **asdict(row.outcome)}
        for row in rows
    ]
    write_whole(out / RECORD, json.dumps(told, indent=2))
    write_whole(out / "index.html", sheet(rows, out.name))


if __name__ == "__main__":
    sys.exit(main())
