"""A folder of trees in the interface: imported side by side, baked together, with a table of the results."""

from __future__ import annotations

import itertools
import shutil
from pathlib import Path

import bpy
import pytest

import addon.ui as interface
from addon.levels.results import results_of
from addon.ui.trees_panel import baked_trees

pytestmark = pytest.mark.usefixtures("registered")


@pytest.fixture
def folder(tmp_path: Path, shrub: Path) -> Path:
    for name in ("ash.glb", "oak.GLB"):
        shutil.copy(shrub, tmp_path / name)
    (tmp_path / "broken.glb").write_bytes(b"glTF and no more")
    (tmp_path / "notes.txt").write_text("no tree")
    (tmp_path / "folder.glb").mkdir()
    return tmp_path


def widths(name: str) -> tuple[float, float]:
    """Return the least and the greatest x of a collection's meshes."""
    objects = [obj for obj in bpy.data.collections[name].objects if obj.type == "MESH"]
    places = [(obj.matrix_world @ vertex.co).x for obj in objects for vertex in obj.data.vertices]
    return min(places), max(places)


def test_each_file_is_a_tree_beside_the_others(folder: Path) -> None:
    assert bpy.ops.leafcloud.import_folder(directory=str(folder)) == {"FINISHED"}
    scene = bpy.context.scene
    assert [collection.name for collection in scene.collection.children] == ["ash", "oak"]
    for collection in scene.collection.children:
        kinds = [obj.name.split(".")[0] for obj in collection.objects]
        assert {"leaves", "branches"} <= set(kinds)
    bpy.context.view_layer.update()
    assert widths("ash")[1] < widths("oak")[0]
    assert {obj.name for obj in bpy.context.selected_objects} == {obj.name for obj in scene.objects}
    assert not [collection for collection in bpy.data.collections if collection.name.startswith("broken")]


def test_all_are_baked_at_once_and_the_table_has_a_row_for_each(folder: Path) -> None:
    bpy.ops.leafcloud.import_folder(directory=str(folder))
    settings = bpy.context.scene.leafcloud
    settings.texture_size, settings.levels, settings.epsilon, settings.quality = 64, 1, 0.2, 0.1
    assert bpy.ops.leafcloud.bake() == {"FINISHED"}
    trees = list(baked_trees(bpy.context.scene))
    assert [tree.name for tree in trees] == ["ash_2", "oak_2"]
    assert all(len(results_of(tree)) >= 2 for tree in trees)
    assert interface.LEAFCLOUD_PT_trees.poll(bpy.context)


def test_a_second_folder_stands_beside_the_first(folder: Path) -> None:
    for _ in range(2):
        bpy.ops.leafcloud.import_folder(directory=str(folder))
    bpy.context.view_layer.update()
    places = [widths(name) for name in ("ash", "oak", "ash.001", "oak.001")]
    assert all(left[1] < right[0] for left, right in itertools.pairwise(places))


def test_a_baked_tree_is_imported_with_its_leaves_alone_and_other_data_stays(tmp_path: Path, shrub: Path) -> None:
    bpy.ops.import_scene.gltf(filepath=str(shrub))
    bpy.ops.object.select_all(action="SELECT")
    settings = bpy.context.scene.leafcloud
    settings.texture_size, settings.levels, settings.epsilon, settings.quality = 64, 1, 0.2, 0.1
    settings.directory = str(tmp_path / "baked")
    assert bpy.ops.leafcloud.bake() == {"FINISHED"}
    (tmp_path / "folder").mkdir()
    shutil.copy(tmp_path / "baked" / "leaves.glb", tmp_path / "folder" / "again.glb")
    bpy.data.meshes.new("unused")
    assert bpy.ops.leafcloud.import_folder(directory=str(tmp_path / "folder")) == {"FINISHED"}
    assert "unused" in bpy.data.meshes
    meshes = [obj for obj in bpy.data.collections["again"].objects if obj.type == "MESH"]
    assert len(meshes) == 1, "level 0 with its trunk"


def test_a_file_without_a_mesh_leaves_nothing_behind(tmp_path: Path) -> None:
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("alone", None))
    bpy.ops.export_scene.gltf(filepath=str(tmp_path / "empty.glb"))
    bpy.data.objects.remove(bpy.data.objects["alone"])
    before = len(bpy.data.objects), len(bpy.data.collections)
    with pytest.raises(RuntimeError, match=r"no file in .* can be read"):
        bpy.ops.leafcloud.import_folder(directory=str(tmp_path))
    assert (len(bpy.data.objects), len(bpy.data.collections)) == before


def test_a_folder_without_trees_is_refused_with_the_remedy(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError, match=r"has no \.glb, \.gltf, \.obj, .* file: choose a folder with trees"):
        bpy.ops.leafcloud.import_folder(directory=str(tmp_path))
    with pytest.raises(RuntimeError, match="cannot be read: No such file or directory; choose another folder"):
        bpy.ops.leafcloud.import_folder(directory=str(tmp_path / "missing"))


def test_a_folder_of_broken_files_changes_nothing(tmp_path: Path) -> None:
    (tmp_path / "broken.obj").write_text("v nan 0 0\n")
    before = len(bpy.data.objects), len(bpy.data.collections)
    with pytest.raises(RuntimeError, match=r"no file in .* can be read: export them again"):
        bpy.ops.leafcloud.import_folder(directory=str(tmp_path))
    assert (len(bpy.data.objects), len(bpy.data.collections)) == before
