"""Repeats work in one process and measures its resident memory: `make bench-soak`.

usage: make bench-soak ARGS='[--share 0.1]'      (default: every repetition)

The works: whole bakes of the small tree with all their files, and calls of the wheel (fits, chains, renders, draw
orders, KTX2 files) on small foliage. Prints a table in Markdown, and with all repetitions writes docs/bench/soak.md.
Ends with an error if the memory grows by more than `MOST_GROWTH` during any work.
"""

from __future__ import annotations

import argparse
import gc
import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import patch

ROOT = Path(__file__).resolve().parents[1]
# Blender reads and writes its configuration here, never in the user's own.
_RESOURCES = tempfile.TemporaryDirectory(prefix="leafcloud-soak-")
os.environ["BLENDER_USER_RESOURCES"] = _RESOURCES.name

import numpy as np  # noqa: E402
from commits import measured_commit  # noqa: E402
from numpy.typing import NDArray  # noqa: E402

import bake  # noqa: E402
import leafcloud  # noqa: E402
from addon.ending import leave  # noqa: E402

TREE = ROOT / "examples" / "shrub.glb"
QUICK = ("--texture-size", "64", "--levels", "1", "--epsilon", "0.2", "--every-level")
MOST_GROWTH = 50e6
"""Bytes that the resident memory may grow during any work after its warm-up."""
QUARTERS = 4

INTRODUCTION = """# Resident memory over many repetitions

Made by `make bench-soak` at {commit}, in one Python process with Blender as a module. MB of resident memory of the
process, after the warm-up and after each quarter of the repetitions. *Growth*: from the least of these to the end, at
most {most:.0f} MB. The memory may also shrink, because the system takes back pages of libraries that are not used.

"""


@dataclass(frozen=True)
class Work:
    """A function and its number of calls: those of the warm-up, which fill caches, and those that are measured."""

    call: Callable[[], object]
    times: int
    warm_up: int


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--share", type=float, default=1.0, help="fraction of the repetitions")
    share = parser.parse_args().share
    headings = ("work", "repetitions", "warm-up", "25 %", "50 %", "75 %", "end", "growth")
    rows: list[tuple[str, ...]] = [headings, ("---",) * len(headings)]
    grown = []
    with tempfile.TemporaryDirectory() as folder:
        for name, work in works(Path(folder)).items():
            times = max(round(share * work.times), QUARTERS)
            memory = list(resident_bytes_of(work, times))
            grown.append(memory[-1] - min(memory))
            rows.append((name, str(times), *(f"{each / 1e6:.1f}" for each in (*memory, grown[-1]))))
            print(" | ".join(rows[-1]), file=sys.stderr, flush=True)
    table = "\n".join(f"| {' | '.join(row)} |" for row in rows)
    print(table)
    if share == 1.0:
        text = INTRODUCTION.format(commit=measured_commit(), most=MOST_GROWTH / 1e6)
        (ROOT / "docs" / "bench" / "soak.md").write_text(f"{text}{table}\n", encoding="utf-8")
    if max(grown) > MOST_GROWTH:
        print(f"the memory grew by more than {MOST_GROWTH / 1e6:.0f} MB", file=sys.stderr)
    _RESOURCES.cleanup()
    leave(int(max(grown) > MOST_GROWTH))


def works(folder: Path) -> dict[str, Work]:
    """Return all works by name. `folder` is for their files."""
    foliage = leafcloud.Foliage(*squares(60))
    positions, triangles = squares(30)
    level = leafcloud.build_chain(foliage, levels=1, cross=False, texture_size=128).levels[0]
    assert isinstance(level, leafcloud.Level)
    return {
        "bakes with all files": Work(lambda: bake_into(folder), 200, 20),
        "fits": Work(lambda: leafcloud.fit(foliage), 1000, 50),
        "chains": Work(lambda: leafcloud.build_chain(foliage, levels=1, texture_size=64), 1000, 50),
        "renders": Work(lambda: render(foliage), 1000, 50),
        "draw orders": Work(lambda: leafcloud.blend_order(positions, triangles).weights, 1000, 50),
        "KTX2 files": Work(lambda: level.ktx2("base_color"), 1000, 50),
    }


def bake_into(folder: Path) -> None:
    # Each bake would have a temporary folder of its own inside that of the bake before.
    with quiet(), patch("addon.ending.own_temporary_folder"):
        status = bake.main(["--input", str(TREE), "--out", str(folder), *QUICK])
    if status != 0:
        raise SystemExit(f"a bake ended with the status {status}")


def render(foliage: leafcloud.Foliage) -> None:
    leafcloud.render([foliage], (1, 0, 0.3), 256, centre=foliage.world_centre.tolist(), radius=foliage.radius)


def squares(count: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return positions and triangles of squares at random places and of random directions."""
    random = np.random.default_rng(1)
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * 0.1
    frames = np.linalg.qr(random.normal(size=(count, 3, 3)))[0]
    positions = random.random((count, 1, 3)) + corners @ frames
    triangles = np.array([[0, 1, 2], [0, 2, 3]]) + 4 * np.arange(count)[:, None, None]
    return positions.reshape(-1, 3), triangles.reshape(-1, 3)


def resident_bytes_of(work: Work, times: int) -> Iterator[float]:
    """Return the resident memory after the warm-up, and after each quarter of `times` calls."""
    for _ in range(work.warm_up):
        work.call()
    yield resident_bytes()
    for quarter in range(QUARTERS):
        for _ in range(times * quarter // QUARTERS, times * (quarter + 1) // QUARTERS):
            work.call()
        yield resident_bytes()


def resident_bytes() -> float:
    """Return the memory of this process that is in use."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return float(pages * os.sysconf("SC_PAGE_SIZE"))


@contextmanager
def quiet() -> Iterator[None]:
    """Drop the standard output and the standard error."""
    kept = [os.dup(number) for number in (1, 2)]
    with open(os.devnull, "w") as nothing:
        for number in (1, 2):
            os.dup2(nothing.fileno(), number)
        try:
            yield
        finally:
            for number, copy in zip((1, 2), kept, strict=True):
                os.dup2(copy, number)
                os.close(copy)


if __name__ == "__main__":
    main()
