"""Detection of leaves: by given names, by telling names, by shapes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from addon.plan.leaves import (
    LeavesError,
    MaterialPart,
    Shape,
    choose_by_names,
    choose_by_shape,
    is_any_tree,
    says_leaf,
    says_wood,
)

Low = tuple[float, float, float]
CROWN, TRUNK = ((-2.0, -2.0, 2.0), (2.0, 2.0, 6.0)), ((-0.2, -0.2, 0.0), (0.2, 0.2, 4.0))


def shape(sizes: list[int], area: float, box: tuple[Low, Low] = CROWN, **more: Any) -> Shape:
    return Shape(np.array(sizes, np.int64), area, *box, **more)


def named_leaves(parts: list[MaterialPart], names: list[str] | None) -> tuple[int, ...]:
    choice = choose_by_names(parts, names)
    assert choice is not None
    return choice.indices


SAY_LEAF = [
    *("leaf", "Leaves", "LEAF_01", "oak_leaves.001", "leaflet", "cloverleaf", "PineNeedles", "pineneedle2"),
    *("Blatt_grün", "Laub", "feuille.001", "Hojas", "Foglie", "листья", "хвоя", "葉", "叶子", "나뭇잎"),
    *("fern frond", "FoliageMat", "mapleLeafMaterial", "leaves-branch-01-1", "M_Foliage", "leafCard", "frondlet"),
]


@pytest.mark.parametrize("name", SAY_LEAF)
def test_telling_names_are_recognized(name: str) -> None:
    assert says_leaf(name)


@pytest.mark.parametrize("name", ["Laubbaum_Stamm", "Urlaub", "針葉樹_幹", "Ствол_лиственницы", "blattlos"])
def test_words_for_trees_are_no_leaves(name: str) -> None:
    assert not says_leaf(name)


def test_a_stone_pine_is_no_stone() -> None:
    parts = [MaterialPart("Stone_Pine", "a", 1), MaterialPart("Stone_Pine", "b", 1)]
    choice = choose_by_shape(parts, [shape([2] * 500, 20.0), shape([120], 4.0, TRUNK)])
    assert (choice.indices, choice.doubt) == ((0,), "")


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
    choice = choose_by_names(parts, ["green", "crown"])
    assert choice is not None
    assert choice.indices == (0, 2)
    assert choice.reason == "'tree' (material 'green'), 'crown': named by the user ('green', 'crown')."


def test_given_name_of_an_object_takes_all_its_slots() -> None:
    parts = [MaterialPart("tree", "leaf", 10), MaterialPart("tree", "bark", 10), MaterialPart("rock", "bark", 5)]
    assert named_leaves(parts, ["tree"]) == (0, 1)


def test_given_name_of_an_instancer_takes_its_instances() -> None:
    parts = [MaterialPart("card", "a", 10, "crown"), MaterialPart("card", "a", 10, "hedge")]
    assert named_leaves(parts, ["crown"]) == (0,)


def test_an_unknown_name_lists_all_names() -> None:
    parts = [MaterialPart("tree", "leaf", 10), MaterialPart("tree", "bark", 10), MaterialPart("rock", "", 5)]
    with pytest.raises(LeavesError) as caught:
        choose_by_names(parts, ["leaf", "leafs"])
    assert str(caught.value) == (
        "no object or material is named 'leafs'; objects: 'tree', 'rock'; materials: 'leaf', 'bark'"
    )


def test_case_counts_only_between_names_that_differ_by_it() -> None:
    parts = [MaterialPart("Crown", "", 10), MaterialPart("crown", "", 10), MaterialPart("Needles", "", 5)]
    assert named_leaves(parts, ["crown"]) == (1,)
    assert named_leaves(parts, ["NEEDLES"]) == (2,)
    assert named_leaves(parts, ["CROWN"]) == (0, 1)


def test_telling_material_splits_an_object() -> None:
    parts = [MaterialPart("tree", "leaf", 10), MaterialPart("tree", "bark", 10)]
    choice = choose_by_names(parts, None)
    assert choice is not None
    assert choice.indices == (0,)
    assert choice.reason == "'tree' (material 'leaf'): the names contain a word for leaves."


def test_telling_material_is_finer_than_a_telling_object() -> None:
    parts = [
        MaterialPart("oak_leaves", "leaf_a", 10),
        MaterialPart("oak_leaves", "bark", 10),
        MaterialPart("leaves.001", "bark", 4),
    ]
    assert named_leaves(parts, []) == (0, 2)


def test_telling_object_and_instancer() -> None:
    parts = [MaterialPart("Foliage", "a", 10), MaterialPart("trunk", "b", 10), MaterialPart("card", "c", 10, "leaves")]
    choice = choose_by_names(parts, None)
    assert choice is not None
    assert choice.indices == (0, 2)
    assert choice.reason.startswith("'Foliage', 'card': the names contain")


def test_wood_in_an_object_that_says_leaf_is_wood() -> None:
    parts = [
        MaterialPart("Leaves", "Green", 10),
        MaterialPart("Leaves", "Bark", 10),
        MaterialPart("leaves.1", "wood", 4),
    ]
    assert named_leaves(parts, None) == (0, 2), "an object of wood alone may be what its name says"


@pytest.mark.parametrize(
    "name", ["Bark", "tree_trunk", "M_Wood", "Baumstamm", "Eichenholz", "soil", "Rinde", "Holz", "кора", "樹皮"]
)
def test_words_for_wood_are_recognized(name: str) -> None:
    assert says_wood(name)


@pytest.mark.parametrize("name", ["", "leaf", "Woodland", "stemless", "rocket", "Rocky", "pine_twig", "Green"])
def test_other_words_are_no_wood(name: str) -> None:
    assert not says_wood(name)


def test_names_that_do_not_tell() -> None:
    assert choose_by_names([MaterialPart("a", "b", 1)], None) is None


def test_many_small_components_are_leaves() -> None:
    parts = [MaterialPart("a", "", 40), MaterialPart("b", "", 120)]
    choice = choose_by_shape(parts, [shape([2] * 20, 20.0), shape([120], 4.0, TRUNK)])
    assert choice.indices == (0,)
    assert choice.doubt == ""
    assert choice.reason == (
        "'a': 20 small components (the median has 2 triangles), much of the surface, as wide as the tree, "
        "above the ground; there are no leaf names."
    )


def test_twigs_are_coarser_than_leaves() -> None:
    # As in the ez-tree oak: 5320 cards of 2 triangles, 140 twigs of mostly 6.
    parts = [MaterialPart("a", "", 840), MaterialPart("b", "", 10640)]
    assert choose_by_shape(parts, [shape([6] * 140, 3.0), shape([2] * 5320, 60.0)]).indices == (1,)


def test_parts_of_one_kind_are_counted_together() -> None:
    # As in the Shapespark tree: kinds of twig cards with few components each, and a trunk.
    parts = [MaterialPart(name, "", 1) for name in "abct"]
    cards = [shape([8] * 8, 8.0), shape([16, 8, 8, 8], 5.0), shape([8] * 5, 5.0)]
    assert choose_by_shape(parts, [*cards, shape([222], 2.0, TRUNK)]).indices == (0, 1, 2)


def test_marks_on_the_bark_and_gravel_are_no_leaves() -> None:
    parts = [MaterialPart(name, "", 1) for name in ("blob", "marks", "gravel", "trunk")]
    marks, gravel = shape([2] * 24, 0.1, TRUNK), shape([4] * 100, 1.0, ((-2.0, -2.0, 0.0), (2.0, 2.0, 0.1)))
    blob = shape([192], 20.0, color=(0.1, 0.3, 0.05))
    assert choose_by_shape(parts, [blob, marks, gravel, shape([120], 4.0, TRUNK)]).indices == (0,)


def test_branches_are_no_leaves() -> None:
    parts = [MaterialPart("a", "", 1), MaterialPart("b", "", 1)]
    branches = shape([36] * 8, 2.0, are_rods=True)
    with pytest.raises(LeavesError, match="no part looks like leaves"):
        choose_by_shape(parts, [branches, shape([120], 4.0, TRUNK)])


def test_a_part_in_doubt_is_told() -> None:
    """The second part is wide and above the ground, but has little of the surface."""
    parts = [MaterialPart(name, "", 1) for name in ("crown", "ring", "trunk")]
    crown, trunk = shape([200], 20.0), shape([120], 2.0, TRUNK)
    choice = choose_by_shape(parts, [crown, shape([100], 1.0), trunk])
    assert choice.indices == (0, 1)
    assert choice.doubt == "'ring' may be no leaves"
    narrow = ((-1.0, -1.0, 2.0), (1.0, 1.0, 4.0))
    choice = choose_by_shape(parts, [crown, shape([100], 1.0, narrow), trunk])
    assert (choice.indices, choice.doubt) == ((0,), "'ring' may be leaves, too")


def test_nothing_alone_is_leaves_by_its_size() -> None:
    with pytest.raises(LeavesError) as caught:
        choose_by_shape([MaterialPart("a", "m", 1)], [shape([12], 1.0, ((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0)))])
    assert str(caught.value) == (
        "no object or material name contains a word for leaves, and no part looks like leaves; "
        "name the leaves in `leaves`; objects: 'a'; materials: 'm'"
    )


def test_a_thousand_names_still_make_one_line() -> None:
    parts = [MaterialPart(f"object{i}", "", 1) for i in range(1000)]
    with pytest.raises(LeavesError) as caught:
        choose_by_names(parts, ["x"])
    assert str(caught.value).endswith("'object11' and 988 more; materials: none")


@pytest.mark.parametrize("name", ["leaves", "Leaves.001", "mesh_0", "Needles", "Plane.003", "1"])
def test_a_name_of_any_tree_tells_none(name: str) -> None:
    assert is_any_tree(name)


@pytest.mark.parametrize("name", ["Oak", "oak_leaves", "Shrub", "leaves_of_grass", "planet"])
def test_a_name_of_a_tree_is_kept(name: str) -> None:
    assert not is_any_tree(name)
