"""An effect that is off costs nothing: a bake calls none of its code, and leaves no data of it.

Each test turns one effect off and all others on. It bakes twice: the second time, all functions that only this effect
uses raise when called. Files, data-blocks and reports must be equal. Other tests check the traces of effects that are
on.
"""

from __future__ import annotations

import importlib
import inspect
import json
import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import pytest
from dumps import dump
from night import rest_at_night
from plan_scenes import add_crown, add_light, principled
from scenes import add_mesh, bake, read

from addon.bake.values import TreeSet
from addon.export.files import write
from addon.export.glb_file import Glb
from addon.settings.bake import BakeSettings
from addon.settings.effects import EFFECTS

pytestmark = pytest.mark.fresh


@dataclass(frozen=True)
class Own:
    """The code that only this effect uses, and the data that it leaves.

    modules: names of whole modules, or `module:name` of single functions and classes.
    traces: parts of lines in the dump or in a file's JSON. All are present if the effect is on, none if it is off.
    """

    modules: tuple[str, ...]
    traces: tuple[str, ...]
    without: tuple[str, ...] = ()
    """Other effects to turn off, because they share this code."""
    chain: str = "both"
    alpha: float = 1.0
    """Alpha of the leaves."""


EFFECTS_APART = {
    "transitions": Own(
        (
            "addon.levels.leaf_moves",
            "addon.levels.morphs:add_transition",
            "addon.levels.morphs:Transition",
            "addon.levels.fading:add_fade",
            "addon.levels.fading:fading_copy",
            "addon.levels.fading:let_fade",
        ),
        ("attributes leaf_target", "attributes leaf_pivot_target", "key_blocks Billboards", "vertex_groups LC_000"),
    ),
    "pruning": Own(
        (
            "addon.levels.morphs:add_pruning",
            "addon.levels.morphs:Pruning",
            "addon.levels.prune_tables:prefix_table",
            "addon.levels.prune_tables:area_shares",
            "addon.export.vertex_data:_engine_values",
        ),
        ("attributes leaf_rank", "attributes leaf_pivot is", "_LEAF_RANK", "prefixes"),
        without=("wind",),
        chain="billboards",
    ),
    # Only the core decides whether front and back differ.
    "back_sides": Own(("addon.nodes.sides",), ("materials tree_LOD1 use_backface_culling = True",)),
    "trunk_levels": Own(
        ("addon.levels.trunk:simplified", "addon.levels.trunk:gathered", "addon.plan.trunk_limits:trunk_limits"),
        ("meshes tree_trunk_1 is there",),
    ),
    # The same functions make the first level and the others.
    "far_levels": Own((), ("objects tree_LOD2 is there", "images tree_LOD2 is there")),
    "normals": Own(("addon.levels.material:_add_normal",), ("images tree_LOD1_normal is there", "normalTexture")),
    "roughness_metallic": Own(
        ("addon.levels.material:_add_orm",),
        ("images tree_LOD1_orm is there", "metallicRoughnessTexture"),
        without=("occlusion", "self_shadowing"),
    ),
    "translucency": Own(
        (
            "addon.export.translucency",
            "addon.levels.material:_shine_through",
            "addon.levels.material:with_opaque_parts",
            "addon.material.describe:_part_light",
        ),
        ("images tree_LOD1_translucency is there", "KHR_materials_diffuse_transmission"),
    ),
    # `all` leaves blend_order to the plan, which turns it on for these leaves.
    "blend_order": Own(
        ("addon.export.blend_order",), ('"blend_order"', '"alphaMode": "BLEND"'), chain="billboards", alpha=0.7
    ),
    "occlusion": Own(
        ("addon.levels.material:_gltf_output",), ("node_groups glTF Material Output is there", "occlusionTexture")
    ),
    "self_shadowing": Own(
        ("addon.levels.material:_add_bent_normal",), ("images tree_LOD1_bent_normal is there", "bentNormalTexture")
    ),
    "shadow_proxy": Own(
        ("addon.levels.shadow_proxy:add_shadow_proxy",),
        ("objects tree_shadow is there", "images tree_shadow is there", "visible_shadow = False"),
    ),
    "leaf_map": Own(
        ("addon.levels.leaf_map",),
        ("images tree_LOD1_leaf_uv is there", "node_groups Leafcloud Leaf Map is there", "leafUvTexture"),
    ),
    "filtering": Own(("addon.levels.filtering",), ("EEVEE: the share of a pixel",)),
    "contrast": Own(
        ("addon.levels.contrast", "addon.export.plain_materials:plain_colors"),
        ("nodes Leafcloud Contrast is there", "mean_color"),
    ),
    "wind": Own(
        (
            "addon.levels.wind:WindAttributes",
            "addon.levels.wind:add_wind",
            "addon.levels.wind:add_wind_attributes",
            "addon.nodes.wind:add_wind_modifier",
            "addon.nodes.wind:wind_group",
        ),
        ("attributes leaf_phase", "node_groups Leafcloud Wind is there", "_LEAF_BILLBOARD_PIVOT"),
    ),
    "baked_light": Own(
        ("addon.bake.lighting", "addon.scene.light", "addon.levels.baked_light", "addon.export.unlit"),
        ("attributes leafcloud_light is there", "KHR_materials_unlit"),
        chain="billboards",
    ),
}


