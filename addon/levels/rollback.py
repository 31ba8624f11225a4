"""Removal of the data-blocks that a failed operation has created."""

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
