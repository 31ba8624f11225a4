"""Vertex groups of billboards, and the selection of a billboard's leaves."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest
from kept_scenes import open_scene

from addon.mesh.baked_levels import level_number

pytestmark = pytest.mark.usefixtures("registered")


@pytest.fixture
def leaves(registered: None, shrub: Path) -> bpy.types.Object:
    """Return the leaves of a baked tree."""
    open_scene("billboard leaves", lambda: bake(shrub))
    [found] = [obj for obj in bpy.data.collections["leaves"].objects if level_number(obj) == 0]
    bpy.context.view_layer.objects.active = found
    return found


def bake(shrub: Path) -> None:
    bpy.ops.import_scene.gltf(filepath=str(shrub))
    bpy.ops.object.select_all(action="SELECT")
    bpy.context.view_layer.objects.active = bpy.data.objects["leaves"]
    settings = bpy.context.scene.leafcloud
    settings.texture_size, settings.levels, settings.epsilon, settings.every_level = 64, 1, 0.2, True
    settings.quality = 0.1
    assert bpy.ops.leafcloud.bake() == {"FINISHED"}


def billboards(obj: bpy.types.Object) -> np.ndarray:
    numbers = np.empty(len(obj.data.vertices), np.int32)
    obj.data.attributes["leaf_billboard"].data.foreach_get("value", numbers)
    return numbers


def test_a_selected_leaf_selects_its_billboard(leaves: bpy.types.Object) -> None:
    numbers = billboards(leaves)
    wanted = np.unique(numbers)[1]
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="DESELECT")
    bpy.ops.object.mode_set(mode="OBJECT")
    leaves.data.vertices[int(np.flatnonzero(numbers == wanted)[0])].select = True
    assert bpy.ops.leafcloud.select_billboard() == {"FINISHED"}
    bpy.ops.object.mode_set(mode="OBJECT")
    selected = np.array([vertex.select for vertex in leaves.data.vertices])
    np.testing.assert_array_equal(selected, numbers == wanted)


def test_no_selection_is_told(leaves: bpy.types.Object) -> None:
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="DESELECT")
    assert bpy.ops.leafcloud.select_billboard() == {"CANCELLED"}


def test_only_the_level_is_edited(leaves: bpy.types.Object) -> None:
    """After a bake all levels are selected. Edit Mode would open all of them."""
    bpy.context.view_layer.objects.active = leaves.parent
    bpy.ops.leafcloud.select_billboard()
    assert bpy.context.objects_in_mode == [leaves]


def test_a_hidden_level_is_refused(leaves: bpy.types.Object) -> None:
    bpy.ops.leafcloud.show_level(level=1)
    assert not bpy.ops.leafcloud.select_billboard.poll()


def test_a_trunk_has_no_billboards(leaves: bpy.types.Object) -> None:
    bpy.context.view_layer.objects.active = leaves.children[0]
    bpy.ops.object.mode_set(mode="EDIT")
    assert not bpy.ops.leafcloud.select_billboard.poll()


def test_the_groups_are_locked(leaves: bpy.types.Object) -> None:
    assert len(leaves.vertex_groups) == billboards(leaves).max() + 1
    assert all(group.lock_weight for group in leaves.vertex_groups)


def test_a_preference_leaves_the_groups_out(leaves: bpy.types.Object, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("addon.ui.operators.preference", lambda name: name != "vertex_groups")
    assert bpy.ops.leafcloud.bake() == {"FINISHED"}
    again = [obj for obj in bpy.data.collections["leaves"].objects if obj.type == "MESH"]
    assert not any(obj.vertex_groups for obj in again)
    assert all("leaf_billboard" in obj.data.attributes for obj in again if level_number(obj) == 0)
