"""The node group that draws all trees of a collection, pruned for the camera by the budget of the scene.

Those farther away give up more of their leaves (after Gomez). With dᵢ the distance from the scene's active camera to
the i-th tree's centre, and λᵢ its own share of leaves by `lod_nodes`, from the distance in the tree's own coordinates:

    ωᵢ = smooth step from 1 at ¾·z to 0 at z                     how far the tree counts; z = far
    n = Σ ωᵢ,  d_min = min(dᵢ, z),  R = max ωᵢ·(dᵢ − d_min)      models, the nearest, the range behind it
    xᵢ = min(dᵢ, z) − d_min,  Rᵢ = max(R, xᵢ)                    depth of the tree, and the range that it sees
    λ′ᵢ = λᵢ · (1 − a · (Rᵢ/z) · (xᵢ/Rᵢ)^(m/n))                  a = strength, m = full models

Where all trees are nearer than ¾·z this is the published formula. Nobody asks what the camera's frame shows, and a tree
that comes from beyond z has no say in the others' n, d_min and R before it is nearer, where its say begins at 0:
minima, maxima and sums of continuous functions are continuous, so λ′ is, along any path of the camera and of any tree.
Only its own range reaches beyond R as far as the tree itself: if it faded out with ωᵢ, a tree that goes away would grow
leaves again. λ′ is never above λ, and falls with the distance among trees of equal scale.

The triangle budget is one factor f ≤ 1 for all λ′. A leaf is drawn where its key, rank / λ′ᵢ, is below f. So the faces
are put in the order of their keys and their triangles counted until the budget is full: the key of the first leaf that
has no room is f. Of leaves with that very key (trees that stand symmetrically have many) those of the first trees are
drawn, as long as there is room, at a size of 0. So never more than the budget is drawn, and less by a leaf at most.

    r = clamp((1 − key/f) / min(0.05, 1 − f·λ′ᵢ), 0, 1)           ramp, by leaf
    s = √(ΣA / Σ(A·r²))                                           by tree, A the areas of its leaves in its coordinates
    p' = pivot + (p − pivot)·s·γ·r                                γ and the share of the mean 1 − κ as in `lod_nodes`

Leaves of a negative rank, and meshes without ranks (the wood), are protected: never pruned, never grown, in no sum of
areas. They count in the budget, but it cannot remove them.

Known limits: every tree is realised before it is pruned, each at every change of the camera, so memory and time follow
the leaves of all trees. Every object of the collection counts in n, the wood too; trees do not lie in collections of
their own inside it. Leaves do not move onto billboards; their pivots and targets come out in the trees' coordinates.
Blender 4.2's Delete Geometry node drops custom normals.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import bpy

from ..scene.node_links import MEAN_SHARE
from .node_laws import (
    LENGTH,
    NEVER,
    SHARE,
    TINY,
    Camera,
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
from .sections import Section

GROUP_NAME = "Leafcloud Scene"

_LAYOUT_KEY = "leafcloud_scene_layout"
_LAYOUT = 1
"""Written into the group; raised when inputs or laws change, so that a file made earlier keeps its own group."""

_RAMP = 0.05
"""ρ at most: the share of the leaves drawn that is growing in or out."""
_FADE = 0.75
"""The share of z from which on trees count less."""


@dataclass(frozen=True)
class SceneSettings:
    """How the trees of a scene share its leaves.

    prune_start: d₀, from where on leaves are pruned, in the trees' own units (world distance / scale). > 0.
    prune_half: h in (0, ½]; half of the leaves are left at d₀/h.
    growth, contrast: of pruned leaves, as measured (`leafcloud.Chain`), the same for all trees; finite.
    full_models: m, of how many trees the loss is linear in the distance; more lose more. > 0.
    far: z, the distance up to which trees count, in units of the object with the modifier. > 0.
    strength: a, what the farthest trees lose at most, in [0, 1]; at 0 each tree is pruned by its own distance alone.
    budget: triangles that are drawn at most, the protected ones among them; 0 for no limit. In [0, 2³¹).
    centre: the point of a tree that the distance is taken from, in the tree's coordinates.

    Raises `ValueError` for a value that is outside its range or not finite.
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
    """The trees of the scene in one geometry, and what is known of each of its points or faces."""

    geometry: bpy.types.NodeSocket
    rank: bpy.types.NodeSocket
    tree: bpy.types.NodeSocket
    keep: bpy.types.NodeSocket
    area: bpy.types.NodeSocket
    """A, in the tree's coordinates; 0 for what is protected."""
    all_area: bpy.types.NodeSocket
    """ΣA of the tree."""


