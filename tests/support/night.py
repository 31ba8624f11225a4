"""Cases of a test that only `make test-night` runs."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def rest_at_night(cases: Iterable[Any], by_day: int = 1) -> list[Any]:
    """Return the cases for `pytest.mark.parametrize`, marked `night` after the first `by_day`."""
    return [case if number < by_day else _at_night(case) for number, case in enumerate(cases)]


def _at_night(case: Any) -> Any:
    if isinstance(case, tuple) and hasattr(case, "marks"):  # A pytest.param.
        return pytest.param(*case.values, marks=[*case.marks, pytest.mark.night], id=case.id)
    return pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=pytest.mark.night)
