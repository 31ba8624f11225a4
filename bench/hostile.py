"""Bakes hostile files, and counts how the bakes end: `make bench-hostile`.

usage: make bench-hostile ARGS='[--only PATTERN] [--sample N] [--list] [--ends FILE]'   (default: all files, two hours)

Each file is a small tree with one change (`hostile_files`, `hostile_blends`), in a folder with a pipe, links, a sparse
file and a file outside of it. Each bake has a process, a folder of its own, SECONDS, and MEMORY; two run at a time. If
the system allows, they have no network.

A bake must end well, or with one line on standard error that names the fault and a remedy. Without --only, the counts
go to docs/hostile.md. The files are baked in a random order; after an interrupt, the same command with --ends goes on.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter, deque
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import psutil
from hostile_blends import blend_cases
from hostile_files import Case, gltf_cases, obj_cases
from hostile_masses import mass_cases

ROOT = Path(__file__).resolve().parents[1]
SECONDS = 30
MEMORY = 3 << 30
"""Limits of a bake: seconds, and bytes of resident memory."""
FLAGS = ("--texture-size", "64", "--levels", "1", "--epsilon", "0.3", "--min-visibility", "0")
OWN_LIMITS = ("--memory", f"{0.9 * MEMORY / 2**30:.3g}", "--minutes", f"{0.8 * SECONDS / 60:.3g}")
"""Limits that the bake keeps by itself."""
SEED = 20261126

GOOD = ("baked", "named", "limit told", "crash told")
ENDS = (*GOOD, "unnamed", "traceback", "crash", "hang", "memory", "escape")

INTRODUCTION = f"""# Hostile files

Made by `make bench-hostile`: each file is a small tree with one change, baked by a process of its own with {SECONDS}
seconds and {MEMORY >> 30} GiB of memory. Pipes, devices, links and sparse files are beside it, another file is outside
of its folder. The bakes get the flags `{" ".join(OWN_LIMITS)}`.

- *baked*: the bake ended well. *named*: it was refused in one line with the fault and a remedy.
- *limit told*, *crash told*: the guard ended the bake at a limit, or Blender crashed, and one line says so.
- *unnamed*: refused in another way. *traceback*: with a traceback. *crash*: by a signal. *hang*, *memory*: over a
  limit.
- *escape*: something was written outside of the folder for results.

Images up to 8192 × 8192 texels and scenes up to ten million triangles are no attack: their bakes take minutes and
gigabytes. Some bytes of modifiers, instances or geometry nodes can fill any memory or take for ever, and damage inside
the blocks of a .blend file may crash Blender. No check can find these before Blender evaluates the scene. So a guard
watches the bake from outside (`addon/guard.py`, on Linux): it ends the bake at `--memory`, by default 90 % of the free
memory, and at `--minutes`, and names a crash.

