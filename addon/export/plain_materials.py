"""Simplified materials for Blender's glTF exporter, used only while files are written.

The exporter reads an image that is linked to Base Color, but not one behind a Mix node. Leaves and trunk have the
artist's materials in files; Blender shows copies of these that fade, or that read a random number per leaf.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import bpy

from ..levels.building import BuiltLevel
from ..levels.contrast import CONTRAST_NODE
from ..material.node_links import Links, tangled_inputs, trees_of


@contextmanager
def plain_colors(levels: Sequence[BuiltLevel]) -> Iterator[None]:
    """Bypass the contrast nodes in LOD 0's materials while the block runs."""
    materials = dict.fromkeys(material for material in levels[0].object.data.materials if material is not None)
    passed = [pair for material in materials if material.node_tree is not None for pair in _pass(material.node_tree)]
    try:
        yield
    finally:
        for tree, mixed, socket in passed:
            tree.links.new(mixed, socket)


@contextmanager
def untangled(levels: Sequence[BuiltLevel]) -> Iterator[None]:
    """Remove links that Blender's glTF exporter would follow for minutes or forever, while the block runs.

    These are the invalid links of cycles, and links to `tangled_inputs`. A tangled input is linked to the first image
    behind it instead, which is all that the exporter reads there.
    """
    objects = [obj for level in levels for obj in (level.object, level.trunk) if obj is not None]
    materials = dict.fromkeys(material for obj in objects for material in obj.data.materials if material is not None)
    trees = [material.node_tree for material in materials if material.node_tree is not None]
    taken = [pair for tree in dict.fromkeys(each for tree in trees for each in trees_of(tree)) for pair in _cut(tree)]
    try:
        yield
    finally:
        for source, target in taken:
            target.id_data.links.new(source, target)


def _cut(tree: bpy.types.NodeTree) -> list[tuple[bpy.types.NodeSocket, bpy.types.NodeSocket]]:
    """Remove a tree's invalid links, replace its tangled links, and return the ends of all former links."""
    tangled = set(tangled_inputs(tree))
    images = {socket: _first_image(socket) for socket in tangled}
    links = [link for link in tree.links if not link.is_valid or link.to_socket in tangled]
    taken = [(link.from_socket, link.to_socket) for link in links]
    for link in links:
        tree.links.remove(link)
    for socket, image in images.items():
        if image is not None:
            tree.links.new(image, socket)
    return taken


def _first_image(target: bpy.types.NodeSocket) -> bpy.types.NodeSocket | None:
    """Return the output of the first image node, in the same tree, that leads to an input; None without one."""
    links, seen, waiting = Links(), set(), [target]
    while waiting:
        link = links.to(waiting.pop())
        if link is None or link.from_socket in seen:
            continue
        seen.add(link.from_socket)
        if link.from_node.type == "TEX_IMAGE":
            return link.from_socket
        waiting += reversed(link.from_node.inputs)
    return None


@contextmanager
def materials_of_meshes(levels: Sequence[BuiltLevel]) -> Iterator[None]:
    """Use the materials of the leaf and trunk meshes instead of their objects' while the block runs."""
    objects = [obj for level in levels for obj in (level.object, level.trunk) if obj is not None]
    own = [slot for obj in objects for slot in obj.material_slots if slot.link == "OBJECT"]
    for slot in own:
        slot.link = "DATA"
    try:
        yield
    finally:
        for slot in own:
            slot.link = "OBJECT"


def _pass(tree: bpy.types.NodeTree) -> list[tuple[bpy.types.NodeTree, bpy.types.NodeSocket, bpy.types.NodeSocket]]:
    passed = []
    for node in [node for node in tree.nodes if node.name.startswith(CONTRAST_NODE)]:
        mixed = next(output for output in node.outputs if output.enabled)
        own = next(socket for socket in node.inputs if socket.identifier == "A_Color")
        for link in list(mixed.links):
            socket = link.to_socket
            passed.append((tree, mixed, socket))
            tree.links.remove(link)
            if own.is_linked:
                tree.links.new(own.links[0].from_socket, socket)
    return passed
