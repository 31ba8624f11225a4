"""Baked light: the light on both sides of leaves in Cycles, and the brightness of levels beside the lit leaves."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from command_line import bake as bake_file
from node_trees import math_node, new_image, new_material, texture_node
from renders import LUMINANCE, render
from scenes import add_mesh, bake, read

from addon.bake.lighting import BakedLight, light_of
from addon.bake.pipeline import prepare
from addon.bake.values import Baked
from addon.errors import SceneError
from addon.export.glb_file import Glb
from addon.export.gltf import export_level
from addon.export.gpu_load import GpuLoad
from addon.export.report import report
from addon.export.unlit import mean_light
from addon.geometry import Tree
from addon.plan.effects import is_on, plan_channels, plan_effects
from addon.plan.facts import Facts
from addon.scene import light
from addon.settings.bake import BakeSettings
from addon.settings.effects import EFFECTS

SKY = (0.2, 0.3, 0.4)
GREEN = (0.1, 0.3, 0.05)


def world(color: tuple[float, float, float]) -> None:
    made = bpy.data.worlds.new("world")
    if made.node_tree is None:
        made.use_nodes = True
    made.node_tree.nodes["Background"].inputs["Color"].default_value = (*color, 1.0)
    bpy.context.scene.world = made


def sun(strength: float, angle: float) -> bpy.types.Object:
    """Add a sun with sharp shadows at an angle from the zenith."""
    made = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    made.data.energy, made.data.angle, made.rotation_euler = strength, 0.0, (angle, 0.0, 0.0)
    bpy.context.scene.collection.objects.link(made)
    return made


def matt(color: tuple[float, float, float] = GREEN) -> bpy.types.Material:
    """Return a material without highlights."""
    material, principled, _ = new_material()
    principled.inputs["Base Color"].default_value = (*color, 1.0)
    principled.inputs["Roughness"].default_value, principled.inputs["Specular IOR Level"].default_value = 1.0, 0.0
    return material


def square(name: str, height: float, side: float = 1.0, material: bpy.types.Material | None = None) -> bpy.types.Object:
    """Add a square around the origin, counter-clockwise seen from above."""
    half = side / 2.0
    corners = [(x, y, height) for x, y in ((-half, -half), (half, -half), (half, half), (-half, half))]
    obj = add_mesh(name, corners, [(0, 1, 2, 3)], materials=[material or matt()])
    uvs = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float32)
    obj.data.uv_layers.new(name="UVMap").uv.foreach_set("vector", uvs.ravel())
    return obj


def lit(tree: Tree, **options: Any) -> BakedLight:
    return light_of(tree, bpy.context.view_layer, **{"with_trunk": False, **options})


# The light


def test_a_sun_lights_the_front_and_the_sky_both_sides() -> None:
    """A sun of strength S at the angle θ gives S · cos θ / π in front. A uniform world adds its color everywhere."""
    leaf = square("leaf", 0.0)
    world(SKY)
    sun(2.0, math.radians(60.0))
    result = lit(read([leaf], ["leaf"]))
    np.testing.assert_allclose(result.leaves.front, np.broadcast_to(SKY, (2, 3, 3)) + 1.0 / math.pi, rtol=1e-5)
    np.testing.assert_allclose(result.leaves.back, np.broadcast_to(SKY, (2, 3, 3)), rtol=1e-5)
    assert result.strength == 1.0
    assert result.warnings == ()


def test_bright_light_is_stored_relative_to_its_strength() -> None:
    leaf = square("leaf", 0.0)
    sun(3.0 * math.pi, 0.0)
    result = lit(read([leaf], ["leaf"]))
    assert result.strength == pytest.approx(3.0, rel=1e-5)
    np.testing.assert_allclose(result.leaves.front, 1.0, rtol=1e-5)
    np.testing.assert_allclose(result.leaves.back, 0.0, atol=1e-6)


def test_without_light_there_is_a_warning() -> None:
    leaf = square("leaf", 0.0)
    [warning] = lit(read([leaf], ["leaf"])).warnings
    assert warning == (
        "no light of the scene 'Scene' reaches the leaves, so baked_light makes them black: add a light, or a world"
    )


@pytest.mark.parametrize("mirrored", [False, True])
def test_the_front_stays_the_front_when_the_tree_is_mirrored(mirrored: bool) -> None:
    leaf = square("leaf", 0.0)
    leaf.scale[0] = -1.0 if mirrored else 1.0
    sun(math.pi, 0.0)
    bpy.context.view_layer.update()
    result = lit(read([leaf], ["leaf"]))
    np.testing.assert_allclose(result.leaves.front, 1.0, rtol=1e-5)
    np.testing.assert_allclose(result.leaves.back, 0.0, atol=1e-6)


def test_custom_normals_decide_the_light_on_both_sides() -> None:
    """The leaf stands upright, with normals 60° from the sun in the zenith. The oracle is a Cycles render."""
    leaf = add_mesh("leaf", [(0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1)], [(0, 1, 2, 3)], materials=[matt()])
    leaf.data.normals_split_custom_set([(0.0, -math.sin(math.pi / 3.0), 0.5)] * 4)
    for angle in (0.3, -0.3):  # Before the leaf and behind it.
        lamp = sun(math.pi, angle)
        result = lit(read([leaf], ["leaf"]))
        np.testing.assert_allclose(result.leaves.front, math.cos(math.pi / 3.0 - angle), atol=2e-3)
        np.testing.assert_allclose(result.leaves.back, 0.0, atol=1e-6)
        bpy.data.objects.remove(lamp)


@pytest.mark.parametrize("by", ["leaf", "trunk", "other"])
def test_objects_in_the_light_cast_shadows_on_leaves(by: str) -> None:
    """The object may belong to the tree or not."""
    leaf, above = square("leaf", 0.0), square("above", 1.0, 2.0)
    sun(math.pi, 0.0)
    objects, names = ([leaf], ["leaf"]) if by == "other" else ([leaf, above], ["leaf", "above"][: 1 + (by == "leaf")])
    tree = read(objects, names)
    below = (tree.leaves.positions[tree.leaves.triangles][..., 2] == 0.0).all(axis=1)
    result = lit(tree)
    np.testing.assert_allclose(result.leaves.front[below], 0.0, atol=1e-6)
    np.testing.assert_allclose(result.leaves.front[~below], 1.0, rtol=1e-5)
    assert (~below).sum() == (2 if by == "leaf" else 0)
    above.hide_render = by == "other"
    expected = 1.0 if by == "other" else 0.0
    np.testing.assert_allclose(lit(read([leaf], ["leaf"]) if by == "other" else tree).leaves.front[below], expected)


def test_a_cut_out_leaf_casts_a_cut_out_shadow() -> None:
    """Only the left half of the upper leaf is opaque. Small leaves lie under both halves."""
    material = matt()
    tree = material.node_tree
    image = texture_node(tree, new_image("i", [[(1.0, 1.0, 1.0, 1.0), (1.0, 1.0, 1.0, 0.0)]]))
    image.interpolation = "Closest"
    cut = math_node(tree, "GREATER_THAN", image.outputs["Alpha"], 0.5)
    tree.links.new(cut, next(n for n in tree.nodes if n.type == "BSDF_PRINCIPLED").inputs["Alpha"])
    above = square("above", 1.0, 2.0, material)
    small = [square(f"leaf {x}", 0.0, 0.4) for x in (-0.5, 0.5)]
    for obj, x in zip(small, (-0.5, 0.5), strict=True):
        obj.location[0] = x
    sun(math.pi, 0.0)
    bpy.context.view_layer.update()
    geometry = read([above, *small], ["above", "leaf -0.5", "leaf 0.5"])
    front = lit(geometry).leaves.front
    corners = geometry.leaves.positions[geometry.leaves.triangles] @ geometry.matrix[:3, :3].T + geometry.matrix[:3, 3]
    left, right = ((corners[..., 2] < 0.5).all(axis=1) & (sign * corners[..., 0] > 0.0).all(axis=1) for sign in (-1, 1))
    # The leaf in the sun reflects light onto the other.
    np.testing.assert_allclose(front[left], 0.0, atol=0.01)
    np.testing.assert_allclose(front[right], 1.0, atol=0.01)


def test_two_bakes_give_the_same_light() -> None:
    leaves = [square(f"leaf {number}", 0.2 * number) for number in range(3)]
    world(SKY)
    sun(2.0, 0.5).data.angle = 0.2
    tree = read(leaves, [obj.name for obj in leaves])
    first, second = lit(tree), lit(tree)
    assert first.leaves.front.tobytes() == second.leaves.front.tobytes()
    assert first.leaves.back.tobytes() == second.leaves.back.tobytes()
    assert first.leaves.front.std() > 0.01


# The scene


KINDS = ("scenes", "objects", "meshes", "materials", "node_groups", "images", "collections", "worlds", "lights")


def state() -> Any:
    scene, layer = bpy.context.scene, bpy.context.view_layer
    shown = [(obj.name, obj.hide_render, obj.visible_get(), obj.select_get()) for obj in scene.objects]
    render = (scene.render.engine, scene.cycles.samples, scene.cycles.seed, scene.cycles.transparent_max_bounces)
    slots = [[slot.material.name for slot in obj.material_slots] for obj in scene.objects]
    kinds = {kind: sorted(getattr(bpy.data, kind).keys()) for kind in KINDS}
    return shown, render, slots, layer.objects.active, scene.name, kinds


@pytest.mark.parametrize("fails", [False, True])
def test_a_light_bake_leaves_the_scene_unchanged(fails: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    leaf, trunk, hidden = square("leaf", 0.0), square("trunk", 1.0), square("hidden", 2.0)
    hidden.hide_render = True
    world(SKY)
    trunk.select_set(True)
    bpy.context.view_layer.objects.active = trunk
    tree = read([leaf, trunk], ["leaf"])
    before = state()
    if fails:

        def failing(*_: object) -> None:
            raise RuntimeError("no engine")

        monkeypatch.setattr(light, "_bake", failing)
        with pytest.raises(
            SceneError, match=r"the light of the scene 'Scene' could not be baked \(no engine\); enable"
        ):
            lit(tree, with_trunk=True)
    else:
        assert lit(tree, with_trunk=True).trunk is not None
    assert state() == before


def test_objects_outside_of_the_view_layer_cast_no_shadow() -> None:
    leaf = square("leaf", 0.0)
    out = bpy.data.collections.new("out")
    bpy.context.scene.collection.children.link(out)
    above = square("above", 1.0, 2.0)
    bpy.context.scene.collection.objects.unlink(above)
    out.objects.link(above)
    bpy.context.view_layer.layer_collection.children["out"].exclude = True
    sun(math.pi, 0.0)
    np.testing.assert_allclose(lit(read([leaf], ["leaf"])).leaves.front, 1.0, rtol=1e-5)


# The plan


def test_baked_light_is_asked_for_by_name() -> None:
    facts = Facts("generic", 2)
    for choice, words in (("auto", "asked for by name"), ("all", "not by `effects=all`")):
        [effect] = [each for each in plan_effects(BakeSettings(effects=choice), facts) if each.name == "baked_light"]
        assert effect.on is False
        assert words in effect.reason
    assert is_on(plan_effects(BakeSettings(effects="baked_light"), facts), "baked_light")


def test_baked_light_turns_effects_for_moving_lights_off() -> None:
    settings = BakeSettings(effects=",".join(EFFECTS))
    effects = plan_effects(settings, Facts("generic", 2))
    on = {effect.name for effect in effects if effect.on}
    kept = {"transitions", "pruning", "back_sides", "trunk_levels", "far_levels"}
    assert on == {*kept, "blend_order", "wind", "baked_light"}
    assert all("the light is baked in" in effect.reason for effect in effects if not effect.on)
    assert plan_channels(settings, Facts("generic", 2)) == ()
    assert is_on(plan_effects(BakeSettings(effects="baked_light"), Facts("generic", 2)), "back_sides")


def test_the_plan_alone_bakes_nothing() -> None:
    tree = read([square("leaf", 0.0)], ["leaf"])
    assert prepare(tree, BakeSettings(effects="baked_light")).light is None


# The levels


def field(material: bpy.types.Material, stacked: int = 1) -> bpy.types.Object:
    """Add nearly flat leaves side by side, in one layer or in several layers that shade each other."""
    heights = np.random.default_rng(2).uniform(-0.02, 0.02, 16 * stacked)
    corners = [
        (x + dx, y + dy, 0.5 * layer + float(heights[16 * layer + 4 * x + y]))
        for layer in range(stacked)
        for x in range(4)
        for y in range(4)
        for dx, dy in ((0.1, 0.1), (0.9, 0.1), (0.9, 0.9), (0.1, 0.9))
    ]
    faces = [(i, i + 1, i + 2, i + 3) for i in range(0, 64 * stacked, 4)]
    return add_mesh("leaves", corners, faces, materials=[material])


def baked(obj: bpy.types.Object, *others: bpy.types.Object, **settings: Any) -> Baked:
    tree = read([obj, *others], [obj.name])
    chosen = {"effects": "baked_light", "levels": 1, "cross": False, "texture_size": 256, **settings}
    return bake(tree, BakeSettings(**chosen))


def seen(objects: list[bpy.types.Object], folder: Path, *, behind: bool) -> float:
    """Show only this object, and return its mean luminance from above or from below."""
    scene = bpy.context.scene
    shown = {obj.name for obj in objects}
    for obj in scene.objects:
        if obj.type == "MESH":
            obj.hide_render = obj.name not in shown
    height, turn = (-5.0, math.pi) if behind else (5.0, 0.0)
    pixels = render(folder, (2.0, 2.0, height), (turn, 0.0, 0.0), width=4.0)
    return float((pixels[..., :3] @ LUMINANCE).mean())


@pytest.mark.parametrize("strength", [1.0, 3.0])
def test_levels_are_as_bright_as_the_lit_leaves(strength: float, tmp_path: Path) -> None:
    """Check both sides: level 0 within 2%, level 1 within 5%, because texels enlarge the leaves' edges."""
    obj = field(matt())
    world(SKY)
    lamp = sun(strength * math.pi, 0.5)
    result = baked(obj)
    for behind in (False, True):
        expected = seen([obj], tmp_path, behind=behind)
        lamp.hide_render = True
        leaves, cloud = (seen([level.object], tmp_path, behind=behind) for level in result.levels)
        lamp.hide_render = False
        assert leaves == pytest.approx(expected, rel=0.02)
        assert cloud == pytest.approx(expected, rel=0.05)
    assert expected < 0.5 * seen([obj], tmp_path, behind=False), "the sides differ"


