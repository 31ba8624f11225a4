"""The points of a forest: scattered by density, mask and slope, or given; turned, scaled, of several kinds.

The expected numbers come from the areas of the ground and from the settings.
"""

from __future__ import annotations

import math
from typing import Any

import bpy
import numpy as np
import pytest
from mathutils import Euler
from scenes import TRIANGLE, add_mesh

from addon.nodes.forest import ForestSettings, add_forest_modifier
from addon.nodes.points import KIND, PointSettings, add_points_modifier, points_group

SQUARE = [(0, 0, 0), (20, 0, 0), (20, 20, 0), (0, 20, 0)]
"""400 square units, level."""


def ground(positions: Any = SQUARE) -> bpy.types.Object:
    return add_mesh("ground", positions, [tuple(range(len(positions)))])


def planted(obj: bpy.types.Object) -> list[tuple[str, np.ndarray]]:
    """Return name and world matrix of each instance that the object draws."""
    graph = bpy.context.evaluated_depsgraph_get()
    return [
        (each.object.original.name, np.array(each.matrix_world, float))
        for each in graph.object_instances
        if each.is_instance and each.parent.original == obj
    ]


def plant(obj: bpy.types.Object, settings: PointSettings) -> list[tuple[str, np.ndarray]]:
    """Plant kinds named A, B … on the object; return the trees."""
    add_points_modifier(obj, settings)
    for kind in range(settings.kinds):
        variants = bpy.data.collections.new(f"kind {kind}")
        variants.objects.link(add_mesh("ABCDEFGH"[kind], TRIANGLE, [(0, 1, 2)], link=False))
        add_forest_modifier(obj, variants, ForestSettings((), kind=kind))
    return planted(obj)


def places(trees: list[tuple[str, np.ndarray]]) -> np.ndarray:
    return np.array([matrix[:3, 3] for _, matrix in trees])


def test_density_is_trees_per_area() -> None:
    trees = plant(ground(), PointSettings(density=2.0))
    assert abs(len(trees) - 800) < 4.0 * math.sqrt(800)
    found = places(trees)
    assert (found[:, :2] >= 0.0).all()
    assert (found[:, :2] <= 20.0).all()


def test_a_mask_thins_the_trees() -> None:
    corners = [(0, 0, 0), (10, 0, 0), (20, 0, 0), (0, 20, 0), (10, 20, 0), (20, 20, 0)]
    obj = add_mesh("ground", corners, [(0, 1, 4, 3), (1, 2, 5, 4)])
    group = obj.vertex_groups.new(name="meadow")
    group.add([0, 3], 1.0, "REPLACE")
    group.add([1, 2, 4, 5], 0.0, "REPLACE")
    trees = plant(obj, PointSettings(density=2.0, mask="meadow"))
    assert abs(len(trees) - 200) < 5.0 * math.sqrt(200), "half of the density in the left half, nothing in the right"
    assert places(trees)[:, 0].max() <= 10.0


@pytest.mark.parametrize(("degrees", "grows"), [(29.0, False), (31.0, True), (90.0, True)])
def test_no_trees_on_steep_slopes(degrees: float, grows: bool) -> None:
    rise = 20.0 * math.tan(math.radians(30.0))
    obj = ground([(0, 0, 0), (20, 0, 0), (20, 20, rise), (0, 20, rise)])
    assert bool(plant(obj, PointSettings(density=1.0, slope=math.radians(degrees)))) == grows


def test_each_vertex_has_a_tree_without_a_density() -> None:
    trees = plant(ground(), PointSettings(turn=0.0))
    np.testing.assert_allclose(sorted(map(tuple, places(trees))), sorted(SQUARE), atol=1e-6)


