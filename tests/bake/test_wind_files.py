"""Wind in files: data for engines, equal motion in the viewer and in Blender, and no trace without the effect."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from browser import ask
from command_line import QUICK, bake, saved
from glb import Node, Primitive, read_glb
from laws import Floats
from lod_scenes import add_camera, evaluate, points_of
from mathutils import Euler, Matrix, Vector
from scenes import add_field, read
from scenes import bake as bake_scene

from addon.bake import pipeline
from addon.bake.pipeline import wind_settings
from addon.bake.values import TreeSet
from addon.export.files import write
from addon.export.gltf import y_up
from addon.levels import shape
from addon.levels import wind as level_wind
from addon.levels.forest import build_forest
from addon.nodes import wind as wind_nodes
from addon.scene.load import load
from addon.settings.bake import BakeSettings
from addon.versions import get_modifier_input

EFFECTS = "transitions,pruning,trunk_levels,wind"
PAGE = "tests/browser/probe.html"
FRAME = 40
PLACE = Matrix.LocRotScale(Vector((30.0, -7.0, 4.0)), Euler((0.3, 0.2, 2.0)), Vector((2.5, 2.5, 2.5)))


@pytest.fixture(scope="module")
def windy_scene(shrub: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Save the shrub, rotated, scaled and far from the origin, with a wind field of strength 7. Return the path."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=str(shrub))
    for obj in bpy.context.scene.objects:
        if obj.parent is None:
            obj.matrix_world = PLACE @ obj.matrix_world
    add_field("WIND", strength=7.0).rotation_euler = (math.pi / 2.0, 0.0, 0.8)
    return saved(tmp_path_factory.mktemp("source") / "shrub.blend")


@pytest.fixture(scope="module")
def folder(windy_scene: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a bake with the planned effects, which include wind, and with pruning."""
    out = tmp_path_factory.mktemp("windy")
    bake(windy_scene, out, *QUICK, "--effects=+pruning")
    return out


@pytest.fixture(scope="module")
def nodes(folder: Path) -> dict[str, Node]:
    return read_glb(folder / "shrub.glb")


def primitives(nodes: dict[str, Node], number: int) -> list[Primitive]:
    return nodes[f"shrub_LOD{number}"].primitives


# Contents


def test_a_field_in_the_scene_calls_for_wind(folder: Path) -> None:
    effects = {each["name"]: each for each in json.loads((folder / "report.json").read_text())["effects"]}
    assert effects["wind"]["on"] is True
    assert effects["wind"]["reason"] == "the force field 'Breeze' blows on the tree"
    assert effects["wind"]["bytes"] > 0
    assert effects["wind"]["seconds"] > 0.0


def test_the_baked_scene_keeps_the_field_and_follows_it(folder: Path) -> None:
    bpy.ops.wm.open_mainfile(filepath=str(folder / "shrub.blend"))
    field, obj = bpy.data.objects["Breeze"], bpy.data.objects["shrub_LOD0"]
    assert [modifier.name for modifier in obj.modifiers] == ["Leafcloud LOD", "Leafcloud Wind"]
    assert get_modifier_input(obj.modifiers[1], "Field") == field
    moved = points_of(evaluate(obj))
    field.rotation_euler.z += 1.0
    turned = points_of(evaluate(obj))
    field.field.strength = 14.0
    stronger = points_of(evaluate(obj))
    assert np.abs(moved - turned).max() > 0.01
    assert np.abs(turned - stronger).max() > 0.01


def test_every_level_stores_the_wind(nodes: dict[str, Node]) -> None:
    for number in range(4):
        wind = nodes[f"shrub_LOD{number}"].extras["leafcloud"]["wind"]
        # Rx(90°) turns Z to −Y, Rz(0.8) turns that on; Y-up.
        assert wind["direction"] == pytest.approx([math.sin(0.8), 0.0, math.cos(0.8)], abs=1e-6)
        assert (wind["strength"], wind["gusts"]) == (7.0, 0.5)
        assert np.linalg.norm(wind["up"]) == pytest.approx(1.0)
        # Up is that of the world.
        turn = nodes[f"shrub_LOD{number}"].matrix[:3, :3]
        assert turn @ wind["up"] / np.linalg.norm(turn @ wind["up"]) == pytest.approx([0.0, 1.0, 0.0], abs=1e-5)
        assert 0.9 < wind["height"] < 1.7


def test_levels_have_only_the_attributes_they_need(nodes: dict[str, Node]) -> None:
    def names(number: int) -> set[str]:
        return {
            name
            for each in primitives(nodes, number)
            for name in each.attributes
            if name.startswith(("_", "TEXCOORD_"))
        }

    morph = {"_LEAF_RANK", "_LEAF_PIVOT", "_LEAF_PIVOT_TARGET", "_LEAF_BILLBOARD_PIVOT"}
    assert names(0) == names(1) == {*morph, "TEXCOORD_0"}
    assert names(2) == {"_LEAF_PIVOT", "TEXCOORD_0"}
    assert names(3) == {"TEXCOORD_0"}
    assert all(name.startswith("shrub") for name in nodes if "LOD" in name)