def test_levels_match_leaves_that_shade_each_other(tmp_path: Path) -> None:
    """Two layers with a color attribute. The sun reaches part of the lower layer. The tolerance is 5%."""
    material = matt()
    tree = material.node_tree
    attribute, product = tree.nodes.new("ShaderNodeVertexColor"), tree.nodes.new("ShaderNodeMix")
    attribute.layer_name, product.data_type, product.blend_type = "tint", "RGBA", "MULTIPLY"
    factor, first, second = (
        next(socket for socket in product.inputs if socket.identifier == name)
        for name in ("Factor_Float", "A_Color", "B_Color")
    )
    factor.default_value, first.default_value = 1.0, (*GREEN, 1.0)
    tree.links.new(attribute.outputs["Color"], second)
    result = next(socket for socket in product.outputs if socket.identifier == "Result_Color")
    tree.links.new(result, next(n for n in tree.nodes if n.type == "BSDF_PRINCIPLED").inputs["Base Color"])
    obj = field(material, 2)
    half = np.tile(np.array((0.5, 0.5, 0.5, 1.0), np.float32), len(obj.data.loops))
    obj.data.color_attributes.new("tint", "FLOAT_COLOR", "CORNER").data.foreach_set("color", half)
    world((0.5, 0.5, 0.5))
    sun(math.pi, 0.6)
    baked_tree = baked(obj)
    for behind in (False, True):
        expected = seen([obj], tmp_path, behind=behind)
        leaves, cloud = (seen([level.object], tmp_path, behind=behind) for level in baked_tree.levels)
        assert leaves == pytest.approx(expected, rel=0.05)
        assert cloud == pytest.approx(expected, rel=0.05)


