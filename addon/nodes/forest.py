"""The node group *Leafcloud Forest*. It places a tree on each point and chooses the variant by distance.

Variants are the children of a collection in the order of their names, from finest to coarsest. They are objects or
collections; collections hold leaves and trunk, which share their meshes with other variants. The world origin is the
origin of each instance. d is the distance from the scene's active camera to the tree's center in the tree's own
coordinates, so a tree of twice the size switches at twice the distance. u is the point's random number in [0, 1):

    level = the number of distances D₁ … D₁₅ that are at most d / (f · (1 + width·u))

f is the input LOD Distance. So a tree switches between f·D and f·(1 + width)·D, never nearer than f·D, and neighbors do
not switch together. u depends on the points' attribute `id`, which scattering nodes store, else on their index. It does
not change when the camera moves.
Points may have the attributes `rotation` (rotation or Euler angles) and `scale` (number or vector).

With a Kind of at least 0 the trees stand on the points of point clouds with this Kind as attribute `leafcloud_kind`
(`nodes.points`). All other geometry stays, so several forests on one object mix several kinds of trees.

All instances share one mesh per variant, so 100,000 trees take little memory. They have no transition and no continuous
pruning: a tree's distance only selects its variant.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import reduce

import bpy

from .builder import Section
from .laws import (
    LENGTH,
    NEVER,
    SHARE,
    CameraNodes,
    add_modifier,
    declare,
    declare_factor,
    given_factor,
    group_of_layout,
)
from .points import KIND

GROUP_NAME = "Leafcloud Forest"
MOST_VARIANTS = 16

_LAYOUT_KEY = "leafcloud_forest_layout"
_LAYOUT = 4
"""Version stored in the group. Increase it when inputs or laws change: files made earlier then keep their group."""


@dataclass(frozen=True)
class ForestSettings:
    """Inputs of the node group. Distances are in units of the object with the points.

    distances: D₁ …, where the second variant starts, the third, and so on, for a tree of scale 1. At most 15, none less
        than the one before, each at least 0.
    centre: the point that they are measured from, in the coordinates of the variants.
    width: the fraction of a distance over which the trees' switches are spread at random. In [0, 1].
    far: points beyond this distance are not drawn. ≥ 0.
    kind: the kind of the trees, or −1 to plant on all points, in place of the object's geometry.

    Raises `ValueError` for a value that is out of range or not finite, and for too many distances.
    """

    distances: tuple[float, ...]
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)
    width: float = 0.15
    far: float = NEVER
    kind: int = -1

    def __post_init__(self) -> None:
        limits = {
            "distances": (len(self.distances) < MOST_VARIANTS, f"at most {MOST_VARIANTS - 1} numbers"),
            "centre": (True, "finite"),
            "width": (0.0 <= self.width <= 1.0, "in [0, 1]"),
            "far": (self.far >= 0.0, "at least 0"),
            "kind": (self.kind >= -1, "at least −1"),
        }
        for name, (holds, limit) in limits.items():
            value = getattr(self, name)
            if not (holds and all(map(math.isfinite, value if isinstance(value, tuple) else (value,)))):
                raise ValueError(f"{name} is {value}, it must be {limit}")
        if list(self.distances) != sorted(self.distances) or min(self.distances, default=0.0) < 0.0:
            raise ValueError(f"distances are {self.distances}, they must be at least 0 and not fall")


def forest_group() -> bpy.types.NodeTree:
    """Return the node group of the current file. Create it if it is missing."""
    return group_of_layout(GROUP_NAME, _LAYOUT_KEY, _LAYOUT, _add_interface, _add_nodes)


def add_forest_modifier(
    obj: bpy.types.Object, variants: bpy.types.Collection, settings: ForestSettings
) -> bpy.types.NodesModifier:
    """Add the modifier that draws a tree on every point of `obj`, in place of its geometry.

    It works without the add-on and without Python. `variants` need not be in any scene and must not contain `obj`.
    """
    values = {
        "Variants": variants,
        "Centre": settings.centre,
        "Width": settings.width,
        "Far": settings.far,
        "Kind": settings.kind,
    }
    values |= {_from(number): distance for number, distance in enumerate(settings.distances, start=1)}
    return add_modifier(obj, GROUP_NAME, forest_group(), values)


def _from(number: int) -> str:
    """Return the name of the input for the distance where a variant starts. `number`: index of the variant, from 1."""
    return f"From {number}"


def _add_interface(tree: bpy.types.NodeTree) -> None:
    """Declare the group's inputs. Files and scripts rely on the names of the inputs, not on the panels."""
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    variants = "Collection of the tree's variants, objects or collections. Their names order them, finest first"
    declare(tree, "Variants", "Collection", variants)
    centre = "Point of the variants that the distance to the camera is measured from"
    declare(tree, "Centre", "Vector", centre, subtype="XYZ")
    width = "Random delay of each switch, as a fraction of the distance. Keeps neighbors from switching together"
    declare(tree, "Width", "Float", width, default_value=0.15, **SHARE)
    far = "Distance beyond which points are not drawn"
    declare(tree, "Far", "Float", far, default_value=NEVER, **LENGTH)

    kind = "Kind of the points that the tree is planted on. −1: all points, in place of all geometry"
    declare(tree, "Kind", "Int", kind, default_value=-1, min_value=-1)

    panel = tree.interface.new_panel("Distances", default_closed=True)
    declare_factor(tree, panel)
    for number in range(1, MOST_VARIANTS):
        description = f"Distance where variant {number} takes over. The finest is variant 0"
        declare(tree, _from(number), "Float", description, panel, default_value=NEVER, **LENGTH)


