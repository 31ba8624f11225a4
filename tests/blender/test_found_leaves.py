"""The search for leaves, in small plants of many kinds: the script that makes them knows which triangles are leaves."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from plants_of_parts import CROWN, KINDS, cards, found_in
from scenes import add_mesh, read

from addon.mesh.extract import extract

RIGHT = 0.85


@pytest.mark.parametrize("kind", KINDS)
def test_no_leaves_are_wrong_in_silence(kind: str) -> None:
    assert found_in(kind).outcome != "wrong"


def test_most_leaves_are_found_without_a_question() -> None:
    outcomes = [found_in(kind).outcome for kind in KINDS]
    assert outcomes.count("right") >= RIGHT * len(outcomes)


def test_coarser_levels_of_another_tool_are_left_out() -> None:
    points, faces = cards()
    coarse, few = cards(40)
    meshes = (("Oak_LOD0", points, faces), ("Oak_LOD1", coarse, few), ("Oak_Billboard", coarse, few))
    objects = [add_mesh(name, own.tolist(), of) for name, own, of in meshes]
    tree = read(objects, None)
    assert len(tree.leaves.triangles) == 2 * len(faces)
    assert tree.warnings == ["'Oak_Billboard', 'Oak_LOD1': left out, coarser levels of another tool"]
    assert len(read(objects, ["Oak_LOD1"]).leaves.triangles) == 2 * len(few), "a name of leaves decides first"
    assert set(tree.sources) == set(objects), "the bake hides them"


def test_a_leaf_far_away_is_left_out_and_named() -> None:
    points, faces = cards()
    far = [tuple(CROWN + np.array([50.0, y, z])) for y, z in ((0.0, 0.0), (0.3, 0.0), (0.0, 0.3))]
    obj = add_mesh("leaves", [*points.tolist(), *far], [*faces, tuple(range(len(points), len(points) + 3))])
    tree = extract(bpy.context.evaluated_depsgraph_get(), [obj])
    assert len(tree.leaves.triangles) == 2 * len(faces)
    assert tree.leaves.positions[:, 0].max() < 10.0
    [warning] = tree.warnings
    assert warning.startswith("leaf triangles left out: 1 of 601. The farthest lies ")
