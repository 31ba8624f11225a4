"""The node group *Leafcloud Scene*. It draws all trees of a collection and prunes them within the scene's budget.

Farther trees lose more of their leaves (after Gomez). dᵢ is the distance from the scene's active camera to the i-th
tree's center. λᵢ is its fraction of leaves kept as in `nodes.lod`, from the distance in the tree's own coordinates:

    ωᵢ = smooth step from 1 at ¾·z to 0 at z                     weight of the tree; z = far
    n = Σ ωᵢ,  d_min = min(dᵢ, z),  R = max ωᵢ·(dᵢ − d_min)      weighted count, nearest tree, depth range behind it
    xᵢ = min(dᵢ, z) − d_min,  Rᵢ = max(R, xᵢ)                    depth of the tree, and its depth range
    λ′ᵢ = λᵢ · (1 − a · (Rᵢ/z) · (xᵢ/Rᵢ)^(m/n))                  a = strength, m = full models

If all trees are nearer than ¾·z this is the published formula. λ′ does not depend on the camera frame. A tree that
comes nearer than z affects the others' n, d_min and R with a weight that starts at 0. Minima, maxima and sums of
continuous functions are continuous, so λ′ is continuous along any path of the camera and of the trees. A tree's own
range Rᵢ always reaches as far as the tree. If it faded out with ωᵢ, a departing tree would grow leaves again. λ′ is
never above λ, and falls with the distance among trees of equal scale.

The triangle budget is one factor f ≤ 1 for all λ′. A leaf is drawn if its key, rank / λ′ᵢ, is below f. To find f, faces
are sorted by key and their triangles counted until the budget is full. f is the key of the first leaf without room.
Several leaves may have exactly this key, for example in symmetrically placed trees. Those of the first trees are drawn
while there is room, at size 0. So the triangle count never exceeds the budget, and falls short by at most one leaf.

    r = clamp((1 − key/f) / min(0.05, 1 − f·λ′ᵢ), 0, 1)           ramp, by leaf
    s = √(ΣA / Σ(A·r²))                                           by tree, A the areas of its leaves in its coordinates
    p' = pivot + (p − pivot)·s·γ·r                                γ, and 1 − κ for colors, as in `nodes.lod`

Leaves of a negative rank, and meshes without ranks (trunks), are protected: never pruned, never grown, in no sum of
areas. They count in the budget, but it cannot remove them.

Known limits: each change of the camera realizes all trees before pruning, so memory and time grow with the leaves of
all trees. Every object of the collection counts in n, trunks too. Trees must not be in child collections. Leaves do not
morph onto billboards. The output's pivots and targets are in the trees' coordinates. Blender 4.2's Delete Geometry node
drops custom normals.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import bpy

import leafcloud

from ..material.node_links import MEAN_SHARE
from .builder import Section
from .laws import (
    LENGTH,
    NEVER,
    SHARE,
    TINY,
    CameraNodes,
    add_modifier,
    declare,
    declare_pruning,
    declare_trend,
    group_of_layout,
    keep,
    mean_share,
    sum_over_faces,
    trend,
)

GROUP_NAME = "Leafcloud Scene"

_LAYOUT_KEY = "leafcloud_scene_layout"
_LAYOUT = 1
"""Version stored in the group. Increase it when inputs or laws change: files made earlier then keep their group."""

_FADE = 0.75
"""Fraction of z from which the weight ω falls."""


@dataclass(frozen=True)
class SceneSettings:
    """Inputs of the node group.

    prune_start: d₀, the distance where pruning begins, in the trees' own units (world distance / scale). > 0.
    prune_half: h in (0, ½]; half of the leaves are kept at d₀/h.
    growth, contrast: measured trends of pruned leaves (`leafcloud.Chain`), the same for all trees; finite.
    full_models: m, the tree count at which pruning is linear in distance; larger scenes prune more. > 0.
    far: z, the distance up to which trees count, in units of the object with the modifier. > 0.
    strength: a, the maximum fraction that the farthest trees lose, in [0, 1]. At 0 each tree is pruned by its own
        distance only.
    budget: maximum number of triangles, including protected ones; 0 for no limit. In [0, 2³¹).
    centre: the point of a tree that the distance is measured from, in the tree's coordinates.

    Raises `ValueError` for a value that is out of range or not finite.
    """

    prune_start: float = NEVER
    prune_half: float = 0.5
    growth: tuple[float, float] = (0.0, 0.0)
    contrast: tuple[float, float] = (0.0, 0.0)
    full_models: float = 10.0
    far: float = 1000.0
    strength: float = 0.5
    budget: int = 0
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        limits = {
            "prune_start": (self.prune_start > 0.0, "greater than 0"),
            "prune_half": (0.0 < self.prune_half <= 0.5, "greater than 0 and at most 0.5"),
            "full_models": (self.full_models > 0.0, "greater than 0"),
            "far": (self.far > 0.0, "greater than 0"),
            "strength": (0.0 <= self.strength <= 1.0, "in [0, 1]"),
            "budget": (0 <= self.budget < 2**31, "at least 0 and below 2³¹"),
            "growth": (all(map(math.isfinite, self.growth)), "finite"),
            "contrast": (all(map(math.isfinite, self.contrast)), "finite"),
            "centre": (all(map(math.isfinite, self.centre)), "finite"),
        }
        for name, (holds, limit) in limits.items():
            value = getattr(self, name)
            if not (holds and (isinstance(value, tuple) or math.isfinite(value))):
                raise ValueError(f"{name} is {value}, it must be {limit}")


class _Trees(NamedTuple):
    """All trees of the scene in one geometry, with fields on its points and faces."""

    geometry: bpy.types.NodeSocket
    rank: bpy.types.NodeSocket
    tree: bpy.types.NodeSocket
    keep: bpy.types.NodeSocket
    area: bpy.types.NodeSocket
    """A, in the tree's coordinates; 0 for protected faces."""
    all_area: bpy.types.NodeSocket
    """ΣA of the tree."""


