"""Settings refuse what cannot be followed, in one line that names flag, value, limit and default."""

from __future__ import annotations

import math

import pytest

from addon.settings import BakeSettings, SettingsError


def test_the_defaults_are_those_of_the_promised_command_line() -> None:
    settings = BakeSettings()
    assert (settings.epsilon, settings.candidates, settings.levels, settings.seed) == (0.04, 600, 2, 0)
    assert (settings.texture_size, settings.cross, settings.method, settings.chain) == (
        2048,
        True,
        "stochastic",
        "billboards",
    )
    assert (settings.effects, settings.engine, settings.pixels) == ("auto", "generic", 8.0)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("epsilon", 0.0),
        ("epsilon", -0.04),
        ("epsilon", 1.5),
        ("epsilon", math.nan),
        ("candidates", 0),
        ("levels", 0),
        ("levels", 9),
        ("seed", -1),
        ("texture_size", 8),
        ("pixels", 0.0),
        ("pixels", math.inf),
        ("method", "kmeans"),
        ("engine", "quake"),
        ("chain", "both"),
        ("effects", "transitions,glitter"),
        ("effects", ""),
    ],
)
def test_a_value_outside_its_range_is_refused(name: str, value: object) -> None:
    with pytest.raises(SettingsError) as refusal:
        BakeSettings(**{name: value})
    message = str(refusal.value)
    assert message.startswith(f"--{name.replace('_', '-')} is {value!r}, it must be ")
    assert "the default is " in message
    assert "\n" not in message


@pytest.mark.parametrize("effects", ["auto", "all", "none", "pruning", "transitions, back_sides"])
def test_effects_may_be_a_choice_or_a_list(effects: str) -> None:
    assert BakeSettings(effects=effects).effects == effects
