"""The plan of the effects and the LOD ranges of the levels, without Blender."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import addon.effects
from addon.effects.back_sides import EFFECT as BACK_SIDES
from addon.plan.decision import Decision, first_on, is_on
from addon.plan.effects import camera_note, plan_channels, plan_effects
from addon.plan.facts import Camera, Facts
from addon.plan.lod_range import HandOverKind, LodRange, View, lod_ranges, rising, trunk_range
from addon.plan.registry import all_effects
from addon.settings.bake import BakeSettings
from addon.settings.effects import EFFECTS
from addon.settings.setting import SettingsError

FACTS = Facts(engine="generic", leaves=672)

FADE, BOTH = HandOverKind.FADE, HandOverKind.MORPH_AND_FADE


BY_ALL = set(EFFECTS) - {"baked_light", "blend_order"}
"""Effects that the list `all` turns on. Light may move, so baked light stays off. The plan decides about blending."""


def chain_with_sides(*two_sided: bool) -> Any:
    """Return a stand-in for a chain. Its levels have only the attribute `two_sided`."""
    return SimpleNamespace(levels=[SimpleNamespace(two_sided=each) for each in two_sided])


def states(effects: tuple[Decision, ...]) -> dict[str, bool | None]:
    return {effect.name: effect.on for effect in effects}


def test_auto_turns_on_the_effects_for_a_free_camera() -> None:
    effects = plan_effects(BakeSettings(), FACTS)
    assert states(effects) == {
        "transitions": True,
        "pruning": False,
        "back_sides": None,
        "trunk_levels": False,
        "far_levels": True,
        "normals": True,
        "roughness_metallic": False,
        "translucency": False,
        "blend_order": False,
        "occlusion": False,
        "self_shadowing": False,
        "shadow_proxy": False,
        "leaf_map": False,
        "contrast": False,
        "filtering": True,
        "wind": False,
        "baked_light": False,
    }
    assert all(effect.reason for effect in effects)


def test_glossy_leaves_turn_on_roughness_metallic() -> None:
    facts = replace(FACTS, glossy="laurel")
    effects = plan_effects(BakeSettings(), facts)
    assert is_on(effects, "roughness_metallic") is True
    assert "'laurel'" in next(effect.reason for effect in effects if effect.name == "roughness_metallic")
    assert plan_channels(BakeSettings(), facts) == ("normals", "orm")
    assert plan_channels(BakeSettings(effects="roughness_metallic,pruning"), FACTS) == ("orm",)
    assert plan_channels(BakeSettings(effects="none"), facts) == ()


def test_translucent_leaves_turn_on_translucency() -> None:
    facts = replace(FACTS, engine="babylon", translucent="lime")
    effects = plan_effects(BakeSettings(engine="babylon"), facts)
    assert is_on(effects, "translucency") is True
    [reason] = [effect.reason for effect in effects if effect.name == "translucency"]
    assert reason == "light may come from anywhere in babylon, and the material 'lime' is translucent"
    assert plan_channels(BakeSettings(), facts) == ("normals", "translucency")
    assert plan_channels(BakeSettings(effects="normals"), facts) == ("normals",)


@pytest.mark.parametrize("effect", ["occlusion", "self_shadowing"])
def test_occlusion_shares_its_texture_with_roughness_metallic(effect: str) -> None:
    assert plan_channels(BakeSettings(effects=effect), FACTS) == ("orm",)
    effects = plan_effects(BakeSettings(effects=effect), FACTS)
    assert first_on(effects, ("roughness_metallic", "occlusion", "self_shadowing")) == effect
    assert (
        first_on(plan_effects(BakeSettings(effects="none"), FACTS), ("roughness_metallic", "occlusion"))
        == "roughness_metallic"
    )


def test_a_single_leaf_is_not_pruned() -> None:
    effects = plan_effects(BakeSettings(chain="both"), replace(FACTS, leaves=1))
    assert states(effects)["pruning"] is False


@pytest.mark.parametrize("camera", [None, Camera(((2.0, 100.0),), View(), moves=True)])
@pytest.mark.parametrize(("leaf", "pruned"), [(0.079, True), (0.081, False)])
def test_chain_both_prunes_only_leaves_that_are_small_enough(leaf: float, pruned: bool, camera: Camera | None) -> None:
    """Leaves below 16 pixels are pruned. Level 1 takes over where 0.04 R is 8 pixels, so a leaf of 0.08 R is 16."""
    facts = replace(FACTS, area=FACTS.leaves * leaf**2, camera=camera)
    plan = {effect.name: effect for effect in plan_effects(BakeSettings(chain="both"), facts)}
    assert (plan["pruning"].on, plan["contrast"].on) == (pruned, pruned)
    if not pruned and camera is None:
        assert plan["pruning"].reason == "the error bound 0.04 lets level 1 take over before any leaf is pruned"


@pytest.mark.parametrize(
    ("asked", "on"),
    [
        ("all", BY_ALL),
        ("none", {"far_levels"}),
        ("pruning", {"pruning", "far_levels"}),
        ("back_sides, transitions", {"back_sides", "transitions", "far_levels"}),
    ],
)
def test_a_list_forces_effects_on_and_off(asked: str, on: set[str]) -> None:
    effects = plan_effects(BakeSettings(effects=asked), FACTS)
    assert {name for name, state in states(effects).items() if state} == on
    assert None not in states(effects).values()
    # Even with `all` the plan decides about alpha blending.
    assert all(asked in effect.reason for effect in effects if (asked, effect.name) != ("all", "blend_order"))


@pytest.mark.parametrize(
    ("asked", "changed"),
    [
        ("auto,+occlusion,-normals", {"occlusion": True, "normals": False}),
        ("+pruning", {"pruning": True}),
        ("+roughness_metallic", {"roughness_metallic": True}),
        ("auto,+back_sides", {"back_sides": True}),
    ],
)
def test_signed_names_override_the_plan(asked: str, changed: dict[str, bool]) -> None:
    planned = states(plan_effects(BakeSettings(), FACTS))
    forced = plan_effects(BakeSettings(effects=asked), FACTS)
    assert states(forced) == planned | changed
    reasons = {effect.name: effect.reason for effect in forced}
    assert all(f"`effects={'+' if on else '-'}{name}`" in reasons[name] for name, on in changed.items())


def test_signed_names_override_a_list_and_all() -> None:
    some = states(plan_effects(BakeSettings(effects="pruning,+roughness_metallic,-far_levels"), FACTS))
    assert {name for name, on in some.items() if on} == {"pruning", "roughness_metallic"}
    most = states(plan_effects(BakeSettings(effects="all,-leaf_map"), FACTS))
    assert {name for name, on in most.items() if on} == BY_ALL - {"leaf_map"}


def test_a_chain_that_prunes_needs_the_effect_pruning() -> None:
    with pytest.raises(SettingsError, match="needs the effect pruning, which is off"):
        BakeSettings(chain="both", effects="auto,-pruning")
    assert BakeSettings(chain="both", effects="none,+pruning").chain == "both"


def test_the_baked_levels_decide_about_back_sides() -> None:
    planned = plan_effects(BakeSettings(), FACTS)
    [decision] = [each for each in planned if each.name == "back_sides"]
    assert BACK_SIDES.settled(decision, chain_with_sides(False, False)).on is False
    kept = BACK_SIDES.settled(decision, chain_with_sides(True, False, True))
    assert kept.on is True
    assert "1, 3" in kept.reason


def test_the_baked_levels_do_not_change_a_forced_effect() -> None:
    planned = plan_effects(BakeSettings(effects="all"), FACTS)
    [decision] = [each for each in planned if each.name == "back_sides"]
    assert BACK_SIDES.settled(decision, chain_with_sides(False)) == decision


def test_an_unknown_effect_raises() -> None:
    with pytest.raises(KeyError):
        is_on(plan_effects(BakeSettings(), FACTS), "glitter")


def test_a_level_hands_over_shortly_before_its_transition_ends() -> None:
    """Level 1 appears at a = 0.998. It is there, and the leaves are gone, 8 % farther away."""
    leaves, first, *_ = lod_ranges((0.0, 10.0, 40.0, 100.0), (FADE, BOTH, BOTH, FADE), transitions=True)
    assert (leaves.appear, leaves.start, leaves.end, leaves.fade_in_end) == (0.0, 5.0, 10.0, 0.0)
    assert (first.appear, first.start, first.end) == (pytest.approx(9.99), leaves.vanish, 40.0)
    assert leaves.fade_out_start == first.appear
    assert leaves.vanish == first.fade_in_end == pytest.approx(1.08 * 9.99)


def test_the_cross_impostor_fades_in_while_the_last_cloud_fades_out() -> None:
    *_, second, cross = lod_ranges((0.0, 10.0, 40.0, 100.0), (FADE, BOTH, BOTH, FADE), transitions=True)
    assert (second.start, second.end) == (math.inf, math.inf)
    assert (second.fade_out_start, second.vanish) == (100.0, pytest.approx(115.0))
    assert cross == LodRange(100.0, math.inf, math.inf, math.inf, pytest.approx(115.0), fade_out_start=math.inf)
    assert [second.fades, cross.fades] == [True, True]


def test_a_trunk_switches_at_the_start_of_a_fade_and_fades_into_the_cross_impostor() -> None:
    ranges = lod_ranges((0.0, 10.0, 40.0, 100.0), (FADE, BOTH, BOTH, FADE), transitions=True)
    leaves, first, second = (trunk_range(ranges, number) for number in range(3))
    assert [leaves.fades, first.fades, second.fades] == [False, False, True]
    assert (leaves.vanish, first.appear) == (ranges[1].appear, ranges[1].appear)
    assert (first.vanish, second.appear, second.fade_in_end) == (ranges[2].appear,) * 3
    assert (second.fade_out_start, second.vanish) == (100.0, pytest.approx(115.0))


def test_simplified_leaves_take_over_without_a_fade() -> None:
    """A fade would draw them twice in the same place, where each copy would shade the other."""
    leaves, simplified, cloud = lod_ranges((0.0, 10.0, 40.0), (FADE, HandOverKind.MORPH, BOTH), transitions=True)
    assert (leaves.start, leaves.end, leaves.vanish, simplified.appear) == (5.0, 10.0, 10.0, 10.0)
    assert not leaves.fades
    assert (simplified.start, simplified.end, cloud.appear) == (10.0, 40.0, pytest.approx(39.94))
    assert simplified.vanish == cloud.fade_in_end > cloud.appear == simplified.fade_out_start


def test_few_trees_of_a_plantation_are_drawn_twice() -> None:
    """Trees on a plane between two distances are as many as the difference of their squares."""
    ranges = lod_ranges((0.0, 4.0, 8.0, 16.0, 30.0), (FADE, HandOverKind.MORPH, BOTH, BOTH, BOTH), transitions=True)
    twice = sum(each.vanish**2 - then.appear**2 for each, then in pairwise(ranges))
    assert 0.0 < twice / 50.0**2 < 0.1


def test_without_transitions_levels_switch_at_once() -> None:
    leaves, first, cross = lod_ranges((0.0, 10.0, 40.0), (FADE, BOTH, FADE), transitions=False)
    assert [leaves.vanish, first.appear, first.vanish, cross.appear] == [10.0, 10.0, 40.0, 40.0]
    assert not any(lod_range.fades for lod_range in (leaves, first, cross))


def test_a_transition_starts_after_the_previous_level_has_vanished() -> None:
    leaves, first, second = lod_ranges((0.0, 10.0, 12.5), (FADE, BOTH, BOTH), transitions=True)
    assert first.start == leaves.vanish > 6.25
    assert first.start < second.appear < first.end == 12.5


def test_a_coarser_level_never_takes_over_before_a_finer_one() -> None:
    assert rising((0.0, 10.0, 8.0, 20.0)) == (0.0, 10.0, 12.5, 20.0)
    leaves, first, second = lod_ranges(rising((0.0, 10.0, 8.0)), (FADE, BOTH, BOTH), transitions=True)
    assert leaves.appear < first.appear < first.fade_in_end == leaves.vanish < second.appear <= 12.5


def test_every_effect_is_a_file_with_a_tooltip() -> None:
    folder = Path(addon.effects.__file__).parent
    assert set(EFFECTS) == {file.stem for file in folder.glob("*.py")} - {"__init__"}
    assert [effect.name for effect in all_effects()] == list(EFFECTS)
    assert all(effect.about and not effect.about.endswith(".") for effect in all_effects())
    assert len({effect.about for effect in all_effects()}) == len(EFFECTS)


def test_viewer_camera_without_a_camera_gives_a_note() -> None:
    settings = BakeSettings(viewer="camera")
    note = camera_note(settings, FACTS, plan_effects(settings, FACTS))
    assert note is not None
    assert note.text == "no camera of the scene sees the tree, so all levels are made"
    assert camera_note(BakeSettings(), FACTS, plan_effects(BakeSettings(), FACTS)) is None


def test_viewer_camera_with_an_engine_gives_a_note() -> None:
    settings = BakeSettings(viewer="camera", engine="three")
    note = camera_note(settings, FACTS, plan_effects(settings, FACTS))
    assert note is not None
    assert note.text == "`engine=three` may show the tree from anywhere, so all levels are made"
