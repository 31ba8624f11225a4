"""Placed trees in the sidebar: copies of a baked tree that show the level for their own places."""

from __future__ import annotations

import bpy
from mathutils import Matrix

from ..levels.placed_tree import place_of, placed_tree
from ..levels.rollback import removed_on_failure
from ..mesh.baked_levels import is_placed_tree, record
from ..nodes.laws import LOD_DISTANCE
from ..versions import draw_modifier_input
from .on_tree import OnTree, active_tree, mode_problem
from .preferences import preference

_ASSET = "Leafcloud"
"""Tag of the assets, by which the asset browser finds them."""


class LEAFCLOUD_OT_place(OnTree, bpy.types.Operator):
    """Add an object at the 3D cursor that shows this tree. Copies of it show the level for their own places"""

    bl_idname = "leafcloud.place"
    bl_label = "Place a Copy"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        tree = active_tree(context)
        assert tree is not None, "poll refuses without a tree"
        with removed_on_failure():
            obj = placed_tree(tree)
        obj.matrix_world = place_of(tree)
        obj.location = context.scene.cursor.location
        context.collection.objects.link(obj)
        for other in context.selected_objects:
            other.select_set(False)
        obj.select_set(True)
        context.view_layer.objects.active = obj
        return {"FINISHED"}


class LEAFCLOUD_OT_asset(OnTree, bpy.types.Operator):
    """Make an asset of this tree. Each copy from the asset browser shows the level for its own place"""

    bl_idname = "leafcloud.asset"
    bl_label = "Mark as Asset"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        tree = active_tree(context)
        assert tree is not None, "poll refuses without a tree"
        with removed_on_failure():
            obj = placed_tree(tree)
        obj.matrix_world = place_of(tree)
        obj.location = (0.0, 0.0, 0.0)
        obj.asset_mark()
        obj.asset_data.description = "A tree that shows the level of detail for its distance from the camera"
        obj.asset_data.tags.new(_ASSET, skip_if_exists=True)
        if not bpy.app.background:
            obj.asset_generate_preview()
        self.report({"INFO"}, f"{obj.name} is an asset: save the file in a folder of the asset libraries")
        return {"FINISHED"}


class LEAFCLOUD_OT_place_instances(bpy.types.Operator):
    """Make the selected collection instances of baked trees show the level for their own places"""

    bl_idname = "leafcloud.place_instances"
    bl_label = "Show Own Levels"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        problem = mode_problem(context)
        if not any(map(_instanced, context.selected_objects)):
            problem = "Select collection instances of a baked tree"
        if problem:
            cls.poll_message_set(problem)
        return not problem

    def execute(self, context: bpy.types.Context) -> set[str]:
        instances = [obj for obj in context.selected_objects if _instanced(obj) is not None]
        for instance in instances:
            show_own_level(instance)
        self.report({"INFO"}, f"{len(instances)} instances show their own levels")
        return {"FINISHED"}


def show_own_level(instance: bpy.types.Object) -> None:
    """Replace an instance of a baked tree's collection by a placed tree, which has its name, place and children.

    An animated instance stays, with the placed tree below it.
    """
    tree = _instanced(instance)
    assert tree is not None, "the object is an instance"
    with removed_on_failure():
        obj = placed_tree(tree)
    own = Matrix.Translation(-tree.instance_offset) @ place_of(tree)
    if instance.animation_data is not None:
        for collection in instance.users_collection:
            collection.objects.link(obj)
        obj.parent, obj.matrix_basis, instance.instance_type = instance, own, "NONE"
        return
    obj.parent, obj.parent_type, obj.parent_bone = instance.parent, instance.parent_type, instance.parent_bone
    obj.matrix_parent_inverse = instance.matrix_parent_inverse
    obj.matrix_basis = instance.matrix_basis @ own
    was_selected = [layer.objects.active == instance for layer in bpy.context.scene.view_layers], instance.select_get()
    name = instance.name
    instance.user_remap(obj)
    bpy.data.objects.remove(instance)
    obj.name = name
    obj.select_set(was_selected[1])
    for layer, was_active in zip(bpy.context.scene.view_layers, was_selected[0], strict=True):
        if was_active:
            layer.objects.active = obj


def place_new_instances(scene: bpy.types.Scene, graph: bpy.types.Depsgraph) -> None:
    """Handler: soon after an instance of a baked tree's collection appears or changes, make it show its own level.

    Only in Blender's interface. A handler may not change the scene that Blender evaluates, but a timer may.
    """
    if bpy.app.background or not preference("place_instances") or bpy.app.timers.is_registered(_place_all):
        return
    changed = (update.id for update in graph.updates)
    if any(isinstance(each, bpy.types.Object) and _instanced(each.original) is not None for each in changed):
        bpy.app.timers.register(_place_all, first_interval=0.1)


def _place_all() -> float | None:
    """Timer: replace all instances of baked trees in the scene, as one step for undo. Wait while Blender is busy."""
    context = bpy.context
    if mode_problem(context) or any(window.modal_operators for window in context.window_manager.windows):
        return 0.5
    instances = [obj for obj in context.scene.objects if _instanced(obj) is not None and obj.library is None]
    for instance in instances:
        show_own_level(instance)
    if instances:
        bpy.ops.ed.undo_push(message=LEAFCLOUD_OT_place_instances.bl_label)
    return None


class LEAFCLOUD_PT_place(bpy.types.Panel):
    """The panel of a placed tree, and of a collection instance, which shows the level of another place."""

    bl_idname = "LEAFCLOUD_PT_place"
    bl_label = "Placed Tree"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Leafcloud"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        obj = context.active_object
        return obj is not None and obj.select_get() and (is_placed_tree(obj) or _instanced(obj) is not None)

    def draw(self, context: bpy.types.Context) -> None:
        layout, obj = self.layout, context.active_object
        layout.use_property_split = True
        layout.use_property_decorate = False
        if not is_placed_tree(obj):
            column = layout.column(align=True)
            column.label(text="Shows the level for the", icon="INFO")
            column.label(text="place of the original tree", icon="BLANK1")
            layout.operator("leafcloud.place_instances")
            return
        modifier = next(each for each in obj.modifiers if each.type == "NODES")
        draw_modifier_input(layout, modifier, LOD_DISTANCE)
        draw_modifier_input(layout, modifier, "Level", text="Level (−1: Auto)")


def _instanced(obj: bpy.types.Object) -> bpy.types.Collection | None:
    """Return the collection of the baked tree that an object is an instance of; None for any other object."""
    collection = obj.instance_collection if obj.instance_type == "COLLECTION" else None
    return collection if collection is not None and record(collection) is not None else None
