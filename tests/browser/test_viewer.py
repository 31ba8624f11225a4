"""The leaves in the viewer have the same places as those of the node group in the baked .blend."""

from __future__ import annotations

import base64
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from bakes import folder_of
from browser import ask
from command_line import QUICK, bake, saved
from glb import Node, read_glb
from laws import KNOTS, Floats, drawn_share, ramp, transition, trend
from lod_scenes import add_camera
from mathutils import Euler, Matrix, Vector
from night import rest_at_night
from viewing import PAGE, PATIENCE, Pruning, apart, attribute, by_leaf, drawn_by_nodes, drawn_by_shader, pivots_of

from addon.mesh.meshes import PROTECT
from addon.nodes.lod import NEVER
from addon.versions import set_modifier_input


@dataclass(frozen=True)
class Rest:
    """A level at rest, as in its file.

    reach: for each leaf, by rank, its largest distances from the origin and from its pivot, and its longest morph.
    ranks, areas: of each triangle; the area of a protected triangle is 0. shares: the table of areas.
    """

    reach: dict[float, tuple[float, float, float]]
    ranks: Floats
    areas: Floats
    shares: Floats

    def true_drawn_share(self, keep: float) -> float:
        return float((self.areas * ramp(self.ranks, np.array(keep)) ** 2).sum() / self.areas.sum())

    def unevenness(self, keep: float) -> float:
        """Return the largest difference over the ramp between the true share of area by rank and the table's share.

        The true share has a step at each leaf. ∫r²dC differs by no more (integrate by parts: r² falls from 1 to 0).
        """
        start = keep * (1.0 - min(0.05, 1.0 - keep))
        at = np.concatenate([[start, keep], self.ranks[(self.ranks >= start) & (self.ranks < keep)]])
        model = np.interp(at, [start, keep], np.interp([start, keep], KNOTS, self.shares))
        below, upto = (
            np.array([self.areas[compare(self.ranks, x)].sum() for x in at]) / self.areas.sum()
            for compare in (np.less, np.less_equal)
        )
        return float(max(np.abs(below - model).max(), np.abs(upto - model).max()))


def rest_of(node: Node) -> Rest:
    ranks, rows = [], []
    for primitive in node.primitives:
        [target] = primitive.targets
        ranks.append(attribute(primitive, "_LEAF_RANK")[primitive.indices, 0])
        columns = [attribute(primitive, "POSITION"), target["POSITION"].astype(float), pivots_of(primitive)]
        rows.append(np.hstack(columns)[primitive.indices])
    corners = np.concatenate(rows)
    sides = np.diff(corners[..., :3], axis=1)
    of_triangles = np.concatenate(ranks)[:, 0]
    areas = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1) / 2.0
    return Rest(
        reach={
            rank: tuple(
                float(np.linalg.norm(each, axis=1).max())
                for each in (row[:, :3], row[:, :3] - row[:, 6:9], row[:, 3:6])
            )
            for rank, row in by_leaf(np.concatenate(ranks).ravel(), corners.reshape(-1, 12)).items()
        },
        ranks=of_triangles,
        areas=np.where(of_triangles < 0.0, 0.0, areas),
        shares=np.array(node.mesh_extras["leafcloud"]["area_shares"]),
    )


def moved(tree: Path, folder: Path, protected: Sequence[int] = ()) -> Path:
    """Save the tree in a new scene, rotated, scaled and far from the origin. Protect the leaves of these points."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=str(tree))
    if protected:
        bpy.data.objects["leaves"].vertex_groups.new(name=PROTECT).add(protected, 1.0, "REPLACE")
    place = Matrix.LocRotScale(Vector((30.0, -7.0, 4.0)), Euler((0.3, 0.2, 2.0)), Vector((2.5, 2.5, 2.5)))
    for obj in bpy.context.scene.objects:
        if obj.parent is None:
            obj.matrix_world = place @ obj.matrix_world
    return saved(folder / tree.with_suffix(".blend").name)


BY_BOUND = ("--pixels", "8")
"""Flags for LOD distances by the error bound: the tree then prunes long before level 1 takes over."""


@pytest.fixture(scope="module", params=rest_at_night(["as it is", "moved and pruned", "moved"], 2))
def baked(request: pytest.FixtureRequest, shrub: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The last bake prunes leaves and protects one of them. The others keep all leaves until level 1 takes over."""
    if request.param == "as it is":
        return folder_of("leaves pruned")
    folder, out = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("shrub")
    if request.param == "moved":
        bake(moved(shrub, folder), out, *QUICK, "--effects=+pruning")
    else:
        bake(moved(shrub, folder, protected=[400]), out, *QUICK, *BY_BOUND, "--chain", "both", "--prune-pixels", "60")
    return out


