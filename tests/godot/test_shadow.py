"""The shadow proxy of a bake casts the shadow of the leaves in Godot."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from godot_project import NEEDS_GODOT, RENDERERS, TREE, colors, godot, project_with, run_script

pytestmark = NEEDS_GODOT


@pytest.fixture(scope="module")
def projects(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Two projects with the same tree, one of them with the proxy beside it."""
    folder = tmp_path_factory.mktemp("shadow")
    without = project_with(folder, [TREE], "--effects", "+shadow_proxy")
    proxied = folder / "proxied"
    shutil.copytree(without, proxied, ignore=shutil.ignore_patterns(".godot", "*.import", "*.png", "*.jpg", "out"))
    shutil.copy(folder / "baked" / f"{TREE.stem}_shadow.glb", proxied / "tree_shadow.glb")
    godot(proxied, "--headless", "--import")
    return {"without": without, "with": proxied}


@pytest.mark.parametrize("renderer", RENDERERS)
def test_the_proxy_casts_the_shadow_of_the_levels(projects: dict[str, Path], renderer: str) -> None:
    folders = {name: run_script(project, "shadow.gd", renderer) for name, project in projects.items()}
    found: dict[str, Any] = {name: json.loads((each / "shadow.json").read_text()) for name, each in folders.items()}
    levels = len(found["without"]["triangles"])
    print(renderer, "triangles in the shadow map by level:", found)
    assert found["with"]["triangles"][0] < 0.2 * found["without"]["triangles"][0]
    assert found["with"]["triangles"][2:] == found["without"]["triangles"][2:], "farther levels cast their own"
    assert found["with"]["loaded_parts"] == found["without"]["loaded_parts"] + 1
    for kind in ("tree", "forest"):
        for level in range(levels):
            areas = {name: shadowed(each / f"shadow_{kind}_{level}.png") for name, each in folders.items()}
            print(f"{renderer} {kind}, level {level}: shadow {areas['with'] / areas['without']:.3f} of the levels' own")
            assert areas["without"] > 5000
            assert areas["with"] == pytest.approx(areas["without"], rel=0.05)


def shadowed(picture: Path) -> int:
    """Return the number of dark pixels of the ground above the tree."""
    rows = colors(picture)[:810]
    return int((np.abs(rows - rows[0, 0]).max(axis=-1) > 0.15).sum())
