"""Fixtures of all tests: the shrub, the measured trees, the glTF validator; none of them needs Blender."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from times import pytest_fixture_setup, pytest_runtest_logreport, pytest_sessionfinish  # noqa: F401 - hooks

ROOT = Path(__file__).resolve().parents[1]
SHRUB = ROOT / "examples" / "shrub.glb"
FOLIAGE = ROOT.parent / "shared" / "foliage"
VALIDATOR = ROOT / "tests" / "gltf_validator"


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark tests in tests/browser and tests of the measured trees; leave the latter out if the trees are missing."""
    measured = [item for item in items if "foliage_dir" in getattr(item, "fixturenames", ())]
    for item in measured:
        item.add_marker("night")
    for item in items:
        if item.path.parent.name == "browser":
            item.add_marker("browser")
    lacking = set() if FOLIAGE.is_dir() else set(measured)
    config.hook.pytest_deselected(items=[item for item in items if item in lacking])
    items[:] = [item for item in items if item not in lacking]


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Run a test with the argument `tree_path` on the shrub and on every measured tree."""
    if "tree_path" in metafunc.fixturenames:
        measured = [pytest.param(tree, marks=pytest.mark.night) for tree in sorted(FOLIAGE.glob("*.glb"))]
        metafunc.parametrize("tree_path", [SHRUB, *measured], ids=lambda tree: tree.stem)


@pytest.fixture(scope="session")
def shrub() -> Path:
    """The small tree of the repository: 672 leaf cards (node `leaves`) and their `branches`."""
    return SHRUB


@pytest.fixture(scope="session")
def foliage_dir() -> Path:
    """The folder of the measured trees."""
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
