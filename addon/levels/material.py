"""Materials of the billboard levels, made from atlas pages, and the mesh layer names that leaf materials read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import bpy
import numpy as np
from numpy.typing import NDArray

from ..material.shading import USUAL_SPECULAR
from ..material.surface import read_surface
from .mesh import COLOR_NAME, UV_NAME, LayerNames

PAGE_NODE = "Leafcloud Page"
CUTOFF_NODE = "Leafcloud Cutoff"
BENT_NORMAL_NODE = "Bent Normal"
TRANSLUCENCY_NODE = "Leafcloud Translucency"
SHARE_NODE = "Leafcloud Translucent Share"
BACK_NODE = "Leafcloud Back"


@dataclass(frozen=True)
class Page:
    """Images and values of a level's material.

    name: of the level, with which the names of its images begin.
    normal: tangent-space normal map. orm: occlusion, roughness and metallic in red, green and blue.
    bent_normal: bent-normal occlusion in the billboards' axes (`leafcloud.Level.bent_normal`).
    """

    base_color: bpy.types.Image
    normal: bpy.types.Image | None = None
    orm: bpy.types.Image | None = None
    occluded: bool = False
    """Whether the red channel of `orm` holds occlusion."""
    bent_normal: bpy.types.Image | None = None
    translucency: bpy.types.Image | None = None
    """Color of the transmitted light. With `opaque_parts` alpha is 0 where no light is transmitted."""
    share: float = 0.0
    """Fraction of the light that is transmitted instead of reflected."""
    opaque_parts: bool = False
    roughness: float = 1.0
    metallic: float = 0.0
    """Roughness and metallic are used if `orm` is None."""
    specular: float = USUAL_SPECULAR
    """Specular IOR Level."""
    name: str = ""


def atlas_material(name: str, page: Page, *, alpha_cutoff: float, double_sided: bool) -> bpy.types.Material:
    """Create a material with a Principled BSDF that uses the page's images.

    It is cut out: opaque where the base color's alpha is above `alpha_cutoff`. With `alpha_cutoff` 0 it is alpha
    blended. Blender's glTF exporter writes a cutout as `alphaMode` MASK with that `alphaCutoff` and blending as BLEND.
    Normals become `normalTexture`, roughness and metallic `metallicRoughnessTexture`.

    A Mix Shader adds translucency: (1 − share) · Principled BSDF + share · Translucent BSDF. Leaf materials are read
    the same way (`material.translucency`). Highlights become weaker by the same fraction.
    """
    material = bpy.data.materials.new(name)
    if material.node_tree is None:  # From Blender 5.0 on every material has nodes.
        material.use_nodes = True
    material.use_backface_culling = not double_sided
    tree = material.node_tree
    surface = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
    surface.inputs["Roughness"].default_value = page.roughness
    surface.inputs["Metallic"].default_value = page.metallic
    surface.inputs["Specular IOR Level"].default_value = page.specular
    texture = _image_node(tree, page.base_color, 300.0)
    texture.name = PAGE_NODE
    opacity = shown_share(tree, texture, alpha_cutoff)
    tree.links.new(texture.outputs["Color"], surface.inputs["Base Color"])
    tree.links.new(opacity, surface.inputs["Alpha"])
    if page.orm is not None:
        parts = _add_orm(tree, surface, page.orm)
        if page.occluded:
            tree.links.new(parts.outputs["Red"], _gltf_output(tree).inputs["Occlusion"])
    if page.normal is not None:
        _add_normal(tree, surface, page.normal)
    if page.translucency is not None:
        _shine_through(tree, surface, opacity, page, cut_out=alpha_cutoff > 0.0)
    if page.bent_normal is not None:
        _add_bent_normal(tree, page.bent_normal)
    if not double_sided:
        hide_back_in_cycles(tree)
    tree.nodes.active = texture  # The texture that Workbench shows.
    return material


def page_of(material: bpy.types.Material | None) -> tuple[bpy.types.Image | None, float] | None:
    """Return the atlas page of a level's material and its alpha cutoff, 0 if blended; None for other materials."""
    if material is None or material.node_tree is None:
        return None
    nodes = material.node_tree.nodes
    page, cutoff = nodes.get(PAGE_NODE), nodes.get(CUTOFF_NODE)
    if page is None:
        return None
    return page.image, 0.0 if cutoff is None else float(cutoff.inputs[1].default_value)


