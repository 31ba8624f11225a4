"""Atlas pages as images and materials in Blender."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from node_trees import atlas_image

from addon.levels.material import BENT_NORMAL_NODE, Page, atlas_material

pytestmark = pytest.mark.version


def test_the_atlas_is_packed_and_keeps_its_pixels() -> None:
    pixels = np.arange(4 * 2 * 4, dtype=np.uint8).reshape(4, 2, 4) * 7
    image = atlas_image("tree_LOD1", pixels)
    assert (image.name, tuple(image.size), image.alpha_mode) == ("tree_LOD1", (2, 4), "CHANNEL_PACKED")
    assert image.packed_file is not None
    read = np.empty(pixels.size, np.float32)
    image.pixels.foreach_get(read)
    assert np.array_equal(np.rint(read.reshape(4, 2, 4)[::-1] * 255.0).astype(np.uint8), pixels)


def test_the_atlas_material_is_cut_out_by_alpha() -> None:
    image = atlas_image("page", np.full((2, 2, 4), 255, np.uint8))
    material = atlas_material("page", Page(image, specular=0.25), alpha_cutoff=0.375, double_sided=False)
    surface = next(node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    threshold = surface.inputs["Alpha"].links[0].from_node
    assert (threshold.operation, threshold.inputs[1].default_value) == ("GREATER_THAN", 0.375)
    assert surface.inputs["Base Color"].links[0].from_node.image == image
    assert material.use_backface_culling
    assert surface.inputs["Specular IOR Level"].default_value == 0.25


def tree_groups(material: bpy.types.Material) -> list[bpy.types.Node]:
    return [node for node in material.node_tree.nodes if node.type == "GROUP"]


def test_the_atlas_material_shows_normals_and_orm() -> None:
    color, normal, orm = (
        atlas_image(name, np.full((2, 2, 4), 255, np.uint8), data=name != "color")
        for name in ("color", "normal", "orm")
    )
    material = atlas_material("page", Page(color, normal, orm), alpha_cutoff=0.5, double_sided=True)
    surface = next(node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    mapped = surface.inputs["Normal"].links[0].from_node
    assert (mapped.type, mapped.inputs["Color"].links[0].from_node.image) == ("NORMAL_MAP", normal)
    for name, channel in (("Roughness", "Green"), ("Metallic", "Blue")):
        part = surface.inputs[name].links[0].from_socket
        assert (part.name, part.node.inputs[0].links[0].from_node.image) == (channel, orm)
    assert not tree_groups(material), "occlusion was not asked for"
    spaces = [image.colorspace_settings.name for image in (color, normal, orm)]
    assert spaces == ["sRGB", "Non-Color", "Non-Color"]


def test_occlusion_uses_an_existing_gltf_output_group() -> None:
    theirs = bpy.data.node_groups.new("glTF Material Output", "ShaderNodeTree")
    theirs.interface.new_socket("Thickness", in_out="INPUT", socket_type="NodeSocketFloat")
    color, orm = (atlas_image(name, np.full((2, 2, 4), 255, np.uint8)) for name in ("color", "orm"))
    material = atlas_material("m", Page(color, orm=orm, occluded=True), alpha_cutoff=0.5, double_sided=True)
    [group] = tree_groups(material)
    assert group.node_tree == theirs
    assert group.inputs["Occlusion"].is_linked


def test_occlusion_and_bent_normals_are_optional_nodes_for_the_export() -> None:
    color, orm, bent_normal = (
        atlas_image(name, np.full((2, 2, 4), 255, np.uint8), data=name != "color")
        for name in ("color", "orm", "bent_normal")
    )
    page = Page(color, orm=orm, occluded=True, bent_normal=bent_normal)
    first, second = (atlas_material(name, page, alpha_cutoff=0.5, double_sided=True) for name in ("a", "b"))
    [group], [other] = tree_groups(first), tree_groups(second)
    assert group.node_tree == other.node_tree
    assert group.node_tree.name == "glTF Material Output"
    red = group.inputs["Occlusion"].links[0].from_socket
    assert (red.name, red.node.inputs[0].links[0].from_node.image) == ("Red", orm)
    assert first.node_tree.nodes[BENT_NORMAL_NODE].image == bent_normal
