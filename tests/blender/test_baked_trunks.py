"""The trunks of baked levels: in Blender, in the costs, in the preview, in the report and in the files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import command_line
import numpy as np
import pytest
from glb import read_glb
from numpy.typing import NDArray
from scenes import add_mesh, bake, material, read, tube

import leafcloud
from addon.bake.drawing import level_trunks
from addon.bake.values import Baked
from addon.export import preview
from addon.plan.trunk_limits import CHANGE, FAR_TRIANGLES, trunk_limits
from addon.settings.bake import BakeSettings

QUICK = ("--epsilon", 0.1, "--pixels", 8, "--texture-size", 128, "--files", "levels")


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
    return bake(read(), BakeSettings(quality=0.1, texture_size=128, levels=2, effects=effects))


def test_each_level_shows_its_own_trunk() -> None:
    result = baked_tree("auto")
    came, first, second, cross = result.levels
    assert came.trunk.data.name == "tree_trunk"
    assert came.trunk_change == 0.0
    assert len(came.trunk.data.polygons) == came.trunk_triangles == 1920
    leaves = [level.triangles for level in (first, second)]
    for level, limit in zip((first, second), trunk_limits(leaves, came.triangles + 1920), strict=True):
        assert 0 < level.trunk_triangles <= limit
        assert len(level.trunk.data.polygons) == level.trunk_triangles
        assert level.trunk_change <= CHANGE
    assert first.trunk_triangles >= second.trunk_triangles
    assert (cross.trunk, cross.trunk_triangles) == (None, 0)


def test_a_level_looks_the_same_with_its_own_trunk() -> None:
    """Pictures of a level with the trunk of LOD 0 and with its own, in views that the simplification never sees."""
    result = baked_tree("auto")
    came, *others = level_trunks(result)
    assert came is not None
    for level, built, trunk in zip(result.chain.levels, result.levels[1:3], others, strict=False):
        pixel = result.schedule.trunk_pixels[built.number - 1]
        size = round(2.0 * came.radius / pixel)

        def picture(trunk: leafcloud.Foliage | None, angle: float, level: Any = level, size: int = size) -> Any:
            parts = [level.foliage(), *([] if trunk is None else [trunk])]
            view = (np.cos(angle), np.sin(angle), 0.25)
            return leafcloud.render(parts, view, size, centre=came.world_centre.tolist(), radius=came.radius)[..., 3]

        angles = np.arange(6) + 0.1
        before, after, bare = (
            np.stack([picture(each, angle) for angle in angles]).astype(float) for each in (came, trunk, None)
        )
        assert np.abs(after - before).sum() < 0.04 * before.sum()
        assert abs(after.sum() - before.sum()) < 2.0 * CHANGE * before.sum(), "neither thinner nor thicker"
        assert np.abs(bare - before).sum() > 0.08 * before.sum(), "the trunk is a part of the picture"


def test_thin_branches_are_on_the_cloud_and_not_in_its_trunk() -> None:
    """Eight tubes, 0.02 wide and 4 long, in a crown of radius 3 or so, and a stem, 2 wide."""
    random = np.random.default_rng(3)
    centres = np.repeat(random.normal((0, 0, 8), 1.2, (400, 3)), 3, axis=0)
    crown = [tuple(point) for point in random.normal(centres, 0.2)]
    add_mesh("leaves", crown, [(3 * i, 3 * i + 1, 3 * i + 2) for i in range(400)], materials=[material("leaf")])
    stem, of_stem = tube(12, 4)
    thin, of_thin = tube(6, 1, height=4.0)
    places = [thin * (0.01, 0.01, 1.0) + (0.2 * i - 0.7, 0.0, 6.0) for i in range(8)]
    positions = np.concatenate([stem, *places])
    faces = np.concatenate([of_stem, *(of_thin + len(stem) + i * len(thin) for i in range(8))])
    corners = [tuple(map(int, triangle)) for triangle in faces]
    add_mesh("trunk", [tuple(p) for p in positions], corners, materials=[material("bark")])
    result = bake(read(), BakeSettings(quality=0.1, texture_size=256, levels=1, every_level=True, form="billboards"))
    [twigs] = result.chain.twigs
    assert twigs.tolist() == list(range(len(of_stem), len(faces)))
    came, cloud, _ = result.levels
    assert came.trunk_triangles == len(faces)
    assert 0 < cloud.trunk_triangles <= len(of_stem)
    assert cloud.trunk_corners.max() < 3 * len(of_stem), "triangles of the stem, counted through the whole trunk"


def test_costs_of_trunk_levels_are_counted() -> None:
    result = baked_tree("auto")
    assert result.costs.seconds["trunk_levels"] > 0.0
    assert result.costs.bytes["trunk_levels"] > 0


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
        """Return the number of covered pixels of each level, the leaves first."""
        subjects = preview.subjects_of(result.prepared.foliage, shown, result.chain.levels)
        assert [subject.name for subject in subjects] == ["Leaves", "Level 1", "Level 2", "Cross impostor"]
        sphere = preview.sphere_of(subjects[0].parts)
        return np.array([(sphere.picture(subject, 300)[..., 3] > 0).sum() for subject in subjects])

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


def test_the_report_has_the_trunk_s_triangles_and_change(with_and_without: tuple[Path, Path]) -> None:
    simplified, plain = (json.loads((out / "report.json").read_text()) for out in with_and_without)
    leaves, cloud, cross = (level["trunk"] for level in simplified["levels"])
    assert leaves["change"] == 0.0
    assert cloud["change"] <= CHANGE or cloud["triangles"] > 0.95 * FAR_TRIANGLES, "the limit comes before the change"
    assert leaves["triangles"] > cloud["triangles"] > 0
    assert cross is None
    assert not any("trunk" in level for level in plain["levels"])


def test_files_without_the_effect_and_lod_0_have_the_source_trunk(with_and_without: tuple[Path, Path]) -> None:
    simplified, plain = with_and_without
    assert (simplified / "shrub_LOD0.glb").read_bytes() == (plain / "shrub_LOD0.glb").read_bytes()

    def triangles(out: Path, level: int) -> int:
        node = read_glb(out / "shrub.glb")[f"shrub_LOD{level}"]
        return sum(len(primitive.indices) for primitive in node.trunk)

    assert triangles(plain, 1) == triangles(plain, 0) == triangles(simplified, 0) > triangles(simplified, 1)
    report = json.loads((simplified / "report.json").read_text())
    assert triangles(simplified, 1) == report["levels"][1]["trunk"]["triangles"]
