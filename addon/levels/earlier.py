"""Replacement and removal of the levels from an earlier bake."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager

import bpy

from ..mesh.baked_levels import belongs_to_bake, full_names, record
from .placed_tree import blocks_of_placed, hand_down
from .root import is_root, keep_root, root_of


def levels_of(scene: bpy.types.Scene, sources: Iterable[bpy.types.Object]) -> tuple[bpy.types.Collection, ...]:
    """Return the collections of levels in the scene that were made only from these objects, or from some of them."""
    names = set(full_names(sources))
    collections = dict.fromkeys(scene.collection.children_recursive)
    return tuple(each for each in collections if (made := record(each)) is not None and names.issuperset(made.sources))


def name_before(collections: Iterable[bpy.types.Collection], sources: Iterable[bpy.types.Object]) -> str | None:
    """Return the name of the collection with levels made from exactly these objects; None if there is no such one."""
    names = full_names(sources)
    return next(
        (each.name for each in collections if (made := record(each)) is not None and made.sources == names), None
    )


@contextmanager
def replaced(collections: Sequence[bpy.types.Collection]) -> Iterator[None]:
    """Free the names of the levels in the collections for the block's new levels. Then remove the old levels.

    Instances, children and other users of an old collection or level then use the new one made from the same sources.
    Objects that an artist has added to the collections stay. If the block fails, the old names are restored.
    """
    own = _own_blocks(collections)
    # Copies of a tree share its meshes, which then stay under another name.
    meshes = [obj.data for obj in own if isinstance(obj, bpy.types.Object) and obj.data is not None]
    names = {block: block.name for block in dict.fromkeys([*own, *meshes])}
    known = set(bpy.data.collections)
    for number, block in enumerate(names):
        block.name = f"Leafcloud earlier {number}"
    try:
        yield
    except BaseException:
        for block, name in names.items():
            block.name = name
        raise
    made = [each for each in bpy.data.collections if each not in known]
    for old in collections:
        before = record(old)
        assert before is not None
        new = next((each for each in made if (now := record(each)) is not None and now.sources == before.sources), None)
        _keep_members(old, new or bpy.context.scene.collection, own)
        if new is None:
            continue
        _put_in_place(old, new, own)
        hand_down(old, new)
        roots = [obj for obj in own if obj in list(old.objects) and is_root(obj)]
        made_now = root_of(new)
        if roots and made_now is not None:
            keep_root(roots[0], made_now)
            own.remove(roots[0])
            del names[roots[0]]
        old.user_remap(new)
        for obj in [obj for obj in old.all_objects if obj in names]:
            heir = bpy.data.objects.get(new.name + names[obj].removeprefix(before.name))
            if heir is not None:
                obj.user_remap(heir)
    for block in _still_used(own):  # By placed trees, if there is no new bake of their tree.
        own.remove(block)
        block.name = names[block]
    bpy.data.batch_remove(own)


def remove_levels(collection: bpy.types.Collection) -> None:
    """Remove a collection of levels with all that its bake made, and copies of the tree in it.

    Objects that an artist has added to it stay, in their places.
    """
    own = _own_blocks([collection], copies=True)
    _keep_members(collection, bpy.context.scene.collection, own)
    for child in [obj for obj in bpy.data.objects if obj.parent in own and obj not in own]:
        place = child.matrix_world.copy()
        child.parent = None
        child.matrix_world = place
    sets = [each for each in bpy.data.collections if collection.name in each.children and record(each) is not None]
    bpy.data.batch_remove([*own, *(each for each in sets if len(each.children) == 1 and not each.objects)])


def _keep_members(old: bpy.types.Collection, new: bpy.types.Collection, own: Collection[bpy.types.ID]) -> None:
    """Link to `new` the objects and collections that an artist has added to `old`."""
    for members, heirs in ((old.objects, new.objects), (old.children, new.children)):
        for member in [each for each in members if each not in own and each.name not in heirs]:
            heirs.link(member)


def _put_in_place(old: bpy.types.Collection, new: bpy.types.Collection, own: Collection[bpy.types.ID]) -> None:
    """Move `new` from the scene's root collection to the parent collections of `old`."""
    roots = [scene.collection.children for scene in bpy.data.scenes]
    parents = [*roots, *(each.children for each in bpy.data.collections if each not in own)]
    places = [children for children in parents if old.name in children]
    for children in places:
        children.unlink(old)
    root = next((children for children in roots if new.name in children), None)
    if places and root is not None:
        root.unlink(new)
        for children in places:
            children.link(new)


def _own_blocks(collections: Iterable[bpy.types.Collection], *, copies: bool = False) -> list[bpy.types.ID]:
    """Return the collections, their members that the bake made, and meshes, materials and images used only there.

    copies: also copies of the tree. Without them, data that only the placed trees of a collection use counts, too: a
    new bake gives them new data.
    """
    own: dict[bpy.types.ID, None] = {}
    placed: set[bpy.types.ID] = set()
    for collection in collections:
        made = record(collection)
        assert made is not None
        members = [*collection.children_recursive, *collection.all_objects]
        own |= dict.fromkeys([collection, *(each for each in members if each.name_full in made.made)])
        own |= dict.fromkeys(each for each in members if copies and belongs_to_bake(each))
        placed |= set() if copies else blocks_of_placed(collection)
    users = bpy.data.user_map()
    for kind in (bpy.data.meshes, bpy.data.materials, bpy.data.images):
        mine = [
            block
            for block in kind
            if users.get(block) and users[block] <= own.keys() | placed and not block.use_fake_user
        ]
        own |= dict.fromkeys(mine)
    return list(own)


def _still_used(own: Sequence[bpy.types.ID]) -> list[bpy.types.ID]:
    """Return the meshes, materials and images among these blocks that others use, or that the returned ones use."""
    users, mine = bpy.data.user_map(), set(own)
    found: dict[bpy.types.ID, None] = {}
    for kind in (bpy.types.Mesh, bpy.types.Material, bpy.types.Image):
        for block in (block for block in own if isinstance(block, kind)):
            if users.get(block, set()) - mine or users.get(block, set()) & found.keys():
                found[block] = None
    return list(found)