def shown_share(tree: bpy.types.NodeTree, texture: bpy.types.Node, alpha_cutoff: float) -> bpy.types.NodeSocket:
    """Return the opacity of a page: 1 where its alpha is above the cutoff, else 0. With cutoff 0 it is the alpha."""
    if alpha_cutoff == 0.0:
        return texture.outputs["Alpha"]
    threshold = _node(tree, "ShaderNodeMath", (-280.0, 100.0))
    threshold.name, threshold.label = CUTOFF_NODE, "Alpha cutoff"
    threshold.operation = "GREATER_THAN"
    threshold.inputs[1].default_value = alpha_cutoff
    tree.links.new(texture.outputs["Alpha"], threshold.inputs[0])
    return threshold.outputs[0]


def hide_back_in_cycles(tree: bpy.types.NodeTree, hidden: bpy.types.NodeSocket | None = None) -> None:
    """Add an output for Cycles that makes back faces transparent, because Cycles has no backface culling.

    Otherwise front and back billboards would both be visible and shade each other. `hidden`: a value that is 1 where
    the surface is transparent, in place of all back faces.
    """
    output = next(node for node in tree.nodes if node.type == "OUTPUT_MATERIAL")
    side, clear, front, shown = (
        _node(tree, f"Shader{kind}", place)
        for kind, place in (
            ("NodeNewGeometry", (300.0, 700.0)),
            ("NodeBsdfTransparent", (300.0, 450.0)),
            ("NodeMixShader", (500.0, 500.0)),
            ("NodeOutputMaterial", (700.0, 500.0)),
        )
    )
    seen = output.inputs["Surface"].links[0].from_socket
    for source, target in zip(
        (hidden or side.outputs["Backfacing"], seen, clear.outputs[0]), front.inputs, strict=True
    ):
        tree.links.new(source, target)
    front.name = BACK_NODE
    tree.links.new(front.outputs[0], shown.inputs["Surface"])
    shown.target = "CYCLES"
    output.is_active_output = True


def _add_orm(tree: bpy.types.NodeTree, surface: bpy.types.Node, image: bpy.types.Image) -> bpy.types.Node:
    """Link the image's green to roughness and its blue to metallic. Return the Separate Color node."""
    parts = _node(tree, "ShaderNodeSeparateColor", (-280.0, -100.0))
    tree.links.new(_image_node(tree, image, 0.0).outputs["Color"], parts.inputs[0])
    tree.links.new(parts.outputs["Green"], surface.inputs["Roughness"])
    tree.links.new(parts.outputs["Blue"], surface.inputs["Metallic"])
    return parts


def _add_normal(tree: bpy.types.NodeTree, surface: bpy.types.Node, image: bpy.types.Image) -> None:
    normal = _node(tree, "ShaderNodeNormalMap", (-280.0, -300.0))
    tree.links.new(_image_node(tree, image, -300.0).outputs["Color"], normal.inputs["Color"])
    tree.links.new(normal.outputs["Normal"], surface.inputs["Normal"])


def _add_bent_normal(tree: bpy.types.NodeTree, image: bpy.types.Image) -> None:
    """Add the bent-normal occlusion as an unlinked image node.

    Blender's renderers do not use it. The export and custom shaders do.
    """
    _image_node(tree, image, -600.0).name = BENT_NORMAL_NODE


def _shine_through(
    tree: bpy.types.NodeTree, surface: bpy.types.Node, opacity: bpy.types.NodeSocket, page: Page, *, cut_out: bool
) -> None:
    """Mix a Translucent BSDF into the surface with the factor `page.share`.

    With `cut_out` the factor is also multiplied by the opacity. So the Principled BSDF keeps its alpha, where exporters
    look for the cutout. Without `cut_out` both shaders have the same opacity.
    """
    texture = _image_node(tree, page.translucency, -900.0)
    texture.name = TRANSLUCENCY_NODE
    translucent, mix = (
        _node(tree, f"Shader{kind}", (40.0, height))
        for kind, height in (("NodeBsdfTranslucent", -600.0), ("NodeMixShader", 500.0))
    )
    tree.links.new(texture.outputs["Color"], translucent.inputs["Color"])
    for link in list(surface.inputs["Normal"].links):
        tree.links.new(link.from_socket, translucent.inputs["Normal"])
    behind = translucent.outputs[0]
    share = _times(tree, opacity if cut_out else 1.0, page.share, 300.0)
    share.node.name = SHARE_NODE
    if not cut_out:
        behind = _as_far_as(tree, opacity, behind)
    if page.opaque_parts:
        share = _times(tree, share, texture.outputs["Alpha"], 500.0)
    [output] = [link.to_socket for link in surface.outputs[0].links]
    for source, target in zip((share, surface.outputs[0], behind), mix.inputs, strict=True):
        tree.links.new(source, target)
    tree.links.new(mix.outputs[0], output)


