"""An invalid setting raises one line with the setting, its value, the limit and the default."""

from __future__ import annotations

import inspect
import math

import numpy as np
import pytest

import leafcloud
from addon.settings.bake import BakeSettings, described
from addon.settings.fit_options import fit_options
from addon.settings.flags import parse, settings_of
from addon.settings.notes import notes
from addon.settings.setting import Limits, SettingsError


def test_the_defaults_match_the_command_line() -> None:
    settings = BakeSettings()
    assert (settings.epsilon, settings.candidates, settings.levels, settings.seed) == (None, 600, 3, 0)
    assert (settings.texture_size, settings.cross, settings.method, settings.chain) == (
        None,
        True,
        "stochastic",
        "billboards",
    )
    assert (settings.effects, settings.engine, settings.pixels, settings.quality) == ("auto", "generic", None, 0.5)
    assert (settings.error_bound, settings.switch_pixels) == (0.04, 8.0)


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
        ("scene", 1.0),
        ("memory_budget", 0.0),
        ("sizes", (2.0,)),
        ("sizes", (0.1, 0.4)),
        ("sizes", (0.5, 0.4, 0.3, 0.2, 0.1)),
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
    assert message.startswith(f"`{name}` is {value!r}, it must be ")
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
        "auto,+roughness_metallic,-normals",
        "-pruning",
        "pruning,+roughness_metallic",
        "all, -leaf_map",
    ],
)
def test_effects_may_be_a_choice_or_a_list(effects: str) -> None:
    assert BakeSettings(effects=effects).effects == effects


def test_settings_that_depend_on_each_other_are_checked_together() -> None:
    with pytest.raises(SettingsError, match="`method=kmeans` needs `max_billboards`"):
        BakeSettings(method="kmeans")
    with pytest.raises(SettingsError, match="`image_epsilon` and `viewing_distance` need each other"):
        BakeSettings(viewing_distance=2.0)
    with pytest.raises(SettingsError, match="`chain=pruning` and `cross=False` exclude each other"):
        BakeSettings(chain="pruning", cross=False)
    with pytest.raises(SettingsError, match="`sizes` needs `quality`"):
        BakeSettings(sizes=(0.5,), pixels=8.0)
    with pytest.raises(SettingsError, match="`sizes` makes clouds"):
        BakeSettings(sizes=(0.5,), form="leaves")
    assert BakeSettings(method="kmeans", max_billboards=20).max_billboards == 20


def refusal_of_fit(**options: object) -> str:
    """Return the core's error message for fit options. At least one option must be invalid."""
    foliage = leafcloud.Foliage(np.eye(3), np.array([[0, 1, 2]]))
    with pytest.raises(leafcloud.LeafcloudError) as refusal:
        leafcloud.fit(foliage, **options)  # type: ignore[arg-type]
    return str(refusal.value)


def test_every_fit_setting_reaches_the_core() -> None:
    """The core names an option of a wrong type. So an option that is lost on the way is not named."""
    wrong = object()
    of_fit = [each.name for each in described() if "unknown option" not in refusal_of_fit(**{each.name: wrong})]
    assert {"epsilon", "views", "seed", "whole_leaves"} <= set(of_fit)
    assert "levels" not in of_fit
    for name in of_fit:
        settings = BakeSettings()
        object.__setattr__(settings, name, wrong)
        assert refusal_of_fit(**fit_options(settings)).startswith(f"{name} is <object"), name


def test_settings_that_may_have_no_effect_are_reported() -> None:
    assert notes(BakeSettings(epsilon=0.1, facing_views=0.5, views=((0.0, 0.0, 1.0),))) == []
    assert notes(BakeSettings(facing_views=0.5)) == ["`facing_views` has no effect without `views`"]
    [note] = notes(BakeSettings(preset="draft", epsilon=0.1, effort="best", texture_size=512))
    assert note == "`preset` may replace `epsilon` and `effort` by other values"


@pytest.mark.parametrize(
    ("limits", "inside", "outside", "words"),
    [
        (Limits(1, 8), (1, 8), (0, 9), "from 1 to 8"),
        (Limits(256), (256, 10**9), (255,), "at least 256"),
        (Limits(0, above=True), (1e-9, 1e9), (0.0, -1.0, math.inf, math.nan), "greater than 0 and finite"),
        (Limits(0, 1, above=True), (0.5, 1.0), (0.0, 1.1, math.nan), "greater than 0 and at most 1"),
        (Limits(0, 1, above=True, below=True), (0.5,), (0.0, 1.0), "greater than 0 and less than 1"),
    ],
)
def test_limits_accept_values_in_range_and_describe_the_range(
    limits: Limits, inside: tuple[float, ...], outside: tuple[float, ...], words: str
) -> None:
    assert all(limits.hold(value) for value in inside)
    assert not any(limits.hold(value) for value in outside)
    assert str(limits) == words


def test_every_setting_has_a_flag_and_a_description() -> None:
    assert settings_of(parse([])) == BakeSettings()
    assert [each.name for each in described()] == list(inspect.signature(BakeSettings).parameters)
    for each in described():
        assert each.setting.about, each.name
        assert each.type is bool or each.setting.unit, each.name
        assert each.default is not None or each.setting.unset, each.name


def test_flags_set_the_settings() -> None:
    flags = [
        "--epsilon",
        "0.1",
        "--no-cross",
        "--whole-leaves",
        "--max-billboards",
        "9",
        "--views=-1,0,0",
        "--views",
        "0,1,0",
    ]
    settings = settings_of(parse([*flags, "--facing-views", "0.5", "--engine", "godot"]))
    assert settings == BakeSettings(
        epsilon=0.1,
        cross=False,
        whole_leaves=True,
        max_billboards=9,
        views=((-1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
        facing_views=0.5,
        engine="godot",
    )
