"""Checks the promises of a refinement on the results of `refine.py`: no error grows, and coverage stays."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

SIZES = (512, 256, 128, 64, 32)
"""Sides of the compared pictures in pixels."""
SUN_SIZES = (128, 32)
"""Sides of the pictures under suns."""
REFINED = ("short", "long")
TOLERANCE = 0.01
"""How much larger the error of a refined level may be than that of the same level before: the error of the sampling."""
COVERAGE = (0.985, 1.015)
"""Range of a refined level's coverage, relative to the leaves."""


def ratios(row: dict[str, Any]) -> Iterator[tuple[str, float]]:
    """Yield the name of each comparison of a tree, and its error after refinement relative to that before."""
    renderers = {"": row["levels"]}
    if "cycles" in row:
        renderers[" in Cycles"] = row["cycles"]
    for renderer, found in renderers.items():
        for name in REFINED:
            for size in SIZES:
                yield f"{row['tree']}, {name}{renderer}, {size}²", found[name][str(size)] / found["off"][str(size)]
    for way, before in row["suns"]["off"].items() if "suns" in row else ():
        for name in REFINED:
            for size, own, first in zip(SUN_SIZES, row["suns"][name][way], before, strict=True):
                yield f"{row['tree']}, {name} under suns, {way}, {size}²", own / first


def failures(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Return a line for each refined level that is worse than before at a size, or covers too much or too little."""
    worse = [
        f"{name}: {ratio:.3f} of the error before, more than {1.0 + TOLERANCE:g}"
        for row in rows
        for name, ratio in ratios(row)
        if not ratio <= 1.0 + TOLERANCE
    ]
    low, high = COVERAGE
    covered = [(row["tree"], name, row["levels"][name]["coverage"]) for row in rows for name in REFINED]
    outside = [
        f"{tree}, {name}: coverage {value:.3f}, not in {low} to {high}"
        for tree, name, value in covered
        if not low <= value <= high
    ]
    return worse + outside


def summary(rows: Sequence[dict[str, Any]]) -> str:
    """Return the result of the checks in words, with the comparison that is nearest to its limit."""
    found = failures(rows)
    if found:
        return "\n".join(["Refinement does not keep its promises:", "", *(f"- {line}" for line in found)])
    if not rows:
        return "Nothing is measured yet."
    name, ratio = max((each for row in rows for each in ratios(row)), key=lambda each: each[1])
    covered = [row["levels"][effort]["coverage"] for row in rows for effort in REFINED]
    return (
        f"No refined level is worse than before by more than {TOLERANCE:.0%} at any size from {SIZES[-1]}² to "
        f"{SIZES[0]}². The largest error is {ratio:.3f} of that before ({name}). Coverage is {min(covered):.3f} to "
        f"{max(covered):.3f}, within {COVERAGE[0]} to {COVERAGE[1]}."
    )
