"""The node group *Leafcloud Eye*: the object from which levels are seen.

It is the scene's active camera in renders. In 3D views it is an object at the place of the view, which the extension
moves (`viewport.eye`), because nodes cannot know that place. Where nobody moves it, as without the extension, in files
and in views through the camera, it is the camera there, too.
"""

from __future__ import annotations

from collections.abc import Iterator

import bpy
from mathutils import Vector

from .builder import Section

GROUP_NAME = "Leafcloud Eye"

LAYOUT_KEY = "leafcloud_eye_layout"
LAYOUT = 1

_EYE = "leafcloud_eye"
"""The custom property of the object at the place of the view."""
_FOLLOWS, _CHOICE = "Follows the view", "Seen from"
"""Names of the nodes that `look_from` changes."""


def fill_eye(tree: bpy.types.NodeTree) -> None:
    """Fill the group. Its output is the object."""
    tree.is_modifier = False
    tree.interface.new_socket("Object", in_out="OUTPUT", socket_type="NodeSocketObject")
    section = Section(tree, "The view or the camera", (0.0, 0.0))
    camera = section.result("GeometryNodeInputActiveCamera")
    follows = section.node("FunctionNodeBooleanMath", section.result("GeometryNodeIsViewport"), operation="AND")
    follows.name = follows.label = _FOLLOWS
    follows.inputs[1].default_value = False
    choice = section.node("GeometryNodeSwitch", follows.outputs[0], camera, input_type="OBJECT")
    choice.name = choice.label = _CHOICE
    section.node("NodeGroupOutput", next(socket for socket in choice.outputs if socket.enabled))


def eye_groups() -> list[bpy.types.NodeTree]:
    """Return the groups of this file. Linked ones take no object of this file, so linked trees follow the camera."""
    own = [tree for tree in bpy.data.node_groups if tree.library is None and LAYOUT_KEY in tree]
    return [tree for tree in own if _FOLLOWS in tree.nodes and _CHOICE in tree.nodes]


def look_from(place: Vector | None) -> None:
    """Show the levels in 3D views as seen from a place in the world; None: from the scene's camera."""
    if place is None:
        for follows, _ in _inputs():
            if follows.default_value:
                follows.default_value = False
        return
    eye = _eye() or _new_eye()
    if eye.location != place:
        eye.location = place
    for follows, choice in _inputs():
        if choice.default_value != eye:
            choice.default_value = eye
        if not follows.default_value:
            follows.default_value = True


def place_of_eye() -> Vector | None:
    """Return the place from which 3D views see the levels; None for the camera's."""
    eye = _eye()
    is_used = any(follows.default_value and choice.default_value == eye for follows, choice in _inputs())
    return None if eye is None or not is_used else eye.location.copy()


def forget_view() -> None:
    """Let the camera decide, and leave nothing of the view in the file."""
    look_from(None)
    for _, choice in _inputs():
        choice.default_value = None
    if (eye := _eye()) is not None:
        bpy.data.objects.remove(eye)


def _inputs() -> Iterator[tuple[bpy.types.NodeSocket, bpy.types.NodeSocket]]:
    """Return the inputs that decide whether the view is followed, and by which object, of each group."""
    for tree in eye_groups():
        choice = tree.nodes[_CHOICE].inputs
        yield tree.nodes[_FOLLOWS].inputs[1], next(each for each in choice if each.enabled and each.name == "True")


def _eye() -> bpy.types.Object | None:
    return next((obj for obj in bpy.data.objects if obj.library is None and _EYE in obj), None)


def _new_eye() -> bpy.types.Object:
    eye = bpy.data.objects.new(GROUP_NAME, None)
    eye[_EYE] = True
    return eye
