"""The node group of the wind: evaluated meshes are compared with the law in tests/support/laws.py."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import bpy
import numpy as np
import pytest
from laws import Air, Floats, blown, fluttered, sway_at, tree_turns
from lod_scenes import Leaves, add_camera, build, evaluate, many_leaves, place, points_of, store
from mathutils import Euler, Matrix, Vector
from scenes import add_field

from addon.nodes.lod import LodSettings, add_lod_modifier, set_manual
from addon.nodes.scene import SceneSettings, add_scene_modifier
from addon.nodes.wind import GROUP_NAME, Swing, WindSettings, add_wind_modifier, wind_group
from addon.plan.wind import Stature, Wind
from addon.versions import get_modifier_input, set_modifier_input

pytestmark = pytest.mark.version

STATURE = Stature(foot=(0.1, -0.2, -4.0), up=(0.0, 0.0, 1.0), height=8.0, spread=3.0, period=2.5)
WIND = Wind(direction=(0.6, 0.8, 0.0), strength=6.0, gusts=0.7)
SETTINGS = WindSettings(STATURE, WIND)
FRAMES = (0, 7, 31, 200)
FPS = 24.0


@dataclass(frozen=True)
class Blown:
    """Leaves with a phase (n,), a freedom (n,) and the pivot of a billboard (n, 3) each."""

    leaves: Leaves
    phases: Floats
    free: Floats
    carriers: Floats

    def build(self, name: str = "Tree", matrix: Matrix | None = None) -> bpy.types.Object:
        mesh = build(self.leaves)
        for attribute, values in (("leaf_phase", self.phases), ("leaf_flutter", self.free)):
            store(mesh, attribute, np.repeat(values, 3).astype(np.float32))
        store(mesh, "leaf_billboard_pivot", np.repeat(self.carriers, 3, axis=0).astype(np.float32))
        return place(mesh, name, matrix)

    def expected(self, air: Air, a: float) -> Floats:
        """Return the corners of all leaves in the wind, without pruning."""
        leaves = self.leaves
        points = (1.0 - a) * leaves.points.astype(float) + a * leaves.targets
        pivot = leaves.pivots.astype(float)
        centre = np.repeat((1.0 - a) * pivot + a * leaves.pivot_targets, 3, axis=0)
        pivots, carriers = np.repeat(pivot, 3, axis=0), np.repeat(self.carriers, 3, axis=0)
        turned = fluttered(points, centre, np.repeat(self.phases, 3), np.repeat(self.free, 3), a, air)
        return blown(turned, pivots, carriers, a, air)


def some_leaves(count: int = 60) -> Blown:
    rng = np.random.default_rng(11)
    leaves = many_leaves(count)
    phases, free = (rng.random(count).astype(np.float32).astype(float) for _ in range(2))
    carriers = rng.normal(size=(count, 3)).astype(np.float32).astype(float)
    return Blown(leaves, phases, free, carriers)


def at_frame(frame: int) -> float:
    """Go to a frame and return its time in seconds."""
    bpy.context.scene.frame_set(frame)
    return frame / FPS


def air_of(settings: WindSettings, seconds: float, matrix: Matrix | None = None) -> Air:
    """Return the wind in the coordinates of a tree with this world matrix."""
    world = np.array(matrix or Matrix())
    along = np.linalg.inv(world[:3, :3]) @ settings.wind.direction
    stature, swing = settings.stature, settings.swing
    return Air(
        direction=along / np.linalg.norm(along),
        up=np.array(stature.up),
        foot=np.array(stature.foot),
        height=stature.height,
        spread=stature.spread,
        strength=settings.wind.strength,
        gusts=settings.wind.gusts,
        turns=tree_turns(seconds, stature.period, world[:3, 3]),
        sway=swing.sway,
        branches=swing.branches,
        flutter=swing.flutter,
    )


def by_hand(modifier: bpy.types.NodesModifier, transition: float) -> None:
    set_modifier_input(modifier, "Manual", True)
    set_modifier_input(modifier, "Transition", transition)


@pytest.mark.parametrize("a", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("direction", [(0.6, 0.8, 0.0), (0.0, 0.0, 1.0), (0.48, -0.6, 0.64)])
def test_the_group_follows_the_law(a: float, direction: tuple[float, float, float]) -> None:
    tree = some_leaves()
    obj = tree.build()
    settings = replace(SETTINGS, wind=replace(WIND, direction=direction))
    set_manual(add_lod_modifier(obj, LodSettings(start=1.0, end=2.0)), transition=a, keep=1.0)
    by_hand(add_wind_modifier(obj, settings), a)
    for frame in FRAMES:
        expected = tree.expected(air_of(settings, at_frame(frame)), a)
        assert np.abs(expected - tree.leaves.points).max() > 0.05
        # τ rounds at 4 ulp of 8 turns. Flutter multiplies this by 2π·6.9 and the leaf's arm. Coordinates are small.
        np.testing.assert_allclose(points_of(evaluate(obj)), expected, rtol=0.0, atol=2e-5)


@pytest.mark.parametrize("mirrored", [1.0, -1.0])
def test_the_direction_of_the_wind_is_in_world_space(mirrored: float) -> None:
    matrix = Matrix.LocRotScale(Vector((30.0, -7.0, 4.0)), Euler((0.3, 0.2, 2.0)), Vector((2.5, 2.5, 2.5 * mirrored)))
    tree = some_leaves()
    obj = tree.build(matrix=matrix)
    add_wind_modifier(obj, SETTINGS)
    for frame in FRAMES:
        expected = tree.expected(air_of(SETTINGS, at_frame(frame), matrix), 0.0)
        np.testing.assert_allclose(points_of(evaluate(obj)), expected, rtol=0.0, atol=4e-5)


@pytest.mark.parametrize("strength", [0.0, -0.0])
def test_at_strength_0_the_output_is_the_input_bit_for_bit(strength: float) -> None:
    tree = some_leaves()
    obj, still = tree.build("Blown"), tree.build("Still")
    for each in (obj, still):
        set_manual(add_lod_modifier(each, LodSettings(start=1.0, end=2.0)), transition=0.4, keep=0.7)
    by_hand(add_wind_modifier(obj, replace(SETTINGS, wind=replace(WIND, strength=strength))), 0.4)
    for frame in FRAMES:
        at_frame(frame)
        assert points_of(evaluate(obj)).tobytes() == points_of(evaluate(still)).tobytes()


def test_a_pivot_moves_with_the_trunk_at_its_place() -> None:
    """A corner of each leaf is its pivot, and a branch ends there. Half of the leaves are pruned."""
    leaves = many_leaves(40)
    corners = leaves.points.reshape(-1, 3, 3).copy()
    corners[:, 0] = leaves.pivots
    tree = replace(some_leaves(40), leaves=replace(leaves, points=corners.reshape(-1, 3)))
    obj = tree.build()
    set_manual(add_lod_modifier(obj, LodSettings(start=1.0, end=2.0)), transition=0.0, keep=0.5)
    add_wind_modifier(obj, SETTINGS)
    trunk = place(build(replace(leaves, points=np.repeat(leaves.pivots, 3, axis=0)), attributes=False), "Trunk")
    add_wind_modifier(trunk, SETTINGS)
    for frame in FRAMES:
        seconds = at_frame(frame)
        ends = points_of(evaluate(trunk))[::3]
        assert (
            np.abs(ends - leaves.pivots - sway_at(leaves.pivots.astype(float), air_of(SETTINGS, seconds))).max() < 2e-5
        )
        held = points_of(evaluate(obj))[::3]
        assert np.abs(held - ends[leaves.ranks < 0.5]).max() < 4e-6


def test_levels_of_a_tree_sway_in_step_and_trees_do_not() -> None:
    leaves = many_leaves(20)
    places = {"Leaves": (0.0, 0.0), "Cloud": (0.0, 0.0), "Other": (6.0, 0.0), "Third": (0.0, 6.0), "Fourth": (6.0, 6.0)}
    objects = {}
    for name, (x, y) in places.items():
        objects[name] = place(build(leaves), name, Matrix.Translation((x, y, 0.0)))
        add_wind_modifier(objects[name], SETTINGS)
    at_frame(17)
    moved = {name: points_of(evaluate(obj)) for name, obj in objects.items()}
    assert moved["Leaves"].tobytes() == moved["Cloud"].tobytes()
    apart = [name for name in places if name != "Cloud"]
    for number, one in enumerate(apart):
        for other in apart[number + 1 :]:
            assert np.abs(moved[one] - moved[other]).max() > 0.02, (one, other)


@pytest.mark.parametrize("strength", [1.0, -30.0, 1e9])
def test_nothing_moves_farther_than_the_bound(strength: float) -> None:
    """|w| ≤ |σ|·(A·H·η² + B·Q·ρ²), and the foot stays."""
    settings = replace(SETTINGS, wind=replace(WIND, strength=strength), swing=Swing(sway=0.3, branches=0.2))
    places = np.float32([[0.1, -0.2, -4.0], [2.0, 1.0, -5.0], [0.1, -0.2, 4.0], [3.0, -0.2, 1.0], [-1.0, 2.0, 3.5]])
    mesh = bpy.data.meshes.new("Trunk")
    mesh.from_pydata(places.tolist(), [(0, 2)], [])
    obj = place(mesh)
    add_wind_modifier(obj, settings)
    y = places.astype(float) - STATURE.foot
    eta, rho = np.maximum(y[:, 2], 0.0) / STATURE.height, np.linalg.norm(y[:, :2], axis=1) / STATURE.spread
    bound = 0.3 * STATURE.height * eta**2 + 0.2 * STATURE.spread * rho**2
    moved = np.zeros(len(places))
    for frame in range(0, 240, 5):
        at_frame(frame)
        moved = np.maximum(moved, np.linalg.norm(points_of(evaluate(obj)) - places, axis=1))
    force = abs(strength) / (abs(strength) + 4.0)
    assert (moved <= force * bound + 1e-5).all()
    assert moved[0] == 0.0
    assert (moved[2:] > 0.2 * force * bound[2:]).all()


def test_steady_wind_bends_the_tree_and_gusts_swing_it() -> None:
    """The top lies on the axis, where no branch swings. It stands still at G = 0 and swings at G = 1."""
    mesh = bpy.data.meshes.new("Top")
    mesh.from_pydata([(0.1, -0.2, 4.0)], [], [])
    obj = place(mesh)
    modifier = add_wind_modifier(obj, replace(SETTINGS, wind=Wind(strength=4.0, gusts=0.0)))
    found = {}
    for gusts in (0.0, 1.0):
        set_modifier_input(modifier, "Gusts", gusts)
        found[gusts] = []
        for frame in range(0, 120, 3):
            at_frame(frame)
            found[gusts].append(float(points_of(evaluate(obj))[0, 0]) - 0.1)
    assert np.allclose(found[0.0], 0.5 * 0.1 * STATURE.height, atol=1e-5)
    assert min(found[1.0]) < -0.1
    assert max(found[1.0]) > 0.1


def test_direction_and_strength_follow_the_field() -> None:
    tree = some_leaves()
    obj = tree.build(matrix=Matrix.Rotation(0.7, 4, "Z"))
    field = add_field("WIND", strength=3.0)
    settings = replace(SETTINGS, wind=replace(WIND, strength=3.0, field="Breeze"))
    modifier = add_wind_modifier(obj, settings)
    assert get_modifier_input(modifier, "Strength") == 3.0
    at_frame(9)
    for turn, strength in (((0.0, 0.0, 0.0), 3.0), ((math.pi / 2.0, 0.0, 0.4), 12.0), ((0.3, -1.0, 2.0), -2.0)):
        field.rotation_euler, field.field.strength = turn, strength
        field.location = (5.0, 6.0, 7.0)
        along = tuple(Euler(turn).to_matrix() @ Vector((0.0, 0.0, 1.0)))
        blowing = replace(settings, wind=Wind(along, strength, WIND.gusts))
        expected = tree.expected(air_of(blowing, 9 / FPS, Matrix.Rotation(0.7, 4, "Z")), 0.0)
        np.testing.assert_allclose(points_of(evaluate(obj)), expected, rtol=0.0, atol=4e-5)
    field.field.strength = 0.0
    assert points_of(evaluate(obj)).tobytes() == tree.leaves.points.tobytes()


def test_the_transition_follows_the_camera_as_in_the_level() -> None:
    tree = some_leaves()
    obj = tree.build()
    centre = (0.5, 0.0, 0.0)
    add_lod_modifier(obj, LodSettings(start=8.0, end=16.0, centre=centre))
    add_wind_modifier(obj, replace(SETTINGS, start=8.0, end=16.0, centre=centre))
    camera = add_camera((0.0, 0.0, 0.0))
    for distance, a in ((4.0, 0.0), (11.0, 0.375), (16.0, 1.0)):
        camera.location = (0.5 + distance, 0.0, 0.0)
        expected = tree.expected(air_of(SETTINGS, at_frame(31)), a)
        np.testing.assert_allclose(points_of(evaluate(obj)), expected, rtol=0.0, atol=2e-5)


def test_pruned_leaves_grow_about_pivots_moved_by_the_wind() -> None:
    """Wind before the scene's pruning is equal to wind after a level's, except that wind changes the areas for s."""
    leaves = many_leaves(50)
    steady = replace(SETTINGS, swing=Swing(flutter=0.0))
    tree, after = place(build(leaves), "Tree"), place(build(leaves), "After")
    before = add_wind_modifier(tree, replace(steady, move_pivots=True))
    trees = bpy.data.collections.new("Trees")
    trees.objects.link(tree)
    bpy.context.scene.collection.objects.unlink(tree)
    scene = place(bpy.data.meshes.new("Nothing"), "Scene")
    add_scene_modifier(scene, trees, SceneSettings(prune_start=5.0, strength=0.0))
    add_lod_modifier(after, LodSettings(start=1e6, end=1e7, prune_start=5.0))
    add_wind_modifier(after, steady)
    add_camera((20.0, 0.0, 0.0))
    at_frame(31)
    expected = points_of(evaluate(after))
    assert 0 < len(expected) < len(leaves.points)
    assert np.abs(points_of(evaluate(scene)) - expected).max() < 0.01
    set_modifier_input(before, "Move Pivots", False)
    assert np.abs(points_of(evaluate(scene)) - expected).max() > 0.05


READ_WITHOUT_ADDON = """
import json, sys, bpy
bpy.ops.wm.open_mainfile(filepath=sys.argv[1], use_scripts=False)
found = []
for frame in (0, 31):
    bpy.context.scene.frame_set(frame)
    mesh = bpy.data.objects["Tree"].evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    found.append([list(vertex.co) for vertex in mesh.vertices])