def test_trees_are_turned_about_their_axis_and_scaled() -> None:
    trees = plant(ground(), PointSettings(density=5.0, turn=1.0, smallest=0.5, largest=2.0))
    linear = np.array([matrix[:3, :3] for _, matrix in trees])
    scales = np.linalg.norm(linear[:, :, 2], axis=1)
    assert 0.5 <= scales.min() < 0.55
    assert 1.95 < scales.max() <= 2.0
    assert scales.mean() == pytest.approx(1.25, abs=0.05)
    np.testing.assert_allclose(linear[:, 2, 2], scales, rtol=1e-5)
    angles = np.arctan2(linear[:, 1, 0], linear[:, 0, 0])
    quarters = np.histogram(angles, bins=4, range=(-math.pi, math.pi))[0]
    assert quarters.min() > 0.2 * len(trees)


def test_several_kinds_share_the_points() -> None:
    trees = plant(ground(), PointSettings(density=5.0, kinds=3))
    names = [name for name, _ in trees]
    for name in "ABC":
        assert names.count(name) == pytest.approx(len(names) / 3.0, rel=0.15)
    found = places(trees)
    assert len(np.unique(found.round(4), axis=0)) == len(found), "no two trees on one point"


def test_a_seed_gives_the_same_forest_and_another_seed_another_one() -> None:
    def forest(seed: int) -> np.ndarray:
        obj = ground()
        return places(plant(obj, PointSettings(density=1.0, seed=seed)))

    first, again, other = forest(3), forest(3), forest(4)
    np.testing.assert_array_equal(first, again)
    assert first.shape != other.shape or not np.allclose(first, other)


def test_instances_of_other_tools_become_trees_in_their_places() -> None:
    """Another modifier scatters cones, turned and scaled. Trees take their places; the cones are gone."""
    obj = ground()
    scatter = bpy.data.node_groups.new("scatter", "GeometryNodeTree")
    scatter.is_modifier = True
    for direction in ("INPUT", "OUTPUT"):
        scatter.interface.new_socket("Geometry", in_out=direction, socket_type="NodeSocketGeometry")
    nodes, links = scatter.nodes, scatter.links
    enter, leave = nodes.new("NodeGroupInput"), nodes.new("NodeGroupOutput")
    cone, instance, join = (
        nodes.new(f"GeometryNode{kind}") for kind in ("MeshCone", "InstanceOnPoints", "JoinGeometry")
    )
    links.new(enter.outputs[0], instance.inputs["Points"])
    links.new(cone.outputs[0], instance.inputs["Instance"])
    instance.inputs["Rotation"].default_value = (0.0, 0.0, 0.5)
    instance.inputs["Scale"].default_value = (2.0, 2.0, 2.0)
    for each in (instance.outputs[0], enter.outputs[0]):
        links.new(each, join.inputs[0])
    links.new(join.outputs[0], leave.inputs[0])
    obj.modifiers.new("scatter", "NODES").node_group = scatter
    trees = plant(obj, PointSettings(turn=0.0))
    assert len(trees) == 4
    expected = 2.0 * np.array(Euler((0.0, 0.0, 0.5)).to_matrix())
    for _, matrix in trees:
        np.testing.assert_allclose(matrix[:3, :3], expected, atol=1e-5)


@pytest.mark.parametrize("visible", [True, False])
def test_the_ground_stays_visible_if_it_should(visible: bool) -> None:
    obj = ground()
    plant(obj, PointSettings(density=1.0, ground=visible, kinds=2))
    shown = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
    assert len(shown.polygons) == int(visible)


def test_settings_out_of_range_are_refused() -> None:
    for name, value in (("kinds", 0), ("density", -1.0), ("slope", 2.0), ("turn", 1.5), ("smallest", 0.0)):
        with pytest.raises(ValueError, match=f"{name} is {value}"):
            PointSettings(**{name: value})


def test_the_inputs_have_the_promised_names() -> None:
    sockets = [item for item in points_group().interface.items_tree if item.item_type == "SOCKET"]
    assert [socket.name for socket in sockets if socket.in_out == "INPUT"] == [
        *("Geometry", "Ground", "Density", "Mask", "Slope", "Turn", "Smallest", "Largest", "Kinds", "Seed")
    ]
    assert all(socket.description for socket in sockets if socket.name != "Geometry")
    assert KIND == "leafcloud_kind"
