"""Materials without what only Blender's node groups feed, while files are written.

Exporters read an image that is linked to Base Color, not one behind a Mix node; and leaves and wood have the artist's
materials in files, though Blender shows copies of them that fade, or read each leaf's own random number.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import bpy

from ..build.contrast import CONTRAST_NODE
from ..build.levels import BuiltLevel


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