def test_phases_are_even_and_the_hull_flutters_most(nodes: dict[str, Node]) -> None:
    [leaves] = primitives(nodes, 0)
    rank, phase, flutter = leaves.attributes["_LEAF_RANK"].T
    _, first, of_vertex = np.unique(rank, return_index=True, return_inverse=True)
    assert (phase == phase[first][of_vertex]).all()
    assert (flutter == flutter[first][of_vertex]).all()
    counts, _ = np.histogram(phase[first], bins=16, range=(0.0, 1.0))
    assert counts.min() >= 672 // 16 - 2
    pivots = leaves.attributes["_LEAF_PIVOT"][first]
    middle = (pivots.min(axis=0) + pivots.max(axis=0)) / 2.0
    depth = np.linalg.norm((pivots - middle) / (np.ptp(pivots, axis=0) / 2.0), axis=1)
    np.testing.assert_allclose(flutter[first], np.minimum(depth, 1.0), atol=1e-4)


def test_the_files_are_valid(folder: Path, gltf_issues: Callable[..., list[dict[str, Any]]]) -> None:
    assert gltf_issues(*sorted(folder.glob("*.glb"))) == []


# The viewer


def eyes(nodes: dict[str, Node]) -> list[tuple[int, Floats]]:
    """Return viewpoints and their levels: start, middle and end of the transitions, and the far levels."""
    extras = [nodes[f"shrub_LOD{number}"].extras["leafcloud"] for number in range(4)]
    points = np.concatenate([each.attributes["POSITION"] for each in primitives(nodes, 0)])
    places = nodes["shrub_LOD0"].to_world(points)
    centre = (places.min(axis=0) + places.max(axis=0)) / 2.0
    found = []
    for number in (0, 1):
        start, end = extras[number]["transition_start"], extras[number]["transition_end"]
        found += [(number, start + share * (end - start)) for share in (0.05, 0.5, 0.99)]
    found += [(2, 0.8 * extras[3]["switch_distance"] + 0.2 * found[-1][1]), (3, 1.5 * extras[3]["switch_distance"])]
    return [(number, centre + distance * np.array([0.6, 0.48, 0.64])) for number, distance in found]


def by_place(rest: Floats, *more: Floats) -> list[bytes]:
    return [row.tobytes() for row in np.ascontiguousarray(np.hstack([rest, *more]), np.float32)]


def moved_by_nodes(obj: bpy.types.Object) -> dict[bytes, Floats]:
    """Return the moved positions by the position and pivots at rest, in glTF's coordinates."""
    mesh, points = obj.data, [points_of(obj.data)]
    for name in ("leaf_pivot", "leaf_billboard_pivot"):
        if name in mesh.attributes:
            values = np.empty((len(mesh.vertices), 3), np.float32)
            mesh.attributes[name].data.foreach_get("vector", values.ravel())
            points.append(values)
    moved = y_up(points_of(evaluate(obj)))
    return dict(zip(by_place(*map(y_up, points)), moved.astype(float), strict=True))


def apart(seen: dict[str, Any], primitive: Primitive, moved: dict[bytes, Floats]) -> float:
    """Return the largest distance between a vertex in the viewer and in Blender."""
    names = ("POSITION", "_LEAF_PIVOT", "_LEAF_BILLBOARD_PIVOT")
    keys = by_place(*(primitive.attributes[name] for name in names if name in primitive.attributes))
    places = np.frombuffer(base64.b64decode(seen["places"]), "<f4").reshape(-1, 3).astype(float)
    return float(np.linalg.norm(places - [moved[key] for key in keys], axis=1).max())


