"""The shadow proxy: an invisible mesh of level 1's billboards that casts the leaves' shadow and never moves or fades.

Rasterizers draw all shadow casters again for every light, cut out by their textures. Billboards are few, and the proxy
keeps the shadow unchanged when levels take over. Known limit: the billboards stand among the leaves, and shade some
leaves that no other leaf shades. Coarse shadow maps hide this. Cycles does not need the proxy.
"""

from __future__ import annotations

import bpy
import numpy as np

from ..mesh.baked_levels import EXTRAS, level_number
from .building import Build
from .material import Page, atlas_material
from .mesh import create_mesh, polygon_faces, polygon_surface
from .root import put_below, root_of

_KEY = "shadow_only"
"""Custom property of a shadow proxy, under `EXTRAS`; also in glTF's extras."""
_SEEN_BY = ("camera", "diffuse", "glossy", "transmission", "volume_scatter")


def add_shadow_proxy(collection: bpy.types.Collection, build: Build) -> None:
    """Add a shadow proxy made from level 1 to the collection, and stop the levels from casting shadows.

    Trunks keep their own shadows. The proxy's texture is white, with the alpha of the level's atlas page.
    """
    name, level = f"{collection.name}_shadow", build.chain.clouds[0]
    pixels, cutoff = level.base_color.copy(), level.alpha_cutoff
    if cutoff == 0.0:  # Shadow maps store no partial opacity, so cut out at half of the greatest alpha.
        cutoff = float(pixels[..., 3].max()) / 510.0
    pixels[..., :3] = 255
    page = Page(build.images.add(name, pixels))
    material = atlas_material(name, page, alpha_cutoff=cutoff, double_sided=True)
    sizes, keys = level.polygon_sizes, np.zeros(level.triangles, np.int32)
    faces = polygon_faces(sizes, keys, np.arange(len(sizes)), mirrored=build.foliage.mirrored)
    mesh = create_mesh(name, polygon_surface(level.corners, level.uvs, faces), [material])
    for obj in collection.objects:
        obj.visible_shadow = level_number(obj) is None
    proxy = bpy.data.objects.new(name, mesh)
    root = root_of(collection)
    assert root is not None, "the levels have a root"
    put_below(root, proxy)
    proxy[EXTRAS] = {_KEY: True}
    for ray in _SEEN_BY:
        setattr(proxy, f"visible_{ray}", False)
    collection.objects.link(proxy)


def shadow_proxy_of(collection: bpy.types.Collection) -> bpy.types.Object | None:
    """Return the shadow proxy in a baked tree's collection; None if it has none."""
    return next(filter(is_shadow_proxy, collection.objects), None)


def is_shadow_proxy(obj: bpy.types.Object) -> bool:
    return _KEY in obj.get(EXTRAS, {})