@dataclass(frozen=True)
class Written:
    """The results of a bake: files, their JSON, the dump of the scene, the report."""

    files: dict[str, bytes]
    documents: list[str]
    blocks: list[str]
    report: dict[str, Any]

    @property
    def words(self) -> str:
        return "\n".join([*self.blocks, *self.documents])


def tree(alpha: float) -> list[bpy.types.Object]:
    """Add cards of two translucent materials with different roughness, and a trunk with more triangles than needed."""
    crown = add_crown(principled("shiny", Roughness=0.2, Subsurface_Weight=0.5, Alpha=alpha))
    crown.data.materials.append(principled("dull", Roughness=0.9, Subsurface_Weight=0.5, Alpha=alpha))
    crown.data.uv_layers.new(name="UVMap")
    for polygon in crown.data.polygons:
        polygon.material_index = polygon.index % 2
        for corner, place in zip(polygon.loop_indices, [(0, 0), (1, 0), (1, 1), (0, 1)], strict=True):
            crown.data.uv_layers[0].data[corner].uv = place
    sides, rings = 16, 6
    turns = [2.0 * math.pi * side / sides for side in range(sides)]
    vertices = [
        (0.1 * math.cos(turn), 0.1 * math.sin(turn), 1.5 * ring / rings - 1.5)
        for ring in range(rings + 1)
        for turn in turns
    ]
    faces = [
        (row + side, row + (side + 1) % sides, row + sides + (side + 1) % sides, row + sides + side)
        for row in range(0, rings * sides, sides)
        for side in range(sides)
    ]
    add_light("SUN")
    bpy.context.view_layer.update()
    return [crown, add_mesh("trunk", vertices, faces)]


