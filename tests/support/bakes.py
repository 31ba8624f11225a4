"""Bakes of the shrub for tests that only read files: each is made once, and shared by all processes and runs.

`BAKES` names those that several files read. They lie in target/bakes, in a folder for the state of the core, the add-on
and Blender: a change of one of these makes them anew. A test may not write into their folders.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import bpy
import command_line
import numpy as np
from command_line import BAKE, QUICK, ROOT, bake, report_in

import leafcloud

SHRUB = ROOT / "examples" / "shrub.glb"
KEPT = ROOT / "target" / "bakes"
STATES = 6
"""Folders of states that stay: the most recently used ones. Three Blenders use one each."""

_MOVING = "--effects=+transitions,+pruning,+wind"
_SHADED = "--effects=+transitions,+normals,+occlusion,+self_shadowing"
_EXACT = ("--effects", "transitions,pruning,trunk_levels,wind")

BAKES: dict[str, tuple[str, ...]] = {
    "quick": QUICK,
    "sharp": (
        *("--texture-size", "256", "--levels", "2", "--effects=+pruning", "--every-level", "--last", "octahedral"),
        *("--form", "billboards", "--files", "all"),
    ),
    "leaves pruned": (*QUICK, "--effects=+pruning"),
    "octahedral": (*QUICK, "--last", "octahedral", "--effects=+transitions"),
    "pruned": (*QUICK, "--chain", "pruning", "--prune-pixels", "60"),
    "generic": (*QUICK, *_EXACT),
    "godot": (*QUICK, *_EXACT, "--engine", "godot"),
    "unity": (*QUICK, "--engine", "unity", "--last", "cross", _MOVING),
    "unity compressed": (*QUICK, "--engine", "unity", "--last", "cross", _MOVING, "--compress"),
    "three": (*QUICK, "--engine", "three", "--last", "cross", _MOVING),
    "three compressed": (*QUICK, "--engine", "three", "--last", "cross", _MOVING, "--compress"),
    "three octahedral": (*QUICK, "--engine", "three", "--last", "octahedral", "--effects=+transitions"),
    "three shaded": (*QUICK, "--engine", "three", "--last", "cross", _SHADED),
    "babylon": (*QUICK, "--engine", "babylon", "--last", "cross", _MOVING),
    "babylon octahedral": (*QUICK, "--engine", "babylon", "--last", "octahedral", _MOVING),
}
"""Flags of each bake."""


def folder_of(name: str) -> Path:
    """Return the folder of a bake of the catalogue."""
    return kept(*BAKES[name])


def report_of(name: str) -> dict[str, Any]:
    """Return the report of a bake of the catalogue."""
    return report_in(folder_of(name))


def kept(*flags: object) -> Path:
    """Return the folder of a bake of the shrub with these flags.

    The first caller makes it, which replaces the open scene; others wait for it.
    """
    out = KEPT / _state() / _digest(json.dumps(list(map(str, flags))).encode())
    with _locked(out.with_suffix(".lock")):
        if not out.exists():
            made = out.with_suffix(".part")
            shutil.rmtree(made, ignore_errors=True)  # Of a run that was ended.
            bake(SHRUB, made, *flags)
            made.rename(out)
        found = {file.name for file in out.iterdir()}
        assert found == set(report_in(out)["files"]), f"a test has written into {out}: remove the folder"
    return out


@cache
def _state() -> str:
    """Return a digest of all that decides what a bake writes. Remove the bakes of older states."""
    package = Path(leafcloud.__file__).parent
    sources = [BAKE, SHRUB, *sorted((ROOT / "addon").rglob("*.py")), *sorted(package.rglob("*.*"))]
    sources += [Path(__file__), Path(command_line.__file__), *sorted(Path(__file__).parent.glob("kept_*.py"))]
    contents = [each.read_bytes() for each in sources if "__pycache__" not in each.parts]
    state = _digest(bpy.app.version_string.encode(), np.__version__.encode(), *contents)
    (KEPT / state).mkdir(parents=True, exist_ok=True)
    (KEPT / state).touch()
    with _locked(KEPT / "lock"):
        for old in sorted(KEPT.glob("*/"), key=lambda each: each.stat().st_mtime)[:-STATES]:
            shutil.rmtree(old, ignore_errors=True)
    return state


def _digest(*contents: bytes) -> str:
    return hashlib.sha256(b"".join(hashlib.sha256(each).digest() for each in contents)).hexdigest()[:16]


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Wait for the lock on a file, and hold it during the block. The system frees the lock of a process that ends."""
    with path.open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield
