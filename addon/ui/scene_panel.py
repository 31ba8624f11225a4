"""A scene of many trees, from the sidebar: its settings, the operator that makes it, its panel."""

from __future__ import annotations

from collections.abc import Iterator

import bpy
from bpy.props import FloatProperty, IntProperty, PointerProperty

from ..build.baked_trees import leaf_pruning, level_number, lod_input
from ..build.rollback import removed_on_failure
from ..build.scene_nodes import SceneSettings, add_scene_modifier
from ..build.shared_scene import SharedTrees, levels_shown, shared_trees
from ..pipeline import view_of
from .properties import with_labels

NAME = "Leafcloud Scene"

_DEFAULTS = SceneSettings()


class LeafcloudSceneSettings(bpy.types.PropertyGroup):
    """How the next scene of trees shares its leaves."""

    trees: PointerProperty(
        name="Trees",
        description="Collection of the baked trees and of their copies; empty: all that are visible",
        type=bpy.types.Collection,
    )
    budget: IntProperty(
        name="Triangles",
        description="At most so many are drawn in a frame; 0: no limit",
        default=1_000_000,
        min=0,
        soft_max=100_000_000,
    )
    full_models: FloatProperty(
        name="Full Models",
        description="Of so many trees the loss is linear in the distance; more trees lose more",
        default=_DEFAULTS.full_models,
        min=0.1,
        soft_max=1000.0,
    )
    far: FloatProperty(
        name="Far",
        description="Distance up to which trees count",
        default=_DEFAULTS.far,
        min=0.001,
        subtype="DISTANCE",
    )
    strength: FloatProperty(
        name="Strength",
        description="Share of its leaves that the farthest tree loses at most, beside what its own distance asks for",
        default=_DEFAULTS.strength,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
    )


class LEAFCLOUD_OT_scene(bpy.types.Operator):
    """Draw all baked trees together, the farther the fewer leaves, and never more triangles than the budget"""

    bl_idname = "leafcloud.scene"
    bl_label = "Build Scene"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if context.mode != "OBJECT":
            cls.poll_message_set("Leave Edit Mode first")
            return False
        if not any(level_number(level) == 0 for obj in _visible(context) for level, _ in levels_shown(obj)):
            cls.poll_message_set("No baked tree is visible there: bake one first, or unhide it")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            with removed_on_failure():
                shared = shared_trees(_visible(context), NAME)
                settings = self._settings(context, shared)
                obj = bpy.data.objects.new(NAME, bpy.data.meshes.new(NAME))
                context.scene.collection.objects.link(obj)
                add_scene_modifier(obj, shared.trees, settings)
        except ValueError as error:
            self.report({"ERROR"}, with_labels(str(error)))
            return {"CANCELLED"}
        for source in shared.sources:
            source.hide_render = True
            if source.visible_get():
                source.hide_set(True)
        self.report({"INFO"}, f"{shared.count} trees are drawn by {obj.name}, and their own objects are hidden")
        return {"FINISHED"}

    def _settings(self, context: bpy.types.Context, shared: SharedTrees) -> SceneSettings:
        """Those of the panel, and of the first kind of tree what is one for all."""
        wanted = context.scene.leafcloud_scene
        pixels, view = context.scene.leafcloud.prune_pixels, view_of(context.scene)
        first, *others = (leaf_pruning(leaves, pixels, view) for leaves in shared.leaves)
        name = shared.leaves[0].name
        if any(other != first for other in others):
            self.report({"WARNING"}, f"the trees are of different kinds: all are pruned as {name} is")
        if not first.measured:
            chain = with_labels("bake it with `chain=pruning` or `chain=both` to have them grow as is seen")
            self.report({"WARNING"}, f"pruned leaves of {name} grow by their area alone: {chain}")
        return SceneSettings(
            prune_start=first.start,
            prune_half=first.half,
            growth=first.growth,
            contrast=first.contrast,
            # The node group counts objects, and wood is one.
            full_models=wanted.full_models * len(shared.trees.objects) / shared.count,
            far=wanted.far,
            strength=wanted.strength,
            budget=wanted.budget,
            centre=lod_input(shared.leaves[0], "Centre"),
        )


class LEAFCLOUD_PT_scene(bpy.types.Panel):
    bl_idname = "LEAFCLOUD_PT_scene"
    bl_label = "Scene of Many Trees"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Leafcloud"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        for name in ("trees", "budget", "full_models", "far", "strength"):
            layout.prop(context.scene.leafcloud_scene, name)
        layout.operator("leafcloud.scene")


def _visible(context: bpy.types.Context) -> Iterator[bpy.types.Object]:
    """What may be a tree of the scene."""
    trees = context.scene.leafcloud_scene.trees
    objects = context.view_layer.objects if trees is None else trees.all_objects
    return (obj for obj in objects if obj.visible_get())