class _Cut(NamedTuple):
    """The budget's cut: keys below `factor` are drawn, and keys equal to `factor` in trees numbered below `tree`."""

    factor: bpy.types.NodeSocket
    tree: bpy.types.NodeSocket


def scene_group() -> bpy.types.NodeTree:
    """Return the node group of the current file. Create it if it is missing."""
    return group_of_layout(GROUP_NAME, _LAYOUT_KEY, _LAYOUT, _add_interface, _add_nodes)


def add_scene_modifier(
    obj: bpy.types.Object, trees: bpy.types.Collection, settings: SceneSettings
) -> bpy.types.NodesModifier:
    """Add the modifier that draws `trees` in place of `obj`'s mesh. It works without the add-on and without Python.

    The collection holds trunks, and leaf meshes with the point attributes of LOD 0 (`leaf_rank`, `leaf_pivot`) but
    without modifiers. Keep it out of the scene: trees in the scene are drawn a second time, unpruned. `obj` must not be
    in the collection.
    """
    values = {
        "Trees": trees,
        "Prune Start": settings.prune_start,
        "Prune Half": settings.prune_half,
        "Growth": settings.growth[0],
        "Growth Quadratic": settings.growth[1],
        "Contrast": settings.contrast[0],
        "Contrast Quadratic": settings.contrast[1],
        "Full Models": settings.full_models,
        "Far": settings.far,
        "Strength": settings.strength,
        "Budget": settings.budget,
        "Centre": settings.centre,
    }
    return add_modifier(obj, GROUP_NAME, scene_group(), values)


def _add_interface(tree: bpy.types.NodeTree) -> None:
    """Declare the group's inputs. Files and scripts rely on the names of the inputs, not on the panels."""
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    declare(tree, "Trees", "Collection", "Collection of baked leaves, with ranks and pivots, and of trunks")
    declare(tree, "Centre", "Vector", "Point of a tree that the distance to the camera is measured from", subtype="XYZ")

    panel = tree.interface.new_panel("Pruning")
    declare_pruning(tree, panel)
    declare_trend(tree, "Growth", "the leaves grow less than needed to keep their total area", panel)
    declare_trend(tree, "Contrast", "leaf colors move toward their mean", panel)

    panel = tree.interface.new_panel("Scene")
    models = "Tree count at which pruning is linear in distance. Larger scenes prune more"
    declare(tree, "Full Models", "Float", models, panel, default_value=10.0, min_value=0.0)
    declare(tree, "Far", "Float", "Distance up to which trees count", panel, default_value=1000.0, **LENGTH)
    strength = "Maximum fraction of their leaves that the farthest trees lose"
    declare(tree, "Strength", "Float", strength, panel, default_value=0.5, **SHARE)
    declare(tree, "Budget", "Int", "Maximum number of triangles; 0: no limit", panel, default_value=0, min_value=0)


