"""Batches on a Dask cluster: a scheduler and three workers on this machine, as their commands start them."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from studio import Studio

from leafcloud.batch.command import main

WORKERS = 3
START_SECONDS = 60.0
TOOL = (sys.executable, "-m", "dask")


@contextmanager
def started(folder: Path, log: str, *arguments: str) -> Iterator[Path]:
    """Run a command of Dask while the block runs. Yield its log."""
    path = folder / log
    environment = {**os.environ, "DASK_DISTRIBUTED__WORKER__MEMORY__TERMINATE": "False"}
    with path.open("w") as file:
        process = subprocess.Popen(
            [*TOOL, *arguments], stdout=file, stderr=file, cwd=folder, env=environment, start_new_session=True
        )
        try:
            yield path
        finally:
            os.killpg(process.pid, signal.SIGTERM)
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)


def said(log: Path, pattern: str) -> str:
    """Wait until a log has the pattern. Return its group."""
    deadline = time.monotonic() + START_SECONDS
    while time.monotonic() < deadline:
        if match := re.search(pattern, log.read_text()):
            return match[1]
        time.sleep(0.1)
    raise AssertionError(log.read_text())


def waited(ready: Callable[[], Any]) -> Any:
    """Return the first true value of `ready`."""
    deadline = time.monotonic() + START_SECONDS
    while not (value := ready()) and time.monotonic() < deadline:
        time.sleep(0.1)
    return value


@pytest.fixture(scope="module")
def scheduler(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The address of a scheduler with three workers. Their nannies start killed ones again."""
    folder = tmp_path_factory.mktemp("cluster")
    with started(folder, "scheduler.log", "scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard") as log:
        address = said(log, r"Scheduler at:\s+(tcp://127\.0\.0\.1:\d+)")
        flags = ("--nworkers", str(WORKERS), "--nthreads", "1", "--host", "127.0.0.1", "--no-dashboard")
        with started(folder, "workers.log", "worker", address, *flags, "--local-directory", str(folder)):
            for number in range(1, WORKERS + 1):
                said(log, rf"(?s)((?:Register worker.*?){{{number}}})")
            yield address


@pytest.fixture
def studio(tmp_path: Path) -> Studio:
    return Studio(tmp_path)


def test_all_trees_are_baked_by_workers_and_unchanged_ones_skipped(studio: Studio, scheduler: str) -> None:
    for number in range(8):
        studio.add(f"tree{number}")
    studio.add("bad", "refused")
    assert studio.run("--scheduler", scheduler, "--", "--levels", 2) == 1
    assert studio.rows["bad"]["reason"] == "the tree has no leaves: add some"
    baked = [row for row in studio.rows.values() if not row["reason"]]
    assert len(baked) == 8
    for row in baked:
        assert {file.name for file in (studio.out / row["tree"]).iterdir()} == {"batch.json", "report.json", "tree.glb"}
        assert (studio.out / row["tree"] / "tree.glb").read_text().endswith("--levels 2")
    assert studio.run("--scheduler", scheduler, "--", "--levels", 2) == 1
    assert sum(row["skipped"] for row in studio.rows.values()) == 8
    assert studio.run("--", "--levels", 2) == 1, "the same batch on this machine"
    assert sum(row["skipped"] for row in studio.rows.values()) == 8


def test_a_tree_whose_worker_dies_is_baked_by_another(studio: Studio, scheduler: str, tmp_path: Path) -> None:
    studio.add("ash", f"deadly {tmp_path / 'mark'}")
    for name in ("elm", "fir", "oak"):
        studio.add(name)
    assert studio.run("--scheduler", scheduler) == 0
    assert (tmp_path / "mark").exists(), "it killed a worker"


def test_a_tree_that_kills_two_workers_is_set_aside(studio: Studio, scheduler: str) -> None:
    studio.add("ash", "deadly mark")
    studio.add("elm")
    assert studio.run("--scheduler", scheduler) == 1
    assert "two workers died" in studio.rows["ash"]["reason"]


def test_a_worker_that_loses_its_disk_gives_the_tree_back(studio: Studio, scheduler: str, tmp_path: Path) -> None:
    studio.add("ash", f"diskless {tmp_path / 'mark'}")
    studio.add("elm")
    assert studio.run("--scheduler", scheduler) == 0
    assert (tmp_path / "mark").exists()


def test_limits_hold_on_workers(studio: Studio, scheduler: str) -> None:
    studio.add("ash", "slow")
    assert studio.run("--scheduler", scheduler, "--minutes", 0.02) == 1
    assert "not done after 0.02 minutes" in studio.rows["ash"]["reason"]


@pytest.mark.night
def test_a_stopped_batch_ends_its_bakes(studio: Studio, scheduler: str, tmp_path: Path) -> None:
    mark = tmp_path / "process"
    studio.add("ash", f"slow {mark}")
    command = [sys.executable, "-m", "leafcloud.batch.command", *studio.arguments("--scheduler", scheduler)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        number = waited(lambda: mark.exists() and mark.read_text())
        process.send_signal(signal.SIGINT)
        _, error = process.communicate(timeout=60)
    assert process.returncode == 130, error
    assert waited(lambda: not Path(f"/proc/{number}").exists()), "the worker ends the bake"
    studio.add("ash")
    assert studio.run("--scheduler", scheduler) == 0


@pytest.mark.night
def test_an_address_without_a_scheduler_is_told(studio: Studio, capsys: pytest.CaptureFixture[str]) -> None:
    studio.add("ash")
    assert main(studio.arguments("--scheduler", "tcp://127.0.0.1:9")) == 1
    assert "no Dask scheduler answers at tcp://127.0.0.1:9" in capsys.readouterr().err
