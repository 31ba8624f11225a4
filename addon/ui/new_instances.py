"""Placed trees in place of new collection instances: in the interface, each instance of a baked tree that an artist
adds soon shows the level for its own place.

An instance is offered once: one that is still or again an instance later, as after an undo, stays. So do those that a
file already has, and instances of linked collections: their own file should decide.
"""

from __future__ import annotations

import bpy

from ..levels.placed_tree import is_placeable
from .handlers import Handlers
from .on_tree import mode_problem
from .place import LEAFCLOUD_OT_place_instances, instanced_tree, show_own_levels
from .preferences import preference

_DELAY, _BUSY = 0.1, 0.5
"""Seconds until instances are replaced, and until the next try while Blender is busy."""

_known: set[int] = set()
"""Session identifiers of the instances that were offered, or that the file had."""


def _on_change(scene: bpy.types.Scene, graph: bpy.types.Depsgraph) -> None:
    """Offer new instances soon. A handler may not change the scene that Blender evaluates, but a timer may."""
    if bpy.app.background or bpy.app.timers.is_registered(_offer):
        return
    changed = (update.id.original for update in graph.updates if isinstance(update.id, bpy.types.Object))
    if any(obj.session_uid not in _known and _is_ours(obj) for obj in changed):
        bpy.app.timers.register(_offer, first_interval=_DELAY)


def _on_another_state(*_: object) -> None:
    """Know all instances of the file, as after loading, undo and redo: none of them is new."""
    stop_offers()
    _know()


def _know() -> None:
    _known.update(obj.session_uid for obj in bpy.data.objects if obj.instance_type == "COLLECTION")


HANDLERS: Handlers = (
    ("depsgraph_update_post", _on_change),
    ("load_post", _on_another_state),
    ("undo_post", _on_another_state),
    ("redo_post", _on_another_state),
)


def stop_offers() -> None:
    """Forget instances that wait, as before the extension is disabled."""
    if bpy.app.timers.is_registered(_offer):
        bpy.app.timers.unregister(_offer)


def _offer() -> float | None:
    """Timer: replace the new instances, as one step for undo. Wait while Blender is busy."""
    context = bpy.context
    if mode_problem(context) or any(window.modal_operators for window in context.window_manager.windows):
        return _BUSY
    new = [obj for obj in context.view_layer.objects if obj.session_uid not in _known and _is_ours(obj)]
    _know()
    if new and preference("place_instances"):
        show_own_levels(new)
        bpy.ops.ed.undo_push(message=LEAFCLOUD_OT_place_instances.bl_label)
    return None


def _is_ours(obj: bpy.types.Object) -> bool:
    tree = instanced_tree(obj)
    return tree is not None and tree.library is None and obj.library is None and is_placeable(tree)
