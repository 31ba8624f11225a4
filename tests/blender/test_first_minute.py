"""The first minute in the sidebar: the selection in words, the panels, their settings and presets."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import MagicMock

import bpy
import pytest

import addon.ui as interface
from addon.ui.properties import _SHOWN, PRESET_SETTINGS, bake_settings
from addon.ui.selected_tree import leaves_problem, selection_words

pytestmark = pytest.mark.usefixtures("registered")

MAIN = ("engine", "quality")
"""Settings of the first panel without an engine."""
OF_CURVE = ("seconds", "image_error")
"""Settings beside the cost curve."""


def leaves(count: int, name: str) -> bpy.types.Object:
    """Return a new selected object of `count` separate quads."""
    points = [(x + 2.0 * i, y, 0.0) for i in range(count) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(points, [], [[4 * i + k for k in range(4)] for i in range(count)])
    obj = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(obj)
    obj.select_set(True)
    bpy.context.view_layer.objects.active = obj
    return obj


def drawn(panel: type[bpy.types.Panel]) -> tuple[list[str], list[str]]:
    """Return the settings and the labels that a panel shows."""
    found: tuple[list[str], list[str]] = ([], [])
    layout = MagicMock()
    layout.prop.side_effect = lambda owner, name, **_: found[0].append(name)
    layout.label.side_effect = lambda text, **_: found[1].append(text)
    for part in ("column", "row", "box"):
        getattr(layout, part).return_value = layout
    panel.draw(SimpleNamespace(layout=layout, groups=getattr(panel, "groups", ())), bpy.context)
    return found


def panels() -> Sequence[type[bpy.types.Panel]]:
    return [cls for cls in interface._CLASSES if issubclass(cls, bpy.types.Panel)]


def test_the_first_panel_names_the_selected_tree_and_counts_its_leaves() -> None:
    assert selection_words(bpy.context) == ""
    leaves(20, "leaves")
    trunk = leaves(1, "bark")
    trunk.select_set(False)
    bpy.context.view_layer.objects.active = bpy.data.objects["leaves"]
    assert selection_words(bpy.context) == "leaves: 20 leaves"
    trunk.select_set(True)
    assert selection_words(bpy.context) == "leaves: 20 leaves, trunk"
    bpy.context.scene.leafcloud.leaves = "BARK"
    assert selection_words(bpy.context) == "leaves: 1 leaf, trunk"


def test_a_selection_that_takes_long_to_count_is_told_by_its_objects() -> None:
    leaves(20, "oak").modifiers.new("wave", "WAVE")
    assert selection_words(bpy.context) == "oak: 1 object"


def test_of_a_large_selection_the_faces_of_the_leaves_are_counted() -> None:
    assert not leaves(30_001, "oak").hide_render
    assert selection_words(bpy.context) == "oak: 1 object", "no name tells the leaves"
    bpy.context.scene.leafcloud.leaves = "oak"
    assert selection_words(bpy.context) == "oak: leaves of 30,001 faces"


def test_a_selection_without_leaves_says_so() -> None:
    leaves(1, "rock")
    assert selection_words(bpy.context) == "rock: no leaves found, name them in Levels"
    bpy.context.scene.leafcloud.leaves = "rok"
    assert selection_words(bpy.context) == "rock: no leaves of that name"


def test_a_renamed_material_is_seen_and_so_is_a_slot_of_the_object() -> None:
    rock = leaves(1, "rock")
    material = bpy.data.materials.new("stone")
    rock.data.materials.append(None)
    rock.material_slots[0].link = "OBJECT"
    rock.material_slots[0].material = material
    assert "no leaves" in selection_words(bpy.context)
    material.name = "Leaf"
    assert selection_words(bpy.context) == "rock: 1 leaf"


def test_an_empty_stands_for_the_tree_below_it() -> None:
    crown = leaves(20, "leaves")
    crown.select_set(False)
    root = bpy.data.objects.new("Oak", None)
    bpy.context.scene.collection.objects.link(root)
    crown.parent = root
    root.select_set(True)
    bpy.context.view_layer.objects.active = root
    settings = bpy.context.scene.leafcloud
    settings.texture_size, settings.levels, settings.epsilon, settings.quality = 64, 1, 0.2, 0.1
    assert selection_words(bpy.context) == "Oak: 20 leaves"
    assert bpy.ops.leafcloud.bake() == {"FINISHED"}
    assert "Oak_LOD1" in bpy.data.objects
    bpy.ops.object.select_all(action="DESELECT")
    root.select_set(True)
    bpy.context.view_layer.objects.active = root
    assert bpy.ops.leafcloud.bake() == {"FINISHED"}, "the hidden sources below it"


def test_the_first_panel_has_the_purpose_and_the_quality_alone() -> None:
    shown, words = drawn(interface.LEAFCLOUD_PT_bake)
    assert tuple(shown) == MAIN
    assert words == ["Select leaves and trunk of a tree", "Balanced: 1.0 × a light breeze"]


def test_an_engine_asks_for_a_folder() -> None:
    settings = bpy.context.scene.leafcloud
    settings.engine = "godot"
    shown, words = drawn(interface.LEAFCLOUD_PT_bake)
    assert shown == ["engine", "directory", "quality"]
    assert "Choose a folder for the engine's files" in words
    settings.directory = "//levels"
    assert "Choose a folder for the engine's files" not in drawn(interface.LEAFCLOUD_PT_bake)[1]


def test_every_setting_is_in_one_panel() -> None:
    groups = [name for panel in panels() for group in getattr(panel, "groups", ()) for name in group]
    assert len(groups) == len(set(groups))
    assert set(groups) == {*_SHOWN, "leaves", "directory"} - {*MAIN, *OF_CURVE}


def test_settings_of_pruning_are_shown_for_chains_that_prune() -> None:
    assert "prune_half" not in drawn(interface.LEAFCLOUD_PT_levels)[0]
    bpy.context.scene.leafcloud.chain = "both"
    assert "prune_half" in drawn(interface.LEAFCLOUD_PT_levels)[0]


def test_presets_are_found_and_set_the_quality() -> None:
    [folder] = [Path(path) for path in bpy.utils.preset_paths("leafcloud") if "addon" in path]
    presets = sorted(folder.glob("*.py"))
    assert [each.stem for each in presets] == ["Background", "Close_Up", "Game"]
    settings = bpy.context.scene.leafcloud
    found = {}
    for preset in presets:
        settings.epsilon, settings.leaves, settings.chain, settings.seconds = 0.1, "crown", "both", 5.0
        bpy.ops.script.execute_preset(filepath=str(preset), menu_idname="LEAFCLOUD_PT_presets")
        found[preset.stem] = round(settings.quality, 3)
        assert (settings.epsilon, settings.leaves, settings.chain) == (0.0, "crown", "billboards")
        bake_settings(settings)
    assert found == {"Background": 0.25, "Close_Up": 0.75, "Game": 0.5}


def test_a_saved_preset_holds_the_settings_of_any_tree() -> None:
    settings = bpy.context.scene.leafcloud
    assert all(hasattr(settings, name) for name in PRESET_SETTINGS)
    assert not {"leaves", "directory", "engine", "seed"} & set(PRESET_SETTINGS)
    values = interface.LEAFCLOUD_OT_preset_add.preset_values
    assert values == [f"settings.{name}" for name in PRESET_SETTINGS]


def test_what_has_no_leaves_is_not_baked() -> None:
    bpy.ops.mesh.primitive_cube_add()
    assert leaves_problem(bpy.context).startswith("No leaves are found in Cube: select a tree")
    with pytest.raises(RuntimeError, match="No leaves are found in Cube"):
        bpy.ops.leafcloud.bake()
    bpy.context.scene.leafcloud.leaves = "Cube"
    assert leaves_problem(bpy.context) == ""


def test_the_sample_stands_at_the_cursor() -> None:
    bpy.context.scene.cursor.location = (3.0, -2.0, 1.0)
    bpy.ops.leafcloud.sample()
    assert {tuple(obj.location) for obj in bpy.context.selected_objects} == {(3.0, -2.0, 1.0)}


def test_object_mode_is_asked_for_by_name() -> None:
    leaves(20, "leaves")
    bpy.ops.object.mode_set(mode="WEIGHT_PAINT")
    with pytest.raises(RuntimeError, match="Switch to Object Mode first"):
        bpy.ops.leafcloud.bake()


def test_the_sample_tree_is_ready_to_bake() -> None:
    assert bpy.ops.leafcloud.sample() == {"FINISHED"}
    assert selection_words(bpy.context).startswith("Shrub: ")
    assert "trunk" in selection_words(bpy.context)
    bpy.context.scene.leafcloud.texture_size = 64
    assert bpy.ops.leafcloud.bake() == {"FINISHED"}