def _add_nodes(tree: bpy.types.NodeTree) -> None:
    section = Section(tree, "Trees and camera", (-5600.0, 0.0))
    operands = (section.group_input("Trees"), True, False)
    instances = section.result("GeometryNodeCollectionInfo", *operands, label="Trees", transform_space="RELATIVE")
    world_distance, own_distance = _distances(section)

    section = Section(tree, "Fraction of leaves kept λ′", (-3800.0, 0.0))
    own_keep = keep(section, own_distance)
    shared_keep = _scene_keep(section, instances, world_distance, own_keep)
    trees = _realised(Section(tree, "All trees as one mesh", (-1600.0, 0.0)), instances, shared_keep)

    section = Section(tree, "Prune", (0.0, 0.0))
    key = _key(section, trees)
    lost = section.compare(key, "GREATER_EQUAL", 1.0, label="rank ≥ λ′")
    kept = _deleted(section, trees.geometry, lost)
    triangles = section.math("SUBTRACT", _corner_count(section), 2.0, label="Triangles of the face")
    binds = _exceeds_budget(section, kept, triangles)

    section = Section(tree, "Cut to the budget", (1600.0, 0.0))
    cut = _cut(section, kept, triangles, key, trees.tree)
    after = section.compare(key, "GREATER_THAN", cut.factor, label="key > f")
    at = section.compare(key, "GREATER_EQUAL", cut.factor, label="key ≥ f")
    late = section.compare(trees.tree, "GREATER_EQUAL", cut.tree, label="No room left")
    over = section.logic(after, "OR", section.logic(at, "AND", late), label="Over the budget")
    within = section.switch("GEOMETRY", binds, kept, _deleted(section, kept, over), label="Cut if over the budget")
    factor = section.switch("FLOAT", binds, 1.0, cut.factor, label="f")

    section = Section(tree, "Scale s·γ·r of the leaves kept", (4200.0, 0.0))
    drawn_keep = section.math("MULTIPLY", trees.keep, factor, label="f·λ′")
    growth = _growth(section, trees, key, factor, drawn_keep)
    pivot = _pivot(section, instances, trees.tree)
    arm = section.vector("SUBTRACT", section.result("GeometryNodeInputPosition"), pivot, label="Point from pivot")
    grown = section.vector("MULTIPLY_ADD", arm, growth, pivot, label="Grow about pivot")
    pruned = section.compare(drawn_keep, "LESS_THAN", 1.0, label="f·λ′ < 1")
    leaf = section.compare(trees.rank, "GREATER_EQUAL", 0.0, label="Not protected")
    growing = section.logic(pruned, "AND", leaf, label="Leaves of pruned trees")
    told = _told(section, within, growing, mean_share(section, drawn_keep))
    section.node("NodeGroupOutput", section.result("GeometryNodeSetPosition", told, growing, grown, label="Grow"))


def _told(
    section: Section, geometry: bpy.types.NodeSocket, growing: bpy.types.NodeSocket, pulled: bpy.types.NodeSocket
) -> bpy.types.NodeSocket:
    """Return the geometry, with `leaf_mean_share` stored for materials if an input Contrast is not 0."""
    numbers = ("Contrast", "Contrast Quadratic")
    first, second = (section.compare(section.group_input(name), "NOT_EQUAL", 0.0) for name in numbers)
    asked = section.logic(first, "OR", second, label="Contrast?")
    stored = {"data_type": "FLOAT", "domain": "POINT"}
    told = section.result(
        "GeometryNodeStoreNamedAttribute", geometry, growing, MEAN_SHARE, pulled, label="1 − κ", **stored
    )
    return section.switch("GEOMETRY", asked, geometry, told, label="Store for materials")


def _distances(section: Section) -> tuple[bpy.types.NodeSocket, bpy.types.NodeSocket]:
    """Return d from the camera to each tree's center, in the coordinates of the object with the modifier and of the
    tree."""
    camera = CameraNodes(section, only_camera=True)
    centre = section.group_input("Centre")
    transform = section.result("GeometryNodeInstanceTransform")
    here = section.result("FunctionNodeTransformPoint", centre, transform, label="Center of the tree")
    distance = camera.distance(section, camera.location, here, label="Distance d")
    inverse = section.result("FunctionNodeInvertMatrix", transform)
    there = section.result("FunctionNodeTransformPoint", camera.location, inverse, label="Camera in tree space")
    return distance, camera.distance(section, there, centre, label="d in its own units")


def _scene_keep(
    section: Section, instances: bpy.types.NodeSocket, distance: bpy.types.NodeSocket, own_keep: bpy.types.NodeSocket
) -> bpy.types.NodeSocket:
    """Return λ′ of each tree."""

    def over_trees(values: bpy.types.NodeSocket, statistic: str, label: str) -> bpy.types.NodeSocket:
        node = section.node(
            "GeometryNodeAttributeStatistic", instances, None, values, label=label, data_type="FLOAT", domain="INSTANCE"
        )
        return node.outputs[statistic]

    far = section.math("MAXIMUM", section.group_input("Far"), TINY, label="z")
    near = section.math("MINIMUM", distance, far, label="min(d, z)")
    nearest = over_trees(near, "Min", "d_min")
    depth = section.math("SUBTRACT", near, nearest, label="x")
    fade = section.math("MULTIPLY", far, _FADE)
    weight = section.result("ShaderNodeMapRange", near, fade, far, 1.0, 0.0, label="ω", interpolation_type="SMOOTHSTEP")
    models = section.math("MAXIMUM", over_trees(weight, "Sum", "Sum of ω"), TINY, label="n")
    shared = over_trees(section.math("MULTIPLY", weight, depth, label="ω·x"), "Max", "R")
    reach = section.math("MAXIMUM", section.math("MAXIMUM", shared, depth), TINY, label="Range")

    full = section.math("MAXIMUM", section.group_input("Full Models"), TINY, label="m")
    power = section.math("DIVIDE", full, models, label="m/n")
    fall = section.math("POWER", section.math("DIVIDE", depth, reach, label="x/Range"), power)
    strength = section.result("ShaderNodeClamp", section.group_input("Strength"), label="a")
    greatest = section.math("MULTIPLY", strength, section.math("DIVIDE", reach, far, label="Range/z"))
    left = section.math("SUBTRACT", 1.0, section.math("MULTIPLY", greatest, fall, label="Loss"), clamp=True)
    return section.math("MULTIPLY", own_keep, left, label="λ′")


def _realised(section: Section, instances: bpy.types.NodeSocket, shared_keep: bpy.types.NodeSocket) -> _Trees:
    """Realize the trees to one mesh.

    Rank and area are captured per source mesh before: once for all its copies, because they do not depend on the
    camera. After realizing, points of meshes without ranks would have ranks, too, and areas would include the scale.
    """
    named = section.node("GeometryNodeInputNamedAttribute", "leaf_rank", label="leaf_rank", data_type="FLOAT")
    rank = section.switch("FLOAT", named.outputs["Exists"], -1.0, named.outputs["Attribute"], label="Rank")
    captured, rank = section.capture(instances, "POINT", "Ranks", Rank=("FLOAT", rank))

    leaf = section.compare(rank, "GREATER_EQUAL", 0.0, label="Not protected")
    face_area = section.result("GeometryNodeInputMeshFaceArea")
    area = section.switch("FLOAT", leaf, 0.0, face_area, label="A")
    areas = {"A": ("FLOAT", area), "ΣA": ("FLOAT", sum_over_faces(section, area))}
    captured, area, all_area = section.capture(captured, "FACE", "Areas", **areas)

    index = section.result("GeometryNodeInputIndex")
    of_tree = {"Tree": ("INT", index), "Keep": ("FLOAT", shared_keep)}
    captured, tree, shared_keep = section.capture(captured, "INSTANCE", "Number and λ′ of the tree", **of_tree)
    geometry = section.result("GeometryNodeRealizeInstances", captured)
    return _Trees(geometry, rank, tree, shared_keep, area, all_area)


def _key(section: Section, trees: _Trees) -> bpy.types.NodeSocket:
    """Return rank / λ′: at least 1 for every leaf if λ′ is 0, negative for protected points.

    In f32 the quotient is below 1 if and only if the rank is below λ′.
    """
    least = section.math("ADD", trees.rank, TINY, label="At λ′ = 0 prune rank 0, too")
    return section.math("DIVIDE", least, section.math("MAXIMUM", trees.keep, TINY), label="Key")


