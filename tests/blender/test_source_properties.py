"""Properties of source files beyond meshes and base colors: kept, or their loss is told (docs/files.md)."""

from __future__ import annotations

import io
import json
import math
import struct
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from node_trees import new_material
from PIL import Image
from scenes import add_mesh
from small_glb import png, write_document, write_quad_glb

import leafcloud
from addon.bake.pipeline import plan
from addon.errors import SceneError
from addon.export.glb_file import Glb
from addon.export.gltf import export_collection
from addon.export.translucency import add_leaf_translucency
from addon.material.cutouts import cut_out_by_images, forgotten_alpha
from addon.material.losses import losses
from addon.material.surface import are_unlit, read_surface
from addon.material.translucency import read_translucency
from addon.mesh.extract import extract
from addon.mesh.motion import at_rest, lost_motion
from addon.scene.load import load
from addon.settings.bake import BakeSettings

HALF_CLEAR = png([[(60, 120, 40, 255), (60, 120, 40, 0)], [(60, 120, 40, 255), (60, 120, 40, 0)]])
TEXTURED: dict[str, Any] = {"baseColorTexture": {"index": 0}}


def imported(folder: Path, **options: Any) -> tuple[bpy.types.Material, list[str]]:
    """Return the material of a small GLB from Blender's importer, and what was told."""
    notes = load(write_quad_glb(folder / "a.glb", **options))
    return bpy.data.meshes[0].materials[0], notes


@pytest.mark.version
@pytest.mark.parametrize("mode", ["OPAQUE", "MASK", "BLEND"])
def test_unlit_materials_are_read(tmp_path: Path, mode: str) -> None:
    unlit = {"pbrMetallicRoughness": TEXTURED, "alphaMode": mode, "extensions": {"KHR_materials_unlit": {}}}
    material, _ = imported(tmp_path, material=unlit, image=HALF_CLEAR)
    surface = read_surface(material)
    assert (surface.unlit, surface.alpha_mode, surface.gaps) == (True, mode, ())
    assert surface.color_texture is not None
    assert losses(material) == []


def test_levels_of_unlit_leaves_need_no_light(tmp_path: Path) -> None:
    unlit = {"pbrMetallicRoughness": TEXTURED, "alphaMode": "MASK", "extensions": {"KHR_materials_unlit": {}}}
    imported(tmp_path, material=unlit, image=HALF_CLEAR)
    tree = extract(bpy.context.evaluated_depsgraph_get(), None)
    assert are_unlit(tree.leaves.materials)
    planned = {each.name: each for each in plan(tree, BakeSettings(effects="auto")).effects}
    assert planned["normals"].reason == "the leaves show their colors without light"
    assert not planned["baked_light"].on


@pytest.mark.version
def test_diffuse_transmission_is_read_and_written_again(tmp_path: Path) -> None:
    """A factor f and a color c: (1 − f) · base color is reflected, f · c is transmitted."""
    extension = {"diffuseTransmissionFactor": 0.25, "diffuseTransmissionColorFactor": [0.5, 1.0, 0.25]}
    material, notes = imported(
        tmp_path,
        material={
            "pbrMetallicRoughness": TEXTURED,
            "alphaMode": "MASK",
            "extensions": {"KHR_materials_diffuse_transmission": extension},
        },
        image=HALF_CLEAR,
    )
    surface = read_surface(material)
    through = read_translucency(material, surface)
    assert notes == []
    assert (surface.alpha_mode, surface.gaps) == ("MASK", ())
    assert through.share == pytest.approx(0.25)
    assert through.reflected == pytest.approx(0.75)
    assert np.allclose(through.color, [0.125, 0.25, 0.0625])
    assert "leafcloud_material" not in material