class _Cut(NamedTuple):
    """Drawn are the leaves of keys below `factor`, and of those at `factor` the ones in trees before `tree`."""

    factor: bpy.types.NodeSocket
    tree: bpy.types.NodeSocket


def scene_group() -> bpy.types.NodeTree:
    """The node group of this file: the one that is there, else a new one."""
    return group_of_layout(GROUP_NAME, _LAYOUT_KEY, _LAYOUT, _add_interface, _add_nodes)


def add_scene_modifier(
    obj: bpy.types.Object, trees: bpy.types.Collection, settings: SceneSettings
) -> bpy.types.NodesModifier:
    """Makes `obj` draw the `trees` in place of its own mesh. It needs neither the add-on nor Python from then on.

    The collection holds meshes of leaves as LOD 0 has them (point attributes `leaf_rank`, `leaf_pivot`) without
    modifiers, and wood. It need not be in the scene; where it is, its trees are drawn a second time, whole. `obj` is
    not in it.
    """
    values = {
        "Trees": trees,
        "Prune Start": settings.prune_start,
        "Prune Half": settings.prune_half,
        "Growth": settings.growth[0],
        "Growth of Few": settings.growth[1],
        "Contrast": settings.contrast[0],
        "Contrast of Few": settings.contrast[1],
        "Full Models": settings.full_models,
        "Far": settings.far,
        "Strength": settings.strength,
        "Budget": settings.budget,
        "Centre": settings.centre,
    }
    return add_modifier(obj, GROUP_NAME, scene_group(), values)


def _add_interface(tree: bpy.types.NodeTree) -> None:
    """Declares the group's inputs. Their names are a promise to files and scripts; their panels are not."""
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    declare(tree, "Trees", "Collection", "Meshes of leaves with ranks and pivots, and wood")
    declare(tree, "Centre", "Vector", "Point of a tree that the distance to the camera is taken from", subtype="XYZ")

    panel = tree.interface.new_panel("Pruning")
    declare_pruning(tree, panel)
    declare_trend(tree, "Growth", "leaves grow less than their area asks for", panel)
    declare_trend(tree, "Contrast", "colours are pulled toward their mean", panel)

    panel = tree.interface.new_panel("Scene")
    models = "Number of trees of which the loss is linear in the distance; more trees lose more"
    declare(tree, "Full Models", "Float", models, panel, default_value=10.0, min_value=0.0)
    declare(tree, "Far", "Float", "Distance up to which trees count", panel, default_value=1000.0, **LENGTH)
    declare(tree, "Strength", "Float", "Share that the farthest trees lose at most", panel, default_value=0.5, **SHARE)
    declare(tree, "Budget", "Int", "Triangles that are drawn at most; 0: no limit", panel, default_value=0, min_value=0)


