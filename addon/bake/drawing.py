"""What the levels of a bake cost to draw, by the core's model, compared with the leaves at the same distance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import leafcloud

from ..levels.building import BuiltLevel
from ..levels.results import LevelResult, level_name
from ..plan.camera_visibility import pixels_of
from ..plan.lod_range import View
from .values import Baked


@dataclass(frozen=True)
class LevelDrawing:
    """What a level costs to draw at the distance where it takes over. For LOD 0 that is the distance of level 1.

    crown_pixels: diameter of the crown's sphere in pixels there. own, trunk: the level and its trunk; None without a
    trunk. before: the level before it there, without its trunk; for LOD 0 itself. leaves, leaves_trunk: LOD 0 there.
    """

    crown_pixels: float
    own: leafcloud.DrawingCost
    trunk: leafcloud.DrawingCost | None
    before: leafcloud.DrawingCost
    leaves: leafcloud.DrawingCost
    leaves_trunk: leafcloud.DrawingCost | None

    @property
    def cheaper(self) -> float:
        """How many times cheaper the level is to draw than LOD 0, both with their trunks."""
        return _total(self.leaves, self.leaves_trunk) / _total(self.own, self.trunk)


def drawing_costs(baked: Baked) -> list[LevelDrawing]:
    """Return the costs of every level, LOD 0 first."""
    drawn = [baked.prepared.foliage, *map(_drawn, baked.chain.levels)]
    trunks = level_trunks(baked)

    @cache
    def leaves(number: int, scale: float) -> leafcloud.DrawingCost:
        level = drawn[number]
        if isinstance(level, leafcloud.OctahedralLevel):
            return level.drawing_cost(scale)
        return leafcloud.drawing_cost([level], scale)

    @cache
    def trunk(number: int, scale: float) -> leafcloud.DrawingCost | None:
        part = trunks[number]
        return None if part is None else leafcloud.drawing_cost([part], scale)

    def cost(number: int) -> LevelDrawing:
        scale = pixels_of(1.0, baked.switch_distances[max(number, 1)], baked.view)
        return LevelDrawing(
            crown_pixels=2.0 * baked.prepared.foliage.radius * scale,
            own=leaves(number, scale),
            trunk=trunk(number, scale),
            before=leaves(max(number - 1, 0), scale),
            leaves=leaves(0, scale),
            leaves_trunk=trunk(0, scale),
        )

    return [cost(number) for number in range(len(drawn))]


def _drawn(level: leafcloud.AnyLevel) -> leafcloud.Foliage | leafcloud.OctahedralLevel:
    """Return the level's foliage, or the level itself if it is an octahedral impostor."""
    return level if isinstance(level, leafcloud.OctahedralLevel) else level.foliage()


def level_trunks(baked: Baked) -> list[leafcloud.Foliage | None]:
    """Return the trunk of each level, LOD 0 first; None for a level without one."""
    came, part = baked.prepared.trunk, baked.prepared.trunk_part

    def trunk(level: BuiltLevel) -> leafcloud.Foliage | None:
        if part is None or level.trunk is None:
            return None
        return came if level.trunk_corners is None else part.of(level.trunk_corners).foliage()

    return [trunk(level) for level in baked.levels]


def level_results(baked: Baked, costs: Sequence[LevelDrawing]) -> list[LevelResult]:
    """Return the figures of every level for the sidebar, LOD 0 first. `costs`: of every level."""

    def texture(level: leafcloud.AnyLevel) -> tuple[int, int]:
        if isinstance(level, leafcloud.LeafLevel):
            return 0, 0
        page = level.color if isinstance(level, leafcloud.OctahedralLevel) else level.base_color
        return page.shape[1], page.shape[0]

    leaves = baked.levels[0]
    results = [LevelResult("Leaves", leaves.triangles + leaves.trunk_triangles, 1.0, (0, 0), 0.0, 0.0)]
    later = zip(baked.chain.levels, baked.levels[1:], costs[1:], baked.switch_distances[1:], strict=True)
    for number, (level, built, cost, distance) in enumerate(later, start=1):
        triangles = level.triangles if isinstance(level, leafcloud.OctahedralLevel) else built.triangles
        results.append(
            LevelResult(
                level_name(level, number),
                triangles + built.trunk_triangles,
                cost.cheaper,
                texture(level),
                level.image_error,
                distance,
            )
        )
    return results


def left_out_reasons(chain: leafcloud.Chain) -> list[str]:
    """Return why each level was left out that the chain did not make, one sentence each."""
    reasons = []
    for each in chain.left_out:
        epsilon = each["epsilon"]
        kind = "the cross impostor" if epsilon is None else f"a cloud with the error bound {epsilon:.3g}"
        reasons.append(
            f"{kind} was left out: where the crown is as high as {View().of_height(each['crown_pixels'])}, it costs as "
            f"much as {each['cost']['total']:,.0f} fragments, and the level before it {each['before']['total']:,.0f}, "
            "but it must save a tenth; `every_level` makes it"
        )
    return reasons


def needs_no_levels(costs: list[LevelDrawing]) -> str | None:
    """Return a note if no level saves enough of the cost of drawing the leaves, else None. `costs`: of every level."""
    if any(each.cheaper * (1.0 - leafcloud.LEAST_SAVING) > 1.0 for each in costs[1:]):
        return None
    return "the tree needs no levels: no level saves a tenth of the cost of drawing its leaves"


def _total(leaves: leafcloud.DrawingCost, trunk: leafcloud.DrawingCost | None) -> float:
    return leaves["total"] + (0.0 if trunk is None else trunk["total"])
