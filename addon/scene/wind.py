"""The wind on a tree, read from the force fields of its scene.

A field of the type Wind counts, and one of the type Turbulence, where it renders, has a strength, and reaches the tree:
the tree lies within the field's own maximum distance, if it has one, and the tree's effector weights, if a particle
system, cloth or soft body of it has any, leave it in their collection and at more than 0. The strongest wind says the
direction, along the Z axis of its object; without one, turbulence shakes the tree to and fro along X. Falloff is not
looked at, nor by how much weights change a field.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import bpy
from mathutils import Vector

from ..plan.wind import Wind

STEADY = 0.5
"""What of a wind's strength is there all the time; the rest, its noise and turbulence come and go."""


def wind_on(sources: Sequence[bpy.types.Object], scene: bpy.types.Scene) -> Wind | None:
    """The wind in `scene` on the tree that the objects `sources` show; None where no field moves it."""
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
    """How fields act on the first particle system, cloth or soft body of the tree, if there is one."""
    for obj in sources:
        for system in obj.particle_systems:
            return system.settings.effector_weights
        for modifier in obj.modifiers:
            if modifier.type in {"CLOTH", "SOFT_BODY"}:
                return modifier.settings.effector_weights
    return None


def _acts(obj: bpy.types.Object, place: Vector, weights: bpy.types.EffectorWeights | None) -> bool:
    """Whether `obj` is a field that moves what stands at `place`."""
    field = obj.field
    if field is None or field.type not in {"WIND", "TURBULENCE"} or obj.hide_render or not field.strength:
        return False
    if field.use_max_distance and (obj.matrix_world.translation - place).length > field.distance_max:
        return False
    if weights is None:
        return True
    chosen = weights.collection is None or obj.name in weights.collection.all_objects
    return chosen and weights.all * (weights.wind if field.type == "WIND" else weights.turbulence) > 0.0
