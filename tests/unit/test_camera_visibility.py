"""The levels that cameras see, and the estimated costs of effects, both without Blender."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from addon.plan.camera_visibility import camera_visibility, latest_switches, pixels_of, soonest_switches
from addon.plan.costs import with_costs
from addon.plan.decision import Decision, is_on
from addon.plan.effects import plan_effects, plan_levels
from addon.plan.facts import Camera, Facts, Lights
from addon.plan.lod_range import View
from addon.plan.rates import BYTES_PER_TEXEL
from addon.settings.bake import BakeSettings
from addon.settings.effects import EFFECTS

VIEW = View(resolution=1000.0, field_of_view=math.pi / 2.0)
"""At the distance d a length of 2 d is seen 1000 pixels large."""

FACTS = Facts("generic", leaves=100, vertices=400, triangles=200, trunk=50, radius=2.0, area=4.0)
SETTINGS = BakeSettings(epsilon=0.08, pixels=10.0, levels=2)
# A length of 0.16 covers 10 pixels at distance 8, so level 1 starts there. Level 2 starts at 28, the cross at 50.


def seen_from(*spans: tuple[float, float]) -> Facts:
    return replace(FACTS, camera=Camera(spans, VIEW))


def test_levels_switch_once_their_error_bounds_cover_few_pixels() -> None:
    assert soonest_switches(SETTINGS, FACTS, VIEW) == pytest.approx((0.0, 8.0, 28.0, 50.0))
    assert soonest_switches(replace(SETTINGS, cross=False), FACTS, VIEW) == pytest.approx((0.0, 8.0, 28.0))


def test_the_cross_replaces_pruned_leaves_once_almost_none_are_kept() -> None:
    pruning = replace(SETTINGS, chain="pruning", prune_pixels=10.0)
    # A leaf of side 0.2 covers 10 pixels at distance 10. Half of the leaves are kept at 20, 0.5% at 2000.
    assert soonest_switches(pruning, FACTS, VIEW) == pytest.approx((0.0, 2000.0))


@pytest.mark.parametrize(
    ("span", "first", "last", "passed"),
    [
        ((3.0, 3.5), 0, 0, ()),
        ((3.0, 4.5), 0, 0, (1,)),
        ((7.0, 7.0), 0, 0, ()),
        ((9.0, 12.0), 1, 1, (2,)),
        ((9.0, 30.0), 1, 2, (2,)),
        ((30.0, 40.0), 2, 2, ()),
        ((1.0, 1000.0), 0, 3, (1, 2, 3)),
        ((60.0, 1000.0), 3, 3, ()),
    ],
)
def test_a_camera_sees_the_levels_for_its_distances(
    span: tuple[float, float], first: int, last: int, passed: tuple[int, ...]
) -> None:
    seen = camera_visibility(SETTINGS, seen_from(span))
    assert seen is not None
    assert (seen.first, seen.last, seen.passed) == (first, last, passed)


@pytest.mark.parametrize("settings", [{"texture_size": 256}, {"max_billboards": 10}, {"max_texels": 10_000}])
def test_a_change_of_level_that_may_come_later_is_planned_for(settings: dict[str, int]) -> None:
    """A texel of 8 R / 256 covers a pixel at 31.25. A budget allows a deviation of R, which covers 10 pixels at 100."""
    wanted = replace(SETTINGS, **settings)
    latest = latest_switches(wanted, FACTS, VIEW)
    assert latest[1] == pytest.approx(31.25 if "texture_size" in settings else 100.0)
    assert latest_switches(SETTINGS, FACTS, VIEW) == soonest_switches(SETTINGS, FACTS, VIEW)
    seen = camera_visibility(wanted, seen_from((9.0, 30.0)))
    assert seen is not None
    assert (seen.first, seen.last, seen.passed) == (0, 2, (1, 2))
    transitions = {effect.name: effect for effect in plan_effects(wanted, seen_from((9.0, 30.0)))}["transitions"]
    assert transitions.on
    assert transitions.reason.endswith(f"level 1 takes over between 4 and {latest[1] / 2:.3g}")


def test_near_and_far_trees_are_seen_on_different_levels() -> None:
    seen = camera_visibility(SETTINGS, seen_from((3.0, 3.0), (40.0, 40.0)))
    assert seen is not None
    assert (seen.first, seen.last, seen.passed) == (0, 2, ())


def test_a_viewer_anywhere_may_see_any_level() -> None:
    assert camera_visibility(SETTINGS, FACTS) is None


def test_a_length_covers_pixels_in_proportion_to_its_angle() -> None:
    assert pixels_of(2.0, 1.0, VIEW) == pytest.approx(1000.0)
    assert pixels_of(2.0, 10.0, VIEW) == pytest.approx(100.0)
    assert pixels_of(2.0, 0.0, VIEW) == math.inf


@pytest.mark.parametrize(
    ("away", "effects", "made"),
    [
        (3.0, "auto", (1, False)),
        (9.0, "auto", (1, False)),
        (30.0, "auto", (2, False)),
        (60.0, "auto", (2, True)),
        (3.0, "+far_levels", (2, True)),
        (3.0, "none", (2, True)),
        (30.0, "none,-far_levels", (2, False)),
    ],
)
def test_a_bake_makes_only_visible_levels(away: float, effects: str, made: tuple[int, bool]) -> None:
    settings, facts = replace(SETTINGS, effects=effects), seen_from((away, away))
    assert plan_levels(settings, facts, plan_effects(settings, facts)) == made


def test_the_cross_is_made_behind_pruned_leaves_though_it_is_not_seen() -> None:
    settings, facts = replace(SETTINGS, chain="pruning", effects="-far_levels"), seen_from((3.0, 3.0))
    assert plan_levels(settings, facts, plan_effects(settings, facts)) == (0, True)


@pytest.mark.parametrize(("away", "pruned"), [(6.0, False), (6.5, True)])
def test_pruning_starts_once_leaves_cover_few_pixels(away: float, pruned: bool) -> None:
    # A leaf of side 0.2 covers 16 pixels at distance 6.25.
    effects = plan_effects(replace(SETTINGS, chain="both"), seen_from((away, away)))
    assert (is_on(effects, "pruning"), is_on(effects, "contrast")) == (pruned, pruned)


def test_light_is_baked_for_unlit_targets_without_moving_lights() -> None:
    unlit = replace(SETTINGS, unlit=True)
    sun = replace(FACTS, lights=Lights(("Sun",)))
    assert is_on(plan_effects(unlit, sun), "baked_light")
    assert not is_on(plan_effects(SETTINGS, sun), "baked_light")
    moving = replace(FACTS, lights=Lights(("Lamp",), "the lamp 'Lamp' moves or changes"))
    assert not is_on(plan_effects(unlit, moving), "baked_light")
    forced = plan_effects(replace(unlit, effects="-baked_light"), sun)
    assert not is_on(forced, "baked_light")


def costs(settings: BakeSettings) -> dict[str, Decision]:
    return {effect.name: effect for effect in with_costs(settings, FACTS, plan_effects(settings, FACTS))}


def test_effects_that_are_off_have_no_estimated_cost() -> None:
    assert all((e.seconds, e.bytes) == (0.0, 0) for e in costs(replace(SETTINGS, effects="none,-far_levels")).values())


def test_a_texture_costs_four_bytes_a_texel_of_all_pages() -> None:
    texels = 256 * 256 + 128 * 128 + 64 * 64
    expected = costs(replace(SETTINGS, texture_size=256, effects="all"))
    for name, images in [
        ("normals", 1),
        ("translucency", 1),
        ("leaf_map", 2),
        ("roughness_metallic", 1),
        ("occlusion", 0),
    ]:
        assert expected[name].bytes == images * BYTES_PER_TEXEL * texels, name
    assert expected["far_levels"].bytes == BYTES_PER_TEXEL * (texels - 256 * 256)


def test_occlusion_without_roughness_metallic_pays_for_the_image_that_they_share() -> None:
    alone = costs(replace(SETTINGS, texture_size=256, effects="none,+occlusion"))
    assert alone["occlusion"].bytes == BYTES_PER_TEXEL * (256 * 256 + 128 * 128 + 64 * 64)


def test_an_undecided_effect_is_estimated_as_if_it_were_on() -> None:
    assert costs(SETTINGS)["back_sides"].bytes > 0


@pytest.mark.parametrize(("name", "amount"), [("transitions", 40 * 400), ("pruning", 16 * 400), ("trunk_levels", 1)])
def test_more_of_a_tree_costs_more(name: str, amount: int) -> None:
    settings, twice = replace(SETTINGS, effects="all"), replace(FACTS, vertices=800, triangles=400, trunk=100)
    [larger] = [e for e in with_costs(settings, twice, plan_effects(settings, twice)) if e.name == name]
    assert larger.bytes - costs(settings)[name].bytes >= amount
    assert larger.seconds > costs(settings)[name].seconds


def test_the_rules_cover_every_effect_in_order() -> None:
    assert tuple(effect.name for effect in plan_effects(SETTINGS, FACTS)) == EFFECTS
