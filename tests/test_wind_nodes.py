"""The wind's node group, read from evaluated meshes and compared with the law, which tests/laws.py writes out."""

from __future__ import annotations

from dataclasses import dataclass, replace

import bpy
import numpy as np
import pytest
from laws import Air, Floats, blown, fluttered, tree_turns
from lod_scenes import Leaves, build, evaluate, many_leaves, place, points_of, store
from mathutils import Matrix

from addon.build.lod_nodes import LodSettings, add_lod_modifier, set_manual
from addon.build.wind_nodes import WindSettings, add_wind_modifier
from addon.plan.wind import Stature, Wind
from addon.versions import set_modifier_input

STATURE = Stature(foot=(0.1, -0.2, -4.0), up=(0.0, 0.0, 1.0), height=8.0, spread=3.0, period=2.5)
WIND = Wind(direction=(0.6, 0.8, 0.0), strength=6.0, gusts=0.7)
SETTINGS = WindSettings(STATURE, WIND)
FRAMES = (0, 7, 31, 200)
FPS = 24.0


@dataclass(frozen=True)
class Blown:
    """Leaves of which each has a phase, a freedom and a billboard's pivot, (n,) and (n, 3)."""

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
        """Of all leaves, none pruned."""
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
    """Goes there; the seconds."""
    bpy.context.scene.frame_set(frame)
    return frame / FPS


def air_of(settings: WindSettings, seconds: float, matrix: Matrix | None = None) -> Air:
    """By the world matrix of the tree: where the wind blows to in its coordinates, and when its turn is."""
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


def add_field(kind: str, name: str = "Breeze", **settings: float) -> bpy.types.Object:
    obj = bpy.data.objects.new(name, None)
    bpy.context.scene.collection.objects.link(obj)
    bpy.context.view_layer.objects.active = obj
    bpy.ops.object.forcefield_toggle()
    obj.field.type = kind
    for key, value in settings.items():
        setattr(obj.field, key, value)
    return obj


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
        # τ rounds at 4 ulp of 8 turns, times 2π·6.9, times the leaf's arm; places themselves are a few units.
        np.testing.assert_allclose(points_of(evaluate(obj)), expected, rtol=0.0, atol=2e-5)
