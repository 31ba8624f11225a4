"""Waiting for the core, which works on a thread of its own and never touches Blender."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import leafcloud

Progress = Callable[[str, float], None]
"""Called with the name of the stage and the share of it that is done, in [0, 1]."""

POLL_SECONDS = 0.1

_T = TypeVar("_T")


def wait(job: leafcloud.Job[_T], progress: Progress) -> _T:
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
