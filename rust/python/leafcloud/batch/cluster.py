"""The bakes of a batch on the workers of a Dask scheduler.

A task carries the bytes of a tree's files, and returns those of its results: workers need no common disk, only the same
version of Leafcloud. Results are moved into place file by file, the report last. Few trees are on their way at a time,
whatever the size of the batch.

A bake runs in a process of its own on the worker, so it seldom takes the worker with it. If a worker dies, its task
goes to another one, once: a tree that kills two workers is set aside. If the disk of a worker fails, its task goes on,
too.
"""

from __future__ import annotations

import os
import shutil
import tempfile
import time
import uuid
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Event
from typing import Any

from distributed import Client, Future, KilledWorker, get_worker
from distributed import Event as SharedEvent

from .. import LeafcloudError
from .process import Limits, Outcome, bake
from .run import Batch, Row, begin, end, forget, report_in, version_of
from .trees import Tree, files_of

_MOST_TRIES = 3
"""Workers that a task is given to, if the disks of the first ones fail."""
_ASK_SECONDS = 5.0
"""Time between two questions of a worker whether the batch was stopped."""


@dataclass(frozen=True)
class Task:
    """A bake for a worker. files: the contents by path below a folder, the tree's own first. stop: name of an event."""

    files: tuple[tuple[str, bytes], ...]
    command: tuple[str, ...]
    flags: tuple[str, ...]
    limits: Limits
    version: str
    stop: str


@dataclass(frozen=True)
class Result:
    """What a worker returns. lost: the worker's disk failed, and the task may succeed on another one."""

    outcome: Outcome
    files: dict[str, bytes] = field(default_factory=dict)
    worker: str = ""
    lost: bool = False


@dataclass(frozen=True)
class _Sent:
    """A tree on its way: the key of its bake, and the workers that gave it back."""

    tree: Tree
    key: str
    task: Task
    tried: tuple[str, ...] = ()


def run_on(scheduler: str, trees: Sequence[Tree], batch: Batch, stop: Event, tell: Callable[[Row], None]) -> list[Row]:
    """Bake all trees on the workers of the scheduler at an address, such as tcp://10.0.0.1:8786. As `run.run`.

    Raises `LeafcloudError` if no scheduler answers.
    """
    try:
        client = Client(scheduler, timeout="10s", set_as_default=False)
    except (OSError, ValueError) as error:
        raise LeafcloudError(
            f"no Dask scheduler answers at {scheduler}: start `dask scheduler` there ({error})"
        ) from error
    rows: dict[Tree, Row] = {}
    with client:
        before = client.run_on_scheduler(_allow_deaths, 1)
        try:
            for row in _rows(client, trees, batch, stop, tell):
                rows[row.tree] = row
        except OSError as error:
            gone = Outcome(f"the scheduler at {scheduler} is gone ({error}): run the same batch again", 0.0, 0)
            rows |= {tree: Row(tree, gone, False, None) for tree in trees if tree not in rows}
        finally:
            with suppress(OSError):
                client.run_on_scheduler(_allow_deaths, before)
    return [rows[tree] for tree in trees if tree in rows]


def _allow_deaths(workers: int, dask_scheduler: Any = None) -> int:
    """Make a task fail when more than so many of its workers have died. Return the number before."""
    before: int = dask_scheduler.allowed_failures
    dask_scheduler.allowed_failures = workers
    return before


def _rows(
    client: Client, trees: Sequence[Tree], batch: Batch, stop: Event, tell: Callable[[Row], None]
) -> Iterator[Row]:
    program, name = version_of(batch.command), f"leafcloud-{uuid.uuid4().hex}"
    shared = SharedEvent(name, client=client)
    ended: SimpleQueue[Future] = SimpleQueue()
    sent: dict[Future, _Sent] = {}
    waiting = iter(trees)
    more = True
    while more or sent:
        if stop.is_set():
            shared.set()
            client.cancel(list(sent))
            return
        while more and not stop.is_set() and len(sent) < 2 * max(sum(client.nthreads().values()), 1):
            tree = next(waiting, None)
            if tree is None:
                more = False
                break
            begun = begin(tree, batch, program)
            if isinstance(begun, Row):
                tell(begun)
                yield begun
            else:
                _send(client, _Sent(tree, begun, _task_of(tree, batch, program, name)), sent, ended)
        try:
            future = ended.get(timeout=0.2)
        except Empty:
            continue
        job = sent.pop(future)
        result = _result_of(future)
        if result.lost and len(job.tried) + 1 < _MOST_TRIES:
            _send(client, replace(job, tried=(*job.tried, result.worker)), sent, ended)
            continue
        row = end(job.tree, batch, job.key, _kept(result, batch.out / job.tree.name))
        if row.outcome.wrong_flags:
            stop.set()
        tell(row)
        yield row


