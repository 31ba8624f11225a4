"""The checks of `make bench-refine`: an error that grows at one size, and a coverage that leaves its range, fail."""

from __future__ import annotations

from typing import Any

import pytest

from bench.refine_checks import failures, summary

SIZES = ("512", "256", "128", "64", "32")


def level(error: float, coverage: float = 1.0) -> dict[str, Any]:
    return {**dict.fromkeys(SIZES, error), "coverage": coverage}


def results() -> dict[str, Any]:
    """Return results of a tree with half of the error after refinement."""
    levels = {name: level(error) for name, error in (("off", 0.2), ("short", 0.1), ("long", 0.1))}
    cycles = {name: level(0.1) for name in ("off", "short", "long")}
    suns = {name: {"normals": [0.1, 0.05], "colors": [0.1, 0.05]} for name in ("off", "short", "long")}
    return {"tree": "elm", "levels": levels, "cycles": cycles, "suns": suns}


def test_smaller_errors_and_the_leaves_coverage_pass() -> None:
    assert failures([results()]) == []
    assert "1.000 of that before (elm, short in Cycles, 512²)" in summary([results()])


def test_an_error_that_grows_within_the_tolerance_passes() -> None:
    row = results()
    row["levels"]["long"]["64"] = 0.2 * 1.0099
    assert failures([row]) == []
    assert "1.010 of that before (elm, long, 64²)" in summary([row])


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("effort", ["short", "long"])
def test_an_error_that_grows_at_one_size_fails(effort: str, size: str) -> None:
    for place, expected, error in (("levels", effort, 0.2), ("cycles", f"{effort} in Cycles", 0.1)):
        row = results()
        row[place][effort][size] = error * 1.02
        assert failures([row]) == [f"elm, {expected}, {size}²: 1.020 of the error before, more than 1.01"]
        assert expected in summary([row])


def test_an_error_that_grows_under_suns_fails() -> None:
    row = results()
    row["suns"]["long"]["colors"] = [0.1, 0.051]
    assert failures([row]) == ["elm, long under suns, colors, 32²: 1.020 of the error before, more than 1.01"]


@pytest.mark.parametrize("coverage", [0.984, 1.016])
def test_a_coverage_outside_of_its_range_fails(coverage: float) -> None:
    row = results()
    row["levels"]["short"]["coverage"] = coverage
    assert failures([row]) == [f"elm, short: coverage {coverage:.3f}, not in 0.985 to 1.015"]


def test_an_error_that_is_no_number_fails() -> None:
    row = results()
    row["levels"]["short"]["32"] = float("nan")
    assert len(failures([row])) == 1


def test_results_without_cycles_pass() -> None:
    row = results()
    del row["cycles"]
    assert failures([row]) == []


def test_no_results_are_no_success() -> None:
    assert summary([]) == "Nothing is measured yet."
