"""Levels of another tool by their names."""

from __future__ import annotations

import pytest

from addon.plan.other_levels import coarser, level_in


@pytest.mark.parametrize(
    ("name", "number"),
    [
        *(("Oak_LOD0", 0), ("Oak_lod2", 2), ("LOD1", 1), ("Tree.LOD3.001", 3), ("Oak LOD 1", 1), ("Oak_LOD_12", 12)),
        *(("Melody2", None), ("Oak_LODGroup", None), ("Oak", None), ("Oak_LOD1b", None), ("explode 3", None)),
    ],
)
def test_numbers_of_levels(name: str, number: int | None) -> None:
    assert level_in([name]) == number


def test_the_nearest_name_counts() -> None:
    assert level_in(["leaves", "Oak_LOD1", "LOD2"]) == 1


def test_the_finest_level_is_the_tree() -> None:
    parts = [["Oak_LOD0"], ["Oak_LOD1"], ["bark", "Oak_LOD0"], ["Oak_Billboard"], ["ground"], ["Oak_LOD2", "LODs"]]
    assert coarser(parts) == [1, 3, 5]


@pytest.mark.parametrize("parts", [[["Oak_LOD1"], ["bark"]], [["Oak"], ["Billboard"]], []])
def test_one_number_tells_nothing(parts: list[list[str]]) -> None:
    assert coarser(parts) == []
