"""The viewer compared with the node group, with leaves pruned until the cross impostor (`--chain pruning`)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from bakes import folder_of
from browser import ask
from glb import Node, read_glb
from laws import Floats, drawn_share, ramp
from lod_scenes import add_camera
from viewing import PAGE, PATIENCE, Pruning, drawn_by_nodes, drawn_by_shader

from addon.plan.pruning import CUT_OFF

SHARES = (0.7, 1.0, 1.7, 5.3, 22.0, 71.0)
"""Distances in units of d₀. They keep 1, 1, 0.59, 0.19, 0.05 and 0.01 of the leaves; half is kept at 2 d₀."""
FADE, GONE = 1.06, 1.151
"""Distances during and after the fade, in units of the distance where the cross impostor starts to fade in."""


@dataclass(frozen=True)
class Tree:
    """A baked tree: its leaves and the eyes that look at it, in glTF's coordinates."""

    folder: Path
    leaves: Node
    pruning: Pruning
    vanish: float
    centre: Floats

    @property
    def distances(self) -> list[float]:
        return [share * self.pruning.start for share in SHARES] + [FADE * self.vanish, GONE * self.vanish]

    @property
    def eyes(self) -> list[Floats]:
        ways = np.random.default_rng(2).normal(size=(len(self.distances), 3))
        ways /= np.linalg.norm(ways, axis=1, keepdims=True)
        return [self.centre + distance * way for distance, way in zip(self.distances, ways, strict=True)]


@pytest.fixture(scope="module")
def tree() -> Tree:
    out = folder_of("pruned")
    nodes = read_glb(out / "shrub.glb")
    assert not {"shrub_LOD2", "shrub_LOD3"} & nodes.keys(), "the chain must have only leaves and cross impostor"
    leaves = nodes["shrub_LOD0"]
    extras = leaves.extras["leafcloud"]
    numbers = (tuple(extras[name]) for name in ("growth", "contrast", "mean_color"))
    places = leaves.to_world(np.concatenate([p.attributes["POSITION"] for p in leaves.primitives]))
    return Tree(
        folder=out,
        leaves=leaves,
        pruning=Pruning(extras["prune_start"], extras["prune_half"], *numbers),
        vanish=nodes["shrub_LOD1"].extras["leafcloud"]["switch_distance"],
        centre=(places.min(axis=0) + places.max(axis=0)) / 2.0,
    )


@pytest.fixture(scope="module")
def views(tree: Tree) -> list[dict[str, Any]]:
    question = {
        "tree": "/files/shrub.glb",
        "settings": {"hysteresis": 0.0, "stagger": 0.0},
        "eyes": [eye.tolist() for eye in tree.eyes],
    }
    return ask(PAGE, question, patience=PATIENCE, files=tree.folder)["seen"]


def test_leaves_are_pruned_until_the_cross_impostor_takes_over(tree: Tree, views: list[dict[str, Any]]) -> None:
    assert [view["level"] for view in views] == [0] * 7 + [1]
    assert [view["share"] > 0.0 for view in views] == [False] * 6 + [True, False]
    assert tree.pruning.keep(tree.vanish) == pytest.approx(CUT_OFF, rel=1e-5)
    ranks = np.unique(np.concatenate([p.attributes["_LEAF_RANK"][:, 0] for p in tree.leaves.primitives]))
    counts = [len(drawn_by_shader(tree.leaves, view["meshes"])) for view in views[:7]]
    assert counts == [np.count_nonzero(ranks < tree.pruning.keep(distance)) for distance in tree.distances[:7]]
    assert counts[1] == len(ranks) > 10 * counts[4] > 0


def test_the_viewer_keeps_the_leaves_of_the_node_group(tree: Tree, views: list[dict[str, Any]]) -> None:
    """Each leaf has the same size, after a correction for s, because the shader reads s from the table."""
    table = np.array(tree.leaves.mesh_extras["leafcloud"]["area_shares"])
    ranks, areas = areas_of(tree.leaves)
    bpy.ops.wm.open_mainfile(filepath=str(tree.folder / "shrub.blend"))
    camera, leaves = add_camera((0.0, 0.0, 0.0)), bpy.data.objects["shrub_LOD0"]
    for eye, distance, view in zip(tree.eyes[:7], tree.distances, views, strict=False):
        camera.location = (eye[0], -eye[2], eye[1])
        bpy.context.view_layer.update()
        by_nodes, by_shader = drawn_by_nodes(leaves), drawn_by_shader(tree.leaves, view["meshes"])
        assert by_shader.keys() == by_nodes.keys()
        keep = tree.pruning.keep(distance)
        true = float((areas * ramp(ranks, np.array(keep)) ** 2).sum() / areas.sum())
        ratio = math.sqrt(true / float(drawn_share(keep, table)))
        for rank, rows in by_shader.items():
            pivot = rows[0, 3:6]
            shader, nodes = (np.linalg.norm(points - pivot, axis=1).max() for points in (rows[:, :3], by_nodes[rank]))
            assert shader == pytest.approx(ratio * nodes, rel=1e-4, abs=1e-6), (rank, keep)


def areas_of(node: Node) -> tuple[Floats, Floats]:
    """Return the rank and the area of each triangle, (t,) each."""
    ranks, areas = [], []
    for primitive in node.primitives:
        corners = primitive.attributes["POSITION"][primitive.indices].astype(float)
        sides = np.diff(corners, axis=1)
        areas.append(np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1) / 2.0)
        ranks.append(primitive.attributes["_LEAF_RANK"][primitive.indices[:, 0], 0].astype(float))
    return np.concatenate(ranks), np.concatenate(areas)
