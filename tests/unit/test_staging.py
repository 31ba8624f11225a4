"""Folder writes that are all or nothing: processes that are killed at each step, and others that live."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from addon.export.staging import Staging

ROOT = Path(__file__).resolve().parents[2]
OLD = {"a": "old a", "b": "old b", "far": "old far"}
NEW = {"a": "new a", "b": "new b", "c": "new c"}

WRITER = """
import os, signal, sys, time
from pathlib import Path
from addon.export import staging

steps = int(sys.argv[2].replace("wait", "0"))
def counted(real):
    def call(*arguments, **named):
        global steps
        steps -= 1
        if steps == 0:
            os.kill(os.getpid(), signal.SIGKILL)
        return real(*arguments, **named)
    return call

for name in ("replace", "unlink", "rename"):
    setattr(os, name, counted(getattr(os, name)))
Path.write_text = counted(Path.write_text)
with staging.Staging(Path(sys.argv[1])) as files:
    for name in ("a", "b", "c"):
        files.path(name).write_text(f"new {name}")
    if sys.argv[2] == "wait":
        print("waits", flush=True)
        time.sleep(60)
    files.commit(["a", "far"])
print("done", flush=True)
"""


def write(folder: Path, steps: int = 0) -> subprocess.CompletedProcess[str]:
    """Write the new files in a process of its own, which kills itself at so many steps; 0: it does not."""
    command = [sys.executable, "-c", WRITER, str(folder), str(steps)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60, check=False)


@contextmanager
def waiting(folder: Path) -> Iterator[subprocess.Popen[str]]:
    """Run a process that has written its files and waits before the commit."""
    command = [sys.executable, "-c", WRITER, str(folder), "wait"]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "waits\n"
        try:
            yield process
        finally:
            process.kill()


def contents(folder: Path) -> dict[str, str]:
    return {file.name: file.read_text() for file in folder.iterdir() if file.is_file()}


def hidden_folders(folder: Path) -> list[Path]:
    return [each for each in folder.iterdir() if each.is_dir()]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, text in OLD.items():
        (tmp_path / name).write_text(text)
    return tmp_path


def test_the_next_writer_finds_the_old_files_or_the_new_ones(folder: Path) -> None:
    """Whatever the step at which a process is killed. Each file is whole at any time."""
    seen = set()
    for steps in range(1, 40):
        for name in (*OLD, *NEW):
            (folder / name).unlink(missing_ok=True)
        for name, text in OLD.items():
            (folder / name).write_text(text)
        ended = write(folder, steps)
        if "done" in ended.stdout:
            break
        assert ended.returncode == -signal.SIGKILL
        assert all(text in (OLD.get(name), NEW.get(name)) for name, text in contents(folder).items()), "whole"
        with Staging(folder):
            pass
        assert contents(folder) in (OLD, NEW), steps
        assert hidden_folders(folder) == []
        seen.add(contents(folder) == NEW)
    assert seen == {False, True}
    assert steps > 8


def test_files_of_a_living_process_stay(folder: Path) -> None:
    with waiting(folder):
        with Staging(folder) as files:
            files.path("b").write_text("mine")
            files.commit()
        [hidden] = hidden_folders(folder)
        assert {each.name for each in hidden.iterdir()} == set(NEW)
    with Staging(folder):
        pass
    assert hidden_folders(folder) == []
    assert contents(folder) == {**OLD, "b": "mine"}


def test_two_writers_at_once_leave_whole_files(folder: Path) -> None:
    command = [sys.executable, "-c", WRITER, str(folder), "0"]
    for _ in range(5):
        both = [subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) for _ in range(3)]
        assert [process.communicate(timeout=60)[0] for process in both] == ["done\n"] * 3
    assert contents(folder) == NEW


def test_without_a_commit_new_folders_go(tmp_path: Path) -> None:
    with Staging(tmp_path / "a" / "b") as files:
        files.path("x").write_text("x")
    assert list(tmp_path.iterdir()) == []


def test_a_foreign_list_moves_and_removes_nothing_elsewhere(folder: Path) -> None:
    outside = folder.parent / "outside"
    outside.write_text("stays")
    for number, removed in enumerate((str(outside), "../outside")):
        hidden = folder / f".leafcloud-{number}"
        hidden.mkdir()
        (hidden / "leafcloud-commit.json").write_text(json.dumps({"files": [], "removed": [removed]}))
    with Staging(folder):
        pass
    assert outside.read_text() == "stays"
    assert contents(folder) == OLD


def test_other_things_with_such_names_stay(folder: Path) -> None:
    (folder / ".leafcloud-file").write_text("x")
    os.mkfifo(folder / ".leafcloud-pipe")
    with Staging(folder):
        pass
    assert (folder / ".leafcloud-file").read_text() == "x"


def test_a_move_that_fails_is_completed_by_the_next_process(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = os.replace

    def failing(source: Path, target: Path) -> None:
        if Path(target).name == "b":
            raise PermissionError("open elsewhere")
        real(source, target)

    def write_new() -> None:
        with Staging(folder) as files, monkeypatch.context() as patch:
            for name, text in NEW.items():
                files.path(name).write_text(text)
            patch.setattr(os, "replace", failing)
            files.commit(["far"])

    with pytest.raises(PermissionError):
        write_new()
    with Staging(folder):
        pass
    assert contents(folder) == NEW
    assert hidden_folders(folder) == []
