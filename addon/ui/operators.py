"""The operator: bakes the selected objects."""

from __future__ import annotations

import itertools
from pathlib import Path

import bpy

import leafcloud

from ..build.rollback import removed_on_failure
from ..job import POLL_SECONDS, wait
from ..pipeline import file_name, finish, layer_of, plan, prepare, start, view_of, write
from ..scene import SceneError
from ..scene.extract import extract
from ..settings import SettingsError
from .measured import predicted
from .properties import bake_settings, leaf_names, show_plan

REFUSALS = (SettingsError, SceneError, leafcloud.LeafcloudError, OSError)

NAVIGATION = {"MOUSEMOVE", "MIDDLEMOUSE", "WHEELUPMOUSE", "WHEELDOWNMOUSE", "TRACKPADPAN", "TRACKPADZOOM"}
"""What gets through while a bake runs: nothing that could edit or undo what is being baked."""

running: list[leafcloud.Job[leafcloud.Chain] | leafcloud.Job[leafcloud.Curve]] = []


def cancel_running() -> None:
    """Cancels the core's work and waits until its thread has ended: the add-on is about to go."""
    for job in running:
        job.cancel()
        try:
            job.result()
        except leafcloud.LeafcloudError:
            continue  # Whether cancelled or failed: nobody is left to tell.
    running.clear()


def can_begin(operator: type[bpy.types.Operator], context: bpy.types.Context) -> bool:
    """Whether there is something to work on and nothing at work; tells what is missing."""
    if not context.selected_objects:
        operator.poll_message_set("Nothing is selected: select the tree's leaves and, if it has any, its wood")
        return False
    if context.mode != "OBJECT":
        operator.poll_message_set("Leave Edit Mode first")
        return False
    if running:
        operator.poll_message_set("A bake or a measurement is running")
        return False
    return True


def refuse(operator: bpy.types.Operator, error: BaseException) -> set[str]:
    """Tells why nothing was done; the scene is as it was."""
    operator.report({"ERROR"}, " ".join(str(error).split()))
    return {"CANCELLED"}


class LEAFCLOUD_OT_plan(bpy.types.Operator):
    """Tell which effects a bake of the selected objects would carry, why, and what each would cost"""

    bl_idname = "leafcloud.plan"
    bl_label = "Plan Effects"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return can_begin(cls, context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        settings = context.scene.leafcloud
        try:
            sources = tuple(context.selected_objects)
            tree = extract(context.evaluated_depsgraph_get(), sources, leaf_names=leaf_names(settings))
            effects = plan(tree, bake_settings(settings), layer_of(context.scene))
        except REFUSALS as error:
            return refuse(self, error)
        show_plan(context.window_manager.leafcloud, effects)
        return {"FINISHED"}


class LEAFCLOUD_OT_bake(bpy.types.Operator):
    """Bake the selected objects into levels of detail, in a new collection"""

    bl_idname = "leafcloud.bake"
    bl_label = "Bake Levels"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return can_begin(cls, context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Bakes from start to end; nothing else happens meanwhile."""
        try:
            self._begin(context)
            chain = wait(self._job, lambda stage, fraction: None)
            return self._end(context, chain)
        except REFUSALS as error:
            return refuse(self, error)
        finally:
            running.clear()

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Bakes while the view stays alive; without an interface like `execute`."""
        if bpy.app.background:
            return self.execute(context)
        try:
            self._begin(context)
        except REFUSALS as error:
            return refuse(self, error)
        manager = context.window_manager
        self._timer = manager.event_timer_add(POLL_SECONDS, window=context.window)
        manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type == "ESC":
            self._job.cancel()
            return {"RUNNING_MODAL"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"} if event.type in NAVIGATION else {"RUNNING_MODAL"}
        show(context, self._job.stage, self._job.fraction)
        if not self._job.done:
            return {"RUNNING_MODAL"}
        try:
            return self._end(context, self._job.result())
        except leafcloud.CancelledError:
            self.report({"INFO"}, "Cancelled")
            return {"CANCELLED"}
        except REFUSALS as error:
            return refuse(self, error)
        finally:
            context.window_manager.event_timer_remove(self._timer)
            running.clear()
            show(context, "", 0.0)

    def _begin(self, context: bpy.types.Context) -> None:
        """Reads the scene and starts the core."""
        settings = context.scene.leafcloud
        self._sources = tuple(context.selected_objects)
        tree = extract(context.evaluated_depsgraph_get(), self._sources, leaf_names=leaf_names(settings))
        self._prepared = predicted(prepare(tree, bake_settings(settings), layer_of(context.scene)))
        self._job = start(self._prepared)
        running.append(self._job)

    def _end(self, context: bpy.types.Context, chain: leafcloud.Chain) -> set[str]:
        """Puts the levels into the scene in the sources' place, and writes them if a folder is given."""
        scene = context.scene
        name = _free_name(file_name((context.active_object or self._sources[0]).name))
        with removed_on_failure():
            baked = finish(self._prepared, chain, name, view_of(scene))
            scene.collection.children.link(baked.collection)
            if scene.leafcloud.directory:
                directory = Path(bpy.path.abspath(scene.leafcloud.directory))
                write(baked, directory, lambda stage, fraction: show(context, stage, fraction), blend=False)
        show_plan(context.window_manager.leafcloud, baked.effects)
        for obj in self._sources:
            obj.hide_set(True)
            obj.hide_render = True
        for warning in self._prepared.warnings:
            self.report({"WARNING"}, warning)
        self.report({"INFO"}, f"Baked {len(baked.levels)} levels into collection {name}, and hid their sources")
        return {"FINISHED"}


def _free_name(wanted: str) -> str:
    """`wanted`, with a number if the levels could not have their names under it."""
    taken = [item.name for item in (*bpy.data.collections, *bpy.data.objects)]

    def is_free(name: str) -> bool:
        return name not in bpy.data.collections and not any(other.startswith(f"{name}_LOD") for other in taken)

    numbered = (f"{wanted}_{number}" for number in itertools.count(2))
    return next(name for name in itertools.chain([wanted], numbered) if is_free(name))


def show(context: bpy.types.Context, stage: str, fraction: float) -> None:
    status = context.window_manager.leafcloud
    status.stage, status.fraction = stage, fraction
    for area in context.screen.areas if context.screen else ():
        area.tag_redraw()
