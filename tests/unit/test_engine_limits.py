"""A bake warns of parts that the engine's own package or script does not read."""

from __future__ import annotations

import pytest

from addon.export.report import joint_report
from addon.plan.decision import Decision
from addon.plan.engine_limits import UNDRAWN, undrawn_warnings
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


@pytest.mark.parametrize(("engine", "is_refused"), [("unity", True), ("unreal", True), ("three", False)])
def test_engines_that_read_one_tree_a_file_have_a_warning_for_several(engine: str, is_refused: bool) -> None:
    report = {"leafcloud": "0", "blender": "4", "files": [], "warnings": ["small"]}
    warnings = joint_report({"oak": dict(report), "elm": dict(report)}, engine)["warnings"]
    assert warnings[-2:] == ["oak: small", "elm: small"]
    assert any("one tree a file" in warning for warning in warnings) == is_refused
