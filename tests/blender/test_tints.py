"""Rendered materials keep the variation between leaves: per object, per island, per position."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
import pytest
from night import rest_at_night
from node_trees import new_image, new_material, texture_node
from renders import render
from scenes import SQUARE, add_mesh

import leafcloud
from addon.bake.part import described_part
from addon.geometry import Geometry
from addon.levels.mesh import read_own_randoms
from addon.levels.trunk import geometry_mesh
from addon.material.describe import Descriptions, describe_materials
from addon.material.flatten import RANDOM, flatten
from addon.material.tints import Islands, nearest_tints
from addon.mesh.extract import extract
from addon.scene.light import Light

TWO_SQUARES = np.array([(x + dx, y, 0) for dx in (0, 3) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))], np.float32)
TRIANGLES = np.array([(0, 1, 2), (0, 2, 3), (4, 5, 6), (4, 6, 7)], np.int32)


def grey_material(node_type: str, output: str) -> bpy.types.Material:
    """Return a gray material with the brightness of a node's output."""
    material, principled, tree = new_material()
    node, grey = tree.nodes.new(node_type), tree.nodes.new("ShaderNodeCombineColor")
    for target in grey.inputs:
        tree.links.new(node.outputs[output], target)
    tree.links.new(grey.outputs[0], principled.inputs["Base Color"])
    return material


def islands(randoms: list[float]) -> Islands:
    return Islands(TWO_SQUARES, TRIANGLES, np.array(randoms, np.float32))


def test_an_object_has_its_random_number() -> None:
    material = grey_material("ShaderNodeObjectInfo", "Random")
    flat = flatten(material)
    assert flat.varies
    factors = nearest_tints([flat], islands([0.25, 0.25, 0.75, 0.75])).front
    brightness = factors * flat.pixels[0, 0, :3]
    np.testing.assert_allclose(brightness[:2], 0.25, atol=1e-3)
    np.testing.assert_allclose(brightness[2:], 0.75, atol=1e-3)


RED, BLUE = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)


def red_or_blue() -> bpy.types.Material:
    """Return a material that is blue for object random numbers above one half, and red otherwise."""
    material, principled, tree = new_material()
    info, above, mix = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("ObjectInfo", "Math", "Mix"))
    above.operation, above.inputs[1].default_value, mix.data_type = "GREATER_THAN", 0.5, "RGBA"
    mix.inputs[6].default_value, mix.inputs[7].default_value = (*RED, 1.0), (*BLUE, 1.0)
    tree.links.new(info.outputs["Random"], above.inputs[0])
    tree.links.new(above.outputs[0], mix.inputs[0])
    tree.links.new(mix.outputs[2], principled.inputs["Base Color"])
    return material


def leaves_with(material: bpy.types.Material, randoms: list[float]) -> Geometry:
    """Return a geometry with one square for each random number."""
    objects = [add_mesh(f"leaf {i}", SQUARE, [(0, 1, 2, 3)], materials=[material]) for i in range(len(randoms))]
    for obj in objects:
        obj.data.uv_layers.new()
    names = [obj.name for obj in objects]
    geometry = extract(bpy.context.evaluated_depsgraph_get(), objects, leaf_names=names).leaves
    return replace(geometry, randoms=np.repeat(np.array(randoms, np.float32), 2))


def shown(described: Descriptions, row: int, column: int) -> np.ndarray:
    """Return linear colors (t, 3) of the triangles' first corners: texel of the material times vertex color."""
    images = [material["image"] for material in described.materials]
    codes = np.array([image[row, column, :3] / 255.0 for image in images if image is not None])
    linear = np.where(codes <= 0.04045, codes / 12.92, ((codes + 0.055) / 1.055) ** 2.4)[described.material_ids]
    return linear if described.colors is None else linear * described.colors[:, 0, :3]


@pytest.mark.parametrize("count", rest_at_night([2, 5, 40]))
def test_leaves_of_two_colours(count: int) -> None:
    """Neither color is a tint of the other, so both are rendered. Many random numbers share 16 renders."""
    randoms = ((np.arange(count) * 0.618 + 0.3) % 1.0).tolist()
    described = describe_materials(leaves_with(red_or_blue(), randoms))
    expected = np.repeat([BLUE if random > 0.5 else RED for random in randoms], 2, axis=0)
    np.testing.assert_allclose(shown(described, 5, 5), expected, atol=0.01)
    assert len(described.materials) == min(count, 16)
    assert described.owners == (0,) * len(described.materials)
    told = f"so it is rendered for {min(count, 16)} of {count} random numbers, to images of 512 × 512 texels"
    assert told in described.messages[-1]


