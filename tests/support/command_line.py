"""The command line as its tests use it: in a process of its own."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import bpy

ROOT = Path(__file__).resolve().parents[2]
BAKE = ROOT / "bake.py"
QUICK = ("--texture-size", "256")


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(BAKE), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=280, check=False)


def bake(source: Path, out: Path, *arguments: object) -> dict[str, Any]:
    """A bake that has to work; its report."""
    done = run("--input", source, "--out", out, *arguments)
    assert done.returncode == 0, done.stderr
    return json.loads((out / "report.json").read_text(encoding="utf-8"))


def refusal(out: Path, *arguments: object) -> str:
    """A bake that has to be refused: in one line, with nothing left in its folder. Gives the line."""
    done = run("--out", out, *arguments)
    assert done.returncode not in (0, -6, -11)
    assert not out.is_dir() or not list(out.iterdir())
    lines = done.stderr.splitlines()
    assert len(lines) == 1, done.stderr
    assert lines[0].startswith("bake.py: ")
    return lines[0].removeprefix("bake.py: ")


def saved(path: Path) -> Path:
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path
