"""Work on Blender's main thread in steps. The interface draws between two steps.

Work in steps is a generator: each `yield` ends a step. Its return value is the result. If the generator is closed, the
work ends at that `yield`, and undoes its changes.
"""

from __future__ import annotations

from collections.abc import Generator
from typing import TypeAlias, TypeVar

_T = TypeVar("_T")

Steps: TypeAlias = Generator[None, None, _T]


def all_steps(steps: Steps[_T]) -> _T:
    """Do all steps, and return the result."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value
