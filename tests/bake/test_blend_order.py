"""Alpha-blended leaves: the plan, the alpha in the atlases, and the drawing order from back to front."""

from __future__ import annotations

import base64
import dataclasses
import json
import re
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from browser import FILES, ask
from command_line import bake, saved
from glb import Node, read_glb
from mathutils import Matrix, Vector
from node_trees import new_image, new_material, texture_node
from numpy.typing import NDArray
from plan_scenes import add_camera, add_crown, plan_of, principled
from scenes import add_mesh
from viewing import PAGE, PATIENCE

import leafcloud
from addon.settings.bake import BakeSettings

COLORS = ((0.8, 0.1, 0.1), (0.1, 0.7, 0.1), (0.1, 0.1, 0.9))
ALPHA = 0.5
SIDE = 1.0
"""Half of a card's side."""


def cards() -> NDArray[np.float64]:
    """Return the corners (3, 4, 3) of three squares through one point. No square is parallel to an axis plane."""
    turn, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
    squares = []
    for normal in range(3):
        across, up = turn[(normal + 1) % 3], turn[(normal + 2) % 3]
        squares.append([SIDE * (a * across + b * up) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
    return np.array(squares)


@pytest.fixture(scope="module")
def baked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a bake of three crossing, half-transparent cards."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    materials = [
        principled(f"leaf {number}", Alpha=ALPHA, Roughness=1.0, Base_Color=(*color, 1.0))
        for number, color in enumerate(COLORS)
    ]
    corners = [tuple(corner) for corner in cards().reshape(-1, 3).tolist()]
    obj = add_mesh("leaves", corners, [(0, 1, 2, 3), (4, 5, 6, 7), (8, 9, 10, 11)], materials=materials)
    for number, polygon in enumerate(obj.data.polygons):
        polygon.material_index = number
    source = saved(tmp_path_factory.mktemp("source") / "cards.blend")
    out = tmp_path_factory.mktemp("cards")
    flags = ("--levels", "1", "--no-cross", "--texture-size", "128", "--epsilon", "0.01", "--engine", "bevy")
    bake(source, out, *flags, "--effects=-back_sides")
    return out


@pytest.fixture(scope="module")
def node(baked: Path) -> Node:
    return read_glb(baked / "cards.glb")["cards_LOD1"]


def test_the_plan_turns_blend_order_on_for_transparent_leaves() -> None:
    plans = {}
    for name, alpha in [("soft", 0.5), ("opaque", 1.0)]:
        bpy.ops.wm.read_factory_settings(use_empty=True)
        plans[name] = plan_of(add_crown(principled("leaf", Alpha=alpha)))["blend_order"]
    assert plans["soft"].on is True
    assert plans["soft"].reason == "the material 'leaf' is semi-transparent, so it is drawn back to front"
    assert plans["soft"].seconds == 0.0, "what it costs is told by another function"
    assert plans["opaque"].on is False
    assert plans["opaque"].reason == "no leaf material is alpha blended, and cutouts need no draw order"


@pytest.mark.parametrize(("shades", "on"), [((0.0, 1.0), False), ((0.0, 0.5), True), ((0.0, 0.4, 1.0, 1.0), False)])
def test_blended_leaves_with_hard_edges_are_cut_out(shades: tuple[float, ...], on: bool) -> None:
    """Importers and exporters leave such materials if the image's alpha is linked without a cutoff."""
    material, surface, tree = new_material()
    texture = texture_node(tree, new_image("leaf", [[(0.2, 0.5, 0.1, shade) for shade in shades]] * 2))
    tree.links.new(texture.outputs["Color"], surface.inputs["Base Color"])
    tree.links.new(texture.outputs["Alpha"], surface.inputs["Alpha"])
    effect = plan_of(add_crown(material))["blend_order"]
    assert effect.on is on
    assert on or effect.reason == "too few leaves are known to be semi-transparent, so 'm' is cut out"


@pytest.mark.parametrize(("alpha", "on"), [(0.05, True), (0.3, True), (0.8, True), (0.95, False)])
def test_leaves_with_a_constant_alpha_are_blended_below_the_limit(alpha: float, on: bool) -> None:
    assert plan_of(add_crown(principled("leaf", Alpha=alpha)))["blend_order"].on is on


@pytest.mark.parametrize(("alphas", "on"), [((0.5, 0.5), True), ((1.0, 1.0), False), ((0.0, 1.0), False)])
def test_leaves_with_half_transparent_corners_are_blended(alphas: tuple[float, float], on: bool) -> None:
    """Two corners of each card have the first alpha, two the second."""
    material, surface, tree = new_material()
    attribute = tree.nodes.new("ShaderNodeVertexColor")
    attribute.layer_name = "Col"
    tree.links.new(attribute.outputs["Alpha"], surface.inputs["Alpha"])
    crown = add_crown(material)
    colors = crown.data.color_attributes.new("Col", "FLOAT_COLOR", "POINT")
    codes = np.ones((len(crown.data.vertices), 4), np.float32)
    codes[:, 3] = np.repeat(np.tile(alphas, len(codes) // 4), 2)
    colors.data.foreach_set("color", codes.ravel())
    assert plan_of(crown)["blend_order"].on is on


def test_soft_edges_of_narrow_leaves_do_not_count_as_transparency() -> None:
    """Needles are three texels wide, and their soft edges are as wide again."""
    row = [(0.2, 0.5, 0.1, shade) for shade in (0.0, 0.3, 0.7, 1.0, 1.0, 1.0, 0.7, 0.3, 0.0, 0.0)]
    material, surface, tree = new_material()
    texture = texture_node(tree, new_image("needles", [row * 3] * 8))
    tree.links.new(texture.outputs["Alpha"], surface.inputs["Alpha"])
    assert plan_of(add_crown(material))["blend_order"].on is False


@pytest.mark.parametrize(("count", "on"), [(1, False), (30, True)])
def test_the_plan_needs_a_minimum_fraction_of_transparent_leaves(count: int, on: bool) -> None:
    """The crown has 60 leaves. The other leaves are opaque."""
    assert plan_of(mixed(count))["blend_order"].on is on


def mixed(count: int) -> bpy.types.Object:
    """Return a crown with `count` transparent cards, beside cut-out and nearly opaque cards."""
    crown = add_crown(principled("hard"))
    for name, alpha in [("soft", 0.4), ("nearly", 0.95)]:
        crown.data.materials.append(principled(name, Alpha=alpha))
    for number, polygon in enumerate(crown.data.polygons):
        polygon.material_index = 1 if number < count else 2 * (number % 2)
    return crown


@pytest.mark.parametrize(
    ("flags", "radii", "soft"),
    [
        (("--effects=auto",), 3.2, "BLEND"),
        (("--effects=auto",), 0.0, "BLEND"),
        (("--effects=-blend_order",), 0.0, "BLEND"),
    ],
)
def test_glb_leaves_have_the_alpha_mode_of_the_plan(
    flags: tuple[str, ...], radii: float, soft: str, tmp_path: Path
) -> None:
    """The mode also holds if the camera sees only level 0. A cutoff would hide leaves with a constant alpha below ½."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    crown = mixed(30)
    if radii > 0.0:
        add_camera(radii, crown)
    source = saved(tmp_path / "mixed.blend")
    report = bake(source, tmp_path / "out", "--levels", "1", "--no-cross", "--texture-size", "128", *flags)
    primitives = read_glb(tmp_path / "out" / "mixed.glb")["mixed_LOD0"].primitives
    modes = {primitive.material["name"]: primitive.material.get("alphaMode", "OPAQUE") for primitive in primitives}
    assert modes == {"hard": "OPAQUE", "soft": soft, "nearly": "OPAQUE"}
    warned = [warning for warning in report["warnings"] if "is blended" in warning]
    assert any(re.search("'nearly' .* uniform alpha of 0.9.* as opaque", warning) for warning in warned)
    kept = any(re.search("'soft' .* keep its uniform alpha of 0.4", warning) for warning in warned)
    assert kept is ("-blend_order" in flags[0])


def test_a_rotated_tree_is_sorted_from_back_to_front(tmp_path: Path) -> None:
    """Squares stand in a row behind each other on a rotated object. The farthest square comes first."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    turn = Matrix.Rotation(1.2, 4, "X")
    rows = [Vector((x, 0.3 * number, z)) for number in range(8) for x, z in ((0, 0), (1, 0), (1, 1), (0, 1))]
    corners = [tuple(turn.inverted() @ corner) for corner in rows]
    faces = [tuple(range(4 * number, 4 * number + 4)) for number in range(8)]
    add_mesh("leaves", corners, faces, materials=[principled("leaf", Alpha=0.5)], matrix=turn)
    source = saved(tmp_path / "row.blend")
    bake(source, tmp_path / "out", "--levels", "1", "--no-cross", "--texture-size", "128", "--epsilon", "0.02")
    node = read_glb(tmp_path / "out" / "row.glb")["row_LOD1"]
    [primitive] = node.primitives
    depths = node.to_world(primitive.attributes["POSITION"])[primitive.indices][:, :, 2].mean(axis=1)
    assert (np.diff(depths) > -0.01).all()
    assert np.ptp(depths) > 1.5


def test_effects_all_leaves_blend_order_to_the_plan() -> None:
    crown = add_crown(principled("leaf"))
    for effects, on in [("all", False), ("all,+blend_order", True), ("none", False), ("blend_order", True)]:
        assert plan_of(crown, BakeSettings(effects=effects))["blend_order"].on is on, effects


def test_a_camera_that_sees_only_level_0_needs_no_blend_order() -> None:
    crown = add_crown(principled("leaf", Alpha=0.5))
    add_camera(3.2, crown)
    assert plan_of(crown, BakeSettings(viewer="camera"))["blend_order"].on is False


def test_atlas_pages_keep_the_alpha_of_blended_leaves() -> None:
    """Two quads on one billboard let half of the background through."""
    quads = np.array([[(x + 1.2 * i, 0.1 * i, z) for x, z in ((0, 0), (1, 0), (1, 1), (0, 1))] for i in (0, 1)], float)
    triangles = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    material = leafcloud.Material(base_color=(0.2, 0.4, 0.1, ALPHA), alpha_mode="BLEND")
    foliage = leafcloud.Foliage(quads.reshape(-1, 3), triangles, materials=[material])
    options: dict[str, Any] = {"levels": 1, "cross": False, "texture_size": 128, "epsilon": 0.2}
    [level] = leafcloud.build_chain(foliage, blended=True, **options).levels
    assert len(level.ranks) == 1
    assert level.alpha_cutoff == 0.0
    # The bake changes alpha a little to match the leaves' coverage: their edges lie between samples.
    assert float(np.quantile(level.base_color[..., 3], 0.9)) == pytest.approx(255 * ALPHA, rel=0.05)
    assert level.alpha_pivots() == []
    [cut] = leafcloud.build_chain(foliage, **options).levels
    assert cut.alpha_cutoff > 0.0
    assert level.image_error < 0.5 * cut.image_error


def test_files_hold_the_pieces_and_their_bsp_tree(baked: Path, node: Node) -> None:
    [primitive] = node.primitives
    assert primitive.material["alphaMode"] == "BLEND"
    [tree] = node.mesh_extras["leafcloud"]["blend_order"]
    count = len(tree["ranges"]) // 2
    assert len(tree["planes"]) == 4 * count
    assert len(tree["children"]) == 2 * count
    ranges = sorted(zip(tree["ranges"][::2], tree["ranges"][1::2], strict=True))
    assert [first for first, _ in ranges] == [0, *(behind for _, behind in ranges[:-1])]
    assert ranges[-1][1] == len(primitive.indices) > 6
    corners = primitive.attributes["POSITION"].astype(float)[primitive.indices]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2.0
    assert areas.sum() == pytest.approx(3 * (2 * SIDE) ** 2, rel=0.1)
    for plane, (first, behind) in zip(
        np.reshape(tree["planes"], (-1, 4)), np.reshape(tree["ranges"], (-1, 2)), strict=True
    ):
        assert np.abs(corners[first:behind] @ plane[:3] - plane[3]).max() < 1e-5
    level = json.loads((baked / "report.json").read_text())["levels"][1]
    assert level["drawing"]["written_triangles"] == len(primitive.indices) > level["triangles"]
    whole = read_glb(baked / "cards.glb")["cards_LOD1"]
    assert np.array_equal(whole.primitives[0].indices, primitive.indices)
    assert whole.mesh_extras == node.mesh_extras


def test_no_piece_crosses_a_plane_of_its_parent_nodes(node: Node) -> None:
    [primitive] = node.primitives
    [tree] = node.mesh_extras["leafcloud"]["blend_order"]
    planes, children, ranges = (
        np.reshape(tree[name], (-1, width)) for name, width in (("planes", 4), ("children", 2), ("ranges", 2))
    )
    corners = primitive.attributes["POSITION"].astype(float)[primitive.indices]

    def below(number: int) -> NDArray[np.float64]:
        own = corners[ranges[number, 0] : ranges[number, 1]].reshape(-1, 3)
        return np.vstack([own, *(below(child) for child in children[number] if child >= 0)])

    for number, plane in enumerate(planes):
        for sign, child in zip((1.0, -1.0), children[number], strict=True):
            if child >= 0:
                assert (sign * (below(child) @ plane[:3] - plane[3])).min() > -1e-5


@dataclasses.dataclass(frozen=True)
class Eye:
    """The probe's camera. It looks at `centre` and sees `radius` to each side there."""

    place: NDArray[np.float64]
    centre: NDArray[np.float64]
    radius: float

    def rays(self, size: int) -> NDArray[np.float64]:
        """Return the ray directions (size, size, 3). The first row is the lowest."""
        forward = self.centre - self.place
        away = np.linalg.norm(forward)
        forward /= away
        right = np.cross(forward, (0.0, 1.0, 0.0))
        right /= np.linalg.norm(right)
        at = ((np.arange(size) + 0.5) / size * 2.0 - 1.0) * self.radius / away
        return forward + at[None, :, None] * right + at[:, None, None] * np.cross(right, forward)


def composed(eye: Eye, size: int, *, backward: bool = False) -> NDArray[np.float64]:
    """Ray-trace the three cards over black, composed from back to front or in the opposite order. (size, size, 3)."""
    rays = eye.rays(size).reshape(-1, 3)
    away, colors = [], []
    for corners, color in zip(cards() @ np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]]), COLORS, strict=True):
        a, u, v = corners[0], corners[1] - corners[0], corners[3] - corners[0]
        normal = np.cross(u, v)
        distance = ((a - eye.place) @ normal) / (rays @ normal)
        point = eye.place + distance[:, None] * rays - a
        inside = np.all([(point @ e > 0.0) & (point @ e < e @ e) for e in (u, v)], axis=0)
        away.append(np.where(inside, distance, -1.0))
        colors.append(color)
    order = np.argsort(-np.array(away), axis=0)
    picture = np.zeros((len(rays), 3))
    for number in order[::-1] if backward else order:
        met = np.take_along_axis(np.array(away), number[None], axis=0)[0] > 0.0
        shown = np.where(met, ALPHA, 0.0)[:, None]
        picture = shown * np.array(colors)[number] + (1.0 - shown) * picture
    return picture.reshape(size, size, 3)


