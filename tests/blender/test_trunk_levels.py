"""Simplified trunks of the levels: fewer triangles from level to level, within the error bound."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import bpy
import command_line
import numpy as np
import pytest
from glb import read_glb
from numpy.typing import NDArray
from scenes import add_mesh, bake, material, read

import leafcloud
from addon.bake.pipeline import seam_share
from addon.bake.values import Baked
from addon.export import preview
from addon.export.files import level_trunks
from addon.geometry import Geometry
from addon.levels.trunk import simplified, whole
from addon.plan.costs import with_costs
from addon.plan.effects import is_on, plan_effects
from addon.plan.facts import Facts
from addon.plan.lod_range import TRUNK_PIXELS, LodRange, trunk_errors
from addon.settings.bake import BakeSettings

QUICK = ("--epsilon", 0.1, "--texture-size", 128)


def grid(n: int) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return the unit square in the plane z = 0 as n × n squares of two triangles."""
    x, y = np.meshgrid(np.arange(n + 1) / n, np.arange(n + 1) / n)
    positions = np.stack([x.ravel(), y.ravel(), np.zeros((n + 1) ** 2)], axis=1)
    a = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    quads = np.stack([a, a + 1, a + n + 2, a, a + n + 2, a + n + 1], axis=1)
    return positions, quads.reshape(-1, 3).astype(np.int32)