def vanishing(nodes: dict[str, Node]) -> list[float]:
    """Return the distance of each hand-over: where a = 0.998, or the next level's switch distance."""
    extras = [nodes[f"shrub_LOD{number}"].extras["leafcloud"] for number in range(4)]
    return [
        each["transition_start"] + 0.998 * (each["transition_end"] - each["transition_start"])
        if "transition_end" in each
        else following["switch_distance"]
        for each, following in itertools.pairwise(extras)
    ]


@dataclass(frozen=True)
class Tree:
    """A baked tree: the nodes of its file, and the distance where each level hands over."""

    folder: Path
    nodes: dict[str, Node]
    vanish: list[float]
    centre: Floats

    @property
    def as_baked(self) -> bool:
        """True if the file's own numbers prune the tree. Otherwise the tests prune the levels by hand."""
        return "prune_start" in self.nodes["shrub_LOD0"].extras["leafcloud"]

    def pruning(self, number: int) -> Pruning:
        """Return the pruning of a level. A bake prunes the leaves alone. The tests prune each level by hand."""
        if not self.as_baked:
            return Pruning(0.4 * self.vanish[0])
        if number > 0:
            return Pruning(NEVER)
        extras = self.nodes["shrub_LOD0"].extras["leafcloud"]
        numbers = (tuple(extras[name]) for name in ("growth", "contrast", "mean_color"))
        return Pruning(extras["prune_start"], extras["prune_half"], *numbers)

    @property
    def settings(self) -> dict[str, Any]:
        """Settings of the viewer."""
        by_hand = {} if self.as_baked else {"pruneStart": self.pruning(0).start, "pruneHalf": self.pruning(0).half}
        return {"hysteresis": 0.0, "stagger": 0.0, **by_hand}

    def eyes(self) -> list[tuple[int, Floats]]:
        """Return eyes all around the tree, in glTF's coordinates, each with its visible level.

        The distances cover transitions and pruning from start to end, and each hand-over: before, during and after. At
        no distance is λ equal to the rank of a leaf.
        """
        first, second, third = self.vanish
        near = [(0, share * first) for share in (0.3, 0.45, 0.71, 0.9, 0.999, 1.024)]
        middle = [
            (1, 1.081 * first),
            *((1, first + share * (second - first)) for share in (0.5, 0.75)),
            *((1, share * second) for share in (0.999, 1.048)),
        ]
        far = [(2, 1.081 * second), (2, 1.06 * third), (3, 1.151 * third), (3, 2.0 * third)]
        count = len(near + middle + far)
        angles = np.arange(count) * math.pi * (3.0 - math.sqrt(5.0))
        directions = np.stack([np.cos(angles), np.linspace(-0.3, 0.8, count), np.sin(angles)], -1)
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        places = [
            (level, self.centre + distance * way)
            for (level, distance), way in zip(near + middle + far, directions, strict=True)
        ]
        return places


@pytest.fixture(scope="module")
def tree(baked: Path) -> Tree:
    nodes = read_glb(baked / "shrub.glb")
    points = np.concatenate([p.attributes["POSITION"] for p in nodes["shrub_LOD0"].primitives])
    places = nodes["shrub_LOD0"].to_world(points)
    return Tree(baked, nodes, vanishing(nodes), (places.min(axis=0) + places.max(axis=0)) / 2.0)


