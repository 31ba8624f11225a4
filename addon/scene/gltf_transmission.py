"""The glTF extension `KHR_materials_diffuse_transmission`, which Blender's importer does not read, as shader nodes.

The extension mixes two shaders: (1 − factor) · base color is reflected, factor · color is transmitted. So the nodes are
a Mix Shader of the imported Principled BSDF and a Translucent BSDF. Its factor is multiplied by the alpha, because a
Translucent BSDF has none.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import bpy

import leafcloud

from .gltf_source import GltfSource

_EXTENSION = "KHR_materials_diffuse_transmission"
_MARK = "leafcloud_material"
"""Custom property of an imported material: its number in the file."""


def marked(source: GltfSource) -> GltfSource:
    """Return the file with the number of each transmissive material in its extras; the file itself without any."""
    if not any(_EXTENSION in material.get("extensions", {}) for material in source.list("materials")):
        return source
    document = copy.deepcopy(source.document)
    for number, material in enumerate(document["materials"]):
        extras = material.get("extras")
        material["extras"] = {**(extras if isinstance(extras, dict) else {}), _MARK: number}
    for key in ("extensionsUsed", "extensionsRequired"):
        document[key] = [name for name in document.get(key, []) if name != _EXTENSION]
    return GltfSource(source.home, document, source.body)


def add_transmission(source: GltfSource, imported: Iterable[bpy.types.Material]) -> list[str]:
    """Add the transmission of the file's materials to the imported ones, which have marks. Return what changed."""
    notes = []
    for material in [each for each in imported if _MARK in each]:
        number = int(material.pop(_MARK))
        found = source.list("materials")[number].get("extensions", {}).get(_EXTENSION, {})
        share, note = _share(source, found)
        if share > 0.0:
            _mix_in(material, source, found, share)
            notes += [f"material {material.name!r}: {note}"] if note else []
    return notes


def _share(source: GltfSource, found: dict[str, Any]) -> tuple[float, str]:
    """Return the transmitted share of the light, the mean over its texture, and what that changes."""
    factor = min(max(found.get("diffuseTransmissionFactor", 0.0), 0.0), 1.0)
    content = _content(source, found.get("diffuseTransmissionTexture"))
    if content is None or factor == 0.0:
        return factor, ""
    try:
        mean = float(leafcloud.decode_image(content)[..., 3].mean()) / 255.0
    except leafcloud.LeafcloudError:
        return factor, "the texture of the light that it transmits cannot be read, and is left out"
    return factor * mean, "a texture varies how much light it transmits: the mean of the texture is used"


def _mix_in(material: bpy.types.Material, source: GltfSource, found: dict[str, Any], share: float) -> None:
    tree = material.node_tree
    principled = next((node for node in tree.nodes if node.type == "BSDF_PRINCIPLED"), None)
    if principled is None or not principled.outputs[0].links:
        return
    target = principled.outputs[0].links[0].to_socket
    x, y = principled.location
    mix, translucent = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("MixShader", "BsdfTranslucent"))
    mix.location, translucent.location = (x + 300.0, y + 200.0), (x, y + 200.0)
    color = (*found.get("diffuseTransmissionColorFactor", (1.0, 1.0, 1.0)), 1.0)
    translucent.inputs["Color"].default_value = color
    image = _image(source, found.get("diffuseTransmissionColorTexture"))
    if image is not None:
        _multiply(tree, _texture(principled, image), color, translucent.inputs["Color"])
    if principled.inputs["Normal"].links:
        tree.links.new(principled.inputs["Normal"].links[0].from_socket, translucent.inputs["Normal"])
    mix.inputs[0].default_value = share * principled.inputs["Alpha"].default_value
    if principled.inputs["Alpha"].links:
        times = tree.nodes.new("ShaderNodeMath")
        times.operation, times.location = "MULTIPLY", (x, y + 400.0)
        times.inputs[1].default_value = share
        tree.links.new(principled.inputs["Alpha"].links[0].from_socket, times.inputs[0])
        tree.links.new(times.outputs[0], mix.inputs[0])
    tree.links.new(principled.outputs[0], mix.inputs[1])
    tree.links.new(translucent.outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], target)


def _texture(principled: bpy.types.Node, image: bpy.types.Image) -> bpy.types.Node:
    """Return a node of the image, laid as the base color's image is."""
    tree = principled.id_data
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image, node.location = image, (principled.location.x - 600.0, principled.location.y + 400.0)
    own = next((each for each in tree.nodes if each.type == "TEX_IMAGE" and each is not node), None)
    if own is not None:
        node.extension, node.interpolation = own.extension, own.interpolation
        for link in own.inputs["Vector"].links:
            tree.links.new(link.from_socket, node.inputs["Vector"])
    return node


def _multiply(
    tree: bpy.types.NodeTree, texture: bpy.types.Node, color: tuple[float, ...], target: bpy.types.NodeSocket
) -> None:
    """Link the texture to an input, multiplied by a color that is not white."""
    if min(color) == max(color) == 1.0:
        tree.links.new(texture.outputs["Color"], target)
        return
    node = tree.nodes.new("ShaderNodeMix")
    node.data_type, node.blend_type = "RGBA", "MULTIPLY"
    inputs = {socket.identifier: socket for socket in node.inputs}
    inputs["Factor_Float"].default_value = 1.0
    inputs["B_Color"].default_value = color
    tree.links.new(texture.outputs["Color"], inputs["A_Color"])
    tree.links.new(next(each for each in node.outputs if each.identifier == "Result_Color"), target)


def _image(source: GltfSource, texture: dict[str, Any] | None) -> bpy.types.Image | None:
    """Return the image of a texture, packed: one of the imported ones if it has the same pixels."""
    content = _content(source, texture)
    if content is None:
        return None
    image = bpy.data.images.new("transmission", 1, 1)
    image.source = "FILE"
    image.pack(data=content, data_len=len(content))
    for other in bpy.data.images:
        if other is not image and other.packed_file is not None and other.packed_file.data == content:
            bpy.data.images.remove(image)
            return other
    return image


def _content(source: GltfSource, texture: dict[str, Any] | None) -> bytes | None:
    """Return the bytes of a texture's image; None without one."""
    number = None if texture is None else source.list("textures")[texture["index"]].get("source")
    content = None if number is None else source.image(number)
    return content.read_bytes() if isinstance(content, Path) else content
