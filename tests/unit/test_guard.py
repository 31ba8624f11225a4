"""The guard of a bake: one line and an exit status, whatever happens to the guarded process."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="only Linux has a guard")

ROOT = Path(__file__).resolve().parents[2]

PROGRAM = f"""
import os, sys, time
sys.path.insert(0, {str(ROOT)!r})
from addon import ending, guard
with guard.guarded("program", "cancelled"):
    ending.answer_signals("answered")
"""
"""A program with a guard. Tests add lines."""

Start = Callable[..., subprocess.Popen[str]]


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Start]:
    """Return a function that starts `PROGRAM` with more lines and with flags, in an empty folder."""
    processes = []
    (tmp_path / "temporary").mkdir()

    def start(lines: str, *flags: str) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [sys.executable, "-c", PROGRAM + lines, *flags],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=tmp_path,
            env={**os.environ, "TMPDIR": str(tmp_path / "temporary")},
            start_new_session=True,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # The tests may run with SIGINT ignored.
        )
        processes.append(process)
        return process

    yield start
    for process in processes:
        if process.poll() is None:
            process.kill()
            process.communicate()


def ended(process: subprocess.Popen[str]) -> tuple[int, str]:
    """Return the exit status, and the text on standard error."""
    _, error = process.communicate(timeout=60)
    return process.returncode, error


def bake_of(process: subprocess.Popen[str]) -> int:
    """Return the number of the guarded process, which has printed a line."""
    assert process.stdout
    return int(process.stdout.readline())


IMPATIENT = PROGRAM.replace("with guard", "guard._PATIENCE = 0.5\nwith guard")
"""The program with a guard that waits for an answer to a signal for half a second."""

READY = "print(os.getpid(), flush=True)\n"


@pytest.mark.parametrize("status", [0, 1, 2, 7])
def test_the_guard_ends_with_the_status_of_the_bake(status: int, start: Start) -> None:
    assert ended(start(f"ending.leave({status})")) == (status, "")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("all_processes", [True, False])
def test_a_signal_reaches_the_bake(number: signal.Signals, all_processes: bool, start: Start) -> None:
    process = start(READY + "time.sleep(100)")
    bake_of(process)
    (os.killpg if all_processes else os.kill)(process.pid, number)
    assert ended(process) == (128 + number, "answered\n")


def test_a_signal_at_the_first_moment_is_answered(start: Start) -> None:
    process = start("time.sleep(100)")
    while "SigBlk:\t0000000000000000" in Path(f"/proc/{process.pid}/status").read_text():
        time.sleep(0.0005)
    process.send_signal(signal.SIGTERM)
    assert ended(process) == (128 + signal.SIGTERM, "answered\n")


def test_the_trial_of_the_folder_for_temporary_files_is_not_interrupted(start: Start, tmp_path: Path) -> None:
    """Python writes a file into the folder and removes it."""
    lines = """
import tempfile
find = tempfile.gettempdir
def slowly():
    tempfile.gettempdir = find
    open("temporary/trial", "w").close()
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(0.5)
    os.remove("temporary/trial")
    return find()
