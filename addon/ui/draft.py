"""A draft: one cloud, made in about a second and shown in place of the sources while the levels are found.

It is a bake with settings that leave nothing to the search, few views, a small page and no effects.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace

import bpy

from ..bake.pipeline import file_name
from ..bake.tree_set import ChainsJob, finish_tree_set, free_name, prepare_tree_set
from ..bake.values import Prepared, TreeSet
from ..geometry import Tree
from ..levels.earlier import levels_of, remove_levels
from ..mesh.baked_levels import record, record_of, remember
from ..settings.bake import BakeSettings
from ..steps import Steps, all_steps
from .handlers import Handlers
from .job_operator import running
from .measured import keep_figures
from .selection import parts_of, select_only, shown_instead

COARSEST, FINEST = 0.25, 0.05
"""ε of a draft for the qualities 0 and 1, as fractions of R: mostly larger than those that the search finds."""

MOST_TRIANGLES = 200_000
"""Triangles of leaves up to which there is a draft: it is built in one step, a fifth of a second for half of them."""

_DRAFT = "leafcloud_draft"
"""The custom property of a draft's collections."""


def prepared_draft(trees: Mapping[str, Tree], settings: BakeSettings) -> dict[str, Prepared]:
    """Prepare the drafts of a bake of these trees; empty if it has none."""
    triangles = sum(len(tree.leaves.triangles) for tree in trees.values())
    if settings.chain == "pruning" or triangles > MOST_TRIANGLES:
        return {}
    drafts = {file_name(f"draft {name}"): tree for name, tree in trees.items()}
    return prepare_tree_set(drafts, draft_of(settings), None)


def draft_of(settings: BakeSettings) -> BakeSettings:
    """Return the settings of a draft of a bake."""
    coarse = COARSEST + (FINEST - COARSEST) * settings.quality
    return replace(
        BakeSettings(),
        epsilon=settings.epsilon or coarse,
        pixels=settings.switch_pixels,
        levels=1,
        cross=False,
        last="cross",
        texture_size=256,
        samples=2,
        min_visibility=0.0,
        effects="none",
    )


def drawn_draft(context: bpy.types.Context, prepared: Mapping[str, Prepared], job: ChainsJob) -> Steps[None]:
    """Build the draft once the job has its chains. Show it until the generator is closed."""
    while job.drafts is None:
        yield
    if not job.drafts:
        return
    sources = [obj for each in prepared.values() for obj in each.tree.sources]
    earlier = [obj for each in levels_of(context.scene, sources) for obj in each.all_objects]
    levels, groups = [obj for obj in earlier if record_of(obj) is not None], set(bpy.data.node_groups)
    name = free_name(next(iter(prepared)))
    tree_set = all_steps(finish_tree_set(prepared, job.drafts, name, context.scene))
    try:
        _mark(tree_set)
        with _selected_again(context), shown_instead(context.view_layer, [], [*sources, *levels]):
            for tree in tree_set.trees:
                keep_figures(tree)
            select_only(context, parts_of(tree_set))
            while True:
                yield
    finally:
        for tree in tree_set.trees:
            remove_levels(tree.collection)
        while made := [each for each in bpy.data.node_groups if each not in groups and not each.users]:
            bpy.data.batch_remove(made)  # Groups in it lose their last user.
        context.view_layer.update()  # Its list of objects has gaps before.


def _mark(tree_set: TreeSet) -> None:
    """Mark the collections as a draft, and note how they were made."""
    made = {tree.collection: tree.prepared.tree.sources for tree in tree_set.trees}
    made.setdefault(tree_set.collection, tuple(obj for sources in made.values() for obj in sources))
    for collection, sources in made.items():
        collection[_DRAFT] = True
        remember(collection, sources, identify=False)


def is_draft(collection: bpy.types.Collection) -> bool:
    return _DRAFT in collection


def remove_left_drafts(*_: object) -> None:
    """Remove drafts if no bake runs, and show the objects that they hide. Undo and saved files can bring them back."""
    if running:
        return
    scene, layer = bpy.context.scene, bpy.context.view_layer
    for collection in [each for each in bpy.data.collections if is_draft(each) and each.objects]:
        made, here = record(collection), set(layer.objects)
        sources = [obj for obj in here if made is not None and obj.name_full in made.sources]
        earlier = [obj for each in levels_of(scene, sources) if not is_draft(each) for obj in each.all_objects]
        for obj in here.intersection(earlier or sources):
            obj.hide_set(False)
            obj.hide_render = False
        remove_levels(collection)
        layer.update()


HANDLERS: Handlers = [(name, remove_left_drafts) for name in ("undo_post", "redo_post", "load_post")]


@contextmanager
def _selected_again(context: bpy.types.Context) -> Iterator[None]:
    """Restore the selection and the active object at the end."""
    selected, active = context.selected_objects, context.view_layer.objects.active
    try:
        yield
    finally:
        for obj in selected:
            obj.select_set(True)
        context.view_layer.objects.active = active
