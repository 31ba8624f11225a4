"""Seconds of the stages of a bake."""

from __future__ import annotations

import pytest

from addon.bake import job
from addon.bake.job import StageClock, stage_words


def test_the_seconds_of_the_stages_add_up(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 10.0
    monkeypatch.setattr(job.time, "monotonic", lambda: now)
    told: list[tuple[str, float]] = []
    clock = StageClock(lambda stage, fraction: told.append((stage, fraction)), started=7.0)
    for stage, fraction, seconds in [
        ("fit", 0.0, 2.0),
        ("fit", 0.5, 1.0),
        ("write oak.glb", 0.0, 4.0),
        ("fit", 0.9, 0.5),
    ]:
        clock(stage, fraction)
        now += seconds
    assert clock.seconds() == {"start": 3.0, "fit": 3.5, "write": 4.0}
    now += 1.0
    assert clock.seconds() == {"start": 3.0, "fit": 4.5, "write": 4.0}
    assert told == [("fit", 0.0), ("fit", 0.5), ("write oak.glb", 0.0), ("fit", 0.9)]


def test_stages_are_told_in_words() -> None:
    assert [stage_words(stage) for stage in ("fit", "Oak: fit", "write Oak.glb", "")] == [
        "find planes",
        "Oak: find planes",
        "write Oak.glb",
        "",
    ]
