"""Simplified trunks of the levels: fewer triangles from level to level, and the same pictures."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import bpy
import numpy as np
import pytest
from numpy.typing import NDArray
from scenes import material, tube, use_nodes

import leafcloud
from addon.geometry import Geometry
from addon.levels.trunk import Kept, TrunkView, gathered, outward, simplified, trunks, unrolled
from addon.plan.costs import with_costs
from addon.plan.effects import is_on, plan_effects
from addon.plan.facts import Facts
from addon.plan.trunk_limits import FAR_TRIANGLES, NEAR_TRIANGLES, trunk_limits
from addon.settings.bake import BakeSettings

QUICK = ("--epsilon", 0.1, "--pixels", 8, "--texture-size", 128, "--files", "levels")


def grid(n: int) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return the unit square in the plane z = 0 as n × n squares of two triangles."""
    x, y = np.meshgrid(np.arange(n + 1) / n, np.arange(n + 1) / n)
    positions = np.stack([x.ravel(), y.ravel(), np.zeros((n + 1) ** 2)], axis=1)
    a = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    quads = np.stack([a, a + 1, a + n + 2, a, a + n + 2, a + n + 1], axis=1)
    return positions, quads.reshape(-1, 3).astype(np.int32)


# The function


def test_a_finely_tessellated_square_becomes_two_triangles() -> None:
    positions, triangles = grid(16)
    result = leafcloud.simplify(positions, triangles, pixel=0.01, change=0.0)
    assert (result.corners.shape, result.corners.dtype) == ((2, 3), np.uint32)
    a, b, c = positions[triangles.ravel()[result.corners]].transpose(1, 0, 2)
    assert np.cross(b - a, c - a)[:, 2].sum() / 2.0 == pytest.approx(1.0), "all of it, and wound as before"
    assert result.change == 0.0


@pytest.mark.parametrize(("pixel", "change"), [(0.02, 0.005), (0.1, 0.02), (0.3, 0.05)])
def test_a_tube_keeps_its_length_and_width(pixel: float, change: float) -> None:
    """From the side a tube is a rectangle, 2 wide and 8 high. A tube of corners on the circle is never wider."""
    positions, triangles = tube(48, 30)
    result = leafcloud.simplify(positions, triangles, pixel=pixel, change=change)
    assert 0 < len(result.corners) < len(triangles) / 4
    assert result.change <= change
    left = leafcloud.Foliage(positions, triangles.ravel()[result.corners])
    for angle in (0.3, 1.1, 2.0, 2.9):
        direction = (np.cos(angle), np.sin(angle), 0.0)
        picture = leafcloud.render([left], direction, 200, centre=(0.0, 0.0, 4.0), radius=5.0)
        area = picture[..., 3].sum() / 255.0 * (10.0 / 200.0) ** 2
        assert 16.0 * (1.0 - 2.0 * change - 0.01) <= area <= 16.01


def test_the_result_does_not_depend_on_the_distance_from_the_origin() -> None:
    positions, triangles = tube(24, 16)
    positions = np.round(positions * 256.0)  # whole numbers: a shift rounds nothing
    near = leafcloud.simplify(positions, triangles, pixel=10.0, change=0.01)
    shift = np.array([2.0**40, -(2.0**40), 2.0**39])
    far = leafcloud.simplify(positions + shift, triangles, pixel=10.0, change=0.01)
    np.testing.assert_array_equal(near.corners, far.corners)
    assert len(near.corners) < len(triangles)


