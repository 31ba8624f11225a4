"""Breaks bakes in many ways, and counts lost and broken files: `make bench-faults`.

usage: make bench-faults ARGS='[--times N]'      (default: 34 of each kind)

Each fault meets a bake of the small tree at a random moment, in a folder that holds the files of an earlier bake of
another error bound: signals (SIGKILL, SIGTERM, SIGINT); a disk for the results and one for temporary files that become
full (file systems of random sizes in memory; needs root); a folder that vanishes; a folder that is not writable
(immutable, because root may write anywhere); a second bake into the same folder; too little address space. Then a bake
without a fault follows.

A file is *lost* if it is missing after the fault or the rerun, *mixed* if it is not one of the earlier or of the new
bake; *left behind* is what the rerun leaves beside its files. A status is *wrong* if it is 0 without all of the new
files, or not 0 with all of them, or not the one for the signal. Writes docs/reliability.md.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
TREE = ROOT / "examples" / "shrub.glb"
FLAGS = ("--texture-size", "64", "--levels", "1", "--epsilon")
OLD, NEW = "0.3", "0.2"
SEED = 20261126
HUNG = 1000
"""Takes the place of the exit status of a bake that does not end."""
BY_CLOCK = ("report.json", "report.html", ".blend")
"""Ends of the names of files that hold seconds or addresses, so that no two bakes give the same bytes: they must be
readable."""

INTRODUCTION = """# Reliability

Made by `make bench-faults`: each fault meets a bake of the small tree at a random moment, in a folder with the files of
an earlier bake. Then the bake is run again, without the fault.

- *ended well*: the bake was done before the fault, or was not disturbed by it.
- *lost*: files that are missing afterwards. *mixed*: files that are neither of the earlier bake nor of the new one.
- *left behind*: files and folders beside the results after the rerun.
- *status*: exit statuses that do not tell what happened, and bakes that did not end within five minutes.
- *rerun*: reruns that did not complete.

