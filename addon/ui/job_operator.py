"""Base of the operators that run the core on the selected objects without blocking the interface."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import bpy

import leafcloud

from ..bake.job import Job, wait
from ..errors import SceneError
from ..settings.setting import SettingsError
from ..steps import Steps, all_steps, in_turns, no_steps
from .progress import show
from .properties import with_labels
from .selected_tree import leaves_problem

REFUSALS = (SettingsError, SceneError, leafcloud.LeafcloudError, OSError)

_NAVIGATION = {"MOUSEMOVE", "MIDDLEMOUSE", "WHEELUPMOUSE", "WHEELDOWNMOUSE", "TRACKPADPAN", "TRACKPADZOOM"}
"""Events that pass through during the work. Events that could edit or undo the scene do not. Clicks on Leafcloud's tab
do, because its operators wait for the end of the work."""

TAB = "Leafcloud"
"""The tab of the sidebar with all panels."""

running: list[Job[Any]] = []
"""The jobs of the running operator. The last one counts: a changed setting cancels a job and adds another."""

cancelled: list[Job[Any]] = []
"""Those of them that a person has cancelled."""

STEP_SECONDS = 0.01
"""Pause between two steps, in which the interface draws."""

CHECK_SECONDS = 0.3
"""Pause between two looks for changed settings."""

BUSY = "A bake or a measurement is running"
"""Why an operator cannot start."""


def cancel_jobs() -> None:
    """Cancel the running jobs, as a person asks for it: they do not begin anew."""
    for job in running:
        job.cancel()
    cancelled[:] = running


def cancel_running() -> None:
    """Cancel the running jobs, and wait until their threads have ended."""
    cancel_jobs()
    for job in running:
        try:
            job.result()
        except leafcloud.LeafcloudError:
            continue  # Cancelled or failed: nothing reads the result.
    _forget_jobs()


def _forget_jobs() -> None:
    running.clear()
    cancelled.clear()


def can_begin(operator: type[bpy.types.Operator], context: bpy.types.Context) -> bool:
    """Return whether the operator can start now. Set the poll message if it cannot."""
    if not context.selected_objects:
        operator.poll_message_set("Nothing is selected: select the tree's leaves and trunk")
        return False
    if context.mode != "OBJECT":
        operator.poll_message_set("Switch to Object Mode first")
        return False
    problem = BUSY if running else leaves_problem(context)
    if problem:
        operator.poll_message_set(problem)
    return not problem


def refuse(operator: bpy.types.Operator, error: BaseException) -> set[str]:
    """Report the error and cancel the operator. The scene is unchanged."""
    said = str(error)
    if isinstance(error, OSError) and error.strerror:
        said = f"cannot write {error.filename}: {error.strerror}; make room there, or choose another `out`"
    operator.report({"ERROR"}, " ".join(with_labels(said).split()))
    return {"CANCELLED"}


class LEAFCLOUD_OT_cancel(bpy.types.Operator):
    """Cancel the bake or the measurement. Nothing changes in the scene"""

    bl_idname = "leafcloud.cancel"
    bl_label = "Cancel"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return bool(running)

    def execute(self, context: bpy.types.Context) -> set[str]:
        cancel_jobs()
        return {"FINISHED"}


def is_over_tab(screen: bpy.types.Screen, event: bpy.types.Event) -> bool:
    """Return whether the mouse is over Leafcloud's tab in a sidebar, which has the button that cancels."""
    regions = (region for area in screen.areas if area.type == "VIEW_3D" for region in area.regions)
    return any(
        region.type == "UI"
        and getattr(region, "active_panel_category", "") == TAB
        and 0 <= event.mouse_x - region.x < region.width
        and 0 <= event.mouse_y - region.y < region.height
        for region in regions
    )


