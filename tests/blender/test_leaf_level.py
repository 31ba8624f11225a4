"""Level 1 as simplified leaves: its mesh, the morph onto it and from it to the first cloud, and when it is made."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
import pytest
from lod_scenes import evaluate, points_of
from mathutils import Matrix, Vector
from mathutils.bvhtree import BVHTree
from numpy.typing import NDArray
from scenes import add_field, add_mesh, bake, material, read, use_nodes

import leafcloud
from addon.bake.values import Baked
from addon.export.gpu_load import GpuLoad
from addon.export.report import report
from addon.nodes.lod import set_manual
from addon.settings.bake import BakeSettings
from addon.settings.setting import SettingsError

SEGMENTS = 8


def tuft(count: int = 150, matrix: Matrix | None = None) -> bpy.types.Object:
    """Add arched blades of grass of two triangles per segment, of two materials, on a disk of radius 1."""
    rng = np.random.default_rng(7)
    vertices: list[tuple[float, float, float]] = []
    faces: list[tuple[int, ...]] = []
    for _ in range(count):
        foot = Vector((*rng.uniform(-0.7, 0.7, 2), 0.0))
        turn = Matrix.Rotation(rng.uniform(0.0, 6.3), 4, "Z")
        first = len(vertices)
        for step in range(SEGMENTS + 1):
            share = step / SEGMENTS
            for side in (-1.0, 1.0):
                point = Vector((0.5 * share * share, 0.03 * side * (1.0 - 0.9 * share), share))
                vertices.append(tuple(foot + turn @ point))
        for step in range(SEGMENTS):
            a = first + 2 * step
            faces.append((a, a + 1, a + 3, a + 2))
    obj = add_mesh("grass", vertices, faces, materials=[material("green"), material("dry")], matrix=matrix)
    for number, polygon in enumerate(obj.data.polygons):
        polygon.material_index = number // SEGMENTS % 2
    return obj


def baked(obj: bpy.types.Object | None = None, **settings: Any) -> Baked:
    shape = {
        "levels": 1,
        "texture_size": 128,
        "quality": 0.1,
        "effects": "transitions,pruning",
        "last": "cross",
        **settings,
    }
    obj = obj or tuft()
    return bake(read([obj], [obj.name]), BakeSettings(**shape))


def places(mesh: bpy.types.Mesh, name: str) -> NDArray[np.float64]:
    """Return the vectors (v, 3) of a point attribute."""
    values = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.attributes[name].data.foreach_get("vector", values)
    return values.reshape(-1, 3).astype(float)


def tree_of(obj: bpy.types.Object) -> BVHTree:
    return BVHTree.FromPolygons(
        [tuple(vertex.co) for vertex in obj.data.vertices], [tuple(each.vertices) for each in obj.data.polygons]
    )


def test_level_1_is_leaves_with_their_materials_and_fewer_triangles() -> None:
    tree = baked()
    leaves, level = tree.levels[0].object, tree.levels[1].object
    assert isinstance(tree.chain.levels[0], leafcloud.LeafLevel)
    assert [each.method for each in tree.chain.levels] == ["simplified", "stochastic", "cross"]
    assert list(level.data.materials) == list(leaves.data.materials)

    def areas(obj: bpy.types.Object) -> list[float]:
        faces = obj.data.polygons
        return [sum(face.area for face in faces if face.material_index == number) for number in range(2)]

    # An arched blade has less area than its length × width; growth keeps the sum of the triangles' areas.
    assert areas(level) == pytest.approx(areas(leaves), rel=0.01)


def test_the_artists_materials_stay_as_they_are() -> None:
    obj = tuft()
    own = list(obj.data.materials)
    for each in own:
        use_nodes(each)
    before = [sorted(node.name for node in each.node_tree.nodes) for each in own]
    tree = baked(obj)
    assert [sorted(node.name for node in each.node_tree.nodes) for each in own] == before
    leaves, simplified = ({slot.material for slot in level.object.material_slots} for level in tree.levels[:2])
    assert leaves == simplified == set(own), "they become other levels without their materials"


def test_the_leaves_morph_onto_the_simplified_leaves() -> None:
    tree = baked()
    leaves, level = tree.levels[0].object, tree.levels[1].object
    targets, surface = places(leaves.data, "leaf_target"), tree_of(level)
    away = [surface.find_nearest(target)[3] for target in targets.tolist()]
    assert max(away) < 1e-5
    set_manual(leaves.modifiers[0], transition=1.0, keep=1.0)
    assert points_of(evaluate(leaves)) == pytest.approx(targets, abs=1e-5)
    most = tree.chain.levels[0].max_deviation_leaves * tree.prepared.foliage.radius
    rest = np.array([vertex.co for vertex in leaves.data.vertices])
    assert np.linalg.norm(targets - rest, axis=1).max() == pytest.approx(most, abs=1e-5)


def test_the_simplified_leaves_morph_onto_the_first_cloud() -> None:
    tree = baked()
    level, [cloud, _] = tree.levels[1].object, tree.chain.clouds
    assert cloud.cloud is not None
    numbers = np.empty(len(level.data.vertices), np.int32)
    level.data.attributes["leaf_billboard"].data.foreach_get("value", numbers)
    targets, planes = places(level.data, "leaf_target"), cloud.cloud.planes
    on = numbers >= 0
    assert on.mean() > 0.9
    normals, distances = planes[numbers[on], :3], planes[numbers[on], 3]
    heights = np.abs(np.einsum("vd,vd->v", targets[on], normals) - distances)
    assert heights.max() < 1e-3 * tree.prepared.foliage.radius
    assert tree.schedule.lod_ranges[1].end < np.inf


MIRRORED = Matrix.LocRotScale(Vector((3.0, 1.0, 2.0)), None, Vector((-2.0, 2.0, 2.0)))


def test_a_mirrored_tree_has_the_same_leaves_with_their_fronts() -> None:
    plain, mirrored = baked(tuft()), baked(tuft(matrix=MIRRORED))
    both = [tree.levels[1].object for tree in (plain, mirrored)]
    sizes = [len(obj.data.polygons) for obj in both]
    # A mirror is another order of sums: now and then another edge collapses first.
    assert sizes[0] == pytest.approx(sizes[1], rel=0.05)
    for tree, obj in zip((plain, mirrored), both, strict=True):
        source, sign = tree.levels[0].object, []
        surface = tree_of(source)
        for face in obj.data.polygons:
            normal = surface.find_nearest(face.center)[1]
            sign.append(normal.dot(face.normal) > 0.0)
        assert np.mean(sign) > 0.99


def test_wind_moves_both_forms_of_a_leaf_alike() -> None:
    obj = tuft()
    add_field("WIND", strength=1.0)
    tree = baked(obj, effects="transitions,wind")
    pivots = [places(built.object.data, "leaf_pivot") for built in tree.levels[:2]]
    rows = [{tuple(row) for row in np.round(each, 4).tolist()} for each in pivots]
    assert rows[0] == rows[1]
    assert len(rows[0]) == 150


def test_a_trunk_stays_with_the_simplified_leaves() -> None:
    leaves = tuft()
    sides = [(i, (i + 1) % 6, 6 + (i + 1) % 6, 6 + i) for i in range(6)]
    ring = [(0.05 * np.cos(i), 0.05 * np.sin(i), z) for z in (0.0, 0.8) for i in range(6)]
    trunk = add_mesh("stem", [tuple(map(float, point)) for point in ring], sides)
    tree = bake(
        read([leaves, trunk], ["grass"]), BakeSettings(levels=1, texture_size=128, effects="transitions,trunk_levels")
    )
    assert all(built.trunk is not None for built in tree.levels[:3])
    assert tree.levels[3].trunk is None


def test_the_report_has_the_row_of_simplified_leaves() -> None:
    tree = baked()
    row = report(tree, [0.0] * len(tree.levels), [], GpuLoad())["levels"][1]
    assert (row["method"], row["billboards"], row["texels"], row["texture_size"]) == ("simplified", 0, 0, None)
    assert 0.0 < row["image_error"] < 0.1
    assert row["switch_distance"] == tree.switch_distances[1] > 0.0


def test_billboards_can_be_asked_for() -> None:
    tree = baked(form="billboards")
    assert [each.method for each in tree.chain.levels] == ["stochastic", "cross"]
    assert len(tree.chain.levels) == len(tree.chain.clouds)


def test_cards_have_billboards_unless_leaves_are_asked_for() -> None:
    square = [(x, y, 0.0) for x in (0.0, 0.2) for y in (0.0, 0.2)]
    vertices, faces = [], []
    for i in range(60):
        place = Matrix.Rotation(0.7 * i, 4, "Z") @ Matrix.Translation((0.5, 0.0, 0.02 * i)) @ Matrix.Rotation(i, 4, "X")
        vertices += [tuple(place @ Vector(point)) for point in square]
        faces.append((4 * i, 4 * i + 1, 4 * i + 3, 4 * i + 2))
    cards = add_mesh("grass", vertices, faces)
    assert not isinstance(baked(cards).chain.levels[0], leafcloud.LeafLevel)
    with pytest.raises(leafcloud.LeafcloudError, match="no leaves with fewer triangles"):
        baked(cards, form="leaves")


@pytest.mark.parametrize("other", [{"pixels": 8.0}, {"seconds": 5.0}, {"chain": "both"}])
def test_leaves_are_judged_by_quality_alone(other: dict[str, Any]) -> None:
    with pytest.raises(SettingsError, match="`form=leaves` needs `quality`"):
        BakeSettings(form="leaves", **other)


def needles(count: int = 2000) -> bpy.types.Object:
    """Add thin quads at random places in a ball of radius 1: no cloud looks like them."""
    rng = np.random.default_rng(3)
    vertices: list[tuple[float, float, float]] = []
    for _ in range(count):
        away, along, side = rng.normal(size=(3, 3))
        place = away / np.linalg.norm(away) * rng.uniform() ** (1 / 3)
        along *= 0.1 / np.linalg.norm(along)
        side = np.cross(along, side)
        side *= 0.004 / np.linalg.norm(side)
        vertices += [tuple((place + a * along + b * side).tolist()) for a, b in ((0, -1), (1, -1), (1, 1), (0, 1))]
    return add_mesh("needles", vertices, [(i, i + 1, i + 2, i + 3) for i in range(0, 4 * count, 4)])


def is_one_of_steps(share: float) -> bool:
    """Return whether a level has such a share of the leaves before: three quarters, or halvings of these or of all."""
    steps = [3 / 4, *(step / 2**halvings for step in (2 / 3, 1 / 2) for halvings in range(6))]
    return any(share == pytest.approx(step, rel=0.02) for step in steps)


def test_fewer_and_larger_leaves_come_before_a_late_cloud() -> None:
    sparse = baked(needles(), quality=0.26)
    levels = [level for level in sparse.chain.levels if level.method == "fewer"]
    assert len(levels) > 0
    for before, built in zip(sparse.levels, sparse.levels[1 : len(levels) + 1], strict=False):
        faces, finer = built.object.data.polygons, before.object.data.polygons
        assert is_one_of_steps(len(faces) / len(finer))
        assert sum(face.area for face in faces) == pytest.approx(sum(face.area for face in finer), rel=0.3)
        assert list(built.object.data.materials) == list(before.object.data.materials)


def test_leaves_morph_onto_fewer_leaves_and_these_onto_the_cloud() -> None:
    sparse = baked(needles(), quality=0.26)
    count = sum(level.method == "fewer" for level in sparse.chain.levels)
    for before, built in zip(sparse.levels[:count], sparse.levels[1:], strict=False):
        obj = before.object
        set_manual(obj.modifiers[0], transition=1.0, keep=1.0)
        mesh, surface = evaluate(obj), tree_of(built.object)
        moved = points_of(mesh)
        there = [face for face in mesh.polygons if face.area > 1e-9]
        assert is_one_of_steps(len(there) / len(mesh.polygons))
        corners = {vertex for face in there for vertex in face.vertices}
        assert max(surface.find_nearest(moved[vertex].tolist())[3] for vertex in corners) < 1e-5
    last, cloud = sparse.levels[count].object, sparse.chain.clouds[0].cloud
    assert cloud is not None
    numbers = np.empty(len(last.data.vertices), np.int32)
    last.data.attributes["leaf_billboard"].data.foreach_get("value", numbers)
    targets, on = places(last.data, "leaf_target"), numbers >= 0
    assert on.mean() > 0.9
    heights = np.einsum("vd,vd->v", targets[on], cloud.planes[numbers[on], :3]) - cloud.planes[numbers[on], 3]
    assert np.abs(heights).max() < 1e-3 * sparse.prepared.foliage.radius