@pytest.mark.browser
def test_the_viewer_draws_from_back_to_front(baked: Path) -> None:
    directions = [(1.0, 0.3, 0.5), (-0.4, 0.6, 1.0), (0.2, -0.9, -0.8), (-1.0, -0.1, 0.2), (0.3, 0.2, -1.0)]
    extras = read_glb(baked / "cards.glb")["cards_LOD1"].extras["leafcloud"]
    centre, radius, away = np.array(extras["centre"]), extras["radius"], 2.0 * extras["switch_distance"]
    eyes = [Eye(centre + away * np.array(d) / np.linalg.norm(d), centre, radius) for d in directions]
    question = {"tree": f"{FILES}cards.glb", "settings": {}, "eyes": [eye.place.tolist() for eye in eyes]}
    views = ask(PAGE, question, patience=PATIENCE, files=baked)["seen"]
    for eye, view in zip(eyes, views, strict=True):
        assert view["level"] == 1
        seen = np.frombuffer(base64.b64decode(view["pixels"]), "<f4").reshape(64, 64, 4)[..., :3]
        expected, backward = composed(eye, 64), composed(eye, 64, backward=True)
        covered = expected.max(axis=2) > 0.0
        off, other = (np.abs(seen - picture).max(axis=2)[covered] for picture in (expected, backward))
        # Edges are a pixel wide. Elsewhere the light differs by one or two percent.
        assert np.quantile(off, 0.75) < 0.06, eye.place
        assert np.quantile(other, 0.75) > 0.1, "the other order is seen to be another"
