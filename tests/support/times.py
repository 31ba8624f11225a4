"""Hooks of pytest that record how long each test and each of its fixtures took. `make test-times` prints the record.

Seconds of a test: its setup, its call and its teardown. Fixtures count in the test that asked for them first.
"""

from __future__ import annotations

import json
import os
import time
from collections import defaultdict
from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest

FOLDER = Path(__file__).resolve().parents[2] / "target" / "times"
LONG = 0.5
"""Seconds. Fixtures that take less are not recorded."""

_seconds: dict[str, float] = defaultdict(float)
_fixtures: dict[str, dict[str, float]] = {}


@pytest.hookimpl(wrapper=True)
def pytest_fixture_setup(
    fixturedef: pytest.FixtureDef[Any], request: pytest.FixtureRequest
) -> Generator[None, Any, Any]:
    begin = time.perf_counter()
    try:
        return (yield)
    finally:
        took = time.perf_counter() - begin
        test = getattr(request, "_pyfuncitem", None)  # `request.node` is a module for a fixture of a module.
        if took > LONG and test is not None:
            test.user_properties.append(("fixture", (fixturedef.argname, took)))


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """With several processes, the first one gets the reports of all."""
    _seconds[report.nodeid] += report.duration
    fixtures = dict(value for name, value in report.user_properties if name == "fixture")
    if fixtures:
        _fixtures[report.nodeid] = fixtures


def pytest_sessionfinish(session: pytest.Session) -> None:
    name = os.environ.get("LEAFCLOUD_TIMES")  # tools/run_tests.sh names the run.
    if name is None or hasattr(session.config, "workerinput"):
        return
    FOLDER.mkdir(parents=True, exist_ok=True)
    rows = [[test, seconds, _fixtures.get(test, {})] for test, seconds in _seconds.items()]
    (FOLDER / f"{name}.json").write_text(json.dumps(rows))
