"""Waiting for a job of the core. The job runs on a separate thread and never touches Blender."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Protocol, TypeVar

Progress = Callable[[str, float], None]
"""Function called with the name of the stage and the fraction done, in [0, 1]."""

POLL_SECONDS = 0.1

_WORDS = {
    "prepare": "read leaves",
    "measure": "see what leaves hide",
    "simplify": "simplify leaves",
    "fit": "find planes",
    "pack": "arrange textures",
    "bake": "draw textures",
    "tune": "match colors",
    "refine": "improve textures",
    "draw": "compare pictures",
    "order": "sort triangles",
    "build": "make levels",
}
"""What stages do, in a person's words; the names of the others tell it."""


def stage_words(stage: str) -> str:
    """Return a stage in words: "TREE: fit" as "TREE: find planes"."""
    tree, colon, kind = stage.rpartition(": ")
    return f"{tree}{colon}{_WORDS.get(kind, kind)}"


class StageClock:
    """Progress that is passed on, with the seconds of each stage. They add up to the time since `started`."""

    def __init__(self, progress: Progress, started: float | None = None) -> None:
        """`started`: a value of `time.monotonic()`. Until the first stage the time counts as "start"."""
        self._progress = progress
        self._seconds: dict[str, float] = {}
        self._stage, self._begin = "start", time.monotonic() if started is None else started

    def __call__(self, stage: str, fraction: float) -> None:
        kind = stage.partition(" ")[0]  # Of "write NAME.glb" the first word.
        if kind != self._stage:
            self._close()
            self._stage = kind
        self._progress(stage, fraction)

    def seconds(self) -> dict[str, float]:
        """Return the seconds of each stage so far, in the order of their first beginnings."""
        self._close()
        return dict(self._seconds)

    def _close(self) -> None:
        now = time.monotonic()
        self._seconds[self._stage] = self._seconds.get(self._stage, 0.0) + now - self._begin
        self._begin = now


_T_co = TypeVar("_T_co", covariant=True)


class Job(Protocol[_T_co]):
    """Interface of `leafcloud.Job`, and of several jobs in sequence."""

    @property
    def stage(self) -> str: ...
    @property
    def fraction(self) -> float: ...
    @property
    def done(self) -> bool: ...
    def cancel(self) -> None: ...
    def result(self, timeout: float | None = None) -> _T_co: ...


def wait(job: Job[_T_co], progress: Progress) -> _T_co:
    """Wait for the job and return its result. Call `progress` about ten times a second.

    Raise the job's own error. Cancel the job if another exception, such as `KeyboardInterrupt`, ends the wait.
    """
    try:
        while True:
            try:
                return job.result(timeout=POLL_SECONDS)
            except TimeoutError:
                progress(job.stage or "start", job.fraction)  # Before the first stage the name is empty.
    except BaseException:
        job.cancel()
        raise
