"""Bakes for the package for three.js, and the fixtures of Blender."""

from __future__ import annotations

from pathlib import Path

import pytest
from command_line import QUICK, bake
from in_blender import _fresh_scene, _no_classes_left, _no_handlers_left, registered  # noqa: F401


@pytest.fixture(scope="session")
def three_bake(shrub: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("three")
    bake(shrub, out, *QUICK, "--engine", "three", "--last", "cross", "--effects=+transitions,+pruning,+wind")
    return out


@pytest.fixture(scope="session")
def octahedral_bake(shrub: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("octahedral")
    bake(shrub, out, *QUICK, "--engine", "three", "--last", "octahedral", "--effects=+transitions")
    return out