def viewed(tree: Tree, **settings: Any) -> list[dict[str, Any]]:
    """Return the viewer's answer for each of the tree's eyes."""
    question = {
        "tree": "/files/shrub.glb",
        "settings": {**tree.settings, **settings},
        "eyes": [eye.tolist() for _, eye in tree.eyes()],
    }
    return ask(PAGE, question, patience=PATIENCE, files=tree.folder)["seen"]


@pytest.fixture(scope="module")
def views(tree: Tree) -> list[dict[str, Any]]:
    return viewed(tree)


def colors(view: dict[str, Any]) -> Floats:
    """Return the colors (p, 4) of the pixels that are not empty."""
    pixels = np.frombuffer(base64.b64decode(view["pixels"]), "<f4").reshape(-1, 4)
    return pixels[pixels[:, 3] > 0.0].astype(float)


def open_blend(tree: Tree) -> list[bpy.types.Object]:
    """Open the baked scene and return its levels, pruned like in the viewer."""
    bpy.ops.wm.open_mainfile(filepath=str(tree.folder / "shrub.blend"))
    levels = [bpy.data.objects[f"shrub_LOD{number}"] for number in range(4)]
    for obj in levels[:2] if not tree.as_baked else []:
        [modifier] = obj.modifiers
        set_modifier_input(modifier, "Prune Start", tree.pruning(0).start / obj.matrix_world.median_scale)
        set_modifier_input(modifier, "Prune Half", tree.pruning(0).half)
    return levels


def test_the_viewer_draws_the_leaves_of_the_node_group(tree: Tree, views: list[dict[str, Any]]) -> None:
    levels = open_blend(tree)
    camera = add_camera((0.0, 0.0, 0.0))
    rests = [rest_of(tree.nodes[f"shrub_LOD{number}"]) for number in (0, 1)]
    for (number, eye), view in zip(tree.eyes(), views, strict=True):
        camera.location = (eye[0], -eye[2], eye[1])
        bpy.context.view_layer.update()
        by_nodes = [drawn_by_nodes(obj) for obj in levels]
        coming = [number + 1] if view["share"] > 0.0 else []
        assert [level for level, leaves in enumerate(by_nodes) if leaves] == [number, *coming]
        assert view["level"] == number
        node = tree.nodes[f"shrub_LOD{number}"]
        by_shader = drawn_by_shader(node, view["meshes"])
        if coming:  # Where the viewer dithers, in Blender some billboards have taken the place of their leaves.
            assert by_shader.keys() >= by_nodes[number].keys()
            continue
        assert by_shader.keys() == by_nodes[number].keys()
        if number < 2:
            distance = float(np.linalg.norm(eye - tree.centre))
            assert_same_places(by_shader, by_nodes[number], rests[number], distance, node, tree.pruning(number))
        else:
            assert all(apart(by_shader[rank][:, :3], by_nodes[number][rank]) == 0.0 for rank in by_shader)


def assert_same_places(
    shader: dict[float, Floats], nodes: dict[float, Floats], rest: Rest, distance: float, node: Node, pruning: Pruning
) -> None:
    """Compare places after a correction for s, because the shader reads s from the table."""
    extras = node.extras["leafcloud"]
    a = float(transition(distance, extras["transition_start"], extras["transition_end"]))
    keep = pruning.keep(distance)
    true, model = rest.true_drawn_share(keep), float(drawn_share(keep, rest.shares))
    assert abs(true - model) <= rest.unevenness(keep) + 1e-6
    for rank, rows in shader.items():
        pivot = (1.0 - a) * rows[:, 3:6] + a * rows[:, 6:]
        points = pivot + (rows[:, :3] - pivot) * (math.sqrt(model / true) if rank >= 0.0 else 1.0)
        off = apart(points, nodes[rank])
        assert off <= tolerance(rest, rank, keep, distance, extras, pruning), (rank, a, keep, off)