# Files


def textured() -> bpy.types.Material:
    """Return a material with a cutout image and a normal map. Unlit materials have no use for the normal map."""
    material = matt((1.0, 1.0, 1.0))
    tree = material.node_tree
    principled = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
    image = texture_node(tree, new_image("i", [[(0.2, 0.6, 0.1, 1.0), (0.2, 0.6, 0.1, 0.0)]]))
    tree.links.new(image.outputs["Color"], principled.inputs["Base Color"])
    tree.links.new(math_node(tree, "GREATER_THAN", image.outputs["Alpha"], 0.4), principled.inputs["Alpha"])
    normal = tree.nodes.new("ShaderNodeNormalMap")
    tree.links.new(texture_node(tree, new_image("n", [[(0.5, 0.5, 1.0, 1.0)]])).outputs[0], normal.inputs["Color"])
    tree.links.new(normal.outputs[0], principled.inputs["Normal"])
    return material


def documents(result: Baked, folder: Path) -> list[tuple[dict[str, Any], bytes]]:
    with mean_light(result.levels):
        for level in result.levels:
            export_level(level, folder / f"{level.number}.glb")
    files = [Glb.read(folder / f"{level.number}.glb") for level in result.levels]
    return [(glb.document, bytes(glb.binary)) for glb in files]


