"""Changes to the open file that are undone: blocks of a failed operation, objects that an export leaves out."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import bpy


@contextmanager
def removed_on_failure() -> Iterator[None]:
    """Remove every object, collection, mesh, material, image and node group that the block has created if it fails."""
    data = bpy.data
    kinds = (data.objects, data.collections, data.meshes, data.materials, data.images, data.node_groups)
    before = [set(kind) for kind in kinds]
    try:
        yield
    except BaseException:
        for kind, known in zip(kinds, before, strict=True):
            for made in [item for item in kind if item not in known]:
                kind.remove(made)
        raise


@contextmanager
def left_out(collection: bpy.types.Collection, obj: bpy.types.Object) -> Iterator[None]:
    """Unlink the object from the collection during the block, for exports: files do not have it."""
    collection.objects.unlink(obj)
    try:
        yield
    finally:
        collection.objects.link(obj)