def tolerance(rest: Rest, rank: float, keep: float, distance: float, extras: dict[str, Any], pruning: Pruning) -> float:
    """Return the largest distance between the places of a leaf that rounding explains.

    Shader and nodes each have an error of some 4 ulp in the distance and of 8 ulp in coordinates. The center has an
    error of 2 ulp. So λ has an error of 10 ulp, r of 1/0.05 times as much, γ of less than 16 ulp.
    """
    ulp = 2.0**-23
    greatest, arm, way = rest.reach[rank]
    growth = pruning.growth_at(keep) / math.sqrt(float(drawn_share(keep, rest.shares)))
    span = extras["transition_end"] - extras["transition_start"]
    by_points = 16.0 * ulp * (1.0 + growth) * (greatest + arm + way)
    by_transition = 12.0 * ulp * distance / span * way * (1.0 + growth)
    by_ramp = arm * growth * (10.0 / 0.05 + 16.0) * ulp
    return by_points + by_transition + by_ramp


def test_the_viewer_draws_only_the_kept_triangles(tree: Tree, views: list[dict[str, Any]]) -> None:
    """The viewer draws the first triangles of the order, and the picture is not empty."""
    whole = sum(len(primitive.indices) for primitive in tree.nodes["shrub_LOD0"].primitives)
    for (number, eye), view in zip(tree.eyes(), views, strict=True):
        assert len(colors(view)) > 200
        if number == 0:
            keep = tree.pruning(0).keep(float(np.linalg.norm(eye - tree.centre)))
            drawn = sum(mesh["count"] // 3 for mesh in view["meshes"])
            assert keep * whole - 2 <= drawn <= (keep + 1 / 64) * whole + 4  # one more leaf, one protected
        if view["share"] == 0.0:  # Otherwise the next level is drawn, too.
            others = sum(len(primitive.indices) for primitive in tree.nodes[f"shrub_LOD{number}"].trunk)
            assert view["triangles"] == others + sum(mesh["count"] // 3 for mesh in view["meshes"])


def test_a_level_fades_in_beyond_the_hand_over(tree: Tree, views: list[dict[str, Any]]) -> None:
    """After a morph the cross-fade takes a tenth of the distance, without a morph a quarter."""
    shares = [view["share"] for view in views]
    assert shares == pytest.approx([*[0.0] * 5, 0.3, *[0.0] * 4, 0.6, 0.0, 0.4, 0.0, 0.0], abs=1e-3)


def test_the_file_has_the_numbers_of_pruning(tree: Tree) -> None:
    """At least four eyes see pruned leaves. Growth and contrast are visible there, and one leaf is protected."""
    ranks = np.concatenate([p.attributes["_LEAF_RANK"][:, 0] for p in tree.nodes["shrub_LOD0"].primitives])
    assert len(np.unique(ranks[ranks < 0.0])) == int(tree.as_baked)
    if tree.as_baked:
        pruning = tree.pruning(0)
        keeps = [pruning.keep(float(np.linalg.norm(eye - tree.centre))) for number, eye in tree.eyes() if number == 0]
        assert sum(keep < 0.95 for keep in keeps) >= 4
        assert abs(pruning.growth_at(keeps[-1]) - 1.0) > 0.01
        assert contrast_at(pruning, keeps[-1]) < 0.95


def contrast_at(pruning: Pruning, keep: float) -> float:
    return min(float(trend(np.array(keep), *pruning.contrast)), 1.0)


def test_colors_of_pruned_leaves_are_pulled_toward_their_mean(tree: Tree, views: list[dict[str, Any]]) -> None:
    """A pixel shows the unchanged trunk, or a leaf. κ multiplies the leaf's difference from the mean color.

    All leaves have the same light, except for the ORM of three.js: up to a tenth less, equal in each channel.
    """
    for (number, eye), view, plain in zip(tree.eyes(), views, viewed(tree, contrast=False), strict=True):
        before, after = colors(plain), colors(view)
        pulled = (before != after).any(axis=1)
        pruning = tree.pruning(number)
        contrast = contrast_at(pruning, pruning.keep(float(np.linalg.norm(eye - tree.centre))))
        if contrast == 1.0:
            assert not pulled.any()
            continue
        mean = (after[pulled, :3] - contrast * before[pulled, :3]) / (1.0 - contrast)
        light = mean / np.array(pruning.mean)
        assert pulled.mean() > 0.5
        assert (np.ptp(light, axis=1) < 1e-3).all()
        assert ((light > 0.9) & (light < 1.0)).all()
