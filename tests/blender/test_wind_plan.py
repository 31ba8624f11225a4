"""Wind: the rule of the effect, the force fields of the scene, and the dimensions of the tree."""

from __future__ import annotations

import math
from dataclasses import replace

import bpy
import numpy as np
import pytest
from scenes import SQUARE, add_field, add_mesh

from addon.plan.effects import Facts, is_on, plan_effects
from addon.plan.wind import Wind, stature
from addon.scene.wind import wind_on
from addon.settings.bake import BakeSettings

FACTS = Facts(engine="generic", leaves=672)


def reason(facts: Facts) -> str:
    [effect] = [effect for effect in plan_effects(BakeSettings(), facts) if effect.name == "wind"]
    return effect.reason


def add_tree() -> bpy.types.Object:
    return add_mesh("leaves", SQUARE, [(0, 1, 2, 3)])


def blowing(*sources: bpy.types.Object) -> Wind | None:
    bpy.context.view_layer.update()
    return wind_on(sources, bpy.context.scene)


# The plan


def test_only_a_force_field_turns_on_wind() -> None:
    assert is_on(plan_effects(BakeSettings(), FACTS), "wind") is False
    assert reason(FACTS) == "no force field blows on the tree"
    windy = replace(FACTS, wind=Wind(field="Breeze"))
    assert is_on(plan_effects(BakeSettings(), windy), "wind") is True
    assert reason(windy) == "the force field 'Breeze' blows on the tree"
    assert reason(replace(FACTS, wind=Wind(gusts=1.0))) == "turbulence shakes the tree"


def test_the_settings_turn_wind_on_and_off() -> None:
    windy = replace(FACTS, wind=Wind(field="Breeze"))
    assert is_on(plan_effects(BakeSettings(effects="pruning,wind"), FACTS), "wind") is True
    assert is_on(plan_effects(BakeSettings(effects="pruning"), windy), "wind") is False


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"direction": (1.0, 1.0, 0.0)}, "it must be of length 1"),
        ({"direction": (math.nan, 0.0, 0.0)}, "it must be of length 1"),
        ({"strength": math.inf}, "strength is inf, it must be finite"),
        ({"gusts": 1.1}, r"gusts is 1\.1, it must be in \[0, 1\]"),
    ],
)
def test_a_wind_out_of_range_is_refused(values: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Wind(**values)


# The scene


def test_there_is_no_wind_without_a_force_field() -> None:
    tree = add_tree()
    assert blowing(tree) is None
    add_field("VORTEX", strength=5.0)
    add_field("WIND", "Calm", strength=0.0)
    assert blowing(tree) is None
    assert blowing() is None


def test_wind_blows_along_the_axis_of_its_field() -> None:
    field = add_field("WIND", strength=3.0)
    field.rotation_euler = (math.pi / 2.0, 0.0, 0.0)
    field.scale = (2.0, 3.0, 4.0)
    found = blowing(add_tree())
    assert (found.strength, found.gusts, found.field) == (3.0, 0.5, "Breeze")
    assert found.direction == pytest.approx((0.0, -1.0, 0.0), abs=1e-6)


def test_turbulence_and_noise_are_gusts() -> None:
    tree = add_tree()
    add_field("WIND", strength=4.0, noise=1.0)
    add_field("TURBULENCE", "Eddy", strength=3.0)
    # Half of the field's 4 is constant. The other half, the noise of 1 and the turbulence of 3 are gusts.
    assert blowing(tree).gusts == pytest.approx((2.0 + 1.0 + 3.0) / (4.0 + 1.0 + 3.0))


def test_turbulence_alone_shakes_the_tree() -> None:
    add_field("TURBULENCE", "Eddy", strength=3.0)
    assert blowing(add_tree()) == Wind((1.0, 0.0, 0.0), 3.0, 1.0, None)


def test_the_strongest_field_is_used() -> None:
    add_field("WIND", "Weak", strength=1.0)
    add_field("WIND", "Strong", strength=-5.0)
    found = blowing(add_tree())
    assert (found.field, found.strength) == ("Strong", -5.0)


@pytest.mark.parametrize(("distance", "acts"), [(9.0, True), (11.0, False)])
def test_a_field_acts_up_to_its_maximum_distance(distance: float, acts: bool) -> None:
    field = add_field("WIND", strength=2.0, use_max_distance=True, distance_max=10.0)
    field.location = (distance, 0.0, 0.0)
    assert (blowing(add_tree()) is not None) == acts


def test_a_field_that_is_hidden_or_in_another_scene_is_ignored() -> None:
    tree, field = add_tree(), add_field("WIND", strength=2.0)
    assert blowing(tree) is not None
    field.hide_render = True
    assert blowing(tree) is None
    field.hide_render = False
    bpy.context.scene.collection.objects.unlink(field)
    bpy.data.scenes.new("Other").collection.objects.link(field)
    assert blowing(tree) is None


def test_effector_weights_select_the_fields() -> None:
    tree, field = add_tree(), add_field("WIND", strength=2.0)
    weights = tree.modifiers.new("Cloth", "CLOTH").settings.effector_weights
    assert blowing(tree) is not None
    weights.wind = 0.0
    assert blowing(tree) is None
    weights.wind, weights.collection = 1.0, bpy.data.collections.new("Fields")
    assert blowing(tree) is None
    weights.collection.objects.link(field)
    assert blowing(tree) is not None


# The tree


def test_the_foot_is_the_lowest_part_of_the_trunk() -> None:
    trunk = np.float32([[2.0, 1.0, -1.0], [2.2, 1.2, -1.0], [2.1, 1.1, 8.0]])
    crown = np.float32([[2.1, 5.1, 4.0], [2.1, 1.1, 15.0], [-0.9, 1.1, 9.0]])
    found = stature(crown, trunk, np.eye(4))
    assert found.foot == pytest.approx((2.1, 1.1, -1.0), abs=1e-6)
    assert found.up == (0.0, 0.0, 1.0)
    assert (found.height, found.spread) == pytest.approx((16.0, 4.0))
    assert found.period == pytest.approx(0.8 * 4.0)


def test_the_foot_of_a_tree_without_trunk_is_below_its_leaves() -> None:
    crown = np.float32([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [1.0, 3.0, 10.0]])
    found = stature(crown, None, np.eye(4))
    assert found.foot == pytest.approx((1.0, 0.0, 0.0))
    assert found.spread == pytest.approx(3.0)


def test_up_is_the_up_axis_of_the_world() -> None:
    """The tree grows along its Y axis, scaled by 2. Lengths are in its own units. The period is for its world size."""
    matrix = np.array([[2.0, 0.0, 0.0, 9.0], [0.0, 0.0, -2.0, 9.0], [0.0, 2.0, 0.0, 9.0], [0.0, 0.0, 0.0, 1.0]])
    found = stature(np.float32([[0.0, 0.0, 0.0], [1.0, 8.0, 0.0]]), np.float32([[0.0, 0.0, 0.0]]), matrix)
    assert found.up == pytest.approx((0.0, 1.0, 0.0))
    assert (found.height, found.spread) == pytest.approx((8.0, 1.0))
    assert found.period == pytest.approx(0.8 * 4.0)


@pytest.mark.parametrize("points", [[[1.0, 2.0, 3.0]], [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0]]])
def test_a_flat_tree_has_a_height_and_a_spread(points: list[list[float]]) -> None:
    found = stature(np.float32(points), None, np.eye(4))
    assert found.height > 0.0
    assert found.spread > 0.0
    assert found.period > 0.0
