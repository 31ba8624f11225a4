"""Planting: how many trees an object gets, where copies stand, and what a scale does."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from lod_scenes import FOUR, build, place
from mathutils import Matrix, Vector
from scenes import add_mesh

from addon.levels.planting import (
    MOST,
    apply_scale,
    area_of,
    free_place,
    is_ground,
    is_scaled,
    may_apply_scale,
    usual_density,
    width_of,
)
from addon.mesh.baked_levels import EXTRAS
from addon.nodes.laws import NEVER
from addon.nodes.lod import LodSettings, add_lod_modifier


def square(side: float) -> bpy.types.Object:
    return add_mesh("ground", [(0, 0, 0), (side, 0, 0), (side, side, 0), (0, side, 0)], [(0, 1, 2, 3)])


def test_the_area_is_that_of_the_faces_in_the_world() -> None:
    ground = square(3.0)
    assert area_of(ground) == pytest.approx(9.0)
    ground.matrix_world = Matrix.Diagonal((2.0, 5.0, 1.0, 1.0))
    assert area_of(ground) == pytest.approx(90.0)
    assert area_of(bpy.data.objects.new("empty", None)) == 0.0


def test_trees_touch_their_neighbors() -> None:
    """Two kinds of trees, 2 and 4 wide, each on half of the places: the mean square of the widths is 10."""
    assert usual_density(400.0, [2.0]) == 0.25
    assert usual_density(400.0, [2.0, 4.0]) == pytest.approx(0.1)
    assert usual_density(1e9, [2.0]) * 1e9 == pytest.approx(MOST)
    assert [usual_density(0.0, [2.0]), usual_density(400.0, []), usual_density(400.0, [0.0])] == [0.0, 0.0, 0.0]


def test_the_width_of_a_tree_is_that_of_its_leaves() -> None:
    """The leaves reach over [0, 6] in both horizontal axes."""
    collection = bpy.data.collections.new("tree")
    obj = bpy.data.objects.new("level", build(FOUR))
    obj[EXTRAS] = {"level": 0}
    collection.objects.link(obj)
    assert width_of(collection) == pytest.approx(np.ptp(FOUR.points[:, :2], axis=0).mean())
    assert width_of(bpy.data.collections.new("none")) == 0.0


def test_an_object_with_instances_is_no_ground() -> None:
    ground = square(1.0)
    assert is_ground(ground)
    add_lod_modifier(ground, LodSettings(start=NEVER, end=NEVER))
    assert is_ground(ground), "a modifier of ours"
    smooth = ground.modifiers.new("smooth", "NODES")
    smooth.node_group = bpy.data.node_groups.new("smooth", "GeometryNodeTree")
    assert is_ground(ground), "a modifier without instances"
    outer = bpy.data.node_groups.new("scatter", "GeometryNodeTree")
    outer.nodes.new("GeometryNodeGroup").node_tree = smooth.node_group
    ground.modifiers.new("scatter", "NODES").node_group = outer
    smooth.node_group.nodes.new("GeometryNodeInstanceOnPoints")
    assert not is_ground(ground)
    assert not is_ground(add_mesh("points", [(0, 0, 0)], []))


def test_a_scale_moves_into_the_mesh() -> None:
    ground = square(1.0)
    ground.scale = (7.0, 3.0, 1.0)
    bpy.context.view_layer.update()
    assert (is_scaled(ground), may_apply_scale(ground)) == (True, True)
    apply_scale(ground)
    bpy.context.view_layer.update()
    assert (is_scaled(ground), area_of(ground)) == (False, pytest.approx(21.0))


def test_a_scale_that_others_share_stays() -> None:
    ground = square(1.0)
    ground.scale = (2.0, 2.0, 2.0)
    twin = place(ground.data, "twin")
    bpy.context.view_layer.update()
    assert not may_apply_scale(ground)
    bpy.data.objects.remove(twin)
    assert may_apply_scale(ground)
    ground.modifiers.new("waves", "DISPLACE")
    assert not may_apply_scale(ground), "its strength is in units of the mesh"


def test_copies_stand_beside_each_other() -> None:
    taken: list[Vector] = []
    for number in (1, 2, 3):
        found = free_place(Vector((1.0, 2.0, 3.0)), 5.0, taken)
        assert found == Vector((1.0 + 5.0 * number, 2.0, 3.0))
        taken.append(found)
    assert free_place(Vector((1.0, 2.0, 3.0)), 5.0, taken[1:]) == taken[0]
