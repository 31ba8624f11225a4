"""Settings refuse what cannot be followed, in one line that names flag, value, limit and default."""

from __future__ import annotations

import inspect
import math

import numpy as np
import pytest

import leafcloud
from addon.settings import BakeSettings, SettingsError, fit_options


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
        ("method", "guess"),
        ("effort", "huge"),
        ("max_billboards", 0),
        ("max_texels", 10),
        ("max_size", 0.01),
        ("compact", 0.0),
        ("max_corners", 2),
        ("vertical", 1.5),
        ("facing_views", -0.1),
        ("image_epsilon", 2.0),
        ("viewing_distance", 0.5),
        ("engine", "quake"),
        ("chain", "cross"),
        ("prune_pixels", 0.0),
        ("prune_half", 0.6),
        ("effects", "transitions,glitter"),
        ("effects", ""),
        ("effects", "+glitter"),
        ("effects", "auto,pruning"),
        ("viewer", "nowhere"),
    ],
)
def test_a_value_outside_its_range_is_refused(name: str, value: object) -> None:
    with pytest.raises(SettingsError) as refusal:
        BakeSettings(**{name: value})
    message = str(refusal.value)
    assert message.startswith(f"--{name.replace('_', '-')} is {value!r}, it must be ")
    assert "the default is " in message
    assert "\n" not in message


@pytest.mark.parametrize(
    "effects",
    [
        "auto",
        "all",
        "none",
        "pruning",
        "transitions, back_sides",
        "auto,+gloss,-normals",
        "-pruning",
        "pruning,+gloss",
        "all, -leaf_map",
    ],
)
def test_effects_may_be_a_choice_or_a_list(effects: str) -> None:
    assert BakeSettings(effects=effects).effects == effects


def test_settings_that_need_each_other() -> None:
    with pytest.raises(SettingsError, match="kmeans"):
        BakeSettings(method="kmeans")
    with pytest.raises(SettingsError, match="--image-epsilon"):
        BakeSettings(viewing_distance=2.0)
    assert BakeSettings(method="kmeans", max_billboards=20).max_billboards == 20


def test_the_fitters_options_are_the_wheels() -> None:
    documented = inspect.signature(BakeSettings)
    options = fit_options(BakeSettings(max_billboards=7))
    assert options["max_billboards"] == 7
    assert set(options) <= set(documented.parameters)
    positions = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], float)
    foliage = leafcloud.Foliage(positions, np.array([[0, 1, 2]]))
    assert len(leafcloud.fit(foliage, **options).planes) == 1