def baked(out: Path, effects: str, chain: str, alpha: float = 1.0, **changed: Any) -> Written:
    """Bake leaves with this alpha in a new scene. `changed` overrides settings."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bake_tree = read(tree(alpha), ["leaves"])
    settings = {"texture_size": 64, "epsilon": 0.2, "effects": effects, "chain": chain, **changed}
    tree_set = TreeSet.of(bake(bake_tree, BakeSettings(**settings)))
    report = write(tree_set, out, lambda stage, fraction: None, blend=False)
    paths = [out / name for name in report["files"] if name.endswith(".glb")]
    documents = [json.dumps(Glb.read(path).document) for path in paths]
    return Written({path.name: path.read_bytes() for path in paths}, documents, dump(), report)


def without_times(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: without_times(each) for key, each in value.items() if key != "seconds"}
    return [without_times(each) for each in value] if isinstance(value, list) else value


def all_but(effect: str) -> str:
    own = EFFECTS_APART[effect]
    return ",".join(["all", *(f"-{name}" for name in (effect, *own.without))])


def forbid(monkeypatch: pytest.MonkeyPatch, entry: str) -> int:
    """Make the functions and classes of `entry` raise on every call in the add-on. Return their number.

    `entry` is a module, or `module:name` for one function or class.
    """
    module, _, name = entry.partition(":")
    members = vars(importlib.import_module(module))
    found = [members[name]] if name else [each for each in members.values() if _is_own(each, module)]

    def touched(*arguments: object, **keywords: object) -> None:
        raise AssertionError(f"{entry} was touched")

    for user in [each for key, each in sys.modules.items() if key.split(".")[0] == "addon"]:
        for key, value in list(vars(user).items()):
            if any(value is each for each in found):
                monkeypatch.setattr(user, key, touched)
    return len(found)


def _is_own(value: object, module: str) -> bool:
    return (inspect.isfunction(value) or inspect.isclass(value)) and value.__module__ == module


def test_every_effect_has_an_entry_in_this_file() -> None:
    assert tuple(sorted(EFFECTS_APART)) == tuple(sorted(EFFECTS))


WITH_CODE = [name for name in EFFECTS if EFFECTS_APART[name].modules]
BY_DAY = ("transitions", "pruning", "wind", "leaf_map")
"""Effects that run by day: one in node groups, one in the order of leaves, one in a scene, one in textures."""


@pytest.mark.parametrize("effect", rest_at_night(sorted(WITH_CODE, key=lambda name: name not in BY_DAY), len(BY_DAY)))
def test_an_effect_that_is_off_calls_no_code_and_leaves_no_trace(
    effect: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = EFFECTS_APART[effect]
    off = baked(tmp_path / "off", all_but(effect), own.chain, own.alpha)
    with monkeypatch.context() as patched:
        assert all(forbid(patched, entry) > 0 for entry in own.modules)
        forbidden = baked(tmp_path / "forbidden", all_but(effect), own.chain, own.alpha)
    assert off.files == forbidden.files
    assert off.blocks == forbidden.blocks
    assert without_times(off.report) == without_times(forbidden.report)
    [said] = [each for each in off.report["effects"] if each["name"] == effect]
    assert (said["on"], said["seconds"], said["bytes"]) == (False, 0.0, 0)
    assert [trace for trace in own.traces if trace in off.words] == []


@pytest.mark.parametrize(
    ("effects", "chain", "shown"),
    [
        ("all", "both", [name for name in EFFECTS if EFFECTS_APART[name].chain == "both"]),
        ("all", "billboards", ["pruning"]),
        ("all", "billboards", ["blend_order"]),
        ("transitions,baked_light", "billboards", ["baked_light"]),
    ],
)
def test_an_effect_that_is_on_leaves_its_traces(effects: str, chain: str, shown: list[str], tmp_path: Path) -> None:
    words = baked(tmp_path, effects, chain, EFFECTS_APART[shown[0]].alpha).words
    assert [trace for name in shown for trace in EFFECTS_APART[name].traces if trace not in words] == []


def test_forbidden_code_of_an_effect_that_is_on_raises(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """This checks `forbid` itself."""
    forbid(monkeypatch, "addon.levels.leaf_map")
    with pytest.raises(AssertionError, match="leaf_map was touched"):
        baked(tmp_path, "all", "billboards")


def test_a_bake_without_far_levels_equals_a_bake_of_one_level(tmp_path: Path) -> None:
    short = baked(tmp_path / "short", "none,-far_levels", "billboards")
    one = baked(tmp_path / "one", "none", "billboards", levels=1, cross=False)
    assert short.files == one.files
    assert short.blocks == one.blocks
    assert [trace for trace in EFFECTS_APART["far_levels"].traces if trace in short.words] == []
    [said] = [each for each in short.report["effects"] if each["name"] == "far_levels"]
    assert (said["on"], said["seconds"], said["bytes"]) == (False, 0.0, 0)
