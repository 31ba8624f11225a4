"""Repeated bakes: a second bake replaces the levels of the same objects, and levels do not count as trees."""

from __future__ import annotations

import json
from pathlib import Path

import bpy
import pytest
from command_line import bake, refusal_apart, run_apart, saved
from lod_scenes import add_camera
from night import rest_at_night
from scenes import add_mesh, import_part, read

from addon.errors import SceneError

pytestmark = pytest.mark.usefixtures("registered")

KINDS = ("objects", "meshes", "materials", "images", "collections", "node_groups")


@pytest.fixture
def sources(shrub: Path) -> list[bpy.types.Object]:
    """The objects of a part of the shrub, selected, with settings of a quick bake."""
    import_part(shrub)
    settings = bpy.context.scene.leafcloud
    settings.texture_size, settings.levels, settings.epsilon, settings.quality = 64, 1, 0.2, 0.1
    found = [bpy.data.objects["leaves"], bpy.data.objects["branches"]]
    select(*found)
    return found


def select(*objects: bpy.types.Object, active: bpy.types.Object | None = None) -> None:
    bpy.ops.object.select_all(action="DESELECT")
    for obj in objects:
        obj.hide_set(False)
        obj.select_set(True)
    bpy.context.view_layer.objects.active = active or objects[0]


def names() -> dict[str, list[str]]:
    """Return the names of all data-blocks with users, by collection."""
    return {kind: sorted(item.name for item in getattr(bpy.data, kind) if item.users) for kind in KINDS}


def shown() -> dict[str, tuple[bool, bool]]:
    return {obj.name: (obj.visible_get(), obj.hide_render) for obj in bpy.context.scene.objects}


@pytest.mark.parametrize("last", rest_at_night(["cross", "octahedral"]))
def test_a_second_bake_replaces_the_first(sources: list[bpy.types.Object], last: str) -> None:
    bpy.context.scene.leafcloud.last = last
    bpy.ops.leafcloud.bake()
    first, before, seen = bpy.data.objects["leaves_LOD0"].session_uid, names(), shown()
    select(*sources)
    bpy.ops.leafcloud.bake()
    assert bpy.data.objects["leaves_LOD0"].session_uid != first
    assert names() == before
    assert shown() == seen
    assert [each.name for each in bpy.context.scene.collection.children if "LOD" in each.name] == []


@pytest.mark.parametrize("selected", ["sources", "level"])
def test_sources_are_found_under_other_names(selected: str, sources: list[bpy.types.Object]) -> None:
    bpy.ops.leafcloud.bake()
    before = [each.name for each in bpy.context.scene.collection.children]
    sources[0].name, sources[1].name = "Birch", "Bark"
    select(*(sources if selected == "sources" else [bpy.data.objects["leaves_LOD0"]]))
    assert bpy.ops.leafcloud.bake() == {"FINISHED"}
    assert [each.name for each in bpy.context.scene.collection.children] == before
    assert [obj.name for obj in bpy.data.objects if "_LOD0" in obj.name] == ["leaves_LOD0", "leaves_LOD0_trunk"]


@pytest.mark.night
def test_a_bake_of_a_selected_level_bakes_its_sources(sources: list[bpy.types.Object]) -> None:
    bpy.context.scene.leafcloud.every_level = True
    bpy.ops.leafcloud.bake()
    before = names()
    collection = bpy.data.collections["leaves"]
    assert set(bpy.context.selected_objects) == set(collection.objects)
    assert bpy.context.view_layer.objects.active.name == "leaves_tree"
    select(bpy.data.objects["leaves_LOD0"])
    settings = bpy.context.scene.leafcloud
    settings.levels = 2
    for name in ("leaves_LOD0", "leaves_LOD1_trunk"):
        select(bpy.data.objects[name])
        assert bpy.ops.leafcloud.bake() == {"FINISHED"}
    assert {*names()["objects"]} == {*before["objects"], "leaves_LOD2_trunk", "leaves_LOD3"}
    settings.levels = 1
    bpy.ops.leafcloud.bake()
    assert names() == before


@pytest.mark.night
def test_a_level_can_be_planned_and_measured(sources: list[bpy.types.Object]) -> None:
    bpy.ops.leafcloud.bake()
    seen = shown()
    assert bpy.ops.leafcloud.plan() == {"FINISHED"}
    assert bpy.ops.leafcloud.curve() == {"FINISHED"}
    assert shown() == seen


def test_a_bake_with_the_trunk_replaces_a_bake_of_the_leaves_alone(sources: list[bpy.types.Object]) -> None:
    select(sources[0])
    bpy.ops.leafcloud.bake()
    assert "leaves_LOD0_trunk" not in bpy.data.objects
    select(*sources)
    bpy.ops.leafcloud.bake()
    assert "leaves_LOD0_trunk" in bpy.data.objects
    assert not [name for name in names()["objects"] if "_2" in name or "." in name]


