"""Content of report.json: the input, the levels, and their costs.

Deviations are fractions of R, areas are in texels, times in seconds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import bpy

import leafcloud

from ..bake.values import Baked
from ..levels.building import BuiltLevel
from ..plan.decision import Decision, is_on
from ..plan.registry import effect_named
from ..settings.bake import BakeSettings


def report(baked: Baked, write_seconds: Sequence[float], files: Sequence[str]) -> dict[str, Any]:
    """Return the content of report.json for one tree.

    `write_seconds`: one number per level. `files`: the names of all written files. Except for the values under the key
    "seconds", the same input, settings and seed give the same content.
    """
    prepared = baked.prepared
    levels = [_leaves(baked.levels[0], write_seconds[0])]
    for level, built, seconds in zip(baked.chain.levels, baked.levels[1:], write_seconds[1:], strict=True):
        distance = baked.switch_distances[built.number]
        levels.append(_level(level, built, prepared.settings, distance, seconds))
    if prepared.tree.trunk is not None and is_on(baked.effects, "trunk_levels"):
        for row, built in zip(levels, baked.levels, strict=True):
            # The cross impostor has no trunk mesh: its textures show the trunk.
            row["trunk"] = None if row["method"] == "cross" else _trunk(built, prepared.foliage.radius)
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
        "levels": levels,
        "predicted": _predicted(baked),
        "effects": [_effect(effect, baked) for effect in baked.effects],
        "files": list(files),
        "warnings": list(prepared.warnings),
    }


def joint_report(reports: Mapping[str, dict[str, Any]]) -> dict[str, Any]:
    """Return the content of report.json for several trees: the common values once, the rest for each tree by name."""
    common = ("leafcloud", "blender", "files")
    first = next(iter(reports.values()))
    trees = [
        {"name": name, **{key: value for key, value in content.items() if key not in common}}
        for name, content in reports.items()
    ]
    warnings = [f"{tree['name']}: {warning}" for tree in trees for warning in tree["warnings"]]
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
        "atlas_occupancy": 0.0,
        "max_deviation": 0.0,
        "mean_deviation": 0.0,
        "max_deviation_leaves": 0.0,
        "in_plane_motion": 0.0,
        "image_error": 0.0,
        "switch_distance": 0.0,
        "seconds": {"fit": 0.0, "pack": 0.0, "bake": 0.0, "look": 0.0, "write": write_seconds},
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
        "atlas_occupancy": level.occupancy,
        "max_deviation": None if cloud is None else cloud.max_deviation,
        "mean_deviation": None if cloud is None else cloud.mean_deviation,
        "max_deviation_leaves": level.max_deviation_leaves,
        "in_plane_motion": level.in_plane_motion,
        "image_error": level.image_error,
        "switch_distance": switch_distance,
        "seconds": {**level.seconds, "write": write_seconds},
    }


def _trunk(built: BuiltLevel, radius: float) -> dict[str, Any]:
    """Return the triangles of a level's trunk, and its deviation from LOD 0's trunk as a fraction of R."""
    return {"triangles": built.trunk_triangles, "error": built.trunk_error / radius}


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
