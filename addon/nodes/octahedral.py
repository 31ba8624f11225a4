"""The shader node groups of an octahedral impostor, by the law of `rust/core/src/lod/octahedral/draw.rs`.

*Leafcloud Octahedral* finds the three views around a ray and their weights. *Leafcloud Octahedral View* finds the place
of the ray in the picture of one view, at a given height toward the viewer. Both work in the axes of the impostor, with
the stored depth as the unit. Each ray has views of its own, so shadows and reflections show the tree from their side.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import bpy

from .builder import Section
from .laws import declare, group_of_layout

GROUP_NAME, VIEW_GROUP_NAME = "Leafcloud Octahedral", "Leafcloud Octahedral View"
BELOW = 0.5
"""How far the views reach below the horizon (`BELOW` of octahedral/mapping.rs)."""
STEPS = 2
"""Corrections of the height by the stored depth (`STEPS` of octahedral/draw.rs)."""
OPEN = 1.5
"""Light over the stored openness (`LC_OPEN` of shaders/octahedral.glsl)."""

_LAYOUT_KEY, _VIEW_LAYOUT_KEY = "leafcloud_octahedral_layout", "leafcloud_octahedral_view_layout"
_LAYOUT = 1

Socket: TypeAlias = bpy.types.NodeSocket


def views_group() -> bpy.types.NodeTree:
    """Return the group that finds the views. Create it if it is missing.

    Outputs: Ray, a Point of it, and Tile (column, row) and Weight of each of three views.
    """
    return group_of_layout(GROUP_NAME, _LAYOUT_KEY, _LAYOUT, _declare_views, _find_views, kind="ShaderNodeTree")


def view_group() -> bpy.types.NodeTree:
    """Return the group that finds a place in a view's picture. Create it if it is missing.

    Outputs: UV, and the axes Right, Up and Toward of the picture.
    """
    return group_of_layout(
        VIEW_GROUP_NAME, _VIEW_LAYOUT_KEY, _LAYOUT, _declare_view, _find_place, kind="ShaderNodeTree"
    )


def transformed(section: Section, rows: Sequence[Sequence[float]], vector: Socket, label: str) -> Socket:
    """Return a vector times three rows of a matrix; a fourth number of each row is added."""
    parts = []
    for row in rows:
        part = section.result("ShaderNodeVectorMath", vector, tuple(row[:3]), operation="DOT_PRODUCT")
        parts.append(section.math("ADD", part, row[3]) if len(row) > 3 else part)
    return section.result("ShaderNodeCombineXYZ", *parts, label=label)


def _dot(section: Section, first: Socket, second: Socket, label: str = "") -> Socket:
    return section.vector("DOT_PRODUCT", first, second, label=label)


def _declare_views(tree: bpy.types.NodeTree) -> None:
    declare(tree, "Eye", "Vector", "Direction from the surface to the eye, of length 1")
    declare(tree, "Point", "Vector", "The place of the surface")
    declare(tree, "Grid", "Float", "Views along each side of the page")
    for name in ("Ray", "Point"):
        tree.interface.new_socket(name, in_out="OUTPUT", socket_type="NodeSocketVector")
    for number in (1, 2, 3):
        tree.interface.new_socket(f"Tile {number}", in_out="OUTPUT", socket_type="NodeSocketVector")
        tree.interface.new_socket(f"Weight {number}", in_out="OUTPUT", socket_type="NodeSocketFloat")


def _find_views(tree: bpy.types.NodeTree) -> None:
    section = Section(tree, "Ray, at most 45° from below", (-2400.0, 600.0))
    toward = section.group_input("Eye")
    eye = section.node("ShaderNodeSeparateXYZ", toward).outputs
    across = section.math("SQRT", section.math("ADD", *(section.math("MULTIPLY", e, e) for e in eye[:2])))
    height = section.math("MAXIMUM", eye[2], section.math("MULTIPLY", across, -1.0))
    ray = section.vector("NORMALIZE", section.result("ShaderNodeCombineXYZ", *eye[:2], height), label="Ray")

    section = Section(tree, "The picture from there", (-800.0, 900.0))
    right = section.vector("NORMALIZE", section.vector("CROSS_PRODUCT", (0.0, 0.0, 1.0), toward), label="Right")
    place, axes = section.group_input("Point"), [right]
    axes += [section.vector("CROSS_PRODUCT", each, right) for each in (toward, ray)]
    across, height = (_dot(section, axis, place) for axis in axes[:2])
    in_plane = section.vector("SCALE", right, across), section.vector("SCALE", axes[2], height)
    point = section.vector("ADD", *in_plane, label="Point")

    section = Section(tree, "Place on the grid", (-2400.0, 0.0))
    level = section.math("ADD", *(section.math("ABSOLUTE", e) for e in eye[:2]), label="|x| + |y|")
    raised = section.math("MULTIPLY_ADD", level, BELOW, eye[2], label="z, counted from the lowest views")
    total = section.math("ADD", level, section.math("MAXIMUM", raised, 0.0))
    last = section.math("SUBTRACT", section.group_input("Grid"), 1.0, label="Last view")
    half = section.math("MULTIPLY", last, 0.5)
    shares = [section.math(kind, *eye[:2]) for kind in ("ADD", "SUBTRACT")]
    places = [
        section.math("MULTIPLY_ADD", section.math("DIVIDE", share, total), half, half, label=name)
        for share, name in zip(shares, ("Column", "Row"), strict=True)
    ]

    section = Section(tree, "The three views", (-800.0, 0.0))
    corner = section.math("SUBTRACT", last, 1.0, label="Last cell")
    cells = [section.result("ShaderNodeClamp", section.math("FLOOR", place), 0.0, corner) for place in places]
    x, y = (
        section.math("SUBTRACT", place, cell, clamp=True, label="In the cell")
        for place, cell in zip(places, cells, strict=True)
    )
    right = section.math("GREATER_THAN", x, y, label="Right of the diagonal?")
    up = section.math("SUBTRACT", 1.0, right)
    steps = ((0.0, 0.0), (right, up), (1.0, 1.0))
    # Squares of barycentric weights: less of the leaves' texture is lost in the blend.
    near = [
        section.math("POWER", share, 2.0)
        for share in (
            section.math("SUBTRACT", 1.0, section.math("MAXIMUM", x, y)),
            section.math("ABSOLUTE", section.math("SUBTRACT", x, y)),
            section.math("MINIMUM", x, y),
        )
    ]
    squares = section.math("ADD", section.math("ADD", near[0], near[1]), near[2], label="Sum of squares")
    weights = [section.math("DIVIDE", square, squares) for square in near]
    found: list[Socket] = []
    for step, weight in zip(steps, weights, strict=True):
        moved = [section.math("ADD", cell, part) for cell, part in zip(cells, step, strict=True)]
        found += [section.result("ShaderNodeCombineXYZ", *moved, label="Tile"), weight]
    section.node("NodeGroupOutput", ray, point, *found)


def _declare_view(tree: bpy.types.NodeTree) -> None:
    declare(tree, "Tile", "Vector", "Column and row of the view")
    declare(tree, "Point", "Vector", "A point of the ray")
    declare(tree, "Ray", "Vector", "Direction of the ray, of length 1")
    declare(tree, "Height", "Float", "Height of the surface toward the viewer")
    declare(tree, "Extent", "Vector", "Half of the width and of the height of the view's picture")
    declare(tree, "Grid", "Float", "Views along each side of the page")
    declare(tree, "Texels", "Float", "Texels along each side of a view")
    for name in ("UV", "Right", "Up", "Toward"):
        tree.interface.new_socket(name, in_out="OUTPUT", socket_type="NodeSocketVector")


def _find_place(tree: bpy.types.NodeTree) -> None:
    section = Section(tree, "Direction of the view", (-3200.0, 0.0))
    grid = section.group_input("Grid")
    tile = section.node("ShaderNodeSeparateXYZ", section.group_input("Tile")).outputs
    half = section.math("MULTIPLY", section.math("SUBTRACT", grid, 1.0), 0.5)
    column, row = (section.math("SUBTRACT", section.math("DIVIDE", part, half), 1.0) for part in tile[:2])
    x, y = (
        section.math("MULTIPLY", section.math(kind, column, row), 0.5, label=name)
        for kind, name in (("ADD", "x"), ("SUBTRACT", "y"))
    )
    level = section.math("ADD", *(section.math("ABSOLUTE", part) for part in (x, y)), label="|x| + |y|")
    rest = section.math("MAXIMUM", section.math("SUBTRACT", 1.0, level), 0.0)
    z = section.math("MULTIPLY_ADD", level, -BELOW, rest, label="z")
    toward = section.vector("NORMALIZE", section.result("ShaderNodeCombineXYZ", x, y, z), label="Toward the viewer")
    right = section.vector("NORMALIZE", section.vector("CROSS_PRODUCT", (0.0, 0.0, 1.0), toward), label="Right")
    up = section.vector("CROSS_PRODUCT", toward, right, label="Up")

    section = Section(tree, "The ray at the height", (-1200.0, 0.0))
    point, ray = section.group_input("Point"), section.group_input("Ray")
    rise = section.math("SUBTRACT", section.group_input("Height"), _dot(section, toward, point), label="Still to go")
    steps = section.math("DIVIDE", rise, _dot(section, toward, ray), label="Along the ray")
    there = section.vector("ADD", point, section.vector("SCALE", ray, steps), label="Surface")
    flat = section.result("ShaderNodeCombineXYZ", _dot(section, right, there), _dot(section, up, there))
    place = section.vector("DIVIDE", flat, section.group_input("Extent"), label="From −1 to 1")

    section = Section(tree, "Place on the page", (0.0, 0.0))
    share = section.vector("MULTIPLY_ADD", place, (0.5, 0.5, 0.0), (0.5, 0.5, 0.0), label="From 0 to 1")
    border = section.math("DIVIDE", 0.5, section.group_input("Texels"), label="Half of a texel")
    low = section.result("ShaderNodeCombineXYZ", border, border)
    high = section.vector("SUBTRACT", (1.0, 1.0, 0.0), low)
    inside = section.vector("MINIMUM", section.vector("MAXIMUM", share, low), high, label="Inside the view")
    from_below = section.math("SUBTRACT", section.math("SUBTRACT", grid, 1.0), tile[1], label="Row from below")
    corner = section.result("ShaderNodeCombineXYZ", tile[0], from_below)
    sides = section.result("ShaderNodeCombineXYZ", grid, grid, 1.0)
    uv = section.vector("DIVIDE", section.vector("ADD", corner, inside), sides, label="UV")
    section.node("NodeGroupOutput", uv, right, up, toward)
