"""Interrupts at any moment of a bake: no further stage, one line, an exit status, and unchanged folders."""

from __future__ import annotations

import glob
import json
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
from command_line import BAKE, QUICK
from night import rest_at_night

LINE = "bake.py: cancelled, nothing was written"


def start(source: Path, out: Path, temporary: Path) -> subprocess.Popen[str]:
    """Start a bake in a session of its own. Return it as soon as it handles signals."""
    temporary.mkdir(exist_ok=True)
    command = [sys.executable, BAKE, "--input", source, "--out", out, *QUICK, "--levels", "1"]
    process = subprocess.Popen(
        [str(each) for each in command],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "TMPDIR": str(temporary)},
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # The tests may run with SIGINT ignored.
    )
    while process.poll() is None and not handles(process.pid, signal.SIGTERM):
        time.sleep(0.001)
    return process


def handles(process: int, number: signal.Signals) -> bool:
    """Return whether the process catches the signal, or waits for it. Python by itself does neither for SIGTERM."""
    lines = Path(f"/proc/{process}/status").read_text().splitlines()
    sets = [int(line.split()[1], 16) for line in lines if line.startswith(("SigCgt:", "SigBlk:"))]
    return any(each >> (number - 1) & 1 for each in sets)


@pytest.fixture(scope="module")
def seconds(shrub: Path, tmp_path_factory: pytest.TempPathFactory) -> float:
    """Return the duration of an uninterrupted bake."""
    folder = tmp_path_factory.mktemp("whole")
    process = start(shrub, folder / "out", folder / "temporary")
    begin = time.monotonic()
    process.communicate(timeout=200)
    assert process.returncode == 0
    assert not list((folder / "temporary").iterdir())
    return time.monotonic() - begin


MOMENTS = [
    *(
        pytest.param(signal.SIGINT, number / 20.0, marks=[pytest.mark.night] * (number % 10 > 0))
        for number in range(21)
    ),
    *rest_at_night((signal.SIGTERM, share) for share in (0.3, 0.0, 0.6)),
]


@pytest.mark.parametrize(("number", "share"), MOMENTS)
def test_an_interrupted_bake_begins_no_further_stage_and_changes_no_folder(
    number: signal.Signals, share: float, seconds: float, shrub: Path, tmp_path: Path
) -> None:
    out, temporary = tmp_path / "out", tmp_path / "temporary"
    out.mkdir()
    (out / "report.json").write_text("of an earlier bake")
    process = start(shrub, out, temporary)
    time.sleep(share * seconds)
    before = told_so_far(process)
    process.send_signal(number)
    _, after = process.communicate(timeout=100)
    # It begins no other stage; one may have begun between the reading and the signal.
    assert after.count("…\n") <= 1
    error = before + after
    *progress, line = error.splitlines() or [""]
    assert not list(temporary.iterdir())
    if share > 0.0 and process.returncode == 0:  # This bake was faster than the one that was timed.
        assert len(list(out.iterdir())) > 1
        return
    assert (process.returncode, line) == (128 + number, LINE), error
    assert all(stage.endswith("…") for stage in progress), error
    assert [(file.name, file.read_text()) for file in out.iterdir()] == [("report.json", "of an earlier bake")]


def told_so_far(process: subprocess.Popen[str]) -> str:
    """Return what a running process has printed on standard error."""
    assert process.stderr is not None
    descriptor, parts = process.stderr.fileno(), [b""]
    os.set_blocking(descriptor, False)
    with suppress(BlockingIOError):
        while part := os.read(descriptor, 65536):
            parts.append(part)
    os.set_blocking(descriptor, True)
    return b"".join(parts).decode()


def wait_for(pattern: str, folder: Path, process: subprocess.Popen[str]) -> None:
    """Wait until the folder of a running bake has a file or folder that matches the pattern."""
    while not glob.glob(pattern, root_dir=folder):  # Path.glob fails where a folder vanishes while it looks.
        assert process.poll() is None, f"the bake ended without {pattern}"
        time.sleep(0.001)


@pytest.mark.night
def test_an_interrupted_bake_removes_the_folders_it_made(shrub: Path, tmp_path: Path) -> None:
    process = start(shrub, tmp_path / "new" / "out", tmp_path / "temporary")
    wait_for("new/out/.leafcloud-*", tmp_path, process)
    os.killpg(process.pid, signal.SIGINT)
    process.communicate(timeout=100)
    assert process.returncode == 130
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(
    "pattern",
    rest_at_night(
        [
            "temporary/leafcloud-bake-*",
            "out/.leafcloud-*/*_LOD0.glb",
            "out/.leafcloud-*/*.blend",
        ]
    ),
)
def test_the_bake_after_a_killed_one_removes_all_that_it_left(pattern: str, shrub: Path, tmp_path: Path) -> None:
    out, temporary = tmp_path / "out", tmp_path / "temporary"
    killed = start(shrub, out, temporary)
    wait_for(pattern, tmp_path, killed)
    killed.kill()
    killed.communicate(timeout=100)
    assert list(temporary.iterdir()), "it had no time to clean up"
    again = start(shrub, out, temporary)
    again.communicate(timeout=200)
    assert again.returncode == 0
    assert not list(temporary.iterdir())
    assert {file.name for file in out.iterdir()} == set(json.loads((out / "report.json").read_text())["files"])
