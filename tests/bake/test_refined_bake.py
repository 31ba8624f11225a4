"""Bakes with refined textures: which files change, and what the report tells of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from command_line import bake_apart, refusal

pytestmark = pytest.mark.night

FLAGS = (
    "--texture-size",
    256,
    "--epsilon",
    0.1,
    "--levels",
    1,
    "--every-level",
    "--effects",
    "none",
    "--no-cross",
    "--files",
    "levels",
)

Bake = tuple[Path, dict[str, Any]]


@pytest.fixture(scope="module")
def bakes(shrub: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Bake]:
    """Folder and report of a bake without refinement and of one with a short one."""
    folder = tmp_path_factory.mktemp("refined")
    return {
        effort: (folder / effort, bake_apart(shrub, folder / effort, *FLAGS, "--refine", effort))
        for effort in ("off", "short")
    }


def test_the_report_tells_the_errors_by_size(bakes: dict[str, Bake]) -> None:
    without, with_refinement = (bakes[effort][1]["levels"][1] for effort in ("off", "short"))
    assert without["refined"] is None
    assert without["refined_planes"] is None
    assert without["seconds"]["refine"] == 0.0
    sizes, ratios = zip(*with_refinement["refined"], strict=True)
    assert sizes[0] <= 256
    assert list(sizes) == [sizes[0] >> half for half in range(len(sizes))]
    assert sizes[-1] >= 32
    assert max(ratios) <= 1.0, "no size became worse"
    assert min(ratios) < 1.0, "something became better"
    assert max(ratio for _, ratio in with_refinement["refined_planes"]) <= 1.0
    assert with_refinement["seconds"]["refine"] > 0.0


def test_bounds_and_deviations_stay(bakes: dict[str, Bake]) -> None:
    without, with_refinement = (bakes[effort][1]["levels"][1] for effort in ("off", "short"))
    assert with_refinement["epsilon"] == without["epsilon"]
    for name in ("billboards", "max_deviation", "max_deviation_leaves"):
        assert with_refinement[name] <= without[name]


def test_the_texture_changes_and_level_0_does_not(bakes: dict[str, Bake], shrub: Path) -> None:
    def file(effort: str, level: int) -> bytes:
        return (bakes[effort][0] / f"{shrub.stem}_LOD{level}.glb").read_bytes()

    assert file("off", 0) == file("short", 0)
    assert file("off", 1) != file("short", 1)


def test_an_unknown_effort_is_refused(shrub: Path, tmp_path: Path) -> None:
    line = refusal(tmp_path / "out", "--input", shrub, "--refine", "forever")
    assert "off" in line
    assert "short" in line
