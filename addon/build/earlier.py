"""Levels of an earlier bake: which objects they were made of, and how the levels of a new bake take their place.

A collection of levels remembers names, not objects: a pointer would keep objects in the file that an artist has
deleted, and would bring them along wherever the collection is appended.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager

import bpy

from ..scene.baked_levels import BAKE, made_names, source_names


def remember(collection: bpy.types.Collection, sources: Iterable[bpy.types.Object]) -> None:
    """Note in a collection which objects its levels were made of, and which of its members the bake has made."""
    members = [*collection.all_objects, *collection.children_recursive]
    collection[BAKE] = json.dumps({"sources": _names(sources), "made": _names(members)})


def levels_of(scene: bpy.types.Scene, sources: Iterable[bpy.types.Object]) -> tuple[bpy.types.Collection, ...]:
    """The collections of levels in the scene that were made of these objects, or of some of them."""
    names = set(_names(sources))
    collections = scene.collection.children_recursive
    return tuple(each for each in collections if (made_of := source_names(each)) and names.issuperset(made_of))


def name_before(collections: Sequence[bpy.types.Collection], sources: Collection[bpy.types.Object]) -> str | None:
    """The name of the collection whose levels were made of just these objects, if one of the collections is that."""
    names = _names(sources)
    return next((each.name for each in collections if sorted(source_names(each)) == names), None)


@contextmanager
def replaced(collections: Sequence[bpy.types.Collection]) -> Iterator[None]:
    """Let the block make new levels under the names of those in the collections; then remove the old ones.

    Instances, parents and other users of an old level or collection use the new one of its name afterwards. Objects
    that an artist has added to the collections stay. When the block fails, all is as it was.
    """
    own = _own_blocks(collections)
    names = {block: block.name for block in own}
    for number, block in enumerate(own):
        block.name = f"Leafcloud earlier {number}"
    try:
        yield
    except BaseException:
        for block, name in names.items():
            block.name = name
        raise
    for block, name in names.items():
        if isinstance(block, bpy.types.Collection):
            new = bpy.data.collections.get(name)
            _keep_members(block, new or bpy.context.scene.collection, own)
            if new is not None:
                _put_in_place(block, new)
                block.user_remap(new)
        if isinstance(block, bpy.types.Object) and name in bpy.data.objects:
            block.user_remap(bpy.data.objects[name])
    bpy.data.batch_remove(own)


def _keep_members(old: bpy.types.Collection, new: bpy.types.Collection, own: Collection[bpy.types.ID]) -> None:
    """Put into `new` whatever an artist has added to `old`."""
    _keep(old.objects, new.objects, own)
    _keep(old.children, new.children, own)


def _keep(
    old: bpy.types.bpy_prop_collection, new: bpy.types.bpy_prop_collection, own: Collection[bpy.types.ID]
) -> None:
    for member in [each for each in old if each not in own and each.name not in new]:
        new.link(member)


def _put_in_place(old: bpy.types.Collection, new: bpy.types.Collection) -> None:
    """Link `new` where `old` is linked, and nowhere else."""
    parents = [*(scene.collection for scene in bpy.data.scenes), *bpy.data.collections]
    for children in [parent.children for parent in parents]:
        was, here = old.name in children, new.name in children
        if was:
            children.unlink(old)
        if was and not here:
            children.link(new)
        if here and not was:
            children.unlink(new)


def _own_blocks(collections: Iterable[bpy.types.Collection]) -> list[bpy.types.ID]:
    """The collections, what the bake made in them, and the meshes, materials and images that nothing else uses."""
    made = {name for each in collections for name in made_names(each)}
    own: dict[bpy.types.ID, None] = {}
    for collection in collections:
        members = [*collection.children_recursive, *collection.all_objects]
        own |= dict.fromkeys([collection, *(each for each in members if each.name_full in made)])
    users = bpy.data.user_map()
    for kind in (bpy.data.meshes, bpy.data.materials, bpy.data.images):
        mine = [block for block in kind if users.get(block) and users[block] <= own.keys() and not block.use_fake_user]
        own |= dict.fromkeys(mine)
    return list(own)


def _names(blocks: Iterable[bpy.types.ID]) -> list[str]:
    return sorted(block.name_full for block in blocks)
