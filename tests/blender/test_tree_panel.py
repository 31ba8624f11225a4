"""The panel of a baked tree: the level that is shown, figures that stay in the file, and removal."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import MagicMock

import bpy
import numpy as np
import pytest
from kept_scenes import open_scene

import addon.ui as interface
from addon.levels.results import LevelResult, keep_warnings, results_of
from addon.levels.shown import shown_level
from addon.mesh.baked_levels import level_number
from addon.ui.framing import crown_of, picture_share
from addon.ui.tree_panel import active_tree, figures_of

pytestmark = [pytest.mark.usefixtures("registered"), pytest.mark.version]

KINDS = ("objects", "meshes", "materials", "images", "collections")


@pytest.fixture
def before(registered: None, shrub: Path) -> dict[str, set[str]]:
    """Open a scene with the baked shrub; return the names of all data-blocks before the bake."""
    return open_scene("tree panel", lambda: bake(shrub))


def bake(shrub: Path) -> dict[str, set[str]]:
    bpy.ops.import_scene.gltf(filepath=str(shrub))
    bpy.ops.object.select_all(action="SELECT")
    bpy.context.view_layer.objects.active = bpy.data.objects["leaves"]
    kept = names()
    settings = bpy.context.scene.leafcloud
    settings.texture_size, settings.levels, settings.epsilon, settings.every_level = 128, 1, 0.1, True
    settings.quality = 0.1
    assert bpy.ops.leafcloud.bake() == {"FINISHED"}
    return kept


def names() -> dict[str, set[str]]:
    return {kind: {block.name for block in getattr(bpy.data, kind)} for kind in KINDS}


def tree() -> bpy.types.Collection:
    found = active_tree(bpy.context)
    assert found is not None
    return found


def drawn() -> set[str]:
    """Return the levels and trunks of the tree that have visible polygons."""
    bpy.context.view_layer.update()
    graph = bpy.context.evaluated_depsgraph_get()
    meshes = [obj for obj in tree().objects if obj.type == "MESH" and obj.visible_get()]
    return {obj.name for obj in meshes if len(obj.evaluated_get(graph).data.polygons)}


@pytest.mark.usefixtures("before")
def test_one_level_is_shown_at_all_distances_and_auto_goes_back() -> None:
    by_distance = drawn()
    for number in (1, 2, 0):
        assert bpy.ops.leafcloud.show_level(level=number) == {"FINISHED"}
        assert shown_level(tree()) == number
        assert {name for name in drawn() if "trunk" not in name} == {f"leaves_LOD{number}"}
    assert bpy.ops.leafcloud.show_level(level=-1) == {"FINISHED"}
    assert shown_level(tree()) is None
    assert drawn() == by_distance
    assert not any("leafcloud_hidden" in obj for obj in tree().objects)


@pytest.mark.usefixtures("before")
def test_levels_that_the_camera_never_sees_stay_hidden_after_auto() -> None:
    hidden = next(obj for obj in tree().objects if level_number(obj) == 1)
    hidden.hide_viewport = hidden.hide_render = True
    bpy.ops.leafcloud.show_level(level=1)
    assert not hidden.hide_viewport
    bpy.ops.leafcloud.show_level(level=-1)
    assert hidden.hide_viewport
    assert hidden.hide_render


@pytest.mark.usefixtures("before")
def test_a_level_that_does_not_exist_is_refused() -> None:
    with pytest.raises(RuntimeError, match="leaves has no level 7; it has the levels 0 to 2"):
        bpy.ops.leafcloud.show_level(level=7)


@pytest.mark.usefixtures("before")
def test_the_sources_are_shown_in_place_of_all_levels_and_hidden_again() -> None:
    by_distance, own = drawn(), tree()
    leaves = bpy.data.objects["leaves"]
    assert not leaves.visible_get()
    assert bpy.ops.leafcloud.show_level(level=-2) == {"FINISHED"}
    assert (shown_level(own), drawn()) == (-2, set())
    assert leaves.visible_get()
    assert not leaves.hide_render
    assert bpy.ops.leafcloud.show_level(level=-1) == {"FINISHED"}
    assert (leaves.visible_get(), leaves.hide_render, drawn()) == (False, True, by_distance)


@pytest.mark.usefixtures("before")
def test_a_source_that_is_shown_belongs_to_its_tree() -> None:
    own = tree()
    bpy.ops.leafcloud.show_level(level=-2)
    bpy.ops.object.select_all(action="DESELECT")
    leaves = bpy.data.objects["leaves"]
    leaves.select_set(True)
    bpy.context.view_layer.objects.active = leaves
    assert active_tree(bpy.context) == own


def test_the_shadow_proxy_is_hidden_beside_the_sources(registered: None, shrub: Path) -> None:
    bpy.ops.import_scene.gltf(filepath=str(shrub))
    bpy.ops.object.select_all(action="SELECT")
    settings = bpy.context.scene.leafcloud
    settings.texture_size, settings.levels, settings.epsilon, settings.effect_shadow_proxy = 64, 1, 0.2, "ON"
    settings.quality = 0.1
    assert bpy.ops.leafcloud.bake() == {"FINISHED"}
    [proxy] = [obj for obj in tree().objects if obj.name.endswith("_shadow")]
    for number, hidden in ((1, False), (-2, True), (0, False), (-1, False)):
        bpy.ops.leafcloud.show_level(level=number)
        assert proxy.hide_render == hidden, number


@pytest.mark.usefixtures("before")
def test_sources_that_are_gone_are_refused_and_do_not_block_the_way_back() -> None:
    bpy.ops.leafcloud.show_level(level=-2)
    for name in ("leaves", "branches"):
        bpy.data.objects.remove(bpy.data.objects[name])
    assert bpy.ops.leafcloud.show_level(level=-1) == {"FINISHED"}
    with pytest.raises(RuntimeError, match="lacks the objects that 'leaves' was made from, 'branches', 'leaves'"):
        bpy.ops.leafcloud.show_level(level=-2)


@pytest.mark.usefixtures("before")
def test_the_panel_stays_when_the_active_level_is_hidden() -> None:
    [level] = [obj for obj in tree().objects if level_number(obj) == 0]
    bpy.ops.object.select_all(action="DESELECT")
    level.select_set(True)
    bpy.context.view_layer.objects.active = level
    bpy.ops.leafcloud.show_level(level=1)
    assert active_tree(bpy.context) is not None


@pytest.mark.usefixtures("before")
def test_each_level_has_a_picture_that_is_saved_with_the_file(tmp_path: Path) -> None:
    colors: dict[int | None, np.ndarray] = {}

    def alphas() -> dict[int | None, np.ndarray]:
        levels = [obj for obj in bpy.data.collections["leaves"].objects if level_number(obj) is not None]
        found = {}
        for obj in levels:
            assert tuple(obj.preview.image_size) == (128, 128)
            pixels = np.array(obj.preview.image_pixels_float[:]).reshape(128, 128, 4)
            assert (pixels[..., :3] <= pixels[..., 3:] + 0.005).all(), "Blender draws previews with premultiplied alpha"
            found[level_number(obj)] = pixels[..., 3]
            colors[level_number(obj)] = pixels[..., 1] - pixels[..., 0]
        return found

    pictures = alphas()
    assert sorted(pictures) == [0, 1, 2]
    for alpha in pictures.values():
        assert 0.02 < alpha.mean() < 0.9
    brown, green = (np.argwhere(part).mean(axis=0)[0] for part in (colors[0] < -0.02, colors[0] > 0.02))
    assert brown < green - 5.0, "the trunk is below the leaves: Blender's rows go from bottom to top"
    assert np.abs(pictures[2] - pictures[0]).mean() < 0.1, "the impostor beside the tree with its trunk"
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "tree.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "tree.blend"))
    assert all(np.abs(alpha - pictures[number]).max() < 0.01 for number, alpha in alphas().items())


@pytest.mark.usefixtures("before")
def test_a_tree_is_exported_for_an_engine_and_its_scene_stays(tmp_path: Path) -> None:
    settings, own = bpy.context.scene.leafcloud, tree()
    settings.trees = "collections"
    bpy.ops.leafcloud.show_level(level=1)
    kept, selected = names(), {obj.name for obj in bpy.context.selected_objects}
    assert bpy.ops.leafcloud.export(engine="three", directory=str(tmp_path)) == {"FINISHED"}
    assert b"KHR_texture_basisu" in (tmp_path / "leaves.glb").read_bytes(), "three.js reads KTX2"
    assert {path.name for path in tmp_path.iterdir()} == {"leaves.glb", "preview.png", "report.html", "report.json"}
    assert (settings.engine, settings.directory) == ("generic", ""), "the settings of later bakes stay"
    assert (tree(), shown_level(own), names()) == (own, 1, kept)
    assert {obj.name for obj in bpy.context.selected_objects} == selected
    assert not bpy.data.objects["leaves"].visible_get()


@pytest.mark.usefixtures("before")
def test_an_export_that_fails_changes_nothing(tmp_path: Path) -> None:
    kept = names()
    (tmp_path / "file").write_text("no folder")
    with pytest.raises(RuntimeError, match="is not a folder: choose another"):
        bpy.ops.leafcloud.export(engine="unity", directory=str(tmp_path / "file"))
    assert names() == kept


@pytest.mark.usefixtures("before")
def test_an_export_without_a_folder_is_refused() -> None:
    with pytest.raises(RuntimeError, match="no folder is chosen"):
        bpy.ops.leafcloud.export(engine="three", directory="")


@pytest.mark.usefixtures("before")
def test_a_table_has_all_baked_trees() -> None:
    assert not interface.LEAFCLOUD_PT_trees.poll(bpy.context), "one tree has its own panel"
    bpy.ops.leafcloud.show_level(level=-2)
    copies = [bpy.data.objects[name].copy() for name in ("leaves", "branches")]
    bpy.ops.object.select_all(action="DESELECT")
    for obj in copies:
        bpy.context.scene.collection.objects.link(obj)
        obj.select_set(True)
    bpy.context.view_layer.objects.active = copies[0]
    assert bpy.ops.leafcloud.bake() == {"FINISHED"}
    assert interface.LEAFCLOUD_PT_trees.poll(bpy.context)
    layout = MagicMock()
    layout.grid_flow.return_value = layout
    interface.LEAFCLOUD_PT_trees.draw(SimpleNamespace(layout=layout), bpy.context)
    assert [call.kwargs["text"] for call in layout.operator.call_args_list] == ["leaves", "leaves.001"]
    cells = [call.kwargs["text"] for call in layout.label.call_args_list]
    results = results_of(bpy.data.collections["leaves"])
    assert cells[4:6] == [f"{results[0].triangles:,}", f"{results[-1].triangles:,}"]
    assert bpy.ops.leafcloud.select_tree(tree="leaves") == {"FINISHED"}
    assert tree().name == "leaves"


@pytest.mark.usefixtures("before")
def test_the_figures_of_each_level_are_saved_with_the_file(tmp_path: Path) -> None:
    results = results_of(tree())
    assert [each.name for each in results] == ["Leaves", "Level 1", "Cross impostor"]
    levels = {level_number(obj): obj for obj in tree().objects if level_number(obj) is not None}
    for number, result in enumerate(results):
        parts = [levels[number], *levels[number].children]
        assert result.triangles == sum(len(obj.data.loops) - 2 * len(obj.data.polygons) for obj in parts)
        assert result.distance == pytest.approx(levels[number]["leafcloud"].get("switch_distance", 0.0))
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "tree.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "tree.blend"))
    assert results_of(bpy.data.collections["leaves"]) == results


@pytest.mark.usefixtures("before")
def test_warnings_of_the_bake_stay_in_the_panel() -> None:
    keep_warnings(tree(), ["the leaves have no texture coordinates, so all of them show one texel of the image"])
    layout = MagicMock()
    layout.row.return_value = layout.column.return_value = layout.split.return_value = layout
    context = SimpleNamespace(
        view_layer=bpy.context.view_layer,
        scene=bpy.context.scene,
        region=SimpleNamespace(width=300.0),
        preferences=SimpleNamespace(system=SimpleNamespace(ui_scale=1.0)),
    )
    interface.LEAFCLOUD_PT_tree.draw(SimpleNamespace(layout=layout), context)
    warned = [call.kwargs for call in layout.label.call_args_list if call.kwargs.get("icon") == "ERROR"]
    assert [each["text"] for each in warned] == ["the leaves have no texture"]


@pytest.mark.usefixtures("before")
def test_the_panel_has_a_button_for_each_level_and_its_figures() -> None:
    layout = MagicMock()
    for part in ("row", "column", "split"):
        getattr(layout, part).return_value = layout
    interface.LEAFCLOUD_PT_tree.draw(SimpleNamespace(layout=layout), bpy.context)
    buttons = [call.kwargs.get("text") for call in layout.operator.call_args_list]
    assert buttons == ["Auto", "0", "1", "2", "Sources", None, None, None, "Bake Again", None, None, "", "", ""]
    labels = [call.kwargs["text"] for call in layout.label.call_args_list]
    results = results_of(tree())
    _, radius = crown_of(tree())
    lines = [figures_of(each, picture_share(radius, each.distance, bpy.context.scene)) for each in results]
    told = (line for each, figures in zip(results, lines, strict=True) for line in (each.name, *figures))
    assert labels == ["leaves", *told]
    assert max(map(len, labels)) <= 26, "wider lines are cut off"


def test_figures_have_units_and_the_share_of_the_picture() -> None:
    def told(distance: float, share: float) -> tuple[str, ...]:
        return figures_of(LevelResult("Level 1", 5, 2.0, (64, 32), 0.05, distance), share)[:4]

    assert told(63.21, 0.444) == ("from 63.2 m on", "44 % of picture height", "5 triangles", "2.0 × cheaper")
    assert told(0.01234, 0.0333)[:2] == ("from 1.23 cm on", "3.3 % of picture height")


def test_the_share_of_the_picture_is_that_of_the_camera() -> None:
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    bpy.context.scene.camera = camera
    camera.data.sensor_fit, camera.data.angle = "VERTICAL", math.radians(90.0)
    scene = bpy.context.scene
    assert picture_share(1.0, 10.0, scene) == pytest.approx(0.1, rel=1e-5)
    assert (picture_share(1.0, 0.5, scene), picture_share(1.0, 0.0, scene)) == (1.0, 1.0)


@pytest.mark.usefixtures("before")
def test_a_level_is_framed_in_a_3d_view_only() -> None:
    with pytest.raises(RuntimeError, match="to show in a 3D view"):
        bpy.ops.leafcloud.frame_level(level=1)


def test_the_panel_is_hidden_without_a_baked_tree() -> None:
    assert not interface.LEAFCLOUD_PT_tree.poll(bpy.context)
    assert not bpy.ops.leafcloud.remove.poll()


def test_removal_leaves_the_file_as_before_the_bake(before: dict[str, set[str]]) -> None:
    assert names() != before
    assert bpy.ops.leafcloud.remove() == {"FINISHED"}
    assert names() == before
    sources = [bpy.data.objects[name] for name in ("leaves", "branches")]
    assert bpy.context.view_layer.objects.active.name == "leaves"
    assert all(obj.visible_get() and not obj.hide_render and obj.select_get() for obj in sources)


@pytest.mark.usefixtures("before")
def test_objects_that_an_artist_added_survive_the_removal() -> None:
    own = bpy.data.objects.new("bird", None)
    tree().objects.link(own)
    bpy.ops.leafcloud.remove()
    assert own.users_collection == (bpy.context.scene.collection,)


@pytest.mark.usefixtures("before")
def test_a_tree_without_its_sources_is_not_removed() -> None:
    for name in ("leaves", "branches"):
        bpy.data.objects.remove(bpy.data.objects[name])
    with pytest.raises(RuntimeError, match="the view layer lacks the objects that 'leaves' was made from"):
        bpy.ops.leafcloud.remove()
    assert "leaves_LOD1" in bpy.data.objects


@pytest.mark.usefixtures("before")
def test_children_of_an_artist_keep_their_place_after_the_removal() -> None:
    bird = bpy.data.objects.new("bird", None)
    bpy.context.scene.collection.objects.link(bird)
    bird.parent, bird.location = bpy.data.objects["leaves_tree"], (4.0, 7.0, 0.0)
    bpy.context.view_layer.update()
    place = bird.matrix_world.copy()
    bpy.ops.leafcloud.remove()
    bpy.context.view_layer.update()
    assert bird.parent is None
    assert bird.matrix_world == place


def test_removal_takes_copies_of_the_tree_with_it(before: dict[str, set[str]]) -> None:
    bpy.ops.object.duplicate(linked=True)
    layout = MagicMock()
    layout.row.return_value = layout.column.return_value = layout.split.return_value = layout
    interface.LEAFCLOUD_PT_tree.draw(SimpleNamespace(layout=layout), bpy.context)
    buttons = [call.kwargs.get("text") for call in layout.operator.call_args_list]
    assert buttons == ["Auto", "0", "1", "2", "Sources", None, None, None, "Bake Again", None, None, "", "", ""]
    assert bpy.ops.leafcloud.remove() == {"FINISHED"}
    assert names() == before


@pytest.mark.usefixtures("before")
def test_auto_changes_nothing_where_no_level_is_fixed() -> None:
    level = next(obj for obj in tree().objects if level_number(obj) == 1)
    level.hide_render = True
    bpy.ops.leafcloud.show_level(level=-1)
    assert level.hide_render
    bpy.ops.leafcloud.show_level(level=0)
    bpy.ops.leafcloud.show_level(level=-1)
    assert level.hide_render