def test_the_core_shows_each_color_on_its_leaves() -> None:
    """Seen from above, the square of one random number is all red, the other all blue."""
    geometry = leaves_with(red_or_blue(), [0.25, 0.75])
    part = described_part(geometry, np.eye(4), (), 0.0, None)
    for leaf, expected in enumerate(((255, 0, 0, 255), (0, 0, 255, 255))):
        own = part.of(np.arange(6 * leaf, 6 * leaf + 6).reshape(2, 3)).foliage()
        pixels = leafcloud.render([own], (0.0, 0.0, 1.0), 16, centre=[0.5, 0.5, 0.0], radius=0.5)
        assert pixels[8, 8].tolist() == list(expected)


def test_a_hue_shift_applies_to_the_whole_leaf() -> None:
    """One third of a turn makes red green and green blue. The other third goes back."""
    material, principled, tree = new_material()
    left, right = (0.5, 0.0, 0.0, 1.0), (0.0, 0.5, 0.0, 1.0)
    image = texture_node(tree, new_image("i", [[left] * 32 + [right] * 32] * 64, is_float=True))
    info, hue = tree.nodes.new("ShaderNodeObjectInfo"), tree.nodes.new("ShaderNodeHueSaturation")
    tree.links.new(image.outputs["Color"], hue.inputs["Color"])
    tree.links.new(info.outputs["Random"], hue.inputs["Hue"])
    tree.links.new(hue.outputs[0], principled.inputs["Base Color"])
    described = describe_materials(leaves_with(material, [0.5, 0.5 + 1.0 / 3.0, 0.5 - 1.0 / 3.0]))
    red, green, blue = 0.5 * np.eye(3)
    np.testing.assert_allclose(shown(described, 32, 16)[::2], [red, green, blue], atol=0.01)
    np.testing.assert_allclose(shown(described, 32, 48)[::2], [green, blue, red], atol=0.01)


def test_leaves_of_different_brightness_share_one_render() -> None:
    """All texels differ. The render uses a random number of one half, so the tints are twice the random numbers."""
    material, principled, tree = new_material()
    values = np.random.default_rng(1).uniform(0.2, 0.9, (64, 64, 3))
    texels = [[(*color, 1.0) for color in row] for row in values.tolist()]
    image = texture_node(tree, new_image("i", texels, is_float=True))
    info, scale = tree.nodes.new("ShaderNodeObjectInfo"), tree.nodes.new("ShaderNodeVectorMath")
    scale.operation = "SCALE"
    tree.links.new(image.outputs["Color"], scale.inputs[0])
    tree.links.new(info.outputs["Random"], scale.inputs["Scale"])
    tree.links.new(scale.outputs[0], principled.inputs["Base Color"])
    described = describe_materials(leaves_with(material, [0.1, 0.4, 0.9]))
    assert described.owners == (0,)
    assert len(described.messages) == 1
    assert described.colors is not None
    np.testing.assert_allclose(described.colors[::2, 0, :3], [[0.2] * 3, [0.8] * 3, [1.8] * 3], rtol=1e-3)


def test_color_changes_by_position_that_are_not_tints_give_a_message() -> None:
    """Leaves are red on the ground and blue at a height of one."""
    material = red_or_blue()
    tree = material.node_tree
    info = next(node for node in tree.nodes if node.type == "OBJECT_INFO")
    place, parts = tree.nodes.new("ShaderNodeNewGeometry"), tree.nodes.new("ShaderNodeSeparateXYZ")
    tree.links.new(place.outputs["Position"], parts.inputs[0])
    tree.links.new(parts.outputs["Z"], info.outputs["Random"].links[0].to_socket)
    geometry, high = leaves_with(material, [0.5]), np.eye(4)
    high[2, 3] = 1.0
    for matrix, told in ((np.eye(4), False), (high, True)):
        said = " ".join(describe_materials(geometry, (), matrix).messages)
        assert ("islands or positions change its leaves by more than a tint" in said) == told


