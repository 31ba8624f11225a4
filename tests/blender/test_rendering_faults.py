"""Scene settings that darken or hide plants are found and corrected."""

from __future__ import annotations

import bpy
import pytest
from mathutils import Vector
from node_trees import new_material

from addon.scene.rendering import BOUNCES, allow_bounces, faults, lens_fault

pytestmark = pytest.mark.version

PLACE, RADIUS = Vector((0.0, 0.0, 0.0)), 2.0


@pytest.fixture
def scene() -> bpy.types.Scene:
    """An empty scene for Cycles, as Blender makes it."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    found = bpy.context.scene
    found.render.engine = "CYCLES"
    return found


def texts(scene: bpy.types.Scene, *materials: bpy.types.Material | None) -> list[str]:
    return [fault.text for fault in faults(scene, PLACE, RADIUS, materials)]


def mended(scene: bpy.types.Scene, *materials: bpy.types.Material) -> list[str]:
    for fault in faults(scene, PLACE, RADIUS, materials):
        fault.mend()
    return texts(scene, *materials)


def test_blenders_default_bounces_are_too_few(scene: bpy.types.Scene) -> None:
    [text] = texts(scene)
    assert text.startswith("Light Paths › Transparent is 8")
    assert mended(scene) == []
    assert scene.cycles.transparent_max_bounces == BOUNCES


def test_more_bounces_stay(scene: bpy.types.Scene) -> None:
    scene.cycles.transparent_max_bounces = 256
    allow_bounces(scene)
    assert scene.cycles.transparent_max_bounces == 256
    assert texts(scene) == []


def test_other_renderers_have_no_bounces(scene: bpy.types.Scene) -> None:
    scene.render.engine = "BLENDER_WORKBENCH"
    assert texts(scene) == []


def test_a_tree_behind_the_clip_end_is_told(scene: bpy.types.Scene) -> None:
    allow_bounces(scene)
    scene.camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(scene.camera)
    scene.camera.location.y = -99.0
    bpy.context.view_layer.update()
    scene.camera.data.clip_end = 101.5
    assert texts(scene) == []
    scene.camera.data.clip_end = 100.0
    assert texts(scene) == ["The camera's Clip End is 100, the tree ends at 101"]
    assert mended(scene) == []


def test_cards_that_cast_whole_shadows_are_told_once(scene: bpy.types.Scene) -> None:
    allow_bounces(scene)
    leaves, principled, _ = new_material()
    leaves.name, principled.inputs["Alpha"].default_value = "leaves", 0.5
    assert texts(scene, leaves, None) == []
    bark, *_ = new_material()
    leaves.use_transparent_shadow = bark.use_transparent_shadow = False
    assert texts(scene, bark) == []
    [text] = texts(scene, leaves, leaves)
    assert text.startswith("Transparent Shadows is off in leaves")
    assert mended(scene, leaves) == []


def test_a_longer_lens_than_the_bakes_is_told(scene: bpy.types.Scene) -> None:
    root = bpy.data.objects.new("root", None)
    root["LOD Distance"] = 1.0
    assert lens_fault(root, 1.05) == []
    [fault] = lens_fault(root, 2.0)
    assert "2.0 × larger" in fault.text
    fault.mend()
    assert root["LOD Distance"] == 2.0
    assert lens_fault(root, 2.0) == []
    [again] = lens_fault(root, 5.0)
    assert "2.5 × larger" in again.text


def test_an_artists_own_lod_distance_stays(scene: bpy.types.Scene) -> None:
    root = bpy.data.objects.new("root", None)
    root["LOD Distance"] = 0.5
    assert lens_fault(root, 2.0) == []
