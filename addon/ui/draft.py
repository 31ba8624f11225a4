"""A draft: one cloud, made in about a second and shown in place of the sources while the levels are found.

It is a bake with settings that leave nothing to the search, few views, a small page and no effects.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace

import bpy

from ..bake.tree_set import ChainsJob, finish_tree_set, free_name
from ..bake.values import Prepared
from ..levels.earlier import levels_of, remove_levels
from ..mesh.baked_levels import record_of, remember
from ..settings.bake import BakeSettings
from ..steps import Steps, in_turns
from .measured import tell
from .selection import parts_of, select_only, shown_instead

COARSEST, FINEST = 0.25, 0.05
"""ε of a draft for the qualities 0 and 1, as fractions of R: mostly larger than those that the search finds."""

_DRAFT = "leafcloud_draft"
"""The custom property of a draft's collections."""


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


def drawn_draft(
    context: bpy.types.Context, prepared: Mapping[str, Prepared], job: ChainsJob, before: Steps[None]
) -> Steps[None]:
    """Build the draft in steps once the job has its chains. Show it until the generator is closed.

    before: shows the draft of a bake that this one replaces; it is closed.
    """
    try:
        while job.drafts is None:
            yield
        if not job.drafts:
            return
        name = free_name(f"{next(iter(prepared))} draft")
        tree_set = yield from in_turns(finish_tree_set(prepared, job.drafts, name, context.scene))
        for tree in tree_set.trees:
            tree.collection[_DRAFT] = True
            remember(tree.collection, tree.prepared.tree.sources)
    finally:
        before.close()
    sources = [obj for each in prepared.values() for obj in each.tree.sources]
    earlier = [obj for each in levels_of(context.scene, sources) if not is_draft(each) for obj in each.all_objects]
    levels = [obj for obj in earlier if record_of(obj) is not None]
    try:
        with _selected_again(context), shown_instead(context.view_layer, [], [*sources, *levels]):
            for tree in tree_set.trees:
                tell(tree)
            select_only(context, parts_of(tree_set))
            while True:
                yield
    finally:
        for tree in tree_set.trees:
            remove_levels(tree.collection)


def is_draft(collection: bpy.types.Collection) -> bool:
    return _DRAFT in collection


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
