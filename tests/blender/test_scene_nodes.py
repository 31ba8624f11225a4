"""The node group of a scene: evaluated meshes are compared with these formulas.

λ = min((d₀/d)^(ln ½ / ln h), 1), λ′ = λ·(1 − a·(d_range/z)·((d − d_min)/d_range)^(m/n)), ρ = min(0.05, 1 − λ′),
r = (λ′ − rank)/(ρλ′) in [0, 1], s² = ΣA/Σ(A·r²), p' = pivot + (p − pivot)·s·r.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import bpy
import numpy as np
import pytest
from lod_scenes import (
    FOUR,
    Floats,
    Leaves,
    add_camera,
    build,
    evaluate,
    many_leaves,
    place,
    points_of,
    store,
    triangle_areas,
)
from mathutils import Euler, Matrix, Vector

from addon.nodes.scene import GROUP_NAME, SceneSettings, add_scene_modifier, scene_group
from addon.versions import set_corner_normals, set_modifier_input

pytestmark = pytest.mark.version


def add_trees(
    meshes: Sequence[bpy.types.Mesh], places: Sequence[Matrix | Vector | tuple[float, ...]]
) -> bpy.types.Collection:
    """Return a collection with a tree at each place, drawn in this order. No scene contains the collection."""
    trees = bpy.data.collections.new("Trees")
    for number, (mesh, where) in enumerate(zip(meshes, places, strict=True)):
        obj = bpy.data.objects.new(f"Tree {number}", mesh)
        obj.matrix_world = where if isinstance(where, Matrix) else Matrix.Translation(where)
        trees.objects.link(obj)
    return trees


def add_scene(trees: bpy.types.Collection, settings: SceneSettings) -> tuple[bpy.types.Object, bpy.types.NodesModifier]:
    obj = place(bpy.data.meshes.new("Nothing"), "Scene")
    return obj, add_scene_modifier(obj, trees, settings)


def own_keep(distance: float, settings: SceneSettings) -> float:
    if distance <= settings.prune_start:
        return 1.0
    return (settings.prune_start / distance) ** (math.log(0.5) / math.log(settings.prune_half))


def published(distances: Floats, keeps: Floats, settings: SceneSettings) -> Floats:
    """Return λ′ for trees that all count fully."""
    depths, reach = distances - distances.min(), np.ptp(distances)
    if reach == 0.0:
        return keeps
    power = settings.full_models / len(distances)
    return keeps * (1.0 - settings.strength * reach / settings.far * (depths / reach) ** power)


def drawn(leaves: Leaves, keep: float, protected: bool = False) -> Floats:
    """Return the corners (n, 3, 3) of the kept leaves, in the order of the mesh and in the tree's coordinates."""
    ranks = leaves.ranks.astype(np.float64)
    free = ranks >= 0.0
    width = min(0.05, 1.0 - keep) * keep
    ramp = np.where(ranks < keep, np.clip((keep - ranks) / width, 0.0, 1.0) if width > 0.0 else 1.0, 0.0)
    areas = leaves.areas[free]
    scale = math.sqrt(areas.sum() / (areas * ramp[free] ** 2).sum()) if (ramp[free] > 0.0).any() else 0.0
    factor = np.where(free, scale * ramp, 1.0)
    pivots = leaves.pivots.astype(np.float64)[:, None]
    grown = pivots + (leaves.points.astype(np.float64).reshape(-1, 3, 3) - pivots) * factor[:, None, None]
    return grown[ranks < keep]


def carried(points: Floats, where: Matrix) -> Floats:
    matrix = np.array(where)
    return points @ matrix[:3, :3].T + matrix[:3, 3]


def shares(obj: bpy.types.Object, tree_count: int, leaf_count: int) -> Floats:
    """Return each tree's share of kept faces. Trees must stand at x = 0, 100, 200 …"""
    x = points_of(evaluate(obj))[::3, 0]
    return np.bincount((x / 100.0).round().astype(int), minlength=tree_count) / leaf_count