def tube(sides: int, rings: int, height: float = 8.0) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return a tube of radius 1 around the z axis, open at both ends."""
    angle = 2.0 * np.pi * np.arange(sides) / sides
    z = np.repeat(np.arange(rings + 1) / rings * height, sides)
    positions = np.stack([np.tile(np.cos(angle), rings + 1), np.tile(np.sin(angle), rings + 1), z], axis=1)
    i, ring = np.tile(np.arange(sides), rings), np.repeat(np.arange(rings), sides) * sides
    a, b = ring + i, ring + (i + 1) % sides
    return positions, np.stack([a, b, b + sides, a, b + sides, a + sides], axis=1).reshape(-1, 3).astype(np.int32)


# The function


def test_a_finely_tessellated_square_becomes_two_triangles() -> None:
    positions, triangles = grid(16)
    result = leafcloud.simplify(positions, triangles, error=1e-3)
    assert (result.corners.shape, result.corners.dtype) == ((2, 3), np.uint32)
    a, b, c = positions[triangles.ravel()[result.corners]].transpose(1, 0, 2)
    assert np.cross(b - a, c - a)[:, 2].sum() / 2.0 == pytest.approx(1.0), "all of it, and wound as before"
    assert 0.0 <= result.error < 1e-6


@pytest.mark.parametrize("error", [0.01, 0.05, 0.2])
def test_a_tube_stays_within_the_error_of_the_circle(error: float) -> None:
    """Points on the result lie between the chord and the circle. Both ends stay."""
    positions, triangles = tube(48, 30)
    result = leafcloud.simplify(positions, triangles, error=error)
    assert 0 < len(result.corners) < len(triangles)
    assert result.error <= error
    weights = np.random.default_rng(1).dirichlet(np.ones(3), 200)
    places = np.einsum("wk,tkc->twc", weights, positions[triangles.ravel()[result.corners]]).reshape(-1, 3)
    radii = np.hypot(places[:, 0], places[:, 1])
    assert radii.min() >= 1.0 - error - 1e-9
    assert radii.max() <= 1.0 + 1e-9
    kept = positions[np.unique(triangles.ravel()[result.corners])]
    assert kept[:, 2].min() <= error
    assert kept[:, 2].max() >= 8.0 - error


def test_the_result_does_not_depend_on_the_distance_from_the_origin() -> None:
    positions, triangles = tube(24, 16)
    positions = np.round(positions * 256.0)  # whole numbers: a shift rounds nothing
    near = leafcloud.simplify(positions, triangles, error=10.0)
    shift = np.array([2.0**40, -(2.0**40), 2.0**39])
    far = leafcloud.simplify(positions + shift, triangles, error=10.0)
    np.testing.assert_array_equal(near.corners, far.corners)
    assert len(near.corners) < len(triangles)


def test_corners_keep_their_attributes() -> None:
    positions, triangles = grid(8)
    materials = np.where(positions[triangles][:, :, 0].mean(axis=1) > 0.5, 70_000, -3)
    uvs = positions[triangles][:, :, :2].astype(np.float32)
    normals = np.tile(np.array([0, 0, 2], np.float32), (len(positions), 1))
    colors = np.ones((len(triangles), 3, 4), np.float32)
    result = leafcloud.simplify(
        positions, triangles, error=0.01, uvs=uvs, normals=normals, colors=colors, material_ids=materials
    )
    assert len(result.corners) <= 8
    of_corner = materials[result.corners // 3]
    assert (of_corner == of_corner[:, :1]).all(), "no triangle has corners of two materials"
    x = positions[triangles.ravel()[result.corners], 0]
    assert x[of_corner == -3].max() <= 0.5
    assert x[of_corner == 70_000].min() >= 0.5


def test_parts_smaller_than_the_error_are_removed() -> None:
    positions, triangles = grid(2)
    result = leafcloud.simplify(positions, triangles, error=0.75)
    assert result.corners.shape == (0, 3)
    assert result.error == pytest.approx(np.sqrt(0.5)), "the radius of what is gone"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"error": 0.0}, "a length above 0"),
        ({"error": np.nan}, "a length above 0"),
        ({"error": "much"}, "a length above 0"),
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
    given = {"positions": positions, "triangles": triangles, "error": 0.1, **arguments}
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


def test_seams_are_corners_that_differ_in_texture_only() -> None:
    """Two triangles share an edge with a texture seam, so the trunk keeps more of its triangles."""
    positions = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], np.float32)
    triangles = np.array([[0, 1, 2], [2, 1, 3]], np.int32)
    joined = positions[triangles][..., :2]
    cut = joined + np.array([0.0, 2.0], np.float32)[:, None, None]

    def share(uvs: NDArray[np.float32] | None) -> float:
        normals = np.tile(np.array([0.0, 0.0, 1.0], np.float32), (2, 3, 1))
        return seam_share(Geometry(positions, triangles, uvs, normals, None, np.zeros(2, np.int32), []))

    assert (share(None), share(joined), share(cut)) == (0.0, 0.0, pytest.approx(1 / 3))
    few, many = (Facts(engine="unity", leaves=5, trunk=1200, trunk_seams=each) for each in (0.1, 0.3))
    sizes = [with_costs(BakeSettings(), facts, plan_effects(BakeSettings(), facts)) for facts in (few, many)]
    left = [effect.bytes for effects in sizes for effect in effects if effect.name == "trunk_levels"]
    assert left[1] > 2 * left[0]


def test_trunk_may_lie_as_far_off_as_leaves_but_is_not_seen_to() -> None:
    def reach(appear: float) -> LodRange:
        return LodRange(appear, 0.0, 0.0, 0.0, appear, 0.0)

    reached = [reach(0.0), reach(100.0), reach(300.0)]
    # What is one unit long is seen so large as the trunk may be off from 50 units away: from 100, two units are.
    assert trunk_errors([5.0, 5.0], reached, 50.0) == (2.0, 5.0)
    assert trunk_errors([1.0, 5.0], reached, 50.0) == (1.0, 5.0)


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


def test_levels_never_have_more_triangles_than_the_one_before() -> None:
    """A scale of 2 gives the tube a radius of 2, because errors are lengths in world space."""
    matrix = np.diag([2.0, 2.0, 2.0, 1.0])
    errors = [0.0, 0.05, 0.05, 0.6, 100.0, 100.0]
    trunk = geometry()
    first = whole("bark", trunk)
    flat, fine, again, coarse, none, nothing = simplified(first, trunk, matrix, errors)
    assert flat is first, "no error, no change"
    assert again is fine, "what is not fewer is not made twice"
    assert first.triangles > fine.triangles > coarse.triangles > 0 == none.triangles
    assert none.mesh is None
    assert nothing is none
    assert [fine.mesh.name, coarse.mesh.name] == ["bark_2", "bark_4"]
    for left, error in ((fine, 0.05), (coarse, 0.6)):
        assert left.error <= error
        assert len(left.mesh.polygons) == left.triangles
        assert [slot.name for slot in left.mesh.materials] == ["bark"]
        places = np.array([tuple(vertex.co) for vertex in left.mesh.vertices])
        uvs = np.array([tuple(each.uv) for each in left.mesh.uv_layers.active.data])
        corners = places[[loop.vertex_index for loop in left.mesh.loops]]
        np.testing.assert_array_equal(uvs, corners[:, 1:].astype(np.float32))


def baked_tree(effects: str) -> Baked:
    """Bake a tube as the trunk, and a crown of triangles around its upper end."""
    positions, triangles = tube(24, 40)
    random = np.random.default_rng(5)
    centres = np.repeat(random.normal((0, 0, 8), 2.5, (60, 3)), 3, axis=0)
    crown = [tuple(point) for point in random.normal(centres, 0.3)]
    leaves = [(3 * i, 3 * i + 1, 3 * i + 2) for i in range(60)]
    add_mesh("leaves", crown, leaves, materials=[material("leaf")])
    faces = [tuple(map(int, triangle)) for triangle in triangles]
    add_mesh("trunk", [tuple(p) for p in positions], faces, materials=[material("bark")])
    return bake(read(), BakeSettings(texture_size=128, effects=effects))


def test_each_level_shows_its_own_trunk() -> None:
    result = baked_tree("auto")
    came, first, second, cross = result.levels
    assert came.trunk.data.name == "tree_trunk"
    assert came.trunk_error == 0.0
    assert len(came.trunk.data.polygons) == came.trunk_triangles == 1920
    assert 1920 > first.trunk_triangles >= second.trunk_triangles > 0
    assert len(second.trunk.data.polygons) == second.trunk_triangles
    assert (cross.trunk, cross.trunk_triangles) == (None, 0)
    radius = result.prepared.foliage.radius
    for level, built in zip(result.chain.levels, (first, second), strict=False):
        assert built.trunk_error <= level.max_deviation_leaves * radius
        pixel = leafcloud.switch_distance(1.0, TRUNK_PIXELS, result.view.resolution, result.view.field_of_view)
        assert built.trunk_error <= result.switch_distances[built.number] / pixel
    assert result.costs.seconds["trunk_levels"] > 0.0
    assert result.costs.bytes["trunk_levels"] > 0


def covered(picture: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Return the number of pixels without background in each column of the preview's first row, leaves first."""
    cell = (picture.shape[1] - preview.GAP) // 4
    row = picture[preview.GAP : cell, : 4 * cell, :3].astype(int)
    return (row != preview.GROUND).any(axis=2).reshape(len(row), 4, cell).sum(axis=(0, 2))


