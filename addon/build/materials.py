"""Materials of the clouds, an atlas page cut out by its alpha; and what the leaves' own materials expect of a mesh."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

import leafcloud

from ..scene.surface import read_surface
from .cloud_mesh import COLOR_NAME, UV_NAME, LayerNames


def atlas_image(name: str, pixels: NDArray[np.uint8]) -> bpy.types.Image:
    """A packed PNG image of `pixels` (h, w, 4), sRGB with straight alpha, row 0 on top.

    Blender's own PNG writer is left aside: the same pixels give the same bytes in every version.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{name}.png"
        leafcloud.write_png(str(path), pixels)
        image = bpy.data.images.load(str(path))
        image.pack()
    image.name = name
    image.filepath_raw = f"//{name}.png"
    # Colours are dilated under transparent texels and wanted there: they must not be multiplied by alpha.
    image.alpha_mode = "CHANNEL_PACKED"
    return image


def atlas_material(name: str, image: bpy.types.Image, *, alpha_cutoff: float, double_sided: bool) -> bpy.types.Material:
    """A rough Principled BSDF with the image's colour, opaque where its alpha is above `alpha_cutoff`.

    Blender's glTF exporter writes the threshold as `alphaMode` MASK with that `alphaCutoff`.
    """
    material = bpy.data.materials.new(name)
    if material.node_tree is None:  # From Blender 5.0 on every material has nodes.
        material.use_nodes = True
    material.use_backface_culling = not double_sided
    tree = material.node_tree
    surface = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
    surface.inputs["Roughness"].default_value = 1.0
    texture = tree.nodes.new("ShaderNodeTexImage")
    texture.image = image
    texture.location = (-600.0, 300.0)
    threshold = tree.nodes.new("ShaderNodeMath")
    threshold.operation = "GREATER_THAN"
    threshold.inputs[1].default_value = alpha_cutoff
    threshold.label = "Alpha cutoff"
    threshold.location = (-280.0, 100.0)
    tree.links.new(texture.outputs["Color"], surface.inputs["Base Color"])
    tree.links.new(texture.outputs["Alpha"], threshold.inputs[0])
    tree.links.new(threshold.outputs[0], surface.inputs["Alpha"])
    return material


def layer_names(materials: Sequence[bpy.types.Material | None]) -> LayerNames:
    """What the materials call the UV maps and colour attributes that they read: a new mesh needs them by that name."""
    surfaces = [read_surface(material) for material in materials]
    uv_maps = [surface.texture.uv_map for surface in surfaces if surface.texture is not None]
    colors = [name for surface in surfaces for name in (surface.color_attribute, surface.alpha_attribute)]
    return LayerNames(
        uv_maps=tuple(dict.fromkeys(name or UV_NAME for name in uv_maps)) or (UV_NAME,),
        colors=tuple(dict.fromkeys(name or COLOR_NAME for name in colors if name is not None)) or (COLOR_NAME,),
    )