def test_each_tree_is_pruned_by_the_published_formula() -> None:
    settings = SceneSettings(prune_start=8.0, prune_half=0.25, full_models=2.0, far=100.0, strength=0.8)
    leaves = [many_leaves(200), many_leaves(300), many_leaves(50), many_leaves(120)]
    places = [(0.0, 5.0, 0.0), (0.0, -10.0, 2.0), (40.0, 3.0, -4.0), (0.0, 0.0, 60.0)]
    obj, _ = add_scene(add_trees([build(each) for each in leaves], places), settings)
    add_camera((1.0, 2.0, 3.0))

    distances = np.linalg.norm(np.array(places) - (1.0, 2.0, 3.0), axis=1)
    keeps = published(distances, np.array([own_keep(d, settings) for d in distances]), settings)
    assert keeps[0] == 1.0
    assert (np.diff(keeps[np.argsort(distances)]) < 0.0).all()
    expected = [
        carried(drawn(each, keep), Matrix.Translation(where))
        for each, keep, where in zip(leaves, keeps, places, strict=True)
    ]
    found = points_of(evaluate(obj)).reshape(-1, 3, 3)
    assert len(found) == sum(map(len, expected))
    np.testing.assert_allclose(found, np.concatenate(expected), rtol=0.0, atol=2e-4)


def test_four_leaves_grow_about_their_pivots_where_their_tree_stands() -> None:
    settings = SceneSettings(prune_start=5.0, strength=0.5, far=100.0)
    where = Matrix.LocRotScale(Vector((30.0, -5.0, 1.0)), Euler((0.3, 1.1, -0.7)), Vector((2.0, 2.0, 2.0)))
    obj, _ = add_scene(add_trees([build(FOUR)], [where]), settings)
    add_camera((30.0, -5.0, 21.0))  # 20 away, 10 for a tree twice as large: λ = ½, and one tree alone is λ′ = λ.
    # Ranks 0 and ¼ stay, with the areas ½ and 2 of 4 in all: s² = 8/5.
    s = math.sqrt(1.6)
    own = np.array([[0, 0, 1], [s, 0, 1], [0, s, 1], [0, 4, -1], [2 * s, 4, -1], [0, 4 + 2 * s, -1]])
    np.testing.assert_allclose(points_of(evaluate(obj)), carried(own, where), atol=1e-5)


def test_growth_and_contrast_follow_the_settings() -> None:
    leaves, keep = many_leaves(300), 0.25
    add_camera((0.0, 0.0, 40.0))
    plain, measured = (
        add_scene(add_trees([build(leaves)], [Matrix()]), SceneSettings(prune_start=10.0, growth=g, contrast=c))[0]
        for g, c in (((0.0, 0.0), (0.0, 0.0)), ((0.1, 0.0), (0.3, -0.02)))
    )
    plain, measured = evaluate(plain), evaluate(measured)
    pivots = np.repeat(leaves.pivots[leaves.ranks < keep], 3, axis=0)
    np.testing.assert_allclose(points_of(measured) - pivots, keep**0.1 * (points_of(plain) - pivots), atol=1e-4)
    pulled = np.empty(len(measured.vertices), np.float32)
    measured.attributes["leaf_mean_share"].data.foreach_get("value", pulled)
    np.testing.assert_allclose(pulled, 1.0 - keep ** (0.3 - 0.02 * math.log(keep)), atol=1e-5)
    assert "leaf_mean_share" not in plain.attributes


def test_trees_at_one_distance_are_pruned_like_single_trees() -> None:
    settings = SceneSettings(prune_start=5.0, full_models=1.0, far=100.0, strength=1.0)
    leaves = many_leaves(100)
    places = [(100.0 * i, 0.0, 0.0) for i in range(2)]
    obj, _ = add_scene(add_trees([build(leaves)] * 2, places), settings)
    add_camera((50.0, 0.0, 0.0))
    assert shares(obj, 2, 100).tolist() == [0.1, 0.1]


def test_trees_near_the_camera_are_unchanged() -> None:
    leaves = many_leaves(100)
    obj, _ = add_scene(add_trees([build(leaves)], [Matrix()]), SceneSettings(prune_start=50.0))
    assert points_of(evaluate(obj)).tobytes() == leaves.points.tobytes()  # The scene has no camera.
    add_camera((0.0, 0.0, 49.0))
    assert points_of(evaluate(obj)).tobytes() == leaves.points.tobytes()