@pytest.mark.parametrize(
    ("front", "back"),
    [((0.2, 0.4, 0.1), (0.6, 0.5, 0.3)), (RED, BLUE)],
    ids=["tint", "in between"],
)
def test_a_back_of_another_colour(front: tuple[float, ...], back: tuple[float, ...]) -> None:
    """Render both sides with the core. A back that is not a tint of the front becomes a tint of their mean."""
    material, principled, tree = new_material()
    side, mix = tree.nodes.new("ShaderNodeNewGeometry"), tree.nodes.new("ShaderNodeMix")
    mix.data_type = "RGBA"
    mix.inputs[6].default_value, mix.inputs[7].default_value = (*front, 1.0), (*back, 1.0)
    tree.links.new(side.outputs["Backfacing"], mix.inputs[0])
    tree.links.new(mix.outputs[2], principled.inputs["Base Color"])
    part = described_part(leaves_with(material, [0.5]), np.eye(4), (), 0.0, None)
    assert len(part.messages) == 1
    for height, color in ((1.0, front), (-1.0, back)):
        codes = leafcloud.render([part.foliage()], (0.0, 0.0, height), 16, centre=[0.5, 0.5, 0.0], radius=0.5)[8, 8, :3]
        linear = np.where(codes <= 10, codes / 255.0 / 12.92, ((codes / 255.0 + 0.055) / 1.055) ** 2.4)
        np.testing.assert_allclose(linear, color, atol=0.01)


def test_each_side_has_its_own_light() -> None:
    """The back has three times the color of the front. Its light is ½, and the light of the front is ¼."""
    material, principled, tree = new_material()
    side, mix = tree.nodes.new("ShaderNodeNewGeometry"), tree.nodes.new("ShaderNodeMix")
    mix.data_type = "RGBA"
    mix.inputs[6].default_value, mix.inputs[7].default_value = (0.2, 0.2, 0.2, 1.0), (0.6, 0.6, 0.6, 1.0)
    tree.links.new(side.outputs["Backfacing"], mix.inputs[0])
    tree.links.new(mix.outputs[2], principled.inputs["Base Color"])
    light = Light(np.full((2, 3, 3), 0.25, np.float32), np.full((2, 3, 3), 0.5, np.float32))
    part = described_part(leaves_with(material, [0.5]), np.eye(4), (), 0.0, light)
    assert part.colors is not None
    assert part.back_colors is not None
    np.testing.assert_allclose(part.colors[..., :3], 0.25, atol=1e-3)
    np.testing.assert_allclose(part.back_colors, 1.5, atol=1e-2)


def test_a_back_with_another_pattern_gives_a_message() -> None:
    """The front is uniform. One half of the back is darker than the other."""
    material, principled, tree = new_material()
    half = [(0.2, 0.2, 0.2, 1.0)] * 32 + [(0.6, 0.6, 0.6, 1.0)] * 32
    image = texture_node(tree, new_image("i", [half] * 64, is_float=True))
    side, mix = tree.nodes.new("ShaderNodeNewGeometry"), tree.nodes.new("ShaderNodeMix")
    mix.data_type = "RGBA"
    tree.links.new(side.outputs["Backfacing"], mix.inputs[0])
    tree.links.new(image.outputs["Color"], mix.inputs[7])
    tree.links.new(mix.outputs[2], principled.inputs["Base Color"])
    messages = describe_materials(leaves_with(material, [0.5])).messages
    assert any("its back is more than a tint of its front" in message for message in messages)


def test_an_island_has_one_random_number() -> None:
    material = grey_material("ShaderNodeNewGeometry", "Random Per Island")
    first, second = np.split(nearest_tints([flatten(material)], islands([0.5] * 4)).front, 2)
    assert np.ptp(first) < 1e-6
    assert np.ptp(second) < 1e-6
    assert abs(first.mean() - second.mean()) > 0.01


def test_colors_vary_with_the_position() -> None:
    """The brightness is x / 4. One square lies at x from 0 to 1, the other at x from 3 to 4."""
    material, principled, tree = new_material()
    place, ramp = tree.nodes.new("ShaderNodeNewGeometry"), tree.nodes.new("ShaderNodeMapRange")
    parts, grey = tree.nodes.new("ShaderNodeSeparateXYZ"), tree.nodes.new("ShaderNodeCombineColor")
    ramp.inputs["From Max"].default_value = 4.0
    tree.links.new(place.outputs["Position"], parts.inputs[0])
    tree.links.new(parts.outputs["X"], ramp.inputs["Value"])
    for target in grey.inputs:
        tree.links.new(ramp.outputs[0], target)
    tree.links.new(grey.outputs[0], principled.inputs["Base Color"])
    flat = flatten(material)
    middle = flat.pixels[..., 0].mean()
    brightness = nearest_tints([flat], islands([0.5] * 4)).front[..., 0] * middle
    np.testing.assert_allclose(brightness, TWO_SQUARES[TRIANGLES][..., 0] / 4.0, atol=5e-3)