def test_another_tree_is_left_alone(sources: list[bpy.types.Object]) -> None:
    bpy.ops.leafcloud.bake()
    other = sources[0].copy()
    bpy.context.scene.collection.objects.link(other)
    select(other)
    bpy.ops.leafcloud.bake()
    assert {"leaves_LOD0", "leaves.001_LOD0"} <= {*names()["objects"]}


def test_instances_and_an_artists_own_objects_stay(sources: list[bpy.types.Object]) -> None:
    bpy.ops.leafcloud.bake()
    levels, scene = bpy.data.collections["leaves"], bpy.context.scene
    instance, lamp = bpy.data.objects.new("far", None), bpy.data.objects.new("lamp", bpy.data.lights.new("lamp", "SUN"))
    instance.instance_type, instance.instance_collection = "COLLECTION", levels
    scene.collection.objects.link(instance)
    levels.objects.link(lamp)
    lamp.parent = bpy.data.objects["leaves_LOD0"]
    garden = bpy.data.collections.new("garden")
    scene.collection.children.link(garden)
    scene.collection.children.unlink(levels)
    garden.children.link(levels)
    levels.name = "shrub"
    select(bpy.data.objects["leaves_LOD0"])
    bpy.ops.leafcloud.bake()
    assert [child.name for child in garden.children] == ["shrub"]
    assert [child.name for child in scene.collection.children if child.name != "Collection"] == ["garden"]
    assert instance.instance_collection == bpy.data.collections["shrub"]
    assert lamp.name in bpy.data.collections["shrub"].objects
    assert lamp.parent == bpy.data.objects["shrub_LOD0"]


def test_a_second_bake_that_fails_leaves_the_first(
    sources: list[bpy.types.Object], monkeypatch: pytest.MonkeyPatch
) -> None:
    bpy.ops.leafcloud.bake()
    before, seen = names(), shown()

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device", "leaves_LOD0.glb")

    monkeypatch.setattr("addon.ui.operators.remember", full)
    with pytest.raises(RuntimeError, match=r"cannot write leaves_LOD0\.glb: No space left on device; .*another Folder"):
        bpy.ops.leafcloud.bake()
    assert names() == before
    assert shown() == seen
    assert "leaves_LOD1" in bpy.data.collections["leaves"].objects


def test_a_refusal_leaves_everything_as_it_was(sources: list[bpy.types.Object]) -> None:
    bpy.ops.leafcloud.bake()
    before, seen = names(), shown()
    bpy.context.scene.leafcloud.leaves = "petals"
    with pytest.raises(RuntimeError, match="petals"):
        bpy.ops.leafcloud.bake()
    assert (names(), shown()) == (before, seen)


def test_a_second_bake_of_several_trees_replaces_the_first(sources: list[bpy.types.Object]) -> None:
    other = sources[0].copy()
    other.location.x = 9.0
    bpy.context.scene.collection.objects.link(other)
    bpy.context.scene.leafcloud.trees = "parents"
    select(sources[0], other)
    bpy.ops.leafcloud.bake()
    before = names()
    assert {"trees", "leaves", "leaves.001"} <= {*before["collections"]}
    assert {obj.name for obj in bpy.context.selected_objects if obj.parent is None} == {
        "leaves_tree",
        "leaves.001_tree",
    }
    bpy.ops.leafcloud.bake()
    assert names() == before
    select(bpy.data.objects["leaves_LOD1"])
    bpy.ops.leafcloud.bake()
    assert {*names()["objects"]} == {*before["objects"]}
    assert {child.name for child in bpy.data.collections["trees"].children} == {"leaves", "leaves.001"}


def test_a_bake_of_a_level_without_its_sources_is_refused(sources: list[bpy.types.Object]) -> None:
    bpy.ops.leafcloud.bake()
    bpy.data.objects.remove(sources[0])
    with pytest.raises(
        RuntimeError,
        match="'leaves_tree' belongs to a baked tree, and the view layer lacks the tree's source objects 'leaves'",
    ):
        bpy.ops.leafcloud.bake()


def test_the_selected_objects_give_the_levels_their_name(sources: list[bpy.types.Object]) -> None:
    cube = add_mesh("Cube", [(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)])
    select(*sources, active=cube)
    cube.select_set(False)
    bpy.ops.leafcloud.bake()
    assert "leaves_LOD0" in bpy.data.objects


def test_reading_a_level_as_a_tree_is_refused(sources: list[bpy.types.Object]) -> None:
    bpy.ops.leafcloud.bake()
    with pytest.raises(SceneError, match="'leaves_LOD0' is a level of a baked tree: bake 'branches', 'leaves'"):
        read()