"""


@dataclass(frozen=True)
class End:
    """How a bake ended."""

    name: str
    how: str
    seconds: float
    megabytes: int
    words: str


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", metavar="PATTERN", default="", help="bake the files with names that match a pattern")
    parser.add_argument("--sample", metavar="N", type=int, help="bake N of the files, chosen at random")
    parser.add_argument("--list", action="store_true", help="list the names of the files")
    parser.add_argument("--ends", metavar="FILE", type=Path, help="add each end to a file, and bake none that is in it")
    options = parser.parse_args(arguments)
    every = [*gltf_cases(), *obj_cases(), *blend_cases(), *mass_cases()]
    cases = [case for case in every if re.search(options.only, case.name)]
    if options.sample is not None and options.sample < len(cases):
        chosen = set(random.Random(SEED).sample(range(len(cases)), options.sample))
        cases = [case for number, case in enumerate(cases) if number in chosen]
    if options.list:
        print("\n".join(case.name for case in cases))
        return 0
    ends = _known(options.ends, {case.name for case in cases})
    done = {end.name for end in ends}
    left = [case for case in cases if case.name not in done]
    random.Random(SEED).shuffle(left)
    with suppress(KeyboardInterrupt):
        for end in _bake_all(left):
            ends.append(end)
            if options.ends is not None:
                with options.ends.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(asdict(end)) + "\n")
    order = {case.name: number for number, case in enumerate(cases)}
    ends.sort(key=lambda end: order[end.name])
    text = f"{len(ends)} of {len(every)} files:\n\n{table(ends)}"
    print(text)
    if not options.only:
        (ROOT / "docs" / "hostile.md").write_text(INTRODUCTION + text, encoding="utf-8")
    return int(any(end.how not in GOOD for end in ends))


def _known(file: Path | None, names: set[str]) -> list[End]:
    """Return the ends in a file of an earlier run, of the named cases."""
    if file is None or not file.exists():
        return []
    ends = [End(**json.loads(line)) for line in file.read_text(encoding="utf-8").splitlines()]
    ends = [replace(end, how=_told(end.words)) if end.how == "named" else end for end in ends]
    return [end for end in ends if end.name in names]


def _bake_all(cases: Iterable[Case]) -> Iterator[End]:
    """Bake the files of all cases. Yield the ends in the same order."""
    with tempfile.TemporaryDirectory(prefix="hostile-") as place, ThreadPoolExecutor(2) as pool:
        running: deque[Future[End]] = deque()
        for number, case in enumerate(cases):  # Blender makes the files in this thread.
            folder = Path(place) / str(number)
            (folder / "in").mkdir(parents=True)
            source = case.write(folder / "in")
            running.append(pool.submit(_bake, case.name, source, folder))
            if len(running) > 2:
                yield running.popleft().result()
        while running:
            yield running.popleft().result()


def table(ends: Iterable[End]) -> str:
    """Return the counts by kind of file, and a line for each bake that did not end as it must."""
    counts: dict[str, Counter[str]] = {}
    ends = list(ends)
    for end in ends:
        counts.setdefault(_kind(end.name), Counter())[end.how] += 1
    lines = [f"| file | {' | '.join(ENDS)} |", "|---" * (len(ENDS) + 1) + "|"]
    for kind, of_kind in (*counts.items(), ("all", sum(counts.values(), Counter()))):
        lines.append(f"| {kind} | {' | '.join(str(of_kind[how] or '') for how in ENDS)} |")
    slowest = max(ends, key=lambda end: end.seconds)
    largest = max(ends, key=lambda end: end.megabytes)
    lines += [
        "",
        f"Slowest: {slowest.seconds:.0f} s ({slowest.name}). Largest: {largest.megabytes} MB ({largest.name}).",
    ]
    lines += ["", *(f"- {end.how}: {end.name}: {end.words}" for end in ends if end.how not in GOOD)]
    return "\n".join(lines).rstrip() + "\n"


def _kind(name: str) -> str:
    words = name.split()
    return " ".join(words[:2]) if words[0] in ("obj", "blend") and words[1] in _KINDS else words[0]


_KINDS = ("library", "image", "option", "corner", "line", "cut", "bytes", "name", "shared", "compressed", "mass")


def _bake(name: str, source: Path, folder: Path) -> End:
    """Bake a file, delete its folder, and return how the bake ended."""
    try:
        end = _ended(name, source, folder)
        line = f"{end.how:9} {end.seconds:4.0f} s {end.megabytes:5} MB  {name}: {end.words}"
        print(line, file=sys.stderr, flush=True)
        return end
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _ended(name: str, source: Path, folder: Path) -> End:
    for each in ("home", "tmp"):
        (folder / each).mkdir()
    before = _contents(folder)
    environment = os.environ | {
        "HOME": str(folder / "home"),
        "TMPDIR": str(folder / "tmp"),
        "BLENDER_USER_RESOURCES": str(folder / "home"),
    }
    command = [sys.executable, str(ROOT / "bake.py"), "--input", str(source), "--out", str(folder / "out"), *FLAGS]
    command += OWN_LIMITS
    begin = time.monotonic()
    with open(folder / "errors", "wb") as errors:
        process = subprocess.Popen(
            [*_without_network(), *command],
            stdout=subprocess.DEVNULL,
            stderr=errors,
            env=environment,
            cwd=folder / "in",
        )
        stopped, peak = _watch(process, begin)
    seconds = time.monotonic() - begin
    words = (folder / "errors").read_text(errors="replace")
    (folder / "errors").unlink()
    shutil.rmtree(folder / "home")
    results = (folder / "out" / "report.json").is_file()
    left = (folder / "out").is_dir() and not results and any((folder / "out").iterdir())
    shutil.rmtree(folder / "out", ignore_errors=True)
    escaped = sorted(_contents(folder) - before)
    escaped = [each for each in escaped if not each.startswith(("home", "tmp"))] + ["out"] * left
    how = _how(stopped, process.returncode, words, results)
    if escaped:
        how, words = "escape", ", ".join(escaped[:5])
    return End(name, how, seconds, peak >> 20, " / ".join(words.split("\n"))[-300:])


def _how(stopped: str, status: int, words: str, results: bool) -> str:
    """Return the end of a bake: one of `ENDS`."""
    lines = [line for line in words.splitlines() if not _is_progress(line)]
    if stopped:
        return stopped
    if status < 0:
        return "crash"
    if "Traceback" in words:
        return "traceback"
    if status == 0:
        return "baked" if results and not lines else "unnamed"
    if status == 1 and len(lines) == 1 and lines[0].startswith("bake.py: ") and re.search("[;:] ", lines[0][9:]):
        return _told(lines[0])
    return "unnamed"


def _told(words: str) -> str:
    """Return whose line it is: of the guard (`addon/guard.py`), or of a check that refused the file."""
    if re.search(r"the bake crashed|killed the bake", words):
        return "crash told"
    return "limit told" if re.search(r"not done after|the bake needs more than", words) else "named"


def _is_progress(line: str) -> bool:
    return line.endswith("…") or line.startswith(("bake.py: note: ", "bake.py: warning: "))


def _watch(process: subprocess.Popen[bytes], begin: float) -> tuple[str, int]:
    """Wait for a process, at most `SECONDS` and `MEMORY`. Return the limit that it exceeded, and its peak in bytes."""
    peak, stopped = 0, ""
    while process.poll() is None:
        peak = max(peak, _resident(process.pid))
        if not stopped and (peak > MEMORY or time.monotonic() - begin > SECONDS):
            stopped = "memory" if peak > MEMORY else "hang"
            process.kill()
        time.sleep(0.05)
    return stopped, peak


def _resident(pid: int) -> int:
    """Return the bytes of a process and of those that it started."""
    total = 0
    with suppress(psutil.Error):
        process = psutil.Process(pid)
        for each in (process, *process.children(recursive=True)):
            total += each.memory_info().rss
    return total


def _contents(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*")}


def _without_network() -> list[str]:
    command = ["unshare", "--net", "--"]
    try:
        works = subprocess.run([*command, "true"], capture_output=True, check=False).returncode == 0
    except OSError:
        works = False
    return command if works else []


if __name__ == "__main__":
    sys.exit(main())
