"""Tangents in GLB files: only for a normal map, and by the UV map of its texture."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest
from glb import read_glb
from node_trees import new_image, new_material, texture_node
from scenes import SQUARE, add_mesh

from addon.export.gltf import export_collection

pytestmark = pytest.mark.version


def mapped_material(uv_map: str) -> bpy.types.Material:
    material, principled, tree = new_material()
    node, image = tree.nodes.new("ShaderNodeNormalMap"), texture_node(tree, new_image("n", [[(0.5, 0.5, 1.0, 1.0)]]))
    layout = tree.nodes.new("ShaderNodeUVMap")
    layout.uv_map = uv_map
    tree.links.new(layout.outputs["UV"], image.inputs["Vector"])
    tree.links.new(image.outputs["Color"], node.inputs["Color"])
    tree.links.new(node.outputs["Normal"], principled.inputs["Normal"])
    return material


def exported(obj: bpy.types.Object, path: Path) -> dict[str, np.ndarray]:
    collection = bpy.data.collections.new("out")
    bpy.context.scene.collection.children.link(collection)
    collection.objects.link(obj)
    export_collection(collection, path)
    return read_glb(path)[obj.name].primitives[0].attributes


def test_a_mesh_without_texture_coordinates_has_no_tangents(tmp_path: Path) -> None:
    obj = add_mesh("plain", SQUARE, [(0, 1, 2, 3)])
    obj.data.materials.append(mapped_material(""))
    assert "TANGENT" not in exported(obj, tmp_path / "plain.glb")


@pytest.mark.parametrize(("used", "expected"), [("first", (1.0, 0.0)), ("second", (0.0, 1.0))])
def test_tangents_follow_the_uv_map_of_the_texture(tmp_path: Path, used: str, expected: tuple[float, float]) -> None:
    """The u axis of the second UV map runs along y."""
    obj = add_mesh("leaf", [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [(0, 1, 2, 3)])
    points = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float32)
    for name, uvs in (("first", points), ("second", points[:, ::-1])):
        obj.data.uv_layers.new(name=name).uv.foreach_set("vector", uvs.ravel())
    obj.data.materials.append(mapped_material(used))
    tangents = exported(obj, tmp_path / "leaf.glb")["TANGENT"]
    # Blender's y is −z in glTF.
    along = (expected[0], 0.0, -expected[1], 1.0 if used == "first" else -1.0)
    np.testing.assert_allclose(tangents, np.tile(along, (4, 1)), atol=1e-6)
