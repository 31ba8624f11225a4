"""The forest in the sidebar: its settings, the operator that plants it, its panel."""

from __future__ import annotations

import bpy
from bpy.props import FloatProperty, PointerProperty

from ..bake.pipeline import view_of
from ..levels.baked_trees import LeafPruning, baked_tree, leaf_pruning, tree_collections
from ..levels.forest import Forest, build_forest
from ..levels.rollback import removed_on_failure
from ..mesh.baked_levels import level_number
from ..nodes.forest import GROUP_NAME, ForestSettings
from ..nodes.laws import NEVER
from .job_operator import BUSY, running
from .properties import with_labels

_DEFAULTS = ForestSettings(())
_WITH_POINTS = ("MESH", "CURVE", "CURVES", "POINTCLOUD")


class LeafcloudForestSettings(bpy.types.PropertyGroup):
    """Settings of the next forest."""

    tree: PointerProperty(
        name="Tree",
        description="Collection of a baked tree. Empty: the only baked tree in the scene",
        type=bpy.types.Collection,
    )
    points: PointerProperty(
        name="Points",
        description="Object with one point per tree. The trees replace its own geometry. Empty: the active object",
        type=bpy.types.Object,
    )
    width: FloatProperty(
        name="Dither",
        description="Trees switch levels at random distances up to this fraction beyond the switch distance. Larger "
        "hides the switches better and draws finer levels farther away",
        default=_DEFAULTS.width,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
    )
    far: FloatProperty(
        name="Far",
        description="Maximum distance at which trees are drawn. 0: no limit",
        default=0.0,
        min=0.0,
        subtype="DISTANCE",
    )


class LEAFCLOUD_OT_forest(bpy.types.Operator):
    """Plant a baked tree on every point of an object. Each tree shows the level for its distance from the camera"""

    bl_idname = "leafcloud.forest"
    bl_label = "Plant Forest"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        problem = _problem(context)
        if problem:
            cls.poll_message_set(problem)
        return not problem

    def execute(self, context: bpy.types.Context) -> set[str]:
        wanted, points = context.scene.leafcloud_forest, _points(context)
        assert points is not None, "poll refuses without points"
        try:
            with removed_on_failure():
                forest = _build(context, _trees(context)[0])
                before = [each for each in points.modifiers if each.name.startswith(GROUP_NAME)]
                planted = forest.plant(points, width=wanted.width, far=wanted.far or NEVER)
        except ValueError as error:
            self.report({"ERROR"}, with_labels(str(error)))
            return {"CANCELLED"}
        for modifier in before:
            points.modifiers.remove(modifier)
        planted.name = GROUP_NAME
        self.report({"INFO"}, f"Planted {points.name} with {len(forest.distances) + 1} variants")
        return {"FINISHED"}


class LEAFCLOUD_PT_forest(bpy.types.Panel):
    bl_idname = "LEAFCLOUD_PT_forest"
    bl_label = "Forest"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Leafcloud"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        for name in ("tree", "points", "width", "far"):
            layout.prop(context.scene.leafcloud_forest, name)
        layout.operator("leafcloud.forest")


def _problem(context: bpy.types.Context) -> str:
    """Return why no forest can be planted now, with the remedy; empty if one can."""
    trees, points = _trees(context), _points(context)
    if context.mode != "OBJECT":
        return "Switch to Object Mode first"
    if running:
        return BUSY
    if not trees:
        return "No baked tree is in the scene: bake one first"
    if len(trees) > 1:
        return f"Choose the tree: {', '.join(tree.name for tree in trees[:4])} …"
    if points is None:
        return "Choose the object with the points, or make it active"
    if points.type not in _WITH_POINTS:
        return f"{points.name} has no points: choose a mesh, a curve or a point cloud"
    if level_number(points) is not None or level_number(points.parent or points) is not None:
        return f"{points.name} belongs to a baked tree: choose the object with the points"
    return ""


def _trees(context: bpy.types.Context) -> tuple[bpy.types.Collection, ...]:
    chosen = context.scene.leafcloud_forest.tree
    return tree_collections(context.scene.objects) if chosen is None else (chosen,)


def _points(context: bpy.types.Context) -> bpy.types.Object | None:
    return context.scene.leafcloud_forest.points or context.view_layer.objects.active


def _build(context: bpy.types.Context, collection: bpy.types.Collection) -> Forest:
    """Build the forest of a tree, with pruned variants if the tree was baked for pruning."""
    tree = baked_tree(collection)
    leaves, pruning = tree.levels[0].object, LeafPruning(NEVER)
    if "leaf_rank" in leaves.data.attributes:
        pruning = leaf_pruning(leaves, context.scene.leafcloud.prune_pixels, view_of(context.scene))
    return build_forest(
        tree.levels,
        f"{collection.name}_forest",
        switch_distances=tree.switch_distances,
        centre=tree.centre,
        prune_start=pruning.start * tree.scale if pruning.measured else NEVER,
        prune_half=pruning.half,
        growth=pruning.growth,
    )
