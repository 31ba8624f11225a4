"""Which objects of a scene are a tree, where there are several: by their topmost parents or by their collections."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence

import bpy

from . import SceneError
from .extract import Tree, extract, part_names

Groups = Mapping[str, Sequence[bpy.types.Object]]
"""The objects of each tree, by its name."""


def grouped(objects: Iterable[bpy.types.Object], trees: str) -> dict[str, list[bpy.types.Object]]:
    """Parts objects into trees: `trees` is one of "parents" and "collections", as in `BakeSettings`.

    Of an object in several collections the first counts, in the order of their names. What is linked from libraries may
    have one name several times; then it is numbered.
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
    """`name`, with the first number behind it with which it is not taken, if it is."""
    names = itertools.chain([name], (f"{name}_{number}" for number in itertools.count(2)))
    return next(name for name in names if not is_taken(name))


def rendered(layer: bpy.types.ViewLayer) -> list[bpy.types.Object]:
    """What is visible and renders."""
    return [obj for obj in layer.objects if obj.visible_get(view_layer=layer) and not obj.hide_render]


def extract_trees(
    depsgraph: bpy.types.Depsgraph, groups: Groups, *, leaf_names: Sequence[str] | None = None
) -> dict[str, Tree]:
    """Reads each tree, in the order of their names; what has no faces, as a camera, is none.

    With `leaf_names`, as for `extract`, only groups that have one of them are trees: a ground is left out.
    Raises `SceneError` as `extract` does, with the tree's name, for a name that no group has, and where there is none.
    """
    found = {name: part_names(depsgraph, groups[name]) for name in sorted(groups)}
    wanted = set(leaf_names or ())
    missing = wanted - set().union(*found.values())
    if missing:
        raise SceneError(f"no object or material is named {min(missing)!r}; check the names of the leaves")
    trees = {}
    for name, names in found.items():
        own = sorted(wanted & names)
        if not names or (wanted and not own):
            continue
        try:
            trees[name] = extract(depsgraph, groups[name], leaf_names=own or None, name=name)
        except SceneError as error:
            raise SceneError(f"tree {name!r}: {error}") from error
    if not trees:
        raise SceneError("no object with faces is there that could be a tree; select the trees' leaves and wood")
    return trees


def _topmost_parent(obj: bpy.types.Object) -> bpy.types.Object:
    while obj.parent is not None:
        obj = obj.parent
    return obj


def _collection(obj: bpy.types.Object) -> bpy.types.Collection:
    return min(obj.users_collection, key=lambda collection: collection.name)
