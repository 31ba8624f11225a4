"""The operators that run a job: they begin it anew where it is outdated."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from addon.steps import Steps
from addon.ui import job_operator
from addon.ui.job_operator import JobOperator


class FakeJob:
    stage, fraction, done, cancelled = "fit", 0.5, False, False

    def cancel(self) -> None:
        self.cancelled = self.done = True

    def result(self, timeout: float | None = None) -> str:
        return "result"


class Operator(JobOperator):
    """Begins anew once. Writes down what happens."""

    def __init__(self) -> None:
        self.events: list[str] = []
        self.jobs: list[FakeJob] = []
        self.outdated = True

    def begin(self, context: Any) -> Any:
        self.jobs.append(FakeJob())
        return self.jobs[-1]

    def meanwhile(self, context: Any, job: Any) -> Steps[None]:
        number = len(self.jobs)
        try:
            while True:
                self.events.append(f"step {number}")
                yield
        finally:
            self.events.append(f"closed {number}")

    def is_outdated(self, context: Any) -> bool:
        return self.outdated and len(self.jobs) == 1

    def end(self, context: Any, found: Any) -> Steps[set[str]]:
        self.events.append(found)
        yield
        return {"FINISHED"}


@pytest.fixture
def context(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setattr(job_operator, "show", lambda *_: None)
    monkeypatch.setattr(job_operator, "running", [])
    monkeypatch.setattr(job_operator.bpy, "app", SimpleNamespace(background=False))
    manager = SimpleNamespace(
        event_timer_add=lambda *_, **__: object(),
        event_timer_remove=lambda _: None,
        modal_handler_add=lambda _: None,
    )
    return SimpleNamespace(window_manager=manager, window=None)


def test_an_outdated_job_is_cancelled_and_begun_anew(context: Any) -> None:
    operator, timer = Operator(), SimpleNamespace(type="TIMER")
    assert operator.invoke(context, timer) == {"RUNNING_MODAL"}
    operator.outdated = False
    operator.modal(context, timer)
    operator.outdated, operator._checked = True, 0.0
    operator.modal(context, timer)
    operator.modal(context, timer)
    first, second = operator.jobs
    assert (first.cancelled, second.cancelled) == (True, False)
    assert operator.events == ["step 1", "closed 1", "step 2", "step 2"]
    assert job_operator.running == [first, second], "a bake cannot begin while one of them runs"
    second.done = True
    assert operator.modal(context, timer) == {"FINISHED"}
    assert operator.events[4:] == ["result", "closed 2"]
    assert not job_operator.running


def test_a_cancelled_job_does_not_begin_anew(context: Any) -> None:
    operator, timer = Operator(), SimpleNamespace(type="TIMER")
    operator.invoke(context, timer)
    operator.jobs[0].cancel = lambda: None  # type: ignore[method-assign]
    operator.modal(context, SimpleNamespace(type="ESC"))
    operator.modal(context, timer)
    assert len(operator.jobs) == 1
    assert operator.events == [], "no steps either"
    job_operator.cancelled.clear()
