"""Bakes with closed or full standard streams: they go on, and the exit status tells whether all files were written."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from command_line import BAKE, QUICK, ROOT
from night import rest_at_night

STREAMS = ["2>&-", ">&-", "<&- >&- 2>&-", ">/dev/full", "2>/dev/full"]


def status(streams: str, *arguments: object) -> int:
    """Run bake.py with redirected streams. Return the exit status."""
    command = ["bash", "-c", f'exec "$@" {streams}', "bash", sys.executable, BAKE, *arguments]
    return subprocess.run([str(each) for each in command], capture_output=True, timeout=200, check=False).returncode


def is_complete(out: Path) -> bool:
    return {file.name for file in out.iterdir()} == set(json.loads((out / "report.json").read_text())["files"])


@pytest.mark.parametrize("streams", rest_at_night(STREAMS))
def test_a_bake_without_streams_writes_all_files(streams: str, shrub: Path, tmp_path: Path) -> None:
    assert status(streams, "--input", shrub, "--out", tmp_path / "out", *QUICK, "--levels", 1) == 0
    assert is_complete(tmp_path / "out")


def test_a_bake_goes_on_after_its_reader_has_ended(shrub: Path, tmp_path: Path) -> None:
    arguments = ["--input", shrub, "--out", tmp_path / "out", *QUICK, "--levels", 1]
    process = subprocess.Popen(
        [sys.executable, str(BAKE), *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    for stream in (process.stdout, process.stderr):
        assert stream
        stream.close()
    assert process.wait(200) == 0
    assert is_complete(tmp_path / "out")


@pytest.mark.parametrize("streams", STREAMS)
def test_a_refusal_without_streams_keeps_its_status(streams: str, tmp_path: Path) -> None:
    assert status(streams, "--input", tmp_path / "gone.glb", "--out", tmp_path / "out") == 1
    assert status(streams, "--nonsense") == 2


def test_a_closed_stream_is_the_null_device(tmp_path: Path) -> None:
    """Else the next file would get the number 2, and the messages."""
    lines = f"""
import os, sys
sys.path.insert(0, {str(ROOT)!r})
from addon import ending
ending.open_closed_streams()
with open("file", "w"):
    print("a message", file=sys.stderr, flush=True)
    os.write(2, b"another")
"""
    subprocess.run(["bash", "-c", 'exec "$@" 2>&-', "bash", sys.executable, "-c", lines], cwd=tmp_path, check=True)
    assert (tmp_path / "file").read_bytes() == b""
