"""The commit that measurements belong to."""

from __future__ import annotations

import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def measured_commit() -> str:
    """Return the name of the current commit, with "-dirty" if files outside docs differ from it."""

    def git(*words: str) -> str:
        return subprocess.run(
            ["git", "-C", str(ROOT), *words], capture_output=True, text=True, check=True
        ).stdout.strip()

    changed = git("status", "--porcelain", "--", ".", ":!docs")
    return git("describe", "--always") + ("-dirty" if changed else "")


def is_current(commit: str) -> bool:
    """Return whether no file outside docs differs between a measured commit and now."""
    if commit.endswith("-dirty") or measured_commit().endswith("-dirty"):
        return False
    compared = ["git", "-C", str(ROOT), "diff", "--quiet", commit, "--", ".", ":!docs"]
    return subprocess.run(compared, capture_output=True).returncode == 0