def _add_nodes(tree: bpy.types.NodeTree) -> None:
    section = Section(tree, "Trees and camera", (-5600.0, 0.0))
    operands = (section.group_input("Trees"), True, False)
    instances = section.result("GeometryNodeCollectionInfo", *operands, label="Trees", transform_space="RELATIVE")
    world_distance, own_distance = _distances(section)

    section = Section(tree, "Share of leaves kept λ′", (-3800.0, 0.0))
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
    late = section.compare(trees.tree, "GREATER_EQUAL", cut.tree, label="No room any more")
    over = section.logic(after, "OR", section.logic(at, "AND", late), label="Over the budget")
    within = section.switch("GEOMETRY", binds, kept, _deleted(section, kept, over), label="Where the budget binds")
    factor = section.switch("FLOAT", binds, 1.0, cut.factor, label="f")

    section = Section(tree, "Growth s·r of the leaves kept", (4200.0, 0.0))
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
    """The geometry with the share of the mean for materials, where the group's user asks for contrast at all."""
    numbers = ("Contrast", "Contrast of Few")
    first, second = (section.compare(section.group_input(name), "NOT_EQUAL", 0.0) for name in numbers)
    asked = section.logic(first, "OR", second, label="Contrast?")
    stored = {"data_type": "FLOAT", "domain": "POINT"}
    told = section.result(
        "GeometryNodeStoreNamedAttribute", geometry, growing, MEAN_SHARE, pulled, label="1 − κ", **stored
    )
    return section.switch("GEOMETRY", asked, geometry, told, label="Tell materials")


def _distances(section: Section) -> tuple[bpy.types.NodeSocket, bpy.types.NodeSocket]:
    """By tree: d from the camera to its centre in the coordinates of the object with the modifier, and in its own."""
    camera = Camera(section)
    centre = section.group_input("Centre")
    transform = section.result("GeometryNodeInstanceTransform")
    here = section.result("FunctionNodeTransformPoint", centre, transform, label="Centre of the tree")
    distance = camera.distance(section, camera.location, here, label="Distance d")
    inverse = section.result("FunctionNodeInvertMatrix", transform)
    there = section.result("FunctionNodeTransformPoint", camera.location, inverse, label="Camera seen from the tree")
    return distance, camera.distance(section, there, centre, label="d in its own units")