def values(document: dict[str, Any], binary: bytes, number: int) -> np.ndarray:
    """Return the values of an accessor, normalized if the accessor says so."""
    accessor = document["accessors"][number]
    view = document["bufferViews"][accessor["bufferView"]]
    kind = {5121: np.uint8, 5123: np.uint16, 5126: np.float32}[accessor["componentType"]]
    width = {"VEC3": 3, "VEC4": 4}[accessor["type"]]
    found = np.frombuffer(binary, kind, width * accessor["count"], view.get("byteOffset", 0)).reshape(-1, width)
    return found / np.iinfo(kind).max if accessor.get("normalized") else found


def test_gltf_files_with_baked_light_are_unlit(
    tmp_path: Path, gltf_issues: Callable[..., list[dict[str, Any]]]
) -> None:
    """Level 0 stores the mean light of both sides over the strength. Billboards are cut out, with a light per side."""
    obj = square("leaves", 0.0, 2.0, textured())
    world(SKY)
    sun(3.0 * math.pi, 0.0)
    result = baked(obj, square("bark", 0.5, 0.1))
    (leaves, binary), (cloud, _) = documents(result, tmp_path)
    lit_leaf = next(material for material in leaves["materials"] if "KHR_materials_unlit" in material["extensions"])
    bark = next(material for material in leaves["materials"] if material is not lit_leaf)
    assert "KHR_materials_unlit" not in bark.get("extensions", {}), "the trunk is lit as before"
    assert lit_leaf["extensions"] == {"KHR_materials_unlit": {}}
    assert (lit_leaf["alphaMode"], lit_leaf["alphaCutoff"]) == ("MASK", pytest.approx(0.4))
    assert "baseColorTexture" in lit_leaf["pbrMetallicRoughness"]
    assert not {"normalTexture", "emissiveFactor", "emissiveTexture"} & {*lit_leaf}
    strength = result.prepared.light.strength if result.prepared.light else 0.0
    assert strength == pytest.approx(3.0 + SKY[2], rel=0.01)
    [primitive] = [
        each
        for mesh in leaves["meshes"]
        for each in mesh["primitives"]
        if leaves["materials"][each["material"]] is lit_leaf
    ]
    assert [name for name in primitive["attributes"] if name.startswith("COLOR")] == ["COLOR_0"]
    colors = values(leaves, binary, primitive["attributes"]["COLOR_0"])
    # The trunk above slightly shades the middle of one of the two triangles.
    assert colors[:, :3].max(axis=0) == pytest.approx((np.array(SKY) + 1.5) / strength, rel=0.01)
    assert len(leaves["images"]) == 1, "nothing asks for the normal map"
    material = next(material for material in cloud["materials"] if material["name"] == "tree_LOD1")
    assert material["extensions"] == {"KHR_materials_unlit": {}}
    assert (material["alphaMode"], material.get("doubleSided", False)) == ("MASK", False)
    assert material["alphaCutoff"] == pytest.approx(result.chain.levels[0].alpha_cutoff)
    assert set(material["pbrMetallicRoughness"]) >= {"baseColorTexture"}
    for said in (material, lit_leaf):
        assert said["extras"]["leafcloud"]["light_strength"] == pytest.approx(strength)
    for document in (leaves, cloud):
        assert document["extensionsUsed"].count("KHR_materials_unlit") == 1
    assert gltf_issues(tmp_path / "0.glb", tmp_path / "1.glb") == []
    names = {attribute.name for attribute in result.levels[0].object.data.color_attributes}
    assert names == {"leafcloud_light", "leafcloud_light_back"}


