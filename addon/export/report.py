"""Content of report.json: the input, the levels, and their costs.

Deviations are fractions of R, times are in seconds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import bpy

import leafcloud

from ..bake.drawing import LevelDrawing, drawing_costs, left_out_reasons, needs_no_levels
from ..bake.values import Baked
from ..levels.building import BuiltLevel
from ..plan.decision import Decision, is_on
from ..plan.engine_limits import several_trees_warnings
from ..plan.lod_range import View
from ..plan.registry import effect_named
from ..settings.bake import BakeSettings
from .gpu_load import GpuLoad

HEAVY = 4.0
"""The levels' textures may take this many times the leaves' bytes on a graphics card without a warning."""
FEW_BYTES = 16_000_000
"""Textures up to these bytes cause no warning: an octahedral impostor has 11 MB."""


def report(baked: Baked, write_seconds: Sequence[float], files: Sequence[str], load: GpuLoad) -> dict[str, Any]:
    """Return the content of report.json for one tree.

    `write_seconds`: one number per level. `files`: the names of all written files. `load`: of their nodes. Except
    for the values under the key "seconds", the same input, settings and seed give the same content.
    """
    prepared = baked.prepared
    levels = [_leaves(baked.levels[0], write_seconds[0])]
    for level, built, seconds in zip(baked.chain.levels, baked.levels[1:], write_seconds[1:], strict=True):
        distance = baked.switch_distances[built.number]
        if isinstance(level, leafcloud.LeafLevel):
            levels.append(_leaf_level(level, built, distance, seconds))
        elif isinstance(level, leafcloud.OctahedralLevel):
            levels.append(_octahedral(level, built, baked, seconds))
        else:
            levels.append(_level(level, built, prepared.settings, distance, seconds))
    if prepared.tree.trunk is not None and is_on(baked.effects, "trunk_levels"):
        for row, built in zip(levels, baked.levels, strict=True):
            # An impostor has no trunk mesh: its textures show the trunk.
            row["trunk"] = None if row["method"] in ("cross", "octahedral") else _trunk(built)
    costs = drawing_costs(baked)
    for row, built, cost in zip(levels, baked.levels, costs, strict=True):
        name = built.object.name
        row["drawing"] = {
            **_drawing(cost, baked.view),
            "gpu_bytes": load.bytes_of(name),
            "texture_bytes": load.texture_bytes_of(name),
            "written_triangles": load.triangles.get(name, 0),
        }
    return {
        "leafcloud": leafcloud.__version__,
        "blender": bpy.app.version_string,
        "input": {
            "triangles": prepared.foliage.triangle_count,
            "leaves": prepared.foliage.leaf_count,
            "radius": prepared.foliage.radius,
            "choice": prepared.tree.choice,
            "materials": list(prepared.materials),
            "dropped": list(prepared.tree.dropped),
        },
        "quality": _quality(baked),
        "levels": levels,
        "hidden_triangles": _hidden_triangles(baked),
        "left_out": _left_out(baked),
        "needs_no_levels": needs_no_levels(costs),
        "predicted": _predicted(baked),
        "effects": [_effect(effect, baked) for effect in baked.effects],
        "files": list(files),
        "warnings": [*prepared.warnings, *texture_warnings(levels)],
    }


def texture_warnings(levels: Sequence[dict[str, Any]]) -> list[str]:
    """Return a warning if the levels' textures take far more room on a graphics card than the leaves themselves."""
    leaves, *others = (level["drawing"] for level in levels)
    textures = sum(level["texture_bytes"] for level in others)
    if textures <= max(HEAVY * leaves["gpu_bytes"], FEW_BYTES):
        return []
    largest = max(levels[1:], key=lambda level: level["drawing"]["texture_bytes"])
    remedy = "`last=cross`" if largest["method"] == "octahedral" else "a smaller `texture_size`"
    return [
        f"the levels' textures take {textures / 1e6:.1f} MB on a graphics card, "
        f"{textures / leaves['gpu_bytes']:.0f} times as much as the leaves with theirs "
        f"({leaves['gpu_bytes'] / 1e6:.1f} MB), most of it for level {largest['level']}: set {remedy}"
    ]