def _scene_keep(
    section: Section, instances: bpy.types.NodeSocket, distance: bpy.types.NodeSocket, own_keep: bpy.types.NodeSocket
) -> bpy.types.NodeSocket:
    """λ′, by tree."""

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
    """The trees as one mesh. What does not depend on the camera is taken from each mesh once, however often it stands.

    Rank and area are captured before, because afterwards every point has a rank, and areas are those of scaled trees.
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
    """rank / λ′, at least 1 for every leaf where λ′ is 0, negative for what is protected.

    In f32 the quotient is below 1 where rank is below λ′, and nowhere else.
    """
    least = section.math("ADD", trees.rank, TINY, label="0 is lost at λ′ = 0, too")
    return section.math("DIVIDE", least, section.math("MAXIMUM", trees.keep, TINY), label="Key")


def _deleted(section: Section, geometry: bpy.types.NodeSocket, lost: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    return section.result("GeometryNodeDeleteGeometry", geometry, lost, label="Prune", domain="POINT", mode="ALL")


def _corner_count(section: Section) -> bpy.types.NodeSocket:
    return section.node("GeometryNodeInputMeshFaceNeighbors", label="Corners of the face").outputs["Vertex Count"]


def _exceeds_budget(
    section: Section, geometry: bpy.types.NodeSocket, triangles: bpy.types.NodeSocket
) -> bpy.types.NodeSocket:
    """Whether there is a budget and `geometry` has more triangles. Counted in integers: f32 has not all from 2²⁴ on."""
    faces = {"data_type": "INT", "domain": "FACE"}
    total = section.node("GeometryNodeAccumulateField", triangles, label="All triangles", **faces).outputs["Total"]
    count = section.result("GeometryNodeSampleIndex", geometry, total, 0, label="Count", **faces)
    budget = section.group_input("Budget")
    limited = section.compare_integers(budget, "GREATER_THAN", 0, label="Is there a budget?")
    return section.logic(limited, "AND", section.compare_integers(count, "GREATER_THAN", budget), label="Does it bind?")


def _cut(
    section: Section,
    geometry: bpy.types.NodeSocket,
    triangles: bpy.types.NodeSocket,
    key: bpy.types.NodeSocket,
    tree: bpy.types.NodeSocket,
) -> _Cut:
    """The cut of `geometry`, which has more triangles than the budget.

    Faces become points, which are quicker to sort. A face has the key of its first point, not the mean of its points,
    which may be rounded: then a leaf would be counted that is not deleted. Sorting keeps the order of equal keys, so
    the faces of one tree stay together. What is protected comes first, and is not cut.
    """
    corner = section.result("GeometryNodeCornersOfFace", label="First corner")
    first = section.result("GeometryNodeVertexOfCorner", corner, label="First point")
    key = section.at_index(key, first, "Key of the face", data_type="FLOAT", domain="POINT")
    of_face = {"Key": ("FLOAT", key), "Tree": ("INT", tree), "Triangles": ("INT", triangles)}
    faces, key, tree, triangles = section.capture(geometry, "FACE", "Of the face", **of_face)
    points = section.result("GeometryNodeMeshToPoints", faces, label="Faces as points", mode="FACES")
    ordered = section.result("GeometryNodeSortElements", points, None, None, key, label="By key", domain="POINT")

    of_point = {"data_type": "INT", "domain": "POINT"}
    counted = section.node("GeometryNodeAccumulateField", triangles, label="Triangles so far", **of_point)
    used, budget = counted.outputs["Leading"], section.group_input("Budget")
    full = section.compare_integers(used, "GREATER_THAN", budget, label="No room any more")
    points = {"data_type": "FLOAT", "domain": "POINT"}
    factor = section.node("GeometryNodeAttributeStatistic", ordered, full, key, label="First key without", **points)
    factor = section.math("MAXIMUM", factor.outputs["Min"], 0.0, label="f")
    at = section.logic(full, "AND", section.compare(key, "LESS_EQUAL", factor), label="Of these, at f")
    first_tree = section.node("GeometryNodeAttributeStatistic", ordered, at, tree, label="First tree without", **points)
    return _Cut(factor, first_tree.outputs["Min"])


def _growth(
    section: Section,
    trees: _Trees,
    key: bpy.types.NodeSocket,
    factor: bpy.types.NodeSocket,
    drawn_keep: bpy.types.NodeSocket,
) -> bpy.types.NodeSocket:
    """s·γ·r. The sum of what is drawn is taken over the geometry that it is asked on, after pruning."""
    share = section.math("DIVIDE", key, factor, label="rank / (f·λ′)")
    rest = section.math("SUBTRACT", 1.0, drawn_keep, label="1 − f·λ′")
    width = section.math("MAXIMUM", section.math("MINIMUM", rest, _RAMP, label="ρ"), TINY)
    ramp = section.math("DIVIDE", section.math("SUBTRACT", 1.0, share), width, label="Ramp r", clamp=True)
    drawn = section.math("MULTIPLY", trees.area, section.math("MULTIPLY", ramp, ramp, label="r²"), label="A·r²")
    drawn_area = sum_over_faces(section, drawn, trees.tree)
    scale = section.math("SQRT", section.math("DIVIDE", trees.all_area, drawn_area), label="Scale s")
    grown = section.math("MULTIPLY", scale, trend(section, drawn_keep, "Growth"), label="s·γ")
    return section.math("MULTIPLY", grown, ramp, label="s·γ·r")


def _pivot(section: Section, instances: bpy.types.NodeSocket, tree: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    """The leaf's pivot where the tree stands: realising moves points, but no attributes."""
    transform = section.result("GeometryNodeInstanceTransform")
    operands = (instances, transform, tree)
    place = section.result(
        "GeometryNodeSampleIndex", *operands, label="Place of the tree", data_type="FLOAT4X4", domain="INSTANCE"
    )
    pivot = section.attribute("FLOAT_VECTOR", "leaf_pivot")
    return section.result("FunctionNodeTransformPoint", pivot, place, label="Pivot")