def test_a_texture_of_the_transmission_is_read_as_its_mean(tmp_path: Path) -> None:
    """Half of the texels have alpha 0: half of the factor is left."""
    extension = {"diffuseTransmissionFactor": 0.5, "diffuseTransmissionTexture": {"index": 0}}
    material, [note] = imported(
        tmp_path,
        material={
            "pbrMetallicRoughness": TEXTURED,
            "extensions": {"KHR_materials_diffuse_transmission": extension},
        },
        image=HALF_CLEAR,
    )
    assert read_translucency(material, read_surface(material)).share == pytest.approx(0.25)
    assert "the mean of the texture is used" in note


def test_extensions_that_nothing_reads_are_told(tmp_path: Path) -> None:
    material = {"extensions": {"KHR_materials_iridescence": {"iridescenceFactor": 1.0}, "KHR_materials_ior": {}}}
    _, notes = imported(tmp_path, material=material)
    assert notes == ["material 'leaf': KHR_materials_iridescence of the file is left out"]


def test_a_black_emission_texture_is_no_light(tmp_path: Path) -> None:
    black, gray = (png([[(value, value, value, 255)]]) for value in (0, 90))
    shining = {"emissiveTexture": {"index": 0}, "emissiveFactor": [1.0, 1.0, 1.0]}
    assert losses(imported(tmp_path, material=shining, image=black)[0]) == []
    [said] = losses(imported(tmp_path, material=shining, image=gray)[0])
    assert "emits light" in said


def test_an_image_without_alpha_blends_nothing(tmp_path: Path) -> None:
    content = io.BytesIO()
    Image.new("RGB", (4, 4), (60, 120, 40)).save(content, "JPEG")
    blended = {"pbrMetallicRoughness": TEXTURED, "alphaMode": "BLEND"}
    material, _ = imported(tmp_path, material=blended, image=content.getvalue())
    assert read_surface(material).alpha_mode == "OPAQUE"
    material, _ = imported(tmp_path, material=blended, image=HALF_CLEAR)
    assert read_surface(material).alpha_mode == "BLEND"


def test_alpha_that_a_material_ignores_is_asked_for(tmp_path: Path) -> None:
    material, _ = imported(tmp_path, material={"pbrMetallicRoughness": TEXTURED}, image=HALF_CLEAR)
    [question] = forgotten_alpha([material, material])
    assert "50% of its image" in question
    assert "`alpha=texture`" in question
    cut_out_by_images([material])
    surface = read_surface(material)
    assert (surface.alpha_mode, surface.alpha_cutoff) == ("MASK", 0.5)
    assert forgotten_alpha([material]) == []


def test_a_missing_image_of_bark_is_told(tmp_path: Path) -> None:
    """The base color is needed, a normal map is not."""
    material, principled, _ = new_material()
    image, normal = (material.node_tree.nodes.new(f"ShaderNode{kind}") for kind in ("TexImage", "NormalMap"))
    image.image = bpy.data.images.new("gone", 2, 2)
    image.image.source, image.image.filepath = "FILE", str(tmp_path / "gone.png")
    material.node_tree.links.new(image.outputs["Color"], normal.inputs["Color"])
    material.node_tree.links.new(normal.outputs["Normal"], principled.inputs["Normal"])
    [said] = losses(material)
    assert "gone.png" in said
    assert "is missing" in said


# OBJ


def obj_file(folder: Path, up: str, material: str = "") -> Path:
    """Write a plant of leaves 1 to 3 above its foot, with Y or Z up, 1 wide."""
    random = np.random.default_rng(3)
    corners = np.concatenate(
        [random.uniform((-1, -1, 1), (1, 1, 3), (300, 3)), [[-0.1, 0, 0], [0.1, 0, 0], [0, 0.1, 1]]]
    )
    if up == "y":
        corners = corners[:, [0, 2, 1]] * (1, 1, -1)
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in corners]
    faces = [f"f {i}/1 {i + 1}/2 {i + 2}/3" for i in range(1, len(corners), 3)]
    (folder / "t.mtl").write_text(f"newmtl leaf\nKd 1 1 1\n{material}")
    text = ["mtllib t.mtl", *lines, "vt 0 0", "vt 1 0", "vt 0 1", "usemtl leaf", *faces]
    (folder / "t.obj").write_text("\n".join(text) + "\n")
    return folder / "t.obj"