def test_the_place_of_the_modifiers_object_has_no_influence() -> None:
    leaves = many_leaves(60)
    obj, _ = add_scene(add_trees([build(leaves)], [(0.0, 7.0, 0.0)]), SceneSettings(prune_start=5.0))
    add_camera((0.0, 0.0, 9.0))
    before = points_of(evaluate(obj))
    obj.matrix_world = Matrix.LocRotScale(Vector((3.0, -5.0, 1.0)), Euler((0.3, 1.1, -0.7)), None)
    after = carried(points_of(evaluate(obj)).astype(np.float64), obj.matrix_world)
    assert 0 < len(before) < 180
    np.testing.assert_allclose(after, before, atol=2e-5)


def test_distances_are_measured_from_the_center_of_each_tree() -> None:
    settings = SceneSettings(prune_start=5.0, centre=(0.0, 0.0, 6.0))
    where = Matrix.LocRotScale(Vector((100.0, 0.0, 0.0)), Euler((math.pi / 2.0, 0.0, 0.0)), Vector((2.0, 2.0, 2.0)))
    obj, _ = add_scene(add_trees([build(many_leaves(100))], [where]), settings)
    add_camera((100.0, -12.0, 40.0))  # The center is at (100, −12, 0): 40 away, 20 in the tree's units.
    assert shares(obj, 2, 100)[1] == 0.25


def falling_weight(distance: float, far: float) -> float:
    """Return a cubic smooth step from 1 at ¾ of `far` to 0 at `far`."""
    t = min(max((distance / far - 0.75) / 0.25, 0.0), 1.0)
    return 1.0 - t * t * (3.0 - 2.0 * t)


@pytest.mark.parametrize("far", [90.0, 130.0, 1000.0])
def test_trees_fade_out_of_the_count_before_the_far_distance(far: float) -> None:
    settings = SceneSettings(prune_start=1e6, full_models=2.0, far=far, strength=1.0)
    places = [(100.0 * i, 0.0, 0.0) for i in range(4)]
    obj, _ = add_scene(add_trees([build(many_leaves(1000))] * 4, places), settings)
    add_camera((-10.0, 0.0, 0.0))
    distances = [10.0, 110.0, 210.0, 310.0]
    weights = [falling_weight(d, far) for d in distances]
    depths = [min(d, far) - 10.0 for d in distances]
    shared = max(w * x for w, x in zip(weights, depths, strict=True))
    for found, depth in zip(shares(obj, 4, 1000), depths, strict=True):
        reach = max(shared, depth)
        loss = reach / far * (depth / reach) ** (2.0 / sum(weights)) if depth else 0.0
        assert found == pytest.approx(1.0 - loss, abs=0.0011)


def test_the_share_is_continuous_while_the_camera_and_a_tree_move() -> None:
    settings = SceneSettings(prune_start=60.0, full_models=4.0, far=400.0, strength=1.0)
    places = [(0.0, 20.0, 0.0), (100.0, 0.0, 0.0), (200.0, 0.0, 30.0), (300.0, 0.0, 0.0)]
    trees = add_trees([build(many_leaves(4000))] * 4, places)
    obj, _ = add_scene(trees, settings)
    camera, comer = add_camera((0.0, 0.0, 0.0)), trees.objects[3]

    def greatest_jumps(steps: int) -> Floats:
        """Return each tree's largest change of share. The camera passes three trees, and a fourth approaches."""
        seen = []
        for share in np.linspace(0.0, 1.0, steps + 1):
            camera.location = (900.0 * share - 200.0, 60.0 * math.sin(5.0 * share), 10.0)
            comer.location.y = 900.0 * (1.0 - share)
            seen.append(shares(obj, 4, 4000))
        return np.abs(np.diff(seen, axis=0)).max(axis=0)

    coarse, fine = greatest_jumps(50), greatest_jumps(400)
    assert (coarse > 0.01).all()
    # Steps eight times finer divide the changes of a smooth λ′ (m ≥ n) by eight. A jump would keep its size.
    assert (fine < 0.3 * coarse).all()


