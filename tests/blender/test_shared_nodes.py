"""Materials with nodes that share inputs, and with cycles of links. A row of 40 such nodes has 2⁴⁰ paths.

The tests count Python calls, because their number does not depend on the machine.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any, TypeVar

import bpy
import numpy as np
import pytest
from command_line import QUICK, bake, refusal, saved
from glb import read_glb
from node_trees import math_node, new_image, new_material, texture_node

from addon.errors import SceneError
from addon.material.describe import describe_material
from addon.material.node_links import folded, nodes_behind, tangled_inputs
from addon.material.shading import read_shading
from addon.material.surface import principled_of, read_surface
from addon.material.translucency import read_translucency

LEVELS = 40
MOST_CALLS = 100_000
"""Far more than 40 nodes need, far less than 2⁴⁰."""

_Value = TypeVar("_Value")


def within_calls(work: Callable[[], _Value]) -> _Value:
    """Return the result of `work`. Fail as soon as it needs too many Python calls."""
    calls = 0

    def count(frame: FrameType, event: str, _: object) -> None:
        nonlocal calls
        calls += 1
        if calls > MOST_CALLS:
            sys.setprofile(None)
            pytest.fail(f"more than {MOST_CALLS} calls, in {frame.f_code.co_qualname}")

    sys.setprofile(count)
    try:
        return work()
    finally:
        sys.setprofile(None)


def in_a_row(step: Callable[[Any], Any], first: Any) -> Any:
    for _ in range(LEVELS):
        first = step(first)
    return first


def twice(tree: Any, kind: str, inputs: tuple[Any, Any], output: Any, **settings: Any) -> Callable[[Any], Any]:
    """Add a node with the same link in both inputs."""

    def add(source: Any) -> Any:
        node = tree.nodes.new(kind)
        for name, value in settings.items():
            setattr(node, name, value)
        by_identifier = {socket.identifier: socket for socket in (*node.inputs, *node.outputs)}
        for name in inputs:
            tree.links.new(source, by_identifier[name] if isinstance(name, str) else node.inputs[name])
        return by_identifier[output] if isinstance(output, str) else node.outputs[output]

    return add


def multiplied(tree: Any, source: Any) -> Any:
    return in_a_row(lambda value: math_node(tree, "MULTIPLY", value, value), source)


def mixed_colors(tree: Any, source: Any, blend: str) -> Any:
    add = twice(tree, "ShaderNodeMix", ("A_Color", "B_Color"), "Result_Color", data_type="RGBA", blend_type=blend)
    mixed = in_a_row(add, source)
    for node in tree.nodes:
        if node.type == "MIX":
            node.inputs["Factor"].default_value = 1.0 if blend == "MULTIPLY" else 0.5
    return mixed


def mixed_shaders(tree: Any, source: Any) -> Any:
    return in_a_row(twice(tree, "ShaderNodeMixShader", (1, 2), 0), source)


def constant(tree: Any, value: float = 1.0) -> Any:
    node = tree.nodes.new("ShaderNodeValue")
    node.outputs[0].default_value = value
    return node.outputs[0]


def shown(material: bpy.types.Material) -> tuple[str, list[int]]:
    """Return the alpha mode of a rendered material and a texel of its image. The sRGB code of 0.8 is 231."""
    description, _ = describe_material(material)
    assert description["image"] is not None
    return description["alpha_mode"], description["image"][3, 3].tolist()


def nested(times: int, levels: int) -> bpy.types.NodeTree:
    """A group that has the next one within it so many times, and multiplies what comes out by itself."""
    inner = None
    for _ in range(levels):
        group = bpy.data.node_groups.new("group", "ShaderNodeTree")
        for way in ("INPUT", "OUTPUT"):
            group.interface.new_socket("value", in_out=way, socket_type="NodeSocketFloat")
        value = group.nodes.new("NodeGroupInput").outputs[0]
        for _ in range(times if inner else 0):
            node = group.nodes.new("ShaderNodeGroup")
            node.node_tree = inner
            group.links.new(value, node.inputs[0])
            value = node.outputs[0]
        group.links.new(math_node(group, "MULTIPLY", value, value), group.nodes.new("NodeGroupOutput").inputs[0])
        inner = group
    assert inner is not None
    return inner


def test_a_value_is_made_once_of_each_part() -> None:
    made: list[int] = []

    def ways(number: int, parts: list[int]) -> int:
        made.append(number)
        return sum(parts) if parts else 1

    assert folded(LEVELS, lambda number: [number - 1] * 2 if number else [], ways) == 2**LEVELS
    assert made == list(range(LEVELS + 1))


def test_a_row_of_nodes_may_exceed_the_recursion_limit() -> None:
    length = folded(50_000, lambda number: [number - 1] if number else [], lambda _, parts: sum(parts) + 1)
    assert length == 50_001


def test_alpha_multiplied_by_itself() -> None:
    material, principled, tree = new_material()
    tree.links.new(multiplied(tree, constant(tree)), principled.inputs["Alpha"])
    assert within_calls(lambda: shown(material)) == ("OPAQUE", [231, 231, 231, 255])


def test_alpha_behind_cut_outs_in_a_row() -> None:
    material, principled, tree = new_material()
    factor, clear = constant(tree), tree.nodes.new("ShaderNodeBsdfTransparent").outputs[0]
    shader = principled.outputs[0]
    for _ in range(LEVELS):
        node = tree.nodes.new("ShaderNodeMixShader")
        for source, target in zip((factor, clear, shader), node.inputs, strict=True):
            tree.links.new(source, target)
        shader = node.outputs[0]
    tree.links.new(shader, tree.nodes["Material Output"].inputs["Surface"])
    assert within_calls(lambda: shown(material)) == ("OPAQUE", [231, 231, 231, 255])


def test_colors_multiplied_by_themselves() -> None:
    material, principled, tree = new_material()
    white = tree.nodes.new("ShaderNodeRGB").outputs[0]
    white.default_value = (1.0, 1.0, 1.0, 1.0)
    tree.links.new(mixed_colors(tree, white, "MULTIPLY"), principled.inputs["Base Color"])
    assert within_calls(lambda: shown(material)) == ("OPAQUE", [255, 255, 255, 255])


def test_a_color_mixed_with_itself_stays_the_same() -> None:
    material, principled, tree = new_material()
    image = texture_node(tree, new_image("i", [[(1.0, 0.5, 0.25, 1.0)] * 2] * 2))
    tree.links.new(mixed_colors(tree, image.outputs["Color"], "MIX"), principled.inputs["Base Color"])
    description, _ = within_calls(lambda: describe_material(material))
    assert description["image"] is not None
    assert np.abs(description["image"].astype(int) - (255, 128, 64, 255)).max() <= 1


def test_a_shader_mixed_with_itself_stays_the_same() -> None:
    material, principled, tree = new_material()
    principled.inputs["Base Color"].default_value = (1.0, 0.2, 0.0, 1.0)
    principled.inputs["Subsurface Weight"].default_value = 1.0
    shader = mixed_shaders(tree, principled.outputs[0])
    tree.links.new(shader, tree.nodes["Material Output"].inputs["Surface"])
    description, _ = within_calls(lambda: describe_material(material))
    assert description["image"] is not None
    assert np.abs(description["image"].astype(int) - (255, 124, 0, 255)).max() <= 1
    # Half of what is scattered inside comes out behind, of the one shader as of all its mixes.
    assert within_calls(lambda: read_translucency(material, read_surface(material)).share) == 0.5


def test_normals_added_to_themselves() -> None:
    material, principled, tree = new_material()
    normals = tree.nodes.new("ShaderNodeNormalMap").outputs[0]
    added = in_a_row(twice(tree, "ShaderNodeVectorMath", (0, 1), 0, operation="ADD"), normals)
    tree.links.new(added, principled.inputs["Normal"])
    shading = within_calls(lambda: read_shading(material, None))
    assert shading.normal is not None
    shader = principled_of(material)
    assert shader is not None
    assert len(within_calls(lambda: nodes_behind([shader.input("Normal")]))) == LEVELS + 1


def test_groups_within_groups() -> None:
    material, principled, tree = new_material()
    node = tree.nodes.new("ShaderNodeGroup")
    node.node_tree = nested(1, LEVELS)
    tree.links.new(constant(tree), node.inputs[0])
    tree.links.new(node.outputs[0], principled.inputs["Alpha"])
    assert within_calls(lambda: shown(material)) == ("OPAQUE", [231, 231, 231, 255])


def test_more_groups_within_groups_than_can_be_rendered_are_refused() -> None:
    material, principled, tree = new_material()
    node = tree.nodes.new("ShaderNodeGroup")
    node.node_tree = nested(2, 12)
    tree.links.new(node.outputs[0], principled.inputs["Alpha"])
    # 2 ends and a product in each of 2¹² − 1 groups, 2 more groups in all but the innermost; and 3 nodes around.
    count = 3 * (2**12 - 1) + (2**12 - 2) + 3
    with pytest.raises(SceneError, match=f"material 'm' has {count:,} nodes.* limit is 5,000"):
        within_calls(lambda: read_surface(material))


@pytest.mark.parametrize("socket", ["Base Color", "Alpha", "Normal"])
def test_a_cycle_of_reroutes_ends(socket: str) -> None:
    material, principled, tree = new_material()
    nodes = [tree.nodes.new("NodeReroute") for _ in range(3)]
    for first, second in zip(nodes, [*nodes[1:], nodes[0]], strict=True):
        tree.links.new(first.outputs[0], second.inputs[0])
    tree.links.new(nodes[0].outputs[0], principled.inputs[socket])
    within_calls(lambda: describe_material(material, ("normals", "orm"), 0.5))


def leaf_alpha(shrub: Path) -> tuple[Any, bpy.types.Node, Any]:
    """Import the shrub. Return the leaves' node tree, its Principled BSDF and the alpha output of its image."""
    bpy.ops.import_scene.gltf(filepath=str(shrub))
    tree = bpy.data.objects["leaves"].active_material.node_tree
    nodes = {node.type: node for node in tree.nodes}
    return tree, nodes["BSDF_PRINCIPLED"], nodes["TEX_IMAGE"].outputs["Alpha"]


