"""Levels of a tree baked with wind: leaves stay on the moving billboards of the next level."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest
from command_line import QUICK, bake, saved
from laws import Air, Floats, sway_at, tree_turns
from lod_scenes import evaluate, points_of
from mathutils import Euler, Matrix, Vector

from addon.nodes.lod import set_manual
from addon.nodes.wind import GROUP_NAME
from addon.versions import get_modifier_input, set_modifier_input

EFFECTS = "transitions,pruning,wind"
FRAMES = (0, 11, 40, 133)
FPS = 24.0
ROUNDING = 1e-5
"""Of the shrub's coordinates, which are below 1.5: some 64 ulp, of sines of some 200 turns."""
PLACE = Matrix.LocRotScale(Vector((30.0, -7.0, 4.0)), Euler((0.3, 0.2, 2.0)), Vector((2.5, 2.5, 2.5)))


def attribute(mesh: bpy.types.Mesh, name: str) -> Floats:
    """(v, …)"""
    found = mesh.attributes[name]
    width = 3 if found.data_type == "FLOAT_VECTOR" else 1
    values = np.empty(width * len(found.data), np.int32 if found.data_type == "INT" else np.float32)
    found.data.foreach_get("vector" if width == 3 else "value", values)
    return values.reshape(-1, 3).astype(float) if width == 3 else values


def blow(strength: float) -> None:
    for obj in bpy.data.objects:
        for modifier in obj.modifiers:
            if modifier.name == GROUP_NAME:
                set_modifier_input(modifier, "Strength", strength)


def by_hand(obj: bpy.types.Object, transition: float) -> None:
    lod, wind = obj.modifiers
    set_manual(lod, transition=transition, keep=1.0)
    set_modifier_input(wind, "Manual", True)
    set_modifier_input(wind, "Transition", transition)


