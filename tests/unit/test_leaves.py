"""Detection of leaves: by given names, by telling names, by many small components."""

from __future__ import annotations

import numpy as np
import pytest

from addon.plan.leaves import LeavesError, MaterialPart, choose_leaves, is_any_tree, says_leaf


def never(index: int) -> np.ndarray:
    raise AssertionError("components are counted although the names tell")


def sizes(*of_parts: list[int]):
    return lambda index: np.array(of_parts[index], np.int64)


SAY_LEAF = [
    *("leaf", "Leaves", "LEAF_01", "oak_leaves.001", "leaflet", "cloverleaf", "PineNeedles", "pineneedle2"),
    *("fern frond", "FoliageMat", "mapleLeafMaterial", "leaves-branch-01-1", "M_Foliage", "leafCard", "frondlet"),
]


@pytest.mark.parametrize("name", SAY_LEAF)
def test_telling_names_are_recognized(name: str) -> None:
    assert says_leaf(name)


@pytest.mark.parametrize("name", ["", "bark", "branches", "trunk", "overleafing", "leafless_twigs", "relief", "lea f"])
def test_other_names_are_not_recognized(name: str) -> None:
    assert not says_leaf(name)


def test_given_names_choose_objects_and_materials() -> None:
    parts = [
        MaterialPart("tree", "green", 10),
        MaterialPart("tree", "brown", 10),
        MaterialPart("crown", "x", 5),
        MaterialPart("rock", "", 3),
    ]
    choice = choose_leaves(parts, ["green", "crown"], never)
    assert choice.indices == (0, 2)
    assert choice.reason == "'tree' (material 'green'), 'crown': named by the user ('green', 'crown')."


def test_given_name_of_an_object_takes_all_its_slots() -> None:
    parts = [MaterialPart("tree", "leaf", 10), MaterialPart("tree", "bark", 10), MaterialPart("rock", "bark", 5)]
    assert choose_leaves(parts, ["tree"], never).indices == (0, 1)


def test_given_name_of_an_instancer_takes_its_instances() -> None:
    parts = [MaterialPart("card", "a", 10, "crown"), MaterialPart("card", "a", 10, "hedge")]
    assert choose_leaves(parts, ["crown"], never).indices == (0,)


def test_an_unknown_name_lists_all_names() -> None:
    parts = [MaterialPart("tree", "leaf", 10), MaterialPart("tree", "bark", 10), MaterialPart("rock", "", 5)]
    with pytest.raises(LeavesError) as caught:
        choose_leaves(parts, ["leaf", "leafs"], never)
    assert str(caught.value) == (
        "no object or material is named 'leafs'; objects: 'tree', 'rock'; materials: 'leaf', 'bark'"
    )


def test_case_counts_only_between_names_that_differ_by_it() -> None:
    parts = [MaterialPart("Crown", "", 10), MaterialPart("crown", "", 10), MaterialPart("Needles", "", 5)]
    assert choose_leaves(parts, ["crown"], never).indices == (1,)
    assert choose_leaves(parts, ["NEEDLES"], never).indices == (2,)
    assert choose_leaves(parts, ["CROWN"], never).indices == (0, 1)


def test_telling_material_splits_an_object() -> None:
    parts = [MaterialPart("tree", "leaf", 10), MaterialPart("tree", "bark", 10)]
    choice = choose_leaves(parts, None, never)
    assert choice.indices == (0,)
    assert choice.reason == "'tree' (material 'leaf'): the names contain leaf, leaves, foliage, needle or frond."


def test_telling_material_is_finer_than_a_telling_object() -> None:
    parts = [
        MaterialPart("oak_leaves", "leaf_a", 10),
        MaterialPart("oak_leaves", "bark", 10),
        MaterialPart("leaves.001", "bark", 4),
    ]
    assert choose_leaves(parts, [], never).indices == (0, 2)


def test_telling_object_and_instancer() -> None:
    parts = [MaterialPart("Foliage", "a", 10), MaterialPart("trunk", "b", 10), MaterialPart("card", "c", 10, "leaves")]
    choice = choose_leaves(parts, None, never)
    assert choice.indices == (0, 2)
    assert choice.reason.startswith("'Foliage', 'card': the names contain")


def test_many_small_components_are_leaves() -> None:
    parts = [MaterialPart("a", "", 40), MaterialPart("b", "", 960)]
    choice = choose_leaves(parts, None, sizes([2] * 20, [60] * 16))
    assert choice.indices == (0,)
    assert choice.reason == "'a': 20 small components (the median has 2 triangles), and there are no leaf names."


def test_twigs_are_coarser_than_leaves() -> None:
    # As in the ez-tree oak: 5320 cards of 2 triangles, 140 twigs of mostly 6.
    parts = [MaterialPart("a", "", 840), MaterialPart("b", "", 10640)]
    assert choose_leaves(parts, None, sizes([6] * 140, [2] * 5320)).indices == (1,)


def test_parts_of_one_kind_are_counted_together() -> None:
    # As in the Shapespark tree: five kinds of twig cards with few components each, and a trunk.
    parts = [MaterialPart(name, "", 1) for name in "abct"]
    assert choose_leaves(parts, None, sizes([8] * 8, [16, 8, 8, 8], [8] * 5, [222])).indices == (0, 1, 2)


@pytest.mark.parametrize("of_parts", [([2] * 15, [400]), ([33] * 100, [400]), ([], [12])])
def test_few_or_large_components_need_a_name(of_parts: tuple[list[int], ...]) -> None:
    parts = [MaterialPart("a", "m", 1), MaterialPart("b", "", 1)]
    with pytest.raises(LeavesError) as caught:
        choose_leaves(parts, None, sizes(*of_parts))
    assert str(caught.value) == (
        "no object or material name contains a word for leaves, and no part is made of many small components; "
        "name the leaves in `leaves`; objects: 'a', 'b'; materials: 'm'"
    )


def test_a_thousand_names_still_make_one_line() -> None:
    parts = [MaterialPart(f"object{i}", "", 1) for i in range(1000)]
    with pytest.raises(LeavesError) as caught:
        choose_leaves(parts, ["x"], never)
    assert str(caught.value).endswith("'object11' and 988 more; materials: none")


@pytest.mark.parametrize("name", ["leaves", "Leaves.001", "mesh_0", "Needles", "Plane.003", "1"])
def test_a_name_of_any_tree_tells_none(name: str) -> None:
    assert is_any_tree(name)


@pytest.mark.parametrize("name", ["Oak", "oak_leaves", "Shrub", "leaves_of_grass", "planet"])
def test_a_name_of_a_tree_is_kept(name: str) -> None:
    assert not is_any_tree(name)