def height() -> float:
    [obj] = [each for each in bpy.context.scene.objects if each.type == "MESH"]
    bpy.context.view_layer.update()
    return max((obj.matrix_world @ vertex.co).z for vertex in obj.data.vertices)


@pytest.mark.version
@pytest.mark.parametrize(("up", "asked", "told"), [("y", "auto", 0), ("z", "auto", 1), ("z", "z", 0), ("y", "y", 0)])
def test_a_plant_of_an_obj_file_stands(tmp_path: Path, up: str, asked: Any, told: int) -> None:
    notes = load(obj_file(tmp_path, up), asked)
    assert height() == pytest.approx(3.0, abs=0.05)
    assert len(notes) == told


@pytest.mark.version
def test_a_gray_mask_cuts_leaves_out_and_clear_glass_is_left_out(tmp_path: Path) -> None:
    Image.new("L", (4, 4), 0).save(tmp_path / "mask.png")
    Image.new("RGB", (4, 4), (60, 120, 40)).save(tmp_path / "leaf.png")
    [note] = load(obj_file(tmp_path, "y", "Tf 1 1 1\nmap_Kd leaf.png\nmap_d mask.png\n"))
    surface = read_surface(bpy.data.materials["leaf"])
    assert "clear glass" in note
    assert surface.alpha_channel == "luminance"
    assert read_translucency(bpy.data.materials["leaf"], surface).share == 0.0


# Motion


def test_an_animated_skeleton_is_baked_at_rest() -> None:
    leaf = add_mesh("leaves", [(0, 0, 1), (1, 0, 1), (0, 0, 2)], [(0, 1, 2)])
    skeleton = bpy.data.armatures.new("bones")
    bones = bpy.data.objects.new("bones", skeleton)
    bpy.context.scene.collection.objects.link(bones)
    bpy.context.view_layer.objects.active = bones
    bpy.ops.object.mode_set(mode="EDIT")
    bone = skeleton.edit_bones.new("bone")
    bone.tail = (0.0, 0.0, 1.0)
    bpy.ops.object.mode_set(mode="OBJECT")
    leaf.vertex_groups.new(name="bone").add([0, 1, 2], 1.0, "REPLACE")
    leaf.modifiers.new("bones", "ARMATURE").object = bones
    pose = bones.pose.bones["bone"]
    pose.rotation_mode = "XYZ"
    pose.rotation_euler = (math.pi / 2.0, 0.0, 0.0)
    bpy.context.view_layer.update()
    graph = bpy.context.evaluated_depsgraph_get()
    assert extract(graph, None).leaves.positions[:, 2].max() < 1.5, "a pose without keys is what an artist sees"
    pose.keyframe_insert("rotation_euler", frame=1)
    with at_rest(bpy.context.view_layer):
        tree = extract(bpy.context.evaluated_depsgraph_get(), None)
    assert tree.leaves.positions[:, 2].max() == pytest.approx(2.0)
    assert skeleton.pose_position == "POSE"


def test_motion_that_levels_do_not_keep_is_told() -> None:
    leaf = add_mesh("leaves", [(0, 0, 1), (1, 0, 1), (0, 0, 2)], [(0, 1, 2)])
    graph = bpy.context.evaluated_depsgraph_get
    assert not any("moving in the source" in each for each in extract(graph(), None).warnings)
    leaf.location.x = 1.0
    leaf.keyframe_insert("location", frame=1)
    [said] = [each for each in extract(graph(), None).warnings if "moving in the source" in each]
    assert "'leaves' by keys of their own" in said


# Compressed files


