"""Grouping of a scene's objects into several trees, by topmost parent or by collection."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence

import bpy

from ..errors import SceneError
from ..geometry import Tree
from ..plan.leaves import named
from .extract import extract, part_names

Groups = Mapping[str, Sequence[bpy.types.Object]]
"""The objects of each tree, by its name."""


def grouped(objects: Iterable[bpy.types.Object], trees: str) -> dict[str, list[bpy.types.Object]]:
    """Group objects into trees by `trees`: "parents" or "collections", as in `BakeSettings`.

    An object in several collections belongs to the first by name. Owners linked from libraries may share a name; then
    the trees get numbered names.
    """
    owner_of = {"parents": _topmost_parent, "collections": _collection}[trees]
    groups: dict[bpy.types.ID, list[bpy.types.Object]] = {}
    for obj in objects:
        groups.setdefault(owner_of(obj), []).append(obj)
    named: dict[str, list[bpy.types.Object]] = {}
    for owner, members in groups.items():
        named[numbered(owner.name, named.__contains__)] = members
    return named


def numbered(name: str, is_taken: Callable[[str], bool]) -> str:
    """Return `name`; if taken, `name` with the first free number from 2 up appended."""
    names = itertools.chain([name], (f"{name}_{number}" for number in itertools.count(2)))
    return next(name for name in names if not is_taken(name))


def rendered(layer: bpy.types.ViewLayer) -> list[bpy.types.Object]:
    """Return the objects that are visible and enabled for rendering."""
    return [obj for obj in layer.objects if obj.visible_get(view_layer=layer) and not obj.hide_render]


def extract_trees(
    depsgraph: bpy.types.Depsgraph, groups: Groups, *, leaf_names: Sequence[str] | None = None
) -> dict[str, Tree]:
    """Read each tree, in the order of their names. Groups without faces, such as a camera, are skipped.

    `leaf_names`: as for `extract`. Groups without any of these names, such as the ground, are skipped.
    Raises `SceneError` as `extract` does, with the tree's name added; also for a name that no group has, and if no tree
    is found.
    """
    found = {name: part_names(depsgraph, groups[name]) for name in sorted(groups)}
    here = set().union(*found.values())
    missing = [name for name in leaf_names or () if not named(name, here)]
    if missing:
        raise SceneError(f"no object or material is named {min(missing)!r}; check the names of the leaves")
    trees = {}
    for name, names in found.items():
        own = sorted(set().union(*(named(name, names) for name in leaf_names or ())))
        if not names or (leaf_names and not own):
            continue
        try:
            trees[name] = extract(depsgraph, groups[name], leaf_names=own or None, name=name)
        except SceneError as error:
            raise SceneError(f"tree {name!r}: {error}") from error
    if not trees:
        raise SceneError("no object with faces found to bake as a tree; select the trees' leaves and trunks")
    return trees


def _topmost_parent(obj: bpy.types.Object) -> bpy.types.Object:
    while obj.parent is not None:
        obj = obj.parent
    return obj


def _collection(obj: bpy.types.Object) -> bpy.types.Collection:
    return min(obj.users_collection, key=lambda collection: collection.name)
