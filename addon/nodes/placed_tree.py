"""The node group of a placed tree: all levels of a baked tree in one object.

Blender evaluates the modifiers of an object once. So all instances of a collection show the level for the place of the
original. Copies of an object are evaluated one by one: each shows the level for its own place, without the add-on and
without Python. A placed tree is therefore one object. Its modifier applies to every level the same node groups as the
level's own modifiers:

    level n:  mesh → materials that fade → Leafcloud LOD → Leafcloud Wind …  → drawn if Level is −1 or n
    tree:     all levels joined

Only one level is drawn at most distances, and two while they cross-fade; the others end at Leafcloud LOD. Shadow
proxies are left out, because rays see all faces of one object alike: the drawn levels cast the shadows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import bpy

from ..versions import set_source
from .builder import Section
from .laws import LOD_DISTANCE, STAGGER, declare, declare_factor, declare_stagger

AUTO = -1
"""Value of the input Level: the distance decides."""
_ROW = -900.0
_STAGGER = 0.1
"""Largest change of the switch distances of placed trees by their places."""


@dataclass(frozen=True)
class LevelModifier:
    """A modifier of a level: its node group, the values of its inputs by name, and the sources of driven inputs."""

    group: bpy.types.NodeTree
    values: dict[str, Any]
    driven: dict[str, tuple[bpy.types.ID, str]]


@dataclass(frozen=True)
class Part:
    """A level or its trunk.

    source: an object with the mesh and no modifiers. fading: pairs of a material of the mesh and the one that replaces
    it. modifiers: the level's own, the first one first.
    """

    level: int
    source: bpy.types.Object
    fading: tuple[tuple[bpy.types.Material, bpy.types.Material], ...]
    modifiers: tuple[LevelModifier, ...]


def fill_tree_group(tree: bpy.types.NodeTree, parts: Sequence[Part]) -> None:
    """Fill the group with the parts of a tree. Nodes that it had are replaced; its inputs and their values stay."""
    _add_interface(tree)
    tree.is_modifier = True
    tree.animation_data_clear()
    tree.nodes.clear()
    joined, last = tree.nodes.new("GeometryNodeJoinGeometry"), max(part.level for part in parts)
    for row, part in enumerate(parts):
        section = Section(tree, part.source.name, (0.0, _ROW * row))
        tree.links.new(_drawn(section, part.level, last, _geometry(section, part)), joined.inputs[0])
    joined.location = (2200.0, 0.0)
    output = tree.nodes.new("NodeGroupOutput")
    output.location = (2400.0, 0.0)
    tree.links.new(joined.outputs[0], output.inputs[0])


def _add_interface(tree: bpy.types.NodeTree) -> None:
    """Declare the inputs that the group lacks: one of an earlier version has no Stagger."""
    names = {item.name for item in tree.interface.items_tree}
    if not names:
        tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
        declare_factor(tree)
        level = "Level that is drawn at all distances. −1: the distance decides"
        declare(tree, "Level", "Int", level, default_value=AUTO, min_value=AUTO)
    if STAGGER not in names:
        declare_stagger(tree, _STAGGER)


def _geometry(section: Section, part: Part) -> bpy.types.NodeSocket:
    """Return the level's geometry after its modifiers."""
    info = section.node("GeometryNodeObjectInfo", part.source, label="Mesh", transform_space="ORIGINAL")
    geometry = info.outputs["Geometry"]
    for old, new in part.fading:
        geometry = section.result("GeometryNodeReplaceMaterial", geometry, old, new, label="Material that fades")
    for modifier in part.modifiers:
        geometry = _applied(section, modifier, geometry)
    return geometry


def _applied(section: Section, modifier: LevelModifier, geometry: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    """Return the geometry after one modifier."""
    node = section.node("GeometryNodeGroup", label=modifier.group.name, node_tree=modifier.group)
    tree = node.id_data
    for name, value in modifier.values.items():
        node.inputs[name].default_value = value
    for name, (source, path) in modifier.driven.items():
        place = list(node.inputs).index(node.inputs[name])
        driven = tree.driver_add(f'nodes["{node.name}"].inputs[{place}].default_value')
        set_source(driven.driver, source, path)
    tree.links.new(geometry, node.inputs[0])
    for shared in (LOD_DISTANCE, STAGGER):
        if shared in node.inputs:
            tree.links.new(section.group_input(shared), node.inputs[shared])
    if "Manual" in node.inputs:
        by_hand = section.compare_integers(section.group_input("Level"), "GREATER_EQUAL", 0, label="By hand?")
        tree.links.new(by_hand, node.inputs["Manual"])
    return node.outputs[0]


def _drawn(section: Section, number: int, last: int, geometry: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    """Return the geometry of level `number`, or nothing if the input Level is another one."""
    level = _chosen(section, last)
    free = section.compare_integers(level, "LESS_THAN", 0, label="By distance")
    this = section.compare_integers(level, "EQUAL", number, label="This level")
    wanted = section.logic(free, "OR", this)
    return section.switch("GEOMETRY", wanted, None, geometry, label="Nothing of other levels")


def _chosen(section: Section, last: int) -> bpy.types.NodeSocket:
    """Return the input Level, at most the last level: a new bake may have fewer."""
    return section.math("MINIMUM", section.group_input("Level"), float(last), label="Level")
