"""What all tests share: an isolated Blender, a fresh scene for each test, the trees, the glTF validator."""

from __future__ import annotations

import atexit
import json
import os
import subprocess
import tempfile
import typing
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

# Blender reads and writes its configuration here, never in the user's own.
_RESOURCES = tempfile.TemporaryDirectory(prefix="leafcloud-tests-")
os.environ["BLENDER_USER_RESOURCES"] = _RESOURCES.name

import bpy

ROOT = Path(__file__).resolve().parent.parent
SHRUB = ROOT / "examples" / "shrub.glb"
FOLIAGE = ROOT.parent / "shared" / "foliage"
VALIDATOR = ROOT / "tests" / "gltf_validator"


@atexit.register
def _free_cached_types() -> None:
    """Lets Blender 4.2 exit: it crashes while anything still refers to ``bpy``, as its glTF exporter's type hints do.

    ``typing`` caches what its generics were made of, here classes whose methods refer to ``bpy``.
    """
    for clear_cache in typing._cleanups:
        clear_cache()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--half", type=int, choices=(1, 2), help="every other file, from the first or the second")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leaves out what is not in the half that is asked for, and the measured trees where they do not lie beside."""
    files = list(dict.fromkeys(item.path for item in items))
    half = config.getoption("half")
    wanted = set(files if half is None else files[half - 1 :: 2])

    def is_left_out(item: pytest.Item) -> bool:
        needs_trees = "foliage_dir" in getattr(item, "fixturenames", ())
        return item.path not in wanted or (needs_trees and not FOLIAGE.is_dir())

    config.hook.pytest_deselected(items=[item for item in items if is_left_out(item)])
    items[:] = [item for item in items if not is_left_out(item)]


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Runs a test that asks for ``tree_path`` on the shrub and on every measured tree that there is."""
    if "tree_path" in metafunc.fixturenames:
        trees = [SHRUB, *sorted(FOLIAGE.glob("*.glb"))]
        metafunc.parametrize("tree_path", trees, ids=[tree.stem for tree in trees])


@pytest.fixture(autouse=True)
def _fresh_scene() -> None:
    """Starts every test in Blender's factory settings with an empty scene."""
    bpy.ops.wm.read_factory_settings(use_empty=True)


@pytest.fixture(autouse=True)
def _no_handlers_left(_fresh_scene: None) -> Iterator[None]:
    """Fails a test that leaves functions in Blender's handlers: at exit they crash Blender 4.2 and hang 4.5."""
    before = _handlers()
    yield
    left = [(name, function) for name, function in _handlers() if (name, function) not in before]
    for name, function in left:
        getattr(bpy.app.handlers, name).remove(function)
    assert not left, f"left in bpy.app.handlers: {left}"


@pytest.fixture
def registered(_no_handlers_left: None) -> Iterator[None]:
    """Registers the add-on during a test."""
    import addon

    addon.register()
    yield
    addon.unregister()


@pytest.fixture(autouse=True, scope="session")
def _no_classes_left() -> Iterator[None]:
    """Fails the run when classes of the add-on are still registered at its end: they crash and hang Blender, too."""
    yield
    bases = (bpy.types.Operator, bpy.types.Panel, bpy.types.PropertyGroup, bpy.types.AddonPreferences)
    classes = [each for base in bases for each in base.__subclasses__() if each.__module__.startswith("addon.")]
    left = [each for each in classes if each.is_registered]
    for each in left:
        bpy.utils.unregister_class(each)
    assert not left, f"left registered: {left}"


def _handlers() -> list[tuple[str, Callable[..., Any]]]:
    """All functions in ``bpy.app.handlers`` with the names of their lists."""
    lists = {name: getattr(bpy.app.handlers, name) for name in dir(bpy.app.handlers)}
    return [
        (name, function) for name, functions in lists.items() if isinstance(functions, list) for function in functions
    ]


@pytest.fixture(scope="session")
def shrub() -> Path:
    """The small tree that comes with the repository: 672 leaf cards (node ``leaves``) and its ``branches``."""
    return SHRUB


@pytest.fixture(scope="session")
def foliage_dir() -> Path:
    """The folder of the measured trees. Tests that ask for it are left out where there is none."""
    return FOLIAGE


@pytest.fixture(scope="session")
def gltf_issues() -> Callable[..., list[dict[str, Any]]]:
    """``gltf_issues(path, …)``: the errors and warnings of the Khronos validator in .glb files, one dictionary each.

    The keys are ``path``, ``code``, ``message``, ``severity`` (0 error, 1 warning) and, where known, ``pointer``.
    """

    def issues(*paths: Path) -> list[dict[str, Any]]:
        assert (VALIDATOR / "node_modules").is_dir(), f"run `npm ci --prefix {VALIDATOR}` (make test does) first"
        command = ["node", str(VALIDATOR / "validate.mjs"), *map(str, paths)]
        found = json.loads(subprocess.run(command, check=True, capture_output=True, text=True, timeout=240).stdout)
        return [
            {"path": path, **message}
            for path, messages in found.items()
            for message in messages
            if message["severity"] <= 1
        ]

    return issues