def test_colour_attributes_count_as_white() -> None:
    material, principled, tree = new_material()
    info, color, scale = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("ObjectInfo", "VertexColor", "VectorMath"))
    scale.operation = "SCALE"
    tree.links.new(color.outputs["Color"], scale.inputs[0])
    tree.links.new(info.outputs["Random"], scale.inputs["Scale"])
    tree.links.new(scale.outputs[0], principled.inputs["Base Color"])
    for name in ("tint", ""):
        color.layer_name = name
        factors = nearest_tints([flatten(material)], islands([0.25, 0.25, 0.75, 0.75])).front
        np.testing.assert_allclose(factors[:2], 0.5, atol=1e-3)
        np.testing.assert_allclose(factors[2:], 1.5, atol=1e-3)


def test_alpha_is_no_tint() -> None:
    material, principled, tree = new_material()
    info = tree.nodes.new("ShaderNodeObjectInfo")
    principled.inputs["Base Color"].default_value = (0.5, 0.5, 0.5, 1.0)
    tree.links.new(info.outputs["Random"], principled.inputs["Alpha"])
    factors = nearest_tints([flatten(material)], islands([0.25, 0.25, 0.75, 0.75])).front
    np.testing.assert_allclose(factors, 1.0, atol=1e-3)


def test_positions_are_in_world_space() -> None:
    material, principled, tree = new_material()
    place, parts, grey = (tree.nodes.new(f"ShaderNode{k}") for k in ("NewGeometry", "SeparateXYZ", "CombineColor"))
    tree.links.new(place.outputs["Position"], parts.inputs[0])
    for target in grey.inputs:
        tree.links.new(parts.outputs["X"], target)
    tree.links.new(grey.outputs[0], principled.inputs["Base Color"])
    geometry = colored_geometry(material, 1)
    near, far = (describe_materials(geometry, (), np.eye(4) + x * np.eye(4, k=3)).colors for x in (0.0, 1.0))
    assert near is not None
    assert far is not None
    np.testing.assert_allclose(far[..., 0] / near[..., 0].max(), (near[..., 0] / near[..., 0].max()) + 1.0, atol=0.02)


def colored_geometry(material: bpy.types.Material, matrices: int) -> Geometry:
    objects = [add_mesh(f"leaves {i}", SQUARE, [(0, 1, 2, 3)], materials=[material]) for i in range(matrices)]
    for obj in objects:
        obj.data.uv_layers.new()
    names = [obj.name for obj in objects]
    return extract(bpy.context.evaluated_depsgraph_get(), objects, leaf_names=names).leaves


def test_objects_keep_their_random_numbers_from_blender() -> None:
    """Two objects share an image. Each object's random number multiplies its color."""
    material, principled, tree = new_material()
    image = texture_node(tree, new_image("i", [[(0.0, 1.0, 0.0, 1.0)] * 4] * 4))
    info, gamma, scale = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("ObjectInfo", "Gamma", "VectorMath"))
    scale.operation = "SCALE"
    tree.links.new(image.outputs["Color"], gamma.inputs["Color"])
    tree.links.new(gamma.outputs[0], scale.inputs[0])
    tree.links.new(info.outputs["Random"], scale.inputs["Scale"])
    tree.links.new(scale.outputs[0], principled.inputs["Base Color"])
    geometry = colored_geometry(material, 2)
    described = describe_materials(geometry)
    assert geometry.randoms is not None
    assert described.colors is not None
    assert geometry.randoms[0] == geometry.randoms[1] != geometry.randoms[2] == geometry.randoms[3]
    image_pixels = described.materials[0]["image"]
    assert image_pixels is not None
    code = float(image_pixels[2, 2, 1]) / 255.0
    shown = described.colors[..., 1] * ((code + 0.055) / 1.055) ** 2.4
    np.testing.assert_allclose(shown, np.repeat(geometry.randoms[:, None], 3, axis=1), atol=0.01)