def _as_far_as(
    tree: bpy.types.NodeTree, opacity: bpy.types.NodeSocket, shader: bpy.types.NodeSocket
) -> bpy.types.NodeSocket:
    """Return `shader` mixed with a Transparent BSDF: `opacity` is the fraction of `shader`."""
    clear, mix = (
        _node(tree, f"Shader{kind}", (300.0, height))
        for kind, height in (("NodeBsdfTransparent", -600.0), ("NodeMixShader", -450.0))
    )
    for source, target in zip((opacity, clear.outputs[0], shader), mix.inputs, strict=True):
        tree.links.new(source, target)
    return mix.outputs[0]


def _times(
    tree: bpy.types.NodeTree,
    first: bpy.types.NodeSocket | float,
    second: bpy.types.NodeSocket | float,
    height: float,
) -> bpy.types.NodeSocket:
    """Return the product of two values, each a socket or a number."""
    node = _node(tree, "ShaderNodeMath", (-280.0, height))
    node.operation = "MULTIPLY"
    for value, socket in zip((first, second), node.inputs, strict=False):
        if isinstance(value, float):
            socket.default_value = value
        else:
            tree.links.new(value, socket)
    return node.outputs[0]


def _gltf_output(tree: bpy.types.NodeTree) -> bpy.types.Node:
    """Add the node *glTF Material Output*. Blender's exporter reads inputs from it that the Principled BSDF lacks."""
    name = "glTF Material Output"
    group = bpy.data.node_groups.get(name)
    if group is None or group.bl_idname != "ShaderNodeTree":
        group = bpy.data.node_groups.new(name, "ShaderNodeTree")
    sockets = {item.name for item in group.interface.items_tree if item.item_type == "SOCKET"}
    if "Occlusion" not in sockets:
        group.interface.new_socket("Occlusion", in_out="INPUT", socket_type="NodeSocketFloat").default_value = 1.0
    node = _node(tree, "ShaderNodeGroup", (0.0, -400.0))
    node.node_tree = group
    return node


def _image_node(tree: bpy.types.NodeTree, image: bpy.types.Image, height: float) -> bpy.types.Node:
    node = _node(tree, "ShaderNodeTexImage", (-600.0, height))
    node.image = image
    return node


def _node(tree: bpy.types.NodeTree, kind: str, location: tuple[float, float]) -> bpy.types.Node:
    node = tree.nodes.new(kind)
    node.location = location
    return node


def layer_names(materials: Sequence[bpy.types.Material | None]) -> LayerNames:
    """Return the names of the UV maps and color attributes that the materials read. A new mesh needs these names."""
    surfaces = [read_surface(material) for material in materials]
    uv_maps = [surface.texture.uv_map for surface in surfaces if surface.texture is not None]
    colors = [name for surface in surfaces for name in (surface.color_attribute, surface.alpha_attribute)]
    return LayerNames(
        uv_maps=tuple(dict.fromkeys(name or UV_NAME for name in uv_maps)) or (UV_NAME,),
        colors=tuple(dict.fromkeys(name or COLOR_NAME for name in colors if name is not None)) or (COLOR_NAME,),
    )


def with_opaque_parts(translucency: NDArray[np.uint8], base_color: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the translucency page with alpha 0 on opaque texels, such as branches and trunk, else 255."""
    opaque = (base_color[..., 3] > 0) & ~translucency[..., :3].any(axis=2)
    return np.dstack([translucency[..., :3], np.where(opaque, 0, 255).astype(np.uint8)])
