"""Materials of levels with baked light. LOD 0 emits base color times the light at its corners, clouds emit a page."""

from __future__ import annotations

import bpy
import numpy as np
from numpy.typing import NDArray

from ..material.flatten import shining_copy
from ..material.node_links import output_of
from ..scene.light import Light
from .material import PAGE_NODE, hide_back_in_cycles, shown_share

FRONT, BACK = "leafcloud_light", "leafcloud_light_back"
"""Color attributes by corner: light divided by its strength, on the side that winds counter-clockwise and its back."""

EXTRAS = "leafcloud"

_PATH_NODE, _EMISSION_NODE = "Leafcloud Path", "Leafcloud Light"


def add_light(mesh: bpy.types.Mesh, light: Light) -> None:
    """Store the light (c, 3) of both sides as color attributes."""
    for name, values in ((FRONT, light.front), (BACK, light.back)):
        attribute = mesh.color_attributes.new(name, "FLOAT_COLOR", "CORNER")
        attribute.data.foreach_set("color", opaque(values).ravel())


def opaque(colors: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return (c, 4) colors with alpha 1 from (c, 3)."""
    return np.concatenate([colors, np.ones_like(colors[:, :1])], axis=1)


def lit_material(material: bpy.types.Material | None, strength: float) -> bpy.types.Material:
    """Return a copy of a leaf material that emits base color · light of the visible side · strength.

    Inputs that only affect lighting are unlinked, so that exporters do not write their images.
    """
    source = material
    if source is None or source.node_tree is None or output_of(source.node_tree) is None:
        source = _new_material("leaf")
    lit = shine(shining_copy(source, _light_seen, strength), strength)
    if source is not material:
        bpy.data.materials.remove(source)
    for principled in [node for node in lit.node_tree.nodes if node.type == "BSDF_PRINCIPLED"]:
        for socket in [socket for socket in principled.inputs if socket.name not in ("Base Color", "Alpha")]:
            for link in list(socket.links):
                lit.node_tree.links.remove(link)
    return lit


def unlit_material(name: str, image: bpy.types.Image, alpha_cutoff: float, *, double_sided: bool) -> bpy.types.Material:
    """Create a material that emits the atlas page to the camera, cut out at `alpha_cutoff`; with 0 it is alpha blended.

    Blender's glTF exporter recognizes this node setup and writes `KHR_materials_unlit` with `alphaMode` MASK or BLEND.
    As with Blender's importer, other rays pass: it neither gives light nor casts a shadow.
    """
    material = _new_material(name)
    material.use_backface_culling = not double_sided
    tree = material.node_tree
    tree.nodes.clear()
    texture, path, emission, either, clear, cut, output = (
        _node(tree, kind, place)
        for kind, place in (
            ("TexImage", (-600.0, 0.0)),
            ("LightPath", (-280.0, 700.0)),
            ("Emission", (-280.0, 0.0)),
            ("MixShader", (-60.0, 0.0)),
            ("BsdfTransparent", (-60.0, 200.0)),
            ("MixShader", (140.0, 100.0)),
            ("OutputMaterial", (500.0, 100.0)),
        )
    )
    texture.image, texture.name = image, PAGE_NODE
    path.name, emission.name = _PATH_NODE, _EMISSION_NODE
    tree.links.new(texture.outputs["Color"], emission.inputs["Color"])
    _mix(tree, either, path.outputs["Is Camera Ray"], clear, emission)
    _mix(tree, cut, shown_share(tree, texture, alpha_cutoff), clear, either)
    tree.links.new(cut.outputs[0], output.inputs["Surface"])
    if not double_sided:
        hide_back_in_cycles(tree)
    return material


def _light_seen(tree: bpy.types.NodeTree) -> bpy.types.NodeSocket:
    """Add nodes that output the baked light of the visible side."""
    side, mix = _node(tree, "NewGeometry", (0.0, 0.0)), _node(tree, "Mix", (0.0, 0.0))
    mix.data_type = "RGBA"
    inputs = {socket.identifier: socket for socket in mix.inputs}
    tree.links.new(side.outputs["Backfacing"], inputs["Factor_Float"])
    for name, target in ((FRONT, "A_Color"), (BACK, "B_Color")):
        attribute = _node(tree, "VertexColor", (0.0, 0.0))
        attribute.layer_name = name
        tree.links.new(attribute.outputs["Color"], inputs[target])
    return next(socket for socket in mix.outputs if socket.identifier == "Result_Color")


def shine(material: bpy.types.Material, strength: float) -> bpy.types.Material:
    """Make a material emit baked light, also to other surfaces, and cast shadows. Return it.

    The strength is stored on the material, because glTF cannot. Cycles does not sample the material as a lamp: only
    paths that hit it by chance receive its light.
    """
    nodes = material.node_tree.nodes
    if _EMISSION_NODE in nodes:
        nodes[_EMISSION_NODE].inputs["Strength"].default_value = strength
        either = nodes[_PATH_NODE].outputs["Is Camera Ray"].links[0].to_node
        material.node_tree.links.new(nodes[_EMISSION_NODE].outputs[0], either.inputs[1])
    material[EXTRAS] = {"light_strength": strength}
    material.cycles.emission_sampling = "NONE"
    return material


def _new_material(name: str) -> bpy.types.Material:
    material = bpy.data.materials.new(name)
    if material.node_tree is None:  # From Blender 5.0 on every material has nodes.
        material.use_nodes = True
    return material


def _mix(
    tree: bpy.types.NodeTree,
    mix: bpy.types.Node,
    factor: bpy.types.NodeSocket,
    first: bpy.types.Node,
    second: bpy.types.Node,
) -> None:
    for source, target in zip((factor, first.outputs[0], second.outputs[0]), mix.inputs, strict=True):
        tree.links.new(source, target)


def _node(tree: bpy.types.NodeTree, kind: str, location: tuple[float, float]) -> bpy.types.Node:
    node = tree.nodes.new(f"ShaderNode{kind}")
    node.location = location
    return node