def test_the_preview_draws_each_level_with_its_own_trunk() -> None:
    """The triangle counts match the levels' meshes. A level without its trunk shows no trunk."""
    result = baked_tree("auto")
    trunks = level_trunks(result)
    assert trunks[3] is None, "the cross shows it in its textures"
    for built, trunk in zip(result.levels[:3], trunks, strict=False):
        assert trunk is not None
        assert trunk.triangle_count == built.trunk_triangles
        assert trunk.area == pytest.approx(sum(face.area for face in built.trunk.data.polygons), rel=1e-5)

    def drawn(shown: list[leafcloud.Foliage | None]) -> NDArray[np.int64]:
        foliage, levels = result.prepared.foliage, result.chain.levels
        return covered(preview.preview_image(foliage, shown, levels, result.switch_distances, result.view))

    lost = drawn(trunks) - drawn([trunks[0], None, *trunks[2:]])
    assert lost[1] > 50
    assert not lost[[0, 2, 3]].any()


def test_the_preview_shows_the_source_trunk_without_the_effect() -> None:
    result = baked_tree("transitions")
    came = result.prepared.trunk
    assert level_trunks(result) == [came, came, came, None]


def test_without_the_effect_all_levels_share_the_source_trunk() -> None:
    levels = baked_tree("transitions").levels
    assert {level.trunk.data.name for level in levels[:-1]} == {"tree_trunk"}


# In files


@pytest.fixture(scope="module")
def with_and_without(tmp_path_factory: pytest.TempPathFactory, shrub: Path) -> tuple[Path, Path]:
    folders = []
    for effects in ("transitions,trunk_levels", "transitions"):
        out = tmp_path_factory.mktemp("trunk")
        command_line.bake(shrub, out, "--levels", 1, "--effects", effects, *QUICK)
        folders.append(out)
    return folders[0], folders[1]


def test_the_report_has_the_trunk_s_triangles_and_error(with_and_without: tuple[Path, Path]) -> None:
    simplified, plain = (json.loads((out / "report.json").read_text()) for out in with_and_without)
    leaves, cloud, cross = (level["trunk"] for level in simplified["levels"])
    assert leaves["error"] == 0.0 < cloud["error"] <= simplified["levels"][1]["max_deviation_leaves"]
    assert leaves["triangles"] > cloud["triangles"] > 0
    assert cross is None
    assert not any("trunk" in level for level in plain["levels"])


def test_files_without_the_effect_and_lod_0_have_the_source_trunk(with_and_without: tuple[Path, Path]) -> None:
    simplified, plain = with_and_without
    assert (simplified / "shrub_LOD0.glb").read_bytes() == (plain / "shrub_LOD0.glb").read_bytes()

    def triangles(out: Path, level: int) -> int:
        node = read_glb(out / f"shrub_LOD{level}.glb")[f"shrub_LOD{level}_trunk"]
        return sum(len(primitive.indices) for primitive in node.primitives)

    assert triangles(plain, 1) == triangles(plain, 0) == triangles(simplified, 0) > triangles(simplified, 1)
    report = json.loads((simplified / "report.json").read_text())
    assert triangles(simplified, 1) == report["levels"][1]["trunk"]["triangles"]
