"""Assertions for hard cases. They also record the results for docs/stability.md.

If ``LEAFCLOUD_STABILITY`` names a file, each case becomes a line of JSON in the file, in the format of the Rust tests.
``make bench-stability`` sets the variable.
"""

from __future__ import annotations

import json
import math
import os


def holds(group: str, name: str, oracle: str, worst: float, allowed: float) -> None:
    """Record the case, and fail if the largest error exceeds the oracle's limit."""
    finite = [value if math.isfinite(value) else None for value in (float(worst), float(allowed))]
    _record(group, name, oracle, {"worst": finite[0], "allowed": finite[1]})
    assert worst <= allowed, f"{group} · {name}: {worst}, allowed {allowed} ({oracle})"


def refuses(group: str, name: str, error: BaseException, naming: str) -> None:
    """Record the refusal, and fail if its message does not contain `naming`."""
    _record(group, name, "a named error", {"error": str(error)})
    assert naming in str(error), f"{group} · {name}: {error}, which does not name {naming!r}"


def _record(group: str, name: str, oracle: str, outcome: dict[str, float | str | None]) -> None:
    if path := os.environ.get("LEAFCLOUD_STABILITY"):
        with open(path, "a", encoding="utf-8") as file:
            file.write(
                json.dumps({"group": group, "name": name, "oracle": oracle, **outcome}, ensure_ascii=False) + "\n"
            )
