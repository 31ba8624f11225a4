"""A bake of 105,000 triangles in the interface: it redraws all the time, and Escape ends it at once."""

from __future__ import annotations

import itertools
import time
from pathlib import Path

import pytest
from blender_window import Window

ROOT = Path(__file__).resolve().parents[2]
TREE = ROOT.parent / "shared" / "foliage" / "douglas_fir_105k.glb"
BAKE = (134, 150)
"""Place of the button *Bake Levels* in the sidebar."""

pytestmark = pytest.mark.skipif(not TREE.is_file(), reason="needs the measured trees beside the repository")

BUSY = "result = bool(bpy.context.window_manager.leafcloud.stage)"


@pytest.fixture(scope="module")
def tree(blender: Window) -> Window:
    blender.keys("a", "x", "Return")
    blender.run(f"bpy.ops.import_scene.gltf(filepath={str(TREE)!r})")
    blender.keys("a", "Home")
    blender.settle()
    return blender


def names(blender: Window) -> list[str]:
    return list(blender.run("result = sorted(obj.name for obj in bpy.data.objects)"))


def begin(blender: Window) -> None:
    blender.click_in_sidebar(*BAKE)
    blender.wait(lambda: blender.run(BUSY), 20.0, "bake")


def test_escape_ends_a_bake_at_once(tree: Window) -> None:
    before = names(tree)
    for seconds in (0.5, 3.0, 6.0):
        begin(tree)
        time.sleep(seconds)
        pressed = time.monotonic()
        tree.keys("Escape")
        tree.wait(lambda: not tree.run(BUSY), 20.0, "end of the bake")
        print(f"cancelled after {time.monotonic() - pressed:.2f} s")
        assert names(tree) == before


def test_the_interface_redraws_during_the_bake(tree: Window) -> None:
    begin(tree)
    began = time.monotonic()
    tree.run("looks.clear()")
    tree.wait(lambda: not tree.run(BUSY), 240.0, "end of the bake")
    tree.settle(0.5)
    seconds = time.monotonic() - began
    times = tree.run("result = list(looks)")
    gaps = [b - a for a, b in itertools.pairwise(times)]
    at = [round(a - times[0], 2) for a, gap in zip(times, gaps, strict=False) if gap > 0.1]
    print(f"bake {seconds:.1f} s, gaps above 0.1 s:", [round(gap, 2) for gap in gaps if gap > 0.1], "at", at)
    tree.capture("baked")
    assert "douglas_fir_105k" in str(names(tree)) or len(names(tree)) > 2
    assert sorted(gaps)[-3] < 0.1
