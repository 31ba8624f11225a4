"""Plants of every kind bake without settings: ferns, palms, grass, ivy, hedges, flowers, leaves on the ground."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from command_line import bake
from plants import PLANTS, write


@pytest.mark.parametrize(
    "name", [name if name == "pot" else pytest.param(name, marks=pytest.mark.night) for name in PLANTS]
)
def test_a_plant_bakes_without_settings(
    name: str, tmp_path: Path, gltf_issues: Callable[..., list[dict[str, Any]]]
) -> None:
    report = bake(write(name, tmp_path), tmp_path / "out")
    assert gltf_issues(*(tmp_path / "out").glob("*.glb")) == []
    leaves, *levels = report["levels"]
    assert levels
    judged = report["quality"]["levels"]
    assert all(level["passes"] or level["crown_pixels"] <= 12.0 for level in judged) or report["warnings"], judged
    for before, level in pairwise([leaves, *levels]):
        assert level["drawing"]["cheaper"] > before["drawing"]["cheaper"]
        assert level["switch_distance"] > before["switch_distance"]
        assert level["drawing"]["cheaper"] > 1.0


def test_the_same_name_and_seed_make_the_same_plant(tmp_path: Path) -> None:
    first, again, other = (write("hosta", tmp_path / str(i), seed).read_bytes() for i, seed in enumerate((1, 1, 2)))
    assert first == again != other