def compressed(path: Path, changes: dict[str, Any] | None = None) -> Path:
    """Write a leaf with streams of EXT_meshopt_compression: positions as they are, normals OCTAHEDRAL in 8 bits."""
    corners = np.array([(0, 0, 0), (1, 0, 0), (0, 2, 0)], np.float32)
    normals = np.array([(0, 0, 127, 0)] * 3, np.int8)
    streams = [
        leafcloud.compress_rows(corners.view(np.uint8).reshape(3, 12)),
        leafcloud.compress_rows(normals.view(np.uint8)),
        leafcloud.compress_triangles(np.array([[0, 1, 2]], np.uint32)),
    ]
    shapes = [(12, "ATTRIBUTES", "NONE"), (4, "ATTRIBUTES", "OCTAHEDRAL"), (4, "TRIANGLES", "NONE")]
    views, body = [], b""
    for stream, (stride, mode, form) in zip(streams, shapes, strict=True):
        packed = {"buffer": 0, "byteOffset": len(body), "byteLength": len(stream), "byteStride": stride, "count": 3}
        packed |= {"mode": mode, **({} if form == "NONE" else {"filter": form}), **(changes or {})}
        views.append(
            {
                **{"buffer": 1, "byteOffset": 0, "byteLength": 3 * stride},
                **({"byteStride": stride} if mode == "ATTRIBUTES" else {}),
                "extensions": {"EXT_meshopt_compression": packed},
            }
        )
        body += stream + bytes(-len(stream) % 4)
    document: dict[str, Any] = {
        "asset": {"version": "2.0"},
        **{
            "extensionsUsed": ["EXT_meshopt_compression", "KHR_mesh_quantization"],
            "scene": 0,
            "scenes": [{"nodes": [0]}],
        },
        "extensionsRequired": ["EXT_meshopt_compression", "KHR_mesh_quantization"],
        "nodes": [{"name": "leaves", "mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": 2}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 2, 0]},
            {"bufferView": 1, "componentType": 5120, "count": 3, "type": "VEC3", "normalized": True},
            {"bufferView": 2, "componentType": 5125, "count": 3, "type": "SCALAR"},
        ],
        "bufferViews": views,
        "buffers": [
            {"byteLength": len(body)},
            {"byteLength": 36, "extensions": {"EXT_meshopt_compression": {"fallback": True}}},
        ],
    }
    return write_document(path, document, body)


@pytest.mark.version
def test_meshes_of_meshoptimizer_are_read(tmp_path: Path) -> None:
    load(compressed(tmp_path / "tree.glb"))
    [obj] = bpy.context.scene.objects
    corners = sorted(tuple(round(x, 4) for x in obj.matrix_world @ vertex.co) for vertex in obj.data.vertices)
    assert corners == [(0.0, 0.0, 0.0), (0.0, 0.0, 2.0), (1.0, 0.0, 0.0)]
    assert obj.name == "leaves"


@pytest.mark.parametrize(
    "changes",
    [
        *({"byteLength": 10**6}, {"count": 10**6}, {"count": 4}, {"mode": "OTHER"}, {"filter": "QUATERNION"}),
        *({"byteOffset": 3}, {"byteStride": 3}),
    ],
)
def test_broken_streams_are_refused(tmp_path: Path, changes: dict[str, Any]) -> None:
    with pytest.raises(Exception, match="is not glTF, or is broken"):
        load(compressed(tmp_path / "tree.glb", changes))


def test_a_leaf_that_transmits_light_keeps_it_in_files(tmp_path: Path) -> None:
    extension = {"diffuseTransmissionFactor": 0.25, "diffuseTransmissionColorTexture": {"index": 0}}
    imported(
        tmp_path,
        material={
            "pbrMetallicRoughness": TEXTURED,
            "extensions": {"KHR_materials_diffuse_transmission": extension},
        },
        image=HALF_CLEAR,
    )
    collection = bpy.data.collections.new("tree")
    bpy.context.scene.collection.children.link(collection)
    collection.objects.link(bpy.context.scene.objects[0])
    export_collection(collection, tmp_path / "out.glb", [lambda glb: add_leaf_translucency(glb, collection)])
    [material] = Glb.read(tmp_path / "out.glb").materials
    written = material["extensions"]["KHR_materials_diffuse_transmission"]
    assert written["diffuseTransmissionFactor"] == pytest.approx(0.25)
    assert written["diffuseTransmissionColorTexture"]["index"] == 0, "the base color's own texture"