@pytest.mark.browser
def test_the_viewer_moves_all_as_blender_does(folder: Path, nodes: dict[str, Node]) -> None:
    """Compare leaves, billboards, cross impostor and trunk.

    GLSL allows errors of 2⁻¹¹ in sines. Wind scales the error by a tenth of height and spread and by at most half of a
    leaf's arm. The blend a also differs, by the rounding of the distance.
    """
    places = eyes(nodes)
    question = {
        "tree": "/files/shrub.glb",
        "settings": {"hysteresis": 0.0, "stagger": 0.0},
        "eyes": [eye.tolist() for _, eye in places],
        "seconds": FRAME / 24.0,
    }
    views = ask(PAGE, question, patience=120.0, files=folder)["seen"]
    bpy.ops.wm.open_mainfile(filepath=str(folder / "shrub.blend"))
    camera = add_camera((0.0, 0.0, 0.0))
    bpy.context.scene.frame_set(FRAME)
    for (number, eye), view in zip(places, views, strict=True):
        camera.location = (eye[0], -eye[2], eye[1])
        bpy.context.view_layer.update()
        assert view["level"] == number
        obj = bpy.data.objects[f"shrub_LOD{number}"]
        moved = moved_by_nodes(obj)
        for seen, primitive in zip(view["meshes"], primitives(nodes, number), strict=True):
            assert apart(seen, primitive, moved) < 4e-4
        for below in obj.children:
            trunk = moved_by_nodes(below)
            for seen, primitive in zip(view["trunk"], nodes[obj.name].trunk, strict=True):
                assert apart(seen, primitive, trunk) < 4e-4
        still = {key: np.frombuffer(key, np.float32)[:3] for key in moved}
        assert max(float(np.linalg.norm(moved[key] - still[key])) for key in moved) > 0.01


# Without wind


def bake_still(out: Path, shrub: Path) -> dict[str, bytes]:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    load(shrub)
    baked = bake_scene(read(), BakeSettings(texture_size=64, epsilon=0.2, quality=0.1, levels=2))
    write(TreeSet.of(baked), out, lambda stage, fraction: None, blend=False)
    return {path.name: path.read_bytes() for path in out.glob("*.glb")}


def test_a_bake_without_wind_calls_no_code_of_the_wind(
    shrub: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All functions of the wind raise. A bake without wind must give the same bytes and leave no trace of wind."""
    before = bake_still(tmp_path / "before", shrub)

    def touched(*arguments: object, **named: object) -> None:
        raise AssertionError("the wind is off")

    for name in (
        "WindAttributes",
        "add_wind_attributes",
        "freedom",
        "phases",
        "wind_extras",
        "add_wind_modifier",
    ):
        monkeypatch.setattr(level_wind, name, touched)
    for name in ("stature", "WindSettings"):
        monkeypatch.setattr(pipeline, name, touched)
    monkeypatch.setattr(shape, "add_wind_attributes", touched)
    monkeypatch.setattr(wind_nodes, "wind_group", touched)
    assert bake_still(tmp_path / "after", shrub) == before
    assert [group.name for group in bpy.data.node_groups] == ["Leafcloud Eye", "Leafcloud LOD"]
    for obj in bpy.data.objects:
        assert all(modifier.name == "Leafcloud LOD" for modifier in obj.modifiers)
        drivers = obj.animation_data.drivers if obj.animation_data else []
        paths = {driver.driver.variables[0].targets[0].data_path for driver in drivers}
        assert paths <= {'["LOD Distance"]'}
        assert "wind" not in obj.get("leafcloud", {})
    attributes = {attribute.name for mesh in bpy.data.meshes for attribute in mesh.attributes}
    assert not attributes & {"leaf_phase", "leaf_flutter", "leaf_billboard_pivot"}
    assert not any(b"WIND" in content or b"wind" in content for content in before.values())


# The forest


@pytest.mark.night
def test_a_forest_sways(shrub: Path) -> None:
    """Pruned variants sway, too. All trees of a variant sway alike. Without wind, variants lack its attributes."""
    load(shrub)
    settings = BakeSettings(texture_size=64, epsilon=0.2, quality=0.1, levels=1, effects=EFFECTS)
    baked = bake_scene(read(), settings)
    near = baked.switch_distances[1]
    for wind in (None, wind_settings(baked.prepared)):
        forest = build_forest(
            baked.levels,
            "Shrubs",
            switch_distances=baked.switch_distances,
            centre=(0.0, 0.0, 0.5),
            prune_start=near / 3.0,
            wind=wind,
        )
        ground = bpy.data.meshes.new("Ground")
        ground.from_pydata([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.9 * near, 0.0, 0.0)], [], [])
        obj = bpy.data.objects.new("Ground", ground)
        bpy.context.scene.collection.objects.link(obj)
        forest.plant(obj)
        add_camera((0.0, 0.0, 0.0))
        half = forest.variants.children[1].objects[0]
        assert ("leaf_phase" in half.data.attributes) == (wind is not None)
        drawn = {}
        for frame in (1, FRAME):
            bpy.context.scene.frame_set(frame)
            drawn[frame] = [
                (each.object.original.name, points_of(each.object.data))
                for each in bpy.context.evaluated_depsgraph_get().object_instances
                if each.is_instance and each.parent.original == obj and not each.object.name.endswith("trunk")
            ]
        assert len({name for name, _ in drawn[1]}) == 2
        for (name, first), (again, later) in zip(drawn[1], drawn[FRAME], strict=True):
            assert name == again
            assert (np.abs(first - later).max() > 0.005) == (wind is not None)