def test_leaves_whose_nodes_share_inputs_are_baked_and_keep_their_image(shrub: Path, tmp_path: Path) -> None:
    tree, principled, alpha = leaf_alpha(shrub)
    largest = in_a_row(lambda value: math_node(tree, "MAXIMUM", value, value), alpha)
    tree.links.new(largest, principled.inputs["Alpha"])
    assert within_calls(lambda: tangled_inputs(tree)) == [principled.inputs["Alpha"]]
    report = bake(saved(tmp_path / "shared.blend"), tmp_path / "out", *QUICK, "--levels", 1)
    assert [warning for warning in report["warnings"] if "Alpha" in warning and "exporter" in warning]
    leaf = read_glb(tmp_path / "out" / "shared_LOD0.glb")["shared_LOD0"].primitives[0].material
    assert leaf["alphaMode"] == "MASK"
    assert "baseColorTexture" in leaf["pbrMetallicRoughness"]


def test_leaves_with_a_cycle_of_links_are_baked_as_without_it(shrub: Path, tmp_path: Path) -> None:
    tree, _, alpha = leaf_alpha(shrub)
    _, target = next((link.from_socket, link.to_socket) for link in tree.links if link.from_socket == alpha)
    first, second = (tree.nodes.new("ShaderNodeMath") for _ in range(2))
    for node in (first, second):
        node.operation, node.inputs[1].default_value = "MULTIPLY", 1.0
    tree.links.new(alpha, first.inputs[0])
    tree.links.new(first.outputs[0], target)
    tree.links.new(first.outputs[0], second.inputs[0])
    tree.links.new(second.outputs[0], first.inputs[1])
    assert [link.is_valid for link in tree.links].count(False) == 1
    report = bake(saved(tmp_path / "cycle.blend"), tmp_path / "out", *QUICK, "--levels", 1)
    assert not [warning for warning in report["warnings"] if "material" in warning]


def test_nodes_that_cannot_be_rendered_are_refused_in_one_line(shrub: Path, tmp_path: Path) -> None:
    tree, principled, alpha = leaf_alpha(shrub)
    node = tree.nodes.new("ShaderNodeGroup")
    node.node_tree = nested(2, 12)
    tree.links.new(alpha, node.inputs[0])
    tree.links.new(node.outputs[0], principled.inputs["Alpha"])
    line = refusal(tmp_path / "out", "--input", saved(tmp_path / "groups.blend"))
    assert "nodes" in line
    assert "limit" in line