def joint_report(reports: Mapping[str, dict[str, Any]], engine: str) -> dict[str, Any]:
    """Return the content of report.json for several trees: the common values once, the rest for each tree by name."""
    common = ("leafcloud", "blender", "files")
    first = next(iter(reports.values()))
    trees = [
        {"name": name, **{key: value for key, value in content.items() if key not in common}}
        for name, content in reports.items()
    ]
    of_trees = [f"{tree['name']}: {warning}" for tree in trees for warning in tree["warnings"]]
    warnings = [*several_trees_warnings(engine, len(trees)), *of_trees]
    return {**{key: first[key] for key in common[:2]}, "trees": trees, "files": first["files"], "warnings": warnings}


def _predicted(baked: Baked) -> dict[str, Any] | None:
    """Return the prediction of a cost curve beside the measured values; None without a cost curve.

    `settings`: the settings chosen for `seconds`, `image_error` or `preset`, else None. `image_error`: that of level 1.
    """
    chosen = baked.chain.chosen
    predicted = baked.prepared.predicted if chosen is None else chosen["predicted"]
    if predicted is None:
        return None
    return {
        "settings": None if chosen is None else chosen["settings"],
        "image_error": {"predicted": predicted["image_error"], "measured": baked.chain.levels[0].image_error},
        "seconds": {"predicted": predicted["seconds"], "measured": baked.chain.seconds},
    }


def _quality(baked: Baked) -> dict[str, Any] | None:
    """Return the row `quality`; None if `pixels` sets the LOD distances.

    For each level after LOD 0: `crown_pixels`, the diameter of the crown where it takes over, and `size`, that as a
    fraction of the picture's height; `passes`, whether it looks like the leaves there; `judged`, its figures there.
    `tried`: the error bounds that were tried for the first cloud, the chosen one last.
    """
    sizes, height = baked.schedule.crowns, baked.view.resolution
    rows = [
        {"crown_pixels": size, "size": size / height, "passes": taken["passes"], "judged": taken["judged"]}
        for size, taken in zip(sizes, baked.chain.takes_over, strict=True)
    ]
    settings = baked.prepared.settings
    whole = {"quality": settings.quality, "scene": settings.scene, "memory_budget": settings.memory_budget}
    return {**whole, "levels": rows, "tried": baked.chain.tried} if rows else None


def _leaves(built: BuiltLevel, write_seconds: float) -> dict[str, Any]:
    """Return the row of LOD 0, which has no billboards and no deviation."""
    return {
        "level": 0,
        "method": "leaves",
        "epsilon": 0.0,
        "candidates": 0,
        "billboards": 0,
        "triangles": built.triangles,
        "trunk_triangles": built.trunk_triangles,
        "texels": 0,
        "texture_size": None,
        "atlas_occupancy": 0.0,
        "max_deviation": 0.0,
        "mean_deviation": 0.0,
        "max_deviation_leaves": 0.0,
        "in_plane_motion": 0.0,
        "image_error": 0.0,
        "refined": None,
        "refined_planes": None,
        "switch_distance": 0.0,
        "seconds": {"fit": 0.0, "pack": 0.0, "bake": 0.0, "look": 0.0, "refine": 0.0, "write": write_seconds},
    }


def _leaf_level(
    level: leafcloud.LeafLevel, built: BuiltLevel, switch_distance: float, write_seconds: float
) -> dict[str, Any]:
    """Return the row of a level of simplified leaves, which has no billboards and no texture of its own."""
    row = _leaves(built, write_seconds)
    return {
        **row,
        "level": built.number,
        "method": level.method,
        "max_deviation": level.max_deviation_leaves,
        "max_deviation_leaves": level.max_deviation_leaves,
        "mean_deviation": None,
        "image_error": level.image_error,
        "switch_distance": switch_distance,
        "seconds": {**level.seconds, "write": write_seconds},
    }


def _octahedral(
    level: leafcloud.OctahedralLevel, built: BuiltLevel, baked: Baked, write_seconds: float
) -> dict[str, Any]:
    """Return the row of an octahedral impostor. `plain`: the row of the cross impostor, which files have in its place.

    triangles: those of its quad in engines; Blender draws an ellipsoid.
    """
    settings, number = baked.prepared.settings, built.number
    plain = _level(level.cross, built, settings, baked.schedule.plain_distances[number], write_seconds)
    plain["triangles"] = level.cross.triangles
    del plain["level"], plain["trunk_triangles"]
    return {
        **_level(level.cross, built, settings, baked.switch_distances[number], write_seconds),
        "method": level.method,
        "billboards": 1,
        "triangles": level.triangles,
        "texels": level.texels,
        "texture_size": list(level.color.shape[1::-1]),
        "atlas_occupancy": 1.0,
        "max_deviation_leaves": level.max_deviation_leaves,
        "in_plane_motion": 0.0,
        "image_error": level.image_error,
        "seconds": {**level.seconds, "write": write_seconds},
        "plain": plain,
    }


