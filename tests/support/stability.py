"""Hard cases: what was measured is asserted here, and recorded for docs/stability.md when ``LEAFCLOUD_STABILITY`` names
a file (``make bench-stability``). Each line of that file is a case in JSON, as the Rust tests write it."""

from __future__ import annotations

import json
import math
import os


def holds(group: str, name: str, oracle: str, worst: float, allowed: float) -> None:
    """The greatest error is at most what the oracle allows."""
    finite = [value if math.isfinite(value) else None for value in (float(worst), float(allowed))]
    _record(group, name, oracle, {"worst": finite[0], "allowed": finite[1]})
    assert worst <= allowed, f"{group} · {name}: {worst}, allowed {allowed} ({oracle})"


def refuses(group: str, name: str, error: BaseException, naming: str) -> None:
    """There is no result, and the error says why."""
    _record(group, name, "a named error", {"error": str(error)})
    assert naming in str(error), f"{group} · {name}: {error}, which does not name {naming!r}"


def _record(group: str, name: str, oracle: str, outcome: dict[str, float | str | None]) -> None:
    if path := os.environ.get("LEAFCLOUD_STABILITY"):
        with open(path, "a", encoding="utf-8") as file:
            file.write(
                json.dumps({"group": group, "name": name, "oracle": oracle, **outcome}, ensure_ascii=False) + "\n"
            )
