"""Chains that the tests of a process build more than once: the first is kept, since chains never change.

The key is everything that the core gets: arrays, materials and options. Tests marked `fresh` build their own chains:
those that measure memory, compare the bytes of two bakes, or forbid a bake to call some code.
"""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from collections.abc import Callable, Iterator
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest

import leafcloud
from addon.bake import part, pipeline

MOST_CHAINS, MOST_KEYS = 32, 1000
"""Chains and keys that a process keeps: some MB for a chain, with the objects of the core some for a key."""

_fresh = False
_chains: OrderedDict[str, leafcloud.Chain] = OrderedDict()
_keys: OrderedDict[int, tuple[object, str]] = OrderedDict()
"""Keys of the last objects of the core, by identity. The object is kept, too, so that no other gets its identity."""


class Ended:
    """A job that has ended, with the interface of `leafcloud.Job`."""

    stage, fraction, done = "bake", 1.0, True

    def __init__(self, chain: leafcloud.Chain) -> None:
        self.best = chain

    def cancel(self) -> None:
        """Do nothing."""

    def result(self, timeout: float | None = None) -> leafcloud.Chain:
        return self.best


class Watched:
    """A job that keeps its chain."""

    def __init__(self, job: leafcloud.Job[leafcloud.Chain], key: str) -> None:
        self._job, self._key = job, key

    def __getattr__(self, name: str) -> Any:
        return getattr(self._job, name)

    def result(self, timeout: float | None = None) -> leafcloud.Chain:
        chain = self._job.result(timeout)
        _remember(_chains, self._key, chain, MOST_CHAINS)
        return chain


def _remember(store: OrderedDict[Any, Any], key: Any, value: Any, most: int) -> None:
    store[key] = value
    while len(store) > most:
        store.popitem(last=False)


def _key(value: object) -> str:
    """Return the same text for equal values only."""
    if id(value) in _keys:
        return _keys[id(value)][1]
    if isinstance(value, np.ndarray):
        return f"{value.dtype.str}{value.shape}{hashlib.sha256(np.ascontiguousarray(value)).hexdigest()}"
    if isinstance(value, dict):
        return f"{{{', '.join(f'{name}: {_key(each)}' for name, each in sorted(value.items()))}}}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_key, value))}]"
    assert value is None or isinstance(value, str | int | float), f"no key for {value!r}"
    return repr(value)


def _with_key(make: Callable[..., Any]) -> Callable[..., Any]:
    def made(*arguments: Any, **options: Any) -> Any:
        result = make(*arguments, **options)
        _remember(
            _keys, id(result), (result, hashlib.sha256(_key([arguments, options]).encode()).hexdigest()), MOST_KEYS
        )
        return result

    return made


def is_fresh() -> bool:
    """Return whether the running test keeps nothing."""
    return _fresh


def _start(foliage: leafcloud.Foliage, **options: Any) -> Any:
    if is_fresh():
        return leafcloud.start_chain(foliage, **options)
    key = _key([foliage, options])
    if key in _chains:
        _chains.move_to_end(key)
        return Ended(_chains[key])
    return Watched(leafcloud.start_chain(foliage, **options), key)


class _Core:
    """The module leafcloud with some names replaced."""

    def __init__(self, **replaced: object) -> None:
        self.__dict__ |= replaced

    def __getattr__(self, name: str) -> Any:
        return getattr(leafcloud, name)


@pytest.fixture(autouse=True, scope="session")
def _kept_chains() -> Iterator[None]:
    """Keep the chains of all bakes in this process."""
    described = _Core(Foliage=_with_key(leafcloud.Foliage), Material=_with_key(leafcloud.Material))
    with patch.object(part, "leafcloud", described), patch.object(pipeline, "leafcloud", _Core(start_chain=_start)):
        yield


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Keep no chain during a test marked `fresh` and during the fixtures that are made for it."""
    global _fresh
    _fresh = item.get_closest_marker("fresh") is not None