def _level(
    level: leafcloud.Level, built: BuiltLevel, settings: BakeSettings, switch_distance: float, write_seconds: float
) -> dict[str, Any]:
    """Return the row of a cloud or of the cross impostor, for which ε and the values of the fit are None."""
    cloud = level.cloud
    return {
        "level": built.number,
        "method": level.method,
        "epsilon": None if cloud is None else cloud.epsilon,
        "candidates": None if cloud is None else settings.candidates,
        "billboards": billboard_count(level),
        "triangles": built.triangles,
        "trunk_triangles": built.trunk_triangles,
        "texels": level.texels,
        "texture_size": list(level.base_color.shape[1::-1]),
        "atlas_occupancy": level.occupancy,
        "max_deviation": None if cloud is None else cloud.max_deviation,
        "mean_deviation": None if cloud is None else cloud.mean_deviation,
        "max_deviation_leaves": level.max_deviation_leaves,
        "in_plane_motion": level.in_plane_motion,
        "image_error": level.image_error,
        "refined": level.refined,
        "refined_planes": level.refined_planes,
        "switch_distance": switch_distance,
        "seconds": {**level.seconds, "write": write_seconds},
    }


def _drawing(cost: LevelDrawing, view: View) -> dict[str, Any]:
    """Return what a level costs to draw where it takes over, LOD 0 where level 1 does.

    crown_pixels: diameter of the crown's sphere there. size: that as a fraction of the picture's height. fragments:
    without the trunk, which has trunk_fragments.
    fragments_before, fragments_leaves: those of the level before and of LOD 0 there, without trunks. area: of all drawn
    sides, relative to LOD 0's. cheaper: how many times cheaper the level is to draw than LOD 0, with trunks.
    """
    return {
        "crown_pixels": cost.crown_pixels,
        "size": cost.crown_pixels / view.resolution,
        "fragments": cost.own["fragments"],
        "fragments_before": cost.before["fragments"],
        "fragments_leaves": cost.leaves["fragments"],
        "trunk_fragments": 0.0 if cost.trunk is None else cost.trunk["fragments"],
        "layers": cost.own["layers"],
        "area": cost.own["area"] / cost.leaves["area"],
        "cheaper": cost.cheaper,
    }


def _hidden_triangles(baked: Baked) -> int:
    """Return the number of triangles that are in no cloud, because the crown hides their leaves.

    They are triangles of the simplified leaves if there are some, else of LOD 0.
    """
    kept = baked.chain.kept
    if kept is None or baked.chain.clouds[0].cloud is None:  # The cross impostor shows all leaves.
        return 0
    triangles, growth = kept
    is_pruned = bool((growth != 1.0).any())
    first = baked.chain.levels[0]
    is_simplified = isinstance(first, leafcloud.LeafLevel) and first.kept is None
    whole = first.triangles if is_simplified else baked.prepared.foliage.triangle_count
    return 0 if is_pruned else whole - len(triangles)


def _left_out(baked: Baked) -> list[dict[str, Any]]:
    """Return the levels that were not made, with the reasons."""
    reasons = left_out_reasons(baked.chain)
    return [{**each, "reason": reason} for each, reason in zip(baked.chain.left_out, reasons, strict=True)]


def _trunk(built: BuiltLevel) -> dict[str, Any]:
    """Return the triangles of a level's trunk, and the fraction of the level's picture that it changes."""
    return {"triangles": built.trunk_triangles, "change": built.trunk_change}


def billboard_count(level: leafcloud.Level) -> int:
    """Return the number of billboards of a level; a pair of front and back billboards counts once."""
    return len(level.plane_ids) // 2 if level.two_sided else len(level.plane_ids)


def _effect(effect: Decision, baked: Baked) -> dict[str, Any]:
    """Return an effect's state and reason, its measured costs, and its estimated costs."""
    nbytes = baked.costs.bytes.get(effect.name, 0) + effect_named(effect.name).texture_bytes(baked.chain)
    return {
        "name": effect.name,
        "on": effect.on,
        "reason": effect.reason,
        "seconds": baked.costs.seconds.get(effect.name, 0.0),
        "bytes": nbytes,
        "estimate": {"seconds": effect.seconds, "bytes": effect.bytes},
    }
