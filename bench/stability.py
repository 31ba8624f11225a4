"""Runs the hard cases of both test suites and shows them: `make bench-stability` writes docs/stability.md.

The test that asserts a case also records it (rust/core/tests/common/stability.rs, tests/support/hard_cases.py):
the largest error found and the allowed one, or the error message for input without a result.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "stability.md"
RUNS = [
    ["cargo", "test", "--quiet", "--package", "leafcloud", "--", "--include-ignored"],
    [sys.executable, "-m", "pytest", "--quiet", "tests/blender/test_hard_cases.py"],
]

INTRODUCTION = """# Hard cases

Made by `make bench-stability` from the tests themselves; every test run asserts each of these cases. An oracle is the
reference for a result, and never comes from the code under test. *Worst* is the largest error found, *allowed* the
oracle's limit. 0 of 0 means equal to the bit, or no miscounts. Input without a result raises a named error, and never
gives NaN, a hang, a panic or an empty success.

ε is 0.04 R in the geometry cases. A cloud's worst is the largest distance of a vertex from its plane divided by ε, in
exact fractions: 1 is allowed. "Every method" is the stochastic method at efforts literal, default and final, density,
and k-means.
"""


def cases() -> list[dict[str, Any]]:
    """Run the tests and return their cases. A case recorded more than once keeps its worst."""
    with tempfile.TemporaryDirectory() as folder:
        record = Path(folder) / "cases.jsonl"
        for command in RUNS:
            subprocess.run(command, cwd=ROOT, check=True, env=os.environ | {"LEAFCLOUD_STABILITY": str(record)})
        lines = [json.loads(line) for line in record.read_text(encoding="utf-8").splitlines()]
    found: dict[tuple[str, str], dict[str, Any]] = {}
    for case in lines:
        known = found.setdefault((case["group"], case["name"]), case)
        if case.get("worst", 0.0) > known.get("worst", 0.0):
            found[case["group"], case["name"]] = case
    return sorted(found.values(), key=lambda case: (case["group"], case["name"]))


def number(value: float) -> str:
    return "0" if value == 0 else f"{value:.3g}"


def table(rows: list[dict[str, Any]]) -> str:
    measured = [case for case in rows if "error" not in case]
    refused = [case for case in rows if "error" in case]
    text = ""
    if measured:
        text += "| case | oracle | worst | allowed |\n|---|---|---|---|\n"
        for case in measured:
            text += f"| {case['name']} | {case['oracle']} | {number(case['worst'])} | {number(case['allowed'])} |\n"
    if refused:
        text += "\n" if measured else ""
        text += "| input without a result | error |\n|---|---|\n"
        for case in refused:
            message = " ".join(case["error"].split()).replace("|", "\\|")
            message = message if len(message) <= 160 else message[:159] + "…"
            text += f"| {case['name']} | {message} |\n"
    return text


def main() -> None:
    found = cases()
    groups = sorted({case["group"] for case in found})
    page = INTRODUCTION + f"\n{len(found)} cases.\n"
    for group in groups:
        page += f"\n## {group}\n\n" + table([case for case in found if case["group"] == group])
    PAGE.write_text(page, encoding="utf-8")
    print(f"{len(found)} cases in {PAGE.relative_to(ROOT)}")


if __name__ == "__main__":
    main()
