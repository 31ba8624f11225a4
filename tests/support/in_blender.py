"""An isolated Blender, a fresh scene for each test, and checks that a test leaves nothing registered.

The conftest.py of every folder whose tests use Blender imports these fixtures.
"""

from __future__ import annotations

import atexit
import os
import tempfile
import typing
from collections.abc import Callable, Iterator
from typing import Any

import pytest

# Blender reads and writes its configuration here, never in the user's own.
_RESOURCES = tempfile.TemporaryDirectory(prefix="leafcloud-tests-")
os.environ["BLENDER_USER_RESOURCES"] = _RESOURCES.name

import bpy


@atexit.register
def _free_cached_types() -> None:
    """Clear the caches of ``typing`` at exit. Blender 4.2 crashes at exit while any object still refers to ``bpy``.

    ``typing`` caches the arguments of generics. The type hints of the glTF exporter refer to ``bpy`` in this way.
    """
    for clear_cache in typing._cleanups:
        clear_cache()


@pytest.fixture(autouse=True, scope="session")
def _factory_settings() -> None:
    bpy.ops.wm.read_factory_settings(use_empty=True)


@pytest.fixture(autouse=True)
def _fresh_scene(_factory_settings: None) -> None:
    """Start every test with an empty scene. Reading the settings anew for each would take seven times as long."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)


@pytest.fixture(autouse=True)
def _no_handlers_left(_fresh_scene: None) -> Iterator[None]:
    """Fail a test that leaves functions in Blender's handlers. At exit they crash Blender 4.2 and hang Blender 4.5."""
    before = _handlers()
    yield
    left = [(name, function) for name, function in _handlers() if (name, function) not in before]
    for name, function in left:
        getattr(bpy.app.handlers, name).remove(function)
    assert not left, f"left in bpy.app.handlers: {left}"


@pytest.fixture
def registered(_no_handlers_left: None) -> Iterator[None]:
    """Register the add-on during a test."""
    import addon

    addon.register()
    yield
    addon.unregister()


@pytest.fixture(autouse=True, scope="session")
def _no_classes_left() -> Iterator[None]:
    """Fail the run if classes of the add-on are still registered at its end. They crash and hang Blender, too."""
    yield
    bases = (bpy.types.Operator, bpy.types.Panel, bpy.types.PropertyGroup, bpy.types.AddonPreferences)
    classes = [each for base in bases for each in base.__subclasses__() if each.__module__.startswith("addon.")]
    left = [each for each in classes if each.is_registered]
    for each in left:
        bpy.utils.unregister_class(each)
    assert not left, f"left registered: {left}"


def _handlers() -> list[tuple[str, Callable[..., Any]]]:
    """Return all functions in ``bpy.app.handlers`` with the names of their lists."""
    lists = {name: getattr(bpy.app.handlers, name) for name in dir(bpy.app.handlers)}
    return [
        (name, function) for name, functions in lists.items() if isinstance(functions, list) for function in functions
    ]