def test_the_source_materials_stay_unchanged(tmp_path: Path) -> None:
    material = textured()
    before = [(node.name, node.bl_idname) for node in material.node_tree.nodes]
    obj = square("leaves", 0.0, 2.0, material)
    world(SKY)
    result = baked(obj, levels=2, cross=True)
    assert [(node.name, node.bl_idname) for node in material.node_tree.nodes] == before
    assert obj.data.materials[0] == material
    [copy] = result.levels[0].object.data.materials
    assert copy != material
    assert copy.node_tree.get_output_node("CYCLES").target == "CYCLES"
    assert all(level.two_sided for level in result.chain.levels)
    assert [level.object.data.materials[0].use_backface_culling for level in result.levels[1:]] == [True] * 3


def test_the_cross_impostor_shows_the_lit_trunk() -> None:
    """Only the cross impostor shows the trunk, so only its bake needs the light on the trunk."""
    world(SKY)
    result = baked(square("leaves", 0.0), square("bark", 0.5, 0.1), cross=True)
    assert result.prepared.light is not None
    assert result.prepared.light.trunk is not None
    np.testing.assert_allclose(result.prepared.light.trunk.front, np.broadcast_to(SKY, (2, 3, 3)), rtol=1e-4)
    bpy.data.objects["tree_LOD0"].hide_render = True


def test_the_report_has_the_cost_of_baked_light() -> None:
    world(SKY)
    result = baked(field(matt()))
    said = next(each for each in report(result, [0.0, 0.0], [], GpuLoad())["effects"] if each["name"] == "baked_light")
    assert said["on"]
    assert said["reason"] == "asked for by `effects=baked_light`"
    assert said["seconds"] > 0.0
    assert said["bytes"] == 32 * 3 * 3 * 4 * 2


def test_the_command_line_bakes_the_light_of_a_file(tmp_path: Path) -> None:
    """The bake reads the lights before it clears the scene, which may remove the leaves' own materials."""
    obj = field(matt())
    sun(math.pi, 0.0)
    source = tmp_path / "tree.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(source))
    quick = ("--texture-size", 64, "--quality", 0.1, "--levels", 1, "--no-cross", "--leaves", obj.name)
    said = bake_file(source, tmp_path / "out", *quick, "--effects", "baked_light")
    assert said["input"]["materials"] == ["m"]
    assert said["warnings"] == []
    document = Glb.read(tmp_path / "out" / "tree.glb").document
    assert [{*material["extensions"]} for material in document["materials"]] == [{"KHR_materials_unlit"}] * 2
