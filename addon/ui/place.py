"""Placed trees in the sidebar: copies of a baked tree that show the level for their own places."""

from __future__ import annotations

import bpy
from bpy.props import IntProperty
from mathutils import Matrix

from ..levels.placed_tree import place_of, placed_tree, tree_group, tree_of
from ..levels.planting import free_place, width_of
from ..levels.root import root_of
from ..mesh.baked_levels import is_placed_tree, record
from ..nodes.laws import LOD_DISTANCE, STAGGER
from ..versions import draw_modifier_input, get_modifier_input, has_modifier_input, set_modifier_input
from ..viewport.labels import length_words
from .job_operator import refuse
from .on_tree import OnTree, active_tree, mode_problem
from .selection import select_only
from .tree_panel import AUTO, draw_figures, level_numbers

_APART = 1.25
"""Distance of a copy from the tree, in widths of the tree."""

_ASSET = "Leafcloud"
"""Tag of the assets, by which the asset browser finds them."""


class LEAFCLOUD_OT_place(OnTree, bpy.types.Operator):
    """Add an object beside the tree that shows it. Copies of it show the level for their own places"""

    bl_idname = "leafcloud.place"
    bl_label = "Place a Copy"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        tree = active_tree(context)
        assert tree is not None, "poll refuses without a tree"
        try:
            group = tree_group(tree)
        except ValueError as error:
            return refuse(self, error)
        obj = placed_tree(f"{tree.name} copy", group)
        obj.matrix_world = place_of(tree)
        copies = [each.location for each in context.scene.objects if is_placed_tree(each) and tree_of(each) == tree]
        obj.location = free_place(obj.location, _APART * width_of(tree), copies)
        context.collection.objects.link(obj)
        select_only(context, [obj])
        away = length_words((obj.location - place_of(tree).translation).length)
        self.report({"INFO"}, f"Placed {obj.name}, {away} beside {tree.name}: it shows the level for its own place")
        return {"FINISHED"}


class LEAFCLOUD_OT_asset(OnTree, bpy.types.Operator):
    """Make an asset of this tree. Each copy from the asset browser shows the level for its own place"""

    bl_idname = "leafcloud.asset"
    bl_label = "Mark as Asset"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        tree = active_tree(context)
        assert tree is not None, "poll refuses without a tree"
        try:
            group = tree_group(tree)
        except ValueError as error:
            return refuse(self, error)
        obj = _asset_of(group)
        if obj is None:
            obj = placed_tree(tree.name, group)
            obj.asset_mark()
        obj.matrix_world = place_of(tree)
        obj.location = (0.0, 0.0, 0.0)
        obj.asset_data.description = "A tree that shows the level of detail for its distance from the camera"
        obj.asset_data.tags.new(_ASSET, skip_if_exists=True)
        if not bpy.app.background:
            obj.asset_generate_preview()
        self.report({"INFO"}, f"{obj.name} is an asset: save the file in a folder of the asset libraries")
        return {"FINISHED"}


def _asset_of(group: bpy.types.NodeTree) -> bpy.types.Object | None:
    """Return the asset that draws the group; None if there is none."""
    assets = (obj for obj in bpy.data.objects if obj.asset_data is not None)
    return next((obj for obj in assets if any(each.node_group == group for each in obj.modifiers)), None)


class LEAFCLOUD_OT_place_instances(bpy.types.Operator):
    """Make the selected collection instances of baked trees show the level for their own places"""

    bl_idname = "leafcloud.place_instances"
    bl_label = "Show Own Levels"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        problem = mode_problem(context)
        if not any(map(instanced_tree, context.selected_objects)):
            problem = "Select collection instances of a baked tree"
        if problem:
            cls.poll_message_set(problem)
        return not problem

    def execute(self, context: bpy.types.Context) -> set[str]:
        instances = [obj for obj in context.selected_objects if instanced_tree(obj) is not None]
        try:
            show_own_levels(instances)
        except ValueError as error:
            return refuse(self, error)
        self.report({"INFO"}, f"Collection instances that show their own levels: {len(instances)}")
        return {"FINISHED"}


def instanced_tree(obj: bpy.types.Object) -> bpy.types.Collection | None:
    """Return the collection of the one baked tree that an object is an instance of; None for any other object."""
    collection = obj.instance_collection if obj.instance_type == "COLLECTION" else None
    is_tree = collection is not None and record(collection) is not None and root_of(collection) is not None
    return collection if is_tree else None


