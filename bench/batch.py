"""Times batches of bakes: `make bench-batch`.

usage: make bench-batch ARGS='[TREE.glb …]'      (default: six trees of ../shared/foliage)

The trees are baked one by one with `bake.py`, then by `leafcloud-batch` with one and with two processes, then by three
workers of a Dask scheduler on this machine. All bakes have the same settings; a bake uses all cores by itself. Then the
same batch is run again, with nothing to do. Writes docs/bench/batch.md. Exit status 1 if a batch exceeds the overhead.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
FOLIAGE = ROOT.parent / "shared" / "foliage"
TREES = ("shrub", "oak_cards_11k", "maple_13k", "pine_cards_20k", "bush_ash_5k", "shapespark_tree1")
WORKERS = 3
LIBRARY = 100_000
MOST_OVERHEAD = 10
"""Limit on the overhead, in percent. Above it the exit status is 1."""

INTRODUCTION = """# Batches

Made by `make bench-batch`: {count} trees, baked one by one, and by `leafcloud-batch`. *Overhead*: over the sum of
single bakes; limit {limit} %. A bake uses all cores by itself, so more processes help only where a part of it cannot.

"""
ON_PAPER = """
## 100,000 trees, on paper

From the figures above: {seconds:.1f} s and {megabytes:.1f} MB of results a tree, on a machine with {cores} cores.

| workers, as this machine | hours |
|---|---|
{hours}

- Storage: {storage:.2f} TB. Each tree has a folder with about a dozen files: 1.2 million files.
- At most two trees a worker are on their way, so the scheduler's memory does not grow with the library. All bytes pass
  the machine that runs `leafcloud-batch`: {rate:.1f} MB/s with 100 workers. With more workers its network is the first
  to break, at 125 MB/s for 1 Gbit/s.
- The summary and the contact sheet are one table and one page for all trees. Pictures load as one scrolls, but 100,000
  of them make a browser slow: bake a library of that size in parts, a folder each.
- `--minutes` and `--memory` set aside what would hold a worker for ever; `batch.json` lists it with its reason.
"""


def timed(*command: object) -> float:
    begin = time.monotonic()
    subprocess.run([str(each) for each in command], check=True, capture_output=True)
    return time.monotonic() - begin


def batch(trees: list[Path], out: Path, *more: object) -> float:
    return timed(sys.executable, "-m", "leafcloud.batch.command", *trees, "--out", out, *more)


@contextmanager
def cluster(folder: Path) -> Iterator[str]:
    """Run a scheduler and its workers while the block runs. Yield its address."""
    tool = (sys.executable, "-m", "dask")
    log = folder / "scheduler.log"
    started = []
    with log.open("w") as file:

        def start(*arguments: str) -> None:
            started.append(subprocess.Popen([*tool, *arguments], stdout=file, stderr=file, start_new_session=True))

        start("scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard")
        address = waited(log, r"Scheduler at:\s+(tcp://127\.0\.0\.1:\d+)")
        flags = ("--nworkers", str(WORKERS), "--nthreads", "1", "--host", "127.0.0.1", "--no-dashboard")
        start("worker", address, *flags, "--local-directory", str(folder))
        waited(log, rf"(?s)((?:Register worker.*?){{{WORKERS}}})")
        try:
            yield address
        finally:
            for process in reversed(started):
                os.killpg(process.pid, signal.SIGTERM)
                process.wait(30)


def waited(log: Path, pattern: str) -> str:
    for _ in range(600):
        if match := re.search(pattern, log.read_text()):
            return match[1]
        time.sleep(0.1)
    raise SystemExit(f"no Dask: {log.read_text()}")


def too_slow(rows: Sequence[tuple[str, float]], single: float) -> list[str]:
    """Return a sentence for each row of seconds that exceeds those of single bakes by more than the limit."""
    over = [(name, 100.0 * (seconds / single - 1.0)) for name, seconds in rows]
    return [f"{name}: {more:+.1f} %, limit {MOST_OVERHEAD} %" for name, more in over if more > MOST_OVERHEAD]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("trees", nargs="*", type=Path)
    usual = [ROOT / "examples" / f"{TREES[0]}.glb", *(FOLIAGE / f"{name}.glb" for name in TREES[1:])]
    trees = parser.parse_args().trees or [tree for tree in usual if tree.is_file()]
    scratch = Path(tempfile.mkdtemp(prefix="batches-"))
    bakes = [
        (sys.executable, ROOT / "bake.py", "--input", tree, "--out", scratch / "one" / tree.stem) for tree in trees
    ]
    single = sum(timed(*command) for command in bakes)
    rows = [("one by one", single)]
    for processes in (1, 2):
        rows.append((f"{processes} at once", batch(trees, scratch / str(processes), "--processes", processes)))
    with cluster(scratch) as address:
        rows.append((f"{WORKERS} Dask workers", batch(trees, scratch / "dask", "--scheduler", address)))
    rows.append(("again, unchanged", batch(trees, scratch / "1", "--processes", 1)))
    size = sum(file.stat().st_size for file in (scratch / "1").rglob("*") if file.is_file()) / 1e6 / len(trees)
    shutil.rmtree(scratch)
    lines = ["| bakes | seconds | trees an hour | overhead |", "|---|---|---|---|"]
    lines += [
        f"| {name} | {seconds:.1f} | {3600.0 * len(trees) / seconds:,.0f} | {100.0 * (seconds / single - 1.0):+.0f} % |"
        for name, seconds in rows
    ]
    best = min(seconds for _, seconds in rows[:-1]) / len(trees)
    hours = "\n".join(f"| {n} | {LIBRARY * best / 3600.0 / n:,.1f} |" for n in (1, 10, 100))
    paper = ON_PAPER.format(
        seconds=best,
        megabytes=size,
        cores=os.cpu_count(),
        hours=hours,
        storage=LIBRARY * size / 1e6,
        rate=100.0 * size / best,
    )
    text = INTRODUCTION.format(count=len(trees), limit=MOST_OVERHEAD) + "\n".join(lines) + "\n" + paper
    print(text)
    (ROOT / "docs" / "bench" / "batch.md").write_text(text)
    broken = too_slow(rows, single)
    print("".join(f"{line}\n" for line in broken), end="", file=sys.stderr)
    return int(bool(broken))


if __name__ == "__main__":
    sys.exit(main())