with open(sys.argv[2], "w") as file:
    json.dump({"points": found, "addon": [name for name in sys.modules if name.split(".")[0] == "addon"]}, file)
"""


def test_the_group_works_from_a_file_without_the_addon(tmp_path: Path) -> None:
    tree = some_leaves()
    obj = tree.build()
    field = add_field("WIND", strength=6.0)
    field.rotation_euler = (math.pi / 2.0, 0.0, 0.0)
    add_wind_modifier(obj, replace(SETTINGS, wind=replace(WIND, field="Breeze", strength=1.0)))
    saved, read = tmp_path / "tree.blend", tmp_path / "read.json"
    bpy.ops.wm.save_as_mainfile(filepath=str(saved))

    # -I keeps this folder and PYTHONPATH out of the search for modules.
    command = [sys.executable, "-I", "-c", READ_WITHOUT_ADDON, str(saved), str(read)]
    subprocess.run(command, check=True, cwd=tmp_path, timeout=120)
    found = json.loads(read.read_text())
    assert found["addon"] == []
    blowing = replace(SETTINGS, wind=Wind((0.0, -1.0, 0.0), 6.0, WIND.gusts))
    for frame, points in zip((0, 31), found["points"], strict=True):
        np.testing.assert_allclose(points, tree.expected(air_of(blowing, frame / FPS), 0.0), rtol=0.0, atol=4e-5)


def test_the_node_groups_are_created_once() -> None:
    foreign = bpy.data.node_groups.new(GROUP_NAME, "GeometryNodeTree")
    group = wind_group()
    assert group != foreign
    assert wind_group() == group
    names = ["Leafcloud Eye", "Leafcloud Sway", GROUP_NAME, f"{GROUP_NAME}.001"]
    assert sorted(tree.name for tree in bpy.data.node_groups) == names
    assert [tree.is_modifier for tree in (group, bpy.data.node_groups["Leafcloud Sway"])] == [True, False]


def test_the_inputs_have_their_documented_names() -> None:
    sockets = [item for item in wind_group().interface.items_tree if item.item_type == "SOCKET"]
    assert [socket.name for socket in sockets if socket.in_out == "OUTPUT"] == ["Geometry"]
    assert [socket.name for socket in sockets if socket.in_out == "INPUT"] == [
        *("Geometry", "Field", "Direction", "Strength", "Gusts", "Period", "Sway", "Branches", "Flutter", "Foot", "Up"),
        *("Height", "Spread", "Move Pivots", "Start", "End", "Centre", "LOD Distance", "Stagger"),
        *("Manual", "Transition"),
    ]
    assert all(socket.description for socket in sockets if socket.name != "Geometry")


def test_each_node_has_a_labeled_frame_and_its_own_place() -> None:
    wind_group()
    for group in bpy.data.node_groups:
        nodes = [node for node in group.nodes if node.bl_idname != "NodeFrame"]
        assert all(node.parent.label for node in nodes)
        assert len({(node.parent.name, *node.location) for node in nodes}) == len(nodes)


@pytest.mark.parametrize("values", [{"sway": -0.1}, {"branches": 1.5}, {"flutter": 2.0}, {"sway": math.nan}])
def test_a_swing_out_of_range_is_refused(values: dict[str, float]) -> None:
    [(name, value)] = values.items()
    with pytest.raises(ValueError, match=rf"{name} is {value}, it must be in \[0, "):
        Swing(**values)