def show_own_levels(instances: list[bpy.types.Object]) -> None:
    """Replace instances of baked trees' collections by placed trees with their names, places and children.

    An instance with animation, constraints or other data that a new object would lack stays, with the placed tree below
    it. Raises `ValueError` for a tree without levels.
    """
    groups: dict[bpy.types.Collection, bpy.types.NodeTree] = {}
    for instance in instances:
        tree = instanced_tree(instance)
        assert tree is not None, "each object is an instance"
        if tree not in groups:
            groups[tree] = tree_group(tree)
        obj = placed_tree(tree.name, groups[tree])
        own = Matrix.Translation(-tree.instance_offset) @ place_of(tree)
        if _is_plain(instance):
            _take_the_place(obj, instance, own)
        else:
            for collection in instance.users_collection:
                collection.objects.link(obj)
            obj.parent, obj.matrix_basis, instance.instance_type = instance, own, "NONE"
            obj.hide_render, obj.hide_viewport = instance.hide_render, instance.hide_viewport


def _is_plain(instance: bpy.types.Object) -> bool:
    """Return whether an instance has no data of its own but its transform, parent and collections."""
    usual = instance.parent_type == "OBJECT" and not (instance.hide_render or instance.hide_viewport)
    moved = any(instance.delta_location) or any(instance.delta_rotation_euler) or set(instance.delta_scale) != {1.0}
    return usual and not moved and instance.animation_data is None and not instance.constraints and not instance.keys()


def _take_the_place(obj: bpy.types.Object, instance: bpy.types.Object, own: Matrix) -> None:
    """Put `obj`, with the matrix `own` relative to the instance, in place of a plain instance, which is removed."""
    obj.parent, obj.matrix_parent_inverse = instance.parent, instance.matrix_parent_inverse
    obj.matrix_basis = instance.matrix_basis @ own
    layers = [layer for layer in bpy.context.scene.view_layers if layer.objects.active == instance]
    name, selected, hidden = instance.name, instance.select_get(), instance.hide_get()
    instance.user_remap(obj)
    bpy.data.objects.remove(instance)
    obj.name = name
    obj.select_set(selected)
    obj.hide_set(hidden)
    for layer in layers:
        layer.objects.active = obj


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
        return obj is not None and obj.select_get() and (is_placed_tree(obj) or instanced_tree(obj) is not None)

    def draw(self, context: bpy.types.Context) -> None:
        layout, obj = self.layout, context.active_object
        if not is_placed_tree(obj):
            column = layout.column(align=True)
            column.label(text="Shows the level for the", icon="INFO")
            column.label(text="place of the original tree", icon="BLANK1")
            layout.operator("leafcloud.place_instances")
            return
        modifier, tree = _modifier_of(obj), tree_of(obj)
        layout.label(text=obj.name, icon="OUTLINER_OB_MESH")
        if tree is not None:
            row, shown = layout.row(align=True), get_modifier_input(modifier, "Level")
            for number in [AUTO, *level_numbers(tree)]:
                text = "Auto" if number == AUTO else str(number)
                row.operator("leafcloud.show_placed_level", text=text, depress=number == shown).level = number
        for name in (LOD_DISTANCE, STAGGER):
            if has_modifier_input(modifier, name):
                draw_modifier_input(layout, modifier, name)
        if tree is not None:
            draw_figures(layout, context, tree)


class LEAFCLOUD_OT_show_placed_level(bpy.types.Operator):
    """Show this level of the selected copies at all distances. Auto shows the level for each distance"""

    bl_idname = "leafcloud.show_placed_level"
    bl_label = "Show Level of a Copy"
    bl_options = {"REGISTER", "UNDO"}

    level: IntProperty(
        name="Level", description="Number of the level. −1: the distance decides", default=AUTO, min=AUTO
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return any(map(is_placed_tree, context.selected_objects))

    def execute(self, context: bpy.types.Context) -> set[str]:
        for obj in filter(is_placed_tree, context.selected_objects):
            set_modifier_input(_modifier_of(obj), "Level", self.level)
        return {"FINISHED"}


def _modifier_of(obj: bpy.types.Object) -> bpy.types.NodesModifier:
    """Return the modifier of a placed tree."""
    return next(each for each in obj.modifiers if each.type == "NODES")
