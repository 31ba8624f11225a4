"""The forest in the sidebar: its settings, the operator that plants it, its panel."""

from __future__ import annotations

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from ..bake.pipeline import view_of
from ..levels.baked_trees import LeafPruning, baked_tree, leaf_pruning, tree_collections
from ..levels.forest import Forest, build_forest, remove_forests
from ..levels.planting import apply_scale, area_of, is_ground, is_scaled, may_apply_scale, usual_density, width_of
from ..levels.rollback import removed_on_failure
from ..levels.root import lod_factor, root_of
from ..mesh.baked_levels import level_number
from ..nodes.forest import ForestSettings
from ..nodes.laws import LOD_DISTANCE, NEVER
from ..nodes.points import GROUP_NAME as POINTS_NAME
from ..nodes.points import PointSettings, add_points_modifier
from ..versions import drive_modifier_input
from ..viewport.labels import length_words
from .job_operator import BUSY, running
from .properties import with_labels
from .rendering import draw_faults
from .wrapped import add_text

_DEFAULTS, _POINTS = ForestSettings(()), PointSettings(smallest=0.8, largest=1.2)
_measured: list[tuple[object, float]] = []
"""The last measured mesh and its area, or empty: a panel asks for it with each drawing."""

_WITH_POINTS = ("MESH", "CURVE", "CURVES", "POINTCLOUD")