def _deleted(section: Section, geometry: bpy.types.NodeSocket, lost: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    return section.result("GeometryNodeDeleteGeometry", geometry, lost, label="Prune", domain="POINT", mode="ALL")


def _corner_count(section: Section) -> bpy.types.NodeSocket:
    return section.node("GeometryNodeInputMeshFaceNeighbors", label="Corners of the face").outputs["Vertex Count"]


def _exceeds_budget(
    section: Section, geometry: bpy.types.NodeSocket, triangles: bpy.types.NodeSocket
) -> bpy.types.NodeSocket:
    """Return whether there is a budget and `geometry` exceeds it.

    It counts in integers, because f32 cannot represent every integer above 2²⁴.
    """
    faces = {"data_type": "INT", "domain": "FACE"}
    total = section.node("GeometryNodeAccumulateField", triangles, label="All triangles", **faces).outputs["Total"]
    count = section.result("GeometryNodeSampleIndex", geometry, total, 0, label="Count", **faces)
    budget = section.group_input("Budget")
    limited = section.compare_integers(budget, "GREATER_THAN", 0, label="Is there a budget?")
    return section.logic(limited, "AND", section.compare_integers(count, "GREATER_THAN", budget), label="Exceeded?")


def _cut(
    section: Section,
    geometry: bpy.types.NodeSocket,
    triangles: bpy.types.NodeSocket,
    key: bpy.types.NodeSocket,
    tree: bpy.types.NodeSocket,
) -> _Cut:
    """Return the cut that fits `geometry` into the budget that it exceeds.

    Faces become points, which sort faster. A face takes the key of its first point. The mean of its points may be
    rounded, and then a counted leaf would not be deleted. Sorting keeps the order of equal keys, so the faces of one
    tree stay together. Protected faces come first and are never cut.
    """
    corner = section.result("GeometryNodeCornersOfFace", label="First corner")
    first = section.result("GeometryNodeVertexOfCorner", corner, label="First point")
    key = section.at_index(key, first, "Key of the face", data_type="FLOAT", domain="POINT")
    of_face = {"Key": ("FLOAT", key), "Tree": ("INT", tree), "Triangles": ("INT", triangles)}
    faces, key, tree, triangles = section.capture(geometry, "FACE", "Key, tree, triangles", **of_face)
    points = section.result("GeometryNodeMeshToPoints", faces, label="Faces as points", mode="FACES")
    ordered = section.result("GeometryNodeSortElements", points, None, None, key, label="By key", domain="POINT")

    of_point = {"data_type": "INT", "domain": "POINT"}
    counted = section.node("GeometryNodeAccumulateField", triangles, label="Triangles so far", **of_point)
    used, budget = counted.outputs["Leading"], section.group_input("Budget")
    full = section.compare_integers(used, "GREATER_THAN", budget, label="No room left")
    points = {"data_type": "FLOAT", "domain": "POINT"}
    factor = section.node("GeometryNodeAttributeStatistic", ordered, full, key, label="First key left out", **points)
    factor = section.math("MAXIMUM", factor.outputs["Min"], 0.0, label="f")
    at = section.logic(full, "AND", section.compare(key, "LESS_EQUAL", factor), label="No room, and key = f")
    first_tree = section.node("GeometryNodeAttributeStatistic", ordered, at, tree, label="First tree out", **points)
    return _Cut(factor, first_tree.outputs["Min"])


def _growth(
    section: Section,
    trees: _Trees,
    key: bpy.types.NodeSocket,
    factor: bpy.types.NodeSocket,
    drawn_keep: bpy.types.NodeSocket,
) -> bpy.types.NodeSocket:
    """Return s·γ·r. The sum of the drawn areas runs over the pruned geometry that evaluates this field."""
    share = section.math("DIVIDE", key, factor, label="rank / (f·λ′)")
    rest = section.math("SUBTRACT", 1.0, drawn_keep, label="1 − f·λ′")
    width = section.math("MAXIMUM", section.math("MINIMUM", rest, leafcloud.RAMP, label="ρ"), TINY)
    ramp = section.math("DIVIDE", section.math("SUBTRACT", 1.0, share), width, label="Ramp r", clamp=True)
    drawn = section.math("MULTIPLY", trees.area, section.math("MULTIPLY", ramp, ramp, label="r²"), label="A·r²")
    drawn_area = sum_over_faces(section, drawn, trees.tree)
    scale = section.math("SQRT", section.math("DIVIDE", trees.all_area, drawn_area), label="Scale s")
    grown = section.math("MULTIPLY", scale, trend(section, drawn_keep, "Growth"), label="s·γ")
    return section.math("MULTIPLY", grown, ramp, label="s·γ·r")


def _pivot(section: Section, instances: bpy.types.NodeSocket, tree: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    """Return the leaf's pivot at the tree's placement. Realizing instances transforms points, but no attributes."""
    transform = section.result("GeometryNodeInstanceTransform")
    operands = (instances, transform, tree)
    place = section.result(
        "GeometryNodeSampleIndex", *operands, label="Place of the tree", data_type="FLOAT4X4", domain="INSTANCE"
    )
    pivot = section.attribute("FLOAT_VECTOR", "leaf_pivot")
    return section.result("FunctionNodeTransformPoint", pivot, place, label="Pivot")
