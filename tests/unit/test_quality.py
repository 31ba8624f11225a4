"""Quality: where levels take over by how they look, without Blender."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from addon.plan.camera_visibility import latest_switches, soonest_switches
from addon.plan.facts import Facts
from addon.plan.lod_range import View
from addon.plan.quality import allowed_difference, core_wishes, crowns, distance_of, quality_warnings
from addon.settings.bake import BakeSettings

VIEW = View(resolution=1000.0, field_of_view=math.pi / 2.0)
"""At the distance d a length of 2 d is seen 1000 pixels large."""
FACTS = Facts("generic", leaves=100, vertices=400, triangles=200, trunk=50, radius=2.0, area=4.0)


def taken(size: float, *, passes: bool = True) -> Any:
    return {"crown_pixels": size, "passes": passes, "judged": {"by": "contrast", "excess": 1.6}}


def test_the_middle_is_a_light_breeze_and_the_ends_are_twice_and_half_of_it() -> None:
    assert [allowed_difference(quality) for quality in (0.0, 0.5, 1.0)] == [2.0, 1.0, 0.5]


def test_a_sphere_appears_as_large_as_its_distance_says() -> None:
    # At distance 20 the view is 40 high, so a sphere of diameter 4 covers 100 of 1000 pixels.
    assert distance_of(100.0, 2.0, VIEW) == pytest.approx(20.0)


def test_a_level_that_looks_different_is_named_unless_it_is_too_small_to_see() -> None:
    levels = [
        SimpleNamespace(method="stochastic"),
        SimpleNamespace(method="stochastic"),
        SimpleNamespace(method="cross"),
    ]
    sizes = [taken(300.0), taken(40.0, passes=False), taken(10.0, passes=False)]
    chain: Any = SimpleNamespace(levels=levels, takes_over=sizes)
    [warning] = quality_warnings(chain)
    assert warning.startswith("level 2 does not look like the leaves even at 3.7 % of the picture's height")
    assert "by its contrast: 1.6 times what `quality` allows" in warning


def test_wished_sizes_are_fractions_of_the_picture_and_others_are_measured() -> None:
    sizes = [taken(540.0), taken(100.0)]
    assert crowns(BakeSettings(), sizes, VIEW) == [540.0, 100.0]
    assert crowns(BakeSettings(sizes=(0.25,)), sizes, VIEW) == [250.0, 100.0]


def test_set_pixels_replace_quality() -> None:
    assert core_wishes(BakeSettings(pixels=8.0), "auto", twigs=True) == {}


def test_engines_whose_packages_draw_shares_are_judged_so() -> None:
    generic, three = (core_wishes(BakeSettings(engine=engine), "auto", twigs=True) for engine in ("generic", "three"))
    assert (generic["shares"], three["shares"]) == (False, True)
    assert (generic["scene"], generic["memory_budget"], generic["quality"]) == (50.0, 4.0, 0.5)


def test_levels_take_over_between_half_of_the_picture_and_a_dot() -> None:
    settings = BakeSettings()
    soonest, latest = soonest_switches(settings, FACTS, VIEW), latest_switches(settings, FACTS, VIEW)
    # A crown of diameter 4 covers 540 pixels at distance 3.7, and 7.8 at 256.4.
    assert soonest[1:3] == pytest.approx((2000.0 / 540.0, 2000.0 / 180.0))
    assert latest[1] == pytest.approx(256.4, rel=1e-3)
    assert all(soon <= late for soon, late in zip(soonest, latest, strict=True))
