"""The selected objects as trees. A selected level is replaced by the source objects of its bake."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager

import bpy

from ..bake.values import TreeSet
from ..errors import SceneError
from ..levels.earlier import levels_of
from ..levels.root import root_of
from ..mesh.baked_levels import is_placed_tree, is_source, record_of
from ..mesh.extract import Tree, extract
from ..mesh.motion import at_rest
from ..mesh.trees import extract_trees, grouped
from .properties import leaf_names


@contextmanager
def selected_trees(context: bpy.types.Context) -> Iterator[dict[str, Tree]]:
    """Yield the trees in the selection by name, divided by the setting `trees`.

    During the block the scene shows the source objects in place of the levels of an earlier bake.
    Raise one of `job_operator.REFUSALS`.
    """
    with trees_of(context, _selected_sources(context), context.scene.leafcloud.trees) as trees:
        yield trees


@contextmanager
def trees_of(
    context: bpy.types.Context, sources: Sequence[bpy.types.Object], division: str
) -> Iterator[dict[str, Tree]]:
    """Yield the trees of these source objects by name, divided by a value of the setting `trees`.

    During the block the scene shows the objects in place of the levels of an earlier bake. Raises as `selected_trees`.
    """
    settings = context.scene.leafcloud
    members = (obj for collection in levels_of(context.scene, sources) for obj in collection.all_objects)
    levels = [obj for obj in members if record_of(obj) is not None]
    with shown_instead(context.view_layer, sources, levels), at_rest(context.view_layer):
        depsgraph, names = context.evaluated_depsgraph_get(), leaf_names(settings)
        if division == "one":
            tree = extract(depsgraph, sources, leaf_names=names)
            yield {tree.name: tree}
        else:
            yield extract_trees(depsgraph, grouped(sources, division), leaf_names=names)


def _selected_sources(context: bpy.types.Context) -> list[bpy.types.Object]:
    """Return the selected objects, each baked level replaced by its sources, and each empty followed by its children.

    Raise `SceneError` for a missing source.
    """
    here = {obj.name_full: obj for obj in context.view_layer.objects}
    sources: dict[bpy.types.Object, None] = {}
    objects = with_children(context)
    trees = [obj for obj in objects if not is_placed_tree(obj)]
    if objects and not trees:
        raise SceneError(f"object {objects[0].name!r} is a placed tree: select the baked tree, or the tree's sources")
    for obj in trees:
        made = record_of(obj)
        names = (obj.name_full,) if made is None else made.sources
        lost = [name for name in names if name not in here]
        if lost:
            raise SceneError(
                f"object {obj.name!r} belongs to a baked tree, and the view layer lacks the tree's source objects "
                f"{', '.join(map(repr, lost[:8]))}: restore them under these names, or select another tree"
            )
        sources |= {here[name]: None for name in names}
    return list(sources)


def select_only(context: bpy.types.Context, objects: Sequence[bpy.types.Object]) -> None:
    """Select these objects alone, and make the first of them active."""
    for obj in context.selected_objects:
        obj.select_set(False)
    for obj in objects:
        obj.select_set(True)
    context.view_layer.objects.active = objects[0]


def parts_of(tree_set: TreeSet) -> list[bpy.types.Object]:
    """Return the trees' roots, then all objects below them: an artist duplicates a tree as a whole."""
    roots = [root for tree in tree_set.trees if (root := root_of(tree.collection)) is not None]
    return [*roots, *(obj for root in roots for obj in root.children_recursive)]


def with_children(context: bpy.types.Context) -> list[bpy.types.Object]:
    """Return the selected objects, and after each empty the objects below it: they are the tree that it stands for.

    Hidden objects below it count only if they are the sources of an earlier bake, which hid them.
    """
    selected = list(context.selected_objects)
    if all(obj.type != "EMPTY" for obj in selected):
        return selected
    below: dict[bpy.types.Object | None, list[bpy.types.Object]] = {}
    for obj in context.view_layer.objects:
        below.setdefault(obj.parent, []).append(obj)
    found: dict[bpy.types.Object, None] = {}
    ahead = [obj for obj in reversed(selected) if obj.type == "EMPTY"]
    while ahead:
        obj = ahead.pop()
        if obj not in found:
            found[obj] = None
            ahead += [child for child in below.get(obj, []) if child.visible_get() or is_source(child)]
    return list(found | dict.fromkeys(selected))


@contextmanager
def shown_instead(
    layer: bpy.types.ViewLayer, shown: Sequence[bpy.types.Object], hidden: Iterable[bpy.types.Object]
) -> Iterator[None]:
    """Show some objects of the layer in the view and in renders, and hide others. Restore all of them at the end."""
    here = set(layer.objects)
    wanted = {**dict.fromkeys(shown, False), **{obj: True for obj in hidden if obj in here}}
    before = {obj: (obj.hide_get(view_layer=layer), obj.hide_render) for obj in wanted}
    selected = [obj for obj in wanted if obj.select_get(view_layer=layer)]
    try:
        for obj, hide in wanted.items():
            obj.hide_set(hide, view_layer=layer)
            obj.hide_render = hide
        yield
    finally:
        for obj, (in_view, in_renders) in before.items():
            obj.hide_set(in_view, view_layer=layer)
            obj.hide_render = in_renders
        for obj in selected:  # Hiding an object deselects it.
            obj.select_set(True, view_layer=layer)
