"""Baked light of LOD 0 in GLB files: `KHR_materials_unlit`, with the light as vertex colors.

A primitive has one color per corner for both sides, so the color is the mean of the light on the two sides. Clouds have
front and back billboards, and Blender's exporter writes them as unlit. glTF colors end at 1, so all light is divided by
its strength. The strength is in the materials' extras, `leafcloud.light_strength`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import bpy
import numpy as np
from numpy.typing import NDArray

from ..levels.baked_light import BACK, FRONT
from ..levels.building import BuiltLevel
from .glb_file import Glb

COLOR_OPTIONS = {"export_vertex_color": "ACTIVE", "export_all_vertex_colors": False}
"""Export options for baked light: write the vertex colors used for rendering, and no others."""

UNLIT = "KHR_materials_unlit"
_MEAN = "leafcloud_light_mean"
_KEPT = {"name", "alphaMode", "alphaCutoff", "doubleSided", "extras"}
"""Properties of an unlit material that are kept, beside the base color."""


@contextmanager
def mean_light(levels: Sequence[BuiltLevel]) -> Iterator[None]:
    """Give LOD 0 the mean light of both sides, times the leaves' own colors, as vertex colors while the block runs."""
    mesh = levels[0].object.data
    if not _is_lit(mesh):
        yield
        return
    attributes = mesh.color_attributes
    own = attributes.render_color_index
    colors = 0.5 * (_colors(mesh, FRONT) + _colors(mesh, BACK))
    if attributes[own].name not in (FRONT, BACK):
        colors *= _colors(mesh, attributes[own].name)
    added = attributes.new(_MEAN, "FLOAT_COLOR", "CORNER")
    added.data.foreach_set("color", np.minimum(colors, 1.0).ravel())
    attributes.render_color_index = attributes.find(_MEAN)
    try:
        yield
    finally:
        attributes.remove(attributes[_MEAN])
        attributes.render_color_index = own


def add_unlit(glb: Glb, collection: bpy.types.Collection) -> None:
    """Make the leaves' own materials unlit in the file that was written from `collection`."""
    meshes = [obj.data for obj in collection.all_objects if _is_lit(obj.data)]
    names = {material.name for mesh in meshes for material in mesh.materials}
    if not names:
        return
    for material in glb.materials:
        if material["name"] not in names:
            continue
        surface = material.get("pbrMetallicRoughness", {})
        kept = {key: value for key, value in material.items() if key in _KEPT}
        base = {key: value for key, value in surface.items() if key.startswith("baseColor")}
        material.clear()
        material |= {**kept, "pbrMetallicRoughness": base, "extensions": {UNLIT: {}}}
    glb.use_extension(UNLIT)


def _is_lit(mesh: bpy.types.Mesh) -> bool:
    return FRONT in mesh.color_attributes


def _colors(mesh: bpy.types.Mesh, name: str) -> NDArray[np.float32]:
    colors = np.empty(4 * len(mesh.loops), np.float32)
    mesh.color_attributes[name].data.foreach_get("color", colors)
    return colors.reshape(-1, 4)
