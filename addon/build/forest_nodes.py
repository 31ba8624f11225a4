"""The node group that draws a forest: on each point an instance of the variant of a tree that its distance asks for.

Variants are the children of a collection in the order of their names, from the finest to the coarsest: objects, or
collections (leaves and wood that share their meshes with other variants). They are drawn as they stand about the origin
of the world. With d the distance from the scene's active camera to the tree's centre in the tree's own coordinates (a
tree that is twice as large switches twice as far away), and u the point's own random number in [0, 1):

    level = how many of the distances D₁ … D₁₅ are at most d / (1 + width·u)

So a tree switches between D and (1 + width)·D, never nearer than it may, and neighbours not together. u follows from
the attribute `id` of the points, as scattering nodes give it, else from their index: it stays when the camera moves.
Points may have the attributes `rotation` (rotation or Euler angles) and `scale` (number or vector).

Instances keep one mesh for all, so 100,000 trees take little memory, and have no transition and no continuous pruning:
what looks at a tree's distance alone is a variant.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import reduce

import bpy

from .node_laws import LENGTH, NEVER, SHARE, Camera, add_modifier, declare, group_of_layout
from .sections import Section

GROUP_NAME = "Leafcloud Forest"
MOST_VARIANTS = 16

_LAYOUT_KEY = "leafcloud_forest_layout"
_LAYOUT = 1
"""Written into the group; raised when inputs or laws change, so that a file made earlier keeps its own group."""


@dataclass(frozen=True)
class ForestSettings:
    """From where the variants of a forest are drawn. Distances are in units of the object with the points.

    distances: D₁ …, from where the second variant is drawn, the third, and so on, for a tree of scale 1. They do not
        fall; at most 15, each at least 0.
    centre: the point that they are taken from, in the coordinates in which the variants stand.
    width: the share of a distance within which trees switch, each at its own place. In [0, 1].
    far: points that are farther than this are not drawn. ≥ 0.

    Raises `ValueError` for a value that is outside its range or not finite, and for too many distances.
    """

    distances: tuple[float, ...]
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)
    width: float = 0.15
    far: float = NEVER

    def __post_init__(self) -> None:
        limits = {
            "distances": (len(self.distances) < MOST_VARIANTS, f"at most {MOST_VARIANTS - 1} numbers"),
            "centre": (True, "finite"),
            "width": (0.0 <= self.width <= 1.0, "in [0, 1]"),
            "far": (self.far >= 0.0, "at least 0"),
        }
        for name, (holds, limit) in limits.items():
            value = getattr(self, name)
            if not (holds and all(map(math.isfinite, value if isinstance(value, tuple) else (value,)))):
                raise ValueError(f"{name} is {value}, it must be {limit}")
        if list(self.distances) != sorted(self.distances) or min(self.distances, default=0.0) < 0.0:
            raise ValueError(f"distances are {self.distances}, they must be at least 0 and not fall")


def forest_group() -> bpy.types.NodeTree:
    """The node group of this file: the one that is there, else a new one."""
    return group_of_layout(GROUP_NAME, _LAYOUT_KEY, _LAYOUT, _add_interface, _add_nodes)


def add_forest_modifier(
    obj: bpy.types.Object, variants: bpy.types.Collection, settings: ForestSettings
) -> bpy.types.NodesModifier:
    """Plants a tree on every point of `obj`, in place of its geometry. It needs neither the add-on nor Python then.

    `variants` need not be in any scene, `obj` is not in it.
    """
    values = {"Variants": variants, "Centre": settings.centre, "Width": settings.width, "Far": settings.far}
    values |= {_from(number): distance for number, distance in enumerate(settings.distances, start=1)}
    return add_modifier(obj, GROUP_NAME, forest_group(), values)


def _from(number: int) -> str:
    """The input that says from where the variant is drawn that has `number` others before it."""
    return f"From {number}"


def _add_interface(tree: bpy.types.NodeTree) -> None:
    """Declares the group's inputs. Their names are a promise to files and scripts; their panels are not."""
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    variants = "Objects or collections in the order of their names: the tree, finest first"
    declare(tree, "Variants", "Collection", variants)
    centre = "Point of the variants that the distance to the camera is taken from"
    declare(tree, "Centre", "Vector", centre, subtype="XYZ")
    width = "Share of a distance within which trees switch, each at its own place"
    declare(tree, "Width", "Float", width, default_value=0.15, **SHARE)
    far = "Distance beyond which points are not drawn"
    declare(tree, "Far", "Float", far, default_value=NEVER, **LENGTH)

    panel = tree.interface.new_panel("Distances")
    for number in range(1, MOST_VARIANTS):
        description = f"Distance from which the variant is drawn that has {number} before it"
        declare(tree, _from(number), "Float", description, panel, default_value=NEVER, **LENGTH)


def _add_nodes(tree: bpy.types.NodeTree) -> None:
    section = Section(tree, "Distance d to the camera", (-3200.0, 0.0))
    camera = Camera(section)
    rotation = section.attribute("QUATERNION", "rotation")
    scale = section.vector_attribute("scale", missing=(1.0, 1.0, 1.0))
    position = section.result("GeometryNodeInputPosition")
    arm = section.vector("SUBTRACT", camera.location, position, label="Camera from point")
    back = section.result("FunctionNodeInvertRotation", rotation)
    turned = section.result("FunctionNodeRotateVector", arm, back, label="Turned as the tree")
    there = section.vector("DIVIDE", turned, scale, label="Camera seen from the tree")
    own_distance = camera.distance(section, there, section.group_input("Centre"), label="d in its own units")
    distance = camera.distance(section, camera.location, position, label="Distance of the point")
    drawn = section.compare(distance, "LESS_EQUAL", section.group_input("Far"), label="Not too far")

    section = Section(tree, "Which variant?", (-1200.0, 0.0))
    level = _level(section, own_distance)

    section = Section(tree, "Plant", (3000.0, 0.0))
    collection = section.group_input("Variants")
    variants = section.result("GeometryNodeCollectionInfo", collection, True, False, label="Variants")
    count = section.result("GeometryNodeAttributeDomainSize", variants, label="How many?", component="INSTANCES")
    level = section.math("MINIMUM", level, section.math("SUBTRACT", count, 1.0, label="The coarsest"), label="Level")
    points = section.group_input("Geometry")
    operands = (points, drawn, variants, True, level, rotation, scale)
    section.node("NodeGroupOutput", section.result("GeometryNodeInstanceOnPoints", *operands, label="Plant"))


def _level(section: Section, distance: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    """How many of the variants' distances, each at the point's own place in its width, are at most `distance`."""
    own = section.result("FunctionNodeRandomValue", 0.0, 1.0, label="u", data_type="FLOAT")
    width = section.math("MAXIMUM", section.group_input("Width"), 0.0, label="Width")
    late = section.math("MULTIPLY_ADD", width, own, 1.0, label="1 + width·u")
    seen = section.math("DIVIDE", distance, late, label="d / (1 + width·u)")
    reached = [
        section.compare(seen, "GREATER_EQUAL", section.group_input(_from(number)), label=f"At least {_from(number)}?")
        for number in range(1, MOST_VARIANTS)
    ]
    return reduce(lambda sum, each: section.math("ADD", sum, each), reached)