def test_random_numbers_are_those_of_cycles(tmp_path: Path) -> None:
    """An object and an instance of another object emit their own random numbers, seen from above."""
    material, principled, tree = new_material()
    tree.nodes.remove(principled)
    info, shine = tree.nodes.new("ShaderNodeObjectInfo"), tree.nodes.new("ShaderNodeEmission")
    tree.links.new(info.outputs["Random"], shine.inputs["Color"])
    tree.links.new(shine.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    add_mesh("Blätter", [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [(0, 1, 2, 3)], materials=[material])
    source = bpy.data.collections.new("source")
    source.objects.link(bpy.data.objects.new("twig", bpy.data.objects["Blätter"].data))
    empty = bpy.data.objects.new("instancer", None)
    empty.instance_type, empty.instance_collection, empty.location = "COLLECTION", source, (1.0, 0.0, 0.0)
    scene = bpy.context.scene
    scene.collection.objects.link(empty)
    geometry = extract(bpy.context.evaluated_depsgraph_get(), None, leaf_names=["Blätter", "twig"]).leaves
    seen = render(tmp_path, (1.0, 0.5, 2.0), width=2.0, size=(16, 8), samples=1)
    first, second = seen[4, 4, 0], seen[4, 12, 0]
    assert geometry.randoms is not None
    assert sorted(set(geometry.randoms.tolist())) == pytest.approx(sorted([first, second]), abs=2e-3)
    assert abs(first - second) > 0.01


def test_joined_leaves_keep_their_own_numbers(tmp_path: Path) -> None:
    """Two squares emit their random numbers, before and after a join. Shared node groups stay unchanged."""
    material, principled, tree = new_material()
    tree.nodes.remove(principled)
    inside = bpy.data.node_groups.new("random", "ShaderNodeTree")
    inside.interface.new_socket("Value", in_out="OUTPUT", socket_type="NodeSocketFloat")
    info, end = inside.nodes.new("ShaderNodeObjectInfo"), inside.nodes.new("NodeGroupOutput")
    inside.links.new(info.outputs["Random"], end.inputs[0])
    group, shine = tree.nodes.new("ShaderNodeGroup"), tree.nodes.new("ShaderNodeEmission")
    group.node_tree = inside
    tree.links.new(group.outputs[0], shine.inputs["Color"])
    tree.links.new(shine.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    objects = [add_mesh(name, SQUARE, [(0, 1, 2, 3)], materials=[material]) for name in ("one", "two")]
    objects[1].location.x = 1.0
    bpy.context.view_layer.update()
    view = {"width": 2.0, "size": (16, 8), "samples": 1}
    expected = render(tmp_path, (1.0, 0.5, 2.0), **view)
    geometry = extract(bpy.context.evaluated_depsgraph_get(), objects, leaf_names=["one", "two"]).leaves
    joined = bpy.data.objects.new("all", geometry_mesh("all", geometry))
    bpy.context.scene.collection.objects.link(joined)
    for obj in objects:
        obj.hide_render = True
    before = render(tmp_path, (1.0, 0.5, 2.0), **view)
    read_own_randoms(joined)
    assert joined.data.materials[0] == material
    assert len(inside.nodes) == 2
    np.testing.assert_allclose(render(tmp_path, (1.0, 0.5, 2.0), **view), expected, atol=2e-3)
    assert abs(before - expected).max() > 0.05


def test_only_materials_that_use_random_numbers_are_copied() -> None:
    material, _, _ = new_material()
    mesh = geometry_mesh("all", colored_geometry(material, 2))
    joined = bpy.data.objects.new("all", mesh)
    read_own_randoms(joined)
    assert RANDOM not in mesh.attributes
    assert joined.material_slots[0].material == material


@pytest.mark.parametrize("uses", [True, False])
def test_without_variation_there_are_no_colours(uses: bool) -> None:
    """An unlinked node does not make leaves differ."""
    material = grey_material("ShaderNodeTexCoord" if uses else "ShaderNodeValue", "UV" if uses else "Value")
    material.node_tree.nodes.new("ShaderNodeObjectInfo")
    geometry = colored_geometry(material, 1)
    assert describe_materials(geometry).colors is None


def test_rendering_tints_leaves_no_data() -> None:
    material = grey_material("ShaderNodeObjectInfo", "Random")
    kinds = ("scenes", "objects", "meshes", "cameras", "materials", "node_groups", "images")
    before = {kind: set(getattr(bpy.data, kind).keys()) for kind in kinds}
    nearest_tints([flatten(material)], islands([0.5] * 4))
    assert {kind: set(getattr(bpy.data, kind).keys()) for kind in kinds} == before