def test_the_command_line_refuses_a_file_that_shows_levels(sources: list[bpy.types.Object], tmp_path: Path) -> None:
    bpy.ops.leafcloud.bake()
    source = saved(tmp_path / "baked.blend")
    line = refusal_apart(tmp_path / "out", "--input", source)
    remedy = "bake 'branches', 'leaves' (select them, or show them in renders and hide the levels there)"
    assert line == f"object 'leaves_LOD0' is a level of a baked tree: {remedy}"
    plan = run_apart("--input", source, "--plan-only")
    assert (plan.returncode, plan.stderr) == (1, f"bake.py: {line}\n")
    for obj in bpy.context.scene.objects:
        obj.hide_set(obj not in sources)
        obj.hide_render = obj not in sources
    saved(source)
    plan = run_apart("--input", source, "--plan-only", "--json")
    assert plan.returncode == 0, plan.stderr
    assert json.loads(plan.stdout)


# The folder


@pytest.fixture
def no_bake(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fail the test if the bake reaches the core."""

    def start(*_: object) -> None:
        raise AssertionError("the bake has begun")

    monkeypatch.setattr("addon.ui.operators.start_tree_set", start)


@pytest.mark.usefixtures("no_bake")
def test_a_folder_that_is_not_writable_is_refused_before_the_bake(
    sources: list[bpy.types.Object], tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("in the way")
    bpy.context.scene.leafcloud.directory = str(tmp_path / "file" / "out")
    with pytest.raises(RuntimeError, match=r"Folder is '.*out', but .*file is not a folder: choose another"):
        bpy.ops.leafcloud.bake()


@pytest.mark.usefixtures("no_bake")
@pytest.mark.parametrize("folder", ["out", "~/out"])
def test_a_folder_relative_to_the_process_is_refused(folder: str, sources: list[bpy.types.Object]) -> None:
    bpy.context.scene.leafcloud.directory = folder
    with pytest.raises(RuntimeError, match=f"Folder is '{folder}': begin it with //"):
        bpy.ops.leafcloud.bake()


@pytest.mark.usefixtures("no_bake")
def test_a_relative_folder_of_an_unsaved_file_is_refused_before_the_bake(sources: list[bpy.types.Object]) -> None:
    bpy.context.scene.leafcloud.directory = "//out"
    with pytest.raises(RuntimeError, match=r"Folder is '//out', .* this file is not saved: save it"):
        bpy.ops.leafcloud.bake()


def test_a_bake_writes_to_a_relative_folder(sources: list[bpy.types.Object], tmp_path: Path) -> None:
    saved(tmp_path / "garden.blend")
    bpy.context.scene.leafcloud.directory = "//out"
    bpy.ops.leafcloud.bake()
    assert (tmp_path / "out" / "report.json").is_file()


def test_the_folder_property_accepts_relative_paths() -> None:
    said = bpy.context.scene.leafcloud.bl_rna.properties["directory"]
    assert getattr(said, "is_path_supports_blend_relative", True)
    assert said.is_animatable


# Another file


@pytest.mark.night
def test_opening_a_file_clears_plan_status_and_curve(sources: list[bpy.types.Object], tmp_path: Path) -> None:
    from addon.ui import measured

    add_camera((0.0, -9.0, 0.0))
    bpy.ops.leafcloud.curve()
    bpy.ops.leafcloud.bake()
    status = bpy.context.window_manager.leafcloud
    assert len(status.plan), status.note
    assert measured.last() is not None
    assert measured.told()
    path = saved(tmp_path / "another.blend")
    for opened in range(2):
        bpy.ops.wm.open_mainfile(filepath=str(path))
        status = bpy.context.window_manager.leafcloud
        assert (len(status.plan), status.note, status.viewer, status.stage) == (0, "", "", ""), opened
        assert measured.last() is None
        assert measured.told() == ()


@pytest.mark.night
def test_a_shorter_chain_removes_the_files_of_a_longer_one(shrub: Path, tmp_path: Path) -> None:
    out, quick = tmp_path / "out", ("--texture-size", 64, "--epsilon", 0.2, "--quality", 0.1, "--files", "levels")
    bake(shrub, out, *quick, "--levels", 2)
    (out / "shrub_LOD9.glb").write_bytes(b"not listed in a report: somebody else's")
    (out / "other_LOD3.glb").write_bytes(b"another tree's")
    listed = set(bake(shrub, out, *quick, "--levels", 1, "--no-cross")["files"])
    assert {file.name for file in out.iterdir()} == listed | {"shrub_LOD9.glb", "other_LOD3.glb"}
