"""Labels of levels: one for each tree, with the level that is drawn at its distance."""

from __future__ import annotations

from pathlib import Path

import bpy
import pytest
from kept_scenes import open_scene
from mathutils import Vector

from addon.levels.shown import show_level
from addon.mesh.baked_levels import level_number
from addon.viewport.labels import MOST, centre_of, length_words, levels_in, seen_from

pytestmark = pytest.mark.usefixtures("registered")


@pytest.fixture
def levels(registered: None, shrub: Path) -> list[bpy.types.Object]:
    """Return the levels of a tree. Level 1 takes over at 128 radii, level 2 at 160, the cross at 200."""
    open_scene("level labels", lambda: bake(shrub))
    found = [obj for obj in bpy.data.collections["leaves"].objects if level_number(obj) is not None]
    return sorted(found, key=lambda obj: obj.name)


def bake(shrub: Path) -> None:
    bpy.ops.import_scene.gltf(filepath=str(shrub))
    bpy.ops.object.select_all(action="SELECT")
    bpy.context.view_layer.objects.active = bpy.data.objects["leaves"]
    settings = bpy.context.scene.leafcloud
    settings.texture_size, settings.levels, settings.epsilon, settings.pixels = 64, 2, 0.1, 8.0
    settings.last, settings.every_level = "cross", True
    assert bpy.ops.leafcloud.bake() == {"FINISHED"}


def eye_at(levels: list[bpy.types.Object], radii: float) -> Vector:
    return centre_of(levels[0]) + Vector((radii * levels[0]["leafcloud"]["radius"], 0.0, 0.0))


@pytest.mark.parametrize(("radii", "number"), [(1.0, 0), (120.0, 0), (145.0, 1), (180.0, 2), (300.0, 3)])
def test_each_tree_has_the_label_of_its_level(levels: list[bpy.types.Object], radii: float, number: int) -> None:
    eye = eye_at(levels, radii)
    [label] = seen_from(eye, levels)
    level = levels[number]
    parts = [level.data, *(child.data for child in level.children)]
    triangles = sum(len(mesh.loops) - 2 * len(mesh.polygons) for mesh in parts)
    distance = (centre_of(level) - eye).length
    name = "leaves" if number == 0 else f"level {number}"
    assert label.text == f"{name}   {length_words(distance)}   {triangles:,} triangles"
    assert label.place.z == pytest.approx(centre_of(level).z + levels[0]["leafcloud"]["radius"])


def test_lengths_are_in_the_units_of_the_scene() -> None:
    assert [length_words(length) for length in (0.5, 12.34, 2345.6)] == ["50 cm", "12.3 m", "2.35 km"]
    bpy.context.scene.unit_settings.system = "IMPERIAL"
    assert length_words(3.048) == "10'"
    bpy.context.scene.unit_settings.system = "NONE"
    assert length_words(2345.6) == "2,345.6"


def test_a_mirrored_tree_has_its_label_above_it(levels: list[bpy.types.Object]) -> None:
    levels[0].parent.scale = (-1.0, -1.0, -1.0)
    bpy.context.view_layer.update()
    [label] = seen_from(eye_at(levels, 1.0), levels)
    assert label.place.z > (levels[0].matrix_world @ centre_of(levels[0])).z


def test_the_label_follows_the_lod_distance(levels: list[bpy.types.Object]) -> None:
    levels[0].parent["LOD Distance"] = 10.0
    levels[0].parent.update_tag()
    bpy.context.view_layer.update()
    [label] = seen_from(eye_at(levels, 300.0), levels)
    assert label.text.startswith("leaves")


def test_a_fade_has_one_label(levels: list[bpy.types.Object]) -> None:
    for radii in range(1, 320):
        assert len(seen_from(eye_at(levels, float(radii)), levels)) == 1, radii


def test_the_nearest_trees_have_labels(levels: list[bpy.types.Object]) -> None:
    copies = []
    for number in range(MOST + 5):
        copy = levels[0].copy()
        copy.location.y = 0.1 * number
        bpy.context.scene.collection.objects.link(copy)
        copies.append(copy)
    bpy.context.view_layer.update()
    found = seen_from(eye_at(levels, 1.0), copies)
    assert len(found) == MOST
    distances = [label.distance for label in found]
    assert distances == sorted(distances, reverse=True)
    assert max(distances) < (centre_of(copies[MOST]) + copies[MOST].location - eye_at(levels, 1.0)).length


def test_deleted_levels_have_no_label(levels: list[bpy.types.Object]) -> None:
    for level in levels:
        bpy.data.objects.remove(level)
    assert seen_from(Vector((1.0, 0.0, 0.0)), levels) == []


def test_a_level_that_is_shown_at_all_distances_has_the_label(levels: list[bpy.types.Object]) -> None:
    show_level(bpy.data.collections["leaves"], 2, bpy.context.view_layer)
    shown = [level for level in levels_in(bpy.context.scene) if level.visible_get()]
    [label] = seen_from(eye_at(levels, 1.0), shown)
    assert label.text.startswith("level 2")
