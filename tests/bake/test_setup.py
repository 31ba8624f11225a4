"""Setup, tools and the example tree of a fresh clone."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path

import bpy
import pytest

from examples import make_shrub

ROOT = Path(__file__).resolve().parents[2]
LOCK = ROOT / "tests" / "gltf_validator" / "package-lock.json"


def run(*command: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run a command in the repository's root, without the variables of a make that may have started the tests."""
    inherited = {key: value for key, value in os.environ.items() if key not in ("MAKEFLAGS", "MAKELEVEL", "MFLAGS")}
    return subprocess.run(
        command, cwd=ROOT, env={**inherited, **environment}, capture_output=True, text=True, timeout=60, check=False
    )


@pytest.fixture
def bare_path(tmp_path: Path) -> Path:
    """Return a folder for PATH with standard Unix tools only: no compiler, interpreter or package manager."""
    for tool in ("bash", "sh", "env", "dirname", "id", "uname"):
        (tmp_path / tool).symlink_to(str(shutil.which(tool)))
    return tmp_path


def add_tool(folder: Path, name: str, script: str = "exit 0") -> None:
    """Write a shell script called ``name`` into ``folder``."""
    (folder / name).write_text(f"#!/bin/sh\n{script}\n")
    (folder / name).chmod(0o755)


def test_help_lists_every_target_in_one_line() -> None:
    listed = run("make").stdout.splitlines()
    names = {line.split()[0] for line in listed}
    assert {"setup", "bake", "test", "bench", "lint", "extension", "clean"} <= names
    phony = re.findall(r"^\.PHONY: ([\w-]+)$", (ROOT / "Makefile").read_text(), re.MULTILINE)
    assert sorted(names) == sorted(phony)
    assert all(len(line.split(maxsplit=1)) == 2 for line in listed)


@pytest.mark.parametrize(
    ("need", "present", "says"),
    [
        ("rust", [], "Rust is missing (no working cargo on PATH)"),
        ("rust", ["cargo"], "Rust is missing (no working rustc on PATH)"),
        ("rust", ["cargo", "rustc"], "A C++ compiler is missing (no cc on PATH)"),
        ("rust", ["cargo", "rustc", "cc"], "A C++ compiler is missing (no c++ on PATH)"),
        ("python", [], "Python 3.11 is missing"),
        ("blender", ["ldconfig"], "Blender needs system libraries that are missing"),
        ("node", [], "The glTF validator and three.js need node and npm"),
        ("chromium", [], "three.js needs a browser"),
        ("compass", [], "not 'compass'"),
    ],
)
def test_a_missing_prerequisite_is_named_in_one_line(bare_path: Path, need: str, present: list[str], says: str) -> None:
    for tool in present:
        add_tool(bare_path, tool)
    result = run("tools/prerequisites.sh", need, PATH=str(bare_path))
    assert result.returncode != 0
    assert result.stdout == ""
    assert result.stderr.count("\n") == 1
    assert says in result.stderr


def test_another_python_is_refused(bare_path: Path) -> None:
    add_tool(bare_path, "python3", "exit 1")
    result = run("tools/prerequisites.sh", "python", PATH=str(bare_path), PYTHON="python3")
    assert result.returncode != 0
    assert "none among: python3" in result.stderr


def test_python_is_found() -> None:
    assert run("tools/prerequisites.sh", "--find-python", PYTHON=sys.executable).stdout.strip() == sys.executable


def test_bake_keeps_paths_with_spaces_whole() -> None:
    planned = run("make", "--dry-run", "bake", "INPUT=a tree.glb", "OUT=the output", "ARGS=--seed 3").stdout
    assert '.venv/bin/python bake.py --input "a tree.glb" --out "the output" --seed 3' in planned


def test_one_version_everywhere() -> None:
    workspace = tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]["package"]["version"]
    manifest = tomllib.loads((ROOT / "addon" / "blender_manifest.toml").read_text())["version"]
    assert manifest == workspace


def test_this_blender_is_the_pinned_one() -> None:
    pins = ROOT / "tools" / "requirements" / f"blender-{bpy.app.version[0]}.{bpy.app.version[1]}.in"
    assert f"bpy=={'.'.join(map(str, bpy.app.version))}" in pins.read_text().splitlines()


def test_lock_file_names_no_registry() -> None:
    packages = json.loads(LOCK.read_text())["packages"]
    assert all("resolved" not in package for package in packages.values())


def test_shipped_shrub_is_what_its_generator_writes(shrub: Path) -> None:
    assert shrub.read_bytes() == make_shrub.glb()
    assert shrub.stat().st_size < 300_000


def test_shrub_imports_and_validates(shrub: Path, gltf_issues: Callable[..., list[object]]) -> None:
    assert gltf_issues(shrub) == []
    bpy.ops.import_scene.gltf(filepath=str(shrub))
    triangles = {obj.name: len(obj.data.polygons) for obj in bpy.data.objects}
    assert triangles == {"leaves": 1344, "branches": 1984}
    assert not bpy.data.materials["leaves"].use_backface_culling
