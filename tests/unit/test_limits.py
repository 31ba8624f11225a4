"""Each number has one range: the settings of a bake and the core accept and refuse the same values."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import leafcloud
from addon.settings.bake import BakeSettings, described
from addon.settings.setting import SettingsError

ROOT = Path(__file__).resolve().parents[2]
FOLIAGE = leafcloud.Foliage(
    np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1]], float),
    np.array([[0, 1, 2], [3, 4, 5]]),
)
CORE_NAMES = {"bend_normals": "normals", "prune_pixels": "leaf_pixels"}
"""Names of the core's options that differ from the settings'."""
WITH: dict[str, dict[str, Any]] = {
    "image_epsilon": {"viewing_distance": 2.0},
    "viewing_distance": {"image_epsilon": 1.0},
    "max_size": {"epsilon": 1e-9},
    "scene": {"quality": 0.5},
    "memory_budget": {"quality": 0.5},
}
"""Settings that others need."""
NUMBERS = [each for each in described() if each.setting.limits is not None and not each.setting.many]


def ends(limits: leafcloud.Setting, low: float) -> tuple[list[float], list[float]]:
    """Return the values just inside and just outside both ends of a range."""
    inner = [next_to(low, math.inf) if limits.above else low]
    inner.append(next_to(limits.high, -math.inf) if limits.below else limits.high)
    return inner, [low if limits.above else less(low), limits.high if limits.below else -less(-limits.high)]


def next_to(value: float, toward: float) -> float:
    return value + int(math.copysign(1, toward)) if isinstance(value, int) else math.nextafter(value, toward)


def less(value: float) -> float:
    """Return a smaller number. Single precision must distinguish the two, because the core keeps some numbers in it."""
    return value - 1 if isinstance(value, int) else value - 1e-6 * (abs(value) or 1.0)


def settings_message(**settings: Any) -> str:
    """Return the message that refuses the settings, or an empty text."""
    try:
        BakeSettings(**settings)
    except SettingsError as error:
        return str(error)
    return ""


def core_message(**options: Any) -> str:
    """Return the core's message that refuses the options, or an empty text.

    The core builds levels only as far as the first report of progress: it checks all options before.
    """
    try:
        leafcloud.build_chain(FOLIAGE, progress=lambda stage, fraction: False, **options)
    except leafcloud.CancelledError:
        return ""
    except leafcloud.LeafcloudError as error:
        return str(error)
    raise AssertionError("the core does not report progress")


@pytest.mark.parametrize("name", [each.name for each in NUMBERS])
def test_settings_and_core_have_the_same_ends(name: str) -> None:
    core_name, given = CORE_NAMES.get(name, name), WITH.get(name, {})
    core = leafcloud.SETTINGS[core_name]
    pruned = {"keep": 0.5} if name in ("prune_pixels", "prune_half") else {}
    low = 1 if name == "levels" else core.low  # The core allows 0 levels before a cross impostor.
    inside, outside = ends(core, low)
    for value in inside:
        assert settings_message(**{name: value}, **given) == ""
        assert core_message(**{core_name: value}, **given, **pruned) == ""
    for value in outside:
        assert settings_message(**{name: value}, **given).startswith(f"`{name}` is ")
        if (name, value) != ("levels", 0):
            assert re.match(rf"`?{core_name}`? is ", core_message(**{core_name: value}, **given, **pruned)), value


@pytest.mark.parametrize("name", ["epsilon", "candidates", "gather", "max_size", "compact", "image_epsilon", "seed"])
def test_the_core_fits_at_both_ends(name: str) -> None:
    core = leafcloud.SETTINGS[name]
    for value in ends(core, core.low)[0]:
        cloud = leafcloud.fit(FOLIAGE, **{name: value, **WITH.get(name, {})})
        assert len(cloud.parents) == 2
        assert np.isfinite(cloud.planes).all()


def test_the_number_of_views_has_one_limit() -> None:
    most = int(leafcloud.SETTINGS["views"].high)
    views = ((1.0, 0.0, 0.0),) * most
    assert settings_message(views=views) == core_message(views=views) == ""
    for message in (settings_message, core_message):
        assert f"`views` has {most + 1} directions" in message(views=(*views, views[0]))


def test_defaults_are_those_of_the_core() -> None:
    for each in NUMBERS:
        # The core bends no normals unless it is asked for normals. Its texture size is the largest if none is set.
        # `quality` chooses the error bound and the pixels.
        if each.name not in ("bend_normals", "texture_size", "epsilon", "pixels"):
            assert each.default == leafcloud.SETTINGS[CORE_NAMES.get(each.name, each.name)].default, each.name


def test_settings_cannot_be_changed() -> None:
    with pytest.raises(TypeError):
        leafcloud.SETTINGS["epsilon"] = None  # type: ignore[index]
    with pytest.raises(AttributeError):
        leafcloud.SETTINGS["epsilon"].low = 0.0  # type: ignore[misc]


@pytest.mark.parametrize(
    ("file", "constant", "value"),
    [
        ("shaders/leafcloud.glsl", "LC_RAMP", leafcloud.RAMP),
        ("engines/three/src/laws.js", "HAND_OVER", leafcloud.HAND_OVER),
        ("engines/bevy/src/laws.rs", "HAND_OVER", leafcloud.HAND_OVER),
    ],
)
def test_shaders_have_the_constants_of_the_core(file: str, constant: str, value: float) -> None:
    """Shaders and packages for engines run without the wheel, so they have copies."""
    text = (ROOT / file).read_text(encoding="utf-8")
    found = re.findall(rf"const (?:float )?{constant}(?:: f32)? = ([\d.]+);", text)
    assert [float(number) for number in found] == [value]