def _send(client: Client, job: _Sent, sent: dict[Future, _Sent], ended: SimpleQueue[Future]) -> None:
    others = [worker for worker in client.nthreads() if worker not in job.tried]
    workers = (others or None) if job.tried else None  # Without others the same one may work again, or a new one come.
    key = f"{job.tree.name}-{uuid.uuid4().hex}"
    options = {"workers": workers, "allow_other_workers": True} if workers else {}
    future = client.submit(bake_task, job.task, pure=False, key=key, **options)
    sent[future] = job
    future.add_done_callback(ended.put)


def _task_of(tree: Tree, batch: Batch, program: str, stop: str) -> Task:
    folder = tree.file.parent
    files = []
    for file in files_of(tree.file):
        with suppress(OSError):
            files.append((Path(os.path.relpath(file, folder)).as_posix(), file.read_bytes()))
    return Task(tuple(files), batch.command, batch.flags, batch.limits, program, stop)


def _result_of(future: Future) -> Result:
    try:
        result: Result = future.result()
    except KilledWorker:
        return Result(Outcome("two workers died while they baked it: bake it alone, and look at its memory", 0.0, 0))
    except Exception as error:  # Whatever a worker raises is that tree's failure.
        return Result(Outcome(f"its worker failed: {type(error).__name__} {error}".replace("\n", " "), 0.0, 0))
    return result


def _kept(result: Result, folder: Path) -> Outcome:
    """Move the files of a result into the tree's folder. Return the outcome, a failure if that fails."""
    if not result.outcome.done:
        return result.outcome
    try:
        folder.mkdir(parents=True, exist_ok=True)
        forget(folder)
        listed = (report_in(folder) or {}).get("files", [])
        earlier = {name for name in listed if isinstance(name, str) and Path(name).name == name}
        with tempfile.TemporaryDirectory(prefix=".leafcloud-", dir=folder) as hidden:
            for name, content in result.files.items():
                Path(hidden, name).write_bytes(content)
            for name in sorted(result.files, key="report.json".__eq__):
                os.replace(Path(hidden, name), folder / name)
        for name in earlier - result.files.keys():
            (folder / name).unlink(missing_ok=True)
    except OSError as error:
        return Outcome(f"{folder}: {error.strerror or error}; make room there", 0.0, 0)
    return result.outcome


class _Stopped(Event):
    """The event of a batch, as a worker sees it: it asks the scheduler now and then."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self._shared = SharedEvent(name)
        self._asked = time.monotonic()

    def is_set(self) -> bool:
        if time.monotonic() - self._asked > _ASK_SECONDS:
            self._asked = time.monotonic()
            with suppress(OSError):  # The scheduler is away: the bake goes on.
                if self._shared.is_set():
                    self.set()
        return super().is_set()


def bake_task(task: Task) -> Result:
    """Bake on a worker: write the files, run the bake, read the results."""
    worker = get_worker()
    address: str = worker.address
    if version_of(task.command) != task.version:
        reason = f"worker {address} has another version of Leafcloud, or no {task.command[-1]}: install the same one"
        return Result(Outcome(reason, 0.0, 0), worker=address)
    home = Path(worker.local_directory)
    try:
        with tempfile.TemporaryDirectory(prefix="leafcloud-", dir=home) as folder:
            source, out = Path(folder, "in"), Path(folder, "out")
            for name, content in task.files:
                file = source / name
                if not file.resolve().is_relative_to(source.resolve()):
                    continue
                file.parent.mkdir(parents=True, exist_ok=True)
                file.write_bytes(content)
            first, _ = task.files[0]
            limits = task.limits.shared_among(worker.state.nthreads)
            outcome = bake(task.command, source / first, out, task.flags, limits, _Stopped(task.stop))
            if not outcome.done:
                return Result(outcome, worker=address, lost=not _is_writable(home, folder))
            return Result(outcome, {file.name: file.read_bytes() for file in out.iterdir() if file.is_file()}, address)
    except OSError as error:
        reason = f"the disk of worker {address} failed: {error.strerror or error}"
        return Result(Outcome(reason, 0.0, 0), worker=address, lost=True)


def _is_writable(home: Path, folder: str) -> bool:
    """Return whether the worker's disk still works."""
    if not os.path.isdir(folder) or shutil.disk_usage(home).free < 2**24:
        return False
    try:
        with tempfile.TemporaryFile(dir=home) as probe:
            probe.write(bytes(2**16))
    except OSError:
        return False
    return True