def test_a_buffer_without_data_is_refused(tmp_path: Path) -> None:
    """A fallback buffer is for compressed views alone: its bytes are nowhere."""
    document: dict[str, Any] = {
        "asset": {"version": "2.0"},
        **{"scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}]},
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 1]}
        ],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"byteLength": 36, "extensions": {"EXT_meshopt_compression": {"fallback": True}}}],
    }
    with pytest.raises(SceneError, match="has 0 of its 36 bytes"):
        load(write_document(tmp_path / "a.glb", document, b""))


def test_views_that_overlap_too_often_are_refused(tmp_path: Path) -> None:
    """They are copied when a file is unpacked."""
    path = compressed(tmp_path / "a.glb")
    content = path.read_bytes()
    size = struct.unpack_from("<I", content, 12)[0]
    document = json.loads(content[20 : 20 + size])
    document["bufferViews"] += [{"buffer": 0, "byteLength": document["buffers"][0]["byteLength"]}] * 50
    with pytest.raises(SceneError, match="its buffer views have"):
        load(write_document(path, document, content[28 + size :]))


@pytest.mark.parametrize("mark", [99, "abc", [1]])
def test_a_property_with_the_name_of_our_mark_is_harmless(tmp_path: Path, mark: object) -> None:
    material, _ = imported(tmp_path, material={"extras": {"leafcloud_material": mark}})
    assert material.name == "leaf"


def test_the_colors_own_file_as_a_mask_masks_nothing(tmp_path: Path) -> None:
    Image.new("RGB", (4, 4), (0, 90, 0)).save(tmp_path / "leaf.png")
    load(obj_file(tmp_path, "y", "map_Kd leaf.png\nmap_d leaf.png\n"))
    surface = read_surface(bpy.data.materials["leaf"])
    assert surface.alpha_mode == "OPAQUE"
    assert surface.color_texture is not None
    assert surface.color_texture.image.colorspace_settings.name == "sRGB"


def test_a_posed_skeleton_without_keys_is_not_told() -> None:
    leaf = add_mesh("leaves", [(0, 0, 1), (1, 0, 1), (0, 0, 2)], [(0, 1, 2)])
    bones = bpy.data.objects.new("bones", bpy.data.armatures.new("bones"))
    bpy.context.scene.collection.objects.link(bones)
    leaf.modifiers.new("bones", "ARMATURE").object = bones
    assert lost_motion([leaf]) == []
    bones.keyframe_insert("location", frame=1)
    [said] = lost_motion([leaf])
    assert "'leaves' by a skeleton" in said


def test_an_image_in_a_group_is_not_cut_out(tmp_path: Path) -> None:
    """The link would cross from one node tree into another."""
    material, _ = imported(tmp_path, material={"pbrMetallicRoughness": TEXTURED}, image=HALF_CLEAR)
    tree = material.node_tree
    group = bpy.data.node_groups.new("inside", "ShaderNodeTree")
    group.interface.new_socket("Color", in_out="OUTPUT", socket_type="NodeSocketColor")
    own = next(node for node in tree.nodes if node.type == "TEX_IMAGE")
    copy, end = group.nodes.new("ShaderNodeTexImage"), group.nodes.new("NodeGroupOutput")
    copy.image = own.image
    group.links.new(copy.outputs["Color"], end.inputs["Color"])
    node = tree.nodes.new("ShaderNodeGroup")
    node.node_tree = group
    target = own.outputs["Color"].links[0].to_socket
    tree.nodes.remove(own)
    tree.links.new(node.outputs["Color"], target)
    cut_out_by_images([material])
    assert len(forgotten_alpha([material])) == 1
