"""Levels of another tool by their names, else by their form."""

from __future__ import annotations

import numpy as np
import pytest

from addon.plan.other_levels import Extent, coarser, coarser_by_form, level_in


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


def part(
    triangles: int, *, size: float = 1.0, area: float = 10.0, flat: bool = False, material: str = "leaf"
) -> Extent:
    """Return a part in a cube around the origin; `flat`: without an extent along y."""
    corner = size * np.array([1.0, 0.0 if flat else 1.0, 1.0])
    return Extent(np.array([-corner, corner]), area, triangles, frozenset([material]))


def test_coarser_levels_fill_the_same_box_by_fewer_triangles() -> None:
    assert coarser_by_form([part(100), part(60, size=0.99), part(20, area=8.0)]) == [1, 2]


@pytest.mark.parametrize(
    "other",
    [
        *(part(40, size=0.5), part(40, area=3.0), part(40, material="twig"), part(90)),
        part(60),  # Leaves of another size in the same crown.
        part(2, flat=True),  # A picture is one only beside other levels.
    ],
)
def test_other_parts_of_a_tree_are_no_levels(other: Extent) -> None:
    assert coarser_by_form([part(100), other]) == []


def test_a_picture_beside_levels_is_one() -> None:
    parts = [part(100), part(60), part(20), part(2, area=1.0, flat=True, material="picture"), part(12, size=0.5)]
    assert coarser_by_form(parts) == [1, 2, 3]