def test_a_tree_beyond_the_far_distance_does_not_change_other_trees() -> None:
    settings = SceneSettings(prune_start=20.0, full_models=1.0, far=500.0, strength=0.9)
    places = [(0.0, 5.0, 0.0), (100.0, 0.0, 0.0), (200.0, 0.0, 30.0)]
    mesh = build(many_leaves(1000))
    trees = add_trees([mesh] * 3, places)
    obj, _ = add_scene(trees, settings)
    add_camera((0.0, 0.0, 0.0))
    alone = shares(obj, 4, 1000)
    far = bpy.data.objects.new("Tree 3", mesh)
    far.location = (300.0, 501.0, 0.0)
    trees.objects.link(far)
    together = shares(obj, 4, 1000)
    assert np.array_equal(alone[:3], together[:3])
    assert 0.0 < together[3] < together[2]


@pytest.mark.parametrize("strength", [0.0, 0.5, 1.0])
def test_the_share_falls_with_distance_and_never_exceeds_the_trees_own_share(strength: float) -> None:
    settings = SceneSettings(prune_start=150.0, full_models=3.0, far=1400.0, strength=strength)
    places = [(100.0 * i, 0.0, 0.0) for i in range(20)]
    obj, _ = add_scene(add_trees([build(many_leaves(500))] * 20, places), settings)
    add_camera((0.0, 0.0, 20.0))
    found = shares(obj, 20, 500)
    own = np.array([own_keep(math.hypot(x, 20.0), settings) for x, _, _ in places])
    assert (np.diff(found) <= 0.0).all()
    assert (found <= np.ceil(own * 500) / 500).all()
    if strength == 0.0:
        assert np.allclose(found, own, atol=0.0021)
    else:
        assert (found[2:] < own[2:] - 0.002).all()


def quads(count: int, seed: int) -> bpy.types.Mesh:
    """Return a mesh of leaves in random places with random ranks. Each leaf is a quad and a triangle."""
    rng = np.random.default_rng(seed)
    corner = rng.normal(size=(count, 1, 3))
    shape = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 1.5, 0]]) * 0.05
    mesh = bpy.data.meshes.new("Quads")
    faces = [face for i in range(0, 5 * count, 5) for face in ((i, i + 1, i + 2, i + 3), (i + 3, i + 2, i + 4))]
    mesh.from_pydata((corner + shape).reshape(-1, 3).tolist(), [], faces)
    store(mesh, "leaf_rank", np.repeat(rng.permutation(count) / count, 5).astype(np.float32))
    store(mesh, "leaf_pivot", np.repeat(corner[:, 0], 5, axis=0).astype(np.float32))
    return mesh


def triangle_count(mesh: bpy.types.Mesh) -> int:
    return len(mesh.loops) - 2 * len(mesh.polygons)


@pytest.mark.parametrize("budget", [1, 2, 3, 50, 997, 1000, 2500, 3600])
@pytest.mark.parametrize("strength", [0.0, 0.7])
def test_the_scene_uses_its_budget_up_to_one_leaf(budget: int, strength: float) -> None:
    settings = SceneSettings(prune_start=25.0, full_models=2.0, far=300.0, strength=strength, budget=budget)
    meshes = [quads(400, 1), quads(700, 2), quads(300, 3), quads(400, 1)]
    places = [(0.0, 3.0, 0.0), (30.0, 0.0, 0.0), (-20.0, 40.0, 0.0), (0.0, 80.0, 10.0)]
    obj, modifier = add_scene(add_trees(meshes, places), settings)
    add_camera((0.0, 0.0, 0.0))
    count = triangle_count(evaluate(obj))
    set_modifier_input(modifier, "Budget", 0)
    without = triangle_count(evaluate(obj))
    if without <= budget:
        assert count == without
    else:
        assert budget - 3 < count <= budget
        set_modifier_input(modifier, "Budget", without)
        assert triangle_count(evaluate(obj)) == without


