"""The scene of many trees in the sidebar: its settings, the operator that builds it, its panel."""

from __future__ import annotations

from collections.abc import Collection, Iterator

import bpy
from bpy.props import FloatProperty, IntProperty, PointerProperty

from ..bake.pipeline import view_of
from ..levels.baked_trees import leaf_pruning, lod_input
from ..levels.rollback import removed_on_failure
from ..levels.shared_scene import SharedTrees, levels_shown, shared_trees
from ..mesh.baked_levels import level_number
from ..nodes.scene import SceneSettings, add_scene_modifier
from ..versions import get_modifier_input
from .job_operator import BUSY, running
from .properties import with_labels

NAME = "Leafcloud Scene"

_REPLACED = "leafcloud_replaced"
"""Custom property of the objects that a scene hides: the name of the scene's object. A later scene of the same trees
replaces it."""

_DEFAULTS = SceneSettings()


class LeafcloudSceneSettings(bpy.types.PropertyGroup):
    """Settings of the next scene of many trees."""

    trees: PointerProperty(
        name="Trees",
        description="Collection of the baked trees and their copies. Empty: all visible baked trees",
        type=bpy.types.Collection,
    )
    budget: IntProperty(
        name="Triangles",
        description="Maximum number of triangles drawn per frame. Prunes leaves to stay within it, but never trunks. "
        "0: no limit",
        default=1_000_000,
        min=0,
        soft_max=100_000_000,
    )
    full_models: FloatProperty(
        name="Full Models",
        description="Tree count at which pruning is linear in distance. Larger scenes prune more",
        default=_DEFAULTS.full_models,
        min=0.1,
        soft_max=1000.0,
    )
    far: FloatProperty(
        name="Far",
        description="Distance up to which trees count for the shared pruning",
        default=_DEFAULTS.far,
        min=0.001,
        subtype="DISTANCE",
    )
    strength: FloatProperty(
        name="Strength",
        description="Greatest fraction that the farthest tree loses of the leaves that pruning by distance has left",
        default=_DEFAULTS.strength,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
    )


class LEAFCLOUD_OT_scene(bpy.types.Operator):
    """Draw all baked trees with one object. Farther trees get fewer leaves, to keep the triangles within the budget.
    Replaces an earlier scene"""

    bl_idname = "leafcloud.scene"
    bl_label = "Build Scene"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if context.mode != "OBJECT":
            cls.poll_message_set("Switch to Object Mode first")
            return False
        if running:
            cls.poll_message_set(BUSY)
            return False
        if not any(level_number(level) == 0 for obj in _trees(context) for level, _ in levels_shown(obj)):
            cls.poll_message_set("No baked tree is visible: bake one first, or unhide it")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            with removed_on_failure():
                shared = shared_trees(_trees(context), NAME)
                settings = self._settings(context, shared)
                obj = bpy.data.objects.new(NAME, bpy.data.meshes.new(NAME))
                context.scene.collection.objects.link(obj)
                add_scene_modifier(obj, shared.trees, settings)
        except ValueError as error:
            self.report({"ERROR"}, with_labels(str(error)))
            return {"CANCELLED"}
        _remove_scenes(context, {source[_REPLACED] for source in shared.sources if _REPLACED in source})
        obj.name = NAME
        for source in shared.sources:
            source[_REPLACED] = obj.name
            source.hide_render = True
            if source.visible_get():
                source.hide_set(True)
        self.report({"INFO"}, f"{obj.name} draws {shared.count} trees; their own objects are hidden")
        return {"FINISHED"}

    def _settings(self, context: bpy.types.Context, shared: SharedTrees) -> SceneSettings:
        """Return the panel's settings with the pruning settings of the first kind of tree, which apply to all trees.

        Warn if the kinds of trees differ, or if the bake did not measure the growth of pruned leaves.
        """
        wanted = context.scene.leafcloud_scene
        pixels, view = context.scene.leafcloud.prune_pixels, view_of(context.scene)
        first, *others = (leaf_pruning(leaves, pixels, view) for leaves in shared.leaves)
        name = shared.leaves[0].name
        if any(other != first for other in others):
            self.report({"WARNING"}, f"the trees have different pruning settings: all are pruned like {name}")
        if not first.measured:
            chain = with_labels("bake it with `chain=pruning` or `chain=both` to measure their growth")
            self.report({"WARNING"}, f"pruned leaves of {name} grow by their area alone and look too dense: {chain}")
        return SceneSettings(
            prune_start=first.start,
            prune_half=first.half,
            growth=first.growth,
            contrast=first.contrast,
            # The node group counts objects, and a trunk is an object of its own.
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


def _trees(context: bpy.types.Context) -> Iterator[bpy.types.Object]:
    """Yield the objects that may be trees of the scene: visible ones, and those that an earlier scene hides."""
    trees = context.scene.leafcloud_scene.trees
    objects = context.view_layer.objects if trees is None else trees.all_objects
    return (obj for obj in objects if obj.visible_get() or (_REPLACED in obj and obj.hide_get()))


def _remove_scenes(context: bpy.types.Context, names: Collection[str]) -> None:
    """Remove the objects of earlier scenes, with their copies of the trees, and show the trees that they hid."""
    for source in [obj for obj in context.view_layer.objects if obj.get(_REPLACED) in names]:
        del source[_REPLACED]
        source.hide_render = False
        source.hide_set(False)
    for obj in [obj for obj in context.scene.objects if obj.name in names and NAME in obj.modifiers]:
        drawn = get_modifier_input(obj.modifiers[NAME], "Trees")
        copies = list(drawn.objects) if drawn is not None and drawn.users <= 1 else []
        bpy.data.batch_remove([obj, obj.data, *copies, *([drawn] if copies else [])])
