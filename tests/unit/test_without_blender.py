"""Tests in this folder run without Blender."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

COLLECT = (
    "import sys, pytest; sys.modules['bpy'] = None; sys.exit(pytest.main(['--collect-only', '-q', *sys.argv[1:]]))"
)


def test_no_test_here_imports_blender() -> None:
    command = [sys.executable, "-c", COLLECT, str(Path(__file__).parent)]
    collected = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert collected.returncode == 0, collected.stdout
