"""Waiting for a job of the core. The job runs on a separate thread and never touches Blender."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeVar

Progress = Callable[[str, float], None]
"""Function called with the name of the stage and the fraction done, in [0, 1]."""

POLL_SECONDS = 0.1

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