tempfile.gettempdir = slowly
ending.own_temporary_folder()
time.sleep(100)
"""
    assert ended(start("import signal\n" + lines)) == (128 + signal.SIGTERM, "answered\n")
    assert not list((tmp_path / "temporary").iterdir())


def test_an_ignored_interrupt_stays_ignored(start: Start) -> None:
    """As for a process in the background of a script."""
    process = subprocess.Popen(
        ["sh", "-c", 'trap "" INT; exec "$@"', "sh", sys.executable, "-c", IMPATIENT + READY + "time.sleep(2)"],
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    bake_of(process)
    os.killpg(process.pid, signal.SIGINT)
    process.communicate(timeout=60)
    assert process.returncode == 0


@pytest.mark.parametrize("number", [signal.SIGSEGV, signal.SIGABRT, signal.SIGKILL])
def test_a_crash_of_the_bake_ends_in_one_line(number: signal.Signals, start: Start, tmp_path: Path) -> None:
    lines = "from pathlib import Path\nending.own_temporary_folder()\nfrom addon.export.staging import Staging\n"
    lines += "with Staging(Path('new/out')) as staging:\n    staging.path('x').write_text('x')\n"
    process = start(f"{lines}    os.kill(os.getpid(), {int(number)})", "--out", "new/out")
    status, error = ended(process)
    assert status == 1
    assert error.startswith("program: the ")
    assert number.name in error
    assert error.count("\n") == 1
    assert [path.name for path in tmp_path.rglob("*")] == ["temporary"], "unfinished files and folders are removed"


def test_a_bake_over_its_memory_ends_in_one_line(start: Start) -> None:
    status, error = ended(start("filled = b'x' * (300 << 20)\ntime.sleep(100)", "--memory", "0.2"))
    assert (status, error.count("\n")) == (1, 1)
    assert "more than 0.2 GiB of memory" in error
    assert "--memory" in error


def test_memory_is_limited_while_the_bake_keeps_the_lock_of_python(start: Start) -> None:
    """No thread of the bake can run meanwhile: `PyDLL` keeps the lock."""
    lines = "import ctypes\nfilled = b'x' * (300 << 20)\nctypes.PyDLL(None).sleep(100)"
    status, error = ended(start(lines, "--memory", "0.2"))
    assert (status, error.count("\n")) == (1, 1)


def test_a_bake_over_its_time_ends_in_one_line(start: Start) -> None:
    status, error = ended(start("time.sleep(100)", "--minutes", "0.01"))
    assert (status, error) == (
        1,
        "program: not done after 0.01 minutes: raise --minutes, or use a smaller tree\n",
    )


def test_a_bake_without_address_space_ends_in_one_line() -> None:
    """Python 3.11 tries for ever to note where an exception was raised, if it gets no memory for that."""
    space = "import resource\nresource.setrlimit(resource.RLIMIT_AS, (400 << 20, 400 << 20))\n"
    lines = """
import ctypes, mmap
sleep = ctypes.PyDLL(None).sleep
held = []
try:
    while True:
        held.append(mmap.mmap(-1, 1 << 16))
except OSError:
    sleep(100)
"""
    process = subprocess.run(
        [sys.executable, "-c", space + IMPATIENT + lines], capture_output=True, text=True, timeout=60
    )
    assert (process.returncode, process.stderr.count("\n")) == (1, 1), process.stderr
    assert "0.391 GiB of address space" in process.stderr


def test_a_bake_that_replaces_files_is_not_killed(start: Start) -> None:
    assert ended(start("ending.commit()\ntime.sleep(2)\nending.leave(7)", "--minutes", "0.01")) == (7, "")


@pytest.mark.parametrize("flag", ["--memory", "--minutes"])
@pytest.mark.parametrize("value", ["0", "-1", "x", "nan"])
def test_the_guard_leaves_wrong_limits_to_the_bake(flag: str, value: str, start: Start) -> None:
    assert ended(start("time.sleep(0.2)\nending.leave(2)", f"{flag}={value}")) == (2, "")


def test_the_bake_dies_with_its_guard(start: Start) -> None:
    process = start(READY + "time.sleep(100)")
    bake = bake_of(process)
    process.kill()
    process.communicate(timeout=60)
    while lives(bake):  # The time-out of pytest ends the test of a bake that lives on.
        time.sleep(0.01)


def lives(process: int) -> bool:
    """Return whether a process has not ended. A dead one may wait for its new parent."""
    try:
        return Path(f"/proc/{process}/stat").read_text().split()[2] not in ("Z", "X")
    except (FileNotFoundError, ProcessLookupError):
        return False


@pytest.mark.night
def test_a_bake_that_answers_no_signal_is_killed(start: Start) -> None:
    process = start(READY + "time.sleep(100)")
    os.kill(bake_of(process), signal.SIGSTOP)
    process.send_signal(signal.SIGTERM)
    assert ended(process) == (128 + signal.SIGTERM, "cancelled\n")


def test_a_commit_of_a_crashed_bake_is_completed(start: Start, tmp_path: Path) -> None:
    """The bake is killed between the decision to move its files and the moves."""
    lines = """
from pathlib import Path
from addon.export import staging
def crash(*_):
    os.kill(os.getpid(), 9)
staging._move = crash
with staging.Staging(Path("out")) as files:
    files.path("x").write_text("new")
    files.commit()
"""
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "x").write_text("old")
    assert ended(start(lines, "--out", "out")) == (0, "")
    assert [(path.name, path.read_text()) for path in (tmp_path / "out").iterdir()] == [("x", "new")]
