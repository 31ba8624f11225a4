"""The plan of the effects, and from how far each level is drawn: decided without Blender."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from addon.plan.effects import Effect, first_on, is_on, plan_channels, plan_effects, settle_back_sides
from addon.plan.facts import Facts
from addon.plan.reach import HAND_OVER, Reach, reaches, rising
from addon.settings import MOVING_LIGHT, BakeSettings, SettingsError

FACTS = Facts(engine="generic", leaves=672)


def states(effects: tuple[Effect, ...]) -> dict[str, bool | None]:
    return {effect.name: effect.on for effect in effects}


def test_auto_turns_on_what_a_free_camera_calls_for() -> None:
    effects = plan_effects(BakeSettings(), FACTS)
    assert states(effects) == {
        "transitions": True,
        "pruning": True,
        "back_sides": None,
        "trunk_levels": False,
        "far_levels": True,
        "normals": True,
        "gloss": False,
        "translucency": False,
        "occlusion": False,
        "self_shadowing": False,
        "leaf_map": False,
        "contrast": False,
        "baked_light": False,
    }
    assert all(effect.reason for effect in effects)


def test_glossy_leaves_call_for_gloss() -> None:
    facts = replace(FACTS, glossy="laurel")
    effects = plan_effects(BakeSettings(), facts)
    assert is_on(effects, "gloss") is True
    assert "'laurel'" in next(effect.reason for effect in effects if effect.name == "gloss")
    assert plan_channels(BakeSettings(), facts) == ("normals", "gloss")
    assert plan_channels(BakeSettings(effects="gloss,pruning"), FACTS) == ("gloss",)
    assert plan_channels(BakeSettings(effects="none"), facts) == ()


def test_leaves_that_let_light_through_call_for_translucency() -> None:
    facts = replace(FACTS, engine="babylon", translucent="lime")
    effects = plan_effects(BakeSettings(engine="babylon"), facts)
    assert is_on(effects, "translucency") is True
    [reason] = [effect.reason for effect in effects if effect.name == "translucency"]
    assert reason == "light may come from anywhere in babylon, and it shines through the material 'lime'"
    assert plan_channels(BakeSettings(), facts) == ("normals", "translucency")
    assert plan_channels(BakeSettings(effects="normals"), facts) == ("normals",)


@pytest.mark.parametrize("effect", ["occlusion", "self_shadowing"])
def test_occlusion_shares_its_texture_with_gloss(effect: str) -> None:
    assert plan_channels(BakeSettings(effects=effect), FACTS) == ("gloss",)
    effects = plan_effects(BakeSettings(effects=effect), FACTS)
    assert first_on(effects, ("gloss", "occlusion", "self_shadowing")) == effect
    assert first_on(plan_effects(BakeSettings(effects="none"), FACTS), ("gloss", "occlusion")) == "gloss"


def test_one_leaf_is_not_pruned() -> None:
    effects = plan_effects(BakeSettings(), replace(FACTS, leaves=1))
    assert states(effects)["pruning"] is False


@pytest.mark.parametrize(
    ("asked", "on"),
    [
        ("all", set(MOVING_LIGHT)),
        ("none", {"far_levels"}),
        ("pruning", {"pruning", "far_levels"}),
        ("back_sides, transitions", {"back_sides", "transitions", "far_levels"}),
    ],
)
def test_the_settings_force_effects_on_and_off(asked: str, on: set[str]) -> None:
    effects = plan_effects(BakeSettings(effects=asked), FACTS)
    assert {name for name, state in states(effects).items() if state} == on
    assert None not in states(effects).values()
    assert all(asked in effect.reason for effect in effects)


@pytest.mark.parametrize(
    ("asked", "changed"),
    [
        ("auto,+occlusion,-normals", {"occlusion": True, "normals": False}),
        ("-pruning", {"pruning": False}),
        ("+gloss", {"gloss": True}),
        ("auto,+back_sides", {"back_sides": True}),
    ],
)
def test_single_effects_are_forced_over_the_plan(asked: str, changed: dict[str, bool]) -> None:
    planned = states(plan_effects(BakeSettings(), FACTS))
    forced = plan_effects(BakeSettings(effects=asked), FACTS)
    assert states(forced) == planned | changed
    assert all(asked in effect.reason for effect in forced if effect.name in changed)


def test_names_and_all_may_be_followed_by_exceptions() -> None:
    some = states(plan_effects(BakeSettings(effects="pruning,+gloss,-far_levels"), FACTS))
    assert {name for name, on in some.items() if on} == {"pruning", "gloss"}
    most = states(plan_effects(BakeSettings(effects="all,-leaf_map"), FACTS))
    assert {name for name, on in most.items() if on} == set(MOVING_LIGHT) - {"leaf_map"}


def test_a_chain_that_prunes_wants_pruning() -> None:
    with pytest.raises(SettingsError, match="with pruning"):
        BakeSettings(chain="both", effects="auto,-pruning")
    assert BakeSettings(chain="both", effects="none,+pruning").chain == "both"


def test_back_sides_are_settled_by_what_the_levels_kept() -> None:
    planned = plan_effects(BakeSettings(), FACTS)
    assert is_on(settle_back_sides(planned, []), "back_sides") is False
    kept = settle_back_sides(planned, [1, 3])
    assert is_on(kept, "back_sides") is True
    assert "1, 3" in kept[2].reason
    assert (kept[:2], kept[3:]) == (planned[:2], planned[3:])


def test_a_forced_effect_is_not_settled_again() -> None:
    planned = plan_effects(BakeSettings(effects="all"), FACTS)
    assert settle_back_sides(planned, []) == planned


def test_an_effect_that_is_not_planned_has_no_state() -> None:
    with pytest.raises(KeyError):
        is_on(plan_effects(BakeSettings(), FACTS), "glitter")


def test_levels_hand_over_shortly_before_their_transitions_end() -> None:
    leaves, first, second, cross = reaches((0.0, 10.0, 40.0, 100.0), (True, True, False, False))
    assert leaves == Reach(appear=0.0, start=5.0, end=10.0, vanish=5.0 + HAND_OVER * 5.0)
    assert first == Reach(appear=leaves.vanish, start=20.0, end=40.0, vanish=20.0 + HAND_OVER * 20.0)
    assert second == Reach(appear=first.vanish, start=math.inf, end=math.inf, vanish=100.0)
    assert cross == Reach(appear=100.0, start=math.inf, end=math.inf, vanish=math.inf)


def test_a_transition_does_not_begin_before_its_level_appears() -> None:
    leaves, first, _ = reaches((0.0, 10.0, 12.0), (True, True, False))
    assert first.start == leaves.vanish > 6.0
    assert leaves.vanish < first.vanish < 12.0


def test_a_coarser_level_never_takes_over_before_a_finer_one() -> None:
    assert rising((0.0, 10.0, 8.0, 20.0)) == (0.0, 10.0, 12.5, 20.0)
    leaves, first, second = reaches(rising((0.0, 10.0, 8.0)), (True, True, False))
    assert leaves.vanish < first.vanish == second.appear <= 12.5
