"""A bake warns of parts that the engine's own package or script does not read."""

from __future__ import annotations

from addon.plan.decision import Decision
from addon.plan.engine_limits import UNDRAWN, several_trees_warnings, undrawn_warnings
from addon.plan.registry import effect_named
from addon.settings.choices import ENGINES
from addon.settings.flags import with_flags


def decisions(*on: str) -> list[Decision]:
    return [Decision(name, name in on, "a reason") for name in ("wind", "pruning", "normals")]


def test_each_effect_that_is_not_drawn_has_a_warning_with_its_flag() -> None:
    first, second = map(with_flags, undrawn_warnings("bevy", decisions("wind", "pruning")))
    assert "Bevy" in first
    assert "--effects=-wind" in first
    assert "--effects=-pruning" in second


def test_effects_that_are_off_or_drawn_have_none() -> None:
    assert undrawn_warnings("bevy", decisions("normals")) == []
    assert undrawn_warnings("three", decisions("wind", "pruning")) == []


def test_the_names_are_those_of_engines_and_effects() -> None:
    assert set(UNDRAWN) <= set(ENGINES)
    assert all(effect_named(name).name == name for names in UNDRAWN.values() for name in names)


def test_engines_that_read_one_tree_a_file_have_a_warning_for_several() -> None:
    for engine in ("unity", "unreal"):
        [warning] = several_trees_warnings(engine, 2)
        assert engine.title() in warning
        assert several_trees_warnings(engine, 1) == []
    assert several_trees_warnings("three", 2) == []