"""


@dataclass
class Bake:
    """A bake that runs: its process, the folder of its results and that of its temporary files."""

    process: subprocess.Popen[bytes]
    out: Path
    temporary: Path
    was_over: bool = False
    """Whether the bake had ended when its folder vanished."""
    beside: int = 0
    """Exit status of a second bake into the same folder."""


@dataclass
class Score:
    """What all bakes with a fault left."""

    runs: int = 0
    ended_well: int = 0
    lost: int = 0
    mixed: int = 0
    left: int = 0
    status: int = 0
    rerun: int = 0
    told: list[str] = field(default_factory=list)


def row_of(name: str, score: Score) -> tuple[str, ...]:
    """Return the cells of a row of the table."""
    counts = (score.runs, score.ended_well, score.lost, score.mixed, score.left, score.status, score.rerun)
    return name, *map(str, counts)


def start(out: Path, temporary: Path, epsilon: str, limit: int | None = None) -> Bake:
    temporary.mkdir(exist_ok=True, parents=True)
    command = [sys.executable, str(ROOT / "bake.py"), "--input", str(TREE), "--out", str(out), *FLAGS, epsilon]

    def prepare() -> None:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        if limit is not None:
            resource.setrlimit(resource.RLIMIT_AS, (limit, limit))

    process = subprocess.Popen(
        command,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        env={**os.environ, "TMPDIR": str(temporary)},
        start_new_session=True,
        preexec_fn=prepare,
    )
    return Bake(process, out, temporary)


def wait(bake: Bake) -> tuple[int, str]:
    """Return the exit status, and the last line on standard error; `HUNG` if the bake does not end."""
    try:
        _, error = bake.process.communicate(timeout=300)
    except subprocess.TimeoutExpired:
        os.killpg(bake.process.pid, signal.SIGKILL)
        bake.process.communicate()
        return HUNG, "hung"
    return bake.process.returncode, (error.decode(errors="replace").strip().splitlines() or [""])[-1]


def files_in(folder: Path) -> dict[str, str]:
    """Return the hash of each file; of those of `BY_CLOCK` the ε of the bake, or whether they can be read at all."""
    found = {}
    for file in sorted(folder.iterdir()) if folder.is_dir() else []:
        if file.is_file():
            found[file.name] = content_of(file)
    return found


def content_of(file: Path) -> str:
    data = file.read_bytes()
    if not file.name.endswith(BY_CLOCK):
        return hashlib.sha256(data).hexdigest()
    if file.name == "report.json":
        try:
            levels = json.loads(data)["levels"]
            return f"report of {levels[1]['epsilon']:.2g}"
        except (ValueError, KeyError, IndexError):
            return "broken"
    if file.suffix == ".html":
        return "page" if b"</html>" in data else "broken"
    # Blender compresses its files, or not.
    return "scene" if data[:7] == b"BLENDER" or data[:4] == b"\x28\xb5\x2f\xfd" else "broken"


Fault = Callable[[Bake, float], int | None]
"""Breaks a bake after so many seconds. Returns the exit status that this asks for; None for any."""


def by_signal(number: signal.Signals) -> Fault:
    def fault(bake: Bake, seconds: float) -> int:
        time.sleep(seconds)
        if bake.process.poll() is None:
            bake.process.send_signal(number)
        return -number if number == signal.SIGKILL else 128 + number

    return fault


def vanishing(bake: Bake, seconds: float) -> None:
    time.sleep(seconds)
    bake.was_over = bake.process.poll() is not None
    shutil.rmtree(bake.out, ignore_errors=True)


def closed(bake: Bake, seconds: float) -> None:
    time.sleep(seconds)
    subprocess.run(["chattr", "+i", str(bake.out)], check=True)
    try:
        bake.process.wait(300)
    finally:
        subprocess.run(["chattr", "-i", str(bake.out)], check=True)


def second(bake: Bake, seconds: float) -> None:
    time.sleep(seconds)
    status, _ = wait(start(bake.out, bake.temporary.with_name("temporary of the second"), NEW))
    bake.beside = status


def nothing(bake: Bake, seconds: float) -> None:
    """The fault is in the bake's surroundings."""


@contextmanager
def disk(folder: Path, size: int) -> Iterator[None]:
    """Mount a file system of so many bytes in memory."""
    folder.mkdir(parents=True, exist_ok=True)
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(folder)], check=True)
    try:
        yield
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=True)


