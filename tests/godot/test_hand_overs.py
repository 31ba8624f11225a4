"""Each distance shows its level, and hand-overs do not show, in each of Godot's renderers."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from engine_views import ROWS, hand_overs, levels_of, sphere_of
from godot_project import (
    NEEDS_GODOT,
    RENDERERS,
    TREE,
    codes,
    colors,
    exported,
    project_with,
    run_script,
    run_window,
    seen,
)
from mathutils import Matrix
from numpy.typing import NDArray

import leafcloud

pytestmark = NEEDS_GODOT


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return project_with(tmp_path_factory.mktemp("godot"), [TREE])


@pytest.fixture(scope="module")
def compatibility(project: Path) -> Path:
    return run_script(project, "views.gd")


@pytest.fixture(scope="module", params=RENDERERS)
def views(request: pytest.FixtureRequest, project: Path, compatibility: Path) -> Path:
    renderer = str(request.param)
    return compatibility if renderer == "gl_compatibility" else run_script(project, "views.gd", renderer)


def test_each_distance_draws_its_level(project: Path, views: Path) -> None:
    """The file's own distances decide. The level before may still fade, up to 15 % behind its end."""
    found: dict[str, Any] = json.loads((views / "drawn.json").read_text())
    switches = [level.extras["leafcloud"]["switch_distance"] for level in levels_of(project / "tree.glb")]
    assert found["levels"] == len(switches)
    assert len(found["drawn"]) == 6 * len(switches)
    for row in found["drawn"]:
        number = sum(row["distance"] >= switch for switch in switches) - 1
        fading = number > 0 and row["distance"] < 1.15 * switches[number]
        assert row["levels"] in ([[number - 1, number], [number]] if fading else [[number]]), row
    assert {number for row in found["drawn"] for number in row["levels"]} == set(range(len(switches)))


def test_a_level_covers_as_much_as_the_one_before_it(views: Path) -> None:
    check_hand_overs(views)


def check_hand_overs(views: Path) -> None:
    """Compare levels that cover at least 300 pixels in all directions: below, single pixels decide. There is no
    antialiasing.
    """
    compared = 0
    for number in range(len(list(views.glob("before_*_0.png")))):
        pair = [load(views, f"{name}_{number}") for name in ("before", "after")]
        masks = [seen(pictures) for pictures in pair]
        covered = [int(mask.sum()) for mask in masks]
        light = [float((pictures[mask] ** 2.2).mean()) for pictures, mask in zip(pair, masks, strict=True)]
        ratios = f"coverage {covered[1] / covered[0]:.3f}, luminance {light[1] / light[0]:.3f}"
        print(f"{views.name} {number} → {number + 1}: {covered[0]} pixels, {ratios}")
        if covered[0] < 300:
            continue
        compared += 1
        assert 0.9 < covered[1] / covered[0] < 1.1
        assert 0.94 < light[1] / light[0] < 1.06
    assert compared >= 1


def load(views: Path, stem: str) -> NDArray[np.float64]:
    """Return the pictures from all directions under one another, (n · h, w, 3)."""
    return np.concatenate([colors(path) for path in sorted(views.glob(f"{stem}_*.png"))])


def test_a_step_over_a_hand_over_does_not_show(project: Path, views: Path) -> None:
    """FLIP in the square around the crown, of a camera that moves by 0.2 % of its distance."""
    levels = levels_of(project / "tree.glb")
    _, radius = sphere_of(levels[0])
    for number, distance in enumerate(hand_overs(levels)):
        half = math.ceil(radius / distance * 0.5 * ROWS / math.tan(math.radians(25.0)))
        flips = {name: step_flip(views, f"{name}_{number}", half) for name in ("begin", "end", "apart")}
        print(f"{views.name} {number} → {number + 1}:", *(f"{name} {flip:.4f}" for name, flip in flips.items()))
        assert flips["begin"] <= 0.02
        assert flips["end"] <= 0.02


def step_flip(views: Path, stem: str, half: int) -> float:
    """Return the mean FLIP between two pictures, up to `half` pixels around their middle."""
    pictures = [codes(views / f"{stem}_{side}.png") for side in range(2)]
    middle = pictures[0].shape[0] // 2
    square = slice(middle - half, middle + half)
    assert seen(pictures[0][..., :3] / 255.0)[square, square].sum() > half, "the tree is in the square"
    base, other = (np.ascontiguousarray(picture[square, square]) for picture in pictures)
    return float(leafcloud.flip_map(base, other).mean())


def test_renderers_cover_the_same(views: Path, compatibility: Path) -> None:
    """All pictures together, because in a single small one single pixels decide."""
    covered = [
        sum(int(seen(colors(picture)).sum()) for picture in sorted(folder.glob("*.png")))
        for folder in (compatibility, views)
    ]
    print(f"{views.name}: {covered[1] / covered[0]:.4f} of Compatibility's coverage")
    assert covered[1] == pytest.approx(covered[0], rel=0.02)


def test_an_exported_game_draws_the_same(project: Path, compatibility: Path, tmp_path: Path) -> None:
    """The pack has no GLB file: imported resources must have everything."""
    pack = exported(project, tmp_path / "game")
    views = run_window(["--main-pack", str(pack)], "views.gd", tmp_path / "out")
    assert json.loads((views / "drawn.json").read_text()) == json.loads((compatibility / "drawn.json").read_text())
    pictures = sorted(compatibility.glob("*.png"))
    assert pictures
    for picture in pictures:
        np.testing.assert_allclose(colors(views / picture.name), colors(picture), atol=0.01, err_msg=picture.name)


def test_a_tree_whose_nodes_are_scaled_and_turned_switches_alike(tmp_path: Path) -> None:
    """Files keep the transforms of the tree's objects."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=str(TREE))
    for obj in [obj for obj in bpy.data.objects if obj.parent is None]:
        obj.matrix_world = Matrix.Translation((30.0, -20.0, 5.0)) @ Matrix.Rotation(1.0, 4, "Z") @ Matrix.Scale(0.05, 4)
    bpy.ops.export_scene.gltf(filepath=str(tmp_path / "moved.glb"))
    project = project_with(tmp_path, [tmp_path / "moved.glb"])
    check_hand_overs(run_script(project, "views.gd"))
    found = json.loads((run_script(project, "forest.gd") / "forest.json").read_text())
    assert 400 <= found["leaves"] <= 800