@pytest.fixture(scope="module")
def folder(shrub: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a bake with wind of the shrub, rotated, scaled and far from the origin."""
    out, source = tmp_path_factory.mktemp("windy"), tmp_path_factory.mktemp("source")
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=str(shrub))
    for obj in bpy.context.scene.objects:
        if obj.parent is None:
            obj.matrix_world = PLACE @ obj.matrix_world
    bake(saved(source / "shrub.blend"), out, *QUICK, "--epsilon", 0.04, "--pixels", 8, "--effects", EFFECTS)
    return out


@pytest.fixture
def levels(folder: Path) -> list[bpy.types.Object]:
    """Open the baked file. Return its levels."""
    bpy.ops.wm.open_mainfile(filepath=str(folder / "shrub.blend"))
    return [bpy.data.objects[f"shrub_LOD{number}"] for number in range(4)]


def affine(rest: Floats, moved: Floats) -> Floats:
    """Return the affine map (4, 3) of a billboard's corners and normal, as x ↦ (x, 1) · result.

    Fail if the corners do not lie in a plane, before or after the motion.
    """
    normal = np.cross(rest[1] - rest[0], rest[2] - rest[0])
    normal /= np.linalg.norm(normal)
    size = np.ptp(rest, axis=0).max()
    known = np.vstack([np.column_stack([rest, np.ones(len(rest))]), [*normal * size, 0.0]])
    found, *_ = np.linalg.lstsq(known, np.vstack([moved, normal * size]), rcond=None)
    assert np.abs(known @ found - np.vstack([moved, normal * size])).max() < 2e-6
    return found


def corners_of_billboards(leaves: bpy.types.Mesh, cloud: bpy.types.Mesh) -> dict[int, list[int]]:
    """Return the corners of each billboard in the next level, found by the pivot.

    The corners lie in one plane with all targets. Targets keep 1/4096 of their height over the plane.
    """
    targets, billboards = attribute(leaves, "leaf_target"), attribute(leaves, "leaf_billboard")
    carriers, pivots = attribute(leaves, "leaf_billboard_pivot"), attribute(cloud, "leaf_pivot")
    rest, found = points_of(cloud).astype(float), {}
    for number in np.unique(billboards[billboards >= 0]).tolist():
        held = billboards == number
        assert np.ptp(carriers[held], axis=0).max() == 0.0
        off = np.linalg.norm(pivots - carriers[held][0], axis=1)
        corners = np.flatnonzero(off < 1e-6)
        assert len(corners) >= 3
        assert off[off >= 1e-6].min(initial=1.0) > 1e-3
        assert heights(rest[corners], targets[held]).max() < 1e-4
        found[number] = corners.tolist()
    assert sum(map(len, found.values())) == len(rest), "each corner is one billboard's"
    return found


def heights(corners: Floats, points: Floats) -> Floats:
    """Return the heights (n,) of points over the plane of a billboard's corners."""
    arms = corners - corners.mean(axis=0)
    normal = np.linalg.svd(arms)[2][-1]
    return np.abs((points - corners.mean(axis=0)) @ normal)


@pytest.mark.parametrize(("finer", "coarser"), [(0, 1), (1, 2)])
@pytest.mark.parametrize("strength", [2.0, 50.0])
def test_leaves_lie_on_the_swayed_billboards_of_the_next_level(
    levels: list[bpy.types.Object], finer: int, coarser: int, strength: float
) -> None:
    """At the end of the transition (a = 1), at any time, leaves lie where the moved billboard's texture shows them.

    Targets keep a small height over the plane.
    """
    blow(strength)
    leaves, cloud = levels[finer], levels[coarser]
    by_hand(leaves, 1.0)
    by_hand(cloud, 0.0)
    targets, billboards = attribute(leaves.data, "leaf_target"), attribute(leaves.data, "leaf_billboard")
    owners, rest = corners_of_billboards(leaves.data, cloud.data), points_of(cloud.data).astype(float)
    farthest = 0.0
    for frame in FRAMES:
        bpy.context.scene.frame_set(frame)
        morphed, swayed = (points_of(evaluate(obj)).astype(float) for obj in (leaves, cloud))
        for number, corners in owners.items():
            held = billboards == number
            carried = affine(rest[corners], swayed[corners])
            expected = np.column_stack([targets[held], np.ones(held.sum())]) @ carried
            off = np.linalg.norm(morphed[held] - expected, axis=1)
            assert (off <= ROUNDING + heights(rest[corners], targets[held])).all(), (frame, number, off.max())
        farthest = max(farthest, float(np.linalg.norm(morphed - targets, axis=1).max()))
    assert farthest > 0.02 * strength / (strength + 4.0)


def test_a_field_of_points_alone_would_not_close(levels: list[bpy.types.Object]) -> None:
    """Show why leaves and billboards follow affine maps: w bends more over a large billboard than levels may differ."""
    blow(50.0)
    leaves, cloud = levels[0], levels[1]
    targets, billboards = attribute(leaves.data, "leaf_target"), attribute(leaves.data, "leaf_billboard")
    rest, air, gap = points_of(cloud.data).astype(float), air_of(leaves, FRAMES[1] / FPS), 0.0
    for number, corners in corners_of_billboards(leaves.data, cloud.data).items():
        held = targets[billboards == number]
        arms = np.column_stack([rest[corners], np.ones(len(corners))])
        flat, *_ = np.linalg.lstsq(arms, rest[corners] + sway_at(rest[corners], air), rcond=None)
        shown = np.column_stack([held, np.ones(len(held))]) @ flat
        gap = max(gap, float(np.linalg.norm(held + sway_at(held, air) - shown, axis=1).max()))
    assert gap > 1000.0 * ROUNDING


def test_the_error_at_the_switch_is_as_small_as_the_formula_predicts(levels: list[bpy.types.Object]) -> None:
    """At a = 0.998, leaves keep 0.002 of their flutter and of their branch's own motion.

    The rest of the distance is the way to their targets, as without wind.
    """
    blow(1e6)
    leaves = levels[0]
    moved, targets = {}, attribute(leaves.data, "leaf_target")
    for a in (0.998, 1.0):
        by_hand(leaves, a)
        bpy.context.scene.frame_set(FRAMES[2])
        moved[a] = points_of(evaluate(leaves)).astype(float)
    way = 0.002 * (points_of(leaves.data) - targets)
    wind = leaves.modifiers[GROUP_NAME]
    sway, branches, flutter, height, spread = (
        get_modifier_input(wind, name) for name in ("Sway", "Branches", "Flutter", "Height", "Spread")
    )
    k = 2.0 * np.sqrt(2.0)
    greatest = 2.0 * sway / height + branches / spread * (2.0 + 4.0 * k + k**2)
    own, carrier, arm = (
        np.linalg.norm(targets - attribute(leaves.data, name), axis=1)
        for name in ("leaf_pivot", "leaf_billboard_pivot", "leaf_pivot_target")
    )
    bound = 0.002 * (flutter * arm + greatest * (own**2 + carrier**2) / 2.0)
    stretch = 1.0 + 2.0 * sway + 4.0 * branches * k  # how the wind changes the way itself
    off = np.linalg.norm(moved[0.998] - moved[1.0], axis=1)
    assert (off <= bound + stretch * np.linalg.norm(way, axis=1) + ROUNDING).all()


def test_trunk_and_cloud_stand_in_one_field(levels: list[bpy.types.Object]) -> None:
    """The displacement w moves the trunk and each billboard's pivot, which is the center of a rectangle's corners."""
    blow(9.0)
    cloud, trunk = levels[1], bpy.data.objects["shrub_LOD1_trunk"]
    by_hand(cloud, 0.0)
    set_manual(trunk.modifiers[0], transition=0.0, keep=1.0)
    pivots, rest, bark = attribute(cloud.data, "leaf_pivot"), points_of(cloud.data), points_of(trunk.data)
    for frame in FRAMES:
        bpy.context.scene.frame_set(frame)
        air = air_of(cloud, frame / FPS)
        np.testing.assert_allclose(points_of(evaluate(trunk)) - bark, sway_at(bark.astype(float), air), atol=ROUNDING)
        swayed = points_of(evaluate(cloud)) - rest
        for pivot in np.unique(pivots, axis=0):
            corners = (pivots == pivot).all(axis=1)
            is_centred = np.allclose(rest[corners].mean(axis=0), pivot, rtol=0.0, atol=ROUNDING)
            if corners.sum() == 4 and is_centred:
                np.testing.assert_allclose(swayed[corners].mean(axis=0), sway_at(pivot[None], air)[0], atol=ROUNDING)


def air_of(obj: bpy.types.Object, seconds: float) -> Air:
    """Return the inputs of the level's modifier, in the level's coordinates."""
    wind = obj.modifiers[GROUP_NAME]
    value = {name: get_modifier_input(wind, name) for name in ("Direction", "Up", "Foot", "Period")}
    numbers = ("Height", "Spread", "Strength", "Gusts")
    swing = {name.lower(): get_modifier_input(wind, name) for name in ("Sway", "Branches", "Flutter")}
    world = np.array(obj.matrix_world)
    along = np.linalg.inv(world[:3, :3]) @ value["Direction"]
    return Air(
        along / np.linalg.norm(along),
        *(np.array(value[name]) for name in ("Up", "Foot")),
        *(get_modifier_input(wind, name) for name in numbers),
        turns=tree_turns(seconds, value["Period"], world[:3, 3]),
        **swing,
    )