class JobOperator:
    """Mixin for operators that run a job of the core. Put it before `bpy.types.Operator` in the list of bases.

    The subclass defines `begin`, which reads the scene and starts a job, and `end`, which uses the result in steps.
    Either may raise one of `REFUSALS`, and must then leave the scene unchanged; `end` also if it is closed between two
    steps. It may define `meanwhile`, steps during the job, and `is_outdated`, whether the job should begin anew.
    """

    in_window = False
    """Whether a person sees the interface during the job."""
    _steps: Steps[set[str]] | None = None
    _checked = 0.0

    if TYPE_CHECKING:
        begin: Callable[[bpy.types.Context], Job[Any]]
        end: Callable[[bpy.types.Context, Any], Steps[set[str]]]
        report: Callable[[set[str], str], None]
        _timer: bpy.types.Timer

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return can_begin(cls, context)

    def meanwhile(self, context: bpy.types.Context, job: Any) -> Steps[None]:
        """Return steps during `job`, on the main thread. They are closed at the end, and undo their changes."""
        return no_steps()

    def is_outdated(self, context: bpy.types.Context) -> bool:
        return False

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Run the job to its end, blocking the interface."""
        self.in_window = False
        try:
            self._start(context)
            return all_steps(self.end(context, wait(self._job, lambda stage, fraction: None)))
        except REFUSALS as error:
            return refuse(self, error)
        finally:
            _forget_jobs()

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Run the job modally, without blocking the interface. Without an interface, run `execute`."""
        if bpy.app.background:
            return self.execute(context)
        self.in_window = True
        try:
            self._start(context)
        except REFUSALS as error:
            return refuse(self, error)
        self._show(context)
        self._timer = context.window_manager.event_timer_add(STEP_SECONDS, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type == "ESC":
            cancel_jobs()
            if self._steps is None:
                return {"RUNNING_MODAL"}  # The job ends soon.
            self.cancel(context)
            self.report({"INFO"}, "Cancelled")
            return {"CANCELLED"}
        if event.type != "TIMER":
            passes = event.type in _NAVIGATION or (event.type == "LEFTMOUSE" and is_over_tab(context.screen, event))
            return {"PASS_THROUGH"} if passes else {"RUNNING_MODAL"}
        self._show(context)
        done = self._step(context)
        if done is not None:
            self._stop(context)
        return done or {"RUNNING_MODAL"}

    def _step(self, context: bpy.types.Context) -> set[str] | None:
        """Do the next step. Return the operator's result after the last one, or after an error."""
        try:
            if not self._job.done:
                self._go_on(context)
                return None
            if self._steps is None:
                self._steps = in_turns(self.end(context, self._job.result()))
            next(self._steps)
        except StopIteration as end:
            return set(end.value)
        except leafcloud.CancelledError:
            self.report({"INFO"}, "Cancelled")
            return {"CANCELLED"}
        except REFUSALS as error:
            self._job.cancel()
            return refuse(self, error)
        except BaseException:
            self._job.cancel()
            self._stop(context)
            raise
        return None

    def _go_on(self, context: bpy.types.Context) -> None:
        """Do a step during the job, or begin it anew."""
        if self._job in cancelled:
            return
        now = time.monotonic()
        if now - self._checked > CHECK_SECONDS:
            self._checked = now
            if self.is_outdated(context):
                self._job.cancel()
                self.end_meanwhile()
                show(context, "", 0.0)
                self._start(context)
        with suppress(*REFUSALS):  # The job goes on without them.
            next(self._meanwhile, None)

    def cancel(self, context: bpy.types.Context) -> None:
        """Cancel the job. Blender calls this when the window closes or another file is loaded."""
        self._job.cancel()
        if self._steps is not None:
            self._steps.close()
        self._stop(context)

    def end_meanwhile(self) -> None:
        self._meanwhile.close()

    def _stop(self, context: bpy.types.Context) -> None:
        try:
            self.end_meanwhile()
        finally:
            context.window_manager.event_timer_remove(self._timer)
            _forget_jobs()
            show(context, "", 0.0)

    def _show(self, context: bpy.types.Context) -> None:
        if self._steps is not None:
            show(context, "build", 1.0)
        else:
            show(context, self._job.stage or "start", self._job.fraction)

    def _start(self, context: bpy.types.Context) -> None:
        self._steps = None
        self._job = self.begin(context)
        running.append(self._job)
        self._meanwhile = self.meanwhile(context, self._job)
