"""`make deny` runs all checks that it can, and says which one it leaves out. The lock files obey the rules."""

from __future__ import annotations

import os
import subprocess
import tomllib
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
WORKSPACES = (ROOT, ROOT / "engines" / "bevy", ROOT / "rust" / "fuzz")
CRATES_IO = "registry+https://github.com/rust-lang/crates.io-index"

# Writes its folder and arguments to a file, and fails as variables tell.
CARGO = """#!/bin/sh
echo "$PWD $*" >>"$CALLS"
case "$*" in
    "deny --version") exit ${NO_DENY:-0} ;;
    "deny fetch db") exit ${NO_DATABASE:-0} ;;
esac
exit ${FORBIDDEN:-0}
"""


def toml(path: Path) -> dict[str, Any]:
    return tomllib.loads(path.read_text())


def deny(folder: Path, **variables: str) -> tuple[subprocess.CompletedProcess[str], list[str]]:
    """Run tools/deny.sh with a cargo that only records its calls; return the result and the checks of crates."""
    calls = folder / "calls"
    cargo = folder / "cargo"
    cargo.write_text(CARGO)
    cargo.chmod(0o755)
    environment = {**os.environ, "PATH": f"{folder}:{os.environ['PATH']}", "CALLS": str(calls), **variables}
    command = [ROOT / "tools" / "deny.sh"]
    result = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60, check=False)
    return result, [line for line in calls.read_text().splitlines() if " check " in line]


def test_all_workspaces_are_checked_with_advisories(tmp_path: Path) -> None:
    result, checks = deny(tmp_path)
    assert result.returncode == 0
    assert [Path(line.split()[0]) for line in checks] == list(WORKSPACES)
    assert all(line.endswith("bans licenses sources advisories") for line in checks)
    assert "left out" not in result.stdout


def test_missing_database_is_told_and_the_other_checks_run(tmp_path: Path) -> None:
    result, checks = deny(tmp_path, NO_DATABASE="1")
    assert result.returncode == 0
    assert len(checks) == 3
    assert all(line.endswith("bans licenses sources") for line in checks)
    assert "left out the advisories" in result.stdout.splitlines()[-1]


def test_database_that_is_named_must_be_one(tmp_path: Path) -> None:
    result, checks = deny(tmp_path, NO_DATABASE="1", ADVISORY_DB=str(tmp_path))
    assert result.returncode == 1
    assert f"ADVISORY_DB={tmp_path} is no Git clone" in result.stderr
    assert not checks


def test_forbidden_crate_and_missing_tool_fail(tmp_path: Path) -> None:
    result, _ = deny(tmp_path, FORBIDDEN="2")
    assert result.returncode == 2
    result, _ = deny(tmp_path, NO_DENY="101")
    assert result.returncode == 1
    assert "cargo install cargo-deny --locked" in result.stderr


@pytest.mark.parametrize("workspace", WORKSPACES, ids=lambda path: path.name)
def test_crates_come_from_one_registry(workspace: Path) -> None:
    sources = {package.get("source") for package in toml(workspace / "Cargo.lock")["package"]}
    assert sources == {None, CRATES_IO}


def test_lock_of_the_fuzz_targets_has_the_crates_of_the_core() -> None:
    """The core is in two workspaces, and a change of its crates must change both locks."""
    wanted = set(toml(ROOT / "rust" / "core" / "Cargo.toml")["dependencies"])
    packages = toml(ROOT / "rust" / "fuzz" / "Cargo.lock")["package"]
    (core,) = [package for package in packages if package["name"] == "leafcloud"]
    assert {entry.split()[0] for entry in core["dependencies"]} == wanted, "run cargo update --workspace in rust/fuzz"


def test_each_exception_has_a_reason() -> None:
    rules = toml(ROOT / "deny.toml")
    for exception in [*rules["advisories"]["ignore"], *rules["bans"]["skip"]]:
        assert len(exception["reason"]) > 20
