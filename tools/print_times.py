"""Prints where the time of the last run of the tests went: `make test-times`.

Phases come from tools/phase.sh, tests from tests/support/times.py; both write into target/times. Several processes run
at once: the tests of a phase take longer than the phase.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

FOLDER = Path(__file__).resolve().parents[1] / "target" / "times"
SLOWEST = 60


def main() -> None:
    """Print the phases, then the slowest tests with their fixtures and the slowest files."""
    phases = FOLDER / "phases.tsv"
    if not phases.exists():
        sys.exit("leafcloud: no run is recorded; `make test` and .ci/run record theirs.")
    rows = [line.split("\t") for line in phases.read_text().splitlines()]
    print("seconds  phase")
    for name, seconds, status in rows:
        print(f"{float(seconds):7.1f}  {name}{'' if status == '0' else f' (exit status {status})'}")
    tests = [
        (seconds, f"{file.stem}: {test}", fixtures)
        for file in sorted(FOLDER.glob("*.json"))
        for test, seconds, fixtures in json.loads(file.read_text())
    ]
    print(f"\nseconds  the {SLOWEST} slowest of {len(tests)} tests, with their fixtures of more than half a second")
    for seconds, test, fixtures in sorted(tests, key=lambda each: each[:2], reverse=True)[:SLOWEST]:
        made = ", ".join(f"{name} {took:.1f}" for name, took in fixtures.items())
        print(f"{seconds:7.1f}  {test}{f' ({made})' if made else ''}")
    files: dict[str, list[float]] = {}
    for seconds, test, _ in tests:
        files.setdefault(test.split("::")[0], []).append(seconds)
    folders: dict[str, float] = {}
    for seconds, test, _ in tests:
        folders[test.rsplit("/", 1)[0]] = folders.get(test.rsplit("/", 1)[0], 0.0) + seconds
    print("\nseconds  folder of tests")
    for name, of_folder in folders.items():
        print(f"{of_folder:7.1f}  {name}")
    print("\nseconds  tests  file")
    for name, all_seconds in sorted(files.items(), key=lambda each: sum(each[1]), reverse=True)[:SLOWEST]:
        print(f"{sum(all_seconds):7.1f}  {len(all_seconds):5}  {name}")


if __name__ == "__main__":
    main()
