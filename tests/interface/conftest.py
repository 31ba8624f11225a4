"""The extension's zip, installed in a real Blender with a window. See `blender_window.py` for what that needs."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from blender_window import Window, command, environment_of, missing, opened

ROOT = Path(__file__).resolve().parents[2]
PICTURES = Path(os.environ.get("LEAFCLOUD_PICTURES", ROOT / "out" / "interface"))
"""Folder of the captures."""


_SIDEBAR = """
view = next(area for area in bpy.context.window_manager.windows[0].screen.areas if area.type == "VIEW_3D")
sidebar = next(region for region in view.regions if region.type == "UI")
"""


@pytest.fixture(scope="module")
def blender(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Iterator[Window]:
    """Return a Blender with the extension and its tab in the sidebar. All tests of a file use the same one."""
    if missing():
        pytest.skip(f"needs {missing()}")
    work = tmp_path_factory.mktemp("blender")
    [archive] = (ROOT / "dist").glob("leafcloud-*.zip")
    subprocess.run(
        [*command(), "--command", "extension", "install-file", "-r", "user_default", "-e", str(archive)],
        env=environment_of(work),
        check=True,
        capture_output=True,
        timeout=120,
    )
    with opened(work, PICTURES / request.path.stem.removeprefix("test_")) as window:
        window.keys("Escape")  # The splash screen.
        window.move(600, 500)
        while window.run(f"{_SIDEBAR}result = sidebar.width") <= 1:
            window.keys("n")  # A window that has just opened loses keys.
            window.settle(0.5)
        window.run(f"{_SIDEBAR}sidebar.active_panel_category = 'Leafcloud'")
        window.settle(1.0)
        yield window
