"""The plan's decision on one effect."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Decision:
    """State of an effect, the reason for it, and its estimated cost.

    on: None while undecided; the bake then decides for each cloud. reason: one sentence.
    seconds, bytes: the estimated cost (`plan.costs`).
    """

    name: str
    on: bool | None
    reason: str
    seconds: float = 0.0
    bytes: int = 0


def is_on(decisions: Sequence[Decision], name: str) -> bool | None:
    """Return whether the effect `name` is on; None while it is undecided. Raises `KeyError` for an unplanned name."""
    for decision in decisions:
        if decision.name == name:
            return decision.on
    raise KeyError(name)


def first_on(decisions: Sequence[Decision], names: Sequence[str]) -> str:
    """Return the first name of an effect that is on; the first of `names` if all are off."""
    return next((name for name in names if is_on(decisions, name)), names[0])
