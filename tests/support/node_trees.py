"""Helpers that build materials node by node."""

from __future__ import annotations

import warnings
from contextlib import closing
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from addon.levels.images import PackedImages
from addon.steps import all_steps


def new_material() -> tuple[bpy.types.Material, bpy.types.Node, Any]:
    """Return a new material, its Principled BSDF and its node tree."""
    material = bpy.data.materials.new("m")
    with warnings.catch_warnings():  # Blender 5 always uses nodes and deprecates the setting
        warnings.simplefilter("ignore", DeprecationWarning)
        material.use_nodes = True
    return material, material.node_tree.nodes["Principled BSDF"], material.node_tree


def new_image(
    name: str,
    pixels: list[list[tuple[float, ...]]],
    *,
    is_float: bool = False,
    space: str = "sRGB",
    alpha_mode: str = "STRAIGHT",
) -> bpy.types.Image:
    """Return an image in memory. The first row is the top row."""
    values = np.array(pixels, np.float32)[::-1]
    image = bpy.data.images.new(name, values.shape[1], values.shape[0], alpha=True, float_buffer=is_float)
    image.colorspace_settings.name = space
    image.alpha_mode = alpha_mode
    image.pixels.foreach_set(values.ravel())
    return image


def atlas_image(name: str, pixels: NDArray[np.uint8], *, data: bool = False) -> bpy.types.Image:
    """Create a packed image as levels have them."""
    with closing(PackedImages()) as images:
        image = images.add(name, pixels, data=data)
        all_steps(images.packed())
        return image


def texture_node(tree: Any, image: bpy.types.Image | None) -> bpy.types.Node:
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    return node


def math_node(tree: Any, operation: str, first: Any, second: Any = 0.0) -> bpy.types.NodeSocket:
    """Add a Math node and return its output. Each operand is a number or an output socket."""
    node = tree.nodes.new("ShaderNodeMath")
    node.operation = operation
    for target, value in zip(node.inputs, (first, second), strict=False):
        if isinstance(value, float):
            target.default_value = value
        else:
            tree.links.new(value, target)
    return node.outputs[0]
