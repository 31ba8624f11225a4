"""Waiting for the core, which works on a thread of its own and never touches Blender."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeVar

Progress = Callable[[str, float], None]
"""Called with the name of the stage and the share of it that is done, in [0, 1]."""

POLL_SECONDS = 0.1

_T_co = TypeVar("_T_co", covariant=True)


class Job(Protocol[_T_co]):
    """What `leafcloud.Job` can, or several of them one after the other."""

    @property
    def stage(self) -> str: ...
    @property
    def fraction(self) -> float: ...
    @property
    def done(self) -> bool: ...
    def cancel(self) -> None: ...
    def result(self, timeout: float | None = None) -> _T_co: ...


def wait(job: Job[_T_co], progress: Progress) -> _T_co:
    """The job's result, with `progress` called about ten times a second while it works.

    Raises the job's own error. When anything else stops the waiting, `KeyboardInterrupt` for one, the job is cancelled.
    """
    try:
        while True:
            try:
                return job.result(timeout=POLL_SECONDS)
            except TimeoutError:
                progress(job.stage or "start", job.fraction)  # It has no name before the first stage.
    except BaseException:
        job.cancel()
        raise
