"""Materials without what only Blender's node groups feed, and without what exporters get lost in, while files are
written.

Exporters read an image that is linked to Base Color, not one behind a Mix node; and leaves and wood have the artist's
materials in files, though Blender shows copies of them that fade, or read each leaf's own random number.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import bpy

from ..build.contrast import CONTRAST_NODE
from ..build.levels import BuiltLevel
from ..scene.node_links import Links, tangled_inputs, trees_of


@contextmanager
def plain_colors(levels: Sequence[BuiltLevel]) -> Iterator[None]:
    """Links what lies under each contrast node of LOD 0's materials past it."""
    materials = dict.fromkeys(material for material in levels[0].object.data.materials if material is not None)
    passed = [pair for material in materials if material.node_tree is not None for pair in _pass(material.node_tree)]
    try:
        yield
    finally:
        for tree, mixed, socket in passed:
            tree.links.new(mixed, socket)


@contextmanager
def untangled(levels: Sequence[BuiltLevel]) -> Iterator[None]:
    """Takes off links that Blender's glTF exporter would follow without end: those of cycles, which mean nothing, and
    those of `tangled_inputs`. These get the first image behind them, which is all that it reads there."""
    objects = [obj for level in levels for obj in (level.object, level.wood) if obj is not None]
    materials = dict.fromkeys(material for obj in objects for material in obj.data.materials if material is not None)
    trees = [material.node_tree for material in materials if material.node_tree is not None]
    taken = [pair for tree in dict.fromkeys(each for tree in trees for each in trees_of(tree)) for pair in _cut(tree)]
    try:
        yield
    finally:
        for source, target in taken:
            target.id_data.links.new(source, target)


def _cut(tree: bpy.types.NodeTree) -> list[tuple[bpy.types.NodeSocket, bpy.types.NodeSocket]]:
    """Takes off a tree's links, and gives their ends."""
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
    """The output of the first image in the same tree on the ways behind an input."""
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
    """Shows leaves and wood in the materials of their meshes, instead of the object's own."""
    objects = [obj for level in levels for obj in (level.object, level.wood) if obj is not None]
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
