"""Times level 1 in Cycles with other materials: `make bench-materials`.

usage: python bench/materials.py [TREE.glb …]  (default: maple, oak and pine of ../shared/foliage)

Renders level 1 without its trunk. Prints two tables in Markdown, in samples per second of processor time:

- pairs of front and back billboards, as files have them, against one polygon for each pair, as Blender draws them;
- the level as it is, against the level without its alpha test. Triangles inside opaque regions could be drawn without
  an alpha test, and this is the most that they could gain: here all triangles are.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import bpy
from stage import FOLIAGE, bake_alone, light_up, place, sampling_time, show_only

from addon.bake.values import Baked
from addon.settings.bake import BakeSettings

TREES = ("maple_13k", "oak_cards_11k", "pine_cards_20k")
SIZE, FEW, MANY = 400, 2, 18
FIELD_OF_VIEW, DISTANCE = 0.6, 3.5
"""The crown nearly fills the picture."""


def shown_level(tree: Path, settings: BakeSettings) -> Baked:
    """Bake a tree and show level 1 without its trunk."""
    baked = bake_alone(tree, settings)
    level = baked.levels[1]
    if level.trunk is not None:
        bpy.data.objects.remove(level.trunk)
        baked = replace(baked, levels=(baked.levels[0], replace(level, trunk=None), *baked.levels[2:]))
    camera = light_up(SIZE, MANY)
    show_only(baked, 1)
    place(baked, camera, DISTANCE, FIELD_OF_VIEW)
    return baked


def samples_per_second() -> float:
    bpy.context.view_layer.update()
    return (MANY - FEW) * SIZE**2 / sampling_time(FEW, MANY)


def pair_row(tree: Path) -> str:
    baked = shown_level(tree, BakeSettings(effects="+back_sides", every_level=True))
    modifier = baked.levels[1].object.modifiers["Leafcloud Sides"]
    speeds = []
    for single in (False, True):
        modifier.show_viewport = modifier.show_render = single
        speeds.append(samples_per_second())
    return line(tree, baked, speeds)


def opaque_row(tree: Path) -> str:
    baked = shown_level(tree, BakeSettings(every_level=True))
    tested = samples_per_second()
    nodes = baked.levels[1].object.data.materials[0].node_tree
    surface = next(node for node in nodes.nodes if node.type == "BSDF_PRINCIPLED")
    for link in list(surface.inputs["Alpha"].links):
        nodes.links.remove(link)
    return line(tree, baked, [tested, samples_per_second()])


def line(tree: Path, baked: Baked, speeds: list[float]) -> str:
    return (
        f"| {tree.stem} | {baked.levels[1].triangles:,} | {speeds[0]:,.0f} | {speeds[1]:,.0f} "
        f"| {speeds[1] / speeds[0]:.2f} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "trees", nargs="*", type=Path, help="GLB files (default: maple, oak, pine of ../shared/foliage)"
    )
    trees = parser.parse_args().trees or [FOLIAGE / f"{name}.glb" for name in TREES]
    for columns, row in (("pairs | one polygon", pair_row), ("alpha tested | opaque", opaque_row)):
        rows = [row(tree) for tree in trees]
        print(f"\n| tree | triangles | {columns} | × |\n|---|---|---|---|---|")
        print("\n".join(rows))


if __name__ == "__main__":
    main()
