"""A studio with trees, and a small program that stands for `bake.py` in tests of batches."""

from __future__ import annotations

import json
import shlex
import sys
from pathlib import Path
from typing import Any

from leafcloud.batch.command import main

PROGRAM = '''
import json, os, pathlib, shutil, signal, sys, time

def known():
    """Whether the last word is an existing file. Makes it."""
    mark = pathlib.Path(words[-1])
    found = mark.exists()
    if mark.is_absolute():
        mark.touch()
    return found

given = sys.argv[1:]
source, out = (pathlib.Path(given[given.index(name) + 1]) for name in ("--input", "--out"))
words = source.read_text().split()
with open(out.parent / "calls.log", "a") as log:
    log.write(source.stem + "\\n")
out.mkdir(parents=True, exist_ok=True)
if "diskless" in words and not known():
    shutil.rmtree(source.parents[1])
    sys.exit("bake.py: cannot read")
if "deadly" in words and not known():
    os.kill(os.getppid(), signal.SIGKILL)
    time.sleep(60)
if "litter" in words:
    (out / ".leafcloud-litter").mkdir()
if "slow" in words:
    print("bake.py: fit …", file=sys.stderr, flush=True)
    if len(words) > 1 and words[-1].startswith("/"):
        pathlib.Path(words[-1]).write_text(str(os.getpid()))
    time.sleep(60)
if "large" in words:
    block = bytearray(os.urandom(1)) * 400_000_000
    time.sleep(60)
if "crash" in words:
    os.abort()
if "--wrong" in given:
    print("bake.py: error: unrecognized arguments: --wrong", file=sys.stderr)
    sys.exit(2)
if "refused" in words:
    sys.exit("bake.py: note: a note\\nbake.py: the tree has no leaves: add some")
print("bake.py: warning: <thin> leaves", file=sys.stderr)
level = {"method": "leaves", "triangles": 12, "trunk_triangles": 3, "switch_distance": 0.0, "drawing": {"cheaper": 1.0}}
report = {"levels": [level], "files": ["report.json", "tree.glb"]}
(out / "report.json").write_text(json.dumps(report))
(out / "tree.glb").write_text(" ".join(given))
'''


class Studio:
    """A folder with trees, a program that bakes them, and the folder of the results."""

    def __init__(self, folder: Path) -> None:
        self.trees, self.out, self.program = folder / "trees", folder / "out", folder / "bake.py"
        self.trees.mkdir()
        self.program.write_text(PROGRAM)

    def add(self, name: str, words: str = "") -> Path:
        file = self.trees / f"{name}.glb"
        file.write_text(words)
        return file

    def arguments(self, *more: object) -> list[str]:
        command = shlex.join([sys.executable, str(self.program)])
        return [*map(str, (self.trees, "--out", self.out, "--bake", command, *more))]

    def run(self, *more: object) -> int:
        return main(self.arguments(*more))

    @property
    def calls(self) -> list[str]:
        """The trees of all begun bakes, in order of their beginning."""
        log = self.out / "calls.log"
        return log.read_text().split() if log.exists() else []

    @property
    def rows(self) -> dict[str, Any]:
        return {row["tree"]: row for row in json.loads((self.out / "batch.json").read_text())}
