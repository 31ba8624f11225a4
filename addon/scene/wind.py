"""Reader of the wind on a tree from the force fields of its scene.

Fields of the types Wind and Turbulence count if they are enabled for rendering, have a strength other than 0, and
reach the tree. A field reaches the tree if two conditions hold:
- The tree is within the field's maximum distance, if the field has one.
- The tree's effector weights, if a particle system, cloth or soft body of the tree has any, include the field in their
  collection and have a weight above 0 for it.

The strongest wind gives the direction, along the Z axis of its object. Without a wind, turbulence shakes the tree along
X. Falloff is ignored, and so are the sizes of the weights.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import bpy
from mathutils import Vector

from ..plan.wind import Wind

STEADY = 0.5
"""The constant share of a wind's strength. The rest, the wind's noise and turbulence are gusts."""


def wind_on(sources: Sequence[bpy.types.Object], scene: bpy.types.Scene) -> Wind | None:
    """Return the wind in `scene` on the tree that the objects `sources` show; None if no field acts on it."""
    if not sources:
        return None
    weights = _weights(sources)
    place = sum((obj.matrix_world.translation for obj in sources), Vector()) / len(sources)
    fields = [obj for obj in scene.objects if _acts(obj, place, weights)]
    winds = [obj for obj in fields if obj.field.type == "WIND"]
    shaking = sum(abs(obj.field.strength) for obj in fields if obj.field.type == "TURBULENCE")
    if not winds:
        return Wind((1.0, 0.0, 0.0), shaking, 1.0) if fields else None
    strongest = max(winds, key=lambda obj: abs(obj.field.strength))
    blowing = abs(strongest.field.strength)
    gusting = (1.0 - STEADY) * blowing + strongest.field.noise + shaking
    x, y, z = strongest.matrix_world.to_3x3().col[2].normalized()
    return Wind((x, y, z), strongest.field.strength, gusting / (gusting + STEADY * blowing), strongest.name)


def _weights(sources: Iterable[bpy.types.Object]) -> bpy.types.EffectorWeights | None:
    """Return the effector weights of the tree's first particle system, cloth or soft body; None without one."""
    for obj in sources:
        for system in obj.particle_systems:
            return system.settings.effector_weights
        for modifier in obj.modifiers:
            if modifier.type in {"CLOTH", "SOFT_BODY"}:
                return modifier.settings.effector_weights
    return None


def _acts(obj: bpy.types.Object, place: Vector, weights: bpy.types.EffectorWeights | None) -> bool:
    """Return whether `obj` is a field that acts on an object at `place`."""
    field = obj.field
    if field is None or field.type not in {"WIND", "TURBULENCE"} or obj.hide_render or not field.strength:
        return False
    if field.use_max_distance and (obj.matrix_world.translation - place).length > field.distance_max:
        return False
    if weights is None:
        return True
    chosen = weights.collection is None or obj.name in weights.collection.all_objects
    return chosen and weights.all * (weights.wind if field.type == "WIND" else weights.turbulence) > 0.0
