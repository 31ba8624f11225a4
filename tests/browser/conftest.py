"""Bakes for the package for three.js, and the fixtures of Blender."""

from __future__ import annotations

from pathlib import Path

import pytest
from bakes import folder_of
from in_blender import _factory_settings, _fresh_scene, _no_classes_left, _no_handlers_left, registered  # noqa: F401
from kept_chains import _kept_chains, pytest_runtest_setup  # noqa: F401
from kept_groups import _kept_groups  # noqa: F401


@pytest.fixture(scope="session")
def three_bake() -> Path:
    return folder_of("three")


@pytest.fixture(scope="session")
def octahedral_bake() -> Path:
    return folder_of("three octahedral")
