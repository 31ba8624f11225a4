"""Helpers that run the command line: in a process of its own, or within the process of the tests."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

import bpy

ROOT = Path(__file__).resolve().parents[2]
BAKE = ROOT / "bake.py"
QUICK = (
    "--texture-size",
    "128",
    "--epsilon",
    "0.1",
    "--pixels",
    "8",
    "--levels",
    "2",
    "--every-level",
    "--files",
    "all",
)
"""Flags of a quick bake of two clouds, however cheap the tree, with all files. No pictures decide."""


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    """Run bake.py within the process of the tests, without the time to start Blender. Return its status and output.

    The bake may replace the open scene. Use `run_apart` to test the process.
    """
    import bake as program

    given = list(map(str, arguments))
    with _captured() as printed, patch("addon.ending.own_temporary_folder"):
        status = program._status(given)
    return subprocess.CompletedProcess(given, status, *printed)


def run_apart(*arguments: object) -> subprocess.CompletedProcess[str]:
    """Run bake.py in a process of its own. Return the ended process."""
    command = [sys.executable, str(BAKE), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=280, check=False)


@contextmanager
def _captured() -> Iterator[list[str]]:
    """Yield an empty list. After the block it holds standard output and standard error, Blender's own included."""
    printed: list[str] = []
    kept, streams = [os.dup(1), os.dup(2)], (sys.stdout, sys.stderr)
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        files = (out, err)
        for number, file in enumerate(files, 1):
            os.dup2(file.fileno(), number)
        sys.stdout, sys.stderr = (open(number, "w", encoding="utf-8", closefd=False) for number in (1, 2))  # noqa: SIM115
        try:
            yield printed
        finally:
            for stream in (sys.stdout, sys.stderr):
                stream.flush()
            sys.stdout, sys.stderr = streams
            for number, descriptor in enumerate(kept, 1):
                os.dup2(descriptor, number)
                os.close(descriptor)
            for file in files:
                file.seek(0)
                printed.append(file.read().decode())


def bake(source: Path, out: Path, *arguments: object) -> dict[str, Any]:
    """Bake `source` into `out` as the command line does. Return the report. The bake replaces the open scene.

    The bake runs in the process of the tests, which saves the start of Blender. Use `bake_apart` to test the process.
    """
    import bake as program

    with patch("addon.ending.own_temporary_folder"):  # The folder would last until the process ends.
        status = program.main([str(each) for each in ("--input", source, "--out", out, *arguments)])
    assert status == 0, "see bake.py's line on standard error"
    return report_in(out)


def bake_apart(source: Path, out: Path, *arguments: object) -> dict[str, Any]:
    """Bake `source` into `out` in a process of its own. Return the report. The open scene stays."""
    done = run_apart("--input", source, "--out", out, *arguments)
    assert done.returncode == 0, done.stderr
    return report_in(out)


def report_in(out: Path) -> dict[str, Any]:
    """Return the report of the bake in the folder `out`."""
    return json.loads((out / "report.json").read_text(encoding="utf-8"))


def refusal(out: Path, *arguments: object) -> str:
    """Run a bake; fail unless bake.py refuses the bake in one line. Return the line.

    The bake must leave nothing in its folder.
    """
    return _refused(run("--out", out, *arguments), out)


def refusal_apart(out: Path, *arguments: object) -> str:
    """Do as `refusal` does in a process of its own: for limits of the process, and to keep the open scene."""
    return _refused(run_apart("--out", out, *arguments), out)


def _refused(done: subprocess.CompletedProcess[str], out: Path) -> str:
    assert done.returncode not in (0, -6, -11)
    assert not out.is_dir() or not list(out.iterdir())
    lines = done.stderr.splitlines()
    assert len(lines) == 1, done.stderr
    assert lines[0].startswith("bake.py: ")
    return lines[0].removeprefix("bake.py: ")


def saved(path: Path) -> Path:
    """Save the open scene as `path`. Return the path."""
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path
