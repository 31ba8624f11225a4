"""Corrections of an imported OBJ file: the axis that points up, gray masks, and the clear glass that exporters write.

- OBJ files do not say which axis points up, and Blender's importer takes Y. A plant with its foot at 0 on Z, and with
  0 in the middle of X and Y, stands on Z, if it is as high as wide.
- `map_d` is a mask. The importer takes the alpha of its image, which a gray image lacks.
- `Tf 1 1 1` is clear glass, but exporters write it for everything.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import Literal

import bpy
import numpy as np
from mathutils import Matrix, Vector
from numpy.typing import NDArray

from ..material.images import lacks_alpha

Up = Literal["auto", "y", "z"]

_FOOT, _MIDDLE = 0.05, 0.3
"""Shares of an extent: how far below 0 a foot may be, and how far 0 must be from both ends of the width."""


def correct(objects: Collection[bpy.types.Object], up: Up) -> list[str]:
    """Correct objects that were just imported with Y up. Return a sentence for each change that nobody asked for."""
    materials = {slot.material for obj in objects for slot in obj.material_slots if slot.material is not None}
    named = sorted(materials, key=lambda material: material.name)
    for material in named:
        _use_gray_mask(material)
    notes = [note for material in named for note in _without_glass(material)]
    stands_on_z = up == "auto" and _stands_on_z(objects)
    if up == "z" or stands_on_z:
        for obj in objects:
            obj.matrix_world = Matrix.Rotation(-math.pi / 2.0, 4, "X") @ obj.matrix_world
    said = "the file is read with Z up, because the plant stands on Z; `up=y` reads it with Y up"
    return [*notes, said] if stands_on_z else notes


def _stands_on_z(objects: Collection[bpy.types.Object]) -> bool:
    """Return whether Z of the file points up. The importer has turned it to −Y."""
    bpy.context.view_layer.update()
    corners = np.array(
        [obj.matrix_world @ Vector(each) for obj in objects if obj.type == "MESH" for each in obj.bound_box]
    )
    if not len(corners):
        return False
    x, y, z = corners[:, 0], corners[:, 2], -corners[:, 1]
    is_tall = np.ptp(z) >= max(np.ptp(x), np.ptp(y))
    return bool(is_tall and _has_foot(z) and not _has_foot(y) and _is_around(x) and _is_around(y))


def _has_foot(values: NDArray[np.float64]) -> bool:
    return bool(abs(values.min()) <= _FOOT * np.ptp(values))


def _is_around(values: NDArray[np.float64]) -> bool:
    least = _MIDDLE * np.ptp(values)
    return bool(values.min() <= -least and values.max() >= least)


def _use_gray_mask(material: bpy.types.Material) -> None:
    """Link the color of an alpha image without an alpha channel in place of its alpha."""
    tree = material.node_tree
    for link in list(tree.links):
        node = link.from_node
        if node.type != "TEX_IMAGE" or link.from_socket.name != "Alpha" or node.image is None:
            continue
        colored = {
            each.from_node.image
            for each in tree.links
            if each.to_socket.name == "Base Color" and each.from_node.type == "TEX_IMAGE"
        }
        if not lacks_alpha(node.image):
            continue
        if node.image in colored:  # Exporters write the color's file for both.
            tree.links.remove(link)
        else:
            node.image.colorspace_settings.name = "Non-Color"
            tree.links.new(node.outputs["Color"], link.to_socket)


def _without_glass(material: bpy.types.Material) -> list[str]:
    principled = next((node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED"), None)
    if principled is None or principled.inputs["Transmission Weight"].default_value != 1.0:
        return []
    principled.inputs["Transmission Weight"].default_value = 0.0
    return [f"material {material.name!r}: its Tf of 1 asks for clear glass, and is left out"]
