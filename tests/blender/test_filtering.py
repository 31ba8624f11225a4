"""Materials that EEVEE filters: the share of a pixel in place of the cutoff, and colors under transparent texels."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest
from node_trees import atlas_image, new_material
from scenes import add_mesh

from addon.effects.filtering import EFFECT
from addon.levels.building import Costs
from addon.levels.filtering import show_shares
from addon.levels.images import PackedImages
from addon.levels.material import PAGE_NODE, Page, atlas_material
from addon.mesh.baked_levels import EXTRAS
from addon.steps import all_steps

pytestmark = pytest.mark.version

SQUARE = [(-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 0.0), (-1.0, 1.0, 0.0)]
GREEN, WHITE = (10, 200, 30), (255, 255, 255)


def picture() -> bpy.types.Image:
    """A green left half, and white under the transparent right half."""
    pixels = np.zeros((8, 8, 4), np.uint8)
    pixels[:, :4], pixels[:, 4:] = (*GREEN, 255), (*WHITE, 0)
    return atlas_image("leaf", pixels)


def cut_out(operation: str, cutoff: float) -> bpy.types.Material:
    """A leaf material with a cutoff, as artists make it or as the glTF importer does."""
    material, principled, tree = new_material()
    texture = tree.nodes.new("ShaderNodeTexImage")
    texture.image = picture()
    step = tree.nodes.new("ShaderNodeMath")
    step.operation, step.inputs[1].default_value = operation, cutoff
    tree.links.new(texture.outputs["Color"], principled.inputs["Base Color"])
    tree.links.new(texture.outputs["Alpha"], step.inputs[0])
    tree.links.new(step.outputs[0], principled.inputs["Alpha"])
    return material


def filtered(material: bpy.types.Material, level: int) -> tuple[bpy.types.Object, Costs]:
    """Return a level with the material after the effect. Levels from 1 on are clouds."""
    obj = add_mesh("tree_LOD", SQUARE, [(0, 1, 2, 3)], materials=[material])
    obj[EXTRAS] = {"level": level}
    collection = bpy.data.collections.new("tree")
    collection.objects.link(obj)
    build: Any = SimpleNamespace(first_cloud=1, costs=Costs(), images=PackedImages())
    EFFECT.add_to_tree(collection, build)
    all_steps(build.images.packed())
    return obj, build.costs


def alpha_of(material: bpy.types.Material, renderer: str) -> bpy.types.Node:
    """Return the node that gives the alpha of a renderer's Principled BSDF."""
    shader = material.node_tree.get_output_node(renderer).inputs["Surface"].links[0].from_node
    assert shader.type == "BSDF_PRINCIPLED"
    return shader.inputs["Alpha"].links[0].from_node


def test_eevee_gets_the_share_and_cycles_and_files_keep_the_cutoff() -> None:
    material = cut_out("GREATER_THAN", 0.5)
    obj, _ = filtered(material, 0)
    shown = obj.material_slots[0].material
    assert alpha_of(shown, "EEVEE").type == "TEX_IMAGE"
    for renderer in ("CYCLES", "ALL"):
        assert alpha_of(shown, renderer).operation == "GREATER_THAN"


@pytest.mark.parametrize("cutoff", [0.1, 0.3])
def test_alpha_at_the_cutoff_covers_half_of_a_pixel(cutoff: float) -> None:
    obj, _ = filtered(cut_out("GREATER_THAN", cutoff), 0)
    bend = alpha_of(obj.material_slots[0].material, "EEVEE")
    assert bend.operation == "POWER"
    assert cutoff ** bend.inputs[1].default_value == pytest.approx(0.5)


def test_the_artists_material_and_image_stay() -> None:
    material = cut_out("ROUND", 0.0)
    nodes = len(material.node_tree.nodes)
    obj, costs = filtered(material, 0)
    slot = obj.material_slots[0]
    assert obj.data.materials[0] == material, "files have this one"
    assert (slot.link, slot.material.name) == ("OBJECT", f"{material.name}_filtered")
    assert len(material.node_tree.nodes) == nodes
    assert costs.bytes == {"filtering": 8 * 8 * 4}


def test_colors_go_on_under_transparent_texels_for_eevee_alone() -> None:
    obj, _ = filtered(cut_out("ROUND", 0.0), 0)
    tree = obj.material_slots[0].material.node_tree
    shaders = [tree.get_output_node(name).inputs["Surface"].links[0].from_node for name in ("CYCLES", "EEVEE")]
    own, image = (shader.inputs["Base Color"].links[0].from_node.image for shader in shaders)
    assert (own.name.partition(".")[0], image.name) == ("leaf", f"{own.name}_filled")
    texels = np.rint(np.array(image.pixels[:]).reshape(8, 8, 4) * 255.0)
    np.testing.assert_array_equal(texels[..., :3], np.broadcast_to(GREEN, (8, 8, 3)))
    np.testing.assert_array_equal(texels[0, :, 3], [255] * 4 + [0] * 4)
    assert tree.nodes.active.image == image, "Workbench filters, too"


