"""Quality: targets, and where levels take over by their pictures, without Blender."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import pytest

from addon.plan.camera_visibility import latest_switches, soonest_switches
from addon.plan.facts import Facts
from addon.plan.lod_range import View
from addon.plan.quality import core_target, distance_of, quality_warnings, switch_sizes, target_error
from addon.settings.bake import BakeSettings

VIEW = View(resolution=1000.0, field_of_view=math.pi / 2.0)
"""At the distance d a length of 2 d is seen 1000 pixels large."""
FACTS = Facts("generic", leaves=100, vertices=400, triangles=200, trunk=50, radius=2.0, area=4.0)


@dataclass
class Errors:
    """Stand-in for `leafcloud.ImageErrors` with a known largest size."""

    largest: float | None
    sizes: tuple[float, ...] = (7.8, 15.6)
    errors: tuple[float, ...] = (0.09, 0.2)

    def largest_size(self, target: float) -> float | None:
        return self.largest


@dataclass
class Level:
    measured: Errors
    cloud: Any = None

    @property
    def method(self) -> str:
        return "cross" if self.cloud is None else "stochastic"

    def image_errors(self, target: float) -> Errors:
        return self.measured


def test_the_middle_is_unnoticed_and_the_ends_are_three_times_more_and_less() -> None:
    assert [target_error(quality) for quality in (0.0, 0.5, 1.0)] == pytest.approx([0.18, 0.06, 0.02])
    assert target_error(0.5, number=2) == pytest.approx(0.08)


def test_a_sphere_appears_as_large_as_its_distance_says() -> None:
    # At distance 20 the view is 40 high, so a sphere of diameter 4 covers 100 of 1000 pixels.
    assert distance_of(100.0, 2.0, VIEW) == pytest.approx(20.0)


def test_no_level_takes_over_at_a_larger_size_than_400_pixels() -> None:
    levels: Any = [Level(Errors(math.inf, errors=(0.01, 0.01)), cloud="cloud")]
    [found] = switch_sizes(BakeSettings(), levels)
    assert found.size == 400.0


def test_a_level_that_misses_its_target_takes_over_at_the_smallest_size_with_a_warning() -> None:
    levels: Any = [Level(Errors(100.0, errors=(0.01, 0.02)), cloud="cloud"), Level(Errors(None))]
    found = switch_sizes(BakeSettings(), levels)
    assert [each.size for each in found] == [100.0, 7.8]
    [warning] = quality_warnings(found, levels)
    assert warning.startswith("level 2 has an image error of 0.09 even where the crown is 8 pixels large")
    assert "`quality` allows 0.08" in warning
    assert "`cross=False`" in warning


def test_set_pixels_replace_quality() -> None:
    levels: Any = [Level(Errors(None))]
    settings = BakeSettings(pixels=8.0)
    assert switch_sizes(settings, levels) == ()
    assert quality_warnings((), levels) == []
    assert core_target(settings) is None


@pytest.mark.parametrize("other", [{"seconds": 5.0}, {"image_error": 0.1}, {"preset": "draft"}, {"chain": "both"}])
def test_wishes_and_other_chains_decide_the_error_bound_themselves(other: dict[str, Any]) -> None:
    assert core_target(BakeSettings(**other)) is None
    assert core_target(BakeSettings()) == pytest.approx(0.06)


def test_levels_take_over_between_the_largest_and_the_smallest_picture() -> None:
    settings = BakeSettings()
    soonest, latest = soonest_switches(settings, FACTS, VIEW), latest_switches(settings, FACTS, VIEW)
    # A crown of diameter 4 covers 400 pixels at distance 5, and 7.8 at 256.4.
    assert soonest[1] == pytest.approx(5.0)
    assert latest[1] == pytest.approx(256.4, rel=1e-3)
    assert all(soon <= late for soon, late in zip(soonest, latest, strict=True))
    coarse = replace(settings, epsilon=0.08)  # A length of 0.16 covers 8 pixels at 10.
    assert soonest_switches(coarse, FACTS, VIEW)[1] == pytest.approx(10.0)
