"""The draft that a window shows during a bake: it comes before the levels, and leaves the scene as it was."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import bpy
import pytest

import leafcloud
from addon.bake import tree_set
from addon.bake.tree_set import ChainsJob, prepare_tree_set, start_tree_set
from addon.bake.values import Prepared
from addon.levels.root import is_root
from addon.mesh.baked_levels import level_number
from addon.steps import Steps, all_steps, no_steps
from addon.ui import job_operator
from addon.ui.draft import draft_of, drawn_draft, is_draft
from addon.ui.job_operator import JobOperator
from addon.ui.operators import LEAFCLOUD_OT_bake
from addon.ui.properties import bake_settings
from addon.ui.selection import selected_trees

pytestmark = [pytest.mark.usefixtures("registered"), pytest.mark.version]

KINDS = ("objects", "meshes", "materials", "images", "collections")


@pytest.fixture
def sources(shrub: Path) -> list[bpy.types.Object]:
    """Return the selected objects of the shrub, with settings for a fast bake."""
    bpy.ops.import_scene.gltf(filepath=str(shrub))
    bpy.ops.object.select_all(action="SELECT")
    bpy.context.view_layer.objects.active = bpy.data.objects["leaves"]
    settings = bpy.context.scene.leafcloud
    settings.texture_size, settings.levels, settings.quality = 128, 1, 0.1
    return list(bpy.context.selected_objects)


def started() -> tuple[Mapping[str, Prepared], ChainsJob]:
    """Start a bake of the selection with its draft. Return the prepared draft and the job."""
    settings = bake_settings(bpy.context.scene.leafcloud)
    with selected_trees(bpy.context) as trees:
        prepared = prepare_tree_set(trees, settings, None)
        drafted = prepare_tree_set(trees, draft_of(settings), None)
    return drafted, start_tree_set(prepared, drafted)


def state() -> object:
    """Return the numbers of data-blocks, what is visible and selected, and the active object."""
    scene = bpy.context.scene
    return (
        {kind: len(getattr(bpy.data, kind)) for kind in KINDS},
        sorted((obj.name, obj.visible_get(), obj.hide_render, obj.select_get()) for obj in scene.objects),
        bpy.context.view_layer.objects.active,
    )


def drafts() -> list[bpy.types.Collection]:
    return [each for each in bpy.data.collections if is_draft(each)]


def shown(before: Steps[None]) -> tuple[Steps[None], ChainsJob]:
    """Bake the selection until its draft is shown. Return the steps that show it, and the job."""
    drafted, job = started()
    steps = drawn_draft(bpy.context, drafted, job, before)
    known = drafts()
    while drafts() in ([], known) or not bpy.context.view_layer.objects.active.select_get():
        next(steps)
    next(steps)
    return steps, job


def test_a_draft_is_shown_in_place_of_its_sources(sources: list[bpy.types.Object]) -> None:
    before = state()
    steps, job = shown(no_steps())
    [collection] = drafts()
    numbers = [level_number(obj) for obj in collection.objects]
    assert sorted(number for number in numbers if number is not None) == [0, 1]
    assert not any(obj.visible_get() for obj in sources)
    active = bpy.context.view_layer.objects.active
    assert is_root(active)
    assert active.name in collection.objects, "the panel shows the draft's figures"
    steps.close()
    assert state() == before
    job.cancel()


def test_steps_that_end_before_the_draft_leave_nothing(sources: list[bpy.types.Object]) -> None:
    before = state()
    drafted, job = started()
    steps = drawn_draft(bpy.context, drafted, job, no_steps())
    while job.drafts is None:
        next(steps)
    next(steps)
    steps.close()
    assert state() == before
    job.cancel()


def test_a_draft_replaces_the_one_before(sources: list[bpy.types.Object]) -> None:
    before = state()
    first, job = shown(no_steps())
    job.cancel()
    [old] = [each.name for each in drafts()]
    bpy.context.scene.leafcloud.quality = 0.9
    second, job = shown(first)
    [new] = [each.name for each in drafts()]
    assert new != old
    assert not any(obj.visible_get() for obj in sources)
    second.close()
    assert state() == before
    job.cancel()


def test_the_levels_of_an_earlier_bake_come_back(sources: list[bpy.types.Object]) -> None:
    assert bpy.ops.leafcloud.bake() == {"FINISHED"}
    before = state()
    steps, job = shown(no_steps())
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
    sources: list[bpy.types.Object], again: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(job_operator, "running", [])
    if again:
        assert bpy.ops.leafcloud.bake() == {"FINISHED"}
    operator: Any = Bake()
    operator._start(bpy.context)
    while not drafts():
        assert operator._go_on(bpy.context) is None
    job = operator._job
    assert all_steps(operator.end(bpy.context, job.result())) == {"FINISHED"}
    assert not drafts()
    names = {obj.name for obj in bpy.context.scene.objects if obj.visible_get()}
    assert {"leaves_tree", "leaves_LOD0", "leaves_LOD1"} <= names
    assert not names & {"leaves", "branches"}, "the sources are hidden"
    assert bpy.context.view_layer.objects.active.name == "leaves_tree"


def test_a_bake_goes_on_without_a_draft(sources: list[bpy.types.Object], monkeypatch: pytest.MonkeyPatch) -> None:
    def start(prepared: Prepared, *, draft: bool = False) -> leafcloud.Job[leafcloud.Chain]:
        if draft:
            raise leafcloud.LeafcloudError("the page is too small")
        return begin(prepared)

    begin = tree_set.start
    monkeypatch.setattr(tree_set, "start", start)
    before = state()
    drafted, job = started()
    assert list(drawn_draft(bpy.context, drafted, job, no_steps())) is not None
    assert job.drafts == []
    assert len(job.result()) == 1
    assert state() == before