def test_corners_keep_their_attributes() -> None:
    positions, triangles = grid(8)
    materials = np.where(positions[triangles][:, :, 0].mean(axis=1) > 0.5, 70_000, -3)
    uvs = positions[triangles][:, :, :2].astype(np.float32)
    normals = np.tile(np.array([0, 0, 2], np.float32), (len(positions), 1))
    colors = np.ones((len(triangles), 3, 4), np.float32)
    result = leafcloud.simplify(
        positions, triangles, pixel=0.01, change=0.0, uvs=uvs, normals=normals, colors=colors, material_ids=materials
    )
    assert len(result.corners) <= 8
    of_corner = materials[result.corners // 3]
    assert (of_corner == of_corner[:, :1]).all(), "no triangle has corners of two materials"
    x = positions[triangles.ravel()[result.corners], 0]
    assert x[of_corner == -3].max() <= 0.5
    assert x[of_corner == 70_000].min() >= 0.5


def box(half: float) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return a closed box around (0, 0, 4), twice as high as wide."""
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-2, 2)]) * half + (0, 0, 4)
    quads = np.array([[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]])
    return corners, quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3).astype(np.int32)


def test_normals_that_simplification_turns_against_their_faces_are_those_of_the_faces() -> None:
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
    up, down, tilted = [0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [0.6, 0.0, 0.8]
    source = Geometry(
        positions=corners,
        triangles=np.array([[0, 1, 2], [2, 1, 0]], np.int32),
        uvs=None,
        # The second triangle faces down, and has a normal against its own face.
        normals=np.array([[tilted, up, up], [down, up, down]], np.float32),
        colors=None,
        material_ids=np.zeros(2, np.int32),
        materials=[None],
    )
    kept = np.array([[0, 1, 2], [2, 1, 0], [3, 4, 5]])
    left = outward(gathered(source, kept), source, kept)
    np.testing.assert_allclose(left.normals, [[tilted, up, up], [down] * 3, [down, up, down]], atol=1e-7)


def test_gathered_triangles_keep_what_belongs_to_them() -> None:
    source = Geometry(
        positions=np.arange(18, dtype=np.float32).reshape(6, 3),
        triangles=np.array([[0, 1, 2], [3, 4, 5]], np.int32),
        uvs=None,
        normals=np.tile(np.float32([0.0, 0.0, 1.0]), (2, 3, 1)),
        colors=None,
        material_ids=np.array([4, 7], np.int32),
        materials=[None],
        randoms=np.float32([0.25, 0.75]),
    )
    left = gathered(source, np.array([[4, 5, 3], [0, 1, 2], [1, 2, 0]]))
    assert left.triangles.tolist() == [[4, 5, 3], [0, 1, 2], [1, 2, 0]]
    assert left.material_ids.tolist() == [7, 4, 4]
    assert left.randoms is not None
    assert left.randoms.tolist() == [0.75, 0.25, 0.25]


def test_only_a_hidden_trunk_disappears_without_a_change() -> None:
    positions, triangles = tube(12, 10)
    hidden = leafcloud.simplify(positions, triangles, leaves=leafcloud.Foliage(*box(3.0)), pixel=0.05, change=0.0)
    assert (hidden.corners.shape, hidden.change) == ((0, 3), 0.0)
    bare = leafcloud.simplify(positions, triangles, pixel=0.05, change=0.0)
    assert len(bare.corners) > 0


@pytest.mark.parametrize("most", [0, 6, 20, 40])
def test_the_limit_comes_before_the_change(most: int) -> None:
    positions, triangles = tube(24, 20)
    result = leafcloud.simplify(positions, triangles, pixel=0.05, change=0.0, most=most)
    assert len(result.corners) <= most
    assert result.change > 0.0
    assert (result.change > 0.5) == (most == 0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"pixel": 0.0}, "a length above 0"),
        ({"pixel": np.nan}, "a length above 0"),
        ({"pixel": "much"}, "a length above 0"),
        ({"change": 1.5}, "between 0 and 1"),
        ({"change": "little"}, "between 0 and 1"),
        ({"most": -1}, "most"),
        ({"triangles": np.zeros((0, 3), int)}, "no triangles"),
        ({"triangles": [[0, 1, 99]]}, "99"),
        ({"positions": np.full((9, 3), np.nan)}, "not finite"),
        ({"positions": np.zeros((9, 3))}, "zero area"),
        ({"uvs": np.zeros((9, 3))}, "uvs"),
        ({"normals": np.full((9, 3), np.inf)}, "normals"),
        ({"material_ids": [0, 1]}, "material_ids"),
    ],
)
def test_invalid_arguments_are_refused(arguments: dict[str, Any], message: str) -> None:
    positions, triangles = grid(2)
    given = {"positions": positions, "triangles": triangles, "pixel": 0.1, "change": 0.0, **arguments}
    with pytest.raises(leafcloud.LeafcloudError, match=message):
        leafcloud.simplify(given.pop("positions"), given.pop("triangles"), **given)


# The plan


def test_the_plan_turns_trunk_levels_on_for_trees_with_a_trunk() -> None:
    facts = Facts(engine="unity", leaves=5, trunk=1200)
    [effect] = [effect for effect in plan_effects(BakeSettings(), facts) if effect.name == "trunk_levels"]
    assert effect.on is True
    assert effect.reason == "the camera may be anywhere in unity, so it may see 1200 trunk triangles from far away"
    assert is_on(plan_effects(BakeSettings(), Facts(engine="unity", leaves=5)), "trunk_levels") is False
    assert is_on(plan_effects(BakeSettings(effects="pruning"), facts), "trunk_levels") is False


def test_simplified_trunks_are_estimated_at_their_limits() -> None:
    def nbytes(trunk: int) -> int:
        facts = Facts(engine="unity", leaves=5, trunk=trunk)
        [found] = [
            effect
            for effect in with_costs(BakeSettings(), facts, plan_effects(BakeSettings(), facts))
            if effect.name == "trunk_levels"
        ]
        return found.bytes or 0

    assert nbytes(100_000) == nbytes(10_000) > 2 * nbytes(100) > 0


def test_a_trunk_may_have_as_many_triangles_as_the_leaves_of_its_level() -> None:
    assert trunk_limits([1400, 300, 90], 40_000) == (1400, 300, FAR_TRIANGLES)
    assert trunk_limits([900], 12_000) == (NEAR_TRIANGLES,)
    assert trunk_limits([300], 4000) == (600,), "0.15 of the tree's"
    assert trunk_limits([30, 30], 400) == (FAR_TRIANGLES, FAR_TRIANGLES), "branches would seem to vanish"
    assert trunk_limits([300, 90], 12_000, wished=400) == (100, FAR_TRIANGLES)
    assert trunk_limits([500], 12_000, wished=400) == (1,)
    assert trunk_limits([], 40_000) == ()


# In Blender


def geometry() -> Geometry:
    positions, triangles = tube(16, 12)
    return Geometry(
        positions=positions.astype(np.float32),
        triangles=triangles,
        uvs=positions[triangles][:, :, 1:].astype(np.float32),
        normals=(positions[triangles] * [1.0, 1.0, 0.0]).astype(np.float32),
        colors=None,
        material_ids=np.zeros(len(triangles), np.int32),
        materials=[bpy.data.materials.new("bark")],
    )


class Bare:
    """A level without leaves in front of the trunk, or with leaves that nobody sees."""

    def __init__(self, triangles: int) -> None:
        self.triangles = triangles

    def foliage(self) -> None:
        return None


def views(*pairs: tuple[float, int], triangles: int = 0) -> list[TrunkView]:
    """Return views of a trunk, given as pixel and limit, beside leaves with so many `triangles`."""
    return [TrunkView(cast("leafcloud.Level", Bare(triangles)), pixel, limit) for pixel, limit in pairs]


def test_a_trunk_of_few_triangles_beside_its_leaves_stays_whole() -> None:
    trunk = geometry()
    first = Kept(trunk)
    assert first.triangles == 384

    def left(limit: int, leaves: int) -> Kept:
        [found] = simplified(first, trunk, np.eye(4), views((0.2, limit), triangles=leaves))
        return found

    assert left(384, 4 * 384) is first
    assert left(384, 4 * 384 - 4).triangles < 384
    assert left(383, 4 * 384).triangles < 384, "the limit comes first"


def test_a_trunk_keeps_more_triangles_than_its_number_where_the_picture_needs_them() -> None:
    trunk = geometry()
    first = Kept(trunk)
    [few] = simplified(first, trunk, np.eye(4), views((0.01, 8)))
    [enough] = simplified(first, trunk, np.eye(4), [replace(each, most_change=0.05) for each in views((0.01, 8))])
    assert few.triangles <= 8 < enough.triangles < first.triangles
    assert few.change > 0.05 >= enough.change


@pytest.mark.night
def test_levels_never_have_more_triangles_than_the_one_before() -> None:
    """A scale of 2 gives the tube a radius of 2, because pixels are lengths in world space."""
    matrix = np.diag([2.0, 2.0, 2.0, 1.0])
    trunk = geometry()
    first = Kept(trunk)
    fine, again, coarse, none, nothing = simplified(
        first, trunk, matrix, views((0.01, 200), (0.01, 200), (1.0, 20), (1.0, 0), (1.0, 60))
    )
    assert again is fine, "what is not fewer is not made twice"
    assert 200 >= fine.triangles > coarse.triangles > 0 == none.triangles
    assert coarse.triangles <= 20
    assert nothing is none
    made = trunks("bark", [first, fine, again, coarse, none])
    assert [None if each.mesh is None else each.mesh.name for each in made] == [
        *("bark", "bark_1", "bark_1", "bark_3"),
        None,
    ]
    for left, trunk in ((fine, made[1]), (coarse, made[3])):
        assert left.change < 0.2
        mesh = trunk.mesh
        assert mesh is not None
        assert len(mesh.polygons) == left.triangles
        assert [slot.name for slot in mesh.materials] == ["bark"]
        places = np.array([tuple(vertex.co) for vertex in mesh.vertices])
        uvs = np.array([tuple(each.uv) for each in mesh.uv_layers.active.data])
        corners = places[[loop.vertex_index for loop in mesh.loops]]
        np.testing.assert_array_equal(uvs, corners[:, 1:].astype(np.float32))


def bark(extension: str, scale: float = 1.0) -> bpy.types.Material:
    """Return a material with an image, wrapped by `extension`, behind a Mapping node with this scale along v."""
    made = material("bark")
    use_nodes(made)
    nodes, links = made.node_tree.nodes, made.node_tree.links
    image, mapping, uv = (nodes.new(f"ShaderNode{kind}") for kind in ("TexImage", "Mapping", "UVMap"))
    image.image, image.extension = bpy.data.images.new("bark", 4, 4), extension
    mapping.inputs["Scale"].default_value = (1.0, scale, 1.0)
    for source, target in ((uv, mapping.inputs[0]), (mapping, image.inputs[0])):
        links.new(source.outputs[0], target)
    links.new(image.outputs["Color"], nodes["Principled BSDF"].inputs["Base Color"])
    return made


def ringed(bark: bpy.types.Material) -> Geometry:
    """Return a tube, 12 high, whose v is 0, 1, 0, 1 … at its 13 rings."""
    plain = geometry()
    uvs = plain.uvs.copy()
    uvs[..., 1] = plain.positions[plain.triangles][..., 2] / 8.0 * 12.0 % 2.0
    assert set(uvs[..., 1].ravel().tolist()) == {0.0, 1.0}
    return replace(plain, uvs=uvs, materials=[bark])


@pytest.mark.parametrize("scale", [1.0, 2.0])
def test_bark_repeats_as_often_on_a_simplified_stem(scale: float) -> None:
    stem = ringed(bark("REPEAT", scale))
    [left] = simplified(Kept(stem), unrolled(stem), np.eye(4), views((0.2, 40)))
    assert left.triangles <= 40 < len(stem.triangles)
    mesh = trunks("bark", [left])[0].mesh
    assert mesh is not None
    for loop, uv in zip(mesh.loops, mesh.uv_layers.active.data, strict=True):
        assert uv.uv.y == mesh.vertices[loop.vertex_index].co.z / 8.0 * 12.0, "a repeat for each ring"


@pytest.mark.parametrize("bark_of", [("CLIP", 1.0), ("EXTEND", 1.0), ("MIRROR", 1.0), ("REPEAT", 0.3)])
def test_textures_that_do_not_repeat_by_whole_numbers_stay(bark_of: tuple[str, float]) -> None:
    stem = ringed(bark(*bark_of))
    np.testing.assert_array_equal(unrolled(stem).uvs, stem.uvs)


def test_texture_coordinates_run_on_only_where_all_textures_repeat() -> None:
    positions, triangles = tube(4, 2)
    uvs = np.float32(positions[triangles][..., 1:]) * [1.0, 0.25] % 2.0
    clamped = np.arange(len(triangles)) % 2 == 0
    made = leafcloud.unrolled_uvs(positions, triangles, uvs, ~clamped)
    np.testing.assert_array_equal(made[clamped], uvs[clamped])
    with pytest.raises(leafcloud.LeafcloudError, match="repeats has 2 rows; it must have one for each of 16 triangles"):
        leafcloud.unrolled_uvs(positions, triangles, uvs, np.array([True, False]))
