"""What casts the leaves' shadow and is not seen: the billboards of level 1, in one mesh that neither moves nor fades.

Rasterisers draw all that casts a shadow again for every light, cut out by its texture. Billboards are few, and their
shadow does not change as levels take over from one another. Known limit: they stand among the leaves that they were
made of, and shade some that no leaf shades; so this is for lights whose shadows are coarse anyway, and nothing that
Cycles needs.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import bpy
import numpy as np
from mathutils import Matrix

import leafcloud

from ..placement import Placement
from .baked_trees import level_number
from .cloud_mesh import create_mesh, fan_surface, fans
from .levels import EXTRAS
from .materials import Page, atlas_image, atlas_material

_KEY = "shadow_only"
"""What says so among the object's custom properties, and in glTF's extras."""
_SEEN_BY = ("camera", "diffuse", "glossy", "transmission", "volume_scatter")


def add_shadow_proxy(collection: bpy.types.Collection, level: leafcloud.Level, placement: Placement) -> None:
    """Puts a proxy beside the levels of a baked tree, which cast no shadow from then on; the wood goes on with its own.

    Its page is white, and has the alpha of the level's for engines.
    """
    name = f"{collection.name}_shadow"
    pixels, cutoff = level.for_engines()
    if cutoff == 0.0:  # Shadow maps know no shades.
        cutoff = float(pixels[..., 3].max()) / 510.0
    pixels[..., :3] = 255
    material = atlas_material(name, Page(atlas_image(name, pixels)), alpha_cutoff=cutoff, double_sided=True)
    faces = fans(np.zeros((len(level.corners), level.corners.shape[1] - 2), np.int32), placement)
    mesh = create_mesh(name, fan_surface(placement.to_tree(level.corners), level.uvs, faces), [material])
    for obj in collection.objects:
        obj.visible_shadow = level_number(obj) is None
    proxy = bpy.data.objects.new(name, mesh)
    proxy.matrix_world = Matrix(placement.matrix.tolist())
    proxy[EXTRAS] = {_KEY: True}
    for ray in _SEEN_BY:
        setattr(proxy, f"visible_{ray}", False)
    collection.objects.link(proxy)


def shadow_proxy_of(collection: bpy.types.Collection) -> bpy.types.Object | None:
    """That of a baked tree, if it has one."""
    return next(filter(is_shadow_proxy, collection.objects), None)


def is_shadow_proxy(obj: bpy.types.Object) -> bool:
    return _KEY in obj.get(EXTRAS, {})


@contextmanager
def left_out(collection: bpy.types.Collection, obj: bpy.types.Object) -> Iterator[None]:
    """Takes the object out of the collection for a while: who draws all that is in a file would draw it, too."""
    collection.objects.unlink(obj)
    try:
        yield
    finally:
        collection.objects.link(obj)