def test_the_page_of_a_cloud_is_its_own() -> None:
    """No copy is needed: its material belongs to the level, and its colors go on already."""
    material = atlas_material("cloud", Page(picture()), alpha_cutoff=0.5, double_sided=True)
    assert show_shares(material)
    assert alpha_of(material, "EEVEE").type == "TEX_IMAGE"
    obj, costs = filtered(material, 1)
    assert (obj.material_slots[0].link, obj.material_slots[0].material) == ("DATA", material)
    assert costs.bytes == {}


def test_translucent_clouds_are_filtered_with_their_share() -> None:
    page = Page(picture(), translucency=picture(), share=0.4)
    material = atlas_material("cloud", page, alpha_cutoff=0.5, double_sided=True)
    show_shares(material)
    assert material.node_tree.nodes.active.name == PAGE_NODE, "Workbench shows the page"
    mix = material.node_tree.get_output_node("EEVEE").inputs["Surface"].links[0].from_node
    assert mix.type == "MIX_SHADER"
    product = mix.inputs[0].links[0].from_node
    assert (product.inputs[0].links[0].from_node.type, product.inputs[1].default_value) == (
        "TEX_IMAGE",
        pytest.approx(0.4),
    )


def test_alpha_with_a_factor_before_the_cutoff_is_filtered() -> None:
    """As the glTF importer makes it for a base color factor with an alpha below 1."""
    material = cut_out("GREATER_THAN", 0.5)
    tree = material.node_tree
    step = alpha_of(material, "ALL")
    texture, half = step.inputs[0].links[0].from_socket, tree.nodes.new("ShaderNodeMath")
    half.operation, half.inputs[1].default_value = "MULTIPLY", 0.9
    tree.links.new(texture, half.inputs[0])
    tree.links.new(half.outputs[0], step.inputs[0])
    obj, _ = filtered(material, 0)
    product = alpha_of(obj.material_slots[0].material, "EEVEE")
    assert (product.operation, product.inputs[1].default_value) == ("MULTIPLY", pytest.approx(0.9))
    assert product.inputs[0].links[0].from_node.image.name.startswith("leaf")


def test_a_reroute_is_passed() -> None:
    material = cut_out("ROUND", 0.0)
    tree = material.node_tree
    step, reroute = alpha_of(material, "ALL"), tree.nodes.new("NodeReroute")
    shader = step.outputs[0].links[0].to_socket
    tree.links.new(step.outputs[0], reroute.inputs[0])
    tree.links.new(reroute.outputs[0], shader)
    obj, _ = filtered(material, 0)
    assert obj.material_slots[0].material.name.endswith("_filtered")


@pytest.mark.parametrize("kind", ["ShaderNodeGamma", "ShaderNodeInvert"])
def test_nodes_that_are_not_copied_leave_the_texture(kind: str) -> None:
    """They lie between the texture and the output, but not behind the cutoff."""
    material = cut_out("ROUND", 0.0)
    tree = material.node_tree
    other, shader = tree.nodes.new(kind), tree.get_output_node("ALL").inputs["Surface"].links[0].from_node
    texture = next(node for node in tree.nodes if node.type == "TEX_IMAGE")
    tree.links.new(texture.outputs["Color"], other.inputs["Color"])
    tree.links.new(other.outputs[0], shader.inputs["Base Color"])
    obj, costs = filtered(material, 0)
    assert (
        alpha_of(obj.material_slots[0].material, "EEVEE")
        == obj.material_slots[0].material.node_tree.nodes["Image Texture"]
    )
    assert costs.bytes == {}


def test_alpha_from_a_node_group_stays() -> None:
    material = cut_out("ROUND", 0.0)
    tree = material.node_tree
    group = bpy.data.node_groups.new("leaf", "ShaderNodeTree")
    group.interface.new_socket("Alpha", in_out="OUTPUT", socket_type="NodeSocketFloat")
    inside, end = group.nodes.new("ShaderNodeTexImage"), group.nodes.new("NodeGroupOutput")
    inside.image = picture()
    group.links.new(inside.outputs["Alpha"], end.inputs[0])
    node = tree.nodes.new("ShaderNodeGroup")
    node.node_tree = group
    tree.links.new(node.outputs[0], alpha_of(material, "ALL").inputs[0])
    obj, _ = filtered(material, 0)
    assert obj.material_slots[0].material == material


def test_names_of_images_are_no_paths(tmp_path: Path) -> None:
    material = cut_out("ROUND", 0.0)
    texture = next(node for node in material.node_tree.nodes if node.type == "TEX_IMAGE")
    texture.image.name = str(tmp_path / "leaf")
    filtered(material, 0)
    assert list(tmp_path.iterdir()) == []


def test_opaque_materials_stay() -> None:
    material, *_ = new_material()
    nodes = len(material.node_tree.nodes)
    obj, _ = filtered(material, 0)
    assert obj.material_slots[0].material == material
    assert len(material.node_tree.nodes) == nodes
