"""Work on Blender's main thread in steps. The interface draws between two steps.

Work in steps is a generator: each `yield` ends a step. Its return value is the result. If the generator is closed, the
work ends at that `yield`, and undoes its changes. Work that does not touch Blender runs on other threads meanwhile.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from typing import TypeAlias, TypeVar

_T = TypeVar("_T")

Steps: TypeAlias = Generator[None, None, _T]

WAITING_SECONDS = 0.05
"""Longest step that waits for another thread."""

TURN_SECONDS = 0.1


def all_steps(steps: Steps[_T]) -> _T:
    """Do all steps, and return the result."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value


def in_turns(steps: Steps[_T]) -> Steps[_T]:
    """Do steps in turns of about `TURN_SECONDS`: short ones would each wait for the interface to draw."""
    try:
        end = time.monotonic() + TURN_SECONDS
        while True:
            try:
                next(steps)
            except StopIteration as last:
                return last.value
            if time.monotonic() > end:
                yield
                end = time.monotonic() + TURN_SECONDS
    finally:
        steps.close()


def no_steps() -> Steps[None]:
    """Do nothing."""
    yield from ()


@contextmanager
def threads(count: int) -> Iterator[ThreadPoolExecutor]:
    """Yield a pool of threads that end after the work submitted in the block. Do not wait for them.

    If the block fails, work that has not begun is left out.
    """
    pool = ThreadPoolExecutor(count, thread_name_prefix="leafcloud")
    try:
        yield pool
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        raise
    pool.shutdown(wait=False)


def timed(work: Callable[[], _T]) -> tuple[_T, float]:
    """Do some work. Return its result and its seconds."""
    begin = time.perf_counter()
    return work(), time.perf_counter() - begin


def waited(work: Future[_T]) -> Steps[_T]:
    """Wait for work on another thread, in steps, and return its result."""
    while not wait([work], WAITING_SECONDS).done:
        yield
    return work.result()