class Trial:
    """All bakes with one kind of fault."""

    def __init__(self, old: Path, new: Path, seconds: float, scratch: Path) -> None:
        self.old, self.new, self.seconds, self.scratch = old, new, seconds, scratch
        self.before, self.after = files_in(old), files_in(new)
        self.chance = random.Random(SEED)

    def run(self, name: str, fault: Fault, times: int) -> Score:
        score = Score()
        for number in range(times):
            folder = Path(tempfile.mkdtemp(dir=self.scratch))
            out, temporary = folder / "out", folder / "temporary"
            limit = None
            if name == "full disk":
                size = sum(file.stat().st_size for file in self.old.iterdir())
                with disk(out, size + self.chance.randrange(1, 2 * size)):
                    self.once(score, out, temporary, fault, limit)
            elif name == "full temporary disk":
                with disk(temporary, self.chance.randrange(1, 60_000)):
                    self.once(score, out, temporary, fault, limit)
            else:
                if name == "little memory":
                    limit = self.chance.randrange(300, 2600) * 2**20
                self.once(score, out, temporary, fault, limit)
            shutil.rmtree(folder, ignore_errors=True)
            print(f"{name}: {number + 1} of {times}; {score.told[-1]}", file=sys.stderr)
        print(f"{name}: {row_of(name, score)}", file=sys.stderr)
        return score

    def once(self, score: Score, out: Path, temporary: Path, fault: Fault, limit: int | None) -> None:
        out.mkdir(parents=True, exist_ok=True)
        for file in self.old.iterdir():
            shutil.copy(file, out)
        bake = start(out, temporary, NEW, limit)
        wanted = fault(bake, self.chance.uniform(0.0, 1.05 * self.seconds))
        status, line = wait(bake)
        score.runs += 1
        score.told.append(f"{status} {line[:140]}")
        vanished = fault is vanishing
        found = files_in(out)
        both = fault is second
        done = self.matches(found, self.after)
        # A process that is killed between two moves leaves whole files of both bakes: the rerun completes them.
        between = status == -signal.SIGKILL
        if status == 0:
            score.ended_well += 1
        score.mixed += sum(found[each] not in (self.before.get(each), self.after.get(each)) for each in found)
        if not vanished:
            kept = [name for name in self.before if name in found or name not in self.after]
            score.lost += len(self.before) - len(kept)
            whole = done or self.matches(found, self.before)
            score.mixed += not (whole or between or both)
        right = status in (0, -signal.SIGKILL) if done else status != 0
        if status == 0:
            right = done or (vanished and bake.was_over) or both
        elif wanted is not None and not done:
            right = status in (wanted, 128 - wanted)  # A signal before the first lines of bake.py ends it as such.
        score.status += (not right or status == HUNG) + (bake.beside != 0)
        self.rerun(score, out, temporary)

    def rerun(self, score: Score, out: Path, temporary: Path) -> None:
        full = os.path.ismount(out) or os.path.ismount(temporary)
        if full:
            # More room: the rerun is to complete.
            for folder in (out, temporary):
                if os.path.ismount(folder):
                    subprocess.run(["mount", "-o", "remount,size=200m", str(folder)], check=True)
        status, line = wait(start(out, temporary, NEW))
        found = files_in(out)
        if status != 0 or not self.matches(found, self.after):
            score.rerun += 1
            score.told[-1] += f" | rerun: {status} {line[:140]}"
        score.lost += len(self.after.keys() - found.keys())
        others = [each for folder in (out, temporary) if folder.is_dir() for each in folder.iterdir()]
        left = [each.name for each in others if each.name not in self.after]
        score.left += len(left)
        if left:
            score.told[-1] += f" | left: {', '.join(left)}"

    @staticmethod
    def matches(found: dict[str, str], files: dict[str, str]) -> bool:
        return found == files


KINDS: dict[str, Fault] = {
    "SIGKILL": by_signal(signal.SIGKILL),
    "SIGTERM": by_signal(signal.SIGTERM),
    "SIGINT": by_signal(signal.SIGINT),
    "folder vanishes": vanishing,
    "folder is closed": closed,
    "full disk": nothing,
    "full temporary disk": nothing,
    "two bakes at once": second,
    "little memory": nothing,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--times", type=int, default=34)
    parser.add_argument("--only", choices=KINDS, action="append")
    options = parser.parse_args()
    scratch = Path(tempfile.mkdtemp(prefix="faults-"))
    old, new = scratch / "old", scratch / "new"
    wait(start(old, scratch / "temporary", OLD))
    begin = time.monotonic()
    wait(start(new, scratch / "temporary", NEW))
    trial = Trial(old, new, time.monotonic() - begin, scratch)
    scores = {name: trial.run(name, KINDS[name], options.times) for name in options.only or KINDS}
    shutil.rmtree(scratch, ignore_errors=True)
    rows = [row_of(name, score) for name, score in scores.items()]
    rows.append(("all", *(str(sum(int(row[i]) for row in rows)) for i in range(1, 8))))
    head = ("fault", "bakes", "ended well", "lost", "mixed", "left behind", "status", "rerun")
    table = "\n".join(["| " + " | ".join(row) + " |" for row in (head, ["---"] * 8, *rows)])
    print(table)
    if options.only is None:
        (ROOT / "docs" / "reliability.md").write_text(INTRODUCTION + table + "\n")
    if any(int(cell) for cell in rows[-1][3:]):
        raise SystemExit("something was lost, mixed, left behind or told wrongly")


if __name__ == "__main__":
    main()
