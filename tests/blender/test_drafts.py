"""The draft that a window shows during a bake: it comes before the levels, and leaves the scene as it was."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import bpy
import pytest
from scenes import collected

import leafcloud
from addon.bake import tree_set
from addon.bake.tree_set import ChainsJob, prepare_tree_set, start_tree_set
from addon.bake.values import Prepared
from addon.levels.root import is_root
from addon.mesh.baked_levels import is_source, level_number
from addon.steps import Steps, all_steps
from addon.ui import job_operator
from addon.ui.draft import drawn_draft, is_draft, prepared_draft
from addon.ui.job_operator import JobOperator
from addon.ui.operators import LEAFCLOUD_OT_bake
from addon.ui.properties import bake_settings
from addon.ui.selection import selected_trees

pytestmark = [pytest.mark.usefixtures("registered"), pytest.mark.version]

KINDS = ("objects", "meshes", "materials", "images", "collections", "node_groups")


def started() -> tuple[Mapping[str, Prepared], ChainsJob]:
    """Start a bake of the selection with its draft. Return the prepared draft and the job."""
    settings = bake_settings(bpy.context.scene.leafcloud)
    with selected_trees(bpy.context) as trees:
        prepared, drafted = prepare_tree_set(trees, settings, None), prepared_draft(trees, settings)
    return drafted, start_tree_set(prepared, drafted)


def state() -> tuple[Any, ...]:
    """Return the number of data-blocks of each kind, the state of each object, and the active object.

    The state of an object: its name, whether it is visible, hidden in renders, selected.
    """
    scene = bpy.context.scene
    return (
        {kind: len(getattr(bpy.data, kind)) for kind in KINDS},
        sorted((obj.name, obj.visible_get(), obj.hide_render, obj.select_get()) for obj in scene.objects),
        bpy.context.view_layer.objects.active,
    )


def drafts() -> list[bpy.types.Collection]:
    return [each for each in bpy.data.collections if is_draft(each)]


def shown() -> tuple[Steps[None], ChainsJob]:
    """Bake the selection until its draft is shown. Return the steps that show it, and the job."""
    drafted, job = started()
    steps = drawn_draft(bpy.context, drafted, job)
    while not drafts():
        next(steps)
    return steps, job


def test_a_draft_is_shown_in_place_of_its_sources(selected_shrub: list[bpy.types.Object]) -> None:
    before = state()
    steps, job = shown()
    [collection] = drafts()
    numbers = [level_number(obj) for obj in collection.objects]
    assert sorted(number for number in numbers if number is not None) == [0, 1]
    assert not any(obj.visible_get() for obj in selected_shrub)
    active = bpy.context.view_layer.objects.active
    assert is_root(active)
    assert active.name in collection.objects, "the panel shows the draft's figures"
    assert job.stage != "draft"
    steps.close()
    assert state() == before
    assert not any(map(is_source, selected_shrub)), "nothing was baked"
    job.cancel()


def test_drafts_of_several_trees_are_removed_with_their_set(selected_shrub: list[bpy.types.Object]) -> None:
    copies = [obj.copy() for obj in selected_shrub]
    collected("one", *selected_shrub)
    collected("two", *copies)
    for obj in copies:
        obj.select_set(True)
    bpy.context.scene.leafcloud.trees = "collections"
    before = state()
    steps, job = shown()
    assert {"draft one", "draft two"} <= {each.name for each in drafts()}
    assert len(drafts()) == 3, "two trees and their set"
    steps.close()
    assert state() == before
    job.cancel()


def test_steps_that_end_before_the_draft_leave_nothing(selected_shrub: list[bpy.types.Object]) -> None:
    before = state()
    drafted, job = started()
    steps = drawn_draft(bpy.context, drafted, job)
    next(steps)
    steps.close()
    assert state() == before
    job.cancel()


def test_undo_may_bring_a_draft_back_but_it_goes(selected_shrub: list[bpy.types.Object]) -> None:
    visible = [obj.name for obj in bpy.context.scene.objects]
    steps, job = shown()
    bpy.ops.ed.undo_push(message="a setting")
    steps.close()
    job.cancel()
    bpy.ops.ed.undo_push(message="the bake")
    bpy.ops.ed.undo()
    assert not drafts()
    assert [obj.name for obj in bpy.context.scene.objects if obj.visible_get()] == visible
    assert len(bpy.context.scene.objects) == len(visible), "its levels are gone"


def test_the_levels_of_an_earlier_bake_come_back(selected_shrub: list[bpy.types.Object]) -> None:
    assert bpy.ops.leafcloud.bake() == {"FINISHED"}
    before = state()
    steps, job = shown()
    visible = [obj for obj in bpy.context.scene.objects if obj.visible_get() and level_number(obj) is not None]
    assert all(is_draft(obj.users_collection[0]) for obj in visible)
    steps.close()
    assert state() == before
    job.cancel()


class Bake(JobOperator):
    """The operator outside Blender's registry, in a window that is not there."""

    viewer, in_window = "", True
    begin, meanwhile, is_outdated, end = (
        vars(LEAFCLOUD_OT_bake)[name] for name in ("begin", "meanwhile", "is_outdated", "end")
    )

    def report(self, kinds: set[str], words: str) -> None:
        pass


@pytest.mark.parametrize("again", [False, True])
def test_the_levels_take_the_place_of_the_draft(
    selected_shrub: list[bpy.types.Object], again: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(job_operator, "running", [])
    if again:
        assert bpy.ops.leafcloud.bake() == {"FINISHED"}
    operator: Any = Bake()
    operator._start(bpy.context)
    while not drafts():
        operator._go_on(bpy.context)
    job = operator._job
    assert all_steps(operator.end(bpy.context, job.result())) == {"FINISHED"}
    assert not drafts()
    names = {obj.name for obj in bpy.context.scene.objects if obj.visible_get()}
    assert {"leaves_tree", "leaves_LOD0", "leaves_LOD1"} <= names
    assert not names & {"leaves", "branches"}, "the sources are hidden"
    assert bpy.context.view_layer.objects.active.name == "leaves_tree"


def test_a_bake_goes_on_without_a_draft(
    selected_shrub: list[bpy.types.Object], monkeypatch: pytest.MonkeyPatch
) -> None:
    def start(prepared: Prepared, *, few_views: bool = False) -> leafcloud.Job[leafcloud.Chain]:
        if few_views:
            raise leafcloud.LeafcloudError("the page is too small")
        return begin(prepared)

    begin = tree_set.start
    monkeypatch.setattr(tree_set, "start", start)
    before = state()
    drafted, job = started()
    assert list(drawn_draft(bpy.context, drafted, job)) is not None
    assert job.drafts == []
    assert len(job.result()) == 1
    assert state() == before
