"""Labels of the preview: the level of each tree, its distance from the view and its triangles, beside the tree."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import blf
import bpy
from bpy_extras.view3d_utils import location_3d_to_region_2d
from mathutils import Vector

from ..mesh.baked_levels import EXTRAS, level_number
from .draw import centre_of, distance_factor, inputs_of
from .look import LevelInputs, look_at

MOST = 30
"""Trees that get a label: those nearest to the view."""
_SIZE = 13.0
_HEADERS = 6.0
"""Height of the view's headers, in sizes of the text."""
_COLOR, _SHADOW = (1.0, 1.0, 1.0, 1.0), (0.0, 0.0, 0.0, 0.8)


@dataclass(frozen=True)
class _Level:
    """A level, with what its label tells. triangles: with the trunk, before pruning."""

    obj: bpy.types.Object
    number: int
    inputs: LevelInputs
    centre: Vector
    radius: float
    triangles: int


@dataclass(frozen=True)
class Label:
    """A line of text at a point of the world: the top of a crown. distance: from the view, in world units."""

    text: str
    place: Vector
    distance: float


class Labels:
    """The labels of the levels that a preview draws. Reads the levels once."""

    def __init__(self, levels: Sequence[bpy.types.Object]) -> None:
        numbers = ((obj, level_number(obj)) for obj in levels)
        self._levels = [_read(obj, number) for obj, number in numbers if number is not None]

    def seen_from(self, eye: Vector) -> list[Label]:
        """Return the labels of the trees nearest to `eye`, the farthest first."""
        found: list[Label] = []
        for level in self._levels:
            with suppress(ReferenceError):  # The level was deleted.
                label = _label(level, eye)
                found += [label] if label else []
        return sorted(found, key=lambda label: label.distance)[:MOST][::-1]

    def draw(self) -> None:
        """Draw into the region of a 3D view."""
        context = bpy.context
        region, view = context.region, context.region_data
        eye = view.view_matrix.inverted().translation
        size = _SIZE * context.preferences.system.ui_scale
        blf.size(0, size)
        blf.enable(0, blf.SHADOW)
        blf.shadow(0, 3, *_SHADOW)
        blf.color(0, *_COLOR)
        for label in self.seen_from(eye):
            place = location_3d_to_region_2d(region, view, label.place)
            if place is not None:
                width, _ = blf.dimensions(0, label.text)
                top = region.height - _HEADERS * size  # A near crown reaches beyond the view.
                blf.position(0, place.x - width / 2.0, min(place.y + size / 2.0, top), 0.0)
                blf.draw(0, label.text)
        blf.disable(0, blf.SHADOW)


def _read(obj: bpy.types.Object, number: int) -> _Level:
    meshes = [obj.data, *(child.data for child in obj.children if child.type == "MESH")]
    triangles = sum(len(mesh.loops) - 2 * len(mesh.polygons) for mesh in meshes)
    return _Level(obj, number, inputs_of(obj), centre_of(obj), float(obj[EXTRAS].get("radius", 0.0)), triangles)


def _label(level: _Level, eye: Vector) -> Label | None:
    """Return the label of a level; None if it is not drawn, or fades out: the next level has the label."""
    matrix = level.obj.matrix_world
    look = look_at(level.inputs, (matrix.inverted_safe() @ eye - level.centre).length / distance_factor(level.obj))
    if look is None or (not look.coming and look.next_share > 0.5) or (look.coming and look.next_share <= 0.5):
        return None
    middle = matrix @ level.centre
    top = middle + Vector((0.0, 0.0, level.radius * max(map(abs, matrix.to_scale()))))
    distance = (middle - eye).length
    name = "leaves" if level.number == 0 else f"level {level.number}"
    return Label(f"{name}   {length_words(distance)}   {level.triangles:,} triangles", top, distance)


def length_words(length: float) -> str:
    """Return a length in the units of the scene."""
    units = bpy.context.scene.unit_settings
    if units.system == "NONE":
        return f"{length:,.1f}"
    return str(bpy.utils.units.to_string(units.system, "LENGTH", length * units.scale_length, precision=3))