def test_equal_trees_use_the_budget_up_to_one_leaf() -> None:
    # All 64 trees have the same ranks. Pruning by rank alone would remove 64 leaves, 192 triangles, at once.
    mesh = quads(50, 4)
    angles = np.arange(64) * math.tau / 64
    places = [(100.0 * math.cos(angle), 100.0 * math.sin(angle), 0.0) for angle in angles]
    obj, modifier = add_scene(add_trees([mesh] * 64, places), SceneSettings(prune_start=50.0, budget=1000))
    add_camera((0.0, 0.0, 0.0))
    for budget in (100, 1000, 1001, 1234, 4000):
        set_modifier_input(modifier, "Budget", budget)
        assert budget - 3 < triangle_count(evaluate(obj)) <= budget


def test_the_budget_scales_all_trees_by_one_factor() -> None:
    settings = SceneSettings(prune_start=100.0, full_models=2.0, far=1000.0, strength=0.6)
    places = [(100.0 * i, 0.0, 0.0) for i in range(5)]
    obj, modifier = add_scene(add_trees([build(many_leaves(2000))] * 5, places), settings)
    add_camera((0.0, 0.0, 0.0))
    free = shares(obj, 5, 2000)
    total = triangle_count(evaluate(obj))
    set_modifier_input(modifier, "Budget", total // 3)
    np.testing.assert_allclose(shares(obj, 5, 2000), free * (total // 3 / total), atol=0.0015)
    area = triangle_areas(points_of(evaluate(obj))).sum()
    assert area == pytest.approx(5.0 * many_leaves(2000).areas.sum(), rel=2e-4)


def protecting(leaves: Leaves, share: float) -> Leaves:
    """Return the same leaves. The given share of the leaves is protected."""
    ranks = leaves.ranks.copy()
    ranks[: int(share * len(ranks))] = -1.0
    return Leaves(leaves.points, leaves.targets, ranks, leaves.pivots, leaves.pivot_targets)


@pytest.mark.parametrize("distance", [5.0, 12.0, 480.0, 1e8])
def test_protected_leaves_are_unchanged_and_do_not_count(distance: float) -> None:
    leaves = protecting(many_leaves(200), 0.3)
    settings = SceneSettings(prune_start=10.0)
    obj, _ = add_scene(add_trees([build(leaves)], [Matrix()]), settings)
    add_camera((0.0, 0.0, distance))
    expected = drawn(leaves, own_keep(distance, settings))
    found = points_of(evaluate(obj)).reshape(-1, 3, 3)
    assert found.shape == expected.shape
    np.testing.assert_allclose(found, expected, atol=2e-4)
    assert found[:60].tobytes() == leaves.points[:180].tobytes()


def test_protected_triangles_count_toward_the_budget_and_are_kept() -> None:
    leaves = protecting(many_leaves(200), 0.3)
    obj, modifier = add_scene(add_trees([build(leaves)] * 2, [Matrix(), (30.0, 0.0, 0.0)]), SceneSettings(budget=150))
    add_camera((0.0, 0.0, 0.0))
    assert len(evaluate(obj).polygons) == 150
    set_modifier_input(modifier, "Budget", 100)
    assert len(evaluate(obj).polygons) == 120
    assert not np.isnan(points_of(evaluate(obj))).any()


def test_a_trunk_in_the_collection_is_unchanged() -> None:
    leaves, trunk = many_leaves(100), many_leaves(40)
    trees = add_trees([build(leaves), build(trunk, attributes=False)], [Matrix(), Matrix()])
    obj, _ = add_scene(trees, SceneSettings(prune_start=1.0))
    add_camera((0.0, 0.0, 10.0))
    found = points_of(evaluate(obj))
    assert found[-120:].tobytes() == trunk.points.tobytes()
    assert len(found) == 3 * 10 + 120


def test_the_area_of_many_leaves_is_kept() -> None:
    # Blender 4.2 adds areas in f32. For this many leaves such a sum is off by a thousandth.
    leaves = many_leaves(150_000)
    obj, _ = add_scene(add_trees([build(leaves)] * 2, [(0.0, 0.0, 20.0), (1.0, 0.0, 30.0)]), SceneSettings(10.0))
    add_camera((0.0, 0.0, 0.0))
    area = triangle_areas(points_of(evaluate(obj))).sum()
    assert area == pytest.approx(2.0 * leaves.areas.sum(), rel=3e-5)


def test_materials_uv_maps_and_normals_are_kept() -> None:
    meshes = []
    for number, name in enumerate(("Spring", "Autumn")):
        mesh = build(many_leaves(40))
        mesh.materials.append(bpy.data.materials.new(name))
        mesh.uv_layers.new(name="UVMap").data.foreach_set("uv", np.full(240, 0.25 + 0.5 * number, np.float32))
        set_corner_normals(mesh, np.tile(np.float32([0.6, 0.0, 0.8]), (120, 1)))
        meshes.append(mesh)
    places = [Matrix.Rotation(angle, 4, "Z") for angle in (0.0, math.pi / 2.0)]
    obj, _ = add_scene(add_trees(meshes, places), SceneSettings(prune_start=20.0))
    add_camera((0.0, 0.0, 40.0))

    evaluated = evaluate(obj)
    assert [material.name for material in evaluated.materials] == ["Spring", "Autumn"]
    assert [face.material_index for face in evaluated.polygons] == [0] * 20 + [1] * 20
    assert [corner.uv[0] for corner in evaluated.uv_layers["UVMap"].data] == [0.25] * 60 + [0.75] * 60
    if bpy.app.version >= (4, 5, 0):  # Before, Blender's Delete Geometry node drops custom normals.
        normals = np.array([normal.vector for normal in evaluated.corner_normals], np.float64)
        np.testing.assert_allclose(normals, [[0.6, 0.0, 0.8]] * 60 + [[0.0, 0.6, 0.8]] * 60, atol=1e-6)


def test_an_empty_collection_draws_nothing() -> None:
    obj, modifier = add_scene(bpy.data.collections.new("Trees"), SceneSettings(budget=10))
    add_camera((0.0, 0.0, 0.0))
    assert len(evaluate(obj).polygons) == 0
    set_modifier_input(modifier, "Trees", None)
    assert len(evaluate(obj).polygons) == 0


def test_the_node_group_is_created_once() -> None:
    foreign = bpy.data.node_groups.new(GROUP_NAME, "GeometryNodeTree")
    group = scene_group()
    assert group != foreign
    assert scene_group() == group
    assert len(bpy.data.node_groups) == 2


def test_the_inputs_have_their_documented_names() -> None:
    sockets = [item for item in scene_group().interface.items_tree if item.item_type == "SOCKET"]
    assert [socket.name for socket in sockets if socket.in_out == "OUTPUT"] == ["Geometry"]
    inputs = [socket for socket in sockets if socket.in_out == "INPUT"]
    assert [socket.name for socket in inputs] == [
        *(
            "Trees",
            "Centre",
            "Prune Start",
            "Prune Half",
            "Growth",
            "Growth Quadratic",
            "Contrast",
            "Contrast Quadratic",
        ),
        *("Full Models", "Far", "Strength", "Budget"),
    ]
    assert all(socket.description for socket in inputs)


def test_each_node_has_a_labeled_frame_and_its_own_place() -> None:
    nodes = [node for node in scene_group().nodes if node.bl_idname != "NodeFrame"]
    assert all(node.parent.label for node in nodes)
    assert len({(node.parent.name, *node.location) for node in nodes}) == len(nodes)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"prune_start": 0.0}, "prune_start is 0.0, it must be greater than 0"),
        ({"prune_half": 0.6}, "prune_half is 0.6, it must be greater than 0 and at most 0.5"),
        ({"full_models": 0.0}, "full_models is 0.0, it must be greater than 0"),
        ({"far": math.inf}, "far is inf, it must be greater than 0"),
        ({"strength": math.nan}, r"strength is nan, it must be in \[0, 1\]"),
        ({"budget": -1}, "budget is -1, it must be at least 0"),
        ({"centre": (0.0, math.nan, 0.0)}, r"centre is \(0.0, nan, 0.0\), it must be finite"),
    ],
)
def test_settings_out_of_range_are_refused(values: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        SceneSettings(**values)