class LeafcloudForestSettings(bpy.types.PropertyGroup):
    """Settings of the next forest."""

    tree: PointerProperty(
        name="Tree",
        description="Collection of a baked tree. Empty: all baked trees in the scene, mixed at random",
        type=bpy.types.Collection,
    )
    points: PointerProperty(
        name="Points",
        description="Object with one point or instance per tree, or the ground to scatter trees on. Empty: the active "
        "object",
        type=bpy.types.Object,
    )
    on: EnumProperty(
        name="On",
        description="Where trees stand",
        items=(
            ("auto", "Auto", "On the object's faces, or on its points and instances if it has no faces or instances"),
            ("faces", "Faces", "Scattered on the object's faces"),
            ("points", "Points", "A tree on each point or instance of the object"),
        ),
    )
    density: FloatProperty(
        name="Density",
        description="Trees per square unit of the faces. 0: as dense as the trees are wide",
        default=_POINTS.density,
        min=0.0,
        soft_max=1.0,
        precision=4,
    )
    mask: StringProperty(
        name="Mask",
        description="Vertex group or attribute of the object, from 0 to 1, that the density is multiplied by",
    )
    slope: FloatProperty(
        name="Slope",
        description="Steepest slope on which trees are scattered",
        default=_POINTS.slope,
        min=0.0,
        max=_POINTS.slope,
        subtype="ANGLE",
    )
    turn: FloatProperty(
        name="Turn",
        description="Random turn of each tree about its own axis, as a fraction of a full turn",
        default=_POINTS.turn,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
    )
    smallest: FloatProperty(
        name="Scale", description="Scale of the smallest trees", default=_POINTS.smallest, min=0.001, soft_max=10.0
    )
    largest: FloatProperty(
        name="to", description="Scale of the largest trees", default=_POINTS.largest, min=0.001, soft_max=10.0
    )
    seed: IntProperty(
        name="Seed", description="Start of all random numbers. Another one gives another forest", default=0, min=0
    )
    ground: BoolProperty(
        name="Ground", description="Keep the object's own meshes and curves visible", default=_POINTS.ground
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
    """Plant baked trees on an object. Each tree shows the level for its distance from the camera"""

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
                trees = _trees(context)
                forests = [_build(context, tree) for tree in trees]
        except ValueError as error:
            self.report({"ERROR"}, with_labels(str(error)))
            return {"CANCELLED"}
        _measured.clear()  # Moved points do not change the key.
        settings, count = _point_settings(context, len(forests)), _count_words(context)
        if is_scaled(points):
            apply_scale(points)
        remove_forests(points)
        for modifier in [each for each in points.modifiers if each.name.startswith(POINTS_NAME)]:
            points.modifiers.remove(modifier)
        add_points_modifier(points, settings)
        for kind, (tree, forest) in enumerate(zip(trees, forests, strict=True)):
            forest.variants.name = f"{tree.name}_forest"
            modifier = forest.plant(points, width=wanted.width, far=wanted.far or NEVER, kind=kind)
            if (root := root_of(tree)) is not None and LOD_DISTANCE in root:
                drive_modifier_input(modifier, LOD_DISTANCE, root, f'["{LOD_DISTANCE}"]')
        kinds = ", ".join(forest.variants.name.removesuffix("_forest") for forest in forests)
        said = count or ("by density" if settings.density else "a tree on each point")
        self.report({"INFO"}, f"Planted {kinds} on {points.name}: {said}")
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
        wanted = context.scene.leafcloud_forest
        column = layout.column(align=True)
        column.prop(wanted, "tree")
        column.prop(wanted, "points")
        column = layout.column(align=True)
        column.prop(wanted, "on")
        if wanted.on != "points":
            ground = _points(context)
            column.prop(wanted, "density")
            if ground is not None and ground.type == "MESH":
                column.prop_search(wanted, "mask", ground, "vertex_groups")
            else:
                column.prop(wanted, "mask")
            column.prop(wanted, "slope")
        column = layout.column(align=True)
        for name in ("turn", "smallest", "largest", "seed", "ground"):
            column.prop(wanted, name)
        column = layout.column(align=True)
        column.prop(wanted, "width")
        column.prop(wanted, "far")
        count = _count_words(context)
        if count and not _problem(context):
            add_text(layout, context, count, "INFO")
        layout.operator("leafcloud.forest")
        draw_faults(layout, context, _trees(context))
        layout.operator("leafcloud.export_forest")


def _point_settings(context: bpy.types.Context, kinds: int) -> PointSettings:
    names = ("ground", "mask", "slope", "turn", "smallest", "largest", "seed")
    wanted = {name: getattr(context.scene.leafcloud_forest, name) for name in names}
    return PointSettings(kinds, density=_density(context), **wanted)


def _is_scattered(context: bpy.types.Context) -> bool:
    """Return whether trees are scattered on faces."""
    wanted, points = context.scene.leafcloud_forest, _points(context)
    is_wished = wanted.on == "faces" or (wanted.on == "auto" and wanted.density > 0.0)
    return is_wished or (wanted.on == "auto" and points is not None and is_ground(points))


def _density(context: bpy.types.Context) -> float:
    """Return the trees per square unit; 0 for a tree on each point."""
    points, given = _points(context), float(context.scene.leafcloud_forest.density)
    if points is None or not _is_scattered(context):
        return 0.0
    return given or usual_density(_area(points), [width_of(tree) for tree in _trees(context)])


def _area(obj: bpy.types.Object) -> float:
    """Return the area of an object, which is measured again where its mesh or its scale is another."""
    if obj.type != "MESH":
        return 0.0
    key = (obj.data.session_uid, len(obj.data.vertices), len(obj.data.polygons), *obj.matrix_world.to_scale())
    if not _measured or _measured[0][0] != key:
        _measured[:] = [(key, area_of(obj))]
    return _measured[0][1]


def _count_words(context: bpy.types.Context) -> str:
    """Return how many trees the object gets, without modifiers; empty where that is not known."""
    density, points = _density(context), _points(context)
    if points is None or density == 0.0 or _area(points) == 0.0:
        return ""
    wanted = context.scene.leafcloud_forest
    fewer = wanted.mask or wanted.slope < _POINTS.slope
    words = f"{density * _area(points):,.0f} trees, {length_words(density**-0.5)} apart on the average"
    return f"at most {words}: fewer by Mask and Slope" if fewer else f"about {words}"


def _problem(context: bpy.types.Context) -> str:
    """Return why no forest can be planted now, with the remedy; empty if one can."""
    trees, points = _trees(context), _points(context)
    if context.mode != "OBJECT":
        return "Switch to Object Mode first"
    if running:
        return BUSY
    if not trees:
        return "No baked tree is in the scene: bake one first"
    if points is None:
        return "Choose the object with the points, or make it active"
    if points.type not in _WITH_POINTS:
        return f"{points.name} has no points: choose a mesh, a curve or a point cloud"
    if level_number(points) is not None or level_number(points.parent or points) is not None:
        return f"{points.name} belongs to a baked tree: choose the object with the points"
    if is_scaled(points) and not may_apply_scale(points):
        return f"{points.name} has a scale, which would stretch the trees: use Object › Apply › Scale"
    if _is_scattered(context) and points.type == "MESH" and not points.modifiers and _area(points) == 0.0:
        return f"{points.name} has no faces: choose Points under On"
    return ""


def _trees(context: bpy.types.Context) -> tuple[bpy.types.Collection, ...]:
    chosen = context.scene.leafcloud_forest.tree
    return tree_collections(context.scene.objects) if chosen is None else (chosen,)


def _points(context: bpy.types.Context) -> bpy.types.Object | None:
    return context.scene.leafcloud_forest.points or context.view_layer.objects.active


def _build(context: bpy.types.Context, collection: bpy.types.Collection) -> Forest:
    """Build the forest of a tree, with pruned variants if the tree was baked for pruning."""
    tree, factor = baked_tree(collection), lod_factor(collection)  # A driver follows LOD Distance.
    leaves, pruning = tree.levels[0].object, LeafPruning(NEVER)
    if "leaf_rank" in leaves.data.attributes:
        pruning = leaf_pruning(leaves, context.scene.leafcloud.prune_pixels, view_of(context.scene))
    return build_forest(
        tree.levels,
        f"{collection.name}_forest",
        switch_distances=[each / factor for each in tree.switch_distances],
        centre=tree.centre,
        prune_start=pruning.start * tree.scale / factor if pruning.measured else NEVER,
        prune_half=pruning.half,
        growth=pruning.growth,
    )
