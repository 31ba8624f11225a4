"""Registration of the extension in bpy: a script that leaves it registered ends."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.version

ROOT = Path(__file__).resolve().parents[2]


def test_a_script_that_does_not_unregister_ends() -> None:
    script = "import bpy, addon; addon.register(); assert bpy.context.scene.leafcloud"
    subprocess.run([sys.executable, "-c", script], cwd=ROOT, check=True, timeout=60, capture_output=True)


def test_handlers_are_added_once_and_removed() -> None:
    script = """
import bpy, addon
def count():
    lists = [getattr(bpy.app.handlers, name) for name in dir(bpy.app.handlers)]
    return sum(len(each) for each in lists if isinstance(each, list))
before = count()
for _ in range(3):
    addon.register()
    assert count() == before + 10, count()
    addon.unregister()
    assert count() == before
"""
    subprocess.run([sys.executable, "-c", script], cwd=ROOT, check=True, timeout=60, capture_output=True)
