"""Labels in 3D views: the level of each tree, its distance and its triangles, beside the tree."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import blf
import bpy
from bpy_extras.view3d_utils import location_3d_to_region_2d
from mathutils import Vector

from ..mesh.baked_levels import EXTRAS, level_number
from ..nodes.eye import place_of_eye
from ..nodes.lod import GROUP_NAME, lod_distance
from ..versions import get_modifier_input

MOST = 30
"""Trees that get a label: those nearest to the eye."""
_SIZE = 13.0
_HEADERS = 6.0
"""Height of the view's headers, in sizes of the text."""
_COLOR, _SHADOW = (1.0, 1.0, 1.0, 1.0), (0.0, 0.0, 0.0, 0.8)


@dataclass(frozen=True)
class Label:
    """A line of text at a point of the world: the top of a crown. distance: from the eye, in world units."""

    text: str
    place: Vector
    distance: float


def draw_labels() -> None:
    """Draw the labels of the scene's levels into the region of a 3D view."""
    context = bpy.context
    region, view, camera = context.region, context.region_data, context.scene.camera
    eye = place_of_eye() or (None if camera is None else camera.matrix_world.translation)
    if eye is None:
        return
    size = _SIZE * context.preferences.system.ui_scale
    blf.size(0, size)
    blf.enable(0, blf.SHADOW)
    blf.shadow(0, 3, *_SHADOW)
    blf.color(0, *_COLOR)
    for label in seen_from(eye, [obj for obj in levels_in(context.scene) if obj.visible_get()]):
        place = location_3d_to_region_2d(region, view, label.place)
        if place is not None:
            width, _ = blf.dimensions(0, label.text)
            top = region.height - _HEADERS * size  # A near crown reaches beyond the view.
            blf.position(0, place.x - width / 2.0, min(place.y + size / 2.0, top), 0.0)
            blf.draw(0, label.text)
    blf.disable(0, blf.SHADOW)


def levels_in(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Return the levels that the distance shows and hides."""
    meshes = (obj for obj in scene.objects if obj.type == "MESH" and GROUP_NAME in obj.modifiers)
    return [obj for obj in meshes if level_number(obj) is not None]


def seen_from(eye: Vector, levels: Sequence[bpy.types.Object]) -> list[Label]:
    """Return the labels of the trees nearest to `eye`, the farthest first."""
    found: list[Label] = []
    for level in levels:
        with suppress(ReferenceError):  # The level was deleted.
            label = _label(level, eye)
            found += [label] if label else []
    return sorted(found, key=lambda label: label.distance)[:MOST][::-1]


def _label(level: bpy.types.Object, eye: Vector) -> Label | None:
    """Return the label of a level; None if it is not drawn, or shows less of the tree than another level."""
    modifier, matrix = level.modifiers[GROUP_NAME], level.matrix_world
    centre = centre_of(level)
    own_distance = (matrix.inverted_safe() @ eye - centre).length / lod_distance(modifier)
    first, last = _range(modifier)
    if not (get_modifier_input(modifier, "Manual") or first <= own_distance < last):
        return None
    middle = matrix @ centre
    radius = float(level[EXTRAS].get("radius", 0.0)) * max(map(abs, matrix.to_scale()))
    distance = (middle - eye).length
    number = level_number(level)
    name = "leaves" if number == 0 else f"level {number}"
    text = f"{name}   {length_words(distance)}   {_triangles(level):,} triangles"
    return Label(text, middle + Vector((0.0, 0.0, radius)), distance)


def _range(modifier: bpy.types.NodesModifier) -> tuple[float, float]:
    """Return the distances between which a level shows more of the tree than others: fades count to their middle."""
    names = ("Appear", "Fade In End", "Fade Out Start", "Vanish")
    appear, faded_in, fades_out, vanish = (float(get_modifier_input(modifier, name)) for name in names)
    return (appear + max(faded_in, appear)) / 2.0, (min(fades_out, vanish) + vanish) / 2.0


def _triangles(level: bpy.types.Object) -> int:
    """Return the triangles of a level with its trunk, before pruning."""
    meshes = [level.data, *(child.data for child in level.children if child.type == "MESH")]
    return sum(len(mesh.loops) - 2 * len(mesh.polygons) for mesh in meshes)


def centre_of(level: bpy.types.Object) -> Vector:
    """Return the point to measure a level's distances from, in its own coordinates."""
    return Vector(get_modifier_input(level.modifiers[GROUP_NAME], "Centre"))


def length_words(length: float) -> str:
    """Return a length in the units of the scene."""
    units = bpy.context.scene.unit_settings
    if units.system == "NONE":
        return f"{length:,.1f}"
    return str(bpy.utils.units.to_string(units.system, "LENGTH", length * units.scale_length, precision=3))
