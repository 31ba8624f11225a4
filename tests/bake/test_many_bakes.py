"""Many bakes in one session of Blender: memory stays, and no data-block is left behind.

For more bakes: LEAFCLOUD_BAKES=200 .venv/bin/python -m pytest -s -o timeout=900 tests/bake/test_many_bakes.py
"""

from __future__ import annotations

import os
from pathlib import Path

import bpy
import pytest

pytestmark = [pytest.mark.night, pytest.mark.fresh, pytest.mark.usefixtures("registered")]

BAKES, FIRST = int(os.environ.get("LEAFCLOUD_BAKES", "60")), 10
MOST_GROWTH = 50e6
"""Bytes of memory that all bakes after the first ones may add."""
KINDS = ("objects", "meshes", "materials", "images", "collections", "node_groups", "textures", "actions")


def resident_bytes() -> int:
    """Return the memory of this process that is in use."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


def counts() -> dict[str, int]:
    return {kind: len(getattr(bpy.data, kind)) for kind in KINDS}


def test_memory_and_data_blocks_do_not_grow(shrub: Path) -> None:
    bpy.ops.import_scene.gltf(filepath=str(shrub))
    bpy.ops.object.select_all(action="SELECT")
    bpy.context.view_layer.objects.active = bpy.data.objects["leaves"]
    settings = bpy.context.scene.leafcloud
    settings.texture_size, settings.epsilon, settings.quality = 64, 0.2, 0.1
    settings.levels, settings.last, settings.effort = 1, "cross", "literal"
    for number in range(BAKES):
        assert bpy.ops.leafcloud.bake() == {"FINISHED"}
        if number == FIRST - 1:
            memory, blocks = resident_bytes(), counts()
    assert counts() == blocks
    grown = resident_bytes() - memory
    print(f"{BAKES - FIRST} bakes added {grown / 1e6:.1f} MB")
    assert grown <= MOST_GROWTH