def _add_nodes(tree: bpy.types.NodeTree) -> None:
    section = Section(tree, "Distance d to the camera", (-3200.0, 0.0))
    camera = CameraNodes(section)
    rotation = section.attribute("QUATERNION", "rotation")
    scale = section.vector_attribute("scale", missing=(1.0, 1.0, 1.0))
    position = section.result("GeometryNodeInputPosition")
    arm = section.vector("SUBTRACT", camera.location, position, label="Camera from point")
    back = section.result("FunctionNodeInvertRotation", rotation)
    turned = section.result("FunctionNodeRotateVector", arm, back, label="In the tree's rotation")
    there = section.vector("DIVIDE", turned, scale, label="Camera in tree space")
    own_distance = camera.distance(section, there, section.group_input("Centre"), label="d in its own units")
    distance = camera.distance(section, camera.location, position, label="Distance of the point")
    drawn = section.compare(distance, "LESS_EQUAL", section.group_input("Far"), label="Not too far")

    section = Section(tree, "Which variant?", (-1200.0, 0.0))
    level = _level(section, own_distance)

    section = Section(tree, "Plant", (3000.0, 0.0))
    collection = section.group_input("Variants")
    variants = section.result("GeometryNodeCollectionInfo", collection, True, False, label="Variants")
    count = section.result("GeometryNodeAttributeDomainSize", variants, label="Variant count", component="INSTANCES")
    level = section.math("MINIMUM", level, section.math("SUBTRACT", count, 1.0, label="The coarsest"), label="Level")
    whole, kind = section.group_input("Geometry"), section.group_input("Kind")
    chosen = section.compare_integers(kind, "GREATER_EQUAL", 0, label="Points of one kind")
    own = section.compare_integers(section.attribute("INT", KIND), "EQUAL", kind, label="This kind")
    cloud = section.node("GeometryNodeSeparateComponents", whole, label="Parts").outputs["Point Cloud"]
    ours = section.node("GeometryNodeSeparateGeometry", cloud, own, label="Points of this kind").outputs["Selection"]
    points = section.switch("GEOMETRY", chosen, whole, ours, label="Points")
    operands = (points, drawn, variants, True, level, rotation, scale)
    forest = section.result("GeometryNodeInstanceOnPoints", *operands, label="Plant")
    rest = _without(section, whole, own)
    joined = tree.nodes.new("GeometryNodeJoinGeometry")
    joined.label, joined.parent, joined.location = "All kinds so far", section.frame, (1800.0, 400.0)
    for each in (forest, rest):
        tree.links.new(each, joined.inputs[0])
    section.node(
        "NodeGroupOutput", section.switch("GEOMETRY", chosen, forest, joined.outputs[0], label="With other geometry")
    )


def _without(section: Section, whole: bpy.types.NodeSocket, own: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    """Return the geometry without the points of point clouds where `own` is true."""
    parts = section.node("GeometryNodeSeparateComponents", whole, label="Parts").outputs
    others = section.node("GeometryNodeSeparateGeometry", parts["Point Cloud"], own, label="Other points")
    joined = section.frame.id_data.nodes.new("GeometryNodeJoinGeometry")
    joined.label, joined.parent, joined.location = "Other geometry", section.frame, (1200.0, 700.0)
    kept = (parts[name] for name in ("Instances", "Curve", "Mesh"))
    for each in (*kept, others.outputs["Inverted"]):
        section.frame.id_data.links.new(each, joined.inputs[0])
    return joined.outputs[0]


def _level(section: Section, distance: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    """Return the number of the variants' distances, each delayed by the point's random number, up to `distance`."""
    own = section.result("FunctionNodeRandomValue", 0.0, 1.0, label="u", data_type="FLOAT")
    width = section.math("MAXIMUM", section.group_input("Width"), 0.0, label="Width")
    late = section.math("MULTIPLY_ADD", width, own, 1.0, label="1 + width·u")
    factor = section.math("MULTIPLY", given_factor(section), late, label="f · (1 + width·u)")
    seen = section.math("DIVIDE", distance, factor, label="d / (f · (1 + width·u))")
    reached = [
        section.compare(seen, "GREATER_EQUAL", section.group_input(_from(number)), label=f"At least {_from(number)}?")
        for number in range(1, MOST_VARIANTS)
    ]
    return reduce(lambda sum, each: section.math("ADD", sum, each), reached)
